//! Backup neighbors of robots that lose in-neighbors: as the file gives them, or chosen.
//!
//! A contained robot has no offsets, so each replacement moves its position and those of the robots that use it. Its
//! replacements are therefore planned for each failure, together for all robots that receive from the failed one, see
//! [`SpareChooser::plan_substitutes`], and so that the plans of two failures are compatible, see
//! [`SpareChooser::plan_for_pairs`].
//!
//! A backup neighbor chosen for a robot with a slot precedes it in an order: fewer hops from the leader, then earlier
//! in the file. A robot that uses a preceding one is leader-connected as long as that one is. Therefore, as long as the
//! leader is alive and a robot has a backup neighbor for each lost in-neighbor, it is leader-connected, and there is no
//! leaderless cycle of backup neighbors. A backup leader can be a backup neighbor of any robot: it is leader-connected,
//! or leads itself.

use std::collections::BTreeSet;

use formation::Vec2;
use formation::graph::Edge;
use formation::laplacian::move_to_settled_positions;
use formation::rewiring::{PlannedReplacement, RepairPlan, Rewiring, Succession};
use formation::trajectory::Trajectory;
use protocol::law::Reference;

use super::Scenario;
use super::deputies::{parse_deputies, parse_successions};
use super::diagnostic::Diagnostic;
use super::keys;
use super::robots::{NeighborKeys, parse_robot_index};
use super::table::TableReader;
use crate::check::planned_positions;

/// Number of nearest robots outside of the in-neighbors that are considered as replacements for a contained robot.
const NEAREST_CANDIDATES: usize = 5;
/// Maximum number of robots that replace one in-neighbor.
const SUBSTITUTES_MAX: usize = 3;
/// Maximum number of improvement rounds.
const IMPROVEMENT_ROUNDS_MAX: usize = 4;

/// Maximum number of robots for which plans are also optimized for pairs of failures.
const PAIR_PLANNING_ROBOTS_MAX: usize = 16;

/// Returns the backup neighbors and backup leaders, and the time for which an in-neighbor must be lost before it is
/// replaced, ns (`None`: no repair). `scenario` has none of them yet.
pub(super) fn parse_repair(
    root: &TableReader<'_, keys::Root>,
    scenario: &Scenario,
    neighbor_keys: &[NeighborKeys<'_>],
    warnings: &mut Vec<Diagnostic>,
) -> Result<(RepairPlan, Option<u64>), Diagnostic> {
    let deputies = parse_deputies(root, scenario)?;
    let successions = parse_successions(scenario, neighbor_keys)?;
    let leaders = RepairPlan { deputies, successions, ..RepairPlan::default() };
    let config = RepairConfig::read(root, scenario, &leaders, neighbor_keys, warnings)?;
    Ok((config.plan_repair(scenario, leaders), config.repair_after_ns))
}

/// Configuration of topology repair.
struct RepairConfig {
    /// Time for which an in-neighbor must be lost before it is replaced, ns. `None`: no repair.
    repair_after_ns: Option<u64>,
    /// Number of backup neighbors chosen for a robot.
    spares_per_robot: usize,
    /// Backup neighbors that a robot lists itself. `None`: chosen.
    listed_spares: Vec<Option<Vec<usize>>>,
}

impl RepairConfig {
    /// Parses `repair`, `repair_after_s` and `spares`, and the lists of each robot.
    fn read(
        root: &TableReader<'_, keys::Root>,
        scenario: &Scenario,
        leaders: &RepairPlan,
        neighbor_keys: &[NeighborKeys<'_>],
        warnings: &mut Vec<Diagnostic>,
    ) -> Result<RepairConfig, Diagnostic> {
        let is_enabled = root
            .required_value(keys::Root::repair)?
            .parse_word(&[("none", false), ("spares", true)])?;
        let listed_spares = neighbor_keys.iter().enumerate().map(|(receiver, robot_keys)| {
            parse_listed_spares(scenario, leaders, receiver, robot_keys)
        });
        let listed_spares: Vec<Option<Vec<usize>>> = listed_spares.collect::<Result<_, _>>()?;
        let robot_values = neighbor_keys
            .iter()
            .flat_map(|robot_keys| [&robot_keys.spares, &robot_keys.deputies])
            .flatten()
            .cloned();
        let message = "has no effect: nothing is repaired";
        let expected = "expected `repair = \"spares\"`, or no such key";
        let mut unused = [
            root.get(keys::Root::spares).map(|count| count.error_about_key(message, expected)),
            root.get(keys::Root::repair_after_s)
                .map(|after| after.error_about_key(message, expected)),
        ]
        .into_iter()
        .flatten()
        .chain(robot_values.map(|value| value.error_about_key(message, expected)));
        if let Some(unused) = unused.next().filter(|_| !is_enabled) {
            warnings.push(unused.into_warning());
        }
        let repair_after_ns = root.time_ns(keys::Root::repair_after_s)?;
        let spares_per_robot = root.integer(keys::Root::spares)? as usize;
        Ok(RepairConfig {
            repair_after_ns: is_enabled.then_some(repair_after_ns),
            spares_per_robot,
            listed_spares,
        })
    }

    /// Returns the plan: `leaders`, which has the backup leaders only, with the backup neighbors of all robots, if
    /// repair is on. Without repair no robot takes the slot of a secondary leader.
    fn plan_repair(&self, scenario: &Scenario, leaders: RepairPlan) -> RepairPlan {
        if self.repair_after_ns.is_none() {
            return RepairPlan { successions: Vec::new(), ..leaders };
        }
        let (spares, substitutes) = self.choose_spares_and_substitutes(scenario, &leaders);
        RepairPlan { spares, substitutes, ..leaders }
    }

    /// Returns the backup links of all robots, grouped by receiver, and the planned replacements of contained robots.
    /// The offset of a link is the difference of the two slots that follow from the whole graph (Remark 1).
    fn choose_spares_and_substitutes(
        &self,
        scenario: &Scenario,
        leaders: &RepairPlan,
    ) -> (Vec<Edge>, Vec<PlannedReplacement>) {
        // Without slots the scenario has errors and is never run.
        let Some(positions) = planned_positions(scenario) else { return Default::default() };
        let contained = |i: &usize| scenario.robots[*i].role.reference == Reference::NeighborMean;
        let needs_plan = |i: &usize| contained(i) && self.listed_spares[*i].is_none();
        let robots = 0..scenario.robots.len();
        let mut chooser = SpareChooser::new(scenario, leaders, &positions);
        chooser.taken_slot_references =
            robots.clone().map(|i| self.slot_keeping_robots(&chooser, i)).collect();
        let planning: Vec<usize> = robots.clone().filter(needs_plan).collect();
        let mut plans: Vec<Vec<PlannedReplacement>> = robots
            .map(|lost| chooser.plan_substitutes(lost, &planning, self.spares_per_robot))
            .collect();
        if !planning.is_empty() && plans.len() <= PAIR_PLANNING_ROBOTS_MAX {
            for _ in 0..IMPROVEMENT_ROUNDS_MAX {
                if !chooser.plan_for_pairs(&mut plans, self.spares_per_robot) {
                    break;
                }
            }
        }
        let has_substitutes = |planned: &PlannedReplacement| !planned.substitutes.is_empty();
        let substitutes: Vec<PlannedReplacement> =
            plans.into_iter().flatten().filter(has_substitutes).collect();
        let leader_rewiring = {
            let has_offsets = |i: usize| !contained(&i);
            Rewiring::new(&scenario.graph, leaders, has_offsets)
        };
        let mut spares = Vec::new();
        for (to, listed) in self.listed_spares.iter().enumerate() {
            let mut from = match listed {
                Some(listed) => listed.clone(),
                None if contained(&to) => {
                    let planned = substitutes.iter().filter(|planned| planned.robot == to);
                    let substitutes_of_robot =
                        planned.flat_map(|planned| planned.substitutes.iter().copied());
                    let substitutes_of_robot: BTreeSet<usize> = substitutes_of_robot
                        .filter(|&substitutes_of_robot| {
                            !chooser.receives_from(to, substitutes_of_robot)
                        })
                        .collect();
                    substitutes_of_robot.into_iter().collect()
                }
                None => chooser.choose_spares(to, self.spares_per_robot),
            };
            let successions = leader_rewiring.receiver(to).successions();
            for deputy in successions.iter().flat_map(|succession| &succession.deputies) {
                if *deputy != to && !chooser.receives_from(to, *deputy) && !from.contains(deputy) {
                    from.push(*deputy);
                }
            }
            spares.extend(from.into_iter().map(|from| {
                let offset_m = positions[to] - positions[from];
                Edge { from, to, offset_m: if contained(&to) { Vec2::zeros() } else { offset_m } }
            }));
            let (slot_owner, references) = chooser.taken_slot_references[to].clone();
            spares.extend(references.into_iter().map(|from| Edge {
                from,
                to,
                offset_m: positions[slot_owner] - positions[from],
            }));
        }
        (spares, substitutes)
    }

    /// Returns the leader whose slot a backup leader takes, and the robots relative to which it then keeps it: the
    /// in-neighbors of that leader and its backup neighbors, except the backup leader's own in-neighbors.
    fn slot_keeping_robots(
        &self,
        chooser: &SpareChooser<'_>,
        deputy: usize,
    ) -> (usize, Vec<usize>) {
        let mut successions = chooser.backup_leaders.successions.iter();
        let Some(succession) = successions.find(|succession| succession.deputies.contains(&deputy))
        else {
            return (deputy, Vec::new());
        };
        let leader = succession.leader;
        let spares = self.listed_spares[leader].clone();
        let spares = spares.unwrap_or_else(|| chooser.choose_spares(leader, self.spares_per_robot));
        let in_neighbors = chooser.scenario.graph.incoming_edges(leader).map(|edge| edge.from);
        let own_spares = self.listed_spares[deputy].as_deref().unwrap_or_default();
        let references = in_neighbors.chain(spares);
        let references = references
            .filter(|from| !chooser.receives_from(deputy, *from) && !own_spares.contains(from));
        (leader, references.collect())
    }
}

/// Returns the backup neighbors that a robot lists in the file, or `None`.
fn parse_listed_spares(
    scenario: &Scenario,
    leaders: &RepairPlan,
    receiver: usize,
    robot_keys: &NeighborKeys<'_>,
) -> Result<Option<Vec<usize>>, Diagnostic> {
    let Some(list) = &robot_keys.spares else { return Ok(None) };
    let robots = &scenario.robots;
    let name = &robots[receiver].name;
    let reference = robots[receiver].role.reference;
    if reference.is_local() {
        return Err(list.error_at_value(
            format!("{name} has spares, but uses no in-neighbors"),
            "expected no `spares` here: the leader and robots with goals need none",
        ));
    }
    let mut spares: Vec<usize> = Vec::new();
    for value in list.elements("expected a list of names of robots: [\"r2\", \"r3\"]")? {
        let spare = parse_robot_index(&value, robots)?;
        let other = &robots[spare].name;
        let error = |what: String, expected: &str| Err(value.error_at_value(what, expected));
        if spare == receiver {
            return error(format!("{name} is listed as its own spare"), "expected another robot");
        }
        if spares.contains(&spare) {
            return error(format!("{other} is a spare of {name} twice"), "expected it once");
        }
        if scenario.graph.incoming_edges(receiver).any(|edge| edge.from == spare) {
            let expected = "expected a robot that it does not hear";
            return error(format!("{name} already hears its spare {other}"), expected);
        }
        let mut kept_slots = leaders.successions.iter().filter(|succession| {
            let is_spare_edge = |edge: &Edge| edge.from == spare;
            succession.deputies.contains(&receiver)
                && scenario.graph.incoming_edges(succession.leader).any(is_spare_edge)
        });
        if let Some(succession) = kept_slots.next() {
            let leader = &robots[succession.leader].name;
            return error(
                format!(
                    "{name} keeps the slot of {leader} relative to {other}, which cannot be its spare, too"
                ),
                "expected a robot that is no in-neighbor of that leader",
            );
        }
        let contained = robots[spare].role.reference == Reference::NeighborMean;
        if reference == Reference::Offsets && contained {
            return error(
                format!("{name} keeps a slot, but its spare {other} is contained and has none"),
                "expected a robot that leads or keeps a slot (52)",
            );
        }
        spares.push(spare);
    }
    Ok(Some(spares))
}

/// Returns the rank of each robot in the order of choice: hops from the leader (without one, from the first root), then
/// the index in the file. `None` if it is not reached.
fn hop_order(scenario: &Scenario) -> Vec<Option<(usize, usize)>> {
    let first = scenario.leader().or_else(|| scenario.graph.roots().first().copied());
    let hops = first.map(|first| scenario.graph.hop_counts_from(first)).unwrap_or_default();
    hops.into_iter().enumerate().map(|(i, hops)| Some((hops?, i))).collect()
}

/// Cost of a pair of failures that leaves a robot without any in-neighbor, the maximum.
const STRANDED_COST: u64 = 10_000_000;

/// Cost of a plan.
type PlanCost = (u64, u64, usize);

/// Data by which backup neighbors are chosen.
struct SpareChooser<'a> {
    scenario: &'a Scenario,
    /// Backup leaders.
    backup_leaders: &'a RepairPlan,
    hop_order: Vec<Option<(usize, usize)>>,
    /// Settled positions at scale 1, m.
    positions: &'a [Vec2],
    /// Distances at which other robots make each robot steer, m.
    steering_distances_m: Vec<f64>,
    /// For each backup leader, the leader whose slot it takes, and the robots relative to which it then keeps it.
    taken_slot_references: Vec<(usize, Vec<usize>)>,
    /// List of the in-neighbors of each robot.
    in_neighbors: Vec<Vec<usize>>,
    /// For each robot of a leaderless formation, whether its information reaches each other robot. Empty with a leader.
    reachability: Vec<Vec<bool>>,
}

impl<'a> SpareChooser<'a> {
    fn new(
        scenario: &'a Scenario,
        backup_leaders: &'a RepairPlan,
        positions: &'a [Vec2],
    ) -> SpareChooser<'a> {
        let mut in_neighbors = vec![Vec::new(); positions.len()];
        scenario.graph.edges().iter().for_each(|edge| in_neighbors[edge.to].push(edge.from));
        let is_leaderless = scenario.leader().is_none();
        let reachability = if is_leaderless { scenario.graph.reachability() } else { Vec::new() };
        let hop_order = hop_order(scenario);
        SpareChooser {
            scenario,
            backup_leaders,
            hop_order,
            positions,
            steering_distances_m: (scenario.steering_distances_m())
                .unwrap_or_else(|| vec![0.0; positions.len()]),
            taken_slot_references: Vec::new(),
            in_neighbors,
            reachability,
        }
    }

    fn receives_from(&self, to: usize, from: usize) -> bool {
        self.in_neighbors[to].contains(&from)
    }

    fn reference(&self, robot: usize) -> Reference {
        self.scenario.robots[robot].role.reference
    }

    fn precedes(&self, from: usize, to: usize) -> bool {
        self.hop_order[from].is_some() && self.hop_order[from] < self.hop_order[to]
    }

    /// Returns whether `to` may use `from`. In a leaderless formation a cycle is not allowed, because velocity feedback
    /// in it does not decay.
    fn may_use(&self, to: usize, from: usize) -> bool {
        from != to && !self.reachability.get(to).is_some_and(|reached| reached[from])
    }

    /// Chooses at most `count` backup neighbors for a robot with a slot, best first.
    fn choose_spares(&self, to: usize, count: usize) -> Vec<usize> {
        if self.reference(to) != Reference::Offsets {
            return Vec::new();
        }
        let deputies = &self.backup_leaders.deputies;
        let rank_of = |from: usize| deputies.iter().position(|&deputy| deputy == from);
        let is_suitable = |&from: &usize| {
            let is_allowed = self.precedes(from, to) || rank_of(from).is_some();
            is_allowed && self.reference(from) != Reference::NeighborMean
        };
        let candidates = (0..self.scenario.robots.len()).filter(is_suitable);
        let candidates =
            candidates.filter(|&from| !self.receives_from(to, from) && self.may_use(to, from));
        let distance_m = |from: usize| (self.positions[from] - self.positions[to]).norm();
        // After the failure of the leader, its out-neighbors use the robot that leads then.
        let receives_from_leader =
            self.scenario.leader().is_some_and(|leader| self.receives_from(to, leader));
        let priority = |from: usize| match receives_from_leader {
            true => rank_of(from).unwrap_or(deputies.len()),
            false => 0,
        };
        let ranked = candidates
            .map(|from| ((priority(from), to_integer_micrometers(distance_m(from))), from));
        let mut ranked: Vec<((usize, u64), usize)> = ranked.collect();
        ranked.sort_unstable();
        ranked.into_iter().take(count).map(|(_, from)| from).collect()
    }

    /// Plans the replacements, at most `count` each, of the robots in `planning` that receive from `lost`, for its
    /// failure. The plan minimizes the violation of the rest distance (Remark 1), then the displacement of all
    /// positions. One robot's choice is improved after the other until none is better; if some robots are still too
    /// close, two choices at a time. A leader with backup leaders is replaced by them.
    fn plan_substitutes(
        &self,
        lost: usize,
        planning: &[usize],
        count: usize,
    ) -> Vec<PlannedReplacement> {
        if self.backup_leaders.successions.iter().any(|choice| choice.leader == lost) {
            return Vec::new();
        }
        let receives_from_lost = |&&to: &&usize| to != lost && self.receives_from(to, lost);
        let receivers: Vec<usize> = planning.iter().filter(receives_from_lost).copied().collect();
        if receivers.is_empty() {
            return Vec::new();
        }
        let remaining = |to: usize| {
            let in_neighbors = self.in_neighbors[to].iter().copied();
            in_neighbors.filter(|&from| from != lost).collect::<Vec<usize>>()
        };
        let in_neighbors: Vec<Vec<usize>> = (0..self.positions.len()).map(remaining).collect();
        let options = receivers
            .iter()
            .map(|&to| (to, self.candidate_in_neighbors(lost, to, &in_neighbors[to], count)));
        let options: Vec<(usize, Vec<Vec<usize>>)> = options.collect();
        let mut best = (self.plan_cost(&[lost], &in_neighbors), in_neighbors);
        for _ in 0..IMPROVEMENT_ROUNDS_MAX {
            let previous_cost = best.0;
            options.iter().for_each(|choice| {
                self.search_combinations(lost, &[choice], &mut best.1.clone(), &mut best)
            });
            if best.0 == previous_cost {
                break;
            }
        }
        let pairs = options.iter().enumerate();
        let pairs = pairs.flat_map(|(k, choice)| {
            options[k + 1..].iter().map(move |other_choice| [choice, other_choice])
        });
        for pair in pairs {
            if best.0.0 > 0 {
                self.search_combinations(lost, &pair, &mut best.1.clone(), &mut best);
            }
        }
        let planned = receivers.into_iter().map(|robot| {
            let substitutes = best.1[robot].split_off(remaining(robot).len());
            PlannedReplacement { robot, lost_in_neighbor: lost, substitutes }
        });
        planned.collect()
    }

    /// Improves the plans for pairs of failures without making single failures worse. Returns whether a plan changed.
    fn plan_for_pairs(&self, plans: &mut [Vec<PlannedReplacement>], count: usize) -> bool {
        let mut has_improved = false;
        for lost in 0..plans.len() {
            let mut best = self.pair_failure_cost(lost, plans, u64::MAX);
            for k in 0..plans[lost].len() {
                let to = plans[lost][k].robot;
                let in_neighbors = self.scenario.graph.incoming_edges(to).map(|edge| edge.from);
                let remaining: Vec<usize> = in_neighbors.filter(|&from| from != lost).collect();
                for option in self.candidate_in_neighbors(lost, to, &remaining, count) {
                    let substitutes = option[remaining.len()..].to_vec();
                    let previous = std::mem::replace(&mut plans[lost][k].substitutes, substitutes);
                    let cost = self.pair_failure_cost(lost, plans, best.0);
                    if cost < best {
                        (best, has_improved) = (cost, true);
                    } else {
                        plans[lost][k].substitutes = previous;
                    }
                }
            }
        }
        has_improved
    }

    /// Returns the cost of the plans when `lost` fails alone ([`SpareChooser::plan_cost`]) and when it fails together
    /// with each other robot (summed). The pairs are skipped if the cost of the single failure exceeds `worst`.
    fn pair_failure_cost(
        &self,
        lost: usize,
        plans: &[Vec<PlannedReplacement>],
        worst: u64,
    ) -> (u64, u64, u64, usize) {
        let (shortfall, moved, count) =
            self.plan_cost(&[lost], &self.used_in_neighbors(plans, &[lost]));
        if shortfall > worst {
            return (shortfall, 0, 0, 0);
        }
        let others = (0..plans.len()).filter(|&other| other != lost);
        let pairs = others.map(|other| [lost, other]);
        let shortfalls =
            pairs.map(|dead| self.plan_cost(&dead, &self.used_in_neighbors(plans, &dead)).0);
        (shortfall, shortfalls.map(|shortfall| shortfall.min(STRANDED_COST)).sum(), moved, count)
    }

    /// Returns the in-neighbors that each robot uses after these failures.
    fn used_in_neighbors(
        &self,
        plans: &[Vec<PlannedReplacement>],
        dead: &[usize],
    ) -> Vec<Vec<usize>> {
        let used_references = |to: usize| {
            let in_neighbors = self.scenario.graph.incoming_edges(to).map(|edge| edge.from);
            let (silent, mut remaining): (Vec<usize>, Vec<usize>) =
                in_neighbors.partition(|from| dead.contains(from));
            let planned = silent.iter().flat_map(|&lost| &plans[lost]);
            let substitutes = planned
                .filter(|planned| planned.robot == to)
                .flat_map(|planned| &planned.substitutes);
            remaining.extend(substitutes.filter(|substitute| !dead.contains(substitute)));
            let taken_slots = self.taken_slots(dead).filter(|(leader, _)| silent.contains(leader));
            remaining.extend(taken_slots.map(|(_, deputy)| deputy));
            remaining
        };
        (0..plans.len()).map(used_references).collect()
    }

    /// Returns the leaders whose slots are taken after these failures, and the robots that take them.
    fn taken_slots(&self, dead: &[usize]) -> impl Iterator<Item = (usize, usize)> {
        let slot_taker =
            |succession: &Succession| Some((succession.leader, succession.acting_deputy(dead)?));
        self.backup_leaders.successions.iter().filter_map(slot_taker)
    }

    /// Searches all combinations of the robots' options. The best combination is kept in `best`.
    fn search_combinations(
        &self,
        lost: usize,
        choices: &[&(usize, Vec<Vec<usize>>)],
        in_neighbors: &mut [Vec<usize>],
        best: &mut (PlanCost, Vec<Vec<usize>>),
    ) {
        let [(to, options), others @ ..] = choices else {
            let cost = self.plan_cost(&[lost], in_neighbors);
            if cost < best.0 {
                *best = (cost, in_neighbors.to_vec());
            }
            return;
        };
        for option in options {
            in_neighbors[*to].clone_from(option);
            self.search_combinations(lost, others, in_neighbors, best);
        }
    }

    /// Returns the candidate in-neighbor sets of a contained robot that has lost `lost`: the ones in `remaining`, with
    /// up to `count` of these and of the nearest other robots added, possibly twice. Each set has a robot that precedes
    /// `to`.
    fn candidate_in_neighbors(
        &self,
        lost: usize,
        to: usize,
        remaining: &[usize],
        count: usize,
    ) -> Vec<Vec<usize>> {
        let is_leaderless = self.scenario.leader().is_none();
        let is_candidate = |&from: &usize| {
            let is_new = from != lost && !remaining.contains(&from) && self.may_use(to, from);
            let is_new = is_new && !self.taken_slot_references[to].1.contains(&from);
            is_new && (!is_leaderless || self.precedes(from, to))
        };
        let mut others: Vec<usize> = (0..self.positions.len()).filter(is_candidate).collect();
        others.sort_by_key(|&from| {
            to_integer_micrometers((self.positions[from] - self.positions[to]).norm())
        });
        others.truncate(NEAREST_CANDIDATES);
        let candidates = [remaining, &others].concat();
        let mut options = vec![remaining.to_vec()];
        let mut shorter = 0;
        for _ in 0..count.min(SUBSTITUTES_MAX) {
            let end = options.len();
            for k in shorter..end {
                let option = options[k].clone();
                // Candidates in order, so that each set occurs once.
                let last_added = option.get(remaining.len()..).and_then(|more| more.last());
                let from = last_added.and_then(|last_added| {
                    candidates.iter().position(|candidate| candidate == last_added)
                });
                let next = candidates[from.unwrap_or(0)..].iter();
                options.extend(next.map(|&added| [&option[..], &[added]].concat()));
            }
            shorter = end;
        }
        options.retain(|option| option.iter().any(|&from| self.precedes(from, to)));
        options
    }

    /// Returns the cost of these in-neighbors after the failures `dead`: the total violation of the rest distance, then
    /// the total squared displacement, then the number of in-neighbors.
    fn plan_cost(&self, dead: &[usize], in_neighbors: &[Vec<usize>]) -> PlanCost {
        let n = self.positions.len();
        let taken_slots: Vec<(usize, usize)> = self.taken_slots(dead).collect();
        let is_contained = |i: usize| {
            self.reference(i) == Reference::NeighborMean
                && taken_slots.iter().all(|(_, deputy)| *deputy != i)
        };
        let is_moved = |&i: &usize| !dead.contains(&i) && is_contained(i);
        let moved: Vec<usize> = (0..n).filter(is_moved).collect();
        let used_references: Vec<Vec<(usize, Vec2)>> = in_neighbors
            .iter()
            .map(|in_neighbors| in_neighbors.iter().map(|&from| (from, Vec2::zeros())).collect())
            .collect();
        let mut positions = self.positions.to_vec();
        taken_slots.iter().for_each(|&(leader, deputy)| positions[deputy] = self.positions[leader]);
        let is_stranded = moved.iter().any(|&i| in_neighbors[i].is_empty());
        if is_stranded
            || move_to_settled_positions(&used_references, &moved, &mut positions).is_none()
        {
            return (u64::MAX, 0, 0);
        }
        let scale = self.scenario.scale().map_or(1.0, |scale| scale.value_range()[0]);
        let steering_m = |robot: usize| self.steering_distances_m[robot];
        // A moving formation leaves dead robots behind.
        let lead = self.scenario.lead.as_ref();
        let is_at_rest =
            lead.is_none_or(|lead| matches!(lead.trajectory, Trajectory::Still { .. }));
        let (mut shortfall_m, mut moved_m2) = (0.0, 0.0);
        for &i in &moved {
            moved_m2 += (positions[i] - self.positions[i]).norm_squared();
            for j in (0..n).filter(|&j| j != i && (is_at_rest || !dead.contains(&j))) {
                let planned_m = scale * (self.positions[i] - self.positions[j]).norm();
                let required_m = steering_m(i).max(steering_m(j)).min(planned_m);
                shortfall_m += (required_m - scale * (positions[i] - positions[j]).norm()).max(0.0);
            }
        }
        (
            to_integer_micrometers(shortfall_m),
            to_integer_micrometers(moved_m2),
            in_neighbors.iter().map(Vec::len).sum(),
        )
    }
}

/// Returns a length, m, or its square, in integer micrometers (or their square), because sums of offsets differ in
/// their last digits.
fn to_integer_micrometers(length_m: f64) -> u64 {
    (length_m * 1e6).round() as u64
}
