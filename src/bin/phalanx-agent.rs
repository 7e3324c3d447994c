//! `phalanx-agent`: the agent as a program of its own, for a robot with hardware instead of a plant.

use std::process::ExitCode;

use clap::Parser;
use phalanx::command_line::AgentArgs;

/// Run the agent of one robot.
#[derive(Parser)]
#[command(version)]
struct Cli {
    #[command(flatten)]
    agent: AgentArgs,
}

fn main() -> ExitCode {
    // The agent also works if signals cannot be reset.
    let _ = protocol::process::reset_signals();
    let Cli { agent: AgentArgs { brief, incarnation, realtime_priority } } = Cli::parse();
    ExitCode::from(agent::control_loop::main(&brief, incarnation, realtime_priority))
}
