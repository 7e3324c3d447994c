//! Motion with a twist that changes at bounded rates (wheels with inertia).
//!
//! Both components of a twist change at constant rates and reach their targets simultaneously, or each changes
//! at its maximum rate. While both rates are constant, the heading has a closed form. The position is an
//! integral without a closed form (a clothoid) and is computed by Gauss-Legendre quadrature over pieces of
//! small turns. Its error is below [`POSITION_ERROR_RATIO_MAX`] of the distance driven.

use serde::{Deserialize, Serialize};

use crate::portable_math;
use crate::pose::{Pose, Twist, wrap_angle};
use crate::unicycle::integrate_arc;

/// Upper bound on the position error, as a fraction of the distance driven. A test compares it with a reference
/// integration.
pub const POSITION_ERROR_RATIO_MAX: f64 = 1e-12;

/// Maximum turn of the heading within one quadrature piece, rad.
const PIECE_TURN_RAD_MAX: f64 = 0.1;

/// Abscissas on [0, 1] and weights of the five-point Gauss-Legendre rule.
const GAUSS_LEGENDRE_NODES: [(f64, f64); 5] = [
    (0.046_910_077_030_668_004, 0.118_463_442_528_094_54),
    (0.230_765_344_947_158_45, 0.239_314_335_249_683_23),
    (0.5, 0.284_444_444_444_444_44),
    (0.769_234_655_052_841_5, 0.239_314_335_249_683_23),
    (0.953_089_922_969_332, 0.118_463_442_528_094_54),
];

/// Maximum rates of change of a robot's twist.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct AccelerationLimits {
    /// Maximum longitudinal acceleration (a_v), m/s^2.
    pub forward_m_s2: f64,
    /// Maximum turn acceleration (a_w), rad/s^2.
    pub turn_rad_s2: f64,
}

/// Coupling of the two components of a twist while it changes.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Ramp {
    /// Both components change at constant rates and arrive simultaneously, so the twist follows a straight
    /// segment.
    #[default]
    Together,
    /// Each component changes at its maximum rate. For a front point, the guard (safety filter) then certifies all twists
    /// between the components of its commands.
    Independent,
}

impl Ramp {
    /// Returns `true` if both components arrive simultaneously.
    pub fn is_coupled(&self) -> bool {
        *self == Ramp::Together
    }
}

impl AccelerationLimits {
    /// Returns the minimum time for a change of the twist (||change||), s.
    pub fn change_time_s(self, change: Twist) -> f64 {
        self.component_times_s(change).into_iter().fold(0.0, f64::max)
    }

    fn component_times_s(self, change: Twist) -> [f64; 2] {
        [change.planar_speed_m_s() / self.forward_m_s2, change.w_rad_s.abs() / self.turn_rad_s2]
    }

    /// Returns pose and twist after `dt_s`, while the twist moves from `twist` to `target` and is then held
    /// there.
    pub fn pose_and_twist_after(
        self,
        mut pose: Pose,
        mut twist: Twist,
        target: Twist,
        ramp: Ramp,
        mut dt_s: f64,
    ) -> (Pose, Twist) {
        // At most two ramps: with independent ramps, the first one ends when the first component arrives.
        for _ in 0..2 {
            let change = target.minus(twist);
            let times_s = self.component_times_s(change);
            let total_s = times_s.into_iter().fold(0.0, f64::max);
            if total_s == 0.0 || dt_s <= 0.0 {
                break;
            }
            let fractions = |ramp_s: f64| match ramp {
                Ramp::Together => [ramp_s / total_s; 2],
                Ramp::Independent => {
                    times_s.map(|s| if s > 0.0 { (ramp_s / s).min(1.0) } else { 1.0 })
                }
            };
            let first_s = match ramp {
                Ramp::Independent => {
                    times_s.into_iter().filter(|s| *s > 0.0).fold(total_s, f64::min)
                }
                Ramp::Together => total_s,
            };
            let ramp_s = first_s.min(dt_s);
            let [v, w] = fractions(ramp_s);
            // Exactly the target value at the end of the ramp, regardless of rounding.
            let part = |from: f64, to: f64, fraction: f64| {
                if fraction >= 1.0 { to } else { from + fraction * (to - from) }
            };
            let next = Twist {
                v_m_s: part(twist.v_m_s, target.v_m_s, v),
                side_m_s: part(twist.side_m_s, target.side_m_s, v),
                w_rad_s: part(twist.w_rad_s, target.w_rad_s, w),
            };
            pose = integrate_twist_change(pose, twist, next, ramp_s);
            twist = next;
            dt_s -= ramp_s;
        }
        if dt_s > 0.0 {
            pose = integrate_arc(pose, twist, dt_s);
        }
        (pose, twist)
    }

    /// Returns pose and twist of a car after `dt_s`: its speed moves from that of `twist` to that of `target`, on the
    /// curve of the target from the beginning. With the target 0 it brakes on its own curve.
    pub fn car_pose_and_twist_after(
        self,
        pose: Pose,
        twist: Twist,
        target: Twist,
        dt_s: f64,
    ) -> (Pose, Twist) {
        let curve = if target.v_m_s == 0.0 { twist } else { target };
        let curvature = if curve.v_m_s == 0.0 { 0.0 } else { curve.w_rad_s / curve.v_m_s };
        let on_curve = |v_m_s: f64| Twist::new(v_m_s, curvature * v_m_s);
        let change = target.v_m_s - twist.v_m_s;
        let total_s = change.abs() / self.forward_m_s2;
        let ramp_s = total_s.min(dt_s);
        let end = match total_s <= dt_s {
            true => target,
            false => on_curve(twist.v_m_s + change * (dt_s / total_s)),
        };
        let pose = integrate_twist_change(pose, on_curve(twist.v_m_s), end, ramp_s);
        (if dt_s > ramp_s { integrate_arc(pose, end, dt_s - ramp_s) } else { pose }, end)
    }
}

/// Returns the pose after `dt_s`, during which the twist changes from `from` to `to` at constant rates.
pub fn integrate_twist_change(mut pose: Pose, from: Twist, to: Twist, dt_s: f64) -> Pose {
    if from == to {
        return integrate_arc(pose, from, dt_s);
    }
    let turn = from.w_rad_s.abs().max(to.w_rad_s.abs()) * dt_s;
    let pieces = (turn / PIECE_TURN_RAD_MAX).ceil().max(1.0);
    let change = to.minus(from);
    let piece_s = dt_s / pieces;
    let at = |k: f64| Twist {
        v_m_s: from.v_m_s + change.v_m_s * (k / pieces),
        side_m_s: from.side_m_s + change.side_m_s * (k / pieces),
        w_rad_s: from.w_rad_s + change.w_rad_s * (k / pieces),
    };
    let mut k = 0.0;
    while k < pieces {
        pose = integrate_piece(pose, at(k), at(k + 1.0), piece_s);
        k += 1.0;
    }
    pose
}

fn integrate_piece(pose: Pose, from: Twist, to: Twist, dt_s: f64) -> Pose {
    let change = to.minus(from);
    let turn_after = |s: f64| dt_s * s * (from.w_rad_s + 0.5 * s * change.w_rad_s);
    let (mut x, mut y) = (0.0, 0.0);
    for (s, weight) in GAUSS_LEGENDRE_NODES {
        let (sin, cos) = portable_math::sin_cos(pose.heading_rad + turn_after(s));
        let forward = weight * (from.v_m_s + s * change.v_m_s);
        let side = weight * (from.side_m_s + s * change.side_m_s);
        x += forward * cos - side * sin;
        y += forward * sin + side * cos;
    }
    Pose {
        x_m: pose.x_m + dt_s * x,
        y_m: pose.y_m + dt_s * y,
        heading_rad: wrap_angle(pose.heading_rad + turn_after(1.0)),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    const START: Pose = Pose { x_m: 0.0, y_m: 0.0, heading_rad: 0.4 };

    fn twist() -> impl Strategy<Value = Twist> {
        let side = prop_oneof![Just(0.0), -2.0..2.0f64];
        (-2.0..2.0f64, side, -8.0..8.0f64).prop_map(|(v_m_s, side_m_s, w_rad_s)| Twist {
            v_m_s,
            side_m_s,
            w_rad_s,
        })
    }

    fn pose_difference(a: Pose, b: Pose) -> f64 {
        (a.x_m - b.x_m).hypot(a.y_m - b.y_m)
    }

    /// Integrates by Simpson's rule with enough pieces that only rounding errors remain.
    fn reference_pose(from: Twist, to: Twist, dt_s: f64) -> Pose {
        let change = to.minus(from);
        let at = |s: f64| {
            let turn = dt_s * s * (from.w_rad_s + 0.5 * s * change.w_rad_s);
            let (sin, cos) = (START.heading_rad + turn).sin_cos();
            let v = from.v_m_s + s * change.v_m_s;
            let side = from.side_m_s + s * change.side_m_s;
            [v * cos - side * sin, v * sin + side * cos]
        };
        let pieces = 2000;
        let h = 1.0 / f64::from(pieces);
        let mut sum = [0.0; 2];
        for k in 0..pieces {
            let a = f64::from(k) * h;
            for (part, weight) in [(at(a), 1.0), (at(a + 0.5 * h), 4.0), (at(a + h), 1.0)] {
                sum[0] += weight * part[0] * h / 6.0;
                sum[1] += weight * part[1] * h / 6.0;
            }
        }
        let turn = dt_s * (from.w_rad_s + 0.5 * change.w_rad_s);
        Pose {
            x_m: dt_s * sum[0],
            y_m: dt_s * sum[1],
            heading_rad: wrap_angle(START.heading_rad + turn),
        }
    }

    #[test]
    fn car_stays_on_the_curve_of_its_target_while_its_speed_changes() {
        let limits = AccelerationLimits { forward_m_s2: 0.5, turn_rad_s2: 1.0 };
        let (now, target) = (Twist::new(-0.1, 0.2), Twist::new(0.2, 0.6));
        let (pose, twist) = limits.car_pose_and_twist_after(START, now, target, 0.4);
        assert!((twist.v_m_s - 0.1).abs() < 1e-12 && (twist.w_rad_s - 0.3).abs() < 1e-12);
        // Backwards and forwards over the same arc.
        assert!(pose_difference(pose, START) < 1e-12 && (pose.heading_rad - 0.4).abs() < 1e-12);
        assert_eq!(limits.car_pose_and_twist_after(START, now, target, 0.7).1, target);
        let (_, slower) = limits.car_pose_and_twist_after(START, target, Twist::ZERO, 0.2);
        assert!((slower.v_m_s - 0.1).abs() < 1e-12 && (slower.w_rad_s - 0.3).abs() < 1e-12);
        assert_eq!(limits.car_pose_and_twist_after(START, target, Twist::ZERO, 0.5).1, Twist::ZERO);
    }

    proptest! {
        #[test]
        fn glide_position_error_is_below_its_bound(
            from in twist(), to in twist(), dt in 1e-4..0.5f64,
        ) {
            let (found, expected) = (integrate_twist_change(START, from, to, dt), reference_pose(from, to, dt));
            let distance = dt * from.planar_speed_m_s().max(to.planar_speed_m_s());
            // The reference has a rounding error of its own.
            prop_assert!(pose_difference(found, expected) <= POSITION_ERROR_RATIO_MAX * distance + 1e-14);
            prop_assert!(wrap_angle(found.heading_rad - expected.heading_rad).abs() < 1e-12);
        }

        #[test]
        fn drive_in_two_parts_equals_drive_at_once(
            from in twist(), target in twist(), a in 0.5..3.0f64, aw in 1.0..10.0f64,
            together in any::<bool>(), dt in 1e-3..2.0f64, first_part in 0.0..1.0f64,
        ) {
            let accelerations = AccelerationLimits { forward_m_s2: a, turn_rad_s2: aw };
            let ramp = if together { Ramp::Together } else { Ramp::Independent };
            let drive = |pose, twist, dt| accelerations.pose_and_twist_after(pose, twist, target, ramp, dt);
            let (pose, twist) = drive(START, from, dt);
            let (intermediate_pose, intermediate) = drive(START, from, first_part * dt);
            let (two_step_pose, two_step_twist) = drive(intermediate_pose, intermediate, dt - first_part * dt);
            prop_assert!(pose_difference(pose, two_step_pose) < 1e-11);
            prop_assert!(accelerations.change_time_s(twist.minus(two_step_twist)) < 1e-12);
        }

        /// Properties P2 and P3: the twist is on the segment towards the target, and at the target once the
        /// ramp time has passed.
        #[test]
        fn together_ramp_follows_a_straight_segment(
            from in twist(), target in twist(), a in 0.5..3.0f64, aw in 1.0..10.0f64, part in 0.0..1.5f64,
        ) {
            let accelerations = AccelerationLimits { forward_m_s2: a, turn_rad_s2: aw };
            let total = accelerations.change_time_s(target.minus(from));
            let (_, twist) =
                accelerations.pose_and_twist_after(START, from, target, Ramp::Together, part * total);
            let fraction = part.min(1.0);
            let remaining = twist.minus(from.scale_by(1.0 - fraction));
            prop_assert!(accelerations.change_time_s(remaining.minus(target.scale_by(fraction))) < 1e-12);
            prop_assert!(part < 1.0 || twist == target);
        }
    }

    #[test]
    fn independent_ramp_components_arrive_separately() {
        let accelerations = AccelerationLimits { forward_m_s2: 2.0, turn_rad_s2: 2.0 };
        let target = Twist::new(1.0, -2.0);
        let at = |dt| {
            accelerations.pose_and_twist_after(START, Twist::ZERO, target, Ramp::Independent, dt).1
        };
        assert_eq!(at(0.25), Twist::new(0.5, -0.5));
        assert_eq!(at(0.75), Twist::new(1.0, -1.5));
        assert_eq!(at(1.0), target);
        let together =
            accelerations.pose_and_twist_after(START, Twist::ZERO, target, Ramp::Together, 0.5).1;
        assert_eq!(together, Twist::new(0.5, -1.0));
    }

    #[test]
    fn drive_at_target_twist_is_an_arc() {
        let accelerations = AccelerationLimits { forward_m_s2: 1.0, turn_rad_s2: 2.0 };
        let twist = Twist::new(0.3, 1.1);
        let (pose, after) =
            accelerations.pose_and_twist_after(START, twist, twist, Ramp::Together, 0.2);
        assert_eq!((pose, after), (integrate_arc(START, twist, 0.2), twist));
    }
}
