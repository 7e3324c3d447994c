//! What is told of a run while it goes on: events in order of time, to the run directory, to the
//! metrics and to whoever looks on.
//!
//! In which order reports arrive is the machine's doing. So a line waits here until everything up
//! to its time is known, and is written in an order that only the run decides.

use std::collections::BTreeSet;

#[cfg(feature = "processes")]
use crate::view::View;
use protocol::message::Contact;

#[cfg(feature = "processes")]
use crate::live;
use outcome::metrics::{Metrics, OrphanChange, Rewiring};
use outcome::results::goals;
use outcome::results::run_dir::{RunDir, RunDirError};

/// What is told, and whom.
pub struct Journal<'a> {
    names: Vec<String>,
    /// Where the run is written.
    pub run_dir: &'a mut RunDir,
    /// What measures the run.
    pub metrics: &'a mut Metrics,
    /// Whoever looks on.
    #[cfg(feature = "processes")]
    pub(crate) view: Option<&'a mut View>,
    /// The deputies that lead.
    leading: BTreeSet<usize>,
    waiting: Lines,
}

/// One event.
#[derive(Debug, Clone, PartialEq)]
struct Line {
    /// Run time, ns.
    t_ns: u64,
    kind: &'static str,
    /// By place; `None` for the run as a whole.
    robot: Option<usize>,
    detail: String,
    change: Option<Change>,
}

/// What the metrics are to know of it, once all before it is known.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Change {
    /// How the robot hears another.
    Heard { other: usize, contact: Contact },
    /// By whom robots go.
    Rewired(Rewiring),
}

/// Lines that wait.
#[derive(Debug, Default)]
struct Lines {
    /// Each with how often before its robot began anew at the same time.
    list: Vec<(usize, Line)>,
}

impl<'a> Journal<'a> {
    /// Nothing was told yet. `names`: of the robots, in scenario order.
    pub fn new(
        names: Vec<String>,
        run_dir: &'a mut RunDir,
        metrics: &'a mut Metrics,
    ) -> Journal<'a> {
        Journal {
            names,
            run_dir,
            metrics,
            #[cfg(feature = "processes")]
            view: None,
            waiting: Lines::default(),
            leading: BTreeSet::new(),
        }
    }

    /// Lets somebody look on, and act by hand.
    #[cfg(feature = "processes")]
    pub fn shown_to(self, view: Option<&'a mut View>) -> Journal<'a> {
        Journal { view, ..self }
    }

    /// The name of a robot.
    pub fn name(&self, robot: usize) -> &str {
        &self.names[robot]
    }

    /// Something happened, to a robot or to the run as a whole. Whoever looks on is told at once.
    pub fn event(&mut self, t_ns: u64, kind: &'static str, robot: Option<usize>, detail: String) {
        // A replacement goes by its in-neighbours.
        let anew = robot.filter(|_| kind == RESTART).map(|robot| Rewiring::Restarted { robot });
        robot.filter(|_| anew.is_some()).inspect(|robot| _ = self.leading.remove(robot));
        anew.into_iter().for_each(|anew| self.metrics.announce_rewiring(t_ns, anew));
        self.line(Line { t_ns, kind, robot, detail, change: anew.map(Change::Rewired) });
    }

    /// A robot says that it hears another so, since then.
    pub fn heard(&mut self, t_ns: u64, robot: usize, other: usize, contact: Contact) {
        let detail = format!("{} {}", contact.word(), self.names[other]);
        let change = Some(Change::Heard { other, contact });
        self.line(Line { t_ns, kind: CONTACT, robot: Some(robot), detail, change });
    }

    /// A robot says that it hears the leader's frame so, since then.
    pub fn frame_heard(&mut self, t_ns: u64, robot: usize, contact: Contact) {
        let detail = format!("{} frame of the leader", contact.word());
        self.event(t_ns, CONTACT, Some(robot), detail);
        let leads = self.metrics.is_deputy(robot) && contact == Contact::Lost;
        if leads != self.leading.contains(&robot) {
            match leads {
                true => _ = self.leading.insert(robot),
                false => _ = self.leading.remove(&robot),
            }
            let detail = if leads { "leads" } else { "leads no longer" }.to_owned();
            self.repaired(t_ns, robot, Rewiring::Leads { robot, yes: leads }, detail);
        }
    }

    /// A robot says that it goes by another, or no longer does, since then.
    pub fn goes_by(&mut self, t_ns: u64, robot: usize, other: usize, yes: bool) {
        let does = if yes { "goes by" } else { "goes no longer by" };
        let detail = format!("{does} {}", self.names[other]);
        self.repaired(t_ns, robot, Rewiring::Uses { robot, other, yes }, detail);
    }

    fn repaired(&mut self, t_ns: u64, robot: usize, rewiring: Rewiring, detail: String) {
        self.metrics.announce_rewiring(t_ns, rewiring);
        let change = Some(Change::Rewired(rewiring));
        self.line(Line { t_ns, kind: REPAIR, robot: Some(robot), detail, change });
    }

    /// A robot says that it goes to this place, m, since then, and whose goal that is. Errors are measured
    /// from there as soon as it is known.
    pub fn goes_to(&mut self, t_ns: u64, robot: usize, goal_m: [f64; 2], whose: &str) {
        self.metrics.set_goal(robot, goal_m.into());
        let detail = goals::format_event_detail(goal_m, whose);
        self.event(t_ns, goals::EVENT, Some(robot), detail);
    }

    fn line(&mut self, line: Line) {
        #[cfg(feature = "processes")]
        if let Some(view) = &mut self.view {
            let name = line.robot.map_or("", |robot| &self.names[robot]);
            view.happened(live::happened(line.t_ns, line.kind, name, &line.detail));
        }
        self.waiting.push(line);
    }

    /// Everything before this run time, ns, is known: writes it down.
    pub fn known_before(&mut self, t_ns: u64) -> Result<(), RunDirError> {
        for OrphanChange { t_ns, robot, orphaned } in self.metrics.take_orphan_changes_before(t_ns)
        {
            let (kind, detail) = match orphaned {
                true => (ORPHANED, "no living leader reaches it"),
                false => (LED, "a leader reaches it again"),
            };
            self.event(t_ns, kind, Some(robot), detail.to_owned());
        }
        if self.waiting.list.is_empty() {
            return Ok(());
        }
        for line in self.waiting.take_before(t_ns) {
            match (line.robot, line.change) {
                (Some(robot), Some(Change::Heard { other, contact })) => {
                    self.metrics.record_contact(robot, other, contact, line.t_ns);
                }
                (_, Some(Change::Rewired(rewiring))) => self.metrics.apply_rewiring(rewiring),
                _ => {}
            }
            let name = line.robot.map_or("", |robot| &self.names[robot]);
            self.run_dir.write_event(line.t_ns, line.kind, name, &line.detail)?;
        }
        Ok(())
    }
}

/// The kind of a replacement's start.
const RESTART: &str = "restart";
/// The kind of what robots say of those they hear.
const CONTACT: &str = "contact";
/// The kind of what robots say of those they go by.
const REPAIR: &str = "repair";
/// The kinds of what the metrics say of the graph.
const ORPHANED: &str = "orphaned";
const LED: &str = "led";

/// What may happen at the same time, in the order of causes: acts, in the order in which they were
/// done; then what follows from them.
fn rank(kind: &str) -> usize {
    let follows = ["died", "restart-ceiling", RESTART, "ready", CONTACT, REPAIR, ORPHANED, LED];
    follows.iter().position(|&other| other == kind).map_or(0, |place| place + 1)
}

impl Lines {
    fn push(&mut self, line: Line) {
        // Whoever was brought back by hand may be killed again before time goes on.
        let of_robot = |(_, other): &&(usize, Line)| {
            ![CONTACT, REPAIR, ORPHANED, LED].contains(&line.kind)
                && ![CONTACT, REPAIR, ORPHANED, LED].contains(&other.kind)
                && (other.t_ns, other.robot) == (line.t_ns, line.robot)
        };
        let round = match self.list.iter().rev().find(of_robot) {
            Some((round, other)) => round + usize::from(rank(line.kind) < rank(other.kind)),
            None => 0,
        };
        self.list.push((round, line));
    }

    /// Those before this run time, ns, in order.
    fn take_before(&mut self, t_ns: u64) -> Vec<Line> {
        // Stable: acts of one time stay in the order in which they were done.
        self.list.sort_by(|(a_round, a), (b_round, b)| {
            let key = |round: usize, line: &Line| (line.t_ns, round, rank(line.kind));
            let whose = || (a.robot, &a.detail).cmp(&(b.robot, &b.detail));
            key(*a_round, a).cmp(&key(*b_round, b)).then_with(|| match rank(a.kind) {
                0 => std::cmp::Ordering::Equal,
                _ => whose(),
            })
        });
        let known = self.list.partition_point(|(_, line)| line.t_ns < t_ns);
        self.list.drain(..known).map(|(_, line)| line).collect()
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
    fn a_link_that_is_called_stale_before_the_truth_of_its_cut_was_taken_counts_all_the_same() {
        let mut scenario = row_of_three();
        let kind = FaultKind::Link { edge: 0, kind: LinkFaultKind::Cut };
        scenario.faults = vec![Fault { at_ns: 2_000_000_000, for_ns: None, kind }];
        let ends = scenario.graph.edges()[0];
        let place = tempfile::tempdir().unwrap();
        let mut run_dir = RunDir::create(&place.path().join("run"), &scenario).unwrap();
        let mut metrics = Metrics::new(&scenario, Pace::Lockstep);
        let names = scenario.robots.iter().map(|robot| robot.name.clone()).collect();
        let mut journal = Journal::new(names, &mut run_dir, &mut metrics);
        // The robots are ahead of what the supervisor has taken in.
        journal.heard(3_000_000_000, ends.to, ends.from, Contact::Stale);
        for tick in 0..5 {
            journal.known_before(header(tick).t_ns).unwrap();
            journal.metrics.add_truth(&header(tick), &rows([0.0, 1.0, 2.0]), &[true; 3]);
        }
        let [fault] = &metrics.finish().faults[..] else { panic!("one fault") };
        assert_eq!(fault.stale_after_s, Some(1.0));
    }

    fn line(t_ns: u64, kind: &'static str, robot: usize) -> Line {
        Line { t_ns, kind, robot: Some(robot), detail: String::new(), change: None }
    }

    fn kinds(lines: &[Line]) -> Vec<(u64, &str, usize)> {
        lines.iter().map(|line| (line.t_ns, line.kind, line.robot.unwrap())).collect()
    }

    #[test]
    fn of_one_time_causes_stand_before_effects_and_whoever_dies_twice_is_dead_at_the_end() {
        let mut lines = Lines::default();
        lines.push(line(6, CONTACT, 0));
        // As they may come: who dies and is ready first is the machine's doing.
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
            lines.push(line(5, kind, robot));
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
        assert_eq!(kinds(&lines.take_before(6)), expected);
        assert!(lines.take_before(6).is_empty(), "what comes later waits");
        assert_eq!(lines.take_before(u64::MAX).len(), 1);
    }

    proptest! {
        /// What robots report arrives in any order, in bursts of any size.
        #[test]
        fn the_order_does_not_depend_on_when_what_was_reported(
            mut reports in proptest::collection::vec((0..8u64, 0..4usize, 0..3usize), 0..40),
            keys in proptest::collection::vec(any::<u32>(), 40),
        ) {
            reports.sort_unstable();
            reports.dedup();
            let told = |reports: &[(u64, usize, usize)]| {
                let mut lines = Lines::default();
                for &(t_ns, robot, about) in reports {
                    lines.push(Line { detail: about.to_string(), ..line(t_ns, CONTACT, robot) });
                }
                lines.take_before(u64::MAX)
            };
            let expected = told(&reports);
            let mut shuffled: Vec<_> = reports.iter().zip(keys).collect();
            shuffled.sort_by_key(|&(_, key)| key);
            let shuffled: Vec<_> = shuffled.into_iter().map(|(&report, _)| report).collect();
            prop_assert_eq!(told(&shuffled), expected);
        }
    }
}
