//! Recorder of a run in progress. A write error is returned to the caller, and everything written before it is kept.

use std::collections::BTreeMap;
use std::io;
use std::path::Path;
use std::time::{Duration, Instant};

use formation::obstacle::Obstacle;
use formation::pose::{Pose, Twist};
use mcap::records::{AttachmentHeader, Metadata};
use protocol::ros2::cdr;
use protocol::ros2::messages::{self as robot_messages, StampedState, base_link};

pub use crate::recording::messages::Nearest;
use crate::recording::messages::{self as of_all, Event, recorded_fields};
use crate::recording::schemas::{self, Schema};
use crate::recording::topics::topic_names;
use crate::recording::walls;
use crate::recording::writer::Writer;
use crate::results::tables::{EventLine, SampleLine, SignalLine};

/// Maximum time between two flushes, whether a chunk is full or not. A kill must not lose more than one second,
/// even on a busy machine.
pub const FLUSH_EVERY: Duration = Duration::from_millis(500);

/// MCAP profile of the recording.
pub(crate) const PROFILE: &str = "ros2";
/// Name of the metadata that identify the run.
pub(crate) const FACTS: &str = "phalanx";
/// Metadata key of the run's start, ns since 1970.
pub(crate) const EPOCH: &str = "started_unix_ns";
/// Metadata key of the robots' names, in scenario order, separated by commas.
pub(crate) const ROBOTS: &str = "robots";
/// Metadata key of the robots' topics, in scenario order, separated by commas.
pub(crate) const TOPICS: &str = "topics";
/// Last part of the topics of signals.
pub(crate) const SIGNALS_TOPIC: &str = "signals";
/// Name in `/rosout` for events of no single robot. No robot may have this name.
pub(crate) const SUPERVISOR: &str = "supervisor";

/// Description of a run, known before it begins.
#[derive(Debug)]
pub struct RunDescription<'a> {
    /// Start of the run, ns since 1970, or a substitute. Run time counts from here.
    pub started_unix_ns: u64,
    /// Whether equal runs give equal files, byte by byte. Then no clock decides which messages share a chunk, and
    /// the last half second of run time is not flushed.
    pub reproducible: bool,
    /// Names of the robots in scenario order.
    pub robots: &'a [String],
    /// Whether the law of each robot records signals.
    pub with_signals: Vec<bool>,
    /// Convex parts of walls and obstacles.
    pub walls: &'a [Obstacle],
    /// Additional metadata of the run.
    pub facts: BTreeMap<String, String>,
    /// Attachments: name, media type, content.
    pub attachments: &'a [(&'a str, &'a str, &'a str)],
}

/// A recording in progress.
pub struct Recorder {
    writer: Writer,
    started_unix_ns: u64,
    reproducible: bool,
    robots: Vec<Robot>,
    tf: u16,
    metrics: u16,
    rosout: u16,
    /// Buffer of the message in progress.
    message: cdr::Writer,
    /// Buffer of the message with the transforms of all robots.
    transforms: cdr::Writer,
    text: String,
    instants: u32,
    events: u32,
    flushed: Instant,
    /// Run time of the last flush, ns.
    flushed_t_ns: u64,
    unflushed: bool,
}

/// Frame and channels of one robot.
struct Robot {
    name: String,
    frame: String,
    odometry: u16,
    pose: u16,
    command: u16,
    /// Channel of the law's signals, if it records any.
    signals: Option<u16>,
}

impl Recorder {
    /// Creates a file, which must not exist, and writes everything that is known beforehand.
    pub fn create(path: &Path, run: &RunDescription<'_>) -> io::Result<Recorder> {
        let topics = topic_names(run.robots);
        let mut writer = Writer::create(path, PROFILE)?;
        let mut facts = run.facts.clone();
        facts.insert(EPOCH.into(), run.started_unix_ns.to_string());
        facts.insert(ROBOTS.into(), run.robots.join(","));
        facts.insert(TOPICS.into(), topics.join(","));
        let facts = Metadata { name: FACTS.into(), metadata: facts };
        writer.metadata(&facts)?;
        for &(name, media_type, content) in run.attachments {
            let header = AttachmentHeader {
                log_time: run.started_unix_ns,
                create_time: run.started_unix_ns,
                name: name.into(),
                media_type: media_type.into(),
            };
            writer.attachment(header, content.as_bytes())?;
        }
        let tf = open_channel_of_schema(&mut writer, &schemas::TF, "/tf", NO_QOS)?;
        let rosout = open_channel_of_schema(&mut writer, &schemas::LOG, "/rosout", NO_QOS)?;
        let metrics = open_channel_of_schema(
            &mut writer,
            &schemas::metrics(&recorded_fields()),
            "/metrics",
            NO_QOS,
        )?;
        let mut robots = Vec::with_capacity(topics.len());
        let types = [&schemas::ODOMETRY, &schemas::POSE_STAMPED, &schemas::COMMAND];
        let [odometry, pose, command] = types.map(|schema| schema_id(&mut writer, schema));
        let (odometry, pose, command) = (odometry?, pose?, command?);
        let signals = match run.with_signals.contains(&true) {
            true => Some(schema_id(&mut writer, &schemas::SIGNALS)?),
            false => None,
        };
        for ((name, topic), has_signals) in run.robots.iter().zip(&topics).zip(&run.with_signals) {
            let signals = signals.filter(|_| *has_signals);
            let mut open = |schema: u16, what: &str| {
                writer.channel(schema, &format!("/{topic}/{what}"), qos_metadata(NO_QOS))
            };
            robots.push(Robot {
                name: name.clone(),
                frame: base_link(name),
                odometry: open(odometry, "odom")?,
                pose: open(pose, "pose")?,
                command: open(command, "cmd_vel")?,
                signals: signals.map(|schema| open(schema, SIGNALS_TOPIC)).transpose()?,
            });
        }
        let mut message = cdr::Writer::new();
        if !run.walls.is_empty() {
            let channel =
                open_channel_of_schema(&mut writer, &schemas::WALLS, "/walls", walls::LATCHED)?;
            walls::markers(&mut message, run.walls, run.started_unix_ns);
            writer.message(channel, 0, run.started_unix_ns, message.bytes())?;
        }
        writer.flush()?;
        Ok(Recorder {
            writer,
            started_unix_ns: run.started_unix_ns,
            reproducible: run.reproducible,
            robots,
            tf,
            metrics,
            rosout,
            message,
            transforms: cdr::Writer::new(),
            text: String::new(),
            instants: 0,
            events: 0,
            flushed: Instant::now(),
            flushed_t_ns: 0,
            unflushed: false,
        })
    }

    /// Writes one ground-truth sample with one line for each robot, in scenario order.
    pub fn record_sample(
        &mut self,
        t_ns: u64,
        lines: &[SampleLine],
        nearest: Option<Nearest>,
    ) -> io::Result<()> {
        if self.reproducible
            && u128::from(t_ns.saturating_sub(self.flushed_t_ns)) >= FLUSH_EVERY.as_nanos()
        {
            self.flushed_t_ns = t_ns;
            self.writer.flush()?;
        }
        let (number, stamp_ns) = (self.instants, self.started_unix_ns + t_ns);
        let Recorder { writer, message, transforms, .. } = self;
        robot_messages::transforms(transforms, self.robots.len());
        for (robot, line) in self.robots.iter().zip(lines) {
            let &SampleLine { x_m, y_m, heading_rad, v_m_s, side_m_s, w_rad_s, .. } = line;
            let (pose, twist) =
                (Pose { x_m, y_m, heading_rad }, Twist { v_m_s, side_m_s, w_rad_s });
            let state = StampedState::new(&robot.frame, stamp_ns, pose, twist);
            robot_messages::transform(transforms, &state);
            robot_messages::odometry(message, &state);
            writer.message(robot.odometry, number, stamp_ns, message.bytes())?;
            robot_messages::pose_stamped(message, &state);
            writer.message(robot.pose, number, stamp_ns, message.bytes())?;
            robot_messages::twist(message, twist);
            writer.message(robot.command, number, stamp_ns, message.bytes())?;
        }
        writer.message(self.tf, number, stamp_ns, transforms.bytes())?;
        of_all::metrics(message, stamp_ns, lines, nearest);
        writer.message(self.metrics, number, stamp_ns, message.bytes())?;
        self.instants = self.instants.wrapping_add(1);
        self.unflushed = true;
        Ok(())
    }

    /// Writes lines of `signals.csv`, which are ordered by robot: one message for each robot.
    pub fn record_signals(&mut self, t_ns: u64, lines: &[SignalLine]) -> io::Result<()> {
        for of_one in lines.chunk_by(|a, b| a.robot == b.robot) {
            let robot = self.robots.iter().find(|robot| robot.name == of_one[0].robot);
            let Some(channel) = robot.and_then(|robot| robot.signals) else { continue };
            let stamp_ns = self.started_unix_ns + t_ns;
            of_all::signals(&mut self.message, self.started_unix_ns, of_one);
            self.writer.message(channel, self.instants, stamp_ns, self.message.bytes())?;
            self.unflushed = true;
        }
        Ok(())
    }

    /// Writes an event of a robot or, with an empty name, of the run.
    pub fn record_event(&mut self, t_ns: u64, event: &EventLine) -> io::Result<()> {
        let EventLine { kind, robot, detail, .. } = event;
        self.text.clear();
        self.text.push_str(kind);
        if !detail.is_empty() {
            self.text.push_str(": ");
            self.text.push_str(detail);
        }
        let name = if robot.is_empty() { SUPERVISOR } else { robot };
        let event = Event { level: ros_log_level(kind), name, kind, text: &self.text };
        let stamp_ns = self.started_unix_ns + t_ns;
        of_all::log(&mut self.message, stamp_ns, &event);
        self.writer.message(self.rosout, self.events, stamp_ns, self.message.bytes())?;
        self.events = self.events.wrapping_add(1);
        self.unflushed = true;
        Ok(())
    }

    /// Flushes buffered records if the last flush was at least [`FLUSH_EVERY`] ago. Call it often. Does nothing for
    /// a reproducible recording, which is flushed by run time.
    pub fn flush_if_due(&mut self, now: Instant) -> io::Result<()> {
        if self.reproducible || now.saturating_duration_since(self.flushed) < FLUSH_EVERY {
            return Ok(());
        }
        self.flushed = now;
        if std::mem::take(&mut self.unflushed) {
            self.writer.flush()?;
        }
        Ok(())
    }

    /// Writes the index and the summary, which complete the file.
    pub fn finish(self) -> io::Result<()> {
        self.writer.finish()
    }
}

/// Empty QoS profile: players use their defaults. An incomplete profile would be rejected.
const NO_QOS: &str = "";

/// Returns the channel metadata with this QoS profile.
fn qos_metadata(qos: &str) -> BTreeMap<String, String> {
    BTreeMap::from([("offered_qos_profiles".to_owned(), qos.to_owned())])
}

fn schema_id(writer: &mut Writer, schema: &Schema<impl AsRef<str>>) -> io::Result<u16> {
    writer.schema(schema.name, schemas::ENCODING, schema.text().as_bytes())
}

/// Opens the only channel of a type.
fn open_channel_of_schema(
    writer: &mut Writer,
    schema: &Schema<impl AsRef<str>>,
    topic: &str,
    qos: &str,
) -> io::Result<u16> {
    let schema = schema_id(writer, schema)?;
    writer.channel(schema, topic, qos_metadata(qos))
}

/// Returns the ROS log level of a kind of event.
fn ros_log_level(kind: &str) -> u8 {
    const INFO: u8 = 20;
    const WARN: u8 = 30;
    const ERROR: u8 = 40;
    match kind {
        "died" | "restart-ceiling" => ERROR,
        "kill" | "freeze" | "load" | "cut" | "orphaned" | "stood-still" => WARN,
        _ => INFO,
    }
}
