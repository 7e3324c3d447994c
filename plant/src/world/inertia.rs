//! Robots whose twist cannot change at once: the rules that the guard with inertia rests on.

use formation::pose::Pose;
use formation::unicycle::arc;
use proptest::prelude::*;
use protocol::brief::{Format, LimitsBrief, RampKind};

use super::*;

const MS: u64 = 1_000_000;
const LIFETIME_NS: u64 = 20 * MS;
const START: Pose = Pose { x_m: 0.0, y_m: 0.0, heading_rad: 0.0 };

/// a_v = 2 m/s^2, a_w = 10 rad/s^2, ell = 0.1 m, v_max = 1 m/s, H = 20 ms.
fn world(ramp: RampKind, wheel_faults: Vec<protocol::fault::WheelFault>) -> World {
    World::new(&brief(ramp, wheel_faults))
}

fn brief(ramp: RampKind, wheel_faults: Vec<protocol::fault::WheelFault>) -> PlantBrief {
    let limits = LimitsBrief {
        acceleration_m_s2: 2.0,
        turn_acceleration_rad_s2: 10.0,
        braking_time_s: 0.5,
        ramp,
    };
    PlantBrief {
        format: Format,
        run_root: "/nowhere".into(),
        pace: Pace::Realtime,
        duration_ns: 1_000_000_000,
        period_ns: 10 * MS,
        plant_tick_ns: MS,
        command_lifetime_ns: LIFETIME_NS,
        distance_min_m: 0.5,
        speed_max_m_s: Some(1.0),
        sensing_radius_m: 3.0,
        velocities_sensed: false,
        clearance_m: 0.0,
        program: None,
        obstacles: Vec::new(),
        robots: vec![BodyBrief {
            name: "r1".into(),
            front_point_m: 0.1,
            wheels: None,
            limits: Some(limits),
            start: START,
            sensor_faults: Vec::new(),
            wheel_faults,
            command_faults: Vec::new(),
        }],
    }
}

fn command(stamp_ns: u64, v_m_s: f64, w_rad_s: f64) -> Command {
    let sequence = stamp_ns + 1;
    Command { tick: 0, stamp_ns, sent_ns: 0, sequence, incarnation: 0, v_m_s, w_rad_s }
}

fn close(found: Twist, v_m_s: f64, w_rad_s: f64) -> bool {
    (found.v_m_s - v_m_s).hypot(found.w_rad_s - w_rad_s) < 1e-12
}

#[test]
fn the_twist_goes_straight_towards_the_command_and_back_to_0_when_it_has_died() {
    let mut world = world(RampKind::Together, Vec::new());
    // 0.4 m/s takes 200 ms, 1 rad/s half of that: both arrive together.
    world.accept(0, &command(0, 0.4, 1.0)).unwrap();
    world.advance(10 * MS);
    assert!(close(world.states[0].twist, 0.02, 0.05), "{:?}", world.states[0].twist);
    // What odometry says is in force at its stamp, not over the arc before it.
    assert_eq!(world.odometry(0).twist(), world.states[0].twist);
    world.advance(20 * MS);
    assert!(close(world.states[0].twist, 0.04, 0.1), "{:?}", world.states[0].twist);
    // It dies at 20 ms: 0.04 m/s take as long to brake from.
    world.advance(30 * MS);
    assert!(close(world.states[0].twist, 0.02, 0.05), "{:?}", world.states[0].twist);
    world.advance(45 * MS);
    assert_eq!(world.states[0].twist, Twist::ZERO);
    // 0.04 m/s at 20 ms on the way up and down.
    let way = world.states[0].pose.x_m;
    assert!((way - 0.04 * 0.02).abs() < 1e-6, "{way}");
}

#[test]
fn independent_ramps_leave_the_segment() {
    let mut world = world(RampKind::Independent, Vec::new());
    world.accept(0, &command(0, 0.4, 1.0)).unwrap();
    world.advance(10 * MS);
    assert!(close(world.states[0].twist, 0.02, 0.1), "{:?}", world.states[0].twist);
}

#[test]
fn stuck_wheels_brake_and_go_on_where_they_are_freed() {
    use protocol::fault::{Span, WheelFault};
    let span = Span { from_ns: 10 * MS, until_ns: 15 * MS };
    let stuck = vec![WheelFault { span, kind: WheelFaultKind::Stuck }];
    let mut world = world(RampKind::Together, stuck);
    world.accept(0, &command(0, 0.4, 0.0)).unwrap();
    for (t_ms, v_m_s) in [(10, 0.02), (15, 0.01), (20, 0.02)] {
        world.advance(t_ms * MS);
        let twist = world.states[0].twist;
        assert!(close(twist, v_m_s, 0.0), "{t_ms} ms: {twist:?}");
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(500))]

    /// `proof/Inertia.v::approaches`: y(t + h) = (1 - sigma) y(t) + sigma target, and with the target 0
    /// it shrinks on its ray, its braking time as fast as time passes.
    #[test]
    fn the_twist_approaches_what_is_in_force_as_the_proof_wants_it(
        commands in proptest::collection::vec(
            (0..30u64, 0..25u64, -1.0..1.0f64, -8.0..8.0f64), 1..12,
        ),
    ) {
        let mut world = world(RampKind::Together, Vec::new());
        let accelerations = world.robots[0].body.limits.unwrap().accelerations();
        for (wait_ms, age_ms, v_m_s, w_rad_s) in commands {
            for _ in 0..wait_ms {
                let before = world.states[0].twist;
                let now_ns = world.t_ns();
                let alive = world.robots[0].obeyed.as_ref().filter(|o| now_ns < o.dies_ns);
                let target = alive.map_or(Twist::ZERO, |obeyed| obeyed.twist);
                world.advance(now_ns + MS);
                let after = world.states[0].twist;
                let change = Twist {
                    v_m_s: target.v_m_s - before.v_m_s,
                    w_rad_s: target.w_rad_s - before.w_rad_s,
                };
                let time = accelerations.time_s(change);
                let sigma = if time > 0.001 { 0.001 / time } else { 1.0 };
                let expected = (
                    before.v_m_s + sigma * change.v_m_s,
                    before.w_rad_s + sigma * change.w_rad_s,
                );
                prop_assert!(close(after, expected.0, expected.1));
                if target == Twist::ZERO {
                    let left = (accelerations.time_s(before) - 0.001).max(0.0);
                    prop_assert!(accelerations.time_s(after) <= left + 1e-12);
                    let cross = after.v_m_s * before.w_rad_s - after.w_rad_s * before.v_m_s;
                    prop_assert!(cross.abs() < 1e-12);
                }
                prop_assert!(front_speed(0.1, after) <= 1.0 + 1e-12);
            }
            let stamp_ns = world.t_ns().saturating_sub(age_ms * MS);
            let _ = world.accept(0, &command(stamp_ns, v_m_s, w_rad_s));
        }
    }

    #[test]
    fn without_limits_the_wheels_do_at_once_what_they_are_told(v in -0.5..0.5f64, w in -2.0..2.0f64) {
        let mut brief = brief(RampKind::Together, Vec::new());
        brief.robots[0].limits = None;
        let mut free = World::new(&brief);
        free.accept(0, &command(0, v, w)).unwrap();
        free.advance(MS);
        let twist = Twist { v_m_s: v, w_rad_s: w };
        prop_assert_eq!((free.states[0].pose, free.states[0].twist), (arc(START, twist, 0.001), twist));
    }
}
