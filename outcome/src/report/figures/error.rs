//! How far everybody was from where it wanted to be: the chapter's Figures 6, 10 and 14.

use super::{
    BOUND, NAMED, SEEN, WIDTH, about_bands, judged, largest, last_stretch, over_time, row,
};
use crate::metrics::summary::Summary;
use crate::report::axis::Axis;
use crate::report::chart::{Figure, Panel};
use crate::report::digits::asked;
use crate::report::palette::{BLACK, Dash, Line, VERMILION, line};
use crate::report::run::{Run, Sample};

/// Errors below this are drawn here: nobody looks at less than a micrometer, m.
const LEAST_M: f64 = 1e-6;

/// The error by those a robot hears: against where they ask it to be.
pub(super) fn by_those_heard(run: &Run) -> Option<Figure> {
    let kind = Sizes {
        name: "errors",
        title: "Position errors",
        axis: "error |e| (m)",
        said: "Errors",
        of: |sample| sample.error_m,
        judge: converging,
    };
    sizes(run, &kind)
}

/// The error to the ideal formation: against the place that the whole graph gives the robot.
pub(super) fn to_the_ideal(run: &Run) -> Option<Figure> {
    let kind = Sizes {
        name: "ideal_errors",
        title: "Errors to the ideal formation",
        axis: "distance from ideal place (m)",
        said: "Distances from the places that the whole graph, as planned, gives everybody, seen from \
               the main leader's true front point (without a leader: where most of the living fit),",
        of: |sample| sample.ideal_error_m,
        judge: staying,
    };
    sizes(run, &kind)
}

/// A figure of errors without their directions.
struct Sizes {
    name: &'static str,
    title: &'static str,
    axis: &'static str,
    /// What they are, as the caption begins.
    said: &'static str,
    of: fn(&Sample) -> Option<f64>,
    /// Draws what is asked of them; says what came of it.
    judge: fn(&Run, &mut Panel) -> String,
}

fn sizes(run: &Run, kind: &Sizes) -> Option<Figure> {
    let Sizes { name, title, axis, said, of, judge } = *kind;
    let errors = run.tracks.iter().flatten().filter_map(of);
    let highest = errors.filter(|error| error.is_finite()).reduce(f64::max)?;
    let last = last_errors(run, of);
    let reached = last.iter().copied().fold(f64::INFINITY, f64::min);
    let converged_m = run.limits.converged_error_m;
    let low = reached.clamp(LEAST_M, (converged_m / 2.0).max(LEAST_M));
    let mut panel = over_time(run, Axis::log(axis, low, highest.max(2.0 * low)));
    let floor = panel.y.bounds().0;
    let error = |robot: usize| {
        let samples = run.tracks[robot].iter().zip(&run.times_s);
        samples.map(move |(sample, &t_s)| {
            of(sample).filter(|_| sample.alive).map(|error| (t_s, error.max(floor)))
        })
    };
    let named = largest(&last);
    for robot in (0..run.tracks.len()).filter(|robot| !named.contains(robot)) {
        panel.over_x(error(robot), Line::CROWD);
    }
    let mut key = Vec::new();
    for &robot in &named {
        panel.over_x(error(robot), line(robot).weight(2));
        key.push((line(robot), run.scene.robots[robot].name.clone()));
    }
    let crowd = run.tracks.len() - named.len();
    if crowd > 0 {
        key.push((Line::CROWD.weight(2), format!("{crowd} others")));
        let worst = (0..run.times_s.len()).map(|instant| {
            let living = run.tracks.iter().map(|track| track[instant]).filter(|now| now.alive);
            let worst = living.filter_map(|sample| of(&sample)).reduce(f64::max)?;
            Some((run.times_s[instant], worst.max(floor)))
        });
        panel.over_x(worst, Line::solid(BLACK).weight(4));
        key.push((Line::solid(BLACK).weight(4), "largest of all".to_owned()));
    }

    let mut caption = match crowd {
        0 => format!("{said} of all living robots"),
        _ => format!("{said} of all living robots, the {NAMED} largest at the end by name"),
    };
    let least = if floor < 1e-6 * 1.01 { "; clipped at 1 \u{b5}m" } else { "" };
    caption += &format!(", logarithmic{least}.{}", about_bands(run));
    let label = format!("converged below {} m", asked(converged_m));
    let dotted = Line::solid(VERMILION).weight(2).dashed(Dash::Dotted);
    panel.bound(converged_m, (0.0, run.end_s()), label, dotted);
    if let Some(rule) = panel.rules.last_mut() {
        rule.label_ends = 0.75 * run.end_s();
    }
    caption += &judge(run, &mut panel);
    Some(Figure {
        name,
        title: title.into(),
        caption,
        width: WIDTH,
        height: 320.0,
        panels: vec![(row(0.0, 320.0), panel)],
        key,
    })
}

/// What is asked of the errors, and what came of it.
fn converging(run: &Run, panel: &mut Panel) -> String {
    let Some(summary) = &run.summary else { return String::new() };
    let mut said = String::new();
    if let Some(t_s) = summary.converged_at_s {
        panel.upright(t_s, 1.0, format!("converged at {t_s:.2} s"), SEEN);
    }
    if let Some(expectation) = summary.expected("converged_by_s") {
        let label = format!("required by {} s", asked(expectation.bound));
        panel.upright(expectation.bound, 0.9, label, BOUND);
        said += &judged(expectation, "All errors stay small from", "s");
    }
    if let Some(expectation) = summary.expected("final_error_m_max") {
        let label = format!("required at the end: {} m", asked(expectation.bound));
        panel.bound(expectation.bound, last_stretch(run), label, BOUND);
        said += &judged(expectation, "The worst over the last 10 % of the run", "m");
    }
    said
}

/// The same of the errors to the ideal formation.
fn staying(run: &Run, panel: &mut Panel) -> String {
    let expected = |summary: &Summary| summary.expected("final_ideal_error_m_max").cloned();
    let Some(expectation) = run.summary.as_ref().and_then(expected) else { return String::new() };
    let label = format!("required at the end: {} m", asked(expectation.bound));
    panel.bound(expectation.bound, last_stretch(run), label, BOUND);
    judged(&expectation, "The worst over the last 10 % of the run", "m")
}

pub(super) fn components(run: &Run) -> Option<Figure> {
    let known = run.tracks.iter().flatten().filter_map(|sample| sample.error_xy_m);
    let (low, high) = known
        .flatten()
        .filter(|error| error.is_finite())
        .fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), e| (low.min(e), high.max(e)));
    if low > high {
        return None;
    }
    let named = largest(&last_errors(run, |sample| sample.error_m));
    let converged_at_s = run.summary.as_ref().and_then(|summary| summary.converged_at_s);
    let mut key = Vec::new();
    let mut panels = Vec::new();
    for (axis, label) in ["error along x (m)", "error along y (m)"].into_iter().enumerate() {
        let mut panel = over_time(run, Axis::linear(label, low, high));
        if axis == 1 {
            panel.bands.iter_mut().for_each(|band| band.label.clear());
        }
        let error = |robot: usize| {
            let samples = run.tracks[robot].iter().zip(&run.times_s);
            samples.map(move |(sample, &t_s)| {
                sample.error_xy_m.filter(|_| sample.alive).map(|error| (t_s, error[axis]))
            })
        };
        for robot in (0..run.tracks.len()).filter(|robot| !named.contains(robot)) {
            panel.over_x(error(robot), Line::CROWD);
        }
        for &robot in &named {
            panel.over_x(error(robot), line(robot).weight(2));
            if axis == 0 {
                key.push((line(robot), run.scene.robots[robot].name.clone()));
            }
        }
        panels.push((row(axis as f64 * 210.0, 210.0), panel));
    }
    let crowd = run.tracks.len() - named.len();
    if crowd > 0 {
        key.push((Line::CROWD.weight(2), format!("{crowd} others")));
    }
    let mut caption = format!("Components of the errors of all living robots.{}", about_bands(run));
    if let Some(t_s) = converged_at_s {
        for (_, panel) in &mut panels {
            panel.upright(t_s, 1.0, format!("converged at {t_s:.2} s"), SEEN);
        }
    }
    if let Some(expectation) = run.summary.as_ref().and_then(|o| o.expected("converged_by_s")) {
        caption += &judged(expectation, "They converge to zero, all stay small from", "s");
    }
    Some(Figure {
        name: "error_components",
        title: "Components of the position errors".into(),
        caption,
        width: WIDTH,
        height: 420.0,
        panels,
        key,
    })
}

/// Everybody's last error, m; 0 for who never had one.
fn last_errors(run: &Run, of: fn(&Sample) -> Option<f64>) -> Vec<f64> {
    let last =
        |track: &Vec<Sample>| track.iter().rev().find_map(of).filter(|error| error.is_finite());
    run.tracks.iter().map(|track| last(track).unwrap_or(0.0)).collect()
}
