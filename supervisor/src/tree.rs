//! The processes below one process: listed, sampled and signalled as one.
//!
//! The process at the top is a keeper (`keeper`): a subreaper, so that a process whose parent dies stays below it.
//! Must not: decide when a robot is to be signalled.

use std::collections::BTreeSet;
use std::fs;
use std::io;
use std::time::{Duration, Instant};

use protocol::clock;
use protocol::watchdog::{ProcessSample, SchedulingState};
use rustix::process::{Pid, PidfdFlags, Signal, pidfd_open, pidfd_send_signal};

/// Maximum time to wait until all processes below a keeper have stopped. Then they are not frozen, and the run ends.
const STOP_DURATION_MAX: Duration = Duration::from_secs(2);
/// Time after which a process in an uninterruptible wait counts as stopped. A process that waits for the
/// child of a `vfork` leaves its wait only after the child, which is stopped, continues.
const UNINTERRUPTIBLE_TIMEOUT: Duration = Duration::from_millis(50);
/// Maximum time to wait until killed processes are dead. The keeper reaps the rest.
const KILL_TIMEOUT: Duration = Duration::from_millis(100);
/// Pause between two passes over the processes.
const PASS_INTERVAL: Duration = Duration::from_micros(200);

/// Failure to signal all processes below a keeper.
#[derive(Debug, thiserror::Error)]
pub enum SignalError {
    /// The kernel refused to send the signal.
    #[error("{signal} was not sent to its process {pid}: {reason}")]
    Refused { signal: &'static str, pid: u32, reason: String },
    /// Processes fork faster than they can be stopped, or some do not stop.
    #[error("its processes did not stop within {} s of SIGSTOP: {left}", STOP_DURATION_MAX.as_secs())]
    NotStopped { left: String },
}

impl SignalError {
    /// Returns the error for a signal that the kernel refused with this error number.
    pub(crate) fn from_refusal(signal: Signal, pid: u32, error: io::Error) -> SignalError {
        let hint = match error.raw_os_error() {
            Some(libc::EPERM) => {
                " (its program runs as another user, by setuid or sudo, or a seccomp filter forbids the signal: let it \
                 run as the user of phalanx)"
            }
            _ => "",
        };
        SignalError::Refused { signal: signal_name(signal), pid, reason: format!("{error}{hint}") }
    }
}

impl SignalError {
    /// Returns the intended action of the signal, as text.
    pub(crate) fn action_text(&self) -> &'static str {
        match self {
            SignalError::Refused { signal: "SIGKILL", .. } => "killed",
            SignalError::Refused { signal: "SIGCONT", .. } => "continued",
            SignalError::Refused { .. } | SignalError::NotStopped { .. } => "frozen",
        }
    }
}

fn signal_name(signal: Signal) -> &'static str {
    match signal {
        Signal::KILL => "SIGKILL",
        Signal::STOP => "SIGSTOP",
        Signal::CONT => "SIGCONT",
        Signal::TERM => "SIGTERM",
        _ => "a signal",
    }
}

/// Returns the ids of all processes below `root`, parents before their children. If a process exits during the call,
/// its children may be missing: the next call finds them as children of the subreaper.
pub(crate) fn descendants(root: u32) -> Vec<u32> {
    let parents = (!lists_children()).then(list_parents);
    let mut found = Vec::new();
    let mut seen = BTreeSet::from([root]);
    let mut stack = vec![root];
    while let Some(pid) = stack.pop() {
        let children = match &parents {
            None => read_thread_children(pid),
            Some(parents) => {
                parents.iter().filter(|(_, parent)| *parent == pid).map(|(pid, _)| *pid).collect()
            }
        };
        for child in children {
            if seen.insert(child) {
                found.push(child);
                stack.push(child);
            }
        }
    }
    found
}

/// Returns the children of a process, dead ones that are not reaped included.
pub(crate) fn child_pids(pid: u32) -> Vec<u32> {
    match lists_children() {
        true => read_thread_children(pid),
        false => {
            let all = list_parents().into_iter();
            all.filter(|(_, parent)| *parent == pid).map(|(child, _)| child).collect()
        }
    }
}

/// Returns whether the kernel lists the children of a thread (CONFIG_PROC_CHILDREN).
fn lists_children() -> bool {
    fs::exists("/proc/thread-self/children").unwrap_or(false)
}

fn read_thread_children(pid: u32) -> Vec<u32> {
    let threads = fs::read_dir(format!("/proc/{pid}/task")).into_iter().flatten().flatten();
    let lists =
        threads.filter_map(|thread| fs::read_to_string(thread.path().join("children")).ok());
    let ids = |list: String| list.split_whitespace().filter_map(|id| id.parse().ok()).collect();
    lists.flat_map(|list| -> Vec<u32> { ids(list) }).collect()
}

/// Returns each process with its parent.
fn list_parents() -> Vec<(u32, u32)> {
    let entries = fs::read_dir("/proc").into_iter().flatten().flatten();
    let pids = entries.filter_map(|entry| entry.file_name().to_str()?.parse::<u32>().ok());
    pids.filter_map(|pid| {
        let stat = fs::read_to_string(format!("/proc/{pid}/stat")).ok()?;
        let parent = stat.rsplit(')').next()?.split_whitespace().nth(1)?.parse().ok()?;
        Some((pid, parent))
    })
    .collect()
}

/// Returns the alive processes below `root`, each with its state.
fn alive_descendants(root: u32) -> Vec<(u32, ProcessSample)> {
    let sampled =
        descendants(root).into_iter().filter_map(|pid| Some((pid, ProcessSample::read(pid).ok()?)));
    sampled.filter(|(_, sample)| sample.state != SchedulingState::Exited).collect()
}

/// Samples the processes below `root` as one process: its processor time is their sum. It is runnable if
/// one of them is, and stopped if all of them are. Fails if `root` is dead.
pub(crate) fn sample_tree(root: u32) -> io::Result<ProcessSample> {
    let root_sample = ProcessSample::read(root)?;
    let members = alive_descendants(root);
    let state = match members.iter().any(|(_, sample)| sample.state == SchedulingState::Runnable) {
        _ if members.is_empty() => root_sample.state,
        true => SchedulingState::Runnable,
        false if are_stopped(&members) => SchedulingState::Stopped,
        false => SchedulingState::Blocked,
    };
    let cpu_time = root_sample.cpu_time + members.iter().map(|(_, sample)| sample.cpu_time).sum();
    Ok(ProcessSample {
        state,
        cpu_time,
        time_ns: clock::now_ns(),
        start_time_ticks: root_sample.start_time_ticks,
    })
}

/// Returns whether there are processes below `root`, and all of them are stopped.
pub(crate) fn is_stopped(root: u32) -> bool {
    are_stopped(&alive_descendants(root))
}

/// Returns whether some of the processes are stopped, and none of the others may run: a process that waits for the
/// child of a `vfork` stays in an uninterruptible wait while the child is stopped.
fn are_stopped(members: &[(u32, ProcessSample)]) -> bool {
    let is_stopped = |sample: &ProcessSample| sample.state == SchedulingState::Stopped;
    members.iter().any(|(_, sample)| is_stopped(sample))
        && members.iter().all(|(pid, sample)| is_stopped(sample) || !may_run(*pid, false))
}

/// Returns the private memory of the processes below `root` together, in bytes, if there are at least two:
/// the kernel enforces the bound of a single one.
pub(crate) fn private_memory_bytes(root: u32) -> Option<u64> {
    let members = alive_descendants(root);
    let bytes = |pid: u32| {
        let status = fs::read_to_string(format!("/proc/{pid}/status")).ok()?;
        let line = status.lines().find_map(|line| line.strip_prefix("RssAnon:"))?;
        Some(1024 * line.split_whitespace().next()?.parse::<u64>().ok()?)
    };
    (members.len() > 1).then(|| members.iter().filter_map(|(pid, _)| bytes(*pid)).sum())
}

/// Sends a signal to one process, unless its ID now belongs to another.
fn send_signal(pid: u32, sample: &ProcessSample, signal: Signal) -> Result<(), SignalError> {
    let Some(id) = Pid::from_raw(pid as i32) else { return Ok(()) };
    let Ok(pidfd) = pidfd_open(id, PidfdFlags::empty()) else { return Ok(()) };
    if !ProcessSample::read(pid).is_ok_and(|now| now.start_time_ticks == sample.start_time_ticks) {
        return Ok(());
    }
    match pidfd_send_signal(&pidfd, signal) {
        Ok(()) | Err(rustix::io::Errno::SRCH) => Ok(()),
        Err(error) => Err(SignalError::from_refusal(signal, pid, error.into())),
    }
}

/// Sends a signal to each alive process below `root`. Returns the first error after all were tried.
pub(crate) fn signal_all(root: u32, signal: Signal) -> Result<(), SignalError> {
    let results =
        alive_descendants(root).into_iter().map(|(pid, sample)| send_signal(pid, &sample, signal));
    results.fold(Ok(()), Result::and)
}

/// Stops every process below `root`, and returns once none of them can run or fork: two passes in a row have found
/// the same processes, all stopped. The first finds them stopped, so the list of the second contains every process that
/// they had forked before.
pub(crate) fn stop_all(root: u32) -> Result<(), SignalError> {
    let start = Instant::now();
    let mut stopped_ids = None;
    loop {
        let members = alive_descendants(root);
        for (pid, sample) in &members {
            if sample.state != SchedulingState::Stopped {
                send_signal(*pid, sample, Signal::STOP)?;
            }
        }
        let counts_uninterruptible = start.elapsed() < UNINTERRUPTIBLE_TIMEOUT;
        let running: Vec<u32> = members
            .iter()
            .map(|(pid, _)| *pid)
            .filter(|&pid| may_run(pid, counts_uninterruptible))
            .collect();
        let ids: Vec<u32> = members.into_iter().map(|(pid, _)| pid).collect();
        let all_stopped = running.is_empty();
        if all_stopped && stopped_ids.as_ref() == Some(&ids) {
            return Ok(());
        }
        if start.elapsed() > STOP_DURATION_MAX {
            let running_text =
                running.iter().map(|pid| format!("{pid}")).collect::<Vec<_>>().join(", ");
            return Err(SignalError::NotStopped { left: running_text });
        }
        stopped_ids = all_stopped.then_some(ids);
        std::thread::sleep(PASS_INTERVAL);
    }
}

/// Returns whether a thread of a process may still run before SIGSTOP takes effect. A thread stops when it leaves the
/// kernel, and completes a fork before. `counts_uninterruptible`: an uninterruptible wait counts as running.
fn may_run(pid: u32, counts_uninterruptible: bool) -> bool {
    let threads = fs::read_dir(format!("/proc/{pid}/task")).into_iter().flatten().flatten();
    let stats = threads.filter_map(|thread| fs::read_to_string(thread.path().join("stat")).ok());
    let mut states = stats.filter_map(|stat| stat.rsplit(')').next()?.trim_start().chars().next());
    states.any(|state| match state {
        'T' | 't' | 'Z' | 'X' | 'x' => false,
        'D' => counts_uninterruptible,
        _ => true,
    })
}

/// Kills every process below `root`, and repeats that until none is alive or [`KILL_TIMEOUT`] is over. A killed
/// process does not fork, so each pass finds only processes that were forked before. Returns at once if the kernel
/// refuses a signal.
pub(crate) fn kill_all(root: u32) -> Result<(), SignalError> {
    let start = Instant::now();
    loop {
        let members = alive_descendants(root);
        let results = members.iter().map(|(pid, sample)| send_signal(*pid, sample, Signal::KILL));
        results.fold(Ok(()), Result::and)?;
        if members.is_empty() || start.elapsed() > KILL_TIMEOUT {
            return Ok(());
        }
        std::thread::sleep(PASS_INTERVAL);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::process::{Child, Command};

    /// Processes of a shell that are killed at the end of a test.
    struct Tree(Child);

    impl Tree {
        /// Starts a shell, and waits until `count` processes are below it.
        fn start(script: &str, count: usize) -> Tree {
            let tree = Tree(Command::new("sh").args(["-c", script]).spawn().unwrap());
            let start = Instant::now();
            while alive_descendants(tree.0.id()).len() < count {
                assert!(start.elapsed() < Duration::from_secs(60), "{count} processes");
                std::thread::sleep(PASS_INTERVAL);
            }
            tree
        }
    }

    impl Drop for Tree {
        fn drop(&mut self) {
            let _ = signal_all(self.0.id(), Signal::KILL);
            let _ = self.0.kill();
            let _ = self.0.wait();
        }
    }

    #[test]
    fn signals_reach_all_processes_below_the_root() {
        let tree = Tree::start("setsid sh -c 'sleep 1000 & sleep 1001' & sleep 1002 & wait", 4);
        let root = tree.0.id();
        assert!(!is_stopped(root));
        stop_all(root).unwrap();
        assert!(is_stopped(root));
        assert_eq!(sample_tree(root).unwrap().state, SchedulingState::Stopped);
        signal_all(root, Signal::CONT).unwrap();
        let start = Instant::now();
        while is_stopped(root) {
            assert!(start.elapsed() < Duration::from_secs(60));
        }
        let members = alive_descendants(root);
        kill_all(root).unwrap();
        // Without a subreaper a process whose parent died first leaves the tree while it is still dying.
        for (pid, sample) in members {
            let is_dead = || {
                ProcessSample::read(pid).map_or(true, |now| {
                    now.state == SchedulingState::Exited
                        || now.start_time_ticks != sample.start_time_ticks
                })
            };
            while !is_dead() {
                assert!(start.elapsed() < Duration::from_secs(60), "{pid} lives");
                std::thread::sleep(PASS_INTERVAL);
            }
        }
    }

    #[test]
    fn parent_of_a_stopped_vfork_child_counts_as_stopped() {
        // `posix_spawn` of Python's subprocess is a vfork: the child stops itself before it executes a program.
        let script = "import ctypes, os, signal\nif ctypes.CDLL(None).vfork() == 0: os.kill(os.getpid(), signal.SIGSTOP)";
        let tree = Tree::start(&format!("python3 -c '{script}' & wait"), 2);
        stop_all(tree.0.id()).unwrap();
        assert!(is_stopped(tree.0.id()));
        assert_eq!(sample_tree(tree.0.id()).unwrap().state, SchedulingState::Stopped);
    }

    #[test]
    fn processes_that_fork_without_end_are_stopped() {
        let script = "f() { while :; do (:) & wait $!; done; }; f & f & f & wait";
        let tree = Tree::start(script, 3);
        // A child that was forked while its parent was being stopped is easily missed.
        for round in 0..100 {
            stop_all(tree.0.id()).unwrap();
            let pids = descendants(tree.0.id());
            std::thread::sleep(Duration::from_millis(2));
            assert_eq!(descendants(tree.0.id()), pids, "a process ran in round {round}");
            signal_all(tree.0.id(), Signal::CONT).unwrap();
        }
    }

    #[test]
    fn processor_time_of_all_processes_counts() {
        let tree = Tree::start("sh -c 'while :; do :; done' & wait", 1);
        let start = Instant::now();
        while sample_tree(tree.0.id()).unwrap().cpu_time < Duration::from_millis(50) {
            assert!(start.elapsed() < Duration::from_secs(60));
            std::thread::sleep(PASS_INTERVAL);
        }
    }

    #[test]
    fn both_ways_to_list_children_agree() {
        let tree = Tree::start("sleep 1000 & sleep 1001 & wait", 2);
        let root = tree.0.id();
        let children = list_parents().into_iter().filter(|(_, parent)| *parent == root);
        let mut by_parent: Vec<u32> = children.map(|(pid, _)| pid).collect();
        let mut listed = read_thread_children(root);
        by_parent.sort_unstable();
        listed.sort_unstable();
        assert_eq!(listed, by_parent);
    }
}
