//! What the truth says about a run: distances, errors, detection and recovery.
//!
//! Every tick counts; nothing is sampled. No I/O in here.
//!
//! | file | question it answers |
//! |---|---|
//! | `error` | how far is each robot from where its role wants it? |
//! | `distance` | how near did every pair come, and when? |
//! | `hash` | are two runs the same? |
//! | `fault` | what did one fault do? |
//! | `expect` | did it go as the scenario expects? |

mod distance;
pub mod error;
pub mod examples;
pub mod expect;
pub mod fault;
pub mod hash;

use std::collections::VecDeque;

use formation::Vec2;
use formation::front_point::front_point;
use formation::hull::hull_distance;
use formation::reachability::Reachability;
use protocol::brief::Pace;
use protocol::message::{Contact, TruthHeader, TruthRow};
use serde::Serialize;

pub use distance::PairDistance;
use distance::{Closest, Distances};
use error::Errors;
use experiment::scenario::{Scenario, Silenced, Struck, seconds};
use fault::{End, FaultReport, FaultWindow};
use hash::TrajectoryHash;

/// Final errors are the worst over this last share of the run.
const FINAL_SHARE: f64 = 0.1;

/// Measures a run as its truths come in.
pub struct Metrics {
    looks_away: bool,
    names: Vec<String>,
    front_points_m: Vec<f64>,
    error: Errors,
    leader: Option<usize>,
    /// Whose convex hull the contained are to be in.
    leaders: Vec<usize>,
    contained: Vec<usize>,
    leaders_alphas: Vec<Vec2>,
    hull_distance_m_max_final: Option<f64>,
    distance_min_m: f64,
    converged_error_m: f64,
    final_from_ns: u64,
    hash: Option<TrajectoryHash>,
    alphas: Vec<Vec2>,
    errors: Vec<Option<f64>>,
    /// Integral of each robot's error over the time it lived, m s.
    integrated_errors_m_s: Vec<Option<f64>>,
    distances: Distances,
    closest: Option<Closest>,
    /// At the newest truth.
    nearest: Option<Closest>,
    violations: u64,
    violations_plant: u64,
    final_errors_m: Vec<Option<f64>>,
    converged_since_ns: Option<u64>,
    truths: u64,
    truths_lost: u64,
    newest_tick: Option<u64>,
    newest_t_ns: Option<u64>,
    faults: Vec<FaultWindow>,
    silent: Silent,
    reachability: Reachability,
    /// What the scenario plans to break: its words, and whom it strikes.
    planned: Vec<(String, Struck)>,
    /// Beginnings and ends of faults that act by the briefs, in order of time, ns.
    scheduled: VecDeque<(u64, usize, Bound)>,
}

/// Who and what is silent now, and by how many faults.
#[derive(Debug, Clone)]
struct Silent {
    robots: Vec<i32>,
    edges: Vec<i32>,
}

impl Silent {
    fn new(scenario: &Scenario) -> Silent {
        let edges = scenario.graph.edges().len();
        Silent { robots: vec![0; scenario.robots.len()], edges: vec![0; edges] }
    }

    fn count(&mut self, silenced: Silenced, by: i32) {
        match silenced {
            Silenced::Nobody => {}
            Silenced::Robot(robot) => self.robots[robot] += by,
            Silenced::Edge(edge) => self.edges[edge] += by,
        }
    }

    /// Whether anything is heard over this edge.
    fn carries(&self, edge: usize, from: usize) -> bool {
        self.robots[from] <= 0 && self.edges[edge] <= 0
    }

    /// Everybody who loses what it goes by.
    fn loses(&self, reachability: &Reachability) -> Vec<usize> {
        let gone = |counts: &[i32]| -> Vec<usize> {
            (0..counts.len()).filter(|&place| counts[place] > 0).collect()
        };
        let loss = reachability.loss(&gone(&self.robots), &gone(&self.edges));
        let lists = [loss.unled, loss.pulled, loss.uncontained, loss.adrift, loss.groups.concat()];
        let mut robots = lists.concat();
        robots.sort_unstable();
        robots.dedup();
        robots
    }
}

/// One end of a fault.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Bound {
    Begin,
    End(End),
}

/// What was measured over a whole run.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Measures {
    /// Smallest distance between two front points, m; `None` for one robot alone.
    pub min_distance_m: Option<f64>,
    /// Between which two.
    pub min_distance_pair: Option<[String; 2]>,
    /// When, s.
    pub min_distance_t_s: Option<f64>,
    /// Ticks (arcs' ends, in real time) at which some pair was nearer than d.
    pub violations: u64,
    /// Worst error over the last 10 % of the run by robot, m; `None` for one that hears nobody or
    /// was dead all that time.
    pub final_error_m: Vec<(String, Option<f64>)>,
    /// The worst of these; `None` if the run did not get that far.
    pub final_error_m_max: Option<f64>,
    /// The same of the main leader alone: how well m(t) is tracked (25).
    pub tracking_error_m_max: Option<f64>,
    /// Integral of the error by robot over the time it lived, m s.
    pub integrated_error_m_s: Vec<(String, Option<f64>)>,
    /// How near every pair came, and when.
    pub pairs: Vec<PairDistance>,
    /// Largest distance of a contained robot from the leaders' convex hull over the last 10 % of
    /// the run, m; `None` where nobody is contained.
    pub hull_distance_m_max_final: Option<f64>,
    /// Since when all living errors stayed below `converged_error_m`, s.
    pub converged_at_s: Option<f64>,
    /// In lockstep.
    pub trajectory_hash: Option<String>,
    /// Truths that never arrived.
    pub truths_lost: u64,
    /// What each fault did.
    pub faults: Vec<FaultReport>,
}

impl Metrics {
    /// Nothing measured yet.
    pub fn new(scenario: &Scenario, pace: Pace) -> Metrics {
        let robots = scenario.robots.len();
        let final_s = scenario.duration_ns as f64 * (1.0 - FINAL_SHARE);
        Metrics {
            looks_away: false,
            names: scenario.robots.iter().map(|robot| robot.name.clone()).collect(),
            front_points_m: scenario.robots.iter().map(|robot| robot.front_point_m).collect(),
            error: Errors::new(scenario),
            leader: scenario.leader(),
            leaders: scenario.leaders(),
            contained: scenario.contained(),
            leaders_alphas: Vec::new(),
            hull_distance_m_max_final: None,
            distance_min_m: scenario.avoidance.distance_min_m,
            converged_error_m: scenario.expect.converged_error_m,
            final_from_ns: final_s as u64,
            hash: (pace == Pace::Lockstep).then(TrajectoryHash::new),
            alphas: vec![Vec2::zeros(); robots],
            errors: vec![None; robots],
            integrated_errors_m_s: vec![None; robots],
            distances: Distances::new(robots),
            closest: None,
            nearest: None,
            violations: 0,
            violations_plant: 0,
            final_errors_m: vec![None; robots],
            converged_since_ns: None,
            truths: 0,
            truths_lost: 0,
            newest_tick: None,
            newest_t_ns: None,
            faults: Vec::new(),
            silent: Silent::new(scenario),
            reachability: scenario.reachability(),
            planned: scenario.faults.iter().map(|fault| fault.kind.struck(scenario)).collect(),
            scheduled: scheduled(scenario),
        }
    }

    /// Measures nothing from here on.
    pub fn look_away(&mut self) {
        self.looks_away = true;
    }

    /// Takes in one truth, and who was alive at it.
    pub fn truth(&mut self, header: &TruthHeader, rows: &[TruthRow], alive: &[bool]) {
        if self.looks_away {
            return;
        }
        while let Some(&(t_ns, fault, bound)) = self.scheduled.front()
            && t_ns <= header.t_ns
        {
            self.scheduled.pop_front();
            match bound {
                Bound::Begin => self.fault_began(fault, t_ns),
                Bound::End(end) => self.fault_ended(fault, end, t_ns),
            }
        }
        let expected = self.newest_tick.map_or(0, |tick| tick + 1);
        self.truths_lost += header.tick.saturating_sub(expected);
        self.newest_tick = Some(header.tick);
        self.truths += 1;
        if let Some(hash) = &mut self.hash {
            hash.update(header.tick, rows);
        }
        for ((alpha, row), ell) in self.alphas.iter_mut().zip(rows).zip(&self.front_points_m) {
            *alpha = front_point(row.pose(), *ell);
        }
        let distance_m = self.measure_distance(header);
        self.measure_errors(header, rows, alive, distance_m);
        self.measure_containment(header, alive);
        self.newest_t_ns = Some(header.t_ns);
    }

    /// The smallest distance since the previous truth, as far as it is known. The plant looks at
    /// the end of every arc and counts from the start, so that neither shorter arcs nor lost
    /// truths hide anything.
    fn measure_distance(&mut self, header: &TruthHeader) -> f64 {
        let now = self.distances.truth(header.t_ns, &self.alphas);
        self.nearest = now;
        let plant = self.distances.seen_by_plant(header);
        for seen in [plant, now].into_iter().flatten() {
            if self.closest.is_none_or(|closest| seen.distance_m < closest.distance_m) {
                self.closest = Some(seen);
            }
        }
        let distance_m = now.map_or(f64::INFINITY, |closest| closest.distance_m);
        self.violations += u64::from(distance_m < self.distance_min_m);
        self.violations_plant = header.violations;
        let news = |closest: &Closest| self.newest_t_ns.is_none_or(|t_ns| closest.t_ns > t_ns);
        plant.filter(news).map_or(distance_m, |closest| distance_m.min(closest.distance_m))
    }

    /// Everybody's error, by role.
    fn measure_errors(
        &mut self,
        header: &TruthHeader,
        rows: &[TruthRow],
        alive: &[bool],
        distance_m: f64,
    ) {
        let t_s = seconds(header.t_ns);
        let frame = self.error.frame(t_s, |leader| rows[leader].heading_rad);
        let since_s = self.newest_t_ns.map_or(0.0, |then_ns| t_s - seconds(then_ns));
        let mut worst: Option<f64> = None;
        for (i, &alive) in alive.iter().enumerate() {
            let error = self.error.of(i, t_s, &frame, &self.alphas, &self.silent);
            let error = error.map(|error| error.norm());
            // NaN would disappear in any maximum and pass as converged.
            let error = error.map(|error| if error.is_nan() { f64::INFINITY } else { error });
            self.errors[i] = error;
            let Some(error) = error.filter(|_| alive) else { continue };
            *self.integrated_errors_m_s[i].get_or_insert(0.0) += error * since_s;
            worst = Some(worst.map_or(error, |worst| worst.max(error)));
            if header.t_ns >= self.final_from_ns {
                let last = &mut self.final_errors_m[i];
                *last = Some(last.map_or(error, |last| last.max(error)));
            }
        }
        let worst = worst.unwrap_or(0.0);
        // Of a formation in which nobody lives there is nothing to say.
        let converged = alive.contains(&true) && worst < self.converged_error_m;
        if !converged {
            self.converged_since_ns = None;
        } else if self.converged_since_ns.is_none() {
            self.converged_since_ns = Some(header.t_ns);
        }
        let bound_m = self.converged_error_m;
        for fault in &mut self.faults {
            let living = self.errors.iter().zip(alive);
            let beyond = living.map(|(error, &alive)| alive && error.is_some_and(|e| e >= bound_m));
            fault.truth(header.t_ns, worst, self.converged_since_ns, beyond, distance_m);
        }
    }

    /// How far outside the leaders' hull the contained are towards the end. (49)
    fn measure_containment(&mut self, header: &TruthHeader, alive: &[bool]) {
        if header.t_ns < self.final_from_ns || self.contained.is_empty() {
            return;
        }
        self.leaders_alphas.clear();
        self.leaders_alphas.extend(self.leaders.iter().map(|&i| self.alphas[i]));
        let living = self.contained.iter().filter(|&&i| alive[i]);
        let outside = living.map(|&i| hull_distance(self.alphas[i], &self.leaders_alphas));
        let worst = self.hull_distance_m_max_final.unwrap_or(0.0);
        self.hull_distance_m_max_final = Some(outside.fold(worst, f64::max));
    }

    /// |e_i| at the newest truth, m, in scenario order; `None` for robots that hear nobody.
    pub fn errors(&self) -> &[Option<f64>] {
        &self.errors
    }

    /// The smallest distance of two front points at the newest truth, m, and their places; `None`
    /// with fewer than two robots.
    pub fn nearest(&self) -> Option<(f64, [usize; 2])> {
        self.nearest.map(|nearest| (nearest.distance_m, nearest.pair))
    }

    /// The fault of this number began.
    pub fn fault_began(&mut self, fault: usize, t_ns: u64) {
        let (what, struck) = self.planned[fault].clone();
        for earlier in &mut self.faults {
            earlier.another_began();
        }
        self.silent.count(struck.silenced, 1);
        let predicted = match struck.silenced {
            Silenced::Nobody => Vec::new(),
            _ => self.silent.loses(&self.reachability),
        };
        let calm =
            self.errors.iter().map(|error| error.is_some_and(|e| e < self.converged_error_m));
        self.faults.push(FaultWindow::new(fault, what, struck, t_ns, predicted, calm));
    }

    /// A robot died, and nobody had planned it; the number of this fault.
    pub fn died_unplanned(&mut self, robot: usize, how: &str, t_ns: u64) -> usize {
        let what = format!("death of {} ({how})", self.names[robot]);
        let silenced = Silenced::Robot(robot);
        let fault = self.new_fault(what, Struck { robot: Some(robot), hearer: None, silenced });
        self.fault_began(fault, t_ns);
        fault
    }

    /// The number of a fault that is not the scenario's, and that is about to begin.
    pub fn new_fault(&mut self, what: String, struck: Struck) -> usize {
        self.planned.push((what, struck));
        self.planned.len() - 1
    }

    /// What the fault broke is whole again, as far as it is ever going to be.
    pub fn fault_ended(&mut self, fault: usize, end: End, t_ns: u64) {
        if let Some(window) = self.faults.iter_mut().find(|window| window.number() == fault) {
            let heard_again = window.ended(end, t_ns);
            self.silent.count(heard_again, -1);
        }
    }

    /// `hearer` says how `neighbor` is heard, and since when.
    pub fn contact(&mut self, hearer: usize, neighbor: usize, contact: Contact, since_t_ns: u64) {
        for fault in &mut self.faults {
            fault.contact(hearer, neighbor, contact, since_t_ns);
        }
    }

    /// What was measured in all.
    pub fn finish(&self) -> Measures {
        let name = |i: usize| self.names[i].clone();
        let by_name = |values: &[Option<f64>]| -> Vec<(String, Option<f64>)> {
            self.names.iter().cloned().zip(values.iter().copied()).collect()
        };
        let final_errors = self.final_errors_m.iter().flatten().copied();
        Measures {
            min_distance_m: self.closest.map(|closest| closest.distance_m),
            min_distance_pair: self.closest.map(|closest| closest.pair.map(name)),
            min_distance_t_s: self.closest.map(|closest| seconds(closest.t_ns)),
            violations: self.violations.max(self.violations_plant),
            final_error_m: by_name(&self.final_errors_m),
            final_error_m_max: final_errors.reduce(f64::max),
            tracking_error_m_max: self.leader.and_then(|leader| self.final_errors_m[leader]),
            integrated_error_m_s: by_name(&self.integrated_errors_m_s),
            pairs: self.distances.pairs(&self.names),
            hull_distance_m_max_final: self.hull_distance_m_max_final,
            converged_at_s: self.converged_since_ns.map(seconds),
            trajectory_hash: self
                .hash
                .as_ref()
                .filter(|_| self.truths > 0)
                .map(TrajectoryHash::finish),
            truths_lost: self.truths_lost,
            faults: self.faults.iter().map(|fault| fault.report(&self.names)).collect(),
        }
    }
}

/// When the faults that act by the briefs, with nobody doing anything, begin and end.
fn scheduled(scenario: &Scenario) -> VecDeque<(u64, usize, Bound)> {
    let mut bounds = Vec::new();
    let faults = scenario.faults.iter().enumerate();
    for (number, fault) in faults.filter(|(_, fault)| fault.kind.acts_by_brief()) {
        bounds.push((fault.at_ns, number, Bound::Begin));
        // What lasts to the end is never going to be any better than it is.
        let (end, t_ns) = match fault.until_ns() {
            Some(until_ns) => (End::Whole, until_ns),
            None => (End::ForGood, fault.at_ns),
        };
        bounds.push((t_ns, number, Bound::End(end)));
    }
    bounds.sort_by_key(|&(t_ns, ..)| t_ns);
    bounds.into()
}

#[cfg(test)]
mod tests;
