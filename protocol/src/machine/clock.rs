//! The monotonic clock, and a timer with absolute deadlines.
//!
//! Must not: compare clocks of two machines, catch up on missed periods, or use wall time.

use std::num::NonZeroU64;

use rustix::thread::{ClockId, clock_nanosleep_absolute};
use rustix::time::Timespec;

use crate::wake::WakeUp;

const NS_PER_S: u64 = 1_000_000_000;

/// Returns the CLOCK_MONOTONIC time, ns.
#[inline]
pub fn now_ns() -> u64 {
    // The C library is used because rustix looks up the vDSO itself, which valgrind does not provide.
    let mut now = libc::timespec { tv_sec: 0, tv_nsec: 0 };
    // SAFETY: it writes all of `now`; this clock always exists.
    unsafe { libc::clock_gettime(libc::CLOCK_MONOTONIC, &mut now) };
    now.tv_sec as u64 * NS_PER_S + now.tv_nsec as u64
}

/// Returns the number of kernel ticks in a second of CPU time.
pub fn ticks_per_s() -> u64 {
    // SAFETY: the call has no preconditions.
    let ticks = unsafe { libc::sysconf(libc::_SC_CLK_TCK) };
    u64::try_from(ticks).unwrap_or_default().max(1)
}

/// Sets the minimum timer slack for this thread: the kernel's default delays each wake-up by 50 us.
pub fn tighten_timer_slack() {
    if let Err(error) = rustix::thread::set_current_timer_slack(NonZeroU64::new(1)) {
        tracing::warn!(%error, "timer slack stays at the kernel's default; wake-ups are 50 us later");
    }
}

/// Periodic timer with absolute deadlines at the multiples of a period plus a phase. Missed deadlines are
/// skipped.
#[derive(Debug)]
pub struct Timer {
    period_ns: u64,
    phase_ns: u64,
    due_ns: u64,
}

impl Timer {
    /// Creates a timer whose first deadline is the first one in the future.
    ///
    /// # Panics
    ///
    /// If the period is 0.
    pub fn new(period_ns: u64, phase_ns: u64) -> Timer {
        assert!(period_ns > 0, "a timer's period must be positive");
        let phase_ns = phase_ns % period_ns;
        Timer { period_ns, phase_ns, due_ns: first_deadline_after(now_ns(), period_ns, phase_ns) }
    }

    /// Returns the deadline of the next wait, ns.
    #[inline]
    pub fn due_ns(&self) -> u64 {
        self.due_ns
    }

    /// Sleeps until the deadline. Returns `None`, with the deadline unchanged, if a signal interrupted it.
    pub fn wait(&mut self) -> Option<WakeUp> {
        let due_ns = self.due_ns;
        sleep_until(due_ns)?;
        let now_ns = now_ns();
        self.due_ns = first_deadline_after(now_ns.max(due_ns), self.period_ns, self.phase_ns);
        Some(WakeUp { due_ns, lateness_ns: now_ns.saturating_sub(due_ns) })
    }
}

/// Sleeps until a CLOCK_MONOTONIC time, ns. Returns `None` if a signal interrupted it.
pub fn sleep_until(due_ns: u64) -> Option<()> {
    let due = Timespec { tv_sec: (due_ns / NS_PER_S) as i64, tv_nsec: (due_ns % NS_PER_S) as _ };
    clock_nanosleep_absolute(ClockId::Monotonic, &due).ok()
}

/// Returns the first `n * period + phase` that is later than `now`.
fn first_deadline_after(now_ns: u64, period_ns: u64, phase_ns: u64) -> u64 {
    if now_ns < phase_ns {
        return phase_ns;
    }
    ((now_ns - phase_ns) / period_ns + 1) * period_ns + phase_ns
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn deadlines_are_multiples_of_the_period_plus_the_phase() {
        assert_eq!(first_deadline_after(0, 10, 3), 3);
        assert_eq!(first_deadline_after(3, 10, 3), 13);
        assert_eq!(first_deadline_after(12, 10, 3), 13);
        assert_eq!(first_deadline_after(13, 10, 3), 23);
        assert_eq!(first_deadline_after(99, 10, 0), 100);
    }

    #[test]
    fn wait_never_returns_early_and_skips_missed_periods() {
        let mut timer = Timer::new(1_000_000, 250_000);
        let first = timer.wait().unwrap();
        assert!(now_ns() >= first.due_ns);
        assert_eq!(first.due_ns % 1_000_000, 250_000);
        sleep_until(first.due_ns + 5_000_000).unwrap();
        timer.wait().unwrap();
        let third = timer.wait().unwrap();
        assert!(third.due_ns >= first.due_ns + 6_000_000);
        assert!(timer.due_ns() > third.due_ns + third.lateness_ns);
    }

    #[test]
    fn timer_slack_can_be_reduced() {
        tighten_timer_slack();
        assert_eq!(rustix::thread::current_timer_slack().unwrap(), 1);
    }
}
