//! MCAP's records as bytes: little-endian, each behind its kind and its length. What is in which
//! record: <https://mcap.dev/spec>.

use std::collections::BTreeMap;

/// Records, one behind the other.
#[derive(Default)]
pub(crate) struct Records(Vec<u8>);

impl Records {
    /// A record: its kind, its length, and what `body` puts into it.
    pub(crate) fn record(&mut self, opcode: u8, body: impl FnOnce(&mut Records)) {
        self.0.push(opcode);
        self.counted(body);
    }

    /// What `body` puts, behind its length in eight bytes; the length.
    pub(crate) fn counted(&mut self, body: impl FnOnce(&mut Records)) -> u64 {
        let at = self.0.len() + 8;
        self.u64(0);
        body(self);
        let length = (self.0.len() - at) as u64;
        self.0[at - 8..at].copy_from_slice(&length.to_le_bytes());
        length
    }

    /// The same behind four bytes, as lists and maps have it.
    pub(crate) fn list(&mut self, body: impl FnOnce(&mut Records)) {
        let at = self.0.len() + 4;
        self.u32(0);
        body(self);
        let length = (self.0.len() - at) as u32;
        self.0[at - 4..at].copy_from_slice(&length.to_le_bytes());
    }

    pub(crate) fn u8(&mut self, value: u8) {
        self.0.push(value);
    }

    pub(crate) fn u16(&mut self, value: u16) {
        self.bytes(&value.to_le_bytes());
    }

    pub(crate) fn u32(&mut self, value: u32) {
        self.bytes(&value.to_le_bytes());
    }

    pub(crate) fn u64(&mut self, value: u64) {
        self.bytes(&value.to_le_bytes());
    }

    pub(crate) fn bytes(&mut self, bytes: &[u8]) {
        self.0.extend_from_slice(bytes);
    }

    pub(crate) fn text(&mut self, text: &str) {
        self.list(|list| list.bytes(text.as_bytes()));
    }

    pub(crate) fn texts(&mut self, map: &BTreeMap<String, String>) {
        self.list(|list| {
            for (key, value) in map {
                list.text(key);
                list.text(value);
            }
        });
    }

    pub(crate) fn as_bytes(&self) -> &[u8] {
        &self.0
    }

    pub(crate) fn len(&self) -> usize {
        self.0.len()
    }

    pub(crate) fn is_empty(&self) -> bool {
        self.0.is_empty()
    }

    /// Begins again, with the memory it has.
    pub(crate) fn clear(&mut self) {
        self.0.clear();
    }

    /// Forgets what stands behind `length`.
    pub(crate) fn truncate(&mut self, length: usize) {
        self.0.truncate(length);
    }
}
