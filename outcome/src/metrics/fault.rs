//! All faults of a run, their predicted effects, and their measured effects.
//!
//! | file | question it answers |
//! |---|---|
//! | `window` | what was the effect of one fault? |
//!
//! Reception reports may arrive before or after the fault that they belong to: the order in which messages of processes
//! arrive has no influence.

mod window;

use std::collections::VecDeque;

use formation::reachability::Reachability;
use protocol::message::ReceptionState;

use crate::metrics::orphans::OrphanTracker;
use crate::metrics::silence::SilenceState;
use experiment::prediction::FailurePredictor;
use experiment::scenario::{AffectedComponent, Scenario, SilencedSource};
use window::{ErrorFlags, FaultWindow, Prediction};
pub use window::{FaultEnd, FaultReport};

/// Maximum delay between the beginning of a fault and its report to the metrics, ns of run time. Older contact
/// reports belong to known faults and are dropped.
const REPORT_DELAY_NS_MAX: u64 = 10_000_000_000;

/// All faults up to now, and the planned faults of the scenario.
pub(super) struct Faults {
    windows: Vec<FaultWindow>,
    pub(super) silence: SilenceState,
    reachability: Reachability,
    predictor: FailurePredictor,
    pub(super) orphans: OrphanTracker,
    /// Description and target of each planned or registered fault.
    planned_faults: Vec<(String, AffectedComponent)>,
    /// Beginnings and ends of the faults that agents apply by themselves, in order of time, ns.
    scheduled_bounds: VecDeque<(u64, usize, FaultBound)>,
    /// Reception reports that may belong to a fault that is reported later.
    reception_reports: Vec<ReceptionReport>,
    newest_t_ns: u64,
}

/// Beginning or end of a fault.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum FaultBound {
    /// The fault begins.
    Begin,
    /// The fault ends.
    End(FaultEnd),
}

/// Report of the reception state of `neighbor` at `receiver`, and its start time.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct ReceptionReport {
    pub(super) receiver: usize,
    pub(super) neighbor: usize,
    pub(super) reception_state: ReceptionState,
    pub(super) since_ns: u64,
}

impl Faults {
    /// Creates the state before the first fault.
    pub(super) fn new(scenario: &Scenario) -> Faults {
        Faults {
            windows: Vec::new(),
            silence: SilenceState::new(scenario),
            reachability: scenario.reachability_of(&scenario.graph_with_spares()),
            predictor: FailurePredictor::new(scenario),
            orphans: OrphanTracker::new(scenario),
            planned_faults: scenario
                .faults
                .iter()
                .map(|fault| {
                    (fault.kind.describe(scenario), fault.kind.affected_component(scenario))
                })
                .collect(),
            scheduled_bounds: agent_fault_bounds(scenario),
            reception_reports: Vec::new(),
            newest_t_ns: 0,
        }
    }

    /// Removes and returns the next scheduled beginning or end up to this time; `None` if there is none.
    pub(super) fn take_scheduled_bound(&mut self, t_ns: u64) -> Option<(u64, usize, FaultBound)> {
        let due = self.scheduled_bounds.front().is_some_and(|&(due_ns, ..)| due_ns <= t_ns);
        if due { self.scheduled_bounds.pop_front() } else { None }
    }

    /// Updates all faults with one sample. `converged_since_ns` is the time since which all errors of living robots are
    /// below the bound; `beyond_bound` gives for each robot which of its two errors are not.
    pub(super) fn add_truth(
        &mut self,
        t_ns: u64,
        error_m: f64,
        converged_since_ns: Option<u64>,
        beyond_bound: impl Iterator<Item = ErrorFlags> + Clone,
        distance_m: f64,
    ) {
        for fault in &mut self.windows {
            fault.add_truth(t_ns, error_m, converged_since_ns, beyond_bound.clone(), distance_m);
        }
        self.newest_t_ns = t_ns;
    }

    /// Returns the number that the next registered fault gets.
    pub(super) fn next_fault_number(&self) -> usize {
        self.planned_faults.len()
    }

    /// Registers a fault that the scenario does not plan and that is about to begin. Returns its number.
    pub(super) fn register_fault(&mut self, what: String, affected: AffectedComponent) -> usize {
        self.planned_faults.push((what, affected));
        self.planned_faults.len() - 1
    }

    /// Begins the fault of this number. `within_bound` gives for each robot whether its two errors are below the bound.
    pub(super) fn begin_fault(
        &mut self,
        fault: usize,
        t_ns: u64,
        within_bound: impl Iterator<Item = ErrorFlags>,
    ) {
        let (what, affected) = self.planned_faults[fault].clone();
        for earlier in &mut self.windows {
            earlier.close_if_recovered();
        }
        let orphaned_before = self.silence.orphaned_robots(&self.reachability);
        self.silence.add_silence(affected.silenced_source, 1);
        self.orphans.add_silence(t_ns, affected.silenced_source, 1);
        let mut orphaned_robots = self.silence.orphaned_robots(&self.reachability);
        orphaned_robots.retain(|robot| !orphaned_before.contains(robot));
        let broken_robots = match affected.silenced_source {
            SilencedSource::NoSource => Vec::new(),
            _ => self.silence.predict_broken(&self.predictor, t_ns),
        };
        let prediction = Prediction { broken_robots, orphaned_robots };
        let mut window = FaultWindow::new(fault, what, affected, t_ns, prediction, within_bound);
        self.reception_reports.iter().for_each(|&report| window.record_reception(report));
        self.windows.push(window);
    }

    /// Ends a fault. Does nothing if it never began.
    pub(super) fn end_fault(&mut self, fault: usize, end: FaultEnd, t_ns: u64) {
        if let Some(window) = self.windows.iter_mut().find(|window| window.number == fault) {
            let restored_source = window.end(end, t_ns);
            self.silence.add_silence(restored_source, -1);
            self.orphans.add_silence(t_ns, restored_source, -1);
        }
    }

    /// Records a reception report for all faults that it may belong to.
    pub(super) fn record_reception(&mut self, report: ReceptionReport) {
        if !matches!(report.reception_state, ReceptionState::Stale | ReceptionState::Lost) {
            return;
        }
        for fault in &mut self.windows {
            fault.record_reception(report);
        }
        if self.reception_reports.len() == self.reception_reports.capacity() {
            let old_ns = self.newest_t_ns.saturating_sub(REPORT_DELAY_NS_MAX);
            self.reception_reports.retain(|earlier| earlier.since_ns >= old_ns);
        }
        self.reception_reports.push(report);
    }

    #[cfg(test)]
    pub(super) fn stored_report_count(&self) -> usize {
        self.reception_reports.len()
    }

    /// Returns the report of each fault, in the order in which the faults were reported.
    pub(super) fn report(&self, names: &[String]) -> Vec<FaultReport> {
        let broken_m = self.predictor.broken_threshold_m();
        self.windows.iter().map(|fault| fault.report(names, broken_m)).collect()
    }
}

/// Returns the beginnings and ends of the faults that agents apply by themselves, in order of time.
fn agent_fault_bounds(scenario: &Scenario) -> VecDeque<(u64, usize, FaultBound)> {
    let mut bounds = Vec::new();
    let faults = scenario.faults.iter().enumerate();
    for (number, fault) in faults.filter(|(_, fault)| fault.kind.is_applied_by_processes()) {
        bounds.push((fault.start_ns, number, FaultBound::Begin));
        // A fault that lasts to the end of the run is never repaired.
        let (end, t_ns) = match fault.end_ns() {
            Some(until_ns) => (FaultEnd::Repaired, until_ns),
            None => (FaultEnd::Permanent, fault.start_ns),
        };
        bounds.push((t_ns, number, FaultBound::End(end)));
    }
    bounds.sort_by_key(|&(t_ns, ..)| t_ns);
    bounds.into()
}
