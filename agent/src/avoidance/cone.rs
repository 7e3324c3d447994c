//! Cones of directions: whatever the true direction to another robot and the true heading become
//! while a command acts, and the half-planes that bound an approach in all of them.

use std::f64::consts::PI;

use formation::Vec2;
use formation::real;

use super::polygon::{HalfPlane, TOLERANCE};

/// Taken off every distance, m: covers rounding, here and in the plant.
pub const ROUNDING_M: f64 = 1e-9;
/// Scales of the wanted command that the bound tries.
pub const SIGMAS: [f64; 3] = [1.0, 0.5, 0.25];
/// How often the range of turn rates is widened before the robot stands.
pub const PASSES_MAX: usize = 4;

/// Directions in which another may be, and how fast it may be approached there.
#[derive(Debug, Clone, Copy)]
pub struct Cone {
    /// n: from the other to this robot, as sensed.
    pub n: Vec2,
    /// By how much the true direction, as seen from the robot's own frame, may be off n, rad.
    pub psi: f64,
    /// b, m/s.
    pub b: f64,
}

impl Cone {
    /// Whether the velocity `u` approaches slower than b in all directions at once:
    /// `proof/Braking.v::one_test_for_the_cone`.
    #[inline]
    pub fn permits(&self, u: Vec2) -> bool {
        let speed = u.norm();
        if speed <= self.b {
            return true;
        }
        let cross = self.n.x * u.y - self.n.y * u.x;
        let angle = real::atan2(cross.abs(), self.n.dot(&u));
        speed * real::cos((angle + self.psi).min(PI)) >= -self.b - TOLERANCE
    }

    /// Half-planes of which each velocity approaches slower than b in every direction of the cone:
    /// `proof/Geometry.v::sides_bound_the_cone`.
    #[inline]
    pub fn sides(&self) -> impl Iterator<Item = HalfPlane> + use<> {
        let Cone { n, psi, b } = *self;
        let pairs = if psi < 1.2 { 1_i32 } else { 2 };
        let step = psi / f64::from(pairs);
        let bound = b * real::cos(0.5 * step);
        // By 0, 1, and 2 steps, the same to either side.
        let mut turns = [(0.0, 1.0); 3];
        for (q, turn) in (0..=pairs).zip(&mut turns).skip(1) {
            *turn = real::sin_cos(f64::from(q) * step);
        }
        (-pairs..=pairs).map(move |q| {
            let (sin, cos) = turns[q.unsigned_abs() as usize];
            let sin = f64::from(q.signum()) * sin;
            let normal = Vec2::new(cos * n.x - sin * n.y, sin * n.x + cos * n.y);
            HalfPlane { normal, bound }
        })
    }
}

/// n = z / r; any direction at r = 0.
#[inline]
pub fn direction(z: Vec2) -> Vec2 {
    let r = z.norm();
    if r > 0.0 { z / r } else { Vec2::new(1.0, 0.0) }
}

/// By how much the direction of z, r m long, may turn while z moves by at most `reach`, m, rad:
/// `proof/Guard.v::swing`, `proof/Geometry.v::direction_within_asin`.
#[inline]
pub fn swing(reach: f64, r: f64) -> f64 {
    if reach < r { real::asin(reach / r) } else { PI }
}

/// Middle and half-width of the headings that are possible within `time`, s, at turn rates from the
/// first to the second of `w`, rad/s, where the sensed heading is off by at most `error`, rad:
/// `proof/Guard.v::middle` and `proof/Guard.v::spread`.
#[inline]
pub fn headings(heading_rad: f64, time: f64, w: [f64; 2], error: f64) -> (f64, f64) {
    let half = 0.5 * time;
    (heading_rad + half * (w[0] + w[1]), half * (w[1] - w[0]) + error)
}
