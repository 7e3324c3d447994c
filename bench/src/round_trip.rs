//! Round trip of an odometry sample to another process and a command back.
//!
//! For Phalanx it is one lockstep tick of one robot: the plant, iceoryx2, the barrier and a real agent with its
//! controller. The baselines carry the same two messages between two processes without a controller. Each end has a
//! core of its own.

use std::time::{Duration, Instant};

use anyhow::{Context as _, anyhow, bail};
use clap::ValueEnum as _;
use experiment::briefs;
use plant::world::World;
use protocol::barrier::Barrier;
use protocol::brief::{Brief as _, Pace};
use protocol::clock;
use protocol::message::{Command, Odometry};
use protocol::run_root;
use protocol::service::{self, Factory, Node, Publisher, Qos, Subscriber};
use supervisor::spawn::{Launcher, ProcessRole};

use crate::cores::{PinnedCores, start_on_last_core};
use crate::peers::{PeerAddress, Peers};
use crate::quantiles::{QUANTILES, quantiles_us};
use crate::rounds::{BenchCase, BenchSettings};
use crate::run::exit_error;
use crate::transport::{Channel, Transport, make_pipe};
use crate::{Interrupted, RESPONSE_TIMEOUT, WorkDir, ring, write_file};

/// Number of round trips over each transport per second of the nominal duration; the five rounds of a full bench make
/// 100,000.
const TRIPS_PER_S: f64 = 20_000.0;
/// Maximum duration of the trips over one transport, as a multiple of the nominal duration. Slower ones are cut off.
const DURATION_FACTOR_MAX: f64 = 10.0;
/// Maximum time until the agent is ready, and for each tick. The measurement fails after it.
const READY_DURATION_MAX: Duration = Duration::from_secs(10);
/// Polling interval for the readiness of the agent.
const READY_POLL_INTERVAL: Duration = Duration::from_millis(1);
/// Number of trips before the measurement, which fill the caches and pass the one-time work of the robot.
const WARM_UP_TRIPS: usize = 200;
/// Control period (T) of the single robot in simulated time, s.
const PERIOD_S: f64 = 0.005;
/// Number of quantiles shown: p50 and p99.
const SHOWN_QUANTILE_COUNT: usize = 2;

/// Returns one case, with the round trip of a robot and of each transport.
pub(crate) fn cases<'a>(settings: &'a BenchSettings<'_>) -> anyhow::Result<Vec<BenchCase<'a>>> {
    run_root::join(settings.root.path())?;
    let node = service::create_node("bench")?;
    let mut round = 0;
    Ok(vec![BenchCase::new("round trip", move |table| {
        round += 1;
        let cores = PinnedCores::pin_to_first();
        let trips = RoundTrips { settings, cores: cores.as_ref(), node: &node, round };
        let names = || {
            QUANTILES.iter().map(|(_, name, _)| format!("{name}, us")).take(SHOWN_QUANTILE_COUNT)
        };
        for (name, us) in names().zip(trips.measure_agent()?) {
            table.record_run(&name, us);
        }
        for &transport in Transport::value_variants() {
            for (name, us) in names().zip(trips.measure_transport(transport)?) {
                table.record_baseline(&name, transport.name(), us);
            }
        }
        Ok(())
    })])
}

/// Setting of the round trips of one round.
struct RoundTrips<'a> {
    settings: &'a BenchSettings<'a>,
    cores: Option<&'a PinnedCores>,
    node: &'a Node,
    round: usize,
}

impl RoundTrips<'_> {
    fn count(&self) -> usize {
        ((TRIPS_PER_S * self.settings.duration_s) as usize).max(1)
    }

    /// Measures trips until their number or the maximum duration is reached, and returns their quantiles, us.
    fn measure(
        &self,
        mut trip: impl FnMut(u64) -> anyhow::Result<()>,
    ) -> anyhow::Result<[f64; QUANTILES.len()]> {
        for tick in 0..WARM_UP_TRIPS {
            trip(tick as u64)?;
        }
        let limit = Duration::from_secs_f64(DURATION_FACTOR_MAX * self.settings.duration_s);
        let mut trips_ns = Vec::with_capacity(self.count());
        let start = Instant::now();
        let mut last_time = start;
        for tick in (WARM_UP_TRIPS as u64..).take(self.count()) {
            trip(tick)?;
            let now = Instant::now();
            trips_ns.push((now - last_time).as_nanos() as u64);
            last_time = now;
            self.settings.check_interrupted()?;
            if now - start > limit {
                break;
            }
        }
        Ok(quantiles_us(trips_ns).expect("at least one trip"))
    }

    /// Measures Phalanx: the bench acts as the plant of a real agent.
    fn measure_agent(&self) -> anyhow::Result<[f64; QUANTILES.len()]> {
        let RoundTrips { settings, cores, node, round } = self;
        let root = settings.root;
        let name = format!("alone-{round}");
        let ticks = (WARM_UP_TRIPS + self.count()) as u64;
        let scenario = ring::parse_scenario(&ring::single_robot_text(&name, ticks, PERIOD_S))?;
        let brief = briefs::agent_brief(&scenario, 0, Pace::Lockstep, root.path());
        let plant = briefs::plant_brief(&scenario, Pace::Lockstep, root.path());
        let services = create_services(&name, node)?;
        // The agent needs these services, but no process receives from them.
        let _other_services = (
            service::beacon_topic(&name).create(node, Qos::for_robot(Pace::Lockstep, 0))?,
            service::status_topic(&name).create(node, Qos::for_status(1))?,
            service::latency_topic(&name).create(node, Qos::for_latency(1))?,
        );
        let barrier = Barrier::create(&root.barrier_path(), 1, 1, RESPONSE_TIMEOUT)?;
        barrier.set_member(0, 0);
        let work_dir = WorkDir::new(root, &name)?;
        let path = work_dir.path().join("brief.toml");
        write_file(&path, &brief.to_toml())?;
        let (odometry, command) = open_ports(&services)?;
        let role = ProcessRole::Agent { brief: &path, program: None, incarnation: 0 };
        let log = work_dir.path().join("agent.log");
        let mut agent =
            start_on_last_core(*cores, || Launcher::for_this_executable().spawn(role, &log))?;
        let mut check_agent = || match agent.try_reap() {
            _ if settings.stop.is_requested() => Err(Interrupted.into()),
            None => Ok(()),
            Some(_) => Err(exit_error("the agent exited early", &agent)),
        };
        let start = Instant::now();
        while services.1.number_of_publishers() == 0 {
            check_agent()?;
            if start.elapsed() > READY_DURATION_MAX {
                bail!("the agent was not ready within {} s", READY_DURATION_MAX.as_secs());
            }
            std::thread::sleep(READY_POLL_INTERVAL);
        }
        let mut world = World::new(&plant);
        self.measure(|tick| {
            odometry.send_copy(Odometry { sent_ns: clock::now_ns(), ..world.odometry(0) })?;
            barrier.begin_tick(tick);
            barrier.release_group(0);
            let (start, mut agent_state) = (Instant::now(), Ok(()));
            let result = barrier.wait_for_arrivals(tick, || {
                agent_state = check_agent();
                agent_state.is_ok() && start.elapsed() < READY_DURATION_MAX
            });
            agent_state?;
            result.map_err(|_| {
                anyhow!("the agent did not answer within {} s", READY_DURATION_MAX.as_secs())
            })?;
            let reply = command.receive()?.filter(|reply| reply.tick == tick);
            let reply = reply.with_context(|| format!("no command at tick {tick}"))?;
            world.accept_command(0, &reply).map_err(|refusal| anyhow!("{refusal}"))?;
            world.advance((tick + 1) * plant.period_ns);
            world.increment_tick();
            Ok(())
        })
    }

    /// Measures a baseline: a peer answers each sample immediately.
    fn measure_transport(&self, transport: Transport) -> anyhow::Result<[f64; QUANTILES.len()]> {
        let RoundTrips { settings, cores, node, round } = self;
        let work_dir =
            WorkDir::new(settings.root, &format!("{}-{round}", transport.to_argument()))?;
        let dir = work_dir.path();
        let services =
            transport.is_iceoryx2().then(|| create_services(&robot_name(dir), node)).transpose()?;
        if transport == Transport::Pipe {
            make_pipe(&dir.join("odometry"))?;
            make_pipe(&dir.join("command"))?;
        }
        let (publisher, subscriber) = services.as_ref().map(open_ports).transpose()?.unzip();
        let odometry = Channel::open_sender(transport, &dir.join("odometry"), true, publisher)?;
        let mut command =
            Channel::<Command>::open_receiver(transport, &dir.join("command"), subscriber)?;
        let arguments = [transport.to_argument().into()];
        let peers = start_on_last_core(*cores, || {
            Peers::start(dir, settings.stop, 1, "round-trip", &arguments)
        })?;
        peers.wait_ready()?;
        self.measure(|tick| {
            let result = odometry.send(&Odometry { tick, ..Odometry::default() });
            result.map_err(|_| peers.wait_for_failure())?;
            let reply =
                command.receive(|| peers.have_failed()).map_err(|_| peers.wait_for_failure())?;
            match reply.ok_or_else(|| peers.wait_for_failure())? {
                reply if reply.tick == tick => Ok(()),
                other => bail!(
                    "{}: the answer is for tick {}, must be for tick {tick}",
                    transport.name(),
                    other.tick
                ),
            }
        })
    }
}

/// Answers each sample until this peer is killed.
pub(crate) fn run_peer(address: &PeerAddress, transport: Transport) -> anyhow::Result<()> {
    let dir = &address.dir;
    let open_iceoryx2_ports = || {
        run_root::join(
            dir.parent().context("the directory of a peer must be below the run root")?,
        )?;
        let (node, robot) = (service::create_node("echo")?, robot_name(dir));
        let publisher = service::command_topic(&robot).open(&node)?.publisher()?;
        anyhow::Ok((publisher, service::odometry_topic(&robot).open(&node)?.subscriber()?))
    };
    let (publisher, subscriber) =
        transport.is_iceoryx2().then(open_iceoryx2_ports).transpose()?.unzip();
    let mut odometry =
        Channel::<Odometry>::open_receiver(transport, &dir.join("odometry"), subscriber)?;
    let command = Channel::open_sender(transport, &dir.join("command"), false, publisher)?;
    address.report_ready()?;
    while let Some(Odometry { tick, .. }) = odometry.receive(|| false)? {
        command.send(&Command { tick, ..Command::default() })?;
    }
    Ok(())
}

/// Creates the odometry and command services of one robot.
fn create_services(
    name: &str,
    node: &Node,
) -> anyhow::Result<(Factory<Odometry>, Factory<Command>)> {
    let qos = Qos::for_robot(Pace::Lockstep, 1);
    Ok((
        service::odometry_topic(name).create(node, qos)?,
        service::command_topic(name).create(node, qos)?,
    ))
}

/// Opens the ports of the plant's end: an odometry publisher and a command subscriber.
fn open_ports(
    services: &(Factory<Odometry>, Factory<Command>),
) -> anyhow::Result<(Publisher<Odometry>, Subscriber<Command>)> {
    Ok((services.0.publisher()?, services.1.subscriber()?))
}

/// Returns the name of the robot of this directory.
fn robot_name(dir: &std::path::Path) -> String {
    dir.file_name().unwrap_or_default().to_string_lossy().into_owned()
}
