//! Processes that take processor time because the scenario says so.

use std::path::Path;
use std::process::ExitStatus;

use crate::child::Child;
use crate::spawn::{Launcher, Role, SpawnError};

/// All of them, and the faults they belong to.
#[derive(Default)]
pub(super) struct Load {
    processes: Vec<(usize, Child)>,
    missing: Option<SpawnError>,
}

impl Load {
    /// Starts so many for a fault; how many there are, in words. That some are missing harms no
    /// robot: the run goes on, is written down, and then fails for not being what was asked for.
    pub(super) fn start(
        &mut self,
        launcher: &Launcher,
        fault: usize,
        asked: usize,
        log: &Path,
    ) -> String {
        for started in 0..asked {
            match launcher.spawn(Role::Load, log) {
                Ok(child) => self.processes.push((fault, child)),
                Err(error) => {
                    tracing::warn!(started, asked, "{error}");
                    self.missing.get_or_insert(error);
                    return format!("{started} of {asked} processes");
                }
            }
        }
        format!("{asked} processes")
    }

    /// Ends those of a fault.
    pub(super) fn end(&self, fault: usize) {
        let ours = self.processes.iter().filter(|(of, _)| *of == fault);
        ours.for_each(|(_, child)| drop(child.kill()));
    }

    /// Reaps the dead. Returns how those ended that no fault has ended.
    pub(super) fn bury(&mut self) -> Vec<ExitStatus> {
        let mut unplanned = Vec::new();
        self.processes.retain_mut(|(_, child)| match child.ended() {
            None => true,
            Some(status) => {
                unplanned.extend((!child.was_killed()).then_some(status));
                false
            }
        });
        unplanned
    }

    /// Those that are there.
    pub(super) fn children(&self) -> impl Iterator<Item = &Child> {
        self.processes.iter().map(|(_, child)| child)
    }

    /// Those that are there.
    pub(super) fn children_mut(&mut self) -> impl Iterator<Item = &mut Child> {
        self.processes.iter_mut().map(|(_, child)| child)
    }

    /// Why there were fewer than asked for, if there were.
    pub(super) fn missing(&mut self) -> Result<(), SpawnError> {
        self.missing.take().map_or(Ok(()), Err)
    }
}
