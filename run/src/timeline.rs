//! Plan of a run: the planned actions on processes, as events in the order of time.
//!
//! Faults of links, sensors and wheels are executed in the processes themselves, from their briefs.

use std::collections::VecDeque;

use experiment::scenario::{FaultKind, Scenario};

use crate::lifecycle::{Initiator, LifecycleEvent};

/// Planned events that have not happened, in order of time.
#[derive(Debug)]
pub struct Timeline {
    /// Events with the run times at which they are due, ns.
    planned_events: VecDeque<(u64, LifecycleEvent)>,
}

impl Timeline {
    /// Creates the timeline of all faults of the scenario.
    pub fn new(scenario: &Scenario) -> Timeline {
        let mut planned_events = Vec::new();
        for (fault, planned_fault) in scenario.faults.iter().enumerate() {
            let (at_ns, initiator) = (planned_fault.start_ns, Initiator::Plan);
            let (start_event, end_event) = match planned_fault.kind {
                FaultKind::Kill { robot, restart_after_ns } => {
                    let restart_at_ns = restart_after_ns.map(|after_ns| at_ns + after_ns);
                    (LifecycleEvent::Kill { robot, fault, restart_at_ns, initiator }, None)
                }
                FaultKind::KillPlant => (LifecycleEvent::KillPlant { fault }, None),
                FaultKind::Freeze { robot } => {
                    let has_planned_thaw = planned_fault.duration_ns.is_some();
                    let freeze =
                        LifecycleEvent::Freeze { robot, fault, has_planned_thaw, initiator };
                    (freeze, Some(LifecycleEvent::Thaw { robot, fault, initiator }))
                }
                FaultKind::Load { processes } => (
                    LifecycleEvent::StartLoad { fault, processes },
                    Some(LifecycleEvent::EndLoad { fault }),
                ),
                FaultKind::Slowdown { .. }
                | FaultKind::Link { .. }
                | FaultKind::Stream { .. }
                | FaultKind::Lie { .. }
                | FaultKind::Sensor { .. }
                | FaultKind::Wheels { .. }
                | FaultKind::Partition { .. } => continue,
            };
            planned_events.push((at_ns, start_event));
            planned_events.extend(planned_fault.end_ns().zip(end_event));
        }
        // Stable sort: an end and a start at the same time keep the order of the scenario, in every run.
        planned_events.sort_by_key(|&(at_ns, _)| at_ns);
        Timeline { planned_events: planned_events.into() }
    }

    /// Returns the run time of the next event, ns.
    pub fn next_event_ns(&self) -> Option<u64> {
        self.planned_events.front().map(|&(at_ns, _)| at_ns)
    }

    /// Removes and returns the next event that is due at `now_ns`.
    pub fn take_due_event(&mut self, now_ns: u64) -> Option<LifecycleEvent> {
        if self.next_event_ns()? <= now_ns {
            Some(self.planned_events.pop_front()?.1)
        } else {
            None
        }
    }
}
