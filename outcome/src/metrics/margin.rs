//! How far an expectation is from being missed: a signed distance over the run, in parts of its bound.
//!
//! It is negative where the expectation was missed, as the robustness of signal temporal logic is where a formula is
//! false: the smallest distance over d less 1, time left to convergence over the limit, 1 less an error over its
//! bound.

use crate::metrics::expect::{Expectation, Verdict};
use crate::metrics::summary::Summary;
use protocol::number::short;

/// The expectations that have a margin.
pub const WITH_MARGIN: [&str; 9] = [
    "min_distance_m",
    "min_clearance_m",
    "final_error_m_max",
    "final_ideal_error_m_max",
    "tracking_error_m_max",
    "hull_distance_m_max",
    "converged_by_s",
    "recovered_within_s",
    "alive_at_end",
];

/// The margin of what has no value: nobody counts, or it never came about.
const WHOLE: f64 = 1.0;

/// The margin of an expectation, in parts of its bound: below 0 exactly where it was missed.
pub fn margin(expectation: &Expectation) -> f64 {
    let Expectation { value, bound, .. } = expectation;
    let unit = if expectation.name == "alive_at_end" { bound.max(1.0) } else { *bound };
    let above = value.map(|value| (value - bound) / unit.max(f64::MIN_POSITIVE));
    let margin = above.map(|above| if expectation.relation() == "<=" { -above } else { above });
    match (expectation.verdict(), margin) {
        (Verdict::Held, margin) => margin.map_or(WHOLE, |margin| margin.max(0.0)),
        // Whoever counts is dead, or it never came about.
        (_, Some(margin)) if margin < 0.0 => margin,
        _ => -WHOLE,
    }
}

/// What the expectation is about, as it came out, in one sentence.
pub fn in_words(expectation: &Expectation, summary: &Summary) -> String {
    let Expectation { name, value, reason, .. } = expectation;
    let bound = short(expectation.bound);
    let asked = if expectation.relation() == "<=" { "at most" } else { "at least" };
    let distance = (summary.min_distance_m, &summary.min_distance_pair, summary.min_distance_t_s);
    let what = match (&**name, distance, value) {
        ("min_distance_m", (Some(m), Some([a, b]), Some(t_s)), _) => {
            format!("{a} and {b} come within {} m of each other at {} s", short(m), short(t_s))
        }
        (_, _, Some(value)) => format!("{name} is {}", short(*value)),
        (_, _, None) => format!("{name} never comes about"),
    };
    let reason = reason.as_ref().map(|reason| format!(" ({reason})")).unwrap_or_default();
    format!("{what}{reason}; {asked} {bound} is expected")
}

#[cfg(test)]
mod tests {
    use super::*;

    fn asked(name: &str, value: Option<f64>, bound: f64, verdict: Verdict) -> f64 {
        let held = verdict == Verdict::Held;
        margin(&Expectation { name: name.into(), value, bound, held, verdict, reason: None })
    }

    #[test]
    fn a_margin_is_in_parts_of_the_bound_and_negative_where_it_was_missed() {
        use Verdict::{Held, Missed};
        for (name, value, bound, verdict, expected) in [
            ("min_distance_m", Some(0.3), 0.2, Held, 0.5),
            ("min_distance_m", Some(0.2), 0.2, Held, 0.0),
            ("min_distance_m", Some(0.1), 0.2, Missed, -0.5),
            ("converged_by_s", Some(9.0), 10.0, Held, 0.1),
            ("converged_by_s", None, 10.0, Missed, -1.0),
            ("converged_by_s", None, 10.0, Held, 1.0),
            ("final_error_m_max", Some(0.003), 0.001, Missed, -2.0),
            // Small enough, of robots that are dead.
            ("final_error_m_max", Some(0.0), 0.001, Missed, -1.0),
            ("alive_at_end", Some(3.0), 4.0, Missed, -0.25),
            ("alive_at_end", Some(0.0), 0.0, Held, 0.0),
        ] {
            let found = asked(name, value, bound, verdict);
            assert!((found - expected).abs() < 1e-12, "{name} {value:?}: {found}");
        }
    }

    #[test]
    fn a_near_miss_is_told_with_who_and_when() {
        let summary = Summary {
            min_distance_m: Some(0.15),
            min_distance_pair: Some(["a", "b"].map(String::from)),
            min_distance_t_s: Some(2.5),
            ..Summary::default()
        };
        let name = "min_distance_m".to_owned();
        let expectation =
            Expectation { name, value: Some(0.15), bound: 0.2, ..Expectation::default() };
        let words = "a and b come within 0.15 m of each other at 2.5 s; at least 0.2 is expected";
        assert_eq!(in_words(&expectation, &summary), words);
    }
}
