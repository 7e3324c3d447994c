//! Teams: robots with different sizes, speed limits or command timeouts.
//!
//! Two robots i and j keep the distance d_ij = keep_i + keep_j. The values of `avoidance` in a scenario are those of
//! the team: the largest d_ij and the highest speed limit. A figure that holds for them holds for all robots.

use std::borrow::Cow;

use protocol::avoidance::MethodConditions;
use protocol::brief::{AvoidanceBrief, MemberBrief, Pace, RobotClassBrief};

use super::{Robot, Scenario, ns_to_seconds};

/// Maximum number of different pairs of size and speed limit that robots can sense.
pub const CLASSES_MAX: usize = 256;

/// Returns the two largest sizes (keep), m; equal if there is one robot.
fn largest_two(robots: &[Robot]) -> [f64; 2] {
    robots.iter().fold([0.0, 0.0], |[first, second], robot| match robot.keep_m > first {
        true => [robot.keep_m, first],
        false => [first, second.max(robot.keep_m)],
    })
}

/// Returns the largest minimum distance of two robots, m, and the highest speed limit, m/s. With fewer than two robots
/// the distance is twice the size.
pub(super) fn largest_distance_and_speed(robots: &[Robot]) -> (f64, f64) {
    let [first, second] = largest_two(robots);
    let second = if robots.len() < 2 { first } else { second };
    let fastest = robots.iter().map(|robot| robot.speed_max_m_s).fold(0.0, f64::max);
    (first + second, fastest)
}

impl Scenario {
    /// Returns `true` if robots have different sizes, speed limits or command timeouts.
    pub fn is_team(&self) -> bool {
        let value = |robot: &Robot| (robot.keep_m, robot.speed_max_m_s, robot.hold_periods);
        self.robots.iter().any(|robot| value(robot) != value(&self.robots[0]))
    }

    /// Returns `true` if robots have different sizes.
    pub fn has_different_sizes(&self) -> bool {
        self.robots.iter().any(|robot| robot.keep_m != self.robots[0].keep_m)
    }

    /// Returns the sizes of the robots, m; empty if they are the same.
    pub fn different_sizes_m(&self) -> Vec<f64> {
        match self.has_different_sizes() {
            true => self.robots.iter().map(|robot| robot.keep_m).collect(),
            false => Vec::new(),
        }
    }

    /// Returns the minimum distance of two robots (d_ij), m.
    pub fn pair_distance_min_m(&self, [i, j]: [usize; 2]) -> f64 {
        self.robots[i].keep_m + self.robots[j].keep_m
    }

    /// Returns the distance that two robots must have at the start, m: the larger one of the two distances that they keep
    /// from each other. It is d_ij, unless the robots of a team do not sense sizes (`proof/Team.v::a_team_keeps_its_distances`).
    pub fn start_distance_min_m(&self, [i, j]: [usize; 2]) -> f64 {
        let sizes_m = self.robots.iter().map(|robot| robot.keep_m);
        match self.classes_sensed || !self.has_different_sizes() {
            true => self.pair_distance_min_m([i, j]),
            false => {
                let larger_m = self.robots[i].keep_m.max(self.robots[j].keep_m);
                larger_m + sizes_m.fold(0.0, f64::max)
            }
        }
    }

    /// Returns H of robot `i`, ns.
    pub fn command_lifetime_ns_of(&self, i: usize, pace: Pace) -> u64 {
        self.lifetime_ns(pace, self.robots[i].hold_periods)
    }

    /// Returns the different pairs of size, m, and speed limit, m/s, in the order of the robots.
    pub fn classes(&self) -> Vec<(f64, f64)> {
        let mut classes = Vec::new();
        for robot in &self.robots {
            let class = (robot.keep_m, robot.speed_max_m_s);
            if !classes.contains(&class) {
                classes.push(class);
            }
        }
        classes
    }

    /// Returns the avoidance parameters of robot `i`: in a team its own speed limit, the largest distance that it
    /// keeps, and what it assumes of the robots of each class. If classes are not sensed, all robots are of one class,
    /// with the largest size and speed of the team.
    pub fn avoidance_of(&self, i: usize, pace: Pace) -> Cow<'_, AvoidanceBrief> {
        self.avoidance_in(&self.team_classes(), i, pace)
    }

    /// Returns the avoidance parameters of each robot, as [`Scenario::avoidance_of`] does.
    pub fn avoidance_of_all(&self, pace: Pace) -> Vec<Cow<'_, AvoidanceBrief>> {
        let classes = self.team_classes();
        (0..self.robots.len()).map(|i| self.avoidance_in(&classes, i, pace)).collect()
    }

    /// Returns the different pairs of size, m, and speed limit, m/s, that the robots of a team distinguish; none if all
    /// robots are the same.
    fn team_classes(&self) -> Vec<(f64, f64)> {
        let maximum = |a: (f64, f64), b: &(f64, f64)| (a.0.max(b.0), a.1.max(b.1));
        match (self.is_team(), self.classes_sensed) {
            (false, _) => Vec::new(),
            (true, true) => self.classes(),
            (true, false) => vec![self.classes().iter().fold((0.0, 0.0), maximum)],
        }
    }

    fn avoidance_in(
        &self,
        classes: &[(f64, f64)],
        i: usize,
        pace: Pace,
    ) -> Cow<'_, AvoidanceBrief> {
        if classes.is_empty() {
            return Cow::Borrowed(&self.avoidance);
        }
        let mut avoidance = self.avoidance.clone();
        let robot = &self.robots[i];
        let class = |&(keep_m, speed_max_m_s): &(f64, f64)| RobotClassBrief {
            distance_min_m: robot.keep_m + keep_m,
            speed_max_m_s,
        };
        avoidance.classes = classes.iter().map(class).collect();
        let distances_m = avoidance.classes.iter().map(|class| class.distance_min_m);
        avoidance.distance_min_m = distances_m.fold(0.0, f64::max);
        avoidance.speed_max_m_s = robot.speed_max_m_s;
        avoidance.command_timeout_max_s = ns_to_seconds(self.command_lifetime_ns(pace));
        Cow::Owned(avoidance)
    }

    /// Returns the conditions of robot `i` with the avoidance parameters [`Scenario::avoidance_of`] and the larger H of
    /// lockstep and real time.
    pub fn conditions_of<'a>(
        &self,
        i: usize,
        avoidance: &'a AvoidanceBrief,
    ) -> MethodConditions<'a> {
        let lifetimes = [Pace::Lockstep, Pace::Realtime];
        let lifetime_ns = lifetimes.map(|pace| self.command_lifetime_ns_of(i, pace));
        MethodConditions {
            avoidance,
            period_s: ns_to_seconds(self.period_ns),
            command_timeout_s: ns_to_seconds(lifetime_ns[0].max(lifetime_ns[1])),
            front_point_m: self.robots[i].front_point_m,
            moves_along_heading: self.robots[i].drive().moves_along_heading(),
            rank: self.yield_rank(i),
        }
    }

    /// Returns the data of robot `i` for the plant as a member of a team; `None` if all robots have the same size,
    /// speed limit and command timeout.
    pub fn member(&self, i: usize, pace: Pace) -> Option<MemberBrief> {
        let robot = &self.robots[i];
        let robot_class = (robot.keep_m, robot.speed_max_m_s);
        self.is_team().then(|| MemberBrief {
            keep_m: robot.keep_m,
            speed_max_m_s: self.avoidance_method.clamps_speed.then_some(robot.speed_max_m_s),
            command_lifetime_ns: self.command_lifetime_ns_of(i, pace),
            class: match self.classes_sensed {
                true => {
                    self.classes().iter().position(|class| *class == robot_class).unwrap_or(0) as u8
                }
                false => 0,
            },
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::examples::row_of_three;

    fn pairs(brief: &AvoidanceBrief) -> Vec<(f64, f64)> {
        brief.classes.iter().map(|class| (class.distance_min_m, class.speed_max_m_s)).collect()
    }

    #[test]
    fn robot_keeps_the_sum_of_the_sizes_of_each_class() {
        let mut scenario = row_of_three();
        assert!(!scenario.is_team() && scenario.member(0, Pace::Lockstep).is_none());
        assert_eq!(*scenario.avoidance_of(0, Pace::Lockstep), scenario.avoidance);
        scenario.robots[1].keep_m = 0.25;
        scenario.robots[2].speed_max_m_s = 0.5;
        scenario.robots[2].hold_periods = 3;
        let avoidance = scenario.avoidance_of(1, Pace::Realtime);
        assert_eq!(pairs(&avoidance), [(0.35, 0.3), (0.5, 0.3), (0.35, 0.5)]);
        assert_eq!((avoidance.distance_min_m, avoidance.speed_max_m_s), (0.5, 0.3));
        assert_eq!(avoidance.command_timeout_max_s, 3.001, "T_p + 3 T of r3");
        let classes = [0, 1, 2].map(|i| scenario.member(i, Pace::Realtime).unwrap().class);
        assert_eq!(classes, [0, 1, 2]);
        let lifetimes_ns = [0, 2].map(|i| scenario.command_lifetime_ns_of(i, Pace::Realtime));
        assert_eq!(lifetimes_ns, [1_001_000_000, 3_001_000_000]);
        scenario.classes_sensed = false;
        assert_eq!(pairs(&scenario.avoidance_of(0, Pace::Lockstep)), [(0.35, 0.5)]);
        let classes = [0, 1, 2].map(|i| scenario.member(i, Pace::Realtime).unwrap().class);
        assert_eq!(classes, [0; 3]);
    }

    #[test]
    fn largest_distance_is_that_of_the_two_largest_robots() {
        let mut scenario = row_of_three();
        assert_eq!(largest_distance_and_speed(&scenario.robots), (0.2, 0.3));
        scenario.robots[0].keep_m = 0.5;
        scenario.robots[2].keep_m = 0.25;
        scenario.robots[1].speed_max_m_s = 0.6;
        assert_eq!(largest_distance_and_speed(&scenario.robots), (0.75, 0.6));
        assert_eq!(largest_distance_and_speed(&scenario.robots[..1]), (1.0, 0.3));
    }
}
