//! Which faults there are, what the theory says of them, and what each did.
//!
//! | file | question it answers |
//! |---|---|
//! | `window` | what did one fault do? |
//!
//! Reports of contacts may come before or after the fault that they are about: the order in which
//! processes are heard decides nothing.

mod window;

use std::collections::VecDeque;

use formation::reachability::Reachability;
use protocol::message::Contact;

use crate::metrics::orphans::Orphans;
use crate::metrics::silence::Silent;
use experiment::prediction::Predictor;
use experiment::scenario::{Scenario, Silenced, Struck};
use window::{Both, FaultWindow, Foretold};
pub use window::{End, FaultReport};

/// No fault is told later than this, ns of run time, after it began: reports that old are about
/// faults already known.
const TOLD_WITHIN_NS: u64 = 10_000_000_000;

/// All faults so far, and those that the scenario plans.
pub(super) struct Faults {
    windows: Vec<FaultWindow>,
    pub(super) silent: Silent,
    reachability: Reachability,
    predictor: Predictor,
    pub(super) orphans: Orphans,
    /// What the scenario plans to break: its words, and whom it strikes.
    planned: Vec<(String, Struck)>,
    /// Beginnings and ends of faults that act by the briefs, in order of time, ns.
    scheduled: VecDeque<(u64, usize, Bound)>,
    /// Reports that a fault may still be told of that they are about.
    reports: Vec<Report>,
    newest_t_ns: u64,
}

/// One end of a fault.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Bound {
    /// It strikes.
    Begin,
    /// It is over.
    End(End),
}

/// `hearer` calls `neighbor` so since then.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Report {
    pub(super) hearer: usize,
    pub(super) neighbor: usize,
    pub(super) contact: Contact,
    pub(super) since_ns: u64,
}

impl Faults {
    /// Nothing broke yet.
    pub(super) fn new(scenario: &Scenario) -> Faults {
        Faults {
            windows: Vec::new(),
            silent: Silent::new(scenario),
            reachability: scenario.reachability_of(&scenario.graph_with_spares()),
            predictor: Predictor::of(scenario),
            orphans: Orphans::new(scenario),
            planned: scenario.faults.iter().map(|fault| fault.kind.struck(scenario)).collect(),
            scheduled: scheduled(scenario),
            reports: Vec::new(),
            newest_t_ns: 0,
        }
    }

    /// What begins or ends by the briefs up to this time, and has not been told yet.
    pub(super) fn take_scheduled(&mut self, t_ns: u64) -> Option<(u64, usize, Bound)> {
        let due = self.scheduled.front().is_some_and(|&(due_ns, ..)| due_ns <= t_ns);
        if due { self.scheduled.pop_front() } else { None }
    }

    /// Takes in one truth; `calm_since_ns`: since when all living errors are below the bound;
    /// `beyond`: which living robots' errors are not, by those heard and to the ideal formation.
    pub(super) fn truth(
        &mut self,
        t_ns: u64,
        error_m: f64,
        calm_since_ns: Option<u64>,
        beyond: impl Iterator<Item = Both> + Clone,
        distance_m: f64,
    ) {
        for fault in &mut self.windows {
            fault.truth(t_ns, error_m, calm_since_ns, beyond.clone(), distance_m);
        }
        self.newest_t_ns = t_ns;
    }

    /// The number that the next fault gets which is not the scenario's.
    pub(super) fn next(&self) -> usize {
        self.planned.len()
    }

    /// The number of a fault that is not the scenario's, and that is about to begin.
    pub(super) fn new_fault(&mut self, what: String, struck: Struck) -> usize {
        self.planned.push((what, struck));
        self.planned.len() - 1
    }

    /// The fault of this number began. `calm`: whose error is below the bound.
    pub(super) fn began(&mut self, fault: usize, t_ns: u64, calm: impl Iterator<Item = Both>) {
        let (what, struck) = self.planned[fault].clone();
        for earlier in &mut self.windows {
            earlier.another_began();
        }
        let before = self.silent.orphaned(&self.reachability);
        self.silent.count(struck.silenced, 1);
        self.orphans.count(t_ns, struck.silenced, 1);
        let mut orphaned = self.silent.orphaned(&self.reachability);
        orphaned.retain(|robot| !before.contains(robot));
        let predicted = match struck.silenced {
            Silenced::Nobody => Vec::new(),
            _ => self.silent.breaks(&self.predictor, t_ns),
        };
        let foretold = Foretold { broken: predicted, orphaned };
        let mut window = FaultWindow::new(fault, what, struck, t_ns, foretold, calm);
        self.reports.iter().for_each(|&report| window.contact(report));
        self.windows.push(window);
    }

    /// What the fault broke is whole again, as far as it is ever going to be.
    pub(super) fn ended(&mut self, fault: usize, end: End, t_ns: u64) {
        if let Some(window) = self.windows.iter_mut().find(|window| window.number == fault) {
            let heard_again = window.ended(end, t_ns);
            self.silent.count(heard_again, -1);
            self.orphans.count(t_ns, heard_again, -1);
        }
    }

    /// Takes in how somebody is heard.
    pub(super) fn contact(&mut self, report: Report) {
        if !matches!(report.contact, Contact::Stale | Contact::Lost) {
            return;
        }
        for fault in &mut self.windows {
            fault.contact(report);
        }
        if self.reports.len() == self.reports.capacity() {
            let old_ns = self.newest_t_ns.saturating_sub(TOLD_WITHIN_NS);
            self.reports.retain(|earlier| earlier.since_ns >= old_ns);
        }
        self.reports.push(report);
    }

    #[cfg(test)]
    pub(super) fn reports_kept(&self) -> usize {
        self.reports.len()
    }

    /// What each fault did, in the order in which they were told.
    pub(super) fn report(&self, names: &[String]) -> Vec<FaultReport> {
        let broken_m = self.predictor.bound_m();
        self.windows.iter().map(|fault| fault.report(names, broken_m)).collect()
    }
}

/// When the faults that act by the briefs, with nobody doing anything, begin and end.
fn scheduled(scenario: &Scenario) -> VecDeque<(u64, usize, Bound)> {
    let mut bounds = Vec::new();
    let faults = scenario.faults.iter().enumerate();
    for (number, fault) in faults.filter(|(_, fault)| fault.kind.acts_by_brief()) {
        bounds.push((fault.at_ns, number, Bound::Begin));
        // What lasts to the end is never going to be any better than it is.
        let (end, t_ns) = match fault.until_ns() {
            Some(until_ns) => (End::Whole, until_ns),
            None => (End::ForGood, fault.at_ns),
        };
        bounds.push((t_ns, number, Bound::End(end)));
    }
    bounds.sort_by_key(|&(t_ns, ..)| t_ns);
    bounds.into()
}
