//! Conflicts of robots whose desired positions are too close to each other (Remark 1), and their effect on the robots
//! that follow them.
//!
//! Robots do not come to rest closer than d_f. If two would, a simplified simulation moves all robots from their
//! planned slots toward the new ones: a robot that yields and finds its slot occupied takes a position at the standoff
//! distance; a robot that comes too close is pushed back; a leader stays.

use std::f64::consts::FRAC_PI_2;

use formation::front_point::rotate;
use formation::hull::hull_distance;
use formation::laplacian::move_to_settled_positions;
use formation::{RELATIVE_ROUNDING_ERROR_MAX, Vec2};
use protocol::law::Reference;

use super::{BreakCause, BrokenPrediction, FailurePredictor, SurvivingGraph};

/// Maximum number of steps of the simulation.
const STEPS_MAX: usize = 2000;
/// Fraction of the remaining distance that a robot moves in a step.
const STEP_FRACTION: f64 = 0.2;
/// Maximum step, as a fraction of d_f.
const STEP_MAX_FRACTION: f64 = 0.1;
/// Fraction of the shortfall to d_f by which a robot moves away in a step.
const RETREAT_FRACTION: f64 = 0.25;
/// Speed below which the simulation has converged, m per step.
const CONVERGED_STEP_M: f64 = 1e-7;
/// Margin, m: a slot is occupied if another robot is closer to it than d_f by more than this.
const OCCUPIED_MARGIN_M: f64 = 1e-3;

/// Final positions of all robots after the conflicts are resolved.
#[derive(Debug)]
pub(super) struct ConflictResolution {
    /// Final position of each robot, m.
    final_positions: Vec<Vec2>,
    /// For each robot, `true` if it is not left behind and not free.
    is_present: Vec<bool>,
    /// `true` if a robot had to yield.
    has_yielded: bool,
    /// Alternative final positions, m. In a moving formation, the position of a yielding robot around the robot that
    /// occupies its slot is not determined.
    alternative_positions: Vec<Vec<Vec2>>,
}

impl ConflictResolution {
    /// Resolves the conflicts of robots that would settle at `positions`.
    pub(super) fn resolve(
        p: &FailurePredictor,
        surviving: &SurvivingGraph,
        positions: &[Vec2],
        left_behind: &[Option<BrokenPrediction>],
    ) -> ConflictResolution {
        let n = p.robots.len();
        // A moving formation leaves dead robots behind; in one at rest they stay in their slots.
        let is_present: Vec<bool> = (0..n)
            .map(|i| match surviving.is_alive[i] {
                // The motion of a free robot is unknown: its law decides where it goes.
                _ if p.robots[i].reference == Reference::LawTarget => false,
                true => left_behind[i].is_none(),
                false => !surviving.is_moving,
            })
            .collect();
        let mut resolution = ConflictResolution {
            final_positions: positions.to_vec(),
            is_present,
            has_yielded: false,
            alternative_positions: Vec::new(),
        };
        let yielding = resolution.find_yielding_robots(p, surviving);
        if !yielding.is_empty() {
            resolution.move_yielding_robots(p, surviving, &yielding);
            resolution.has_yielded = true;
            if surviving.is_moving {
                resolution.alternative_positions = resolution.rotate_around_occupants(p, surviving);
            }
        }
        resolution
    }

    /// Returns the positions of all robots with the yielding ones rotated by 90, 180 and 270 degrees around the robots
    /// that occupy their slots.
    fn rotate_around_occupants(
        &self,
        p: &FailurePredictor,
        surviving: &SurvivingGraph,
    ) -> Vec<Vec<Vec2>> {
        let displaced: Vec<(usize, usize)> = (0..p.robots.len())
            .filter(|&i| self.is_present[i] && follows_others(p, surviving, i))
            .filter_map(|i| {
                Some((
                    i,
                    self.robot_in_desired_position(p, i, self.desired_position(surviving, i))?,
                ))
            })
            .collect();
        let displaced_robots: Vec<usize> = displaced.iter().map(|&(i, _)| i).collect();
        let is_downstream = surviving.robots_downstream_of(&displaced_robots);
        let followers: Vec<usize> = (0..p.robots.len())
            .filter(|i| is_downstream[*i] && self.is_present[*i] && !displaced_robots.contains(i))
            .collect();
        let rotated = |quarter_turns: f64| {
            let mut positions = self.final_positions.clone();
            for &(i, occupant) in &displaced {
                let relative_position = rotate(
                    quarter_turns * FRAC_PI_2,
                    self.final_positions[i] - self.final_positions[occupant],
                );
                positions[i] = self.final_positions[occupant] + relative_position;
            }
            move_to_settled_positions(&surviving.in_neighbors, &followers, &mut positions)
                .map(|()| positions)
        };
        [1.0, 2.0, 3.0].into_iter().filter_map(rotated).collect()
    }

    /// Returns the yielding robots that are closer to another robot than the standoff distance and than planned.
    fn find_yielding_robots(&self, p: &FailurePredictor, surviving: &SurvivingGraph) -> Vec<usize> {
        let n = p.robots.len();
        // Two robots in their planned slots have their planned distance. Hence only pairs with a displaced
        // robot are compared.
        let is_displaced: Vec<bool> =
            (0..n).map(|i| self.final_positions[i] != p.planned_slots[i]).collect();
        let displaced: Vec<usize> = (0..n).filter(|&j| is_displaced[j]).collect();
        let mut yielding = Vec::new();
        for i in (0..n).filter(|&i| self.is_present[i]) {
            let all = (if is_displaced[i] { i + 1 } else { n })..n;
            let first_later = displaced.partition_point(|&j| j <= i);
            let displaced_later = if is_displaced[i] { &[] } else { &displaced[first_later..] };
            for j in all.chain(displaced_later.iter().copied()).filter(|&j| self.is_present[j]) {
                let standoff_m = p.robots[i].standoff_m.max(p.robots[j].standoff_m);
                let distance_m = p.usual_and_smallest_scale[1]
                    * (self.final_positions[i] - self.final_positions[j]).norm();
                let planned_distance_m = p.usual_and_smallest_scale[1]
                    * (p.planned_slots[i] - p.planned_slots[j]).norm();
                if distance_m < standoff_m && distance_m < planned_distance_m - CONVERGED_STEP_M {
                    yielding
                        .extend([i, j].into_iter().filter(|&i| follows_others(p, surviving, i)));
                }
            }
        }
        yielding
    }

    /// Moves all affected robots from their old positions toward the desired ones.
    fn move_yielding_robots(
        &mut self,
        p: &FailurePredictor,
        surviving: &SurvivingGraph,
        yielding: &[usize],
    ) {
        let n = p.robots.len();
        let is_affected = surviving.robots_downstream_of(yielding);
        let moves =
            |&i: &usize| self.is_present[i] && is_affected[i] && follows_others(p, surviving, i);
        let movers: Vec<usize> = (0..n).filter(moves).collect();
        movers.iter().for_each(|&i| self.final_positions[i] = p.planned_slots[i]);
        for _ in 0..STEPS_MAX {
            let previous_positions = self.final_positions.clone();
            let step = |&i: &usize| self.next_step(p, surviving, i);
            let steps: Vec<Vec2> = movers.iter().map(step).collect();
            for (&i, step) in movers.iter().zip(&steps) {
                self.final_positions[i] = previous_positions[i] + step;
            }
            if steps.iter().all(|step| step.norm() < CONVERGED_STEP_M) {
                break;
            }
        }
    }

    /// Returns the next step of a robot, m.
    fn next_step(&self, p: &FailurePredictor, surviving: &SurvivingGraph, i: usize) -> Vec2 {
        let position = self.final_positions[i];
        let d_f = p.robots[i].standoff_m / p.usual_and_smallest_scale[1];
        let desired = self.desired_position(surviving, i);
        let occupant = self.robot_in_desired_position(p, i, desired);
        let gap = occupant.map(|j| desired - self.final_positions[j]);
        let d_s = gap.map_or(d_f, |gap| d_f + p.robots[i].standoff_excess * (d_f - gap.norm()));
        let target = occupant.zip(gap).map_or(desired, |(j, gap)| {
            let occupant_position = self.final_positions[j];
            let direction = gap + (d_f - gap.norm()) * unit_vector(position - occupant_position);
            occupant_position + d_s * unit_vector(direction)
        });
        let mut step = STEP_FRACTION * (target - position);
        // A robot farther away than this does not change the step.
        let reach_m2 = |step: Vec2| {
            let reach_m = d_f.max(d_s) + step.norm() / RETREAT_FRACTION;
            reach_m * reach_m * (1.0 + RELATIVE_ROUNDING_ERROR_MAX)
        };
        let mut reached_m2 = reach_m2(step);
        for j in (0..p.robots.len()).filter(|&j| j != i && self.is_present[j]) {
            let separation = position - self.final_positions[j];
            if separation.norm_squared() > reached_m2 {
                continue;
            }
            let normal = unit_vector(separation);
            let distance_min = if occupant == Some(j) { d_f } else { d_s };
            let shortfall =
                RETREAT_FRACTION * (distance_min - separation.norm()) - normal.dot(&step);
            // Around the other robot, unless the desired position is occupied.
            let tangent =
                if occupant.is_some() { Vec2::zeros() } else { Vec2::new(-normal.y, normal.x) };
            if shortfall > 0.0 {
                step += shortfall * (normal + tangent);
                reached_m2 = reach_m2(step);
            }
        }
        let length = step.norm();
        step * (STEP_MAX_FRACTION * d_f / length.max(STEP_MAX_FRACTION * d_f))
    }

    /// Returns the desired position of a robot: the mean of its in-neighbors' positions plus offsets.
    fn desired_position(&self, surviving: &SurvivingGraph, i: usize) -> Vec2 {
        let in_neighbors = &surviving.in_neighbors[i];
        let sum: Vec2 = in_neighbors.iter().map(|&(from, c)| self.final_positions[from] + c).sum();
        if in_neighbors.is_empty() {
            self.final_positions[i]
        } else {
            sum / in_neighbors.len() as f64
        }
    }

    /// Returns the robot that occupies the desired position of a robot that yields, or `None`.
    fn robot_in_desired_position(
        &self,
        p: &FailurePredictor,
        i: usize,
        desired: Vec2,
    ) -> Option<usize> {
        if !p.robots[i].yields {
            return None;
        }
        let others = (0..p.robots.len()).filter(|&j| j != i && self.is_present[j]);
        let gap =
            |j: usize| p.usual_and_smallest_scale[1] * (desired - self.final_positions[j]).norm();
        let nearest = others.min_by(|&a, &b| gap(a).total_cmp(&gap(b)));
        nearest.filter(|&j| gap(j) < p.robots[i].standoff_m - OCCUPIED_MARGIN_M)
    }

    /// Returns the robot closest to a robot.
    fn nearest_robot(&self, i: usize) -> Option<usize> {
        let gap = |j: usize| (self.final_positions[i] - self.final_positions[j]).norm();
        let others = (0..self.is_present.len()).filter(|&j| j != i && self.is_present[j]);
        others.min_by(|&a, &b| gap(a).total_cmp(&gap(b)))
    }

    /// Returns for each living robot that ends off its slot the cause and the distance, m.
    pub(super) fn causes_of_displacement(
        &self,
        p: &FailurePredictor,
        surviving: &SurvivingGraph,
    ) -> Vec<Option<(BreakCause, f64)>> {
        let n = p.robots.len();
        let is_considered = |i: &usize| surviving.is_alive[*i] && self.is_present[*i];
        let mut displacements: Vec<Vec2> = (0..n)
            .map(|i| p.usual_and_smallest_scale[0] * (self.final_positions[i] - p.planned_slots[i]))
            .collect();
        if p.leader.is_none() {
            // The formation is located by the median of the robots that keep a slot.
            let keeps_slot = |i: &usize| p.robots[*i].reference == Reference::Offsets;
            let of_slot_keepers: Vec<Vec2> =
                (0..n).filter(is_considered).filter(keeps_slot).map(|i| displacements[i]).collect();
            let center = median(&of_slot_keepers);
            displacements.iter_mut().for_each(|displacement| *displacement -= center);
        }
        let displacement_m = |i: usize| displacements[i].norm();
        let displacement_max_m = |i: usize| {
            let others = self
                .alternative_positions
                .iter()
                .map(|positions| (positions[i] - p.planned_slots[i]).norm());
            others
                .map(|distance_m| p.usual_and_smallest_scale[0] * distance_m)
                .fold(displacement_m(i), f64::max)
        };
        let cause = |i: usize| {
            let desired = self.desired_position(surviving, i);
            let is_pushed_away = p.usual_and_smallest_scale[0]
                * (desired - self.final_positions[i]).norm()
                > OCCUPIED_MARGIN_M;
            let is_displaced = |j: usize| displacement_max_m(j) > OCCUPIED_MARGIN_M;
            // The position it would move to because of its lost in-neighbors alone.
            let without_conflict: Vec2 =
                surviving.in_neighbors[i].iter().map(|&(j, c)| p.planned_slot(j) + c).sum();
            let without_conflict = without_conflict / surviving.in_neighbors[i].len().max(1) as f64;
            let lost = surviving.lost_in_neighbor[i]
                .filter(|_| (without_conflict - p.planned_slots[i]).norm() > 1e-9);
            let broken_neighbor = surviving.in_neighbors[i]
                .iter()
                .map(|&(j, _)| j)
                .find(|&j| j < n && is_displaced(j));
            match (
                self.robot_in_desired_position(p, i, desired),
                self.nearest_robot(i),
                lost,
                broken_neighbor,
            ) {
                (Some(occupant), ..) if self.has_yielded => BreakCause::SlotOccupied { occupant },
                (_, Some(claimant), ..) if self.has_yielded && is_pushed_away => {
                    BreakCause::SlotClaimed { claimant }
                }
                (_, _, Some(lost), _) => match surviving.replaced_leader[i] {
                    Some(leader) => BreakCause::TakesLeaderSlot { leader },
                    None => BreakCause::DesiredPositionChanged { lost_in_neighbor: lost },
                },
                (.., Some(broken_neighbor)) => {
                    BreakCause::FollowsBrokenRobot { in_neighbor: broken_neighbor }
                }
                _ => BreakCause::Uncontained,
            }
        };
        let reported_m = |i: usize| {
            if displacement_m(i) > p.broken_threshold_m {
                displacement_m(i)
            } else {
                displacement_max_m(i)
            }
        };
        let broken = |i: usize| {
            (is_considered(&i) && displacement_max_m(i) > p.broken_threshold_m)
                .then(|| (cause(i), reported_m(i)))
        };
        (0..n).map(broken).collect()
    }

    /// Returns the distance of a contained robot from the convex hull of the living robots that lead or keep a slot, m,
    /// or `None` if it is inside.
    pub(super) fn hull_distance_m(
        &self,
        p: &FailurePredictor,
        surviving: &SurvivingGraph,
        i: usize,
    ) -> Option<f64> {
        let contained = |i: usize| {
            p.robots[i].reference == Reference::NeighborMean
                && surviving.replaced_leader[i].is_none()
        };
        let corners: Vec<Vec2> = (0..p.robots.len())
            .filter(|&j| surviving.is_alive[j] && self.is_present[j] && !contained(j))
            .map(|j| self.final_positions[j])
            .collect();
        let outside_m =
            p.usual_and_smallest_scale[0] * hull_distance(self.final_positions[i], &corners);
        (contained(i) && outside_m > OCCUPIED_MARGIN_M && outside_m.is_finite())
            .then_some(outside_m)
    }
}

/// Returns whether a robot follows others. The main leader, dead robots and robots without in-neighbors do not.
fn follows_others(p: &FailurePredictor, surviving: &SurvivingGraph, i: usize) -> bool {
    surviving.is_alive[i]
        && !surviving.in_neighbors[i].is_empty()
        && !p.robots[i].reference.is_local()
}

/// Returns the unit vector of `vector`, or that of the x axis if it is zero.
fn unit_vector(vector: Vec2) -> Vec2 {
    let length = vector.norm();
    if length > 1e-12 { vector / length } else { Vec2::new(1.0, 0.0) }
}

/// Returns the median of each coordinate, which an outlier changes little.
fn median(points: &[Vec2]) -> Vec2 {
    let middle = |coordinate: usize| {
        let mut sorted: Vec<f64> = points.iter().map(|point| point[coordinate]).collect();
        sorted.sort_by(f64::total_cmp);
        match sorted.len() {
            0 => 0.0,
            n => 0.5 * (sorted[(n - 1) / 2] + sorted[n / 2]),
        }
    };
    Vec2::new(middle(0), middle(1))
}
