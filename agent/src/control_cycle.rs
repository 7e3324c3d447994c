//! Control cycle of a robot: received messages in, messages to send out. It does no I/O and reads no clock.
//!
//! The process of a robot waits and sends around it (`control_loop`). In-process runs and the adversarial tests
//! call the same code. A cycle has two halves, [`ControlCycle::sense`] and [`ControlCycle::act`], so that a training
//! environment can act in between.
//!
//! Decided here: which beacons count, which odometry is too old to be answered, which answer expires before it
//! is sent, which wake-ups count as late, which answers miss a deadline, when the supervisor gets a report, and
//! how long a robot waits for a silent plant.

use std::borrow::Borrow;

use formation::desired::Target;
use protocol::brief::{AgentBrief, NeighborBrief, Pace};
use protocol::latency::{LatencyRecorder, robot_rows_per_tick};
use protocol::law_message::{Broadcast, GapCounter, SendDecision, SentCounts};
use protocol::message::{Goal, LinkFaultByHand, NeighborStatus, Odometry, StatusHeader};
use protocol::stage::{LatenessCause, Stage};
use protocol::wake::{StaggeredInterval, WakeUp};

use crate::controller::{Answer, Controller};
use crate::laws::LawOutput;

/// Maximum time without a sign of the plant in real time. After it the agent exits with an error. Longer than
/// the start-up of a large experiment may take.
pub(crate) const PLANT_SILENCE_MAX_NS: u64 = 30_000_000_000;
/// Maximum time without a sign of the plant before the first sample, ns. The plant begins once all robots are
/// ready, and some may start slowly.
pub(crate) const PLANT_START_WAIT_MAX_NS: u64 = 3_600_000_000_000;
/// Maximum part of the time between two cycles that counts as silence, or two periods if they are longer: an
/// agent that was stopped could not receive anything.
const COUNTED_SILENCE_NS_MAX: u64 = 1_000_000_000;
/// Time in which a robot sends at least one report to the supervisor in real time, ns.
const STATUS_INTERVAL_NS: u64 = 100_000_000;
/// Maximum number of wake-ups that are kept until a sample shows that the run continues. More occur only if the
/// plant is in trouble.
const STORED_WAKE_UPS_MAX: usize = 100;

/// State of a robot between its control cycles.
pub struct ControlCycle {
    controller: Controller,
    measurements: LatencyRecorder,
    /// Start of the last cycle, ns.
    cycle_start_ns: u64,
    /// Reference time of the answer, ns: the stamp of the newest sample in lockstep, the time of the last
    /// reception in real time.
    answer_reference_ns: u64,
    /// Time without a sign of the plant, ns.
    plant_silence_ns: u64,
    /// Time of the last report to the supervisor, ns.
    last_status_ns: u64,
    status_interval: StaggeredInterval,
    /// Deadline of the current wake-up, ns. `None` in lockstep, which has no deadlines.
    deadline_ns: Option<u64>,
    /// Wake-ups without a following sample: kind, and lateness, ns.
    stored_wake_ups: Vec<(Stage, u64)>,
    /// Intended additional delay of the current answer, ns.
    answer_delay_ns: u64,
    /// Time until which the robot was slow because of a fault, ns.
    slow_until_ns: u64,
    /// `true` if the last answer missed a deadline.
    missed_deadline: bool,
    deadline_misses: u64,
    old_odometry_count: u64,
    /// Beacons and messages that left with the answers, and messages that a queue dropped before they arrived.
    sent_counts: SentCounts,
    /// Counters of missing messages, for each in-neighbor; `None` if its law sends none. Empty if no law does.
    gap_counters: Vec<Option<GapCounter>>,
}

/// Messages received since the last control cycle.
pub struct Inbox<'a, B> {
    /// Time of reception by the machine's clock, ns.
    pub received_ns: u64,
    /// Newest sample, if one was received.
    pub odometry: Option<&'a Odometry>,
    /// First lockstep tick in which the robot takes part since it was started or resumed. 0 in real time.
    pub participant_since_tick: u64,
    /// Beacons of the senders. Each one is taken from its queue when the iterator reaches it, and none before
    /// the robot has started.
    pub beacons: B,
    /// Newest list of links cut and restored interactively. Empty if none was received.
    pub link_faults: &'a [LinkFaultByHand],
    /// Goal from an external client, if one was received.
    pub goal: Option<Goal>,
}

/// A received beacon with the message of the sender's law, if it came with one. `B` is a [`Broadcast`], or borrows
/// one from a sender in the same process.
#[derive(Debug, Clone)]
pub struct ReceivedBeacon<B = Broadcast> {
    /// Index of the sender among the in-neighbors and spares, from 0.
    pub sender_index: usize,
    /// The received beacon and message.
    pub broadcast: B,
    /// Time of reception by the machine's clock, ns. Not used in lockstep.
    pub received_ns: u64,
}

/// Messages to be sent. A driver uses the same outbox in all cycles, because an answer is large.
#[derive(Debug, Default)]
pub struct Outbox {
    /// Answer to the plant and to the out-neighbors. In real time it is sent [`Answer::delay_ns`] later.
    pub answer: Option<Answer>,
    /// Message of the answer, if the supervisor records messages; otherwise empty. It is reported with the status.
    pub recorded_message: Vec<u8>,
    /// `true` if the status has to be reported to the supervisor afterwards.
    pub status_is_due: bool,
    /// `true` if the silence of the plant exceeds the maximum, so that the agent has to exit.
    pub is_plant_silent: bool,
}

/// Classification of a wake-up in real time.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum WakeUpClass {
    /// Before the first sample, while all robots wait for the last one to start. Not counted.
    Starting,
    /// The robot was frozen, or slow because of a fault, past the deadline. Not a lateness caused by the
    /// machine.
    DelayedByFault,
    /// Its lateness counts as caused by this machine.
    Counted {
        /// Whether the previous answer missed a deadline.
        missed_deadline: bool,
    },
}

impl ControlCycle {
    /// Creates the state of a robot that has received nothing yet, at `now_ns` by the machine's clock.
    pub fn new(controller: Controller, now_ns: u64) -> ControlCycle {
        let brief = controller.brief();
        let gap_counter =
            |neighbor: &NeighborBrief| neighbor.message.as_ref().map(|_| GapCounter::default());
        let mut gap_counters: Vec<_> = brief.neighbors.iter().map(gap_counter).collect();
        if gap_counters.iter().all(Option::is_none) {
            gap_counters.clear();
        }
        ControlCycle {
            gap_counters,
            measurements: LatencyRecorder::for_process(
                brief.index,
                controller.incarnation(),
                robot_rows_per_tick(brief.senders().count()),
            ),
            status_interval: StaggeredInterval::new(STATUS_INTERVAL_NS, brief.index),
            controller,
            cycle_start_ns: now_ns,
            answer_reference_ns: now_ns,
            plant_silence_ns: 0,
            last_status_ns: now_ns,
            deadline_ns: None,
            stored_wake_ups: Vec::with_capacity(STORED_WAKE_UPS_MAX + 1),
            answer_delay_ns: 0,
            slow_until_ns: 0,
            missed_deadline: false,
            deadline_misses: 0,
            old_odometry_count: 0,
            sent_counts: SentCounts::default(),
        }
    }

    /// Returns the robot's brief.
    pub fn brief(&self) -> &AgentBrief {
        self.controller.brief()
    }

    /// Returns the controller.
    pub fn controller(&self) -> &Controller {
        &self.controller
    }

    /// Records a wake-up (real time only). `thawed_ns` is the time of the last resumption after a freeze.
    pub fn record_wake_up(&mut self, wake: &WakeUp, thawed_ns: u64) -> WakeUpClass {
        self.deadline_ns = Some(wake.due_ns);
        let missed_deadline = std::mem::take(&mut self.missed_deadline);
        if !self.controller.has_started() {
            return WakeUpClass::Starting;
        }
        let is_delayed_by_fault = wake.due_ns < self.slow_until_ns.max(thawed_ns);
        let (stage, class) = match is_delayed_by_fault {
            true => (Stage::PlannedDelay, WakeUpClass::DelayedByFault),
            false => (Stage::Wake, WakeUpClass::Counted { missed_deadline }),
        };
        self.stored_wake_ups.push((stage, wake.lateness_ns));
        class
    }

    /// Records the cause of the lateness of the current wake-up, which counts.
    pub fn record_lateness(&mut self, wake: &WakeUp, cause: LatenessCause) {
        self.stored_wake_ups.push((cause.stage(), wake.lateness_ns));
    }

    /// Runs one control cycle. Returns the messages to be sent, or the first error of `beacons`.
    pub fn run<E, B: Borrow<Broadcast>>(
        &mut self,
        inbox: Inbox<'_, impl IntoIterator<Item = Result<ReceivedBeacon<B>, E>>>,
    ) -> Result<Outbox, E> {
        self.sense(inbox)?;
        let mut outbox = Outbox::default();
        self.answer(&mut outbox);
        Ok(outbox)
    }

    /// Runs the second half of a cycle with the output of the control law.
    pub fn answer(&mut self, outbox: &mut Outbox) {
        let output = self.law_output();
        self.act(output, outbox);
    }

    /// Runs the first half of a cycle: processes the received messages. Returns the first error of `beacons`.
    pub fn sense<E, B: Borrow<Broadcast>>(
        &mut self,
        inbox: Inbox<'_, impl IntoIterator<Item = Result<ReceivedBeacon<B>, E>>>,
    ) -> Result<(), E> {
        let Inbox { received_ns, odometry, participant_since_tick, beacons, link_faults, goal } =
            inbox;
        self.count_silence(received_ns, odometry.is_some());
        self.answer_reference_ns = match (self.brief().pace, odometry) {
            (Pace::Lockstep, Some(odometry)) => odometry.stamp_ns,
            _ => received_ns,
        };
        link_faults.iter().for_each(|link| self.controller.set_link_cut(link.robot, link.cut == 1));
        if let Some(goal) = goal {
            self.controller.request_goal(&goal);
        }
        // Without another sample the run is over, and wake-ups after its end do not count.
        if odometry.is_some() || self.stored_wake_ups.len() >= STORED_WAKE_UPS_MAX {
            for &(stage, lateness_ns) in &self.stored_wake_ups {
                self.measurements.record(stage, 0, lateness_ns);
            }
            self.stored_wake_ups.clear();
        }
        // At its first sample a robot has not received anything.
        let is_joining = odometry.is_some_and(|odometry| odometry.tick <= participant_since_tick);
        if self.controller.has_started() && !is_joining {
            for delivery in beacons {
                match delivery {
                    // By reference, because a beacon is large.
                    Ok(ReceivedBeacon { sender_index, ref broadcast, received_ns }) => {
                        self.receive_broadcast(sender_index, broadcast.borrow(), received_ns);
                    }
                    Err(error) => return Err(error),
                }
            }
        }
        let Some(odometry) = odometry else {
            self.controller.clear_sample();
            return Ok(());
        };
        self.measurements.record(Stage::Odometry, 0, received_ns.saturating_sub(odometry.sent_ns));
        // The answer would expire before it is sent.
        let age_ns = self.answer_reference_ns.saturating_sub(odometry.stamp_ns);
        if age_ns >= self.brief().command_lifetime_ns {
            self.old_odometry_count += 1;
            self.controller.clear_sample();
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
    pub fn set_send_decision(&mut self, decision: SendDecision) {
        self.controller.set_send_decision(decision);
    }

    /// Sets the target of a free robot at the current sample, in place of the law's choice.
    pub fn set_own_target(&mut self, target: Option<Target>) {
        self.controller.set_own_target(target);
    }

    /// Runs the second half of a cycle: writes the messages to be sent over `outbox`, given the output of the control
    /// law.
    pub fn act(&mut self, output: LawOutput, outbox: &mut Outbox) {
        let is_realtime = self.brief().pace == Pace::Realtime;
        let Outbox { answer, recorded_message, status_is_due, is_plant_silent } = outbox;
        self.controller.act(output, self.answer_reference_ns, answer);
        *is_plant_silent = self.plant_silence_ns > self.silence_max_ns();
        // In lockstep an answer delayed by a period or more expires before it is sent.
        if !is_realtime && (answer.as_ref()).is_some_and(|it| it.delay_ns >= self.brief().period_ns)
        {
            *answer = None;
        }
        self.answer_delay_ns = answer.as_ref().map_or(0, |answer| answer.delay_ns);
        if let Some(answer) = answer {
            if let Some(broadcast) = answer.outgoing_broadcast() {
                self.sent_counts.count_sent(broadcast);
            }
            answer.broadcast.beacon.messages_sent = self.sent_counts.messages;
        }
        let is_due = is_realtime
            && self.status_interval.begins_between(self.last_status_ns, self.cycle_start_ns);
        // The values of a sample are reported with it, so that none is lost.
        recorded_message.clear();
        if let Some(answer) = answer.as_ref().filter(|_| self.brief().records_messages) {
            recorded_message.extend_from_slice(answer.message());
        }
        *status_is_due = self.controller.take_status_change()
            | is_due
            | self.controller.has_signals()
            | !recorded_message.is_empty();
        if *status_is_due {
            self.last_status_ns = self.cycle_start_ns;
        }
    }

    /// Returns for how long the plant may be silent, ns.
    pub(crate) fn silence_max_ns(&self) -> u64 {
        if self.controller.has_started() { PLANT_SILENCE_MAX_NS } else { PLANT_START_WAIT_MAX_NS }
    }

    /// Records that the current answer was sent at `sent_ns` by the machine's clock.
    pub fn record_sent(&mut self, sent_ns: u64) {
        let compute_ns = sent_ns.saturating_sub(self.cycle_start_ns);
        self.measurements.record(Stage::Compute, 0, compute_ns);
        for (from, age_ns) in
            self.controller.neighborhood().beacon_ages_ns(self.answer_reference_ns)
        {
            self.measurements.record(Stage::BeaconAge, from, age_ns);
        }
        let Some(due_ns) = self.deadline_ns else { return };
        if self.answer_delay_ns > 0 {
            self.slow_until_ns = sent_ns;
        }
        let misses = sent_ns.saturating_sub(due_ns) / self.brief().period_ns;
        self.deadline_misses += misses;
        self.missed_deadline = misses > 0;
    }

    /// Returns the status for the supervisor.
    pub fn status(&self) -> (StatusHeader, impl ExactSizeIterator<Item = NeighborStatus>) {
        let (header, neighbors) = self.controller.status();
        let &ControlCycle { deadline_misses, old_odometry_count: odometry_old, .. } = self;
        let sent = self.sent_counts();
        let header = StatusHeader {
            deadline_misses,
            odometry_old,
            beacons_sent: sent.beacons,
            messages_sent: sent.messages,
            message_hash: sent.message_hash,
            messages_dropped: sent.dropped_messages,
            ..header
        };
        (header, neighbors)
    }

    /// Returns the beacons and messages that this robot has sent, and the messages that its law has not received.
    pub fn sent_counts(&self) -> SentCounts {
        let not_queued = self.controller.neighborhood().messages_dropped();
        SentCounts {
            dropped_messages: self.sent_counts.dropped_messages.saturating_add(not_queued),
            ..self.sent_counts
        }
    }

    /// Returns the measurements not sent yet.
    pub fn measurements(&self) -> &LatencyRecorder {
        &self.measurements
    }

    /// Returns whether the measurements have to be sent now. In lockstep this depends only on their number, so
    /// that the measurements of a killed robot depend on nothing but the tick.
    pub fn batch_is_due(&self) -> bool {
        match self.brief().pace {
            Pace::Lockstep => self.measurements.is_half_full(),
            Pace::Realtime => self.measurements.is_due(self.cycle_start_ns),
        }
    }

    /// Returns the measurements with the information ages since the previous batch. The caller sends and clears
    /// them.
    pub fn measurement_batch(&mut self) -> &mut LatencyRecorder {
        for (from, sums) in self.controller.take_information_ages(self.answer_reference_ns) {
            self.measurements.record_age(from, &sums);
        }
        &mut self.measurements
    }

    fn receive_broadcast(&mut self, sender_index: usize, broadcast: &Broadcast, received_ns: u64) {
        let Broadcast { beacon, message } = broadcast;
        if !self.controller.neighborhood().needs_beacon_of_tick(sender_index, beacon.tick) {
            return;
        }
        // Before the faults of the link, which lose messages on purpose. A backup neighbor is not received all the
        // time.
        if let Some(Some(gaps)) = self.gap_counters.get_mut(sender_index) {
            self.sent_counts.dropped_messages = self
                .sent_counts
                .dropped_messages
                .saturating_add(gaps.record_beacon(beacon, message.is_some()));
        }
        if self.brief().pace == Pace::Realtime {
            let delivery_ns = received_ns.saturating_sub(beacon.sent_ns);
            let from = self.brief().sender(sender_index).index;
            self.measurements.record(Stage::BeaconDelivery, from, delivery_ns);
            self.answer_reference_ns = self.answer_reference_ns.max(received_ns);
        }
        // A refusal is counted. In real time one beacon may overtake another.
        let now_ns = self.answer_reference_ns;
        if let Err(refusal) = self.controller.receive_broadcast(sender_index, broadcast, now_ns) {
            let neighbor = self.brief().sender(sender_index);
            tracing::debug!(neighbor = neighbor.name, %refusal, "beacon refused");
        }
    }

    fn count_silence(&mut self, now_ns: u64, has_odometry: bool) {
        let gap_ns = now_ns.saturating_sub(self.cycle_start_ns);
        self.plant_silence_ns = match has_odometry {
            true => 0,
            false => {
                self.plant_silence_ns
                    + gap_ns.min(COUNTED_SILENCE_NS_MAX.max(2 * self.brief().period_ns))
            }
        };
        self.cycle_start_ns = now_ns;
    }
}

#[cfg(test)]
mod tests;
