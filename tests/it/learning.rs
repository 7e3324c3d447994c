//! `phalanx.parallel_env` with external trainers, which `tests/learning/install` installs into target/learning; RLlib into
//! target/rllib.

use std::path::Path;
use std::process::Command;

use crate::harness::{ExitsWith as _, ROOT};

/// Returns the output of a script of tests/learning about the shipped triangle, run with Python of target/`environment`.
#[track_caller]
fn script(environment: &str, name: &str) -> String {
    let programs = Path::new(ROOT).join("target").join(environment).join("bin");
    let install = match environment {
        "learning" => "tests/learning/install".to_owned(),
        other => format!("tests/learning/install {other}"),
    };
    assert!(programs.join("phalanx").exists(), "run {install} first");
    let mut command = Command::new(programs.join("python3"));
    command.arg(format!("{ROOT}/tests/learning/{name}.py"));
    command.arg(format!("{ROOT}/scenarios/triangle.toml")).exits_with(0).stdout
}

#[test]
#[ignore = "needs the trainers that tests/learning/install installs"]
fn supersuit_steps_copies_in_this_process_and_in_others() {
    let printed = script("learning", "vectors");
    for line in ["4 environments, 0 processes", "4 environments, 2 processes", "a robot that dies"]
    {
        assert!(printed.contains(line), "{printed}");
    }
}

#[test]
#[ignore = "needs the trainers that tests/learning/install installs"]
fn torchrl_wrapper_rolls_out_an_episode() {
    let printed = script("learning", "torchrl_wrapper");
    assert!(printed.contains("rollout (20,)"), "{printed}");
}

#[test]
#[ignore = "needs RLlib, which tests/learning/install rllib installs"]
fn rllib_wrapper_steps_episodes_and_trains_with_ppo() {
    let printed = script("rllib", "rllib_wrapper");
    for line in [
        "stepped 100 steps, 3 robots at the end",
        "stepped 100 steps, 2 robots at the end",
        "trained 3 iterations, 0 worker processes, faults []",
        "trained 3 iterations, 0 worker processes, faults ['kill r2 @0.2']",
        "trained 3 iterations, 1 worker processes, faults []",
    ] {
        assert!(printed.contains(line), "no {line:?} in {printed}");
    }
}

#[test]
#[ignore = "needs the trainers that tests/learning/install installs"]
fn policy_of_stable_baselines3_runs_as_processes() {
    crate::pages::book::follow_training();
}
