//! A whole run within one process, measured and written down as one of processes is: all but the section
//! `wall` of its summary is the same, byte for byte.
//!
//! What has no meaning without processes is left out: logs, briefs, the time that the start-up took, and how
//! long messages were under way.

use std::time::Instant;

use agent::brain::Brain;
use agent::ports::latency_rows_per_tick;
use experiment::scenario::{FaultKind, Scenario};
use outcome::metrics::Metrics;
use outcome::metrics::summary::ProcessUsage;
use outcome::results::latency::Latency;
use outcome::results::outcome::Outcome;
use outcome::results::run_dir::{RunDir, RunDirError};
use outcome::results::usage;
use protocol::brief::{AgentBrief, Pace};
use protocol::clock::now_ns;
use protocol::latency::Recorder;
use protocol::message::TruthRow;
use protocol::stage::Stage;
use supervisor::run::journal::Journal;
use supervisor::run::reports::{News, Report};

use super::{Effect, InProcess};

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
    let think = |brief: &AgentBrief, incarnation| {
        Brain::new(brief, incarnation).expect("the brief of a checked scenario")
    };
    let mut run = InProcess::new(scenario.clone(), think);
    let names = scenario.robots.iter().map(|robot| robot.name.clone()).collect();
    let mut said = Said {
        journal: Journal::new(names, run_dir, metrics),
        latency: Latency::new(scenario, Pace::Lockstep),
        robots: run.agents.iter().map(|brief| Robot::new(brief, run.agents.len())).collect(),
    };
    let (began, mut outcome) = (Instant::now(), Outcome::default());
    let ran = said.tick_until_the_end(&mut run, &mut outcome, &mut goes_on);
    outcome.wall = began.elapsed();
    let robots = 0..scenario.robots.len();
    outcome.restarts = robots.map(|robot| run.lives.incarnation(robot)).collect();
    let usage = usage::of_this_thread().since(&usage_before);
    outcome.usages = vec![ProcessUsage { name: NAME.into(), starts: 1, usage }];
    said.into_outcome(&mut outcome);
    (outcome, ran)
}

/// What the robots say of themselves, and who is told.
struct Said<'a> {
    journal: Journal<'a>,
    latency: Latency,
    robots: Vec<Robot>,
}

/// What one robot said of itself.
struct Robot {
    report: Report,
    /// Beacons refused when it reported last.
    refused: u64,
    recorder: Recorder,
    rows_per_tick: usize,
    /// Stamp of its newest sample, ns.
    newest_ns: u64,
    /// How long it has been at work in this tick, ns.
    busy_ns: u64,
}

impl Robot {
    /// Of one of so many.
    fn new(brief: &AgentBrief, robots: usize) -> Robot {
        let rows_per_tick = latency_rows_per_tick(brief);
        Robot {
            report: Report::new(robots),
            refused: 0,
            recorder: Recorder::for_ticks_of(0, rows_per_tick),
            rows_per_tick,
            newest_ns: 0,
            busy_ns: 0,
        }
    }

    /// A replacement is started. What the dead had not yet told is gone.
    fn begins_anew(&mut self, incarnation: u64) {
        self.report.begins_anew();
        self.refused = 0;
        self.recorder = Recorder::for_ticks_of(incarnation, self.rows_per_tick);
    }

    /// Hands over what it measured so far.
    fn hand_over(&mut self, brain: &mut Brain, to: &mut Latency, place: usize) {
        for (from, sums) in brain.take_ages(self.newest_ns) {
            self.recorder.record_age(from, &sums);
        }
        let (header, rows) = self.recorder.batch();
        // The plant is 0.
        to.take(place + 1, &header, rows);
        self.recorder.clear(self.newest_ns);
    }
}

impl Said<'_> {
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
        for (place, robot) in self.robots.iter_mut().enumerate() {
            if let Some(brain) = &mut run.robots[place].brain {
                robot.hand_over(brain, &mut self.latency, place);
            }
        }
        self.journal.known_before(u64::MAX)
    }

    fn one_tick<F: Fn(&AgentBrief, u64) -> Brain>(&mut self, run: &mut InProcess<F>, t_ns: u64) {
        run.act(|effect| self.told(effect, t_ns));
        run.world.take_due();
        for (i, robot) in self.robots.iter_mut().enumerate() {
            let (sent_ns, mut taken_ns) = (now_ns(), 0);
            if run.sense_one(i, || taken_ns = now_ns()) {
                robot.newest_ns = t_ns;
                robot.busy_ns = now_ns().saturating_sub(taken_ns);
                robot.recorder.record(Stage::Odometry, 0, taken_ns.saturating_sub(sent_ns));
            }
        }
        for i in 0..self.robots.len() {
            let began_ns = now_ns();
            let in_time = run.answer_one(i, Brain::wish);
            let ended_ns = now_ns();
            let Some(brain) = run.robots[i].taking_part() else { continue };
            let robot = &mut self.robots[i];
            if in_time {
                let compute_ns = robot.busy_ns + ended_ns.saturating_sub(began_ns);
                robot.recorder.record(Stage::Compute, 0, compute_ns);
                for (from, age_ns) in brain.ages(t_ns) {
                    robot.recorder.record(Stage::BeaconAge, from, age_ns);
                }
            }
            if brain.take_news() | (brain.beacons_refused() != robot.refused) {
                robot.refused = brain.beacons_refused();
                let (header, rows) = brain.status(0);
                let rows: Vec<_> = rows.collect();
                for news in robot.report.take(&header, &rows) {
                    match news {
                        News::Heard { other, contact, since_ns } => {
                            self.journal.heard(since_ns, i, other, contact);
                        }
                        News::FrameHeard { contact, since_ns } => {
                            self.journal.frame_heard(since_ns, i, contact);
                        }
                        // In lockstep no goal comes from outside.
                        News::GoesTo { .. } => {}
                    }
                }
            }
            if robot.recorder.is_half_full() {
                robot.hand_over(brain, &mut self.latency, i);
            }
        }
        run.pass();
    }

    /// Something happened to a robot at this run time, ns.
    fn told(&mut self, effect: &Effect, t_ns: u64) {
        match *effect {
            Effect::Start { robot, incarnation } => {
                self.robots[robot].begins_anew(incarnation);
            }
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
        outcome.deadline_misses =
            self.robots.iter().map(|robot| robot.report.counts().misses).sum();
        outcome.beacons_refused =
            self.robots.iter().map(|robot| robot.report.counts().refused).collect();
        outcome.latency = self.latency;
    }
}
