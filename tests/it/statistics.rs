//! The statistics of campaigns, compared with SciPy and statsmodels on data generated from seeds.

use formation::random::SplitMix64;
use outcome::campaign::statistics;
use serde_json::{Value, json};

use crate::recording::assert_script_succeeds;

/// Draws values of the distribution `kind`.
fn values(random: &mut SplitMix64, n: usize, kind: u64) -> Vec<f64> {
    let value = |random: &mut SplitMix64| match kind {
        // Uniform; skewed; few distinct values with many ties.
        0 => random.draw_unit(),
        1 => -(1.0 - random.draw_unit()).ln(),
        _ => random.draw_between(0, 6) as f64,
    };
    (0..n).map(|_| value(random)).collect()
}

#[test]
#[ignore = "needs SciPy and statsmodels, which tests/readers/install installs"]
fn statistics_agree_with_other_readers_of_the_same_data() {
    let mut random = SplitMix64::new(20_261_122);
    let mut rates = Vec::new();
    for total in [1, 2, 7, 200, 1000] {
        for count in [0, 1, total / 2, total] {
            rates.push(json!({ "count": count, "of": total, "own": statistics::estimate_rate(count, total) }));
        }
    }
    let (mut medians, mut times, mut pairs) = (Vec::new(), Vec::new(), Vec::new());
    for n in [2, 3, 10, 35, 200] {
        for kind in 0..3 {
            let sample = values(&mut random, n, kind);
            let drawn = statistics::bootstrap_medians(&sample, 999, 7);
            let value = statistics::finite_median(&sample).unwrap();
            let interval = statistics::bca_interval(&sample, value, &drawn);
            medians.push(
                json!({ "sample": sample, "drawn": drawn, "median": value, "ends": interval }),
            );
            let all = values(&mut random, n, kind);
            let (mut observed, mut censored) = (Vec::new(), Vec::new());
            for time in all {
                if random.draw_bool(0.7) { observed.push(time) } else { censored.push(time) }
            }
            let steps = statistics::cumulative_distribution(&observed, &censored);
            times.push(json!({ "came": observed, "censored": censored, "steps": steps }));
        }
    }
    for [first, second] in [[0, 0], [0, 1], [3, 9], [9, 3], [5, 5], [40, 61], [400, 480]] {
        pairs.push(
            json!({ "first": first, "second": second, "p": statistics::mcnemar_p_value(first, second) }),
        );
    }
    let quantiles: Vec<Value> = [1e-12, 1e-3, 0.025, 0.3, 0.5, 0.975, 0.999_999]
        .iter()
        .map(|&fraction| json!({ "share": fraction, "z": statistics::normal_quantile(fraction) }))
        .collect();
    let data = json!({
        "rates": rates, "medians": medians, "times": times, "pairs": pairs, "quantiles": quantiles,
    });
    let scratch = tempfile::tempdir().unwrap();
    let path = scratch.path().join("statistics.json");
    std::fs::write(&path, data.to_string()).unwrap();
    assert_script_succeeds("by_scipy", &[&path]);
}
