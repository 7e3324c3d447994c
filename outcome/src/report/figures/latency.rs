//! Figures of beacon ages, wake-up latency and its causes, over time and as distributions.

use std::collections::HashMap;

use crate::metrics::summary::LatenessCause;

use super::{
    BOUND_LINE, CurveSet, NAMED_CURVE_COUNT, OBSERVED_EVENT_LINE, WIDTH, bands_caption,
    full_width_row, panel_over_time,
};
use crate::report::axis::Axis;
use crate::report::chart::{Figure, Panel, Rect};
use crate::report::digits::format_four_digits;
use crate::report::palette::{BLACK, Dash, LineStyle, VERMILION, robot_line};
use crate::report::run::{LatencyDistribution, LatencyInterval, LoadedRun};
use protocol::number::format_short;

const HEIGHT: f64 = 300.0;
/// Width of the left panel, over time, px.
const OVER_TIME_WIDTH: f64 = 390.0;

/// Smallest fraction of samples that is drawn.
const SHOWN_FRACTION_MIN: f64 = 1e-6;
/// Smallest value that is drawn, ms.
const SHOWN_MS_MIN: f64 = 1e-3;
/// Line style of the control timer.
const CONTROL_TIMER_LINE: LineStyle = LineStyle::solid(BLACK).with_dash(Dash::Dashed);
/// Line style of the largest median.
const MEDIAN_LINE: LineStyle = OBSERVED_EVENT_LINE.with_width(1.2);

pub(super) fn draw_information_age(run: &LoadedRun) -> Option<Figure> {
    let stage = StageData::collect(run, "beacon_age")?;
    let (mut panels, caption_note) =
        stage.draw_panels(run, "age at use", 1.2e3 * run.lost_after_s, None);
    let dotted = LineStyle::solid(VERMILION).with_width(0.8).with_dash(Dash::Dotted);
    for (bound_s, label, style, label_height) in
        [(run.stale_after_s, "stale", dotted, 1.0), (run.lost_after_s, "lost", BOUND_LINE, 0.9)]
    {
        let bound_ms = bound_s * 1e3;
        let [(_, over_time_panel), (_, distribution_panel)] = &mut panels;
        let (low, high) = over_time_panel.x_axis.value_range();
        over_time_panel.add_horizontal_line(
            bound_ms,
            (low, high),
            format!("{label} after {} ms", format_short(bound_ms)),
            style,
        );
        let (low, high) = distribution_panel.x_axis.value_range();
        if (low..=high).contains(&bound_ms) {
            distribution_panel.add_vertical_line(bound_ms, label_height, label.to_owned(), style);
        }
    }
    let caption = format!(
        "Age of a neighbor's newest beacon when it was used, by edge.{caption_note} Data of lost neighbors \
         are not used; the age of information, which grows during silence, is in the table.{}",
        bands_caption(run)
    );
    Some(stage.assemble_figure("information_age", "Beacon age at use", caption, panels, false))
}

pub(super) fn draw_wake_latency(run: &LoadedRun) -> Option<Figure> {
    let stage = StageData::collect(run, "wake")?;
    let control_timer = StageData::collect(run, "machine");
    let (panels, caption_note) = stage.draw_panels(run, "lateness", 0.0, control_timer.as_ref());
    let control_note = match &control_timer {
        Some(control_timer) if !control_timer.distributions.is_empty() => {
            " Dashed: a process that only waits on the robots' timer, on this machine."
        }
        _ => "",
    };
    let caption = format!(
        "Delay of each process's wake-up after its timer's deadline; missed wake-ups are included.{caption_note}{control_note}{}",
        bands_caption(run)
    );
    let shows_control =
        control_timer.is_some_and(|control_timer| !control_timer.intervals.is_empty());
    Some(stage.assemble_figure("wake_lateness", "Wake lateness", caption, panels, shows_control))
}

/// Draws the cumulative number of late wake-ups for each cause that occurred.
pub(super) fn draw_late_by_cause(run: &LoadedRun) -> Option<Figure> {
    let mut causes = Vec::new();
    for cause in LatenessCause::ALL {
        let Some(stage) = StageData::collect(run, cause.stage().keyword()) else { continue };
        let mut cumulative_count = 0;
        let mut points = vec![Some((0.0, 0.0))];
        let mut intervals = stage.intervals;
        intervals.sort_by(|a, b| a.t_s.total_cmp(&b.t_s));
        for interval in intervals {
            points.push(Some((interval.t_s, cumulative_count as f64)));
            cumulative_count += interval.count;
            points.push(Some((interval.t_s, cumulative_count as f64)));
        }
        points.push(Some((run.end_s(), cumulative_count as f64)));
        causes.extend((cumulative_count > 0).then_some((cause, points, cumulative_count)));
    }
    let count_max = causes.iter().map(|cause| cause.2).max()?;
    let mut panel = panel_over_time(run, Axis::linear("cumulative count", 0.0, count_max as f64));
    let mut legend = Vec::new();
    for (index, (cause, points, total)) in causes.into_iter().enumerate() {
        panel.add_curve(points, robot_line(index));
        legend.push((robot_line(index), format!("{}: {total}", cause.text())));
    }
    let caption = format!(
        "Cumulative number of robots' wake-ups that were more than a tenth of a period late or \
         after a missed deadline, by the cause of at least half of the lateness. Planned freezes and \
         slow robots are not counted.{}",
        bands_caption(run)
    );
    let title = "Late wake-ups by cause";
    Some(Figure::single_panel(
        "late_by_cause",
        title,
        caption,
        full_width_row(0.0, HEIGHT),
        panel,
        legend,
    ))
}

/// Measurements of one stage.
struct StageData<'r> {
    intervals: Vec<&'r LatencyInterval>,
    distributions: Vec<&'r LatencyDistribution>,
    /// Names of the robots or edges with measurements.
    names: Vec<String>,
    /// Selection of the worst ones, which are named.
    curves: CurveSet,
}

impl<'r> StageData<'r> {
    /// Collects the measurements of a stage; `None` if there are none.
    fn collect(run: &'r LoadedRun, stage: &str) -> Option<StageData<'r>> {
        let intervals = run.latency_over_time.iter().filter(|interval| interval.stage == stage);
        let distributions =
            run.latency_distributions.iter().filter(|distribution| distribution.stage == stage);
        let (intervals, distributions) =
            (intervals.collect::<Vec<_>>(), distributions.collect::<Vec<_>>());
        let (mut names, mut worst_ms) = (Vec::new(), Vec::new());
        let mut indices = HashMap::new();
        let interval_maxima =
            intervals.iter().map(|interval| (robot_or_edge(interval), interval.max_ns));
        let largest_ns = |distribution: &LatencyDistribution| {
            distribution.exceedance.last().map_or(0, |&(value_ns, _)| value_ns)
        };
        let distribution_maxima = distributions
            .iter()
            .map(|distribution| (distribution.robot_or_edge.clone(), largest_ns(distribution)));
        for (name, max_ns) in interval_maxima.chain(distribution_maxima) {
            let index = *indices.entry(name.clone()).or_insert_with(|| {
                names.push(name);
                worst_ms.push(0.0_f64);
                worst_ms.len() - 1
            });
            worst_ms[index] = worst_ms[index].max(ns_to_ms(max_ns));
        }
        let curves = CurveSet::select_largest(&worst_ms);
        (!names.is_empty()).then_some(StageData { intervals, distributions, names, curves })
    }

    /// Returns the line style of a named robot or edge.
    fn line_style(&self, index: usize) -> LineStyle {
        robot_line(
            self.curves.named_curves.iter().position(|&other| other == index).unwrap_or_default(),
        )
    }

    fn largest_ms(&self) -> f64 {
        let interval_maxima_ns = self.intervals.iter().map(|interval| interval.max_ns);
        let distribution_values_ns = self
            .distributions
            .iter()
            .flat_map(|distribution| &distribution.exceedance)
            .map(|&(ns, _)| ns);
        ns_to_ms(interval_maxima_ns.chain(distribution_values_ns).max().unwrap_or(0))
    }

    /// Draws the values over time and their distribution, on axes that reach at least `high_ms`, with another stage
    /// for comparison. Returns the panels and sentences for the caption.
    fn draw_panels(
        &self,
        run: &LoadedRun,
        quantity: &str,
        high_ms: f64,
        control: Option<&StageData<'_>>,
    ) -> ([(Rect, Panel); 2], String) {
        let medians_ns = self.intervals.iter().map(|interval| interval.p50_ns);
        let smallest_values_ns = self
            .distributions
            .iter()
            .filter_map(|distribution| Some(distribution.exceedance.first()?.0));
        let low =
            ns_to_ms(medians_ns.chain(smallest_values_ns).filter(|&ns| ns > 0).min().unwrap_or(0))
                .max(SHOWN_MS_MIN);
        let stages = [Some(self), control].into_iter().flatten();
        let high = stages.map(StageData::largest_ms).fold(low.max(high_ms), f64::max);
        let value_axis = || Axis::log(&format!("{quantity} (ms)"), low, high);
        let interval_s = interval_length_s(run);
        let steps_over_time =
            |values: &[(f64, f64)]| interval_steps(values, interval_s, run.end_s(), low);
        let maxima_ms = |intervals: &[&LatencyInterval]| -> Vec<(f64, f64)> {
            intervals.iter().map(|interval| (interval.t_s, ns_to_ms(interval.max_ns))).collect()
        };
        let mut intervals_by_name: HashMap<String, Vec<&LatencyInterval>> = HashMap::new();
        for &interval in &self.intervals {
            intervals_by_name.entry(robot_or_edge(interval)).or_default().push(interval);
        }
        let line_style = |index| self.line_style(index).with_width(0.8);
        let mut over_time_panel = panel_over_time(run, value_axis());
        self.curves.draw(&mut over_time_panel, line_style, |index| {
            let measurements =
                intervals_by_name.get(&self.names[index]).map_or(&[][..], Vec::as_slice);
            steps_over_time(&maxima_ms(measurements))
        });
        over_time_panel.add_curve(steps_over_time(&self.largest_medians_ms()), MEDIAN_LINE);
        let mut distribution_panel = Panel::new(value_axis(), self.fraction_axis());
        self.curves.draw(&mut distribution_panel, line_style, |index| {
            let measurements = self
                .distributions
                .iter()
                .filter(|distribution| distribution.robot_or_edge == self.names[index]);
            measurements
                .flat_map(|distribution| exceedance_steps(distribution, low))
                .map(Some)
                .collect::<Vec<_>>()
        });
        if let Some(control) = control {
            over_time_panel
                .add_curve(steps_over_time(&maxima_ms(&control.intervals)), CONTROL_TIMER_LINE);
            for distribution in &control.distributions {
                distribution_panel.add_curve(
                    exceedance_steps(distribution, low).into_iter().map(Some),
                    CONTROL_TIMER_LINE,
                );
            }
        }
        let named_note = match self.curves.unnamed_count() {
            0 => String::new(),
            _ => format!(" The {NAMED_CURVE_COUNT} worst are named."),
        };
        let caption_note = format!(
            " Left: the largest value in each {} s, by its arrival at the supervisor, with a gap where \
             there was none. Right: the complementary distribution (CCDF), the fraction of samples above \
             a value.{named_note}",
            format_four_digits(interval_s)
        );
        let panel_rect = |x, width| Rect { x, y: 0.0, width, height: HEIGHT };
        let distribution_rect = panel_rect(OVER_TIME_WIDTH, WIDTH - OVER_TIME_WIDTH);
        (
            [
                (panel_rect(0.0, OVER_TIME_WIDTH), over_time_panel),
                (distribution_rect, distribution_panel),
            ],
            caption_note,
        )
    }

    /// Returns the figure. `shows_control` tells whether the control timer is drawn over time.
    fn assemble_figure(
        &self,
        name: &'static str,
        title: &str,
        caption: String,
        panels: [(Rect, Panel); 2],
        shows_control: bool,
    ) -> Figure {
        let mut legend = self
            .curves
            .legend_entries(|index| self.line_style(index), |index| self.names[index].clone());
        legend.extend(
            (!self.intervals.is_empty()).then(|| (MEDIAN_LINE, "largest median".to_owned())),
        );
        legend.extend(shows_control.then(|| (CONTROL_TIMER_LINE, "control timer".to_owned())));
        let (title, panels) = (title.to_owned(), panels.into());
        Figure { name, title, caption, width: WIDTH, panels, legend }
    }

    /// Returns for each interval the largest of all medians, ms.
    fn largest_medians_ms(&self) -> Vec<(f64, f64)> {
        let medians =
            self.intervals.iter().map(|interval| (interval.t_s, ns_to_ms(interval.p50_ns)));
        let mut sorted: Vec<(f64, f64)> = medians.collect();
        sorted.sort_by(|a, b| a.0.total_cmp(&b.0).then(b.1.total_cmp(&a.1)));
        sorted.dedup_by_key(|median| median.0);
        sorted
    }

    fn fraction_axis(&self) -> Axis {
        let fractions = self
            .distributions
            .iter()
            .flat_map(|distribution| &distribution.exceedance)
            .map(|&(_, fraction)| fraction);
        let smallest_fraction = fractions
            .filter(|&fraction| fraction > 0.0)
            .fold(1.0, f64::min)
            .max(SHOWN_FRACTION_MIN);
        Axis::log("fraction of samples above (CCDF)", smallest_fraction.min(0.1), 1.0)
    }
}

/// Returns the robot's name, or the edge as `r1->r2`.
fn robot_or_edge(LatencyInterval { robot, from, .. }: &LatencyInterval) -> String {
    from.as_ref().map_or(robot.clone(), |from| format!("{from}->{robot}"))
}

fn ns_to_ms(ns: u64) -> f64 {
    ns as f64 / 1e6
}

/// Returns the points of the step function of the fraction of samples above a value, from 1 at the smallest value.
fn exceedance_steps(distribution: &LatencyDistribution, low: f64) -> Vec<(f64, f64)> {
    let mut fraction = 1.0;
    let mut points = Vec::new();
    for &(value_ns, fraction_above) in &distribution.exceedance {
        let value = ns_to_ms(value_ns).max(low);
        points.push((value, fraction));
        if fraction_above > 0.0 {
            points.push((value, fraction_above));
        }
        fraction = fraction_above;
    }
    points
}

/// Returns the length of the intervals of latencies over time, s: the median distance of their middles, because the
/// last one may be shorter.
fn interval_length_s(run: &LoadedRun) -> f64 {
    let mut middles: Vec<f64> = run.latency_over_time.iter().map(|interval| interval.t_s).collect();
    middles.sort_by(f64::total_cmp);
    middles.dedup();
    let mut distances_s: Vec<f64> = middles.windows(2).map(|pair| pair[1] - pair[0]).collect();
    distances_s.sort_by(f64::total_cmp);
    let median_s = distances_s
        .get(distances_s.len().saturating_sub(1) / 2)
        .copied()
        .filter(|median_s| median_s.is_finite());
    median_s.unwrap_or(run.end_s()).max(1e-9)
}

/// Returns the points of a step function over intervals of this length, given by their middles. Values are raised
/// to `low`; an interval without a value is a gap.
fn interval_steps(
    values: &[(f64, f64)],
    interval_s: f64,
    end_s: f64,
    low: f64,
) -> Vec<Option<(f64, f64)>> {
    let mut points = Vec::new();
    let mut last_index = None;
    for &(t_s, value) in values {
        let index = (t_s / interval_s + 1e-6).floor();
        if last_index.is_some_and(|last_index| index > last_index + 1.5) {
            points.push(None);
        }
        last_index = Some(index);
        let (start_s, value) = (index * interval_s, value.max(low));
        points.push(Some((start_s, value)));
        points.push(Some(((start_s + interval_s).min(end_s).max(start_s), value)));
    }
    points
}
