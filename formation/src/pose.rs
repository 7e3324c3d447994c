//! Pose in the frame `map`, twist in the robot's own frame.

use serde::{Deserialize, Serialize};

/// Position (m) and heading (rad) of the axle's mid-point xi in the frame `map`.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Pose {
    /// Forward axis of `map`, m.
    pub x_m: f64,
    /// Left axis of `map`, m.
    pub y_m: f64,
    /// Counter-clockwise from x, in (-pi, pi].
    pub heading_rad: f64,
}

/// Longitudinal speed of the axle's mid-point (m/s) and turn rate (rad/s).
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Twist {
    /// Longitudinal speed v, m/s.
    pub v_m_s: f64,
    /// Turn rate w, rad/s, counter-clockwise.
    pub w_rad_s: f64,
}

impl Twist {
    /// Standing still.
    pub const ZERO: Twist = Twist { v_m_s: 0.0, w_rad_s: 0.0 };

    /// The same path, driven `factor` times as fast.
    pub fn scaled(self, factor: f64) -> Twist {
        Twist { v_m_s: factor * self.v_m_s, w_rad_s: factor * self.w_rad_s }
    }

    /// Whether both components are numbers.
    pub fn is_finite(self) -> bool {
        self.v_m_s.is_finite() && self.w_rad_s.is_finite()
    }
}

/// The same direction in (-pi, pi].
pub fn wrap_angle(angle_rad: f64) -> f64 {
    use std::f64::consts::{PI, TAU};
    if angle_rad > -PI && angle_rad <= PI {
        return angle_rad;
    }
    let wrapped = angle_rad.rem_euclid(TAU);
    if wrapped > PI { wrapped - TAU } else { wrapped }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;
    use std::f64::consts::PI;

    proptest! {
        #[test]
        fn an_angle_within_the_interval_stays_bit_by_bit_what_it_is(angle in -PI..PI) {
            prop_assert!(angle == -PI || wrap_angle(angle).to_bits() == angle.to_bits());
        }
    }

    #[test]
    fn a_wrapped_angle_points_the_same_way_and_lies_in_the_half_open_interval() {
        for k in -20..=20 {
            let angle = 0.77 * f64::from(k);
            let wrapped = wrap_angle(angle);
            assert!(wrapped > -PI && wrapped <= PI, "{angle} -> {wrapped}");
            assert!((wrapped.sin() - angle.sin()).abs() < 1e-12);
            assert!((wrapped.cos() - angle.cos()).abs() < 1e-12);
        }
        assert_eq!(wrap_angle(-PI), PI);
        assert_eq!(wrap_angle(PI), PI);
    }

    #[test]
    fn a_twist_is_scaled_as_a_whole_and_finite_only_with_both_parts() {
        let twist = Twist { v_m_s: 3.0, w_rad_s: -4.0 };
        assert_eq!(twist.scaled(0.5), Twist { v_m_s: 1.5, w_rad_s: -2.0 });
        assert!(twist.is_finite());
        assert!(!Twist { v_m_s: f64::NAN, ..twist }.is_finite());
        assert!(!Twist { w_rad_s: f64::INFINITY, ..twist }.is_finite());
    }
}
