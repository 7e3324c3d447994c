//! Command line of `phalanx bench`.
//!
//! The table goes to stdout, all other output to stderr. A bench fails only if a measurement is impossible,
//! or if the trajectories differ.

use std::io::{self, IsTerminal as _, Write as _};
use std::path::PathBuf;

use anyhow::Context as _;
use clap::{Args, Parser, Subcommand, ValueEnum};
use protocol::process::{Stop, exit, quiet_iceoryx2, set_name, try_realtime_priority};
use protocol::run_root::{self, RunRoot};

use crate::machine::Machine;
use crate::peers::{self, Post};
use crate::rounds::Setting;
use crate::table::{Report, Table};
use crate::timers::Task;
use crate::transport::Transport;
use crate::{
    Interrupted, bare_lockstep, growth, lockstep, neighbor, realtime, repair, replacement,
    round_trip, timers,
};

/// First argument of a process that takes part in a measurement.
pub const PEER: &str = peers::PEER;

/// Measure the machine's baselines and the ratio of a run to each.
#[derive(Debug, Parser)]
#[command(name = "phalanx bench", bin_name = "phalanx bench", version)]
#[command(args_conflicts_with_subcommands = true)]
pub struct CommandLine {
    /// Measurements.
    #[command(flatten)]
    args: BenchArgs,
    /// Role of a process that takes part in a measurement.
    #[command(subcommand)]
    peer: Option<Child>,
}

#[derive(Debug, Subcommand)]
#[command(disable_help_subcommand = true)]
enum Child {
    /// Take part in a measurement.
    #[command(hide = true)]
    Peer {
        /// Directory and index of the process.
        #[command(flatten)]
        post: Post,
        /// Task of the process.
        #[command(subcommand)]
        verb: PeerVerb,
    },
}

/// Arguments of `phalanx bench`.
#[derive(Debug, Args)]
struct BenchArgs {
    /// Use fewer and shorter rounds: one minute instead of several.
    #[arg(long)]
    quick: bool,
    /// Measure only these parts.
    #[arg(long, value_enum, value_name = "PART", value_delimiter = ',')]
    only: Vec<Part>,
    /// Numbers of robots [default: 3, 8, 16, 32, 64 in lockstep; 3, 8, 32, 64 in real time; 2, 8 for
    /// neighbors; 8, 64 for the start-up; 3, 8, 16, 32, 64, 128, 256 for growth].
    #[arg(long, value_name = "N", value_delimiter = ',')]
    #[arg(value_parser = clap::value_parser!(u16).range(2..=256))]
    robots: Vec<u16>,
    /// Number of rounds; each measures the run and its baselines alternately [default: 5; 3 with --quick].
    #[arg(long, value_parser = clap::value_parser!(u16).range(1..))]
    rounds: Option<u16>,
    /// Number of kills per round in the parts replacement and repair.
    #[arg(long, default_value_t = 20, value_parser = clap::value_parser!(u16).range(1..))]
    kills: u16,
    /// Also measure the start-up of 256 robots.
    #[arg(long)]
    large: bool,
    /// In the part realtime, run robots, plant and timers with SCHED_FIFO priority and locked memory.
    #[arg(long)]
    realtime_priority: bool,
    /// Approximate duration of each measurement, s [default: 1; 0.2 with --quick].
    #[arg(long, hide = true, value_parser = seconds)]
    seconds: Option<f64>,
    /// Output format.
    #[arg(long, value_enum, default_value_t = Output::Text)]
    output: Output,
}

/// Part of a bench.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
enum Part {
    /// Round trip of a robot, compared with those of bare transports.
    #[value(alias = "floors")]
    Baselines,
    /// Ticks per second, compared with the same work without iceoryx2.
    Lockstep,
    /// Deadline misses, by number of robots and rate.
    Realtime,
    /// Time from a neighbor's publication to its use, compared with iceoryx2 polled by the same timers.
    Neighbor,
    /// Cost of a tick for up to 256 robots; only if named here.
    Growth,
    /// Time until all processes are ready.
    Startup,
    /// Time from a kill to the replacement's first command.
    Replacement,
    /// Time from a loss to the first sample for which a backup neighbor is used, beyond `repair_after_s`.
    Repair,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
enum Output {
    /// Table.
    Text,
    /// JSON, with the values of every round.
    Json,
}

fn seconds(word: &str) -> Result<f64, String> {
    match word.parse() {
        Ok(seconds) if (0.001..=100.0).contains(&seconds) => Ok(seconds),
        _ => Err("must be a number from 0.001 to 100".into()),
    }
}

/// Runs `phalanx bench`, or a process that it starts, and returns the exit code.
pub fn main(command_line: &CommandLine) -> u8 {
    quiet_iceoryx2();
    match &command_line.peer {
        Some(Child::Peer { post, verb }) => peer(post, verb),
        None => bench(&command_line.args),
    }
}

fn bench(args: &BenchArgs) -> u8 {
    let stop = Stop::on_signals_twice_at_once().context("cannot handle signals");
    let measured = stop.and_then(|stop| measure(args, &stop));
    if io::stderr().is_terminal() {
        let _ = write!(io::stderr(), "\r\x1b[K");
    }
    let report = match measured {
        Ok(report) => report,
        Err(error) => {
            let code = complain(&format!("{error:#}"));
            return if error.is::<Interrupted>() { exit::INTERRUPTED } else { code };
        }
    };
    let text = match args.output {
        Output::Text => report.screen(),
        Output::Json => report.to_json(),
    };
    match io::stdout().write_all(text.as_bytes()).and_then(|()| io::stdout().flush()) {
        Err(error) if error.kind() != io::ErrorKind::BrokenPipe => complain(&error.to_string()),
        _ => report.differing().map_or(exit::OK, |differing| complain(&differing)),
    }
}

fn measure(args: &BenchArgs, stop: &Stop) -> anyhow::Result<Report> {
    let mut machine = Machine::read();
    let warnings = machine.warnings();
    let shows_progress = io::stderr().is_terminal();
    // Printed before the long measurement too; the table repeats it.
    for warning in warnings.iter().filter(|_| shows_progress) {
        let _ = writeln!(io::stderr(), "warning: {warning}");
    }
    let base = run_root::base();
    run_root::sweep(&base);
    let root = RunRoot::create(&base)?;
    let setting = Setting {
        root: &root,
        stop,
        rounds: args.rounds.map_or(if args.quick { 3 } else { 5 }, usize::from),
        seconds: args.seconds.unwrap_or(if args.quick { 0.2 } else { 1.0 }),
        realtime_priority: args.realtime_priority,
        shows_progress,
    };
    if args.realtime_priority {
        try_realtime_priority().context("--realtime-priority")?;
    }
    let (mut table, mut notes) = (Table::default(), Vec::new());
    for &part in Part::value_variants() {
        let by_itself = part != Part::Growth && args.only.is_empty();
        if !by_itself && !args.only.contains(&part) {
            continue;
        }
        if part == Part::Growth {
            notes.extend(growth::NOTES.map(str::to_owned));
        }
        measure_part(part, args, &setting, &mut table)?;
    }
    if let Err(error) = root.remove() {
        let _ = writeln!(io::stderr(), "warning: could not remove the run root: {error}");
    }
    machine.read_load_after();
    Ok(table.report(machine, warnings, notes))
}

fn measure_part(
    part: Part,
    args: &BenchArgs,
    setting: &Setting<'_>,
    table: &mut Table,
) -> anyhow::Result<()> {
    let robots = |default: &[usize]| match &args.robots[..] {
        [] => default.to_vec(),
        chosen => chosen.iter().copied().map(usize::from).collect(),
    };
    let (name, cases) = match part {
        // The JSON has always used this name.
        Part::Baselines => ("floors", round_trip::cases(setting)?),
        Part::Lockstep => ("lockstep", lockstep::speed(setting, &robots(&[3, 8, 16, 32, 64]))?),
        Part::Realtime => ("realtime", realtime::cases(setting, &robots(&[3, 8, 32, 64]))),
        Part::Neighbor => ("neighbor", neighbor::cases(setting, &robots(&[2, 8]))?),
        Part::Growth => ("growth", growth::cases(setting, &robots(&[3, 8, 16, 32, 64, 128, 256]))),
        Part::Startup => {
            let mut robots = robots(&[8, 64]);
            robots.extend(args.large.then_some(256));
            ("startup", lockstep::startup(setting, &robots)?)
        }
        Part::Replacement => ("replacement", replacement::cases(setting, args.kills.into())),
        Part::Repair => ("repair", repair::cases(setting, args.kills.into())),
    };
    setting.measure(table, name, cases)
}

fn complain(error: &str) -> u8 {
    let _ = writeln!(io::stderr(), "error: {error}");
    exit::INFRASTRUCTURE
}

/// Task of a process that takes part in a measurement.
#[derive(Debug, Clone, Subcommand)]
enum PeerVerb {
    /// Reply to samples.
    RoundTrip {
        /// Transport of the messages.
        #[arg(value_enum)]
        transport: Transport,
    },
    /// Run a robot without iceoryx2.
    Lockstep,
    /// Exchange beacons with neighbors, without a controller.
    Neighbor {
        /// Number of wake-ups.
        ticks: u64,
    },
    /// Wait on a robot's timer, and do nothing else.
    Timer(Task),
    /// Kill a robot and wait for its replacement.
    Kill {
        /// Configuration file (brief) of the robot.
        brief: PathBuf,
        /// Number of kills.
        kills: usize,
    },
}

/// Runs `phalanx-bench peer` and returns the exit code.
fn peer(post: &Post, verb: &PeerVerb) -> u8 {
    set_name("phalanx-bench");
    peers::limit_life();
    let done = match verb {
        PeerVerb::RoundTrip { transport } => round_trip::peer(post, *transport),
        PeerVerb::Lockstep => bare_lockstep::peer(post),
        PeerVerb::Neighbor { ticks } => neighbor::peer(post, *ticks),
        PeerVerb::Timer(task) => timers::peer(post, *task),
        PeerVerb::Kill { brief, kills } => replacement::peer(post, brief, *kills),
    };
    done.map_or_else(|error| complain(&format!("{error:#}")), |()| exit::OK)
}
