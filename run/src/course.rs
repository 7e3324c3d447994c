//! Pure part of a run, as one value: its plan, the states of its robots, their newest reports, and the journal. Events
//! go in; orders for a driver come out, and records go to the journal.
//!
//! A driver executes orders, and reports what happened as further events. It decides nothing. `supervisor/` is the
//! driver with processes, and `in_process` the one without.

use experiment::scenario::{FaultKind, Scenario};
use outcome::metrics::Metrics;
use outcome::report::scene::Frame;
use outcome::results::outcome::Outcome;
use outcome::results::run_dir::RunDirError;
use outcome::results::scene;
use protocol::message::{NeighborStatus, StatusHeader, TruthHeader, TruthRow};

use crate::journal::Journal;
use crate::lifecycle::{Effect, Event, Initiator, Lifecycles, Order, Record};
use crate::reports::{Report, StatusChange};
use crate::timeline::Timeline;

/// Receiver of the records of a run.
pub trait Records {
    /// Takes a record at this run time, ns.
    fn record(&mut self, t_ns: u64, record: Record);
}

/// Pure part of a run. `J` receives its records: a [`Journal`], [`Metrics`] alone, or `()` for none.
#[derive(Debug)]
pub struct Course<J> {
    timeline: Timeline,
    lifecycles: Lifecycles,
    /// Newest report of each robot, in scenario order.
    reports: Vec<Report>,
    /// Own goal of each robot, in scenario order, m; `None` for a robot without a goal.
    own_goals_m: Vec<Option<[f64; 2]>>,
    /// Receiver of the records.
    pub journal: J,
}

impl<J: Records> Course<J> {
    /// Creates the state at the start, in which all first processes are being started. `restart_before_cleanup` is
    /// whether a replacement may start before the stale resources of its predecessor are removed.
    pub fn new(scenario: &Scenario, restart_before_cleanup: bool, journal: J) -> Course<J> {
        let robots = &scenario.robots;
        let policies = robots.iter().map(|robot| robot.restart);
        let hearers = scenario.graph.edges().iter().map(|edge| edge.to);
        Course {
            timeline: Timeline::new(scenario),
            lifecycles: Lifecycles::new(policies, hearers, restart_before_cleanup),
            reports: robots.iter().map(|_| Report::new(robots.len())).collect(),
            own_goals_m: robots.iter().map(|robot| robot.goal_m).collect(),
            journal,
        }
    }

    /// Returns the states of the robots.
    pub fn lifecycles(&self) -> &Lifecycles {
        &self.lifecycles
    }

    /// Returns the newest report of a robot.
    pub fn report(&self, robot: usize) -> &Report {
        &self.reports[robot]
    }

    /// Handles an event at this run time, ns. Returns the orders that follow from it.
    pub fn handle(&mut self, now_ns: u64, event: Event) -> Vec<Order> {
        let mut orders = Vec::new();
        for effect in self.lifecycles.step(now_ns, event) {
            match effect {
                Effect::Record(record) => self.journal.record(now_ns, record),
                Effect::Order(order) => {
                    if let Order::Start { robot, .. } = order {
                        // Reports that the dead process had not yet sent are lost.
                        self.reports[robot].reset();
                    }
                    orders.push(order);
                }
            }
        }
        orders
    }

    /// Handles the next planned event that is due at this run time, ns. Returns the orders that follow from it;
    /// `None` if no planned event is due.
    pub fn handle_planned(&mut self, now_ns: u64) -> Option<Vec<Order>> {
        let event = self.timeline.take_due(now_ns)?;
        Some(self.handle(now_ns, event))
    }

    /// Returns the run time of the next planned event or replacement, ns.
    pub fn next_action_ns(&self) -> Option<u64> {
        let next = [self.lifecycles.next_restart_ns(), self.timeline.next_ns()];
        next.into_iter().flatten().min()
    }
}

impl Course<Metrics> {
    /// Measures a ground truth sample.
    pub fn add_truth(&mut self, header: &TruthHeader, rows: &[TruthRow]) {
        self.journal.add_truth(header, rows, self.lifecycles.alive_robots());
    }
}

impl Course<Journal<'_>> {
    /// Records an event of a robot, or of the whole run, from which nothing follows.
    pub fn record_event(
        &mut self,
        now_ns: u64,
        kind: &'static str,
        robot: Option<usize>,
        detail: impl Into<String>,
    ) {
        self.journal.event(now_ns, kind, robot, detail.into());
    }

    /// Registers a fault that the scenario does not plan, for the report. Returns its number.
    pub fn register_fault(
        &mut self,
        scenario: &Scenario,
        kind: &FaultKind,
        who: Initiator,
    ) -> usize {
        let what = format!("{}, {}", kind.describe(scenario), who.keyword());
        self.journal.metrics.register_fault(what, kind.affected_component(scenario))
    }

    /// Records a ground truth sample.
    pub fn record_truth(
        &mut self,
        header: &TruthHeader,
        rows: &[TruthRow],
    ) -> Result<(), RunDirError> {
        let Course { journal, lifecycles, .. } = self;
        journal.metrics.add_truth(header, rows, lifecycles.alive_robots());
        let measured = journal.metrics.current();
        journal.run_dir.write_truth(header, rows, lifecycles.alive_robots(), measured)
    }

    /// Records a status message of a robot's present process. Returns the changes in it.
    pub fn record_status(
        &mut self,
        robot: usize,
        header: &StatusHeader,
        neighbors: &[NeighborStatus],
    ) -> Vec<StatusChange> {
        self.journal.metrics.set_own_target(robot, header.t_ns, header.target());
        self.journal.metrics.add_signals(robot, header.t_ns, header.signals());
        let changes = self.reports[robot].update(header, neighbors);
        for change in &changes {
            self.journal.record_change(robot, change, self.own_goals_m[robot]);
        }
        changes
    }

    /// Returns a ground truth sample, the newest one, as a frame for figures.
    pub fn frame(&self, scenario: &Scenario, header: &TruthHeader, rows: &[TruthRow]) -> Frame {
        let Course { lifecycles, reports, journal, .. } = self;
        let orphaned = journal.metrics.orphaned();
        let state = |robot: usize| lifecycles.process_state(robot).state(orphaned[robot]);
        let heard = |from: usize, to: usize| reports[to].contact(from);
        let cut = |edge| lifecycles.is_cut(edge);
        let errors_m = journal.metrics.current().errors_m;
        scene::frame(scenario, header, rows, errors_m, state, heard, cut)
    }

    /// Returns the outcome of the run as far as it follows from the events and the reports.
    pub fn outcome(&self) -> Outcome {
        let counts = self.reports.iter().map(Report::counts);
        let robots = 0..self.reports.len();
        Outcome {
            restarts: robots.map(|robot| self.lifecycles.incarnation(robot)).collect(),
            deadline_misses: counts.clone().map(|counts| counts.misses).sum(),
            odometry_old: counts.clone().map(|counts| counts.odometry_old).sum(),
            beacons_refused: counts.clone().map(|counts| counts.refused).collect(),
            sent: counts.map(|counts| counts.sent).collect(),
            ..Outcome::default()
        }
    }
}

impl Records for () {
    fn record(&mut self, _: u64, _: Record) {}
}

impl Records for Metrics {
    fn record(&mut self, t_ns: u64, record: Record) {
        match record {
            Record::Note { .. } => {}
            Record::Began(fault) => self.begin_fault(fault, t_ns),
            Record::DiedUnplanned { robot, how, at_ns, fault } => {
                let number = self.record_unplanned_death(robot, &how, at_ns);
                debug_assert_eq!(number, fault);
            }
            Record::Ended { fault, end, at_ns } => self.end_fault(fault, end, at_ns),
        }
    }
}

impl Records for Journal<'_> {
    fn record(&mut self, t_ns: u64, record: Record) {
        match record {
            Record::Note { kind, robot, detail } => self.event(t_ns, kind, robot, detail),
            record => self.metrics.record(t_ns, record),
        }
    }
}
