//! Robots that cannot arrive come to rest, and block others no longer than necessary.

use experiment::scenario::Scenario;
use formation::front_point::front_point;
use outcome::metrics::Measures;
use outcome::metrics::blocked_robots::BlockReason;

use crate::oracle::{simulate_watched, with_faults};

/// Maximum distance in 20 s of a robot that is at rest, m.
const STILL_M: f64 = 5e-3;

/// Simulates `scenario`. Returns its measures, and the distance that each front point moved between these times, m.
fn run(scenario: &Scenario, [from_s, until_s]: [f64; 2]) -> (Measures, Vec<f64>) {
    let mut ways_m = vec![0.0; scenario.robots.len()];
    let mut before = Vec::new();
    let measures = simulate_watched(scenario, |header, rows, _| {
        let at = |(row, robot): (&protocol::message::TruthRow, &experiment::scenario::Robot)| {
            front_point(row.pose(), robot.front_point_m)
        };
        let now: Vec<_> = rows.iter().zip(&scenario.robots).map(at).collect();
        if (from_s..until_s).contains(&(header.t_ns as f64 / 1e9)) {
            for (way, (now, before)) in ways_m.iter_mut().zip(now.iter().zip(&before)) {
                *way += (now - before as &formation::Vec2).norm();
            }
        }
        before = now;
    });
    assert_eq!(measures.violations, 0);
    (measures, ways_m)
}

/// Returns the names of the robots with a final error of more than 1 mm.
fn robots_off_target(measures: &Measures) -> Vec<&str> {
    let errors = measures.final_error_m.iter();
    let is_off = |error_m: &Option<f64>| error_m.is_none_or(|error_m| error_m > 1e-3);
    errors.filter(|(_, error_m)| is_off(error_m)).map(|(robot, _)| robot.as_str()).collect()
}

#[test]
fn robot_with_occupied_slot_rests_beside_it_others_arrive() {
    let set = ["expect={}", "duration_s=120"];
    let scenario = with_faults("antipodal-8", &set, &["kill r1 @0.2"]);
    let (measures, ways_m) = run(&scenario, [100.0, 120.0]);
    assert_eq!(robots_off_target(&measures), ["r1", "r5"]);
    let [wait] = &measures.waits[..] else { panic!("{:?}", measures.waits) };
    let told = (wait.robot.as_str(), wait.for_robot.as_str(), wait.why, wait.lives);
    assert_eq!(told, ("r5", "r1", BlockReason::Taken, false));
    assert!(wait.error_m < 1.5 * 0.2, "{wait:?}");
    assert!(ways_m.iter().all(|way| *way < STILL_M), "{ways_m:?}");
}

#[test]
fn enclosed_and_excluded_robots_rest_and_others_arrive() {
    let walls = "wall=[{ points_m = [[-1.15, -0.25], [-0.55, -0.25], [-0.55, 0.25], [-1.15, 0.25], [-1.15, -0.25]] }]";
    let set = ["expect={}", "duration_s=180", "avoidance.clearance_m=0.1", walls];
    // The robots retry from time to time, and rest for longer each time: here since 150 s.
    let (measures, ways_m) = run(&with_faults("antipodal-8", &set, &[]), [155.0, 175.0]);
    assert_eq!(robots_off_target(&measures), ["r1", "r5"]);
    assert!(ways_m.iter().all(|way| *way < STILL_M), "{ways_m:?}");
}

#[test]
fn robots_behind_a_blocked_door_wait_and_then_arrive() {
    // r1 stands in the door from 11 s on.
    let set = ["expect={}", "duration_s=240"];
    let scenario = with_faults("doorway", &set, &["freeze r1 @11 for 60"]);
    let (measures, ways_m) = run(&scenario, [65.0, 71.0]);
    assert_eq!(robots_off_target(&measures), [""; 0]);
    assert!(ways_m.iter().all(|way| *way < STILL_M), "{ways_m:?}");
    let arrived_at_s = measures.converged_at_s.expect("all arrive");
    assert!(arrived_at_s > 71.0, "the door was blocked until then");
}
