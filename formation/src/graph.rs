//! The formation graph: which robot receives from which, and at which offset. (Definition 1)
//!
//! An edge points in the direction of information flow: `to` receives from `from`.

use std::cell::OnceCell;
use std::collections::VecDeque;

use crate::Vec2;

/// The directed edge R_from -> R_to: R_to receives from R_from, and its desired position is alpha_from +
/// offset.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Edge {
    /// Index of the sending robot.
    pub from: usize,
    /// Index of the receiving robot.
    pub to: usize,
    /// Desired relative position c_{from,to} = R_to - R_from, m, in `map`.
    pub offset_m: Vec2,
}

/// Formation graph: the number of robots, which are indexed from 0 in scenario order, and the edges between
/// them.
#[derive(Debug, Clone, PartialEq)]
pub struct FormationGraph {
    robot_count: usize,
    edges: Vec<Edge>,
}

/// An edge whose offset is inconsistent with the path that the other edges define.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct InconsistentOffset {
    /// Index of the edge that closes the cycle.
    pub edge: usize,
    /// Closure error: the norm of the sum of the offsets around the cycle, m.
    pub closure_error_m: f64,
    /// `true` if the cycle is directed, so that information can flow around it.
    pub in_directed_cycle: bool,
}

impl FormationGraph {
    /// Creates a graph with `robots` robots. Panics if an edge names a robot that does not exist.
    pub fn new(robots: usize, edges: Vec<Edge>) -> FormationGraph {
        assert!(edges.iter().all(|e| e.from < robots && e.to < robots), "edge out of range");
        FormationGraph { robot_count: robots, edges }
    }

    /// Returns the number of robots.
    pub fn robot_count(&self) -> usize {
        self.robot_count
    }

    /// Returns all edges, in the order given.
    pub fn edges(&self) -> &[Edge] {
        &self.edges
    }

    /// Returns the incoming edges of `robot`: its in-neighborhood N_i with offsets.
    pub fn incoming_edges(&self, robot: usize) -> impl Iterator<Item = &Edge> {
        self.edges.iter().filter(move |e| e.to == robot)
    }

    /// Returns the outgoing edges of `robot`.
    pub fn outgoing_edges(&self, robot: usize) -> impl Iterator<Item = &Edge> {
        self.edges.iter().filter(move |e| e.from == robot)
    }

    /// Returns for each robot whether the information of one of `sources` reaches it. The sources count as reached.
    pub fn robots_reached_from(&self, sources: &[usize]) -> Vec<bool> {
        let out_neighbors = self.out_neighbors();
        let mut reached = vec![false; self.robot_count];
        let mut open = sources.to_vec();
        while let Some(robot) = open.pop() {
            if !std::mem::replace(&mut reached[robot], true) {
                open.extend(
                    out_neighbors[robot].iter().filter(|&&out_neighbor| !reached[out_neighbor]),
                );
            }
        }
        reached
    }

    /// Returns the receivers of each robot.
    fn out_neighbors(&self) -> Vec<Vec<usize>> {
        let mut out_neighbors = vec![Vec::new(); self.robot_count];
        for edge in &self.edges {
            out_neighbors[edge.from].push(edge.to);
        }
        out_neighbors
    }

    /// Returns for each robot the set of robots that its information reaches, itself included.
    pub fn reachability(&self) -> Vec<Vec<bool>> {
        let reached = |row: Vec<Option<usize>>| row.iter().map(Option::is_some).collect();
        self.hop_counts().into_iter().map(reached).collect()
    }

    /// Returns the minimum number of edges from each robot to each robot: 0 to itself, and `None` for an
    /// unreachable robot.
    pub fn hop_counts(&self) -> Vec<Vec<Option<usize>>> {
        let out_neighbors = self.out_neighbors();
        (0..self.robot_count).map(|source| hops_from(source, &out_neighbors)).collect()
    }

    /// Returns the minimum number of edges from `source` to each robot, `None` for an unreachable one: a row of
    /// [`hop_counts`](Self::hop_counts).
    pub fn hop_counts_from(&self, source: usize) -> Vec<Option<usize>> {
        hops_from(source, &self.out_neighbors())
    }

    /// Returns the robots from which every other robot is reachable. If there are none, the formation
    /// decomposes into groups that do not agree on a common position.
    pub fn roots(&self) -> Vec<usize> {
        let reached = self.reachability();
        (0..self.robot_count).filter(|&r| reached[r].iter().all(|&is_reached| is_reached)).collect()
    }

    /// Returns positions that satisfy the offsets of a spanning forest, m, with the first robot of each
    /// connected component at the origin, and the edges whose closure error exceeds `tolerance_m`.
    pub fn positions_from_offsets(&self, tolerance_m: f64) -> (Vec<Vec2>, Vec<InconsistentOffset>) {
        let mut positions: Vec<Option<Vec2>> = vec![None; self.robot_count];
        for first in 0..self.robot_count {
            if positions[first].is_some() {
                continue;
            }
            positions[first] = Some(Vec2::zeros());
            let mut open = vec![first];
            while let Some(robot) = open.pop() {
                let position = positions[robot].expect("an open robot has a place");
                for edge in &self.edges {
                    let (other, other_position) = match (edge.from == robot, edge.to == robot) {
                        (true, _) => (edge.to, position + edge.offset_m),
                        (_, true) => (edge.from, position - edge.offset_m),
                        _ => continue,
                    };
                    if positions[other].is_none() {
                        positions[other] = Some(other_position);
                        open.push(other);
                    }
                }
            }
        }
        let positions: Vec<Vec2> =
            positions.into_iter().map(|p| p.expect("every robot is placed")).collect();
        let mut open_cycles = Vec::new();
        let reached = OnceCell::new();
        for (index, edge) in self.edges.iter().enumerate() {
            let gap_m = (positions[edge.from] + edge.offset_m - positions[edge.to]).norm();
            if gap_m > tolerance_m {
                let reached = reached.get_or_init(|| self.reachability());
                let directed = reached[edge.to][edge.from];
                open_cycles.push(InconsistentOffset {
                    edge: index,
                    closure_error_m: gap_m,
                    in_directed_cycle: directed,
                });
            }
        }
        (positions, open_cycles)
    }
}

/// Searches the graph breadth-first from `source`.
fn hops_from(source: usize, out_neighbors: &[Vec<usize>]) -> Vec<Option<usize>> {
    let mut hops = vec![None; out_neighbors.len()];
    hops[source] = Some(0);
    let mut open = VecDeque::from([source]);
    while let Some(robot) = open.pop_front() {
        for &out_neighbor in &out_neighbors[robot] {
            if hops[out_neighbor].is_none() {
                hops[out_neighbor] = hops[robot].map(|hop| hop + 1);
                open.push_back(out_neighbor);
            }
        }
    }
    hops
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        /// Offsets computed from positions close every cycle and reproduce the positions, up to a translation
        /// of each connected component. An offset changed by more than the tolerance opens the cycles it is
        /// part of.
        #[test]
        fn shape_reproduces_positions_and_finds_open_cycles(
            positions in proptest::collection::vec((-4..5i32, -4..5i32), 1..8),
            pairs in proptest::collection::btree_set((0..8usize, 0..8usize), 0..20),
            changed_edge in any::<proptest::sample::Index>(),
        ) {
            let n = positions.len();
            let positions: Vec<Vec2> =
                positions.iter().map(|&(x, y)| 0.5 * Vec2::new(f64::from(x), f64::from(y))).collect();
            let mut edges: Vec<Edge> = Vec::new();
            for (from, to) in pairs.into_iter().map(|(from, to)| (from % n, to % n)) {
                let offset_m = positions[to] - positions[from];
                if from != to && edges.iter().all(|edge| (edge.from, edge.to) != (from, to)) {
                    edges.push(Edge { from, to, offset_m });
                }
            }
            let graph = FormationGraph::new(n, edges.clone());
            let (found, open) = graph.positions_from_offsets(0.0);
            prop_assert!(open.is_empty());
            for edge in &edges {
                prop_assert_eq!(found[edge.to] - found[edge.from], edge.offset_m);
            }
            // The first robot of each component is at the origin.
            let connected = FormationGraph::new(n, edges.iter().flat_map(|&edge| {
                let Edge { from, to, offset_m } = edge;
                [edge, Edge { from: to, to: from, offset_m: -offset_m }]
            }).collect()).reachability();
            for component in &connected {
                let first = component.iter().position(|&is_connected| is_connected).unwrap();
                prop_assert_eq!(found[first], Vec2::zeros());
            }

            if edges.is_empty() {
                return Ok(());
            }
            let wrong = changed_edge.index(edges.len());
            edges[wrong].offset_m += Vec2::new(0.0, 0.25);
            let graph = FormationGraph::new(n, edges.clone());
            prop_assert!(graph.positions_from_offsets(0.25).1.is_empty(), "no more than the tolerance");
            let (found, open) = graph.positions_from_offsets(0.2);
            let reached = graph.reachability();
            for (source, reached) in reached.iter().enumerate() {
                prop_assert_eq!(&graph.robots_reached_from(&[source]), reached);
            }
            for (index, edge) in edges.iter().enumerate() {
                let gap_m = (found[edge.from] + edge.offset_m - found[edge.to]).norm();
                let listed = open.iter().find(|cycle| cycle.edge == index);
                prop_assert_eq!(listed.is_some(), gap_m > 0.2);
                let directed = reached[edge.to][edge.from];
                prop_assert!(listed.is_none_or(|o| o.closure_error_m == gap_m && o.in_directed_cycle == directed));
            }
            // It opens exactly the cycles it is part of, which exist if its ends are connected without it.
            let without = edges.iter().enumerate().filter(|(index, _)| *index != wrong);
            let without = without.flat_map(|(_, &edge)| {
                [edge, Edge { from: edge.to, to: edge.from, ..edge }]
            });
            let connected = FormationGraph::new(n, without.collect()).reachability();
            prop_assert_eq!(open.is_empty(), !connected[edges[wrong].from][edges[wrong].to]);
        }
    }

    fn edge(from: usize, to: usize, x: f64, y: f64) -> Edge {
        Edge { from, to, offset_m: Vec2::new(x, y) }
    }

    #[test]
    fn hops_count_edges_of_the_shortest_directed_path() {
        let graph = FormationGraph::new(
            4,
            vec![edge(0, 1, 1.0, 0.0), edge(1, 2, 1.0, 0.0), edge(0, 2, 2.0, 0.0)],
        );
        let hops = graph.hop_counts();
        assert_eq!(hops[0], [Some(0), Some(1), Some(1), None]);
        assert_eq!(hops[1], [None, Some(0), Some(1), None]);
        assert_eq!(hops[3], [None, None, None, Some(0)]);
    }

    #[test]
    fn disconnected_graph_has_no_root_and_chain_has_its_head() {
        let disconnected = FormationGraph::new(4, vec![edge(0, 1, 1.0, 0.0), edge(2, 3, 1.0, 0.0)]);
        assert!(disconnected.roots().is_empty());
        let chain = FormationGraph::new(3, vec![edge(0, 1, 1.0, 0.0), edge(1, 2, 1.0, 0.0)]);
        assert_eq!(chain.roots(), vec![0]);
    }

    #[test]
    fn edge_ends_are_in_neighbor_and_out_neighbor() {
        let graph = FormationGraph::new(4, vec![edge(0, 1, 1.0, 0.0), edge(2, 1, 0.0, 1.0)]);
        assert_eq!(graph.robot_count(), 4);
        let in_neighbors = |robot| graph.incoming_edges(robot).map(|e| e.from).collect::<Vec<_>>();
        let out_neighbors = |robot| graph.outgoing_edges(robot).map(|e| e.to).collect::<Vec<_>>();
        assert_eq!((in_neighbors(1), in_neighbors(0)), (vec![0, 2], vec![]));
        assert_eq!((out_neighbors(2), out_neighbors(1)), (vec![1], vec![]));
    }
}
