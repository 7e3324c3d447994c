//! `phalanx-agent`: the agent alone, for a robot that has hardware instead of a plant.

use std::process::ExitCode;

use clap::Parser;
use phalanx::command_line::AgentArgs;

/// Run one robot's agent.
#[derive(Parser)]
#[command(version)]
struct Cli {
    #[command(flatten)]
    agent: AgentArgs,
}

fn main() -> ExitCode {
    // What is refused here, the agent lives without.
    let _ = protocol::process::reset_signals();
    let Cli { agent: AgentArgs { brief, incarnation, realtime_priority } } = Cli::parse();
    ExitCode::from(agent::control_loop::main(&brief, incarnation, realtime_priority))
}
