//! Starting of children: the executable, the role of each, and the reason why a start failed.
//!
//! Must not watch or end a child (`child`), or decide what follows on a failure.

use std::ffi::OsString;
use std::fmt;
use std::fs::File;
use std::io::{self, Write as _};
use std::os::unix::process::CommandExt;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};

use crate::addresses::FixedAddressesGuard;
use crate::child::{self, Child, KeeperConfig, PARENT_PID_VARIABLE, RUN_ROOT_VARIABLE};
use crate::limits;
use outcome::results::programs::ProgramCommand;
use protocol::run_root;

/// Starts children: all of the same executable, each in a role of its own. Holds whether robots and plant
/// have real-time priority.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Launcher {
    executable: PathBuf,
    realtime_priority: bool,
    keeps_cores_awake: bool,
    same_addresses: bool,
    run_root: Option<PathBuf>,
}

/// Role of a child. `brief` is its configuration file, `program` replaces the built-in agent or plant, and
/// `arguments` are command-line arguments.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[expect(missing_docs, reason = "the fields are named in the variants' comments")]
pub enum ProcessRole<'a> {
    /// `phalanx agent BRIEF --incarnation N`, or a program in its place. `incarnation` is the number of
    /// earlier starts of this robot's process.
    Agent { brief: &'a Path, program: Option<&'a ProgramCommand>, incarnation: u64 },
    /// `phalanx plant BRIEF`, or a program in its place.
    Plant { brief: &'a Path, program: Option<&'a ProgramCommand> },
    /// `phalanx machine RUN_ROOT --period-ns N --robots N`, with the robots' period.
    ControlTimer { run_root: &'a Path, period_ns: u64, robots: usize },
    /// `phalanx bridge BRIEF`.
    Bridge { brief: &'a Path },
    /// `phalanx ros2 BRIEF`.
    Ros2 { brief: &'a Path },
    /// `phalanx load`.
    Load,
    /// `phalanx awake`.
    KeepCoreAwake,
    /// `phalanx reap RUN_ROOT LOGS`. It outlives this process by a moment, and its only input is that this
    /// process is gone.
    Reaper { run_root: &'a Path, logs: &'a Path },
    /// `phalanx ARGUMENT...`: a run or a peer of a benchmark, for `phalanx bench`.
    Bench { arguments: &'a [OsString] },
    /// The program of a metric, with the directory of the run as its last argument. Its standard output is written to
    /// the new file `output`.
    Metrics { run_dir: &'a Path, program: &'a ProgramCommand, output: &'a Path },
    /// `phalanx run ARGUMENT...`: a run of a campaign.
    Run { arguments: &'a [OsString] },
}

impl<'a> ProcessRole<'a> {
    /// Returns the process name, and the subcommand and the path at the start of the command line.
    fn command_line_start(&self) -> (&'static str, Option<&'static str>, Option<&'a Path>) {
        match *self {
            ProcessRole::Agent { brief, .. } => ("phalanx-agent", Some("agent"), Some(brief)),
            ProcessRole::Plant { brief, .. } => ("phalanx-plant", Some("plant"), Some(brief)),
            ProcessRole::ControlTimer { run_root, .. } => {
                ("phalanx-machine", Some("machine"), Some(run_root))
            }
            ProcessRole::Bridge { brief } => ("phalanx-bridge", Some("bridge"), Some(brief)),
            ProcessRole::Ros2 { brief } => ("phalanx-ros2", Some("ros2"), Some(brief)),
            ProcessRole::Load => ("phalanx-load", Some("load"), None),
            ProcessRole::KeepCoreAwake => ("phalanx-awake", Some("awake"), None),
            ProcessRole::Reaper { run_root, .. } => {
                ("phalanx-reaper", Some("reap"), Some(run_root))
            }
            ProcessRole::Bench { .. } => ("phalanx-bench", None, None),
            ProcessRole::Run { .. } => ("phalanx", None, None),
            ProcessRole::Metrics { run_dir, .. } => ("phalanx-metrics", None, Some(run_dir)),
        }
    }
}

impl fmt::Display for ProcessRole<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            ProcessRole::Agent { brief, .. } => {
                write!(f, "robot {}", brief.file_stem().unwrap_or_default().display())
            }
            ProcessRole::Plant { .. } => f.write_str("the plant"),
            ProcessRole::ControlTimer { .. } => f.write_str("the control timer"),
            ProcessRole::Bridge { .. } => f.write_str("the bridge"),
            ProcessRole::Ros2 { .. } => f.write_str("the process for ROS 2"),
            ProcessRole::Load => f.write_str("a process that takes processor time"),
            ProcessRole::KeepCoreAwake => f.write_str("a process that keeps a core awake"),
            ProcessRole::Reaper { .. } => {
                f.write_str("the process that ends what programs leave behind")
            }
            ProcessRole::Run { .. } => f.write_str("a run"),
            ProcessRole::Metrics { .. } => f.write_str("the program of a metric"),
            ProcessRole::Bench { arguments } => {
                let arguments =
                    arguments.iter().take(2).map(|argument| format!(" {}", argument.display()));
                write!(f, "`phalanx{}`", arguments.collect::<String>())
            }
        }
    }
}

/// Failure to start a process or a thread of the run.
#[derive(Debug, thiserror::Error)]
#[error("cannot start {process}: {reason}")]
pub struct SpawnError {
    process: String,
    reason: String,
    source: io::Error,
}

impl SpawnError {
    /// Returns the error for a system on which the processes of a program cannot be found.
    pub(crate) fn unsupported_programs() -> SpawnError {
        let reason = "the processes that they start could not be killed or frozen with them, because /proc does not show the \
                   processes of this user, or a process may not become a subreaper (prctl); mount /proc without hidepid, \
                   or use laws that are built in";
        let source = io::Error::other(reason);
        SpawnError { process: "programs of the scenario".into(), reason: reason.into(), source }
    }

    /// Returns the error for a thread `thread_name` that could not be started.
    pub(crate) fn from_thread_error(thread_name: &str, source: io::Error) -> SpawnError {
        SpawnError { process: thread_name.into(), reason: limits::explain_refusal(&source), source }
    }
}

impl Launcher {
    /// Creates a launcher of this executable, even if its file has been replaced meanwhile.
    pub fn for_this_executable() -> Launcher {
        Launcher::new("/proc/self/exe")
    }

    /// Creates a launcher of another executable, given by a path that contains a slash. Its `main` must
    /// begin with [`crate::child::prepare_process`] and accept the command lines of [`ProcessRole`], like `phalanx`.
    pub fn new(executable: impl Into<PathBuf>) -> Launcher {
        Launcher {
            executable: executable.into(),
            realtime_priority: false,
            keeps_cores_awake: true,
            same_addresses: false,
            run_root: None,
        }
    }

    /// Runs robots, plant and control process with real-time priority.
    pub fn with_realtime_priority(self) -> Launcher {
        Launcher { realtime_priority: true, ..self }
    }

    /// Keeps no core awake, because other runs execute concurrently.
    pub fn without_awake_cores(self) -> Launcher {
        Launcher { keeps_cores_awake: false, ..self }
    }

    /// Gives robots with the built-in agent a fixed address-space layout, which is faster in lockstep.
    pub(crate) fn with_same_addresses(self) -> Launcher {
        Launcher { same_addresses: true, ..self }
    }

    /// Marks all started processes, and their children, as belonging to the run of this run root.
    pub(crate) fn with_run_root(self, run_root: &Path) -> Launcher {
        Launcher { run_root: Some(run_root.into()), ..self }
    }

    /// Returns whether cores are kept awake.
    pub(crate) fn keeps_cores_awake(&self) -> bool {
        self.keeps_cores_awake
    }

    /// Starts a process in this role, with its output appended to `log`. The calling thread must outlive
    /// the run, because the child dies with that thread.
    pub fn spawn(&self, role: ProcessRole<'_>, log: &Path) -> Result<Child, SpawnError> {
        let log_error = |source: io::Error| {
            let reason = format!(
                "its log {} cannot be opened: {}",
                log.display(),
                limits::explain_refusal(&source)
            );
            SpawnError { process: role.to_string(), reason, source }
        };
        let spawn_error = |source: io::Error| SpawnError {
            process: role.to_string(),
            reason: self.explain_failure(&source),
            source,
        };
        let log_file = File::options().create(true).append(true).open(log).map_err(log_error)?;
        if let ProcessRole::Agent { incarnation: incarnation @ 1.., .. } = role {
            let line = child::replacement_line(incarnation);
            (&log_file).write_all(line.as_bytes()).map_err(log_error)?;
        }
        let mut command = Command::new(&self.executable);
        let (name, subcommand, brief) = role.command_line_start();
        command.arg0(name);
        let mut keeper_config = None;
        match role {
            ProcessRole::Agent { program: Some(program), .. }
            | ProcessRole::Plant { program: Some(program), .. }
            | ProcessRole::Metrics { program, .. } => {
                let config = self.keeper_config(&role, program);
                add_keeper_arguments(&mut command, program, &config);
                keeper_config = Some(config);
            }
            _ => drop(command.args(subcommand)),
        }
        command.args(brief);
        match role {
            ProcessRole::Agent { incarnation, .. } => {
                command.arg("--incarnation").arg(incarnation.to_string());
            }
            ProcessRole::ControlTimer { period_ns, robots, .. } => {
                command.arg("--period-ns").arg(period_ns.to_string());
                command.arg("--robots").arg(robots.to_string());
            }
            ProcessRole::Reaper { logs, .. } => drop(command.arg(logs)),
            ProcessRole::Bench { arguments } | ProcessRole::Run { arguments } => {
                command.args(arguments);
            }
            _ => {}
        }
        if self.realtime_priority
            && matches!(
                role,
                ProcessRole::Agent { .. }
                    | ProcessRole::Plant { .. }
                    | ProcessRole::Bridge { .. }
                    | ProcessRole::ControlTimer { .. }
            )
        {
            command.arg("--realtime-priority");
        }
        command
            .stdin(Stdio::null())
            .stdout(log_file.try_clone().map_err(spawn_error)?)
            .stderr(log_file)
            .process_group(0); // a Ctrl-C on the terminal is the supervisor's alone
        // Nothing may run between fork and exec: with `pre_exec`, the start would copy the page tables of
        // this process, whose shared memory grows with the robots, once for each robot.
        command.env(PARENT_PID_VARIABLE, std::process::id().to_string());
        command.envs(self.run_root.iter().map(|run_root| (RUN_ROOT_VARIABLE, run_root)));
        if let ProcessRole::Metrics { output, .. } = role {
            command.stdout(File::create_new(output).map_err(spawn_error)?);
        }
        if let ProcessRole::Reaper { .. } = role {
            command
                .env_remove(PARENT_PID_VARIABLE)
                .env_remove(RUN_ROOT_VARIABLE)
                .stdin(Stdio::piped());
        }
        // Never for a program of the scenario, which may process untrusted input.
        let is_builtin_agent = matches!(role, ProcessRole::Agent { program: None, .. });
        let address_guard =
            (self.same_addresses && is_builtin_agent).then(FixedAddressesGuard::for_children);
        let process = command.spawn().map_err(spawn_error)?;
        drop(address_guard);
        let child = Child::watch(process, log).map_err(|source| {
            let reason =
                format!("it cannot be watched (pidfd_open): {}", limits::explain_refusal(&source));
            SpawnError { process: role.to_string(), reason, source }
        })?;
        Ok(child.with_keeper(keeper_config))
    }

    /// Returns the configuration of a program's keeper.
    fn keeper_config(&self, role: &ProcessRole<'_>, program: &ProgramCommand) -> KeeperConfig {
        let name = match role {
            ProcessRole::Agent { brief, .. } => brief.file_stem(),
            ProcessRole::Metrics { output, .. } => output.file_stem(),
            _ => None,
        };
        let name = name.map_or("plant".into(), |name| name.to_string_lossy());
        let root = self.run_root.as_deref().unwrap_or(Path::new("/"));
        let pid_file = run_root::pid_path(root, &name);
        KeeperConfig { pid_file, memory_max_mb: program.memory_max_mb }
    }

    /// Returns the reason why the process was not started.
    fn explain_failure(&self, error: &io::Error) -> String {
        let path = self.executable.display();
        match error.raw_os_error() {
            Some(libc::ENOENT) => format!("the executable {path} does not exist"),
            Some(libc::EACCES | libc::EPERM) => format!(
                "{path} may not be executed ({error}): check its mode, and whether its file \
                 system is mounted noexec"
            ),
            Some(libc::ENOEXEC) => format!("{path} is no executable for this machine ({error})"),
            _ => limits::explain_refusal(error),
        }
    }
}

/// Adds the arguments by which this executable starts a program and becomes its keeper.
fn add_keeper_arguments(command: &mut Command, program: &ProgramCommand, config: &KeeperConfig) {
    command.arg("become").arg(&program.folder).arg("--pid-file").arg(&config.pid_file);
    if let Some(mb) = program.memory_max_mb {
        command.arg("--memory-max-mb").arg(mb.to_string());
    }
    command.arg("--").args(&program.command_line);
}

#[cfg(test)]
mod tests {
    use super::*;

    fn spawn_refusal_text(executable: &Path, role: ProcessRole<'_>) -> String {
        let log = Path::new("/dev/null");
        Launcher::new(executable).spawn(role, log).unwrap_err().to_string()
    }

    #[test]
    fn spawn_error_names_the_executable_or_log_and_the_reason() {
        let brief = Path::new("/runs/x/briefs/r2.toml");
        let agent = ProcessRole::Agent { brief, program: None, incarnation: 0 };
        assert_eq!(
            spawn_refusal_text(Path::new("/no/such/phalanx"), agent),
            "cannot start robot r2: the executable /no/such/phalanx does not exist"
        );
        let text = spawn_refusal_text(
            Path::new("/etc/passwd"),
            ProcessRole::Plant { brief, program: None },
        );
        assert!(text.starts_with("cannot start the plant: /etc/passwd may not be exec"), "{text}");
        let log = Path::new("/no/such/folder/awake.jsonl");
        let error = Launcher::for_this_executable()
            .spawn(ProcessRole::KeepCoreAwake, log)
            .unwrap_err()
            .to_string();
        assert!(error.contains("keeps a core awake: its log /no/such/folder/awake.j"), "{error}");
    }
}
