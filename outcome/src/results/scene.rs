//! Content of the picture of a run: the constant part, and one instant.

use crate::report::scene::{
    EdgeState, Frame, FrameRobot, RobotState, Scene, SceneEdge, SceneFault, SceneRobot,
};
use experiment::scenario::{FaultKind, Scenario, Silenced};
use formation::front_point::front_point;
use formation::graph::Edge;
use formation::rewiring::Purpose;
use formation::seconds;
use protocol::brief::Pace;
use protocol::law::Reference;
use protocol::message::{Contact, TruthHeader, TruthRow};

/// Returns the constant part of the picture.
pub fn scene(scenario: &Scenario, pace: Pace) -> Scene {
    let contains = !scenario.contained_robots().is_empty();
    let robots = scenario.robots.iter().map(|robot| SceneRobot {
        name: robot.name.clone(),
        role: match robot.role.reference {
            Reference::Trajectory if robot.role.leads => "main-leader",
            Reference::Trajectory | Reference::Goal | Reference::Free => robot.role.name,
            Reference::Offsets if contains => "leader",
            Reference::Offsets => "formation",
            Reference::Middle => "contained",
        }
        .into(),
        front_point_m: robot.front_point_m,
    });
    let rewiring = scenario.rewiring();
    let edges = rewiring.links().iter().enumerate();
    let edge = |(link, edge): (usize, &Edge)| SceneEdge {
        from: edge.from,
        to: edge.to,
        spare: rewiring.purpose(link) != Purpose::InNeighbor,
        for_place: rewiring.purpose(link) == Purpose::LeaderSlot,
    };
    let faults = scenario.faults.iter().map(|fault| {
        let struck = fault.kind.affected_component(scenario);
        let until_ns = match fault.kind {
            FaultKind::Kill { restart_after_ns, .. } => {
                restart_after_ns.map(|after_ns| fault.at_ns.saturating_add(after_ns))
            }
            _ => fault.until_ns(),
        };
        let is_link = matches!(fault.kind, FaultKind::Link { .. });
        SceneFault {
            t_s: seconds(fault.at_ns),
            until_s: until_ns.map(seconds),
            what: fault.kind.describe(scenario),
            robots: struck.robot.filter(|_| !is_link).into_iter().collect(),
            cuts: cut_by(struck.silenced),
        }
    });
    Scene {
        name: scenario.name.clone(),
        pace: pace.keyword().into(),
        duration_s: seconds(scenario.duration_ns),
        distance_min_m: scenario.avoidance.distance_min_m,
        robots: robots.collect(),
        edges: edges.map(edge).collect(),
        walls: scenario.walls.iter().map(|wall| wall.shape.clone()).collect(),
        faults: faults.collect(),
        faults_in_all: 0,
    }
}

/// Returns the edge that a fault cuts; `None` if it silences something else.
fn cut_by(silenced: Silenced) -> Option<usize> {
    match silenced {
        Silenced::Edge(edge) => Some(edge),
        Silenced::Robot(_) | Silenced::Nobody => None,
    }
}

/// Returns whether the scenario cuts an edge at this time.
fn is_cut(scenario: &Scenario, edge: usize, t_ns: u64) -> bool {
    scenario.faults.iter().any(|fault| {
        let lasts = fault.at_ns <= t_ns && fault.until_ns().is_none_or(|until_ns| t_ns < until_ns);
        lasts && cut_by(fault.kind.affected_component(scenario).silenced) == Some(edge)
    })
}

/// Returns the picture at one ground-truth sample. `state` returns the state of a robot, `heard` the contact of an
/// edge `(from, to)`, `manually_cut_edge` whether an edge is cut manually.
pub fn frame(
    scenario: &Scenario,
    header: &TruthHeader,
    rows: &[TruthRow],
    errors_m: &[Option<f64>],
    state: impl Fn(usize) -> RobotState,
    heard: impl Fn(usize, usize) -> Contact,
    manually_cut_edge: impl Fn(usize) -> bool,
) -> Frame {
    let alphas: Vec<_> = rows
        .iter()
        .zip(&scenario.robots)
        .map(|(row, robot)| front_point(row.pose(), robot.front_point_m))
        .collect();
    let pairs = alphas.iter().enumerate().flat_map(|(i, a)| {
        let others = &alphas[i + 1..];
        others.iter().map(move |b| (a - b).norm())
    });
    let shown = rows.iter().zip(errors_m).enumerate().map(|(robot, (row, error_m))| {
        let state = state(robot);
        FrameRobot {
            x_m: row.x_m,
            y_m: row.y_m,
            heading_rad: row.heading_rad,
            error_m: error_m.filter(|_| state != RobotState::Dead),
            state,
        }
    });
    let in_graph = scenario.graph.edges().len();
    let edge = |(place, ends): (usize, &Edge)| {
        let contact = match heard(ends.from, ends.to) {
            Contact::Unheard if place >= in_graph => EdgeState::Closed,
            Contact::Fresh => EdgeState::Fresh,
            Contact::Stale | Contact::Unheard => EdgeState::Stale,
            Contact::Lost => EdgeState::Lost,
        };
        let cut =
            place < in_graph && manually_cut_edge(place) || is_cut(scenario, place, header.t_ns);
        contact.combine([ends.from, ends.to].map(&state), cut)
    };
    Frame {
        t_s: seconds(header.t_ns),
        robots: shown.collect(),
        edges: scenario
            .graph
            .edges()
            .iter()
            .chain(&scenario.repair.spares)
            .enumerate()
            .map(edge)
            .collect(),
        distance_m: pairs.reduce(f64::min),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use experiment::examples::row_of_three;
    use experiment::scenario::Fault;
    use protocol::fault::LinkFaultKind;

    #[test]
    fn scene_refers_to_edges_and_faults_by_index() {
        let mut scenario = row_of_three();
        let cut = FaultKind::Link { edge: 0, kind: LinkFaultKind::Cut };
        scenario.faults = vec![
            Fault { at_ns: 1_000_000_000, for_ns: Some(500_000_000), kind: cut },
            Fault {
                at_ns: 2_000_000_000,
                for_ns: None,
                kind: FaultKind::Kill { robot: 2, restart_after_ns: Some(1_000_000_000) },
            },
        ];
        let scene = scene(&scenario, Pace::Lockstep);
        let ends = scenario.graph.edges()[0];
        assert_eq!(
            scene.edges[0],
            SceneEdge { from: ends.from, to: ends.to, ..SceneEdge::default() }
        );
        let [cut, kill] = &scene.faults[..] else { panic!("{:?}", scene.faults) };
        assert_eq!((cut.t_s, cut.until_s, cut.cuts), (1.0, Some(1.5), Some(0)));
        assert!(cut.robots.is_empty(), "{cut:?}");
        assert_eq!((kill.what.as_str(), kill.until_s), ("kill r3", Some(3.0)));
        assert_eq!((&kill.robots[..], kill.cuts), (&[2][..], None));
        let cut_at = |t_ns| [0, 1].map(|edge| is_cut(&scenario, edge, t_ns));
        assert_eq!(cut_at(999_999_999), [false; 2]);
        assert_eq!(cut_at(1_000_000_000), [true, false]);
        assert_eq!(cut_at(1_500_000_000), [false; 2]);
    }
}
