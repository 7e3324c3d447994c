//! The figures of a campaign: rates, medians and distributions, each point of the grid for itself.

use crate::report::axis::Axis;
use crate::report::chart::{Figure, Mark, Panel, Place, Shape};
use crate::report::palette::{BLACK, Dash, Line, VERMILION, line};

use crate::campaign::points::Point;
use crate::campaign::statistics::Estimate;
use experiment::campaign::file::Campaign;

/// Of every figure.
const PLACE: Place = Place { x: 0.0, y: 0.0, width: 720.0, height: 280.0 };
/// More distributions than these are told apart by nobody.
const CURVES_MAX: usize = 12;
/// Of more points than these, the numbers are enough.
const LABELS_MAX: usize = 6;
/// Values below this are errors of rounding.
const ROUNDING: f64 = 1e-9;
/// A bound that nobody is to pass.
const BOUND: Line = Line::solid(VERMILION).dashed(Dash::Dashed);

/// All figures that there is something to see in.
pub fn figures(campaign: &Campaign, points: &[Point]) -> Vec<Figure> {
    let runs: usize = points.iter().map(|point| point.runs).sum();
    let each = each(points);
    let rated = |name, title, says: &str, estimate| {
        let bars = "Bars are Wilson intervals of 95 %";
        let caption = format!("{says} {bars}; n = {runs} runs, {each}.");
        let range = Some((0.0, 1.0));
        Quantity { name, title, caption, label: "share of runs", range, estimate }
    };
    let middle = |name, title, label, estimate| {
        let caption = format!("Medians; bars are BCa bootstrap intervals of 95 %; n = {each}.");
        Quantity { name, title, caption, label, range: None, estimate }
    };
    let held = "Share of runs whose expectations all held.";
    let held = rated("held", "Every expectation held", held, |point| point.held.rate);
    let below = "Share of runs in which some pair was nearer than d.";
    let below = rated("below_d", "Nearer than d", below, |point| point.below_d.rate);
    let distance = middle("distance", "Smallest distance", "smallest distance / d", |point| {
        point.min_distance_over_d.median
    });
    let error = middle("error", "Final error", "worst error of the last 10 % (m)", |point| {
        point.final_error_m_max.median
    });
    let over_points = |quantity: Quantity<'_>| quantity.over_points(campaign, points);
    let all = [
        over_points(held),
        over_points(below),
        convergence(points),
        distances(points),
        over_points(distance),
        over_points(error),
    ];
    all.into_iter().flatten().collect()
}

fn each(points: &[Point]) -> String {
    let least = points.iter().map(|point| point.runs).min().unwrap_or(0);
    let most = points.iter().map(|point| point.runs).max().unwrap_or(0);
    match least == most {
        true => format!("{least} at each point"),
        false => format!("{least} to {most} at each point"),
    }
}

/// The axis of numbers that runs are drawn over, if there is one; others get a curve for each of their
/// values.
fn numbers(campaign: &Campaign) -> Option<usize> {
    let long = |axis: &usize| {
        let settings = &campaign.axes[*axis].settings;
        settings.len() >= 3 && settings.iter().all(|setting| setting.number.is_some())
    };
    (0..campaign.axes.len()).filter(long).max_by_key(|axis| campaign.axes[*axis].settings.len())
}

/// What is drawn over the points of the grid.
struct Quantity<'a> {
    name: &'static str,
    title: &'a str,
    caption: String,
    label: &'a str,
    range: Option<(f64, f64)>,
    estimate: fn(&Point) -> Option<Estimate>,
}

impl Quantity<'_> {
    fn over_points(self, campaign: &Campaign, points: &[Point]) -> Option<Figure> {
        let known = points.iter().filter_map(|point| Some((point, (self.estimate)(point)?)));
        let known: Vec<(&Point, Estimate)> =
            known.filter(|(_, estimate)| estimate.value.is_finite()).collect();
        // Of a single point the table says it all.
        if known.len() < 2 {
            return None;
        }
        let number = numbers(campaign);
        let x_of = |point: &Point| match number {
            None => point.number as f64,
            Some(axis) => campaign.at(point.number - 1)[axis].number.expect("an axis of numbers"),
        };
        let x = match number {
            None => {
                Axis::numbers("combination of settings, by its number in the table", points.len())
            }
            Some(axis) => axis_of(&campaign.axes[axis].key, points.iter().map(x_of)),
        };
        let mut panel = Panel::new(x, self.axis(&known));
        let (bottom, top) = panel.y.bounds();
        // A curve for all points that differ in the axis of numbers alone: what else they have.
        let others = |point: &Point| match number {
            None => String::new(),
            Some(axis) => {
                let others = point.settings.iter().enumerate().filter(|(other, _)| *other != axis);
                let others = others.map(|(_, (key, value))| format!("{key} = {value}"));
                others.collect::<Vec<_>>().join(", ")
            }
        };
        let mut curves: Vec<(String, Vec<(f64, f64)>)> = Vec::new();
        for (point, estimate) in &known {
            let (at, curve) = ((x_of(point), estimate.value), others(point));
            let place = curves.iter().position(|(other, _)| *other == curve).unwrap_or_else(|| {
                curves.push((curve, Vec::new()));
                curves.len() - 1
            });
            curves[place].1.push(at);
            let color = if number.is_some() { line(place).color } else { BLACK };
            let (low, high) = (estimate.low.unwrap_or(at.1), estimate.high.unwrap_or(at.1));
            let bar = vec![(at.0, low.max(bottom)), (at.0, high.min(top))];
            panel.curves.push((bar, Line::solid(color).width(0.8), false));
            let named = number.is_none() && points.len() <= LABELS_MAX;
            let label = if named { values(point) } else { String::new() };
            panel.marks.push(Mark { at, shape: Shape::Ring, color, label });
        }
        let (mut caption, mut key) = (self.caption, Vec::new());
        if number.is_none() {
            caption += " Each combination of settings has its number in the table.";
            curves.clear();
        }
        for (place, (words, list)) in curves.into_iter().enumerate() {
            panel.curves.push((list, line(place), false));
            key.extend((!words.is_empty()).then_some((line(place), words)));
        }
        Some(Figure::of_one(self.name, self.title, caption, PLACE, panel, key))
    }

    /// Of the values, with the ends of their intervals.
    fn axis(&self, known: &[(&Point, Estimate)]) -> Axis {
        if let Some((low, high)) = self.range {
            return Axis::exact(self.label, low, high);
        }
        let ends = known.iter().flat_map(|(_, e)| [Some(e.value), e.low, e.high]).flatten();
        let (least, most) = bounds(ends);
        // What is as small as errors of rounding has no other scale than its power of ten.
        match least > 0.0 && (most / least > 100.0 || most < ROUNDING) {
            true => Axis::log(self.label, least, most),
            false => Axis::linear(self.label, least, most),
        }
    }
}

/// An axis of settings: logarithmic if they are far apart.
fn axis_of(key: &str, settings: impl Iterator<Item = f64>) -> Axis {
    let (low, high) = bounds(settings);
    if low > 0.0 && high / low > 20.0 {
        return Axis::log(key, low, high);
    }
    let edge = 0.04 * (high - low);
    Axis::exact(key, low - edge, high + edge)
}

fn values(point: &Point) -> String {
    point.settings.iter().map(|(_, value)| value.as_str()).collect::<Vec<_>>().join(", ")
}

fn bounds(values: impl Iterator<Item = f64>) -> (f64, f64) {
    values.fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), v| (low.min(v), high.max(v)))
}

/// How a curve of a point is told apart, with its n.
fn named(point: &Point, n: usize) -> String {
    let settings: Vec<String> =
        point.settings.iter().map(|(key, value)| format!("{key} = {value}")).collect();
    match settings.is_empty() {
        true => format!("n = {n}"),
        false => format!("{} (n = {n})", settings.join(", ")),
    }
}

/// Distributions of so many points as can be told apart, in these axes. `steps`: from which value on which
/// share of the runs has come; and of how many runs.
fn distributions<'p>(
    points: &'p [Point],
    [x, y]: [Axis; 2],
    steps: impl Fn(&'p Point) -> (Vec<(f64, f64)>, usize),
) -> (Panel, Vec<(Line, String)>, String) {
    let (mut panel, mut key) = (Panel::new(x, y), Vec::new());
    let (begin, end) = panel.x.bounds();
    for (place, point) in points.iter().take(CURVES_MAX).enumerate() {
        let (steps, n) = steps(point);
        let (mut curve, mut before) = (vec![(begin, 0.0)], 0.0);
        for (value, share) in steps {
            curve.extend([(value, before), (value, share)]);
            before = share;
        }
        curve.push((end, before));
        panel.curves.push((curve, line(place), false));
        key.push((line(place), named(point, n)));
    }
    let left_out = match points.len() > CURVES_MAX {
        true => format!(" The first {CURVES_MAX} of {} combinations of settings.", points.len()),
        false => String::new(),
    };
    (panel, key, left_out)
}

/// Share of runs converged, over time.
fn convergence(points: &[Point]) -> Option<Figure> {
    let ends = points.iter().flat_map(|point| point.convergence.iter().map(|step| step.value));
    let longest = ends.fold(0.0, f64::max);
    if longest <= 0.0 {
        return None;
    }
    let axes =
        [Axis::linear("time (s)", 0.0, longest), Axis::exact("share of runs converged", 0.0, 1.0)];
    let (panel, key, left_out) = distributions(points, axes, |point| {
        let steps = point.convergence.iter().map(|step| (step.value, step.share));
        (steps.collect(), point.runs)
    });
    let caption = format!(
        "Empirical distribution of convergence times; runs that did not converge are censored at their \
         end, and then the curve ends below 1.{left_out}"
    );
    Some(Figure::of_one("convergence", "Convergence times", caption, PLACE, panel, key))
}

/// Share of runs whose smallest distance was at most so much.
fn distances(points: &[Point]) -> Option<Figure> {
    let (least, most) = bounds(points.iter().flat_map(|point| point.distances.iter().copied()));
    if !least.is_finite() {
        return None;
    }
    let axes = [
        Axis::linear("smallest distance / d", least.min(0.95), most.max(1.05)),
        Axis::exact("share of runs with at most that", 0.0, 1.0),
    ];
    let (mut panel, key, left_out) = distributions(points, axes, |point| {
        let n = point.distances.len();
        let steps = point.distances.iter().zip(1..).map(|(&m, nth)| (m, f64::from(nth) / n as f64));
        (steps.collect(), n)
    });
    panel.upright(1.0, 1.0, "d".into(), BOUND);
    let caption = format!(
        "Empirical distribution of the smallest distance of any two front points at any tick, over d.{left_out}"
    );
    Some(Figure::of_one("distances", "Smallest distances", caption, PLACE, panel, key))
}
