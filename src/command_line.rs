//! The command line of `phalanx`: every role of its one binary. Documentation, completions and manual
//! pages are made of it too.

use std::ffi::OsString;
use std::path::PathBuf;

use clap::error::{ContextKind, ContextValue, ErrorKind};
use clap::{Args, Parser, Subcommand};
use clap_complete::Shell;
use experiment::scenario::keys::Format;

use crate::verbs::Verb;
use crate::verbs::screen::printed;

/// Decentralised multi-robot experiments on one machine, run the way they would be deployed.
#[derive(Debug, Parser)]
#[command(name = "phalanx", version)]
pub struct CommandLine {
    /// What to do, or to be.
    #[command(subcommand)]
    pub role: Role,
}

impl CommandLine {
    /// That of this process; if it is wrong, says so and ends the process. Keys of a scenario that are given as options are
    /// told how to be set.
    pub fn read() -> CommandLine {
        CommandLine::try_parse().unwrap_or_else(|mut error| {
            // Help and version are results: where they cannot be printed, the program has failed.
            if !error.use_stderr() {
                std::process::exit(i32::from(printed(error.print())));
            }
            if let Some(tip) = how_to_set(&error) {
                error.insert(ContextKind::Suggested, ContextValue::StyledStrs(vec![tip.into()]));
            }
            error.exit()
        })
    }
}

/// How to set the key of a scenario that was given as an option, if one was.
fn how_to_set(error: &clap::Error) -> Option<String> {
    let words: Vec<String> =
        std::env::args_os().map(|word| word.to_string_lossy().into_owned()).collect();
    let sets = ["run", "check"].contains(&words.get(1)?.as_str());
    let unknown = sets && error.kind() == ErrorKind::UnknownArgument;
    let ContextValue::String(option) = error.get(ContextKind::InvalidArg).filter(|_| unknown)?
    else {
        return None;
    };
    let key = Format::new(&agent::catalog()).key_meant_by(option.strip_prefix("--")?)?;
    let at = words.iter().position(|word| word.split('=').next() == Some(option))?;
    let value = match words[at].split_once('=') {
        Some((_, value)) => value,
        None => {
            words.get(at + 1).filter(|word| !word.starts_with("--")).map_or("VALUE", |word| word)
        }
    };
    Some(format!("a key of the scenario is set by '--set {key}={value}'"))
}

/// What this process does, or is.
#[derive(Debug, Subcommand)]
pub enum Role {
    /// A verb.
    #[command(flatten)]
    Supervisor(Verb),
    /// Print what completes this command line in a shell.
    Completions {
        /// The shell.
        shell: Shell,
    },
    /// Measure this machine's baselines, and the ratio of a run to each: the program phalanx-bench.
    // It may not be there.
    #[command(disable_help_flag = true, hide = true)]
    Bench {
        /// Passed on; `--help` lists them.
        #[arg(trailing_var_arg = true, allow_hyphen_values = true, value_name = "ARGUMENTS")]
        words: Vec<OsString>,
    },
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
    /// Carry what crosses between the hosts of a run that is under way.
    #[cfg(feature = "bridge")]
    #[command(hide = true)]
    Bridge {
        /// The bridge's brief.
        brief: PathBuf,
        /// Run before every ordinary process, with all memory locked.
        #[arg(long)]
        realtime_priority: bool,
    },
    /// Show a run that is under way to ROS 2.
    #[cfg(feature = "bridge")]
    #[command(hide = true)]
    Ros2 {
        /// What to show, and where.
        brief: PathBuf,
    },
    /// Wake by the robots' timer and do nothing else, until killed.
    #[command(hide = true)]
    Machine {
        /// The run it belongs to.
        run_root: PathBuf,
        /// The robots' period, ns.
        #[arg(long)]
        period_ns: u64,
        /// How many robots there are.
        #[arg(long)]
        robots: usize,
        /// Run before every ordinary process, with all memory locked.
        #[arg(long)]
        realtime_priority: bool,
    },
    /// Start another program in place of a part of phalanx, and become its keeper.
    #[command(hide = true)]
    Become {
        /// Working directory of the program.
        folder: PathBuf,
        /// File in which the agent or the plant writes its process id.
        #[arg(long)]
        pid_file: PathBuf,
        /// Maximum memory of its own of each process, MB.
        #[arg(long)]
        memory_max_mb: Option<u64>,
        /// The program and its arguments.
        #[arg(last = true, required = true)]
        words: Vec<OsString>,
    },
    /// Keep all processes of a program together, and end as it does.
    #[command(hide = true)]
    Keep {
        /// Process id of the supervisor.
        parent: u32,
        /// Process id of the program.
        first: u32,
        /// File in which the agent or the plant writes its process id.
        pid_file: PathBuf,
    },
    /// Take processor time until killed.
    #[command(hide = true)]
    Load,
    /// End what programs of a run left behind, once its supervisor was killed.
    #[command(hide = true)]
    Reap {
        /// The run.
        run_root: PathBuf,
        /// Where its logs are.
        logs: PathBuf,
    },
    /// Keep a core from falling asleep until killed.
    #[command(hide = true)]
    Awake,
}

/// Arguments of `phalanx agent`.
#[derive(Debug, Args)]
pub struct AgentArgs {
    /// The robot's brief.
    pub brief: PathBuf,
    /// How often this robot's process was started before.
    #[arg(long, default_value_t = 0)]
    pub incarnation: u64,
    /// Run before every ordinary process, with all memory locked.
    #[arg(long)]
    pub realtime_priority: bool,
}
