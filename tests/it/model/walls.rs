//! Random walls and obstacles around the robots of a fleet, and the displacement that makes a robot ram one.

use std::f64::consts::TAU;

use agent::avoidance::{wall_approach_slack_fraction, wall_deflection_distance_m};
use formation::Vec2;
use formation::front_point::{front_point, rotate};
use formation::obstacle::Obstacle;
use formation::random::SplitMix64;
use protocol::avoidance::MethodConditions;

use super::{Fleet, Model};

/// Angle between the direction to a wall and the requested velocity of a robot that rams it, rad. It compensates the
/// deflection.
const RAMMING_ANGLE_RAD: f64 = 0.7;

impl Fleet {
    /// Returns the fleet among walls drawn from this seed. The minimum distance from a start to a wall is the
    /// clearance.
    pub fn among_walls(mut self, seed: u64) -> Fleet {
        let mut rng = SplitMix64::new(seed ^ 0x77a1);
        let starts = self.plant.robots.iter();
        let starts: Vec<Vec2> =
            starts.map(|body| front_point(body.start, body.front_point_m)).collect();
        let center = starts.iter().sum::<Vec2>() / starts.len() as f64;
        let spread_m = starts.iter().map(|start| (start - center).norm()).fold(0.1, f64::max);
        let clearance_m = self.plant.distance_min_m * (0.2 + 0.8 * rng.draw_unit());
        // A sample does not report all of many small discs.
        let (count, size_m) = if rng.draw_bool(0.1) { (60, 0.03) } else { (6, spread_m) };
        let mut obstacles = Vec::new();
        for _ in 0..20 * count {
            let at = center + polar(1.5 * spread_m * rng.draw_unit().sqrt(), TAU * rng.draw_unit());
            let (size_m, turn) = (size_m * (0.1 + 0.9 * rng.draw_unit()), TAU * rng.draw_unit());
            let corner = |k: f64, corners: f64| at + polar(0.5 * size_m, turn + TAU * k / corners);
            let drawn = match rng.draw_between(0, 2) {
                0 => Obstacle::Disc { center_m: at.into(), radius_m: 0.5 * size_m },
                1 => Obstacle::segment(corner(0.0, 2.0).into(), corner(1.0, 2.0).into()),
                _ => {
                    let corners = 3.0 + rng.draw_between(0, 2) as f64;
                    let corners_m =
                        (0..corners as u32).map(|k| corner(f64::from(k), corners).into());
                    Obstacle::Polygon { corners_m: corners_m.collect() }
                }
            };
            drawn.check_convex().expect("its corners are on a circle");
            let near = |start: &Vec2| (start - drawn.nearest_point(*start)).norm() < clearance_m;
            if !starts.iter().any(near) {
                obstacles.push(drawn);
            }
            if obstacles.len() == count {
                break;
            }
        }
        // Behind one of the robots, at the clearance within a relative error of 1e-9.
        let robot = rng.draw_between(0, starts.len() as u64 - 1) as usize;
        let out = (starts[robot] - center).normalize();
        let foot = starts[robot] + (clearance_m * (1.0 + 1e-9)) * out;
        let along = rotate(0.25 * TAU, out);
        let behind = Obstacle::segment((foot - 0.2 * along).into(), (foot + 0.2 * along).into());
        let free = |start: &Vec2| (start - behind.nearest_point(*start)).norm() >= clearance_m;
        if starts.iter().all(free) {
            obstacles.push(behind);
        }
        self.plant.obstacles = obstacles;
        self.plant.clearance_m = clearance_m;
        for agent in &mut self.agents {
            agent.avoidance.clearance_m = clearance_m;
        }
        self.sees_as_far_as_needed()
    }
}

fn polar(length: f64, angle: f64) -> Vec2 {
    rotate(angle, Vec2::new(length, 0.0))
}

/// Displacements of a robot that rams a near obstacle. Components are along the direction from the obstacle to the
/// robot and to the left of it.
pub struct Ramming {
    /// Direction of the requested velocity.
    pub requested_direction: Vec2,
    /// Component of the deflected displacement in one period along the direction, m.
    pub p_n: f64,
    /// Component to the left of the direction, m.
    pub p_t: f64,
}

impl Model<'_> {
    /// Returns the position of the wall to which robot `i` has less slack than `slack_m`, relative to the robot, m.
    pub(super) fn wall_nearer_than(&self, i: usize, slack_m: f64) -> Option<Vec2> {
        let clearance_m = self.fleet.plant.clearance_m;
        let alpha = self.alphas[i];
        let nearest = self.obstacles.nearest_obstacle(alpha)?;
        (nearest.distance_m - clearance_m < slack_m).then(|| nearest.point - alpha)
    }

    /// Returns the displacements that ram the wall at the relative position `towards`, m.
    pub(super) fn ramming_a_wall(&self, i: usize, towards: Vec2) -> Ramming {
        let brief = &self.fleet.agents[i];
        let at = MethodConditions::for_robot(brief);
        let reach = brief.avoidance.speed_max_m_s * brief.period_ns as f64 / 1e9; // V
        let wall_distance_m = towards.norm();
        let excess =
            wall_approach_slack_fraction(&at) * (wall_deflection_distance_m(&at) - wall_distance_m);
        let lambda = (excess + reach * RAMMING_ANGLE_RAD.cos()).max(0.0);
        Ramming {
            // Left of the direction from the wall is right of the direction to the wall.
            requested_direction: rotate(
                -RAMMING_ANGLE_RAD,
                towards / wall_distance_m.max(f64::MIN_POSITIVE),
            ),
            p_n: excess.max(-reach * RAMMING_ANGLE_RAD.cos()),
            p_t: reach * RAMMING_ANGLE_RAD.sin() + lambda,
        }
    }
}
