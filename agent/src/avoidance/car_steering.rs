//! Steering of a car, which turns only while it moves.
//!
//! Let g be the desired velocity and e the angle between its direction and the heading in the current gear. The car
//! drives with v = |g| cos e, at least 0.3 |g|, and turns as a robot at its axle midpoint, at most by kappa |v|. Where
//! e is large it shuttles: it drives in the opposite gear with full lock, so that it turns towards g, until e is small.
//! A car that is held back by others changes its direction of travel for a while. An addition to the chapter.

use std::f64::consts::{FRAC_PI_2, PI};

use formation::Vec2;
use formation::drive::Drive;
use formation::portable_math;
use formation::pose::{Twist, wrap_angle};

use super::Sample;

/// Angle e from which a car shuttles, and below which it drives on, rad.
const SHUTTLE_FROM_RAD: f64 = 1.1;
const SHUTTLE_UNTIL_RAD: f64 = 0.5;
/// Angle beyond a right angle at which the gear changes, rad.
const GEAR_HYSTERESIS_RAD: f64 = 0.3;
/// Minimum of v as a fraction of |g|.
const SPEED_FRACTION_MIN: f64 = 0.3;
/// Time for which a car is held back before it changes its direction, and for which it then keeps it at least, s.
const HELD_BACK_TIME_S: f64 = 0.25;
/// Fraction of the commanded speed below which a car counts as held back.
const HELD_BACK_SPEED_FRACTION: f64 = 0.2;

/// Gear of one car, and how long it has been held back.
#[derive(Debug, Default)]
pub struct CarSteering {
    /// `true` in reverse gear.
    is_in_reverse: bool,
    /// `true` while the car drives in the gear opposite to g.
    is_shuttling: bool,
    /// Time since the last change of `is_shuttling`, s.
    phase_time_s: f64,
    /// Time for which the car has been held back, s.
    held_back_time_s: f64,
    /// Stamp of the previous sample, ns.
    stamp_ns: Option<u64>,
    /// Speed commanded at the previous sample, m/s.
    commanded_speed_m_s: f64,
    /// Speed at the previous sample, m/s.
    speed_m_s: f64,
}

/// Desired motion of a car at one sample.
#[derive(Debug, Clone, Copy)]
pub struct DesiredCarMotion {
    /// Desired velocity (g), m/s.
    pub velocity: Vec2,
    /// Gain of the angle e, 1/s.
    pub direction_gain_per_s: f64,
    /// Turn rate of g, rad/s.
    pub direction_turn_rate_rad_s: f64,
    /// Speed below which the direction of g counts less, m/s.
    pub slow_speed_m_s: f64,
    /// `true` if the car drives forward only, as a leader.
    pub drives_forward_only: bool,
}

impl CarSteering {
    /// Returns the twist of a car with this drive for the `desired` motion at `sample`.
    pub fn steer(
        &mut self,
        drive: Drive,
        sample: &Sample<'_>,
        desired: &DesiredCarMotion,
    ) -> Twist {
        let DesiredCarMotion { velocity, slow_speed_m_s, .. } = *desired;
        let speed = velocity.norm();
        self.update_times(sample, slow_speed_m_s);
        if speed == 0.0 {
            self.commanded_speed_m_s = 0.0;
            return Twist::ZERO;
        }
        let angle_rad = portable_math::atan2(velocity.y, velocity.x);
        let error_rad = self.choose_gear(
            angle_rad - sample.heading_at_effect.angle_rad(),
            desired.drives_forward_only,
        );
        let gear = if self.is_in_reverse { -1.0 } else { 1.0 };
        let twist = match self.is_shuttling {
            true => {
                let turn = drive.curvature_max_per_m * speed;
                Twist::new(-gear * speed, turn.copysign(error_rad))
            }
            false => {
                let weight = if speed < slow_speed_m_s { speed / slow_speed_m_s } else { 1.0 };
                let v_m_s = gear * speed * portable_math::cos(error_rad).max(SPEED_FRACTION_MIN);
                Twist::new(
                    v_m_s,
                    weight
                        * (desired.direction_gain_per_s * error_rad
                            + desired.direction_turn_rate_rad_s),
                )
            }
        };
        self.commanded_speed_m_s = twist.v_m_s;
        drive.along_curve(twist, twist.v_m_s)
    }

    /// Updates the times with a new sample. While a car with inertia gains speed, the time for which it has been held
    /// back stands still: a change of the gear takes as long as its ramp.
    fn update_times(&mut self, sample: &Sample<'_>, slow_speed_m_s: f64) {
        let previous_ns = self.stamp_ns.replace(sample.stamp_ns).unwrap_or(sample.stamp_ns);
        let dt = sample.stamp_ns.saturating_sub(previous_ns) as f64 / 1e9;
        self.phase_time_s += dt;
        let (commanded, speed_m_s) = (self.commanded_speed_m_s, sample.twist.v_m_s);
        let previous_speed_m_s = std::mem::replace(&mut self.speed_m_s, speed_m_s);
        let is_slow = commanded.abs() > slow_speed_m_s
            && speed_m_s * commanded.signum() < HELD_BACK_SPEED_FRACTION * commanded.abs();
        let gains_speed = (speed_m_s - previous_speed_m_s) * commanded.signum() > 0.0;
        self.held_back_time_s = match (is_slow, gains_speed) {
            (true, false) => self.held_back_time_s + dt,
            (true, true) => self.held_back_time_s,
            (false, _) => 0.0,
        };
    }

    /// Chooses the gear for a direction at this angle to the heading, rad. Returns the angle in that gear (e), rad.
    fn choose_gear(&mut self, angle_rad: f64, drives_forward_only: bool) -> f64 {
        let error_in_gear = |reverse: bool| wrap_angle(angle_rad - if reverse { PI } else { 0.0 });
        if drives_forward_only {
            (self.is_in_reverse, self.is_shuttling) = (false, false);
            return error_in_gear(false);
        }
        if error_in_gear(self.is_in_reverse).abs() > FRAC_PI_2 + GEAR_HYSTERESIS_RAD {
            self.is_in_reverse = !self.is_in_reverse;
        }
        let error_rad = error_in_gear(self.is_in_reverse);
        let may_toggle = self.phase_time_s > HELD_BACK_TIME_S;
        let toggles = match self.is_shuttling {
            _ if self.held_back_time_s > HELD_BACK_TIME_S => true,
            true => may_toggle && error_rad.abs() < SHUTTLE_UNTIL_RAD,
            false => may_toggle && error_rad.abs() > SHUTTLE_FROM_RAD,
        };
        if toggles {
            (self.is_shuttling, self.phase_time_s, self.held_back_time_s) =
                (!self.is_shuttling, 0.0, 0.0);
        }
        error_rad
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use formation::drive::DriveKind;
    use formation::front_point::Heading;
    use formation::pose::Pose;
    use formation::unicycle::integrate_arc;

    const PERIOD_S: f64 = 0.01;

    /// Drives to the origin at up to 0.2 m/s with R_min = 0.15 m for 30 s. In each step the speed changes by at most
    /// `speed_change_max_m_s`. Returns the end.
    fn drive_to_origin(start: Pose, blocked_until: u64, speed_change_max_m_s: f64) -> Pose {
        let car = Drive::new(DriveKind::Ackermann, 0.0, None).with_turning_radius(Some(0.15));
        let (mut steering, mut pose, mut twist) = (CarSteering::default(), start, Twist::ZERO);
        for step in 0..3000 {
            let velocity = (-Vec2::new(pose.x_m, pose.y_m)).cap_magnitude(0.2);
            let sample = Sample {
                stamp_ns: step * 10_000_000,
                heading_at_effect: Heading::new(pose.heading_rad),
                twist,
                ..Sample::default()
            };
            let desired = DesiredCarMotion {
                velocity,
                direction_gain_per_s: 10.0,
                direction_turn_rate_rad_s: 0.0,
                slow_speed_m_s: 3e-3,
                drives_forward_only: false,
            };
            let requested = steering.steer(car, &sample, &desired);
            assert!(
                requested.w_rad_s.abs() <= requested.v_m_s.abs() / 0.15 + 1e-12,
                "{requested:?}"
            );
            // Something ahead holds it back at first.
            let is_blocked = step < blocked_until && requested.v_m_s > 0.0;
            let v_m_s = twist.v_m_s
                + (requested.v_m_s - twist.v_m_s)
                    .clamp(-speed_change_max_m_s, speed_change_max_m_s);
            twist = if is_blocked { Twist::ZERO } else { car.along_curve(requested, v_m_s) };
            pose = integrate_arc(pose, twist, PERIOD_S);
        }
        pose
    }

    #[test]
    fn car_reaches_a_place_in_any_direction() {
        // Without inertia, and with 2 s from 0.2 m/s to rest, much longer than it takes to count as held back.
        for speed_change_max_m_s in [f64::INFINITY, 0.1 * PERIOD_S] {
            for angle in 0..16 {
                let heading_rad = wrap_angle(f64::from(angle) * PI / 8.0);
                let start = Pose { x_m: 0.3, y_m: -0.1, heading_rad };
                let end = drive_to_origin(start, 0, speed_change_max_m_s);
                assert!(end.x_m.hypot(end.y_m) < 1e-2, "{heading_rad}: {end:?}");
            }
        }
    }

    #[test]
    fn car_that_is_held_back_drives_in_the_other_direction() {
        let start = Pose { x_m: -0.3, y_m: 0.0, heading_rad: 0.0 };
        let end = drive_to_origin(start, 400, f64::INFINITY);
        assert!(end.x_m.hypot(end.y_m) < 1e-2, "{end:?}");
    }
}
