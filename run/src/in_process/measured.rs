//! Complete run within one process, measured and recorded like a run with processes: the summary is
//! identical byte for byte, except for its section `wall`.
//!
//! Omitted because they have no meaning without processes: logs, briefs, the duration of the start-up, and
//! message latencies.

use agent::control_cycle::ControlCycle;
use agent::controller::Controller;
use experiment::scenario::{FaultKind, Scenario};
use outcome::metrics::{Metrics, ReferenceChange, RunMetrics};
use outcome::report::scene::SceneFrame;
use outcome::results::latency::LatencyCollector;
use outcome::results::outcome::RunOutcome;
use outcome::results::run_dir::{RunDir, RunDirError};
use protocol::brief::{AgentBrief, Pace};
use protocol::message::{ReceptionState, TruthHeader, TruthRow};

use super::{ControllerFactory, InProcessError, InProcessRun};
use crate::journal::Journal;

/// Returns the reason why a run of this scenario needs processes, or `None`.
pub fn reason_for_processes(scenario: &Scenario) -> Option<&'static str> {
    let has_fault = |predicate: fn(&FaultKind) -> bool| {
        scenario.faults.iter().any(|fault| predicate(&fault.kind))
    };
    if scenario.process_programs().next().is_some() {
        Some("programs of the scenario's own")
    } else if has_fault(|kind| matches!(kind, FaultKind::KillPlant)) {
        Some("a fault that kills the plant")
    } else if has_fault(|kind| matches!(kind, FaultKind::Load { .. })) {
        Some("a fault that takes processor time")
    } else {
        None
    }
}

/// Creates the controller for a brief of a valid scenario.
/// Panics if the brief is invalid.
pub fn create_controller(brief: &AgentBrief, incarnation: u64) -> Controller {
    Controller::new(brief, incarnation).expect("the brief of a checked scenario")
}

/// Receives each ground truth sample, and for each robot whether it was alive. Returns whether the run continues.
pub type TruthWatch<'a> = dyn FnMut(&TruthHeader, &[TruthRow], &[bool]) -> bool + 'a;

/// Returns the measures of a lockstep run with controllers made by `create_controller`, and records nothing else.
/// Calls `watch` with each ground truth sample and the robots that were alive; returns `None` if `watch` returns
/// `false` before the end.
pub fn measure_run(
    scenario: &Scenario,
    create_controller: ControllerFactory,
    watch: &mut TruthWatch<'_>,
) -> Option<RunMetrics> {
    let metrics = Metrics::new(scenario, Pace::Lockstep).without_pair_distances();
    let run = InProcessRun::with_journal(scenario.clone(), create_controller, metrics);
    let mut run = run.unwrap_or_else(|error| panic!("it needs no processes: {error}"));
    let may_lead: Vec<bool> = run.agent_briefs.iter().map(|brief| brief.deputy.is_some()).collect();
    let mut rows: Vec<TruthRow> = Vec::new();
    loop {
        let header = run.world().truth_header();
        rows.clear();
        rows.extend(run.world().truth());
        run.state_machine.measure_truth(&header, &rows);
        let continues = watch(&header, &rows, run.alive_robots());
        let metrics = &run.state_machine.journal;
        if run.is_over() || metrics.ends_early() {
            return Some(metrics.finish());
        }
        if !continues {
            return None;
        }
        let mut reference_changes = Vec::new();
        run.advance(|robot, cycle| {
            let law_output = cycle.law_output();
            if may_lead[robot] {
                let is_leading = cycle.status().0.frame == ReceptionState::Lost as u64;
                reference_changes.push(ReferenceChange::DeputyLead { robot, is_leading });
            }
            if cycle.controller().neighborhood().has_repair_plan() {
                let (_, senders) = cycle.status();
                reference_changes.extend(senders.map(|sender| ReferenceChange::ReferenceUse {
                    robot,
                    neighbor: sender.robot as usize - 1,
                    is_used: sender.goes_by == 1,
                }));
            }
            law_output
        });
        let InProcessRun { robots, previous_outboxes, state_machine, .. } = &mut run;
        for (index, (robot, outbox)) in robots.iter_mut().zip(previous_outboxes).enumerate() {
            if outbox.status_is_due
                && let Some((cycle, _)) = robot.participating_cycle()
            {
                state_machine.measure_status(index, &cycle.status().0);
            }
        }
        let metrics = &mut state_machine.journal;
        reference_changes
            .into_iter()
            .for_each(|reference_change| metrics.apply_rewiring(reference_change));
    }
}

/// Complete run in progress: records the status reports of the robots, and the events that affect them.
pub struct MeasuredRun<'a> {
    run: InProcessRun<Journal<'a>>,
    latency: LatencyCollector,
    /// Header of the newest ground truth sample.
    header: TruthHeader,
    truth_rows: Vec<TruthRow>,
}

impl<'a> MeasuredRun<'a> {
    /// Creates the run at the start, before the first ground truth sample. `clock_ns` is the clock for
    /// latency measurements.
    pub fn new(
        scenario: &Scenario,
        create_controller: ControllerFactory,
        run_dir: &'a mut RunDir,
        metrics: &'a mut Metrics,
        clock_ns: fn() -> u64,
    ) -> Result<MeasuredRun<'a>, InProcessError> {
        let names = scenario.robots.iter().map(|robot| robot.name.clone()).collect();
        let journal = Journal::new(names, run_dir, metrics);
        let mut run = InProcessRun::with_journal(scenario.clone(), create_controller, journal)?;
        run.clock_ns = clock_ns;
        Ok(MeasuredRun {
            latency: LatencyCollector::new(scenario, Pace::Lockstep),
            header: TruthHeader::default(),
            truth_rows: Vec::new(),
            run,
        })
    }

    /// Returns the run itself.
    pub fn run(&self) -> &InProcessRun<Journal<'a>> {
        &self.run
    }

    /// Returns the metrics of the run.
    pub fn metrics(&self) -> &Metrics {
        self.run.state_machine.journal.metrics
    }

    /// Returns the run directory.
    pub fn run_dir(&mut self) -> &mut RunDir {
        self.run.state_machine.journal.run_dir
    }

    /// Returns the newest ground truth sample as a frame for figures.
    pub fn scene_frame(&self) -> SceneFrame {
        let MeasuredRun { run, header, truth_rows, .. } = self;
        run.state_machine.scene_frame(&run.scenario, header, truth_rows)
    }

    /// Records the current ground truth sample. Returns whether it is the last one.
    pub fn record_truth_sample(&mut self) -> Result<bool, RunDirError> {
        let MeasuredRun { run, header, truth_rows, .. } = self;
        *header = run.world().truth_header();
        truth_rows.clear();
        truth_rows.extend(run.world().truth());
        run.state_machine.journal.write_events_before(header.t_ns)?;
        run.state_machine.record_truth(header, truth_rows)?;
        Ok(run.is_over() || run.state_machine.journal.metrics.ends_early())
    }

    /// Advances the run by one period, after a ground truth sample that was not the last one.
    pub fn advance_tick(&mut self) {
        let MeasuredRun { run, latency, header, .. } = self;
        latency.set_time(header.t_ns);
        run.advance(|_, cycle| cycle.law_output());
        let InProcessRun { robots, previous_outboxes, state_machine, .. } = run;
        for (index, (robot, outbox)) in robots.iter_mut().zip(previous_outboxes).enumerate() {
            let Some((cycle, _)) = robot.participating_cycle() else { continue };
            if outbox.status_is_due {
                let (header, neighbors) = cycle.status();
                let neighbors: Vec<_> = neighbors.collect();
                let message = &outbox.recorded_message;
                state_machine.record_status(index, &header, &neighbors, message);
            }
            if cycle.batch_is_due() {
                record_latencies(latency, cycle, index);
            }
        }
    }

    /// Records the remaining data after the last ground truth sample. Returns the outcome, the journal, and
    /// whether all records could be written.
    pub fn finish(mut self) -> (RunOutcome, Journal<'a>, Result<(), RunDirError>) {
        for (index, robot) in self.run.robots.iter_mut().enumerate() {
            if let Some(cycle) = &mut robot.cycle {
                record_latencies(&mut self.latency, cycle, index);
                self.run.state_machine.record_sent_counts(index, cycle.sent_counts());
            }
        }
        let mut state_machine = self.run.state_machine;
        let write_result = state_machine.journal.write_events_before(u64::MAX);
        let (newest_truth, latency) = (Some(self.header), self.latency);
        let outcome = RunOutcome { newest_truth, latency, ..state_machine.outcome() };
        (outcome, state_machine.journal, write_result)
    }
}

/// Records the new latencies of this robot.
fn record_latencies(latency: &mut LatencyCollector, cycle: &mut ControlCycle, index: usize) {
    let measurements = cycle.measurement_batch();
    let (header, rows) = measurements.batch();
    // Index 0 is the plant.
    latency.add_batch(index + 1, &header, rows);
    measurements.begin_next_batch(0);
}
