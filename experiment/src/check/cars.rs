//! Checks of cars (`drive = "ackermann"`), which cannot turn without moving.

use protocol::number::{format_distinct, format_short};

use super::finding::{Finding, warning_finding};
use super::steady::FormationMotion;
use crate::scenario::{Robot, Scenario};

/// Largest number of cars that all arrived in every simulated swap, with 0.36 m^2 for each and R_min = 0.15 m.
const ARRIVING_CARS_MAX: usize = 16;

/// Warns about the car whose slot or trajectory turns most tightly, if that is tighter than its minimum turning radius.
pub(super) fn check_path_curvatures(
    scenario: &Scenario,
    motion: &FormationMotion,
) -> Option<Finding> {
    let robots = scenario.robots.iter().zip(&motion.peak_curvatures);
    let too_tight =
        robots.filter(|(robot, (curvature, _))| *curvature > robot.drive().curvature_max_per_m);
    let (robot, (curvature, t_s)) = too_tight.max_by(|(_, a), (_, b)| a.0.total_cmp(&b.0))?;
    let radius_min_m = robot.turning_radius_min_m.unwrap_or_default();
    let [radius, radius_min] = format_distinct(1.0 / curvature, radius_min_m);
    let path = if robot.role.leads { "trajectory" } else { "slot" };
    Some(warning_finding(
        format!("robot.{}.turning_radius_min_m", robot.name),
        format!(
            "the {path} of {} turns within {radius} m at {} s, more tightly than the robot, whose minimum turning \
             radius is {radius_min} m: it leaves the {path} there",
            robot.name,
            format_short(*t_s)
        ),
        format!("expected at most {radius} m, or a path with a wider turn"),
    ))
}

/// Warns if more cars go to goals than arrived in every simulated swap.
pub(super) fn check_car_crowd(scenario: &Scenario) -> Option<Finding> {
    let has_goal = |robot: &&Robot| robot.drive().is_car() && robot.goal_m.is_some();
    let cars = scenario.robots.iter().filter(has_goal).count();
    (cars > ARRIVING_CARS_MAX).then(|| {
        warning_finding(
            "robot_defaults.drive",
            format!(
                "{cars} cars go to goals: a car needs room to turn, so in a crowd some may not arrive. Distances are \
                 kept"
            ),
            "expected a planner that leads the cars past each other, more room, or another drive",
        )
    })
}

#[cfg(test)]
mod tests {
    use super::super::steady::PeakSpeeds;
    use super::*;
    use crate::examples::row_of_three;
    use formation::drive::DriveKind;

    /// Returns three cars with a minimum turning radius of 0.3 m.
    fn cars() -> Scenario {
        let mut scenario = row_of_three();
        for robot in &mut scenario.robots {
            (robot.drive_kind, robot.front_point_m) = (DriveKind::Ackermann, 0.0);
            robot.turning_radius_min_m = Some(0.3);
        }
        scenario
    }

    #[test]
    fn tightest_slot_of_a_car_is_warned_of() {
        let mut motion = FormationMotion {
            horizon_s: 40.0,
            trajectory_speed_max_m_s: 0.1,
            offset_rate_max_m_s: 0.1,
            peak_speeds: vec![PeakSpeeds::default(); 3],
            peak_times_s: vec![[0.0; 3]; 3],
            peak_curvatures: vec![(0.0, 0.0), (5.0, 31.0), (4.0, 1.0)],
            wall_passages: vec![None; 3],
            transient: None,
        };
        let warned = check_path_curvatures(&cars(), &motion).unwrap();
        assert_eq!(warned.path, "robot.r2.turning_radius_min_m");
        let start = "the slot of r2 turns within 0.2 m at 31 s, more tightly than the robot";
        assert!(warned.message.starts_with(start), "{}", warned.message);
        motion.peak_curvatures.fill((3.0, 1.0));
        assert_eq!(check_path_curvatures(&cars(), &motion), None);
    }

    #[test]
    fn many_cars_with_goals_are_warned_of() {
        let mut scenario = cars();
        let mut car = scenario.robots[0].clone();
        car.goal_m = Some([1.0, 0.0]);
        scenario.robots = vec![car.clone(); ARRIVING_CARS_MAX];
        assert_eq!(check_car_crowd(&scenario), None);
        scenario.robots.push(car);
        let warned = check_car_crowd(&scenario).unwrap();
        assert!(warned.message.starts_with("17 cars go to goals"), "{}", warned.message);
    }
}
