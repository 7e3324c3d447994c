//! Character encodings of graph files: UTF-8, UTF-16, and in XML a declared ISO-8859-1 or Windows-1252.

use crate::scenario::file::FileError;

/// Number of bytes at the start of a file in which an XML declaration is looked for.
const DECLARATION_BYTES_MAX: usize = 256;
/// Remedy for a file in an encoding that is not read.
const ENCODING_REMEDY: &str = "expected UTF-8, UTF-16, or XML that declares ISO-8859-1 or windows-1252; \
    `iconv -f ENCODING -t UTF-8` converts a file";
/// Characters of Windows-1252 for the bytes 0x80 to 0x9f. U+FFFD stands for the five unassigned ones.
const WINDOWS_1252: [char; 32] = [
    '€', '\u{fffd}', '‚', 'ƒ', '„', '…', '†', '‡', 'ˆ', '‰', 'Š', '‹', 'Œ', '\u{fffd}', 'Ž',
    '\u{fffd}', //
    '\u{fffd}', '‘', '’', '“', '”', '•', '–', '—', '˜', '™', 'š', '›', 'œ', '\u{fffd}', 'ž', 'Ÿ',
];

/// Returns the text of a graph file. Fails for an encoding that is not read, and for bytes
/// that the encoding does not allow; the message names the encoding.
pub(super) fn decode(bytes: Vec<u8>) -> Result<String, FileError> {
    match bytes[..] {
        [0xff, 0xfe, 0, 0, ..] | [0, 0, 0xfe, 0xff, ..] => {
            Err(decoding_error("is UTF-32".to_owned()))
        }
        [0xff, 0xfe, ref text @ ..] => decode_utf_16(text, u16::from_le_bytes),
        [0xfe, 0xff, ref text @ ..] => decode_utf_16(text, u16::from_be_bytes),
        // Without a byte order mark, the first character decides: it is ASCII in every format.
        [first, 0, ..] if first != 0 => decode_utf_16(&bytes, u16::from_le_bytes),
        [0, second, ..] if second != 0 => decode_utf_16(&bytes, u16::from_be_bytes),
        _ => decode_declared_encoding(bytes),
    }
}

fn decoding_error(what: String) -> FileError {
    FileError { problem: what, remedy: ENCODING_REMEDY }
}

fn decode_utf_16(bytes: &[u8], unit: impl Fn([u8; 2]) -> u16) -> Result<String, FileError> {
    let (units, rest) = bytes.as_chunks();
    if !rest.is_empty() {
        return Err(decoding_error("is UTF-16 with half a character at its end".to_owned()));
    }
    let mut text = String::with_capacity(bytes.len());
    for c in char::decode_utf16(units.iter().map(|&bytes| unit(bytes))) {
        let line = || text.matches('\n').count() + 1;
        text.push(c.map_err(|_| {
            decoding_error(format!("is UTF-16 with half a character on line {}", line()))
        })?);
    }
    Ok(text)
}

/// Decodes text of one byte or more for a character, as declared in XML or else as UTF-8.
fn decode_declared_encoding(bytes: Vec<u8>) -> Result<String, FileError> {
    let declared = declared_encoding(&bytes);
    let is_ascii = bytes.iter().all(|byte| byte.is_ascii() && *byte != 0x1b);
    match declared.as_deref() {
        None | Some("utf-8" | "utf8" | "utf-16" | "us-ascii" | "ascii") => decode_utf_8(bytes),
        Some("iso-8859-1" | "iso8859-1" | "iso_8859-1" | "latin1" | "latin-1" | "l1") => {
            Ok(bytes.into_iter().map(char::from).collect())
        }
        Some("windows-1252" | "cp1252" | "cp-1252") => {
            let decode = |byte: u8| match byte {
                0x80..=0x9f => WINDOWS_1252[usize::from(byte - 0x80)],
                _ => char::from(byte),
            };
            Ok(bytes.into_iter().map(decode).collect())
        }
        // ASCII is the same in all of these but those that shift.
        Some(name) if is_ascii && name != "utf-7" => decode_utf_8(bytes),
        Some(name) => Err(decoding_error(format!("is declared to be {name:?}"))),
    }
}

fn decode_utf_8(bytes: Vec<u8>) -> Result<String, FileError> {
    String::from_utf8(bytes).map_err(|error| {
        let at = error.utf8_error().valid_up_to();
        let line = error.as_bytes()[..at].iter().filter(|&&byte| byte == b'\n').count() + 1;
        let byte = error.as_bytes()[at];
        decoding_error(format!(
            "is not UTF-8 (perhaps ISO-8859-1 or windows-1252): byte 0x{byte:02x} at offset {at}, on line {line}"
        ))
    })
}

/// Returns the encoding that an XML declaration names, in lower case.
fn declared_encoding(bytes: &[u8]) -> Option<String> {
    let bytes = bytes.strip_prefix(b"\xef\xbb\xbf").unwrap_or(bytes);
    let start = String::from_utf8_lossy(&bytes[..bytes.len().min(DECLARATION_BYTES_MAX)]);
    let (declaration, _) = start.strip_prefix("<?xml")?.split_once("?>")?;
    let (_, value) = declaration.split_once("encoding")?;
    let value = value.trim_start().strip_prefix('=')?.trim_start();
    let quote = value.chars().next().filter(|c| matches!(c, '"' | '\''))?;
    let (name, _) = value[1..].split_once(quote)?;
    Some(name.trim().to_ascii_lowercase())
}
