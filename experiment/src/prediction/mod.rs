//! Prediction of the robots that failures of robots and links break, and of the causes.
//!
//! `phalanx check` and the report of every fault use this prediction. A robot is *broken* if it ends farther than a
//! threshold from its slot in the planned formation. `metrics` measures the broken robots by the same definition,
//! with independent code.
//!
//! | file | question it answers |
//! |---|---|
//! | `surviving_graph` | which in-neighbors remain, which robots stop, and which ones does the leader reach? |
//! | `leader_motion` | does the formation still move, and how fast? |
//! | `edge_failures` | which single failures of links have no effect? |
//! | `slot_conflicts` | which robots have desired positions too close to each other? (Remark 1) |
//! | `broken` | which robots are broken, why, and by how much? |
//!
//! Assumptions: the formation has settled when the fault starts, and the fault is permanent. Slots are compared in the
//! leader's frame (without a leader, in `map`). A moving formation leaves robots behind that stop; in one at rest,
//! robots that stop are in their slots.

mod broken;
mod edge_failures;
mod leader_motion;
mod slot_conflicts;
mod surviving_graph;
#[cfg(test)]
mod tests;

use formation::Vec2;
use formation::laplacian::move_to_settled_positions;
use formation::rewiring::Rewiring;
use protocol::brief::{REPAIR_SPEED_FACTOR, SilencePolicy, YieldPriority};
use protocol::law::Reference;

pub use broken::{
    BreakCause, BrokenPrediction, BrokenRobot, broken_definition_text, lines_by_cause,
};
pub use edge_failures::SingleCutPredictor;
use leader_motion::LeaderMotion;
use slot_conflicts::ConflictResolution;
use surviving_graph::SurvivingGraph;

use crate::scenario::Scenario;
use formation::{ns_to_seconds, portable_math};

/// Predictor of the consequences of failures of robots and links.
#[derive(Debug, Clone)]
pub struct FailurePredictor {
    robots: Vec<RobotProperties>,
    /// In-neighbors, backup neighbors and plans of all robots.
    rewiring: Rewiring,
    /// Main leader.
    leader: Option<usize>,
    /// Backup leaders of the main leader, in order of preference.
    deputies: Vec<usize>,
    /// Planned slot of each robot at scale 1 and heading 0, m.
    planned_slots: Vec<Vec2>,
    /// Motion of the main leader, if there is one.
    leader_motion: Option<LeaderMotion>,
    /// Time for which the beacons of a failed robot are extrapolated, s: until it is lost. Its last beacon is two
    /// periods old when it fails.
    extrapolation_horizon_s: f64,
    /// Time until a backup neighbor replaces a lost in-neighbor, s.
    repair_after_s: f64,
    /// d, minimum distance, m.
    distance_min_m: f64,
    /// Usual and smallest scale.
    usual_and_smallest_scale: [f64; 2],
    /// Threshold for a broken robot: maximum distance from its slot, m.
    broken_threshold_m: f64,
}

/// Properties of one robot.
#[derive(Debug, Clone, Copy)]
struct RobotProperties {
    reference: Reference,
    silence: SilencePolicy,
    /// Distance to another robot below which it does not come to rest, m (Remark 1).
    standoff_m: f64,
    /// Whether the robot yields when its slot is occupied.
    yields: bool,
    /// k of a law whose correction is k tanh, m/s. `None` for other laws.
    gain_m_s: Option<f64>,
    /// Extra standoff distance from other robots while its slot is occupied, as a fraction of `standoff_m` minus the
    /// distance between its slot and the occupying robot.
    standoff_excess: f64,
}

impl FailurePredictor {
    /// Creates the predictor of a scenario, with its `converged_error_m` as the threshold.
    pub fn new(scenario: &Scenario) -> FailurePredictor {
        let steering_distances_m = scenario.steering_distances_m();
        let properties = |i: usize| RobotProperties {
            reference: scenario.robots[i].role.reference,
            silence: scenario.silence.policy,
            standoff_m: steering_distances_m.as_ref().map_or(0.0, |distances_m| distances_m[i]),
            yields: scenario.yield_rank(i) == YieldPriority::Contained,
            gain_m_s: scenario.robots[i].correction_max_m_s,
            standoff_excess: scenario.avoidance_method.standoff_excess,
        };
        let n = scenario.robots.len();
        let mut predictor = FailurePredictor {
            robots: (0..n).map(properties).collect(),
            rewiring: scenario.rewiring(),
            leader: scenario.leader(),
            deputies: scenario.repair_plan.deputies.clone(),
            planned_slots: scenario
                .anchors_m()
                .into_iter()
                .map(Option::unwrap_or_default)
                .collect(),
            leader_motion: LeaderMotion::from_scenario(scenario),
            extrapolation_horizon_s: ns_to_seconds(scenario.silence.lost_after_ns)
                - 2.0 * ns_to_seconds(scenario.period_ns),
            repair_after_s: ns_to_seconds(scenario.repair_after_ns.unwrap_or(0)),
            distance_min_m: scenario.avoidance.distance_min_m,
            usual_and_smallest_scale: scenario
                .scale()
                .map_or([1.0; 2], |scale| [scale.final_or_mean_value(), scale.value_range()[0]]),
            broken_threshold_m: scenario.expectations.converged_error_m,
        };
        let intact = SurvivingGraph::compute(&predictor, &[], &[], false);
        let mut positions = intact.settled_positions(&predictor.planned_slots);
        let (to_settle, _) = intact.robots_to_settle(&predictor);
        // The system is singular only if a robot is reached by no other, which is an error of the scenario.
        if move_to_settled_positions(&intact.in_neighbors, &to_settle, &mut positions).is_some() {
            predictor.planned_slots = positions[..n].to_vec();
        }
        predictor
    }

    /// Sets the threshold for a broken robot, m.
    pub fn with_broken_threshold(self, bound_m: f64) -> FailurePredictor {
        FailurePredictor { broken_threshold_m: bound_m, ..self }
    }

    /// Returns the threshold for a broken robot, m.
    pub fn broken_threshold_m(&self) -> f64 {
        self.broken_threshold_m
    }

    /// Returns the living robots that break, in order of their indices, if the robots `dead` are dead or frozen and the
    /// edges `cut_edges` are down from `t_s` on. With `None`, a leader that ever moves counts as moving.
    pub fn broken_robots(
        &self,
        dead: &[usize],
        cut_edges: &[usize],
        t_s: Option<f64>,
    ) -> Vec<BrokenPrediction> {
        let moving = self.leader_motion.as_ref().is_some_and(|motion| motion.is_moving(t_s));
        let mut surviving = SurvivingGraph::compute(self, dead, cut_edges, moving);
        // Without a living leader or backup leader all robots stop.
        let is_leaderless = self.leader.is_some() && !surviving.is_leading.contains(&true);
        surviving.is_moving &= !is_leaderless;
        let mut causes = surviving.robots_left_behind(self);
        let positions = self.settled_positions(&surviving, &causes);
        let resolution = ConflictResolution::resolve(self, &surviving, &positions, &causes);
        for (i, cause) in
            resolution.causes_of_displacement(self, &surviving).into_iter().enumerate()
        {
            if let Some((cause, distance_m)) = cause {
                let hull_distance_m = resolution.hull_distance_m(self, &surviving, i);
                causes[i] = Some(BrokenPrediction {
                    robot: i,
                    cause,
                    slot_distance_m: Some(distance_m),
                    hull_distance_m,
                });
            }
        }
        if moving && is_leaderless {
            self.mark_overrunning_robots(&mut causes, &surviving, t_s);
        }
        causes.into_iter().flatten().collect()
    }

    /// Returns the time after these failures at which the contained robots have reached their new positions within the
    /// threshold, s. Returns `None` if no contained robot with a failed in-neighbor has a new position.
    ///
    /// The error follows e' = -k tanh(h e) once the failed robots are declared failed. A robot without a failed
    /// in-neighbor stays among its in-neighbors and is no farther off than they are.
    pub fn settling_time_s(&self, dead: &[usize]) -> Option<f64> {
        let surviving = SurvivingGraph::compute(self, dead, &[], false);
        let positions = self.settled_positions(&surviving, &vec![None; self.robots.len()]);
        let settling_s = |i: usize| {
            let moved_m =
                self.usual_and_smallest_scale[0] * (positions[i] - self.planned_slots[i]).norm();
            let contained =
                surviving.is_alive[i] && self.robots[i].reference == Reference::NeighborMean;
            let moves = contained
                && surviving.lost_in_neighbor[i].is_some()
                && moved_m > self.broken_threshold_m;
            let k = self.robots[i].gain_m_s.filter(|_| moves)?;
            let h =
                if self.rewiring.receiver(i).has_repair_plan() { REPAIR_SPEED_FACTOR } else { 1.0 };
            let sinh = |x: f64| (portable_math::exp(x) - portable_math::exp(-x)) / 2.0;
            Some(portable_math::ln(sinh(h * moved_m) / sinh(h * self.broken_threshold_m)) / (h * k))
        };
        let slowest_s = (0..self.robots.len()).filter_map(settling_s).reduce(f64::max)?;
        Some(self.extrapolation_horizon_s + self.repair_after_s + slowest_s)
    }

    /// Returns the maximum error of a robot that keeps a slot, m, after these robots, one of which leads, fail at `t_s`
    /// (`None`: at any time) and until a backup leader leads. Returns `None` if none does.
    ///
    /// A robot that a leader reaches only over backup neighbors stops until these are in use. A robot that passes the
    /// failed leader keeps d from it.
    pub fn peak_error_m(&self, dead: &[usize], t_s: Option<f64>) -> Option<f64> {
        let leader = self.leader.filter(|leader| dead.contains(leader))?;
        let motion = self.leader_motion.as_ref().filter(|_| !self.deputies.is_empty())?;
        let rewiring = self.rewiring.without_repair();
        let surviving = SurvivingGraph::compute(
            &FailurePredictor { rewiring, ..self.clone() },
            dead,
            &[],
            true,
        );
        let leading: Vec<usize> =
            (0..self.robots.len()).filter(|&i| surviving.is_leading[i]).collect();
        if leading.is_empty() {
            return None;
        }
        let is_led = surviving.robots_downstream_of(&leading);
        let mut peak_m = 0.0f64;
        let keeps_slot = |&i: &usize| self.robots[i].reference == Reference::Offsets;
        for i in (0..self.robots.len()).filter(keeps_slot).filter(|i| surviving.is_alive[*i]) {
            let offset_from_leader = self.planned_slots[i] - self.planned_slots[leader];
            if !is_led[i] {
                let lag_m = motion.slot_speed_m_s(offset_from_leader, t_s) * self.repair_after_s;
                peak_m = peak_m.max(lag_m);
            }
            if let Some(t_s) = t_s {
                peak_m = peak_m.max(
                    self.distance_min_m - motion.leader_distance_min_m(offset_from_leader, t_s),
                );
            }
        }
        Some(peak_m)
    }

    /// Marks as broken the robots that move too far at the speed of their slots before they detect the loss of the
    /// leader.
    fn mark_overrunning_robots(
        &self,
        causes: &mut [Option<BrokenPrediction>],
        surviving: &SurvivingGraph,
        t_s: Option<f64>,
    ) {
        let (Some(motion), Some(leader)) = (&self.leader_motion, self.leader) else { return };
        for robot in (0..self.robots.len()).filter(|&i| surviving.is_alive[i]) {
            let overrun_m = motion.slot_speed_m_s(self.planned_slots[robot], t_s)
                * self.extrapolation_horizon_s;
            if overrun_m > self.broken_threshold_m && !self.robots[robot].reference.is_local() {
                let previous = causes[robot];
                let distance_m = previous
                    .and_then(|previous| previous.slot_distance_m)
                    .unwrap_or(0.0)
                    .max(overrun_m);
                let hull_distance_m = previous.and_then(|previous| previous.hull_distance_m);
                let cause = BreakCause::LeaderDead { leader };
                causes[robot] = Some(BrokenPrediction {
                    robot,
                    cause,
                    slot_distance_m: Some(distance_m),
                    hull_distance_m,
                });
            }
        }
    }

    /// Returns the planned slot of a robot, m. Indices from the number of robots on stand for last known positions.
    fn planned_slot(&self, i: usize) -> Vec2 {
        self.planned_slots[i % self.robots.len()]
    }

    /// Returns whether the desired position of robot `i` is its planned slot if `in_neighbors` are in theirs: the mean
    /// of their planned slots plus offsets.
    fn recovers_slot(&self, in_neighbors: &[(usize, Vec2)], i: usize) -> bool {
        let sum: Vec2 =
            in_neighbors.iter().map(|&(from, offset)| self.planned_slot(from) + offset).sum();
        // Without in-neighbors the mean is NaN, and there is no other desired position.
        let error_m = (sum / in_neighbors.len() as f64 - self.planned_slots[i]).norm();
        error_m <= 1e-9 || error_m.is_nan()
    }

    /// Returns the predictions of all single cuts.
    pub fn single_cut_predictor(&self) -> SingleCutPredictor<'_> {
        SingleCutPredictor::new(self)
    }

    /// Returns the positions at which the robots that are not left behind settle, m.
    fn settled_positions(
        &self,
        surviving: &SurvivingGraph,
        left_behind: &[Option<BrokenPrediction>],
    ) -> Vec<Vec2> {
        let mut positions = surviving.settled_positions(&self.planned_slots);
        let (to_settle, closed_groups) = surviving.robots_to_settle(self);
        let is_displaced = |&i: &usize| !self.recovers_slot(&surviving.in_neighbors[i], i);
        let to_settle: Vec<usize> =
            to_settle.into_iter().filter(|&i| left_behind[i].is_none()).collect();
        // A robot whose in-neighbors all keep their positions keeps its own.
        let moved: Vec<usize> = to_settle.iter().copied().filter(is_displaced).collect();
        let moved = surviving.robots_downstream_of(&moved);
        let to_settle: Vec<usize> = to_settle.into_iter().filter(|&i| moved[i]).collect();
        if move_to_settled_positions(&surviving.in_neighbors, &to_settle, &mut positions).is_none()
        {
            return positions;
        }
        // A group without in-edges from outside keeps its mean.
        for group in closed_groups {
            let shift: Vec2 = group.iter().map(|&i| self.planned_slots[i] - positions[i]).sum();
            let shift = shift / group.len() as f64;
            if shift.norm() > 1e-9 {
                let is_downstream = surviving.robots_downstream_of(&group);
                (0..self.robots.len())
                    .filter(|&i| is_downstream[i])
                    .for_each(|i| positions[i] += shift);
            }
        }
        positions
    }
}
