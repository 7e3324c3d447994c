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

pub use crate::recording::messages::NearestPair;
use crate::recording::messages::{self as run_messages, LogEvent, recorded_fields};
use crate::recording::schemas::{self, Schema};
use crate::recording::topics::topic_names;
use crate::recording::walls;
use crate::recording::writer::RecordingWriter;
use crate::results::tables::{EventLine, RecordedMessage, SampleLine, SignalLine};

/// Maximum time between two flushes, whether a chunk is full or not. A kill must not lose more than one second,
/// even on a busy machine.
pub const FLUSH_INTERVAL: Duration = Duration::from_millis(500);

/// MCAP profile of the recording.
pub(crate) const MCAP_PROFILE: &str = "ros2";
/// Name of the metadata that identify the run.
pub(crate) const METADATA_NAME: &str = "phalanx";
/// Metadata key of the run's start, ns since 1970.
pub(crate) const EPOCH_KEY: &str = "started_unix_ns";
/// Metadata key of the robots' names, in scenario order, separated by commas.
pub(crate) const ROBOTS_KEY: &str = "robots";
/// Metadata key of the robots' topics, in scenario order, separated by commas.
pub(crate) const TOPICS_KEY: &str = "topics";
/// Name in `/rosout` for events of no single robot. No robot may have this name.
pub(crate) const SUPERVISOR_NAME: &str = "supervisor";

/// Topic of a robot for values of its control law. Only robots whose law has such values have it.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum LawTopic {
    /// Numbers that the law recorded.
    Signals,
    /// Messages that the law sent.
    Messages,
}

impl LawTopic {
    /// All topics, in the order of the enumeration.
    pub(crate) const ALL: [LawTopic; 2] = [LawTopic::Signals, LawTopic::Messages];

    /// Returns the last part of the name of the topic.
    pub(crate) fn name(self) -> &'static str {
        match self {
            LawTopic::Signals => "signals",
            LawTopic::Messages => "messages",
        }
    }

    fn schema(self) -> &'static Schema {
        match self {
            LawTopic::Signals => &schemas::SIGNALS,
            LawTopic::Messages => &schemas::LAW_MESSAGE,
        }
    }
}

/// Description of a run, known before it begins.
#[derive(Debug)]
pub struct RunDescription<'a> {
    /// Start of the run, ns since 1970, or a substitute. Run time counts from here.
    pub started_unix_ns: u64,
    /// Whether equal runs give equal files, byte by byte. Then no clock decides which messages share a chunk, and
    /// the last half second of run time is not flushed.
    pub is_reproducible: bool,
    /// Names of the robots in scenario order.
    pub robots: &'a [String],
    /// Topics for values of control laws, in the order of the enumeration, and whether each robot has them.
    pub law_topics: [(LawTopic, Vec<bool>); 2],
    /// Convex parts of walls and obstacles.
    pub walls: &'a [Obstacle],
    /// Additional metadata of the run.
    pub metadata: BTreeMap<String, String>,
    /// Attachments: name, media type, content.
    pub attachments: &'a [(&'a str, &'a str, &'a str)],
}

/// A recording in progress.
pub struct Recorder {
    writer: RecordingWriter,
    started_unix_ns: u64,
    is_reproducible: bool,
    robots: Vec<RobotChannels>,
    tf_channel: u16,
    metrics_channel: u16,
    rosout_channel: u16,
    /// Buffer of the message in progress.
    message_buffer: cdr::Writer,
    /// Buffer of the message with the transforms of all robots.
    transforms_buffer: cdr::Writer,
    text_buffer: String,
    sample_count: u32,
    event_count: u32,
    last_flush: Instant,
    /// Run time of the last flush, ns.
    flushed_t_ns: u64,
    has_unflushed_data: bool,
}

/// Frame and channels of one robot.
struct RobotChannels {
    name: String,
    frame: String,
    odometry_channel: u16,
    pose_channel: u16,
    command_channel: u16,
    /// Channel of each [`LawTopic`], if the robot has it.
    law_channels: [Option<u16>; LawTopic::ALL.len()],
}

impl Recorder {
    /// Creates a file, which must not exist, and writes everything that is known beforehand.
    pub fn create(path: &Path, run: &RunDescription<'_>) -> io::Result<Recorder> {
        let topics = topic_names(run.robots);
        let mut writer = RecordingWriter::create(path, MCAP_PROFILE)?;
        let mut metadata = run.metadata.clone();
        metadata.insert(EPOCH_KEY.into(), run.started_unix_ns.to_string());
        metadata.insert(ROBOTS_KEY.into(), run.robots.join(","));
        metadata.insert(TOPICS_KEY.into(), topics.join(","));
        let metadata = Metadata { name: METADATA_NAME.into(), metadata };
        writer.append_metadata(&metadata)?;
        for &(name, media_type, content) in run.attachments {
            let header = AttachmentHeader {
                log_time: run.started_unix_ns,
                create_time: run.started_unix_ns,
                name: name.into(),
                media_type: media_type.into(),
            };
            writer.append_attachment(header, content.as_bytes())?;
        }
        let tf_channel = open_channel_of_schema(&mut writer, &schemas::TF, "/tf", NO_QOS)?;
        let rosout_channel = open_channel_of_schema(&mut writer, &schemas::LOG, "/rosout", NO_QOS)?;
        let metrics_channel = open_channel_of_schema(
            &mut writer,
            &schemas::metrics_schema(&recorded_fields()),
            "/metrics",
            NO_QOS,
        )?;
        let mut robots = Vec::with_capacity(topics.len());
        let types = [&schemas::ODOMETRY, &schemas::POSE_STAMPED, &schemas::COMMAND];
        let [odometry, pose, command] = types.map(|schema| register_schema(&mut writer, schema));
        let (odometry, pose, command) = (odometry?, pose?, command?);
        let mut law_schemas = [None; LawTopic::ALL.len()];
        for (schema, (topic, robots)) in law_schemas.iter_mut().zip(&run.law_topics) {
            if robots.contains(&true) {
                *schema = Some(register_schema(&mut writer, topic.schema())?);
            }
        }
        for (robot_index, (name, topic)) in run.robots.iter().zip(&topics).enumerate() {
            let mut open_channel = |schema: u16, name: &str| {
                writer.register_channel(schema, &format!("/{topic}/{name}"), qos_metadata(NO_QOS))
            };
            let mut channels = RobotChannels {
                name: name.clone(),
                frame: base_link(name),
                odometry_channel: open_channel(odometry, "odom")?,
                pose_channel: open_channel(pose, "pose")?,
                command_channel: open_channel(command, "cmd_vel")?,
                law_channels: [None; LawTopic::ALL.len()],
            };
            for (schema, (topic, has_topic)) in law_schemas.iter().zip(&run.law_topics) {
                if let Some(schema) = schema.filter(|_| has_topic[robot_index]) {
                    let channel = open_channel(schema, topic.name())?;
                    channels.law_channels[*topic as usize] = Some(channel);
                }
            }
            robots.push(channels);
        }
        let mut message_buffer = cdr::Writer::new();
        if !run.walls.is_empty() {
            let channel =
                open_channel_of_schema(&mut writer, &schemas::WALLS, "/walls", walls::LATCHED_QOS)?;
            walls::write_wall_markers(&mut message_buffer, run.walls, run.started_unix_ns);
            writer.add_message(channel, 0, run.started_unix_ns, message_buffer.bytes())?;
        }
        writer.flush()?;
        Ok(Recorder {
            writer,
            started_unix_ns: run.started_unix_ns,
            is_reproducible: run.is_reproducible,
            robots,
            tf_channel,
            metrics_channel,
            rosout_channel,
            message_buffer,
            transforms_buffer: cdr::Writer::new(),
            text_buffer: String::new(),
            sample_count: 0,
            event_count: 0,
            last_flush: Instant::now(),
            flushed_t_ns: 0,
            has_unflushed_data: false,
        })
    }

    /// Writes one ground-truth sample with one line for each robot, in scenario order.
    pub fn record_sample(
        &mut self,
        t_ns: u64,
        lines: &[SampleLine],
        nearest_pair: Option<NearestPair>,
    ) -> io::Result<()> {
        if self.is_reproducible
            && u128::from(t_ns.saturating_sub(self.flushed_t_ns)) >= FLUSH_INTERVAL.as_nanos()
        {
            self.flushed_t_ns = t_ns;
            self.writer.flush()?;
        }
        let (number, stamp_ns) = (self.sample_count, self.started_unix_ns + t_ns);
        let Recorder { writer, message_buffer, transforms_buffer, .. } = self;
        robot_messages::begin_transforms(transforms_buffer, self.robots.len());
        for (robot, line) in self.robots.iter().zip(lines) {
            let &SampleLine { x_m, y_m, heading_rad, v_m_s, side_m_s, w_rad_s, .. } = line;
            let (pose, twist) =
                (Pose { x_m, y_m, heading_rad }, Twist { v_m_s, side_m_s, w_rad_s });
            let state = StampedState::new(&robot.frame, stamp_ns, pose, twist);
            robot_messages::write_transform(transforms_buffer, &state);
            robot_messages::write_odometry(message_buffer, &state);
            writer.add_message(robot.odometry_channel, number, stamp_ns, message_buffer.bytes())?;
            robot_messages::write_pose_stamped(message_buffer, &state);
            writer.add_message(robot.pose_channel, number, stamp_ns, message_buffer.bytes())?;
            robot_messages::write_twist(message_buffer, twist);
            writer.add_message(robot.command_channel, number, stamp_ns, message_buffer.bytes())?;
        }
        writer.add_message(self.tf_channel, number, stamp_ns, transforms_buffer.bytes())?;
        run_messages::write_metrics(message_buffer, stamp_ns, lines, nearest_pair);
        writer.add_message(self.metrics_channel, number, stamp_ns, message_buffer.bytes())?;
        self.sample_count = self.sample_count.wrapping_add(1);
        self.has_unflushed_data = true;
        Ok(())
    }

    /// Writes lines of `signals.csv`, which are ordered by robot: one message for each robot.
    pub fn record_signals(&mut self, t_ns: u64, lines: &[SignalLine]) -> io::Result<()> {
        for robot_lines in lines.chunk_by(|a, b| a.robot == b.robot) {
            run_messages::write_signals(
                &mut self.message_buffer,
                self.started_unix_ns,
                robot_lines,
            );
            self.add_law_values(LawTopic::Signals, &robot_lines[0].robot, t_ns)?;
        }
        Ok(())
    }

    /// Writes messages of control laws.
    pub fn record_law_messages(
        &mut self,
        t_ns: u64,
        messages: &[RecordedMessage],
    ) -> io::Result<()> {
        for message in messages {
            run_messages::write_law_message(
                &mut self.message_buffer,
                self.started_unix_ns,
                message,
            );
            self.add_law_values(LawTopic::Messages, &message.robot, t_ns)?;
        }
        Ok(())
    }

    /// Writes the message in the buffer to a topic of a robot; does nothing if the robot does not have the topic.
    fn add_law_values(&mut self, topic: LawTopic, robot: &str, t_ns: u64) -> io::Result<()> {
        let robot = self.robots.iter().find(|channels| channels.name == robot);
        let Some(channel) = robot.and_then(|robot| robot.law_channels[topic as usize]) else {
            return Ok(());
        };
        let stamp_ns = self.started_unix_ns + t_ns;
        self.has_unflushed_data = true;
        self.writer.add_message(channel, self.sample_count, stamp_ns, self.message_buffer.bytes())
    }

    /// Writes an event of a robot or, with an empty name, of the run.
    pub fn record_event(&mut self, t_ns: u64, event: &EventLine) -> io::Result<()> {
        let EventLine { kind, robot, detail, .. } = event;
        self.text_buffer.clear();
        self.text_buffer.push_str(kind);
        if !detail.is_empty() {
            self.text_buffer.push_str(": ");
            self.text_buffer.push_str(detail);
        }
        let name = if robot.is_empty() { SUPERVISOR_NAME } else { robot };
        let event = LogEvent { level: ros_log_level(kind), name, kind, text: &self.text_buffer };
        let stamp_ns = self.started_unix_ns + t_ns;
        run_messages::write_log(&mut self.message_buffer, stamp_ns, &event);
        self.writer.add_message(
            self.rosout_channel,
            self.event_count,
            stamp_ns,
            self.message_buffer.bytes(),
        )?;
        self.event_count = self.event_count.wrapping_add(1);
        self.has_unflushed_data = true;
        Ok(())
    }

    /// Flushes buffered records if the last flush was at least [`FLUSH_INTERVAL`] ago. Call it often. Does nothing for
    /// a reproducible recording, which is flushed by run time.
    pub fn flush_if_due(&mut self, now: Instant) -> io::Result<()> {
        if self.is_reproducible || now.saturating_duration_since(self.last_flush) < FLUSH_INTERVAL {
            return Ok(());
        }
        self.last_flush = now;
        if std::mem::take(&mut self.has_unflushed_data) {
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

fn register_schema(
    writer: &mut RecordingWriter,
    schema: &Schema<impl AsRef<str>>,
) -> io::Result<u16> {
    writer.register_schema(schema.name, schemas::ENCODING, schema.definition_text().as_bytes())
}

/// Opens the only channel of a type.
fn open_channel_of_schema(
    writer: &mut RecordingWriter,
    schema: &Schema<impl AsRef<str>>,
    topic: &str,
    qos: &str,
) -> io::Result<u16> {
    let schema = register_schema(writer, schema)?;
    writer.register_channel(schema, topic, qos_metadata(qos))
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
