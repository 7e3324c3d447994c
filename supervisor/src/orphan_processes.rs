//! Orphan processes: processes that the programs of a run started and left running. They are killed and
//! reported at the end of the run.
//!
//! The supervisor kills them as its children. If the supervisor was killed, a separate process does, the
//! reaper; if that was killed too, the next run or `phalanx clean`. The latter two recognize them by an
//! environment variable.

use std::collections::BTreeSet;
use std::fs;
use std::io::{self, Read as _, Write as _};
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use protocol::process::{Stderr, exit, set_thread_name};
use rustix::process::{
    Pid, Signal, child_subreaper, getpid, getppid, kill_process, set_child_subreaper,
};

use crate::child::{Child, RUN_ROOT_VARIABLE, close_inherited_descriptors};
use crate::keeper;
use crate::orphans::{self, describe_orphan, find_log, is_own_process, is_running};
use crate::spawn::{Launcher, ProcessRole, SpawnError};
use crate::tree;

/// Maximum time to wait for killed processes to exit.
const KILLED_EXIT_TIMEOUT: Duration = Duration::from_secs(5);
/// Polling interval while killed processes exit.
const POLL_INTERVAL: Duration = Duration::from_millis(1);

/// Guard that makes this process the subreaper of processes started after its creation. Drop it after all
/// children started since then have exited: it kills the remaining ones.
pub(crate) struct OrphanReaper {
    /// Children that existed before.
    earlier_children: BTreeSet<i32>,
    /// Folder of the programs' logs. A process that left another is identified by its output file.
    log_folder: PathBuf,
    /// Process that kills the orphans if this process is killed.
    reaper: Option<Child>,
}

impl OrphanReaper {
    /// Makes this process a subreaper, and remembers its present children.
    pub(crate) fn watch(logs: &Path) -> OrphanReaper {
        if let Err(error) = set_child_subreaper(Some(getpid())) {
            tracing::warn!(%error, "orphan processes of programs will not be found");
        }
        let logs = logs.canonicalize().unwrap_or_else(|_| logs.into());
        let earlier_children = orphans::list_child_pids();
        orphans::add_known_children(earlier_children.iter().map(|&pid| pid as u32));
        OrphanReaper { earlier_children, log_folder: logs, reaper: None }
    }

    /// Starts the reaper, so that orphans are killed even if this process is killed.
    /// # Errors
    /// The processes of a program cannot be found on this system, so that none could be killed or frozen as
    /// a whole; or the reaper cannot be started.
    pub(crate) fn start_reaper_process(
        &mut self,
        launcher: &Launcher,
        run_root: &Path,
    ) -> Result<(), SpawnError> {
        let role = ProcessRole::Reaper { run_root, logs: &self.log_folder };
        let reaper = launcher.spawn(role, &self.log_folder.join("reaper.jsonl"))?;
        let pid = reaper.pid();
        self.earlier_children.insert(pid as i32);
        self.reaper = Some(reaper);
        let is_subreaper = child_subreaper().is_ok_and(|subreaper| subreaper.is_some());
        match is_subreaper
            && tree::descendants(std::process::id()).contains(&pid)
            && is_running(pid as i32)
        {
            true => Ok(()),
            false => Err(SpawnError::unsupported_programs()),
        }
    }
}

/// Runs the reaper: waits until the supervisor is gone, and kills all remaining processes of its run.
pub fn run_reaper(run_root: &Path, logs: &Path) -> u8 {
    set_thread_name("phalanx-reaper");
    let supervisor = getppid();
    if let Err(error) = close_inherited_descriptors() {
        let _ = writeln!(Stderr, "cannot begin: {error}");
        return exit::INFRASTRUCTURE_FAILURE;
    }
    // No data is ever written: the read returns when the supervisor's end closes.
    let _ = io::stdin().read(&mut [0]);
    // The descriptors of a dying process close before its children receive their signal.
    let start = Instant::now();
    while getppid() == supervisor && start.elapsed() < KILLED_EXIT_TIMEOUT {
        std::thread::sleep(POLL_INTERVAL);
    }
    for message in kill_processes_of_run(run_root, Some(logs)) {
        let _ = writeln!(Stderr, "{{\"level\":\"WARN\",\"message\":{message:?}}}");
    }
    exit::OK
}

/// Kills every process of a run whose supervisor is gone, and waits until they have exited, at most
/// `KILLED_EXIT_TIMEOUT`. Returns a message for each one that a program of the run left behind.
pub fn kill_processes_of_run(run_root: &Path, logs: Option<&Path>) -> Vec<String> {
    let (start, mut messages) = (Instant::now(), Vec::new());
    let mut killed = BTreeSet::new();
    loop {
        // Keepers exit by themselves, after all processes below them.
        let is_of_the_run = |&pid: &i32| {
            pid != current_pid()
                && (belongs_to_run(pid, run_root) || find_log(pid, logs).is_some())
                && !is_keeper(pid)
        };
        let remaining: Vec<i32> =
            pids().filter(is_of_the_run).filter(|&pid| is_running(pid)).collect();
        if remaining.is_empty() || start.elapsed() > KILLED_EXIT_TIMEOUT {
            return messages;
        }
        for pid in remaining.into_iter().filter(|&pid| killed.insert(pid)) {
            let line = fs::read(format!("/proc/{pid}/cmdline")).unwrap_or_default();
            // The kernel or the keeper kills the run's own processes. A dying process has no command line.
            if !has_brief(&line) && !is_own_process(pid) && !line.is_empty() {
                messages.push(format!("{}; killed it", describe_orphan(pid, logs)));
            }
            if let Some(pid) = Pid::from_raw(pid) {
                let _ = kill_process(pid, Signal::KILL);
            }
        }
        std::thread::sleep(POLL_INTERVAL);
    }
}

/// Returns whether a process or one of its ancestors was started for this run, by its environment.
fn belongs_to_run(pid: i32, run_root: &Path) -> bool {
    let environment = fs::read(format!("/proc/{pid}/environ")).unwrap_or_default();
    let expected_entry =
        [RUN_ROOT_VARIABLE.as_bytes(), b"=", run_root.as_os_str().as_encoded_bytes()].concat();
    environment.split(|&byte| byte == 0).any(|entry| entry == expected_entry)
}

/// Returns whether a process is a keeper.
fn is_keeper(pid: i32) -> bool {
    let name = fs::read_to_string(format!("/proc/{pid}/comm")).unwrap_or_default();
    name.trim_end() == keeper::PROCESS_NAME
}

/// Returns whether a command line names a brief, as for agents and plants.
fn has_brief(line: &[u8]) -> bool {
    let mut arguments = line.split(|&byte| byte == 0).map(String::from_utf8_lossy);
    arguments.any(|argument| argument.contains("/briefs/") && argument.ends_with(".toml"))
}

fn current_pid() -> i32 {
    getpid().as_raw_nonzero().get()
}

impl Drop for OrphanReaper {
    fn drop(&mut self) {
        orphans::kill_children(
            |pid| !self.earlier_children.contains(&pid),
            Some(&self.log_folder),
            true,
        );
    }
}

/// Returns the IDs of all processes.
fn pids() -> impl Iterator<Item = i32> {
    let entries = fs::read_dir("/proc").into_iter().flatten().flatten();
    entries.filter_map(|entry| entry.file_name().to_str()?.parse().ok())
}
