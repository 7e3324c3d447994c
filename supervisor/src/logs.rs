//! Bound on the logs of a run: when a log becomes too long, its middle is replaced by a line with the
//! number of dropped bytes.

use std::collections::BTreeMap;
use std::fs::{self, OpenOptions};
use std::io::{self, Write as _};
use std::os::unix::fs::FileExt as _;
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

/// Maximum size of a log; exceeded at most until the next check.
pub(crate) const LOG_BYTES_MAX: u64 = 64 << 20;
/// Number of bytes kept from the start of a truncated log.
const BEGINNING_BYTES: u64 = LOG_BYTES_MAX / 2;
/// Number of bytes kept from the end of a truncated log.
const END_BYTES: u64 = 16 << 10;
/// Interval at which sizes are checked.
const CHECK_INTERVAL: Duration = Duration::from_millis(200);

/// Logs in a run's directory.
pub(crate) struct Logs {
    folder: PathBuf,
    last_poll: Instant,
    dropped_parts: BTreeMap<PathBuf, DroppedLogPart>,
}

/// Record of what was dropped from one log.
#[derive(Default)]
struct DroppedLogPart {
    bytes: u64,
    /// Length of the line in the log that reports the dropped bytes, bytes.
    line_bytes: u64,
}

impl Logs {
    /// Creates the bound for the logs of this folder.
    pub(crate) fn new(folder: &Path) -> Logs {
        Logs { folder: folder.into(), last_poll: Instant::now(), dropped_parts: BTreeMap::new() }
    }

    /// Truncates logs that are too long, if a check is due.
    pub(crate) fn truncate_if_due(&mut self) {
        if self.last_poll.elapsed() >= CHECK_INTERVAL {
            self.last_poll = Instant::now();
            self.shorten_all();
        }
    }

    /// Truncates all logs that are too long.
    pub(crate) fn shorten_all(&mut self) {
        for entry in fs::read_dir(&self.folder).into_iter().flatten().flatten() {
            // A symbolic link is not a log.
            let is_too_long = |file: fs::Metadata| file.is_file() && file.len() > LOG_BYTES_MAX;
            if entry.metadata().is_ok_and(is_too_long)
                && let Err(error) = self.shorten(&entry.path())
            {
                tracing::warn!("cannot shorten {}: {error}", entry.path().display());
            }
        }
    }

    /// Truncates a log. Processes that write meanwhile append to the remaining file.
    fn shorten(&mut self, path: &Path) -> io::Result<()> {
        let mut file = OpenOptions::new().read(true).append(true).open(path)?;
        let length = file.metadata()?.len();
        let mut end = vec![0; END_BYTES as usize];
        file.read_exact_at(&mut end, length - END_BYTES)?;
        let line_end = end.iter().position(|&byte| byte == b'\n');
        let end = &end[line_end.map_or(0, |index| index + 1)..];
        file.set_len(BEGINNING_BYTES)?;
        if !self.dropped_parts.contains_key(path) {
            let mib = LOG_BYTES_MAX >> 20;
            tracing::warn!("{} is longer than {mib} MiB; dropped its middle", path.display());
        }
        let dropped_part = self.dropped_parts.entry(path.into()).or_default();
        dropped_part.bytes += length - BEGINNING_BYTES - end.len() as u64 - dropped_part.line_bytes;
        let line = format!(
            "\n{{\"level\":\"WARN\",\"message\":\"{} bytes were dropped here: the limit of a log is {} MiB\"}}\n",
            dropped_part.bytes,
            LOG_BYTES_MAX >> 20
        );
        dropped_part.line_bytes = line.len() as u64;
        file.write_all(&[line.as_bytes(), end].concat())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn truncated_log_keeps_both_ends_and_counts_dropped_bytes() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("r1.jsonl");
        let mut log = OpenOptions::new().create(true).append(true).open(&path).unwrap();
        let mut logs = Logs::new(folder.path());
        let line = format!("{:>63}\n", "x");
        let (mut written, mut truncations) = (0, 0);
        while truncations < 3 {
            let text = line.repeat(1 << 18);
            written += text.len() as u64;
            log.write_all(text.as_bytes()).unwrap();
            let before = log.metadata().unwrap().len();
            logs.shorten_all();
            truncations += u64::from(log.metadata().unwrap().len() < before);
        }
        log.write_all(b"the end\n").unwrap();
        let text = fs::read_to_string(&path).unwrap();
        assert!(text.len() as u64 <= LOG_BYTES_MAX, "{}", text.len());
        let report_lines: Vec<&str> =
            text.lines().filter(|line| line.contains("dropped")).collect();
        let [report_line] = report_lines[..] else { panic!("one line says so: {report_lines:?}") };
        let kept_bytes =
            (text.lines().filter(|line| line.ends_with(" x")).count() * line.len()) as u64;
        assert!(
            report_line.contains(&format!("\"{} bytes were", written - kept_bytes)),
            "{report_line} {kept_bytes}"
        );
        assert!(text.ends_with(" x\nthe end\n"), "what was said last is there");
    }
}
