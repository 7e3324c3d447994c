//! What rmw_zenoh wants beside every message, without which its receivers drop it: a number, a time,
//! and who sent it.
//!
//! Three values without names, as since rmw_zenoh 0.2.4: sequence and stamp as `i64`, then the sender
//! with its length before it. (rmw_zenoh, issue 641)

/// How many bytes name a sender.
pub const GID_BYTES: usize = 16;
/// How many bytes an attachment has.
pub const BYTES: usize = 8 + 8 + 1 + GID_BYTES;

/// Of the message with this number, from 1, that its sender made at this time of ROS, ns.
pub fn encode(sequence: i64, stamp_ns: i64, gid: &[u8; GID_BYTES]) -> [u8; BYTES] {
    let mut bytes = [0; BYTES];
    bytes[..8].copy_from_slice(&sequence.to_le_bytes());
    bytes[8..16].copy_from_slice(&stamp_ns.to_le_bytes());
    bytes[16] = GID_BYTES as u8;
    bytes[17..].copy_from_slice(gid);
    bytes
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_attachment_is_number_time_and_sender() {
        let gid = std::array::from_fn(|i| i as u8);
        let bytes = encode(0x0102, -1, &gid);
        assert_eq!(bytes[..8], [2, 1, 0, 0, 0, 0, 0, 0]);
        assert_eq!(bytes[8..16], [0xff; 8]);
        assert_eq!(bytes[16], 16);
        assert_eq!(bytes[17..], gid);
    }
}
