//! Header of every sample on the wire: sender, build, experiment and sequence number.
//!
//! All numbers are little-endian. Must not: decide whether a sample is accepted (`gate`).

use protocol::message::Plain;

/// Version of the wire format, incremented with every change.
pub const WIRE_FORMAT_VERSION: u16 = 1;
/// First bytes of a frame.
const FRAME_MAGIC: [u8; 4] = *b"phlx";
/// Size of the header, bytes.
pub const HEADER_BYTES: usize = 48;

/// Header of a frame.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct FrameHeader {
    /// Wire format version of the sender; see [`WIRE_FORMAT_VERSION`].
    pub version: u16,
    /// Index of the sending host.
    pub host: u16,
    /// Layout hash of the content; see [`layout_hash`].
    pub layout_hash: u64,
    /// Hash of scenario and fleet file.
    pub experiment_hash: u64,
    /// Random number drawn at the start of the sending bridge.
    pub boot_id: u64,
    /// Sequence number under one key since the start of the sending bridge.
    pub sequence: u64,
    /// Time of sending by the clock of the plant's host, as estimated by the sender, ns; 0 if unknown.
    pub source_ns: u64,
}

/// Returns the layout hash of a slice of `P` after a header `H`.
pub fn layout_hash<P: Plain, H: Plain>() -> u64 {
    P::LAYOUT.rotate_left(1) ^ H::LAYOUT
}

impl FrameHeader {
    /// Encodes a frame: this header, then the concatenated parts.
    pub fn encode_frame(&self, parts: &[&[u8]]) -> Vec<u8> {
        let length: usize = parts.iter().map(|part| part.len()).sum();
        let mut bytes = Vec::with_capacity(HEADER_BYTES + length);
        bytes.extend(FRAME_MAGIC);
        bytes.extend(self.version.to_le_bytes());
        bytes.extend(self.host.to_le_bytes());
        for number in
            [self.layout_hash, self.experiment_hash, self.boot_id, self.sequence, self.source_ns]
        {
            bytes.extend(number.to_le_bytes());
        }
        parts.iter().for_each(|part| bytes.extend(*part));
        bytes
    }

    /// Splits a frame into header and content; `None` if it has no header of any version.
    pub fn decode(frame: &[u8]) -> Option<(FrameHeader, &[u8])> {
        let (header, content) = frame.split_first_chunk::<HEADER_BYTES>()?;
        let rest = header.strip_prefix(&FRAME_MAGIC)?;
        let (small, large) = rest.split_at(4);
        let small = |offset: usize| u16::from_le_bytes([small[offset], small[offset + 1]]);
        let (large, _) = large.as_chunks();
        let [layout, experiment, boot, sequence, source_ns] =
            std::array::from_fn(|i| u64::from_le_bytes(large[i]));
        let (version, host) = (small(0), small(2));
        let header = FrameHeader {
            version,
            host,
            layout_hash: layout,
            experiment_hash: experiment,
            boot_id: boot,
            sequence,
            source_ns,
        };
        Some((header, content))
    }
}

/// Decodes a header and the rows after it; `None` if the content is incomplete.
pub fn decode_slice<P: Plain, H: Plain>(content: &[u8]) -> Option<(H, Vec<P>)> {
    let (header, rows) = content.split_at_checked(size_of::<H>())?;
    let chunks = rows.chunks_exact(size_of::<P>());
    if !chunks.remainder().is_empty() {
        return None;
    }
    Some((H::from_bytes(header)?, chunks.map(|row| P::from_bytes(row)).collect::<Option<_>>()?))
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;
    use protocol::message::{NeighborStatus, StatusHeader};

    proptest! {
        #[test]
        fn frame_round_trip_keeps_header_and_content(
            numbers in any::<[u64; 5]>(),
            small in any::<[u16; 2]>(),
            content in proptest::collection::vec(any::<u8>(), 0..200),
        ) {
            let [layout, experiment, boot, sequence, source_ns] = numbers;
            let [version, host] = small;
            let header = FrameHeader { version, host, layout_hash: layout, experiment_hash: experiment, boot_id: boot, sequence, source_ns };
            let frame = header.encode_frame(&[&content[..content.len() / 2], &content[content.len() / 2..]]);
            prop_assert_eq!(frame.len(), HEADER_BYTES + content.len());
            prop_assert_eq!(FrameHeader::decode(&frame), Some((header, &content[..])));
        }

        #[test]
        fn garbage_is_refused_without_a_panic(
            bytes in proptest::collection::vec(any::<u8>(), 0..100),
        ) {
            prop_assert_eq!(FrameHeader::decode(&bytes).is_some(), bytes.starts_with(b"phlx") && bytes.len() >= HEADER_BYTES);
            let _ = decode_slice::<NeighborStatus, StatusHeader>(&bytes);
        }
    }

    #[test]
    fn incomplete_slice_is_refused() {
        let header = StatusHeader { tick: 5, ..StatusHeader::default() };
        let rows = [NeighborStatus { robot: 2, ..NeighborStatus::default() }; 3];
        let mut content = header.bytes().to_vec();
        rows.iter().for_each(|row| content.extend(row.bytes()));
        assert_eq!(decode_slice(&content), Some((header, rows.to_vec())));
        content.pop();
        assert_eq!(decode_slice::<NeighborStatus, StatusHeader>(&content), None);
        assert_ne!(
            layout_hash::<NeighborStatus, StatusHeader>(),
            layout_hash::<StatusHeader, NeighborStatus>()
        );
    }
}
