//! Processes that the programs of a run started and left behind: they end with the run, and are named.
//!
//! The supervisor ends them, to whom they fall as children. Where it was killed itself, another process does, the reaper;
//! where that was killed too, the next run or `phalanx clean`. Those know them by a variable of their environment.

use std::collections::BTreeSet;
use std::fs;
use std::io::{self, Read as _, Write as _};
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use protocol::process::{Stderr, exit, set_name};
use rustix::process::{
    Pid, Signal, child_subreaper, getpid, getppid, kill_process, set_child_subreaper,
};

use crate::child::{Child, RUN, keep_three_descriptors};
use crate::keeper;
use crate::orphans::{self, is_own, lives, log_of, name};
use crate::spawn::{Launcher, Role, SpawnError};
use crate::tree;

/// For those that were killed nobody waits longer than this.
const KILLED_MAX: Duration = Duration::from_secs(5);
/// How often it is looked whether they are gone.
const LOOK_EVERY: Duration = Duration::from_millis(1);

/// From when it is made, whoever is left by a dead child becomes a child of this process. Dropped once all children that
/// were started since then have ended, it ends whoever is there.
pub(crate) struct LeftBehind {
    /// Children from before.
    before: BTreeSet<i32>,
    /// Where the logs of the programs are: whoever left one shows by its output.
    logs: PathBuf,
    /// Who ends them if this process is killed.
    reaper: Option<Child>,
}

impl LeftBehind {
    /// Nobody is left behind yet.
    pub(crate) fn watch(logs: &Path) -> LeftBehind {
        if let Err(error) = set_child_subreaper(Some(getpid())) {
            tracing::warn!(%error, "processes that programs leave behind will not be found");
        }
        let logs = logs.canonicalize().unwrap_or_else(|_| logs.into());
        let before = orphans::children();
        orphans::know(before.iter().map(|&pid| pid as u32));
        LeftBehind { before, logs, reaper: None }
    }

    /// They end even if this process is killed. An error if the processes of a program cannot be found at all, so that
    /// none could be killed or frozen as a whole.
    pub(crate) fn reap_after_a_kill(
        &mut self,
        launcher: &Launcher,
        run_root: &Path,
    ) -> Result<(), SpawnError> {
        let role = Role::Reaper { run_root, logs: &self.logs };
        let reaper = launcher.spawn(role, &self.logs.join("reaper.jsonl"))?;
        let pid = reaper.pid();
        self.before.insert(pid as i32);
        self.reaper = Some(reaper);
        let is_subreaper = child_subreaper().is_ok_and(|subreaper| subreaper.is_some());
        match is_subreaper && tree::below(std::process::id()).contains(&pid) && lives(pid as i32) {
            true => Ok(()),
            false => Err(SpawnError::of_programs()),
        }
    }
}

/// What the reaper does: waits until the supervisor is gone, and ends all that is left of its run.
pub fn reap(run_root: &Path, logs: &Path) -> u8 {
    set_name("phalanx-reaper");
    let supervisor = getppid();
    if let Err(error) = keep_three_descriptors() {
        let _ = writeln!(Stderr, "cannot begin: {error}");
        return exit::INFRASTRUCTURE;
    }
    // Nobody writes: this ends when whoever holds the other end does.
    let _ = io::stdin().read(&mut [0]);
    // Its descriptors close before its children are told.
    let began = Instant::now();
    while getppid() == supervisor && began.elapsed() < KILLED_MAX {
        std::thread::sleep(LOOK_EVERY);
    }
    for named in end_all_of(run_root, Some(logs)) {
        let _ = writeln!(Stderr, "{{\"level\":\"WARN\",\"message\":{named:?}}}");
    }
    exit::OK
}

/// Kills every process of a run whose supervisor is gone, and returns once they are, or the kernel holds them. Which ones
/// were left behind by a program of it, in words.
pub fn end_all_of(run_root: &Path, logs: Option<&Path>) -> Vec<String> {
    let (began, mut named) = (Instant::now(), Vec::new());
    let mut killed = BTreeSet::new();
    loop {
        // Keepers end by themselves, after all that is below them.
        let is_of_the_run = |&pid: &i32| {
            pid != own_pid()
                && (has_run(pid, run_root) || log_of(pid, logs).is_some())
                && !is_keeper(pid)
        };
        let left: Vec<i32> = pids().filter(is_of_the_run).filter(|&pid| lives(pid)).collect();
        if left.is_empty() || began.elapsed() > KILLED_MAX {
            return named;
        }
        for pid in left.into_iter().filter(|&pid| killed.insert(pid)) {
            let line = fs::read(format!("/proc/{pid}/cmdline")).unwrap_or_default();
            // The kernel, or the keeper, kills those of the run itself. A dying process has no line left.
            if !has_brief(&line) && !is_own(pid) && !line.is_empty() {
                named.push(format!("{}; it is killed", name(pid, logs)));
            }
            if let Some(pid) = Pid::from_raw(pid) {
                let _ = kill_process(pid, Signal::KILL);
            }
        }
        std::thread::sleep(LOOK_EVERY);
    }
}

/// Whether a process, or whoever started it, was started for that run.
fn has_run(pid: i32, run_root: &Path) -> bool {
    let environment = fs::read(format!("/proc/{pid}/environ")).unwrap_or_default();
    let wanted = [RUN.as_bytes(), b"=", run_root.as_os_str().as_encoded_bytes()].concat();
    environment.split(|&byte| byte == 0).any(|entry| entry == wanted)
}

/// Returns whether a process is a keeper.
fn is_keeper(pid: i32) -> bool {
    let name = fs::read_to_string(format!("/proc/{pid}/comm")).unwrap_or_default();
    name.trim_end() == keeper::NAME
}

/// Whether a command line names a brief, as those of agents and plants do.
fn has_brief(line: &[u8]) -> bool {
    let mut words = line.split(|&byte| byte == 0).map(String::from_utf8_lossy);
    words.any(|word| word.contains("/briefs/") && word.ends_with(".toml"))
}

fn own_pid() -> i32 {
    getpid().as_raw_nonzero().get()
}

impl Drop for LeftBehind {
    fn drop(&mut self) {
        orphans::end_children(|pid| !self.before.contains(&pid), Some(&self.logs), true);
    }
}

/// All processes.
fn pids() -> impl Iterator<Item = i32> {
    let entries = fs::read_dir("/proc").into_iter().flatten().flatten();
    entries.filter_map(|entry| entry.file_name().to_str()?.parse().ok())
}
