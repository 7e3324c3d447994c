//! Latency distributions per interval of run time.
//!
//! A value belongs to the interval in which it reached the supervisor: up to 0.1 s of wall time, in lockstep up to
//! a few hundred ticks, after it was measured.

use formation::ns_to_seconds;
use protocol::stage::Stage;

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

    /// Adds the distribution of one stage and robot or edge in an interval, and clears the values.
    pub(super) fn add_distribution(
        &mut self,
        middle_s: f64,
        stage: Stage,
        robot: &str,
        from: Option<&str>,
        values_ns: &mut Vec<u64>,
    ) {
        let count = values_ns.len();
        // The rank of the smallest value that at least this percentage of the values does not exceed.
        let rank = |percent: usize| (count * percent).div_ceil(100).saturating_sub(1);
        if count == 0 {
            return;
        }
        let (below, &mut p99_ns, above) = values_ns.select_nth_unstable(rank(99));
        let max_ns = above.iter().copied().max().unwrap_or(p99_ns);
        let median_rank = rank(50);
        let p50_ns = if median_rank < below.len() {
            *below.select_nth_unstable(median_rank).1
        } else {
            p99_ns
        };
        self.closed_intervals.push(LatencyInterval {
            t_s: middle_s,
            stage: stage.keyword().to_owned(),
            robot: robot.to_owned(),
            from: from.map(str::to_owned),
            count: count as u64,
            p50_ns,
            p99_ns,
            max_ns,
        });
        values_ns.clear();
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn interval_quantiles_equal_those_of_sorted_values(
            values_ns in prop::collection::vec(0..1000u64, 1..300),
        ) {
            let mut intervals = LatencyIntervals::new(30_000_000_000);
            intervals.add_distribution(0.5, Stage::Wake, "plant", None, &mut values_ns.clone());
            let mut sorted = values_ns;
            sorted.sort_unstable();
            let rank = |fraction: f64| sorted[(sorted.len() as f64 * fraction).ceil() as usize - 1];
            let line = &intervals.closed_intervals[0];
            let found = (line.count as usize, line.p50_ns, line.p99_ns, line.max_ns);
            let expected = (sorted.len(), rank(0.5), rank(0.99), sorted[sorted.len() - 1]);
            prop_assert_eq!(found, expected);
        }
    }
}
