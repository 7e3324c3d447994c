//! What a law sees of the world: plain values, all of one odometry sample.

use formation::Vec2;
use formation::desired::Target;
use formation::pose::{Pose, Twist};
use protocol::message::Contact;

/// One instant as a law sees it. Positions and velocities are in `map`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Situation<'a> {
    /// e = alpha - alpha*, m; alpha* is where the robot's role wants it. (13) (32)
    pub error: Vec2,
    /// alpha*', m/s.
    pub desired_velocity: Vec2,
    /// T, s.
    pub period_s: f64,
    /// a: how many periods old a neighbour's sample may normally be.
    pub age_periods: f64,
    /// Time since the run's start, s.
    pub t_s: f64,
    /// Own pose: the axle's mid-point.
    pub pose: Pose,
    /// Own front point alpha, m.
    pub front_point: Vec2,
    /// Own twist in force at the sample.
    pub twist: Twist,
    /// Own front point - that of each robot sensed near, m, nearest first.
    pub away: &'a [Vec2],
    /// Whoever was heard at least once, in the brief's order; the lost are among them.
    pub heard: &'a [Heard],
}

impl Situation<'static> {
    /// At the origin and at t = 0, with nobody heard: the rest of a `Situation` that a test of a law
    /// fills in what it is about.
    pub const ALONE: Situation<'static> = Situation {
        error: Vec2::new(0.0, 0.0),
        desired_velocity: Vec2::new(0.0, 0.0),
        period_s: 0.005,
        age_periods: 1.0,
        t_s: 0.0,
        pose: Pose { x_m: 0.0, y_m: 0.0, heading_rad: 0.0 },
        front_point: Vec2::new(0.0, 0.0),
        twist: Twist::ZERO,
        away: &[],
        heard: &[],
    };
}

/// What is known of one robot that was heard.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Heard {
    /// Its place in the scenario, from 1.
    pub index: usize,
    /// alpha_j, m: extrapolated to the sample's stamp by the velocity below; of a lost robot, to the
    /// moment at which it was given up.
    pub position: Vec2,
    /// Its published velocity, m/s; 0 once it is lost.
    pub velocity: Vec2,
    /// C_ji, m, and its rate, m/s: where to stand as seen from it, turned and scaled as the
    /// formation is now; zero where the role knows no offsets. (20) (22)
    pub offset: Target,
    /// How old its newest beacon is, s; in real time below 0 for one that is newer than the sample.
    pub age_s: f64,
    /// How well it is heard: `Fresh`, `Stale` or `Lost`.
    pub contact: Contact,
}
