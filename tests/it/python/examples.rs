//! Example plants in `bindings/python/examples/`: robots on wheels and cars in MuJoCo, and robots on serial lines.

use std::path::Path;

use super::{ROOT, installed, stderr_contains};
use crate::harness::{FinishedRun, Phalanx};

/// Prepares a shipped scenario for the installed `phalanx`.
fn example(name: &str) -> Phalanx {
    let mut command = installed();
    command.arg("run").arg(format!("{ROOT}/bindings/python/examples/{name}.toml"));
    Phalanx::new(command)
}

#[track_caller]
fn assert_expected_result(ended: &FinishedRun) {
    ended.exits_with(0).assert_leaves_nothing();
    let seen_m = ended.number("/min_distance_m");
    ended.assert_holds(seen_m.is_finite(), "the minimum distance is reported");
}

#[test]
#[ignore = "needs the package that tests/python/install installs"]
fn wheeled_triangle_converges_below_2_cm_repeatably() {
    let [first, second] = [(); 2].map(|()| example("mujoco/triangle").lockstep().finish());
    assert_expected_result(&first);
    let error_m = first.number("/final_error_m_max");
    first.assert_holds(error_m < 0.02, format!("they are at their places: {error_m} m"));
    first.assert_holds(first.hash() == second.hash(), format!("as {}", second.hash()));
    let built_in = crate::harness::run("triangle").lockstep().finish();
    first.assert_holds(first.hash() != built_in.hash(), "on another plant");
}

#[test]
#[ignore = "needs the package that tests/python/install installs"]
fn restarted_wheeled_robot_returns_to_its_slot() {
    let ended = example("mujoco/triangle").lockstep().fault("kill r2 @3 restart 1").finish();
    assert_expected_result(&ended);
    let events = ended.file("events.csv");
    ended.assert_holds(events.contains(",ready,r2,incarnation 1"), "r2 came back");
    let error_m = ended.number("/final_error_m/r2");
    ended.assert_holds(error_m < 0.02, format!("and is at its slot: {error_m} m"));
}

#[test]
#[ignore = "needs the package that tests/python/install installs"]
fn wheeled_pentagon_keeps_distance_with_inertia_aware_guard() {
    let ended = example("mujoco/pentagon").lockstep().set("duration_s=20").finish();
    assert_expected_result(&ended);
    ended.assert_holds(ended.number("/min_distance_m") >= 0.3, "no distance is below d");
}

/// Asserts that a run of robots with goals kept the distance `d_m`, and ended at the goals.
#[track_caller]
fn assert_goals_are_reached(ended: &FinishedRun, d_m: f64) {
    assert_expected_result(ended);
    ended.assert_holds(ended.number("/min_distance_m") >= d_m, "no distance is below d");
    let error_m = ended.number("/final_error_m_max");
    ended.assert_holds(error_m < 0.01, format!("they are at their goals: {error_m} m"));
}

/// Runs the scenario twice, and asserts its result and that the runs are the same.
#[track_caller]
fn assert_goals_are_reached_repeatably(name: &str, d_m: f64) {
    let [first, second] = [(); 2].map(|()| example(name).lockstep().finish());
    assert_goals_are_reached(&first, d_m);
    first.assert_holds(first.hash() == second.hash(), format!("as {}", second.hash()));
}

/// Runs the scenario with a kill and a restart, and asserts its result.
#[track_caller]
fn assert_restarted_robot_reaches_its_goal(name: &str, d_m: f64) {
    let ended = example(name).lockstep().fault("kill r2 @3 restart 1").finish();
    assert_goals_are_reached(&ended, d_m);
    let events = ended.file("events.csv");
    ended.assert_holds(events.contains(",ready,r2,incarnation 1"), "r2 came back");
}

#[test]
#[ignore = "needs the package that tests/python/install installs"]
fn mecanum_robots_in_mujoco_reach_their_goals_repeatably() {
    assert_goals_are_reached_repeatably("mujoco/omni", 0.4);
}

#[test]
#[ignore = "needs the package that tests/python/install installs"]
fn restarted_mecanum_robot_in_mujoco_reaches_its_goal() {
    assert_restarted_robot_reaches_its_goal("mujoco/omni", 0.4);
}

#[test]
#[ignore = "needs the package that tests/python/install installs"]
fn cars_in_mujoco_reach_their_goals_repeatably() {
    assert_goals_are_reached_repeatably("mujoco/car", 1.0);
}

#[test]
#[ignore = "needs the package that tests/python/install installs"]
fn restarted_car_in_mujoco_reaches_its_goal() {
    assert_restarted_robot_reaches_its_goal("mujoco/car", 1.0);
}

#[test]
#[ignore = "needs the package that tests/python/install installs"]
fn wheeled_triangle_and_pentagon_run_in_real_time() {
    for name in ["triangle", "pentagon"] {
        let run = example(&format!("mujoco/{name}")).set("expect={}").set("duration_s=8");
        let ended = run.fault("kill r2 @1 restart 1").finish();
        assert_expected_result(&ended);
        ended.assert_holds(ended.number("/t_s") == 8.0, "it goes to its end");
        ended.assert_holds(
            ended.file("events.csv").contains(",ready,r2,incarnation 1"),
            "r2 came back",
        );
    }
}

#[test]
#[ignore = "needs the package that tests/python/install installs"]
fn serial_robots_move_and_leave_no_process() {
    let ended = example("serial/pair").set("expect={}").set("duration_s=4").finish();
    assert_expected_result(&ended);
    let samples = ended.file("samples.csv");
    let x_m =
        |line: Option<&str>| -> f64 { line.unwrap().split(',').nth(2).unwrap().parse().unwrap() };
    let ahead = || samples.lines().filter(|line| line.contains(",ahead,"));
    let moved_m = (x_m(ahead().next_back()) - x_m(ahead().next())).abs();
    ended.assert_holds(moved_m > 0.005, format!("it moved along its circle: {moved_m} m in x"));
    let programs = ended.run_dir().join("programs");
    let stub = programs.join("stub.py");
    let start = std::time::Instant::now();
    while is_run(&stub) {
        ended.assert_holds(
            start.elapsed().as_secs() < 60,
            "the robots of software end with the line",
        );
        std::thread::sleep(std::time::Duration::from_millis(5));
    }
}

#[test]
#[ignore = "needs the package that tests/python/install installs"]
fn serial_robots_are_refused_faster_than_real_time() {
    let ended = example("serial/pair").lockstep().finish();
    ended.exits_with(4).assert_leaves_nothing();
    stderr_contains(&ended, "robots cannot move faster than real time: run with --pace realtime");
}

#[test]
#[ignore = "needs the package that tests/python/install installs"]
fn robots_away_from_their_start_poses_are_not_driven() {
    let folder = tempfile::tempdir().unwrap();
    for name in ["driver.py", "stub.py", "devices.json", "pair.toml"] {
        let from = Path::new(ROOT).join("bindings/python/examples/serial").join(name);
        std::fs::copy(from, folder.path().join(name)).unwrap();
    }
    let driver = folder.path().join("driver.py");
    let text = std::fs::read_to_string(&driver).unwrap();
    let shifted_text = text.replace("(robot.start.x_m, ", "(robot.start.x_m + 0.1, ");
    assert_ne!(text, shifted_text);
    std::fs::write(&driver, shifted_text).unwrap();
    let mut command = installed();
    command.arg("run").arg(folder.path().join("pair.toml"));
    let ended = Phalanx::new(command).finish();
    ended.exits_with(4).assert_leaves_nothing();
    stderr_contains(&ended, "ahead is at 1.1, 0.0, 1.5, not at its start");
}

/// Returns whether a process was started with this file.
fn is_run(file: &Path) -> bool {
    let command_line = |entry: std::fs::DirEntry| std::fs::read(entry.path().join("cmdline")).ok();
    let lines = std::fs::read_dir("/proc").unwrap().flatten().filter_map(command_line);
    let file = file.as_os_str().as_encoded_bytes();
    lines.into_iter().any(|line| line.windows(file.len()).any(|part| part == file))
}
