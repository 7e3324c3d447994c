//! One robot as the supervisor keeps it: where its process is in its life, and what follows on a
//! death that nobody planned.

use std::path::PathBuf;
use std::time::Instant;

use protocol::message::{Contact, NeighborStatus, StatusHeader};
use protocol::service::Subscriber;

use crate::child::Child;
use crate::spawn::{Launcher, Role, SpawnError};
use crate::usage::Usage;
use experiment::scenario::RestartPolicy;

/// Where a robot's process is in its life.
#[derive(Debug)]
pub(crate) enum Seat {
    /// Started; its first status is awaited.
    Starting { child: Child, since: Instant },
    /// Taking part.
    Flying { child: Child },
    /// Stopped by SIGSTOP.
    Frozen { child: Child },
    /// Killed on purpose; its end is awaited.
    Ending { child: Child },
    /// Dead and reaped.
    Down,
}

/// One robot as the supervisor keeps it.
pub(crate) struct Robot {
    pub(crate) name: String,
    pub(crate) brief: PathBuf,
    pub(crate) log: PathBuf,
    pub(crate) seat: Seat,
    pub(crate) incarnation: u64,
    /// Its processes that are dead and reaped, and not yet cleaned up.
    pub(crate) remains: usize,
    /// Run time at which a replacement is due, ns.
    pub(crate) restart_at_ns: Option<u64>,
    /// Run times of restarts nobody planned, ns.
    unplanned_restarts_ns: Vec<u64>,
    /// The fault that its present death, or its replacement's start, belongs to.
    pub(crate) fault: Option<usize>,
    /// The fault by which it is frozen.
    pub(crate) frozen_by: Option<usize>,
    pub(crate) status: Subscriber<[NeighborStatus], StatusHeader>,
    /// How it last said it hears each robot.
    pub(crate) contacts: Vec<Contact>,
    /// How it last said it hears the leader's frame.
    pub(crate) frame: Contact,
    /// Beacons refused by earlier incarnations, and by this one so far.
    pub(crate) refused_before: u64,
    pub(crate) refused: u64,
    /// Deadline misses of earlier incarnations, and of this one so far.
    pub(crate) misses_before: u64,
    pub(crate) misses: u64,
    /// What its processes took from the machine, up to the last death.
    pub(crate) usage: Usage,
}

impl Robot {
    /// A robot whose process was not started yet.
    pub(crate) fn new(
        name: &str,
        brief: PathBuf,
        log: PathBuf,
        status: Subscriber<[NeighborStatus], StatusHeader>,
        robots: usize,
    ) -> Robot {
        Robot {
            name: name.into(),
            brief,
            log,
            seat: Seat::Down,
            incarnation: 0,
            remains: 0,
            restart_at_ns: None,
            unplanned_restarts_ns: Vec::new(),
            fault: None,
            frozen_by: None,
            status,
            contacts: vec![Contact::Unheard; robots],
            frame: Contact::Unheard,
            refused_before: 0,
            refused: 0,
            misses_before: 0,
            misses: 0,
            usage: Usage::default(),
        }
    }

    /// How many restarts nobody planned fall into the policy's window that ends at `t_ns`.
    pub(crate) fn recent_restarts(&mut self, t_ns: u64, policy: &RestartPolicy) -> u32 {
        let window_began_ns = t_ns.saturating_sub(policy.window_ns);
        self.unplanned_restarts_ns.retain(|&at_ns| at_ns >= window_began_ns);
        self.unplanned_restarts_ns.len() as u32
    }

    /// Plans the restart after a death at `t_ns` that nobody planned.
    pub(crate) fn restart_unplanned(&mut self, t_ns: u64, delay_ns: u64) {
        self.unplanned_restarts_ns.push(t_ns);
        self.restart_at_ns = Some(t_ns + delay_ns);
    }

    /// Starts its process.
    pub(crate) fn start(&mut self, launcher: &Launcher) -> Result<(), SpawnError> {
        let role = Role::Agent { brief: &self.brief, incarnation: self.incarnation };
        let child = launcher.spawn(role, &self.log)?;
        self.seat = Seat::Starting { child, since: Instant::now() };
        Ok(())
    }
}

/// The order in which the first processes are started, drawn from the seed: no result may lean
/// on it. (Fisher and Yates, with xorshift64*.)
pub(crate) fn start_order(seed: u64, robots: usize) -> Vec<usize> {
    let mut order: Vec<usize> = (0..robots).collect();
    let mut state = seed.wrapping_mul(0x9e37_79b9_7f4a_7c15) | 1;
    for last in (1..robots).rev() {
        state ^= state >> 12;
        state ^= state << 25;
        state ^= state >> 27;
        let draw = state.wrapping_mul(0x2545_f491_4f6c_dd1d) >> 33;
        order.swap(last, draw as usize % (last + 1));
    }
    order
}

impl Seat {
    pub(crate) fn child(&self) -> Option<&Child> {
        match self {
            Seat::Starting { child, .. }
            | Seat::Flying { child }
            | Seat::Frozen { child }
            | Seat::Ending { child } => Some(child),
            Seat::Down => None,
        }
    }

    pub(crate) fn child_mut(&mut self) -> Option<&mut Child> {
        match self {
            Seat::Starting { child, .. }
            | Seat::Flying { child }
            | Seat::Frozen { child }
            | Seat::Ending { child } => Some(child),
            Seat::Down => None,
        }
    }

    /// Its first status has come.
    pub(crate) fn has_started(&mut self) {
        *self = match std::mem::replace(self, Seat::Down) {
            Seat::Starting { child, .. } => Seat::Flying { child },
            other => other,
        };
    }

    /// It is stopped; whether there was anybody taking part.
    pub(crate) fn freezes(&mut self) -> bool {
        *self = match std::mem::replace(self, Seat::Down) {
            Seat::Flying { child } => {
                child.stop();
                Seat::Frozen { child }
            }
            other => other,
        };
        matches!(self, Seat::Frozen { .. })
    }

    /// It goes on; whether it was frozen.
    pub(crate) fn thaws(&mut self) -> bool {
        let frozen = matches!(self, Seat::Frozen { .. });
        *self = match std::mem::replace(self, Seat::Down) {
            Seat::Frozen { child } => {
                child.go_on();
                Seat::Flying { child }
            }
            other => other,
        };
        frozen
    }

    /// It is killed on purpose, if there is anybody to kill.
    pub(crate) fn is_killed(&mut self) {
        *self = match std::mem::replace(self, Seat::Down) {
            Seat::Starting { child, .. }
            | Seat::Flying { child }
            | Seat::Frozen { child }
            | Seat::Ending { child } => {
                child.kill();
                Seat::Ending { child }
            }
            other => other,
        };
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_seed_starts_every_robot_once() {
        for seed in 0..50 {
            let mut order = start_order(seed, 9);
            order.sort_unstable();
            assert_eq!(order, (0..9).collect::<Vec<_>>());
        }
        assert_ne!(start_order(1, 9), start_order(2, 9));
    }
}
