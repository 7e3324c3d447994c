//! Silence by faults: which robots and edges are silent, and which robots that breaks.

use experiment::prediction::{Broken, Predictor};
use experiment::scenario::{Scenario, Silenced};
use formation::reachability::Reachability;
use formation::seconds;

/// Number of faults that silence each robot and edge, and the edges in use. Edges to backup neighbors follow the
/// edges of the graph.
#[derive(Debug, Clone)]
pub(super) struct SilenceState {
    robots: Vec<i32>,
    edges: Vec<i32>,
    /// Ends of each edge, `[from, to]`.
    ends: Vec<[usize; 2]>,
    /// Number of edges of the graph. Edges with larger indices lead to backup neighbors.
    in_graph: usize,
    in_use: Vec<bool>,
    /// Whether a follower uses the edge to take over a leader's slot.
    keeps_leader_slot: Vec<bool>,
    leader: Option<usize>,
    /// Which deputies lead in place of the leader.
    leads: Vec<bool>,
}

/// A change of the neighbors that a robot uses.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[expect(missing_docs, reason = "the fields are robot indices and flags")]
pub enum Rewiring {
    /// The robot starts or stops using another robot as a reference.
    Uses { robot: usize, other: usize, yes: bool },
    /// A deputy starts or stops leading.
    Leads { robot: usize, yes: bool },
    /// The robot is replaced, and uses its in-neighbors of the graph again.
    Restarted { robot: usize },
}

impl SilenceState {
    /// Creates the state without faults.
    pub(super) fn new(scenario: &Scenario) -> SilenceState {
        let in_graph = scenario.graph.edges().len();
        let edges = scenario.graph.edges().iter().chain(&scenario.spares);
        let keeps_leader_slot = |(place, edge)| place >= in_graph && scenario.is_for_place(edge);
        let keeps_leader_slot = edges.clone().enumerate().map(keeps_leader_slot).collect();
        let ends: Vec<[usize; 2]> = edges.map(|edge| [edge.from, edge.to]).collect();
        SilenceState {
            robots: vec![0; scenario.robots.len()],
            edges: vec![0; ends.len()],
            in_use: (0..ends.len()).map(|edge| edge < in_graph).collect(),
            ends,
            keeps_leader_slot,
            in_graph,
            leader: scenario.leader(),
            leads: vec![false; scenario.robots.len()],
        }
    }

    /// Adds `by` to the number of faults that silence a robot or edge.
    pub(super) fn add_silence(&mut self, silenced: Silenced, by: i32) {
        match silenced {
            Silenced::Nobody => {}
            Silenced::Robot(robot) => self.robots[robot] += by,
            Silenced::Edge(edge) => self.edges[edge] += by,
        }
    }

    /// Applies a change of the neighbors that a robot uses.
    pub(super) fn apply_rewiring(&mut self, rewiring: Rewiring) {
        match rewiring {
            Rewiring::Leads { robot, yes } => self.leads[robot] = yes,
            Rewiring::Restarted { robot } => self.leads[robot] = false,
            Rewiring::Uses { .. } => {}
        }
        for (edge, &[from, to]) in self.ends.iter().enumerate() {
            match rewiring {
                Rewiring::Uses { robot, other, yes } if [from, to] == [other, robot] => {
                    self.in_use[edge] = yes;
                }
                Rewiring::Restarted { robot } if to == robot => {
                    self.in_use[edge] = edge < self.in_graph;
                }
                _ => {}
            }
        }
    }

    /// Returns whether the receiving robot uses this edge and beacons arrive over it.
    pub(super) fn carries_beacons(&self, edge: usize, from: usize) -> bool {
        self.in_use[edge] && self.robots[from] <= 0 && self.edges[edge] <= 0
    }

    /// Returns whether the receiving robot uses this edge, with or without beacons.
    pub(super) fn is_used(&self, edge: usize) -> bool {
        self.in_use[edge]
    }

    /// Returns whether this edge leads to a backup neighbor.
    pub(super) fn is_spare(&self, edge: usize) -> bool {
        edge >= self.in_graph
    }

    /// Returns whether this robot is a deputy that leads.
    pub(super) fn is_acting_deputy(&self, robot: usize) -> bool {
        self.leads[robot]
    }

    /// Returns whether this robot is a follower that takes over a leader's slot.
    pub(super) fn takes_place(&self, robot: usize) -> bool {
        let by = |edge: usize| self.keeps_leader_slot[edge] && self.in_use[edge];
        (0..self.ends.len()).any(|edge| self.ends[edge][1] == robot && by(edge))
    }

    /// Returns whether a fault silences this robot.
    pub(super) fn is_silent(&self, robot: usize) -> bool {
        self.robots[robot] > 0
    }

    /// Returns the robots that are not silent and that no living leader reaches.
    pub(super) fn orphaned(&self, reachability: &Reachability) -> Vec<usize> {
        let silent = (0..self.ends.len()).filter(|&e| self.edges[e] > 0 || !self.in_use[e]);
        let leaders = (0..self.leads.len()).filter(|&i| self.leads[i] || self.leader == Some(i));
        let (dead, silent): (_, Vec<usize>) = (silenced_indices(&self.robots), silent.collect());
        let loss = reachability.loss_with_leaders(&leaders.collect::<Vec<_>>(), &dead, &silent);
        [loss.unled, loss.uncontained, loss.adrift].concat()
    }

    /// Predicts which robots are broken if the current silence lasts from `t_ns` on.
    pub(super) fn predict_broken(&self, predictor: &Predictor, t_ns: u64) -> Vec<Broken> {
        predictor.broken_robots(
            &silenced_indices(&self.robots),
            &silenced_indices(&self.edges),
            Some(seconds(t_ns)),
        )
    }
}

/// Returns the indices with at least one fault.
fn silenced_indices(counts: &[i32]) -> Vec<usize> {
    (0..counts.len()).filter(|&place| counts[place] > 0).collect()
}
