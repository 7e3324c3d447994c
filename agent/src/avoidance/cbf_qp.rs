//! Safety barrier certificates: a quadratic program for each robot. (Wang, Ames, Egerstedt: Safety
//! barrier certificates for collisions-free multirobot systems, 2017; the decentralised form, for
//! single integrators)
//!
//! h = r^2 - d^2 is to fall no faster than h' >= -a h, so that it stays above 0. h' = 2 z . (u_i - u_j),
//! and each robot of a pair sees to half of it: 2 z . u >= -a h / 2. What is nearest to gamma of all that
//! fulfils this for everybody near, and |u| <= v_max, is taken. A wall does not move, so that the robot sees
//! to all of it, with the nearest point of each convex part and the clearance.
//!
//! 0 is always permitted while nobody is too near: the robot stands then at worst. Where somebody is, the
//! program may have no solution; the half-planes give way by the same amount then, the least there is, and
//! those of walls last.
//!
//! Positions suffice. Sampled with the period T it keeps d as long as a T <= 1, where all else is ideal:
//! of two displacements along z, each is at most half of the slack.
//!
//! | symbol | meaning |
//! |---|---|
//! | z, r, n | own - the other, m, its length and direction |
//! | h | r^2 - d^2, m^2 |
//! | a | rate at which h may fall, 1/s (gamma in the paper) |

use formation::Vec2;
use formation::real;
use protocol::avoidance::{AvoidanceDescription, Conditions, Gain};

use super::cone::{ROUNDING_M, direction};
use super::holonomic::{HOLONOMIC, Holonomic, Velocity, sampled_too_slowly};
use super::polygon::HalfPlane;
use super::program::nearest_permitted;
use super::{AvoidanceRow, Sample};

/// Of the rate at which h may fall, a robot sees to half beside another, and to all beside a wall.
const OF_ANOTHER: f64 = 0.5;
const OF_A_WALL: f64 = 1.0;

pub(super) const ROW: AvoidanceRow = AvoidanceRow {
    description: AvoidanceDescription {
        name: "cbf-qp",
        source: "Wang et al. 2017",
        promises: "d, where `barrier_per_s` times the period is at most 1; no way out of deadlocks",
        sensing_radius_m,
        gains: &[Gain::needed(
            "barrier_per_s",
            "rate at which r^2 - d^2 of two robots may fall, in 1/s",
        )],
        // Of more than all of the slack in a period, nothing is left.
        advice: |at| sampled_too_slowly(at, "barrier_per_s", 1.0),
        ..HOLONOMIC
    },
    build: |brief, gains| {
        let cbf_qp = CbfQp {
            d: brief.avoidance.distance_min_m + ROUNDING_M,
            clearance: brief.avoidance.clearance_m + ROUNDING_M,
            v_max: brief.avoidance.speed_max_m_s,
            rate: gains.get("barrier_per_s"),
        };
        Box::new(Holonomic::new(brief, cbf_qp))
    },
};

/// Nobody farther away than where v_max is permitted matters, m.
fn sensing_radius_m(at: &Conditions<'_>) -> f64 {
    let Some(rate) = at.avoidance.gains.get("barrier_per_s") else { return 0.0 };
    // a (r^2 - k^2) share / (2 r) = v_max
    let radius = |distance_min: f64, share: f64| {
        let half = at.speed_m_s() / (rate * share);
        half + real::hypot(half, distance_min)
    };
    let robots = radius(at.avoidance.distance_min_m, OF_ANOTHER);
    let walls = radius(at.avoidance.clearance_m, OF_A_WALL);
    robots.max(walls) + at.distance_error_m()
}

/// One robot's.
struct CbfQp {
    d: f64,
    clearance: f64,
    v_max: f64,
    /// a, 1/s.
    rate: f64,
}

impl Velocity for CbfQp {
    fn velocity(&mut self, sample: &Sample<'_>, gamma: Vec2) -> Option<Vec2> {
        let walls = sample.walls.iter().map(|z| self.side(*z, self.clearance, OF_A_WALL));
        let robots = sample.away.iter().map(|z| self.side(*z, self.d, OF_ANOTHER));
        let sides: Vec<HalfPlane> = walls.chain(robots).collect();
        Some(nearest_permitted(gamma, self.v_max, &sides, sample.walls.len()))
    }
}

impl CbfQp {
    /// 2 z . u >= -share a h, for |z| u.
    fn side(&self, z: Vec2, distance_min: f64, share: f64) -> HalfPlane {
        let r = z.norm();
        let h = r * r - distance_min * distance_min;
        // At the same place any direction leads away, as fast as possible.
        let bound = if r > 0.0 { share * self.rate * h / (2.0 * r) } else { -self.v_max };
        HalfPlane { normal: direction(z), bound }
    }
}

#[cfg(test)]
mod tests;
