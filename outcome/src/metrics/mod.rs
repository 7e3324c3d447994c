//! Metrics of a run, computed from the ground truth: distances, errors, fault detection and recovery.
//!
//! Every tick is evaluated; nothing is subsampled. This module does no I/O.
//!
//! | file | question it answers |
//! |---|---|
//! | `distance` | how near did each pair of robots come, and when? |
//! | `clearance` | how near did a robot come to a wall, and where? |
//! | `error` | how far is each robot from the target that its role gives it? |
//! | `finals` | what is the maximum over the last part of the run? |
//! | `end` | may the run end before its duration? |
//! | `target` | which target position does its role give a robot? |
//! | `signals` | which values did the control laws record, and what follows for the metrics of the experiment? |
//! | `blocked_robots` | which robots are off their slots at the end, and which robot blocks each? |
//! | `travel` | when did each robot arrive, and how long was its path? |
//! | `ideal` | how far is each robot from its slot in the ideal formation? |
//! | `frame` | how does the ideal formation rotate and scale? |
//! | `containment` | how far are the followers from the leaders' convex hull? |
//! | `fault` | what was the effect of each fault? |
//! | `orphans` | which robots are disconnected from every leader? |
//! | `silence` | which robots and edges are silent by faults, and which robots does that break? |
//! | `expect` | did the expectations of the scenario hold? |
//! | `margin` | by which margin did each expectation hold? |
//! | `summary` | what does `summary.json` contain? |
//! | `truths` | are two runs equal, and are ground-truth samples missing? |
//! | `hash` | how is a trajectory hashed? |

pub mod blocked_robots;
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
pub mod signals;
mod silence;
pub mod summary;
mod target;
mod travel;
mod truths;

use formation::Vec2;
use formation::desired::Target;
use formation::front_point::front_point;
use protocol::brief::Pace;
use protocol::message::{Contact, TruthHeader, TruthRow};
use protocol::signals::SignalValues;

use blocked_robots::BlockDetector;
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
use ideal::IdealErrors;
pub use orphans::OrphanChange;
use signals::Signals;
pub use silence::ReferenceChange;
use summary::Summary;
use travel::Travel;
use truths::Truths;

/// Metrics of a run, updated with every ground-truth sample.
pub struct Metrics {
    is_stopped: bool,
    converged_error_m: f64,
    names: Vec<String>,
    deputies: Vec<usize>,
    front_points_m: Vec<f64>,
    /// Front points at the newest ground-truth sample, m.
    alphas: Vec<Vec2>,
    /// Whether each robot was alive at that sample.
    alive: Vec<bool>,
    truths: Truths,
    distances: Distances,
    /// Name of the wall or obstacle that each convex part belongs to.
    walls: Vec<String>,
    newest: Option<TruthHeader>,
    /// Frame in which the ideal formation rotates and scales.
    frame: IdealFrame,
    errors: Errors,
    travel: Travel,
    waits: BlockDetector,
    ideal: IdealErrors,
    containment: Containment,
    faults: Faults,
    signals: Signals,
    end: EarlyEnd,
}

/// Metrics at the newest ground-truth sample; lists are in scenario order. An empty list says that all its values are
/// unknown.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct CurrentErrors<'a> {
    /// |e_i| with respect to the in-neighbors that each robot receives from, m; `None` for a robot that receives from none.
    pub errors_m: &'a [Option<f64>],
    /// Error vectors e_i of the same errors, m.
    pub errors: &'a [Option<Vec2>],
    /// Distance of each robot from its slot in the ideal formation, m; `None` for a robot without a slot.
    pub ideal_errors_m: &'a [Option<f64>],
    /// Smallest distance between two front points, m, and the indices of both robots; `None` with fewer than two
    /// robots.
    pub nearest: Option<(f64, [usize; 2])>,
    /// Newest value of each signal of each robot, in scenario order and in the order of the laws' declarations.
    pub signals: &'a [signals::Newest],
}

/// Metrics of a complete run: a summary in which only the fields that the metrics determine are set.
pub type Measures = Summary;

impl Metrics {
    /// Creates the metrics of a scenario before the first sample.
    pub fn new(scenario: &Scenario, pace: Pace) -> Metrics {
        let robots = scenario.robots.len();
        let window = Window::for_scenario(scenario);
        Metrics {
            is_stopped: false,
            converged_error_m: scenario.expect.converged_error_m,
            names: scenario.robots.iter().map(|robot| robot.name.clone()).collect(),
            deputies: scenario.repair.deputies.clone(),
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
            waits: BlockDetector::new(scenario),
            ideal: IdealErrors::new(scenario, window),
            containment: Containment::new(scenario, window),
            faults: Faults::new(scenario),
            signals: Signals::new(scenario),
            end: EarlyEnd::for_scenario(scenario),
        }
    }

    /// Stops measuring: later samples are ignored.
    pub fn stop(&mut self) {
        self.is_stopped = true;
    }

    /// Updates all metrics with one ground-truth sample. `alive` says which robots were alive at it.
    pub fn add_truth(&mut self, header: &TruthHeader, rows: &[TruthRow], alive: &[bool]) {
        if self.is_stopped {
            return;
        }
        let t_ns = header.t_ns;
        while let Some((due_ns, fault, bound)) = self.faults.take_scheduled(t_ns) {
            match bound {
                Bound::Begin => self.begin_fault(fault, due_ns),
                Bound::End(end) => self.end_fault(fault, end, due_ns),
            }
        }
        self.truths.add_truth(header.tick, t_ns, rows);
        self.signals.advance(t_ns);
        self.newest = Some(*header);
        self.alive.clear();
        self.alive.extend_from_slice(alive);
        for ((alpha, row), ell) in self.alphas.iter_mut().zip(rows).zip(&self.front_points_m) {
            *alpha = front_point(row.pose(), *ell);
        }
        let distance_m = self.distances.add_truth(header, &self.alphas);
        let silent = &self.faults.silence;
        let frame = self.frame.add_truth(t_ns, rows, alive);
        let worst_m = self.errors.add_truth(t_ns, &frame, &self.alphas, alive, silent);
        self.travel.add_truth(t_ns, &self.alphas, &self.errors.now_m, alive);
        self.ideal.add_truth(t_ns, &frame, &self.alphas, alive, &self.errors.now_m);
        let bound_m = self.converged_error_m;
        let both = self.errors.now_m.iter().zip(&self.ideal.now_m);
        let beyond = both.zip(alive).map(|((heard, ideal), &alive)| {
            [heard, ideal].map(|error| alive && error.is_some_and(|error| error >= bound_m))
        });
        let converged_since_ns = self.errors.converged_since_ns;
        self.faults.add_truth(t_ns, worst_m, converged_since_ns, beyond, distance_m);
        self.containment.add_truth(t_ns, &self.alphas, alive, &self.faults.silence);
        self.end.add_truth(t_ns, converged_since_ns);
    }

    /// Records which robots are alive at the end of the run. A robot may have died shortly before the newest sample
    /// although its death was detected later.
    pub fn mark_alive_at_end(&mut self, alive: &[bool]) {
        self.alive.iter_mut().zip(alive).for_each(|(at_truth, at_end)| *at_truth &= at_end);
    }

    /// Returns the metrics at the newest ground-truth sample.
    pub fn current(&self) -> CurrentErrors<'_> {
        CurrentErrors {
            errors_m: &self.errors.now_m,
            errors: &self.errors.current_errors,
            ideal_errors_m: &self.ideal.now_m,
            nearest: self.distances.newest_minimum(),
            signals: self.signals.newest(),
        }
    }

    /// Returns whether the run ends early, at the newest ground-truth sample. Later samples do not count.
    pub fn ends_early(&self) -> bool {
        self.end.is_reached()
    }

    /// Returns the run time, ns, before which the run does not end early, as known at the newest sample; `None` if
    /// it never ends early.
    pub fn earliest_end_ns(&self) -> Option<u64> {
        self.end.earliest_end_ns()
    }

    /// Sets a new goal, m, for a robot whose role is to go to goals. From the next sample on, the error is the
    /// distance to this goal.
    pub fn set_goal(&mut self, robot: usize, goal: Vec2) {
        self.errors.set_goal(robot, goal);
        self.travel.drop_path_ratio();
    }

    /// Sets the target that the law of a free robot named at its sample of run time `t_ns`, ns; `None` if it named
    /// none. Errors refer to it from the next ground-truth sample on.
    pub fn set_own_target(&mut self, robot: usize, t_ns: u64, target: Option<Target>) {
        self.errors.set_own_target(robot, t_ns, target);
    }

    /// Adds the signals that a robot's law recorded at its sample of run time `t_ns`, ns. They count from the next
    /// ground-truth sample on.
    pub fn add_signals(&mut self, robot: usize, t_ns: u64, values: SignalValues) {
        self.signals.add(robot, t_ns, values);
    }

    /// Begins the fault of this number.
    pub fn begin_fault(&mut self, fault: usize, t_ns: u64) {
        let within = |error: &Option<f64>| error.is_some_and(|e| e < self.converged_error_m);
        let both = self.errors.now_m.iter().zip(&self.ideal.now_m);
        let within_bound = both.map(|(heard, ideal)| [heard, ideal].map(within));
        self.faults.begin(fault, t_ns, within_bound);
    }

    /// Records the death of a robot that the scenario does not plan. Returns the number of the new fault.
    pub fn record_unplanned_death(&mut self, robot: usize, how: &str, t_ns: u64) -> usize {
        let what = format!("death of {} ({how})", self.names[robot]);
        let silenced = Silenced::Robot(robot);
        let fault =
            self.register_fault(what, Struck { robot: Some(robot), silenced, ..Struck::default() });
        self.begin_fault(fault, t_ns);
        fault
    }

    /// Returns the number that the next registered fault gets.
    pub fn next_fault_number(&self) -> usize {
        self.faults.next_number()
    }

    /// Registers a fault that the scenario does not plan and that is about to begin. Returns its number.
    pub fn register_fault(&mut self, what: String, struck: Struck) -> usize {
        self.faults.register_fault(what, struck)
    }

    /// Ends the fault: what it broke is repaired as far as it ever will be.
    pub fn end_fault(&mut self, fault: usize, end: End, t_ns: u64) {
        self.faults.end(fault, end, t_ns);
    }

    /// Returns the robots that were disconnected from every leader, or connected again, before run time `t_ns`, ns,
    /// and were not returned yet. All faults before `t_ns` must be known.
    pub fn take_orphan_changes_before(&mut self, t_ns: u64) -> Vec<OrphanChange> {
        self.faults.orphans.settle_before(t_ns)
    }

    /// Returns for each robot, in scenario order, whether the changes returned up to now leave it disconnected from
    /// every leader.
    pub fn orphaned(&self) -> &[bool] {
        &self.faults.orphans.orphaned
    }

    /// Records how `hearer` classifies the contact to `neighbor`, and since when. The report may arrive before or
    /// after the fault that it belongs to.
    pub fn record_contact(
        &mut self,
        hearer: usize,
        neighbor: usize,
        contact: Contact,
        since_t_ns: u64,
    ) {
        self.faults.record_contact(Report { hearer, neighbor, contact, since_ns: since_t_ns });
    }

    /// Returns whether this robot is a backup leader (deputy) of the main leader.
    pub fn is_deputy(&self, robot: usize) -> bool {
        self.deputies.contains(&robot)
    }

    /// Announces a change of the in-neighbors that a robot uses, at run time `t_ns`, ns. Earlier faults may still be
    /// unknown.
    pub fn announce_rewiring(&mut self, t_ns: u64, rewiring: ReferenceChange) {
        self.faults.orphans.record_rewiring(t_ns, rewiring);
    }

    /// Applies a change of the in-neighbors that a robot uses. From the next sample on, its error refers to the new
    /// ones.
    pub fn apply_rewiring(&mut self, rewiring: ReferenceChange) {
        self.faults.silence.apply_rewiring(rewiring);
    }

    /// Returns the smallest distance of every pair, and when it occurred.
    pub fn pairs(&self) -> Vec<PairDistance> {
        self.distances.pairs(&self.names)
    }

    /// Returns the metrics of the complete run.
    pub fn finish(&self) -> Measures {
        let by_name = |values: &[Option<f64>]| -> Vec<(String, Option<f64>)> {
            self.names.iter().cloned().zip(values.iter().copied()).collect()
        };
        let closest = self.distances.closest_pair();
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
            final_error_m: by_name(&self.errors.final_errors.by_robot_m(end_ns)),
            final_error_m_max: self.errors.final_errors.max_m(end_ns),
            final_ideal_error_m: by_name(&self.ideal.final_errors.by_robot_m(end_ns)),
            final_ideal_error_m_max: self.ideal.final_errors.max_m(end_ns),
            tracking_error_m_max: self.errors.tracking_m_max(),
            integrated_error_m_s: by_name(&self.errors.integrated_m_s),
            hull_distance_m_max_final: self.containment.final_m_max(end_ns),
            converged_at_s: self.errors.converged_since_ns.map(seconds),
            is_unjudged: !self.errors.is_judged,
            arrived_at_s: by_name(&self.travel.arrived_at_s()),
            path_m: by_name(&self.travel.path_m()),
            path_over_straight: self.travel.path_over_straight(),
            waits: self.waits.blocked_robots(
                &self.alphas,
                &self.errors.current_errors,
                &self.alive,
            ),
            trajectory_hash: self.truths.hash(),
            alive_at_end: living.map(|(name, _)| name.clone()).collect(),
            hash_by_second: self.truths.hash_by_second.clone(),
            truths_lost: self.truths.lost_samples,
            unseen_s: self.truths.unseen_ns.iter().map(|gap| gap.map(seconds)).collect(),
            faults: self.faults.report(&self.names),
            metrics: self.signals.metrics(&self.alive),
            ..Summary::default()
        }
    }
}

#[cfg(test)]
mod tests;
