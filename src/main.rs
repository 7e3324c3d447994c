//! `phalanx`: one binary for every role. What it does is in the crates; here the roles are told
//! apart, the verbs are one file each, and the supervisor learns what the agents know.

use std::io::Write as _;
use std::path::PathBuf;
use std::process::ExitCode;

use clap::{Parser, Subcommand};
use phalanx::verbs;
use protocol::process::{Stderr, exit};
use results::manifest::Build;
use supervisor::spawn::Launcher;

/// Decentralised multi-robot experiments on one machine, run the way they would be deployed.
#[derive(Parser)]
#[command(version)]
struct Cli {
    #[command(subcommand)]
    role: Role,
}

#[derive(Subcommand)]
enum Role {
    #[command(flatten)]
    Supervisor(verbs::Verb),
    /// Measure this machine's baselines, and the ratio of a run to each.
    Bench(bench::cli::BenchArgs),
    /// Run one robot's agent, in a run that is under way.
    Agent(AgentArgs),
    /// Stand in for the hardware of a run that is under way.
    Plant {
        /// The plant's brief.
        brief: PathBuf,
        /// Run before every ordinary process, with all memory locked.
        #[arg(long)]
        realtime_priority: bool,
    },
    /// Take processor time until killed.
    #[command(hide = true)]
    Load,
    /// Keep a core from falling asleep until killed.
    #[command(hide = true)]
    Awake,
    /// Take part in a measurement.
    #[command(hide = true, subcommand)]
    BenchPeer(bench::cli::PeerVerb),
}

#[derive(clap::Args)]
struct AgentArgs {
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
    if let Err(error) = supervisor::child::obey_parent() {
        let _ = writeln!(Stderr, "error: cannot start as a child: {error}");
        return ExitCode::from(exit::INFRASTRUCTURE);
    }
    let code = match Cli::parse().role {
        Role::Supervisor(verb) => {
            let launcher = Launcher::of_this_executable();
            verbs::main(&verb, &agent::catalog(), &launcher, &build())
        }
        Role::Agent(AgentArgs { brief, incarnation, realtime_priority }) => {
            agent::flight::main(&brief, incarnation, realtime_priority)
        }
        Role::Plant { brief, realtime_priority } => plant::flight::main(&brief, realtime_priority),
        Role::Load => supervisor::child::load(),
        Role::Awake => supervisor::child::awake(),
        Role::Bench(args) => bench::cli::main(&args),
        Role::BenchPeer(verb) => bench::cli::peer(&verb),
    };
    ExitCode::from(code)
}

/// How this program was built, as the build script saw it.
fn build() -> Build {
    let known = |word: &str| Some(word.to_owned()).filter(|word| !word.is_empty());
    Build {
        git_hash: known(env!("PHALANX_GIT_HASH")),
        git_dirty: env!("PHALANX_GIT_DIRTY").parse().ok(),
        rustc: known(env!("PHALANX_RUSTC")),
        profile: known(env!("PHALANX_PROFILE")),
    }
}
