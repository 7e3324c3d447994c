//! Safety barrier certificates: a control barrier function with a quadratic program (CBF-QP) for each robot.
//! (Wang, Ames, Egerstedt: Safety barrier certificates for collisions-free multirobot systems, 2017; the
//! decentralized form, for single integrators)
//!
//! The barrier h = r^2 - d^2 must satisfy h' >= -a h, so that it stays positive. With h' = 2 z . (u_i - u_j),
//! each robot of a pair guarantees half of it: 2 z . u >= -a h / 2. The method returns the velocity nearest to
//! gamma that satisfies this constraint for every neighbor in range, and |u| <= v_max. A wall does not move, so
//! the robot guarantees all of it, with the nearest point of each convex part and the clearance in place of d.
//!
//! While no neighbor is closer than d, u = 0 is feasible, so in the worst case the robot stops. Otherwise the
//! program may be infeasible. The half-planes are then relaxed by one common amount, the smallest that makes it
//! feasible. Half-planes of walls are relaxed last.
//!
//! The method needs positions only. Sampled with period T under otherwise ideal conditions it keeps d if a T <=
//! 1, because the displacement of each robot along z is then at most half of the slack.
//!
//! | symbol | meaning |
//! |---|---|
//! | z, r, n | own position - other's position, m, its length and direction |
//! | h | r^2 - d^2, m^2 |
//! | a | maximum relative rate of decrease of h, 1/s (gamma in the paper) |

use formation::Vec2;
use formation::portable_math;
use protocol::avoidance::{AvoidanceDescription, Gain, MethodConditions};

use super::cone::{ROUNDING_MARGIN_M, direction};
use super::holonomic::{HOLONOMIC_DESCRIPTION, Holonomic, VelocityMethod, advise_rate};
use super::polygon::HalfPlane;
use super::program::nearest_permitted_velocity;
use super::{AvoidanceRow, Sample};

/// Fraction of the constraint on h that the robot guarantees: half towards another robot, all of it towards a
/// wall.
const ROBOT_CONSTRAINT_FRACTION: f64 = 0.5;
const WALL_CONSTRAINT_FRACTION: f64 = 1.0;

pub(super) const METHOD: AvoidanceRow = AvoidanceRow {
    description: AvoidanceDescription {
        name: "cbf-qp",
        source: "Wang et al. 2017",
        guarantee_text: "d, if `barrier_per_s` times the period is at most 1; does not resolve deadlocks",
        sensing_radius_m,
        gains: &[Gain::new(
            "barrier_per_s",
            "maximum relative rate at which the barrier r^2 - d^2 may decrease, with r the distance of two \
             robots, in 1/s; with a smaller rate robots slow down farther apart",
        )],
        // A larger product would use up more than the whole slack within one period.
        find_warning: |conditions| advise_rate(conditions, "barrier_per_s", 1.0),
        ..HOLONOMIC_DESCRIPTION
    },
    build: |brief, gains| {
        let cbf_qp = CbfQp {
            distance_min: brief.avoidance.distance_min_m + ROUNDING_MARGIN_M,
            clearance: brief.avoidance.clearance_m + ROUNDING_MARGIN_M,
            v_max: brief.avoidance.speed_max_m_s,
            barrier_rate: gains.get("barrier_per_s"),
        };
        Box::new(Holonomic::new(brief, cbf_qp))
    },
};

/// Returns the distance, m, beyond which the constraint permits v_max in every direction, so that no neighbor
/// or wall matters.
fn sensing_radius_m(conditions: &MethodConditions<'_>) -> f64 {
    let Some(rate) = conditions.avoidance.gains.get("barrier_per_s") else { return 0.0 };
    // a (r^2 - k^2) share / (2 r) = v_max
    let radius = |distance_min: f64, fraction: f64| {
        let half = conditions.speed_max_m_s() / (rate * fraction);
        half + portable_math::hypot(half, distance_min)
    };
    let robots = radius(conditions.avoidance.distance_min_m, ROBOT_CONSTRAINT_FRACTION);
    let walls = radius(conditions.avoidance.clearance_m, WALL_CONSTRAINT_FRACTION);
    robots.max(walls) + conditions.distance_error_max_m()
}

/// CBF-QP method of one robot.
struct CbfQp {
    distance_min: f64,
    clearance: f64,
    v_max: f64,
    /// Maximum relative rate of decrease of h (a), 1/s.
    barrier_rate: f64,
}

impl VelocityMethod for CbfQp {
    fn choose_velocity(&mut self, sample: &Sample<'_>, gamma: Vec2) -> Option<Vec2> {
        let walls = sample
            .wall_vectors
            .iter()
            .map(|z| self.barrier_constraint(*z, self.clearance, WALL_CONSTRAINT_FRACTION));
        let robots = sample
            .neighbor_vectors
            .iter()
            .map(|z| self.barrier_constraint(*z, self.distance_min, ROBOT_CONSTRAINT_FRACTION));
        let sides: Vec<HalfPlane> = walls.chain(robots).collect();
        Some(nearest_permitted_velocity(gamma, self.v_max, &sides, sample.wall_vectors.len()))
    }
}

impl CbfQp {
    /// Returns the constraint 2 z . u >= -share a h as a half-plane, divided by 2 |z|.
    fn barrier_constraint(&self, z: Vec2, distance_min: f64, fraction: f64) -> HalfPlane {
        let r = z.norm();
        let h = r * r - distance_min * distance_min;
        // With coincident positions any direction leads away, so the robot leaves at maximum speed.
        let bound =
            if r > 0.0 { fraction * self.barrier_rate * h / (2.0 * r) } else { -self.v_max };
        HalfPlane { normal: direction(z), boundary_distance: bound }
    }
}

#[cfg(test)]
mod tests;
