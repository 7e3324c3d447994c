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

/// Change that an event tells of, for the columns of `events.csv` and for the metrics, to which it is applied once all
/// earlier events are known.
#[derive(Debug, Clone, Copy, PartialEq)]
enum RecordedChange {
    /// New contact state of another robot.
    Reception { other_robot: usize, reception_state: ReceptionState },
    /// New contact state of the leader's frame.
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
        let anew = robot
            .filter(|_| kind == RESTART_KIND)
            .map(|robot| ReferenceChange::Restarted { robot });
        robot.filter(|_| anew.is_some()).inspect(|robot| _ = self.leading_deputies.remove(robot));
        anew.into_iter().for_each(|anew| self.metrics.announce_rewiring(t_ns, anew));
        self.add_record(EventRecord {
            t_ns,
            kind,
            robot,
            detail,
            change: anew.map(RecordedChange::References),
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
            StatusChange::ReceptionChanged {
                other_robot: other,
                reception_state: contact,
                since_ns,
            } => {
                self.add_reception_state(since_ns, robot, other, contact);
            }
            StatusChange::LeaderFrameReceptionChanged { reception_state: contact, since_ns } => {
                self.add_leader_frame_reception(since_ns, robot, contact);
            }
            StatusChange::ReferenceUseChanged { other_robot: other, is_used: yes, since_ns } => {
                self.add_reference_use(since_ns, robot, other, yes);
            }
            StatusChange::GoalChanged { outside_goal_m: outside_m, since_ns } => {
                if let Some(goal_m) = outside_m.or(own_goal_m) {
                    let whose = if outside_m.is_some() { "ros2" } else { "the scenario" };
                    self.add_goal(since_ns, robot, goal_m, whose);
                }
            }
        }
    }

    /// Adds a robot's report that its contact to another robot is in this state since `t_ns`.
    fn add_reception_state(
        &mut self,
        t_ns: u64,
        robot: usize,
        other: usize,
        contact: ReceptionState,
    ) {
        let detail = format!("{} {}", contact.keyword(), self.robot_names[other]);
        let change =
            Some(RecordedChange::Reception { other_robot: other, reception_state: contact });
        self.add_record(EventRecord {
            t_ns,
            kind: CONTACT_KIND,
            robot: Some(robot),
            detail,
            change,
        });
    }

    /// Adds a robot's report that its contact to the leader's frame is in this state since `t_ns`.
    fn add_leader_frame_reception(&mut self, t_ns: u64, robot: usize, contact: ReceptionState) {
        let detail = format!("{} frame of the leader", contact.keyword());
        let change = Some(RecordedChange::LeaderFrameReception(contact));
        self.add_record(EventRecord {
            t_ns,
            kind: CONTACT_KIND,
            robot: Some(robot),
            detail,
            change,
        });
        let leads = self.metrics.is_deputy(robot) && contact == ReceptionState::Lost;
        if leads != self.leading_deputies.contains(&robot) {
            match leads {
                true => _ = self.leading_deputies.insert(robot),
                false => _ = self.leading_deputies.remove(&robot),
            }
            let detail = if leads { "leads" } else { "leads no longer" }.to_owned();
            self.add_reference_change(
                t_ns,
                robot,
                ReferenceChange::DeputyLead { robot, is_leading: leads },
                detail,
            );
        }
    }

    /// Adds a robot's report that it uses another as a reference, or no longer does, since `t_ns`.
    fn add_reference_use(&mut self, t_ns: u64, robot: usize, other: usize, yes: bool) {
        let does = if yes { "uses" } else { "no longer uses" };
        let detail = format!("{does} {}", self.robot_names[other]);
        self.add_reference_change(
            t_ns,
            robot,
            ReferenceChange::ReferenceUse { robot, neighbor: other, is_used: yes },
            detail,
        );
    }

    fn add_reference_change(
        &mut self,
        t_ns: u64,
        robot: usize,
        rewiring: ReferenceChange,
        detail: String,
    ) {
        self.metrics.announce_rewiring(t_ns, rewiring);
        let change = Some(RecordedChange::References(rewiring));
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
    fn add_goal(&mut self, t_ns: u64, robot: usize, goal_m: [f64; 2], whose: &str) {
        self.metrics.set_goal(robot, goal_m.into());
        let [x_m, y_m] = goal_m;
        let detail = format!("to {x_m} {y_m} m, from {whose}");
        let change = Some(RecordedChange::Goal(goal_m));
        self.add_record(EventRecord { t_ns, kind: GOAL_KIND, robot: Some(robot), detail, change });
    }

    /// Adds the interactive cut or repair of the link between two robots.
    pub fn add_link_event(
        &mut self,
        t_ns: u64,
        kind: &'static str,
        [from, to]: [usize; 2],
        detail: String,
    ) {
        let change = Some(RecordedChange::Link { sender: from });
        self.add_record(EventRecord { t_ns, kind, robot: Some(to), detail, change });
    }

    fn add_record(&mut self, line: EventRecord) {
        if self.added_events.is_some() {
            let event = self.event_line(line.clone());
            self.added_events.iter_mut().for_each(|added| added.push(event.clone()));
        }
        self.pending_records.push(line);
    }

    /// Returns the record as a line of `events.csv`.
    fn event_line(
        &self,
        EventRecord { t_ns, kind, robot, detail, change }: EventRecord,
    ) -> EventLine {
        let name = |robot: usize| self.robot_names[robot].clone();
        let (other, state) = match change {
            Some(RecordedChange::Reception { other_robot: other, reception_state: contact }) => {
                (Some(other), contact.keyword())
            }
            Some(RecordedChange::LeaderFrameReception(contact)) => (None, contact.keyword()),
            Some(RecordedChange::References(ReferenceChange::ReferenceUse {
                neighbor: other,
                is_used: yes,
                ..
            })) => (Some(other), if yes { "used" } else { "unused" }),
            Some(RecordedChange::References(ReferenceChange::DeputyLead {
                is_leading: yes,
                ..
            })) => (None, if yes { "leads" } else { "follows" }),
            Some(RecordedChange::Link { sender: from }) => (Some(from), ""),
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
            robot: robot.map_or(String::new(), name),
            detail,
            other: other.map_or(String::new(), name),
            state: state.to_owned(),
            goal_x_m: goal_m.map(|[x_m, _]| x_m),
            goal_y_m: goal_m.map(|[_, y_m]| y_m),
        }
    }

    /// Writes all records before this run time, ns, at which all earlier events are known.
    pub fn write_events_before(&mut self, t_ns: u64) -> Result<(), RunDirError> {
        for OrphanChange { t_ns, robot, is_orphaned: orphaned } in
            self.metrics.take_orphan_changes_before(t_ns)
        {
            let (kind, detail) = match orphaned {
                true => (ORPHANED_KIND, "no living leader reaches it"),
                false => (LED_KIND, "a leader reaches it again"),
            };
            self.add_event(t_ns, kind, Some(robot), detail.to_owned());
        }
        if self.pending_records.records.is_empty() {
            return Ok(());
        }
        for line in self.pending_records.take_records_before(t_ns) {
            match (line.robot, line.change) {
                (
                    Some(robot),
                    Some(RecordedChange::Reception {
                        other_robot: other,
                        reception_state: contact,
                    }),
                ) => {
                    self.metrics.record_reception(robot, other, contact, line.t_ns);
                }
                (_, Some(RecordedChange::References(rewiring))) => {
                    self.metrics.apply_rewiring(rewiring)
                }
                _ => {}
            }
            let t_ns = line.t_ns;
            let event = self.event_line(line);
            self.run_dir.write_event(t_ns, event)?;
        }
        Ok(())
    }
}

/// Kind of the event of a replacement's start.
const RESTART_KIND: &str = "restart";
/// Kind of the events of contact states.
const CONTACT_KIND: &str = "contact";
/// Kind of the events of changed references.
const REPAIR_KIND: &str = "repair";
/// Kind of the events of new goals.
const GOAL_KIND: &str = "goal";
/// Kinds of the events that the metrics derive from the graph.
const ORPHANED_KIND: &str = "orphaned";
const LED_KIND: &str = "led";

/// Returns the rank of events at the same time, in the order of causes: actions, in the order of execution;
/// then their effects.
fn causal_rank(kind: &str) -> usize {
    let follows = [
        "died",
        "restart-ceiling",
        RESTART_KIND,
        "ready",
        CONTACT_KIND,
        REPAIR_KIND,
        ORPHANED_KIND,
        LED_KIND,
    ];
    follows.iter().position(|&other| other == kind).map_or(0, |place| place + 1)
}

impl PendingRecords {
    fn push(&mut self, line: EventRecord) {
        // A robot restarted interactively may be killed again at the same run time.
        let is_same_event = |(_, other): &&(usize, EventRecord)| {
            ![CONTACT_KIND, REPAIR_KIND, ORPHANED_KIND, LED_KIND].contains(&line.kind)
                && ![CONTACT_KIND, REPAIR_KIND, ORPHANED_KIND, LED_KIND].contains(&other.kind)
                && (other.t_ns, other.robot) == (line.t_ns, line.robot)
        };
        let round = match self.records.iter().rev().find(is_same_event) {
            Some((round, other)) => {
                round + usize::from(causal_rank(line.kind) < causal_rank(other.kind))
            }
            None => 0,
        };
        self.records.push((round, line));
    }

    /// Removes and returns the records before this run time, ns, in order.
    fn take_records_before(&mut self, t_ns: u64) -> Vec<EventRecord> {
        // Stable sort: actions at the same time stay in the order of execution.
        self.records.sort_by(|(a_round, a), (b_round, b)| {
            let key = |round: usize, line: &EventRecord| (line.t_ns, round, causal_rank(line.kind));
            let whose = || (a.robot, &a.detail).cmp(&(b.robot, &b.detail));
            key(*a_round, a).cmp(&key(*b_round, b)).then_with(|| match causal_rank(a.kind) {
                0 => std::cmp::Ordering::Equal,
                _ => whose(),
            })
        });
        let known = self.records.partition_point(|(_, line)| line.t_ns < t_ns);
        self.records.drain(..known).map(|(_, line)| line).collect()
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
        let ends = scenario.graph.edges()[0];
        let place = tempfile::tempdir().unwrap();
        let mut run_dir = RunDir::create(&place.path().join("run"), &scenario).unwrap();
        let mut metrics = Metrics::new(&scenario, Pace::Lockstep);
        let names = scenario.robots.iter().map(|robot| robot.name.clone()).collect();
        let mut journal = Journal::new(names, &mut run_dir, &mut metrics);
        // Reports of robots may be newer than the ground truth that was read.
        journal.add_reception_state(3_000_000_000, ends.to, ends.from, ReceptionState::Stale);
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

    fn event_kinds(lines: &[EventRecord]) -> Vec<(u64, &str, usize)> {
        lines.iter().map(|line| (line.t_ns, line.kind, line.robot.unwrap())).collect()
    }

    #[test]
    fn causes_precede_effects_at_equal_times() {
        let mut lines = PendingRecords::default();
        lines.push(event_record(6, CONTACT_KIND, 0));
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
            lines.push(event_record(5, kind, robot));
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
        assert_eq!(event_kinds(&lines.take_records_before(6)), expected);
        assert!(lines.take_records_before(6).is_empty(), "what comes later waits");
        assert_eq!(lines.take_records_before(u64::MAX).len(), 1);
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
            let told = |reports: &[(u64, usize, usize)]| {
                let mut lines = PendingRecords::default();
                for &(t_ns, robot, about) in reports {
                    lines.push(EventRecord { detail: about.to_string(), ..event_record(t_ns, CONTACT_KIND, robot) });
                }
                lines.take_records_before(u64::MAX)
            };
            let expected = told(&reports);
            let mut shuffled: Vec<_> = reports.iter().zip(keys).collect();
            shuffled.sort_by_key(|&(_, key)| key);
            let shuffled: Vec<_> = shuffled.into_iter().map(|(&report, _)| report).collect();
            prop_assert_eq!(told(&shuffled), expected);
        }
    }
}
