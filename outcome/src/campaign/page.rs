//! Report page `report.html` and data file `campaign.json` of a campaign.

use std::fmt::Write as _;

use crate::report::chart::Figure;
use crate::report::digits::format_four_digits;
use crate::report::html::{
    Section, TableCell as Field, description_list_html, figures_html, page_html, table_html,
};
use crate::results::files::manifest::BuildInfo;
use serde::Serialize;
use serde_json::{Value, json};

use crate::campaign::points::{GridPoint, Median, PairedComparison, Rate};
use crate::campaign::statistics::{BOOTSTRAP_SEED, Estimate, RESAMPLES};
use experiment::campaign::axes::{Axis, AxisKind, Case};
use experiment::campaign::file::Campaign;
use experiment::campaign::starts::{BoxCenter, GoalAssignment, RandomStarts};

/// Provenance of the numbers: build and executable.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Origin<'a> {
    /// Build information of this program.
    #[serde(flatten)]
    pub build: &'a BuildInfo,
    /// SHA-256 of the executable.
    pub executable: &'a str,
}

/// Returns the content of `campaign.json`.
pub fn campaign_json(
    campaign: &Campaign,
    points: &[GridPoint],
    pairs: &[PairedComparison],
    origin: &Origin<'_>,
) -> String {
    let axes: Vec<Value> = campaign.axes.iter().map(axis_to_json).collect();
    let zipped_axes: Vec<Vec<&str>> = (campaign.axis_groups.iter().filter(|group| group.len() > 1))
        .map(|group| group.iter().map(|&axis| campaign.axes[axis].key.as_str()).collect())
        .collect();
    let document = json!({
        "format": 1,
        "name": campaign.name,
        "scenario": campaign.scenario.display().to_string(),
        "pace": campaign.pace.keyword(),
        "keep": campaign.file_retention.keyword(),
        "set": campaign.assignments,
        "axes": axes,
        "zip": zipped_axes,
        "faults": campaign.faults,
        "seeds": campaign.seeds,
        "starts": campaign.random_starts.map(starts_to_json),
        "runs": campaign.run_count(),
        "bootstrap": { "resamples": RESAMPLES, "seed": BOOTSTRAP_SEED },
        "points": points,
        "pairs": pairs,
        "phalanx": origin,
    });
    serde_json::to_string_pretty(&document).expect("plain values") + "\n"
}

fn axis_to_json(axis: &Axis) -> Value {
    let values: Vec<&str> = axis.settings.iter().map(|s| s.display_text.as_str()).collect();
    let mut value = json!({ "key": axis.key, "values": values });
    if axis.kind == AxisKind::Cases {
        let cases = axis.settings.iter().map(|setting| {
            let Case { scenario, assignments, random_starts } = &setting.case;
            json!({
                "scenario": scenario.as_ref().map(|path| path.display().to_string()),
                "set": assignments,
                "faults": setting.faults,
                "starts": random_starts.map(starts_to_json),
            })
        });
        value["cases"] = cases.collect();
    }
    value
}

fn starts_to_json(starts: RandomStarts) -> Value {
    let RandomStarts { box_m, separation_min_m, box_center, goals } = starts;
    let (around, center_m) = match box_center {
        BoxCenter::Common(center_m) => ("middle", center_m),
        BoxCenter::PerRobot => ("each", None),
    };
    json!({ "box_m": box_m, "apart_m": separation_min_m, "around": around, "center_m": center_m, "goals": goals.keyword() })
}

/// Returns the content of `report.html`.
pub fn campaign_html(
    campaign: &Campaign,
    points: &[GridPoint],
    pairs: &[PairedComparison],
    figures: &[Figure],
) -> String {
    let runs: usize = points.iter().map(|point| point.runs).sum();
    let missing: usize = points.iter().map(|point| point.missing).sum();
    let given_up: usize = points.iter().map(|point| point.given_up).sum();
    let (point_count, seeds) = (points.len(), campaign.runs_per_point());
    let mut head = format!(
        "<p class=\"quiet\">{runs} runs: {point_count} combination{} of settings, {seeds} seed{}, {}</p>\n",
        if point_count == 1 { "" } else { "s" },
        if seeds == 1 { "" } else { "s" },
        campaign.pace.keyword()
    );
    if missing + given_up > 0 {
        let _ = writeln!(
            head,
            "<p class=\"verdict missed\">{missing} runs are missing and {given_up} were given up; the numbers below \
             do not include them</p>"
        );
    }
    let sections = [
        ("points", "Combinations of settings", points_table(campaign, points)),
        ("figures", "Figures", figures_html(figures)),
        ("pairs", "Seed by seed", pairs_table(pairs)),
        ("campaign", "Campaign", campaign_list(campaign)),
    ];
    let sections = sections.into_iter().filter(|(_, _, content)| !content.is_empty());
    let sections = sections.map(|(id, title, content)| Section { id, title, content });
    let title = format!("{}: report of a campaign", campaign.name);
    page_html(&campaign.name, &title, &head, sections.collect())
}

fn points_table(campaign: &Campaign, points: &[GridPoint]) -> String {
    let mut heads = vec!["#No.".to_owned()];
    heads.extend(campaign.axes.iter().map(|axis| axis.key.clone()));
    let fixed = [
        "#n",
        "#Held",
        "#Below d",
        "#Converged",
        "#Converged at, s",
        "#Smallest distance / d",
        "#Final error, m",
    ];
    heads.extend(fixed.map(str::to_owned));
    let rows = points.iter().map(|point| {
        let mut row = vec![Field::Number(point.number.to_string())];
        row.extend(point.settings.iter().map(|(_, value)| Field::UnbrokenText(value.clone())));
        row.push(Field::Number(point.runs.to_string()));
        row.extend(
            [point.held, point.below_d, point.converged].map(|r| Field::Number(format_rate(r))),
        );
        let medians = [point.converged_at_s, point.min_distance_over_d, point.final_error_m_max];
        row.extend(medians.map(|median| Field::Number(format_median(median))));
        row
    });
    let heads: Vec<&str> = heads.iter().map(String::as_str).collect();
    format!(
        "{}<p class=\"quiet\">Rates are counts of runs with Wilson intervals of 95 %. The other columns are medians \
         of n runs with BCa bootstrap intervals of 95 %. A dash means that the data give no interval, because all \
         values are equal or too many runs never reached the event. Held: every expectation of the scenario held.</p>\n",
        table_html(&heads, rows)
    )
}

fn format_rate(rate: Rate) -> String {
    let Rate { count, of, rate } = rate;
    let percent = |share: f64| format!("{:.1}", 100.0 * share);
    match rate {
        Some(Estimate { low: Some(low), high: Some(high), .. }) => {
            format!("{count} of {of} ({}\u{2013}{} %)", percent(low), percent(high))
        }
        _ => "\u{2013}".into(),
    }
}

fn format_median(median: Median) -> String {
    let Some(Estimate { value, low, high }) = median.median else { return "\u{2013}".into() };
    if !value.is_finite() {
        return format!("never ({} of {})", median.never, median.of);
    }
    let format_bound = |bound: Option<f64>| bound.map_or("\u{2013}".into(), format_four_digits);
    let interval = match (low, high) {
        (None, None) => "(\u{2013})".into(),
        _ => format!("({} to {})", format_bound(low), format_bound(high)),
    };
    let never = match median.never {
        0 => String::new(),
        never => format!(", never {never}"),
    };
    format!("{} {interval}{never}", format_four_digits(value))
}

fn pairs_table(pairs: &[PairedComparison]) -> String {
    let heads = [
        "#Point",
        "#Against",
        "#Pairs",
        "#Held only in the first",
        "#Held only in the second",
        "#p (McNemar)",
        "#Smallest distance / d: difference",
        "#Final error: difference, m",
    ];
    let rows = pairs.iter().map(|pair| {
        [
            pair.point.to_string(),
            pair.base.to_string(),
            pair.pairs.to_string(),
            pair.held_point_only.to_string(),
            pair.held_base_only.to_string(),
            format_four_digits(pair.p_value),
            format!(
                "{}, n = {}",
                format_median(pair.distance_difference),
                pair.distance_difference.of
            ),
            format!(
                "{}, n = {}",
                format_median(pair.error_difference_m),
                pair.error_difference_m.of
            ),
        ]
        .map(Field::Number)
        .into()
    });
    let table = table_html(&heads, rows);
    match table.is_empty() {
        true => table,
        false => format!(
            "<p>Each point is compared with the first by runs of the same seed: McNemar's exact test on the runs that \
             held at only one of the two points, and medians of the differences with BCa bootstrap intervals of \
             95 %.</p>\n{table}"
        ),
    }
}

fn campaign_list(campaign: &Campaign) -> String {
    let mut rows = vec![
        ("Scenario", campaign.scenario.display().to_string()),
        ("Time mode", campaign.pace.keyword().to_owned()),
    ];
    for assignment in &campaign.assignments {
        rows.push(("Set", assignment.clone()));
    }
    for fault in &campaign.faults {
        rows.push(("Fault", fault.clone()));
    }
    rows.extend(campaign.random_starts.map(|starts| ("Starts", describe_starts(starts))));
    for axis in campaign.axes.iter().filter(|axis| axis.kind == AxisKind::Cases) {
        for setting in &axis.settings {
            let Case { scenario, assignments, random_starts } = &setting.case;
            let scenario = scenario.iter().map(|path| format!("scenario {}", path.display()));
            let faults = setting.faults.iter().map(|fault| format!("fault {fault}"));
            let starts =
                random_starts.iter().map(|starts| format!("starts {}", describe_starts(*starts)));
            let changes: Vec<_> =
                scenario.chain(assignments.iter().cloned()).chain(faults).chain(starts).collect();
            let changes =
                if changes.is_empty() { "nothing changed".to_owned() } else { changes.join("; ") };
            rows.push(("Case", format!("{} {}: {changes}", axis.key, setting.display_text)));
        }
    }
    rows.push(("Bootstrap", format!("{RESAMPLES} samples, seed {BOOTSTRAP_SEED}")));
    description_list_html(rows.iter().map(|(name, value)| (*name, value.as_str())))
}

fn describe_starts(starts: RandomStarts) -> String {
    let RandomStarts { box_m: [width, height], separation_min_m, box_center, goals } = starts;
    let center_note =
        if box_center == BoxCenter::PerRobot { " around each robot's own start" } else { "" };
    let swaps_text = match goals {
        GoalAssignment::Own => "",
        GoalAssignment::Swaps => "; random pairs swap places",
    };
    format!(
        "drawn from the seed in {width} m by {height} m{center_note}, at least {separation_min_m} m apart{swaps_text}"
    )
}
