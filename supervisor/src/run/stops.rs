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
use run::course::RunStateMachine;
use run::journal::Journal;
use run::lifecycle::{Initiator, LifecycleEvent, ProcessState};

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
    plant_stop: Option<ProcessStop>,
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
        let unwatched = std::env::var_os(UNATTENDED_VARIABLE);
        ExternalStops {
            unattended_timeout: stop_timeout(scenario.stopped_after_ns, unwatched.as_deref()),
            last_poll: Instant::now(),
            plant_stop: None,
            robot_stops: vec![None; scenario.robots.len()],
        }
    }

    /// Returns the robots that are stopped, as robots lost without a plan.
    pub(super) fn stopped_robots(&self) -> impl Iterator<Item = FailedRobot> {
        let stopped = self.robot_stops.iter().enumerate().filter(|(_, stopped)| stopped.is_some());
        let cause = "was stopped by another process, and was not resumed";
        stopped.map(move |(robot, _)| FailedRobot { robot, cause: cause.into() })
    }

    /// Checks, if due, which processes were stopped or resumed. Returns the events of those whose stop counts.
    ///
    /// # Errors
    /// A process has been stopped in lockstep for longer than the limit.
    pub(super) fn detect_stops(
        &mut self,
        scenario: &Scenario,
        course: &mut RunStateMachine<Journal<'_>>,
        processes: &mut Processes,
        time_mode: &TimeMode,
    ) -> Result<Vec<LifecycleEvent>, RunError> {
        if self.last_poll.elapsed() < POLL_INTERVAL {
            return Ok(Vec::new());
        }
        self.last_poll = Instant::now();
        let goes_on = time_mode.continues_despite_stopped_process();
        let mut events = Vec::new();
        match (self.plant_stop, processes.plant.is_stopped()) {
            (None, true) => events.extend(self.handle_plant_stop(course, goes_on)),
            (Some(stopped), false) => events.extend(self.handle_plant_resume(stopped)),
            _ => {}
        }
        processes.children_mut().for_each(|child| child.kill_if_over_memory_limit());
        for robot in 0..scenario.robots.len() {
            let stopped = processes.is_stopped(robot);
            match self.robot_stops[robot] {
                None if stopped
                    && counts_as_stop(course.lifecycles().process_state(robot), goes_on) =>
                {
                    events.extend(self.handle_robot_stop(robot, scenario, course, goes_on));
                }
                Some(since) if !stopped => {
                    events.extend(self.handle_robot_resume(robot, since, course))
                }
                _ => {}
            }
        }
        if !goes_on {
            self.check_limit(scenario)?;
        }
        Ok(events)
    }

    /// Returns an error if a process has been stopped for longer than the limit.
    fn check_limit(&self, scenario: &Scenario) -> Result<(), RunError> {
        let Some(limit) = self.unattended_timeout else { return Ok(()) };
        let long =
            |stopped: &Option<ProcessStop>| stopped.is_some_and(|s| s.start_time.elapsed() > limit);
        let robot = self.robot_stops.iter().position(long);
        let robot = robot.map(|robot| scenario.robots[robot].name.as_str());
        match robot.or(long(&self.plant_stop).then_some("the plant")) {
            Some(process) => Err(RunError::ProcessStopped { process: process.into(), limit }),
            None => Ok(()),
        }
    }

    fn handle_plant_stop(
        &mut self,
        course: &mut RunStateMachine<Journal<'_>>,
        goes_on: bool,
    ) -> Option<LifecycleEvent> {
        warn_stopped("the plant", "no robot moves until it is resumed (SIGCONT)");
        let initiator = Initiator::OtherProcess;
        let fault = goes_on.then(|| {
            let what = format!("freeze plant, {}", initiator.keyword());
            course.journal.metrics.register_fault(what, AffectedComponent::default())
        });
        self.plant_stop = Some(ProcessStop { start_time: Instant::now(), fault_index: fault });
        fault.map(|fault| LifecycleEvent::PlantStopped { fault, initiator })
    }

    fn handle_plant_resume(&mut self, stopped: ProcessStop) -> Option<LifecycleEvent> {
        self.plant_stop = None;
        stopped.warn_resumed("the plant");
        stopped
            .fault_index
            .map(|fault| LifecycleEvent::PlantResumed { fault, initiator: Initiator::OtherProcess })
    }

    fn handle_robot_stop(
        &mut self,
        robot: usize,
        scenario: &Scenario,
        course: &mut RunStateMachine<Journal<'_>>,
        goes_on: bool,
    ) -> Option<LifecycleEvent> {
        let what_follows = match goes_on {
            true => "the others continue without it",
            false => "the run waits for it (SIGCONT)",
        };
        warn_stopped(course.journal.robot_name(robot), what_follows);
        let initiator = Initiator::OtherProcess;
        let fault = goes_on
            .then(|| course.register_fault(scenario, &FaultKind::Freeze { robot }, initiator));
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
        stopped: ProcessStop,
        course: &RunStateMachine<Journal<'_>>,
    ) -> Option<LifecycleEvent> {
        self.robot_stops[robot] = None;
        let frozen_by = course.lifecycles().freezing_fault(robot);
        let fault = stopped.fault_index.filter(|&fault| frozen_by == Some(fault))?;
        stopped.warn_resumed(course.journal.robot_name(robot));
        Some(LifecycleEvent::Thaw { robot, fault, initiator: Initiator::OtherProcess })
    }
}

/// Returns whether the stop of a process in this state counts: it should be moving, or the plant waits for it because
/// the run does not go on without it.
fn counts_as_stop(state: ProcessState, goes_on: bool) -> bool {
    match state {
        ProcessState::Moving => true,
        ProcessState::Starting => !goes_on,
        ProcessState::Frozen | ProcessState::Exiting | ProcessState::Dead => false,
    }
}

/// Returns the time after which a stopped process ends a lockstep run; `None` means never. `unwatched` is
/// the value of the environment variable.
fn stop_timeout(stopped_after_ns: Option<u64>, unwatched: Option<&OsStr>) -> Option<Duration> {
    let unwatched = unwatched.is_some_and(|value| !value.is_empty());
    stopped_after_ns.map(Duration::from_nanos).or(unwatched.then_some(UNATTENDED_STOP_TIMEOUT))
}

fn warn_stopped(name: &str, what_follows: &str) {
    tracing::warn!("{name} was stopped by another process; {what_follows}");
}

impl ProcessStop {
    fn warn_resumed(&self, name: &str) {
        let lasted_s = self.start_time.elapsed().as_secs_f64();
        tracing::warn!("{name} was resumed after {lasted_s:.1} s");
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn unattended_run_ends_a_minute_after_a_stop_by_default() {
        for (said_s, unwatched, waits_s) in [
            (None, None, None),
            (None, Some(""), None),
            (None, Some("true"), Some(60)),
            (Some(5), Some("true"), Some(5)),
            (Some(90), None, Some(90)),
        ] {
            let found =
                stop_timeout(said_s.map(|s: u64| s * 1_000_000_000), unwatched.map(OsStr::new));
            assert_eq!(found, waits_s.map(Duration::from_secs), "{said_s:?} {unwatched:?}");
        }
    }
}
