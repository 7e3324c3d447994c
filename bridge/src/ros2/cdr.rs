//! CDR, little-endian: how ROS 2 lays numbers and strings out in a message.
//!
//! Every number begins at a multiple of its own size, counted from the end of the header. No crate for
//! it is small: `hiroz-cdr` 0.2 brings zenoh's buffers, which the default build must not have.

/// Before every message: plain CDR, little-endian, no options.
const HEADER: [u8; 4] = [0, 1, 0, 0];

/// A message that is being written.
#[derive(Debug, Clone)]
pub struct Writer {
    bytes: Vec<u8>,
}

impl Writer {
    /// With nothing but the header.
    pub fn new() -> Writer {
        Writer { bytes: HEADER.to_vec() }
    }

    /// The bytes of it all.
    pub fn finish(self) -> Vec<u8> {
        self.bytes
    }

    /// An integer of 32 bits.
    pub fn u32(&mut self, number: u32) {
        self.number(number.to_le_bytes());
    }

    /// A signed integer of 32 bits.
    pub fn i32(&mut self, number: i32) {
        self.number(number.to_le_bytes());
    }

    /// Numbers of 64 bits, one after the other.
    pub fn f64s(&mut self, numbers: &[f64]) {
        for number in numbers {
            self.number(number.to_le_bytes());
        }
    }

    /// A string: its length with the NUL at its end, then its bytes and that NUL.
    pub fn string(&mut self, text: &str) {
        self.u32(text.len() as u32 + 1);
        self.bytes.extend_from_slice(text.as_bytes());
        self.bytes.push(0);
    }

    fn number<const SIZE: usize>(&mut self, bytes: [u8; SIZE]) {
        let written = self.bytes.len() - HEADER.len();
        self.bytes.resize(HEADER.len() + written.next_multiple_of(SIZE), 0);
        self.bytes.extend_from_slice(&bytes);
    }
}

impl Default for Writer {
    fn default() -> Writer {
        Writer::new()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_begin_at_multiples_of_their_size_after_the_header() {
        let mut writer = Writer::new();
        writer.string("ab");
        writer.i32(-2);
        writer.f64s(&[1.0]);
        let bytes = writer.finish();
        assert_eq!(&bytes[..4], [0, 1, 0, 0]);
        assert_eq!(&bytes[4..11], [3, 0, 0, 0, b'a', b'b', 0]);
        assert_eq!(&bytes[11..16], [0, 0xfe, 0xff, 0xff, 0xff]);
        assert_eq!(&bytes[16..20], [0; 4]);
        assert_eq!(bytes[20..], 1.0_f64.to_le_bytes());
    }
}
