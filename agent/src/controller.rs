//! The controller of one robot: odometry and received beacons in, beacon and command out.
//!
//! It does no I/O and reads no clock. The same controller runs in a process of its own and, composed with the
//! simulated plant, in tests that predict every bit of the process's output.
//!
//! An answer has three steps: [`Controller::sense`] processes a sample, the control law computes its output for the
//! current situation, and [`Controller::act`] turns the output into an answer. The training environment calls these
//! steps separately.

mod goal_requests;

use formation::Vec2;
use formation::desired::Target;
use formation::front_point::{Heading, front_point_and_velocity, front_velocity};
use formation::pose::{Pose, Twist, wrap_angle};
use protocol::age::AgeSums;
use protocol::brief::{AgentBrief, Pace, PublishedVelocity, REPAIR_SPEED_FACTOR, YieldPriority};
use protocol::fault::{LinkFaultKind, Transmission};
use protocol::law_message::{Broadcast, SendDecision};
use protocol::link::FaultyLink;
use protocol::message::{
    Beacon, Command, Goal, NeighborStatus, Odometry, PROXIMITY_MAX, StatusHeader,
};
use protocol::signals::SignalValues;

use crate::UnfitBrief;
use crate::avoidance::{self, Avoidance, Sample};
use crate::laws::{self, Law, LawOutput, NeighborEstimate, Situation};
use crate::neighborhood::{BeaconRefusal, Neighborhood};
use crate::roles::{self, Role, RoleInput};
use goal_requests::GoalRequests;

/// Returns the age of a beacon when it is used, in periods (a of the boundary layer): exactly 1 in lockstep,
/// and up to 2 in real time (one period of the sender, one for delivery and phase). Delays of odometry and
/// commands are added.
fn beacon_age_periods(brief: &AgentBrief) -> f64 {
    let delay_periods = brief.late_ns as f64 / brief.period_ns as f64;
    match brief.pace {
        Pace::Lockstep => 1.0 + delay_periods,
        Pace::Realtime => 2.0 + delay_periods,
    }
}

/// Components of a controller: rows of this crate's tables, or the components of a user program.
pub struct Parts {
    /// Role, which determines the desired position.
    pub role: Box<dyn Role>,
    /// Control law, which determines the nominal velocity.
    pub law: Box<dyn Law>,
    /// Avoidance method, which keeps the minimum distance.
    pub avoidance: Box<dyn Avoidance>,
}

impl Parts {
    /// Creates the components named in the brief. Returns an error if a name is unknown or the brief does not
    /// suit a component.
    pub fn from_brief(brief: &AgentBrief) -> Result<Parts, UnfitBrief> {
        Parts::from_brief_with_laws(brief, &[])
    }

    /// Creates the components named in the brief, of which the law may be one of `added`. Returns an error if a name is
    /// unknown or the brief does not suit a component.
    pub fn from_brief_with_laws(
        brief: &AgentBrief,
        added: &[laws::LawRow],
    ) -> Result<Parts, UnfitBrief> {
        let row = laws::find_row_with(&brief.law, added)?;
        let law = row.make(&brief.gains)?;
        Ok(Parts { role: row.role.make(brief)?, law, avoidance: avoidance::build(brief)? })
    }

    /// Creates the components with the given control law. The role is that of the brief's program, or of the
    /// control law that the brief names.
    pub fn with_law(brief: &AgentBrief, law: Box<dyn Law>) -> Result<Parts, UnfitBrief> {
        let role = match &brief.program {
            Some(program) => roles::find_row(&program.role)?,
            None => laws::find_row(&brief.law)?.role,
        };
        Ok(Parts { role: role.make(brief)?, law, avoidance: avoidance::build(brief)? })
    }
}

/// Controller of one robot.
pub struct Controller {
    role: Box<dyn Role>,
    incarnation: u64,
    brief: Box<AgentBrief>,
    law: Box<dyn Law>,
    avoidance: Box<dyn Avoidance>,
    neighborhood: Neighborhood,
    cycle_state: CycleState,
    /// Incoming link from each sender, in the order of the brief.
    links: Vec<FaultyLink<Broadcast>>,
    /// For each sender, whether its beacons are received at any distance, and none is falsified.
    receives_all: Vec<bool>,
    /// Whether every beacon of every sender is received at once and unchanged.
    has_only_transparent_links: bool,
    /// Faulty link from the own sensors, if the brief has odometry faults.
    odometry_link: Option<FaultyLink<Odometry>>,
    /// Stamp of the newest sample answered, ns.
    answered_stamp_ns: Option<u64>,
    /// Stamp of t = 0, ns, known with the first sample.
    start_ns: u64,
    has_status_change: bool,
    goal_requests: GoalRequests,
    /// Own front point at the last valid sample, m.
    front_point: Option<Vec2>,
    /// Stamp, ns, and front point of the previous sample. Set only if velocities are computed by differences.
    previous_front_point: Option<(u64, Vec2)>,
    sequence_number: u64,
    beacons_refused: u64,
    newest_sample_tick_and_time: Option<(u64, u64)>,
    /// The law's choice of what to send with the next answer.
    send_decision: SendDecision,
    /// Target that the law of a free robot has named for the current sample.
    own_target: Option<Target>,
    /// Stamp of that sample, ns.
    own_target_ns: u64,
    /// Signals that the law recorded at the current sample.
    signals: SignalValues,
}

/// Values derived from the current sample.
struct CycleState {
    period_s: f64,
    age_periods: f64,
    /// Own state at the sample to be answered, or `None` if there is nothing to answer.
    own: Option<OwnState>,
    /// Front point (alpha), m.
    front_point: Vec2,
    /// Velocity of the front point (alpha'), m/s.
    front_velocity: Vec2,
    /// Error alpha - alpha*, m, or `None` without a desired position.
    error: Option<Vec2>,
    /// Error as the control law shall see it, m, and desired velocity (alpha*'), m/s.
    law_error_and_desired_velocity: Option<(Vec2, Vec2)>,
    /// Own front point - front point of each neighbor in range, m.
    neighbor_vectors: Vec<Vec2>,
    /// Classes of these neighbors.
    neighbor_classes: Vec<u8>,
    /// Velocities of their front points, m/s; empty if they are not sensed.
    neighbor_velocities: Vec<Vec2>,
    /// Own front point - nearest point of each wall in range, m.
    wall_vectors: Vec<Vec2>,
    /// Estimates of the received robots.
    neighbor_estimates: Vec<NeighborEstimate>,
}

/// State of the robot and of its proximity sensor at one odometry sample.
#[derive(Clone, Copy)]
struct OwnState {
    stamp_ns: u64,
    t_ns: u64,
    pose: Pose,
    heading: Heading,
    twist: Twist,
    proximity_valid: bool,
    neighbors_truncated: bool,
    walls_truncated: bool,
}

/// Output for a robot without a desired position: velocity 0.
const STOP_OUTPUT: LawOutput = LawOutput::Velocity(Vec2::new(0.0, 0.0));

/// Answer of a controller to one odometry sample.
#[derive(Debug, Clone, Default)]
pub struct Answer {
    /// Beacon to the out-neighbors, and the message of the law.
    pub broadcast: Broadcast,
    /// `true` if the law withholds both.
    pub is_withheld: bool,
    /// Command to the plant.
    pub command: Command,
    /// Additional delay before the answer is sent, ns, because of a fault in the brief.
    pub delay_ns: u64,
}

impl Answer {
    /// Returns the beacon.
    pub fn beacon(&self) -> &Beacon {
        &self.broadcast.beacon
    }

    /// Returns the message to be sent; empty if the law sends none.
    pub fn message(&self) -> &[u8] {
        self.broadcast.message.as_deref().unwrap_or_default()
    }

    /// Returns the beacon and the message to be sent; `None` if the law withholds them.
    #[inline]
    pub fn outgoing_broadcast(&self) -> Option<&Broadcast> {
        (!self.is_withheld).then_some(&self.broadcast)
    }
}

impl Controller {
    /// Creates a controller with the components named in the brief. Returns an error if they do not exist or do
    /// not suit the brief.
    pub fn new(brief: &AgentBrief, incarnation: u64) -> Result<Controller, UnfitBrief> {
        Ok(Controller::with_parts(brief, incarnation, Parts::from_brief(brief)?))
    }

    /// Creates a controller with the given components, which need not be in any table.
    pub fn with_parts(brief: &AgentBrief, incarnation: u64, parts: Parts) -> Controller {
        let Parts { role, law, avoidance } = parts;
        let mut controller = Controller {
            role,
            incarnation,
            brief: Box::new(brief.clone()),
            law,
            avoidance,
            neighborhood: Neighborhood::new(brief, incarnation),
            cycle_state: CycleState {
                period_s: brief.period_ns as f64 / 1e9,
                age_periods: beacon_age_periods(brief),
                own: None,
                front_point: Vec2::zeros(),
                front_velocity: Vec2::zeros(),
                error: None,
                law_error_and_desired_velocity: None,
                neighbor_vectors: Vec::with_capacity(PROXIMITY_MAX),
                neighbor_classes: Vec::with_capacity(PROXIMITY_MAX),
                neighbor_velocities: Vec::new(),
                wall_vectors: Vec::new(),
                neighbor_estimates: Vec::with_capacity(brief.senders().count()),
            },
            links: brief.senders().map(|sender| FaultyLink::new(&sender.faults)).collect(),
            receives_all: (brief.senders())
                .map(|sender| sender.lies.is_empty() && sender.range.is_none())
                .collect(),
            has_only_transparent_links: false,
            odometry_link: (!brief.odometry_faults.is_empty())
                .then(|| FaultyLink::new(&brief.odometry_faults)),
            answered_stamp_ns: None,
            start_ns: 0,
            has_status_change: false,
            goal_requests: GoalRequests::default(),
            front_point: None,
            previous_front_point: None,
            sequence_number: 0,
            beacons_refused: 0,
            newest_sample_tick_and_time: None,
            send_decision: SendDecision::Beacon,
            own_target: None,
            own_target_ns: 0,
            signals: SignalValues::NONE,
        };
        controller.update_transparency();
        controller
    }

    /// Returns the robot's brief.
    pub fn brief(&self) -> &AgentBrief {
        &self.brief
    }

    /// Receives a beacon without a message, see [`Controller::receive_broadcast`].
    pub fn receive_beacon(
        &mut self,
        sender_index: usize,
        beacon: &Beacon,
        now_ns: u64,
    ) -> Result<(), BeaconRefusal> {
        self.receive_broadcast(sender_index, &(*beacon).into(), now_ns)
    }

    /// Receives a beacon, and the message with it, from the neighbor `sender_index` in the order of the brief,
    /// after the first sample. A refused beacon is counted and changes nothing. A beacon that the link faults drop
    /// or delay has no effect for now.
    #[inline]
    pub fn receive_broadcast(
        &mut self,
        sender_index: usize,
        broadcast: &Broadcast,
        now_ns: u64,
    ) -> Result<(), BeaconRefusal> {
        if self.has_only_transparent_links || self.is_transparent(sender_index) {
            return self.receive_without_delay(sender_index, broadcast, now_ns);
        }
        let beacon = &broadcast.beacon;
        let transmission = Transmission {
            tick: beacon.tick,
            t_ns: beacon.stamp_ns.saturating_sub(self.start_ns),
            distance_m: self.front_point.map(|alpha| (alpha - beacon.position()).norm()),
        };
        if !self.neighborhood.update_range(sender_index, transmission.distance_m, now_ns) {
            return Ok(());
        }
        let sender = self.brief.sender(sender_index);
        let mut broadcast = broadcast.clone();
        let (lies, format) = (&sender.lies, sender.message.as_ref());
        lies.iter()
            .for_each(|fault| fault.falsify_broadcast(&mut broadcast, format, transmission.t_ns));
        match self.links[sender_index].send(&broadcast, transmission) {
            Some(broadcast) => self.receive_without_delay(sender_index, &broadcast, now_ns),
            None => Ok(()),
        }
    }

    /// Takes the link from a robot down, or restores it. `robot` is the index in the scenario, from 1. Does
    /// nothing for a robot that is not an in-neighbor.
    pub fn set_link_cut(&mut self, robot: u64, is_down: bool) {
        if let Some(sender_index) = self.neighborhood.sender_index(robot) {
            self.links[sender_index].set_cut(is_down);
            self.update_transparency();
        }
    }

    /// Returns whether every beacon of this sender is received at once and unchanged.
    fn is_transparent(&self, sender_index: usize) -> bool {
        self.receives_all[sender_index] && self.links[sender_index].is_transparent()
    }

    /// Determines whether all links are transparent, after a change. Beacons are in transit only in a link with faults,
    /// which is never transparent.
    fn update_transparency(&mut self) {
        self.has_only_transparent_links = (0..self.links.len()).all(|i| self.is_transparent(i));
    }

    /// Sets a goal requested by an external client, effective from the next sample. A goal that is not newer
    /// than the current one is ignored, and only the goal role uses it.
    pub fn request_goal(&mut self, goal: &Goal) {
        self.goal_requests.store_goal(goal);
    }

    #[inline]
    fn receive_without_delay(
        &mut self,
        sender_index: usize,
        broadcast: &Broadcast,
        now_ns: u64,
    ) -> Result<(), BeaconRefusal> {
        let result = self.neighborhood.receive_broadcast(sender_index, broadcast, now_ns);
        self.beacons_refused += u64::from(result.is_err());
        self.has_status_change |= result.is_err();
        result
    }

    /// Returns the in-neighbors and their communication states.
    pub fn neighborhood(&self) -> &Neighborhood {
        &self.neighborhood
    }

    /// Returns the incarnation number of the robot, from 0.
    pub fn incarnation(&self) -> u64 {
        self.incarnation
    }

    /// Returns `true` once a sample has been processed.
    pub fn has_started(&self) -> bool {
        self.newest_sample_tick_and_time.is_some()
    }

    /// Returns whether the communication state of a neighbor changed or a beacon was refused since the last call, and
    /// resets the flag.
    pub fn take_status_change(&mut self) -> bool {
        std::mem::take(&mut self.has_status_change)
    }

    /// Answers an odometry sample. Returns `None` if the pose is invalid. If faults drop or delay odometry, the
    /// newest sample that has arrived is answered, unless it was answered before.
    ///
    /// `effect_ns` is the expected stamp at which the answer takes effect, without the delays of faults. In
    /// lockstep it is the stamp of the sample. The caller sets `sent_ns`.
    pub fn answer(&mut self, odometry: &Odometry, effect_ns: u64) -> Option<Answer> {
        self.sense(odometry);
        let output = self.law_output();
        let mut answer = None;
        self.act(output, effect_ns, &mut answer);
        answer
    }

    /// Processes an odometry sample, and updates the estimates of the neighbors to its time.
    pub fn sense(&mut self, odometry: &Odometry) {
        self.newest_sample_tick_and_time = Some((odometry.tick, odometry.t_ns));
        self.start_ns = odometry.stamp_ns.saturating_sub(odometry.t_ns);
        let links = if self.has_only_transparent_links { 0 } else { self.links.len() };
        for sender_index in 0..links {
            while let Some(broadcast) = self.links[sender_index].next_due_message(odometry.t_ns) {
                if !self.neighborhood.is_in_range(sender_index) {
                    continue;
                }
                // A refusal is counted. Jitter may reorder beacons.
                let _ = self.receive_without_delay(sender_index, &broadcast, odometry.stamp_ns);
            }
        }
        self.has_status_change |=
            self.goal_requests.apply_pending_goal(&mut *self.role, odometry.t_ns);
        self.has_status_change |= self.neighborhood.update_reception_states(
            odometry.tick,
            odometry.t_ns,
            odometry.stamp_ns,
        );
        (self.cycle_state.error, self.cycle_state.law_error_and_desired_velocity) = (None, None);
        self.cycle_state.own = None;
        let delivered;
        let odometry = match self.odometry_link {
            None => Some(odometry),
            Some(_) => {
                delivered = self.pass_odometry_link(odometry);
                delivered.as_ref()
            }
        };
        let Some(odometry) = odometry.filter(|sample| sample.pose_valid == 1) else { return };
        let own = self.cycle_state.set_odometry(odometry, self.brief.front_point_m);
        let alpha = self.cycle_state.front_point;
        self.front_point = Some(alpha);
        let target = self
            .role
            .target(&own.role_input(&self.neighborhood), &mut self.cycle_state.neighbor_estimates);
        // A free robot uses the target that its law returned at the previous sample.
        let law_target =
            self.own_target.filter(|_| self.role.asks_law_for_target()).map(|target| {
                target.extrapolate(own.stamp_ns.saturating_sub(self.own_target_ns) as f64 / 1e9)
            });
        if let Some(target) = law_target.or(target) {
            let error = alpha - target.position;
            self.cycle_state.error = Some(error);
            if error.norm() <= self.arrival_radius_m() {
                self.neighborhood.record_leader_on_path();
            }
            let sample = self.cycle_state.avoidance_sample(&own);
            let error = self.avoidance.standoff_error(&sample, error);
            let speeds_up = self.brief.rank == YieldPriority::Contained
                && self.neighborhood.has_failed_in_neighbor();
            let error = if speeds_up { REPAIR_SPEED_FACTOR * error } else { error };
            self.cycle_state.law_error_and_desired_velocity = Some((error, target.velocity));
        }
    }

    /// Returns the distance within which the robot is on its path, m: one front-point distance, or d/2 if it is
    /// controlled at its axle midpoint.
    fn arrival_radius_m(&self) -> f64 {
        match self.brief.front_point_m == 0.0 {
            true => 0.5 * self.brief.avoidance.distance_min_m,
            false => self.brief.front_point_m,
        }
    }

    /// Marks that there is no sample to be answered.
    pub fn clear_sample(&mut self) {
        self.cycle_state.own = None;
    }

    /// Returns the input of the control law for the current sample, or `None` without a desired position.
    pub fn situation(&self) -> Option<Situation<'_>> {
        self.cycle_state.situation()
    }

    /// Returns the output of the control law for the current sample. Must be called once per sample, because
    /// laws have state.
    pub fn law_output(&mut self) -> LawOutput {
        let has_signals = !self.brief.signals.is_empty();
        if has_signals {
            self.signals = SignalValues::NONE;
        }
        let Some(situation) = self.cycle_state.situation() else { return STOP_OUTPUT };
        let output = self.law.output(&situation);
        self.send_decision = self.law.send_decision();
        if has_signals {
            self.signals = self.law.signals();
        }
        if self.role.asks_law_for_target() {
            let target = self.law.target();
            self.set_own_target(target);
        }
        output
    }

    /// Sets the target of a free robot at the current sample, in place of the law's choice. Does nothing for other
    /// roles, and without a valid sample.
    pub fn set_own_target(&mut self, target: Option<Target>) {
        let Some(own) = self.cycle_state.own.filter(|_| self.role.asks_law_for_target()) else {
            return;
        };
        self.has_status_change |= self.own_target != target;
        self.own_target = target;
        self.own_target_ns = own.stamp_ns;
        let error = target.map(|target| self.cycle_state.front_point - target.position);
        self.cycle_state.error = error;
        let velocity = target.map_or(Vec2::zeros(), |target| target.velocity);
        self.cycle_state.law_error_and_desired_velocity =
            Some((error.unwrap_or_default(), velocity));
    }

    /// Returns whether the law recorded a signal at the current sample.
    pub fn has_signals(&self) -> bool {
        !self.signals.is_empty()
    }

    /// Sets what leaves with the next answer, in place of the law's choice.
    pub fn set_send_decision(&mut self, decision: SendDecision) {
        self.send_decision = decision;
    }

    /// Returns what leaves with the current answer, for which the law has seen all queued messages if it was called.
    ///
    /// # Panics
    ///
    /// If the law sends what it does not declare. Laws in other languages are checked before.
    fn take_send_decision(&mut self) -> SendDecision {
        if self.cycle_state.situation().is_some() {
            self.neighborhood.discard_queued_messages();
        }
        let decision = std::mem::take(&mut self.send_decision);
        let AgentBrief { name, law, message, withholds, .. } = &*self.brief;
        if let Err(error) = decision.check(message.as_ref(), *withholds) {
            panic!("the law \"{law}\" of {name} is wrong: {error}");
        }
        decision
    }

    /// Computes the answer to the current sample from the output of the control law, and writes it over `answer`. A
    /// robot without a desired position stops. See [`Controller::answer`].
    pub fn act(&mut self, output: LawOutput, effect_ns: u64, answer: &mut Option<Answer>) {
        let (message, is_sent) = self.take_send_decision().into_message();
        let sample = self.newest_sample_tick_and_time.zip(self.cycle_state.own);
        let Some(((tick, t_ns), own)) = sample else {
            *answer = None;
            return;
        };
        let effect_ns = effect_ns + self.expected_command_delay_ns(t_ns);
        let role_input = own.role_input(&self.neighborhood);
        let (pose, alpha) = (role_input.pose, self.cycle_state.front_point);
        let desired = self.cycle_state.law_error_and_desired_velocity;
        let output = desired.map_or(STOP_OUTPUT, |_| output);
        let slot_velocity = desired.map_or(Vec2::zeros(), |(_, velocity)| velocity);
        let gamma = self.avoidance.admit_velocity(match output {
            LawOutput::Velocity(gamma) => gamma,
            LawOutput::Twist(twist) => {
                front_velocity(pose.heading_rad, self.brief.front_point_m, twist)
            }
        });
        let (frame_rank, frame) = match self.role.formation_frame(&role_input, &*self.avoidance) {
            Some(frame) => {
                // Rank 0 is that of the main leader.
                let rank = self.brief.deputy.as_ref().map_or(0, |deputy| deputy.rank);
                (rank, Some((own.stamp_ns, frame)))
            }
            None => match self.neighborhood.frame_in_force(own.stamp_ns) {
                Some(received) => (received.rank, Some((received.stamp_ns, received.frame))),
                None => (0, None),
            },
        };

        let until_effect_s = effect_ns.saturating_sub(own.stamp_ns) as f64 / 1e9;
        let sample = Sample {
            heading_at_effect: own
                .heading
                .with_angle(wrap_angle(pose.heading_rad + own.twist.w_rad_s * until_effect_s)),
            error: self.cycle_state.error,
            slot_velocity,
            ..self.cycle_state.avoidance_sample(&own)
        };
        let twist = match output {
            LawOutput::Velocity(_) => self.avoidance.steer(&sample, gamma),
            LawOutput::Twist(twist) => self.avoidance.restrict_twist(&sample, twist, gamma),
        };
        let published = match self.brief.published_velocity {
            PublishedVelocity::Gamma => gamma,
            PublishedVelocity::GammaAndBeta => {
                front_velocity(pose.heading_rad, self.brief.front_point_m, twist)
            }
            PublishedVelocity::Differenced => {
                let previous = self.previous_front_point.replace((own.stamp_ns, alpha));
                velocity_by_difference(previous, own.stamp_ns, alpha)
            }
        };

        self.sequence_number += 1;
        let slow = self.brief.slow.iter().filter(|fault| fault.span.contains(own.t_ns));
        // In place, because an answer is large.
        let answer = answer.get_or_insert_default();
        answer.is_withheld = !is_sent;
        answer.delay_ns = slow.map(|fault| fault.delay_ns).sum();
        answer.broadcast.message = message;
        let beacon = &mut answer.broadcast.beacon;
        *beacon = Beacon {
            tick,
            stamp_ns: own.stamp_ns,
            sent_ns: 0,
            incarnation: self.incarnation,
            x_m: alpha.x,
            y_m: alpha.y,
            vx_m_s: published.x,
            vy_m_s: published.y,
            frame_rank,
            ..Beacon::default()
        };
        beacon.set_leader_frame(frame);
        answer.command = Command {
            tick,
            stamp_ns: own.stamp_ns,
            sent_ns: 0,
            sequence: self.sequence_number,
            incarnation: self.incarnation,
            v_m_s: twist.v_m_s,
            side_m_s: twist.side_m_s,
            w_rad_s: twist.w_rad_s,
        };
    }

    /// Passes a sample through the faulty odometry link. Returns the newest sample that has arrived, unless it
    /// was answered before.
    fn pass_odometry_link(&mut self, odometry: &Odometry) -> Option<Odometry> {
        let link = self.odometry_link.as_mut()?;
        let Odometry { tick, t_ns, .. } = *odometry;
        let mut newest = link.send(odometry, Transmission { tick, t_ns, distance_m: None });
        while let Some(sample) = link.next_due_message(t_ns) {
            if newest.is_none_or(|newest| sample.stamp_ns > newest.stamp_ns) {
                newest = Some(sample);
            }
        }
        let answered_ns = self.answered_stamp_ns;
        let newest = newest.filter(|sample| Some(sample.stamp_ns) > answered_ns)?;
        self.answered_stamp_ns = Some(newest.stamp_ns);
        Some(newest)
    }

    /// Returns the expected delay of commands sent at this run time, ns: the mean of the active delay faults,
    /// and their maximum if there are several.
    fn expected_command_delay_ns(&self, t_ns: u64) -> u64 {
        let active = self.brief.command_faults.iter().filter(|fault| fault.span.contains(t_ns));
        let delays_ns = active.map(|fault| match fault.kind {
            LinkFaultKind::Delay { delay_ns, jitter_ns } => delay_ns.saturating_add(jitter_ns / 2),
            _ => 0,
        });
        delays_ns.max().unwrap_or(0)
    }

    /// Returns the information ages since the last call. See [`Neighborhood::take_information_ages`].
    pub fn take_information_ages(&mut self, now_ns: u64) -> impl Iterator<Item = (usize, AgeSums)> {
        self.neighborhood.take_information_ages(now_ns)
    }

    /// Returns the status for the supervisor. Deadline misses, old odometry and sent beacons are not known here and
    /// are 0.
    pub fn status(&self) -> (StatusHeader, impl ExactSizeIterator<Item = NeighborStatus>) {
        let (tick, t_ns) = self.newest_sample_tick_and_time.unwrap_or_default();
        let (goal, goal_since_ns) = self.goal_requests.goal_in_force();
        let (signals_recorded, signals) = self.signals.parts();
        let header = StatusHeader {
            tick,
            t_ns,
            incarnation: self.incarnation,
            moving: u64::from(self.newest_sample_tick_and_time.is_some()),
            deadline_misses: 0,
            odometry_old: 0,
            beacons_refused: self.beacons_refused,
            beacons_sent: 0,
            messages_sent: 0,
            message_hash: 0,
            messages_dropped: 0,
            target_known: u64::from(self.own_target.is_some()),
            target_m: self.own_target.map_or([0.0; 2], |target| target.position.into()),
            target_velocity_m_s: self.own_target.map_or([0.0; 2], |target| target.velocity.into()),
            signals_recorded,
            signals,
            frame: self.neighborhood.leader_frame_reception().state as u64,
            frame_since_t_ns: self.neighborhood.leader_frame_reception().t_ns,
            goal_stamp_ns: goal.stamp_ns,
            goal_since_t_ns: goal_since_ns,
            goal_m: [goal.x_m, goal.y_m],
            neighbors: self.neighborhood.status().len() as u64,
        };
        (header, self.neighborhood.status())
    }
}

impl CycleState {
    /// Sets the sample to be answered, which has a valid pose. Only the part of it that is used is copied, because
    /// it is large.
    fn set_odometry(&mut self, odometry: &Odometry, front_point_m: f64) -> OwnState {
        let own = OwnState {
            stamp_ns: odometry.stamp_ns,
            t_ns: odometry.t_ns,
            pose: odometry.pose(),
            heading: Heading::new(odometry.heading_rad),
            twist: odometry.twist(),
            proximity_valid: odometry.proximity_valid == 1,
            neighbors_truncated: odometry.proximity_cut == 1,
            walls_truncated: odometry.walls_cut == 1,
        };
        let (alpha, velocity) =
            front_point_and_velocity(own.heading, own.pose, front_point_m, own.twist); // (2), (3)
        (self.front_point, self.front_velocity) = (alpha, velocity);
        self.neighbor_vectors.clear();
        self.neighbor_vectors.extend(odometry.proximity_front_points().map(|other| alpha - other));
        self.neighbor_classes.clear();
        self.neighbor_classes.extend_from_slice(odometry.near_classes());
        self.neighbor_velocities.clear();
        self.neighbor_velocities.extend(odometry.proximity_velocities());
        self.wall_vectors.clear();
        self.wall_vectors.extend(odometry.nearest_wall_points().map(|nearest| alpha - nearest));
        self.own = Some(own);
        own
    }

    fn situation(&self) -> Option<Situation<'_>> {
        let (own, (error, desired_velocity)) =
            (self.own.as_ref()?, self.law_error_and_desired_velocity?);
        Some(Situation {
            error,
            desired_velocity,
            period_s: self.period_s,
            age_periods: self.age_periods,
            t_s: own.t_s(),
            pose: own.pose,
            front_point: self.front_point,
            twist: own.twist,
            neighbor_vectors: &self.neighbor_vectors,
            proximity_valid: own.proximity_valid,
            neighbors_truncated: own.neighbors_truncated,
            neighbor_estimates: &self.neighbor_estimates,
        })
    }

    /// Returns the input of the avoidance at the own state, without a target, and with the heading at the stamp in
    /// place of that at which the answer takes effect.
    fn avoidance_sample(&self, own: &OwnState) -> Sample<'_> {
        Sample {
            stamp_ns: own.stamp_ns,
            t_s: own.t_s(),
            heading_rad: own.pose.heading_rad,
            heading_at_effect: own.heading,
            twist: own.twist,
            front_point: self.front_point,
            front_velocity: self.front_velocity,
            neighbor_vectors: &self.neighbor_vectors,
            neighbor_classes: &self.neighbor_classes,
            proximity_valid: own.proximity_valid,
            neighbors_truncated: own.neighbors_truncated,
            neighbor_velocities: &self.neighbor_velocities,
            wall_vectors: &self.wall_vectors,
            walls_truncated: own.walls_truncated,
            error: None,
            slot_velocity: Vec2::zeros(),
        }
    }
}

impl OwnState {
    /// Returns the run time of the sample, s.
    fn t_s(&self) -> f64 {
        self.t_ns as f64 / 1e9
    }

    /// Returns the sample as input of a role.
    fn role_input<'a>(&self, neighborhood: &'a Neighborhood) -> RoleInput<'a> {
        RoleInput { stamp_ns: self.stamp_ns, t_s: self.t_s(), pose: self.pose, neighborhood }
    }
}

/// Returns the mean velocity of alpha since the `previous` sample, m/s, or 0 without one.
fn velocity_by_difference(previous: Option<(u64, Vec2)>, stamp_ns: u64, alpha: Vec2) -> Vec2 {
    previous.map_or(Vec2::zeros(), |(previous_ns, previous_alpha)| {
        (alpha - previous_alpha) / (stamp_ns.saturating_sub(previous_ns).max(1) as f64 / 1e9)
    })
}

#[cfg(test)]
mod tests;
