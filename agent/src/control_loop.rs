//! When the brain thinks: one loop for each pace, the same body.
//!
//! The loops need the plant; no command needs the supervisor. In lockstep, where a tick takes as long
//! as the slowest robot, an agent waits as long as the supervisor is at work, which knows who is hung.

use std::error::Error;
use std::path::Path;
use std::time::Duration;

use protocol::barrier::{Barrier, BarrierError};
use protocol::brief::{self, AgentBrief, BriefError, Pace};
use protocol::clock::{self, Timer};
use protocol::lateness::{Late, Witness};
use protocol::message::Odometry;
use protocol::process::{self, Alarm, Stop, Thaws, Turns};
use protocol::run_root::{self, RunRootError};
use protocol::service::Sample;
use protocol::stage::Stage;
use protocol::watchdog::{SupervisorLost, SupervisorWatch};

use crate::brain::{Brain, Parts};
use crate::golden_phase;
use crate::ports::{PortError, Ports};

/// In real time, without a sign of the plant for this long, the agent gives up. Longer than the
/// start-up of a large experiment may take.
const PLANT_SILENCE_MAX_NS: u64 = 30_000_000_000;
/// Of the time between two wake-ups at most this much, or two periods, counts as silence: an agent
/// that was stopped could hear nobody.
const GAP_NS_MAX: u64 = 1_000_000_000;
/// A robot that is slow on purpose looks this often whether it is to stop.
const LINGER_STEP: Duration = Duration::from_millis(50);
/// In real time the supervisor hears from every agent at least this often.
const STATUS_EVERY_NS: u64 = 100_000_000;
/// Wake-ups that are kept until a sample shows that the run goes on. More are of a plant in trouble.
const LATE_MAX: usize = 100;

/// Why an agent gave up.
#[derive(Debug, thiserror::Error)]
pub enum LoopError {
    /// Its brief is unreadable.
    #[error(transparent)]
    Brief(#[from] BriefError),
    /// Its brief makes no brain.
    #[error(transparent)]
    Parts(#[from] Box<dyn Error + Send + Sync>),
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
    /// In lockstep the supervisor watches over everybody: without it there is no run.
    #[error(transparent)]
    SupervisorLost(#[from] SupervisorLost),
    /// Nothing was heard of the plant.
    #[error("no sign of the plant for {} s", PLANT_SILENCE_MAX_NS / 1_000_000_000)]
    PlantSilent,
    /// A sample that lockstep promises is not there.
    #[error("lockstep is broken: at tick {tick} there is no {what}")]
    Missing {
        /// The tick at hand.
        tick: u64,
        /// What is missing.
        what: String,
    },
}

/// Moves the robot of this brief until told to stop. Its brain is made of what `parts` makes of the
/// brief: [`Parts::of`], or a program's own law, role or method.
pub fn run<E>(
    brief_path: &Path,
    incarnation: u64,
    parts: impl FnOnce(&AgentBrief) -> Result<Parts, E>,
) -> Result<(), LoopError>
where
    E: Into<Box<dyn Error + Send + Sync>>,
{
    let brief: AgentBrief = brief::read(brief_path)?;
    let parts = parts(&brief).map_err(Into::into)?;
    let brain = Brain::with_parts(&brief, incarnation, parts);
    let stop = Stop::on_signals()?;
    run_root::join(&brief.run_root)?;
    clock::tighten_timer_slack();
    if brief.pace == Pace::Realtime {
        process::take_turns(Turns::Short);
    }
    // Before the ports, whose presence tells the plant that it may begin.
    let barrier = match brief.pace {
        Pace::Lockstep => {
            let mut barrier = Barrier::open(&run_root::barrier_path(&brief.run_root))?;
            barrier.rely_on(Alarm::start()?);
            Some(barrier)
        }
        Pace::Realtime => None,
    };
    let epoch = barrier.as_ref().map_or(0, |barrier| barrier.epoch(brief.index - 1));
    let ports = Ports::open(&brief, incarnation)?;
    tracing::info!(robot = brief.name, incarnation, law = brief.law, "ready");
    let agent =
        Agent { brief, brain, ports, stop, deadline_misses: 0, odometry_old: 0, reported_ns: 0 };
    match barrier {
        Some(barrier) => agent.run_in_lockstep(&barrier, epoch),
        None => agent.run_in_real_time(),
    }
}

struct Agent {
    brief: AgentBrief,
    brain: Brain,
    ports: Ports,
    stop: Stop,
    deadline_misses: u64,
    odometry_old: u64,
    reported_ns: u64,
}

impl Agent {
    fn run_in_lockstep(mut self, barrier: &Barrier, mut epoch: u32) -> Result<(), LoopError> {
        let slot = self.brief.index - 1;
        let (mut supervisor, mut refused) = (SupervisorWatch::new(barrier), 0);
        let mut newest_ns = 0;
        self.report(clock::now_ns())?;
        barrier.reported();
        while !self.stop.requested() {
            let patience = supervisor.patience(barrier, &self.stop);
            let Some((new_epoch, tick)) = barrier.wait_tick(slot, epoch, patience) else {
                break;
            };
            epoch = new_epoch;
            supervisor.went_on();
            // After a freeze it first sees a tick that went by without it.
            let Some(first_tick) = barrier.member_since(slot).filter(|&since| since <= tick) else {
                continue;
            };
            let odometry = self.odometry_of(tick)?;
            newest_ns = odometry.stamp_ns;
            let taken_ns = clock::now_ns();
            self.ports.latency.record(
                Stage::Odometry,
                0,
                taken_ns.saturating_sub(odometry.sent_ns),
            );
            if tick > first_tick {
                self.hear_tick(barrier, tick - 1, newest_ns)?;
            }
            let answer = self.brain.answer(&odometry, newest_ns);
            drop(odometry);
            // An answer that takes a period or more is dead before it is sent.
            let in_time = answer.filter(|answer| answer.delay_ns < self.brief.period_ns);
            if let Some(answer) = &in_time {
                let sent_ns = clock::now_ns();
                self.ports.send(answer, sent_ns)?;
                self.measure(taken_ns, newest_ns, sent_ns);
            }
            // Before it arrives, and by what happened alone: whoever is killed after this tick has
            // told the same in every run.
            if self.brain.take_news() | (self.brain.beacons_refused() != refused) {
                refused = self.brain.beacons_refused();
                self.report(taken_ns)?;
                barrier.reported();
            }
            if self.ports.latency.is_half_full() {
                self.tell_ages(newest_ns);
                self.ports.latency.send_if_half_full(taken_ns);
            }
            match in_time {
                Some(_) => barrier.arrive(slot, tick),
                None => barrier.arrive_mute(slot, tick),
            }
        }
        self.tell_ages(newest_ns);
        supervisor.lost().map_or(Ok(()), |lost| Err(lost.into()))
    }

    /// The odometry of exactly this tick; older samples are from before this robot took part.
    fn odometry_of(&self, tick: u64) -> Result<Sample<Odometry>, LoopError> {
        while let Some(odometry) = self.ports.odometry()? {
            if odometry.tick == tick {
                return Ok(odometry);
            }
        }
        Err(LoopError::Missing { tick, what: "odometry".into() })
    }

    /// Takes from every neighbour that took part in `tick` its beacon of that tick, and from
    /// others nothing. A neighbour may be a tick ahead: what it said there stays in the queue.
    fn hear_tick(&mut self, barrier: &Barrier, tick: u64, now_ns: u64) -> Result<(), LoopError> {
        for (place, neighbor) in self.brief.neighbors.iter().enumerate() {
            let slot = neighbor.index - 1;
            let takes_part = || barrier.member_since(slot).is_some_and(|since| since <= tick);
            if !takes_part() || barrier.is_mute(slot, tick) {
                continue;
            }
            loop {
                match self.ports.beacon(place)? {
                    Some(beacon) if beacon.tick < tick => {}
                    Some(beacon) if beacon.tick == tick => {
                        if let Err(refusal) = self.brain.hear(place, &beacon, now_ns) {
                            tracing::warn!(neighbor = neighbor.name, %refusal, "beacon refused");
                        }
                        break;
                    }
                    // It died in this very tick, by nobody's plan.
                    None if !takes_part() => break,
                    _ => {
                        let what = format!("beacon of {} from tick {tick}", neighbor.name);
                        return Err(LoopError::Missing { tick: tick + 1, what });
                    }
                }
            }
        }
        Ok(())
    }

    fn run_in_real_time(mut self) -> Result<(), LoopError> {
        let period_ns = self.brief.period_ns;
        let phase = golden_phase(self.brief.index);
        let mut timer = Timer::new(period_ns, (phase * period_ns as f64) as u64);
        let thaws = Thaws::watch()?;
        let mut slow_until_ns = 0;
        let mut awake_ns = clock::now_ns();
        let mut silent_ns = 0;
        let mut late_ns = Vec::with_capacity(LATE_MAX);
        let mut witness = Witness::new(period_ns);
        let (mut rested_ns, mut missed) = (awake_ns, false);
        self.report(awake_ns)?;
        while !self.stop.requested() {
            let Some(wake) = timer.wait() else {
                rested_ns = clock::now_ns();
                continue;
            };
            // From its first sample on: before, everybody waits for the last one to start.
            if self.brain.has_started() {
                // Whoever was frozen or slow on purpose is not late by the machine's doing.
                let held = wake.due_ns < slow_until_ns.max(thaws.last_ns());
                late_ns.push((if held { Stage::Held } else { Stage::Wake }, wake.lateness_ns));
                let missed = std::mem::take(&mut missed);
                if held {
                    witness.look();
                } else if !witness.on_time(wake.lateness_ns, missed) {
                    let cause = witness.cause_of(Late::of(&wake, awake_ns, rested_ns));
                    late_ns.push((cause.stage(), wake.lateness_ns));
                }
            } else {
                self.ports.connect();
            }
            // In real time a queue holds the newest sample and no other.
            let newest = self.ports.odometry()?;
            // Without another sample the run is over, and everybody late who is not yet told.
            if newest.is_some() || late_ns.len() >= LATE_MAX {
                let late_ns = late_ns.drain(..);
                late_ns.for_each(|(stage, ns)| self.ports.latency.record(stage, 0, ns));
            }
            let taken_ns = clock::now_ns();
            silent_ns += (taken_ns - awake_ns).min(GAP_NS_MAX.max(2 * period_ns));
            awake_ns = taken_ns;
            self.ports.faults_by_hand(|robot, cut| self.brain.set_cut(robot, cut))?;
            if let Some(goal) = self.ports.goal()? {
                self.brain.go_to(&goal);
            }
            // At its first sample a robot has heard nothing, as in lockstep.
            if self.brain.has_started() {
                self.hear_newest()?;
            }
            // Only what may take long is worth a clock read of its own.
            rested_ns = taken_ns;
            if let Some(odometry) = newest {
                silent_ns = 0;
                self.ports.latency.record(
                    Stage::Odometry,
                    0,
                    taken_ns.saturating_sub(odometry.sent_ns),
                );
                let used_ns = clock::now_ns();
                let age_ns = used_ns.saturating_sub(odometry.stamp_ns);
                // Its answer would be dead before it is sent.
                let is_old = age_ns >= self.brief.command_lifetime_ns;
                self.odometry_old += u64::from(is_old);
                let answer = match is_old {
                    true => None,
                    false => self.brain.answer(&odometry, used_ns),
                };
                drop(odometry);
                if let Some(answer) = answer {
                    self.linger(answer.delay_ns);
                    let sent_ns = clock::now_ns();
                    if answer.delay_ns > 0 {
                        slow_until_ns = sent_ns;
                    }
                    self.ports.send(&answer, sent_ns)?;
                    self.measure(taken_ns, used_ns, sent_ns);
                    rested_ns = sent_ns;
                    let misses = sent_ns.saturating_sub(wake.due_ns) / period_ns;
                    self.deadline_misses += misses;
                    missed = misses > 0;
                } else {
                    rested_ns = clock::now_ns();
                }
            } else if silent_ns > PLANT_SILENCE_MAX_NS {
                return Err(LoopError::PlantSilent);
            }
            let news = self.brain.take_news();
            let reported = self.report_if(news, taken_ns)?;
            let told = self.ports.latency.is_due(taken_ns);
            if told {
                self.tell_ages(taken_ns);
                self.ports.latency.send_if_due(taken_ns);
            }
            if reported || told {
                rested_ns = clock::now_ns();
            }
        }
        self.tell_ages(clock::now_ns());
        Ok(())
    }

    /// Writes down how long an answer took, and how old the beacons were that it used.
    fn measure(&mut self, taken_ns: u64, used_ns: u64, sent_ns: u64) {
        let latency = &mut self.ports.latency;
        latency.record(Stage::Compute, 0, sent_ns.saturating_sub(taken_ns));
        for (from, age_ns) in self.brain.ages(used_ns) {
            latency.record(Stage::BeaconAge, from, age_ns);
        }
    }

    /// Writes down what the ages of what is heard came to, for the next batch of latencies.
    fn tell_ages(&mut self, now_ns: u64) {
        for (from, sums) in self.brain.take_ages(now_ns) {
            self.ports.latency.record_age(from, &sums);
        }
    }

    /// Lets this much time pass, but for the end of the run.
    fn linger(&self, ns: u64) {
        let end_ns = clock::now_ns().saturating_add(ns);
        while !self.stop.requested() {
            let left_ns = end_ns.saturating_sub(clock::now_ns());
            if left_ns == 0 {
                return;
            }
            std::thread::sleep(Duration::from_nanos(left_ns).min(LINGER_STEP));
        }
    }

    /// Takes whatever the neighbours said last.
    fn hear_newest(&mut self) -> Result<(), LoopError> {
        for (place, neighbor) in self.brief.neighbors.iter().enumerate() {
            if let Some(beacon) = self.ports.beacon(place)? {
                let taken_ns = clock::now_ns();
                let under_way_ns = taken_ns.saturating_sub(beacon.sent_ns);
                self.ports.latency.record(Stage::BeaconDelivery, neighbor.index, under_way_ns);
                if let Err(refusal) = self.brain.hear(place, &beacon, taken_ns) {
                    tracing::debug!(neighbor = neighbor.name, %refusal, "beacon refused");
                }
            }
        }
        Ok(())
    }

    /// Tells the supervisor how it goes if there is news, or if it has heard nothing for long; whether
    /// it did.
    fn report_if(&mut self, news: bool, now_ns: u64) -> Result<bool, LoopError> {
        let due = news || now_ns - self.reported_ns >= STATUS_EVERY_NS;
        if due {
            self.report(now_ns)?;
        }
        Ok(due)
    }

    fn report(&mut self, now_ns: u64) -> Result<(), LoopError> {
        self.ports.report(&self.brain, self.deadline_misses, self.odometry_old)?;
        self.reported_ns = now_ns;
        Ok(())
    }
}

/// What the process `phalanx-agent` does: named, logging, and with an exit code that tells.
pub fn main(brief_path: &Path, incarnation: u64, realtime_priority: bool) -> u8 {
    main_with(brief_path, incarnation, realtime_priority, Parts::of)
}

/// The same for a program that has a law, a role or an avoidance method of its own, see [`run`].
pub fn main_with<E>(
    brief_path: &Path,
    incarnation: u64,
    realtime_priority: bool,
    parts: impl FnOnce(&AgentBrief) -> Result<Parts, E>,
) -> u8
where
    E: Into<Box<dyn Error + Send + Sync>>,
{
    process::set_name("phalanx-agent");
    process::log_to_stderr();
    if realtime_priority {
        process::hurry();
    }
    match run(brief_path, incarnation, parts) {
        Ok(()) => process::exit::OK,
        Err(error) => {
            tracing::error!("{error}");
            process::exit::INFRASTRUCTURE
        }
    }
}
