//! What was asked for: the command line, and one function for each verb.
//!
//! Results go to stdout, everything else to stderr. The exit code tells how it went.

use std::io::{self, IsTerminal, Write};
use std::net::SocketAddr;
use std::path::{Path, PathBuf};
use std::sync::OnceLock;

use clap::{Args, Subcommand, ValueEnum};
use indicatif::{ProgressBar, ProgressStyle};
use protocol::brief::Pace;
use protocol::law::LawDescription;
use protocol::process::{Stop, exit, log_level, quiet_iceoryx2, try_realtime_priority};
use protocol::run_root;
use recording::export::{ExportError, Exported};
use recording::recover::{Outcome as Recovery, RecoverError};
use view::{Bound, ViewError};

use crate::dead_runs;
use crate::doctor;
use crate::live;
use crate::outcome::Outcome;
use crate::report;
use crate::run::{self, Run};
use crate::run_dir::{Manifest, RECORDING, RunDir, RunDirError, default_out, to_json};
use crate::spawn::Launcher;
use crate::summary::{self, Summary};
use experiment::check::{self, Theory};
use experiment::drawing::{Drawing, drawn};
use experiment::scenario::Scenario;
use experiment::scenario::diagnostic::Diagnostic;
use experiment::scenario::read::{Overrides, read};
use metrics::Metrics;
use metrics::expect;

const MS: u64 = 1_000_000;

/// The supervisor's verbs.
#[derive(Debug, Subcommand)]
pub enum Verb {
    /// Fly a scenario: every robot a process of its own.
    Run(RunArgs),
    /// Validate a scenario and print what can be said before it flies.
    Check(CheckArgs),
    /// Draw the figures of a run and write its page, from what it has written.
    Report(ReportArgs),
    /// Say whether this machine is fit for runs, and what to do about it.
    Doctor(DoctorArgs),
    /// Remove what dead runs left in the run root and in shared memory.
    Clean(CleanArgs),
    /// Give a recording that a kill cut short its index back, in a new file.
    Recover(RecoverArgs),
    /// Turn a recording into CSV tables, one for each kind of observation.
    Export(ExportArgs),
}

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
    /// free port]; the address to open is printed on stderr. The run never waits for a browser.
    #[arg(
        long,
        value_name = "ADDR",
        num_args = 0..=1,
        require_equals = true,
        default_missing_value = view::DEFAULT,
        default_value_if("view_control", "true", view::DEFAULT),
        value_parser = view::address
    )]
    view: Option<SocketAddr>,
    /// Show the run as --view does, and let that page kill, freeze and restart robots and cut links.
    #[arg(long)]
    view_control: bool,
    /// Let --view=ADDR listen where other machines can reach it. There is no encryption: whoever sees
    /// the address printed, or the traffic, sees the run and, with --view-control, breaks it.
    #[arg(long, requires = "view")]
    insecure: bool,
    /// Write no figures and no report.html; `phalanx report` makes them later.
    #[arg(long)]
    no_report: bool,
    /// Measure and record nothing: what measuring costs is measured against this.
    #[arg(long, hide = true)]
    unmeasured: bool,
    /// What to print at the end.
    #[arg(long, value_enum, default_value_t = Output::Text)]
    output: Output,
}

/// Arguments of `phalanx check`.
#[derive(Debug, Args)]
pub struct CheckArgs {
    #[command(flatten)]
    scenario: ScenarioArgs,
    /// What to print.
    #[arg(long, value_enum, default_value_t = Output::Text)]
    output: Output,
    /// Print the formation graph instead, to be drawn.
    #[arg(long, value_enum, value_name = "FORMAT", conflicts_with = "output")]
    graph: Option<GraphFormat>,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
enum GraphFormat {
    /// Mermaid: GitHub and many editors draw it.
    Mermaid,
    /// Graphviz: `| dot -Tsvg`.
    Dot,
}

impl From<GraphFormat> for Drawing {
    fn from(format: GraphFormat) -> Drawing {
        match format {
            GraphFormat::Mermaid => Drawing::Mermaid,
            GraphFormat::Dot => Drawing::Dot,
        }
    }
}

/// Arguments of `phalanx report`.
#[derive(Debug, Args)]
pub struct ReportArgs {
    /// The directory that a run has written; figures and page of an earlier report are replaced.
    run_dir: PathBuf,
}

/// Arguments of `phalanx doctor`.
#[derive(Debug, Args)]
pub struct DoctorArgs {
    /// Robots that the machine is to be fit for.
    #[arg(long, value_name = "N", default_value_t = 8, value_parser = clap::value_parser!(u32).range(1..=100_000))]
    robots: u32,
    /// What to print.
    #[arg(long, value_enum, default_value_t = Output::Text)]
    output: Output,
}

/// Arguments of `phalanx clean`.
#[derive(Debug, Args)]
pub struct CleanArgs {
    /// Only say what would be removed.
    #[arg(long)]
    dry_run: bool,
}

/// Arguments of `phalanx recover`.
#[derive(Debug, Args)]
pub struct RecoverArgs {
    /// The recording; it is only read. One that is whole is left alone.
    file: PathBuf,
    /// The new recording; must not exist [default: FILE with .recovered.mcap for its ending].
    #[arg(long, value_name = "FILE")]
    out: Option<PathBuf>,
}

/// Arguments of `phalanx export`.
#[derive(Debug, Args)]
pub struct ExportArgs {
    /// A run directory, or a recording by itself.
    #[arg(value_name = "RUN_DIR|FILE")]
    run: PathBuf,
    /// Where to write the tables; must not exist [default: RUN_DIR/export, or FILE with -export for
    /// its ending].
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
}

/// A scenario file, and changes to it.
#[derive(Debug, Args)]
struct ScenarioArgs {
    /// The scenario file.
    scenario: PathBuf,
    /// Seed of everything random.
    #[arg(long)]
    seed: Option<u64>,
    /// Set a key of the scenario, as in avoidance.kind=none.
    #[arg(long, value_name = "KEY=VALUE")]
    set: Vec<String>,
    /// Add a fault, as in 'kill r2 @10 restart 2'.
    #[arg(long, value_name = "SPEC")]
    fault: Vec<String>,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
enum PaceArg {
    /// Simulated time, bit-identical from run to run.
    Lockstep,
    /// The machine's clock.
    Realtime,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
enum Output {
    /// One screen for people.
    Text,
    /// The same and more for programs; of a run, summary.json.
    Json,
}

/// Does what was asked for; `laws` are those that the agents know, which `launcher` starts.
pub fn main(verb: &Verb, laws: &[LawDescription], launcher: &Launcher) -> u8 {
    tracing_subscriber::fmt()
        .with_writer(|| AboveTheBar)
        .with_ansi(in_color())
        .with_target(false)
        .without_time()
        .with_max_level(log_level(tracing::Level::WARN))
        .init();
    quiet_iceoryx2();
    match verb {
        Verb::Run(args) => run(args, laws, launcher.clone()),
        Verb::Check(args) => check(args, laws),
        Verb::Report(args) => report(&args.run_dir, laws),
        Verb::Doctor(args) => diagnose(args),
        Verb::Clean(args) => tidy(args),
        Verb::Recover(args) => recover(args),
        Verb::Export(args) => export(args),
    }
}

/// The progress bar of the run at hand.
static BAR: OnceLock<ProgressBar> = OnceLock::new();

/// Standard error, with the progress bar out of the way while something is written.
struct AboveTheBar;

impl Write for AboveTheBar {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        match BAR.get() {
            Some(bar) => bar.suspend(|| io::stderr().write(bytes)),
            None => io::stderr().write(bytes),
        }
    }

    fn flush(&mut self) -> io::Result<()> {
        io::stderr().flush()
    }
}

/// Colors only for people who want them: NO_COLOR, and a terminal.
fn in_color() -> bool {
    io::stderr().is_terminal() && std::env::var_os("NO_COLOR").is_none_or(|value| value.is_empty())
}

fn check(args: &CheckArgs, laws: &[LawDescription]) -> u8 {
    let Some((scenario, _)) = read_scenario(&args.scenario, laws) else {
        return exit::BAD_SCENARIO;
    };
    if let Some(drawing) = args.graph {
        return print(&drawn(&scenario, drawing.into()));
    }
    let theory = Theory::of(&scenario);
    print(&match args.output {
        Output::Text => check::report(&scenario, &theory),
        Output::Json => theory.to_json(),
    })
}

fn report(run_dir: &Path, laws: &[LawDescription]) -> u8 {
    let scenario = match report::scenario_path(run_dir) {
        Ok(scenario) => scenario,
        Err(error) => {
            complain(&error);
            return exit::USAGE;
        }
    };
    // Its warnings were shown when it flew.
    let (scenario, ..) = match read(&scenario, &Overrides::default(), laws) {
        Ok(read) => read,
        Err(diagnostic) => {
            let _ = writeln!(io::stderr(), "{}", diagnostic.render(in_color()));
            return exit::BAD_SCENARIO;
        }
    };
    match report::write(run_dir, &scenario) {
        Ok(page) => print(&format!("written to {}\n", page.display())),
        Err(error) => complain(&error),
    }
}

fn diagnose(args: &DoctorArgs) -> u8 {
    let findings = doctor::examine(args.robots as usize);
    let printed = print(&match args.output {
        Output::Text => doctor::screen(&findings),
        Output::Json => to_json(&findings),
    });
    if doctor::is_wrong(&findings) { exit::INFRASTRUCTURE } else { printed }
}

fn tidy(args: &CleanArgs) -> u8 {
    let (said, failures) = dead_runs::remove(&run_root::base(), args.dry_run);
    let printed = print(&said);
    for failure in &failures {
        complain(failure);
    }
    if failures.is_empty() { printed } else { exit::INFRASTRUCTURE }
}

fn recover(args: &RecoverArgs) -> u8 {
    let out = args.out.clone().unwrap_or_else(|| args.file.with_extension("recovered.mcap"));
    match recording::recover::recover(&args.file, &out) {
        Ok(Recovery::Whole) => {
            print(&format!("{} is whole: nothing to recover\n", args.file.display()))
        }
        Ok(Recovery::Recovered(recovered)) => {
            print(&format!("{recovered}written to {}\n", out.display()))
        }
        Err(error) => {
            let code = complain(&error);
            if matches!(error, RecoverError::Write { .. }) { code } else { exit::USAGE }
        }
    }
}

fn export(args: &ExportArgs) -> u8 {
    let (file, out) = if args.run.is_dir() {
        (args.run.join(RECORDING), args.run.join("export"))
    } else {
        let stem = args.run.file_stem().unwrap_or_default().to_string_lossy();
        (args.run.clone(), args.run.with_file_name(format!("{stem}-export")))
    };
    let out = args.out.clone().unwrap_or(out);
    match recording::export::export(&file, &out) {
        Ok(Exported { tables, whole }) => {
            if !whole {
                tracing::warn!("{} is cut or damaged; what is whole is exported", file.display());
            }
            let rows = |(name, rows): &(&str, u64)| format!("{rows:>9} rows  {name}\n");
            let tables: String = tables.iter().map(rows).collect();
            print(&format!("{tables}written to {}\n", out.display()))
        }
        Err(error) => {
            let code = complain(&error);
            let wrote = matches!(error, ExportError::Write { .. } | ExportError::Message { .. });
            if wrote { code } else { exit::USAGE }
        }
    }
}

fn run(args: &RunArgs, laws: &[LawDescription], mut launcher: Launcher) -> u8 {
    if args.realtime_priority && args.pace == PaceArg::Lockstep {
        complain(&"--realtime-priority is for --pace realtime: lockstep has no deadlines");
        return exit::USAGE;
    }
    let Some((scenario, text)) = read_scenario(&args.scenario, laws) else {
        return exit::BAD_SCENARIO;
    };
    // Before anything is written or spawned: the port may be taken.
    let place = args.view.map(|address| view::bind(address, args.insecure)).transpose();
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
    let out = args.out.clone().unwrap_or_else(|| default_out(&scenario.name));
    let mut manifest = Manifest::collect(&scenario, &args.scenario.scenario, pace);
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
    let how = How { pace, launcher, unmeasured: args.unmeasured, looks };
    match fly(&scenario, &text, &manifest, &out, how) {
        Ok(flown) => {
            if flown.took_off && !args.no_report {
                // The run is written down: that its pictures are not changes nothing about it.
                if let Err(error) = report::write(&out, &scenario) {
                    complain(&error);
                }
            }
            let printed = match args.output {
                // What was wrong was said already; of nothing there is nothing to show.
                Output::Text if !flown.took_off => exit::OK,
                Output::Text => print(&format!(
                    "{}\nwritten to {}\n",
                    summary::screen(&flown.summary).trim_end(),
                    out.display()
                )),
                Output::Json => print(&flown.summary.to_json()),
            };
            if flown.exit == exit::OK { printed } else { flown.exit }
        }
        Err(error @ (NotFlown::Signals(_) | NotFlown::View(_))) => complain(&error),
        Err(NotFlown::RunDir(error)) => {
            let code = complain(&error);
            if matches!(error, RunDirError::Exists(_)) { exit::USAGE } else { code }
        }
    }
}

/// Why a run left no summary.
#[derive(Debug, thiserror::Error)]
enum NotFlown {
    #[error("cannot handle signals: {0}")]
    Signals(#[from] io::Error),
    #[error(transparent)]
    RunDir(#[from] RunDirError),
    #[error(transparent)]
    View(#[from] ViewError),
}

/// How a scenario is run.
struct How {
    pace: Pace,
    launcher: Launcher,
    unmeasured: bool,
    looks: Option<Looks>,
}

/// Where people may look at a run under way.
struct Looks {
    bound: Bound,
    /// They may act as well.
    control: bool,
}

struct Flown {
    took_off: bool,
    summary: Summary,
    exit: u8,
}

/// Runs a sound scenario and writes everything down.
fn fly(
    scenario: &Scenario,
    text: &str,
    manifest: &Manifest,
    out: &Path,
    how: How,
) -> Result<Flown, NotFlown> {
    let How { pace, launcher, unmeasured, looks } = how;
    let stop = Stop::on_signals_twice_at_once()?;
    let mut run_dir = RunDir::create(out, scenario)?;
    run_dir.write_scenario(text)?;
    run_dir.write_manifest(manifest)?;
    run_dir.begin_recording(text, manifest)?;
    let mut metrics = Metrics::new(scenario, pace);
    if unmeasured {
        run_dir.record_nothing();
        metrics.look_away();
    }
    let by_hand = looks.as_ref().is_some_and(|looks| looks.control);
    let mut view = None;
    if let Some(Looks { bound, control }) = looks {
        let _ = writeln!(io::stderr(), "view: {}", bound.url());
        view = Some(bound.serve(live::scene(scenario, pace), control)?);
    }
    let bar = BAR.get_or_init(|| progress_bar(scenario.duration_ns));
    let launched =
        Run::launch(scenario, pace, &launcher, by_hand, &mut run_dir, &mut metrics, stop);
    let (mut outcome, flown) = match launched {
        Ok(run) => run.watched_by(view.as_mut()).to_the_end(|t_ns| show_progress(bar, t_ns)),
        Err(error) => (Outcome::default(), Err(error)),
    };
    bar.finish_and_clear();
    let ended_with = run::exit_code(&outcome, &flown);
    if let Err(error) = &flown {
        complain(error);
    }
    let measures = metrics.finish();
    let expectations =
        expect::evaluate(&scenario.expect, &measures, pace, outcome.deadline_misses, ended_with);
    let held = expectations.iter().all(|expectation| expectation.held);
    let expected = scenario.expect.exit == Some(ended_with);
    let exit = match (ended_with, held) {
        (exit::OK, true) => exit::OK,
        (exit::OK, false) => exit::EXPECTATION_MISSED,
        (_, true) if expected => exit::OK,
        (code, _) => code,
    };
    let summary = Summary::new(scenario, pace, &measures, &outcome, expectations, exit);
    let finished = run_dir.finish(&summary, &measures.pairs, &mut outcome.latency);
    if let Some(view) = view {
        let text = match (&flown, &finished) {
            (Err(error), _) => format!("error: {error}"),
            (_, Err(error)) => format!("error: {error}"),
            _ => summary::screen(&summary),
        };
        let exit = if finished.is_ok() { exit } else { exit::INFRASTRUCTURE };
        view.landed(exit, &text);
    }
    finished?;
    Ok(Flown { took_off: outcome.truth.is_some(), summary, exit })
}

fn progress_bar(duration_ns: u64) -> ProgressBar {
    if !io::stderr().is_terminal() {
        return ProgressBar::hidden();
    }
    let bar = ProgressBar::new(duration_ns / MS);
    // Not as wide as the screen: the echo of a Ctrl-C would break the line.
    let style = ProgressStyle::with_template("{bar:50} {msg}").expect("a valid template");
    bar.set_style(style);
    bar
}

fn show_progress(bar: &ProgressBar, t_ns: u64) {
    bar.set_position(t_ns / MS);
    let seconds = |ms: u64| ms as f64 / 1e3;
    let whole = bar.length().map_or(0.0, seconds);
    bar.set_message(format!("{:.1} of {whole} s", seconds(t_ns / MS)));
}

/// The scenario with its effective text; what is wrong with it is printed.
fn read_scenario(args: &ScenarioArgs, laws: &[LawDescription]) -> Option<(Scenario, String)> {
    let overrides =
        Overrides { set: args.set.clone(), faults: args.fault.clone(), seed: args.seed };
    let show = |diagnostic: &Diagnostic| {
        let _ = writeln!(io::stderr(), "{}", diagnostic.render(in_color()));
    };
    match read(&args.scenario, &overrides, laws) {
        Ok((scenario, text, warnings)) => {
            warnings.iter().for_each(show);
            Some((scenario, text))
        }
        Err(diagnostic) => {
            show(&diagnostic);
            None
        }
    }
}

/// Prints a result; a closed pipe is the reader's choice, not an error.
fn print(text: &str) -> u8 {
    match io::stdout().write_all(text.as_bytes()).and_then(|()| io::stdout().flush()) {
        Ok(()) => exit::OK,
        Err(error) if error.kind() == io::ErrorKind::BrokenPipe => exit::OK,
        Err(error) => complain(&error),
    }
}

fn complain(error: &dyn std::fmt::Display) -> u8 {
    let _ = writeln!(io::stderr(), "error: {error}");
    exit::INFRASTRUCTURE
}
