//! The guard's guarantee under adversarial timing, in the in-process model of the real-time mode: no two front points
//! come closer than d under any delays, freezes and kills, with exact and with inexact sensors and bodies. Deliberate
//! mistakes show that the same runs find a violation.

use std::f64::consts::TAU;

use formation::Vec2;
use formation::front_point::front_point;
use formation::pose::Pose;
use outcome::metrics::Metrics;
use protocol::brief::{AgentBrief, BodyBrief, Pace};
use protocol::message::PROXIMITY_MAX;

use crate::harness::{map_in_parallel, repetition_factor};
use crate::model::{
    ADVERSARIES, Adversary, Expiry, FAULT_PROFILES, FaultProfile, Fleet, RequestedVelocity, Trial,
    TrialResult, simulate, stay_at,
};
use crate::oracle::scenario;

pub const NS_PER_S: u64 = 1_000_000_000;
pub const TRIANGLES: [&str; 4] = ["triangle", "triangle-b", "triangle-c", "triangle-d"];
pub const PERIODS: [&str; 3] = ["period_s=0.005", "period_s=0.01", "period_s=0.02"];

/// Returns a trial with faults from its beginning to its end.
pub fn hostile_trial(
    seed: u64,
    adversary: Adversary,
    requested_velocity: RequestedVelocity,
) -> Trial {
    let expiry = Expiry::FromSample;
    Trial {
        seed,
        adversary,
        requested_velocity,
        expiry,
        hostile_ns: 3 * NS_PER_S,
        duration_ns: 3 * NS_PER_S,
    }
}

/// Simulates a trial. Returns the margin of the minimum distance to d or of the minimum wall clearance to the required
/// one, whichever is smaller, m, and the outcome.
pub fn margin(fleet: &Fleet, trial: Trial) -> (f64, TrialResult) {
    let outcome = simulate(fleet, trial, |_, _, _| ());
    (margin_of(fleet, &outcome), outcome)
}

/// One run, with the name that a violation is reported with.
pub struct HostileCase {
    pub name: String,
    pub fleet: Fleet,
    pub trial: Trial,
}

/// Returns the margin of a simulated run, m.
fn margin_of(fleet: &Fleet, outcome: &TrialResult) -> f64 {
    outcome.margin_m.min(outcome.clearance_m - fleet.plant.clearance_m)
}

pub fn fleet_of_scenario(name: &str, set: &[&str]) -> Fleet {
    Fleet::from_scenario(&scenario(name, set))
}

/// Returns `n` robots on a circle, each with the opposite point as its goal.
pub fn swap(n: usize, period: &str) -> Fleet {
    let Fleet { mut plant, agents } = fleet_of_scenario("triangle", &[period]);
    let (body, agent) = (plant.robots[0].clone(), agents[0].clone());
    let radius_m = 0.06 * n as f64;
    let direction = |i: usize| {
        let (sin, cos) = (TAU * i as f64 / n as f64).sin_cos();
        Vec2::new(cos, sin)
    };
    plant.robots = (0..n)
        .map(|i| {
            let axle = (radius_m + body.front_point_m) * direction(i);
            let heading_rad = (-direction(i).y).atan2(-direction(i).x);
            BodyBrief { start: Pose { x_m: axle.x, y_m: axle.y, heading_rad }, ..body.clone() }
        })
        .collect();
    let agents = (0..n).map(|i| leads_to(-radius_m * direction(i), i, &agent));
    Fleet { plant, agents: agents.collect() }
}

/// Returns 49 robots in a square at spacing d, each with the opposite point as its goal. Their speed is three times the
/// advised limit: robots in the middle have more neighbors within the needed radius than a proximity sample holds.
fn crowd(period: &str) -> Fleet {
    // Halves, quarters and eighths, so that the distances at the start are exact.
    let (d, ell) = (0.25, 0.125);
    let Fleet { mut plant, agents } = fleet_of_scenario("triangle", &[period]);
    let (body, agent) = (plant.robots[0].clone(), agents[0].clone());
    let position = |i: usize| d * Vec2::new((i % 7) as f64 - 3.0, (i / 7) as f64 - 3.0);
    plant.distance_min_m = d;
    plant.robots = (0..49)
        .map(|i| {
            let (x_m, y_m) = (position(i).x - ell, position(i).y);
            let start = Pose { x_m, y_m, heading_rad: 0.0 };
            BodyBrief { start, front_point_m: ell, ..body.clone() }
        })
        .collect();
    let agents = (0..49).map(|i| {
        let mut agent = AgentBrief { front_point_m: ell, ..leads_to(-position(i), i, &agent) };
        agent.avoidance.distance_min_m = d;
        agent
    });
    Fleet { plant, agents: agents.collect() }.under(FaultProfile::Fast)
}

/// Returns the brief of robot `i` as a leader that goes to this point, m, also if it receives no beacon.
fn leads_to(point: Vec2, i: usize, agent: &AgentBrief) -> AgentBrief {
    AgentBrief {
        index: i + 1,
        law: "leader-tanh".into(),
        gains: [("k_m_m_s".into(), 1.0)].into(),
        lead: Some(stay_at(point.into())),
        neighbors: Vec::new(),
        ..agent.clone()
    }
}

/// Simulates every fleet at every period against every adversary, with its law and ramming: 216 runs a round, each with
/// another seed, and each round with other faults of sensors and bodies.
#[test]
fn in_2160_adversarial_runs_no_two_robots_come_nearer_than_d() {
    let rounds = 10 * repetition_factor();
    let mut fleets = Vec::new();
    for period in PERIODS {
        let of_scenarios = TRIANGLES.into_iter().chain(["pentagon", "containment"]);
        fleets.extend(
            of_scenarios.map(|name| (name.into(), period, fleet_of_scenario(name, &[period]))),
        );
        fleets.extend([6, 7, 8].map(|n| (format!("swap of {n}"), period, swap(n, period))));
    }
    let (mut seed, mut rammed_m) = (0, f64::INFINITY);
    let (mut late, mut freezes, mut kills) = (0, 0, 0);
    for profile in FAULT_PROFILES.into_iter().cycle().take(rounds) {
        let mut cases = Vec::new();
        for (name, period, fleet) in &fleets {
            let fleet = fleet.clone().under(profile);
            for (adversary, requested_velocity) in adversaries_and_velocities() {
                seed += 1;
                let trial = hostile_trial(seed, adversary, requested_velocity);
                let name = format!("{name}, {period}, {profile:?}, {trial:?}");
                cases.push(HostileCase { name, fleet: fleet.clone(), trial });
            }
        }
        let outcomes = map_in_parallel(&cases, |case| margin(&case.fleet, case.trial));
        for (case, (margin_m, outcome)) in cases.iter().zip(outcomes) {
            assert!(margin_m >= 0.0, "{}: {margin_m}, {outcome:?}", case.name);
            if profile == FaultProfile::Nothing
                && case.trial.requested_velocity == RequestedVelocity::Ram
            {
                rammed_m = rammed_m.min(margin_m);
            }
            late += outcome.commands_late;
            freezes += outcome.freezes;
            kills += outcome.kills;
        }
    }
    assert_eq!(seed, 216 * rounds as u64);
    // The faults did happen, and only the bound kept ramming robots apart.
    assert!(late.min(freezes).min(kills) > seed, "{late} late, {freezes} frozen, {kills} killed");
    assert!(rammed_m < 1e-6, "{rammed_m}");
}

/// Returns every adversary with every requested velocity.
pub fn adversaries_and_velocities() -> impl Iterator<Item = (Adversary, RequestedVelocity)> {
    ADVERSARIES.into_iter().flat_map(|adversary| {
        [(adversary, RequestedVelocity::Law), (adversary, RequestedVelocity::Ram)]
    })
}

/// Simulates a trial. Returns the minimum clearance of robots to walls after they have left their start, m, and the
/// outcome.
fn min_clearance_m(fleet: &Fleet, trial: Trial) -> (f64, TrialResult) {
    let mut min_clearance_m = f64::INFINITY;
    let outcome = simulate(fleet, trial, |header, truth, _| {
        if header.t_ns > NS_PER_S / 2 {
            for (row, body) in truth.iter().zip(&fleet.plant.robots) {
                let alpha = front_point(row.pose(), body.front_point_m);
                let to_walls =
                    fleet.plant.obstacles.iter().map(|wall| alpha - wall.nearest_point(alpha));
                min_clearance_m =
                    to_walls.map(|to_walls| to_walls.norm()).fold(min_clearance_m, f64::min);
            }
        }
    });
    (min_clearance_m, outcome)
}

/// Simulates the same fleets, each among other walls.
#[test]
fn in_864_adversarial_runs_among_walls_robots_keep_clearance() {
    let rounds = 6 * repetition_factor() as u64;
    let (mut runs, mut closest_m, mut close_runs) = (0, f64::INFINITY, 0);
    for (round, profile) in (0..rounds).zip(FAULT_PROFILES.into_iter().cycle()) {
        let mut cases = Vec::new();
        for (index, period) in (0..).zip(PERIODS) {
            let mut fleets: Vec<Fleet> =
                TRIANGLES.map(|name| fleet_of_scenario(name, &[period])).into();
            fleets.extend([6, 7].map(|n| swap(n, period)));
            for (number, fleet) in (0..).zip(fleets) {
                let seed = 100 * round + 10 * index + number;
                let fleet = fleet.among_walls(seed).under(profile);
                for (adversary, requested_velocity) in adversaries_and_velocities() {
                    runs += 1;
                    let trial = Trial {
                        duration_ns: 2 * NS_PER_S,
                        ..hostile_trial(runs, adversary, requested_velocity)
                    };
                    let name = format!("{seed}, {period}, {profile:?}, {trial:?}");
                    cases.push(HostileCase { name, fleet: fleet.clone(), trial });
                }
            }
        }
        let outcomes = map_in_parallel(&cases, |case| min_clearance_m(&case.fleet, case.trial));
        for (HostileCase { name, fleet, .. }, (min_clearance_m, outcome)) in
            cases.iter().zip(outcomes)
        {
            assert!(margin_of(fleet, &outcome) >= 0.0, "{name}: {outcome:?}");
            let clearance_margin_m = min_clearance_m - fleet.plant.clearance_m;
            closest_m = closest_m.min(clearance_margin_m);
            close_runs += u64::from(clearance_margin_m < 1e-2);
        }
    }
    println!(
        "{runs} runs among walls, after 0.5 s at the closest clearance + {closest_m:e} m, {close_runs} \
         within 1 cm of it"
    );
    assert_eq!(runs, 144 * rounds);
    // The robots did come close to walls.
    assert!(closest_m < 1e-3 && 5 * close_runs > runs, "{closest_m}, {close_runs} of {runs}");
}

#[test]
fn crowd_at_spacing_d_with_partial_sensing_keeps_d() {
    let fleet = crowd("period_s=0.02");
    let alphas: Vec<Vec2> =
        fleet.plant.robots.iter().map(|body| front_point(body.start, body.front_point_m)).collect();
    let neighbor_count = |alpha: &Vec2| {
        let within = |other: &&Vec2| (*other - alpha).norm() <= fleet.plant.sensing_radius_m;
        alphas.iter().filter(within).count() - 1
    };
    let max_neighbors = alphas.iter().map(neighbor_count).max();
    assert!(max_neighbors > Some(PROXIMITY_MAX), "{max_neighbors:?}");
    for (seed, (adversary, requested_velocity)) in (0..).zip(adversaries_and_velocities()) {
        let trial =
            Trial { duration_ns: NS_PER_S, ..hostile_trial(seed, adversary, requested_velocity) };
        let (margin_m, outcome) = margin(&fleet, trial);
        assert!(margin_m >= 0.0, "{trial:?}: {margin_m}, {outcome:?}");
    }
}

#[test]
fn all_robots_return_after_the_last_fault() {
    let cases = TRIANGLES.map(|name| (name, 3)).into_iter().chain([("pentagon", 2)]);
    for (index, (name, hostile_s)) in cases.enumerate() {
        for (seed, adversary) in (10 * index as u64..).zip(ADVERSARIES) {
            let scenario = scenario(name, &["duration_s=30", "expect={}"]);
            let fleet = Fleet::from_scenario(&scenario);
            let mut metrics = Metrics::new(&scenario, Pace::Realtime);
            let trial = Trial {
                hostile_ns: hostile_s * NS_PER_S,
                duration_ns: scenario.duration_ns,
                ..hostile_trial(seed, adversary, RequestedVelocity::Law)
            };
            let outcome = simulate(&fleet, trial, |header, truth, alive| {
                metrics.add_truth(header, truth, alive);
            });
            let measures = metrics.finish();
            let error_m = measures.final_error_m_max.expect("it ran to the end");
            assert!(error_m < 1e-2, "{name}, {trial:?}: {error_m}, {outcome:?}");
            assert_eq!(measures.violations, 0, "{name}, {trial:?}: {outcome:?}");
        }
    }
}

/// Returns how many of 40 trials violate d with a mistake, and the largest violation, m. Checks that all keep d
/// without the mistake.
fn below_d(fleet: &Fleet, mistaken: &Fleet, trial: impl Fn(u64) -> Trial) -> (usize, f64) {
    let mut below = (0, 0.0f64);
    for seed in 0..40 {
        let honest = Trial { expiry: Expiry::FromSample, ..trial(seed) };
        let (margin_m, outcome) = margin(fleet, honest);
        assert!(margin_m >= 0.0, "{honest:?}: {outcome:?}");
        let (margin_m, _) = margin(mistaken, trial(seed));
        below = (below.0 + usize::from(margin_m < 0.0), below.1.max(-margin_m));
    }
    below
}

#[test]
fn literal_focus_falls_below_d_in_hostile_trials() {
    let guarded = fleet_of_scenario("triangle-d", &[]);
    let literal = fleet_of_scenario("triangle-d", &["avoidance.kind=focus"]);
    let trial = |seed| hostile_trial(seed, Adversary::Chance, RequestedVelocity::Law);
    let (count, worst_m) = below_d(&guarded, &literal, trial);
    assert!(count > 20 && worst_m > 1e-3, "{count}, {worst_m}");
}

#[test]
fn command_lifetime_counted_from_arrival_violates_d() {
    let fleet = fleet_of_scenario("containment", &["period_s=0.01"]);
    for (adversary, count_min) in [(Adversary::JustInTime, 20), (Adversary::Ambush, 1)] {
        let trial = |seed| {
            let expiry = Expiry::FromArrival;
            Trial { expiry, ..hostile_trial(seed, adversary, RequestedVelocity::Ram) }
        };
        let (count, worst_m) = below_d(&fleet, &fleet, trial);
        assert!(count >= count_min && worst_m > 1e-2, "{adversary:?}: {count}, {worst_m}");
    }
}

#[test]
fn agents_assuming_a_quarter_of_the_lifetime_violate_d() {
    let fleet = fleet_of_scenario("containment", &["period_s=0.02"]);
    let mut hasty = fleet.clone();
    for agent in &mut hasty.agents {
        agent.command_lifetime_ns /= 4;
    }
    for adversary in ADVERSARIES {
        let trial = |seed| hostile_trial(seed, adversary, RequestedVelocity::Ram);
        let (count, worst_m) = below_d(&fleet, &hasty, trial);
        assert!(count > 10 && worst_m > 1e-2, "{adversary:?}: {count}, {worst_m}");
    }
}
