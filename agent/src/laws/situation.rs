//! Input of a control law: plain values from one odometry sample.

use formation::Vec2;
use formation::desired::Target;
use formation::pose::{Pose, Twist};
use protocol::law_message::ReceivedMessage;
use protocol::message::ReceptionState;

/// State of the robot and its neighbors at one instant. Positions and velocities are in `map`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Situation<'a> {
    /// Error e = alpha - alpha*, m, where alpha* is the desired position of the robot's role. (13) (32)
    pub error: Vec2,
    /// Desired velocity (alpha*'), m/s.
    pub desired_velocity: Vec2,
    /// Control period (T), s.
    pub period_s: f64,
    /// Maximum regular age of a neighbor's sample (a), in periods.
    pub age_periods: f64,
    /// Time since the start of the run, s.
    pub t_s: f64,
    /// Own pose, of the axle midpoint.
    pub pose: Pose,
    /// Own front point (alpha), m.
    pub front_point: Vec2,
    /// Own twist in force at the sample.
    pub twist: Twist,
    /// Own front point - front point of each neighbor in range, m, nearest first.
    pub neighbor_vectors: &'a [Vec2],
    /// Whether the proximity sensor works; otherwise `neighbor_vectors` is empty.
    pub proximity_valid: bool,
    /// Whether more robots were in range than `neighbor_vectors` contains, which are the nearest ones.
    pub neighbors_truncated: bool,
    /// The in-neighbors received at least once, in the order of the brief, including the lost ones.
    pub neighbor_estimates: &'a [NeighborEstimate],
}

impl Situation<'static> {
    /// Situation at the origin and at t = 0, without neighbors. Tests of control laws override the fields they
    /// are about.
    pub const WITHOUT_NEIGHBORS: Situation<'static> = Situation {
        error: Vec2::new(0.0, 0.0),
        desired_velocity: Vec2::new(0.0, 0.0),
        period_s: 0.005,
        age_periods: 1.0,
        t_s: 0.0,
        pose: Pose { x_m: 0.0, y_m: 0.0, heading_rad: 0.0 },
        front_point: Vec2::new(0.0, 0.0),
        twist: Twist::ZERO,
        neighbor_vectors: &[],
        proximity_valid: true,
        neighbors_truncated: false,
        neighbor_estimates: &[],
    };
}

/// Estimate of one received robot.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct NeighborEstimate {
    /// Index in the scenario, from 1.
    pub index: usize,
    /// Estimated front point (alpha_j), m: extrapolated to the stamp of the sample with the velocity below, for
    /// a lost robot only to the time at which it was declared lost.
    pub position: Vec2,
    /// Published velocity, m/s, and 0 once the robot is lost.
    pub velocity: Vec2,
    /// Desired relative position (C_ji), m, and its rate, m/s, rotated and scaled with the formation. Zero for
    /// roles without offsets. (20) (22)
    pub offset: Target,
    /// Age of the newest beacon, s. In real time it is negative for a beacon newer than the sample.
    pub age_s: f64,
    /// Communication state: `Fresh`, `Stale` or `Lost`.
    pub reception_state: ReceptionState,
    /// Incarnation of the sender of that beacon: the number of earlier starts of the robot's process. It increases
    /// when the neighbor restarts.
    pub incarnation: u64,
    /// Newest message of this incarnation of the neighbor's law; `None` if none was received.
    pub message: Option<ReceivedMessage>,
    /// Messages that arrived since the last call of the law, oldest first: at most `message_queue` of the law, of which
    /// the default is 0.
    pub queued_messages: Vec<ReceivedMessage>,
}
