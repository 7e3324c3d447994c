//! Tests of each cause with a formation whose outcome is known in closed form.

use formation::graph::{Edge, FormationGraph};
use formation::scale::Scale;
use formation::trajectory::Trajectory;
use protocol::avoidance::AvoidanceDescription;
use protocol::brief::LeadBrief;
use protocol::law::Role;

use super::*;
use crate::examples::row_of_three;

const LEADER_ROLE: Role = Role::LEADER;
const FORMATION_ROLE: Role = Role::FORMATION;
const CONTAINED_ROLE: Role = Role::CONTAINED;

/// Returns a leader that moves at 1 m/s along x.
fn moving_leader() -> Option<LeadBrief> {
    let trajectory = Trajectory::Line { center_m: [0.0, 0.0], velocity_m_s: [1.0, 0.0] };
    Some(LeadBrief { scale: Scale::CONSTANT_ONE, trajectory, keep_heading: false })
}

fn standing_leader() -> Option<LeadBrief> {
    let trajectory = Trajectory::Still { center_m: [0.0, 0.0] };
    Some(LeadBrief { scale: Scale::CONSTANT_ONE, trajectory, keep_heading: false })
}

/// Returns a predictor for robots of these roles; an edge is sender, receiver and offset. The steering distance is 0.25
/// m, in-neighbors are lost after 0.1 s, and the bound is 1 cm.
fn formation_scenario(
    roles: &[Role],
    edges: &[(usize, usize, [f64; 2])],
    lead: Option<LeadBrief>,
) -> Scenario {
    let mut scenario = row_of_three();
    let template = scenario.robots[0].clone();
    scenario.robots = roles
        .iter()
        .enumerate()
        .map(|(i, &role)| {
            let mut robot = template.clone();
            (robot.role, robot.name) = (role, format!("r{}", i + 1));
            robot
        })
        .collect();
    let edge =
        |&(from, to, offset): &(usize, usize, [f64; 2])| Edge { from, to, offset_m: offset.into() };
    scenario.graph = FormationGraph::new(roles.len(), edges.iter().map(edge).collect());
    scenario.lead = lead;
    scenario.silence.lost_after_ns = 100_000_000;
    scenario.avoidance_method = AvoidanceDescription {
        steering_distance: Some(("d_f", |_| 0.25)),
        ..AvoidanceDescription::NO_AVOIDANCE
    };
    scenario
}

fn predicted_causes(
    scenario: &Scenario,
    dead: &[usize],
    cut_edges: &[usize],
) -> Vec<(usize, BreakCause)> {
    let broken = FailurePredictor::new(scenario).broken_robots(dead, cut_edges, Some(1.0));
    broken.into_iter().map(|prediction| (prediction.robot, prediction.cause)).collect()
}

/// Returns a line: 0 leads; 1, 2 and 3 follow each other behind it.
fn line_scenario(lead: Option<LeadBrief>) -> Scenario {
    let behind = [-1.0, 0.0];
    let edges = [(0, 1, behind), (1, 2, behind), (2, 3, behind)];
    formation_scenario(&[LEADER_ROLE, FORMATION_ROLE, FORMATION_ROLE, FORMATION_ROLE], &edges, lead)
}

/// Returns a containment: 0 leads, 1 and 2 keep slots, and form a triangle with the corners (0, 0), (-4, 2), (-4, -2).
/// 3 receives from 0 and 1; 4 receives from 1, 2 and 3.
fn containment_scenario(lead: Option<LeadBrief>) -> Scenario {
    let none = [0.0, 0.0];
    let edges = [
        (0, 1, [-4.0, 2.0]),
        (0, 2, [-4.0, -2.0]),
        (0, 3, none),
        (1, 3, none),
        (1, 4, none),
        (2, 4, none),
        (3, 4, none),
    ];
    formation_scenario(
        &[LEADER_ROLE, FORMATION_ROLE, FORMATION_ROLE, CONTAINED_ROLE, CONTAINED_ROLE],
        &edges,
        lead,
    )
}

#[test]
fn moving_line_leaves_robots_after_a_gap_and_still_line_none() {
    let expected = [
        (2, BreakCause::NoInNeighbor { lost_in_neighbor: 1 }),
        (3, BreakCause::LeaderUnreachable { leader: 0 }),
    ];
    assert_eq!(predicted_causes(&line_scenario(moving_leader()), &[1], &[]), expected);
    let mut last = line_scenario(moving_leader());
    last.silence.policy = SilencePolicy::Last;
    let expected_last = [
        (2, BreakCause::UsesLastPosition { lost_in_neighbor: 1 }),
        (3, BreakCause::LeaderUnreachable { leader: 0 }),
    ];
    assert_eq!(predicted_causes(&last, &[1], &[]), expected_last);
    assert_eq!(predicted_causes(&line_scenario(moving_leader()), &[], &[1]), expected);
    assert_eq!(predicted_causes(&line_scenario(moving_leader()), &[3], &[]), []);
    for dead in 0..4 {
        assert_eq!(
            predicted_causes(&line_scenario(standing_leader()), &[dead], &[]),
            [],
            "r{} dies",
            dead + 1
        );
    }
}

#[test]
fn robots_of_a_dead_leader_stop_after_their_overrun() {
    // At 1 m/s for 0.1 s but for two periods.
    let mut scenario = line_scenario(moving_leader());
    scenario.period_ns = 5_000_000;
    let predictor = FailurePredictor::new(&scenario);
    let broken = predictor.broken_robots(&[0], &[], Some(1.0));
    assert_eq!(broken.len(), 3);
    for robot in &broken {
        assert_eq!(robot.cause, BreakCause::LeaderDead { leader: 0 });
        assert!((robot.slot_distance_m.unwrap() - 0.09).abs() < 1e-9, "{robot:?}");
    }
    assert_eq!(predictor.with_broken_threshold(0.11).broken_robots(&[0], &[], Some(1.0)), []);
}

#[test]
fn follower_of_leader_and_stranded_robot_is_held_back() {
    // 0 -> 1 -> 2 -> 1: without the edge 1 -> 2, 2 has no in-neighbor.
    let edges = [(0, 1, [-1.0, 0.0]), (1, 2, [-1.0, 0.0]), (2, 1, [1.0, 0.0])];
    let scenario =
        formation_scenario(&[LEADER_ROLE, FORMATION_ROLE, FORMATION_ROLE], &edges, moving_leader());
    let expected = [
        (1, BreakCause::InNeighborLeftBehind { in_neighbor: 2 }),
        (2, BreakCause::NoInNeighbor { lost_in_neighbor: 1 }),
    ];
    assert_eq!(predicted_causes(&scenario, &[], &[1]), expected);
}

#[test]
fn robot_that_lost_one_of_two_stops_or_holds_by_policy() {
    // 2 receives from 0 and 1.
    let edges = [(0, 1, [-1.0, 0.0]), (0, 2, [0.0, -1.0]), (1, 2, [1.0, -1.0])];
    let mut scenario =
        formation_scenario(&[LEADER_ROLE, FORMATION_ROLE, FORMATION_ROLE], &edges, moving_leader());
    assert_eq!(predicted_causes(&scenario, &[1], &[]), []);
    scenario.silence.policy = SilencePolicy::Stop;
    assert_eq!(
        predicted_causes(&scenario, &[1], &[]),
        [(2, BreakCause::NoInNeighbor { lost_in_neighbor: 1 })]
    );
    scenario.silence.policy = SilencePolicy::Keep;
    assert_eq!(
        predicted_causes(&scenario, &[1], &[]),
        [(2, BreakCause::UsesLastPosition { lost_in_neighbor: 1 })]
    );
    scenario.lead = standing_leader();
    assert_eq!(predicted_causes(&scenario, &[1], &[]), []);
}

#[test]
fn contained_robot_moves_to_the_mean_with_its_followers() {
    for lead in [moving_leader(), standing_leader()] {
        // r4 was in the middle of (0, 0) and (-4, 2), r5 in that of (-4, 2), (-4, -2), (-2, 1).
        let predictor = FailurePredictor::new(&containment_scenario(lead));
        let broken = predictor.broken_robots(&[2], &[], Some(1.0));
        let [prediction] = broken[..] else { panic!("{broken:?}") };
        assert_eq!(
            (prediction.robot, prediction.cause),
            (4, BreakCause::DesiredPositionChanged { lost_in_neighbor: 2 })
        );
        // It goes from (-10/3, 1/3) to (-3, 3/2).
        let expected_m = Vec2::new(-10.0 / 3.0 + 3.0, 1.0 / 3.0 - 1.5).norm();
        assert!((prediction.slot_distance_m.unwrap() - expected_m).abs() < 1e-9, "{prediction:?}");
        assert_eq!(prediction.hull_distance_m, None);
    }
}

#[test]
fn robot_with_one_neighbor_stops_at_standoff_from_its_slot() {
    // Without 1, robot 3 receives only from the leader; 4, which receives from 2 and 3, follows.
    let broken = FailurePredictor::new(&containment_scenario(standing_leader())).broken_robots(
        &[],
        &[3],
        Some(1.0),
    );
    let causes: Vec<(usize, BreakCause)> =
        broken.iter().map(|prediction| (prediction.robot, prediction.cause)).collect();
    assert_eq!(
        causes,
        [
            (3, BreakCause::SlotOccupied { occupant: 0 }),
            (4, BreakCause::FollowsBrokenRobot { in_neighbor: 3 })
        ]
    );
    // It came from (-2, 1), and stops 0.25 m before the leader.
    let expected_m = 5.0f64.sqrt() - 0.25;
    assert!((broken[0].slot_distance_m.unwrap() - expected_m).abs() < 1e-3, "{broken:?}");
    assert!((broken[1].slot_distance_m.unwrap() - expected_m / 3.0).abs() < 1e-3, "{broken:?}");
    let scenario = containment_scenario(standing_leader());
    let name = |i: usize| scenario.robots[i].name.as_str();
    assert_eq!(broken[0].describe(name), "desired position occupied by r1 (Remark 1)");
}

#[test]
fn contained_robots_without_leaders_have_an_empty_hull() {
    // 2 and 3 receive from each other; only 2 receives from 1, which keeps a slot.
    let none = [0.0, 0.0];
    let edges = [(0, 1, [-2.0, 0.0]), (1, 2, none), (2, 3, none), (3, 2, none), (0, 3, none)];
    let scenario = formation_scenario(
        &[LEADER_ROLE, FORMATION_ROLE, CONTAINED_ROLE, CONTAINED_ROLE],
        &edges,
        moving_leader(),
    );
    let cut_edges = [1, 4];
    assert_eq!(
        predicted_causes(&scenario, &[], &cut_edges),
        [(2, BreakCause::Uncontained), (3, BreakCause::Uncontained)]
    );
}

#[test]
fn leaderless_consistent_offsets_do_not_move_after_death() {
    let side = [[0.5, 0.0], [0.0, 0.5], [-0.5, 0.0], [0.0, -0.5]];
    let edges: Vec<_> = (0..4).map(|i| (i, (i + 1) % 4, side[i])).collect();
    let ring = formation_scenario(&[FORMATION_ROLE; 4], &edges, None);
    for robot in 0..4 {
        assert_eq!(predicted_causes(&ring, &[robot], &[]), []);
        assert_eq!(predicted_causes(&ring, &[], &[robot]), []);
    }
}

#[test]
fn inconsistent_offsets_shift_the_slot_to_the_mean() {
    // 2 receives from 0 and 1, whose offsets disagree by 0.1 m: it settles in the middle, and moves by half of that.
    let edges = [(0, 1, [1.0, 0.0]), (0, 2, [0.0, 1.0]), (1, 2, [-0.9, 1.0]), (0, 3, [-1.0, 0.0])];
    let scenario = formation_scenario(&[FORMATION_ROLE; 4], &edges, None);
    let broken = FailurePredictor::new(&scenario).broken_robots(&[1], &[], None);
    let [prediction] = broken[..] else { panic!("{broken:?}") };
    assert_eq!(
        (prediction.robot, prediction.cause),
        (2, BreakCause::DesiredPositionChanged { lost_in_neighbor: 1 })
    );
    assert!((prediction.slot_distance_m.unwrap() - 0.05).abs() < 1e-9, "{prediction:?}");
}

#[test]
fn dead_body_blocks_a_still_formation_and_not_a_moving_one() {
    // 3, at the mean of 0, 1 and 2, moves without 2 to the mean of 0 and 1, where 4 is.
    let none = [0.0, 0.0];
    let edges = [
        (0, 1, [2.0, 0.0]),
        (0, 2, [1.0, 3.0]),
        (0, 3, none),
        (1, 3, none),
        (2, 3, none),
        (0, 4, [1.0, 0.0]),
    ];
    let roles = [LEADER_ROLE, FORMATION_ROLE, FORMATION_ROLE, CONTAINED_ROLE, FORMATION_ROLE];
    let causes = |lead| predicted_causes(&formation_scenario(&roles, &edges, lead), &[2, 4], &[]);
    assert_eq!(causes(standing_leader()), [(3, BreakCause::SlotOccupied { occupant: 4 })]);
    assert_eq!(
        causes(moving_leader()),
        [(3, BreakCause::DesiredPositionChanged { lost_in_neighbor: 2 })]
    );
}

#[test]
fn equal_causes_of_several_robots_are_one_line() {
    let why = |i: usize| ["a", "b", "a"][i].to_owned();
    let broken = ["r1", "r2", "r3"].into_iter().enumerate().map(|(i, robot)| (robot, why(i)));
    assert_eq!(lines_by_cause(broken), ["r1, r3: a", "r2: b"]);
}

/// Returns a random formation of up to eight robots, drawn from `seed`: roles, edges, policy and backup neighbors. Most
/// offsets are consistent.
fn draw_formation(seed: u64) -> Scenario {
    let mut drawn = 0;
    let mut below = |bound: usize| {
        drawn += 1;
        (formation::random::draw_unit_by_number(seed, drawn) * bound as f64) as usize
    };
    let n = 2 + below(7);
    let has_leader = below(3) > 0;
    let contained = if below(3) == 0 { 3 } else { 0 };
    let role = |i: usize, draw: usize| match i {
        0 if has_leader => LEADER_ROLE,
        _ if draw < contained => CONTAINED_ROLE,
        _ => FORMATION_ROLE,
    };
    let roles: Vec<Role> = (0..n).map(|i| role(i, below(10))).collect();
    let (density, draws_errors) = (1 + below(9), below(2));
    let slot = |i: usize| [2.0 * (i % 3) as f64, 2.0 * (i / 3) as f64];
    let (mut edges, mut spares) = (Vec::new(), Vec::new());
    for from in 0..n {
        for to in (0..n).filter(|&to| to != from && !(has_leader && to == 0)) {
            let ([x, y], [from_x, from_y]) = (slot(to), slot(from));
            let error_m = if draws_errors > 0 && below(8) == 0 { 0.5 } else { 0.0 };
            let edge = match roles[to].reference {
                Reference::NeighborMean => (from, to, [0.0, 0.0]),
                _ => (from, to, [x - from_x + error_m, y - from_y]),
            };
            if below(10) < density {
                edges.push(edge);
            } else if below(10) == 0 {
                spares.push(Edge { from, to, offset_m: edge.2.into() });
            }
        }
    }
    let lead = if below(2) == 0 { moving_leader() } else { standing_leader() };
    let mut scenario = formation_scenario(&roles, &edges, lead.filter(|_| has_leader));
    scenario.silence.policy =
        [SilencePolicy::Last, SilencePolicy::Ignore, SilencePolicy::Keep, SilencePolicy::Stop]
            [below(4)];
    scenario.repair_plan.spares = spares;
    scenario
}

#[test]
fn single_cuts_are_predicted_as_one_by_one() {
    let (mut skipped, mut all) = (0, 0);
    for seed in 0..400 {
        let scenario = draw_formation(seed);
        let predictor = FailurePredictor::new(&scenario);
        let cut_predictor = predictor.single_cut_predictor();
        for edge in 0..scenario.graph.edges().len() {
            let expected = predictor.broken_robots(&[], &[edge], None);
            assert_eq!(
                cut_predictor.broken_by_cut(edge),
                expected,
                "seed {seed}, edge {edge}: {scenario:?}"
            );
            (skipped, all) =
                (skipped + usize::from(cut_predictor.cut_breaks_no_robot(edge)), all + 1);
        }
    }
    assert!(skipped > all / 10 && skipped < all, "{skipped} of {all} without a whole prediction");
}

#[test]
fn deputy_behind_a_stopped_robot_does_not_lead() {
    // 1 receives from the leader 0 and from 3. Without 3 it stops, and still relays the leader's frame to its
    // out-neighbor 2.
    let edges =
        [(0, 1, [-1.0, 0.0]), (0, 3, [-1.0, 1.0]), (3, 1, [0.0, -1.0]), (1, 2, [-1.0, 0.0])];
    let mut scenario = formation_scenario(
        &[LEADER_ROLE, FORMATION_ROLE, FORMATION_ROLE, FORMATION_ROLE],
        &edges,
        moving_leader(),
    );
    scenario.silence.policy = SilencePolicy::Stop;
    scenario.repair_plan.deputies = vec![2];
    assert_eq!(scenario.rewiring().leading_robots(Some(0), &[2], &[3], &[]), [0]);
    let expected = [
        (1, BreakCause::NoInNeighbor { lost_in_neighbor: 3 }),
        (2, BreakCause::LeaderUnreachable { leader: 0 }),
    ];
    assert_eq!(predicted_causes(&scenario, &[3], &[]), expected);
}
