//! Every single death and every single cut of the shipped scenarios: permanent, or ended after five seconds.
//!
//! This module lists the cases and runs them in the oracle. The expected results are in the modules that use them.

use experiment::scenario::Scenario;
use formation::front_point::front_point;
use outcome::metrics::RunMetrics;
use protocol::message::{TruthHeader, TruthRow};

use crate::harness::map_in_parallel;
use crate::oracle::{scenario as scenario_named, simulate_watched, with_faults};

/// Shipped scenarios without faults that differ in more than their starts. `swarm64` is not in the list, since all of
/// its cases take too long: tests sample them.
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

/// Duration of a temporary fault, s.
pub const WHOLE_AFTER_S: f64 = 5.0;

/// Component that fails.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum FailingComponent {
    /// Death of the robot with this index.
    Robot(usize),
    /// Cut of the edge with this index in the scenario's graph.
    Edge(usize),
}

/// A single fault in a scenario.
#[derive(Debug, Clone, PartialEq)]
pub struct SingleFaultCase {
    /// Name of the scenario: `scenarios/<name>.toml`.
    pub scenario: &'static str,
    /// Component that fails.
    pub broken: FailingComponent,
    /// Fault in the syntax of `--fault`, without times: `kill r1`, `cut r1->r2`.
    pub what: String,
    /// Time of the fault, s: half of the run, when all robots have settled.
    pub at_s: f64,
    /// Assignments of scenario keys.
    pub set: &'static [&'static str],
}

impl SingleFaultCase {
    /// Reads the scenario with the fault and without expectations. If `is_temporary`, the robot is restarted or the
    /// edge mended after [`WHOLE_AFTER_S`].
    pub fn scenario(&self, is_temporary: bool) -> Scenario {
        let ending = match (is_temporary, self.broken) {
            (false, _) => String::new(),
            (true, FailingComponent::Robot(_)) => format!(" restart {WHOLE_AFTER_S}"),
            (true, FailingComponent::Edge(_)) => format!(" for {WHOLE_AFTER_S}"),
        };
        let fault = format!("{} @{}{ending}", self.what, self.at_s);
        with_faults(self.scenario, self.set, &[&fault])
    }

    /// Simulates the case in the oracle. Calls `watch` with every ground-truth sample and the robots that were alive.
    pub fn run(
        &self,
        is_temporary: bool,
        watch: impl FnMut(&TruthHeader, &[TruthRow], &[bool]),
    ) -> RunMetrics {
        simulate_watched(&self.scenario(is_temporary), watch)
    }
}

/// Returns every case of a shipped scenario: all deaths, then all cuts.
pub fn cases_of(name: &'static str) -> Vec<SingleFaultCase> {
    let scenario = scenario_named(name, &[]);
    let robot = |i: usize| scenario.robots[i].name.as_str();
    let kills = (0..scenario.robots.len())
        .map(|i| (FailingComponent::Robot(i), format!("kill {}", robot(i))));
    let edges = scenario.graph.edges().iter().enumerate();
    let link_cuts = edges.map(|(e, edge)| {
        (FailingComponent::Edge(e), format!("cut {}->{}", robot(edge.from), robot(edge.to)))
    });
    let at_s = 0.5 * scenario.duration_ns as f64 / 1e9;
    let set = &["expect={}"];
    kills
        .chain(link_cuts)
        .map(|(broken, what)| SingleFaultCase { scenario: name, broken, what, at_s, set })
        .collect()
}

/// Returns every case of every shipped scenario.
pub fn cases() -> Vec<SingleFaultCase> {
    SHIPPED.into_iter().flat_map(cases_of).collect()
}

#[test]
fn contained_robot_at_the_leader_slot_does_not_block_leader() {
    // r3 receives from r8, the leader, and from r4: without r4 its desired position is that of r8.
    let mut cases = cases_of("containment");
    cases.retain(|case| ["kill r4", "cut r4->r3"].contains(&case.what.as_str()));
    let results = map_in_parallel(&cases, |case| {
        let scenario = case.scenario(false);
        let (leader, lead) = (scenario.leader().unwrap(), scenario.lead.clone().unwrap());
        let ell_m = scenario.robots[leader].front_point_m;
        let mut error_m = 0.0f64;
        let measures = case.run(false, |header, rows, _| {
            let t_s = header.t_ns as f64 / 1e9;
            if t_s >= case.at_s {
                let alpha = front_point(rows[leader].pose(), ell_m);
                error_m = error_m.max((alpha - lead.trajectory.target_at(t_s).position).norm());
            }
        });
        (case.what.clone(), error_m, measures.violations)
    });
    assert_eq!(results.len(), 2);
    for (what, error_m, violations) in results {
        assert!(error_m < 1e-6 && violations == 0, "{what}: {error_m} m, {violations} violations");
    }
}

#[test]
fn robot_without_a_slot_blocks_no_other_robot() {
    // f2 receives from f1 only, so that its desired position is that of f1; f1 receives from f2, so that both are off.
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
