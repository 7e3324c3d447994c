//! The unicycle (1), integrated in closed form for a constant (v, w); with a lateral speed, also an omnidirectional
//! body.

use crate::portable_math;
use crate::pose::{Pose, Twist, wrap_angle};

/// Returns the pose after `twist` was held for `dt_s` seconds: an exact circular arc (a line for w = 0).
///
/// The chord of the arc has length v dt sinc(w dt / 2) and points along heading + w dt / 2.
pub fn integrate_arc(pose: Pose, twist: Twist, dt_s: f64) -> Pose {
    let half_turn = 0.5 * twist.w_rad_s * dt_s;
    let chord_ratio = sinc(half_turn);
    let [forward, side] = [twist.v_m_s, twist.side_m_s].map(|speed| speed * dt_s * chord_ratio);
    let (sin, cos) = portable_math::sin_cos(pose.heading_rad + half_turn);
    Pose {
        x_m: pose.x_m + (forward * cos - side * sin),
        y_m: pose.y_m + (forward * sin + side * cos),
        heading_rad: wrap_angle(pose.heading_rad + 2.0 * half_turn),
    }
}

/// Returns the twist of the arc from one pose to another in `dt_s` seconds, with the smaller of the two
/// possible turns. Used to reconstruct the wheel motion of a body that reports only its pose. A sideways
/// displacement is not represented in the twist.
pub fn twist_between(from: Pose, to: Pose, dt_s: f64) -> Twist {
    let half_turn = 0.5 * wrap_angle(to.heading_rad - from.heading_rad);
    let (sin, cos) = portable_math::sin_cos(from.heading_rad + half_turn);
    let (x, y) = (to.x_m - from.x_m, to.y_m - from.y_m);
    let displacement = [x * cos + y * sin, y * cos - x * sin];
    let [v_m_s, side_m_s] = displacement.map(|chord| chord / sinc(half_turn) / dt_s);
    Twist { v_m_s, side_m_s, w_rad_s: 2.0 * half_turn / dt_s }
}

/// Returns sin(a) / a, continued to 1 at a = 0.
pub fn sinc(a: f64) -> f64 {
    if a.abs() < 1e-4 { 1.0 - a * a / 6.0 } else { portable_math::sin(a) / a }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn pose_distance(a: Pose, b: Pose) -> f64 {
        (a.x_m - b.x_m).hypot(a.y_m - b.y_m)
    }

    proptest! {
        #[test]
        fn two_half_arcs_equal_one_arc(
            heading in -3.0..3.0f64, v in -2.0..2.0f64, side in -2.0..2.0f64, w in -20.0..20.0f64,
            dt in 1e-6..0.5f64,
        ) {
            let start = Pose { x_m: 0.2, y_m: 0.1, heading_rad: heading };
            let twist = Twist { v_m_s: v, side_m_s: side, w_rad_s: w };
            let single_arc = integrate_arc(start, twist, dt);
            let two_arcs = integrate_arc(integrate_arc(start, twist, dt / 2.0), twist, dt / 2.0);
            prop_assert!(pose_distance(single_arc, two_arcs) < 1e-12);
            prop_assert_eq!(single_arc.heading_rad, wrap_angle(single_arc.heading_rad));
        }

        #[test]
        fn arc_agrees_with_small_euler_steps(
            v in -1.0..1.0f64, side in -1.0..1.0f64, w in -3.0..3.0f64,
        ) {
            let start = Pose { x_m: 0.0, y_m: 0.0, heading_rad: 0.4 };
            let twist = Twist { v_m_s: v, side_m_s: side, w_rad_s: w };
            let (steps, dt) = (100_000, 0.5);
            let h = dt / f64::from(steps);
            let (mut x, mut y, mut th) = (start.x_m, start.y_m, start.heading_rad);
            for _ in 0..steps {
                x += h * (v * th.cos() - side * th.sin());
                y += h * (v * th.sin() + side * th.cos());
                th += h * w;
            }
            let end = integrate_arc(start, twist, dt);
            prop_assert!((end.x_m - x).hypot(end.y_m - y) < 2e-4);
        }
    }

    #[test]
    fn sinc_is_exact_on_both_sides_of_its_series_limit() {
        // Accurate up to the next term of the series, a^4 / 120.
        for a in [0.0f64, 1e-9, 3e-5, 9.9e-5, 1.01e-4, 3e-4, 1e-3] {
            let expected = 1.0 - a * a / 6.0 + a.powi(4) / 120.0;
            assert!((sinc(a) - expected).abs() < 3e-16, "{a}: {}", sinc(a));
        }
    }

    proptest! {
        #[test]
        fn twist_between_arc_endpoints_is_the_twist_of_the_arc(
            v_m_s in -2.0..2.0f64,
            side_m_s in -2.0..2.0f64,
            w_rad_s in prop_oneof![Just(0.0), -1e-3..1e-3f64, -50.0..50.0f64],
            heading_rad in -3.1..3.1f64,
            dt_s in 1e-3..0.05f64,
        ) {
            let from = Pose { x_m: 0.3, y_m: -0.7, heading_rad };
            let to = integrate_arc(from, Twist { v_m_s, side_m_s, w_rad_s }, dt_s);
            let found = twist_between(from, to, dt_s);
            prop_assert!((found.v_m_s - v_m_s).abs() < 1e-9, "{found:?}");
            prop_assert!((found.side_m_s - side_m_s).abs() < 1e-9, "{found:?}");
            prop_assert!((found.w_rad_s - w_rad_s).abs() < 1e-9, "{found:?}");
        }
    }
}
