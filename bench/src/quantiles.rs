//! Quantiles that are shown of a distribution of times.

/// Names in `summary.json` and in the table, and fractions, of the quantiles.
pub(crate) const QUANTILES: [(&str, &str, f64); 3] =
    [("p50_ns", "p50", 0.5), ("p99_ns", "p99", 0.99), ("p99.9_ns", "p99.9", 0.999)];

/// [`QUANTILES`] of one distribution, us.
pub(crate) type Quantiles = [f64; 3];

/// Returns the quantiles of these times; `None` without values.
pub(crate) fn quantiles_us<N: Copy + Ord + Into<u64>>(mut values_ns: Vec<N>) -> Option<Quantiles> {
    values_ns.sort_unstable();
    let last = values_ns.len().checked_sub(1)?;
    let at = |share: f64| values_ns[(share * last as f64).round() as usize].into() as f64 / 1e3;
    Some(QUANTILES.map(|(.., share)| at(share)))
}

/// Combines several distributions quantile by quantile with `add`; `None` without any.
pub(crate) fn combined(all: &[Quantiles], add: fn(f64, f64) -> f64) -> Option<Quantiles> {
    let both = |a: Quantiles, b: Quantiles| std::array::from_fn(|place| add(a[place], b[place]));
    all.iter().copied().reduce(both)
}

/// Returns the mean of several distributions quantile by quantile; `None` without any.
pub(crate) fn mean(all: &[Quantiles]) -> Option<Quantiles> {
    Some(combined(all, |a, b| a + b)?.map(|sum| sum / all.len() as f64))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn quantiles_are_values_that_were_seen_and_several_spreads_have_a_mean_and_a_largest_one() {
        let us = (1..=101_u64).rev().map(|us| us * 1000).collect();
        assert_eq!(quantiles_us(us), Some([51.0, 100.0, 101.0]));
        assert_eq!(quantiles_us::<u64>(Vec::new()), None);
        let all = [[1.0, 5.0, 6.0], [3.0, 4.0, 10.0]];
        assert_eq!(mean(&all), Some([2.0, 4.5, 8.0]));
        assert_eq!(combined(&all, f64::max), Some([3.0, 5.0, 10.0]));
    }
}
