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
    fn order_state(&mut self, wanted: WantedState) -> Result<(), RunError> {
        self.stopped = wanted == WantedState::Stopped;
        self.report.state = PolledState::NotPolled as u64;
        let sent = self.process.set_wanted_state(wanted);
        sent.map_err(|error| RunError::signal_failure(&self.name, error))
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
        if let Some(ProcessSample { cpu_time: computed, time_ns: at_ns, .. }) = sample {
            (self.report.computed_ns, self.report.polled_ns) = (computed.as_nanos() as u64, at_ns);
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
    let mut left_behind = OrphanReaper::watch(&host_dir.logs_path());
    let own = brief.robots.iter().enumerate().filter(|(_, robot)| robot.host == brief.here);
    let links = own.clone().map(|(_, robot)| robot.hears).sum();
    let own: Vec<usize> = own.map(|(place, _)| place).collect();
    let need = RequiredSpace::for_robots(scenario, own.iter().copied(), links);
    let run_root = make_run_root(own.len(), need, ViewUse::Off)?;
    let launcher = &launcher.clone().with_run_root(run_root.path());
    if scenario.process_programs().next().is_some() {
        left_behind.start_reaper_process(launcher, run_root.path())?;
    }
    let brief = BridgeBrief { run_root: run_root.path().into(), ..brief };
    let node = service::create_node("supervisor")?;
    let services = RobotServices::open_for_host(&node, scenario, &brief)?;
    let name = brief.hosts[brief.here].name.as_str();
    let hosts = Qos::for_hosts(1);
    let orders = service::orders_topic(name).create(&node, hosts)?;
    let report = service::host_report_topic(name).create(&node, hosts)?;
    let bridges = service::bridge_topic(name).create(&node, hosts)?;
    let cleaner = Cleaner::start(&run_root, &node)?;
    shm_capacity::allocate_reserved_memory(run_root.path(), None)?;
    let told = host_dir.write_brief("bridge", &brief)?;
    let bridge =
        HelperProcess::start(HelperKind::Bridge, launcher, told, host_dir.log_path("bridge"))?;
    let mut share = LocalRun {
        brief: &brief,
        launcher,
        stop_flag: stop,
        robots: write_robot_briefs(scenario, &brief, run_root.path(), host_dir)?,
        bridge,
        cleaner,
        logs: Logs::new(&host_dir.logs_path()),
        orders: orders.subscriber()?,
        report_publisher: report.publisher(scenario.robots.len())?,
        bridge_subscriber: bridges.subscriber()?,
        newest_orders: None,
        unconfirmed_count: 0,
        phase: Phase::Gathering,
        sequence: 0,
        last_report_time: None,
        last_poll_time: Instant::now(),
    };
    let ended = share.run_main_loop();
    share.leave_if_needed(&ended);
    share.end_robots();
    share.bridge.terminate();
    drop(share);
    drop((orders, report, bridges, services, node));
    if let Err(error) = run_root.remove() {
        tracing::warn!(%error, "could not remove the run root");
    }
    ended
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
    for (place, robot) in scenario.robots.iter().enumerate() {
        if brief.robots[place].host != brief.here {
            continue;
        }
        let told = briefs.brief(place, Pace::Realtime, run_root);
        let told =
            host_dir.write_brief(&robot.name, &AgentBrief { links_by_hand: false, ..told })?;
        let program = scenario.program(place).map(|program| host_dir.program_command(program));
        let process = RobotProcess::new(told, program.transpose()?, host_dir.log_path(&robot.name));
        let (name, number) = (robot.name.clone(), place as u64 + 1);
        let report = ReportRow { robot: number, ..ReportRow::default() };
        robots.insert(number, LocalRobot { name, process, stopped: false, report });
    }
    Ok(robots)
}

impl LocalRun<'_> {
    fn run_main_loop(&mut self) -> Result<HostEnd, RunError> {
        let began = Instant::now();
        loop {
            if self.stop_flag.is_requested() {
                return Ok(HostEnd::Interrupted);
            }
            self.run_iteration()?;
            self.check_coordinator_alive(began)?;
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
        let mut wanted = None;
        while let Some(sample) = self.orders.receive()? {
            self.newest_orders = Some((*sample.user_header(), Instant::now()));
            wanted = Some(sample.payload().to_vec());
        }
        self.reap_exited();
        if self.last_poll_time.elapsed() >= POLL_INTERVAL {
            self.last_poll_time = Instant::now();
            self.robots.values_mut().for_each(LocalRobot::poll);
        }
        self.logs.truncate_if_due();
        if let Some(died) = self.bridge.poll(&self.cleaner) {
            let how = RunError::check_given_up(died)?;
            tracing::warn!(%how, "the bridge died; restarting it");
        }
        while let Some(dead) = self.cleaner.next_cleaned_owner() {
            match dead {
                DeadProcessOwner::Robot(number) => {
                    let robot = self.robots.get_mut(&(number as u64));
                    robot.expect("its clean-up was asked for here").report.cleaned += 1;
                }
                DeadProcessOwner::Bridge => self.bridge.restart_after_cleanup()?,
                DeadProcessOwner::Ros2 => {}
            }
        }
        if let (Some(rows), Some((header, _))) = (wanted, self.newest_orders)
            && Phase::from_number(header.phase) == Some(Phase::Running)
        {
            self.phase = self.phase.max(Phase::Running);
            self.apply_orders(&rows)?;
        }
        self.send_report()
    }

    fn wait_for_message_or_exit(&self) {
        let children = self.robots.values().filter_map(|robot| robot.process.child());
        let mut news: Vec<_> = children.chain(self.bridge.child()).map(death_poll_fd).collect();
        news.push(PollFd::from_borrowed_fd(self.cleaner.results_fd(), PollFlags::IN));
        wait_until_readable(&mut news, ITERATION_MAX);
    }

    /// Starts, signals and ends processes as the orders say.
    fn apply_orders(&mut self, rows: &[OrderRow]) -> Result<(), RunError> {
        for row in rows {
            let Some(robot) = self.robots.get_mut(&row.robot) else { continue };
            let report = robot.report;
            let lives = robot.process.child().is_some();
            if lives {
                let wanted = match WantedState::from_number(row.wanted) {
                    _ if report.starts < row.starts => Some(WantedState::Killed),
                    Some(wanted) if wanted != WantedState::Killed => {
                        let stops = wanted == WantedState::Stopped;
                        (robot.stopped != stops).then_some(wanted)
                    }
                    wanted => wanted,
                };
                if let Some(wanted) = wanted {
                    robot.order_state(wanted)?;
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
        if self.last_report_time.is_some_and(|at| at.elapsed() < REPORT_INTERVAL) {
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
    fn check_coordinator_alive(&self, began: Instant) -> Result<(), RunError> {
        let brief = self.brief;
        match self.newest_orders {
            Some((_, at)) if at.elapsed() > Duration::from_nanos(brief.silence_ns_max) => {
                Err(RunError::PlantsHostLost { host: self.plant_host_name(), silent: at.elapsed() })
            }
            None if began.elapsed() > Duration::from_nanos(brief.join_within_ns) => {
                let (hosts, waited) = (self.plant_host_name(), began.elapsed());
                Err(RunError::HostsMissing { hosts, waited, dropped: String::new() })
            }
            _ => Ok(()),
        }
    }

    /// Announces to the plant's host that this host leaves, if the run continues there, because its robots
    /// exit next.
    fn leave_if_needed(&mut self, ended: &Result<HostEnd, RunError>) {
        let knows = matches!(
            ended,
            Ok(HostEnd::RunEnded)
                | Err(RunError::PlantsHostFailed { .. } | RunError::PlantsHostLost { .. })
        );
        if knows || self.phase == Phase::Done {
            return;
        }
        self.reap_exited();
        self.phase = Phase::Done;
        let began = Instant::now();
        while began.elapsed() < LEAVE_ANNOUNCEMENT_TIME {
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
        let ended = Instant::now();
        self.unconfirmed_count = 1;
        while ended.elapsed() < DELIVERY_TIMEOUT
            && (ended.elapsed() < FLUSH_TIME || self.unconfirmed_count > 0)
        {
            self.run_iteration()?;
        }
        self.phase = Phase::Done;
        self.last_report_time = None;
        let done = Instant::now();
        let released = |share: &LocalRun<'_>| {
            share
                .newest_orders
                .is_some_and(|(header, _)| Phase::from_number(header.phase) == Some(Phase::Done))
        };
        while done.elapsed() < COORDINATOR_EXIT_TIMEOUT && !released(self) {
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
