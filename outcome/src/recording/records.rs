//! Encoding of a record of a recording.

use std::io::Cursor;

use binrw::{BinWrite, BinWriterExt as _};

/// Appends a record: its kind, its length, and its content in parts.
pub(crate) fn append_record(out: &mut Vec<u8>, opcode: u8, parts: &[&[u8]]) {
    let length: usize = parts.iter().map(|part| part.len()).sum();
    out.push(opcode);
    out.extend((length as u64).to_le_bytes());
    parts.iter().for_each(|part| out.extend_from_slice(part));
}

/// Encodes the content of a record, or its beginning.
pub(crate) fn encode_content(content: &impl for<'a> BinWrite<Args<'a> = ()>) -> Vec<u8> {
    let mut bytes = Cursor::new(Vec::new());
    bytes.write_le(content).expect("memory takes all");
    bytes.into_inner()
}
