//! Encoding and decoding of CDR, little-endian: the layout of numbers and strings in ROS 2 messages.
//!
//! Every number is aligned to its own size, counted from the end of the header. No small crate exists:
//! `hiroz-cdr` 0.2 depends on zenoh's buffers, which the default build must not contain.

/// Header of every message: plain CDR, little-endian, no options.
const HEADER: [u8; 4] = [0, 1, 0, 0];

const NS_PER_S: u64 = 1_000_000_000;

/// Encoder of a message.
#[derive(Debug, Clone)]
pub struct Writer {
    bytes: Vec<u8>,
}

impl Writer {
    /// Creates a message that has only its header.
    pub fn new() -> Writer {
        Writer { bytes: HEADER.to_vec() }
    }

    /// Starts another message, in the same memory.
    pub fn clear(&mut self) {
        self.bytes.truncate(HEADER.len());
    }

    /// Returns the encoded message.
    pub fn bytes(&self) -> &[u8] {
        &self.bytes
    }

    /// Appends an 8-bit integer.
    pub fn write_u8(&mut self, number: u8) {
        self.bytes.push(number);
    }

    /// Appends a 32-bit integer.
    pub fn write_u32(&mut self, number: u32) {
        self.align(4);
        self.bytes.extend_from_slice(&number.to_le_bytes());
    }

    /// Appends a 32-bit floating-point number.
    pub fn write_f32(&mut self, number: f32) {
        self.write_u32(number.to_bits());
    }

    /// Appends consecutive 64-bit floating-point numbers.
    pub fn write_f64s<const COUNT: usize>(&mut self, numbers: &[f64; COUNT]) {
        self.align(8);
        self.bytes.extend_from_slice(numbers.map(f64::to_le_bytes).as_flattened());
    }

    /// Appends a string: its length including the final NUL, then its bytes and the NUL.
    pub fn write_string(&mut self, text: &str) {
        self.write_u32(text.len() as u32 + 1);
        self.bytes.extend_from_slice(text.as_bytes());
        self.bytes.push(0);
    }

    /// Appends a `builtin_interfaces/Time` for a time in ns since 1970: whole seconds, which ROS 2 counts until
    /// 2038, and the remaining nanoseconds.
    pub fn write_time(&mut self, stamp_ns: u64) {
        self.write_u32((stamp_ns / NS_PER_S) as u32);
        self.write_u32((stamp_ns % NS_PER_S) as u32);
    }

    fn align(&mut self, size: usize) {
        let written = self.bytes.len() - HEADER.len();
        let padding = written.next_multiple_of(size) - written;
        self.bytes.extend_from_slice(&[0; 8][..padding]);
    }
}

impl Default for Writer {
    fn default() -> Writer {
        Writer::new()
    }
}

/// Decoder of a message. Every method returns `None` at the end of the message or if the bytes are invalid.
#[derive(Debug, Clone, Copy)]
pub struct Reader<'a> {
    body: &'a [u8],
    read_byte_count: usize,
}

impl<'a> Reader<'a> {
    /// Starts reading a message; `None` if it is not plain little-endian CDR. The options are ignored.
    pub fn new(message: &'a [u8]) -> Option<Reader<'a>> {
        let (header, body) = message.split_first_chunk::<{ HEADER.len() }>()?;
        (header[..2] == HEADER[..2]).then_some(Reader { body, read_byte_count: 0 })
    }

    /// Returns whether the whole message was read, except for padding to a multiple of four.
    pub fn is_done(&self) -> bool {
        self.body.len() - self.read_byte_count < 4
    }

    /// Reads an 8-bit integer.
    pub fn read_u8(&mut self) -> Option<u8> {
        self.read_number_bytes().map(u8::from_le_bytes)
    }

    /// Reads a 32-bit integer.
    pub fn read_u32(&mut self) -> Option<u32> {
        self.read_number_bytes().map(u32::from_le_bytes)
    }

    /// Reads a 64-bit floating-point number.
    pub fn read_f64(&mut self) -> Option<f64> {
        self.read_number_bytes().map(f64::from_le_bytes)
    }

    /// Reads consecutive 64-bit floating-point numbers.
    pub fn read_f64s<const COUNT: usize>(&mut self) -> Option<[f64; COUNT]> {
        let mut numbers = [0.0; COUNT];
        for number in &mut numbers {
            *number = self.read_f64()?;
        }
        Some(numbers)
    }

    /// Reads a string, which has exactly one NUL, at its end.
    pub fn read_string(&mut self) -> Option<&'a str> {
        let length = usize::try_from(self.read_u32()?).ok()?;
        let (text, nul) = self.read_bytes(length)?.split_last().map(|(nul, text)| (text, *nul))?;
        (nul == 0 && !text.contains(&0)).then(|| std::str::from_utf8(text).ok()).flatten()
    }

    /// Reads a `builtin_interfaces/Time`, in ns since 1970.
    pub fn read_time(&mut self) -> Option<u64> {
        let (s, ns) = (self.read_u32()?, self.read_u32()?);
        Some(u64::from(s) * NS_PER_S + u64::from(ns))
    }

    /// Reads a sequence, element by element. A false count costs no more than the length of the message.
    pub fn read_list<T>(&mut self, element: impl Fn(&mut Self) -> Option<T>) -> Option<Vec<T>> {
        let count = self.read_u32()?;
        (0..count).map(|_| element(self)).collect()
    }

    fn read_number_bytes<const SIZE: usize>(&mut self) -> Option<[u8; SIZE]> {
        self.read_byte_count = self.read_byte_count.next_multiple_of(SIZE);
        self.read_bytes(SIZE)?.try_into().ok()
    }

    fn read_bytes(&mut self, bytes: usize) -> Option<&'a [u8]> {
        let bytes_read = self.body.get(self.read_byte_count..)?.get(..bytes)?;
        self.read_byte_count += bytes;
        Some(bytes_read)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_are_aligned_and_round_trip() {
        let mut writer = Writer::new();
        writer.write_string("ab");
        writer.write_u32(0xffff_fffe);
        writer.write_f64s(&[1.0]);
        writer.write_u8(7);
        writer.write_time(5_000_000_009);
        let bytes = writer.bytes();
        assert_eq!(&bytes[..4], [0, 1, 0, 0]);
        assert_eq!(&bytes[4..11], [3, 0, 0, 0, b'a', b'b', 0]);
        assert_eq!(&bytes[11..16], [0, 0xfe, 0xff, 0xff, 0xff]);
        assert_eq!(&bytes[16..20], [0; 4]);
        assert_eq!(bytes[20..28], 1.0_f64.to_le_bytes());
        assert_eq!(&bytes[28..], [7, 0, 0, 0, 5, 0, 0, 0, 9, 0, 0, 0]);
        let mut reader = Reader::new(bytes).unwrap();
        assert_eq!((reader.read_string(), reader.read_u32()), (Some("ab"), Some(0xffff_fffe)));
        assert_eq!((reader.read_f64s(), reader.read_u8()), (Some([1.0]), Some(7)));
        assert!(!reader.is_done());
        assert_eq!(reader.read_time(), Some(5_000_000_009));
        assert!(reader.is_done());
        assert_eq!(reader.read_u32(), None);
    }

    #[test]
    fn invalid_string_or_header_is_refused() {
        let read = |bytes: &[u8]| {
            Reader::new(bytes).and_then(|mut reader| reader.read_string().map(str::len))
        };
        assert_eq!(read(b"\0\x01\0\0\x02\0\0\0a\0"), Some(1));
        for other in [
            &b""[..],
            b"\0\x01\0",
            // Big-endian.
            b"\0\0\0\0\0\0\0\x02a\0",
            b"\0\x01\0\0\0\0\0\0",
            b"\0\x01\0\0\x02\0\0\0ab",
            b"\0\x01\0\0\x03\0\0\0\0a\0",
            b"\0\x01\0\0\x03\0\0\0a\0",
            b"\0\x01\0\0\xff\xff\xff\xffa\0",
            b"\0\x01\0\0\x02\0\0\0\xff\0",
        ] {
            assert_eq!(read(other), None, "{other:?}");
        }
        let long = Reader::new(b"\0\x01\0\0\xff\xff\xff\xff").unwrap().read_list(Reader::read_f64);
        assert_eq!(long, None, "there are not so many");
    }
}
