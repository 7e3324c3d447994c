//! Dispatch of a process to the role that its command line selects.

use std::env;
use std::ffi::OsString;
use std::io::{self, Write as _};
use std::os::unix::process::CommandExt as _;
use std::process::Command;

use agent::controller::Parts;
use agent::laws::LawRow;
use clap::CommandFactory as _;
use clap_complete::Shell;
use outcome::results::manifest::BuildInfo;
use protocol::process::{Stderr, exit};
use supervisor::control_timer::{self, ControlTimerArguments};
use supervisor::keeper;
use supervisor::spawn::Launcher;

use crate::command_line::{AgentArgs, CommandLine, Role};
use crate::verbs;

/// File name of the benchmark program, which is installed next to this one.
const BENCH_PROGRAM: &str = "phalanx-bench";

/// Runs the role to its end and returns the exit code.
pub fn main(role: Role) -> u8 {
    main_with_laws(role, &[])
}

/// Runs the role like [`main`], for a program with control laws in addition to the built-in ones. Runs within one
/// process know the built-in ones only.
pub fn main_with_laws(role: Role, added: &[LawRow]) -> u8 {
    match role {
        Role::Supervisor(verb) => {
            let launcher = Launcher::for_this_executable();
            let catalog = agent::catalog_with_laws(added);
            verbs::main(&verb, &catalog, &launcher, &build_information())
        }
        Role::Agent(AgentArgs { brief, incarnation, realtime_priority }) => {
            agent::control_loop::main_with_parts(&brief, incarnation, realtime_priority, |brief| {
                Parts::from_brief_with_laws(brief, added)
            })
        }
        Role::Plant { brief, realtime_priority } => {
            plant::world_loop::main(&brief, realtime_priority)
        }
        Role::Bridge(role) => role.main(),
        Role::Machine { run_root, period_ns, robots, realtime_priority } => {
            control_timer::main(&ControlTimerArguments {
                run_root,
                period_ns,
                robots,
                realtime_priority,
            })
        }
        Role::Become { folder, pid_file, memory_max_mb, words } => {
            let error = keeper::start_program(&keeper::ProgramStart {
                folder,
                memory_max_mb,
                pid_file,
                command_line: words,
            });
            let _ = writeln!(Stderr, "error: {error}");
            exit::INFRASTRUCTURE_FAILURE
        }
        Role::Keep { parent, first, pid_file } => {
            keeper::supervise_program(parent, first, &pid_file)
        }
        Role::Load => supervisor::child::consume_processor_time(),
        Role::Awake => supervisor::child::keep_core_awake(),
        Role::Reap { run_root, logs } => supervisor::orphan_processes::run_reaper(&run_root, &logs),
        Role::Completions { shell } => verbs::print(&completion_script(shell)),
        Role::Bench { words: arguments } => execute_bench(&arguments),
    }
}

/// Returns the completion script for a shell.
fn completion_script(shell: Shell) -> String {
    let mut text = Vec::new();
    clap_complete::generate(shell, &mut CommandLine::command(), "phalanx", &mut text);
    String::from_utf8(text).expect("completion scripts are UTF-8")
}

/// Replaces this process by the benchmark program. Returns an exit code only if that fails.
fn execute_bench(arguments: &[OsString]) -> u8 {
    let path = match env::current_exe() {
        Ok(executable) => executable.with_file_name(BENCH_PROGRAM),
        Err(_) => BENCH_PROGRAM.into(),
    };
    let error = Command::new(&path).args(arguments).exec();
    let hint = match error.kind() {
        io::ErrorKind::NotFound => "; `cargo build --release -p bench` builds it",
        _ => "",
    };
    let _ = writeln!(Stderr, "error: cannot start {}: {error}{hint}", path.display());
    exit::INFRASTRUCTURE_FAILURE
}

/// Returns the build information recorded by the build script.
fn build_information() -> BuildInfo {
    let non_empty = |text: &str| Some(text.to_owned()).filter(|text| !text.is_empty());
    BuildInfo {
        git_hash: non_empty(env!("PHALANX_GIT_HASH")),
        git_dirty: env!("PHALANX_GIT_DIRTY").parse().ok(),
        rustc: non_empty(env!("PHALANX_RUSTC")),
        profile: non_empty(env!("PHALANX_PROFILE")),
    }
}
