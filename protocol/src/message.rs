//! The messages on the wire: `#[repr(C)]`, self-contained, SI units, frame `map`.
//!
//! Each type's name carries a version and a hash of its layout (names, types, offsets and sizes
//! of all fields), because iceoryx2 compares names and sizes only: two builds that order equal
//! fields differently would otherwise read each other's numbers as their own.
//!
//! `t_ns` is the time since the run's start. `stamp_ns` is CLOCK_MONOTONIC in real time and equal
//! to `t_ns` in lockstep; it is the only time that decides anything. `sent_ns` is CLOCK_MONOTONIC
//! in both paces and only measures.

use formation::Vec2;
use formation::frame::LeaderFrame;
use formation::pose::{Pose, Twist};

/// No front point is farther from the origin than this, m: beyond, doubles resolve less than
/// 0.1 um.
pub const POSITION_MAX_M: f64 = 1e9;
/// No robot is faster than this, m/s.
pub const SPEED_MAX_M_S: f64 = 1e6;
/// No angle, scale, turn rate or other rate is larger than this, in SI units: products of two stay
/// far from overflow.
pub const OTHER_MAX: f64 = 1e9;
/// No robot's process was started more often than this: a larger number is garbage, and would lock
/// out the honest.
pub const INCARNATION_MAX: u64 = u32::MAX as u64;
/// Most deputies of a leader.
pub const DEPUTIES_MAX: u64 = 16;

/// The most robots that one odometry sample reports as near.
pub const PROXIMITY_MAX: usize = 32;
/// The most convex parts of walls and obstacles that one odometry sample reports as near.
pub const WALLS_MAX: usize = 16;

/// A message that is its bytes: it goes from host to host as it lies in memory, little-endian.
///
/// # Safety
/// It has no padding, and any bytes are a value of it.
pub unsafe trait Plain: Copy + 'static {
    /// The hash of its layout.
    const LAYOUT: u64;

    /// Its bytes.
    fn bytes(&self) -> &[u8] {
        // SAFETY: no padding, hence all of them are initialised.
        unsafe { std::slice::from_raw_parts(std::ptr::from_ref(self).cast(), size_of::<Self>()) }
    }

    /// The message that these bytes are, if they are as many as it has.
    fn of_bytes(bytes: &[u8]) -> Option<Self> {
        // SAFETY: as many as are read; any bytes are a value.
        (bytes.len() == size_of::<Self>())
            .then(|| unsafe { bytes.as_ptr().cast::<Self>().read_unaligned() })
    }
}

// SAFETY: a plain number.
unsafe impl Plain for u64 {
    const LAYOUT: u64 = layout::text(layout::START, "u64");
}

// SAFETY: nothing of nothing.
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
        #[derive(Debug, Clone, Copy, PartialEq, Default)]
        #[repr(C)]
        pub struct $name { $($(#[$field_doc])* pub $field: $type,)+ }

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
    /// Plant to agent: what a robot senses about itself and about who is near.
    Odometry / 4 {
        /// Plant tick, from 0.
        tick: u64,
        /// Time since the run's start, ns.
        t_ns: u64,
        /// When this was sensed, ns.
        stamp_ns: u64,
        /// When this was sent, ns.
        sent_ns: u64,
        /// Axle mid-point, m.
        x_m: f64,
        /// Axle mid-point, m.
        y_m: f64,
        /// Heading, rad.
        heading_rad: f64,
        /// Longitudinal speed in force up to now, m/s.
        v_m_s: f64,
        /// Turn rate in force up to now, rad/s.
        w_rad_s: f64,
        /// 1 if pose and twist are known; otherwise they mean nothing.
        pose_valid: u64,
        /// 1 if the proximity sensor works.
        proximity_valid: u32,
        /// 1 if more robots were near than fit in the list.
        proximity_cut: u32,
        /// How many robots are reported as near.
        proximity_count: u32,
        /// 1 if their velocities are sensed as well, which only some avoidance methods ask for.
        velocities_sensed: u32,
        /// Front points of the robots within the sensing radius, nearest first, m. Where velocities
        /// are sensed these are half as many at most, and the second half has the velocities of
        /// these front points, m/s, in the same order: nobody else pays for them.
        near: [[f64; 2]; PROXIMITY_MAX],
        /// How many points of walls are reported.
        walls_count: u32,
        /// 1 if more walls were near than fit in the list.
        walls_cut: u32,
        /// Of each convex part of a wall or obstacle within the sensing radius the point that is nearest
        /// to the own front point, nearest first, m. The proximity sensor sees them too.
        walls: [[f64; 2]; WALLS_MAX],
    }
}

impl Odometry {
    /// Pose of the axle's mid-point.
    pub fn pose(&self) -> Pose {
        Pose { x_m: self.x_m, y_m: self.y_m, heading_rad: self.heading_rad }
    }

    /// Twist in force up to the stamp.
    pub fn twist(&self) -> Twist {
        Twist { v_m_s: self.v_m_s, w_rad_s: self.w_rad_s }
    }

    /// Front points of the robots within the sensing radius, nearest first, m.
    pub fn proximity(&self) -> impl Iterator<Item = Vec2> {
        let count = (self.proximity_count as usize).min(self.proximity_max());
        self.near[..count].iter().map(|&[x, y]| Vec2::new(x, y))
    }

    /// Velocities of these front points, m/s, in the same order; none where they are not sensed.
    pub fn velocities(&self) -> impl Iterator<Item = Vec2> {
        let (most, count) = (self.proximity_max(), self.proximity_count as usize);
        let sensed = if self.velocities_sensed == 1 { count.min(most) } else { 0 };
        self.near[PROXIMITY_MAX - most..][..sensed].iter().map(|&[x, y]| Vec2::new(x, y))
    }

    /// Nearest points of the walls within the sensing radius, nearest first, m.
    pub fn walls(&self) -> impl Iterator<Item = Vec2> {
        let count = (self.walls_count as usize).min(WALLS_MAX);
        self.walls[..count].iter().map(|&[x, y]| Vec2::new(x, y))
    }

    fn proximity_max(&self) -> usize {
        if self.velocities_sensed == 1 { PROXIMITY_MAX / 2 } else { PROXIMITY_MAX }
    }
}

message! {
    /// Agent to plant: how to move, in answer to one odometry sample.
    Command / 1 {
        /// Tick of the odometry answered.
        tick: u64,
        /// Stamp of the odometry answered, ns: the command dies at this stamp plus its lifetime.
        stamp_ns: u64,
        /// When this was sent, ns.
        sent_ns: u64,
        /// Counts up within an incarnation.
        sequence: u64,
        /// How often this robot's process was started before.
        incarnation: u64,
        /// Longitudinal speed, m/s.
        v_m_s: f64,
        /// Turn rate, rad/s.
        w_rad_s: f64,
    }
}

impl Command {
    /// The twist asked for.
    pub fn twist(&self) -> Twist {
        Twist { v_m_s: self.v_m_s, w_rad_s: self.w_rad_s }
    }

    /// Whether a robot that works could have said this. NaN is not plausible.
    pub fn is_plausible(&self) -> bool {
        self.v_m_s.abs() <= SPEED_MAX_M_S
            && self.w_rad_s.abs() <= OTHER_MAX
            && self.incarnation <= INCARNATION_MAX
    }
}

message! {
    /// Agent to those that hear it: where its front point is and where it wants to go.
    Beacon / 3 {
        /// Tick of the odometry this was computed from.
        tick: u64,
        /// Stamp of that odometry, ns.
        stamp_ns: u64,
        /// When this was sent, ns.
        sent_ns: u64,
        /// How often this robot's process was started before.
        incarnation: u64,
        /// Front point, m.
        x_m: f64,
        /// Front point, m.
        y_m: f64,
        /// Published velocity, m/s.
        vx_m_s: f64,
        /// Published velocity, m/s.
        vy_m_s: f64,
        /// 1 if the leader's frame below is known.
        frame_known: u64,
        /// Whose it is: 0 the main leader's, k that of the k-th deputy, which leads in its place.
        frame_rank: u64,
        /// Stamp of the leader's odometry that the frame is from, ns.
        frame_stamp_ns: u64,
        /// theta_n, rad.
        frame_heading_rad: f64,
        /// w_n, free of avoidance, rad/s.
        frame_turn_rate_rad_s: f64,
        /// w_n', rad/s^2.
        frame_turn_acceleration_rad_s2: f64,
        /// delta.
        frame_scale: f64,
        /// delta', 1/s.
        frame_scale_rate_per_s: f64,
    }
}

impl Beacon {
    /// Front point, m.
    pub fn position(&self) -> Vec2 {
        Vec2::new(self.x_m, self.y_m)
    }

    /// Published velocity, m/s.
    pub fn velocity(&self) -> Vec2 {
        Vec2::new(self.vx_m_s, self.vy_m_s)
    }

    /// The leader's frame, if known, and its stamp, ns.
    pub fn frame(&self) -> Option<(u64, LeaderFrame)> {
        let frame = LeaderFrame {
            heading_rad: self.frame_heading_rad,
            turn_rate_rad_s: self.frame_turn_rate_rad_s,
            turn_acceleration_rad_s2: self.frame_turn_acceleration_rad_s2,
            scale: self.frame_scale,
            scale_rate_per_s: self.frame_scale_rate_per_s,
        };
        (self.frame_known == 1).then_some((self.frame_stamp_ns, frame))
    }

    /// The same beacon with this frame.
    pub fn with_frame(self, frame: Option<(u64, LeaderFrame)>) -> Beacon {
        let (stamp_ns, known) = frame.unwrap_or((0, LeaderFrame::STILL));
        Beacon {
            frame_known: u64::from(frame.is_some()),
            frame_stamp_ns: stamp_ns,
            frame_heading_rad: known.heading_rad,
            frame_turn_rate_rad_s: known.turn_rate_rad_s,
            frame_turn_acceleration_rad_s2: known.turn_acceleration_rad_s2,
            frame_scale: known.scale,
            frame_scale_rate_per_s: known.scale_rate_per_s,
            ..self
        }
    }

    /// Whether all its numbers are numbers.
    pub fn is_finite(&self) -> bool {
        let motion = [self.x_m, self.y_m, self.vx_m_s, self.vy_m_s];
        motion.iter().chain(&self.frame_numbers()).all(|number| number.is_finite())
    }

    /// Whether a robot that works could have said this, so that no law overflows on it.
    pub fn is_plausible(&self) -> bool {
        let within = |numbers: &[f64], max: f64| numbers.iter().all(|number| number.abs() <= max);
        within(&[self.x_m, self.y_m], POSITION_MAX_M)
            && within(&[self.vx_m_s, self.vy_m_s], SPEED_MAX_M_S)
            && within(&self.frame_numbers(), OTHER_MAX)
            && self.incarnation <= INCARNATION_MAX
            && self.frame_rank <= DEPUTIES_MAX
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
    /// Agent to supervisor, before the slice of [`NeighborStatus`]: how the agent is doing.
    StatusHeader / 4 {
        /// Tick of the newest odometry taken; 0 before the first.
        tick: u64,
        /// Time since the run's start of that odometry, ns.
        t_ns: u64,
        /// How often this robot's process was started before.
        incarnation: u64,
        /// 1 once the first odometry was answered.
        moving: u64,
        /// Commands sent after the next wake-up was due.
        deadline_misses: u64,
        /// Real time: samples too old for an answer, which got none.
        odometry_old: u64,
        /// Beacons refused: not finite, not plausible, from the future, older than the newest one.
        beacons_refused: u64,
        /// How the leader's frame is heard, a [`Contact`] as a number.
        frame: u64,
        /// Time since the run's start since which it is so, ns.
        frame_since_t_ns: u64,
        /// Stamp of the [`Goal`] in force, ns; 0: none, where the brief sends it counts.
        goal_stamp_ns: u64,
        /// Time since the run's start since which it is in force, ns.
        goal_since_t_ns: u64,
        /// That goal, m.
        goal_m: [f64; 2],
    }
}

impl StatusHeader {
    /// The goal in force that came from outside, m, and since when of the run's time, ns.
    pub fn goal(&self) -> Option<(u64, [f64; 2])> {
        (self.goal_stamp_ns > 0).then_some((self.goal_since_t_ns, self.goal_m))
    }
}

message! {
    /// From outside to a robot whose role goes to a goal, in real time: where its front point is to go from
    /// the robot's next tick on. It is said again and again; only a newer stamp is news.
    Goal / 1 {
        /// When it came in, ns; not 0.
        stamp_ns: u64,
        /// The place in `map`, m.
        x_m: f64,
        /// The place in `map`, m.
        y_m: f64,
    }
}

impl Goal {
    /// The place, m.
    pub fn position(&self) -> Vec2 {
        Vec2::new(self.x_m, self.y_m)
    }

    /// Whether a robot can be sent there at all. NaN is not plausible.
    pub fn is_plausible(&self) -> bool {
        self.x_m.abs() <= POSITION_MAX_M && self.y_m.abs() <= POSITION_MAX_M
    }
}

message! {
    /// The process of ROS 2 to the supervisor: what became of goals since that process began.
    GoalCounts / 1 {
        /// When it began, ns: another process counts from 0.
        began_ns: u64,
        /// Goals taken.
        taken: u64,
        /// Goals refused, by reason: see [`crate::goal`].
        refused: [u64; 8],
    }
}

message! {
    /// Supervisor to agent, in real time: whether somebody cut the link from a neighbour by hand. What
    /// the scenario cuts is in the brief.
    LinkFaultByHand / 1 {
        /// Place of the neighbour in the scenario, from 1.
        robot: u64,
        /// 1 if nothing gets through.
        cut: u64,
    }
}

message! {
    /// What an agent thinks of one robot it hears.
    NeighborStatus / 2 {
        /// Place of the neighbour in the scenario, from 1.
        robot: u64,
        /// A [`Contact`] as a number.
        contact: u64,
        /// Tick at which it became so.
        since_tick: u64,
        /// Time since the run's start at which it became so, ns.
        since_t_ns: u64,
        /// 1 if the robot goes by it: an in-neighbour unless a spare replaces it, a spare while it
        /// replaces one.
        goes_by: u64,
        /// Time since the run's start at which that became so, ns; 0: it always was.
        goes_by_since_t_ns: u64,
    }
}

numbered! {
    /// How well a neighbour is heard.
    #[derive(Default)]
    Contact: u64 {
        /// Never heard by this incarnation.
        #[default]
        Unheard = 0 "unheard",
        /// Heard recently enough to be taken at its word.
        Fresh = 1 "fresh",
        /// Extrapolated by its published velocity.
        Stale = 2 "stale",
        /// Given up; the silence policy decides.
        Lost = 3 "lost",
    }
}

message! {
    /// Plant to supervisor, before the slice of [`TruthRow`]: time, and what the plant saw between
    /// two truths. Counters run from the start, so that a lost truth loses no count.
    TruthHeader / 3 {
        /// Plant tick, from 0.
        tick: u64,
        /// Time since the run's start, ns.
        t_ns: u64,
        /// The same instant as a stamp, ns.
        stamp_ns: u64,
        /// When this was sent, ns.
        sent_ns: u64,
        /// Smallest distance between two front points at any arc's end so far, m.
        closest_m: f64,
        /// When that was, ns since the run's start.
        closest_t_ns: u64,
        /// Between which two, places from 0.
        closest_pair: [u32; 2],
        /// Arcs' ends so far at which some pair was nearer than d.
        violations: u64,
        /// Smallest distance of a front point from a wall or obstacle at any arc's end so far, m.
        clearance_m: f64,
        /// When that was, ns since the run's start.
        clearance_t_ns: u64,
        /// Where the front point was, m.
        clearance_at_m: [f64; 2],
        /// Whose front point, place from 0, and from which convex part, place from 0.
        clearance_between: [u32; 2],
        /// Arcs' ends so far at which some front point was nearer to a wall than the clearance.
        clearance_violations: u64,
        /// Commands refused because they had died or had come from the future.
        commands_late: u64,
        /// Commands refused because a newer one had been accepted.
        commands_old: u64,
        /// Commands refused because they were not finite, or not plausible.
        commands_not_finite: u64,
        /// Commands scaled down to the speed limit.
        commands_scaled: u64,
        /// Accepted commands that died with no successor: the wheels stopped.
        commands_expired: u64,
        /// The greatest age of a command that moved a robot, from the stamp of the sample that it answers, ns.
        command_age_ns_max: u64,
    }
}

message! {
    /// The true state of one robot.
    TruthRow / 1 {
        /// Axle mid-point, m.
        x_m: f64,
        /// Axle mid-point, m.
        y_m: f64,
        /// Heading, rad.
        heading_rad: f64,
        /// Longitudinal speed over the arc that ends here, m/s.
        v_m_s: f64,
        /// Turn rate over the arc that ends here, rad/s.
        w_rad_s: f64,
        /// 1 if a command was in force over that arc.
        commanded: u64,
    }
}

impl TruthRow {
    /// Pose of the axle's mid-point.
    pub fn pose(&self) -> Pose {
        Pose { x_m: self.x_m, y_m: self.y_m, heading_rad: self.heading_rad }
    }
}

message! {
    /// Agent or plant to supervisor, before the slice of [`LatencyRow`]: which values these are.
    LatencyHeader / 1 {
        /// How often this robot's process was started before; 0 for the plant.
        incarnation: u64,
        /// How many values this incarnation had measured before these.
        first_row: u64,
        /// Samples so far that this process should have taken and that were gone.
        samples_lost: u64,
    }
}

message! {
    /// One value measured by an agent or the plant.
    LatencyRow / 1 {
        /// A [`Stage`](crate::stage::Stage) as a number.
        stage: u32,
        /// Place in the scenario, from 1, of the robot whose beacon or command it is about; 0 for
        /// none.
        from: u32,
        /// The value, ns.
        value_ns: u64,
    }
}

message! {
    /// Where a run has several hosts: what a host without the plant is to do, before the slice of
    /// [`OrderRow`]. It says how all is to be, not what is to change: whoever missed one is right again
    /// with the next.
    OrderHeader / 1 {
        /// Counts up with every one that is sent.
        sequence: u64,
        /// A [`Phase`] as a number.
        phase: u64,
        /// 1 if the run could not go on, at its end.
        failed: u64,
    }
}

message! {
    /// How the process of one robot of that host is to be.
    OrderRow / 1 {
        /// Place of the robot in the scenario, from 1.
        robot: u64,
        /// How often its process is to have been started by now.
        starts: u64,
        /// A [`Wanted`] as a number.
        wanted: u64,
    }
}

message! {
    /// Where a run has several hosts: how a host without the plant is doing, before the slice of
    /// [`ReportRow`].
    ReportHeader / 1 {
        /// Counts up with every one that is sent.
        sequence: u64,
        /// A [`Phase`] as a number: how far it is.
        phase: u64,
        /// How often its bridge was started anew.
        bridge_restarts: u64,
    }
}

message! {
    /// How the process of one robot of that host is.
    ReportRow / 2 {
        /// Place of the robot in the scenario, from 1.
        robot: u64,
        /// How often its process was started.
        starts: u64,
        /// How often its process ended, was reaped, and its remains were removed.
        cleaned: u64,
        /// 1 if the process that was started last has ended and was reaped.
        ended: u64,
        /// How it ended, as `wait` has it.
        status: u64,
        /// 1 if it ended before its host was told that the run is over.
        ended_early: u64,
        /// A [`Polled`] as a number: its state when its host polled it last.
        state: u64,
        /// Processor time of the process at that poll, ns.
        computed_ns: u64,
        /// Time of that poll by the clock of the host, ns.
        polled_ns: u64,
    }
}

message! {
    /// A bridge to its supervisor, before the slice of [`PeerRow`]: how it is doing. Counters run from
    /// its start.
    BridgeHeader / 2 {
        /// Drawn when it started.
        boot: u64,
        /// Frames sent to other hosts.
        sent: u64,
        /// Of these, odometry, commands and beacons.
        samples_sent: u64,
        /// Frames taken over from other hosts.
        taken: u64,
        /// What it measured and told, and the plant's host has not confirmed yet.
        unconfirmed: u64,
        /// How many of them were dropped, because that host was away for too long.
        told_dropped: u64,
        /// What was dropped and refused, by reason: see the crate `bridge`.
        dropped: [u64; 16],
    }
}

message! {
    /// What a bridge knows of another host.
    PeerRow / 1 {
        /// Place of the host in the fleet file, from 0.
        host: u64,
        /// How long ago it was heard last, ns; `u64::MAX`: never.
        silent_ns: u64,
        /// The smallest round trip of late, ns; 0 if none was measured.
        round_trip_ns: u64,
        /// The largest half of a round trip that a stamp was read by so far, ns.
        uncertainty_ns_max: u64,
    }
}

numbered! {
    /// How far a run on several hosts is.
    #[derive(Default)]
    Phase: u64 {
        /// Not all hosts are there.
        #[default]
        Gathering = 0 "gathering",
        /// Robots are started, and move.
        Running = 1 "running",
        /// It is over: processes end, and what they told is handed over.
        Ending = 2 "ending",
        /// All of that is done.
        Done = 3 "done",
    }
}

numbered! {
    /// How a process is to be.
    #[derive(Default)]
    Wanted: u64 {
        /// Running.
        #[default]
        Running = 0 "running",
        /// Stopped by SIGSTOP.
        Stopped = 1 "stopped",
        /// Killed by SIGKILL.
        Killed = 2 "killed",
    }
}

numbered! {
    /// Process state of a robot on another host, as its host polled it last.
    #[derive(Default)]
    Polled: u64 {
        /// Not polled since the last order, or stopped as ordered.
        #[default]
        Not = 0 "not polled",
        /// Running, or waiting for a processor.
        Runnable = 1 "runnable",
        /// Waiting for anything else.
        Blocked = 2 "blocked",
        /// Stopped by SIGSTOP without an order.
        Stopped = 3 "stopped",
    }
}

/// The layout hash (FNV-1a), at compile time.
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
            /// The same fields as `LatencyHeader`, two of them swapped.
            LatencyHeader / 1 {
                /// .
                first_row: u64,
                /// .
                incarnation: u64,
                /// .
                samples_lost: u64,
            }
        }
    }

    #[test]
    fn reordered_fields_of_equal_size_are_another_layout() {
        assert_eq!(size_of::<LatencyHeader>(), size_of::<reordered::LatencyHeader>());
        assert_ne!(LatencyHeader::LAYOUT, reordered::LatencyHeader::LAYOUT);
    }

    /// As it was when hosts began to tell each other this hash.
    #[test]
    fn the_hash_of_a_layout_is_that_of_other_builds() {
        assert_eq!(
            (Command::LAYOUT, Beacon::LAYOUT),
            (0x5c33_4519_ee2a_5fd8, 0x1189_c96e_91a2_16ce)
        );
    }

    #[test]
    fn a_message_is_its_bytes() {
        let command = Command { tick: 7, v_m_s: -0.25, ..Command::default() };
        let bytes = command.bytes().to_vec();
        assert_eq!(bytes.len(), size_of::<Command>());
        assert_eq!(Command::of_bytes(&bytes), Some(command));
        assert_eq!(Command::of_bytes(&bytes[1..]), None);
        assert_eq!(<()>::of_bytes(&[]), Some(()));
    }
}
