//! Drive of a robot: the twists that it can execute, and the velocity that they give its controlled point.
//!
//! The controlled point lies `ell` ahead of the axle midpoint. With y = (v, ell w), its velocity in the frame of the
//! robot, a drive is the set of possible pairs (y, w):
//!
//! | controlled point | y | turn rate |
//! |---|---|---|
//! | front point, ell > 0 | (v, ell w), any direction | follows from y |
//! | axle midpoint, ell = 0 | (v, 0) | independent of y, at most w_max |
//!
//! At the axle midpoint v and w change independently, each between its value and its target. Braking concerns v
//! alone: a robot that only turns keeps its place.

use crate::front_point::front_speed;
use crate::pose::Twist;
use crate::ramp::Accelerations;

/// Drive of one robot.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Drive {
    /// Distance of the controlled point ahead of the axle midpoint (ell), m; 0 for the axle midpoint itself.
    pub ell_m: f64,
    /// Maximum turn rate (w_max), rad/s; infinite without a limit.
    pub turn_rate_max_rad_s: f64,
}

impl Drive {
    /// Creates the drive of a robot with this front point, m, and turn rate limit, rad/s.
    pub fn new(ell_m: f64, turn_rate_max_rad_s: Option<f64>) -> Drive {
        Drive { ell_m, turn_rate_max_rad_s: turn_rate_max_rad_s.unwrap_or(f64::INFINITY) }
    }

    /// Returns `true` if the turn rate is independent of the velocity of the controlled point, as at the axle midpoint.
    pub fn turns_freely(self) -> bool {
        self.ell_m == 0.0
    }

    /// Returns the largest turn rate of a robot whose controlled point moves at most at `speed_max_m_s`, rad/s.
    pub fn turn_rate_bound(self, speed_max_m_s: f64) -> f64 {
        match self.turns_freely() {
            true => self.turn_rate_max_rad_s,
            false => (speed_max_m_s / self.ell_m).min(self.turn_rate_max_rad_s),
        }
    }

    /// Returns `twist`, reduced until the controlled point moves at most at `speed_max_m_s` and the robot turns at most
    /// at w_max. A turn rate that is independent of the velocity is reduced by itself; otherwise both parts are scaled.
    #[inline]
    pub fn clamp(self, speed_max_m_s: f64, twist: Twist) -> Twist {
        let turn_max = self.turn_rate_max_rad_s;
        if self.turns_freely() {
            return Twist {
                v_m_s: twist.v_m_s.clamp(-speed_max_m_s, speed_max_m_s),
                w_rad_s: twist.w_rad_s.clamp(-turn_max, turn_max),
            };
        }
        let speed = front_speed(self.ell_m, twist);
        let twist = if speed > speed_max_m_s { twist.scaled(speed_max_m_s / speed) } else { twist };
        let turn = twist.w_rad_s.abs();
        if turn > turn_max { twist.scaled(turn_max / turn) } else { twist }
    }

    /// Returns the braking time of a twist, s: the time after which the controlled point is at rest.
    #[inline]
    pub fn braking_time_s(self, accelerations: Accelerations, twist: Twist) -> f64 {
        match self.turns_freely() {
            true => twist.v_m_s.abs() / accelerations.forward_m_s2,
            false => accelerations.time_s(twist),
        }
    }

    /// Returns `twist`, reduced until its braking time is at most `time_s`. A turn rate that is independent of the
    /// velocity stays.
    pub fn clamp_braking_time(
        self,
        accelerations: Accelerations,
        twist: Twist,
        time_s: f64,
    ) -> Twist {
        let time = self.braking_time_s(accelerations, twist);
        if time <= time_s {
            return twist;
        }
        let shorter = twist.scaled(time_s / time);
        if self.turns_freely() { Twist { w_rad_s: twist.w_rad_s, ..shorter } } else { shorter }
    }

    /// Returns the twist nearest to `target` that is reached from `now` within `time_s`: on the segment between them,
    /// or with both parts changing independently.
    pub fn reachable(
        self,
        accelerations: Accelerations,
        now: Twist,
        target: Twist,
        time_s: f64,
    ) -> Twist {
        let change =
            Twist { v_m_s: target.v_m_s - now.v_m_s, w_rad_s: target.w_rad_s - now.w_rad_s };
        if self.turns_freely() {
            let part = |from: f64, to: f64, change: f64, most: f64| {
                if change.abs() <= most { to } else { from + change.signum() * most }
            };
            let Accelerations { forward_m_s2, turn_rad_s2 } = accelerations;
            return Twist {
                v_m_s: part(now.v_m_s, target.v_m_s, change.v_m_s, forward_m_s2 * time_s),
                w_rad_s: part(now.w_rad_s, target.w_rad_s, change.w_rad_s, turn_rad_s2 * time_s),
            };
        }
        let time = accelerations.time_s(change);
        if time <= time_s {
            return target;
        }
        let part = change.scaled(time_s / time);
        Twist { v_m_s: now.v_m_s + part.v_m_s, w_rad_s: now.w_rad_s + part.w_rad_s }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    const AXLE: Drive = Drive { ell_m: 0.0, turn_rate_max_rad_s: 2.0 };
    const FRONT_POINT_DRIVE: Drive = Drive { ell_m: 0.1, turn_rate_max_rad_s: 2.0 };
    const ACCELERATIONS: Accelerations = Accelerations { forward_m_s2: 0.5, turn_rad_s2: 4.0 };

    fn twist(v_m_s: f64, w_rad_s: f64) -> Twist {
        Twist { v_m_s, w_rad_s }
    }

    #[test]
    fn axle_limits_speed_and_turn_rate_separately() {
        assert_eq!(AXLE.clamp(0.3, twist(-0.6, 1.0)), twist(-0.3, 1.0));
        assert_eq!(AXLE.clamp(0.3, twist(0.1, -5.0)), twist(0.1, -2.0));
        assert_eq!(AXLE.turn_rate_bound(0.3), 2.0);
        assert_eq!(AXLE.braking_time_s(ACCELERATIONS, twist(-0.2, 9.0)), 0.4);
        assert_eq!(AXLE.braking_time_s(ACCELERATIONS, twist(0.0, 9.0)), 0.0);
        let shorter = AXLE.clamp_braking_time(ACCELERATIONS, twist(-0.2, 1.0), 0.2);
        assert_eq!(shorter, twist(-0.1, 1.0));
        let next = AXLE.reachable(ACCELERATIONS, twist(0.1, 0.0), twist(0.2, 2.0), 0.1);
        assert!((next.v_m_s - 0.15).abs() < 1e-12 && (next.w_rad_s - 0.4).abs() < 1e-12);
        let next = AXLE.reachable(ACCELERATIONS, twist(0.1, 0.0), twist(0.12, 2.0), 0.1);
        assert_eq!(next, twist(0.12, 0.4));
    }

    proptest! {
        #[test]
        fn front_point_limits_scale_both_parts_of_a_twist(
            v in -2.0..2.0f64, w in -9.0..9.0f64, speed in 0.05..1.0f64, time in 0.05..1.0f64,
        ) {
            let given = twist(v, w);
            for found in [
                FRONT_POINT_DRIVE.clamp(speed, given),
                FRONT_POINT_DRIVE.clamp_braking_time(ACCELERATIONS, given, time),
                FRONT_POINT_DRIVE.reachable(ACCELERATIONS, Twist::ZERO, given, time),
            ] {
                prop_assert!((found.v_m_s * w - found.w_rad_s * v).abs() < 1e-12, "{found:?}");
            }
            let found = FRONT_POINT_DRIVE.clamp(speed, given);
            prop_assert!(front_speed(0.1, found) < speed + 1e-12);
            prop_assert!(found.w_rad_s.abs() < FRONT_POINT_DRIVE.turn_rate_bound(speed) + 1e-12);
        }
    }
}
