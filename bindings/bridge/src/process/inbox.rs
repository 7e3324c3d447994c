//! What arrives from other hosts, until the bridge's loop takes it: under each key the newest sample, and
//! of what robots told all.
//!
//! zenoh calls from threads of its own; what may not be taken over is dropped and counted right there,
//! so that it displaces nothing.

use std::collections::VecDeque;
use std::sync::{Condvar, Mutex, MutexGuard};
use std::time::Duration;

use protocol::clock;
use protocol::dropped::Dropped;

use crate::frame::Header;
use crate::gate::{Boots, Gate};

/// At most so many batches of what robots told wait; those that find no place are sent again.
const TOLD_MAX: usize = 16;

/// A frame that passed its gate.
#[derive(Debug, Clone)]
pub struct Arrived {
    /// Its place among the routes.
    pub route: usize,
    /// Its header.
    pub header: Header,
    /// What follows it.
    pub content: Vec<u8>,
    /// When it arrived, ns.
    pub at_ns: u64,
}

/// What waits.
pub struct Inbox {
    state: Mutex<State>,
    news: Condvar,
}

struct State {
    /// Of the routes that end here.
    lanes: Vec<Option<Lane>>,
    /// Of all hosts.
    boots: Vec<Boots>,
    /// How many were dropped, by reason.
    dropped: [u64; Dropped::ALL.len()],
    arrived: bool,
}

struct Lane {
    gate: Gate,
    from: usize,
    keeps: usize,
    waiting: VecDeque<Arrived>,
}

impl Inbox {
    /// For so many routes and hosts.
    pub fn new(routes: usize, hosts: usize) -> Inbox {
        let state = State {
            lanes: (0..routes).map(|_| None).collect(),
            boots: vec![Boots::default(); hosts],
            dropped: [0; Dropped::ALL.len()],
            arrived: false,
        };
        Inbox { state: Mutex::new(state), news: Condvar::new() }
    }

    /// Frames of this route from that host are taken over through this gate. `all`: not the newest only.
    pub fn open(&self, route: usize, from: usize, gate: Gate, all: bool) {
        let keeps = if all { TOLD_MAX } else { 1 };
        self.lock().lanes[route] = Some(Lane { gate, from, keeps, waiting: VecDeque::new() });
    }

    /// A frame arrived.
    pub fn put(&self, route: usize, frame: &[u8]) {
        let at_ns = clock::now_ns();
        let mut state = self.lock();
        let State { lanes, boots, dropped, arrived } = &mut *state;
        let Some(lane) = &mut lanes[route] else { return };
        match lane.gate.pass(frame, &mut boots[lane.from]) {
            Ok((header, content)) => {
                if lane.waiting.len() == lane.keeps {
                    if lane.keeps > 1 {
                        return;
                    }
                    lane.waiting.clear();
                }
                lane.waiting.push_back(Arrived { route, header, content: content.to_vec(), at_ns });
                *arrived = true;
                drop(state);
                self.news.notify_one();
            }
            Err(why) => dropped[why as usize] += 1,
        }
    }

    /// Waits until something arrived, at most until that time, ns; takes all of it.
    pub fn wait(&self, until_ns: u64) -> Vec<Arrived> {
        let mut state = self.lock();
        while !state.arrived {
            let left_ns = until_ns.saturating_sub(clock::now_ns());
            if left_ns == 0 {
                break;
            }
            let waited = self.news.wait_timeout(state, Duration::from_nanos(left_ns));
            state = waited.unwrap_or_else(std::sync::PoisonError::into_inner).0;
        }
        state.arrived = false;
        state.lanes.iter_mut().flatten().flat_map(|lane| lane.waiting.drain(..)).collect()
    }

    /// How many were dropped for this reason.
    pub fn dropped(&self, why: Dropped) -> u64 {
        self.lock().dropped[why as usize]
    }

    fn lock(&self) -> MutexGuard<'_, State> {
        // Whoever panicked left nothing half-done.
        self.state.lock().unwrap_or_else(std::sync::PoisonError::into_inner)
    }
}
