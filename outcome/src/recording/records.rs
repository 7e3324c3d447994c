//! How a record of a recording is written.

use std::io::Cursor;

use binrw::{BinWrite, BinWriterExt as _};

/// A record: its kind, its length, and what is in it, in parts.
pub(crate) fn record(out: &mut Vec<u8>, opcode: u8, parts: &[&[u8]]) {
    let length: usize = parts.iter().map(|part| part.len()).sum();
    out.push(opcode);
    out.extend((length as u64).to_le_bytes());
    parts.iter().for_each(|part| out.extend_from_slice(part));
}

/// A record's content, or the beginning of it.
pub(crate) fn bytes(content: &impl for<'a> BinWrite<Args<'a> = ()>) -> Vec<u8> {
    let mut bytes = Cursor::new(Vec::new());
    bytes.write_le(content).expect("memory takes all");
    bytes.into_inner()
}
