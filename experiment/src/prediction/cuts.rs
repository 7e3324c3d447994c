//! Single failures of edges that break no robot, found without a prediction of the whole formation for each edge.

use formation::Vec2;

use super::surviving_graph::{SurvivingGraph, SurvivingNeighbors};
use super::{Broken, Predictor};

/// Predictor of the effect of each single cut. In a dense graph most cuts change neither reachability nor slots, which
/// follows from two rows of the graph.
#[derive(Debug)]
pub struct SingleCuts<'p> {
    predictor: &'p Predictor,
    /// Sender and receiver of each edge.
    ends: Vec<[usize; 2]>,
    /// The formation without a fault; `None` if a robot is off its planned slot, or if there are backup leaders.
    intact: Option<SurvivingGraph>,
}

impl<'p> SingleCuts<'p> {
    pub(super) fn new(predictor: &'p Predictor) -> SingleCuts<'p> {
        let edges = predictor.rewiring.edges().iter();
        let ends = edges.map(|edge| [edge.from, edge.to]).collect();
        let rests =
            predictor.deputies.is_empty() && predictor.broken_robots(&[], &[], None).is_empty();
        let moving = predictor.course.as_ref().is_some_and(|course| course.is_moving(None));
        let intact = rests.then(|| SurvivingGraph::compute(predictor, &[], &[], moving));
        let intact = intact.filter(|whole| {
            let in_place = |heard: &Vec<(usize, Vec2)>, i| {
                heard.is_empty() || predictor.recovers_slot(heard, i)
            };
            let mut rows = whole.heard.iter().enumerate();
            rows.all(|(i, heard)| in_place(heard, i))
                && whole.left_behind(predictor).iter().all(Option::is_none)
        });
        SingleCuts { predictor, ends, intact }
    }

    /// Returns the robots that the permanent cut of this edge alone breaks, as [`Predictor::broken_robots`] does.
    pub fn broken_by_cut(&self, edge: usize) -> Vec<Broken> {
        if self.is_quick(edge) {
            return Vec::new();
        }
        self.predictor.broken_robots(&[], &[edge], None)
    }

    /// Returns whether the cut of this edge certainly breaks no robot.
    pub(super) fn is_quick(&self, edge: usize) -> bool {
        self.intact.as_ref().is_some_and(|intact| self.changes_nothing(intact, edge))
    }

    /// Returns whether reachability and all planned slots stay the same without the edge.
    fn changes_nothing(&self, intact: &SurvivingGraph, edge: usize) -> bool {
        let [from, to] = self.ends[edge];
        if self.predictor.robots[to].reference.is_local() {
            return true;
        }
        let n = self.predictor.robots.len();
        let row = SurvivingNeighbors::compute(self.predictor, to, &[], &[edge]);
        let mut known = vec![false; n];
        intact.heard[to].iter().for_each(|&(other, _)| known[other] = true);
        let mut new = row.heard.iter().filter(|(other, _)| *other < n && !known[*other]);
        row.takes.is_none()
            && !row.heard.is_empty()
            && row.heard.iter().all(|&(other, _)| other < n)
            && self.predictor.recovers_slot(&row.heard, to)
            && new.all(|&(other, _)| intact.downstream(&[to])[other])
            && is_connected(intact, from, to, &row.heard)
    }
}

/// Returns whether `from` reaches `to`, directly or over other robots, if `heard` are the in-neighbors of `to`.
fn is_connected(intact: &SurvivingGraph, from: usize, to: usize, heard: &[(usize, Vec2)]) -> bool {
    let n = intact.heard.len();
    let mut seen = vec![false; n];
    seen[to] = true;
    let mut open = vec![heard];
    while let Some(row) = open.pop() {
        if row.iter().any(|&(other, _)| other == from) {
            return true;
        }
        for &(other, _) in row.iter().filter(|(other, _)| *other < n) {
            if !std::mem::replace(&mut seen[other], true) {
                open.push(&intact.heard[other]);
            }
        }
    }
    false
}
