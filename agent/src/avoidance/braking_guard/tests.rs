//! When a robot with inertia stands, what of a command it is granted, and its figures.

use protocol::brief::RampKind;

use super::super::guard::tests::{brief, sample as sample_at};
use super::*;

/// A TurtleBot3 Burger: d = 0.3 m, ell = 0.1 m, T = 10 ms, H = 100 ms, tau = 0.35 s.
fn burger() -> AgentBrief {
    let mut brief = AgentBrief { front_point_m: 0.1, pace: Pace::Lockstep, ..brief() };
    brief.command_lifetime_ns = 100_000_000;
    brief.limits = Some(LimitsBrief {
        acceleration_m_s2: 2.5,
        turn_acceleration_rad_s2: 3.2,
        braking_time_s: 0.35,
        ramp: RampKind::Together,
    });
    brief.avoidance.distance_min_m = 0.3;
    brief.avoidance.speed_max_m_s = 0.22;
    brief.avoidance.braking_time_max_s = 0.35;
    brief
}

fn near(found: f64, expected: f64) -> bool {
    (found - expected).abs() < 1e-3
}

/// The rows of `docs/explanation/inertia.md`.
#[test]
fn its_figures_are_those_of_the_documentation() {
    let figures = |tau: f64, lifetime_ms: u64, v_max: f64| {
        let mut brief = burger();
        brief.command_lifetime_ns = lifetime_ms * 1_000_000;
        brief.avoidance.speed_max_m_s = v_max;
        brief.avoidance.braking_time_max_s = tau;
        let at = Conditions::of(&brief);
        [rate_per_s(&at), slow_down_zone_m(&at)]
    };
    for (found, expected) in [
        (figures(0.35, 100, 0.22), [2.222, 0.1553]),
        (figures(0.35, 13, 0.22), [2.755, 0.1110]),
        (figures(1.5, 100, 1.5), [0.625, 3.37]),
        (figures(0.75, 100, 0.75), [1.176, 0.930]),
    ] {
        let off = (found[0] - expected[0]).abs().max((found[1] - expected[1]).abs());
        assert!(off < 5e-3, "{found:?} is not {expected:?}");
    }
    let at = burger();
    let at = Conditions::of(&at);
    assert!(near(robots_radius_m(&at), 0.3 + slow_down_zone_m(&at)));
    // The deflection asks for more where the zone is small.
    let mut slow = burger();
    slow.command_lifetime_ns = 1_000_000_000;
    let at = Conditions::of(&slow);
    let deflected = deflection_distance_m(&at) + 0.22 * 1.35;
    assert!(near(robots_radius_m(&at), deflected.max(0.3 + slow_down_zone_m(&at))));
}

#[test]
fn the_guard_with_inertia_answers_for_all_as_soon_as_one_has_limits() {
    // It alone stands for the first lifetime in real time.
    let answer = |tau: f64| {
        let mut brief = AgentBrief { limits: None, pace: Pace::Realtime, ..burger() };
        brief.avoidance.braking_time_max_s = tau;
        let mut guard = super::super::build(&brief).unwrap();
        guard.steer(&sample_at(0, 0.0, &[]), Vec2::new(0.1, 0.0))
    };
    assert!(answer(0.0).v_m_s > 0.09);
    assert_eq!(answer(0.35), Twist::ZERO);
}

#[test]
fn after_a_start_it_stands_until_no_predecessor_can_act_and_in_lockstep_not_at_all() {
    let moves = |pace: Pace, since_ns: u64| {
        let mut guard = BrakingGuard::new(&AgentBrief { pace, ..burger() });
        guard.steer(&sample_at(1_000_000_000, 0.0, &[]), Vec2::new(0.1, 0.0));
        let later = sample_at(1_000_000_000 + since_ns, 0.0, &[]);
        guard.steer(&later, Vec2::new(0.1, 0.0)) != Twist::ZERO
    };
    assert!(!moves(Pace::Realtime, 99_999_999));
    assert!(moves(Pace::Realtime, 100_000_000));
    assert!(moves(Pace::Lockstep, 1));
}

#[test]
fn a_robot_that_may_not_see_everybody_who_matters_brakes() {
    let needed = BrakingGuard::new(&burger()).kept.robots_radius;
    let (inside, beyond) = ([Vec2::new(0.99 * needed, 0.0)], [Vec2::new(1.01 * needed, 0.0)]);
    for (valid, cut, away, moves) in [
        (true, false, &inside[..], true),
        (true, true, &beyond, true),
        (true, true, &inside, false),
        (true, true, &[], false),
        (false, false, &[], false),
    ] {
        let seen = Sample {
            proximity_valid: valid,
            proximity_cut: cut,
            ..sample_at(1_000_000_000, 0.0, away)
        };
        let twist = BrakingGuard::new(&burger()).steer(&seen, Vec2::new(0.1, 0.0));
        assert_eq!(twist != Twist::ZERO, moves, "valid: {valid}, cut: {cut}, {away:?}");
    }
}

#[test]
fn with_nobody_near_it_asks_for_no_more_than_it_can_brake_from_and_reach() {
    let mut guard = BrakingGuard::new(&burger());
    let wanted = |angle: f64| rotate(angle, Vec2::new(0.22, 0.0));
    // Straight on from standing: 2.5 m/s^2 for 0.1 s is more than v_max.
    let ahead = guard.steer(&sample_at(0, 0.0, &[]), wanted(0.0));
    assert!((ahead.v_m_s - 0.22).abs() < 1e-9 && ahead.w_rad_s.abs() < 1e-12, "{ahead:?}");
    // Sideways: ell w = 0.22 m/s would be 2.2 rad/s; braking allows 1.12, reach 0.32.
    let aside = guard.steer(&sample_at(1_000_000_000, 0.0, &[]), wanted(1.5));
    assert!((aside.w_rad_s - 0.32).abs() < 1e-6, "{aside:?}");
    let turning = Twist { v_m_s: 0.0, w_rad_s: 1.0 };
    let sample = Sample { twist: turning, ..sample_at(2_000_000_000, 0.0, &[]) };
    let aside = guard.steer(&sample, wanted(1.5));
    assert!((aside.w_rad_s - 1.12).abs() < 1e-6, "{aside:?}");
}

#[test]
fn who_drives_at_somebody_without_a_certificate_brakes() {
    let away = [Vec2::new(-0.301, 0.0)];
    let now = Twist { v_m_s: 0.2, w_rad_s: 0.0 };
    let sample = Sample { twist: now, ..sample_at(0, 0.0, &away) };
    let mut guard = BrakingGuard::new(&burger());
    assert_eq!(guard.steer(&sample, Vec2::new(0.2, 0.0)), Twist::ZERO);
    // The same as a command under way.
    let mut guard = BrakingGuard::new(&burger());
    guard.alive.push_back((0, now));
    assert_eq!(guard.bound(&sample_at(0, 0.0, &away), now), Twist::ZERO);
    // Away from it there is nothing to certify against.
    let sample = Sample { twist: now, ..sample_at(0, PI, &away) };
    let mut guard = BrakingGuard::new(&burger());
    assert!(guard.bound(&sample, now).v_m_s > 0.19);
}

/// Among robots with inertia, one without has the other guard's bound, with the common Lambda.
#[test]
fn a_robot_that_stops_at_once_goes_as_fast_as_its_share_of_the_slack() {
    let brief = AgentBrief { limits: None, ..burger() };
    let at = Conditions::of(&brief);
    let (rate, h) = (rate_per_s(&at), 0.11); // H + T
    for slack in [0.0, 0.005, 0.02, 0.05] {
        let mut guard = BrakingGuard::new(&brief);
        let away = [Vec2::new(-(0.3 + slack), 0.0)];
        let wanted = Twist { v_m_s: 0.22, w_rad_s: 0.0 };
        // A twist that is over counts for nothing.
        let sample = Sample { twist: wanted, ..sample_at(0, 0.0, &away) };
        let granted = guard.bound(&sample, wanted);
        let at_scale = |sigma: f64| {
            let m = (1.0 + sigma) * 0.22 * h;
            let b = rate * (slack * (-2.0 * rate * h).exp()).max(slack - m);
            let half_step = 0.5 * (m / (0.3 + slack)).asin();
            (sigma * 0.22).min(if b < sigma * 0.22 { b * half_step.cos() } else { f64::MAX })
        };
        let expected = [1.0, 0.5, 0.25].map(at_scale).into_iter().fold(0.0, f64::max);
        assert!((granted.v_m_s - expected).abs() < 1e-6, "{slack}: {granted:?}, {expected}");
    }
}
