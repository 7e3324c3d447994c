//! Would some death leave robots that go by each other, by spares among them, and by nobody else?

use formation::graph::{Edge, FormationGraph};
use formation::laplacian::velocity_feedback_robots;

use crate::scenario::Scenario;

/// Robots that go by each other alone. By their places.
pub(super) struct Circle {
    /// Whose death closes it.
    pub(super) dead: usize,
    /// Who then goes by a spare.
    pub(super) robot: usize,
    /// Which spare, which goes by that robot.
    pub(super) spare: usize,
}

/// The first that a single death closes. The main leader's own is not meant: without it all stand.
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
    // A deputy that no leader reaches leads.
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
