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
    let mortal =
        |dead: &usize| scenario.leader() != Some(*dead) && !scenario.repair_plan.spares.is_empty();
    let rewiring = scenario.rewiring();
    (0..scenario.robots.len())
        .filter(mortal)
        .find_map(|dead| find_cycle_after_failure(scenario, &rewiring, dead))
}

fn find_cycle_after_failure(
    scenario: &Scenario,
    rewiring: &Rewiring,
    dead: usize,
) -> Option<DependencyCycle> {
    let mut unused = vec![false; rewiring.links().len()];
    rewiring.unused_links(&[dead], &[]).into_iter().for_each(|link| unused[link] = true);
    let left =
        |&(place, edge): &(usize, &Edge)| !unused[place] && ![edge.from, edge.to].contains(&dead);
    let left: Vec<(usize, &Edge)> = rewiring.links().iter().enumerate().filter(left).collect();
    let edges = left.iter().map(|(_, edge)| **edge).collect();
    let graph = FormationGraph::new(scenario.robots.len(), edges);
    let feed_forward: Vec<bool> =
        scenario.robots.iter().map(|robot| robot.uses_feed_forward).collect();
    let adrift: Vec<bool> = match scenario.leader() {
        Some(leader) => {
            let deputies = &scenario.repair_plan.deputies;
            let led = graph.robots_reached_from(&rewiring.leading_robots(
                Some(leader),
                deputies,
                &[dead],
                &[],
            ));
            led.into_iter().map(|led| !led).collect()
        }
        None => {
            let mut adrift = vec![false; scenario.robots.len()];
            let robots = velocity_feedback_robots(&graph, &feed_forward);
            robots.into_iter().for_each(|robot| adrift[robot] = true);
            adrift
        }
    };
    let spares = left.iter().filter(|(place, _)| *place >= scenario.graph.edges().len());
    let mut ends = spares.map(|(_, edge)| (edge.from, edge.to));
    let (spare, robot) = ends.find(|&(spare, robot)| {
        adrift[spare] && adrift[robot] && graph.robots_reached_from(&[robot])[spare]
    })?;
    Some(DependencyCycle { failed_robot: dead, robot, spare })
}
