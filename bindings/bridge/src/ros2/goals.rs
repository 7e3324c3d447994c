//! Acceptance of goals from ROS 2.
//!
//! A goal is the target of a robot's front point. Only the position in the plane is used. The stamp is ignored,
//! because many clients set none.

use formation::Vec2;
use formation::obstacle::Obstacles;
use protocol::goal::RefusalReason;
use protocol::message::{Goal, GoalCounts};
use protocol::ros2::Ros2Brief;
use protocol::ros2::messages::{MAP_FRAME, StampedPose, read_pose_stamped};

/// Area in which goals may lie.
#[derive(Debug, Clone)]
pub struct GoalArea {
    obstacles: Obstacles,
    clearance_m: f64,
    closed_walls: Vec<Vec<Vec2>>,
}

impl GoalArea {
    /// Creates the area of a brief.
    pub fn from_brief(brief: &Ros2Brief) -> GoalArea {
        let corners = |wall: &Vec<[f64; 2]>| wall.iter().map(|&corner| corner.into()).collect();
        GoalArea {
            obstacles: Obstacles::new(&brief.obstacles),
            clearance_m: brief.clearance_m,
            closed_walls: brief.closed_walls_m.iter().map(corners).collect(),
        }
    }

    /// Returns the target in a message for a robot with this start position, or the reason for refusing it.
    pub fn parse_goal_position(&self, message: &[u8], start: Vec2) -> Result<Vec2, RefusalReason> {
        let StampedPose { frame, position_m, orientation } =
            read_pose_stamped(message).ok_or(RefusalReason::Layout)?;
        if position_m.iter().chain(&orientation).any(|number| !number.is_finite()) {
            return Err(RefusalReason::NotFinite);
        }
        if !frame.is_empty() && frame != MAP_FRAME {
            return Err(RefusalReason::WrongFrame);
        }
        let [x_m, y_m, _] = position_m;
        if !(Goal { stamp_ns: 0, x_m, y_m }).is_plausible() {
            return Err(RefusalReason::Far);
        }
        let position = Vec2::new(x_m, y_m);
        if self
            .closed_walls
            .iter()
            .any(|wall| polygon_contains(wall, position) != polygon_contains(wall, start))
        {
            return Err(RefusalReason::BehindWall);
        }
        if self.obstacles.obstacles_within(position, self.clearance_m).next().is_some() {
            return Err(RefusalReason::TooCloseToWall);
        }
        Ok(position)
    }
}

/// Returns whether a point lies within a closed polygon: a ray from it crosses an odd number of sides.
fn polygon_contains(corners: &[Vec2], point: Vec2) -> bool {
    let sides = corners.iter().zip(corners.iter().cycle().skip(1));
    let crosses = |(a, b): &(&Vec2, &Vec2)| {
        (a.y > point.y) != (b.y > point.y)
            && point.x < a.x + (point.y - a.y) / (b.y - a.y) * (b.x - a.x)
    };
    sides.filter(crosses).count() % 2 == 1
}

/// Queue of goals from zenoh's threads until the main loop forwards them.
#[derive(Debug)]
pub struct GoalInbox {
    /// Newest goal of each robot.
    newest_goals: Vec<Option<Goal>>,
    counts: GoalCounts,
}

impl GoalInbox {
    /// Creates a queue for this number of robots, in a process that started at `start_ns`.
    pub fn new(robots: usize, start_ns: u64) -> GoalInbox {
        let counts = GoalCounts { began_ns: start_ns, ..GoalCounts::default() };
        GoalInbox { newest_goals: vec![None; robots], counts }
    }

    /// Stores the target of a robot, m, received at `now_ns`, or counts the reason for refusing it.
    pub fn store_goal(&mut self, robot: usize, position: Result<Vec2, RefusalReason>, now_ns: u64) {
        match position {
            Ok(position) => {
                self.counts.taken += 1;
                // Each stamp is newer than the one before.
                let before_ns = self.newest_goals[robot].map_or(0, |goal| goal.stamp_ns);
                let stamp_ns = now_ns.max(before_ns + 1);
                self.newest_goals[robot] =
                    Some(Goal { stamp_ns, x_m: position.x, y_m: position.y });
            }
            Err(why) => self.counts.count_refusal(why),
        }
    }

    /// Returns the newest goal of a robot.
    pub fn newest_goal(&self, robot: usize) -> Option<Goal> {
        self.newest_goals[robot]
    }

    /// Returns the counts of accepted and refused goals.
    pub fn counts(&self) -> GoalCounts {
        self.counts
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use formation::obstacle::Obstacle;
    use protocol::ros2::cdr::Writer;

    const START: Vec2 = Vec2::new(0.0, 0.0);

    /// Returns an area with a closed square of 4 m around the origin, and a disc in it.
    fn example_area() -> GoalArea {
        let corners = [[-2.0, -2.0], [2.0, -2.0], [2.0, 2.0], [-2.0, 2.0]];
        let side = |i: usize| Obstacle::segment(corners[i], corners[(i + 1) % 4]);
        let mut parts: Vec<Obstacle> = (0..4).map(side).collect();
        parts.push(Obstacle::Disc { center_m: [1.0, 1.0], radius_m: 0.5 });
        GoalArea {
            obstacles: Obstacles::new(&parts),
            clearance_m: 0.1,
            closed_walls: vec![corners.map(Vec2::from).to_vec()],
        }
    }

    fn encode_goal_message(frame: &str, numbers: [f64; 7]) -> Vec<u8> {
        let mut out = Writer::new();
        out.write_time(0);
        out.write_string(frame);
        out.write_f64s(&numbers);
        out.bytes().to_vec()
    }

    fn pose_values(x_m: f64, y_m: f64) -> [f64; 7] {
        [x_m, y_m, 0.0, 0.0, 0.0, 0.0, 1.0]
    }

    #[test]
    fn goal_is_refused_for_the_first_applicable_reason() {
        let area = example_area();
        let parse =
            |frame, numbers| area.parse_goal_position(&encode_goal_message(frame, numbers), START);
        for frame in ["map", ""] {
            assert_eq!(parse(frame, pose_values(-1.0, 0.5)), Ok(Vec2::new(-1.0, 0.5)));
        }
        // Height and orientation, of any length, are ignored.
        let any_orientation = [-1.0, 0.5, 7.0, 0.0, 0.0, 0.0, 0.0];
        assert_eq!(parse("map", any_orientation), Ok(Vec2::new(-1.0, 0.5)));
        assert_eq!(area.parse_goal_position(b"nonsense", START), Err(RefusalReason::Layout));
        for index in 0..7 {
            for wrong in [f64::NAN, f64::INFINITY, f64::NEG_INFINITY] {
                let mut numbers = pose_values(-1.0, 0.5);
                numbers[index] = wrong;
                assert_eq!(parse("odom", numbers), Err(RefusalReason::NotFinite));
            }
        }
        for frame in ["odom", "/map", "r1/base_link"] {
            assert_eq!(
                parse(frame, pose_values(-1.0, 0.5)),
                Err(RefusalReason::WrongFrame),
                "{frame}"
            );
        }
        assert_eq!(parse("map", pose_values(1e300, 0.0)), Err(RefusalReason::Far));
        assert_eq!(parse("map", pose_values(3.0, 0.5)), Err(RefusalReason::BehindWall));
        assert_eq!(parse("map", pose_values(1.0, 1.0)), Err(RefusalReason::TooCloseToWall));
        assert_eq!(
            parse("map", pose_values(-1.95, 0.0)),
            Err(RefusalReason::TooCloseToWall),
            "too near to a wall"
        );
    }

    #[test]
    fn goal_inside_wall_is_refused_for_robot_outside() {
        let area = example_area();
        let start = Vec2::new(5.0, 5.0);
        let parse = |numbers| area.parse_goal_position(&encode_goal_message("map", numbers), start);
        assert_eq!(parse(pose_values(3.0, 0.5)), Ok(Vec2::new(3.0, 0.5)));
        assert_eq!(parse(pose_values(-1.0, 0.5)), Err(RefusalReason::BehindWall));
    }

    #[test]
    fn without_walls_any_plausible_goal_is_accepted() {
        let open_area =
            GoalArea { obstacles: Obstacles::new(&[]), clearance_m: 0.1, closed_walls: Vec::new() };
        assert!(
            open_area
                .parse_goal_position(&encode_goal_message("", pose_values(1e6, -1e6)), START)
                .is_ok()
        );
    }

    #[test]
    fn newest_goal_per_robot_wins_with_a_unique_stamp() {
        let mut inbox = GoalInbox::new(2, 5);
        let position_at = |x_m| Ok(Vec2::new(x_m, 0.0));
        for (x_m, now_ns) in [(1.0, 10), (2.0, 10), (3.0, 9)] {
            inbox.store_goal(1, position_at(x_m), now_ns);
        }
        inbox.store_goal(1, Err(RefusalReason::WrongFrame), 20);
        assert_eq!(inbox.newest_goal(0), None);
        assert_eq!(inbox.newest_goal(1), Some(Goal { stamp_ns: 12, x_m: 3.0, y_m: 0.0 }));
        let counts = inbox.counts();
        assert_eq!((counts.began_ns, counts.taken), (5, 3));
        assert_eq!(counts.refused_counts().collect::<Vec<_>>(), [("frame", 1)]);
    }

    proptest::proptest! {
        /// Varies the direction and first corner of a square.
        #[test]
        fn square_surrounds_exactly_its_inner_points(
            x in -3.0..3.0f64, y in -3.0..3.0f64, first in 0..4usize, is_reversed in proptest::bool::ANY,
        ) {
            let mut corners = [[-2.0, -2.0], [2.0, -2.0], [2.0, 2.0], [-2.0, 2.0]].map(Vec2::from);
            corners.rotate_left(first);
            if is_reversed {
                corners.reverse();
            }
            let is_inside = x.abs() < 2.0 && y.abs() < 2.0;
            proptest::prop_assert_eq!(polygon_contains(&corners, Vec2::new(x, y)), is_inside);
        }
    }
}
