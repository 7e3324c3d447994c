//! Figure of the distances of all pairs: the chapter's Figures 5, 9 and 13.

use formation::Vec2;

use super::{
    ALL_ROBOTS_LINE, BOUND_LINE, CurveSet, NAMED_CURVE_COUNT, WIDTH, bands_caption,
    describe_expectation, full_width_row, panel_over_time,
};
use crate::report::axis::Axis;
use crate::report::chart::{Figure, Mark, MarkShape, Panel};
use crate::report::digits::format_four_digits;
use crate::report::palette::{BLACK, robot_line};
use crate::report::run::LoadedRun;
use protocol::number::format_short;

/// Maximum number of pairs with a curve each. Of more pairs, only the smallest of all distances and the nearest
/// pairs are drawn.
const DRAWN_PAIRS_MAX: usize = 120;
/// Range of the lower panel, in multiples of d.
const LOWER_PANEL_RANGE: (f64, f64) = (0.9, 1.6);

/// Distances of all pairs of robots, m; in a team each divided by the minimum distance of the pair.
struct PairDistances {
    pairs: Vec<[usize; 2]>,
    /// Smallest distance of each pair.
    pair_minimum: Vec<f64>,
    /// Smallest distance of all pairs at each instant.
    instant_minimum: Vec<f64>,
    /// Largest distance of all pairs and instants.
    maximum: f64,
}

/// Returns the distance, m, by which the distance of a pair is divided: its minimum distance in a team, otherwise 1 m.
fn divisor_m(run: &LoadedRun, pair: [usize; 2]) -> f64 {
    let keep_m = pair.map(|robot| run.scene.robots[robot].keep_m);
    keep_m[0].zip(keep_m[1]).map_or(1.0, |(first_m, second_m)| first_m + second_m)
}

impl PairDistances {
    fn compute(run: &LoadedRun) -> PairDistances {
        let robots = run.scene.robots.len();
        let pairs = (0..robots).flat_map(|i| (i + 1..robots).map(move |j| [i, j]));
        let pairs: Vec<[usize; 2]> = pairs.collect();
        let divisors_m: Vec<f64> = pairs.iter().map(|&pair| divisor_m(run, pair)).collect();
        let (mut pair_minimum, mut maximum) = (vec![f64::INFINITY; pairs.len()], 0.0);
        let instant_minimum = (0..run.times_s.len()).map(|instant| {
            let alphas: Vec<Vec2> =
                (0..robots).map(|robot| run.front_point(robot, instant)).collect();
            let mut minimum = f64::INFINITY;
            for ((&[i, j], divisor_m), pair_minimum) in
                pairs.iter().zip(&divisors_m).zip(&mut pair_minimum)
            {
                let square = ((alphas[i] - alphas[j]) / *divisor_m).norm_squared();
                *pair_minimum = square.min(*pair_minimum);
                minimum = square.min(minimum);
                maximum = square.max(maximum);
            }
            minimum.sqrt()
        });
        let instant_minimum = instant_minimum.collect();
        pair_minimum.iter_mut().for_each(|square| *square = square.sqrt());
        PairDistances { pairs, pair_minimum, instant_minimum, maximum: maximum.sqrt() }
    }
}

pub(super) fn draw_pair_distances(run: &LoadedRun) -> Option<Figure> {
    let PairDistances { pairs, pair_minimum, instant_minimum, maximum } =
        PairDistances::compute(run);
    if pairs.is_empty() {
        return None;
    }
    let (is_team, d) = match run.scene.has_sizes() {
        true => (true, 1.0),
        false => (false, run.scene.distance_min_m),
    };
    let labels = match is_team {
        true => ["distance / minimum of the pair", "near the minimum"],
        false => ["distance (m)", "near d (m)"],
    };
    let negated_minima: Vec<f64> = pair_minimum.iter().map(|m| -m).collect();
    let CurveSet { count, named_curves } = CurveSet::select_largest(&negated_minima);
    let shows_envelope = count > DRAWN_PAIRS_MAX;
    let pair_distances = |pair: usize| {
        let [i, j] = pairs[pair];
        let divisor_m = divisor_m(run, [i, j]);
        let distance =
            move |k: usize| (run.front_point(i, k) - run.front_point(j, k)).norm() / divisor_m;
        (0..run.times_s.len()).map(move |k| (run.times_s[k], distance(k)))
    };
    let highest = match shows_envelope {
        false => maximum,
        true => {
            let drawn_distances =
                named_curves.iter().flat_map(|&pair| pair_distances(pair)).map(|(_, m)| m);
            drawn_distances.filter(|m| m.is_finite()).fold(d, f64::max)
        }
    };
    let mut panels = vec![(
        full_width_row(0.0, 270.0),
        panel_over_time(run, Axis::linear(labels[0], 0.0, highest)),
    )];
    // The lower panel is left out if no pair came near d.
    let has_lower_panel = pair_minimum.iter().any(|minimum| *minimum < LOWER_PANEL_RANGE.1 * d);
    if has_lower_panel {
        let lower_axis = Axis::exact(labels[1], LOWER_PANEL_RANGE.0 * d, LOWER_PANEL_RANGE.1 * d);
        panels.push((
            full_width_row(270.0, 200.0),
            panel_over_time(run, lower_axis).without_band_labels(),
        ));
    }
    let style_index =
        |pair: usize| named_curves.iter().position(|&other| other == pair).unwrap_or_default();
    let name = |pair: usize| {
        let [a, b] = pairs[pair].map(|robot| run.scene.robots[robot].name.as_str());
        format!("{a} \u{2013} {b}")
    };
    let drawn_curves = CurveSet {
        count: if shows_envelope { 0 } else { count },
        named_curves: named_curves.clone(),
    };
    for (_, panel) in &mut panels {
        drawn_curves.draw(
            panel,
            |pair| robot_line(style_index(pair)).with_width(0.8),
            |pair| pair_distances(pair).map(Some),
        );
        if shows_envelope {
            let smallest = run.times_s.iter().copied().zip(instant_minimum.iter().copied());
            panel.add_curve(smallest.map(Some), ALL_ROBOTS_LINE);
        }
        draw_minimum_distance(run, panel, d);
    }
    let legend_curves = CurveSet {
        count: if shows_envelope { named_curves.len() } else { count },
        named_curves: named_curves.clone(),
    };
    let mut legend = legend_curves.legend_entries(|pair| robot_line(style_index(pair)), name);
    legend.extend(
        shows_envelope.then(|| (ALL_ROBOTS_LINE, format!("smallest of all {count} pairs"))),
    );
    Some(Figure {
        name: "distances",
        title: "Distances of all pairs".into(),
        caption: caption(run, count, named_curves.len(), has_lower_panel),
        width: WIDTH,
        panels,
        legend,
    })
}

fn caption(
    run: &LoadedRun,
    pair_count: usize,
    named_count: usize,
    has_lower_panel: bool,
) -> String {
    let mut caption = match (pair_count > DRAWN_PAIRS_MAX, pair_count > named_count) {
        (true, _) => format!(
            "The smallest of all {pair_count} distances between front points, and the {NAMED_CURVE_COUNT} nearest pairs."
        ),
        (_, true) => format!(
            "All {pair_count} distances between front points; the {NAMED_CURVE_COUNT} nearest pairs are named."
        ),
        _ => "All distances between front points.".to_owned(),
    };
    let is_team = run.scene.has_sizes();
    if is_team {
        caption += " Each is divided by the minimum distance of its pair, the sum of two sizes.";
    }
    if has_lower_panel {
        caption += if is_team { " Below: detail near 1." } else { " Below: detail near d." };
    }
    caption += &bands_caption(run);
    let verdict = match is_team {
        true => describe_expectation(run, "min_distance_over_d", "The smallest at any tick", ""),
        false => describe_expectation(run, "min_distance_m", "The smallest at any tick", "m"),
    };
    match (&run.summary, verdict.as_str()) {
        (Some(_), "") => caption + " The scenario expects no minimum distance.",
        (_, verdict) => caption + verdict,
    }
}

/// Draws the line d, and marks the smallest distance at any tick.
fn draw_minimum_distance(run: &LoadedRun, panel: &mut Panel, d: f64) {
    let is_team = run.scene.has_sizes();
    let label = match is_team {
        true => "minimum distance".to_owned(),
        false => format!("d = {} m", format_short(d)),
    };
    panel.add_horizontal_line(d, (0.0, run.end_s()), label, BOUND_LINE);
    let Some(summary) = run.summary.as_ref().filter(|_| !is_team) else { return };
    if let (Some(distance_m), Some([a, b]), Some(t_s)) =
        (summary.min_distance_m, &summary.min_distance_pair, summary.min_distance_t_s)
    {
        let label = format!(
            "smallest {} m, {a} \u{2013} {b} at {t_s:.2} s",
            format_four_digits(distance_m)
        );
        panel.marks.push(Mark {
            position: (t_s, distance_m),
            shape: MarkShape::Ring,
            color: BLACK,
            label,
        });
    }
}
