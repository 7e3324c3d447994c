//! An example method that brakes: scales gamma down before each collision predicted within a horizon tau.

use formation::Vec2;
use formation::front_point::twist_for_front_velocity;
use formation::pose::Twist;
use protocol::avoidance::{AvoidanceDescription, Gain, RequiredSensing};

use super::{Avoidance, AvoidanceRow, Sample};

pub(super) const METHOD: AvoidanceRow = AvoidanceRow {
    description: AvoidanceDescription {
        name: "brake",
        source: "an example",
        clamps_speed: true,
        required_sensing: RequiredSensing::PositionsAndVelocities,
        sensing_radius_m: |at| {
            let tau = at.avoidance.gains["horizon_s"];
            at.avoidance.distance_min_m + 2.0 * at.speed_max_m_s() * tau
        },
        gains: &[Gain::new("horizon_s", "tau, look-ahead time, in seconds")],
        ..AvoidanceDescription::NO_AVOIDANCE
    },
    build: |brief, gains| {
        Box::new(Brake {
            d: brief.avoidance.distance_min_m,
            v_max: brief.avoidance.speed_max_m_s,
            ell: brief.front_point_m,
            tau: gains.get("horizon_s"),
        })
    },
};

struct Brake {
    d: f64,
    v_max: f64,
    ell: f64,
    tau: f64,
}

impl Avoidance for Brake {
    fn admit_velocity(&self, gamma: Vec2) -> Vec2 {
        gamma.cap_magnitude(self.v_max)
    }

    fn velocity_to_twist(&self, heading_rad: f64, gamma: Vec2) -> Twist {
        twist_for_front_velocity(heading_rad, self.ell, gamma)
    }

    fn steer(&mut self, sample: &Sample<'_>, gamma: Vec2) -> Twist {
        let Some(near) = sample.neighbor_motions() else { return Twist::ZERO };
        let fraction = near.fold(1.0f64, |fraction, (z, v_j)| {
            let closing = (v_j - gamma).dot(&z) / z.norm(); // -r', m/s
            let slack = (z.norm() - self.d).max(0.0);
            if closing > 0.0 { fraction.min(slack / (closing * self.tau)) } else { fraction }
        });
        self.velocity_to_twist(sample.heading_rad, fraction * gamma)
    }
}
