//! What happens in a run, in order, from the first process to the last.
//!
//! One loop takes in what the processes say and who died, and acts on what is due. It never waits
//! for a child: what follows on what is in `lives`, and each turn of the loop moves it on if it can.
//!
//! | file | question it answers |
//! |---|---|
//! | `launch` | how does it begin? |
//! | `services` | over what do the processes speak? |
//! | `conduct` | how does time pass, and what follows from that? |
//! | `intake` | what did the plant and the robots say up to now? |
//! | `reports` | what did a robot say of itself, and what of it is new? |
//! | `listen` | in which order is that taken in, and who is told? |
//! | `lives` | where is each robot's process in its life, and what follows on what? |
//! | `acts` | what is done, when it is due? |
//! | `hung` | who owes an answer for too long? |
//! | `standstill` | when did the supervisor itself not run? |
//! | `stops` | whom did somebody else stop? |
//! | `by_hand` | what may people do to it meanwhile? |
//! | `processes` | how are the processes started, signalled and reaped? |
//! | `hosts/` | what has it to do with other hosts? |
//! | `goals` | what became of goals from outside? |
//! | `load` | what takes processor time on purpose? |
//! | `kept` | how are the bridge and the process for ROS 2 kept going? |
//! | `journal` | what is told of it, and in which order? |
//! | `farewell` | how does it end? |
//! | `error` | why could it not go on? |

mod acts;
mod by_hand;
mod conduct;
mod error;
mod farewell;
mod goals;
pub mod hosts;
mod hung;
mod intake;
pub mod journal;
mod kept;
pub mod launch;
mod listen;
pub mod lives;
mod load;
mod processes;
pub mod reports;
mod services;
mod standstill;
mod stops;

use std::collections::VecDeque;
use std::time::{Duration, Instant};

use protocol::incarnations::Incarnations;
use protocol::message::LinkFaultByHand;
use protocol::process::{Stop, drain_stderr, exit};
use protocol::run_root::RunRoot;
use protocol::service::{Node, Publisher};
use rustix::event::{PollFd, PollFlags};

use crate::dead_nodes::{Cleaner, Dead};
use crate::left_behind::LeftBehind;
use crate::limits::OutOfMemory;
use crate::live;
use crate::logs::Logs;
use crate::room;
use crate::timeline::Timeline;
use conduct::Conduct;
pub use error::RunError;
use experiment::scenario::{Scenario, Silenced, Struck};
use hosts::coordinator::{HostNews, Hosts};
use hung::Watched;
use intake::Intake;
use journal::Journal;
use kept::{Died, GivenUp, Kept};
use lives::{Event, Lives, Seat};
use outcome::results::outcome::Outcome;
use processes::Processes;
use services::RunServices;
use standstill::Standstill;
use stops::Stops;

/// A run under way.
pub struct Run<'a> {
    scenario: &'a Scenario,
    stop: Stop,
    interrupted: bool,
    /// When the first process was started.
    launched: Instant,
    /// Run time at which deaths were last looked for: those found next came after it, ns.
    all_seen_alive_ns: u64,
    timeline: Timeline,
    lives: Lives,
    /// What was asked for by hand, and is yet to be done or refused.
    asked: VecDeque<crate::view::Request>,
    /// How much was done of it.
    acts_by_hand: u64,
    stops: Stops,
    standstill: Standstill,
    out_of_memory: OutOfMemory,
    journal: Journal<'a>,
    // In the order in which they must go: processes before services before the run root.
    processes: Processes,
    /// Which of them the plant obeys.
    incarnations: Incarnations,
    intake: Intake,
    /// To each robot in scenario order, if links may be cut by hand.
    faults_by_hand: Vec<Publisher<[LinkFaultByHand]>>,
    cleaner: Cleaner,
    conduct: Conduct,
    /// Where there are several.
    hosts: Option<Hosts>,
    /// Where ROS 2 listens.
    ros2: Option<Kept>,
    /// Something failed that no plan has.
    failed: bool,
    _services: RunServices,
    _node: Node,
    run_root: RunRoot,
    logs: Logs,
    left_behind: LeftBehind,
}

impl<'a> Run<'a> {
    /// Goes on to the end, to a signal, or to an error; then ends every process and removes what they
    /// shared. `progress` is told the run time of the newest truth, ns.
    pub fn to_the_end(mut self, mut progress: impl FnMut(u64)) -> (Outcome, Result<(), RunError>) {
        let ran = self.turn_until_the_end(&mut progress);
        self.failed = ran.is_err();
        // A run that comes to its end is over with its last truth.
        let whole = ran.is_ok() && !self.interrupted;
        let over = if whole { self.intake.last_news } else { Instant::now() };
        if let Err(error) = &ran {
            tracing::debug!(%error, "the run ends early");
        }
        let (outcome, ended) = self.farewell(over);
        (outcome, ran.and(ended))
    }

    fn turn_until_the_end(&mut self, progress: &mut impl FnMut(u64)) -> Result<(), RunError> {
        loop {
            if self.stop.requested() {
                self.interrupted = true;
                return Ok(());
            }
            self.wait_for_news();
            drain_stderr(Duration::ZERO);
            self.take_standstill()?;
            self.take_truths()?;
            self.take_hosts()?;
            self.watch_ros2();
            // Deaths first: whoever calls a robot stale then does so of a fault that is known.
            self.take_deaths()?;
            self.take_stops()?;
            self.logs.look();
            self.take_reports()?;
            while let Some(dead) = self.cleaner.done() {
                let kept = match dead {
                    Dead::Robot(robot) => {
                        self.happens(self.intake.now_ns(), Event::Cleaned { robot })?;
                        continue;
                    }
                    Dead::Bridge => self.hosts.as_mut().map(|hosts| &mut hosts.bridge),
                    Dead::Ros2 => self.ros2.as_mut(),
                };
                kept.map_or(Ok(()), Kept::cleaned)?;
            }
            self.take_requests();
            self.tell_view();
            self.journal.run_dir.flush_if_due(Instant::now())?;
            progress(self.intake.now_ns());
            if self.is_over() {
                self.conduct.let_finish();
                return Ok(());
            }
            self.act()?;
            self.check_deadlines()?;
            self.place();
        }
    }

    /// Whether the newest truth is the last that counts.
    fn is_over(&self) -> bool {
        self.intake.now_ns() >= self.end_ns() || self.journal.metrics.ends_early()
    }

    /// When the last truth comes, ns: in lockstep at a whole tick.
    fn end_ns(&self) -> u64 {
        let &Scenario { duration_ns, period_ns, .. } = self.scenario;
        match self.conduct.goes_on_without_the_stopped() {
            true => duration_ns,
            false => duration_ns / period_ns * period_ns,
        }
    }

    /// Waits until something may have happened.
    fn wait_for_news(&self) {
        self.conduct.wait_for_news(|| {
            let mut news = self.processes.watched();
            news.push(PollFd::from_borrowed_fd(self.cleaner.news(), PollFlags::IN));
            news
        });
    }

    /// Looks whether the process died that shows the run to ROS 2.
    fn watch_ros2(&mut self) {
        let Some(ros2) = &mut self.ros2 else { return };
        if let Some(Died { how, given_up }) = ros2.watch(&self.cleaner) {
            let what = match given_up {
                None => how,
                Some(GivenUp { log, .. }) => {
                    tracing::warn!("ROS 2 cannot listen ({how}); the log says:\n{log}");
                    format!("{how}, and did not come up; the run goes on without")
                }
            };
            self.journal.event(self.intake.now_ns(), "ros2-died", None, what);
        }
    }

    /// Takes in what other hosts say, and tells them what is wanted of them.
    fn take_hosts(&mut self) -> Result<(), RunError> {
        let Some(hosts) = &mut self.hosts else { return Ok(()) };
        let mut remotes = self.processes.remotes();
        let mut news = hosts.take_reports(&mut remotes)?;
        let cleaned: Vec<usize> = (remotes.iter_mut().enumerate())
            .filter_map(|(robot, remote)| remote.as_mut()?.is_cleaned().then_some(robot))
            .collect();
        hosts.tell(&remotes)?;
        let (now_ns, silence_ns) = (self.intake.now_ns(), hosts.silence_ns());
        if let Some(how) = hosts.watch_bridge(&self.cleaner)? {
            self.journal.event(now_ns, "bridge-died", None, format!("of this host: {how}"));
        }
        for robot in cleaned {
            self.happens(now_ns, Event::Cleaned { robot })?;
        }
        for news in news.drain(..) {
            let Some(hosts) = &self.hosts else { return Ok(()) };
            let name = |host| hosts.name(host).to_owned();
            match news {
                HostNews::BridgeRestarted(host) => {
                    let detail = format!("host {}", name(host));
                    self.journal.event(now_ns, "bridge-restarted", None, detail);
                }
                HostNews::Lost(host) => {
                    let why = format!("host {} is not heard", name(host));
                    // It fell silent before that was known.
                    self.lose_host(host, now_ns.saturating_sub(silence_ns), &why)?;
                }
                HostNews::Left(host) => {
                    let why = format!("the supervisor of host {} ended", name(host));
                    self.lose_host(host, now_ns, &why)?;
                }
                HostNews::SupervisorSilent(host) => tracing::warn!(
                    "the supervisor of host {} sends no reports; whether its robots live is not known meanwhile",
                    name(host)
                ),
                HostNews::Back(host) => {
                    let (name, robots) = (name(host), hosts.robots_of(host));
                    self.journal.event(now_ns, "host-back", None, format!("host {name}"));
                    for robot in robots {
                        let why = format!("host {name} is heard again");
                        self.happens(now_ns, Event::Reachable { robot, why })?;
                    }
                }
            }
        }
        Ok(())
    }

    /// Records that a host is lost, and its robots with it. `at_ns`: run time since which it is.
    fn lose_host(&mut self, host: usize, at_ns: u64, why: &str) -> Result<(), RunError> {
        let Some(hosts) = &self.hosts else { return Ok(()) };
        let (name, robots) = (hosts.name(host).to_owned(), hosts.robots_of(host));
        let now_ns = self.intake.now_ns();
        self.journal.event(now_ns, "host-lost", None, format!("host {name}"));
        tracing::warn!(host = name, t_s = now_ns as f64 / 1e9, why, "out of reach");
        for robot in robots {
            let silenced = Silenced::Robot(robot);
            let struck = Struck { robot: Some(robot), silenced, ..Struck::default() };
            let what = format!("{} out of reach, on {name}", self.journal.name(robot));
            let fault = self.journal.metrics.register_fault(what, struck);
            self.happens(at_ns, Event::Unreachable { robot, fault, why: why.into() })?;
        }
        Ok(())
    }

    /// Takes in what the robots say, if it is time.
    fn take_reports(&mut self) -> Result<(), RunError> {
        // While the plant stands, all that was said before its next act is known before it.
        if self.intake.is_due() || self.conduct.stands(self.intake.newest.as_ref()) {
            self.take_statuses()?;
            self.intake.take_latencies()?;
            self.intake.take_goal_counts()?;
        }
        if let Some(newest) = &self.intake.newest {
            self.journal.known_before(self.conduct.known_before(newest))?;
        }
        Ok(())
    }

    /// Hands over what else there is to see. Waits for nobody.
    fn tell_view(&mut self) {
        let Some(view) = &mut self.journal.view else { return };
        view.pass_on();
        if view.wants_latency(Instant::now()) {
            view.latency(live::stages(&self.intake.latency));
        }
    }

    /// Nobody is waited for without a limit.
    fn check_deadlines(&mut self) -> Result<(), RunError> {
        let Run { lives, processes, journal, intake, conduct, run_root, hosts, .. } = self;
        if lives.anybody_starts() && intake.newest.is_none() {
            // The plant waits for robots.
            intake.last_news = Instant::now();
        }
        let ready_after = Duration::from_nanos(self.scenario.ready_after_ns);
        let nobody_moves = intake.newest.is_none();
        if let Some(hosts) = hosts {
            // A robot out of reach is not waited for, unless no robot has moved yet: then the plant waits for it.
            let starting = (0..self.scenario.robots.len()).filter(|&robot| {
                let host = processes.host_of(robot);
                host.is_some_and(|host| nobody_moves || hosts.is_reachable(host))
                    && lives.seat(robot) == Seat::Starting
            });
            let starting: Vec<usize> = starting.collect();
            // What they do there is not seen from here: those that start at once share the cores of their host.
            let limit = ready_after * starting.len() as u32;
            if let Some(&robot) =
                starting.iter().find(|&&robot| processes.started(robot).elapsed() > limit)
            {
                let (robot, log) = (journal.name(robot).to_owned(), processes.last_lines(robot));
                return Err(RunError::NotReady { robot, limit, log });
            }
        }
        // Silence of a host that is out of reach is not that of its robots.
        let is_reachable =
            |host: usize| hosts.as_ref().is_none_or(|hosts| hosts.is_reachable(host));
        let watched = processes.watched_robots(is_reachable).map(|(robot, process)| {
            let starts = lives.seat(robot) == Seat::Starting;
            let starting_since = starts.then(|| processes.started(robot));
            let statuses = intake.reports[robot].taken;
            Watched { robot, name: journal.name(robot), process, starting_since, statuses }
        });
        let slow = |robot| Duration::from_nanos(self.scenario.slow_ns_max(robot));
        let newest = intake.newest.as_ref();
        conduct
            .check_deadlines(newest, intake.last_news, &processes.plant, watched, slow)
            .map_err(|error| room::full(run_root.path()).map_or(error, RunError::Room))
    }

    /// Keeps everybody on the cores where they are fastest.
    fn place(&mut self) {
        if self.intake.began.is_some() {
            let Processes { plant, .. } = &self.processes;
            let log = self.journal.run_dir.log_path("awake");
            self.conduct.place(plant, self.processes.of_robots(), &log);
        }
    }
}

/// The exit code of a run that ended with this error.
pub fn exit_code(outcome: &Outcome, ran: &Result<(), RunError>) -> u8 {
    match ran {
        Err(RunError::Interrupted { .. }) => exit::INTERRUPTED,
        Err(_) => exit::INFRASTRUCTURE,
        Ok(()) if outcome.interrupted => exit::INTERRUPTED,
        Ok(()) => exit::OK,
    }
}
