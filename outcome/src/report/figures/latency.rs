//! How old what was heard was, how late everybody woke, and why: over time, and how that is spread.

use crate::metrics::summary::Cause;

use super::{BOUND, NAMED, SEEN, WIDTH, about_bands, largest, over_time, row};
use crate::report::axis::Axis;
use crate::report::chart::{Figure, Panel, Place};
use crate::report::digits::{asked, digits};
use crate::report::palette::{BLACK, Dash, Line, VERMILION, line};
use crate::report::run::{Bin, Run, Spread};

const HEIGHT: f64 = 300.0;
/// The left panel, over time, is so wide, px.
const OVER_TIME: f64 = 390.0;

/// Shares smaller than this are not drawn.
const SHARE_LEAST: f64 = 1e-6;
/// The control group.
const CONTROL: Line = Line::solid(BLACK).dashed(Dash::Dashed);

pub(super) fn information_age(run: &Run) -> Option<Figure> {
    let mut figure = of_stage(
        run,
        "beacon_age",
        "information_age",
        "age at use",
        Some(run.limits.lost_after_s),
        None,
    )?;
    let limits = run.limits;
    for (place, (_, panel)) in figure.panels.iter_mut().enumerate() {
        for (bound_s, word) in [(limits.stale_after_s, "stale"), (limits.lost_after_s, "lost")] {
            let ms = bound_s * 1e3;
            let label = format!("{word} after {} ms", asked(ms));
            let line = match word {
                "stale" => Line::solid(VERMILION).weight(2).dashed(Dash::Dotted),
                _ => BOUND,
            };
            let (low, high) = panel.x.bounds();
            if place == 0 {
                panel.bound(ms, (low, high), label, line);
            } else if (low..=high).contains(&ms) {
                let share = if word == "stale" { 1.0 } else { 0.9 };
                panel.upright(ms, share, word.to_owned(), line);
            }
        }
    }
    figure.title = "Age of what was heard, at use".into();
    figure.caption = format!(
        "How old a neighbor's newest beacon was when it was used, by edge.{} Who is lost is not \
         used any more: the information age, which silence makes grow, is in the table.{}",
        figure.caption,
        about_bands(run)
    );
    Some(figure)
}

pub(super) fn wake_lateness(run: &Run) -> Option<Figure> {
    let mut figure = of_stage(run, "wake", "wake_lateness", "lateness", None, Some("machine"))?;
    figure.title = "Wake lateness".into();
    let control = match run.spreads.iter().any(|spread| spread.stage == "machine") {
        true => " Dashed: a process with the robots' timer and nothing else, on this machine.",
        false => "",
    };
    figure.caption = format!(
        "How much later than its timer's deadline each process woke; missed wake-ups count as \
         well.{}{control}{}",
        figure.caption,
        about_bands(run)
    );
    Some(figure)
}

/// How many wake-ups and answers had been late by when, for each cause that there was.
pub(super) fn late_by_cause(run: &Run) -> Option<Figure> {
    let mut causes = Vec::new();
    for cause in Cause::ALL {
        let mut bins: Vec<(f64, u64)> = (run.over_time.iter())
            .filter(|bin| bin.stage == cause.stage().word())
            .map(|bin| (bin.t_s, bin.count))
            .collect();
        bins.sort_by(|a, b| a.0.total_cmp(&b.0));
        let total: u64 = bins.iter().map(|bin| bin.1).sum();
        if total > 0 {
            causes.push((cause, bins, total));
        }
    }
    let most = causes.iter().map(|cause| cause.2).max()?;
    let mut panel = over_time(run, Axis::linear("cumulative count", 0.0, most as f64));
    let mut key = Vec::new();
    for (place, (cause, bins, total)) in causes.iter().enumerate() {
        let mut so_far = 0;
        let mut points = vec![Some((0.0, 0.0))];
        for &(t_s, count) in bins {
            points.push(Some((t_s, so_far as f64)));
            so_far += count;
            points.push(Some((t_s, so_far as f64)));
        }
        points.push(Some((run.end_s(), so_far as f64)));
        panel.over_x(points, line(place));
        key.push((line(place), format!("{}: {total}", cause.words())));
    }
    Some(Figure {
        name: "late_by_cause",
        title: "Late, by cause".into(),
        caption: format!(
            "Cumulative count of the robots' wake-ups that came more than a tenth of a period late or \
             after a missed deadline, by what explains at least half of the lateness. Planned freezes and \
             slow robots are not counted.{}",
            about_bands(run)
        ),
        width: WIDTH,
        height: HEIGHT,
        panels: vec![(row(0.0, HEIGHT), panel)],
        key,
    })
}

/// A stage over time and as distribution, on an axis with `bound_s` on it, and beside it the stage
/// `control`; the caption says what the lines are.
fn of_stage(
    run: &Run,
    stage: &str,
    name: &'static str,
    word: &str,
    bound_s: Option<f64>,
    control: Option<&str>,
) -> Option<Figure> {
    let bins: Vec<&Bin> = run.over_time.iter().filter(|bin| bin.stage == stage).collect();
    let spreads: Vec<&Spread> = run.spreads.iter().filter(|spread| spread.stage == stage).collect();
    let mut who: Vec<String> = bins.iter().map(|bin| of_bin(bin)).collect();
    who.extend(spreads.iter().map(|spread| spread.of.clone()));
    let mut seen = std::collections::HashSet::new();
    who.retain(|name| seen.insert(name.clone()));
    if who.is_empty() {
        return None;
    }
    let place_of: std::collections::HashMap<&str, usize> =
        who.iter().enumerate().map(|(place, name)| (name.as_str(), place)).collect();
    let mut by_who: Vec<Vec<&Bin>> = vec![Vec::new(); who.len()];
    for bin in &bins {
        by_who[place_of[of_bin(bin).as_str()]].push(bin);
    }
    let mut worst = vec![0.0f64; who.len()];
    for (worst, bins) in worst.iter_mut().zip(&by_who) {
        *worst = bins.iter().map(|bin| bin.max_ns as f64).fold(0.0, f64::max);
    }
    for spread in &spreads {
        let place = place_of[spread.of.as_str()];
        let largest = spread.above.last().map_or(0, |&(value_ns, _)| value_ns);
        worst[place] = worst[place].max(largest as f64);
    }
    let named = largest(&worst);
    let style = |place: usize| named.iter().position(|&other| other == place).map(line);

    let least = bins.iter().map(|bin| bin.p50_ns);
    let least = least.chain(spreads.iter().filter_map(|spread| Some(spread.above.first()?.0)));
    // Nobody looks at less than a microsecond.
    let low = ms(least.filter(|&ns| ns > 0).min().unwrap_or(1).max(1000));
    let is_control = |stage: &str| control == Some(stage);
    let beside: Vec<&Bin> = run.over_time.iter().filter(|bin| is_control(&bin.stage)).collect();
    worst.extend(beside.iter().map(|bin| bin.max_ns as f64));
    let high = (worst.iter().copied().fold(0.0, f64::max) / 1e6).max(low);
    // A bound is seen with some room above it.
    let high = high.max(bound_s.map_or(low, |bound_s| 1.2e3 * bound_s));
    let values = |label: &str| Axis::log(label, low, high);
    let length_s = stretch_s(run);
    let mut left = over_time(run, values(&format!("{word} (ms)")));
    let mut right = Panel::new(values(&format!("{word} (ms)")), share_axis(&spreads));
    let order = (0..who.len()).filter(|place| style(*place).is_none()).chain(named.iter().copied());
    for place in order {
        let line = style(place).unwrap_or(Line::CROWD);
        let values = by_who[place].iter().map(|bin| (bin.t_s, ms(bin.max_ns).max(low)));
        left.over_x(steps(values, length_s, run.end_s()), line.weight(line.weight.min(2)));
        for spread in spreads.iter().filter(|spread| spread.of == who[place]) {
            right.curves.push((stairs(spread, low), line.weight(line.weight.min(2)), true));
        }
    }
    left.over_x(steps(medians(&bins, low), length_s, run.end_s()), SEEN.weight(3));
    let values = beside.iter().map(|bin| (bin.t_s, ms(bin.max_ns).max(low)));
    left.over_x(steps(values, length_s, run.end_s()), CONTROL);
    for spread in run.spreads.iter().filter(|spread| is_control(&spread.stage)) {
        right.curves.push((stairs(spread, low), CONTROL, true));
    }
    let mut key: Vec<(Line, String)> =
        named.iter().map(|&place| (style(place).unwrap_or(SEEN), who[place].clone())).collect();
    if who.len() > named.len() {
        key.push((Line::CROWD.weight(2), format!("{} others", who.len() - named.len())));
    }
    if !bins.is_empty() {
        key.push((SEEN.weight(3), "median of the worst".to_owned()));
    }
    if !beside.is_empty() {
        key.push((CONTROL, "bare timer".to_owned()));
    }
    let told = if who.len() > named.len() {
        format!(" The {NAMED} that are worst by name.")
    } else {
        String::new()
    };
    let right_place = Place { x: OVER_TIME, y: 0.0, width: WIDTH - OVER_TIME, height: HEIGHT };
    let left_place = Place { x: 0.0, y: 0.0, width: OVER_TIME, height: HEIGHT };
    Some(Figure {
        name,
        title: String::new(),
        caption: format!(
            " Left: the largest value of each {} s, by when it reached the supervisor; a gap where \
             there was none. Right: the complementary distribution (CCDF), the share of samples above \
             a value.{told}",
            digits(length_s)
        ),
        width: WIDTH,
        height: HEIGHT,
        panels: vec![(left_place, left), (right_place, right)],
        key,
    })
}

fn of_bin(bin: &Bin) -> String {
    bin.from.as_ref().map_or(bin.robot.clone(), |from| format!("{from}->{}", bin.robot))
}

fn ms(ns: u64) -> f64 {
    ns as f64 / 1e6
}

fn share_axis(spreads: &[&Spread]) -> Axis {
    let shares = spreads.iter().flat_map(|spread| &spread.above).map(|&(_, share)| share);
    let least = shares.filter(|&share| share > 0.0).fold(1.0, f64::min).max(SHARE_LEAST);
    Axis::log("share of samples above (CCDF)", least.min(0.1), 1.0)
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
    let mut middles: Vec<f64> = run.over_time.iter().map(|bin| bin.t_s).collect();
    middles.sort_by(f64::total_cmp);
    middles.dedup();
    let mut apart: Vec<f64> = middles.windows(2).map(|pair| pair[1] - pair[0]).collect();
    apart.sort_by(f64::total_cmp);
    let usual =
        apart.get(apart.len().saturating_sub(1) / 2).copied().filter(|apart| apart.is_finite());
    usual.unwrap_or(run.end_s()).max(1e-9)
}

/// What is known of stretches of this length, by their middles: each level from one end of its stretch
/// to the other, and a gap where a stretch has no value.
fn steps(
    values: impl IntoIterator<Item = (f64, f64)>,
    length_s: f64,
    end_s: f64,
) -> Vec<Option<(f64, f64)>> {
    let mut points = Vec::new();
    let mut last = None;
    for (t_s, value) in values {
        let nth = (t_s / length_s + 1e-6).floor();
        if last.is_some_and(|last| nth > last + 1.5) {
            points.push(None);
        }
        last = Some(nth);
        let from_s = nth * length_s;
        points.push(Some((from_s, value)));
        points.push(Some(((from_s + length_s).min(end_s).max(from_s), value)));
    }
    points
}

/// For each stretch of time, the largest of all medians.
fn medians(bins: &[&Bin], low: f64) -> Vec<(f64, f64)> {
    let mut sorted: Vec<(f64, u64)> = bins.iter().map(|bin| (bin.t_s, bin.p50_ns)).collect();
    sorted.sort_by(|a, b| a.0.total_cmp(&b.0));
    let stretches = sorted.chunk_by(|a, b| a.0 == b.0);
    let largest = stretches.map(|group| (group[0].0, group.iter().map(|bin| bin.1).max()));
    largest.map(|(t_s, ns)| (t_s, ms(ns.unwrap_or(0)).max(low))).collect()
}
