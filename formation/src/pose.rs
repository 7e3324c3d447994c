//! Pose in the frame `map`, and twist in the frame of the robot.

use serde::{Deserialize, Serialize};

use crate::portable_math;

/// Position (m) and heading (rad) of the axle midpoint xi in the frame `map`.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Pose {
    /// Coordinate along the forward axis of `map`, m.
    pub x_m: f64,
    /// Coordinate along the left axis of `map`, m.
    pub y_m: f64,
    /// Heading, counter-clockwise from the x axis, in (-pi, pi], rad.
    pub heading_rad: f64,
}

/// Velocity of the axle midpoint in the frame of the robot (m/s), and turn rate (rad/s).
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Twist {
    /// Longitudinal speed v, m/s.
    pub v_m_s: f64,
    /// Lateral speed, m/s, to the left; 0 unless the robot is omnidirectional.
    pub side_m_s: f64,
    /// Turn rate w, rad/s, counter-clockwise.
    pub w_rad_s: f64,
}

impl Twist {
    /// Twist of a robot at rest.
    pub const ZERO: Twist = Twist::new(0.0, 0.0);

    /// Creates a twist without lateral speed.
    pub const fn new(v_m_s: f64, w_rad_s: f64) -> Twist {
        Twist { v_m_s, side_m_s: 0.0, w_rad_s }
    }

    /// Returns the twist multiplied by `factor`: the same path at a different speed.
    pub fn scale_by(self, factor: f64) -> Twist {
        Twist {
            v_m_s: factor * self.v_m_s,
            side_m_s: factor * self.side_m_s,
            w_rad_s: factor * self.w_rad_s,
        }
    }

    /// Returns the speed of the axle midpoint, m/s.
    #[inline]
    pub fn planar_speed_m_s(self) -> f64 {
        match self.side_m_s == 0.0 {
            true => self.v_m_s.abs(),
            false => portable_math::hypot(self.v_m_s, self.side_m_s),
        }
    }

    /// Returns the sum of both twists.
    pub fn plus(self, other: Twist) -> Twist {
        Twist {
            v_m_s: self.v_m_s + other.v_m_s,
            side_m_s: self.side_m_s + other.side_m_s,
            w_rad_s: self.w_rad_s + other.w_rad_s,
        }
    }

    /// Returns the change from `other` to this twist.
    pub fn minus(self, other: Twist) -> Twist {
        self.plus(other.scale_by(-1.0))
    }

    /// Returns `true` if all components are finite.
    pub fn is_finite(self) -> bool {
        self.v_m_s.is_finite() && self.side_m_s.is_finite() && self.w_rad_s.is_finite()
    }
}

/// Returns the equivalent angle in (-pi, pi].
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
        fn wrap_angle_inside_the_interval_is_bit_identical(angle in -PI..PI) {
            prop_assert!(angle == -PI || wrap_angle(angle).to_bits() == angle.to_bits());
        }
    }

    #[test]
    fn wrapped_angle_is_equivalent_and_in_half_open_interval() {
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
    fn twist_scales_all_parts_and_is_finite_only_with_all() {
        let twist = Twist { v_m_s: 3.0, side_m_s: 1.0, w_rad_s: -4.0 };
        assert_eq!(twist.scale_by(0.5), Twist { v_m_s: 1.5, side_m_s: 0.5, w_rad_s: -2.0 });
        assert!(twist.is_finite());
        assert!(!Twist { v_m_s: f64::NAN, ..twist }.is_finite());
        assert!(!Twist { side_m_s: f64::NAN, ..twist }.is_finite());
        assert!(!Twist { w_rad_s: f64::INFINITY, ..twist }.is_finite());
    }
}
