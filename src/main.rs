//! `phalanx`: one binary for every role. What it does is in the crates; here the roles are told
//! apart, the verbs are one file each, and the supervisor learns what the agents know.

use std::io::Write as _;
use std::process::ExitCode;

use clap::Parser as _;
use phalanx::command_line::{AgentArgs, CommandLine, Role};
use phalanx::verbs;
use protocol::process::{Stderr, exit};
use results::manifest::Build;
use supervisor::control_timer::{self, ControlTimer};
use supervisor::spawn::Launcher;

fn main() -> ExitCode {
    if let Err(error) = supervisor::child::obey_parent() {
        let _ = writeln!(Stderr, "error: cannot start as a child: {error}");
        return ExitCode::from(exit::INFRASTRUCTURE);
    }
    let code = match CommandLine::parse().role {
        Role::Supervisor(verb) => {
            let launcher = Launcher::of_this_executable();
            verbs::main(&verb, &agent::catalog(), &launcher, &build())
        }
        Role::Agent(AgentArgs { brief, incarnation, realtime_priority }) => {
            agent::flight::main(&brief, incarnation, realtime_priority)
        }
        Role::Plant { brief, realtime_priority } => plant::flight::main(&brief, realtime_priority),
        Role::Machine { run_root, period_ns, robots, realtime_priority } => {
            control_timer::main(&ControlTimer { run_root, period_ns, robots, realtime_priority })
        }
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
