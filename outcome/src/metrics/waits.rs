//! Who had not arrived at the end, and for whom it waits.

use experiment::scenario::Scenario;
use formation::Vec2;
use formation::obstacle::Obstacles;
use serde::{Deserialize, Serialize};

/// Nearer than this share beyond the distance at which it steers, another holds a robot up.
const HELD_UP: f64 = 1.1;

/// One robot that is not where its role wants it.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Wait {
    /// Who.
    pub robot: String,
    /// How far off its place, m.
    pub error_m: f64,
    /// The robot that is on its place or in its way; for [`Why::Wall`], the wall or obstacle in its way.
    pub for_robot: String,
    /// `taken`: that robot is on its place. `blocked`: it is in its way. `wall`: a wall is in its way.
    pub why: Why,
    /// Whether that robot lives; `true` for a wall.
    pub lives: bool,
}

/// Why somebody waits.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Why {
    /// The other is on its place.
    Taken,
    /// The other is in its way.
    Blocked,
    /// A wall or obstacle is in its way.
    Wall,
}

impl Wait {
    /// In a sentence's part: `r2 for r1, dead, on its place`.
    pub fn in_words(&self) -> String {
        let Wait { robot, for_robot, why, lives, .. } = self;
        let dead = if *lives { "" } else { ", dead," };
        let why = match why {
            Why::Taken => "on its place",
            Why::Blocked | Why::Wall => "in its way",
        };
        format!("{robot} for {for_robot}{dead} {why}")
    }
}

/// From which distance others make each robot steer, and which errors are none.
pub(super) struct Waits {
    names: Vec<String>,
    steers_within_m: Vec<f64>,
    converged_error_m: f64,
    walls: Obstacles,
    wall_names: Vec<String>,
    /// Distance from a wall within which avoidance steers, m.
    steers_beside_walls_m: f64,
}

impl Waits {
    pub(super) fn new(scenario: &Scenario) -> Waits {
        let steers = |i| scenario.steers_within_m(i).unwrap_or(0.0);
        Waits {
            names: scenario.robots.iter().map(|robot| robot.name.clone()).collect(),
            steers_within_m: (0..scenario.robots.len()).map(steers).collect(),
            converged_error_m: scenario.expect.converged_error_m,
            walls: scenario.obstacles(),
            wall_names: scenario.walls.iter().map(|wall| wall.name.clone()).collect(),
            steers_beside_walls_m: scenario
                .method
                .steers_beside_walls
                .map_or(0.0, |(_, distance_m)| distance_m(&scenario.conditions())),
        }
    }

    /// Of the living that are off their places by `errors`, m: those with another on their place or in their
    /// way.
    pub(super) fn at(&self, alphas: &[Vec2], errors: &[Option<Vec2>], alive: &[bool]) -> Vec<Wait> {
        let off =
            |i: &usize| alive[*i] && errors[*i].is_some_and(|e| e.norm() >= self.converged_error_m);
        (0..alphas.len())
            .filter(off)
            .filter_map(|i| self.wait_of(i, alphas, errors[i]?, alive))
            .collect()
    }

    fn wait_of(&self, i: usize, alphas: &[Vec2], error: Vec2, alive: &[bool]) -> Option<Wait> {
        let steers_m = self.steers_within_m[i];
        let place = alphas[i] - error;
        let others = || (0..alphas.len()).filter(|&j| j != i);
        let nearest_to = |point: Vec2| {
            let gap_m = move |j: &usize| (alphas[*j] - point).norm();
            (gap_m, others().min_by(|a, b| gap_m(a).total_cmp(&gap_m(b))))
        };
        let (gap_m, on_it) = nearest_to(place);
        let taken = on_it.filter(|j| gap_m(j) < steers_m).map(|j| (j, Why::Taken));
        let blocks = |j: &usize| {
            let z = alphas[i] - alphas[*j];
            z.norm() < HELD_UP * steers_m && z.dot(&error) > 0.0
        };
        let in_the_way = || {
            let gap_m = |j: &usize| (alphas[i] - alphas[*j]).norm();
            let blocking = others().filter(blocks);
            blocking.min_by(|a, b| gap_m(a).total_cmp(&gap_m(b))).map(|j| (j, Why::Blocked))
        };
        let Some((j, why)) = taken.or_else(in_the_way) else {
            return self.wait_for_wall(i, alphas[i], error);
        };
        Some(Wait {
            robot: self.names[i].clone(),
            error_m: error.norm(),
            for_robot: self.names[j].clone(),
            why,
            lives: alive[j],
        })
    }

    /// Returns the wait of a robot that has a wall between it and its place; `None` if there is none near.
    fn wait_for_wall(&self, i: usize, alpha: Vec2, error: Vec2) -> Option<Wait> {
        let reach_m = HELD_UP * self.steers_beside_walls_m;
        let mut near = self.walls.within(alpha, reach_m).collect::<Vec<_>>();
        near.sort_by(|a, b| a.distance_m.total_cmp(&b.distance_m));
        // More ahead of it than beside it.
        let ahead = |point: Vec2, distance_m: f64| {
            (alpha - point).dot(&error) > 0.5 * distance_m * error.norm()
        };
        let wall = near.into_iter().find(|near| ahead(near.point, near.distance_m))?;
        Some(Wait {
            robot: self.names[i].clone(),
            error_m: error.norm(),
            for_robot: self.wall_names[wall.index].clone(),
            why: Why::Wall,
            lives: true,
        })
    }
}
