//! Waiting and sending around a robot's turn ([`crate::turn`]): one loop for each pace.
//!
//! The loops need the plant; no command needs the supervisor. In lockstep, where a tick takes as long
//! as the slowest robot, an agent waits as long as the supervisor is at work, which knows who is hung.

use std::path::Path;
use std::time::Duration;

use protocol::barrier::Barrier;
use protocol::brief::{self, AgentBrief, Pace};
use protocol::clock::{self, Timer};
use protocol::lateness::Witness;
use protocol::message::Odometry;
use protocol::process::{self, Alarm, Failure, Stop, Thaws, Turns};
use protocol::run_root;
use protocol::service::Sample;
use protocol::watchdog::SupervisorWatch;

use crate::brain::{Brain, Parts};
use crate::golden_phase;
use crate::ports::Ports;
use crate::turn::{Delivery, Inbox, PLANT_SILENCE_MAX_NS, Turn, Woken};

/// A robot that is slow on purpose looks this often whether it is to stop.
const LINGER_STEP: Duration = Duration::from_millis(50);

/// Moves the robot of this brief until told to stop. Its brain is made of what `parts` makes of the
/// brief: [`Parts::of`], or a program's own law, role or method.
pub fn run<E>(
    brief_path: &Path,
    incarnation: u64,
    parts: impl FnOnce(&AgentBrief) -> Result<Parts, E>,
) -> Result<(), Failure>
where
    E: Into<Failure>,
{
    let brief: AgentBrief = brief::read(brief_path)?;
    let parts = parts(&brief).map_err(Into::into)?;
    let brain = Brain::with_parts(&brief, incarnation, parts);
    let stop = Stop::on_signals().map_err(|error| format!("cannot handle signals: {error}"))?;
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
    let robot = brief.name.clone();
    let turn = Turn::new(brief, brain, clock::now_ns());
    let ports = Ports::open(turn.brief(), turn.measured())?;
    tracing::info!(robot, incarnation, law = turn.brief().law, "ready");
    let mut agent = Agent { turn, ports, stop };
    let ended = match barrier {
        Some(barrier) => agent.run_in_lockstep(&barrier, epoch),
        None => agent.run_in_real_time(),
    };
    agent.send_measured();
    ended
}

struct Agent {
    turn: Turn,
    ports: Ports,
    stop: Stop,
}

impl Agent {
    fn run_in_lockstep(&mut self, barrier: &Barrier, mut epoch: u32) -> Result<(), Failure> {
        let slot = self.turn.brief().index - 1;
        let mut supervisor = SupervisorWatch::new(barrier);
        self.report()?;
        barrier.reported();
        while !self.stop.requested() {
            let patience = supervisor.patience(barrier, &self.stop);
            let Some((new_epoch, tick)) = barrier.wait_tick(slot, epoch, patience) else {
                break;
            };
            epoch = new_epoch;
            supervisor.went_on();
            // After a freeze it first sees a tick that went by without it.
            let since = barrier.member_since(slot).filter(|&since| since <= tick);
            let Some(member_since) = since else { continue };
            let odometry = odometry_of(&self.ports, tick)?;
            let ports = &self.ports;
            let beacon = |place| beacon_before(ports, barrier, place, tick).transpose();
            let outbox = self.turn.take(Inbox {
                taken_ns: clock::now_ns(),
                odometry: Some(&odometry),
                member_since,
                beacons: (0..ports.senders()).filter_map(beacon),
                cuts: &[],
                goal: None,
            })?;
            drop(odometry);
            if let Some(answer) = &outbox.answer {
                let sent_ns = clock::now_ns();
                self.ports.send(answer, sent_ns)?;
                self.turn.sent(sent_ns);
            }
            // Before it arrives: what a spare that is opened now says at the next tick is in the queue.
            self.ports.listen(self.turn.brain().neighborhood())?;
            // Before it arrives, and by what happened alone: whoever is killed after this tick has
            // told the same in every run.
            if outbox.report {
                self.report()?;
                barrier.reported();
            }
            if self.turn.batch_is_due() {
                self.send_measured();
            }
            match outbox.answer {
                Some(_) => barrier.arrive(slot, tick),
                None => barrier.arrive_mute(slot, tick),
            }
        }
        supervisor.lost().map_or(Ok(()), |lost| Err(lost.into()))
    }

    fn run_in_real_time(&mut self) -> Result<(), Failure> {
        let &AgentBrief { period_ns, index, .. } = self.turn.brief();
        let mut timer = Timer::new(period_ns, (golden_phase(index) * period_ns as f64) as u64);
        let thaws = Thaws::watch()?;
        let mut witness = Witness::new(period_ns);
        self.report()?;
        while !self.stop.requested() {
            let Some(wake) = timer.wait() else {
                witness.rests(clock::now_ns());
                continue;
            };
            match self.turn.wake(&wake, thaws.last_ns()) {
                Woken::Starting => self.ports.connect(),
                Woken::Held => witness.look_at(&wake),
                Woken::Counted { missed } => {
                    if let Some(cause) = witness.cause_if_late(&wake, missed) {
                        self.turn.was_late(&wake, cause);
                    }
                }
            }
            witness.rests(self.turn_in_real_time()?);
        }
        Ok(())
    }

    /// Takes the turn that it woke up for; when that was over, ns. Only what may take long is worth a look at
    /// the clock.
    fn turn_in_real_time(&mut self) -> Result<u64, Failure> {
        // In real time a queue holds the newest sample and no other.
        let odometry = self.ports.odometry()?;
        let cuts = self.ports.cuts()?;
        let taken_ns = clock::now_ns();
        let outbox = self.turn.take(Inbox {
            taken_ns,
            odometry: odometry.as_deref(),
            member_since: 0,
            beacons: self.ports.newest_beacons(),
            cuts: cuts.as_ref().map_or(&[], |cuts| cuts.payload()),
            goal: self.ports.goal()?,
        })?;
        drop(odometry);
        let mut rested_ns = taken_ns;
        if let Some(answer) = &outbox.answer {
            self.linger(answer.delay_ns);
            rested_ns = clock::now_ns();
            self.ports.send(answer, rested_ns)?;
            self.turn.sent(rested_ns);
        }
        self.ports.listen(self.turn.brain().neighborhood())?;
        if outbox.plant_silent {
            let silent_s = PLANT_SILENCE_MAX_NS / 1_000_000_000;
            return Err(format!("no sign of the plant for {silent_s} s").into());
        }
        let batch_is_due = self.turn.batch_is_due();
        if outbox.report {
            self.report()?;
        }
        if batch_is_due {
            self.send_measured();
        }
        let told = outbox.report || batch_is_due;
        Ok(if told { clock::now_ns() } else { rested_ns })
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

    /// Tells the supervisor how it goes.
    fn report(&self) -> Result<(), Failure> {
        let (header, neighbors) = self.turn.status();
        self.ports.report(header, neighbors)
    }

    fn send_measured(&mut self) {
        self.ports.latency.send(self.turn.batch(), clock::now_ns());
    }
}

/// The odometry of exactly this tick; older samples are from before the robot took part.
fn odometry_of(ports: &Ports, tick: u64) -> Result<Sample<Odometry>, Failure> {
    while let Some(odometry) = ports.odometry()? {
        if odometry.tick == tick {
            return Ok(odometry);
        }
    }
    Err(missing(tick, "odometry"))
}

/// What the sender at `place` said at the tick before this one, if it was awaited, took part in that and was
/// not mute. It may be a tick ahead: what it said there stays in the queue.
fn beacon_before(
    ports: &Ports,
    barrier: &Barrier,
    place: usize,
    tick: u64,
) -> Result<Option<Delivery>, Failure> {
    let before = tick - 1;
    let (name, slot) = ports.sender(place);
    let takes_part = || barrier.member_since(slot).is_some_and(|since| since <= before);
    if !ports.awaits(place, before) || !takes_part() || barrier.is_mute(slot, before) {
        return Ok(None);
    }
    loop {
        match ports.beacon(place)? {
            Some(beacon) if beacon.tick < before => {}
            Some(beacon) if beacon.tick == before => {
                return Ok(Some(Delivery { place, beacon, taken_ns: 0 }));
            }
            // It died in this very tick, by nobody's plan.
            None if !takes_part() => return Ok(None),
            _ => {
                return Err(missing(tick, &format!("beacon of {name} from tick {before}")));
            }
        }
    }
}

/// A sample that lockstep promises is not there.
fn missing(tick: u64, what: &str) -> Failure {
    format!("lockstep is broken: at tick {tick} there is no {what}").into()
}

/// What the process `phalanx-agent` does: named, logging, and with an exit code that tells.
pub fn main(brief_path: &Path, incarnation: u64, realtime_priority: bool) -> u8 {
    main_with(brief_path, incarnation, realtime_priority, Parts::of)
}

/// The same for a program that has a law, a role or an avoidance method of its own, see [`run`].
pub fn main_with<E: Into<Failure>>(
    brief_path: &Path,
    incarnation: u64,
    realtime_priority: bool,
    parts: impl FnOnce(&AgentBrief) -> Result<Parts, E>,
) -> u8 {
    process::main("phalanx-agent", realtime_priority, || run(brief_path, incarnation, parts))
}
