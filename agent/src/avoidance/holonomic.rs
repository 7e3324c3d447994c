//! Methods that choose a velocity of the front point, as if it were the centre of a holonomic robot.
//!
//! A front point can move anywhere at once, so that such a method need not know of wheels: the exact
//! hold makes a twist of what it chooses. At the end of each period the front point is where the
//! velocity leads, or, where the arc there would be too fast, less far in the same direction.
//!
//! They assume what their papers do: exact positions (and velocities) of one instant, no delay, and
//! robots that move as they choose at once. A list of the near that is cut counts as all there are: it
//! begins with the nearest. A robot that senses nothing stands.

use formation::Vec2;
use formation::front_point::front_speed;
use formation::pose::Twist;
use protocol::avoidance::{Advice, AvoidanceDescription, Conditions, Promise, Senses};
use protocol::brief::AgentBrief;
use protocol::number::{short, told_apart};

use super::{Avoidance, Sample, clip, exact_hold, within_speed};

/// What such methods have in common.
pub const HOLONOMIC: AvoidanceDescription = AvoidanceDescription {
    promise: Promise::Ideal,
    assumes: "everybody uses it, senses positions exactly, and moves at once as it chooses; no delay, \
              no inertia",
    clamps_speed: true,
    senses: Senses::Positions,
    minds_walls: true,
    steers_within: Some(("d", |at| at.avoidance.distance_min_m)),
    steers_beside_walls: Some(("the clearance", |at| at.avoidance.clearance_m)),
    ..AvoidanceDescription::INERT
};

/// A rate, 1/s, that must not be more than `most` in a period: else two that use up their slack meet.
pub fn sampled_too_slowly(at: &Conditions<'_>, key: &'static str, most: f64) -> Option<Advice> {
    let product = *at.avoidance.gains.get(key)? * at.period_s;
    let [found, limit] = told_apart(product, most);
    (product > most).then(|| Advice {
        key,
        message: format!("{key} T = {found}: sampled this slowly it does not keep d"),
        expected: format!("expected at most {limit}: {} 1/s", short(most / at.period_s)),
    })
}

/// What a method chooses.
pub trait Velocity: Send {
    /// u, m/s, no longer than v_max, that answers `sample` when gamma is wanted; `None`: not enough is
    /// known about who is near.
    fn velocity(&mut self, sample: &Sample<'_>, gamma: Vec2) -> Option<Vec2>;
}

/// The robot that does what `method` chooses.
pub struct Holonomic<V> {
    method: V,
    v_max: f64,
    ell: f64,
    /// T, s.
    period: f64,
}

impl<V: Velocity> Holonomic<V> {
    /// The robot of this brief.
    pub fn new(brief: &AgentBrief, method: V) -> Holonomic<V> {
        Holonomic {
            method,
            v_max: brief.avoidance.speed_max_m_s,
            ell: brief.front_point_m,
            period: brief.period_ns as f64 / 1e9,
        }
    }
}

impl<V: Velocity> Avoidance for Holonomic<V> {
    fn admit(&self, gamma: Vec2) -> Vec2 {
        clip(gamma, self.v_max)
    }

    fn follow(&self, heading_rad: f64, gamma: Vec2) -> Twist {
        exact_hold(heading_rad, self.ell, gamma * self.period, self.period)
    }

    fn steer(&mut self, sample: &Sample<'_>, gamma: Vec2) -> Twist {
        let velocity = match sample.proximity_valid {
            true => self.method.velocity(sample, gamma),
            false => None,
        };
        let Some(u) = velocity else { return Twist::ZERO };
        let heading = sample.heading_effect_rad;
        let speed = front_speed(self.ell, self.follow(heading, u));
        // An arc is longer than its chord; a shorter chord has an arc that is slower by more than that.
        let u = if speed > self.v_max { u * (self.v_max / speed) } else { u };
        within_speed(self.v_max, self.ell, self.follow(heading, u))
    }
}

#[cfg(test)]
mod tests {
    use std::f64::consts::FRAC_PI_2;

    use super::super::guard::tests::brief;
    use super::*;
    use formation::front_point::front_point;
    use formation::pose::Pose;
    use formation::unicycle::arc;
    use proptest::prelude::*;

    /// Does what is wanted, whoever is near.
    struct Willing;

    impl Velocity for Willing {
        fn velocity(&mut self, _: &Sample<'_>, gamma: Vec2) -> Option<Vec2> {
            Some(gamma)
        }
    }

    /// Knows nothing.
    struct Lost;

    impl Velocity for Lost {
        fn velocity(&mut self, _: &Sample<'_>, _: Vec2) -> Option<Vec2> {
            None
        }
    }

    proptest! {
        /// d = 0.2 m, v_max = 0.5 m/s, ell = 0.1 m, T = 10 ms.
        #[test]
        fn the_front_point_goes_where_the_velocity_leads_and_no_faster_than_v_max(
            heading in -3.1..3.1f64, course in -3.1..3.1f64,
            speed in prop_oneof![Just(0.5), 0.0..0.5f64],
        ) {
            let mut robot = Holonomic::new(&brief(), Willing);
            let direction = Vec2::new(course.cos(), course.sin());
            let sample = Sample { heading_effect_rad: heading, ..Sample::default() };
            let twist = robot.steer(&sample, speed * direction);
            prop_assert!(front_speed(0.1, twist) <= 0.5 + 1e-15);
            let pose = Pose { x_m: 0.3, y_m: -0.7, heading_rad: heading };
            let moved = front_point(arc(pose, twist, 0.01), 0.1) - front_point(pose, 0.1);
            let (far, wanted) = (moved.dot(&direction), 0.01 * speed);
            prop_assert!((moved - far * direction).norm() < 1e-12, "{moved:?}");
            prop_assert!(far < wanted + 1e-12 && far > 0.999 * wanted - 1e-12, "{far}");
            prop_assert!(far > wanted - 1e-12 || speed > 0.499, "{far}");
        }
    }

    #[test]
    fn who_does_not_know_who_is_near_stands() {
        let gamma = Vec2::new(0.3, 0.0);
        let blind = Sample { proximity_valid: false, ..Sample::default() };
        assert_eq!(Holonomic::new(&brief(), Willing).steer(&blind, gamma), Twist::ZERO);
        let seeing = Sample::default();
        assert_eq!(Holonomic::new(&brief(), Lost).steer(&seeing, gamma), Twist::ZERO);
        assert!(Holonomic::new(&brief(), Willing).steer(&seeing, gamma).v_m_s > 0.29);
    }

    #[test]
    fn gamma_is_limited_before_it_is_published_and_the_heading_of_effect_counts() {
        let mut robot = Holonomic::new(&brief(), Willing);
        assert!((robot.admit(Vec2::new(3.0, 4.0)) - Vec2::new(0.3, 0.4)).norm() < 1e-15);
        let sample = Sample { heading_effect_rad: FRAC_PI_2, ..Sample::default() };
        let twist = robot.steer(&sample, Vec2::new(0.0, 0.2));
        assert!((twist.v_m_s - 0.2).abs() < 1e-12 && twist.w_rad_s.abs() < 1e-9, "{twist:?}");
    }
}
