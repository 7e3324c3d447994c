//! Runs of a hunt with one process for each robot, for scenarios with programs of their own. Each is a `phalanx run`
//! in lockstep, in a directory that is removed once the run has been evaluated.

use std::fs;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicUsize, Ordering};

use experiment::campaign::file::FileRetention;
use experiment::scenario::Scenario;
use formation::ns_to_seconds;
use outcome::campaign::folder::{
    ATTEMPTS_MAX, RunState, partial_run_dir, read_failed_attempts, read_state, sibling_path,
};
use outcome::metrics::summary::Summary;
use outcome::results::page::{ReportError, for_each_sample};
use outcome::results::programs::Programs;
use protocol::message::TruthRow;
use protocol::process::{StopFlag, exit};
use supervisor::child::{Child, describe_exit};
use supervisor::spawn::{Launcher, ProcessRole};

use super::behavior::BehaviorRecorder;
use super::error::RunEvaluationError;
use crate::pool::processes::wait_for_run;
use crate::verbs::cell_in_process::format_error;

/// Name of the folder of the runs in progress, inside that of the hunt.
const RUNS_FOLDER_NAME: &str = "runs";
/// Minimum of the time after which a run is ended, s, and the multiple of its duration after which it is ended.
const DEADLINE_S_MIN: f64 = 600.0;
const DEADLINE_FACTOR: f64 = 10.0;
/// Number of lines of a log that are shown when a run fails.
const SHOWN_LOG_LINES: usize = 8;

/// Execution of the runs of a hunt by processes.
pub(super) struct HuntProcessExecutor<'a> {
    launcher: &'a Launcher,
    folder: PathBuf,
    programs: Programs,
    stop: &'a StopFlag,
    /// Number of runs that were started.
    started_runs: AtomicUsize,
}

impl<'a> HuntProcessExecutor<'a> {
    /// Creates the execution of runs with these programs, for the hunt in the folder `hunt_folder`. Nothing is
    /// written.
    pub(super) fn new(
        launcher: &'a Launcher,
        hunt_folder: &Path,
        programs: Programs,
        stop: &'a StopFlag,
    ) -> HuntProcessExecutor<'a> {
        let folder = std::path::absolute(hunt_folder)
            .unwrap_or_else(|_| hunt_folder.into())
            .join(RUNS_FOLDER_NAME);
        HuntProcessExecutor { launcher, folder, programs, stop, started_runs: AtomicUsize::new(0) }
    }

    /// Returns text that identifies the contents of the programs.
    pub(super) fn identity(&self) -> String {
        format!("{:?}", self.programs.manifest_files())
    }

    /// Creates the folder of the runs, and removes what a killed hunt left in it. The folder of the hunt must be
    /// locked.
    pub(super) fn prepare(&self) -> Result<(), String> {
        let _ = fs::remove_dir_all(&self.folder);
        fs::create_dir_all(&self.folder)
            .map_err(|error| format!("cannot make {}: {error}", self.folder.display()))?;
        self.copy_programs(&self.folder)
    }

    /// Removes the folder of the runs.
    pub(super) fn remove_runs_folder(&self) {
        let _ = fs::remove_dir_all(&self.folder);
    }

    /// Copies the programs next to a scenario in the folder `to`, and replaces older copies.
    pub(super) fn copy_programs(&self, to: &Path) -> Result<(), String> {
        let _ = fs::remove_dir_all(to.join(experiment::scenario::program::PROGRAMS_FOLDER));
        self.programs
            .write(to)
            .map_err(|(path, error)| format!("cannot write {}: {error}", path.display()))
    }

    /// Runs the scenario with this effective text, and passes the directory of the run and its summary to `evaluate`.
    /// The directory is removed afterwards.
    pub(super) fn run<T>(
        &self,
        scenario: &Scenario,
        text: &str,
        evaluate: impl FnOnce(&Path, Summary) -> Result<T, RunEvaluationError>,
    ) -> Result<T, RunEvaluationError> {
        let number = self.started_runs.fetch_add(1, Ordering::Relaxed);
        let run = self.folder.join(format!("run-{number}"));
        let file = run.with_extension("toml");
        fs::write(&file, text).map_err(|error| {
            RunEvaluationError::Failed(format!("cannot write {}: {error}", file.display()))
        })?;
        let result =
            self.run_file(scenario, &file, &run).and_then(|summary| evaluate(&run, summary));
        let _ = fs::remove_dir_all(&run);
        if !matches!(result, Err(RunEvaluationError::Failed(_))) {
            let _ = fs::remove_file(&file);
            for extension in ["log", "failed"] {
                let _ = fs::remove_file(sibling_path(&run, extension));
            }
        }
        result
    }

    /// Runs a scenario file, with its programs next to it, into the directory `run`, which is replaced. Repeats a run
    /// that an infrastructure failure ended.
    pub(super) fn run_file(
        &self,
        scenario: &Scenario,
        file: &Path,
        run: &Path,
    ) -> Result<Summary, RunEvaluationError> {
        let _ = fs::remove_dir_all(run);
        let deadline_s = DEADLINE_S_MIN.max(DEADLINE_FACTOR * ns_to_seconds(scenario.duration_ns));
        let mut reason = String::new();
        for _ in 0..ATTEMPTS_MAX {
            if self.stop.is_requested() {
                return Err(RunEvaluationError::Stopped);
            }
            reason = match self.attempt(file, run, deadline_s)? {
                None => match read_state(run, FileRetention::All).map_err(format_error) {
                    Ok(RunState::Done(summary)) => return Ok(*summary),
                    Ok(_) => "it left no complete result".to_owned(),
                    Err(reason) => reason,
                },
                Some(reason) => read_failed_attempts(run).last().cloned().unwrap_or(reason),
            };
        }
        Err(RunEvaluationError::Failed(format!(
            "{ATTEMPTS_MAX} times in a row: {reason}; `phalanx run {} --pace lockstep` repeats it",
            file.display()
        )))
    }

    /// Runs a scenario file once. Returns the reason if an infrastructure failure ended the run.
    fn attempt(
        &self,
        file: &Path,
        run: &Path,
        deadline_s: f64,
    ) -> Result<Option<String>, RunEvaluationError> {
        let deadline = deadline_s.to_string();
        let arguments = ["run".as_ref(), file.as_os_str(), "--pace".as_ref(), "lockstep".as_ref()];
        let cell_options = ["--cell".as_ref(), run.as_os_str(), "--keep".as_ref(), "all".as_ref()];
        let deadline_option = ["--deadline-s".as_ref(), deadline.as_ref()];
        let arguments: Vec<_> = arguments
            .into_iter()
            .chain(cell_options)
            .chain(deadline_option)
            .map(ToOwned::to_owned)
            .collect();
        let log = sibling_path(run, "log");
        let child = self.launcher.spawn(ProcessRole::Run { arguments: &arguments }, &log);
        let mut child = child.map_err(|error| RunEvaluationError::Failed(error.to_string()))?;
        let exit_status = wait_for_run(&mut child, self.stop, deadline_s);
        let _ = fs::remove_dir_all(partial_run_dir(run, child.pid()));
        let Some(status) = exit_status else {
            return match self.stop.is_requested() {
                true => Err(RunEvaluationError::Stopped),
                false => Ok(Some(format!("killed: it took more than {deadline_s} s"))),
            };
        };
        let lines = |child: &Child| child.last_lines(SHOWN_LOG_LINES);
        match status.code().map(|code| code as u8) {
            Some(exit::OK) => {
                let _ = fs::remove_file(&log);
                Ok(None)
            }
            Some(exit::USAGE_ERROR | exit::BAD_SCENARIO) => {
                Err(RunEvaluationError::Failed(lines(&child)))
            }
            _ => Ok(Some(describe_exit(status))),
        }
    }
}

/// Returns the behavior of a recorded run. Its samples do not have the commands in effect, nor whether a robot was
/// frozen: a robot that does not move at all counts as one without a command.
pub(super) fn recorded_behavior(scenario: &Scenario, run: &Path) -> Result<Vec<u16>, ReportError> {
    let front_point_offsets_m: Vec<f64> =
        scenario.robots.iter().map(|robot| robot.front_point_m).collect();
    let mut behavior =
        BehaviorRecorder::new(&front_point_offsets_m, scenario.avoidance.distance_min_m);
    let (mut rows, mut alive) = (Vec::new(), Vec::new());
    for_each_sample(run, |sample| {
        let mut row = TruthRow {
            x_m: sample.x_m,
            y_m: sample.y_m,
            heading_rad: sample.heading_rad,
            v_m_s: sample.v_m_s,
            side_m_s: sample.side_m_s,
            w_rad_s: sample.w_rad_s,
            ..TruthRow::default()
        };
        let is_moving = [row.v_m_s, row.side_m_s, row.w_rad_s].iter().any(|speed| *speed != 0.0);
        row.commanded = u64::from(is_moving);
        rows.push(row);
        alive.push(sample.alive);
        if rows.len() == front_point_offsets_m.len() {
            behavior.add_truth(&rows, &alive);
            rows.clear();
            alive.clear();
        }
    })?;
    Ok(behavior.into_observed_events())
}
