//! Load processes, which consume processor time for a load fault.

use std::path::Path;
use std::process::ExitStatus;

use crate::child::Child;
use crate::spawn::{Launcher, ProcessRole, SpawnError};

/// All load processes, with the faults to which they belong.
#[derive(Default)]
pub(super) struct LoadProcesses {
    processes: Vec<(usize, Child)>,
    spawn_error: Option<SpawnError>,
}

impl LoadProcesses {
    /// Starts load processes for a fault, and returns their number as text. If some cannot be started, no
    /// robot is affected: the run continues, is recorded, and then fails, because the load was not as
    /// planned.
    pub(super) fn start(
        &mut self,
        launcher: &Launcher,
        fault: usize,
        requested_count: usize,
        log: &Path,
    ) -> String {
        for started_count in 0..requested_count {
            match launcher.spawn(ProcessRole::Load, log) {
                Ok(child) => self.processes.push((fault, child)),
                Err(error) => {
                    tracing::warn!(started = started_count, asked = requested_count, "{error}");
                    self.spawn_error.get_or_insert(error);
                    return format!("{started_count} of {requested_count} processes");
                }
            }
        }
        format!("{requested_count} processes")
    }

    /// Kills the load processes of a fault.
    pub(super) fn kill_fault_processes(&self, fault: usize) {
        let processes = self.processes.iter().filter(|(process_fault, _)| *process_fault == fault);
        processes.for_each(|(_, child)| drop(child.kill()));
    }

    /// Reaps load processes that have exited. Returns the exit status of each that was not ended by the end
    /// of its fault.
    pub(super) fn reap_exited(&mut self) -> Vec<ExitStatus> {
        let mut unplanned = Vec::new();
        self.processes.retain_mut(|(_, child)| match child.try_reap() {
            None => true,
            Some(status) => {
                unplanned.extend((!child.was_killed()).then_some(status));
                false
            }
        });
        unplanned
    }

    /// Returns the load processes.
    pub(super) fn children(&self) -> impl Iterator<Item = &Child> {
        self.processes.iter().map(|(_, child)| child)
    }

    /// Returns the load processes.
    pub(super) fn children_mut(&mut self) -> impl Iterator<Item = &mut Child> {
        self.processes.iter_mut().map(|(_, child)| child)
    }

    /// Returns an error if fewer load processes could be started than planned.
    pub(super) fn check_load_processes(&mut self) -> Result<(), SpawnError> {
        self.spawn_error.take().map_or(Ok(()), Err)
    }
}
