//! Byzantine robots, which send false beacons: how far they displace other robots with and without resilient laws.

use formation::Vec2;
use formation::front_point::front_point;
use formation::random::SplitMix64;

use crate::harness::{map_in_parallel, repetition_factor, run};
use crate::oracle::{simulate, simulate_watched, with_faults};

const LIE: &str = "lie r3 beacons by [1.5, 0.0] @15 for 20";
const TICKS_PER_S: usize = 200;

/// Returns the maximum displacement of each robot from this time on, m, relative to the run without false data.
fn displacement_by_lie_m(law: &str, false_data: &str, from_s: usize) -> Vec<f64> {
    moved_amid(&[], law, false_data, from_s)
}

/// Returns the maximum displacements in runs with additional faults and with spares.
fn moved_amid(others: &[&str], law: &str, false_data: &str, from_s: usize) -> Vec<f64> {
    let law = format!("robot_defaults.law=\"{law}\"");
    let set = ["expect={}", "fault=[]", "duration_s=40", "repair=spares", &law];
    let paths = |faults: &[&str]| {
        let scenario = with_faults("liar-10", &set, &[others, faults].concat());
        let mut paths: Vec<Vec<Vec2>> = Vec::new();
        let measures = simulate_watched(&scenario, |_, truth, _| {
            let robots = truth.iter().zip(&scenario.robots);
            paths.push(robots.map(|(row, r)| front_point(row.pose(), r.front_point_m)).collect());
        });
        assert_eq!(measures.violations, 0, "{false_data}");
        paths
    };
    let (with, without) = (paths(&[false_data]), paths(&[]));
    let displacement = |robot: usize| {
        let pairs = with.iter().zip(&without).skip(from_s * TICKS_PER_S);
        pairs.map(|(a, b)| (a[robot] - b[robot]).norm()).fold(0.0, f64::max)
    };
    (0..10).map(displacement).collect()
}

/// Returns the maximum displacement of all robots except for r3, the Byzantine robot, m.
fn worst_honest(moved: &[f64]) -> f64 {
    (0..10).filter(|&robot| robot != 2).map(|robot| moved[robot]).fold(0.0, f64::max)
}

#[test]
fn one_byzantine_robot_moves_only_nonresilient_robots() {
    for false_data in [
        LIE,
        "lie r3 beacons drift [0.1, 0.05] @15 for 20",
        "lie r3 beacons random 3 @15 for 20",
        "lie r3 beacons by [0.0, -1.5] turn 0.8 @15 for 20",
    ] {
        let robust_m = worst_honest(&displacement_by_lie_m("formation-robust", false_data, 0));
        assert!(robust_m < 0.05, "{false_data}: an honest robot is displaced by {robust_m} m");
        println!("{false_data}: {robust_m} m");
    }
    let mean_m = worst_honest(&displacement_by_lie_m("formation-tanh", LIE, 0));
    println!("the mean: {mean_m} m");
    assert!(mean_m > 0.5, "the mean is moved by {mean_m} m only");
}

/// After the death of r2, r6 and r7 use r5 as a reference, which sends false data. Or positions have errors of up to 2
/// cm.
#[test]
fn spare_or_noisy_liar_does_not_move_resilient_robots() {
    let dead = ["kill r2 @10"];
    let spares = with_faults("liar-10", &["repair=spares", "fault=[]"], &dead)
        .rewiring()
        .active_repairs(&[1], &[]);
    assert_eq!(spares.iter().filter(|one| one.substitute == 4).count(), 2, "{spares:?}");
    let noise = ["r4", "r6", "r7", "r9"];
    let noise = noise.map(|robot| format!("noise {robot} odometry by 0.02 heading 0.01 @5 for 35"));
    let noise: Vec<&str> = noise.iter().map(String::as_str).collect();
    for (others, byzantine_robot) in [(&dead[..], 5), (&noise[..], 3)] {
        let false_data = format!("lie r{byzantine_robot} beacons by [1.5, 0.0] @15 for 20");
        let moved = moved_amid(others, "formation-robust", &false_data, 0);
        let honest = (1..=10).zip(moved).filter(|(robot, _)| *robot != byzantine_robot);
        let moved_m = honest.map(|(_, moved_m)| moved_m).fold(0.0, f64::max);
        println!("{others:?}, {false_data}: {moved_m} m");
        assert!(
            moved_m < 0.05,
            "{others:?}, {false_data}: an honest robot is displaced by {moved_m} m"
        );
    }
}

/// False data after the formation has settled, or from the start when all robots are off their slots. Sent to one robot
/// or to all.
#[test]
fn random_liars_move_honest_robots_by_at_most_5_centimeters() {
    let cases: Vec<u64> = (0..8 * repetition_factor() as u64).collect();
    let worst = map_in_parallel(&cases, |&number| {
        let (byzantine_robot, false_data) = draw_lie(number);
        let from_s = if number % 8 < 4 { 0 } else { 25 };
        let moved =
            displacement_by_lie_m("formation-robust", &false_data, from_s).into_iter().enumerate();
        let honest =
            moved.filter(|&(robot, _)| robot != byzantine_robot).map(|(_, moved_m)| moved_m);
        (honest.fold(0.0, f64::max), false_data)
    });
    for (moved_m, false_data) in &worst {
        println!("{false_data}: {moved_m} m");
        assert!(*moved_m < 0.05, "{false_data}: an honest robot is displaced by {moved_m} m");
    }
}

/// Draws false data of r2 to r10: constant, drifting or random, also of the frame, to all robots or to one.
fn draw_lie(number: u64) -> (usize, String) {
    let mut rng = SplitMix64::new(1000 + number);
    let scenario = with_faults("liar-10", &["fault=[]"], &[]);
    let edges: Vec<_> = scenario.graph.edges().iter().filter(|edge| edge.from > 0).collect();
    let edge = edges[rng.next_u64() as usize % edges.len()];
    let [byzantine_robot, receiver] =
        [edge.from, edge.to].map(|i| scenario.robots[i].name.as_str());
    let mut within = |bound: f64| bound * (2.0 * rng.draw_unit() - 1.0);
    let what = match number % 4 {
        0 => format!("by [{:.3}, {:.3}]", within(4.0), within(4.0)),
        1 => format!("drift [{:.3}, {:.3}]", within(0.3), within(0.3)),
        2 => format!("random {:.3}", within(3.0).abs() + 0.1),
        _ => format!("by [{:.3}, {:.3}] turn {:.3}", within(1.0), within(1.0), within(3.0)),
    };
    let whom = if number.is_multiple_of(3) {
        format!("{byzantine_robot}->{receiver}")
    } else {
        format!("{byzantine_robot} beacons")
    };
    let at_s = if number % 8 < 4 { 12 } else { 0 };
    (edge.from, format!("lie {whom} {what} @{at_s} for 28"))
}

#[test]
fn runs_with_a_liar_match_prediction_and_keep_distance() {
    map_in_parallel(&["formation-robust", "formation-tanh"], |law| {
        let law = format!("robot_defaults.law=\"{law}\"");
        let set = ["expect={}", "duration_s=25", &law];
        let ended = run("liar-10").lockstep().sets(set).finish();
        ended.exits_with(0).assert_leaves_nothing().assert_keeps_d();
        let predicted = simulate(&with_faults("liar-10", &set, &[])).trajectory_hash;
        ended.assert_holds(
            Some(ended.hash()) == predicted.as_deref(),
            "the oracle has the same hash",
        );
        let why = ended.summary["faults"][0]["predicted_why"].to_string();
        ended.assert_holds(
            why.contains("not predicted"),
            format!("it does not foretell a lie: {why}"),
        );
        let again = run("liar-10").lockstep().sets(set).finish();
        again.assert_holds(again.hash() == ended.hash(), "the same hash twice");
        let live = run("liar-10").args(["--pace", "realtime"]).sets(set).finish();
        live.exits_with(0).assert_leaves_nothing().assert_keeps_d();
    });
}
