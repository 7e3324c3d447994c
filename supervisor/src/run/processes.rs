//! The processes of a run: started, signalled, watched, reaped. Must not: decide anything about
//! them, or wait for one.

use std::path::PathBuf;
use std::process::ExitStatus;
use std::time::{Duration, Instant};

use protocol::message::Wanted;
use protocol::watchdog::Sample;
use rustix::event::{PollFd, PollFlags, Timespec, poll};

use super::hosts::remote::Remote;
use super::load::Load;
use crate::child::{self, Child, Entry};
use crate::spawn::{Launcher, Role, SpawnError};
use crate::tree::SignalError;
use outcome::results::programs::ProgramCommand;
use outcome::results::usage::Usage;

/// Processes asked to end are killed after this.
pub(crate) const GRACE: Duration = Duration::from_secs(2);
/// How many lines of a dead child's log are shown.
pub(super) const LOG_LINES: usize = 8;
/// Printed in place of the log of a process of another host.
const LOG_ELSEWHERE: &str = "  (on the host where it lived)";

/// All of them.
pub(super) struct Processes {
    pub(super) plant: Child,
    robots: Vec<Robot>,
    /// With the robots' timer and nothing else, if there is one.
    control_timer: Option<Child>,
    /// Usage of the control timer, if it died before the end.
    dead_control_timer: Option<Usage>,
    /// What takes processor time on purpose.
    pub(super) load: Load,
    pub(super) launcher: Launcher,
}

/// Process of a robot that is watched for silence.
#[derive(Clone, Copy)]
pub(super) enum Process<'a> {
    /// A child of this supervisor.
    Here(&'a Child),
    /// A process of another host.
    Elsewhere(&'a Remote),
}

impl Process<'_> {
    /// Returns a number that no earlier process of the same robot had.
    pub(super) fn number(self) -> u64 {
        match self {
            Process::Here(child) => child.pid().into(),
            Process::Elsewhere(remote) => remote.starts(),
        }
    }

    /// Polls its state; `None` if it is not known or the process is dead. The state of a process of another host is
    /// as old as that host's newest report, by that host's clock.
    pub(super) fn sample(self) -> Option<Sample> {
        match self {
            Process::Here(child) => child.sample().ok(),
            Process::Elsewhere(remote) => remote.sample(),
        }
    }

    /// Returns the end of its log, for the screen.
    pub(super) fn last_lines(self) -> String {
        match self {
            Process::Here(child) => child.last_lines(LOG_LINES),
            Process::Elsewhere(_) => LOG_ELSEWHERE.into(),
        }
    }
}

/// A robot's process, or the place for one.
pub(crate) struct Robot {
    brief: PathBuf,
    /// What takes the place of the built-in agent.
    program: Option<ProgramCommand>,
    log: PathBuf,
    child: Option<Child>,
    /// Of a robot whose process another host has.
    remote: Option<Remote>,
    /// When the newest was started.
    started: Instant,
    /// What those took that are reaped.
    usage: Usage,
}

impl Robot {
    /// One whose process was not started yet.
    pub(crate) fn new(brief: PathBuf, program: Option<ProgramCommand>, log: PathBuf) -> Robot {
        let (started, usage) = (Instant::now(), Usage::default());
        Robot { brief, program, log, child: None, remote: None, started, usage }
    }

    /// One whose process another host has.
    pub(super) fn elsewhere(remote: Remote) -> Robot {
        let nowhere = PathBuf::new();
        Robot { remote: Some(remote), ..Robot::new(nowhere.clone(), None, nowhere) }
    }

    /// Of a robot whose process another host has.
    pub(super) fn remote(&mut self) -> Option<&mut Remote> {
        self.remote.as_mut()
    }

    /// Starts its process; there is none now.
    pub(crate) fn start(
        &mut self,
        launcher: &Launcher,
        incarnation: u64,
    ) -> Result<(), SpawnError> {
        self.started = Instant::now();
        let role = Role::Agent { brief: &self.brief, program: self.program.as_ref(), incarnation };
        self.child = Some(launcher.spawn(role, &self.log)?);
        Ok(())
    }

    /// Its process, if there is one.
    pub(crate) fn child(&self) -> Option<&Child> {
        self.child.as_ref()
    }

    /// The same, to be ended.
    pub(crate) fn child_mut(&mut self) -> Option<&mut Child> {
        self.child.as_mut()
    }

    /// Lets its process, if there is one, be so from now on. An error if a signal could not be sent.
    pub(crate) fn want(&self, wanted: Wanted) -> Result<(), SignalError> {
        let Some(child) = &self.child else { return Ok(()) };
        match wanted {
            Wanted::Killed => child.kill(),
            Wanted::Stopped => child.stop(),
            Wanted::Running => child.go_on(),
        }
    }

    /// How its process ended, once it has; it is gone then.
    pub(crate) fn reap(&mut self) -> Option<ExitStatus> {
        let status = self.child.as_mut()?.ended()?;
        self.usage = self.usage();
        self.child = None;
        Some(status)
    }

    /// What all its processes took, once they are dead.
    fn usage(&self) -> Usage {
        let mut usage = self.usage;
        usage += self.child.as_ref().and_then(Child::usage).unwrap_or_default();
        usage
    }
}

impl Processes {
    /// The plant runs, the robots do not.
    pub(super) fn new(
        plant: Child,
        control_timer: Option<Child>,
        robots: Vec<Robot>,
        launcher: Launcher,
    ) -> Processes {
        let (dead_control_timer, load) = (None, Load::default());
        Processes { plant, robots, control_timer, dead_control_timer, load, launcher }
    }

    /// Starts a robot's process; there is none now.
    pub(super) fn start(&mut self, robot: usize, incarnation: u64) -> Result<(), SpawnError> {
        let robot = &mut self.robots[robot];
        match &mut robot.remote {
            Some(remote) => {
                robot.started = Instant::now();
                remote.start();
                Ok(())
            }
            None => robot.start(&self.launcher, incarnation),
        }
    }

    /// Lets a robot's process, if there is one, be so from now on. An error if a signal could not be sent.
    pub(super) fn want(&mut self, robot: usize, wanted: Wanted) -> Result<(), SignalError> {
        let robot = &mut self.robots[robot];
        if let Some(remote) = &mut robot.remote {
            remote.want(wanted);
        }
        robot.want(wanted)
    }

    /// The robots whose processes other hosts have, by place.
    pub(super) fn remotes(&mut self) -> Vec<Option<&mut Remote>> {
        self.robots.iter_mut().map(|robot| robot.remote.as_mut()).collect()
    }

    /// The host of a robot's process, by its place, if it is another.
    pub(super) fn host_of(&self, robot: usize) -> Option<usize> {
        self.robots[robot].remote.as_ref().map(|remote| remote.host)
    }

    /// When a robot's newest process was started.
    pub(super) fn started(&self, robot: usize) -> Instant {
        self.robots[robot].started
    }

    /// Moves the deadlines of starting robots by a time in which the supervisor did not run.
    pub(super) fn postpone_deadlines(&mut self, by: Duration) {
        self.robots.iter_mut().for_each(|robot| robot.started += by);
    }

    /// The end of a robot's log.
    pub(super) fn last_lines(&self, robot: usize) -> String {
        if self.robots[robot].remote.is_some() {
            return LOG_ELSEWHERE.into();
        }
        child::shown(&self.last_entries(robot))
    }

    /// The same line by line; none of a robot that lives elsewhere.
    pub(super) fn last_entries(&self, robot: usize) -> Vec<Entry> {
        child::last_entries(&self.robots[robot].log, LOG_LINES)
    }

    /// Returns whether a robot's process is stopped. Of a process on another host, whether it is stopped without an
    /// order, as that host polled it last.
    pub(super) fn is_stopped(&mut self, robot: usize) -> bool {
        let robot = &mut self.robots[robot];
        match &robot.remote {
            Some(remote) => remote.is_stopped(),
            None => robot.child.as_mut().is_some_and(Child::is_stopped),
        }
    }

    /// Returns the robots that have a process, by place: those of this host, and those of hosts that are reachable.
    pub(super) fn watched_robots(
        &self,
        is_reachable: impl Fn(usize) -> bool + Clone,
    ) -> impl Iterator<Item = (usize, Process<'_>)> + Clone {
        let robots = self.robots.iter().enumerate();
        robots.filter_map(move |(place, robot)| {
            let process = match &robot.remote {
                Some(remote) => {
                    let is_watched = is_reachable(remote.host) && !remote.has_ended();
                    is_watched.then_some(Process::Elsewhere(remote))?
                }
                None => Process::Here(robot.child.as_ref()?),
            };
            Some((place, process))
        })
    }

    /// The robots' processes, by place.
    pub(super) fn of_robots(&self) -> impl Iterator<Item = (usize, &Child)> + Clone {
        let robots = self.robots.iter().enumerate();
        robots.filter_map(|(i, robot)| Some((i, robot.child.as_ref()?)))
    }

    /// What is readable once the plant or a robot is dead.
    pub(super) fn watched(&self) -> Vec<PollFd<'_>> {
        let children = self.of_robots().map(|(_, child)| child).chain([&self.plant]);
        children.chain(&self.control_timer).map(watch).collect()
    }

    /// Asks about all at once: nearly always, none did.
    pub(super) fn anybody_died(&self) -> bool {
        let mut watched = self.watched();
        watched.extend(self.load.children().map(watch));
        let mut elsewhere = self.robots.iter().filter_map(|robot| robot.remote.as_ref());
        if elsewhere.any(Remote::has_ended) {
            return true;
        }
        // An interruption tells nothing.
        poll(&mut watched, Some(&Timespec { tv_sec: 0, tv_nsec: 0 })) != Ok(0)
    }

    /// How a robot's process ended, once it has; it is gone then.
    pub(super) fn reap(&mut self, robot: usize) -> Option<ExitStatus> {
        let robot = &mut self.robots[robot];
        match &mut robot.remote {
            Some(remote) => remote.reap(),
            None => robot.reap(),
        }
    }

    /// All children. The control timer first: the end of a run is nobody's lateness. Then the plant,
    /// which waits for the robots, and they for nobody.
    pub(super) fn all_mut(&mut self) -> impl Iterator<Item = &mut Child> {
        let robots = self.robots.iter_mut().filter_map(|robot| robot.child.as_mut());
        let first = self.control_timer.iter_mut().chain([&mut self.plant]);
        first.chain(robots).chain(self.load.children_mut())
    }

    /// Reaps the control timer. Returns how it ended, if it just has.
    pub(super) fn reap_control_timer(&mut self) -> Option<ExitStatus> {
        let child = self.control_timer.as_mut()?;
        let status = child.ended()?;
        self.dead_control_timer = Some(child.usage().unwrap_or_default());
        self.control_timer = None;
        Some(status)
    }

    /// What the control timer took, once it is dead.
    pub(super) fn control_timer_usage(&self) -> Option<Usage> {
        let ended = self.control_timer.as_ref().map(|child| child.usage().unwrap_or_default());
        ended.or(self.dead_control_timer)
    }

    /// What the processes of each robot of this host took, once they are dead; by its place.
    pub(super) fn usages(&self) -> impl Iterator<Item = (usize, Usage)> {
        let here = self.robots.iter().enumerate().filter(|(_, robot)| robot.remote.is_none());
        here.map(|(place, robot)| (place, robot.usage()))
    }
}

/// Waits until one of these is readable, for at most one turn. An interruption is a turn without news.
pub(crate) fn wait_for_news(news: &mut [PollFd<'_>], turn: Duration) {
    let turn = Timespec { tv_sec: 0, tv_nsec: turn.as_nanos() as i64 };
    let _ = poll(news, Some(&turn));
}

/// Asks everybody to end, and kills whoever does not.
pub(crate) fn end_all(mut children: Vec<&mut Child>) {
    let asked = Instant::now();
    let mut killed = false;
    children.iter().for_each(|child| child.terminate());
    loop {
        children.retain_mut(|child| child.ended().is_none());
        if children.is_empty() {
            return;
        }
        if !killed && asked.elapsed() > GRACE {
            killed = true;
            for child in &children {
                tracing::warn!("{} did not end when asked, and was killed", child.name());
                if let Err(error) = child.kill() {
                    tracing::warn!("{}: {error}", child.name());
                }
            }
        } else if asked.elapsed() > 2 * GRACE {
            tracing::error!("a killed process does not end; the kernel holds it");
            return;
        }
        std::thread::sleep(Duration::from_millis(1));
    }
}

/// Readable once it is dead.
pub(crate) fn watch(child: &Child) -> PollFd<'_> {
    PollFd::from_borrowed_fd(child.pidfd(), PollFlags::IN)
}
