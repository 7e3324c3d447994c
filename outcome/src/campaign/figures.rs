//! The figures of a campaign: rates, medians and distributions, each point of the grid for itself.

use crate::report::axis::Axis;
use crate::report::chart::{Figure, Mark, Panel, Place, Shape};
use crate::report::palette::{BLACK, Dash, Line, VERMILION, line};

use crate::campaign::points::{Median, Point, Rate};
use crate::campaign::statistics::Estimate;
use experiment::campaign::file::Campaign;

const WIDTH: f64 = 720.0;
const HEIGHT: f64 = 280.0;
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
    let rated = |name, title: &str, says: &str, of: fn(&Point) -> Rate| {
        let of = move |point: &Point| of(point).rate;
        let counts: usize = points.iter().map(|point| point.runs).sum();
        let caption = format!(
            "{says} Bars are Wilson intervals of 95 %; n = {counts} runs, {}.",
            each(points)
        );
        over_points(campaign, points, name, title, caption, Some((0.0, 1.0)), "share of runs", &of)
    };
    let middle = |name, title: &str, label: &str, of: fn(&Point) -> Median| {
        let of = move |point: &Point| of(point).median;
        let caption =
            format!("Medians; bars are BCa bootstrap intervals of 95 %; n = {}.", each(points));
        over_points(campaign, points, name, title, caption, None, label, &of)
    };
    let all = [
        rated(
            "held",
            "Every expectation held",
            "Share of runs whose expectations all held.",
            |p| p.held,
        ),
        rated(
            "below_d",
            "Nearer than d",
            "Share of runs in which some pair was nearer than d.",
            |p| p.below_d,
        ),
        convergence(points),
        distances(points),
        middle("distance", "Smallest distance", "smallest distance / d", |p| p.min_distance_over_d),
        middle("error", "Final error", "worst error of the last 10 % (m)", |p| p.final_error_m_max),
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

/// The values that its points share, and where they are.
type Curve = (Vec<String>, Vec<(f64, f64)>);

#[expect(clippy::too_many_arguments, reason = "what a figure is made of")]
fn over_points(
    campaign: &Campaign,
    points: &[Point],
    name: &'static str,
    title: &str,
    mut caption: String,
    range: Option<(f64, f64)>,
    label: &str,
    of: &dyn Fn(&Point) -> Option<Estimate>,
) -> Option<Figure> {
    let known: Vec<(&Point, Estimate)> = points
        .iter()
        .filter_map(|point| Some((point, of(point)?)))
        .filter(|(_, estimate)| estimate.value.is_finite())
        .collect();
    // Of a single point the table says it all.
    if known.len() < 2 {
        return None;
    }
    let number = numbers(campaign);
    let x_of = |point: &Point| match number {
        Some(axis) => {
            let setting = campaign.at(point.number - 1)[axis];
            setting.number.expect("an axis of numbers")
        }
        None => point.number as f64,
    };
    let xs: Vec<f64> = points.iter().map(x_of).collect();
    let (low, high) = bounds(xs.iter().copied());
    let log = number.is_some() && low > 0.0 && high / low > 20.0;
    let x = match (number, log) {
        (None, _) => {
            Axis::numbers("combination of settings, by its number in the table", points.len())
        }
        (Some(axis), true) => Axis::log(&campaign.axes[axis].key, low, high),
        (Some(axis), false) => {
            let edge = 0.04 * (high - low);
            Axis::exact(&campaign.axes[axis].key, low - edge, high + edge)
        }
    };
    let ends = known.iter().flat_map(|(_, e)| [Some(e.value), e.low, e.high]).flatten();
    let (least, most) = range.unwrap_or_else(|| bounds(ends));
    // What is as small as errors of rounding has no other scale than its power of ten.
    let spread = range.is_none() && least > 0.0 && (most / least > 100.0 || most < ROUNDING);
    let y = match (range, spread) {
        (Some((low, high)), _) => Axis::exact(label, low, high),
        (None, true) => {
            let decade = |value: f64, to: fn(f64) -> f64| 10f64.powf(to(value.log10()));
            Axis::log(label, decade(least, f64::floor), decade(most, f64::ceil))
        }
        (None, false) => Axis::linear(label, least, most),
    };
    let mut panel = Panel::new(x, y);
    // A curve for all points that differ in the axis of numbers alone.
    let others = |point: &Point| -> Vec<String> {
        let settings = point.settings.iter().enumerate();
        settings
            .filter(|(axis, _)| Some(*axis) != number)
            .map(|(_, (key, value))| format!("{key} = {value}"))
            .collect()
    };
    let mut curves: Vec<Curve> = Vec::new();
    for (point, estimate) in &known {
        let at = (x_of(point), estimate.value);
        let key = if number.is_some() { others(point) } else { Vec::new() };
        match curves.iter_mut().find(|(other, _)| *other == key) {
            Some((_, list)) => list.push(at),
            None => curves.push((key.clone(), vec![at])),
        }
        let place = curves.iter().position(|(other, _)| *other == key).expect("just made");
        let color = if number.is_some() { line(place) } else { Line::solid(BLACK) };
        let (bottom, top) = panel.y.bounds();
        let (low, high) = (estimate.low.unwrap_or(at.1), estimate.high.unwrap_or(at.1));
        let bar = vec![(at.0, low.max(bottom)), (at.0, high.min(top))];
        panel.curves.push((bar, Line { dash: Dash::Solid, ..color }.weight(2), false));
        let label = match (number, points.len() <= LABELS_MAX) {
            (None, true) => values(point),
            _ => String::new(),
        };
        panel.marks.push(Mark { at, shape: Shape::Ring, color: color.color, label });
    }
    let mut key = Vec::new();
    if number.is_some() {
        for (place, (words, list)) in curves.into_iter().enumerate() {
            panel.curves.push((list, line(place), false));
            if !words.is_empty() {
                key.push((line(place), words.join(", ")));
            }
        }
    } else {
        caption += " Each combination of settings has its number in the table.";
    }
    Some(figure(name, title, caption, panel, key))
}

fn values(point: &Point) -> String {
    point.settings.iter().map(|(_, value)| value.as_str()).collect::<Vec<_>>().join(", ")
}

fn bounds(values: impl Iterator<Item = f64>) -> (f64, f64) {
    values.fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), v| (low.min(v), high.max(v)))
}

fn figure(
    name: &'static str,
    title: &str,
    caption: String,
    panel: Panel,
    key: Vec<(Line, String)>,
) -> Figure {
    let place = Place { x: 0.0, y: 0.0, width: WIDTH, height: HEIGHT };
    let title = title.to_owned();
    Figure { name, title, caption, width: WIDTH, height: HEIGHT, panels: vec![(place, panel)], key }
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

/// Share of runs converged, over time.
fn convergence(points: &[Point]) -> Option<Figure> {
    let ends = points.iter().flat_map(|point| point.convergence.iter().map(|step| step.value));
    let longest = ends.fold(0.0, f64::max);
    if longest <= 0.0 {
        return None;
    }
    let mut panel = Panel::new(
        Axis::linear("time (s)", 0.0, longest),
        Axis::exact("share of runs converged", 0.0, 1.0),
    );
    let mut key = Vec::new();
    for (place, point) in points.iter().take(CURVES_MAX).enumerate() {
        let mut curve = vec![(0.0, 0.0)];
        for step in &point.convergence {
            curve.push((step.value, curve.last().expect("not empty").1));
            curve.push((step.value, step.share));
        }
        curve.push((panel.x.bounds().1, curve.last().expect("not empty").1));
        panel.curves.push((curve, line(place), false));
        key.push((line(place), named(point, point.runs)));
    }
    let caption = format!(
        "Empirical distribution of convergence times; runs that did not converge are censored at their \
         end, and then the curve ends below 1.{}",
        left_out(points)
    );
    Some(figure("convergence", "Convergence times", caption, panel, key))
}

/// Share of runs whose smallest distance was at most so much.
fn distances(points: &[Point]) -> Option<Figure> {
    let all = || points.iter().flat_map(|point| point.distances.iter().copied());
    let (least, most) = bounds(all());
    if !least.is_finite() {
        return None;
    }
    let mut panel = Panel::new(
        Axis::linear("smallest distance / d", least.min(0.95), most.max(1.05)),
        Axis::exact("share of runs with at most that", 0.0, 1.0),
    );
    let mut key = Vec::new();
    for (place, point) in points.iter().take(CURVES_MAX).enumerate() {
        let n = point.distances.len();
        let mut curve = vec![(panel.x.bounds().0, 0.0)];
        for (i, &distance) in point.distances.iter().enumerate() {
            curve.push((distance, i as f64 / n as f64));
            curve.push((distance, (i + 1) as f64 / n as f64));
        }
        if n > 0 {
            curve.push((panel.x.bounds().1, 1.0));
        }
        panel.curves.push((curve, line(place), false));
        key.push((line(place), named(point, n)));
    }
    panel.upright(1.0, 1.0, "d".into(), BOUND);
    let caption = format!(
        "Empirical distribution of the smallest distance of any two front points at any tick, over d.{}",
        left_out(points)
    );
    Some(figure("distances", "Smallest distances", caption, panel, key))
}

fn left_out(points: &[Point]) -> String {
    match points.len() > CURVES_MAX {
        true => format!(" The first {CURVES_MAX} of {} combinations of settings.", points.len()),
        false => String::new(),
    }
}
