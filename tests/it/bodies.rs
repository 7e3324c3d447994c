//! The guard's guarantee for robots that are controlled at their axle midpoints: adversarial runs as in `hostile`, with
//! and without inertia and walls, and mixed with robots that have front points. The chapter's cases and swaps with the
//! same bodies.

use crate::harness::{in_parallel, times};
use crate::hostile::{
    HostileCase, S, adversaries_and_wishes, fleet_of_scenario, hostile_trial, margin, swap,
};
use crate::model::{
    ADVERSARIES, Adversary, Expiry, FAULT_PROFILES, FaultProfile, Fleet, INERTIAS, Trial, Wish,
};
use crate::oracle::{scenario, simulate};

/// Returns every fleet, without and with inertia, every second one among walls. In every third fleet each second robot
/// has a front point.
fn fleets(round: usize) -> Vec<(String, Fleet)> {
    let mut fleets = Vec::new();
    let mut seed = 7000 * round as u64;
    let period = ["period_s=0.01", "period_s=0.02"][round % 2];
    let of_scenarios =
        ["triangle", "triangle-d", "containment"].map(|name| fleet_of_scenario(name, &[period]));
    let swaps = [swap(6, period), swap(8, period)];
    for (number, fleet) in of_scenarios.into_iter().chain(swaps).enumerate() {
        for inertia in [None, Some(INERTIAS[(round + number) % INERTIAS.len()])] {
            seed += 1;
            let axle = match seed % 3 {
                0 => fleet.clone().at_axle_in_turn(),
                _ => fleet.clone().at_axle(),
            };
            let axle = inertia.map_or(axle.clone(), |inertia| axle.with_inertia(inertia));
            let axle = if seed.is_multiple_of(2) { axle.among_walls(seed) } else { axle };
            fleets.push((format!("fleet {number}, {period}, {inertia:?}, {seed}"), axle));
        }
    }
    fleets
}

/// Simulates 80 runs a round, each round with another fault profile.
#[test]
fn in_960_adversarial_runs_axle_midpoints_keep_d_and_clearance() {
    let rounds = 12 * times();
    let (mut seed, mut late, mut freezes, mut kills) = (0, 0, 0, 0);
    let mut closest_m = f64::INFINITY;
    for (round, profile) in FAULT_PROFILES.into_iter().cycle().take(rounds).enumerate() {
        let mut cases = Vec::new();
        for (name, fleet) in fleets(round) {
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
fn lifetime_from_arrival_violates_d_at_the_axle() {
    let fleet = fleet_of_scenario("containment", &["period_s=0.01"]).at_axle();
    let trial =
        |seed, expiry| Trial { expiry, ..hostile_trial(seed, Adversary::JustInTime, Wish::Ram) };
    let below = (0..40).filter(|&seed| {
        assert!(margin(&fleet, trial(seed, Expiry::FromSample)).0 >= 0.0, "{seed}");
        margin(&fleet, trial(seed, Expiry::FromArrival)).0 < 0.0
    });
    let below = below.count();
    assert!(below >= 5, "{below} of 40");
}

#[test]
fn shorter_command_timeout_in_the_guard_violates_d_at_the_axle() {
    let fleet = fleet_of_scenario("containment", &["period_s=0.02"]).at_axle();
    let mut hasty = fleet.clone();
    hasty.agents.iter_mut().for_each(|agent| agent.command_lifetime_ns /= 4);
    let below = (0..40).filter(|&seed| {
        let adversary = ADVERSARIES[seed as usize % ADVERSARIES.len()];
        margin(&hasty, hostile_trial(seed, adversary, Wish::Ram)).0 < 0.0
    });
    let below = below.count();
    assert!(below > 5, "{below} of 40");
}

/// Maximum errors of the last 10 % of the chapter's cases at T = 5 ms, m.
const CASES: [(&str, f64, f64); 3] = [
    ("bodies/triangle-axle", 0.2, 1e-5),
    ("bodies/pentagon-axle", 0.3, 3.5e-4),
    ("bodies/containment-axle", 0.2, 1.2e-3),
];

#[test]
fn chapter_cases_at_the_axle_are_as_exact_as_at_a_front_point() {
    let measured = in_parallel(&CASES, |&(name, ..)| simulate(&scenario(name, &[])));
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
