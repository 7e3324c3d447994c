//! Motion estimation of neighbors in range. The proximity sensor reports positions, but neither identities nor
//! velocities.
//!
//! Robots are at least d apart, and none moves farther than v_max dt between two samples, where v_max is the highest of
//! the team. A robot sensed within d/4 of an earlier position is therefore the same robot, provided that v_max dt is
//! less than d/4. After a longer gap nothing is known. Only performance terms use these estimates: no guarantee about
//! distances depends on them.

use formation::Vec2;
use formation::portable_math;
use protocol::avoidance::MethodConditions;

use super::{Sample, clip};

/// Minimum time constant of the smoothed velocities, s.
const SMOOTHING_TIME_S_MIN: f64 = 0.05;
/// Ratio of the distance driven at v_max during the smoothing time to the position error.
const SMOOTHING_DISTANCE_PER_ERROR: f64 = 10.0;
/// Maximum displacement of a robot that counts as being at rest, as a fraction of d.
const REST_RADIUS_FRACTION: f64 = 0.05;

/// Speed below which the smoothed velocity of a robot at rest becomes 0, m/s. Otherwise it decreases to subnormal
/// numbers, with which processors compute slowly.
const REST_SPEED_M_S: f64 = 1e-100;

/// Maximum number of tracked neighbors, the nearest. Robots behind them are handled later.
const TRACKED_NEIGHBORS_MAX: usize = 6;

/// A tracked neighbor.
#[derive(Debug, Clone, Copy)]
pub struct TrackedNeighbor {
    /// Own front point - the neighbor's front point, m.
    pub z: Vec2,
    /// Class of the neighbor, an index into the classes of the brief.
    pub class: u8,
    /// Estimated velocity in `map`, m/s, and 0 while it is unknown.
    pub velocity: Vec2,
    /// Time for which the neighbor has been at rest, s.
    pub rest_time_s: f64,
    /// Current position, and position at the last detected motion, m, in `map`.
    position: Vec2,
    last_motion_position: Vec2,
}

/// Constants of one step between two samples.
#[derive(Debug, Clone, Copy)]
struct UpdateConstants {
    /// Time between the two samples, s.
    dt: f64,
    /// Reciprocal of the time between the two samples, 1/s.
    reciprocal_dt: f64,
    /// Weight of the new velocity in the smoothed velocity.
    smoothing_weight: f64,
    v_max: f64,
    /// Squared distance from an earlier position within which a robot is identified as the same, m^2.
    same_robot_distance_squared: f64,
    /// Squared distance from the anchor within which a robot counts as being at rest, m^2.
    rest_distance_squared: f64,
}

impl TrackedNeighbor {
    /// Creates a neighbor that is sensed for the first time.
    fn new(z: Vec2, position: Vec2, class: u8) -> TrackedNeighbor {
        TrackedNeighbor {
            z,
            class,
            velocity: Vec2::zeros(),
            rest_time_s: 0.0,
            position,
            last_motion_position: position,
        }
    }

    /// Returns the neighbor updated to a new position.
    fn update_position(self, z: Vec2, position: Vec2, step: &UpdateConstants) -> TrackedNeighbor {
        let current_velocity = (position - self.position) * step.reciprocal_dt;
        let velocity = self.velocity + (current_velocity - self.velocity) * step.smoothing_weight;
        let velocity = velocity.map(|speed| if speed.abs() < REST_SPEED_M_S { 0.0 } else { speed });
        let (last_motion_position, rest_time_s) = match (position - self.last_motion_position)
            .norm_squared()
            < step.rest_distance_squared
        {
            true => (self.last_motion_position, self.rest_time_s + step.dt),
            false => (position, 0.0),
        };
        TrackedNeighbor {
            z,
            velocity: clip(velocity, step.v_max),
            rest_time_s,
            position,
            last_motion_position,
            ..self
        }
    }
}

/// Tracker of the neighbors in range, from sample to sample.
#[derive(Debug)]
pub struct NeighborTracker {
    smoothing_time_s: f64,
    stamp_ns: Option<u64>,
    /// Step between the last two samples.
    update_constants: UpdateConstants,
    neighbors: Vec<TrackedNeighbor>,
    previous_neighbors: Vec<TrackedNeighbor>,
}

impl NeighborTracker {
    /// Creates a tracker without neighbors.
    pub fn new(conditions: &MethodConditions<'_>) -> NeighborTracker {
        // Of a team the smallest distance: another robot may be as close to a third one.
        let distances = conditions.avoidance.classes.iter().map(|class| class.distance_min_m);
        let d = distances.reduce(f64::min).unwrap_or(conditions.avoidance.distance_min_m);
        let error = conditions.distance_error_max_m();
        let v_max = conditions.others_speed_max_m_s();
        let (same_robot_distance, rest_distance) =
            (0.25 * d, (REST_RADIUS_FRACTION * d).max(3.0 * error));
        NeighborTracker {
            smoothing_time_s: SMOOTHING_TIME_S_MIN
                .max(SMOOTHING_DISTANCE_PER_ERROR * error / v_max),
            stamp_ns: None,
            update_constants: UpdateConstants {
                dt: 0.0,
                reciprocal_dt: f64::INFINITY,
                smoothing_weight: 0.0,
                v_max,
                same_robot_distance_squared: same_robot_distance * same_robot_distance,
                rest_distance_squared: rest_distance * rest_distance,
            },
            neighbors: Vec::new(),
            previous_neighbors: Vec::new(),
        }
    }

    /// Updates the tracker with a sample. A repeated call with the same sample has no effect.
    pub fn observe(&mut self, sample: &Sample<'_>) {
        let nearest =
            &sample.neighbor_vectors[..sample.neighbor_vectors.len().min(TRACKED_NEIGHBORS_MAX)];
        let first = self.neighbors.first().map(|neighbor| &neighbor.z);
        let same = first == nearest.first() && self.neighbors.len() == nearest.len();
        if same && self.stamp_ns == Some(sample.stamp_ns) {
            return;
        }
        let previous_ns = self.stamp_ns.replace(sample.stamp_ns).unwrap_or(sample.stamp_ns);
        let dt = sample.stamp_ns.saturating_sub(previous_ns) as f64 / 1e9;
        if self.update_constants.dt != dt {
            let smoothing_weight = dt / (dt + self.smoothing_time_s);
            self.update_constants = UpdateConstants {
                dt,
                reciprocal_dt: 1.0 / dt,
                smoothing_weight,
                ..self.update_constants
            };
        }
        let step = &self.update_constants;
        if portable_math::square(step.v_max * dt) >= step.same_robot_distance_squared || dt == 0.0 {
            self.neighbors.clear();
        }
        std::mem::swap(&mut self.neighbors, &mut self.previous_neighbors);
        self.neighbors.clear();
        self.neighbors.extend(nearest.iter().enumerate().map(|(index, &z)| {
            let position = sample.front_point - z;
            let same = |neighbor: &&TrackedNeighbor| {
                (neighbor.position - position).norm_squared() < step.same_robot_distance_squared
            };
            // The order of the list rarely changes, so the same index is tried first.
            let known = self.previous_neighbors.get(index).filter(same);
            let class = sample.neighbor_classes.get(index).copied().unwrap_or_default();
            match known.or_else(|| self.previous_neighbors.iter().find(same)) {
                Some(neighbor) => {
                    TrackedNeighbor { class, ..neighbor.update_position(z, position, step) }
                }
                None => TrackedNeighbor::new(z, position, class),
            }
        }));
    }

    /// Returns the time between the last two samples, s.
    pub fn dt(&self) -> f64 {
        self.update_constants.dt
    }

    /// Returns the tracked neighbors, nearest first.
    pub fn neighbors(&self) -> &[TrackedNeighbor] {
        &self.neighbors
    }
}

#[cfg(test)]
mod tests {
    use super::super::guard::tests::{brief, sample};
    use super::*;

    /// Creates a tracker with d = 0.2 m and v_max = 0.5 m/s.
    fn tracker(sensing_error_m: f64) -> NeighborTracker {
        let mut brief = brief();
        brief.avoidance.sensing_error_m = sensing_error_m;
        NeighborTracker::new(&MethodConditions::for_robot(&brief))
    }

    /// Moves the robot along x at 0.1 m/s and reports others at `positions`, in `map`, every 10 ms.
    fn track_moving_neighbors(
        tracker: &mut NeighborTracker,
        steps: u64,
        positions: impl Fn(u64, f64) -> Vec<Vec2>,
    ) {
        for step in 0..steps {
            let t_s = 0.01 * step as f64;
            let front_point = Vec2::new(0.1 * t_s, 0.0);
            let neighbor_vectors: Vec<Vec2> =
                positions(step, t_s).iter().map(|position| front_point - position).collect();
            tracker.observe(&Sample {
                front_point,
                ..sample(10_000_000 * step, 0.0, &neighbor_vectors)
            });
        }
    }

    #[test]
    fn velocities_are_tracked_in_any_list_order() {
        let mut tracker = tracker(0.0);
        let (rest_position, velocity) = (Vec2::new(1.0, 0.2), Vec2::new(0.0, -0.4));
        track_moving_neighbors(&mut tracker, 101, |step, t_s| {
            let two = [rest_position, Vec2::new(1.0, 0.0) + t_s * velocity];
            if step % 3 == 0 { two.to_vec() } else { vec![two[1], two[0]] }
        });
        let [moving, resting] = tracker.neighbors() else { panic!("two are near") };
        assert!((moving.velocity - velocity).norm() < 1e-6, "{moving:?}");
        assert!(moving.rest_time_s < 0.05, "{moving:?}");
        assert!(
            resting.velocity.norm() < 1e-9 && (resting.rest_time_s - 1.0).abs() < 1e-9,
            "{resting:?}"
        );
    }

    #[test]
    fn new_neighbor_and_long_gap_reset_the_estimates() {
        let mut tracker = tracker(0.0);
        let positions = |step: u64, t_s: f64| {
            let first = Vec2::new(1.0, 0.3 * t_s);
            if step < 20 { vec![first] } else { vec![first, Vec2::new(0.5, 0.3 * t_s)] }
        };
        track_moving_neighbors(&mut tracker, 21, positions);
        let [known, new] = tracker.neighbors() else { panic!("two are near") };
        assert!(known.velocity.y > 0.2 && new.velocity == Vec2::zeros() && new.rest_time_s == 0.0);
        // At v_max a robot moves by d/4 in 100 ms: after 99 ms a neighbor is recognized, after 100 ms it is
        // not.
        for (gap_ns, is_known) in [(99_999_999, true), (100_000_000, false)] {
            let mut tracker = super::tests::tracker(0.0);
            track_moving_neighbors(&mut tracker, 21, |_, t_s| vec![Vec2::new(1.0, 0.3 * t_s)]);
            let neighbor_vectors = [Vec2::new(-0.98, -0.06)];
            let front_point = Vec2::new(0.02, 0.0);
            tracker.observe(&Sample {
                front_point,
                ..sample(200_000_000 + gap_ns, 0.0, &neighbor_vectors)
            });
            assert_eq!(tracker.neighbors()[0].velocity != Vec2::zeros(), is_known, "{gap_ns} ns");
        }
    }

    #[test]
    fn only_the_six_nearest_neighbors_are_tracked() {
        let mut tracker = tracker(0.0);
        let row = |count: u32| (1..=count).map(|j| Vec2::new(0.3 * f64::from(j), 0.0)).collect();
        track_moving_neighbors(&mut tracker, 1, |_, _| row(8));
        let tracked: Vec<f64> = tracker.neighbors().iter().map(|neighbor| -neighbor.z.x).collect();
        let nearest: Vec<f64> = row(6).iter().map(|position: &Vec2| position.x).collect();
        assert_eq!(tracked, nearest);
    }

    #[test]
    fn sensing_errors_do_not_look_like_motion() {
        let mut tracker = tracker(0.01);
        track_moving_neighbors(&mut tracker, 500, |step, _| {
            let error = if step % 2 == 0 { 0.01 } else { -0.01 };
            vec![Vec2::new(1.0 + error, 0.5)]
        });
        let [resting] = tracker.neighbors() else { panic!("one is near") };
        assert!(resting.velocity.norm() < 0.06 && resting.rest_time_s > 4.9, "{resting:?}");
    }
}
