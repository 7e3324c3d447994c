//! Robots that had not arrived at the end, and the robot that blocks each.

use experiment::scenario::Scenario;
use formation::Vec2;
use formation::obstacle::Obstacles;
use serde::{Deserialize, Serialize};

/// Factor on the steering distance: another robot within this multiple of it, in its path, blocks a robot.
const BLOCKING_FACTOR: f64 = 1.1;

/// A robot outside its slot that another robot blocks.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct BlockedRobot {
    /// Name of the robot.
    pub robot: String,
    /// Distance from its slot, m.
    pub error_m: f64,
    /// Name of the blocking robot or, for [`BlockReason::Wall`], of the blocking wall or obstacle.
    pub for_robot: String,
    /// Kind of the block. `taken`: the robot is in the slot; `blocked`: the robot is on the way to it; `wall`: a
    /// wall is on the way.
    pub why: BlockReason,
    /// Whether the blocking robot is alive; `true` for a wall.
    pub lives: bool,
}

/// Reason why a robot is blocked.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum BlockReason {
    /// The other robot is in the slot.
    Taken,
    /// The other robot is on the way to the slot.
    Blocked,
    /// A wall or obstacle is on the way to the slot.
    Wall,
}

impl BlockedRobot {
    /// Formats the pair as part of a sentence: `r2 by r1 (dead) in its slot`.
    pub fn describe(&self) -> String {
        let BlockedRobot { robot, for_robot, why, lives, .. } = self;
        let dead = if *lives { "" } else { " (dead)" };
        let why = match why {
            BlockReason::Taken => "in its slot",
            BlockReason::Blocked | BlockReason::Wall => "in its path",
        };
        format!("{robot} by {for_robot}{dead} {why}")
    }
}

/// Detector of blocked robots: the steering distance of each robot, and the error below which a robot has arrived.
pub(super) struct BlockDetector {
    names: Vec<String>,
    avoidance_radii_m: Vec<f64>,
    converged_error_m: f64,
    walls: Obstacles,
    wall_names: Vec<String>,
    /// Distance from a wall within which avoidance steers, m.
    wall_avoidance_radius_m: f64,
}

impl BlockDetector {
    pub(super) fn new(scenario: &Scenario) -> BlockDetector {
        let robots = scenario.robots.len();
        BlockDetector {
            names: scenario.robots.iter().map(|robot| robot.name.clone()).collect(),
            avoidance_radii_m: scenario.steering_distances_m().unwrap_or_else(|| vec![0.0; robots]),
            converged_error_m: scenario.expectations.converged_error_m,
            walls: scenario.obstacles(),
            wall_names: scenario.walls.iter().map(|wall| wall.name.clone()).collect(),
            wall_avoidance_radius_m: scenario
                .avoidance_method
                .wall_steering_distance
                .map_or(0.0, |(_, distance_m)| distance_m(&scenario.avoidance_conditions())),
        }
    }

    /// Returns the living robots that are off their slots by `errors`, m, and that another robot blocks in the slot
    /// or on the way.
    pub(super) fn find_blocked_robots(
        &self,
        alphas: &[Vec2],
        errors: &[Option<Vec2>],
        alive: &[bool],
    ) -> Vec<BlockedRobot> {
        let is_off_slot =
            |i: &usize| alive[*i] && errors[*i].is_some_and(|e| e.norm() >= self.converged_error_m);
        (0..alphas.len())
            .filter(is_off_slot)
            .filter_map(|i| self.find_blocking(i, alphas, errors[i]?, alive))
            .collect()
    }

    fn find_blocking(
        &self,
        i: usize,
        alphas: &[Vec2],
        error: Vec2,
        alive: &[bool],
    ) -> Option<BlockedRobot> {
        let avoidance_radius_m = self.avoidance_radii_m[i];
        let slot = alphas[i] - error;
        let other_robots = || (0..alphas.len()).filter(|&j| j != i);
        let nearest_to_point = |point: Vec2| {
            let gap_m = move |j: &usize| (alphas[*j] - point).norm();
            (gap_m, other_robots().min_by(|a, b| gap_m(a).total_cmp(&gap_m(b))))
        };
        let (gap_m, nearest_robot) = nearest_to_point(slot);
        let slot_occupant = nearest_robot
            .filter(|j| gap_m(j) < avoidance_radius_m)
            .map(|j| (j, BlockReason::Taken));
        let is_in_path = |j: &usize| {
            let z = alphas[i] - alphas[*j];
            z.norm() < BLOCKING_FACTOR * avoidance_radius_m && z.dot(&error) > 0.0
        };
        let nearest_in_path = || {
            let gap_m = |j: &usize| (alphas[i] - alphas[*j]).norm();
            let blocking = other_robots().filter(is_in_path);
            blocking.min_by(|a, b| gap_m(a).total_cmp(&gap_m(b))).map(|j| (j, BlockReason::Blocked))
        };
        let Some((j, why)) = slot_occupant.or_else(nearest_in_path) else {
            return self.find_blocking_wall(i, alphas[i], error);
        };
        Some(BlockedRobot {
            robot: self.names[i].clone(),
            error_m: error.norm(),
            for_robot: self.names[j].clone(),
            why,
            lives: alive[j],
        })
    }

    /// Returns the block of a robot that has a wall between it and its slot; `None` if no wall is near.
    fn find_blocking_wall(&self, i: usize, alpha: Vec2, error: Vec2) -> Option<BlockedRobot> {
        let reach_m = BLOCKING_FACTOR * self.wall_avoidance_radius_m;
        let mut walls_in_reach = self.walls.obstacles_within(alpha, reach_m).collect::<Vec<_>>();
        walls_in_reach.sort_by(|a, b| a.distance_m.total_cmp(&b.distance_m));
        // The wall must be more ahead of the robot than to its side.
        let is_ahead = |point: Vec2, distance_m: f64| {
            (alpha - point).dot(&error) > 0.5 * distance_m * error.norm()
        };
        let wall = walls_in_reach.into_iter().find(|wall| is_ahead(wall.point, wall.distance_m))?;
        Some(BlockedRobot {
            robot: self.names[i].clone(),
            error_m: error.norm(),
            for_robot: self.wall_names[wall.index].clone(),
            why: BlockReason::Wall,
            lives: true,
        })
    }
}
