//! Method without avoidance: the robot executes the nominal velocity (gamma) unchanged. (17)

use formation::Vec2;
use formation::front_point::twist_for;
use formation::pose::Twist;
use protocol::avoidance::AvoidanceDescription;

use super::{Avoidance, AvoidanceRow, Sample};

pub(super) const ROW: AvoidanceRow = AvoidanceRow {
    description: AvoidanceDescription {
        name: "none",
        source: "(17)",
        ..AvoidanceDescription::INERT
    },
    build: |brief, _| Box::new(NominalOnly { ell: brief.front_point_m }),
};

/// Method that ignores all neighbors.
struct NominalOnly {
    /// Distance of the front point from the axle (ell), m.
    ell: f64,
}

impl Avoidance for NominalOnly {
    fn follow(&self, heading_rad: f64, gamma: Vec2) -> Twist {
        twist_for(heading_rad, self.ell, gamma) // (17)
    }

    fn steer(&mut self, sample: &Sample<'_>, gamma: Vec2) -> Twist {
        self.follow(sample.heading_rad, gamma)
    }

    fn restrain(&mut self, _: &Sample<'_>, wanted: Twist, _: Vec2) -> Twist {
        wanted
    }
}
