//! `phalanx-agent`: the agent alone, for a robot that has hardware instead of a plant.

use std::path::PathBuf;
use std::process::ExitCode;

use clap::Parser;

/// Run one robot's agent.
#[derive(Parser)]
#[command(version)]
struct Cli {
    /// The robot's brief.
    brief: PathBuf,
    /// How often this robot's process was started before.
    #[arg(long, default_value_t = 0)]
    incarnation: u64,
    /// Run before every ordinary process, with all memory locked.
    #[arg(long)]
    realtime_priority: bool,
}

fn main() -> ExitCode {
    let Cli { brief, incarnation, realtime_priority } = Cli::parse();
    ExitCode::from(agent::control_loop::main(&brief, incarnation, realtime_priority))
}
