//! Who holds a lockstep run up, and for how long? The supervisor knows all processes and watches
//! over each that owes an answer: a robot its first status and its arrival at each tick, the plant
//! the next tick. Whoever owes one for some seconds is told on the screen; whoever is hung ends the run.
//!
//! In real time nobody waits for anybody; whoever has fallen silent is told, and named at the end if it is still
//! silent then.
//!
//! A machine that is busy ends no run: what counts is what a process does (`protocol::watchdog`). Robots that owe
//! an answer share the wall time evenly; one alone has all of it. Whoever answers within a look or two costs nothing
//! here.

use std::time::{Duration, Instant};

use protocol::barrier::Barrier;
use protocol::message::TruthHeader;
use protocol::watchdog::{Activity, GAP_MAX, Sample, State, Watchdog};

use super::error::RunError;
use super::processes::{LOG_LINES, Process};
use crate::child::Child;
use outcome::metrics::expect::FailedRobot;

/// How often those who owe an answer are looked at.
const LOOK_EVERY: Duration = Duration::from_millis(200);
/// Whoever owes an answer for this much wall time is told, or for half of what ends the run if that is less.
const TELL_AFTER: Duration = Duration::from_secs(5);
/// In real time robots report ten times a second; whoever does not for this long, and is not slow on purpose, is
/// silent.
const SILENT_AFTER: Duration = Duration::from_secs(5);
/// Of so many at once each is told.
const TOLD_MAX: usize = 4;
/// Activity of a tick: the first status.
const FIRST_STATUS: u64 = u64::MAX;

/// A robot's process.
#[derive(Clone, Copy)]
pub(super) struct Watched<'a> {
    /// Its place in the scenario.
    pub(super) robot: usize,
    pub(super) name: &'a str,
    pub(super) process: Process<'a>,
    /// When it was started, if its first status is awaited.
    pub(super) starting_since: Option<Instant>,
    /// How many statuses of it were taken.
    pub(super) statuses: u64,
}

/// Watches over all processes of a lockstep run.
pub(super) struct Watch {
    limit: Duration,
    /// How long a robot may take to start.
    ready_after: Duration,
    looked: Instant,
    plant: Debt,
    robots: Vec<Debt>,
    /// In real time, what silent robots do instead of reporting.
    silent: Vec<Option<Activity>>,
}

impl Watch {
    /// Whoever owes an answer for `limit` is hung.
    pub(super) fn new(robots: usize, limit: Duration, ready_after: Duration) -> Watch {
        Watch {
            limit,
            ready_after,
            looked: Instant::now(),
            plant: Debt::default(),
            silent: vec![None; robots],
            robots: (0..robots).map(|_| Debt::default()).collect(),
        }
    }

    /// Returns how long a robot may take to start, in time of its own.
    pub(super) fn ready_after(&self) -> Duration {
        self.ready_after
    }

    /// In real time: looks, if it is time to, who has fallen silent, and tells each of them once. `slow`: by how much a
    /// robot may be slow on purpose. An error names a robot that does not become ready.
    pub(super) fn look_for_silence<'a>(
        &mut self,
        robots: impl Iterator<Item = Watched<'a>>,
        slow: impl Fn(usize) -> Duration,
    ) -> Result<(), RunError> {
        if self.looked.elapsed() < LOOK_EVERY {
            return Ok(());
        }
        self.looked = Instant::now();
        let before = std::mem::take(&mut self.silent);
        self.silent = vec![None; before.len()];
        for Watched { robot, name, process, starting_since, statuses } in robots {
            if starting_since.is_some() {
                // The start of a process of another host is not seen from here.
                if let Process::Elsewhere(_) = process {
                    continue;
                }
                let found = self.robots[robot].look_at_start(process, self.ready_after, true);
                if let Found::Hung(_) = found {
                    return Err(not_ready(name, process, self.ready_after));
                }
                continue;
            }
            let limit = SILENT_AFTER + slow(robot);
            let found = self.robots[robot].look(Some(statuses), 1.0, process, limit);
            if let Found::Hung(instead) = found {
                self.silent[robot] = Some(instead);
                if before[robot].is_none() {
                    tracing::warn!(
                        "{name} has said nothing for {} s {instead}; the others go on without it",
                        limit.as_secs_f64()
                    );
                }
            }
        }
        Ok(())
    }

    /// Robots that are silent, as those that nobody's plan lost.
    pub(super) fn failed(&self) -> impl Iterator<Item = FailedRobot> {
        let silent = self.silent.iter().enumerate();
        silent.filter_map(|(robot, instead)| {
            let cause = format!("was hung at the end: it said nothing {}", (*instead)?);
            Some(FailedRobot { robot, cause })
        })
    }

    /// Looks, if it is time to. An error names whoever is hung. `newest`: the truth taken in last.
    pub(super) fn look<'a>(
        &mut self,
        barrier: &Barrier,
        newest: Option<&TruthHeader>,
        plant: &Child,
        robots: impl Iterator<Item = Watched<'a>>,
    ) -> Result<(), RunError> {
        if self.looked.elapsed() < LOOK_EVERY {
            return Ok(());
        }
        self.looked = Instant::now();
        let awaited = barrier.awaited();
        let mut anybody_starts = false;
        let mut late = Vec::new();
        for Watched { robot, name, process, starting_since, .. } in robots {
            anybody_starts |= starting_since.is_some();
            let tick = awaited.iter().find(|(slot, _)| *slot == robot).map(|(_, tick)| *tick);
            let debt = &mut self.robots[robot];
            let found = match starting_since {
                Some(_) => debt.look_at_start(process, self.ready_after, false),
                None => debt.look(tick, 1.0 / awaited.len().max(1) as f64, process, self.limit),
            };
            match found {
                Found::InTime => {}
                Found::Late(doing) => late.push(match tick {
                    Some(tick) => format!("{name} has not answered tick {tick}, and {doing}"),
                    None => format!("{name} is not ready, and {doing}"),
                }),
                Found::Hung(_) if starting_since.is_some() => {
                    return Err(not_ready(name, process, self.ready_after));
                }
                Found::Hung(instead) => {
                    let (robot, log) = (name.to_owned(), process.last_lines());
                    let (tick, limit) = (tick.unwrap_or_default(), self.limit);
                    return Err(RunError::RobotHung { robot, tick, limit, instead, log });
                }
            }
        }
        // It waits for robots, or for the supervisor.
        let waits = anybody_starts || !awaited.is_empty() || barrier.paused().is_some();
        let taken = newest.map_or(0, |truth| truth.tick + 1);
        let owed = (!waits).then_some(taken << 32 | u64::from(barrier.ticks_begun()));
        match self.plant.look(owed, 1.0, Process::Here(plant), self.limit) {
            Found::InTime => {}
            Found::Late(doing) => {
                late.push(format!("the plant has not gone on from tick {taken}, and {doing}"));
            }
            Found::Hung(instead) => {
                let (limit, log) = (self.limit, plant.last_lines(LOG_LINES));
                return Err(RunError::PlantHung { limit, instead, log });
            }
        }
        tell(&late, tell_after(self.limit));
        Ok(())
    }
}

/// Returns the error for a robot that has not become ready.
fn not_ready(name: &str, process: Process<'_>, limit: Duration) -> RunError {
    RunError::NotReady { robot: name.to_owned(), limit, log: process.last_lines() }
}

/// Returns how many processes and threads of this machine run or wait for a processor, per processor; at least 1.
fn load_per_processor() -> f64 {
    let text = std::fs::read_to_string("/proc/loadavg").unwrap_or_default();
    let running = text.split_whitespace().nth(3).and_then(|tasks| tasks.split_once('/'));
    let running = running.and_then(|(running, _)| running.parse().ok()).unwrap_or(1.0);
    let processors = std::thread::available_parallelism().map_or(1.0, |n| n.get() as f64);
    f64::max(1.0, running / processors)
}

/// After how much wall time somebody is told who ends the run after `limit`.
fn tell_after(limit: Duration) -> Duration {
    TELL_AFTER.min(limit / 2)
}

/// Tells who holds everybody up.
fn tell(late: &[String], after: Duration) {
    let after_s = after.as_secs_f64();
    for who in late.iter().take(TOLD_MAX) {
        tracing::warn!("{who}, for {after_s} s of wall time; everybody else waits");
    }
    if let Some(more) = late.len().checked_sub(TOLD_MAX).filter(|&more| more > 0) {
        tracing::warn!("so have {more} more");
    }
}

/// How a process stands that may owe an answer.
#[derive(Debug, PartialEq)]
enum Found {
    /// It owes none, or not for long, or that was told already.
    InTime,
    /// It has owed one for some time, and does this.
    Late(&'static str),
    /// It has owed it for too long, and did this instead.
    Hung(Activity),
}

/// What one process owes.
#[derive(Debug, Default)]
struct Debt {
    /// The answer, and the number of the process that owes it.
    owed: Option<(u64, u64)>,
    dog: Watchdog,
    /// The newest look, ns.
    looked_ns: Option<u64>,
    /// Wall time that it was not stopped for, as far as somebody looked.
    owed_for: Duration,
    /// The part of it for which the process was blocked.
    blocked_for: Duration,
    told: bool,
    /// Of a first status: the highest load per processor so far.
    load_max: f64,
}

impl Debt {
    /// It owes this answer, or none. `share`: of the wall time it may expect this much for itself.
    fn look(
        &mut self,
        owed: Option<u64>,
        share: f64,
        process: Process<'_>,
        limit: Duration,
    ) -> Found {
        let owed = owed.map(|owed| (owed, process.number()));
        if owed.is_none() || self.owed != owed {
            *self = Debt { owed, ..Debt::default() };
            return Found::InTime;
        }
        // The dead are dealt with elsewhere.
        match process.sample() {
            Some(sample) => self.see(sample, share, limit),
            None => Found::InTime,
        }
    }

    /// It owes its first status. Starting may take a program long: only what it does itself counts, and of the time in
    /// which it is blocked less on a busy machine, where it may wait for others that wait for a processor.
    /// `stopped_counts`: time in which it is stopped is time in which it is blocked.
    fn look_at_start(
        &mut self,
        process: Process<'_>,
        limit: Duration,
        stopped_counts: bool,
    ) -> Found {
        let owed = Some((FIRST_STATUS, process.number()));
        if self.owed != owed {
            *self = Debt { owed, load_max: 1.0, ..Debt::default() };
            return Found::InTime;
        }
        self.load_max = self.load_max.max(load_per_processor());
        match process.sample() {
            Some(mut sample) => {
                if stopped_counts && sample.state == State::Stopped {
                    sample.state = State::Blocked;
                }
                match self.see(sample, 0.0, limit) {
                    Found::Hung(Activity::Waited) if !self.has_waited(limit) => Found::InTime,
                    found => found,
                }
            }
            None => Found::InTime,
        }
    }

    /// Whether it has waited for so long on a machine as busy as this.
    fn has_waited(&self, limit: Duration) -> bool {
        self.dog.hung_activity(limit.mul_f64(self.load_max)).is_some()
    }

    fn see(&mut self, sample: Sample, share: f64, limit: Duration) -> Found {
        self.dog.add_sample_with_share(sample, share);
        let since_ns = self.looked_ns.replace(sample.at_ns).unwrap_or(sample.at_ns);
        let since = Duration::from_nanos(sample.at_ns - since_ns).min(GAP_MAX);
        if sample.state != State::Stopped {
            self.owed_for += since;
        }
        if sample.state == State::Blocked {
            self.blocked_for += since;
        }
        if let Some(instead) = self.dog.hung_activity(limit) {
            return Found::Hung(instead);
        }
        if self.owed_for < tell_after(limit) || std::mem::replace(&mut self.told, true) {
            return Found::InTime;
        }
        // One look says little: on a busy machine a process is blocked for moments only, between long waits for a
        // processor.
        let mostly_blocked = self.blocked_for > self.owed_for / 2;
        Found::Late(match sample.state {
            State::Stopped => "is stopped",
            State::Gone => "is dead",
            _ if mostly_blocked => "is blocked (on a file, a timer or another process)",
            _ => "runs or waits for a processor",
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn whoever_owes_an_answer_is_told_of_once_before_it_ends_the_run() {
        let mut debt = Debt::default();
        let found = |looks: std::ops::RangeInclusive<u64>, state, debt: &mut Debt| {
            let sample = |look: u64| Sample {
                state,
                computed: Duration::from_millis(40 * look.saturating_sub(18_000)),
                at_ns: look * 200_000_000,
                started: 7,
            };
            let all = looks.map(|look| debt.see(sample(look), 1.0, Duration::from_secs(60)));
            all.filter(|found| *found != Found::InTime).collect::<Vec<_>>()
        };
        // Stopped for an hour: whoever stopped it was told.
        assert_eq!(found(0..=18_000, State::Stopped, &mut debt), []);
        let late = Found::Late("runs or waits for a processor");
        assert_eq!(found(18_001..=18_299, State::Runnable, &mut debt), [late]);
        let hung = Found::Hung(Activity::Computed);
        assert_eq!(found(18_300..=18_301, State::Runnable, &mut debt).last(), Some(&hung));
        assert_eq!(tell_after(Duration::from_secs(1)), Duration::from_millis(500));
    }

    #[test]
    fn a_late_process_is_described_by_what_it_mostly_did() {
        let blocked = "is blocked (on a file, a timer or another process)";
        for (blocked_looks, expected) in [(1, "runs or waits for a processor"), (3, blocked)] {
            let mut debt = Debt::default();
            let late = (0..100).map(|look: u64| {
                // Blocked in the last looks before it is told, whatever it did before.
                let is_blocked = look % 4 < blocked_looks || look > 22;
                let state = if is_blocked { State::Blocked } else { State::Runnable };
                let sample = Sample {
                    state,
                    computed: Duration::ZERO,
                    at_ns: look * 200_000_000,
                    started: 7,
                };
                debt.see(sample, 0.0, Duration::from_secs(60))
            });
            let late: Vec<Found> = late.filter(|found| *found != Found::InTime).collect();
            assert_eq!(late, [Found::Late(expected)]);
        }
    }
}
