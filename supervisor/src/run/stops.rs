//! Processes that are stopped and resumed from outside of the run (`kill -STOP`, Ctrl-Z). The supervisor
//! prints a message and, in real time, where the run continues without them, records a fault. In lockstep
//! all processes wait, and results do not depend on it.

use std::ffi::OsStr;
use std::time::{Duration, Instant};

use experiment::scenario::{FaultKind, Scenario, Struck};

use super::error::RunError;
use super::processes::Processes;
use super::time_mode::TimeMode;
use outcome::metrics::expect::FailedRobot;
use run::course::Course;
use run::journal::Journal;
use run::lifecycle::{Event, Initiator, ProcessState};

/// Polling interval for stopped processes.
const LOOK_EVERY: Duration = Duration::from_millis(100);

/// Time after which a stopped process ends an unattended lockstep run, if the scenario does not set another.
const UNWATCHED_MAX: Duration = Duration::from_secs(60);
/// Environment variable that is set for unattended runs.
const UNATTENDED_VARIABLE: &str = "CI";

/// Processes stopped from outside of the run.
pub(super) struct Stops {
    /// Time after which a stopped process ends a lockstep run; `None` means never.
    limit: Option<Duration>,
    last_poll: Instant,
    plant: Option<Stopped>,
    /// Stop of each robot's process, in scenario order.
    robots: Vec<Option<Stopped>>,
}

/// Stop of a process.
#[derive(Debug, Clone, Copy)]
struct Stopped {
    since: Instant,
    /// Number of the fault that the stop counts as, in real time.
    fault: Option<usize>,
}

impl Stops {
    /// Creates the state without stopped processes.
    pub(super) fn new(scenario: &Scenario) -> Stops {
        let unwatched = std::env::var_os(UNATTENDED_VARIABLE);
        Stops {
            limit: limit(scenario.stopped_after_ns, unwatched.as_deref()),
            last_poll: Instant::now(),
            plant: None,
            robots: vec![None; scenario.robots.len()],
        }
    }

    /// Returns the robots that are stopped, as robots lost without a plan.
    pub(super) fn stopped_robots(&self) -> impl Iterator<Item = FailedRobot> {
        let stopped = self.robots.iter().enumerate().filter(|(_, stopped)| stopped.is_some());
        let cause = "was stopped by another process, and was not resumed";
        stopped.map(move |(robot, _)| FailedRobot { robot, cause: cause.into() })
    }

    /// Checks, if due, which processes were stopped or resumed. Returns the events of those whose stop counts.
    ///
    /// # Errors
    /// A process has been stopped in lockstep for longer than the limit.
    pub(super) fn check(
        &mut self,
        scenario: &Scenario,
        course: &mut Course<Journal<'_>>,
        processes: &mut Processes,
        time_mode: &TimeMode,
    ) -> Result<Vec<Event>, RunError> {
        if self.last_poll.elapsed() < LOOK_EVERY {
            return Ok(Vec::new());
        }
        self.last_poll = Instant::now();
        let goes_on = time_mode.continues_without_stopped();
        let mut events = Vec::new();
        match (self.plant, processes.plant.is_stopped()) {
            (None, true) => events.extend(self.plant_stopped(course, goes_on)),
            (Some(stopped), false) => events.extend(self.plant_resumed(stopped)),
            _ => {}
        }
        processes.children_mut().for_each(|child| child.kill_if_too_large());
        for robot in 0..scenario.robots.len() {
            let stopped = processes.is_stopped(robot);
            match self.robots[robot] {
                None if stopped
                    && takes_stop(course.lifecycles().process_state(robot), goes_on) =>
                {
                    events.extend(self.robot_stopped(robot, scenario, course, goes_on));
                }
                Some(since) if !stopped => events.extend(self.robot_resumed(robot, since, course)),
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
        let Some(limit) = self.limit else { return Ok(()) };
        let long = |stopped: &Option<Stopped>| stopped.is_some_and(|s| s.since.elapsed() > limit);
        let robot = self.robots.iter().position(long);
        let robot = robot.map(|robot| scenario.robots[robot].name.as_str());
        match robot.or(long(&self.plant).then_some("the plant")) {
            Some(who) => Err(RunError::Stopped { who: who.into(), limit }),
            None => Ok(()),
        }
    }

    fn plant_stopped(&mut self, course: &mut Course<Journal<'_>>, goes_on: bool) -> Option<Event> {
        warn_stopped("the plant", "no robot moves until it is resumed (SIGCONT)");
        let who = Initiator::Outside;
        let fault = goes_on.then(|| {
            let what = format!("freeze plant, {}", who.keyword());
            course.journal.metrics.register_fault(what, Struck::default())
        });
        self.plant = Some(Stopped { since: Instant::now(), fault });
        fault.map(|fault| Event::PlantStopped { fault, who })
    }

    fn plant_resumed(&mut self, stopped: Stopped) -> Option<Event> {
        self.plant = None;
        stopped.warn_resumed("the plant");
        stopped.fault.map(|fault| Event::PlantResumed { fault, who: Initiator::Outside })
    }

    fn robot_stopped(
        &mut self,
        robot: usize,
        scenario: &Scenario,
        course: &mut Course<Journal<'_>>,
        goes_on: bool,
    ) -> Option<Event> {
        let what_follows = match goes_on {
            true => "the others continue without it",
            false => "the run waits for it (SIGCONT)",
        };
        warn_stopped(course.journal.name(robot), what_follows);
        let who = Initiator::Outside;
        let fault =
            goes_on.then(|| course.register_fault(scenario, &FaultKind::Freeze { robot }, who));
        self.robots[robot] = Some(Stopped { since: Instant::now(), fault });
        fault.map(|fault| Event::Freeze { robot, fault, ends: false, who })
    }

    /// Returns the event of a stopped robot that was resumed or has died.
    fn robot_resumed(
        &mut self,
        robot: usize,
        stopped: Stopped,
        course: &Course<Journal<'_>>,
    ) -> Option<Event> {
        self.robots[robot] = None;
        let frozen_by = course.lifecycles().frozen_by(robot);
        let fault = stopped.fault.filter(|&fault| frozen_by == Some(fault))?;
        stopped.warn_resumed(course.journal.name(robot));
        Some(Event::Thaw { robot, fault, who: Initiator::Outside })
    }
}

/// Returns whether the stop of a process in this state counts: it should be moving, or the plant waits for it because
/// the run does not go on without it.
fn takes_stop(state: ProcessState, goes_on: bool) -> bool {
    match state {
        ProcessState::Moving => true,
        ProcessState::Starting => !goes_on,
        ProcessState::Frozen | ProcessState::Ending | ProcessState::Down => false,
    }
}

/// Returns the time after which a stopped process ends a lockstep run; `None` means never. `unwatched` is
/// the value of the environment variable.
fn limit(stopped_after_ns: Option<u64>, unwatched: Option<&OsStr>) -> Option<Duration> {
    let unwatched = unwatched.is_some_and(|value| !value.is_empty());
    stopped_after_ns.map(Duration::from_nanos).or(unwatched.then_some(UNWATCHED_MAX))
}

fn warn_stopped(name: &str, what_follows: &str) {
    tracing::warn!("{name} was stopped by another process; {what_follows}");
}

impl Stopped {
    fn warn_resumed(&self, name: &str) {
        let lasted_s = self.since.elapsed().as_secs_f64();
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
            let found = limit(said_s.map(|s: u64| s * 1_000_000_000), unwatched.map(OsStr::new));
            assert_eq!(found, waits_s.map(Duration::from_secs), "{said_s:?} {unwatched:?}");
        }
    }
}
