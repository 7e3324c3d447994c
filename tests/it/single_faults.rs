//! Every single death and every single cut of the shipped scenarios: for good, or whole again after
//! five seconds.
//!
//! What is asked of them stands with whoever asks; here is which cases there are, and how one runs
//! in the oracle.

use experiment::scenario::Scenario;
use formation::front_point::front_point;
use outcome::metrics::Measures;
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
    /// Keys that are set.
    pub set: &'static [&'static str],
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
        with_faults(self.scenario, self.set, &[&fault])
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
    let set = &["expect={}"];
    kills
        .chain(cuts)
        .map(|(broken, what)| Case { scenario: name, broken, what, at_s, set })
        .collect()
}

/// Every case of every shipped scenario.
pub fn cases() -> Vec<Case> {
    SHIPPED.into_iter().flat_map(cases_of).collect()
}

#[test]
fn contained_robot_at_the_leader_slot_does_not_block_leader() {
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
                off_m = off_m.max((alpha - lead.trajectory.target_at(t_s).position).norm());
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
fn robot_without_a_slot_blocks_no_other_robot() {
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
