//! Command-line definition of `phalanx`: one binary with a subcommand for each process role. Reference
//! page, shell completions and manual pages are generated from it.

use std::ffi::OsString;
use std::path::PathBuf;

use clap::error::{ContextKind, ContextValue, ErrorKind};
use clap::{Args, Parser, Subcommand};
use clap_complete::Shell;
use experiment::scenario::keys::FileFormat;

use crate::verbs::Verb;
use crate::verbs::screen::exit_code_of_print;
use crate::verbs::with_bridge::BridgeRole;

/// Decentralized multi-robot experiments on one machine, run the way they would be deployed.
#[derive(Debug, Parser)]
#[command(name = "phalanx", version)]
pub struct CommandLine {
    /// Selected subcommand.
    #[command(subcommand)]
    pub role: Role,
}

impl CommandLine {
    /// Parses the arguments of this process. On an error, prints it and exits; if a scenario key was given
    /// as an option, the message suggests `--set`.
    pub fn read() -> CommandLine {
        CommandLine::try_parse().unwrap_or_else(|mut error| {
            // Help and version are results: the program has failed if they cannot be printed.
            if !error.use_stderr() {
                std::process::exit(i32::from(exit_code_of_print(error.print())));
            }
            if let Some(tip) = suggest_set_option(&error) {
                error.insert(ContextKind::Suggested, ContextValue::StyledStrs(vec![tip.into()]));
            }
            error.exit()
        })
    }
}

/// Returns a hint to use `--set` if the unknown option of `run` or `check` names a scenario key.
fn suggest_set_option(error: &clap::Error) -> Option<String> {
    let arguments: Vec<String> =
        std::env::args_os().map(|argument| argument.to_string_lossy().into_owned()).collect();
    let accepts_set_option = ["run", "check"].contains(&arguments.get(1)?.as_str());
    let is_unknown_argument = accepts_set_option && error.kind() == ErrorKind::UnknownArgument;
    let ContextValue::String(option) =
        error.get(ContextKind::InvalidArg).filter(|_| is_unknown_argument)?
    else {
        return None;
    };
    let key = FileFormat::new(&agent::catalog()).key_meant_by(option.strip_prefix("--")?)?;
    let index = arguments.iter().position(|argument| argument.split('=').next() == Some(option))?;
    let value = match arguments[index].split_once('=') {
        Some((_, value)) => value,
        None => arguments
            .get(index + 1)
            .filter(|argument| !argument.starts_with("--"))
            .map_or("VALUE", |argument| argument),
    };
    Some(format!("to set a scenario key, use '--set {key}={value}'"))
}

/// Role of this process.
#[derive(Debug, Subcommand)]
pub enum Role {
    /// User-facing subcommand.
    #[command(flatten)]
    Supervisor(Verb),
    /// Generate a shell completion script.
    Completions {
        /// Shell to generate the script for.
        shell: Shell,
    },
    /// Measure the machine's baselines and the ratio of a run to each (starts phalanx-bench).
    // Hidden: phalanx-bench may not be installed.
    #[command(disable_help_flag = true, hide = true)]
    Bench {
        /// Arguments passed to phalanx-bench; `--help` lists them.
        #[arg(trailing_var_arg = true, allow_hyphen_values = true, value_name = "ARGUMENTS")]
        words: Vec<OsString>,
    },
    /// Run the agent of one robot in a run that is in progress.
    Agent(AgentArgs),
    /// Run the simulated plant of a run that is in progress.
    Plant {
        /// Configuration file (brief) of the plant.
        brief: PathBuf,
        /// Run with SCHED_FIFO priority and locked memory.
        #[arg(long)]
        realtime_priority: bool,
    },
    /// Role that needs the feature `bridge`.
    #[command(flatten)]
    Bridge(BridgeRole),
    /// Run the control process: wait on the robots' timer only, until killed.
    #[command(hide = true)]
    Machine {
        /// Directory of the run's shared files (run root).
        run_root: PathBuf,
        /// Period of the robots, ns.
        #[arg(long)]
        period_ns: u64,
        /// Number of robots.
        #[arg(long)]
        robots: usize,
        /// Run with SCHED_FIFO priority and locked memory.
        #[arg(long)]
        realtime_priority: bool,
    },
    /// Start a program that replaces a part of phalanx, and become its keeper process.
    #[command(hide = true)]
    Become {
        /// Working directory of the program.
        folder: PathBuf,
        /// File in which the agent or the plant writes its process ID.
        #[arg(long)]
        pid_file: PathBuf,
        /// Maximum private memory of each process, MB.
        #[arg(long)]
        memory_max_mb: Option<u64>,
        /// The program and its arguments.
        #[arg(last = true, required = true)]
        words: Vec<OsString>,
    },
    /// Keep all processes of a program together, and exit with the program's status.
    #[command(hide = true)]
    Keep {
        /// Process ID of the supervisor.
        parent: u32,
        /// Process ID of the program.
        first: u32,
        /// File in which the agent or the plant writes its process ID.
        pid_file: PathBuf,
    },
    /// Consume processor time until killed (load fault).
    #[command(hide = true)]
    Load,
    /// Kill the orphan processes of a run's programs after its supervisor was killed.
    #[command(hide = true)]
    Reap {
        /// Directory of the run's shared files (run root).
        run_root: PathBuf,
        /// Directory of the run's logs.
        logs: PathBuf,
    },
    /// Keep a core out of idle states until killed.
    #[command(hide = true)]
    Awake,
}

/// Arguments of `phalanx agent`.
#[derive(Debug, Args)]
pub struct AgentArgs {
    /// Configuration file (brief) of the robot.
    pub brief: PathBuf,
    /// Incarnation number: how many times this robot's process was started before.
    #[arg(long, default_value_t = 0)]
    pub incarnation: u64,
    /// Run with SCHED_FIFO priority and locked memory.
    #[arg(long)]
    pub realtime_priority: bool,
}
