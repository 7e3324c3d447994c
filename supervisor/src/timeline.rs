//! What the supervisor itself does to processes, and when: kills, freezes, thaws, load.
//!
//! Faults of links, sensors and wheels are not here: they act in the processes, by their briefs.

use std::collections::VecDeque;

use experiment::scenario::{FaultKind, Scenario};

/// Something that the supervisor does at a time of the scenario's choice.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[expect(missing_docs, reason = "the fields are named in the variants' comments")]
pub enum Act {
    /// SIGKILL of a robot's process; a replacement at that run time, ns.
    Kill { robot: usize, restart_at_ns: Option<u64> },
    /// SIGSTOP of a robot's process.
    Freeze { robot: usize },
    /// SIGCONT, after a freeze.
    Thaw { robot: usize },
    /// SIGKILL of the plant.
    KillPlant,
    /// So many processes that do nothing but take processor time.
    StartLoad { processes: usize },
    /// Ends them.
    EndLoad,
}

/// Acts that have not been done yet, in order of time.
#[derive(Debug)]
pub struct Timeline {
    due: VecDeque<Due>,
}

/// An act, when it is due, ns, and the fault that it belongs to.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Due {
    /// When, ns of run time.
    pub at_ns: u64,
    /// The number of its fault in the scenario.
    pub fault: usize,
    /// What is done.
    pub act: Act,
}

impl Timeline {
    /// All that the scenario's faults ask for.
    pub fn new(scenario: &Scenario) -> Timeline {
        let mut due = Vec::new();
        for (fault, planned) in scenario.faults.iter().enumerate() {
            let at_ns = planned.at_ns;
            let mut first = |act| due.push(Due { at_ns, fault, act });
            let last = match planned.kind {
                FaultKind::Kill { robot, restart_after_ns } => {
                    let restart_at_ns = restart_after_ns.map(|after_ns| at_ns + after_ns);
                    first(Act::Kill { robot, restart_at_ns });
                    None
                }
                FaultKind::KillPlant => {
                    first(Act::KillPlant);
                    None
                }
                FaultKind::Freeze { robot } => {
                    first(Act::Freeze { robot });
                    Some(Act::Thaw { robot })
                }
                FaultKind::Load { processes } => {
                    first(Act::StartLoad { processes });
                    Some(Act::EndLoad)
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
        // Stable: what ends at the time at which something else begins stands before it or after
        // it as in the scenario, in every run.
        due.sort_by_key(|due| due.at_ns);
        Timeline { due: due.into() }
    }

    /// When the next act is due, ns.
    pub fn next_ns(&self) -> Option<u64> {
        self.due.front().map(|due| due.at_ns)
    }

    /// The next act that is due at `now_ns`; it is not asked for again.
    pub fn take_due(&mut self, now_ns: u64) -> Option<Due> {
        if self.next_ns()? <= now_ns { self.due.pop_front() } else { None }
    }
}
