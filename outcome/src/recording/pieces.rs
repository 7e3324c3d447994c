//! What is in a file, piece by piece, as far as it is whole: a killed supervisor leaves no index and
//! perhaps half a chunk, a bad disk a chunk that does not fit its checksum.
//!
//! A damaged piece is left out. Where its length is wrong, reading goes on at the next chunk that fits its checksum, or
//! where the index begins. No length is trusted for an allocation.

use std::collections::VecDeque;
use std::fmt;
use std::fs::File;
use std::io::{self, Read, Seek, SeekFrom};
use std::os::unix::fs::FileExt;
use std::path::Path;

use mcap::records::{Record, op};
use mcap::sans_io::{LinearReadEvent, LinearReader, LinearReaderOptions};
use mcap::{MAGIC, McapError};
use protocol::regular_file::{self, Links};

use crate::results::checksums::listed_beside;

/// What every record begins with: its kind and its length.
const RECORD_HEADER: u64 = 9;
/// Kinds of records below this are MCAP's own, from this on anybody's.
const PRIVATE: u8 = 0x80;

/// LZ4 makes of one byte no more than this; a chunk that says otherwise is damaged, and must not
/// make us ask for the memory.
const EXPANSION_MAX: usize = 255;
/// A chunk of this size is never too large, bytes.
const CHUNK_MIN: usize = 64 * 1024;
/// No record is larger, bytes, nor what is in a chunk: the recorder's chunks have 256 KiB, and the largest attachment is
/// a scenario.
const RECORD_MAX: usize = 64 << 20;
/// How much is read at a time, bytes: memory grows with what is there, not with what a length says.
const READ_MAX: usize = 64 * 1024;
/// While the next sound chunk is looked for, no more than so many times the file is read again.
const LOOKS_MAX: u64 = 4;

/// The records of a file in order, those in chunks included; chunks themselves not.
pub(crate) struct Pieces {
    file: File,
    reader: LinearReader,
    waiting: VecDeque<Record<'static>>,
    reads_on: bool,
    length: u64,
    soundness: Soundness,
    whole_to: u64,
    /// Bytes that were read to find out where to go on.
    looked_at: u64,
    /// Stamps of the oldest and the newest message so far, ns since 1970.
    stamps_ns: Option<(u64, u64)>,
    /// Messages are missing behind the newest.
    is_gap: bool,
    /// Its run wrote it to its end: the checksums of a run are written after it.
    had_end: bool,
}

/// How far a file is whole.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct Soundness {
    /// Records that are not what they say, or do not fit their checksums.
    pub damaged: u64,
    /// Run time of which messages are missing in the middle, or up to an end that is known, ns.
    pub lost_ns: u64,
    /// Bytes at the end that are no whole record.
    pub cut_bytes: u64,
    /// What is cut off at the end was no mere index.
    pub cuts_data: bool,
    /// The checksum over all data, or that over the index, does not fit.
    pub misfits: bool,
    /// There is an index, and the end is where it should be.
    pub has_end: bool,
    /// There is the record behind which no data follow.
    pub data_ended: bool,
    /// There is a checksum over all data and one over the index: without them nothing is known of what is outside of
    /// chunks and attachments.
    pub has_checksums: bool,
}

impl Soundness {
    /// Whether nothing is known to be lost or changed.
    pub fn is_whole(&self) -> bool {
        self.has_end && self.damaged == 0 && self.cut_bytes == 0 && !self.misfits
    }

    /// Whether something is lost or changed that had been written, and not just never came to its end.
    pub fn is_damaged(&self) -> bool {
        self.damaged > 0 || self.misfits || self.cuts_data
    }
}

/// What is wrong.
impl fmt::Display for Soundness {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let &Soundness { damaged, lost_ns, cut_bytes, misfits, has_end, .. } = self;
        let no_end = match (self.data_ended, self.cuts_data) {
            (true, _) => "it has no index",
            (false, true) => "its end is lost: the run had written more",
            (false, false) => "it has no end, and whether more was written is not known",
        };
        let faults = [
            (damaged > 0, format!("damaged chunks or other records: {damaged}")),
            (lost_ns > 0, format!("seconds lost: {:.3}", formation::seconds(lost_ns))),
            (cut_bytes > 0, format!("bytes at the end that are cut: {cut_bytes}")),
            (misfits, "a checksum over the whole does not fit".to_owned()),
            (!has_end && cut_bytes == 0 && !misfits, no_end.to_owned()),
        ];
        let faults: Vec<String> =
            faults.into_iter().filter_map(|(is_so, words)| is_so.then_some(words)).collect();
        f.write_str(&faults.join("; "))
    }
}

impl Pieces {
    pub(crate) fn open(path: &Path) -> io::Result<Pieces> {
        let file = regular_file::open(path, Links::Followed)?;
        let length = file.metadata()?.len();
        Ok(Pieces {
            file,
            reader: reader(true),
            waiting: VecDeque::new(),
            reads_on: true,
            length,
            soundness: Soundness { has_checksums: true, ..Soundness::default() },
            whole_to: 0,
            looked_at: 0,
            stamps_ns: None,
            is_gap: false,
            had_end: listed_beside(path).is_some(),
        })
    }

    /// How far the file was whole; known once there are no more pieces.
    pub(crate) fn soundness(&self) -> Soundness {
        let ends_too_early = self.had_end && !self.soundness.data_ended;
        Soundness { cuts_data: self.soundness.cuts_data || ends_too_early, ..self.soundness }
    }

    /// Takes in the next record of the file itself, or finds its end, or where it is cut.
    fn read(&mut self) -> io::Result<()> {
        while let Some(event) = self.reader.next_event() {
            match event {
                Ok(LinearReadEvent::ReadRequest(wanted)) => {
                    let read = loop {
                        match self.file.read(self.reader.insert(wanted.min(READ_MAX))) {
                            Err(error) if error.kind() == io::ErrorKind::Interrupted => {}
                            other => break other?,
                        }
                    };
                    self.reader.notify_read(read);
                }
                Ok(LinearReadEvent::Record { opcode, data }) => {
                    let begin = self.whole_to.max(MAGIC.len() as u64);
                    self.whole_to = begin + RECORD_HEADER + data.len() as u64;
                    let records = match opcode {
                        op::CHUNK => records_of_chunk(data),
                        // No writer of ours puts one there, where it has no checksum of its own: it was something else.
                        op::MESSAGE => None,
                        _ => parsed(opcode, data).map(|record| VecDeque::from([record])),
                    };
                    let length = chunk_length(data).filter(|_| opcode == op::CHUNK);
                    let is_padded = length.is_some_and(|length| length < data.len() as u64);
                    match records {
                        Some(records) => {
                            self.waiting = records;
                            // No writer pads chunks: the length is wrong, and more of the file follows.
                            if let Some(length) = length.filter(|_| is_padded) {
                                self.soundness.damaged += 1;
                                return self.go_on_at(begin + RECORD_HEADER + length);
                            }
                        }
                        None if opcode == op::CHUNK && self.header(self.whole_to)?.is_none() => {
                            self.whole_to = begin;
                            return self.go_on_behind_damage();
                        }
                        None => {
                            self.soundness.damaged += 1;
                            self.is_gap |= opcode == op::CHUNK;
                        }
                    }
                    return Ok(());
                }
                // What the index says is still to come.
                Err(McapError::BadDataCrc { .. }) => {
                    self.soundness.misfits = true;
                    return self.go_on_at(self.whole_to);
                }
                Err(McapError::BadSummaryCrc { .. }) => {
                    self.soundness.misfits = true;
                    self.reads_on = false;
                    return Ok(());
                }
                Err(_) => return self.go_on_behind_damage(),
            }
        }
        // Only a file that ends as it should comes here.
        self.reads_on = false;
        Ok(())
    }

    /// Reads on behind a record whose length is wrong, where that can be; if not, the file is cut there.
    fn go_on_behind_damage(&mut self) -> io::Result<()> {
        // In the index nothing would be gained by it.
        let next =
            if self.soundness.data_ended { None } else { self.next_sound(self.whole_to + 1)? };
        if let Some(at) = next {
            self.soundness.damaged += 1;
            self.is_gap = true;
            return self.go_on_at(at);
        }
        self.soundness.cut_bytes = self.length - self.whole_to.min(self.length);
        self.soundness.cuts_data = self.soundness.cut_bytes > 0 && !self.soundness.data_ended;
        self.soundness.has_end = false;
        self.reads_on = false;
        Ok(())
    }

    /// The next place at which something sound begins.
    fn next_sound(&mut self, mut at: u64) -> io::Result<Option<u64>> {
        let mut block = vec![0; READ_MAX];
        loop {
            let read = self.file.read_at(&mut block, at)?;
            for (place, &kind) in block[..read].iter().enumerate() {
                let may_begin = matches!(kind, op::CHUNK | op::DATA_END);
                if may_begin && self.is_sound(at + place as u64)? {
                    return Ok(Some(at + place as u64));
                }
            }
            if read == 0 {
                return Ok(None);
            }
            at += read as u64;
        }
    }

    /// Kind and length of the record that begins there; `None` if none can.
    fn header(&self, at: u64) -> io::Result<Option<(u8, u64)>> {
        let Some(rest) = self.length.checked_sub(at + RECORD_HEADER) else { return Ok(None) };
        let mut header = [0; RECORD_HEADER as usize];
        self.file.read_exact_at(&mut header, at)?;
        let length = u64::from_le_bytes(header[1..].try_into().expect("8 bytes"));
        let is_one = (op::HEADER..=op::DATA_END).contains(&header[0]) && length <= rest;
        Ok(is_one.then_some((header[0], length)))
    }

    /// Whether a chunk is there that fits its checksum, or the end of all data.
    fn is_sound(&mut self, at: u64) -> io::Result<bool> {
        let length = match self.header(at)? {
            Some((op::DATA_END, length)) => return Ok(length == 4),
            Some((op::CHUNK, length)) if length <= RECORD_MAX as u64 => length,
            _ => return Ok(false),
        };
        if self.looked_at + length > LOOKS_MAX * self.length {
            return Ok(false);
        }
        self.looked_at += length;
        let mut body = vec![0; length as usize];
        self.file.read_exact_at(&mut body, at + RECORD_HEADER)?;
        Ok(records_of_chunk(&body).is_some())
    }

    fn go_on_at(&mut self, at: u64) -> io::Result<()> {
        self.file.seek(SeekFrom::Start(at))?;
        self.reader = reader(false);
        self.whole_to = at;
        Ok(())
    }

    /// Takes note of when a message was, and of the time without messages before it.
    fn note(&mut self, stamp_ns: u64) {
        let (first_ns, last_ns) = self.stamps_ns.unwrap_or((stamp_ns, stamp_ns));
        if std::mem::take(&mut self.is_gap) {
            self.soundness.lost_ns += stamp_ns.saturating_sub(last_ns);
        }
        self.stamps_ns = Some((first_ns.min(stamp_ns), last_ns.max(stamp_ns)));
    }
}

/// A reader of the file, from its first byte or from a record in the middle.
fn reader(from_the_start: bool) -> LinearReader {
    let options = LinearReaderOptions::default()
        .with_emit_chunks(true)
        .with_skip_start_magic(!from_the_start)
        .with_validate_data_section_crc(from_the_start)
        .with_validate_summary_section_crc(true)
        .with_check_finishes_after_end_magic(true)
        .with_record_length_limit(RECORD_MAX);
    LinearReader::new_with_options(options)
}

impl Iterator for Pieces {
    type Item = io::Result<Record<'static>>;

    fn next(&mut self) -> Option<io::Result<Record<'static>>> {
        loop {
            match self.waiting.pop_front() {
                Some(Record::DataEnd(end)) => {
                    self.soundness.data_ended = true;
                    self.soundness.has_checksums &= end.data_section_crc != 0;
                }
                Some(Record::Message { header, data }) => {
                    self.note(header.log_time);
                    return Some(Ok(Record::Message { header, data }));
                }
                Some(Record::Statistics(said)) if said.message_count > 0 => {
                    let (start_ns, end_ns) = (said.message_start_time, said.message_end_time);
                    let (first_ns, last_ns) = self.stamps_ns.unwrap_or((end_ns, start_ns));
                    let lost_ns =
                        first_ns.saturating_sub(start_ns) + end_ns.saturating_sub(last_ns);
                    if self.soundness.is_damaged() {
                        self.soundness.lost_ns = self.soundness.lost_ns.saturating_add(lost_ns);
                    }
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
        .with_record_length_limit((body.len() * EXPANSION_MAX).clamp(CHUNK_MIN, RECORD_MAX));
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

/// How long a chunk is by the length of what is compressed in it.
fn chunk_length(body: &[u8]) -> Option<u64> {
    let behind_name = Field::Text.skip(body.get(28..)?)?;
    let compressed = u64::from_le_bytes(*behind_name.first_chunk()?);
    compressed.checked_add((body.len() - behind_name.len() + 8) as u64)
}

/// How a record of this kind and length begins.
fn framed(opcode: u8, length: usize) -> [u8; RECORD_HEADER as usize] {
    let mut header = [opcode; RECORD_HEADER as usize];
    header[1..].copy_from_slice(&(length as u64).to_le_bytes());
    header
}

/// `None` if this is not what its kind says, or of a kind that MCAP does not have.
fn parsed(opcode: u8, body: &[u8]) -> Option<Record<'static>> {
    if !lengths_fit(opcode, body) {
        return None;
    }
    match mcap::parse_record(opcode, body).ok()? {
        Record::Unknown { opcode, .. } if opcode < PRIVATE => None,
        record => Some(record.into_owned()),
    }
}

/// What a record has in it, as far as lengths matter.
#[derive(Clone, Copy)]
enum Field {
    /// So many bytes.
    Bytes(usize),
    /// Text or a list, behind its length in 4 bytes.
    Text,
    /// Names and values, all of them text, behind the length of all in 4 bytes.
    Texts,
    /// Bytes behind their length in 8 bytes.
    Data,
}

/// Whether all that a record says the length of is there: the crate reserves memory for it before it looks.
fn lengths_fit(opcode: u8, body: &[u8]) -> bool {
    use Field::{Bytes, Data, Text, Texts};
    let fields: &[Field] = match opcode {
        op::HEADER => &[Text, Text],
        op::SCHEMA => &[Bytes(2), Text, Text, Text],
        op::CHANNEL => &[Bytes(4), Text, Text, Texts],
        op::CHUNK_INDEX => &[Bytes(32), Text, Bytes(8), Text, Bytes(16)],
        op::ATTACHMENT => &[Bytes(16), Text, Text, Data, Bytes(4)],
        op::ATTACHMENT_INDEX => &[Bytes(40), Text, Text],
        op::METADATA => &[Text, Texts],
        op::METADATA_INDEX => &[Bytes(16), Text],
        _ => &[],
    };
    fields.iter().try_fold(body, |rest, field| field.skip(rest)).is_some()
}

impl Field {
    /// What is behind it; `None` if it does not fit.
    fn skip(self, rest: &[u8]) -> Option<&[u8]> {
        match self {
            Field::Bytes(length) => rest.get(length..),
            Field::Text => {
                let (length, rest) = rest.split_first_chunk()?;
                rest.get(u32::from_le_bytes(*length) as usize..)
            }
            Field::Texts => {
                let behind = Field::Text.skip(rest)?;
                let mut texts = &rest[4..rest.len() - behind.len()];
                while !texts.is_empty() {
                    texts = Field::Text.skip(texts).and_then(|value| Field::Text.skip(value))?;
                }
                Some(behind)
            }
            Field::Data => {
                let (length, rest) = rest.split_first_chunk()?;
                rest.get(usize::try_from(u64::from_le_bytes(*length)).ok()?..)
            }
        }
    }
}
