//! Distribution of the values of one stage and robot or edge.
//!
//! The buckets are those of an HDR histogram, but only those with values are stored: most distributions have a few
//! buckets, while a histogram has an array of all buckets up to its largest value, and a run has one for each edge.

use hdrhistogram::Histogram;

/// Number of significant digits of the histograms.
const HISTOGRAM_DIGITS: u8 = 3;
/// Number of leading bits of a value that its bucket keeps: 2,048 steps, enough for three digits.
const BUCKET_BITS: u32 = 11;
/// Maximum number of groups of equal values that are not in buckets yet. More would take more memory than the buckets.
const PENDING_GROUPS_MAX: usize = 4096;

/// Equal values that were added one after the other. Ages in lockstep are the same at nearly every tick.
#[derive(Debug, Clone, Copy)]
struct EqualValues {
    value_ns: u64,
    count: u64,
}

impl EqualValues {
    fn sum_ns(self) -> u128 {
        u128::from(self.value_ns) * u128::from(self.count)
    }
}

/// Distribution of the values of one stage and robot or edge.
#[derive(Debug, Clone)]
pub(super) struct ValueDistribution {
    /// Smallest value and number of values of each bucket, ascending.
    buckets: Vec<(u64, u64)>,
    /// Values of the current interval of run time, without the newest ones.
    recent_values: Vec<EqualValues>,
    /// Number of the entries of `recent_values` that are in buckets.
    bucketed_count: usize,
    /// Newest values, which are not in buckets and not in the following count and sum; none if their number is 0.
    newest_values: EqualValues,
    earlier_count: u64,
    earlier_sum_ns: u128,
    pub(super) min_ns: u64,
    pub(super) max_ns: u64,
}

/// Number, median, 99th percentile and maximum, ns, of the values of one interval of run time. A percentile is the
/// smallest value that at least this percentage of the values does not exceed.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub(super) struct IntervalQuantiles {
    pub(super) count: u64,
    pub(super) p50_ns: u64,
    pub(super) p99_ns: u64,
    pub(super) max_ns: u64,
}

impl Default for ValueDistribution {
    fn default() -> ValueDistribution {
        ValueDistribution {
            buckets: Vec::new(),
            recent_values: Vec::new(),
            bucketed_count: 0,
            newest_values: EqualValues { value_ns: 0, count: 0 },
            earlier_count: 0,
            earlier_sum_ns: 0,
            min_ns: u64::MAX,
            max_ns: 0,
        }
    }
}

impl ValueDistribution {
    /// Adds a value.
    #[inline(always)]
    pub(super) fn add(&mut self, value_ns: u64) {
        if value_ns == self.newest_values.value_ns && self.newest_values.count > 0 {
            self.newest_values.count += 1;
        } else {
            self.add_different_value(value_ns);
        }
    }

    /// Adds a value that differs from the previous one.
    #[inline(never)]
    fn add_different_value(&mut self, value_ns: u64) {
        self.min_ns = self.min_ns.min(value_ns);
        self.max_ns = self.max_ns.max(value_ns);
        self.store_newest_values();
        self.newest_values = EqualValues { value_ns, count: 1 };
        if self.recent_values.len() - self.bucketed_count >= PENDING_GROUPS_MAX {
            self.fill_buckets();
        }
    }

    /// Moves the newest values to those before them.
    fn store_newest_values(&mut self) {
        if self.newest_values.count > 0 {
            self.earlier_count += self.newest_values.count;
            self.earlier_sum_ns += self.newest_values.sum_ns();
            self.recent_values.push(self.newest_values);
            self.newest_values.count = 0;
        }
    }

    /// Returns the number of all values.
    pub(super) fn count(&self) -> u64 {
        self.earlier_count + self.newest_values.count
    }

    /// Returns the sum of all values, ns.
    pub(super) fn sum_ns(&self) -> u128 {
        self.earlier_sum_ns + self.newest_values.sum_ns()
    }

    /// Adds all values of another distribution.
    pub(super) fn merge(&mut self, other: &ValueDistribution) {
        let pending =
            other.pending_values().map(|values| (bucket_ns(values.value_ns), values.count));
        let buckets = other.buckets.iter().copied().chain(pending);
        for (bucket_ns, count) in buckets {
            self.count_in_bucket(bucket_ns, count, 0);
        }
        self.earlier_count += other.count();
        self.min_ns = self.min_ns.min(other.min_ns);
        self.max_ns = self.max_ns.max(other.max_ns);
        self.earlier_sum_ns += other.sum_ns();
    }

    /// Ends the current interval of run time. Returns the quantiles of its values; `None` without values.
    pub(super) fn end_interval(&mut self) -> Option<IntervalQuantiles> {
        self.store_newest_values();
        let is_sorted_by_bucketing = self.bucketed_count == 0;
        self.fill_buckets();
        self.bucketed_count = 0;
        if !is_sorted_by_bucketing {
            self.recent_values.sort_unstable_by_key(|values| values.value_ns);
        }
        let max_ns = self.recent_values.last()?.value_ns;
        let count: u64 = self.recent_values.iter().map(|values| values.count).sum();
        let value_at_rank = |rank: u64| {
            let mut counted = 0;
            let reaches_rank = |values: &&EqualValues| {
                counted += values.count;
                counted >= rank
            };
            self.recent_values.iter().find(reaches_rank).map_or(max_ns, |values| values.value_ns)
        };
        let [p50_ns, p99_ns] =
            [50, 99].map(|percent| value_at_rank((count * percent).div_ceil(100)));
        self.recent_values.clear();
        Some(IntervalQuantiles { count, p50_ns, p99_ns, max_ns })
    }

    /// Returns the values that are not in buckets yet.
    fn pending_values(&self) -> impl Iterator<Item = EqualValues> {
        let newest = (self.newest_values.count > 0).then_some(self.newest_values);
        self.recent_values[self.bucketed_count..].iter().copied().chain(newest)
    }

    /// Sorts the values that are not in buckets yet, without the newest ones, and counts them in buckets.
    fn fill_buckets(&mut self) {
        let mut recent_values = std::mem::take(&mut self.recent_values);
        let pending = &mut recent_values[self.bucketed_count..];
        pending.sort_unstable_by_key(|values| values.value_ns);
        let mut index = 0;
        for values in pending.chunk_by(|a, b| bucket_ns(a.value_ns) == bucket_ns(b.value_ns)) {
            let count = values.iter().map(|values| values.count).sum();
            index = self.count_in_bucket(bucket_ns(values[0].value_ns), count, index);
        }
        self.bucketed_count = recent_values.len();
        self.recent_values = recent_values;
    }

    /// Adds to the count of a bucket that does not come before the one at `first_index`. Returns its index.
    fn count_in_bucket(&mut self, bucket_ns: u64, count: u64, first_index: usize) -> usize {
        let later = &self.buckets[first_index..];
        let is_before = |&(other_ns, _): &(u64, u64)| other_ns < bucket_ns;
        // Buckets that are filled one after the other are often near each other.
        let near = later.iter().take(8).position(|bucket| !is_before(bucket));
        let index = first_index + near.unwrap_or_else(|| later.partition_point(is_before));
        match self.buckets.get_mut(index) {
            Some((other_ns, counted)) if *other_ns == bucket_ns => *counted += count,
            _ => self.buckets.insert(index, (bucket_ns, count)),
        }
        index
    }

    /// Returns the distribution as a histogram.
    pub(super) fn histogram(&self) -> Histogram<u64> {
        let mut histogram = Histogram::new(HISTOGRAM_DIGITS).expect("a valid number of digits");
        let pending = self.pending_values().map(|values| (values.value_ns, values.count));
        for (value_ns, count) in self.buckets.iter().copied().chain(pending) {
            histogram.record_n(value_ns, count).expect("the histogram grows as needed");
        }
        histogram
    }

    /// Returns a quantile with the precision of the histogram, clamped to the smallest and largest value.
    pub(super) fn quantile_ns(&self, histogram: &Histogram<u64>, quantile: f64) -> u64 {
        histogram.value_at_quantile(quantile).clamp(self.min_ns, self.max_ns)
    }
}

/// Returns the smallest value of the bucket of a value, ns.
fn bucket_ns(value_ns: u64) -> u64 {
    let bits = u64::BITS - value_ns.leading_zeros();
    let dropped_bits = bits.saturating_sub(BUCKET_BITS);
    value_ns >> dropped_bits << dropped_bits
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn interval_quantiles_equal_those_of_sorted_values(
            intervals in prop::collection::vec(prop::collection::vec(0..1000u64, 0..300), 1..4),
        ) {
            let mut distribution = ValueDistribution::default();
            for mut values_ns in intervals {
                values_ns.iter().for_each(|&value_ns| distribution.add(value_ns));
                values_ns.sort_unstable();
                let rank = |fraction: f64| values_ns[(values_ns.len() as f64 * fraction).ceil() as usize - 1];
                let expected = values_ns.last().map(|&max_ns| IntervalQuantiles {
                    count: values_ns.len() as u64,
                    p50_ns: rank(0.5),
                    p99_ns: rank(0.99),
                    max_ns,
                });
                prop_assert_eq!(distribution.end_interval(), expected);
            }
        }

        #[test]
        fn buckets_equal_those_of_an_hdr_histogram(
            values_ns in prop::collection::vec((0..42_u32, any::<u64>()), 1..300),
            end_bits in any::<u64>(),
        ) {
            let values_ns = values_ns.into_iter().map(|(bits, value)| value >> (63 - bits));
            let mut reference = Histogram::<u64>::new(HISTOGRAM_DIGITS).unwrap();
            let (mut distribution, mut interval, mut merged) =
                (ValueDistribution::default(), ValueDistribution::default(), ValueDistribution::default());
            for (i, value_ns) in values_ns.enumerate() {
                reference.record(value_ns).unwrap();
                prop_assert_eq!(bucket_ns(value_ns), reference.lowest_equivalent(value_ns));
                [&mut distribution, &mut interval].into_iter().for_each(|distribution| distribution.add(value_ns));
                if (end_bits >> (i % 64)) & 1 == 1 {
                    distribution.end_interval();
                    merged.merge(&interval);
                    interval = ValueDistribution::default();
                }
            }
            merged.merge(&interval);
            for found in [distribution, merged] {
                prop_assert_eq!(found.count(), reference.len());
                for quantile in [0.0, 0.5, 0.9, 0.999, 1.0] {
                    let expected = reference.value_at_quantile(quantile);
                    prop_assert_eq!(found.histogram().value_at_quantile(quantile), expected);
                }
            }
        }
    }
}
