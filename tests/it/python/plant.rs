//! Plants in Python, set by `[plant] program`: each equals the built-in plant except for its motion, and one that
//! fails ends the run with a report.

use std::path::Path;

use tempfile::TempDir;

use super::{ROOT, installed, python, stderr_contains};
use crate::harness::{ExitsWith as _, FinishedRun, Phalanx};

/// Creates the triangle with a plant that is a copy of a test file under the name `name`.
fn triangle(file: &str, name: &str, more: &str) -> TempDir {
    let folder = tempfile::tempdir().unwrap();
    let plant = Path::new(ROOT).join("tests/python/plants").join(file).with_extension("py");
    std::fs::copy(plant, folder.path().join(format!("{name}.py"))).unwrap();
    let text = std::fs::read_to_string(Path::new(ROOT).join("scenarios/triangle.toml")).unwrap();
    let plant = format!("\n[plant]\nprogram = [\"python3\", \"{name}.py\"]\n{more}");
    std::fs::write(folder.path().join("triangle.toml"), text + &plant).unwrap();
    folder
}

/// Prepares a run of the triangle in that folder for 4 s with the installed `phalanx`.
fn run(folder: &TempDir) -> Phalanx {
    let mut command = installed();
    command.arg("run").arg(folder.path().join("triangle.toml"));
    Phalanx::new(command).set("expect={}").set("duration_s=4")
}

/// Prepares the same run with the built-in plant.
fn built_in() -> Phalanx {
    crate::harness::run("triangle").set("expect={}").set("duration_s=4")
}

#[test]
#[ignore = "needs the package that tests/python/install installs"]
fn python_arcs_give_an_identical_run_also_under_faults() {
    let folder = triangle("exact", "exact", "");
    let faults =
        ["kill r2 @1 restart 0.5", "wheels r3 limit 0.05 @2 for 0.5", "freeze r1 @3 for 0.1"];
    let all =
        |run: Phalanx| faults.iter().fold(run.lockstep(), |run, fault| run.fault(fault)).finish();
    let (same, ended) = (all(built_in()), all(run(&folder)));
    same.exits_with(0);
    ended.exits_with(0).assert_leaves_nothing();
    ended.assert_holds(ended.hash() == same.hash(), format!("as {}", same.hash()));
}

#[test]
#[ignore = "needs the package that tests/python/install installs"]
fn pose_only_plant_moves_robots_the_same_distance() {
    let folder = triangle("exact", "poses", "");
    let (same, ended) = (built_in().lockstep().finish(), run(&folder).lockstep().finish());
    ended.exits_with(0).assert_leaves_nothing();
    for robot in ["r1", "r2", "r3"] {
        let error = |ended: &FinishedRun| ended.number(&format!("/final_error_m/{robot}"));
        let error_m = (error(&ended) - error(&same)).abs();
        ended.assert_holds(error_m < 1e-12, format!("{robot} is off by {error_m} m"));
    }
}

/// Returns the result of a run whose plant is defective from 1 s on. Asserts that it ends as with a plant's death and
/// reports all of `parts`.
fn run_with_bad_plant(name: &str, run: impl Fn(Phalanx) -> Phalanx, parts: &[&str]) -> FinishedRun {
    let folder = triangle("hostile", name, "memory_max_mb = 300\n");
    let ended = run(self::run(&folder)).finish();
    ended.exits_with(4).assert_leaves_nothing();
    parts.iter().for_each(|part| stderr_contains(&ended, part));
    ended.assert_holds(ended.number("/t_s") < 1.1, "the run has no earlier defect");
    ended
}

#[test]
#[ignore = "needs the package that tests/python/install installs"]
fn failing_plant_ends_the_run_with_its_defect() {
    let raises = [
        "error: the plant died (exit code 4)",
        "Hostile.step (raises.py:19) at t = 1.000 s raised",
        "Traceback (most recent call last):",
        "ValueError: my physics are at their end",
    ];
    for (name, parts) in [
        ("raises", &raises[..]),
        ("returns_nan", &["the plant moved r2 to y_m = NaN; the magnitude must be at most 1e9"]),
        ("leaves", &["error: the plant died (exit code 0)"]),
        ("crashes", &["error: the plant died (signal 11)"]),
        ("eats", &["Hostile.step (eats.py:19) at t = 1.000 s raised", "MemoryError"]),
    ] {
        run_with_bad_plant(name, Phalanx::lockstep, parts);
    }
    run_with_bad_plant("raises", |run| run, &[raises[0], raises[3]]);
    for (name, returned) in [
        ("returns_nothing", "returned None, "),
        ("returns_a_string", "returned 'north', "),
        ("returns_bytes", "returned [b'abc', b'abc', b'abc'], "),
        ("returns_two_robots", "returned [["),
        ("returns_points", "returned [["),
    ] {
        let at = format!("Hostile.step ({name}.py:19) at t = 1.000 s ");
        let expected = "expected 3 poses, one for each robot: (x, y, heading) in m and rad, or";
        run_with_bad_plant(name, Phalanx::lockstep, &[&at, returned, expected]);
    }
}

#[test]
#[ignore = "needs the package that tests/python/install installs"]
fn slow_plant_is_reported_in_real_time_and_allowed_otherwise() {
    let ended = run_with_bad_plant(
        "sleeps",
        |run| run,
        &["the plant is slower than real time: moving the robots by"],
    );
    stderr_contains(
        &ended,
        "use a faster plant, a longer `plant_tick_s` in `realtime`, or `--pace lockstep`",
    );
    let folder = triangle("hostile", "sleeps", "");
    run(&folder).lockstep().set("duration_s=1.05").finish().exits_with(0);
}

#[test]
#[ignore = "needs the package that tests/python/install installs"]
fn unresponsive_plant_is_named_in_lockstep() {
    run_with_bad_plant(
        "loops",
        |run| run.lockstep().set("hung_after_s=1"),
        &["error: the plant has not advanced for 1 s"],
    );
}

#[test]
#[ignore = "needs the package that tests/python/install installs"]
fn plant_constructor_error_is_reported() {
    let folder = triangle("hostile", "refuses", "");
    let ended = run(&folder).lockstep().finish();
    ended.exits_with(4).assert_leaves_nothing();
    stderr_contains(&ended, "cannot make the plant Hostile(robots): Traceback");
    stderr_contains(&ended, "ValueError: the physics engine has no licence");
}

#[test]
#[ignore = "needs the package that tests/python/install installs"]
fn law_used_as_plant_is_refused_with_the_reason() {
    let folder = triangle("../laws/tanh", "tanh", "");
    let ended = run(&folder).lockstep().finish();
    ended.exits_with(4).assert_leaves_nothing();
    stderr_contains(&ended, "plant.toml is not a brief");
    let mut help = python(&[folder.path().join("tanh.py").to_str().unwrap(), "--help"]);
    assert!(help.exits_with(0).stdout.contains("[laws.NAME]"));
}
