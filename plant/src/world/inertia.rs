//! Robots with acceleration limits: the rules that the guard with inertia assumes.

use formation::ramp::Ramp;
use proptest::prelude::*;
use protocol::brief::AccelerationLimitsBrief;
use protocol::fault::{Span, WheelFault};

use super::*;
use crate::testing::{self, NS_PER_MS, brief};

/// Creates a robot with a_v = 2 m/s^2 and a_w = 10 rad/s^2.
fn world(ramp: Ramp, wheel_faults: Vec<WheelFault>) -> World {
    let limits = AccelerationLimitsBrief {
        acceleration_m_s2: 2.0,
        turn_acceleration_rad_s2: 10.0,
        braking_time_s: 0.5,
        ramp,
    };
    let mut brief = brief(&[0.0]);
    brief.robots[0].limits = Some(limits);
    brief.robots[0].wheel_faults = wheel_faults;
    World::new(&brief)
}

fn command(stamp_ns: u64, v_m_s: f64, w_rad_s: f64) -> Command {
    testing::command(stamp_ns, stamp_ns + 1, v_m_s, w_rad_s)
}

fn is_close(found: Twist, v_m_s: f64, w_rad_s: f64) -> bool {
    (found.v_m_s - v_m_s).hypot(found.w_rad_s - w_rad_s) < 1e-12
}

#[test]
fn independent_ramps_leave_the_segment() {
    let mut world = world(Ramp::Independent, Vec::new());
    world.accept_command(0, &command(0, 0.4, 1.0)).unwrap();
    world.advance(10 * NS_PER_MS);
    assert!(is_close(world.states[0].twist, 0.02, 0.1), "{:?}", world.states[0].twist);
}

#[test]
fn stuck_wheels_brake_and_continue_once_freed() {
    let span = Span { from_ns: 10 * NS_PER_MS, until_ns: 15 * NS_PER_MS };
    let stuck = vec![WheelFault { span, kind: WheelFaultKind::Stuck }];
    let mut world = world(Ramp::Together, stuck);
    world.accept_command(0, &command(0, 0.4, 0.0)).unwrap();
    for (t_ms, v_m_s) in [(10, 0.02), (15, 0.01), (20, 0.02)] {
        world.advance(t_ms * NS_PER_MS);
        let twist = world.states[0].twist;
        assert!(is_close(twist, v_m_s, 0.0), "{t_ms} ms: {twist:?}");
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(500))]

    /// Checks `proof/Inertia.v::approaches`: y(t + h) = (1 - sigma) y(t) + sigma target. With the target 0, y
    /// shrinks on its ray, and its braking time decreases at the rate of time.
    #[test]
    fn twist_approaches_the_command_in_force_as_proven(
        commands in proptest::collection::vec(
            (0..30u64, 0..25u64, -1.0..1.0f64, -8.0..8.0f64), 1..12,
        ),
    ) {
        let mut world = world(Ramp::Together, Vec::new());
        let accelerations = world.robots[0].body.limits.unwrap().maximum_accelerations();
        for (wait_ms, age_ms, v_m_s, w_rad_s) in commands {
            for _ in 0..wait_ms {
                let before = world.states[0].twist;
                let now_ns = world.t_ns();
                let alive = world.robots[0].command_in_force.as_ref().filter(|o| now_ns < o.expires_ns);
                let target = alive.map_or(Twist::ZERO, |in_force| in_force.twist);
                world.advance(now_ns + NS_PER_MS);
                let after = world.states[0].twist;
                let change = Twist::new(target.v_m_s - before.v_m_s, target.w_rad_s - before.w_rad_s);
                let time = accelerations.change_time_s(change);
                let sigma = if time > 0.001 { 0.001 / time } else { 1.0 };
                let expected = (
                    before.v_m_s + sigma * change.v_m_s,
                    before.w_rad_s + sigma * change.w_rad_s,
                );
                prop_assert!(is_close(after, expected.0, expected.1));
                // Odometry reports the twist at its stamp, not that of the preceding arc.
                prop_assert_eq!(world.odometry(0).twist(), after);
                if target == Twist::ZERO {
                    let remaining_s = (accelerations.change_time_s(before) - 0.001).max(0.0);
                    prop_assert!(accelerations.change_time_s(after) <= remaining_s + 1e-12);
                    let cross = after.v_m_s * before.w_rad_s - after.w_rad_s * before.v_m_s;
                    prop_assert!(cross.abs() < 1e-12);
                }
                prop_assert!(front_speed(0.1, after) <= 1.0 + 1e-12);
            }
            let stamp_ns = world.t_ns().saturating_sub(age_ms * NS_PER_MS);
            let _ = world.accept_command(0, &command(stamp_ns, v_m_s, w_rad_s));
        }
    }
}
