//! Silence by faults: which robots and edges are silent, and which robots that breaks.

use experiment::prediction::{Broken, Predictor};
use experiment::scenario::{Scenario, Silenced};
use formation::reachability::Reachability;
use formation::rewiring::Purpose;
use formation::seconds;

/// Number of faults that silence each robot and edge, and the edges in use. Edges to backup neighbors follow the
/// edges of the graph.
#[derive(Debug, Clone)]
pub(super) struct SilenceState {
    robots: Vec<i32>,
    edges: Vec<i32>,
    /// Ends of each edge, `[from, to]`.
    ends: Vec<[usize; 2]>,
    purposes: Vec<Purpose>,
    in_use: Vec<bool>,
    leader: Option<usize>,
    /// Which deputies lead in place of the leader.
    leads: Vec<bool>,
}

/// A change of the neighbors that a robot uses.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[expect(missing_docs, reason = "the fields are robot indices and flags")]
pub enum ReferenceChange {
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
        let rewiring = scenario.rewiring();
        let ends: Vec<[usize; 2]> =
            rewiring.links().iter().map(|edge| [edge.from, edge.to]).collect();
        let purposes: Vec<Purpose> = (0..ends.len()).map(|edge| rewiring.purpose(edge)).collect();
        SilenceState {
            robots: vec![0; scenario.robots.len()],
            edges: vec![0; ends.len()],
            in_use: purposes.iter().map(|purpose| *purpose == Purpose::InNeighbor).collect(),
            ends,
            purposes,
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
    pub(super) fn apply_rewiring(&mut self, rewiring: ReferenceChange) {
        match rewiring {
            ReferenceChange::Leads { robot, yes } => self.leads[robot] = yes,
            ReferenceChange::Restarted { robot } => self.leads[robot] = false,
            ReferenceChange::Uses { .. } => {}
        }
        for (edge, &[from, to]) in self.ends.iter().enumerate() {
            match rewiring {
                ReferenceChange::Uses { robot, other, yes } if [from, to] == [other, robot] => {
                    self.in_use[edge] = yes;
                }
                ReferenceChange::Restarted { robot } if to == robot => {
                    self.in_use[edge] = self.purposes[edge] == Purpose::InNeighbor;
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
        self.purposes[edge] != Purpose::InNeighbor
    }

    /// Returns whether this robot is a deputy that leads.
    pub(super) fn is_acting_deputy(&self, robot: usize) -> bool {
        self.leads[robot]
    }

    /// Returns whether this robot is a follower that takes over a leader's slot.
    pub(super) fn takes_place(&self, robot: usize) -> bool {
        let by = |edge: usize| self.purposes[edge] == Purpose::LeaderSlot && self.in_use[edge];
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
