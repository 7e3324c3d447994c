//! Adapter for methods that choose a velocity of the front point as if it were the center of a holonomic robot.
//!
//! A front point can move in any direction at once, so such a method needs no wheel model: the exact hold
//! converts its velocity to a twist. At the end of each period the front point is at the displacement of the
//! velocity or, if the arc would exceed v_max, less far in the same direction.
//!
//! These methods assume what their papers assume: exact simultaneous positions (and velocities), no delay, and
//! robots that reach the chosen velocity at once. A truncated proximity sample counts as complete, because it
//! starts with the nearest robot. Without a valid proximity sample the robot stops.

use formation::Vec2;
use formation::front_point::{Heading, front_speed};
use formation::pose::Twist;
use protocol::avoidance::{
    AvoidanceDescription, AvoidanceWarning, DistanceGuarantee, MethodConditions, RequiredSensing,
};
use protocol::brief::AgentBrief;
use protocol::number::{format_distinct, format_short};

use super::steering::Steering;
use super::{Avoidance, Sample, clip};

/// Common part of the descriptions of holonomic methods.
pub const HOLONOMIC_DESCRIPTION: AvoidanceDescription = AvoidanceDescription {
    distance_guarantee: DistanceGuarantee::UnderIdealAssumptions,
    assumptions_text: "every robot uses it, senses positions exactly and moves at once as chosen; no delay, \
              no inertia",
    clamps_speed: true,
    required_sensing: RequiredSensing::Positions,
    avoids_walls: true,
    steering_distance: Some(("d", |conditions| conditions.avoidance.distance_min_m)),
    wall_steering_distance: Some(("the clearance", |conditions| conditions.avoidance.clearance_m)),
    ..AvoidanceDescription::NO_AVOIDANCE
};

/// Returns an advice if the rate `key`, 1/s, times the period exceeds `maximum`. Two robots that both use up their
/// slack would then come closer than d.
pub fn advise_rate(
    conditions: &MethodConditions<'_>,
    key: &'static str,
    maximum: f64,
) -> Option<AvoidanceWarning> {
    let product = *conditions.avoidance.gains.get(key)? * conditions.period_s;
    let [found, limit] = format_distinct(product, maximum);
    (product > maximum).then(|| AvoidanceWarning {
        key,
        message: format!("{key} T = {found}: the sampled method does not keep d at this period"),
        expected_value: format!(
            "expected {key} T to be at most {limit}: at most {} 1/s",
            format_short(maximum / conditions.period_s)
        ),
    })
}

/// A method that chooses a velocity.
pub trait VelocityMethod: Send {
    /// Returns the velocity u, m/s, at most v_max, for `sample` if gamma is requested, or `None` if too little
    /// is known about the neighbors.
    fn choose_velocity(&mut self, sample: &Sample<'_>, gamma: Vec2) -> Option<Vec2>;
}

/// Avoidance that executes the velocity chosen by `method`.
pub struct Holonomic<V> {
    method: V,
    v_max: f64,
    steering: Steering,
    /// Control period (T), s.
    period: f64,
}

impl<V: VelocityMethod> Holonomic<V> {
    /// Creates the adapter for the robot of this brief.
    pub fn new(brief: &AgentBrief, method: V) -> Holonomic<V> {
        Holonomic {
            method,
            v_max: brief.avoidance.speed_max_m_s,
            steering: Steering::new(brief),
            period: brief.period_ns as f64 / 1e9,
        }
    }
}

impl<V: VelocityMethod> Avoidance for Holonomic<V> {
    fn admit_velocity(&self, gamma: Vec2) -> Vec2 {
        clip(gamma, self.v_max)
    }

    fn velocity_to_twist(&self, heading_rad: f64, gamma: Vec2) -> Twist {
        self.steering.displacement_to_twist(Heading::new(heading_rad), gamma * self.period)
    }

    fn steer(&mut self, sample: &Sample<'_>, gamma: Vec2) -> Twist {
        let velocity = match sample.proximity_valid {
            true => self.method.choose_velocity(sample, gamma),
            false => None,
        };
        let Some(u) = velocity else { return Twist::ZERO };
        let drive = self.steering.drive();
        if drive.turns_freely() {
            let requested = self.steering.steer(sample, gamma, u * self.period);
            return drive.clamp(self.v_max, requested);
        }
        let twist_for = |u: Vec2| {
            self.steering.displacement_to_twist(sample.heading_at_effect, u * self.period)
        };
        let speed = front_speed(drive.ell_m, twist_for(u));
        // An arc is longer than its chord. A shorter chord has an arc whose speed is lower by a larger factor.
        let u = if speed > self.v_max { u * (self.v_max / speed) } else { u };
        drive.clamp(self.v_max, twist_for(u))
    }
}

#[cfg(test)]
mod tests {
    use std::f64::consts::FRAC_PI_2;

    use super::super::guard::tests::brief;
    use super::*;
    use formation::front_point::front_point;
    use formation::pose::Pose;
    use formation::unicycle::integrate_arc;
    use proptest::prelude::*;

    /// Returns the requested velocity, regardless of neighbors.
    struct PassThroughMethod;

    impl VelocityMethod for PassThroughMethod {
        fn choose_velocity(&mut self, _: &Sample<'_>, gamma: Vec2) -> Option<Vec2> {
            Some(gamma)
        }
    }

    /// Returns `None`, as a method without the necessary information.
    struct NoVelocityMethod;

    impl VelocityMethod for NoVelocityMethod {
        fn choose_velocity(&mut self, _: &Sample<'_>, _: Vec2) -> Option<Vec2> {
            None
        }
    }

    proptest! {
        /// Parameters: d = 0.2 m, v_max = 0.5 m/s, ell = 0.1 m and T = 10 ms.
        #[test]
        fn front_point_moves_by_the_velocity_within_v_max(
            heading in -3.1..3.1f64, course in -3.1..3.1f64,
            speed in prop_oneof![Just(0.5), 0.0..0.5f64],
        ) {
            let mut robot = Holonomic::new(&brief(), PassThroughMethod);
            let direction = Vec2::new(course.cos(), course.sin());
            let sample = Sample { heading_at_effect: Heading::new(heading), ..Sample::default() };
            let twist = robot.steer(&sample, speed * direction);
            prop_assert!(front_speed(0.1, twist) <= 0.5 + 1e-15);
            let pose = Pose { x_m: 0.3, y_m: -0.7, heading_rad: heading };
            let moved = front_point(integrate_arc(pose, twist, 0.01), 0.1) - front_point(pose, 0.1);
            let (distance, requested) = (moved.dot(&direction), 0.01 * speed);
            prop_assert!((moved - distance * direction).norm() < 1e-12, "{moved:?}");
            prop_assert!(distance < requested + 1e-12 && distance > 0.999 * requested - 1e-12, "{distance}");
            prop_assert!(distance > requested - 1e-12 || speed > 0.499, "{distance}");
        }
    }

    #[test]
    fn holonomic_robot_stops_without_proximity_information() {
        let gamma = Vec2::new(0.3, 0.0);
        let blind = Sample { proximity_valid: false, ..Sample::default() };
        assert_eq!(Holonomic::new(&brief(), PassThroughMethod).steer(&blind, gamma), Twist::ZERO);
        let seeing = Sample::default();
        assert_eq!(Holonomic::new(&brief(), NoVelocityMethod).steer(&seeing, gamma), Twist::ZERO);
        assert!(Holonomic::new(&brief(), PassThroughMethod).steer(&seeing, gamma).v_m_s > 0.29);
    }

    #[test]
    fn gamma_is_clipped_and_heading_of_effect_is_used() {
        let mut robot = Holonomic::new(&brief(), PassThroughMethod);
        assert!((robot.admit_velocity(Vec2::new(3.0, 4.0)) - Vec2::new(0.3, 0.4)).norm() < 1e-15);
        let sample = Sample { heading_at_effect: Heading::new(FRAC_PI_2), ..Sample::default() };
        let twist = robot.steer(&sample, Vec2::new(0.0, 0.2));
        assert!((twist.v_m_s - 0.2).abs() < 1e-12 && twist.w_rad_s.abs() < 1e-9, "{twist:?}");
    }
}
