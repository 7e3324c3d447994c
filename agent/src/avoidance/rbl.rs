//! RBL: the rule-based Lloyd algorithm. (Boldrer, Serra-Gomez, Lyons, Kratky, Alonso-Mora, Ferranti: Rule-based
//! Lloyd algorithm for multi-robot motion planning and control with safety and convergence guarantees, arXiv
//! 2310.19511)
//!
//! Each robot moves to the weighted centroid of its cell: the points within r_s that are closer to it than to
//! the others, and no closer to the others than d permits. Points are weighted by exp(-|q - e| / beta), which
//! grows towards the goal e. The velocity is u = -k (alpha - c), at most v_max. The cell is convex, so it
//! contains its centroid.
//!
//! The rules against deadlocks compare c with c_0, the centroid without other robots. If both are far apart and
//! the robot is at c, it is blocked by others:
//!
//! - (8) beta decreases, so that the robot pushes forward. Otherwise it returns to its nominal value.
//! - (9) the goal rotates clockwise about the robot, on the same side for all robots, by up to a right angle.
//!   Otherwise it rotates back.
//! - (10) at a right angle it rotates back at once if the cell extends farther in the original direction.
//!
//! The goal is the desired position of the robot's role (`Sample::error`), and gamma is not used, so the speed
//! of the control law has no effect. A robot without a desired position stays where it is and yields.
//! Parameters that the paper leaves to its program (github.com/manuelboldrer/RBL, d = 0.4 m there) are scaled
//! with d.
//!
//! The cell of the paper ends r/2 from the robot, or r - d if the distance is less than 2 d. That is the whole
//! slack for each of two robots. Sampled with period T under otherwise ideal conditions, d is kept if k T <=
//! 1/2. A wall is a side of the cell at the clearance from its nearest point, for each convex part.
//!
//! Centroids are sums over a grid of points around the robot. They are in the cell for any grid.
//!
//! | symbol | meaning |
//! |---|---|
//! | z, r, n | own position - other's position, m, its length and direction |
//! | q, e | a point of the cell and the goal, relative to the robot, m |
//! | c, c_0 | centroids of the cell and of the disc, relative to the robot, m |
//! | theta | angle by which the goal is rotated, rad |

use std::f64::consts::FRAC_PI_2;

use formation::Vec2;
use formation::front_point::rotate;
use formation::portable_math;
use protocol::avoidance::{AvoidanceDescription, Conditions, Gain};

use super::cone::{ROUNDING_M, direction};
use super::holonomic::{HOLONOMIC, Holonomic, Velocity, advise_rate};
use super::polygon::HalfPlane;
use super::{AvoidanceRow, Sample, clip};

/// Distance within which a robot counts as being at c, in d (d_1 and d_3 of the paper).
const AT_CENTROID: f64 = 0.25;
/// Distance beyond which the two centroids count as far apart, in d (d_2 and d_4 of the paper).
const FAR_APART: f64 = 1.0;
/// Rate of decrease of beta, in d per second, and its minimum, in d.
const SPREAD_FALL_PER_S: f64 = 2.5;
const SPREAD_MIN: f64 = 0.1875;
/// Rate at which beta returns to its nominal value, 1/s.
const SPREAD_RETURN_PER_S: f64 = 1.0;
/// Rotation speed of the goal, rad/s.
const TURN_RAD_S: f64 = 1.0;
/// Number of grid points along r_s.
const GRID_POINTS: i32 = 12;

pub(super) const ROW: AvoidanceRow = AvoidanceRow {
    description: AvoidanceDescription {
        name: "rbl",
        source: "arXiv 2310.19511",
        promises: "d, if `approach_per_s` times the period is at most 1/2, and arrival near the goals; \
                   a robot stays off its goal while others are near it",
        assumes: "every robot uses it, senses positions exactly and moves at once as chosen; no delay, \
                  no inertia; goals farther apart than cells",
        sensing_radius_m,
        gains: &[
            Gain::required(
                "cell_radius_m",
                "r_s, maximum radius of the cell around a robot, in which its next \
                                             position lies, in m",
            ),
            Gain::required(
                "spread_m",
                "beta, length over which the weights of the points of the cell decrease \
                                        with the distance from the goal, in m",
            ),
            Gain::required(
                "approach_per_s",
                "k, rate at which a robot approaches the weighted centroid of its \
                                              cell, in 1/s",
            ),
        ],
        // Two robots that each use up the whole slack come closer than d.
        advice: |at| advise_rate(at, "approach_per_s", 0.5),
        ..HOLONOMIC
    },
    build: |brief, gains| {
        let (d, r_s) = (brief.avoidance.distance_min_m, gains.get("cell_radius_m"));
        let spread = gains.get("spread_m");
        let rbl = Rbl {
            d: d + ROUNDING_M,
            clearance: brief.avoidance.clearance_m + ROUNDING_M,
            v_max: brief.avoidance.speed_max_m_s,
            period: brief.period_ns as f64 / 1e9,
            k: gains.get("approach_per_s"),
            spread_wanted: spread,
            spread,
            theta: 0.0,
            disc: grid(r_s),
            cell: Vec::new(),
            sides: Vec::new(),
        };
        Box::new(Holonomic::new(brief, rbl))
    },
};

/// Returns the distance, m, beyond which the cell of no other robot, and no wall, touches the robot's cell.
fn sensing_radius_m(at: &Conditions<'_>) -> f64 {
    let Some(r_s) = at.avoidance.gains.get("cell_radius_m") else { return 0.0 };
    let others = (2.0 * r_s).max(r_s + at.avoidance.distance_min_m);
    others.max(r_s + at.avoidance.clearance_m) + at.distance_error_m()
}

/// Returns the grid points of a disc around the robot, relative to it, m.
fn grid(r_s: f64) -> Vec<Vec2> {
    let step = r_s / f64::from(GRID_POINTS);
    let row = |i: i32| {
        (-GRID_POINTS..=GRID_POINTS).map(move |j| step * Vec2::new(f64::from(i), f64::from(j)))
    };
    (-GRID_POINTS..=GRID_POINTS).flat_map(row).filter(|q| q.norm() <= r_s).collect()
}

/// RBL method of one robot.
struct Rbl {
    d: f64,
    clearance: f64,
    v_max: f64,
    /// Control period (T), s.
    period: f64,
    /// Approach rate (k), 1/s.
    k: f64,
    /// Nominal and current beta, m.
    spread_wanted: f64,
    spread: f64,
    theta: f64,
    disc: Vec<Vec2>,
    cell: Vec<Vec2>,
    sides: Vec<HalfPlane>,
}

impl Velocity for Rbl {
    fn velocity(&mut self, sample: &Sample<'_>, _: Vec2) -> Option<Vec2> {
        let goal = -sample.error.unwrap_or_default();
        let turned = rotate(-self.theta, goal);
        self.collect_cell(sample);
        let beta = self.spread;
        let c = centroid(&self.cell, turned, beta);
        let c_0 = centroid(&self.disc, turned, beta);
        let blocked = (c - c_0).norm() > FAR_APART * self.d && c.norm() < AT_CENTROID * self.d;
        let rate = match blocked {
            true => -SPREAD_FALL_PER_S * self.d, // (8)
            false => SPREAD_RETURN_PER_S * (self.spread_wanted - beta),
        };
        let least = (SPREAD_MIN * self.d).min(self.spread_wanted);
        self.spread = (beta + self.period * rate).max(least);
        let turn = TURN_RAD_S * self.period;
        self.theta = match blocked {
            true => (self.theta + turn).min(FRAC_PI_2), // (9)
            false => (self.theta - turn).max(0.0),
        };
        if self.theta == FRAC_PI_2 && centroid(&self.cell, goal, beta).norm() > c.norm() {
            self.theta = 0.0; // (10)
        }
        Some(clip(self.k * c, self.v_max))
    }
}

impl Rbl {
    /// Collects the grid points of the disc that belong to the cell.
    fn collect_cell(&mut self, sample: &Sample<'_>) {
        let (d, clearance) = (self.d, self.clearance);
        let others = sample.away.iter().map(|z| {
            let r = z.norm();
            HalfPlane { normal: direction(*z), bound: (0.5 * r).min(r - d) }
        });
        let walls = sample
            .walls
            .iter()
            .map(|z| HalfPlane { normal: direction(*z), bound: z.norm() - clearance });
        self.sides.clear();
        self.sides.extend(others.chain(walls));
        let sides = &self.sides;
        let within = |q: &&Vec2| sides.iter().all(|side| side.violation_m_s(**q) <= 0.0);
        self.cell.clear();
        self.cell.extend(self.disc.iter().filter(within));
    }
}

/// Returns the mean of `points` with weights exp(-|q - goal| / spread), or 0 if there are none.
fn centroid(points: &[Vec2], goal: Vec2, spread: f64) -> Vec2 {
    let far = |q: &Vec2| (q - goal).norm();
    let Some(nearest) = points.iter().map(far).reduce(f64::min) else { return Vec2::zeros() };
    let (mut sum, mut weights) = (Vec2::zeros(), 0.0);
    for q in points {
        let weight = portable_math::exp((nearest - far(q)) / spread);
        sum += weight * q;
        weights += weight;
    }
    sum / weights
}

#[cfg(test)]
mod tests;
