//! Laws and controllers in Python, by the package as it is installed: `tests/python/install` puts it into
//! target/python. A robot whose law is in Python is the same robot; one that is hostile harms nobody.

mod env;
mod examples;
mod plant;
mod runs;

use std::path::{Path, PathBuf};
use std::process::{Command, Output};

use tempfile::TempDir;

use crate::elsewhere::{self, keeps_its_distance, moves_as, r3_came_back, says};
use crate::harness::{Ended, Phalanx};

const ROOT: &str = env!("CARGO_MANIFEST_DIR");

/// Laws of the tests.
fn law(name: &str) -> PathBuf {
    Path::new(ROOT).join("tests/python/laws").join(name).with_extension("py")
}

/// PATH with the environment that has the package before all others.
fn path() -> String {
    let programs = Path::new(ROOT).join("target/python/bin");
    assert!(programs.join("phalanx").exists(), "run tests/python/install first");
    format!("{}:{}", programs.display(), std::env::var("PATH").unwrap())
}

/// Something in the environment that has the package.
fn python(words: &[&str]) -> Output {
    Command::new("python3").args(words).env("PATH", path()).output().unwrap()
}

/// The pentagon with the law `mine`, the copy of a file of the tests under that name.
fn pentagon(file: &str, name: &str, more: &str) -> TempDir {
    let folder = tempfile::tempdir().unwrap();
    std::fs::copy(law(file), folder.path().join(format!("{name}.py"))).unwrap();
    std::fs::copy(law("leader"), folder.path().join("leader.py")).unwrap();
    let text = std::fs::read_to_string(Path::new(ROOT).join("scenarios/pentagon.toml")).unwrap();
    let laws = format!(
        "\n[laws.mine]\nprogram = [\"python3\", \"{name}.py\"]\nrole = \"formation\"\n\
         gains = [\"k_f_m_s\"]\nfeed_forward = true\ncorrection_max = \"k_f_m_s\"\n{more}\n\
         [laws.ahead]\nprogram = [\"python3\", \"leader.py\"]\nrole = \"leader\"\n\
         gains = [\"k_m_m_s\"]\nfeed_forward = true\ncorrection_max = \"k_m_m_s\"\n"
    );
    std::fs::write(folder.path().join("pentagon.toml"), text + &laws).unwrap();
    folder
}

/// The pentagon in that folder, by the `phalanx` that the package has installed.
fn run(folder: &TempDir) -> Phalanx {
    let path = path();
    let mut command = Command::new(Path::new(ROOT).join("target/python/bin/phalanx"));
    command.arg("run").arg(folder.path().join("pentagon.toml")).env("PATH", path);
    Phalanx::new(command).set("expect={}")
}

/// The same with r3 by the law `mine`.
fn with_r3(folder: &TempDir) -> Phalanx {
    elsewhere::with_r3(run(folder))
}

#[test]
#[ignore = "needs the package that tests/python/install installs"]
fn auditwheel_finds_the_wheel_fit_for_other_machines_with_the_same_or_a_newer_system() {
    let wheels = std::fs::read_dir(Path::new(ROOT).join("target/python/wheels")).unwrap();
    let [wheel] = &wheels.map(|entry| entry.unwrap().path()).collect::<Vec<_>>()[..] else {
        panic!("one wheel")
    };
    assert!(wheel.to_string_lossy().ends_with("-cp310-abi3-linux_x86_64.whl"), "{wheel:?}");
    let Output { status, stdout, stderr } =
        python(&["-m", "auditwheel", "show", wheel.to_str().unwrap()]);
    let said = String::from_utf8_lossy(&stdout).split_whitespace().collect::<Vec<_>>().join(" ");
    assert!(status.success(), "{said} {}", String::from_utf8_lossy(&stderr));
    // No library but those that every Linux with this glibc has.
    let tag = "is consistent with the following platform tag: \"manylinux_2_";
    assert!(said.contains(tag), "{said}");
}

#[test]
#[ignore = "needs the package that tests/python/install installs"]
fn the_package_has_the_version_of_the_workspace_and_the_program_too() {
    let said = python(&["-c", "import phalanx; print(phalanx.__version__)"]);
    let version = env!("CARGO_PKG_VERSION");
    assert_eq!(String::from_utf8_lossy(&said.stdout).trim(), version);
    let program = Path::new(ROOT).join("target/python/bin/phalanx");
    let said = Command::new(program).arg("--version").output().unwrap();
    assert_eq!(String::from_utf8_lossy(&said.stdout).trim(), format!("phalanx {version}"));
    let manifest =
        std::fs::read_to_string(Path::new(ROOT).join("bindings/python/Cargo.toml")).unwrap();
    let manifest: toml::Table = manifest.parse().unwrap();
    assert_eq!(manifest["package"]["version"].as_str(), Some(version));
}

#[test]
#[ignore = "needs the package that tests/python/install installs"]
fn a_robot_with_the_same_law_in_python_moves_bit_by_bit_as_the_built_in_one_in_all_of_ten_runs() {
    let folder = pentagon("tanh", "tanh", "");
    let built_in = run(&folder).lockstep().set("duration_s=4").finish();
    for _ in 0..10 {
        let ended = with_r3(&folder).lockstep().set("duration_s=4").finish();
        moves_as(&ended, &built_in);
    }
}

#[test]
#[ignore = "needs the package that tests/python/install installs"]
fn five_robots_in_python_move_as_five_built_in_ones() {
    let folder = pentagon("tanh", "tanh", "");
    let built_in = run(&folder).lockstep().set("duration_s=12").finish();
    let all = run(&folder).set("robot_defaults.law=mine").set("robot.r5.law=ahead");
    let all = all.lockstep().set("duration_s=12").finish();
    all.exits_with(0).leaves_nothing();
    all.claim(all.hash() == built_in.hash(), format!("as {}", built_in.hash()));
    let converged_s = all.number("/converged_at_s");
    all.claim(converged_s < 10.0, format!("they converge: {converged_s} s"));
}

#[test]
#[ignore = "needs the package that tests/python/install installs"]
fn a_robot_in_python_that_is_killed_and_restarted_in_lockstep_moves_as_a_built_in_one_would() {
    let folder = pentagon("tanh", "tanh", "");
    let killed =
        |run: Phalanx| run.lockstep().set("duration_s=14").fault("kill r3 @10 restart 2").finish();
    let (built_in, ended) = (killed(run(&folder)), killed(with_r3(&folder)));
    moves_as(&ended, &built_in);
}

#[test]
#[ignore = "needs the package that tests/python/install installs"]
fn a_robot_in_python_that_is_killed_and_restarted_in_real_time_finds_its_place_again() {
    let folder = pentagon("tanh", "tanh", "");
    let ended = with_r3(&folder).set("duration_s=18").fault("kill r3 @10 restart 2").finish();
    r3_came_back(&ended);
}

/// r3 is hostile from 1 s on, in lockstep: the run ends with `code`, and says all of `parts`.
fn hostile(name: &str, more: &str, set: &[&str], code: i32, parts: &[&str]) -> Ended {
    let folder = pentagon("hostile", name, more);
    let run = with_r3(&folder).lockstep().set("duration_s=2");
    let ended = set.iter().fold(run, |run, set| run.set(set)).finish();
    ended.exits_with(code).leaves_nothing();
    keeps_its_distance(&ended);
    parts.iter().for_each(|part| says(&ended, part));
    ended
}

#[test]
#[ignore = "needs the package that tests/python/install installs"]
fn a_law_that_raises_ends_its_robot_with_its_traceback_on_screen_and_in_its_log() {
    let parts = [
        "Hostile.gamma (raises.py:21) at t = 1.000 s raised",
        "Traceback (most recent call last):",
        "ValueError: my law is at its end",
    ];
    let ended = hostile("raises", "", &[], 0, &parts);
    let log = ended.file("logs/r3.jsonl");
    ended.claim(parts.iter().all(|part| log.contains(part)), format!("its log says so: {log}"));
    let events = ended.file("events.csv");
    ended.claim(events.contains(",ready,r3,incarnation 1"), "it was restarted");
}

#[test]
#[ignore = "needs the package that tests/python/install installs"]
fn a_law_that_raises_and_may_not_be_restarted_ends_the_run() {
    let set = ["robot_defaults.restart_policy=never"];
    let parts =
        ["error: r3 died (exit code 1) and is not restarted", "ValueError: my law is at its end"];
    hostile("raises", "", &set, 4, &parts);
}

#[test]
#[ignore = "needs the package that tests/python/install installs"]
fn a_law_that_answers_not_a_number_is_refused() {
    let said = "Hostile.gamma (returns_nan.py:21) at t = 1.000 s returned (nan, 0.0), expected two \
                finite numbers (x, y) in m/s";
    hostile("returns_nan", "", &[], 0, &[said]);
}

#[test]
#[ignore = "needs the package that tests/python/install installs"]
fn a_law_that_answers_a_string_is_refused() {
    hostile("returns_a_string", "", &[], 0, &["returned 'north', expected two finite numbers"]);
}

#[test]
#[ignore = "needs the package that tests/python/install installs"]
fn a_law_that_answers_three_numbers_is_refused() {
    hostile(
        "returns_three",
        "",
        &[],
        0,
        &["returned (0.1, 0.2, 0.3), expected two finite numbers"],
    );
}

#[test]
#[ignore = "needs the package that tests/python/install installs"]
fn a_law_that_asks_for_more_memory_than_it_may_have_is_refused_it() {
    let parts = ["Hostile.gamma (eats.py:21) at t = 1.000 s raised", "MemoryError"];
    hostile("eats", "memory_max_mb = 300", &[], 0, &parts);
}

#[test]
#[ignore = "needs the package that tests/python/install installs"]
fn a_law_that_leaves_its_process_is_a_death_that_nobody_planned() {
    let ended = hostile("leaves", "", &[], 0, &["died unexpectedly", "exit code 0"]);
    ended.claim(ended.file("events.csv").contains("died,r3,exit code 0"), "it is an event");
}

#[test]
#[ignore = "needs the package that tests/python/install installs"]
fn a_law_that_brings_its_process_down_is_a_death_that_nobody_planned() {
    hostile("crashes", "", &[], 0, &["died unexpectedly", "signal 11"]);
}

#[test]
#[ignore = "needs the package that tests/python/install installs"]
fn a_law_that_loops_for_ever_is_named_in_lockstep() {
    let parts = ["error: r3 has not answered tick 500 for 1 s", "(hung_after_s)"];
    hostile("loops", "", &["hung_after_s=1"], 4, &parts);
}

#[test]
#[ignore = "needs the package that tests/python/install installs"]
fn a_law_that_loops_for_ever_is_left_behind_in_real_time_and_killed_at_the_end() {
    let folder = pentagon("hostile", "loops", "");
    let ended = with_r3(&folder).set("duration_s=3").finish();
    ended.exits_with(0).leaves_nothing();
    keeps_its_distance(&ended);
    says(&ended, "r3 did not end when asked, and was killed");
    ended.claim(ended.file("events.csv").contains("lost"), "others lose it");
}

#[test]
#[ignore = "needs the package that tests/python/install installs"]
fn a_law_that_sleeps_is_late_and_no_hang() {
    let folder = pentagon("hostile", "sleeps", "");
    let ended = with_r3(&folder).set("duration_s=4").finish();
    ended.exits_with(0).leaves_nothing();
    keeps_its_distance(&ended);
    let misses = ended.number("/deadline_misses");
    ended.claim(misses >= 400.0, format!("{misses} deadlines are missed"));
    let table = ended.file("latency.csv");
    let compute = table.lines().find(|line| line.starts_with("compute,r3,")).unwrap_or_default();
    let longest_ns: f64 = compute.split(',').nth(10).and_then(|ns| ns.parse().ok()).unwrap_or(0.0);
    ended.claim(longest_ns >= 1e9, format!("an answer took a second: {compute}"));
}

#[test]
#[ignore = "needs the package that tests/python/install installs"]
fn a_law_that_kills_its_siblings_ends_the_run_and_brings_nobody_together() {
    let ended = hostile("kills", "", &[], 4, &["error: the plant died (signal 9)"]);
    ended.claim(ended.number("/t_s") >= 0.99, "it went well until then");
}

#[test]
#[ignore = "needs the package that tests/python/install installs"]
fn a_controller_that_drives_at_others_comes_no_nearer_than_it_may() {
    let folder = pentagon("chase", "chase", "");
    for pace in ["lockstep", "realtime"] {
        let all = run(&folder).set("robot_defaults.law=mine").args(["--pace", pace]);
        let ended = all.set("duration_s=8").finish();
        ended.exits_with(0).leaves_nothing();
        keeps_its_distance(&ended);
        let nearest_m = ended.number("/min_distance_m");
        ended.claim(nearest_m < 0.4, format!("they went for each other: {nearest_m}"));
    }
}

#[test]
#[ignore = "needs the package that tests/python/install installs"]
fn a_controller_keeps_its_place_among_robots_with_laws() {
    let folder = pentagon("place", "place", "");
    let text = std::fs::read_to_string(folder.path().join("pentagon.toml")).unwrap();
    let text = text.replacen("gains = [\"k_f_m_s\"]", "gains = [\"k_per_s\"]", 1).replacen(
        "correction_max = \"k_f_m_s\"\n",
        "",
        1,
    );
    std::fs::write(folder.path().join("pentagon.toml"), text).unwrap();
    let ended = with_r3(&folder).set("robot.r3.k_per_s=3").lockstep().set("duration_s=12").finish();
    ended.exits_with(0).leaves_nothing();
    keeps_its_distance(&ended);
    let error_m = ended.number("/final_error_m/r3");
    ended.claim(error_m < 0.02, format!("r3 is where it belongs: {error_m} m"));
}

#[test]
#[ignore = "needs the package that tests/python/install installs"]
fn a_law_that_cannot_be_made_of_its_gains_says_so() {
    let folder = pentagon("place", "place", "");
    let ended = with_r3(&folder).lockstep().finish();
    ended.exits_with(4).leaves_nothing();
    says(&ended, "cannot make the law Place(k_f_m_s=3): ");
    says(&ended, "unexpected keyword argument 'k_f_m_s'");
}

#[test]
#[ignore = "needs the package that tests/python/install installs"]
fn a_program_without_the_package_says_which_module_it_lacks() {
    let folder = pentagon("tanh", "tanh", "");
    let bare = folder.path().join("bare");
    let made = python(&["-m", "venv", "--without-pip", bare.to_str().unwrap()]);
    assert!(made.status.success());
    let program = format!("laws.mine.program=[\"{}/bin/python3\", \"tanh.py\"]", bare.display());
    let ended = with_r3(&folder).set(program).lockstep().finish();
    ended.exits_with(4).leaves_nothing();
    says(&ended, "ModuleNotFoundError: No module named 'phalanx'");
}

#[test]
#[ignore = "needs the package that tests/python/install installs"]
fn a_file_that_serves_nothing_says_what_is_missing() {
    let folder = pentagon("tanh", "tanh", "");
    std::fs::write(folder.path().join("tanh.py"), "import phalanx\n").unwrap();
    let ended = with_r3(&folder).lockstep().finish();
    ended.exits_with(4).leaves_nothing();
    says(&ended, "r3 died (exit code 0, before it was ready) and is not restarted");
}

#[test]
#[ignore = "needs the package that tests/python/install installs"]
fn a_supervisor_of_another_version_is_one_clear_diagnostic() {
    let folder = pentagon("tanh", "tanh", "");
    let ended = with_r3(&folder).lockstep().set("duration_s=0.1").finish();
    let brief = ended.file("briefs/r3.toml");
    let version = format!("phalanx = \"{}\"", env!("CARGO_PKG_VERSION"));
    assert!(brief.contains(&version), "{brief}");
    let other = brief.replace(&version, "phalanx = \"99.1.0\"\nof_the_future = true");
    let path = folder.path().join("r3.toml");
    std::fs::write(&path, other).unwrap();
    let law = folder.path().join("tanh.py");
    let output = python(&[law.to_str().unwrap(), path.to_str().unwrap()]);
    let said = String::from_utf8_lossy(&output.stderr);
    assert_eq!(output.status.code(), Some(4), "{said}");
    assert_eq!(said.lines().count(), 1, "{said}");
    assert!(said.contains("phalanx 99.1.0 starts this program"), "{said}");
}

#[test]
#[ignore = "needs the package that tests/python/install installs"]
fn a_law_started_by_hand_says_what_starts_it() {
    let output = python(&[law("tanh").to_str().unwrap()]);
    let said = String::from_utf8_lossy(&output.stderr);
    assert_eq!(output.status.code(), Some(2), "{said}");
    assert!(said.contains("the following arguments are required: brief"), "{said}");
    let output = python(&["-c", "import phalanx; phalanx.serve(3)"]);
    let said = String::from_utf8_lossy(&output.stderr);
    assert!(
        said.contains(
            "takes a class derived from phalanx.Law, phalanx.Controller or phalanx.Plant"
        ),
        "{said}"
    );
}

#[test]
#[ignore = "needs the package that tests/python/install installs"]
fn the_packages_types_are_what_its_stubs_say() {
    let output = python(&["-m", "mypy.stubtest", "phalanx", "--ignore-disjoint-bases"]);
    let said = String::from_utf8_lossy(&output.stdout);
    assert!(output.status.success(), "{said}");
}
