//! ORCA: optimal reciprocal collision avoidance. (van den Berg, Guy, Lin, Manocha: Reciprocal n-body collision
//! avoidance, 2011)
//!
//! The velocity obstacle VO is the set of relative velocities that bring two robots closer than d within tau.
//! The vector u is the smallest change that moves the current relative velocity to the boundary of VO. Each
//! robot makes at least half of that change, which gives a half-plane of velocities. A linear program selects
//! the velocity nearest to gamma in all half-planes and within v_max. If there is none, it selects the velocity
//! with the smallest maximum violation.
//!
//! Each radius is d/2, so that front points keep d. Optimization velocities are the sensed velocities. For a
//! wall, the nearest point of each convex part counts, with the optimization velocity 0 and the whole change.
//! Wall constraints are not relaxed.
//!
//! Known limitations: exactly symmetric scenes may deadlock, and robots may come closer than d if the program
//! is infeasible at high local density.
//!
//! | symbol | meaning |
//! |---|---|
//! | p, r | other position - own position, m, and its length |
//! | v | own velocity - other velocity, m/s |
//! | w | v relative to the center of the disc that truncates VO, m/s |
//! | u, n | smallest change of v to the boundary of VO, m/s, and the outward normal of the boundary there |

use formation::Vec2;
use formation::front_point::front_velocity;
use protocol::avoidance::{AvoidanceDescription, Gain, MethodConditions, RequiredSensing};

use super::cone::{ROUNDING_MARGIN_M, direction};
use super::holonomic::{HOLONOMIC_DESCRIPTION, Holonomic, VelocityMethod};
use super::polygon::HalfPlane;
use super::program::nearest_permitted_velocity;
use super::{AvoidanceRow, Sample};

pub(super) const METHOD: AvoidanceRow = AvoidanceRow {
    description: AvoidanceDescription {
        name: "orca",
        source: "van den Berg et al. 2011",
        guarantee_text: "d for the next `horizon_s` if its linear program is feasible; does not resolve \
                   exact symmetry",
        assumptions_text: "every robot uses it, senses positions and velocities exactly and moves at once as \
                  chosen; no delay, no inertia",
        required_sensing: RequiredSensing::PositionsAndVelocities,
        sensing_radius_m,
        gains: &[Gain::new(
            "horizon_s",
            "tau, time for which the chosen velocities keep the distance d, in \
                                              seconds; with a larger tau robots avoid each other earlier",
        )],
        ..HOLONOMIC_DESCRIPTION
    },
    build: |brief, gains| {
        let orca = Orca {
            distance_min: brief.avoidance.distance_min_m + ROUNDING_MARGIN_M,
            clearance: brief.avoidance.clearance_m + ROUNDING_MARGIN_M,
            v_max: brief.avoidance.speed_max_m_s,
            ell: brief.front_point_m,
            period: brief.period_ns as f64 / 1e9,
            time_horizon: gains.get("horizon_s"),
            half_planes: Vec::new(),
        };
        Box::new(Holonomic::new(brief, orca))
    },
};

/// Returns the radius, m, beyond which no robot can come closer than d within tau, d + 2 v_max tau, or the
/// corresponding radius of walls if it is larger.
fn sensing_radius_m(conditions: &MethodConditions<'_>) -> f64 {
    let distance = conditions.speed_max_m_s()
        * conditions.avoidance.gains.get("horizon_s").copied().unwrap_or(0.0);
    let robots = conditions.avoidance.distance_min_m + 2.0 * distance;
    robots.max(conditions.avoidance.clearance_m + distance) + conditions.distance_error_max_m()
}

/// ORCA method of one robot.
struct Orca {
    distance_min: f64,
    clearance: f64,
    v_max: f64,
    ell: f64,
    /// Control period (T), s.
    period: f64,
    time_horizon: f64,
    half_planes: Vec<HalfPlane>,
}

impl VelocityMethod for Orca {
    fn choose_velocity(&mut self, sample: &Sample<'_>, gamma: Vec2) -> Option<Vec2> {
        let own = front_velocity(sample.heading_rad, self.ell, sample.twist);
        let neighbors = sample.neighbor_motions()?;
        let mut sides = std::mem::take(&mut self.half_planes);
        sides.clear();
        sides.extend(sample.wall_vectors.iter().map(|z| self.wall_half_plane(*z)));
        sides.extend(neighbors.map(|(z, other)| {
            let (u, n) = self.smallest_velocity_change(-z, own - other);
            HalfPlane { normal: n, boundary_distance: -n.dot(&(own + 0.5 * u)) }
        }));
        self.half_planes = sides;
        Some(nearest_permitted_velocity(
            gamma,
            self.v_max,
            &self.half_planes,
            sample.wall_vectors.len(),
        ))
    }
}

impl Orca {
    /// Returns u and n.
    fn smallest_velocity_change(&self, p: Vec2, v: Vec2) -> (Vec2, Vec2) {
        let (r, d) = (p.norm(), self.distance_min);
        // A robot that is already too close must leave VO within one period.
        let time = if r > d { self.time_horizon } else { self.period };
        let w = v - p / time;
        let (cross, dot) = (p.x * w.y - p.y * w.x, p.dot(&w));
        if r <= d || (dot < 0.0 && dot * dot > d * d * w.norm_squared()) {
            // The nearest part of the boundary is the truncating disc.
            let n = if w.norm() > 0.0 { w.normalize() } else { -direction(p) };
            return ((d / time - w.norm()) * n, n);
        }
        // The nearest part is one of the two tangents from 0 to the disc: p, turned by asin(d/r) to its side.
        let leg = (r * r - d * d).sqrt();
        let side = if cross > 0.0 { 1.0 } else { -1.0 };
        let tangent = (leg * p + side * d * Vec2::new(-p.y, p.x)) / (r * r);
        let n = side * Vec2::new(-tangent.y, tangent.x);
        (-n.dot(&v) * n, n)
    }

    /// Returns the half-plane that keeps the clearance from a convex part with nearest point -z for tau.
    fn wall_half_plane(&self, z: Vec2) -> HalfPlane {
        let slack = z.norm() - self.clearance;
        let time = if slack > 0.0 { self.time_horizon } else { self.period };
        HalfPlane { normal: direction(z), boundary_distance: slack / time }
    }
}

#[cfg(test)]
mod tests;
