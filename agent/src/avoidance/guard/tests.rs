//! Requirements on the brief, stopping conditions, granted commands, and documented figures of the guard.

use formation::ramp::Ramp;
use protocol::brief::AvoidanceBrief;

use super::super::exact_hold;
use super::*;

/// Returns a brief with d = 0.2 m, v_max = 0.5 m/s, ell = 0.1 m, T = 10 ms, H = 25 ms and exact sensors.
pub(in super::super) fn brief() -> AgentBrief {
    let mut brief = crate::testing::brief();
    brief.avoidance.kind = "guard".into();
    brief.avoidance.speed_max_m_s = 0.5;
    brief.avoidance.sensing_radius_m = f64::INFINITY;
    brief
}

pub(in super::super) fn sample(
    stamp_ns: u64,
    heading_rad: f64,
    neighbor_vectors: &[Vec2],
) -> Sample<'_> {
    let t_s = stamp_ns as f64 / 1e9;
    Sample {
        stamp_ns,
        t_s,
        heading_rad,
        heading_at_effect: Heading::new(heading_rad),
        neighbor_vectors,
        ..Sample::default()
    }
}

/// Returns the brief of a TurtleBot3 Burger: d = 0.3 m, ell = 0.1 m, T = 10 ms, H = 100 ms, tau = 0.35 s.
fn turtlebot3_burger_brief() -> AgentBrief {
    let mut brief = AgentBrief { front_point_m: 0.1, pace: Pace::Lockstep, ..brief() };
    brief.command_lifetime_ns = 100_000_000;
    brief.limits = Some(AccelerationLimitsBrief {
        acceleration_m_s2: 2.5,
        turn_acceleration_rad_s2: 3.2,
        braking_time_s: 0.35,
        ramp: Ramp::Together,
    });
    brief.avoidance.distance_min_m = 0.3;
    brief.avoidance.speed_max_m_s = 0.22;
    brief.avoidance.braking_time_max_s = 0.35;
    brief
}

/// Returns the brief of this robot with another kind of ramp.
fn turtlebot3_burger_brief_with(ramp: Ramp) -> AgentBrief {
    let mut brief = turtlebot3_burger_brief();
    brief.limits.as_mut().unwrap().ramp = ramp;
    brief
}

#[test]
fn guard_refuses_a_brief_outside_the_assumptions() {
    let refusal = |change: &dyn Fn(&mut AvoidanceBrief)| {
        let mut brief = brief();
        change(&mut brief.avoidance);
        super::super::build(&brief).err().map(|why| why.to_string())
    };
    let needed_m = sensing_radius_m(&MethodConditions::for_robot(&brief()));
    assert_eq!(refusal(&|a| a.sensing_radius_m = needed_m), None);
    let too_small = refusal(&|a| a.sensing_radius_m = needed_m.next_down()).unwrap();
    assert!(too_small.contains("\"guard\" sees too late"), "{too_small}");
    assert!(refusal(&|a| a.sensing_radius_m = f64::NAN).unwrap().contains("sees too late"));
    // Sensor errors require a larger radius.
    let sensor_errors: [&dyn Fn(&mut AvoidanceBrief); 2] =
        [&|a| a.sensing_error_m = 0.01, &|a| a.heading_error_rad = 0.01];
    for set_error in sensor_errors {
        assert!(
            refusal(&|a| {
                a.sensing_radius_m = needed_m;
                set_error(a);
            })
            .is_some()
        );
    }
    assert!(refusal(&|a| a.speed_max_m_s = f64::INFINITY).unwrap().contains("a speed limit"));
}

#[test]
fn robot_stops_if_neighbors_in_range_may_be_unknown() {
    for mut brief in [brief(), turtlebot3_burger_brief()] {
        brief.pace = Pace::Lockstep;
        brief.avoidance.clearance_m = 0.1;
        let VicinityParameters {
            known_robots_radius: robots_radius,
            known_walls_radius: walls_radius,
            ..
        } = Guard::new(&brief).vicinity;
        for (is_valid, is_truncated, distance_factor, moves) in [
            (true, false, None, true),
            (true, false, Some(0.99), true),
            (true, true, Some(1.01), true),
            (true, true, Some(1.0), true),
            // Omitted robots may be within the required radius.
            (true, true, Some(0.99), false),
            (true, true, None, false),
            (false, false, None, false),
            (false, true, Some(1.01), false),
        ] {
            for (radius, is_wall) in [(robots_radius, false), (walls_radius, true)] {
                // The nearest known neighbor is behind the robot.
                let nearest: Vec<Vec2> = distance_factor
                    .iter()
                    .map(|distance_factor| Vec2::new(distance_factor * radius, 0.0))
                    .collect();
                let [neighbor_vectors, walls] =
                    if is_wall { [&[][..], &nearest] } else { [&nearest[..], &[]] };
                let sample = Sample {
                    proximity_valid: is_valid,
                    neighbors_truncated: is_truncated && !is_wall,
                    wall_vectors: walls,
                    walls_truncated: is_truncated && is_wall,
                    ..sample(1_000_000_000, 0.0, neighbor_vectors)
                };
                let twist = Guard::new(&brief).steer(&sample, Vec2::new(0.2, 0.0));
                let expected = if moves { 0.2 } else { 0.0 };
                let error = (twist.v_m_s - expected).hypot(twist.w_rad_s);
                assert!(
                    error < 1e-9,
                    "valid: {is_valid}, cut: {is_truncated}, {neighbor_vectors:?}, {walls:?}: {twist:?}"
                );
            }
        }
    }
}

#[test]
fn command_is_remembered_until_it_expires() {
    let stamps = [1_000_000_000, 1_010_000_000, 1_025_000_000, 2_000_000_000];
    let mut guard = Guard::new(&brief());
    let remembered = stamps.map(|stamp_ns| {
        guard.steer(&sample(stamp_ns, 0.0, &[]), Vec2::zeros());
        guard.unexpired_commands.iter().map(|(answered_ns, _)| *answered_ns).collect::<Vec<u64>>()
    });
    let [a, b, c, d] = stamps;
    // The first command expires at 1.025 s and is inactive at the sample of that instant.
    assert_eq!(remembered, [vec![a], vec![a, b], vec![b, c], vec![d]]);
}

#[test]
fn inertia_stops_robot_until_old_commands_have_expired() {
    // H is 100 ms.
    for (pace, late_ns, since_ns, moves) in [
        (Pace::Realtime, 0, 99_999_999, false),
        (Pace::Realtime, 0, 100_000_000, true),
        (Pace::Lockstep, 1, 99_999_999, false),
        // In lockstep a command has expired by the next tick.
        (Pace::Lockstep, 0, 1, true),
    ] {
        let mut guard = Guard::new(&AgentBrief { pace, late_ns, ..turtlebot3_burger_brief() });
        guard.steer(&sample(1_000_000_000, 0.0, &[]), Vec2::new(0.1, 0.0));
        let later = sample(1_000_000_000 + since_ns, 0.0, &[]);
        let twist = guard.steer(&later, Vec2::new(0.1, 0.0));
        assert_eq!(twist != Twist::ZERO, moves, "{pace:?}, {since_ns}");
    }
}

#[test]
fn commands_of_predecessor_count_as_worst_case() {
    let stamp_ns = 1_000_000_000;
    let neighbor_vectors = [Vec2::new(-0.21, 0.02)];
    let tried = Twist::new(0.3, 1.0);
    let granted = |pace: Pace, since_ns: u64, alive: &[f64]| {
        let mut guard = Guard::new(&AgentBrief { pace, ..brief() });
        guard.drop_expired_commands(stamp_ns - since_ns);
        guard.unexpired_commands =
            { alive }.iter().map(|&w_rad_s| (0, Twist::new(0.0, w_rad_s))).collect();
        guard.grant_twist(&sample(stamp_ns, 0.2, &neighbor_vectors), Twist::ZERO, tried)
    };
    // v_max / ell = 5 rad/s, H = 25 ms.
    let worst = granted(Pace::Lockstep, 0, &[-5.0, 5.0]);
    assert_eq!(granted(Pace::Realtime, 24_999_999, &[]), worst);
    assert_eq!(granted(Pace::Realtime, 25_000_000, &[]), granted(Pace::Lockstep, 0, &[]));
    assert_ne!(granted(Pace::Lockstep, 0, &[]), worst);
    assert_ne!(granted(Pace::Lockstep, 0, &[5.0]), worst);
}

/// Compares with the rows of `docs/explanation/inertia.md`, and with robots that stop at once.
#[test]
fn guard_figures_match_the_documentation() {
    let brief_with = |change: &dyn Fn(&mut AgentBrief)| {
        let mut brief = brief();
        change(&mut brief);
        brief
    };
    let burger_with = |tau: f64, lifetime_ms: u64, v_max: f64| {
        let mut brief = turtlebot3_burger_brief();
        brief.command_lifetime_ns = lifetime_ms * 1_000_000;
        brief.avoidance.speed_max_m_s = v_max;
        brief.avoidance.braking_time_max_s = tau;
        brief
    };
    for (brief, rate, zone) in [
        (burger_with(0.35, 100, 0.22), 2.222, 0.1553),
        (burger_with(0.35, 13, 0.22), 2.755, 0.1110),
        (burger_with(1.5, 100, 1.5), 0.625, 3.37),
        (burger_with(0.75, 100, 0.75), 1.176, 0.930),
        // Without inertia: 1/H and 3 v_max H.
        (brief(), 40.0, 0.0375),
    ] {
        let conditions = MethodConditions::for_robot(&brief);
        let found = [slack_decrease_rate_per_s(&conditions), slow_down_zone_m(&conditions)];
        let error = (found[0] - rate).abs().max((found[1] - zone).abs());
        assert!(error < 5e-3, "{found:?} is not {rate}, {zone}");
    }
    let figures = |brief: &AgentBrief| {
        let conditions = MethodConditions::for_robot(brief);
        [
            deflection_distance_m(&conditions),
            sensing_radius_m(&conditions),
            speed_cap_m_s(&conditions),
        ]
    };
    let brief_of_motion = |period_ms: u64, ell: f64, v_max: f64| {
        brief_with(&|brief| {
            brief.period_ns = period_ms * 1_000_000;
            brief.front_point_m = ell;
            brief.avoidance.speed_max_m_s = v_max;
        })
    };
    let brief_with_clearance = |command_lifetime_ms: u64, clearance_m: f64| {
        brief_with(&|brief| {
            brief.command_lifetime_ns = command_lifetime_ms * 1_000_000;
            brief.avoidance.clearance_m = clearance_m;
        })
    };
    for (brief, expected) in [
        // Expected: d + 1.9 v_max H; d_f + v_max T / 0.17; d/4 and ell/2 over H.
        (brief_of_motion(10, 0.2, 0.5), [0.22375, 0.22375 + 0.005 / 0.17, 2.0]),
        (brief_of_motion(10, 0.08, 0.5), [0.22375, 0.22375 + 0.005 / 0.17, 1.6]),
        // Here d + 3 v_max H is larger, and d_f is at its minimum of 1.05 d.
        (brief_of_motion(1, 0.2, 0.5), [0.22375, 0.2375, 2.0]),
        (brief_of_motion(1, 0.2, 0.2), [0.21, 0.215, 2.0]),
        // The clearance + 3/2 v_max H. Without walls only the radius for robots counts.
        (brief_with_clearance(100, 1.0), [0.295, 1.075, 0.5]),
        (brief_with_clearance(100, 0.0), [0.295, 0.35, 0.5]),
        // Here c_f + v_max T / 0.25 is larger, and c_f is at its minimum of 1.05 clearances.
        (brief_with_clearance(25, 1.0), [0.22375, 1.05 + 0.005 / 0.25, 2.0]),
        // At the axle midpoint d/4 over H alone.
        (brief_of_motion(10, 0.0, 0.5), [0.22375, 0.22375 + 0.005 / 0.17, 2.0]),
        // Here d + Z is larger. d_f is that of robots that stop at once.
        (burger_with(0.35, 1000, 0.22), [0.718, 0.3 + 0.22 * 1.35 * (1.0 + 2.0 / 1.35), 0.05]),
    ] {
        let found = figures(&brief);
        let error = found.iter().zip(expected).map(|(found, expected)| (found - expected).abs());
        assert!(error.fold(0.0, f64::max) < 1e-9, "{found:?} is not {expected:?}");
    }
}

#[test]
fn speed_above_the_recommended_maximum_is_advised_against() {
    let advice = |v_max: f64| {
        let mut brief = brief();
        brief.avoidance.speed_max_m_s = v_max;
        advise_speed_cap(&MethodConditions::for_robot(&brief))
    };
    assert_eq!((advice(1.9), advice(2.0), advice(f64::INFINITY)), (None, None, None));
    let AvoidanceWarning { key, message, expected_value: expected } = advice(2.5).unwrap();
    assert_eq!(key, "speed_max_m_s");
    assert!(
        message.contains("2.5 m/s is above") && expected.contains("at most 2 m/s"),
        "{message}"
    );
}

#[test]
fn front_point_moves_by_gamma_without_neighbors() {
    let mut guard = Guard::new(&AgentBrief { pace: Pace::Lockstep, ..brief() });
    assert!((guard.admit_velocity(Vec2::new(3.0, 4.0)) - Vec2::new(0.3, 0.4)).norm() < 1e-15);
    let gamma = Vec2::new(0.1, 0.3);
    assert_eq!(guard.standoff_error(&sample(500_000_000, 0.7, &[]), gamma), gamma);
    let twist = guard.velocity_to_twist(0.7, gamma);
    assert_eq!(twist, exact_hold(Heading::new(0.7), 0.1, 0.01 * gamma, 0.01));
    assert_eq!(guard.steer(&sample(1_000_000_000, 0.7, &[]), gamma), twist);
    // For a sideways displacement the arc is longer than its chord, so the twist is scaled to the limit.
    let twist = guard.steer(&sample(2_000_000_000, 0.0, &[]), Vec2::new(0.0, 0.5));
    let literal = exact_hold(Heading::ZERO, 0.1, Vec2::new(0.0, 0.005), 0.01);
    assert!(front_speed(0.1, literal) > 0.5 + 1e-6);
    assert!((front_speed(0.1, twist) - 0.5).abs() < 1e-12, "{twist:?}");
    assert!((twist.w_rad_s * literal.v_m_s - twist.v_m_s * literal.w_rad_s).abs() < 1e-12);
}

#[test]
fn request_is_limited_by_braking_time_and_reach() {
    let mut guard = Guard::new(&turtlebot3_burger_brief());
    let requested = |angle: f64| rotate(angle, Vec2::new(0.22, 0.0));
    // Straight ahead from rest: 2.5 m/s^2 for 0.1 s exceeds v_max.
    let ahead = guard.steer(&sample(0, 0.0, &[]), requested(0.0));
    assert!((ahead.v_m_s - 0.22).abs() < 1e-9 && ahead.w_rad_s.abs() < 1e-12, "{ahead:?}");
    // Sideways: ell w = 0.22 m/s corresponds to 2.2 rad/s. The braking time allows 1.12, the reachable range
    // 0.32.
    let sideways = guard.steer(&sample(1_000_000_000, 0.0, &[]), requested(1.5));
    assert!((sideways.w_rad_s - 0.32).abs() < 1e-6, "{sideways:?}");
    let turning = Twist::new(0.0, 1.0);
    let turning_sample = Sample { twist: turning, ..sample(2_000_000_000, 0.0, &[]) };
    let sideways = guard.steer(&turning_sample, requested(1.5));
    assert!((sideways.w_rad_s - 1.12).abs() < 1e-6, "{sideways:?}");
}

#[test]
fn independent_ramps_permit_the_maximum_speed() {
    let brief = turtlebot3_burger_brief_with(Ramp::Independent);
    let twist = Guard::new(&brief).steer(&sample(0, 0.0, &[]), Vec2::new(0.22, 0.0));
    assert!((twist.v_m_s - 0.22).abs() < 1e-9 && twist.w_rad_s.abs() < 1e-12, "{twist:?}");
}

/// A plane has no preferred direction: the same scene, turned, has the same twist.
#[test]
fn certified_twist_does_not_depend_on_the_direction_of_the_axes() {
    let [together, independent] =
        [Ramp::Together, Ramp::Independent].map(turtlebot3_burger_brief_with);
    for brief in [brief(), together, independent] {
        let d = brief.avoidance.distance_min_m;
        let mut limited_count = 0;
        for (distance_m, angle) in [(0.01, 0.3), (0.03, -0.5), (0.06, 0.9), (0.1, 0.0)] {
            let vectors = [(distance_m, angle), (0.2, angle + 2.0)]
                .map(|(excess_m, angle)| rotate(angle, Vec2::new(-(d + excess_m), 0.0)));
            let tried = Twist::new(0.15, 0.4);
            let certified = |turn: f64| {
                let vectors = vectors.map(|z| rotate(turn, z));
                let sample = Sample { twist: Twist::ZERO, ..sample(0, turn, &vectors) };
                Guard::new(&brief).certify(&sample, tried)
            };
            let twist = certified(0.0);
            limited_count += usize::from(twist != tried);
            for turn in [0.7, 1.6, 2.9, -2.2] {
                let turned = certified(turn);
                let difference = (turned.v_m_s - twist.v_m_s).hypot(turned.w_rad_s - twist.w_rad_s);
                assert!(difference < 1e-6, "{distance_m} {turn}: {turned:?}, {twist:?}");
            }
        }
        assert!(limited_count > 0, "no neighbor limited a twist");
    }
}

/// Returns scenes of one to four neighbors at most 0.12 m beyond d, each with a requested twist.
fn crowded_scenes(brief: &AgentBrief) -> impl Iterator<Item = (Vec<Vec2>, Twist)> {
    let d = brief.avoidance.distance_min_m;
    let v_max = brief.avoidance.speed_max_m_s;
    let requests = [(0.7, 1.0), (0.3, -2.5), (-0.5, 1.5), (0.1, 4.0), (0.9, -0.5)];
    (0..20).flat_map(move |scene| {
        let neighbors = (0..1 + scene % 4).map(|i| {
            let (excess_m, angle) = (0.004 * (scene + 3 * i) as f64, 1.3 * (scene + 2 * i) as f64);
            rotate(angle, Vec2::new(d + excess_m, 0.0))
        });
        let neighbors: Vec<Vec2> = neighbors.collect();
        requests.map(|(v, w)| (neighbors.clone(), Twist::new(v * v_max, w)))
    })
}

/// The range of turn rates that the certificate covers is widened by the twist found, and in the last pass to all turn
/// rates, so that a robot that stops at once always has a certificate.
#[test]
fn range_of_turn_rates_is_widened_until_it_contains_the_twist() {
    let mut passes = [0; 3];
    let brief = AgentBrief { pace: Pace::Lockstep, ..brief() };
    for (vectors, request) in crowded_scenes(&brief) {
        let mut guard = Guard::new(&brief);
        let tried = guard.scale_into_twist_set(request);
        let sample = sample(1_000_000_000, 0.4, &vectors);
        let granted = guard.grant_twist(&sample, Twist::ZERO, tried);
        let granted = granted.expect("a certified twist");

        let mut bounds = MotionBounds::default();
        guard.widen_bounds(&mut bounds, Twist::ZERO);
        guard.widen_bounds(&mut bounds, tried);
        let found = [0, 1].map(|_| {
            let twist = guard.certified_twist_near(&sample, tried, bounds);
            let [low, high] = bounds.turn_rate_range;
            guard.widen_bounds(&mut bounds, twist);
            (twist, (low..=high).contains(&twist.w_rad_s))
        });
        let first = found.iter().position(|(_, is_in_range)| *is_in_range);
        passes[first.unwrap_or(2)] += 1;
        if let Some(pass) = first {
            assert_eq!(granted, found[pass].0, "{vectors:?} {request:?}");
        }
    }
    assert!(passes.iter().all(|&count| count > 0), "scenes of each kind: {passes:?}");
}

#[test]
fn uncertified_approach_brakes() {
    let neighbor_vectors = [Vec2::new(-0.301, 0.0)];
    let now = Twist::new(0.2, 0.0);
    let driving = Sample { twist: now, ..sample(0, 0.0, &neighbor_vectors) };
    let mut guard = Guard::new(&turtlebot3_burger_brief());
    assert_eq!(guard.steer(&driving, Vec2::new(0.2, 0.0)), Twist::ZERO);
    // With an unexpired command instead of the twist in force.
    let mut guard = Guard::new(&turtlebot3_burger_brief());
    guard.unexpired_commands.push_back((0, now));
    assert_eq!(guard.certify(&sample(0, 0.0, &neighbor_vectors), now), Twist::ZERO);
    // Moving away there is nothing to certify against.
    let leaving = Sample { twist: now, ..sample(0, PI, &neighbor_vectors) };
    let mut guard = Guard::new(&turtlebot3_burger_brief());
    assert!(guard.certify(&leaving, now).v_m_s > 0.19);
}

/// All robots without inertia, or one such robot among robots with inertia: then with the common Lambda, and
/// for H + T.
#[test]
fn robot_without_inertia_uses_its_full_share_of_the_slack() {
    let alone = AgentBrief { limits: None, ..turtlebot3_burger_brief() };
    for (brief, rate, h) in [(brief(), 40.0, 0.025), (alone, 1.0 / 0.45, 0.11)] {
        let brief = AgentBrief { pace: Pace::Lockstep, ..brief };
        let (d, v_max) = (brief.avoidance.distance_min_m, brief.avoidance.speed_max_m_s);
        for slack in [0.0, 0.001, 0.005, 0.01, 0.02, 0.05, 0.1] {
            let neighbor_vectors = [Vec2::new(-(d + slack), 0.0)];
            let requested = Twist::new(v_max, 0.0);
            // For a robot that stops at once the reported twist is irrelevant.
            let sample = Sample { twist: requested, ..sample(0, 0.0, &neighbor_vectors) };
            let granted = Guard::new(&brief).certify(&sample, requested);
            let at_scale = |sigma: f64| {
                let m = (1.0 + sigma) * v_max * h;
                let b = rate * (slack * (-2.0 * rate * h).exp()).max(slack - m);
                let half_step = 0.5 * (m / (d + slack)).asin();
                let bound = if b < sigma * v_max { b * half_step.cos() } else { f64::MAX };
                (sigma * v_max).min(bound)
            };
            let expected = [1.0, 0.5, 0.25].map(at_scale).into_iter().fold(0.0, f64::max);
            assert!((granted.v_m_s - expected).abs() < 1e-6, "{slack}: {granted:?}, {expected}");
            assert!(granted.w_rad_s.abs() < 1e-6, "{granted:?}");
        }
    }
}
