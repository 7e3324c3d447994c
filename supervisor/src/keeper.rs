//! Keeper process of a robot or a plant that is a program of the scenario: the process that the supervisor
//! watches. It is the subreaper of the program, so that all processes that the program starts stay below it
//! in the process tree.
//!
//! It exits like the robot, with the same exit code or signal. The supervisor then kills the remaining
//! processes (`orphan_processes`). If the supervisor dies, the keeper kills all processes below it. If the
//! keeper is killed, the program dies with it, and the remaining processes become children of the
//! supervisor. Must not have a thread or allocate much memory, because each such robot has a keeper.

use std::ffi::{CString, OsString};
use std::fs;
use std::io::{self, Write as _};
use std::os::fd::{AsRawFd as _, FromRawFd as _, OwnedFd};
use std::os::unix::ffi::OsStrExt as _;
use std::os::unix::process::{CommandExt as _, ExitStatusExt as _, parent_id};
use std::path::{Path, PathBuf};
use std::process::{Command, ExitStatus};
use std::time::{Duration, Instant};

use protocol::process::{Stderr, exit, reset_signals, set_thread_name};
use rustix::event::{PollFd, PollFlags, Timespec, poll};
use rustix::process::{
    Pid, PidfdFlags, Resource, Rlimit, Signal, getpid, kill_process, pidfd_open, pidfd_send_signal,
    set_child_subreaper, set_parent_process_death_signal, setrlimit,
};

use crate::child::PARENT_PID_VARIABLE;
use crate::tree;

/// Name of the process.
pub(crate) const PROCESS_NAME: &str = "phalanx-keeper";

/// Polling interval for the file with the agent's process ID, until it exists.
const PID_FILE_POLL_INTERVAL: Duration = Duration::from_millis(20);
/// Maximum time for a wrapper to exit after the agent that it started, so that its exit code is known.
const WRAPPER_EXIT_TIMEOUT: Duration = Duration::from_millis(500);
/// Time for the reaper to report the processes of a run whose supervisor is dead, before the keeper kills them.
const REAPER_TIMEOUT: Duration = Duration::from_secs(1);
/// Maximum time to wait for killed processes to exit.
const KILLED_EXIT_TIMEOUT: Duration = Duration::from_secs(5);
/// Signals that the keeper reads from a descriptor. SIGUSR1 is its parent-death signal.
const HANDLED_SIGNALS: [libc::c_int; 5] =
    [libc::SIGCHLD, libc::SIGUSR1, libc::SIGTERM, libc::SIGINT, libc::SIGHUP];

/// Command of a program, with its limits.
#[derive(Debug, Clone)]
pub struct ProgramStart {
    /// Working directory of the program.
    pub folder: PathBuf,
    /// Maximum private memory of each process, MB.
    pub memory_max_mb: Option<u64>,
    /// File in which the agent or the plant writes its process ID once it runs.
    pub pid_file: PathBuf,
    /// The program and its arguments.
    pub command_line: Vec<OsString>,
}

/// Starts a program as a child of this process, which becomes its keeper. Returns only if that fails, with the error.
pub fn start_program(start: &ProgramStart) -> io::Error {
    match start.start() {
        Ok(never) => match never {},
        Err(error) => error,
    }
}

impl ProgramStart {
    fn start(&self) -> io::Result<std::convert::Infallible> {
        let with_context =
            |what: &str, error: io::Error| io::Error::other(format!("{what}: {error}"));
        let [program, arguments @ ..] = &self.command_line[..] else {
            return Err(io::Error::other("the program is missing on the command line"));
        };
        set_child_subreaper(Some(getpid()))
            .map_err(|error| with_context("cannot become a subreaper", error.into()))?;
        let parent = parent_id();
        block_signals()?;
        set_parent_process_death_signal(Some(Signal::USR1))?;
        let (keeper, memory_max_mb) = (getpid(), self.memory_max_mb);
        let mut command = Command::new(program);
        command.args(arguments).current_dir(&self.folder).env_remove(PARENT_PID_VARIABLE);
        let before_exec = move || -> io::Result<()> {
            // The keeper blocks signals, and its child inherits that: SIGTERM would never reach the program.
            reset_signals()?;
            set_parent_process_death_signal(Some(Signal::KILL))?;
            if rustix::process::getppid() != Some(keeper) {
                return Err(io::Error::from_raw_os_error(libc::ESRCH));
            }
            if let Some(mb) = memory_max_mb {
                // Not the address space: shared and merely mapped memory is not private memory.
                let bytes = Some(mb.saturating_mul(1_000_000));
                setrlimit(Resource::Data, Rlimit { current: bytes, maximum: bytes })?;
            }
            Ok(())
        };
        // SAFETY: system calls only, between fork and exec of a process with one thread.
        unsafe { command.pre_exec(before_exec) };
        let child = command
            .spawn()
            .map_err(|error| with_context(&format!("cannot start {}", program.display()), error))?;
        // The keeper's own command line contains no brief, so that the robot is found by its program.
        let arguments = [
            PROCESS_NAME.into(),
            "keep".into(),
            parent.to_string().into(),
            child.id().to_string().into(),
            self.pid_file.clone().into_os_string(),
        ];
        Err(with_context(
            "cannot become the keeper of the program",
            exec_own_executable(&arguments),
        ))
    }
}

/// Replaces this process by the same executable with other arguments, without the environment variable that makes a
/// process of phalanx die with its parent. Unlike with [`Command::exec`], blocked signals stay blocked. Returns the
/// error.
fn exec_own_executable(arguments: &[OsString]) -> io::Error {
    let c_string = |bytes: &[u8]| CString::new(bytes).map_err(io::Error::other);
    let c_strings = || -> io::Result<(Vec<CString>, Vec<CString>)> {
        let arguments = arguments
            .iter()
            .map(|argument| c_string(argument.as_bytes()))
            .collect::<io::Result<_>>()?;
        let variables = std::env::vars_os().filter(|(name, _)| name != PARENT_PID_VARIABLE);
        let entry = |(name, value): (OsString, OsString)| {
            c_string(&[name.as_bytes(), b"=", value.as_bytes()].concat())
        };
        Ok((arguments, variables.map(entry).collect::<io::Result<_>>()?))
    };
    let (arguments, variables) = match c_strings() {
        Ok(c_strings) => c_strings,
        Err(error) => return error,
    };
    let pointers = |c_strings: &[CString]| -> Vec<*const libc::c_char> {
        c_strings.iter().map(|c_string| c_string.as_ptr()).chain([std::ptr::null()]).collect()
    };
    let (arguments, variables) = (pointers(&arguments), pointers(&variables));
    // SAFETY: both are arrays of strings that end in a null pointer, and outlive the call.
    unsafe { libc::execve(c"/proc/self/exe".as_ptr(), arguments.as_ptr(), variables.as_ptr()) };
    io::Error::last_os_error()
}

/// Blocks the signals that are read from the descriptor, and returns their set.
fn block_signals() -> io::Result<libc::sigset_t> {
    // SAFETY: zeros are a value of this plain type, and each call writes memory of the right type.
    unsafe {
        let mut set: libc::sigset_t = std::mem::zeroed();
        libc::sigemptyset(&mut set);
        for signal in HANDLED_SIGNALS {
            libc::sigaddset(&mut set, signal);
        }
        match libc::sigprocmask(libc::SIG_BLOCK, &set, std::ptr::null_mut()) {
            0 => Ok(set),
            _ => Err(io::Error::last_os_error()),
        }
    }
}

/// The agent, or the plant: the process below the keeper that takes part in the run.
#[derive(Debug)]
struct AgentProcess {
    pid: u32,
    /// Descriptor of the agent; `None` if it is the child of the keeper, whose exit SIGCHLD reports.
    pidfd: Option<OwnedFd>,
    /// Exit status, if the keeper has reaped it.
    status: Option<ExitStatus>,
    /// Time at which the agent was first seen dead.
    dead_since: Option<Instant>,
}

/// State of a keeper.
#[derive(Debug)]
struct Keeper {
    /// Process ID of the program that it has started.
    program_pid: u32,
    program_status: Option<ExitStatus>,
    /// Exit status of the orphan that was reaped last.
    last_status: Option<ExitStatus>,
    pid_file: PathBuf,
    agent: Option<AgentProcess>,
    /// Whether the program was asked to terminate.
    is_exit_requested: bool,
    /// Time at which the supervisor was seen dead.
    orphaned_since: Option<Instant>,
    signals: OwnedFd,
}

/// Keeps the program `program_pid`, a child of this process, until the robot has exited, and exits like it.
/// `parent` is the supervisor's process ID. Returns an exit code only if the program exited with one, or if
/// the keeper failed.
pub fn supervise_program(parent: u32, program_pid: u32, pid_file: &Path) -> u8 {
    set_thread_name(PROCESS_NAME);
    let mut keeper = match Keeper::new(parent, program_pid, pid_file) {
        Ok(keeper) => keeper,
        Err(error) => {
            let _ = writeln!(Stderr, "error: cannot keep the program: {error}");
            return exit::INFRASTRUCTURE_FAILURE;
        }
    };
    loop {
        let has_children = keeper.reap();
        let status = match has_children {
            true => keeper.exit_status_if_over(),
            false => Some(keeper.status()),
        };
        if let Some(status) = status {
            return exit_like(status);
        }
        keeper.wait_for_event();
    }
}

impl Keeper {
    fn new(parent: u32, program_pid: u32, pid_file: &Path) -> io::Result<Keeper> {
        let set = block_signals()?;
        // SAFETY: a plain system call; the descriptor is new and nothing else owns it.
        let signals = unsafe {
            match libc::signalfd(-1, &set, libc::SFD_CLOEXEC | libc::SFD_NONBLOCK) {
                -1 => return Err(io::Error::last_os_error()),
                descriptor => OwnedFd::from_raw_fd(descriptor),
            }
        };
        set_child_subreaper(Some(getpid()))?;
        set_parent_process_death_signal(Some(Signal::USR1))?;
        let orphaned_since = (parent_id() != parent).then(Instant::now);
        Ok(Keeper {
            program_pid,
            program_status: None,
            last_status: None,
            pid_file: pid_file.into(),
            agent: None,
            is_exit_requested: false,
            orphaned_since,
            signals,
        })
    }

    /// Reaps all dead children. Returns `false` once there are no children, and with them no processes below.
    fn reap(&mut self) -> bool {
        loop {
            let mut status = 0;
            // SAFETY: writes `status`.
            match unsafe { libc::waitpid(-1, &mut status, libc::WNOHANG) } {
                0 => return true,
                -1 if io::Error::last_os_error().raw_os_error() == Some(libc::EINTR) => {}
                -1 => return false,
                pid => {
                    let (pid, status) = (pid as u32, ExitStatus::from_raw(status));
                    if pid == self.program_pid {
                        self.find_agent();
                        self.program_status = Some(status);
                    } else {
                        self.last_status = Some(status);
                    }
                    if let Some(agent) = self.agent.as_mut().filter(|agent| agent.pid == pid) {
                        agent.status = Some(status);
                    }
                }
            }
        }
    }

    /// Reads the process ID of the agent, once it is written. An ID that is not below the keeper belongs to
    /// another PID namespace, and is ignored.
    fn find_agent(&mut self) {
        if self.agent.is_some() {
            return;
        }
        let text = fs::read_to_string(&self.pid_file).unwrap_or_default();
        let Ok(pid) = text.trim().parse::<u32>() else { return };
        let agent = |pidfd| AgentProcess { pid, pidfd, status: None, dead_since: None };
        if pid == self.program_pid {
            self.agent = Some(agent(None));
            return;
        }
        let is_below = tree::descendants(std::process::id()).contains(&pid);
        let id = Pid::from_raw(pid as i32).filter(|_| is_below);
        let pidfd = id.and_then(|id| pidfd_open(id, PidfdFlags::empty()).ok());
        self.agent = pidfd.map(|pidfd| agent(Some(pidfd)));
    }

    /// Returns the exit status of the robot, if it is over although processes are left.
    fn exit_status_if_over(&mut self) -> Option<ExitStatus> {
        self.find_agent();
        if let Some(since) = self.orphaned_since {
            return self.kill_all_processes(since);
        }
        let agent_is_reaped = self.agent.as_ref().is_some_and(|agent| agent.status.is_some());
        let agent_is_first = self.agent.as_ref().is_some_and(|agent| agent.pid == self.program_pid);
        let agent_dead_since = self.agent.as_mut().and_then(AgentProcess::dead_since);
        match self.program_status {
            // The remaining processes are orphans.
            Some(status) if agent_is_first => Some(status),
            Some(status) if !status.success() && !self.is_exit_requested => Some(status),
            // The program has not exited, or has left the agent running. If the agent's own status is
            // unknown, the exit of its parent is awaited.
            _ => {
                let since = agent_dead_since?;
                let is_late = since.elapsed() > WRAPPER_EXIT_TIMEOUT;
                let unknown_status = ExitStatus::from_raw(libc::SIGKILL);
                match agent_is_reaped {
                    true => Some(self.status()),
                    false => is_late.then_some(unknown_status),
                }
            }
        }
    }

    /// Returns the exit status of the robot: that of the agent if the keeper has reaped it, else that of the program.
    fn status(&self) -> ExitStatus {
        let agent_status = self.agent.as_ref().and_then(|agent| agent.status);
        let program_status = match self.program_status {
            Some(status) if !status.success() => Some(status),
            Some(status) => self.last_status.or(Some(status)),
            None => None,
        };
        agent_status.or(program_status).unwrap_or(ExitStatus::from_raw(libc::SIGKILL))
    }

    /// Kills the program and the agent after the supervisor's death, and all other processes once the
    /// reaper has had time to report them. Returns a status if processes still do not exit.
    fn kill_all_processes(&self, since: Instant) -> Option<ExitStatus> {
        if self.program_status.is_none() {
            let _ = send_signal(self.program_pid, Signal::KILL);
        }
        if let Some(pidfd) = self.agent.as_ref().and_then(|agent| agent.pidfd.as_ref()) {
            let _ = pidfd_send_signal(pidfd, Signal::KILL);
        }
        if since.elapsed() > REAPER_TIMEOUT {
            let _ = tree::kill_all(std::process::id());
        }
        let kill_status = ExitStatus::from_raw(libc::SIGKILL);
        (since.elapsed() > REAPER_TIMEOUT + KILLED_EXIT_TIMEOUT).then_some(kill_status)
    }

    /// Waits for a signal or the exit of the agent, and processes the signals.
    fn wait_for_event(&mut self) {
        let alive_agent = self.agent.as_ref().filter(|agent| agent.dead_since.is_none());
        let mut poll_fds = vec![PollFd::new(&self.signals, PollFlags::IN)];
        let pidfd = alive_agent.and_then(|agent| agent.pidfd.as_ref());
        poll_fds.extend(pidfd.map(|pidfd| PollFd::new(pidfd, PollFlags::IN)));
        let can_wait_indefinitely = alive_agent.is_some() && self.orphaned_since.is_none();
        let timeout = Timespec { tv_sec: 0, tv_nsec: PID_FILE_POLL_INTERVAL.subsec_nanos().into() };
        let _ = poll(&mut poll_fds, (!can_wait_indefinitely).then_some(&timeout));
        while let Some(signal) = self.next_signal() {
            match signal {
                libc::SIGCHLD => {}
                libc::SIGUSR1 => drop(self.orphaned_since.get_or_insert_with(Instant::now)),
                _ => self.request_exit(),
            }
        }
    }

    fn next_signal(&self) -> Option<libc::c_int> {
        let mut info = std::mem::MaybeUninit::<libc::signalfd_siginfo>::zeroed();
        let size = size_of::<libc::signalfd_siginfo>();
        // SAFETY: at most `size` bytes are written to memory of that size.
        let read = unsafe { libc::read(self.signals.as_raw_fd(), info.as_mut_ptr().cast(), size) };
        // SAFETY: zeros are a value of this plain struct, and the kernel writes whole ones.
        (read == size as isize).then(|| unsafe { info.assume_init() }.ssi_signo as libc::c_int)
    }

    /// Sends SIGTERM to the agent, or to all processes while the agent is not known.
    fn request_exit(&mut self) {
        self.is_exit_requested = true;
        self.find_agent();
        let _ = match self.agent.as_ref() {
            Some(AgentProcess { pidfd: Some(pidfd), .. }) => pidfd_send_signal(pidfd, Signal::TERM),
            Some(AgentProcess { pid, .. }) if self.program_status.is_none() => {
                send_signal(*pid, Signal::TERM)
            }
            Some(_) => Ok(()),
            None => {
                let _ = tree::signal_all(std::process::id(), Signal::TERM);
                Ok(())
            }
        };
    }
}

impl AgentProcess {
    /// Returns the time since which the agent is seen dead; `None` while it is alive.
    fn dead_since(&mut self) -> Option<Instant> {
        if self.dead_since.is_none() && (self.status.is_some() || self.has_ended()) {
            self.dead_since = Some(Instant::now());
        }
        self.dead_since
    }

    fn has_ended(&self) -> bool {
        let Some(pidfd) = &self.pidfd else { return false };
        let now = Timespec { tv_sec: 0, tv_nsec: 0 };
        matches!(poll(&mut [PollFd::new(pidfd, PollFlags::IN)], Some(&now)), Ok(1))
    }
}

/// Sends a signal to a child that is not reaped.
fn send_signal(child: u32, signal: Signal) -> Result<(), rustix::io::Errno> {
    let pid = Pid::from_raw(child as i32).ok_or(rustix::io::Errno::SRCH)?;
    kill_process(pid, signal)
}

/// Ends this process like another: by the same signal, or by returning its exit code.
fn exit_like(status: ExitStatus) -> u8 {
    let Some(signal) = status.signal() else {
        return status
            .code()
            .and_then(|code| u8::try_from(code).ok())
            .unwrap_or(exit::INFRASTRUCTURE_FAILURE);
    };
    // The program has already written a core file, if enabled.
    let none = Rlimit { current: Some(0), maximum: Some(0) };
    let _ = setrlimit(Resource::Core, none);
    // SAFETY: the default action of a signal of this process, which has one thread, ends it.
    unsafe {
        let mut set: libc::sigset_t = std::mem::zeroed();
        libc::sigemptyset(&mut set);
        libc::sigaddset(&mut set, signal);
        libc::signal(signal, libc::SIG_DFL);
        libc::raise(signal);
        libc::sigprocmask(libc::SIG_UNBLOCK, &set, std::ptr::null_mut());
    }
    // A signal that does not terminate by default cannot have ended another process.
    exit::INFRASTRUCTURE_FAILURE
}
