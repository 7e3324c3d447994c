//! Readers of the files of a run directory, complete or truncated: text, JSON, and tables.

use std::fs;
use std::io;
use std::path::Path;

use csv::ErrorKind;
use experiment::scenario::file::check_inside_folder;
use protocol::regular_file::{self, SymlinkPolicy};
use serde::de::DeserializeOwned;

use super::ReportError;

/// Maximum size of a file that a report reads, bytes: hours of any experiment. A larger file is an error.
const FILE_BYTES_MAX: u64 = 1 << 34;

/// Reads a file. Returns `None` if it does not exist.
pub(super) fn read_file(path: &Path) -> Result<Option<Vec<u8>>, ReportError> {
    let read_error = |error| ReportError::Read(path.into(), error);
    match fs::metadata(path) {
        Err(error) if error.kind() == io::ErrorKind::NotFound => return Ok(None),
        Err(error) => return Err(read_error(error)),
        Ok(metadata) if metadata.len() > FILE_BYTES_MAX => {
            let bytes = metadata.len();
            let reason = format!("it has {bytes} bytes, expected at most {FILE_BYTES_MAX}");
            return Err(read_error(io::Error::other(reason)));
        }
        Ok(_) => check_inside_folder(path.parent().unwrap_or(path), path).map_err(read_error)?,
    }
    let read = regular_file::read(path, SymlinkPolicy::Followed, FILE_BYTES_MAX);
    read.map(Some).map_err(read_error)
}

/// Parses a JSON file. Returns `None` if it does not exist.
pub(super) fn read_json<T: DeserializeOwned>(path: &Path) -> Result<Option<T>, ReportError> {
    let Some(text) = read_file(path)? else { return Ok(None) };
    let malformed = |error: serde_json::Error| {
        let what = format!("{error}; expected JSON as a run writes it");
        ReportError::MalformedLine(path.into(), error.line() as u64, what)
    };
    serde_json::from_slice(&text).map(Some).map_err(malformed)
}

/// Passes each line of a table to `take`. Additional columns are ignored, because later versions may have them.
/// Text behind the last line end is ignored, because the run was killed while it was written. Without the file,
/// does nothing.
pub(super) fn for_each_line<T: DeserializeOwned>(
    path: &Path,
    take: impl FnMut(T) -> Result<(), String>,
) -> Result<(), ReportError> {
    match read_file(path)? {
        Some(text) => for_each_line_of_text(path, &text, take),
        None => Ok(()),
    }
}

/// Passes each line of the text of a table to `take`; see [`for_each_line`].
pub(super) fn for_each_line_of_text<T: DeserializeOwned>(
    path: &Path,
    text: &[u8],
    mut take: impl FnMut(T) -> Result<(), String>,
) -> Result<(), ReportError> {
    let complete_length = text.iter().rposition(|&byte| byte == b'\n').map_or(0, |i| i + 1);
    let mut reader = csv::Reader::from_reader(&text[..complete_length]);
    let malformed = |line, what| ReportError::MalformedLine(path.into(), line, what);
    let mut lines = reader.deserialize::<T>();
    while let Some(line) = lines.next() {
        let end = lines.reader().position().line();
        let line = line.map_err(|error| {
            let at = error.position().map_or(end, csv::Position::line);
            malformed(at, describe_error(&error))
        })?;
        take(line).map_err(|what| malformed(end - 1, what))?;
    }
    Ok(())
}

fn describe_error(error: &csv::Error) -> String {
    match error.kind() {
        ErrorKind::UnequalLengths { expected_len, len, .. } => {
            format!("has {len} fields, expected {expected_len}")
        }
        ErrorKind::Deserialize { err, .. } => err.to_string(),
        _ => error.to_string(),
    }
}
