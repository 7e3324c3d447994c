//! The rule of one robot against a second formulation of it, against the steps of an agent, and in a formation.

use proptest::collection::vec;
use proptest::prelude::*;
use proptest::sample::subsequence;

use super::*;

/// The receiving robot of [`receivers`].
const RECEIVING_ROBOT: usize = 0;
/// Robots that keep its leader's slot in [`receivers`].
const LEADER_SLOT_SPARES: [usize; 2] = [8, 9];

/// Returns receivers of the three kinds that a scenario plans: with offsets and backup neighbors for any in-neighbor,
/// and without offsets, with the same or with planned replacements, and with deputies of the in-neighbor 1.
fn receivers() -> impl Strategy<Value = Receiver> {
    let robots = |all: &'static [usize]| subsequence(all, 0..=all.len());
    let plan = || vec(2..=7usize, 0..=3);
    let deputies = Just(vec![RECEIVING_ROBOT, 2, 5, 6]).prop_shuffle().prop_flat_map(|all| {
        let count_max = all.len();
        subsequence(all, 0..=count_max).prop_shuffle()
    });
    let plans = (plan(), plan(), plan());
    (robots(&[2, 3, 4]), robots(&[5, 6, 7]), plans, deputies, 0..3).prop_map(
        |(mut in_neighbors, any, plans, deputies, kind)| {
            in_neighbors.insert(0, 1);
            let successions = match kind == 0 || deputies.is_empty() {
                true => Vec::new(),
                false => vec![Succession { leader: 1, deputies }],
            };
            let is_in_neighbor = |robot: &usize| in_neighbors.contains(robot);
            let lost = in_neighbors.iter().filter(|&&lost| lost != 1 || successions.is_empty());
            let plans = lost.zip([plans.0, plans.1, plans.2]).filter(|_| kind == 2);
            let substitutes = plans.map(|(&lost, mut by)| {
                by.retain(|by| *by != lost && (*by > 4 || is_in_neighbor(by)));
                PlannedReplacement {
                    robot: RECEIVING_ROBOT,
                    lost_in_neighbor: lost,
                    substitutes: by,
                }
            });
            let substitutes: Vec<PlannedReplacement> = substitutes.collect();
            let planned = substitutes.iter().flat_map(|plan| plan.substitutes.iter().copied());
            let mut spares: Vec<usize> = if kind == 2 { planned.collect() } else { any };
            spares.extend(
                successions.iter().flat_map(|succession| succession.deputies.iter().copied()),
            );
            spares.retain(|spare| !is_in_neighbor(spare) && *spare != RECEIVING_ROBOT);
            spares.sort_unstable();
            spares.dedup();
            let spares = spares.into_iter().map(|spare| (spare, false));
            let slot_spares = LEADER_SLOT_SPARES.into_iter().filter(|_| !successions.is_empty());
            let spares: Vec<_> = spares.chain(slot_spares.map(|spare| (spare, true))).collect();
            Receiver::new(RECEIVING_ROBOT, in_neighbors, spares, substitutes, successions)
        },
    )
}

/// Returns receivers and the senders that they have lost.
fn receivers_with_losses() -> impl Strategy<Value = (Receiver, Vec<bool>)> {
    receivers().prop_flat_map(|receiver| {
        let senders = receiver.senders().len();
        (Just(receiver), vec(any::<bool>(), senders))
    })
}

/// Returns the robots that the receiver uses after these losses, once for each in-neighbor for which they count, in
/// order. Each lost in-neighbor is replaced in turn; without a replacement, it stays.
fn used_robots(receiver: &Receiver, lost: &[bool]) -> Vec<usize> {
    let senders = receiver.senders();
    let alive = |purpose: SenderPurpose| {
        let all = senders.iter().zip(lost);
        all.filter(move |(sender, lost)| sender.purpose == purpose && !**lost)
            .map(|(sender, _)| sender.robot)
    };
    let is_alive = |robot: usize| {
        senders.iter().zip(lost).any(|(sender, lost)| sender.robot == robot && !lost)
    };
    let mut any_lost = alive(SenderPurpose::ReplaceAnyLost);
    let mut used = Vec::new();
    for (sender, _) in
        senders.iter().zip(lost).filter(|(sender, _)| sender.purpose == SenderPurpose::InNeighbor)
    {
        let robot = sender.robot;
        let succession =
            receiver.successions().iter().find(|succession| succession.leader == robot);
        let by: Vec<usize> = match succession {
            _ if is_alive(robot) => vec![robot],
            Some(succession) => {
                match succession.deputies.iter().find(|&&by| by == RECEIVING_ROBOT || is_alive(by))
                {
                    Some(&RECEIVING_ROBOT)
                        if alive(SenderPurpose::KeepLeaderSlot).next().is_some() =>
                    {
                        return alive(SenderPurpose::KeepLeaderSlot).collect();
                    }
                    Some(&RECEIVING_ROBOT) | None => Vec::new(),
                    Some(&by) => vec![by],
                }
            }
            None => match any_lost.next() {
                Some(by) => vec![by],
                None => {
                    let plans =
                        receiver.substitutes().iter().filter(|plan| plan.lost_in_neighbor == robot);
                    plans
                        .flat_map(|plan| plan.substitutes.iter().copied())
                        .filter(|&by| is_alive(by))
                        .collect()
                }
            },
        };
        used.extend(if by.is_empty() { vec![robot] } else { by });
    }
    used.sort_unstable();
    used
}

/// Returns the robots that the receiver uses, once for each in-neighbor for which they count, in order.
fn used_robots_by_weight(receiver: &Receiver, references: &References) -> Vec<usize> {
    let all = receiver.senders().iter().zip(&references.weights);
    let mut used: Vec<usize> =
        all.flat_map(|(sender, &weight)| std::iter::repeat_n(sender.robot, weight)).collect();
    used.sort_unstable();
    used
}

proptest! {
    #[test]
    fn references_match_a_second_formulation((receiver, lost) in receivers_with_losses()) {
        let references = receiver.references(|index| lost[index]);
        prop_assert_eq!(
            used_robots_by_weight(&receiver, &references),
            used_robots(&receiver, &lost)
        );
    }

    #[test]
    fn steps_of_an_agent_end_at_the_predicted_references((receiver, lost) in receivers_with_losses()) {
        // An agent observes only the senders that it receives.
        let mut found = receiver.references_without_failures();
        for _ in 0..=2 * lost.len() {
            let received = found.is_sender_open.clone();
            let state = |index: usize| SenderState {
                has_failed: received[index] && lost[index],
                is_received: received[index] && !lost[index],
            };
            receiver.update_references(state, &mut found);
        }
        prop_assert_eq!(found, receiver.references(|index| lost[index]));
    }

    #[test]
    fn references_without_losses_are_the_in_neighbors((receiver, lost) in receivers_with_losses()) {
        let mut references = receiver.references(|index| lost[index]);
        receiver.update_references(|_| SenderState { has_failed: false, is_received: true }, &mut references);
        prop_assert_eq!(&references, &receiver.references_without_failures());
        let in_neighbor = |index: usize| receiver.senders()[index].purpose == SenderPurpose::InNeighbor;
        for index in 0..lost.len() {
            prop_assert_eq!(references.weights[index], usize::from(in_neighbor(index)));
        }
    }

    #[test]
    fn reported_weights_match_the_references((receiver, lost) in receivers_with_losses()) {
        let references = receiver.references(|index| lost[index]);
        let uses = |index| references.uses_sender(index);
        for index in (0..lost.len()).filter(|&index| uses(index)) {
            let is_received = |other: usize| references.is_sender_open[other] && !lost[other];
            let weight = receiver.reported_weight(index, uses, is_received);
            prop_assert_eq!(weight, references.weights[index]);
        }
    }

    #[test]
    fn each_unused_in_neighbor_is_replaced((receiver, lost) in receivers_with_losses()) {
        let references = receiver.references(|index| lost[index]);
        let replacements = receiver.replacements(&references);
        for &Replacement { lost_index, substitute_index } in &replacements {
            prop_assert!(lost[lost_index] && !references.uses_sender(lost_index));
            prop_assert!(!lost[substitute_index] && references.uses_sender(substitute_index));
        }
        for index in 0..lost.len() {
            let is_in_neighbor = receiver.senders()[index].purpose == SenderPurpose::InNeighbor;
            let replaced = replacements.iter().any(|replacement| replacement.lost_index == index);
            let unused = is_in_neighbor && !references.uses_sender(index);
            prop_assert!(references.keeps_leader_slot || replaced == unused);
            let times = replacements.iter().filter(|replacement| replacement.substitute_index == index).count();
            let own = usize::from(is_in_neighbor && references.uses_sender(index));
            prop_assert_eq!(times + own, references.weights[index]);
        }
    }
}

/// Returns the receiver 0 of 1 and 2, where 1 has the only deputy 3, and 4 replaces any in-neighbor.
fn receiver_with_deputy() -> Receiver {
    let successions = vec![Succession { leader: 1, deputies: vec![3] }];
    Receiver::new(RECEIVING_ROBOT, [1, 2], [(4, false), (3, false)], Vec::new(), successions)
}

#[test]
fn backup_neighbor_replaces_no_leader_with_dead_deputies() {
    let lost = |robots: &'static [usize]| {
        let receiver = receiver_with_deputy();
        let references = receiver.references(|k| robots.contains(&receiver.senders()[k].robot));
        used_robots_by_weight(&receiver, &references)
    };
    assert_eq!(lost(&[1]), [2, 3]);
    assert_eq!(lost(&[1, 3]), [1, 2]);
    assert_eq!(lost(&[1, 2, 3]), [1, 4]);
    assert_eq!(lost(&[2]), [1, 4]);
}

#[test]
fn planned_sender_is_open_only_for_its_in_neighbors() {
    let receiver = receiver_with_deputy();
    let open = |robots: &'static [usize]| {
        receiver.references(|k| robots.contains(&receiver.senders()[k].robot)).is_sender_open
    };
    assert_eq!(open(&[]), [true, true, false, false]);
    assert_eq!(open(&[1]), [true, true, false, true]);
    assert_eq!(open(&[2]), [true, true, true, false]);
}

/// Returns a containment: 0 leads 1 and 2, which have slots; 3 receives from 1 and 2, 4 from 1 and 3. Robot 4 takes the
/// slot of 1, relative to 0; 3 then uses 4, and 4 replaces 2 for 3 by plan. 0 is the backup neighbor of 2.
fn containment() -> (FormationGraph, RepairPlan) {
    let edge = |from, to, x_m| Edge { from, to, offset_m: Vec2::new(x_m, 0.0) };
    let edges = [(0, 1, -1.0), (1, 2, -1.0), (1, 3, 0.0), (2, 3, 0.0), (1, 4, 0.0), (3, 4, 0.0)];
    let edges = edges.map(|(from, to, x_m)| edge(from, to, x_m));
    let plan = RepairPlan {
        spares: vec![edge(0, 2, -2.0), edge(4, 3, 0.0), edge(0, 4, -1.0)],
        substitutes: vec![PlannedReplacement {
            robot: 3,
            lost_in_neighbor: 2,
            substitutes: vec![1, 4],
        }],
        deputies: vec![2],
        successions: vec![Succession { leader: 1, deputies: vec![4] }],
    };
    (FormationGraph::new(5, edges.into()), plan)
}

#[test]
fn repairs_and_unused_links_follow_from_the_references() {
    let (graph, plan) = containment();
    let rewiring = Rewiring::new(&graph, &plan, |robot| robot < 3);
    let purposes: Vec<SenderPurpose> = (6..9).map(|link| rewiring.purpose(link)).collect();
    assert_eq!(
        purposes,
        [
            SenderPurpose::ReplaceAnyLost,
            SenderPurpose::ReplaceByPlan,
            SenderPurpose::KeepLeaderSlot
        ]
    );
    let repaired = |robot, by, instead_of, spare| ActiveRepair {
        robot,
        substitute: by,
        lost_in_neighbor: instead_of,
        spare_link: spare,
    };
    assert_eq!(rewiring.active_repairs(&[], &[]), []);
    assert_eq!(rewiring.unused_links(&[], &[]), [6, 7, 8]);
    let of_1 = [repaired(3, 4, 1, Some(1)), repaired(2, 0, 1, Some(0)), repaired(4, 0, 1, Some(2))];
    assert_eq!(rewiring.active_repairs(&[1], &[]), of_1);
    // 4 takes the slot of 1, and uses neither 1 nor 3.
    assert_eq!(rewiring.unused_links(&[1], &[]), [4, 5]);
    let of_2 = [repaired(3, 1, 2, None), repaired(3, 4, 2, Some(1))];
    assert_eq!(rewiring.active_repairs(&[2], &[]), of_2);
    assert_eq!(rewiring.active_repairs(&[], &[3]), of_2);
    assert_eq!(rewiring.active_repairs(&[2, 4], &[]), [repaired(3, 1, 2, None)]);
    assert_eq!(rewiring.unused_links(&[2, 4], &[]), [6, 7, 8]);
}

#[test]
fn slot_of_a_leader_is_not_kept_without_a_sender_for_it() {
    let (graph, plan) = containment();
    let rewiring = Rewiring::new(&graph, &plan, |robot| robot < 3);
    assert!(rewiring.references(4, &[1], &[]).keeps_leader_slot);
    let references = rewiring.references(4, &[0, 1], &[]);
    assert!(!references.keeps_leader_slot);
    assert_eq!(references.weights, [1, 1, 0], "1 stays: no other robot replaces it");
}

#[test]
fn first_deputy_that_no_leader_reaches_leads() {
    let edge = |from, to| Edge { from, to, offset_m: Vec2::new(-1.0, 0.0) };
    // 0 leads 1, 1 leads 2, and 3 receives from 2. 1 and 3 are deputies.
    let graph = FormationGraph::new(4, vec![edge(0, 1), edge(1, 2), edge(2, 3)]);
    let leading = |spares: Vec<Edge>, dead: &[usize], cut: &[usize]| {
        let plan = RepairPlan { spares, ..RepairPlan::default() };
        Rewiring::new(&graph, &plan, |_| true).leading_robots(Some(0), &[1, 3], dead, cut)
    };
    assert_eq!(leading(vec![], &[], &[]), [0]);
    assert_eq!(leading(vec![], &[0], &[]), [1]);
    assert_eq!(leading(vec![], &[2], &[]), [0, 3]);
    assert_eq!(leading(vec![], &[], &[0]), [0, 1]);
    assert_eq!(leading(vec![], &[0, 2], &[]), [1, 3]);
    // The backup neighbor of 3 is used once 2 is dead, and not before.
    assert_eq!(leading(vec![edge(0, 3)], &[2], &[]), [0]);
    assert_eq!(leading(vec![edge(0, 3)], &[1], &[]), [0, 3]);
}
