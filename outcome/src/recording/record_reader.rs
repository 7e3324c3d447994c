//! Reader of the valid records of a recording that may be damaged: a killed supervisor leaves no index and possibly a
//! partial chunk, a bad disk a chunk that does not match its checksum.
//!
//! Corrupt records are skipped. If the length of a record is wrong, reading continues at the next chunk that
//! matches its checksum, or where the index begins. No length from the file is trusted for an allocation.

use std::collections::VecDeque;
use std::fmt;
use std::fs::File;
use std::io::{self, Read, Seek, SeekFrom};
use std::os::unix::fs::FileExt;
use std::path::Path;

use mcap::records::{Record, op};
use mcap::sans_io::{LinearReadEvent, LinearReader, LinearReaderOptions};
use mcap::{MAGIC, McapError};
use protocol::regular_file::{self, SymlinkPolicy};

use crate::results::files::checksums::read_listed_checksum_next_to;

/// Length of a record header (kind and length), bytes.
const RECORD_HEADER_BYTES: u64 = 9;
/// Lowest record kind that is free for private use. Lower ones are reserved by MCAP.
const PRIVATE_KIND_MIN: u8 = 0x80;

/// Maximum expansion of one compressed byte by LZ4. A chunk that claims more is damaged. The limit bounds the
/// memory that it can request.
const LZ4_EXPANSION_FACTOR_MAX: usize = 255;
/// Chunk size that is always accepted, bytes.
const ACCEPTED_CHUNK_BYTES: usize = 64 * 1024;
/// Maximum size of a record and of the content of a chunk, bytes. The recorder's chunks have 256 KiB, and the
/// largest attachment is a scenario. A larger record counts as damaged.
const RECORD_BYTES_MAX: usize = 64 << 20;
/// Maximum number of bytes per read. Memory grows with the data that exist, not with a claimed length.
const READ_BYTES_MAX: usize = 64 * 1024;
/// Maximum amount of data that is read again to find the next valid chunk, as a multiple of the file size. Beyond
/// it, the rest of the file is given up.
const RESYNC_PASSES_MAX: u64 = 4;

/// Iterator over the records of a file, including those in chunks but without the chunks themselves.
pub(crate) struct RecordReader {
    file: File,
    reader: LinearReader,
    pending_records: VecDeque<Record<'static>>,
    is_reading: bool,
    file_length: u64,
    integrity: Integrity,
    valid_len: u64,
    /// Number of bytes that were read to find valid chunks behind damage.
    resync_bytes: u64,
    /// Stamps of the oldest and the newest message up to now, ns since 1970.
    stamps_ns: Option<(u64, u64)>,
    /// Whether messages are missing after the newest one.
    has_gap: bool,
    /// Whether the run completed the file: the checksums of a run are written after it.
    was_completed: bool,
}

/// Integrity of a recording.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct Integrity {
    /// Number of records that are malformed or do not match their checksums.
    pub damaged_records: u64,
    /// Run time without messages because of damage, in the middle or up to a known end, ns.
    pub lost_time_ns: u64,
    /// Number of bytes at the end that form no complete record.
    pub truncated_bytes: u64,
    /// Whether data, not only the index, is truncated at the end.
    pub is_data_truncated: bool,
    /// Whether the checksum over all data or the one over the index does not match.
    pub has_checksum_mismatch: bool,
    /// Whether the file has an index and ends where it should.
    pub has_end: bool,
    /// Whether the record that ends the data section exists.
    pub has_data_end: bool,
    /// Whether the file has checksums over all data and over the index. Without them, damage outside of chunks and
    /// attachments is not detected.
    pub has_checksums: bool,
}

impl Integrity {
    /// Returns whether the file is complete and no damage is known.
    pub fn is_complete(&self) -> bool {
        self.has_end
            && self.damaged_records == 0
            && self.truncated_bytes == 0
            && !self.has_checksum_mismatch
    }

    /// Returns whether data that had been written was lost or changed. Only a missing end is no damage.
    pub fn is_damaged(&self) -> bool {
        self.damaged_records > 0 || self.has_checksum_mismatch || self.is_data_truncated
    }
}

impl fmt::Display for Integrity {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let &Integrity {
            damaged_records,
            lost_time_ns,
            truncated_bytes,
            has_checksum_mismatch,
            has_end,
            ..
        } = self;
        let missing_end_text = match (self.has_data_end, self.is_data_truncated) {
            (true, _) => "it has no index",
            (false, true) => "its end is lost: the run had written more",
            (false, false) => "it has no end; whether the run wrote more is not known",
        };
        let faults = [
            (damaged_records > 0, format!("damaged chunks or other records: {damaged_records}")),
            (
                lost_time_ns > 0,
                format!("seconds lost: {:.3}", formation::ns_to_seconds(lost_time_ns)),
            ),
            (truncated_bytes > 0, format!("truncated bytes at the end: {truncated_bytes}")),
            (has_checksum_mismatch, "a checksum of the file does not match".to_owned()),
            (
                !has_end && truncated_bytes == 0 && !has_checksum_mismatch,
                missing_end_text.to_owned(),
            ),
        ];
        let faults: Vec<String> = faults
            .into_iter()
            .filter_map(|(is_present, text)| is_present.then_some(text))
            .collect();
        f.write_str(&faults.join("; "))
    }
}

impl RecordReader {
    pub(crate) fn open(path: &Path) -> io::Result<RecordReader> {
        let file = regular_file::open(path, SymlinkPolicy::Followed)?;
        let file_length = file.metadata()?.len();
        Ok(RecordReader {
            file,
            reader: create_linear_reader(true),
            pending_records: VecDeque::new(),
            is_reading: true,
            file_length,
            integrity: Integrity { has_checksums: true, ..Integrity::default() },
            valid_len: 0,
            resync_bytes: 0,
            stamps_ns: None,
            has_gap: false,
            was_completed: read_listed_checksum_next_to(path).is_some(),
        })
    }

    /// Returns the integrity of the file. It is final after the last record.
    pub(crate) fn integrity(&self) -> Integrity {
        let is_end_missing = self.was_completed && !self.integrity.has_data_end;
        Integrity {
            is_data_truncated: self.integrity.is_data_truncated || is_end_missing,
            ..self.integrity
        }
    }

    /// Reads the next record of the file, its end, or the point where it is cut.
    fn read_record(&mut self) -> io::Result<()> {
        while let Some(event) = self.reader.next_event() {
            match event {
                Ok(LinearReadEvent::ReadRequest(requested_bytes)) => {
                    let read = loop {
                        match self
                            .file
                            .read(self.reader.insert(requested_bytes.min(READ_BYTES_MAX)))
                        {
                            Err(error) if error.kind() == io::ErrorKind::Interrupted => {}
                            other => break other?,
                        }
                    };
                    self.reader.notify_read(read);
                }
                Ok(LinearReadEvent::Record { opcode, data }) => {
                    let record_start = self.valid_len.max(MAGIC.len() as u64);
                    self.valid_len = record_start + RECORD_HEADER_BYTES + data.len() as u64;
                    let records = match opcode {
                        op::CHUNK => parse_chunk_records(data),
                        // No own writer puts a message outside of a chunk, where it has no checksum: the record was
                        // another one.
                        op::MESSAGE => None,
                        _ => parse_record(opcode, data).map(|record| VecDeque::from([record])),
                    };
                    let length = chunk_length(data).filter(|_| opcode == op::CHUNK);
                    let is_padded = length.is_some_and(|length| length < data.len() as u64);
                    match records {
                        Some(records) => {
                            self.pending_records = records;
                            // No own writer pads chunks: the length is wrong, and more of the file follows.
                            if let Some(length) = length.filter(|_| is_padded) {
                                self.integrity.damaged_records += 1;
                                return self.seek_to(record_start + RECORD_HEADER_BYTES + length);
                            }
                        }
                        None if opcode == op::CHUNK
                            && self.read_header_at(self.valid_len)?.is_none() =>
                        {
                            self.valid_len = record_start;
                            return self.resync_after_corruption();
                        }
                        None => {
                            self.integrity.damaged_records += 1;
                            self.has_gap |= opcode == op::CHUNK;
                        }
                    }
                    return Ok(());
                }
                // The index, which follows, is still readable.
                Err(McapError::BadDataCrc { .. }) => {
                    self.integrity.has_checksum_mismatch = true;
                    return self.seek_to(self.valid_len);
                }
                Err(McapError::BadSummaryCrc { .. }) => {
                    self.integrity.has_checksum_mismatch = true;
                    self.is_reading = false;
                    return Ok(());
                }
                Err(_) => return self.resync_after_corruption(),
            }
        }
        // Only a file that ends correctly reaches this point.
        self.is_reading = false;
        Ok(())
    }

    /// Continues reading behind a record with a wrong length. Where that is impossible, the file is cut there.
    fn resync_after_corruption(&mut self) -> io::Result<()> {
        // In the index, resynchronization would recover nothing.
        let next_offset = if self.integrity.has_data_end {
            None
        } else {
            self.find_next_valid(self.valid_len + 1)?
        };
        if let Some(offset) = next_offset {
            self.integrity.damaged_records += 1;
            self.has_gap = true;
            return self.seek_to(offset);
        }
        self.integrity.truncated_bytes = self.file_length - self.valid_len.min(self.file_length);
        self.integrity.is_data_truncated =
            self.integrity.truncated_bytes > 0 && !self.integrity.has_data_end;
        self.integrity.has_end = false;
        self.is_reading = false;
        Ok(())
    }

    /// Returns the next offset at which a valid chunk or the end of the data begins.
    fn find_next_valid(&mut self, mut offset: u64) -> io::Result<Option<u64>> {
        let mut block = vec![0; READ_BYTES_MAX];
        loop {
            let read = self.file.read_at(&mut block, offset)?;
            for (i, &kind) in block[..read].iter().enumerate() {
                let is_candidate = matches!(kind, op::CHUNK | op::DATA_END);
                if is_candidate && self.is_valid_at(offset + i as u64)? {
                    return Ok(Some(offset + i as u64));
                }
            }
            if read == 0 {
                return Ok(None);
            }
            offset += read as u64;
        }
    }

    /// Reads kind and length of the record at this offset. Returns `None` if no record can begin there.
    fn read_header_at(&self, offset: u64) -> io::Result<Option<(u8, u64)>> {
        let Some(bytes_after) = self.file_length.checked_sub(offset + RECORD_HEADER_BYTES) else {
            return Ok(None);
        };
        let mut header = [0; RECORD_HEADER_BYTES as usize];
        self.file.read_exact_at(&mut header, offset)?;
        let length = u64::from_le_bytes(header[1..].try_into().expect("8 bytes"));
        let is_record_header =
            (op::HEADER..=op::DATA_END).contains(&header[0]) && length <= bytes_after;
        Ok(is_record_header.then_some((header[0], length)))
    }

    /// Returns whether a chunk that matches its checksum, or the end of all data, begins at this offset.
    fn is_valid_at(&mut self, offset: u64) -> io::Result<bool> {
        let length = match self.read_header_at(offset)? {
            Some((op::DATA_END, length)) => return Ok(length == 4),
            Some((op::CHUNK, length)) if length <= RECORD_BYTES_MAX as u64 => length,
            _ => return Ok(false),
        };
        if self.resync_bytes + length > RESYNC_PASSES_MAX * self.file_length {
            return Ok(false);
        }
        self.resync_bytes += length;
        let mut body = vec![0; length as usize];
        self.file.read_exact_at(&mut body, offset + RECORD_HEADER_BYTES)?;
        Ok(parse_chunk_records(&body).is_some())
    }

    fn seek_to(&mut self, offset: u64) -> io::Result<()> {
        self.file.seek(SeekFrom::Start(offset))?;
        self.reader = create_linear_reader(false);
        self.valid_len = offset;
        Ok(())
    }

    /// Records the stamp of a message, and the time without messages before it.
    fn record_stamp(&mut self, stamp_ns: u64) {
        let (first_ns, last_ns) = self.stamps_ns.unwrap_or((stamp_ns, stamp_ns));
        if std::mem::take(&mut self.has_gap) {
            self.integrity.lost_time_ns += stamp_ns.saturating_sub(last_ns);
        }
        self.stamps_ns = Some((first_ns.min(stamp_ns), last_ns.max(stamp_ns)));
    }
}

/// Creates a reader of the file, from its first byte or from a record in the middle.
fn create_linear_reader(is_from_start: bool) -> LinearReader {
    let options = LinearReaderOptions::default()
        .with_emit_chunks(true)
        .with_skip_start_magic(!is_from_start)
        .with_validate_data_section_crc(is_from_start)
        .with_validate_summary_section_crc(true)
        .with_check_finishes_after_end_magic(true)
        .with_record_length_limit(RECORD_BYTES_MAX);
    LinearReader::new_with_options(options)
}

impl Iterator for RecordReader {
    type Item = io::Result<Record<'static>>;

    fn next(&mut self) -> Option<io::Result<Record<'static>>> {
        loop {
            match self.pending_records.pop_front() {
                Some(Record::DataEnd(data_end)) => {
                    self.integrity.has_data_end = true;
                    self.integrity.has_checksums &= data_end.data_section_crc != 0;
                }
                Some(Record::Message { header, data }) => {
                    self.record_stamp(header.log_time);
                    return Some(Ok(Record::Message { header, data }));
                }
                Some(Record::Statistics(statistics)) if statistics.message_count > 0 => {
                    let (start_ns, end_ns) =
                        (statistics.message_start_time, statistics.message_end_time);
                    let (first_ns, last_ns) = self.stamps_ns.unwrap_or((end_ns, start_ns));
                    let lost_ns =
                        first_ns.saturating_sub(start_ns) + end_ns.saturating_sub(last_ns);
                    if self.integrity.is_damaged() {
                        self.integrity.lost_time_ns =
                            self.integrity.lost_time_ns.saturating_add(lost_ns);
                    }
                }
                Some(Record::Footer(footer)) => {
                    self.integrity.has_end = footer.summary_start > 0;
                    self.integrity.has_checksums &= footer.summary_crc != 0;
                }
                Some(record) => return Some(Ok(record)),
                None if !self.is_reading => return None,
                None => {
                    if let Err(error) = self.read_record() {
                        self.is_reading = false;
                        return Some(Err(error));
                    }
                }
            }
        }
    }
}

/// Parses the records in a chunk. Returns `None` if its checksum does not match.
fn parse_chunk_records(body: &[u8]) -> Option<VecDeque<Record<'static>>> {
    let options = LinearReaderOptions::default()
        .with_skip_start_magic(true)
        .with_skip_end_magic(true)
        .with_prevalidate_chunk_crcs(true)
        .with_record_length_limit(
            (body.len() * LZ4_EXPANSION_FACTOR_MAX).clamp(ACCEPTED_CHUNK_BYTES, RECORD_BYTES_MAX),
        );
    let mut reader = LinearReader::new_with_options(options);
    let header = encode_record_header(op::CHUNK, body.len());
    // The end of data confirms that the chunk was complete.
    let end = [&encode_record_header(op::DATA_END, 4)[..], &[0; 4]].concat();
    let mut bytes = header.chain(body).chain(&end[..]);
    let mut records = VecDeque::new();
    loop {
        match reader.next_event()?.ok()? {
            LinearReadEvent::ReadRequest(requested_bytes) => {
                let read = bytes.read(reader.insert(requested_bytes)).ok()?;
                reader.notify_read(read);
            }
            LinearReadEvent::Record { opcode: op::DATA_END, .. } => return Some(records),
            LinearReadEvent::Record { opcode, data } => {
                records.push_back(parse_record(opcode, data)?)
            }
        }
    }
}

/// Returns the length of a chunk by the length of its compressed data.
fn chunk_length(body: &[u8]) -> Option<u64> {
    let after_name = FieldEncoding::Text.skip(body.get(28..)?)?;
    let compressed_length = u64::from_le_bytes(*after_name.first_chunk()?);
    compressed_length.checked_add((body.len() - after_name.len() + 8) as u64)
}

/// Returns the header of a record of this kind and length.
fn encode_record_header(opcode: u8, length: usize) -> [u8; RECORD_HEADER_BYTES as usize] {
    let mut header = [opcode; RECORD_HEADER_BYTES as usize];
    header[1..].copy_from_slice(&(length as u64).to_le_bytes());
    header
}

/// Parses a record. Returns `None` if it is malformed, or of a kind that MCAP does not define.
fn parse_record(opcode: u8, body: &[u8]) -> Option<Record<'static>> {
    if !lengths_fit(opcode, body) {
        return None;
    }
    match mcap::parse_record(opcode, body).ok()? {
        Record::Unknown { opcode, .. } if opcode < PRIVATE_KIND_MIN => None,
        record => Some(record.into_owned()),
    }
}

/// Field of a record, as far as its length matters.
#[derive(Clone, Copy)]
enum FieldEncoding {
    /// A fixed number of bytes.
    Bytes(usize),
    /// Text or a list, preceded by its length in 4 bytes.
    Text,
    /// Names and values, all of them text, preceded by the total length in 4 bytes.
    TextMap,
    /// Bytes, preceded by their length in 8 bytes.
    Data,
}

/// Returns whether all fields of a record are inside of it. The crate `mcap` allocates memory by these lengths
/// before it checks them.
fn lengths_fit(opcode: u8, body: &[u8]) -> bool {
    use FieldEncoding::{Bytes, Data, Text, TextMap};
    let fields: &[FieldEncoding] = match opcode {
        op::HEADER => &[Text, Text],
        op::SCHEMA => &[Bytes(2), Text, Text, Text],
        op::CHANNEL => &[Bytes(4), Text, Text, TextMap],
        op::CHUNK_INDEX => &[Bytes(32), Text, Bytes(8), Text, Bytes(16)],
        op::ATTACHMENT => &[Bytes(16), Text, Text, Data, Bytes(4)],
        op::ATTACHMENT_INDEX => &[Bytes(40), Text, Text],
        op::METADATA => &[Text, TextMap],
        op::METADATA_INDEX => &[Bytes(16), Text],
        _ => &[],
    };
    fields.iter().try_fold(body, |rest, field| field.skip(rest)).is_some()
}

impl FieldEncoding {
    /// Returns the bytes behind the field; `None` if the field does not fit.
    fn skip(self, rest: &[u8]) -> Option<&[u8]> {
        match self {
            FieldEncoding::Bytes(length) => rest.get(length..),
            FieldEncoding::Text => {
                let (length, rest) = rest.split_first_chunk()?;
                rest.get(u32::from_le_bytes(*length) as usize..)
            }
            FieldEncoding::TextMap => {
                let after_map = FieldEncoding::Text.skip(rest)?;
                let mut texts = &rest[4..rest.len() - after_map.len()];
                while !texts.is_empty() {
                    texts = FieldEncoding::Text
                        .skip(texts)
                        .and_then(|value| FieldEncoding::Text.skip(value))?;
                }
                Some(after_map)
            }
            FieldEncoding::Data => {
                let (length, rest) = rest.split_first_chunk()?;
                rest.get(usize::try_from(u64::from_le_bytes(*length)).ok()?..)
            }
        }
    }
}
