//! One run of a campaign within this process. Writes the same directory as `phalanx run --cell`, except for
//! briefs and logs of processes.

use std::any::Any;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::Path;
use std::sync::Mutex;
use std::time::{Duration, Instant};

use crate::pool::processes::ProcessExecutor;
use crate::pool::{AttemptResult, RunExecutor};
use experiment::campaign::cells::CampaignRun;
use experiment::campaign::file::{Campaign, FileRetention};
use experiment::scenario::Scenario;
use experiment::scenario::read::{read_for_run, scenario_folder};
use outcome::campaign::folder::{CampaignFolder, complete_run, partial_dir, prepare_run};
use outcome::metrics::Metrics;
use outcome::metrics::summary::ProcessUsage;
use outcome::results::manifest::{BuildInfo, Manifest};
use outcome::results::outcome::RunOutcome;
use outcome::results::programs::Programs;
use outcome::results::run_dir::{RunDir, RunDirError};
use outcome::results::usage;
use protocol::brief::Pace;
use protocol::catalog::Catalog;
use protocol::clock::now_ns;
use protocol::process::{StopFlag, exit};

use super::execute::evaluate_and_write;
use run::in_process::measured::{self, MeasuredRun, create_controller};

/// Execution of a campaign's runs within this process.
pub(super) struct InProcessExecutor<'a> {
    pub(super) campaign: &'a Campaign,
    pub(super) folder: &'a CampaignFolder,
    pub(super) catalog: &'a Catalog,
    pub(super) build: &'a BuildInfo,
    pub(super) stop: &'a StopFlag,
    /// Fallback for runs that need processes.
    pub(super) process_executor: ProcessExecutor<'a>,
    /// Number of runs that needed processes, and the reason for the first of them.
    pub(super) process_fallback: Mutex<(usize, &'static str)>,
}

impl RunExecutor for InProcessExecutor<'_> {
    fn attempt(&self, cell: &CampaignRun) -> AttemptResult {
        let read_result = read_for_run(&cell.scenario, &cell.overrides, self.catalog);
        let (scenario, text) = match read_result {
            Ok((scenario, text, _)) => (scenario, text),
            Err(diagnostic) => return AttemptResult::Refused(diagnostic.render(false)),
        };
        if let Some(reason) = measured::reason_for_processes(&scenario) {
            let mut fallback =
                self.process_fallback.lock().expect("no thread panics while it holds the lock");
            fallback.1 = if fallback.0 == 0 { reason } else { fallback.1 };
            fallback.0 += 1;
            drop(fallback);
            return self.process_executor.attempt(cell);
        }
        let run_path = self.folder.run_path(&cell.id);
        let partial_dir = partial_dir(&run_path);
        // Removes the partial directory of an earlier attempt.
        let _ = std::fs::remove_dir_all(&partial_dir);
        let result =
            catch_failures(|| self.run(&scenario, &text, &cell.scenario, &partial_dir, &run_path));
        if result != AttemptResult::Done {
            let _ = std::fs::remove_dir_all(&partial_dir);
        }
        result
    }

    fn has_own_cores(&self) -> bool {
        false
    }
}

impl InProcessExecutor<'_> {
    /// Executes a valid scenario of the file `scenario_path` into `partial_dir`, which is renamed to `run_path` when
    /// complete.
    fn run(
        &self,
        scenario: &Scenario,
        text: &str,
        scenario_path: &Path,
        partial_dir: &Path,
        run_path: &Path,
    ) -> Result<AttemptResult, String> {
        let (retention, pace) = (self.campaign.file_retention, Pace::Lockstep);
        if prepare_run(run_path, retention).map_err(format_error)? {
            return Ok(AttemptResult::Done);
        }
        let programs = Programs::read(scenario, scenario_folder(scenario_path))
            .map_err(|(path, error)| format!("cannot read {}: {error}", path.display()))?;
        let mut manifest = Manifest::collect(scenario, scenario_path, pace, self.build);
        manifest.programs = programs.manifest_files();
        let is_recorded = retention != FileRetention::Summary;
        let create_result =
            create_run_dir(scenario, text, &manifest, partial_dir, is_recorded, &programs);
        let mut run_dir = create_result.map_err(format_error)?;
        let mut metrics = Metrics::new(scenario, pace);
        let start = Instant::now();
        let deadline = Duration::from_secs_f64(self.campaign.deadline_s);
        let should_continue = || !self.stop.is_requested() && start.elapsed() < deadline;
        let (mut outcome, result) =
            simulate_to_end(scenario, &mut run_dir, &mut metrics, should_continue);
        result.map_err(format_error)?;
        if outcome.was_interrupted {
            return match self.stop.is_requested() {
                true => Ok(AttemptResult::Stopped),
                false => Err(format!("took more than {deadline:?}")),
            };
        }
        let launcher = self.process_executor.launcher;
        let end_inputs = (exit::OK, launcher, self.stop);
        let evaluated_run =
            evaluate_and_write(scenario, pace, &metrics, &mut outcome, end_inputs, &mut run_dir);
        if let Some(error) = evaluated_run.first_error() {
            return Err(error);
        }
        let has_passed = evaluated_run.summary.exit == exit::OK;
        complete_run(partial_dir, run_path, retention, has_passed)
            .map_err(|error| format!("cannot complete {}: {error}", run_path.display()))?;
        Ok(AttemptResult::Done)
    }
}

/// Creates the directory `partial_dir` of a run, with the files written before the first ground truth sample, and
/// copies of these programs. It is recorded if `is_recorded`, or if a program computes metrics from it.
pub(super) fn create_run_dir(
    scenario: &Scenario,
    text: &str,
    manifest: &Manifest,
    partial_dir: &Path,
    is_recorded: bool,
    programs: &Programs,
) -> Result<RunDir, RunDirError> {
    let mut run_dir = RunDir::create(partial_dir, scenario)?;
    run_dir.write_initial_files(text, manifest, is_recorded || scenario.has_metric_programs())?;
    if scenario.has_metric_programs() {
        run_dir.write_programs(programs)?;
    }
    Ok(run_dir)
}

/// Runs a scenario to its end, or until `should_continue` returns `false`; it is called at every tick.
pub(super) fn simulate_to_end(
    scenario: &Scenario,
    run_dir: &mut RunDir,
    metrics: &mut Metrics,
    should_continue: impl Fn() -> bool,
) -> (RunOutcome, Result<(), RunDirError>) {
    let earlier_usage = usage::read_this_thread();
    let create_controller = Box::new(create_controller);
    let run = MeasuredRun::new(scenario, create_controller, run_dir, metrics, now_ns);
    let mut run = run.expect("it needs no processes");
    let start = Instant::now();
    let (was_interrupted, result) = loop {
        match run.record_truth_sample() {
            Ok(false) if should_continue() => run.advance_tick(),
            Ok(is_last) => break (!is_last, Ok(())),
            Err(error) => break (false, Err(error)),
        }
    };
    let wall_time = start.elapsed();
    let (outcome, _, write_result) = run.finish();
    let usage = usage::read_this_thread().usage_since(&earlier_usage);
    let usages = vec![ProcessUsage { name: THREAD_NAME.into(), starts: 1, usage }];
    (RunOutcome { was_interrupted, wall_time, usages, ..outcome }, result.and(write_result))
}

/// Name of the thread that computes the run, in the list of its processes.
const THREAD_NAME: &str = "all";

/// Returns the result of an attempt. Converts panics and errors into failures of this run, so that other
/// runs continue.
fn catch_failures(attempt: impl FnOnce() -> Result<AttemptResult, String>) -> AttemptResult {
    // The state of an attempt that panics is dropped.
    let result = catch_unwind(AssertUnwindSafe(attempt))
        .unwrap_or_else(|panic| Err(format!("panicked: {}", panic_message(&*panic))));
    result.unwrap_or_else(AttemptResult::Failed)
}

/// Returns the message of a panic.
pub(super) fn panic_message(panic: &(dyn Any + Send)) -> &str {
    let message = panic.downcast_ref::<String>().map(String::as_str);
    message.or_else(|| panic.downcast_ref::<&str>().copied()).unwrap_or("without a message")
}

pub(super) fn format_error(error: impl std::fmt::Display) -> String {
    error.to_string()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn run_that_panics_fails_with_the_message() {
        let failure = |message: &str| AttemptResult::Failed(message.to_owned());
        assert_eq!(catch_failures(|| panic!("no {}", 1)), failure("panicked: no 1"));
        assert_eq!(catch_failures(|| panic!("none")), failure("panicked: none"));
        assert_eq!(catch_failures(|| Err("no room".into())), failure("no room"));
        assert_eq!(catch_failures(|| Ok(AttemptResult::Done)), AttemptResult::Done);
    }
}
