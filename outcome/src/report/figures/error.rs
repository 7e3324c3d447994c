//! Figures of the errors: the chapter's Figures 6, 10 and 14.

use super::{
    ALL_ROBOTS_LINE, BOUND_LINE, CurveSet, NAMED_CURVE_COUNT, OBSERVED_EVENT_LINE, WIDTH,
    bands_caption, describe_expectation, draw_final_bound, find_expectation, full_width_row,
    panel_over_time,
};
use crate::report::axis::Axis;
use crate::report::chart::{Figure, Panel};
use crate::report::palette::{Dash, LineStyle, VERMILION, robot_line};
use crate::report::run::{LoadedRun, RobotSample};
use crate::report::simplify::CanvasPoint;
use protocol::number::format_short;

/// Smallest error that is drawn, m. Smaller ones are clipped.
const SHOWN_ERROR_M_MIN: f64 = 1e-6;
/// Subject of the sentences about final errors.
const FINAL_ERROR_SUBJECT: &str = "The worst over the last 10 % of the run";

/// Draws the errors with respect to the targets that the in-neighbors give.
pub(super) fn draw_neighbor_errors(run: &LoadedRun) -> Option<Figure> {
    let magnitudes = draw_magnitudes(run, "Errors", "error |e| (m)", |sample| sample.error_m)?;
    let ErrorMagnitudes { mut panel, mut caption, legend } = magnitudes;
    mark_convergence(run, &mut panel);
    if let Some(expectation) = find_expectation(run, "converged_by_s") {
        let label = format!("required by {} s", format_short(expectation.bound));
        panel.add_vertical_line(expectation.bound, 0.9, label, BOUND_LINE);
    }
    caption += &describe_expectation(run, "converged_by_s", "All errors stay small from", "s");
    caption += &draw_final_bound(run, &mut panel, "final_error_m_max", FINAL_ERROR_SUBJECT);
    Some(Figure::single_panel(
        "errors",
        "Position errors",
        caption,
        full_width_row(0.0, 320.0),
        panel,
        legend,
    ))
}

/// Draws the errors with respect to the ideal formation.
pub(super) fn draw_ideal_errors(run: &LoadedRun) -> Option<Figure> {
    let subject = "Distances from the slots that the whole planned graph gives the robots, relative to \
     the main leader's true front point (without a leader: relative to the median of the living robots),";
    let axis = "distance from ideal slot (m)";
    let magnitudes = draw_magnitudes(run, subject, axis, |sample| sample.ideal_error_m)?;
    let ErrorMagnitudes { mut panel, mut caption, legend } = magnitudes;
    caption += &draw_final_bound(run, &mut panel, "final_ideal_error_m_max", FINAL_ERROR_SUBJECT);
    let title = "Errors to the ideal formation";
    Some(Figure::single_panel(
        "ideal_errors",
        title,
        caption,
        full_width_row(0.0, 320.0),
        panel,
        legend,
    ))
}

/// Marks the time of convergence.
fn mark_convergence(run: &LoadedRun, panel: &mut Panel) {
    if let Some(t_s) = run.summary.as_ref().and_then(|summary| summary.converged_at_s) {
        panel.add_vertical_line(t_s, 1.0, format!("converged at {t_s:.2} s"), OBSERVED_EVENT_LINE);
    }
}

/// Returns a value of a robot over time, while the robot is alive.
fn values_while_alive(
    run: &LoadedRun,
    robot: usize,
    value: impl Fn(&RobotSample) -> Option<f64>,
) -> impl Iterator<Item = Option<CanvasPoint>> {
    let samples = run.tracks[robot].iter().zip(&run.times_s);
    samples.map(move |(sample, &t_s)| Some((t_s, value(sample).filter(|_| sample.is_alive)?)))
}

/// Panel, caption and key of the magnitudes of errors.
struct ErrorMagnitudes {
    panel: Panel,
    caption: String,
    legend: Vec<(LineStyle, String)>,
}

/// Draws the magnitudes of errors. `subject` is the beginning of the caption.
fn draw_magnitudes(
    run: &LoadedRun,
    subject: &str,
    axis: &str,
    error: fn(&RobotSample) -> Option<f64>,
) -> Option<ErrorMagnitudes> {
    let errors = run.tracks.iter().flatten().filter_map(error);
    let highest = errors.filter(|error| error.is_finite()).reduce(f64::max)?;
    let final_errors = last_errors(run, error);
    let smallest_error = final_errors.iter().copied().fold(f64::INFINITY, f64::min);
    let converged_m = run.converged_error_m;
    let low = smallest_error.clamp(SHOWN_ERROR_M_MIN, (converged_m / 2.0).max(SHOWN_ERROR_M_MIN));
    let mut panel = panel_over_time(run, Axis::log(axis, low, highest.max(2.0 * low)));
    let floor = panel.y_axis.value_range().0;
    let curves = CurveSet::select_largest(&final_errors);
    let line_style = |robot| robot_line(robot).with_width(0.8);
    curves.draw(&mut panel, line_style, |robot| {
        values_while_alive(run, robot, move |sample| error(sample).map(|error| error.max(floor)))
    });
    let mut legend =
        curves.legend_entries(robot_line, |robot| run.scene.robots[robot].name.clone());
    if curves.unnamed_count() > 0 {
        let worst = (0..run.times_s.len()).map(|instant| {
            let alive_samples =
                run.tracks.iter().map(|track| track[instant]).filter(|sample| sample.is_alive);
            let worst = alive_samples.filter_map(|sample| error(&sample)).reduce(f64::max)?;
            Some((run.times_s[instant], worst.max(floor)))
        });
        panel.add_curve(worst, ALL_ROBOTS_LINE);
        legend.push((ALL_ROBOTS_LINE, "largest of all".to_owned()));
    }
    let named_note = match curves.unnamed_count() {
        0 => String::new(),
        _ => format!(", the {NAMED_CURVE_COUNT} largest at the end named"),
    };
    let clipping_note = if floor < 1e-6 * 1.01 { "; clipped at 1 \u{b5}m" } else { "" };
    let bands = bands_caption(run);
    let extent_text = if curves.draws_distribution() { "distribution over" } else { "of" };
    let caption = format!(
        "{subject} {extent_text} all living robots{named_note}, logarithmic{clipping_note}.{bands}"
    );
    let label = format!("converged below {} m", format_short(converged_m));
    let dotted = LineStyle::solid(VERMILION).with_width(0.8).with_dash(Dash::Dotted);
    panel.add_horizontal_line(converged_m, (0.0, run.end_s()), label, dotted);
    if let Some(line) = panel.reference_lines.last_mut() {
        line.label_end_x = 0.75 * run.end_s();
    }
    Some(ErrorMagnitudes { panel, caption, legend })
}

pub(super) fn draw_components(run: &LoadedRun) -> Option<Figure> {
    let components = run.tracks.iter().flatten().filter_map(|sample| sample.error_xy_m).flatten();
    let components = components.filter(|error| error.is_finite()).map(|error| (error, error));
    let (low, high) = components.reduce(|(low, high), (e, _)| (low.min(e), high.max(e)))?;
    let curves = CurveSet::select_largest(&last_errors(run, |sample| sample.error_m));
    let panel = |(axis, label): (usize, &str)| {
        let mut panel = panel_over_time(run, Axis::linear(label, low, high));
        if axis > 0 {
            panel = panel.without_band_labels();
        }
        curves.draw(
            &mut panel,
            |robot| robot_line(robot).with_width(0.8),
            |robot| values_while_alive(run, robot, move |sample| Some(sample.error_xy_m?[axis])),
        );
        mark_convergence(run, &mut panel);
        (full_width_row(axis as f64 * 210.0, 210.0), panel)
    };
    let bands = bands_caption(run);
    let mut caption = format!("Components of the errors of all living robots.{bands}");
    let convergence_subject = "They converge to zero, all stay small from";
    caption += &describe_expectation(run, "converged_by_s", convergence_subject, "s");
    let axes = ["error along x (m)", "error along y (m)"];
    Some(Figure {
        name: "error_components",
        title: "Components of the position errors".into(),
        caption,
        width: WIDTH,
        panels: axes.into_iter().enumerate().map(panel).collect(),
        legend: curves.legend_entries(robot_line, |robot| run.scene.robots[robot].name.clone()),
    })
}

/// Returns the last error of each robot, m; 0 for a robot that never had one.
fn last_errors(run: &LoadedRun, error: fn(&RobotSample) -> Option<f64>) -> Vec<f64> {
    let last_error = |track: &Vec<RobotSample>| {
        track.iter().rev().find_map(error).filter(|error| error.is_finite())
    };
    run.tracks.iter().map(|track| last_error(track).unwrap_or(0.0)).collect()
}
