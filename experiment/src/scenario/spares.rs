//! Whom robots go by in place of in-neighbours that are lost for long: as the file says, or chosen.
//!
//! A spare that is chosen comes before the robot in an order: fewer hops from the leader, then earlier in the
//! file. Whoever goes by somebody before it in that order is led as long as that one is. So as long as the
//! leader lives and a robot has a spare for each in-neighbour that it has lost, it is led, and no circle of
//! spares is without a leader. A deputy may be anybody's spare: who goes by it is led if it is, and otherwise it
//! leads.

use formation::Vec2;
use formation::graph::Edge;
use protocol::law::Reference;
use protocol::planted;

use super::Scenario;
use super::diagnostic::Diagnostic;
use super::robots::{Ties, robot_named};
use super::table::Table;
use crate::check::places;

/// What is repaired, and how soon.
pub(super) struct Repair {
    /// A spare is opened for an in-neighbour that is lost for so long, ns; `None`: none ever is.
    pub(super) after_ns: Option<u64>,
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
        let own = ties.iter().filter_map(|tie| tie.spares.clone());
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

    /// The spares of all robots, robot by robot: edges from the spare, with the difference of the two places
    /// that follow from the whole graph (Remark 1).
    pub(super) fn spares(&self, scenario: &Scenario) -> Vec<Edge> {
        // Without places the scenario has errors, and is never run.
        let places = self.after_ns.and_then(|_| places(scenario));
        let Some(places) = places else { return Vec::new() };
        let choice = Choice { scenario, order: order(scenario), places: &places };
        let mut spares = Vec::new();
        for (to, given) in self.given.iter().enumerate() {
            let keeps_place = scenario.robots[to].role.reference == Reference::Offsets;
            let from = given.clone().unwrap_or_else(|| choice.of(to, self.count));
            spares.extend(from.into_iter().map(|from| {
                let offset_m = places[to] - places[from];
                Edge { from, to, offset_m: if keeps_place { offset_m } else { Vec2::zeros() } }
            }));
        }
        spares
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
    if reference.is_its_own() {
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
        if scenario.graph.heard_by(hearer).any(|edge| edge.from == spare) {
            let expected = "expected a robot that it does not hear anyway";
            return wrong(format!("{name} hears {other}, which is to be its spare"), expected);
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

/// What spares are chosen by.
struct Choice<'a> {
    scenario: &'a Scenario,
    order: Vec<Option<(usize, usize)>>,
    /// Where everybody settles, at scale 1, m.
    places: &'a [Vec2],
}

impl Choice<'_> {
    /// At most so many spares for a robot, the best first.
    fn of(&self, to: usize, count: usize) -> Vec<usize> {
        let hears = |from: usize| self.scenario.graph.heard_by(to).any(|edge| edge.from == from);
        let reference = |robot: usize| self.scenario.robots[robot].role.reference;
        // Without a leader, a circle would be one in which velocities never die out.
        let unled = self.scenario.leader().is_none();
        let reached = unled.then(|| self.scenario.graph.hops().swap_remove(to));
        let deputies = &self.scenario.deputies;
        let rank_of = |from: usize| deputies.iter().position(|&deputy| deputy == from);
        let may = |&from: &usize| {
            let fits = reference(to) == Reference::Middle || reference(from) != Reference::Middle;
            let before = self.order[from].is_some()
                && (self.order[from] < self.order[to] || planted::is("circle-of-spares"));
            let reached = reached.as_ref().is_some_and(|reached| reached[from].is_some());
            fits && (before || rank_of(from).is_some()) && from != to && !hears(from) && !reached
        };
        let candidates = (0..self.scenario.robots.len()).filter(may);
        let mut rated: Vec<((usize, u64), usize)> = match reference(to) {
            Reference::Offsets => {
                let distance_m = |from: usize| (self.places[from] - self.places[to]).norm();
                // Without the leader those who heard it go by who leads then.
                let hears_leader = self.scenario.leader().is_some_and(hears);
                let first = |from: usize| match hears_leader {
                    true => rank_of(from).unwrap_or(deputies.len()),
                    false => 0,
                };
                candidates.map(|from| ((first(from), rank(distance_m(from))), from)).collect()
            }
            Reference::Middle => {
                let without = self.without(to, None);
                let rated = candidates.map(|from| (self.without(to, Some(from)), from));
                rated.filter(|(with, _)| *with < without).collect()
            }
            Reference::Trajectory | Reference::Goal => Vec::new(),
        };
        rated.sort_unstable();
        rated.into_iter().take(count).map(|(_, from)| from).collect()
    }

    /// How bad it is for a contained robot to lose one of those it hears and go by this one in its place: after
    /// how many of these losses its place is nearer to another's than robots come to rest (Remark 1), and how far
    /// it moves at most. The others' places are taken to stay.
    fn without(&self, to: usize, spare: Option<usize>) -> (usize, u64) {
        let heard: Vec<usize> = self.scenario.graph.heard_by(to).map(|edge| edge.from).collect();
        let scale = self.scenario.scale().map_or(1.0, |scale| scale.range()[0]);
        let steers_m = |robot: usize| self.scenario.steers_within_m(robot).unwrap_or(0.0);
        let (mut taken, mut moved_m) = (0, 0.0f64);
        for &lost in &heard {
            let left: Vec<usize> =
                heard.iter().copied().filter(|&from| from != lost).chain(spare).collect();
            if left.is_empty() {
                return (usize::MAX, 0);
            }
            let place =
                left.iter().map(|&from| self.places[from]).sum::<Vec2>() / left.len() as f64;
            let mut others = (0..self.places.len()).filter(|&other| other != to && other != lost);
            let near = |other: usize| {
                let apart_m = scale * (self.places[other] - place).norm();
                apart_m < steers_m(to).max(steers_m(other))
            };
            taken += usize::from(others.any(near));
            moved_m = moved_m.max((place - self.places[to]).norm());
        }
        (taken, rank(moved_m))
    }
}

/// A length, m, in micrometers: sums of offsets differ in their last digits from others that are the same.
fn rank(length_m: f64) -> u64 {
    (length_m * 1e6).round() as u64
}
