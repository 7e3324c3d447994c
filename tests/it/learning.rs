//! `phalanx.parallel_env` with external trainers, which `tests/learning/install` installs into target/learning.

use std::path::Path;
use std::process::Command;

use crate::harness::{ExitsWith as _, ROOT};

/// Returns the output of a script of tests/learning about the shipped triangle.
#[track_caller]
fn script(name: &str) -> String {
    let programs = Path::new(ROOT).join("target/learning/bin");
    assert!(programs.join("phalanx").exists(), "run tests/learning/install first");
    let mut command = Command::new(programs.join("python3"));
    command.arg(format!("{ROOT}/tests/learning/{name}.py"));
    command.arg(format!("{ROOT}/scenarios/triangle.toml")).exits_with(0).stdout
}

#[test]
#[ignore = "needs the trainers that tests/learning/install installs"]
fn supersuit_steps_copies_in_this_process_and_in_others() {
    let printed = script("vectors");
    for line in ["4 environments, 0 processes", "4 environments, 2 processes", "a robot that dies"]
    {
        assert!(printed.contains(line), "{printed}");
    }
}

#[test]
#[ignore = "needs the trainers that tests/learning/install installs"]
fn torchrl_wrapper_rolls_out_an_episode() {
    let printed = script("torchrl_wrapper");
    assert!(printed.contains("rollout (20,)"), "{printed}");
}

#[test]
#[ignore = "needs the trainers that tests/learning/install installs"]
fn policy_of_stable_baselines3_runs_as_processes() {
    crate::pages::book::follow_training();
}
