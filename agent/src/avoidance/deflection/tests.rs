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
    let mut led = |far: f64, p: Vec2| {
        let walls = [rotate(0.7, Vec2::new(-far, 0.0))]; // ahead, turned by 0.7
        let beside = Sample { wall_vectors: &walls, ..Sample::default() };
        rotate(-0.7, deflection.deflect(&beside, rotate(0.7, p)))
    };
    let near = |found: Vec2, x: f64, y: f64| {
        assert!((found - Vec2::new(x, y)).norm() < 1e-12, "{found:?} is not {x}, {y}");
    };
    // At c_f the component into the wall is removed, and redirected to the requested side.
    near(led(c_f, Vec2::new(3e-3, 2e-3)), 0.0, 5e-3);
    near(led(c_f, Vec2::new(3e-3, -2e-3)), 0.0, -5e-3);
    near(led(c_f, Vec2::new(4e-3, 0.0)), 0.0, 0.0);
    // With a small sideways component, a larger fraction is redirected, continuously.
    let side = 1e-4 / (16e-6f64 + 1e-8).sqrt();
    near(led(c_f, Vec2::new(4e-3, 1e-4)), 0.0, 1e-4 + 4e-3 * 4.0 * side);
    // Closer to the wall it moves away for any request. Farther away a quarter of the remaining slack may be
    // used.
    near(led(c_f - 4e-3, Vec2::zeros()), -1e-3, 0.0);
    near(led(c_f + 4e-3, Vec2::new(3e-3, 1e-3)), 1e-3, 3e-3);
    near(led(c_f + 4e-3, Vec2::new(1e-3, 2e-3)), 1e-3, 2e-3);
    near(led(c_f + 4e-3, Vec2::new(-4e-3, 2e-3)), -4e-3, 2e-3);
}

/// The scene is rotated by an angle at which no component is 0.
#[test]
fn focus_around_an_obstacle_is_only_as_strong_as_needed() {
    let brief = AgentBrief { index: 2, ..brief() };
    let mut deflection = Deflection::with_constants(&brief, &FOCUS_ONLY_CONSTANTS);
    let (phase, period_s) = (deflection.dither_phase_rad, deflection.dither_period_s);
    assert!((phase - 0.236_067_977_4).abs() < 1e-9);
    assert!((period_s - 1.5 * (1.0 + 4.0 * 0.236_067_977_4 / 3.0)).abs() < 1e-9);
    let turned = |x: f64, y: f64| rotate(0.7, Vec2::new(x, y));
    // Instant at which the dither has completed `turns` of its periods.
    let at = |turns: f64| (turns - phase) * period_s;
    let mut deflect = |turns: f64, away: &[Vec2], p: Vec2| {
        deflection
            .deflect(&Sample { t_s: at(turns), neighbor_vectors: away, ..Sample::default() }, p)
    };
    let near = |found: Vec2, expected: Vec2| {
        assert!((found - expected).norm() < 1e-10, "{found:?} is not {expected:?}");
    };
    let (d_f, reach) = (0.21875, 0.005); // V
    let other = [turned(-0.212, 0.0)]; // ahead: n = (-1, 0), t = (0, -1)
    let excess = 0.25 * (d_f - 0.212);
    let clipped = |x: f64, y: f64| turned(x, y) * (reach / x.hypot(y));

    // Straight towards it, at a dither angle of 0.
    near(deflect(3.0, &other, turned(reach, 0.0)), clipped(-excess, -(excess + reach)));
    // At a dither angle of 1 rad the approach is smaller, and less is added.
    let (sin, cos) = 1f64.sin_cos();
    let lambda = excess + reach * cos;
    let expected = turned(reach * cos - lambda, reach * sin - lambda);
    near(deflect(3.25, &other, turned(reach, 0.0)), expected);
    // Moving away faster than required: nothing is deflected.
    near(deflect(3.25, &other, turned(-0.004, 0.001)), turned(-0.004, 0.001));
    // A robot that is out of reach within one period is ignored, even if a nearer one pushes towards it by more
    // than the distance of one period.
    let deep = turned(-0.2, 0.0);
    let excess = 0.25 * (d_f - 0.2);
    let expected = clipped(-excess, -(excess + reach));
    near(deflect(3.0, &[deep], turned(reach, 0.0)), expected);
    near(deflect(3.0, &[deep, turned(0.0, 0.24)], turned(reach, 0.0)), expected);
    // A robot just within reach removes only the excess of one period.
    let half_of_it = turned(-(d_f + 0.5 * reach / 0.25), 0.0); // kappa = 0.25
    near(deflect(3.0, &[half_of_it], turned(reach, 0.0)), turned(0.5 * reach, -0.5 * reach));
    // Coincident positions define no direction to steer around.
    assert!(deflect(3.0, &[Vec2::zeros()], turned(reach, 0.0)).norm() <= reach);
}

#[test]
fn lower_yield_priority_enlarges_d_f() {
    let [mut keeps, mut gives] =
        [YieldPriority::First, YieldPriority::Contained].map(deflection_of_rank);
    let expected_d_f = 0.21; // 0.05 d is more than 1.5 v_max H
    assert!(
        (keeps.deflection_distance - expected_d_f).abs() < 1e-12,
        "{}",
        keeps.deflection_distance
    );
    assert!(
        (deflection_of_rank(YieldPriority::Follower).deflection_distance - 1.1 * expected_d_f)
            .abs()
            < 1e-12
    );
    assert!(
        (gives.deflection_distance - 1.12 * expected_d_f).abs() < 1e-12,
        "{}",
        gives.deflection_distance
    );

    // The other is ahead, between the two values of d_f, and both robots request to go there.
    let (ahead, away) = (Vec2::new(1e-3, 0.0), [Vec2::new(-0.23, 0.0)]);
    let sample = Sample { neighbor_vectors: &away, ..Sample::default() };
    assert!((keeps.deflect(&sample, ahead) - ahead).norm() < 1e-12);
    let led = gives.deflect(&sample, ahead);
    assert!(led.x < 0.0 && led.y.abs() > 0.0, "back, and around: {led:?}");
}

/// Returns the displacement of a robot that requests none next to another at `z` that has moved at a constant
/// velocity for 20 s. `error` is the error of its own slot, which moves as well.
fn deflected_displacement(
    (brief, constants): (&AgentBrief, &Constants),
    error: Vec2,
    z: Vec2,
    [velocity, place_velocity]: [Vec2; 2],
) -> Vec2 {
    let mut robot = Deflection::with_constants(brief, constants);
    let mut answer = Vec2::zeros();
    for step in 0..=4000u64 {
        let t_s = 0.005 * step as f64;
        let away = [z + velocity * (20.0 - t_s)]; // z at the last
        let stamp_ns = 5_000_000 * step;
        let at = Sample { stamp_ns, t_s, slot_velocity: place_velocity, ..Sample::default() };
        let seen = Sample { neighbor_vectors: &away, error: Some(error), ..at };
        robot.standoff_error(&seen, error);
        answer = robot.deflect(&seen, Vec2::zeros());
    }
    answer
}

#[test]
fn arrived_robot_yields_only_to_approaching_robots() {
    let yielding = Constants { yield_share: 0.5, yield_speed: 0.5, ..FOCUS_ONLY_CONSTANTS };
    let first = slow_robot_brief(YieldPriority::First);
    let z = rotate(0.4, Vec2::new(0.31, 0.0)); // between d_f and 1.5 d_f = 0.315 m
    let (comes, passes) = (0.6 * z, 0.6 * Vec2::new(-z.y, z.x)); // 0.19 m/s
    let at_home = Vec2::new(0.001, 0.0);
    let nothing = Vec2::zeros();
    let aside = deflected_displacement((&first, &yielding), at_home, z, [comes, nothing]);
    assert!(aside.dot(&z) > 0.0 && aside.norm() > 1e-4, "{aside:?}");
    for (what, error, velocities) in [
        ("a robot at rest", at_home, [nothing, nothing]),
        ("a robot moving away", at_home, [-comes, nothing]),
        ("a robot passing as in a turning formation", at_home, [passes, nothing]),
        ("a robot moving along as in a moving formation", at_home, [comes, comes]),
        ("a robot far from its own slot", Vec2::new(3.0, 0.0), [comes, nothing]),
    ] {
        assert!(
            deflected_displacement((&first, &yielding), error, z, velocities).norm() < 1e-6,
            "{what}"
        );
    }
    let without =
        deflected_displacement((&first, &FOCUS_ONLY_CONSTANTS), at_home, z, [comes, nothing]);
    assert!(without.norm() < 1e-12, "no robot yields with a share of almost 0");
    let contained = slow_robot_brief(YieldPriority::Contained);
    let contained = deflected_displacement((&contained, &yielding), at_home, z, [comes, nothing]);
    assert!(contained.norm() < 1e-12, "another may want to stay at a contained robot's place");
    let leader =
        deflected_displacement((&make_leader(first), &yielding), at_home, z, [comes, nothing]);
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
    let ahead_only = Constants {
        look_ahead: 4.0,
        look_ahead_share: 1.0,
        look_ahead_turn_rad,
        ..FOCUS_ONLY_CONSTANTS
    };
    let ahead = Vec2::new(1.5e-3, 0.0); // 0.3 m/s
    // Returns the turn for another robot with this position and velocity, which is tracked for 1 s before.
    let turn_of = |brief: &AgentBrief, at: Vec2, velocity: Vec2| {
        let mut robot = Deflection::with_constants(brief, &ahead_only);
        for step in 0..=200u64 {
            let stamp_ns = 5_000_000 * step;
            let away = [-(at - velocity * (1.0 - 0.005 * step as f64))];
            robot.tracker.observe(&Sample {
                stamp_ns,
                neighbor_vectors: &away,
                ..Sample::default()
            });
        }
        let led = robot.turn_away_early(ahead);
        assert!((led.norm() - ahead.norm()).abs() < 1e-15, "as fast as before: {led:?}");
        led.y.atan2(led.x)
    };
    let turn = |at: Vec2, velocity: Vec2| turn_of(&brief, at, velocity);
    let still = Vec2::zeros();
    let [left, right] = [0.05, -0.05].map(|y| turn(Vec2::new(0.6, -y), still));
    assert!(left > 0.01 && (left + right).abs() < 1e-12, "{left}, {right}");
    assert!(turn(Vec2::new(0.6, 0.0), still) != 0.0, "straight at it, to one side");
    for (what, at, velocity) in [
        ("behind", Vec2::new(-0.4, 0.05), still),
        ("wide of it", Vec2::new(0.6, 0.22), still),
        ("too far ahead to be met soon", Vec2::new(1.0, 0.05), still),
        ("going the same way as fast", Vec2::new(0.4, 0.05), Vec2::new(0.3, 0.0)),
    ] {
        assert!(turn(at, velocity).abs() < 1e-9, "{what}: {}", turn(at, velocity));
    }
    let leader = turn_of(&make_leader(brief.clone()), Vec2::new(0.6, -0.05), still);
    assert_eq!(leader, 0.0, "all others follow the leader");
    // Earlier encounters give larger turns, up to the limit.
    let sooner = turn(Vec2::new(0.4, -0.05), still);
    assert!(sooner > left, "{sooner}, {left}");
    let comes = turn(Vec2::new(0.4, -0.05), Vec2::new(-0.3, 0.0));
    assert!(comes > sooner, "{comes}");
    let constants = Constants { look_ahead_turn_rad: 0.1, ..ahead_only };
    let mut robot = Deflection::with_constants(&brief, &constants);
    let away = [Vec2::new(-0.22, 0.05)];
    robot.tracker.observe(&Sample { neighbor_vectors: &away, ..Sample::default() });
    let led = robot.turn_away_early(ahead);
    assert!((led.y.atan2(led.x).abs() - 0.1).abs() < 1e-12, "{led:?}");
}

/// Returns the desired position after standoff, relative to the robot, with others at rest at `away` for
/// `since_s`.
fn position_after_standoff(
    robot: &mut Deflection,
    away: &[Vec2],
    place: Vec2,
    since_s: f64,
) -> Vec2 {
    let mut asked = place;
    let steps = (since_s / 0.01).round() as u64;
    for step in 0..=steps {
        let stamp_ns = 10_000_000 * step;
        asked = -robot.standoff_error(
            &Sample { stamp_ns, neighbor_vectors: away, ..Sample::default() },
            -place,
        );
    }
    asked
}

#[test]
fn occupied_slot_is_replaced_by_a_standoff_position() {
    let other = Vec2::new(1.0, 0.0); // seen from the robot
    let close = |found: Vec2, expected: Vec2| (found - expected).norm() < 1e-9;
    // The position of a contained robot is replaced at once, any other slot once the other robot has been at
    // rest long enough.
    for (rank, d_f, since_s) in [
        (YieldPriority::Contained, 0.2352, 0.0),
        (YieldPriority::Follower, 0.231, OCCUPIED_AFTER_S + 0.01),
        (YieldPriority::First, 0.21, OCCUPIED_AFTER_S + 0.01),
    ] {
        let asked = |place| {
            position_after_standoff(&mut deflection_of_rank(rank), &[-other], place, since_s)
        };
        // Farther from the other than d_f the desired position is unchanged.
        let free = other + Vec2::new(0.0, d_f + 1e-3);
        assert!(close(asked(free), free));
        // With equal positions: in line with the other, at 1.1 d_f.
        assert!(close(asked(other), Vec2::new(1.0 - 1.1 * d_f, 0.0)));
        // Near the other: on the side of the slot, and continuous where the slot becomes free.
        let aside = asked(other + Vec2::new(0.0, 0.5 * d_f));
        let expected = rotate(0.25 * PI, Vec2::new(0.0, 1.05 * d_f));
        assert!(close(aside - other, expected), "{aside:?}");
        let nearly = other + Vec2::new(0.0, d_f - 1e-6);
        assert!((asked(nearly) - nearly).norm() < 1e-5, "{:?}", asked(nearly));
        // Of two robots the one nearer to the slot counts.
        let two = [-other, -other - Vec2::new(0.0, 0.3)];
        let asked = position_after_standoff(
            &mut deflection_of_rank(rank),
            &two,
            other + Vec2::new(0.0, 0.3),
            since_s,
        );
        assert!(((asked + two[1]).norm() - 1.1 * d_f).abs() < 1e-9, "{asked:?}");
    }
    // Two coincident positions, which d excludes, leave the desired position unchanged.
    let place = Vec2::new(0.1, 0.0);
    assert_eq!(
        position_after_standoff(
            &mut deflection_of_rank(YieldPriority::Contained),
            &[Vec2::zeros()],
            place,
            0.0
        ),
        place
    );
}

#[test]
fn slot_is_kept_while_the_other_robot_may_move_on() {
    let other = Vec2::new(1.0, 0.0);
    for rank in [YieldPriority::First, YieldPriority::Follower] {
        let nearly_s = OCCUPIED_AFTER_S - 0.02;
        assert_eq!(
            position_after_standoff(&mut deflection_of_rank(rank), &[-other], other, nearly_s),
            other
        );
    }
}

#[test]
fn standoff_holds_back_without_steering_around() {
    let mut robot = deflection_of_rank(YieldPriority::Contained);
    let (ahead, away) = (Vec2::new(1.5e-3, 0.0), [Vec2::new(-0.233, 0.0)]);
    let at = |t_s| Sample { t_s, neighbor_vectors: &away, ..Sample::default() };
    let around = robot.deflect(&at(0.0), ahead);
    assert!(around.y.abs() > 1e-4, "{around:?}");
    robot.standoff_error(&at(0.0), Vec2::new(-0.233, 0.0));
    // No sideways motion, at any phase of the dither.
    for t_s in [0.0, 0.3, 0.9] {
        let back = robot.deflect(&at(t_s), ahead);
        assert!(back.x < 0.0 && back.y == 0.0, "{back:?}");
    }
    robot.standoff_error(&at(0.0), Vec2::new(-1.0, 0.0));
    assert_eq!(robot.deflect(&at(0.0), ahead), around);
}

#[test]
fn standoff_keeps_d_s_from_all_but_the_slot_occupant() {
    let mut robot = deflection_of_rank(YieldPriority::Contained);
    let taker = Vec2::new(-0.25, 0.0); // ahead; both nearer than d_s, and farther away than d_f
    let beside = Vec2::new(0.0, -0.257);
    let both = Sample { neighbor_vectors: &[taker, beside], ..Sample::default() };
    let mut moved = |wanted: Vec2, away: &[Vec2]| {
        robot.standoff_error(&both, wanted);
        robot.deflect(&Sample { neighbor_vectors: away, ..Sample::default() }, Vec2::zeros())
    };
    assert_eq!(moved(taker, &[taker]), Vec2::zeros());
    let back = 0.25 * (1.1 * 0.2352 - 0.257);
    assert!((moved(taker, &[taker, beside]) - Vec2::new(0.0, -back)).norm() < 1e-12);
    assert_eq!(moved(Vec2::new(1.0, 1.0), &[taker, beside]), Vec2::zeros());
}

#[test]
fn blocked_robot_steers_more_and_rests_ever_longer() {
    let mut robot = deflection_of_rank(YieldPriority::First);
    let (unit_s, error) = (0.2 / 0.3, Vec2::new(-1.0, 0.0));
    let wanted = Vec2::new(1.5e-3, 0.0);
    // The robot is blocked and requests to move. Collects the times at which it starts and stops resting, s.
    let away = [Vec2::new(-0.205, 0.0)];
    let mut rests = Vec::new();
    let mut was = false;
    for step in 0..30_000u64 {
        let (stamp_ns, t_s) = (10_000_000 * step, 0.01 * step as f64);
        let seen = Sample {
            stamp_ns,
            t_s,
            neighbor_vectors: &away,
            error: Some(error),
            ..Sample::default()
        };
        robot.deflect(&seen, wanted);
        let rests_now = robot.progress.is_resting();
        if rests_now != was {
            rests.push(t_s / unit_s);
        }
        was = rests_now;
        assert!(
            robot.progress.missing_progress() > 0.0 || t_s < unit_s,
            "it counts as getting nowhere"
        );
    }
    let lasts: Vec<f64> = rests.windows(2).map(|pair| (pair[1] - pair[0]).round()).collect();
    assert!(lasts.starts_with(&[30.0, 30.0, 60.0, 30.0, 120.0][..]), "tries and rests: {lasts:?}");
    // Closer to its slot, or with a different slot, it tries again at once.
    for error in [Vec2::new(-0.98, 0.0), Vec2::new(-1.5, 0.0)] {
        let mut robot = deflection_of_rank(YieldPriority::First);
        for step in 0..4000u64 {
            let error = Some(if step < 3999 { Vec2::new(-1.0, 0.0) } else { error });
            let stamp_ns = 10_000_000 * step;
            robot.deflect(
                &Sample { stamp_ns, neighbor_vectors: &away, error, ..Sample::default() },
                wanted,
            );
            let expected = step < 3999 && 0.01 * step as f64 > 31.0 * unit_s;
            if expected || step == 3999 {
                assert_eq!(robot.progress.is_resting(), expected, "{step}");
            }
        }
    }
}
