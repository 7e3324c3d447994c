//! Random start poses, drawn from a seed. Front points are uniformly distributed over one box for all robots, or over a
//! box around each robot's start in the scenario. They keep the requested distance from each other (Assumption 1) and
//! the clearance of the scenario from walls. Headings are uniformly distributed. Optionally, the goals are the starts
//! of other robots, in random pairs.
//!
//! The draw depends only on the seed, the box, the walls and the number of robots. Runs that differ in anything else
//! have the same starts and can be compared seed by seed.

use std::f64::consts::PI;

use crate::campaign::keys;
pub use crate::campaign::keys::GoalAssignment;
use crate::check::start_front_points;
use crate::scenario::Scenario;
use crate::scenario::diagnostic::Diagnostic;
use crate::scenario::fields::kinds;
use crate::scenario::table::TypedValue;
use formation::Vec2;
use formation::front_point::rotate;
use formation::pose::Pose;
use formation::random::SplitMix64;

/// Stream constant that makes the draw independent of other draws with the same seed.
const STARTS_STREAM: u64 = u64::from_le_bytes(*b"starts  ");
const SWAPS_STREAM: u64 = u64::from_le_bytes(*b"swaps   ");
/// Maximum number of draws for one robot, and of attempts for all of them, before the box counts as too small.
const DRAWS_MAX: usize = 1000;
/// Margin added to the minimum distance, m. It covers the rounding of the written poses.
const ROUNDING_MARGIN_M: f64 = 1e-9;

/// Center of the box.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum BoxCenter {
    /// One box for all robots, around this point, m. `None`: around the mean of the front points in the scenario.
    Common(Option<[f64; 2]>),
    /// One box for each robot, around its front point in the scenario.
    PerRobot,
}

/// Box from which starts are drawn.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct RandomStarts {
    /// Width and height, m.
    pub box_m: [f64; 2],
    /// Minimum distance of two front points, m.
    pub separation_min_m: f64,
    /// Center of the box.
    pub box_center: BoxCenter,
    /// Goals of the robots.
    pub goals: GoalAssignment,
}

/// Reason why no starts could be drawn.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[expect(missing_docs, reason = "the messages say what the fields are")]
pub enum StartsError {
    /// The requested distance violates Assumption 1.
    #[error(
        "`apart_m` is {apart_m}, and d is {d_m}: Assumption 1 requires starts that are more than d apart"
    )]
    SeparationTooSmall { apart_m: f64, d_m: f64 },
    /// The robots do not fit into the box.
    #[error("{robots} robots {apart_m} m apart do not fit in a box of {} m by {} m with seed {seed}", .box_m[0], .box_m[1])]
    BoxTooSmall { robots: usize, apart_m: f64, box_m: [f64; 2], seed: u64 },
}

impl RandomStarts {
    pub(crate) fn read(
        value: &TypedValue<'_, kinds::Table<keys::Starts>>,
    ) -> Result<RandomStarts, Diagnostic> {
        let table = value.table()?;
        let sides = table.required_value(keys::Starts::box_m)?;
        let box_m = sides.pair()?;
        if box_m.iter().any(|side| *side <= 0.0) {
            return Err(sides
                .error_about_key("has a side without length", "expected two lengths above 0 m"));
        }
        let center = table.get(keys::Starts::center_m);
        let each = table.read_word(keys::Starts::around)? == "each";
        let box_center = match (each, &center) {
            (true, Some(center)) => {
                return Err(center.error_about_key(
                    "has no effect with `around = \"each\"`",
                    "expected no `center_m`: each box is around its robot's own start",
                ));
            }
            (true, None) => BoxCenter::PerRobot,
            _ => BoxCenter::Common(center.map(|center| center.pair()).transpose()?),
        };
        Ok(RandomStarts {
            box_m,
            separation_min_m: table.number(keys::Starts::apart_m)?,
            box_center,
            goals: table.read_word(keys::Starts::goals)?,
        })
    }

    /// Returns the start poses and goals that `seed` draws for the robots of a scenario, in the syntax of `--set`.
    ///
    /// # Errors
    ///
    /// The distance violates Assumption 1, or no placement was found.
    pub fn draw(&self, scenario: &Scenario, seed: u64) -> Result<Vec<String>, StartsError> {
        let d_m = scenario.avoidance.distance_min_m;
        if self.separation_min_m <= d_m {
            return Err(StartsError::SeparationTooSmall { apart_m: self.separation_min_m, d_m });
        }
        let robots = &scenario.robots;
        let scenario_points = start_front_points(robots);
        let same_for_all = |at: Vec2| vec![at; robots.len()];
        let centers = match self.box_center {
            BoxCenter::PerRobot => scenario_points,
            BoxCenter::Common(Some([x, y])) => same_for_all(Vec2::new(x, y)),
            BoxCenter::Common(None) => {
                same_for_all(scenario_points.iter().sum::<Vec2>() / robots.len() as f64)
            }
        };
        let walls = scenario.obstacles();
        let clearance_m = scenario.avoidance.clearance_m + ROUNDING_MARGIN_M;
        let is_clear =
            |at: Vec2| walls.nearest_obstacle(at).is_none_or(|wall| wall.distance_m >= clearance_m);
        let mut random = SplitMix64::new(seed ^ STARTS_STREAM);
        let positions = self.draw_positions(&mut random, &centers, is_clear).ok_or(
            StartsError::BoxTooSmall {
                robots: robots.len(),
                apart_m: self.separation_min_m,
                box_m: self.box_m,
                seed,
            },
        )?;
        let mut assignments = Vec::new();
        if self.goals == GoalAssignment::Swaps {
            let mut random = SplitMix64::new(seed ^ SWAPS_STREAM);
            for (robot, to) in robots.iter().zip(draw_partners(&mut random, robots.len())) {
                let goal = positions[to];
                assignments
                    .push(format!("robot.{}.goal_m=[{:?}, {:?}]", robot.name, goal.x, goal.y));
            }
        }
        let start = |(position, robot): (Vec2, &crate::scenario::Robot)| {
            // Maps [0, 1) to (-pi, pi].
            let heading_rad = PI - 2.0 * PI * random.draw_unit();
            let ahead = robot.front_point_m * rotate(heading_rad, Vec2::x());
            let axle = position - ahead;
            start_assignment(&robot.name, Pose { x_m: axle.x, y_m: axle.y, heading_rad })
        };
        assignments.extend(positions.into_iter().zip(robots).map(start));
        Ok(assignments)
    }

    /// Draws points in the boxes around `centers` for which `is_clear` returns true, or returns `None` if there is no
    /// room.
    fn draw_positions(
        &self,
        random: &mut SplitMix64,
        centers: &[Vec2],
        is_clear: impl Fn(Vec2) -> bool,
    ) -> Option<Vec<Vec2>> {
        let [width, height] = self.box_m;
        for _ in 0..DRAWS_MAX {
            let mut positions: Vec<Vec2> = Vec::new();
            for _ in 0..DRAWS_MAX {
                let Some(center) = centers.get(positions.len()) else { return Some(positions) };
                let [x, y] = [width, height].map(|side| side * (random.draw_unit() - 0.5));
                let position = center + Vec2::new(x, y);
                let is_separated = |other: &Vec2| {
                    (position - other).norm() >= self.separation_min_m + ROUNDING_MARGIN_M
                };
                if positions.iter().all(is_separated) && is_clear(position) {
                    positions.push(position);
                }
            }
        }
        None
    }
}

/// Returns the start of a robot in the syntax of `--set`.
pub(crate) fn start_assignment(robot: &str, pose: Pose) -> String {
    let Pose { x_m, y_m, heading_rad } = pose;
    format!("robot.{robot}.pose={{ x_m = {x_m:?}, y_m = {y_m:?}, heading_rad = {heading_rad:?} }}")
}

/// Returns the exchange partners: in random order, the first robot with the second, and so on. The last three of an odd
/// number exchange cyclically. A single robot stays.
fn draw_partners(random: &mut SplitMix64, robots: usize) -> Vec<usize> {
    let mut order: Vec<usize> = (0..robots).collect();
    for last in (1..robots).rev() {
        order.swap(last, random.draw_between(0, last as u64) as usize);
    }
    let mut partners = vec![0; robots];
    let mut rest = &order[..];
    while !rest.is_empty() {
        let (group, others) = rest.split_at(if rest.len() == 3 { 3 } else { rest.len().min(2) });
        for (index, &robot) in group.iter().enumerate() {
            partners[robot] = group[(index + 1) % group.len()];
        }
        rest = others;
    }
    partners
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::examples::row_of_three;
    use crate::scenario::Wall;
    use formation::front_point::front_point;
    use formation::obstacle::Obstacle;
    use proptest::prelude::*;

    const STARTS: RandomStarts = RandomStarts {
        box_m: [2.0, 1.0],
        separation_min_m: 0.3,
        box_center: BoxCenter::Common(Some([5.0, -1.0])),
        goals: GoalAssignment::Own,
    };

    #[test]
    fn start_box_too_small_or_against_assumption_1_is_refused() {
        let scenario = row_of_three();
        let small = RandomStarts { box_m: [0.2, 0.2], ..STARTS };
        assert!(matches!(
            small.draw(&scenario, 1),
            Err(StartsError::BoxTooSmall { robots: 3, .. })
        ));
        let near = RandomStarts { separation_min_m: 0.2, ..STARTS };
        assert!(
            matches!(near.draw(&scenario, 1), Err(StartsError::SeparationTooSmall { .. })),
            "d is 0.2 m"
        );
    }

    #[test]
    fn box_without_a_center_is_around_the_scenario_starts() {
        let scenario = row_of_three();
        let around_own =
            RandomStarts { box_center: BoxCenter::Common(None), ..STARTS }.draw(&scenario, 3);
        let mean = scenario_starts(&scenario).iter().sum::<Vec2>() / 3.0;
        let with_center =
            RandomStarts { box_center: BoxCenter::Common(Some([mean.x, mean.y])), ..STARTS };
        assert_eq!(around_own.unwrap(), with_center.draw(&scenario, 3).unwrap());
    }

    fn scenario_starts(scenario: &Scenario) -> Vec<Vec2> {
        scenario.robots.iter().map(|robot| front_point(robot.start, robot.front_point_m)).collect()
    }

    /// Returns the front point of a start, 0.1 m ahead of the axle.
    fn parse_front_point(text: &str) -> Vec2 {
        let heading = parse_number(text, "heading_rad");
        assert!(-PI < heading && heading <= PI);
        let axle = Vec2::new(parse_number(text, "x_m"), parse_number(text, "y_m"));
        axle + 0.1 * Vec2::new(heading.cos(), heading.sin())
    }

    fn parse_front_points(drawn: &[String]) -> Vec<Vec2> {
        drawn.iter().map(|text| parse_front_point(text)).collect()
    }

    #[test]
    fn around_each_draws_starts_near_its_own_and_clear_of_walls() {
        let mut scenario = row_of_three();
        let starts = scenario_starts(&scenario);
        let center_m = (starts[1] + Vec2::new(0.0, 0.1)).into();
        scenario.walls.push(Wall {
            name: "obstacle 1".into(),
            path: "obstacle.0".into(),
            shape: Obstacle::Disc { center_m, radius_m: 0.05 },
        });
        let clearance_m = 0.1;
        scenario.avoidance.clearance_m = clearance_m;
        let each = RandomStarts {
            box_m: [0.4, 0.6],
            separation_min_m: 0.21,
            box_center: BoxCenter::PerRobot,
            goals: GoalAssignment::Own,
        };
        let mut near = 0;
        for seed in 1..=50 {
            for (at, own) in
                parse_front_points(&each.draw(&scenario, seed).unwrap()).iter().zip(&starts)
            {
                let offset = at - own;
                assert!(offset.x.abs() <= 0.2 + 1e-9 && offset.y.abs() <= 0.3 + 1e-9, "{offset}");
                let wall_distance_m =
                    scenario.obstacles().nearest_obstacle(*at).unwrap().distance_m;
                assert!(wall_distance_m >= clearance_m, "{wall_distance_m}");
                near += usize::from(wall_distance_m < 2.0 * clearance_m);
            }
        }
        assert!(near > 20, "the wall is in the way: {near}");
    }

    /// Checks that the goals are a permutation of the starts and that no robot keeps its own.
    #[test]
    fn swaps_are_of_pairs_and_of_three_where_the_number_is_odd() {
        for robots in 2..12 {
            let partners = draw_partners(&mut SplitMix64::new(robots as u64), robots);
            let steps = |robot: usize| {
                let mut at = partners[robot];
                let mut steps = 1;
                while at != robot {
                    (at, steps) = (partners[at], steps + 1);
                }
                steps
            };
            let threes = (0..robots).filter(|robot| steps(*robot) == 3).count();
            let twos = (0..robots).filter(|robot| steps(*robot) == 2).count();
            assert_eq!((threes, threes + twos), (3 * (robots % 2), robots), "{partners:?}");
        }
        assert_eq!(draw_partners(&mut SplitMix64::new(0), 1), [0]);
        let first = |seed| draw_partners(&mut SplitMix64::new(seed), 8);
        assert!((1..20).any(|seed| first(seed) != first(0)));
    }

    #[test]
    fn swapped_goals_are_starts_of_others_and_keep_the_starts() {
        let scenario = row_of_three();
        let swapping = RandomStarts { goals: GoalAssignment::Swaps, ..STARTS };
        let drawn = swapping.draw(&scenario, 4).unwrap();
        assert_eq!(drawn[3..], STARTS.draw(&scenario, 4).unwrap());
        let starts = parse_front_points(&drawn[3..]);
        for (own, text) in starts.iter().zip(&drawn) {
            let (_, pair) = text.split_once(".goal_m=[").unwrap();
            let (x, y) = pair.trim_end_matches(']').split_once(", ").unwrap();
            let goal = Vec2::new(x.parse().unwrap(), y.parse().unwrap());
            assert!(starts.iter().any(|start| (start - goal).norm() < 1e-9), "{text}");
            assert!((own - goal).norm() > 0.2, "{text}");
        }
    }

    fn parse_number(text: &str, key: &str) -> f64 {
        let (_, rest) = text.split_once(&format!("{key} = ")).unwrap();
        rest.split([',', ' ']).next().unwrap().parse().unwrap()
    }

    proptest! {
        #[test]
        fn every_seed_draws_distinct_starts_in_box(seed in any::<u64>()) {
            let drawn = STARTS.draw(&row_of_three(), seed).unwrap();
            prop_assert_eq!(&drawn, &STARTS.draw(&row_of_three(), seed).unwrap());
            prop_assert!(drawn != STARTS.draw(&row_of_three(), seed ^ 1).unwrap());
            let points = parse_front_points(&drawn);
            for (i, point) in points.iter().enumerate() {
                prop_assert!((point.x - 5.0).abs() <= 1.0 + 1e-9 && (point.y + 1.0).abs() <= 0.5 + 1e-9);
                for other in &points[..i] {
                    prop_assert!((point - other).norm() >= 0.3);
                }
            }
        }
    }
}
