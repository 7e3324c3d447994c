//! Collision avoidance: from the nominal velocity (gamma) to a twist (v, w).
//!
//! This module does no I/O and reads no clock. A method is one file and one row of [`METHODS`].
//!
//! | file | question it answers |
//! |---|---|
//! | `none` | what does the control law do without avoidance? (17) |
//! | `focus` | what does the chapter's method do? (11) (12) (19) |
//! | `guard` | what keeps d despite late samples, dying robots and braking times? |
//! | `braking` | how does inertia change the figures of the guard? |
//! | `deflection` | how does a robot steer around others? |
//! | `neighbor_tracker` | how do neighbors in range move? |
//! | `progress_monitor` | does the robot make progress, and when does it give up for a while? |
//! | `vicinity` | which neighbors and walls are in range, how fast may they approach, and at which minimum distance? |
//! | `cone` | in which directions may another robot be while a command is in effect? |
//! | `hold` | which constant (v, w) moves the front point by a given displacement? |
//! | `steering` | which (v, w) moves the controlled point, front point or axle midpoint, by a given displacement? |
//! | `car_steering` | in which gear does a car drive, and when does it shuttle? |
//! | `polygon` | what is the nearest velocity that satisfies all bounds? |
//!
//! Published methods, for comparison:
//!
//! | file | question it answers |
//! |---|---|
//! | `orca` | what does optimal reciprocal collision avoidance do? |
//! | `cbf_qp` | what do safety barrier certificates do? |
//! | `rbl` | what does the rule-based Lloyd algorithm do? |
//! | `holonomic` | how does a robot with wheels follow a velocity chosen for a point? |
//! | `program` | what is the best velocity, violating some bounds if necessary? |

mod braking;
mod car_steering;
mod cbf_qp;
mod cone;
mod deflection;
mod focus;
mod guard;
mod hold;
mod holonomic;
#[cfg(test)]
mod ideal_simulation;
mod neighbor_tracker;
mod none;
mod orca;
mod polygon;
mod program;
mod progress_monitor;
mod rbl;
mod steering;
mod vicinity;

use formation::Vec2;
use formation::front_point::Heading;
use formation::pose::Twist;
use protocol::avoidance::{AvoidanceDescription, MethodConditions};
use protocol::brief::{AgentBrief, AvoidanceBrief};
use protocol::number::format_distinct;

pub use deflection::{
    approach_slack_fraction, deflection_distance_m, wall_approach_slack_fraction,
    wall_deflection_distance_m,
};
pub use hold::exact_hold;

use crate::UnfitBrief;
pub use crate::gains::Gains;

/// Input of an avoidance method, derived from one odometry sample.
#[derive(Debug, Clone, Copy)]
pub struct Sample<'a> {
    /// Stamp of the sample, ns.
    pub stamp_ns: u64,
    /// Time since the start of the run, s.
    pub t_s: f64,
    /// Heading at the stamp, rad.
    pub heading_rad: f64,
    /// Expected heading when the answer takes effect.
    pub heading_at_effect: Heading,
    /// Twist in force at the stamp.
    pub twist: Twist,
    /// Position of the own front point, m, in `map`.
    pub front_point: Vec2,
    /// Velocity of the own front point at the stamp, m/s, in `map`.
    pub front_velocity: Vec2,
    /// Vectors z_j = own front point - other front point, m, in `map`, nearest first.
    pub neighbor_vectors: &'a [Vec2],
    /// Classes of these robots, in the order of `neighbor_vectors`: indices into the classes of the brief. Ignored if
    /// the brief has none.
    pub neighbor_classes: &'a [u8],
    /// `true` if the proximity sensor works. Otherwise nothing is known about neighbors in range.
    pub proximity_valid: bool,
    /// `true` if the list of neighbors in range is truncated.
    pub neighbors_truncated: bool,
    /// Velocities of the other front points, m/s, in `map`, in the order of `neighbor_vectors`. Empty unless the method
    /// requests [`RequiredSensing::PositionsAndVelocities`].
    ///
    /// [`RequiredSensing::PositionsAndVelocities`]: protocol::avoidance::RequiredSensing::PositionsAndVelocities
    pub neighbor_velocities: &'a [Vec2],
    /// Own front point - nearest point of each convex part of a wall or obstacle, m, in `map`, nearest first.
    /// Measured by the proximity sensor.
    pub wall_vectors: &'a [Vec2],
    /// `true` if the list of walls is truncated.
    pub walls_truncated: bool,
    /// Own front point - desired position, m, in `map`, or `None` without a desired position.
    pub error: Option<Vec2>,
    /// Velocity of the desired position, m/s, in `map`.
    pub slot_velocity: Vec2,
}

impl Sample<'_> {
    /// Returns z, m, and velocity, m/s, of every neighbor in range, or `None` if they are unknown. A method
    /// that needs them then stops the robot.
    pub fn neighbor_motions(&self) -> Option<impl Iterator<Item = (Vec2, Vec2)>> {
        let known =
            self.proximity_valid && self.neighbor_velocities.len() == self.neighbor_vectors.len();
        known.then(|| {
            self.neighbor_vectors.iter().copied().zip(self.neighbor_velocities.iter().copied())
        })
    }
}

/// A collision avoidance method of one robot.
pub trait Avoidance: Send {
    /// Returns the part of gamma, m/s, that may be used and published.
    fn admit_velocity(&self, gamma: Vec2) -> Vec2 {
        gamma
    }

    /// Returns the error e = alpha - alpha*, m, that the control law shall use. It differs from `error` if
    /// another robot occupies alpha*. Velocities, walls and the error itself are not set in `sample` yet.
    fn standoff_error(&mut self, sample: &Sample<'_>, error: Vec2) -> Vec2 {
        let _ = sample;
        error
    }

    /// Returns the twist that follows the admitted gamma from `heading_rad` if no neighbor is in range.
    fn velocity_to_twist(&self, heading_rad: f64, gamma: Vec2) -> Twist;

    /// Returns the twist that answers `sample`, given the admitted gamma.
    fn steer(&mut self, sample: &Sample<'_>, gamma: Vec2) -> Twist;

    /// Returns the twist that answers `sample` if a controller requests the twist `requested`, which gives the
    /// front point the admitted velocity gamma. The default implementation uses gamma only, for methods that
    /// choose velocities.
    fn restrict_twist(&mut self, sample: &Sample<'_>, requested: Twist, gamma: Vec2) -> Twist {
        let _ = requested;
        self.steer(sample, gamma)
    }
}

/// One row of [`METHODS`].
pub struct AvoidanceRow {
    /// Name, source, keys and figures, as published to the supervisor.
    pub description: AvoidanceDescription,
    /// Creates the method from a brief and its gains, which are all present and positive.
    pub build: fn(&AgentBrief, &Gains<'_>) -> Box<dyn Avoidance>,
}

impl AvoidanceRow {
    /// Creates the method for the robot of this brief.
    ///
    /// Returns an error if a gain is missing, unknown or not positive, if a required speed limit is missing, or
    /// if the sensing radius is too small for the method.
    pub fn make(&self, brief: &AgentBrief) -> Result<Box<dyn Avoidance>, UnfitBrief> {
        let of = format!("avoidance {:?}", self.description.name);
        let keys = self.description.gains.iter().map(|gain| gain.key);
        let gains = Gains::check(&brief.avoidance.gains, &of, keys)?;
        if self.description.needs_front_point && brief.front_point_m == 0.0 {
            return Err(UnfitBrief(format!(
                "{of} needs a front point, got front_point_m = 0: it requests velocities in any direction"
            )));
        }
        let AvoidanceBrief { speed_max_m_s, sensing_radius_m, .. } = brief.avoidance;
        if self.description.clamps_speed && !speed_max_m_s.is_finite() {
            let got = format!("got avoidance.speed_max_m_s = {speed_max_m_s}");
            return Err(UnfitBrief(format!("{of} needs a speed limit, {got}")));
        }
        let needed_m = (self.description.sensing_radius_m)(&MethodConditions::for_robot(brief));
        // A comparison with NaN is false.
        if sensing_radius_m.is_nan() || sensing_radius_m < needed_m {
            let [found, needed] = format_distinct(sensing_radius_m, needed_m);
            let radius =
                format!("avoidance.sensing_radius_m = {found}, expected {needed} m or more");
            return Err(UnfitBrief(format!("{of} sees too late with {radius}")));
        }
        Ok((self.build)(brief, &gains))
    }
}

/// All methods. The first is the default.
pub const METHODS: &[AvoidanceRow] =
    &[guard::METHOD, focus::METHOD, none::METHOD, orca::METHOD, cbf_qp::METHOD, rbl::METHOD];

/// Creates the method named in the brief. Returns an error if the name is unknown or the brief does not suit
/// the method.
pub fn build(brief: &AgentBrief) -> Result<Box<dyn Avoidance>, UnfitBrief> {
    let name = &brief.avoidance.kind;
    let row = METHODS.iter().find(|row| row.description.name == name).ok_or_else(|| {
        let known: Vec<_> = METHODS.iter().map(|row| row.description.name).collect();
        UnfitBrief(format!("unknown avoidance {name:?}, expected one of {}", known.join(", ")))
    })?;
    row.make(brief)
}

/// Returns `vector`, shortened to `length_max` if it is longer.
#[inline]
fn clip(vector: Vec2, length_max: f64) -> Vec2 {
    match vector.norm_squared() > length_max * length_max {
        true => shorten_to(vector, length_max),
        false => vector,
    }
}

/// Shortens a vector to a length. Not inlined, because it is rarely needed and roots and quotients are slow.
#[cold]
fn shorten_to(vector: Vec2, length: f64) -> Vec2 {
    vector * (length / vector.norm())
}

#[cfg(test)]
mod tests {
    use super::*;

    impl Default for Sample<'_> {
        /// Returns a sample at the start, with a working sensor and no neighbor in range.
        fn default() -> Self {
            Sample {
                stamp_ns: 0,
                t_s: 0.0,
                heading_rad: 0.0,
                heading_at_effect: Heading::ZERO,
                twist: Twist::ZERO,
                front_point: Vec2::zeros(),
                front_velocity: Vec2::zeros(),
                neighbor_vectors: &[],
                neighbor_classes: &[],
                proximity_valid: true,
                neighbors_truncated: false,
                neighbor_velocities: &[],
                wall_vectors: &[],
                walls_truncated: false,
                error: None,
                slot_velocity: Vec2::zeros(),
            }
        }
    }

    #[test]
    fn neighbor_velocities_require_a_valid_sensor() {
        let (neighbor_vectors, velocities) = ([Vec2::new(0.1, 0.0)], [Vec2::new(0.0, 0.3)]);
        let sample = Sample {
            neighbor_vectors: &neighbor_vectors,
            neighbor_velocities: &velocities,
            ..Sample::default()
        };
        let known = |sample: Sample<'_>| sample.neighbor_motions().map(Iterator::collect::<Vec<_>>);
        assert_eq!(known(sample), Some(vec![(neighbor_vectors[0], velocities[0])]));
        assert_eq!(known(Sample { neighbor_velocities: &[], ..sample }), None);
        assert_eq!(known(Sample { proximity_valid: false, ..sample }), None);
    }
}
