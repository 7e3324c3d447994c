//! Plan of a run: the planned actions on processes, as events in the order of time.
//!
//! Faults of links, sensors and wheels are executed in the processes themselves, from their briefs.

use std::collections::VecDeque;

use experiment::scenario::{FaultKind, Scenario};

use crate::lifecycle::{Event, Initiator};

/// Planned events that have not happened, in order of time.
#[derive(Debug)]
pub struct Timeline {
    /// Events with the run times at which they are due, ns.
    due: VecDeque<(u64, Event)>,
}

impl Timeline {
    /// Creates the timeline of all faults of the scenario.
    pub fn new(scenario: &Scenario) -> Timeline {
        let mut due = Vec::new();
        for (fault, planned) in scenario.faults.iter().enumerate() {
            let (at_ns, who) = (planned.at_ns, Initiator::Plan);
            let (first, last) = match planned.kind {
                FaultKind::Kill { robot, restart_after_ns } => {
                    let restart_at_ns = restart_after_ns.map(|after_ns| at_ns + after_ns);
                    (Event::Kill { robot, fault, restart_at_ns, who }, None)
                }
                FaultKind::KillPlant => (Event::KillPlant { fault }, None),
                FaultKind::Freeze { robot } => {
                    let ends = planned.for_ns.is_some();
                    let freeze = Event::Freeze { robot, fault, ends, who };
                    (freeze, Some(Event::Thaw { robot, fault, who }))
                }
                FaultKind::Load { processes } => {
                    (Event::StartLoad { fault, processes }, Some(Event::EndLoad { fault }))
                }
                FaultKind::Slow { .. }
                | FaultKind::Link { .. }
                | FaultKind::Stream { .. }
                | FaultKind::Lie { .. }
                | FaultKind::Sensor { .. }
                | FaultKind::Wheels { .. }
                | FaultKind::Partition { .. } => continue,
            };
            due.push((at_ns, first));
            due.extend(planned.until_ns().zip(last));
        }
        // Stable sort: an end and a start at the same time keep the order of the scenario, in every run.
        due.sort_by_key(|&(at_ns, _)| at_ns);
        Timeline { due: due.into() }
    }

    /// Returns the run time of the next event, ns.
    pub fn next_ns(&self) -> Option<u64> {
        self.due.front().map(|&(at_ns, _)| at_ns)
    }

    /// Removes and returns the next event that is due at `now_ns`.
    pub fn take_due(&mut self, now_ns: u64) -> Option<Event> {
        if self.next_ns()? <= now_ns { Some(self.due.pop_front()?.1) } else { None }
    }
}
