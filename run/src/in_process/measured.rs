//! Complete run within one process, measured and recorded like a run with processes: the summary is
//! identical byte for byte, except for its section `wall`.
//!
//! Omitted because they have no meaning without processes: logs, briefs, the duration of the start-up, and
//! message latencies.

use agent::control_cycle::ControlCycle;
use agent::controller::Controller;
use experiment::scenario::{FaultKind, Scenario};
use outcome::metrics::{Measures, Metrics, Rewiring};
use outcome::report::scene::Frame;
use outcome::results::latency::Latency;
use outcome::results::outcome::Outcome;
use outcome::results::run_dir::{RunDir, RunDirError};
use outcome::results::scene;
use protocol::brief::{AgentBrief, Pace};
use protocol::message::{Contact, TruthHeader, TruthRow};

use super::{InProcess, NotInProcess, Robot};
use crate::journal::Journal;
use crate::lifecycle::Effect;
use crate::reports::{Report, StatusChange};

/// Returns the reason why a run of this scenario needs processes, or `None`.
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

/// Creates the controller for a brief of a valid scenario.
/// Panics if the brief is invalid.
pub fn controller(brief: &AgentBrief, incarnation: u64) -> Controller {
    Controller::new(brief, incarnation).expect("the brief of a checked scenario")
}

/// Returns the measures of a lockstep run with controllers made by `think`, and records nothing else. Calls
/// `watch` with each ground truth sample and the robots that were alive; returns `None` if `watch` returns
/// `false` before the end.
pub fn measure(
    scenario: &Scenario,
    think: &dyn Fn(&AgentBrief, u64) -> Controller,
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
        metrics.add_truth(&header, &rows, run.alive());
        let goes_on = watch(&header, &rows, run.alive());
        if run.is_over() || metrics.ends_early() {
            return Some(metrics.finish());
        }
        if !goes_on {
            return None;
        }
        run.sense(|effect| match *effect {
            Effect::Began(fault) => metrics.begin_fault(fault, header.t_ns),
            Effect::Ended { fault, end, at_ns } => metrics.end_fault(fault, end, at_ns),
            _ => {}
        });
        let mut rewirings = Vec::new();
        run.step(|robot, cycle| {
            let wish = cycle.law_output();
            if cycle.brief().deputy.is_some() {
                let yes = cycle.status().0.frame == Contact::Lost as u64;
                rewirings.push(Rewiring::Leads { robot, yes });
            }
            if cycle.brief().is_repaired() {
                let (_, senders) = cycle.status();
                rewirings.extend(senders.map(|sender| Rewiring::Uses {
                    robot,
                    other: sender.robot as usize - 1,
                    yes: sender.goes_by == 1,
                }));
            }
            wish
        });
        rewirings.into_iter().for_each(|rewiring| metrics.apply_rewiring(rewiring));
    }
}

/// Complete run in progress: records the status reports of the robots, and the events that affect them.
pub struct Measured<'a, F> {
    run: InProcess<F>,
    journal: Journal<'a>,
    latency: Latency,
    reports: Vec<Report>,
    /// Header of the newest ground truth sample.
    header: TruthHeader,
    rows: Vec<TruthRow>,
}

impl<'a, F: Fn(&AgentBrief, u64) -> Controller> Measured<'a, F> {
    /// Creates the run at the start, before the first ground truth sample. `clock_ns` is the clock for
    /// latency measurements.
    pub fn new(
        scenario: &Scenario,
        think: F,
        run_dir: &'a mut RunDir,
        metrics: &'a mut Metrics,
        clock_ns: fn() -> u64,
    ) -> Result<Measured<'a, F>, NotInProcess> {
        let mut run = InProcess::new(scenario.clone(), think)?;
        run.clock_ns = clock_ns;
        let names = scenario.robots.iter().map(|robot| robot.name.clone()).collect();
        Ok(Measured {
            journal: Journal::new(names, run_dir, metrics),
            latency: Latency::new(scenario, Pace::Lockstep),
            reports: run.agents.iter().map(|_| Report::new(run.agents.len())).collect(),
            header: TruthHeader::default(),
            rows: Vec::new(),
            run,
        })
    }

    /// Returns the run itself.
    pub fn run(&self) -> &InProcess<F> {
        &self.run
    }

    /// Returns the metrics of the run.
    pub fn metrics(&self) -> &Metrics {
        self.journal.metrics
    }

    /// Returns the run directory.
    pub fn run_dir(&mut self) -> &mut RunDir {
        self.journal.run_dir
    }

    /// Returns the newest ground truth sample as a frame for figures.
    pub fn frame(&self) -> Frame {
        let Measured { run, journal, reports, header, rows, .. } = self;
        let orphaned = journal.metrics.orphaned();
        let state = |robot: usize| run.lifecycles.process_state(robot).state(orphaned[robot]);
        let heard = |from: usize, to: usize| reports[to].contact(from);
        let errors_m = journal.metrics.current().errors_m;
        scene::frame(&run.scenario, header, rows, errors_m, state, heard, |_| false)
    }

    /// Records the current ground truth sample. Returns whether it is the last one.
    pub fn truth(&mut self) -> Result<bool, RunDirError> {
        let Measured { run, journal, header, rows, .. } = self;
        *header = run.world().truth_header();
        rows.clear();
        rows.extend(run.world().truth());
        journal.known_before(header.t_ns)?;
        journal.metrics.add_truth(header, rows, run.alive());
        let measured = journal.metrics.current();
        journal.run_dir.write_truth(header, rows, run.alive(), measured)?;
        Ok(run.is_over() || journal.metrics.ends_early())
    }

    /// Advances the run by one period, after a ground truth sample that was not the last one.
    pub fn tick(&mut self) {
        let Measured { run, journal, latency, reports, header, .. } = self;
        latency.set_time(header.t_ns);
        run.sense(|effect| record_effect(journal, reports, effect, header.t_ns));
        run.step(|_, cycle| cycle.law_output());
        for (place, Robot { cycle, member_since, reports: news, .. }) in
            run.robots.iter_mut().enumerate()
        {
            let Some((cycle, _)) = cycle.as_mut().zip(*member_since) else { continue };
            if *news {
                record_report(journal, &mut reports[place], cycle, place);
            }
            if cycle.batch_is_due() {
                record_latencies(latency, cycle, place);
            }
        }
    }

    /// Records the remaining data after the last ground truth sample. Returns the outcome, the journal, and
    /// whether all records could be written.
    pub fn finish(mut self) -> (Outcome, Journal<'a>, Result<(), RunDirError>) {
        for (place, robot) in self.run.robots.iter_mut().enumerate() {
            if let Some(cycle) = &mut robot.cycle {
                record_latencies(&mut self.latency, cycle, place);
            }
        }
        let told = self.journal.known_before(u64::MAX);
        let counts = self.reports.iter().map(Report::counts);
        let outcome = Outcome {
            truth: Some(self.header),
            restarts: (0..self.reports.len()).map(|i| self.run.lifecycles.incarnation(i)).collect(),
            deadline_misses: counts.clone().map(|counts| counts.misses).sum(),
            beacons_refused: counts.clone().map(|counts| counts.refused).collect(),
            sent: counts.map(|counts| counts.sent).collect(),
            latency: self.latency,
            ..Outcome::default()
        };
        (outcome, self.journal, told)
    }
}

/// Records a status report of this robot.
fn record_report(
    journal: &mut Journal<'_>,
    report: &mut Report,
    cycle: &ControlCycle,
    place: usize,
) {
    let (header, neighbors) = cycle.status();
    let neighbors: Vec<_> = neighbors.collect();
    journal.metrics.set_own_target(place, header.t_ns, header.target());
    for news in report.update(&header, &neighbors) {
        match news {
            StatusChange::Heard { other, contact, since_ns } => {
                journal.heard(since_ns, place, other, contact);
            }
            StatusChange::FrameHeard { contact, since_ns } => {
                journal.frame_heard(since_ns, place, contact);
            }
            StatusChange::GoesBy { other, yes, since_ns } => {
                journal.goes_by(since_ns, place, other, yes);
            }
            // In lockstep no goal comes from outside.
            StatusChange::GoesTo { .. } => {}
        }
    }
}

/// Records the new latencies of this robot.
fn record_latencies(latency: &mut Latency, cycle: &mut ControlCycle, place: usize) {
    let measured = cycle.batch();
    let (header, rows) = measured.batch();
    // Index 0 is the plant.
    latency.add_batch(place + 1, &header, rows);
    measured.clear(0);
}

/// Records an effect on a robot at run time `t_ns`.
fn record_effect(journal: &mut Journal<'_>, reports: &mut [Report], effect: &Effect, t_ns: u64) {
    match *effect {
        // Reports that the dead process had not yet sent are lost.
        Effect::Start { robot, .. } => reports[robot].reset(),
        Effect::Note { kind, robot, ref detail } => {
            journal.event(t_ns, kind, Some(robot), detail.clone());
        }
        Effect::Began(fault) => journal.metrics.begin_fault(fault, t_ns),
        Effect::Ended { fault, end, at_ns } => journal.metrics.end_fault(fault, end, at_ns),
        _ => {}
    }
}
