//! Export of a recording as tables: CSV in long form, one file for each kind of observation, units in the column
//! names, the same run time as in `samples.csv`.
//!
//! Positions and velocities equal those of the run bit by bit. Headings were converted to quaternions and may
//! differ in the last digit.

use std::collections::HashMap;
use std::fs::{self, File};
use std::io;
use std::marker::PhantomData;
use std::path::{Path, PathBuf};

use experiment::campaign::cells::sha256;
use formation::pose::{Pose, Twist};
use formation::seconds;
use mcap::records::{Metadata, Record};
use protocol::regular_file::{self, Links};
use protocol::ros2::messages::{read_pose_stamped, read_twist};
use serde::Serialize;

use crate::columns::{Table, Value, table};
use crate::recording::messages::{read_log, read_metrics, read_signals};
use crate::recording::record_reader::{Integrity, RecordReader};
use crate::recording::recorder::{EPOCH, FACTS, ROBOTS, SIGNALS_TOPIC, SUPERVISOR, TOPICS};
use crate::results::files::checksums::{CHECKSUMS, listed_checksum_next_to};
use crate::results::tables::{SampleLine, SignalLine};

/// Result of an export.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Exported {
    /// Name of each table and its number of rows.
    pub tables: Vec<(&'static str, u64)>,
    /// Integrity of the recording. The tables hold all valid data.
    pub integrity: Integrity,
}

/// Reason why there is no export, or only a part of it.
#[derive(Debug, thiserror::Error)]
pub enum ExportError {
    /// The output directory exists.
    #[error("{} exists already; an export never overwrites, choose a new name with --out", .0.display())]
    Exists(PathBuf),
    /// The recording cannot be read.
    #[error("cannot read {}: {}", .0.display(), .1)]
    Read(PathBuf, io::Error),
    /// The recording does not identify its run.
    #[error(
        "{} is no recording of a run: expected an MCAP file with metadata named \"{FACTS}\" \
         that contain {EPOCH}, {ROBOTS} and {TOPICS}", .0.display()
    )]
    Foreign(PathBuf),
    /// Data is lost or changed.
    #[error(
        "{} is damaged, and nothing is exported: {}. `phalanx recover` writes the valid part into a new file; \
         --allow-damage exports it directly", .0.display(), .1
    )]
    Damaged(PathBuf, Integrity),
    /// The recording is complete, but its run wrote another.
    #[error(
        "{} is not the recording that its run wrote: its SHA-256 is {found}, but {CHECKSUMS} lists {listed}. Nothing is \
         exported; restore the run's own recording, or export this one with --allow-damage", .file.display()
    )]
    Another {
        /// Path of the recording.
        file: PathBuf,
        /// SHA-256 of the file.
        found: String,
        /// SHA-256 that the run recorded.
        listed: String,
    },
    /// A message does not have the type of its channel: file, topic, and run time, s.
    #[error("{}: a message on {} at {} s does not have the type of its channel", .0.display(), .1, .2)]
    Message(PathBuf, String, f64),
    /// A table could not be written.
    #[error("cannot write {}: {}; what was written before is kept", .0.display(), .1)]
    Write(PathBuf, io::Error),
}

/// Writes the tables of the recording `file` into the new directory `out`. A damaged recording is exported only
/// with `allow_damage`, and its tables then hold the valid data.
pub fn export(file: &Path, out: &Path, allow_damage: bool) -> Result<Exported, ExportError> {
    let unreadable = |error| ExportError::Read(file.into(), error);
    let mut pieces = RecordReader::open(file).map_err(unreadable)?;
    let run = loop {
        match pieces.next().transpose().map_err(unreadable)? {
            Some(Record::Metadata(facts)) if facts.name == FACTS => {
                break RecordedRun::from_metadata(&facts);
            }
            Some(_) => {}
            None => break None,
        }
    };
    let run = run.ok_or_else(|| ExportError::Foreign(file.into()))?;
    let integrity = integrity(file).map_err(unreadable)?;
    if !integrity.is_complete() && !allow_damage {
        return Err(ExportError::Damaged(file.into(), integrity));
    }
    if !allow_damage && let Some((found, listed)) = checksum_difference(file).map_err(unreadable)? {
        return Err(ExportError::Another { file: file.into(), found, listed });
    }
    fs::create_dir(out).map_err(|error| match error.kind() {
        io::ErrorKind::AlreadyExists => ExportError::Exists(out.into()),
        _ => ExportError::Write(out.into(), error),
    })?;
    let filled = fill(Tables::create(out)?, pieces, &run, file);
    if matches!(filled, Err(ExportError::Message(..))) {
        // Partial tables could be taken for complete ones.
        let _ = fs::remove_dir_all(out);
    }
    Ok(Exported { tables: filled?, integrity })
}

/// Writes the messages into the tables. Returns the name and the number of rows of each table.
fn fill(
    mut tables: Tables,
    pieces: RecordReader,
    run: &RecordedRun,
    file: &Path,
) -> Result<Vec<(&'static str, u64)>, ExportError> {
    let unreadable = |error| ExportError::Read(file.into(), error);
    let mut channels = HashMap::new();
    for piece in pieces {
        match piece.map_err(unreadable)? {
            Record::Channel(channel) => {
                let kind = run.observation(&channel.topic);
                if let Some(Observation::Signals(_)) = kind {
                    tables.open_signals()?;
                }
                channels.insert(channel.id, (channel.topic, kind));
            }
            Record::Message { header, data } => {
                let Some((topic, Some(kind))) = channels.get(&header.channel_id) else { continue };
                let t_s = seconds(header.log_time.saturating_sub(run.started_unix_ns));
                let is_taken = run.write_message(&mut tables, *kind, t_s, &data)?;
                is_taken.ok_or_else(|| ExportError::Message(file.into(), topic.clone(), t_s))?;
            }
            _ => {}
        }
    }
    tables.finish()
}

/// Returns the SHA-256 of a recording and the SHA-256 in the list of its run, if they differ.
fn checksum_difference(file: &Path) -> io::Result<Option<(String, String)>> {
    let Some(listed) = listed_checksum_next_to(file) else { return Ok(None) };
    let found = sha256(regular_file::open(file, Links::Followed)?)?;
    Ok((found != listed).then_some((found, listed)))
}

/// Reads the complete file and returns its integrity.
fn integrity(file: &Path) -> io::Result<Integrity> {
    let mut pieces = RecordReader::open(file)?;
    pieces.by_ref().try_for_each(|piece| piece.map(drop))?;
    Ok(pieces.integrity())
}

/// Identity of the recorded run.
struct RecordedRun {
    started_unix_ns: u64,
    robots: Vec<String>,
    topics: Vec<String>,
}

/// Kind of observation of a topic, with the robot's index.
#[derive(Clone, Copy)]
enum Observation {
    Pose(usize),
    Command(usize),
    Metrics,
    Event,
    Signals(usize),
}

impl RecordedRun {
    fn from_metadata(facts: &Metadata) -> Option<RecordedRun> {
        let list = |key: &str| -> Option<Vec<String>> {
            Some(facts.metadata.get(key)?.split(',').map(str::to_owned).collect())
        };
        let started_unix_ns = facts.metadata.get(EPOCH)?.parse().ok()?;
        let (robots, topics) = (list(ROBOTS)?, list(TOPICS)?);
        (robots.len() == topics.len()).then_some(RecordedRun { started_unix_ns, robots, topics })
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
                    SIGNALS_TOPIC => Some(Observation::Signals(robot)),
                    _ => None,
                }
            }
        }
    }

    /// Writes one message into its table. Returns `None` if the message does not have the type of its channel.
    fn write_message(
        &self,
        tables: &mut Tables,
        kind: Observation,
        t_s: f64,
        message: &[u8],
    ) -> Result<Option<()>, ExportError> {
        let name = |robot: usize| self.robots[robot].clone();
        match kind {
            Observation::Pose(robot) => {
                let Some(place) = read_pose_stamped(message) else { return Ok(None) };
                let Pose { x_m, y_m, heading_rad } = place.pose();
                let robot = name(robot);
                tables.poses.row(PoseLine { t_s, robot, x_m, y_m, heading_rad })?;
            }
            Observation::Command(robot) => {
                let Some(Twist { v_m_s, side_m_s, w_rad_s }) = read_twist(message) else {
                    return Ok(None);
                };
                tables.commands.row(CommandLine {
                    t_s,
                    robot: name(robot),
                    v_m_s,
                    w_rad_s,
                    side_m_s,
                })?;
            }
            Observation::Signals(robot) => {
                let Some(signals) = read_signals(message) else { return Ok(None) };
                for (stamp_ns, signal, value) in signals {
                    let t_s = seconds(stamp_ns.saturating_sub(self.started_unix_ns));
                    let (robot, signal) = (name(robot), signal.to_owned());
                    let row = SignalLine { t_s, robot, signal, value };
                    tables.signals.as_mut().map_or(Ok(()), |table| table.row(row))?;
                }
            }
            Observation::Metrics => {
                let Some(metrics) = read_metrics(message) else { return Ok(None) };
                for (i, robot) in metrics.robots.iter().enumerate() {
                    let unknown = Value::Number(None);
                    let values = metrics.columns.iter();
                    let values = values.map(|column| column.get(i).copied().unwrap_or(unknown));
                    let robot = (*robot).to_owned();
                    tables.errors.row(ErrorLine(t_s, robot, values.collect()))?;
                }
                if let Some((min_distance_m, [a, b])) = metrics.nearest {
                    let name = |place: usize| Some((*metrics.robots.get(place)?).to_owned());
                    let (Some(robot_a), Some(robot_b)) = (name(a), name(b)) else {
                        return Ok(None);
                    };
                    tables.distances.row(DistanceLine { t_s, robot_a, robot_b, min_distance_m })?;
                }
            }
            Observation::Event => {
                let Some(event) = read_log(message) else { return Ok(None) };
                let robot = if event.name == SUPERVISOR { "" } else { event.name };
                let detail = event.text.strip_prefix(event.kind).unwrap_or(event.text);
                let detail = detail.strip_prefix(": ").unwrap_or(detail);
                let [kind, robot, detail] = [event.kind, robot, detail].map(str::to_owned);
                let level = event.level.into();
                tables.events.row(LogLine { t_s, kind, robot, level, detail })?;
            }
        }
        Ok(Some(()))
    }
}

table! {
    /// Line of `poses.csv`.
    #[derive(Serialize)]
    struct PoseLine in "poses.csv" {
        /// Time since the start of the run, s.
        pub t_s: f64,
        /// Name of the robot.
        pub robot: String,
        /// True x of the midpoint of the axle, m.
        pub x_m: f64,
        /// True y of the midpoint of the axle, m.
        pub y_m: f64,
        /// True heading, rad.
        pub heading_rad: f64,
    }
}

table! {
    /// Line of `commands.csv`.
    #[derive(Serialize)]
    struct CommandLine in "commands.csv" {
        /// Time since the start of the run, s.
        pub t_s: f64,
        /// Name of the robot.
        pub robot: String,
        /// Longitudinal speed, m/s.
        pub v_m_s: f64,
        /// Turn rate, rad/s.
        pub w_rad_s: f64,
        /// Lateral speed, m/s, to the left.
        pub side_m_s: f64,
    }
}

table! {
    /// Line of `distances.csv`: the nearest two robots.
    #[derive(Serialize)]
    struct DistanceLine in "distances.csv" {
        /// Time since the start of the run, s.
        pub t_s: f64,
        /// Name of the first robot.
        pub robot_a: String,
        /// Name of the second robot.
        pub robot_b: String,
        /// Distance of their front points, m.
        pub min_distance_m: f64,
    }
}

table! {
    /// Line of the exported `events.csv`.
    #[derive(Serialize)]
    struct LogLine in "events.csv" {
        /// Time since the start of the run, s.
        pub t_s: f64,
        /// Kind of the event.
        pub kind: String,
        /// Name of the robot; empty for an event of the whole run.
        pub robot: String,
        /// Level of ROS 2 logs: 20 information, 30 warning, 40 error.
        pub level: u64,
        /// Description as text.
        pub detail: String,
    }
}

/// Line of [`ERRORS`]: time, s, name of the robot, and the recorded columns of `samples.csv`.
#[derive(Serialize)]
struct ErrorLine(f64, String, Vec<Value<'static>>);

/// Name of the table of the recorded columns of `samples.csv`.
const ERRORS: &str = "errors.csv";

/// Returns the names of the columns of a table.
fn column_names<L: Table>() -> Vec<&'static str> {
    L::COLUMNS.iter().map(|column| column.name).collect()
}

/// Returns the names of the columns of [`ERRORS`].
fn error_columns() -> Vec<&'static str> {
    ["t_s", "robot"]
        .into_iter()
        .chain(SampleLine::recorded_columns().map(|column| column.name))
        .collect()
}

/// Returns the exported tables and their columns for the reference page, in Markdown.
pub fn reference() -> String {
    let tables = [
        (PoseLine::FILE, column_names::<PoseLine>()),
        (CommandLine::FILE, column_names::<CommandLine>()),
        (ERRORS, error_columns()),
        (DistanceLine::FILE, column_names::<DistanceLine>()),
        (LogLine::FILE, column_names::<LogLine>()),
        (SignalLine::FILE, column_names::<SignalLine>()),
    ];
    let row =
        |(file, names): (&str, Vec<&str>)| format!("| `{file}` | `{}` |\n", names.join("`, `"));
    format!("| file | columns |\n|---|---|\n{}", tables.map(row).concat())
}

/// Tables of an export in progress.
struct Tables {
    poses: TableWriter<PoseLine>,
    commands: TableWriter<CommandLine>,
    errors: TableWriter<ErrorLine>,
    distances: TableWriter<DistanceLine>,
    events: TableWriter<LogLine>,
    /// Table of the laws' signals; `None` without a channel for them.
    signals: Option<TableWriter<SignalLine>>,
    out: PathBuf,
}

impl Tables {
    fn create(out: &Path) -> Result<Tables, ExportError> {
        Ok(Tables {
            poses: TableWriter::create(out)?,
            commands: TableWriter::create(out)?,
            errors: TableWriter::create_with(out, ERRORS, &error_columns())?,
            distances: TableWriter::create(out)?,
            events: TableWriter::create(out)?,
            signals: None,
            out: out.to_owned(),
        })
    }

    /// Creates the table of signals unless it exists.
    fn open_signals(&mut self) -> Result<(), ExportError> {
        if self.signals.is_none() {
            self.signals = Some(TableWriter::create(&self.out)?);
        }
        Ok(())
    }

    /// Completes all files. Returns the name and the number of rows of each table.
    fn finish(self) -> Result<Vec<(&'static str, u64)>, ExportError> {
        let Tables { poses, commands, errors, distances, events, signals, out: _ } = self;
        let mut tables = vec![
            poses.finish()?,
            commands.finish()?,
            errors.finish()?,
            distances.finish()?,
            events.finish()?,
        ];
        if let Some(signals) = signals {
            tables.push(signals.finish()?);
        }
        Ok(tables)
    }
}

/// A table in progress, with lines of type `L`.
struct TableWriter<L> {
    name: &'static str,
    path: PathBuf,
    rows: u64,
    writer: csv::Writer<File>,
    line: PhantomData<L>,
}

impl<L: Table> TableWriter<L> {
    fn create(out: &Path) -> Result<TableWriter<L>, ExportError> {
        TableWriter::create_with(out, L::FILE, &column_names::<L>())
    }
}

impl<L> TableWriter<L> {
    fn create_with(
        out: &Path,
        name: &'static str,
        columns: &[&str],
    ) -> Result<TableWriter<L>, ExportError> {
        let path = out.join(name);
        let file =
            File::create_new(&path).map_err(|error| ExportError::Write(path.clone(), error))?;
        let writer = csv::WriterBuilder::new().has_headers(false).from_writer(file);
        let mut table = TableWriter { name, path, rows: 0, writer, line: PhantomData };
        // Written here, so that a table without rows has a header too.
        let written = table.writer.write_record(columns);
        written.map_err(|error| table.export_error(error.into()))?;
        Ok(table)
    }

    fn row(&mut self, row: L) -> Result<(), ExportError>
    where
        L: Serialize,
    {
        self.rows += 1;
        let written = self.writer.serialize(row);
        written.map_err(|error| self.export_error(error.into()))
    }

    fn finish(mut self) -> Result<(&'static str, u64), ExportError> {
        self.writer.flush().map_err(|error| self.export_error(error))?;
        Ok((self.name, self.rows))
    }

    fn export_error(&self, error: io::Error) -> ExportError {
        ExportError::Write(self.path.clone(), error)
    }
}
