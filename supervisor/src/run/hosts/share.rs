//! Local part of a run on a host without the plant: its robots' processes and its bridge, in the states
//! that the plant's host orders. Makes only one decision: whether the plant's host is lost.

use std::collections::BTreeMap;
use std::os::unix::process::ExitStatusExt as _;
use std::path::Path;
use std::time::{Duration, Instant};

use protocol::brief::{AgentBrief, BridgeBrief, Pace};
use protocol::message::{
    BridgeHeader, OrderHeader, OrderRow, PeerRow, Phase, PolledState, ReportHeader, ReportRow,
    WantedState,
};
use protocol::process::{StopFlag, drain_stderr};
use protocol::service::{self, Publisher, Qos, Subscriber, send_slice};
use protocol::watchdog::{ProcessSample, SchedulingState};
use rustix::event::{PollFd, PollFlags};

use crate::child::Child;
use crate::dead_nodes::{Cleaner, DeadProcessOwner};
use crate::descriptors::ViewUse;
use crate::logs::Logs;
use crate::orphan_processes::OrphanReaper;
use crate::run::RunError;
use crate::run::helper_process::{HelperKind, HelperProcess};
use crate::run::launch::make_run_root;
use crate::run::processes::{RobotProcess, death_poll_fd, terminate_all, wait_until_readable};
use crate::run::services::RobotServices;
use crate::shm_capacity::{self, RequiredSpace};
use crate::spawn::Launcher;
use experiment::briefs;
use experiment::scenario::Scenario;
use outcome::results::host_dir::HostDir;

/// Maximum time for which one iteration of the loop waits for messages.
const ITERATION_MAX: Duration = Duration::from_millis(2);
/// Interval at which reports are sent to the plant's host.
const REPORT_INTERVAL: Duration = Duration::from_millis(20);
/// Interval at which the states of the robots' processes are polled.
const POLL_INTERVAL: Duration = Duration::from_millis(100);
/// Duration for which this host announces that it leaves, before its robots exit.
const LEAVE_ANNOUNCEMENT_TIME: Duration = Duration::from_millis(200);
/// Maximum time for the delivery of the robots' last messages to be confirmed, after they have exited.
const DELIVERY_TIMEOUT: Duration = Duration::from_secs(4);
/// Time for the bridge to read the robots' last messages.
const FLUSH_TIME: Duration = Duration::from_millis(150);
/// Maximum time to wait for the plant's host to announce the end.
const COORDINATOR_EXIT_TIMEOUT: Duration = Duration::from_secs(2);

/// Kind of end of a host's part of a run.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum HostEnd {
    /// The run has ended.
    RunEnded,
    /// A signal ended this host's part before the end of the run.
    Interrupted,
}

/// Robot of this host.
struct LocalRobot {
    name: String,
    process: RobotProcess,
    stopped: bool,
    report: ReportRow,
}

impl LocalRobot {
    /// Orders this state for the robot's process, and discards the last polled state.
    fn order_state(&mut self, state: WantedState) -> Result<(), RunError> {
        self.stopped = state == WantedState::Stopped;
        self.report.state = PolledState::NotPolled as u64;
        let result = self.process.set_wanted_state(state);
        result.map_err(|error| RunError::signal_failure(&self.name, error))
    }

    /// Polls the state of the robot's process.
    fn poll(&mut self) {
        let sample = self.process.child().map(Child::sample);
        let sample = sample.and_then(Result::ok).filter(|_| !self.stopped);
        let state = match sample.map(|sample| sample.state) {
            None | Some(SchedulingState::Exited) => PolledState::NotPolled,
            Some(SchedulingState::Runnable) => PolledState::Runnable,
            Some(SchedulingState::Blocked) => PolledState::Blocked,
            Some(SchedulingState::Stopped) => PolledState::Stopped,
        };
        self.report.state = state as u64;
        if let Some(ProcessSample { cpu_time, time_ns, .. }) = sample {
            (self.report.computed_ns, self.report.polled_ns) =
                (cpu_time.as_nanos() as u64, time_ns);
        }
    }
}

/// Local part of a run in progress.
struct LocalRun<'a> {
    brief: &'a BridgeBrief,
    launcher: &'a Launcher,
    stop_flag: &'a StopFlag,
    robots: BTreeMap<u64, LocalRobot>,
    bridge: HelperProcess,
    cleaner: Cleaner,
    logs: Logs,
    orders: Subscriber<[OrderRow], OrderHeader>,
    report_publisher: Publisher<[ReportRow], ReportHeader>,
    bridge_subscriber: Subscriber<[PeerRow], BridgeHeader>,
    /// Newest orders of the plant's host, and their arrival time.
    newest_orders: Option<(OrderHeader, Instant)>,
    unconfirmed_count: u64,
    phase: Phase,
    sequence: u64,
    last_report_time: Option<Instant>,
    last_poll_time: Instant,
}

/// Runs the local part of this host to the end of the run. `brief` is the brief of the bridge, without its run root.
pub fn run(
    scenario: &Scenario,
    brief: BridgeBrief,
    launcher: &Launcher,
    host_dir: &HostDir,
    stop: &StopFlag,
) -> Result<HostEnd, RunError> {
    let mut orphan_reaper = OrphanReaper::watch(&host_dir.logs_path());
    let own_robots = brief.robots.iter().enumerate().filter(|(_, robot)| robot.host == brief.here);
    let links = own_robots.clone().map(|(_, robot)| robot.hears).sum();
    let own_robots: Vec<usize> = own_robots.map(|(robot, _)| robot).collect();
    let required_space = RequiredSpace::for_robots(scenario, own_robots.iter().copied(), links);
    let run_root = make_run_root(own_robots.len(), required_space, ViewUse::Off)?;
    let launcher = &launcher.clone().with_run_root(run_root.path());
    if scenario.process_programs().next().is_some() {
        orphan_reaper.start_reaper_process(launcher, run_root.path())?;
    }
    let brief = BridgeBrief { run_root: run_root.path().into(), ..brief };
    let node = service::create_node("supervisor")?;
    let services = RobotServices::open_for_host(&node, scenario, &brief)?;
    let name = brief.hosts[brief.here].name.as_str();
    let qos = Qos::for_hosts(1);
    let orders = service::orders_topic(name).create(&node, qos)?;
    let reports = service::host_report_topic(name).create(&node, qos)?;
    let bridge_status = service::bridge_topic(name).create(&node, qos)?;
    let cleaner = Cleaner::start(&run_root, &node)?;
    shm_capacity::allocate_reserved_memory(run_root.path(), None)?;
    let bridge_brief = host_dir.write_brief("bridge", &brief)?;
    let bridge = HelperProcess::start(
        HelperKind::Bridge,
        launcher,
        bridge_brief,
        host_dir.log_path("bridge"),
    )?;
    let mut local_run = LocalRun {
        brief: &brief,
        launcher,
        stop_flag: stop,
        robots: write_robot_briefs(scenario, &brief, run_root.path(), host_dir)?,
        bridge,
        cleaner,
        logs: Logs::new(&host_dir.logs_path()),
        orders: orders.subscriber()?,
        report_publisher: reports.publisher(scenario.robots.len())?,
        bridge_subscriber: bridge_status.subscriber()?,
        newest_orders: None,
        unconfirmed_count: 0,
        phase: Phase::Gathering,
        sequence: 0,
        last_report_time: None,
        last_poll_time: Instant::now(),
    };
    let end_result = local_run.run_main_loop();
    local_run.leave_if_needed(&end_result);
    local_run.end_robots();
    local_run.bridge.terminate();
    drop(local_run);
    drop((orders, reports, bridge_status, services, node));
    if let Err(error) = run_root.remove() {
        tracing::warn!(%error, "could not remove the run root");
    }
    end_result
}

/// Writes the brief of each robot of this host.
fn write_robot_briefs(
    scenario: &Scenario,
    brief: &BridgeBrief,
    run_root: &Path,
    host_dir: &HostDir,
) -> Result<BTreeMap<u64, LocalRobot>, RunError> {
    let briefs = briefs::AgentBriefs::new(scenario);
    let mut robots = BTreeMap::new();
    for (robot, robot_entry) in scenario.robots.iter().enumerate() {
        if brief.robots[robot].host != brief.here {
            continue;
        }
        let agent_brief = briefs.brief(robot, Pace::Realtime, run_root);
        let agent_brief = host_dir
            .write_brief(&robot_entry.name, &AgentBrief { links_by_hand: false, ..agent_brief })?;
        let program = scenario.program(robot).map(|program| host_dir.program_command(program));
        let process = RobotProcess::new(
            agent_brief,
            program.transpose()?,
            host_dir.log_path(&robot_entry.name),
        );
        let (name, number) = (robot_entry.name.clone(), robot as u64 + 1);
        let report = ReportRow { robot: number, ..ReportRow::default() };
        robots.insert(number, LocalRobot { name, process, stopped: false, report });
    }
    Ok(robots)
}

impl LocalRun<'_> {
    fn run_main_loop(&mut self) -> Result<HostEnd, RunError> {
        let start = Instant::now();
        loop {
            if self.stop_flag.is_requested() {
                return Ok(HostEnd::Interrupted);
            }
            self.run_iteration()?;
            self.check_coordinator_alive(start)?;
            let Some((header, _)) = self.newest_orders else { continue };
            if header.failed == 1 {
                self.phase = Phase::Done;
                self.last_report_time = None;
                self.send_report()?;
                return Err(RunError::PlantsHostFailed { host: self.plant_host_name() });
            }
            if Phase::from_number(header.phase) >= Some(Phase::Ending) {
                self.deliver_last_messages()?;
                return Ok(HostEnd::RunEnded);
            }
        }
    }

    fn plant_host_name(&self) -> String {
        self.brief.hosts[self.brief.plant].name.clone()
    }

    /// Executes one iteration: reads messages, applies orders, and reports.
    fn run_iteration(&mut self) -> Result<(), RunError> {
        self.wait_for_message_or_exit();
        drain_stderr(Duration::ZERO);
        while let Some(sample) = self.bridge_subscriber.receive()? {
            self.unconfirmed_count = sample.user_header().unconfirmed;
        }
        let mut order_rows = None;
        while let Some(sample) = self.orders.receive()? {
            self.newest_orders = Some((*sample.user_header(), Instant::now()));
            order_rows = Some(sample.payload().to_vec());
        }
        self.reap_exited();
        if self.last_poll_time.elapsed() >= POLL_INTERVAL {
            self.last_poll_time = Instant::now();
            self.robots.values_mut().for_each(LocalRobot::poll);
        }
        self.logs.truncate_if_due();
        if let Some(death) = self.bridge.poll(&self.cleaner) {
            let cause = RunError::check_given_up(death)?;
            tracing::warn!(how = %cause, "the bridge died; restarting it");
        }
        while let Some(owner) = self.cleaner.next_cleaned_owner() {
            match owner {
                DeadProcessOwner::Robot(number) => {
                    let robot = self.robots.get_mut(&(number as u64));
                    robot.expect("its clean-up was asked for here").report.cleaned += 1;
                }
                DeadProcessOwner::Bridge => self.bridge.restart_after_cleanup()?,
                DeadProcessOwner::Ros2 => {}
            }
        }
        if let (Some(rows), Some((header, _))) = (order_rows, self.newest_orders)
            && Phase::from_number(header.phase) == Some(Phase::Running)
        {
            self.phase = self.phase.max(Phase::Running);
            self.apply_orders(&rows)?;
        }
        self.send_report()
    }

    fn wait_for_message_or_exit(&self) {
        let children = self.robots.values().filter_map(|robot| robot.process.child());
        let mut poll_fds: Vec<_> = children.chain(self.bridge.child()).map(death_poll_fd).collect();
        poll_fds.push(PollFd::from_borrowed_fd(self.cleaner.results_fd(), PollFlags::IN));
        wait_until_readable(&mut poll_fds, ITERATION_MAX);
    }

    /// Starts, signals and ends processes according to the orders.
    fn apply_orders(&mut self, rows: &[OrderRow]) -> Result<(), RunError> {
        for row in rows {
            let Some(robot) = self.robots.get_mut(&row.robot) else { continue };
            let report = robot.report;
            let is_running = robot.process.child().is_some();
            if is_running {
                let state = match WantedState::from_number(row.wanted) {
                    _ if report.starts < row.starts => Some(WantedState::Killed),
                    Some(state) if state != WantedState::Killed => {
                        let is_stop = state == WantedState::Stopped;
                        (robot.stopped != is_stop).then_some(state)
                    }
                    state => state,
                };
                if let Some(state) = state {
                    robot.order_state(state)?;
                }
            } else if report.starts < row.starts && report.cleaned == report.starts {
                // The stale resources of the previous process were removed first.
                robot.process.start(self.launcher, row.starts - 1)?;
                robot.stopped = false;
                // A robot that was never started here has nothing to clean up.
                let (starts, cleaned) = (row.starts, row.starts - 1);
                robot.report =
                    ReportRow { robot: row.robot, starts, cleaned, ..ReportRow::default() };
            }
        }
        Ok(())
    }

    /// Reaps processes that have exited.
    fn reap_exited(&mut self) {
        for (number, robot) in &mut self.robots {
            let Some(status) = robot.process.reap() else { continue };
            robot.report.ended = 1;
            robot.report.status = status.into_raw() as u32 as u64;
            robot.report.ended_early = u64::from(self.phase < Phase::Ending);
            robot.report.state = PolledState::NotPolled as u64;
            self.cleaner.request_cleanup(DeadProcessOwner::Robot(*number as usize));
            self.last_report_time = None;
            if self.phase < Phase::Ending {
                tracing::warn!(
                    robot = robot.name,
                    how = crate::child::describe_exit(status),
                    "ended"
                );
            }
        }
    }

    /// Sends a report to the plant's host, if due.
    fn send_report(&mut self) -> Result<(), RunError> {
        if self.last_report_time.is_some_and(|last| last.elapsed() < REPORT_INTERVAL) {
            return Ok(());
        }
        self.last_report_time = Some(Instant::now());
        let children = self.robots.values().filter_map(|robot| robot.process.child());
        children.for_each(Child::kill_if_over_memory_limit);
        self.sequence += 1;
        let header = ReportHeader {
            sequence: self.sequence,
            phase: self.phase as u64,
            bridge_restarts: self.bridge.restarts(),
        };
        let rows: Vec<ReportRow> = self.robots.values().map(|robot| robot.report).collect();
        send_slice(&self.report_publisher, header, rows.len(), |row| rows[row])?;
        Ok(())
    }

    /// Returns an error if the plant's host is silent for too long, because there is no run without it.
    fn check_coordinator_alive(&self, start: Instant) -> Result<(), RunError> {
        let brief = self.brief;
        match self.newest_orders {
            Some((_, arrival))
                if arrival.elapsed() > Duration::from_nanos(brief.silence_ns_max) =>
            {
                Err(RunError::PlantsHostLost {
                    host: self.plant_host_name(),
                    silent: arrival.elapsed(),
                })
            }
            None if start.elapsed() > Duration::from_nanos(brief.join_within_ns) => {
                let (hosts, waited) = (self.plant_host_name(), start.elapsed());
                Err(RunError::HostsMissing { hosts, waited, dropped: String::new() })
            }
            _ => Ok(()),
        }
    }

    /// Announces to the plant's host that this host leaves, if the run continues there, because its robots
    /// exit next.
    fn leave_if_needed(&mut self, end_result: &Result<HostEnd, RunError>) {
        let is_informed = matches!(
            end_result,
            Ok(HostEnd::RunEnded)
                | Err(RunError::PlantsHostFailed { .. } | RunError::PlantsHostLost { .. })
        );
        if is_informed || self.phase == Phase::Done {
            return;
        }
        self.reap_exited();
        self.phase = Phase::Done;
        let start = Instant::now();
        while start.elapsed() < LEAVE_ANNOUNCEMENT_TIME {
            if let Err(error) = self.send_report() {
                tracing::warn!(%error, "cannot inform the plant's host that this host leaves");
                return;
            }
            std::thread::sleep(ITERATION_MAX);
        }
    }

    /// Ends the robots at the end of the run, and waits until their last messages have been delivered.
    fn deliver_last_messages(&mut self) -> Result<(), RunError> {
        self.reap_exited();
        self.phase = Phase::Ending;
        self.end_robots();
        let robots_end = Instant::now();
        self.unconfirmed_count = 1;
        while robots_end.elapsed() < DELIVERY_TIMEOUT
            && (robots_end.elapsed() < FLUSH_TIME || self.unconfirmed_count > 0)
        {
            self.run_iteration()?;
        }
        self.phase = Phase::Done;
        self.last_report_time = None;
        let done_since = Instant::now();
        let is_released = |local_run: &LocalRun<'_>| {
            local_run
                .newest_orders
                .is_some_and(|(header, _)| Phase::from_number(header.phase) == Some(Phase::Done))
        };
        while done_since.elapsed() < COORDINATOR_EXIT_TIMEOUT && !is_released(self) {
            self.run_iteration()?;
        }
        Ok(())
    }

    /// Terminates all robots, and kills each that does not exit in time.
    fn end_robots(&mut self) {
        let robots = self.robots.values_mut();
        terminate_all(robots.filter_map(|robot| robot.process.child_mut()).collect());
        self.reap_exited();
    }
}
