//! Readers of `samples.csv` and `events.csv`.
//!
//! A killed run leaves both files truncated: an incomplete last line or instant is left out.

use std::collections::HashMap;
use std::iter::Peekable;
use std::path::Path;

use crate::report::run::{Change, ChangedTo, Sample};
use crate::report::scene::{EdgeState, RobotState, Scene, SceneEdge, SceneFault};
use formation::Vec2;
use formation::pose::Pose;

use super::ReportError;
use super::files::{each_line, each_line_of, text};
use crate::metrics::vectors::{ErrorVectors, Silence};
use crate::results::goals;
use crate::results::tables::{EventLine, SampleLine};
use experiment::scenario::Scenario;
use experiment::scenario::Silenced;

/// Maximum number of samples that are loaded. Of a longer record only every n-th instant is used.
const SAMPLES_MAX: usize = 2_000_000;

/// Content of `samples.csv`.
pub(super) struct Record {
    pub(super) times_s: Vec<f64>,
    pub(super) tracks: Vec<Vec<Sample>>,
    pub(super) every: usize,
}

/// Reads `events.csv`.
pub(super) fn events(path: &Path) -> Result<Vec<EventLine>, ReportError> {
    let mut events = Vec::new();
    each_line(path, |event| {
        events.push(event);
        Ok(())
    })?;
    // A contact event has the time at which the contact changed.
    events.sort_by(|a: &EventLine, b| a.t_s.total_cmp(&b.t_s));
    Ok(events)
}

/// A goal that a robot got from outside.
pub(super) struct GoalEvent {
    t_s: f64,
    robot: usize,
    goal: Vec2,
}

/// Returns the goals that robots got from outside, in order of time.
pub(super) fn goals(events: &[EventLine], scenario: &Scenario) -> Vec<GoalEvent> {
    let sent = |event: &EventLine| {
        let robot = scenario.robots.iter().position(|robot| robot.name == event.robot)?;
        Some(GoalEvent {
            t_s: event.t_s,
            robot,
            goal: goals::parse_position_m(&event.detail)?.into(),
        })
    };
    events.iter().filter(|event| event.kind == goals::EVENT).filter_map(sent).collect()
}

/// Kind of the events about topology repair.
const REPAIR: &str = "repair";

/// Returns the state changes of robots and edges, in order of time.
pub(super) fn changes(events: &[EventLine], scene: &Scene) -> Vec<Change> {
    let robots = scene.robots.iter().enumerate();
    let place: HashMap<&str, usize> = robots.map(|(i, robot)| (robot.name.as_str(), i)).collect();
    let change = |EventLine { t_s, kind, robot, detail, .. }: &EventLine| {
        let robot = *place.get(robot.as_str())?;
        let state = match kind.as_str() {
            "kill" | "died" => RobotState::Dead,
            "restart" => RobotState::Starting,
            "ready" | "thaw" | "led" => RobotState::Moving,
            "orphaned" => RobotState::Orphaned,
            "freeze" if detail.starts_with("SIGSTOP") => RobotState::Frozen,
            "contact" => {
                let (word, heard) = detail.split_once(' ')?;
                let ends = (*place.get(heard)?, robot);
                let is_heard = |edge: &SceneEdge| (edge.from, edge.to) == ends && !edge.spare;
                let edge = scene.edges.iter().position(is_heard)?;
                let to = ChangedTo::Edge(edge, edge_state(word)?);
                return Some(Change { t_s: *t_s, to });
            }
            REPAIR => {
                // Earlier versions wrote "goes by" and "goes no longer by".
                let after =
                    |words: [&str; 2]| words.into_iter().find_map(|word| detail.strip_prefix(word));
                let used = after(["uses ", "goes by "]);
                let unused = after(["no longer uses ", "goes no longer by "]);
                let (yes, by) = match (used, unused) {
                    (Some(by), _) => (true, by),
                    (None, Some(by)) => (false, by),
                    (None, None) => {
                        let to = ChangedTo::Leads(robot, detail == "leads");
                        return Some(Change { t_s: *t_s, to });
                    }
                };
                let ends = (*place.get(by)?, robot);
                let is_spare = |edge: &SceneEdge| (edge.from, edge.to) == ends && edge.spare;
                let edge = scene.edges.iter().position(is_spare)?;
                let state = if yes { EdgeState::Fresh } else { EdgeState::Closed };
                return Some(Change { t_s: *t_s, to: ChangedTo::Edge(edge, state) });
            }
            _ => return None,
        };
        Some(Change { t_s: *t_s, to: ChangedTo::Robot(robot, state) })
    };
    events.iter().filter_map(change).collect()
}

/// Returns the repair events in order of time: time, s, robot, and detail.
pub(super) fn repairs(events: &[EventLine]) -> Vec<(f64, String, String)> {
    let repairs = events.iter().filter(|event| event.kind == REPAIR);
    repairs.map(|event| (event.t_s, event.robot.clone(), event.detail.clone())).collect()
}

/// Parses the keyword of an edge state in `events.csv`.
fn edge_state(word: &str) -> Option<EdgeState> {
    match word {
        "fresh" => Some(EdgeState::Fresh),
        "stale" => Some(EdgeState::Stale),
        "lost" => Some(EdgeState::Lost),
        _ => None,
    }
}

/// Reads `samples.csv`. Without the file, the record is empty.
pub(super) fn record(
    path: &Path,
    scenario: &Scenario,
    faults: &[SceneFault],
    goals: &[GoalEvent],
) -> Result<Record, ReportError> {
    let robots = scenario.robots.len();
    let mut record = Record { times_s: Vec::new(), tracks: vec![Vec::new(); robots], every: 1 };
    let Some(text) = text(path)? else { return Ok(record) };
    let lines = text.iter().filter(|&&byte| byte == b'\n').count();
    record.every = lines.div_ceil(SAMPLES_MAX).max(1);
    let names = scenario.robots.iter().map(|robot| robot.name.as_str());
    let mut instants = SampleAssembler {
        record,
        place: names.zip(0..).collect(),
        last: lines.saturating_sub(1) / robots.max(1),
        errors: ErrorVectors::new(scenario, silences(scenario, faults)),
        goals: goals.iter().peekable(),
        number: 0,
        t_s: f64::NEG_INFINITY,
        samples: vec![None; robots],
        missing: robots,
    };
    each_line_of(path, &text, |line| instants.add_line(line))?;
    Ok(instants.record)
}

/// Assembler of the lines of each instant.
struct SampleAssembler<'a, G: Iterator<Item = &'a GoalEvent>> {
    record: Record,
    place: HashMap<&'a str, usize>,
    /// Number of complete instants of the file.
    last: usize,
    errors: ErrorVectors,
    goals: Peekable<G>,
    /// Number of complete instants read.
    number: usize,
    /// Time of the instant in progress, s.
    t_s: f64,
    samples: Vec<Option<Sample>>,
    missing: usize,
}

impl<'a, G: Iterator<Item = &'a GoalEvent>> SampleAssembler<'a, G> {
    fn add_line(&mut self, line: SampleLine) -> Result<(), String> {
        let begins = self.missing == self.samples.len();
        if begins && !(line.t_s.is_finite() && line.t_s >= self.t_s) {
            return Err(format!("time {} is not later than the one before", line.t_s));
        }
        if !begins && line.t_s != self.t_s {
            return Err(format!(
                "the time changes, but {} robots have no sample yet",
                self.missing
            ));
        }
        self.t_s = line.t_s;
        let Some(&robot) = self.place.get(line.robot.as_str()) else {
            return Err(format!("{:?} is no robot of scenario.toml", line.robot));
        };
        let sample = Sample {
            x_m: line.x_m,
            y_m: line.y_m,
            heading_rad: line.heading_rad,
            error_m: line.error_m,
            ideal_error_m: line.ideal_error_m,
            error_xy_m: None,
            alive: line.alive,
        };
        if self.samples[robot].replace(sample).is_some() {
            return Err(format!("{:?} occurs twice at one time", line.robot));
        }
        self.missing -= 1;
        if self.missing == 0 {
            self.finish_instant();
        }
        Ok(())
    }

    /// Completes an instant of which all robots have a sample.
    fn finish_instant(&mut self) {
        while let Some(sent) = self.goals.next_if(|sent| sent.t_s <= self.t_s) {
            self.errors.set_goal(sent.robot, sent.goal);
        }
        let samples: Vec<Sample> = self.samples.iter_mut().filter_map(Option::take).collect();
        if self.number.is_multiple_of(self.record.every) || self.number + 1 >= self.last {
            let pose = |at: &Sample| Pose { x_m: at.x_m, y_m: at.y_m, heading_rad: at.heading_rad };
            let poses: Vec<Pose> = samples.iter().map(pose).collect();
            let errors = self.errors.errors_at(self.t_s, &poses);
            for ((track, sample), error) in self.record.tracks.iter_mut().zip(&samples).zip(errors)
            {
                // The moment of a silence is not known to the tick: where the computed error differs from the
                // measured one, its components are unknown.
                let same = |error: &Vec2| {
                    let measured = sample.error_m.unwrap_or(f64::NAN);
                    (error.norm() - measured).abs() <= 1e-9 * measured.max(1.0)
                };
                let error_xy_m = error.filter(same).map(|error| [error.x, error.y]);
                track.push(Sample { error_xy_m, ..*sample });
            }
            self.record.times_s.push(self.t_s);
        }
        self.number += 1;
        self.missing = self.samples.len();
    }
}

/// Returns the periods in which robots and edges were silent.
fn silences(scenario: &Scenario, faults: &[SceneFault]) -> Vec<Silence> {
    let planned: HashMap<String, Silenced> = scenario
        .faults
        .iter()
        .map(|fault| (fault.kind.describe(scenario), fault.kind.struck(scenario).silenced))
        .collect();
    let silence = |fault: &SceneFault| {
        // An unplanned fault is a manual cut or a death.
        let died = || fault.robots.first().map_or(Silenced::Nobody, |&i| Silenced::Robot(i));
        let by_hand = || fault.cuts.map_or_else(died, Silenced::Edge);
        Silence {
            from_s: fault.t_s,
            until_s: fault.until_s.unwrap_or(f64::INFINITY),
            silenced: planned.get(&fault.what).copied().unwrap_or_else(by_hand),
        }
    };
    faults.iter().map(silence).collect()
}
