//! Whom robots go by in place of in-neighbours that are lost for long: as the file says, or chosen.
//!
//! A contained robot has no offsets: whom it goes by in place of one moves its place, and those of others that
//! go by it. So that is planned for each death, for all that hear the dead one together, see [`Choice::plan`]; and so that
//! the plans of two deaths go together, see [`Choice::plan_for_pairs`].
//!
//! A spare that is chosen for a robot that keeps a place comes before the robot in an order: fewer hops from the leader, then earlier in the
//! file. Whoever goes by somebody before it in that order is led as long as that one is. So as long as the
//! leader lives and a robot has a spare for each in-neighbour that it has lost, it is led, and no circle of
//! spares is without a leader. A deputy may be anybody's spare: who goes by it is led if it is, and otherwise it
//! leads.

use std::collections::BTreeSet;

use formation::Vec2;
use formation::graph::Edge;
use formation::laplacian::settle;
use formation::trajectory::Trajectory;
use protocol::law::Reference;
use protocol::planted;

use super::Scenario;
use super::diagnostic::Diagnostic;
use super::robots::{Ties, robot_named};
use super::table::Table;
use crate::check::places;

/// Of robots that a contained one does not hear, so many of the nearest may take somebody's place.
const NEAREST: usize = 5;
/// Most who take one robot's place.
const SUBSTITUTES_MAX: usize = 3;
/// Most rounds of choices: each is better than the one before.
const ROUNDS: usize = 4;

/// Plans are chosen for pairs of deaths too where there are no more robots than this.
const PAIRS_ROBOTS_MAX: usize = 16;

/// By whom a contained robot goes in place of one that it has lost.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Substitutes {
    /// The contained robot.
    pub robot: usize,
    /// Whom it has lost.
    pub lost: usize,
    /// By whom it goes instead: somebody twice counts twice, one that it hears anyway once more.
    pub by: Vec<usize>,
}

/// A robot that goes by another in place of one that it has lost.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Repaired {
    /// Which.
    pub robot: usize,
    /// By whom.
    pub by: usize,
    /// In place of whom.
    pub instead_of: usize,
    /// The place of that spare in [`Scenario::spares`]; `None`: it hears it anyway, and counts it once more.
    pub spare: Option<usize>,
}

/// What is repaired, and how soon.
pub(super) struct Repair {
    /// A spare is opened for an in-neighbour that is lost for so long, ns; `None`: none ever is.
    after_ns: Option<u64>,
    /// So many are chosen for a robot.
    count: usize,
    /// Of robots that name their own: which.
    given: Vec<Option<Vec<usize>>>,
}

impl Repair {
    /// `repair`, `repair_after_s`, `spares`, and those of each robot.
    pub(super) fn read(
        root: &Table<'_>,
        scenario: &Scenario,
        ties: &[Ties<'_>],
        warnings: &mut Vec<Diagnostic>,
    ) -> Result<Repair, Diagnostic> {
        let repairs = root.need("repair")?.word(&[("none", false), ("spares", true)])?;
        let given = ties.iter().enumerate().map(|(hearer, tie)| given(scenario, hearer, tie));
        let given: Vec<Option<Vec<usize>>> = given.collect::<Result<_, _>>()?;
        let own = ties.iter().flat_map(|tie| [&tie.spares, &tie.deputies]).flatten().cloned();
        let mut unused =
            root.get("spares").into_iter().chain(root.get("repair_after_s")).chain(own);
        if let Some(unused) = unused.next().filter(|_| !repairs) {
            let expected = "expected `repair = \"spares\"`, or no such key";
            warnings
                .push(unused.wrong("has no effect: nothing is repaired", expected).as_warning());
        }
        let after_ns = root.time_ns("repair_after_s")?;
        let count = root.whole("spares")? as usize;
        Ok(Repair { after_ns: repairs.then_some(after_ns), count, given })
    }

    /// Who replaces whom, if anything is repaired.
    pub(super) fn plan(&self, scenario: &mut Scenario) {
        if self.after_ns.is_none() {
            scenario.successions.clear();
        }
        (scenario.spares, scenario.substitutes) = self.spares(scenario);
        scenario.repair_after_ns = self.after_ns;
    }

    /// The spares of all robots, robot by robot: edges from the spare, with the difference of the two places
    /// that follow from the whole graph (Remark 1); and what is planned for contained robots.
    fn spares(&self, scenario: &Scenario) -> (Vec<Edge>, Vec<Substitutes>) {
        // Without places the scenario has errors, and is never run.
        let places = self.after_ns.and_then(|_| places(scenario));
        let Some(places) = places else { return Default::default() };
        let contained = |i: &usize| scenario.robots[*i].role.reference == Reference::Middle;
        let plans = |i: &usize| contained(i) && self.given[*i].is_none();
        let robots = 0..scenario.robots.len();
        let mut choice =
            Choice { scenario, order: order(scenario), places: &places, keep_by: Vec::new() };
        choice.keep_by = robots.clone().map(|i| self.keeps_place_by(&choice, i)).collect();
        let planning: Vec<usize> = robots.clone().filter(plans).collect();
        let mut plans: Vec<Vec<Substitutes>> =
            robots.map(|lost| choice.plan(lost, &planning, self.count)).collect();
        if !planning.is_empty() && plans.len() <= PAIRS_ROBOTS_MAX {
            for _ in 0..ROUNDS {
                if !choice.plan_for_pairs(&mut plans, self.count) {
                    break;
                }
            }
        }
        let filled = |planned: &Substitutes| !planned.by.is_empty();
        let substitutes: Vec<Substitutes> = plans.into_iter().flatten().filter(filled).collect();
        let mut spares = Vec::new();
        for (to, given) in self.given.iter().enumerate() {
            let mut from = match given {
                Some(given) => given.clone(),
                None if contained(&to) => {
                    let planned = substitutes.iter().filter(|planned| planned.robot == to);
                    let by = planned.flat_map(|planned| planned.by.iter().copied());
                    let by: BTreeSet<usize> = by.filter(|&by| !choice.hears(to, by)).collect();
                    by.into_iter().collect()
                }
                None => choice.of(to, self.count),
            };
            for deputy in scenario.successions_heard(to).flat_map(|one| &one.deputies) {
                if *deputy != to && !choice.hears(to, *deputy) && !from.contains(deputy) {
                    from.push(*deputy);
                }
            }
            spares.extend(from.into_iter().map(|from| {
                let offset_m = places[to] - places[from];
                Edge { from, to, offset_m: if contained(&to) { Vec2::zeros() } else { offset_m } }
            }));
            let (place, by) = choice.keep_by[to].clone();
            spares.extend(by.into_iter().map(|from| Edge {
                from,
                to,
                offset_m: places[place] - places[from],
            }));
        }
        (spares, substitutes)
    }

    /// By whom a deputy keeps the place of a leader that it takes, and whose that is: by those that this one hears and by its
    /// spares, but for whom the deputy itself hears.
    fn keeps_place_by(&self, choice: &Choice<'_>, deputy: usize) -> (usize, Vec<usize>) {
        let mut successions = choice.scenario.successions.iter();
        let Some(one) = successions.find(|one| one.deputies.contains(&deputy)) else {
            return (deputy, Vec::new());
        };
        let leader = one.leader;
        let spares = self.given[leader].clone();
        let spares = spares.unwrap_or_else(|| choice.of(leader, self.count));
        let heard = choice.scenario.graph.incoming_edges(leader).map(|edge| edge.from);
        let own = self.given[deputy].as_deref().unwrap_or_default();
        let by = heard.chain(spares);
        let by = by.filter(|from| !choice.hears(deputy, *from) && !own.contains(from));
        (leader, by.collect())
    }
}

/// The spares that a robot of the file names, if it does.
fn given(
    scenario: &Scenario,
    hearer: usize,
    tie: &Ties<'_>,
) -> Result<Option<Vec<usize>>, Diagnostic> {
    let Some(list) = &tie.spares else { return Ok(None) };
    let robots = &scenario.robots;
    let name = &robots[hearer].name;
    let reference = robots[hearer].role.reference;
    if reference.is_local() {
        return Err(list.here(
            format!("{name} has spares, but goes by nobody that it hears"),
            "expected no `spares` here: the leader and robots with goals need none",
        ));
    }
    let mut spares: Vec<usize> = Vec::new();
    for value in list.elements("expected a list of names of robots: [\"r2\", \"r3\"]")? {
        let spare = robot_named(&value, robots)?;
        let other = &robots[spare].name;
        let wrong = |what: String, expected: &str| Err(value.here(what, expected));
        if spare == hearer {
            return wrong(
                format!("{name} is to be its own spare"),
                "expected another robot: nobody hears itself",
            );
        }
        if spares.contains(&spare) {
            return wrong(format!("{other} is a spare of {name} twice"), "expected it once");
        }
        if scenario.graph.incoming_edges(hearer).any(|edge| edge.from == spare) {
            let expected = "expected a robot that it does not hear anyway";
            return wrong(format!("{name} hears {other}, which is to be its spare"), expected);
        }
        let mut keeps_by = scenario.successions.iter().filter(|one| {
            let by = |edge: &Edge| edge.from == spare;
            one.deputies.contains(&hearer) && scenario.graph.incoming_edges(one.leader).any(by)
        });
        if let Some(one) = keeps_by.next() {
            let leader = &robots[one.leader].name;
            return wrong(
                format!(
                    "{name} is to keep the place of {leader} by {other}, which is to be its spare"
                ),
                "expected a robot by which that leader does not keep its place",
            );
        }
        let contained = robots[spare].role.reference == Reference::Middle;
        if reference == Reference::Offsets && contained {
            return wrong(
                format!("{name} keeps a place, but its spare {other} is contained and has none"),
                "expected a robot that leads or keeps a place itself (52)",
            );
        }
        spares.push(spare);
    }
    Ok(Some(spares))
}

/// For each robot its rank in the order by which spares are chosen: hops from the leader (without one, from
/// the first robot that reaches all), then place in the file. Who is not reached has none.
fn order(scenario: &Scenario) -> Vec<Option<(usize, usize)>> {
    let first = scenario.leader().or_else(|| scenario.graph.roots().first().copied());
    let hops = first.map(|first| scenario.graph.hops().swap_remove(first)).unwrap_or_default();
    hops.into_iter().enumerate().map(|(i, hops)| Some((hops?, i))).collect()
}

/// As bad as a pair of deaths can be: somebody is left without anybody to go by.
const STRANDED: u64 = 10_000_000;

/// How bad a plan is.
type Cost = (u64, u64, usize);

/// What spares are chosen by.
struct Choice<'a> {
    scenario: &'a Scenario,
    order: Vec<Option<(usize, usize)>>,
    /// Where everybody settles, at scale 1, m.
    places: &'a [Vec2],
    /// Of each deputy, whose place it takes, and by whom it then keeps it.
    keep_by: Vec<(usize, Vec<usize>)>,
}

impl Choice<'_> {
    fn hears(&self, to: usize, from: usize) -> bool {
        self.scenario.graph.incoming_edges(to).any(|edge| edge.from == from)
    }

    fn reference(&self, robot: usize) -> Reference {
        self.scenario.robots[robot].role.reference
    }

    fn is_before(&self, from: usize, to: usize) -> bool {
        self.order[from].is_some()
            && (self.order[from] < self.order[to] || planted::is("circle-of-spares"))
    }

    /// Whether this robot may go by that one: without a leader, a circle would be one in which velocities never
    /// die out.
    fn may(&self, to: usize, from: usize) -> bool {
        let unled = self.scenario.leader().is_none();
        let circle = || self.scenario.graph.hops().swap_remove(to)[from].is_some();
        from != to && !(unled && circle())
    }

    /// At most so many spares for a robot that keeps a place, the best first.
    fn of(&self, to: usize, count: usize) -> Vec<usize> {
        if self.reference(to) != Reference::Offsets {
            return Vec::new();
        }
        let deputies = &self.scenario.deputies;
        let rank_of = |from: usize| deputies.iter().position(|&deputy| deputy == from);
        let fits = |&from: &usize| {
            let before = self.is_before(from, to) || rank_of(from).is_some();
            before && self.reference(from) != Reference::Middle
        };
        let fits = (0..self.scenario.robots.len()).filter(fits);
        let candidates = fits.filter(|&from| !self.hears(to, from) && self.may(to, from));
        let distance_m = |from: usize| (self.places[from] - self.places[to]).norm();
        // Without the leader those who heard it go by who leads then.
        let hears_leader = self.scenario.leader().is_some_and(|leader| self.hears(to, leader));
        let first = |from: usize| match hears_leader {
            true => rank_of(from).unwrap_or(deputies.len()),
            false => 0,
        };
        let rated = candidates.map(|from| ((first(from), rank(distance_m(from))), from));
        let mut rated: Vec<((usize, u64), usize)> = rated.collect();
        rated.sort_unstable();
        rated.into_iter().take(count).map(|(_, from)| from).collect()
    }

    /// By whom those of `planning` go that hear `lost`, once it is dead: with at most so many each, so that nobody's
    /// place is nearer to another's than robots come to rest (Remark 1), or as little as can be; and of these so
    /// that places move least. One robot's choice after the other, until none is better; if some are still too near,
    /// those of two at a time. Who has deputies is replaced by them.
    fn plan(&self, lost: usize, planning: &[usize], count: usize) -> Vec<Substitutes> {
        if self.scenario.successions.iter().any(|one| one.leader == lost) {
            return Vec::new();
        }
        let hears_lost = |&&to: &&usize| to != lost && self.hears(to, lost);
        let hearers: Vec<usize> = planning.iter().filter(hears_lost).copied().collect();
        let left = |to: usize| {
            let heard = self.scenario.graph.incoming_edges(to).map(|edge| edge.from);
            heard.filter(|&from| from != lost).collect::<Vec<usize>>()
        };
        let heard: Vec<Vec<usize>> = (0..self.places.len()).map(left).collect();
        let options = hearers.iter().map(|&to| (to, self.options(lost, to, &heard[to], count)));
        let options: Vec<(usize, Vec<Vec<usize>>)> = options.collect();
        let mut best = (self.cost(&[lost], &heard), heard);
        for _ in 0..ROUNDS {
            let before = best.0;
            options
                .iter()
                .for_each(|one| self.search(lost, &[one], &mut best.1.clone(), &mut best));
            if best.0 == before {
                break;
            }
        }
        let pairs = options.iter().enumerate();
        let pairs =
            pairs.flat_map(|(k, one)| options[k + 1..].iter().map(move |other| [one, other]));
        for pair in pairs {
            if best.0.0 > 0 {
                self.search(lost, &pair, &mut best.1.clone(), &mut best);
            }
        }
        let planned = hearers.into_iter().map(|robot| {
            let by = best.1[robot].split_off(left(robot).len());
            Substitutes { robot, lost, by }
        });
        planned.collect()
    }

    /// Chooses among what is as good after single deaths what is better after pairs of them; whether anything is.
    fn plan_for_pairs(&self, plans: &mut [Vec<Substitutes>], count: usize) -> bool {
        let mut better = false;
        for lost in 0..plans.len() {
            let mut best = self.cost_of_pairs(lost, plans, u64::MAX);
            for k in 0..plans[lost].len() {
                let to = plans[lost][k].robot;
                let heard = self.scenario.graph.incoming_edges(to).map(|edge| edge.from);
                let left: Vec<usize> = heard.filter(|&from| from != lost).collect();
                for option in self.options(lost, to, &left, count) {
                    let by = option[left.len()..].to_vec();
                    let before = std::mem::replace(&mut plans[lost][k].by, by);
                    let cost = self.cost_of_pairs(lost, plans, best.0);
                    if cost < best {
                        (best, better) = (cost, true);
                    } else {
                        plans[lost][k].by = before;
                    }
                }
            }
        }
        better
    }

    /// How bad these plans are once one is dead, alone or with another: first as [`Choice::cost`] has it of the one
    /// death, no worse than `worst`, then of all pairs.
    fn cost_of_pairs(
        &self,
        lost: usize,
        plans: &[Vec<Substitutes>],
        worst: u64,
    ) -> (u64, u64, u64, usize) {
        let (lacking, moved, count) = self.cost(&[lost], &self.heard(plans, &[lost]));
        if lacking > worst {
            return (lacking, 0, 0, 0);
        }
        let others = (0..plans.len()).filter(|&other| other != lost);
        let pairs = others.map(|other| [lost, other]);
        let lacking_m = pairs.map(|dead| self.cost(&dead, &self.heard(plans, &dead)).0);
        (lacking, lacking_m.map(|lacking_m| lacking_m.min(STRANDED)).sum(), moved, count)
    }

    /// By whom everybody goes once these are dead.
    fn heard(&self, plans: &[Vec<Substitutes>], dead: &[usize]) -> Vec<Vec<usize>> {
        let gone_by = |to: usize| {
            let heard = self.scenario.graph.incoming_edges(to).map(|edge| edge.from);
            let (silent, mut left): (Vec<usize>, Vec<usize>) =
                heard.partition(|from| dead.contains(from));
            let planned = silent.iter().flat_map(|&lost| &plans[lost]);
            let by = planned.filter(|planned| planned.robot == to).flat_map(|planned| &planned.by);
            left.extend(by.filter(|by| !dead.contains(by)));
            let taken = self.taken(dead).filter(|(leader, _)| silent.contains(leader));
            left.extend(taken.map(|(_, deputy)| deputy));
            left
        };
        (0..plans.len()).map(gone_by).collect()
    }

    /// Which leaders' places are taken once these are dead, and by whom.
    fn taken(&self, dead: &[usize]) -> impl Iterator<Item = (usize, usize)> {
        let lost = self.scenario.successions.iter().filter(|one| dead.contains(&one.leader));
        lost.filter_map(|one| {
            let mut living = one.deputies.iter().filter(|deputy| !dead.contains(deputy));
            Some((one.leader, *living.next()?))
        })
    }

    /// Whether these robots do better with others of their options: the best of all is kept in `best`.
    fn search(
        &self,
        lost: usize,
        choices: &[&(usize, Vec<Vec<usize>>)],
        heard: &mut [Vec<usize>],
        best: &mut (Cost, Vec<Vec<usize>>),
    ) {
        let [(to, options), others @ ..] = choices else {
            let cost = self.cost(&[lost], heard);
            if cost < best.0 {
                *best = (cost, heard.to_vec());
            }
            return;
        };
        for option in options {
            heard[*to].clone_from(option);
            self.search(lost, others, heard, best);
        }
    }

    /// By whom a contained robot might go that has lost this one: by those that are `left` to it, and up to so many of
    /// these and of the nearest others besides, some perhaps twice. Somebody before it is among them.
    fn options(&self, lost: usize, to: usize, left: &[usize], count: usize) -> Vec<Vec<usize>> {
        let unled = self.scenario.leader().is_none();
        let fits = |&from: &usize| {
            let other = from != lost && !left.contains(&from) && self.may(to, from);
            let other = other && !self.keep_by[to].1.contains(&from);
            other && (!unled || self.is_before(from, to))
        };
        let mut others: Vec<usize> = (0..self.places.len()).filter(fits).collect();
        others.sort_by_key(|&from| rank((self.places[from] - self.places[to]).norm()));
        others.truncate(NEAREST);
        let candidates = [left, &others].concat();
        let mut options = vec![left.to_vec()];
        let mut shorter = 0;
        for _ in 0..count.min(SUBSTITUTES_MAX) {
            let end = options.len();
            for k in shorter..end {
                let option = options[k].clone();
                // Each set once: in the order of the candidates.
                let last = option.get(left.len()..).and_then(|more| more.last());
                let from = last.and_then(|last| candidates.iter().position(|one| one == last));
                let next = candidates[from.unwrap_or(0)..].iter();
                options.extend(next.map(|&by| [&option[..], &[by]].concat()));
            }
            shorter = end;
        }
        options.retain(|option| option.iter().any(|&from| self.is_before(from, to)));
        options
    }

    /// How bad it is that robots go by these once some are dead: by how much places are nearer to others than robots come
    /// to rest, and how far they move (squared), over all; then how many are gone by.
    fn cost(&self, dead: &[usize], heard: &[Vec<usize>]) -> Cost {
        let n = self.places.len();
        let taken: Vec<(usize, usize)> = self.taken(dead).collect();
        let contained = |i: usize| {
            self.reference(i) == Reference::Middle && taken.iter().all(|(_, deputy)| *deputy != i)
        };
        let moves = |&i: &usize| !dead.contains(&i) && contained(i);
        let free: Vec<usize> = (0..n).filter(moves).collect();
        let gone_by: Vec<Vec<(usize, Vec2)>> = heard
            .iter()
            .map(|heard| heard.iter().map(|&from| (from, Vec2::zeros())).collect())
            .collect();
        let mut places = self.places.to_vec();
        taken.iter().for_each(|&(leader, deputy)| places[deputy] = self.places[leader]);
        let stranded = free.iter().any(|&i| heard[i].is_empty());
        if stranded || settle(&gone_by, &free, &mut places).is_none() {
            return (u64::MAX, 0, 0);
        }
        let scale = self.scenario.scale().map_or(1.0, |scale| scale.range()[0]);
        let steers_m = |robot: usize| self.scenario.steers_within_m(robot).unwrap_or(0.0);
        // A formation that moves leaves bodies behind.
        let lead = self.scenario.lead.as_ref();
        let stands = lead.is_none_or(|lead| matches!(lead.trajectory, Trajectory::Still { .. }));
        let (mut lacking_m, mut moved_m2) = (0.0, 0.0);
        for &i in &free {
            moved_m2 += (places[i] - self.places[i]).norm_squared();
            for j in (0..n).filter(|&j| j != i && (stands || !dead.contains(&j))) {
                let planned_m = scale * (self.places[i] - self.places[j]).norm();
                let asked_m = steers_m(i).max(steers_m(j)).min(planned_m);
                lacking_m += (asked_m - scale * (places[i] - places[j]).norm()).max(0.0);
            }
        }
        (rank(lacking_m), rank(moved_m2), heard.iter().map(Vec::len).sum())
    }
}

/// A length, m, in micrometers (or the square of one): sums of offsets differ in their last digits from others that are the same.
fn rank(length_m: f64) -> u64 {
    (length_m * 1e6).round() as u64
}
