//! The guard's guarantee for robots with inertia: the adversarial runs of `hostile`, half of them among walls, with a
//! guard that accounts for inertia and with one that does not.

use crate::harness::{map_in_parallel, repetition_factor};
use crate::hostile::{
    HostileCase, NS_PER_S, PERIODS, TRIANGLES, adversaries_and_velocities, fleet_of_scenario,
    hostile_trial, margin, swap,
};
use crate::model::{FAULT_PROFILES, FaultProfile, Fleet, INERTIAS, Trial};

/// Returns every fleet at every period, with the kinds of inertia in turn.
fn fleets(round: usize) -> Vec<(String, Fleet)> {
    let mut fleets = Vec::new();
    let mut inertias = INERTIAS.into_iter().cycle().skip(round);
    let mut seed = 1000 * round as u64;
    for period in PERIODS {
        let of_scenarios =
            TRIANGLES.map(|name| (name.to_owned(), fleet_of_scenario(name, &[period])));
        let swaps = [6, 7, 8].map(|n| (format!("swap of {n}"), swap(n, period)));
        for (name, fleet) in of_scenarios.into_iter().chain(swaps) {
            let inertia = inertias.next().expect("without end");
            let fleet = fleet.with_inertia(inertia);
            seed += 1;
            // Every second fleet, in turn.
            let walls = seed.is_multiple_of(2);
            let fleet = if walls { fleet.among_walls(seed) } else { fleet };
            let walls = if walls { format!(", walls of {seed}") } else { String::new() };
            fleets.push((format!("{name}, {period}, {inertia:?}{walls}"), fleet));
        }
    }
    fleets
}

/// Simulates 168 runs a round, each round with another fault profile. Prints how many of the same runs without faults
/// violate d or the clearance with a guard that ignores inertia, the number of these runs, and the worst margin.
#[test]
fn in_2016_adversarial_runs_robots_with_inertia_keep_d() {
    let rounds = 12 * repetition_factor();
    let (mut seed, mut late, mut freezes, mut kills) = (0, 0, 0, 0);
    let (mut compared, mut below) = (0, 0);
    let (mut worst, mut worst_clearance) = (f64::INFINITY, f64::INFINITY);
    let (mut closest, mut closest_to_wall) = (f64::INFINITY, f64::INFINITY);
    let mut among_walls = 0;
    for (round, profile) in FAULT_PROFILES.into_iter().cycle().take(rounds).enumerate() {
        let mut cases = Vec::new();
        for (name, fleet) in fleets(round / FAULT_PROFILES.len() + round) {
            let inertia_unaware = fleet.clone().without_knowing_its_inertia();
            let fleet = fleet.under(profile);
            for (adversary, requested_velocity) in adversaries_and_velocities() {
                seed += 1;
                let trial = Trial {
                    duration_ns: 2 * NS_PER_S,
                    ..hostile_trial(seed, adversary, requested_velocity)
                };
                let name = format!("{name}, {profile:?}, {trial:?}");
                let compare = (profile == FaultProfile::Nothing).then(|| inertia_unaware.clone());
                cases.push((HostileCase { name, fleet: fleet.clone(), trial }, compare));
            }
        }
        let outcomes =
            map_in_parallel(&cases, |(HostileCase { fleet, trial, .. }, inertia_unaware)| {
                let compared =
                    inertia_unaware.as_ref().map(|inertia_unaware| margin(inertia_unaware, *trial));
                (margin(fleet, *trial), compared)
            });
        for ((case, _), ((margin_m, outcome), inertia_unaware)) in cases.iter().zip(outcomes) {
            let HostileCase { name, fleet: Fleet { plant, .. }, .. } = case;
            assert!(margin_m >= 0.0, "{name}: {margin_m}, {outcome:?}");
            closest = closest.min(outcome.closest_m - plant.distance_min_m);
            closest_to_wall = closest_to_wall.min(outcome.clearance_m - plant.clearance_m);
            among_walls += u64::from(outcome.clearance_m.is_finite());
            late += outcome.commands_late;
            freezes += outcome.freezes;
            kills += outcome.kills;
            if let Some((margin_m, outcome)) = inertia_unaware {
                compared += 1;
                below += u64::from(margin_m < 0.0);
                worst = worst.min(outcome.closest_m / plant.distance_min_m);
                let clearance_m = plant.clearance_m.max(f64::MIN_POSITIVE);
                worst_clearance = worst_clearance.min(outcome.clearance_m / clearance_m);
            }
        }
    }
    println!(
        "{seed} runs, {among_walls} among walls, closest d + {closest:e} m and clearance + \
         {closest_to_wall:e} m, {late} late, {freezes} frozen, {kills} killed; without knowing: {below} of \
         {compared} below, worst {worst} d and {worst_clearance} of the clearance"
    );
    assert_eq!(seed, 168 * rounds as u64);
    assert!(
        late.min(freezes).min(kills) > seed / 2,
        "{late} late, {freezes} frozen, {kills} killed"
    );
    assert!(20 * below >= 3 * compared, "only {below} of {compared} runs show a broken promise");
}
