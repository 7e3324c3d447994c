//! A whole run within one process, measured and written down as one of processes is: all but the section
//! `wall` of its summary is the same, byte for byte.
//!
//! What has no meaning without processes is left out: logs, briefs, the time that the start-up took, and how
//! long messages were under way.

use std::time::Instant;

use agent::brain::Brain;
use agent::turn::Turn;
use experiment::scenario::{FaultKind, Scenario};
use outcome::metrics::summary::ProcessUsage;
use outcome::metrics::{Measures, Metrics, Rewiring};
use outcome::results::latency::Latency;
use outcome::results::outcome::Outcome;
use outcome::results::run_dir::{RunDir, RunDirError};
use outcome::results::usage;
use protocol::brief::{AgentBrief, Pace};
use protocol::clock::now_ns;
use protocol::message::{Contact, TruthHeader, TruthRow};
use supervisor::run::journal::Journal;
use supervisor::run::reports::{News, Report};

use super::{Effect, InProcess, Robot};

/// How the thread that does a run is called among its processes.
const NAME: &str = "all";

/// Why a run of this scenario needs processes, if it does.
pub fn needs_processes(scenario: &Scenario) -> Option<&'static str> {
    let any =
        |wanted: fn(&FaultKind) -> bool| scenario.faults.iter().any(|fault| wanted(&fault.kind));
    if scenario.programs().next().is_some() {
        Some("programs of the scenario's own")
    } else if any(|kind| matches!(kind, FaultKind::KillPlant)) {
        Some("a fault that kills the plant")
    } else if any(|kind| matches!(kind, FaultKind::Load { .. })) {
        Some("a fault that takes processor time")
    } else {
        None
    }
}

/// Runs a scenario in lockstep to its end, or until `goes_on` says no, which is asked at every tick.
pub fn run(
    scenario: &Scenario,
    run_dir: &mut RunDir,
    metrics: &mut Metrics,
    mut goes_on: impl FnMut() -> bool,
) -> (Outcome, Result<(), RunDirError>) {
    let usage_before = usage::of_this_thread();
    let mut run = InProcess::new(scenario.clone(), brain).expect("it needs no processes");
    run.clock_ns = now_ns;
    let names = scenario.robots.iter().map(|robot| robot.name.clone()).collect();
    let mut listener = Listener {
        journal: Journal::new(names, run_dir, metrics),
        latency: Latency::new(scenario, Pace::Lockstep),
        reports: run.agents.iter().map(|_| Report::new(run.agents.len())).collect(),
    };
    let (began, mut outcome) = (Instant::now(), Outcome::default());
    let ran = listener.tick_until_the_end(&mut run, &mut outcome, &mut goes_on);
    outcome.wall = began.elapsed();
    let robots = 0..scenario.robots.len();
    outcome.restarts = robots.map(|robot| run.lives.incarnation(robot)).collect();
    let usage = usage::of_this_thread().since(&usage_before);
    outcome.usages = vec![ProcessUsage { name: NAME.into(), starts: 1, usage }];
    listener.into_outcome(&mut outcome);
    (outcome, ran)
}

/// The brain of a brief that a checked scenario has.
pub fn brain(brief: &AgentBrief, incarnation: u64) -> Brain {
    Brain::new(brief, incarnation).expect("the brief of a checked scenario")
}

/// What a run in lockstep with brains made by `think` comes to, with nothing taken down but what it is judged by. `watch`
/// sees every truth, and who was alive at it; `None` if it says before the end that the run is not to go on.
pub fn measure(
    scenario: &Scenario,
    think: &dyn Fn(&AgentBrief, u64) -> Brain,
    mut watch: impl FnMut(&TruthHeader, &[TruthRow], &[bool]) -> bool,
) -> Option<Measures> {
    let run = InProcess::new(scenario.clone(), think);
    let mut run = run.unwrap_or_else(|error| panic!("it needs no processes: {error}"));
    let mut metrics = Metrics::new(scenario, Pace::Lockstep);
    let mut rows: Vec<TruthRow> = Vec::new();
    loop {
        let header = run.world().truth_header();
        rows.clear();
        rows.extend(run.world().truth());
        metrics.truth(&header, &rows, run.alive());
        let goes_on = watch(&header, &rows, run.alive());
        if run.is_over() || metrics.ends_early() {
            return Some(metrics.finish());
        }
        if !goes_on {
            return None;
        }
        run.sense(|effect| match *effect {
            Effect::Began(fault) => metrics.fault_began(fault, header.t_ns),
            Effect::Ended { fault, end, at_ns } => metrics.fault_ended(fault, end, at_ns),
            _ => {}
        });
        let mut rewirings = Vec::new();
        run.step(|robot, turn| {
            let wish = turn.wish();
            if turn.brief().deputy.is_some() {
                let yes = turn.status().0.frame == Contact::Lost as u64;
                rewirings.push(Rewiring::Leads { robot, yes });
            }
            if !turn.brief().spares.is_empty() {
                let (_, senders) = turn.status();
                rewirings.extend(senders.map(|sender| Rewiring::GoesBy {
                    robot,
                    other: sender.robot as usize - 1,
                    yes: sender.goes_by == 1,
                }));
            }
            wish
        });
        rewirings.into_iter().for_each(|rewiring| metrics.rewired(rewiring));
    }
}

/// Takes down what the robots report of themselves, and what happens to them.
struct Listener<'a> {
    journal: Journal<'a>,
    latency: Latency,
    reports: Vec<Report>,
}

impl Listener<'_> {
    fn tick_until_the_end<F: Fn(&AgentBrief, u64) -> Brain>(
        &mut self,
        run: &mut InProcess<F>,
        outcome: &mut Outcome,
        goes_on: &mut impl FnMut() -> bool,
    ) -> Result<(), RunDirError> {
        let mut rows: Vec<TruthRow> = Vec::new();
        loop {
            let header = run.world().truth_header();
            rows.clear();
            rows.extend(run.world().truth());
            self.journal.known_before(header.t_ns)?;
            self.journal.metrics.truth(&header, &rows, run.alive());
            let measured = self.journal.metrics.now();
            self.journal.run_dir.truth(&header, &rows, run.alive(), measured)?;
            outcome.truth = Some(header);
            if run.is_over() || self.journal.metrics.ends_early() {
                break;
            }
            if !goes_on() {
                outcome.interrupted = true;
                break;
            }
            self.latency.now(header.t_ns);
            self.one_tick(run, header.t_ns);
        }
        for (place, robot) in run.robots.iter_mut().enumerate() {
            if let Some(turn) = &mut robot.turn {
                self.take_batch(turn, place);
            }
        }
        self.journal.known_before(u64::MAX)
    }

    fn one_tick<F: Fn(&AgentBrief, u64) -> Brain>(&mut self, run: &mut InProcess<F>, t_ns: u64) {
        run.sense(|effect| self.happened(effect, t_ns));
        run.step(|_, turn| turn.wish());
        for (place, Robot { turn, member_since, reports, .. }) in run.robots.iter_mut().enumerate()
        {
            let Some((turn, _)) = turn.as_mut().zip(*member_since) else { continue };
            if *reports {
                self.take_report(turn, place);
            }
            if turn.batch_is_due() {
                self.take_batch(turn, place);
            }
        }
    }

    /// Takes down how this robot says that it goes.
    fn take_report(&mut self, turn: &Turn, place: usize) {
        let (header, neighbors) = turn.status();
        let neighbors: Vec<_> = neighbors.collect();
        for news in self.reports[place].take(&header, &neighbors) {
            match news {
                News::Heard { other, contact, since_ns } => {
                    self.journal.heard(since_ns, place, other, contact);
                }
                News::FrameHeard { contact, since_ns } => {
                    self.journal.frame_heard(since_ns, place, contact);
                }
                News::GoesBy { other, yes, since_ns } => {
                    self.journal.goes_by(since_ns, place, other, yes);
                }
                // In lockstep no goal comes from outside.
                News::GoesTo { .. } => {}
            }
        }
    }

    /// Takes down what this robot measured so far.
    fn take_batch(&mut self, turn: &mut Turn, place: usize) {
        let measured = turn.batch();
        let (header, rows) = measured.batch();
        // The plant is 0.
        self.latency.take(place + 1, &header, rows);
        measured.clear(0);
    }

    /// Something happened to a robot at this run time, ns.
    fn happened(&mut self, effect: &Effect, t_ns: u64) {
        match *effect {
            // What the dead had not yet reported is gone.
            Effect::Start { robot, .. } => self.reports[robot].begins_anew(),
            Effect::Note { kind, robot, ref detail } => {
                self.journal.event(t_ns, kind, Some(robot), detail.clone());
            }
            Effect::Began(fault) => self.journal.metrics.fault_began(fault, t_ns),
            Effect::Ended { fault, end, at_ns } => {
                self.journal.metrics.fault_ended(fault, end, at_ns);
            }
            _ => {}
        }
    }

    fn into_outcome(self, outcome: &mut Outcome) {
        let counts = self.reports.iter().map(Report::counts);
        outcome.deadline_misses = counts.clone().map(|counts| counts.misses).sum();
        outcome.beacons_refused = counts.map(|counts| counts.refused).collect();
        outcome.latency = self.latency;
    }
}
