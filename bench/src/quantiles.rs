//! Quantiles of a distribution of times that the table shows.

/// Key in `summary.json`, name in the table and probability of each quantile.
pub(crate) const QUANTILES: [(&str, &str, f64); 3] =
    [("p50_ns", "p50", 0.5), ("p99_ns", "p99", 0.99), ("p99.9_ns", "p99.9", 0.999)];

/// Values of [`QUANTILES`] of one distribution, us.
pub(crate) type Quantiles = [f64; 3];

/// Returns the quantiles of times in ns, each the sample of the nearest rank; `None` if there are no samples.
pub(crate) fn quantiles_us<N: Copy + Ord + Into<u64>>(mut values_ns: Vec<N>) -> Option<Quantiles> {
    values_ns.sort_unstable();
    let last = values_ns.len().checked_sub(1)?;
    let quantile_us = |probability: f64| {
        values_ns[(probability * last as f64).round() as usize].into() as f64 / 1e3
    };
    Some(QUANTILES.map(|(.., probability)| quantile_us(probability)))
}

/// Reduces several distributions with `combine`, separately for each quantile; `None` if there are none.
pub(crate) fn reduce_quantiles(
    distributions: &[Quantiles],
    combine: fn(f64, f64) -> f64,
) -> Option<Quantiles> {
    let pair = |a: Quantiles, b: Quantiles| std::array::from_fn(|i| combine(a[i], b[i]));
    distributions.iter().copied().reduce(pair)
}

/// Returns the mean of several distributions, separately for each quantile; `None` if there are none.
pub(crate) fn mean_quantiles(distributions: &[Quantiles]) -> Option<Quantiles> {
    Some(reduce_quantiles(distributions, |a, b| a + b)?.map(|sum| sum / distributions.len() as f64))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn quantiles_are_samples_and_reduce_to_mean_and_maximum() {
        let values_ns = (1..=101_u64).rev().map(|us| us * 1000).collect();
        assert_eq!(quantiles_us(values_ns), Some([51.0, 100.0, 101.0]));
        assert_eq!(quantiles_us::<u64>(Vec::new()), None);
        let distributions = [[1.0, 5.0, 6.0], [3.0, 4.0, 10.0]];
        assert_eq!(mean_quantiles(&distributions), Some([2.0, 4.5, 8.0]));
        assert_eq!(reduce_quantiles(&distributions, f64::max), Some([3.0, 5.0, 10.0]));
    }
}
