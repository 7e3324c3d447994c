//! Processes that are stopped and resumed from outside of the run (`kill -STOP`, Ctrl-Z). The supervisor
//! prints a message and, in real time, where the run continues without them, records a fault. In lockstep
//! all processes wait, and results do not depend on it.

use std::ffi::OsStr;
use std::time::{Duration, Instant};

use experiment::scenario::{AffectedComponent, FaultKind, Scenario};

use super::error::RunError;
use super::processes::Processes;
use super::time_mode::TimeMode;
use outcome::metrics::expect::FailedRobot;
use run::journal::Journal;
use run::lifecycle::{Initiator, LifecycleEvent, ProcessState};
use run::state_machine::RunStateMachine;

/// Polling interval for stopped processes.
const POLL_INTERVAL: Duration = Duration::from_millis(100);

/// Time after which a stopped process ends an unattended lockstep run, if the scenario does not set another.
const UNATTENDED_STOP_TIMEOUT: Duration = Duration::from_secs(60);
/// Environment variable that is set for unattended runs.
const UNATTENDED_VARIABLE: &str = "CI";

/// Processes stopped from outside of the run.
pub(super) struct ExternalStops {
    /// Time after which a stopped process ends a lockstep run; `None` means never.
    unattended_timeout: Option<Duration>,
    last_poll: Instant,
    /// Stop of the plant, and the run time of the newest ground truth sample then, ns.
    plant_stop: Option<(ProcessStop, u64)>,
    /// Stop of each robot's process, in scenario order.
    robot_stops: Vec<Option<ProcessStop>>,
}

/// Stop of a process.
#[derive(Debug, Clone, Copy)]
struct ProcessStop {
    start_time: Instant,
    /// Number of the fault that the stop counts as, in real time.
    fault_index: Option<usize>,
}

impl ExternalStops {
    /// Creates the state without stopped processes.
    pub(super) fn new(scenario: &Scenario) -> ExternalStops {
        let variable = std::env::var_os(UNATTENDED_VARIABLE);
        ExternalStops {
            unattended_timeout: stop_timeout(scenario.stopped_after_ns, variable.as_deref()),
            last_poll: Instant::now(),
            plant_stop: None,
            robot_stops: vec![None; scenario.robots.len()],
        }
    }

    /// Returns the robots that are stopped, as robots lost without a plan.
    pub(super) fn stopped_robots(&self) -> impl Iterator<Item = FailedRobot> {
        let stops = self.robot_stops.iter().enumerate().filter(|(_, stop)| stop.is_some());
        let cause = "was stopped by another process, and was not resumed";
        stops.map(move |(robot, _)| FailedRobot { robot, cause: cause.into() })
    }

    /// Checks, if due, which processes were stopped or resumed. Returns the events of those whose stop counts. `now_ns`
    /// is the run time of the newest ground truth sample.
    ///
    /// # Errors
    /// A process has been stopped in lockstep for longer than the limit.
    pub(super) fn detect_stops(
        &mut self,
        scenario: &Scenario,
        state_machine: &mut RunStateMachine<Journal<'_>>,
        processes: &mut Processes,
        time_mode: &TimeMode,
        now_ns: u64,
    ) -> Result<Vec<LifecycleEvent>, RunError> {
        if self.last_poll.elapsed() < POLL_INTERVAL {
            return Ok(Vec::new());
        }
        self.last_poll = Instant::now();
        let continues = time_mode.continues_despite_stopped_process();
        let mut events = Vec::new();
        match (self.plant_stop, processes.plant.is_stopped()) {
            (None, true) => events.extend(self.handle_plant_stop(state_machine, continues, now_ns)),
            // In real time the run time of the resumption is that of the next sample.
            (Some((stop, stopped_at_ns)), false) if !continues || now_ns > stopped_at_ns => {
                events.extend(self.handle_plant_resume(stop));
            }
            _ => {}
        }
        processes.children_mut().for_each(|child| child.kill_if_over_memory_limit());
        for robot in 0..scenario.robots.len() {
            let stopped = processes.is_stopped(robot);
            match self.robot_stops[robot] {
                None if stopped
                    && counts_as_stop(
                        state_machine.lifecycles().process_state(robot),
                        continues,
                    ) =>
                {
                    events.extend(self.handle_robot_stop(
                        robot,
                        scenario,
                        state_machine,
                        continues,
                    ));
                }
                Some(stop) if !stopped => {
                    events.extend(self.handle_robot_resume(robot, stop, state_machine))
                }
                _ => {}
            }
        }
        if !continues {
            self.check_limit(scenario)?;
        }
        Ok(events)
    }

    /// Returns an error if a process has been stopped for longer than the limit.
    fn check_limit(&self, scenario: &Scenario) -> Result<(), RunError> {
        let Some(limit) = self.unattended_timeout else { return Ok(()) };
        let is_over_limit =
            |stop: &Option<ProcessStop>| stop.is_some_and(|stop| stop.start_time.elapsed() > limit);
        let robot = self.robot_stops.iter().position(is_over_limit);
        let robot = robot.map(|robot| scenario.robots[robot].name.as_str());
        let plant_stop = self.plant_stop.map(|(stop, _)| stop);
        match robot.or(is_over_limit(&plant_stop).then_some("the plant")) {
            Some(process) => Err(RunError::ProcessStopped { process: process.into(), limit }),
            None => Ok(()),
        }
    }

    fn handle_plant_stop(
        &mut self,
        state_machine: &mut RunStateMachine<Journal<'_>>,
        continues: bool,
        now_ns: u64,
    ) -> Option<LifecycleEvent> {
        warn_stopped("the plant", "no robot moves until it is resumed (SIGCONT)");
        let initiator = Initiator::OtherProcess;
        let fault = continues.then(|| {
            let description = format!("freeze plant, {}", initiator.keyword());
            state_machine.journal.metrics.register_fault(description, AffectedComponent::default())
        });
        let stop = ProcessStop { start_time: Instant::now(), fault_index: fault };
        self.plant_stop = Some((stop, now_ns));
        fault.map(|fault| LifecycleEvent::PlantStopped { fault, initiator })
    }

    fn handle_plant_resume(&mut self, stop: ProcessStop) -> Option<LifecycleEvent> {
        self.plant_stop = None;
        stop.warn_resumed("the plant");
        stop.fault_index
            .map(|fault| LifecycleEvent::PlantResumed { fault, initiator: Initiator::OtherProcess })
    }

    fn handle_robot_stop(
        &mut self,
        robot: usize,
        scenario: &Scenario,
        state_machine: &mut RunStateMachine<Journal<'_>>,
        continues: bool,
    ) -> Option<LifecycleEvent> {
        let consequence = match continues {
            true => "the others continue without it",
            false => "the run waits for it (SIGCONT)",
        };
        warn_stopped(state_machine.journal.robot_name(robot), consequence);
        let initiator = Initiator::OtherProcess;
        let fault = continues.then(|| {
            state_machine.register_fault(scenario, &FaultKind::Freeze { robot }, initiator)
        });
        self.robot_stops[robot] =
            Some(ProcessStop { start_time: Instant::now(), fault_index: fault });
        fault.map(|fault| LifecycleEvent::Freeze {
            robot,
            fault,
            has_planned_thaw: false,
            initiator,
        })
    }

    /// Returns the event of a stopped robot that was resumed or has died.
    fn handle_robot_resume(
        &mut self,
        robot: usize,
        stop: ProcessStop,
        state_machine: &RunStateMachine<Journal<'_>>,
    ) -> Option<LifecycleEvent> {
        self.robot_stops[robot] = None;
        let freezing_fault = state_machine.lifecycles().freezing_fault(robot);
        let fault = stop.fault_index.filter(|&fault| freezing_fault == Some(fault))?;
        stop.warn_resumed(state_machine.journal.robot_name(robot));
        Some(LifecycleEvent::Thaw { robot, fault, initiator: Initiator::OtherProcess })
    }
}

/// Returns whether the stop of a process in this state counts: it should be moving, or the plant waits for it because
/// the run does not continue without it.
fn counts_as_stop(state: ProcessState, continues: bool) -> bool {
    match state {
        ProcessState::Moving => true,
        ProcessState::Starting => !continues,
        ProcessState::Frozen | ProcessState::Exiting | ProcessState::Dead => false,
    }
}

/// Returns the time after which a stopped process ends a lockstep run; `None` means never. `variable` is
/// the value of the environment variable.
fn stop_timeout(stopped_after_ns: Option<u64>, variable: Option<&OsStr>) -> Option<Duration> {
    let is_unattended = variable.is_some_and(|value| !value.is_empty());
    stopped_after_ns.map(Duration::from_nanos).or(is_unattended.then_some(UNATTENDED_STOP_TIMEOUT))
}

fn warn_stopped(name: &str, consequence: &str) {
    tracing::warn!("{name} was stopped by another process; {consequence}");
}

impl ProcessStop {
    fn warn_resumed(&self, name: &str) {
        let duration_s = self.start_time.elapsed().as_secs_f64();
        tracing::warn!("{name} was resumed after {duration_s:.1} s");
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn unattended_run_ends_a_minute_after_a_stop_by_default() {
        for (configured_s, variable, expected_s) in [
            (None, None, None),
            (None, Some(""), None),
            (None, Some("true"), Some(60)),
            (Some(5), Some("true"), Some(5)),
            (Some(90), None, Some(90)),
        ] {
            let found = stop_timeout(
                configured_s.map(|s: u64| s * 1_000_000_000),
                variable.map(OsStr::new),
            );
            assert_eq!(found, expected_s.map(Duration::from_secs), "{configured_s:?} {variable:?}");
        }
    }
}
