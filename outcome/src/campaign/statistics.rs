//! Statistics of samples: rates, medians and censored times, with confidence intervals.
//!
//! All functions take and return plain numbers. The test `tests/readers/by_scipy.py` compares them with SciPy and
//! statsmodels. All intervals are two-sided, of 95 %.

use formation::portable_math;
use formation::random::SplitMix64;

/// Probability that an interval does not contain the true value.
const SIGNIFICANCE_LEVEL: f64 = 0.05;
/// Quantile of the standard normal distribution at 1 - ALPHA/2.
const NORMAL_QUANTILE: f64 = 1.959_963_984_540_054;
/// Number of samples drawn for a bootstrap interval.
pub const RESAMPLES: usize = 9999;
/// Seed of the bootstrap: equal data give equal intervals.
pub const BOOTSTRAP_SEED: u64 = 20_091_231;

/// An estimated value with its confidence interval.
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize)]
pub struct Estimate {
    /// Estimated value.
    pub value: f64,
    /// Lower end of the interval; `None` if the data do not bound it.
    pub low: Option<f64>,
    /// Upper end of the interval; `None` if the data do not bound it.
    pub high: Option<f64>,
}

/// Returns the rate `count / of` with its Wilson score interval (Wilson 1927). Returns `None` if `of` is 0.
pub fn estimate_rate(count: usize, of: usize) -> Option<Estimate> {
    if of == 0 {
        return None;
    }
    let (k, n) = (count as f64, of as f64);
    let p = k / n;
    let scale = 1.0 + NORMAL_QUANTILE * NORMAL_QUANTILE / n;
    let middle = (p + NORMAL_QUANTILE * NORMAL_QUANTILE / (2.0 * n)) / scale;
    let half = NORMAL_QUANTILE / scale
        * (p * (1.0 - p) / n + NORMAL_QUANTILE * NORMAL_QUANTILE / (4.0 * n * n)).sqrt();
    // Rounding must not move the ends past the observed 0 or 1.
    let low = if count == 0 { 0.0 } else { middle - half };
    let high = if count == of { 1.0 } else { middle + half };
    Some(Estimate { value: p, low: Some(low), high: Some(high) })
}

/// Returns the median of finite values, or `None` for an empty slice.
pub fn finite_median(values: &[f64]) -> Option<f64> {
    let mut sorted = values.to_vec();
    sorted.sort_by(f64::total_cmp);
    sorted_median(&sorted)
}

fn sorted_median(sorted: &[f64]) -> Option<f64> {
    let n = sorted.len();
    match n {
        0 => None,
        _ if n % 2 == 1 => Some(sorted[n / 2]),
        // The mean of two infinities of opposite sign is undefined; equal ones need no mean.
        _ if sorted[n / 2 - 1] == sorted[n / 2] => Some(sorted[n / 2]),
        _ => Some((sorted[n / 2 - 1] + sorted[n / 2]) / 2.0),
    }
}

/// Returns the median with its bias-corrected and accelerated (BCa) bootstrap interval (Efron 1987). Infinite
/// values stand for events that never occurred. The interval is missing if there are fewer than two values or all
/// are equal; an end is missing if it is beyond all finite values.
pub fn estimate_median(values: &[f64]) -> Option<Estimate> {
    let value = finite_median(values)?;
    let medians = bootstrap_medians(values, RESAMPLES, BOOTSTRAP_SEED);
    let interval = bca_interval(values, value, &medians);
    let finite = |bound: f64| Some(bound).filter(|bound| bound.is_finite());
    let [low, high] = interval.map_or([None, None], |interval| interval.map(finite));
    Some(Estimate { value, low, high })
}

/// Returns the sorted medians of `resamples` samples that are drawn from the values with replacement.
pub fn bootstrap_medians(values: &[f64], resamples: usize, seed: u64) -> Vec<f64> {
    let mut sorted = values.to_vec();
    sorted.sort_by(f64::total_cmp);
    let mut rng = SplitMix64::new(seed);
    let n = sorted.len() as u64;
    if n == 0 {
        return Vec::new();
    }
    // For each index of the sorted values, the number of times that it was drawn; the medians follow by counting.
    let mut counts = vec![0_u32; sorted.len()];
    let mut medians: Vec<f64> = (0..resamples)
        .map(|_| {
            counts.fill(0);
            (0..n).for_each(|_| counts[rng.draw_between(0, n - 1) as usize] += 1);
            let value_at_rank = |rank: u64| {
                let mut cumulative_count = 0;
                let index = counts.iter().position(|&count| {
                    cumulative_count += u64::from(count);
                    cumulative_count > rank
                });
                sorted[index.expect("all of them were drawn")]
            };
            let (low, high) = (value_at_rank((n - 1) / 2), value_at_rank(n / 2));
            if low == high { low } else { (low + high) / 2.0 }
        })
        .collect();
    medians.sort_by(f64::total_cmp);
    medians
}

/// Returns the BCa interval of the median, from the sorted bootstrap medians. Returns `None` where the interval is
/// not defined.
pub fn bca_interval(values: &[f64], value: f64, medians: &[f64]) -> Option<[f64; 2]> {
    let n = values.len();
    if n < 2 || medians.is_empty() || !value.is_finite() {
        return None;
    }
    let below = medians.iter().filter(|median| **median < value).count();
    let at_or_below = medians.iter().filter(|median| **median <= value).count();
    let share = (below + at_or_below) as f64 / (2 * medians.len()) as f64;
    let bias = normal_quantile(share);
    // Jackknife: medians without each value in turn.
    let mut sorted = values.to_vec();
    sorted.sort_by(f64::total_cmp);
    let jackknife_medians: Option<Vec<f64>> = (0..n)
        .map(|left_out| {
            let rest: Vec<f64> = sorted
                .iter()
                .enumerate()
                .filter(|(i, _)| *i != left_out)
                .map(|(_, v)| *v)
                .collect();
            sorted_median(&rest).filter(|median| median.is_finite())
        })
        .collect();
    let jackknife_medians = jackknife_medians?;
    let mean = jackknife_medians.iter().sum::<f64>() / n as f64;
    let [squares, cubes] = [2.0, 3.0].map(|power| {
        jackknife_medians.iter().map(|m| portable_math::pow(mean - m, power)).sum::<f64>()
    });
    let acceleration = cubes / (6.0 * portable_math::pow(squares, 1.5));
    if !bias.is_finite() || !acceleration.is_finite() {
        return None;
    }
    let interval = [SIGNIFICANCE_LEVEL / 2.0, 1.0 - SIGNIFICANCE_LEVEL / 2.0].map(|alpha| {
        let z = bias + normal_quantile(alpha);
        let level = normal_cdf(bias + z / (1.0 - acceleration * z));
        interpolated_quantile(medians, level)
    });
    Some(interval)
}

/// Returns a quantile of a sorted slice, with linear interpolation.
fn interpolated_quantile(sorted: &[f64], level: f64) -> f64 {
    let position = level.clamp(0.0, 1.0) * (sorted.len() - 1) as f64;
    let (low, high) = (sorted[position.floor() as usize], sorted[position.ceil() as usize]);
    if low == high { low } else { low + (high - low) * position.fract() }
}

/// A step of a cumulative distribution.
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize)]
pub struct DistributionStep {
    /// Value at which the cumulative fraction changes.
    pub value: f64,
    /// Cumulative fraction of events up to and including `value`.
    pub share: f64,
}

/// Returns the distribution of event times, of which some are right-censored (`censored` holds the times at which
/// those runs ended): one minus the Kaplan-Meier estimate (1958). It ends below 1 if the last time is censored.
pub fn cumulative_distribution(event_times: &[f64], censored: &[f64]) -> Vec<DistributionStep> {
    let mut event_times = event_times.to_vec();
    event_times.sort_by(f64::total_cmp);
    let mut survival = 1.0;
    let mut steps: Vec<DistributionStep> = Vec::new();
    let mut index = 0;
    while index < event_times.len() {
        let value = event_times[index];
        let event_count = event_times[index..].iter().take_while(|other| **other == value).count();
        let at_risk =
            (event_times.len() - index) + censored.iter().filter(|end| **end >= value).count();
        survival *= 1.0 - event_count as f64 / at_risk as f64;
        steps.push(DistributionStep { value, share: 1.0 - survival });
        index += event_count;
    }
    steps
}

/// Returns the two-sided p-value of McNemar's exact test (binomial test of 1/2): of the discordant pairs, `first`
/// favor one side and `second` the other.
pub fn mcnemar_p_value(first: usize, second: usize) -> f64 {
    let (smaller, n) = (first.min(second), first + second);
    // C(n, k) / 2^n, each term from the one before, as logarithms because n may be large.
    let mut term = -(n as f64) * std::f64::consts::LN_2;
    let mut sum = 0.0;
    for k in 0..=smaller {
        sum += portable_math::exp(term);
        term += portable_math::ln((n - k) as f64 / (k + 1) as f64);
    }
    (2.0 * sum).min(1.0)
}

/// Returns the cumulative distribution function of the standard normal distribution at z.
pub fn normal_cdf(z: f64) -> f64 {
    0.5 * portable_math::erfc(-z / std::f64::consts::SQRT_2)
}

/// Returns the quantile of the standard normal distribution, by bisection. Returns infinity at 0 and 1, and NaN
/// outside of [0, 1].
pub fn normal_quantile(probability: f64) -> f64 {
    if !(probability > 0.0 && probability < 1.0) {
        return if probability == 0.0 {
            f64::NEG_INFINITY
        } else if probability == 1.0 {
            f64::INFINITY
        } else {
            f64::NAN
        };
    }
    let (mut low, mut high) = (-40.0, 40.0);
    for _ in 0..60 {
        let middle = (low + high) / 2.0;
        if normal_cdf(middle) < probability { low = middle } else { high = middle }
    }
    (low + high) / 2.0
}
