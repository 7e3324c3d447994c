//! Latency distributions per interval of run time.
//!
//! The distributions of a process are closed when its first values of a later interval arrive, so that this work is spread
//! over time: in a run in real time it would otherwise delay the robots. A value belongs to the interval in which it
//! reached the supervisor: up to 0.1 s of wall time, in lockstep up to
//! a few hundred ticks, after it was measured.

use formation::ns_to_seconds;

use super::distribution::IntervalQuantiles;

/// Target number of intervals of a run.
const TARGET_INTERVALS: u64 = 100;
/// Minimum length of an interval, ns, unless the run would have fewer than [`INTERVALS_MIN`].
const INTERVAL_NS_MIN: u64 = 1_000_000_000;
/// Minimum number of intervals of a run.
const INTERVALS_MIN: u64 = 20;
/// Maximum length of an interval, ns, which bounds the number of buffered values.
const INTERVAL_NS_MAX: u64 = 10_000_000_000;

/// Quantiles of one stage and robot or edge in one interval. The fields are in the order of the lines in
/// `latency_over_time.csv`.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub(super) struct ClosedInterval {
    /// Number of the interval, from 0.
    pub(super) interval: u64,
    pub(super) stage: u32,
    /// Process that measured the values.
    pub(super) process: usize,
    /// The other robot, counted from 1; 0 for none.
    pub(super) other: usize,
    pub(super) quantiles: IntervalQuantiles,
}

/// All closed intervals, and the number of the current one.
#[derive(Debug, Clone, Default)]
pub(super) struct LatencyIntervals {
    duration_ns: u64,
    interval_ns: u64,
    pub(super) current_interval: u64,
    pub(super) closed_intervals: Vec<ClosedInterval>,
}

impl LatencyIntervals {
    pub(super) fn new(duration_ns: u64) -> LatencyIntervals {
        let interval_ns = (duration_ns / TARGET_INTERVALS).clamp(INTERVAL_NS_MIN, INTERVAL_NS_MAX);
        let interval_ns = interval_ns.min(duration_ns / INTERVALS_MIN).max(1);
        LatencyIntervals {
            duration_ns,
            interval_ns,
            current_interval: 0,
            closed_intervals: Vec::new(),
        }
    }

    /// Sets the run time.
    pub(super) fn set_time(&mut self, t_ns: u64) {
        self.current_interval = t_ns / self.interval_ns.max(1);
    }

    /// Returns the middle of an interval, s.
    pub(super) fn middle_s(&self, interval: u64) -> f64 {
        let middle_ns = interval * self.interval_ns + self.interval_ns / 2;
        ns_to_seconds(middle_ns.min(self.duration_ns))
    }
}
