//! Topology repair: which robots a robot uses as references once some robots or links are lost. An addition to the
//! chapter.
//!
//! [`Receiver`] has the rule for one robot. The agent applies it to the states that it observes. [`Rewiring`] applies
//! it to all robots of a formation after assumed failures, for checks and predictions.

use crate::Vec2;
use crate::graph::{Edge, FormationGraph};

/// Planned replacement of an in-neighbor of a robot without offsets.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct PlannedReplacement {
    /// Robot that loses an in-neighbor.
    pub robot: usize,
    /// The lost in-neighbor.
    pub lost_in_neighbor: usize,
    /// Replacements of the lost in-neighbor. A robot that is listed twice counts twice; an existing in-neighbor counts
    /// for itself and for each entry.
    pub substitutes: Vec<usize>,
}

impl PlannedReplacement {
    /// Returns how often `robot` is listed.
    fn listing_count(&self, robot: usize) -> usize {
        self.substitutes.iter().filter(|&&by| by == robot).count()
    }
}

/// Backup leaders of a secondary leader: robots without offsets that take its slot while it is lost.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Succession {
    /// The secondary leader.
    pub leader: usize,
    /// Backup leaders, in order of preference.
    pub deputies: Vec<usize>,
}

impl Succession {
    /// Returns the rank, from 0, of the deputy that takes the slot once the leader has failed: the first for which
    /// `has_failed` is false, or the number of deputies if there is none.
    fn acting_rank(&self, has_failed: impl Fn(usize) -> bool) -> usize {
        let first_alive = self.deputies.iter().position(|&deputy| !has_failed(deputy));
        first_alive.unwrap_or(self.deputies.len())
    }

    /// Returns the deputy that takes the slot after the robots `dead` have failed, or `None` if there is none or the
    /// leader is alive.
    pub fn acting_deputy(&self, dead: &[usize]) -> Option<usize> {
        let rank = self.acting_rank(|deputy| dead.contains(&deputy));
        self.deputies.get(rank).copied().filter(|_| dead.contains(&self.leader))
    }
}

/// Backup neighbors and backup leaders of a formation.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct RepairPlan {
    /// Links from backup neighbors, grouped by receiver and in order of preference. Robots without offsets use links
    /// with a nonzero offset only to keep the slot of a leader that they replace.
    pub spares: Vec<Edge>,
    /// Planned replacements for the in-neighbors of robots without offsets.
    pub substitutes: Vec<PlannedReplacement>,
    /// Backup leaders of the main leader, in order of preference.
    pub deputies: Vec<usize>,
    /// Backup leaders of the secondary leaders.
    pub successions: Vec<Succession>,
}

/// Purpose of a sender for its receiver.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum SenderPurpose {
    /// Link of the formation graph.
    InNeighbor,
    /// Backup neighbor for any lost in-neighbor without deputies.
    ReplaceAnyLost,
    /// Backup neighbor for those in-neighbors only that it replaces by plan or as a deputy.
    ReplaceByPlan,
    /// Backup neighbor relative to which the receiver keeps the slot of a leader that it replaces.
    KeepLeaderSlot,
}

/// A robot from which another may receive.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Sender {
    /// Index of the robot.
    pub robot: usize,
    /// Its purpose for the receiver.
    pub purpose: SenderPurpose,
}

/// State of a sender, as its receiver observes it.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct SenderState {
    /// `true` after a loss of at least the repair time, until it has been received for the same time.
    pub has_failed: bool,
    /// `true` if a beacon was received and the sender is not lost.
    pub is_received: bool,
}

/// References of a robot: the senders that it uses.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct References {
    /// Number of in-neighbors for which each sender counts. 0: the sender is no reference.
    pub weights: Vec<usize>,
    /// For each sender, `true` if its beacons are received. Always `true` for an in-neighbor.
    pub is_sender_open: Vec<bool>,
    /// Whether the robot keeps the slot of a leader that it replaces.
    pub keeps_leader_slot: bool,
    /// For each succession, the rank from 0 of the first deputy that has not failed. `None`: the leader has not failed.
    acting_deputy_ranks: Vec<Option<usize>>,
}

impl References {
    /// Returns whether a sender is a reference.
    pub fn uses_sender(&self, index: usize) -> bool {
        self.weights[index] > 0
    }
}

/// A lost in-neighbor and a sender that replaces it, as indices in the receiver's list of senders.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Replacement {
    /// Index of the lost in-neighbor.
    pub lost_index: usize,
    /// Index of the sender that counts instead.
    pub substitute_index: usize,
}

/// One robot, with all robots from which it may receive and its plans for their failures.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Receiver {
    robot: usize,
    /// All senders: the in-neighbors, then the backup neighbors in order of preference.
    senders: Vec<Sender>,
    in_neighbor_count: usize,
    substitutes: Vec<PlannedReplacement>,
    successions: Vec<Succession>,
}

impl Receiver {
    /// Creates the receiver `robot`. `spares` are its backup neighbors in order of preference, each with `true` if it
    /// is used only to keep the slot of a leader. `substitutes` are the plans of this robot, and `successions` the ones
    /// of its in-neighbors.
    pub fn new(
        robot: usize,
        in_neighbors: impl IntoIterator<Item = usize>,
        spares: impl IntoIterator<Item = (usize, bool)>,
        substitutes: Vec<PlannedReplacement>,
        successions: Vec<Succession>,
    ) -> Receiver {
        let in_neighbor = |robot| Sender { robot, purpose: SenderPurpose::InNeighbor };
        let mut senders: Vec<Sender> = in_neighbors.into_iter().map(in_neighbor).collect();
        let in_neighbors = senders.len();
        senders.extend(spares.into_iter().map(|(robot, keeps_slot)| {
            let is_planned = substitutes.iter().any(|plan| plan.substitutes.contains(&robot))
                || successions.iter().any(|succession| succession.deputies.contains(&robot));
            let purpose = match (keeps_slot, is_planned) {
                (true, _) => SenderPurpose::KeepLeaderSlot,
                (false, true) => SenderPurpose::ReplaceByPlan,
                (false, false) => SenderPurpose::ReplaceAnyLost,
            };
            Sender { robot, purpose }
        }));
        Receiver { robot, senders, in_neighbor_count: in_neighbors, substitutes, successions }
    }

    /// Returns the in-neighbors, then the backup neighbors in order of preference.
    pub fn senders(&self) -> &[Sender] {
        &self.senders
    }

    /// Returns the number of in-neighbors.
    pub fn in_neighbor_count(&self) -> usize {
        self.in_neighbor_count
    }

    /// Returns the planned replacements of the robot's in-neighbors.
    pub fn substitutes(&self) -> &[PlannedReplacement] {
        &self.substitutes
    }

    /// Returns the successions of the leaders that the robot receives from.
    pub fn successions(&self) -> &[Succession] {
        &self.successions
    }

    /// Returns whether any failure changes the references.
    pub fn has_repair_plan(&self) -> bool {
        self.senders.len() > self.in_neighbor_count
            || !self.substitutes.is_empty()
            || !self.successions.is_empty()
    }

    /// Returns the in-neighbors that `sender` replaces by plan, once for each entry.
    pub fn in_neighbors_replaced_by(&self, sender: usize) -> impl Iterator<Item = usize> {
        let plans = self.substitutes.iter();
        plans.flat_map(move |plan| {
            std::iter::repeat_n(plan.lost_in_neighbor, plan.listing_count(sender))
        })
    }

    /// Returns the references while no sender has failed: the in-neighbors.
    pub fn references_without_failures(&self) -> References {
        let is_in_neighbor = |index| index < self.in_neighbor_count;
        References {
            weights: (0..self.senders.len()).map(|k| usize::from(is_in_neighbor(k))).collect(),
            is_sender_open: (0..self.senders.len()).map(is_in_neighbor).collect(),
            keeps_leader_slot: false,
            acting_deputy_ranks: vec![None; self.successions.len()],
        }
    }

    /// Returns the references once the senders for which `is_lost` is true have been replaced.
    pub fn references(&self, is_lost: impl Fn(usize) -> bool) -> References {
        let mut references = self.references_without_failures();
        let state = |index| {
            let lost = is_lost(index);
            SenderState { has_failed: lost, is_received: !lost }
        };
        self.update_references(state, &mut references);
        references
    }

    /// Updates the references to the states of the senders. An agent, which knows nothing of a closed backup neighbor,
    /// states that it has not failed and is not received.
    ///
    /// A planned backup neighbor is open while an in-neighbor that it replaces has failed. The deputies of a failed
    /// leader are open up to the first deputy alive, which counts for the leader. One of the other backup neighbors is
    /// open for each failed in-neighbor without deputies, and a further one for each open backup neighbor that has
    /// failed, too. A failed in-neighbor remains a reference until a replacement is received. A robot that replaces a
    /// leader itself uses only the senders for this purpose, as soon as it receives from any of these.
    pub fn update_references(
        &self,
        state: impl Fn(usize) -> SenderState,
        references: &mut References,
    ) {
        let in_neighbors = self.in_neighbor_count;
        if !(0..self.senders.len()).any(|index| state(index).has_failed) {
            return self.reset(references);
        }
        let has_failed = |robot: usize| self.any_sender_is(robot, |index| state(index).has_failed);
        let References {
            weights,
            is_sender_open,
            keeps_leader_slot,
            acting_deputy_ranks: acting_ranks,
        } = references;
        for (succession, acting_rank) in self.successions.iter().zip(&mut *acting_ranks) {
            *acting_rank =
                has_failed(succession.leader).then(|| succession.acting_rank(has_failed));
        }
        let replaces_leader = self.leaders_replaced_by(acting_ranks, self.robot).next().is_some();
        let is_for_slot =
            |index: &usize| self.senders[*index].purpose == SenderPurpose::KeepLeaderSlot;
        *keeps_leader_slot = replaces_leader
            && (0..self.senders.len()).filter(is_for_slot).any(|k| state(k).is_received);
        let without_deputies = |&index: &usize| {
            state(index).has_failed && !self.has_deputies(self.senders[index].robot)
        };
        let mut unreplaced_count = (0..in_neighbors).filter(without_deputies).count();
        let mut substitute_count = 0;
        for index in in_neighbors..self.senders.len() {
            let Sender { robot, purpose } = self.senders[index];
            let mut planned_for = self.in_neighbors_replaced_by(robot);
            let is_planned = planned_for.any(has_failed);
            is_sender_open[index] = match purpose {
                SenderPurpose::InNeighbor => true,
                SenderPurpose::ReplaceAnyLost => unreplaced_count > 0,
                SenderPurpose::KeepLeaderSlot => replaces_leader,
                SenderPurpose::ReplaceByPlan => {
                    is_planned || self.must_receive_deputy(acting_ranks, robot)
                }
            };
            let is_any = purpose == SenderPurpose::ReplaceAnyLost && is_sender_open[index];
            unreplaced_count -= usize::from(is_any && !state(index).has_failed);
            let is_received = is_sender_open[index] && state(index).is_received;
            substitute_count += usize::from(is_any && is_received);
            let replaces = is_any
                || is_planned
                || self.leaders_replaced_by(acting_ranks, robot).next().is_some();
            let is_reference = if *keeps_leader_slot {
                purpose == SenderPurpose::KeepLeaderSlot
            } else {
                replaces
            };
            weights[index] = usize::from(is_received && is_reference);
        }
        let is_received = |index: usize| is_sender_open[index] && state(index).is_received;
        let in_neighbors = weights.iter_mut().zip(&self.senders).enumerate().take(in_neighbors);
        for (index, (weight, sender)) in in_neighbors {
            let robot = sender.robot;
            let is_substitute =
                |by: usize| is_received(by) && self.replacement_count(acting_ranks, by, robot) > 0;
            let has_failed = state(index).has_failed;
            let is_replaced_by_plan = has_failed && (0..self.senders.len()).any(is_substitute);
            let is_replaced_by_any = has_failed
                && !is_replaced_by_plan
                && !self.has_deputies(robot)
                && substitute_count > 0;
            substitute_count -= usize::from(is_replaced_by_any);
            *weight =
                usize::from(!(is_replaced_by_plan || is_replaced_by_any || *keeps_leader_slot));
        }
        for index in 0..self.senders.len() {
            if weights[index] > 0 {
                let is_used = |other: usize| weights[other] > 0;
                weights[index] =
                    self.reference_weight(acting_ranks, index, is_used, is_received(index));
            }
        }
    }

    /// Returns the number of in-neighbors for which a sender counts, if it is a reference, from a report of the
    /// references in use and of the senders that are received.
    pub fn reported_weight(
        &self,
        index: usize,
        is_used: impl Fn(usize) -> bool,
        is_received: impl Fn(usize) -> bool,
    ) -> usize {
        let first_received_deputy = |succession: &Succession| {
            succession.deputies.iter().position(|&deputy| self.any_sender_is(deputy, &is_received))
        };
        let acting_ranks: Vec<Option<usize>> =
            self.successions.iter().map(first_received_deputy).collect();
        self.reference_weight(&acting_ranks, index, is_used, is_received(index))
    }

    /// Returns the replacements of lost in-neighbors, in the order of these and then of the plans.
    pub fn replacements(&self, references: &References) -> Vec<Replacement> {
        let References { acting_deputy_ranks: acting_ranks, keeps_leader_slot, .. } = references;
        let uses = |index: &usize| references.uses_sender(*index);
        let is_substitute =
            |&by: &usize| references.weights[by] > usize::from(self.counts_for_itself(by));
        let with = |purpose: SenderPurpose| {
            let all = 0..self.senders.len();
            all.filter(uses).filter(move |&index| self.senders[index].purpose == purpose)
        };
        let mut any_lost = with(SenderPurpose::ReplaceAnyLost);
        let mut replacements = Vec::new();
        for lost in (0..self.in_neighbor_count).filter(|index| !uses(index)) {
            let robot = self.senders[lost].robot;
            let deputy = self
                .successions
                .iter()
                .zip(acting_ranks)
                .find(|(succession, _)| succession.leader == robot);
            let deputy =
                deputy.map(|(succession, rank)| succession.deputies.get((*rank)?).copied());
            let by: Vec<usize> = match deputy {
                Some(by) if *keeps_leader_slot && by == Some(self.robot) => {
                    with(SenderPurpose::KeepLeaderSlot).collect()
                }
                _ if *keeps_leader_slot => Vec::new(),
                Some(by) => by.and_then(|by| self.sender_index(by)).into_iter().collect(),
                None => {
                    let plans =
                        self.substitutes.iter().filter(|plan| plan.lost_in_neighbor == robot);
                    let by = plans.flat_map(|plan| &plan.substitutes);
                    let by: Vec<usize> = by.filter_map(|&by| self.sender_index(by)).collect();
                    let by: Vec<usize> = by.into_iter().filter(is_substitute).collect();
                    if by.is_empty() { any_lost.next().into_iter().collect() } else { by }
                }
            };
            replacements.extend(
                by.into_iter().map(|by| Replacement { lost_index: lost, substitute_index: by }),
            );
        }
        replacements
    }

    /// Sets the references to the in-neighbors.
    fn reset(&self, references: &mut References) {
        references.keeps_leader_slot = false;
        references.acting_deputy_ranks.fill(None);
        for index in 0..self.senders.len() {
            references.is_sender_open[index] = index < self.in_neighbor_count;
            references.weights[index] = usize::from(index < self.in_neighbor_count);
        }
    }

    fn sender_index(&self, robot: usize) -> Option<usize> {
        self.senders.iter().position(|sender| sender.robot == robot)
    }

    /// Returns whether `state` is true for a sender that is `robot`.
    fn any_sender_is(&self, robot: usize, state: impl Fn(usize) -> bool) -> bool {
        self.senders.iter().enumerate().any(|(index, sender)| sender.robot == robot && state(index))
    }

    fn has_deputies(&self, robot: usize) -> bool {
        self.successions.iter().any(|succession| succession.leader == robot)
    }

    /// Returns the failed leaders that `robot` replaces.
    fn leaders_replaced_by(
        &self,
        acting_ranks: &[Option<usize>],
        robot: usize,
    ) -> impl Iterator<Item = usize> {
        let ranked = self.successions.iter().zip(acting_ranks);
        let replaces_leader = move |succession: &Succession, rank: Option<usize>| {
            rank.is_some_and(|rank| succession.deputies.get(rank) == Some(&robot))
        };
        ranked
            .filter(move |(succession, rank)| replaces_leader(succession, **rank))
            .map(|(succession, _)| succession.leader)
    }

    /// Returns whether a deputy has to be received: it replaces a leader, or precedes the deputy that does.
    fn must_receive_deputy(&self, acting_ranks: &[Option<usize>], robot: usize) -> bool {
        self.successions.iter().zip(acting_ranks).any(|(succession, rank)| {
            rank.is_some_and(|rank| {
                succession.deputies.iter().take(rank + 1).any(|&by| by == robot)
            })
        })
    }

    /// Returns how often a sender counts instead of the in-neighbor `lost`, by plan or as a deputy.
    fn replacement_count(
        &self,
        acting_ranks: &[Option<usize>],
        index: usize,
        lost: usize,
    ) -> usize {
        let robot = self.senders[index].robot;
        let planned_count =
            self.in_neighbors_replaced_by(robot).filter(|&robot| robot == lost).count();
        planned_count
            + self.leaders_replaced_by(acting_ranks, robot).filter(|&leader| leader == lost).count()
    }

    /// Returns whether a reference counts for itself, not only for in-neighbors that it replaces.
    fn counts_for_itself(&self, index: usize) -> bool {
        self.senders[index].purpose != SenderPurpose::ReplaceByPlan
    }

    /// Returns the number of in-neighbors for which a reference counts: itself and, if received, the replaced ones.
    fn reference_weight(
        &self,
        acting_ranks: &[Option<usize>],
        index: usize,
        is_used: impl Fn(usize) -> bool,
        is_received: bool,
    ) -> usize {
        let robot = self.senders[index].robot;
        let replaced = self
            .in_neighbors_replaced_by(robot)
            .chain(self.leaders_replaced_by(acting_ranks, robot));
        let is_unused = |lost: &usize| {
            let mut in_neighbors = self.senders[..self.in_neighbor_count].iter();
            in_neighbors.position(|sender| sender.robot == *lost).is_some_and(|lost| !is_used(lost))
        };
        let replaced = if is_received { replaced.filter(is_unused).count() } else { 0 };
        usize::from(self.counts_for_itself(index)) + replaced
    }
}

/// A topology repair in force.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct ActiveRepair {
    /// The receiving robot.
    pub robot: usize,
    /// Robot that replaces the lost one.
    pub substitute: usize,
    /// The lost in-neighbor.
    pub lost_in_neighbor: usize,
    /// Index of the link in [`RepairPlan::spares`]. `None`: an existing in-neighbor with a larger weight.
    pub spare_link: Option<usize>,
}

/// References of all robots of a formation after failures of robots and links.
///
/// Links are counted over the edges of the graph, then over the backup links of the plan.
#[derive(Debug, Clone)]
pub struct Rewiring {
    links: Vec<Edge>,
    graph_edge_count: usize,
    receivers: Vec<Receiver>,
    /// For each receiver, the link to each of its senders.
    incoming_links: Vec<Vec<usize>>,
}

impl Rewiring {
    /// Creates the rewiring of a formation. `has_offsets` is false for robots that keep no slot relative to their
    /// in-neighbors.
    pub fn new(
        graph: &FormationGraph,
        plan: &RepairPlan,
        has_offsets: impl Fn(usize) -> bool,
    ) -> Rewiring {
        let in_graph = graph.edges().len();
        let links: Vec<Edge> = graph.edges().iter().chain(&plan.spares).copied().collect();
        let mut incoming = vec![Vec::new(); graph.robot_count()];
        links.iter().enumerate().for_each(|(link, edge)| incoming[edge.to].push(link));
        let receiver = |robot: usize| {
            let own = || incoming[robot].iter().map(|&link| (link, &links[link]));
            let in_neighbors =
                || own().filter(|(link, _)| *link < in_graph).map(|(_, edge)| edge.from);
            let spares = own().filter(|(link, _)| *link >= in_graph);
            let spares = spares.map(|(_, edge)| {
                (edge.from, !has_offsets(robot) && edge.offset_m != Vec2::zeros())
            });
            let substitutes =
                plan.substitutes.iter().filter(|replacement| replacement.robot == robot);
            let successions = plan.successions.iter().filter(|succession| {
                !has_offsets(robot) && in_neighbors().any(|leader| leader == succession.leader)
            });
            Receiver::new(
                robot,
                in_neighbors(),
                spares,
                substitutes.cloned().collect(),
                successions.cloned().collect(),
            )
        };
        let receivers = (0..graph.robot_count()).map(receiver).collect();
        Rewiring { links, graph_edge_count: in_graph, receivers, incoming_links: incoming }
    }

    /// Returns the rewiring of the same formation without any backup neighbor.
    pub fn without_repair(&self) -> Rewiring {
        let graph = FormationGraph::new(self.receivers.len(), self.edges().to_vec());
        Rewiring::new(&graph, &RepairPlan::default(), |_| true)
    }

    /// Returns the edges of the graph.
    pub fn edges(&self) -> &[Edge] {
        &self.links[..self.graph_edge_count]
    }

    /// Returns the edges of the graph, then the backup links.
    pub fn links(&self) -> &[Edge] {
        &self.links
    }

    /// Returns the plans of a robot.
    pub fn receiver(&self, robot: usize) -> &Receiver {
        &self.receivers[robot]
    }

    /// Returns the links to the senders of a robot, in the order of [`Receiver::senders`].
    pub fn incoming_links(&self, robot: usize) -> &[usize] {
        &self.incoming_links[robot]
    }

    /// Returns the purpose of a link for its receiver.
    pub fn purpose(&self, link: usize) -> SenderPurpose {
        let to = self.links[link].to;
        let index = self.incoming_links[to].iter().position(|&incoming| incoming == link);
        self.receivers[to].senders[index.expect("a link enters its receiver")].purpose
    }

    /// Returns whether a link carries nothing after the robots `dead` have failed and the edges `cut` are down.
    pub fn is_silent(&self, link: usize, dead: &[usize], cut: &[usize]) -> bool {
        dead.contains(&self.links[link].from) || cut.contains(&link)
    }

    /// Returns the references of an alive robot once the robots `dead` and the edges `cut` have been replaced.
    pub fn references(&self, robot: usize, dead: &[usize], cut: &[usize]) -> References {
        let incoming = &self.incoming_links[robot];
        self.receivers[robot].references(|index| self.is_silent(incoming[index], dead, cut))
    }

    /// Returns the repairs in force after these failures: by deputies, by backup neighbors for any in-neighbor, by
    /// plan, and for the slot of a leader, each in the order of the links.
    pub fn active_repairs(&self, dead: &[usize], cut: &[usize]) -> Vec<ActiveRepair> {
        let mut repairs = Vec::new();
        for (robot, references) in self.changed_references(dead, cut) {
            let (receiver, incoming) = (&self.receivers[robot], &self.incoming_links[robot]);
            for Replacement { lost_index: lost, substitute_index: by } in
                receiver.replacements(&references)
            {
                let [lost, by] = [lost, by].map(|index| (incoming[index], receiver.senders[index]));
                let ((lost_link, lost), (link, by)) = (lost, by);
                let order = match by.purpose {
                    SenderPurpose::KeepLeaderSlot => (3, lost_link),
                    SenderPurpose::ReplaceAnyLost => (1, link),
                    _ if receiver.has_deputies(lost.robot) => (0, lost_link),
                    _ => (2, lost_link),
                };
                let (by, lost_in_neighbor, spare) =
                    (by.robot, lost.robot, link.checked_sub(self.graph_edge_count));
                repairs.push((
                    order,
                    ActiveRepair { robot, substitute: by, lost_in_neighbor, spare_link: spare },
                ));
            }
        }
        repairs.sort_by_key(|(order, _)| *order);
        repairs.into_iter().map(|(_, repaired)| repaired).collect()
    }

    /// Returns the links without effect after these failures, in order: backup links that replace no in-neighbor, and
    /// edges into robots that keep the slot of a leader. Other edges that carry nothing because of the failures are not
    /// included.
    pub fn unused_links(&self, dead: &[usize], cut: &[usize]) -> Vec<usize> {
        let mut is_used: Vec<bool> =
            (0..self.links.len()).map(|link| link < self.graph_edge_count).collect();
        for (robot, references) in self.changed_references(dead, cut) {
            for (index, &link) in self.incoming_links[robot].iter().enumerate() {
                is_used[link] &= !references.keeps_leader_slot;
                is_used[link] |= link >= self.graph_edge_count && references.uses_sender(index);
            }
        }
        (0..self.links.len()).filter(|&link| !is_used[link]).collect()
    }

    /// Returns the robots that lead after these failures, in order of rank: the main leader `leader` if it is alive,
    /// and each alive robot of its `deputies` that no leader of a better rank reaches over links in use.
    pub fn leading_robots(
        &self,
        leader: Option<usize>,
        deputies: &[usize],
        dead: &[usize],
        cut: &[usize],
    ) -> Vec<usize> {
        let is_alive = |robot: &usize| !dead.contains(robot);
        let mut leading: Vec<usize> = leader.into_iter().filter(is_alive).collect();
        if deputies.is_empty() {
            return leading;
        }
        let unused = self.unused_links(dead, cut);
        let mut out_neighbors = vec![Vec::new(); self.receivers.len()];
        for (link, edge) in self.links.iter().enumerate() {
            let carries = !self.is_silent(link, dead, cut) && unused.binary_search(&link).is_err();
            if carries && is_alive(&edge.to) {
                out_neighbors[edge.from].push(edge.to);
            }
        }
        let mut reached = vec![false; self.receivers.len()];
        let mut open = leading.clone();
        for &deputy in deputies.iter().filter(|deputy| is_alive(deputy)) {
            while let Some(robot) = open.pop() {
                if !std::mem::replace(&mut reached[robot], true) {
                    open.extend(&out_neighbors[robot]);
                }
            }
            if !reached[deputy] {
                leading.push(deputy);
                open.push(deputy);
            }
        }
        leading
    }

    /// Returns the references of the alive robots that may use others than their in-neighbors.
    fn changed_references(
        &self,
        dead: &[usize],
        cut: &[usize],
    ) -> impl Iterator<Item = (usize, References)> {
        let has_silent_link = |robot: usize| {
            let mut incoming = self.incoming_links[robot].iter();
            incoming.any(|&link| self.is_silent(link, dead, cut))
        };
        let may_change = move |&robot: &usize| {
            !dead.contains(&robot)
                && self.receivers[robot].has_repair_plan()
                && has_silent_link(robot)
        };
        let changed = (0..self.receivers.len()).filter(may_change);
        changed.map(move |robot| (robot, self.references(robot, dead, cut)))
    }
}

#[cfg(test)]
mod tests;
