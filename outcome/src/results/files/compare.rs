//! Comparison of two lockstep runs: whether they are equal, and where they differ first.
//!
//! In lockstep the tables, the recording and the summary without its section `wall` are a function of the
//! experiment, byte for byte, for one executable on one kind of machine.

use std::fmt::{self, Write as _};
use std::io::{self, BufRead, BufReader, Read};
use std::path::{Path, PathBuf};

use experiment::campaign::cells::sha256;
use experiment::scenario::file::{open_inside_folder, read_inside_folder};
use protocol::regular_file;
use serde::Serialize;
use serde_json::Value;

use crate::results::files::checksums;
use crate::results::run_dir::{
    MANIFEST_FILE, OPTIONAL_TABLES, RECORDING_FILE, REPRODUCIBLE_TABLES, SUMMARY_FILE,
};

/// Keys of the manifest that may explain a difference, with their descriptions.
const ORIGIN_KEYS: [(&str, &str); 9] = [
    ("phalanx", "version of phalanx"),
    ("git_hash", "commit"),
    ("git_dirty", "sources differ from the commit"),
    ("rustc", "compiler"),
    ("profile", "build profile"),
    ("libc", "C library, with the mathematical functions"),
    ("machine", "architecture"),
    ("processor", "processor"),
    ("kernel", "kernel"),
];

/// Maximum size of a summary or manifest, bytes. A larger one is an error.
const JSON_BYTES_MAX: u64 = 1 << 30;
/// Maximum length of a line of a table, bytes. A longer one is an error.
const LINE_BYTES_MAX: u64 = 1 << 24;

/// Reason why a run cannot be repeated bit by bit.
#[derive(Debug, thiserror::Error)]
pub enum RepeatabilityError {
    /// A file of the run is missing or malformed.
    #[error("{} is not a complete run: {}: {}", .0.display(), .1, .2)]
    UnreadableFile(PathBuf, &'static str, io::Error),
    /// The run was affected by unplanned events: the reason, and what can be verified.
    #[error("{} {}", .0.display(), .1)]
    UnplannedEvent(PathBuf, String),
}

/// Checks that a run can be repeated bit by bit.
///
/// # Errors
///
/// The run is not complete, in real time, interrupted, or was changed manually.
pub fn check_repeatable(run_dir: &Path) -> Result<(), RepeatabilityError> {
    let unreadable_file =
        |file| move |error| RepeatabilityError::UnreadableFile(run_dir.into(), file, error);
    let unplanned_event = |reason| Err(RepeatabilityError::UnplannedEvent(run_dir.into(), reason));
    let manifest = read_json(run_dir, MANIFEST_FILE).map_err(unreadable_file(MANIFEST_FILE))?;
    if manifest["pace"] != "lockstep" {
        return unplanned_event(
            "is a run in real time, which cannot be repeated; only runs with --pace lockstep can be verified"
                .to_owned(),
        );
    }
    let summary = read_json(run_dir, SUMMARY_FILE).map_err(unreadable_file(SUMMARY_FILE))?;
    if summary["interrupted"] == true {
        let t_s = summary["t_s"].as_f64().unwrap_or_default();
        return unplanned_event(format!(
            "was interrupted at {t_s} s; only a run that ended by itself can be verified"
        ));
    }
    match summary["acts_by_hand"].as_u64() {
        None | Some(0) => Ok(()),
        Some(count) => unplanned_event(format!(
            "was changed manually, which cannot be repeated ({count} times)"
        )),
    }
}

fn read_json(run_dir: &Path, name: &str) -> io::Result<Value> {
    Ok(serde_json::from_slice(&read_inside_folder(run_dir, name, JSON_BYTES_MAX)?)?)
}

/// Comparison of two runs. In every pair the first value is of the recorded run, the second of the new one.
#[derive(Debug, Serialize)]
pub struct Comparison {
    /// Whether the runs are equal, bit by bit.
    pub same: bool,
    /// Trajectory hashes.
    pub trajectory_hash: [Value; 2],
    /// First second of simulated time, counted from 0, in which the trajectories differ.
    pub first_second: Option<u64>,
    /// Comparison of each file. The recording contains version and commit: if these differ, it is compared with its
    /// checksum, if there is one.
    pub files: Vec<FileComparison>,
    /// Differences of executable and machine.
    pub origins: Vec<OriginDifference>,
}

/// Comparison of one file of two runs.
#[derive(Debug, Serialize)]
pub struct FileComparison {
    /// Name of the file.
    pub file: &'static str,
    /// First difference as text; `None` if the files are equal.
    pub first_difference: Option<String>,
}

/// A difference in the provenance of two runs.
#[derive(Debug, PartialEq, Serialize)]
pub struct OriginDifference {
    /// Description of what differs.
    pub what: &'static str,
    /// Value for each run; null if it is not known.
    pub values: [Value; 2],
}

impl Comparison {
    /// Compares a recorded run with a new one.
    pub fn compare(recorded: &Path, repeated: &Path) -> io::Result<Comparison> {
        let read_both = |name: &str| -> io::Result<[Value; 2]> {
            Ok([read_json(recorded, name)?, read_json(repeated, name)?])
        };
        let (summaries, manifests) = (read_both(SUMMARY_FILE)?, read_both(MANIFEST_FILE)?);
        let hashes = |key| summaries.each_ref().map(|summary| summary[key].clone());
        let trajectory_hash = hashes("trajectory_hash");
        // The recording contains version and commit.
        let is_same_source =
            ["phalanx", "git_hash"].iter().all(|&key| manifests[0][key] == manifests[1][key]);
        let listed_checksum = checksums::read_listed_checksum(recorded, RECORDING_FILE);
        let files: Vec<FileComparison> = (REPRODUCIBLE_TABLES.into_iter())
            .chain([SUMMARY_FILE, RECORDING_FILE])
            .filter(|&file| file != RECORDING_FILE || is_same_source || listed_checksum.is_some())
            .filter(|file| {
                !OPTIONAL_TABLES.contains(file)
                    || [recorded, repeated].iter().any(|run| run.join(file).exists())
            })
            .map(|file| {
                let open_both = || {
                    Ok([open_inside_folder(recorded, file)?, open_inside_folder(repeated, file)?])
                };
                let first_difference = match file {
                    RECORDING_FILE if is_same_source => open_both().and_then(first_different_byte),
                    RECORDING_FILE => {
                        open_inside_folder(recorded, file).and_then(sha256).map(|found| {
                            let differs = listed_checksum.as_ref() != Some(&found);
                            differs.then(|| "differs from what the run wrote".to_owned())
                        })
                    }
                    SUMMARY_FILE => Ok(first_summary_difference(&summaries)),
                    _ => open_both().and_then(first_different_line),
                };
                let with_file_name =
                    |error: io::Error| io::Error::new(error.kind(), format!("{file}: {error}"));
                Ok(FileComparison {
                    file,
                    first_difference: first_difference.map_err(with_file_name)?,
                })
            })
            .collect::<io::Result<_>>()?;
        let origins = ORIGIN_KEYS.iter().filter_map(|&(key, what)| {
            let values = manifests.each_ref().map(|manifest| manifest[key].clone());
            (values[0] != values[1]).then_some(OriginDifference { what, values })
        });
        let is_same_hash = trajectory_hash[0] == trajectory_hash[1];
        Ok(Comparison {
            same: is_same_hash && files.iter().all(|file| file.first_difference.is_none()),
            first_second: if is_same_hash {
                None
            } else {
                first_different_second(&hashes("hash_by_second"))
            },
            trajectory_hash,
            files,
            origins: origins.collect(),
        })
    }
}

/// Returns the first second whose hashes differ, or the one after the last that both have.
fn first_different_second(chains: &[Value; 2]) -> Option<u64> {
    let [recorded, repeated] = chains.each_ref().map(|chain| chain.as_array());
    let (recorded, repeated) = (recorded?, repeated?);
    let equal_count = recorded.iter().zip(repeated).take_while(|(a, b)| a == b).count();
    (!recorded.is_empty() || !repeated.is_empty()).then_some(equal_count as u64)
}

/// Returns the first difference of two tables: the line, its first two columns, and the first column that differs.
fn first_different_line(files: [impl Read; 2]) -> io::Result<Option<String>> {
    let [mut recorded, mut repeated] = files.map(BufReader::new);
    let mut header = None;
    for number in 1.. {
        let lines = match (next_line(&mut recorded)?, next_line(&mut repeated)?) {
            (None, None) => break,
            (Some(_), None) => return Ok(Some(format!("line {number} is missing now"))),
            (None, Some(_)) => return Ok(Some(format!("line {number} was not there"))),
            (Some(recorded), Some(repeated)) => [recorded, repeated],
        };
        if lines[0] != lines[1] {
            return Ok(Some(difference_text(
                number,
                header.as_deref().unwrap_or_default(),
                &lines,
            )));
        }
        header.get_or_insert_with(|| lines[0].clone());
    }
    Ok(None)
}

/// Returns the next line with its line end; `None` at the end of the file.
///
/// # Errors
///
/// The line has more than [`LINE_BYTES_MAX`] bytes or is not UTF-8.
fn next_line(file: &mut impl BufRead) -> io::Result<Option<String>> {
    let mut line = Vec::new();
    file.take(LINE_BYTES_MAX).read_until(b'\n', &mut line)?;
    if line.len() as u64 == LINE_BYTES_MAX && line.last() != Some(&b'\n') {
        let message =
            format!("it has a line of more than {LINE_BYTES_MAX} bytes, expected a table");
        return Err(io::Error::other(message));
    }
    if line.is_empty() { Ok(None) } else { regular_file::decode_utf8(line).map(Some) }
}

/// Splits a line from its line end, which is empty, "\n" or "\r\n".
fn split_line_end(line: &str) -> (&str, &str) {
    line.split_at(line.trim_end_matches(['\r', '\n']).len())
}

fn difference_text(number: usize, header: &str, lines: &[String; 2]) -> String {
    let split = lines.each_ref().map(|line| split_line_end(line));
    let [lines, line_ends] = [split.map(|(line, _)| line), split.map(|(_, end)| end)];
    if lines[0] == lines[1] {
        return format!(
            "line {number} ended with {:?}, ends with {:?}",
            line_ends[0], line_ends[1]
        );
    }
    let (header, _) = split_line_end(header);
    let names: Vec<&str> = header.split(',').collect();
    let fields = lines.each_ref().map(|line| line.split(',').collect::<Vec<_>>());
    let mut text = format!("line {number}");
    let column = fields[0].iter().zip(&fields[1]).position(|(a, b)| a != b);
    match column {
        Some(column) if column < names.len() => {
            for key_column in 0..column.min(2) {
                let _ = write!(text, ", {} {}", names[key_column], fields[0][key_column]);
            }
            let _ = write!(
                text,
                ": {} was {}, is {}",
                names[column], fields[0][column], fields[1][column]
            );
        }
        _ => {
            let _ = write!(text, " was {:?}, is {:?}", lines[0], lines[1]);
        }
    }
    text
}

/// Returns the offset of the first difference of two recordings.
fn first_different_byte(files: [impl Read; 2]) -> io::Result<Option<String>> {
    let [mut recorded, mut repeated] = files.map(|file| BufReader::new(file).bytes());
    for offset in 0_u64.. {
        match (recorded.next().transpose()?, repeated.next().transpose()?) {
            (None, None) => break,
            (a, b) if a != b => return Ok(Some(format!("byte {offset}"))),
            _ => (),
        }
    }
    Ok(None)
}

/// Returns the first entry in which two summaries differ, without the section `wall`.
fn first_summary_difference(summaries: &[Value; 2]) -> Option<String> {
    let [recorded, repeated] = summaries.each_ref().map(|summary| {
        let mut without_wall = summary.clone();
        without_wall.as_object_mut().map(|entries| entries.remove("wall"));
        without_wall
    });
    first_differing_entry(&recorded, &repeated, String::new())
}

fn first_differing_entry(recorded: &Value, repeated: &Value, path: String) -> Option<String> {
    match (recorded, repeated) {
        (Value::Object(a), Value::Object(b)) if a.keys().eq(b.keys()) => {
            a.iter().find_map(|(key, value)| {
                first_differing_entry(value, &b[key], format!("{path}/{key}"))
            })
        }
        (Value::Array(a), Value::Array(b)) if a.len() == b.len() => {
            let pairs = a.iter().zip(b).enumerate();
            pairs
                .map(|(i, (a, b))| first_differing_entry(a, b, format!("{path}/{i}")))
                .find_map(|found| found)
        }
        (a, b) if a == b => None,
        (Value::Object(a), Value::Object(b)) => {
            let removed_key = a.keys().find(|&key| !b.contains_key(key));
            let added_key = || b.keys().find(|&key| !a.contains_key(key));
            Some(match (removed_key, added_key()) {
                (Some(key), _) => format!("{path}/{key} is missing now"),
                (None, Some(key)) => format!("{path}/{key} was not there"),
                (None, None) => format!("{path}: another order"),
            })
        }
        (a, b) => Some(format!("{path} was {}, is {}", format_short(a), format_short(b))),
    }
}

/// Formats a value in one line, truncated if it is long.
fn format_short(value: &Value) -> String {
    let text = value.to_string();
    match text.char_indices().nth(60) {
        Some((end, _)) => format!("{}...", &text[..end]),
        None => text,
    }
}

impl fmt::Display for Comparison {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let format_value =
            |value: &Value| value.as_str().map_or_else(|| format_short(value), str::to_owned);
        let [recorded, repeated] = self.trajectory_hash.each_ref().map(format_value);
        if self.same {
            writeln!(f, "the same, bit by bit")?;
            writeln!(f, "trajectory hash     {repeated}")?;
        } else {
            writeln!(f, "NOT the same")?;
            match recorded == repeated {
                true => writeln!(f, "trajectory hash     {repeated}, as recorded")?,
                false => writeln!(f, "trajectory hash     was {recorded}, is {repeated}")?,
            }
        }
        if let Some(second) = self.first_second {
            let end = second + 1;
            writeln!(f, "first difference    between {second} s and {end} s of simulated time")?;
        }
        for FileComparison { file, first_difference } in &self.files {
            let outcome = first_difference.as_deref().unwrap_or("the same");
            writeln!(f, "{file:<19} {outcome}")?;
        }
        for OriginDifference { what, values } in &self.origins {
            let [recorded, repeated] = values.each_ref().map(format_value);
            writeln!(f, "{what}: was {recorded}, is {repeated}")?;
        }
        if !self.same && self.origins.is_empty() {
            writeln!(
                f,
                "executable and machine are of the same kind, as far as the manifests tell"
            )?;
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use serde_json::json;

    #[test]
    fn tables_differ_at_a_line_and_a_column() {
        let first_difference = |recorded: &str, repeated: &str| {
            first_different_line([recorded.as_bytes(), repeated.as_bytes()]).unwrap()
        };
        let table = "t_s,robot,x_m\n0,r1,1\n0,r2,2\n";
        assert_eq!(first_difference(table, table), None);
        let moved = first_difference(table, "t_s,robot,x_m\n0,r1,1\n0,r2,3\n").unwrap();
        assert_eq!(moved, "line 3, t_s 0, robot r2: x_m was 2, is 3");
        assert_eq!(
            first_difference(table, "t_s,robot,x_m\n0,r1,1\n").unwrap(),
            "line 3 is missing now"
        );
        assert_eq!(first_difference("t_s\n", "t_s\n0\n").unwrap(), "line 2 was not there");
        assert!(
            first_difference("t_s\n", "t_s,x\n").unwrap().contains("line 1 was"),
            "other columns"
        );
    }

    #[test]
    fn tables_with_other_line_ends_differ() {
        let first_difference = |recorded: &str, repeated: &str| {
            first_different_line([recorded.as_bytes(), repeated.as_bytes()]).unwrap()
        };
        let crlf = first_difference("t_s,x\r\n0,1\r\n", "t_s,x\n0,1\n").unwrap();
        assert_eq!(crlf, r#"line 1 ended with "\r\n", ends with "\n""#);
        let without_line_end = first_difference("t_s,x\n0,1", "t_s,x\n0,1\n").unwrap();
        assert_eq!(without_line_end, r#"line 2 ended with "", ends with "\n""#);
        let two_differences = first_difference("t_s,x\r\n0,1\r\n", "t_s,x\r\n0,2\n").unwrap();
        assert_eq!(two_differences, "line 2, t_s 0: x was 1, is 2");
        let long =
            first_different_line([io::repeat(b'a'), io::repeat(b'a')]).unwrap_err().to_string();
        assert!(long.contains("a line of more than"), "{long}");
    }

    #[test]
    fn recordings_differ_at_a_byte_or_in_length() {
        for (repeated, expected) in [("abc", None), ("abx", Some("byte 2")), ("ab", Some("byte 2"))]
        {
            let first_difference = first_different_byte([b"abc", repeated.as_bytes()]).unwrap();
            assert_eq!(first_difference.as_deref(), expected);
        }
    }

    #[test]
    fn summaries_differ_at_an_entry_and_never_by_wall_time() {
        let summary = |x: f64, wall: u64| json!({ "faults": [{ "x": x }], "wall": wall });
        assert_eq!(first_summary_difference(&[summary(1.0, 1), summary(1.0, 2)]), None);
        let changed = first_summary_difference(&[summary(1.0, 1), summary(2.0, 1)]).unwrap();
        assert_eq!(changed, "/faults/0/x was 1.0, is 2.0");
        let more = first_summary_difference(&[json!({}), json!({ "new": 1 })]).unwrap();
        assert_eq!(more, "/new was not there");
    }
}
