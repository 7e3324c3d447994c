//! Robustness of the graph against Byzantine robots, and whether it suffices for the resilient laws (W-MSR).

use formation::robustness::{
    EXACT_ROBUSTNESS_ROBOTS_MAX, bootstrap_percolation_failures, liars_total_max, robustness,
    robustness_upper_bound, strong_robustness,
};
use protocol::law::Reference;
use serde::Serialize;

use super::finding::{Finding, NAMES_MAX, error_finding, warning_finding};
use crate::scenario::diagnostic::format_list;
use crate::scenario::{FaultKind, Robot, Scenario};

/// Robustness of the graph against Byzantine robots.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct LiarTolerance {
    /// F, maximum number of Byzantine in-neighbors that the laws tolerate.
    pub liars_max: usize,
    /// Largest r for which the graph is r-robust.
    pub robustness: usize,
    /// `true` if `robustness` is only an upper bound, which is used for many robots.
    pub robustness_is_bound: bool,
    /// Largest r for which the graph is strongly r-robust around its leader. `None` without a leader.
    pub strong_robustness: Option<usize>,
    /// Number of Byzantine in-neighbors per robot that the graph tolerates (F-local). An upper bound if `robustness` is
    /// one.
    pub among_heard: usize,
    /// Total number of Byzantine robots that a leaderless graph tolerates (F-total). `None` with a leader or for many
    /// robots.
    pub in_all: Option<usize>,
}

impl LiarTolerance {
    /// Computes the robustness, or returns `None` if the scenario has neither Byzantine robots nor resilient laws.
    pub(super) fn compute(scenario: &Scenario) -> Option<LiarTolerance> {
        let is_byzantine = |kind: &FaultKind| matches!(kind, FaultKind::Lie { .. });
        let liars_max = scenario.robots.iter().map(Robot::liars_max).max().unwrap_or(0);
        if liars_max == 0 && !scenario.faults.iter().any(|fault| is_byzantine(&fault.kind)) {
            return None;
        }
        let (graph, trusted) = (&scenario.graph, trusted_robots(scenario));
        let has_leader = trusted.contains(&true);
        let is_exact = graph.robot_count() <= EXACT_ROBUSTNESS_ROBOTS_MAX;
        let robust = if is_exact { robustness(graph) } else { robustness_upper_bound(graph) };
        let strong = has_leader.then(|| strong_robustness(graph, &trusted));
        Some(LiarTolerance {
            liars_max,
            robustness: robust,
            robustness_is_bound: !is_exact,
            strong_robustness: strong,
            among_heard: strong.unwrap_or(robust).saturating_sub(1) / 2,
            in_all: (is_exact && !has_leader).then(|| liars_total_max(graph)),
        })
    }

    /// Returns the robustness as text.
    pub(super) fn describe(&self, leader: Option<&str>) -> String {
        let at_most = if self.robustness_is_bound { "at most " } else { "" };
        let robust = format!("the graph is {at_most}{}-robust", self.robustness);
        let count = |count: usize| format!("{count} liar{}", if count == 1 { "" } else { "s" });
        let tolerated = count(self.among_heard);
        match (self.strong_robustness, self.in_all) {
            (Some(strong), _) => format!(
                "{robust}, and strongly {strong}-robust around the leader {}: it tolerates {tolerated} among the \
                 in-neighbors of each robot",
                leader.unwrap_or_default()
            ),
            (None, Some(in_all)) => format!(
                "{robust}: without a leader it tolerates {tolerated} among the in-neighbors of each robot, and \
                 {} in total",
                count(in_all)
            ),
            (None, None) => {
                format!(
                    "{robust}: it tolerates {at_most}{tolerated} among the in-neighbors of each robot"
                )
            }
        }
    }
}

/// Returns for each robot whether the resilient laws trust it.
fn trusted_robots(scenario: &Scenario) -> Vec<bool> {
    scenario.robots.iter().map(|robot| robot.role.reference.is_local()).collect()
}

/// Checks that robots with a resilient law have enough in-neighbors, and that the graph is robust enough.
pub(super) fn check_liar_tolerance(scenario: &Scenario) -> Vec<Finding> {
    let (robots, graph, trusted) = (&scenario.robots, &scenario.graph, trusted_robots(scenario));
    let name = |i: usize| robots[i].name.as_str();
    let leader = scenario.leader().map_or("a leader", name);
    let resilient: Vec<usize> = (0..robots.len()).filter(|&i| robots[i].liars_max() > 0).collect();
    if resilient.is_empty() {
        return Vec::new();
    }
    let senders = |i: usize| graph.incoming_edges(i).map(|edge| edge.from);
    let needed = |i: usize| 2 * robots[i].liars_max() + 1;
    let has_too_few =
        |&&i: &&usize| !senders(i).any(|from| trusted[from]) && senders(i).count() < needed(i);
    if let Some(&i) = resilient.iter().find(has_too_few) {
        let (liars_max, count) = (robots[i].liars_max(), senders(i).count());
        return vec![error_finding(
            format!("robot.{}.liars_max", name(i)),
            format!(
                "{} has liars_max = {liars_max}, but does not hear {leader} and has only {count} \
                 in-neighbors",
                name(i)
            ),
            format!(
                "expected 2 liars_max + 1 = {} in-neighbors, or the leader among them",
                needed(i)
            ),
        )];
    }
    let follows_others = |&i: &usize| {
        robots[i].role.reference == Reference::Offsets
            && robots[i].liars_max() == 0
            && senders(i).any(|from| !trusted[from])
    };
    let unprotected: Vec<usize> = (0..robots.len()).filter(follows_others).collect();
    let senders_needed = |i: usize| match robots[i].liars_max() {
        0 => (!unprotected.contains(&i)).then_some(usize::MAX),
        _ => Some(needed(i)),
    };
    let mut findings = Vec::new();
    let unreached = bootstrap_percolation_failures(graph, &trusted, senders_needed);
    let unreached: Vec<&str> =
        unreached.into_iter().filter(|i| resilient.contains(i)).map(name).collect();
    if let Some(first) = unreached.first() {
        let liars_max = resilient.iter().map(|&i| robots[i].liars_max()).max().unwrap_or(0);
        findings.push(error_finding(
            format!("robot.{first}.liars_max"),
            format!(
                "the graph does not tolerate liars_max = {liars_max}: none of {} hears {leader}, or 2 liars_max + \
                 1 robots outside of this group with a reliable position",
                format_list(&unreached, NAMES_MAX)
            ),
            format!(
                "expected a graph that is strongly {}-robust around {leader}, or a smaller `liars_max`",
                2 * liars_max + 1
            ),
        ));
    }
    if let Some(&i) = unprotected.first() {
        let all: Vec<&str> = unprotected.iter().map(|&i| name(i)).collect();
        findings.push(warning_finding(
            format!("robot.{}.law", name(i)),
            format!(
                "Byzantine robots displace {}, and these then mislead others",
                format_list(&all, NAMES_MAX)
            ),
            "expected `law = \"formation-robust\"` for all robots that keep a slot",
        ));
    }
    let byzantine_leader = scenario.faults.iter().find_map(|fault| match fault.kind {
        FaultKind::Lie { robot, .. } if trusted[robot] => Some(robot),
        _ => None,
    });
    findings.extend(byzantine_leader.map(|i| {
        warning_finding(
            "fault",
            format!("{} is Byzantine, but trusted: no robot discards its values", name(i)),
            "expected a Byzantine robot that does not lead",
        )
    }));
    findings
}
