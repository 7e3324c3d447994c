//! Supervisor side of the live view: the data passed to the server thread, and when. No function waits,
//! except at the end of the run.
//!
//! The server thread has the lowest priority and may be delayed for long. Events that the queue has no
//! space for wait here; frames are dropped.

use std::collections::VecDeque;
use std::sync::Arc;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::mpsc::Receiver;
use std::time::{Duration, Instant, SystemTime, UNIX_EPOCH};

use outcome::report::scene::SceneFrame;
use serde::Serialize;
use tokio::sync::mpsc::Sender;
use tokio::sync::mpsc::error::TrySendError;

use crate::view::act::ClientRequest;

/// Minimum interval between frames: at most 20 per second.
const FRAME_INTERVAL_MIN: Duration = Duration::from_millis(50);
/// Interval of latency summaries, which change slowly and are expensive to compute.
const LATENCY_SUMMARY_INTERVAL: Duration = Duration::from_secs(1);
/// Maximum time to wait for the server to send the last message.
const SHUTDOWN_TIMEOUT: Duration = Duration::from_millis(1500);
/// Maximum number of events kept for clients that connect later. The oldest are dropped.
pub(crate) const EVENTS_MAX: usize = 256;
/// Capacity of the queue to the server thread, in messages. Frames are dropped when it is full.
pub(crate) const VIEW_QUEUE_CAPACITY: usize = 64;
/// Maximum number of clients that receive events.
const CLIENTS_MAX: usize = 16;

/// Event of the run.
#[derive(Debug, Clone, Default, PartialEq, Serialize)]
pub struct RunEvent {
    /// Run time, s.
    pub t_s: f64,
    /// Kind, as in `events.csv`.
    pub kind: String,
    /// Name of the robot; empty for an event of the whole run.
    pub robot: String,
    /// Details of the event.
    pub detail: String,
    /// Name of the other robot, as in `events.csv`.
    pub other: String,
}

/// Latency so far of one stage of the loop, where it is largest.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct StageLatency {
    /// Stage, as in `latency.csv`.
    pub stage: String,
    /// Robot or edge with the largest latency.
    pub worst: String,
    /// Median, us.
    pub p50_us: f64,
    /// 99th percentile, us.
    pub p99_us: f64,
    /// Maximum, us.
    pub max_us: f64,
    /// Number of values.
    pub count: u64,
}

/// End of the run.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub(crate) struct RunEnd {
    /// Exit code of the run.
    pub(crate) exit: u8,
    /// Text that the run prints.
    pub(crate) text: String,
}

/// Frame in the queue.
#[derive(Debug, Clone)]
pub(crate) struct NumberedFrame {
    /// Frame number, increasing by one.
    pub(crate) number: u64,
    pub(crate) creation_time: Instant,
    pub(crate) unix_time_ms: u64,
    pub(crate) frame: SceneFrame,
}

/// Message to the server thread.
#[derive(Debug)]
pub(crate) enum ViewMessage {
    Frame(NumberedFrame),
    Event(RunEvent),
    Latency(Vec<StageLatency>),
    RunEnd(RunEnd),
}

/// Number of connected clients.
#[derive(Debug, Default)]
pub(crate) struct ClientCount(AtomicUsize);

/// Permit of one client; dropping it allows another.
#[derive(Debug)]
pub(crate) struct ClientPermit(Arc<ClientCount>);

impl ClientCount {
    pub(crate) fn count(&self) -> usize {
        self.0.load(Ordering::Relaxed)
    }

    /// Returns a permit for one more client; `None` if [`CLIENTS_MAX`] are connected. Called by the single
    /// server thread only.
    pub(crate) fn acquire_client_permit(self: &Arc<ClientCount>) -> Option<ClientPermit> {
        (self.count() < CLIENTS_MAX).then(|| {
            self.0.fetch_add(1, Ordering::Relaxed);
            ClientPermit(self.clone())
        })
    }
}

impl Drop for ClientPermit {
    fn drop(&mut self) {
        self.0.0.fetch_sub(1, Ordering::Relaxed);
    }
}

/// Supervisor side of the live view.
#[derive(Debug)]
pub struct View {
    messages: Sender<ViewMessage>,
    clients: Arc<ClientCount>,
    /// Whether clients may send requests.
    accepts_control: bool,
    requests: Receiver<ClientRequest>,
    /// Disconnected when the server has exited.
    server_exit: Receiver<()>,
    /// Events that have not been passed to the server, because no client is connected or the queue was full.
    events: VecDeque<RunEvent>,
    pub(crate) frame_count: u64,
    frame_due_time: Instant,
    latency_due_time: Instant,
}

impl View {
    pub(crate) fn new(
        messages: Sender<ViewMessage>,
        clients: Arc<ClientCount>,
        accepts_control: bool,
        requests: Receiver<ClientRequest>,
        server_exit: Receiver<()>,
    ) -> View {
        let now = Instant::now();
        View {
            messages,
            clients,
            accepts_control,
            requests,
            server_exit,
            events: VecDeque::new(),
            frame_count: 0,
            frame_due_time: now,
            latency_due_time: now,
        }
    }

    /// Returns whether clients may send requests.
    pub fn takes_requests(&self) -> bool {
        self.accepts_control
    }

    /// Returns the number of connected clients.
    pub(crate) fn client_count(&self) -> usize {
        self.clients.count()
    }

    /// Returns whether a client is connected. Without one, no frames need to be made.
    pub fn is_watched(&self) -> bool {
        self.client_count() > 0
    }

    /// Returns whether a client is connected and the next frame is due.
    pub fn is_frame_due(&self, now: Instant) -> bool {
        self.is_watched() && now >= self.frame_due_time
    }

    /// Passes a frame to the server. Drops it if the queue is full.
    pub fn send_frame(&mut self, frame: SceneFrame) {
        let creation_time = Instant::now();
        let unix_time = SystemTime::now().duration_since(UNIX_EPOCH).unwrap_or_default();
        let unix_time_ms = unix_time.as_millis() as u64;
        let number = self.frame_count + 1;
        let message =
            ViewMessage::Frame(NumberedFrame { number, creation_time, unix_time_ms, frame });
        if self.messages.try_send(message).is_ok() {
            self.frame_count = number;
            self.frame_due_time = creation_time + FRAME_INTERVAL_MIN;
        }
    }

    /// Returns whether a client is connected and a latency summary is due.
    pub fn is_latency_due(&self, now: Instant) -> bool {
        self.is_watched() && now >= self.latency_due_time
    }

    /// Passes a latency summary to the server. Drops it if the queue is full.
    pub fn send_latency(&mut self, stages: Vec<StageLatency>) {
        if self.messages.try_send(ViewMessage::Latency(stages)).is_ok() {
            self.latency_due_time = Instant::now() + LATENCY_SUMMARY_INTERVAL;
        }
    }

    /// Stores an event for present and later clients. Drops the oldest if `EVENTS_MAX` are stored.
    pub fn record_event(&mut self, event: RunEvent) {
        if self.events.len() == EVENTS_MAX {
            self.events.pop_front();
        }
        self.events.push_back(event);
    }

    /// Passes the stored events to the server, as far as the queue has space, if a client is connected.
    pub fn flush_events(&mut self) {
        while self.is_watched()
            && let Some(event) = self.events.pop_front()
        {
            if let Err(TrySendError::Full(ViewMessage::Event(event))) =
                self.messages.try_send(ViewMessage::Event(event))
            {
                self.events.push_front(event);
                return;
            }
        }
    }

    /// Returns the next request of a client.
    pub fn next_request(&self) -> Option<ClientRequest> {
        self.requests.try_recv().ok()
    }

    /// Sends the end of the run to all clients and stops the server. Waits at most `SHUTDOWN_TIMEOUT`, and not
    /// at all without clients. `text` is what the run prints.
    pub fn send_end_of_run(mut self, exit: u8, text: &str) {
        let deadline = Instant::now() + SHUTDOWN_TIMEOUT;
        loop {
            self.flush_events();
            let message = ViewMessage::RunEnd(RunEnd { exit, text: text.into() });
            let is_full = matches!(self.messages.try_send(message), Err(TrySendError::Full(_)));
            if !is_full || Instant::now() > deadline {
                break;
            }
            std::thread::sleep(Duration::from_millis(1));
        }
        // Clients that wait for a response learn that the run is over.
        drop(self.requests);
        if self.clients.count() > 0 {
            // The server sends nothing: this returns when it exits or at the timeout.
            let _ =
                self.server_exit.recv_timeout(deadline.saturating_duration_since(Instant::now()));
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn events_before_the_first_client_are_kept_up_to_a_maximum() {
        let (messages, mut received) = tokio::sync::mpsc::channel(VIEW_QUEUE_CAPACITY);
        let (clients, requests) = (Arc::new(ClientCount::default()), std::sync::mpsc::channel().1);
        let server_exit = std::sync::mpsc::channel().1;
        let mut view = View::new(messages, clients.clone(), false, requests, server_exit);
        for number in 0..2 * EVENTS_MAX {
            let detail = number.to_string();
            view.record_event(RunEvent { kind: "kill".into(), detail, ..RunEvent::default() });
        }
        view.flush_events();
        assert!(
            received.is_empty() && !view.is_frame_due(Instant::now()),
            "no client is connected"
        );
        let permits: Vec<ClientPermit> =
            (0..CLIENTS_MAX).map(|_| clients.acquire_client_permit().unwrap()).collect();
        assert!(clients.acquire_client_permit().is_none() && view.is_frame_due(Instant::now()));
        let mut details = Vec::new();
        // The server is delayed repeatedly.
        while details.len() < EVENTS_MAX {
            view.flush_events();
            view.send_frame(SceneFrame::default());
            while let Ok(ViewMessage::Event(event)) = received.try_recv() {
                details.push(event.detail.parse::<usize>().unwrap());
            }
        }
        assert_eq!(details, Vec::from_iter(EVENTS_MAX..2 * EVENTS_MAX));
        drop(permits);
        assert!(!view.is_watched());
    }
}
