//! Goals behind walls. Avoidance steers a robot along a wall toward the side of its goal. It is no path planner: a
//! robot in front of a wall that blocks the way to its goal stays there.

use formation::Vec2;
use formation::obstacle::Obstacles;

use super::finding::{Finding, warning_finding};
use super::start_front_points;
use crate::scenario::Scenario;
use protocol::number::format_short;

/// Number of simulation steps per clearance.
const STEPS_PER_CLEARANCE: f64 = 8.0;
/// Maximum number of steps of one simulated path.
const STEPS_MAX: usize = 100_000;
/// Number of steps after which a robot must be closer to its goal.
const PROGRESS_CHECK_STEPS: usize = 64;
/// Fraction of the distance to the goal by which a disturbed robot must be closer than before.
const GOAL_PROGRESS_FRACTION_MIN: f64 = 1e-3;
/// Minimum progress toward the goal, as a fraction of the path length of a round of steps.
const PATH_PROGRESS_FRACTION_MIN: f64 = 1e-3;

/// Point at which a wall blocks a robot.
#[derive(Debug, Clone, Copy, PartialEq)]
struct DeadEnd {
    position: Vec2,
    /// Distance from the point to the goal, m.
    remaining_distance_m: f64,
    /// Index of the wall.
    wall: usize,
}

/// Warns about every goal that a robot does not reach by going straight to it and along walls.
pub(super) fn check_dead_ends(scenario: &Scenario) -> Vec<Finding> {
    let steering = scenario.avoidance_method.wall_steering_distance.zip(scenario.goals_m());
    let Some(((_, distance_m), goals)) = steering else { return Vec::new() };
    if scenario.walls.is_empty() {
        return Vec::new();
    }
    let (walls, bound_m) = (scenario.obstacles(), distance_m(&scenario.avoidance_conditions()));
    let clearance_m = scenario.avoidance.clearance_m;
    let starts = start_front_points(&scenario.robots);
    let routes = scenario.robots.iter().zip(starts.into_iter().zip(goals));
    routes.filter_map(|(robot, (start, goal))| {
        // Another check warns about a goal that is too close to a wall.
        if walls.nearest_obstacle(goal).is_some_and(|near| near.distance_m < bound_m) {
            return None;
        }
        let DeadEnd { position, remaining_distance_m, wall } = find_dead_end(&walls, start, goal, clearance_m)?;
        let (name, wall) = (&robot.name, &scenario.walls[wall].name);
        let [x, y, remaining] = [position.x, position.y, remaining_distance_m].map(|m| format_short((m * 1e2).round() / 1e2));
        Some(warning_finding(
            format!("robot.{name}.goal_m"),
            format!(
                "{wall} is between {name} and its goal: {name} moves along it to ({x}, {y}) m, and stops there permanently, {remaining} m from the goal"
            ),
            "expected a goal that is reached straight ahead and along walls, because avoidance plans no path around walls",
        ))
    })
    .collect()
}

/// Simulates a robot that goes straight to its goal, and along walls in its way. Returns the point at which it makes no
/// more progress, also after a disturbance by one clearance, or `None` if it arrives.
fn find_dead_end(walls: &Obstacles, start: Vec2, goal: Vec2, clearance_m: f64) -> Option<DeadEnd> {
    let step_m = clearance_m / STEPS_PER_CLEARANCE;
    let arrives = |position: Vec2| (goal - position).norm() <= step_m;
    // One round of steps. It ends at the goal.
    let follow = |mut position: Vec2| {
        for _ in 0..PROGRESS_CHECK_STEPS {
            if arrives(position) {
                break;
            }
            position += admissible_velocity(
                walls,
                position,
                (goal - position).normalize(),
                clearance_m + step_m,
            ) * step_m;
            position = move_off_walls(walls, position, clearance_m);
        }
        position
    };
    let mut position = start;
    for _ in 0..STEPS_MAX / PROGRESS_CHECK_STEPS {
        let remaining_m = (goal - position).norm();
        let next = follow(position);
        if arrives(next) {
            return None;
        }
        if (goal - next).norm()
            < remaining_m - PATH_PROGRESS_FRACTION_MIN * step_m * PROGRESS_CHECK_STEPS as f64
        {
            position = next;
            continue;
        }
        // In front of a disc or a corner, the smallest disturbance leads past it.
        let (ahead, remaining_m) = ((goal - next).normalize(), (goal - next).norm());
        let sidestep = Vec2::new(-ahead.y, ahead.x) * clearance_m;
        let after_sidestep = [sidestep, -sidestep]
            .map(|sidestep| follow(move_off_walls(walls, next + sidestep, clearance_m)));
        let closer = after_sidestep.into_iter().find(|position| {
            (goal - position).norm() < remaining_m * (1.0 - GOAL_PROGRESS_FRACTION_MIN)
        });
        let Some(closer) = closer else {
            let wall = walls.nearest_obstacle(next)?.index;
            return Some(DeadEnd { position: next, remaining_distance_m: remaining_m, wall });
        };
        if arrives(closer) {
            return None;
        }
        position = closer;
    }
    None
}

/// Returns the point moved away from the nearest wall, to the clearance, if it is nearer.
fn move_off_walls(walls: &Obstacles, position: Vec2, clearance_m: f64) -> Vec2 {
    match walls
        .nearest_obstacle(position)
        .filter(|nearest| nearest.distance_m < clearance_m && nearest.distance_m > 0.0)
    {
        Some(nearest) => {
            nearest.point + (position - nearest.point) * (clearance_m / nearest.distance_m)
        }
        None => position,
    }
}

/// Returns the admissible velocity nearest to the unit vector `ahead`: none of it leads nearer to a wall within
/// `reach_m`.
fn admissible_velocity(walls: &Obstacles, position: Vec2, ahead: Vec2, reach_m: f64) -> Vec2 {
    let obstacles = walls.obstacles_within(position, reach_m).filter(|near| near.distance_m > 0.0);
    let normals: Vec<Vec2> =
        obstacles.map(|near| (position - near.point) / near.distance_m).collect();
    let fits = |v: &Vec2| normals.iter().all(|normal| normal.dot(v) >= -1e-9);
    let along = normals.iter().map(|normal| ahead - normal * normal.dot(&ahead));
    let candidates = std::iter::once(ahead).chain(along).filter(fits);
    let best = candidates.max_by(|a, b| a.dot(&ahead).total_cmp(&b.dot(&ahead)));
    best.unwrap_or_else(Vec2::zeros)
}

#[cfg(test)]
mod tests {
    use super::*;
    use formation::obstacle::Obstacle;

    fn find_dead_end_at_walls(
        walls: &[Obstacle],
        start: [f64; 2],
        goal: [f64; 2],
    ) -> Option<DeadEnd> {
        find_dead_end(&Obstacles::new(walls), start.into(), goal.into(), 0.1)
    }

    #[test]
    fn goal_straight_behind_a_wall_is_a_dead_end() {
        let wall = [Obstacle::segment([0.0, -3.0], [0.0, 1.0])];
        let found = find_dead_end_at_walls(&wall, [-2.0, 0.0], [2.0, 0.0]).expect("a dead end");
        assert!((found.position - Vec2::new(-0.1, 0.0)).norm() < 0.03, "{found:?}");
        assert!((found.remaining_distance_m - 2.1).abs() < 0.03, "{found:?}");
        // It slides along to where the wall is nearest to the goal.
        let found = find_dead_end_at_walls(&wall, [-2.0, 2.5], [2.0, -1.0]).expect("a dead end");
        assert!((found.position - Vec2::new(-0.1, -1.0)).norm() < 0.1, "{found:?}");
    }

    #[test]
    fn goals_beside_a_wall_and_around_its_end_are_reached() {
        let wall = [Obstacle::segment([0.0, -3.0], [0.0, 1.0])];
        for (start, goal) in
            [([-2.0, 2.0], [2.0, 2.0]), ([-2.0, 0.0], [-0.5, 0.9]), ([-2.0, 0.0], [2.0, 3.0])]
        {
            assert_eq!(find_dead_end_at_walls(&wall, start, goal), None, "{start:?} {goal:?}");
        }
        let disc = [Obstacle::Disc { center_m: [0.0, 0.0], radius_m: 0.5 }];
        for lateral_m in [0.0, 1e-9, 0.01, 0.1] {
            assert_eq!(
                find_dead_end_at_walls(&disc, [-2.0, lateral_m], [2.0, 0.0]),
                None,
                "{lateral_m} m"
            );
        }
    }

    #[test]
    fn room_without_a_door_is_a_dead_end() {
        let corners = [[1.0, -1.0], [3.0, -1.0], [3.0, 1.0], [1.0, 1.0], [1.0, -1.0]];
        let walls: Vec<_> =
            corners.windows(2).map(|ends| Obstacle::segment(ends[0], ends[1])).collect();
        let found = find_dead_end_at_walls(&walls, [-2.0, 0.3], [2.0, 0.0]).expect("a dead end");
        assert!((found.remaining_distance_m - 1.1).abs() < 0.05, "{found:?}");
    }
}
