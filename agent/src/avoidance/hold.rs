//! Exact hold: a constant (v, w) that moves the front point by a given displacement.

use formation::Vec2;
use formation::front_point::Heading;
use formation::portable_math;
use formation::pose::Twist;

/// Returns the twist that, held for `period_s` from `heading`, moves the front point by exactly
/// `displacement` (m, in `map`). The displacement must be shorter than 2 ell.
///
/// The front point of an arc that turns by 2 phi ends where b = R(-theta) p satisfies tan phi = b_y / (b_x + 2
/// ell).
pub fn exact_hold(heading: Heading, ell_m: f64, displacement: Vec2, period_s: f64) -> Twist {
    let b = heading.to_body(displacement);
    let q = b.y / (b.x + 2.0 * ell_m);
    let phi = portable_math::atan(q);
    let f = if q.abs() < 1e-9 { 1.0 } else { phi / q };
    Twist::new(f * (b.x + q * b.y) / period_s, 2.0 * phi / period_s)
}

#[cfg(test)]
mod tests {
    use super::*;
    use formation::front_point::{front_point, rotate};
    use formation::pose::Pose;
    use formation::unicycle::integrate_arc;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn exact_hold_moves_the_front_point_by_the_displacement(
            heading_rad in -3.1..3.1f64,
            ell in 0.02..0.5f64,
            fraction in 0.0..0.9f64,
            direction in -3.1..3.1f64,
            period in 1e-3..0.1f64,
        ) {
            let pose = Pose { x_m: 0.3, y_m: -0.7, heading_rad };
            let displacement = rotate(direction, Vec2::new(fraction * 2.0 * ell, 0.0));
            let twist = exact_hold(Heading::new(heading_rad), ell, displacement, period);
            let moved = front_point(integrate_arc(pose, twist, period), ell) - front_point(pose, ell);
            prop_assert!((moved - displacement).norm() < 1e-12, "{moved:?} {displacement:?}");
        }
    }
}
