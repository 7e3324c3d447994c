//! Time mode of a run, and what depends on it. No other file distinguishes the modes.
//!
//! In lockstep the plant pauses at the tick of the next action, and the supervisor acts only then, until
//! all processes are at rest, because wall time is not simulated time. In real time no process waits for
//! the supervisor.

use std::path::Path;
use std::time::{Duration, Instant};

use protocol::barrier::{Barrier, BarrierError};
use protocol::brief::Pace;
use protocol::law_message::SentCounts;
use protocol::message::{StatusHeader, TruthHeader};
use protocol::run_root::RunRoot;
use rustix::event::PollFd;

use super::error::{RunError, TRUTH_SILENCE_MAX};
use super::hung::{RunWatchdog, WatchedRobot};
use super::processes::wait_until_readable;
use crate::child::Child;
use crate::cores::{Cores, Placement};
use crate::spawn::Launcher;
use experiment::scenario::Scenario;
use outcome::metrics::expect::FailedRobot;
use outcome::results::usage::Usage;

/// Maximum time for which one iteration of the loop waits for messages.
const ITERATION_MAX: Duration = Duration::from_millis(2);

/// Time mode, with its state.
pub(super) enum TimeMode {
    /// Lockstep, as fast as the machine allows.
    Lockstep {
        barrier: Barrier,
        /// Assignment of the processes to cores; `None` if unavailable.
        placement: Option<Box<Placement>>,
        period_ns: u64,
        watchdog: Box<RunWatchdog>,
    },
    /// Real time, by the machine's clock.
    Realtime { period_ns: u64, watchdog: Box<RunWatchdog> },
}

impl TimeMode {
    /// Creates the state that must exist before the first process.
    pub(super) fn new(
        scenario: &Scenario,
        pace: Pace,
        run_root: &RunRoot,
        launcher: &Launcher,
    ) -> Result<TimeMode, BarrierError> {
        let (robots, period_ns) = (scenario.robots.len(), scenario.period_ns);
        let hung_timeout = Duration::from_nanos(scenario.hung_after_ns);
        let ready_after = Duration::from_nanos(scenario.ready_after_ns);
        let watchdog = Box::new(RunWatchdog::new(robots, hung_timeout, ready_after));
        if pace == Pace::Realtime {
            return Ok(TimeMode::Realtime { period_ns, watchdog });
        }
        let cores = Cores::assign(robots, std::process::id() as usize);
        let groups = cores.as_ref().map_or(1, Cores::groups);
        let barrier = Barrier::create(&run_root.barrier_path(), robots, groups, hung_timeout)?;
        // No robot moves before all have reported, so that a death during the start-up has no effect on the run.
        barrier.pause_at(0);
        Ok(TimeMode::Lockstep {
            barrier,
            placement: cores.map(|cores| Box::new(Placement::new(cores, launcher.clone()))),
            period_ns,
            watchdog,
        })
    }

    /// Returns whether links can be cut interactively: in real time only, because messages about them have no tick.
    pub(super) fn can_cut_links(&self) -> bool {
        matches!(self, TimeMode::Realtime { .. })
    }

    /// Returns whether a replacement may start before the stale resources of its predecessor are removed.
    /// In lockstep it waits for the removal, so that each restart finds the same state.
    pub(super) fn restarts_before_cleanup(&self) -> bool {
        matches!(self, TimeMode::Realtime { .. })
    }

    /// Returns whether other processes continue while one is stopped. In lockstep they wait.
    pub(super) fn continues_despite_stopped_process(&self) -> bool {
        matches!(self, TimeMode::Realtime { .. })
    }

    /// Waits for a message or a process exit, at most one iteration. `poll_fds` returns the descriptors to wait
    /// for in real time; in lockstep the plant wakes the supervisor.
    pub(super) fn wait_for_message_or_exit<'f>(&self, poll_fds: impl FnOnce() -> Vec<PollFd<'f>>) {
        match self {
            TimeMode::Lockstep { barrier, .. } => {
                barrier.wait_for_attention(ITERATION_MAX);
            }
            TimeMode::Realtime { .. } => wait_until_readable(&mut poll_fds(), ITERATION_MAX),
        }
    }

    /// Processes the arrival of a ground truth sample.
    pub(super) fn record_truth_arrival(&self, truth: &TruthHeader) {
        if let TimeMode::Lockstep { barrier, .. } = self {
            barrier.set_consumed_ticks(truth.tick + 1);
        }
    }

    /// Returns the number of robot reports that have been sent, if all reports before the newest ground
    /// truth are among them. In lockstep robots report before they arrive at the barrier, for which the
    /// plant waits.
    pub(super) fn reports_before_truth(&self) -> Option<u32> {
        match self {
            TimeMode::Lockstep { barrier, .. } => Some(barrier.report_count()),
            TimeMode::Realtime { .. } => None,
        }
    }

    /// Returns the run time, ns, before which all events are known after this ground truth, and in lockstep
    /// all messages before it, were read.
    pub(super) fn known_until_ns(&self, newest_truth: &TruthHeader) -> u64 {
        match self {
            TimeMode::Lockstep { .. } => newest_truth.t_ns,
            // Messages in transit are not waited for.
            TimeMode::Realtime { .. } => newest_truth.t_ns.saturating_add(1),
        }
    }

    /// Returns whether the plant waits for the supervisor: it has not started, or it is paused and the
    /// ground truth of that tick, sent before the pause, was read.
    pub(super) fn plant_waits_for_supervisor(&self, newest: Option<&TruthHeader>) -> bool {
        match (self, newest) {
            (TimeMode::Realtime { .. }, _) => false,
            (TimeMode::Lockstep { .. }, None) => true,
            (TimeMode::Lockstep { barrier, .. }, Some(truth)) => {
                barrier.paused_before_tick() == Some(truth.tick)
            }
        }
    }

    /// Returns whether the supervisor may kill, stop and start robots now.
    pub(super) fn may_act(&self, newest: Option<&TruthHeader>) -> bool {
        matches!(self, TimeMode::Realtime { .. }) || self.plant_waits_for_supervisor(newest)
    }

    /// Returns whether no robot has moved yet.
    pub(super) fn is_starting_up(&self, newest: Option<&TruthHeader>) -> bool {
        match self {
            TimeMode::Lockstep { .. } => {
                newest.is_none_or(|truth| truth.t_ns == 0)
                    && self.plant_waits_for_supervisor(newest)
            }
            TimeMode::Realtime { .. } => newest.is_none(),
        }
    }

    /// Returns whether a robot with this status takes part. In lockstep a replacement is ready before its
    /// first tick; in real time it takes part once it has replied to a sample.
    pub(super) fn takes_part(&self, status: &StatusHeader) -> bool {
        match self {
            TimeMode::Lockstep { .. } => true,
            TimeMode::Realtime { .. } => status.incarnation == 0 || status.moving == 1,
        }
    }

    /// Makes the plant wait for this robot from the next tick on.
    pub(super) fn add_robot(&self, robot: usize) {
        if let TimeMode::Lockstep { barrier, .. } = self {
            barrier.set_member(robot, barrier.paused_before_tick().unwrap_or(0));
        }
    }

    /// Returns what the process of this robot, which is dead or sends no more, has sent, in lockstep; `None` in
    /// real time, where its statuses contain the counts.
    pub(super) fn take_sent_counts(&self, robot: usize) -> Option<SentCounts> {
        match self {
            TimeMode::Lockstep { barrier, .. } => Some(barrier.take_sent_counts(robot)),
            TimeMode::Realtime { .. } => None,
        }
    }

    /// Makes the plant no longer wait for this robot.
    pub(super) fn remove_robot(&self, robot: usize) {
        if let TimeMode::Lockstep { barrier, .. } = self {
            barrier.remove_member(robot);
        }
    }

    /// Sets the run time, ns, at which the plant pauses; `None` means never.
    pub(super) fn pause_at(&self, t_ns: Option<u64>) {
        if let TimeMode::Lockstep { barrier, period_ns, .. } = self {
            barrier.pause_at(t_ns.map_or(u64::MAX, |t_ns| t_ns.div_ceil(*period_ns)));
        }
    }

    /// Lets the plant continue up to the time set by [`TimeMode::pause_at`].
    pub(super) fn resume(&self) {
        if let TimeMode::Lockstep { barrier, .. } = self {
            barrier.resume();
        }
    }

    /// Checks all timeouts. In real time they are wall time; in lockstep, time in which a process could
    /// run, so that a slow machine causes none. `last_arrival` is when the last ground truth arrived, and
    /// `slowdown` the planned slowdown of a robot.
    /// # Errors
    /// A process exceeded its timeout.
    pub(super) fn check_deadlines<'c>(
        &mut self,
        newest: Option<&TruthHeader>,
        last_arrival: Instant,
        plant: &Child,
        robots: impl Iterator<Item = WatchedRobot<'c>> + Clone,
        slowdown: impl Fn(usize) -> Duration,
    ) -> Result<(), RunError> {
        match self {
            TimeMode::Lockstep { barrier, watchdog, .. } => {
                watchdog.check(barrier, newest, plant, robots)
            }
            TimeMode::Realtime { watchdog, .. } => {
                watchdog.check_silence(robots, slowdown)?;
                // The start of a plant of the scenario has the timeout of a robot's start.
                let limit = match newest {
                    None => TRUTH_SILENCE_MAX.max(watchdog.ready_timeout()),
                    Some(_) => TRUTH_SILENCE_MAX,
                };
                match last_arrival.elapsed() > limit {
                    true => Err(RunError::PlantSilent { limit }),
                    false => Ok(()),
                }
            }
        }
    }

    /// Lets all processes finish their current tick after the last ground truth, so that none is killed in it.
    pub(super) fn finish_current_tick(&self) {
        if let TimeMode::Realtime { period_ns, .. } = self {
            std::thread::sleep(2 * Duration::from_nanos(*period_ns));
        }
    }

    /// Returns the robots that are hung without blocking the run, in real time. In lockstep they end the run.
    pub(super) fn hung_robots(&self) -> Vec<FailedRobot> {
        match self {
            TimeMode::Lockstep { .. } => Vec::new(),
            TimeMode::Realtime { watchdog, .. } => watchdog.silent_robots().collect(),
        }
    }

    /// Pins the plant and the robots (by index) to their cores, while no other process needs these. `log`
    /// is for the processes that keep the cores awake.
    pub(super) fn pin_processes<'c>(
        &mut self,
        plant: &Child,
        robots: impl Iterator<Item = (usize, &'c Child)> + Clone,
        log: &Path,
    ) {
        if let TimeMode::Lockstep { placement: Some(placement), barrier, .. } = self {
            placement.update(plant, robots, barrier.ticks_begun(), log);
        }
    }

    /// Releases the cores. Returns the resource usage of the processes that kept them awake.
    pub(super) fn release_cores(&mut self) -> Option<Usage> {
        match self {
            TimeMode::Lockstep { placement: Some(placement), .. } => {
                Some(placement.end_placement())
            }
            _ => None,
        }
    }
}
