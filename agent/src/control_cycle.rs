//! Control cycle of a robot: received messages in, messages to send out. It does no I/O and reads no clock.
//!
//! The process of a robot waits and sends around it (`control_loop`). In-process runs and the adversarial tests
//! call the same code. A cycle has two halves, [`ControlCycle::sense`] and [`ControlCycle::act`], so that a training
//! environment can act in between.
//!
//! Decided here: which beacons count, which odometry is too old to be answered, which answer expires before it
//! is sent, which wake-ups count as late, which answers miss a deadline, when the supervisor gets a report, and
//! how long a robot waits for a silent plant.

use std::sync::Arc;

use formation::desired::Target;
use protocol::brief::{AgentBrief, Pace};
use protocol::latency::Recorder;
use protocol::law_message::{Broadcast, Outgoing, SentCounts};
use protocol::message::{Beacon, Goal, LinkFaultByHand, NeighborStatus, Odometry, StatusHeader};
use protocol::stage::{Cause, Stage};
use protocol::wake::Wake;

use crate::controller::{Answer, Controller};
use crate::laws::LawOutput;

/// Maximum time without a sign of the plant in real time. After it the agent exits with an error. Longer than
/// the start-up of a large experiment may take.
pub(crate) const PLANT_SILENCE_MAX_NS: u64 = 30_000_000_000;
/// Maximum time without a sign of the plant before the first sample, ns. The plant begins once all robots are
/// ready, and some may start slowly.
pub(crate) const PLANT_STARTS_WITHIN_NS: u64 = 3_600_000_000_000;
/// Maximum part of the time between two cycles that counts as silence, or two periods if they are longer: an
/// agent that was stopped could not receive anything.
const GAP_NS_MAX: u64 = 1_000_000_000;
/// Maximum time between two reports to the supervisor in real time.
const STATUS_EVERY_NS: u64 = 100_000_000;
/// Maximum number of wake-ups that are kept until a sample shows that the run continues. More occur only if the
/// plant is in trouble.
const WAKES_MAX: usize = 100;

/// State of a robot between its control cycles.
pub struct ControlCycle {
    brief: AgentBrief,
    controller: Controller,
    measured: Recorder,
    /// Start of the last cycle, ns.
    cycle_start_ns: u64,
    /// Reference time of the answer, ns: the stamp of the newest sample in lockstep, the time of the last
    /// reception in real time.
    used_ns: u64,
    /// Time without a sign of the plant, ns.
    silent_ns: u64,
    /// Time of the last report to the supervisor, ns.
    reported_ns: u64,
    /// Deadline of the current wake-up, ns. `None` in lockstep, which has no deadlines.
    due_ns: Option<u64>,
    /// Wake-ups without a following sample: kind, and lateness, ns.
    wakes: Vec<(Stage, u64)>,
    /// Intended additional delay of the current answer, ns.
    delay_ns: u64,
    /// Time until which the robot was slow because of a fault, ns.
    slow_until_ns: u64,
    /// `true` if the last answer missed a deadline.
    missed: bool,
    deadline_misses: u64,
    odometry_old: u64,
    /// Beacons and messages that left with the answers.
    sent: SentCounts,
}

/// Messages received since the last control cycle.
pub struct Inbox<'a, B> {
    /// Time of reception by the machine's clock, ns.
    pub received_ns: u64,
    /// Newest sample, if one was received.
    pub odometry: Option<&'a Odometry>,
    /// First lockstep tick in which the robot takes part since it was started or resumed. 0 in real time.
    pub member_since: u64,
    /// Beacons of the senders. Each one is taken from its queue when the iterator reaches it, and none before
    /// the robot has started.
    pub beacons: B,
    /// Newest list of links cut and restored interactively. Empty if none was received.
    pub cuts: &'a [LinkFaultByHand],
    /// Goal from an external client, if one was received.
    pub goal: Option<Goal>,
}

/// A received beacon.
#[derive(Debug, Clone)]
pub struct Delivery {
    /// Index of the sender among the in-neighbors and spares, from 0.
    pub place: usize,
    /// The received beacon.
    pub beacon: Beacon,
    /// Message of the sender's law, if it came with the beacon.
    pub message: Option<Arc<[u8]>>,
    /// Time of reception by the machine's clock, ns. Not used in lockstep.
    pub received_ns: u64,
}

/// Messages to be sent.
#[derive(Debug)]
pub struct Outbox {
    /// Answer to the plant and to the out-neighbors. In real time it is sent [`Answer::delay_ns`] later.
    pub answer: Option<Answer>,
    /// `true` if the status has to be reported to the supervisor afterwards.
    pub report: bool,
    /// `true` if the silence of the plant exceeds the maximum, so that the agent has to exit.
    pub plant_silent: bool,
}

/// Classification of a wake-up in real time.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Woken {
    /// Before the first sample, while all robots wait for the last one to start. Not counted.
    Starting,
    /// The robot was frozen, or slow because of a fault, past the deadline. Not a lateness caused by the
    /// machine.
    Held,
    /// Counted. `missed` tells whether the previous answer missed a deadline.
    Counted {
        /// Whether the previous answer missed a deadline.
        missed: bool,
    },
}

impl ControlCycle {
    /// Creates the state of a robot that has received nothing yet, at `now_ns` by the machine's clock.
    pub fn new(brief: AgentBrief, controller: Controller, now_ns: u64) -> ControlCycle {
        ControlCycle {
            measured: Recorder::for_ticks_of(controller.incarnation(), rows_per_tick(&brief)),
            brief,
            controller,
            cycle_start_ns: now_ns,
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
            sent: SentCounts::default(),
        }
    }

    /// Returns the robot's brief.
    pub fn brief(&self) -> &AgentBrief {
        &self.brief
    }

    /// Returns the controller.
    pub fn controller(&self) -> &Controller {
        &self.controller
    }

    /// Records a wake-up (real time only). `thawed_ns` is the time of the last resumption after a freeze.
    pub fn wake(&mut self, wake: &Wake, thawed_ns: u64) -> Woken {
        self.due_ns = Some(wake.due_ns);
        let missed = std::mem::take(&mut self.missed);
        if !self.controller.has_started() {
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

    /// Records the cause of the lateness of the current wake-up, which counts.
    pub fn record_lateness(&mut self, wake: &Wake, cause: Cause) {
        self.wakes.push((cause.stage(), wake.lateness_ns));
    }

    /// Runs one control cycle. Returns the messages to be sent, or the first error of `beacons`.
    pub fn run<E>(
        &mut self,
        inbox: Inbox<'_, impl IntoIterator<Item = Result<Delivery, E>>>,
    ) -> Result<Outbox, E> {
        self.sense(inbox)?;
        let output = self.law_output();
        Ok(self.act(output))
    }

    /// Runs the first half of a cycle: processes the received messages. Returns the first error of `beacons`.
    pub fn sense<E>(
        &mut self,
        inbox: Inbox<'_, impl IntoIterator<Item = Result<Delivery, E>>>,
    ) -> Result<(), E> {
        let Inbox { received_ns: taken_ns, odometry, member_since, beacons, cuts, goal } = inbox;
        self.count_silence(taken_ns, odometry.is_some());
        self.used_ns = match (self.brief.pace, odometry) {
            (Pace::Lockstep, Some(odometry)) => odometry.stamp_ns,
            _ => taken_ns,
        };
        cuts.iter().for_each(|link| self.controller.set_cut(link.robot, link.cut == 1));
        if let Some(goal) = goal {
            self.controller.go_to(&goal);
        }
        // Without another sample the run is over, and wake-ups after its end do not count.
        if odometry.is_some() || self.wakes.len() >= WAKES_MAX {
            self.wakes.drain(..).for_each(|(stage, ns)| self.measured.record(stage, 0, ns));
        }
        // At its first sample a robot has not received anything.
        let joins = odometry.is_some_and(|odometry| odometry.tick <= member_since);
        if self.controller.has_started() && !joins {
            for delivery in beacons {
                self.receive_delivery(delivery?);
            }
        }
        let Some(odometry) = odometry else {
            self.controller.sense_nothing();
            return Ok(());
        };
        self.measured.record(Stage::Odometry, 0, taken_ns.saturating_sub(odometry.sent_ns));
        // The answer would expire before it is sent.
        let age_ns = self.used_ns.saturating_sub(odometry.stamp_ns);
        if age_ns >= self.brief.command_lifetime_ns {
            self.odometry_old += 1;
            self.controller.sense_nothing();
        } else {
            self.controller.sense(odometry);
        }
        Ok(())
    }

    /// Returns the output of the control law for the current sample. Must be called once per cycle.
    pub fn law_output(&mut self) -> LawOutput {
        self.controller.law_output()
    }

    /// Sets what leaves to the out-neighbors with the next answer, in place of the law's choice.
    pub fn set_outgoing(&mut self, outgoing: Outgoing) {
        self.controller.set_outgoing(outgoing);
    }

    /// Sets the target of a free robot at the current sample, in place of the law's choice.
    pub fn set_own_target(&mut self, target: Option<Target>) {
        self.controller.set_own_target(target);
    }

    /// Runs the second half of a cycle: returns the messages to be sent, given the output of the control law.
    pub fn act(&mut self, output: LawOutput) -> Outbox {
        let is_realtime = self.brief.pace == Pace::Realtime;
        let answer = self.controller.act(output, self.used_ns);
        // In lockstep an answer delayed by a period or more expires before it is sent.
        let answer = answer.filter(|answer| is_realtime || answer.delay_ns < self.brief.period_ns);
        self.delay_ns = answer.as_ref().map_or(0, |answer| answer.delay_ns);
        if let Some(answer) = &answer {
            self.sent.count(answer.beacon.tick, &answer.outgoing);
        }
        let quiet_ns = self.cycle_start_ns.saturating_sub(self.reported_ns);
        let is_due = match is_realtime {
            true => quiet_ns >= STATUS_EVERY_NS,
            // The counts of a killed robot thus depend on nothing but the tick.
            false => self.brief.counts_sent && answer.is_some(),
        };
        // The values of a sample are reported with it, so that none is lost.
        let report = self.controller.take_news() | is_due | self.controller.has_signals();
        if report {
            self.reported_ns = self.cycle_start_ns;
        }
        Outbox { answer, report, plant_silent: self.silent_ns > self.silence_max_ns() }
    }

    /// Returns for how long the plant may be silent, ns.
    pub(crate) fn silence_max_ns(&self) -> u64 {
        if self.controller.has_started() { PLANT_SILENCE_MAX_NS } else { PLANT_STARTS_WITHIN_NS }
    }

    /// Records that the current answer was sent at `sent_ns` by the machine's clock.
    pub fn record_sent(&mut self, sent_ns: u64) {
        let compute_ns = sent_ns.saturating_sub(self.cycle_start_ns);
        self.measured.record(Stage::Compute, 0, compute_ns);
        for (from, age_ns) in self.controller.neighborhood().ages(self.used_ns) {
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

    /// Returns the status for the supervisor.
    pub fn status(&self) -> (StatusHeader, impl ExactSizeIterator<Item = NeighborStatus>) {
        let (header, neighbors) = self.controller.status();
        let &ControlCycle { deadline_misses, odometry_old, sent, .. } = self;
        let header = StatusHeader {
            deadline_misses,
            odometry_old,
            beacons_sent: sent.beacons,
            messages_sent: sent.messages,
            message_hash: sent.message_hash,
            ..header
        };
        (header, neighbors)
    }

    /// Returns the measurements not sent yet.
    pub fn measured(&self) -> &Recorder {
        &self.measured
    }

    /// Returns whether the measurements have to be sent now. In lockstep this depends only on their number, so
    /// that the measurements of a killed robot depend on nothing but the tick.
    pub fn batch_is_due(&self) -> bool {
        match self.brief.pace {
            Pace::Lockstep => self.measured.is_half_full(),
            Pace::Realtime => self.measured.is_due(self.cycle_start_ns),
        }
    }

    /// Returns the measurements with the information ages since the previous batch. The caller sends and clears
    /// them.
    pub fn batch(&mut self) -> &mut Recorder {
        for (from, sums) in self.controller.take_ages(self.used_ns) {
            self.measured.record_age(from, &sums);
        }
        &mut self.measured
    }

    fn receive_delivery(&mut self, delivery: Delivery) {
        let Delivery { place, beacon, message, received_ns: taken_ns } = delivery;
        if !self.controller.neighborhood().needs_beacon_of_tick(place, beacon.tick) {
            return;
        }
        let neighbor = self.brief.sender(place);
        if self.brief.pace == Pace::Realtime {
            let under_way_ns = taken_ns.saturating_sub(beacon.sent_ns);
            self.measured.record(Stage::BeaconDelivery, neighbor.index, under_way_ns);
            self.used_ns = self.used_ns.max(taken_ns);
        }
        // A refusal is counted. In real time one beacon may overtake another.
        if let Err(refusal) =
            self.controller.receive(place, Broadcast { beacon, message }, self.used_ns)
        {
            tracing::debug!(neighbor = neighbor.name, %refusal, "beacon refused");
        }
    }

    fn count_silence(&mut self, now_ns: u64, heard: bool) {
        let gap_ns = now_ns.saturating_sub(self.cycle_start_ns);
        self.silent_ns = match heard {
            true => 0,
            false => self.silent_ns + gap_ns.min(GAP_NS_MAX.max(2 * self.brief.period_ns)),
        };
        self.cycle_start_ns = now_ns;
    }
}

/// Returns the maximum number of values that an agent measures in one tick.
fn rows_per_tick(brief: &AgentBrief) -> usize {
    3 + 2 * brief.senders().count()
}

#[cfg(test)]
mod tests;
