//! The files of a run directory, whole or cut short: text, JSON, and tables line by line.

use std::fs;
use std::io;
use std::path::Path;

use csv::ErrorKind;
use experiment::scenario::file::stays_in;
use protocol::regular_file::{self, Links};
use serde::de::DeserializeOwned;

use super::ReportError;

/// A report takes in no file larger than this, bytes: hours of any experiment.
const FILE_BYTES_MAX: u64 = 1 << 34;

/// What a file holds; `None` if there is none.
pub(super) fn text(path: &Path) -> Result<Option<Vec<u8>>, ReportError> {
    let unread = |error| ReportError::Read(path.into(), error);
    match fs::metadata(path) {
        Err(error) if error.kind() == io::ErrorKind::NotFound => return Ok(None),
        Err(error) => return Err(unread(error)),
        Ok(found) if found.len() > FILE_BYTES_MAX => {
            let bytes = found.len();
            let why = format!("it has {bytes} bytes, expected at most {FILE_BYTES_MAX}");
            return Err(unread(io::Error::other(why)));
        }
        Ok(_) => stays_in(path.parent().unwrap_or(path), path).map_err(unread)?,
    }
    let read = regular_file::read(path, Links::Followed, FILE_BYTES_MAX);
    read.map(Some).map_err(unread)
}

/// The value that a file holds; `None` if there is none.
pub(super) fn json<T: DeserializeOwned>(path: &Path) -> Result<Option<T>, ReportError> {
    let Some(text) = text(path)? else { return Ok(None) };
    let broken = |error: serde_json::Error| {
        let what = format!("{error}; expected JSON as a run writes it");
        ReportError::Broken(path.into(), error.line() as u64, what)
    };
    serde_json::from_slice(&text).map(Some).map_err(broken)
}

/// Hands over each line of a table: later versions may have other columns beside those that `T` needs. What
/// follows the last line's end was being written when the run was killed. Nothing without the file.
pub(super) fn each_line<T: DeserializeOwned>(
    path: &Path,
    take: impl FnMut(T) -> Result<(), String>,
) -> Result<(), ReportError> {
    match text(path)? {
        Some(text) => each_line_of(path, &text, take),
        None => Ok(()),
    }
}

/// The same of a file that was read.
pub(super) fn each_line_of<T: DeserializeOwned>(
    path: &Path,
    text: &[u8],
    mut take: impl FnMut(T) -> Result<(), String>,
) -> Result<(), ReportError> {
    let whole = text.iter().rposition(|&byte| byte == b'\n').map_or(0, |place| place + 1);
    let mut reader = csv::Reader::from_reader(&text[..whole]);
    let broken = |line, what| ReportError::Broken(path.into(), line, what);
    let mut lines = reader.deserialize::<T>();
    while let Some(line) = lines.next() {
        let end = lines.reader().position().line();
        let line = line.map_err(|error| {
            let at = error.position().map_or(end, csv::Position::line);
            broken(at, in_words(&error))
        })?;
        take(line).map_err(|what| broken(end - 1, what))?;
    }
    Ok(())
}

fn in_words(error: &csv::Error) -> String {
    match error.kind() {
        ErrorKind::UnequalLengths { expected_len, len, .. } => {
            format!("has {len} fields, expected {expected_len}")
        }
        ErrorKind::Deserialize { err, .. } => err.to_string(),
        _ => error.to_string(),
    }
}
