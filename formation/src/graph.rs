//! The formation graph: who hears whom, and at which offset. (Definition 1)
//!
//! An edge points the way information flows: `from` is heard by `to`.

use std::cell::OnceCell;
use std::collections::VecDeque;

use crate::Vec2;

/// The edge R_from -> R_to: R_to hears R_from and wants to stand at alpha_from + offset.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Edge {
    /// Place of the robot that is heard.
    pub from: usize,
    /// Place of the robot that hears.
    pub to: usize,
    /// c_{from,to} = R_to - R_from, m, in `map`.
    pub offset_m: Vec2,
}

/// Robots by their place in the scenario (from 0), and the edges between them.
#[derive(Debug, Clone, PartialEq)]
pub struct FormationGraph {
    robots: usize,
    edges: Vec<Edge>,
}

/// An edge whose offset disagrees with the path that the other edges already fix.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct OpenCycle {
    /// Place in the list of edges of the edge that closes the cycle.
    pub edge: usize,
    /// By how much the offsets around the cycle miss, m.
    pub gap_m: f64,
    /// Whether information can flow all the way round it.
    pub directed: bool,
}

impl FormationGraph {
    /// A graph on `robots` robots. Panics if an edge names a robot that does not exist.
    pub fn new(robots: usize, edges: Vec<Edge>) -> FormationGraph {
        assert!(edges.iter().all(|e| e.from < robots && e.to < robots), "edge out of range");
        FormationGraph { robots, edges }
    }

    /// How many robots there are.
    pub fn robots(&self) -> usize {
        self.robots
    }

    /// All edges, in the order given.
    pub fn edges(&self) -> &[Edge] {
        &self.edges
    }

    /// The edges that end in `robot`: its neighbourhood N_i with offsets.
    pub fn heard_by(&self, robot: usize) -> impl Iterator<Item = &Edge> {
        self.edges.iter().filter(move |e| e.to == robot)
    }

    /// The edges that leave `robot`.
    pub fn hearers_of(&self, robot: usize) -> impl Iterator<Item = &Edge> {
        self.edges.iter().filter(move |e| e.from == robot)
    }

    /// For each robot, which robots its information reaches, itself included.
    pub fn reachability(&self) -> Vec<Vec<bool>> {
        let reached = |row: Vec<Option<usize>>| row.iter().map(Option::is_some).collect();
        self.hops().into_iter().map(reached).collect()
    }

    /// For each robot, over how many edges its information reaches each robot, at least; itself over none.
    /// `None` for a robot that it does not reach.
    pub fn hops(&self) -> Vec<Vec<Option<usize>>> {
        let mut hearers = vec![Vec::new(); self.robots];
        for edge in &self.edges {
            hearers[edge.from].push(edge.to);
        }
        let from = |source: usize| {
            let mut hops = vec![None; self.robots];
            hops[source] = Some(0);
            let mut open = VecDeque::from([source]);
            while let Some(robot) = open.pop_front() {
                for &hearer in &hearers[robot] {
                    if hops[hearer].is_none() {
                        hops[hearer] = hops[robot].map(|hop| hop + 1);
                        open.push_back(hearer);
                    }
                }
            }
            hops
        };
        (0..self.robots).map(from).collect()
    }

    /// Robots from which information reaches every other robot. Empty: the formation falls apart
    /// into groups that never agree on where it stands.
    pub fn roots(&self) -> Vec<usize> {
        let reached = self.reachability();
        (0..self.robots).filter(|&r| reached[r].iter().all(|&yes| yes)).collect()
    }

    /// Positions that meet as many offsets as possible (the first robot of each connected part at
    /// the origin), m, and the edges that miss by more than `tolerance_m`.
    pub fn shape(&self, tolerance_m: f64) -> (Vec<Vec2>, Vec<OpenCycle>) {
        let mut place: Vec<Option<Vec2>> = vec![None; self.robots];
        for first in 0..self.robots {
            if place[first].is_some() {
                continue;
            }
            place[first] = Some(Vec2::zeros());
            let mut open = vec![first];
            while let Some(robot) = open.pop() {
                let here = place[robot].expect("an open robot has a place");
                for edge in &self.edges {
                    let (other, there) = match (edge.from == robot, edge.to == robot) {
                        (true, _) => (edge.to, here + edge.offset_m),
                        (_, true) => (edge.from, here - edge.offset_m),
                        _ => continue,
                    };
                    if place[other].is_none() {
                        place[other] = Some(there);
                        open.push(other);
                    }
                }
            }
        }
        let place: Vec<Vec2> =
            place.into_iter().map(|p| p.expect("every robot is placed")).collect();
        let mut open_cycles = Vec::new();
        let reached = OnceCell::new();
        for (index, edge) in self.edges.iter().enumerate() {
            let gap_m = (place[edge.from] + edge.offset_m - place[edge.to]).norm();
            if gap_m > tolerance_m {
                let reached = reached.get_or_init(|| self.reachability());
                let directed = reached[edge.to][edge.from];
                open_cycles.push(OpenCycle { edge: index, gap_m, directed });
            }
        }
        (place, open_cycles)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        /// Offsets that are taken from places close every cycle, and give the places back, up to
        /// where each connected part stands. One that is off by more than the tolerance opens the
        /// cycles that it is part of.
        #[test]
        fn the_shape_is_that_which_the_offsets_were_taken_from(
            places in proptest::collection::vec((-4..5i32, -4..5i32), 1..8),
            pairs in proptest::collection::btree_set((0..8usize, 0..8usize), 0..20),
            off in any::<proptest::sample::Index>(),
        ) {
            let n = places.len();
            let places: Vec<Vec2> =
                places.iter().map(|&(x, y)| 0.5 * Vec2::new(f64::from(x), f64::from(y))).collect();
            let mut edges: Vec<Edge> = Vec::new();
            for (from, to) in pairs.into_iter().map(|(from, to)| (from % n, to % n)) {
                let offset_m = places[to] - places[from];
                if from != to && edges.iter().all(|edge| (edge.from, edge.to) != (from, to)) {
                    edges.push(Edge { from, to, offset_m });
                }
            }
            let graph = FormationGraph::new(n, edges.clone());
            let (found, open) = graph.shape(0.0);
            prop_assert!(open.is_empty());
            for edge in &edges {
                prop_assert_eq!(found[edge.to] - found[edge.from], edge.offset_m);
            }
            // The first robot of each part stands at the origin.
            let joined = FormationGraph::new(n, edges.iter().flat_map(|&edge| {
                let Edge { from, to, offset_m } = edge;
                [edge, Edge { from: to, to: from, offset_m: -offset_m }]
            }).collect()).reachability();
            for part in &joined {
                let first = part.iter().position(|&yes| yes).unwrap();
                prop_assert_eq!(found[first], Vec2::zeros());
            }

            if edges.is_empty() {
                return Ok(());
            }
            let wrong = off.index(edges.len());
            edges[wrong].offset_m += Vec2::new(0.0, 0.25);
            let graph = FormationGraph::new(n, edges.clone());
            prop_assert!(graph.shape(0.25).1.is_empty(), "no more than the tolerance");
            let (found, open) = graph.shape(0.2);
            let reached = graph.reachability();
            for (index, edge) in edges.iter().enumerate() {
                let gap_m = (found[edge.from] + edge.offset_m - found[edge.to]).norm();
                let listed = open.iter().find(|cycle| cycle.edge == index);
                prop_assert_eq!(listed.is_some(), gap_m > 0.2);
                let directed = reached[edge.to][edge.from];
                prop_assert!(listed.is_none_or(|o| o.gap_m == gap_m && o.directed == directed));
            }
            // It opens exactly the cycles that it is part of: if its ends hang together without it.
            let without = edges.iter().enumerate().filter(|(index, _)| *index != wrong);
            let without = without.flat_map(|(_, &edge)| {
                [edge, Edge { from: edge.to, to: edge.from, ..edge }]
            });
            let joined = FormationGraph::new(n, without.collect()).reachability();
            prop_assert_eq!(open.is_empty(), !joined[edges[wrong].from][edges[wrong].to]);
        }
    }

    fn edge(from: usize, to: usize, x: f64, y: f64) -> Edge {
        Edge { from, to, offset_m: Vec2::new(x, y) }
    }

    #[test]
    fn hops_are_counted_along_the_edges_and_the_shortest_way() {
        let graph = FormationGraph::new(
            4,
            vec![edge(0, 1, 1.0, 0.0), edge(1, 2, 1.0, 0.0), edge(0, 2, 2.0, 0.0)],
        );
        let hops = graph.hops();
        assert_eq!(hops[0], [Some(0), Some(1), Some(1), None]);
        assert_eq!(hops[1], [None, Some(0), Some(1), None]);
        assert_eq!(hops[3], [None, None, None, Some(0)]);
    }

    #[test]
    fn two_groups_have_no_root_and_a_chain_has_its_head() {
        let apart = FormationGraph::new(4, vec![edge(0, 1, 1.0, 0.0), edge(2, 3, 1.0, 0.0)]);
        assert!(apart.roots().is_empty());
        let chain = FormationGraph::new(3, vec![edge(0, 1, 1.0, 0.0), edge(1, 2, 1.0, 0.0)]);
        assert_eq!(chain.roots(), vec![0]);
    }

    #[test]
    fn who_is_heard_and_who_hears_are_the_two_ends_of_an_edge() {
        let graph = FormationGraph::new(4, vec![edge(0, 1, 1.0, 0.0), edge(2, 1, 0.0, 1.0)]);
        assert_eq!(graph.robots(), 4);
        let heard = |robot| graph.heard_by(robot).map(|e| e.from).collect::<Vec<_>>();
        let hearers = |robot| graph.hearers_of(robot).map(|e| e.to).collect::<Vec<_>>();
        assert_eq!((heard(1), heard(0)), (vec![0, 2], vec![]));
        assert_eq!((hearers(2), hearers(1)), (vec![1], vec![]));
    }
}
