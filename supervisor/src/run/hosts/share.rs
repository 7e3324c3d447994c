//! The share of a host without the plant: its robots' processes and its bridge, as the plant's host
//! wants them. Must not: decide anything by itself, but that the plant's host is lost.

use std::collections::BTreeMap;
use std::os::unix::process::ExitStatusExt as _;
use std::path::PathBuf;
use std::time::{Duration, Instant};

use protocol::brief::{AgentBrief, BridgeBrief, Pace};
use protocol::message::{
    Beacon, BridgeHeader, Command, LatencyHeader, LatencyRow, NeighborStatus, Odometry,
    OrderHeader, OrderRow, PeerRow, Phase, ReportHeader, ReportRow, StatusHeader, Wanted,
};
use protocol::process::Stop;
use protocol::service::{self, Factory, Node, Publisher, Qos, Subscriber, send_slice};
use rustix::event::{PollFd, PollFlags, Timespec, poll};

use crate::child::Child;
use crate::dead_nodes::{Cleaner, Dead};
use crate::room;
use crate::run::RunError;
use crate::run::kept::{Kept, Which};
use crate::run::launch::make_run_root;
use crate::spawn::{Launcher, Role};
use experiment::briefs;
use experiment::scenario::Scenario;
use outcome::results::host_dir::HostDir;
use outcome::results::programs::Started;

/// How long one turn of the loop waits for news.
const TURN: Duration = Duration::from_millis(2);
/// How often the plant's host is told.
const REPORT_EVERY: Duration = Duration::from_millis(20);
/// Processes asked to end are killed after this.
const GRACE: Duration = Duration::from_secs(2);
/// How long what the robots told may take to be confirmed, once they have ended.
const HANDOVER_MAX: Duration = Duration::from_secs(4);
/// The bridge takes what the robots said last within this.
const HANDOVER_MIN: Duration = Duration::from_millis(150);
/// How long the end of the plant's host is waited for.
const DONE_MAX: Duration = Duration::from_secs(2);

/// How a share ended.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Ended {
    /// With the run.
    WithTheRun,
    /// By a signal.
    Interrupted,
}

/// All services of the share, kept in being.
struct Services {
    _odometry: Vec<Factory<Odometry>>,
    _command: Vec<Factory<Command>>,
    _beacon: Vec<Factory<Beacon>>,
    _status: Vec<Factory<[NeighborStatus], StatusHeader>>,
    _latency: Vec<Factory<[LatencyRow], LatencyHeader>>,
    orders: Factory<[OrderRow], OrderHeader>,
    report: Factory<[ReportRow], ReportHeader>,
    bridge: Factory<[PeerRow], BridgeHeader>,
}

impl Services {
    /// Of the robots of this host, and of those elsewhere that they hear.
    fn create(
        node: &Node,
        brief: &BridgeBrief,
        scenario: &Scenario,
    ) -> Result<Services, service::ServiceError> {
        let here = brief.here;
        let is_here = |robot: usize| brief.robots[robot].host == here;
        let name = |robot: usize| scenario.robots[robot].name.as_str();
        let own = || (0..scenario.robots.len()).filter(|&robot| is_here(robot));
        let hearers = |robot: usize| {
            let hearers = scenario.graph.edges().iter().filter(|edge| edge.from == robot);
            hearers.filter(|edge| is_here(edge.to)).count()
        };
        let heard =
            (0..scenario.robots.len()).filter(|&robot| is_here(robot) || hearers(robot) > 0);
        let one = Qos::of_robot(Pace::Realtime, 1).and_one_more();
        let host = brief.hosts[here].name.as_str();
        let hosts = Qos::of_hosts(1);
        Ok(Services {
            _odometry: own()
                .map(|robot| service::odometry(name(robot)).create(node, one))
                .collect::<Result<_, _>>()?,
            _command: own()
                .map(|robot| service::command(name(robot)).create(node, one))
                .collect::<Result<_, _>>()?,
            _beacon: heard
                .map(|robot| {
                    let qos = Qos::of_robot(Pace::Realtime, hearers(robot)).and_one_more();
                    service::beacon(name(robot)).create(node, qos)
                })
                .collect::<Result<_, _>>()?,
            _status: own()
                .map(|robot| service::status(name(robot)).create(node, Qos::of_status(1)))
                .collect::<Result<_, _>>()?,
            _latency: own()
                .map(|robot| service::latency(name(robot)).create(node, Qos::of_latency(1)))
                .collect::<Result<_, _>>()?,
            orders: service::orders(host).create(node, hosts)?,
            report: service::report(host).create(node, hosts)?,
            bridge: service::bridge(host).create(node, hosts)?,
        })
    }
}

/// One robot of this host.
struct Robot {
    name: String,
    brief: PathBuf,
    program: Option<Started>,
    log: PathBuf,
    child: Option<Child>,
    stopped: bool,
    report: ReportRow,
}

/// The share under way.
struct Share<'a> {
    brief: &'a BridgeBrief,
    launcher: &'a Launcher,
    stop: &'a Stop,
    robots: BTreeMap<u64, Robot>,
    bridge: Kept,
    cleaner: Cleaner,
    orders: Subscriber<[OrderRow], OrderHeader>,
    report: Publisher<[ReportRow], ReportHeader>,
    bridges: Subscriber<[PeerRow], BridgeHeader>,
    /// What the plant's host said last, and when.
    ordered: Option<(OrderHeader, Instant)>,
    unconfirmed: u64,
    phase: Phase,
    sequence: u64,
    reported: Option<Instant>,
}

/// Runs the share of this host to the run's end. `brief`: of the bridge, but for the run root.
pub fn run(
    scenario: &Scenario,
    brief: BridgeBrief,
    launcher: &Launcher,
    host_dir: &HostDir,
    stop: &Stop,
) -> Result<Ended, RunError> {
    let own = brief.robots.iter().filter(|robot| robot.host == brief.here);
    let links = own.clone().map(|robot| robot.hears).sum();
    let run_root = make_run_root(own.count(), links)?;
    let brief = BridgeBrief { run_root: run_root.path().into(), ..brief };
    let node = service::node("supervisor")?;
    let services = Services::create(&node, &brief, scenario)?;
    let cleaner = Cleaner::start(&run_root, &node)?;
    room::take(run_root.path())?;
    let told = host_dir.write_brief("bridge", &brief)?;
    let bridge = Kept::start(Which::Bridge, launcher, told, host_dir.log_path("bridge"))?;
    let mut robots = BTreeMap::new();
    for (place, robot) in scenario.robots.iter().enumerate() {
        if brief.robots[place].host != brief.here {
            continue;
        }
        let told = briefs::agent(scenario, place, Pace::Realtime, run_root.path());
        let told =
            host_dir.write_brief(&robot.name, &AgentBrief { links_by_hand: false, ..told })?;
        let program = scenario.program(place).map(|program| host_dir.started(program));
        let number = place as u64 + 1;
        robots.insert(
            number,
            Robot {
                name: robot.name.clone(),
                brief: told,
                program: program.transpose()?,
                log: host_dir.log_path(&robot.name),
                child: None,
                stopped: false,
                report: ReportRow { robot: number, ..ReportRow::default() },
            },
        );
    }
    let mut share = Share {
        brief: &brief,
        launcher,
        stop,
        robots,
        bridge,
        cleaner,
        orders: services.orders.subscriber()?,
        report: services.report.publisher(scenario.robots.len())?,
        bridges: services.bridge.subscriber()?,
        ordered: None,
        unconfirmed: 0,
        phase: Phase::Gathering,
        sequence: 0,
        reported: None,
    };
    let ended = share.turn_until_the_end();
    share.end_robots(Instant::now());
    share.bridge.end(GRACE);
    drop(share);
    drop((services, node));
    if let Err(error) = run_root.remove() {
        tracing::warn!(%error, "could not remove the run root");
    }
    ended
}

impl Share<'_> {
    fn turn_until_the_end(&mut self) -> Result<Ended, RunError> {
        let began = Instant::now();
        loop {
            if self.stop.requested() {
                return Ok(Ended::Interrupted);
            }
            self.turn()?;
            self.must_be_heard(began)?;
            let Some((header, _)) = self.ordered else { continue };
            if header.failed == 1 {
                self.phase = Phase::Done;
                self.reported = None;
                self.tell()?;
                return Err(RunError::PlantsHostFailed { host: self.plants_host() });
            }
            if Phase::from_number(header.phase) >= Some(Phase::Ending) {
                self.hand_over()?;
                return Ok(Ended::WithTheRun);
            }
        }
    }

    fn plants_host(&self) -> String {
        self.brief.hosts[self.brief.plant].name.clone()
    }

    /// Takes in what there is, does what is wanted, and tells how it is.
    fn turn(&mut self) -> Result<(), RunError> {
        self.wait_for_news();
        while let Some(sample) = self.bridges.receive()? {
            self.unconfirmed = sample.user_header().unconfirmed;
        }
        let mut wanted = None;
        while let Some(sample) = self.orders.receive()? {
            self.ordered = Some((*sample.user_header(), Instant::now()));
            wanted = Some(sample.payload().to_vec());
        }
        self.bury();
        if let Some(died) = self.bridge.watch(&self.cleaner) {
            let how = RunError::unless_it_comes_back(died)?;
            tracing::warn!(%how, "the bridge died, and is started anew");
        }
        while let Some(dead) = self.cleaner.done() {
            match dead {
                Dead::Robot(number) => {
                    let robot = self.robots.get_mut(&(number as u64));
                    robot.expect("its clean-up was asked for here").report.cleaned += 1;
                }
                Dead::Bridge => self.bridge.cleaned()?,
                Dead::Ros2 => {}
            }
        }
        if let (Some(rows), Some((header, _))) = (wanted, self.ordered)
            && Phase::from_number(header.phase) == Some(Phase::Running)
        {
            self.phase = self.phase.max(Phase::Running);
            self.obey(&rows)?;
        }
        self.tell()
    }

    fn wait_for_news(&self) {
        let children = self.robots.values().filter_map(|robot| robot.child.as_ref());
        let children = children.chain(self.bridge.child());
        let mut news: Vec<PollFd<'_>> =
            children.map(|child| PollFd::from_borrowed_fd(child.pidfd(), PollFlags::IN)).collect();
        news.push(PollFd::from_borrowed_fd(self.cleaner.news(), PollFlags::IN));
        let turn = Timespec { tv_sec: 0, tv_nsec: TURN.as_nanos() as i64 };
        // An interruption is a turn without news.
        let _ = poll(&mut news, Some(&turn));
    }

    /// Lets processes be as they are to be.
    fn obey(&mut self, rows: &[OrderRow]) -> Result<(), RunError> {
        for row in rows {
            let Some(robot) = self.robots.get_mut(&row.robot) else { continue };
            let report = &mut robot.report;
            match &robot.child {
                Some(child) if report.starts < row.starts => child.kill(),
                Some(child) => match Wanted::from_number(row.wanted) {
                    Some(Wanted::Killed) => child.kill(),
                    Some(Wanted::Stopped) if !robot.stopped => {
                        child.stop();
                        robot.stopped = true;
                    }
                    Some(Wanted::Running) if robot.stopped => {
                        child.go_on();
                        robot.stopped = false;
                    }
                    _ => {}
                },
                // What the one before left is removed first.
                None if report.starts < row.starts && report.cleaned == report.starts => {
                    let role = Role::Agent {
                        brief: &robot.brief,
                        program: robot.program.as_ref(),
                        incarnation: row.starts - 1,
                    };
                    robot.child = Some(self.launcher.spawn(role, &robot.log)?);
                    robot.stopped = false;
                    // Whoever was never started here is as good as cleaned up.
                    report.cleaned = row.starts - 1;
                    (report.starts, report.ended, report.status) = (row.starts, 0, 0);
                }
                None => {}
            }
        }
        Ok(())
    }

    /// Reaps the dead.
    fn bury(&mut self) {
        for (number, robot) in &mut self.robots {
            let Some(status) = robot.child.as_mut().and_then(Child::ended) else { continue };
            robot.child = None;
            robot.report.ended = 1;
            robot.report.status = status.into_raw() as u32 as u64;
            self.cleaner.request(Dead::Robot(*number as usize));
            self.reported = None;
            if self.phase < Phase::Ending {
                tracing::warn!(robot = robot.name, how = crate::child::in_words(status), "ended");
            }
        }
    }

    /// Tells the plant's host how it is, if it is time.
    fn tell(&mut self) -> Result<(), RunError> {
        if self.reported.is_some_and(|at| at.elapsed() < REPORT_EVERY) {
            return Ok(());
        }
        self.reported = Some(Instant::now());
        self.sequence += 1;
        let header = ReportHeader {
            sequence: self.sequence,
            phase: self.phase as u64,
            bridge_restarts: self.bridge.restarts(),
        };
        let rows: Vec<ReportRow> = self.robots.values().map(|robot| robot.report).collect();
        send_slice(&self.report, header, rows.len(), |row| rows[row])?;
        Ok(())
    }

    /// Without a sign of the plant's host there is no run here either.
    fn must_be_heard(&self, began: Instant) -> Result<(), RunError> {
        let brief = self.brief;
        match self.ordered {
            Some((_, at)) if at.elapsed() > Duration::from_nanos(brief.silence_ns_max) => {
                Err(RunError::PlantsHostLost { host: self.plants_host(), silent: at.elapsed() })
            }
            None if began.elapsed() > Duration::from_nanos(brief.join_within_ns) => {
                let (hosts, waited) = (self.plants_host(), began.elapsed());
                Err(RunError::HostsMissing { hosts, waited, dropped: String::new() })
            }
            _ => Ok(()),
        }
    }

    /// The run is over: ends the robots, and waits until what they told has arrived.
    fn hand_over(&mut self) -> Result<(), RunError> {
        self.phase = Phase::Ending;
        let began = Instant::now();
        self.end_robots(began);
        let ended = Instant::now();
        self.unconfirmed = 1;
        while ended.elapsed() < HANDOVER_MAX
            && (ended.elapsed() < HANDOVER_MIN || self.unconfirmed > 0)
        {
            self.turn()?;
        }
        self.phase = Phase::Done;
        self.reported = None;
        let done = Instant::now();
        let released = |share: &Share<'_>| {
            share
                .ordered
                .is_some_and(|(header, _)| Phase::from_number(header.phase) == Some(Phase::Done))
        };
        while done.elapsed() < DONE_MAX && !released(self) {
            self.turn()?;
        }
        Ok(())
    }

    /// Asks all robots to end, and kills those that do not.
    fn end_robots(&mut self, asked: Instant) {
        let mut killed = false;
        for child in self.robots.values().filter_map(|robot| robot.child.as_ref()) {
            child.terminate();
        }
        while self.robots.values().any(|robot| robot.child.is_some()) {
            if !killed && asked.elapsed() > GRACE {
                killed = true;
                for child in self.robots.values().filter_map(|robot| robot.child.as_ref()) {
                    tracing::warn!("{} did not end when asked, and was killed", child.name());
                    child.kill();
                }
            } else if asked.elapsed() > 2 * GRACE {
                tracing::error!("a killed process does not end; the kernel holds it");
                return;
            }
            self.bury();
            std::thread::sleep(Duration::from_millis(1));
        }
    }
}
