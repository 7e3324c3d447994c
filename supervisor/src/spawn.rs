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

use crate::addresses::SameAddresses;
use crate::child::{self, Child, KeptProgram, PARENT, RUN};
use crate::limits;
use outcome::results::programs::ProgramCommand;
use protocol::run_root;

/// Starts children: all of the same executable, each in a role of its own. Holds whether robots and plant
/// have real-time priority.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Launcher {
    executable: PathBuf,
    realtime_priority: bool,
    keeps_awake: bool,
    same_addresses: bool,
    run_root: Option<PathBuf>,
}

/// Role of a child. `brief` is its configuration file, `program` replaces the built-in agent or plant, and
/// `words` are command-line arguments.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[expect(missing_docs, reason = "the fields are named in the variants' comments")]
pub enum Role<'a> {
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
    Awake,
    /// `phalanx reap RUN_ROOT LOGS`. It outlives this process by a moment, and its only input is that this
    /// process is gone.
    Reaper { run_root: &'a Path, logs: &'a Path },
    /// `phalanx WORD...`: a run or a peer of a benchmark, for `phalanx bench`.
    Bench { words: &'a [OsString] },
    /// `phalanx run WORD...`: a run of a campaign.
    Run { words: &'a [OsString] },
}

impl fmt::Display for Role<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Role::Agent { brief, .. } => {
                write!(f, "robot {}", brief.file_stem().unwrap_or_default().display())
            }
            Role::Plant { .. } => f.write_str("the plant"),
            Role::ControlTimer { .. } => f.write_str("the control timer"),
            Role::Bridge { .. } => f.write_str("the bridge"),
            Role::Ros2 { .. } => f.write_str("the process for ROS 2"),
            Role::Load => f.write_str("a process that takes processor time"),
            Role::Awake => f.write_str("a process that keeps a core awake"),
            Role::Reaper { .. } => f.write_str("the process that ends what programs leave behind"),
            Role::Run { .. } => f.write_str("a run"),
            Role::Bench { words } => {
                let words = words.iter().take(2).map(|word| format!(" {}", word.display()));
                write!(f, "`phalanx{}`", words.collect::<String>())
            }
        }
    }
}

/// Failure to start a process or a thread of the run.
#[derive(Debug, thiserror::Error)]
#[error("cannot start {process}: {why}")]
pub struct SpawnError {
    process: String,
    why: String,
    source: io::Error,
}

impl SpawnError {
    /// Returns the error for a system on which the processes of a program cannot be found.
    pub(crate) fn unsupported_programs() -> SpawnError {
        let why = "the processes that they start could not be killed or frozen with them, because /proc does not show the \
                   processes of this user, or a process may not become a subreaper (prctl); mount /proc without hidepid, \
                   or use laws that are built in";
        let source = io::Error::other(why);
        SpawnError { process: "programs of the scenario".into(), why: why.into(), source }
    }

    /// Returns the error for a thread `what` that could not be started.
    pub(crate) fn from_thread_error(what: &str, source: io::Error) -> SpawnError {
        SpawnError { process: what.into(), why: limits::explain(&source), source }
    }
}

impl Launcher {
    /// Creates a launcher of this executable, even if its file has been replaced meanwhile.
    pub fn for_this_executable() -> Launcher {
        Launcher::new("/proc/self/exe")
    }

    /// Creates a launcher of another executable, given by a path that contains a slash. Its `main` must
    /// begin with [`crate::child::obey_parent`] and accept the command lines of [`Role`], like `phalanx`.
    pub fn new(executable: impl Into<PathBuf>) -> Launcher {
        Launcher {
            executable: executable.into(),
            realtime_priority: false,
            keeps_awake: true,
            same_addresses: false,
            run_root: None,
        }
    }

    /// Runs robots, plant and control process with real-time priority.
    pub fn with_realtime_priority(self) -> Launcher {
        Launcher { realtime_priority: true, ..self }
    }

    /// Keeps no core awake, because other runs execute concurrently.
    pub fn without_awake(self) -> Launcher {
        Launcher { keeps_awake: false, ..self }
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
    pub(crate) fn keeps_awake(&self) -> bool {
        self.keeps_awake
    }

    /// Starts a process in this role, with its output appended to `log`. The calling thread must outlive
    /// the run, because the child dies with that thread.
    pub fn spawn(&self, role: Role<'_>, log: &Path) -> Result<Child, SpawnError> {
        let unlogged = |source: io::Error| {
            let why =
                format!("its log {} cannot be opened: {}", log.display(), limits::explain(&source));
            SpawnError { process: role.to_string(), why, source }
        };
        let refused = |source: io::Error| SpawnError {
            process: role.to_string(),
            why: self.explain_failure(&source),
            source,
        };
        let out = File::options().create(true).append(true).open(log).map_err(unlogged)?;
        if let Role::Agent { incarnation: incarnation @ 1.., .. } = role {
            let line = child::replacement_line(incarnation);
            (&out).write_all(line.as_bytes()).map_err(unlogged)?;
        }
        let mut command = Command::new(&self.executable);
        let (name, verb, brief) = match role {
            Role::Agent { brief, .. } => ("phalanx-agent", Some("agent"), Some(brief)),
            Role::Plant { brief, .. } => ("phalanx-plant", Some("plant"), Some(brief)),
            Role::ControlTimer { run_root, .. } => {
                ("phalanx-machine", Some("machine"), Some(run_root))
            }
            Role::Bridge { brief } => ("phalanx-bridge", Some("bridge"), Some(brief)),
            Role::Ros2 { brief } => ("phalanx-ros2", Some("ros2"), Some(brief)),
            Role::Load => ("phalanx-load", Some("load"), None),
            Role::Awake => ("phalanx-awake", Some("awake"), None),
            Role::Reaper { run_root, .. } => ("phalanx-reaper", Some("reap"), Some(run_root)),
            Role::Bench { .. } => ("phalanx-bench", None, None),
            Role::Run { .. } => ("phalanx", None, None),
        };
        command.arg0(name);
        let mut keeps = None;
        match role {
            Role::Agent { program: Some(program), .. }
            | Role::Plant { program: Some(program), .. } => {
                let kept = self.keeper_config(&role, program);
                become_program(&mut command, program, &kept);
                keeps = Some(kept);
            }
            _ => drop(command.args(verb)),
        }
        command.args(brief);
        match role {
            Role::Agent { incarnation, .. } => {
                command.arg("--incarnation").arg(incarnation.to_string());
            }
            Role::ControlTimer { period_ns, robots, .. } => {
                command.arg("--period-ns").arg(period_ns.to_string());
                command.arg("--robots").arg(robots.to_string());
            }
            Role::Reaper { logs, .. } => drop(command.arg(logs)),
            Role::Bench { words } | Role::Run { words } => drop(command.args(words)),
            _ => {}
        }
        if self.realtime_priority
            && matches!(
                role,
                Role::Agent { .. }
                    | Role::Plant { .. }
                    | Role::Bridge { .. }
                    | Role::ControlTimer { .. }
            )
        {
            command.arg("--realtime-priority");
        }
        command
            .stdin(Stdio::null())
            .stdout(out.try_clone().map_err(refused)?)
            .stderr(out)
            .process_group(0); // a Ctrl-C on the terminal is the supervisor's alone
        // Nothing may run between fork and exec: with `pre_exec`, the start would copy the page tables of
        // this process, whose shared memory grows with the robots, once for each robot.
        command.env(PARENT, std::process::id().to_string());
        command.envs(self.run_root.iter().map(|run_root| (RUN, run_root)));
        if let Role::Reaper { .. } = role {
            command.env_remove(PARENT).env_remove(RUN).stdin(Stdio::piped());
        }
        // Never for a program of the scenario, which may process untrusted input.
        let own_agent = matches!(role, Role::Agent { program: None, .. });
        let same = (self.same_addresses && own_agent).then(SameAddresses::for_children);
        let process = command.spawn().map_err(refused)?;
        drop(same);
        let watched = Child::watch(process, log).map_err(|source| {
            let why = format!("it cannot be watched (pidfd_open): {}", limits::explain(&source));
            SpawnError { process: role.to_string(), why, source }
        })?;
        Ok(watched.with_keeper(keeps))
    }

    /// Returns the configuration of a program's keeper.
    fn keeper_config(&self, role: &Role<'_>, program: &ProgramCommand) -> KeptProgram {
        let name = match role {
            Role::Agent { brief, .. } => brief.file_stem(),
            _ => None,
        };
        let name = name.map_or("plant".into(), |name| name.to_string_lossy());
        let root = self.run_root.as_deref().unwrap_or(Path::new("/"));
        let pid_file = run_root::pid_path(root, &name);
        KeptProgram { pid_file, memory_max_mb: program.memory_max_mb }
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
            _ => limits::explain(error),
        }
    }
}

/// Adds the arguments by which this executable starts a program and becomes its keeper.
fn become_program(command: &mut Command, program: &ProgramCommand, kept: &KeptProgram) {
    command.arg("become").arg(&program.folder).arg("--pid-file").arg(&kept.pid_file);
    if let Some(mb) = program.memory_max_mb {
        command.arg("--memory-max-mb").arg(mb.to_string());
    }
    command.arg("--").args(&program.command_line);
}

#[cfg(test)]
mod tests {
    use super::*;

    fn spawn_refusal_text(executable: &Path, role: Role<'_>) -> String {
        let log = Path::new("/dev/null");
        Launcher::new(executable).spawn(role, log).unwrap_err().to_string()
    }

    #[test]
    fn spawn_error_names_the_executable_or_log_and_the_reason() {
        let brief = Path::new("/runs/x/briefs/r2.toml");
        let agent = Role::Agent { brief, program: None, incarnation: 0 };
        assert_eq!(
            spawn_refusal_text(Path::new("/no/such/phalanx"), agent),
            "cannot start robot r2: the executable /no/such/phalanx does not exist"
        );
        let text =
            spawn_refusal_text(Path::new("/etc/passwd"), Role::Plant { brief, program: None });
        assert!(text.starts_with("cannot start the plant: /etc/passwd may not be exec"), "{text}");
        let log = Path::new("/no/such/folder/awake.jsonl");
        let error =
            Launcher::for_this_executable().spawn(Role::Awake, log).unwrap_err().to_string();
        assert!(error.contains("keeps a core awake: its log /no/such/folder/awake.j"), "{error}");
    }
}
