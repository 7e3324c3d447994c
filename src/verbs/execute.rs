//! Executes a valid scenario to its end by processes, evaluates it and records it: for `phalanx run`, for
//! one run of a campaign, and for `phalanx verify`.

use std::path::{Path, PathBuf};

use protocol::brief::Pace;
use protocol::process::{StopFlag, exit, never_block_on_stderr};
use protocol::ros2::Ros2Brief;
use run::journal::Journal;
use supervisor::metric_programs::compute_metrics;
use supervisor::run::launch::RunConnections;
use supervisor::run::{Run, RunError, exit_code};
use supervisor::spawn::Launcher;
use supervisor::view::{BoundServer, View, ViewError};

use super::Failure;
use super::fleet::HostPart;
use super::screen::{end_progress, print_failure, print_info, run_progress_bar, show_progress};
use experiment::scenario::read::scenario_folder;
use experiment::scenario::{FaultKind, Scenario};
use outcome::metrics::Metrics;
use outcome::metrics::expect::FailedRobot;
use outcome::metrics::summary::Summary;
use outcome::report::screen::format_screen;
use outcome::results::checksums;
use outcome::results::manifest::{BuildInfo, Manifest};
use outcome::results::outcome::RunOutcome;
use outcome::results::programs::Programs;
use outcome::results::run_dir::{RunDir, RunDirError, RunLocation};
use outcome::results::scene::build_scene;
use outcome::results::summary;

/// Callback that receives the stop flag of the run before it begins.
type StartCallback = Box<dyn FnOnce(&StopFlag)>;

/// Options of an execution.
pub(super) struct ExecutionOptions {
    pub(super) pace: Pace,
    pub(super) launcher: Launcher,
    pub(super) is_unmeasured: bool,
    /// Whether samples and recording are written.
    pub(super) is_recorded: bool,
    pub(super) live_view: Option<LiveView>,
    /// Contents of the programs of the scenario.
    pub(super) programs: Programs,
    /// Callback that receives the stop flag.
    pub(super) on_start: Option<StartCallback>,
    /// This host's part of a run on several hosts.
    pub(super) host_part: Option<HostPart>,
    /// Configuration of the ROS 2 bridge, without its run root.
    pub(super) ros2: Option<Ros2Brief>,
}

impl ExecutionOptions {
    /// Returns options for a run that is measured and recorded, without a live view.
    pub(super) fn new(pace: Pace, launcher: Launcher, programs: Programs) -> ExecutionOptions {
        ExecutionOptions {
            pace,
            launcher,
            is_unmeasured: false,
            is_recorded: true,
            live_view: None,
            programs,
            on_start: None,
            host_part: None,
            ros2: None,
        }
    }
}

/// Live view of the run, on a bound port.
pub(super) struct LiveView {
    pub(super) bound_port: BoundServer,
    /// Whether clients may inject faults.
    pub(super) allows_control: bool,
}

/// Result of an execution.
pub(super) struct ExecutionResult {
    /// Whether the robots started to move.
    pub(super) has_begun: bool,
    /// Directory of the run.
    pub(super) run_dir: PathBuf,
    /// Whether all files were written.
    pub(super) all_files_written: bool,
    pub(super) summary: Summary,
    /// Summary as text of at most one screen.
    pub(super) summary_text: String,
    pub(super) end: RunEnd,
    /// Failed processes, by the names of their logs, and how each failed. The text begins with the name.
    pub(super) failed_processes: Vec<(String, String)>,
}

/// Kind of end of a run.
pub(super) enum RunEnd {
    /// The run reached its planned end, or a planned fault killed the plant. The measured values are a
    /// result in both cases.
    AsPlanned,
    /// A signal ended the run.
    Interrupted,
    /// An unplanned failure ended the run.
    Failed(String),
}

impl RunEnd {
    fn from_outcome(
        scenario: &Scenario,
        outcome: &RunOutcome,
        result: &Result<(), RunError>,
    ) -> RunEnd {
        let t_ns = outcome.newest_truth.map(|truth| truth.t_ns);
        let kills_plant = scenario.faults.iter().any(|fault| {
            fault.kind == FaultKind::KillPlant
                && t_ns.is_some_and(|t_ns| fault.start_ns <= t_ns + scenario.period_ns)
        });
        match result {
            Err(RunError::PlantDied { .. }) if kills_plant => RunEnd::AsPlanned,
            Err(error) => RunEnd::Failed(error.to_string()),
            Ok(()) if outcome.was_interrupted => RunEnd::Interrupted,
            Ok(()) => RunEnd::AsPlanned,
        }
    }
}

/// Evaluated and recorded run.
pub(super) struct EvaluatedRun {
    pub(super) summary: Summary,
    summary_text: String,
    /// Errors of the files that could not be written.
    pub(super) write_errors: Vec<RunDirError>,
    /// Error of a program that computes metrics.
    pub(super) metrics_error: Option<String>,
}

impl EvaluatedRun {
    /// Returns the error that makes the results incomplete, if there is one.
    pub(super) fn first_error(&self) -> Option<String> {
        let write_error = self.write_errors.first().map(ToString::to_string);
        write_error.or_else(|| self.metrics_error.clone())
    }
}

/// Computes the metrics of programs with `launcher`, compares the measured values with the expectations and writes
/// the results. The stop flag ends these programs.
pub(super) fn evaluate_and_write(
    scenario: &Scenario,
    pace: Pace,
    metrics: &Metrics,
    outcome: &mut RunOutcome,
    (mut exit_code, launcher, stop): (u8, &Launcher, &StopFlag),
    run_dir: &mut RunDir,
) -> EvaluatedRun {
    let write_errors = run_dir.write_final_files(
        &metrics.pair_distances(),
        &mut outcome.latency,
        outcome.wall_time,
    );
    let mut metrics_error = None;
    let is_complete =
        outcome.newest_truth.is_some() && !outcome.was_interrupted && write_errors.is_empty();
    if is_complete && exit_code != exit::INFRASTRUCTURE_FAILURE {
        match compute_metrics(scenario, run_dir.path(), launcher, stop) {
            Ok(program_metrics) => outcome.program_metrics = program_metrics,
            Err(error) => (metrics_error, exit_code) = (Some(error), exit::INFRASTRUCTURE_FAILURE),
        }
    }
    let mut summary = summary::evaluate_run(scenario, pace, metrics, outcome, exit_code);
    // The verdict does not depend on whether it can be written.
    let summary_text = format_screen(&summary);
    let write_errors = run_dir.finish(&mut summary, write_errors);
    EvaluatedRun { summary, summary_text, write_errors, metrics_error }
}

/// Executes a valid scenario and records everything. `text` is the effective scenario text.
pub(super) fn execute(
    scenario: &Scenario,
    text: &str,
    manifest: &Manifest,
    location: &RunLocation,
    mut options: ExecutionOptions,
) -> Result<ExecutionResult, Failure> {
    let stop = super::stop_flag_on_signals()?;
    never_block_on_stderr();
    if let Some(on_start) = options.on_start.take() {
        on_start(&stop);
    }
    let (out, mut run_dir) = location.create_with(|out| RunDir::create(out, scenario))?;
    // Programs that compute metrics read the tables and the recording.
    let is_recorded = options.is_recorded || scenario.has_metric_programs();
    run_dir.write_initial_files(text, manifest, is_recorded && !options.is_unmeasured)?;
    run_dir.write_programs(&options.programs)?;
    options.host_part.as_ref().map_or(Ok(()), |part| run_dir.write_fleet(&part.fleet_text))?;
    let mut metrics = Metrics::new(scenario, options.pace);
    if options.is_unmeasured {
        metrics.stop_measuring();
    }
    let (pace, launcher, metrics_stop) = (options.pace, options.launcher.clone(), stop.clone());
    let mut view = options.live_view.take().map(|view| view.serve(scenario, pace)).transpose()?;
    let (mut outcome, result) =
        execute_to_completion(scenario, options, &mut run_dir, &mut metrics, view.as_mut(), stop);
    let run_exit_code = exit_code(&outcome, &result);
    let mut end = RunEnd::from_outcome(scenario, &outcome, &result);
    if let Err(error) = &result {
        print_failure(error);
    }
    let end_inputs = (run_exit_code, &launcher, &metrics_stop);
    let evaluated_run =
        evaluate_and_write(scenario, pace, &metrics, &mut outcome, end_inputs, &mut run_dir);
    let EvaluatedRun { summary, summary_text, write_errors, metrics_error } = evaluated_run;
    if let Some(error) = metrics_error {
        print_failure(&error);
        end = RunEnd::Failed(error);
    }
    let run_error = result.as_ref().err().map(ToString::to_string);
    let write_errors: Vec<String> = write_errors.iter().map(ToString::to_string).collect();
    for error in write_errors.iter().filter(|&error| run_error.as_ref() != Some(error)) {
        print_failure(error);
    }
    if let Some(view) = view {
        let error = run_error.as_ref().or(write_errors.first());
        let text = error.map_or_else(|| summary_text.clone(), |error| format!("error: {error}"));
        view.send_end_of_run(summary.exit, &text);
    }
    let (has_begun, all_files_written) = (outcome.newest_truth.is_some(), write_errors.is_empty());
    let failed_processes = failed_processes(scenario, &outcome, &result);
    Ok(ExecutionResult {
        has_begun,
        run_dir: out,
        all_files_written,
        summary,
        summary_text,
        end,
        failed_processes,
    })
}

/// Returns the failed processes, by the names of their logs, and how each failed.
fn failed_processes(
    scenario: &Scenario,
    outcome: &RunOutcome,
    result: &Result<(), RunError>,
) -> Vec<(String, String)> {
    let robots = outcome.failed_robots.iter().map(|FailedRobot { robot, cause }| {
        let name = &scenario.robots[*robot].name;
        (name.clone(), format!("{name} {cause}"))
    });
    let run_failure = result.as_ref().err().and_then(RunError::failed_process);
    robots.chain(run_failure.map(|(process, cause)| (process.to_owned(), cause))).collect()
}

impl LiveView {
    fn serve(self, scenario: &Scenario, pace: Pace) -> Result<View, ViewError> {
        print_info(&format!("view: {}", self.bound_port.url()));
        self.bound_port.serve(build_scene(scenario, pace), self.allows_control)
    }
}

/// Runs all processes to the end. Returns the outcome, and the error if an infrastructure failure ended the run.
fn execute_to_completion(
    scenario: &Scenario,
    options: ExecutionOptions,
    run_dir: &mut RunDir,
    metrics: &mut Metrics,
    view: Option<&mut View>,
    stop: StopFlag,
) -> (RunOutcome, Result<(), RunError>) {
    let bar = run_progress_bar(scenario.duration_ns);
    let connections = RunConnections {
        accepts_requests: view.as_ref().is_some_and(|view| view.takes_requests()),
        view,
        bridge_brief: options.host_part.map(|part| part.brief),
        ros2: options.ros2,
    };
    let names = scenario.robots.iter().map(|robot| robot.name.clone()).collect();
    let journal = Journal::new(names, run_dir, metrics);
    let launch_result =
        Run::launch(scenario, options.pace, &options.launcher, connections, journal, stop);
    let result = match launch_result {
        Ok(run) => run.run_to_end(|t_ns| show_progress(bar, t_ns)),
        Err(error) => {
            let was_interrupted = matches!(error, RunError::Interrupted { .. });
            (RunOutcome { was_interrupted, ..RunOutcome::default() }, Err(error))
        }
    };
    end_progress(bar);
    result
}

/// Reads the programs of a scenario from the folder of its file. On an error, prints it and returns the exit code.
pub(super) fn read_programs(scenario: &Scenario, path: &Path) -> Result<Programs, u8> {
    Programs::read(scenario, scenario_folder(path)).map_err(|(path, error)| {
        print_failure(&format_args!("cannot read {}: {error}", path.display()))
    })
}

/// Executes a valid scenario in lockstep into a new directory, without figures. Returns an exit code, after
/// printing the error, unless the run reaches its end.
pub(super) fn repeat_run(
    scenario: &Scenario,
    text: &str,
    programs: Programs,
    out: &Path,
    launcher: Launcher,
    build: &BuildInfo,
) -> Result<(), u8> {
    let pace = Pace::Lockstep;
    let mut manifest = Manifest::collect(scenario, &out.join("scenario.toml"), pace, build);
    manifest.programs = programs.manifest_files();
    let options = ExecutionOptions::new(pace, launcher, programs);
    let result = execute(scenario, text, &manifest, &RunLocation::Path(out.into()), options);
    let result = result.map_err(|error| print_failure(&error))?;
    if !(result.has_begun && result.all_files_written) || result.summary.interrupted {
        return Err(exit::INFRASTRUCTURE_FAILURE);
    }
    checksums::write_checksums(out, out).map_err(|error| print_failure(&error))
}
