//! What is told of a spread of times: three of its quantiles.

/// Their names in `summary.json` and in the table, and the share.
pub(crate) const QUANTILES: [(&str, &str, f64); 3] =
    [("p50_ns", "p50", 0.5), ("p99_ns", "p99", 0.99), ("p99.9_ns", "p99.9", 0.999)];

/// [`QUANTILES`] of one spread, us.
pub(crate) type Quantiles = [f64; 3];

/// `None` of nothing.
pub(crate) fn quantiles_us<N: Copy + Ord + Into<u64>>(mut values_ns: Vec<N>) -> Option<Quantiles> {
    values_ns.sort_unstable();
    let last = values_ns.len().checked_sub(1)?;
    let at = |share: f64| values_ns[(share * last as f64).round() as usize].into() as f64 / 1e3;
    Some(QUANTILES.map(|(.., share)| at(share)))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn quantiles_are_values_that_were_seen() {
        assert_eq!(
            quantiles_us((1..=101_u64).rev().map(|us| us * 1000).collect()),
            Some([51.0, 100.0, 101.0])
        );
        assert_eq!(quantiles_us::<u64>(Vec::new()), None);
    }
}
