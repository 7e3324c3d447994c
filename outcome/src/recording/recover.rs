//! Gives a recording its end back: index and summary, which a killed supervisor never wrote. Every
//! whole chunk is copied, and with it what readers do not need and people do: attachments and
//! metadata. The old file is only read.

use std::fmt;
use std::io;
use std::path::{Path, PathBuf};

use mcap::records::Record;

use crate::recording::pieces::{Pieces, Soundness};
use crate::recording::writer::{WriteError, Writer};

/// What came of it.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Outcome {
    /// Nothing was missing, and nothing was written.
    Whole,
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
    /// Chunks and attachments left out because they did not fit their checksums.
    pub damaged: u64,
    /// Messages left out because their channel was in a damaged chunk.
    pub orphans: u64,
    /// Bytes at the end that were cut short.
    pub cut_bytes: u64,
}

/// Why nothing was recovered.
#[derive(Debug, thiserror::Error)]
pub enum RecoverError {
    /// It would overwrite something.
    #[error("{} exists already; give --out a new name", .0.display())]
    Exists(PathBuf),
    /// The recording cannot be read.
    #[error("cannot read {}: {source}", path.display())]
    Read {
        /// Which.
        path: PathBuf,
        /// Why.
        source: io::Error,
    },
    /// It is no recording, or one that was cut before anything was in it.
    #[error("nothing to recover in {}: expected an MCAP file with at least its header", .0.display())]
    Nothing(PathBuf),
    /// The new file cannot be written.
    #[error("cannot write {}: {source}; it is removed again", path.display())]
    Write {
        /// Which.
        path: PathBuf,
        /// Why.
        source: io::Error,
    },
}

/// Writes what is whole in `file` into the new file `out`, unless all of it is.
pub fn recover(file: &Path, out: &Path) -> Result<Outcome, RecoverError> {
    let unreadable = |source| RecoverError::Read { path: file.into(), source };
    let mut pieces = Pieces::open(file).map_err(unreadable)?;
    let mut profile = None;
    for piece in pieces.by_ref() {
        if let Record::Header(header) = piece.map_err(unreadable)? {
            profile.get_or_insert(header.profile);
        }
    }
    let profile = profile.ok_or_else(|| RecoverError::Nothing(file.into()))?;
    let soundness = pieces.soundness();
    if soundness.whole {
        return Ok(Outcome::Whole);
    }

    let writer = Writer::create(out, &profile).map_err(|source| match source.kind() {
        io::ErrorKind::AlreadyExists => RecoverError::Exists(out.into()),
        _ => RecoverError::Write { path: out.into(), source },
    })?;
    let pieces = Pieces::open(file).map_err(unreadable)?;
    let recovered = copied(pieces, writer, soundness).map_err(|error| match error {
        Failure::Read(source) => unreadable(source),
        Failure::Write(source) => RecoverError::Write { path: out.into(), source },
    });
    if recovered.is_err() {
        // Half a file would only stand in the way of the next try.
        let _ = std::fs::remove_file(out);
    }
    recovered.map(Outcome::Recovered)
}

enum Failure {
    Read(io::Error),
    Write(io::Error),
}

fn copied(pieces: Pieces, mut writer: Writer, soundness: Soundness) -> Result<Recovered, Failure> {
    let Soundness { damaged, cut_bytes, .. } = soundness;
    let mut recovered = Recovered { damaged, cut_bytes, ..Recovered::default() };
    for piece in pieces {
        let record = piece.map_err(Failure::Read)?;
        match copy(&record, &mut writer, &mut recovered) {
            Ok(()) => {}
            Err(WriteError::File(source)) => return Err(Failure::Write(source)),
            // It refers to something that was lost, or contradicts what came before.
            Err(_) => recovered.orphans += u64::from(matches!(record, Record::Message { .. })),
        }
    }
    writer.finish().map_err(Failure::Write)?;
    Ok(recovered)
}

fn copy(
    record: &Record<'_>,
    writer: &mut Writer,
    recovered: &mut Recovered,
) -> Result<(), WriteError> {
    match record {
        Record::Schema { header, data } => writer.schema(header, data)?,
        Record::Channel(channel) => writer.channel(channel)?,
        Record::Message { header, data } => {
            writer.message(header, data)?;
            recovered.messages += 1;
            let (first, last) = recovered.stamps_ns.unwrap_or((u64::MAX, 0));
            let stamp_ns = header.log_time;
            recovered.stamps_ns = Some((first.min(stamp_ns), last.max(stamp_ns)));
        }
        Record::Attachment { header, data, .. } => {
            writer.attachment(header, data)?;
            recovered.attachments += 1;
        }
        Record::Metadata(metadata) => {
            writer.metadata(metadata)?;
            recovered.metadata += 1;
        }
        _ => {}
    }
    Ok(())
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
        let damaged = match self.damaged {
            0 => String::new(),
            damaged => format!(", {damaged} damaged chunks or attachments"),
        };
        let orphans = match self.orphans {
            0 => String::new(),
            orphans => format!(", {orphans} messages of unknown channels"),
        };
        writeln!(f, "lost       {} bytes at the end{damaged}{orphans}", self.cut_bytes)
    }
}
