//! Lattices whose gaps are too narrow for a robot: they jam while they form, unless they are open during that time
//! (`scale = { kind = "closing" }`). Simulated in the oracle.

use experiment::campaign::starts::{BoxCenter, GoalAssignment, RandomStarts};
use experiment::check::{Opening, check_scenario};
use experiment::scenario::{Fault, FaultKind, Scenario};
use formation::Vec2;
use formation::front_point::front_point;
use formation::graph::{Edge, FormationGraph};
use formation::pose::Pose;
use formation::random::SplitMix64;
use formation::scale::Scale;

use crate::oracle::{scenario, simulate};

/// Minimum distance (d), m.
const DISTANCE_MIN_M: f64 = 0.2;

/// Returns a scenario of 120 s with robots scattered over a square (4.8 m^2 for ten robots) that form a lattice of four
/// columns, or six for more than 12 robots. Each receives from its neighbors to the left and below, or with `both_ways`
/// from all neighbors.
pub fn scattered_scenario(robots: usize, gap_m: f64, both_ways: bool, seed: u64) -> Scenario {
    let columns = if robots > 12 { 6 } else { 4 };
    let side_m = 2.4 * (robots as f64 / 12.0).sqrt();
    let mut rng = SplitMix64::new(seed);
    let mut scenario = scenario("lattice-12", &["duration_s=120"]);
    let one = scenario.robots[0].clone();
    let mut alphas: Vec<Vec2> = Vec::new();
    scenario.robots.clear();
    while alphas.len() < robots {
        let [x_m, y_m] = [0, 1].map(|_| side_m * rng.draw_unit() - 0.5 * side_m);
        let heading_rad = std::f64::consts::TAU * (rng.draw_unit() - 0.5);
        let start = Pose { x_m, y_m, heading_rad };
        let alpha = front_point(start, one.front_point_m);
        if alphas.iter().all(|other| (alpha - other).norm() > 0.25) {
            alphas.push(alpha);
            let name = format!("r{}", alphas.len());
            scenario.robots.push(experiment::scenario::Robot { name, start, ..one.clone() });
        }
    }
    let in_neighbors = |index: usize| {
        let left = (!index.is_multiple_of(columns)).then(|| (index - 1, Vec2::new(gap_m, 0.0)));
        let below = (index >= columns).then(|| (index - columns, Vec2::new(0.0, gap_m)));
        [left, below].into_iter().flatten()
    };
    let ahead = |to| in_neighbors(to).map(move |(from, offset_m)| Edge { from, to, offset_m });
    let mut edges: Vec<Edge> = (0..robots).flat_map(ahead).collect();
    if both_ways {
        let back = |edge: &Edge| Edge { from: edge.to, to: edge.from, offset_m: -edge.offset_m };
        edges.extend(edges.clone().iter().map(back));
    }
    scenario.graph = FormationGraph::new(robots, edges);
    scenario
}

/// Returns the scenario with the opening that `check` advises, and further ones at `reopen_at_s`. It ends 40 s after
/// the formation has closed.
fn opened(robots: usize, gap_m: f64, both_ways: bool, seed: u64, reopen_at_s: &[f64]) -> Scenario {
    let mut scenario = scattered_scenario(robots, gap_m, both_ways, seed);
    let Opening { from, hold_s, over_s, .. } =
        Opening::compute(&scenario).expect("all robots keep a slot");
    let scale = Scale::Closing { from, hold_s, over_s, reopen_at_s: reopen_at_s.to_vec() };
    scenario.duration_ns = 1_000_000_000 * (scale.closing_end_s().unwrap() + 40.0) as u64;
    scenario.leaderless_scale = Some(scale);
    scenario
}

/// Returns the scenario with a robot that is killed while the formation is open and restarted after it has closed, when
/// it is outside or blocks others. The formation opens again.
fn scenario_with_restarted_robot(
    robots: usize,
    gap_m: f64,
    both_ways: bool,
    seed: u64,
) -> Scenario {
    let scenario = opened(robots, gap_m, both_ways, seed, &[]);
    let Some(Scale::Closing { hold_s, over_s, .. }) = scenario.leaderless_scale else {
        unreachable!("it closes")
    };
    let (killed_s, closed_s) = (hold_s.min(60.0), hold_s + over_s);
    let ns = |s: f64| (s * 1e9) as u64;
    // The corner robot without in-neighbors stays in any case.
    let robot = 1 + (7 * seed as usize) % (robots - 1);
    let restart_after_ns = Some(ns(closed_s + 10.0 - killed_s));
    let kind = FaultKind::Kill { robot, restart_after_ns };
    let mut scenario = opened(robots, gap_m, both_ways, seed, &[closed_s + 15.0]);
    scenario.faults.push(Fault { start_ns: ns(killed_s), duration_ns: None, kind });
    scenario
}

/// Returns the seeds from 1 to `seeds` whose scenarios get stuck. Checks that no two robots come closer than d.
fn seeds_that_get_stuck(seeds: u64, scenario: impl Fn(u64) -> Scenario) -> Vec<u64> {
    let mut stuck = Vec::new();
    for seed in 1..=seeds {
        let measures = simulate(&scenario(seed));
        assert!(
            measures.min_distance_m.unwrap() >= DISTANCE_MIN_M,
            "{seed}: {:?}",
            measures.min_distance_m
        );
        if measures.converged_at_s.is_none() {
            stuck.push(seed);
        }
    }
    stuck
}

#[test]
fn dense_lattice_forms_by_opening_where_it_jams_otherwise() {
    for both_ways in [false, true] {
        let jammed = seeds_that_get_stuck(4, |seed| {
            scattered_scenario(12, 1.1 * DISTANCE_MIN_M, both_ways, seed)
        });
        assert!(!jammed.is_empty(), "both ways: {both_ways}");
        let opened =
            seeds_that_get_stuck(4, |seed| opened(12, 1.1 * DISTANCE_MIN_M, both_ways, seed, &[]));
        assert_eq!(opened, [0; 0], "both ways: {both_ways}");
    }
}

#[test]
fn returning_robot_enters_a_closed_lattice_after_reopening() {
    for both_ways in [false, true] {
        assert_eq!(
            seeds_that_get_stuck(2, |seed| scenario_with_restarted_robot(
                12,
                1.1 * DISTANCE_MIN_M,
                both_ways,
                seed
            )),
            [0; 0]
        );
    }
}

#[test]
fn thirty_mutual_robots_form_with_advised_and_small_opening() {
    let start = |scale: &str| {
        let mut set = vec!["graph=\"30-1.1-both-ways.json\"".to_owned(), "duration_s=400".into()];
        set.push(format!("scale={scale}"));
        let read = |set: &[String]| -> Scenario {
            scenario("lattices/lattice", &set.iter().map(String::as_str).collect::<Vec<_>>())
        };
        // The scenarios of the campaign.
        let around = BoxCenter::Common(None);
        let starts = RandomStarts {
            box_m: [3.8, 3.8],
            separation_min_m: 0.25,
            box_center: around,
            goals: GoalAssignment::Own,
        };
        set.extend(starts.draw(&read(&set), 1).expect("there is room"));
        read(&set)
    };
    let measures = simulate(&start("{ kind = \"closing\" }"));
    assert!(measures.min_distance_m.unwrap() >= DISTANCE_MIN_M, "{:?}", measures.min_distance_m);
    assert!(measures.converged_at_s.is_some());
    // Gaps of 2.4 d: wide enough for one robot at a time.
    let measures = simulate(&start("{ kind = \"closing\", from = 2.182 }"));
    assert!(measures.min_distance_m.unwrap() >= DISTANCE_MIN_M, "{:?}", measures.min_distance_m);
    assert!(measures.converged_at_s.is_some());
}

#[test]
fn check_advises_opening_only_for_dense_closed_lattices() {
    let warned = |scenario: &Scenario| -> Vec<String> {
        check_scenario(scenario).into_iter().map(|finding| finding.message).collect()
    };
    let advises_opening =
        |messages: &[String]| messages.iter().any(|message| message.contains("arrives late"));
    let dense = scattered_scenario(12, 1.1 * DISTANCE_MIN_M, false, 1);
    assert!(advises_opening(&warned(&dense)), "{:?}", warned(&dense));
    assert!(!advises_opening(&warned(&scattered_scenario(12, 3.0 * DISTANCE_MIN_M, false, 1))));
    let mut closing = opened(12, 1.1 * DISTANCE_MIN_M, false, 1, &[]);
    assert!(!advises_opening(&warned(&closing)));
    for (from, hold_s, over_s, word) in [
        (1.3, 70.0, 30.0, "no robot passes"),
        (2.2, 5.0, 30.0, "to reach its slot"),
        (2.2, 70.0, 900.0, "run ends"),
    ] {
        let reopen_at_s = Vec::new();
        closing.leaderless_scale = Some(Scale::Closing { from, hold_s, over_s, reopen_at_s });
        let messages = warned(&closing);
        assert!(messages.iter().any(|message| message.contains(word)), "{word}: {messages:?}");
    }
}
