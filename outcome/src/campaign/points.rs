//! Results at each grid point: rates, medians and times with their intervals, and comparisons of points by seed.

use std::collections::BTreeMap;

use serde::Serialize;

use crate::campaign::statistics::{
    DistributionStep, Estimate, cumulative_distribution, estimate_median, estimate_rate,
    mcnemar_p_value,
};
use crate::campaign::table::RunRow;
use experiment::campaign::file::Campaign;

/// Frequency of an event among runs.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Rate {
    /// Number of runs in which the event occurred.
    pub count: usize,
    /// Number of runs counted.
    pub of: usize,
    /// Rate with its Wilson interval; `None` if no run was counted.
    pub rate: Option<Estimate>,
}

/// Median of a measured quantity.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Median {
    /// Number of runs counted.
    pub of: usize,
    /// Number of runs without a value, because the event never occurred.
    pub never: usize,
    /// Median with its bootstrap interval. The median is infinite, and `null` in JSON, if the event never occurred
    /// in more than half of the runs.
    pub median: Option<Estimate>,
}

/// Results at one point of the parameter grid.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct GridPoint {
    /// Number of the point, counted from 1.
    pub number: usize,
    /// Name and value of each axis.
    pub settings: Vec<(String, String)>,
    /// Runs with a result.
    pub runs: usize,
    /// Number of runs that were given up. No other field includes them.
    pub given_up: usize,
    /// Number of runs that are missing.
    pub missing: usize,
    /// Runs in which all expectations held, of the runs that declare any.
    pub held: Rate,
    /// Runs in which some pair was nearer than d at some tick.
    pub below_d: Rate,
    /// Runs in which all errors stayed below the bound from some time on.
    pub converged: Rate,
    /// Time of convergence, s.
    pub converged_at_s: Median,
    /// Smallest distance, divided by d.
    pub min_distance_over_d: Median,
    /// Worst error of the last 10 % of the run, m.
    pub final_error_m_max: Median,
    /// Distribution of convergence times. Runs that did not converge are censored at their end.
    #[serde(skip)]
    pub convergence: Vec<DistributionStep>,
    /// Smallest distance of each run divided by d, sorted.
    #[serde(skip)]
    pub distances: Vec<f64>,
}

/// Comparison of two grid points by runs of the same seed.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct PairedComparison {
    /// Number of the reference point.
    pub base: usize,
    /// Number of the point that is compared with it.
    pub point: usize,
    /// Number of seeds for which both points have a result.
    pub pairs: usize,
    /// Number of pairs in which the expectations held at the reference point only.
    pub held_base_only: usize,
    /// Number of pairs in which the expectations held at the compared point only.
    pub held_point_only: usize,
    /// Two-sided p-value of McNemar's exact test of equal probability.
    pub p_value: f64,
    /// Median difference of the smallest distance over d: compared point minus reference.
    pub distance_difference: Median,
    /// Median difference of the final error, m: compared point minus reference, over pairs in which both have one.
    pub error_difference_m: Median,
}

fn count_rate<'a>(flags: impl Iterator<Item = &'a bool>) -> Rate {
    let (mut count, mut of) = (0, 0);
    for flag in flags {
        count += usize::from(*flag);
        of += 1;
    }
    Rate { count, of, rate: estimate_rate(count, of) }
}

fn median_of_known_values(values: &[Option<f64>]) -> Median {
    let values_or_infinity: Vec<f64> =
        values.iter().map(|value| value.unwrap_or(f64::INFINITY)).collect();
    let never = values_or_infinity.iter().filter(|value| !value.is_finite()).count();
    Median { of: values_or_infinity.len(), never, median: estimate_median(&values_or_infinity) }
}

/// Computes the results at each grid point, in order.
pub fn compute_points(campaign: &Campaign, rows: &[RunRow<'_>]) -> Vec<GridPoint> {
    let runs_per_point = campaign.runs_per_point();
    (0..campaign.point_count())
        .map(|point| {
            let point_rows: Vec<_> =
                rows.iter().filter(|row| row.campaign_run.point_index == point).collect();
            let completed: Vec<_> =
                point_rows.iter().filter_map(|row| Some((*row, row.summary()?))).collect();
            let held: Vec<bool> = completed
                .iter()
                .filter(|(row, _)| row.verdict_keyword() != "undeclared")
                .map(|(row, _)| row.verdict_keyword() == "held")
                .collect();
            let below: Vec<bool> = completed.iter().map(|(_, s)| s.violations > 0).collect();
            let times: Vec<Option<f64>> = completed.iter().map(|(_, s)| s.converged_at_s).collect();
            let converged: Vec<bool> = times.iter().map(Option::is_some).collect();
            let converged_times_s: Vec<f64> = times.iter().flatten().copied().collect();
            let censored_times_s = completed.iter().filter(|(_, s)| s.converged_at_s.is_none());
            let censored_times_s: Vec<f64> = censored_times_s.map(|(_, s)| s.t_s).collect();
            let distance_over_d = |(row, s): &(&RunRow<'_>, &crate::metrics::summary::Summary)| {
                s.distance_over_d(row.campaign_run.distance_min_m)
            };
            let distances: Vec<Option<f64>> = completed.iter().map(distance_over_d).collect();
            let errors: Vec<Option<f64>> =
                completed.iter().map(|(_, s)| s.final_error_m_max).collect();
            let mut sorted_distances: Vec<f64> = distances.iter().flatten().copied().collect();
            sorted_distances.sort_by(f64::total_cmp);
            let settings = campaign.axes.iter().zip(campaign.settings_at(point));
            GridPoint {
                number: point + 1,
                settings: settings.map(|(a, s)| (a.key.clone(), s.display_text.clone())).collect(),
                runs: completed.len(),
                given_up: point_rows.len() - completed.len(),
                missing: runs_per_point - point_rows.len(),
                held: count_rate(held.iter()),
                below_d: count_rate(below.iter()),
                converged: count_rate(converged.iter()),
                converged_at_s: median_of_known_values(&times),
                min_distance_over_d: median_of_known_values(&distances),
                final_error_m_max: median_of_known_values(&errors),
                convergence: cumulative_distribution(&converged_times_s, &censored_times_s),
                distances: sorted_distances,
            }
        })
        .collect()
}

/// Compares every other point with the first, by seed.
pub fn compute_pairings(campaign: &Campaign, rows: &[RunRow<'_>]) -> Vec<PairedComparison> {
    let rows_by_seed = |point: usize| -> BTreeMap<u64, &RunRow<'_>> {
        let point_rows = rows
            .iter()
            .filter(|row| row.campaign_run.point_index == point && row.summary().is_some());
        point_rows.map(|row| (row.campaign_run.seed, row)).collect()
    };
    let base = rows_by_seed(0);
    let pairing = |point: usize| {
        let other = rows_by_seed(point);
        let pairs: Vec<_> =
            base.iter().filter_map(|(seed, row)| Some((*row, *other.get(seed)?))).collect();
        let held = |row: &RunRow<'_>| row.verdict_keyword() == "held";
        let count_held_only = |in_base: bool| {
            let differs =
                |(a, b): &&(&RunRow<'_>, &RunRow<'_>)| held(a) == in_base && held(b) != in_base;
            pairs.iter().filter(differs).count()
        };
        let difference = |value: &dyn Fn(&RunRow<'_>) -> Option<f64>| {
            let differences: Vec<Option<f64>> =
                pairs.iter().filter_map(|(a, b)| Some(Some(value(b)? - value(a)?))).collect();
            median_of_known_values(&differences)
        };
        let (held_base_only, held_point_only) = (count_held_only(true), count_held_only(false));
        PairedComparison {
            base: 1,
            point: point + 1,
            pairs: pairs.len(),
            held_base_only,
            held_point_only,
            p_value: mcnemar_p_value(held_base_only, held_point_only),
            distance_difference: difference(&|row| {
                row.summary()?.distance_over_d(row.campaign_run.distance_min_m)
            }),
            error_difference_m: difference(&|row| row.summary()?.final_error_m_max),
        }
    };
    (1..campaign.point_count()).map(pairing).filter(|pairing| pairing.pairs > 0).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::campaign::folder::RunState;
    use crate::metrics::expect::{Expectation, Verdict};
    use crate::metrics::summary::Summary;
    use experiment::campaign::cells::CampaignRun;
    use experiment::campaign::file::read_text;
    use experiment::scenario::read::Overrides;
    use protocol::catalog::Catalog;
    use std::path::Path;

    /// Two points of three seeds. The first converges at 1 s, 2 s and never. The second never holds and has no
    /// result for seed 3.
    #[test]
    fn point_counts_its_runs_and_pairs_share_a_seed() {
        let text = "name = 'a'\nscenario = '../../scenarios/triangle.toml'\nseeds = 3\n\
                    [vary]\navoidance.kind = ['guard', 'focus']\n";
        let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("src/campaign.toml");
        let catalog = Catalog { laws: Vec::new(), methods: Vec::new() };
        let campaign = read_text(&path, text, &catalog).unwrap();
        let cell = |point: usize, seed: u64| CampaignRun {
            number: 1,
            point_index: point,
            seed,
            id: format!("{point}{seed}"),
            scenario: "a.toml".into(),
            overrides: Overrides::default(),
            distance_min_m: 0.2,
            duration_s: 30.0,
        };
        let cells = [cell(0, 1), cell(0, 2), cell(0, 3), cell(1, 1), cell(1, 2), cell(1, 3)];
        let done = |held: bool, violations, converged_at_s, min_distance_m| {
            let expectation = Expectation { held, ..Expectation::default() };
            assert_eq!(expectation.verdict() == Verdict::Held, held);
            RunState::Done(Box::new(Summary {
                t_s: 30.0,
                violations,
                converged_at_s,
                min_distance_m: Some(min_distance_m),
                expectations: vec![expectation],
                ..Summary::default()
            }))
        };
        let states = [
            done(true, 0, Some(1.0), 0.3),
            done(true, 0, Some(2.0), 0.4),
            done(true, 0, None, 0.5),
            done(false, 7, Some(1.0), 0.1),
            done(false, 0, Some(1.5), 0.2),
            RunState::GivenUp("no room".into()),
        ];
        let rows: Vec<RunRow<'_>> = cells
            .iter()
            .zip(states)
            .map(|(cell, state)| RunRow { campaign_run: cell, state, failure_count: 0 })
            .collect();
        let [guard, focus] = &compute_points(&campaign, &rows)[..] else { panic!("two points") };
        assert_eq!((guard.runs, guard.given_up, guard.missing), (3, 0, 0));
        assert_eq!((focus.runs, focus.given_up, focus.missing), (2, 1, 0));
        let counts = |rate: Rate| (rate.count, rate.of);
        assert_eq!(
            [guard.held, guard.below_d, guard.converged].map(counts),
            [(3, 3), (0, 3), (2, 3)]
        );
        assert_eq!(
            [focus.held, focus.below_d, focus.converged].map(counts),
            [(0, 2), (1, 2), (2, 2)]
        );
        assert_eq!(guard.converged_at_s.median.unwrap().value, 2.0);
        assert_eq!((guard.converged_at_s.of, guard.converged_at_s.never), (3, 1));
        let shares: Vec<f64> = guard.convergence.iter().map(|step| step.share).collect();
        assert!((shares[1] - 2.0 / 3.0).abs() < 1e-12 && shares.len() == 2, "{shares:?}");
        assert_eq!(focus.settings, [("avoidance.kind".to_owned(), "focus".to_owned())]);

        let [pair] = &compute_pairings(&campaign, &rows)[..] else { panic!("one pair of points") };
        assert_eq!((pair.pairs, pair.held_base_only, pair.held_point_only), (2, 2, 0));
        assert_eq!(pair.p_value, 0.5);
        assert!((pair.distance_difference.median.unwrap().value + 1.0).abs() < 1e-12);
        // With only two runs, one of the first point is missing and no pair exists.
        assert_eq!(compute_points(&campaign, &rows[..2])[0].missing, 1);
        assert!(compute_pairings(&campaign, &rows[..2]).is_empty());
    }
}
