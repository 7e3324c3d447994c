//! `phalanx run`: a scenario is run, written down and judged.

use std::io;
use std::net::SocketAddr;
use std::path::{Path, PathBuf};

use clap::{Args, ValueEnum};
use protocol::brief::Pace;
use protocol::catalog::Catalog;
use protocol::process::{Stop, exit, try_realtime_priority};
use protocol::ros2::Ros2Brief;
use supervisor::view::{Bound, ViewError};

use super::cell::{self, CellArgs};
use super::fleet::{FleetArgs, Member, Part, must_be_of_one_host};
use super::ros2::Ros2Args;
use super::scenario::ScenarioArgs;
use super::screen::{Output, complain, print, print_as, progress, show_progress, tell};
use super::share;
use experiment::scenario::read::folder;
use experiment::scenario::{FaultKind, Scenario};
use outcome::metrics::Metrics;
use outcome::metrics::expect;
use outcome::metrics::summary::Summary;
use outcome::results::manifest::{Build, Manifest};
use outcome::results::outcome::Outcome;
use outcome::results::page;
use outcome::results::programs::Programs;
use outcome::results::run_dir::{RunDir, RunDirError, default_out};
use outcome::results::scene::scene;
use outcome::results::summary::{self, to_json};
use supervisor::run::{self, Run, RunError};
use supervisor::spawn::Launcher;

/// Arguments of `phalanx run`.
#[derive(Debug, Args)]
pub struct RunArgs {
    #[command(flatten)]
    scenario: ScenarioArgs,
    /// How time passes.
    #[arg(long, value_enum, default_value_t = PaceArg::Realtime)]
    pace: PaceArg,
    /// Where to write the run; must not exist [default: runs/NAME-DATE-TIME].
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
    /// Let agents and plant run before every ordinary process, with their memory locked
    /// (SCHED_FIFO, mlockall); real time only.
    #[arg(long)]
    realtime_priority: bool,
    /// Show the run in a browser while it goes on, at a port or address of this machine [default: any
    /// free port]; the address to open is printed on stderr. The run never blocks on the browser.
    #[arg(
        long,
        value_name = "ADDR",
        num_args = 0..=1,
        require_equals = true,
        default_missing_value = supervisor::view::DEFAULT,
        default_value_if("view_control", "true", supervisor::view::DEFAULT),
        value_parser = supervisor::view::address
    )]
    view: Option<SocketAddr>,
    /// Show the run as --view does, and let that page kill, freeze and restart robots and cut edges.
    #[arg(long)]
    view_control: bool,
    /// Let --view=ADDR listen where other machines can reach it. There is no encryption: whoever sees
    /// the address printed, or the traffic, sees the run and, with --view-control, breaks it. The same for
    /// hosts of a --fleet without certificates: whoever reaches them moves the robots.
    #[arg(long)]
    insecure: bool,
    #[command(flatten)]
    fleet: FleetArgs,
    #[command(flatten)]
    ros2: Ros2Args,
    /// Write no figures and no report.html; `phalanx report` makes them later.
    #[arg(long)]
    no_report: bool,
    /// Measure and record nothing: what measuring costs is measured against this.
    #[arg(long, hide = true)]
    unmeasured: bool,
    /// What to print at the end.
    #[arg(long, value_enum, default_value_t = Output::Text)]
    output: Output,
    #[command(flatten)]
    campaign: CellArgs,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
enum PaceArg {
    /// Simulated time, bit-identical from run to run.
    Lockstep,
    /// The machine's clock.
    Realtime,
}

pub(super) fn run(args: &RunArgs, catalog: &Catalog, mut launcher: Launcher, build: &Build) -> u8 {
    if args.realtime_priority && args.pace == PaceArg::Lockstep {
        complain(&"--realtime-priority is for --pace realtime: lockstep has no deadlines");
        return exit::USAGE;
    }
    if args.insecure && args.view.is_none() && !args.fleet.is_given() {
        complain(
            &"--insecure is for --view=ADDR and --fleet: nothing else is open to other machines",
        );
        return exit::USAGE;
    }
    if args.fleet.is_given() && args.pace == PaceArg::Lockstep {
        complain(
            &"--fleet is for --pace realtime: in lockstep each tick would wait for the network",
        );
        return exit::USAGE;
    }
    let fleet = match args.fleet.read(args.insecure) {
        Ok(fleet) => fleet,
        Err(code) => return code,
    };
    let set = fleet.as_ref().map_or(Vec::new(), Member::set);
    let Some((scenario, text)) = args.scenario.read_with(&set, catalog) else {
        return exit::BAD_SCENARIO;
    };
    let part = match fleet {
        Some(fleet) => fleet.part(&scenario, &text).map(Some),
        None => must_be_of_one_host(&scenario).map(|()| None),
    };
    let part = match part {
        Ok(part) => part,
        Err(code) => return code,
    };
    let lives_here = |robot: usize| {
        part.as_ref().is_none_or(|part| part.brief.robots[robot].host == part.brief.here)
    };
    let ros2 = match args.ros2.read(&scenario, args.pace == PaceArg::Realtime, lives_here) {
        Ok(ros2) => ros2,
        Err(code) => return code,
    };
    // Before anything is written or spawned: the port may be taken.
    let place = args.view.map(|address| supervisor::view::bind(address, args.insecure)).transpose();
    let looks = match place {
        Ok(place) => place.map(|bound| Looks { bound, control: args.view_control }),
        Err(error) => {
            let code = complain(&error);
            return if matches!(error, ViewError::NotLoopback(_)) { exit::USAGE } else { code };
        }
    };
    let pace = match args.pace {
        PaceArg::Lockstep => Pace::Lockstep,
        PaceArg::Realtime => Pace::Realtime,
    };
    let name = match (&part, &args.fleet.host) {
        (Some(part), Some(host)) if !part.has_plant() => format!("{}-{host}", scenario.name),
        _ => scenario.name.clone(),
    };
    let out = args.out.clone().unwrap_or_else(|| default_out(&name));
    let Some(programs) = read_programs(&scenario, &args.scenario.path) else {
        return exit::BAD_SCENARIO;
    };
    let mut manifest = Manifest::collect(&scenario, &args.scenario.path, pace, build);
    manifest.programs = programs.listed();
    if args.realtime_priority {
        manifest.realtime_priority = Some(match try_realtime_priority() {
            Ok(()) => {
                launcher = launcher.with_realtime_priority();
                "granted".into()
            }
            Err(error) => {
                tracing::warn!("running with ordinary priority: {error}");
                error.to_string()
            }
        });
    }
    let part = match part {
        Some(part) if !part.has_plant() => {
            if args.view.is_some() || ros2.is_some() {
                complain(&"--view and --ros2 are for the plant's host, which sees all of the run");
                return exit::USAGE;
            }
            return share::run(&scenario, &text, part, &programs, &out, &launcher);
        }
        part => part,
    };
    let how = How { programs, part, ..How::new(pace, launcher) };
    if let Some(cell) = &args.campaign.cell {
        // Other runs go on beside it.
        let how = How { launcher: how.launcher.without_awake(), ..how };
        return cell::run(&args.campaign, cell, &scenario, &text, &manifest, how);
    }
    let how = How { unmeasured: args.unmeasured, looks, ros2, ..how };
    match execute(&scenario, &text, &manifest, &out, how) {
        Ok(ended) => {
            if ended.began && ended.written && !args.no_report {
                // The run is written down: that its pictures are not changes nothing about it.
                if let Err(error) = page::write(&out, &scenario) {
                    complain(&error);
                }
            }
            let printed = match args.output {
                // What was wrong was said already; of nothing there is nothing to show.
                Output::Text if !ended.began => exit::OK,
                Output::Text => {
                    let written =
                        if ended.written { "written" } else { "not all of it is written" };
                    print(&format!("{}\n{written} to {}\n", ended.screen.trim_end(), out.display()))
                }
                Output::Json => print_as(Output::Json, &to_json(&ended.summary)),
            };
            if ended.summary.exit == exit::OK { printed } else { ended.summary.exit }
        }
        Err(error @ (NotRun::Signals(_) | NotRun::View(_))) => complain(&error),
        Err(NotRun::RunDir(error)) => {
            let code = complain(&error);
            if matches!(error, RunDirError::Exists(_)) { exit::USAGE } else { code }
        }
    }
}

/// The programs of a scenario of that file; what cannot be read is said.
pub(super) fn read_programs(scenario: &Scenario, path: &Path) -> Option<Programs> {
    let read = Programs::read(scenario, folder(path));
    let told = read.map_err(|(path, error)| {
        complain(&format_args!("cannot read {}: {error}", path.display()))
    });
    told.ok()
}

/// Runs a sound scenario in lockstep, into a new directory and without pictures. Whether it came to its
/// end; what went wrong is said.
pub(super) fn run_again(
    scenario: &Scenario,
    text: &str,
    programs: Programs,
    out: &Path,
    launcher: Launcher,
    build: &Build,
) -> bool {
    let pace = Pace::Lockstep;
    let mut manifest = Manifest::collect(scenario, &out.join("scenario.toml"), pace, build);
    manifest.programs = programs.listed();
    let how = How { programs, ..How::new(pace, launcher) };
    match execute(scenario, text, &manifest, out, how) {
        Ok(ended) => ended.began && ended.written && !ended.summary.interrupted,
        Err(error) => {
            complain(&error);
            false
        }
    }
}

/// Why a run left no summary.
#[derive(Debug, thiserror::Error)]
pub(super) enum NotRun {
    #[error("cannot handle signals: {0}")]
    Signals(#[from] io::Error),
    #[error(transparent)]
    RunDir(#[from] RunDirError),
    #[error(transparent)]
    View(#[from] ViewError),
}

/// Is given what ends the run early, before it begins.
type OnStart = Box<dyn FnOnce(&Stop)>;

/// How a scenario is run.
pub(super) struct How {
    pub(super) pace: Pace,
    pub(super) launcher: Launcher,
    pub(super) unmeasured: bool,
    /// Samples and recording are written.
    pub(super) recorded: bool,
    pub(super) looks: Option<Looks>,
    /// What robots run that is not built in.
    pub(super) programs: Programs,
    /// Is given what ends the run early.
    pub(super) on_start: Option<OnStart>,
    /// Of a run on several hosts.
    pub(super) part: Option<Part>,
    /// What the process is told that shows the run to ROS 2.
    pub(super) ros2: Option<Ros2Brief>,
}

impl How {
    /// Measured, recorded, and looked at by nobody.
    fn new(pace: Pace, launcher: Launcher) -> How {
        let (unmeasured, recorded) = (false, true);
        let (looks, programs, on_start, part, ros2) = (None, Programs::default(), None, None, None);
        How { pace, launcher, unmeasured, recorded, looks, programs, on_start, part, ros2 }
    }
}

/// Where people may look at a run under way.
pub(super) struct Looks {
    bound: Bound,
    /// They may act as well.
    control: bool,
}

pub(super) struct Ended {
    began: bool,
    /// All of it, into its directory.
    pub(super) written: bool,
    pub(super) summary: Summary,
    screen: String,
    pub(super) end: End,
}

/// How a run ended.
pub(super) enum End {
    /// At its end, or with the plant that its plan kills: whatever came out is a result.
    AsPlanned,
    /// By a signal.
    Interrupted,
    /// Something failed that no plan has.
    Failed(String),
}

impl End {
    fn of(scenario: &Scenario, outcome: &Outcome, result: &Result<(), RunError>) -> End {
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

/// A run, judged and written down.
pub(super) struct Judged {
    pub(super) summary: Summary,
    screen: String,
    pub(super) finished: Result<(), RunDirError>,
}

/// Holds what was measured against what the scenario expects, and writes it down. `ended_with`: the exit
/// code without expectations.
pub(super) fn judge(
    scenario: &Scenario,
    pace: Pace,
    metrics: &Metrics,
    outcome: &mut Outcome,
    ended_with: u8,
    run_dir: &mut RunDir,
) -> Judged {
    let measures = metrics.finish();
    let expectations =
        expect::evaluate(scenario, &measures, pace, outcome.deadline_misses, ended_with);
    let held = expectations.iter().all(|expectation| expectation.held);
    let expected = scenario.expect.exit == Some(ended_with);
    let exit = match (ended_with, held) {
        (exit::OK, true) => exit::OK,
        (exit::OK, false) => exit::EXPECTATION_MISSED,
        (_, true) if expected => exit::OK,
        (code, _) => code,
    };
    let mut summary = summary::sum_up(scenario, pace, &measures, outcome, expectations, exit);
    // The verdict is what it is, whether or not it can be written down.
    let screen = summary::screen(&summary);
    let finished = run_dir.finish(&mut summary, &measures.pairs, &mut outcome.latency);
    Judged { summary, screen, finished }
}

/// Runs a sound scenario and writes everything down.
pub(super) fn execute(
    scenario: &Scenario,
    text: &str,
    manifest: &Manifest,
    out: &Path,
    how: How,
) -> Result<Ended, NotRun> {
    let How { pace, launcher, unmeasured, recorded, looks, programs, on_start, part, ros2 } = how;
    let stop = Stop::on_signals_twice_at_once()?;
    if let Some(on_start) = on_start {
        on_start(&stop);
    }
    let mut run_dir = RunDir::create(out, scenario)?;
    run_dir.write_scenario(text)?;
    run_dir.write_manifest(manifest)?;
    run_dir.write_programs(&programs)?;
    if let Some(part) = &part {
        run_dir.write_fleet(&part.text)?;
    }
    if recorded {
        run_dir.begin_recording(text, manifest)?;
    } else {
        run_dir.record_nothing();
    }
    let mut metrics = Metrics::new(scenario, pace);
    if unmeasured {
        run_dir.record_nothing();
        metrics.look_away();
    }
    let by_hand = looks.as_ref().is_some_and(|looks| looks.control);
    let mut view = None;
    if let Some(Looks { bound, control }) = looks {
        tell(&format!("view: {}", bound.url()));
        view = Some(bound.serve(scene(scenario, pace), control)?);
    }
    let bar = progress(scenario.duration_ns);
    let fleet = part.map(|part| part.brief);
    let launched = Run::launch(
        scenario,
        pace,
        &launcher,
        by_hand,
        fleet,
        ros2,
        &mut run_dir,
        &mut metrics,
        stop,
    );
    let (mut outcome, result) = match launched {
        Ok(run) => run.watched_by(view.as_mut()).to_the_end(|t_ns| show_progress(bar, t_ns)),
        Err(error) => {
            let interrupted = matches!(error, RunError::Interrupted { .. });
            (Outcome { interrupted, ..Outcome::default() }, Err(error))
        }
    };
    bar.finish_and_clear();
    let ended_with = run::exit_code(&outcome, &result);
    let end = End::of(scenario, &outcome, &result);
    if let Err(error) = &result {
        complain(error);
    }
    let judged = judge(scenario, pace, &metrics, &mut outcome, ended_with, &mut run_dir);
    let Judged { summary, screen, finished } = judged;
    let ended = result.as_ref().err().map(ToString::to_string);
    let unwritten = finished.as_ref().err().map(ToString::to_string);
    if let Some(error) = unwritten.as_ref().filter(|error| ended.as_ref() != Some(error)) {
        complain(error);
    }
    if let Some(view) = view {
        let error = ended.as_ref().or(unwritten.as_ref());
        let text = error.map_or_else(|| screen.clone(), |error| format!("error: {error}"));
        view.ended(summary.exit, &text);
    }
    let began = outcome.truth.is_some();
    Ok(Ended { began, written: finished.is_ok(), summary, screen, end })
}
