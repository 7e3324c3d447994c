//! Steering: the twist that moves the controlled point by a displacement within one period.
//!
//! A front point moves in any direction at once: the exact hold computes the twist, without state. The axle midpoint
//! moves only along its heading, so the robot turns towards the displacement and drives with the cosine of the
//! remaining angle:
//!
//! - e = angle(g) - theta - w_g T/2, with the desired velocity g and its turn rate w_g: the heading in the middle of
//!   the period shall be the direction of g. In reverse gear the direction of -g counts.
//! - w = k e + w_g, at most w_max. w_g is the difference of the angles of g, smoothed over 20 ms. With it e decreases
//!   exactly like exp(-k t), for a moving target too.
//! - v = |g| cos(heading error in the middle of the period), 0 if the robot faces the other way.
//! - The gear changes where e exceeds a right angle by 0.3 rad, so a cusp of the path needs no turn.
//!
//! Where g is slower than 1 % of the speed limit its direction is noise, and the robot turns less. At its goal a robot
//! turns in place to its final heading, if it has one: y = 0, so no half-plane of the guard limits it.
//!
//! An omnidirectional robot moves exactly by the displacement, and turns to its final heading on the way: y = R(-theta
//! - w T/2) g / sinc(w T/2).
//!
//! An addition to the chapter, which names the control of the axle midpoint as future work.

use std::f64::consts::{FRAC_PI_2, PI};

use formation::Vec2;
use formation::drive::{Drive, DriveKind};
use formation::front_point::{Heading, rotate};
use formation::portable_math;
use formation::pose::{Twist, wrap_angle};
use formation::unicycle::sinc;
use protocol::brief::AgentBrief;

use super::car_steering::{CarSteering, DesiredCarMotion};
use super::{Sample, exact_hold};

/// Gain k of the direction error, 1/s, and its maximum as a fraction of 1/T.
const DIRECTION_GAIN_PER_S: f64 = 10.0;
const DIRECTION_GAIN_PERIODS_MAX: f64 = 0.5;
/// Angle beyond a right angle at which the gear changes, rad.
const GEAR_HYSTERESIS_RAD: f64 = 0.3;
/// Time constant of the smoothed turn rate of g, s.
const TURN_SMOOTHING_S: f64 = 0.02;
/// Maximum step of the angle of g that counts as a turn and not as a jump, rad.
const TURN_STEP_RAD_MAX: f64 = 0.35;
/// Speed below which the direction of g counts less, as a fraction of the speed limit.
const SLOW_SPEED_FRACTION: f64 = 0.01;
/// Distance from the goal at which a robot begins to turn to its final heading, as a fraction of d, and the factor by
/// which it may then be pushed off before it drives again.
const ARRIVAL_DISTANCE_FRACTION: f64 = 0.005;
const ARRIVAL_HYSTERESIS_FACTOR: f64 = 2.0;

/// Steering of one robot.
pub struct Steering {
    drive: Drive,
    /// Control period (T), s.
    period_s: f64,
    /// Speed below which the direction of g counts less, m/s.
    slow_speed_m_s: f64,
    direction_gain_per_s: f64,
    /// Maximum turn acceleration (a_w), rad/s^2; infinite without inertia.
    turn_acceleration_max_rad_s2: f64,
    /// `true` if the robot drives forward only, as a leader whose heading is that of its path.
    drives_forward_only: bool,
    final_heading_rad: Option<f64>,
    /// Distance from the goal within which the robot turns to its final heading, m.
    arrival_distance_m: f64,
    /// `true` while the robot turns to its final heading.
    is_turning_in_place: bool,
    /// `true` in reverse gear.
    is_in_reverse: bool,
    /// Stamp, ns, and angle of g at the previous sample, rad.
    previous_direction: Option<(u64, f64)>,
    /// Smoothed turn rate of g (w_g), rad/s.
    direction_turn_rate_rad_s: f64,
    /// Gear of a car. Unused by other drives.
    car_steering: CarSteering,
}

impl Steering {
    /// Creates the steering of the robot of this brief.
    pub fn new(brief: &AgentBrief) -> Steering {
        let (period_s, v_max) = (brief.period_ns as f64 / 1e9, brief.avoidance.speed_max_m_s);
        Steering {
            drive: brief.drive(),
            period_s,
            slow_speed_m_s: if v_max.is_finite() { SLOW_SPEED_FRACTION * v_max } else { 0.0 },
            direction_gain_per_s: DIRECTION_GAIN_PER_S.min(DIRECTION_GAIN_PERIODS_MAX / period_s),
            turn_acceleration_max_rad_s2: brief
                .limits
                .map_or(f64::INFINITY, |limits| limits.turn_acceleration_rad_s2),
            drives_forward_only: brief.lead.as_ref().is_some_and(|lead| !lead.keep_heading),
            final_heading_rad: brief.goal_heading_rad,
            arrival_distance_m: ARRIVAL_DISTANCE_FRACTION * brief.avoidance.distance_min_m,
            is_turning_in_place: false,
            is_in_reverse: false,
            previous_direction: None,
            direction_turn_rate_rad_s: 0.0,
            car_steering: CarSteering::default(),
        }
    }

    /// Returns the drive of the robot.
    pub fn drive(&self) -> Drive {
        self.drive
    }

    /// Returns the twist that moves the controlled point by `displacement`, m, within one period from `heading`, without
    /// knowledge of earlier displacements.
    pub fn displacement_to_twist(&self, heading: Heading, displacement: Vec2) -> Twist {
        let heading_rad = heading.angle_rad();
        let u = displacement / self.period_s; // g
        match (self.drive.kind, self.drive.turns_freely()) {
            (DriveKind::Omni, _) => self.omnidirectional_twist(heading_rad, u),
            (DriveKind::Differential, true) => {
                self.twist_towards(heading_rad, u, 0.0, self.is_in_reverse)
            }
            (DriveKind::Ackermann, _) => {
                let twist = self.twist_towards(heading_rad, u, 0.0, self.is_in_reverse);
                self.drive.along_curve(twist, twist.v_m_s)
            }
            (DriveKind::Differential, false) => {
                exact_hold(heading, self.drive.ell_m, displacement, self.period_s)
            }
        }
    }

    /// Returns the twist of an omnidirectional robot that moves by u T within one period.
    fn omnidirectional_twist(&self, heading_rad: f64, u: Vec2) -> Twist {
        let w_max = self.drive.turn_rate_max_rad_s;
        let turn =
            |final_rad: f64| self.heading_correction_rate(wrap_angle(final_rad - heading_rad));
        let w_rad_s = self.final_heading_rad.map_or(0.0, turn).clamp(-w_max, w_max);
        let half_turn = 0.5 * w_rad_s * self.period_s;
        self.drive
            .twist_for_velocity(rotate(-heading_rad - half_turn, u) / sinc(half_turn), w_rad_s)
    }

    /// Returns the twist that moves the controlled point by `displacement`, m, within one period, in answer to
    /// `sample`. `gamma` is the nominal velocity, m/s: a robot that avoids another does not turn to its final heading.
    pub fn steer(&mut self, sample: &Sample<'_>, gamma: Vec2, displacement: Vec2) -> Twist {
        if !self.drive.moves_along_heading() {
            return self.displacement_to_twist(sample.heading_at_effect, displacement);
        }
        let heading_rad = sample.heading_at_effect.angle_rad();
        let u = displacement / self.period_s; // g
        if let Some(twist) = self.turn_in_place(sample, gamma, u) {
            return twist;
        }
        if u.norm_squared() == 0.0 {
            self.previous_direction = None;
            return Twist::ZERO;
        }
        let angle_rad = portable_math::atan2(u.y, u.x);
        self.update_direction_turn_rate(sample.stamp_ns, angle_rad);
        if self.drive.is_car() {
            let desired = DesiredCarMotion {
                velocity: u,
                direction_gain_per_s: self.direction_gain_per_s,
                direction_turn_rate_rad_s: self.direction_turn_rate_rad_s,
                slow_speed_m_s: self.slow_speed_m_s,
                drives_forward_only: self.drives_forward_only,
            };
            return self.car_steering.steer(self.drive, sample, &desired);
        }
        let error_rad =
            wrap_angle(angle_rad - heading_rad - if self.is_in_reverse { PI } else { 0.0 });
        if self.drives_forward_only {
            self.is_in_reverse = false;
        } else if error_rad.abs() > FRAC_PI_2 + GEAR_HYSTERESIS_RAD {
            self.is_in_reverse = !self.is_in_reverse;
        }
        self.twist_towards(heading_rad, u, self.direction_turn_rate_rad_s, self.is_in_reverse)
    }

    /// Returns the twist towards `u` in this gear, if the direction of `u` turns at `turn_rad_s`.
    fn twist_towards(&self, heading_rad: f64, u: Vec2, turn_rad_s: f64, reverse: bool) -> Twist {
        let speed = u.norm();
        if speed == 0.0 {
            return Twist::ZERO;
        }
        let (gear, direction) = if reverse { (-1.0, -u) } else { (1.0, u) };
        let error_rad = wrap_angle(portable_math::atan2(direction.y, direction.x) - heading_rad);
        let half_s = 0.5 * self.period_s;
        let weight = if speed < self.slow_speed_m_s { speed / self.slow_speed_m_s } else { 1.0 };
        let correction = self.heading_correction_rate(error_rad - turn_rad_s * half_s);
        let w_max = self.drive.turn_rate_max_rad_s;
        let w_rad_s = (weight * (correction + turn_rad_s)).clamp(-w_max, w_max);
        let cos = portable_math::cos(error_rad - w_rad_s * half_s);
        Twist::new(gear * speed * cos.max(0.0), w_rad_s)
    }

    /// Returns the turn rate that corrects a heading error, rad/s, from which the robot can stop turning in time.
    fn heading_correction_rate(&self, error_rad: f64) -> f64 {
        let turn = self.direction_gain_per_s * error_rad;
        if self.turn_acceleration_max_rad_s2 == f64::INFINITY {
            return turn;
        }
        let stoppable_rate = (self.turn_acceleration_max_rad_s2 * error_rad.abs()).sqrt();
        turn.clamp(-stoppable_rate, stoppable_rate)
    }

    /// Updates the turn rate of g with its angle at a new sample.
    fn update_direction_turn_rate(&mut self, stamp_ns: u64, angle_rad: f64) {
        let previous = self.previous_direction.replace((stamp_ns, angle_rad));
        let Some((previous_ns, previous_rad)) = previous else {
            self.direction_turn_rate_rad_s = 0.0;
            return;
        };
        let dt = stamp_ns.saturating_sub(previous_ns) as f64 / 1e9;
        let step_rad = wrap_angle(angle_rad - previous_rad);
        if dt > 0.0 && step_rad.abs() <= TURN_STEP_RAD_MAX {
            self.direction_turn_rate_rad_s +=
                (step_rad / dt - self.direction_turn_rate_rad_s) * (dt / (dt + TURN_SMOOTHING_S));
        }
    }

    /// Returns the twist that turns a robot at its goal to its final heading, or `None` if it has to drive.
    fn turn_in_place(&mut self, sample: &Sample<'_>, gamma: Vec2, u: Vec2) -> Option<Twist> {
        let final_rad = self.final_heading_rad?;
        let distance_m = sample.error?.norm();
        let within = if self.is_turning_in_place { ARRIVAL_HYSTERESIS_FACTOR } else { 1.0 }
            * self.arrival_distance_m;
        let is_unobstructed =
            (u - gamma).norm() <= self.slow_speed_m_s || u.norm() <= self.slow_speed_m_s;
        self.is_turning_in_place = distance_m < within && is_unobstructed;
        if !self.is_turning_in_place {
            return None;
        }
        self.previous_direction = None;
        let w_max = self.drive.turn_rate_max_rad_s;
        let error_rad = wrap_angle(final_rad - sample.heading_at_effect.angle_rad());
        let turn = self.heading_correction_rate(error_rad);
        Some(Twist::new(0.0, turn.clamp(-w_max, w_max)))
    }
}

#[cfg(test)]
mod tests {
    use super::super::guard::tests::brief;
    use super::*;
    use formation::pose::Pose;
    use formation::unicycle::integrate_arc;
    use proptest::prelude::*;

    const PERIOD_S: f64 = 0.01;

    /// Returns the steering of a robot at its axle midpoint: w_max = 4 rad/s, v_max = 0.5 m/s, T = 10 ms.
    fn axle_steering(change: impl FnOnce(&mut AgentBrief)) -> Steering {
        let mut brief = brief();
        (brief.front_point_m, brief.turn_rate_max_rad_s) = (0.0, Some(4.0));
        change(&mut brief);
        Steering::new(&brief)
    }

    fn sample(step: u64, pose: Pose, error: Vec2) -> Sample<'static> {
        let stamp_ns = step * 10_000_000;
        Sample {
            stamp_ns,
            heading_at_effect: Heading::new(pose.heading_rad),
            error: Some(error),
            ..Sample::default()
        }
    }

    /// Drives for `steps` periods with the desired velocity `g(t, position)`. Returns the poses.
    fn simulate_drive(
        steering: &mut Steering,
        start: Pose,
        steps: u64,
        g: impl Fn(f64, Vec2) -> Vec2,
    ) -> Vec<Pose> {
        let mut pose = start;
        let mut path = vec![pose];
        for step in 0..steps {
            let position = Vec2::new(pose.x_m, pose.y_m);
            let u = g(step as f64 * PERIOD_S, position);
            let twist = steering.steer(&sample(step, pose, position), u, u * PERIOD_S);
            assert!(twist.w_rad_s.abs() <= 4.0 && twist.v_m_s.abs() <= u.norm() + 1e-15);
            pose = integrate_arc(pose, twist, PERIOD_S);
            path.push(pose);
        }
        path
    }

    #[test]
    fn axle_on_a_circle_tracks_without_lag() {
        // m(t) on a circle of 0.5 m at 0.3 m/s, with g = m' - 2 (alpha - m).
        let m = |t: f64| 0.5 * Vec2::new((0.6 * t).cos(), (0.6 * t).sin());
        let rate = |t: f64| 0.3 * Vec2::new(-(0.6 * t).sin(), (0.6 * t).cos());
        let mut steering = axle_steering(|_| {});
        let start = Pose { x_m: 0.3, y_m: -0.2, heading_rad: 0.0 };
        let path = simulate_drive(&mut steering, start, 2000, |t, position| {
            rate(t + 0.5 * PERIOD_S) - 2.0 * (position - m(t))
        });
        let error =
            |k: usize| (Vec2::new(path[k].x_m, path[k].y_m) - m(k as f64 * PERIOD_S)).norm();
        let worst = (1500..=2000).map(error).fold(0.0, f64::max);
        assert!(worst < 2e-5, "{worst}");
    }

    #[test]
    fn goal_behind_an_axle_is_reached_in_reverse_gear() {
        let mut steering = axle_steering(|_| {});
        let start = Pose { x_m: 0.4, y_m: 0.05, heading_rad: 0.0 };
        let path = simulate_drive(&mut steering, start, 1000, |_, position| -position);
        assert!(path.iter().all(|pose| pose.heading_rad.abs() < 1.0), "it does not turn around");
        let end = path.last().unwrap();
        assert!(end.x_m.hypot(end.y_m) < 1e-4, "{end:?}");
        let mut leader = axle_steering(|brief| {
            let lead = protocol::brief::LeadBrief {
                scale: formation::scale::Scale::CONSTANT_ONE,
                trajectory: formation::trajectory::Trajectory::Still { center_m: [0.0, 0.0] },
                keep_heading: false,
            };
            brief.lead = Some(lead);
        });
        let path = simulate_drive(&mut leader, start, 1000, |_, position| -position);
        assert!(path.iter().any(|pose| pose.heading_rad.abs() > 2.5), "a leader turns around");
    }

    #[test]
    fn robot_at_its_goal_turns_in_place_to_its_final_heading() {
        for accelerates in [false, true] {
            let mut steering = axle_steering(|brief| {
                brief.goal_heading_rad = Some(-2.0);
                brief.limits = accelerates.then_some(protocol::brief::AccelerationLimitsBrief {
                    acceleration_m_s2: 1.0,
                    turn_acceleration_rad_s2: 2.0,
                    braking_time_s: 0.5,
                    ramp: formation::ramp::Ramp::Independent,
                });
            });
            let start = Pose { x_m: 0.2, y_m: 0.1, heading_rad: 0.5 };
            let path = simulate_drive(&mut steering, start, 1500, |_, position| -position);
            let end = path.last().unwrap();
            assert!(end.x_m.hypot(end.y_m) < 2e-3, "{end:?}");
            assert!(wrap_angle(end.heading_rad + 2.0).abs() < 1e-3, "{end:?}");
        }
    }

    proptest! {
        #[test]
        fn omni_robot_moves_by_the_displacement_while_it_turns(
            heading_rad in -3.1..3.1f64, final_rad in -3.1..3.1f64, course in -3.1..3.1f64,
            speed in 0.0..0.4f64,
        ) {
            let mut steering = axle_steering(|brief| {
                brief.drive_kind = DriveKind::Omni;
                brief.goal_heading_rad = Some(final_rad);
            });
            let mut pose = Pose { x_m: 0.3, y_m: -0.7, heading_rad };
            let u = speed * Vec2::new(course.cos(), course.sin());
            for step in 0..200 {
                let end = integrate_arc(pose, steering.steer(&sample(step, pose, u), u, u * PERIOD_S), PERIOD_S);
                let moved = Vec2::new(end.x_m - pose.x_m, end.y_m - pose.y_m);
                prop_assert!((moved - u * PERIOD_S).norm() < 1e-12, "{moved:?}");
                pose = end;
            }
            prop_assert!(wrap_angle(pose.heading_rad - final_rad).abs() < 1e-3, "{pose:?}");
        }
    }

    #[test]
    fn robot_that_avoids_another_does_not_turn_in_place() {
        let mut steering = axle_steering(|brief| brief.goal_heading_rad = Some(2.0));
        let pose = Pose { x_m: 0.0, y_m: 0.0, heading_rad: 0.0 };
        let sample_at_goal = sample(0, pose, Vec2::zeros());
        let displacement = Vec2::new(0.2, 0.0) * PERIOD_S;
        assert_eq!(steering.steer(&sample_at_goal, Vec2::zeros(), Vec2::zeros()).v_m_s, 0.0);
        assert!(
            (steering.steer(&sample_at_goal, Vec2::zeros(), displacement).v_m_s - 0.2).abs()
                < 1e-12
        );
    }

    proptest! {
        /// Along the heading, in either gear, the displacement of one period is exact.
        #[test]
        fn aligned_axle_moves_by_the_displacement(
            heading_rad in -3.1..3.1f64, speed in -0.4..0.4f64,
        ) {
            let mut steering = axle_steering(|_| {});
            let pose = Pose { x_m: 0.3, y_m: -0.7, heading_rad };
            let u = speed * Vec2::new(heading_rad.cos(), heading_rad.sin());
            let end = integrate_arc(pose, steering.steer(&sample(0, pose, u), u, u * PERIOD_S), PERIOD_S);
            let moved = Vec2::new(end.x_m - pose.x_m, end.y_m - pose.y_m);
            prop_assert!((moved - u * PERIOD_S).norm() < 1e-12, "{moved:?}");
        }
    }
}
