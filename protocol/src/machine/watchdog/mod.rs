//! Watchdog: distinguishes a hung process with a pending response from one that is only starved.
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
/// agent needs a thousandth of it; an endless loop with ten others on one core gets nearly all of it, and more
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

    /// Adds the time since the previous sample, for a process that may expect the fraction `cpu_fraction` of the wall
    /// time, from 0 to 1.
    pub fn add_sample_with_cpu_fraction(&mut self, sample: ProcessSample, cpu_fraction: f64) {
        let Some(last) = self.last_sample.replace(sample) else { return };
        let elapsed =
            Duration::from_nanos(sample.time_ns.saturating_sub(last.time_ns)).min(SAMPLE_GAP_MAX);
        let mut cpu_time = sample.cpu_time.saturating_sub(last.cpu_time);
        let is_stopped = [last.state, sample.state].contains(&SchedulingState::Stopped);
        let expected = elapsed.mul_f64(cpu_fraction);
        if !is_stopped && !cpu_time.is_zero() && cpu_time >= expected.mul_f64(CPU_TIME_FRACTION_MIN)
        {
            cpu_time = cpu_time.max(expected);
        }
        self.computing_time += cpu_time;
        if (last.state, sample.state) == (SchedulingState::Blocked, SchedulingState::Blocked) {
            self.waiting_time += elapsed.saturating_sub(cpu_time);
        }
    }

    /// Returns the main activity if the response has been pending for `limit`; `None` otherwise.
    pub fn hung_activity(&self, limit: Duration) -> Option<Activity> {
        let activity = match self.computing_time > self.waiting_time {
            true => Activity::Computing,
            false => Activity::Waiting,
        };
        (self.computing_time + self.waiting_time >= limit).then_some(activity)
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
        let mut watchdog = Watchdog::default();
        for (state, cpu_time_s, time_s) in samples {
            let cpu_time = Duration::from_secs(cpu_time_s);
            watchdog.add_sample(ProcessSample {
                state,
                cpu_time,
                time_ns: (time_s * 1e9) as u64,
                start_time_ticks: 7,
            });
        }
        watchdog
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
    fn hung_activity_at_usage(
        per_cent: u64,
        cpu_fraction: f64,
        duration_s: u64,
    ) -> Option<Activity> {
        let mut watchdog = Watchdog::default();
        for index in 0..=duration_s * 5 {
            let cpu_time = Duration::from_millis(2 * per_cent * index);
            let (state, time_ns) = (SchedulingState::Runnable, index * 200_000_000);
            watchdog.add_sample_with_cpu_fraction(
                ProcessSample { state, cpu_time, time_ns, start_time_ticks: 7 },
                cpu_fraction,
            );
        }
        watchdog.hung_activity(HUNG_LIMIT)
    }

    #[test]
    fn cpu_share_of_at_least_a_tenth_counts_as_wall_time() {
        // Usage in per cent of a core, the process's share of the cores, and the last duration, s, at which it is not hung.
        for (per_cent, cpu_fraction, last_s) in [
            (10, 1.0, 59),
            // With other processes of the run with a pending response.
            (5, 0.5, 119),
            // A process that got more than its share used that much.
            (100, 0.5, 59),
            // A starved process: only its used CPU time counts.
            (9, 1.0, 666),
        ] {
            let hung = [last_s, last_s + 1]
                .map(|duration_s| hung_activity_at_usage(per_cent, cpu_fraction, duration_s));
            assert_eq!(hung, [None, Some(Activity::Computing)], "{per_cent} %");
        }
        assert_eq!(hung_activity_at_usage(0, 1.0, 100_000), None);
    }

    #[test]
    fn share_does_not_count_while_the_process_is_stopped() {
        let states =
            [SchedulingState::Runnable, SchedulingState::Stopped, SchedulingState::Runnable];
        let mut watchdog = Watchdog::default();
        for index in 0..10_000 {
            let (state, cpu_time) = (states[index % 3], Duration::from_millis(index as u64));
            let time_ns = index as u64 * 1_000_000;
            watchdog.add_sample_with_cpu_fraction(
                ProcessSample { state, cpu_time, time_ns, start_time_ticks: 7 },
                1.0,
            );
        }
        // In a third of the intervals it was not stopped.
        assert_eq!(watchdog.hung_activity(Duration::from_secs(10)), None);
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
            let watchdog = watchdog_after((0..10_000).map(|i| (states[i % 4], 3, i as f64)));
            assert_eq!(watchdog.hung_activity(HUNG_LIMIT), None, "{states:?}");
        }
    }

    #[test]
    fn time_without_samples_does_not_count() {
        let watchdog = watchdog_after(
            [0.0, 0.5, 3600.0, 3600.5].map(|time_s| (SchedulingState::Blocked, 0, time_s)),
        );
        let hung = [60_000, 2000, 2001].map(|ms| watchdog.hung_activity(Duration::from_millis(ms)));
        assert_eq!(hung, [None, Some(Activity::Waiting), None]);
    }

    #[test]
    fn time_counts_once_and_a_response_resets_it() {
        let mut watchdog = watchdog_after([
            (SchedulingState::Blocked, 0, 0.0),
            (SchedulingState::Blocked, 1, 1.0),
        ]);
        assert_eq!(watchdog.hung_activity(Duration::from_secs(1)), Some(Activity::Computing));
        assert_eq!(watchdog.hung_activity(Duration::from_millis(1001)), None);
        watchdog.reset();
        assert_eq!(watchdog.hung_activity(Duration::from_nanos(1)), None);
    }
}
