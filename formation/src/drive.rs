//! Drive of a robot: the twists that it can execute, and the velocity that they give its controlled point.
//!
//! The controlled point lies `ell` ahead of the axle midpoint. With y = (v, s + ell w), its velocity in the frame of
//! the robot, where s is the lateral speed, a drive is the set of possible pairs (y, w):
//!
//! | drive | controlled point | y | turn rate |
//! |---|---|---|---|
//! | differential | front point, ell > 0 | (v, ell w), any direction | follows from y |
//! | differential | axle midpoint, ell = 0 | (v, 0) | independent of y, at most w_max |
//! | omnidirectional | center, ell = 0 | (v, s), any direction | independent of y, at most w_max |
//! | Ackermann (car) | rear axle midpoint, ell = 0 | (v, 0) | at most kappa \|v\|, with kappa = 1 / R_min |
//!
//! Where ell = 0, y and w change independently, each between its value and its target. Braking concerns y alone: a
//! robot that only turns keeps its position. A car turns only while it moves: whatever its steering angle does, its
//! turn rate is at most kappa |v| (`proof/Bodies.v::car_turns_at_most`). A drone at fixed height is an omnidirectional
//! robot with w_max = 0.

use serde::{Deserialize, Serialize};

use crate::Vec2;
use crate::front_point::front_speed;
use crate::pose::Twist;
use crate::ramp::AccelerationLimits;

/// Kind of a drive.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum DriveKind {
    /// Two driven wheels on one axle: no lateral speed.
    #[default]
    Differential,
    /// Any velocity in the plane, as with four mecanum wheels or as a drone at fixed height.
    Omni,
    /// Steered front wheels, as a car: no lateral speed of the rear axle, and a minimum turning radius.
    Ackermann,
}

impl DriveKind {
    /// Returns `true` for the differential drive.
    pub fn is_differential(&self) -> bool {
        *self == DriveKind::Differential
    }
}

/// Drive of one robot.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Drive {
    /// Kind of the drive.
    pub kind: DriveKind,
    /// Distance of the controlled point ahead of the axle midpoint (ell), m; 0 for the axle midpoint itself, or for the
    /// center of an omnidirectional robot.
    pub ell_m: f64,
    /// Maximum turn rate (w_max), rad/s; infinite without a limit.
    pub turn_rate_max_rad_s: f64,
    /// Maximum curvature of the path of a car (kappa), 1/m; infinite for other drives.
    pub curvature_max_per_m: f64,
}

impl Drive {
    /// Creates the drive of a robot with this controlled point, m, and turn rate limit, rad/s.
    #[inline]
    pub fn new(kind: DriveKind, ell_m: f64, turn_rate_max_rad_s: Option<f64>) -> Drive {
        Drive {
            kind,
            ell_m,
            turn_rate_max_rad_s: turn_rate_max_rad_s.unwrap_or(f64::INFINITY),
            curvature_max_per_m: f64::INFINITY,
        }
    }

    /// Returns the drive with a minimum turning radius, m; unchanged for `None`.
    #[inline]
    pub fn with_turning_radius(self, turning_radius_min_m: Option<f64>) -> Drive {
        let curvature_max_per_m =
            turning_radius_min_m.map_or(f64::INFINITY, |radius_m| 1.0 / radius_m);
        Drive { curvature_max_per_m, ..self }
    }

    /// Returns `true` for a car, whose turn rate is at most kappa |v|.
    pub fn is_car(self) -> bool {
        self.kind == DriveKind::Ackermann
    }

    /// Returns the twist of a car with this speed, m/s, and the curvature of `twist`, at most kappa; straight ahead if
    /// `twist` has no speed.
    pub fn along_curve(self, twist: Twist, v_m_s: f64) -> Twist {
        let curvature_max = self.curvature_max_per_m;
        let curvature = if twist.v_m_s == 0.0 { 0.0 } else { twist.w_rad_s / twist.v_m_s };
        Twist::new(v_m_s, curvature.clamp(-curvature_max, curvature_max) * v_m_s)
    }

    /// Returns `true` if the turn rate is independent of the velocity of the controlled point.
    pub fn turns_freely(self) -> bool {
        self.ell_m == 0.0
    }

    /// Returns `true` if the controlled point moves only along the heading, as the axle midpoint of a differential
    /// drive.
    pub fn moves_along_heading(self) -> bool {
        self.kind != DriveKind::Omni && self.turns_freely()
    }

    /// Returns y, the velocity of the controlled point in the frame of the robot, m/s.
    #[inline]
    pub fn velocity_of_twist(self, twist: Twist) -> Vec2 {
        Vec2::new(twist.v_m_s, twist.side_m_s + self.ell_m * twist.w_rad_s)
    }

    /// Returns the twist whose y is `velocity`, or its part along the heading if the drive permits no other. A turn
    /// rate that is independent of y is `w_rad_s`.
    pub fn twist_for_velocity(self, velocity: Vec2, w_rad_s: f64) -> Twist {
        match (self.kind, self.turns_freely()) {
            (DriveKind::Omni, _) => Twist { v_m_s: velocity.x, side_m_s: velocity.y, w_rad_s },
            (DriveKind::Differential, true) => Twist::new(velocity.x, w_rad_s),
            (DriveKind::Ackermann, _) => {
                self.along_curve(Twist::new(velocity.x, w_rad_s), velocity.x)
            }
            (DriveKind::Differential, false) => Twist::new(velocity.x, velocity.y / self.ell_m),
        }
    }

    /// Returns the largest turn rate of a robot whose controlled point moves at most at `speed_max_m_s`, rad/s.
    pub fn turn_rate_bound(self, speed_max_m_s: f64) -> f64 {
        match self.turns_freely() {
            true if self.is_car() => self.curvature_max_per_m * speed_max_m_s,
            true => self.turn_rate_max_rad_s,
            false => (speed_max_m_s / self.ell_m).min(self.turn_rate_max_rad_s),
        }
    }

    /// Returns `twist`, reduced until the controlled point moves at most at `speed_max_m_s` and the robot turns at most
    /// at w_max. A turn rate that is independent of the velocity is reduced by itself; otherwise both parts are scaled.
    #[inline]
    pub fn clamp(self, speed_max_m_s: f64, twist: Twist) -> Twist {
        let turn_max = self.turn_rate_max_rad_s;
        if self.moves_along_heading() {
            let v_m_s = twist.v_m_s.clamp(-speed_max_m_s, speed_max_m_s);
            if self.is_car() {
                return self.along_curve(twist, v_m_s);
            }
            return Twist::new(v_m_s, twist.w_rad_s.clamp(-turn_max, turn_max));
        }
        // No drive but the omnidirectional one has a lateral speed.
        let twist = match self.kind {
            DriveKind::Differential | DriveKind::Ackermann => Twist { side_m_s: 0.0, ..twist },
            DriveKind::Omni => twist,
        };
        let speed = front_speed(self.ell_m, twist);
        let slower =
            if speed > speed_max_m_s { twist.scale_by(speed_max_m_s / speed) } else { twist };
        if self.turns_freely() {
            return Twist { w_rad_s: twist.w_rad_s.clamp(-turn_max, turn_max), ..slower };
        }
        let turn = slower.w_rad_s.abs();
        if turn > turn_max { slower.scale_by(turn_max / turn) } else { slower }
    }

    /// Returns the braking time of a twist, s: the time after which the controlled point is at rest.
    #[inline]
    pub fn braking_time_s(self, accelerations: AccelerationLimits, twist: Twist) -> f64 {
        match self.turns_freely() {
            true => accelerations.change_time_s(Twist { w_rad_s: 0.0, ..twist }),
            false => accelerations.change_time_s(twist),
        }
    }

    /// Returns `twist`, reduced until its braking time is at most `time_s`. A turn rate that is independent of the
    /// velocity stays.
    pub fn clamp_braking_time(
        self,
        accelerations: AccelerationLimits,
        twist: Twist,
        time_s: f64,
    ) -> Twist {
        let time = self.braking_time_s(accelerations, twist);
        if time <= time_s {
            return twist;
        }
        let shorter = twist.scale_by(time_s / time);
        if self.turns_freely() && !self.is_car() {
            Twist { w_rad_s: twist.w_rad_s, ..shorter }
        } else {
            shorter
        }
    }

    /// Returns the twist nearest to `target` that is reached from `now` within `time_s`: on the segment between them,
    /// or with y and w changing independently.
    pub fn nearest_reachable_twist(
        self,
        accelerations: AccelerationLimits,
        now: Twist,
        target: Twist,
        time_s: f64,
    ) -> Twist {
        let change = target.minus(now);
        if self.turns_freely() {
            let AccelerationLimits { turn_rad_s2, .. } = accelerations;
            let planar = Twist { w_rad_s: 0.0, ..change };
            let time = accelerations.change_time_s(planar);
            let reached = match time <= time_s {
                true => target,
                false => now.plus(planar.scale_by(time_s / time)),
            };
            let turn = turn_rad_s2 * time_s;
            if self.is_car() {
                return self.along_curve(target, reached.v_m_s);
            }
            let w_rad_s = match change.w_rad_s.abs() <= turn {
                true => target.w_rad_s,
                false => now.w_rad_s + change.w_rad_s.signum() * turn,
            };
            return Twist { w_rad_s, ..reached };
        }
        let time = accelerations.change_time_s(change);
        if time <= time_s { target } else { now.plus(change.scale_by(time_s / time)) }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    const FRONT_POINT_DRIVE: Drive = Drive {
        kind: DriveKind::Differential,
        ell_m: 0.1,
        turn_rate_max_rad_s: 2.0,
        curvature_max_per_m: f64::INFINITY,
    };
    const CAR: Drive = Drive { kind: DriveKind::Ackermann, curvature_max_per_m: 5.0, ..AXLE_DRIVE };
    const AXLE_DRIVE: Drive = Drive { ell_m: 0.0, ..FRONT_POINT_DRIVE };
    const OMNI_DRIVE: Drive = Drive { kind: DriveKind::Omni, ..AXLE_DRIVE };
    const ACCELERATIONS: AccelerationLimits =
        AccelerationLimits { forward_m_s2: 0.5, turn_rad_s2: 4.0 };

    fn twist(v_m_s: f64, w_rad_s: f64) -> Twist {
        Twist::new(v_m_s, w_rad_s)
    }

    #[test]
    fn axle_limits_speed_and_turn_rate_separately() {
        assert_eq!(AXLE_DRIVE.clamp(0.3, twist(-0.6, 1.0)), twist(-0.3, 1.0));
        assert_eq!(AXLE_DRIVE.clamp(0.3, twist(0.1, -5.0)), twist(0.1, -2.0));
        assert_eq!(AXLE_DRIVE.turn_rate_bound(0.3), 2.0);
        assert_eq!(AXLE_DRIVE.braking_time_s(ACCELERATIONS, twist(-0.2, 9.0)), 0.4);
        assert_eq!(AXLE_DRIVE.braking_time_s(ACCELERATIONS, twist(0.0, 9.0)), 0.0);
        let shorter = AXLE_DRIVE.clamp_braking_time(ACCELERATIONS, twist(-0.2, 1.0), 0.2);
        assert_eq!(shorter, twist(-0.1, 1.0));
        let next = AXLE_DRIVE.nearest_reachable_twist(
            ACCELERATIONS,
            twist(0.1, 0.0),
            twist(0.2, 2.0),
            0.1,
        );
        assert!((next.v_m_s - 0.15).abs() < 1e-12 && (next.w_rad_s - 0.4).abs() < 1e-12);
        let next = AXLE_DRIVE.nearest_reachable_twist(
            ACCELERATIONS,
            twist(0.1, 0.0),
            twist(0.12, 2.0),
            0.1,
        );
        assert_eq!(next, twist(0.12, 0.4));
    }

    #[test]
    fn car_keeps_its_curvature_when_it_is_slowed_down() {
        assert_eq!(CAR.clamp(0.3, twist(0.6, 1.2)), twist(0.3, 0.6));
        assert_eq!(CAR.clamp(0.3, twist(-0.2, 9.0)), twist(-0.2, 1.0));
        assert_eq!(CAR.clamp(0.3, twist(0.0, 9.0)), twist(0.0, 0.0), "it does not turn in place");
        assert_eq!(CAR.turn_rate_bound(0.3), 1.5);
        assert!(CAR.moves_along_heading() && CAR.turns_freely());
        let shorter = CAR.clamp_braking_time(ACCELERATIONS, twist(-0.2, 1.0), 0.2);
        assert_eq!(shorter, twist(-0.1, 0.5));
        // From 0.1 m/s it reaches 0.15 m/s in 0.1 s, on the curve of the target.
        let next =
            CAR.nearest_reachable_twist(ACCELERATIONS, twist(0.1, 0.5), twist(0.2, -0.4), 0.1);
        assert!((next.v_m_s - 0.15).abs() < 1e-12 && (next.w_rad_s + 0.3).abs() < 1e-12);
    }

    #[test]
    fn omni_limits_planar_speed_and_turn_rate_separately() {
        let slanted = Twist { v_m_s: -0.6, side_m_s: 0.8, w_rad_s: -5.0 };
        let found = OMNI_DRIVE.clamp(0.5, slanted);
        assert!((found.v_m_s + 0.3).abs() < 1e-15 && (found.side_m_s - 0.4).abs() < 1e-15);
        assert_eq!(found.w_rad_s, -2.0);
        assert_eq!(
            AXLE_DRIVE.clamp(0.5, slanted),
            twist(-0.5, -2.0),
            "an axle has no lateral speed"
        );
        assert_eq!(
            FRONT_POINT_DRIVE.clamp(9.0, Twist { w_rad_s: 1.0, ..slanted }),
            twist(-0.6, 1.0)
        );
        assert_eq!(OMNI_DRIVE.braking_time_s(ACCELERATIONS, slanted), 2.0);
        let next = OMNI_DRIVE.nearest_reachable_twist(ACCELERATIONS, twist(0.0, 0.1), slanted, 0.1);
        assert!((next.v_m_s + 0.03).abs() < 1e-15 && (next.side_m_s - 0.04).abs() < 1e-15);
        assert!((next.w_rad_s + 0.3).abs() < 1e-15);
        let found = OMNI_DRIVE.twist_for_velocity(Vec2::new(0.1, -0.2), 0.7);
        assert_eq!(found, Twist { v_m_s: 0.1, side_m_s: -0.2, w_rad_s: 0.7 });
        assert_eq!(OMNI_DRIVE.velocity_of_twist(found), Vec2::new(0.1, -0.2));
    }

    proptest! {
        #[test]
        fn front_point_limits_scale_both_parts_of_a_twist(
            v in -2.0..2.0f64, w in -9.0..9.0f64, speed in 0.05..1.0f64, time in 0.05..1.0f64,
        ) {
            let requested = twist(v, w);
            for found in [
                FRONT_POINT_DRIVE.clamp(speed, requested),
                FRONT_POINT_DRIVE.clamp_braking_time(ACCELERATIONS, requested, time),
                FRONT_POINT_DRIVE.nearest_reachable_twist(ACCELERATIONS, Twist::ZERO, requested, time),
            ] {
                prop_assert!((found.v_m_s * w - found.w_rad_s * v).abs() < 1e-12, "{found:?}");
            }
            let found = FRONT_POINT_DRIVE.clamp(speed, requested);
            prop_assert!(front_speed(0.1, found) < speed + 1e-12);
            prop_assert!(found.w_rad_s.abs() < FRONT_POINT_DRIVE.turn_rate_bound(speed) + 1e-12);
        }
    }
}
