//! Processes of a run: starting, signalling, watching and reaping. Must not make decisions about them, or
//! wait for one.

use std::path::PathBuf;
use std::process::ExitStatus;
use std::time::{Duration, Instant};

use protocol::incarnations::Incarnations;
use protocol::message::WantedState;
use protocol::watchdog::ProcessSample;
use rustix::event::{PollFd, PollFlags, Timespec, poll};

use super::hosts::remote::RemoteRobot;
use super::load::LoadProcesses;
use crate::child::{self, Child, LogEntry};
use crate::spawn::{Launcher, ProcessRole, SpawnError};
use crate::tree::SignalError;
use outcome::results::programs::ProgramCommand;
use outcome::results::usage::Usage;

/// Time after SIGTERM at which a process is killed. A Python interpreter needs more than 2 s to exit on a busy machine.
pub(crate) const TERMINATION_GRACE_TIME: Duration = Duration::from_secs(5);
/// Number of lines of a dead child's log that are shown.
pub(super) const SHOWN_LOG_LINES: usize = 8;
/// Printed in place of the log of a process of another host.
const REMOTE_LOG_PLACEHOLDER: &str = "  (on the host of the process)";

/// All processes of a run.
pub(super) struct Processes {
    pub(super) plant: Child,
    robots: Vec<RobotProcess>,
    /// Shared table of the incarnations whose commands the plant accepts.
    pub(super) incarnations: Incarnations,
    /// Control process, if there is one.
    control_timer: Option<Child>,
    /// Usage of the control process, if it died before the end.
    dead_control_timer_usage: Option<Usage>,
    /// Load processes.
    pub(super) load: LoadProcesses,
    pub(super) launcher: Launcher,
}

/// Process of a robot that is watched for silence.
#[derive(Clone, Copy)]
pub(super) enum WatchedProcess<'a> {
    /// A child of this supervisor.
    Local(&'a Child),
    /// A process of another host.
    Remote(&'a RemoteRobot),
}

impl WatchedProcess<'_> {
    /// Returns a number that no earlier process of the same robot had.
    pub(super) fn number(self) -> u64 {
        match self {
            WatchedProcess::Local(child) => child.pid().into(),
            WatchedProcess::Remote(remote) => remote.starts(),
        }
    }

    /// Polls the state of the process; `None` if it is unknown or the process is dead. The state of a process of
    /// another host is as old as that host's newest report, by that host's clock.
    pub(super) fn sample(self) -> Option<ProcessSample> {
        match self {
            WatchedProcess::Local(child) => child.sample().ok(),
            WatchedProcess::Remote(remote) => remote.sample(),
        }
    }

    /// Returns the last lines of the process's log, for the screen.
    pub(super) fn last_lines(self) -> String {
        match self {
            WatchedProcess::Local(child) => child.last_lines(SHOWN_LOG_LINES),
            WatchedProcess::Remote(_) => REMOTE_LOG_PLACEHOLDER.into(),
        }
    }
}

/// Process of a robot, or its state between two processes.
pub(crate) struct RobotProcess {
    brief: PathBuf,
    /// Program that replaces the built-in agent.
    program: Option<ProgramCommand>,
    log: PathBuf,
    child: Option<Child>,
    /// State of a robot whose process runs on another host.
    remote_robot: Option<RemoteRobot>,
    /// Start time of the newest process.
    start_time: Instant,
    /// Resource usage of the robot's reaped processes.
    usage: Usage,
}

impl RobotProcess {
    /// Creates a robot whose process has not been started.
    pub(crate) fn new(
        brief: PathBuf,
        program: Option<ProgramCommand>,
        log: PathBuf,
    ) -> RobotProcess {
        let (start_time, usage) = (Instant::now(), Usage::default());
        RobotProcess { brief, program, log, child: None, remote_robot: None, start_time, usage }
    }

    /// Creates a robot whose process runs on another host.
    pub(super) fn new_remote(remote: RemoteRobot) -> RobotProcess {
        let empty_path = PathBuf::new();
        RobotProcess {
            remote_robot: Some(remote),
            ..RobotProcess::new(empty_path.clone(), None, empty_path)
        }
    }

    /// Returns the state of a robot whose process runs on another host; `None` for one of this host.
    pub(super) fn remote_robot(&mut self) -> Option<&mut RemoteRobot> {
        self.remote_robot.as_mut()
    }

    /// Starts the robot's process. The robot must not have a process.
    pub(crate) fn start(
        &mut self,
        launcher: &Launcher,
        incarnation: u64,
    ) -> Result<(), SpawnError> {
        self.start_time = Instant::now();
        let role =
            ProcessRole::Agent { brief: &self.brief, program: self.program.as_ref(), incarnation };
        self.child = Some(launcher.spawn(role, &self.log)?);
        Ok(())
    }

    /// Returns the robot's process, if there is one.
    pub(crate) fn child(&self) -> Option<&Child> {
        self.child.as_ref()
    }

    /// Returns the robot's process mutably, if there is one.
    pub(crate) fn child_mut(&mut self) -> Option<&mut Child> {
        self.child.as_mut()
    }

    /// Sets the wanted state of its process, if there is one. Fails if a signal could not be sent.
    pub(crate) fn set_wanted_state(&self, state: WantedState) -> Result<(), SignalError> {
        let Some(child) = &self.child else { return Ok(()) };
        match state {
            WantedState::Killed => child.kill(),
            WantedState::Stopped => child.stop(),
            WantedState::Running => child.resume(),
        }
    }

    /// Returns the exit status of its process if that has exited, and removes the process.
    pub(crate) fn reap(&mut self) -> Option<ExitStatus> {
        let status = self.child.as_mut()?.try_reap()?;
        self.usage = self.usage();
        self.child = None;
        Some(status)
    }

    /// Returns the resource usage of all its processes that are reaped.
    fn usage(&self) -> Usage {
        let mut usage = self.usage;
        usage += self.child.as_ref().and_then(Child::usage).unwrap_or_default();
        usage
    }
}

impl Processes {
    /// Creates the state in which the plant runs, and the robots do not.
    pub(super) fn new(
        plant: Child,
        control_timer: Option<Child>,
        robots: Vec<RobotProcess>,
        incarnations: Incarnations,
        launcher: Launcher,
    ) -> Processes {
        let (dead_control_timer_usage, load) = (None, LoadProcesses::default());
        Processes {
            plant,
            robots,
            incarnations,
            control_timer,
            dead_control_timer_usage,
            load,
            launcher,
        }
    }

    /// Starts a robot's process. It must not have one.
    pub(super) fn start_robot(&mut self, robot: usize, incarnation: u64) -> Result<(), SpawnError> {
        let robot = &mut self.robots[robot];
        match &mut robot.remote_robot {
            Some(remote) => {
                robot.start_time = Instant::now();
                remote.order_start();
                Ok(())
            }
            None => robot.start(&self.launcher, incarnation),
        }
    }

    /// Sets the wanted state of a robot's process, if there is one. Fails if a signal could not be sent.
    pub(super) fn set_wanted_state(
        &mut self,
        robot: usize,
        state: WantedState,
    ) -> Result<(), SignalError> {
        let robot = &mut self.robots[robot];
        if let Some(remote) = &mut robot.remote_robot {
            remote.order_state(state);
        }
        robot.set_wanted_state(state)
    }

    /// Returns the state of each robot whose process runs on another host, by index; `None` for others.
    pub(super) fn remote_robots(&mut self) -> Vec<Option<&mut RemoteRobot>> {
        self.robots.iter_mut().map(|robot| robot.remote_robot.as_mut()).collect()
    }

    /// Returns the index of the host of a robot's process, if it is another host.
    pub(super) fn remote_host(&self, robot: usize) -> Option<usize> {
        self.robots[robot].remote_robot.as_ref().map(|remote| remote.host)
    }

    /// Returns the start time of a robot's newest process.
    pub(super) fn start_time(&self, robot: usize) -> Instant {
        self.robots[robot].start_time
    }

    /// Postpones the deadlines of starting robots by a time in which the supervisor did not run.
    pub(super) fn postpone_deadlines(&mut self, delay: Duration) {
        self.robots.iter_mut().for_each(|robot| robot.start_time += delay);
    }

    /// Returns the end of a robot's log, for the screen.
    pub(super) fn last_lines(&self, robot: usize) -> String {
        if self.robots[robot].remote_robot.is_some() {
            return REMOTE_LOG_PLACEHOLDER.into();
        }
        child::format_log_lines(&self.last_entries(robot))
    }

    /// Returns the last lines of a robot's log; empty for a robot of another host.
    pub(super) fn last_entries(&self, robot: usize) -> Vec<LogEntry> {
        child::read_last_log_entries(&self.robots[robot].log, SHOWN_LOG_LINES)
    }

    /// Returns whether a robot's process is stopped. For a process on another host: whether it was stopped
    /// without an order when that host last polled it.
    pub(super) fn is_stopped(&mut self, robot: usize) -> bool {
        let robot = &mut self.robots[robot];
        match &robot.remote_robot {
            Some(remote) => remote.is_stopped(),
            None => robot.child.as_mut().is_some_and(Child::is_stopped),
        }
    }

    /// Returns the robots that have a process, by index: robots of this host, and of reachable hosts.
    pub(super) fn watched_robots(
        &self,
        is_reachable: impl Fn(usize) -> bool + Clone,
    ) -> impl Iterator<Item = (usize, WatchedProcess<'_>)> + Clone {
        let robots = self.robots.iter().enumerate();
        robots.filter_map(move |(index, robot)| {
            let process = match &robot.remote_robot {
                Some(remote) => {
                    let is_watched = is_reachable(remote.host) && !remote.has_ended();
                    is_watched.then_some(WatchedProcess::Remote(remote))?
                }
                None => WatchedProcess::Local(robot.child.as_ref()?),
            };
            Some((index, process))
        })
    }

    /// Returns the robots' processes on this host, by index.
    pub(super) fn robot_children(&self) -> impl Iterator<Item = (usize, &Child)> + Clone {
        let robots = self.robots.iter().enumerate();
        robots.filter_map(|(i, robot)| Some((i, robot.child.as_ref()?)))
    }

    /// Returns the descriptors that become readable when the plant or a robot dies.
    pub(super) fn pidfds(&self) -> Vec<PollFd<'_>> {
        let children = self.robot_children().map(|(_, child)| child).chain([&self.plant]);
        children.chain(&self.control_timer).map(death_poll_fd).collect()
    }

    /// Returns whether the plant or a robot may have died. Polls all at once, because nearly always none did.
    pub(super) fn has_any_died(&self) -> bool {
        let mut poll_fds = self.pidfds();
        poll_fds.extend(self.load.children().map(death_poll_fd));
        let mut remote_robots = self.robots.iter().filter_map(|robot| robot.remote_robot.as_ref());
        if remote_robots.any(RemoteRobot::has_ended) {
            return true;
        }
        // If the call was interrupted, each is checked.
        poll(&mut poll_fds, Some(&Timespec { tv_sec: 0, tv_nsec: 0 })) != Ok(0)
    }

    /// Returns the exit status of a robot's process if that has exited, and removes the process.
    pub(super) fn reap_robot(&mut self, robot: usize) -> Option<ExitStatus> {
        let robot = &mut self.robots[robot];
        match &mut robot.remote_robot {
            Some(remote) => remote.reap(),
            None => robot.reap(),
        }
    }

    /// Returns all children in the order of termination: the control process first, so that the shutdown is
    /// not measured as latency; then the plant, which waits for the robots; then the robots.
    pub(super) fn children_mut(&mut self) -> impl Iterator<Item = &mut Child> {
        let robots = self.robots.iter_mut().filter_map(|robot| robot.child.as_mut());
        let first = self.control_timer.iter_mut().chain([&mut self.plant]);
        first.chain(robots).chain(self.load.children_mut())
    }

    /// Reaps the control process. Returns its exit status if it has just exited.
    pub(super) fn reap_control_timer(&mut self) -> Option<ExitStatus> {
        let child = self.control_timer.as_mut()?;
        let status = child.try_reap()?;
        self.dead_control_timer_usage = Some(child.usage().unwrap_or_default());
        self.control_timer = None;
        Some(status)
    }

    /// Returns the resource usage of the control process, once it has exited.
    pub(super) fn control_timer_usage(&self) -> Option<Usage> {
        let ended = self.control_timer.as_ref().map(|child| child.usage().unwrap_or_default());
        ended.or(self.dead_control_timer_usage)
    }

    /// Returns the resource usage of each robot's processes on this host, once they have exited, by index.
    pub(super) fn usages(&self) -> impl Iterator<Item = (usize, Usage)> {
        let local_robots =
            self.robots.iter().enumerate().filter(|(_, robot)| robot.remote_robot.is_none());
        local_robots.map(|(index, robot)| (index, robot.usage()))
    }
}

/// Waits until one of these is readable, at most for `timeout`. Returns early if interrupted.
pub(crate) fn wait_until_readable(poll_fds: &mut [PollFd<'_>], timeout: Duration) {
    let timeout = Timespec { tv_sec: 0, tv_nsec: timeout.as_nanos() as i64 };
    let _ = poll(poll_fds, Some(&timeout));
}

/// Terminates all children, and kills each that does not exit in [`TERMINATION_GRACE_TIME`].
pub(crate) fn terminate_all(mut children: Vec<&mut Child>) {
    let start = Instant::now();
    let mut killed = false;
    children.iter().for_each(|child| child.terminate());
    loop {
        children.retain_mut(|child| child.try_reap().is_none());
        if children.is_empty() {
            return;
        }
        if !killed && start.elapsed() > TERMINATION_GRACE_TIME {
            killed = true;
            for child in &children {
                tracing::warn!("{} did not exit on request, and was killed", child.name());
                if let Err(error) = child.kill() {
                    tracing::warn!("{}: {error}", child.name());
                }
            }
        } else if start.elapsed() > 2 * TERMINATION_GRACE_TIME {
            tracing::error!("a killed process does not exit: it is in an uninterruptible wait");
            return;
        }
        std::thread::sleep(Duration::from_millis(1));
    }
}

/// Returns a poll entry that becomes readable when the child is dead.
pub(crate) fn death_poll_fd(child: &Child) -> PollFd<'_> {
    PollFd::from_borrowed_fd(child.pidfd(), PollFlags::IN)
}
