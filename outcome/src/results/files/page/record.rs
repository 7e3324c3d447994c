//! Readers of `samples.csv`, `signals.csv` and `events.csv`.
//!
//! A killed run leaves both files truncated: an incomplete last line or instant is left out.

use std::collections::HashMap;
use std::path::Path;

use experiment::scenario::Scenario;
use formation::graph::Edge;

use super::ReportError;
use super::files::{for_each_line, for_each_line_of_text, read_file};
use crate::report::run::{NewState, RobotSample, SignalTrack, StateChange};
use crate::report::scene::{EdgeState, RobotState, Scene};
use crate::results::tables::{EventLine, SampleLine, SignalLine};

/// Maximum number of samples that are loaded. Of a longer record only every n-th instant is used.
const SAMPLES_MAX: usize = 2_000_000;

/// Content of `samples.csv`.
pub(super) struct SampleRecord {
    pub(super) times_s: Vec<f64>,
    pub(super) tracks: Vec<Vec<RobotSample>>,
    pub(super) decimation: usize,
}

/// Reads `events.csv`.
pub(super) fn read_events(path: &Path) -> Result<Vec<EventLine>, ReportError> {
    let mut events = Vec::new();
    for_each_line(path, |event| {
        events.push(event);
        Ok(())
    })?;
    // A contact event has the time at which the contact changed.
    events.sort_by(|a: &EventLine, b| a.t_s.total_cmp(&b.t_s));
    Ok(events)
}

/// Kind of the events about topology repair.
const REPAIR_EVENT: &str = "repair";

/// Returns the state changes of robots and edges, in order of time. Events of earlier versions have no columns for the
/// changes of edges and deputies.
pub(super) fn state_changes(events: &[EventLine], scene: &Scene) -> Vec<StateChange> {
    let robots = scene.robots.iter().enumerate();
    let robot_indices: HashMap<&str, usize> =
        robots.map(|(i, robot)| (robot.name.as_str(), i)).collect();
    let mut states = vec![RobotState::Moving; scene.robots.len()];
    let change = |event: &EventLine| {
        let robot = *robot_indices.get(event.robot.as_str())?;
        let edge = |is_spare: bool| {
            let edge_ends = (*robot_indices.get(event.other.as_str())?, robot);
            let edges = &mut scene.edges.iter();
            edges.position(|edge| (edge.from, edge.to) == edge_ends && edge.spare == is_spare)
        };
        let new_state = match (event.kind.as_str(), event.state.as_str()) {
            ("kill" | "died", _) => NewState::Robot(robot, RobotState::Dead),
            ("restart", _) => NewState::Robot(robot, RobotState::Starting),
            ("ready" | "thaw" | "led", _) => NewState::Robot(robot, RobotState::Moving),
            ("orphaned", _) => NewState::Robot(robot, RobotState::Orphaned),
            // Without a process there is nothing to freeze.
            ("freeze", _) if ![RobotState::Dead, RobotState::Starting].contains(&states[robot]) => {
                NewState::Robot(robot, RobotState::Frozen)
            }
            ("contact", state) => NewState::Edge(edge(false)?, parse_edge_state(state)?),
            (REPAIR_EVENT, "leads") => NewState::Leads(robot, true),
            (REPAIR_EVENT, "follows") => NewState::Leads(robot, false),
            (REPAIR_EVENT, "used") => NewState::Edge(edge(true)?, EdgeState::Fresh),
            (REPAIR_EVENT, "unused") => NewState::Edge(edge(true)?, EdgeState::Closed),
            _ => return None,
        };
        if let NewState::Robot(robot, state) = new_state {
            states[robot] = state;
        }
        Some(StateChange { t_s: event.t_s, new_state })
    };
    events.iter().filter_map(change).collect()
}

/// Returns the edge that was cut manually at this time, s. `None` for events of earlier versions.
pub(super) fn manually_cut_edge(
    events: &[EventLine],
    scenario: &Scenario,
    t_s: f64,
) -> Option<usize> {
    let cut_event = events.iter().find(|event| event.kind == "cut" && event.t_s == t_s)?;
    let name = |robot: usize| &scenario.robots[robot].name;
    let is_cut_edge =
        |edge: &Edge| (name(edge.from), name(edge.to)) == (&cut_event.other, &cut_event.robot);
    scenario.graph.edges().iter().position(is_cut_edge)
}

/// Returns the repair events in order of time: time, s, robot, and detail.
pub(super) fn repair_events(events: &[EventLine]) -> Vec<(f64, String, String)> {
    let repairs = events.iter().filter(|event| event.kind == REPAIR_EVENT);
    repairs.map(|event| (event.t_s, event.robot.clone(), event.detail.clone())).collect()
}

/// Reads `signals.csv`. Without the file, there are no signals.
pub(super) fn read_signals(
    path: &Path,
    scenario: &Scenario,
) -> Result<Vec<SignalTrack>, ReportError> {
    let robots = scenario.robots.iter().zip(0..);
    let robot_indices: HashMap<&str, usize> =
        robots.map(|(robot, i)| (robot.name.as_str(), i)).collect();
    let mut signals: Vec<SignalTrack> = Vec::new();
    for_each_line(path, |line: SignalLine| {
        let Some(&robot) = robot_indices.get(line.robot.as_str()) else {
            return Err(format!("{:?} is no robot of scenario.toml", line.robot));
        };
        if !(line.t_s.is_finite() && line.value.is_finite()) {
            return Err("a number is not finite".to_owned());
        }
        let known_signal = signals.iter().position(|signal| signal.name == line.signal);
        let signal_index = known_signal.unwrap_or_else(|| {
            let values = vec![Vec::new(); scenario.robots.len()];
            signals.push(SignalTrack { name: line.signal, values });
            signals.len() - 1
        });
        signals[signal_index].values[robot].push((line.t_s, line.value));
        Ok(())
    })?;
    Ok(signals)
}

/// Parses the keyword of an edge state in `events.csv`.
fn parse_edge_state(keyword: &str) -> Option<EdgeState> {
    match keyword {
        "fresh" => Some(EdgeState::Fresh),
        "stale" => Some(EdgeState::Stale),
        "lost" => Some(EdgeState::Lost),
        "apart" => Some(EdgeState::Closed),
        _ => None,
    }
}

/// Reads `samples.csv`. Without the file, the record is empty.
pub(super) fn read_samples(path: &Path, scenario: &Scenario) -> Result<SampleRecord, ReportError> {
    let robots = scenario.robots.len();
    let mut record =
        SampleRecord { times_s: Vec::new(), tracks: vec![Vec::new(); robots], decimation: 1 };
    let Some(text) = read_file(path)? else { return Ok(record) };
    let line_count = text.iter().filter(|&&byte| byte == b'\n').count();
    record.decimation = line_count.div_ceil(SAMPLES_MAX).max(1);
    let names = scenario.robots.iter().map(|robot| robot.name.as_str());
    let mut assembler = SampleAssembler {
        record,
        robot_indices: names.zip(0..).collect(),
        instant_count: line_count.saturating_sub(1) / robots.max(1),
        instant_number: 0,
        t_s: f64::NEG_INFINITY,
        samples: vec![None; robots],
        missing_samples: robots,
    };
    for_each_line_of_text(path, &text, |line| assembler.add_line(line))?;
    Ok(assembler.record)
}

/// Assembler of the lines of each instant.
struct SampleAssembler<'a> {
    record: SampleRecord,
    robot_indices: HashMap<&'a str, usize>,
    /// Number of complete instants of the file.
    instant_count: usize,
    /// Number of complete instants read.
    instant_number: usize,
    /// Time of the instant in progress, s.
    t_s: f64,
    samples: Vec<Option<RobotSample>>,
    missing_samples: usize,
}

impl SampleAssembler<'_> {
    fn add_line(&mut self, line: SampleLine) -> Result<(), String> {
        let is_first_robot = self.missing_samples == self.samples.len();
        if is_first_robot && !(line.t_s.is_finite() && line.t_s >= self.t_s) {
            return Err(format!("time {} is not later than the one before", line.t_s));
        }
        if !is_first_robot && line.t_s != self.t_s {
            return Err(format!(
                "the time changes, but {} robots have no sample yet",
                self.missing_samples
            ));
        }
        self.t_s = line.t_s;
        let Some(&robot) = self.robot_indices.get(line.robot.as_str()) else {
            return Err(format!("{:?} is no robot of scenario.toml", line.robot));
        };
        let sample = RobotSample {
            x_m: line.x_m,
            y_m: line.y_m,
            heading_rad: line.heading_rad,
            error_m: line.error_m,
            ideal_error_m: line.ideal_error_m,
            error_xy_m: line.error_x_m.zip(line.error_y_m).map(<[f64; 2]>::from),
            is_alive: line.alive,
        };
        if self.samples[robot].replace(sample).is_some() {
            return Err(format!("{:?} occurs twice at one time", line.robot));
        }
        self.missing_samples -= 1;
        if self.missing_samples == 0 {
            self.finish_instant();
        }
        Ok(())
    }

    /// Completes an instant of which all robots have a sample.
    fn finish_instant(&mut self) {
        let samples = self.samples.iter_mut().filter_map(Option::take);
        if self.instant_number.is_multiple_of(self.record.decimation)
            || self.instant_number + 1 >= self.instant_count
        {
            self.record
                .tracks
                .iter_mut()
                .zip(samples)
                .for_each(|(track, sample)| track.push(sample));
            self.record.times_s.push(self.t_s);
        } else {
            samples.for_each(drop);
        }
        self.instant_number += 1;
        self.missing_samples = self.samples.len();
    }
}
