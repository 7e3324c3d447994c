//! Margin of an expectation: its signed distance from being missed, as a fraction of its bound.
//!
//! The margin is negative if the expectation was missed, like the robustness of a signal temporal logic formula
//! that is false. Examples: smallest distance over d, minus 1; time left to convergence over the limit; 1 minus
//! error over bound.

use crate::metrics::expect::{Expectation, FAILED_ROBOTS_NAME, METRIC_NAME_PREFIX, Verdict};
use crate::metrics::summary::Summary;
use protocol::number::format_short;

/// Returns whether the expectation with this name has a margin: those in [`EXPECTATIONS_WITH_MARGIN`], and bounds of
/// metrics.
pub fn has_margin(name: &str) -> bool {
    EXPECTATIONS_WITH_MARGIN.contains(&name) || name.starts_with(METRIC_NAME_PREFIX)
}

/// Names of the expectations that have a margin, except for bounds of metrics.
pub const EXPECTATIONS_WITH_MARGIN: [&str; 10] = [
    "min_distance_m",
    "min_distance_over_d",
    "min_clearance_m",
    "final_error_m_max",
    "final_ideal_error_m_max",
    "tracking_error_m_max",
    "hull_distance_m_max",
    "converged_by_s",
    "recovered_within_s",
    "alive_at_end",
];

/// Margin of an expectation without a value, because no robot counts or the event never occurred.
const NO_VALUE_MARGIN: f64 = 1.0;

/// Returns the margin of an expectation as a fraction of its bound. It is negative if and only if the expectation
/// was missed.
pub fn margin(expectation: &Expectation) -> f64 {
    let Expectation { value, bound, .. } = expectation;
    let unit = match &*expectation.name {
        "alive_at_end" | FAILED_ROBOTS_NAME => bound.max(1.0),
        name if name.starts_with(METRIC_NAME_PREFIX) && *bound == 0.0 => 1.0,
        _ => bound.abs(),
    };
    let above = value.map(|value| (value - bound) / unit.max(f64::MIN_POSITIVE));
    let margin = above.map(|above| if expectation.relation() == "<=" { -above } else { above });
    match (expectation.verdict(), margin) {
        (Verdict::Held, margin) => margin.map_or(NO_VALUE_MARGIN, |margin| margin.max(0.0)),
        // A counted robot is dead, or the event never occurred.
        (_, Some(margin)) if margin < 0.0 => margin,
        _ => -NO_VALUE_MARGIN,
    }
}

/// Describes the result of an expectation in one sentence.
pub fn describe(expectation: &Expectation, summary: &Summary) -> String {
    let Expectation { name, value, reason, .. } = expectation;
    let bound = format_short(expectation.bound);
    let bound_relation = if expectation.relation() == "<=" { "at most" } else { "at least" };
    let distance = (summary.min_distance_m, &summary.min_distance_pair, summary.min_distance_t_s);
    let result = match (&**name, distance, value) {
        ("min_distance_m", (Some(m), Some([a, b]), Some(t_s)), _) => {
            format!(
                "{a} and {b} come within {} m of each other at {} s",
                format_short(m),
                format_short(t_s)
            )
        }
        (_, _, Some(value)) => format!("{name} is {}", format_short(*value)),
        (_, _, None) => format!("{name} is never reached"),
    };
    let reason = reason.as_ref().map(|reason| format!(" ({reason})")).unwrap_or_default();
    format!("{result}{reason}; expected: {bound_relation} {bound}")
}

#[cfg(test)]
mod tests {
    use super::*;

    fn margin_for(name: &str, value: Option<f64>, bound: f64, verdict: Verdict) -> f64 {
        let held = verdict == Verdict::Held;
        margin(&Expectation { name: name.into(), value, bound, held, verdict, reason: None })
    }

    #[test]
    fn margin_is_relative_to_the_bound_and_negative_if_missed() {
        use Verdict::{Held, Missed};
        for (name, value, bound, verdict, expected) in [
            ("min_distance_m", Some(0.3), 0.2, Held, 0.5),
            ("min_distance_m", Some(0.2), 0.2, Held, 0.0),
            ("min_distance_m", Some(0.1), 0.2, Missed, -0.5),
            ("converged_by_s", Some(9.0), 10.0, Held, 0.1),
            ("converged_by_s", None, 10.0, Missed, -1.0),
            ("converged_by_s", None, 10.0, Held, 1.0),
            ("final_error_m_max", Some(0.003), 0.001, Missed, -2.0),
            // The error is small enough, but a robot is dead.
            ("final_error_m_max", Some(0.0), 0.001, Missed, -1.0),
            ("alive_at_end", Some(3.0), 4.0, Missed, -0.25),
            ("alive_at_end", Some(0.0), 0.0, Held, 0.0),
            (FAILED_ROBOTS_NAME, Some(2.0), 0.0, Missed, -2.0),
            ("metrics.cost_m2.max", Some(3.0), 2.0, Missed, -0.5),
            ("metrics.gap_m.min", Some(-1.0), -2.0, Held, 0.5),
            ("metrics.gap_m.min", Some(-0.25), 0.0, Missed, -0.25),
        ] {
            let found = margin_for(name, value, bound, verdict);
            assert!((found - expected).abs() < 1e-12, "{name} {value:?}: {found}");
        }
    }

    #[test]
    fn near_miss_names_robots_and_time() {
        let summary = Summary {
            min_distance_m: Some(0.15),
            min_distance_pair: Some(["a", "b"].map(String::from)),
            min_distance_t_s: Some(2.5),
            ..Summary::default()
        };
        let name = "min_distance_m".to_owned();
        let expectation =
            Expectation { name, value: Some(0.15), bound: 0.2, ..Expectation::default() };
        let expected = "a and b come within 0.15 m of each other at 2.5 s; expected: at least 0.2";
        assert_eq!(describe(&expectation, &summary), expected);
    }
}
