//! Figures and report page of a run directory.
//!
//! Reads only what the run has written, so older runs and killed runs get a report too. Missing files are left out;
//! broken ones are named in an error.
//!
//! | file | question it answers |
//! |---|---|
//! | `files` | how is a file read, complete or truncated? |
//! | `record` | where were the robots, and which events occurred? |
//! | `delays` | which latencies and ages were measured? |

mod delays;
mod files;
mod record;
#[cfg(test)]
mod tests;

use std::fs;
use std::io;
use std::path::{Path, PathBuf};

use crate::report::html::CUT_SHORT_NOTE;
use crate::report::run::{LoadedRun, NewState, StateChange};
use crate::report::scene::{RobotState, Scene, SceneFault};
use files::read_json;
use protocol::brief::Pace;
use protocol::number::{format_distinct, format_short};

use crate::columns::Table as _;
use crate::metrics::fault::FaultReport;
use crate::metrics::summary::{Summary, WallTimeValues};
use crate::results::files::checksums::{self, Damage, replace_file};
use crate::results::files::date;
use crate::results::files::host_dir::SCENARIO_FILE;
use crate::results::files::manifest::LOCKSTEP_EPOCH_UNIX_NS;
use crate::results::scene::build_scene;
use crate::results::tables::{EventLine, SampleLine, SignalLine};
use experiment::scenario::Scenario;
use experiment::scenario::file::check_inside_folder;
use formation::ns_to_seconds;

/// Reason why there is no report.
#[derive(Debug, thiserror::Error)]
pub enum ReportError {
    /// The directory is not a run directory.
    #[error(
        "{} is no run directory: it has no scenario.toml; expected the directory that `phalanx run` \
         has written",
        .0.display()
    )]
    NotARun(PathBuf),
    /// A file could not be read.
    #[error("cannot read {}: {}", .0.display(), .1)]
    Read(PathBuf, io::Error),
    /// A file is malformed: path, line counted from 1, and what was found.
    #[error("{}:{}: {}", .0.display(), .1, .2)]
    MalformedLine(PathBuf, u64, String),
    /// The run has no recorded motion.
    #[error("{} has no recorded movement to show", .0.display())]
    NoSamples(PathBuf),
    /// A figure or the page could not be written.
    #[error("cannot write {}: {}; the run itself is kept", .0.display(), .1)]
    Write(PathBuf, io::Error),
}

/// Returns the path of the run's scenario.
///
/// # Errors
///
/// The directory was not written by a run, or the scenario is a link that leads out of it.
pub fn scenario_path(run_dir: &Path) -> Result<PathBuf, ReportError> {
    let path = run_dir.join(SCENARIO_FILE);
    if !path.is_file() {
        return Err(ReportError::NotARun(run_dir.into()));
    }
    match check_inside_folder(run_dir, &path) {
        Ok(()) => Ok(path),
        Err(error) => Err(ReportError::Read(path, error)),
    }
}

/// Result of writing a page.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct WrittenPage {
    /// Path of the page.
    pub path: PathBuf,
    /// Notice for a run that ended without a summary.
    pub cut_short_note: Option<&'static str>,
    /// Description of a file that differs from what the run wrote.
    pub damage: Option<String>,
    /// Whether the files were compared with checksums.
    pub is_checked: bool,
}

/// Writes `figures/*.svg` and `report.html` of a run of this scenario. `about` is a sentence for the top of the
/// page.
pub fn write_page(
    run_dir: &Path,
    scenario: &Scenario,
    about: Option<String>,
) -> Result<WrittenPage, ReportError> {
    let check_result = checksums::check_run_files(run_dir);
    let is_checked = !matches!(check_result, Err(Damage::NoChecksums));
    let damage = check_result.err().filter(|_| is_checked).map(|damage| damage.to_string());
    let run = LoadedRun { introduction: about, damage, ..load_run(run_dir, scenario)? };
    let figures = crate::report::figures::all_figures(&run);
    let directory = run_dir.join("figures");
    fs::create_dir_all(&directory)
        .and_then(|()| check_inside_folder(run_dir, &directory))
        .map_err(write_error(&directory))?;
    for figure in &figures {
        let path = directory.join(format!("{}.svg", figure.name));
        replace_file(&path, figure.to_svg(), false).map_err(write_error(&path))?;
    }
    let path = run_dir.join("report.html");
    replace_file(&path, crate::report::html::report_html(&run, &figures), false)
        .map_err(write_error(&path))?;
    let cut_short_note = run.summary.is_none().then_some(CUT_SHORT_NOTE);
    Ok(WrittenPage { path, cut_short_note, damage: run.damage, is_checked })
}

/// Passes each line of `samples.csv` of a run directory to `take`, in order. Without the file, does nothing.
pub fn for_each_sample(
    run_dir: &Path,
    mut take: impl FnMut(SampleLine),
) -> Result<(), ReportError> {
    files::for_each_line(&run_dir.join(SampleLine::FILE), |line| {
        take(line);
        Ok(())
    })
}

/// Writes a run of this scenario as one animated SVG.
pub fn write_animation(
    run_dir: &Path,
    scenario: &Scenario,
    path: &Path,
) -> Result<(), ReportError> {
    let svg = crate::report::animation::draw_animation(&load_run(run_dir, scenario)?);
    let svg = svg.ok_or_else(|| ReportError::NoSamples(run_dir.into()))?;
    fs::write(path, svg).map_err(write_error(path))
}

fn write_error(path: &Path) -> impl FnOnce(io::Error) -> ReportError {
    let path = path.to_path_buf();
    move |error| ReportError::Write(path, error)
}

/// Reads all data of a run directory.
pub fn load_run(run_dir: &Path, scenario: &Scenario) -> Result<LoadedRun, ReportError> {
    let manifest: serde_json::Map<String, serde_json::Value> =
        read_json(&run_dir.join("manifest.json"))?.unwrap_or_default();
    let path = run_dir.join("summary.json");
    let mut summary: Option<Summary> = read_json(&path)?;
    // In earlier versions the values of the section `wall` were at the top level.
    if let (Some(summary), Some(old_wall)) = (&mut summary, read_json::<WallTimeValues>(&path)?)
        && old_wall != WallTimeValues::default()
    {
        summary.wall = old_wall;
    }
    let pace = manifest.get("pace").and_then(serde_json::Value::as_str);
    let pace = pace.unwrap_or("unknown time mode").to_owned();
    let mut scene = Scene { pace, ..build_scene(scenario, Pace::Realtime) };
    let events = record::read_events(&run_dir.join(EventLine::FILE))?;
    let state_changes = record::state_changes(&events, &scene);
    if let Some(summary) = &summary {
        scene.faults = observed_faults(scenario, summary, &events, &state_changes, &scene.faults);
    }
    let record = record::read_samples(&run_dir.join(SampleLine::FILE), scenario)?;
    let lead_positions_m = |lead: &protocol::brief::LeadBrief| {
        let positions = record.times_s.iter().map(|&t_s| lead.trajectory.target_at(t_s).position);
        positions.map(|position| [position.x, position.y]).collect()
    };
    Ok(LoadedRun {
        converged_error_m: scenario.expectations.converged_error_m,
        stale_after_s: ns_to_seconds(scenario.silence.stale_after_ns),
        lost_after_s: ns_to_seconds(scenario.silence.lost_after_ns),
        leader_reference_m: scenario.lead.as_ref().map(lead_positions_m).unwrap_or_default(),
        times_s: record.times_s,
        tracks: record.tracks,
        decimation: record.decimation,
        repair_events: record::repair_events(&events),
        signals: record::read_signals(&run_dir.join(SignalLine::FILE), scenario)?,
        state_changes,
        missing_guarantee: missing_guarantee_text(scenario, summary.as_ref()),
        introduction: None,
        damage: None,
        summary,
        manifest: manifest.iter().map(|(name, value)| format_manifest_entry(name, value)).collect(),
        latency_over_time: delays::read_latency_over_time(&run_dir.join("latency_over_time.csv"))?,
        latency_distributions: delays::read_latency_distributions(&run_dir.join("latency.hlog"))?,
        scene,
    })
}

/// Parses the text of `events.csv`.
///
/// # Errors
///
/// A line is malformed.
pub fn parse_events(text: &str) -> Result<Vec<EventLine>, ReportError> {
    let mut events = Vec::new();
    files::for_each_line_of_text(Path::new(EventLine::FILE), text.as_bytes(), |event| {
        events.push(event);
        Ok(())
    })?;
    Ok(events)
}

/// Returns the reason why no guarantee about distances holds, and the smallest distance observed.
fn missing_guarantee_text(scenario: &Scenario, summary: Option<&Summary>) -> Option<String> {
    let reason = scenario.missing_guarantee_reason()?;
    let d_m = scenario.avoidance.distance_min_m;
    let observation = summary.and_then(|summary| match summary.min_distance_over_d {
        Some(distance_over_d) => {
            Some(format!("; the smallest distance seen is {} d", format_short(distance_over_d)))
        }
        None => summary.min_distance_m.map(|distance_m| {
            let [distance, d] = format_distinct(distance_m, d_m);
            format!("; the smallest distance seen is {distance} m, with d = {d} m")
        }),
    });
    Some(reason + &observation.unwrap_or_default())
}

/// Formats an entry of the manifest: commands as a shell accepts them, times as dates.
fn format_manifest_entry(name: &str, value: &serde_json::Value) -> (String, String) {
    let unix_ns = value.as_u64();
    let text = match (name, value, unix_ns) {
        ("command", serde_json::Value::Array(arguments), _) => {
            format_command_line(arguments.iter().map(format_value))
        }
        ("epoch_unix_ns", _, Some(LOCKSTEP_EPOCH_UNIX_NS)) => format!(
            "{}, as of every run in lockstep, so that equal runs give equal bytes",
            date::format_date(LOCKSTEP_EPOCH_UNIX_NS / 1_000_000_000)
        ),
        ("started_unix_ns" | "epoch_unix_ns", _, Some(unix_ns)) => {
            date::format_date(unix_ns / 1_000_000_000)
        }
        _ => format_value(value),
    };
    (name.strip_suffix("_unix_ns").unwrap_or(name).to_owned(), text)
}

/// Formats arguments as a command line of a POSIX shell.
pub fn format_command_line(arguments: impl Iterator<Item = impl AsRef<str>>) -> String {
    arguments.map(|argument| quote_for_shell(argument.as_ref())).collect::<Vec<_>>().join(" ")
}

/// Quotes an argument for a POSIX shell.
fn quote_for_shell(argument: &str) -> String {
    let is_plain =
        |character: char| character.is_ascii_alphanumeric() || "_-./=:,+@%".contains(character);
    if !argument.is_empty() && argument.chars().all(is_plain) {
        return argument.to_owned();
    }
    format!("'{}'", argument.replace('\'', r"'\''"))
}

fn format_value(value: &serde_json::Value) -> String {
    match value {
        serde_json::Value::Null => "-".into(),
        serde_json::Value::String(text) => text.clone(),
        serde_json::Value::Array(list) => {
            list.iter().map(format_value).collect::<Vec<_>>().join(" ")
        }
        other => other.to_string(),
    }
}

/// Returns the faults as observed. `planned` are the faults of the scenario.
fn observed_faults(
    scenario: &Scenario,
    summary: &Summary,
    events: &[EventLine],
    changes: &[StateChange],
    planned: &[SceneFault],
) -> Vec<SceneFault> {
    let observed_fault = |fault: &FaultReport| {
        let is_earlier_plan = |planned_fault: &&SceneFault| {
            planned_fault.what == fault.what && planned_fault.t_s <= fault.t_s + 1e-9
        };
        let planned_fault = planned.iter().rfind(is_earlier_plan);
        let robot_index =
            |name: &String| scenario.robots.iter().position(|robot| robot.name == *name);
        let robot = fault.robot.as_ref().and_then(robot_index);
        // A fault that never ends has a duration of 0.
        let lasted_s = fault.lasted_s.filter(|&lasted_s| lasted_s > 0.0);
        let is_moving_again = changes.iter().any(|change| {
            change.t_s == fault.t_s
                && robot.map(|robot_index| NewState::Robot(robot_index, RobotState::Moving))
                    == Some(change.new_state)
        });
        let immediate_end = (is_moving_again && fault.lasted_s.is_some()).then_some(0.0);
        SceneFault {
            t_s: fault.t_s,
            until_s: lasted_s.or(immediate_end).map(|lasted_s| fault.t_s + lasted_s),
            what: fault.what.clone(),
            robots: robot.into_iter().collect(),
            cuts: planned_fault
                .and_then(|planned_fault| planned_fault.cuts)
                .or_else(|| record::manually_cut_edge(events, scenario, fault.t_s)),
        }
    };
    summary.faults.iter().map(observed_fault).collect()
}
