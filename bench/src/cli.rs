//! What was asked for, and in which order it is measured.
//!
//! The table goes to stdout, everything else to stderr. A bench fails only if something could not
//! be measured, or if the trajectories differ.

use std::io::{self, IsTerminal as _, Write as _};
use std::path::PathBuf;
use std::time::Duration;

use clap::{Args, Parser, Subcommand, ValueEnum};
use protocol::process::{Stop, exit, quiet_iceoryx2, set_name, try_realtime_priority};
use protocol::run_root::{self, RunRoot};

use crate::floor::Carrier;
#[cfg(feature = "bridge")]
use crate::hosts;
use crate::machine::Machine;
use crate::round_trip::Transport;
use crate::table::Report;
use crate::timers::Task;
use crate::{
    BenchError, Setting, causes, control, floor, growth, lockstep, neighbor, pages, peers,
    realtime, replacement, round_trip, startup, timers, view,
};

/// Round trips by each means in one second's worth of a round; five rounds of a full bench make
/// 100,000.
const TRIPS_PER_S: f64 = 20_000.0;
/// A means that is this much slower than a second's worth should be is cut off.
const TRIPS_LIMIT: f64 = 10.0;
/// A run in real time takes this much longer than one in lockstep: rare misses need time.
const REALTIME: f64 = 3.0;
/// One whose rarest delays are to be seen takes this much longer.
const CONTROL: f64 = 60.0;
/// A run whose cost is to be told from that of starting 256 processes takes this much longer.
const GROWTH: f64 = 3.0;

/// The first word of a process that takes part in a measurement.
pub const PEER: &str = "peer";

/// Measure this machine's baselines, and the ratio of a run to each.
#[derive(Debug, Parser)]
#[command(name = "phalanx bench", bin_name = "phalanx bench", version)]
#[command(args_conflicts_with_subcommands = true)]
pub struct CommandLine {
    /// What to measure.
    #[command(flatten)]
    args: BenchArgs,
    /// Or what to do in a measurement.
    #[command(subcommand)]
    peer: Option<Child>,
}

#[derive(Debug, Subcommand)]
#[command(disable_help_subcommand = true)]
enum Child {
    /// Take part in a measurement.
    #[command(hide = true, subcommand)]
    Peer(PeerVerb),
}

/// Arguments of `phalanx bench`.
#[derive(Debug, Args)]
struct BenchArgs {
    /// A minute instead of several: fewer and shorter rounds.
    #[arg(long)]
    quick: bool,
    /// Measure these parts alone.
    #[arg(long, value_enum, value_name = "PART", value_delimiter = ',')]
    only: Vec<Part>,
    /// Numbers of robots [default: 3, 8, 16, 32, 64 in lockstep; 3, 8, 32, 64 in real time;
    /// 2, 8 for neighbors; 8, 64 for the start-up and pages; 3, 8, 16, 32, 64, 128, 256 for
    /// growth].
    #[arg(long, value_name = "N", value_delimiter = ',', value_parser = robots)]
    robots: Vec<usize>,
    /// How often ours and the baselines take turns [default: 5; 3 if quick].
    #[arg(long, value_parser = clap::value_parser!(u16).range(1..))]
    rounds: Option<u16>,
    /// Kills in each round of the part replacement.
    #[arg(long, default_value_t = 20, value_parser = clap::value_parser!(u16).range(1..))]
    kills: u16,
    /// Measure the start-up of 256 robots too.
    #[arg(long)]
    large: bool,
    /// In the parts realtime and control, let robots, plant and timers run before every ordinary process, with
    /// their memory locked.
    #[arg(long)]
    realtime_priority: bool,
    /// How long each measurement is to take, s, about [default: 1; 0.2 if quick].
    #[arg(long, hide = true, value_parser = seconds)]
    seconds: Option<f64>,
    /// What to print.
    #[arg(long, value_enum, default_value_t = Output::Text)]
    output: Output,
}

/// The parts of a bench.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
enum Part {
    /// A robot's round trip, against those of bare transports.
    #[value(alias = "floors")]
    Baselines,
    /// Ticks per second, against the same without iceoryx2.
    Lockstep,
    /// Deadlines missed, by size and rate.
    Realtime,
    /// How late all robots wake, against the bare timer of the same run; only if named here.
    Control,
    /// Whether late wake-ups are told their true cause; only if named here.
    Causes,
    /// From a neighbor's publication to its use, against iceoryx2 polled by the same timers.
    Neighbor,
    /// The same with a live view open in a browser, and without; only if named here.
    View,
    /// What a tick costs as the robots grow in number, to 256; only if named here.
    Growth,
    /// From one host to another, by zenoh with TLS and by bridges, against plain UDP; only if named here, and in a
    /// build with the feature `bridge`.
    Bridge,
    /// Which pages of memory a tick in lockstep touches, by what they are for; only if named here.
    Pages,
    /// Time until everybody is ready.
    Startup,
    /// Time from a kill to the replacement's first command.
    Replacement,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
enum Output {
    /// A table.
    Text,
    /// The same for programs, with every round's figures.
    Json,
}

fn robots(word: &str) -> Result<usize, String> {
    match word.parse() {
        Ok(robots @ 2..=256) => Ok(robots),
        _ => Err("expected a number from 2 to 256".into()),
    }
}

fn seconds(word: &str) -> Result<f64, String> {
    match word.parse() {
        Ok(seconds) if (0.001..=100.0).contains(&seconds) => Ok(seconds),
        _ => Err("expected a number from 0.001 to 100".into()),
    }
}

/// `phalanx bench`, or a process that it starts.
pub fn main(command_line: &CommandLine) -> u8 {
    quiet_iceoryx2();
    match &command_line.peer {
        Some(Child::Peer(verb)) => peer(verb),
        None => bench(&command_line.args),
    }
}

fn bench(args: &BenchArgs) -> u8 {
    let measured = Stop::on_signals_twice_at_once()
        .map_err(|error| BenchError::Wrong(format!("cannot handle signals: {error}")))
        .and_then(|stop| measure(args, &stop));
    if io::stderr().is_terminal() {
        let _ = write!(io::stderr(), "\r\x1b[K");
    }
    let report = match measured {
        Ok(report) => report,
        Err(error @ BenchError::Interrupted) => {
            complain(&error);
            return exit::INTERRUPTED;
        }
        Err(error) => return complain(&error),
    };
    let text = match args.output {
        Output::Text => report.screen(),
        Output::Json => report.to_json(),
    };
    match io::stdout().write_all(text.as_bytes()).and_then(|()| io::stdout().flush()) {
        Err(error) if error.kind() != io::ErrorKind::BrokenPipe => return complain(&error),
        _ => {}
    }
    let differ = report.trajectories.iter().find(|trajectory| !trajectory.is_one());
    match differ {
        Some(trajectory) => complain(&format!(
            "trajectories of {} robots differ, so their speeds do not compare: {:?}",
            trajectory.robots, trajectory.hashes
        )),
        None => exit::OK,
    }
}

fn measure(args: &BenchArgs, stop: &Stop) -> Result<Report, BenchError> {
    let mut machine = Machine::look();
    let warnings = machine.warnings();
    let terminal = io::stderr().is_terminal();
    // Before the wait, for whoever would rather not; the table says it again.
    for warning in warnings.iter().filter(|_| terminal) {
        let _ = writeln!(io::stderr(), "warning: {warning}");
    }
    let base = run_root::base();
    run_root::sweep(&base);
    let root = RunRoot::create(&base)?;
    let rounds = args.rounds.map_or(if args.quick { 3 } else { 5 }, usize::from);
    let seconds = args.seconds.unwrap_or(if args.quick { 0.2 } else { 1.0 });
    let or = |default: &[usize]| match &args.robots[..] {
        [] => default.to_vec(),
        chosen => chosen.to_vec(),
    };
    let wanted = |part| args.only.is_empty() || args.only.contains(&part);
    let realtime_priority = args.realtime_priority;
    let setting = &Setting { root: &root, stop, rounds, tells: terminal, realtime_priority };
    if realtime_priority {
        try_realtime_priority()
            .map_err(|error| BenchError::Wrong(format!("--realtime-priority: {error}")))?;
    }
    let (mut rows, mut trajectories, mut notes) = (Vec::new(), Vec::new(), Vec::new());
    if wanted(Part::Baselines) {
        let trips = ((TRIPS_PER_S * seconds) as usize).max(1);
        let limit = Duration::from_secs_f64(TRIPS_LIMIT * seconds);
        rows.extend(round_trip::measure(setting, trips, limit)?);
    }
    if wanted(Part::Lockstep) {
        let robots = or(&[3, 8, 16, 32, 64]);
        let measured = lockstep::measure(setting, &robots, seconds)?;
        rows.extend(measured.0);
        trajectories = measured.1;
    }
    if wanted(Part::Realtime) {
        let robots = or(&[3, 8, 32, 64]);
        let seconds = REALTIME * seconds;
        let measured = realtime::measure(setting, &robots, seconds)?;
        rows.extend(measured.0);
        notes.extend(measured.1);
    }
    if args.only.contains(&Part::Control) {
        let measured = control::measure(setting, CONTROL * seconds)?;
        rows.extend(measured.0);
        notes.extend(measured.1);
    }
    if args.only.contains(&Part::Causes) {
        let measured = causes::measure(setting, REALTIME * seconds)?;
        rows.extend(measured.0);
        notes.extend(measured.1);
    }
    if wanted(Part::Neighbor) {
        let robots = or(&[2, 8]);
        let seconds = REALTIME * seconds;
        rows.extend(neighbor::measure(setting, &robots, seconds)?);
    }
    if args.only.contains(&Part::View) {
        rows.extend(view::measure(setting, &or(&[8]), REALTIME * seconds)?);
    }
    if args.only.contains(&Part::Growth) {
        let robots = or(&[3, 8, 16, 32, 64, 128, 256]);
        let seconds = GROWTH * seconds;
        rows.extend(growth::measure(setting, &robots, seconds)?);
        notes.extend(growth::NOTES.map(str::to_owned));
    }
    if args.only.contains(&Part::Bridge) {
        #[cfg(feature = "bridge")]
        {
            let measured = hosts::measure(setting, REALTIME * seconds)?;
            rows.extend(measured.0);
            notes.extend(measured.1);
        }
        #[cfg(not(feature = "bridge"))]
        return Err(BenchError::Wrong(
            "this was built without the feature `bridge`: `cargo build --release --workspace --features bridge`".into(),
        ));
    }
    if args.only.contains(&Part::Pages) {
        let measured = pages::measure(setting, &or(&[8, 64]))?;
        rows.extend(measured.0);
        notes.extend(measured.1);
    }
    if wanted(Part::Startup) {
        let mut robots = or(&[8, 64]);
        robots.extend(args.large.then_some(256));
        rows.extend(startup::measure(setting, &robots)?);
    }
    if wanted(Part::Replacement) {
        rows.extend(replacement::measure(setting, args.kills.into())?);
    }
    if let Err(error) = root.remove() {
        let _ = writeln!(io::stderr(), "warning: could not remove the run root: {error}");
    }
    machine.look_again();
    Ok(Report { machine, warnings, trajectories, rows, notes })
}

fn complain(error: &dyn std::fmt::Display) -> u8 {
    let _ = writeln!(io::stderr(), "error: {error}");
    exit::INFRASTRUCTURE
}

/// A process that takes part in a measurement.
#[derive(Debug, Subcommand)]
enum PeerVerb {
    /// Answer samples.
    RoundTrip {
        /// What carries them.
        #[arg(value_enum)]
        transport: Transport,
        /// Where the ends are.
        dir: PathBuf,
    },
    /// Run a robot without iceoryx2.
    Floor {
        /// What carries the samples.
        #[arg(value_enum)]
        carrier: Carrier,
        /// The robot's brief.
        brief: PathBuf,
    },
    /// Hear neighbors and be heard, without a brain.
    Neighbor {
        /// The robot's brief.
        brief: PathBuf,
        /// For how many wake-ups.
        ticks: u64,
        /// Where to write what was seen.
        result: PathBuf,
    },
    /// Wake by a robot's timer, and do nothing.
    Timer {
        /// Which robot's, from 1.
        index: usize,
        /// What to do.
        #[command(flatten)]
        task: Task,
        /// Where to write what was seen.
        result: PathBuf,
    },
    /// Be late in one way, and tell what was seen of it.
    Late {
        /// In which way.
        #[arg(value_enum)]
        way: causes::Way,
        /// For how many periods.
        ticks: u64,
        /// Where to write what was seen.
        result: PathBuf,
    },
    /// Be the end of a cable between two hosts.
    #[cfg(feature = "bridge")]
    Host {
        /// What the host's bridge is told.
        brief: PathBuf,
        /// How many samples count.
        samples: u64,
        /// Where to write what arrived.
        result: PathBuf,
    },
    /// Kill a robot and wait for its replacement.
    Kill {
        /// The robot's brief.
        brief: PathBuf,
        /// How often.
        kills: usize,
        /// Where to write how long each took.
        result: PathBuf,
    },
}

/// `phalanx-bench peer`.
fn peer(verb: &PeerVerb) -> u8 {
    set_name("phalanx-bench");
    peers::limit_life();
    let done = match verb {
        PeerVerb::RoundTrip { transport, dir } => round_trip::peer(*transport, dir),
        PeerVerb::Floor { carrier, brief } => floor::agent(*carrier, brief),
        PeerVerb::Neighbor { brief, ticks, result } => neighbor::peer(brief, *ticks, result),
        PeerVerb::Timer { index, task, result } => timers::peer(*index, *task, result),
        PeerVerb::Late { way, ticks, result } => causes::peer(*way, *ticks, result),
        #[cfg(feature = "bridge")]
        PeerVerb::Host { brief, samples, result } => hosts::peer(brief, *samples, result),
        PeerVerb::Kill { brief, kills, result } => replacement::onlooker(brief, *kills, result),
    };
    done.map_or_else(|error| complain(&error), |()| exit::OK)
}
