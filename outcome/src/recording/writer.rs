//! Writer of an MCAP file: data, then the summary that readers use as an index. At every moment the file is valid
//! up to a point, and written bytes are never changed. Checksums cover every byte.
//!
//! The crate `mcap` has a writer too, which updates compression and checksums with each field of each message. In a
//! lockstep run of 64 robots that takes 7 % more processor time for the whole run (docs/performance.md). This
//! writer works chunk by chunk; the content of records, except messages, is encoded by the crate. Each block is
//! written in one call; after an error the next attempt begins at the same offset.

use std::collections::BTreeMap;
use std::fs::File;
use std::io;
use std::os::unix::fs::FileExt;
use std::path::Path;

use mcap::MAGIC;
use mcap::records::{
    AttachmentHeader, AttachmentIndex, Channel, DataEnd, Header, Metadata, MetadataIndex,
    SchemaHeader, Statistics, SummaryOffset, op,
};

use crate::recording::chunk::Chunk;
use crate::recording::records::{append_record, encode_content};

/// MCAP file in progress. If it is dropped without [`Writer::finish`], the summary is written then.
pub(crate) struct RecordingWriter {
    file: OutputFile,
    chunk: Chunk,
    schemas: Vec<u8>,
    channels: Vec<u8>,
    /// Number of messages per channel.
    message_counts: Vec<u64>,
    statistics: Statistics,
    chunk_indexes: Vec<u8>,
    attachment_indexes: Vec<u8>,
    metadata_indexes: Vec<u8>,
    is_finished: bool,
}

/// The file and its valid length.
struct OutputFile {
    file: File,
    valid_length: u64,
    /// CRC-32 of all bytes written in the current section.
    crc: crc32fast::Hasher,
}

impl OutputFile {
    /// Writes `bytes` at the end of the valid data. Returns their offset.
    fn append(&mut self, bytes: &[u8]) -> io::Result<u64> {
        let offset = self.valid_length;
        self.file.write_all_at(bytes, offset)?;
        self.valid_length += bytes.len() as u64;
        self.crc.update(bytes);
        Ok(offset)
    }
}

impl RecordingWriter {
    /// Creates a file, which must not exist.
    pub(crate) fn create(path: &Path, profile: &str) -> io::Result<RecordingWriter> {
        let crc = crc32fast::Hasher::new();
        let mut file = OutputFile { file: File::create_new(path)?, valid_length: 0, crc };
        let library = concat!("phalanx ", env!("CARGO_PKG_VERSION")).to_owned();
        let mut file_start = MAGIC.to_vec();
        append_record(
            &mut file_start,
            op::HEADER,
            &[&encode_content(&Header { profile: profile.into(), library })],
        );
        file.append(&file_start)?;
        Ok(RecordingWriter {
            file,
            chunk: Chunk::new(),
            schemas: Vec::new(),
            channels: Vec::new(),
            message_counts: Vec::new(),
            statistics: Statistics::default(),
            chunk_indexes: Vec::new(),
            attachment_indexes: Vec::new(),
            metadata_indexes: Vec::new(),
            is_finished: false,
        })
    }

    /// Registers a message schema and returns its ID.
    pub(crate) fn register_schema(
        &mut self,
        name: &str,
        encoding: &str,
        data: &[u8],
    ) -> io::Result<u16> {
        let id = self.statistics.schema_count + 1;
        let header = SchemaHeader { id, name: name.into(), encoding: encoding.into() };
        let length = (data.len() as u32).to_le_bytes();
        let record_start = self.schemas.len();
        append_record(&mut self.schemas, op::SCHEMA, &[&encode_content(&header), &length, data]);
        self.statistics.schema_count = id;
        self.ensure_space(self.schemas.len() - record_start)?;
        self.chunk.add_record(&self.schemas[record_start..]);
        Ok(id)
    }

    /// Registers a channel of CDR messages and returns its ID.
    ///
    /// # Errors
    ///
    /// The file has 65536 channels already, or cannot be written.
    pub(crate) fn register_channel(
        &mut self,
        schema_id: u16,
        topic: &str,
        metadata: BTreeMap<String, String>,
    ) -> io::Result<u16> {
        let too_many = |_| io::Error::other("it has more than the 65536 channels of an MCAP file");
        let id = u16::try_from(self.message_counts.len()).map_err(too_many)?;
        let (topic, message_encoding) = (topic.to_owned(), "cdr".to_owned());
        let channel = Channel { id, schema_id, topic, message_encoding, metadata };
        let record_start = self.channels.len();
        append_record(&mut self.channels, op::CHANNEL, &[&encode_content(&channel)]);
        self.message_counts.push(0);
        self.ensure_space(self.channels.len() - record_start)?;
        self.chunk.add_record(&self.channels[record_start..]);
        Ok(id)
    }

    /// Adds a message with its sequence number to a registered channel.
    pub(crate) fn add_message(
        &mut self,
        channel: u16,
        sequence: u32,
        stamp_ns: u64,
        data: &[u8],
    ) -> io::Result<()> {
        self.ensure_space(data.len())?;
        self.message_counts[usize::from(channel)] += 1;
        self.chunk.add_message(channel, sequence, stamp_ns, data);
        Ok(())
    }

    /// Flushes and appends an attachment.
    pub(crate) fn append_attachment(
        &mut self,
        header: AttachmentHeader,
        data: &[u8],
    ) -> io::Result<()> {
        let mut content = encode_content(&header);
        content.extend((data.len() as u64).to_le_bytes());
        content.extend_from_slice(data);
        let crc = crc32fast::hash(&content).to_le_bytes();
        let (offset, length) = self.append_record(op::ATTACHMENT, &[&content, &crc])?;
        let AttachmentHeader { log_time, create_time, name, media_type } = header;
        let data_size = data.len() as u64;
        let index =
            AttachmentIndex { offset, length, log_time, create_time, data_size, name, media_type };
        append_record(
            &mut self.attachment_indexes,
            op::ATTACHMENT_INDEX,
            &[&encode_content(&index)],
        );
        self.statistics.attachment_count += 1;
        Ok(())
    }

    /// Flushes and appends named metadata.
    pub(crate) fn append_metadata(&mut self, metadata: &Metadata) -> io::Result<()> {
        let (offset, length) = self.append_record(op::METADATA, &[&encode_content(metadata)])?;
        let index = MetadataIndex { offset, length, name: metadata.name.clone() };
        append_record(&mut self.metadata_indexes, op::METADATA_INDEX, &[&encode_content(&index)]);
        self.statistics.metadata_count += 1;
        Ok(())
    }

    /// Flushes and appends a record outside of chunks. Returns its offset and length.
    fn append_record(&mut self, opcode: u8, parts: &[&[u8]]) -> io::Result<(u64, u64)> {
        self.flush()?;
        let mut out = Vec::new();
        append_record(&mut out, opcode, parts);
        Ok((self.file.append(&out)?, out.len() as u64))
    }

    /// Closes the chunk unless a record of about `length` bytes still fits into it.
    fn ensure_space(&mut self, length: usize) -> io::Result<()> {
        if self.chunk.has_space(length) { Ok(()) } else { self.flush() }
    }

    /// Writes the chunk in progress to the file.
    pub(crate) fn flush(&mut self) -> io::Result<()> {
        if self.chunk.is_empty() {
            return Ok(());
        }
        let (encoded_chunk, index) = self.chunk.close(self.file.valid_length);
        self.file.append(encoded_chunk)?;
        append_record(&mut self.chunk_indexes, op::CHUNK_INDEX, &[&encode_content(&index)]);
        let statistics = &mut self.statistics;
        statistics.chunk_count += 1;
        if let Some((first_ns, last_ns)) = self.chunk.stamps_ns() {
            let is_first_chunk = statistics.message_end_time == 0;
            let start_ns = if is_first_chunk { first_ns } else { statistics.message_start_time };
            statistics.message_start_time = start_ns.min(first_ns);
            statistics.message_end_time = statistics.message_end_time.max(last_ns);
        }
        self.chunk.clear();
        Ok(())
    }

    /// Writes the summary, which completes the file.
    pub(crate) fn finish(mut self) -> io::Result<()> {
        self.write_end()
    }

    fn write_end(&mut self) -> io::Result<()> {
        self.is_finished = true;
        self.flush()?;
        let data_section_crc = self.file.crc.clone().finalize();
        self.append_record(op::DATA_END, &[&encode_content(&DataEnd { data_section_crc })])?;

        let summary_start = self.file.valid_length;
        self.file.crc = crc32fast::Hasher::new();
        let counts = (0..).zip(self.message_counts.iter().copied()).filter(|&(_, count)| count > 0);
        self.statistics.channel_message_counts = counts.collect();
        self.statistics.message_count = self.message_counts.iter().sum();
        self.statistics.channel_count = self.message_counts.len() as u32;
        let (mut statistics, mut offsets) = (Vec::new(), Vec::new());
        append_record(&mut statistics, op::STATISTICS, &[&encode_content(&self.statistics)]);
        for (group_opcode, group) in [
            (op::SCHEMA, &self.schemas),
            (op::CHANNEL, &self.channels),
            (op::STATISTICS, &statistics),
            (op::CHUNK_INDEX, &self.chunk_indexes),
            (op::ATTACHMENT_INDEX, &self.attachment_indexes),
            (op::METADATA_INDEX, &self.metadata_indexes),
        ] {
            if !group.is_empty() {
                let (group_start, group_length) = (self.file.append(group)?, group.len() as u64);
                let offset = SummaryOffset { group_opcode, group_start, group_length };
                append_record(&mut offsets, op::SUMMARY_OFFSET, &[&encode_content(&offset)]);
            }
        }

        // The checksum covers everything before it, including a part of its own record.
        let mut footer = offsets;
        let section_starts =
            [summary_start.to_le_bytes(), self.file.valid_length.to_le_bytes()].concat();
        append_record(&mut footer, op::FOOTER, &[&section_starts, &[0; 4]]);
        footer.truncate(footer.len() - 4);
        self.file.append(&footer)?;
        let crc = self.file.crc.clone().finalize().to_le_bytes();
        self.file.append(&[&crc, MAGIC].concat()).map(drop)
    }
}

impl Drop for RecordingWriter {
    fn drop(&mut self) {
        if !self.is_finished {
            // An error was reported by an earlier call, if there was one.
            let _ = self.write_end();
        }
    }
}

#[cfg(test)]
mod tests;
