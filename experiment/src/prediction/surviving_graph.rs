//! Surviving graph after failures: the remaining in-neighbors, the robots that stop, and the robots that the leader
//! reaches.

use formation::Vec2;
use formation::graph::Edge;
use protocol::brief::SilencePolicy;
use protocol::law::Reference;

use super::{BreakCause, BrokenPrediction, FailurePredictor};

/// Surviving formation after failures.
///
/// Positions have two halves: those of the robots, and after them the last known position of each, which the policies
/// `keep` and `last` use.
#[derive(Debug)]
pub(super) struct SurvivingGraph {
    pub(super) is_alive: Vec<bool>,
    /// In-neighbors that each robot uses, with c_ji, m, including backup neighbors. Empty for dead robots and for
    /// robots that stop.
    pub(super) in_neighbors: Vec<Vec<(usize, Vec2)>>,
    /// First lost in-neighbor of each robot.
    pub(super) lost_in_neighbor: Vec<Option<usize>>,
    /// Leader whose slot each robot takes, if it does.
    pub(super) replaced_leader: Vec<Option<usize>>,
    /// Robots that use each robot.
    out_neighbors: Vec<Vec<usize>>,
    /// Robots that lead: the main leader, or backup leaders that no leader of a better rank reaches.
    pub(super) is_leading: Vec<bool>,
    pub(super) is_moving: bool,
}

/// Surviving in-neighbors of one robot.
#[derive(Debug, Default)]
pub(super) struct SurvivingNeighbors {
    pub(super) in_neighbors: Vec<(usize, Vec2)>,
    pub(super) lost_in_neighbor: Option<usize>,
    pub(super) replaced_leader: Option<usize>,
}

impl SurvivingNeighbors {
    /// Returns the in-neighbors that robot `i`, which is alive, uses after the robots `dead` have failed and the edges
    /// `cut_edges` are down.
    pub(super) fn compute(
        p: &FailurePredictor,
        i: usize,
        dead: &[usize],
        cut_edges: &[usize],
    ) -> SurvivingNeighbors {
        let mut neighbors = SurvivingNeighbors::default();
        if p.robots[i].reference.is_local() {
            return neighbors;
        }
        let (n, rewiring) = (p.robots.len(), &p.rewiring);
        let (receiver, incoming) = (rewiring.receiver(i), rewiring.incoming_links(i));
        let sender = |index: usize| {
            let Edge { from, offset_m, .. } = rewiring.links()[incoming[index]];
            (from, offset_m)
        };
        let references = rewiring.references(i, dead, cut_edges);
        let replacements = receiver.replacements(&references);
        let mut stops = false;
        for (index, &link) in incoming.iter().enumerate().take(receiver.in_neighbor_count()) {
            let (from, offset_m) = sender(index);
            if !rewiring.is_silent(link, dead, cut_edges) {
                neighbors.in_neighbors.push((from, offset_m));
                continue;
            }
            neighbors.lost_in_neighbor.get_or_insert(from);
            if references.uses_sender(index) {
                // Lost and not replaced.
                stops = p.robots[i].silence == SilencePolicy::Stop;
                if p.robots[i].silence == SilencePolicy::Keep {
                    neighbors.in_neighbors.push((n + from, offset_m));
                }
            }
            let substitutes =
                replacements.iter().filter(|replacement| replacement.lost_index == index);
            neighbors
                .in_neighbors
                .extend(substitutes.map(|replacement| sender(replacement.substitute_index)));
        }
        match p.robots[i].silence {
            SilencePolicy::Stop if stops => neighbors.in_neighbors.clear(),
            // Without any in-neighbor, the last known positions of all.
            SilencePolicy::Last if neighbors.in_neighbors.is_empty() => {
                let last = |index| {
                    let (from, offset_m) = sender(index);
                    (n + from, offset_m)
                };
                neighbors.in_neighbors = (0..receiver.in_neighbor_count()).map(last).collect();
            }
            _ => {}
        }
        if references.keeps_leader_slot {
            neighbors.replaced_leader =
                replacements.first().map(|replacement| sender(replacement.lost_index).0);
            neighbors.in_neighbors = replacements
                .iter()
                .map(|replacement| sender(replacement.substitute_index))
                .collect();
        }
        neighbors
    }
}

impl SurvivingGraph {
    /// Computes the surviving graph without these robots and edges. `moving`: the formation moves.
    pub(super) fn compute(
        p: &FailurePredictor,
        dead: &[usize],
        cut_edges: &[usize],
        moving: bool,
    ) -> SurvivingGraph {
        let n = p.robots.len();
        let mut surviving = SurvivingGraph {
            is_alive: (0..n).map(|i| !dead.contains(&i)).collect(),
            in_neighbors: vec![Vec::new(); n],
            lost_in_neighbor: vec![None; n],
            replaced_leader: vec![None; n],
            out_neighbors: vec![Vec::new(); n],
            is_leading: vec![false; n],
            is_moving: moving,
        };
        for i in (0..n).filter(|i| !dead.contains(i)) {
            let neighbors = SurvivingNeighbors::compute(p, i, dead, cut_edges);
            (
                surviving.in_neighbors[i],
                surviving.lost_in_neighbor[i],
                surviving.replaced_leader[i],
            ) = (neighbors.in_neighbors, neighbors.lost_in_neighbor, neighbors.replaced_leader);
            for &(from, _) in surviving.in_neighbors[i].iter().filter(|(from, _)| *from < n) {
                surviving.out_neighbors[from].push(i);
            }
        }
        for robot in p.rewiring.leading_robots(p.leader, &p.deputies, dead, cut_edges) {
            // A leader uses no in-neighbors.
            surviving.is_leading[robot] = true;
            surviving.in_neighbors[robot].clear();
            surviving
                .out_neighbors
                .iter_mut()
                .for_each(|receivers| receivers.retain(|&i| i != robot));
        }
        surviving
    }

    /// Returns the positions of the robots and their last known positions.
    pub(super) fn settled_positions(&self, planned: &[Vec2]) -> Vec<Vec2> {
        [planned, planned].concat()
    }

    /// Returns the robots that use one of `sources` directly or indirectly, and these.
    pub(super) fn robots_downstream_of(&self, sources: &[usize]) -> Vec<bool> {
        let mut reached = vec![false; self.in_neighbors.len()];
        let mut open = sources.to_vec();
        while let Some(robot) = open.pop() {
            if !std::mem::replace(&mut reached[robot], true) {
                open.extend(self.out_neighbors[robot].iter().filter(|&&next| !reached[next]));
            }
        }
        reached
    }

    /// Returns the living robots that use others, and the groups among them without in-edges from outside. One robot of
    /// each group is left out, because a fixed point is needed to settle the others.
    pub(super) fn robots_to_settle(&self, p: &FailurePredictor) -> (Vec<usize>, Vec<Vec<usize>>) {
        let n = self.in_neighbors.len();
        let alive_robots = || (0..n).filter(|&i| self.is_alive[i]);
        let uses_last_position = |i: usize| self.in_neighbors[i].iter().any(|&(from, _)| from >= n);
        let is_anchored = |i: &usize| {
            self.in_neighbors[*i].is_empty()
                || uses_last_position(*i)
                || p.robots[*i].reference.is_local()
        };
        let mut reached =
            self.robots_downstream_of(&alive_robots().filter(is_anchored).collect::<Vec<_>>());
        let (mut pinned, mut groups) = (Vec::new(), Vec::new());
        while let Some(first) = alive_robots().find(|&i| !reached[i]) {
            let group = self.closed_group(first);
            let downstream = self.robots_downstream_of(&group);
            reached
                .iter_mut()
                .zip(downstream)
                .for_each(|(reached, downstream)| *reached |= downstream);
            pinned.push(group[0]);
            groups.push(group);
        }
        let to_settle = alive_robots()
            .filter(|&i| !self.in_neighbors[i].is_empty() && !pinned.contains(&i))
            .collect();
        (to_settle, groups)
    }

    /// Returns a group that receives nothing from outside itself and that reaches `robot`, in order. No robot that
    /// receives from none may reach `robot`.
    fn closed_group(&self, mut robot: usize) -> Vec<usize> {
        loop {
            let group = self.robots_upstream_of(robot);
            // A member that `robot` does not reach is reached by fewer: by itself and some of the group.
            let is_downstream = self.robots_downstream_of(&[robot]);
            match group.iter().find(|&&member| !is_downstream[member]) {
                Some(&member) => robot = member,
                None => return group,
            }
        }
    }

    /// Returns the robots that this robot uses directly or indirectly, and the robot itself, in order.
    fn robots_upstream_of(&self, robot: usize) -> Vec<usize> {
        let mut reached = vec![false; self.in_neighbors.len()];
        let mut open = vec![robot];
        while let Some(robot) = open.pop() {
            if !std::mem::replace(&mut reached[robot], true) {
                let senders = self.in_neighbors[robot].iter().map(|&(from, _)| from);
                open.extend(senders.filter(|&from| from < reached.len() && !reached[from]));
            }
        }
        (0..reached.len()).filter(|&i| reached[i]).collect()
    }

    /// Returns the robots that a moving formation leaves behind, and those that they hold back. None in a formation at
    /// rest.
    pub(super) fn robots_left_behind(&self, p: &FailurePredictor) -> Vec<Option<BrokenPrediction>> {
        let n = self.in_neighbors.len();
        let mut causes = vec![None; n];
        let (Some(leader), true) = (p.leader, self.is_moving) else { return causes };
        let is_independent = |i: usize| p.robots[i].reference.is_local() || self.is_leading[i];
        let independent: Vec<usize> =
            (0..n).filter(|&i| self.is_alive[i] && is_independent(i)).collect();
        let is_led = self.robots_downstream_of(&independent);
        let slot_keepers: Vec<usize> = (0..n)
            .filter(|&i| self.is_alive[i] && p.robots[i].reference != Reference::NeighborMean)
            .collect();
        let has_hull = self.robots_downstream_of(&slot_keepers);
        let lost_sender = |i: usize| self.in_neighbors[i].iter().find(|&&(from, _)| from >= n);
        let stays_behind = |&i: &usize| {
            self.is_alive[i] && !is_independent(i) && (!is_led[i] || lost_sender(i).is_some())
        };
        let left_behind: Vec<usize> = (0..n).filter(stays_behind).collect();
        let is_held_back = self.robots_downstream_of(&left_behind);
        for i in (0..n).filter(|&i| self.is_alive[i] && !is_independent(i) && is_held_back[i]) {
            let contained = p.robots[i].reference == Reference::NeighborMean;
            let cause = if self.in_neighbors[i].is_empty()
                && let Some(lost) = self.lost_in_neighbor[i]
            {
                BreakCause::NoInNeighbor { lost_in_neighbor: lost }
            } else if let Some(&(lost, _)) = lost_sender(i)
                && self.in_neighbors[i].iter().all(|&(from, _)| from >= n)
            {
                BreakCause::UsesLastPosition { lost_in_neighbor: lost - n }
            } else if contained && !has_hull[i] {
                BreakCause::Uncontained
            } else if !is_led[i] {
                BreakCause::LeaderUnreachable { leader }
            } else if let Some(&(lost, _)) = lost_sender(i) {
                BreakCause::UsesLastPosition { lost_in_neighbor: lost - n }
            } else {
                let holds_back = |&&(from, _): &&(usize, Vec2)| is_held_back[from];
                let slow_neighbor = self.in_neighbors[i].iter().find(holds_back);
                BreakCause::InNeighborLeftBehind {
                    in_neighbor: slow_neighbor.map_or(leader, |&(slow_neighbor, _)| slow_neighbor),
                }
            };
            causes[i] = Some(BrokenPrediction {
                robot: i,
                cause,
                slot_distance_m: None,
                hull_distance_m: None,
            });
        }
        causes
    }
}
