//! The front point (off-axis point, alpha), `ell` ahead of the axle midpoint, and the map between its velocity
//! and (v, w). Controlling alpha instead of the axle midpoint xi keeps the decoupling matrix A(theta)
//! invertible.

use crate::Vec2;
use crate::portable_math;
use crate::pose::{Pose, Twist, wrap_angle};

/// Returns the front point alpha = xi + ell (cos theta, sin theta), m, in `map`. (2)
#[inline]
pub fn front_point(pose: Pose, ell_m: f64) -> Vec2 {
    front_point_and_velocity(Heading::new(pose.heading_rad), pose, ell_m, Twist::ZERO).0
}

/// Returns the velocity of the front point, A(theta) (v, w), m/s, in `map`. (3)
#[inline]
pub fn front_velocity(heading_rad: f64, ell_m: f64, twist: Twist) -> Vec2 {
    rotate(heading_rad, Vec2::new(twist.v_m_s, twist.side_m_s + ell_m * twist.w_rad_s))
}

/// Returns the front point, m, and its velocity, m/s, in `map`. `heading` is that of the pose. (2) (3)
#[inline]
pub fn front_point_and_velocity(
    heading: Heading,
    pose: Pose,
    ell_m: f64,
    twist: Twist,
) -> (Vec2, Vec2) {
    let Rotation { sin, cos } = heading.rotation;
    let alpha = Vec2::new(pose.x_m + ell_m * cos, pose.y_m + ell_m * sin);
    let (v, lateral) = (twist.v_m_s, twist.side_m_s + ell_m * twist.w_rad_s);
    (alpha, Vec2::new(cos * v - sin * lateral, sin * v + cos * lateral))
}

/// Returns the twist that gives the front point the velocity `u`: A(theta)^-1 u. (17)
pub fn twist_for_front_velocity(heading_rad: f64, ell_m: f64, u: Vec2) -> Twist {
    let body = rotate(-heading_rad, u);
    Twist::new(body.x, body.y / ell_m)
}

/// Returns the twist as [`twist_for_front_velocity`], with the unit vector `direction` of the heading.
#[inline]
pub fn twist_for_front_velocity_along(direction: Vec2, ell_m: f64, u: Vec2) -> Twist {
    Twist::new(direction.dot(&u), direction.perp(&u) / ell_m)
}

/// Returns the speed of the front point, m/s: |A(theta) (v, w)| = hypot(v, ell w), at any heading.
#[inline]
pub fn front_speed(ell_m: f64, twist: Twist) -> f64 {
    portable_math::hypot(twist.v_m_s, twist.side_m_s + ell_m * twist.w_rad_s)
}

/// Returns the heading, rad, after the front point has moved for `time_s` at the constant velocity `u`, m/s,
/// starting from `heading_rad`. The vehicle follows the front point like a towed cart.
///
/// theta' = (-sin theta u_x + cos theta u_y) / ell (17). The angle psi between heading and u decays as tan(psi
/// / 2) = tan(psi_0 / 2) exp(-|u| t / ell).
pub fn towed_heading(heading_rad: f64, ell_m: f64, u: Vec2, time_s: f64) -> f64 {
    let speed_m_s = u.norm();
    if speed_m_s == 0.0 {
        return heading_rad;
    }
    let direction_rad = portable_math::atan2(u.y, u.x);
    let half_rad = 0.5 * wrap_angle(heading_rad - direction_rad);
    let decay = portable_math::exp(-speed_m_s * time_s / ell_m);
    wrap_angle(
        direction_rad
            + 2.0
                * portable_math::atan2(
                    portable_math::sin(half_rad) * decay,
                    portable_math::cos(half_rad),
                ),
    )
}

/// Returns the unit vector of the heading after a motion as in [`towed_heading`], from the unit vector `direction`. It
/// is faster, and differs by rounding.
#[inline]
pub fn towed_direction(direction: Vec2, ell_m: f64, u: Vec2, time_s: f64) -> Vec2 {
    let speed_m_s = u.norm();
    if speed_m_s == 0.0 {
        return direction;
    }
    let along = u / speed_m_s;
    // tan(psi / 2) = sin psi / (1 + cos psi) = b / a
    let (a, b) = (1.0 + along.dot(&direction), along.perp(&direction));
    let b_later = b * portable_math::exp(-speed_m_s * time_s / ell_m);
    let sum = a * a + b_later * b_later;
    // Exactly opposite to u, the heading stays.
    if sum == 0.0 {
        return direction;
    }
    let (cos, sin) = ((a * a - b_later * b_later) / sum, 2.0 * a * b_later / sum);
    Rotation { sin, cos }.apply(along)
}

/// Returns the velocity that draws the heading of a leader's frame, m/s: `u`, the velocity of the leader's front
/// point. If the frame keeps its heading where the path reverses and `u` points behind `heading_rad`, returns `-u`: a
/// nominal leader that drives backwards.
pub fn towing_velocity(heading_rad: f64, u: Vec2, keeps_heading: bool) -> Vec2 {
    let (sin, cos) = portable_math::sin_cos(heading_rad);
    match keeps_heading && cos * u.x + sin * u.y < 0.0 {
        true => -u,
        false => u,
    }
}

/// Returns `vector` rotated counter-clockwise by `angle_rad`.
#[inline]
pub fn rotate(angle_rad: f64, vector: Vec2) -> Vec2 {
    Rotation::from_angle(angle_rad).apply(vector)
}

/// Heading with its sine and cosine, for several uses of one heading.
#[derive(Debug, Clone, Copy)]
pub struct Heading {
    angle_rad: f64,
    rotation: Rotation,
}

impl Heading {
    /// Heading along the x axis.
    pub const ZERO: Heading = Heading { angle_rad: 0.0, rotation: Rotation { sin: 0.0, cos: 1.0 } };

    /// Returns the heading of an angle, rad.
    #[inline]
    pub fn new(angle_rad: f64) -> Heading {
        Heading { angle_rad, rotation: Rotation::from_angle(angle_rad) }
    }

    /// Returns the angle, rad.
    #[inline]
    pub fn angle_rad(self) -> f64 {
        self.angle_rad
    }

    /// Returns the heading of another angle, rad. Computes nothing if it is the same angle.
    #[inline]
    pub fn with_angle(self, angle_rad: f64) -> Heading {
        match angle_rad.to_bits() == self.angle_rad.to_bits() {
            true => self,
            false => Heading::new(angle_rad),
        }
    }

    /// Returns a vector of `map` in the frame of the robot.
    #[inline]
    pub fn to_body(self, vector: Vec2) -> Vec2 {
        let Rotation { sin, cos } = self.rotation;
        Rotation { sin: -sin, cos }.apply(vector)
    }
}

/// Rotation by a fixed angle, for several vectors.
#[derive(Debug, Clone, Copy)]
pub struct Rotation {
    sin: f64,
    cos: f64,
}

impl Rotation {
    /// Returns the counter-clockwise rotation by `angle_rad`.
    #[inline]
    pub fn from_angle(angle_rad: f64) -> Rotation {
        let (sin, cos) = portable_math::sin_cos(angle_rad);
        Rotation { sin, cos }
    }

    /// Returns the unit vector of the angle.
    #[inline]
    pub fn unit_vector(self) -> Vec2 {
        Vec2::new(self.cos, self.sin)
    }

    /// Returns `vector`, rotated.
    #[inline]
    pub fn apply(self, vector: Vec2) -> Vec2 {
        let Rotation { sin, cos } = self;
        Vec2::new(cos * vector.x - sin * vector.y, sin * vector.x + cos * vector.y)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::unicycle::integrate_arc;
    use proptest::prelude::*;
    use std::f64::consts::PI;

    proptest! {
        #[test]
        fn twist_for_inverts_front_velocity(
            theta in -3.0..3.0f64, ell in 0.01..0.5f64, ux in -2.0..2.0f64, uy in -2.0..2.0f64,
        ) {
            let u = Vec2::new(ux, uy);
            let back = front_velocity(theta, ell, twist_for_front_velocity(theta, ell, u));
            prop_assert!((back - u).norm() < 1e-12);
        }

        #[test]
        fn front_velocity_is_derivative_of_front_point(
            theta in -3.0..3.0f64, v in -2.0..2.0f64, w in -5.0..5.0f64,
        ) {
            let (ell, h) = (0.1, 1e-6);
            let pose = Pose { x_m: 0.3, y_m: 0.4, heading_rad: theta };
            let twist = Twist::new(v, w);
            let slope = (front_point(integrate_arc(pose, twist, h), ell)
                - front_point(integrate_arc(pose, twist, -h), ell)) / (2.0 * h);
            prop_assert!((slope - front_velocity(theta, ell, twist)).norm() < 1e-6);
            prop_assert!((slope.norm() - front_speed(ell, twist)).abs() < 1e-6);
        }

        #[test]
        fn unit_vector_of_heading_gives_the_same_motion(
            theta in -PI..PI, ell in 0.01..0.5f64, ux in -2.0..2.0f64, uy in -2.0..2.0f64, time_s in 0.0..2.0f64,
        ) {
            let u = Vec2::new(ux, uy);
            let unit = |heading_rad| Rotation::from_angle(heading_rad).unit_vector();
            let later = towed_direction(unit(theta), ell, u, time_s);
            prop_assert!((later - unit(towed_heading(theta, ell, u, time_s))).norm() < 1e-7);
            let [twist, along] = [
                twist_for_front_velocity(theta, ell, u),
                twist_for_front_velocity_along(unit(theta), ell, u),
            ];
            prop_assert!((twist.v_m_s - along.v_m_s).abs() < 1e-12);
            prop_assert!((twist.w_rad_s - along.w_rad_s).abs() < 1e-12 / ell);
        }
    }

    #[test]
    fn drawn_heading_at_zero_velocity_is_unchanged() {
        for start in [-3.0, -0.1, 0.7, 3.1] {
            assert_eq!(towed_heading(start, 0.15, Vec2::zeros(), 0.7), start);
            let direction = Rotation::from_angle(start).unit_vector();
            assert_eq!(towed_direction(direction, 0.15, Vec2::zeros(), 0.7), direction);
        }
        // Exactly opposite to the velocity.
        let behind = Vec2::new(-1.0, 0.0);
        assert_eq!(towed_direction(behind, 0.15, -behind, 0.7), behind);
    }

    #[test]
    fn drawn_heading_solves_its_differential_equation() {
        let (ell, u) = (0.15, Vec2::new(0.3, -0.4));
        for start in [-3.0, -1.0, 0.2, 2.0] {
            // Explicit Euler with a step short enough for an error below 1e-5.
            let (mut euler, steps) = (start, 200_000);
            let step_s = 0.7 / f64::from(steps);
            for _ in 0..steps {
                euler += step_s * twist_for_front_velocity(euler, ell, u).w_rad_s;
            }
            let exact = towed_heading(start, ell, u, 0.7);
            assert!(wrap_angle(exact - euler).abs() < 1e-5, "from {start}: {exact}, {euler}");
        }
    }
}
