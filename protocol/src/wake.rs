//! Wake-ups of processes: the timer phase of each robot, one measured wake-up, and what a robot does once per interval.

/// One wake-up of a process's timer.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct WakeUp {
    /// Deadline of the wait, ns.
    pub due_ns: u64,
    /// Wake-up latency: time from the deadline to the return of the wait, ns.
    pub lateness_ns: u64,
}

/// Returns the timer phase in [0, 1) of the robot with this scenario index. Multiples of the fractional part of
/// the golden ratio are spread evenly, for any number of robots.
pub fn golden_phase(index: usize) -> f64 {
    (0.618_033_988_7 * index as f64).fract()
}

/// Returns the phase of the robot with this scenario index in a period, ns.
pub fn golden_phase_ns(index: usize, period_ns: u64) -> u64 {
    (golden_phase(index) * period_ns as f64) as u64
}

/// Interval in which a process does something once in real time, at a phase of its own. Otherwise all robots, which begin
/// at the same time, would need more processor time in the same period.
#[derive(Debug, Clone, Copy)]
pub struct StaggeredInterval {
    length_ns: u64,
    phase_ns: u64,
}

impl StaggeredInterval {
    /// Creates an interval of this length for the process with this index: a robot, from 1, or 0 for the plant.
    pub fn new(length_ns: u64, index: usize) -> StaggeredInterval {
        StaggeredInterval { length_ns, phase_ns: golden_phase_ns(index, length_ns) }
    }

    /// Returns whether an interval begins after `last_ns` and until `now_ns`.
    #[inline]
    pub fn begins_between(&self, last_ns: u64, now_ns: u64) -> bool {
        let number = |time_ns: u64| time_ns.saturating_add(self.phase_ns) / self.length_ns;
        number(now_ns) > number(last_ns)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        /// A process that looks often enough acts once in each interval.
        #[test]
        fn interval_begins_once_per_length(
            index in 0..2000usize, start_ns in 0..10_000u64, steps in prop::collection::vec(1..100u64, 1..200),
        ) {
            let interval = StaggeredInterval::new(1000, index);
            let (mut last_ns, mut now_ns, mut beginnings) = (start_ns, start_ns, 0_u64);
            for step in steps {
                now_ns += step;
                if interval.begins_between(last_ns, now_ns) {
                    prop_assert!(beginnings == 0 || now_ns - last_ns > 900, "{last_ns}, {now_ns}");
                    (last_ns, beginnings) = (now_ns, beginnings + 1);
                }
                prop_assert!(now_ns - last_ns <= 1000);
            }
            prop_assert!(beginnings.abs_diff((now_ns - start_ns) / 1000) <= 1);
        }
    }

    #[test]
    fn intervals_of_different_robots_begin_at_different_times() {
        let beginning = |index: usize| {
            let interval = StaggeredInterval::new(100, index);
            (1..=100).find(|&now| interval.begins_between(now - 1, now)).unwrap()
        };
        let mut beginnings: Vec<u64> = (0..34).map(beginning).collect();
        beginnings.sort_unstable();
        beginnings.dedup();
        assert_eq!(beginnings.len(), 34);
    }
}
