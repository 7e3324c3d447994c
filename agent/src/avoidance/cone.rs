//! Cones of directions: a bound on the direction to another robot and on the own heading while a command is in
//! effect, and the half-planes that bound the approach speed in all of these directions.

use std::f64::consts::PI;

use formation::Vec2;
use formation::portable_math;

use super::polygon::{HalfPlane, VIOLATION_TOLERANCE_M_S};

/// Margin subtracted from every distance, m. It covers rounding errors here and in the plant.
pub const ROUNDING_MARGIN_M: f64 = 1e-9;
/// Scales of the requested command that the bound tries, in this order.
pub const REQUESTED_TWIST_SCALES: [f64; 3] = [1.0, 0.5, 0.25];
/// Maximum number of times the range of turn rates is widened. After that the robot is not certified and stops.
pub const WIDENING_PASSES_MAX: usize = 4;

/// Cone of directions from another robot, with the maximum approach speed in it.
#[derive(Debug, Clone, Copy)]
pub struct Cone {
    /// Sensed unit vector from the other robot to this robot (n).
    pub axis: Vec2,
    /// Half-angle of the cone: maximum deviation of the true direction from n in the robot's own frame, rad.
    pub half_angle_rad: f64,
    /// Maximum approach speed (b), m/s.
    pub approach_speed_max: f64,
}

impl Cone {
    /// Returns `true` if the velocity `u` approaches by at most b in every direction of the cone:
    /// `proof/Braking.v::one_test_for_the_cone`.
    #[inline]
    pub fn permits(&self, u: Vec2) -> bool {
        let speed = u.norm();
        if speed <= self.approach_speed_max {
            return true;
        }
        let cross = self.axis.x * u.y - self.axis.y * u.x;
        let angle = portable_math::atan2(cross.abs(), self.axis.dot(&u));
        speed * portable_math::cos((angle + self.half_angle_rad).min(PI))
            >= -self.approach_speed_max - VIOLATION_TOLERANCE_M_S
    }

    /// Returns half-planes whose intersection contains only velocities that approach by at most b in every
    /// direction of the cone: `proof/Geometry.v::sides_bound_the_cone`.
    #[inline]
    pub fn half_planes(&self) -> impl Iterator<Item = HalfPlane> + use<> {
        let Cone { axis: n, half_angle_rad: psi, approach_speed_max: b } = *self;
        let pairs = if psi < 1.2 { 1_i32 } else { 2 };
        let step = psi / f64::from(pairs);
        let bound = b * portable_math::cos(0.5 * step);
        // Sine and cosine of 0, 1 and 2 steps, used on both sides.
        let mut sin_cos = [(0.0, 1.0); 3];
        for (q, entry) in (0..=pairs).zip(&mut sin_cos).skip(1) {
            *entry = portable_math::sin_cos(f64::from(q) * step);
        }
        (-pairs..=pairs).map(move |q| {
            let (sin, cos) = sin_cos[q.unsigned_abs() as usize];
            let sin = f64::from(q.signum()) * sin;
            let normal = Vec2::new(cos * n.x - sin * n.y, sin * n.x + cos * n.y);
            HalfPlane { normal, boundary_distance: bound }
        })
    }
}

/// Returns the unit vector n = z / r, or the x axis if r = 0.
#[inline]
pub fn direction(z: Vec2) -> Vec2 {
    let r = z.norm();
    if r > 0.0 { z / r } else { Vec2::new(1.0, 0.0) }
}

/// Returns the maximum angle, rad, by which the direction of z, with length `r`, m, can turn while z moves by
/// at most `reach`, m: `proof/Guard.v::swing`, `proof/Geometry.v::direction_within_asin`.
#[inline]
pub fn direction_change_max_rad(reach: f64, r: f64) -> f64 {
    if reach < r { portable_math::asin(reach / r) } else { PI }
}

/// Returns center and half-width of the range of headings, rad, that are reachable within `time`, s, at turn
/// rates between `w[0]` and `w[1]`, rad/s, if the sensed heading has an error of at most `error`, rad:
/// `proof/Guard.v::middle` and `proof/Guard.v::spread`.
#[inline]
pub fn heading_range(heading_rad: f64, time: f64, w: [f64; 2], error: f64) -> (f64, f64) {
    let half = 0.5 * time;
    (heading_rad + half * (w[0] + w[1]), half * (w[1] - w[0]) + error)
}
