//! The supervisor's end: what it hands over, and when. Nothing here waits, but for the farewell.
//!
//! The server's thread gives way to every other, so it may be held up for long: what there is no room for is kept
//! here, or dropped.

use std::collections::VecDeque;
use std::sync::Arc;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::mpsc::Receiver;
use std::time::{Duration, Instant, SystemTime, UNIX_EPOCH};

use outcome::report::scene::Frame;
use serde::Serialize;
use tokio::sync::mpsc::Sender;
use tokio::sync::mpsc::error::TrySendError;

use crate::view::act::Request;

/// At most 20 frames a second: enough for the eye.
const FRAME_EVERY: Duration = Duration::from_millis(50);
/// Latencies change slowly, and take time to sum up.
const LATENCY_EVERY: Duration = Duration::from_secs(1);
/// The farewell may take this long.
const LANDED_MAX: Duration = Duration::from_millis(1500);
/// So many events are kept for clients that come later; the oldest give way.
pub(crate) const HAPPENED_MAX: usize = 256;
/// So much may be on its way to the server.
pub(crate) const LETTERS_MAX: usize = 64;
/// Clients that are told of the run at once.
const CLIENTS_MAX: usize = 16;

/// An event of the run.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Happened {
    /// Run time, s.
    pub t_s: f64,
    /// As in `events.csv`.
    pub kind: String,
    /// To whom; empty where it was nobody in particular.
    pub robot: String,
    /// More about it.
    pub detail: String,
}

/// How late one stage of the loop is so far, where it is latest.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct StageNow {
    /// As in `latency.csv`.
    pub stage: String,
    /// The robot or edge that fares worst.
    pub worst: String,
    /// Half of its values are at most this, us.
    pub p50_us: f64,
    /// 99 % of them.
    pub p99_us: f64,
    /// The largest, us.
    pub max_us: f64,
    /// How many values.
    pub count: u64,
}

/// How the run ended.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub(crate) struct Ended {
    /// Its exit code.
    pub(crate) exit: u8,
    /// What it prints.
    pub(crate) text: String,
}

/// A frame on its way.
#[derive(Debug, Clone)]
pub(crate) struct Handed {
    /// Counts up.
    pub(crate) number: u64,
    pub(crate) at: Instant,
    pub(crate) at_unix_ms: u64,
    pub(crate) frame: Frame,
}

/// What is handed over.
#[derive(Debug)]
pub(crate) enum Letter {
    Frame(Handed),
    Happened(Happened),
    Latency(Vec<StageNow>),
    Ended(Ended),
}

/// How many clients are told of the run.
#[derive(Debug, Default)]
pub(crate) struct Clients(AtomicUsize);

/// A client's place, free again once it is gone.
#[derive(Debug)]
pub(crate) struct Seat(Arc<Clients>);

impl Clients {
    pub(crate) fn count(&self) -> usize {
        self.0.load(Ordering::Relaxed)
    }

    /// Lets one more client be told, if there is room. The server's one thread only.
    pub(crate) fn seat(self: &Arc<Clients>) -> Option<Seat> {
        (self.count() < CLIENTS_MAX).then(|| {
            self.0.fetch_add(1, Ordering::Relaxed);
            Seat(self.clone())
        })
    }
}

impl Drop for Seat {
    fn drop(&mut self) {
        self.0.0.fetch_sub(1, Ordering::Relaxed);
    }
}

/// The supervisor's end of the live view.
#[derive(Debug)]
pub struct View {
    letters: Sender<Letter>,
    clients: Arc<Clients>,
    /// Clients may act.
    control: bool,
    requests: Receiver<Request>,
    /// Closed when the server is gone.
    gone: Receiver<()>,
    /// Events that are yet to be handed over: nobody has come to see them, or there was no room.
    happened: VecDeque<Happened>,
    pub(crate) frames: u64,
    frame_due: Instant,
    latency_due: Instant,
}

impl View {
    pub(crate) fn new(
        letters: Sender<Letter>,
        clients: Arc<Clients>,
        control: bool,
        requests: Receiver<Request>,
        gone: Receiver<()>,
    ) -> View {
        let now = Instant::now();
        View {
            letters,
            clients,
            control,
            requests,
            gone,
            happened: VecDeque::new(),
            frames: 0,
            frame_due: now,
            latency_due: now,
        }
    }

    /// Whether clients may act.
    pub fn takes_requests(&self) -> bool {
        self.control
    }

    /// How many clients are told of the run.
    pub(crate) fn clients(&self) -> usize {
        self.clients.count()
    }

    /// Whether anybody looks. If not, there is no need to make anything.
    pub fn is_watched(&self) -> bool {
        self.clients() > 0
    }

    /// Whether somebody looks and the next frame is due.
    pub fn wants_frame(&self, now: Instant) -> bool {
        self.is_watched() && now >= self.frame_due
    }

    /// Hands over a frame, if there is room.
    pub fn frame(&mut self, frame: Frame) {
        let at = Instant::now();
        let since_1970 = SystemTime::now().duration_since(UNIX_EPOCH).unwrap_or_default();
        let at_unix_ms = since_1970.as_millis() as u64;
        let number = self.frames + 1;
        let handed = Letter::Frame(Handed { number, at, at_unix_ms, frame });
        if self.letters.try_send(handed).is_ok() {
            self.frames = number;
            self.frame_due = at + FRAME_EVERY;
        }
    }

    /// Whether somebody looks and latencies are due.
    pub fn wants_latency(&self, now: Instant) -> bool {
        self.is_watched() && now >= self.latency_due
    }

    /// Hands over how late every stage is, if there is room.
    pub fn latency(&mut self, stages: Vec<StageNow>) {
        if self.letters.try_send(Letter::Latency(stages)).is_ok() {
            self.latency_due = Instant::now() + LATENCY_EVERY;
        }
    }

    /// Keeps an event for whoever looks, now or later.
    pub fn happened(&mut self, happened: Happened) {
        if self.happened.len() == HAPPENED_MAX {
            self.happened.pop_front();
        }
        self.happened.push_back(happened);
    }

    /// Hands over the events that were kept, as far as there is room, if somebody looks.
    pub fn pass_on(&mut self) {
        while self.is_watched()
            && let Some(happened) = self.happened.pop_front()
        {
            if let Err(TrySendError::Full(Letter::Happened(happened))) =
                self.letters.try_send(Letter::Happened(happened))
            {
                self.happened.push_front(happened);
                return;
            }
        }
    }

    /// The next thing that a client asks for.
    pub fn request(&self) -> Option<Request> {
        self.requests.try_recv().ok()
    }

    /// Tells everybody how the run ended, and ends the server; waits for that, but not for long, and
    /// not if nobody looks. `text`: what the run prints.
    pub fn ended(mut self, exit: u8, text: &str) {
        let end = Instant::now() + LANDED_MAX;
        loop {
            self.pass_on();
            let ended = Letter::Ended(Ended { exit, text: text.into() });
            let full = matches!(self.letters.try_send(ended), Err(TrySendError::Full(_)));
            if !full || Instant::now() > end {
                break;
            }
            std::thread::sleep(Duration::from_millis(1));
        }
        // No more requests: whoever still waits for an answer hears that the run is over.
        drop(self.requests);
        if self.clients.count() > 0 {
            // It says nothing; it is gone, or takes too long.
            let _ = self.gone.recv_timeout(end.saturating_duration_since(Instant::now()));
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_happens_before_anybody_looks_is_kept_and_bounded_and_nobody_waits_for_the_server() {
        let (letters, mut taken) = tokio::sync::mpsc::channel(LETTERS_MAX);
        let (clients, requests) = (Arc::new(Clients::default()), std::sync::mpsc::channel().1);
        let gone = std::sync::mpsc::channel().1;
        let mut view = View::new(letters, clients.clone(), false, requests, gone);
        for number in 0..2 * HAPPENED_MAX {
            let detail = number.to_string();
            view.happened(Happened { t_s: 0.0, kind: "kill".into(), robot: "".into(), detail });
        }
        view.pass_on();
        assert!(taken.is_empty() && !view.wants_frame(Instant::now()), "nobody looks");
        let seats: Vec<Seat> = (0..CLIENTS_MAX).map(|_| clients.seat().unwrap()).collect();
        assert!(clients.seat().is_none() && view.wants_frame(Instant::now()));
        let mut details = Vec::new();
        // The server is held up again and again.
        while details.len() < HAPPENED_MAX {
            view.pass_on();
            view.frame(Frame::default());
            while let Ok(Letter::Happened(happened)) = taken.try_recv() {
                details.push(happened.detail.parse::<usize>().unwrap());
            }
        }
        assert_eq!(details, Vec::from_iter(HAPPENED_MAX..2 * HAPPENED_MAX));
        drop(seats);
        assert!(!view.is_watched());
    }
}
