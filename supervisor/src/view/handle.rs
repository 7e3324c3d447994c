//! The supervisor's end: what it hands over, and when. Nothing here waits, but for the farewell.

use std::collections::VecDeque;
use std::sync::Arc;
use std::sync::mpsc::Receiver;
use std::time::{Duration, Instant, SystemTime, UNIX_EPOCH};

use outcome::report::scene::Frame;

use crate::view::act::Request;
use crate::view::post::{Ended, HAPPENED_MAX, Handed, Happened, Post, StageNow};

/// At most 20 frames a second: enough for the eye.
const FRAME_EVERY: Duration = Duration::from_millis(50);
/// Latencies change slowly, and take time to sum up.
const LATENCY_EVERY: Duration = Duration::from_secs(1);
/// The farewell may take this long.
const LANDED_MAX: Duration = Duration::from_millis(1500);

/// The supervisor's end of the live view.
#[derive(Debug)]
pub struct View {
    pub(crate) post: Arc<Post>,
    /// Clients may act.
    control: bool,
    requests: Receiver<Request>,
    /// Closed when the server is gone.
    gone: Receiver<()>,
    /// Events that are yet to be handed over: nobody has come to see them, or the box was taken.
    happened: VecDeque<Happened>,
    pub(crate) frames: u64,
    frame_due: Instant,
    latency_due: Instant,
}

impl View {
    pub(crate) fn new(
        post: Arc<Post>,
        control: bool,
        requests: Receiver<Request>,
        gone: Receiver<()>,
    ) -> View {
        let now = Instant::now();
        View {
            post,
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

    /// Whether anybody looks. If not, there is no need to make anything.
    pub fn is_watched(&self) -> bool {
        self.post.clients() > 0
    }

    /// Whether somebody looks and the next frame is due.
    pub fn wants_frame(&self, now: Instant) -> bool {
        self.is_watched() && now >= self.frame_due
    }

    /// Hands over a frame; it takes the place of one that was not yet fetched.
    pub fn frame(&mut self, frame: Frame) {
        let at = Instant::now();
        let since_1970 = SystemTime::now().duration_since(UNIX_EPOCH).unwrap_or_default();
        let at_unix_ms = since_1970.as_millis() as u64;
        let number = self.frames + 1;
        let handed = Handed { number, at, at_unix_ms, frame };
        if self.post.put(|letters| letters.frame = Some(handed)) {
            self.frames = number;
            self.frame_due = at + FRAME_EVERY;
        }
    }

    /// Whether somebody looks and latencies are due.
    pub fn wants_latency(&self, now: Instant) -> bool {
        self.is_watched() && now >= self.latency_due
    }

    /// Hands over how late every stage is.
    pub fn latency(&mut self, stages: Vec<StageNow>) {
        if self.post.put(|letters| letters.latency = Some(stages)) {
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

    /// Hands over the events that were kept, if somebody looks.
    pub fn pass_on(&mut self) {
        if !self.happened.is_empty() && self.is_watched() {
            let kept = &mut self.happened;
            self.post.put(|letters| {
                letters.happened.append(kept);
                let spare = letters.happened.len().saturating_sub(HAPPENED_MAX);
                letters.happened.drain(..spare);
            });
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
        self.pass_on();
        let mut ended = Some(Ended { exit, text: text.into() });
        while !self.post.put(|letters| letters.ended = ended.take()) && Instant::now() < end {
            std::thread::sleep(Duration::from_millis(1));
        }
        // No more requests: whoever still waits for an answer hears that the run is over.
        drop(self.requests);
        if self.post.clients() > 0 {
            // It says nothing; it is gone, or takes too long.
            let _ = self.gone.recv_timeout(end.saturating_duration_since(Instant::now()));
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::sync::mpsc::channel;

    fn view() -> (Arc<Post>, View) {
        let post = Arc::new(Post::default());
        (post.clone(), View::new(post, false, channel().1, channel().1))
    }

    #[test]
    fn a_frame_takes_the_place_of_one_that_nobody_fetched() {
        let (post, mut view) = view();
        assert!(!view.wants_frame(Instant::now()), "nobody looks");
        let _seat = post.seat().unwrap();
        assert!(view.wants_frame(Instant::now()));
        for t_s in [1.0, 2.0] {
            view.frame(Frame { t_s, ..Frame::default() });
        }
        assert!(!view.wants_frame(Instant::now() - FRAME_EVERY), "it is not due");
        let frame = post.take().frame.unwrap();
        assert_eq!((frame.number, frame.frame.t_s), (2, 2.0));
    }

    #[test]
    fn what_happens_before_anybody_looks_is_kept_and_bounded() {
        let (post, mut view) = view();
        for number in 0..2 * HAPPENED_MAX {
            let detail = number.to_string();
            view.happened(Happened { t_s: 0.0, kind: "kill".into(), robot: "".into(), detail });
        }
        view.pass_on();
        assert!(post.take().happened.is_empty(), "nobody looks");
        let _seat = post.seat().unwrap();
        view.pass_on();
        let happened = post.take().happened;
        assert_eq!(happened.len(), HAPPENED_MAX);
        assert_eq!(happened[0].detail, HAPPENED_MAX.to_string());
        view.pass_on();
        assert!(post.take().happened.is_empty(), "once");
    }
}
