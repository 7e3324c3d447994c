//! ORCA: optimal reciprocal collision avoidance. (van den Berg, Guy, Lin, Manocha: Reciprocal n-body
//! collision avoidance, 2011)
//!
//! Of the velocities relative to another robot, the velocity obstacle VO holds those that bring the two
//! nearer than d within tau. u is the smallest change that takes the relative velocity at hand to its
//! border. Each of the two makes half of that change, or more: a half-plane of velocities. Of those in all
//! half-planes and within v_max, the nearest to gamma is taken, by a linear program; where there is none,
//! that which misses the worst-missed half-plane by least.
//!
//! Radii are d/2 each, so that front points keep d. Optimisation velocities are those sensed. Of a wall
//! counts the nearest point of each convex part, with the optimisation velocity 0 and the whole change;
//! walls do not give way.
//!
//! Known: exactly symmetric scenes may deadlock, and a crowd that leaves the program without a solution
//! may come nearer than d.
//!
//! | symbol | meaning |
//! |---|---|
//! | p, r | the other - own, m, and its length |
//! | v | own velocity - the other's, m/s |
//! | w | v as seen from the middle of the disc that cuts VO off, m/s |
//! | u, n | smallest change of v to the border of VO, m/s; the border's normal there, outwards |

use formation::Vec2;
use formation::front_point::front_velocity;
use protocol::avoidance::{AvoidanceDescription, Conditions, Gain, Senses};

use super::cone::{ROUNDING_M, direction};
use super::holonomic::{HOLONOMIC, Holonomic, Velocity};
use super::polygon::HalfPlane;
use super::program::nearest_permitted;
use super::{AvoidanceRow, Sample};

pub(super) const ROW: AvoidanceRow = AvoidanceRow {
    description: AvoidanceDescription {
        name: "orca",
        source: "van den Berg et al. 2011",
        promises: "d for the next `horizon_s` wherever its linear program has a solution; no way out of \
                   exact symmetry",
        assumes: "everybody uses it, senses positions and velocities exactly, and moves at once as it \
                  chooses; no delay, no inertia",
        senses: Senses::Velocities,
        sensing_radius_m,
        gains: &[Gain::needed("horizon_s", "tau, how far ahead it keeps d, in seconds")],
        ..HOLONOMIC
    },
    build: |brief, gains| {
        let orca = Orca {
            d: brief.avoidance.distance_min_m + ROUNDING_M,
            clearance: brief.avoidance.clearance_m + ROUNDING_M,
            v_max: brief.avoidance.speed_max_m_s,
            ell: brief.front_point_m,
            period: brief.period_ns as f64 / 1e9,
            tau: gains.get("horizon_s"),
            sides: Vec::new(),
        };
        Box::new(Holonomic::new(brief, orca))
    },
};

/// Nobody farther away can come nearer than d within tau, m: d + 2 v_max tau; and no wall.
fn sensing_radius_m(at: &Conditions<'_>) -> f64 {
    let way = at.speed_m_s() * at.avoidance.gains.get("horizon_s").copied().unwrap_or(0.0);
    let robots = at.avoidance.distance_min_m + 2.0 * way;
    robots.max(at.avoidance.clearance_m + way) + at.distance_error_m()
}

/// One robot's.
struct Orca {
    d: f64,
    clearance: f64,
    v_max: f64,
    ell: f64,
    /// T, s.
    period: f64,
    tau: f64,
    sides: Vec<HalfPlane>,
}

impl Velocity for Orca {
    fn velocity(&mut self, sample: &Sample<'_>, gamma: Vec2) -> Option<Vec2> {
        let own = front_velocity(sample.heading_rad, self.ell, sample.twist);
        let near = sample.moving()?;
        let mut sides = std::mem::take(&mut self.sides);
        sides.clear();
        sides.extend(sample.walls.iter().map(|z| self.beside_wall(*z)));
        sides.extend(near.map(|(z, other)| {
            let (u, n) = self.smallest_change(-z, own - other);
            HalfPlane { normal: n, bound: -n.dot(&(own + 0.5 * u)) }
        }));
        self.sides = sides;
        Some(nearest_permitted(gamma, self.v_max, &self.sides, sample.walls.len()))
    }
}

impl Orca {
    /// u and n.
    fn smallest_change(&self, p: Vec2, v: Vec2) -> (Vec2, Vec2) {
        let (r, d) = (p.norm(), self.d);
        // Who is too near already is to be out of it after one period.
        let within = if r > d { self.tau } else { self.period };
        let w = v - p / within;
        let (across, ahead) = (p.x * w.y - p.y * w.x, p.dot(&w));
        if r <= d || (ahead < 0.0 && ahead * ahead > d * d * w.norm_squared()) {
            // The nearest part of the border is the disc's.
            let n = if w.norm() > 0.0 { w.normalize() } else { -direction(p) };
            return ((d / within - w.norm()) * n, n);
        }
        // It is one of the two tangents from 0 to the disc: p, turned by asin(d/r) to its side.
        let leg = (r * r - d * d).sqrt();
        let side = if across > 0.0 { 1.0 } else { -1.0 };
        let tangent = (leg * p + side * d * Vec2::new(-p.y, p.x)) / (r * r);
        let n = side * Vec2::new(-tangent.y, tangent.x);
        (-n.dot(&v) * n, n)
    }

    /// What keeps the clearance from a convex part whose nearest point is at -z, for tau.
    fn beside_wall(&self, z: Vec2) -> HalfPlane {
        let slack = z.norm() - self.clearance;
        let within = if slack > 0.0 { self.tau } else { self.period };
        HalfPlane { normal: direction(z), bound: slack / within }
    }
}

#[cfg(test)]
mod tests;
