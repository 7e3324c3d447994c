//! Watchdog: tells a process with a pending response that is hung from one that is only starved.
//!
//! CPU time used without responding counts, and so does time in which the process is blocked. If the process may
//! expect a fraction of the wall time, all of that fraction counts as soon as it ran for a tenth of it: an
//! endless loop on a busy machine is then detected after a wall-clock time, while a starved process is not. Time
//! in which it is stopped, or is runnable without a core, does not count, because a busy machine is no fault of
//! the process. Time in which no sample was taken does not count either, because the observer may have been
//! stopped as well. Pure except for [`ProcessSample::read`]. Must not: wait, or end a process.

mod sample;
mod supervisor;

use std::time::Duration;

pub use self::sample::{ProcessSample, SchedulingState};
pub use self::supervisor::{SupervisorLossReason, SupervisorWatch};

/// Maximum time between two samples that counts.
pub const SAMPLE_GAP_MAX: Duration = Duration::from_secs(1);
/// Minimum fraction of its expected CPU time that a process must have used for all of it to count. A responding
/// agent needs a thousandth of it; an endless loop beside ten others on one core gets nearly all of it, and more
/// on two.
const CPU_TIME_FRACTION_MIN: f64 = 0.1;

/// Activity of a process that does not respond.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Activity {
    /// Computing: it used CPU time.
    Computing,
    /// Waiting: it was blocked.
    Waiting,
}

/// Time for which a process has had a pending response, by activity.
#[derive(Debug, Clone, Copy, Default)]
pub struct Watchdog {
    last_sample: Option<ProcessSample>,
    computing_time: Duration,
    waiting_time: Duration,
}

impl Watchdog {
    /// Resets the watchdog: the process has responded.
    pub fn reset(&mut self) {
        *self = Watchdog::default();
    }

    /// Adds the time since the previous sample. Time before the first sample does not count.
    pub fn add_sample(&mut self, sample: ProcessSample) {
        self.add_sample_with_cpu_fraction(sample, 0.0);
    }

    /// Adds the time since the previous sample, for a process that may expect the fraction `share` of the wall
    /// time, from 0 to 1.
    pub fn add_sample_with_cpu_fraction(&mut self, sample: ProcessSample, share: f64) {
        let Some(last) = self.last_sample.replace(sample) else { return };
        let between =
            Duration::from_nanos(sample.time_ns.saturating_sub(last.time_ns)).min(SAMPLE_GAP_MAX);
        let mut computed = sample.cpu_time.saturating_sub(last.cpu_time);
        let stopped = [last.state, sample.state].contains(&SchedulingState::Stopped);
        let expected = between.mul_f64(share);
        if !stopped && !computed.is_zero() && computed >= expected.mul_f64(CPU_TIME_FRACTION_MIN) {
            computed = computed.max(expected);
        }
        self.computing_time += computed;
        if (last.state, sample.state) == (SchedulingState::Blocked, SchedulingState::Blocked) {
            self.waiting_time += between.saturating_sub(computed);
        }
    }

    /// Returns the main activity if the response has been pending for `limit`; `None` otherwise.
    pub fn hung_activity(&self, limit: Duration) -> Option<Activity> {
        let mostly = match self.computing_time > self.waiting_time {
            true => Activity::Computing,
            false => Activity::Waiting,
        };
        (self.computing_time + self.waiting_time >= limit).then_some(mostly)
    }
}

impl std::fmt::Display for Activity {
    /// Writes text that follows a duration: `60 s while it ran`, `60 s while blocked`.
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(match self {
            Activity::Computing => "while it ran",
            Activity::Waiting => "while blocked",
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const HUNG_LIMIT: Duration = Duration::from_secs(60);

    /// Returns a watchdog after these samples: state, CPU time in s, time in s.
    fn watchdog_after(samples: impl IntoIterator<Item = (SchedulingState, u64, f64)>) -> Watchdog {
        let mut dog = Watchdog::default();
        for (state, computed_s, at_s) in samples {
            let computed = Duration::from_secs(computed_s);
            dog.add_sample(ProcessSample {
                state,
                cpu_time: computed,
                time_ns: (at_s * 1e9) as u64,
                start_time_ticks: 7,
            });
        }
        dog
    }

    #[test]
    fn cpu_time_and_blocked_time_count_toward_the_limit() {
        let spins =
            |times: u64| (0..=times).map(|i| (SchedulingState::Runnable, i, i as f64 / 4.0));
        assert_eq!(watchdog_after(spins(59)).hung_activity(HUNG_LIMIT), None);
        assert_eq!(watchdog_after(spins(60)).hung_activity(HUNG_LIMIT), Some(Activity::Computing));
        let waits = |s: u64| (0..=s * 5).map(|i| (SchedulingState::Blocked, 3, i as f64 / 5.0));
        assert_eq!(watchdog_after(waits(59)).hung_activity(HUNG_LIMIT), None);
        assert_eq!(watchdog_after(waits(60)).hung_activity(HUNG_LIMIT), Some(Activity::Waiting));
        // CPU time used before the first sample does not count.
        assert_eq!(
            watchdog_after([(SchedulingState::Runnable, 500, 0.0)]).hung_activity(HUNG_LIMIT),
            None
        );
    }

    /// Returns the result for a process with `per_cent` of a core, sampled five times a second.
    fn hung_activity_at_usage(per_cent: u64, share: f64, for_s: u64) -> Option<Activity> {
        let mut dog = Watchdog::default();
        for look in 0..=for_s * 5 {
            let computed = Duration::from_millis(2 * per_cent * look);
            let (state, at_ns) = (SchedulingState::Runnable, look * 200_000_000);
            dog.add_sample_with_cpu_fraction(
                ProcessSample { state, cpu_time: computed, time_ns: at_ns, start_time_ticks: 7 },
                share,
            );
        }
        dog.hung_activity(HUNG_LIMIT)
    }

    #[test]
    fn cpu_share_of_at_least_a_tenth_counts_as_wall_time() {
        let computed = Some(Activity::Computing);
        // Alone, and beside other processes of the run with a pending response.
        assert_eq!([59, 60].map(|for_s| hung_activity_at_usage(10, 1.0, for_s)), [None, computed]);
        assert_eq!([119, 120].map(|for_s| hung_activity_at_usage(5, 0.5, for_s)), [None, computed]);
        // A process that got more than its share used that much.
        assert_eq!([59, 60].map(|for_s| hung_activity_at_usage(100, 0.5, for_s)), [None, computed]);
        // A starved process: only its used CPU time counts.
        assert_eq!([666, 667].map(|for_s| hung_activity_at_usage(9, 1.0, for_s)), [None, computed]);
        assert_eq!(hung_activity_at_usage(0, 1.0, 100_000), None);
    }

    #[test]
    fn share_does_not_count_while_the_process_is_stopped() {
        let states =
            [SchedulingState::Runnable, SchedulingState::Stopped, SchedulingState::Runnable];
        let mut dog = Watchdog::default();
        for look in 0..10_000 {
            let (state, computed) = (states[look % 3], Duration::from_millis(look as u64));
            let at_ns = look as u64 * 1_000_000;
            dog.add_sample_with_cpu_fraction(
                ProcessSample { state, cpu_time: computed, time_ns: at_ns, start_time_ticks: 7 },
                1.0,
            );
        }
        // In a third of the intervals it was not stopped.
        assert_eq!(dog.hung_activity(Duration::from_secs(10)), None);
    }

    #[test]
    fn starved_stopped_or_briefly_blocked_is_not_hung() {
        let (runnable, blocked, stopped) =
            (SchedulingState::Runnable, SchedulingState::Blocked, SchedulingState::Stopped);
        for states in [
            [runnable; 4],
            [stopped; 4],
            [SchedulingState::Exited; 4],
            [blocked, runnable, blocked, stopped],
        ] {
            let dog = watchdog_after((0..10_000).map(|i| (states[i % 4], 3, i as f64)));
            assert_eq!(dog.hung_activity(HUNG_LIMIT), None, "{states:?}");
        }
    }

    #[test]
    fn time_without_samples_does_not_count() {
        let dog = watchdog_after(
            [0.0, 0.5, 3600.0, 3600.5].map(|at_s| (SchedulingState::Blocked, 0, at_s)),
        );
        let hung = [60_000, 2000, 2001].map(|ms| dog.hung_activity(Duration::from_millis(ms)));
        assert_eq!(hung, [None, Some(Activity::Waiting), None]);
    }

    #[test]
    fn time_counts_once_and_a_response_resets_it() {
        let mut dog = watchdog_after([
            (SchedulingState::Blocked, 0, 0.0),
            (SchedulingState::Blocked, 1, 1.0),
        ]);
        assert_eq!(dog.hung_activity(Duration::from_secs(1)), Some(Activity::Computing));
        assert_eq!(dog.hung_activity(Duration::from_millis(1001)), None);
        dog.reset();
        assert_eq!(dog.hung_activity(Duration::from_nanos(1)), None);
    }
}
