//! The scenario's expectations, held against what was measured.

use protocol::brief::Pace;
use serde::{Deserialize, Serialize};

use super::Measures;
use experiment::scenario::Expectations;

/// One expectation and how it came out.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct Expectation {
    /// Its key in the scenario.
    pub name: String,
    /// What was measured; `None`: it never came about.
    pub value: Option<f64>,
    /// What was asked for.
    pub bound: f64,
    /// Whether it held.
    pub held: bool,
}

/// Every expectation of the scenario; `exit`: the code that the run itself ended with.
pub fn evaluate(
    expect: &Expectations,
    measures: &Measures,
    pace: Pace,
    deadline_misses: u64,
    exit: u8,
) -> Vec<Expectation> {
    let mut found = Vec::new();
    let mut ask =
        |name: &str, bound: Option<f64>, value: Option<f64>, holds: fn(f64, f64) -> bool| {
            if let Some(bound) = bound {
                let held = value.is_some_and(|value| holds(value, bound));
                found.push(Expectation { name: name.to_owned(), value, bound, held });
            }
        };
    let at_least = |value, bound| value >= bound;
    let at_most = |value, bound| value <= bound;
    let equal = |value, bound| value == bound;
    ask("min_distance_m", expect.min_distance_m, measures.min_distance_m, at_least);
    ask("final_error_m_max", expect.final_error_m_max, measures.final_error_m_max, at_most);
    let ideal = (expect.final_ideal_error_m_max, measures.final_ideal_error_m_max);
    ask("final_ideal_error_m_max", ideal.0, ideal.1, at_most);
    let tracking = (expect.tracking_error_m_max, measures.tracking_error_m_max);
    ask("tracking_error_m_max", tracking.0, tracking.1, at_most);
    let hull = (expect.hull_distance_m_max, measures.hull_distance_m_max_final);
    ask("hull_distance_m_max", hull.0, hull.1, at_most);
    ask("converged_by_s", expect.converged_by_s, measures.converged_at_s, at_most);
    let recoveries = measures.faults.iter().map(|fault| fault.recovered_after_s);
    let slowest =
        recoveries.collect::<Option<Vec<f64>>>().map(|all| all.into_iter().fold(0.0, f64::max));
    // Without a fault there is nothing that could recover, and a typing error in the timeline.
    let slowest = slowest.filter(|_| !measures.faults.is_empty());
    ask("recovered_within_s", expect.recovered_within_s, slowest, at_most);
    let misses_max = expect.deadline_misses_max.filter(|_| pace == Pace::Realtime);
    let misses = Some(deadline_misses as f64);
    ask("deadline_misses_max", misses_max.map(|bound| bound as f64), misses, at_most);
    ask("exit", expect.exit.map(f64::from), Some(f64::from(exit)), equal);
    found
}

#[cfg(test)]
mod tests {
    use super::*;

    fn measures() -> Measures {
        Measures {
            min_distance_m: Some(0.2),
            min_distance_pair: None,
            min_distance_t_s: None,
            violations: 0,
            final_error_m: Vec::new(),
            final_error_m_max: Some(0.5),
            final_ideal_error_m: Vec::new(),
            final_ideal_error_m_max: Some(0.5),
            tracking_error_m_max: None,
            integrated_error_m_s: Vec::new(),
            pairs: Vec::new(),
            hull_distance_m_max_final: None,
            converged_at_s: None,
            trajectory_hash: None,
            truths_lost: 0,
            faults: Vec::new(),
        }
    }

    #[test]
    fn bounds_include_their_ends_and_what_never_came_about_does_not_hold() {
        let expect = Expectations {
            min_distance_m: Some(0.2),
            final_error_m_max: Some(0.4),
            final_ideal_error_m_max: Some(0.5),
            tracking_error_m_max: Some(0.4),
            hull_distance_m_max: None,
            converged_by_s: Some(10.0),
            recovered_within_s: Some(1.0),
            deadline_misses_max: Some(0),
            exit: Some(0),
            converged_error_m: 0.01,
        };
        let held = |pace| -> Vec<(String, bool)> {
            let found = evaluate(&expect, &measures(), pace, 1, 0);
            found.into_iter().map(|expectation| (expectation.name, expectation.held)).collect()
        };
        let named = |held: &[(&str, bool)]| -> Vec<(String, bool)> {
            held.iter().map(|&(name, held)| (name.to_owned(), held)).collect()
        };
        let in_both = [
            ("min_distance_m", true),
            ("final_error_m_max", false),
            ("final_ideal_error_m_max", true),
            ("tracking_error_m_max", false),
            ("converged_by_s", false),
            ("recovered_within_s", false),
        ];
        assert_eq!(held(Pace::Lockstep), named(&[&in_both[..], &[("exit", true)]].concat()));
        let in_real_time = [("deadline_misses_max", false), ("exit", true)];
        assert_eq!(held(Pace::Realtime), named(&[&in_both[..], &in_real_time[..]].concat()));
    }
}
