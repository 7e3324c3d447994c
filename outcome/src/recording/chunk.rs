//! The chunk that is being filled: records as they will lie in it, and where each message lies.
//! Checksum and compression are for the whole of it, once, when it is closed: both cost far more
//! when they are fed message by message. What was allocated stays for the next chunk.

use lz4::block::{compress_bound, compress_to_buffer};
use mcap::records::{MessageHeader, op};

use crate::recording::records::Records;

/// How large a chunk may become, bytes, unless a single record is larger. A chunk that a kill cuts is
/// lost; and small ones are quick to look something up in.
const SIZE_MAX: usize = 64 * 1024;
/// What a message is besides its data: kind, length, channel, number and two stamps; bytes.
pub(crate) const MESSAGE_HEADER: usize = 9 + 22;
/// How the chunk says what its frame is.
const COMPRESSION: &str = "lz4";

/// How a frame of LZ4 begins: version 1, blocks that do not need each other, of 64 KiB at most, no
/// checksum, for the chunk has one. The last byte vouches for the two before it.
const FRAME: [u8; 7] = [0x04, 0x22, 0x4d, 0x18, 0x60, 0x40, 0x82];
/// The largest block of such a frame, bytes.
const BLOCK_MAX: usize = 64 * 1024;
/// Says in a block's length that the block is as it was.
const UNCOMPRESSED: u32 = 1 << 31;
/// Ends a frame.
const NO_BLOCK: u32 = 0;

pub(crate) struct Chunk {
    records: Records,
    /// Of the first and the last message by their stamps, ns since 1970.
    stamps_ns: Option<(u64, u64)>,
    /// Of each channel by its id: stamp and place of its messages, as the index has them.
    entries: Vec<Records>,
    /// A block, compressed.
    block: Vec<u8>,
}

impl Chunk {
    pub(crate) fn new() -> Chunk {
        let bound = compress_bound(BLOCK_MAX).expect("64 KiB are not too much");
        Chunk {
            records: Records::default(),
            stamps_ns: None,
            entries: Vec::new(),
            block: vec![0; bound],
        }
    }

    pub(crate) fn is_empty(&self) -> bool {
        self.records.is_empty()
    }

    /// Whether a record of `length` bytes still fits.
    pub(crate) fn has_room(&self, length: usize) -> bool {
        self.is_empty() || self.records.len() + length <= SIZE_MAX
    }

    /// Of the first and the last message by their stamps, ns since 1970.
    pub(crate) fn stamps_ns(&self) -> Option<(u64, u64)> {
        self.stamps_ns
    }

    /// Adds a whole record, of a schema or a channel.
    pub(crate) fn add(&mut self, record: &Records) {
        self.records.bytes(record.as_bytes());
    }

    pub(crate) fn add_message(&mut self, header: &MessageHeader, data: &[u8]) {
        let &MessageHeader { channel_id, sequence, log_time, publish_time } = header;
        let channel = usize::from(channel_id);
        if self.entries.len() <= channel {
            self.entries.resize_with(channel + 1, Records::default);
        }
        let mut entry = [0; 16];
        entry[..8].copy_from_slice(&log_time.to_le_bytes());
        entry[8..].copy_from_slice(&(self.records.len() as u64).to_le_bytes());
        self.entries[channel].bytes(&entry);
        let (first_ns, last_ns) = self.stamps_ns.unwrap_or((log_time, log_time));
        self.stamps_ns = Some((first_ns.min(log_time), last_ns.max(log_time)));
        // In one piece: nothing else is written as often.
        let mut begin = [op::MESSAGE; MESSAGE_HEADER];
        begin[1..9].copy_from_slice(&((MESSAGE_HEADER - 9 + data.len()) as u64).to_le_bytes());
        begin[9..11].copy_from_slice(&channel_id.to_le_bytes());
        begin[11..15].copy_from_slice(&sequence.to_le_bytes());
        begin[15..23].copy_from_slice(&log_time.to_le_bytes());
        begin[23..].copy_from_slice(&publish_time.to_le_bytes());
        self.records.bytes(&begin);
        self.records.bytes(data);
    }

    /// Puts the chunk and its message indexes into `out`, which begins at `offset` in the file, and
    /// what leads to them into `chunk_indexes`.
    pub(crate) fn close(&mut self, offset: u64, out: &mut Records, chunk_indexes: &mut Records) {
        let (first_ns, last_ns) = self.stamps_ns.unwrap_or((0, 0));
        let size = self.records.len() as u64;
        let mut compressed_size = 0;
        out.record(op::CHUNK, |record| {
            record.u64(first_ns);
            record.u64(last_ns);
            record.u64(size);
            record.u32(crc32fast::hash(self.records.as_bytes()));
            record.text(COMPRESSION);
            compressed_size = record.counted(|frame| {
                compress(self.records.as_bytes(), &mut self.block, frame);
            });
        });
        let length = out.len();
        chunk_indexes.record(op::CHUNK_INDEX, |index| {
            index.u64(first_ns);
            index.u64(last_ns);
            index.u64(offset);
            index.u64(length as u64);
            index.list(|places| {
                for (channel_id, entries) in (0..).zip(&self.entries) {
                    if !entries.is_empty() {
                        places.u16(channel_id);
                        places.u64(offset + out.len() as u64);
                        out.record(op::MESSAGE_INDEX, |record| {
                            record.u16(channel_id);
                            record.list(|list| list.bytes(entries.as_bytes()));
                        });
                    }
                }
            });
            index.u64((out.len() - length) as u64);
            index.text(COMPRESSION);
            index.u64(compressed_size);
            index.u64(size);
        });
    }

    /// Begins the next one.
    pub(crate) fn clear(&mut self) {
        self.records.clear();
        self.stamps_ns = None;
        self.entries.iter_mut().for_each(Records::clear);
    }
}

/// Puts `bytes` into `frame`, block by block; one that does not become smaller stays as it is.
fn compress(bytes: &[u8], block: &mut [u8], frame: &mut Records) {
    frame.bytes(&FRAME);
    for part in bytes.chunks(BLOCK_MAX) {
        match compress_to_buffer(part, None, false, block) {
            Ok(size) if size < part.len() => {
                frame.u32(size as u32);
                frame.bytes(&block[..size]);
            }
            _ => {
                frame.u32(part.len() as u32 | UNCOMPRESSED);
                frame.bytes(part);
            }
        }
    }
    frame.u32(NO_BLOCK);
}
