//! The oracle: the same controllers and plant composed in one process. A lockstep run of real processes must reproduce
//! its prediction bit by bit.

use experiment::scenario::Scenario;
use experiment::scenario::read::{Overrides, read};
use outcome::metrics::RunMetrics;
use protocol::message::{TruthHeader, TruthRow};
use run::in_process::ControllerFactory;
use run::in_process::measured::{create_controller, measure_run};

/// Reads `scenarios/<name>.toml` with these keys set.
pub fn scenario(name: &str, set: &[&str]) -> Scenario {
    with_faults(name, set, &[])
}

/// Reads `scenarios/<name>.toml` with these keys set and these faults added, in the syntax of `--fault`.
pub fn with_faults(name: &str, set: &[&str], faults: &[&str]) -> Scenario {
    let owned = |list: &[&str]| list.iter().map(|&argument| argument.into()).collect();
    let overrides = Overrides { assignments: owned(set), faults: owned(faults), seed: None };
    let path = format!("{}/scenarios/{name}.toml", env!("CARGO_MANIFEST_DIR"));
    match read(path.as_ref(), &overrides, &agent::catalog()) {
        Ok((scenario, ..)) => scenario,
        Err(diagnostic) => panic!("{}", diagnostic.render(false)),
    }
}

/// Simulates `scenario` in lockstep with its faults, and returns the measures.
pub fn simulate(scenario: &Scenario) -> RunMetrics {
    simulate_with(scenario, Box::new(create_controller))
}

/// Simulates `scenario` with controllers that `make_controller` makes from a process configuration and an incarnation
/// number.
pub fn simulate_with(scenario: &Scenario, make_controller: ControllerFactory) -> RunMetrics {
    run(scenario, make_controller, |_, _, _| {})
}

/// Simulates `scenario` with the usual controllers. `watch` receives every ground-truth sample and which robots were
/// alive at it.
pub fn simulate_watched(
    scenario: &Scenario,
    watch: impl FnMut(&TruthHeader, &[TruthRow], &[bool]),
) -> RunMetrics {
    run(scenario, Box::new(create_controller), watch)
}

fn run(
    scenario: &Scenario,
    make_controller: ControllerFactory,
    mut watch: impl FnMut(&TruthHeader, &[TruthRow], &[bool]),
) -> RunMetrics {
    let measures = measure_run(scenario, make_controller, &mut |header, rows, alive| {
        watch(header, rows, alive);
        true
    });
    measures.expect("it goes on to its end")
}
