//! From a run directory to its figures and its page.
//!
//! Reads what the run has written, and nothing else: a run of yesterday and one that was killed
//! half-way get a report as well. What a run had no time to write is left out; what is broken is
//! named.
//!
//! | file | question it answers |
//! |---|---|
//! | `files` | how is a file read, whole or cut short? |
//! | `record` | where was everybody, and what happened, as far as it was written down? |
//! | `delays` | how late, how long and how old was everything? |

mod delays;
mod files;
mod record;
#[cfg(test)]
mod tests;

use std::fs;
use std::io;
use std::path::{Path, PathBuf};

use crate::report::html::CUT_SHORT;
use crate::report::run::{Change, ChangedTo, Run};
use crate::report::scene::{RobotState, Scene, SceneFault};
use files::json;
use protocol::brief::Pace;
use protocol::fault::LinkFaultKind;
use protocol::number::told_apart;

use crate::metrics::fault::FaultReport;
use crate::metrics::summary::{Summary, Wall};
use crate::results::checksums::{self, Damage, replace};
use crate::results::date;
use crate::results::host_dir::SCENARIO;
use crate::results::manifest::LOCKSTEP_EPOCH_UNIX_NS;
use crate::results::scene::scene;
use experiment::scenario::file::stays_in;
use experiment::scenario::{FaultKind, Scenario};
use formation::seconds;

/// Why there is no report.
#[derive(Debug, thiserror::Error)]
pub enum ReportError {
    /// The directory is of another kind.
    #[error(
        "{} is no run directory: it has no scenario.toml; expected the directory that `phalanx run` \
         has written",
        .0.display()
    )]
    NotARun(PathBuf),
    /// A file could not be read.
    #[error("cannot read {}: {}", .0.display(), .1)]
    Read(PathBuf, io::Error),
    /// A file is not as a run writes it: which, at which line from 1, and what is there.
    #[error("{}:{}: {}", .0.display(), .1, .2)]
    Broken(PathBuf, u64, String),
    /// There is nothing that could move.
    #[error("{} has no recorded movement to show", .0.display())]
    Nothing(PathBuf),
    /// A figure or the page could not be written.
    #[error("cannot write {}: {}; the run itself is kept", .0.display(), .1)]
    Write(PathBuf, io::Error),
}

/// Refuses a directory that no run has written.
pub fn scenario_path(run_dir: &Path) -> Result<PathBuf, ReportError> {
    let path = run_dir.join(SCENARIO);
    if !path.is_file() {
        return Err(ReportError::NotARun(run_dir.into()));
    }
    match stays_in(run_dir, &path) {
        Ok(()) => Ok(path),
        Err(error) => Err(ReportError::Read(path, error)),
    }
}

/// A page that was written.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Written {
    /// Where it is.
    pub path: PathBuf,
    /// What is to be said of the run, if it ended without a summary.
    pub cut_short: Option<&'static str>,
    /// Which of its files is not as the run wrote it.
    pub damage: Option<String>,
    /// Whether its files could be held against checksums.
    pub is_checked: bool,
}

/// Writes `figures/*.svg` and `report.html` of a run of this scenario; `about` it, a sentence stands at its top.
pub fn write(
    run_dir: &Path,
    scenario: &Scenario,
    about: Option<String>,
) -> Result<Written, ReportError> {
    let checked = checksums::check(run_dir);
    let is_checked = !matches!(checked, Err(Damage::NoChecksums));
    let damage = checked.err().filter(|_| is_checked).map(|damage| damage.to_string());
    let run = Run { about, damage, ..load(run_dir, scenario)? };
    let figures = crate::report::figures::all(&run);
    let directory = run_dir.join("figures");
    fs::create_dir_all(&directory)
        .and_then(|()| stays_in(run_dir, &directory))
        .map_err(unwritten(&directory))?;
    for figure in &figures {
        let path = directory.join(format!("{}.svg", figure.name));
        replace(&path, figure.svg(), false).map_err(unwritten(&path))?;
    }
    let path = run_dir.join("report.html");
    replace(&path, crate::report::html::report(&run, &figures), false).map_err(unwritten(&path))?;
    let cut_short = run.summary.is_none().then_some(CUT_SHORT);
    Ok(Written { path, cut_short, damage: run.damage, is_checked })
}

/// Writes a run of this scenario as one animated picture.
pub fn animate(run_dir: &Path, scenario: &Scenario, path: &Path) -> Result<(), ReportError> {
    let svg = crate::report::animation::animation(&load(run_dir, scenario)?);
    let svg = svg.ok_or_else(|| ReportError::Nothing(run_dir.into()))?;
    fs::write(path, svg).map_err(unwritten(path))
}

fn unwritten(path: &Path) -> impl FnOnce(io::Error) -> ReportError {
    let path = path.to_path_buf();
    move |error| ReportError::Write(path, error)
}

/// Everything that a run directory says.
pub fn load(run_dir: &Path, scenario: &Scenario) -> Result<Run, ReportError> {
    let manifest: serde_json::Map<String, serde_json::Value> =
        json(&run_dir.join("manifest.json"))?.unwrap_or_default();
    let path = run_dir.join("summary.json");
    let mut summary: Option<Summary> = json(&path)?;
    // Before there was a section for it, what depends on wall time stood at the top.
    if let (Some(summary), Some(at_the_top)) = (&mut summary, json::<Wall>(&path)?)
        && at_the_top != Wall::default()
    {
        summary.wall = at_the_top;
    }
    let pace = manifest.get("pace").and_then(serde_json::Value::as_str);
    let pace = pace.unwrap_or("unknown pace").to_owned();
    let mut scene = Scene { pace, ..scene(scenario, Pace::Realtime) };
    let events = record::events(&run_dir.join("events.csv"))?;
    let changes = record::changes(&events, &scene);
    if let Some(summary) = &summary {
        scene.faults = seen(scenario, summary, &changes, &scene.faults);
    }
    let goals = record::goals(&events, scenario);
    let record = record::record(&run_dir.join("samples.csv"), scenario, &scene.faults, &goals)?;
    let lead_m = |lead: &protocol::brief::LeadBrief| {
        let places = record.times_s.iter().map(|&t_s| lead.trajectory.target_at(t_s).position);
        places.map(|place| [place.x, place.y]).collect()
    };
    Ok(Run {
        converged_error_m: scenario.expect.converged_error_m,
        stale_after_s: seconds(scenario.silence.stale_after_ns),
        lost_after_s: seconds(scenario.silence.lost_after_ns),
        lead_m: scenario.lead.as_ref().map(lead_m).unwrap_or_default(),
        times_s: record.times_s,
        tracks: record.tracks,
        every: record.every,
        repairs: record::repairs(&events),
        changes,
        unpromised: unpromised(scenario, summary.as_ref()),
        about: None,
        damage: None,
        summary,
        manifest: manifest.iter().map(|(name, value)| manifest_line(name, value)).collect(),
        over_time: delays::over_time(&run_dir.join("latency_over_time.csv"))?,
        spreads: delays::spreads(&run_dir.join("latency.hlog"))?,
        scene,
    })
}

/// Why no promise about distances holds, and what was seen of them.
fn unpromised(scenario: &Scenario, summary: Option<&Summary>) -> Option<String> {
    let why = scenario.unpromised()?;
    let d_m = scenario.avoidance.distance_min_m;
    let seen = summary.and_then(|summary| summary.min_distance_m).map(|seen_m| {
        let [seen, d] = told_apart(seen_m, d_m);
        format!("; the smallest distance seen is {seen} m, with d = {d} m")
    });
    Some(why + &seen.unwrap_or_default())
}

/// A line of the manifest as people read it: a command that a shell takes, dates.
fn manifest_line(name: &str, value: &serde_json::Value) -> (String, String) {
    let unix_ns = value.as_u64();
    let in_words = match (name, value, unix_ns) {
        ("command", serde_json::Value::Array(words), _) => command_line(words.iter().map(in_words)),
        ("epoch_unix_ns", _, Some(LOCKSTEP_EPOCH_UNIX_NS)) => format!(
            "{}, as of every run in lockstep, so that equal runs give equal bytes",
            date::in_words(LOCKSTEP_EPOCH_UNIX_NS / 1_000_000_000)
        ),
        ("started_unix_ns" | "epoch_unix_ns", _, Some(unix_ns)) => {
            date::in_words(unix_ns / 1_000_000_000)
        }
        _ => in_words(value),
    };
    (name.strip_suffix("_unix_ns").unwrap_or(name).to_owned(), in_words)
}

/// Words as a POSIX shell reads them.
pub fn command_line(words: impl Iterator<Item = impl AsRef<str>>) -> String {
    words.map(|word| quoted(word.as_ref())).collect::<Vec<_>>().join(" ")
}

/// A word as a POSIX shell reads it.
fn quoted(word: &str) -> String {
    let plain = |letter: char| letter.is_ascii_alphanumeric() || "_-./=:,+@%".contains(letter);
    if !word.is_empty() && word.chars().all(plain) {
        return word.to_owned();
    }
    format!("'{}'", word.replace('\'', r"'\''"))
}

fn in_words(value: &serde_json::Value) -> String {
    match value {
        serde_json::Value::Null => "-".into(),
        serde_json::Value::String(text) => text.clone(),
        serde_json::Value::Array(list) => list.iter().map(in_words).collect::<Vec<_>>().join(" "),
        other => other.to_string(),
    }
}

/// The faults as they were seen; `planned`: as they were planned.
fn seen(
    scenario: &Scenario,
    summary: &Summary,
    changes: &[Change],
    planned: &[SceneFault],
) -> Vec<SceneFault> {
    let seen = |fault: &FaultReport| {
        let before = |plan: &&SceneFault| plan.what == fault.what && plan.t_s <= fault.t_s + 1e-9;
        let plan = planned.iter().rfind(before);
        let place = |name: &String| scenario.robots.iter().position(|robot| robot.name == *name);
        let robot = fault.robot.as_ref().and_then(place);
        // What never ends is over as soon as it began.
        let lasted_s = fault.lasted_s.filter(|&lasted_s| lasted_s > 0.0);
        let back = changes.iter().any(|change| {
            change.t_s == fault.t_s
                && robot.map(|place| ChangedTo::Robot(place, RobotState::Moving)) == Some(change.to)
        });
        let at_once = (back && fault.lasted_s.is_some()).then_some(0.0);
        SceneFault {
            t_s: fault.t_s,
            until_s: lasted_s.or(at_once).map(|lasted_s| fault.t_s + lasted_s),
            what: fault.what.clone(),
            robots: robot.into_iter().collect(),
            cuts: plan.and_then(|plan| plan.cuts).or_else(|| cut_by_hand(scenario, &fault.what)),
        }
    };
    summary.faults.iter().map(seen).collect()
}

/// The edge that somebody has cut by hand, by what the summary says of it.
fn cut_by_hand(scenario: &Scenario, what: &str) -> Option<usize> {
    let what = what.strip_suffix(", by hand")?;
    let mut edges = 0..scenario.graph.edges().len();
    edges
        .find(|&edge| FaultKind::Link { edge, kind: LinkFaultKind::Cut }.struck(scenario).0 == what)
}
