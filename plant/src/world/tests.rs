//! Counters and sensors of the plant, apart from the rules checked in `proof` and `inertia`.

use formation::pose::Pose;
use protocol::brief::{MemberBrief, WheelsBrief};
use protocol::fault::{LinkFault, LinkFaultKind, Span, WheelFault};

use super::*;
use crate::testing::{NS_PER_MS, brief, command};

/// Returns a brief of robots at 0, 2 and 4.5 m.
fn brief_of_three_robots() -> PlantBrief {
    brief(&[0.0, 2.0, 4.5])
}

/// Returns the time span between two times in milliseconds.
fn span(from: u64, until: u64) -> Span {
    Span { from_ns: from * NS_PER_MS, until_ns: until * NS_PER_MS }
}

fn robot_x_m(world: &World, robot: usize) -> f64 {
    world.states[robot].pose.x_m
}

#[test]
fn delayed_command_acts_later_and_expires_by_its_stamp() {
    // In transit until 15 ms and received at 20 ms. With a timeout of 20 ms it has just expired.
    for (lifetime_ms, is_commanded, late) in [
        (20, [[false, true], [false, true], [false; 2]], 1),
        (30, [[false, true], [false, true], [true; 2]], 0),
    ] {
        let kind = LinkFaultKind::Delay { delay_ns: 15 * NS_PER_MS, jitter_ns: 0 };
        let mut brief =
            PlantBrief { command_lifetime_ns: lifetime_ms * NS_PER_MS, ..brief_of_three_robots() };
        brief.robots[0].command_faults = vec![LinkFault { span: span(0, 100), kind, seed: 1 }];
        let mut world = World::new(&brief);
        [0, 1]
            .iter()
            .for_each(|&robot| world.receive_command(robot, &command(0, 1, 0.4, 0.0)).unwrap());
        for (tick, is_commanded) in (1..).zip(is_commanded) {
            world.advance(10 * tick * NS_PER_MS);
            let commanded = [0, 1].map(|i| world.truth().nth(i).unwrap().commanded == 1);
            assert_eq!(commanded, is_commanded, "tick {tick} of {lifetime_ms} ms");
            world.accept_due_commands();
        }
        assert_eq!(world.truth_header().commands_late, late);
    }
}

#[test]
fn invalid_commands_are_refused_and_counted_by_kind() {
    let mut world = World::new(&brief_of_three_robots());
    world.advance(50 * NS_PER_MS);
    world.accept_command(0, &command(45 * NS_PER_MS, 7, 0.0, 0.0)).unwrap();
    // It would be newer than every honest command of the rest of the run.
    let last = Command { incarnation: u64::MAX, ..command(46 * NS_PER_MS, 9, 0.0, 0.0) };
    for (command, why) in [
        (command(30 * NS_PER_MS, 8, 0.5, 0.0), CommandRefusal::Late),
        (command(51 * NS_PER_MS, 8, 0.5, 0.0), CommandRefusal::Late),
        (command(45 * NS_PER_MS, 7, 0.5, 0.0), CommandRefusal::NotNewer),
        (command(44 * NS_PER_MS, 9, 0.5, 0.0), CommandRefusal::NotNewer),
        (command(46 * NS_PER_MS, 9, f64::NAN, 0.0), CommandRefusal::NotFinite),
        (command(46 * NS_PER_MS, 9, 0.0, f64::NEG_INFINITY), CommandRefusal::NotFinite),
        (command(46 * NS_PER_MS, 9, 1e300, 0.0), CommandRefusal::NotFinite),
        (last, CommandRefusal::NotFinite),
        (command(u64::MAX, 9, 0.5, 0.0), CommandRefusal::Late),
    ] {
        assert_eq!(world.accept_command(0, &command), Err(why), "{command:?}");
    }
    world.advance(60 * NS_PER_MS);
    assert_eq!(robot_x_m(&world, 0), 0.0);
    let replacement = Command { incarnation: 1, ..command(55 * NS_PER_MS, 1, 0.5, 0.0) };
    assert_eq!(world.accept_command(0, &replacement), Ok(()));
    world.advance(100 * NS_PER_MS);
    // It acts from 60 ms to 55 + 20 ms.
    assert!((robot_x_m(&world, 0) - 0.0075).abs() < 1e-15, "{}", robot_x_m(&world, 0));
    let header = world.truth_header();
    let refused = [header.commands_late, header.commands_old, header.commands_not_finite];
    assert_eq!((refused, header.commands_expired), ([3, 2, 4], 1));
    // Both commands are at most 20 ms old: one is replaced at 60 ms with 15 ms, the other one expires.
    assert_eq!(header.command_age_ns_max, 20 * NS_PER_MS);
    assert_eq!(world.truth().next().unwrap().commanded, 0);
}

#[test]
fn command_is_scaled_to_speed_limit_and_wheel_limits() {
    let wheels = |speed_max_m_s| Some(WheelsBrief { speed_max_m_s, track_m: 0.2 });
    let limit = |speed_max_m_s| vec![(span(0, 10), WheelFaultKind::Limit { speed_max_m_s })];
    let stuck = vec![(span(0, 10), WheelFaultKind::Stuck)];
    for (wheels, faults, requested, fraction, scaled) in [
        // hypot(3, 0.1 40) = 5 m/s, with a limit of 1 m/s.
        (None, vec![], (3.0, 40.0), 0.2, 1),
        (None, vec![], (1.0 + 1e-6, 0.0), 1.0 / (1.0 + 1e-6), 1),
        // An excess within rounding is not counted.
        (None, vec![], (1.0 + 1e-12, 0.0), 1.0 / (1.0 + 1e-12), 0),
        (
            None,
            vec![],
            (1.0 + RELATIVE_SPEED_TOLERANCE, 0.0),
            1.0 / (1.0 + RELATIVE_SPEED_TOLERANCE),
            0,
        ),
        // |v| + 0.1 |w| = 0.6 m/s.
        (wheels(0.3), vec![], (0.4, -2.0), 0.5, 0),
        (wheels(0.7), limit(0.3), (0.4, -2.0), 0.5, 0),
        // Without wheels in the brief, the track of failing wheels is twice the front point distance.
        (None, limit(0.3), (0.4, -2.0), 0.5, 0),
        (None, stuck, (0.4, -2.0), 0.0, 0),
    ] {
        let mut brief = brief_of_three_robots();
        brief.robots[0].wheels = wheels;
        let faults = faults.into_iter().map(|(span, kind)| WheelFault { span, kind });
        brief.robots[0].wheel_faults = faults.collect();
        let mut world = World::new(&brief);
        let (v, w) = requested;
        world.accept_command(0, &command(0, 1, v, w)).unwrap();
        world.advance(NS_PER_MS);
        let Twist { v_m_s, w_rad_s, .. } = world.states[0].twist;
        assert!(
            (v_m_s - fraction * v).hypot(w_rad_s - fraction * w) < 1e-12,
            "{requested:?}: {v_m_s}"
        );
        assert_eq!(world.truth_header().commands_scaled, scaled, "{requested:?}");
    }
}

#[test]
fn wheel_fault_lasts_exactly_for_its_span() {
    let mut brief = PlantBrief { plant_tick_ns: 20 * NS_PER_MS, ..brief_of_three_robots() };
    let slow = WheelFaultKind::Limit { speed_max_m_s: 0.5 };
    let faults = [(span(5, 8), WheelFaultKind::Stuck), (span(10, 20), slow)];
    brief.robots[0].wheel_faults = faults.map(|(span, kind)| WheelFault { span, kind }).to_vec();
    let mut world = World::new(&brief);
    world.accept_command(0, &command(0, 1, 1.0, 0.0)).unwrap();
    world.advance(15 * NS_PER_MS);
    // 5 ms and 2 ms at 1 m/s, 5 ms at 0.5 m/s.
    assert!((robot_x_m(&world, 0) - 0.0095).abs() < 1e-15, "{}", robot_x_m(&world, 0));
}

#[test]
fn nearest_neighbors_are_sensed_in_order_and_cut_is_flagged() {
    let half = PROXIMITY_MAX / 2;
    for (robots, velocities_sensed) in [
        (PROXIMITY_MAX + 1, false),
        (PROXIMITY_MAX + 2, false),
        (half + 1, true),
        (half + 2, true),
        (100, false),
    ] {
        let mut brief = PlantBrief { velocities_sensed, ..brief(&[0.0]) };
        let body = brief.robots[0].clone();
        // A lattice of front points with many equal distances, not ordered by distance. Without velocities
        // the distances are exact, so that neighbors at the same distance stay in the order of the brief.
        let turn_rad = if velocities_sensed { 0.1 } else { 0.0 };
        let start = |i: usize| Pose {
            x_m: (i * 37 % 100 / 10) as f64,
            y_m: (i * 37 % 10) as f64,
            heading_rad: turn_rad * i as f64,
        };
        let body = BodyBrief { front_point_m: 0.125, ..body };
        brief.robots = (0..robots).map(|i| BodyBrief { start: start(i), ..body.clone() }).collect();
        let count_max = if velocities_sensed { half } else { PROXIMITY_MAX };
        for (robot, radius_m) in
            (0..robots).zip([20.0, 0.5, 1.0, 2.0, 3.0, 4.0].into_iter().cycle())
        {
            brief.sensing_radius_m = radius_m;
            let mut world = World::new(&brief);
            if velocities_sensed {
                for moving in 0..robots {
                    world
                        .accept_command(moving, &command(0, 1, 0.1, 1e-3 * moving as f64))
                        .unwrap();
                }
                world.advance(NS_PER_MS);
            }
            let distance_m =
                |other: usize| (world.front_points[other] - world.front_points[robot]).norm();
            let mut neighbors: Vec<usize> = (0..robots).filter(|&other| other != robot).collect();
            neighbors.retain(|&other| distance_m(other) <= radius_m);
            neighbors.sort_by(|&a, &b| distance_m(a).total_cmp(&distance_m(b)));
            let sample = world.odometry(robot);
            assert_eq!(
                sample.proximity_cut == 1,
                neighbors.len() > count_max,
                "{robots} {radius_m}"
            );
            neighbors.truncate(count_max);
            let positions = neighbors.iter().map(|&other| world.front_points[other]);
            assert!(sample.proximity_front_points().eq(positions), "{robots} {robot} {radius_m}");
            let velocities = neighbors.iter().filter(|_| velocities_sensed).map(|&other| {
                let BodyState { pose, twist } = world.states[other];
                front_velocity(pose.heading_rad, 0.125, twist)
            });
            assert!(sample.proximity_velocities().eq(velocities), "{robots} {robot} {radius_m}");
        }
    }
}

/// Returns a sensor fault with this span in milliseconds.
fn sensor_fault(sensor: Sensor, kind: SensorFaultKind, from: u64, until: u64) -> SensorFault {
    SensorFault { span: span(from, until), sensor, kind, seed: 5 }
}

const NOISE: SensorFaultKind = SensorFaultKind::Noise { bound_m: 0.1, heading_bound_rad: 0.2 };

#[test]
fn sensor_in_dropout_reports_invalid_default_values() {
    let mut brief = brief_of_three_robots();
    brief.robots[1].sensor_faults = vec![
        sensor_fault(Sensor::Odometry, SensorFaultKind::Blackout, 1, 2),
        sensor_fault(Sensor::Proximity, SensorFaultKind::Blackout, 2, 3),
    ];
    let mut world = World::new(&brief);
    world.accept_command(1, &command(0, 1, 0.0, 1.0)).unwrap();
    for (t_ms, pose_valid, proximity_valid) in [(1, false, true), (2, true, false), (3, true, true)]
    {
        world.advance(t_ms * NS_PER_MS);
        let sample = world.odometry(1);
        let valid = [sample.pose_valid == 1, sample.proximity_valid == 1];
        assert_eq!(valid, [pose_valid, proximity_valid]);
        let own = [sample.x_m, sample.y_m, sample.heading_rad, sample.v_m_s, sample.w_rad_s];
        assert_eq!(own == [0.0; 5], !pose_valid, "{own:?}");
        assert_eq!(sample.near == [[0.0; 2]; PROXIMITY_MAX], !proximity_valid, "{:?}", sample.near);
        assert_eq!(sample.proximity_count, if proximity_valid { 2 } else { 0 });
    }
}

#[test]
fn noise_is_drawn_per_number_during_the_fault() {
    let mut brief = brief_of_three_robots();
    let faults = [Sensor::Odometry, Sensor::Proximity];
    let faults = faults.map(|sensor| sensor_fault(sensor, NOISE, 0, 2));
    brief.robots[1].sensor_faults = faults.to_vec();
    brief.robots[1].start.y_m = 0.3;
    let mut world = World::new(&brief);
    for (t_ms, noisy) in [(0, 1.0), (1, 1.0), (2, 0.0)] {
        world.advance(t_ms * NS_PER_MS);
        let tick = world.increment_tick();
        let sample = world.odometry(1);
        let [x, y] = faults[0].position_error_m(tick, 0).map(|error_m| noisy * error_m);
        let heading_rad = noisy * faults[0].heading_error_rad(tick);
        assert_eq!(sample.pose(), Pose { x_m: 2.0 + x, y_m: 0.3 + y, heading_rad });
        let neighbors: Vec<Vec2> = sample.proximity_front_points().collect();
        let noise = [1, 2].map(|item| noisy * Vec2::from(faults[1].position_error_m(tick, item)));
        assert_eq!(neighbors, [Vec2::new(0.1, 0.0) + noise[0], Vec2::new(4.6, 0.0) + noise[1]]);
    }
}

/// Returns the brief of a team with these positions on the x axis and sizes, m, with front points at 0.125 m.
fn brief_of_a_team(x_m: &[f64], keep_m: &[f64]) -> PlantBrief {
    let mut brief = brief(x_m);
    for (body, &keep_m) in brief.robots.iter_mut().zip(keep_m) {
        body.front_point_m = 0.125;
        body.member = Some(MemberBrief {
            keep_m,
            speed_max_m_s: None,
            command_lifetime_ns: 20 * NS_PER_MS,
            class: 0,
        });
    }
    brief
}

#[test]
fn any_pair_of_a_team_below_the_sum_of_its_sizes_is_counted() {
    for (x_m, keep_m, violations) in [
        // The closest pair keeps its distance in both cases.
        ([0.0, 0.31, 0.80, 9.0], [0.1, 0.2, 0.3, 0.1], 1),
        ([0.0, 0.31, 0.82, 9.0], [0.1, 0.2, 0.3, 0.1], 0),
        // A distance equal to the sum is kept.
        ([0.0, 0.75, 1.75, 9.0], [0.25, 0.5, 0.5, 0.5], 0),
        // Large robots, farther apart than the sensing radius of 3 m and than the closest pair.
        ([0.0, 59.0, 200.0, 201.0], [30.0, 30.0, 0.5, 0.5], 1),
    ] {
        let world = World::new(&brief_of_a_team(&x_m, &keep_m));
        assert_eq!(world.truth_header().violations, violations, "{x_m:?}");
    }
}

#[test]
fn distance_violations_are_counted_per_arc_from_the_start() {
    for (distance_m, at_start, later) in [(0.5, 0, 0), (0.49, 1, 11), (0.51, 0, 0)] {
        let mut world = World::new(&brief(&[0.0, distance_m]));
        assert_eq!(world.truth_header().violations, at_start, "{distance_m}");
        world.advance(10 * NS_PER_MS);
        let header = world.truth_header();
        assert_eq!((header.violations, header.closest_t_ns), (later, 0), "{distance_m}");
    }
    let mut world = World::new(&brief(&[0.0, 0.6, 4.5]));
    for sequence in 1..=20 {
        world.accept_command(0, &command(world.t_ns(), sequence, 1.0, 0.0)).unwrap();
        world.advance(10 * sequence * NS_PER_MS);
    }
    let header = world.truth_header();
    assert!((header.closest_m - 0.4).abs() < 1e-12, "{}", header.closest_m);
    assert_eq!((header.closest_pair, header.closest_t_ns), ([0, 1], 200 * NS_PER_MS));
    // From 0.5 m on, at 1 mm per arc. At 0.5 m, rounding decides.
    assert!((100..=101).contains(&header.violations), "{}", header.violations);
}

#[test]
fn stamps_times_and_ticks_count_from_their_origins() {
    let mut world = World::new(&brief_of_three_robots());
    world.start_at(7 * NS_PER_MS);
    assert_eq!((world.increment_tick(), world.increment_tick()), (1, 2));
    world.advance(5 * NS_PER_MS);
    let (header, sample) = (world.truth_header(), world.odometry(0));
    assert_eq!(
        (world.t_ns(), header.t_ns, sample.t_ns),
        (5 * NS_PER_MS, 5 * NS_PER_MS, 5 * NS_PER_MS)
    );
    assert_eq!((header.stamp_ns, sample.stamp_ns), (12 * NS_PER_MS, 12 * NS_PER_MS));
    assert_eq!((header.tick, sample.tick), (2, 2));
}
