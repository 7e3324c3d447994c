//! CDR as ROS 2 writes it: little-endian, every number aligned to its own size, counted from behind
//! the four bytes that say so.

/// Says that little-endian CDR follows.
const ENCAPSULATION: [u8; 4] = [0, 1, 0, 0];

/// A message that is put together once. Each function tells where it put its value, so that the
/// value can be replaced.
pub(crate) struct Sheet(Vec<u8>);

impl Sheet {
    pub(crate) fn new() -> Sheet {
        Sheet(ENCAPSULATION.to_vec())
    }

    /// Begins again, with the memory it has.
    pub(crate) fn clear(&mut self) {
        self.0.truncate(ENCAPSULATION.len());
    }

    pub(crate) fn u8(&mut self, value: u8) -> usize {
        self.put(1, &[value])
    }

    pub(crate) fn u32(&mut self, value: u32) -> usize {
        self.put(4, &value.to_le_bytes())
    }

    pub(crate) fn f32(&mut self, value: f32) -> usize {
        self.put(4, &value.to_le_bytes())
    }

    pub(crate) fn f64(&mut self, value: f64) -> usize {
        self.put(8, &value.to_le_bytes())
    }

    /// Its length with the final zero, the text, a zero.
    pub(crate) fn text(&mut self, text: &str) -> usize {
        let at = self.u32(text.len() as u32 + 1);
        self.0.extend_from_slice(text.as_bytes());
        self.0.push(0);
        at
    }

    /// Seconds and nanoseconds since 1970.
    pub(crate) fn time(&mut self, stamp_ns: u64) -> usize {
        let at = self.u32(0);
        self.u32(0);
        self.set_time(at, stamp_ns);
        at
    }

    fn put(&mut self, size: usize, bytes: &[u8]) -> usize {
        let end = self.0.len() - ENCAPSULATION.len();
        self.0.resize(ENCAPSULATION.len() + end.next_multiple_of(size), 0);
        let at = self.0.len();
        self.0.extend_from_slice(bytes);
        at
    }

    pub(crate) fn set_u8(&mut self, at: usize, value: u8) {
        self.0[at] = value;
    }

    pub(crate) fn set_u32(&mut self, at: usize, value: u32) {
        self.0[at..at + 4].copy_from_slice(&value.to_le_bytes());
    }

    pub(crate) fn set_f64(&mut self, at: usize, value: f64) {
        self.0[at..at + 8].copy_from_slice(&value.to_le_bytes());
    }

    pub(crate) fn set_time(&mut self, at: usize, stamp_ns: u64) {
        // Whole seconds since 1970 fit until 2038, which is as far as ROS 2 counts.
        self.set_u32(at, (stamp_ns / 1_000_000_000) as u32);
        self.set_u32(at + 4, (stamp_ns % 1_000_000_000) as u32);
    }

    pub(crate) fn bytes(&self) -> &[u8] {
        &self.0
    }
}

/// Reads values in order; `None` where the message ends too early.
pub(crate) struct Reader<'a> {
    body: &'a [u8],
    at: usize,
}

impl<'a> Reader<'a> {
    /// `None` if this is not little-endian CDR.
    pub(crate) fn new(message: &'a [u8]) -> Option<Reader<'a>> {
        Some(Reader { body: message.strip_prefix(&ENCAPSULATION)?, at: 0 })
    }

    fn take(&mut self, size: usize, length: usize) -> Option<&'a [u8]> {
        let from = self.at.checked_next_multiple_of(size)?;
        let to = from.checked_add(length)?;
        self.at = to;
        self.body.get(from..to)
    }

    fn number<const SIZE: usize>(&mut self) -> Option<[u8; SIZE]> {
        self.take(SIZE, SIZE)?.try_into().ok()
    }

    pub(crate) fn u8(&mut self) -> Option<u8> {
        self.number().map(u8::from_le_bytes)
    }

    pub(crate) fn u32(&mut self) -> Option<u32> {
        self.number().map(u32::from_le_bytes)
    }

    pub(crate) fn f64(&mut self) -> Option<f64> {
        self.number().map(f64::from_le_bytes)
    }

    pub(crate) fn text(&mut self) -> Option<&'a str> {
        let length = self.u32()? as usize;
        let text = self.take(1, length)?.strip_suffix(b"\0")?;
        std::str::from_utf8(text).ok()
    }

    /// Seconds and nanoseconds since 1970.
    pub(crate) fn time(&mut self) -> Option<u64> {
        let (seconds, rest) = (self.u32()?, self.u32()?);
        Some(u64::from(seconds) * 1_000_000_000 + u64::from(rest))
    }

    /// A sequence, element by element; a count that is not in the message reads as far as it goes.
    pub(crate) fn list<T>(&mut self, one: impl Fn(&mut Self) -> Option<T>) -> Option<Vec<T>> {
        let count = self.u32()?;
        (0..count).map(|_| one(self)).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_value_stands_where_its_size_divides_the_place() {
        let mut sheet = Sheet::new();
        sheet.u8(7);
        sheet.f64(1.5);
        sheet.text("ab");
        sheet.u32(9);
        // 4 of encapsulation; 1, 7 of padding, 8; length 3, "ab\0", 1 of padding; 4.
        assert_eq!(sheet.bytes().len(), 4 + 16 + 8 + 4);
        assert_eq!(sheet.bytes()[12..20], 1.5f64.to_le_bytes());
        let mut reader = Reader::new(sheet.bytes()).unwrap();
        assert_eq!((reader.u8(), reader.f64()), (Some(7), Some(1.5)));
        assert_eq!((reader.text(), reader.u32()), (Some("ab"), Some(9)));
        assert_eq!(reader.u8(), None);
    }

    #[test]
    fn a_message_that_is_cut_or_lies_about_its_length_is_not_read() {
        let mut sheet = Sheet::new();
        sheet.u32(u32::MAX);
        assert_eq!(Reader::new(sheet.bytes()).unwrap().text(), None);
        assert_eq!(Reader::new(sheet.bytes()).unwrap().list(Reader::f64), None);
        assert!(Reader::new(&[0, 0, 0, 0]).is_none());
        assert!(Reader::new(&[]).is_none());
    }
}
