//! How old what was heard was, how late everybody woke, and why: over time, and how that is spread.

use std::collections::HashMap;

use crate::metrics::summary::Cause;

use super::{BOUND, Many, NAMED, SEEN, WIDTH, about_bands, over_time, row};
use crate::report::axis::Axis;
use crate::report::chart::{Figure, Panel, Place};
use crate::report::digits::digits;
use crate::report::palette::{BLACK, Dash, Line, VERMILION, line};
use crate::report::run::{Run, Spread, Stretch};
use protocol::number::short;

const HEIGHT: f64 = 300.0;
/// The left panel, over time, is so wide, px.
const OVER_TIME: f64 = 390.0;

/// Shares smaller than this are not drawn.
const SHARE_LEAST: f64 = 1e-6;
/// Nobody looks at less than a microsecond, ms.
const LEAST_MS: f64 = 1e-3;
/// The control group.
const CONTROL: Line = Line::solid(BLACK).dashed(Dash::Dashed);
/// The median of the worst.
const MEDIAN: Line = SEEN.width(1.2);

pub(super) fn information_age(run: &Run) -> Option<Figure> {
    let stage = Stage::of(run, "beacon_age")?;
    let (mut panels, named) = stage.panels(run, "age at use", 1.2e3 * run.lost_after_s, None);
    let dotted = Line::solid(VERMILION).width(0.8).dashed(Dash::Dotted);
    for (bound_s, word, line, share) in
        [(run.stale_after_s, "stale", dotted, 1.0), (run.lost_after_s, "lost", BOUND, 0.9)]
    {
        let ms = bound_s * 1e3;
        let [(_, over_time), (_, shares)] = &mut panels;
        let (low, high) = over_time.x.bounds();
        over_time.bound(ms, (low, high), format!("{word} after {} ms", short(ms)), line);
        let (low, high) = shares.x.bounds();
        if (low..=high).contains(&ms) {
            shares.upright(ms, share, word.to_owned(), line);
        }
    }
    let caption = format!(
        "How old a neighbor's newest beacon was when it was used, by edge.{named} Data of lost neighbors \
         are not used: the information age, which silence makes grow, is in the table.{}",
        about_bands(run)
    );
    Some(stage.figure("information_age", "Age of what was heard, at use", caption, panels, false))
}

pub(super) fn wake_lateness(run: &Run) -> Option<Figure> {
    let stage = Stage::of(run, "wake")?;
    let machine = Stage::of(run, "machine");
    let (panels, named) = stage.panels(run, "lateness", 0.0, machine.as_ref());
    let control = match &machine {
        Some(machine) if !machine.spreads.is_empty() => {
            " Dashed: a process with the robots' timer and nothing else, on this machine."
        }
        _ => "",
    };
    let caption = format!(
        "How much later than its timer's deadline each process woke; missed wake-ups count as \
         well.{named}{control}{}",
        about_bands(run)
    );
    let beside = machine.is_some_and(|machine| !machine.stretches.is_empty());
    Some(stage.figure("wake_lateness", "Wake lateness", caption, panels, beside))
}

/// How many wake-ups and answers had been late by when, for each cause that there was.
pub(super) fn late_by_cause(run: &Run) -> Option<Figure> {
    let mut causes = Vec::new();
    for cause in Cause::ALL {
        let Some(stage) = Stage::of(run, cause.stage().word()) else { continue };
        let mut so_far = 0;
        let mut points = vec![Some((0.0, 0.0))];
        let mut stretches = stage.stretches;
        stretches.sort_by(|a, b| a.t_s.total_cmp(&b.t_s));
        for stretch in stretches {
            points.push(Some((stretch.t_s, so_far as f64)));
            so_far += stretch.count;
            points.push(Some((stretch.t_s, so_far as f64)));
        }
        points.push(Some((run.end_s(), so_far as f64)));
        causes.extend((so_far > 0).then_some((cause, points, so_far)));
    }
    let most = causes.iter().map(|cause| cause.2).max()?;
    let mut panel = over_time(run, Axis::linear("cumulative count", 0.0, most as f64));
    let mut key = Vec::new();
    for (place, (cause, points, total)) in causes.into_iter().enumerate() {
        panel.over_x(points, line(place));
        key.push((line(place), format!("{}: {total}", cause.words())));
    }
    let caption = format!(
        "Cumulative count of the robots' wake-ups that came more than a tenth of a period late or \
         after a missed deadline, by what explains at least half of the lateness. Planned freezes and \
         slow robots are not counted.{}",
        about_bands(run)
    );
    Some(Figure::of_one("late_by_cause", "Late, by cause", caption, row(0.0, HEIGHT), panel, key))
}

/// What was measured of one stage.
struct Stage<'r> {
    stretches: Vec<&'r Stretch>,
    spreads: Vec<&'r Spread>,
    /// The robots or edges that have it.
    who: Vec<String>,
    /// The worst of them by name.
    many: Many,
}

impl<'r> Stage<'r> {
    /// `None` if nobody has it.
    fn of(run: &'r Run, stage: &str) -> Option<Stage<'r>> {
        let stretches = run.over_time.iter().filter(|stretch| stretch.stage == stage);
        let spreads = run.spreads.iter().filter(|spread| spread.stage == stage);
        let (stretches, spreads) = (stretches.collect::<Vec<_>>(), spreads.collect::<Vec<_>>());
        let (mut who, mut worst) = (Vec::new(), Vec::new());
        let mut places = HashMap::new();
        let of_stretches = stretches.iter().map(|stretch| (edge(stretch), stretch.max_ns));
        let largest = |spread: &Spread| spread.above.last().map_or(0, |&(value_ns, _)| value_ns);
        let of_spreads = spreads.iter().map(|spread| (spread.of.clone(), largest(spread)));
        for (name, max_ns) in of_stretches.chain(of_spreads) {
            let place = *places.entry(name.clone()).or_insert_with(|| {
                who.push(name);
                worst.push(0.0_f64);
                worst.len() - 1
            });
            worst[place] = worst[place].max(ms(max_ns));
        }
        let many = Many::by_size(&worst);
        (!who.is_empty()).then_some(Stage { stretches, spreads, who, many })
    }

    /// The line of one of those with a name.
    fn line(&self, place: usize) -> Line {
        line(self.many.named.iter().position(|&other| other == place).unwrap_or_default())
    }

    fn largest_ms(&self) -> f64 {
        let largest = self.stretches.iter().map(|stretch| stretch.max_ns);
        let spread = self.spreads.iter().flat_map(|spread| &spread.above).map(|&(ns, _)| ns);
        ms(largest.chain(spread).max().unwrap_or(0))
    }

    /// Over time and as distribution, on axes that reach to `high_ms` at least, with another stage as control
    /// group; and what is to be said of the lines.
    fn panels(
        &self,
        run: &Run,
        word: &str,
        high_ms: f64,
        control: Option<&Stage<'_>>,
    ) -> ([(Place, Panel); 2], String) {
        let least = self.stretches.iter().map(|stretch| stretch.p50_ns);
        let first = self.spreads.iter().filter_map(|spread| Some(spread.above.first()?.0));
        let low = ms(least.chain(first).filter(|&ns| ns > 0).min().unwrap_or(0)).max(LEAST_MS);
        let both = [Some(self), control].into_iter().flatten();
        let high = both.map(Stage::largest_ms).fold(low.max(high_ms), f64::max);
        let values = || Axis::log(&format!("{word} (ms)"), low, high);
        let length_s = stretch_s(run);
        let stairs_over_time = |of: &[(f64, f64)]| steps(of, length_s, run.end_s(), low);
        let largest = |stretches: &[&Stretch]| -> Vec<(f64, f64)> {
            stretches.iter().map(|stretch| (stretch.t_s, ms(stretch.max_ns))).collect()
        };
        let mut by_who: HashMap<String, Vec<&Stretch>> = HashMap::new();
        for &stretch in &self.stretches {
            by_who.entry(edge(stretch)).or_default().push(stretch);
        }
        let thin = |place| self.line(place).width(0.8);
        let mut left = over_time(run, values());
        self.many.draw(&mut left, thin, |place| {
            let own = by_who.get(&self.who[place]).map_or(&[][..], Vec::as_slice);
            stairs_over_time(&largest(own))
        });
        left.over_x(stairs_over_time(&self.medians()), MEDIAN);
        let mut right = Panel::new(values(), self.share_axis());
        self.many.draw(&mut right, thin, |place| {
            let own = self.spreads.iter().filter(|spread| spread.of == self.who[place]);
            own.flat_map(|spread| stairs(spread, low)).map(Some).collect::<Vec<_>>()
        });
        if let Some(control) = control {
            left.over_x(stairs_over_time(&largest(&control.stretches)), CONTROL);
            for spread in &control.spreads {
                right.over_x(stairs(spread, low).into_iter().map(Some), CONTROL);
            }
        }
        let named = match self.many.others() {
            0 => String::new(),
            _ => format!(" The {NAMED} that are worst by name."),
        };
        let lines = format!(
            " Left: the largest value of each {} s, by when it reached the supervisor; a gap where \
             there was none. Right: the complementary distribution (CCDF), the share of samples above \
             a value.{named}",
            digits(length_s)
        );
        let place = |x, width| Place { x, y: 0.0, width, height: HEIGHT };
        let right_place = place(OVER_TIME, WIDTH - OVER_TIME);
        ([(place(0.0, OVER_TIME), left), (right_place, right)], lines)
    }

    /// `beside`: a control group is drawn over time.
    fn figure(
        &self,
        name: &'static str,
        title: &str,
        caption: String,
        panels: [(Place, Panel); 2],
        beside: bool,
    ) -> Figure {
        let mut key = self.many.key(|place| self.line(place), |place| self.who[place].clone());
        key.extend(
            (!self.stretches.is_empty()).then(|| (MEDIAN, "median of the worst".to_owned())),
        );
        key.extend(beside.then(|| (CONTROL, "bare timer".to_owned())));
        let (title, panels) = (title.to_owned(), panels.into());
        Figure { name, title, caption, width: WIDTH, panels, key }
    }

    /// For each stretch of time, the largest of all medians, ms.
    fn medians(&self) -> Vec<(f64, f64)> {
        let medians = self.stretches.iter().map(|stretch| (stretch.t_s, ms(stretch.p50_ns)));
        let mut sorted: Vec<(f64, f64)> = medians.collect();
        sorted.sort_by(|a, b| a.0.total_cmp(&b.0).then(b.1.total_cmp(&a.1)));
        sorted.dedup_by_key(|median| median.0);
        sorted
    }

    fn share_axis(&self) -> Axis {
        let shares = self.spreads.iter().flat_map(|spread| &spread.above).map(|&(_, share)| share);
        let least = shares.filter(|&share| share > 0.0).fold(1.0, f64::min).max(SHARE_LEAST);
        Axis::log("share of samples above (CCDF)", least.min(0.1), 1.0)
    }
}

/// The robot, or the edge as `r1->r2`.
fn edge(Stretch { robot, from, .. }: &Stretch) -> String {
    from.as_ref().map_or(robot.clone(), |from| format!("{from}->{robot}"))
}

fn ms(ns: u64) -> f64 {
    ns as f64 / 1e6
}

/// The share of samples above falls in steps, from 1 at the smallest value.
fn stairs(spread: &Spread, low: f64) -> Vec<(f64, f64)> {
    let mut share = 1.0;
    let mut points = Vec::new();
    for &(value_ns, above) in &spread.above {
        let value = ms(value_ns).max(low);
        points.push((value, share));
        if above > 0.0 {
            points.push((value, above));
        }
        share = above;
    }
    points
}

/// How long the stretches are that latencies over time are summed up in, s. Those are told by their
/// middles, and the last one may be cut short.
fn stretch_s(run: &Run) -> f64 {
    let mut middles: Vec<f64> = run.over_time.iter().map(|stretch| stretch.t_s).collect();
    middles.sort_by(f64::total_cmp);
    middles.dedup();
    let mut apart: Vec<f64> = middles.windows(2).map(|pair| pair[1] - pair[0]).collect();
    apart.sort_by(f64::total_cmp);
    let usual =
        apart.get(apart.len().saturating_sub(1) / 2).copied().filter(|apart| apart.is_finite());
    usual.unwrap_or(run.end_s()).max(1e-9)
}

/// What is known of stretches of this length, by their middles: each level from one end of its stretch
/// to the other, `low` at least, and a gap where a stretch has no value.
fn steps(values: &[(f64, f64)], length_s: f64, end_s: f64, low: f64) -> Vec<Option<(f64, f64)>> {
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
