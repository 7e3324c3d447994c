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
//! | `interactive_actions` | interactive faults |
//! | `processes` | starting, signalling and reaping of processes |
//! | `hosts/` | runs on several hosts |
//! | `goals` | counts of goals from outside |
//! | `load` | load processes |
//! | `helper_process` | the bridge and the ROS 2 bridge, restarted when they die |
//! | `shutdown` | end of a run |
//! | `error` | errors that end a run |

mod error;
mod goals;
mod helper_process;
pub mod hosts;
mod hung;
mod intake;
mod interactive_actions;
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

use protocol::process::{StopFlag, drain_stderr, exit};
use protocol::run_root::RunRoot;
use protocol::service::Node;
use rustix::event::{PollFd, PollFlags};

use crate::dead_nodes::{Cleaner, DeadProcessOwner};
use crate::limits::OutOfMemoryCounter;
use crate::live;
use crate::logs::Logs;
use crate::orphan_processes::OrphanReaper;
use crate::shm_capacity::{self, Allocator};
pub use error::RunError;
use experiment::scenario::{AffectedComponent, Scenario, Settings, SilencedSource};
use helper_process::{HelperDeath, HelperProcess, RepeatedStartFailure};
use hosts::coordinator::{HostChange, Hosts};
use hung::WatchedRobot;
use intake::MessageReceivers;
use interactive_actions::InteractiveActions;
use outcome::results::outcome::RunOutcome;
use processes::Processes;
use run::journal::Journal;
use run::lifecycle::{LifecycleEvent, ProcessState};
use run::state_machine::RunStateMachine;
use services::RunServices;
use standstill::StandstillDetector;
use stops::ExternalStops;
use time_mode::TimeMode;

/// Run in progress: the driver of a [`RunStateMachine`] with processes.
pub struct Run<'a> {
    scenario: &'a Scenario,
    termination_state: TerminationState,
    detectors: FailureDetectors,
    /// Pure part of the run: it decides what follows from an event.
    state_machine: RunStateMachine<Journal<'a>>,
    // In the order in which they must be dropped: processes before services before the run root.
    processes: Processes,
    receivers: MessageReceivers,
    interactive_actions: InteractiveActions<'a>,
    helpers: Helpers,
    time_mode: TimeMode,
    shared_resources: SharedResources,
}

/// Beginning and end of a run.
struct TerminationState {
    /// Request to end the run early.
    stop_flag: StopFlag,
    /// Time at which the first process was started.
    launch_time: Instant,
    interrupted: bool,
    /// Whether an unplanned failure occurred.
    has_failed: bool,
}

/// Detection of failures for which no process is at fault.
struct FailureDetectors {
    external_stops: ExternalStops,
    standstill: StandstillDetector,
    out_of_memory_counter: OutOfMemoryCounter,
    /// Run time of the last check for deaths, ns. Deaths found by the next check occurred after it.
    all_seen_alive_ns: u64,
}

impl FailureDetectors {
    /// Starts to watch the system for a run of this scenario.
    fn start(scenario: &Scenario) -> FailureDetectors {
        FailureDetectors {
            external_stops: ExternalStops::new(scenario),
            standstill: StandstillDetector::new(),
            out_of_memory_counter: OutOfMemoryCounter::start(),
            all_seen_alive_ns: 0,
        }
    }
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
    allocator: Allocator,
    logs: Logs,
    orphan_reaper: OrphanReaper,
}

impl<'a> Run<'a> {
    /// Runs to the end, to a signal, or to an error; then ends every process and removes the shared files.
    /// Calls `progress` with the run time of the newest ground truth, ns.
    pub fn run_to_end(
        mut self,
        mut progress: impl FnMut(u64),
    ) -> (RunOutcome, Result<(), RunError>) {
        let loop_result = self.run_main_loop(&mut progress);
        self.termination_state.has_failed = loop_result.is_err();
        // A run that reaches its end is over at its last ground truth sample.
        let is_complete = loop_result.is_ok() && !self.termination_state.interrupted;
        let end_time = if is_complete { self.receivers.last_truth_arrival } else { Instant::now() };
        if let Err(error) = &loop_result {
            tracing::debug!(%error, "the run ends early");
        }
        let (outcome, shutdown_result) = self.shut_down(end_time);
        (outcome, loop_result.and(shutdown_result))
    }

    fn run_main_loop(&mut self, progress: &mut impl FnMut(u64)) -> Result<(), RunError> {
        loop {
            if self.termination_state.stop_flag.is_requested() {
                self.termination_state.interrupted = true;
                return Ok(());
            }
            self.wait_for_message_or_exit();
            drain_stderr(Duration::ZERO);
            self.check_standstill()?;
            self.read_truths()?;
            self.exchange_with_hosts()?;
            self.watch_ros2();
            // Deaths first, so that a robot that reports another as stale does so after the fault is known.
            self.process_deaths()?;
            for event in self.check_stopped_processes()? {
                self.handle_event(self.receivers.now_ns(), event)?;
            }
            self.shared_resources.logs.truncate_if_due();
            self.read_reports()?;
            self.allocate_memory_if_due()?;
            while let Some(owner) = self.helpers.cleaner.next_cleaned_owner() {
                let helper = match owner {
                    DeadProcessOwner::Robot(robot) => {
                        self.handle_event(
                            self.receivers.now_ns(),
                            LifecycleEvent::CleanedUp { robot },
                        )?;
                        continue;
                    }
                    DeadProcessOwner::Bridge => {
                        self.helpers.hosts.as_mut().map(|hosts| &mut hosts.bridge)
                    }
                    DeadProcessOwner::Ros2 => self.helpers.ros2.as_mut(),
                };
                helper.map_or(Ok(()), HelperProcess::restart_after_cleanup)?;
            }
            if self.interactive_actions.read_requests() {
                self.set_next_pause();
            }
            self.update_view();
            self.state_machine.journal.run_dir.flush_if_due(Instant::now())?;
            progress(self.receivers.now_ns());
            if self.is_over() {
                self.time_mode.finish_current_tick();
                return Ok(());
            }
            self.execute_due_actions()?;
            self.check_deadlines()?;
            self.pin_processes();
        }
    }

    /// Returns whether the newest ground truth sample is the last of the run.
    fn is_over(&self) -> bool {
        self.receivers.now_ns() >= self.end_ns() || self.state_machine.journal.metrics.ends_early()
    }

    /// Returns the run time of the last ground truth sample, ns: in lockstep a multiple of the control period.
    fn end_ns(&self) -> u64 {
        let &Settings { duration_ns, period_ns, .. } = &self.scenario.settings;
        match self.time_mode.continues_despite_stopped_process() {
            true => duration_ns,
            false => duration_ns / period_ns * period_ns,
        }
    }

    /// Waits for a message or a process exit.
    fn wait_for_message_or_exit(&self) {
        self.time_mode.wait_for_message_or_exit(|| {
            let mut poll_fds = self.processes.pidfds();
            poll_fds
                .push(PollFd::from_borrowed_fd(self.helpers.cleaner.results_fd(), PollFlags::IN));
            poll_fds
        });
    }

    /// Polls the ROS 2 bridge, and records its death.
    fn watch_ros2(&mut self) {
        let Some(ros2) = &mut self.helpers.ros2 else { return };
        if let Some(HelperDeath { cause, repeated_failure }) = ros2.poll(&self.helpers.cleaner) {
            let detail = match repeated_failure {
                None => cause,
                Some(RepeatedStartFailure { log, .. }) => {
                    tracing::warn!("ROS 2 cannot listen ({cause}); the log says:\n{log}");
                    format!("{cause}, and did not become ready; the run continues without it")
                }
            };
            self.state_machine.record_event(self.receivers.now_ns(), "ros2-died", None, detail);
        }
    }

    /// Reads the messages of other hosts, and sends orders to them.
    fn exchange_with_hosts(&mut self) -> Result<(), RunError> {
        let Some(hosts) = &mut self.helpers.hosts else { return Ok(()) };
        let mut remotes = self.processes.remote_robots();
        let mut changes = hosts.read_reports(&mut remotes)?;
        let cleaned_robots: Vec<usize> = (remotes.iter_mut().enumerate())
            .filter_map(|(robot, remote)| remote.as_mut()?.take_cleanup().then_some(robot))
            .collect();
        hosts.send_orders(&remotes)?;
        let (now_ns, silence_max_ns) = (self.receivers.now_ns(), hosts.silence_max_ns());
        if let Some(cause) = hosts.watch_bridge(&self.helpers.cleaner)? {
            self.state_machine.record_event(
                now_ns,
                "bridge-died",
                None,
                format!("of this host: {cause}"),
            );
        }
        for robot in cleaned_robots {
            self.handle_event(now_ns, LifecycleEvent::CleanedUp { robot })?;
        }
        for change in changes.drain(..) {
            let Some(hosts) = &self.helpers.hosts else { return Ok(()) };
            let host_name = |host| hosts.host_name(host).to_owned();
            match change {
                HostChange::BridgeRestarted(host) => {
                    let detail = format!("host {}", host_name(host));
                    self.state_machine.record_event(now_ns, "bridge-restarted", None, detail);
                }
                HostChange::Lost(host) => {
                    let reason = format!("host {} is unreachable", host_name(host));
                    // It became unreachable before that was detected.
                    self.record_host_loss(host, now_ns.saturating_sub(silence_max_ns), &reason)?;
                }
                HostChange::Left(host) => {
                    let reason = format!("the supervisor of host {} ended", host_name(host));
                    self.record_host_loss(host, now_ns, &reason)?;
                }
                HostChange::SupervisorSilent(host) => tracing::warn!(
                    "the supervisor of host {} sends no reports; until it does, it is not known whether its robots are alive",
                    host_name(host)
                ),
                HostChange::ReachableAgain(host) => {
                    let (host_name, robots) = (host_name(host), hosts.robots_of_host(host));
                    self.state_machine.record_event(
                        now_ns,
                        "host-back",
                        None,
                        format!("host {host_name}"),
                    );
                    for robot in robots {
                        let reason = format!("host {host_name} is reachable again");
                        self.handle_event(now_ns, LifecycleEvent::HostReachable { robot, reason })?;
                    }
                }
            }
        }
        Ok(())
    }

    /// Records that a host and its robots are lost. `at_ns` is the run time since which they are.
    fn record_host_loss(&mut self, host: usize, at_ns: u64, reason: &str) -> Result<(), RunError> {
        let Some(hosts) = &self.helpers.hosts else { return Ok(()) };
        let (name, robots) = (hosts.host_name(host).to_owned(), hosts.robots_of_host(host));
        let now_ns = self.receivers.now_ns();
        self.state_machine.record_event(now_ns, "host-lost", None, format!("host {name}"));
        tracing::warn!(host = name, t_s = now_ns as f64 / 1e9, why = reason, "out of reach");
        for robot in robots {
            let silenced_source = SilencedSource::Robot(robot);
            let affected = AffectedComponent {
                robot: Some(robot),
                silenced_source,
                ..AffectedComponent::default()
            };
            let description =
                format!("{} out of reach, on {name}", self.state_machine.journal.robot_name(robot));
            let fault = self.state_machine.journal.metrics.register_fault(description, affected);
            self.handle_event(
                at_ns,
                LifecycleEvent::HostUnreachable { robot, fault, reason: reason.into() },
            )?;
        }
        Ok(())
    }

    /// Returns the events of processes that were stopped or resumed from outside of the run.
    fn check_stopped_processes(&mut self) -> Result<Vec<LifecycleEvent>, RunError> {
        let Run { scenario, detectors, state_machine, processes, time_mode, .. } = self;
        let now_ns = self.receivers.now_ns();
        detectors.external_stops.detect_stops(scenario, state_machine, processes, time_mode, now_ns)
    }

    /// Reports a standstill of the supervisor in real time, postpones all deadlines by it, and processes
    /// the deaths in it. In lockstep nothing depends on the time.
    ///
    /// # Errors
    /// A process has died whose death ends the run.
    fn check_standstill(&mut self) -> Result<(), RunError> {
        let standstill_time = self.detectors.standstill.detect_standstill(Instant::now());
        let Some(standstill_time) =
            standstill_time.filter(|_| self.time_mode.continues_despite_stopped_process())
        else {
            return Ok(());
        };
        let duration_text = format!("{:.1} s", standstill_time.as_secs_f64());
        tracing::warn!(
            "the supervisor did not run for {duration_text} (stopped, or its container or machine was paused): it detected nothing in that time, and planned actions are late"
        );
        self.state_machine.record_event(
            self.receivers.now_ns(),
            standstill::EVENT_KIND,
            None,
            format!("supervisor, for {duration_text}"),
        );
        self.receivers.last_truth_arrival += standstill_time;
        self.processes.postpone_deadlines(standstill_time);
        // A plant that has ended as planned has sent its last ground truth, which is newer than all deaths.
        match self.processes.plant.try_reap() {
            Some(status) if !status.success() => Ok(()),
            _ => self.process_robot_deaths(),
        }
    }

    /// Reads the robots' reports, if due.
    fn read_reports(&mut self) -> Result<(), RunError> {
        // While the plant waits, all messages sent before its next action are read before that action.
        if self.receivers.is_report_poll_due()
            || self.time_mode.plant_waits_for_supervisor(self.receivers.newest_truth.as_ref())
        {
            self.read_statuses()?;
            self.receivers.read_latencies()?;
            self.receivers.read_goal_counts()?;
        }
        if let Some(newest) = &self.receivers.newest_truth {
            self.state_machine
                .journal
                .write_events_before(self.time_mode.known_until_ns(newest))?;
        }
        Ok(())
    }

    /// Sends frames, latencies and events to the live view. Never waits.
    fn update_view(&mut self) {
        self.pass_events_to_view();
        let Some(view) = &mut self.interactive_actions.view else { return };
        view.flush_events();
        if view.is_latency_due(Instant::now()) {
            view.send_latency(live::summarize_stages(&self.receivers.latency_collector));
        }
    }

    /// Hands the events that are new in the journal to the live view.
    fn pass_events_to_view(&mut self) {
        let Some(view) = &mut self.interactive_actions.view else { return };
        let added = self.state_machine.journal.take_added_events().into_iter();
        added.for_each(|event| view.record_event(event.into()));
    }

    /// Checks the timeouts of all processes.
    fn check_deadlines(&mut self) -> Result<(), RunError> {
        let Run {
            state_machine, processes, receivers, time_mode, shared_resources, helpers, ..
        } = self;
        let (lifecycles, journal) = (state_machine.lifecycles(), &state_machine.journal);
        if lifecycles.is_any_process_starting() && receivers.newest_truth.is_none() {
            // The plant waits for robots.
            receivers.last_truth_arrival = Instant::now();
        }
        let ready_after = Duration::from_nanos(self.scenario.ready_after_ns);
        let no_robot_moves = receivers.newest_truth.is_none();
        if let Some(hosts) = &helpers.hosts {
            // The timeout of an unreachable robot is not checked, unless no robot has moved yet: then the
            // plant waits for it.
            let starting = (0..self.scenario.robots.len()).filter(|&robot| {
                let host = processes.remote_host(robot);
                host.is_some_and(|host| no_robot_moves || hosts.is_reachable(host))
                    && lifecycles.process_state(robot) == ProcessState::Starting
            });
            let starting: Vec<usize> = starting.collect();
            // Activity on other hosts cannot be observed, and processes that start concurrently share the
            // cores of their host.
            let limit = ready_after * starting.len() as u32;
            if let Some(&robot) =
                starting.iter().find(|&&robot| processes.start_time(robot).elapsed() > limit)
            {
                let (robot, log) =
                    (journal.robot_name(robot).to_owned(), processes.last_lines(robot));
                return Err(RunError::NotReady { robot, limit, log });
            }
        }
        // A silent robot on an unreachable host is not itself at fault.
        let is_reachable =
            |host: usize| helpers.hosts.as_ref().is_none_or(|hosts| hosts.is_reachable(host));
        let watched = processes.watched_robots(is_reachable).map(|(robot, process)| {
            let is_starting = lifecycles.process_state(robot) == ProcessState::Starting;
            let starting_since = is_starting.then(|| processes.start_time(robot));
            let statuses = state_machine.report(robot).statuses_read;
            WatchedRobot {
                robot,
                name: journal.robot_name(robot),
                process,
                starting_since,
                statuses,
            }
        });
        let slowdown = |robot| Duration::from_nanos(self.scenario.slow_fault_delay_ns_max(robot));
        let newest = receivers.newest_truth.as_ref();
        time_mode
            .check_deadlines(
                newest,
                receivers.last_truth_arrival,
                &processes.plant,
                watched,
                slowdown,
            )
            .map_err(|error| {
                shm_capacity::find_space_error(shared_resources.run_root.path())
                    .map_or(error, RunError::Space)
            })
    }

    /// Pins all processes to the cores on which they are fastest.
    fn pin_processes(&mut self) {
        if self.receivers.first_truth_arrival.is_some() {
            let Processes { plant, .. } = &self.processes;
            let log = self.state_machine.journal.run_dir.log_path("awake");
            self.time_mode.pin_processes(plant, self.processes.robot_children(), &log);
        }
    }
}

/// Returns the exit code of a run that ended with this outcome and error.
pub fn exit_code(outcome: &RunOutcome, result: &Result<(), RunError>) -> u8 {
    match result {
        Err(RunError::Interrupted { .. }) => exit::INTERRUPTED,
        Err(_) => exit::INFRASTRUCTURE_FAILURE,
        Ok(()) if outcome.was_interrupted => exit::INTERRUPTED,
        Ok(()) => exit::OK,
    }
}
