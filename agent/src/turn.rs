//! One turn of a robot: what has come by now in, what is to be sent out. Pure: no I/O, no clock, no iceoryx2.
//!
//! The process of a robot waits and sends around it (`control_loop`); runs within one process and the
//! tests' adversary call the same. A turn has two halves, [`Turn::sense`] and [`Turn::act`], so that whoever
//! trains a law can act in between.
//!
//! What is decided here: which beacons are heard, which odometry is too old to be answered, which answer is
//! dead before it is sent, which wake-ups count as late, what misses a deadline, when the supervisor is to hear
//! of it all, and for how long a robot may hear nothing of the plant.

use protocol::brief::{AgentBrief, Pace};
use protocol::latency::Recorder;
use protocol::message::{Beacon, Goal, LinkFaultByHand, NeighborStatus, Odometry, StatusHeader};
use protocol::stage::{Cause, Stage};
use protocol::wake::Wake;

use crate::brain::{Answer, Brain};
use crate::laws::Wish;

/// In real time, without a sign of the plant for this long, the agent gives up. Longer than the
/// start-up of a large experiment may take.
pub(crate) const PLANT_SILENCE_MAX_NS: u64 = 30_000_000_000;
/// Of the time between two turns at most this much, or two periods, counts as silence: an agent
/// that was stopped could hear nobody.
const GAP_NS_MAX: u64 = 1_000_000_000;
/// In real time the supervisor hears from every agent at least this often.
const STATUS_EVERY_NS: u64 = 100_000_000;
/// Wake-ups that are kept until a sample shows that the run goes on. More are of a plant in trouble.
const WAKES_MAX: usize = 100;

/// A robot between its turns.
pub struct Turn {
    brief: AgentBrief,
    brain: Brain,
    measured: Recorder,
    /// When the last turn was taken, ns.
    taken_ns: u64,
    /// The moment that its answer goes by: the newest sample's stamp in lockstep, in real time that of
    /// whatever was taken last, ns.
    used_ns: u64,
    /// For how long nothing was heard of the plant, ns.
    silent_ns: u64,
    /// When the supervisor was told last how it goes, ns.
    reported_ns: u64,
    /// Deadline of the wake-up at hand, ns; `None` in lockstep, which has none.
    due_ns: Option<u64>,
    /// Wake-ups that no sample has followed yet: which kind, and how late, ns.
    wakes: Vec<(Stage, u64)>,
    /// How much later than computed the answer at hand is sent on purpose, ns.
    delay_ns: u64,
    /// Until when it was slow on purpose, ns.
    slow_until_ns: u64,
    /// The last answer missed a deadline.
    missed: bool,
    deadline_misses: u64,
    odometry_old: u64,
}

/// What has come since the last turn.
pub struct Inbox<'a, B> {
    /// The machine's clock when it was taken, ns.
    pub taken_ns: u64,
    /// The newest sample, if one came.
    pub odometry: Option<&'a Odometry>,
    /// In lockstep the first tick that the robot takes part in, since it was started or let go; 0 in real time.
    pub member_since: u64,
    /// What those that it hears said. It is taken from their queues as it is asked for, and not before the
    /// robot hears.
    pub beacons: B,
    /// The newest list of links cut and mended by hand, if one came.
    pub cuts: &'a [LinkFaultByHand],
    /// Where somebody outside sends the robot, if that came.
    pub goal: Option<Goal>,
}

/// A beacon that has come.
#[derive(Debug, Clone, Copy)]
pub struct Delivery {
    /// The sender's place among those that the robot hears and its spares, from 0.
    pub place: usize,
    /// What it said.
    pub beacon: Beacon,
    /// The machine's clock when it was taken, ns; of no meaning in lockstep.
    pub taken_ns: u64,
}

/// What is to be sent.
#[derive(Debug)]
pub struct Outbox {
    /// To the plant, and to those that hear the robot; in real time [`Answer::delay_ns`] later.
    pub answer: Option<Answer>,
    /// The supervisor is to hear how it goes, after that.
    pub report: bool,
    /// There was no sign of the plant for so long that the agent is to give up.
    pub plant_silent: bool,
}

/// How a wake-up of real time counts.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Woken {
    /// Not at all: before its first sample, everybody waits for the last one to start.
    Starting,
    /// The robot was frozen or slow on purpose past the deadline: not late by the machine's doing.
    Held,
    /// As it is. `missed`: the answer before missed a deadline.
    Counted {
        /// Whether it did.
        missed: bool,
    },
}

impl Turn {
    /// A robot that has heard nothing yet, at `now_ns` by the machine's clock.
    pub fn new(brief: AgentBrief, brain: Brain, now_ns: u64) -> Turn {
        Turn {
            measured: Recorder::for_ticks_of(brain.incarnation(), rows_per_tick(&brief)),
            brief,
            brain,
            taken_ns: now_ns,
            used_ns: now_ns,
            silent_ns: 0,
            reported_ns: now_ns,
            due_ns: None,
            wakes: Vec::with_capacity(WAKES_MAX + 1),
            delay_ns: 0,
            slow_until_ns: 0,
            missed: false,
            deadline_misses: 0,
            odometry_old: 0,
        }
    }

    /// What the robot was told at its start.
    pub fn brief(&self) -> &AgentBrief {
        &self.brief
    }

    /// What thinks.
    pub fn brain(&self) -> &Brain {
        &self.brain
    }

    /// In real time: it woke up for a turn. `thawed_ns`: when it went on last after a freeze.
    pub fn wake(&mut self, wake: &Wake, thawed_ns: u64) -> Woken {
        self.due_ns = Some(wake.due_ns);
        let missed = std::mem::take(&mut self.missed);
        if !self.brain.has_started() {
            return Woken::Starting;
        }
        let held = wake.due_ns < self.slow_until_ns.max(thawed_ns);
        let (stage, woken) = match held {
            true => (Stage::Held, Woken::Held),
            false => (Stage::Wake, Woken::Counted { missed }),
        };
        self.wakes.push((stage, wake.lateness_ns));
        woken
    }

    /// The wake-up at hand, which counts, was late by this cause.
    pub fn was_late(&mut self, wake: &Wake, cause: Cause) {
        self.wakes.push((cause.stage(), wake.lateness_ns));
    }

    /// One turn: what is to be sent, by what has come.
    pub fn take<E>(
        &mut self,
        inbox: Inbox<'_, impl IntoIterator<Item = Result<Delivery, E>>>,
    ) -> Result<Outbox, E> {
        self.sense(inbox)?;
        let wish = self.wish();
        Ok(self.act(wish))
    }

    /// The first half of a turn: takes in what has come.
    pub fn sense<E>(
        &mut self,
        inbox: Inbox<'_, impl IntoIterator<Item = Result<Delivery, E>>>,
    ) -> Result<(), E> {
        let Inbox { taken_ns, odometry, member_since, beacons, cuts, goal } = inbox;
        self.count_silence(taken_ns, odometry.is_some());
        self.used_ns = match (self.brief.pace, odometry) {
            (Pace::Lockstep, Some(odometry)) => odometry.stamp_ns,
            _ => taken_ns,
        };
        cuts.iter().for_each(|link| self.brain.set_cut(link.robot, link.cut == 1));
        if let Some(goal) = goal {
            self.brain.go_to(&goal);
        }
        // Without another sample the run is over, and everybody late who is not yet told.
        if odometry.is_some() || self.wakes.len() >= WAKES_MAX {
            self.wakes.drain(..).for_each(|(stage, ns)| self.measured.record(stage, 0, ns));
        }
        // At its first sample a robot has heard nothing.
        let joins = odometry.is_some_and(|odometry| odometry.tick <= member_since);
        if self.brain.has_started() && !joins {
            for delivery in beacons {
                self.hear(&delivery?);
            }
        }
        let Some(odometry) = odometry else {
            self.brain.sense_nothing();
            return Ok(());
        };
        self.measured.record(Stage::Odometry, 0, taken_ns.saturating_sub(odometry.sent_ns));
        // Its answer would be dead before it is sent.
        let age_ns = self.used_ns.saturating_sub(odometry.stamp_ns);
        if age_ns >= self.brief.command_lifetime_ns {
            self.odometry_old += 1;
            self.brain.sense_nothing();
        } else {
            self.brain.sense(odometry);
        }
        Ok(())
    }

    /// What the law wants in the situation at hand. To be asked once.
    pub fn wish(&mut self) -> Wish {
        self.brain.wish()
    }

    /// The second half of a turn: what is to be sent, given what the law wants.
    pub fn act(&mut self, wish: Wish) -> Outbox {
        let is_realtime = self.brief.pace == Pace::Realtime;
        let answer = self.brain.act(wish, self.used_ns);
        // In lockstep an answer that takes a period or more is dead before it is sent.
        let answer = answer.filter(|answer| is_realtime || answer.delay_ns < self.brief.period_ns);
        self.delay_ns = answer.map_or(0, |answer| answer.delay_ns);
        let quiet_ns = self.taken_ns.saturating_sub(self.reported_ns);
        let report = self.brain.take_news() | (is_realtime && quiet_ns >= STATUS_EVERY_NS);
        if report {
            self.reported_ns = self.taken_ns;
        }
        Outbox { answer, report, plant_silent: self.silent_ns > PLANT_SILENCE_MAX_NS }
    }

    /// The answer at hand was sent, at `sent_ns` by the machine's clock.
    pub fn sent(&mut self, sent_ns: u64) {
        let compute_ns = sent_ns.saturating_sub(self.taken_ns);
        self.measured.record(Stage::Compute, 0, compute_ns);
        for (from, age_ns) in self.brain.neighborhood().ages(self.used_ns) {
            self.measured.record(Stage::BeaconAge, from, age_ns);
        }
        let Some(due_ns) = self.due_ns else { return };
        if self.delay_ns > 0 {
            self.slow_until_ns = sent_ns;
        }
        let misses = sent_ns.saturating_sub(due_ns) / self.brief.period_ns;
        self.deadline_misses += misses;
        self.missed = misses > 0;
    }

    /// How it goes, for the supervisor.
    pub fn status(&self) -> (StatusHeader, impl ExactSizeIterator<Item = NeighborStatus>) {
        let (header, neighbors) = self.brain.status();
        let &Turn { deadline_misses, odometry_old, .. } = self;
        (StatusHeader { deadline_misses, odometry_old, ..header }, neighbors)
    }

    /// What it measured and has not sent.
    pub fn measured(&self) -> &Recorder {
        &self.measured
    }

    /// Whether that is to be sent now: in lockstep by how much it is alone, so that what arrives of a robot
    /// that is killed depends on nothing but the tick.
    pub fn batch_is_due(&self) -> bool {
        match self.brief.pace {
            Pace::Lockstep => self.measured.is_half_full(),
            Pace::Realtime => self.measured.is_due(self.taken_ns),
        }
    }

    /// The same with how old was what it heard since the batch before: to be sent, and then cleared.
    pub fn batch(&mut self) -> &mut Recorder {
        for (from, sums) in self.brain.take_ages(self.used_ns) {
            self.measured.record_age(from, &sums);
        }
        &mut self.measured
    }

    fn hear(&mut self, delivery: &Delivery) {
        let &Delivery { place, beacon, taken_ns } = delivery;
        if !self.brain.neighborhood().awaits(place, beacon.tick) {
            return;
        }
        let neighbor = self.brief.sender(place);
        if self.brief.pace == Pace::Realtime {
            let under_way_ns = taken_ns.saturating_sub(beacon.sent_ns);
            self.measured.record(Stage::BeaconDelivery, neighbor.index, under_way_ns);
            self.used_ns = self.used_ns.max(taken_ns);
        }
        // A refusal is counted; in real time one beacon may overtake another.
        if let Err(refusal) = self.brain.hear(place, &beacon, self.used_ns) {
            tracing::debug!(neighbor = neighbor.name, %refusal, "beacon refused");
        }
    }

    fn count_silence(&mut self, now_ns: u64, heard: bool) {
        let gap_ns = now_ns.saturating_sub(self.taken_ns);
        self.silent_ns = match heard {
            true => 0,
            false => self.silent_ns + gap_ns.min(GAP_NS_MAX.max(2 * self.brief.period_ns)),
        };
        self.taken_ns = now_ns;
    }
}

/// How many values an agent measures in one tick, at most.
fn rows_per_tick(brief: &AgentBrief) -> usize {
    3 + 2 * brief.senders().count()
}

#[cfg(test)]
mod tests;
