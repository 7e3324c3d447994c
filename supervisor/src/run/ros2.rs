//! The process that shows the run to ROS 2: started, watched, and started anew when it dies.
//!
//! No robot needs it: a run goes on without.

use std::path::PathBuf;
use std::time::{Duration, Instant};

use metrics::summary::ProcessUsage;
use results::usage::Usage;

use crate::child::{self, Child};
use crate::dead_nodes::Cleaner;
use crate::spawn::{Launcher, Role, SpawnError};

/// In place of a robot, for the clean-up of what a dead one left.
pub(super) const REMAINS: usize = usize::MAX - 1;
/// One that lived for less than this did not come up.
const UP_AFTER: Duration = Duration::from_secs(2);
/// So often in a row it may fail to come up.
const FAILURES_MAX: u64 = 3;
/// How many lines of its log are shown.
const LOG_LINES: usize = 8;

/// The process.
pub(super) struct Ros2 {
    brief: PathBuf,
    log: PathBuf,
    launcher: Launcher,
    child: Option<Child>,
    started: Instant,
    starts: u64,
    failures: u64,
    usage: Usage,
}

impl Ros2 {
    /// Starts it.
    pub(super) fn start(
        launcher: &Launcher,
        brief: PathBuf,
        log: PathBuf,
    ) -> Result<Ros2, SpawnError> {
        let (launcher, started) = (launcher.clone(), Instant::now());
        let (starts, failures, usage) = (0, 0, Usage::default());
        let mut ros2 = Ros2 { brief, log, launcher, child: None, started, starts, failures, usage };
        ros2.spawn()?;
        Ok(ros2)
    }

    fn spawn(&mut self) -> Result<(), SpawnError> {
        self.child = Some(self.launcher.spawn(Role::Ros2 { brief: &self.brief }, &self.log)?);
        self.started = Instant::now();
        self.starts += 1;
        Ok(())
    }

    /// Looks whether it died; how, and what follows, if it just did. What it left is removed before
    /// another is started.
    pub(super) fn watch(&mut self, cleaner: &Cleaner) -> Option<String> {
        let child = self.child.as_mut()?;
        let status = child.ended()?;
        self.usage += child.usage().unwrap_or_default();
        self.child = None;
        let how = child::in_words(status);
        self.failures = match self.started.elapsed() < UP_AFTER && status.code().is_some() {
            true => self.failures + 1,
            false => 0,
        };
        if self.gave_up() {
            let log = child::last_lines(&self.log, LOG_LINES);
            tracing::warn!("ROS 2 cannot listen ({how}); the log says:\n{log}");
            return Some(format!("{how}, and did not come up; the run goes on without"));
        }
        cleaner.request(REMAINS);
        Some(how)
    }

    /// What it left is removed: starts another.
    pub(super) fn cleaned(&mut self) -> Result<(), SpawnError> {
        if self.child.is_some() || self.gave_up() { Ok(()) } else { self.spawn() }
    }

    fn gave_up(&self) -> bool {
        self.failures == FAILURES_MAX
    }

    /// Asks it to end, and kills it if it does not within that time; what it took.
    pub(super) fn end(mut self, grace: Duration) -> ProcessUsage {
        if let Some(child) = &mut self.child {
            child.terminate();
            let asked = Instant::now();
            while child.ended().is_none() {
                if asked.elapsed() > grace {
                    tracing::warn!("the process for ROS 2 did not end when asked, and was killed");
                    child.end();
                    break;
                }
                std::thread::sleep(Duration::from_millis(1));
            }
            self.usage += child.usage().unwrap_or_default();
        }
        ProcessUsage { name: "ros2".into(), starts: self.starts, usage: self.usage }
    }
}
