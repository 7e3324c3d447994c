//! Shared futex words, and sleeping on a word until another process changes it.
//!
//! A waiting process reads a word, evaluates the condition, and sleeps only while the word still has the value it
//! read; a process that changes the condition changes the word too. All accesses are `SeqCst`: setting a flag
//! before sleeping and changing a word before reading the flag must not be reordered. In tests every access can
//! be a step of the model.

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

/// Maximum time between two evaluations of the condition by a waiting process without an alarm.
pub(super) const RECHECK_INTERVAL: Duration = Duration::from_millis(50);

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum WakeReason {
    WordMayHaveChanged,
    TimedOut,
    Signal,
}

impl Barrier {
    /// Sleeps while the word has this value, until the next alarm if there is one; may return early.
    pub(super) fn sleep_while_unchanged(&self, word: &AtomicU32, value: u32) -> WakeReason {
        sleep_while(word, value, self.alarm.is_none().then_some(RECHECK_INTERVAL))
    }

    /// Sleeps until the condition holds. The process that makes it true must change the word. Returns `false`
    /// once `keep_waiting` does and the condition still does not hold.
    pub(super) fn wait_until(
        &self,
        word: &AtomicU32,
        condition: impl Fn() -> bool,
        mut keep_waiting: impl FnMut() -> bool,
    ) -> bool {
        loop {
            let seen = word.load(SeqCst);
            if condition() {
                return true;
            }
            if self.sleep_while_unchanged(word, seen) != WakeReason::WordMayHaveChanged
                && !keep_waiting()
            {
                return condition();
            }
        }
    }
}

/// Sleeps while the word has this value, at most for `limit`; may return early.
pub(super) fn sleep_while(word: &AtomicU32, value: u32, limit: Option<Duration>) -> WakeReason {
    #[cfg(test)]
    let word = match super::tests::stepped::sleep_while(word, value) {
        Some(reason) => return reason,
        None => word.plain(),
    };
    let limit = limit.map(|limit| Timespec {
        tv_sec: limit.as_secs().min(i32::MAX as u64) as i64,
        tv_nsec: limit.subsec_nanos() as _,
    });
    // Without the private flag, because the word is shared between processes.
    match futex::wait(word, futex::Flags::empty(), value, limit.as_ref()) {
        Err(Errno::TIMEDOUT) => WakeReason::TimedOut,
        Err(Errno::INTR) => WakeReason::Signal,
        _ => WakeReason::WordMayHaveChanged,
    }
}

/// Wakes all processes that sleep on the word.
pub(super) fn wake_waiters(word: &AtomicU32) {
    #[cfg(test)]
    let word = match super::tests::stepped::wake(word) {
        true => return,
        false => word.plain(),
    };
    // Fails only if the word is not mapped.
    let _ = futex::wake(word, futex::Flags::empty(), i32::MAX as u32);
}
