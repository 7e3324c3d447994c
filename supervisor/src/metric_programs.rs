//! Programs of the scenario that compute metrics from the directory of a run, once it has ended.
//!
//! Must not: decide what follows from a metric.

use std::path::Path;
use std::time::{Duration, Instant};

use experiment::scenario::{MetricProgram, Scenario};
use formation::ns_to_seconds;
use outcome::metrics::program_output::parse_metrics;
use outcome::results::programs::program_command;
use protocol::process::StopFlag;
use protocol::regular_file::{self, SymlinkPolicy};

use crate::child::describe_exit;
use crate::spawn::{Launcher, ProcessRole};

/// Interval at which signals and the deadline are checked.
const POLL_INTERVAL: Duration = Duration::from_millis(20);
/// Maximum size of the output of a program, bytes.
const OUTPUT_BYTES_MAX: u64 = 1 << 20;
/// Number of lines of the log that an error shows.
const SHOWN_LOG_LINES: usize = 8;

/// Runs all programs that compute metrics of a run, one after the other, and returns the metrics. The directory of the
/// run must be complete except for its summary, and have copies of the programs.
///
/// # Errors
///
/// A program cannot be started, fails, exceeds its deadline, or prints no valid metrics. All its processes have ended.
pub fn compute_metrics(
    scenario: &Scenario,
    run_dir: &Path,
    launcher: &Launcher,
    stop: &StopFlag,
) -> Result<Vec<(String, Option<f64>)>, String> {
    let mut metrics = Vec::new();
    for program in scenario.metric_programs() {
        let with_program_name = |reason: String| {
            let command_line = program.program.command_line.join(" ");
            format!("the metrics program `{command_line}` {reason}")
        };
        metrics.extend(run_program(&program, run_dir, launcher, stop).map_err(with_program_name)?);
    }
    Ok(metrics)
}

/// Runs one program. The error is a predicate of the program.
fn run_program(
    program: &MetricProgram<'_>,
    run_dir: &Path,
    launcher: &Launcher,
    stop: &StopFlag,
) -> Result<Vec<(String, Option<f64>)>, String> {
    let run_dir = std::path::absolute(run_dir).unwrap_or_else(|_| run_dir.into());
    let command = program_command(program.program, &run_dir);
    let stem = format!("metrics-{}", program.metrics[0]);
    let logs = run_dir.join("logs");
    let (log, output) = (logs.join(format!("{stem}.jsonl")), logs.join(format!("{stem}.json")));
    let role = ProcessRole::Metrics { run_dir: &run_dir, program: &command, output: &output };
    let child = launcher.spawn(role, &log);
    let mut child = child.map_err(|error| format!("was not started: {error}"))?;
    let (start, limit) = (Instant::now(), Duration::from_nanos(program.deadline_ns));
    let status = loop {
        if let Some(status) = child.wait_timeout(POLL_INTERVAL) {
            break status;
        }
        let is_late = start.elapsed() > limit;
        if is_late || stop.is_requested() {
            child.kill_and_wait();
            return Err(match is_late {
                true => format!(
                    "took more than {} s (deadline_s), and was killed",
                    ns_to_seconds(program.deadline_ns)
                ),
                false => "was interrupted".to_owned(),
            });
        }
    };
    if !status.success() {
        let lines = child.last_lines(SHOWN_LOG_LINES);
        let lines = if lines.is_empty() { String::new() } else { format!(":\n{lines}") };
        return Err(format!("failed ({}){lines}", describe_exit(status)));
    }
    let text = regular_file::read_to_string(&output, SymlinkPolicy::Refused, OUTPUT_BYTES_MAX);
    let text = text.map_err(|error| format!("printed what cannot be read: {error}"))?;
    parse_metrics(&text, &program.metrics)
}
