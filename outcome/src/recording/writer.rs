//! Writes a file of MCAP from its beginning to its end: data, then the summary by which readers find
//! their way. What is in the file is whole up to a point at every moment, and nothing in it is
//! changed later.
//!
//! The crate `mcap` can write too, but compresses, sums and indexes each message by itself, which
//! makes an instant four times as dear. Here that is done chunk by chunk. A piece goes into the file
//! in one write; where that fails, the next try begins at the same place.

use std::collections::BTreeMap;
use std::fs::File;
use std::io;
use std::os::unix::fs::FileExt;
use std::path::Path;

use mcap::MAGIC;
use mcap::records::{AttachmentHeader, Channel, MessageHeader, Metadata, SchemaHeader, op};

use crate::recording::chunk::{Chunk, MESSAGE_HEADER};
use crate::recording::records::Records;

/// Why a record was not written.
#[derive(Debug, thiserror::Error)]
pub(crate) enum WriteError {
    /// The file's reasons, which have words already.
    #[error(transparent)]
    File(#[from] io::Error),
    /// Zero stands for no schema.
    #[error("schema \"{0}\" has the id 0; expected 1 or more")]
    SchemaWithoutId(String),
    /// Its id is taken.
    #[error("schema {0} is in the file already, and not the same; expected another id")]
    OtherSchema(u16),
    /// Its id is taken.
    #[error("channel {0} is in the file already, and not the same; expected another id")]
    OtherChannel(u16),
    /// A channel is of a schema that was not written.
    #[error("channel {channel} is of schema {schema}; expected a schema of the file")]
    UnknownSchema {
        /// Which channel.
        channel: u16,
        /// Its schema.
        schema: u16,
    },
    /// A message is on a channel that was not written.
    #[error("a message is on channel {0}; expected a channel of the file")]
    UnknownChannel(u16),
}

impl From<WriteError> for io::Error {
    fn from(error: WriteError) -> io::Error {
        match error {
            WriteError::File(error) => error,
            other => io::Error::other(other),
        }
    }
}

/// A file being written. Dropped without [`Writer::finish`] it still gets its end.
pub(crate) struct Writer {
    file: Output,
    /// The next piece of the file, put together.
    out: Records,
    chunk: Chunk,
    schemas: BTreeMap<u16, Records>,
    /// By their ids.
    channels: Vec<Option<KnownChannel>>,
    /// Of the first and the last message by their stamps, ns since 1970.
    stamps_ns: Option<(u64, u64)>,
    chunks: Index,
    attachments: Index,
    metadata: Index,
    finished: bool,
}

/// A channel of the file.
struct KnownChannel {
    record: Records,
    messages: u64,
}

/// Where all of a kind are.
#[derive(Default)]
struct Index {
    count: u32,
    records: Records,
}

/// The file, with its end.
struct Output {
    file: File,
    end: u64,
}

impl Output {
    /// Puts `bytes` behind the last ones that were written in full.
    fn append(&mut self, bytes: &[u8]) -> io::Result<()> {
        self.file.write_all_at(bytes, self.end)?;
        self.end += bytes.len() as u64;
        Ok(())
    }
}

impl Writer {
    /// Begins a file, which must not exist.
    pub(crate) fn create(path: &Path, profile: &str) -> io::Result<Writer> {
        let mut file = Output { file: File::create_new(path)?, end: 0 };
        let mut out = Records::default();
        out.bytes(MAGIC);
        out.record(op::HEADER, |record| {
            record.text(profile);
            record.text(concat!("phalanx ", env!("CARGO_PKG_VERSION")));
        });
        file.append(out.as_bytes())?;
        Ok(Writer {
            file,
            out,
            chunk: Chunk::new(),
            schemas: BTreeMap::new(),
            channels: Vec::new(),
            stamps_ns: None,
            chunks: Index::default(),
            attachments: Index::default(),
            metadata: Index::default(),
            finished: false,
        })
    }

    /// Adds a message type. The same one again is fine.
    pub(crate) fn schema(&mut self, header: &SchemaHeader, data: &[u8]) -> Result<(), WriteError> {
        if header.id == 0 {
            return Err(WriteError::SchemaWithoutId(header.name.clone()));
        }
        let mut schema = Records::default();
        schema.record(op::SCHEMA, |record| {
            record.u16(header.id);
            record.text(&header.name);
            record.text(&header.encoding);
            record.list(|list| list.bytes(data));
        });
        match self.schemas.get(&header.id) {
            Some(known) if known.as_bytes() == schema.as_bytes() => return Ok(()),
            Some(_) => return Err(WriteError::OtherSchema(header.id)),
            None => {}
        }
        self.make_room(schema.len())?;
        self.chunk.add(&schema);
        self.schemas.insert(header.id, schema);
        Ok(())
    }

    /// Adds a channel, whose schema is known. The same one again is fine.
    pub(crate) fn channel(&mut self, channel: &Channel) -> Result<(), WriteError> {
        let &Channel { id, schema_id: schema, .. } = channel;
        if schema != 0 && !self.schemas.contains_key(&schema) {
            return Err(WriteError::UnknownSchema { channel: id, schema });
        }
        let mut record = Records::default();
        record.record(op::CHANNEL, |record| {
            record.u16(id);
            record.u16(schema);
            record.text(&channel.topic);
            record.text(&channel.message_encoding);
            record.texts(&channel.metadata);
        });
        let place = usize::from(id);
        match self.channels.get(place) {
            Some(Some(known)) if known.record.as_bytes() == record.as_bytes() => return Ok(()),
            Some(Some(_)) => return Err(WriteError::OtherChannel(id)),
            Some(None) => {}
            None => self.channels.resize_with(place + 1, || None),
        }
        self.make_room(record.len())?;
        self.chunk.add(&record);
        self.channels[place] = Some(KnownChannel { record, messages: 0 });
        Ok(())
    }

    /// Adds a message, whose channel is known.
    pub(crate) fn message(
        &mut self,
        header: &MessageHeader,
        data: &[u8],
    ) -> Result<(), WriteError> {
        self.make_room(MESSAGE_HEADER + data.len())?;
        match self.channels.get_mut(usize::from(header.channel_id)) {
            Some(Some(channel)) => channel.messages += 1,
            _ => return Err(WriteError::UnknownChannel(header.channel_id)),
        }
        self.chunk.add_message(header, data);
        Ok(())
    }

    /// Attaches a file, behind everything that came before.
    pub(crate) fn attachment(&mut self, header: &AttachmentHeader, data: &[u8]) -> io::Result<()> {
        let AttachmentHeader { log_time, create_time, name, media_type } = header;
        let (offset, length) = self.put(op::ATTACHMENT, |record| {
            let begin = record.len();
            record.u64(*log_time);
            record.u64(*create_time);
            record.text(name);
            record.text(media_type);
            record.counted(|content| content.bytes(data));
            record.u32(crc32fast::hash(&record.as_bytes()[begin..]));
        })?;
        self.attachments.count += 1;
        self.attachments.records.record(op::ATTACHMENT_INDEX, |index| {
            index.u64(offset);
            index.u64(length);
            index.u64(*log_time);
            index.u64(*create_time);
            index.u64(data.len() as u64);
            index.text(name);
            index.text(media_type);
        });
        Ok(())
    }

    /// Adds facts under a name, behind everything that came before.
    pub(crate) fn metadata(&mut self, metadata: &Metadata) -> io::Result<()> {
        let (offset, length) = self.put(op::METADATA, |record| {
            record.text(&metadata.name);
            record.texts(&metadata.metadata);
        })?;
        self.metadata.count += 1;
        self.metadata.records.record(op::METADATA_INDEX, |index| {
            index.u64(offset);
            index.u64(length);
            index.text(&metadata.name);
        });
        Ok(())
    }

    /// Puts a record that is in no chunk behind everything that came before; where, and how long.
    fn put(&mut self, opcode: u8, body: impl FnOnce(&mut Records)) -> io::Result<(u64, u64)> {
        self.flush()?;
        self.out.clear();
        self.out.record(opcode, body);
        let (offset, length) = (self.file.end, self.out.len() as u64);
        self.file.append(self.out.as_bytes())?;
        Ok((offset, length))
    }

    /// Closes the chunk unless a record of `length` bytes still fits into it.
    fn make_room(&mut self, length: usize) -> io::Result<()> {
        if self.chunk.has_room(length) { Ok(()) } else { self.flush() }
    }

    /// Sees to it that everything is in the file.
    pub(crate) fn flush(&mut self) -> io::Result<()> {
        if self.chunk.is_empty() {
            return Ok(());
        }
        let indexed = self.chunks.records.len();
        self.out.clear();
        self.chunk.close(self.file.end, &mut self.out, &mut self.chunks.records);
        if let Err(error) = self.file.append(self.out.as_bytes()) {
            self.chunks.records.truncate(indexed);
            return Err(error);
        }
        self.chunks.count += 1;
        self.stamps_ns = match (self.stamps_ns, self.chunk.stamps_ns()) {
            (Some((first, last)), Some((from, to))) => Some((first.min(from), last.max(to))),
            (before, now) => before.or(now),
        };
        self.chunk.clear();
        Ok(())
    }

    /// Writes the summary, by which the file is whole.
    pub(crate) fn finish(mut self) -> io::Result<()> {
        self.end()
    }

    fn end(&mut self) -> io::Result<()> {
        self.finished = true;
        // Of the data, each chunk has a checksum of its own.
        self.put(op::DATA_END, |record| record.u32(0))?;

        let summary = self.file.end;
        let (mut crc, mut offsets) = (crc32fast::Hasher::new(), Records::default());
        let statistics = self.statistics();
        let (mut schemas, mut channels) = (Records::default(), Records::default());
        self.schemas.values().for_each(|schema| schemas.bytes(schema.as_bytes()));
        self.known_channels().for_each(|(_, known)| channels.bytes(known.record.as_bytes()));
        for (opcode, group) in [
            (op::SCHEMA, &schemas),
            (op::CHANNEL, &channels),
            (op::STATISTICS, &statistics),
            (op::CHUNK_INDEX, &self.chunks.records),
            (op::ATTACHMENT_INDEX, &self.attachments.records),
            (op::METADATA_INDEX, &self.metadata.records),
        ] {
            if !group.is_empty() {
                offsets.record(op::SUMMARY_OFFSET, |record| {
                    record.u8(opcode);
                    record.u64(self.file.end);
                    record.u64(group.len() as u64);
                });
                crc.update(group.as_bytes());
                self.file.append(group.as_bytes())?;
            }
        }

        let summary_offsets = self.file.end;
        let mut end = offsets;
        end.record(op::FOOTER, |record| {
            record.u64(summary);
            record.u64(summary_offsets);
            record.u32(0);
        });
        // The checksum is over everything before it, a part of its own record included.
        end.truncate(end.len() - 4);
        crc.update(end.as_bytes());
        end.u32(crc.finalize());
        end.bytes(MAGIC);
        self.file.append(end.as_bytes())
    }

    fn statistics(&self) -> Records {
        let mut statistics = Records::default();
        let (first_ns, last_ns) = self.stamps_ns.unwrap_or((0, 0));
        statistics.record(op::STATISTICS, |record| {
            record.u64(self.known_channels().map(|(_, known)| known.messages).sum());
            record.u16(self.schemas.len() as u16);
            record.u32(self.known_channels().count() as u32);
            record.u32(self.attachments.count);
            record.u32(self.metadata.count);
            record.u32(self.chunks.count);
            record.u64(first_ns);
            record.u64(last_ns);
            record.list(|list| {
                for (id, known) in self.known_channels().filter(|(_, known)| known.messages > 0) {
                    list.u16(id);
                    list.u64(known.messages);
                }
            });
        });
        statistics
    }

    fn known_channels(&self) -> impl Iterator<Item = (u16, &KnownChannel)> {
        (0..=u16::MAX).zip(&self.channels).filter_map(|(id, known)| Some((id, known.as_ref()?)))
    }
}

impl Drop for Writer {
    fn drop(&mut self) {
        if !self.finished {
            // Whoever gave it up has heard of its trouble, if any.
            let _ = self.end();
        }
    }
}

#[cfg(test)]
mod tests;
