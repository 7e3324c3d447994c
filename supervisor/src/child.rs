//! One child process: watched through a pidfd, terminated and reaped. `spawn` starts it.
//!
//! Children die with the supervisor, even on its SIGKILL, and inherit none of its descriptors. No function
//! here waits for a child that was not killed, and the wait for a killed child is bounded.

use std::cell::OnceCell;
use std::fs::File;
use std::io::{self, Read, Seek, SeekFrom, Write as _};
use std::os::fd::{AsFd, BorrowedFd, OwnedFd};
use std::os::unix::process::{ExitStatusExt, parent_id};
use std::path::{Path, PathBuf};
use std::process::ExitStatus;
use std::time::{Duration, Instant};

use protocol::process::Stderr;
use protocol::watchdog::ProcessSample;
use rustix::event::{PollFd, PollFlags, Timespec, poll};
use rustix::process::{
    Pid, PidfdFlags, Signal, WaitId, WaitIdOptions, pidfd_open, pidfd_send_signal, waitid,
};

use crate::descriptors;
use crate::orphans;
pub(crate) use crate::orphans::PARENT_PID_VARIABLE;
use crate::tree::{self, SignalError};
use outcome::results::usage::{self, Usage};

/// Number of bytes at the end of a log that are searched for its last lines.
const TAIL_BYTES: u64 = 16 * 1024;

/// Environment variable with the run root of the run to which a process belongs.
pub(crate) const RUN_ROOT_VARIABLE: &str = "PHALANX_RUN";

/// Maximum time to wait for a killed process to exit. The kernel can delay SIGKILL while the process is in
/// an uninterruptible wait.
const KILLED_EXIT_TIMEOUT: Duration = Duration::from_secs(5);
/// Pause before a wait is repeated that a signal interrupted.
const RETRY_INTERVAL: Duration = Duration::from_millis(1);

/// Configuration of a keeper, which holds together all processes of a program of the scenario.
#[derive(Debug, Clone)]
pub(crate) struct KeeperConfig {
    /// File in which the agent or the plant writes its process ID.
    pub(crate) pid_file: PathBuf,
    /// Maximum private memory of all processes together, MB.
    pub(crate) memory_max_mb: Option<u64>,
}

/// Running child, or dead one not yet reaped. For a keeper (`keeper`), all methods act on the processes below it.
#[derive(Debug)]
pub struct Child {
    process: std::process::Child,
    pidfd: OwnedFd,
    log: PathBuf,
    usage: Option<Usage>,
    /// Time of the first SIGKILL to the child.
    first_kill_time: OnceCell<Instant>,
    /// Whether the child was stopped at the last poll of its status.
    stopped: bool,
    /// Configuration of the keeper; `None` if this child is not one.
    keeper_config: Option<KeeperConfig>,
}

impl Child {
    /// Starts to watch a process that was just started. Kills it if it cannot be watched.
    pub(crate) fn watch(mut process: std::process::Child, log: &Path) -> io::Result<Child> {
        orphans::add_known_children([process.id()]);
        match pidfd_open(Pid::from_child(&process), PidfdFlags::empty()) {
            Ok(pidfd) => Ok(Child {
                keeper_config: None,
                process,
                pidfd,
                log: log.into(),
                usage: None,
                first_kill_time: OnceCell::new(),
                stopped: false,
            }),
            Err(error) => {
                let _ = process.kill();
                // If it does not exit at once, it is never reaped, and disappears with this process.
                let _ = process.try_wait();
                Err(error.into())
            }
        }
    }

    /// Returns this child as the keeper of a program.
    pub(crate) fn with_keeper(mut self, keeper_config: Option<KeeperConfig>) -> Child {
        self.keeper_config = keeper_config;
        self
    }

    /// Returns the process ID.
    pub fn pid(&self) -> u32 {
        self.process.id()
    }

    /// Returns the IDs of the processes that do the work: the child's own, or those below a keeper once
    /// there are any.
    pub(crate) fn worker_pids(&self) -> Vec<u32> {
        let descendants =
            if self.keeper_config.is_some() { tree::descendants(self.pid()) } else { Vec::new() };
        if descendants.is_empty() { vec![self.pid()] } else { descendants }
    }

    /// Returns the process ID of the agent or the plant, which owns the ports; `None` for a kept program
    /// until it is known.
    pub(crate) fn agent_pid(&self) -> Option<u32> {
        let Some(keeper_config) = &self.keeper_config else { return Some(self.pid()) };
        std::fs::read_to_string(&keeper_config.pid_file).ok()?.trim().parse().ok()
    }

    /// Samples the state of the child with all its processes. Fails if it is dead.
    pub(crate) fn sample(&self) -> io::Result<ProcessSample> {
        match self.keeper_config {
            Some(_) => tree::sample_tree(self.pid()),
            None => ProcessSample::read(self.pid()),
        }
    }

    /// Kills the child, with a warning, if its processes together exceed their memory bound.
    pub(crate) fn kill_if_over_memory_limit(&self) {
        let Some(limit_mb) =
            self.keeper_config.as_ref().and_then(|keeper_config| keeper_config.memory_max_mb)
        else {
            return;
        };
        let used_mb =
            tree::private_memory_bytes(self.pid()).map_or(0, |bytes| bytes.div_ceil(1_000_000));
        if used_mb > limit_mb && self.first_kill_time.get().is_none() {
            tracing::warn!(
                "{}: its processes have {used_mb} MB together, above the limit of {limit_mb} MB (memory_max_mb); killing them",
                self.name()
            );
            if let Err(error) = self.kill() {
                tracing::warn!("{}: {error}", self.name());
            }
        }
    }

    /// Returns a descriptor that becomes readable when the child is dead.
    pub fn pidfd(&self) -> BorrowedFd<'_> {
        self.pidfd.as_fd()
    }

    /// Kills the child with SIGKILL. Does nothing if it is dead.
    pub fn kill(&self) -> Result<(), SignalError> {
        self.first_kill_time.get_or_init(Instant::now);
        match &self.keeper_config {
            None => self.send_signal(Signal::KILL),
            Some(_) if tree::descendants(self.pid()).is_empty() => self.send_signal(Signal::KILL),
            Some(_) => {
                let result = tree::kill_all(self.pid());
                // The keeper reaps them, and exits with the robot's status.
                result.and(self.send_signal(Signal::CONT))
            }
        }
    }

    /// Sends SIGTERM, followed by SIGCONT so that a stopped child receives it.
    pub fn terminate(&self) {
        let result = self.send_signal(Signal::TERM).and_then(|()| self.resume());
        if let Err(error) = result {
            tracing::warn!("{}: {error}", self.name());
        }
    }

    /// Stops the child with SIGSTOP until [`Child::resume`].
    pub fn stop(&self) -> Result<(), SignalError> {
        match self.keeper_config {
            Some(_) => tree::stop_all(self.pid()),
            None => self.send_signal(Signal::STOP),
        }
    }

    /// Resumes the child with SIGCONT after [`Child::stop`].
    pub fn resume(&self) -> Result<(), SignalError> {
        let result =
            self.keeper_config.as_ref().map(|_| tree::signal_all(self.pid(), Signal::CONT));
        result.unwrap_or(Ok(())).and(self.send_signal(Signal::CONT))
    }

    /// Returns whether the child is stopped, also if another process stopped it (`kill -STOP`, Ctrl-Z).
    pub fn is_stopped(&mut self) -> bool {
        if self.keeper_config.is_some() {
            return tree::is_stopped(self.pid());
        }
        let changes = WaitIdOptions::STOPPED | WaitIdOptions::CONTINUED | WaitIdOptions::NOHANG;
        while let Ok(Some(change)) = waitid(WaitId::PidFd(self.pidfd.as_fd()), changes) {
            self.stopped = !change.continued();
        }
        self.stopped
    }

    fn send_signal(&self, signal: Signal) -> Result<(), SignalError> {
        match pidfd_send_signal(&self.pidfd, signal) {
            Ok(()) | Err(rustix::io::Errno::SRCH) => Ok(()),
            Err(error) => Err(SignalError::from_refusal(signal, self.pid(), error.into())),
        }
    }

    /// Returns the exit status if the child has exited, and reaps it. First kills and reaps the orphans
    /// that a keeper left.
    pub fn try_reap(&mut self) -> Option<ExitStatus> {
        if self.usage.is_none() {
            match usage::read_exited_child(self.pidfd.as_fd()) {
                Ok(None) => return None,
                Ok(usage) => self.usage = usage,
                Err(error) => {
                    tracing::warn!(pid = self.pid(), %error, "cannot read its resource usage")
                }
            }
        }
        let status = self.process.try_wait().unwrap_or_else(|error| {
            tracing::warn!(pid = self.pid(), %error, "cannot read its exit status");
            None
        });
        if status.is_some()
            && orphans::remove_known_child(self.pid())
            && self.keeper_config.is_some()
        {
            // Processes killed together with it need not be named.
            let warns = self.first_kill_time.get().is_none();
            orphans::kill_all_orphans(self.log.parent(), warns);
        }
        status
    }

    /// Kills the child and waits for its exit, at most `KILLED_EXIT_TIMEOUT`. Returns the exit status; `None`,
    /// with a warning, if it did not exit in time.
    pub fn kill_and_wait(&mut self) -> Option<ExitStatus> {
        if let Some(status) = self.try_reap() {
            return Some(status);
        }
        if let Err(error) = self.kill() {
            tracing::warn!("{}: {error}", self.name());
            return None;
        }
        let kill_time = *self.first_kill_time.get_or_init(Instant::now);
        let status = self.wait_timeout(KILLED_EXIT_TIMEOUT.saturating_sub(kill_time.elapsed()));
        if status.is_none() {
            tracing::warn!(
                pid = self.pid(),
                "killed, but does not exit: it is in an uninterruptible wait"
            );
        }
        status
    }

    /// Waits for the child to exit, at most for `limit`. Returns the exit status.
    pub fn wait_timeout(&mut self, limit: Duration) -> Option<ExitStatus> {
        let start = Instant::now();
        loop {
            let remaining = limit.saturating_sub(start.elapsed());
            let timeout = Timespec {
                tv_sec: remaining.as_secs() as i64,
                tv_nsec: remaining.subsec_nanos().into(),
            };
            let _ = poll(&mut [PollFd::new(&self.pidfd, PollFlags::IN)], Some(&timeout));
            let status = self.try_reap();
            if status.is_some() || remaining.is_zero() {
                return status;
            }
            std::thread::sleep(RETRY_INTERVAL);
        }
    }

    /// Returns whether the child is dead, reaped or not.
    pub(crate) fn is_dead(&self) -> bool {
        let now = Timespec { tv_sec: 0, tv_nsec: 0 };
        poll(&mut [PollFd::new(&self.pidfd, PollFlags::IN)], Some(&now)) == Ok(1)
    }

    /// Returns whether this supervisor has killed the child.
    pub(crate) fn was_killed(&self) -> bool {
        self.first_kill_time.get().is_some()
    }

    /// Returns the resource usage of the child, once it has exited.
    pub fn usage(&self) -> Option<Usage> {
        self.usage
    }

    /// Returns the name of the process, which is the name of its log.
    pub fn name(&self) -> String {
        self.log.file_stem().unwrap_or_default().to_string_lossy().into_owned()
    }

    /// Returns the last lines of its log, for the screen.
    pub fn last_lines(&self, count: usize) -> String {
        format_log_lines(&read_last_log_entries(&self.log, count))
    }
}

impl Drop for Child {
    /// Kills the child, so that no process survives a run that fails.
    fn drop(&mut self) {
        self.kill_and_wait();
    }
}

/// Consumes processor time until killed (load fault).
pub fn consume_processor_time() -> ! {
    protocol::process::set_thread_name("phalanx-load");
    spin()
}

fn spin() -> ! {
    loop {
        std::hint::spin_loop();
    }
}

/// Keeps a core out of idle states, at idle priority, until killed. The wake-up of an idle core takes
/// longer than a control cycle.
pub fn keep_core_awake() -> u8 {
    protocol::process::set_thread_name("phalanx-awake");
    match protocol::process::set_idle_priority() {
        Ok(()) => spin(),
        // At normal priority it would delay the processes that it is meant to help.
        Err(error) => {
            let _ = writeln!(Stderr, "the core is not kept awake: {error}");
            protocol::process::exit::OK
        }
    }
}

/// Returns how a process ended, as text.
pub fn describe_exit(status: ExitStatus) -> String {
    match (status.code(), status.signal()) {
        (Some(code), _) => format!("exit code {code}"),
        (None, Some(signal)) => format!("signal {signal}"),
        (None, None) => format!("{status}"),
    }
}

/// Line of a log.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) struct LogEntry {
    /// Severity level, for a line of phalanx's own logs.
    pub(crate) level: Option<String>,
    /// Message text.
    pub(crate) message: String,
}

impl LogEntry {
    fn parse(line: &str) -> LogEntry {
        let json: serde_json::Value = serde_json::from_str(line).unwrap_or_default();
        match (json["level"].as_str(), json["message"].as_str()) {
            (Some(level), Some(message)) => {
                LogEntry { level: Some(level.into()), message: message.into() }
            }
            _ => LogEntry { level: None, message: line.into() },
        }
    }
}

/// First words of the line that separates the processes of a robot in its log.
const REPLACEMENT_LINE_START: &str = "a replacement is started: incarnation ";

/// Returns the line that precedes the output of a replacement in a robot's log.
pub(crate) fn replacement_line(incarnation: u64) -> String {
    format!("{{\"level\":\"INFO\",\"message\":\"{REPLACEMENT_LINE_START}{incarnation}\"}}\n")
}

/// Returns the last `count` lines that the newest process has written to a log; an empty list if it cannot be read.
pub(crate) fn read_last_log_entries(path: &Path, count: usize) -> Vec<LogEntry> {
    let tail = || -> io::Result<String> {
        let mut file = File::open(path)?;
        let length = file.metadata()?.len();
        file.seek(SeekFrom::Start(length.saturating_sub(TAIL_BYTES)))?;
        let mut bytes = Vec::new();
        file.take(TAIL_BYTES).read_to_end(&mut bytes)?;
        Ok(String::from_utf8_lossy(&bytes).into_owned())
    };
    let text = tail().unwrap_or_default();
    let mut lines: Vec<LogEntry> = text.lines().map(LogEntry::parse).collect();
    if let Some(at) =
        lines.iter().rposition(|line| line.message.starts_with(REPLACEMENT_LINE_START))
    {
        lines.drain(..=at);
    }
    lines.drain(..lines.len().saturating_sub(count));
    lines
}

/// Last message of a law or plant in Python if the package is not installed.
const MISSING_PACKAGE_MESSAGE: &str = "No module named 'phalanx'";
/// Remedy for the missing Python package.
const MISSING_PACKAGE_REMEDY: &str =
    "\n  (activate the virtual environment with the package, or set its interpreter in `program`)";

/// Formats lines of a log for the screen.
pub(crate) fn format_log_lines(entries: &[LogEntry]) -> String {
    if entries.is_empty() {
        return "  (its newest process has written nothing)".into();
    }
    let line = |LogEntry { level, message }: &LogEntry| match level {
        Some(level) => format!("  {level} {message}"),
        None => format!("  {message}"),
    };
    let lines = entries.iter().map(line).collect::<Vec<_>>().join("\n");
    let hint = if lines.contains(MISSING_PACKAGE_MESSAGE) { MISSING_PACKAGE_REMEDY } else { "" };
    lines + hint
}

/// Prepares a process of phalanx. Every `main` calls it first, before it has threads or files. Resets the
/// signal state inherited from the parent. A child of a supervisor then dies with its parent, even on
/// SIGKILL, closes all descriptors beyond the first three, and is killed before its parent when memory runs
/// out. A process started by a user counts its inherited descriptors.
///
/// # Errors
/// The kernel refuses a system call, or the parent of a child has already exited.
pub fn prepare_process() -> io::Result<()> {
    protocol::process::reset_signals()?;
    let parent = std::env::var(PARENT_PID_VARIABLE).ok().and_then(|id| id.parse().ok());
    let Some(parent): Option<u32> = parent else {
        descriptors::count_inherited_descriptors();
        return Ok(());
    };
    protocol::process::raise_out_of_memory_score();
    rustix::process::set_parent_process_death_signal(Some(Signal::KILL))?;
    if parent_id() != parent {
        return Err(io::Error::other("the parent of this process has already exited"));
    }
    close_inherited_descriptors()
}

/// Closes the inherited descriptors beyond the first three, before this process opens any.
pub(crate) fn close_inherited_descriptors() -> io::Result<()> {
    // By its number: the C library has a name for it only since glibc 2.34. SAFETY: a plain system call; no
    // code uses a descriptor beyond the first three yet.
    let result = unsafe { libc::syscall(libc::SYS_close_range, 3_u64, u64::from(u32::MAX), 0_u64) };
    if result == 0 { Ok(()) } else { Err(io::Error::last_os_error()) }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::process::Command;

    fn start_process(program: &str, argument: &str) -> std::process::Child {
        Command::new(program).arg(argument).spawn().unwrap()
    }

    #[test]
    fn dropped_child_is_killed_and_reaped() {
        let child = Child::watch(start_process("sleep", "1000"), Path::new("/dev/null")).unwrap();
        let process = PathBuf::from(format!("/proc/{}", child.pid()));
        assert!(process.exists());
        drop(child);
        assert!(!process.exists());
    }

    #[test]
    fn child_is_stopped_between_sigstop_and_sigcont() {
        let mut child =
            Child::watch(start_process("sleep", "1000"), Path::new("/dev/null")).unwrap();
        let mut wait_until = |stopped| {
            let start = Instant::now();
            while child.is_stopped() != stopped {
                assert!(start.elapsed() < Duration::from_secs(60));
                std::thread::sleep(RETRY_INTERVAL);
            }
            assert_eq!(child.is_stopped(), stopped, "until that changes");
            if stopped { child.resume() } else { child.stop() }.unwrap();
        };
        [false, true, false].into_iter().for_each(&mut wait_until);
    }

    #[test]
    fn phalanx_log_lines_have_a_level() {
        let folder = tempfile::tempdir().unwrap();
        let log = folder.path().join("r1.jsonl");
        let text = "lost\n{\"level\":\"INFO\",\"message\":\"ready\"}\n  INFO of another program\n";
        std::fs::write(&log, text).unwrap();
        let entries = read_last_log_entries(&log, 2);
        let levels: Vec<_> = entries.iter().map(|entry| entry.level.as_deref()).collect();
        assert_eq!(levels, [Some("INFO"), None]);
        assert_eq!(format_log_lines(&entries), "  INFO ready\n    INFO of another program");
        // The last lines of a replacement do not include lines of its predecessor.
        let replaced = text.to_owned() + &replacement_line(1);
        std::fs::write(&log, &replaced).unwrap();
        assert_eq!(read_last_log_entries(&log, 8), []);
        assert_eq!(format_log_lines(&[]), "  (its newest process has written nothing)");
        std::fs::write(&log, replaced + "lost again\n").unwrap();
        assert_eq!(format_log_lines(&read_last_log_entries(&log, 8)), "  lost again");
    }

    /// Checks that a process that survives SIGKILL is given up: the kernel protects the first process of a
    /// machine or container from signals of its own namespace, so a child watched through that pidfd cannot
    /// be killed.
    #[test]
    fn unkillable_process_is_given_up() {
        let mut child =
            Child::watch(start_process("sleep", "1000"), Path::new("/dev/null")).unwrap();
        let sleep_pid = Pid::from_child(&child.process);
        let child_pidfd = std::mem::replace(
            &mut child.pidfd,
            pidfd_open(Pid::INIT, PidfdFlags::empty()).unwrap(),
        );
        assert_eq!(child.kill_and_wait(), None);
        // Once given up, it costs no further wait.
        assert!(child.first_kill_time.get().unwrap().elapsed() >= KILLED_EXIT_TIMEOUT);
        drop(child);
        assert!(PathBuf::from(format!("/proc/{}", sleep_pid.as_raw_nonzero())).exists());
        pidfd_send_signal(&child_pidfd, Signal::KILL).unwrap();
        rustix::process::waitpid(Some(sleep_pid), rustix::process::WaitOptions::empty()).unwrap();
    }
}
