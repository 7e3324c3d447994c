//! The guard's guarantee for robots that are controlled at their axle midpoints, for omnidirectional ones, for drones,
//! for cars, for front points whose speed and turn rate change independently, and for teams of robots with different
//! sizes, speed limits and command timeouts: adversarial runs as in `hostile`, with and without inertia and walls, and
//! mixed with robots that have front points. The chapter's cases and swaps with the same bodies. `tests/fuzz/bodies`
//! makes 10,000 adversarial runs for each body.

use crate::harness::{map_in_parallel, repetition_factor, run};
use crate::hostile::{
    HostileCase, NS_PER_S, adversaries_and_velocities, fleet_of_scenario, hostile_trial, margin,
    swap,
};
use crate::model::{
    ADVERSARIES, Adversary, Expiry, FAULT_PROFILES, FaultProfile, Fleet, INERTIAS,
    RequestedVelocity, Trial,
};
use crate::oracle::{scenario, simulate, with_faults};

/// Returns every fleet, without and with inertia, every second one among walls. Every third fleet is `mixed` with
/// robots that have front points, the others consist of `body` alone.
fn fleets(round: usize, body: Make, mixed: Make) -> Vec<(String, Fleet)> {
    let mut fleets = Vec::new();
    let mut seed = 7000 * round as u64;
    let period = ["period_s=0.01", "period_s=0.02"][round % 2];
    let of_scenarios =
        ["triangle", "triangle-d", "containment"].map(|name| fleet_of_scenario(name, &[period]));
    let swaps = [swap(6, period), swap(8, period)];
    for (number, fleet) in of_scenarios.into_iter().chain(swaps).enumerate() {
        for inertia in [None, Some(INERTIAS[(round + number) % INERTIAS.len()])] {
            seed += 1;
            let make = if seed.is_multiple_of(3) { mixed } else { body };
            let changed = make(fleet.clone());
            let changed = inertia.map_or(changed.clone(), |inertia| changed.with_inertia(inertia));
            let changed = if seed.is_multiple_of(2) { changed.among_walls(seed) } else { changed };
            fleets.push((format!("fleet {number}, {period}, {inertia:?}, {seed}"), changed));
        }
    }
    fleets
}

#[test]
fn in_960_adversarial_runs_axle_midpoints_keep_d_and_clearance() {
    assert_keeps_d_and_clearance(Fleet::at_axle, Fleet::at_axle_in_turn);
}

#[test]
fn in_960_adversarial_runs_omni_robots_keep_d_and_clearance() {
    assert_keeps_d_and_clearance(Fleet::omnidirectional, Fleet::of_all_bodies);
}

#[test]
fn in_960_adversarial_runs_drones_keep_d_and_clearance() {
    assert_keeps_d_and_clearance(Fleet::drones, Fleet::drones_in_turn);
}

#[test]
fn in_960_adversarial_runs_cars_keep_d_and_clearance() {
    assert_keeps_d_and_clearance(Fleet::cars, Fleet::cars_in_turn);
}

#[test]
fn in_960_adversarial_runs_teams_keep_the_distance_of_each_pair() {
    // Every fourth round without sensing classes.
    let into_team = |fleet: Fleet, round: usize| fleet.into_team(round % 4 != 3);
    keeps_distances(|fleet| fleet, Fleet::of_all_bodies, into_team);
}

#[test]
fn in_960_adversarial_runs_independent_ramps_keep_d() {
    let change = |fleet: Fleet, _| fleet.with_independent_ramps();
    keeps_distances(|fleet| fleet, Fleet::at_axle_in_turn, change);
}

/// Function that gives the robots of a fleet another body.
type Make = fn(Fleet) -> Fleet;

/// Simulates 80 runs a round, each round with another fault profile, of fleets as in [`fleets`].
fn assert_keeps_d_and_clearance(body: Make, mixed: Make) {
    keeps_distances(body, mixed, |fleet, _| fleet);
}

/// Simulates the runs of [`assert_keeps_d_and_clearance`], with the fleets of a round changed by `change`.
fn keeps_distances(body: Make, mixed: Make, change: fn(Fleet, usize) -> Fleet) {
    let rounds = 12 * repetition_factor();
    let (mut seed, mut late, mut freezes, mut kills) = (0, 0, 0, 0);
    let mut closest_m = f64::INFINITY;
    for (round, profile) in FAULT_PROFILES.into_iter().cycle().take(rounds).enumerate() {
        let mut cases = Vec::new();
        for (name, fleet) in fleets(round, body, mixed) {
            let fleet = change(fleet.under(profile), round);
            for (adversary, requested_velocity) in adversaries_and_velocities() {
                seed += 1;
                let trial = Trial {
                    duration_ns: 2 * NS_PER_S,
                    ..hostile_trial(seed, adversary, requested_velocity)
                };
                let name = format!("{name}, {profile:?}, {trial:?}");
                cases.push(HostileCase { name, fleet: fleet.clone(), trial });
            }
        }
        let outcomes = map_in_parallel(&cases, |case| margin(&case.fleet, case.trial));
        for (case, (margin_m, outcome)) in cases.iter().zip(outcomes) {
            assert!(margin_m >= 0.0, "{}: {margin_m}, {outcome:?}", case.name);
            if profile == FaultProfile::Nothing {
                closest_m = closest_m.min(margin_m);
            }
            late += outcome.commands_late;
            freezes += outcome.freezes;
            kills += outcome.kills;
        }
    }
    println!("{seed} runs, closest {closest_m:e} m, {late} late, {freezes} frozen, {kills} killed");
    assert_eq!(seed, 80 * rounds as u64);
    // The faults did happen, and robots did come close.
    assert!(late.min(freezes).min(kills) > seed / 2, "{late}, {freezes}, {kills}");
    assert!(closest_m < 1e-3, "{closest_m}");
}

/// Every body without a front point.
const BODIES: [Make; 4] = [Fleet::at_axle, Fleet::omnidirectional, Fleet::drones, Fleet::cars];

#[test]
fn lifetime_from_arrival_violates_d_for_each_body() {
    for body in BODIES {
        let fleet = body(fleet_of_scenario("containment", &["period_s=0.01"]));
        let trial = |seed, expiry| Trial {
            expiry,
            ..hostile_trial(seed, Adversary::JustInTime, RequestedVelocity::Ram)
        };
        let below = (0..40).filter(|&seed| {
            assert!(margin(&fleet, trial(seed, Expiry::FromSample)).0 >= 0.0, "{seed}");
            margin(&fleet, trial(seed, Expiry::FromArrival)).0 < 0.0
        });
        let below = below.count();
        assert!(below >= 5, "{below} of 40");
    }
}

#[test]
fn shorter_timeout_in_the_guard_violates_d_for_each_body() {
    for body in BODIES {
        let mut hasty = body(fleet_of_scenario("containment", &["period_s=0.02"]));
        hasty.agents.iter_mut().for_each(|agent| agent.command_lifetime_ns /= 4);
        let below = (0..40).filter(|&seed| {
            let adversary = ADVERSARIES[seed as usize % ADVERSARIES.len()];
            margin(&hasty, hostile_trial(seed, adversary, RequestedVelocity::Ram)).0 < 0.0
        });
        let below = below.count();
        assert!(below > 5, "{below} of 40");
    }
}

/// Maximum errors of the last 10 % of the chapter's cases at T = 5 ms, m.
const CASES: [(&str, f64, f64); 3] = [
    ("bodies/triangle-axle", 0.2, 1e-5),
    ("bodies/pentagon-axle", 0.3, 3.5e-4),
    ("bodies/containment-axle", 0.2, 1.2e-3),
];

#[test]
fn chapter_cases_at_the_axle_are_as_exact_as_at_a_front_point() {
    are_as_exact_as_at_a_front_point(&[]);
}

#[test]
fn chapter_cases_of_omni_robots_are_as_exact_as_front_points() {
    are_as_exact_as_at_a_front_point(&["robot_defaults.drive=omni"]);
    are_as_exact_as_at_a_front_point(&[
        "robot_defaults.drive=omni",
        "robot_defaults.turn_rate_max_rad_s=0.0",
    ]);
}

/// Checks distances and errors of the chapter's cases at the axle with these keys set.
fn are_as_exact_as_at_a_front_point(set: &[&str]) {
    let measured = map_in_parallel(&CASES, |&(name, ..)| simulate(&scenario(name, set)));
    for (&(name, d, limit_m), simulated) in CASES.iter().zip(measured) {
        let (min_distance_m, error_m) =
            (simulated.min_distance_m.unwrap(), simulated.final_error_m_max.unwrap());
        println!(
            "{name}: error {error_m:.2e} m, nearest {:.3} d, converged at {:?} s",
            min_distance_m / d,
            simulated.converged_at_s
        );
        assert!(min_distance_m >= d, "{name}: {min_distance_m}");
        assert!(error_m <= limit_m, "{name}: {error_m}");
    }
}

/// Scenarios of each body, with inertia except for cars and the team.
const SWAPS: [(&str, &[&str]); 5] = [
    ("bodies/parking-8", &[]),
    ("bodies/parking-8", &["robot_defaults.drive=omni"]),
    ("bodies/drones-8", &[]),
    ("bodies/cars-8", &[]),
    ("bodies/team-9", &[]),
];

#[test]
fn faults_of_each_body_give_one_hash_in_both_drivers() {
    let faults = [
        "kill r2 @1 restart 0.5",
        "freeze r3 @2 for 0.5",
        "loss r4 commands of 0.3 @0.5 for 4",
        "wheels r5 limit 0.1 @1 for 2",
    ];
    for (name, set) in SWAPS {
        let set: Vec<&str> = [set, &["duration_s=6", "expect={}"]].concat();
        let expected = simulate(&with_faults(name, &set, &faults)).trajectory_hash.unwrap();
        for _ in 0..2 {
            let ended = run(name).lockstep().sets(set.iter().copied()).faults(faults).finish();
            ended.exits_with(0).assert_leaves_nothing();
            ended.assert_holds(ended.hash() == expected, format!("as in process: {expected}"));
        }
    }
}

#[test]
fn omni_robots_and_drones_reach_their_goals_and_final_headings() {
    for (name, set) in &SWAPS[1..3] {
        let simulated = simulate(&scenario(name, set));
        let error_m = simulated.final_error_m_max.unwrap();
        assert!(error_m < 2e-3 && simulated.min_distance_m.unwrap() >= 0.2, "{error_m}");
    }
}

#[test]
fn cars_and_a_team_reach_their_goals() {
    for (name, error_m_max) in [("bodies/cars-8", 0.05), ("bodies/team-9", 2e-3)] {
        let simulated = simulate(&scenario(name, &[]));
        let (error_m, converged) = (simulated.final_error_m_max, simulated.converged_at_s);
        println!("{name}: {error_m:?} m, converged at {converged:?} s");
        assert!(error_m.unwrap() <= error_m_max && converged.is_some(), "{name}: {error_m:?}");
        assert_eq!(simulated.violations, 0, "{name}");
        // Small robots come closer to each other than large ones.
        let is_team = name == "bodies/team-9";
        let min_distance_m = simulated.min_distance_m.unwrap();
        assert_eq!(
            min_distance_m < 0.28 && simulated.min_distance_over_d.is_some(),
            is_team,
            "{min_distance_m}"
        );
        assert!(!is_team || simulated.min_distance_over_d >= Some(1.0));
    }
}

#[test]
fn team_that_senses_no_sizes_keeps_the_largest_distance() {
    let team = simulate(&scenario("bodies/team-9", &["avoidance.classes_sensed=false"]));
    assert_eq!(team.violations, 0);
    // Two small robots keep 0.07 m + 0.14 m as well.
    assert!(team.min_distance_m.unwrap() >= 0.21, "{:?}", team.min_distance_m);
}
