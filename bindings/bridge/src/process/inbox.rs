//! Queue of frames from other hosts until the bridge's loop reads them: the newest frame under each key, but all
//! frames with status and latencies.
//!
//! zenoh calls from its own threads; a frame that is refused is dropped and counted at once, so that it displaces
//! no other.

use std::collections::VecDeque;
use std::sync::{Condvar, Mutex, MutexGuard};
use std::time::Duration;

use protocol::clock;
use protocol::dropped::Dropped;

use crate::frame::Header;
use crate::gate::{Boots, Gate};

/// Maximum number of queued frames with status and latencies. Further ones are dropped, and the sender sends them
/// again.
const TOLD_MAX: usize = 16;

/// An accepted frame.
#[derive(Debug, Clone)]
pub struct Arrived {
    /// Index of the route on which the frame arrived.
    pub route: usize,
    /// Header of the frame.
    pub header: Header,
    /// Content of the frame.
    pub content: Vec<u8>,
    /// Time of arrival, ns.
    pub at_ns: u64,
}

/// Queue of frames that have arrived and that the bridge's loop has not read.
pub struct Inbox {
    state: Mutex<State>,
    arrival: Condvar,
}

struct State {
    /// Queue of each route that ends here.
    lanes: Vec<Option<Lane>>,
    /// Current bridge of each host.
    boots: Vec<Boots>,
    /// Number of dropped frames, by reason.
    dropped: [u64; Dropped::ALL.len()],
    arrived: bool,
}

struct Lane {
    gate: Gate,
    sending_host: usize,
    keeps: usize,
    waiting: VecDeque<Arrived>,
}

impl Inbox {
    /// Creates queues for these numbers of routes and hosts.
    pub fn new(routes: usize, hosts: usize) -> Inbox {
        let state = State {
            lanes: (0..routes).map(|_| None).collect(),
            boots: vec![Boots::default(); hosts],
            dropped: [0; Dropped::ALL.len()],
            arrived: false,
        };
        Inbox { state: Mutex::new(state), arrival: Condvar::new() }
    }

    /// Opens the queue of a route for frames of host `from` that pass `gate`. `all`: keep all frames, not only
    /// the newest.
    pub fn open(&self, route: usize, from: usize, gate: Gate, all: bool) {
        let keeps = if all { TOLD_MAX } else { 1 };
        self.lock().lanes[route] =
            Some(Lane { gate, sending_host: from, keeps, waiting: VecDeque::new() });
    }

    /// Adds a frame, or drops it and counts the reason.
    pub fn put(&self, route: usize, frame: &[u8]) {
        let at_ns = clock::now_ns();
        let mut state = self.lock();
        let State { lanes, boots, dropped, arrived } = &mut *state;
        let Some(lane) = &mut lanes[route] else { return };
        match lane.gate.accept_frame(frame, &mut boots[lane.sending_host]) {
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
                self.arrival.notify_one();
            }
            Err(why) => dropped[why as usize] += 1,
        }
    }

    /// Waits until a frame arrives, at most until `until_ns`. Returns all queued frames.
    pub fn wait(&self, until_ns: u64) -> Vec<Arrived> {
        let mut state = self.lock();
        while !state.arrived {
            let left_ns = until_ns.saturating_sub(clock::now_ns());
            if left_ns == 0 {
                break;
            }
            let waited = self.arrival.wait_timeout(state, Duration::from_nanos(left_ns));
            state = waited.unwrap_or_else(std::sync::PoisonError::into_inner).0;
        }
        state.arrived = false;
        state.lanes.iter_mut().flatten().flat_map(|lane| lane.waiting.drain(..)).collect()
    }

    /// Returns the number of frames dropped for this reason.
    pub fn dropped_count(&self, why: Dropped) -> u64 {
        self.lock().dropped[why as usize]
    }

    fn lock(&self) -> MutexGuard<'_, State> {
        // After a panic in another thread the state is still consistent.
        self.state.lock().unwrap_or_else(std::sync::PoisonError::into_inner)
    }
}
