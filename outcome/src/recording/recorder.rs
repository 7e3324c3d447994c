//! Writes a run down while it goes on. Every failure is the file's; what was written before is kept.

use std::collections::BTreeMap;
use std::io;
use std::ops::RangeInclusive;
use std::path::Path;
use std::time::{Duration, Instant};

use formation::obstacle::Obstacle;
use mcap::records::{AttachmentHeader, Channel, MessageHeader, Metadata, SchemaHeader};

use crate::recording::cdr::Sheet;
use crate::recording::messages::{self, Event, Sheets};
pub use crate::recording::messages::{Nearest, State};
use crate::recording::schemas::{self, Schema};
use crate::recording::topics::spelled;
use crate::recording::walls;
use crate::recording::writer::Writer;

/// What is written is in the file after this, whether its chunk is full or not: a kill must not cost
/// more than a second, on a busy machine neither.
pub const FLUSH_EVERY: Duration = Duration::from_millis(500);

/// Name of the metadata that says what run this is.
pub(crate) const FACTS: &str = "phalanx";
/// Key of the run's start, ns since 1970.
pub(crate) const EPOCH: &str = "started_unix_ns";
/// Key of the robots' names in scenario order, with commas between them.
pub(crate) const ROBOTS: &str = "robots";
/// Key of the robots' topics, in the same way.
pub(crate) const TOPICS: &str = "topics";
/// Who speaks in `/rosout` of what happens to no single robot. No robot may be called so.
pub(crate) const SUPERVISOR: &str = "supervisor";

/// What is known of a run before it begins.
#[derive(Debug)]
pub struct Run<'a> {
    /// When the run began, ns since 1970, or what stands for it. Run time counts from here.
    pub started_unix_ns: u64,
    /// Whether the same run gives the same file, byte by byte: then no clock decides what is written
    /// together, and the last half second of run time waits for more.
    pub reproducible: bool,
    /// The robots' names in scenario order.
    pub robots: &'a [String],
    /// The convex parts of walls and obstacles.
    pub walls: &'a [Obstacle],
    /// Further facts, for people and scripts.
    pub facts: BTreeMap<String, String>,
    /// Files to be carried along: name, media type, content.
    pub attachments: &'a [(&'a str, &'a str, &'a str)],
}

/// A recording under way.
pub struct Recorder {
    writer: Writer,
    started_unix_ns: u64,
    reproducible: bool,
    sheets: Sheets,
    /// Of each robot's odometry, pose and command.
    channels: Vec<[u16; 3]>,
    tf: u16,
    metrics: u16,
    rosout: u16,
    log: Sheet,
    text: String,
    instants: u32,
    events: u32,
    flushed: Instant,
    /// Run time of the last flush, ns.
    flushed_t_ns: u64,
    unflushed: bool,
}

impl Recorder {
    /// Begins a file, which must not exist, with everything in it that is known beforehand.
    pub fn create(path: &Path, run: &Run<'_>) -> io::Result<Recorder> {
        let topics = spelled(run.robots);
        let mut writer = Writer::create(path, "ros2")?;
        let mut facts = run.facts.clone();
        facts.insert(EPOCH.into(), run.started_unix_ns.to_string());
        facts.insert(ROBOTS.into(), run.robots.join(","));
        facts.insert(TOPICS.into(), topics.join(","));
        let facts = Metadata { name: FACTS.into(), metadata: facts };
        writer.metadata(&facts)?;
        for (name, media_type, content) in run.attachments {
            let header = AttachmentHeader {
                log_time: run.started_unix_ns,
                create_time: run.started_unix_ns,
                name: (*name).into(),
                media_type: (*media_type).into(),
            };
            writer.attachment(&header, content.as_bytes())?;
        }
        let mut channels = Channels { writer: &mut writer, ids: 0..=u16::MAX };
        // Empty: whoever plays it back takes the defaults. Half a profile would not be understood.
        let qos = "";
        let tf = channels.open(&schemas::TF, "/tf", qos)?;
        let rosout = channels.open(&schemas::LOG, "/rosout", qos)?;
        let metrics = channels.open(&schemas::METRICS, "/metrics", qos)?;
        let mut of_robots = Vec::with_capacity(topics.len());
        for robot in &topics {
            of_robots.push([
                channels.open(&schemas::ODOMETRY, &format!("/{robot}/odom"), qos)?,
                channels.open(&schemas::POSE_STAMPED, &format!("/{robot}/pose"), qos)?,
                channels.open(&schemas::COMMAND, &format!("/{robot}/cmd_vel"), qos)?,
            ]);
        }
        if !run.walls.is_empty() {
            let channel_id = channels.open(&schemas::WALLS, "/walls", walls::LATCHED)?;
            let stamp_ns = run.started_unix_ns;
            let header = MessageHeader {
                channel_id,
                sequence: 0,
                log_time: stamp_ns,
                publish_time: stamp_ns,
            };
            writer.message(&header, walls::markers(run.walls, stamp_ns).bytes())?;
        }
        writer.flush()?;
        Ok(Recorder {
            writer,
            started_unix_ns: run.started_unix_ns,
            reproducible: run.reproducible,
            sheets: Sheets::new(run.robots),
            channels: of_robots,
            tf,
            metrics,
            rosout,
            log: Sheet::new(),
            text: String::new(),
            instants: 0,
            events: 0,
            flushed: Instant::now(),
            flushed_t_ns: 0,
            unflushed: false,
        })
    }

    /// Writes one instant of the truth; the lists are in scenario order. `errors_m`: by those that
    /// each robot hears, and to the ideal formation; `None`: this robot has no place to be at.
    pub fn instant(
        &mut self,
        t_ns: u64,
        states: impl Iterator<Item = State>,
        errors_m: [&[Option<f64>]; 2],
        alive: &[bool],
        nearest: Option<Nearest>,
    ) -> io::Result<()> {
        if self.reproducible
            && u128::from(t_ns.saturating_sub(self.flushed_t_ns)) >= FLUSH_EVERY.as_nanos()
        {
            self.flushed_t_ns = t_ns;
            self.writer.flush()?;
        }
        let stamp_ns = self.started_unix_ns + t_ns;
        self.sheets.set(stamp_ns, states, errors_m, alive, nearest);
        let mut header = MessageHeader {
            channel_id: self.tf,
            sequence: self.instants,
            log_time: stamp_ns,
            publish_time: stamp_ns,
        };
        let writer = &mut self.writer;
        writer.message(&header, self.sheets.tf())?;
        for (robot, channels) in self.sheets.robots.iter().zip(&self.channels) {
            for (bytes, &channel_id) in robot.bytes().into_iter().zip(channels) {
                header.channel_id = channel_id;
                writer.message(&header, bytes)?;
            }
        }
        header.channel_id = self.metrics;
        writer.message(&header, self.sheets.metrics())?;
        self.instants = self.instants.wrapping_add(1);
        self.unflushed = true;
        Ok(())
    }

    /// Writes what happened, to a robot or, without a name, to the run as a whole.
    pub fn event(&mut self, t_ns: u64, kind: &str, robot: &str, detail: &str) -> io::Result<()> {
        self.text.clear();
        self.text.push_str(kind);
        if !detail.is_empty() {
            self.text.push_str(": ");
            self.text.push_str(detail);
        }
        let name = if robot.is_empty() { SUPERVISOR } else { robot };
        let event = Event { level: level(kind), name, kind, text: &self.text };
        let stamp_ns = self.started_unix_ns + t_ns;
        messages::write_log(&mut self.log, stamp_ns, &event);
        let header = MessageHeader {
            channel_id: self.rosout,
            sequence: self.events,
            log_time: stamp_ns,
            publish_time: stamp_ns,
        };
        self.writer.message(&header, self.log.bytes())?;
        self.events = self.events.wrapping_add(1);
        self.unflushed = true;
        Ok(())
    }

    /// Sees to it that what was written is in the file, if it has waited [`FLUSH_EVERY`]. To be asked
    /// often. Of a reproducible recording run time decides, and this does nothing.
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

    /// Writes the index and the summary, by which the file is whole.
    pub fn finish(self) -> io::Result<()> {
        self.writer.finish()
    }
}

/// Opens channels, with ids in a row.
struct Channels<'a> {
    writer: &'a mut Writer,
    ids: RangeInclusive<u16>,
}

impl Channels<'_> {
    fn open(&mut self, schema: &Schema, topic: &str, qos: &str) -> io::Result<u16> {
        let &Schema { id: schema_id, name, .. } = schema;
        let encoding = schemas::ENCODING.to_owned();
        let header = SchemaHeader { id: schema_id, name: name.to_owned(), encoding };
        self.writer.schema(&header, schema.text().as_bytes())?;
        let too_many = || io::Error::other("it has more than the 65536 channels of an MCAP file");
        let id = self.ids.next().ok_or_else(too_many)?;
        self.writer.channel(&Channel {
            id,
            schema_id,
            topic: topic.to_owned(),
            message_encoding: "cdr".to_owned(),
            metadata: BTreeMap::from([("offered_qos_profiles".to_owned(), qos.to_owned())]),
        })?;
        Ok(id)
    }
}

/// How bad a kind of event is, as ROS counts it.
fn level(kind: &str) -> u8 {
    const INFO: u8 = 20;
    const WARN: u8 = 30;
    const ERROR: u8 = 40;
    match kind {
        "died" | "restart-ceiling" => ERROR,
        "kill" | "freeze" | "load" | "cut" | "orphaned" => WARN,
        _ => INFO,
    }
}
