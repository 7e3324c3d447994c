//! How supervisor and server hand things to each other: a letter box of one frame, one table of
//! latencies and a bounded list of events, and a bounded queue of requests the other way.
//!
//! The supervisor never waits here. The server's thread gives way to every other, so it may be held
//! up for long with the box open: then the supervisor keeps what it has and tries again.

use std::collections::VecDeque;
use std::sync::Mutex;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::time::Instant;

use outcome::report::scene::Frame;
use serde::Serialize;

/// So many events are kept for clients that come later; the oldest give way.
pub(crate) const HAPPENED_MAX: usize = 256;
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

/// What lies in the box.
#[derive(Debug, Default)]
pub(crate) struct Letters {
    pub(crate) frame: Option<Handed>,
    pub(crate) happened: VecDeque<Happened>,
    pub(crate) latency: Option<Vec<StageNow>>,
    pub(crate) ended: Option<Ended>,
}

/// The box, and how many clients are told of the run.
#[derive(Debug, Default)]
pub(crate) struct Post {
    letters: Mutex<Letters>,
    clients: AtomicUsize,
}

impl Post {
    /// Puts something in, if the box is free; whether it was. Never waits.
    pub(crate) fn put(&self, into: impl FnOnce(&mut Letters)) -> bool {
        let letters = self.letters.try_lock();
        letters.map(|mut letters| into(&mut letters)).is_ok()
    }

    /// Empties the box. The server only.
    pub(crate) fn take(&self) -> Letters {
        // A supervisor that panicked has nothing more to say.
        self.letters.lock().map(|mut letters| std::mem::take(&mut *letters)).unwrap_or_default()
    }

    /// How many clients are told of the run.
    pub(crate) fn clients(&self) -> usize {
        self.clients.load(Ordering::Relaxed)
    }

    /// Lets one more client be told, if there is room. The server's one thread only.
    pub(crate) fn seat(self: &std::sync::Arc<Post>) -> Option<Seat> {
        (self.clients() < CLIENTS_MAX).then(|| {
            self.clients.fetch_add(1, Ordering::Relaxed);
            Seat(self.clone())
        })
    }
}

/// A client's place, free again once it is gone.
#[derive(Debug)]
pub(crate) struct Seat(std::sync::Arc<Post>);

impl Drop for Seat {
    fn drop(&mut self) {
        self.0.clients.fetch_sub(1, Ordering::Relaxed);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::sync::Arc;

    #[test]
    fn whoever_finds_the_box_taken_goes_on_at_once() {
        let post = Post::default();
        let held = post.letters.lock().unwrap();
        assert!(!post.put(|_| panic!("it is taken")));
        drop(held);
        assert!(post.put(|letters| letters.latency = Some(Vec::new())));
        assert!(post.take().latency.is_some());
        assert!(post.take().latency.is_none());
    }

    #[test]
    fn there_is_room_for_so_many_clients_and_for_others_once_they_leave() {
        let post = Arc::new(Post::default());
        let mut seats: Vec<Seat> = (0..CLIENTS_MAX).map(|_| post.seat().unwrap()).collect();
        assert!(post.seat().is_none());
        seats.pop();
        assert!(post.seat().is_some());
        drop(seats);
        assert_eq!(post.clients(), 0);
    }
}
