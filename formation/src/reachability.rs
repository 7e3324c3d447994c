//! Reachability in the formation graph, and what robots lose by deaths and link cuts. (Assumptions 3 to 5)
//!
//! Robots are given and returned as indices. Dead robots are left out, as with the silence policy `ignore`. A
//! robot that is silent without being dead counts as dead.

use serde::Serialize;

use crate::graph::FormationGraph;

/// A formation graph with the roles of its robots, for reachability queries.
#[derive(Debug, Clone)]
pub struct Reachability {
    /// Ends of each edge, `[from, to]`.
    edges: Vec<[usize; 2]>,
    /// For each robot, the indices of its outgoing edges.
    outgoing_edges: Vec<Vec<usize>>,
    leader: Option<usize>,
    is_contained: Vec<bool>,
    /// For each robot, `true` if it needs no in-neighbor.
    needs_no_in_neighbor: Vec<bool>,
    defects_without_faults: Defects,
}

/// Robots whose required information sources are missing, by kind of defect. Robots are given by index or by
/// name, in ascending order.
#[derive(Debug, Clone, Default, PartialEq, Eq, Serialize)]
pub struct Defects<R = usize> {
    /// Formation robots not reachable from the main leader, if there is one. (Assumptions 3, 5)
    pub unled: Vec<R>,
    /// Formation robots reachable from the main leader, but also from an `unled` robot, which displaces them
    /// from their slots.
    pub pulled: Vec<R>,
    /// Followers (containment control) that are not reachable from any leader or formation robot. (Assumption
    /// 4)
    pub uncontained: Vec<R>,
    /// Followers reachable only from `unled` robots, if there is a main leader. The hull that contains them
    /// no longer follows the trajectory.
    pub adrift: Vec<R>,
    /// Groups of formation robots that receive nothing from outside of their group, if there is no main leader
    /// and several such groups. No robot reaches all of them, so each group settles independently.
    pub groups: Vec<Vec<R>>,
}

impl<R> Defects<R> {
    /// Returns `true` if no robot has a defect.
    pub fn is_empty(&self) -> bool {
        let Defects { unled, pulled, uncontained, adrift, groups } = self;
        [unled, pulled, uncontained, adrift].iter().all(|list| list.is_empty()) && groups.is_empty()
    }

    /// Returns the same lists with every robot replaced by `name(robot)`.
    pub fn map_robots<N>(&self, name: impl Fn(&R) -> N) -> Defects<N> {
        let named = |robots: &Vec<R>| robots.iter().map(&name).collect::<Vec<N>>();
        Defects {
            unled: named(&self.unled),
            pulled: named(&self.pulled),
            uncontained: named(&self.uncontained),
            adrift: named(&self.adrift),
            groups: self.groups.iter().map(named).collect(),
        }
    }
}

/// Result of a graph search: the reached robots, and the edges over which each was first reached.
struct SearchResult {
    is_reached: Vec<bool>,
    predecessor_edges: Vec<usize>,
}

/// Dead robots and cut edges.
struct Failures {
    is_dead: Vec<bool>,
    is_cut: Vec<bool>,
}

impl Reachability {
    /// Creates the query structure and computes the state without failures.
    ///
    /// `leader` is the main leader, if there is one. `contained` are the followers and `independent` the robots that
    /// need no in-neighbor. All other robots are formation robots. Panics if an index is out of range.
    pub fn new(
        graph: &FormationGraph,
        leader: Option<usize>,
        contained: &[usize],
        independent: &[usize],
    ) -> Reachability {
        let n = graph.robot_count();
        let mut reachability = Reachability {
            edges: graph.edges().iter().map(|edge| [edge.from, edge.to]).collect(),
            outgoing_edges: vec![Vec::new(); n],
            leader,
            is_contained: vec![false; n],
            needs_no_in_neighbor: vec![false; n],
            defects_without_faults: Defects::default(),
        };
        for (index, [from, _]) in reachability.edges.iter().enumerate() {
            reachability.outgoing_edges[*from].push(index);
        }
        contained.iter().for_each(|&robot| reachability.is_contained[robot] = true);
        independent.iter().for_each(|&robot| reachability.needs_no_in_neighbor[robot] = true);
        reachability.defects_without_faults = reachability.defects(&[], &[]);
        reachability
    }

    /// Returns the defects without deaths and cuts.
    pub fn defects_without_faults(&self) -> &Defects {
        &self.defects_without_faults
    }

    /// Returns the defects of the surviving robots after the robots `dead` have died and the edges `cut` (by
    /// index) carry nothing.
    pub fn defects(&self, dead: &[usize], cut: &[usize]) -> Defects {
        self.defects_with_leaders(self.leader.as_slice(), dead, cut)
    }

    /// Returns the defects like [`Self::defects`], with `leaders` (backup leaders included) in place of the
    /// main leader. Incoming edges of a leader are ignored.
    fn defects_with_leaders(&self, leaders: &[usize], dead: &[usize], cut: &[usize]) -> Defects {
        let n = self.outgoing_edges.len();
        let mut failures = self.failures(dead, cut);
        for (edge, [_, to]) in self.edges.iter().enumerate() {
            failures.is_cut[edge] |= leaders.contains(to);
        }

        let is_alive = |&robot: &usize| !failures.is_dead[robot];
        let formation_robots: Vec<usize> = self.formation_robots().filter(is_alive).collect();
        let is_supported = self.search(&formation_robots, &failures).is_reached;
        let contained = || (0..n).filter(is_alive).filter(|&robot| self.is_contained[robot]);
        let mut defects = Defects {
            uncontained: contained().filter(|&robot| !is_supported[robot]).collect(),
            ..Defects::default()
        };
        if self.leader.is_none() {
            defects.groups = self.separate_groups(&formation_robots, &failures);
            return defects;
        }
        let reached_from_leaders = self.search(leaders, &failures).is_reached;
        let is_follower = |robot: &&usize| !leaders.contains(robot);
        defects.unled = formation_robots
            .iter()
            .filter(is_follower)
            .copied()
            .filter(|&r| !reached_from_leaders[r])
            .collect();
        let reached_from_unled = self.search(&defects.unled, &failures).is_reached;
        let pulled = |&robot: &usize| reached_from_leaders[robot] && reached_from_unled[robot];
        defects.pulled =
            formation_robots.iter().filter(is_follower).copied().filter(pulled).collect();
        defects.adrift = contained()
            .filter(|&robot| is_supported[robot] && !reached_from_leaders[robot])
            .collect();
        defects
    }

    /// Returns for each robot whether it is reachable from `from` after the given deaths and cuts.
    pub fn robots_reachable_from(
        &self,
        from: &[usize],
        dead: &[usize],
        cut: &[usize],
    ) -> Vec<bool> {
        self.search(from, &self.failures(dead, cut)).is_reached
    }

    fn failures(&self, dead: &[usize], cut: &[usize]) -> Failures {
        let robots = self.outgoing_edges.len();
        let mut failures =
            Failures { is_dead: vec![false; robots], is_cut: vec![false; self.edges.len()] };
        dead.iter().for_each(|&robot| failures.is_dead[robot] = true);
        cut.iter().for_each(|&edge| failures.is_cut[edge] = true);
        failures
    }

    /// Returns the robots that lead or keep a formation slot by what they receive.
    fn formation_robots(&self) -> impl Iterator<Item = usize> + '_ {
        (0..self.outgoing_edges.len())
            .filter(|&robot| !self.is_contained[robot] && !self.needs_no_in_neighbor[robot])
    }

    /// Returns the defects after these losses that did not exist before. Groups are reported only if there was
    /// a single group before.
    pub fn new_defects(&self, dead: &[usize], cut: &[usize]) -> Defects {
        self.new_defects_with_leaders(self.leader.as_slice(), dead, cut)
    }

    /// Returns the new defects like [`Self::new_defects`], with `leaders` (backup leaders included) in place of the
    /// main leader. Incoming edges of a leader are ignored.
    pub fn new_defects_with_leaders(
        &self,
        leaders: &[usize],
        dead: &[usize],
        cut: &[usize],
    ) -> Defects {
        let Defects { unled, pulled, uncontained, adrift, groups } =
            self.defects_with_leaders(leaders, dead, cut);
        let new = |after: Vec<usize>, before: &[usize]| {
            after.into_iter().filter(|robot| !before.contains(robot)).collect()
        };
        Defects {
            unled: new(unled, &self.defects_without_faults.unled),
            pulled: new(pulled, &self.defects_without_faults.pulled),
            uncontained: new(uncontained, &self.defects_without_faults.uncontained),
            adrift: new(adrift, &self.defects_without_faults.adrift),
            groups: if self.defects_without_faults.groups.is_empty() { groups } else { Vec::new() },
        }
    }

    /// Returns each single edge whose cut causes a defect, with the defects it causes.
    pub fn cuts_causing_defects(&self) -> Vec<(usize, Defects)> {
        // Cutting an edge that no search used leaves every reached robot reachable.
        let n = self.outgoing_edges.len();
        let no_failures =
            Failures { is_dead: vec![false; n], is_cut: vec![false; self.edges.len()] };
        let formation_robots: Vec<usize> = self.formation_robots().collect();
        let start = self.leader.or_else(|| self.find_root(&formation_robots, &no_failures));
        let mut used = self.search(&formation_robots, &no_failures).predecessor_edges;
        used.extend(self.search(start.as_slice(), &no_failures).predecessor_edges);
        used.sort_unstable();
        used.dedup();
        let losses = used.into_iter().map(|edge| (edge, self.new_defects(&[], &[edge])));
        losses.filter(|(_, loss)| !loss.is_empty()).collect()
    }

    /// Searches the graph from `sources`, which count as reached. Dead robots neither reach nor are reached.
    fn search(&self, sources: &[usize], failures: &Failures) -> SearchResult {
        let mut reached = vec![false; self.outgoing_edges.len()];
        let mut predecessor_edges = Vec::new();
        let mut open = Vec::new();
        for &source in sources.iter().filter(|&&source| !failures.is_dead[source]) {
            reached[source] = true;
            open.push(source);
        }
        while let Some(robot) = open.pop() {
            for &edge in self.outgoing_edges[robot].iter().filter(|&&edge| !failures.is_cut[edge]) {
                let to = self.edges[edge][1];
                if !failures.is_dead[to] && !std::mem::replace(&mut reached[to], true) {
                    predecessor_edges.push(edge);
                    open.push(to);
                }
            }
        }
        SearchResult { is_reached: reached, predecessor_edges }
    }

    /// Returns one of `robots` from which all of `robots` are reachable, or `None`.
    fn find_root(&self, robots: &[usize], failures: &Failures) -> Option<usize> {
        // Only the last robot that no earlier candidate reached can be a root.
        let mut seen = vec![false; self.outgoing_edges.len()];
        let mut candidate = None;
        for &robot in robots {
            if !seen[robot] {
                candidate = Some(robot);
                let reached = self.search(&[robot], failures).is_reached;
                seen.iter_mut().zip(reached).for_each(|(seen, reached)| *seen |= reached);
            }
        }
        let reached = self.search(candidate.as_slice(), failures).is_reached;
        candidate.filter(|_| robots.iter().all(|&robot| reached[robot]))
    }

    /// Returns the groups among `robots` that receive nothing from outside of themselves. Empty if one robot
    /// reaches all.
    fn separate_groups(&self, robots: &[usize], failures: &Failures) -> Vec<Vec<usize>> {
        if self.find_root(robots, failures).is_some() {
            return Vec::new();
        }
        let reached: Vec<Vec<bool>> =
            robots.iter().map(|&robot| self.search(&[robot], failures).is_reached).collect();
        let mut groups: Vec<Vec<usize>> = Vec::new();
        for (i, &robot) in robots.iter().enumerate() {
            let closed =
                robots.iter().zip(&reached).all(|(&s, from_s)| !from_s[robot] || reached[i][s]);
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

    /// A robot without in-neighbors stops, and displaces the robots that still receive from it.
    #[test]
    fn broken_cycle_behind_the_leader_pulls_its_entry_robot() {
        let cycle = graph(4, &[[0, 1], [1, 2], [2, 3], [3, 1]]);
        let loss = Reachability::new(&cycle, Some(0), &[], &[]).new_defects(&[2], &[]);
        assert_eq!(loss, Defects { unled: vec![3], pulled: vec![1], ..Defects::default() });
    }

    /// Computes for each pair of alive robots whether there is a path, by Warshall's algorithm.
    fn path_matrix(edges: &[[usize; 2]], alive: &[bool], cut: Option<usize>) -> Vec<Vec<bool>> {
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

    /// Computes [`Defects`] literally by its definitions.
    fn defects_by_definition(
        edges: &[[usize; 2]],
        leader: Option<usize>,
        [contained, independent]: [&[usize]; 2],
        alive: &[bool],
        cut: Option<usize>,
    ) -> Defects {
        let path = path_matrix(edges, alive, cut);
        let alive_robots = || (0..alive.len()).filter(|&r| alive[r]);
        let keeps_slot = |r: usize| !contained.contains(&r);
        let formation_robots: Vec<usize> =
            alive_robots().filter(|&r| keeps_slot(r) && !independent.contains(&r)).collect();
        let is_led = |r: usize| leader.is_some_and(|leader| path[leader][r]);
        let is_supported = |r: usize| formation_robots.iter().any(|&p| path[p][r]);
        let followers = || formation_robots.iter().copied().filter(|&r| Some(r) != leader);
        let uncontained = alive_robots().filter(|&r| !keeps_slot(r) && !is_supported(r)).collect();
        if leader.is_some() {
            let unled: Vec<usize> = followers().filter(|&r| !is_led(r)).collect();
            let pulled =
                followers().filter(|&r| is_led(r) && unled.iter().any(|&u| path[u][r])).collect();
            let adrift = alive_robots()
                .filter(|&r| !keeps_slot(r) && is_supported(r) && !is_led(r))
                .collect();
            return Defects { unled, pulled, uncontained, adrift, groups: vec![] };
        }
        if formation_robots.iter().any(|&r| formation_robots.iter().all(|&s| path[r][s]))
            || formation_robots.is_empty()
        {
            return Defects { uncontained, ..Defects::default() };
        }
        let mut groups: Vec<Vec<usize>> = formation_robots
            .iter()
            .map(|&r| {
                formation_robots.iter().copied().filter(|&s| path[r][s] && path[s][r]).collect()
            })
            .filter(|group: &Vec<usize>| {
                let outside = |s: &&usize| !group.contains(s);
                formation_robots.iter().filter(outside).all(|&s| !path[s][group[0]])
            })
            .collect();
        groups.sort();
        groups.dedup();
        Defects { uncontained, groups, ..Defects::default() }
    }

    fn new_defects(before: &Defects, after: Defects) -> Defects {
        let new = |after: Vec<usize>, before: &Vec<usize>| {
            after.into_iter().filter(|r| !before.contains(r)).collect()
        };
        Defects {
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
        fn deaths_and_cuts_cause_the_losses_of_the_definition(
            n in 1..8usize,
            pairs in proptest::collection::btree_set((0..8usize, 0..8usize), 0..24),
            leads in any::<bool>(),
            contained in proptest::collection::btree_set(1..8usize, 0..4),
            independent in proptest::collection::btree_set(1..8usize, 0..2),
            dead in (0..8usize, 0..8usize),
        ) {
            // The leader has no incoming edge.
            let edges: Vec<[usize; 2]> = pairs
                .into_iter()
                .map(|(from, to)| [from % n, to % n])
                .filter(|[from, to]| from != to && !(leads && *to == 0))
                .collect();
            let independent: Vec<usize> =
                independent.into_iter().filter(|r| *r < n && !contained.contains(r)).collect();
            let contained: Vec<usize> = contained.into_iter().filter(|&r| r < n).collect();
            let leader = leads.then_some(0);
            let reachability = Reachability::new(&graph(n, &edges), leader, &contained, &independent);
            let defects = |alive: &[bool], cut| {
                defects_by_definition(&edges, leader, [&contained, &independent], alive, cut)
            };
            let intact = defects(&vec![true; n], None);
            prop_assert_eq!(reachability.defects_without_faults(), &intact);
            // Each single death, and one pair of deaths.
            let deaths = (0..n).map(|robot| vec![robot]).chain([vec![dead.0 % n, dead.1 % n]]);
            for dead in deaths {
                let alive: Vec<bool> = (0..n).map(|robot| !dead.contains(&robot)).collect();
                let after = defects(&alive, None);
                prop_assert_eq!(reachability.new_defects(&dead, &[]), new_defects(&intact, after));
            }
            let mut breaking = Vec::new();
            for edge in 0..edges.len() {
                let loss = new_defects(&intact, defects(&vec![true; n], Some(edge)));
                prop_assert_eq!(&reachability.new_defects(&[], &[edge]), &loss);
                if !loss.is_empty() {
                    breaking.push((edge, loss));
                }
            }
            prop_assert_eq!(reachability.cuts_causing_defects(), breaking);
        }
    }
}
