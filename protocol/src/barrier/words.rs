//! The words that processes share, and how one sleeps on a word until another process changes it.
//!
//! Whoever waits reads a word, looks at the condition, and sleeps only while the word is the one
//! read; whoever changes the condition changes the word. All accesses are `SeqCst`: a flag set
//! before sleeping and a word changed before looking at the flag must not pass each other. In tests
//! every access can be a step of the model.

use std::sync::atomic::Ordering::SeqCst;
#[cfg(not(test))]
pub(super) use std::sync::atomic::{AtomicU32, AtomicU64};
use std::time::Duration;

use rustix::io::Errno;
use rustix::thread::futex;
use rustix::time::Timespec;

use super::Barrier;
#[cfg(test)]
pub(super) use super::tests::stepped::{AtomicU32, AtomicU64};

/// Whoever waits looks up at least this often.
pub(super) const RECHECK: Duration = Duration::from_millis(50);

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Woken {
    Perhaps,
    TimedOut,
    Signal,
}

impl Barrier {
    /// Sleeps while the word has this value, until the next alarm if there is one; may return early.
    pub(super) fn rest(&self, word: &AtomicU32, value: u32) -> Woken {
        sleep_while(word, value, self.alarm.is_none().then_some(RECHECK))
    }

    /// Sleeps until the condition holds, whose maker changes the word; false once `patience` ends.
    pub(super) fn wait_until(
        &self,
        word: &AtomicU32,
        condition: impl Fn() -> bool,
        mut patience: impl FnMut() -> bool,
    ) -> bool {
        loop {
            let seen = word.load(SeqCst);
            if condition() {
                return true;
            }
            if self.rest(word, seen) != Woken::Perhaps && !patience() {
                return condition();
            }
        }
    }
}

/// Sleeps while the word has this value, at most for the limit; may return early.
pub(super) fn sleep_while(word: &AtomicU32, value: u32, limit: Option<Duration>) -> Woken {
    #[cfg(test)]
    let word = match super::tests::stepped::sleep_while(word, value) {
        Some(woken) => return woken,
        None => word.plain(),
    };
    let limit = limit.map(|limit| Timespec {
        tv_sec: limit.as_secs().min(i32::MAX as u64) as i64,
        tv_nsec: limit.subsec_nanos() as _,
    });
    // Not the private flag: the word is shared between processes.
    match futex::wait(word, futex::Flags::empty(), value, limit.as_ref()) {
        Err(Errno::TIMEDOUT) => Woken::TimedOut,
        Err(Errno::INTR) => Woken::Signal,
        _ => Woken::Perhaps,
    }
}

/// Wakes whoever sleeps on the word.
pub(super) fn wake(word: &AtomicU32) {
    #[cfg(test)]
    let word = match super::tests::stepped::wake(word) {
        true => return,
        false => word.plain(),
    };
    // Fails only for a word that is not mapped.
    let _ = futex::wake(word, futex::Flags::empty(), i32::MAX as u32);
}
