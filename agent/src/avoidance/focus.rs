//! The chapter's avoidance as published: an unstable focus around every robot closer than d.
//!
//! Needed to reproduce the chapter and to show how sampling voids its guarantee. Speeds are not clamped.

use formation::Vec2;
use formation::front_point::twist_for_front_velocity;
use formation::pose::Twist;
use protocol::avoidance::{
    AvoidanceDescription, AvoidanceWarning, DistanceGuarantee, Gain, MethodConditions,
    RequiredSensing,
};
use protocol::number::format_short;

use super::{Avoidance, AvoidanceRow, Sample};

/// Maximum of epsilon T without advice. Above it a sampled focus overshoots (measured on all three cases of the
/// chapter).
const EPSILON_TIMES_PERIOD_MAX: f64 = 0.1;

pub(super) const METHOD: AvoidanceRow = AvoidanceRow {
    description: AvoidanceDescription {
        name: "focus",
        source: "(11) (12) (19)",
        distance_guarantee: DistanceGuarantee::UnderIdealAssumptions,
        guarantee_text: "d in continuous time (Propositions 1 and 2)",
        assumptions_text: "exact positions, no delay, no speed limit, no inertia; sampling voids it",
        required_sensing: RequiredSensing::Positions,
        needs_front_point: true,
        sensing_radius_m: |conditions| {
            conditions.avoidance.distance_min_m + conditions.distance_error_max_m()
        },
        steering_distance: Some(("d", |conditions| conditions.avoidance.distance_min_m)),
        gains: &[Gain::new(
            "epsilon_per_s",
            "epsilon, gain of the repulsion between robots closer than d, \
                                                  in 1/s; a larger gain repels more strongly",
        )],
        find_warning: advise_period,
        ..AvoidanceDescription::NO_AVOIDANCE
    },
    build: |brief, gains| {
        Box::new(Focus {
            distance_min: brief.avoidance.distance_min_m,
            epsilon: gains.get("epsilon_per_s"),
            ell: brief.front_point_m,
        })
    },
};

/// The chapter's method: u = gamma + beta, converted to (v, w) by (17).
struct Focus {
    /// Minimum distance (d), m.
    distance_min: f64,
    /// Strength of the focus (epsilon), 1/s.
    epsilon: f64,
    /// Distance of the front point from the axle (ell), m.
    ell: f64,
}

impl Avoidance for Focus {
    fn velocity_to_twist(&self, heading_rad: f64, u: Vec2) -> Twist {
        twist_for_front_velocity(heading_rad, self.ell, u) // (17)
    }

    fn steer(&mut self, sample: &Sample<'_>, gamma: Vec2) -> Twist {
        if !sample.proximity_valid {
            return Twist::ZERO;
        }
        let u = gamma + self.avoidance_velocity(sample.neighbor_vectors); // (19)
        self.velocity_to_twist(sample.heading_rad, u)
    }
}

impl Focus {
    /// Returns the avoidance velocity (beta), m/s: an unstable focus on every robot within d. (11) (12)
    fn avoidance_velocity(&self, neighbor_vectors: &[Vec2]) -> Vec2 {
        let in_range = neighbor_vectors.iter().filter(|z| z.norm() <= self.distance_min); // (10) (12)
        let sum: Vec2 = in_range.map(|z| Vec2::new(z.x - z.y, z.x + z.y)).sum();
        self.epsilon * sum // (11)
    }
}

/// Returns an advice if the focus turns by more than a tenth within one period and overshoots.
fn advise_period(conditions: &MethodConditions<'_>) -> Option<AvoidanceWarning> {
    let epsilon = *conditions.avoidance.gains.get("epsilon_per_s")?;
    let product = epsilon * conditions.period_s;
    (product > EPSILON_TIMES_PERIOD_MAX).then(|| AvoidanceWarning {
        key: "epsilon_per_s",
        message: format!(
            "epsilon T = {}: the sampled focus does not keep d at this period",
            format_short(product)
        ),
        expected_value: format!(
            "expected a period of at most {} s, or kind = \"guard\"",
            format_short(EPSILON_TIMES_PERIOD_MAX / epsilon)
        ),
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn focus_field_spirals_outward_and_ends_at_d() {
        let focus = Focus { distance_min: 0.2, epsilon: 2.0, ell: 0.1 };
        assert_eq!(focus.avoidance_velocity(&[Vec2::new(0.1, 0.0)]), Vec2::new(0.2, 0.2));
        assert_eq!(focus.avoidance_velocity(&[Vec2::new(0.0, 0.1)]), Vec2::new(-0.2, 0.2));
        assert_eq!(focus.avoidance_velocity(&[Vec2::new(0.21, 0.0)]), Vec2::zeros());
    }

    #[test]
    fn focus_adds_beta_and_stops_without_proximity() {
        let mut focus = Focus { distance_min: 0.2, epsilon: 2.0, ell: 0.1 };
        let (gamma, neighbor_vectors) = (Vec2::new(0.1, -0.3), [Vec2::new(0.1, 0.0)]);
        let sample =
            Sample { heading_rad: 0.7, neighbor_vectors: &neighbor_vectors, ..Sample::default() };
        let velocity = gamma + Vec2::new(0.2, 0.2);
        assert_eq!(focus.steer(&sample, gamma), twist_for_front_velocity(0.7, 0.1, velocity));
        assert_eq!(focus.velocity_to_twist(0.7, gamma), twist_for_front_velocity(0.7, 0.1, gamma));
        let blind = Sample { proximity_valid: false, ..sample };
        assert_eq!(focus.steer(&blind, gamma), Twist::ZERO);
    }

    #[test]
    fn focus_requires_radius_d_and_advises_a_short_period() {
        let mut brief = crate::testing::brief();
        brief.avoidance.sensing_error_m = 0.01;
        brief.avoidance.gains = [("epsilon_per_s".into(), 10.0)].into();
        let conditions_with =
            |period_s: f64| MethodConditions { period_s, ..MethodConditions::for_robot(&brief) };
        assert!(
            ((METHOD.description.sensing_radius_m)(&conditions_with(0.01)) - 0.21).abs() < 1e-12
        );
        assert_eq!(
            (advise_period(&conditions_with(0.009)), advise_period(&conditions_with(0.01))),
            (None, None)
        );
        let advice = advise_period(&conditions_with(0.02)).unwrap();
        assert!(advice.message.starts_with("epsilon T = 0.2: "), "{}", advice.message);
        assert!(advice.expected_value.contains("at most 0.01 s"), "{}", advice.expected_value);
    }
}
