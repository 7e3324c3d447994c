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
//! | `program_output` | which metrics did a program print? |
//! | `pending` | which reported values count at a ground-truth sample? |
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
pub(crate) mod pending;
pub mod program_output;
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
use protocol::message::{ReceptionState, TruthHeader, TruthRow};
use protocol::signals::SignalValues;

use blocked_robots::BlockDetector;
pub use clearance::Clearance;
use containment::Containment;
use distance::Distances;
pub use distance::PairDistance;
use end::EarlyEndCondition;
use error::FormationErrors;
use experiment::scenario::{AffectedComponent, Scenario, SilencedSource};
use fault::{FaultBound, FaultEnd, Faults, ReceptionReport};
use finals::FinalWindow;
use formation::ns_to_seconds;
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
    front_point_offsets_m: Vec<f64>,
    /// Front points at the newest ground-truth sample, m.
    front_points: Vec<Vec2>,
    /// Whether each robot was alive at that sample.
    alive: Vec<bool>,
    truths: Truths,
    distances: Distances,
    /// Name of the wall or obstacle that each convex part belongs to.
    wall_names: Vec<String>,
    newest_header: Option<TruthHeader>,
    /// Frame in which the ideal formation rotates and scales.
    ideal_frame: IdealFrame,
    errors: FormationErrors,
    travel: Travel,
    block_detector: BlockDetector,
    ideal_errors: IdealErrors,
    containment: Containment,
    faults: Faults,
    signals: Signals,
    early_end: EarlyEndCondition,
}

/// Metrics at the newest ground-truth sample; lists are in scenario order. An empty list means that all its values are
/// unknown.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct CurrentMetrics<'a> {
    /// |e_i| with respect to the in-neighbors that each robot receives from, m; `None` for a robot that receives from none.
    pub errors_m: &'a [Option<f64>],
    /// Error vectors e_i of the same errors, m.
    pub error_vectors: &'a [Option<Vec2>],
    /// Distance of each robot from its slot in the ideal formation, m; `None` for a robot without a slot.
    pub ideal_errors_m: &'a [Option<f64>],
    /// Smallest distance between two front points, m, and the indices of both robots; `None` with fewer than two
    /// robots.
    pub nearest_pair: Option<(f64, [usize; 2])>,
    /// Newest value of each signal of each robot, in scenario order and in the order of the laws' declarations.
    pub signals: &'a [signals::NewestValue],
}

/// Metrics of a complete run: a summary in which only the fields that the metrics determine are set.
pub type RunMetrics = Summary;

impl Metrics {
    /// Creates the metrics of a scenario before the first sample.
    pub fn new(scenario: &Scenario, pace: Pace) -> Metrics {
        let robots = scenario.robots.len();
        let window = FinalWindow::for_scenario(scenario);
        Metrics {
            is_stopped: false,
            converged_error_m: scenario.expectations.converged_error_m,
            names: scenario.robots.iter().map(|robot| robot.name.clone()).collect(),
            deputies: scenario.repair_plan.deputies.clone(),
            front_point_offsets_m: scenario
                .robots
                .iter()
                .map(|robot| robot.front_point_m)
                .collect(),
            front_points: vec![Vec2::zeros(); robots],
            alive: vec![true; robots],
            truths: Truths::new(pace),
            distances: Distances::new(
                robots,
                scenario.avoidance.distance_min_m,
                scenario.different_sizes_m(),
            ),
            wall_names: scenario.walls.iter().map(|wall| wall.name.clone()).collect(),
            newest_header: None,
            ideal_frame: IdealFrame::new(scenario),
            errors: FormationErrors::new(scenario, window),
            travel: Travel::new(scenario),
            block_detector: BlockDetector::new(scenario),
            ideal_errors: IdealErrors::new(scenario, window),
            containment: Containment::new(scenario, window),
            faults: Faults::new(scenario),
            signals: Signals::new(scenario),
            early_end: EarlyEndCondition::for_scenario(scenario),
        }
    }

    /// Omits the smallest distances of all pairs ([`Metrics::pair_distances`]), and measures only that of the closest
    /// pair, which is faster.
    pub fn without_pair_distances(mut self) -> Metrics {
        self.distances.measure_only_closest_pair();
        self
    }

    /// Stops measuring: later samples are ignored.
    pub fn stop_measuring(&mut self) {
        self.is_stopped = true;
    }

    /// Updates all metrics with one ground-truth sample. `alive` holds which robots were alive at that sample.
    pub fn add_truth(&mut self, header: &TruthHeader, rows: &[TruthRow], alive: &[bool]) {
        if self.is_stopped {
            return;
        }
        let t_ns = header.t_ns;
        while let Some((due_ns, fault, bound)) = self.faults.take_scheduled_bound(t_ns) {
            match bound {
                FaultBound::Begin => self.begin_fault(fault, due_ns),
                FaultBound::End(end) => self.end_fault(fault, end, due_ns),
            }
        }
        self.truths.add_truth(header.tick, t_ns, rows);
        self.signals.apply_values_before(t_ns);
        self.newest_header = Some(*header);
        self.alive.clear();
        self.alive.extend_from_slice(alive);
        for ((alpha, row), ell) in
            self.front_points.iter_mut().zip(rows).zip(&self.front_point_offsets_m)
        {
            *alpha = front_point(row.pose(), *ell);
        }
        let distance_m = self.distances.add_truth(header, &self.front_points);
        let silence = &self.faults.silence;
        let frame = self.ideal_frame.add_truth(t_ns, rows, alive);
        let worst_m = self.errors.add_truth(t_ns, &frame, &self.front_points, alive, silence);
        self.travel.add_truth(t_ns, &self.front_points, &self.errors.current_errors_m, alive);
        self.ideal_errors.add_truth(
            t_ns,
            &frame,
            &self.front_points,
            alive,
            &self.errors.current_errors_m,
        );
        let bound_m = self.converged_error_m;
        let errors = self.errors.current_errors_m.iter().zip(&self.ideal_errors.current_errors_m);
        let beyond_bound = errors.zip(alive).map(|((error, ideal_error), &alive)| {
            [error, ideal_error].map(|error| alive && error.is_some_and(|error| error >= bound_m))
        });
        let converged_since_ns = self.errors.converged_since_ns;
        self.faults.add_truth(t_ns, worst_m, converged_since_ns, beyond_bound, distance_m);
        self.containment.add_truth(t_ns, &self.front_points, alive, &self.faults.silence);
        self.early_end.add_truth(t_ns, converged_since_ns);
    }

    /// Records which robots are alive at the end of the run. A robot may have died shortly before the newest sample
    /// although its death was detected later.
    pub fn mark_alive_at_end(&mut self, alive: &[bool]) {
        self.alive.iter_mut().zip(alive).for_each(|(at_truth, at_end)| *at_truth &= at_end);
    }

    /// Returns the metrics at the newest ground-truth sample.
    pub fn current_metrics(&self) -> CurrentMetrics<'_> {
        CurrentMetrics {
            errors_m: &self.errors.current_errors_m,
            error_vectors: &self.errors.current_error_vectors,
            ideal_errors_m: &self.ideal_errors.current_errors_m,
            nearest_pair: self.distances.newest_min_distance(),
            signals: self.signals.newest_values(),
        }
    }

    /// Returns whether the run ends early, at the newest ground-truth sample. Later samples do not count.
    pub fn ends_early(&self) -> bool {
        self.early_end.is_reached()
    }

    /// Returns the run time, ns, before which the run does not end early, as known at the newest sample; `None` if
    /// it never ends early.
    pub fn earliest_end_ns(&self) -> Option<u64> {
        self.early_end.earliest_end_ns()
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
        self.signals.add_values(robot, t_ns, values);
    }

    /// Begins the fault of this number.
    pub fn begin_fault(&mut self, fault: usize, t_ns: u64) {
        let within = |error: &Option<f64>| error.is_some_and(|e| e < self.converged_error_m);
        let errors = self.errors.current_errors_m.iter().zip(&self.ideal_errors.current_errors_m);
        let within_bound = errors.map(|(error, ideal_error)| [error, ideal_error].map(within));
        self.faults.begin_fault(fault, t_ns, within_bound);
    }

    /// Records the death of a robot that the scenario does not plan. Returns the number of the new fault.
    pub fn record_unplanned_death(&mut self, robot: usize, cause: &str, t_ns: u64) -> usize {
        let what = format!("death of {} ({cause})", self.names[robot]);
        let silenced_source = SilencedSource::Robot(robot);
        let fault = self.register_fault(
            what,
            AffectedComponent {
                robot: Some(robot),
                silenced_source,
                ..AffectedComponent::default()
            },
        );
        self.begin_fault(fault, t_ns);
        fault
    }

    /// Returns the number that the next registered fault gets.
    pub fn next_fault_number(&self) -> usize {
        self.faults.next_fault_number()
    }

    /// Registers a fault that the scenario does not plan and that is about to begin. Returns its number.
    pub fn register_fault(&mut self, what: String, affected: AffectedComponent) -> usize {
        self.faults.register_fault(what, affected)
    }

    /// Ends the fault: what it broke is repaired as far as it ever will be.
    pub fn end_fault(&mut self, fault: usize, end: FaultEnd, t_ns: u64) {
        self.faults.end_fault(fault, end, t_ns);
    }

    /// Returns the robots that were disconnected from every leader, or connected again, before run time `t_ns`, ns,
    /// and were not returned yet. All faults before `t_ns` must be known.
    pub fn take_orphan_changes_before(&mut self, t_ns: u64) -> Vec<OrphanChange> {
        self.faults.orphans.apply_changes_before(t_ns)
    }

    /// Returns for each robot, in scenario order, whether the changes returned up to now leave it disconnected from
    /// every leader.
    pub fn orphaned_robots(&self) -> &[bool] {
        &self.faults.orphans.is_orphaned
    }

    /// Records the reception state of `neighbor` at `receiver`, and its start time. The report may arrive before or
    /// after the fault that it belongs to.
    pub fn record_reception(
        &mut self,
        receiver: usize,
        neighbor: usize,
        reception_state: ReceptionState,
        since_ns: u64,
    ) {
        self.faults.record_reception(ReceptionReport {
            receiver,
            neighbor,
            reception_state,
            since_ns,
        });
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

    /// Returns the smallest distance of every pair, and when it occurred. Empty after
    /// [`Metrics::without_pair_distances`].
    pub fn pair_distances(&self) -> Vec<PairDistance> {
        self.distances.pair_distances(&self.names)
    }

    /// Returns the metrics of the complete run.
    pub fn finish(&self) -> RunMetrics {
        let by_name = |values: &[Option<f64>]| -> Vec<(String, Option<f64>)> {
            self.names.iter().cloned().zip(values.iter().copied()).collect()
        };
        let closest = self.distances.closest_pair();
        let alive_names = self.names.iter().zip(&self.alive).filter(|(_, alive)| **alive);
        let end_ns = self.early_end.newest_t_ns;
        Summary {
            t_s: ns_to_seconds(end_ns),
            ended_early: self.ends_early(),
            min_distance_m: closest.map(|closest| closest.distance_m),
            min_distance_pair: closest
                .map(|closest| closest.pair.map(|robot| self.names[robot].clone())),
            min_distance_t_s: closest.map(|closest| ns_to_seconds(closest.t_ns)),
            min_distance_over_d: self.distances.smallest_over_d(),
            violations: self.distances.violations(),
            min_clearance: self.newest_header.and_then(|header| {
                Clearance::from_plant_header(&header, &self.names, &self.wall_names)
            }),
            clearance_violations: self
                .newest_header
                .map_or(0, |header| header.clearance_violations),
            final_error_m: by_name(&self.errors.final_errors.errors_by_robot_m(end_ns)),
            final_error_m_max: self.errors.final_errors.error_m_max(end_ns),
            final_ideal_error_m: by_name(&self.ideal_errors.final_errors.errors_by_robot_m(end_ns)),
            final_ideal_error_m_max: self.ideal_errors.final_errors.error_m_max(end_ns),
            tracking_error_m_max: self.errors.final_tracking_error_m_max(),
            integrated_error_m_s: by_name(&self.errors.error_integrals_m_s),
            hull_distance_m_max_final: self.containment.final_distance_m_max(end_ns),
            converged_at_s: self.errors.converged_since_ns.map(ns_to_seconds),
            is_unjudged: !self.errors.is_evaluated,
            arrived_at_s: by_name(&self.travel.arrival_times_s()),
            path_m: by_name(&self.travel.path_lengths_m()),
            path_over_straight: self.travel.path_ratio(),
            waits: self.block_detector.find_blocked_robots(
                &self.front_points,
                &self.errors.current_error_vectors,
                &self.alive,
            ),
            trajectory_hash: self.truths.hash(),
            alive_at_end: alive_names.map(|(name, _)| name.clone()).collect(),
            hash_by_second: self.truths.hash_by_second.clone(),
            truths_lost: self.truths.lost_samples,
            unseen_s: self
                .truths
                .unseen_periods_ns
                .iter()
                .map(|gap| gap.map(ns_to_seconds))
                .collect(),
            faults: self.faults.report(&self.names),
            metrics: self.signals.compute_metrics(&self.alive),
            ..Summary::default()
        }
    }
}

#[cfg(test)]
mod tests;
