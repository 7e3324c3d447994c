//! How far everybody was from where it wanted to be: the chapter's Figures 6, 10 and 14.

use super::{
    ALL, BOUND, Many, NAMED, SEEN, WIDTH, about_bands, expected, judged, over_time,
    required_at_the_end, row,
};
use crate::report::axis::Axis;
use crate::report::chart::{Figure, Panel};
use crate::report::palette::{Dash, Line, VERMILION, line};
use crate::report::run::{Run, Sample};
use crate::report::simplify::Point;
use protocol::number::short;

/// Errors below this are drawn here: nobody looks at less than a micrometer, m.
const LEAST_M: f64 = 1e-6;
/// Of the expectations about the end.
const WORST: &str = "The worst over the last 10 % of the run";

/// The error by those a robot hears: against where they ask it to be.
pub(super) fn by_those_heard(run: &Run) -> Option<Figure> {
    let sizes = sizes(run, "Errors", "error |e| (m)", |sample| sample.error_m)?;
    let Sizes { mut panel, mut caption, key } = sizes;
    converged(run, &mut panel);
    if let Some(expectation) = expected(run, "converged_by_s") {
        let label = format!("required by {} s", short(expectation.bound));
        panel.upright(expectation.bound, 0.9, label, BOUND);
    }
    caption += &judged(run, "converged_by_s", "All errors stay small from", "s");
    caption += &required_at_the_end(run, &mut panel, "final_error_m_max", WORST);
    Some(Figure::of_one("errors", "Position errors", caption, row(0.0, 320.0), panel, key))
}

/// The error to the ideal formation: against the place that the whole graph gives the robot.
pub(super) fn to_the_ideal(run: &Run) -> Option<Figure> {
    let what = "Distances from the places that the whole graph, as planned, gives everybody, seen from \
                the main leader's true front point (without a leader: where most of the living fit),";
    let axis = "distance from ideal place (m)";
    let sizes = sizes(run, what, axis, |sample| sample.ideal_error_m)?;
    let Sizes { mut panel, mut caption, key } = sizes;
    caption += &required_at_the_end(run, &mut panel, "final_ideal_error_m_max", WORST);
    let title = "Errors to the ideal formation";
    Some(Figure::of_one("ideal_errors", title, caption, row(0.0, 320.0), panel, key))
}

/// When everybody had converged.
fn converged(run: &Run, panel: &mut Panel) {
    if let Some(t_s) = run.summary.as_ref().and_then(|summary| summary.converged_at_s) {
        panel.upright(t_s, 1.0, format!("converged at {t_s:.2} s"), SEEN);
    }
}

/// What a robot's samples say over time, while it lives.
fn living(
    run: &Run,
    robot: usize,
    value: impl Fn(&Sample) -> Option<f64>,
) -> impl Iterator<Item = Option<Point>> {
    let samples = run.tracks[robot].iter().zip(&run.times_s);
    samples.map(move |(sample, &t_s)| Some((t_s, value(sample).filter(|_| sample.alive)?)))
}

/// Errors without their directions.
struct Sizes {
    panel: Panel,
    caption: String,
    key: Vec<(Line, String)>,
}

/// `what` they are, as the caption begins.
fn sizes(run: &Run, what: &str, axis: &str, error: fn(&Sample) -> Option<f64>) -> Option<Sizes> {
    let errors = run.tracks.iter().flatten().filter_map(error);
    let highest = errors.filter(|error| error.is_finite()).reduce(f64::max)?;
    let last = last_errors(run, error);
    let reached = last.iter().copied().fold(f64::INFINITY, f64::min);
    let converged_m = run.converged_error_m;
    let low = reached.clamp(LEAST_M, (converged_m / 2.0).max(LEAST_M));
    let mut panel = over_time(run, Axis::log(axis, low, highest.max(2.0 * low)));
    let floor = panel.y.bounds().0;
    let many = Many::by_size(&last);
    let thin = |robot| line(robot).width(0.8);
    many.draw(&mut panel, thin, |robot| {
        living(run, robot, move |sample| error(sample).map(|error| error.max(floor)))
    });
    let mut key = many.key(line, |robot| run.scene.robots[robot].name.clone());
    if many.others() > 0 {
        let worst = (0..run.times_s.len()).map(|instant| {
            let living = run.tracks.iter().map(|track| track[instant]).filter(|now| now.alive);
            let worst = living.filter_map(|sample| error(&sample)).reduce(f64::max)?;
            Some((run.times_s[instant], worst.max(floor)))
        });
        panel.over_x(worst, ALL);
        key.push((ALL, "largest of all".to_owned()));
    }
    let named = match many.others() {
        0 => String::new(),
        _ => format!(", the {NAMED} largest at the end by name"),
    };
    let least = if floor < 1e-6 * 1.01 { "; clipped at 1 \u{b5}m" } else { "" };
    let bands = about_bands(run);
    let caption = format!("{what} of all living robots{named}, logarithmic{least}.{bands}");
    let label = format!("converged below {} m", short(converged_m));
    let dotted = Line::solid(VERMILION).width(0.8).dashed(Dash::Dotted);
    panel.bound(converged_m, (0.0, run.end_s()), label, dotted);
    if let Some(rule) = panel.rules.last_mut() {
        rule.label_ends = 0.75 * run.end_s();
    }
    Some(Sizes { panel, caption, key })
}

pub(super) fn components(run: &Run) -> Option<Figure> {
    let known = run.tracks.iter().flatten().filter_map(|sample| sample.error_xy_m).flatten();
    let known = known.filter(|error| error.is_finite()).map(|error| (error, error));
    let (low, high) = known.reduce(|(low, high), (e, _)| (low.min(e), high.max(e)))?;
    let many = Many::by_size(&last_errors(run, |sample| sample.error_m));
    let panel = |(axis, label): (usize, &str)| {
        let mut panel = over_time(run, Axis::linear(label, low, high));
        if axis > 0 {
            panel = panel.with_nameless_bands();
        }
        many.draw(
            &mut panel,
            |robot| line(robot).width(0.8),
            |robot| living(run, robot, move |sample| Some(sample.error_xy_m?[axis])),
        );
        converged(run, &mut panel);
        (row(axis as f64 * 210.0, 210.0), panel)
    };
    let bands = about_bands(run);
    let mut caption = format!("Components of the errors of all living robots.{bands}");
    let when = "They converge to zero, all stay small from";
    caption += &judged(run, "converged_by_s", when, "s");
    let axes = ["error along x (m)", "error along y (m)"];
    Some(Figure {
        name: "error_components",
        title: "Components of the position errors".into(),
        caption,
        width: WIDTH,
        panels: axes.into_iter().enumerate().map(panel).collect(),
        key: many.key(line, |robot| run.scene.robots[robot].name.clone()),
    })
}

/// Everybody's last error, m; 0 for who never had one.
fn last_errors(run: &Run, error: fn(&Sample) -> Option<f64>) -> Vec<f64> {
    let last =
        |track: &Vec<Sample>| track.iter().rev().find_map(error).filter(|error| error.is_finite());
    run.tracks.iter().map(|track| last(track).unwrap_or(0.0)).collect()
}
