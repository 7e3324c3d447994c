//! When time passes: one loop for each pace over the same world.
//!
//! In lockstep the plant leads the barrier, and waits for robots and supervisor as long as that one
//! is at work, which knows who is hung; in real time it waits for nobody but the clock.

use std::error::Error;
use std::path::Path;
use std::time::{Duration, Instant};

use protocol::barrier::{Barrier, BarrierError, LEAD_MAX};
use protocol::brief::{self, BriefError, Pace, PlantBrief};
use protocol::clock::{self, Timer};
use protocol::lateness::{Late, Witness};
use protocol::process::{self, Alarm, Stop, Turns};
use protocol::run_root::{self, RunRootError};
use protocol::stage::Stage;
use protocol::watchdog::{SupervisorLost, SupervisorWatch};

use crate::gaps::Gaps;
use crate::motion::{Checked, Motion, Unicycles};
use crate::overrun::{Overrun, TooSlow};
use crate::ports::{PortError, Ports};
use crate::world::World;

/// In real time all robots must be ready within this; the supervisor has a shorter bound and names
/// the culprit.
const READY_MAX: Duration = Duration::from_secs(30);
/// How often readiness is looked at.
const READY_EVERY: Duration = Duration::from_millis(1);
/// In real time, once all are ready, they have this long and two periods to connect to each other.
const SETTLE_MIN: Duration = Duration::from_millis(20);
/// How long the last truth of real time waits for the supervisor's signal to end.
const RELEASE_MAX: Duration = Duration::from_secs(10);
/// The supervisor's attention is drawn to new truths once they tell of so many robots, and every so many ticks:
/// seldom, it works for long while robots on its core wait; often, waking it costs more.
const ATTENTION_ROBOTS: u64 = 48;
const ATTENTION_EVERY: [u64; 2] = [4, 16];

/// Why the plant gave up.
#[derive(Debug, thiserror::Error)]
pub enum LoopError {
    /// Its brief is unreadable.
    #[error(transparent)]
    Brief(#[from] BriefError),
    /// The run it belongs to is not there.
    #[error(transparent)]
    RunRoot(#[from] RunRootError),
    /// A port failed.
    #[error(transparent)]
    Port(#[from] PortError),
    /// The barrier is not there.
    #[error(transparent)]
    Barrier(#[from] BarrierError),
    /// Signals cannot be handled.
    #[error("cannot handle signals: {0}")]
    Signals(#[from] std::io::Error),
    /// What moves the robots could not be made, or failed.
    #[error(transparent)]
    Motion(Box<dyn Error + Send + Sync>),
    /// What moves the robots is slower than real time.
    #[error(transparent)]
    TooSlow(#[from] TooSlow),
    /// Some robots never came up.
    #[error("not ready after {} s: {robots}", READY_MAX.as_secs())]
    NotReady {
        /// Their names.
        robots: String,
    },
    /// A robot arrived at the barrier without a command.
    #[error("lockstep is broken: {robot} arrived at tick {tick} without a command")]
    NoCommand {
        /// The tick at hand.
        tick: u64,
        /// Its name.
        robot: String,
    },
    /// In lockstep the supervisor watches over everybody: without it there is no run.
    #[error(transparent)]
    SupervisorLost(#[from] SupervisorLost),
}

/// Runs the world of this brief to its end. Its robots are moved by what `motion` makes of the brief:
/// [`Unicycles`], or a program's own physics.
pub fn run<M: Motion, E>(
    brief_path: &Path,
    motion: impl FnOnce(&PlantBrief) -> Result<M, E>,
) -> Result<(), LoopError>
where
    E: Into<Box<dyn Error + Send + Sync>>,
{
    let brief: PlantBrief = brief::read(brief_path)?;
    let stop = Stop::on_signals()?;
    run_root::join(&brief.run_root)?;
    let motion = motion(&brief).map_err(|error| LoopError::Motion(error.into()))?;
    let motion = Checked::new(&brief, motion);
    clock::tighten_timer_slack();
    if brief.pace == Pace::Realtime {
        process::take_turns(Turns::Short);
    }
    let ports = Ports::open(&brief)?;
    let sent_ns = vec![0; brief.robots.len()];
    let plant = Plant { world: World::moved_by(motion, &brief), brief, ports, stop, sent_ns };
    match plant.brief.pace {
        Pace::Lockstep => {
            let mut barrier = Barrier::open(&run_root::barrier_path(&plant.brief.run_root))?;
            barrier.rely_on(Alarm::start()?);
            let mut supervisor = SupervisorWatch::new(&barrier);
            if plant.wait_until_ready(supervisor.patience(&barrier, &plant.stop)) {
                plant.run_in_lockstep(&barrier, &mut supervisor)?;
            }
            supervisor.lost().map_or(Ok(()), |lost| Err(lost.into()))
        }
        Pace::Realtime => {
            let began = Instant::now();
            if plant.wait_until_ready(|| !plant.stop.requested() && began.elapsed() < READY_MAX) {
                plant.run_in_real_time()
            } else if plant.stop.requested() {
                Ok(())
            } else {
                Err(LoopError::NotReady { robots: plant.names(plant.ports.not_ready()) })
            }
        }
    }
}

struct Plant<M> {
    brief: PlantBrief,
    world: World<M>,
    ports: Ports,
    stop: Stop,
    /// When each robot's newest odometry was sent, ns.
    sent_ns: Vec<u64>,
}

impl<M: Motion> Plant<M> {
    /// Whether all robots are; false once `patience` ends.
    fn wait_until_ready(&self, mut patience: impl FnMut() -> bool) -> bool {
        while self.ports.not_ready().next().is_some() {
            if !patience() {
                return false;
            }
            std::thread::sleep(READY_EVERY);
        }
        tracing::info!(robots = self.brief.robots.len(), "all ready, t = 0");
        true
    }

    /// Ends early when asked to stop, or without a supervisor.
    fn run_in_lockstep(
        mut self,
        barrier: &Barrier,
        supervisor: &mut SupervisorWatch,
    ) -> Result<(), LoopError> {
        let ticks = self.brief.duration_ns / self.brief.period_ns;
        let [often, seldom] = ATTENTION_EVERY;
        let attention_every =
            (ATTENTION_ROBOTS / self.brief.robots.len() as u64).clamp(often, seldom);
        for tick in 0..ticks {
            self.ports.send_truth(&self.world)?;
            if tick.is_multiple_of(attention_every) {
                barrier.attention();
            }
            let mut patience = supervisor.patience(barrier, &self.stop);
            let goes_on = !self.stop.requested()
                && (!barrier.pause_due(tick) || barrier.pause(tick, &mut patience))
                && barrier.wait_lead(tick, LEAD_MAX, &mut patience);
            drop(patience);
            if !goes_on || self.stop.requested() || !self.run_one_tick(barrier, supervisor, tick)? {
                return Ok(());
            }
            self.advance((tick + 1) * self.brief.period_ns)?;
            self.world.next_tick();
        }
        self.ports.send_truth(&self.world)?;
        barrier.attention();
        release(supervisor.patience(barrier, &self.stop));
        Ok(())
    }

    /// Odometry to everybody who takes part, and a command from each; false if it ends early.
    fn run_one_tick(
        &mut self,
        barrier: &Barrier,
        supervisor: &mut SupervisorWatch,
        tick: u64,
    ) -> Result<bool, LoopError> {
        barrier.begin(tick);
        for group in 0..barrier.groups() {
            for robot in barrier.members_of(group) {
                self.sent_ns[robot] = self.ports.send_odometry(&self.world, robot)?;
            }
            barrier.release(group);
        }
        if barrier.wait_arrivals(tick, supervisor.patience(barrier, &self.stop)).is_err() {
            return Ok(false);
        }
        self.world.take_due();
        for robot in barrier.members() {
            loop {
                match self.ports.command(robot)? {
                    Some(command) if command.tick < tick => {}
                    Some(command) => {
                        let answered_ns = clock::now_ns().saturating_sub(self.sent_ns[robot]);
                        self.ports.latency.record(Stage::Command, robot + 1, answered_ns);
                        if let Err(refusal) = self.world.take(robot, &command) {
                            tracing::warn!(robot, tick, %refusal, "command refused");
                        }
                        break;
                    }
                    // It died in this very tick, by nobody's plan.
                    None if self.stop.requested() => break,
                    None if barrier.member_since(robot).is_none() => break,
                    None if barrier.is_mute(robot, tick) => break,
                    None => {
                        let robot = self.brief.robots[robot].name.clone();
                        return Err(LoopError::NoCommand { tick, robot });
                    }
                }
            }
        }
        self.ports.latency.send_if_due(clock::now_ns());
        Ok(true)
    }

    fn run_in_real_time(mut self) -> Result<(), LoopError> {
        // Else everybody would connect to everybody in the first period, and all be late.
        self.ports.connect();
        std::thread::sleep(SETTLE_MIN.max(2 * Duration::from_nanos(self.brief.period_ns)));
        let tick_ns = self.brief.plant_tick_ns;
        let start_ns = clock::now_ns();
        let mut timer = Timer::new(tick_ns, start_ns % tick_ns);
        self.world.start_at(start_ns);
        self.publish()?;
        let mut witness = Witness::new(tick_ns);
        let (mut awake_ns, mut rested_ns) = (start_ns, start_ns);
        let mut gaps = vec![Gaps::default(); self.brief.robots.len()];
        let mut overrun = Overrun::default();
        while !self.stop.requested() && self.world.t_ns() < self.brief.duration_ns {
            let Some(wake) = timer.wait() else { continue };
            self.ports.latency.record(Stage::Wake, 0, wake.lateness_ns);
            if !witness.on_time(wake.lateness_ns, false) {
                let cause = witness.cause_of(Late::of(&wake, awake_ns, rested_ns));
                self.ports.latency.record(cause.stage(), 0, wake.lateness_ns);
            }
            let now_ns = clock::now_ns();
            awake_ns = now_ns;
            let t_ns = (now_ns - start_ns).min(self.brief.duration_ns);
            self.catch_up(t_ns, &mut overrun)?;
            self.world.next_tick();
            self.world.take_due();
            for (robot, gaps) in gaps.iter_mut().enumerate() {
                while let Some(command) = self.ports.command(robot)? {
                    let answered_ns = clock::now_ns().saturating_sub(command.stamp_ns);
                    self.ports.latency.record(Stage::Command, robot + 1, answered_ns);
                    self.ports.latency.count_lost(gaps.before(&command));
                    if let Err(refusal) = self.world.take(robot, &command) {
                        tracing::debug!(robot, t_ns, %refusal, "command refused");
                    }
                }
            }
            if t_ns < self.brief.duration_ns {
                self.publish()?;
            } else {
                // Nobody is to act on the end.
                self.ports.send_truth(&self.world)?;
            }
            self.ports.latency.send_if_due(now_ns);
            rested_ns = clock::now_ns();
        }
        let began = Instant::now();
        release(|| !self.stop.requested() && began.elapsed() < RELEASE_MAX);
        Ok(())
    }

    fn advance(&mut self, t_ns: u64) -> Result<(), LoopError> {
        self.world.try_advance(t_ns).map_err(|error| LoopError::Motion(error.into()))
    }

    /// The same in plant ticks, and an error once that is slower than real time.
    fn catch_up(&mut self, t_ns: u64, overrun: &mut Overrun) -> Result<(), LoopError> {
        let (began_ns, from_ns) = (clock::now_ns(), self.world.t_ns());
        let took_ns = || clock::now_ns().saturating_sub(began_ns);
        while self.world.t_ns() < t_ns {
            self.advance(t_ns.min(self.world.t_ns() + self.brief.plant_tick_ns))?;
            overrun.under_way(self.world.t_ns() - from_ns, took_ns())?;
        }
        overrun.over(t_ns - from_ns, took_ns());
        Ok(())
    }

    fn publish(&self) -> Result<(), LoopError> {
        for robot in 0..self.brief.robots.len() {
            self.ports.send_odometry(&self.world, robot)?;
        }
        self.ports.send_truth(&self.world)?;
        Ok(())
    }

    fn names(&self, robots: impl Iterator<Item = usize>) -> String {
        let names: Vec<&str> = robots.map(|i| self.brief.robots[i].name.as_str()).collect();
        names.join(", ")
    }
}

/// Leaves the last truth in place until the supervisor, having taken it, says stop.
fn release(mut patience: impl FnMut() -> bool) {
    while patience() {
        std::thread::sleep(READY_EVERY);
    }
}

/// What the process does: named, logging, and with an exit code that tells.
pub fn main(brief_path: &Path, realtime_priority: bool) -> u8 {
    main_with(brief_path, realtime_priority, |brief| Ok::<_, LoopError>(Unicycles::new(brief)))
}

/// The same for a program that moves the robots by itself, see [`run`].
pub fn main_with<M: Motion, E>(
    brief_path: &Path,
    realtime_priority: bool,
    motion: impl FnOnce(&PlantBrief) -> Result<M, E>,
) -> u8
where
    E: Into<Box<dyn Error + Send + Sync>>,
{
    process::set_name("phalanx-plant");
    process::log_to_stderr();
    if realtime_priority {
        process::hurry();
    }
    match run(brief_path, motion) {
        Ok(()) => process::exit::OK,
        Err(error) => {
            tracing::error!("{error}");
            process::exit::INFRASTRUCTURE
        }
    }
}
