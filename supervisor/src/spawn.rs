//! Which executable the children are, in which role each is started, and why one could not be.
//!
//! Must not: watch or end a child (`child`), or decide what follows on a failure.

use std::ffi::OsString;
use std::fmt;
use std::fs::File;
use std::io;
use std::os::unix::process::CommandExt;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};

use crate::addresses::SameAddresses;
use crate::child::{Child, PARENT};
use crate::limits;
use outcome::results::programs::Started;

/// Starts children: which executable all of them are, each in a role of its own, and whether robots
/// and plant have priority.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Launcher {
    executable: PathBuf,
    realtime_priority: bool,
    keeps_awake: bool,
    same_addresses: bool,
}

/// What a child is to be.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Role<'a> {
    /// `phalanx agent BRIEF --incarnation N`, or a program in its place.
    Agent {
        /// Its brief.
        brief: &'a Path,
        /// What takes the place of `phalanx agent`.
        program: Option<&'a Started>,
        /// How often this robot's process was started before.
        incarnation: u64,
    },
    /// `phalanx plant BRIEF`, or a program in its place.
    Plant {
        /// Its brief.
        brief: &'a Path,
        /// What takes the place of `phalanx plant`.
        program: Option<&'a Started>,
    },
    /// `phalanx machine RUN_ROOT --period-ns N --robots N`.
    ControlTimer {
        /// The run it belongs to.
        run_root: &'a Path,
        /// The robots' period, ns.
        period_ns: u64,
        /// How many robots there are.
        robots: usize,
    },
    /// `phalanx bridge BRIEF`.
    Bridge {
        /// Its brief.
        brief: &'a Path,
    },
    /// `phalanx ros2 BRIEF`.
    Ros2 {
        /// Its brief.
        brief: &'a Path,
    },
    /// `phalanx load`.
    Load,
    /// `phalanx awake`.
    Awake,
    /// `phalanx WORD...`: a run, or a peer in a measurement, of `phalanx bench`.
    Bench {
        /// The command line.
        words: &'a [OsString],
    },
    /// `phalanx run WORD...`: a run of a campaign.
    Run {
        /// The command line.
        words: &'a [OsString],
    },
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
            Role::Run { .. } => f.write_str("a run"),
            Role::Bench { words } => {
                let words: Vec<_> = words.iter().take(2).map(|word| word.display()).collect();
                write!(f, "`phalanx")?;
                words.iter().try_for_each(|word| write!(f, " {word}"))?;
                write!(f, "`")
            }
        }
    }
}

/// Why a process or a thread of the run could not be started.
#[derive(Debug, thiserror::Error)]
#[error("cannot start {what}: {why}")]
pub struct SpawnError {
    what: String,
    why: String,
    source: io::Error,
}

impl SpawnError {
    /// A thread that is called `what` was refused.
    pub(crate) fn of_thread(what: &str, source: io::Error) -> SpawnError {
        SpawnError { what: what.into(), why: limits::why(&source), source }
    }
}

impl Launcher {
    /// Of this very executable, even if its file was replaced meanwhile.
    pub fn of_this_executable() -> Launcher {
        Launcher::of("/proc/self/exe")
    }

    /// Of another one, by a path with a slash in it. Its `main` begins with
    /// [`crate::child::obey_parent`] and takes the command lines of [`Role`], as `phalanx` does.
    pub fn of(executable: impl Into<PathBuf>) -> Launcher {
        Launcher {
            executable: executable.into(),
            realtime_priority: false,
            keeps_awake: true,
            same_addresses: false,
        }
    }

    /// Robots, plant and control timer run before every ordinary process of the machine.
    pub fn with_realtime_priority(self) -> Launcher {
        Launcher { realtime_priority: true, ..self }
    }

    /// No core is kept awake: others run beside this run.
    pub fn without_awake(self) -> Launcher {
        Launcher { keeps_awake: false, ..self }
    }

    /// Robots that are our own agent have the same addresses, not random ones: faster in lockstep.
    pub(crate) fn with_same_addresses(self) -> Launcher {
        Launcher { same_addresses: true, ..self }
    }

    /// Whether cores are kept awake.
    pub(crate) fn keeps_awake(&self) -> bool {
        self.keeps_awake
    }

    /// Starts a process in this role, its log appended to `log`. The calling thread must live as
    /// long as the run: the child dies with it.
    pub fn spawn(&self, role: Role<'_>, log: &Path) -> Result<Child, SpawnError> {
        let unlogged = |source: io::Error| {
            let why =
                format!("its log {} cannot be opened: {}", log.display(), limits::why(&source));
            SpawnError { what: role.to_string(), why, source }
        };
        let refused = |source: io::Error| SpawnError {
            what: role.to_string(),
            why: self.why(&source),
            source,
        };
        let out = File::options().create(true).append(true).open(log).map_err(unlogged)?;
        let mut command = Command::new(&self.executable);
        match role {
            Role::Agent { brief, program, incarnation } => {
                command.arg0("phalanx-agent");
                part(&mut command, "agent", program);
                command.arg(brief).arg("--incarnation").arg(incarnation.to_string());
            }
            Role::Plant { brief, program } => {
                command.arg0("phalanx-plant");
                part(&mut command, "plant", program);
                command.arg(brief);
            }
            Role::ControlTimer { run_root, period_ns, robots } => {
                command.arg0("phalanx-machine").arg("machine").arg(run_root);
                command.arg("--period-ns").arg(period_ns.to_string());
                command.arg("--robots").arg(robots.to_string());
            }
            Role::Bridge { brief } => {
                command.arg0("phalanx-bridge").arg("bridge").arg(brief);
            }
            Role::Ros2 { brief } => {
                command.arg0("phalanx-ros2").arg("ros2").arg(brief);
            }
            Role::Load => {
                command.arg0("phalanx-load").arg("load");
            }
            Role::Awake => {
                command.arg0("phalanx-awake").arg("awake");
            }
            Role::Bench { words } => {
                command.arg0("phalanx-bench").args(words);
            }
            Role::Run { words } => {
                command.arg0("phalanx").args(words);
            }
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
        // Nothing may be asked to run between fork and exec: the start would copy the page tables
        // of this process, whose shared memory grows with the robots, once for each of them.
        command.env(PARENT, std::process::id().to_string());
        // Never for somebody else's program, which may be fed by strangers.
        let own_agent = matches!(role, Role::Agent { program: None, .. });
        let same = (self.same_addresses && own_agent).then(SameAddresses::for_children);
        let process = command.spawn().map_err(refused)?;
        drop(same);
        Child::watch(process, log).map_err(|source| {
            let why = format!("it cannot be watched (pidfd_open): {}", limits::why(&source));
            SpawnError { what: role.to_string(), why, source }
        })
    }

    /// Why it was not started.
    fn why(&self, error: &io::Error) -> String {
        let path = self.executable.display();
        match error.raw_os_error() {
            Some(libc::ENOENT) => format!("the executable {path} is not there"),
            Some(libc::EACCES | libc::EPERM) => format!(
                "{path} may not be executed ({error}): look at its mode, and whether its file \
                 system is mounted noexec"
            ),
            Some(libc::ENOEXEC) => format!("{path} is no executable for this machine ({error})"),
            _ => limits::why(error),
        }
    }
}

/// The words by which our own executable becomes a part of phalanx, or what takes its place.
fn part(command: &mut Command, part: &str, program: Option<&Started>) {
    match program {
        None => drop(command.arg(part)),
        Some(program) => become_program(command, program),
    }
}

/// The words by which our own executable becomes another one: what must be done between fork and exec
/// is done by it, under the id that is watched.
fn become_program(command: &mut Command, program: &Started) {
    command.arg("become").arg(&program.folder);
    if let Some(mb) = program.memory_max_mb {
        command.arg("--memory-max-mb").arg(mb.to_string());
    }
    command.arg("--").args(&program.words);
}

#[cfg(test)]
mod tests {
    use super::*;

    fn refused(executable: &Path, role: Role<'_>) -> String {
        let log = Path::new("/dev/null");
        Launcher::of(executable).spawn(role, log).unwrap_err().to_string()
    }

    #[test]
    fn an_executable_that_cannot_be_started_is_named_with_the_reason() {
        let brief = Path::new("/runs/x/briefs/r2.toml");
        let agent = Role::Agent { brief, program: None, incarnation: 0 };
        assert_eq!(
            refused(Path::new("/no/such/phalanx"), agent),
            "cannot start robot r2: the executable /no/such/phalanx is not there"
        );
        let text = refused(Path::new("/etc/passwd"), Role::Plant { brief, program: None });
        assert!(text.starts_with("cannot start the plant: /etc/passwd may not be exec"), "{text}");
    }

    #[test]
    fn a_log_that_cannot_be_opened_is_named() {
        let log = Path::new("/no/such/folder/awake.jsonl");
        let error = Launcher::of_this_executable().spawn(Role::Awake, log).unwrap_err().to_string();
        assert!(error.contains("keeps a core awake: its log /no/such/folder/awake.j"), "{error}");
    }
}
