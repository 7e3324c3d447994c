//! The process of the bridge: started, watched, and started anew when it dies, whoever's host it is.

use std::path::PathBuf;
use std::time::{Duration, Instant};

use crate::child::{self, Child};
use crate::dead_nodes::Cleaner;
use crate::run::RunError;
use crate::spawn::{Launcher, Role, SpawnError};

/// In place of a robot, for the clean-up of what a dead bridge left.
pub(crate) const REMAINS: usize = usize::MAX;
/// One that lived for less than this did not come up.
const UP_AFTER: Duration = Duration::from_secs(2);
/// So often in a row it may fail to come up.
const FAILURES_MAX: u64 = 3;
/// How many lines of its log are shown.
const LOG_LINES: usize = 8;

/// The bridge of this host.
pub(crate) struct Bridge {
    brief: PathBuf,
    log: PathBuf,
    launcher: Launcher,
    child: Option<Child>,
    started: Instant,
    failures: u64,
    /// How often it was started anew.
    pub(crate) restarts: u64,
}

impl Bridge {
    /// Starts it.
    pub(crate) fn start(
        launcher: &Launcher,
        brief: PathBuf,
        log: PathBuf,
    ) -> Result<Bridge, SpawnError> {
        let child = Some(launcher.spawn(Role::Bridge { brief: &brief }, &log)?);
        let (launcher, started) = (launcher.clone(), Instant::now());
        Ok(Bridge { brief, log, launcher, child, started, failures: 0, restarts: 0 })
    }

    /// Looks whether it died; how, if it just did. What it left is removed before another is started.
    pub(crate) fn watch(&mut self, cleaner: &Cleaner) -> Result<Option<String>, RunError> {
        let Some(status) = self.child.as_mut().and_then(Child::ended) else { return Ok(None) };
        self.child = None;
        let how = child::in_words(status);
        self.failures = match self.started.elapsed() < UP_AFTER && status.code().is_some() {
            true => self.failures + 1,
            false => 0,
        };
        if self.failures == FAILURES_MAX {
            let log = child::last_lines(&self.log, LOG_LINES);
            return Err(RunError::BridgeDied { how, times: self.failures, log });
        }
        cleaner.request(REMAINS);
        Ok(Some(how))
    }

    /// What it left is removed: starts another.
    pub(crate) fn cleaned(&mut self) -> Result<(), SpawnError> {
        if self.child.is_none() {
            self.child = Some(self.launcher.spawn(Role::Bridge { brief: &self.brief }, &self.log)?);
            self.started = Instant::now();
            self.restarts += 1;
        }
        Ok(())
    }

    /// Its process, if there is one.
    pub(crate) fn child(&self) -> Option<&Child> {
        self.child.as_ref()
    }

    /// Asks it to end, and kills it if it does not within that time.
    pub(crate) fn end(&mut self, grace: Duration) {
        let Some(child) = &mut self.child else { return };
        child.terminate();
        let asked = Instant::now();
        while child.ended().is_none() {
            if asked.elapsed() > grace {
                tracing::warn!("the bridge did not end when asked, and was killed");
                child.end();
                return;
            }
            std::thread::sleep(Duration::from_millis(1));
        }
    }
}
