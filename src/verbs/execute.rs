//! Executes a valid scenario to its end by processes, evaluates it and records it: for `phalanx run`, for
//! one run of a campaign, and for `phalanx verify`.

use std::path::{Path, PathBuf};

use protocol::brief::Pace;
use protocol::process::{Stop, exit, never_block_on_stderr};
use protocol::ros2::Ros2Brief;
use run::journal::Journal;
use supervisor::run::launch::Connections;
use supervisor::run::{Run, RunError, exit_code};
use supervisor::spawn::Launcher;
use supervisor::view::{Bound, View, ViewError};

use super::Failure;
use super::fleet::HostPart;
use super::screen::{end_progress, print_failure, print_info, progress, show_progress};
use experiment::scenario::read::folder;
use experiment::scenario::{FaultKind, Scenario};
use outcome::metrics::Metrics;
use outcome::metrics::expect::FailedRobot;
use outcome::metrics::summary::Summary;
use outcome::report::screen::screen;
use outcome::results::checksums;
use outcome::results::manifest::{Build, Manifest};
use outcome::results::outcome::Outcome;
use outcome::results::programs::Programs;
use outcome::results::run_dir::{RunDir, RunDirError, RunLocation};
use outcome::results::scene::scene;
use outcome::results::summary;

/// Callback that receives the stop flag of the run before it begins.
type OnStart = Box<dyn FnOnce(&Stop)>;

/// Options of an execution.
pub(super) struct ExecutionOptions {
    pub(super) pace: Pace,
    pub(super) launcher: Launcher,
    pub(super) unmeasured: bool,
    /// Whether samples and recording are written.
    pub(super) recorded: bool,
    pub(super) live_view: Option<LiveView>,
    /// Contents of the programs of the scenario.
    pub(super) programs: Programs,
    /// Callback that receives the stop flag.
    pub(super) on_start: Option<OnStart>,
    /// This host's part of a run on several hosts.
    pub(super) part: Option<HostPart>,
    /// Configuration of the ROS 2 bridge, without its run root.
    pub(super) ros2: Option<Ros2Brief>,
}

impl ExecutionOptions {
    /// Returns options for a run that is measured and recorded, without a live view.
    pub(super) fn new(pace: Pace, launcher: Launcher, programs: Programs) -> ExecutionOptions {
        ExecutionOptions {
            pace,
            launcher,
            unmeasured: false,
            recorded: true,
            live_view: None,
            programs,
            on_start: None,
            part: None,
            ros2: None,
        }
    }
}

/// Live view of the run, on a bound port.
pub(super) struct LiveView {
    pub(super) bound: Bound,
    /// Whether clients may inject faults.
    pub(super) control: bool,
}

/// Result of an execution.
pub(super) struct Execution {
    /// Whether the robots started to move.
    pub(super) began: bool,
    /// Directory of the run.
    pub(super) out: PathBuf,
    /// Whether all files were written.
    pub(super) written: bool,
    pub(super) summary: Summary,
    /// Summary as text of at most one screen.
    pub(super) screen: String,
    pub(super) end: End,
    /// Failed processes, by the names of their logs, and how each failed. The text begins with the name.
    pub(super) failed: Vec<(String, String)>,
}

/// Kind of end of a run.
pub(super) enum End {
    /// The run reached its planned end, or a planned fault killed the plant. The measured values are a
    /// result in both cases.
    AsPlanned,
    /// A signal ended the run.
    Interrupted,
    /// An unplanned failure ended the run.
    Failed(String),
}

impl End {
    fn from_outcome(scenario: &Scenario, outcome: &Outcome, result: &Result<(), RunError>) -> End {
        let t_ns = outcome.truth.map(|truth| truth.t_ns);
        let kills_plant = scenario.faults.iter().any(|fault| {
            fault.kind == FaultKind::KillPlant
                && t_ns.is_some_and(|t_ns| fault.at_ns <= t_ns + scenario.period_ns)
        });
        match result {
            Err(RunError::PlantDied { .. }) if kills_plant => End::AsPlanned,
            Err(error) => End::Failed(error.to_string()),
            Ok(()) if outcome.interrupted => End::Interrupted,
            Ok(()) => End::AsPlanned,
        }
    }
}

/// Evaluated and recorded run.
pub(super) struct EvaluatedRun {
    pub(super) summary: Summary,
    screen: String,
    /// Errors of the files that could not be written.
    pub(super) unwritten: Vec<RunDirError>,
}

/// Compares the measured values with the expectations and writes the results. `ended_with` is the exit code
/// without expectations.
pub(super) fn judge(
    scenario: &Scenario,
    pace: Pace,
    metrics: &Metrics,
    outcome: &mut Outcome,
    ended_with: u8,
    run_dir: &mut RunDir,
) -> EvaluatedRun {
    let mut summary = summary::judge(scenario, pace, metrics, outcome, ended_with);
    // The verdict does not depend on whether it can be written.
    let screen = screen(&summary);
    let unwritten = run_dir.finish(&mut summary, &metrics.pairs(), &mut outcome.latency);
    EvaluatedRun { summary, screen, unwritten }
}

/// Executes a valid scenario and records everything. `text` is the effective scenario text.
pub(super) fn execute(
    scenario: &Scenario,
    text: &str,
    manifest: &Manifest,
    place: &RunLocation,
    mut how: ExecutionOptions,
) -> Result<Execution, Failure> {
    let stop = super::stop()?;
    never_block_on_stderr();
    if let Some(on_start) = how.on_start.take() {
        on_start(&stop);
    }
    let (out, mut run_dir) = place.create_with(|out| RunDir::create(out, scenario))?;
    run_dir.begin(text, manifest, how.recorded && !how.unmeasured)?;
    run_dir.write_programs(&how.programs)?;
    how.part.as_ref().map_or(Ok(()), |part| run_dir.write_fleet(&part.text))?;
    let mut metrics = Metrics::new(scenario, how.pace);
    if how.unmeasured {
        metrics.stop();
    }
    let pace = how.pace;
    let mut view = how.live_view.take().map(|view| view.serve(scenario, pace)).transpose()?;
    let (mut outcome, result) =
        execute_to_completion(scenario, how, &mut run_dir, &mut metrics, view.as_mut(), stop);
    let ended_with = exit_code(&outcome, &result);
    let end = End::from_outcome(scenario, &outcome, &result);
    if let Err(error) = &result {
        print_failure(error);
    }
    let judged = judge(scenario, pace, &metrics, &mut outcome, ended_with, &mut run_dir);
    let EvaluatedRun { summary, screen, unwritten } = judged;
    let ended = result.as_ref().err().map(ToString::to_string);
    let unwritten: Vec<String> = unwritten.iter().map(ToString::to_string).collect();
    for error in unwritten.iter().filter(|&error| ended.as_ref() != Some(error)) {
        print_failure(error);
    }
    if let Some(view) = view {
        let error = ended.as_ref().or(unwritten.first());
        let text = error.map_or_else(|| screen.clone(), |error| format!("error: {error}"));
        view.send_end_of_run(summary.exit, &text);
    }
    let (began, written) = (outcome.truth.is_some(), unwritten.is_empty());
    let failed = failed_processes(scenario, &outcome, &result);
    Ok(Execution { began, out, written, summary, screen, end, failed })
}

/// Returns the failed processes, by the names of their logs, and how each failed.
fn failed_processes(
    scenario: &Scenario,
    outcome: &Outcome,
    result: &Result<(), RunError>,
) -> Vec<(String, String)> {
    let robots = outcome.failed_robots.iter().map(|FailedRobot { robot, cause }| {
        let name = &scenario.robots[*robot].name;
        (name.clone(), format!("{name} {cause}"))
    });
    let last = result.as_ref().err().and_then(RunError::failed_process);
    robots.chain(last.map(|(process, how)| (process.to_owned(), how))).collect()
}

impl LiveView {
    fn serve(self, scenario: &Scenario, pace: Pace) -> Result<View, ViewError> {
        print_info(&format!("view: {}", self.bound.url()));
        self.bound.serve(scene(scenario, pace), self.control)
    }
}

/// Runs all processes to the end. Returns the outcome, and the error if an infrastructure failure ended the run.
fn execute_to_completion(
    scenario: &Scenario,
    how: ExecutionOptions,
    run_dir: &mut RunDir,
    metrics: &mut Metrics,
    view: Option<&mut View>,
    stop: Stop,
) -> (Outcome, Result<(), RunError>) {
    let bar = progress(scenario.duration_ns);
    let open_to = Connections {
        hands: view.as_ref().is_some_and(|view| view.takes_requests()),
        view,
        hosts: how.part.map(|part| part.brief),
        ros2: how.ros2,
    };
    let names = scenario.robots.iter().map(|robot| robot.name.clone()).collect();
    let journal = Journal::new(names, run_dir, metrics);
    let launched = Run::launch(scenario, how.pace, &how.launcher, open_to, journal, stop);
    let ended = match launched {
        Ok(run) => run.run_to_end(|t_ns| show_progress(bar, t_ns)),
        Err(error) => {
            let interrupted = matches!(error, RunError::Interrupted { .. });
            (Outcome { interrupted, ..Outcome::default() }, Err(error))
        }
    };
    end_progress(bar);
    ended
}

/// Reads the programs of a scenario from the folder of its file. On an error, prints it and returns the exit code.
pub(super) fn read_programs(scenario: &Scenario, path: &Path) -> Result<Programs, u8> {
    Programs::read(scenario, folder(path)).map_err(|(path, error)| {
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
    build: &Build,
) -> Result<(), u8> {
    let pace = Pace::Lockstep;
    let mut manifest = Manifest::collect(scenario, &out.join("scenario.toml"), pace, build);
    manifest.programs = programs.manifest_files();
    let how = ExecutionOptions::new(pace, launcher, programs);
    let ended = execute(scenario, text, &manifest, &RunLocation::Path(out.into()), how);
    let ended = ended.map_err(|error| print_failure(&error))?;
    if !(ended.began && ended.written) || ended.summary.interrupted {
        return Err(exit::INFRASTRUCTURE);
    }
    checksums::write(out, out).map_err(|error| print_failure(&error))
}
