//! The chapter's avoidance, as published: an unstable focus around everybody nearer than d.
//!
//! Needed to reproduce the chapter and to show where sampling voids its guarantee; nothing is
//! clamped here.

use formation::Vec2;
use formation::front_point::twist_for;
use formation::pose::Twist;
use protocol::avoidance::{Advice, AvoidanceDescription, Conditions, Gain, Promise, Senses};
use protocol::number::short;

use super::{Avoidance, AvoidanceRow, Sample};

/// Above this epsilon T, a sampled focus overshoots (measured on all three cases of the chapter).
const EPSILON_PERIOD_MAX: f64 = 0.1;

pub(super) const ROW: AvoidanceRow = AvoidanceRow {
    description: AvoidanceDescription {
        name: "focus",
        source: "(11) (12) (19)",
        promise: Promise::Ideal,
        promises: "d in continuous time (Propositions 1 and 2)",
        assumes: "exact positions, no delay, no speed limit, no inertia; sampling voids it",
        senses: Senses::Positions,
        sensing_radius_m: |at| at.avoidance.distance_min_m + at.distance_error_m(),
        steers_within: Some(("d", |at| at.avoidance.distance_min_m)),
        gains: &[Gain::needed("epsilon_per_s", "strength of the focus, in 1/s")],
        advice: overshoot,
        ..AvoidanceDescription::INERT
    },
    build: |brief, gains| {
        Box::new(Focus {
            d: brief.avoidance.distance_min_m,
            epsilon: gains.get("epsilon_per_s"),
            ell: brief.front_point_m,
        })
    },
};

/// u = gamma + beta, turned into (v, w) by (17).
struct Focus {
    /// d, m.
    d: f64,
    /// epsilon, 1/s.
    epsilon: f64,
    /// ell, m.
    ell: f64,
}

impl Avoidance for Focus {
    fn follow(&self, heading_rad: f64, u: Vec2) -> Twist {
        twist_for(heading_rad, self.ell, u) // (17)
    }

    fn steer(&mut self, sample: &Sample<'_>, gamma: Vec2) -> Twist {
        if !sample.proximity_valid {
            return Twist::ZERO;
        }
        let u = gamma + self.beta(sample.away); // (19)
        self.follow(sample.heading_rad, u)
    }
}

impl Focus {
    /// beta, m/s: an unstable focus on everybody within d. (11) (12)
    fn beta(&self, away: &[Vec2]) -> Vec2 {
        let near = away.iter().filter(|z| z.norm() <= self.d); // (10) (12)
        let sum: Vec2 = near.map(|z| Vec2::new(z.x - z.y, z.x + z.y)).sum();
        self.epsilon * sum // (11)
    }
}

/// A focus that turns by more than a tenth within one period overshoots.
fn overshoot(at: &Conditions<'_>) -> Option<Advice> {
    let epsilon = *at.avoidance.gains.get("epsilon_per_s")?;
    let product = epsilon * at.period_s;
    (product > EPSILON_PERIOD_MAX).then(|| Advice {
        key: "epsilon_per_s",
        message: format!(
            "epsilon T = {}: a focus sampled this slowly does not keep d",
            short(product)
        ),
        expected: format!(
            "expected a period of at most {} s, or kind = \"guard\"",
            short(EPSILON_PERIOD_MAX / epsilon)
        ),
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_field_spirals_outwards_counter_clockwise_and_ends_at_d() {
        let focus = Focus { d: 0.2, epsilon: 2.0, ell: 0.1 };
        assert_eq!(focus.beta(&[Vec2::new(0.1, 0.0)]), Vec2::new(0.2, 0.2));
        assert_eq!(focus.beta(&[Vec2::new(0.0, 0.1)]), Vec2::new(-0.2, 0.2));
        assert_eq!(focus.beta(&[Vec2::new(0.21, 0.0)]), Vec2::zeros());
    }

    #[test]
    fn it_follows_gamma_and_beta_and_stands_while_it_sees_nothing() {
        let mut focus = Focus { d: 0.2, epsilon: 2.0, ell: 0.1 };
        let (gamma, away) = (Vec2::new(0.1, -0.3), [Vec2::new(0.1, 0.0)]);
        let sample = Sample { heading_rad: 0.7, away: &away, ..Sample::default() };
        let beside = gamma + Vec2::new(0.2, 0.2);
        assert_eq!(focus.steer(&sample, gamma), twist_for(0.7, 0.1, beside));
        assert_eq!(focus.follow(0.7, gamma), twist_for(0.7, 0.1, gamma));
        let blind = Sample { proximity_valid: false, ..sample };
        assert_eq!(focus.steer(&blind, gamma), Twist::ZERO);
    }

    #[test]
    fn it_needs_to_see_d_and_what_sensors_err_by_and_a_period_short_for_epsilon() {
        let mut brief = crate::testing::brief();
        brief.avoidance.sensing_error_m = 0.01;
        brief.avoidance.gains = [("epsilon_per_s".into(), 10.0)].into();
        let at = |period_s: f64| Conditions { period_s, ..Conditions::of(&brief) };
        assert!(((ROW.description.sensing_radius_m)(&at(0.01)) - 0.21).abs() < 1e-12);
        assert_eq!((overshoot(&at(0.009)), overshoot(&at(0.01))), (None, None));
        let advice = overshoot(&at(0.02)).unwrap();
        assert!(advice.message.starts_with("epsilon T = 0.2: "), "{}", advice.message);
        assert!(advice.expected.contains("at most 0.01 s"), "{}", advice.expected);
    }
}
