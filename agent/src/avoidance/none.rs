//! Method without avoidance: the robot executes the nominal velocity (gamma) unchanged. (17)

use formation::Vec2;
use formation::front_point::{Heading, twist_for_front_velocity};
use formation::pose::Twist;
use protocol::avoidance::AvoidanceDescription;

use super::steering::Steering;
use super::{Avoidance, AvoidanceRow, Sample};

pub(super) const METHOD: AvoidanceRow = AvoidanceRow {
    description: AvoidanceDescription {
        name: "none",
        source: "(17)",
        ..AvoidanceDescription::NO_AVOIDANCE
    },
    build: |brief, _| {
        let steering = Steering::new(brief);
        let period_s = brief.period_ns as f64 / 1e9;
        Box::new(NoAvoidance { ell: brief.front_point_m, steering, period_s })
    },
};

/// Method that ignores all neighbors.
struct NoAvoidance {
    /// Distance of the front point from the axle (ell), m.
    ell: f64,
    steering: Steering,
    /// Control period (T), s.
    period_s: f64,
}

impl Avoidance for NoAvoidance {
    fn velocity_to_twist(&self, heading_rad: f64, gamma: Vec2) -> Twist {
        match self.steering.drive().turns_freely() {
            true => {
                let heading = Heading::new(heading_rad);
                self.steering.displacement_to_twist(heading, gamma * self.period_s)
            }
            false => twist_for_front_velocity(heading_rad, self.ell, gamma), // (17)
        }
    }

    fn steer(&mut self, sample: &Sample<'_>, gamma: Vec2) -> Twist {
        match self.steering.drive().turns_freely() {
            true => self.steering.steer(sample, gamma, gamma * self.period_s),
            false => self.velocity_to_twist(sample.heading_rad, gamma),
        }
    }

    fn restrict_twist(&mut self, _: &Sample<'_>, requested: Twist, _: Vec2) -> Twist {
        requested
    }
}
