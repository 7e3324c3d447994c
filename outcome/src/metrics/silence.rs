//! Silence by faults: which robots and edges are silent, and which robots this breaks.

use experiment::prediction::{BrokenPrediction, FailurePredictor};
use experiment::scenario::{Scenario, SilencedSource};
use formation::ns_to_seconds;
use formation::reachability::Reachability;
use formation::rewiring::SenderPurpose;

/// Number of faults that silence each robot and edge, and the edges in use. Edges to backup neighbors follow the
/// edges of the graph.
#[derive(Debug, Clone)]
pub(super) struct SilenceState {
    robot_fault_counts: Vec<i32>,
    edge_fault_counts: Vec<i32>,
    /// Ends of each edge, `[from, to]`.
    edge_ends: Vec<[usize; 2]>,
    /// For each robot, the indices of its incoming edges.
    incoming_edges: Vec<Vec<usize>>,
    purposes: Vec<SenderPurpose>,
    used_edges: Vec<bool>,
    leader: Option<usize>,
    /// Which deputies act as leader instead of the leader.
    acting_deputies: Vec<bool>,
    /// Whether no robot and no edge is silent, and exactly the edges of the graph are in use.
    is_undisturbed: bool,
}

/// A change of the neighbors that a robot uses.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[expect(missing_docs, reason = "the fields are robot indices and flags")]
pub enum ReferenceChange {
    /// The robot starts or stops using another robot as a reference.
    ReferenceUse { robot: usize, neighbor: usize, is_used: bool },
    /// A deputy starts or stops leading.
    DeputyLead { robot: usize, is_leading: bool },
    /// The robot is replaced, and uses its in-neighbors of the graph again.
    Restarted { robot: usize },
}

impl SilenceState {
    /// Creates the state without faults.
    pub(super) fn new(scenario: &Scenario) -> SilenceState {
        let rewiring = scenario.rewiring();
        let edge_ends: Vec<[usize; 2]> =
            rewiring.links().iter().map(|edge| [edge.from, edge.to]).collect();
        let purposes: Vec<SenderPurpose> =
            (0..edge_ends.len()).map(|edge| rewiring.purpose(edge)).collect();
        SilenceState {
            robot_fault_counts: vec![0; scenario.robots.len()],
            edge_fault_counts: vec![0; edge_ends.len()],
            used_edges: purposes
                .iter()
                .map(|purpose| *purpose == SenderPurpose::InNeighbor)
                .collect(),
            edge_ends,
            incoming_edges: (0..scenario.robots.len())
                .map(|robot| rewiring.incoming_links(robot).to_vec())
                .collect(),
            purposes,
            leader: scenario.leader(),
            acting_deputies: vec![false; scenario.robots.len()],
            is_undisturbed: true,
        }
    }

    /// Returns whether every robot receives from exactly its in-neighbors.
    pub(super) fn is_undisturbed(&self) -> bool {
        self.is_undisturbed
    }

    fn update_undisturbed(&mut self) {
        let mut counts = self.robot_fault_counts.iter().chain(&self.edge_fault_counts);
        let mut used = self.used_edges.iter().zip(&self.purposes);
        self.is_undisturbed = counts.all(|count| *count <= 0)
            && used.all(|(used, purpose)| *used == (*purpose == SenderPurpose::InNeighbor));
    }

    /// Adds `delta` to the number of faults that silence a robot or edge.
    pub(super) fn add_silence(&mut self, silenced: SilencedSource, delta: i32) {
        match silenced {
            SilencedSource::NoSource => {}
            SilencedSource::Robot(robot) => self.robot_fault_counts[robot] += delta,
            SilencedSource::Edge(edge) => self.edge_fault_counts[edge] += delta,
        }
        self.update_undisturbed();
    }

    /// Applies a change of the neighbors that a robot uses.
    pub(super) fn apply_rewiring(&mut self, rewiring: ReferenceChange) {
        let mut is_changed = false;
        let mut set_use = |is_used: &mut bool, new_value| {
            is_changed |= std::mem::replace(is_used, new_value) != new_value
        };
        match rewiring {
            ReferenceChange::DeputyLead { robot, is_leading } => {
                self.acting_deputies[robot] = is_leading
            }
            ReferenceChange::Restarted { robot } => {
                self.acting_deputies[robot] = false;
                for &edge in &self.incoming_edges[robot] {
                    let is_used = self.purposes[edge] == SenderPurpose::InNeighbor;
                    set_use(&mut self.used_edges[edge], is_used);
                }
            }
            ReferenceChange::ReferenceUse { robot, neighbor, is_used } => {
                let incoming = self.incoming_edges[robot].iter();
                for &edge in incoming.filter(|&&edge| self.edge_ends[edge][0] == neighbor) {
                    set_use(&mut self.used_edges[edge], is_used);
                }
            }
        }
        if is_changed {
            self.update_undisturbed();
        }
    }

    /// Returns whether the receiving robot uses this edge and beacons arrive over it.
    pub(super) fn carries_beacons(&self, edge: usize, from: usize) -> bool {
        self.used_edges[edge]
            && self.robot_fault_counts[from] <= 0
            && self.edge_fault_counts[edge] <= 0
    }

    /// Returns whether the receiving robot uses this edge, with or without beacons.
    pub(super) fn is_used(&self, edge: usize) -> bool {
        self.used_edges[edge]
    }

    /// Returns whether this edge leads to a backup neighbor.
    pub(super) fn is_spare(&self, edge: usize) -> bool {
        self.purposes[edge] != SenderPurpose::InNeighbor
    }

    /// Returns whether this robot is a deputy that leads.
    pub(super) fn is_acting_deputy(&self, robot: usize) -> bool {
        self.acting_deputies[robot]
    }

    /// Returns whether this robot is a follower that takes over a leader's slot.
    pub(super) fn takes_leader_slot(&self, robot: usize) -> bool {
        let takes_slot = |edge: usize| {
            self.purposes[edge] == SenderPurpose::KeepLeaderSlot && self.used_edges[edge]
        };
        self.incoming_edges[robot].iter().any(|&edge| takes_slot(edge))
    }

    /// Returns whether a fault silences this robot.
    pub(super) fn is_silent(&self, robot: usize) -> bool {
        self.robot_fault_counts[robot] > 0
    }

    /// Returns the robots that are not silent and that no leader that is alive reaches.
    pub(super) fn orphaned_robots(&self, reachability: &Reachability) -> Vec<usize> {
        let silent_edges = (0..self.edge_ends.len())
            .filter(|&e| self.edge_fault_counts[e] > 0 || !self.used_edges[e]);
        let leaders = (0..self.acting_deputies.len())
            .filter(|&i| self.acting_deputies[i] || self.leader == Some(i));
        let (dead, silent_edges): (_, Vec<usize>) =
            (silenced_indices(&self.robot_fault_counts), silent_edges.collect());
        let loss = reachability.new_defects_with_leaders(
            &leaders.collect::<Vec<_>>(),
            &dead,
            &silent_edges,
        );
        [loss.unled, loss.uncontained, loss.adrift].concat()
    }

    /// Predicts which robots are broken if the current silence lasts from `t_ns` on.
    pub(super) fn predict_broken(
        &self,
        predictor: &FailurePredictor,
        t_ns: u64,
    ) -> Vec<BrokenPrediction> {
        predictor.broken_robots(
            &silenced_indices(&self.robot_fault_counts),
            &silenced_indices(&self.edge_fault_counts),
            Some(ns_to_seconds(t_ns)),
        )
    }
}

/// Returns the indices with at least one fault.
fn silenced_indices(counts: &[i32]) -> Vec<usize> {
    (0..counts.len()).filter(|&i| counts[i] > 0).collect()
}
