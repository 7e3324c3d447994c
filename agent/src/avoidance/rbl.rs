//! RBL: the rule-based Lloyd algorithm. (Boldrer, Serra-Gomez, Lyons, Kratky, Alonso-Mora, Ferranti:
//! Rule-based Lloyd algorithm for multi-robot motion planning and control with safety and convergence
//! guarantees, arXiv 2310.19511)
//!
//! Each robot goes to the centroid of its cell: of all points within r_s that are nearer to it than to the
//! others, and no nearer to them than d lets it come. Points weigh exp(-|q - e| / beta): the nearer to the
//! goal e, the more. u = -k (alpha - c), no longer than v_max. The cell is convex, so that its centroid lies
//! in it.
//!
//! Rules against deadlocks compare c with c_0, the centroid that there would be without others. Where the
//! two are far apart and the robot is at c, others hold it up:
//!
//! - (8) beta falls, so that the robot presses on; else it goes back to what it was.
//! - (9) the goal turns clockwise about the robot, everybody's to the same side, by up to a right angle;
//!   else it turns back.
//! - (10) at a right angle it turns back at once where the cell leads farther the straight way.
//!
//! The goal is the place that the robot's role wants (`Sample::error`), and gamma is not used: laws that
//! are faster than v_max or slower make no difference. A robot that wants no place stays where it is, and
//! gives way. Numbers that the paper leaves to its program (github.com/manuelboldrer/RBL, d = 0.4 m
//! there) are in proportion to d here.
//!
//! The paper's cell ends r/2 from the robot, or, nearer than 2 d, r - d. That is all of the slack, for each
//! of two: sampled with the period T it keeps d as long as k T <= 1/2, where all else is ideal. A wall is
//! a side of the cell at the clearance from its nearest point, of each convex part.
//!
//! Centroids are sums over a net of points about the robot: they lie in the cell whatever the net.
//!
//! | symbol | meaning |
//! |---|---|
//! | z, r, n | own - the other, m, its length and direction |
//! | q, e | a point of the cell and the goal, from the robot, m |
//! | c, c_0 | centroids of the cell and of the disc, from the robot, m |
//! | theta | by how much the goal is turned, rad |

use std::f64::consts::FRAC_PI_2;

use formation::Vec2;
use formation::front_point::rotate;
use formation::real;
use protocol::avoidance::{AvoidanceDescription, Conditions, Gain};

use super::cone::{ROUNDING_M, direction};
use super::holonomic::{HOLONOMIC, Holonomic, Velocity, sampled_too_slowly};
use super::polygon::HalfPlane;
use super::{AvoidanceRow, Sample, clip};

/// d_1 and d_3 in d: a robot nearer to c than this is at it.
const AT_CENTROID: f64 = 0.25;
/// d_2 and d_4 in d: centroids farther apart than this are far apart.
const FAR_APART: f64 = 1.0;
/// How fast beta falls, in d a second, and how far at most, in d.
const SPREAD_FALL_PER_S: f64 = 2.5;
const SPREAD_MIN: f64 = 0.1875;
/// How fast beta goes back, 1/s.
const SPREAD_RETURN_PER_S: f64 = 1.0;
/// How fast the goal turns, rad/s.
const TURN_RAD_S: f64 = 1.0;
/// Points of the net along r_s.
const NET: i32 = 12;

pub(super) const ROW: AvoidanceRow = AvoidanceRow {
    description: AvoidanceDescription {
        name: "rbl",
        source: "arXiv 2310.19511",
        promises: "d, where `approach_per_s` times the period is at most 1/2, and arrival near the goals; \
                   with others near its goal a robot stays off it",
        assumes: "everybody uses it, senses positions exactly, and moves at once as it chooses; no delay, \
                  no inertia; goals farther apart than cells",
        sensing_radius_m,
        gains: &[
            Gain::needed("cell_radius_m", "r_s, how far cells reach, in m"),
            Gain::needed("spread_m", "beta, how far around the goal points weigh, in m"),
            Gain::needed("approach_per_s", "k, rate at which it approaches the centroid, in 1/s"),
        ],
        // Two that use up all of the slack meet.
        advice: |at| sampled_too_slowly(at, "approach_per_s", 0.5),
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
            disc: net(r_s),
            cell: Vec::new(),
            sides: Vec::new(),
        };
        Box::new(Holonomic::new(brief, rbl))
    },
};

/// The cell of nobody farther away touches the robot's, m.
fn sensing_radius_m(at: &Conditions<'_>) -> f64 {
    let Some(r_s) = at.avoidance.gains.get("cell_radius_m") else { return 0.0 };
    let others = (2.0 * r_s).max(r_s + at.avoidance.distance_min_m);
    others.max(r_s + at.avoidance.clearance_m) + at.distance_error_m()
}

/// Points of a disc about the robot, from the robot, m.
fn net(r_s: f64) -> Vec<Vec2> {
    let step = r_s / f64::from(NET);
    let row = |i: i32| (-NET..=NET).map(move |j| step * Vec2::new(f64::from(i), f64::from(j)));
    (-NET..=NET).flat_map(row).filter(|q| q.norm() <= r_s).collect()
}

/// One robot's.
struct Rbl {
    d: f64,
    clearance: f64,
    v_max: f64,
    /// T, s.
    period: f64,
    /// 1/s.
    k: f64,
    /// beta as given, and as it is, m.
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
        let held_up = (c - c_0).norm() > FAR_APART * self.d && c.norm() < AT_CENTROID * self.d;
        let rate = match held_up {
            true => -SPREAD_FALL_PER_S * self.d, // (8)
            false => SPREAD_RETURN_PER_S * (self.spread_wanted - beta),
        };
        let least = (SPREAD_MIN * self.d).min(self.spread_wanted);
        self.spread = (beta + self.period * rate).max(least);
        let turn = TURN_RAD_S * self.period;
        self.theta = match held_up {
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
    /// What is left of the disc.
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
        let within = |q: &&Vec2| sides.iter().all(|side| side.excess(**q) <= 0.0);
        self.cell.clear();
        self.cell.extend(self.disc.iter().filter(within));
    }
}

/// The mean of `points`, of which each weighs exp(-|q - goal| / spread); 0 if there are none.
fn centroid(points: &[Vec2], goal: Vec2, spread: f64) -> Vec2 {
    let far = |q: &Vec2| (q - goal).norm();
    let Some(nearest) = points.iter().map(far).reduce(f64::min) else { return Vec2::zeros() };
    let (mut sum, mut weights) = (Vec2::zeros(), 0.0);
    for q in points {
        let weight = real::exp((nearest - far(q)) / spread);
        sum += weight * q;
        weights += weight;
    }
    sum / weights
}

#[cfg(test)]
mod tests;
