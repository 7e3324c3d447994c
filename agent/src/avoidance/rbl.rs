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
use protocol::avoidance::{AvoidanceDescription, Gain, MethodConditions};

use super::cone::{ROUNDING_MARGIN_M, direction};
use super::holonomic::{HOLONOMIC_DESCRIPTION, Holonomic, VelocityMethod, advise_rate};
use super::polygon::HalfPlane;
use super::{AvoidanceRow, Sample, clip};

/// Distance within which a robot counts as being at c, in d (d_1 and d_3 of the paper).
const CENTROID_REACHED_DISTANCE: f64 = 0.25;
/// Distance beyond which the two centroids count as far apart, in d (d_2 and d_4 of the paper).
const CENTROIDS_APART_DISTANCE: f64 = 1.0;
/// Rate of decrease of beta, in d per second, and its minimum, in d.
const SPREAD_DECREASE_PER_S: f64 = 2.5;
const SPREAD_MIN: f64 = 0.1875;
/// Rate at which beta returns to its nominal value, 1/s.
const SPREAD_RETURN_PER_S: f64 = 1.0;
/// Rotation speed of the goal, rad/s.
const GOAL_ROTATION_RAD_S: f64 = 1.0;
/// Number of grid points along r_s.
const GRID_POINTS_PER_RADIUS: i32 = 12;

pub(super) const METHOD: AvoidanceRow = AvoidanceRow {
    description: AvoidanceDescription {
        name: "rbl",
        source: "arXiv 2310.19511",
        guarantee_text: "d, if `approach_per_s` times the period is at most 1/2, and arrival near the goals; \
                   a robot stays off its goal while others are near it",
        assumptions_text: "every robot uses it, senses positions exactly and moves at once as chosen; no delay, \
                  no inertia; goals farther apart than cells",
        sensing_radius_m,
        gains: &[
            Gain::new(
                "cell_radius_m",
                "r_s, maximum radius of the cell around a robot, in which its next \
                                             position lies, in m",
            ),
            Gain::new(
                "spread_m",
                "beta, length over which the weights of the points of the cell decrease \
                                        with the distance from the goal, in m",
            ),
            Gain::new(
                "approach_per_s",
                "k, rate at which a robot approaches the weighted centroid of its \
                                              cell, in 1/s",
            ),
        ],
        // Two robots that each use up the whole slack come closer than d.
        find_warning: |conditions| advise_rate(conditions, "approach_per_s", 0.5),
        ..HOLONOMIC_DESCRIPTION
    },
    build: |brief, gains| {
        let (d, r_s) = (brief.avoidance.distance_min_m, gains.get("cell_radius_m"));
        let spread = gains.get("spread_m");
        let rbl = Rbl {
            distance_min: d + ROUNDING_MARGIN_M,
            clearance: brief.avoidance.clearance_m + ROUNDING_MARGIN_M,
            v_max: brief.avoidance.speed_max_m_s,
            period: brief.period_ns as f64 / 1e9,
            approach_rate: gains.get("approach_per_s"),
            nominal_spread: spread,
            spread,
            goal_rotation_rad: 0.0,
            disc_points: disc_grid_points(r_s),
            cell_points: Vec::new(),
            half_planes: Vec::new(),
        };
        Box::new(Holonomic::new(brief, rbl))
    },
};

/// Returns the distance, m, beyond which the cell of no other robot, and no wall, touches the robot's cell.
fn sensing_radius_m(conditions: &MethodConditions<'_>) -> f64 {
    let Some(r_s) = conditions.avoidance.gains.get("cell_radius_m") else { return 0.0 };
    let others = (2.0 * r_s).max(r_s + conditions.avoidance.distance_min_m);
    others.max(r_s + conditions.avoidance.clearance_m) + conditions.distance_error_max_m()
}

/// Returns the grid points of a disc around the robot, relative to it, m.
fn disc_grid_points(r_s: f64) -> Vec<Vec2> {
    let step = r_s / f64::from(GRID_POINTS_PER_RADIUS);
    let row = |i: i32| {
        (-GRID_POINTS_PER_RADIUS..=GRID_POINTS_PER_RADIUS)
            .map(move |j| step * Vec2::new(f64::from(i), f64::from(j)))
    };
    (-GRID_POINTS_PER_RADIUS..=GRID_POINTS_PER_RADIUS)
        .flat_map(row)
        .filter(|q| q.norm() <= r_s)
        .collect()
}

/// RBL method of one robot.
struct Rbl {
    distance_min: f64,
    clearance: f64,
    v_max: f64,
    /// Control period (T), s.
    period: f64,
    /// Approach rate (k), 1/s.
    approach_rate: f64,
    /// Nominal and current beta, m.
    nominal_spread: f64,
    spread: f64,
    goal_rotation_rad: f64,
    disc_points: Vec<Vec2>,
    cell_points: Vec<Vec2>,
    half_planes: Vec<HalfPlane>,
}

impl VelocityMethod for Rbl {
    fn choose_velocity(&mut self, sample: &Sample<'_>, _: Vec2) -> Option<Vec2> {
        let goal = -sample.error.unwrap_or_default();
        let rotated_goal = rotate(-self.goal_rotation_rad, goal);
        self.collect_cell_points(sample);
        let beta = self.spread;
        let c = centroid(&self.cell_points, rotated_goal, beta);
        let c_0 = centroid(&self.disc_points, rotated_goal, beta);
        let is_blocked = (c - c_0).norm() > CENTROIDS_APART_DISTANCE * self.distance_min
            && c.norm() < CENTROID_REACHED_DISTANCE * self.distance_min;
        let rate = match is_blocked {
            true => -SPREAD_DECREASE_PER_S * self.distance_min, // (8)
            false => SPREAD_RETURN_PER_S * (self.nominal_spread - beta),
        };
        let spread_min = (SPREAD_MIN * self.distance_min).min(self.nominal_spread);
        self.spread = (beta + self.period * rate).max(spread_min);
        let rotation_step_rad = GOAL_ROTATION_RAD_S * self.period;
        self.goal_rotation_rad = match is_blocked {
            true => (self.goal_rotation_rad + rotation_step_rad).min(FRAC_PI_2), // (9)
            false => (self.goal_rotation_rad - rotation_step_rad).max(0.0),
        };
        if self.goal_rotation_rad == FRAC_PI_2
            && centroid(&self.cell_points, goal, beta).norm() > c.norm()
        {
            self.goal_rotation_rad = 0.0; // (10)
        }
        Some(clip(self.approach_rate * c, self.v_max))
    }
}

impl Rbl {
    /// Collects the grid points of the disc that belong to the cell.
    fn collect_cell_points(&mut self, sample: &Sample<'_>) {
        let (d, clearance) = (self.distance_min, self.clearance);
        let others = sample.neighbor_vectors.iter().map(|z| {
            let r = z.norm();
            HalfPlane { normal: direction(*z), boundary_distance: (0.5 * r).min(r - d) }
        });
        let walls = sample
            .wall_vectors
            .iter()
            .map(|z| HalfPlane { normal: direction(*z), boundary_distance: z.norm() - clearance });
        self.half_planes.clear();
        self.half_planes.extend(others.chain(walls));
        let sides = &self.half_planes;
        let is_inside = |q: &&Vec2| sides.iter().all(|side| side.violation_m_s(**q) <= 0.0);
        self.cell_points.clear();
        self.cell_points.extend(self.disc_points.iter().filter(is_inside));
    }
}

/// Returns the mean of `points` with weights exp(-|q - goal| / spread), or 0 if there are none.
fn centroid(points: &[Vec2], goal: Vec2, spread: f64) -> Vec2 {
    let distance_to_goal = |q: &Vec2| (q - goal).norm();
    let Some(nearest) = points.iter().map(distance_to_goal).reduce(f64::min) else {
        return Vec2::zeros();
    };
    let (mut sum, mut weights) = (Vec2::zeros(), 0.0);
    for q in points {
        let weight = portable_math::exp((nearest - distance_to_goal(q)) / spread);
        sum += weight * q;
        weights += weight;
    }
    sum / weights
}

#[cfg(test)]
mod tests;
