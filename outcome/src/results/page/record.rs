//! Where everybody was, and what happened: `samples.csv` and `events.csv`.
//!
//! A run that was killed leaves both without their ends: a last line or instant that is not whole
//! is left out.

use std::collections::HashMap;
use std::path::Path;

use crate::report::run::{Change, ChangedTo, Sample};
use crate::report::scene::{RobotState, Scene, SceneFault};
use csv::{ByteRecord, ReaderBuilder};
use formation::Vec2;
use formation::pose::Pose;

use super::{ReportError, edge_state, text};
use crate::metrics::vectors::{ErrorVectors, Silence};
use crate::results::goals;
use experiment::scenario::Scenario;
use experiment::scenario::Silenced;

/// No more samples of one robot at one instant than this are taken in; of a longer record only one
/// of so many instants.
const SAMPLES_MAX: usize = 2_000_000;
const SAMPLES_COLUMNS: [&str; 9] =
    ["t_s", "robot", "x_m", "y_m", "heading_rad", "v_m_s", "w_rad_s", "error_m", "alive"];
/// Behind these; in a run of an earlier version there is none.
const IDEAL_COLUMN: &str = "ideal_error_m";
const EVENTS_COLUMNS: [&str; 4] = ["t_s", "kind", "robot", "detail"];

/// What `samples.csv` holds.
pub(super) struct Record {
    pub(super) times_s: Vec<f64>,
    pub(super) tracks: Vec<Vec<Sample>>,
    pub(super) every: usize,
}

/// A table that begins with known columns, in their order; later versions may append others.
struct Lines<'a> {
    path: &'a Path,
    reader: csv::Reader<&'a [u8]>,
    record: ByteRecord,
    /// All that there are.
    columns: Vec<String>,
}

impl<'a> Lines<'a> {
    fn new(path: &'a Path, text: &'a [u8], columns: &[&str]) -> Result<Lines<'a>, ReportError> {
        // Whatever follows the last line's end was being written when the run was killed.
        let whole = text.iter().rposition(|&byte| byte == b'\n').map_or(0, |place| place + 1);
        let mut reader = ReaderBuilder::new().flexible(true).from_reader(&text[..whole]);
        let name = |name: &[u8]| String::from_utf8_lossy(name).into_owned();
        let found = reader.byte_headers().map(|found| found.iter().map(name).collect::<Vec<_>>());
        let sound = |found: &Vec<String>| {
            found.is_empty()
                || found.iter().zip(columns).filter(|(a, b)| a == b).count() == columns.len()
        };
        let Some(found) = found.ok().filter(sound) else {
            let what = format!("has other columns, expected {}", columns.join(","));
            return Err(ReportError::Broken { path: path.into(), line: 1, what });
        };
        Ok(Lines { path, reader, record: ByteRecord::new(), columns: found })
    }

    /// Goes on to the next line; `false` at the end.
    fn next(&mut self) -> Result<bool, ReportError> {
        let read = self.reader.read_byte_record(&mut self.record);
        if !read.map_err(|error| self.broken(error.to_string()))? {
            return Ok(false);
        }
        let (found, expected) = (self.record.len(), self.columns.len());
        if found == expected {
            return Ok(true);
        }
        Err(self.broken(format!("has {found} fields, expected {expected}")))
    }

    fn word(&self, column: usize) -> Result<&str, ReportError> {
        let field = &self.record[column];
        std::str::from_utf8(field)
            .map_err(|_| self.broken(format!("{:?} is no text", String::from_utf8_lossy(field))))
    }

    fn number(&self, column: usize) -> Result<f64, ReportError> {
        let word = self.word(column)?;
        word.parse().map_err(|_| self.broken(format!("{word:?} is no number")))
    }

    /// Where a column is that may be missing.
    fn column(&self, name: &str) -> Option<usize> {
        self.columns.iter().position(|known| known == name)
    }

    /// A number, if the column is there and not empty.
    fn maybe_number(&self, column: Option<usize>) -> Result<Option<f64>, ReportError> {
        let filled = column.filter(|&column| !self.record[column].is_empty());
        filled.map(|column| self.number(column)).transpose()
    }

    fn broken(&self, what: String) -> ReportError {
        let line = self.record.position().map_or(0, csv::Position::line);
        ReportError::Broken { path: self.path.into(), line, what }
    }
}

/// Where a robot was sent from outside.
pub(super) struct SentTo {
    t_s: f64,
    robot: usize,
    goal: Vec2,
}

/// Reads `events.csv`: where robots were sent from outside, in order of time.
pub(super) fn goals(path: &Path, scenario: &Scenario) -> Result<Vec<SentTo>, ReportError> {
    let Some(text) = text(path)? else { return Ok(Vec::new()) };
    let mut sent = Vec::new();
    let mut lines = Lines::new(path, &text, &EVENTS_COLUMNS)?;
    while lines.next()? {
        if lines.word(1)? != goals::EVENT {
            continue;
        }
        let (t_s, name) = (lines.number(0)?, lines.word(2)?);
        let robot = scenario.robots.iter().position(|robot| robot.name == name);
        let place_m = goals::place_m(lines.word(3)?);
        sent.extend(robot.zip(place_m).map(|(robot, m)| SentTo { t_s, robot, goal: m.into() }));
    }
    sent.sort_by(|a, b| a.t_s.total_cmp(&b.t_s));
    Ok(sent)
}

/// Reads `samples.csv`; without the file, nothing was recorded.
pub(super) fn record(
    path: &Path,
    scenario: &Scenario,
    faults: &[SceneFault],
    goals: &[SentTo],
) -> Result<Record, ReportError> {
    let robots = scenario.robots.len();
    let mut record = Record { times_s: Vec::new(), tracks: vec![Vec::new(); robots], every: 1 };
    let Some(text) = text(path)? else { return Ok(record) };
    let samples = text.iter().filter(|&&byte| byte == b'\n').count();
    record.every = samples.div_ceil(SAMPLES_MAX).max(1);
    let place: HashMap<&str, usize> =
        scenario.robots.iter().enumerate().map(|(i, robot)| (robot.name.as_str(), i)).collect();
    let mut errors = ErrorVectors::new(scenario, silences(scenario, faults));
    let mut goals = goals.iter().peekable();
    let mut lines = Lines::new(path, &text, &SAMPLES_COLUMNS)?;
    let ideal = lines.column(IDEAL_COLUMN);
    let mut instant: Vec<Option<Sample>> = vec![None; robots];
    let (mut missing, mut number) = (robots, 0usize);
    let mut instant_s = f64::NAN;
    let mut t_word = Vec::new();
    let last = samples.saturating_sub(robots) as u64 + 1;
    while lines.next()? {
        let begins = missing == robots;
        if begins {
            t_word.clear();
            t_word.extend_from_slice(&lines.record[0]);
            instant_s = lines.number(0)?;
            if !instant_s.is_finite() || record.times_s.last().is_some_and(|&t_s| t_s > instant_s) {
                return Err(lines.broken(format!("{instant_s} is no later time")));
            }
        } else if lines.record[0] != t_word[..] {
            return Err(lines.broken(format!("begins an instant; {missing} robots still miss one")));
        }
        let name = lines.word(1)?;
        let Some(&robot) = place.get(name) else {
            return Err(lines.broken(format!("{name:?} is no robot of scenario.toml")));
        };
        let sample = Sample {
            x_m: lines.number(2)?,
            y_m: lines.number(3)?,
            heading_rad: lines.number(4)?,
            error_m: lines.maybe_number(Some(7))?,
            ideal_error_m: lines.maybe_number(ideal)?,
            error_xy_m: None,
            alive: &lines.record[8] == b"1",
        };
        if instant[robot].replace(sample).is_some() {
            return Err(lines.broken(format!("{name:?} is here twice at one time")));
        }
        missing -= 1;
        if missing > 0 {
            continue;
        }
        let line = lines.record.position().map_or(0, csv::Position::line);
        while let Some(sent) = goals.next_if(|sent| sent.t_s <= instant_s) {
            errors.send(sent.robot, sent.goal);
        }
        if number.is_multiple_of(record.every) || line > last {
            let whole = || instant.iter().flatten();
            let pose = |at: &Sample| Pose { x_m: at.x_m, y_m: at.y_m, heading_rad: at.heading_rad };
            let poses: Vec<Pose> = whole().map(pose).collect();
            for ((track, sample), error) in
                record.tracks.iter_mut().zip(whole()).zip(errors.at(instant_s, &poses))
            {
                // Who was silent at that very moment is not known to the tick: where the error
                // is not the one that was measured, it is another one.
                let same = |error: &Vec2| {
                    let measured = sample.error_m.unwrap_or(f64::NAN);
                    (error.norm() - measured).abs() <= 1e-9 * measured.max(1.0)
                };
                let error_xy_m = error.filter(same).map(|error| [error.x, error.y]);
                track.push(Sample { error_xy_m, ..*sample });
            }
            record.times_s.push(instant_s);
        }
        number += 1;
        missing = robots;
        instant.fill(None);
    }
    Ok(record)
}

/// Who and what was silent, and when.
fn silences(scenario: &Scenario, faults: &[SceneFault]) -> Vec<Silence> {
    let planned: HashMap<String, Silenced> = scenario
        .faults
        .iter()
        .map(|fault| fault.kind.struck(scenario))
        .map(|(what, struck)| (what, struck.silenced))
        .collect();
    let silence = |fault: &SceneFault| {
        // What nobody had planned is a cut by hand, or a death.
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

/// Reads `events.csv`: what became of robots and edges, in order of time.
pub(super) fn changes(path: &Path, scene: &Scene) -> Result<Vec<Change>, ReportError> {
    let Some(text) = text(path)? else { return Ok(Vec::new()) };
    let robots = scene.robots.iter().enumerate();
    let place: HashMap<&str, usize> = robots.map(|(i, robot)| (robot.name.as_str(), i)).collect();
    let edges = scene.edges.iter().enumerate();
    let edge: HashMap<(usize, usize), usize> =
        edges.map(|(i, edge)| ((edge.from, edge.to), i)).collect();
    let mut changes = Vec::new();
    let mut lines = Lines::new(path, &text, &EVENTS_COLUMNS)?;
    while lines.next()? {
        let t_s = lines.number(0)?;
        let Some(&robot) = place.get(lines.word(2)?) else { continue };
        let detail = lines.word(3)?;
        let to = match lines.word(1)? {
            "kill" | "died" => ChangedTo::Robot(robot, RobotState::Dead),
            "restart" => ChangedTo::Robot(robot, RobotState::Starting),
            "ready" | "thaw" | "led" => ChangedTo::Robot(robot, RobotState::Moving),
            "orphaned" => ChangedTo::Robot(robot, RobotState::Orphaned),
            "freeze" if detail.starts_with("SIGSTOP") => {
                ChangedTo::Robot(robot, RobotState::Frozen)
            }
            "contact" => {
                let words = detail.split_once(' ');
                let known = words.and_then(|(word, heard)| {
                    let edge = *edge.get(&(*place.get(heard)?, robot))?;
                    Some(ChangedTo::Edge(edge, edge_state(word)?))
                });
                let Some(known) = known else { continue };
                known
            }
            _ => continue,
        };
        changes.push(Change { t_s, to });
    }
    // A contact is told with the time at which it began.
    changes.sort_by(|a, b| a.t_s.total_cmp(&b.t_s));
    Ok(changes)
}
