//! Distribution of the values of one stage and robot or edge.
//!
//! The buckets are those of an HDR histogram, but only those with values are stored: most distributions have a few
//! buckets, while a histogram has an array of all buckets up to its largest value, and a run has one for each edge.

use hdrhistogram::Histogram;

/// Number of significant digits of the histograms.
const HISTOGRAM_DIGITS: u8 = 3;
/// Number of leading bits of a value that its bucket keeps: 2,048 steps, enough for three digits.
const BUCKET_BITS: u32 = 11;
/// Maximum number of values that are not in buckets yet. More would take more memory than the buckets.
const PENDING_VALUES_MAX: usize = 4096;

/// Distribution of the values of one stage and robot or edge.
#[derive(Debug, Clone)]
pub(super) struct ValueDistribution {
    /// Smallest value and number of values of each bucket, ascending.
    buckets: Vec<(u64, u64)>,
    /// Values of the current interval of run time, ns.
    recent_values_ns: Vec<u64>,
    /// Number of the recent values that are in buckets.
    bucketed_count: usize,
    pub(super) count: u64,
    pub(super) min_ns: u64,
    pub(super) max_ns: u64,
    pub(super) sum_ns: u128,
}

impl Default for ValueDistribution {
    fn default() -> ValueDistribution {
        ValueDistribution {
            buckets: Vec::new(),
            recent_values_ns: Vec::new(),
            bucketed_count: 0,
            count: 0,
            min_ns: u64::MAX,
            max_ns: 0,
            sum_ns: 0,
        }
    }
}

impl ValueDistribution {
    /// Adds a value.
    pub(super) fn add(&mut self, value_ns: u64) {
        self.count += 1;
        self.min_ns = self.min_ns.min(value_ns);
        self.max_ns = self.max_ns.max(value_ns);
        self.sum_ns += u128::from(value_ns);
        self.recent_values_ns.push(value_ns);
        if self.recent_values_ns.len() - self.bucketed_count >= PENDING_VALUES_MAX {
            self.fill_buckets();
        }
    }

    /// Adds all values of another distribution.
    pub(super) fn merge(&mut self, other: &ValueDistribution) {
        let pending = other.pending_values_ns().iter().map(|&value_ns| (bucket_ns(value_ns), 1));
        let buckets = other.buckets.iter().copied().chain(pending);
        buckets.for_each(|(bucket_ns, count)| self.count_in_bucket(bucket_ns, count));
        self.count += other.count;
        self.min_ns = self.min_ns.min(other.min_ns);
        self.max_ns = self.max_ns.max(other.max_ns);
        self.sum_ns += other.sum_ns;
    }

    /// Ends the current interval of run time. Returns its values, ns, in any order, for the caller to clear.
    pub(super) fn take_recent_values_ns(&mut self) -> &mut Vec<u64> {
        self.fill_buckets();
        self.bucketed_count = 0;
        &mut self.recent_values_ns
    }

    /// Returns the values that are not in buckets yet, ns.
    fn pending_values_ns(&self) -> &[u64] {
        &self.recent_values_ns[self.bucketed_count..]
    }

    /// Counts the values that are not in buckets yet.
    fn fill_buckets(&mut self) {
        let mut recent_values_ns = std::mem::take(&mut self.recent_values_ns);
        let pending_ns = &mut recent_values_ns[self.bucketed_count..];
        pending_ns.sort_unstable();
        for bucket_values in pending_ns.chunk_by(|&a_ns, &b_ns| bucket_ns(a_ns) == bucket_ns(b_ns))
        {
            self.count_in_bucket(bucket_ns(bucket_values[0]), bucket_values.len() as u64);
        }
        self.bucketed_count = recent_values_ns.len();
        self.recent_values_ns = recent_values_ns;
    }

    fn count_in_bucket(&mut self, bucket_ns: u64, count: u64) {
        match self.buckets.binary_search_by_key(&bucket_ns, |&(bucket_ns, _)| bucket_ns) {
            Ok(index) => self.buckets[index].1 += count,
            Err(index) => self.buckets.insert(index, (bucket_ns, count)),
        }
    }

    /// Returns the distribution as a histogram.
    pub(super) fn histogram(&self) -> Histogram<u64> {
        let mut histogram = Histogram::new(HISTOGRAM_DIGITS).expect("a valid number of digits");
        let pending = self.pending_values_ns().iter().map(|&value_ns| (value_ns, 1));
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
                    distribution.take_recent_values_ns().clear();
                    merged.merge(&interval);
                    interval = ValueDistribution::default();
                }
            }
            merged.merge(&interval);
            for found in [distribution, merged] {
                prop_assert_eq!(found.count, reference.len());
                for quantile in [0.0, 0.5, 0.9, 0.999, 1.0] {
                    let expected = reference.value_at_quantile(quantile);
                    prop_assert_eq!(found.histogram().value_at_quantile(quantile), expected);
                }
            }
        }
    }
}
