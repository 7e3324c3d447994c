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

/// Environment variable that contains the process ID of a child's parent.
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

/// Kills and reaps all orphans. `logs` is the folder of the run's logs. If `warns`, a warning names each.
pub(crate) fn kill_all_orphans(logs: Option<&Path>, warns: bool) {
    let logs = logs.and_then(|logs| logs.canonicalize().ok());
    kill_children(|pid| !known_children().contains(&(pid as u32)), logs.as_deref(), warns);
}

/// Kills and reaps the children that `is_orphan` selects, until there are none. If `warns`, a warning names each.
pub(crate) fn kill_children(is_orphan: impl Fn(i32) -> bool, logs: Option<&Path>, warns: bool) {
    let start = Instant::now();
    let mut killed = BTreeSet::new();
    // Their orphans follow in the next pass.
    loop {
        let remaining = list_child_pids().into_iter().filter(|&pid| is_orphan(pid));
        let remaining: Vec<Pid> = remaining.filter_map(Pid::from_raw).collect();
        if remaining.is_empty() {
            return;
        }
        if start.elapsed() > KILLED_EXIT_TIMEOUT {
            tracing::warn!(
                "{} killed processes do not exit: they are in uninterruptible waits",
                remaining.len()
            );
            return;
        }
        for pid in remaining {
            let number = pid.as_raw_nonzero().get();
            if is_running(number) && killed.insert(number) {
                if warns && !is_own_process(number) {
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
    let output_links = [1, 2].map(|number| Path::new("/proc").join(format!("{pid}/fd/{number}")));
    let output_links = output_links.into_iter().filter_map(|output| output.read_link().ok());
    logs.and_then(|logs| output_links.into_iter().find(|path| path.parent() == Some(logs)))
}

/// Returns whether a process exists and is not dead.
pub(crate) fn is_running(pid: i32) -> bool {
    ProcessSample::read(pid as u32).is_ok_and(|now| now.state != SchedulingState::Exited)
}

/// Returns whether a process is phalanx's own and not a program's. A program that replaces a part of
/// phalanx, and its children, do not have the environment variable of the parent.
pub(crate) fn is_own_process(pid: i32) -> bool {
    let environment = fs::read(format!("/proc/{pid}/environ")).unwrap_or_default();
    let prefix = [PARENT_PID_VARIABLE.as_bytes(), b"="].concat();
    environment.split(|&byte| byte == 0).any(|entry| entry.starts_with(&prefix))
}
