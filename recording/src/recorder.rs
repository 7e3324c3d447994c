//! Writes a run down while it goes on. Every failure is the file's; after one the recorder writes
//! nothing more, and what was written before is kept.

use std::collections::BTreeMap;
use std::fs::File;
use std::io::{self, BufWriter};
use std::path::Path;
use std::time::{Duration, Instant};

use mcap::records::MessageHeader;
use mcap::write::{Metadata, NoSeek};
use mcap::{Attachment, Compression, McapError, WriteOptions};

use crate::cdr::Sheet;
use crate::messages::{self, Event, Sheets};
pub use crate::messages::{Nearest, State};
use crate::schemas::{self, Schema};
use crate::topics::spelled;

/// Uncompressed size after which a chunk is closed, bytes. A chunk that a kill cuts is lost; and small
/// ones are quick to look something up in.
const CHUNK_SIZE: u64 = 64 * 1024;
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

/// The file that is written to: never sought in, so that what is in it is whole up to a point.
pub(crate) type Writer = mcap::Writer<NoSeek<BufWriter<File>>>;

/// A new file of MCAP.
pub(crate) fn create(path: &Path, profile: &str) -> io::Result<Writer> {
    let file = BufWriter::new(File::create_new(path)?);
    WriteOptions::new()
        .profile(profile)
        .library(concat!("phalanx ", env!("CARGO_PKG_VERSION")))
        .compression(Some(Compression::Lz4))
        .chunk_size(Some(CHUNK_SIZE))
        .disable_seeking(true)
        // Every chunk has a checksum of its own.
        .calculate_data_section_crc(false)
        .create(NoSeek::new(file))
        .map_err(failed)
}

/// Writing fails for the file's reasons, which have words already.
pub(crate) fn failed(error: McapError) -> io::Error {
    match error {
        McapError::Io(error) => error,
        other => io::Error::other(other),
    }
}

/// What is known of a run before it begins.
#[derive(Debug)]
pub struct Run<'a> {
    /// When the run began, ns since 1970. Run time counts from here.
    pub started_unix_ns: u64,
    /// The robots' names in scenario order.
    pub robots: &'a [String],
    /// Further facts, for people and scripts.
    pub facts: BTreeMap<String, String>,
    /// Files to be carried along: name, media type, content.
    pub attachments: &'a [(&'a str, &'a str, &'a str)],
}

/// A recording under way.
pub struct Recorder {
    writer: Writer,
    started_unix_ns: u64,
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
    unflushed: bool,
}

impl Recorder {
    /// Begins a file, which must not exist, with everything in it that is known beforehand.
    pub fn create(path: &Path, run: &Run<'_>) -> io::Result<Recorder> {
        let topics = spelled(run.robots);
        let mut writer = create(path, "ros2")?;
        let mut facts = run.facts.clone();
        facts.insert(EPOCH.into(), run.started_unix_ns.to_string());
        facts.insert(ROBOTS.into(), run.robots.join(","));
        facts.insert(TOPICS.into(), topics.join(","));
        let facts = Metadata { name: FACTS.into(), metadata: facts };
        writer.write_metadata(&facts).map_err(failed)?;
        for (name, media_type, content) in run.attachments {
            let attachment = Attachment {
                log_time: run.started_unix_ns,
                create_time: run.started_unix_ns,
                name: (*name).into(),
                media_type: (*media_type).into(),
                data: content.as_bytes().into(),
            };
            writer.attach(&attachment).map_err(failed)?;
        }
        let tf = channel(&mut writer, &schemas::TF, "/tf")?;
        let rosout = channel(&mut writer, &schemas::LOG, "/rosout")?;
        let metrics = channel(&mut writer, &schemas::METRICS, "/metrics")?;
        let mut channels = Vec::with_capacity(topics.len());
        for robot in &topics {
            channels.push([
                channel(&mut writer, &schemas::ODOMETRY, &format!("/{robot}/odom"))?,
                channel(&mut writer, &schemas::POSE_STAMPED, &format!("/{robot}/pose"))?,
                channel(&mut writer, &schemas::COMMAND, &format!("/{robot}/cmd_vel"))?,
            ]);
        }
        writer.flush().map_err(failed)?;
        Ok(Recorder {
            writer,
            started_unix_ns: run.started_unix_ns,
            sheets: Sheets::new(run.robots),
            channels,
            tf,
            metrics,
            rosout,
            log: Sheet::new(),
            text: String::new(),
            instants: 0,
            events: 0,
            flushed: Instant::now(),
            unflushed: false,
        })
    }

    /// Writes one instant of the truth; the lists are in scenario order. An error of `None`: this
    /// robot has no place to be at.
    pub fn instant(
        &mut self,
        t_ns: u64,
        states: impl Iterator<Item = State>,
        errors_m: &[Option<f64>],
        alive: &[bool],
        nearest: Option<Nearest>,
    ) -> io::Result<()> {
        let stamp_ns = self.started_unix_ns + t_ns;
        self.sheets.set(stamp_ns, states, errors_m, alive, nearest);
        let mut header = MessageHeader {
            channel_id: self.tf,
            sequence: self.instants,
            log_time: stamp_ns,
            publish_time: stamp_ns,
        };
        let writer = &mut self.writer;
        writer.write_to_known_channel(&header, self.sheets.tf()).map_err(failed)?;
        for (robot, channels) in self.sheets.robots.iter().zip(&self.channels) {
            for (bytes, &channel_id) in robot.bytes().into_iter().zip(channels) {
                header.channel_id = channel_id;
                writer.write_to_known_channel(&header, bytes).map_err(failed)?;
            }
        }
        header.channel_id = self.metrics;
        writer.write_to_known_channel(&header, self.sheets.metrics()).map_err(failed)?;
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
        self.writer.write_to_known_channel(&header, self.log.bytes()).map_err(failed)?;
        self.events = self.events.wrapping_add(1);
        self.unflushed = true;
        Ok(())
    }

    /// Sees to it that what was written is in the file, if it has waited [`FLUSH_EVERY`]. To be asked
    /// often.
    pub fn flush_if_due(&mut self, now: Instant) -> io::Result<()> {
        if now.saturating_duration_since(self.flushed) < FLUSH_EVERY {
            return Ok(());
        }
        self.flushed = now;
        if std::mem::take(&mut self.unflushed) {
            self.writer.flush().map_err(failed)?;
        }
        Ok(())
    }

    /// Writes the index and the summary, by which the file is whole.
    pub fn finish(mut self) -> io::Result<()> {
        self.writer.finish().map_err(failed).map(drop)
    }
}

fn channel(writer: &mut Writer, schema: &Schema, topic: &str) -> io::Result<u16> {
    let text = schema.text();
    let id = writer.add_schema(schema.name, schemas::ENCODING, text.as_bytes()).map_err(failed)?;
    // Empty: whoever plays it back takes the defaults. Half a profile would not be understood.
    let metadata = BTreeMap::from([("offered_qos_profiles".to_owned(), String::new())]);
    writer.add_channel(id, topic, "cdr", &metadata).map_err(failed)
}

/// How bad a kind of event is, as ROS counts it.
fn level(kind: &str) -> u8 {
    const INFO: u8 = 20;
    const WARN: u8 = 30;
    const ERROR: u8 = 40;
    match kind {
        "died" | "restart-ceiling" => ERROR,
        "kill" | "freeze" | "load" | "cut" => WARN,
        _ => INFO,
    }
}
