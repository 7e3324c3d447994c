//! Round trip: an odometry sample to another process, and a command back.
//!
//! Ours is one lockstep tick of one robot: plant, iceoryx2, barrier, and a real agent with its controller.
//! The baselines transport the same two messages between two processes, without any computation. Each end
//! has a core of its own.

use std::time::{Duration, Instant};

use anyhow::{Context as _, anyhow, bail};
use clap::ValueEnum as _;
use experiment::briefs;
use plant::world::World;
use protocol::barrier::Barrier;
use protocol::brief::{self, Pace};
use protocol::clock;
use protocol::message::{Command, Odometry};
use protocol::run_root;
use protocol::service::{self, Factory, Node, Publisher, Qos, Subscriber};
use supervisor::spawn::{Launcher, Role};

use crate::cores::{Cores, on_the_last};
use crate::peers::{Peers, Post};
use crate::quantiles::{QUANTILES, quantiles_us};
use crate::rounds::{Case, Setting};
use crate::run::dead;
use crate::transport::{Channel, Transport, make_pipe};
use crate::{HUNG_AFTER, Interrupted, Place, ring, write};

/// Number of round trips by each transport per second of a round; five rounds of a full bench make 100,000.
const TRIPS_PER_S: f64 = 20_000.0;
/// Factor by which a transport may exceed the duration of a round, before it is stopped.
const TRIPS_LIMIT: f64 = 10.0;
/// Maximum time for a robot to become ready, and for a tick.
const READY_MAX: Duration = Duration::from_secs(10);
const READY_EVERY: Duration = Duration::from_millis(1);
/// Number of round trips that are not measured: caches are cold, and the robot opens its connections.
const WARM_UP: usize = 200;
/// Period (T) of the single robot, s, of simulated time.
const PERIOD_S: f64 = 0.005;
/// Number of quantiles shown: p50 and p99.
const SHOWN: usize = 2;

/// Returns the case of a robot's round trip and that of each transport.
pub(crate) fn cases<'a>(setting: &'a Setting<'_>) -> anyhow::Result<Vec<Case<'a>>> {
    run_root::join(setting.root.path())?;
    let node = service::node("bench")?;
    let mut round = 0;
    Ok(vec![Case::new("round trip", move |table| {
        round += 1;
        let cores = Cores::pin_this_thread();
        let trips = Trips { setting, cores: cores.as_ref(), node: &node, round };
        let names = || QUANTILES.iter().map(|(_, name, _)| format!("{name}, us")).take(SHOWN);
        for (name, us) in names().zip(trips.an_agent()?) {
            table.run(&name, us);
        }
        for &transport in Transport::value_variants() {
            for (name, us) in names().zip(trips.bare(transport)?) {
                table.baseline(&name, transport.name(), us);
            }
        }
        Ok(())
    })])
}

/// Settings of the round trips of one round.
struct Trips<'a> {
    setting: &'a Setting<'a>,
    cores: Option<&'a Cores>,
    node: &'a Node,
    round: usize,
}

impl Trips<'_> {
    fn count(&self) -> usize {
        ((TRIPS_PER_S * self.setting.seconds) as usize).max(1)
    }

    /// Measures round trips until there are enough or the time is over.
    fn timed(
        &self,
        mut trip: impl FnMut(u64) -> anyhow::Result<()>,
    ) -> anyhow::Result<[f64; QUANTILES.len()]> {
        for tick in 0..WARM_UP {
            trip(tick as u64)?;
        }
        let limit = Duration::from_secs_f64(TRIPS_LIMIT * self.setting.seconds);
        let mut trips_ns = Vec::with_capacity(self.count());
        let began = Instant::now();
        let mut last = began;
        for tick in (WARM_UP as u64..).take(self.count()) {
            trip(tick)?;
            let now = Instant::now();
            trips_ns.push((now - last).as_nanos() as u64);
            last = now;
            self.setting.check_signals()?;
            if now - began > limit {
                break;
            }
        }
        Ok(quantiles_us(trips_ns).expect("at least one trip"))
    }

    /// Measures a real agent, with the bench in place of the plant.
    fn an_agent(&self) -> anyhow::Result<[f64; QUANTILES.len()]> {
        let Trips { setting, cores, node, round } = self;
        let root = setting.root;
        let name = format!("alone-{round}");
        let ticks = (WARM_UP + self.count()) as u64;
        let scenario = ring::read(&ring::alone(&name, ticks, PERIOD_S))?;
        let brief = briefs::agent(&scenario, 0, Pace::Lockstep, root.path());
        let plant = briefs::plant(&scenario, Pace::Lockstep, root.path());
        let own = create(&name, node)?;
        // Not received by any process.
        let _others = (
            service::beacon(&name).create(node, Qos::of_robot(Pace::Lockstep, 0))?,
            service::status(&name).create(node, Qos::of_status(1))?,
            service::latency(&name).create(node, Qos::of_latency(1))?,
        );
        let barrier = Barrier::create(&root.barrier_path(), 1, 1, HUNG_AFTER)?;
        barrier.set_member(0, 0);
        let place = Place::new(root, &name)?;
        let path = place.path().join("brief.toml");
        write(&path, &brief::to_text(&brief))?;
        let (odometry, command) = ports_of(&own)?;
        let role = Role::Agent { brief: &path, program: None, incarnation: 0 };
        let log = place.path().join("agent.log");
        let mut agent = on_the_last(*cores, || Launcher::of_this_executable().spawn(role, &log))?;
        let mut lives = || match agent.ended() {
            _ if setting.stop.requested() => Err(Interrupted.into()),
            None => Ok(()),
            Some(_) => Err(dead("the agent ended early", &agent)),
        };
        let began = Instant::now();
        while own.1.number_of_publishers() == 0 {
            lives()?;
            if began.elapsed() > READY_MAX {
                bail!("the agent was not ready in time");
            }
            std::thread::sleep(READY_EVERY);
        }
        let mut world = World::new(&plant);
        self.timed(|tick| {
            odometry.send_copy(Odometry { sent_ns: clock::now_ns(), ..world.odometry(0) })?;
            barrier.begin(tick);
            barrier.release(0);
            let (began, mut lived) = (Instant::now(), Ok(()));
            let arrived = barrier.wait_arrivals(tick, || {
                lived = lives();
                lived.is_ok() && began.elapsed() < READY_MAX
            });
            lived?;
            arrived.map_err(|_| anyhow!("the agent did not answer in time"))?;
            let answer = command.receive()?.filter(|answer| answer.tick == tick);
            let answer = answer.with_context(|| format!("no command at tick {tick}"))?;
            world.accept(0, &answer).map_err(|refusal| anyhow!("{refusal}"))?;
            world.advance((tick + 1) * plant.period_ns);
            world.next_tick();
            Ok(())
        })
    }

    /// Measures a baseline: the bench, and a peer that replies at once.
    fn bare(&self, transport: Transport) -> anyhow::Result<[f64; QUANTILES.len()]> {
        let Trips { setting, cores, node, round } = self;
        let place = Place::new(setting.root, &format!("{}-{round}", transport.word()))?;
        let dir = place.path();
        let services = transport.is_iceoryx2().then(|| create(&name(dir), node)).transpose()?;
        if transport == Transport::Pipe {
            make_pipe(&dir.join("odometry"))?;
            make_pipe(&dir.join("command"))?;
        }
        let (publisher, subscriber) = services.as_ref().map(ports_of).transpose()?.unzip();
        let odometry = Channel::sending(transport, &dir.join("odometry"), true, publisher)?;
        let mut command =
            Channel::<Command>::receiving(transport, &dir.join("command"), subscriber)?;
        let words = [transport.word().into()];
        let peers =
            on_the_last(*cores, || Peers::start(dir, setting.stop, 1, "round-trip", &words))?;
        peers.wait_ready()?;
        self.timed(|tick| {
            let sent = odometry.send(&Odometry { tick, ..Odometry::default() });
            sent.map_err(|_| peers.why())?;
            let answer = command.receive(|| peers.gone()).map_err(|_| peers.why())?;
            match answer.ok_or_else(|| peers.why())? {
                answer if answer.tick == tick => Ok(()),
                other => bail!("{}: {} came back for {tick}", transport.name(), other.tick),
            }
        })
    }
}

/// Replies to every sample until killed.
pub(crate) fn peer(post: &Post, transport: Transport) -> anyhow::Result<()> {
    let dir = &post.dir;
    let ports = || {
        run_root::join(dir.parent().context("it is below the run root")?)?;
        let (node, robot) = (service::node("echo")?, name(dir));
        let publisher = service::command(&robot).open(&node)?.publisher()?;
        anyhow::Ok((publisher, service::odometry(&robot).open(&node)?.subscriber()?))
    };
    let (publisher, subscriber) = transport.is_iceoryx2().then(ports).transpose()?.unzip();
    let mut odometry =
        Channel::<Odometry>::receiving(transport, &dir.join("odometry"), subscriber)?;
    let command = Channel::sending(transport, &dir.join("command"), false, publisher)?;
    post.report_ready()?;
    while let Some(Odometry { tick, .. }) = odometry.receive(|| false)? {
        command.send(&Command { tick, ..Command::default() })?;
    }
    Ok(())
}

/// Creates the two services of one robot.
fn create(name: &str, node: &Node) -> anyhow::Result<(Factory<Odometry>, Factory<Command>)> {
    let one = Qos::of_robot(Pace::Lockstep, 1);
    Ok((service::odometry(name).create(node, one)?, service::command(name).create(node, one)?))
}

/// Opens the ports of the requesting end: odometry is sent, commands are received.
fn ports_of(
    services: &(Factory<Odometry>, Factory<Command>),
) -> anyhow::Result<(Publisher<Odometry>, Subscriber<Command>)> {
    Ok((services.0.publisher()?, services.1.subscriber()?))
}

/// Returns the name of the robot of this directory.
fn name(dir: &std::path::Path) -> String {
    dir.file_name().unwrap_or_default().to_string_lossy().into_owned()
}
