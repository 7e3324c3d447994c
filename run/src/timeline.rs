//! Planned actions of the supervisor on processes: kills, freezes, thaws, load.
//!
//! Faults of links, sensors and wheels are executed in the processes themselves, from their briefs.

use std::collections::VecDeque;

use experiment::scenario::{FaultKind, Scenario};

/// Action of the supervisor at a planned time.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[expect(missing_docs, reason = "the fields are named in the variants' comments")]
pub enum PlannedAction {
    /// SIGKILL of a robot's process, and the run time of its replacement, ns.
    Kill { robot: usize, restart_at_ns: Option<u64> },
    /// SIGSTOP of a robot's process.
    Freeze { robot: usize },
    /// SIGCONT, after a freeze.
    Thaw { robot: usize },
    /// SIGKILL of the plant.
    KillPlant,
    /// Start of `processes` load processes.
    StartLoad { processes: usize },
    /// End of the load processes.
    EndLoad,
}

/// Actions that have not been executed, in order of time.
#[derive(Debug)]
pub struct Timeline {
    due: VecDeque<Due>,
}

/// A planned action with its time and its fault.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Due {
    /// Run time at which the action is due, ns.
    pub at_ns: u64,
    /// Number of the fault in the scenario to which the action belongs.
    pub fault: usize,
    /// Action to execute.
    pub act: PlannedAction,
}

impl Timeline {
    /// Creates the timeline of all faults of the scenario.
    pub fn new(scenario: &Scenario) -> Timeline {
        let mut due = Vec::new();
        for (fault, planned) in scenario.faults.iter().enumerate() {
            let at_ns = planned.at_ns;
            let mut first = |act| due.push(Due { at_ns, fault, act });
            let last = match planned.kind {
                FaultKind::Kill { robot, restart_after_ns } => {
                    let restart_at_ns = restart_after_ns.map(|after_ns| at_ns + after_ns);
                    first(PlannedAction::Kill { robot, restart_at_ns });
                    None
                }
                FaultKind::KillPlant => {
                    first(PlannedAction::KillPlant);
                    None
                }
                FaultKind::Freeze { robot } => {
                    first(PlannedAction::Freeze { robot });
                    Some(PlannedAction::Thaw { robot })
                }
                FaultKind::Load { processes } => {
                    first(PlannedAction::StartLoad { processes });
                    Some(PlannedAction::EndLoad)
                }
                FaultKind::Slow { .. }
                | FaultKind::Link { .. }
                | FaultKind::Stream { .. }
                | FaultKind::Lie { .. }
                | FaultKind::Sensor { .. }
                | FaultKind::Wheels { .. }
                | FaultKind::Partition { .. } => None,
            };
            if let (Some(act), Some(at_ns)) = (last, planned.until_ns()) {
                due.push(Due { at_ns, fault, act });
            }
        }
        // Stable sort: an end and a start at the same time keep the order of the scenario, in every run.
        due.sort_by_key(|due| due.at_ns);
        Timeline { due: due.into() }
    }

    /// Returns the run time of the next action, ns.
    pub fn next_ns(&self) -> Option<u64> {
        self.due.front().map(|due| due.at_ns)
    }

    /// Removes and returns the next action that is due at `now_ns`.
    pub fn take_due(&mut self, now_ns: u64) -> Option<Due> {
        if self.next_ns()? <= now_ns { self.due.pop_front() } else { None }
    }
}
