//! Robots that cannot arrive come to rest, and block others no longer than necessary.

use std::path::Path;

use agent::controller::{Controller, Parts};
use agent::laws::{Law, Situation};
use experiment::campaign::starts::{BoxCenter, GoalAssignment, RandomStarts};
use experiment::scenario::Scenario;
use experiment::scenario::read::{Overrides, read_text};
use formation::Vec2;
use formation::desired::Target;
use formation::front_point::front_point;
use outcome::metrics::RunMetrics;
use outcome::metrics::blocked_robots::BlockReason;
use protocol::brief::AgentBrief;
use protocol::message::TruthRow;
use run::in_process::measured::measure_run;

use crate::harness::map_in_parallel;
use crate::oracle::{simulate_watched, with_faults};

/// Maximum distance in 20 s of a robot that is at rest, m.
const STILL_M: f64 = 5e-3;

/// Simulates `scenario`. Returns its measures, and the distance that each front point moved between these times, m.
fn run(scenario: &Scenario, [from_s, until_s]: [f64; 2]) -> (RunMetrics, Vec<f64>) {
    let mut path_lengths_m = vec![0.0; scenario.robots.len()];
    let mut previous = Vec::new();
    let measures = simulate_watched(scenario, |header, rows, _| {
        let at = |(row, robot): (&protocol::message::TruthRow, &experiment::scenario::Robot)| {
            front_point(row.pose(), robot.front_point_m)
        };
        let current: Vec<_> = rows.iter().zip(&scenario.robots).map(at).collect();
        if (from_s..until_s).contains(&(header.t_ns as f64 / 1e9)) {
            for (length_m, (current, previous)) in
                path_lengths_m.iter_mut().zip(current.iter().zip(&previous))
            {
                *length_m += (current - previous as &formation::Vec2).norm();
            }
        }
        previous = current;
    });
    assert_eq!(measures.violations, 0);
    (measures, path_lengths_m)
}

/// Returns the names of the robots with a final error of more than 1 mm.
fn robots_off_target(measures: &RunMetrics) -> Vec<&str> {
    let errors = measures.final_error_m.iter();
    let is_off = |error_m: &Option<f64>| error_m.is_none_or(|error_m| error_m > 1e-3);
    errors.filter(|(_, error_m)| is_off(error_m)).map(|(robot, _)| robot.as_str()).collect()
}

#[test]
fn robot_with_occupied_slot_rests_beside_it_others_arrive() {
    let set = ["expect={}", "duration_s=120"];
    let scenario = with_faults("antipodal-8", &set, &["kill r1 @0.2"]);
    let (measures, path_lengths_m) = run(&scenario, [100.0, 120.0]);
    assert_eq!(robots_off_target(&measures), ["r1", "r5"]);
    let [wait] = &measures.waits[..] else { panic!("{:?}", measures.waits) };
    let found = (wait.robot.as_str(), wait.for_robot.as_str(), wait.why, wait.lives);
    assert_eq!(found, ("r5", "r1", BlockReason::Taken, false));
    assert!(wait.error_m < 1.5 * 0.2, "{wait:?}");
    assert!(path_lengths_m.iter().all(|length_m| *length_m < STILL_M), "{path_lengths_m:?}");
}

#[test]
fn enclosed_and_excluded_robots_rest_and_others_arrive() {
    let walls = "wall=[{ points_m = [[-1.15, -0.25], [-0.55, -0.25], [-0.55, 0.25], [-1.15, 0.25], [-1.15, -0.25]] }]";
    let set = ["expect={}", "duration_s=180", "avoidance.clearance_m=0.1", walls];
    // The robots retry from time to time, and rest for longer each time: here since 150 s.
    let (measures, path_lengths_m) = run(&with_faults("antipodal-8", &set, &[]), [155.0, 175.0]);
    assert_eq!(robots_off_target(&measures), ["r1", "r5"]);
    assert!(path_lengths_m.iter().all(|length_m| *length_m < STILL_M), "{path_lengths_m:?}");
}

#[test]
fn robots_behind_a_blocked_door_wait_and_then_arrive() {
    // r1 stands in the door from 11 s on.
    let set = ["expect={}", "duration_s=240"];
    let scenario = with_faults("doorway", &set, &["freeze r1 @11 for 60"]);
    let (measures, path_lengths_m) = run(&scenario, [65.0, 71.0]);
    assert_eq!(robots_off_target(&measures), [""; 0]);
    assert!(path_lengths_m.iter().all(|length_m| *length_m < STILL_M), "{path_lengths_m:?}");
    let arrived_at_s = measures.converged_at_s.expect("all arrive");
    assert!(arrived_at_s > 71.0, "the door was blocked until then");
}

/// Law of a free robot that moves straight to the goal in its parameters, and names it as its target if
/// `is_target_published`.
struct ToGoal {
    goal: Vec2,
    speed_m_s: f64,
    is_target_published: bool,
}

impl Law for ToGoal {
    fn gamma(&mut self, situation: &Situation<'_>) -> Vec2 {
        let error = situation.front_point - self.goal;
        // Within this distance the speed is proportional to the error, as in the built-in laws.
        let near_m = 10.0 * self.speed_m_s * situation.period_s;
        -self.speed_m_s * error / error.norm().max(near_m)
    }

    fn target(&mut self) -> Option<Target> {
        self.is_target_published.then(|| Target::at_rest(self.goal))
    }
}

/// Returns 12 robots on 0.2 m^2 each, of which random pairs swap their positions: with a law in a program and the role
/// `free`.
fn dense_swap(seed: u64) -> Scenario {
    let root = env!("CARGO_MANIFEST_DIR");
    let path = Path::new(root).join("scenarios/campaigns/comparison/antipodal-16.toml");
    let text = std::fs::read_to_string(&path).unwrap();
    let lines = text.lines().filter(|line| !(13..=16).any(|i| line.contains(&format!("\"r{i}\""))));
    let goals: String = lines.map(|line| format!("{line}\n")).collect();
    let read = |text: &str, set: Vec<String>| {
        let overrides = Overrides { assignments: set, ..Overrides::default() };
        let read = read_text(&path, text, &overrides, &agent::catalog());
        read.unwrap_or_else(|error| panic!("{}", error.render(false))).0
    };
    let side_m = (12.0f64 * 0.2).sqrt();
    let starts = RandomStarts {
        box_m: [side_m; 2],
        separation_min_m: 0.3,
        box_center: BoxCenter::Common(None),
        goals: GoalAssignment::Swaps,
    };
    let drawn = starts.draw(&read(&goals, Vec::new()), seed).unwrap();
    let law = "[laws.swap]\nprogram = ['python3']\nrole = 'free'\ngains = ['speed_m_s']\n";
    let free =
        goals.replace("goal_m = [", "params.goal_m = [").replace("\"goal-unit\"", "\"swap\"");
    let set = drawn.into_iter().map(|set| set.replace(".goal_m=", ".params.goal_m=")).collect();
    read(&format!("{free}\n{law}"), set)
}

/// Returns the number of robots that end within a quarter of d of their goals.
fn arrived(scenario: &Scenario, is_target_published: bool) -> usize {
    let make_controller = move |brief: &AgentBrief, incarnation| {
        let goal = brief.params["goal_m"].as_array().unwrap();
        let [x, y] = [0, 1].map(|i| goal[i].as_float().unwrap());
        let speed_m_s = brief.gains["speed_m_s"];
        let law = Box::new(ToGoal { goal: Vec2::new(x, y), speed_m_s, is_target_published });
        let parts = Parts::with_law(brief, law).unwrap();
        Controller::with_parts(brief, incarnation, parts)
    };
    let mut end_points: Vec<Vec2> = Vec::new();
    let front_points = |rows: &[TruthRow]| {
        let rows = rows.iter().zip(&scenario.robots);
        rows.map(|(row, robot)| front_point(row.pose(), robot.front_point_m)).collect()
    };
    let measures = measure_run(scenario, Box::new(make_controller), &mut |_, rows, _| {
        end_points = front_points(rows);
        true
    });
    let measures = measures.unwrap();
    assert_eq!(measures.violations, 0);
    let is_at_goal = |(robot, end): (&experiment::scenario::Robot, &Vec2)| {
        let goal = robot.params["goal_m"].as_array().unwrap();
        let goal = Vec2::from([0, 1].map(|i| goal[i].as_float().unwrap()));
        (end - goal).norm() < 0.05
    };
    scenario.robots.iter().zip(&end_points).filter(|pair| is_at_goal(*pair)).count()
}

#[test]
fn robots_of_dense_swaps_arrive_at_the_targets_of_free_laws() {
    let seeds: Vec<u64> = (1..=11).collect();
    let counts = map_in_parallel(&seeds, |&seed| arrived(&dense_swap(seed), true));
    assert_eq!(counts, [12; 11], "robots of 12 that arrived in each swap");
}
