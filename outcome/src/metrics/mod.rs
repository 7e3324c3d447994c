//! What the truth says about a run: distances, errors, detection and recovery.
//!
//! Every tick counts; nothing is sampled. No I/O in here.
//!
//! | file | question it answers |
//! |---|---|
//! | `distance` | how near did each two come to each other, and when? |
//! | `clearance` | how near did anybody come to a wall, and where? |
//! | `error` | how far is each robot from where its role wants it? |
//! | `finals` | what is worst towards the end? |
//! | `end` | may it end before its time? |
//! | `target` | where does its role want it? |
//! | `waits` | who is not there at the end, and for whom does it wait? |
//! | `travel` | when did it get there, and by how long a way? |
//! | `ideal` | how far is each robot from its place in the whole formation? |
//! | `frame` | how does that formation turn and grow? |
//! | `vectors` | which way was it off, in a run that is over? |
//! | `containment` | how far are the contained from the leaders' hull? |
//! | `fault` | what did each fault do? |
//! | `orphans` | who is cut off from its leader? |
//! | `silence` | who is silent by faults, and whom does that break? |
//! | `expect` | did it go as the scenario expects? |
//! | `margin` | how far was that from going otherwise? |
//! | `summary` | what came out, as it is written and read? |
//! | `truths` | are two runs the same, and is any truth missing? |
//! | `hash` | how does a trajectory become one word? |

mod clearance;
mod containment;
mod distance;
mod end;
mod error;
pub mod examples;
pub mod expect;
pub mod fault;
mod finals;
mod frame;
pub mod hash;
mod ideal;
pub mod margin;
mod orphans;
mod silence;
pub mod summary;
mod target;
mod travel;
mod truths;
pub mod vectors;
pub mod waits;

use formation::Vec2;
use formation::front_point::front_point;
use protocol::brief::Pace;
use protocol::message::{Contact, TruthHeader, TruthRow};

pub use clearance::Clearance;
use containment::Containment;
use distance::Distances;
pub use distance::PairDistance;
use end::EarlyEnd;
use error::Errors;
use experiment::scenario::{Scenario, Silenced, Struck};
use fault::{Bound, End, Faults, Report};
use finals::Window;
use formation::seconds;
use frame::IdealFrame;
use ideal::Ideal;
pub use orphans::Turn;
pub use silence::Rewiring;
use summary::Summary;
use travel::Travel;
use truths::Truths;
use waits::Waits;

/// Measures a run as its truths come in.
pub struct Metrics {
    looks_away: bool,
    converged_error_m: f64,
    names: Vec<String>,
    deputies: Vec<usize>,
    front_points_m: Vec<f64>,
    /// Front points at the newest truth.
    alphas: Vec<Vec2>,
    /// Who was alive at it.
    alive: Vec<bool>,
    truths: Truths,
    distances: Distances,
    /// Which wall or obstacle each convex part belongs to.
    walls: Vec<String>,
    newest: Option<TruthHeader>,
    /// What the formation turns and grows with.
    frame: IdealFrame,
    errors: Errors,
    travel: Travel,
    waits: Waits,
    ideal: Ideal,
    containment: Containment,
    faults: Faults,
    end: EarlyEnd,
}

/// What is known at the newest truth; lists in scenario order.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct Now<'a> {
    /// |e_i|, by those that each robot hears, m; `None` for robots that hear nobody.
    pub errors_m: &'a [Option<f64>],
    /// How far each is from its place in the ideal formation, m; `None` where it has none.
    pub ideal_errors_m: &'a [Option<f64>],
    /// The smallest distance of two front points, m, and their places; `None` with fewer than two
    /// robots.
    pub nearest: Option<(f64, [usize; 2])>,
}

/// What was measured over a whole run: its summary, in which what else a run leaves is not known yet.
pub type Measures = Summary;

impl Metrics {
    /// Nothing measured yet.
    pub fn new(scenario: &Scenario, pace: Pace) -> Metrics {
        let robots = scenario.robots.len();
        let window = Window::of(scenario);
        Metrics {
            looks_away: false,
            converged_error_m: scenario.expect.converged_error_m,
            names: scenario.robots.iter().map(|robot| robot.name.clone()).collect(),
            deputies: scenario.deputies.clone(),
            front_points_m: scenario.robots.iter().map(|robot| robot.front_point_m).collect(),
            alphas: vec![Vec2::zeros(); robots],
            alive: vec![true; robots],
            truths: Truths::new(pace),
            distances: Distances::new(robots, scenario.avoidance.distance_min_m),
            walls: scenario.walls.iter().map(|wall| wall.name.clone()).collect(),
            newest: None,
            frame: IdealFrame::new(scenario),
            errors: Errors::new(scenario, window),
            travel: Travel::new(scenario),
            waits: Waits::new(scenario),
            ideal: Ideal::new(scenario, window),
            containment: Containment::new(scenario, window),
            faults: Faults::new(scenario),
            end: EarlyEnd::of(scenario),
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
        let t_ns = header.t_ns;
        while let Some((due_ns, fault, bound)) = self.faults.take_scheduled(t_ns) {
            match bound {
                Bound::Begin => self.fault_began(fault, due_ns),
                Bound::End(end) => self.fault_ended(fault, end, due_ns),
            }
        }
        self.truths.truth(header.tick, t_ns, rows);
        self.newest = Some(*header);
        self.alive.clear();
        self.alive.extend_from_slice(alive);
        for ((alpha, row), ell) in self.alphas.iter_mut().zip(rows).zip(&self.front_points_m) {
            *alpha = front_point(row.pose(), *ell);
        }
        let distance_m = self.distances.truth(header, &self.alphas);
        let silent = &self.faults.silent;
        let frame = self.frame.truth(t_ns, rows, alive);
        let worst_m = self.errors.truth(t_ns, &frame, &self.alphas, alive, silent);
        self.travel.truth(t_ns, &self.alphas, &self.errors.now_m, alive);
        self.ideal.truth(t_ns, &frame, &self.alphas, alive, &self.errors.now_m);
        let bound_m = self.converged_error_m;
        let both = self.errors.now_m.iter().zip(&self.ideal.now_m);
        let beyond = both.zip(alive).map(|((heard, ideal), &alive)| {
            [heard, ideal].map(|error| alive && error.is_some_and(|error| error >= bound_m))
        });
        let calm_since_ns = self.errors.converged_since_ns;
        self.faults.truth(t_ns, worst_m, calm_since_ns, beyond, distance_m);
        self.containment.truth(t_ns, &self.alphas, alive, &self.faults.silent);
        self.end.truth(t_ns, calm_since_ns);
    }

    /// Takes in which robots are alive at the end of the run. A robot may have died shortly before the newest truth,
    /// and its death have been noticed only after it.
    pub fn ends_with(&mut self, alive: &[bool]) {
        self.alive.iter_mut().zip(alive).for_each(|(at_truth, at_end)| *at_truth &= at_end);
    }

    /// What is known at the newest truth.
    pub fn now(&self) -> Now<'_> {
        Now {
            errors_m: &self.errors.now_m,
            ideal_errors_m: &self.ideal.now_m,
            nearest: self.distances.nearest(),
        }
    }

    /// Whether the run ends before its time, at the newest truth: nothing after it counts.
    pub fn ends_early(&self) -> bool {
        self.end.has_come()
    }

    /// Before this run time, ns, it does not end early, as far as is known at the newest truth; `None`: it
    /// never does.
    pub fn no_early_end_before_ns(&self) -> Option<u64> {
        self.end.not_before_ns()
    }

    /// A robot that goes to goals was sent to another one, m: from the next truth on its error is the distance
    /// from there.
    pub fn sent(&mut self, robot: usize, goal: Vec2) {
        self.errors.send(robot, goal);
        self.travel.sent();
    }

    /// The fault of this number began.
    pub fn fault_began(&mut self, fault: usize, t_ns: u64) {
        let within = |error: &Option<f64>| error.is_some_and(|e| e < self.converged_error_m);
        let both = self.errors.now_m.iter().zip(&self.ideal.now_m);
        let calm = both.map(|(heard, ideal)| [heard, ideal].map(within));
        self.faults.began(fault, t_ns, calm);
    }

    /// A robot died, and nobody had planned it; the number of this fault.
    pub fn died_unplanned(&mut self, robot: usize, how: &str, t_ns: u64) -> usize {
        let what = format!("death of {} ({how})", self.names[robot]);
        let silenced = Silenced::Robot(robot);
        let fault =
            self.new_fault(what, Struck { robot: Some(robot), silenced, ..Struck::default() });
        self.fault_began(fault, t_ns);
        fault
    }

    /// The number that the next fault gets which is not the scenario's.
    pub fn next_fault(&self) -> usize {
        self.faults.next()
    }

    /// The number of a fault that is not the scenario's, and that is about to begin.
    pub fn new_fault(&mut self, what: String, struck: Struck) -> usize {
        self.faults.new_fault(what, struck)
    }

    /// What the fault broke is whole again, as far as it is ever going to be.
    pub fn fault_ended(&mut self, fault: usize, end: End, t_ns: u64) {
        self.faults.ended(fault, end, t_ns);
    }

    /// Everything before this run time, ns, is known, but for what was told already: who was cut off
    /// from its leader since, and whom one reaches again.
    pub fn orphans_before(&mut self, t_ns: u64) -> Vec<Turn> {
        self.faults.orphans.settle_before(t_ns)
    }

    /// Who is cut off from its leader, as far as it was told; in scenario order.
    pub fn orphaned(&self) -> &[bool] {
        &self.faults.orphans.orphaned
    }

    /// `hearer` says how `neighbor` is heard, and since when: before or after the fault is told that
    /// this is about.
    pub fn contact(&mut self, hearer: usize, neighbor: usize, contact: Contact, since_t_ns: u64) {
        self.faults.contact(Report { hearer, neighbor, contact, since_ns: since_t_ns });
    }

    /// Whether this robot may lead in the main leader's place.
    pub fn is_deputy(&self, robot: usize) -> bool {
        self.deputies.contains(&robot)
    }

    /// By whom a robot goes changes at this time, ns: before all up to then is known.
    pub fn rewiring_announced(&mut self, t_ns: u64, rewiring: Rewiring) {
        self.faults.orphans.rewired(t_ns, rewiring);
    }

    /// By whom a robot goes has changed: from the next truth on its error is measured by those.
    pub fn rewired(&mut self, rewiring: Rewiring) {
        self.faults.silent.rewire(rewiring);
    }

    /// How near every pair came, and when.
    pub fn pairs(&self) -> Vec<PairDistance> {
        self.distances.pairs(&self.names)
    }

    /// What was measured in all.
    pub fn finish(&self) -> Measures {
        let by_name = |values: &[Option<f64>]| -> Vec<(String, Option<f64>)> {
            self.names.iter().cloned().zip(values.iter().copied()).collect()
        };
        let closest = self.distances.closest();
        let living = self.names.iter().zip(&self.alive).filter(|(_, alive)| **alive);
        let end_ns = self.end.newest_t_ns;
        Summary {
            t_s: seconds(end_ns),
            ended_early: self.ends_early(),
            min_distance_m: closest.map(|closest| closest.distance_m),
            min_distance_pair: closest
                .map(|closest| closest.pair.map(|robot| self.names[robot].clone())),
            min_distance_t_s: closest.map(|closest| seconds(closest.t_ns)),
            violations: self.distances.violations(),
            min_clearance: self
                .newest
                .and_then(|header| Clearance::seen_by_plant(&header, &self.names, &self.walls)),
            clearance_violations: self.newest.map_or(0, |header| header.clearance_violations),
            final_error_m: by_name(&self.errors.finals.by_robot_m(end_ns)),
            final_error_m_max: self.errors.finals.max_m(end_ns),
            final_ideal_error_m: by_name(&self.ideal.finals.by_robot_m(end_ns)),
            final_ideal_error_m_max: self.ideal.finals.max_m(end_ns),
            tracking_error_m_max: self.errors.tracking_m_max(),
            integrated_error_m_s: by_name(&self.errors.integrated_m_s),
            hull_distance_m_max_final: self.containment.final_m_max(end_ns),
            converged_at_s: self.errors.converged_since_ns.map(seconds),
            arrived_at_s: by_name(&self.travel.arrived_at_s()),
            path_m: by_name(&self.travel.path_m()),
            path_over_straight: self.travel.path_over_straight(),
            waits: self.waits.at(&self.alphas, &self.errors.now, &self.alive),
            trajectory_hash: self.truths.hash(),
            alive_at_end: living.map(|(name, _)| name.clone()).collect(),
            hash_by_second: self.truths.hash_by_second.clone(),
            truths_lost: self.truths.lost,
            unseen_s: self.truths.unseen_ns.iter().map(|gap| gap.map(seconds)).collect(),
            faults: self.faults.report(&self.names),
            ..Summary::default()
        }
    }
}

#[cfg(test)]
mod tests;
