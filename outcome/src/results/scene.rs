//! Content of the picture of a run: the constant part, and one instant.

use crate::report::scene::{
    EdgeState, FrameRobot, RobotState, Scene, SceneEdge, SceneFault, SceneFrame, SceneRobot,
};
use experiment::scenario::{FaultKind, Scenario, SilencedSource};
use formation::front_point::front_point;
use formation::graph::Edge;
use formation::ns_to_seconds;
use formation::rewiring::SenderPurpose;
use protocol::brief::Pace;
use protocol::law::Reference;
use protocol::message::{ReceptionState, TruthHeader, TruthRow};

/// Returns the constant part of the picture.
pub fn build_scene(scenario: &Scenario, pace: Pace) -> Scene {
    let has_contained_robots = !scenario.contained_robots().is_empty();
    let has_different_sizes = scenario.has_different_sizes();
    let robots = scenario.robots.iter().map(|robot| SceneRobot {
        name: robot.name.clone(),
        role: match robot.role.reference {
            Reference::Trajectory if robot.role.leads => "main-leader",
            Reference::Trajectory | Reference::Goal | Reference::LawTarget => robot.role.name,
            Reference::Offsets if has_contained_robots => "leader",
            Reference::Offsets => "formation",
            Reference::NeighborMean => "contained",
        }
        .into(),
        front_point_m: robot.front_point_m,
        keep_m: has_different_sizes.then_some(robot.keep_m),
    });
    let rewiring = scenario.rewiring();
    let edges = rewiring.links().iter().enumerate();
    let edge = |(link, edge): (usize, &Edge)| SceneEdge {
        from: edge.from,
        to: edge.to,
        spare: rewiring.purpose(link) != SenderPurpose::InNeighbor,
        for_place: rewiring.purpose(link) == SenderPurpose::KeepLeaderSlot,
        by_distance: scenario.communication_range(link).is_some(),
    };
    let faults = scenario.faults.iter().map(|fault| {
        let affected = fault.kind.affected_component(scenario);
        let until_ns = match fault.kind {
            FaultKind::Kill { restart_after_ns, .. } => {
                restart_after_ns.map(|after_ns| fault.start_ns.saturating_add(after_ns))
            }
            _ => fault.end_ns(),
        };
        let is_link_fault = matches!(fault.kind, FaultKind::Link { .. });
        SceneFault {
            t_s: ns_to_seconds(fault.start_ns),
            until_s: until_ns.map(ns_to_seconds),
            what: fault.kind.describe(scenario),
            robots: affected.robot.filter(|_| !is_link_fault).into_iter().collect(),
            cuts: cut_edge_index(affected.silenced_source),
        }
    });
    Scene {
        name: scenario.name.clone(),
        pace: pace.keyword().into(),
        duration_s: ns_to_seconds(scenario.duration_ns),
        distance_min_m: scenario.avoidance.distance_min_m,
        robots: robots.collect(),
        edges: edges.map(edge).collect(),
        walls: scenario.walls.iter().map(|wall| wall.shape.clone()).collect(),
        faults: faults.collect(),
        faults_in_all: 0,
    }
}

/// Returns the edge that a fault cuts; `None` if it silences something else.
fn cut_edge_index(silenced: SilencedSource) -> Option<usize> {
    match silenced {
        SilencedSource::Edge(edge) => Some(edge),
        SilencedSource::Robot(_) | SilencedSource::NoSource => None,
    }
}

/// Returns whether the scenario cuts an edge at this time.
fn is_edge_cut(scenario: &Scenario, edge: usize, t_ns: u64) -> bool {
    scenario.faults.iter().any(|fault| {
        let is_active = fault.start_ns <= t_ns && fault.end_ns().is_none_or(|end_ns| t_ns < end_ns);
        is_active
            && cut_edge_index(fault.kind.affected_component(scenario).silenced_source) == Some(edge)
    })
}

/// Returns the picture at one ground-truth sample. `state` returns the state of a robot, `reception_state` that of an
/// edge `(from, to)`, `is_edge_cut_manually` whether an edge is cut manually.
pub fn build_frame(
    scenario: &Scenario,
    header: &TruthHeader,
    rows: &[TruthRow],
    errors_m: &[Option<f64>],
    state: impl Fn(usize) -> RobotState,
    reception_state: impl Fn(usize, usize) -> ReceptionState,
    is_edge_cut_manually: impl Fn(usize) -> bool,
) -> SceneFrame {
    let alphas: Vec<_> = rows
        .iter()
        .zip(&scenario.robots)
        .map(|(row, robot)| front_point(row.pose(), robot.front_point_m))
        .collect();
    let pairs = alphas.iter().enumerate().flat_map(|(i, a)| {
        let later_robots = &alphas[i + 1..];
        later_robots.iter().map(move |b| (a - b).norm())
    });
    let robots = rows.iter().zip(errors_m).enumerate().map(|(robot, (row, error_m))| {
        let state = state(robot);
        FrameRobot {
            x_m: row.x_m,
            y_m: row.y_m,
            heading_rad: row.heading_rad,
            error_m: error_m.filter(|_| state != RobotState::Dead),
            state,
        }
    });
    let graph_edge_count = scenario.graph.edges().len();
    let edge_state = |(index, edge): (usize, &Edge)| {
        let state_at_receiver = match reception_state(edge.from, edge.to) {
            ReceptionState::NothingReceived
                if index >= graph_edge_count || scenario.communication_range(index).is_some() =>
            {
                EdgeState::Closed
            }
            ReceptionState::Apart => EdgeState::Closed,
            ReceptionState::Fresh => EdgeState::Fresh,
            ReceptionState::Stale | ReceptionState::NothingReceived => EdgeState::Stale,
            ReceptionState::Lost => EdgeState::Lost,
        };
        let is_cut = index < graph_edge_count && is_edge_cut_manually(index)
            || is_edge_cut(scenario, index, header.t_ns);
        state_at_receiver.combine([edge.from, edge.to].map(&state), is_cut)
    };
    SceneFrame {
        t_s: ns_to_seconds(header.t_ns),
        robots: robots.collect(),
        edges: scenario
            .graph
            .edges()
            .iter()
            .chain(&scenario.repair_plan.spares)
            .enumerate()
            .map(edge_state)
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
            Fault { start_ns: 1_000_000_000, duration_ns: Some(500_000_000), kind: cut },
            Fault {
                start_ns: 2_000_000_000,
                duration_ns: None,
                kind: FaultKind::Kill { robot: 2, restart_after_ns: Some(1_000_000_000) },
            },
        ];
        let scene = build_scene(&scenario, Pace::Lockstep);
        let edge = scenario.graph.edges()[0];
        assert_eq!(
            scene.edges[0],
            SceneEdge { from: edge.from, to: edge.to, ..SceneEdge::default() }
        );
        let [cut, kill] = &scene.faults[..] else { panic!("{:?}", scene.faults) };
        assert_eq!((cut.t_s, cut.until_s, cut.cuts), (1.0, Some(1.5), Some(0)));
        assert!(cut.robots.is_empty(), "{cut:?}");
        assert_eq!((kill.what.as_str(), kill.until_s), ("kill r3", Some(3.0)));
        assert_eq!((&kill.robots[..], kill.cuts), (&[2][..], None));
        let cut_at = |t_ns| [0, 1].map(|edge| is_edge_cut(&scenario, edge, t_ns));
        assert_eq!(cut_at(999_999_999), [false; 2]);
        assert_eq!(cut_at(1_000_000_000), [true, false]);
        assert_eq!(cut_at(1_500_000_000), [false; 2]);
    }
}
