//! Robustness of a graph against Byzantine robots: r-robustness, (r, s)-robustness and strong r-robustness.
//!
//! A set of robots is r-reachable if one of its robots has at least r in-neighbors outside of the set. A graph
//! is r-robust if of any two disjoint nonempty sets at least one is r-reachable. It is (r, s)-robust if for any
//! two such sets either all robots of one, or at least s robots of both together, have r in-neighbors outside
//! of their set. With W-MSR (`resilient`), leaderless robots reach agreement despite any F Byzantine robots
//! (F-total) if and only if the graph is (F + 1, F + 1)-robust, and despite F Byzantine in-neighbors of each
//! robot (F-local) if it is (2F + 1)-robust. (LeBlanc, Zhang, Koutsoukos, Sundaram, IEEE JSAC 2013)
//!
//! With a trusted leader the relevant property is strong r-robustness around the leader: each nonempty set
//! without the leader has a robot with the leader or r robots outside of the set as in-neighbors. With r = 2F +
//! 1 the leader's values reach every robot despite F Byzantine in-neighbors of each. (as for broadcasts: Zhang,
//! Sundaram, ACC 2012)

use crate::graph::FormationGraph;

/// Maximum number of robots for which (r, s)-robustness is computed, because all 2^n sets are examined.
pub const EXACT_ROBUSTNESS_ROBOTS_MAX: usize = 14;

/// Returns the robots that bootstrap percolation from `trusted` does not activate. A robot becomes active if it
/// has a trusted in-neighbor or at least `needed(robot)` active in-neighbors. `None` means never. If the
/// threshold is r for all robots and the result is empty, the graph is strongly r-robust around `trusted`.
pub fn bootstrap_percolation_failures(
    graph: &FormationGraph,
    trusted: &[bool],
    threshold: impl Fn(usize) -> Option<usize>,
) -> Vec<usize> {
    let mut reached = trusted.to_vec();
    let becomes_active = |reached: &[bool], robot: usize| {
        let in_neighbors = || graph.incoming_edges(robot).map(|edge| edge.from);
        let has_enough =
            |threshold| in_neighbors().filter(|&from| reached[from]).count() >= threshold;
        threshold(robot).is_some_and(|threshold| {
            in_neighbors().any(|from| trusted[from]) || has_enough(threshold)
        })
    };
    while let Some(robot) =
        (0..graph.robot_count()).find(|&robot| !reached[robot] && becomes_active(&reached, robot))
    {
        reached[robot] = true;
    }
    (0..graph.robot_count()).filter(|&robot| !reached[robot]).collect()
}

/// Returns the largest r for which the graph is strongly r-robust around `trusted`. It is the number of robots
/// if every robot has a trusted in-neighbor.
pub fn strong_robustness(graph: &FormationGraph, trusted: &[bool]) -> usize {
    let holds = |&r: &usize| bootstrap_percolation_failures(graph, trusted, |_| Some(r)).is_empty();
    (1..=graph.robot_count()).take_while(holds).last().unwrap_or(0)
}

/// Two disjoint sets of robots.
pub type DisjointRobotSets = [Vec<usize>; 2];

/// Returns the largest s for which the graph is (r, s)-robust, and two sets that prove it is not more. It is 0
/// if the graph is not r-robust, and the number of robots, without sets, if no two sets limit it. Panics for
/// more than [`EXACT_ROBUSTNESS_ROBOTS_MAX`] robots.
pub fn max_s_for_r(graph: &FormationGraph, r: usize) -> (usize, Option<DisjointRobotSets>) {
    let n = graph.robot_count();
    assert!(n <= EXACT_ROBUSTNESS_ROBOTS_MAX, "{n} robots");
    let mut in_neighbors = vec![0u32; n];
    graph.edges().iter().for_each(|edge| in_neighbors[edge.to] |= 1 << edge.from);
    let all = (1u32 << n) - 1;
    // Number of robots of a set with r in-neighbors outside of it. If all have them, the maximum n, since such
    // a set imposes no limit.
    let reaching = |set: u32| {
        let is_reachable = |&robot: &usize| (in_neighbors[robot] & !set).count_ones() as usize >= r;
        let of_set = (0..n).filter(|robot| set >> robot & 1 == 1);
        let count = of_set.filter(is_reachable).count();
        if count == set.count_ones() as usize { n } else { count }
    };
    // For each set, its subset with the smallest such number.
    let mut minimum_of_subsets: Vec<(usize, u32)> = vec![(n, 0)];
    for set in 1..=all {
        let subsets = (0..n)
            .filter(|robot| set >> robot & 1 == 1)
            .map(|robot| minimum_of_subsets[(set & !(1 << robot)) as usize]);
        minimum_of_subsets.push(subsets.chain([(reaching(set), set)]).min().unwrap_or((n, 0)));
    }
    let pairs = (1..all).map(|set| {
        let (other_reaching, other) = minimum_of_subsets[(all & !set) as usize];
        (
            minimum_of_subsets[set as usize].0 + other_reaching,
            minimum_of_subsets[set as usize].1,
            other,
        )
    });
    match pairs.min() {
        Some((s, a, b)) if s < n && a != 0 && b != 0 => {
            let robots = |set: u32| (0..n).filter(|robot| set >> robot & 1 == 1).collect();
            (s, Some([robots(a), robots(b)]))
        }
        _ => (n, None),
    }
}

/// Returns the largest r for which the graph is r-robust. Panics for more than [`EXACT_ROBUSTNESS_ROBOTS_MAX`] robots.
pub fn robustness(graph: &FormationGraph) -> usize {
    (1..=robustness_upper_bound(graph))
        .take_while(|&r| max_s_for_r(graph, r).0 > 0)
        .last()
        .unwrap_or(0)
}

/// Returns an upper bound on r: the minimum of half the number of robots, rounded up, and the second smallest
/// in-degree.
pub fn robustness_upper_bound(graph: &FormationGraph) -> usize {
    let mut degrees: Vec<usize> =
        (0..graph.robot_count()).map(|i| graph.incoming_edges(i).count()).collect();
    degrees.sort_unstable();
    graph.robot_count().div_ceil(2).min(degrees.get(1).copied().unwrap_or(0))
}

/// Returns the maximum total number of Byzantine robots (F-total) that the leaderless graph tolerates. Panics
/// for more than [`EXACT_ROBUSTNESS_ROBOTS_MAX`] robots.
pub fn liars_total_max(graph: &FormationGraph) -> usize {
    (1..graph.robot_count())
        .take_while(|&byzantine_count| max_s_for_r(graph, byzantine_count + 1).0 > byzantine_count)
        .last()
        .unwrap_or(0)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Vec2;
    use crate::graph::Edge;
    use proptest::prelude::*;

    fn graph(n: usize, edges: impl IntoIterator<Item = (usize, usize)>) -> FormationGraph {
        let edge = |(from, to)| Edge { from, to, offset_m: Vec2::zeros() };
        FormationGraph::new(n, edges.into_iter().map(edge).collect())
    }

    fn complete_graph(n: usize) -> FormationGraph {
        graph(n, (0..n).flat_map(|i| (0..n).filter(move |&j| j != i).map(move |j| (i, j))))
    }

    #[test]
    fn complete_graph_reaches_the_robustness_bound() {
        for n in 2..9 {
            let complete = complete_graph(n);
            assert_eq!(
                (robustness(&complete), robustness_upper_bound(&complete)),
                (n.div_ceil(2), n.div_ceil(2))
            );
            // The honest robots must outnumber the Byzantine ones. (LeBlanc et al. 2013)
            assert_eq!(liars_total_max(&complete), (n - 1) / 2, "{n}");
        }
    }

    #[test]
    fn directed_ring_is_1_robust_and_tolerates_no_liar() {
        let ring = graph(6, (0..6).map(|i| (i, (i + 1) % 6)));
        assert_eq!((robustness(&ring), liars_total_max(&ring)), (1, 0));
        let (s, sets) = max_s_for_r(&ring, 2);
        assert_eq!((s, sets.is_some()), (0, true));
        let disconnected = graph(4, [(0, 1), (1, 0), (2, 3), (3, 2)]);
        assert_eq!(robustness(&disconnected), 0);
    }

    #[test]
    fn strong_robustness_around_a_leader_drops_with_an_edge() {
        // Robot 0 is an in-neighbor of 1 to 3, and each later robot receives from its three predecessors.
        let mut edges: Vec<(usize, usize)> = (1..4).map(|i| (0, i)).collect();
        edges.extend((4..9).flat_map(|i| (i - 3..i).map(move |j| (j, i))));
        let trusted: Vec<bool> = (0..9).map(|i| i == 0).collect();
        assert_eq!(strong_robustness(&graph(9, edges.clone()), &trusted), 3);
        edges.retain(|&edge| edge != (5, 6));
        let thin = graph(9, edges);
        assert_eq!(strong_robustness(&thin, &trusted), 2);
        assert_eq!(bootstrap_percolation_failures(&thin, &trusted, |_| Some(3)), [6, 7, 8]);
        assert_eq!(
            bootstrap_percolation_failures(&thin, &trusted, |i| (i != 4).then_some(2)),
            [4, 6, 7, 8]
        );
    }

    proptest! {
        /// Compares with the definition, for every pair of sets.
        #[test]
        fn robustness_matches_the_definition(
            n in 2..7usize,
            pairs in proptest::collection::btree_set((0..7usize, 0..7usize), 0..30),
            r in 1..4usize,
        ) {
            let inside = |&(a, b): &(usize, usize)| a < n && b < n && a != b;
            let graph = graph(n, pairs.into_iter().filter(inside));
            let has = |set: usize, i: usize| set >> i & 1 == 1;
            let reaching = |set: usize| {
                let outside = |i| graph.incoming_edges(i).filter(|edge| !has(set, edge.from)).count();
                (0..n).filter(|&i| has(set, i) && outside(i) >= r).count()
            };
            let size = |set: usize| (0..n).filter(|&i| has(set, i)).count();
            let holds = |s: usize| (1..1 << n).all(|a: usize| (1..1 << n).all(|b: usize| {
                let (in_a, in_b) = (reaching(a), reaching(b));
                a & b != 0 || in_a == size(a) || in_b == size(b) || in_a + in_b >= s
            }));
            let (s, sets) = max_s_for_r(&graph, r);
            prop_assert!(holds(s));
            prop_assert_eq!(sets.is_some(), s < n);
            if let Some([a, b]) = sets {
                prop_assert!(!holds(s + 1));
                let set = |robots: &[usize]| robots.iter().map(|i| 1 << i).sum::<usize>();
                let (a, b) = (set(&a), set(&b));
                prop_assert_eq!((a & b, reaching(a) + reaching(b)), (0, s));
            }
            prop_assert!(robustness(&graph) <= robustness_upper_bound(&graph));
        }
    }
}
