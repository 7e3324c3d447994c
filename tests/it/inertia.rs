//! The promise where nobody stops at once: the adversarial runs of `hostile`, with robots that have
//! inertia, half of them among walls, under the guard that knows it and under the one that does not.

use std::f64::consts::TAU;

use agent::brain::Brain;
use experiment::scenario::Scenario;
use formation::Vec2;
use formation::front_point::front_point;
use formation::pose::{Pose, wrap_angle};
use formation::random::SplitMix64;
use outcome::metrics::Measures;
use protocol::brief::AgentBrief;

use crate::hostile::{
    Case, PERIODS, S, TRIANGLES, adversaries_and_wishes, hostile, margin, named, on_all_cores, swap,
};
use crate::model::{Fleet, HARDSHIPS, Hardship, INERTIAS, Trial};
use crate::oracle::{self, scenario};

/// Every fleet at every period, with every inertia in turn.
fn fleets(round: usize) -> Vec<(String, Fleet)> {
    let mut fleets = Vec::new();
    let mut inertias = INERTIAS.into_iter().cycle().skip(round);
    let mut seed = 1000 * round as u64;
    for period in PERIODS {
        let of_scenarios = TRIANGLES.map(|name| (name.to_owned(), named(name, &[period])));
        let swaps = [6, 7, 8].map(|n| (format!("swap of {n}"), swap(n, period)));
        for (name, fleet) in of_scenarios.into_iter().chain(swaps) {
            let inertia = inertias.next().expect("without end");
            let fleet = fleet.with_inertia(inertia);
            seed += 1;
            // Every second one, in turn.
            let walls = seed.is_multiple_of(2);
            let fleet = if walls { fleet.among_walls(seed) } else { fleet };
            let walls = if walls { format!(", walls of {seed}") } else { String::new() };
            fleets.push((format!("{name}, {period}, {inertia:?}{walls}"), fleet));
        }
    }
    fleets
}

/// 168 runs a round, each round under another hardship; how many of the same runs, without hardship,
/// fall below d or clearance under the guard that does not know of inertia, of how many, and the worst.
fn nobody_comes_nearer_than_d(rounds: usize) {
    let (mut seed, mut late, mut freezes, mut kills) = (0, 0, 0, 0);
    let (mut compared, mut below) = (0, 0);
    let (mut worst, mut worst_clearance) = (f64::INFINITY, f64::INFINITY);
    let (mut closest, mut beside_walls) = (f64::INFINITY, f64::INFINITY);
    let mut among_walls = 0;
    for (round, hardship) in HARDSHIPS.into_iter().cycle().take(rounds).enumerate() {
        let mut cases = Vec::new();
        for (name, fleet) in fleets(round / HARDSHIPS.len() + round) {
            let unknowing = fleet.clone().without_knowing_its_inertia();
            let fleet = fleet.under(hardship);
            for (adversary, wish) in adversaries_and_wishes() {
                seed += 1;
                let trial = Trial { duration_ns: 2 * S, ..hostile(seed, adversary, wish) };
                let name = format!("{name}, {hardship:?}, {trial:?}");
                let compare = (hardship == Hardship::Nothing).then(|| unknowing.clone());
                cases.push((Case { name, fleet: fleet.clone(), trial }, compare));
            }
        }
        let outcomes = on_all_cores(&cases, |(Case { fleet, trial, .. }, unknowing)| {
            let compared = unknowing.as_ref().map(|unknowing| margin(unknowing, *trial));
            (margin(fleet, *trial), compared)
        });
        for ((case, _), ((margin_m, outcome), unknowing)) in cases.iter().zip(outcomes) {
            let Case { name, fleet: Fleet { plant, .. }, .. } = case;
            assert!(margin_m >= 0.0, "{name}: {margin_m}, {outcome:?}");
            closest = closest.min(outcome.closest_m - plant.distance_min_m);
            beside_walls = beside_walls.min(outcome.clearance_m - plant.clearance_m);
            among_walls += u64::from(outcome.clearance_m.is_finite());
            late += outcome.commands_late;
            freezes += outcome.freezes;
            kills += outcome.kills;
            if let Some((margin_m, outcome)) = unknowing {
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
         {beside_walls:e} m, {late} late, {freezes} frozen, {kills} killed; without knowing: {below} of \
         {compared} below, worst {worst} d and {worst_clearance} of the clearance"
    );
    assert_eq!(seed, 168 * rounds as u64);
    assert!(
        late.min(freezes).min(kills) > seed / 2,
        "{late} late, {freezes} frozen, {kills} killed"
    );
    assert!(20 * below >= 3 * compared, "only {below} of {compared} runs show a broken promise");
}

#[test]
fn in_2016_adversarial_runs_no_two_robots_with_inertia_come_nearer_than_d() {
    nobody_comes_nearer_than_d(12);
}

/// `cargo test --release --test it -- --ignored --nocapture adversarial_runs_no_two_robots_with_inertia`
#[test]
#[ignore = "minutes; ten times as many seeds"]
fn in_20160_adversarial_runs_no_two_robots_with_inertia_come_nearer_than_d() {
    nobody_comes_nearer_than_d(120);
}

/// `swap-8-burger` from starts drawn from this seed: each robot off its place on the circle, in any
/// heading.
fn swap_from(seed: u64) -> Scenario {
    let mut dice = SplitMix64::new(seed);
    let mut swap = scenario("swap-8-burger", &[]);
    for robot in &mut swap.robots {
        let mut off = || 0.2 * (dice.unit() - 0.5);
        let alpha = front_point(robot.start, robot.front_point_m) + Vec2::new(off(), off());
        let heading_rad = wrap_angle(TAU * dice.unit());
        let back = robot.front_point_m * Vec2::new(heading_rad.cos(), heading_rad.sin());
        robot.start = Pose { x_m: alpha.x - back.x, y_m: alpha.y - back.y, heading_rad };
    }
    swap
}

/// The same of robots that stop at once.
fn without_inertia(mut scenario: Scenario) -> Scenario {
    for robot in &mut scenario.robots {
        robot.limits = None;
    }
    scenario.avoidance.braking_time_max_s = 0.0;
    scenario
}

/// Runs it with the guard that does not know that robots have inertia.
fn simulate_unknowing(scenario: &Scenario) -> Measures {
    oracle::simulate_with(scenario, &|brief, incarnation| {
        let mut brief = AgentBrief { limits: None, ..brief.clone() };
        brief.avoidance.braking_time_max_s = 0.0;
        Brain::new(&brief, incarnation).expect("a checked brief")
    })
}

/// Mean time until all have arrived, s, how many did, and the smallest distance in units of d.
fn told(what: &str, trials: &[Measures]) -> (usize, f64) {
    let arrived: Vec<f64> = trials.iter().filter_map(|trial| trial.converged_at_s).collect();
    let mean_s = arrived.iter().sum::<f64>() / arrived.len() as f64;
    let closest = trials.iter().filter_map(|trial| trial.min_distance_m).fold(f64::MAX, f64::min);
    let ratio = closest / 0.42;
    println!("| {what} | {} of {} | {mean_s:.1} | {ratio:.3} |", arrived.len(), trials.len());
    (arrived.len(), ratio)
}

/// `cargo test --release --test it -- --ignored --nocapture swaps_of_eight_burgers`
#[test]
#[ignore = "a table of docs/explanation/inertia.md: 60 trials of a minute"]
fn swaps_of_eight_burgers_arrive_and_keep_d_and_without_the_guard_that_knows_they_do_not() {
    let swaps: Vec<Scenario> = (1..=20).map(swap_from).collect();
    println!(
        "| guard, plant | arrived | mean time (s) | smallest distance / d |\n|---|---|---|---|"
    );
    let ideal: Vec<_> =
        swaps.iter().map(|s| oracle::simulate(&without_inertia(s.clone()))).collect();
    told("without inertia, robots that stop at once", &ideal);
    let unknowing: Vec<_> = swaps.iter().map(simulate_unknowing).collect();
    let (_, without) = told("without inertia, Burgers", &unknowing);
    let knowing: Vec<_> = swaps.iter().map(oracle::simulate).collect();
    let (arrived, with) = told("with inertia, Burgers", &knowing);
    assert!(arrived == 20 && with >= 1.0 && without < 1.0);
}

/// `cargo test --release --test it -- --ignored --nocapture what_inertia_costs`
#[test]
#[ignore = "a table of docs/explanation/inertia.md: 15 runs"]
fn what_inertia_costs_is_time_and_never_distance() {
    let cases = [
        ("triangle", "period_s=0.005"),
        ("pentagon", "period_s=0.005"),
        ("containment", "period_s=0.005"),
    ];
    println!(
        "| case | v_max / a (s) | converged at (s) | worst error of the last 10 % (m) | smallest distance / d |"
    );
    println!("|---|---|---|---|---|");
    for (name, period) in cases {
        for braking_s in [0.0, 0.05, 0.1, 0.2, 0.5] {
            let free = scenario(name, &[period]);
            let (v_max, ell) = (free.avoidance.speed_max_m_s, free.robots[0].front_point_m);
            let (a, a_w) = (v_max / braking_s, v_max / (ell * braking_s));
            let limits = format!(
                "robot_defaults.limits={{acceleration_m_s2={a:.6},turn_acceleration_rad_s2={a_w:.6}}}"
            );
            let set = [period, &limits];
            let simulated = if braking_s > 0.0 { scenario(name, &set) } else { free };
            let run = oracle::simulate(&simulated);
            let ratio = run.min_distance_m.unwrap() / simulated.avoidance.distance_min_m;
            let converged = run.converged_at_s.map_or("-".to_owned(), |s| format!("{s:.1}"));
            println!(
                "| `{name}` | {braking_s} | {converged} | {:.1e} | {ratio:.3} |",
                run.final_error_m_max.unwrap()
            );
            assert!(ratio >= 1.0, "{name}, {braking_s}");
        }
    }
}
