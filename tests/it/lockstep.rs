//! Lockstep: real processes match the prediction of the oracle bit for bit.

use outcome::metrics::RunMetrics;

use crate::golden::AS_PROCESSES;
use crate::harness::{FinishedRun, map_in_parallel, run};
use crate::oracle::{scenario, simulate};

/// Returns the names of all scenarios with at most `robots_max` robots, from the folder, so that new files are
/// included.
fn shipped(robots_max: usize) -> Vec<String> {
    let folder = concat!(env!("CARGO_MANIFEST_DIR"), "/scenarios");
    let paths = std::fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().path());
    let scenarios = paths.filter(|path| path.extension().is_some_and(|end| end == "toml"));
    let names = scenarios.map(|path| path.file_stem().unwrap().to_str().unwrap().to_owned());
    let mut names: Vec<String> =
        names.filter(|name| scenario(name, &[]).robots.len() <= robots_max).collect();
    names.sort();
    assert!(names.iter().any(|name| name == "triangle"), "{folder}: {names:?}");
    names
}

/// Runs real processes with these assignments. Checks that their trajectory is the prediction of the oracle.
fn run_as_predicted(name: &str, set: &[&str]) -> (FinishedRun, RunMetrics) {
    let ended = run(name).lockstep().sets(set).finish();
    ended.exits_with(0).assert_leaves_nothing();
    let predicted = simulate(&scenario(name, set));
    let hash = predicted.trajectory_hash.as_deref().unwrap();
    ended.assert_holds(ended.hash() == hash, format!("{name} {set:?}: the hash is {hash}"));
    (ended, predicted)
}

/// The scenarios in [`AS_PROCESSES`] are left out: `golden` compares their runs, in both drivers, with stored results.
#[test]
fn every_process_run_equals_the_prediction_of_the_oracle() {
    let mut names = shipped(12);
    names.retain(|name| !AS_PROCESSES.contains(&name.as_str()));
    map_in_parallel(&names, |name| {
        let (ended, predicted) = run_as_predicted(name, &[]);
        let distance_m = predicted.min_distance_m.unwrap();
        let same = (ended.number("/min_distance_m") - distance_m).abs() < 1e-12;
        ended.assert_holds(same, format!("{distance_m} m apart"));
    });
}

#[test]
fn sixty_four_robots_follow_one_leader_and_keep_their_distance() {
    // Only a part of the run: 66 processes take processor time from real-time tests that run in parallel.
    let (ended, _) = run_as_predicted("swarm64", &["duration_s=20", "expect.converged_by_s=18"]);
    let errors = ended.summary["final_error_m"].as_object().unwrap();
    ended.assert_holds(errors.len() == 64, "64 robots have an error");
    ended.assert_holds(errors.values().all(|error| error.is_number()), "each was alive to the end");
    ended.assert_keeps_d();
    // Measured values are below 1 s. A run without it, or with a very slow start, is broken.
    ended.assert_holds((1e-3..10.0).contains(&ended.number("/wall/startup_s")), "they came up");
}

#[test]
fn every_avoidance_method_matches_the_oracle() {
    map_in_parallel(&["none", "focus", "orca", "cbf-qp", "rbl"], |kind| {
        let kind = format!("avoidance.kind={kind}");
        let set = [
            &kind,
            "avoidance.horizon_s=2",
            "avoidance.barrier_per_s=2",
            "avoidance.cell_radius_m=0.6",
            "avoidance.spread_m=0.1",
            "avoidance.approach_per_s=10",
            "duration_s=8",
            "expect={}",
        ];
        run_as_predicted("triangle-d", &set);
    });
}

#[test]
fn runs_agree_for_any_start_order_and_parallel_runs() {
    // The seed determines the order in which processes are started.
    let mut hashes = map_in_parallel(&["0", "1", "2", "3"], |seed| {
        let other_run = run("triangle").lockstep().start();
        let ended = run("triangle-kill").lockstep().args(["--seed", seed]).finish();
        ended.exits_with(0).assert_leaves_nothing();
        other_run.finish().exits_with(0).assert_leaves_nothing();
        ended.hash().to_owned()
    });
    hashes.dedup();
    let predicted = simulate(&scenario("triangle-kill", &[])).trajectory_hash.unwrap();
    assert_eq!(hashes, [predicted]);
}

/// A scenario, its minimum distance (d) in m, and the maximum loss of d with the literal focus at 0.1 ms.
const FOCUS: [(&str, f64, f64); 2] = [("pentagon", 0.3, 0.01), ("containment", 0.2, 0.04)];

#[test]
fn literal_focus_almost_keeps_d_at_a_period_of_100_us() {
    map_in_parallel(&FOCUS, |(name, d, loss)| {
        // Robots are closest on their way into the formation, within 5 s.
        let set = ["avoidance.kind=focus", "period_s=0.0001", "duration_s=5", "expect={}"];
        let distance = simulate(&scenario(name, &set)).min_distance_m.unwrap() / d;
        assert!((1.0 - loss..1.0).contains(&distance), "{name}: {distance} d");
    });
}

#[test]
fn swap_and_lattice_arrive_from_disturbed_starts() {
    let disturbances = ["swap-8", "lattice-12"].map(|name| (1..=4).map(move |by| (name, by)));
    let disturbances: Vec<(&str, i32)> = disturbances.into_iter().flatten().collect();
    map_in_parallel(&disturbances, |&(name, disturbance)| {
        let mut scenario = scenario(name, &[]);
        for (robot, number) in scenario.robots.iter_mut().zip(1..) {
            let phase = f64::from(disturbance * number);
            robot.start.x_m += 0.02 * phase.sin();
            robot.start.y_m += 0.02 * (2.0 * phase).sin();
            robot.start.heading_rad += 0.5 * (3.0 * phase).sin();
        }
        let simulated = simulate(&scenario);
        let (distance_m, error_m) =
            (simulated.min_distance_m.unwrap(), simulated.final_error_m_max.unwrap());
        assert!(distance_m >= 0.2, "{name}, disturbance {disturbance}: {distance_m}");
        assert!(error_m < 1e-3, "{name}, disturbance {disturbance}: {error_m}");
    });
}

#[test]
fn run_with_partial_last_period_ends_at_its_last_tick() {
    let ended = run("triangle").lockstep().sets(["period_s=0.03", "duration_s=0.1", "expect={}"]);
    let ended = ended.finish();
    ended.exits_with(0).assert_leaves_nothing();
    ended.assert_holds(ended.number("/ticks") == 3.0, "three ticks of 0.03 s");
}
