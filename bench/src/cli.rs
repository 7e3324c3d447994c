//! Command line of `phalanx bench` and of its peer processes.
//!
//! The table goes to stdout, all other output to stderr. A bench fails only if a measurement fails or if the
//! trajectories differ.

use std::io::{self, IsTerminal as _, Write as _};
use std::path::PathBuf;

use anyhow::Context as _;
use clap::{Args, Parser, Subcommand, ValueEnum};
use protocol::process::{
    StopFlag, check_realtime_priority, exit, limit_iceoryx2_log, set_thread_name,
};
use protocol::run_root::{self, RunRoot};

use crate::machine::Machine;
use crate::peers::{self, PeerAddress};
use crate::rounds::BenchSettings;
use crate::table::{MeasurementTable, Report};
use crate::timers::TimerTask;
use crate::transport::Transport;
use crate::{
    Interrupted, bare_lockstep, growth, in_process, lockstep, messages, neighbor, realtime, repair,
    replacement, round_trip, timers,
};

/// First argument of a peer process, which takes part in a measurement.
pub const PEER_SUBCOMMAND: &str = peers::PEER_SUBCOMMAND;

/// Measure runs against baselines of this machine
#[derive(Debug, Parser)]
#[command(name = "phalanx bench", bin_name = "phalanx bench", version)]
#[command(args_conflicts_with_subcommands = true)]
pub struct CommandLine {
    /// Arguments of the bench.
    #[command(flatten)]
    args: BenchArgs,
    /// Command of a peer process; `None` for the bench itself.
    #[command(subcommand)]
    peer: Option<PeerCommand>,
}

#[derive(Debug, Subcommand)]
#[command(disable_help_subcommand = true)]
enum PeerCommand {
    /// Take part in a measurement.
    #[command(hide = true)]
    Peer {
        /// Directory and index of the peer.
        #[command(flatten)]
        address: PeerAddress,
        /// Task of the peer.
        #[command(subcommand)]
        verb: PeerVerb,
    },
}

/// Arguments of `phalanx bench`.
#[derive(Debug, Args)]
struct BenchArgs {
    /// Use fewer and shorter rounds: about one minute instead of several.
    #[arg(long)]
    quick: bool,
    /// Measure only these parts.
    #[arg(long, value_enum, value_name = "PART", value_delimiter = ',')]
    only: Vec<BenchPart>,
    /// Numbers of robots [default: 3, 8, 16, 32, 64 for lockstep; 3, 8, 32, 64 for realtime;
    /// 2, 8 for neighbor; 8, 64 for startup and messages; 3, 8, 16, 32, 64, 128, 256 for growth;
    /// 8, 64, 256, 1024 for in-process].
    #[arg(long, value_name = "N", value_delimiter = ',')]
    #[arg(value_parser = clap::value_parser!(u16).range(2..=1024))]
    robots: Vec<u16>,
    /// Number of rounds; in each, Phalanx and its baselines are measured once [default: 5; 3 with --quick].
    #[arg(long, value_parser = clap::value_parser!(u16).range(1..))]
    rounds: Option<u16>,
    /// Number of kills in each round of the parts replacement and repair.
    #[arg(long, default_value_t = 20, value_parser = clap::value_parser!(u16).range(1..))]
    kills: u16,
    /// Also measure the start-up of 256 robots.
    #[arg(long)]
    large: bool,
    /// Run robots, plant and timers of the part realtime with SCHED_FIFO priority and locked memory.
    #[arg(long)]
    realtime_priority: bool,
    /// Approximate duration of each measurement, s [default: 1; 0.2 with --quick].
    #[arg(long, hide = true, value_parser = parse_seconds)]
    seconds: Option<f64>,
    /// Output format.
    #[arg(long, value_enum, default_value_t = OutputFormat::Text)]
    output: OutputFormat,
}

/// A part of the bench.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
enum BenchPart {
    /// Round trip of a robot, compared with bare transports.
    #[value(alias = "floors")]
    Baselines,
    /// Ticks per second, compared with the same work without iceoryx2.
    Lockstep,
    /// Deadline misses by rate and number of robots, compared with bare timers.
    Realtime,
    /// Time from a neighbor's publication to its use, compared with iceoryx2 polled by the same timers.
    Neighbor,
    /// Processor time per tick for up to 256 robots; measured only if named here.
    Growth,
    /// Processor time per tick of runs within one process, for up to 1,024 robots; measured only if named here.
    InProcess,
    /// Processor time per tick with a message of 256 bytes in each beacon, compared with none; measured only if named
    /// here.
    Messages,
    /// Time until all processes are ready.
    Startup,
    /// Time from a kill to the replacement's first command.
    Replacement,
    /// Time from the timeout of an in-neighbor to the first sample that uses a backup neighbor, minus `repair_after_s`.
    Repair,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
enum OutputFormat {
    /// Text table.
    Text,
    /// JSON, with the values of every round.
    Json,
}

/// Parses the value of `--seconds`.
fn parse_seconds(text: &str) -> Result<f64, String> {
    match text.parse() {
        Ok(seconds) if (0.001..=100.0).contains(&seconds) => Ok(seconds),
        _ => Err("must be a number from 0.001 to 100".into()),
    }
}

/// Runs `phalanx bench` or one of its peer processes, and returns the exit code.
pub fn main(command_line: &CommandLine) -> u8 {
    limit_iceoryx2_log();
    match &command_line.peer {
        Some(PeerCommand::Peer { address, verb }) => run_peer(address, verb),
        None => run_bench(&command_line.args),
    }
}

/// Measures all selected parts, prints the report and returns the exit code.
fn run_bench(args: &BenchArgs) -> u8 {
    let stop = StopFlag::for_run_ending_signals().context("cannot handle signals");
    let result = stop.and_then(|stop| measure(args, &stop));
    if io::stderr().is_terminal() {
        let _ = write!(io::stderr(), "\r\x1b[K");
    }
    let report = match result {
        Ok(report) => report,
        Err(error) => {
            let code = print_error(&format!("{error:#}"));
            return if error.is::<Interrupted>() { exit::INTERRUPTED } else { code };
        }
    };
    let text = match args.output {
        OutputFormat::Text => report.to_text(),
        OutputFormat::Json => report.to_json(),
    };
    match io::stdout().write_all(text.as_bytes()).and_then(|()| io::stdout().flush()) {
        Err(error) if error.kind() != io::ErrorKind::BrokenPipe => print_error(&error.to_string()),
        _ => report.find_trajectory_mismatch().map_or(exit::OK, |message| print_error(&message)),
    }
}

fn measure(args: &BenchArgs, stop: &StopFlag) -> anyhow::Result<Report> {
    let mut machine = Machine::probe();
    let warnings = machine.warnings();
    let shows_progress = io::stderr().is_terminal();
    // Printed before the long wait, so that the user can interrupt it; the table repeats them.
    for warning in warnings.iter().filter(|_| shows_progress) {
        let _ = writeln!(io::stderr(), "warning: {warning}");
    }
    let base = run_root::base_directory();
    run_root::remove_dead_roots(&base);
    let root = RunRoot::create(&base)?;
    let settings = BenchSettings {
        root: &root,
        stop,
        rounds: args.rounds.map_or(if args.quick { 3 } else { 5 }, usize::from),
        duration_s: args.seconds.unwrap_or(if args.quick { 0.2 } else { 1.0 }),
        realtime_priority: args.realtime_priority,
        shows_progress,
    };
    if args.realtime_priority {
        check_realtime_priority().context("--realtime-priority")?;
    }
    let (mut table, mut notes) = (MeasurementTable::default(), Vec::new());
    for &part in BenchPart::value_variants() {
        let is_on_demand =
            [BenchPart::Growth, BenchPart::InProcess, BenchPart::Messages].contains(&part);
        let is_default = !is_on_demand && args.only.is_empty();
        if !is_default && !args.only.contains(&part) {
            continue;
        }
        if part == BenchPart::Growth {
            notes.extend(growth::NOTES.map(str::to_owned));
        }
        measure_part(part, args, &settings, &mut table)?;
    }
    if let Err(error) = root.remove() {
        let _ = writeln!(io::stderr(), "warning: could not remove the run root: {error}");
    }
    machine.update_load();
    Ok(table.into_report(machine, warnings, notes))
}

fn measure_part(
    part: BenchPart,
    args: &BenchArgs,
    settings: &BenchSettings<'_>,
    table: &mut MeasurementTable,
) -> anyhow::Result<()> {
    let robots = |default: &[usize]| match &args.robots[..] {
        [] => default.to_vec(),
        selected => selected.iter().copied().map(usize::from).collect(),
    };
    let (name, cases) = match part {
        // The established name of this part in the JSON output.
        BenchPart::Baselines => ("floors", round_trip::cases(settings)?),
        BenchPart::Lockstep => {
            ("lockstep", lockstep::speed_cases(settings, &robots(&[3, 8, 16, 32, 64]))?)
        }
        BenchPart::Realtime => ("realtime", realtime::cases(settings, &robots(&[3, 8, 32, 64]))),
        BenchPart::Neighbor => ("neighbor", neighbor::cases(settings, &robots(&[2, 8]))?),
        BenchPart::Growth => {
            ("growth", growth::cases(settings, &robots(&[3, 8, 16, 32, 64, 128, 256]))?)
        }
        BenchPart::InProcess => {
            ("in-process", in_process::cases(settings, &robots(&[8, 64, 256, 1024])))
        }
        BenchPart::Messages => ("messages", messages::cases(settings, &robots(&[8, 64]))),
        BenchPart::Startup => {
            let mut robots = robots(&[8, 64]);
            robots.extend(args.large.then_some(256));
            ("startup", lockstep::startup_cases(settings, &robots)?)
        }
        BenchPart::Replacement => ("replacement", replacement::cases(settings, args.kills.into())),
        BenchPart::Repair => ("repair", repair::cases(settings, args.kills.into())),
    };
    settings.measure_cases(table, name, cases)
}

/// Prints an error to stderr and returns the exit code for it.
fn print_error(error: &str) -> u8 {
    let _ = writeln!(io::stderr(), "error: {error}");
    exit::INFRASTRUCTURE_FAILURE
}

/// Task of a peer process.
#[derive(Debug, Clone, Subcommand)]
enum PeerVerb {
    /// Answer odometry samples.
    RoundTrip {
        /// Transport of the messages.
        #[arg(value_enum)]
        transport: Transport,
    },
    /// Run the controller of a robot without iceoryx2.
    Lockstep {
        /// Answer each tick at once, without a controller.
        #[arg(long)]
        without_work: bool,
    },
    /// Exchange beacons with neighbors, without a controller.
    Neighbor {
        /// Number of wake-ups.
        ticks: u64,
    },
    /// Wake at a robot's timer and use the processor, without other work.
    Timer(TimerTask),
    /// Kill a robot repeatedly and wait for each replacement.
    Kill {
        /// Path of the robot's process configuration (brief).
        brief: PathBuf,
        /// Number of kills.
        kills: usize,
    },
}

/// Runs a peer process (`phalanx-bench peer`) and returns its exit code.
fn run_peer(address: &PeerAddress, verb: &PeerVerb) -> u8 {
    set_thread_name("phalanx-bench");
    peers::limit_lifetime();
    let result = match verb {
        PeerVerb::RoundTrip { transport } => round_trip::run_peer(address, *transport),
        PeerVerb::Lockstep { without_work: false } => bare_lockstep::run_peer(address),
        PeerVerb::Lockstep { without_work: true } => bare_lockstep::run_peer_without_work(address),
        PeerVerb::Neighbor { ticks } => neighbor::run_peer(address, *ticks),
        PeerVerb::Timer(task) => timers::run_peer(address, *task),
        PeerVerb::Kill { brief, kills } => replacement::run_peer(address, brief, *kills),
    };
    result.map_or_else(|error| print_error(&format!("{error:#}")), |()| exit::OK)
}
