//! Latency distributions per interval of run time.
//!
//! A value belongs to the interval in which it reached the supervisor: up to 0.1 s of wall time, in lockstep up to
//! a few hundred ticks, after it was measured.

use formation::ns_to_seconds;
use protocol::stage::Stage;

use super::distribution::IntervalQuantiles;
use crate::metrics::summary::LatencyInterval;

/// Target number of intervals of a run.
const TARGET_INTERVALS: u64 = 100;
/// Minimum length of an interval, ns, unless the run would have fewer than [`INTERVALS_MIN`].
const INTERVAL_NS_MIN: u64 = 1_000_000_000;
/// Minimum number of intervals of a run.
const INTERVALS_MIN: u64 = 20;
/// Maximum length of an interval, ns, which bounds the number of buffered values.
const INTERVAL_NS_MAX: u64 = 10_000_000_000;

/// All closed intervals, and the number of the current one.
#[derive(Debug, Clone, Default)]
pub(super) struct LatencyIntervals {
    duration_ns: u64,
    interval_ns: u64,
    current_interval: u64,
    pub(super) closed_intervals: Vec<LatencyInterval>,
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

    /// Sets the run time. If a new interval begins, returns the middle of the previous one, s.
    pub(super) fn set_time(&mut self, t_ns: u64) -> Option<f64> {
        let interval = t_ns / self.interval_ns.max(1);
        let previous = std::mem::replace(&mut self.current_interval, interval);
        (previous != interval).then(|| self.middle_s(previous))
    }

    /// Returns the middle of the current interval, which is the last one, s.
    pub(super) fn current_middle_s(&self) -> f64 {
        self.middle_s(self.current_interval)
    }

    fn middle_s(&self, interval: u64) -> f64 {
        let middle_ns = interval * self.interval_ns + self.interval_ns / 2;
        ns_to_seconds(middle_ns.min(self.duration_ns))
    }

    /// Adds the quantiles of one stage and robot or edge in an interval.
    pub(super) fn add_quantiles(
        &mut self,
        middle_s: f64,
        stage: Stage,
        robot: &str,
        from: Option<&str>,
        quantiles: IntervalQuantiles,
    ) {
        let IntervalQuantiles { count, p50_ns, p99_ns, max_ns } = quantiles;
        self.closed_intervals.push(LatencyInterval {
            t_s: middle_s,
            stage: stage.keyword().to_owned(),
            robot: robot.to_owned(),
            from: from.map(str::to_owned),
            count,
            p50_ns,
            p99_ns,
            max_ns,
        });
    }
}
