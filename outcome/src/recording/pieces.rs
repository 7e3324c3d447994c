//! What is in a file, piece by piece, as far as it is whole: a killed supervisor leaves no index and
//! perhaps half a chunk, a bad disk a chunk that does not fit its checksum.
//!
//! A damaged chunk is left out and the next one read; where a piece is cut, the rest is not told from
//! noise, and reading ends.

use std::collections::VecDeque;
use std::fmt;
use std::fs::File;
use std::io::{self, Read};
use std::path::Path;

use mcap::records::{Record, op};
use mcap::sans_io::{LinearReadEvent, LinearReader, LinearReaderOptions};
use mcap::{MAGIC, McapError};

/// What every record begins with: its kind and its length.
const RECORD_HEADER: u64 = 9;
/// Kinds of records below this are MCAP's own, from this on anybody's.
const PRIVATE: u8 = 0x80;

/// LZ4 makes of one byte no more than this; a chunk that says otherwise is damaged, and must not
/// make us ask for the memory.
const EXPANSION_MAX: usize = 255;
/// A chunk of this size is never too large, bytes.
const CHUNK_MIN: usize = 64 * 1024;

/// The records of a file in order, those in chunks included; chunks themselves not.
pub(crate) struct Pieces {
    file: File,
    reader: LinearReader,
    waiting: VecDeque<Record<'static>>,
    reads_on: bool,
    length: u64,
    soundness: Soundness,
    whole_to: u64,
}

/// How far a file is whole.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct Soundness {
    /// Records that are not what they say, or do not fit their checksums.
    pub damaged: u64,
    /// Bytes at the end that are no whole record.
    pub cut_bytes: u64,
    /// The checksum over all data, or that over the index, does not fit.
    pub misfits: bool,
    /// There is an index, and the end is where it should be.
    pub has_end: bool,
    /// There is a checksum over all data and one over the index: without them nothing is known of what is outside of
    /// chunks and attachments.
    pub has_checksums: bool,
}

impl Soundness {
    /// Whether nothing is known to be lost or changed.
    pub fn is_whole(&self) -> bool {
        self.has_end && self.damaged == 0 && self.cut_bytes == 0 && !self.misfits
    }
}

/// What is wrong.
impl fmt::Display for Soundness {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let &Soundness { damaged, cut_bytes, misfits, has_end, .. } = self;
        let faults = [
            (damaged > 0, format!("damaged chunks or other records: {damaged}")),
            (cut_bytes > 0, format!("bytes at the end that are cut: {cut_bytes}")),
            (misfits, "a checksum over the whole does not fit".to_owned()),
            (!has_end && cut_bytes == 0 && !misfits, "it has no index".to_owned()),
        ];
        let faults: Vec<String> =
            faults.into_iter().filter_map(|(is_so, words)| is_so.then_some(words)).collect();
        f.write_str(&faults.join("; "))
    }
}

impl Pieces {
    pub(crate) fn open(path: &Path) -> io::Result<Pieces> {
        let file = File::open(path)?;
        let metadata = file.metadata()?;
        if !metadata.is_file() {
            return Err(io::Error::other("it is no file"));
        }
        let length = metadata.len();
        // A length that was cut or is noise must not make us ask for more memory than there is file.
        let limit = usize::try_from(length).unwrap_or(usize::MAX);
        let options = LinearReaderOptions::default()
            .with_emit_chunks(true)
            .with_validate_data_section_crc(true)
            .with_validate_summary_section_crc(true)
            .with_check_finishes_after_end_magic(true)
            .with_record_length_limit(limit);
        Ok(Pieces {
            file,
            reader: LinearReader::new_with_options(options),
            waiting: VecDeque::new(),
            reads_on: true,
            length,
            soundness: Soundness { has_checksums: true, ..Soundness::default() },
            whole_to: 0,
        })
    }

    /// How far the file was whole; known once there are no more pieces.
    pub(crate) fn soundness(&self) -> Soundness {
        self.soundness
    }

    /// Takes in the next record of the file itself, or finds its end, or where it is cut.
    fn read(&mut self) -> io::Result<()> {
        while let Some(event) = self.reader.next_event() {
            match event {
                Ok(LinearReadEvent::ReadRequest(wanted)) => {
                    let read = loop {
                        match self.file.read(self.reader.insert(wanted)) {
                            Err(error) if error.kind() == io::ErrorKind::Interrupted => {}
                            other => break other?,
                        }
                    };
                    self.reader.notify_read(read);
                }
                Ok(LinearReadEvent::Record { opcode, data }) => {
                    self.whole_to = self.whole_to.max(MAGIC.len() as u64);
                    self.whole_to += RECORD_HEADER + data.len() as u64;
                    let records = match opcode {
                        op::CHUNK => records_of_chunk(data),
                        _ => parsed(opcode, data).map(|record| VecDeque::from([record])),
                    };
                    match records {
                        Some(records) => self.waiting = records,
                        None => self.soundness.damaged += 1,
                    }
                    return Ok(());
                }
                Err(McapError::BadDataCrc { .. } | McapError::BadSummaryCrc { .. }) => {
                    self.soundness.misfits = true;
                    self.reads_on = false;
                    return Ok(());
                }
                Err(_) => {
                    self.soundness.cut_bytes = self.length - self.whole_to.min(self.length);
                    self.soundness.has_end = false;
                    self.reads_on = false;
                    return Ok(());
                }
            }
        }
        // Only a file that ends as it should comes here.
        self.reads_on = false;
        Ok(())
    }
}

impl Iterator for Pieces {
    type Item = io::Result<Record<'static>>;

    fn next(&mut self) -> Option<io::Result<Record<'static>>> {
        loop {
            match self.waiting.pop_front() {
                Some(Record::DataEnd(end)) => {
                    self.soundness.has_checksums &= end.data_section_crc != 0;
                }
                Some(Record::Footer(footer)) => {
                    self.soundness.has_end = footer.summary_start > 0;
                    self.soundness.has_checksums &= footer.summary_crc != 0;
                }
                Some(record) => return Some(Ok(record)),
                None if !self.reads_on => return None,
                None => {
                    if let Err(error) = self.read() {
                        self.reads_on = false;
                        return Some(Err(error));
                    }
                }
            }
        }
    }
}

/// What is in a chunk, once its checksum was found right: nothing is taken from a damaged one.
fn records_of_chunk(body: &[u8]) -> Option<VecDeque<Record<'static>>> {
    let options = LinearReaderOptions::default()
        .with_skip_start_magic(true)
        .with_skip_end_magic(true)
        .with_prevalidate_chunk_crcs(true)
        .with_record_length_limit(body.len().saturating_mul(EXPANSION_MAX).max(CHUNK_MIN));
    let mut reader = LinearReader::new_with_options(options);
    let header = framed(op::CHUNK, body.len());
    // By the end of data we know that the chunk was whole.
    let end = [&framed(op::DATA_END, 4)[..], &[0; 4]].concat();
    let mut bytes = header.chain(body).chain(&end[..]);
    let mut records = VecDeque::new();
    loop {
        match reader.next_event()?.ok()? {
            LinearReadEvent::ReadRequest(wanted) => {
                let read = bytes.read(reader.insert(wanted)).ok()?;
                reader.notify_read(read);
            }
            LinearReadEvent::Record { opcode: op::DATA_END, .. } => return Some(records),
            LinearReadEvent::Record { opcode, data } => records.push_back(parsed(opcode, data)?),
        }
    }
}

/// How a record of this kind and length begins.
fn framed(opcode: u8, length: usize) -> [u8; RECORD_HEADER as usize] {
    let mut header = [opcode; RECORD_HEADER as usize];
    header[1..].copy_from_slice(&(length as u64).to_le_bytes());
    header
}

/// `None` if this is not what its kind says, or of a kind that MCAP does not have.
fn parsed(opcode: u8, body: &[u8]) -> Option<Record<'static>> {
    // The crate cuts the checksum off an attachment before it knows that there is one.
    if opcode == op::ATTACHMENT && !attachment_fits(body) {
        return None;
    }
    match mcap::parse_record(opcode, body).ok()? {
        Record::Unknown { opcode, .. } if opcode < PRIVATE => None,
        record => Some(record.into_owned()),
    }
}

/// Two stamps, name and media type with their lengths, the data with its length, a checksum.
fn attachment_fits(body: &[u8]) -> bool {
    let text_ends = |from: usize| -> Option<usize> {
        let length = body.get(from..from.checked_add(4)?)?;
        let length = u32::from_le_bytes(length.try_into().ok()?);
        from.checked_add(4)?.checked_add(length as usize)
    };
    let header_ends = text_ends(16).and_then(text_ends);
    header_ends.and_then(|end| end.checked_add(8 + 4)).is_some_and(|end| end <= body.len())
}
