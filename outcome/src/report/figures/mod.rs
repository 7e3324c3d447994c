//! Figures of a run, after the chapter's Figures 4-6, 8-10 and 12-14.
//!
//! | file | question it answers |
//! |---|---|
//! | `plane` | where did the robots go, and in which formation? |
//! | `distance` | how near did every pair come? |
//! | `error` | how large were the errors, and the errors to the ideal formation? |
//! | `hull` | how far outside of the leaders' convex hull were the followers? |
//! | `signals` | which values did the control laws record? |
//! | `repair` | which neighbors did robots use before and after the repair? |
//! | `latency` | how old were beacons at use, how late were wake-ups, and why? |

mod distance;
mod error;
mod hull;
mod latency;
mod plane;
mod repair;
mod signals;
#[cfg(test)]
mod tests;

use protocol::number::{format_distinct, format_short};

use crate::metrics::expect::Expectation;

use crate::report::axis::Axis;
use crate::report::chart::{Band, Figure, Panel, Rect};
use crate::report::palette::{BLACK, Dash, GRAY, LineStyle, VERMILION};
use crate::report::rows::SHOWN_ROWS_MAX;
use crate::report::run::LoadedRun;
use crate::report::simplify::CanvasPoint;

/// Width of all figures, px: that of a page of a paper.
const WIDTH: f64 = 640.0;
/// Maximum number of curves that are all named.
const ALL_NAMED_CURVES_MAX: usize = 10;
/// Number of named curves if there are more than [`ALL_NAMED_CURVES_MAX`].
const NAMED_CURVE_COUNT: usize = 6;
/// Maximum number of curves that are drawn. Of more curves the distribution is drawn, beneath the named ones.
const CURVES_MAX: usize = 200;
/// Quantiles at the edges of the tinted bands of a distribution.
const BAND_QUANTILES: [[f64; 2]; 2] = [[0.01, 0.99], [0.1, 0.9]];
/// Opacity of each tinted band. The inner band is drawn on the outer band.
const BAND_OPACITY: f64 = 0.3;
/// Maximum number of faults that are named; more are numbered.
const NAMED_FAULTS_MAX: usize = 6;
/// Maximum number of faults at the same time that have bands of their own. The bands of more would cover the curves.
const OVERLAPPING_BANDS_MAX: usize = 12;
/// Maximum number of bands that show faults in a figure with more faults than a table lists. Gaps between bands
/// are closed if they are shorter than the duration of the run divided by this number.
const BANDS_MAX: usize = 500;
/// Fraction of the run, at its end, over which final values are taken.
const FINAL_FRACTION: f64 = 0.1;

/// Line style of a bound that must not be crossed.
pub(super) const BOUND_LINE: LineStyle = LineStyle::solid(VERMILION).with_dash(Dash::Dashed);
/// Line style of an observed event.
const OBSERVED_EVENT_LINE: LineStyle = LineStyle::solid(BLACK).with_width(0.8);
/// Line style of a value of all robots together.
const ALL_ROBOTS_LINE: LineStyle = LineStyle::solid(BLACK).with_width(1.6);
/// Line style of the median of a distribution.
const MEDIAN_LINE: LineStyle = LineStyle::solid(GRAY).with_width(1.6);

/// Returns all figures for which there are data.
pub fn all_figures(run: &LoadedRun) -> Vec<Figure> {
    if run.times_s.is_empty() || run.tracks.is_empty() {
        return Vec::new();
    }
    let figures = [
        plane::draw_trajectories(run),
        distance::draw_pair_distances(run),
        error::draw_neighbor_errors(run),
        error::draw_ideal_errors(run),
        error::draw_components(run),
        hull::draw_hull_distance(run),
        signals::draw_signals(run),
        repair::draw_repair(run),
        latency::draw_information_age(run),
        latency::draw_wake_latency(run),
        latency::draw_late_by_cause(run),
    ];
    figures.into_iter().flatten().collect()
}

/// Creates a panel over run time with the faults as bands.
pub(super) fn panel_over_time(run: &LoadedRun, y: Axis) -> Panel {
    let mut panel = Panel::new(Axis::exact("time (s)", 0.0, run.end_s()), y);
    if merges_bands(run) {
        panel.bands = merged_bands(run);
        return panel;
    }
    let are_named = run.scene.faults.len() <= NAMED_FAULTS_MAX;
    let faults = run.scene.faults.iter().enumerate();
    panel.bands = faults
        .map(|(index, fault)| Band {
            start_x: fault.t_s,
            end_x: fault.until_s.unwrap_or(f64::INFINITY).min(run.end_s()),
            label: if are_named { fault.what.clone() } else { (index + 1).to_string() },
        })
        .collect();
    panel
}

/// Returns whether the faults are too many, or too many at the same time, for a band of each.
fn merges_bands(run: &LoadedRun) -> bool {
    let faults = &run.scene.faults;
    let active_count = |t_s: f64| {
        let ends_after = |until_s: Option<f64>| until_s.is_none_or(|until_s| until_s > t_s);
        faults.iter().filter(|fault| fault.t_s <= t_s && ends_after(fault.until_s)).count()
    };
    faults.len() > SHOWN_ROWS_MAX
        || faults.iter().any(|fault| active_count(fault.t_s) > OVERLAPPING_BANDS_MAX)
}

/// Returns bands without labels that cover the times at which any fault was active: at most [`BANDS_MAX`].
fn merged_bands(run: &LoadedRun) -> Vec<Band> {
    let (end_s, gap_s) = (run.end_s(), run.end_s() / BANDS_MAX as f64);
    let periods =
        run.scene.faults.iter().map(|fault| {
            (fault.t_s, fault.until_s.unwrap_or(f64::INFINITY).min(end_s).max(fault.t_s))
        });
    let mut periods: Vec<(f64, f64)> = periods.filter(|(start_s, _)| start_s.is_finite()).collect();
    periods.sort_by(|a, b| a.0.total_cmp(&b.0));
    let mut bands: Vec<Band> = Vec::new();
    for (start_s, end_s) in periods {
        match bands.last_mut() {
            Some(last_band) if start_s < last_band.end_x + gap_s => {
                last_band.end_x = last_band.end_x.max(end_s)
            }
            _ => bands.push(Band { start_x: start_s, end_x: end_s, label: String::new() }),
        }
    }
    bands
}

/// Returns a rectangle over the full width.
fn full_width_row(y: f64, height: f64) -> Rect {
    Rect { x: 0.0, y, width: WIDTH, height }
}

/// Returns start and end of the final part of a run that was not cut short, s.
fn final_interval(run: &LoadedRun) -> (f64, f64) {
    let end_s = run.duration_s();
    (end_s * (1.0 - FINAL_FRACTION), end_s)
}

/// Returns the sentence about the bands for a caption.
fn bands_caption(run: &LoadedRun) -> String {
    match run.scene.faults.len() {
        0 => String::new(),
        1..=NAMED_FAULTS_MAX => " Tinted: faults.".into(),
        count if merges_bands(run) => format!(
            " Tinted: times at which any of the {count} faults was active; they are too many to be drawn separately."
        ),
        _ => " Tinted: faults, by their numbers in the table.".into(),
    }
}

/// Returns the expectation with this name, if the summary has it.
fn find_expectation<'r>(run: &'r LoadedRun, name: &str) -> Option<&'r Expectation> {
    run.summary.as_ref()?.find_expectation(name)
}

/// Describes an expectation in one sentence: measured value, bound and verdict. Returns an empty string if there is
/// none.
fn describe_expectation(run: &LoadedRun, name: &str, subject: &str, unit: &str) -> String {
    let Some(expectation) = find_expectation(run, name) else { return String::new() };
    let unit = if unit.is_empty() { String::new() } else { format!(" {unit}") };
    let (measured_value, bound) = match expectation.value {
        Some(value) => {
            let [value, bound] = format_distinct(value, expectation.bound);
            (format!("{value}{unit}"), bound)
        }
        None => ("never".to_owned(), format_short(expectation.bound)),
    };
    let verdict = expectation.verdict().display_text();
    let reason = expectation.reason.as_ref().map_or(String::new(), |reason| format!(" ({reason})"));
    format!(" {subject}: {measured_value}, required {bound}{unit}: {verdict}{reason}.")
}

/// Draws the bound of an expectation over the final part of the run, and describes the expectation in one sentence.
fn draw_final_bound(run: &LoadedRun, panel: &mut Panel, name: &str, subject: &str) -> String {
    if let Some(expectation) = find_expectation(run, name) {
        let label = format!("required at the end: {} m", format_short(expectation.bound));
        panel.add_horizontal_line(expectation.bound, final_interval(run), label, BOUND_LINE);
    }
    describe_expectation(run, name, subject, "m")
}

/// A set of curves: all are named if they are few, else the largest ones.
struct CurveSet {
    count: usize,
    /// Indices of the named curves.
    named_curves: Vec<usize>,
}

impl CurveSet {
    /// Creates a set from the sizes of the curves.
    fn select_largest(sizes: &[f64]) -> CurveSet {
        let count = sizes.len();
        let mut named_curves: Vec<usize> = (0..count).collect();
        if count > ALL_NAMED_CURVES_MAX {
            named_curves.sort_by(|&a, &b| sizes[b].total_cmp(&sizes[a]));
            named_curves.truncate(NAMED_CURVE_COUNT);
        }
        CurveSet { count, named_curves }
    }

    fn unnamed_count(&self) -> usize {
        self.count - self.named_curves.len()
    }

    /// Returns whether the distribution of all curves is drawn instead of the unnamed ones.
    fn draws_distribution(&self) -> bool {
        self.count > CURVES_MAX
    }

    /// Draws the unnamed curves, or the distribution of all, and, on top of them, the named ones. The nth points of all
    /// curves have the same x.
    fn draw<P: IntoIterator<Item = Option<CanvasPoint>>>(
        &self,
        panel: &mut Panel,
        style: impl Fn(usize) -> LineStyle,
        points: impl Fn(usize) -> P,
    ) {
        if self.draws_distribution() {
            draw_distribution((0..self.count).map(&points), panel);
        } else {
            for index in (0..self.count).filter(|index| !self.named_curves.contains(index)) {
                panel.add_curve(points(index), LineStyle::UNNAMED_CURVE_LINE);
            }
        }
        for &index in &self.named_curves {
            panel.add_curve(points(index), style(index));
        }
    }

    /// Returns the legend entries of the curves.
    fn legend_entries(
        &self,
        style: impl Fn(usize) -> LineStyle,
        name: impl Fn(usize) -> String,
    ) -> Vec<(LineStyle, String)> {
        let named_entries = self.named_curves.iter().map(|&index| (style(index), name(index)));
        if self.draws_distribution() {
            let distribution_label =
                format!("median of all {}; tinted: 10 to 90 %, 1 to 99 %", self.count);
            return named_entries.chain([(MEDIAN_LINE, distribution_label)]).collect();
        }
        let unnamed_entry = (self.unnamed_count() > 0).then(|| {
            (
                LineStyle::UNNAMED_CURVE_LINE.with_width(0.8),
                format!("{} others", self.unnamed_count()),
            )
        });
        named_entries.chain(unnamed_entry).collect()
    }
}

/// Draws the median of curves over x, and tints the area between quantiles, at each x over the curves that have a point
/// there.
fn draw_distribution<P: IntoIterator<Item = Option<CanvasPoint>>>(
    curves: impl Iterator<Item = P>,
    panel: &mut Panel,
) {
    let mut columns: Vec<(f64, Vec<f64>)> = Vec::new();
    for curve in curves {
        for (index, point) in curve.into_iter().enumerate() {
            if columns.len() == index {
                columns.push((f64::NAN, Vec::new()));
            }
            if let Some((x, y)) = point.filter(|(_, y)| y.is_finite()) {
                columns[index].0 = x;
                columns[index].1.push(y);
            }
        }
    }
    columns.retain(|(_, values)| !values.is_empty());
    columns.iter_mut().for_each(|(_, values)| values.sort_by(f64::total_cmp));
    let quantile_points = |fraction: f64| {
        let quantile =
            move |values: &[f64]| values[(fraction * (values.len() - 1) as f64) as usize];
        columns.iter().map(move |(x, values)| (*x, quantile(values)))
    };
    for [low, high] in BAND_QUANTILES {
        let upper_edge: Vec<CanvasPoint> = quantile_points(high).collect();
        let corners = quantile_points(low).chain(upper_edge.into_iter().rev()).collect();
        panel.areas.push((corners, GRAY, BAND_OPACITY));
    }
    panel.add_curve(quantile_points(0.5).map(Some), MEDIAN_LINE);
}
