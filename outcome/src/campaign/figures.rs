//! Figures of a campaign: rates, medians and distributions at each grid point.

use crate::report::axis::Axis;
use crate::report::chart::{Figure, Mark, MarkShape, Panel, Rect};
use crate::report::palette::{BLACK, Dash, LineStyle, VERMILION, robot_line};

use crate::campaign::points::GridPoint;
use crate::campaign::statistics::Estimate;
use experiment::campaign::file::Campaign;

/// Size of every figure.
const FIGURE_SIZE: Rect = Rect { x: 0.0, y: 0.0, width: 720.0, height: 280.0 };
/// Maximum number of distribution curves in one figure; further ones are left out. More would not be
/// distinguishable.
const CURVES_MAX: usize = 12;
/// Maximum number of points with text labels; with more points the labels are omitted.
const LABELS_MAX: usize = 6;
/// Threshold below which values are rounding errors.
const ROUNDING_ERROR_MAX: f64 = 1e-9;
/// Line style of a bound that must not be crossed.
const BOUND_LINE: LineStyle = LineStyle::solid(VERMILION).with_dash(Dash::Dashed);

/// Returns all figures that the data support.
pub fn draw_figures(campaign: &Campaign, points: &[GridPoint]) -> Vec<Figure> {
    let runs: usize = points.iter().map(|point| point.runs).sum();
    let each = runs_per_point_text(points);
    let rate_quantity = |name, title, description: &str, estimate| {
        let bars = "Bars are Wilson intervals of 95 %";
        let caption = format!("{description} {bars}; n = {runs} runs, {each}.");
        let range = Some((0.0, 1.0));
        PlottedQuantity { name, title, caption, label: "fraction of runs", range, estimate }
    };
    let median_quantity = |name, title, label, estimate| {
        let caption = format!("Medians; bars are BCa bootstrap intervals of 95 %; n = {each}.");
        PlottedQuantity { name, title, caption, label, range: None, estimate }
    };
    let held = "Fraction of runs in which all expectations held.";
    let held = rate_quantity("held", "Every expectation held", held, |point| point.held.rate);
    let below = "Fraction of runs in which a pair of robots was closer than d.";
    let below = rate_quantity("below_d", "Nearer than d", below, |point| point.below_d.rate);
    let distance =
        median_quantity("distance", "Smallest distance", "smallest distance / d", |point| {
            point.min_distance_over_d.median
        });
    let error =
        median_quantity("error", "Final error", "worst error of the last 10 % (m)", |point| {
            point.final_error_m_max.median
        });
    let draw_over_points =
        |quantity: PlottedQuantity<'_>| quantity.draw_over_points(campaign, points);
    let all = [
        draw_over_points(held),
        draw_over_points(below),
        draw_convergence(points),
        draw_distances(points),
        draw_over_points(distance),
        draw_over_points(error),
    ];
    all.into_iter().flatten().collect()
}

fn runs_per_point_text(points: &[GridPoint]) -> String {
    let minimum = points.iter().map(|point| point.runs).min().unwrap_or(0);
    let maximum = points.iter().map(|point| point.runs).max().unwrap_or(0);
    match minimum == maximum {
        true => format!("{minimum} at each point"),
        false => format!("{minimum} to {maximum} at each point"),
    }
}

/// Returns the numeric axis with the most values, at least 3, if there is one. It becomes the x axis, and the
/// values of the other axes become curves.
fn longest_numeric_axis(campaign: &Campaign) -> Option<usize> {
    let long = |axis: &usize| {
        let settings = &campaign.axes[*axis].settings;
        settings.len() >= 3 && settings.iter().all(|setting| setting.numeric_value.is_some())
    };
    (0..campaign.axes.len()).filter(long).max_by_key(|axis| campaign.axes[*axis].settings.len())
}

/// Quantity that is drawn over the grid points.
struct PlottedQuantity<'a> {
    name: &'static str,
    title: &'a str,
    caption: String,
    label: &'a str,
    range: Option<(f64, f64)>,
    estimate: fn(&GridPoint) -> Option<Estimate>,
}

impl PlottedQuantity<'_> {
    fn draw_over_points(self, campaign: &Campaign, points: &[GridPoint]) -> Option<Figure> {
        let known = points.iter().filter_map(|point| Some((point, (self.estimate)(point)?)));
        let known: Vec<(&GridPoint, Estimate)> =
            known.filter(|(_, estimate)| estimate.value.is_finite()).collect();
        // A single point is shown in the table alone.
        if known.len() < 2 {
            return None;
        }
        let numeric_axis = longest_numeric_axis(campaign);
        let x_of = |point: &GridPoint| match numeric_axis {
            None => point.number as f64,
            Some(axis) => campaign.settings_at(point.number - 1)[axis]
                .numeric_value
                .expect("an axis of numbers"),
        };
        let x = match numeric_axis {
            None => Axis::for_item_numbers(
                "combination of settings, by its number in the table",
                points.len(),
            ),
            Some(axis) => settings_axis(&campaign.axes[axis].key, points.iter().map(x_of)),
        };
        let mut panel = Panel::new(x, self.fit_axis(&known));
        let (bottom, top) = panel.y_axis.value_range();
        // All points that differ only in the numeric axis share a curve, which is named by their other settings.
        let curve_name = |point: &GridPoint| match numeric_axis {
            None => String::new(),
            Some(axis) => {
                let others = point.settings.iter().enumerate().filter(|(other, _)| *other != axis);
                let others = others.map(|(_, (key, value))| format!("{key} = {value}"));
                others.collect::<Vec<_>>().join(", ")
            }
        };
        let mut curves: Vec<(String, Vec<(f64, f64)>)> = Vec::new();
        for (point, estimate) in &known {
            let (position, name) = ((x_of(point), estimate.value), curve_name(point));
            let index = curves.iter().position(|(other, _)| *other == name).unwrap_or_else(|| {
                curves.push((name, Vec::new()));
                curves.len() - 1
            });
            curves[index].1.push(position);
            let color = if numeric_axis.is_some() { robot_line(index).color } else { BLACK };
            let (low, high) =
                (estimate.low.unwrap_or(position.1), estimate.high.unwrap_or(position.1));
            let bar = vec![(position.0, low.max(bottom)), (position.0, high.min(top))];
            panel.curves.push((bar, LineStyle::solid(color).with_width(0.8), false));
            let named = numeric_axis.is_none() && points.len() <= LABELS_MAX;
            let label = if named { settings_text(point) } else { String::new() };
            panel.marks.push(Mark { position, shape: MarkShape::Ring, color, label });
        }
        let (mut caption, mut legend) = (self.caption, Vec::new());
        if numeric_axis.is_none() {
            caption += " Each combination of settings has its number in the table.";
            curves.clear();
        }
        for (index, (name, curve)) in curves.into_iter().enumerate() {
            panel.curves.push((curve, robot_line(index), false));
            legend.extend((!name.is_empty()).then_some((robot_line(index), name)));
        }
        Some(Figure::single_panel(self.name, self.title, caption, FIGURE_SIZE, panel, legend))
    }

    /// Returns the axis that fits the values and the ends of their intervals.
    fn fit_axis(&self, known: &[(&GridPoint, Estimate)]) -> Axis {
        if let Some((low, high)) = self.range {
            return Axis::exact(self.label, low, high);
        }
        let bounds = known.iter().flat_map(|(_, e)| [Some(e.value), e.low, e.high]).flatten();
        let (minimum, maximum) = value_range(bounds);
        // Values as small as rounding errors have no other scale than their power of ten.
        match minimum > 0.0 && (maximum / minimum > 100.0 || maximum < ROUNDING_ERROR_MAX) {
            true => Axis::log(self.label, minimum, maximum),
            false => Axis::linear(self.label, minimum, maximum),
        }
    }
}

/// Returns an axis for numeric settings, logarithmic if their ratio is above 20.
fn settings_axis(key: &str, settings: impl Iterator<Item = f64>) -> Axis {
    let (low, high) = value_range(settings);
    if low > 0.0 && high / low > 20.0 {
        return Axis::log(key, low, high);
    }
    let edge = 0.04 * (high - low);
    Axis::exact(key, low - edge, high + edge)
}

fn settings_text(point: &GridPoint) -> String {
    point.settings.iter().map(|(_, value)| value.as_str()).collect::<Vec<_>>().join(", ")
}

fn value_range(values: impl Iterator<Item = f64>) -> (f64, f64) {
    values.fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), v| (low.min(v), high.max(v)))
}

/// Returns the legend entry of a point: its settings and its number of runs.
fn legend_entry(point: &GridPoint, n: usize) -> String {
    let settings: Vec<String> =
        point.settings.iter().map(|(key, value)| format!("{key} = {value}")).collect();
    match settings.is_empty() {
        true => format!("n = {n}"),
        false => format!("{} (n = {n})", settings.join(", ")),
    }
}

/// Draws the cumulative distributions of at most [`CURVES_MAX`] points. `steps` returns for a point the values with
/// their cumulative fractions, and the number of runs. Returns the panel, the legend, and a sentence about curves
/// that were left out.
fn draw_distributions<'p>(
    points: &'p [GridPoint],
    [x, y]: [Axis; 2],
    steps: impl Fn(&'p GridPoint) -> (Vec<(f64, f64)>, usize),
) -> (Panel, Vec<(LineStyle, String)>, String) {
    let (mut panel, mut legend) = (Panel::new(x, y), Vec::new());
    let (begin, end) = panel.x_axis.value_range();
    for (index, point) in points.iter().take(CURVES_MAX).enumerate() {
        let (steps, n) = steps(point);
        let (mut curve, mut before) = (vec![(begin, 0.0)], 0.0);
        for (value, share) in steps {
            curve.extend([(value, before), (value, share)]);
            before = share;
        }
        curve.push((end, before));
        panel.curves.push((curve, robot_line(index), false));
        legend.push((robot_line(index), legend_entry(point, n)));
    }
    let omitted_note = match points.len() > CURVES_MAX {
        true => format!(
            " Only the first {CURVES_MAX} of {} combinations of settings are drawn.",
            points.len()
        ),
        false => String::new(),
    };
    (panel, legend, omitted_note)
}

/// Draws the fraction of converged runs over time.
fn draw_convergence(points: &[GridPoint]) -> Option<Figure> {
    let times = points.iter().flat_map(|point| point.convergence.iter().map(|step| step.value));
    let longest = times.fold(0.0, f64::max);
    if longest <= 0.0 {
        return None;
    }
    let axes = [
        Axis::linear("time (s)", 0.0, longest),
        Axis::exact("fraction of runs converged", 0.0, 1.0),
    ];
    let (panel, legend, omitted_note) = draw_distributions(points, axes, |point| {
        let steps = point.convergence.iter().map(|step| (step.value, step.share));
        (steps.collect(), point.runs)
    });
    let caption = format!(
        "Empirical distribution of convergence times. Runs that did not converge are censored at their end; the \
         curve then ends below 1.{omitted_note}"
    );
    Some(Figure::single_panel(
        "convergence",
        "Convergence times",
        caption,
        FIGURE_SIZE,
        panel,
        legend,
    ))
}

/// Draws the fraction of runs over their smallest distance.
fn draw_distances(points: &[GridPoint]) -> Option<Figure> {
    let (minimum, maximum) =
        value_range(points.iter().flat_map(|point| point.distances.iter().copied()));
    if !minimum.is_finite() {
        return None;
    }
    let axes = [
        Axis::linear("smallest distance / d", minimum.min(0.95), maximum.max(1.05)),
        Axis::exact("cumulative fraction of runs", 0.0, 1.0),
    ];
    let (mut panel, legend, omitted_note) = draw_distributions(points, axes, |point| {
        let n = point.distances.len();
        let steps = point.distances.iter().zip(1..).map(|(&m, nth)| (m, f64::from(nth) / n as f64));
        (steps.collect(), n)
    });
    panel.add_vertical_line(1.0, 1.0, "d".into(), BOUND_LINE);
    let caption = format!(
        "Empirical distribution of the smallest distance between two front points at any tick, divided by d.{omitted_note}"
    );
    Some(Figure::single_panel(
        "distances",
        "Smallest distances",
        caption,
        FIGURE_SIZE,
        panel,
        legend,
    ))
}
