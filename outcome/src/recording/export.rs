//! A recording as tables: tidy CSV in long form, one file for each kind of observation, units in the
//! column names, the same run time as in `samples.csv`.
//!
//! | file | columns |
//! |---|---|
//! | `poses.csv` | `t_s,robot,x_m,y_m,heading_rad` |
//! | `commands.csv` | `t_s,robot,v_m_s,w_rad_s` |
//! | `errors.csv` | `t_s,robot,error_m,alive,ideal_error_m`; no error where the robot has no place to be at |
//! | `distances.csv` | `t_s,robot_a,robot_b,min_distance_m`: the nearest two |
//! | `events.csv` | `t_s,kind,robot,level,detail`; no robot where it is the whole run's |
//!
//! Positions and velocities are the run's bit by bit; a heading went through a quaternion and may
//! differ in its last digit.

use std::collections::HashMap;
use std::fs::{self, File};
use std::io;
use std::path::{Path, PathBuf};

use experiment::campaign::cells::sha256;
use formation::pose::{Pose, Twist};
use formation::seconds;
use mcap::records::{Metadata, Record};
use protocol::regular_file::{self, Links};
use protocol::ros2::messages::{read_pose_stamped, read_twist};
use serde::Serialize;

use crate::recording::messages::{read_log, read_metrics};
use crate::recording::pieces::{Pieces, Soundness};
use crate::recording::recorder::{EPOCH, FACTS, ROBOTS, SUPERVISOR, TOPICS};
use crate::results::checksums::{CHECKSUMS, listed_beside};

/// What was exported.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Exported {
    /// Each table with its number of rows.
    pub tables: Vec<(&'static str, u64)>,
    /// How far the recording was whole; the tables hold what there is.
    pub soundness: Soundness,
}

/// Why there is no export, or only a part of it.
#[derive(Debug, thiserror::Error)]
pub enum ExportError {
    /// It would overwrite something.
    #[error("{} exists already; an export never overwrites, give --out a new name", .0.display())]
    Exists(PathBuf),
    /// The recording cannot be read.
    #[error("cannot read {}: {}", .0.display(), .1)]
    Read(PathBuf, io::Error),
    /// It does not say what run it is of.
    #[error(
        "{} is no recording of a run: expected an MCAP file with metadata called \"{FACTS}\", \
         in it {EPOCH}, {ROBOTS} and {TOPICS}", .0.display()
    )]
    Foreign(PathBuf),
    /// Something of it is lost or changed.
    #[error(
        "{} is damaged, and nothing is exported: {}. `phalanx recover` writes what is whole into a new file; \
         --allow-damage exports that at once", .0.display(), .1
    )]
    Damaged(PathBuf, Soundness),
    /// It is whole, and not the recording that its run wrote.
    #[error(
        "{} is not the recording that its run wrote: its SHA-256 is {found}, and {CHECKSUMS} lists {listed}. Nothing is \
         exported; put the run's own recording there, or export it all the same with --allow-damage", .file.display()
    )]
    Another {
        /// The recording.
        file: PathBuf,
        /// SHA-256 of the file.
        found: String,
        /// SHA-256 that the run wrote down.
        listed: String,
    },
    /// A message is not what its channel says: in which file, on which topic, and its run time, s.
    #[error("{}: a message on {} at {} s is not what its type says", .0.display(), .1, .2)]
    Message(PathBuf, String, f64),
    /// A table could not be written.
    #[error("cannot write {}: {}; what was written before is kept", .0.display(), .1)]
    Write(PathBuf, io::Error),
}

/// Writes the tables of the recording `file` into the new directory `out`: of one that is damaged only if that is
/// allowed, and then what is whole in it.
pub fn export(file: &Path, out: &Path, allow_damage: bool) -> Result<Exported, ExportError> {
    let unreadable = |error| ExportError::Read(file.into(), error);
    let mut pieces = Pieces::open(file).map_err(unreadable)?;
    let run = loop {
        match pieces.next().transpose().map_err(unreadable)? {
            Some(Record::Metadata(facts)) if facts.name == FACTS => break Run::of(&facts),
            Some(_) => {}
            None => break None,
        }
    };
    let run = run.ok_or_else(|| ExportError::Foreign(file.into()))?;
    let soundness = soundness(file).map_err(unreadable)?;
    if !soundness.is_whole() && !allow_damage {
        return Err(ExportError::Damaged(file.into(), soundness));
    }
    if !allow_damage && let Some((found, listed)) = is_another(file).map_err(unreadable)? {
        return Err(ExportError::Another { file: file.into(), found, listed });
    }
    fs::create_dir(out).map_err(|error| match error.kind() {
        io::ErrorKind::AlreadyExists => ExportError::Exists(out.into()),
        _ => ExportError::Write(out.into(), error),
    })?;
    let tables = TABLES.map(|(name, columns)| Table::create(out, name, columns));
    let tables = tables.into_iter().collect::<Result<Vec<_>, _>>()?;
    let filled = fill(tables, pieces, &run, file);
    if matches!(filled, Err(ExportError::Message(..))) {
        // Half of it would be taken for all.
        let _ = fs::remove_dir_all(out);
    }
    Ok(Exported { tables: filled?, soundness })
}

/// Writes the messages of these pieces into the tables; what these are called, and how many rows each has.
fn fill(
    mut tables: Vec<Table>,
    pieces: Pieces,
    run: &Run,
    file: &Path,
) -> Result<Vec<(&'static str, u64)>, ExportError> {
    let unreadable = |error| ExportError::Read(file.into(), error);
    let mut channels = HashMap::new();
    for piece in pieces {
        match piece.map_err(unreadable)? {
            Record::Channel(channel) => {
                let kind = run.observation(&channel.topic);
                channels.insert(channel.id, (channel.topic, kind));
            }
            Record::Message { header, data } => {
                let Some((topic, Some(kind))) = channels.get(&header.channel_id) else { continue };
                let t_s = seconds(header.log_time.saturating_sub(run.started_unix_ns));
                let is_taken = run.take(&mut tables, *kind, t_s, &data)?;
                is_taken.ok_or_else(|| ExportError::Message(file.into(), topic.clone(), t_s))?;
            }
            _ => {}
        }
    }
    tables.into_iter().map(Table::finish).collect()
}

/// Returns the SHA-256 of a recording and that which its run wrote down, if these differ.
fn is_another(file: &Path) -> io::Result<Option<(String, String)>> {
    let Some(listed) = listed_beside(file) else { return Ok(None) };
    let found = sha256(regular_file::open(file, Links::Followed)?)?;
    Ok((found != listed).then_some((found, listed)))
}

/// How far a file is whole: all of it is read.
fn soundness(file: &Path) -> io::Result<Soundness> {
    let mut pieces = Pieces::open(file)?;
    pieces.by_ref().try_for_each(|piece| piece.map(drop))?;
    Ok(pieces.soundness())
}

/// What the recording says of its run.
struct Run {
    started_unix_ns: u64,
    robots: Vec<String>,
    topics: Vec<String>,
}

/// What a topic observes, of which robot.
#[derive(Clone, Copy)]
enum Observation {
    Pose(usize),
    Command(usize),
    Metrics,
    Event,
}

impl Run {
    fn of(facts: &Metadata) -> Option<Run> {
        let list = |key: &str| -> Option<Vec<String>> {
            Some(facts.metadata.get(key)?.split(',').map(str::to_owned).collect())
        };
        let started_unix_ns = facts.metadata.get(EPOCH)?.parse().ok()?;
        let (robots, topics) = (list(ROBOTS)?, list(TOPICS)?);
        (robots.len() == topics.len()).then_some(Run { started_unix_ns, robots, topics })
    }

    fn observation(&self, topic: &str) -> Option<Observation> {
        match topic {
            "/metrics" => Some(Observation::Metrics),
            "/rosout" => Some(Observation::Event),
            _ => {
                let (robot, what) = topic.strip_prefix('/')?.split_once('/')?;
                let robot = self.topics.iter().position(|known| known == robot)?;
                match what {
                    "pose" => Some(Observation::Pose(robot)),
                    "cmd_vel" => Some(Observation::Command(robot)),
                    _ => None,
                }
            }
        }
    }

    /// Takes one message into its table; `None` if it is not of its type.
    fn take(
        &self,
        tables: &mut [Table],
        kind: Observation,
        t_s: f64,
        message: &[u8],
    ) -> Result<Option<()>, ExportError> {
        let [poses, commands, errors, distances, events] = tables else {
            unreachable!("as many as TABLES")
        };
        match kind {
            Observation::Pose(robot) => {
                let Some(place) = read_pose_stamped(message) else { return Ok(None) };
                let Pose { x_m, y_m, heading_rad } = place.pose();
                poses.row((t_s, &self.robots[robot], x_m, y_m, heading_rad))?;
            }
            Observation::Command(robot) => {
                let Some(Twist { v_m_s, w_rad_s }) = read_twist(message) else { return Ok(None) };
                commands.row((t_s, &self.robots[robot], v_m_s, w_rad_s))?;
            }
            Observation::Metrics => {
                let Some(metrics) = read_metrics(message) else { return Ok(None) };
                let robots = metrics.robots.iter().zip(&metrics.errors_m).zip(&metrics.alive);
                for (i, ((robot, error_m), alive)) in robots.enumerate() {
                    let ideal_m = metrics.ideal_errors_m.get(i).copied().flatten();
                    errors.row((t_s, robot, error_m, u8::from(*alive), ideal_m))?;
                }
                if let Some((distance_m, [a, b])) = metrics.nearest {
                    let name = |place: usize| metrics.robots.get(place);
                    let (Some(a), Some(b)) = (name(a), name(b)) else { return Ok(None) };
                    distances.row((t_s, a, b, distance_m))?;
                }
            }
            Observation::Event => {
                let Some(event) = read_log(message) else { return Ok(None) };
                let robot = if event.name == SUPERVISOR { "" } else { event.name };
                let detail = event.text.strip_prefix(event.kind).unwrap_or(event.text);
                let detail = detail.strip_prefix(": ").unwrap_or(detail);
                events.row((t_s, event.kind, robot, event.level, detail))?;
            }
        }
        Ok(Some(()))
    }
}

/// Each table, and its columns as they are in the file.
const TABLES: [(&str, &str); 5] = [
    ("poses.csv", "t_s,robot,x_m,y_m,heading_rad"),
    ("commands.csv", "t_s,robot,v_m_s,w_rad_s"),
    ("errors.csv", "t_s,robot,error_m,alive,ideal_error_m"),
    ("distances.csv", "t_s,robot_a,robot_b,min_distance_m"),
    ("events.csv", "t_s,kind,robot,level,detail"),
];

/// One table under way.
struct Table {
    name: &'static str,
    path: PathBuf,
    rows: u64,
    writer: csv::Writer<File>,
}

impl Table {
    fn create(out: &Path, name: &'static str, columns: &str) -> Result<Table, ExportError> {
        let path = out.join(name);
        let file =
            File::create_new(&path).map_err(|error| ExportError::Write(path.clone(), error))?;
        let writer = csv::WriterBuilder::new().has_headers(false).from_writer(file);
        let mut table = Table { name, path, rows: 0, writer };
        // Here, not with the first row: a table without rows has columns all the same.
        let written = table.writer.write_record(columns.split(','));
        written.map_err(|error| table.failed(error.into()))?;
        Ok(table)
    }

    fn row(&mut self, row: impl Serialize) -> Result<(), ExportError> {
        self.rows += 1;
        let written = self.writer.serialize(row);
        written.map_err(|error| self.failed(error.into()))
    }

    fn finish(mut self) -> Result<(&'static str, u64), ExportError> {
        self.writer.flush().map_err(|error| self.failed(error))?;
        Ok((self.name, self.rows))
    }

    fn failed(&self, error: io::Error) -> ExportError {
        ExportError::Write(self.path.clone(), error)
    }
}
