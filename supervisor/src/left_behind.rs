//! Processes that the programs of a run started and left behind: they end with the run, and are named.

use std::collections::BTreeSet;
use std::fs;
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use protocol::watchdog::{Sample, State};
use rustix::process::{
    Pid, Signal, WaitOptions, getpid, kill_process, set_child_subreaper, waitpid,
};

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
}

impl LeftBehind {
    /// Nobody is left behind yet.
    pub(crate) fn watch(logs: &Path) -> LeftBehind {
        if let Err(error) = set_child_subreaper(Some(getpid())) {
            tracing::warn!(%error, "processes that programs leave behind will not be found");
        }
        let logs = logs.canonicalize().unwrap_or_else(|_| logs.into());
        LeftBehind { before: children(), logs }
    }

    /// Who it is, in words.
    fn name(&self, pid: i32) -> String {
        let proc = PathBuf::from(format!("/proc/{pid}"));
        let program = fs::read_to_string(proc.join("comm")).unwrap_or_default();
        let outputs = [1, 2].map(|number| proc.join(format!("fd/{number}")).read_link());
        let log = outputs.into_iter().flatten().find(|path| path.parent() == Some(&self.logs));
        let owner = log.and_then(|log| Some(log.file_stem()?.display().to_string()));
        let owner = owner.unwrap_or_else(|| "a program of the run".into());
        format!("{owner} left the process `{}` ({pid}) behind", program.trim_end())
    }
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
                let lives = Sample::of(number as u32).is_ok_and(|now| now.state != State::Gone);
                if lives && named.insert(number) {
                    tracing::warn!("{}; it is killed", self.name(number));
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
    let own = getpid().as_raw_nonzero().get();
    let is_ours = |pid: &i32| {
        let stat = fs::read_to_string(format!("/proc/{pid}/stat")).unwrap_or_default();
        // The name may have anything in it; behind it are the state and the parent.
        let parent = stat.rsplit(')').next().and_then(|rest| rest.split_whitespace().nth(1));
        parent.and_then(|parent| parent.parse().ok()) == Some(own)
    };
    let entries = fs::read_dir("/proc").into_iter().flatten().flatten();
    let pids = entries.filter_map(|entry| entry.file_name().to_str()?.parse().ok());
    pids.filter(is_ours).collect()
}
