//! Orphans: processes that a dead child of this process left, and that became its children because it is
//! their subreaper.
//!
//! Must not start a process.

use std::collections::BTreeSet;
use std::fs;
use std::path::{Path, PathBuf};
use std::sync::{Mutex, MutexGuard};
use std::time::{Duration, Instant};

use protocol::watchdog::{ProcessSample, SchedulingState};
use rustix::process::{Pid, Signal, WaitOptions, kill_process, waitpid};

use crate::tree;

/// Maximum time to wait for killed processes to exit.
const KILLED_EXIT_TIMEOUT: Duration = Duration::from_secs(5);
/// Polling interval while killed processes exit.
const POLL_INTERVAL: Duration = Duration::from_millis(1);

/// Environment variable that tells a child its parent's process ID.
pub(crate) const PARENT_PID_VARIABLE: &str = "PHALANX_PARENT";

/// Process IDs of children that this process started, or that existed before, and has not reaped. Any other
/// child is an orphan.
static KNOWN_CHILDREN: Mutex<BTreeSet<u32>> = Mutex::new(BTreeSet::new());

fn known_children() -> MutexGuard<'static, BTreeSet<u32>> {
    KNOWN_CHILDREN.lock().unwrap_or_else(|poisoned| poisoned.into_inner())
}

/// Adds children to the known ones.
pub(crate) fn add_known_children(children: impl IntoIterator<Item = u32>) {
    known_children().extend(children);
}

/// Removes a child that was reaped. Returns whether it was known.
pub(crate) fn remove_known_child(child: u32) -> bool {
    known_children().remove(&child)
}

/// Kills and reaps all orphans. `logs` is the folder of the run's logs. If `names`, a warning names each.
pub(crate) fn kill_all_orphans(logs: Option<&Path>, names: bool) {
    let logs = logs.and_then(|logs| logs.canonicalize().ok());
    kill_children(|pid| !known_children().contains(&(pid as u32)), logs.as_deref(), names);
}

/// Kills and reaps the children that `is_left` selects, until there are none. If `names`, a warning names each.
pub(crate) fn kill_children(is_left: impl Fn(i32) -> bool, logs: Option<&Path>, names: bool) {
    let began = Instant::now();
    let mut named = BTreeSet::new();
    // Their orphans follow in the next pass.
    loop {
        let left = list_child_pids().into_iter().filter(|&pid| is_left(pid));
        let left: Vec<Pid> = left.filter_map(Pid::from_raw).collect();
        if left.is_empty() {
            return;
        }
        if began.elapsed() > KILLED_EXIT_TIMEOUT {
            tracing::warn!(
                "{} killed processes do not exit: they are in uninterruptible waits",
                left.len()
            );
            return;
        }
        for pid in left {
            let number = pid.as_raw_nonzero().get();
            if is_running(number) && named.insert(number) {
                if names && !is_own_process(number) {
                    tracing::warn!("{}; killed it", describe_orphan(number, logs));
                }
                let _ = kill_process(pid, Signal::KILL);
            }
            let _ = waitpid(Some(pid), WaitOptions::NOHANG);
        }
        std::thread::sleep(POLL_INTERVAL);
    }
}

/// Returns the children of this process.
pub(crate) fn list_child_pids() -> BTreeSet<i32> {
    tree::child_pids(std::process::id()).into_iter().map(|pid| pid as i32).collect()
}

/// Returns a message that names a process and the robot that left it behind. `logs`: the folder of the run's logs.
pub(crate) fn describe_orphan(pid: i32, logs: Option<&Path>) -> String {
    let proc = PathBuf::from(format!("/proc/{pid}"));
    let program = fs::read_to_string(proc.join("comm")).unwrap_or_default();
    let owner = find_log(pid, logs).and_then(|log| Some(log.file_stem()?.display().to_string()));
    let owner = owner.unwrap_or_else(|| "a program of the run".into());
    format!("{owner} left the process `{}` ({pid}) behind", program.trim_end())
}

/// Returns the log in that folder to which the output of a process goes.
pub(crate) fn find_log(pid: i32, logs: Option<&Path>) -> Option<PathBuf> {
    let outputs = [1, 2].map(|number| Path::new("/proc").join(format!("{pid}/fd/{number}")));
    let outputs = outputs.into_iter().filter_map(|output| output.read_link().ok());
    logs.and_then(|logs| outputs.into_iter().find(|path| path.parent() == Some(logs)))
}

/// Returns whether a process exists and is not dead.
pub(crate) fn is_running(pid: i32) -> bool {
    ProcessSample::read(pid as u32).is_ok_and(|now| now.state != SchedulingState::Exited)
}

/// Returns whether a process is phalanx's own and not a program's. A program that replaces a part of
/// phalanx, and its children, do not have the environment variable of the parent.
pub(crate) fn is_own_process(pid: i32) -> bool {
    let environment = fs::read(format!("/proc/{pid}/environ")).unwrap_or_default();
    let begins = [PARENT_PID_VARIABLE.as_bytes(), b"="].concat();
    environment.split(|&byte| byte == 0).any(|entry| entry.starts_with(&begins))
}
