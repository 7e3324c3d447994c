//! Recovery of a recording: writes the index and the summary that a killed supervisor never wrote. Every valid chunk is
//! copied, and also attachments and metadata, which users need, but programs that read the file do not. The old file is
//! only read.

use std::fmt;
use std::fs::File;
use std::io::{self, BufWriter};
use std::path::{Path, PathBuf};

use mcap::records::Record;
use mcap::write::NoSeek;
use mcap::{Attachment, Compression, McapError, McapResult, WriteOptions};

use crate::recording::chunk::CHUNK_BYTES_MAX;
use crate::recording::record_reader::{Integrity, RecordReader};
use crate::recording::recorder::MCAP_PROFILE;

/// Result of a recovery.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum RecoverOutcome {
    /// The file was complete, and nothing was written.
    Complete {
        /// Whether checksums cover all of the file. In recordings of earlier versions, metadata and indexes have
        /// none.
        is_checked: bool,
    },
    /// A recovered file was written.
    Recovered(RecoverySummary),
}

/// Content of the recovered file, and damage of the old one.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct RecoverySummary {
    /// Number of copied messages.
    pub message_count: u64,
    /// Stamps of the first and the last message, ns since 1970.
    pub stamps_ns: Option<(u64, u64)>,
    /// Number of attachments.
    pub attachment_count: u64,
    /// Number of metadata records.
    pub metadata_count: u64,
    /// Number of messages left out because their channel was in a damaged chunk.
    pub orphan_message_count: u64,
    /// Integrity of the old file.
    pub integrity: Integrity,
}

/// Reason why nothing was recovered.
#[derive(Debug, thiserror::Error)]
pub enum RecoverError {
    /// A file with the new name exists.
    #[error("{} exists already; choose a new name with --out", .0.display())]
    Exists(PathBuf),
    /// The recording cannot be read.
    #[error("cannot read {}: {}", .0.display(), .1)]
    Read(PathBuf, io::Error),
    /// The file is not a recording, or was cut before its first record.
    #[error("nothing to recover in {}: expected an MCAP file with at least its header", .0.display())]
    NoValidRecord(PathBuf),
    /// The new file cannot be written.
    #[error("cannot write {}: {}; the partial file is removed", .0.display(), .1)]
    Write(PathBuf, io::Error),
}

/// Copies the valid records of `file` into the new file `out`, unless `file` is complete.
pub fn recover(file: &Path, out: &Path) -> Result<RecoverOutcome, RecoverError> {
    let read_error = |error| RecoverError::Read(file.into(), error);
    let write_error = |error| RecoverError::Write(out.into(), error);
    let mut reader = RecordReader::open(file).map_err(read_error)?;
    let (mut profile, mut has_messages) = (None, false);
    for record in reader.by_ref() {
        match record.map_err(read_error)? {
            Record::Header(header) => drop(profile.get_or_insert(header.profile)),
            Record::Message { .. } => has_messages = true,
            _ => {}
        }
    }
    // The header may be damaged although the messages behind it are valid.
    let profile = profile.or_else(|| has_messages.then(|| MCAP_PROFILE.to_owned()));
    let profile = profile.ok_or_else(|| RecoverError::NoValidRecord(file.into()))?;
    let integrity = reader.integrity();
    if integrity.is_complete() {
        return Ok(RecoverOutcome::Complete { is_checked: integrity.has_checksums });
    }

    let mut writer = create_writer(out, &profile).map_err(|error| match error.kind() {
        io::ErrorKind::AlreadyExists => RecoverError::Exists(out.into()),
        _ => write_error(error),
    })?;
    let mut summary = RecoverySummary { integrity, ..RecoverySummary::default() };
    let mut copy_all = || -> Result<(), RecoverError> {
        for record in RecordReader::open(file).map_err(read_error)? {
            let record = record.map_err(read_error)?;
            match copy_record(&record, &mut writer, &mut summary) {
                Ok(()) => {}
                Err(McapError::Io(error)) => return Err(write_error(error)),
                // The record refers to one that was lost, or contradicts an earlier one.
                Err(_) => {
                    summary.orphan_message_count +=
                        u64::from(matches!(record, Record::Message { .. }))
                }
            }
        }
        writer.finish().map(drop).map_err(|error| write_error(io_error(error)))
    };
    if let Err(error) = copy_all() {
        // A partial file would only block the next attempt.
        let _ = std::fs::remove_file(out);
        return Err(error);
    }
    Ok(RecoverOutcome::Recovered(summary))
}

/// Writer of the crate `mcap`, which accepts records in any order. Speed does not matter here.
type McapWriter = mcap::Writer<NoSeek<BufWriter<File>>>;

/// Creates a file, which must not exist.
fn create_writer(path: &Path, profile: &str) -> io::Result<McapWriter> {
    let options = WriteOptions::new()
        .profile(profile)
        .library(concat!("phalanx ", env!("CARGO_PKG_VERSION")))
        .compression(Some(Compression::Lz4))
        .chunk_size(Some(CHUNK_BYTES_MAX as u64))
        .disable_seeking(true);
    let file = BufWriter::new(File::create_new(path)?);
    options.create(NoSeek::new(file)).map_err(io_error)
}

/// Converts an error of the crate `mcap` into an I/O error.
fn io_error(error: McapError) -> io::Error {
    match error {
        McapError::Io(error) => error,
        other => io::Error::other(other),
    }
}

fn copy_record(
    record: &Record<'_>,
    writer: &mut McapWriter,
    summary: &mut RecoverySummary,
) -> McapResult<()> {
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
            summary.message_count += 1;
            let (first, last) = summary.stamps_ns.unwrap_or((u64::MAX, 0));
            let stamp_ns = header.log_time;
            summary.stamps_ns = Some((first.min(stamp_ns), last.max(stamp_ns)));
        }
        Record::Attachment { header, data, .. } => {
            writer.attach(&Attachment {
                log_time: header.log_time,
                create_time: header.create_time,
                name: header.name.clone(),
                media_type: header.media_type.clone(),
                data: data.clone(),
            })?;
            summary.attachment_count += 1;
        }
        Record::Metadata(metadata) => {
            writer.write_metadata(metadata)?;
            summary.metadata_count += 1;
        }
        _ => {}
    }
    Ok(())
}

impl RecoverySummary {
    /// Returns whether written data is missing in the new file or was changed.
    pub fn is_damaged(&self) -> bool {
        self.integrity.is_damaged() || self.orphan_message_count > 0 || self.message_count == 0
    }
}

impl fmt::Display for RecoverySummary {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let (first_ns, last_ns) = self.stamps_ns.unwrap_or((0, 0));
        writeln!(
            f,
            "recovered  {} messages over {:.3} s, {} attachments, {} metadata",
            self.message_count,
            formation::ns_to_seconds(last_ns - first_ns),
            self.attachment_count,
            self.metadata_count
        )?;
        writeln!(f, "lost       {}", self.integrity)?;
        if self.message_count == 0 {
            writeln!(f, "           every message: none is valid")?;
        }
        if self.orphan_message_count > 0 {
            writeln!(f, "           messages of unknown channels: {}", self.orphan_message_count)?;
        }
        if self.integrity.has_checksum_mismatch && self.integrity.damaged_records == 0 {
            let hint = "metadata or an index was changed, and which one is not known: compare the metadata";
            writeln!(f, "           {hint}")?;
        }
        Ok(())
    }
}
