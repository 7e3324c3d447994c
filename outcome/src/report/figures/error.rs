//! Figures of the errors: the chapter's Figures 6, 10 and 14.

use super::{
    ALL, BOUND, CurveSet, NAMED, OBSERVED, WIDTH, bands_caption, describe_expectation,
    draw_final_bound, find_expectation, full_width_row, over_time,
};
use crate::report::axis::Axis;
use crate::report::chart::{Figure, Panel};
use crate::report::palette::{Dash, Line, VERMILION, line};
use crate::report::run::{Run, Sample};
use crate::report::simplify::CanvasPoint;
use protocol::number::format_short;

/// Smallest error that is drawn, m. Smaller ones are clipped.
const LEAST_M: f64 = 1e-6;
/// Subject of the sentences about final errors.
const FINAL_ERROR_SUBJECT: &str = "The worst over the last 10 % of the run";

/// Draws the errors with respect to the targets that the in-neighbors give.
pub(super) fn to_neighbors(run: &Run) -> Option<Figure> {
    let sizes = sizes(run, "Errors", "error |e| (m)", |sample| sample.error_m)?;
    let Sizes { mut panel, mut caption, key } = sizes;
    converged(run, &mut panel);
    if let Some(expectation) = find_expectation(run, "converged_by_s") {
        let label = format!("required by {} s", format_short(expectation.bound));
        panel.add_vertical_line(expectation.bound, 0.9, label, BOUND);
    }
    caption += &describe_expectation(run, "converged_by_s", "All errors stay small from", "s");
    caption += &draw_final_bound(run, &mut panel, "final_error_m_max", FINAL_ERROR_SUBJECT);
    Some(Figure::single_panel(
        "errors",
        "Position errors",
        caption,
        full_width_row(0.0, 320.0),
        panel,
        key,
    ))
}

/// Draws the errors with respect to the ideal formation.
pub(super) fn draw_ideal_errors(run: &Run) -> Option<Figure> {
    let what = "Distances from the slots that the whole planned graph gives the robots, relative to \
     the main leader's true front point (without a leader: relative to the median of the living robots),";
    let axis = "distance from ideal slot (m)";
    let sizes = sizes(run, what, axis, |sample| sample.ideal_error_m)?;
    let Sizes { mut panel, mut caption, key } = sizes;
    caption += &draw_final_bound(run, &mut panel, "final_ideal_error_m_max", FINAL_ERROR_SUBJECT);
    let title = "Errors to the ideal formation";
    Some(Figure::single_panel(
        "ideal_errors",
        title,
        caption,
        full_width_row(0.0, 320.0),
        panel,
        key,
    ))
}

/// Marks the time of convergence.
fn converged(run: &Run, panel: &mut Panel) {
    if let Some(t_s) = run.summary.as_ref().and_then(|summary| summary.converged_at_s) {
        panel.add_vertical_line(t_s, 1.0, format!("converged at {t_s:.2} s"), OBSERVED);
    }
}

/// Returns a value of a robot over time, while the robot is alive.
fn values_while_alive(
    run: &Run,
    robot: usize,
    value: impl Fn(&Sample) -> Option<f64>,
) -> impl Iterator<Item = Option<CanvasPoint>> {
    let samples = run.tracks[robot].iter().zip(&run.times_s);
    samples.map(move |(sample, &t_s)| Some((t_s, value(sample).filter(|_| sample.alive)?)))
}

/// Panel, caption and key of the magnitudes of errors.
struct Sizes {
    panel: Panel,
    caption: String,
    key: Vec<(Line, String)>,
}

/// Draws the magnitudes of errors. `what` is the beginning of the caption.
fn sizes(run: &Run, what: &str, axis: &str, error: fn(&Sample) -> Option<f64>) -> Option<Sizes> {
    let errors = run.tracks.iter().flatten().filter_map(error);
    let highest = errors.filter(|error| error.is_finite()).reduce(f64::max)?;
    let last = last_errors(run, error);
    let reached = last.iter().copied().fold(f64::INFINITY, f64::min);
    let converged_m = run.converged_error_m;
    let low = reached.clamp(LEAST_M, (converged_m / 2.0).max(LEAST_M));
    let mut panel = over_time(run, Axis::log(axis, low, highest.max(2.0 * low)));
    let floor = panel.y.value_range().0;
    let many = CurveSet::by_size(&last);
    let thin = |robot| line(robot).width(0.8);
    many.draw(&mut panel, thin, |robot| {
        values_while_alive(run, robot, move |sample| error(sample).map(|error| error.max(floor)))
    });
    let mut key = many.key(line, |robot| run.scene.robots[robot].name.clone());
    if many.other_count() > 0 {
        let worst = (0..run.times_s.len()).map(|instant| {
            let living = run.tracks.iter().map(|track| track[instant]).filter(|now| now.alive);
            let worst = living.filter_map(|sample| error(&sample)).reduce(f64::max)?;
            Some((run.times_s[instant], worst.max(floor)))
        });
        panel.add_curve(worst, ALL);
        key.push((ALL, "largest of all".to_owned()));
    }
    let named = match many.other_count() {
        0 => String::new(),
        _ => format!(", the {NAMED} largest at the end named"),
    };
    let least = if floor < 1e-6 * 1.01 { "; clipped at 1 \u{b5}m" } else { "" };
    let bands = bands_caption(run);
    let of_all = if many.draws_distribution() { "distribution over" } else { "of" };
    let caption = format!("{what} {of_all} all living robots{named}, logarithmic{least}.{bands}");
    let label = format!("converged below {} m", format_short(converged_m));
    let dotted = Line::solid(VERMILION).width(0.8).dashed(Dash::Dotted);
    panel.add_horizontal_line(converged_m, (0.0, run.end_s()), label, dotted);
    if let Some(rule) = panel.rules.last_mut() {
        rule.label_ends = 0.75 * run.end_s();
    }
    Some(Sizes { panel, caption, key })
}

pub(super) fn components(run: &Run) -> Option<Figure> {
    let known = run.tracks.iter().flatten().filter_map(|sample| sample.error_xy_m).flatten();
    let known = known.filter(|error| error.is_finite()).map(|error| (error, error));
    let (low, high) = known.reduce(|(low, high), (e, _)| (low.min(e), high.max(e)))?;
    let many = CurveSet::by_size(&last_errors(run, |sample| sample.error_m));
    let panel = |(axis, label): (usize, &str)| {
        let mut panel = over_time(run, Axis::linear(label, low, high));
        if axis > 0 {
            panel = panel.with_nameless_bands();
        }
        many.draw(
            &mut panel,
            |robot| line(robot).width(0.8),
            |robot| values_while_alive(run, robot, move |sample| Some(sample.error_xy_m?[axis])),
        );
        converged(run, &mut panel);
        (full_width_row(axis as f64 * 210.0, 210.0), panel)
    };
    let bands = bands_caption(run);
    let mut caption = format!("Components of the errors of all living robots.{bands}");
    let when = "They converge to zero, all stay small from";
    caption += &describe_expectation(run, "converged_by_s", when, "s");
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

/// Returns the last error of each robot, m; 0 for a robot that never had one.
fn last_errors(run: &Run, error: fn(&Sample) -> Option<f64>) -> Vec<f64> {
    let last =
        |track: &Vec<Sample>| track.iter().rev().find_map(error).filter(|error| error.is_finite());
    run.tracks.iter().map(|track| last(track).unwrap_or(0.0)).collect()
}
