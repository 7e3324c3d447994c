//! Closed cycles that a failure of one robot creates: robots that use only each other, over backup neighbors.

use formation::graph::{Edge, FormationGraph};
use formation::laplacian::velocity_feedback_robots;
use formation::rewiring::Rewiring;

use crate::scenario::Scenario;

/// A closed cycle, by robot indices.
pub(super) struct DependencyCycle {
    /// Robot whose failure closes the cycle.
    pub(super) failed_robot: usize,
    /// Robot that then uses a backup neighbor.
    pub(super) robot: usize,
    /// The backup neighbor, which uses that robot.
    pub(super) spare: usize,
}

/// Returns the first cycle that the failure of one robot closes. The failure of the main leader is not considered,
/// because all robots stop without it.
pub(super) fn find_first_cycle(scenario: &Scenario) -> Option<DependencyCycle> {
    let can_fail =
        |dead: &usize| scenario.leader() != Some(*dead) && !scenario.repair_plan.spares.is_empty();
    let rewiring = scenario.rewiring();
    (0..scenario.robots.len())
        .filter(can_fail)
        .find_map(|dead| find_cycle_after_failure(scenario, &rewiring, dead))
}

fn find_cycle_after_failure(
    scenario: &Scenario,
    rewiring: &Rewiring,
    dead: usize,
) -> Option<DependencyCycle> {
    let mut is_unused = vec![false; rewiring.links().len()];
    rewiring.unused_links(&[dead], &[]).into_iter().for_each(|link| is_unused[link] = true);
    let remaining = |&(index, edge): &(usize, &Edge)| {
        !is_unused[index] && ![edge.from, edge.to].contains(&dead)
    };
    let remaining: Vec<(usize, &Edge)> =
        rewiring.links().iter().enumerate().filter(remaining).collect();
    let edges = remaining.iter().map(|(_, edge)| **edge).collect();
    let graph = FormationGraph::new(scenario.robots.len(), edges);
    let feed_forward: Vec<bool> =
        scenario.robots.iter().map(|robot| robot.uses_feed_forward).collect();
    let is_adrift: Vec<bool> = match scenario.leader() {
        Some(leader) => {
            let deputies = &scenario.repair_plan.deputies;
            let is_led = graph.robots_reached_from(&rewiring.leading_robots(
                Some(leader),
                deputies,
                &[dead],
                &[],
            ));
            is_led.into_iter().map(|is_led| !is_led).collect()
        }
        None => {
            let mut is_adrift = vec![false; scenario.robots.len()];
            let robots = velocity_feedback_robots(&graph, &feed_forward);
            robots.into_iter().for_each(|robot| is_adrift[robot] = true);
            is_adrift
        }
    };
    let backup_links = remaining.iter().filter(|(index, _)| *index >= scenario.graph.edges().len());
    let mut endpoints = backup_links.map(|(_, edge)| (edge.from, edge.to));
    let (spare, robot) = endpoints.find(|&(spare, robot)| {
        is_adrift[spare] && is_adrift[robot] && graph.robots_reached_from(&[robot])[spare]
    })?;
    Some(DependencyCycle { failed_robot: dead, robot, spare })
}
