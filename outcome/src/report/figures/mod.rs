//! The figures of a run, after the chapter's Figures 4-6, 8-10 and 12-14.
//!
//! | file | question it answers |
//! |---|---|
//! | `plane` | where did everybody go, and in which formation? |
//! | `distance` | how near did every pair come? |
//! | `error` | how far was everybody from where it wanted to be, and from its place in the whole? |
//! | `hull` | how far outside the leaders' hull were the contained? |
//! | `repair` | who went by whom before and after robots were lost? |
//! | `latency` | how old was what was heard, how late did everybody wake, and why? |

mod distance;
mod error;
mod hull;
mod latency;
mod plane;
mod repair;
#[cfg(test)]
mod tests;

use protocol::number::{short, told_apart};

use crate::metrics::expect::Expectation;

use crate::report::axis::Axis;
use crate::report::chart::{Band, Figure, Panel, Place};
use crate::report::palette::{BLACK, Dash, Line, VERMILION};
use crate::report::rows::ROWS_SHOWN;
use crate::report::run::Run;
use crate::report::simplify::Point;

/// Of all figures: as wide as a page of a paper, px.
const WIDTH: f64 = 640.0;
/// Of more curves than this, only some are named.
const NAMED_ALL: usize = 10;
/// How many are named then.
const NAMED: usize = 6;
/// More faults than this are numbered instead of named.
const FAULTS_NAMED: usize = 6;
/// Maximum number of bands that are drawn for more faults than a table lists: shorter gaps than this share of the run
/// are closed.
const BANDS_MAX: usize = 500;
/// The last share of a run, over which final values are taken.
const FINAL_SHARE: f64 = 0.1;

/// Shall not be passed.
pub(super) const BOUND: Line = Line::solid(VERMILION).dashed(Dash::Dashed);
/// Was seen.
const SEEN: Line = Line::solid(BLACK).width(0.8);
/// What is said of all together.
const ALL: Line = Line::solid(BLACK).width(1.6);

/// All figures for which there is something to show.
pub fn all(run: &Run) -> Vec<Figure> {
    if run.times_s.is_empty() || run.tracks.is_empty() {
        return Vec::new();
    }
    let figures = [
        plane::trajectories(run),
        distance::of_pairs(run),
        error::by_those_heard(run),
        error::to_the_ideal(run),
        error::components(run),
        hull::distance(run),
        repair::before_and_after(run),
        latency::information_age(run),
        latency::wake_lateness(run),
        latency::late_by_cause(run),
    ];
    figures.into_iter().flatten().collect()
}

/// A panel over run time with the faults as bands.
pub(super) fn over_time(run: &Run, y: Axis) -> Panel {
    let mut panel = Panel::new(Axis::exact("time (s)", 0.0, run.end_s()), y);
    if run.scene.faults.len() > ROWS_SHOWN {
        panel.bands = merged_bands(run);
        return panel;
    }
    let named = run.scene.faults.len() <= FAULTS_NAMED;
    let faults = run.scene.faults.iter().enumerate();
    panel.bands = faults
        .map(|(place, fault)| Band {
            from: fault.t_s,
            to: fault.until_s.unwrap_or(f64::INFINITY).min(run.end_s()),
            label: if named { fault.what.clone() } else { (place + 1).to_string() },
        })
        .collect();
    panel
}

/// Returns bands without labels that cover the times at which any fault lasted: at most [`BANDS_MAX`].
fn merged_bands(run: &Run) -> Vec<Band> {
    let (end_s, gap_s) = (run.end_s(), run.end_s() / BANDS_MAX as f64);
    let spans =
        run.scene.faults.iter().map(|fault| {
            (fault.t_s, fault.until_s.unwrap_or(f64::INFINITY).min(end_s).max(fault.t_s))
        });
    let mut spans: Vec<(f64, f64)> = spans.filter(|(from, _)| from.is_finite()).collect();
    spans.sort_by(|a, b| a.0.total_cmp(&b.0));
    let mut bands: Vec<Band> = Vec::new();
    for (from, to) in spans {
        match bands.last_mut() {
            Some(last) if from < last.to + gap_s => last.to = last.to.max(to),
            _ => bands.push(Band { from, to, label: String::new() }),
        }
    }
    bands
}

/// A place over the whole width.
fn row(y: f64, height: f64) -> Place {
    Place { x: 0.0, y, width: WIDTH, height }
}

/// The stretch of the last share of a run that went to its end.
fn last_stretch(run: &Run) -> (f64, f64) {
    let end_s = run.lasts_s();
    (end_s * (1.0 - FINAL_SHARE), end_s)
}

/// What is said of the bands.
fn about_bands(run: &Run) -> String {
    match run.scene.faults.len() {
        0 => String::new(),
        1..=FAULTS_NAMED => " Tinted: faults.".into(),
        count if count > ROWS_SHOWN => format!(
            " Tinted: the times at which any of the {count} faults lasted, too many to be drawn one by one."
        ),
        _ => " Tinted: faults, by their numbers in the table.".into(),
    }
}

/// What the scenario expects under this name, and what came of it.
fn expected<'r>(run: &'r Run, name: &str) -> Option<&'r Expectation> {
    run.summary.as_ref()?.expected(name)
}

/// That expectation in words: what was measured, what was required, and whether it held; nothing if there is
/// none.
fn judged(run: &Run, name: &str, of: &str, unit: &str) -> String {
    let Some(expectation) = expected(run, name) else { return String::new() };
    let (measured, bound) = match expectation.value {
        Some(value) => {
            let [value, bound] = told_apart(value, expectation.bound);
            (format!("{value} {unit}"), bound)
        }
        None => ("never".to_owned(), short(expectation.bound)),
    };
    let verdict = expectation.verdict().in_words();
    let reason = expectation.reason.as_ref().map_or(String::new(), |why| format!(" ({why})"));
    format!(" {of}: {measured}, required {bound} {unit}: {verdict}{reason}.")
}

/// Draws what is required over the last share of the run, and says what came of it.
fn required_at_the_end(run: &Run, panel: &mut Panel, name: &str, of: &str) -> String {
    if let Some(expectation) = expected(run, name) {
        let label = format!("required at the end: {} m", short(expectation.bound));
        panel.bound(expectation.bound, last_stretch(run), label, BOUND);
    }
    judged(run, name, of, "m")
}

/// Many curves, of which each has a name if they are few, else the largest ones.
struct Many {
    count: usize,
    /// Places of those with a name.
    named: Vec<usize>,
}

impl Many {
    /// `sizes`: of each curve; the largest are named.
    fn by_size(sizes: &[f64]) -> Many {
        let count = sizes.len();
        let mut named: Vec<usize> = (0..count).collect();
        if count > NAMED_ALL {
            named.sort_by(|&a, &b| sizes[b].total_cmp(&sizes[a]));
            named.truncate(NAMED);
        }
        Many { count, named }
    }

    fn others(&self) -> usize {
        self.count - self.named.len()
    }

    /// The nameless, then on top of them the others, each with its line and its points.
    fn draw<P: IntoIterator<Item = Option<Point>>>(
        &self,
        panel: &mut Panel,
        line: impl Fn(usize) -> Line,
        points: impl Fn(usize) -> P,
    ) {
        for place in (0..self.count).filter(|place| !self.named.contains(place)) {
            panel.over_x(points(place), Line::CROWD);
        }
        for &place in &self.named {
            panel.over_x(points(place), line(place));
        }
    }

    /// What each line stands for.
    fn key(
        &self,
        line: impl Fn(usize) -> Line,
        name: impl Fn(usize) -> String,
    ) -> Vec<(Line, String)> {
        let named = self.named.iter().map(|&place| (line(place), name(place)));
        let others = (self.others() > 0)
            .then(|| (Line::CROWD.width(0.8), format!("{} others", self.others())));
        named.chain(others).collect()
    }
}
