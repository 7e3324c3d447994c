//! `phalanx run --cell DIR`: one run of a campaign. It is written under another name beside DIR and
//! renamed when it is complete, so that DIR is a complete run or not there.
//!
//! The exit code says whether DIR is there now, not how the run came out: 0 whatever became of its
//! expectations, 4 if its machinery failed, 130 if it was interrupted.

use std::path::PathBuf;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

use clap::Args;
use experiment::campaign::file::Keep;
use outcome::campaign::folder::{append_failure, complete, partial_dir, prepare_run};
use protocol::process::{Stop, exit};

use super::execute::{End, How, execute};
use super::screen::complain;
use experiment::scenario::Scenario;
use outcome::results::manifest::Manifest;
use outcome::results::run_dir::RunLocation;

/// What makes a run one of a campaign.
#[derive(Debug, Args)]
pub(super) struct CellArgs {
    /// The directory of a run of a campaign.
    #[arg(long, value_name = "DIR", hide = true, conflicts_with_all = ["out", "view", "output"])]
    pub(super) cell: Option<PathBuf>,
    /// What is kept of it.
    #[arg(long, hide = true, requires = "cell", default_value = "summary", value_parser = keep)]
    keep: Keep,
    /// Longest that it may take.
    #[arg(long, value_name = "SECONDS", hide = true, requires = "cell", value_parser = seconds)]
    deadline_s: Option<Duration>,
}

fn seconds(text: &str) -> Result<Duration, String> {
    let number: f64 = text.parse().map_err(|_| "no number".to_owned())?;
    Duration::try_from_secs_f64(number).map_err(|error| error.to_string())
}

fn keep(word: &str) -> Result<Keep, String> {
    let mut all = [Keep::Summary, Keep::Failed, Keep::All].into_iter();
    all.find(|keep| keep.word() == word).ok_or_else(|| "no word for what is kept".into())
}

/// Runs a sound scenario as a run of a campaign.
pub(super) fn run(
    args: &CellArgs,
    cell: &std::path::Path,
    scenario: &Scenario,
    text: &str,
    manifest: &Manifest,
    how: How,
) -> u8 {
    let keep = args.keep;
    match prepare_run(cell, keep) {
        Ok(true) => return exit::OK,
        Ok(false) => {}
        Err(error) => return complain(&error),
    }
    let out = partial_dir(cell);
    // What a process of this number left.
    let _ = std::fs::remove_dir_all(&out);
    let late = Arc::new(AtomicBool::new(false));
    let bell = args.deadline_s.map(|deadline| (deadline, Arc::clone(&late)));
    let ring = move |stop: &Stop| {
        let Some((deadline, late)) = bell else { return };
        let stop = stop.clone();
        // Nobody waits for it: it ends with the process.
        std::thread::spawn(move || {
            std::thread::sleep(deadline);
            late.store(true, Ordering::Relaxed);
            stop.request();
        });
    };
    let how = How { recorded: keep != Keep::Summary, on_start: Some(Box::new(ring)), ..how };
    let remove = || {
        let _ = std::fs::remove_dir_all(&out);
    };
    let failed = |why: &str| {
        remove();
        if let Err(error) = append_failure(cell, why) {
            complain(&format_args!("cannot write beside {}: {error}", cell.display()));
        }
        exit::INFRASTRUCTURE
    };
    let told = |why: String| {
        complain(&why);
        failed(&why)
    };
    let ended = match execute(scenario, text, manifest, &RunLocation::Path(out.clone()), how) {
        Ok(ended) => ended,
        Err(error) => return told(error.to_string()),
    };
    match ended.end {
        End::AsPlanned if ended.written => {
            let passed = ended.summary.exit == exit::OK;
            match complete(&out, cell, keep, passed) {
                Ok(()) => exit::OK,
                Err(error) => told(format!("cannot complete {}: {error}", cell.display())),
            }
        }
        End::Interrupted if late.load(Ordering::Relaxed) => {
            told(format!("took more than {:?}", args.deadline_s.unwrap_or_default()))
        }
        End::Interrupted => {
            remove();
            exit::INTERRUPTED
        }
        End::AsPlanned => failed("not all of it could be written"),
        End::Failed(why) => failed(&why),
    }
}
