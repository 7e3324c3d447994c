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
use protocol::watchdog::{Sample, State};
use rustix::process::{
    Pid, Signal, WaitOptions, getpid, getppid, kill_process, set_child_subreaper, waitpid,
};

use crate::child::{Child, PARENT, RUN, keep_three_descriptors};
use crate::spawn::{Launcher, Role, SpawnError};

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
        LeftBehind { before: children(), logs, reaper: None }
    }

    /// They end even if this process is killed.
    pub(crate) fn reap_after_a_kill(
        &mut self,
        launcher: &Launcher,
        run_root: &Path,
    ) -> Result<(), SpawnError> {
        let role = Role::Reaper { run_root, logs: &self.logs };
        let reaper = launcher.spawn(role, &self.logs.join("reaper.jsonl"))?;
        self.before.insert(reaper.pid() as i32);
        self.reaper = Some(reaper);
        Ok(())
    }
}

/// Who it is, in words. `logs`: where the logs of the run are, if that is known.
fn name(pid: i32, logs: Option<&Path>) -> String {
    let proc = PathBuf::from(format!("/proc/{pid}"));
    let program = fs::read_to_string(proc.join("comm")).unwrap_or_default();
    let owner = log_of(pid, logs).and_then(|log| Some(log.file_stem()?.display().to_string()));
    let owner = owner.unwrap_or_else(|| "a program of the run".into());
    format!("{owner} left the process `{}` ({pid}) behind", program.trim_end())
}

/// The log that takes its output, of those in that folder.
fn log_of(pid: i32, logs: Option<&Path>) -> Option<PathBuf> {
    let outputs = [1, 2].map(|number| Path::new("/proc").join(format!("{pid}/fd/{number}")));
    let outputs = outputs.into_iter().filter_map(|output| output.read_link().ok());
    logs.and_then(|logs| outputs.into_iter().find(|path| path.parent() == Some(logs)))
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
        let is_of_the_run = |&pid: &i32| {
            pid != own_pid() && (has_run(pid, run_root) || log_of(pid, logs).is_some())
        };
        let left: Vec<i32> = pids().filter(is_of_the_run).filter(|&pid| lives(pid)).collect();
        if left.is_empty() || began.elapsed() > KILLED_MAX {
            return named;
        }
        for pid in left.into_iter().filter(|&pid| killed.insert(pid)) {
            let line = fs::read(format!("/proc/{pid}/cmdline")).unwrap_or_default();
            // The kernel kills those that the supervisor started; each leads a group. Whoever is dying has no line left.
            let is_started_by_the_supervisor =
                has_brief(&line) && stat(pid, 2).is_some_and(|group| group == pid);
            if !is_started_by_the_supervisor && !is_own(pid) && !line.is_empty() {
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

/// Returns whether a process is one of phalanx's own and no program's: the program that a part of phalanx becomes, and
/// what that starts, do not have the variable that names the parent.
fn is_own(pid: i32) -> bool {
    let environment = fs::read(format!("/proc/{pid}/environ")).unwrap_or_default();
    let begins = [PARENT.as_bytes(), b"="].concat();
    environment.split(|&byte| byte == 0).any(|entry| entry.starts_with(&begins))
}

/// Whether a command line names a brief, as those of agents and plants do.
fn has_brief(line: &[u8]) -> bool {
    let mut words = line.split(|&byte| byte == 0).map(String::from_utf8_lossy);
    words.any(|word| word.contains("/briefs/") && word.ends_with(".toml"))
}

fn lives(pid: i32) -> bool {
    Sample::of(pid as u32).is_ok_and(|now| now.state != State::Gone)
}

fn own_pid() -> i32 {
    getpid().as_raw_nonzero().get()
}

impl Drop for LeftBehind {
    fn drop(&mut self) {
        let began = Instant::now();
        let mut named = BTreeSet::new();
        // Whom they leave behind comes next.
        loop {
            let left = children().into_iter().filter(|pid| !self.before.contains(pid));
            let left: Vec<Pid> = left.filter_map(Pid::from_raw).collect();
            if left.is_empty() {
                return;
            }
            if began.elapsed() > KILLED_MAX {
                tracing::warn!("{} killed processes do not end: the kernel holds them", left.len());
                return;
            }
            for pid in left {
                let number = pid.as_raw_nonzero().get();
                if lives(number) && named.insert(number) {
                    if !is_own(number) {
                        tracing::warn!("{}; it is killed", name(number, Some(&self.logs)));
                    }
                    let _ = kill_process(pid, Signal::KILL);
                }
                let _ = waitpid(Some(pid), WaitOptions::NOHANG);
            }
            std::thread::sleep(LOOK_EVERY);
        }
    }
}

/// The children of this process. Not every kernel lists them.
fn children() -> BTreeSet<i32> {
    pids().filter(|&pid| stat(pid, 1) == Some(own_pid())).collect()
}

/// All processes.
fn pids() -> impl Iterator<Item = i32> {
    let entries = fs::read_dir("/proc").into_iter().flatten().flatten();
    entries.filter_map(|entry| entry.file_name().to_str()?.parse().ok())
}

/// A number that the kernel tells of a process: behind its name, which may have anything in it, and its state (0), are
/// its parent (1) and its group (2).
fn stat(pid: i32, place: usize) -> Option<i32> {
    let stat = fs::read_to_string(format!("/proc/{pid}/stat")).ok()?;
    stat.rsplit(')').next()?.split_whitespace().nth(place)?.parse().ok()
}
