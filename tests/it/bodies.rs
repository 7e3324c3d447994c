//! The guard's guarantee for robots that are controlled at their axle midpoints, and for omnidirectional ones: adversarial
//! runs as in `hostile`, with and without inertia and walls, and mixed with robots that have front points. The chapter's
//! cases and swaps with the same bodies.

use crate::harness::{in_parallel, run, times};
use crate::hostile::{
    HostileCase, S, adversaries_and_wishes, fleet_of_scenario, hostile_trial, margin, swap,
};
use crate::model::{
    ADVERSARIES, Adversary, Expiry, FAULT_PROFILES, FaultProfile, Fleet, INERTIAS, Trial, Wish,
};
use crate::oracle::{scenario, simulate, with_faults};

/// Returns every fleet, without and with inertia, every second one among walls. Every third fleet is `mixed` with robots
/// that have front points, the others consist of `body` alone.
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
            let made = make(fleet.clone());
            let made = inertia.map_or(made.clone(), |inertia| made.with_inertia(inertia));
            let made = if seed.is_multiple_of(2) { made.among_walls(seed) } else { made };
            fleets.push((format!("fleet {number}, {period}, {inertia:?}, {seed}"), made));
        }
    }
    fleets
}

#[test]
fn in_960_adversarial_runs_axle_midpoints_keep_d_and_clearance() {
    keeps_d_and_clearance(Fleet::at_axle, Fleet::at_axle_in_turn);
}

#[test]
fn in_960_adversarial_runs_omni_robots_keep_d_and_clearance() {
    keeps_d_and_clearance(Fleet::omnidirectional, Fleet::of_all_bodies);
}

/// Function that gives the robots of a fleet another body.
type Make = fn(Fleet) -> Fleet;

/// Simulates 80 runs a round, each round with another fault profile, of fleets as in [`fleets`].
fn keeps_d_and_clearance(body: Make, mixed: Make) {
    let rounds = 12 * times();
    let (mut seed, mut late, mut freezes, mut kills) = (0, 0, 0, 0);
    let mut closest_m = f64::INFINITY;
    for (round, profile) in FAULT_PROFILES.into_iter().cycle().take(rounds).enumerate() {
        let mut cases = Vec::new();
        for (name, fleet) in fleets(round, body, mixed) {
            let fleet = fleet.under(profile);
            for (adversary, wish) in adversaries_and_wishes() {
                seed += 1;
                let trial = Trial { duration_ns: 2 * S, ..hostile_trial(seed, adversary, wish) };
                let name = format!("{name}, {profile:?}, {trial:?}");
                cases.push(HostileCase { name, fleet: fleet.clone(), trial });
            }
        }
        let outcomes = in_parallel(&cases, |case| margin(&case.fleet, case.trial));
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

#[test]
fn lifetime_from_arrival_violates_d_for_each_body() {
    for body in [Fleet::at_axle as Make, Fleet::omnidirectional] {
        let fleet = body(fleet_of_scenario("containment", &["period_s=0.01"]));
        let trial = |seed, expiry| Trial {
            expiry,
            ..hostile_trial(seed, Adversary::JustInTime, Wish::Ram)
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
    for body in [Fleet::at_axle as Make, Fleet::omnidirectional] {
        let mut hasty = body(fleet_of_scenario("containment", &["period_s=0.02"]));
        hasty.agents.iter_mut().for_each(|agent| agent.command_lifetime_ns /= 4);
        let below = (0..40).filter(|&seed| {
            let adversary = ADVERSARIES[seed as usize % ADVERSARIES.len()];
            margin(&hasty, hostile_trial(seed, adversary, Wish::Ram)).0 < 0.0
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
    let measured = in_parallel(&CASES, |&(name, ..)| simulate(&scenario(name, set)));
    for (&(name, d, most_m), simulated) in CASES.iter().zip(measured) {
        let (near_m, error_m) =
            (simulated.min_distance_m.unwrap(), simulated.final_error_m_max.unwrap());
        println!(
            "{name}: error {error_m:.2e} m, nearest {:.3} d, converged at {:?} s",
            near_m / d,
            simulated.converged_at_s
        );
        assert!(near_m >= d, "{name}: {near_m}");
        assert!(error_m <= most_m, "{name}: {error_m}");
    }
}

/// Scenarios of each body, with inertia.
const SWAPS: [(&str, &[&str]); 3] = [
    ("bodies/parking-8", &[]),
    ("bodies/parking-8", &["robot_defaults.drive=omni"]),
    ("bodies/drones-8", &[]),
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
            ended.exits_with(0).leaves_nothing();
            ended.claim(ended.hash() == expected, format!("as in process: {expected}"));
        }
    }
}

#[test]
fn omni_robots_and_drones_reach_their_goals_and_final_headings() {
    for (name, set) in &SWAPS[1..] {
        let simulated = simulate(&scenario(name, set));
        let error_m = simulated.final_error_m_max.unwrap();
        assert!(error_m < 2e-3 && simulated.min_distance_m.unwrap() >= 0.2, "{error_m}");
    }
}
