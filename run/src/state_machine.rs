//! Pure part of a run, as one value: its plan, the states of its robots, their newest reports, and the journal. Events
//! go in; orders for a driver come out, and records go to the journal.
//!
//! A driver executes orders, and reports what happened as further events. It decides nothing. `supervisor/` is the
//! driver with processes, and `in_process` the one without.

use experiment::scenario::{FaultKind, Scenario};
use outcome::metrics::Metrics;
use outcome::report::scene::SceneFrame;
use outcome::results::outcome::RunOutcome;
use outcome::results::run_dir::RunDirError;
use outcome::results::scene;
use protocol::law_message::SentCounts;
use protocol::message::{NeighborStatus, StatusHeader, TruthHeader, TruthRow};

use crate::journal::Journal;
use crate::lifecycle::{DriverOrder, Effect, Initiator, LifecycleEvent, Lifecycles, RunRecord};
use crate::reports::{RobotReport, StatusChange};
use crate::timeline::Timeline;

/// Receiver of the records of a run.
pub trait RecordSink {
    /// Takes a record at this run time, ns.
    fn record(&mut self, t_ns: u64, record: RunRecord);
}

/// Pure part of a run. `J` receives its records: a [`Journal`], [`Metrics`] alone, or `()` for none.
#[derive(Debug)]
pub struct RunStateMachine<J> {
    timeline: Timeline,
    lifecycles: Lifecycles,
    /// Newest report of each robot, in scenario order.
    reports: Vec<RobotReport>,
    /// Own goal of each robot, in scenario order, m; `None` for a robot without a goal.
    own_goals_m: Vec<Option<[f64; 2]>>,
    /// Receiver of the records.
    pub journal: J,
}

impl<J: RecordSink> RunStateMachine<J> {
    /// Creates the state at the start, in which all first processes are being started. `restart_before_cleanup` is
    /// whether a replacement may start before the stale resources of its predecessor are removed.
    pub fn new(
        scenario: &Scenario,
        restart_before_cleanup: bool,
        journal: J,
    ) -> RunStateMachine<J> {
        let robots = &scenario.robots;
        let policies = robots.iter().map(|robot| robot.restart_policy);
        let link_receivers = scenario.graph.edges().iter().map(|edge| edge.to);
        RunStateMachine {
            timeline: Timeline::new(scenario),
            lifecycles: Lifecycles::new(policies, link_receivers, restart_before_cleanup),
            reports: robots.iter().map(|_| RobotReport::new(robots.len())).collect(),
            own_goals_m: robots.iter().map(|robot| robot.goal_m).collect(),
            journal,
        }
    }

    /// Returns the states of the robots.
    pub fn lifecycles(&self) -> &Lifecycles {
        &self.lifecycles
    }

    /// Returns the newest report of a robot.
    pub fn report(&self, robot: usize) -> &RobotReport {
        &self.reports[robot]
    }

    /// Handles an event at this run time, ns. Returns the orders that follow from it.
    pub fn handle_event(&mut self, now_ns: u64, event: LifecycleEvent) -> Vec<DriverOrder> {
        let mut orders = Vec::new();
        for effect in self.lifecycles.handle_event(now_ns, event) {
            match effect {
                Effect::Record(record) => self.journal.record(now_ns, record),
                Effect::Order(order) => {
                    if let DriverOrder::Start { robot, .. } = order {
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
    pub fn handle_planned_event(&mut self, now_ns: u64) -> Option<Vec<DriverOrder>> {
        let event = self.timeline.take_due_event(now_ns)?;
        Some(self.handle_event(now_ns, event))
    }

    /// Records what the present process of a robot has sent. In lockstep a driver calls it before it reports the death of
    /// that process, and at the end of the run.
    pub fn record_sent_counts(&mut self, robot: usize, counts: SentCounts) {
        self.reports[robot].update_sent_counts(counts);
    }

    /// Returns the run time of the next planned event or replacement, ns.
    pub fn next_action_ns(&self) -> Option<u64> {
        let next = [self.lifecycles.next_restart_ns(), self.timeline.next_event_ns()];
        next.into_iter().flatten().min()
    }
}

/// Passes the target and the signals of a robot's law from its status to the metrics.
fn add_law_values(metrics: &mut Metrics, robot: usize, header: &StatusHeader) {
    metrics.set_own_target(robot, header.t_ns, header.target());
    metrics.add_signals(robot, header.t_ns, header.signals());
}

impl RunStateMachine<Metrics> {
    /// Measures the law values in a status message of a robot's present process.
    pub fn measure_status(&mut self, robot: usize, header: &StatusHeader) {
        add_law_values(&mut self.journal, robot, header);
    }

    /// Measures a ground truth sample.
    pub fn measure_truth(&mut self, header: &TruthHeader, rows: &[TruthRow]) {
        self.journal.add_truth(header, rows, self.lifecycles.alive_robots());
    }
}

impl RunStateMachine<Journal<'_>> {
    /// Records an event of a robot, or of the whole run, that has no effects.
    pub fn record_event(
        &mut self,
        now_ns: u64,
        kind: &'static str,
        robot: Option<usize>,
        detail: impl Into<String>,
    ) {
        self.journal.add_event(now_ns, kind, robot, detail.into());
    }

    /// Registers a fault that the scenario does not plan, for the report. Returns its number.
    pub fn register_fault(
        &mut self,
        scenario: &Scenario,
        kind: &FaultKind,
        initiator: Initiator,
    ) -> usize {
        let description = format!("{}, {}", kind.describe(scenario), initiator.keyword());
        self.journal.metrics.register_fault(description, kind.affected_component(scenario))
    }

    /// Records a ground truth sample.
    pub fn record_truth(
        &mut self,
        header: &TruthHeader,
        rows: &[TruthRow],
    ) -> Result<(), RunDirError> {
        let RunStateMachine { journal, lifecycles, .. } = self;
        journal.metrics.add_truth(header, rows, lifecycles.alive_robots());
        let measured = journal.metrics.current_metrics();
        journal.run_dir.write_truth(header, rows, lifecycles.alive_robots(), measured)
    }

    /// Records a status message of a robot's present process. `message` is the recorded message of its law, empty if
    /// there is none. Returns the changes in it.
    pub fn record_status(
        &mut self,
        robot: usize,
        header: &StatusHeader,
        neighbors: &[NeighborStatus],
        message: &[u8],
    ) -> Vec<StatusChange> {
        self.journal.run_dir.add_law_message(robot, header.t_ns, message);
        add_law_values(self.journal.metrics, robot, header);
        let changes = self.reports[robot].update(header, neighbors);
        for change in &changes {
            self.journal.record_change(robot, change, self.own_goals_m[robot]);
        }
        changes
    }

    /// Returns a ground truth sample, the newest one, as a frame for figures.
    pub fn scene_frame(
        &self,
        scenario: &Scenario,
        header: &TruthHeader,
        rows: &[TruthRow],
    ) -> SceneFrame {
        let RunStateMachine { lifecycles, reports, journal, .. } = self;
        let orphaned = journal.metrics.orphaned_robots();
        let display_state =
            |robot: usize| lifecycles.process_state(robot).display_state(orphaned[robot]);
        let reception_state = |from: usize, to: usize| reports[to].reception_state(from);
        let is_link_cut = |edge| lifecycles.is_link_cut(edge);
        let errors_m = journal.metrics.current_metrics().errors_m;
        scene::build_frame(
            scenario,
            header,
            rows,
            errors_m,
            display_state,
            reception_state,
            is_link_cut,
        )
    }

    /// Returns the outcome of the run as far as it follows from the events and the reports.
    pub fn outcome(&self) -> RunOutcome {
        let counts = self.reports.iter().map(RobotReport::counts);
        let robots = 0..self.reports.len();
        RunOutcome {
            restart_counts: robots.map(|robot| self.lifecycles.incarnation(robot)).collect(),
            deadline_misses: counts.clone().map(|counts| counts.deadline_misses).sum(),
            unanswered_samples: counts.clone().map(|counts| counts.old_odometry_samples).sum(),
            refused_beacon_counts: counts.clone().map(|counts| counts.rejected_beacons).collect(),
            sent_counts: counts.map(|counts| counts.sent_counts).collect(),
            ..RunOutcome::default()
        }
    }
}

impl RecordSink for () {
    fn record(&mut self, _: u64, _: RunRecord) {}
}

impl RecordSink for Metrics {
    fn record(&mut self, t_ns: u64, record: RunRecord) {
        match record {
            RunRecord::Note { .. } => {}
            RunRecord::FaultBegan(fault) => self.begin_fault(fault, t_ns),
            RunRecord::UnplannedDeath { robot, cause, at_ns, fault } => {
                let number = self.record_unplanned_death(robot, &cause, at_ns);
                assert_eq!(number, fault);
            }
            RunRecord::FaultEnded { fault, end, at_ns } => self.end_fault(fault, end, at_ns),
        }
    }
}

impl RecordSink for Journal<'_> {
    fn record(&mut self, t_ns: u64, record: RunRecord) {
        match record {
            RunRecord::Note { kind, robot, detail } => self.add_event(t_ns, kind, robot, detail),
            record => self.metrics.record(t_ns, record),
        }
    }
}
