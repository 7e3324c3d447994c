//! Journal of a run: passes events in the order of run time to the run directory and to the metrics, and keeps
//! new ones for a live view.
//!
//! The order in which reports arrive depends on the machine. A record therefore waits until all events
//! before its time are known, and is written in an order that depends on the run only.

use std::collections::BTreeSet;

use formation::ns_to_seconds;
use protocol::message::ReceptionState;

use outcome::metrics::{Metrics, OrphanChange, ReferenceChange};
use outcome::results::run_dir::{RunDir, RunDirError};
use outcome::results::tables::EventLine;

use crate::reports::StatusChange;

/// Journal, with its outputs.
pub struct Journal<'a> {
    robot_names: Vec<String>,
    /// Directory of the run.
    pub run_dir: &'a mut RunDir,
    /// Metrics of the run.
    pub metrics: &'a mut Metrics,
    /// Events that were added since the last call of [`Journal::take_added_events`]; `None` if they are not kept.
    added_events: Option<Vec<EventLine>>,
    /// Backup leaders that lead at present.
    leading_deputies: BTreeSet<usize>,
    pending_records: PendingRecords,
}

/// Record of one event.
#[derive(Debug, Clone, PartialEq)]
struct EventRecord {
    /// Run time, ns.
    t_ns: u64,
    kind: &'static str,
    /// Index of the robot; `None` for an event of the whole run.
    robot: Option<usize>,
    detail: String,
    change: Option<RecordedChange>,
}

/// Change that an event reports, for the columns of `events.csv` and for the metrics, to which it is applied once all
/// earlier events are known.
#[derive(Debug, Clone, Copy, PartialEq)]
enum RecordedChange {
    /// New reception state of another robot.
    Reception { other_robot: usize, reception_state: ReceptionState },
    /// New reception state of the leader's frame.
    LeaderFrameReception(ReceptionState),
    /// New references of a robot.
    References(ReferenceChange),
    /// New goal, m.
    Goal([f64; 2]),
    /// Interactive cut or repair of the link from this robot.
    Link { sender: usize },
}

/// Records that wait for earlier events.
#[derive(Debug, Default)]
struct PendingRecords {
    /// Records, each with the number of earlier restarts of its robot at the same time.
    records: Vec<(usize, EventRecord)>,
}

impl<'a> Journal<'a> {
    /// Creates an empty journal for robots with these names, in scenario order.
    pub fn new(
        names: Vec<String>,
        run_dir: &'a mut RunDir,
        metrics: &'a mut Metrics,
    ) -> Journal<'a> {
        Journal {
            robot_names: names,
            run_dir,
            metrics,
            added_events: None,
            pending_records: PendingRecords::default(),
            leading_deputies: BTreeSet::new(),
        }
    }

    /// Keeps each added event until [`Journal::take_added_events`] returns it.
    pub fn collect_added_events(&mut self) {
        self.added_events = Some(Vec::new());
    }

    /// Removes and returns the events that were added since the last call, in the order in which they were added.
    pub fn take_added_events(&mut self) -> Vec<EventLine> {
        self.added_events.as_mut().map(std::mem::take).unwrap_or_default()
    }

    /// Returns the name of a robot.
    pub fn robot_name(&self, robot: usize) -> &str {
        &self.robot_names[robot]
    }

    /// Adds an event of a robot, or of the whole run.
    pub fn add_event(
        &mut self,
        t_ns: u64,
        kind: &'static str,
        robot: Option<usize>,
        detail: String,
    ) {
        // A replacement tracks its in-neighbors again.
        let restart_change = robot
            .filter(|_| kind == RESTART_KIND)
            .map(|robot| ReferenceChange::Restarted { robot });
        robot
            .filter(|_| restart_change.is_some())
            .inspect(|robot| _ = self.leading_deputies.remove(robot));
        restart_change
            .into_iter()
            .for_each(|restart_change| self.metrics.announce_rewiring(t_ns, restart_change));
        self.add_record(EventRecord {
            t_ns,
            kind,
            robot,
            detail,
            change: restart_change.map(RecordedChange::References),
        });
    }

    /// Adds a change in a robot's status. `own_goal_m` is the robot's goal unless one comes from outside, m.
    pub fn record_change(
        &mut self,
        robot: usize,
        change: &StatusChange,
        own_goal_m: Option<[f64; 2]>,
    ) {
        match *change {
            StatusChange::ReceptionChanged { other_robot, reception_state, since_ns } => {
                self.add_reception_state(since_ns, robot, other_robot, reception_state);
            }
            StatusChange::LeaderFrameReceptionChanged { reception_state, since_ns } => {
                self.add_leader_frame_reception(since_ns, robot, reception_state);
            }
            StatusChange::ReferenceUseChanged { other_robot, is_used, since_ns } => {
                self.add_reference_use(since_ns, robot, other_robot, is_used);
            }
            StatusChange::GoalChanged { outside_goal_m, since_ns } => {
                if let Some(goal_m) = outside_goal_m.or(own_goal_m) {
                    let source = if outside_goal_m.is_some() { "ros2" } else { "the scenario" };
                    self.add_goal(since_ns, robot, goal_m, source);
                }
            }
        }
    }

    /// Adds a robot's report that its reception of another robot is in this state since `t_ns`.
    fn add_reception_state(
        &mut self,
        t_ns: u64,
        robot: usize,
        other_robot: usize,
        reception_state: ReceptionState,
    ) {
        let detail = format!("{} {}", reception_state.keyword(), self.robot_names[other_robot]);
        let change = Some(RecordedChange::Reception { other_robot, reception_state });
        self.add_record(EventRecord {
            t_ns,
            kind: CONTACT_KIND,
            robot: Some(robot),
            detail,
            change,
        });
    }

    /// Adds a robot's report that its reception of the leader's frame is in this state since `t_ns`.
    fn add_leader_frame_reception(
        &mut self,
        t_ns: u64,
        robot: usize,
        reception_state: ReceptionState,
    ) {
        let detail = format!("{} frame of the leader", reception_state.keyword());
        let change = Some(RecordedChange::LeaderFrameReception(reception_state));
        self.add_record(EventRecord {
            t_ns,
            kind: CONTACT_KIND,
            robot: Some(robot),
            detail,
            change,
        });
        let is_leading = self.metrics.is_deputy(robot) && reception_state == ReceptionState::Lost;
        if is_leading != self.leading_deputies.contains(&robot) {
            match is_leading {
                true => _ = self.leading_deputies.insert(robot),
                false => _ = self.leading_deputies.remove(&robot),
            }
            let detail = if is_leading { "leads" } else { "leads no longer" }.to_owned();
            self.add_reference_change(
                t_ns,
                robot,
                ReferenceChange::DeputyLead { robot, is_leading },
                detail,
            );
        }
    }

    /// Adds a robot's report that it uses another as a reference, or no longer does, since `t_ns`.
    fn add_reference_use(&mut self, t_ns: u64, robot: usize, other_robot: usize, is_used: bool) {
        let verb = if is_used { "uses" } else { "no longer uses" };
        let detail = format!("{verb} {}", self.robot_names[other_robot]);
        self.add_reference_change(
            t_ns,
            robot,
            ReferenceChange::ReferenceUse { robot, neighbor: other_robot, is_used },
            detail,
        );
    }

    fn add_reference_change(
        &mut self,
        t_ns: u64,
        robot: usize,
        reference_change: ReferenceChange,
        detail: String,
    ) {
        self.metrics.announce_rewiring(t_ns, reference_change);
        let change = Some(RecordedChange::References(reference_change));
        self.add_record(EventRecord {
            t_ns,
            kind: REPAIR_KIND,
            robot: Some(robot),
            detail,
            change,
        });
    }

    /// Adds a robot's report that it drives to this goal, m, since `t_ns`, and the source of the goal.
    /// Errors are measured from this goal once the report is known.
    fn add_goal(&mut self, t_ns: u64, robot: usize, goal_m: [f64; 2], source: &str) {
        self.metrics.set_goal(robot, goal_m.into());
        let [x_m, y_m] = goal_m;
        let detail = format!("to {x_m} {y_m} m, from {source}");
        let change = Some(RecordedChange::Goal(goal_m));
        self.add_record(EventRecord { t_ns, kind: GOAL_KIND, robot: Some(robot), detail, change });
    }

    /// Adds the interactive cut or repair of the link between two robots.
    pub fn add_link_event(
        &mut self,
        t_ns: u64,
        kind: &'static str,
        [sender, receiver]: [usize; 2],
        detail: String,
    ) {
        let change = Some(RecordedChange::Link { sender });
        self.add_record(EventRecord { t_ns, kind, robot: Some(receiver), detail, change });
    }

    fn add_record(&mut self, record: EventRecord) {
        if self.added_events.is_some() {
            let event = self.event_line(record.clone());
            self.added_events.iter_mut().for_each(|added| added.push(event.clone()));
        }
        self.pending_records.push(record);
    }

    /// Returns the record as a line of `events.csv`.
    fn event_line(
        &self,
        EventRecord { t_ns, kind, robot, detail, change }: EventRecord,
    ) -> EventLine {
        let robot_name = |robot: usize| self.robot_names[robot].clone();
        let (other_robot, state) = match change {
            Some(RecordedChange::Reception { other_robot, reception_state }) => {
                (Some(other_robot), reception_state.keyword())
            }
            Some(RecordedChange::LeaderFrameReception(reception_state)) => {
                (None, reception_state.keyword())
            }
            Some(RecordedChange::References(ReferenceChange::ReferenceUse {
                neighbor: other_robot,
                is_used,
                ..
            })) => (Some(other_robot), if is_used { "used" } else { "unused" }),
            Some(RecordedChange::References(ReferenceChange::DeputyLead {
                is_leading, ..
            })) => (None, if is_leading { "leads" } else { "follows" }),
            Some(RecordedChange::Link { sender }) => (Some(sender), ""),
            Some(
                RecordedChange::References(ReferenceChange::Restarted { .. })
                | RecordedChange::Goal(_),
            )
            | None => (None, ""),
        };
        let goal_m = match change {
            Some(RecordedChange::Goal(goal_m)) => Some(goal_m),
            _ => None,
        };
        EventLine {
            t_s: ns_to_seconds(t_ns),
            kind: kind.to_owned(),
            robot: robot.map_or(String::new(), robot_name),
            detail,
            other: other_robot.map_or(String::new(), robot_name),
            state: state.to_owned(),
            goal_x_m: goal_m.map(|[x_m, _]| x_m),
            goal_y_m: goal_m.map(|[_, y_m]| y_m),
        }
    }

    /// Writes all records before this run time, ns, at which all earlier events are known.
    pub fn write_events_before(&mut self, t_ns: u64) -> Result<(), RunDirError> {
        for OrphanChange { t_ns, robot, is_orphaned } in
            self.metrics.take_orphan_changes_before(t_ns)
        {
            let (kind, detail) = match is_orphaned {
                true => (ORPHANED_KIND, "no living leader reaches it"),
                false => (RECONNECTED_KIND, "a leader reaches it again"),
            };
            self.add_event(t_ns, kind, Some(robot), detail.to_owned());
        }
        if self.pending_records.records.is_empty() {
            return Ok(());
        }
        for record in self.pending_records.take_records_before(t_ns) {
            match (record.robot, record.change) {
                (Some(robot), Some(RecordedChange::Reception { other_robot, reception_state })) => {
                    self.metrics.record_reception(robot, other_robot, reception_state, record.t_ns);
                }
                (_, Some(RecordedChange::References(reference_change))) => {
                    self.metrics.apply_rewiring(reference_change)
                }
                _ => {}
            }
            let t_ns = record.t_ns;
            let event = self.event_line(record);
            self.run_dir.write_event(t_ns, event)?;
        }
        Ok(())
    }
}

/// Kind of the event of a replacement's start.
const RESTART_KIND: &str = "restart";
/// Kind of the events of reception states.
const CONTACT_KIND: &str = "contact";
/// Kind of the events of changed references.
const REPAIR_KIND: &str = "repair";
/// Kind of the events of new goals.
const GOAL_KIND: &str = "goal";
/// Kinds of the events that the metrics derive from the graph.
const ORPHANED_KIND: &str = "orphaned";
const RECONNECTED_KIND: &str = "led";

/// Returns the rank of events at the same time, in the order of causes: actions, in the order of execution;
/// then their effects.
fn causal_rank(kind: &str) -> usize {
    let effect_kinds = [
        "died",
        "restart-ceiling",
        RESTART_KIND,
        "ready",
        CONTACT_KIND,
        REPAIR_KIND,
        ORPHANED_KIND,
        RECONNECTED_KIND,
    ];
    effect_kinds.iter().position(|&other| other == kind).map_or(0, |index| index + 1)
}

impl PendingRecords {
    fn push(&mut self, record: EventRecord) {
        // A robot restarted interactively may be killed again at the same run time.
        let is_same_event = |(_, other): &&(usize, EventRecord)| {
            ![CONTACT_KIND, REPAIR_KIND, ORPHANED_KIND, RECONNECTED_KIND].contains(&record.kind)
                && ![CONTACT_KIND, REPAIR_KIND, ORPHANED_KIND, RECONNECTED_KIND]
                    .contains(&other.kind)
                && (other.t_ns, other.robot) == (record.t_ns, record.robot)
        };
        let round = match self.records.iter().rev().find(is_same_event) {
            Some((round, other)) => {
                round + usize::from(causal_rank(record.kind) < causal_rank(other.kind))
            }
            None => 0,
        };
        self.records.push((round, record));
    }

    /// Removes and returns the records before this run time, ns, in order.
    fn take_records_before(&mut self, t_ns: u64) -> Vec<EventRecord> {
        // Stable sort: actions at the same time stay in the order of execution.
        self.records.sort_by(|(a_round, a), (b_round, b)| {
            let key =
                |round: usize, record: &EventRecord| (record.t_ns, round, causal_rank(record.kind));
            let compare_content = || (a.robot, &a.detail).cmp(&(b.robot, &b.detail));
            key(*a_round, a).cmp(&key(*b_round, b)).then_with(|| match causal_rank(a.kind) {
                0 => std::cmp::Ordering::Equal,
                _ => compare_content(),
            })
        });
        let known_count = self.records.partition_point(|(_, record)| record.t_ns < t_ns);
        self.records.drain(..known_count).map(|(_, record)| record).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    use experiment::examples::row_of_three;
    use experiment::scenario::{Fault, FaultKind};
    use outcome::metrics::examples::{header, rows};
    use protocol::brief::Pace;
    use protocol::fault::LinkFaultKind;

    #[test]
    fn stale_report_before_the_ground_truth_of_its_cut_counts() {
        let mut scenario = row_of_three();
        let kind = FaultKind::Link { edge: 0, kind: LinkFaultKind::Cut };
        scenario.faults = vec![Fault { start_ns: 2_000_000_000, duration_ns: None, kind }];
        let edge = scenario.graph.edges()[0];
        let temp_dir = tempfile::tempdir().unwrap();
        let mut run_dir = RunDir::create(&temp_dir.path().join("run"), &scenario).unwrap();
        let mut metrics = Metrics::new(&scenario, Pace::Lockstep);
        let names = scenario.robots.iter().map(|robot| robot.name.clone()).collect();
        let mut journal = Journal::new(names, &mut run_dir, &mut metrics);
        // Reports of robots may be newer than the ground truth that was read.
        journal.add_reception_state(3_000_000_000, edge.to, edge.from, ReceptionState::Stale);
        for tick in 0..5 {
            journal.write_events_before(header(tick).t_ns).unwrap();
            journal.metrics.add_truth(&header(tick), &rows([0.0, 1.0, 2.0]), &[true; 3]);
        }
        let [fault] = &metrics.finish().faults[..] else { panic!("one fault") };
        assert_eq!(fault.stale_after_s, Some(1.0));
    }

    fn event_record(t_ns: u64, kind: &'static str, robot: usize) -> EventRecord {
        EventRecord { t_ns, kind, robot: Some(robot), detail: String::new(), change: None }
    }

    fn event_kinds(records: &[EventRecord]) -> Vec<(u64, &str, usize)> {
        records.iter().map(|record| (record.t_ns, record.kind, record.robot.unwrap())).collect()
    }

    #[test]
    fn causes_precede_effects_at_equal_times() {
        let mut records = PendingRecords::default();
        records.push(event_record(6, CONTACT_KIND, 0));
        // In any order, because which robot dies and is ready first depends on the machine.
        for (kind, robot) in [
            ("kill", 2),
            ("kill", 1),
            ("thaw", 0),
            ("died", 2),
            ("restart", 2),
            ("ready", 2),
            ("died", 1),
            ("kill", 2),
            ("died", 2),
        ] {
            records.push(event_record(5, kind, robot));
        }
        let expected = [
            (5, "kill", 2),
            (5, "kill", 1),
            (5, "thaw", 0),
            (5, "died", 1),
            (5, "died", 2),
            (5, "restart", 2),
            (5, "ready", 2),
            (5, "kill", 2),
            (5, "died", 2),
        ];
        assert_eq!(event_kinds(&records.take_records_before(6)), expected);
        assert!(records.take_records_before(6).is_empty(), "what comes later waits");
        assert_eq!(records.take_records_before(u64::MAX).len(), 1);
    }

    proptest! {
        /// Checks that the order of records does not depend on the order in which reports arrive, nor on
        /// their grouping.
        #[test]
        fn journal_order_does_not_depend_on_arrival_order(
            mut reports in proptest::collection::vec((0..8u64, 0..4usize, 0..3usize), 0..40),
            keys in proptest::collection::vec(any::<u32>(), 40),
        ) {
            reports.sort_unstable();
            reports.dedup();
            let ordered_records = |reports: &[(u64, usize, usize)]| {
                let mut records = PendingRecords::default();
                for &(t_ns, robot, number) in reports {
                    records.push(EventRecord { detail: number.to_string(), ..event_record(t_ns, CONTACT_KIND, robot) });
                }
                records.take_records_before(u64::MAX)
            };
            let expected = ordered_records(&reports);
            let mut shuffled: Vec<_> = reports.iter().zip(keys).collect();
            shuffled.sort_by_key(|&(_, key)| key);
            let shuffled: Vec<_> = shuffled.into_iter().map(|(&report, _)| report).collect();
            prop_assert_eq!(ordered_records(&shuffled), expected);
        }
    }
}
