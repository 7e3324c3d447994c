//! Watchdog of a lockstep run: detects processes that block it. The supervisor watches each process with a
//! pending response: a robot its first status and its arrival at each tick, the plant the next tick. A
//! process whose response is pending for some seconds is reported on the screen; a hung process ends the
//! run.
//!
//! In real time no process waits for another. A silent robot is reported, and listed at the end if it is
//! still silent.
//!
//! A busy machine ends no run: the decision depends on what a process does (`protocol::watchdog`). Robots
//! with pending responses share the wall time evenly; a single such robot is charged all of it. Processes
//! that respond within one or two polls cost nothing.

use std::time::{Duration, Instant};

use protocol::barrier::Barrier;
use protocol::message::TruthHeader;
use protocol::watchdog::{Activity, ProcessSample, SAMPLE_GAP_MAX, SchedulingState, Watchdog};

use super::error::RunError;
use super::processes::{SHOWN_LOG_LINES, WatchedProcess};
use crate::child::Child;
use outcome::metrics::expect::FailedRobot;

/// Polling interval for processes with pending responses.
const POLL_INTERVAL: Duration = Duration::from_millis(200);
/// Wall time after which a pending response is reported. If half of the limit that ends the run is less,
/// that applies.
const PENDING_REPORT_TIMEOUT: Duration = Duration::from_secs(5);
/// Time without a report after which a robot counts as silent in real time. Robots report ten times per
/// second, unless they are slowed down on purpose.
const SILENCE_TIMEOUT: Duration = Duration::from_secs(5);
/// Maximum number of processes reported one by one.
const REPORTED_PROCESSES_MAX: usize = 4;
/// Value in place of a tick for the first status of a process.
const FIRST_STATUS_MARKER: u64 = u64::MAX;

/// Watched process of a robot.
#[derive(Clone, Copy)]
pub(super) struct WatchedRobot<'a> {
    /// Index of the robot in the scenario.
    pub(super) robot: usize,
    pub(super) name: &'a str,
    pub(super) process: WatchedProcess<'a>,
    /// Start time of the process, while its first status is pending.
    pub(super) starting_since: Option<Instant>,
    /// Number of statuses of the robot that were read.
    pub(super) statuses: u64,
}

/// Watchdog of all processes of a run.
pub(super) struct RunWatchdog {
    hung_timeout: Duration,
    /// Maximum time for a robot to start.
    ready_timeout: Duration,
    last_poll: Instant,
    plant: PendingResponse,
    robots: Vec<PendingResponse>,
    /// State of each silent robot in real time; `None` for others.
    silent_robots: Vec<Option<Activity>>,
}

impl RunWatchdog {
    /// Creates the watchdog. A process whose response is pending for `limit` is hung.
    pub(super) fn new(robots: usize, limit: Duration, ready_after: Duration) -> RunWatchdog {
        RunWatchdog {
            hung_timeout: limit,
            ready_timeout: ready_after,
            last_poll: Instant::now(),
            plant: PendingResponse::default(),
            silent_robots: vec![None; robots],
            robots: (0..robots).map(|_| PendingResponse::default()).collect(),
        }
    }

    /// Returns the maximum time for a robot to start, in time of its own.
    pub(super) fn ready_timeout(&self) -> Duration {
        self.ready_timeout
    }

    /// Checks in real time, if due, which robots have become silent, and reports each once. `slowdown` is the
    /// planned slowdown of a robot.
    /// # Errors
    /// A robot has not become ready in time.
    pub(super) fn check_silence<'a>(
        &mut self,
        robots: impl Iterator<Item = WatchedRobot<'a>>,
        slowdown: impl Fn(usize) -> Duration,
    ) -> Result<(), RunError> {
        if self.last_poll.elapsed() < POLL_INTERVAL {
            return Ok(());
        }
        self.last_poll = Instant::now();
        let previously_silent = std::mem::take(&mut self.silent_robots);
        self.silent_robots = vec![None; previously_silent.len()];
        for WatchedRobot { robot, name, process, starting_since, statuses } in robots {
            if starting_since.is_some() {
                // The start of a process on another host cannot be observed.
                if let WatchedProcess::Remote(_) = process {
                    continue;
                }
                let response_state =
                    self.robots[robot].poll_start(process, self.ready_timeout, true);
                if let ResponseState::Hung(_) = response_state {
                    return Err(not_ready_error(name, process, self.ready_timeout));
                }
                continue;
            }
            let limit = SILENCE_TIMEOUT + slowdown(robot);
            let response_state = self.robots[robot].poll(Some(statuses), 1.0, process, limit);
            if let ResponseState::Hung(activity) = response_state {
                self.silent_robots[robot] = Some(activity);
                if previously_silent[robot].is_none() {
                    tracing::warn!(
                        "{name} has sent no status for {} s {activity}; the others continue without it",
                        limit.as_secs_f64()
                    );
                }
            }
        }
        Ok(())
    }

    /// Returns the silent robots, as robots lost without a plan.
    pub(super) fn silent_robots(&self) -> impl Iterator<Item = FailedRobot> {
        let robots = self.silent_robots.iter().enumerate();
        robots.filter_map(|(robot, activity)| {
            let cause = format!("was hung at the end: it sent no status {}", (*activity)?);
            Some(FailedRobot { robot, cause })
        })
    }

    /// Checks the processes with pending responses, if due. `newest` is the last ground truth sample that was read.
    /// # Errors
    /// A process is hung.
    pub(super) fn check<'a>(
        &mut self,
        barrier: &Barrier,
        newest: Option<&TruthHeader>,
        plant: &Child,
        robots: impl Iterator<Item = WatchedRobot<'a>>,
    ) -> Result<(), RunError> {
        if self.last_poll.elapsed() < POLL_INTERVAL {
            return Ok(());
        }
        self.last_poll = Instant::now();
        let pending_members = barrier.pending_members();
        let mut any_starting = false;
        let mut late_processes = Vec::new();
        for WatchedRobot { robot, name, process, starting_since, .. } in robots {
            any_starting |= starting_since.is_some();
            let tick =
                pending_members.iter().find(|(slot, _)| *slot == robot).map(|(_, tick)| *tick);
            let response = &mut self.robots[robot];
            let response_state = match starting_since {
                Some(_) => response.poll_start(process, self.ready_timeout, false),
                None => response.poll(
                    tick,
                    1.0 / pending_members.len().max(1) as f64,
                    process,
                    self.hung_timeout,
                ),
            };
            match response_state {
                ResponseState::InTime => {}
                ResponseState::Late(state_text) => late_processes.push(match tick {
                    Some(tick) => format!("{name} has not answered tick {tick}, and {state_text}"),
                    None => format!("{name} is not ready, and {state_text}"),
                }),
                ResponseState::Hung(_) if starting_since.is_some() => {
                    return Err(not_ready_error(name, process, self.ready_timeout));
                }
                ResponseState::Hung(activity) => {
                    let (robot, log) = (name.to_owned(), process.last_lines());
                    let (tick, limit) = (tick.unwrap_or_default(), self.hung_timeout);
                    return Err(RunError::RobotHung { robot, tick, limit, activity, log });
                }
            }
        }
        // The plant waits for robots or for the supervisor.
        let is_waiting =
            any_starting || !pending_members.is_empty() || barrier.paused_before_tick().is_some();
        let ticks_read = newest.map_or(0, |truth| truth.tick + 1);
        let response_number =
            (!is_waiting).then_some(ticks_read << 32 | u64::from(barrier.ticks_begun()));
        match self.plant.poll(response_number, 1.0, WatchedProcess::Local(plant), self.hung_timeout)
        {
            ResponseState::InTime => {}
            ResponseState::Late(state_text) => {
                late_processes.push(format!(
                    "the plant has not advanced from tick {ticks_read}, and {state_text}"
                ));
            }
            ResponseState::Hung(activity) => {
                let (limit, log) = (self.hung_timeout, plant.last_lines(SHOWN_LOG_LINES));
                return Err(RunError::PlantHung { limit, activity, log });
            }
        }
        warn_of_late_processes(&late_processes, report_timeout(self.hung_timeout));
        Ok(())
    }
}

/// Returns the error for a robot that has not become ready.
fn not_ready_error(name: &str, process: WatchedProcess<'_>, limit: Duration) -> RunError {
    RunError::NotReady { robot: name.to_owned(), limit, log: process.last_lines() }
}

/// Returns the number of processes and threads on this machine that run or wait for a processor, per
/// processor; at least 1.
fn load_per_processor() -> f64 {
    let text = std::fs::read_to_string("/proc/loadavg").unwrap_or_default();
    let running = text.split_whitespace().nth(3).and_then(|tasks| tasks.split_once('/'));
    let running = running.and_then(|(running, _)| running.parse().ok()).unwrap_or(1.0);
    let processors = std::thread::available_parallelism().map_or(1.0, |n| n.get() as f64);
    f64::max(1.0, running / processors)
}

/// Returns the wall time after which a pending response is reported, for the `limit` that ends the run.
fn report_timeout(limit: Duration) -> Duration {
    PENDING_REPORT_TIMEOUT.min(limit / 2)
}

/// Reports the processes that block the run.
fn warn_of_late_processes(messages: &[String], after: Duration) {
    let after_s = after.as_secs_f64();
    for message in messages.iter().take(REPORTED_PROCESSES_MAX) {
        tracing::warn!("{message}, for {after_s} s of wall time; all other processes wait");
    }
    if let Some(remaining) =
        messages.len().checked_sub(REPORTED_PROCESSES_MAX).filter(|&remaining| remaining > 0)
    {
        tracing::warn!("so have {remaining} more");
    }
}

/// State of a process with regard to its pending response.
#[derive(Debug, PartialEq)]
enum ResponseState {
    /// The process has no pending response, or not for long, or it has been reported.
    InTime,
    /// The response is late, with the present state of the process.
    Late(&'static str),
    /// The response is pending for too long, with the state of the process meanwhile.
    Hung(Activity),
}

/// Pending response of one process.
#[derive(Debug, Default)]
struct PendingResponse {
    /// Number of the response, and number of the process.
    pending_response: Option<(u64, u64)>,
    watchdog: Watchdog,
    /// Time of the newest poll, ns.
    last_poll_ns: Option<u64>,
    /// Wall time that the response has been pending, without time in which the process was stopped.
    pending_time: Duration,
    /// Part of that time in which the process was blocked.
    blocked_time: Duration,
    is_reported: bool,
    /// Highest load per processor while the first status is pending.
    load_max: f64,
}

impl PendingResponse {
    /// Polls the process with this pending response. `share` is the fraction of wall time that is charged to it.
    fn poll(
        &mut self,
        awaited_response: Option<u64>,
        share: f64,
        process: WatchedProcess<'_>,
        limit: Duration,
    ) -> ResponseState {
        let awaited_response = awaited_response.map(|number| (number, process.number()));
        if awaited_response.is_none() || self.pending_response != awaited_response {
            *self = PendingResponse {
                pending_response: awaited_response,
                ..PendingResponse::default()
            };
            return ResponseState::InTime;
        }
        // Deaths are processed elsewhere.
        match process.sample() {
            Some(sample) => self.add_sample(sample, share, limit),
            None => ResponseState::InTime,
        }
    }

    /// Polls a process whose first status is pending. A program may take long to start: only its own
    /// activity counts, and on a busy machine a smaller part of the time in which it is blocked, because it
    /// may wait for processes that wait for a processor. `counts_stopped_time` is whether time in which it is
    /// stopped counts as blocked.
    fn poll_start(
        &mut self,
        process: WatchedProcess<'_>,
        limit: Duration,
        counts_stopped_time: bool,
    ) -> ResponseState {
        let awaited_response = Some((FIRST_STATUS_MARKER, process.number()));
        if self.pending_response != awaited_response {
            *self = PendingResponse {
                pending_response: awaited_response,
                load_max: 1.0,
                ..PendingResponse::default()
            };
            return ResponseState::InTime;
        }
        self.load_max = self.load_max.max(load_per_processor());
        match process.sample() {
            Some(mut sample) => {
                if counts_stopped_time && sample.state == SchedulingState::Stopped {
                    sample.state = SchedulingState::Blocked;
                }
                match self.add_sample(sample, 0.0, limit) {
                    ResponseState::Hung(Activity::Waiting) if !self.has_waited(limit) => {
                        ResponseState::InTime
                    }
                    found => found,
                }
            }
            None => ResponseState::InTime,
        }
    }

    /// Returns whether the process has had a pending response for `limit`, scaled by the load of the machine.
    fn has_waited(&self, limit: Duration) -> bool {
        self.watchdog.hung_activity(limit.mul_f64(self.load_max)).is_some()
    }

    fn add_sample(&mut self, sample: ProcessSample, share: f64, limit: Duration) -> ResponseState {
        self.watchdog.add_sample_with_cpu_fraction(sample, share);
        let previous_ns = self.last_poll_ns.replace(sample.time_ns).unwrap_or(sample.time_ns);
        let elapsed = Duration::from_nanos(sample.time_ns - previous_ns).min(SAMPLE_GAP_MAX);
        if sample.state != SchedulingState::Stopped {
            self.pending_time += elapsed;
        }
        if sample.state == SchedulingState::Blocked {
            self.blocked_time += elapsed;
        }
        if let Some(activity) = self.watchdog.hung_activity(limit) {
            return ResponseState::Hung(activity);
        }
        if self.pending_time < report_timeout(limit)
            || std::mem::replace(&mut self.is_reported, true)
        {
            return ResponseState::InTime;
        }
        // One poll is not enough: on a busy machine a process is blocked only briefly, between long waits
        // for a processor.
        let mostly_blocked = self.blocked_time > self.pending_time / 2;
        ResponseState::Late(match sample.state {
            SchedulingState::Stopped => "is stopped",
            SchedulingState::Exited => "is dead",
            _ if mostly_blocked => "is blocked (on a file, a timer or another process)",
            _ => "runs or waits for a processor",
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn late_process_is_reported_once_before_it_ends_the_run() {
        let mut response = PendingResponse::default();
        let reported =
            |polls: std::ops::RangeInclusive<u64>, state, response: &mut PendingResponse| {
                let sample = |poll: u64| ProcessSample {
                    state,
                    cpu_time: Duration::from_millis(40 * poll.saturating_sub(18_000)),
                    time_ns: poll * 200_000_000,
                    start_time_ticks: 7,
                };
                let states = polls
                    .map(|poll| response.add_sample(sample(poll), 1.0, Duration::from_secs(60)));
                states.filter(|found| *found != ResponseState::InTime).collect::<Vec<_>>()
            };
        // A stopped process is reported elsewhere.
        assert_eq!(reported(0..=18_000, SchedulingState::Stopped, &mut response), []);
        let late_state = ResponseState::Late("runs or waits for a processor");
        assert_eq!(
            reported(18_001..=18_299, SchedulingState::Runnable, &mut response),
            [late_state]
        );
        let hung_state = ResponseState::Hung(Activity::Computing);
        assert_eq!(
            reported(18_300..=18_301, SchedulingState::Runnable, &mut response).last(),
            Some(&hung_state)
        );
        assert_eq!(report_timeout(Duration::from_secs(1)), Duration::from_millis(500));
    }

    #[test]
    fn late_process_is_described_by_its_main_activity() {
        let blocked = "is blocked (on a file, a timer or another process)";
        for (blocked_polls, expected) in [(1, "runs or waits for a processor"), (3, blocked)] {
            let mut response = PendingResponse::default();
            let late_states = (0..100).map(|poll: u64| {
                // Blocked in the last polls before the report, independent of earlier states.
                let is_blocked = poll % 4 < blocked_polls || poll > 22;
                let state =
                    if is_blocked { SchedulingState::Blocked } else { SchedulingState::Runnable };
                let sample = ProcessSample {
                    state,
                    cpu_time: Duration::ZERO,
                    time_ns: poll * 200_000_000,
                    start_time_ticks: 7,
                };
                response.add_sample(sample, 0.0, Duration::from_secs(60))
            });
            let late_states: Vec<ResponseState> =
                late_states.filter(|found| *found != ResponseState::InTime).collect();
            assert_eq!(late_states, [ResponseState::Late(expected)]);
        }
    }
}
