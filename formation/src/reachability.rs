//! Whose information reaches whom, and what a death or a cut takes from whom. (Assumptions 3 to 5)
//!
//! Plain places in, plain places out. The dead are left out, as with the silence policy `ignore`;
//! robots that fell silent without dying count as dead.

use crate::graph::FormationGraph;

/// A formation graph with the parts its robots play, and what its edges give them.
#[derive(Debug, Clone)]
pub struct Reachability {
    /// The ends of each edge, `[from, to]`.
    edges: Vec<[usize; 2]>,
    /// For each robot, the edges that leave it.
    leaving: Vec<Vec<usize>>,
    leader: Option<usize>,
    contained: Vec<bool>,
    /// Those that need nobody.
    alone: Vec<bool>,
    intact: Standing,
}

/// Who has what it goes by. Robots by their places, in order.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct Standing {
    /// With a main leader: robots that keep a place and that it does not reach. (Assumptions 3, 5)
    pub unled: Vec<usize>,
    /// With a main leader: robots that keep a place and that it reaches, but an unled robot
    /// reaches too. That one pulls them out of their place.
    pub pulled: Vec<usize>,
    /// Contained robots that no robot reaches that leads or keeps a place. (Assumption 4)
    pub uncontained: Vec<usize>,
    /// With a main leader: contained robots that still have somebody to be contained by, but only
    /// unled ones. Their hull no longer follows the trajectory.
    pub adrift: Vec<usize>,
    /// Without a main leader: groups of robots that keep a place and hear nobody outside, if
    /// there are several. No robot's information reaches them all, so each stands for itself.
    pub groups: Vec<Vec<usize>>,
}

impl Standing {
    /// Whether everybody has what it goes by.
    pub fn is_sound(&self) -> bool {
        let Standing { unled, pulled, uncontained, adrift, groups } = self;
        [unled, pulled, uncontained, adrift].iter().all(|list| list.is_empty()) && groups.is_empty()
    }
}

/// Who is reached, and over which edges first.
struct Spread {
    reached: Vec<bool>,
    over: Vec<usize>,
}

/// What is gone.
struct Gone {
    dead: Vec<bool>,
    cut: Vec<bool>,
}

impl Reachability {
    /// `leader`: the main leader, if there is one. `contained`: those that keep no place; `alone`:
    /// those that need nobody to know theirs. All the others keep one. Panics if one of them does
    /// not exist.
    pub fn new(
        graph: &FormationGraph,
        leader: Option<usize>,
        contained: &[usize],
        alone: &[usize],
    ) -> Reachability {
        let n = graph.robots();
        let mut reachability = Reachability {
            edges: graph.edges().iter().map(|edge| [edge.from, edge.to]).collect(),
            leaving: vec![Vec::new(); n],
            leader,
            contained: vec![false; n],
            alone: vec![false; n],
            intact: Standing::default(),
        };
        for (index, [from, _]) in reachability.edges.iter().enumerate() {
            reachability.leaving[*from].push(index);
        }
        contained.iter().for_each(|&robot| reachability.contained[robot] = true);
        alone.iter().for_each(|&robot| reachability.alone[robot] = true);
        reachability.intact = reachability.standing(&[], &[]);
        reachability
    }

    /// Who lacks what while everybody lives and every edge carries.
    pub fn intact(&self) -> &Standing {
        &self.intact
    }

    /// Who among the living lacks what once the robots `dead` have died and the edges `cut` (by
    /// their places) carry nothing.
    pub fn standing(&self, dead: &[usize], cut: &[usize]) -> Standing {
        let n = self.leaving.len();
        let mut gone = Gone { dead: vec![false; n], cut: vec![false; self.edges.len()] };
        dead.iter().for_each(|&robot| gone.dead[robot] = true);
        cut.iter().for_each(|&edge| gone.cut[edge] = true);

        let living = |&robot: &usize| !gone.dead[robot];
        let places: Vec<usize> = self.places().filter(living).collect();
        let held = self.spread(&places, &gone).reached;
        let contained = || (0..n).filter(living).filter(|&robot| self.contained[robot]);
        let mut standing = Standing {
            uncontained: contained().filter(|&robot| !held[robot]).collect(),
            ..Standing::default()
        };
        let Some(leader) = self.leader else {
            standing.groups = self.groups(&places, &gone);
            return standing;
        };
        let led = self.spread(self.leader.as_slice(), &gone).reached;
        let kept = |robot: &&usize| **robot != leader;
        standing.unled = places.iter().filter(kept).copied().filter(|&r| !led[r]).collect();
        let stray = self.spread(&standing.unled, &gone).reached;
        let pulled = |&robot: &usize| led[robot] && stray[robot];
        standing.pulled = places.iter().filter(kept).copied().filter(pulled).collect();
        standing.adrift = contained().filter(|&robot| held[robot] && !led[robot]).collect();
        standing
    }

    /// Those that lead or keep a place by what they hear.
    fn places(&self) -> impl Iterator<Item = usize> + '_ {
        (0..self.leaving.len()).filter(|&robot| !self.contained[robot] && !self.alone[robot])
    }

    /// What the living lack after these losses and had before. Groups count as lost only where
    /// all were one before.
    pub fn loss(&self, dead: &[usize], cut: &[usize]) -> Standing {
        let Standing { unled, pulled, uncontained, adrift, groups } = self.standing(dead, cut);
        let new = |after: Vec<usize>, before: &[usize]| {
            after.into_iter().filter(|robot| !before.contains(robot)).collect()
        };
        Standing {
            unled: new(unled, &self.intact.unled),
            pulled: new(pulled, &self.intact.pulled),
            uncontained: new(uncontained, &self.intact.uncontained),
            adrift: new(adrift, &self.intact.adrift),
            groups: if self.intact.groups.is_empty() { groups } else { Vec::new() },
        }
    }

    /// The single edges whose cut takes something from somebody, with what it takes.
    pub fn breaking_cuts(&self) -> Vec<(usize, Standing)> {
        // Cutting an edge that no spreading went over first leaves all reached that were.
        let n = self.leaving.len();
        let whole = Gone { dead: vec![false; n], cut: vec![false; self.edges.len()] };
        let places: Vec<usize> = self.places().collect();
        let start = self.leader.or_else(|| self.root(&places, &whole));
        let mut used = self.spread(&places, &whole).over;
        used.extend(self.spread(start.as_slice(), &whole).over);
        used.sort_unstable();
        used.dedup();
        let losses = used.into_iter().map(|edge| (edge, self.loss(&[], &[edge])));
        losses.filter(|(_, loss)| !loss.is_sound()).collect()
    }

    /// Who is reached from any of `sources`, which count as reached; the dead reach nobody.
    fn spread(&self, sources: &[usize], gone: &Gone) -> Spread {
        let mut reached = vec![false; self.leaving.len()];
        let mut over = Vec::new();
        let mut open = Vec::new();
        for &source in sources.iter().filter(|&&source| !gone.dead[source]) {
            reached[source] = true;
            open.push(source);
        }
        while let Some(robot) = open.pop() {
            for &edge in self.leaving[robot].iter().filter(|&&edge| !gone.cut[edge]) {
                let to = self.edges[edge][1];
                if !gone.dead[to] && !std::mem::replace(&mut reached[to], true) {
                    over.push(edge);
                    open.push(to);
                }
            }
        }
        Spread { reached, over }
    }

    /// One of `places` from which all of them are reached, if there is one.
    fn root(&self, places: &[usize], gone: &Gone) -> Option<usize> {
        // Only the last robot not reached from those before it can be one.
        let mut seen = vec![false; self.leaving.len()];
        let mut candidate = None;
        for &robot in places {
            if !seen[robot] {
                candidate = Some(robot);
                let reached = self.spread(&[robot], gone).reached;
                seen.iter_mut().zip(reached).for_each(|(seen, reached)| *seen |= reached);
            }
        }
        let reached = self.spread(candidate.as_slice(), gone).reached;
        candidate.filter(|_| places.iter().all(|&robot| reached[robot]))
    }

    /// The groups among `places` that hear nobody outside themselves, if there are several.
    fn groups(&self, places: &[usize], gone: &Gone) -> Vec<Vec<usize>> {
        if self.root(places, gone).is_some() {
            return Vec::new();
        }
        let reached: Vec<Vec<bool>> =
            places.iter().map(|&robot| self.spread(&[robot], gone).reached).collect();
        let mut groups: Vec<Vec<usize>> = Vec::new();
        for (i, &robot) in places.iter().enumerate() {
            let closed =
                places.iter().zip(&reached).all(|(&s, from_s)| !from_s[robot] || reached[i][s]);
            if closed {
                match groups.iter_mut().find(|group| reached[i][group[0]]) {
                    Some(group) => group.push(robot),
                    None => groups.push(vec![robot]),
                }
            }
        }
        groups
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Vec2;
    use crate::graph::Edge;
    use proptest::prelude::*;

    fn graph(robots: usize, edges: &[[usize; 2]]) -> FormationGraph {
        let edge = |&[from, to]: &[usize; 2]| Edge { from, to, offset_m: Vec2::zeros() };
        FormationGraph::new(robots, edges.iter().map(edge).collect())
    }

    /// Robot 0 leads, all others keep a place.
    fn led(robots: usize, edges: &[[usize; 2]]) -> Reachability {
        Reachability::new(&graph(robots, edges), Some(0), &[], &[])
    }

    fn leaderless(robots: usize, edges: &[[usize; 2]]) -> Reachability {
        Reachability::new(&graph(robots, edges), None, &[], &[])
    }

    fn unled(robots: &[usize]) -> Standing {
        Standing { unled: robots.to_vec(), ..Standing::default() }
    }

    fn groups(groups: &[&[usize]]) -> Standing {
        let groups = groups.iter().map(|group| group.to_vec()).collect();
        Standing { groups, ..Standing::default() }
    }

    /// The losses of each single death, and of each cut that takes something.
    fn assert_losses(
        reachability: &Reachability,
        deaths: &[Standing],
        cuts: &[([usize; 2], Standing)],
    ) {
        for (robot, expected) in deaths.iter().enumerate() {
            assert_eq!(reachability.loss(&[robot], &[]), *expected, "robot {robot} dies");
        }
        let found: Vec<_> = reachability
            .breaking_cuts()
            .into_iter()
            .map(|(edge, loss)| (reachability.edges[edge], loss))
            .collect();
        assert_eq!(found, cuts);
    }

    #[test]
    fn in_a_chain_a_death_takes_the_leader_from_all_behind() {
        let chain = led(4, &[[0, 1], [1, 2], [2, 3]]);
        let deaths = [unled(&[1, 2, 3]), unled(&[2, 3]), unled(&[3]), unled(&[])];
        let cuts = [([0, 1], unled(&[1, 2, 3])), ([1, 2], unled(&[2, 3])), ([2, 3], unled(&[3]))];
        assert_losses(&chain, &deaths, &cuts);
    }

    #[test]
    fn in_a_star_only_the_death_of_its_middle_matters() {
        let star = led(4, &[[0, 1], [0, 2], [0, 3]]);
        let cuts = [1, 2, 3].map(|robot| ([0, robot], unled(&[robot])));
        assert_losses(&star, &[unled(&[1, 2, 3]), unled(&[]), unled(&[]), unled(&[])], &cuts);
    }

    #[test]
    fn in_a_diamond_only_the_leaders_death_matters() {
        let diamond = led(4, &[[0, 1], [0, 2], [1, 2], [2, 1], [1, 3], [2, 3]]);
        let deaths = [unled(&[1, 2, 3]), unled(&[]), unled(&[]), unled(&[])];
        assert_losses(&diamond, &deaths, &[]);
    }

    #[test]
    fn two_trees_that_share_a_robot_both_hang_on_it() {
        // 0 -> 1 -> {2, 3}, 2 -> 4, 3 -> 5
        let trees = led(6, &[[0, 1], [1, 2], [1, 3], [2, 4], [3, 5]]);
        let deaths = [
            unled(&[1, 2, 3, 4, 5]),
            unled(&[2, 3, 4, 5]),
            unled(&[4]),
            unled(&[5]),
            unled(&[]),
            unled(&[]),
        ];
        for (robot, expected) in deaths.iter().enumerate() {
            assert_eq!(trees.loss(&[robot], &[]), *expected);
        }
    }

    #[test]
    fn a_bridge_between_two_redundant_halves_is_the_only_cut_that_matters() {
        // 0 feeds 1 and 2, which hear each other; the edge 2 -> 3 leads to 3, 4 and 5, a ring.
        let edges = [[0, 1], [0, 2], [1, 2], [2, 1], [2, 3], [3, 4], [4, 5], [5, 3]];
        let halves = led(6, &edges);
        let cut = |from, to| {
            let edge = edges.iter().position(|&ends| ends == [from, to]).unwrap();
            halves.loss(&[], &[edge])
        };
        assert_eq!(cut(2, 3), unled(&[3, 4, 5]));
        assert!(cut(0, 1).is_sound() && cut(5, 3).is_sound());
        assert_eq!(halves.loss(&[2], &[]), unled(&[3, 4, 5]));
        assert_eq!(halves.loss(&[1], &[]), unled(&[]));
    }

    #[test]
    fn a_cycle_that_hangs_off_the_leader_pulls_its_entry_when_it_breaks_behind_it() {
        // 0 -> 1 -> 2 -> 3 -> 1
        let cycle = led(4, &[[0, 1], [1, 2], [2, 3], [3, 1]]);
        let pulled = |lost: &[usize], pulled: &[usize]| Standing {
            unled: lost.to_vec(),
            pulled: pulled.to_vec(),
            ..Standing::default()
        };
        // Robot 3 no longer hears anybody, stands still, and robot 1 still hears it.
        let deaths = [unled(&[1, 2, 3]), unled(&[2, 3]), pulled(&[3], &[1]), unled(&[])];
        let cuts = [
            ([0, 1], unled(&[1, 2, 3])),
            ([1, 2], pulled(&[2, 3], &[1])),
            ([2, 3], pulled(&[3], &[1, 2])),
        ];
        assert_losses(&cycle, &deaths, &cuts);
    }

    #[test]
    fn a_robot_without_an_edge_lacks_the_leader_from_the_start_and_no_death_takes_it() {
        let apart = led(3, &[[0, 1]]);
        assert_eq!(*apart.intact(), unled(&[2]));
        assert_losses(&apart, &[unled(&[1]), unled(&[]), unled(&[])], &[([0, 1], unled(&[1]))]);
    }

    #[test]
    fn a_ring_without_a_leader_survives_every_death_and_every_cut() {
        let ring = leaderless(4, &[[0, 1], [1, 2], [2, 3], [3, 0]]);
        assert_losses(&ring, &[groups(&[]), groups(&[]), groups(&[]), groups(&[])], &[]);
    }

    #[test]
    fn without_its_head_a_star_without_a_leader_falls_apart_into_single_robots() {
        let star = leaderless(4, &[[0, 1], [0, 2], [0, 3]]);
        let deaths = [groups(&[&[1], &[2], &[3]]), groups(&[]), groups(&[]), groups(&[])];
        let cuts = [1, 2, 3].map(|robot| ([0, robot], groups(&[&[0], &[robot]])));
        assert_losses(&star, &deaths, &cuts);
    }

    #[test]
    fn two_rings_joined_in_one_robot_fall_apart_when_it_dies() {
        // Both rings pass through robot 0: 0 1 2 and 0 3 4.
        let rings = leaderless(5, &[[0, 1], [1, 2], [2, 0], [0, 3], [3, 4], [4, 0]]);
        assert_eq!(rings.loss(&[0], &[]), groups(&[&[1], &[3]]));
        assert!((1..5).all(|robot| rings.loss(&[robot], &[]).is_sound()));
    }

    #[test]
    fn two_components_without_a_leader_are_two_groups_from_the_start() {
        let apart = leaderless(4, &[[0, 1], [1, 0], [2, 3]]);
        assert_eq!(*apart.intact(), groups(&[&[0, 1], &[2]]));
        assert!((0..4).all(|robot| apart.loss(&[robot], &[]).is_sound()));
    }

    #[test]
    fn the_contained_are_lost_with_the_only_leader_they_hear_of_and_adrift_with_the_main_one() {
        // 0 leads, 1 and 2 keep a place; 3 hears 1, 4 hears 1 and 2, 5 hears only 3.
        let graph = graph(6, &[[0, 1], [0, 2], [1, 3], [1, 4], [2, 4], [3, 5]]);
        let containment = Reachability::new(&graph, Some(0), &[3, 4, 5], &[]);
        assert!(containment.intact().is_sound());
        let uncontained =
            |robots: &[usize]| Standing { uncontained: robots.to_vec(), ..Standing::default() };
        let deaths = [
            Standing { unled: vec![1, 2], adrift: vec![3, 4, 5], ..Standing::default() },
            uncontained(&[3, 5]),
            uncontained(&[]),
            uncontained(&[5]),
            uncontained(&[]),
            uncontained(&[]),
        ];
        let cuts = [
            ([0, 1], Standing { unled: vec![1], adrift: vec![3, 5], ..Standing::default() }),
            ([0, 2], unled(&[2])),
            ([1, 3], uncontained(&[3, 5])),
            ([3, 5], uncontained(&[5])),
        ];
        assert_losses(&containment, &deaths, &cuts);
        // Both who contain robot 4 at once.
        assert_eq!(containment.loss(&[1, 2], &[]), uncontained(&[3, 4, 5]));
    }

    #[test]
    fn robots_that_are_all_contained_are_contained_by_nobody() {
        let graph = graph(2, &[[0, 1], [1, 0]]);
        let standing = Reachability::new(&graph, None, &[0, 1], &[]).intact().clone();
        assert_eq!(standing, Standing { uncontained: vec![0, 1], ..Standing::default() });
    }

    /// Whether there is a path, for each pair of living robots, by Warshall's closure.
    fn paths(edges: &[[usize; 2]], alive: &[bool], cut: Option<usize>) -> Vec<Vec<bool>> {
        let n = alive.len();
        let mut path: Vec<Vec<bool>> =
            (0..n).map(|i| (0..n).map(|j| i == j && alive[i]).collect()).collect();
        for (index, &[from, to]) in edges.iter().enumerate() {
            path[from][to] |= alive[from] && alive[to] && cut != Some(index);
        }
        for via in 0..n {
            for from in 0..n {
                for to in 0..n {
                    path[from][to] |= path[from][via] && path[via][to];
                }
            }
        }
        path
    }

    /// The definitions of [`Standing`], word by word.
    fn by_definition(
        edges: &[[usize; 2]],
        leader: Option<usize>,
        contained: &[usize],
        alive: &[bool],
        cut: Option<usize>,
    ) -> Standing {
        let path = paths(edges, alive, cut);
        let living = || (0..alive.len()).filter(|&r| alive[r]);
        let place = |r: usize| !contained.contains(&r);
        let places: Vec<usize> = living().filter(|&r| place(r)).collect();
        let led = |r: usize| leader.is_some_and(|leader| path[leader][r]);
        let held = |r: usize| places.iter().any(|&p| path[p][r]);
        let kept = || places.iter().copied().filter(|&r| Some(r) != leader);
        let uncontained = living().filter(|&r| !place(r) && !held(r)).collect();
        if leader.is_some() {
            let unled: Vec<usize> = kept().filter(|&r| !led(r)).collect();
            let pulled =
                kept().filter(|&r| led(r) && unled.iter().any(|&stray| path[stray][r])).collect();
            let adrift = living().filter(|&r| !place(r) && held(r) && !led(r)).collect();
            return Standing { unled, pulled, uncontained, adrift, groups: vec![] };
        }
        if places.iter().any(|&r| places.iter().all(|&s| path[r][s])) || places.is_empty() {
            return Standing { uncontained, ..Standing::default() };
        }
        let mut groups: Vec<Vec<usize>> = places
            .iter()
            .map(|&r| places.iter().copied().filter(|&s| path[r][s] && path[s][r]).collect())
            .filter(|group: &Vec<usize>| {
                let outside = |s: &&usize| !group.contains(s);
                places.iter().filter(outside).all(|&s| !path[s][group[0]])
            })
            .collect();
        groups.sort();
        groups.dedup();
        Standing { uncontained, groups, ..Standing::default() }
    }

    fn lost(before: &Standing, after: Standing) -> Standing {
        let new = |after: Vec<usize>, before: &Vec<usize>| {
            after.into_iter().filter(|r| !before.contains(r)).collect()
        };
        Standing {
            unled: new(after.unled, &before.unled),
            pulled: new(after.pulled, &before.pulled),
            uncontained: new(after.uncontained, &before.uncontained),
            adrift: new(after.adrift, &before.adrift),
            groups: if before.groups.is_empty() { after.groups } else { vec![] },
        }
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(1500))]
        #[test]
        fn every_death_and_every_cut_takes_what_the_definitions_say(
            n in 1..8usize,
            pairs in proptest::collection::btree_set((0..8usize, 0..8usize), 0..24),
            leads in any::<bool>(),
            contained in proptest::collection::btree_set(1..8usize, 0..4),
        ) {
            // The leader hears nobody.
            let edges: Vec<[usize; 2]> = pairs
                .into_iter()
                .map(|(from, to)| [from % n, to % n])
                .filter(|[from, to]| from != to && !(leads && *to == 0))
                .collect();
            let contained: Vec<usize> = contained.into_iter().filter(|&r| r < n).collect();
            let leader = leads.then_some(0);
            let reachability = Reachability::new(&graph(n, &edges), leader, &contained, &[]);
            let standing = |alive: &[bool], cut| {
                by_definition(&edges, leader, &contained, alive, cut)
            };
            let intact = standing(&vec![true; n], None);
            prop_assert_eq!(reachability.intact(), &intact);
            for robot in 0..n {
                let mut alive = vec![true; n];
                alive[robot] = false;
                let after = standing(&alive, None);
                prop_assert_eq!(reachability.loss(&[robot], &[]), lost(&intact, after));
            }
            let mut breaking = Vec::new();
            for edge in 0..edges.len() {
                let loss = lost(&intact, standing(&vec![true; n], Some(edge)));
                prop_assert_eq!(&reachability.loss(&[], &[edge]), &loss);
                if !loss.is_sound() {
                    breaking.push((edge, loss));
                }
            }
            prop_assert_eq!(reachability.breaking_cuts(), breaking);
        }
    }
}
