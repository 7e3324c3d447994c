//! Whose information reaches whom, and what a death or a cut takes from whom. (Assumptions 3 to 5)
//!
//! Plain places in, plain places out. The dead are left out, as with the silence policy `ignore`;
//! robots that fell silent without dying count as dead.

use serde::Serialize;

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

/// Who has what it goes by. Robots by their places, or by their names, in order.
#[derive(Debug, Clone, Default, PartialEq, Eq, Serialize)]
pub struct Standing<R = usize> {
    /// With a main leader: robots that keep a place and that it does not reach. (Assumptions 3, 5)
    pub unled: Vec<R>,
    /// With a main leader: robots that keep a place and that it reaches, but an unled robot
    /// reaches too. That one pulls them out of their place.
    pub pulled: Vec<R>,
    /// Contained robots that no robot reaches that leads or keeps a place. (Assumption 4)
    pub uncontained: Vec<R>,
    /// With a main leader: contained robots that still have somebody to be contained by, but only
    /// unled ones. Their hull no longer follows the trajectory.
    pub adrift: Vec<R>,
    /// Without a main leader: groups of robots that keep a place and hear nobody outside, if
    /// there are several. No robot's information reaches them all, so each stands for itself.
    pub groups: Vec<Vec<R>>,
}

impl<R> Standing<R> {
    /// Whether everybody has what it goes by.
    pub fn is_sound(&self) -> bool {
        let Standing { unled, pulled, uncontained, adrift, groups } = self;
        [unled, pulled, uncontained, adrift].iter().all(|list| list.is_empty()) && groups.is_empty()
    }

    /// The same with that name for each robot.
    pub fn named<N>(&self, name: impl Fn(&R) -> N) -> Standing<N> {
        let named = |robots: &Vec<R>| robots.iter().map(&name).collect::<Vec<N>>();
        Standing {
            unled: named(&self.unled),
            pulled: named(&self.pulled),
            uncontained: named(&self.uncontained),
            adrift: named(&self.adrift),
            groups: self.groups.iter().map(named).collect(),
        }
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
        self.standing_led_by(self.leader.as_slice(), dead, cut)
    }

    /// The same where these lead, who go by nobody, deputies of the main leader among them.
    fn standing_led_by(&self, leaders: &[usize], dead: &[usize], cut: &[usize]) -> Standing {
        let n = self.leaving.len();
        let mut gone = self.gone(dead, cut);
        for (edge, [_, to]) in self.edges.iter().enumerate() {
            gone.cut[edge] |= leaders.contains(to);
        }

        let living = |&robot: &usize| !gone.dead[robot];
        let places: Vec<usize> = self.places().filter(living).collect();
        let held = self.spread(&places, &gone).reached;
        let contained = || (0..n).filter(living).filter(|&robot| self.contained[robot]);
        let mut standing = Standing {
            uncontained: contained().filter(|&robot| !held[robot]).collect(),
            ..Standing::default()
        };
        if self.leader.is_none() {
            standing.groups = self.groups(&places, &gone);
            return standing;
        }
        let led = self.spread(leaders, &gone).reached;
        let kept = |robot: &&usize| !leaders.contains(robot);
        standing.unled = places.iter().filter(kept).copied().filter(|&r| !led[r]).collect();
        let stray = self.spread(&standing.unled, &gone).reached;
        let pulled = |&robot: &usize| led[robot] && stray[robot];
        standing.pulled = places.iter().filter(kept).copied().filter(pulled).collect();
        standing.adrift = contained().filter(|&robot| held[robot] && !led[robot]).collect();
        standing
    }

    /// Whom the information of these living reaches once those robots are dead and edges cut.
    pub fn reached(&self, from: &[usize], dead: &[usize], cut: &[usize]) -> Vec<bool> {
        self.spread(from, &self.gone(dead, cut)).reached
    }

    fn gone(&self, dead: &[usize], cut: &[usize]) -> Gone {
        let robots = self.leaving.len();
        let mut gone = Gone { dead: vec![false; robots], cut: vec![false; self.edges.len()] };
        dead.iter().for_each(|&robot| gone.dead[robot] = true);
        cut.iter().for_each(|&edge| gone.cut[edge] = true);
        gone
    }

    /// Those that lead or keep a place by what they hear.
    fn places(&self) -> impl Iterator<Item = usize> + '_ {
        (0..self.leaving.len()).filter(|&robot| !self.contained[robot] && !self.alone[robot])
    }

    /// What the living lack after these losses and had before. Groups count as lost only where
    /// all were one before.
    pub fn loss(&self, dead: &[usize], cut: &[usize]) -> Standing {
        self.loss_led_by(self.leader.as_slice(), dead, cut)
    }

    /// The same where these lead, who go by nobody, deputies of the main leader among them.
    pub fn loss_led_by(&self, leaders: &[usize], dead: &[usize], cut: &[usize]) -> Standing {
        let Standing { unled, pulled, uncontained, adrift, groups } =
            self.standing_led_by(leaders, dead, cut);
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

    /// A robot that no longer hears anybody stands still, and pulls whoever still hears it.
    #[test]
    fn a_cycle_that_hangs_off_the_leader_pulls_its_entry_when_it_breaks_behind_it() {
        let cycle = graph(4, &[[0, 1], [1, 2], [2, 3], [3, 1]]);
        let loss = Reachability::new(&cycle, Some(0), &[], &[]).loss(&[2], &[]);
        assert_eq!(loss, Standing { unled: vec![3], pulled: vec![1], ..Standing::default() });
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
        [contained, alone]: [&[usize]; 2],
        alive: &[bool],
        cut: Option<usize>,
    ) -> Standing {
        let path = paths(edges, alive, cut);
        let living = || (0..alive.len()).filter(|&r| alive[r]);
        let place = |r: usize| !contained.contains(&r);
        let places: Vec<usize> = living().filter(|&r| place(r) && !alone.contains(&r)).collect();
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
            alone in proptest::collection::btree_set(1..8usize, 0..2),
            dead in (0..8usize, 0..8usize),
        ) {
            // The leader hears nobody.
            let edges: Vec<[usize; 2]> = pairs
                .into_iter()
                .map(|(from, to)| [from % n, to % n])
                .filter(|[from, to]| from != to && !(leads && *to == 0))
                .collect();
            let alone: Vec<usize> =
                alone.into_iter().filter(|r| *r < n && !contained.contains(r)).collect();
            let contained: Vec<usize> = contained.into_iter().filter(|&r| r < n).collect();
            let leader = leads.then_some(0);
            let reachability = Reachability::new(&graph(n, &edges), leader, &contained, &alone);
            let standing = |alive: &[bool], cut| {
                by_definition(&edges, leader, [&contained, &alone], alive, cut)
            };
            let intact = standing(&vec![true; n], None);
            prop_assert_eq!(reachability.intact(), &intact);
            // Each alone, and two at once.
            let deaths = (0..n).map(|robot| vec![robot]).chain([vec![dead.0 % n, dead.1 % n]]);
            for dead in deaths {
                let alive: Vec<bool> = (0..n).map(|robot| !dead.contains(&robot)).collect();
                let after = standing(&alive, None);
                prop_assert_eq!(reachability.loss(&dead, &[]), lost(&intact, after));
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
