//! Processes that are stopped and resumed from outside of the run (`kill -STOP`, Ctrl-Z). The supervisor
//! prints a message and, in real time, where the run continues without them, records a fault. In lockstep
//! all processes wait, and results do not depend on it.

use std::ffi::OsStr;
use std::time::{Duration, Instant};

use experiment::scenario::{FaultKind, Scenario, Struck};

use super::Run;
use super::error::RunError;
use outcome::metrics::expect::FailedRobot;
use run::lifecycle::{Event, Initiator, ProcessState};

/// Polling interval for stopped processes.
const LOOK_EVERY: Duration = Duration::from_millis(100);

/// Time after which a stopped process ends an unattended lockstep run, if the scenario does not set another.
const UNWATCHED_MAX: Duration = Duration::from_secs(60);
/// Environment variable that is set for unattended runs.
const UNWATCHED: &str = "CI";

/// Processes stopped from outside of the run.
pub(super) struct Stops {
    /// Time after which a stopped process ends a lockstep run; `None` means never.
    limit: Option<Duration>,
    looked: Instant,
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
        let unwatched = std::env::var_os(UNWATCHED);
        Stops {
            limit: limit(scenario.stopped_after_ns, unwatched.as_deref()),
            looked: Instant::now(),
            plant: None,
            robots: vec![None; scenario.robots.len()],
        }
    }

    /// Returns the robots that are stopped, as robots lost without a plan.
    pub(super) fn failed(&self) -> impl Iterator<Item = FailedRobot> {
        let stopped = self.robots.iter().enumerate().filter(|(_, stopped)| stopped.is_some());
        let cause = "was stopped by another process, and was not resumed";
        stopped.map(move |(robot, _)| FailedRobot { robot, cause: cause.into() })
    }
}

impl Run<'_> {
    /// Checks, if due, which processes were stopped or resumed.
    pub(super) fn check_stops(&mut self) -> Result<(), RunError> {
        if self.detectors.stops.looked.elapsed() < LOOK_EVERY {
            return Ok(());
        }
        self.detectors.stops.looked = Instant::now();
        match (self.detectors.stops.plant, self.processes.plant.is_stopped()) {
            (None, true) => self.detectors.stops.plant = Some(self.record_plant_stopped()?),
            (Some(stopped), false) => self.record_plant_resumed(stopped)?,
            _ => {}
        }
        self.processes.children_mut().for_each(|child| child.kill_if_too_large());
        for robot in 0..self.scenario.robots.len() {
            let stopped = self.processes.is_stopped(robot);
            match self.detectors.stops.robots[robot] {
                None if stopped && self.takes_stop(robot) => {
                    self.detectors.stops.robots[robot] = Some(self.record_robot_stopped(robot)?);
                }
                Some(since) if !stopped => self.record_robot_resumed(robot, since)?,
                _ => {}
            }
        }
        self.end_if_stopped_too_long()
    }

    /// Returns whether a stop of this robot counts: it should be moving, or in lockstep the plant waits for it.
    fn takes_stop(&self, robot: usize) -> bool {
        let waits = !self.time_mode.continues_without_stopped();
        match self.course.lifecycles().process_state(robot) {
            ProcessState::Moving => true,
            ProcessState::Starting => waits,
            ProcessState::Frozen | ProcessState::Ending | ProcessState::Down => false,
        }
    }

    /// Returns an error if a process has been stopped in lockstep for longer than the limit.
    fn end_if_stopped_too_long(&self) -> Result<(), RunError> {
        let Some(limit) = self.detectors.stops.limit else { return Ok(()) };
        if self.time_mode.continues_without_stopped() {
            return Ok(());
        }
        let long = |stopped: &Option<Stopped>| stopped.is_some_and(|s| s.since.elapsed() > limit);
        let robot = self.detectors.stops.robots.iter().position(long);
        let robot = robot.map(|robot| self.course.journal.name(robot));
        match robot.or(long(&self.detectors.stops.plant).then_some("the plant")) {
            Some(who) => Err(RunError::Stopped { who: who.into(), limit }),
            None => Ok(()),
        }
    }

    fn record_plant_stopped(&mut self) -> Result<Stopped, RunError> {
        warn_of("the plant", "no robot moves until it is resumed (SIGCONT)");
        let stopped = Stopped { since: Instant::now(), fault: None };
        if !self.time_mode.continues_without_stopped() {
            return Ok(stopped);
        }
        let who = Initiator::Outside;
        let what = format!("freeze plant, {}", who.keyword());
        let fault = self.course.journal.metrics.register_fault(what, Struck::default());
        self.handle(self.intake.now_ns(), Event::PlantStopped { fault, who })?;
        Ok(Stopped { fault: Some(fault), ..stopped })
    }

    fn record_plant_resumed(&mut self, stopped: Stopped) -> Result<(), RunError> {
        self.detectors.stops.plant = None;
        stopped.warn_resumed("the plant");
        let Some(fault) = stopped.fault else { return Ok(()) };
        let who = Initiator::Outside;
        self.handle(self.intake.now_ns(), Event::PlantResumed { fault, who })
    }

    fn record_robot_stopped(&mut self, robot: usize) -> Result<Stopped, RunError> {
        let stopped = Stopped { since: Instant::now(), fault: None };
        let name = self.course.journal.name(robot);
        if !self.time_mode.continues_without_stopped() {
            warn_of(name, "the run waits for it (SIGCONT)");
            return Ok(stopped);
        }
        warn_of(name, "the others continue without it");
        let who = Initiator::Outside;
        let fault = self.new_fault(&FaultKind::Freeze { robot }, who);
        self.handle(self.intake.now_ns(), Event::Freeze { robot, fault, ends: false, who })?;
        Ok(Stopped { fault: Some(fault), ..stopped })
    }

    /// Records that a stopped robot was resumed or has died.
    fn record_robot_resumed(&mut self, robot: usize, stopped: Stopped) -> Result<(), RunError> {
        self.detectors.stops.robots[robot] = None;
        let frozen_by = self.course.lifecycles().frozen_by(robot);
        if let Some(fault) = stopped.fault.filter(|&fault| frozen_by == Some(fault)) {
            stopped.warn_resumed(self.course.journal.name(robot));
            let who = Initiator::Outside;
            self.handle(self.intake.now_ns(), Event::Thaw { robot, fault, who })?;
        }
        Ok(())
    }
}

/// Returns the time after which a stopped process ends a lockstep run; `None` means never. `unwatched` is
/// the value of the environment variable.
fn limit(stopped_after_ns: Option<u64>, unwatched: Option<&OsStr>) -> Option<Duration> {
    let unwatched = unwatched.is_some_and(|value| !value.is_empty());
    stopped_after_ns.map(Duration::from_nanos).or(unwatched.then_some(UNWATCHED_MAX))
}

fn warn_of(name: &str, what_follows: &str) {
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
