//! Neighborhood of a robot: its in-neighbors, their newest beacons and ages, communication timeouts, and the
//! replacement of neighbors that are lost for long.

mod frames;
mod repair;

use std::collections::VecDeque;
use std::iter::repeat_n;
use std::sync::Arc;

use formation::Vec2;
use formation::desired::{Target, mean_target};
use formation::frame::LeaderFrame;
use formation::resilient::{ReceivedValue, resilient_frame, resilient_target};
use formation::rewiring::{Receiver, References};
use protocol::age::{AgeSums, EdgeAgeIntegrator};
use protocol::brief::{AgentBrief, NeighborBrief, RangeBrief, SilenceBrief, SilencePolicy};
use protocol::law_message::{Broadcast, MessageFormat, ReceivedMessage};
use protocol::message::{Beacon, NeighborStatus, ReceptionState};

use crate::laws::situation::NeighborEstimate;
pub use frames::ReceivedFrame;
use frames::ReceivedFrames;
use repair::{FailureDeclaration, ReferenceUse, SpareOpeningTime};

/// The in-neighbors and spares (backup neighbors) of a robot, in the order of the brief. Indices count over both.
pub struct Neighborhood {
    neighbors: Vec<Neighbor>,
    /// Index of the first spare.
    first_spare_index: usize,
    repair_after_ns: u64,
    /// The plans for failures of the senders.
    receiver: Receiver,
    /// Whether any failure changes the references.
    has_repair_plan: bool,
    references: References,
    silence: SilenceBrief,
    /// Number of values that W-MSR discards on either side (F).
    liars_max: usize,
    /// Maximum number of messages of a neighbor that are kept for the law; 0 if it takes only the newest one.
    messages_queued_max: usize,
    messages_dropped: u64,
    /// Leader frames relayed by the in-neighbors.
    received_frames: ReceivedFrames,
    leader_frame_reception: TimedReceptionState,
    /// Stamp of the first sample, ns, from which timeouts are counted.
    first_sample_ns: Option<u64>,
    /// `true` for a restarted leader, which receives from its deputies (its spares) until it takes back the
    /// lead.
    is_restarted_leader: bool,
}

struct Neighbor {
    index: u64,
    /// `true` for a trusted node, whose values W-MSR never discards.
    is_trusted: bool,
    offset: Vec2,
    newest_beacon: Option<Beacon>,
    /// Format of its messages; `None` if its law sends none.
    message_format: Option<Arc<MessageFormat>>,
    /// Newest message of its present incarnation, and the stamp of the beacon that carried it, ns.
    newest_message: Option<(u64, Arc<[u8]>)>,
    /// Messages that the law has not seen yet, oldest first, with the stamps of their beacons; only if the law asks for
    /// all of them.
    queued_messages: VecDeque<(u64, Arc<[u8]>)>,
    reception: TimedReceptionState,
    age_integrator: EdgeAgeIntegrator,
    failure_declaration: FailureDeclaration,
    reference_use: ReferenceUse,
    /// Time since which a spare is received; `None` while it is closed, and for an in-neighbor.
    opening_time: Option<SpareOpeningTime>,
    /// Communication by distance; `None` if it is received at any distance.
    range_state: Option<RangeState>,
}

/// State of the communication by distance with a neighbor.
#[derive(Debug, Clone, Copy)]
struct RangeState {
    brief: RangeBrief,
    /// Stamp since which the neighbor is in range, ns; `None` while it is not.
    connected_ns: Option<u64>,
}

impl Neighbor {
    fn new(brief: &NeighborBrief, is_spare: bool) -> Neighbor {
        Neighbor {
            index: brief.index as u64,
            is_trusted: brief.trusted,
            offset: Vec2::from(brief.offset_m),
            newest_beacon: None,
            message_format: brief.message.clone().map(Arc::new),
            newest_message: None,
            queued_messages: VecDeque::new(),
            reception: TimedReceptionState::default(),
            age_integrator: EdgeAgeIntegrator::default(),
            failure_declaration: FailureDeclaration::default(),
            reference_use: ReferenceUse { is_used: !is_spare, last_change_t_ns: 0 },
            opening_time: None,
            range_state: brief.range.map(|range| RangeState { brief: range, connected_ns: None }),
        }
    }

    /// Returns `true` if it is received by distance, and not in range.
    fn is_out_of_range(&self) -> bool {
        self.range_state.is_some_and(|range| range.connected_ns.is_none())
    }

    /// Returns `true` if a beacon was received and the neighbor is not lost.
    fn is_received(&self) -> bool {
        self.newest_beacon.is_some() && self.reception.state != ReceptionState::Lost
    }

    /// Returns `true` if it is received at any distance and stays fresh at `stamp_ns`, as most are.
    #[inline]
    fn stays_fresh(&self, stamp_ns: u64, silence: &SilenceBrief) -> bool {
        let silent_ns_max = silence.stale_after_ns.min(silence.lost_after_ns);
        let is_recent = |beacon: &Beacon| stamp_ns.saturating_sub(beacon.stamp_ns) <= silent_ns_max;
        self.reception.state == ReceptionState::Fresh
            && self.range_state.is_none()
            && self.newest_beacon.as_ref().is_some_and(is_recent)
    }

    /// Returns one of its messages as of `now_ns`.
    fn describe_message(&self, now_ns: u64, message: &(u64, Arc<[u8]>)) -> Option<ReceivedMessage> {
        let (stamp_ns, bytes) = message;
        let (format, bytes) = (Arc::clone(self.message_format.as_ref()?), Arc::clone(bytes));
        Some(ReceivedMessage { format, bytes, age_s: age_s(now_ns, *stamp_ns) })
    }

    /// Discards all information about a spare.
    fn reset(&mut self) {
        self.newest_beacon = None;
        self.newest_message = None;
        self.queued_messages.clear();
        self.reception = TimedReceptionState::default();
        self.age_integrator = EdgeAgeIntegrator::default();
        self.failure_declaration = FailureDeclaration::default();
        self.opening_time = None;
    }
}

/// Returns the age of a stamp, s.
fn age_s(now_ns: u64, stamp_ns: u64) -> f64 {
    (now_ns as i64 - stamp_ns as i64) as f64 / 1e9
}

/// Returns the frame of time `stamp_ns` extrapolated to `target_ns`, forwards or backwards.
fn extrapolate_frame(stamp_ns: u64, frame: LeaderFrame, target_ns: u64) -> LeaderFrame {
    frame.extrapolate((target_ns as i64 - stamp_ns as i64) as f64 / 1e9)
}

/// Communication state, and the time of its last change.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct TimedReceptionState {
    /// Communication state of the in-neighbor.
    pub state: ReceptionState,
    /// Tick of the last change.
    pub tick: u64,
    /// Run time of the last change, ns.
    pub t_ns: u64,
}

impl TimedReceptionState {
    /// Sets the state. Returns whether it changed.
    fn set_state(&mut self, state: ReceptionState, tick: u64, t_ns: u64) -> bool {
        let changed = state != self.state;
        if changed {
            *self = TimedReceptionState { state, tick, t_ns };
        }
        changed
    }
}

/// Reason why a beacon was not used.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
pub enum BeaconRefusal {
    /// A number in the beacon is NaN or infinite.
    #[error("not finite")]
    NotFinite,
    /// A number in the beacon exceeds the plausible range.
    #[error("not plausible")]
    NotPlausible,
    /// The stamp is later than the current time.
    #[error("from the future")]
    FromFuture,
    /// The beacon is not newer, by incarnation and then stamp, than the newest received.
    #[error("older than the newest heard")]
    NotNewer,
    /// The message is not of the format that the sender's law declares.
    #[error("a message of another format than its law declares")]
    WrongMessageFormat,
}

impl Neighborhood {
    /// Creates the neighborhood without received beacons. `incarnation` is the number of earlier starts of the
    /// robot's process.
    pub fn new(brief: &AgentBrief, incarnation: u64) -> Neighborhood {
        let neighbors = brief.neighbors.iter().map(|sender| Neighbor::new(sender, false));
        let spares = brief.spares.iter().map(|sender| Neighbor::new(sender, true));
        let receiver = repair::receiver_from_brief(brief);
        Neighborhood {
            neighbors: neighbors.chain(spares).collect(),
            first_spare_index: brief.neighbors.len(),
            repair_after_ns: brief.repair_after_ns,
            references: receiver.references_without_failures(),
            has_repair_plan: receiver.has_repair_plan(),
            receiver,
            silence: brief.silence.clone(),
            liars_max: brief.liars_max(),
            messages_queued_max: brief.message_queue,
            messages_dropped: 0,
            received_frames: ReceivedFrames::new(brief),
            leader_frame_reception: TimedReceptionState::default(),
            first_sample_ns: None,
            is_restarted_leader: brief.lead.is_some()
                && !brief.spares.is_empty()
                && incarnation > 0,
        }
    }

    /// Returns the index of each spare, and the tick at which it was opened, or `None` while it is closed.
    pub fn spares(&self) -> impl Iterator<Item = (usize, Option<u64>)> {
        let spares = self.neighbors.iter().enumerate().skip(self.first_spare_index);
        spares.map(|(sender_index, spare)| {
            (sender_index, spare.opening_time.map(|opened| opened.tick))
        })
    }

    /// Returns whether a beacon of this tick from the sender `sender_index` counts. Beacons of a spare up
    /// to the tick at which it was opened may or may not be in the queue, so they never count.
    #[inline]
    pub fn needs_beacon_of_tick(&self, sender_index: usize, tick: u64) -> bool {
        sender_index < self.first_spare_index
            || self.neighbors[sender_index].opening_time.is_some_and(|opened| tick > opened.tick)
    }

    /// Returns the index, in the order of the brief, of the robot with the scenario index `robot` (from 1), or
    /// `None`.
    pub fn sender_index(&self, robot: u64) -> Option<usize> {
        self.neighbors.iter().position(|neighbor| neighbor.index == robot)
    }

    /// Returns whether the neighbor is in range, or received at any distance.
    pub fn is_in_range(&self, sender_index: usize) -> bool {
        !self.neighbors[sender_index].is_out_of_range()
    }

    /// Updates the communication by distance at a beacon sent from this distance, m, which is `None` if it is not
    /// known. Returns whether the beacon is in range. All that is known about a neighbor that leaves the range is
    /// discarded.
    pub fn update_range(
        &mut self,
        sender_index: usize,
        distance_m: Option<f64>,
        now_ns: u64,
    ) -> bool {
        let neighbor = &mut self.neighbors[sender_index];
        let Some(state) = &mut neighbor.range_state else { return true };
        let was_connected = state.connected_ns.is_some();
        // Without a known own position, nothing changes.
        let is_connected =
            distance_m.map_or(was_connected, |r_m| state.brief.contains(r_m, was_connected));
        match (was_connected, is_connected) {
            (false, true) => state.connected_ns = Some(now_ns),
            (true, false) => {
                state.connected_ns = None;
                neighbor.newest_beacon = None;
                neighbor.newest_message = None;
                neighbor.age_integrator = EdgeAgeIntegrator::default();
            }
            _ => {}
        }
        is_connected
    }

    /// Processes a beacon of the neighbor `sender_index` in the order of the brief. Returns why it was
    /// refused, if it was.
    #[inline]
    pub fn receive_beacon(
        &mut self,
        sender_index: usize,
        beacon: &Beacon,
        now_ns: u64,
    ) -> Result<(), BeaconRefusal> {
        let neighbor = &mut self.neighbors[sender_index];
        if !beacon.is_plausible() {
            return Err(match beacon.is_finite() {
                true => BeaconRefusal::NotPlausible,
                false => BeaconRefusal::NotFinite,
            });
        }
        let frame = beacon.leader_frame();
        if beacon.stamp_ns > now_ns || frame.is_some_and(|(stamp_ns, _)| stamp_ns > now_ns) {
            return Err(BeaconRefusal::FromFuture);
        }
        let order = |b: &Beacon| (b.incarnation, b.stamp_ns);
        if neighbor.newest_beacon.as_ref().is_some_and(|newest| order(beacon) <= order(newest)) {
            return Err(BeaconRefusal::NotNewer);
        }
        if neighbor
            .newest_beacon
            .as_ref()
            .is_some_and(|newest| newest.incarnation != beacon.incarnation)
        {
            neighbor.newest_message = None;
            neighbor.queued_messages.clear();
        }
        neighbor.newest_beacon = Some(*beacon);
        neighbor.age_integrator.record_sample(beacon.stamp_ns, now_ns);
        if let Some((stamp_ns, frame)) = frame
            && self.liars_max == 0
        {
            self.received_frames.store_frame(beacon.frame_rank, stamp_ns, frame, now_ns);
        }
        Ok(())
    }

    /// Receives a beacon with the message that travels with it, like [`Neighborhood::receive_beacon`]. A beacon without
    /// a message leaves the last message in place. Returns why both were refused, if they were.
    #[inline]
    pub fn receive_broadcast(
        &mut self,
        sender_index: usize,
        broadcast: &Broadcast,
        now_ns: u64,
    ) -> Result<(), BeaconRefusal> {
        if let Some(message) = &broadcast.message {
            let format = self.neighbors[sender_index]
                .message_format
                .as_ref()
                .ok_or(BeaconRefusal::WrongMessageFormat)?;
            format.check_bytes(message).map_err(|_| BeaconRefusal::WrongMessageFormat)?;
        }
        self.receive_beacon(sender_index, &broadcast.beacon, now_ns)?;
        if let Some(message) = &broadcast.message {
            let stamp_ns = broadcast.beacon.stamp_ns;
            let neighbor = &mut self.neighbors[sender_index];
            neighbor.newest_message = Some((stamp_ns, Arc::clone(message)));
            if self.messages_queued_max > 0 {
                if neighbor.queued_messages.len() == self.messages_queued_max {
                    neighbor.queued_messages.pop_front();
                    self.messages_dropped += 1;
                }
                neighbor.queued_messages.push_back((stamp_ns, Arc::clone(message)));
            }
        }
        Ok(())
    }

    /// Discards the messages that the law has seen.
    pub fn discard_queued_messages(&mut self) {
        if self.messages_queued_max > 0 {
            self.neighbors.iter_mut().for_each(|neighbor| neighbor.queued_messages.clear());
        }
    }

    /// Returns the number of messages that the law has not seen, because more of a neighbor arrived between two of its
    /// calls than it asks for.
    pub fn messages_dropped(&self) -> u64 {
        self.messages_dropped
    }

    /// Updates the communication states at an odometry sample, and the choice of references. Returns whether
    /// anything changed.
    pub fn update_reception_states(&mut self, tick: u64, t_ns: u64, stamp_ns: u64) -> bool {
        let first_ns = *self.first_sample_ns.get_or_insert(stamp_ns);
        if self.liars_max > 0 {
            self.update_resilient_frame(stamp_ns);
        }
        let silence = &self.silence;
        let state_out_of_range = |state: ReceptionState| match state {
            ReceptionState::NothingReceived => ReceptionState::NothingReceived,
            _ => ReceptionState::Apart,
        };
        let silence_state = |newest_ns: Option<u64>, start_ns: u64| {
            let silent_ns = stamp_ns.saturating_sub(newest_ns.unwrap_or(start_ns));
            match newest_ns {
                _ if silent_ns > silence.lost_after_ns => ReceptionState::Lost,
                None => ReceptionState::NothingReceived,
                Some(_) if silent_ns > silence.stale_after_ns => ReceptionState::Stale,
                Some(_) => ReceptionState::Fresh,
            }
        };
        let frame_received_ns =
            self.received_frames.frame_in_force(stamp_ns).map(|frame| frame.received_ns);
        // A leaderless formation never receives a frame, and none is missing.
        let mut changed = frame_received_ns.is_some()
            && self.leader_frame_reception.set_state(
                silence_state(frame_received_ns, first_ns),
                tick,
                t_ns,
            );
        self.is_restarted_leader &=
            silence_state(frame_received_ns, first_ns) != ReceptionState::Lost;
        let (neighbors, spares) = self.neighbors.split_at_mut(self.first_spare_index);
        let open_spares = spares.iter_mut().filter_map(|spare| {
            let start_ns = spare.opening_time?.stamp_ns;
            Some((spare, start_ns))
        });
        for (sender, start_ns) in neighbors.iter_mut().map(|it| (it, first_ns)).chain(open_spares) {
            if sender.stays_fresh(stamp_ns, silence) {
                continue;
            }
            let beacon_stamp_ns = sender.newest_beacon.as_ref().map(|beacon| beacon.stamp_ns);
            let start_ns =
                sender.range_state.and_then(|range| range.connected_ns).unwrap_or(start_ns);
            let state = match sender.is_out_of_range() {
                true => state_out_of_range(sender.reception.state),
                false => silence_state(beacon_stamp_ns, start_ns),
            };
            changed |= sender.reception.set_state(state, tick, t_ns);
        }
        let now = SpareOpeningTime { tick, stamp_ns };
        if self.is_restarted_leader {
            spares.iter_mut().for_each(|spare| _ = spare.opening_time.get_or_insert(now));
        } else if self.has_repair_plan {
            let (receiver, references) = (&self.receiver, &mut self.references);
            let (neighbors, after_ns) = (&mut self.neighbors, self.repair_after_ns);
            changed |= repair::update_spares_and_references(
                neighbors, receiver, references, after_ns, now, t_ns,
            );
        }
        changed
    }

    /// Returns the leader frame to be used at `stamp_ns` and to be relayed: that of the best rank that is not
    /// lost, or otherwise the last one received.
    pub fn frame_in_force(&self, stamp_ns: u64) -> Option<&ReceivedFrame> {
        self.received_frames.frame_in_force(stamp_ns)
    }

    /// Returns `true` while a restarted leader has not taken back the lead: a deputy leads and the robot is not
    /// on its path yet.
    pub fn is_resuming_lead(&self) -> bool {
        self.is_restarted_leader
    }

    /// Records that a restarted leader has reached its path. The robot takes back the lead if the frame of a deputy,
    /// which it continues, has been received.
    pub fn record_leader_on_path(&mut self) {
        self.is_restarted_leader &=
            self.leader_frame_reception.state == ReceptionState::NothingReceived;
    }

    /// Returns the leader's frame at `stamp_ns`, extrapolated by its age. If no newer frame has been received
    /// for the timeout of a neighbor, it is frozen, so that no robot keeps rotating around a dead leader. The
    /// time since reception counts, not the age: a frame relayed over many hops is old but valid.
    pub fn frame_at(&self, stamp_ns: u64) -> Option<LeaderFrame> {
        let &ReceivedFrame { stamp_ns: told_ns, frame, received_ns, .. } =
            self.frame_in_force(stamp_ns)?;
        let lost_after_ns = self.silence.lost_after_ns;
        let lost = stamp_ns.saturating_sub(received_ns) > lost_after_ns;
        // All robots that received the same last frame of the leader use the same frozen frame, regardless of
        // when they received it. With slightly different frames, mutual neighbors would drift away together.
        let age_ns = if lost { lost_after_ns } else { stamp_ns.saturating_sub(told_ns) };
        let later = frame.extrapolate(age_ns as f64 / 1e9);
        Some(if lost { later.with_zero_rates() } else { later })
    }

    /// Determines the leader's frame if some in-neighbors may be Byzantine: the frame received from the leader
    /// itself, or otherwise the W-MSR result of the relayed frames, at a stamp that `liars_max` of them exceed.
    fn update_resilient_frame(&mut self, now_ns: u64) {
        let received = self
            .neighbors
            .iter()
            .filter(|neighbor| neighbor.reception.state != ReceptionState::Lost);
        let received = received.filter_map(|neighbor| {
            Some((neighbor.is_trusted, neighbor.newest_beacon.as_ref()?.leader_frame()?))
        });
        let (trusted, others): (Vec<_>, Vec<_>) = received.partition(|(trusted, _)| *trusted);
        let mut stamps: Vec<u64> = others.iter().map(|(_, (stamp_ns, _))| *stamp_ns).collect();
        stamps.sort_unstable_by(|a, b| b.cmp(a));
        let current = self.received_frames.main_leader_frame().copied();
        let is_newer = |stamp_ns: &u64| current.is_none_or(|current| *stamp_ns > current.stamp_ns);
        let current_at = |stamp_ns| {
            current.map(|current| extrapolate_frame(current.stamp_ns, current.frame, stamp_ns))
        };
        let newest = trusted
            .iter()
            .map(|(_, timed_frame)| *timed_frame)
            .max_by_key(|(stamp_ns, _)| *stamp_ns);
        let agreed = match (newest, stamps.get(self.liars_max)) {
            (Some((stamp_ns, frame)), _) => is_newer(&stamp_ns).then_some((stamp_ns, frame)),
            (None, Some(&stamp_ns)) => {
                let frames = others
                    .iter()
                    .map(|&(_, (frame_ns, frame))| extrapolate_frame(frame_ns, frame, stamp_ns));
                let frames: Vec<LeaderFrame> = frames.collect();
                let agreed = is_newer(&stamp_ns)
                    .then(|| resilient_frame(current_at(stamp_ns), &frames, self.liars_max));
                agreed.flatten().map(|frame| (stamp_ns, frame))
            }
            (None, None) => None,
        };
        if let Some((stamp_ns, frame)) = agreed {
            self.received_frames.store_frame(0, stamp_ns, frame, now_ns);
        }
    }

    /// Returns the communication state of the leader's frame, and the time of its last change.
    pub fn leader_frame_reception(&self) -> TimedReceptionState {
        self.leader_frame_reception
    }

    /// Fills `estimates` with the estimates at `stamp_ns` of all neighbors ever received, with offsets C_ji =
    /// `offset`(c_ji). Positions are extrapolated with the published velocity. Lost neighbors stay at the
    /// position at which they were declared lost.
    pub fn estimate_neighbors(
        &self,
        stamp_ns: u64,
        offset: impl Fn(Vec2) -> Target,
        estimates: &mut Vec<NeighborEstimate>,
    ) {
        let mut count = 0;
        for neighbor in &self.neighbors {
            let Some(beacon) = neighbor.newest_beacon.as_ref() else { continue };
            let age_s = age_s(stamp_ns, beacon.stamp_ns);
            let published = Target { position: beacon.position(), velocity: beacon.velocity() };
            let reception_state = neighbor.reception.state;
            let alpha_j = match reception_state {
                ReceptionState::Lost => Target::at_rest(
                    published.extrapolate(self.silence.lost_after_ns as f64 / 1e9).position,
                ),
                _ => published.extrapolate(age_s),
            };
            if count == estimates.len() {
                estimates.push(NeighborEstimate::default());
            }
            // Overwritten in place, field by field, which is faster than a new list at each sample.
            let NeighborEstimate {
                index,
                position,
                velocity,
                offset: offset_at_stamp,
                age_s: age_at_stamp_s,
                reception_state: state,
                incarnation,
                message,
                queued_messages,
            } = &mut estimates[count];
            count += 1;
            *index = neighbor.index as usize;
            (*position, *velocity) = (alpha_j.position, alpha_j.velocity);
            *offset_at_stamp = offset(neighbor.offset);
            *age_at_stamp_s = age_s;
            *state = reception_state;
            *incarnation = beacon.incarnation;
            let has_no_message = message.is_none() && queued_messages.is_empty();
            if neighbor.message_format.is_some() || !has_no_message {
                let received = |message| neighbor.describe_message(stamp_ns, message);
                *message = neighbor.newest_message.as_ref().and_then(received);
                queued_messages.clear();
                queued_messages.extend(neighbor.queued_messages.iter().filter_map(received));
            }
        }
        estimates.truncate(count);
    }

    /// Returns whether any failure changes the references: with backup neighbors, planned replacements or failover.
    pub fn has_repair_plan(&self) -> bool {
        self.has_repair_plan
    }

    /// Returns `true` if a planned in-neighbor is declared failed, so that it may be replaced.
    pub fn has_failed_in_neighbor(&self) -> bool {
        self.neighbors[..self.first_spare_index]
            .iter()
            .any(|neighbor| neighbor.failure_declaration.is_declared_failed)
    }

    /// Returns `true` if the robot succeeds a failed leader, and keeps that leader's slot with the neighbors
    /// named for this purpose.
    pub fn keeps_leader_slot(&self) -> bool {
        self.references.keeps_leader_slot
    }

    /// Returns the desired position and velocity (alpha*, alpha*') from the `estimates`: the mean over
    /// the in-neighbors, without replaced ones. Returns `None` if the robot has to stop: no reference is left,
    /// or one is lost under the policy `stop`. (13) (24) (45) (46)
    ///
    /// Once the leader's frame is lost, velocities count as 0. They would only feed back among the robots, and
    /// without a path from the leader this feedback never decays.
    pub fn desired_target(&self, estimates: &[NeighborEstimate]) -> Option<Target> {
        let references = self.counted_references(estimates)?;
        let mean = mean_target(references.map(|(alpha_j, c_ji, _)| (alpha_j, c_ji)))?;
        Some(self.without_velocity_of_lost_frame(mean))
    }

    /// Returns the desired position and velocity by W-MSR in place of the mean. `own` is the position of the
    /// robot, m, and its last desired velocity, m/s.
    pub fn resilient_desired_target(
        &self,
        estimates: &[NeighborEstimate],
        own: Target,
    ) -> Option<Target> {
        let to_value = |(alpha_j, c_ji, is_trusted): (Target, Target, bool)| ReceivedValue {
            value: Target {
                position: alpha_j.position + c_ji.position,
                velocity: alpha_j.velocity + c_ji.velocity,
            },
            is_trusted,
        };
        let values: Vec<ReceivedValue<Target>> =
            self.counted_references(estimates)?.map(to_value).collect();
        let target =
            (!values.is_empty()).then(|| resilient_target(own, &values, self.liars_max))?;
        Some(self.without_velocity_of_lost_frame(target))
    }

    /// Returns alpha_j, C_ji and whether R_j is a trusted node, for each reference that counts, or `None` if the robot
    /// has to stop because one is lost.
    fn counted_references(
        &self,
        estimates: &[NeighborEstimate],
    ) -> Option<impl Iterator<Item = (Target, Target, bool)>> {
        let is_lost = |neighbor: &Neighbor| neighbor.reception.state == ReceptionState::Lost;
        let mut used_references =
            self.neighbors.iter().filter(|neighbor| neighbor.reference_use.is_used);
        if self.silence.policy == SilencePolicy::Stop && used_references.any(is_lost) {
            return None;
        }
        // In the order of the estimates.
        let indexed = self.neighbors.iter().enumerate();
        let received = indexed.filter(|(_, neighbor)| neighbor.newest_beacon.is_some());
        let used_references =
            estimates.iter().zip(received).filter(|(_, (_, sender))| sender.reference_use.is_used);
        let all_lost = || {
            let mut estimates = used_references.clone().map(|(estimate, _)| estimate);
            estimates.all(|estimate| estimate.reception_state == ReceptionState::Lost)
        };
        let keeps_lost = match self.silence.policy {
            SilencePolicy::Keep => true,
            SilencePolicy::Last => all_lost(),
            SilencePolicy::Ignore | SilencePolicy::Stop => false,
        };
        let counted = used_references.filter(move |(estimate, _)| {
            keeps_lost || estimate.reception_state != ReceptionState::Lost
        });
        Some(counted.flat_map(
            |(&NeighborEstimate { position, velocity, offset, .. }, (k, sender))| {
                let weight = self.references.weights[k];
                repeat_n((Target { position, velocity }, offset, sender.is_trusted), weight)
            },
        ))
    }

    /// Returns `target`, at rest once the leader's frame is lost: see [`Neighborhood::desired_target`].
    fn without_velocity_of_lost_frame(&self, target: Target) -> Target {
        match self.leader_frame_reception.state {
            ReceptionState::Lost => Target::at_rest(target.position),
            _ => target,
        }
    }

    /// Returns the age at `now_ns` of the newest beacon of each in-neighbor, ns, with the sender's index in the
    /// scenario, from 1. Neighbors never received or lost are omitted.
    pub fn beacon_ages_ns(&self, now_ns: u64) -> impl Iterator<Item = (usize, u64)> {
        self.neighbors.iter().filter_map(move |neighbor| {
            let beacon = neighbor.newest_beacon.as_ref()?;
            let is_usable = neighbor.reception.state != ReceptionState::Lost;
            is_usable.then(|| (neighbor.index as usize, now_ns.saturating_sub(beacon.stamp_ns)))
        })
    }

    /// Returns the information ages of all neighbors since the last call, with the sender's index in the
    /// scenario, from 1. Silent neighbors are included.
    pub fn take_information_ages(&mut self, now_ns: u64) -> impl Iterator<Item = (usize, AgeSums)> {
        let (neighbors, spares) = self.neighbors.split_at_mut(self.first_spare_index);
        let open = spares.iter_mut().filter(|spare| spare.opening_time.is_some());
        neighbors
            .iter_mut()
            .chain(open)
            .map(move |sender| (sender.index as usize, sender.age_integrator.take_sums(now_ns)))
    }

    /// Returns the communication states for the supervisor.
    pub fn status(&self) -> impl ExactSizeIterator<Item = NeighborStatus> {
        self.neighbors.iter().map(|neighbor| NeighborStatus {
            robot: neighbor.index,
            contact: neighbor.reception.state as u64,
            since_tick: neighbor.reception.tick,
            since_t_ns: neighbor.reception.t_ns,
            goes_by: u64::from(neighbor.reference_use.is_used),
            goes_by_since_t_ns: neighbor.reference_use.last_change_t_ns,
        })
    }
}

#[cfg(test)]
mod tests;
