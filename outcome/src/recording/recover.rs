//! Gives a recording its end back: index and summary, which a killed supervisor never wrote. Every
//! whole chunk is copied, and with it what readers do not need and people do: attachments and
//! metadata. The old file is only read.

use std::fmt;
use std::fs::File;
use std::io::{self, BufWriter};
use std::path::{Path, PathBuf};

use mcap::records::Record;
use mcap::write::NoSeek;
use mcap::{Attachment, Compression, McapError, McapResult, WriteOptions};

use crate::recording::chunk::SIZE_MAX;
use crate::recording::pieces::{Pieces, Soundness};
use crate::recording::recorder::PROFILE;

/// What came of it.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Outcome {
    /// Nothing was missing, and nothing was written.
    Whole {
        /// Whether all of it is under a checksum. In recordings of versions before this one, metadata and indexes are not.
        checked: bool,
    },
    /// A whole file was written.
    Recovered(Recovered),
}

/// What is in the new file, and what is not.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct Recovered {
    /// Messages, each whole.
    pub messages: u64,
    /// Stamps of the first and the last message, ns since 1970.
    pub stamps_ns: Option<(u64, u64)>,
    /// Attached files.
    pub attachments: u64,
    /// Metadata records.
    pub metadata: u64,
    /// Messages left out because their channel was in a damaged chunk.
    pub orphans: u64,
    /// What was wrong with the old file.
    pub soundness: Soundness,
}

/// Why nothing was recovered.
#[derive(Debug, thiserror::Error)]
pub enum RecoverError {
    /// It would overwrite something.
    #[error("{} exists already; give --out a new name", .0.display())]
    Exists(PathBuf),
    /// The recording cannot be read.
    #[error("cannot read {}: {}", .0.display(), .1)]
    Read(PathBuf, io::Error),
    /// It is no recording, or one that was cut before anything was in it.
    #[error("nothing to recover in {}: expected an MCAP file with at least its header", .0.display())]
    Nothing(PathBuf),
    /// The new file cannot be written.
    #[error("cannot write {}: {}; it is removed again", .0.display(), .1)]
    Write(PathBuf, io::Error),
}

/// Writes what is whole in `file` into the new file `out`, unless all of it is.
pub fn recover(file: &Path, out: &Path) -> Result<Outcome, RecoverError> {
    let unreadable = |error| RecoverError::Read(file.into(), error);
    let unwritten = |error| RecoverError::Write(out.into(), error);
    let mut pieces = Pieces::open(file).map_err(unreadable)?;
    let (mut profile, mut has_messages) = (None, false);
    for piece in pieces.by_ref() {
        match piece.map_err(unreadable)? {
            Record::Header(header) => drop(profile.get_or_insert(header.profile)),
            Record::Message { .. } => has_messages = true,
            _ => {}
        }
    }
    // A header may be damaged, and the messages behind it whole.
    let profile = profile.or_else(|| has_messages.then(|| PROFILE.to_owned()));
    let profile = profile.ok_or_else(|| RecoverError::Nothing(file.into()))?;
    let soundness = pieces.soundness();
    if soundness.is_whole() {
        return Ok(Outcome::Whole { checked: soundness.has_checksums });
    }

    let mut writer = create(out, &profile).map_err(|error| match error.kind() {
        io::ErrorKind::AlreadyExists => RecoverError::Exists(out.into()),
        _ => unwritten(error),
    })?;
    let mut recovered = Recovered { soundness, ..Recovered::default() };
    let mut copy_all = || -> Result<(), RecoverError> {
        for piece in Pieces::open(file).map_err(unreadable)? {
            let record = piece.map_err(unreadable)?;
            match copy(&record, &mut writer, &mut recovered) {
                Ok(()) => {}
                Err(McapError::Io(error)) => return Err(unwritten(error)),
                // It refers to something that was lost, or contradicts what came before.
                Err(_) => recovered.orphans += u64::from(matches!(record, Record::Message { .. })),
            }
        }
        writer.finish().map(drop).map_err(|error| unwritten(io_error(error)))
    };
    if let Err(error) = copy_all() {
        // Half a file would only stand in the way of the next try.
        let _ = std::fs::remove_file(out);
        return Err(error);
    }
    Ok(Outcome::Recovered(recovered))
}

/// Time is no matter here, so that the crate's own writer does it, which takes records from anywhere.
type Writer = mcap::Writer<NoSeek<BufWriter<File>>>;

/// Begins a file, which must not exist.
fn create(path: &Path, profile: &str) -> io::Result<Writer> {
    let options = WriteOptions::new()
        .profile(profile)
        .library(concat!("phalanx ", env!("CARGO_PKG_VERSION")))
        .compression(Some(Compression::Lz4))
        .chunk_size(Some(SIZE_MAX as u64))
        .disable_seeking(true);
    let file = BufWriter::new(File::create_new(path)?);
    options.create(NoSeek::new(file)).map_err(io_error)
}

/// What `mcap` says of a file, as everybody else says it.
fn io_error(error: McapError) -> io::Error {
    match error {
        McapError::Io(error) => error,
        other => io::Error::other(other),
    }
}

fn copy(record: &Record<'_>, writer: &mut Writer, recovered: &mut Recovered) -> McapResult<()> {
    match record {
        Record::Schema { header, data } => {
            writer.add_schema_with_id(header.id, &header.name, &header.encoding, data)?;
        }
        Record::Channel(channel) => {
            let &mcap::records::Channel { id, schema_id, .. } = channel;
            let (topic, encoding) = (&channel.topic, &channel.message_encoding);
            writer.add_channel_with_id(id, schema_id, topic, encoding, &channel.metadata)?;
        }
        Record::Message { header, data } => {
            writer.write_to_known_channel(header, data)?;
            recovered.messages += 1;
            let (first, last) = recovered.stamps_ns.unwrap_or((u64::MAX, 0));
            let stamp_ns = header.log_time;
            recovered.stamps_ns = Some((first.min(stamp_ns), last.max(stamp_ns)));
        }
        Record::Attachment { header, data, .. } => {
            writer.attach(&Attachment {
                log_time: header.log_time,
                create_time: header.create_time,
                name: header.name.clone(),
                media_type: header.media_type.clone(),
                data: data.clone(),
            })?;
            recovered.attachments += 1;
        }
        Record::Metadata(metadata) => {
            writer.write_metadata(metadata)?;
            recovered.metadata += 1;
        }
        _ => {}
    }
    Ok(())
}

impl Recovered {
    /// Whether something that had been written is not in the new file, or is changed.
    pub fn is_damaged(&self) -> bool {
        self.soundness.is_damaged() || self.orphans > 0 || self.messages == 0
    }
}

impl fmt::Display for Recovered {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let (first_ns, last_ns) = self.stamps_ns.unwrap_or((0, 0));
        writeln!(
            f,
            "recovered  {} messages over {:.3} s, {} attachments, {} metadata",
            self.messages,
            formation::seconds(last_ns - first_ns),
            self.attachments,
            self.metadata
        )?;
        writeln!(f, "lost       {}", self.soundness)?;
        if self.messages == 0 {
            writeln!(f, "           every message: no whole one is in it")?;
        }
        if self.orphans > 0 {
            writeln!(f, "           messages of unknown channels: {}", self.orphans)?;
        }
        if self.soundness.misfits && self.soundness.damaged == 0 {
            let what =
                "which of metadata and indexes was changed is not known: compare the metadata";
            writeln!(f, "           {what}")?;
        }
        Ok(())
    }
}
