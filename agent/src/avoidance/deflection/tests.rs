//! Steering around others, yielding, standoff and progress monitoring.

use std::f64::consts::PI;

use formation::scale::Scale;
use formation::trajectory::Trajectory;
use protocol::brief::LeadBrief;

use super::super::guard::tests::brief;
use super::*;

/// Constants for the chapter's focus alone, only as strong as needed, with a dither of 1 rad and without look-ahead
/// and yielding.
const FOCUS_ONLY_CONSTANTS: Constants = Constants {
    dither_rad: 1.0,
    around: 1.0,
    around_at_last: 1.0,
    slack_share: 0.25,
    margin: 1.5,
    look_ahead_turn_rad: 1e-12,
    yield_share: 1e-12,
    ..Constants::TUNED
};

/// Returns a brief with d = 0.2 m, v_max = 0.3 m/s, T = H = 5 ms: d_f = 0.21 m for the first rank, 0.231 m for
/// followers, 0.2352 m for contained robots.
fn slow_robot_brief(rank: YieldPriority) -> AgentBrief {
    let mut brief = AgentBrief { rank, ..brief() };
    (brief.period_ns, brief.command_lifetime_ns) = (5_000_000, 5_000_000);
    brief.avoidance.speed_max_m_s = 0.3;
    brief
}

fn deflection_of_rank(rank: YieldPriority) -> Deflection {
    Deflection::with_constants(&slow_robot_brief(rank), &FOCUS_ONLY_CONSTANTS)
}

#[test]
fn wall_deflection_follows_requested_side_and_keeps_c_f() {
    let mut brief = brief();
    brief.avoidance.clearance_m = 0.1;
    let mut deflection = Deflection::with_constants(&brief, &FOCUS_ONLY_CONSTANTS);
    let c_f = 0.109375; // 0.75 v_max H
    let mut deflect_at = |distance: f64, p: Vec2| {
        let walls = [rotate(0.7, Vec2::new(-distance, 0.0))]; // ahead, turned by 0.7
        let sample = Sample { wall_vectors: &walls, ..Sample::default() };
        rotate(-0.7, deflection.deflect(&sample, rotate(0.7, p)))
    };
    let assert_close = |found: Vec2, x: f64, y: f64| {
        assert!((found - Vec2::new(x, y)).norm() < 1e-12, "{found:?} is not {x}, {y}");
    };
    // At c_f the component into the wall is removed, and redirected to the requested side.
    assert_close(deflect_at(c_f, Vec2::new(3e-3, 2e-3)), 0.0, 5e-3);
    assert_close(deflect_at(c_f, Vec2::new(3e-3, -2e-3)), 0.0, -5e-3);
    assert_close(deflect_at(c_f, Vec2::new(4e-3, 0.0)), 0.0, 0.0);
    // With a small sideways component, a larger fraction is redirected, continuously.
    let side = 1e-4 / (16e-6f64 + 1e-8).sqrt();
    assert_close(deflect_at(c_f, Vec2::new(4e-3, 1e-4)), 0.0, 1e-4 + 4e-3 * 4.0 * side);
    // Closer to the wall it moves away for any request. Farther away a quarter of the remaining slack may be
    // used.
    assert_close(deflect_at(c_f - 4e-3, Vec2::zeros()), -1e-3, 0.0);
    assert_close(deflect_at(c_f + 4e-3, Vec2::new(3e-3, 1e-3)), 1e-3, 3e-3);
    assert_close(deflect_at(c_f + 4e-3, Vec2::new(1e-3, 2e-3)), 1e-3, 2e-3);
    assert_close(deflect_at(c_f + 4e-3, Vec2::new(-4e-3, 2e-3)), -4e-3, 2e-3);
}

/// The scene is rotated by an angle at which no component is 0.
#[test]
fn focus_around_an_obstacle_is_only_as_strong_as_needed() {
    let brief = AgentBrief { index: 2, ..brief() };
    let mut deflection = Deflection::with_constants(&brief, &FOCUS_ONLY_CONSTANTS);
    let (phase, period_s) = (deflection.dither_phase_rad, deflection.dither_period_s);
    assert!((phase - 0.236_067_977_4).abs() < 1e-9);
    assert!((period_s - 1.5 * (1.0 + 4.0 * 0.236_067_977_4 / 3.0)).abs() < 1e-9);
    let rotated = |x: f64, y: f64| rotate(0.7, Vec2::new(x, y));
    // Instant at which the dither has completed `cycles` of its periods.
    let time_of = |cycles: f64| (cycles - phase) * period_s;
    let mut deflect = |cycles: f64, neighbor_vectors: &[Vec2], p: Vec2| {
        deflection
            .deflect(&Sample { t_s: time_of(cycles), neighbor_vectors, ..Sample::default() }, p)
    };
    let assert_close = |found: Vec2, expected: Vec2| {
        assert!((found - expected).norm() < 1e-10, "{found:?} is not {expected:?}");
    };
    let (d_f, reach) = (0.21875, 0.005); // V
    let other = [rotated(-0.212, 0.0)]; // ahead: n = (-1, 0), t = (0, -1)
    let excess = 0.25 * (d_f - 0.212);
    let clipped = |x: f64, y: f64| rotated(x, y) * (reach / x.hypot(y));

    // Straight towards it, at a dither angle of 0.
    assert_close(deflect(3.0, &other, rotated(reach, 0.0)), clipped(-excess, -(excess + reach)));
    // At a dither angle of 1 rad the approach is smaller, and less is added.
    let (sin, cos) = 1f64.sin_cos();
    let lambda = excess + reach * cos;
    let expected = rotated(reach * cos - lambda, reach * sin - lambda);
    assert_close(deflect(3.25, &other, rotated(reach, 0.0)), expected);
    // Moving away faster than required: nothing is deflected.
    assert_close(deflect(3.25, &other, rotated(-0.004, 0.001)), rotated(-0.004, 0.001));
    // A robot that is out of reach within one period is ignored, even if a nearer one pushes towards it by more
    // than the distance of one period.
    let too_near = rotated(-0.2, 0.0);
    let excess = 0.25 * (d_f - 0.2);
    let expected = clipped(-excess, -(excess + reach));
    assert_close(deflect(3.0, &[too_near], rotated(reach, 0.0)), expected);
    assert_close(deflect(3.0, &[too_near, rotated(0.0, 0.24)], rotated(reach, 0.0)), expected);
    // A robot just within reach removes only the excess of one period.
    let just_within_reach = rotated(-(d_f + 0.5 * reach / 0.25), 0.0); // kappa = 0.25
    assert_close(
        deflect(3.0, &[just_within_reach], rotated(reach, 0.0)),
        rotated(0.5 * reach, -0.5 * reach),
    );
    // Coincident positions define no direction to steer around.
    assert!(deflect(3.0, &[Vec2::zeros()], rotated(reach, 0.0)).norm() <= reach);
}

#[test]
fn lower_yield_priority_enlarges_d_f() {
    let [mut first, mut contained] =
        [YieldPriority::First, YieldPriority::Contained].map(deflection_of_rank);
    let expected_d_f = 0.21; // 0.05 d is more than 1.5 v_max H
    assert!(
        (first.deflection_distance - expected_d_f).abs() < 1e-12,
        "{}",
        first.deflection_distance
    );
    assert!(
        (deflection_of_rank(YieldPriority::Follower).deflection_distance - 1.1 * expected_d_f)
            .abs()
            < 1e-12
    );
    assert!(
        (contained.deflection_distance - 1.12 * expected_d_f).abs() < 1e-12,
        "{}",
        contained.deflection_distance
    );

    // The other is ahead, between the two values of d_f, and both robots request to go there.
    let (ahead, neighbor_vectors) = (Vec2::new(1e-3, 0.0), [Vec2::new(-0.23, 0.0)]);
    let sample = Sample { neighbor_vectors: &neighbor_vectors, ..Sample::default() };
    assert!((first.deflect(&sample, ahead) - ahead).norm() < 1e-12);
    let deflected = contained.deflect(&sample, ahead);
    assert!(deflected.x < 0.0 && deflected.y.abs() > 0.0, "back, and around: {deflected:?}");
}

/// Returns the displacement of a robot that requests none next to another at `z` that has moved at a constant
/// velocity for 20 s. `error` is the error of its own slot, which moves as well.
fn deflected_displacement(
    (brief, constants): (&AgentBrief, &Constants),
    error: Vec2,
    z: Vec2,
    [velocity, slot_velocity]: [Vec2; 2],
) -> Vec2 {
    let mut robot = Deflection::with_constants(brief, constants);
    let mut displacement = Vec2::zeros();
    for step in 0..=4000u64 {
        let t_s = 0.005 * step as f64;
        let neighbor_vectors = [z + velocity * (20.0 - t_s)]; // z at the last
        let stamp_ns = 5_000_000 * step;
        let sample_without_neighbors = Sample { stamp_ns, t_s, slot_velocity, ..Sample::default() };
        let sample = Sample {
            neighbor_vectors: &neighbor_vectors,
            error: Some(error),
            ..sample_without_neighbors
        };
        robot.standoff_error(&sample, error);
        displacement = robot.deflect(&sample, Vec2::zeros());
    }
    displacement
}

#[test]
fn arrived_robot_yields_only_to_approaching_robots() {
    let yielding_constants =
        Constants { yield_share: 0.5, yield_speed: 0.5, ..FOCUS_ONLY_CONSTANTS };
    let first = slow_robot_brief(YieldPriority::First);
    let z = rotate(0.4, Vec2::new(0.31, 0.0)); // between d_f and 1.5 d_f = 0.315 m
    let (approaching, passing) = (0.6 * z, 0.6 * Vec2::new(-z.y, z.x)); // 0.19 m/s
    let at_slot = Vec2::new(0.001, 0.0);
    let zero = Vec2::zeros();
    let displacement =
        deflected_displacement((&first, &yielding_constants), at_slot, z, [approaching, zero]);
    assert!(displacement.dot(&z) > 0.0 && displacement.norm() > 1e-4, "{displacement:?}");
    for (what, error, velocities) in [
        ("a robot at rest", at_slot, [zero, zero]),
        ("a robot moving away", at_slot, [-approaching, zero]),
        ("a robot passing as in a turning formation", at_slot, [passing, zero]),
        ("a robot moving along as in a moving formation", at_slot, [approaching, approaching]),
        ("a robot far from its own slot", Vec2::new(3.0, 0.0), [approaching, zero]),
    ] {
        assert!(
            deflected_displacement((&first, &yielding_constants), error, z, velocities).norm()
                < 1e-6,
            "{what}"
        );
    }
    let without =
        deflected_displacement((&first, &FOCUS_ONLY_CONSTANTS), at_slot, z, [approaching, zero]);
    assert!(without.norm() < 1e-12, "no robot yields with a share of almost 0");
    let contained = slow_robot_brief(YieldPriority::Contained);
    let contained =
        deflected_displacement((&contained, &yielding_constants), at_slot, z, [approaching, zero]);
    assert!(contained.norm() < 1e-12, "another may want to stay at a contained robot's place");
    let leader = deflected_displacement(
        (&make_leader(first), &yielding_constants),
        at_slot,
        z,
        [approaching, zero],
    );
    assert!(leader.norm() < 1e-12, "all others follow the leader");
}

/// Makes the robot a leader of all others.
fn make_leader(brief: AgentBrief) -> AgentBrief {
    let trajectory = Trajectory::Still { center_m: [0.0, 0.0] };
    let lead = LeadBrief { scale: Scale::CONSTANT_ONE, trajectory, keep_heading: false };
    AgentBrief { lead: Some(lead), ..brief }
}

#[test]
fn look_ahead_turns_to_the_side_of_the_predicted_passing() {
    let brief = slow_robot_brief(YieldPriority::First);
    let look_ahead_turn_rad = Constants::TUNED.look_ahead_turn_rad;
    let look_ahead_constants = Constants {
        look_ahead: 4.0,
        look_ahead_along_heading: 6.0,
        look_ahead_share: 1.0,
        look_ahead_turn_rad,
        ..FOCUS_ONLY_CONSTANTS
    };
    let ahead = Vec2::new(1.5e-3, 0.0); // 0.3 m/s
    // Returns the turn for another robot with this position and velocity, which is tracked for 1 s before.
    let turn_by = |brief: &AgentBrief, position: Vec2, velocity: Vec2| {
        let mut robot = Deflection::with_constants(brief, &look_ahead_constants);
        for step in 0..=200u64 {
            let stamp_ns = 5_000_000 * step;
            let neighbor_vectors = [-(position - velocity * (1.0 - 0.005 * step as f64))];
            robot.tracker.observe(&Sample {
                stamp_ns,
                neighbor_vectors: &neighbor_vectors,
                ..Sample::default()
            });
        }
        let turned = robot.turn_away_early(ahead);
        assert!((turned.norm() - ahead.norm()).abs() < 1e-15, "as fast as before: {turned:?}");
        turned.y.atan2(turned.x)
    };
    let turn = |position: Vec2, velocity: Vec2| turn_by(&brief, position, velocity);
    let at_rest = Vec2::zeros();
    let [left, right] = [0.05, -0.05].map(|y| turn(Vec2::new(0.6, -y), at_rest));
    assert!(left > 0.01 && (left + right).abs() < 1e-12, "{left}, {right}");
    assert!(turn(Vec2::new(0.6, 0.0), at_rest) != 0.0, "straight at it, to one side");
    for (what, position, velocity) in [
        ("behind", Vec2::new(-0.4, 0.05), at_rest),
        ("wide of it", Vec2::new(0.6, 0.22), at_rest),
        ("too far ahead to be met soon", Vec2::new(1.0, 0.05), at_rest),
        ("going the same way as fast", Vec2::new(0.4, 0.05), Vec2::new(0.3, 0.0)),
    ] {
        assert!(turn(position, velocity).abs() < 1e-9, "{what}: {}", turn(position, velocity));
    }
    let mut axle_brief = brief.clone();
    (axle_brief.front_point_m, axle_brief.turn_rate_max_rad_s) = (0.0, Some(4.0));
    let turn_of_axle = |x_m: f64| turn_by(&axle_brief, Vec2::new(x_m, 0.05), at_rest);
    assert!(turn_of_axle(1.0) < -0.001 && turn_of_axle(1.3) == 0.0, "it needs time to turn");
    let leader = turn_by(&make_leader(brief.clone()), Vec2::new(0.6, -0.05), at_rest);
    assert_eq!(leader, 0.0, "all others follow the leader");
    // Earlier encounters give larger turns, up to the limit.
    let earlier = turn(Vec2::new(0.4, -0.05), at_rest);
    assert!(earlier > left, "{earlier}, {left}");
    let approaching = turn(Vec2::new(0.4, -0.05), Vec2::new(-0.3, 0.0));
    assert!(approaching > earlier, "{approaching}");
    let constants = Constants { look_ahead_turn_rad: 0.1, ..look_ahead_constants };
    let mut robot = Deflection::with_constants(&brief, &constants);
    let neighbor_vectors = [Vec2::new(-0.22, 0.05)];
    robot.tracker.observe(&Sample { neighbor_vectors: &neighbor_vectors, ..Sample::default() });
    let turned = robot.turn_away_early(ahead);
    assert!((turned.y.atan2(turned.x).abs() - 0.1).abs() < 1e-12, "{turned:?}");
}

/// Returns the desired position after standoff, relative to the robot, with others at rest at `neighbor_vectors` for
/// `rest_s`.
fn position_after_standoff(
    robot: &mut Deflection,
    neighbor_vectors: &[Vec2],
    slot: Vec2,
    rest_s: f64,
) -> Vec2 {
    let mut desired = slot;
    let steps = (rest_s / 0.01).round() as u64;
    for step in 0..=steps {
        let stamp_ns = 10_000_000 * step;
        desired = -robot
            .standoff_error(&Sample { stamp_ns, neighbor_vectors, ..Sample::default() }, -slot);
    }
    desired
}

#[test]
fn occupied_slot_is_replaced_by_a_standoff_position() {
    let other = Vec2::new(1.0, 0.0); // seen from the robot
    let is_close = |found: Vec2, expected: Vec2| (found - expected).norm() < 1e-9;
    // The position of a contained robot is replaced at once, any other slot once the other robot has been at
    // rest long enough.
    for (rank, d_f, rest_s) in [
        (YieldPriority::Contained, 0.2352, 0.0),
        (YieldPriority::Follower, 0.231, OCCUPIED_AFTER_S + 0.01),
        (YieldPriority::First, 0.21, OCCUPIED_AFTER_S + 0.01),
    ] {
        let desired =
            |slot| position_after_standoff(&mut deflection_of_rank(rank), &[-other], slot, rest_s);
        // Farther from the other than d_f the desired position is unchanged.
        let free = other + Vec2::new(0.0, d_f + 1e-3);
        assert!(is_close(desired(free), free));
        // With equal positions: in line with the other, at 1.1 d_f.
        assert!(is_close(desired(other), Vec2::new(1.0 - 1.1 * d_f, 0.0)));
        // Near the other: on the side of the slot, and continuous where the slot becomes free.
        let desired_beside = desired(other + Vec2::new(0.0, 0.5 * d_f));
        let expected = rotate(0.25 * PI, Vec2::new(0.0, 1.05 * d_f));
        assert!(is_close(desired_beside - other, expected), "{desired_beside:?}");
        let almost_free = other + Vec2::new(0.0, d_f - 1e-6);
        assert!((desired(almost_free) - almost_free).norm() < 1e-5, "{:?}", desired(almost_free));
        // Of two robots the one nearer to the slot counts.
        let two = [-other, -other - Vec2::new(0.0, 0.3)];
        let desired = position_after_standoff(
            &mut deflection_of_rank(rank),
            &two,
            other + Vec2::new(0.0, 0.3),
            rest_s,
        );
        assert!(((desired + two[1]).norm() - 1.1 * d_f).abs() < 1e-9, "{desired:?}");
    }
    // Two coincident positions, which d excludes, leave the desired position unchanged.
    let slot = Vec2::new(0.1, 0.0);
    assert_eq!(
        position_after_standoff(
            &mut deflection_of_rank(YieldPriority::Contained),
            &[Vec2::zeros()],
            slot,
            0.0
        ),
        slot
    );
}

#[test]
fn slot_is_kept_while_the_other_robot_may_move_on() {
    let other = Vec2::new(1.0, 0.0);
    for rank in [YieldPriority::First, YieldPriority::Follower] {
        let rest_s = OCCUPIED_AFTER_S - 0.02;
        assert_eq!(
            position_after_standoff(&mut deflection_of_rank(rank), &[-other], other, rest_s),
            other
        );
    }
}

#[test]
fn standoff_holds_back_without_steering_around() {
    let mut robot = deflection_of_rank(YieldPriority::Contained);
    let (ahead, neighbor_vectors) = (Vec2::new(1.5e-3, 0.0), [Vec2::new(-0.233, 0.0)]);
    let sample_at = |t_s| Sample { t_s, neighbor_vectors: &neighbor_vectors, ..Sample::default() };
    let deflected = robot.deflect(&sample_at(0.0), ahead);
    assert!(deflected.y.abs() > 1e-4, "{deflected:?}");
    robot.standoff_error(&sample_at(0.0), Vec2::new(-0.233, 0.0));
    // No sideways motion, at any phase of the dither.
    for t_s in [0.0, 0.3, 0.9] {
        let held_back = robot.deflect(&sample_at(t_s), ahead);
        assert!(held_back.x < 0.0 && held_back.y == 0.0, "{held_back:?}");
    }
    robot.standoff_error(&sample_at(0.0), Vec2::new(-1.0, 0.0));
    assert_eq!(robot.deflect(&sample_at(0.0), ahead), deflected);
}

#[test]
fn standoff_keeps_d_s_from_all_but_the_slot_occupant() {
    let mut robot = deflection_of_rank(YieldPriority::Contained);
    let occupant = Vec2::new(-0.25, 0.0); // ahead; both nearer than d_s, and farther away than d_f
    let bystander = Vec2::new(0.0, -0.257);
    let both = Sample { neighbor_vectors: &[occupant, bystander], ..Sample::default() };
    let mut displacement = |slot: Vec2, neighbor_vectors: &[Vec2]| {
        robot.standoff_error(&both, slot);
        robot.deflect(&Sample { neighbor_vectors, ..Sample::default() }, Vec2::zeros())
    };
    assert_eq!(displacement(occupant, &[occupant]), Vec2::zeros());
    let back = 0.25 * (1.1 * 0.2352 - 0.257);
    assert!(
        (displacement(occupant, &[occupant, bystander]) - Vec2::new(0.0, -back)).norm() < 1e-12
    );
    assert_eq!(displacement(Vec2::new(1.0, 1.0), &[occupant, bystander]), Vec2::zeros());
}

#[test]
fn blocked_robot_steers_more_and_rests_ever_longer() {
    let mut robot = deflection_of_rank(YieldPriority::First);
    let (unit_s, error) = (0.2 / 0.3, Vec2::new(-1.0, 0.0));
    let requested = Vec2::new(1.5e-3, 0.0);
    // The robot is blocked and requests to move. Collects the times at which it starts and stops resting, s.
    let neighbor_vectors = [Vec2::new(-0.205, 0.0)];
    let mut change_times = Vec::new();
    let mut was_resting = false;
    for step in 0..30_000u64 {
        let (stamp_ns, t_s) = (10_000_000 * step, 0.01 * step as f64);
        let sample = Sample {
            stamp_ns,
            t_s,
            neighbor_vectors: &neighbor_vectors,
            error: Some(error),
            ..Sample::default()
        };
        robot.deflect(&sample, requested);
        let is_resting = robot.progress.is_resting();
        if is_resting != was_resting {
            change_times.push(t_s / unit_s);
        }
        was_resting = is_resting;
        assert!(
            robot.progress.missing_progress() > 0.0 || t_s < unit_s,
            "it counts as getting nowhere"
        );
    }
    let durations: Vec<f64> =
        change_times.windows(2).map(|pair| (pair[1] - pair[0]).round()).collect();
    assert!(
        durations.starts_with(&[30.0, 30.0, 60.0, 30.0, 120.0][..]),
        "tries and rests: {durations:?}"
    );
    // Closer to its slot, or with a different slot, it tries again at once.
    for error in [Vec2::new(-0.98, 0.0), Vec2::new(-1.5, 0.0)] {
        let mut robot = deflection_of_rank(YieldPriority::First);
        for step in 0..4000u64 {
            let error = Some(if step < 3999 { Vec2::new(-1.0, 0.0) } else { error });
            let stamp_ns = 10_000_000 * step;
            robot.deflect(
                &Sample {
                    stamp_ns,
                    neighbor_vectors: &neighbor_vectors,
                    error,
                    ..Sample::default()
                },
                requested,
            );
            let expected = step < 3999 && 0.01 * step as f64 > 31.0 * unit_s;
            if expected || step == 3999 {
                assert_eq!(robot.progress.is_resting(), expected, "{step}");
            }
        }
    }
}
