//! One child process: started, watched through a pidfd, ended, and reaped.
//!
//! Children die with the supervisor, even on its SIGKILL, and inherit none of its descriptors.
//! Nothing here waits for a child.

use std::ffi::OsString;
use std::fs::File;
use std::io::{self, Read, Seek, SeekFrom};
use std::os::fd::{AsFd, BorrowedFd, OwnedFd};
use std::os::unix::process::{CommandExt, ExitStatusExt, parent_id};
use std::path::{Path, PathBuf};
use std::process::{Command, ExitStatus, Stdio};

use rustix::process::{Pid, PidfdFlags, Signal, pidfd_open, pidfd_send_signal};

use crate::usage::Usage;

/// How much of a log's end is looked at for its last lines.
const TAIL_BYTES: u64 = 16 * 1024;

/// The environment variable that tells a child which process started it.
const PARENT: &str = "PHALANX_PARENT";

/// What a child is to be.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Role<'a> {
    /// `phalanx agent BRIEF --incarnation N`.
    Agent {
        /// Its brief.
        brief: &'a Path,
        /// How often this robot's process was started before.
        incarnation: u64,
    },
    /// `phalanx plant BRIEF`.
    Plant {
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
}

/// A running child, or a dead one not yet reaped.
#[derive(Debug)]
pub struct Child {
    process: std::process::Child,
    pidfd: OwnedFd,
    log: PathBuf,
    usage: Option<Usage>,
}

/// Why a child could not be started.
#[derive(Debug, thiserror::Error)]
#[error("cannot start {what}: {source}")]
pub struct SpawnError {
    what: String,
    source: io::Error,
}

impl Child {
    /// Starts this very executable in another role, its log appended to `log`. The calling thread
    /// must live as long as the run: the child dies with it.
    /// `realtime_priority`: it is to run before every ordinary process.
    pub fn spawn(role: Role<'_>, log: &Path, realtime_priority: bool) -> Result<Child, SpawnError> {
        let failed = |source| SpawnError { what: format!("{role:?}"), source };
        let out = File::options().create(true).append(true).open(log).map_err(failed)?;
        let mut command = Command::new("/proc/self/exe");
        match role {
            Role::Agent { brief, incarnation } => {
                command.arg0("phalanx-agent").arg("agent").arg(brief);
                command.arg("--incarnation").arg(incarnation.to_string());
            }
            Role::Plant { brief } => {
                command.arg0("phalanx-plant").arg("plant").arg(brief);
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
        }
        if realtime_priority {
            command.arg("--realtime-priority");
        }
        command
            .stdin(Stdio::null())
            .stdout(out.try_clone().map_err(failed)?)
            .stderr(out)
            .process_group(0); // a Ctrl-C on the terminal is the supervisor's alone
        // Nothing may be asked to run between fork and exec: the start would copy the page tables
        // of this process, whose shared memory grows with the robots, once for each of them.
        command.env(PARENT, std::process::id().to_string());
        let mut process = command.spawn().map_err(failed)?;
        let pid = Pid::from_child(&process);
        match pidfd_open(pid, PidfdFlags::empty()) {
            Ok(pidfd) => Ok(Child { process, pidfd, log: log.into(), usage: None }),
            Err(error) => {
                // Without the descriptor it could not be watched. SIGKILL cannot be ignored.
                let _ = process.kill();
                let _ = process.wait();
                Err(failed(error.into()))
            }
        }
    }

    /// Its process id.
    pub fn pid(&self) -> u32 {
        self.process.id()
    }

    /// Readable once it is dead.
    pub fn pidfd(&self) -> BorrowedFd<'_> {
        self.pidfd.as_fd()
    }

    /// Ends it at once. Harmless if it is dead already.
    pub fn kill(&self) {
        self.signal(Signal::KILL);
    }

    /// Asks it to end; one that was stopped hears of it as well.
    pub fn terminate(&self) {
        self.signal(Signal::TERM);
        self.signal(Signal::CONT);
    }

    /// Stops it, wherever it is, until [`Child::go_on`].
    pub fn stop(&self) {
        self.signal(Signal::STOP);
    }

    /// Lets it go on after [`Child::stop`].
    pub fn go_on(&self) {
        self.signal(Signal::CONT);
    }

    fn signal(&self, signal: Signal) {
        if let Err(error) = pidfd_send_signal(&self.pidfd, signal)
            && error != rustix::io::Errno::SRCH
        {
            tracing::warn!(pid = self.pid(), ?signal, %error, "signal not sent");
        }
    }

    /// How it ended, once it has; it is reaped then.
    pub fn ended(&mut self) -> Option<ExitStatus> {
        if self.usage.is_none() {
            match Usage::of_dead(self.pidfd.as_fd()) {
                Ok(None) => return None,
                Ok(dead) => self.usage = dead,
                Err(error) => tracing::warn!(pid = self.pid(), %error, "cannot ask what it took"),
            }
        }
        self.process.try_wait().unwrap_or_else(|error| {
            tracing::warn!(pid = self.pid(), %error, "cannot ask for its end");
            None
        })
    }

    /// What it took from the machine, once it has ended.
    pub fn usage(&self) -> Option<Usage> {
        self.usage
    }

    /// The last lines of its log, for a screen.
    pub fn last_lines(&self, count: usize) -> String {
        last_lines(&self.log, count)
    }
}

impl Drop for Child {
    /// Nobody outlives whoever keeps it: a run that fails half-way leaves no process.
    fn drop(&mut self) {
        if self.ended().is_none() {
            self.kill();
            // SIGKILL cannot be ignored: this wait is short.
            let _ = self.process.wait();
        }
    }
}

/// What a load process does: nothing, as fast as it can, until it is killed.
pub fn load() -> ! {
    protocol::process::set_name("phalanx-load");
    spin()
}

fn spin() -> ! {
    loop {
        std::hint::spin_loop();
    }
}

/// What keeps a core awake does: nothing, and only while nobody else wants that core. A core that
/// sleeps takes longer to wake than a robot to think.
pub fn awake() -> u8 {
    protocol::process::set_name("phalanx-awake");
    match protocol::process::stand_back() {
        Ok(()) => spin(),
        // It must not run beside those for whom it is there.
        Err(error) => {
            eprintln!("the core is not kept awake: {error}");
            protocol::process::exit::OK
        }
    }
}

/// How a process ended, in words.
pub fn in_words(status: ExitStatus) -> String {
    match (status.code(), status.signal()) {
        (Some(code), _) => format!("exit code {code}"),
        (None, Some(signal)) => format!("signal {signal}"),
        (None, None) => format!("{status}"),
    }
}

/// The last `count` lines of a file; empty if it cannot be read.
pub fn last_lines(path: &Path, count: usize) -> String {
    let tail = || -> io::Result<String> {
        let mut file = File::open(path)?;
        let length = file.metadata()?.len();
        file.seek(SeekFrom::Start(length.saturating_sub(TAIL_BYTES)))?;
        let mut bytes = Vec::new();
        file.take(TAIL_BYTES).read_to_end(&mut bytes)?;
        Ok(String::from_utf8_lossy(&bytes).into_owned())
    };
    let text = tail().unwrap_or_default();
    let lines: Vec<String> = text.lines().map(for_people).collect();
    lines[lines.len().saturating_sub(count)..].join("\n")
}

/// `LEVEL message` of a line of a JSON log; any other line as it is.
fn for_people(line: &str) -> String {
    let entry: serde_json::Value = serde_json::from_str(line).unwrap_or_default();
    match (entry["level"].as_str(), entry["message"].as_str()) {
        (Some(level), Some(message)) => format!("  {level} {message}"),
        _ => format!("  {line}"),
    }
}

/// What every process does first of all, before it has threads or files: a child dies with its
/// parent from here on, even on its SIGKILL, and keeps no descriptor but the first three. Whoever
/// was started by hand goes on as it is.
pub fn obey_parent() -> io::Result<()> {
    let parent = std::env::var(PARENT).ok().and_then(|id| id.parse().ok());
    let Some(parent): Option<u32> = parent else { return Ok(()) };
    rustix::process::set_parent_process_death_signal(Some(Signal::KILL))?;
    if parent_id() != parent {
        return Err(io::Error::other("whoever started this process is gone already"));
    }
    // SAFETY: a plain system call; no descriptor beyond the first three is anybody's yet.
    let closed = unsafe { libc::close_range(3, u32::MAX, 0) };
    if closed == 0 { Ok(()) } else { Err(io::Error::last_os_error()) }
}
