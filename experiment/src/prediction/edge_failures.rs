//! Single failures of edges that break no robot, found without a prediction of the whole formation for each edge.

use formation::Vec2;

use super::surviving_graph::{SurvivingGraph, SurvivingNeighbors};
use super::{BrokenPrediction, FailurePredictor};

/// Predictor of the effect of each single cut. In a dense graph most cuts change neither reachability nor slots, which
/// follows from two rows of the graph.
#[derive(Debug)]
pub struct SingleCutPredictor<'p> {
    predictor: &'p FailurePredictor,
    /// Sender and receiver of each edge.
    edge_ends: Vec<[usize; 2]>,
    /// The formation without a fault; `None` if a robot is off its planned slot, or if there are backup leaders.
    intact_graph: Option<SurvivingGraph>,
}

impl<'p> SingleCutPredictor<'p> {
    pub(super) fn new(predictor: &'p FailurePredictor) -> SingleCutPredictor<'p> {
        let edges = predictor.rewiring.edges().iter();
        let edge_ends = edges.map(|edge| [edge.from, edge.to]).collect();
        let is_undisturbed =
            predictor.deputies.is_empty() && predictor.broken_robots(&[], &[], None).is_empty();
        let is_moving =
            predictor.leader_motion.as_ref().is_some_and(|motion| motion.is_moving(None));
        let intact =
            is_undisturbed.then(|| SurvivingGraph::compute(predictor, &[], &[], is_moving));
        let intact = intact.filter(|graph| {
            let keeps_slot = |in_neighbors: &Vec<(usize, Vec2)>, i| {
                in_neighbors.is_empty() || predictor.recovers_slot(in_neighbors, i)
            };
            let mut rows = graph.in_neighbors.iter().enumerate();
            rows.all(|(i, in_neighbors)| keeps_slot(in_neighbors, i))
                && graph.robots_left_behind(predictor).iter().all(Option::is_none)
        });
        SingleCutPredictor { predictor, edge_ends, intact_graph: intact }
    }

    /// Returns the robots that the permanent cut of this edge alone breaks, as [`FailurePredictor::broken_robots`]
    /// does.
    pub fn broken_by_cut(&self, edge: usize) -> Vec<BrokenPrediction> {
        if self.cut_breaks_no_robot(edge) {
            return Vec::new();
        }
        self.predictor.broken_robots(&[], &[edge], None)
    }

    /// Returns whether the cut of this edge certainly breaks no robot.
    pub(super) fn cut_breaks_no_robot(&self, edge: usize) -> bool {
        self.intact_graph.as_ref().is_some_and(|intact| self.cut_changes_nothing(intact, edge))
    }

    /// Returns whether reachability and all planned slots stay the same without the edge.
    fn cut_changes_nothing(&self, intact: &SurvivingGraph, edge: usize) -> bool {
        let [from, to] = self.edge_ends[edge];
        if self.predictor.robots[to].reference.is_local() {
            return true;
        }
        let n = self.predictor.robots.len();
        let neighbors = SurvivingNeighbors::compute(self.predictor, to, &[], &[edge]);
        let mut is_known = vec![false; n];
        intact.in_neighbors[to].iter().for_each(|&(other, _)| is_known[other] = true);
        let mut new =
            neighbors.in_neighbors.iter().filter(|(other, _)| *other < n && !is_known[*other]);
        neighbors.replaced_leader.is_none()
            && !neighbors.in_neighbors.is_empty()
            && neighbors.in_neighbors.iter().all(|&(other, _)| other < n)
            && self.predictor.recovers_slot(&neighbors.in_neighbors, to)
            && new.all(|&(other, _)| intact.robots_downstream_of(&[to])[other])
            && is_connected(intact, from, to, &neighbors.in_neighbors)
    }
}

/// Returns whether `from` reaches `to`, directly or over other robots, if `in_neighbors` are the in-neighbors of `to`.
fn is_connected(
    intact: &SurvivingGraph,
    from: usize,
    to: usize,
    in_neighbors: &[(usize, Vec2)],
) -> bool {
    let n = intact.in_neighbors.len();
    let mut is_visited = vec![false; n];
    is_visited[to] = true;
    let mut open = vec![in_neighbors];
    while let Some(row) = open.pop() {
        if row.iter().any(|&(other, _)| other == from) {
            return true;
        }
        for &(other, _) in row.iter().filter(|(other, _)| *other < n) {
            if !std::mem::replace(&mut is_visited[other], true) {
                open.push(&intact.in_neighbors[other]);
            }
        }
    }
    false
}
