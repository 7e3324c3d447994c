//! Figure of the signals that control laws recorded.

use super::{CurveSet, NAMED_CURVE_COUNT, WIDTH, bands_caption, full_width_row, panel_over_time};
use crate::report::axis::Axis;
use crate::report::chart::Figure;
use crate::report::palette::robot_line;
use crate::report::run::{LoadedRun, SignalTrack};

/// Height of the panel of a signal, px.
const PANEL_HEIGHT: f64 = 210.0;

/// Draws each signal over time, with a curve for each robot; `None` if no law recorded any.
pub(super) fn draw_signals(run: &LoadedRun) -> Option<Figure> {
    let drawn_signals: Vec<(&SignalTrack, [f64; 2])> =
        run.signals.iter().filter_map(|signal| Some((signal, value_range(signal)?))).collect();
    let (first, _) = drawn_signals.first()?;
    let curves = CurveSet::select_largest(&last_magnitudes(first));
    let panels = drawn_signals.iter().enumerate().map(|(index, (signal, [low, high]))| {
        let mut panel = panel_over_time(run, Axis::linear(&signal.name, *low, *high));
        if index > 0 {
            panel = panel.without_band_labels();
        }
        let points = |robot: usize| signal.values[robot].iter().copied().map(Some);
        curves.draw(&mut panel, |robot| robot_line(robot).with_width(0.8), points);
        (full_width_row(index as f64 * PANEL_HEIGHT, PANEL_HEIGHT), panel)
    });
    let named_note = match curves.unnamed_count() {
        0 => String::new(),
        _ => {
            format!(
                " Named: the {NAMED_CURVE_COUNT} robots with the largest last values of `{}`.",
                first.name
            )
        }
    };
    Some(Figure {
        name: "signals",
        title: "Signals of the control laws".into(),
        caption: format!(
            "Values that the control laws recorded, in the units of the names' suffixes.{named_note}{}",
            bands_caption(run)
        ),
        width: WIDTH,
        panels: panels.collect(),
        legend: curves.legend_entries(robot_line, |robot| run.scene.robots[robot].name.clone()),
    })
}

/// Returns the smallest and the largest value of a signal; `None` without any.
fn value_range(signal: &SignalTrack) -> Option<[f64; 2]> {
    let values = signal.values.iter().flatten().map(|(_, value)| [*value; 2]);
    values.reduce(|[low, high], [value, _]| [low.min(value), high.max(value)])
}

/// Returns the magnitude of the last value of each robot; 0 for a robot without any.
fn last_magnitudes(signal: &SignalTrack) -> Vec<f64> {
    let last_magnitude =
        |values: &Vec<(f64, f64)>| values.last().map_or(0.0, |(_, value)| value.abs());
    signal.values.iter().map(last_magnitude).collect()
}
