//! Walls and obstacles: sensing, and the minimum clearance of all robots.

use formation::Vec2;
use formation::obstacle::{NearestObstacle, Obstacles};
use protocol::brief::PlantBrief;
use protocol::message::{Odometry, WALLS_MAX};

/// All obstacles, and the accumulated clearance statistics.
pub(super) struct Walls {
    obstacles: Obstacles,
    required_clearance_m: f64,
    smallest_clearance: Clearance,
    violations: u64,
}

/// Distance of a front point from a wall at one instant.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Clearance {
    /// Distance, m.
    pub(super) distance_m: f64,
    /// Position of the front point, m.
    pub(super) front_point: Vec2,
    /// Indices of the robot and of the convex part.
    pub(super) robot_and_wall_indices: [usize; 2],
    /// Time since the start, ns.
    pub(super) t_ns: u64,
}

impl Walls {
    /// Creates the obstacles of this brief, with an infinite clearance.
    pub(super) fn new(brief: &PlantBrief) -> Walls {
        Walls {
            obstacles: Obstacles::new(&brief.obstacles),
            required_clearance_m: brief.clearance_m,
            smallest_clearance: Clearance {
                distance_m: f64::INFINITY,
                front_point: Vec2::zeros(),
                robot_and_wall_indices: [0; 2],
                t_ns: 0,
            },
            violations: 0,
        }
    }

    /// Updates the statistics with the front points at `t_ns`.
    pub(super) fn update(&mut self, alphas: &[Vec2], t_ns: u64) {
        let mut is_violated = false;
        for (robot, &front_point) in alphas.iter().enumerate() {
            let Some(NearestObstacle { index, distance_m, .. }) =
                self.obstacles.nearest_obstacle(front_point)
            else {
                return;
            };
            is_violated |= distance_m < self.required_clearance_m;
            if distance_m < self.smallest_clearance.distance_m {
                self.smallest_clearance = Clearance {
                    distance_m,
                    front_point,
                    robot_and_wall_indices: [robot, index],
                    t_ns,
                };
            }
        }
        self.violations += u64::from(is_violated);
    }

    /// Returns the minimum clearance up to now, which is infinite without walls.
    pub(super) fn smallest_clearance(&self) -> Clearance {
        self.smallest_clearance
    }

    /// Returns the number of updates at which a robot was closer to a wall than the clearance.
    pub(super) fn violations(&self) -> u64 {
        self.violations
    }

    /// Fills in the nearest points of the walls within `radius_m` of the front point `alpha`, nearest first.
    /// `noise_m(i)` is the noise of the i-th nearest point, from 1.
    pub(super) fn sense_walls(
        &self,
        alpha: Vec2,
        radius_m: f64,
        noise_m: impl Fn(usize) -> Vec2,
        sample: &mut Odometry,
    ) {
        if self.obstacles.is_empty() {
            return;
        }
        let mut nearest: [Option<NearestObstacle>; WALLS_MAX] = [None; WALLS_MAX];
        let mut in_range_count = 0;
        for wall in self.obstacles.obstacles_within(alpha, radius_m) {
            let count = in_range_count.min(WALLS_MAX);
            in_range_count += 1;
            // Inserted after walls at the same distance, so that these stay in the order of the brief.
            let is_nearer = |other: &Option<NearestObstacle>| {
                other.is_some_and(|other| other.distance_m <= wall.distance_m)
            };
            let index = nearest[..count].partition_point(is_nearer);
            if index < WALLS_MAX {
                nearest.copy_within(index..count.min(WALLS_MAX - 1), index + 1);
                nearest[index] = Some(wall);
            }
        }
        for (item, (point, wall)) in
            sample.walls.iter_mut().zip(nearest.iter().flatten()).enumerate()
        {
            *point = (wall.point + noise_m(item + 1)).into();
        }
        sample.walls_count = in_range_count.min(WALLS_MAX) as u32;
        sample.walls_cut = u32::from(in_range_count > WALLS_MAX);
    }
}

#[cfg(test)]
mod tests {
    use formation::obstacle::Obstacle;
    use protocol::fault::{Sensor, SensorFault, SensorFaultKind, Span};
    use protocol::message::PROXIMITY_MAX;

    use super::super::World;
    use super::*;
    use crate::testing::{self, NS_PER_MS, command};

    /// Returns the brief of one robot with its front point at the origin and a sensing radius of 1 m.
    fn brief(obstacles: Vec<Obstacle>) -> PlantBrief {
        let brief = testing::brief(&[-0.1]);
        PlantBrief { sensing_radius_m: 1.0, clearance_m: 0.25, obstacles, ..brief }
    }

    fn disc(x_m: f64, y_m: f64) -> Obstacle {
        Obstacle::Disc { center_m: [x_m, y_m], radius_m: 0.1 }
    }

    #[test]
    fn nearest_point_of_each_convex_part_is_sensed_in_order() {
        let wall = Obstacle::segment([-3.0, 0.5], [3.0, 0.5]);
        let square = [[0.3, -0.2], [0.6, -0.2], [0.6, -0.5], [0.3, -0.5]];
        let square = Obstacle::Polygon { corners_m: square.to_vec() };
        let far = Obstacle::segment([1.01, -3.0], [1.01, 3.0]);
        let world = World::new(&brief(vec![far, wall, square, disc(-0.5, 0.0)]));
        let seen: Vec<Vec2> = world.odometry(0).nearest_wall_points().collect();
        let expected = [[0.3, -0.2], [-0.4, 0.0], [0.0, 0.5]];
        assert_eq!(seen.len(), expected.len(), "{seen:?}");
        for (seen, expected) in seen.iter().zip(expected) {
            assert!((seen - Vec2::from(expected)).norm() < 1e-12, "{seen}");
        }
        assert_eq!(World::new(&brief(Vec::new())).odometry(0).nearest_wall_points().count(), 0);
    }

    #[test]
    fn too_many_walls_report_the_nearest_and_set_the_cut_flag() {
        let sample_with_discs = |count: usize| {
            let discs = (0..count).map(|i| {
                // Not ordered by distance.
                let distance_m = 0.2 + 0.6 * (i * 5 % count) as f64 / count as f64;
                let (sin, cos) = (i as f64).sin_cos();
                disc(distance_m * cos, distance_m * sin)
            });
            World::new(&brief(discs.collect())).odometry(0)
        };
        let (few, many) = (sample_with_discs(WALLS_MAX), sample_with_discs(WALLS_MAX + 5));
        assert_eq!((few.walls_count as usize, few.walls_cut), (WALLS_MAX, 0));
        assert_eq!((many.walls_count as usize, many.walls_cut), (WALLS_MAX, 1));
        let distances_m: Vec<f64> = many.nearest_wall_points().map(|point| point.norm()).collect();
        // Ordered by distance, for any order in the brief.
        for (rank, distance_m) in distances_m.iter().enumerate() {
            let beyond_first = 0.6 * rank as f64 / (WALLS_MAX + 5) as f64;
            assert!((distance_m - distances_m[0] - beyond_first).abs() < 1e-12, "{distances_m:?}");
        }
    }

    #[test]
    fn walls_are_sensed_with_noise_and_not_during_dropout() {
        let mut brief = brief(vec![disc(0.5, 0.0), disc(0.0, 0.5)]);
        let fault = |from_ns, kind| {
            let span = Span { from_ns, until_ns: from_ns + NS_PER_MS };
            SensorFault { span, sensor: Sensor::Proximity, kind, seed: 3 }
        };
        let noise = SensorFaultKind::Noise { bound_m: 0.05, heading_bound_rad: 0.0 };
        brief.robots[0].sensor_faults =
            vec![fault(NS_PER_MS, SensorFaultKind::Blackout), fault(2 * NS_PER_MS, noise)];
        let mut world = World::new(&brief);
        let mut errors_m = Vec::new();
        for t_ms in 0..3 {
            world.advance(t_ms * NS_PER_MS);
            let sample = world.odometry(0);
            let truth = [Vec2::new(0.4, 0.0), Vec2::new(0.0, 0.4)];
            let errors: Vec<Vec2> =
                sample.nearest_wall_points().zip(truth).map(|(a, b)| a - b).collect();
            assert!(
                t_ms != 1 || sample.proximity_valid == 0 && sample.walls == [[0.0; 2]; WALLS_MAX]
            );
            errors_m.push(errors);
        }
        assert_eq!(errors_m[0].len(), 2);
        assert!(errors_m[0].iter().all(|error_m| error_m.norm() < 1e-12) && errors_m[1].is_empty());
        // Numbered after the noise of the robots in range.
        let fault = &brief.robots[0].sensor_faults[1];
        for (item, error_m) in (PROXIMITY_MAX as u64 + 1..).zip(&errors_m[2]) {
            let expected_m = Vec2::from(fault.position_error_m(world.tick(), item));
            assert!(expected_m.norm() > 0.0 && expected_m.norm() <= 0.05, "{expected_m}");
            assert!((error_m - expected_m).norm() < 1e-12, "{errors_m:?}");
        }
        assert_eq!(errors_m[2].len(), 2);
    }

    #[test]
    fn clearance_violation_is_located_and_counted_per_arc() {
        let header = World::new(&brief(Vec::new())).truth_header();
        assert_eq!((header.clearance_m, header.clearance_violations), (f64::INFINITY, 0));
        let wall = Obstacle::segment([0.3, -1.0], [0.3, 1.0]);
        let mut world = World::new(&brief(vec![disc(0.0, 0.9), wall]));
        assert_eq!(world.truth_header().clearance_m, 0.3);
        for (sequence, t_ms) in (1..).zip([0, 20, 40, 60]) {
            // At 1 m/s up to 0.06 m, where the robot turns back.
            let v_m_s = if t_ms < 60 { 1.0 } else { -1.0 };
            world.accept_command(0, &command(t_ms * NS_PER_MS, sequence, v_m_s, 0.0)).unwrap();
            world.advance((t_ms + 20) * NS_PER_MS);
        }
        let header = world.truth_header();
        assert!((header.clearance_m - 0.24).abs() < 1e-12, "{}", header.clearance_m);
        assert!((header.clearance_at_m[0] - 0.06).abs() < 1e-12);
        assert_eq!((header.clearance_t_ns, header.clearance_between), (60 * NS_PER_MS, [0, 1]));
        // Less than 0.25 m from 51 to 60 ms, and to 69 ms on the way back. At 0.25 m, rounding decides.
        assert!((19..=21).contains(&header.clearance_violations), "{header:?}");
    }
}
