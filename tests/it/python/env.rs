//! `phalanx.parallel_env`: the plant and the controllers of a run, stepped from Python.

use std::path::Path;

use crate::harness::{self, ExitsWith as _};

use super::{ROOT, python};

/// Returns the output of a script of tests/python/env.
#[track_caller]
fn script(name: &str, arguments: &[&str]) -> String {
    let path = format!("{ROOT}/tests/python/env/{name}.py");
    python(&[&[path.as_str()], arguments].concat()).exits_with(0).stdout
}

fn shipped(name: &str) -> String {
    format!("{ROOT}/scenarios/{name}.toml")
}

#[test]
#[ignore = "needs the package that tests/python/install installs"]
fn environment_passes_the_pettingzoo_tests() {
    let printed = script("api", &[&shipped("triangle")]);
    assert_eq!(printed.matches("Passed Parallel API test").count(), 4, "{printed}");
}

#[test]
#[ignore = "needs the package that tests/python/install installs"]
fn environment_copies_and_images_match_its_step() {
    assert_eq!(script("copies", &[&shipped("triangle")]).trim(), "copied, pickled and drawn");
}

#[test]
#[ignore = "needs the package that tests/python/install installs"]
fn env_with_built_in_velocities_equals_the_process_run() {
    let noise = "noise r2 odometry by 0.005 @1 for 3";
    for (name, agents, set, faults) in [
        ("triangle", "all", "duration_s=12", &[][..]),
        ("triangle", "r1,r3", "duration_s=4", &[noise, "freeze r3 @2 for 0.5"]),
        ("triangle", "all", "avoidance.kind=focus", &["kill r2 @3 restart 2"]),
        ("pentagon", "all", "duration_s=12", &[]),
        ("pentagon", "r3,r5", "duration_s=4", &["kill r3 @1 restart 1", "kill r1 @2"]),
    ] {
        let run = harness::run(name).lockstep().set("expect={}").set("duration_s=6").set(set);
        let ended = faults.iter().fold(run, |run, fault| run.fault(fault)).finish();
        ended.exits_with(0);
        let path = shipped(name);
        let arguments = [&[path.as_str(), agents, "duration_s=6", set], faults].concat();
        let printed = script("same", &arguments);
        let (hash, rewards) = printed.trim().split_once(' ').unwrap();
        ended.assert_holds(ended.hash() == hash, format!("{name} {arguments:?}: {hash}"));
        assert!(rewards.parse::<f64>().unwrap() < 0.0, "errors cost: {rewards}");
    }
}

#[test]
#[ignore = "needs the package that tests/python/install installs"]
fn policy_inputs_in_a_process_equal_those_in_training() {
    let folder = tempfile::tempdir().unwrap();
    let law = Path::new(ROOT).join("tests/python/env/process.py");
    std::fs::copy(law, folder.path().join("process.py")).unwrap();
    let text = std::fs::read_to_string(shipped("triangle")).unwrap();
    let law = "\n[laws.shows]\nprogram = [\"python3\", \"process.py\"]\nrole = \"formation\"\n";
    let scenario = folder.path().join("triangle.toml");
    std::fs::write(&scenario, text + law).unwrap();
    let mut command = super::installed();
    command.arg("run").arg(&scenario);
    let run = harness::Phalanx::new(command).set("expect={}").set("robot_defaults.law=shows");
    let ended = run.lockstep().set("duration_s=0.6").finish();
    ended.exits_with(0);
    let log = ended.file("logs/r1.jsonl");
    let shown = log.lines().find(|line| line.starts_with("seen: "));
    let printed = script("process", &["env", scenario.to_str().unwrap()]);
    assert_eq!(shown, Some(printed.trim()), "{log}");
    assert_eq!(printed.split(' ').count(), 1 + 11 + 8 + 4 * 3);
}

#[test]
#[ignore = "needs the package that tests/python/install installs"]
fn environment_from_invalid_input_is_refused_with_the_reason() {
    let triangle = shipped("triangle");
    let own =
        "laws={'own': {'program': ['./own'], 'role': 'formation'}}, robot={'r2': {'law': 'own'}}";
    let cases = [
        ("env('no.toml')", "ValueError: ", "no.toml"),
        ("env(T, perod_s=1)", "ValueError: ", "period_s"),
        (
            "env(T, agents=['r9'])",
            "ValueError: ",
            "no robot is called \"r9\"; there are r1, r2, r3",
        ),
        ("env(T, render_mode='human')", "ValueError: ", "expected 'rgb_array' or None"),
        ("env(T, action='force')", "ValueError: ", "expected 'velocity' or 'twist'"),
        ("env(T, faults=['kill plant @1'])", "ValueError: ", "a fault kills the plant"),
        (
            &format!("env(T, agents=['r1'], {own})"),
            "ValueError: r2 has the law \"own\" of a program",
            "",
        ),
        ("step(env(T), r2=(1, 2))", "ValueError: there is no action of r1", ""),
        (
            "step(env(T), r1=(1, 2, 3))",
            "ValueError: the action of r1 is (1, 2, 3)",
            "expected two numbers",
        ),
        ("step(env(T), r1=b'ab')", "ValueError: the action of r1 is b'ab'", "expected two numbers"),
        (
            "step(env(T), r1=(1, math.nan), r2=(0, 0), r3=(0, 0))",
            "ValueError: ",
            "expected two finite numbers (x, y) in m/s",
        ),
        ("env(T, plant={'program': ['true']})", "ValueError: ", "starts no program"),
        ("env(T).situation('r9')", "ValueError: no robot is called \"r9\"", ""),
        (
            "phalanx.Observation(-1, 2)",
            "ValueError: neighbors is -1 and near is 2; both must be 0 or more",
            "",
        ),
    ];
    let head = format!(
        "import math, phalanx\nenv, T = phalanx.parallel_env, {triangle:?}\n\
         def step(e, **actions):\n    e.reset()\n    e.step(actions)\n"
    );
    for (line, error, part) in cases {
        let stderr = python(&["-c", &format!("{head}{line}")]).exits_with(1).stderr;
        assert!(stderr.contains(error) && stderr.contains(part), "{line}: {stderr}");
    }
}

#[test]
#[ignore = "needs the package that tests/python/install installs"]
fn missing_pettingzoo_is_reported_with_the_packages() {
    let hidden = "import sys; sys.modules['pettingzoo'] = None\n\
                  import phalanx; phalanx.parallel_env('x.toml')";
    let output = python(&["-c", hidden]).output().unwrap();
    let stderr = String::from_utf8_lossy(&output.stderr);
    assert!(stderr.contains("pip install pettingzoo gymnasium numpy"), "{stderr}");
}

#[test]
#[ignore = "needs the package that tests/python/install installs"]
fn messages_in_an_environment_equal_those_between_processes() {
    let scenario = shipped("algorithms/event-triggered/scenario");
    let mut command = super::installed();
    command.arg("run").arg(&scenario);
    let run = harness::Phalanx::new(command).lockstep().set("duration_s=5").finish();
    run.exits_with(0);
    assert_eq!(script("messages", &[&scenario]).trim(), run.hash());
}
