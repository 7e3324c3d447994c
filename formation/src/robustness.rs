//! How many liars a graph bears: r-robustness and its kin.
//!
//! A set of robots is r-reachable if one of them hears r robots outside of it. A graph is r-robust if of any two
//! disjoint sets one is r-reachable, and (r, s)-robust if of any two either all of one, or s of both together,
//! hear r robots outside of their set. With W-MSR (`resilient`) robots that nobody leads agree despite any F
//! liars if and only if the graph is (F + 1, F + 1)-robust, and despite F liars among those that each robot
//! hears if it is (2F + 1)-robust. (LeBlanc, Zhang, Koutsoukos, Sundaram, IEEE JSAC 2013)
//!
//! With a leader that is trusted it is strong r-robustness around the leader that counts: each set without the
//! leader has a robot that hears the leader or r robots outside of the set. With r = 2F + 1 what the leader
//! says reaches everybody despite F liars among those that each robot hears.
//! (as for broadcasts: Zhang, Sundaram, ACC 2012)

use crate::graph::FormationGraph;

/// (r, s)-robustness is decided for so many robots at most: 2^n sets.
pub const ROBOTS_EXACT_MAX: usize = 14;

/// Who is not reached from the `trusted` if each robot takes part once it hears one of them, or `needed` of it
/// others that take part; `None`: it never does. Empty: the graph is strongly r-robust around them, where r
/// is what all need.
pub fn unreached(
    graph: &FormationGraph,
    trusted: &[bool],
    needed: impl Fn(usize) -> Option<usize>,
) -> Vec<usize> {
    let mut reached = trusted.to_vec();
    let joins = |reached: &[bool], robot: usize| {
        let heard = || graph.heard_by(robot).map(|edge| edge.from);
        let enough = |needed| heard().filter(|&from| reached[from]).count() >= needed;
        needed(robot).is_some_and(|needed| heard().any(|from| trusted[from]) || enough(needed))
    };
    while let Some(robot) =
        (0..graph.robots()).find(|&robot| !reached[robot] && joins(&reached, robot))
    {
        reached[robot] = true;
    }
    (0..graph.robots()).filter(|&robot| !reached[robot]).collect()
}

/// The largest r for which the graph is strongly r-robust around the `trusted`; its number of robots if
/// everybody hears one of them.
pub fn strong_robustness(graph: &FormationGraph, trusted: &[bool]) -> usize {
    let holds = |&r: &usize| unreached(graph, trusted, |_| Some(r)).is_empty();
    (1..=graph.robots()).take_while(holds).last().unwrap_or(0)
}

/// Two disjoint sets of robots.
pub type Sets = [Vec<usize>; 2];

/// For how many s the graph is (r, s)-robust, and the two sets for which it is not more; 0: it is not r-robust.
/// All robots where no two sets say otherwise. Panics for more than [`ROBOTS_EXACT_MAX`] robots.
pub fn s_of(graph: &FormationGraph, r: usize) -> (usize, Option<Sets>) {
    let n = graph.robots();
    assert!(n <= ROBOTS_EXACT_MAX, "{n} robots");
    let mut heard = vec![0u32; n];
    graph.edges().iter().for_each(|edge| heard[edge.to] |= 1 << edge.from);
    let all = (1u32 << n) - 1;
    // How many of a set hear r outside of it; all of them: as many as there can be of two.
    let reaching = |set: u32| {
        let hears = |&robot: &usize| (heard[robot] & !set).count_ones() as usize >= r;
        let of_set = (0..n).filter(|robot| set >> robot & 1 == 1);
        let count = of_set.filter(hears).count();
        if count == set.count_ones() as usize { n } else { count }
    };
    // Of each set the subset that is reached the least.
    let mut least: Vec<(usize, u32)> = vec![(n, 0)];
    for set in 1..=all {
        let subsets = (0..n)
            .filter(|robot| set >> robot & 1 == 1)
            .map(|robot| least[(set & !(1 << robot)) as usize]);
        least.push(subsets.chain([(reaching(set), set)]).min().unwrap_or((n, 0)));
    }
    let pairs = (1..all).map(|set| {
        let (other_reaching, other) = least[(all & !set) as usize];
        (least[set as usize].0 + other_reaching, least[set as usize].1, other)
    });
    match pairs.min() {
        Some((s, a, b)) if s < n && a != 0 && b != 0 => {
            let robots = |set: u32| (0..n).filter(|robot| set >> robot & 1 == 1).collect();
            (s, Some([robots(a), robots(b)]))
        }
        _ => (n, None),
    }
}

/// The largest r for which the graph is r-robust. Panics for more than [`ROBOTS_EXACT_MAX`] robots.
pub fn robustness(graph: &FormationGraph) -> usize {
    (1..=robustness_max(graph)).take_while(|&r| s_of(graph, r).0 > 0).last().unwrap_or(0)
}

/// No larger r is possible: half of the robots, rounded up, and the second smallest number of robots that one
/// hears.
pub fn robustness_max(graph: &FormationGraph) -> usize {
    let mut degrees: Vec<usize> = (0..graph.robots()).map(|i| graph.heard_by(i).count()).collect();
    degrees.sort_unstable();
    graph.robots().div_ceil(2).min(degrees.get(1).copied().unwrap_or(0))
}

/// How many liars in all the graph bears if nobody leads. Panics for more than [`ROBOTS_EXACT_MAX`] robots.
pub fn liars_in_all_max(graph: &FormationGraph) -> usize {
    (1..graph.robots()).take_while(|&liars| s_of(graph, liars + 1).0 > liars).last().unwrap_or(0)
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

    fn complete(n: usize) -> FormationGraph {
        graph(n, (0..n).flat_map(|i| (0..n).filter(move |&j| j != i).map(move |j| (i, j))))
    }

    #[test]
    fn a_complete_graph_is_as_robust_as_can_be() {
        for n in 2..9 {
            let whole = complete(n);
            assert_eq!(
                (robustness(&whole), robustness_max(&whole)),
                (n.div_ceil(2), n.div_ceil(2))
            );
            // More than twice as many honest robots as liars, and one more. (LeBlanc et al. 2013)
            assert_eq!(liars_in_all_max(&whole), (n - 1) / 2, "{n}");
        }
    }

    #[test]
    fn a_ring_that_hears_one_way_is_1_robust_and_bears_nobody() {
        let ring = graph(6, (0..6).map(|i| (i, (i + 1) % 6)));
        assert_eq!((robustness(&ring), liars_in_all_max(&ring)), (1, 0));
        let (s, sets) = s_of(&ring, 2);
        assert_eq!((s, sets.is_some()), (0, true));
        let apart = graph(4, [(0, 1), (1, 0), (2, 3), (3, 2)]);
        assert_eq!(robustness(&apart), 0);
    }

    #[test]
    fn around_a_leader_it_is_the_number_of_paths_that_do_not_meet_hearsay() {
        // 0 is heard by 1 to 3, and each later one hears the three before it.
        let mut edges: Vec<(usize, usize)> = (1..4).map(|i| (0, i)).collect();
        edges.extend((4..9).flat_map(|i| (i - 3..i).map(move |j| (j, i))));
        let trusted: Vec<bool> = (0..9).map(|i| i == 0).collect();
        assert_eq!(strong_robustness(&graph(9, edges.clone()), &trusted), 3);
        edges.retain(|&edge| edge != (5, 6));
        let thin = graph(9, edges);
        assert_eq!(strong_robustness(&thin, &trusted), 2);
        assert_eq!(unreached(&thin, &trusted, |_| Some(3)), [6, 7, 8]);
        assert_eq!(unreached(&thin, &trusted, |i| (i != 4).then_some(2)), [4, 6, 7, 8]);
    }

    proptest! {
        /// Held against the definition, pair by pair.
        #[test]
        fn it_is_the_robustness_of_the_definition(
            n in 2..7usize,
            pairs in proptest::collection::btree_set((0..7usize, 0..7usize), 0..30),
            r in 1..4usize,
        ) {
            let inside = |&(a, b): &(usize, usize)| a < n && b < n && a != b;
            let graph = graph(n, pairs.into_iter().filter(inside));
            let has = |set: usize, i: usize| set >> i & 1 == 1;
            let reaching = |set: usize| {
                let outside = |i| graph.heard_by(i).filter(|edge| !has(set, edge.from)).count();
                (0..n).filter(|&i| has(set, i) && outside(i) >= r).count()
            };
            let size = |set: usize| (0..n).filter(|&i| has(set, i)).count();
            let holds = |s: usize| (1..1 << n).all(|a: usize| (1..1 << n).all(|b: usize| {
                let (in_a, in_b) = (reaching(a), reaching(b));
                a & b != 0 || in_a == size(a) || in_b == size(b) || in_a + in_b >= s
            }));
            let (s, sets) = s_of(&graph, r);
            prop_assert!(holds(s));
            prop_assert_eq!(sets.is_some(), s < n);
            if let Some([a, b]) = sets {
                prop_assert!(!holds(s + 1));
                let set = |robots: &[usize]| robots.iter().map(|i| 1 << i).sum::<usize>();
                let (a, b) = (set(&a), set(&b));
                prop_assert_eq!((a & b, reaching(a) + reaching(b)), (0, s));
            }
            prop_assert!(robustness(&graph) <= robustness_max(&graph));
        }
    }
}
