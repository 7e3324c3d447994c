//! Message types on the wire: `#[repr(C)]`, self-contained, SI units, frame `map`.
//!
//! Each type name carries a version and a hash of the layout (names, types, offsets and sizes of all fields),
//! because iceoryx2 compares only names and sizes: two builds that order equal fields differently would otherwise
//! misread each other's messages.
//!
//! `t_ns` is the time since the start of the run. `stamp_ns` is CLOCK_MONOTONIC in real time and equal to `t_ns`
//! in lockstep; it is the only time that decisions depend on. `sent_ns` is CLOCK_MONOTONIC in both time modes and
//! is used only for measurements.

use formation::Vec2;
use formation::desired::Target;
use formation::frame::LeaderFrame;
use formation::pose::{Pose, Twist};

use crate::signals::{SIGNALS_MAX, SignalValues};

/// Maximum coordinate of a front point, m. Beyond it, doubles resolve less than 0.1 um. Messages with larger
/// values are refused.
pub const POSITION_MAX_M: f64 = 1e9;
/// Maximum speed of a robot, m/s. Messages with larger values are refused.
pub const SPEED_MAX_M_S: f64 = 1e6;
/// Maximum angle, scale, turn rate or other rate, in SI units: products of two stay far from overflow. Messages
/// with larger values are refused.
pub const ANGLE_SCALE_AND_RATE_MAX: f64 = 1e9;
/// Maximum incarnation number. A larger one is garbage, and would make the plant refuse the real robot.
pub const INCARNATION_MAX: u64 = u32::MAX as u64;
/// Maximum number of backup leaders (deputies) of a leader.
pub const DEPUTIES_MAX: u64 = 16;

/// Maximum number of robots in the proximity list of one odometry sample.
pub const PROXIMITY_MAX: usize = 32;
/// Maximum number of convex parts of walls and obstacles in one odometry sample.
pub const WALLS_MAX: usize = 16;

/// A message whose memory is its encoding: it is sent between hosts as it lies in memory, little-endian.
///
/// # Safety
///
/// The type has no padding, and every bit pattern is a valid value.
pub unsafe trait Plain: Copy + 'static {
    /// Hash of the memory layout.
    const LAYOUT: u64;

    /// Returns the encoded bytes.
    fn bytes(&self) -> &[u8] {
        // SAFETY: there is no padding, so all bytes are initialized.
        unsafe { std::slice::from_raw_parts(std::ptr::from_ref(self).cast(), size_of::<Self>()) }
    }

    /// Decodes a message; `None` if the number of bytes is wrong.
    fn from_bytes(bytes: &[u8]) -> Option<Self> {
        // SAFETY: the length equals the size of the type, and every bit pattern is a valid value.
        (bytes.len() == size_of::<Self>())
            .then(|| unsafe { bytes.as_ptr().cast::<Self>().read_unaligned() })
    }
}

// SAFETY: a plain number.
unsafe impl Plain for u8 {
    const LAYOUT: u64 = layout::text(layout::START, "u8");
}

// SAFETY: a plain number.
unsafe impl Plain for u64 {
    const LAYOUT: u64 = layout::text(layout::START, "u64");
}

// SAFETY: the type has no bytes.
unsafe impl Plain for () {
    const LAYOUT: u64 = layout::START;
}

#[cfg(target_endian = "big")]
compile_error!("messages go from host to host little-endian");

/// Declares a message: a `#[repr(C)]` struct with a type name `phalanx/<Name>/<version>/<hash>`.
macro_rules! message {
    ($(#[$doc:meta])* $name:ident / $version:literal {
        $($(#[$field_doc:meta])* $field:ident: $type:ty,)+
    }) => {
        $(#[$doc])*
        #[derive(Debug, Clone, Copy, PartialEq)]
        #[repr(C)]
        pub struct $name { $($(#[$field_doc])* pub $field: $type,)+ }

        impl Default for $name {
            /// Returns the message whose fields are all 0.
            #[inline]
            fn default() -> $name {
                // SAFETY: plain numbers only, for which 0 is a valid value.
                unsafe { core::mem::zeroed() }
            }
        }

        const _: () = assert!(0 $(+ size_of::<$type>())+ == size_of::<$name>(), "no padding");

        // SAFETY: `#[repr(C)]`, plain numbers only, and no padding: just asserted.
        unsafe impl $crate::message::Plain for $name {
            const LAYOUT: u64 = {
                let hash = layout::text(layout::START, stringify!($name));
                $(
                    let hash = layout::text(hash, stringify!($field));
                    let hash = layout::text(hash, stringify!($type));
                    let hash = layout::number(hash, core::mem::offset_of!($name, $field));
                    let hash = layout::number(hash, core::mem::size_of::<$type>());
                )+
                layout::number(hash, core::mem::size_of::<$name>())
            };
        }

        // SAFETY: `#[repr(C)]`, plain numbers only (the layout hash covers every field), no
        // pointers; the name is unique to this layout.
        #[cfg(feature = "ipc")]
        unsafe impl iceoryx2::prelude::ZeroCopySend for $name {
            unsafe fn type_name() -> &'static str {
                static NAME: std::sync::OnceLock<String> = std::sync::OnceLock::new();
                let layout = <$name as $crate::message::Plain>::LAYOUT;
                let name = || format!("phalanx/{}/{}/{layout:016x}", stringify!($name), $version);
                NAME.get_or_init(name)
            }
        }
    };
}

message! {
    /// Plant to agent: sensor data of a robot: its own pose and twist, robots in range, and walls.
    Odometry / 6 {
        /// Plant tick, from 0.
        tick: u64,
        /// Time since the start of the run, ns.
        t_ns: u64,
        /// Time of sensing, ns.
        stamp_ns: u64,
        /// Time of sending, ns.
        sent_ns: u64,
        /// Axle mid-point, m.
        x_m: f64,
        /// Axle mid-point, m.
        y_m: f64,
        /// Heading, rad.
        heading_rad: f64,
        /// Longitudinal speed up to now, m/s.
        v_m_s: f64,
        /// Lateral speed up to now, m/s, to the left; 0 unless the robot is omnidirectional.
        side_m_s: f64,
        /// Turn rate up to now, rad/s.
        w_rad_s: f64,
        /// 1 if pose and twist are valid; otherwise they must be ignored.
        pose_valid: u64,
        /// 1 if the proximity sensor works.
        proximity_valid: u32,
        /// 1 if more robots were in range than the list holds.
        proximity_cut: u32,
        /// Number of robots in the proximity list.
        proximity_count: u32,
        /// 1 if the velocities of these robots are sensed too; only some avoidance methods need them.
        velocities_sensed: u32,
        /// Front points of the robots within the sensing radius, nearest first, m. If velocities are sensed, the
        /// list holds at most half as many, and its second half has their velocities, m/s, in the same order.
        near: [[f64; 2]; PROXIMITY_MAX],
        /// Number of points in the list of walls.
        walls_count: u32,
        /// 1 if more walls were in range than the list holds.
        walls_cut: u32,
        /// Classes of the robots in `near`, in the same order; 0 unless robots sense classes.
        near_class: [u8; PROXIMITY_MAX],
        /// For each convex part of a wall or obstacle within the sensing radius, its point nearest to the own
        /// front point, m; nearest part first. Walls are seen by the proximity sensor.
        walls: [[f64; 2]; WALLS_MAX],
    }
}

impl Odometry {
    /// Returns the pose of the axle mid-point.
    pub fn pose(&self) -> Pose {
        Pose { x_m: self.x_m, y_m: self.y_m, heading_rad: self.heading_rad }
    }

    /// Returns the twist up to the stamp.
    pub fn twist(&self) -> Twist {
        Twist { v_m_s: self.v_m_s, side_m_s: self.side_m_s, w_rad_s: self.w_rad_s }
    }

    /// Sets pose and twist; with `None` they are not valid.
    #[inline]
    pub fn set_own_state(&mut self, own: Option<(Pose, Twist)>) {
        let nothing = (Pose { x_m: 0.0, y_m: 0.0, heading_rad: 0.0 }, Twist::ZERO);
        let (pose, twist) = own.unwrap_or(nothing);
        self.pose_valid = u64::from(own.is_some());
        (self.x_m, self.y_m, self.heading_rad) = (pose.x_m, pose.y_m, pose.heading_rad);
        (self.v_m_s, self.side_m_s, self.w_rad_s) = (twist.v_m_s, twist.side_m_s, twist.w_rad_s);
    }

    /// Sets that the proximity sensor does not work. Its lists are empty afterwards.
    #[inline]
    pub fn clear_proximity(&mut self) {
        (self.proximity_valid, self.proximity_cut, self.proximity_count) = (0, 0, 0);
        (self.walls_count, self.walls_cut) = (0, 0);
    }

    /// Returns the front points of the robots within the sensing radius, nearest first, m.
    #[inline]
    pub fn proximity_front_points(&self) -> impl Iterator<Item = Vec2> {
        let count = (self.proximity_count as usize).min(self.proximity_max());
        self.near[..count].iter().map(|&[x, y]| Vec2::new(x, y))
    }

    /// Returns the classes of these robots, in the same order.
    #[inline]
    pub fn near_classes(&self) -> &[u8] {
        let count = (self.proximity_count as usize).min(self.proximity_max());
        &self.near_class[..count]
    }

    /// Returns the velocities of these front points, m/s, in the same order; empty if they are not sensed.
    #[inline]
    pub fn proximity_velocities(&self) -> impl Iterator<Item = Vec2> {
        let (count_max, count) = (self.proximity_max(), self.proximity_count as usize);
        let sensed = if self.velocities_sensed == 1 { count.min(count_max) } else { 0 };
        self.near[PROXIMITY_MAX - count_max..][..sensed].iter().map(|&[x, y]| Vec2::new(x, y))
    }

    /// Returns the nearest points of the walls within the sensing radius, nearest first, m.
    #[inline]
    pub fn nearest_wall_points(&self) -> impl Iterator<Item = Vec2> {
        let count = (self.walls_count as usize).min(WALLS_MAX);
        self.walls[..count].iter().map(|&[x, y]| Vec2::new(x, y))
    }

    fn proximity_max(&self) -> usize {
        if self.velocities_sensed == 1 { PROXIMITY_MAX / 2 } else { PROXIMITY_MAX }
    }
}

message! {
    /// Agent to plant: the commanded twist, in response to one odometry sample.
    Command / 2 {
        /// Tick of the odometry sample answered.
        tick: u64,
        /// Stamp of the odometry sample answered, ns: the command expires one command timeout after it.
        stamp_ns: u64,
        /// Time of sending, ns.
        sent_ns: u64,
        /// Sequence number, which increments within an incarnation.
        sequence: u64,
        /// Incarnation: the number of earlier starts of the robot's process.
        incarnation: u64,
        /// Longitudinal speed, m/s.
        v_m_s: f64,
        /// Lateral speed, m/s, to the left; 0 unless the robot is omnidirectional.
        side_m_s: f64,
        /// Turn rate, rad/s.
        w_rad_s: f64,
    }
}

impl Command {
    /// Returns the commanded twist.
    pub fn twist(&self) -> Twist {
        Twist { v_m_s: self.v_m_s, side_m_s: self.side_m_s, w_rad_s: self.w_rad_s }
    }

    /// Returns whether a working robot could have sent this. NaN is not plausible.
    #[inline]
    pub fn is_plausible(&self) -> bool {
        self.v_m_s.abs() <= SPEED_MAX_M_S
            && self.side_m_s.abs() <= SPEED_MAX_M_S
            && self.w_rad_s.abs() <= ANGLE_SCALE_AND_RATE_MAX
            && self.incarnation <= INCARNATION_MAX
    }
}

message! {
    /// Agent to the robots that receive from it: front point, published velocity and the leader's frame.
    Beacon / 4 {
        /// Tick of the odometry sample that this was computed from.
        tick: u64,
        /// Stamp of that odometry sample, ns.
        stamp_ns: u64,
        /// Time of sending, ns.
        sent_ns: u64,
        /// Incarnation: the number of earlier starts of the robot's process.
        incarnation: u64,
        /// Front point, x, m.
        x_m: f64,
        /// Front point, y, m.
        y_m: f64,
        /// Published velocity, x, m/s.
        vx_m_s: f64,
        /// Published velocity, y, m/s.
        vy_m_s: f64,
        /// 1 if the leader's frame in the following fields is valid.
        frame_known: u64,
        /// Rank of the leader that the frame belongs to: 0 for the main leader, k for its k-th backup leader.
        frame_rank: u64,
        /// Stamp of the odometry sample of the leader from which the frame was computed, ns.
        frame_stamp_ns: u64,
        /// Heading of the leader's frame (theta_n), rad.
        frame_heading_rad: f64,
        /// Turn rate of the leader's frame (w_n), without avoidance, rad/s.
        frame_turn_rate_rad_s: f64,
        /// Turn acceleration of the leader's frame (w_n'), rad/s^2.
        frame_turn_acceleration_rad_s2: f64,
        /// Scale of the formation (delta).
        frame_scale: f64,
        /// Rate of change of the scale (delta'), 1/s.
        frame_scale_rate_per_s: f64,
        /// Number of messages of the control law that this incarnation has sent, with the one after this header, so
        /// that a receiver can count the messages dropped by its queue.
        messages_sent: u64,
    }
}

impl Beacon {
    /// Returns the front point, m.
    #[inline]
    pub fn position(&self) -> Vec2 {
        Vec2::new(self.x_m, self.y_m)
    }

    /// Returns the published velocity, m/s.
    #[inline]
    pub fn velocity(&self) -> Vec2 {
        Vec2::new(self.vx_m_s, self.vy_m_s)
    }

    /// Returns the leader's frame and its stamp, ns; `None` if it is not valid.
    #[inline]
    pub fn leader_frame(&self) -> Option<(u64, LeaderFrame)> {
        let frame = LeaderFrame {
            heading_rad: self.frame_heading_rad,
            turn_rate_rad_s: self.frame_turn_rate_rad_s,
            turn_acceleration_rad_s2: self.frame_turn_acceleration_rad_s2,
            scale: self.frame_scale,
            scale_rate_per_s: self.frame_scale_rate_per_s,
        };
        (self.frame_known == 1).then_some((self.frame_stamp_ns, frame))
    }

    /// Returns a copy of the beacon with this frame.
    pub fn with_leader_frame(mut self, frame: Option<(u64, LeaderFrame)>) -> Beacon {
        self.set_leader_frame(frame);
        self
    }

    /// Sets the frame of the leader, and the time at which it is valid, ns; `None` if it is not known.
    #[inline]
    pub fn set_leader_frame(&mut self, frame: Option<(u64, LeaderFrame)>) {
        let (stamp_ns, leader_frame) = frame.unwrap_or((0, LeaderFrame::IDENTITY));
        self.frame_known = u64::from(frame.is_some());
        self.frame_stamp_ns = stamp_ns;
        self.frame_heading_rad = leader_frame.heading_rad;
        self.frame_turn_rate_rad_s = leader_frame.turn_rate_rad_s;
        self.frame_turn_acceleration_rad_s2 = leader_frame.turn_acceleration_rad_s2;
        self.frame_scale = leader_frame.scale;
        self.frame_scale_rate_per_s = leader_frame.scale_rate_per_s;
    }

    /// Returns whether all numbers are finite.
    #[inline]
    pub fn is_finite(&self) -> bool {
        let motion = [self.x_m, self.y_m, self.vx_m_s, self.vy_m_s];
        motion.iter().chain(&self.frame_numbers()).all(|number| number.is_finite())
    }

    /// Returns whether a working robot could have sent this, so that no law overflows on it. NaN is not plausible.
    #[inline]
    pub fn is_plausible(&self) -> bool {
        // Without branches, which is faster than up to the first number that is out of range.
        let is_within = |numbers: &[f64], max: f64| {
            numbers.iter().fold(true, |is_within, number| is_within & (number.abs() <= max))
        };
        is_within(&[self.x_m, self.y_m], POSITION_MAX_M)
            & is_within(&[self.vx_m_s, self.vy_m_s], SPEED_MAX_M_S)
            & is_within(&self.frame_numbers(), ANGLE_SCALE_AND_RATE_MAX)
            & (self.incarnation <= INCARNATION_MAX)
            & (self.frame_rank <= DEPUTIES_MAX)
    }

    fn frame_numbers(&self) -> [f64; 5] {
        [
            self.frame_heading_rad,
            self.frame_turn_rate_rad_s,
            self.frame_turn_acceleration_rad_s2,
            self.frame_scale,
            self.frame_scale_rate_per_s,
        ]
    }
}

message! {
    /// Agent to supervisor: status of the agent. After it follow the [`NeighborStatus`] of each in-neighbor and, if the
    /// run records messages, the bytes of the message of the control law at that sample.
    StatusHeader / 8 {
        /// Tick of the newest odometry sample received; 0 before the first.
        tick: u64,
        /// Time since the start of the run of that sample, ns.
        t_ns: u64,
        /// Incarnation: the number of earlier starts of the robot's process.
        incarnation: u64,
        /// 1 once the first odometry sample was answered.
        moving: u64,
        /// Number of commands sent after the deadline of the next wake-up.
        deadline_misses: u64,
        /// Number of odometry samples that were too old and were not answered (real time only).
        odometry_old: u64,
        /// Number of beacons refused: not finite, not plausible, from the future, or older than the newest one.
        beacons_refused: u64,
        /// Number of beacons sent.
        beacons_sent: u64,
        /// Number of messages of the control law sent with these beacons.
        messages_sent: u64,
        /// Hash of these messages and their ticks; 0 without messages.
        message_hash: u64,
        /// Number of messages of in-neighbors that no control cycle processed: a queue was full, or the robot was
        /// frozen.
        messages_dropped: u64,
        /// 1 if the law of a free robot named a target at that sample.
        target_known: u64,
        /// Position of the target, m.
        target_m: [f64; 2],
        /// Velocity of the target, m/s.
        target_velocity_m_s: [f64; 2],
        /// A bit for each signal that the law recorded at that sample, in the order of its declaration.
        signals_recorded: u64,
        /// Values of these signals.
        signals: [f64; SIGNALS_MAX],
        /// Reception state of the leader's frame, a [`ReceptionState`] as a number.
        frame: u64,
        /// Time since the start of the run at which that state began, ns.
        frame_since_t_ns: u64,
        /// Stamp of the current [`Goal`], ns; 0 if the goal of the brief is current.
        goal_stamp_ns: u64,
        /// Time since the start of the run at which that goal became current, ns.
        goal_since_t_ns: u64,
        /// The current goal, m.
        goal_m: [f64; 2],
        /// Number of [`NeighborStatus`] that follow.
        neighbors: u64,
    }
}

impl StatusHeader {
    /// Returns the maximum length of the bytes after the header, for this number of in-neighbors and backup neighbors,
    /// and this maximum length of a recorded message, bytes.
    pub const fn payload_bytes_max(neighbors: usize, message_bytes_max: usize) -> usize {
        neighbors * size_of::<NeighborStatus>() + message_bytes_max
    }

    /// Returns the bytes after the header. `message` is empty if no message is recorded.
    pub fn encode_payload(
        neighbors: impl ExactSizeIterator<Item = NeighborStatus>,
        message: &[u8],
    ) -> Vec<u8> {
        let length = StatusHeader::payload_bytes_max(neighbors.len(), message.len());
        let mut payload = Vec::with_capacity(length);
        neighbors.for_each(|neighbor| payload.extend(neighbor.bytes()));
        payload.extend(message);
        payload
    }

    /// Splits the bytes after the header into the states of the neighbors and the recorded message, which is empty if
    /// there is none. Returns `None` if the bytes are incomplete.
    pub fn split_payload<'a>(&self, payload: &'a [u8]) -> Option<(Vec<NeighborStatus>, &'a [u8])> {
        let count = usize::try_from(self.neighbors).ok()?;
        let length = count.checked_mul(size_of::<NeighborStatus>())?;
        let (neighbors, message) = payload.split_at_checked(length)?;
        let neighbors = neighbors.chunks_exact(size_of::<NeighborStatus>());
        Some((neighbors.map(NeighborStatus::from_bytes).collect::<Option<_>>()?, message))
    }

    /// Returns the target that the law of a free robot named at that sample; `None` if it named none.
    pub fn target(&self) -> Option<Target> {
        let target =
            Target { position: self.target_m.into(), velocity: self.target_velocity_m_s.into() };
        (self.target_known == 1).then_some(target)
    }

    /// Returns the values of signals that the law recorded at that sample.
    pub fn signals(&self) -> SignalValues {
        SignalValues::from_parts(self.signals_recorded, self.signals)
    }

    /// Returns the current goal if it came from outside: the time since the start of the run at which it became
    /// current, ns, and its position, m.
    pub fn goal(&self) -> Option<(u64, [f64; 2])> {
        (self.goal_stamp_ns > 0).then_some((self.goal_since_t_ns, self.goal_m))
    }
}

message! {
    /// Goal from outside, for a robot whose role goes to a goal (real time only): the target of its front point from
    /// its next tick on. It is sent repeatedly; only a newer stamp changes the goal.
    Goal / 1 {
        /// Time of arrival at the process that received it from outside, ns; not 0.
        stamp_ns: u64,
        /// Target in `map`, x, m.
        x_m: f64,
        /// Target in `map`, y, m.
        y_m: f64,
    }
}

impl Goal {
    /// Returns the target, m.
    pub fn position(&self) -> Vec2 {
        Vec2::new(self.x_m, self.y_m)
    }

    /// Returns whether the target is within the coordinate limit. NaN is not plausible.
    #[inline]
    pub fn is_plausible(&self) -> bool {
        self.x_m.abs() <= POSITION_MAX_M && self.y_m.abs() <= POSITION_MAX_M
    }
}

message! {
    /// ROS 2 process to supervisor: number of goals accepted and refused since that process started.
    GoalCounts / 1 {
        /// Start time of the process, ns. Another process counts from 0.
        began_ns: u64,
        /// Number of goals accepted.
        taken: u64,
        /// Number of goals refused, by reason: see [`crate::goal`].
        refused: [u64; 8],
    }
}

message! {
    /// Supervisor to agent (real time only): whether a user cut the link from a neighbor. Cuts of the scenario
    /// are in the brief.
    LinkFaultByHand / 1 {
        /// Scenario index of the neighbor, from 1.
        robot: u64,
        /// 1 if the link is cut: no beacon gets through.
        cut: u64,
    }
}

message! {
    /// Status of one in-neighbor, as seen by the agent.
    NeighborStatus / 2 {
        /// Scenario index of the neighbor, from 1.
        robot: u64,
        /// Reception state, a [`ReceptionState`] as a number.
        contact: u64,
        /// Tick at which that state began.
        since_tick: u64,
        /// Time since the start of the run at which that state began, ns.
        since_t_ns: u64,
        /// 1 if the robot uses it as a reference: an in-neighbor unless a backup neighbor (spare) replaces it, or
        /// a backup neighbor while it replaces one.
        goes_by: u64,
        /// Time since the start of the run at which `goes_by` last changed, ns; 0 if it never did.
        goes_by_since_t_ns: u64,
    }
}

wire_enum! {
    /// Reception state of a neighbor.
    #[derive(Default)]
    ReceptionState: u64 {
        /// Initial state: this incarnation has received no beacon.
        #[default]
        NothingReceived = 0 "unheard",
        /// Recent beacon: used as received.
        Fresh = 1 "fresh",
        /// Beacon older than the stale threshold: extrapolated by its published velocity.
        Stale = 2 "stale",
        /// Beacon older than the lost threshold: timed out, so the silence policy applies.
        Lost = 3 "lost",
        /// Out of the range of communication by distance, after it was in range: nothing is known about it.
        Apart = 4 "apart",
    }
}

message! {
    /// Plant to supervisor, before the slice of [`TruthRow`]: time, and counters and extremes since the start of
    /// the run. They are cumulative, so a lost message loses no count.
    TruthHeader / 3 {
        /// Plant tick, from 0.
        tick: u64,
        /// Time since the start of the run, ns.
        t_ns: u64,
        /// Stamp of the same instant, ns.
        stamp_ns: u64,
        /// Time of sending, ns.
        sent_ns: u64,
        /// Minimum distance between two front points at the end of any arc since the start, m.
        closest_m: f64,
        /// Time of that minimum since the start of the run, ns.
        closest_t_ns: u64,
        /// Indices of these two robots, from 0.
        closest_pair: [u32; 2],
        /// Number of arcs at whose end some pair was closer than d.
        violations: u64,
        /// Minimum distance of a front point from a wall or obstacle at the end of any arc since the start, m.
        clearance_m: f64,
        /// Time of that minimum since the start of the run, ns.
        clearance_t_ns: u64,
        /// Position of that front point, m.
        clearance_at_m: [f64; 2],
        /// Index of that robot and index of the convex part, both from 0.
        clearance_between: [u32; 2],
        /// Number of arcs at whose end some front point was closer to a wall than the clearance.
        clearance_violations: u64,
        /// Number of commands refused because they had expired or had a stamp in the future.
        commands_late: u64,
        /// Number of commands refused because a newer one had been accepted.
        commands_old: u64,
        /// Number of commands refused because they were not finite or not plausible.
        commands_not_finite: u64,
        /// Number of commands scaled down to the speed limit.
        commands_scaled: u64,
        /// Number of accepted commands that expired without a successor: the wheels stopped.
        commands_expired: u64,
        /// Maximum age of a command that moved a robot, ns: from the stamp of the sample that it answers.
        command_age_ns_max: u64,
    }
}

message! {
    /// Ground truth of one robot.
    TruthRow / 2 {
        /// Axle mid-point, x, m.
        x_m: f64,
        /// Axle mid-point, y, m.
        y_m: f64,
        /// Heading, rad.
        heading_rad: f64,
        /// Longitudinal speed over the arc that ends at this tick, m/s.
        v_m_s: f64,
        /// Lateral speed over the arc that ends at this tick, m/s, to the left; 0 unless the robot is omnidirectional.
        side_m_s: f64,
        /// Turn rate over the arc that ends at this tick, rad/s.
        w_rad_s: f64,
        /// 1 if a command was in effect over that arc.
        commanded: u64,
    }
}

impl TruthRow {
    /// Returns the pose of the axle mid-point.
    pub fn pose(&self) -> Pose {
        Pose { x_m: self.x_m, y_m: self.y_m, heading_rad: self.heading_rad }
    }
}

message! {
    /// Agent or plant to supervisor, before the slice of [`LatencyRow`]: origin of these values.
    LatencyHeader / 1 {
        /// Incarnation: the number of earlier starts of the robot's process; 0 for the plant.
        incarnation: u64,
        /// Number of values that this incarnation measured before these.
        first_row: u64,
        /// Number of samples since its start that this process should have received and that were overwritten before.
        samples_lost: u64,
    }
}

message! {
    /// One value measured by an agent or the plant.
    LatencyRow / 1 {
        /// A [`Stage`](crate::stage::Stage) as a number.
        stage: u32,
        /// Scenario index, from 1, of the robot whose beacon or command was measured; 0 for none.
        from: u32,
        /// Measured value, ns.
        value_ns: u64,
    }
}

message! {
    /// Orders to a host without the plant, in a run on several hosts, before the slice of [`OrderRow`]. An order
    /// gives the desired state and not a change, so a lost order is repaired by the next one.
    OrderHeader / 1 {
        /// Sequence number, which increments with every message sent.
        sequence: u64,
        /// Desired phase, a [`Phase`] as a number.
        phase: u64,
        /// 1 if the run failed; valid at its end.
        failed: u64,
    }
}

message! {
    /// Desired state of the process of one robot of that host.
    OrderRow / 1 {
        /// Scenario index of the robot, from 1.
        robot: u64,
        /// Desired total number of starts of its process.
        starts: u64,
        /// Desired process state, a [`WantedState`] as a number.
        wanted: u64,
    }
}

message! {
    /// Report of a host without the plant, in a run on several hosts, before the slice of [`ReportRow`].
    ReportHeader / 1 {
        /// Sequence number, which increments with every message sent.
        sequence: u64,
        /// Current phase, a [`Phase`] as a number.
        phase: u64,
        /// Number of restarts of its bridge.
        bridge_restarts: u64,
    }
}

message! {
    /// State of the process of one robot of that host.
    ReportRow / 2 {
        /// Scenario index of the robot, from 1.
        robot: u64,
        /// Number of starts of its process.
        starts: u64,
        /// Number of its processes that have exited, been reaped, and had their stale resources removed.
        cleaned: u64,
        /// 1 if the process that was started last has exited and been reaped.
        ended: u64,
        /// Exit status of that process, as `wait` returns it.
        status: u64,
        /// 1 if it exited before its host was ordered to end the run.
        ended_early: u64,
        /// State of the process at the last poll by its host, a [`PolledState`] as a number.
        state: u64,
        /// CPU time of the process at that poll, ns.
        computed_ns: u64,
        /// Time of that poll by the clock of the host, ns.
        polled_ns: u64,
    }
}

message! {
    /// Bridge to its supervisor, before the slice of [`PeerRow`]: counters since the start of the bridge.
    BridgeHeader / 2 {
        /// Random number drawn at the start of the bridge.
        boot: u64,
        /// Number of frames sent to other hosts.
        sent: u64,
        /// Number of these frames that carry odometry, commands or beacons.
        samples_sent: u64,
        /// Number of frames accepted from other hosts.
        taken: u64,
        /// Number of records that the host of the plant has not acknowledged yet.
        unconfirmed: u64,
        /// Number of records dropped because that host was unreachable for too long.
        told_dropped: u64,
        /// Number of samples dropped and connections refused, by reason: see [`crate::dropped`].
        dropped: [u64; 16],
    }
}

message! {
    /// Link of a bridge to another host.
    PeerRow / 1 {
        /// Index of the host in the fleet file, from 0.
        host: u64,
        /// Time since a message of that host was last received, ns; `u64::MAX` if none ever was.
        silent_ns: u64,
        /// Minimum of the recent round-trip times, ns; 0 if none was measured.
        round_trip_ns: u64,
        /// Maximum of half the round-trip time with which a stamp was converted, ns.
        uncertainty_ns_max: u64,
    }
}

wire_enum! {
    /// Phase of a run on several hosts.
    #[derive(Default)]
    Phase: u64 {
        /// Waiting for all hosts.
        #[default]
        Gathering = 0 "gathering",
        /// Robots are started and move.
        Running = 1 "running",
        /// Shutdown: processes exit, and their remaining records are forwarded.
        Ending = 2 "ending",
        /// Shutdown complete.
        Done = 3 "done",
    }
}

wire_enum! {
    /// Desired state of a process.
    #[derive(Default)]
    WantedState: u64 {
        /// Running process.
        #[default]
        Running = 0 "running",
        /// Stopped by SIGSTOP.
        Stopped = 1 "stopped",
        /// Killed by SIGKILL.
        Killed = 2 "killed",
    }
}

wire_enum! {
    /// Process state of a robot on another host at the last poll by that host.
    #[derive(Default)]
    PolledState: u64 {
        /// Unknown state: not polled since the last order, or stopped as ordered.
        #[default]
        NotPolled = 0 "not polled",
        /// Running, or waiting for a CPU core.
        Runnable = 1 "runnable",
        /// Waiting for anything else.
        Blocked = 2 "blocked",
        /// Stopped by SIGSTOP without an order.
        Stopped = 3 "stopped",
    }
}

/// FNV-1a hash of a memory layout, computed at compile time.
mod layout {
    pub const START: u64 = 0xcbf2_9ce4_8422_2325;

    const fn bytes(mut hash: u64, bytes: &[u8]) -> u64 {
        let mut i = 0;
        while i < bytes.len() {
            hash = (hash ^ bytes[i] as u64).wrapping_mul(0x0000_0100_0000_01b3);
            i += 1;
        }
        hash
    }

    pub const fn text(hash: u64, text: &str) -> u64 {
        bytes(bytes(hash, text.as_bytes()), &[0xff])
    }

    pub const fn number(hash: u64, number: usize) -> u64 {
        bytes(hash, &(number as u64).to_le_bytes())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    mod reordered {
        use super::layout;
        message! {
            /// `LatencyHeader` with two fields swapped.
            LatencyHeader / 1 {
                /// Field of the original.
                first_row: u64,
                /// Field of the original.
                incarnation: u64,
                /// Field of the original.
                samples_lost: u64,
            }
        }
    }

    #[test]
    fn reordered_fields_of_equal_size_change_the_layout_hash() {
        assert_eq!(size_of::<LatencyHeader>(), size_of::<reordered::LatencyHeader>());
        assert_ne!(LatencyHeader::LAYOUT, reordered::LatencyHeader::LAYOUT);
    }

    /// Compares the hashes with those of the first build in which hosts exchanged them.
    #[test]
    fn layout_hashes_equal_those_of_earlier_builds() {
        assert_eq!(
            (Command::LAYOUT, Beacon::LAYOUT),
            (0xb2c2_5179_10a1_fdbd, 0x7149_9a2e_1144_cf98)
        );
    }

    #[test]
    fn status_payload_splits_into_neighbors_and_message() {
        let rows = [1, 2].map(|robot| NeighborStatus { robot, ..NeighborStatus::default() });
        let header = StatusHeader { neighbors: 2, ..StatusHeader::default() };
        for message in [&[][..], &[7, 8, 9]] {
            let payload = StatusHeader::encode_payload(rows.into_iter(), message);
            assert_eq!(payload.len(), StatusHeader::payload_bytes_max(2, message.len()));
            assert_eq!(header.split_payload(&payload), Some((rows.to_vec(), message)));
        }
        assert_eq!(header.split_payload(&[0; 3]), None);
        let neighbors = u64::MAX;
        let garbage = StatusHeader { neighbors, ..StatusHeader::default() };
        assert_eq!(garbage.split_payload(&[0; 3]), None);
    }

    #[test]
    fn message_round_trips_through_its_bytes() {
        let command = Command { tick: 7, v_m_s: -0.25, ..Command::default() };
        let bytes = command.bytes().to_vec();
        assert_eq!(bytes.len(), size_of::<Command>());
        assert_eq!(Command::from_bytes(&bytes), Some(command));
        assert_eq!(Command::from_bytes(&bytes[1..]), None);
        assert_eq!(<()>::from_bytes(&[]), Some(()));
    }
}
