//! Dispatch of a process to the role that its command line selects.

use std::env;
use std::ffi::OsString;
use std::io::{self, Write as _};
use std::os::unix::process::CommandExt as _;
use std::process::Command;

use clap::CommandFactory as _;
use clap_complete::Shell;
use outcome::results::manifest::Build;
use protocol::process::{Stderr, exit};
use supervisor::control_timer::{self, ControlTimer};
use supervisor::keeper;
use supervisor::spawn::Launcher;

use crate::command_line::{AgentArgs, CommandLine, Role};
use crate::verbs;

/// File name of the benchmark program, which is installed next to this one.
const BENCH: &str = "phalanx-bench";

/// Runs the role to its end and returns the exit code.
pub fn main(role: Role) -> u8 {
    match role {
        Role::Supervisor(verb) => {
            let launcher = Launcher::for_this_executable();
            verbs::main(&verb, &agent::catalog(), &launcher, &build())
        }
        Role::Agent(AgentArgs { brief, incarnation, realtime_priority }) => {
            agent::control_loop::main(&brief, incarnation, realtime_priority)
        }
        Role::Plant { brief, realtime_priority } => {
            plant::world_loop::main(&brief, realtime_priority)
        }
        Role::Bridge(role) => role.main(),
        Role::Machine { run_root, period_ns, robots, realtime_priority } => {
            control_timer::main(&ControlTimer { run_root, period_ns, robots, realtime_priority })
        }
        Role::Become { folder, pid_file, memory_max_mb, words } => {
            let error = keeper::start(&keeper::Start {
                folder,
                memory_max_mb,
                pid_file,
                command_line: words,
            });
            let _ = writeln!(Stderr, "error: {error}");
            exit::INFRASTRUCTURE
        }
        Role::Keep { parent, first, pid_file } => keeper::keep_program(parent, first, &pid_file),
        Role::Load => supervisor::child::load(),
        Role::Awake => supervisor::child::keep_core_awake(),
        Role::Reap { run_root, logs } => supervisor::orphan_processes::reap(&run_root, &logs),
        Role::Completions { shell } => verbs::print(&completions(shell)),
        Role::Bench { words } => bench(&words),
    }
}

/// Returns the completion script for a shell.
fn completions(shell: Shell) -> String {
    let mut text = Vec::new();
    clap_complete::generate(shell, &mut CommandLine::command(), "phalanx", &mut text);
    String::from_utf8(text).expect("completion scripts are UTF-8")
}

/// Replaces this process by the benchmark program. Returns an exit code only if that fails.
fn bench(words: &[OsString]) -> u8 {
    let path = match env::current_exe() {
        Ok(own) => own.with_file_name(BENCH),
        Err(_) => BENCH.into(),
    };
    let error = Command::new(&path).args(words).exec();
    let hint = match error.kind() {
        io::ErrorKind::NotFound => "; `cargo build --release -p bench` builds it",
        _ => "",
    };
    let _ = writeln!(Stderr, "error: cannot start {}: {error}{hint}", path.display());
    exit::INFRASTRUCTURE
}

/// Returns the build information recorded by the build script.
fn build() -> Build {
    let known = |word: &str| Some(word.to_owned()).filter(|word| !word.is_empty());
    Build {
        git_hash: known(env!("PHALANX_GIT_HASH")),
        git_dirty: env!("PHALANX_GIT_DIRTY").parse().ok(),
        rustc: known(env!("PHALANX_RUSTC")),
        profile: known(env!("PHALANX_PROFILE")),
    }
}
