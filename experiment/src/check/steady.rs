//! Settled formation: positions of the robots, and the speeds needed to stay there.
//!
//! Once all errors have decayed, alpha = (A^-1 tensor I) C(t): every robot is at a fixed slot in the leader's frame,
//! and all slots turn and scale with it. (20)-(23) (30) (33)
//!
//! Errors decay with feed-forward laws. A law without feed-forward lags behind a moving leader, more so with a smaller
//! gain. That lag is not computed here.

use formation::Vec2;
use formation::closest::{ClosestPair, closest_pair};
use formation::desired::Target;
use formation::drive::{Drive, DriveKind};
use formation::frame::LeaderFrame;
use formation::front_point::{
    Rotation, front_point, front_speed, towed_direction, towed_heading, towing_velocity,
    twist_for_front_velocity, twist_for_front_velocity_along,
};
use formation::laplacian::{move_to_settled_positions, settled_positions};
use formation::obstacle::Obstacles;
use formation::portable_math;
use formation::pose::{Twist, wrap_angle};
use formation::scale::Scale;
use serde::Serialize;

use crate::scenario::{Robot, Scenario};
use formation::ns_to_seconds;

/// Maximum number of simulation steps of all robots together, about a second of computation.
const STEPS_MAX: usize = 1 << 22;
/// Minimum step, s. The shipped trajectories turn by less than 1 mrad in it.
const STEP_S_MIN: f64 = 2e-3;
/// Maximum step, s. A run that would take more steps than allowed is only simulated in part.
const STEP_S_MAX: f64 = 1e-2;

/// Maximum ratio of a peak speed in the transient to that in the settled formation at which the transient is ignored.
const TRANSIENT_RATIO_MAX: f64 = 1.001;

/// Settled formation.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct SettledFormation {
    /// Slots at scale 1 and heading 0, relative to the leader (without one, to the first root), m; goals in the frame
    /// `map`.
    pub positions: Vec<Vec2>,
    /// Smallest and largest scale.
    pub scale_range: [f64; 2],
    /// The closest pair of robots at the smallest scale, free robots left out.
    pub closest_pair: Option<ClosestPair>,
    /// For each robot, whether its motion is unknown: it is free, or follows a free robot. The slots of these robots
    /// are their start positions.
    pub is_unknown: Vec<bool>,
}

impl SettledFormation {
    /// Computes the settled formation of a scenario without errors.
    ///
    /// # Panics
    ///
    /// If the robots have no goals and no root reaches all.
    pub fn compute(scenario: &Scenario) -> SettledFormation {
        let positions = planned_positions(scenario)
            .expect("a sound scenario has goals, or a root that reaches all");
        let scale = scenario.scale().map_or([1.0; 2], Scale::value_range);
        // The motion of free robots is unknown: their laws decide where they go.
        let is_free = |i: &usize| scenario.is_free(*i);
        let settled_robots: Vec<usize> = (0..positions.len()).filter(|i| !is_free(i)).collect();
        let smallest: Vec<Vec2> = settled_robots.iter().map(|&i| scale[0] * positions[i]).collect();
        let closest = closest_pair(&smallest).map(|closest| {
            let pair = closest.pair.map(|index| settled_robots[index]);
            ClosestPair { pair, ..closest }
        });
        SettledFormation {
            closest_pair: closest,
            positions,
            scale_range: scale,
            is_unknown: robots_with_unknown_motion(scenario),
        }
    }
}

/// Returns for each robot whether it is free, or follows a free robot over any number of edges.
fn robots_with_unknown_motion(scenario: &Scenario) -> Vec<bool> {
    let robots = 0..scenario.robots.len();
    let free: Vec<usize> = robots.clone().filter(|&i| scenario.is_free(i)).collect();
    if free.is_empty() {
        return vec![false; robots.len()];
    }
    let reached = scenario.graph_of_offsets().reachability();
    robots.map(|i| free.iter().any(|&from| from == i || reached[from][i])).collect()
}

/// Returns the slots of all robots at scale 1 and heading 0, relative to the leader (without one, to the first root),
/// or their goals, m. Returns `None` if they do not follow from the graph.
pub(crate) fn planned_positions(scenario: &Scenario) -> Option<Vec<Vec2>> {
    if scenario.has_free_robots() {
        return positions_with_stationary_free_robots(scenario);
    }
    let pinned = || scenario.leader().or_else(|| scenario.graph.roots().first().copied());
    scenario.goals_m().or_else(|| settled_positions(&scenario.graph, pinned()?))
}

/// Returns the slots like [`planned_positions`] if some robots are free: these are assumed to stay at their starts.
fn positions_with_stationary_free_robots(scenario: &Scenario) -> Option<Vec<Vec2>> {
    let anchors = scenario.anchors_m();
    let others: Vec<usize> = (0..anchors.len()).filter(|&i| anchors[i].is_none()).collect();
    let graph = scenario.graph_of_offsets();
    let reached = graph.reachability();
    let reaches_all = |i: &usize| others.iter().all(|&other| reached[*i][other]);
    let pinned = scenario.leader().or_else(|| others.iter().copied().find(reaches_all));
    // Slots are relative to the pinned robot.
    let start = |i: usize| {
        let robot = &scenario.robots[i];
        front_point(robot.start, robot.front_point_m)
    };
    let origin = pinned.map_or(Vec2::zeros(), start);
    let relative_position =
        |anchor: &Option<Vec2>| anchor.map_or(Vec2::zeros(), |anchor| anchor - origin);
    let mut positions: Vec<Vec2> = anchors.iter().map(relative_position).collect();
    let in_neighbors: Vec<Vec<(usize, Vec2)>> = (0..positions.len())
        .map(|i| graph.incoming_edges(i).map(|edge| (edge.from, edge.offset_m)).collect())
        .collect();
    let to_settle: Vec<usize> = others.into_iter().filter(|&i| Some(i) != pinned).collect();
    let has_unanchored = to_settle.iter().any(|&i| in_neighbors[i].is_empty());
    if has_unanchored {
        return None;
    }
    move_to_settled_positions(&in_neighbors, &to_settle, &mut positions)?;
    Some(positions)
}

/// Speed below which a slot counts as being at rest, so that its path has no curvature, m/s.
const SLOT_SPEED_MIN_M_S: f64 = 1e-3;

/// Maximum speeds that one robot needs to stay in its slot.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize)]
pub struct PeakSpeeds {
    /// |alpha'|, speed of the front point, which the speed limit bounds, m/s.
    pub front_speed_m_s: f64,
    /// |v|, linear speed, m/s.
    pub v_m_s: f64,
    /// |w|, turn rate, rad/s.
    pub w_rad_s: f64,
    /// |v| + track |w| / 2, speed of the faster wheel's rim, m/s. `None` if the track width is unknown.
    pub rim_speed_m_s: Option<f64>,
}

/// Motion of the leader and the settled formation.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct FormationMotion {
    /// End of the simulated interval, which starts at 0, s. It is the duration of the run unless that takes too many
    /// steps.
    pub horizon_s: f64,
    /// eta_m, maximum of |m'|, m/s.
    pub trajectory_speed_max_m_s: f64,
    /// eta_c, maximum of |C'_ji| over all edges with an offset, m/s.
    pub offset_rate_max_m_s: f64,
    /// Peak speeds of each robot in the settled formation.
    pub peak_speeds: Vec<PeakSpeeds>,
    /// Times of the peak speeds of each robot, s since the start: of the front point, of a wheel's rim, and of the turn
    /// rate.
    pub peak_times_s: Vec<[f64; 3]>,
    /// Largest curvature of the path of each car, 1/m, and its time, s; 0 for other robots.
    pub peak_curvatures: Vec<(f64, f64)>,
    /// Smallest distance of each robot's slot from a wall. `None` without walls.
    pub wall_passages: Vec<Option<WallPassage>>,
    /// Initial transient, if the leader starts with another heading than its path and that makes a robot faster.
    pub transient: Option<InitialTransient>,
}

/// Smallest distance of a slot from a wall.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct WallPassage {
    /// Smallest distance of the slot from the wall, m.
    pub distance_m: f64,
    /// Time, s since the start.
    pub t_s: f64,
    /// Index of the convex part in the scenario.
    pub wall: usize,
}

/// Initial transient: the effect of the leader's start heading on the others until it has turned.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct InitialTransient {
    /// Heading of the leader's path at the start, rad. With this start heading there is no transient.
    pub tangent_rad: f64,
    /// Peak speeds of each robot from the start on.
    pub peak_speeds: Vec<PeakSpeeds>,
    /// Times of the peak speeds of each robot, s since the start: of the front point, of a wheel's rim, and of the turn
    /// rate.
    pub peak_times_s: Vec<[f64; 3]>,
}

impl FormationMotion {
    /// Computes the motion. Returns `None` without a leader, where all robots come to rest.
    ///
    /// The leader's front point is on m(t) from the start, and its heading starts as in the scenario. The effect of
    /// that heading is reported separately as the transient. The other robots start with their tangential headings.
    pub fn compute(scenario: &Scenario, settled: &SettledFormation) -> Option<FormationMotion> {
        let (leader, lead) = (scenario.leader()?, scenario.lead.as_ref()?);
        let start_rad = scenario.robots[leader].start.heading_rad;
        let given = FormationMotion::compute_from_heading(start_rad, scenario, settled)?;
        // A path that starts at rest has a heading only after a moment.
        let initial_velocities =
            (0..=100).map(|step| lead.trajectory.target_at(f64::from(step) * STEP_S_MIN).velocity);
        let Some(tangent_rad) = initial_velocities.into_iter().find_map(heading_of) else {
            return Some(given);
        };
        if tangent_rad == start_rad {
            return Some(given);
        }
        let along = FormationMotion::compute_from_heading(tangent_rad, scenario, settled)?;
        let faster = |(given, along): (&PeakSpeeds, &PeakSpeeds)| {
            given.front_speed_m_s > TRANSIENT_RATIO_MAX * along.front_speed_m_s
                || given.rim_speed_m_s
                    > along.rim_speed_m_s.map(|rim_m_s| TRANSIENT_RATIO_MAX * rim_m_s)
        };
        if !given.peak_speeds.iter().zip(&along.peak_speeds).any(faster) {
            return Some(given);
        }
        let FormationMotion { peak_speeds, peak_times_s, .. } = given;
        Some(FormationMotion {
            peak_speeds: along.peak_speeds,
            peak_times_s: along.peak_times_s,
            wall_passages: along.wall_passages,
            transient: Some(InitialTransient { tangent_rad, peak_speeds, peak_times_s }),
            ..given
        })
    }

    /// Computes the motion of a leader that starts with the heading `leader_rad`.
    fn compute_from_heading(
        leader_rad: f64,
        scenario: &Scenario,
        settled: &SettledFormation,
    ) -> Option<FormationMotion> {
        let leader = scenario.leader()?;
        let robots = &scenario.robots;
        let steps_max = (STEPS_MAX / robots.len()) as f64;
        let duration_s = ns_to_seconds(scenario.duration_ns);
        let step_s = (duration_s / steps_max).clamp(STEP_S_MIN, STEP_S_MAX).min(duration_s);
        let steps = (duration_s / step_s).ceil().min(steps_max) as usize;
        let offset_m =
            scenario.formation_edges().map(|(_, edge)| edge.offset_m.norm()).fold(0.0, f64::max);

        let mut motion = FormationMotion {
            horizon_s: (steps as f64 * step_s).min(duration_s),
            trajectory_speed_max_m_s: 0.0,
            offset_rate_max_m_s: 0.0,
            peak_speeds: vec![PeakSpeeds::default(); robots.len()],
            peak_times_s: vec![[0.0; 3]; robots.len()],
            peak_curvatures: vec![(0.0, 0.0); robots.len()],
            wall_passages: vec![None; robots.len()],
            transient: None,
        };
        let walls = scenario.obstacles();
        // Position of each slot when its distance from all walls was last computed, and that distance, m.
        let mut last_checked = vec![(Vec2::zeros(), 0.0); robots.len()];
        // Of robots that drive along their heading, rad, and of those that are towed at their front point, unit vectors.
        let mut headings_rad: Vec<f64> = robots.iter().map(|r| r.start.heading_rad).collect();
        let unit_vector = |&heading_rad: &f64| Rotation::from_angle(heading_rad).unit_vector();
        let mut directions: Vec<Vec2> = headings_rad.iter().map(unit_vector).collect();
        let drives: Vec<Drive> = robots.iter().map(Robot::drive).collect();
        let mut previous: Option<Vec<Vec2>> = None;
        let mut velocities: Vec<Vec2> = Vec::with_capacity(robots.len());
        for (t_s, target, frame) in leader_motion_samples(scenario, leader_rad, step_s, steps)? {
            let transform = frame.offset_transform();
            (headings_rad[leader], directions[leader]) = (frame.heading_rad, transform.direction());
            if !walls.is_empty() {
                let slots = settled.positions.iter().zip(&settled.is_unknown);
                let slots = slots.map(|(&slot, is_unknown)| {
                    (!is_unknown).then(|| target.position + transform.apply(slot).position)
                });
                motion.update_clearances(&walls, slots, t_s, &mut last_checked);
            }
            let slots = settled.positions.iter();
            velocities.clear();
            velocities.extend(slots.map(|&slot| target.velocity + transform.apply(slot).velocity));
            for (i, robot) in robots.iter().enumerate().filter(|(i, _)| !settled.is_unknown[*i]) {
                let velocity = velocities[i];
                let last_velocity = previous.as_ref().map(|previous| previous[i]);
                let twist = if i != leader && drives[i].moves_along_heading() {
                    let last_rad = last_velocity.map(|_| headings_rad[i]);
                    axle_twist(velocity, last_rad, &mut headings_rad[i], step_s)
                } else if robot.drive_kind == DriveKind::Omni {
                    Twist::new(velocity.norm(), 0.0)
                } else if drives[i].turns_freely() {
                    Twist::new(velocity.norm(), frame.turn_rate_rad_s)
                } else {
                    if i != leader && robot.drive_kind.is_differential() {
                        directions[i] = match last_velocity {
                            None => velocity.try_normalize(0.0).unwrap_or(directions[i]),
                            Some(last_velocity) => {
                                let mean = 0.5 * (last_velocity + velocity);
                                towed_direction(directions[i], robot.front_point_m, mean, step_s)
                            }
                        };
                    }
                    twist_for_front_velocity_along(directions[i], robot.front_point_m, velocity)
                };
                let peak_times_s = &mut motion.peak_times_s[i];
                motion.peak_speeds[i].update_peaks(peak_times_s, robot, twist, t_s);
                motion.update_peak_curvature(i, drives[i], twist, t_s);
            }
            motion.trajectory_speed_max_m_s =
                motion.trajectory_speed_max_m_s.max(target.velocity.norm());
            let offset_rate_m_s = transform.apply(Vec2::new(offset_m, 0.0)).velocity.norm();
            motion.offset_rate_max_m_s = motion.offset_rate_max_m_s.max(offset_rate_m_s);
            std::mem::swap(previous.get_or_insert_default(), &mut velocities);
        }
        Some(motion)
    }

    /// Updates the largest curvature of the path of robot `i` with a twist at `t_s`, if it is a car that moves.
    fn update_peak_curvature(&mut self, i: usize, drive: Drive, twist: Twist, t_s: f64) {
        let (v, w) = (twist.v_m_s.abs(), twist.w_rad_s.abs());
        if drive.is_car() && v > SLOT_SPEED_MIN_M_S && w / v > self.peak_curvatures[i].0 {
            self.peak_curvatures[i] = (w / v, t_s);
        }
    }

    /// Updates the smallest distances of slots from walls; `None` for a slot that is unknown. `last_checked`: for each
    /// slot, the position at which the distance was last computed, and that distance, m.
    fn update_clearances(
        &mut self,
        walls: &Obstacles,
        slots: impl Iterator<Item = Option<Vec2>>,
        t_s: f64,
        last_checked: &mut [(Vec2, f64)],
    ) {
        for ((position, passage), last_checked) in
            slots.zip(&mut self.wall_passages).zip(last_checked)
        {
            let Some(position) = position else { continue };
            let distance_min_m = passage.map_or(f64::INFINITY, |passage| passage.distance_m);
            // Lower bound on the distance from any wall, by the triangle inequality.
            let (last_position, last_distance_m) = *last_checked;
            if last_distance_m - (position - last_position).norm() > distance_min_m {
                continue;
            }
            let Some(nearest) = walls.nearest_obstacle(position) else { continue };
            *last_checked = (position, nearest.distance_m);
            if nearest.distance_m < distance_min_m {
                *passage =
                    Some(WallPassage { distance_m: nearest.distance_m, t_s, wall: nearest.index });
            }
        }
    }
}

impl PeakSpeeds {
    /// Updates the peaks with a twist at `t_s`. `peak_times_s`: times of the peaks of front point, rim and turn rate.
    fn update_peaks(&mut self, peak_times_s: &mut [f64; 3], robot: &Robot, twist: Twist, t_s: f64) {
        let (v, w) = (twist.v_m_s.abs(), twist.w_rad_s.abs());
        let front_m_s = front_speed(robot.front_point_m, twist);
        if front_m_s > self.front_speed_m_s {
            (self.front_speed_m_s, peak_times_s[0]) = (front_m_s, t_s);
        }
        self.v_m_s = self.v_m_s.max(v);
        if w > self.w_rad_s {
            (self.w_rad_s, peak_times_s[2]) = (w, t_s);
        }
        if let Some(wheels) = robot.wheels {
            let rim_m_s = v + 0.5 * wheels.track_m * w;
            if self.rim_speed_m_s.is_none_or(|peak_m_s| rim_m_s > peak_m_s) {
                (self.rim_speed_m_s, peak_times_s[1]) = (Some(rim_m_s), t_s);
            }
        }
    }
}

/// Returns the time, s, and the main leader's target and frame at 0 and after each of `steps` steps. The front point is
/// on m(t) and pulls the heading along, which starts at `heading_rad`; at the axle midpoint it is that of m'(t).
/// Returns `None` without a leader.
pub(crate) fn leader_motion_samples(
    scenario: &Scenario,
    heading_rad: f64,
    step_s: f64,
    steps: usize,
) -> Option<impl Iterator<Item = (f64, Target, LeaderFrame)>> {
    let (leader, lead) = (scenario.leader()?, scenario.lead.as_ref()?);
    let (ell_m, drive) = (scenario.robots[leader].front_point_m, scenario.robots[leader].drive());
    let mut heading_rad = heading_rad;
    Some((0..=steps).map(move |step| {
        let t_s = step as f64 * step_s;
        let target = lead.trajectory.target_at(t_s);
        let (scale, scale_rate_per_s) = lead.scale.value_and_rate_at(t_s);
        let identity = LeaderFrame::IDENTITY;
        if drive.turns_freely() {
            let direction =
                lead.trajectory.direction_at(t_s, step_s, heading_rad, lead.keep_heading);
            heading_rad = direction.heading_rad;
            let turn_rate_rad_s = direction.turn_rate_rad_s;
            let frame =
                LeaderFrame { heading_rad, turn_rate_rad_s, scale, scale_rate_per_s, ..identity };
            return (t_s, target, frame);
        }
        if step > 0 {
            let mid_velocity = lead.trajectory.target_at(t_s - 0.5 * step_s).velocity;
            let towing = towing_velocity(heading_rad, mid_velocity, lead.keep_heading);
            heading_rad = towed_heading(heading_rad, ell_m, towing, step_s);
        }
        let towing = towing_velocity(heading_rad, target.velocity, lead.keep_heading);
        let turn_rate_rad_s = twist_for_front_velocity(heading_rad, ell_m, towing).w_rad_s;
        let frame =
            LeaderFrame { heading_rad, turn_rate_rad_s, scale, scale_rate_per_s, ..identity };
        (t_s, target, frame)
    }))
}

/// Returns the twist of an axle midpoint with this velocity, m/s, and updates its heading, rad: the robot drives in the
/// gear that turns it less. `previous_rad` is its heading one step before, if there was one.
fn axle_twist(
    velocity: Vec2,
    previous_rad: Option<f64>,
    heading_rad: &mut f64,
    step_s: f64,
) -> Twist {
    let ahead = towing_velocity(*heading_rad, velocity, previous_rad.is_some());
    *heading_rad = heading_of(ahead).unwrap_or(*heading_rad);
    let turn_rad = previous_rad.map_or(0.0, |previous_rad| wrap_angle(*heading_rad - previous_rad));
    Twist::new(velocity.norm(), turn_rad / step_s)
}

/// Returns the direction of a velocity, rad, or `None` if it is zero.
fn heading_of(velocity: Vec2) -> Option<f64> {
    (velocity.norm() > 0.0).then(|| portable_math::atan2(velocity.y, velocity.x))
}
