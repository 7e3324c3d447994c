//! Queue of frames from other hosts until the bridge's loop reads them: the newest frame under each key, but all
//! frames with status and latencies.
//!
//! zenoh calls from its own threads; a frame that is refused is dropped and counted at once, so that it displaces
//! no other.

use std::collections::VecDeque;
use std::sync::{Condvar, Mutex, MutexGuard};
use std::time::Duration;

use protocol::clock;
use protocol::dropped::DropReason;

use crate::frame::FrameHeader;
use crate::gate::{BridgeBoots, FrameFilter};

/// Maximum number of queued frames with status and latencies. Further ones are dropped, and the sender sends them
/// again.
const QUEUED_STATUS_FRAMES_MAX: usize = 16;

/// An accepted frame.
#[derive(Debug, Clone)]
pub struct ReceivedFrame {
    /// Index of the route on which the frame arrived.
    pub route: usize,
    /// Header of the frame.
    pub header: FrameHeader,
    /// Content of the frame.
    pub content: Vec<u8>,
    /// Time of arrival, ns.
    pub arrival_ns: u64,
}

/// Queue of frames that have arrived and that the bridge's loop has not read.
pub struct Inbox {
    state: Mutex<InboxState>,
    arrival: Condvar,
}

struct InboxState {
    /// Queue of each route that ends here.
    route_queues: Vec<Option<RouteQueue>>,
    /// Current bridge of each host.
    boots: Vec<BridgeBoots>,
    /// Number of dropped frames, by reason.
    dropped_counts: [u64; DropReason::ALL.len()],
    has_frames: bool,
}

struct RouteQueue {
    filter: FrameFilter,
    sending_host: usize,
    capacity: usize,
    frames: VecDeque<ReceivedFrame>,
}

impl Inbox {
    /// Creates queues for these numbers of routes and hosts.
    pub fn new(routes: usize, hosts: usize) -> Inbox {
        let state = InboxState {
            route_queues: (0..routes).map(|_| None).collect(),
            boots: vec![BridgeBoots::default(); hosts],
            dropped_counts: [0; DropReason::ALL.len()],
            has_frames: false,
        };
        Inbox { state: Mutex::new(state), arrival: Condvar::new() }
    }

    /// Opens the queue of a route for frames of host `from` that pass `filter`. `all`: keep all frames, not only
    /// the newest.
    pub fn open_route(&self, route: usize, from: usize, filter: FrameFilter, all: bool) {
        let capacity = if all { QUEUED_STATUS_FRAMES_MAX } else { 1 };
        self.lock().route_queues[route] =
            Some(RouteQueue { filter, sending_host: from, capacity, frames: VecDeque::new() });
    }

    /// Adds a frame, or drops it and counts the reason.
    pub fn push_frame(&self, route: usize, frame: &[u8]) {
        let arrival_ns = clock::now_ns();
        let mut state = self.lock();
        let InboxState { route_queues, boots, dropped_counts, has_frames } = &mut *state;
        let Some(queue) = &mut route_queues[route] else { return };
        match queue.filter.accept_frame(frame, &mut boots[queue.sending_host]) {
            Ok((header, content)) => {
                if queue.frames.len() == queue.capacity {
                    if queue.capacity > 1 {
                        return;
                    }
                    queue.frames.clear();
                }
                queue.frames.push_back(ReceivedFrame {
                    route,
                    header,
                    content: content.to_vec(),
                    arrival_ns,
                });
                *has_frames = true;
                drop(state);
                self.arrival.notify_one();
            }
            Err(reason) => dropped_counts[reason as usize] += 1,
        }
    }

    /// Waits until a frame arrives, at most until `until_ns`. Returns all queued frames.
    pub fn wait_for_frames(&self, until_ns: u64) -> Vec<ReceivedFrame> {
        let mut state = self.lock();
        while !state.has_frames {
            let left_ns = until_ns.saturating_sub(clock::now_ns());
            if left_ns == 0 {
                break;
            }
            let waited = self.arrival.wait_timeout(state, Duration::from_nanos(left_ns));
            state = waited.unwrap_or_else(std::sync::PoisonError::into_inner).0;
        }
        state.has_frames = false;
        state.route_queues.iter_mut().flatten().flat_map(|queue| queue.frames.drain(..)).collect()
    }

    /// Returns the number of frames dropped for this reason.
    pub fn dropped_count(&self, reason: DropReason) -> u64 {
        self.lock().dropped_counts[reason as usize]
    }

    fn lock(&self) -> MutexGuard<'_, InboxState> {
        // After a panic in another thread the state is still consistent.
        self.state.lock().unwrap_or_else(std::sync::PoisonError::into_inner)
    }
}
