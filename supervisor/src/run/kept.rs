//! A process that is kept going beside the robots: the bridge between hosts, and the one that shows the run to
//! ROS 2. It is watched, started anew when it dies, and given up when it does not come up.

use std::path::PathBuf;
use std::time::{Duration, Instant};

use outcome::metrics::summary::ProcessUsage;
use outcome::results::usage::Usage;

use crate::child::{self, Child};
use crate::dead_nodes::{Cleaner, Dead};
use crate::run::processes::end_all;
use crate::spawn::{Launcher, Role, SpawnError};

/// One that lived for less than this did not come up.
const UP_AFTER: Duration = Duration::from_secs(2);
/// So often in a row it may fail to come up.
const FAILURES_MAX: u64 = 3;
/// How many lines of its log are shown.
const LOG_LINES: usize = 8;

/// Which process it is.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Which {
    /// The bridge of this host.
    Bridge,
    /// The one that shows the run to ROS 2.
    Ros2,
}

impl Which {
    fn dead(self) -> Dead {
        match self {
            Which::Bridge => Dead::Bridge,
            Which::Ros2 => Dead::Ros2,
        }
    }

    fn name(self) -> &'static str {
        match self {
            Which::Bridge => "bridge",
            Which::Ros2 => "ros2",
        }
    }
}

/// How it died.
#[derive(Debug)]
pub(crate) struct Died {
    /// In words.
    pub(crate) how: String,
    /// It is not started anew.
    pub(crate) given_up: Option<GivenUp>,
}

/// It died too often before it was up.
#[derive(Debug)]
pub(crate) struct GivenUp {
    /// How often in a row.
    pub(crate) times: u64,
    /// The end of its log.
    pub(crate) log: String,
}

/// The process, and its replacements.
pub(crate) struct Kept {
    which: Which,
    brief: PathBuf,
    log: PathBuf,
    launcher: Launcher,
    child: Option<Child>,
    started: Instant,
    starts: u64,
    failures: u64,
    usage: Usage,
}

impl Kept {
    /// Starts it.
    pub(crate) fn start(
        which: Which,
        launcher: &Launcher,
        brief: PathBuf,
        log: PathBuf,
    ) -> Result<Kept, SpawnError> {
        let (launcher, started) = (launcher.clone(), Instant::now());
        let (starts, failures, usage) = (0, 0, Usage::default());
        let mut kept =
            Kept { which, brief, log, launcher, child: None, started, starts, failures, usage };
        kept.spawn()?;
        Ok(kept)
    }

    fn spawn(&mut self) -> Result<(), SpawnError> {
        let brief = &self.brief;
        let role = match self.which {
            Which::Bridge => Role::Bridge { brief },
            Which::Ros2 => Role::Ros2 { brief },
        };
        self.child = Some(self.launcher.spawn(role, &self.log)?);
        self.started = Instant::now();
        self.starts += 1;
        Ok(())
    }

    /// Looks whether it died; how, if it just did. What it left is removed before another is started.
    pub(crate) fn watch(&mut self, cleaner: &Cleaner) -> Option<Died> {
        let child = self.child.as_mut()?;
        let status = child.ended()?;
        self.usage += child.usage().unwrap_or_default();
        self.child = None;
        // One that was killed says nothing of whether it comes up.
        let failed = self.started.elapsed() < UP_AFTER && status.code().is_some();
        self.failures = if failed { self.failures + 1 } else { 0 };
        let given_up = self.is_given_up().then(|| GivenUp {
            times: self.failures,
            log: child::shown(&child::last_entries(&self.log, LOG_LINES)),
        });
        if given_up.is_none() {
            cleaner.request(self.which.dead());
        }
        Some(Died { how: child::in_words(status), given_up })
    }

    fn is_given_up(&self) -> bool {
        self.failures >= FAILURES_MAX
    }

    /// What it left is removed: starts another.
    pub(crate) fn cleaned(&mut self) -> Result<(), SpawnError> {
        if self.child.is_some() || self.is_given_up() { Ok(()) } else { self.spawn() }
    }

    /// How often it was started anew.
    pub(crate) fn restarts(&self) -> u64 {
        self.starts - 1
    }

    /// Its process, if there is one.
    pub(crate) fn child(&self) -> Option<&Child> {
        self.child.as_ref()
    }

    /// Asks it to end, and kills it if it does not; what it took.
    pub(crate) fn end(&mut self) -> ProcessUsage {
        if let Some(mut child) = self.child.take() {
            end_all(vec![&mut child]);
            self.usage += child.usage().unwrap_or_default();
        }
        ProcessUsage { name: self.which.name().into(), starts: self.starts, usage: self.usage }
    }
}
