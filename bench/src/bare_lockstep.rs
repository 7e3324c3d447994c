//! Lockstep baseline without iceoryx2: the same controllers and plant over one shared mapping, with the
//! lockstep barrier. Its trajectory must equal that of a run bit by bit.
//!
//! Agents are separate processes; the plant runs in the bench itself. There is no supervisor: the ground
//! truth of each tick is stored, and hashed after the measurement.

use std::path::Path;
use std::time::Instant;

use agent::controller::Controller;
use anyhow::{Context as _, anyhow};
use experiment::briefs;
use experiment::scenario::Scenario;
use outcome::metrics::hash::TrajectoryHash;
use plant::world::World;
use protocol::barrier::Barrier;
use protocol::brief::{self, AgentBrief, Pace};
use protocol::message::{Beacon, Command, Odometry, TruthRow};
use protocol::process::Alarm;
use protocol::run_root::barrier_path;

use crate::memory::{Line, Mapping};
use crate::peers::{self, Peers, Post};
use crate::rounds::Setting;
use crate::{HUNG_AFTER, Place};

/// Result of a run without iceoryx2.
pub(crate) struct BareRun {
    /// Wall time from the start of the first agent until all were ready, s.
    pub(crate) startup_s: f64,
    /// Ticks per second of wall time.
    pub(crate) ticks_per_s: f64,
    /// Trajectory hash.
    pub(crate) hash: String,
}

/// Slot of one robot in the mapping. It has separate beacons for even and odd ticks, because one is read
/// while the other is written.
#[repr(C)]
struct RobotSlot {
    odometry: Line<Odometry>,
    command: Line<Command>,
    beacons: [Line<Beacon>; 2],
}

fn seats(dir: &Path, robots: usize) -> anyhow::Result<Mapping<RobotSlot>> {
    // SAFETY: messages are plain numbers, for which zeros are a value.
    unsafe { Mapping::new(&dir.join("seats"), robots) }
}

/// Executes a scenario without faults, and returns the measurements.
pub(crate) fn run(setting: &Setting<'_>, scenario: &Scenario) -> anyhow::Result<BareRun> {
    let place = Place::new(setting.root, "bare")?;
    let dir = place.path();
    let robots = scenario.robots.len();
    let plant = briefs::plant(scenario, Pace::Lockstep, dir);
    let ticks = plant.duration_ns / plant.period_ns;
    let briefs = (0..robots).map(|i| briefs::agent(scenario, i, Pace::Lockstep, dir));
    peers::write_briefs(dir, briefs)?;
    let barrier = Barrier::create(&barrier_path(dir), robots, 1, HUNG_AFTER)?;
    (0..robots).for_each(|slot| barrier.set_member(slot, 0));
    let seats = seats(dir, robots)?;
    let launched = Instant::now();
    let peers = Peers::start(dir, setting.stop, robots, "lockstep", &[])?;
    peers.wait_ready()?;
    let startup_s = launched.elapsed().as_secs_f64();

    let mut world = World::new(&plant);
    let mut truths: Vec<TruthRow> = Vec::with_capacity((ticks as usize + 1) * robots);
    let began = Instant::now();
    for tick in 0..ticks {
        truths.extend(world.truth());
        for (robot, seat) in seats.iter().enumerate() {
            seat.odometry.write(world.odometry(robot));
        }
        barrier.begin(tick);
        barrier.release(0);
        barrier.wait_arrivals(tick, || !peers.gone()).map_err(|_| peers.why())?;
        for (robot, seat) in seats.iter().enumerate() {
            let refused = |refusal| anyhow!("robot {robot} at tick {tick}: {refusal}");
            world.accept(robot, &seat.command.read()).map_err(refused)?;
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
    Ok(BareRun { startup_s, ticks_per_s, hash: hash.finish() })
}

/// Executes the agent process of a lockstep run without faults, until it is killed.
pub(crate) fn peer(post: &Post) -> anyhow::Result<()> {
    let brief: AgentBrief = brief::read(&post.brief())?;
    let mut controller = Controller::new(&brief, 0)?;
    let mut barrier = Barrier::open(&barrier_path(&post.dir))?;
    barrier.rely_on(Alarm::start()?);
    let seats = seats(&post.dir, barrier.slots())?;
    let slot = brief.index - 1;
    let mut epoch = barrier.epoch(slot);
    post.report_ready()?;
    loop {
        let Some((next, _)) = barrier.wait_tick(slot, epoch, || true) else { continue };
        epoch = next;
        let odometry = seats[slot].odometry.read();
        if let Some(before) = odometry.tick.checked_sub(1) {
            for (place, neighbor) in brief.neighbors.iter().enumerate() {
                let beacon = seats[neighbor.index - 1].beacons[before as usize & 1].read();
                let heard = controller.hear(place, &beacon, odometry.stamp_ns);
                heard.map_err(|refusal| anyhow!("beacon refused: {refusal}"))?;
            }
        }
        let answer =
            controller.answer(&odometry, odometry.stamp_ns).context("no answer to a sample")?;
        seats[slot].beacons[odometry.tick as usize & 1].write(answer.beacon);
        seats[slot].command.write(answer.command);
        barrier.arrive(slot, odometry.tick);
    }
}
