//! Who holds a lockstep run up, and for how long? The supervisor knows all processes and watches
//! over each that owes an answer: a robot its first status and its arrival at each tick, the plant
//! the next tick.
//!
//! A machine that is busy ends no run: what counts is what a process does (`protocol::watchdog`).
//! Whoever answers within a look or two costs nothing here.

use std::time::{Duration, Instant};

use protocol::barrier::Barrier;
use protocol::message::TruthHeader;
use protocol::watchdog::{Instead, Sample, State, Watchdog};

use super::error::{READY_MAX, RunError};
use super::processes::LOG_LINES;
use crate::child::Child;

/// How often those who owe an answer are looked at.
const LOOK_EVERY: Duration = Duration::from_millis(200);
/// Instead of a tick: the first status.
const FIRST_STATUS: u64 = u64::MAX;

/// A robot's process.
#[derive(Clone, Copy)]
pub(super) struct Watched<'a> {
    /// Its place in the scenario.
    pub(super) robot: usize,
    pub(super) name: &'a str,
    pub(super) child: &'a Child,
    /// When it was started, if its first status is awaited.
    pub(super) starting_since: Option<Instant>,
}

/// Watches over all processes of a lockstep run.
pub(super) struct Watch {
    limit: Duration,
    looked: Instant,
    plant: Debt,
    robots: Vec<Debt>,
}

impl Watch {
    /// Whoever owes an answer for `limit` is hung.
    pub(super) fn new(robots: usize, limit: Duration) -> Watch {
        let robots = (0..robots).map(|_| Debt::default()).collect();
        Watch { limit, looked: Instant::now(), plant: Debt::default(), robots }
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
        for Watched { robot, name, child, starting_since } in robots {
            anybody_starts |= starting_since.is_some();
            let tick = awaited.iter().find(|(slot, _)| *slot == robot).map(|(_, tick)| *tick);
            let (owed, limit) = match starting_since {
                Some(_) => (Some(FIRST_STATUS), READY_MAX),
                None => (tick, self.limit),
            };
            let Some(instead) = self.robots[robot].look(owed, name, child, limit) else { continue };
            let (robot, log) = (name.to_owned(), child.last_lines(LOG_LINES));
            return Err(match starting_since {
                Some(_) => RunError::NotReady { robot, log },
                None => {
                    let tick = tick.unwrap_or_default();
                    RunError::RobotHung { robot, tick, limit, instead, log }
                }
            });
        }
        // It waits for robots, or for the supervisor.
        let waits = anybody_starts || !awaited.is_empty() || barrier.paused().is_some();
        let taken = newest.map_or(0, |truth| truth.tick + 1);
        let owed = (!waits).then_some(taken << 32 | u64::from(barrier.ticks_begun()));
        match self.plant.look(owed, "the plant", plant, self.limit) {
            None => Ok(()),
            Some(instead) => {
                let (limit, log) = (self.limit, plant.last_lines(LOG_LINES));
                Err(RunError::PlantHung { limit, instead, log })
            }
        }
    }
}

/// What one process owes.
#[derive(Debug, Default)]
struct Debt {
    /// Which answer, of which process id.
    owed: Option<(u64, u32)>,
    dog: Watchdog,
    seen_stopped: bool,
}

impl Debt {
    /// It owes this answer, or none: what it did instead, if it has owed it for too long.
    fn look(
        &mut self,
        owed: Option<u64>,
        name: &str,
        child: &Child,
        limit: Duration,
    ) -> Option<Instead> {
        let owed = owed.map(|owed| (owed, child.pid()));
        if owed.is_none() || self.owed != owed {
            *self = Debt { owed, ..Debt::default() };
            return None;
        }
        // The dead are dealt with elsewhere.
        let sample = Sample::of(child.pid()).ok()?;
        let stopped = sample.state == State::Stopped;
        if stopped && !std::mem::replace(&mut self.seen_stopped, true) {
            tracing::warn!("{name} was stopped by somebody else; the run waits for it (SIGCONT)");
        }
        self.dog.see(sample);
        self.dog.hung(limit)
    }
}
