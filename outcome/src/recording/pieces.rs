//! What is in a file, piece by piece, as far as it is whole: a killed supervisor leaves no index and
//! perhaps half a chunk, a bad disk a chunk that does not fit its checksum.
//!
//! A damaged chunk is left out and the next one read; where a piece is cut, the rest is not told from
//! noise, and reading ends.

use std::collections::VecDeque;
use std::fs::File;
use std::io::{self, Read};
use std::path::Path;

use mcap::MAGIC;
use mcap::records::{Record, op};
use mcap::sans_io::{LinearReadEvent, LinearReader, LinearReaderOptions};

/// What every record begins with: its kind and its length.
const RECORD_HEADER: u64 = 9;

/// LZ4 makes of one byte no more than this; a chunk that says otherwise is damaged, and must not
/// make us ask for the memory.
const EXPANSION_MAX: usize = 255;
/// A chunk of this size is never too large, bytes.
const CHUNK_MIN: usize = 64 * 1024;

/// The records of a file in order, those in chunks included; chunks and indexes themselves not.
pub(crate) struct Pieces {
    file: File,
    reader: LinearReader,
    waiting: VecDeque<Record<'static>>,
    ended: bool,
    has_index: bool,
    damaged: u64,
    length: u64,
    whole_to: u64,
}

/// How far a file is whole.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Soundness {
    /// To the end, with an index.
    pub(crate) whole: bool,
    /// Chunks and attachments that do not fit their checksums.
    pub(crate) damaged: u64,
    /// Bytes at the end that are no whole record.
    pub(crate) cut_bytes: u64,
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
            .with_check_finishes_after_end_magic(true)
            .with_record_length_limit(limit);
        Ok(Pieces {
            file,
            reader: LinearReader::new_with_options(options),
            waiting: VecDeque::new(),
            ended: false,
            has_index: false,
            damaged: 0,
            length,
            whole_to: 0,
        })
    }

    /// How far the file was whole; known once there are no more pieces.
    pub(crate) fn soundness(&self) -> Soundness {
        let cut_bytes = self.length - self.whole_to.min(self.length);
        let whole = self.has_index && self.damaged == 0 && cut_bytes == 0;
        Soundness { whole, damaged: self.damaged, cut_bytes }
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
                    let found = match opcode {
                        op::CHUNK => records_of_chunk(data),
                        _ => parsed(opcode, data).map(|record| VecDeque::from([record])),
                    };
                    match found {
                        Some(records) => self.waiting = records,
                        None => self.damaged += 1,
                    }
                    return Ok(());
                }
                Err(_) => {
                    self.ended = true;
                    return Ok(());
                }
            }
        }
        // Only a file that ends as it should comes here: the magic stands at its end as well.
        self.whole_to += MAGIC.len() as u64;
        self.ended = true;
        Ok(())
    }
}

impl Iterator for Pieces {
    type Item = io::Result<Record<'static>>;

    fn next(&mut self) -> Option<io::Result<Record<'static>>> {
        loop {
            match self.waiting.pop_front() {
                Some(Record::Footer(footer)) => self.has_index = footer.summary_start > 0,
                Some(record) => return Some(Ok(record)),
                None if self.ended => return None,
                None => {
                    if let Err(error) = self.read() {
                        self.ended = true;
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

/// `None` if this is not what its kind says.
fn parsed(opcode: u8, body: &[u8]) -> Option<Record<'static>> {
    // The crate cuts the checksum off an attachment before it knows that there is one.
    if opcode == op::ATTACHMENT && !attachment_fits(body) {
        return None;
    }
    mcap::parse_record(opcode, body).ok().map(Record::into_owned)
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
