//! Every single death and every single cut of the shipped scenarios: for good, or whole again after
//! five seconds.
//!
//! What is asked of them stands with whoever asks; here is which cases there are, and how one runs
//! in the oracle.

use experiment::scenario::{FaultKind, Scenario};
use formation::Vec2;
use formation::front_point::front_point;
use formation::graph::{Edge, FormationGraph};
use outcome::metrics::Measures;
use protocol::law::Reference;
use protocol::message::{TruthHeader, TruthRow};

use crate::harness::in_parallel;
use crate::oracle::{scenario as scenario_named, simulate_watched, with_faults};

/// The shipped scenarios that have no faults of their own and differ in more than their starts;
/// `swarm64`, which is too long for all of its cases, is sampled by whoever needs it.
pub const SHIPPED: [&str; 9] = [
    "containment",
    "escort",
    "lattice-12",
    "line-5",
    "pentagon",
    "ring-6",
    "standing-leaders",
    "swap-8",
    "triangle",
];

/// How long until a fault that ends is over, s.
pub const WHOLE_AFTER_S: f64 = 5.0;

/// What breaks.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Broken {
    /// The robot of this place, from 0, is killed.
    Robot(usize),
    /// The edge of this place in the scenario's graph is cut.
    Edge(usize),
}

/// One fault in one scenario.
#[derive(Debug, Clone, PartialEq)]
pub struct Case {
    /// `scenarios/<name>.toml`.
    pub scenario: &'static str,
    /// What breaks.
    pub broken: Broken,
    /// The same in the words of `--fault`, without times: `kill r1`, `cut r1->r2`.
    pub what: String,
    /// When, s: half-way, when all have settled.
    pub at_s: f64,
}

impl Case {
    /// The scenario with its fault, and without expectations; `whole_again`: the robot is restarted
    /// and the edge mended, after [`WHOLE_AFTER_S`].
    pub fn scenario(&self, whole_again: bool) -> Scenario {
        let ends = match (whole_again, self.broken) {
            (false, _) => String::new(),
            (true, Broken::Robot(_)) => format!(" restart {WHOLE_AFTER_S}"),
            (true, Broken::Edge(_)) => format!(" for {WHOLE_AFTER_S}"),
        };
        let fault = format!("{} @{}{ends}", self.what, self.at_s);
        with_faults(self.scenario, &["expect={}"], &[&fault])
    }

    /// Runs it in the oracle; `watch` sees every truth, and who was alive at it.
    pub fn run(
        &self,
        whole_again: bool,
        watch: impl FnMut(&TruthHeader, &[TruthRow], &[bool]),
    ) -> Measures {
        simulate_watched(&self.scenario(whole_again), watch)
    }
}

/// Every case of a shipped scenario: all deaths, then all cuts.
pub fn cases_of(name: &'static str) -> Vec<Case> {
    let scenario = scenario_named(name, &[]);
    let robot = |i: usize| scenario.robots[i].name.as_str();
    let kills =
        (0..scenario.robots.len()).map(|i| (Broken::Robot(i), format!("kill {}", robot(i))));
    let edges = scenario.graph.edges().iter().enumerate();
    let cuts = edges.map(|(e, edge)| {
        (Broken::Edge(e), format!("cut {}->{}", robot(edge.from), robot(edge.to)))
    });
    let at_s = 0.5 * scenario.duration_ns as f64 / 1e9;
    kills.chain(cuts).map(|(broken, what)| Case { scenario: name, broken, what, at_s }).collect()
}

/// Every case of every shipped scenario.
pub fn cases() -> Vec<Case> {
    SHIPPED.into_iter().flat_map(cases_of).collect()
}

#[test]
fn the_shipped_scenarios_have_162_single_deaths_and_cuts() {
    let cases = cases();
    assert_eq!(cases.len(), 162);
    let r4 = cases.iter().find(|case| case.scenario == "containment" && case.what == "kill r4");
    let r4 = r4.expect("r4 may die");
    assert_eq!((r4.broken, r4.at_s), (Broken::Robot(3), 40.0));
    for (whole_again, restart_after_ns) in [(false, None), (true, Some(5_000_000_000))] {
        let faults = r4.scenario(whole_again).faults;
        let [fault] = &faults[..] else { panic!("one fault: {faults:?}") };
        assert_eq!(fault.kind, FaultKind::Kill { robot: 3, restart_after_ns });
        assert_eq!(fault.at_ns, 40_000_000_000);
    }
}

#[test]
fn a_leader_is_not_held_up_by_a_contained_robot_that_wants_its_place() {
    // r3 hears r8, the leader, and r4: without r4 it wants to be where r8 is.
    let mut cases = cases_of("containment");
    cases.retain(|case| ["kill r4", "cut r4->r3"].contains(&case.what.as_str()));
    let held_up = in_parallel(&cases, |case| {
        let scenario = case.scenario(false);
        let (leader, lead) = (scenario.leader().unwrap(), scenario.lead.clone().unwrap());
        let ell_m = scenario.robots[leader].front_point_m;
        let mut off_m = 0.0f64;
        let measures = case.run(false, |header, rows, _| {
            let t_s = header.t_ns as f64 / 1e9;
            if t_s >= case.at_s {
                let alpha = front_point(rows[leader].pose(), ell_m);
                off_m = off_m.max((alpha - lead.trajectory.at(t_s).position).norm());
            }
        });
        (case.what.clone(), off_m, measures.violations)
    });
    assert_eq!(held_up.len(), 2);
    for (what, off_m, violations) in held_up {
        assert!(off_m < 1e-6 && violations == 0, "{what}: {off_m} m, {violations} violations");
    }
}

#[test]
fn whoever_has_no_place_is_in_nobodys_way() {
    // f2 hears f1 alone, and wants to be where f1 is; f1 hears f2, so that both are off.
    let mut cases = cases_of("escort");
    cases.retain(|case| case.what == "cut left->f2");
    let [case] = &cases[..] else { panic!("one case: {cases:?}") };
    let measures = case.run(false, |_, _, _| {});
    for (robot, error_m) in &measures.final_error_m {
        let error_m = error_m.expect("all live");
        let bound_m = if ["f1", "f2"].contains(&robot.as_str()) { 0.3 } else { 0.005 };
        assert!(error_m < bound_m, "{robot}: {error_m} m");
    }
}

/// Where everybody settles without what is broken, m, seen from the leader at heading 0 and scale 1,
/// of those that the leader reaches and no orphan pulls away.
fn places_left(scenario: &Scenario, broken: Broken) -> Vec<Option<Vec2>> {
    let edges = scenario.graph.edges().iter().enumerate();
    let whole = |(e, edge): (usize, &Edge)| match broken {
        Broken::Robot(dead) => (edge.from != dead && edge.to != dead).then_some(*edge),
        Broken::Edge(cut) => (e != cut).then_some(*edge),
    };
    let left: Vec<Edge> = edges.filter_map(whole).collect();
    let (robots, leader) = (scenario.robots.len(), scenario.leader().expect("a leader"));
    let graph = FormationGraph::new(robots, left.clone());
    let reached = graph.reachability();
    let orphan = |i: usize| !reached[leader][i];
    let pulled = |i: usize| (0..robots).any(|j| orphan(j) && reached[j][i]);
    let stands = |i: usize| !orphan(i) && !pulled(i);
    let mut places = vec![Vec2::zeros(); robots];
    // The mean of what those heard ask for, again and again: it converges as velocities do. (33)
    for _ in 0..5_000 {
        for i in (0..robots).filter(|&i| i != leader && stands(i)) {
            let heard: Vec<&Edge> = left.iter().filter(|edge| edge.to == i).collect();
            let keeps_place = scenario.robots[i].role.reference == Reference::Offsets;
            let offset = |edge: &Edge| if keeps_place { edge.offset_m } else { Vec2::zeros() };
            let asked = heard.iter().map(|edge| places[edge.from] + offset(edge));
            places[i] = asked.sum::<Vec2>() / heard.len() as f64;
        }
    }
    (0..robots).map(|i| stands(i).then_some(places[i])).collect()
}

/// `cargo test --test it -- --ignored --nocapture nobody_who_can_stay`
#[test]
#[ignore = "minutes: 324 runs"]
fn nobody_who_can_stay_in_its_place_is_thrown_off_it_by_a_death_or_a_cut() {
    let found = in_parallel(&cases(), |case| {
        let mut wrong = Vec::new();
        let scenario = case.scenario(false);
        let measures = case.run(false, |_, _, _| {});
        let d = scenario.avoidance.distance_min_m;
        let (near_m, dead) = (measures.min_distance_m.unwrap(), case.broken);
        if near_m < d || measures.violations > 0 {
            wrong.push(format!("{near_m} m apart"));
        }
        if let Some(leader) = scenario.leader().filter(|&i| dead != Broken::Robot(i)) {
            let tracking_m = measures.tracking_error_m_max.unwrap();
            if tracking_m >= 5e-3 {
                wrong.push(format!("the leader is {tracking_m} m off"));
            }
            let lead = scenario.lead.as_ref().unwrap();
            let end_s = scenario.duration_ns as f64 / 1e9;
            let last = (0..=100).map(|k| lead.scale.at(end_s * (0.9 + 1e-3 * f64::from(k))).0);
            let scale = last.fold(f64::INFINITY, f64::min);
            let places = places_left(&scenario, case.broken);
            let steers = |i: usize| scenario.steers_within_m(i).unwrap();
            for i in (0..places.len()).filter(|&i| i != leader && dead != Broken::Robot(i)) {
                let Some(place) = places[i] else { continue };
                let taken = (0..places.len()).filter(|&j| j != i).any(|j| {
                    let apart_m = places[j].map(|other| scale * (place - other).norm());
                    apart_m.is_some_and(|apart_m| apart_m <= steers(i).max(steers(j)))
                });
                let own = scenario.robots[i].role.reference == Reference::Offsets;
                let errors =
                    if own { &measures.final_ideal_error_m } else { &measures.final_error_m };
                let error_m = errors[i].1.unwrap();
                if !taken && error_m >= 0.02 {
                    wrong.push(format!("{} is {error_m} m off", errors[i].0));
                }
            }
        }
        // Half as long again: gains of 0.3 per second take their time.
        let mut longer = case.scenario(true);
        longer.duration_ns += longer.duration_ns / 2;
        let measures = simulate_watched(&longer, |_, _, _| {});
        let bound_m = scenario_named(case.scenario, &[]).expect.final_error_m_max.unwrap();
        let error_m = measures.final_error_m_max.unwrap();
        let name = format!("{} {}", case.scenario, case.what);
        if error_m >= bound_m || measures.min_distance_m.unwrap() < d {
            wrong.push(format!("whole again, somebody is {error_m} m off"));
        }
        (name, wrong)
    });
    let wrong: Vec<_> = found.iter().filter(|(_, wrong)| !wrong.is_empty()).collect();
    println!("{} cases, {} of them not as promised", found.len(), wrong.len());
    assert!(wrong.is_empty(), "{wrong:#?}");
}
