//! Margin computed by the calling program: each run is written to a directory, whose path is printed after
//! "? " as a line of standard output; the margin is read from the next line of standard input.

use std::fs;
use std::io::{self, Write as _};
use std::path::{Path, PathBuf};
use std::sync::Mutex;

use protocol::number::format_short;

use crate::verbs::cell_in_process::format_error;

/// Margin that the calling program computes.
pub(super) struct ExternalMargin {
    /// Name of the margin.
    pub(super) name: String,
    folder: PathBuf,
    /// Number of runs for which a margin was requested. The lock serializes the requests.
    margin_requests: Mutex<usize>,
}

impl ExternalMargin {
    /// Creates the margin with this name; runs are written below `folder`.
    pub(super) fn new(name: String, folder: PathBuf) -> ExternalMargin {
        ExternalMargin { name, folder, margin_requests: Mutex::new(0) }
    }

    /// Writes a run to a directory by `record`, and requests its margin. Fails if the run cannot be written, or the
    /// reply is missing or not a number.
    pub(super) fn record_and_request(
        &self,
        record: impl FnOnce(&Path) -> Result<(), String>,
    ) -> Result<f64, String> {
        let mut request_count = self.margin_requests.lock().map_err(format_error)?;
        *request_count += 1;
        let run_dir = self.folder.join(format!("asked-{request_count}"));
        record(&run_dir)?;
        let margin = self.read_margin(&run_dir);
        let _ = fs::remove_dir_all(&run_dir);
        margin
    }

    /// Requests the margin of a run that has been written to `run_dir`. Fails if the reply is missing or not a number.
    pub(super) fn request(&self, run_dir: &Path) -> Result<f64, String> {
        let _lock = self.margin_requests.lock().map_err(format_error)?;
        self.read_margin(run_dir)
    }

    fn read_margin(&self, run_dir: &Path) -> Result<f64, String> {
        let reply = request_margin(&run_dir.to_string_lossy()).map_err(format_error)?;
        match reply.trim().parse::<f64>() {
            Ok(margin) if !margin.is_nan() => Ok(margin),
            _ if reply.is_empty() => {
                Err(format!("the program that computes {} has exited", self.name))
            }
            _ => Err(format!("{} is {:?}, but must be a number", self.name, reply.trim())),
        }
    }

    /// Returns a sentence about a run with this margin.
    pub(super) fn describe(&self, margin: f64) -> String {
        format!("{} is {}; expected: at least 0", self.name, format_short(margin))
    }
}

fn request_margin(run_dir: &str) -> io::Result<String> {
    let mut stdout = io::stdout().lock();
    writeln!(stdout, "? {run_dir}")?;
    stdout.flush()?;
    let mut reply = String::new();
    io::stdin().read_line(&mut reply)?;
    Ok(reply)
}
