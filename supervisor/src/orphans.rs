//! Orphans: what a dead child of this process has left, and which falls to it as their subreaper.
//!
//! Must not: start a process.

use std::collections::BTreeSet;
use std::fs;
use std::path::{Path, PathBuf};
use std::sync::{Mutex, MutexGuard};
use std::time::{Duration, Instant};

use protocol::watchdog::{Sample, State};
use rustix::process::{Pid, Signal, WaitOptions, kill_process, waitpid};

use crate::tree;

/// Maximum time to wait for killed processes to end.
const KILLED_MAX: Duration = Duration::from_secs(5);
/// Polling interval while killed processes end.
const LOOK_EVERY: Duration = Duration::from_millis(1);

/// The environment variable that tells a child which process started it.
pub(crate) const PARENT: &str = "PHALANX_PARENT";

/// Process ids of the children that this process has started, or that were there before, and has not reaped. Any other
/// child is an orphan of one of them.
static KNOWN: Mutex<BTreeSet<u32>> = Mutex::new(BTreeSet::new());

fn known() -> MutexGuard<'static, BTreeSet<u32>> {
    KNOWN.lock().unwrap_or_else(|poisoned| poisoned.into_inner())
}

/// Adds children to the known ones.
pub(crate) fn know(children: impl IntoIterator<Item = u32>) {
    known().extend(children);
}

/// Removes a child that was reaped. Returns whether it was known.
pub(crate) fn forget(child: u32) -> bool {
    known().remove(&child)
}

/// Kills and reaps all orphans. `logs`: where the logs of the run are; `names`: each is named in a warning.
pub(crate) fn end_all(logs: Option<&Path>, names: bool) {
    let logs = logs.and_then(|logs| logs.canonicalize().ok());
    end_children(|pid| !known().contains(&(pid as u32)), logs.as_deref(), names);
}

/// Kills and reaps the children that `is_left` chooses, until there are none. `names`: each is named in a warning.
pub(crate) fn end_children(is_left: impl Fn(i32) -> bool, logs: Option<&Path>, names: bool) {
    let began = Instant::now();
    let mut named = BTreeSet::new();
    // Whom they leave behind comes next.
    loop {
        let left = children().into_iter().filter(|&pid| is_left(pid));
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
                if names && !is_own(number) {
                    tracing::warn!("{}; it is killed", name(number, logs));
                }
                let _ = kill_process(pid, Signal::KILL);
            }
            let _ = waitpid(Some(pid), WaitOptions::NOHANG);
        }
        std::thread::sleep(LOOK_EVERY);
    }
}

/// Returns the children of this process.
pub(crate) fn children() -> BTreeSet<i32> {
    tree::children(std::process::id()).into_iter().map(|pid| pid as i32).collect()
}

/// Returns a message that names a process and the robot that left it behind. `logs`: the folder of the run's logs.
pub(crate) fn name(pid: i32, logs: Option<&Path>) -> String {
    let proc = PathBuf::from(format!("/proc/{pid}"));
    let program = fs::read_to_string(proc.join("comm")).unwrap_or_default();
    let owner = log_of(pid, logs).and_then(|log| Some(log.file_stem()?.display().to_string()));
    let owner = owner.unwrap_or_else(|| "a program of the run".into());
    format!("{owner} left the process `{}` ({pid}) behind", program.trim_end())
}

/// Returns the log in that folder to which the output of a process goes.
pub(crate) fn log_of(pid: i32, logs: Option<&Path>) -> Option<PathBuf> {
    let outputs = [1, 2].map(|number| Path::new("/proc").join(format!("{pid}/fd/{number}")));
    let outputs = outputs.into_iter().filter_map(|output| output.read_link().ok());
    logs.and_then(|logs| outputs.into_iter().find(|path| path.parent() == Some(logs)))
}

/// Whether a process is there and not dead.
pub(crate) fn lives(pid: i32) -> bool {
    Sample::of(pid as u32).is_ok_and(|now| now.state != State::Gone)
}

/// Returns whether a process is one of phalanx's own and no program's: the program that a part of phalanx starts, and
/// what that starts, do not have the variable that names the parent.
pub(crate) fn is_own(pid: i32) -> bool {
    let environment = fs::read(format!("/proc/{pid}/environ")).unwrap_or_default();
    let begins = [PARENT.as_bytes(), b"="].concat();
    environment.split(|&byte| byte == 0).any(|entry| entry.starts_with(&begins))
}
