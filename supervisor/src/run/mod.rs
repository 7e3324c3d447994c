//! Course of a run, from the first process to the last.
//!
//! One loop reads the messages of the processes, detects deaths, and executes due actions. It never waits
//! for a child: consequences are decided in the crate `run`, and each iteration of the loop advances them if it
//! can.
//!
//! | file | contents |
//! |---|---|
//! | `launch` | start of a run |
//! | `services` | iceoryx2 services of a run |
//! | `time_mode` | time mode, and what depends on it |
//! | `intake` | newest messages of the plant and the robots |
//! | `listen` | order in which messages are read, and their distribution |
//! | `scheduled_actions` | execution of due actions |
//! | `hung` | watchdog of processes with pending responses |
//! | `standstill` | detection of times in which the supervisor itself did not run |
//! | `stops` | processes stopped from outside of the run |
//! | `by_hand` | interactive faults |
//! | `processes` | starting, signalling and reaping of processes |
//! | `hosts/` | runs on several hosts |
//! | `goals` | counts of goals from outside |
//! | `load` | load processes |
//! | `helper_process` | the bridge and the ROS 2 bridge, restarted when they die |
//! | `shutdown` | end of a run |
//! | `error` | errors that end a run |

mod by_hand;
mod error;
mod goals;
mod helper_process;
pub mod hosts;
mod hung;
mod intake;
pub mod launch;
mod listen;
mod load;
mod processes;
mod scheduled_actions;
mod services;
mod shutdown;
mod standstill;
mod stops;
mod time_mode;

use std::time::{Duration, Instant};

use protocol::process::{Stop, drain_stderr, exit};
use protocol::run_root::RunRoot;
use protocol::service::Node;
use rustix::event::{PollFd, PollFlags};

use crate::dead_nodes::{Cleaner, Dead};
use crate::limits::OutOfMemory;
use crate::live;
use crate::logs::Logs;
use crate::orphan_processes::OrphanReaper;
use crate::shm_capacity;
use by_hand::ByHand;
pub use error::RunError;
use experiment::scenario::{Scenario, Settings, Silenced, Struck};
use helper_process::{Died, GivenUp, HelperProcess};
use hosts::coordinator::{HostNews, Hosts};
use hung::Watched;
use intake::Intake;
use outcome::results::outcome::Outcome;
use processes::Processes;
use run::course::Course;
use run::journal::Journal;
use run::lifecycle::{Event, ProcessState};
use services::RunServices;
use standstill::Standstill;
use stops::Stops;
use time_mode::TimeMode;

/// Run in progress: the driver of a [`Course`] with processes.
pub struct Run<'a> {
    scenario: &'a Scenario,
    ending: Ending,
    detectors: Detectors,
    /// Pure part of the run: it decides what follows from an event.
    course: Course<Journal<'a>>,
    // In the order in which they must be dropped: processes before services before the run root.
    processes: Processes,
    intake: Intake,
    by_hand: ByHand<'a>,
    helpers: Helpers,
    time_mode: TimeMode,
    shared: SharedResources,
}

/// Beginning and end of a run.
struct Ending {
    /// Request to end the run early.
    stop: Stop,
    /// Time at which the first process was started.
    launched: Instant,
    interrupted: bool,
    /// Whether an unplanned failure occurred.
    failed: bool,
}

/// Detection of failures for which no process is at fault.
struct Detectors {
    stops: Stops,
    standstill: Standstill,
    out_of_memory: OutOfMemory,
    /// Run time of the last check for deaths, ns. Deaths found by the next check occurred after it.
    all_seen_alive_ns: u64,
}

/// Helper processes, and the thread that removes what dead processes left.
struct Helpers {
    cleaner: Cleaner,
    /// Other hosts, with the bridge to them; `None` for a run on one host.
    hosts: Option<Hosts>,
    /// ROS 2 bridge; `None` without it.
    ros2: Option<HelperProcess>,
}

/// Resources that the processes of a run share, in the order in which they must be dropped.
struct SharedResources {
    _services: RunServices,
    _node: Node,
    run_root: RunRoot,
    logs: Logs,
    left_behind: OrphanReaper,
}

impl<'a> Run<'a> {
    /// Runs to the end, to a signal, or to an error; then ends every process and removes the shared files.
    /// Calls `progress` with the run time of the newest ground truth, ns.
    pub fn run_to_end(mut self, mut progress: impl FnMut(u64)) -> (Outcome, Result<(), RunError>) {
        let ran = self.run_main_loop(&mut progress);
        self.ending.failed = ran.is_err();
        // A run that reaches its end is over at its last ground truth sample.
        let whole = ran.is_ok() && !self.ending.interrupted;
        let over = if whole { self.intake.last_news } else { Instant::now() };
        if let Err(error) = &ran {
            tracing::debug!(%error, "the run ends early");
        }
        let (outcome, ended) = self.shut_down(over);
        (outcome, ran.and(ended))
    }

    fn run_main_loop(&mut self, progress: &mut impl FnMut(u64)) -> Result<(), RunError> {
        loop {
            if self.ending.stop.is_requested() {
                self.ending.interrupted = true;
                return Ok(());
            }
            self.wait_for_news();
            drain_stderr(Duration::ZERO);
            self.check_standstill()?;
            self.read_truths()?;
            self.exchange_with_hosts()?;
            self.watch_ros2();
            // Deaths first, so that a robot that reports another as stale does so after the fault is known.
            self.take_deaths()?;
            for event in self.check_stops()? {
                self.handle(self.intake.now_ns(), event)?;
            }
            self.shared.logs.truncate_if_due();
            self.read_reports()?;
            while let Some(dead) = self.helpers.cleaner.next_cleaned_owner() {
                let kept = match dead {
                    Dead::Robot(robot) => {
                        self.handle(self.intake.now_ns(), Event::Cleaned { robot })?;
                        continue;
                    }
                    Dead::Bridge => self.helpers.hosts.as_mut().map(|hosts| &mut hosts.bridge),
                    Dead::Ros2 => self.helpers.ros2.as_mut(),
                };
                kept.map_or(Ok(()), HelperProcess::cleaned)?;
            }
            if self.by_hand.read_requests() {
                self.set_next_pause();
            }
            self.update_view();
            self.course.journal.run_dir.flush_if_due(Instant::now())?;
            progress(self.intake.now_ns());
            if self.is_over() {
                self.time_mode.finish_current_tick();
                return Ok(());
            }
            self.act()?;
            self.check_deadlines()?;
            self.pin_processes();
        }
    }

    /// Returns whether the newest ground truth sample is the last of the run.
    fn is_over(&self) -> bool {
        self.intake.now_ns() >= self.end_ns() || self.course.journal.metrics.ends_early()
    }

    /// Returns the run time of the last ground truth sample, ns: in lockstep at a whole tick.
    fn end_ns(&self) -> u64 {
        let &Settings { duration_ns, period_ns, .. } = &self.scenario.settings;
        match self.time_mode.continues_without_stopped() {
            true => duration_ns,
            false => duration_ns / period_ns * period_ns,
        }
    }

    /// Waits for a message or a process exit.
    fn wait_for_news(&self) {
        self.time_mode.wait_for_news(|| {
            let mut news = self.processes.pidfds();
            news.push(PollFd::from_borrowed_fd(self.helpers.cleaner.results_fd(), PollFlags::IN));
            news
        });
    }

    /// Polls the ROS 2 bridge, and records its death.
    fn watch_ros2(&mut self) {
        let Some(ros2) = &mut self.helpers.ros2 else { return };
        if let Some(Died { cause: how, given_up }) = ros2.watch(&self.helpers.cleaner) {
            let what = match given_up {
                None => how,
                Some(GivenUp { log, .. }) => {
                    tracing::warn!("ROS 2 cannot listen ({how}); the log says:\n{log}");
                    format!("{how}, and did not become ready; the run continues without it")
                }
            };
            self.course.record_event(self.intake.now_ns(), "ros2-died", None, what);
        }
    }

    /// Reads the messages of other hosts, and sends orders to them.
    fn exchange_with_hosts(&mut self) -> Result<(), RunError> {
        let Some(hosts) = &mut self.helpers.hosts else { return Ok(()) };
        let mut remotes = self.processes.remotes();
        let mut news = hosts.read_reports(&mut remotes)?;
        let cleaned: Vec<usize> = (remotes.iter_mut().enumerate())
            .filter_map(|(robot, remote)| remote.as_mut()?.is_cleaned().then_some(robot))
            .collect();
        hosts.send_orders(&remotes)?;
        let (now_ns, silence_ns) = (self.intake.now_ns(), hosts.silence_ns());
        if let Some(how) = hosts.watch_bridge(&self.helpers.cleaner)? {
            self.course.record_event(now_ns, "bridge-died", None, format!("of this host: {how}"));
        }
        for robot in cleaned {
            self.handle(now_ns, Event::Cleaned { robot })?;
        }
        for news in news.drain(..) {
            let Some(hosts) = &self.helpers.hosts else { return Ok(()) };
            let name = |host| hosts.name(host).to_owned();
            match news {
                HostNews::BridgeRestarted(host) => {
                    let detail = format!("host {}", name(host));
                    self.course.record_event(now_ns, "bridge-restarted", None, detail);
                }
                HostNews::Lost(host) => {
                    let why = format!("host {} is unreachable", name(host));
                    // It became unreachable before that was detected.
                    self.lose_host(host, now_ns.saturating_sub(silence_ns), &why)?;
                }
                HostNews::Left(host) => {
                    let why = format!("the supervisor of host {} ended", name(host));
                    self.lose_host(host, now_ns, &why)?;
                }
                HostNews::SupervisorSilent(host) => tracing::warn!(
                    "the supervisor of host {} sends no reports; until it does, it is not known whether its robots are alive",
                    name(host)
                ),
                HostNews::Back(host) => {
                    let (name, robots) = (name(host), hosts.robots_of(host));
                    self.course.record_event(now_ns, "host-back", None, format!("host {name}"));
                    for robot in robots {
                        let why = format!("host {name} is reachable again");
                        self.handle(now_ns, Event::Reachable { robot, why })?;
                    }
                }
            }
        }
        Ok(())
    }

    /// Records that a host and its robots are lost. `at_ns` is the run time since which they are.
    fn lose_host(&mut self, host: usize, at_ns: u64, why: &str) -> Result<(), RunError> {
        let Some(hosts) = &self.helpers.hosts else { return Ok(()) };
        let (name, robots) = (hosts.name(host).to_owned(), hosts.robots_of(host));
        let now_ns = self.intake.now_ns();
        self.course.record_event(now_ns, "host-lost", None, format!("host {name}"));
        tracing::warn!(host = name, t_s = now_ns as f64 / 1e9, why, "out of reach");
        for robot in robots {
            let silenced = Silenced::Robot(robot);
            let struck = Struck { robot: Some(robot), silenced, ..Struck::default() };
            let what = format!("{} out of reach, on {name}", self.course.journal.name(robot));
            let fault = self.course.journal.metrics.register_fault(what, struck);
            self.handle(at_ns, Event::Unreachable { robot, fault, why: why.into() })?;
        }
        Ok(())
    }

    /// Returns the events of processes that were stopped or resumed from outside of the run.
    fn check_stops(&mut self) -> Result<Vec<Event>, RunError> {
        let Run { scenario, detectors, course, processes, time_mode, .. } = self;
        detectors.stops.check(scenario, course, processes, time_mode)
    }

    /// Reports a standstill of the supervisor in real time, postpones all deadlines by it, and processes
    /// the deaths in it. In lockstep nothing depends on the time.
    ///
    /// # Errors
    /// A process has died whose death ends the run.
    fn check_standstill(&mut self) -> Result<(), RunError> {
        let stood = self.detectors.standstill.detect_standstill(Instant::now());
        let Some(stood) = stood.filter(|_| self.time_mode.continues_without_stopped()) else {
            return Ok(());
        };
        let for_s = format!("{:.1} s", stood.as_secs_f64());
        tracing::warn!(
            "the supervisor did not run for {for_s} (stopped, or its container or machine was paused): it detected nothing in that time, and planned actions are late"
        );
        self.course.record_event(
            self.intake.now_ns(),
            standstill::EVENT,
            None,
            format!("supervisor, for {for_s}"),
        );
        self.intake.last_news += stood;
        self.processes.postpone_deadlines(stood);
        // A plant that has ended as planned has sent its last ground truth, which is newer than all deaths.
        match self.processes.plant.try_reap() {
            Some(status) if !status.success() => Ok(()),
            _ => self.process_robot_deaths(),
        }
    }

    /// Reads the robots' reports, if due.
    fn read_reports(&mut self) -> Result<(), RunError> {
        // While the plant waits, all messages sent before its next action are read before that action.
        if self.intake.is_due()
            || self.time_mode.plant_waits_for_supervisor(self.intake.newest.as_ref())
        {
            self.read_statuses()?;
            self.intake.read_latencies()?;
            self.intake.read_goal_counts()?;
        }
        if let Some(newest) = &self.intake.newest {
            self.course.journal.known_before(self.time_mode.known_before(newest))?;
        }
        Ok(())
    }

    /// Sends frames, latencies and events to the live view. Never waits.
    fn update_view(&mut self) {
        self.pass_events_to_view();
        let Some(view) = &mut self.by_hand.view else { return };
        view.flush_events();
        if view.wants_latency(Instant::now()) {
            view.latency(live::stages(&self.intake.latency));
        }
    }

    /// Hands the events that are new in the journal to the live view.
    fn pass_events_to_view(&mut self) {
        let Some(view) = &mut self.by_hand.view else { return };
        let added = self.course.journal.take_added().into_iter();
        added.for_each(|event| view.record_event(event.into()));
    }

    /// Checks the timeouts of all processes.
    fn check_deadlines(&mut self) -> Result<(), RunError> {
        let Run { course, processes, intake, time_mode, shared, helpers, .. } = self;
        let (lifecycles, journal) = (course.lifecycles(), &course.journal);
        if lifecycles.is_any_starting() && intake.newest.is_none() {
            // The plant waits for robots.
            intake.last_news = Instant::now();
        }
        let ready_after = Duration::from_nanos(self.scenario.ready_after_ns);
        let nobody_moves = intake.newest.is_none();
        if let Some(hosts) = &helpers.hosts {
            // The timeout of an unreachable robot is not checked, unless no robot has moved yet: then the
            // plant waits for it.
            let starting = (0..self.scenario.robots.len()).filter(|&robot| {
                let host = processes.remote_host(robot);
                host.is_some_and(|host| nobody_moves || hosts.is_reachable(host))
                    && lifecycles.process_state(robot) == ProcessState::Starting
            });
            let starting: Vec<usize> = starting.collect();
            // Activity on other hosts cannot be observed, and processes that start concurrently share the
            // cores of their host.
            let limit = ready_after * starting.len() as u32;
            if let Some(&robot) =
                starting.iter().find(|&&robot| processes.started(robot).elapsed() > limit)
            {
                let (robot, log) = (journal.name(robot).to_owned(), processes.last_lines(robot));
                return Err(RunError::NotReady { robot, limit, log });
            }
        }
        // A silent robot on an unreachable host is not itself at fault.
        let is_reachable =
            |host: usize| helpers.hosts.as_ref().is_none_or(|hosts| hosts.is_reachable(host));
        let watched = processes.watched_robots(is_reachable).map(|(robot, process)| {
            let starts = lifecycles.process_state(robot) == ProcessState::Starting;
            let starting_since = starts.then(|| processes.started(robot));
            let statuses = course.report(robot).statuses_read;
            Watched { robot, name: journal.name(robot), process, starting_since, statuses }
        });
        let slow = |robot| Duration::from_nanos(self.scenario.slow_ns_max(robot));
        let newest = intake.newest.as_ref();
        time_mode
            .check_deadlines(newest, intake.last_news, &processes.plant, watched, slow)
            .map_err(|error| {
                shm_capacity::find_space_error(shared.run_root.path())
                    .map_or(error, RunError::Space)
            })
    }

    /// Pins all processes to the cores on which they are fastest.
    fn pin_processes(&mut self) {
        if self.intake.began.is_some() {
            let Processes { plant, .. } = &self.processes;
            let log = self.course.journal.run_dir.log_path("awake");
            self.time_mode.pin_processes(plant, self.processes.robot_children(), &log);
        }
    }
}

/// Returns the exit code of a run that ended with this outcome and error.
pub fn exit_code(outcome: &Outcome, ran: &Result<(), RunError>) -> u8 {
    match ran {
        Err(RunError::Interrupted { .. }) => exit::INTERRUPTED,
        Err(_) => exit::INFRASTRUCTURE,
        Ok(()) if outcome.interrupted => exit::INTERRUPTED,
        Ok(()) => exit::OK,
    }
}
