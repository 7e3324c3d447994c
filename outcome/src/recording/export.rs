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
use formation::ns_to_seconds;
use formation::pose::{Pose, Twist};
use mcap::records::{Metadata, Record};
use protocol::regular_file::{self, SymlinkPolicy};
use protocol::ros2::messages::{read_pose_stamped, read_twist};
use serde::Serialize;

use crate::columns::{ColumnValue, Table, table};
use crate::recording::messages::{
    LawMessage, read_law_message, read_log, read_metrics, read_signals,
};
use crate::recording::record_reader::{Integrity, RecordReader};
use crate::recording::recorder::{
    EPOCH_KEY, LawTopic, METADATA_NAME, ROBOTS_KEY, SUPERVISOR_NAME, TOPICS_KEY,
};
use crate::results::files::checksums::{CHECKSUMS_FILE, read_listed_checksum_next_to};
use crate::results::tables::{MessageLine, SampleLine, SignalLine};

/// Result of an export.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct ExportResult {
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
        "{} is no recording of a run: expected an MCAP file with metadata named \"{METADATA_NAME}\" \
         that contain {EPOCH_KEY}, {ROBOTS_KEY} and {TOPICS_KEY}", .0.display()
    )]
    NotARecording(PathBuf),
    /// Data is lost or changed.
    #[error(
        "{} is damaged, and nothing is exported: {}. `phalanx recover` writes the valid part into a new file; \
         --allow-damage exports it directly", .0.display(), .1
    )]
    DamagedRecording(PathBuf, Integrity),
    /// The recording is complete, but its run wrote another.
    #[error(
        "{} is not the recording that its run wrote: its SHA-256 is {found}, but {CHECKSUMS_FILE} lists {listed}. Nothing is \
         exported; restore the run's own recording, or export this one with --allow-damage", .file.display()
    )]
    OtherRecording {
        /// Path of the recording.
        file: PathBuf,
        /// SHA-256 of the file.
        found: String,
        /// SHA-256 that the run recorded.
        listed: String,
    },
    /// A message does not have the type of its channel: file, topic, and run time, s.
    #[error("{}: a message on {} at {} s does not have the type of its channel", .0.display(), .1, .2)]
    MalformedMessage(PathBuf, String, f64),
    /// A table could not be written.
    #[error("cannot write {}: {}; what was written before is kept", .0.display(), .1)]
    Write(PathBuf, io::Error),
}

/// Writes the tables of the recording `file` into the new directory `out`. A damaged recording is exported only
/// with `allow_damage`, and its tables then hold the valid data.
pub fn export(file: &Path, out: &Path, allow_damage: bool) -> Result<ExportResult, ExportError> {
    let read_error = |error| ExportError::Read(file.into(), error);
    let mut reader = RecordReader::open(file).map_err(read_error)?;
    let run = loop {
        match reader.next().transpose().map_err(read_error)? {
            Some(Record::Metadata(metadata)) if metadata.name == METADATA_NAME => {
                break RecordedRun::from_metadata(&metadata);
            }
            Some(_) => {}
            None => break None,
        }
    };
    let run = run.ok_or_else(|| ExportError::NotARecording(file.into()))?;
    let integrity = read_integrity(file).map_err(read_error)?;
    if !integrity.is_complete() && !allow_damage {
        return Err(ExportError::DamagedRecording(file.into(), integrity));
    }
    if !allow_damage
        && let Some((found, listed)) = find_checksum_difference(file).map_err(read_error)?
    {
        return Err(ExportError::OtherRecording { file: file.into(), found, listed });
    }
    fs::create_dir(out).map_err(|error| match error.kind() {
        io::ErrorKind::AlreadyExists => ExportError::Exists(out.into()),
        _ => ExportError::Write(out.into(), error),
    })?;
    let result = fill_tables(ExportTables::create(out)?, reader, &run, file);
    if matches!(result, Err(ExportError::MalformedMessage(..))) {
        // Partial tables could be taken for complete ones.
        let _ = fs::remove_dir_all(out);
    }
    Ok(ExportResult { tables: result?, integrity })
}

/// Writes the messages into the tables. Returns the name and the number of rows of each table.
fn fill_tables(
    mut tables: ExportTables,
    reader: RecordReader,
    run: &RecordedRun,
    file: &Path,
) -> Result<Vec<(&'static str, u64)>, ExportError> {
    let read_error = |error| ExportError::Read(file.into(), error);
    let mut channels = HashMap::new();
    for record in reader {
        match record.map_err(read_error)? {
            Record::Channel(channel) => {
                let kind = run.find_observation(&channel.topic);
                if let Some(ObservationKind::Law(topic, _)) = kind {
                    tables.open_law_table(topic)?;
                }
                channels.insert(channel.id, (channel.topic, kind));
            }
            Record::Message { header, data } => {
                let Some((topic, Some(kind))) = channels.get(&header.channel_id) else { continue };
                let t_s = ns_to_seconds(header.log_time.saturating_sub(run.started_unix_ns));
                let written = run.write_message(&mut tables, *kind, t_s, &data)?;
                written.ok_or_else(|| {
                    ExportError::MalformedMessage(file.into(), topic.clone(), t_s)
                })?;
            }
            _ => {}
        }
    }
    tables.finish()
}

/// Returns the SHA-256 of a recording and the SHA-256 in the list of its run, if they differ.
fn find_checksum_difference(file: &Path) -> io::Result<Option<(String, String)>> {
    let Some(listed) = read_listed_checksum_next_to(file) else { return Ok(None) };
    let found = sha256(regular_file::open(file, SymlinkPolicy::Followed)?)?;
    Ok((found != listed).then_some((found, listed)))
}

/// Reads the complete file and returns its integrity.
fn read_integrity(file: &Path) -> io::Result<Integrity> {
    let mut reader = RecordReader::open(file)?;
    reader.by_ref().try_for_each(|record| record.map(drop))?;
    Ok(reader.integrity())
}

/// Identity of the recorded run.
struct RecordedRun {
    started_unix_ns: u64,
    robots: Vec<String>,
    topics: Vec<String>,
}

/// Kind of observation of a topic, with the robot's index.
#[derive(Clone, Copy)]
enum ObservationKind {
    Pose(usize),
    Command(usize),
    Metrics,
    Event,
    Law(LawTopic, usize),
}

impl RecordedRun {
    fn from_metadata(metadata: &Metadata) -> Option<RecordedRun> {
        let list = |key: &str| -> Option<Vec<String>> {
            Some(metadata.metadata.get(key)?.split(',').map(str::to_owned).collect())
        };
        let started_unix_ns = metadata.metadata.get(EPOCH_KEY)?.parse().ok()?;
        let (robots, topics) = (list(ROBOTS_KEY)?, list(TOPICS_KEY)?);
        (robots.len() == topics.len()).then_some(RecordedRun { started_unix_ns, robots, topics })
    }

    fn find_observation(&self, topic: &str) -> Option<ObservationKind> {
        match topic {
            "/metrics" => Some(ObservationKind::Metrics),
            "/rosout" => Some(ObservationKind::Event),
            _ => {
                let (robot, topic_name) = topic.strip_prefix('/')?.split_once('/')?;
                let robot = self.topics.iter().position(|known| known == robot)?;
                match topic_name {
                    "pose" => Some(ObservationKind::Pose(robot)),
                    "cmd_vel" => Some(ObservationKind::Command(robot)),
                    _ => {
                        let topic =
                            LawTopic::ALL.into_iter().find(|topic| topic.name() == topic_name)?;
                        Some(ObservationKind::Law(topic, robot))
                    }
                }
            }
        }
    }

    /// Writes one message into its table. Returns `None` if the message does not have the type of its channel.
    fn write_message(
        &self,
        tables: &mut ExportTables,
        kind: ObservationKind,
        t_s: f64,
        message: &[u8],
    ) -> Result<Option<()>, ExportError> {
        let name = |robot: usize| self.robots[robot].clone();
        match kind {
            ObservationKind::Pose(robot) => {
                let Some(pose_message) = read_pose_stamped(message) else { return Ok(None) };
                let Pose { x_m, y_m, heading_rad } = pose_message.pose();
                let robot = name(robot);
                tables.poses.write_row(PoseLine { t_s, robot, x_m, y_m, heading_rad })?;
            }
            ObservationKind::Command(robot) => {
                let Some(Twist { v_m_s, side_m_s, w_rad_s }) = read_twist(message) else {
                    return Ok(None);
                };
                tables.commands.write_row(CommandLine {
                    t_s,
                    robot: name(robot),
                    v_m_s,
                    w_rad_s,
                    side_m_s,
                })?;
            }
            ObservationKind::Law(LawTopic::Messages, robot) => {
                let Some(LawMessage { stamp_ns, arrays, bytes }) = read_law_message(message) else {
                    return Ok(None);
                };
                let t_s = ns_to_seconds(stamp_ns.saturating_sub(self.started_unix_ns));
                let robot = name(robot);
                let lines = MessageLine::lines_of_message(t_s, &robot, arrays.into_iter(), &bytes);
                for row in lines {
                    tables.messages.as_mut().map_or(Ok(()), |table| table.write_row(row))?;
                }
            }
            ObservationKind::Law(LawTopic::Signals, robot) => {
                let Some(signals) = read_signals(message) else { return Ok(None) };
                for (stamp_ns, signal, value) in signals {
                    let t_s = ns_to_seconds(stamp_ns.saturating_sub(self.started_unix_ns));
                    let (robot, signal) = (name(robot), signal.to_owned());
                    let row = SignalLine { t_s, robot, signal, value };
                    tables.signals.as_mut().map_or(Ok(()), |table| table.write_row(row))?;
                }
            }
            ObservationKind::Metrics => {
                let Some(metrics) = read_metrics(message) else { return Ok(None) };
                for (i, robot) in metrics.robots.iter().enumerate() {
                    let unknown = ColumnValue::Number(None);
                    let values = metrics.columns.iter();
                    let values = values.map(|column| column.get(i).copied().unwrap_or(unknown));
                    let robot = (*robot).to_owned();
                    tables.errors.write_row(ErrorLine(t_s, robot, values.collect()))?;
                }
                if let Some((min_distance_m, [a, b])) = metrics.nearest_pair {
                    let name = |index: usize| Some((*metrics.robots.get(index)?).to_owned());
                    let (Some(robot_a), Some(robot_b)) = (name(a), name(b)) else {
                        return Ok(None);
                    };
                    tables.distances.write_row(DistanceLine {
                        t_s,
                        robot_a,
                        robot_b,
                        min_distance_m,
                    })?;
                }
            }
            ObservationKind::Event => {
                let Some(event) = read_log(message) else { return Ok(None) };
                let robot = if event.name == SUPERVISOR_NAME { "" } else { event.name };
                let detail = event.text.strip_prefix(event.kind).unwrap_or(event.text);
                let detail = detail.strip_prefix(": ").unwrap_or(detail);
                let [kind, robot, detail] = [event.kind, robot, detail].map(str::to_owned);
                let level = event.level.into();
                tables.events.write_row(LogLine { t_s, kind, robot, level, detail })?;
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
struct ErrorLine(f64, String, Vec<ColumnValue<'static>>);

/// Name of the table of the recorded columns of `samples.csv`.
const ERRORS_FILE: &str = "errors.csv";

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
pub fn tables_reference() -> String {
    let tables = [
        (PoseLine::FILE, column_names::<PoseLine>()),
        (CommandLine::FILE, column_names::<CommandLine>()),
        (ERRORS_FILE, error_columns()),
        (DistanceLine::FILE, column_names::<DistanceLine>()),
        (LogLine::FILE, column_names::<LogLine>()),
        (SignalLine::FILE, column_names::<SignalLine>()),
        (MessageLine::FILE, column_names::<MessageLine>()),
    ];
    let row =
        |(file, names): (&str, Vec<&str>)| format!("| `{file}` | `{}` |\n", names.join("`, `"));
    format!("| file | columns |\n|---|---|\n{}", tables.map(row).concat())
}

/// Tables of an export in progress.
struct ExportTables {
    poses: TableWriter<PoseLine>,
    commands: TableWriter<CommandLine>,
    errors: TableWriter<ErrorLine>,
    distances: TableWriter<DistanceLine>,
    events: TableWriter<LogLine>,
    /// Table of the laws' signals; `None` without a channel for them.
    signals: Option<TableWriter<SignalLine>>,
    /// Table of the laws' messages; `None` without a channel for them.
    messages: Option<TableWriter<MessageLine>>,
    out: PathBuf,
}

impl ExportTables {
    fn create(out: &Path) -> Result<ExportTables, ExportError> {
        Ok(ExportTables {
            poses: TableWriter::create(out)?,
            commands: TableWriter::create(out)?,
            errors: TableWriter::create_with_columns(out, ERRORS_FILE, &error_columns())?,
            distances: TableWriter::create(out)?,
            events: TableWriter::create(out)?,
            signals: None,
            messages: None,
            out: out.to_owned(),
        })
    }

    /// Creates the table of a topic of control laws unless it exists.
    fn open_law_table(&mut self, topic: LawTopic) -> Result<(), ExportError> {
        match topic {
            LawTopic::Signals if self.signals.is_none() => {
                self.signals = Some(TableWriter::create(&self.out)?);
            }
            LawTopic::Messages if self.messages.is_none() => {
                self.messages = Some(TableWriter::create(&self.out)?);
            }
            LawTopic::Signals | LawTopic::Messages => {}
        }
        Ok(())
    }

    /// Completes all files. Returns the name and the number of rows of each table.
    fn finish(self) -> Result<Vec<(&'static str, u64)>, ExportError> {
        let ExportTables { poses, commands, errors, distances, events, signals, messages, .. } =
            self;
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
        if let Some(messages) = messages {
            tables.push(messages.finish()?);
        }
        Ok(tables)
    }
}

/// A table in progress, with lines of type `L`.
struct TableWriter<L> {
    name: &'static str,
    path: PathBuf,
    row_count: u64,
    writer: csv::Writer<File>,
    line: PhantomData<L>,
}

impl<L: Table> TableWriter<L> {
    fn create(out: &Path) -> Result<TableWriter<L>, ExportError> {
        TableWriter::create_with_columns(out, L::FILE, &column_names::<L>())
    }
}

impl<L> TableWriter<L> {
    fn create_with_columns(
        out: &Path,
        name: &'static str,
        columns: &[&str],
    ) -> Result<TableWriter<L>, ExportError> {
        let path = out.join(name);
        let file =
            File::create_new(&path).map_err(|error| ExportError::Write(path.clone(), error))?;
        let writer = csv::WriterBuilder::new().has_headers(false).from_writer(file);
        let mut table = TableWriter { name, path, row_count: 0, writer, line: PhantomData };
        // Written here, so that a table without rows has a header too.
        let written = table.writer.write_record(columns);
        written.map_err(|error| table.export_error(error.into()))?;
        Ok(table)
    }

    fn write_row(&mut self, row: L) -> Result<(), ExportError>
    where
        L: Serialize,
    {
        self.row_count += 1;
        let written = self.writer.serialize(row);
        written.map_err(|error| self.export_error(error.into()))
    }

    fn finish(mut self) -> Result<(&'static str, u64), ExportError> {
        self.writer.flush().map_err(|error| self.export_error(error))?;
        Ok((self.name, self.row_count))
    }

    fn export_error(&self, error: io::Error) -> ExportError {
        ExportError::Write(self.path.clone(), error)
    }
}
