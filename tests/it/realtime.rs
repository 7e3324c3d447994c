//! Real-time runs whose timing is under test.

use crate::harness::run;

#[test]
fn run_takes_its_duration_in_one_process_per_robot_and_plant() {
    let mut running = run("triangle").set("duration_s=12").start();
    running.wait_for_event("contact");
    let mut names: Vec<String> = running.children().into_iter().map(|(_, name)| name).collect();
    names.sort();
    assert_eq!(names, ["plant", "r1", "r2", "r3"]);
    for (pid, name) in running.children() {
        let output = std::fs::read_to_string(format!("/proc/{pid}/comm")).unwrap();
        let expected = if name == "plant" { "phalanx-plant" } else { "phalanx-agent" };
        assert_eq!(output.trim(), expected, "{name}");
    }
    let ended = running.finish();
    ended.exits_with(0).assert_leaves_nothing().assert_keeps_d();
    ended.assert_holds(ended.number("/t_s") == 12.0, "12 s of run time");
    ended.assert_holds(ended.number("/wall/wall_s") > 11.9, "in no less of wall time");
    ended.assert_holds(ended.number("/final_error_m_max") < 1e-3, "the formation has converged");
    ended.assert_holds(ended.summary["trajectory_hash"].is_null(), "real time has no hash");
}

/// Faults under which the guard must keep d with real processes: freezes when robots are near each other, answers that
/// come just before and long after their commands expire, and deaths of all but one.
const HOSTILE_FAULTS: [&[&str]; 3] = [
    &[
        "freeze r1 @1 for 0.3",
        "freeze r2 @1.1 for 0.5",
        "freeze r1 @2 for 0.05",
        "freeze r3 @2.02 for 0.4",
        "freeze r2 @3 for 0.02",
        "freeze r1 @3.5 for 0.2",
    ],
    &[
        "slow r1 by 0.008 @0 for 2",
        "slow r2 by 0.011 @0.5 for 2",
        "slow r3 by 0.03 @1 for 3",
        "slow r1 by 0.2 @2 for 2",
        "load of 3 @1 for 2",
    ],
    &["kill r1 @1 restart 1", "kill r2 @1.2", "freeze r3 @1.5 for 1", "kill r1 @3.5"],
];

/// Accelerations of a TurtleBot3 Burger.
const BURGER: &str = "robot_defaults.limits={acceleration_m_s2=2.5,turn_acceleration_rad_s2=3.2,\
                      braking_time_s=0.35}";

/// Walls in the way of all triangles, none nearer to a start pose than the clearance.
const WALLS: [&str; 4] = [
    "obstacle=[{ kind = \"disc\", center_m = [0.12, 0.12], radius_m = 0.03 }]",
    "wall=[{ points_m = [[-0.3, -0.1], [-0.12, -0.12]] }]",
    "avoidance.clearance_m=0.05",
    "expect={ min_distance_m = 0.2, min_clearance_m = 0.05 }",
];

/// Runs the scenario from these start poses in real time at three periods, each with different faults; half of the
/// runs have inertia and walls.
fn hostile_runs(starts: &[&str], first: usize, keys: &[&str]) {
    let mut number = first;
    for (turn, start) in starts.iter().enumerate() {
        let sets = (0..3).map(|i| HOSTILE_FAULTS[(first + turn + i) % 3]);
        let runs = [0.005, 0.01, 0.02].into_iter().zip(sets);
        let runs: Vec<_> = runs
            .map(|(period_s, faults)| {
                let hostile = run(start)
                    .set(format!("period_s={period_s}"))
                    .set("duration_s=5")
                    .set("expect={ min_distance_m = 0.2 }");
                let hostile = keys.iter().fold(hostile, |hostile, key| hostile.set(key));
                number += 1;
                let walls =
                    if !keys.is_empty() && number.is_multiple_of(2) { &WALLS[..] } else { &[] };
                let hostile = walls.iter().fold(hostile, |hostile, wall| hostile.set(wall));
                faults.iter().fold(hostile, |hostile, fault| hostile.fault(fault)).start()
            })
            .collect();
        for hostile in runs {
            let ended = hostile.finish();
            ended.exits_with(0).assert_leaves_nothing().assert_keeps_d();
            let too_near = ended.number("/clearance_violations");
            ended.assert_holds(too_near == 0.0, "no arc ends nearer to a wall than the clearance");
        }
    }
}

#[test]
fn guard_keeps_d_in_real_time_under_freeze_delay_and_death() {
    hostile_runs(&["triangle-b", "triangle-d"], 0, &[]);
}

#[test]
fn robots_with_inertia_keep_d_in_real_time_under_faults() {
    hostile_runs(&["triangle-c"], 0, &[BURGER]);
}

/// `cargo test --release --test it -- --ignored dozens`
#[test]
#[ignore = "72 runs of 5 s: two minutes"]
fn guard_keeps_d_in_dozens_of_hostile_runs_and_with_inertia() {
    for (first, keys) in (0..3).flat_map(|first| [(first, &[][..]), (first, &[BURGER][..])]) {
        hostile_runs(&["triangle", "triangle-b", "triangle-c", "triangle-d"], first, keys);
    }
}
