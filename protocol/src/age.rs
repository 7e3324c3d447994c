//! Age of information of an edge: the current time minus the stamp of the newest sample received over it. It
//! grows with time and drops when a newer sample arrives, which gives a sawtooth.
//!
//! The receiving robot integrates the age exactly and sends the sums together with its latencies, so an edge
//! without samples has a growing age instead of missing values. Must not: allocate, wait, or read a clock.

use crate::message::LatencyRow;

/// Stage numbers of the rows that carry age sums; larger than the numbers of all stages.
const SAMPLE_COUNT_STAGE: u32 = 64;
const DURATION_STAGE: u32 = 65;
const AGE_INTEGRAL_STAGE: u32 = 66;
const AGE_MAX_STAGE: u32 = 67;

/// Integral, duration and maximum of an age over an interval.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct AgeSums {
    /// Number of received samples.
    pub sample_count: u64,
    /// Duration for which an age was defined, ns: it is undefined before the first sample.
    pub duration_ns: u64,
    /// Integral of the age over that duration, s^2.
    pub integral_s2: f64,
    /// Maximum age, ns.
    pub peak_ns: u64,
}

impl AgeSums {
    /// Returns the mean age over the time for which it was defined, ns; `None` if it never was.
    pub fn mean_ns(&self) -> Option<f64> {
        (self.duration_ns > 0).then(|| self.integral_s2 * 1e18 / self.duration_ns as f64)
    }

    /// Returns the rows that carry these sums. `from`: 1-based scenario index of the sending robot.
    pub fn to_rows(&self, from: usize) -> [LatencyRow; 4] {
        let row = |stage, value_ns| LatencyRow { stage, from: from as u32, value_ns };
        [
            row(SAMPLE_COUNT_STAGE, self.sample_count),
            row(DURATION_STAGE, self.duration_ns),
            row(AGE_INTEGRAL_STAGE, self.integral_s2.to_bits()),
            row(AGE_MAX_STAGE, self.peak_ns),
        ]
    }

    /// Returns whether a row carries an age sum.
    #[inline]
    pub fn is_carried_by(row: &LatencyRow) -> bool {
        (SAMPLE_COUNT_STAGE..=AGE_MAX_STAGE).contains(&row.stage)
    }

    /// Adds a row of another batch. Returns `false` if the row carries no age sum.
    pub fn add_row(&mut self, row: &LatencyRow) -> bool {
        match row.stage {
            SAMPLE_COUNT_STAGE => {
                self.sample_count = self.sample_count.saturating_add(row.value_ns)
            }
            DURATION_STAGE => self.duration_ns = self.duration_ns.saturating_add(row.value_ns),
            AGE_INTEGRAL_STAGE => self.integral_s2 += f64::from_bits(row.value_ns),
            AGE_MAX_STAGE => self.peak_ns = self.peak_ns.max(row.value_ns),
            _ => return false,
        }
        true
    }
}

/// Age of one edge at the receiving robot.
#[derive(Debug, Clone, Copy, Default)]
pub struct EdgeAgeIntegrator {
    /// Stamp of the newest received sample, ns.
    stamp_ns: Option<u64>,
    /// Time up to which `sums` includes the age, ns.
    integrated_until_ns: u64,
    sums: AgeSums,
}

impl EdgeAgeIntegrator {
    /// Records that a newer sample was received at `now_ns`.
    #[inline]
    pub fn record_sample(&mut self, stamp_ns: u64, now_ns: u64) {
        self.integrate_until(now_ns);
        self.stamp_ns = Some(stamp_ns);
        self.integrated_until_ns = now_ns;
        self.sums.sample_count += 1;
    }

    /// Returns the sums since the last call and resets them.
    pub fn take_sums(&mut self, now_ns: u64) -> AgeSums {
        self.integrate_until(now_ns);
        std::mem::take(&mut self.sums)
    }

    #[inline]
    fn integrate_until(&mut self, now_ns: u64) {
        let Some(stamp_ns) = self.stamp_ns.filter(|_| now_ns > self.integrated_until_ns) else {
            return;
        };
        let interval_ns = now_ns - self.integrated_until_ns;
        let [from_ns, to_ns] =
            [self.integrated_until_ns, now_ns].map(|time_ns| time_ns.saturating_sub(stamp_ns));
        let middle_s = 0.5 * (ns_to_f64(from_ns) + ns_to_f64(to_ns)) / 1e9;
        self.sums.integral_s2 += middle_s * (ns_to_f64(interval_ns) / 1e9);
        self.sums.duration_ns += interval_ns;
        self.sums.peak_ns = self.sums.peak_ns.max(to_ns);
        self.integrated_until_ns = now_ns;
    }
}

/// Returns a time as a floating-point number, ns; at most 2^63 (292 years). Processors convert signed integers faster.
#[inline]
fn ns_to_f64(time_ns: u64) -> f64 {
    time_ns.min(i64::MAX as u64) as i64 as f64
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    const NS_PER_MS: u64 = 1_000_000;

    #[test]
    fn age_in_lockstep_is_one_to_two_periods_and_grows_in_a_cut() {
        let mut age = EdgeAgeIntegrator::default();
        assert_eq!(age.take_sums(7 * NS_PER_MS).mean_ns(), None, "nothing was heard yet");
        for tick in 1..=100 {
            age.record_sample((tick - 1) * NS_PER_MS, tick * NS_PER_MS);
        }
        let sums = age.take_sums(101 * NS_PER_MS);
        assert_eq!(
            (sums.sample_count, sums.duration_ns, sums.peak_ns),
            (100, 100 * NS_PER_MS, 2 * NS_PER_MS)
        );
        assert!((sums.mean_ns().unwrap() - 1.5e6).abs() < 1e-3);
        age.record_sample(4099 * NS_PER_MS, 4101 * NS_PER_MS);
        let cut = age.take_sums(4101 * NS_PER_MS);
        assert_eq!(
            (cut.sample_count, cut.duration_ns, cut.peak_ns),
            (1, 4000 * NS_PER_MS, 4002 * NS_PER_MS)
        );
        assert!((cut.mean_ns().unwrap() - 2002e6).abs() < 1e-3);
    }

    proptest! {
        /// The sums do not depend on how often they are taken.
        #[test]
        fn sums_of_intervals_equal_the_sum_of_all_time(
            samples in prop::collection::vec((1..50u64, 0..20u64), 1..40),
            takes_sums in prop::collection::vec(any::<bool>(), 40),
        ) {
            let (mut single, mut repeated) = (EdgeAgeIntegrator::default(), EdgeAgeIntegrator::default());
            let (mut total, mut now_ns) = (AgeSums::default(), 100 * NS_PER_MS);
            let mut last_stamp_ns = 0;
            for (&(pause_ms, age_ms), &takes_sums) in samples.iter().zip(&takes_sums) {
                now_ns += pause_ms * NS_PER_MS;
                let stamp_ns = (now_ns - age_ms * NS_PER_MS).max(last_stamp_ns + 1);
                last_stamp_ns = stamp_ns;
                single.record_sample(stamp_ns, now_ns);
                repeated.record_sample(stamp_ns, now_ns);
                if takes_sums {
                    for row in repeated.take_sums(now_ns + NS_PER_MS / 2).to_rows(3) {
                        prop_assert!(total.add_row(&row) && row.from == 3);
                    }
                    now_ns += NS_PER_MS / 2;
                }
            }
            now_ns += NS_PER_MS;
            repeated.take_sums(now_ns).to_rows(3).iter().for_each(|row| {
                total.add_row(row);
            });
            let all = single.take_sums(now_ns);
            prop_assert_eq!(
                (all.sample_count, all.duration_ns, all.peak_ns),
                (total.sample_count, total.duration_ns, total.peak_ns)
            );
            prop_assert!((all.integral_s2 - total.integral_s2).abs() <= 1e-12 * all.integral_s2.max(1e-9));
        }
    }
}
