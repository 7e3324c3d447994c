//! Chunk in progress: its records, and the offset of each message. Checksum and compression are computed once per
//! chunk when it is closed, because both cost far more per message. Buffers are reused for the next chunk.

use lz4::block::{compress_bound, compress_to_buffer};
use mcap::records::{ChunkHeader, ChunkIndex, op};

use crate::recording::records::{append_record, encode_content};

/// Maximum size of a chunk, bytes, unless a single record is larger. A kill loses the chunk in progress, and small
/// chunks allow fast access but need a larger index: 64 robots fill 68 KB per instant.
pub(crate) const CHUNK_BYTES_MAX: usize = 256 * 1024;
/// Size of a message without its data, bytes: kind, length, channel, sequence number and two stamps.
const MESSAGE_HEADER_BYTES: usize = 9 + 22;
/// Name of the compression in the chunk header.
const COMPRESSION: &str = "lz4";

/// Header of an LZ4 frame: version 1, independent blocks of at most 64 KiB, no checksum because the chunk has one.
/// The last byte is the checksum of the two before it.
const LZ4_FRAME_HEADER: [u8; 7] = [0x04, 0x22, 0x4d, 0x18, 0x60, 0x40, 0x82];
/// Maximum block size of such a frame, bytes.
const BLOCK_BYTES_MAX: usize = 64 * 1024;
/// Flag in a block's length: the block is not compressed.
const UNCOMPRESSED_FLAG: u32 = 1 << 31;
/// Block length that ends a frame.
const FRAME_END_LENGTH: u32 = 0;

pub(crate) struct Chunk {
    records: Vec<u8>,
    /// Stamps of the oldest and the newest message, ns since 1970.
    stamps_ns: Option<(u64, u64)>,
    /// Index entries of each channel: stamp and offset of its messages.
    index_entries: Vec<Vec<u8>>,
    /// Compressed records.
    lz4_frame: Vec<u8>,
    /// Buffer for a compressed block.
    block_buffer: Vec<u8>,
    /// Chunk and its message indexes, as written to the file.
    encoded_chunk: Vec<u8>,
}

impl Chunk {
    pub(crate) fn new() -> Chunk {
        let bound = compress_bound(BLOCK_BYTES_MAX).expect("64 KiB are not too much");
        Chunk {
            records: Vec::new(),
            stamps_ns: None,
            index_entries: Vec::new(),
            lz4_frame: Vec::new(),
            block_buffer: vec![0; bound],
            encoded_chunk: Vec::new(),
        }
    }

    pub(crate) fn is_empty(&self) -> bool {
        self.records.is_empty()
    }

    /// Returns whether a record with `length` bytes still fits.
    pub(crate) fn has_space(&self, length: usize) -> bool {
        self.is_empty() || self.records.len() + MESSAGE_HEADER_BYTES + length <= CHUNK_BYTES_MAX
    }

    /// Returns the stamps of the oldest and the newest message, ns since 1970.
    pub(crate) fn stamps_ns(&self) -> Option<(u64, u64)> {
        self.stamps_ns
    }

    /// Appends a complete record of a schema or a channel.
    pub(crate) fn add_record(&mut self, record: &[u8]) {
        self.records.extend_from_slice(record);
    }

    pub(crate) fn add_message(
        &mut self,
        channel_id: u16,
        sequence: u32,
        stamp_ns: u64,
        data: &[u8],
    ) {
        let channel = usize::from(channel_id);
        if self.index_entries.len() <= channel {
            self.index_entries.resize_with(channel + 1, Vec::new);
        }
        let mut entry = [0; 16];
        entry[..8].copy_from_slice(&stamp_ns.to_le_bytes());
        entry[8..].copy_from_slice(&(self.records.len() as u64).to_le_bytes());
        self.index_entries[channel].extend_from_slice(&entry);
        let (first_ns, last_ns) = self.stamps_ns.unwrap_or((stamp_ns, stamp_ns));
        self.stamps_ns = Some((first_ns.min(stamp_ns), last_ns.max(stamp_ns)));
        // Written in one call, because nothing else is written as often.
        let mut header = [op::MESSAGE; MESSAGE_HEADER_BYTES];
        header[1..9]
            .copy_from_slice(&((MESSAGE_HEADER_BYTES - 9 + data.len()) as u64).to_le_bytes());
        header[9..11].copy_from_slice(&channel_id.to_le_bytes());
        header[11..15].copy_from_slice(&sequence.to_le_bytes());
        header[15..23].copy_from_slice(&stamp_ns.to_le_bytes());
        header[23..].copy_from_slice(&stamp_ns.to_le_bytes());
        self.records.extend_from_slice(&header);
        self.records.extend_from_slice(data);
    }

    /// Closes the chunk. Returns its bytes with the message indexes, to be written at `offset` of the file, and its
    /// entry for the index.
    pub(crate) fn close(&mut self, offset: u64) -> (&[u8], ChunkIndex) {
        self.compress();
        let (first_ns, last_ns) = self.stamps_ns.unwrap_or((0, 0));
        let header = ChunkHeader {
            message_start_time: first_ns,
            message_end_time: last_ns,
            uncompressed_size: self.records.len() as u64,
            uncompressed_crc: crc32fast::hash(&self.records),
            compression: COMPRESSION.to_owned(),
            compressed_size: self.lz4_frame.len() as u64,
        };
        self.encoded_chunk.clear();
        append_record(
            &mut self.encoded_chunk,
            op::CHUNK,
            &[&encode_content(&header), &self.lz4_frame],
        );
        let mut index = ChunkIndex {
            message_start_time: first_ns,
            message_end_time: last_ns,
            chunk_start_offset: offset,
            chunk_length: self.encoded_chunk.len() as u64,
            message_index_offsets: Default::default(),
            message_index_length: 0,
            compression: header.compression,
            compressed_size: header.compressed_size,
            uncompressed_size: header.uncompressed_size,
        };
        for (channel_id, entries) in (0_u16..).zip(&self.index_entries) {
            if !entries.is_empty() {
                let index_offset = offset + self.encoded_chunk.len() as u64;
                index.message_index_offsets.insert(channel_id, index_offset);
                let length = (entries.len() as u32).to_le_bytes();
                let parts = [&channel_id.to_le_bytes()[..], &length, entries];
                append_record(&mut self.encoded_chunk, op::MESSAGE_INDEX, &parts);
            }
        }
        index.message_index_length = self.encoded_chunk.len() as u64 - index.chunk_length;
        (&self.encoded_chunk, index)
    }

    /// Compresses the records into the frame, block by block. A block that does not shrink is stored uncompressed.
    fn compress(&mut self) {
        self.lz4_frame.clear();
        self.lz4_frame.extend(LZ4_FRAME_HEADER);
        for part in self.records.chunks(BLOCK_BYTES_MAX) {
            let (length, block) =
                match compress_to_buffer(part, None, false, &mut self.block_buffer) {
                    Ok(size) if size < part.len() => (size as u32, &self.block_buffer[..size]),
                    _ => (part.len() as u32 | UNCOMPRESSED_FLAG, part),
                };
            self.lz4_frame.extend(length.to_le_bytes());
            self.lz4_frame.extend_from_slice(block);
        }
        self.lz4_frame.extend(FRAME_END_LENGTH.to_le_bytes());
    }

    /// Clears the chunk for the next records.
    pub(crate) fn clear(&mut self) {
        self.records.clear();
        self.stamps_ns = None;
        self.index_entries.iter_mut().for_each(Vec::clear);
    }
}
