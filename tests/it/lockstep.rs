//! Lockstep: real processes do, bit by bit, what the oracle foretells.

use supervisor::metrics::Measures;
use supervisor::scenario::Scenario;
use supervisor::scenario::read::{Overrides, read};

use crate::harness::run;
use crate::oracle;

const STARTS: [&str; 4] = ["triangle", "triangle-b", "triangle-c", "triangle-d"];

fn scenario(name: &str, set: &[&str]) -> Scenario {
    let set = set.iter().map(|&assignment| assignment.into()).collect();
    let overrides = Overrides { set, ..Overrides::default() };
    let path = format!("{}/scenarios/{name}.toml", env!("CARGO_MANIFEST_DIR"));
    match read(path.as_ref(), &overrides, &agent::laws::descriptions()) {
        Ok((scenario, ..)) => scenario,
        Err(diagnostic) => panic!("{}", diagnostic.render(false)),
    }
}

/// Smallest distance and worst final error, m.
fn far(flight: &Measures) -> (f64, f64) {
    (flight.min_distance_m.unwrap(), flight.final_error_m_max.unwrap())
}

#[track_caller]
fn assert_within(share: f64, found: f64, expected: f64, what: &str) {
    let off = (found / expected - 1.0).abs();
    assert!(off <= share, "{what}: {found} is not within {share} of {expected}");
}

#[test]
fn every_run_of_real_processes_is_the_one_the_oracle_foretold() {
    for name in STARTS.into_iter().chain(["triangle-kill", "pentagon", "containment"]) {
        let ended = run(name).lockstep().finish();
        ended.exits_with(0).leaves_nothing();
        let foretold = oracle::fly(&scenario(name, &[]));
        let hash = foretold.trajectory_hash.unwrap();
        ended.claim(ended.hash() == hash, format!("{name}: the hash is {hash}"));
        let distance = foretold.min_distance_m.unwrap();
        let same = (ended.number("/min_distance_m") - distance).abs() < 1e-12;
        ended.claim(same, format!("{distance} m apart"));
    }
}

#[test]
fn every_kind_of_avoidance_is_foretold() {
    for kind in ["none", "focus"] {
        let set = format!("avoidance.kind={kind}");
        let ended =
            run("triangle-d").lockstep().set(&set).set("duration_s=8").set("expect={}").finish();
        let expected = oracle::fly(&scenario("triangle-d", &[&set, "duration_s=8", "expect={}"]));
        ended.exits_with(0);
        ended.claim(
            Some(ended.hash()) == expected.trajectory_hash.as_deref(),
            format!("{kind}: foretold"),
        );
    }
}

#[test]
fn ten_runs_agree_whatever_order_the_robots_start_in() {
    // The seed draws the order in which processes are started.
    let hashes: Vec<String> = (0..10)
        .map(|seed| {
            let seed = seed.to_string();
            let ended = run("triangle-kill").lockstep().args(["--seed", seed.as_str()]).finish();
            ended.exits_with(0).hash().to_owned()
        })
        .collect();
    assert!(hashes.iter().all(|hash| *hash == hashes[0]), "{hashes:?}");
    let undisturbed = oracle::fly(&scenario("triangle", &[])).trajectory_hash;
    assert_ne!(Some(&hashes[0]), undisturbed.as_ref());
}

#[test]
fn two_runs_at_once_are_the_same_as_alone() {
    let (one, other) =
        (run("triangle").lockstep().start(), run("triangle-kill").lockstep().start());
    for (run, name) in [(one, "triangle"), (other, "triangle-kill")] {
        let ended = run.finish();
        let foretold = oracle::fly(&scenario(name, &[])).trajectory_hash.unwrap();
        ended.exits_with(0).leaves_nothing();
        ended.claim(ended.hash() == foretold, format!("{name} is undisturbed"));
    }
}

#[test]
fn guard_converges_from_every_start_and_keeps_d_at_every_period() {
    for name in STARTS {
        for period in ["period_s=0.001", "period_s=0.005", "period_s=0.02"] {
            let flight = oracle::fly(&scenario(name, &[period]));
            let (distance_m, error_m) = far(&flight);
            assert!(distance_m >= 0.2, "{name} {period}: {distance_m}");
            assert!(error_m < 1e-3, "{name} {period}: {error_m}");
        }
    }
}

#[test]
fn without_avoidance_the_robots_come_as_near_as_was_measured() {
    for period in ["period_s=0.001", "period_s=0.005"] {
        for (name, expected) in STARTS.into_iter().zip([0.188, 0.0096, 0.091, 0.0935]) {
            let flight = oracle::fly(&scenario(name, &["avoidance.kind=none", period]));
            assert_within(0.05, far(&flight).0, expected, name);
        }
    }
}

#[test]
fn the_literal_focus_falls_below_d_and_start_c_ends_in_the_known_livelock() {
    for name in STARTS {
        let flight = oracle::fly(&scenario(name, &["avoidance.kind=focus", "period_s=0.001"]));
        let (distance_m, error_m) = far(&flight);
        assert!(distance_m < 0.2, "{name}: {distance_m}");
        let expected = if name == "triangle-c" { 0.38..0.42 } else { 0.0..1e-3 };
        assert!(expected.contains(&error_m), "{name}: {error_m}");
    }
}

#[test]
fn what_robots_publish_decides_how_well_they_are_followed_and_never_how_near_they_come() {
    for (name, d) in [("pentagon", 0.3), ("containment", 0.2)] {
        let errors = ["gamma", "gamma+beta", "differenced"].map(|kind| {
            let set = format!("published_velocity=\"{kind}\"");
            let (distance_m, error_m) = far(&oracle::fly(&scenario(name, &[&set])));
            assert!(distance_m >= d, "{name}, {kind}: {distance_m}");
            error_m
        });
        assert!(errors.is_sorted() && errors[2] > 1.5 * errors[0], "{name}: {errors:?}");
    }
}

/// A scenario, its d in m, and for each period what was measured.
type Measured = (&'static str, f64, [(f64, f64); 5]);

/// Worst error of the last 10 % and smallest distance / d at periods of 1, 2, 5, 10 and 20 ms, as
/// an independent simulation of the same laws measured them.
const MEASURED: [Measured; 2] = [
    (
        "pentagon",
        0.3,
        [(6.9e-5, 1.050), (1.4e-4, 1.050), (3.5e-4, 1.052), (7.0e-4, 1.084), (1.4e-3, 1.209)],
    ),
    (
        "containment",
        0.2,
        [(2.2e-4, 1.049), (4.3e-4, 1.039), (1.1e-3, 1.049), (2.2e-3, 1.100), (4.4e-3, 1.203)],
    ),
];

#[test]
fn tracking_and_containment_are_as_exact_and_as_far_apart_as_was_measured() {
    for (name, d, rows) in MEASURED {
        for (period_s, (error_m, distance)) in
            [0.001, 0.002, 0.005, 0.01, 0.02].into_iter().zip(rows)
        {
            let flight = oracle::fly(&scenario(name, &[&format!("period_s={period_s}")]));
            let (found_m, found_error_m) = far(&flight);
            assert!(found_m >= d, "{name} at {period_s} s: {found_m}");
            assert_within(0.05, found_m / d, distance, name);
            assert!(found_error_m < 1.1 * error_m, "{name} at {period_s} s: {found_error_m}");
        }
    }
}
