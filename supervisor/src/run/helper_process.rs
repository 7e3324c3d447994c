//! Helper process that is restarted when it dies: the bridge between hosts, and the ROS 2 bridge. It is
//! given up if it repeatedly fails to become ready.

use std::path::PathBuf;
use std::time::{Duration, Instant};

use outcome::metrics::summary::ProcessUsage;
use outcome::results::usage::Usage;

use crate::child::{self, Child};
use crate::dead_nodes::{Cleaner, DeadProcessOwner};
use crate::run::processes::terminate_all;
use crate::spawn::{Launcher, ProcessRole, SpawnError};

/// Minimum uptime for a start to count as successful.
const HEALTHY_UPTIME_MIN: Duration = Duration::from_secs(2);
/// Maximum number of consecutive failed starts, after which the helper is given up.
const FAILURES_MAX: u64 = 3;
/// Number of lines of a helper's log that are shown.
const SHOWN_LOG_LINES: usize = 8;

/// Kind of helper process.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum HelperKind {
    /// Network bridge of this host.
    Bridge,
    /// Bridge between this run and ROS 2.
    Ros2,
}

impl HelperKind {
    fn dead_process(self) -> DeadProcessOwner {
        match self {
            HelperKind::Bridge => DeadProcessOwner::Bridge,
            HelperKind::Ros2 => DeadProcessOwner::Ros2,
        }
    }

    fn name(self) -> &'static str {
        match self {
            HelperKind::Bridge => "bridge",
            HelperKind::Ros2 => "ros2",
        }
    }
}

/// Death of a helper process.
#[derive(Debug)]
pub(crate) struct HelperDeath {
    /// Cause of death, as text.
    pub(crate) cause: String,
    /// Reason why the helper is not restarted; `None` if it is.
    pub(crate) repeated_failure: Option<RepeatedStartFailure>,
}

/// Helper that failed to start too often.
#[derive(Debug)]
pub(crate) struct RepeatedStartFailure {
    /// Number of consecutive failed starts.
    pub(crate) failed_starts: u64,
    /// Last lines of the helper's log.
    pub(crate) log: String,
}

/// A helper process, which is replaced when it dies.
pub(crate) struct HelperProcess {
    kind: HelperKind,
    brief: PathBuf,
    log: PathBuf,
    launcher: Launcher,
    child: Option<Child>,
    last_start_time: Instant,
    starts: u64,
    failures: u64,
    usage: Usage,
}

impl HelperProcess {
    /// Starts the helper process.
    pub(crate) fn start(
        kind: HelperKind,
        launcher: &Launcher,
        brief: PathBuf,
        log: PathBuf,
    ) -> Result<HelperProcess, SpawnError> {
        let (launcher, last_start_time) = (launcher.clone(), Instant::now());
        let (starts, failures, usage) = (0, 0, Usage::default());
        let mut helper = HelperProcess {
            kind,
            brief,
            log,
            launcher,
            child: None,
            last_start_time,
            starts,
            failures,
            usage,
        };
        helper.spawn()?;
        Ok(helper)
    }

    fn spawn(&mut self) -> Result<(), SpawnError> {
        let brief = &self.brief;
        let role = match self.kind {
            HelperKind::Bridge => ProcessRole::Bridge { brief },
            HelperKind::Ros2 => ProcessRole::Ros2 { brief },
        };
        self.child = Some(self.launcher.spawn(role, &self.log)?);
        self.last_start_time = Instant::now();
        self.starts += 1;
        Ok(())
    }

    /// Polls the helper process. Returns how it died if it has just exited. The replacement is started
    /// after the stale resources of the dead process have been removed.
    pub(crate) fn poll(&mut self, cleaner: &Cleaner) -> Option<HelperDeath> {
        let child = self.child.as_mut()?;
        let status = child.try_reap()?;
        self.usage += child.usage().unwrap_or_default();
        self.child = None;
        // The death of a killed process does not show that starts fail.
        let has_failed =
            self.last_start_time.elapsed() < HEALTHY_UPTIME_MIN && status.code().is_some();
        self.failures = if has_failed { self.failures + 1 } else { 0 };
        let repeated_failure = self.is_given_up().then(|| RepeatedStartFailure {
            failed_starts: self.failures,
            log: child::format_log_lines(&child::read_last_log_entries(&self.log, SHOWN_LOG_LINES)),
        });
        if repeated_failure.is_none() {
            cleaner.request_cleanup(self.kind.dead_process());
        }
        Some(HelperDeath { cause: child::describe_exit(status), repeated_failure })
    }

    fn is_given_up(&self) -> bool {
        self.failures >= FAILURES_MAX
    }

    /// Starts a replacement, after the stale resources of the dead process have been removed.
    pub(crate) fn restart_after_cleanup(&mut self) -> Result<(), SpawnError> {
        if self.child.is_some() || self.is_given_up() { Ok(()) } else { self.spawn() }
    }

    /// Returns the number of restarts.
    pub(crate) fn restarts(&self) -> u64 {
        self.starts - 1
    }

    /// Returns the process, if there is one.
    pub(crate) fn child(&self) -> Option<&Child> {
        self.child.as_ref()
    }

    /// Terminates the process, and kills it if it does not exit. Returns its resource usage.
    pub(crate) fn terminate(&mut self) -> ProcessUsage {
        if let Some(mut child) = self.child.take() {
            terminate_all(vec![&mut child]);
            self.usage += child.usage().unwrap_or_default();
        }
        ProcessUsage { name: self.kind.name().into(), starts: self.starts, usage: self.usage }
    }
}
