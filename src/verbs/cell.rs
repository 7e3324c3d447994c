//! `phalanx run --cell DIR`: one run of a campaign. It is written to a temporary directory next to DIR and
//! renamed when complete, so that DIR either is a complete run or does not exist.
//!
//! The exit code says whether DIR exists, independent of expectations: 0 if it does, 4 after an
//! infrastructure failure, 130 if interrupted.

use std::path::PathBuf;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

use clap::Args;
use experiment::campaign::file::FileRetention;
use outcome::campaign::folder::{append_failure, complete_run, partial_dir, prepare_run};
use protocol::process::{StopFlag, exit};

use super::execute::{ExecutionOptions, RunEnd, execute};
use super::screen::print_failure;
use experiment::scenario::Scenario;
use outcome::results::manifest::Manifest;
use outcome::results::run_dir::RunLocation;

/// Options of a run of a campaign.
#[derive(Debug, Args)]
pub(super) struct CellArgs {
    /// Directory of a run of a campaign.
    #[arg(long, value_name = "DIR", hide = true, conflicts_with_all = ["out", "view", "output"])]
    pub(super) cell: Option<PathBuf>,
    /// Files to keep.
    #[arg(long, hide = true, requires = "cell", default_value = "summary", value_parser = parse_file_retention)]
    keep: FileRetention,
    /// Deadline of the run, s.
    #[arg(long, value_name = "SECONDS", hide = true, requires = "cell", value_parser = parse_seconds)]
    deadline_s: Option<Duration>,
}

fn parse_seconds(text: &str) -> Result<Duration, String> {
    let number: f64 = text.parse().map_err(|_| "must be a number".to_owned())?;
    Duration::try_from_secs_f64(number).map_err(|error| error.to_string())
}

fn parse_file_retention(text: &str) -> Result<FileRetention, String> {
    let mut values =
        [FileRetention::Summary, FileRetention::Failed, FileRetention::All].into_iter();
    values
        .find(|value| value.keyword() == text)
        .ok_or_else(|| "must be summary, failed or all".into())
}

/// Executes a valid scenario as a run of a campaign and returns the exit code.
pub(super) fn execute_campaign_run(
    args: &CellArgs,
    cell: &std::path::Path,
    scenario: &Scenario,
    text: &str,
    manifest: &Manifest,
    options: ExecutionOptions,
) -> u8 {
    let retention = args.keep;
    match prepare_run(cell, retention) {
        Ok(true) => return exit::OK,
        Ok(false) => {}
        Err(error) => return print_failure(&error),
    }
    let out = partial_dir(cell);
    // Removes the partial directory of an earlier process with this number.
    let _ = std::fs::remove_dir_all(&out);
    let is_late = Arc::new(AtomicBool::new(false));
    let deadline_timer = args.deadline_s.map(|deadline| (deadline, Arc::clone(&is_late)));
    let start_deadline_timer = move |stop: &StopFlag| {
        let Some((deadline, is_late)) = deadline_timer else { return };
        let stop = stop.clone();
        // Never joined: the thread ends with the process.
        std::thread::spawn(move || {
            std::thread::sleep(deadline);
            is_late.store(true, Ordering::Relaxed);
            stop.request();
        });
    };
    let options = ExecutionOptions {
        is_recorded: retention != FileRetention::Summary,
        on_start: Some(Box::new(start_deadline_timer)),
        ..options
    };
    let remove_partial_dir = || {
        let _ = std::fs::remove_dir_all(&out);
    };
    let record_failure = |reason: &str| {
        remove_partial_dir();
        if let Err(error) = append_failure(cell, reason) {
            print_failure(&format_args!("cannot write next to {}: {error}", cell.display()));
        }
        exit::INFRASTRUCTURE_FAILURE
    };
    let report_failure = |reason: String| {
        print_failure(&reason);
        record_failure(&reason)
    };
    let result = match execute(scenario, text, manifest, &RunLocation::Path(out.clone()), options) {
        Ok(result) => result,
        Err(error) => return report_failure(error.to_string()),
    };
    match result.end {
        RunEnd::AsPlanned if result.all_files_written => {
            let has_passed = result.summary.exit == exit::OK;
            match complete_run(&out, cell, retention, has_passed) {
                Ok(()) => exit::OK,
                Err(error) => {
                    report_failure(format!("cannot complete {}: {error}", cell.display()))
                }
            }
        }
        RunEnd::Interrupted if is_late.load(Ordering::Relaxed) => {
            report_failure(format!("took more than {:?}", args.deadline_s.unwrap_or_default()))
        }
        RunEnd::Interrupted => {
            remove_partial_dir();
            exit::INTERRUPTED
        }
        RunEnd::AsPlanned => record_failure("some files could not be written"),
        RunEnd::Failed(reason) => record_failure(&reason),
    }
}
