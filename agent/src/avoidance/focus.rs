//! The chapter's avoidance, literally: an unstable focus around everybody nearer than d.
//!
//! Needed to reproduce the chapter and to show where sampling breaks it; nothing is clamped here.

use formation::Vec2;
use formation::front_point::twist_for;
use formation::pose::Twist;
use protocol::brief::AgentBrief;

use super::Sample;

/// u = gamma + beta, turned into (v, w) by (17).
pub struct Focus {
    /// d, m.
    distance_min_m: f64,
    /// epsilon, 1/s.
    epsilon_per_s: f64,
    /// ell, m.
    front_point_m: f64,
}

impl Focus {
    pub(super) fn new(brief: &AgentBrief) -> Focus {
        Focus {
            distance_min_m: brief.avoidance.distance_min_m,
            epsilon_per_s: brief.avoidance.epsilon_per_s,
            front_point_m: brief.front_point_m,
        }
    }

    pub(super) fn follow(&self, heading_rad: f64, u: Vec2) -> Twist {
        twist_for(heading_rad, self.front_point_m, u) // (17)
    }

    pub(super) fn steer(&self, sample: &Sample<'_>, gamma: Vec2) -> Twist {
        if !sample.proximity_valid {
            return Twist::ZERO;
        }
        let u = gamma + self.beta(sample.away); // (19)
        self.follow(sample.heading_rad, u)
    }

    /// beta, m/s: an unstable focus on everybody within d. (11) (12)
    fn beta(&self, away: &[Vec2]) -> Vec2 {
        let near = away.iter().filter(|z| z.norm() <= self.distance_min_m); // (10) (12)
        let sum: Vec2 = near.map(|z| Vec2::new(z.x - z.y, z.x + z.y)).sum();
        self.epsilon_per_s * sum // (11)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_field_spirals_outwards_counter_clockwise_and_ends_at_d() {
        let focus = Focus { distance_min_m: 0.2, epsilon_per_s: 2.0, front_point_m: 0.1 };
        assert_eq!(focus.beta(&[Vec2::new(0.1, 0.0)]), Vec2::new(0.2, 0.2));
        assert_eq!(focus.beta(&[Vec2::new(0.0, 0.1)]), Vec2::new(-0.2, 0.2));
        assert_eq!(focus.beta(&[Vec2::new(0.21, 0.0)]), Vec2::zeros());
    }
}
