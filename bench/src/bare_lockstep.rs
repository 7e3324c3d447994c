//! Baseline without iceoryx2: the controllers and the plant of a run over one shared mapping, with the lockstep
//! barrier. Its trajectory must equal that of the run bit by bit.
//!
//! Each agent is a process; the plant runs in the bench process. There is no supervisor: the bench keeps the ground
//! truth of each tick and hashes it after the time measurement.
//!
//! Processes without controllers, which the same barrier wakes at each tick, show what the wake-up alone costs.

use std::ffi::OsString;
use std::path::Path;
use std::time::Instant;

use agent::controller::Controller;
use anyhow::{Context as _, anyhow};
use experiment::briefs;
use experiment::scenario::Scenario;
use outcome::metrics::hash::TrajectoryHash;
use outcome::results::usage::{self, Usage};
use plant::world::World;
use protocol::barrier::Barrier;
use protocol::brief::{self, AgentBrief, Pace};
use protocol::message::{Beacon, Command, Odometry, TruthRow};
use protocol::process::Alarm;
use protocol::run_root::barrier_path;

use crate::memory::{CacheAligned, Mapping};
use crate::peers::{self, PeerAddress, Peers};
use crate::rounds::BenchSettings;
use crate::{RESPONSE_TIMEOUT, WorkDir};

/// Result of a run without iceoryx2.
pub(crate) struct BareRun {
    /// Wall time from the first agent's start until all were ready, s.
    pub(crate) startup_s: f64,
    /// Ticks per second of wall time.
    pub(crate) ticks_per_s: f64,
    /// Processor time of the agents including their start, s.
    pub(crate) agents_cpu_s: f64,
    /// Trajectory hash.
    pub(crate) hash: String,
}

/// Messages of one robot in the mapping. The two beacons belong to even and odd ticks: neighbors read one while the
/// robot writes the other.
#[repr(C)]
struct RobotMessages {
    odometry: CacheAligned<Odometry>,
    command: CacheAligned<Command>,
    beacons: [CacheAligned<Beacon>; 2],
}

fn map_messages(dir: &Path, robots: usize) -> anyhow::Result<Mapping<RobotMessages>> {
    // SAFETY: messages are plain numbers, for which all-zero bytes are valid.
    unsafe { Mapping::new(&dir.join("messages"), robots) }
}

/// Creates the barrier in `dir` and starts one peer for each robot.
fn start_peers(
    settings: &BenchSettings<'_>,
    dir: &Path,
    robots: usize,
    arguments: &[OsString],
) -> anyhow::Result<(Barrier, Peers)> {
    let barrier = Barrier::create(&barrier_path(dir), robots, 1, RESPONSE_TIMEOUT)?;
    (0..robots).for_each(|slot| barrier.set_member(slot, 0));
    let peers = Peers::start(dir, settings.stop, robots, "lockstep", arguments)?;
    Ok((barrier, peers))
}

/// Wakes all peers for one tick and waits until they have answered.
fn run_tick(barrier: &Barrier, peers: &Peers, tick: u64) -> anyhow::Result<()> {
    barrier.begin_tick(tick);
    barrier.release_group(0);
    barrier.wait_for_arrivals(tick, || !peers.have_failed()).map_err(|_| peers.wait_for_failure())
}

/// Returns the processor time, s, of the child processes that were reaped since `earlier` was read.
fn reaped_cpu_s(earlier: &Usage) -> f64 {
    usage::read_reaped_children().usage_since(earlier).processor_time_s()
}

/// Wakes one process for each robot at each tick; the processes answer at once. Returns their processor time including
/// their start, s.
///
/// # Errors
/// If a peer cannot start or exits early, or if a signal interrupts the bench.
pub(crate) fn run_without_work(
    settings: &BenchSettings<'_>,
    robots: usize,
    ticks: u64,
) -> anyhow::Result<f64> {
    let work_dir = WorkDir::new(settings.root, "no-work")?;
    let earlier = usage::read_reaped_children();
    let arguments = ["--without-work".into()];
    let (barrier, peers) = start_peers(settings, work_dir.path(), robots, &arguments)?;
    peers.wait_ready()?;
    (0..ticks).try_for_each(|tick| run_tick(&barrier, &peers, tick))?;
    drop(peers);
    Ok(reaped_cpu_s(&earlier))
}

/// Runs a scenario and measures its speed. The scenario must not have faults.
///
/// # Errors
/// If a peer cannot start, exits early or sends an invalid command, or if a signal interrupts the bench.
pub(crate) fn run(settings: &BenchSettings<'_>, scenario: &Scenario) -> anyhow::Result<BareRun> {
    let work_dir = WorkDir::new(settings.root, "bare")?;
    let dir = work_dir.path();
    let robots = scenario.robots.len();
    let plant = briefs::plant_brief(scenario, Pace::Lockstep, dir);
    let ticks = plant.duration_ns / plant.period_ns;
    let agent_briefs = briefs::AgentBriefs::new(scenario);
    let briefs = (0..robots).map(|i| agent_briefs.brief(i, Pace::Lockstep, dir));
    peers::write_briefs(dir, briefs)?;
    let messages = map_messages(dir, robots)?;
    let earlier = usage::read_reaped_children();
    let launch_time = Instant::now();
    let (barrier, peers) = start_peers(settings, dir, robots, &[])?;
    peers.wait_ready()?;
    let startup_s = launch_time.elapsed().as_secs_f64();

    let mut world = World::new(&plant);
    let mut truths: Vec<TruthRow> = Vec::with_capacity((ticks as usize + 1) * robots);
    let start = Instant::now();
    for tick in 0..ticks {
        truths.extend(world.truth());
        for (robot, message) in messages.iter().enumerate() {
            message.odometry.write(world.odometry(robot));
        }
        run_tick(&barrier, &peers, tick)?;
        for (robot, message) in messages.iter().enumerate() {
            let command_error = |refusal| anyhow!("robot {robot} at tick {tick}: {refusal}");
            world.accept_command(robot, &message.command.read()).map_err(command_error)?;
        }
        world.advance((tick + 1) * plant.period_ns);
        world.increment_tick();
    }
    truths.extend(world.truth());
    let wall_time = start.elapsed();
    drop(peers);
    let agents_cpu_s = reaped_cpu_s(&earlier);

    let mut hash = TrajectoryHash::new();
    for (tick, rows) in (0..).zip(truths.chunks(robots)) {
        hash.update(tick, rows);
    }
    let ticks_per_s = ticks as f64 / wall_time.as_secs_f64();
    Ok(BareRun { startup_s, ticks_per_s, agents_cpu_s, hash: hash.finish() })
}

/// Runs a process that answers each tick at once, until it is killed.
pub(crate) fn run_peer_without_work(address: &PeerAddress) -> anyhow::Result<()> {
    answer_ticks(address, open_barrier(address)?, || Ok(()))
}

/// Runs the agent process of this baseline until it is killed. It does the work of an agent in a lockstep run without
/// faults.
pub(crate) fn run_peer(address: &PeerAddress) -> anyhow::Result<()> {
    let brief: AgentBrief = brief::read(&address.brief_path())?;
    let mut controller = Controller::new(&brief, 0)?;
    let barrier = open_barrier(address)?;
    let messages = map_messages(&address.dir, barrier.slots())?;
    let own_messages = &messages[address.index];
    answer_ticks(address, barrier, || {
        let odometry = own_messages.odometry.read();
        if let Some(previous_tick) = odometry.tick.checked_sub(1) {
            for (index, neighbor) in brief.neighbors.iter().enumerate() {
                let beacon =
                    messages[neighbor.index - 1].beacons[previous_tick as usize & 1].read();
                let result = controller.receive_beacon(index, &beacon, odometry.stamp_ns);
                result.map_err(|refusal| anyhow!("beacon refused: {refusal}"))?;
            }
        }
        let answer = controller
            .answer(&odometry, odometry.stamp_ns)
            .context("the controller gave no answer to an odometry sample")?;
        own_messages.beacons[odometry.tick as usize & 1].write(*answer.beacon());
        own_messages.command.write(answer.command);
        Ok(())
    })
}

/// Opens the barrier of the peers in the directory of `address`.
fn open_barrier(address: &PeerAddress) -> anyhow::Result<Barrier> {
    let mut barrier = Barrier::open(&barrier_path(&address.dir))?;
    barrier.set_alarm(Alarm::start()?);
    Ok(barrier)
}

/// Reports that this peer is ready, then calls `answer` at each tick and arrives at the barrier. Returns only an error
/// of `answer` or of the report.
fn answer_ticks(
    address: &PeerAddress,
    barrier: Barrier,
    mut answer: impl FnMut() -> anyhow::Result<()>,
) -> anyhow::Result<()> {
    let slot = address.index;
    let mut epoch = barrier.epoch(slot);
    address.report_ready()?;
    loop {
        if let Some((next_epoch, tick)) = barrier.wait_for_tick(slot, epoch, || true) {
            epoch = next_epoch;
            answer()?;
            barrier.arrive(slot, tick);
        }
    }
}
