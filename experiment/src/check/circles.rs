//! Closed cycles that a failure of one robot creates: robots that use only each other, over backup neighbors.

use formation::graph::{Edge, FormationGraph};
use formation::laplacian::velocity_feedback_robots;

use crate::scenario::Scenario;

/// A closed cycle, by robot indices.
pub(super) struct Circle {
    /// Robot whose failure closes the cycle.
    pub(super) dead: usize,
    /// Robot that then uses a backup neighbor.
    pub(super) robot: usize,
    /// The backup neighbor, which uses that robot.
    pub(super) spare: usize,
}

/// Returns the first cycle that the failure of one robot closes. The failure of the main leader is not considered,
/// because all robots stop without it.
pub(super) fn first_circle(scenario: &Scenario) -> Option<Circle> {
    let mortal = |dead: &usize| scenario.leader() != Some(*dead) && !scenario.spares.is_empty();
    (0..scenario.robots.len()).filter(mortal).find_map(|dead| circle(scenario, dead))
}

fn circle(scenario: &Scenario, dead: usize) -> Option<Circle> {
    let closed = scenario.closed_spares(&[dead], &[]);
    let whole = scenario.graph_with_spares();
    let left = |&(place, edge): &(usize, &Edge)| {
        !closed.contains(&place) && ![edge.from, edge.to].contains(&dead)
    };
    let left: Vec<(usize, &Edge)> = whole.edges().iter().enumerate().filter(left).collect();
    let edges = left.iter().map(|(_, edge)| **edge).collect();
    let graph = FormationGraph::new(scenario.robots.len(), edges);
    let reached = graph.reachability();
    let feed_forward: Vec<bool> = scenario.robots.iter().map(|robot| robot.feed_forward).collect();
    let velocity_feedback_robots = velocity_feedback_robots(&graph, &feed_forward);
    // A backup leader that no leader reaches leads.
    let leads = |leader| [&[leader], &scenario.deputies[..]].concat();
    let adrift = |robot: usize| match scenario.leader() {
        Some(leader) => leads(leader).iter().all(|&leads| !reached[leads][robot]),
        None => velocity_feedback_robots.contains(&robot),
    };
    let spares = left.iter().filter(|(place, _)| *place >= scenario.graph.edges().len());
    let mut ends = spares.map(|(_, edge)| (edge.from, edge.to));
    let (spare, robot) =
        ends.find(|&(spare, robot)| adrift(spare) && adrift(robot) && reached[robot][spare])?;
    Some(Circle { dead, robot, spare })
}
