//! The same brains and the same world without iceoryx2: over one mapping with a broadcast futex,
//! or over pipes. Its trajectory must equal that of the real thing bit by bit.
//!
//! Agents are processes of their own; the plant's half runs in the bench itself. There is no
//! supervisor: what is true at each tick is kept, and hashed after the clock has stopped.

use std::ffi::OsString;
use std::fs::File;
use std::path::{Path, PathBuf};
use std::time::Instant;

use agent::brain::Brain;
use clap::ValueEnum;
use experiment::briefs;
use experiment::scenario::Scenario;
use outcome::metrics::hash::TrajectoryHash;
use plant::world::World;
use protocol::barrier::Barrier;
use protocol::brief::{self, AgentBrief, Pace};
use protocol::message::{Beacon, Command, Odometry, TruthRow};
use protocol::process::{Alarm, Stop};
use protocol::run_root::RunRoot;

use crate::mapping::{Line, Mapping};
use crate::peers::{self, Peers};
use crate::{BenchError, HUNG_AFTER, Place, failed, pipe};

/// What carries the samples.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum Carrier {
    /// One mapping, and the lockstep barrier.
    Mapping,
    /// Two pipes for each robot, and one for each edge.
    Pipes,
}

impl Carrier {
    /// All of them.
    pub(crate) const ALL: [Carrier; 2] = [Carrier::Mapping, Carrier::Pipes];

    fn word(self) -> &'static str {
        match self {
            Carrier::Mapping => "mapping",
            Carrier::Pipes => "pipes",
        }
    }

    /// What it is called in the table.
    pub(crate) fn name(self) -> &'static str {
        match self {
            Carrier::Mapping => "mapping + futex",
            Carrier::Pipes => "pipes",
        }
    }
}

/// What a run over a floor gave.
pub(crate) struct FloorRun {
    /// Wall time from the first agent's start until all were ready, s.
    pub(crate) startup_s: f64,
    /// Ticks per second of wall time.
    pub(crate) ticks_per_s: f64,
    /// The trajectory's hash.
    pub(crate) hash: String,
}

/// One robot's place in the mapping. Beacons of even and of odd ticks: one is read while the other
/// is written.
#[repr(C)]
struct Seat {
    odometry: Line<Odometry>,
    command: Line<Command>,
    beacons: [Line<Beacon>; 2],
}

/// Runs a scenario without faults over this carrier.
pub(crate) fn run(
    root: &RunRoot,
    stop: &Stop,
    scenario: &Scenario,
    carrier: Carrier,
) -> Result<FloorRun, BenchError> {
    let place = Place::new(root, "floor")?;
    let dir = place.path();
    let robots = scenario.robots.len();
    let plant = briefs::plant(scenario, Pace::Lockstep, dir);
    let ticks = plant.duration_ns / plant.period_ns;
    let mut words: Vec<Vec<OsString>> = Vec::new();
    for i in 0..robots {
        let told = briefs::agent(scenario, i, Pace::Lockstep, dir);
        let path = dir.join(format!("brief-{i}.toml"));
        std::fs::write(&path, brief::to_text(&told)).map_err(failed("write", &path))?;
        words.push(vec!["peer".into(), "floor".into(), carrier.word().into(), path.into()]);
    }
    let mut plant_end: Box<dyn PlantEnd> = match carrier {
        Carrier::Mapping => Box::new(MappedPlant::new(dir, robots)?),
        Carrier::Pipes => Box::new(PipedPlant::new(dir, scenario)?),
    };

    let launched = Instant::now();
    let peers = Peers::start(dir, stop, words)?;
    peers.wait_ready()?;
    let startup_s = launched.elapsed().as_secs_f64();

    let mut world = World::new(&plant);
    let mut truths: Vec<TruthRow> = Vec::with_capacity((ticks as usize + 1) * robots);
    let began = Instant::now();
    for tick in 0..ticks {
        truths.extend(world.truth());
        plant_end.tell(&world, tick, &peers)?;
        for robot in 0..robots {
            let command = plant_end.command(robot, &peers)?;
            world.accept(robot, &command).map_err(|refusal| {
                BenchError::Wrong(format!(
                    "{}: robot {robot} at tick {tick}: {refusal}",
                    carrier.name()
                ))
            })?;
        }
        world.advance((tick + 1) * plant.period_ns);
        world.next_tick();
    }
    truths.extend(world.truth());
    let wall = began.elapsed();
    drop(peers);

    let mut hash = TrajectoryHash::new();
    for (tick, rows) in (0..).zip(truths.chunks(robots)) {
        hash.update(tick, rows);
    }
    let ticks_per_s = ticks as f64 / wall.as_secs_f64();
    Ok(FloorRun { startup_s, ticks_per_s, hash: hash.finish() })
}

/// The plant's end of a carrier.
trait PlantEnd {
    /// Gives every robot its odometry, and lets it answer.
    fn tell(&mut self, world: &World, tick: u64, peers: &Peers) -> Result<(), BenchError>;
    /// The robot's answer.
    fn command(&mut self, robot: usize, peers: &Peers) -> Result<Command, BenchError>;
}

/// An agent's end of a carrier.
trait AgentEnd {
    /// The next odometry.
    fn odometry(&mut self) -> Result<Odometry, BenchError>;
    /// The beacon of the tick before from the neighbour at `place`.
    fn beacon(&mut self, place: usize, tick: u64) -> Result<Beacon, BenchError>;
    /// Sends an answer.
    fn send(&mut self, beacon: &Beacon, command: &Command) -> Result<(), BenchError>;
}

struct MappedPlant {
    seats: Mapping<Seat>,
    barrier: Barrier,
}

impl MappedPlant {
    fn new(dir: &Path, robots: usize) -> Result<MappedPlant, BenchError> {
        let barrier = Barrier::create(&dir.join("barrier"), robots, 1, HUNG_AFTER)?;
        (0..robots).for_each(|slot| barrier.set_member(slot, 0));
        Ok(MappedPlant { seats: seats(dir, robots)?, barrier })
    }
}

fn seats(dir: &Path, robots: usize) -> Result<Mapping<Seat>, BenchError> {
    // SAFETY: messages are plain numbers, for which zeros are a value.
    unsafe { Mapping::new(&dir.join("seats"), robots) }
}

impl PlantEnd for MappedPlant {
    fn tell(&mut self, world: &World, tick: u64, peers: &Peers) -> Result<(), BenchError> {
        for (robot, seat) in self.seats.iter().enumerate() {
            seat.odometry.write(world.odometry(robot));
        }
        self.barrier.begin(tick);
        self.barrier.release(0);
        let mut checked = Ok(());
        let arrived = self.barrier.wait_arrivals(tick, || {
            checked = peers.check();
            checked.is_ok()
        });
        arrived.or(checked)
    }

    fn command(&mut self, robot: usize, _: &Peers) -> Result<Command, BenchError> {
        Ok(self.seats[robot].command.read())
    }
}

struct MappedAgent {
    seats: Mapping<Seat>,
    barrier: Barrier,
    epoch: u32,
    slot: usize,
    neighbors: Vec<usize>,
}

impl MappedAgent {
    fn new(dir: &Path, brief: &AgentBrief) -> Result<MappedAgent, BenchError> {
        let mut barrier = Barrier::open(&dir.join("barrier"))?;
        let alarm = Alarm::start();
        barrier.rely_on(alarm.map_err(failed("set an alarm for", dir))?);
        Ok(MappedAgent {
            seats: seats(dir, barrier.slots())?,
            epoch: barrier.epoch(brief.index - 1),
            barrier,
            slot: brief.index - 1,
            neighbors: brief.neighbors.iter().map(|neighbor| neighbor.index - 1).collect(),
        })
    }
}

impl AgentEnd for MappedAgent {
    fn odometry(&mut self) -> Result<Odometry, BenchError> {
        // Until it is killed.
        if let Some((epoch, _)) = self.barrier.wait_tick(self.slot, self.epoch, || true) {
            self.epoch = epoch;
        }
        Ok(self.seats[self.slot].odometry.read())
    }

    fn beacon(&mut self, place: usize, tick: u64) -> Result<Beacon, BenchError> {
        Ok(self.seats[self.neighbors[place]].beacons[tick as usize & 1].read())
    }

    fn send(&mut self, beacon: &Beacon, command: &Command) -> Result<(), BenchError> {
        let seat = &self.seats[self.slot];
        seat.beacons[beacon.tick as usize & 1].write(*beacon);
        seat.command.write(*command);
        self.barrier.arrive(self.slot, command.tick);
        Ok(())
    }
}

fn odometry_pipe(dir: &Path, robot: usize) -> PathBuf {
    dir.join(format!("odometry-{robot}"))
}

fn command_pipe(dir: &Path, robot: usize) -> PathBuf {
    dir.join(format!("command-{robot}"))
}

fn beacon_pipe(dir: &Path, from: usize, to: usize) -> PathBuf {
    dir.join(format!("beacon-{from}-{to}"))
}

struct PipedPlant {
    odometry: Vec<File>,
    command: Vec<File>,
}

impl PipedPlant {
    fn new(dir: &Path, scenario: &Scenario) -> Result<PipedPlant, BenchError> {
        let made = |path: PathBuf| pipe::make(&path).map(|()| path);
        for edge in scenario.graph.edges() {
            made(beacon_pipe(dir, edge.from, edge.to))?;
        }
        let robots = 0..scenario.robots.len();
        let odometry = robots.clone().map(|i| pipe::open(&made(odometry_pipe(dir, i))?));
        let command = robots.map(|i| pipe::open_for_reading(&made(command_pipe(dir, i))?));
        Ok(PipedPlant {
            odometry: odometry.collect::<Result<_, _>>()?,
            command: command.collect::<Result<_, _>>()?,
        })
    }
}

impl PlantEnd for PipedPlant {
    fn tell(&mut self, world: &World, _: u64, peers: &Peers) -> Result<(), BenchError> {
        for (robot, odometry) in self.odometry.iter().enumerate() {
            pipe::write(odometry, &world.odometry(robot)).map_err(|_| peers.why())?;
        }
        Ok(())
    }

    fn command(&mut self, robot: usize, peers: &Peers) -> Result<Command, BenchError> {
        pipe::read(&self.command[robot]).map_err(|_| peers.why())
    }
}

struct PipedAgent {
    odometry: File,
    command: File,
    heard: Vec<File>,
    hearers: Vec<File>,
}

impl PipedAgent {
    fn new(dir: &Path, brief: &AgentBrief) -> Result<PipedAgent, BenchError> {
        let own = brief.index - 1;
        let heard = brief.neighbors.iter().map(|n| pipe::open(&beacon_pipe(dir, n.index - 1, own)));
        let there = |path: &PathBuf| path.exists();
        // An agent is not told who hears it; the pipes that bear its number say so.
        let hearers = (0..robots_of(dir)).map(|to| beacon_pipe(dir, own, to)).filter(there);
        Ok(PipedAgent {
            odometry: pipe::open_for_reading(&odometry_pipe(dir, own))?,
            command: pipe::open_for_writing(&command_pipe(dir, own))?,
            heard: heard.collect::<Result<_, _>>()?,
            hearers: hearers.map(|path| pipe::open(&path)).collect::<Result<_, _>>()?,
        })
    }
}

/// How many robots there are: as many as pipes for odometry.
fn robots_of(dir: &Path) -> usize {
    (0..).take_while(|&i| odometry_pipe(dir, i).exists()).count()
}

impl AgentEnd for PipedAgent {
    fn odometry(&mut self) -> Result<Odometry, BenchError> {
        pipe::read(&self.odometry).map_err(failed("read", Path::new("odometry")))
    }

    fn beacon(&mut self, place: usize, _: u64) -> Result<Beacon, BenchError> {
        pipe::read(&self.heard[place]).map_err(failed("read", Path::new("a beacon")))
    }

    fn send(&mut self, beacon: &Beacon, command: &Command) -> Result<(), BenchError> {
        for hearer in &self.hearers {
            pipe::write(hearer, beacon).map_err(failed("write", Path::new("a beacon")))?;
        }
        pipe::write(&self.command, command).map_err(failed("write", Path::new("a command")))
    }
}

/// What an agent's process does, until it is killed: what an agent of a lockstep run without
/// faults does.
pub(crate) fn agent(carrier: Carrier, brief_path: &Path) -> Result<(), BenchError> {
    let brief: AgentBrief = brief::read(brief_path)?;
    let dir = brief.run_root.clone();
    let mut brain = Brain::new(&brief, 0)?;
    let mut end: Box<dyn AgentEnd> = match carrier {
        Carrier::Mapping => Box::new(MappedAgent::new(&dir, &brief)?),
        Carrier::Pipes => Box::new(PipedAgent::new(&dir, &brief)?),
    };
    peers::say_ready(&dir, brief.index - 1)?;
    loop {
        let odometry = end.odometry()?;
        if let Some(before) = odometry.tick.checked_sub(1) {
            for place in 0..brief.neighbors.len() {
                let beacon = end.beacon(place, before)?;
                let heard = brain.hear(place, &beacon, odometry.stamp_ns);
                heard.map_err(|refusal| BenchError::Wrong(format!("beacon refused: {refusal}")))?;
            }
        }
        let answer = brain.answer(&odometry, odometry.stamp_ns);
        let answer = answer.ok_or_else(|| BenchError::Wrong("no answer to a sample".into()))?;
        end.send(&answer.beacon, &answer.command)?;
    }
}
