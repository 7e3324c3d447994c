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
    let (mut panels, named) = stage.draw_panels(run, "age at use", 1.2e3 * run.lost_after_s, None);
    let dotted = LineStyle::solid(VERMILION).with_width(0.8).with_dash(Dash::Dotted);
    for (bound_s, word, line, share) in
        [(run.stale_after_s, "stale", dotted, 1.0), (run.lost_after_s, "lost", BOUND_LINE, 0.9)]
    {
        let ms = bound_s * 1e3;
        let [(_, over_time), (_, shares)] = &mut panels;
        let (low, high) = over_time.x_axis.value_range();
        over_time.add_horizontal_line(
            ms,
            (low, high),
            format!("{word} after {} ms", format_short(ms)),
            line,
        );
        let (low, high) = shares.x_axis.value_range();
        if (low..=high).contains(&ms) {
            shares.add_vertical_line(ms, share, word.to_owned(), line);
        }
    }
    let caption = format!(
        "Age of a neighbor's newest beacon when it was used, by edge.{named} Data of lost neighbors \
         are not used; the age of information, which grows during silence, is in the table.{}",
        bands_caption(run)
    );
    Some(stage.assemble_figure("information_age", "Beacon age at use", caption, panels, false))
}

pub(super) fn draw_wake_latency(run: &LoadedRun) -> Option<Figure> {
    let stage = StageData::collect(run, "wake")?;
    let machine = StageData::collect(run, "machine");
    let (panels, named) = stage.draw_panels(run, "lateness", 0.0, machine.as_ref());
    let control = match &machine {
        Some(machine) if !machine.distributions.is_empty() => {
            " Dashed: a process that only waits on the robots' timer, on this machine."
        }
        _ => "",
    };
    let caption = format!(
        "Delay of each process's wake-up after its timer's deadline; missed wake-ups are included.{named}{control}{}",
        bands_caption(run)
    );
    let with_control = machine.is_some_and(|machine| !machine.intervals.is_empty());
    Some(stage.assemble_figure("wake_lateness", "Wake lateness", caption, panels, with_control))
}

/// Draws the cumulative number of late wake-ups for each cause that occurred.
pub(super) fn draw_late_by_cause(run: &LoadedRun) -> Option<Figure> {
    let mut causes = Vec::new();
    for cause in LatenessCause::ALL {
        let Some(stage) = StageData::collect(run, cause.stage().keyword()) else { continue };
        let mut so_far = 0;
        let mut points = vec![Some((0.0, 0.0))];
        let mut intervals = stage.intervals;
        intervals.sort_by(|a, b| a.t_s.total_cmp(&b.t_s));
        for interval in intervals {
            points.push(Some((interval.t_s, so_far as f64)));
            so_far += interval.count;
            points.push(Some((interval.t_s, so_far as f64)));
        }
        points.push(Some((run.end_s(), so_far as f64)));
        causes.extend((so_far > 0).then_some((cause, points, so_far)));
    }
    let most = causes.iter().map(|cause| cause.2).max()?;
    let mut panel = panel_over_time(run, Axis::linear("cumulative count", 0.0, most as f64));
    let mut key = Vec::new();
    for (place, (cause, points, total)) in causes.into_iter().enumerate() {
        panel.add_curve(points, robot_line(place));
        key.push((robot_line(place), format!("{}: {total}", cause.text())));
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
        key,
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
        let spreads = run.latency_distributions.iter().filter(|spread| spread.stage == stage);
        let (intervals, spreads) = (intervals.collect::<Vec<_>>(), spreads.collect::<Vec<_>>());
        let (mut names, mut worst) = (Vec::new(), Vec::new());
        let mut places = HashMap::new();
        let of_stretches =
            intervals.iter().map(|interval| (robot_or_edge(interval), interval.max_ns));
        let largest = |spread: &LatencyDistribution| {
            spread.exceedance.last().map_or(0, |&(value_ns, _)| value_ns)
        };
        let of_spreads =
            spreads.iter().map(|spread| (spread.robot_or_edge.clone(), largest(spread)));
        for (name, max_ns) in of_stretches.chain(of_spreads) {
            let place = *places.entry(name.clone()).or_insert_with(|| {
                names.push(name);
                worst.push(0.0_f64);
                worst.len() - 1
            });
            worst[place] = worst[place].max(ns_to_ms(max_ns));
        }
        let many = CurveSet::select_largest(&worst);
        (!names.is_empty()).then_some(StageData {
            intervals,
            distributions: spreads,
            names,
            curves: many,
        })
    }

    /// Returns the line style of a named robot or edge.
    fn line_style(&self, place: usize) -> LineStyle {
        robot_line(
            self.curves.named_curves.iter().position(|&other| other == place).unwrap_or_default(),
        )
    }

    fn largest_ms(&self) -> f64 {
        let largest = self.intervals.iter().map(|interval| interval.max_ns);
        let spread =
            self.distributions.iter().flat_map(|spread| &spread.exceedance).map(|&(ns, _)| ns);
        ns_to_ms(largest.chain(spread).max().unwrap_or(0))
    }

    /// Draws the values over time and their distribution, on axes that reach at least `high_ms`, with another stage
    /// for comparison. Returns the panels and sentences for the caption.
    fn draw_panels(
        &self,
        run: &LoadedRun,
        word: &str,
        high_ms: f64,
        control: Option<&StageData<'_>>,
    ) -> ([(Rect, Panel); 2], String) {
        let least = self.intervals.iter().map(|interval| interval.p50_ns);
        let first =
            self.distributions.iter().filter_map(|spread| Some(spread.exceedance.first()?.0));
        let low =
            ns_to_ms(least.chain(first).filter(|&ns| ns > 0).min().unwrap_or(0)).max(SHOWN_MS_MIN);
        let both = [Some(self), control].into_iter().flatten();
        let high = both.map(StageData::largest_ms).fold(low.max(high_ms), f64::max);
        let values = || Axis::log(&format!("{word} (ms)"), low, high);
        let length_s = interval_length_s(run);
        let stairs_over_time = |of: &[(f64, f64)]| interval_steps(of, length_s, run.end_s(), low);
        let largest = |intervals: &[&LatencyInterval]| -> Vec<(f64, f64)> {
            intervals.iter().map(|interval| (interval.t_s, ns_to_ms(interval.max_ns))).collect()
        };
        let mut by_name: HashMap<String, Vec<&LatencyInterval>> = HashMap::new();
        for &interval in &self.intervals {
            by_name.entry(robot_or_edge(interval)).or_default().push(interval);
        }
        let thin = |place| self.line_style(place).with_width(0.8);
        let mut left = panel_over_time(run, values());
        self.curves.draw(&mut left, thin, |place| {
            let own = by_name.get(&self.names[place]).map_or(&[][..], Vec::as_slice);
            stairs_over_time(&largest(own))
        });
        left.add_curve(stairs_over_time(&self.largest_medians_ms()), MEDIAN_LINE);
        let mut right = Panel::new(values(), self.fraction_axis());
        self.curves.draw(&mut right, thin, |place| {
            let own = self
                .distributions
                .iter()
                .filter(|spread| spread.robot_or_edge == self.names[place]);
            own.flat_map(|spread| exceedance_steps(spread, low)).map(Some).collect::<Vec<_>>()
        });
        if let Some(control) = control {
            left.add_curve(stairs_over_time(&largest(&control.intervals)), CONTROL_TIMER_LINE);
            for spread in &control.distributions {
                right.add_curve(
                    exceedance_steps(spread, low).into_iter().map(Some),
                    CONTROL_TIMER_LINE,
                );
            }
        }
        let named = match self.curves.unnamed_count() {
            0 => String::new(),
            _ => format!(" The {NAMED_CURVE_COUNT} worst are named."),
        };
        let lines = format!(
            " Left: the largest value in each {} s, by its arrival at the supervisor, with a gap where \
             there was none. Right: the complementary distribution (CCDF), the fraction of samples above \
             a value.{named}",
            format_four_digits(length_s)
        );
        let place = |x, width| Rect { x, y: 0.0, width, height: HEIGHT };
        let right_place = place(OVER_TIME_WIDTH, WIDTH - OVER_TIME_WIDTH);
        ([(place(0.0, OVER_TIME_WIDTH), left), (right_place, right)], lines)
    }

    /// Returns the figure. `with_control` says whether the control timer is drawn over time.
    fn assemble_figure(
        &self,
        name: &'static str,
        title: &str,
        caption: String,
        panels: [(Rect, Panel); 2],
        with_control: bool,
    ) -> Figure {
        let mut key = self
            .curves
            .legend_entries(|place| self.line_style(place), |place| self.names[place].clone());
        key.extend(
            (!self.intervals.is_empty()).then(|| (MEDIAN_LINE, "largest median".to_owned())),
        );
        key.extend(with_control.then(|| (CONTROL_TIMER_LINE, "control timer".to_owned())));
        let (title, panels) = (title.to_owned(), panels.into());
        Figure { name, title, caption, width: WIDTH, panels, legend: key }
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
        let shares = self
            .distributions
            .iter()
            .flat_map(|spread| &spread.exceedance)
            .map(|&(_, share)| share);
        let least = shares.filter(|&share| share > 0.0).fold(1.0, f64::min).max(SHOWN_FRACTION_MIN);
        Axis::log("fraction of samples above (CCDF)", least.min(0.1), 1.0)
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
fn exceedance_steps(spread: &LatencyDistribution, low: f64) -> Vec<(f64, f64)> {
    let mut share = 1.0;
    let mut points = Vec::new();
    for &(value_ns, above) in &spread.exceedance {
        let value = ns_to_ms(value_ns).max(low);
        points.push((value, share));
        if above > 0.0 {
            points.push((value, above));
        }
        share = above;
    }
    points
}

/// Returns the length of the intervals of latencies over time, s: the median distance of their middles, because the
/// last one may be shorter.
fn interval_length_s(run: &LoadedRun) -> f64 {
    let mut middles: Vec<f64> = run.latency_over_time.iter().map(|interval| interval.t_s).collect();
    middles.sort_by(f64::total_cmp);
    middles.dedup();
    let mut apart: Vec<f64> = middles.windows(2).map(|pair| pair[1] - pair[0]).collect();
    apart.sort_by(f64::total_cmp);
    let usual =
        apart.get(apart.len().saturating_sub(1) / 2).copied().filter(|apart| apart.is_finite());
    usual.unwrap_or(run.end_s()).max(1e-9)
}

/// Returns the points of a step function over intervals of this length, given by their middles. Values are raised
/// to `low`; an interval without a value is a gap.
fn interval_steps(
    values: &[(f64, f64)],
    length_s: f64,
    end_s: f64,
    low: f64,
) -> Vec<Option<(f64, f64)>> {
    let mut points = Vec::new();
    let mut last = None;
    for &(t_s, value) in values {
        let nth = (t_s / length_s + 1e-6).floor();
        if last.is_some_and(|last| nth > last + 1.5) {
            points.push(None);
        }
        last = Some(nth);
        let (from_s, value) = (nth * length_s, value.max(low));
        points.push(Some((from_s, value)));
        points.push(Some(((from_s + length_s).min(end_s).max(from_s), value)));
    }
    points
}
