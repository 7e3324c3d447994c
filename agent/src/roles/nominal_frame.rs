//! The leader's frame: rotation and scale of the formation, and their rates. (20)-(23)
//!
//! In the chapter the heading of the frame is that of the leader's body. A body is rotated by more than its
//! task: by avoidance, on the way back to its path and, through its control law, by sensor noise. Each of these
//! would swing the offsets of all robots, farther for larger offsets. And w_n', a difference over one period,
//! would amplify noise of millimeters to tens of rad/s^2.
//!
//! The frame is therefore that of a *nominal* leader: the same unicycle, starting from the heading of the
//! robot's first sample, whose front point moves with m'(t) only. A leader on its path has the same heading,
//! for any initial heading: along m(t) the difference of two headings decays like exp(-|m'| t / ell). Nothing
//! is estimated. Since m is known, turn rate and turn acceleration contain no noise, and no disturbance of the
//! leader rotates the formation.
//!
//! Where m(t) stops and reverses, that leader turns around, and the formation with it. With `keep_heading` the nominal
//! leader drives backwards instead, while m'(t) points behind it.
//!
//! Of all sensed values only the first heading is used. A leader that is controlled at its axle midpoint has the
//! heading of m'(t), without memory. An addition to the chapter.

use formation::drive::Drive;
use formation::frame::LeaderFrame;
use formation::front_point::towing_velocity;
use formation::pose::wrap_angle;
use formation::trajectory::Direction;
use protocol::brief::LeadBrief;

use crate::avoidance::Avoidance;

/// Maximum gap between samples, in periods. After a longer gap the nominal leader restarts from the robot's own
/// heading, as after a restart, so that the work per sample is bounded.
const SAMPLE_GAP_PERIODS_MAX: f64 = 1000.0;

/// Frame generator of an undisturbed leader.
pub(super) struct NominalFrameGenerator {
    /// Control period (T), s.
    period_s: f64,
    /// `true` if the leader is controlled at its axle midpoint.
    is_axle_controlled: bool,
    nominal_leader: Option<NominalLeader>,
}

/// State of the nominal leader at one instant.
#[derive(Debug, Clone, Copy)]
struct NominalLeader {
    /// Time since the start of the run, s.
    t_s: f64,
    /// Heading at that time, rad.
    heading_rad: f64,
    /// Turn rate held for one period from that time, rad/s.
    turn_rate_rad_s: f64,
    /// Difference from the previously held turn rate per second, rad/s^2.
    turn_acceleration_rad_s2: f64,
}

impl NominalFrameGenerator {
    /// Creates a generator that starts at the first sample, for a leader with this drive.
    pub(super) fn new(period_s: f64, drive: Drive) -> NominalFrameGenerator {
        NominalFrameGenerator {
            period_s,
            is_axle_controlled: drive.turns_freely(),
            nominal_leader: None,
        }
    }

    /// Creates a generator that continues `frame` from `t_s`, s since the start of the run.
    pub(super) fn continue_from(
        period_s: f64,
        drive: Drive,
        t_s: f64,
        frame: LeaderFrame,
    ) -> NominalFrameGenerator {
        let LeaderFrame { heading_rad, turn_rate_rad_s, turn_acceleration_rad_s2, .. } = frame;
        let held_rad_s = turn_rate_rad_s + 0.5 * period_s * turn_acceleration_rad_s2;
        let acceleration_rad_s2 = turn_acceleration_rad_s2;
        let nominal = NominalLeader {
            t_s,
            heading_rad,
            turn_rate_rad_s: held_rad_s,
            turn_acceleration_rad_s2: acceleration_rad_s2,
        };
        NominalFrameGenerator {
            nominal_leader: Some(nominal),
            ..NominalFrameGenerator::new(period_s, drive)
        }
    }

    /// Returns `true` once a frame was computed, or if it continues another one.
    pub(super) fn has_begun(&self) -> bool {
        self.nominal_leader.is_some()
    }

    /// Returns the frame at `t_s`, s since the start of the run. `heading_rad`, the robot's own heading, is
    /// used only at the first sample and after a long gap.
    pub(super) fn advance(
        &mut self,
        t_s: f64,
        heading_rad: f64,
        lead: &LeadBrief,
        avoidance: &dyn Avoidance,
    ) -> LeaderFrame {
        if self.is_axle_controlled {
            return self.advance_at_axle(t_s, heading_rad, lead);
        }
        let (period_s, LeadBrief { trajectory, scale, keep_heading }) = (self.period_s, lead);
        let turn_rate_at = |t_s: f64, heading_rad: f64| {
            let velocity = trajectory.target_at(t_s + 0.5 * period_s).velocity;
            let towing =
                towing_velocity(heading_rad, avoidance.admit_velocity(velocity), *keep_heading);
            avoidance.velocity_to_twist(heading_rad, towing).w_rad_s
        };
        let nominal = self
            .nominal_leader
            .filter(|leader| t_s - leader.t_s <= SAMPLE_GAP_PERIODS_MAX * period_s);
        let mut leader = nominal.unwrap_or_else(|| NominalLeader {
            t_s,
            heading_rad,
            turn_rate_rad_s: turn_rate_at(t_s, heading_rad),
            turn_acceleration_rad_s2: 0.0,
        });
        // Rounded to an integer number of periods, so that timer jitter has no effect.
        let periods = ((t_s - leader.t_s) / period_s).round();
        for period in 1..=periods as u32 {
            let from_s = nominal.unwrap_or(leader).t_s;
            let heading_rad = wrap_angle(leader.heading_rad + leader.turn_rate_rad_s * period_s);
            let t_s = from_s + f64::from(period) * period_s;
            let held_rad_s = turn_rate_at(t_s, heading_rad);
            let acceleration_rad_s2 = (held_rad_s - leader.turn_rate_rad_s) / period_s;
            leader = NominalLeader {
                t_s,
                heading_rad,
                turn_rate_rad_s: held_rad_s,
                turn_acceleration_rad_s2: acceleration_rad_s2,
            };
        }
        self.nominal_leader = Some(leader);
        let (scale, scale_rate_per_s) = scale.value_and_rate_at(t_s);
        let frame = LeaderFrame {
            heading_rad: leader.heading_rad,
            // The turn rate held for a period is the rate at its middle.
            turn_rate_rad_s: leader.turn_rate_rad_s
                - 0.5 * period_s * leader.turn_acceleration_rad_s2,
            turn_acceleration_rad_s2: leader.turn_acceleration_rad_s2,
            scale,
            scale_rate_per_s: 0.0,
        };
        LeaderFrame { scale_rate_per_s, ..frame.extrapolate(t_s - leader.t_s) }
    }

    /// Returns the frame at `t_s` of a leader whose heading is that of m'(t). `heading_rad` counts only where m(t) is
    /// at rest, or chooses the gear, before the first frame.
    fn advance_at_axle(&mut self, t_s: f64, heading_rad: f64, lead: &LeadBrief) -> LeaderFrame {
        let LeadBrief { trajectory, scale, keep_heading } = lead;
        let heading_rad = self.nominal_leader.map_or(heading_rad, |leader| leader.heading_rad);
        let Direction { heading_rad, turn_rate_rad_s, turn_acceleration_rad_s2 } =
            trajectory.direction_at(t_s, self.period_s, heading_rad, *keep_heading);
        let held_rad_s = turn_rate_rad_s + 0.5 * self.period_s * turn_acceleration_rad_s2;
        let acceleration_rad_s2 = turn_acceleration_rad_s2;
        self.nominal_leader = Some(NominalLeader {
            t_s,
            heading_rad,
            turn_rate_rad_s: held_rad_s,
            turn_acceleration_rad_s2: acceleration_rad_s2,
        });
        let (scale, scale_rate_per_s) = scale.value_and_rate_at(t_s);
        LeaderFrame {
            heading_rad,
            turn_rate_rad_s,
            turn_acceleration_rad_s2,
            scale,
            scale_rate_per_s,
        }
    }
}

#[cfg(test)]
mod tests {
    use std::f64::consts::PI;

    use super::*;
    use crate::avoidance::{Sample, exact_hold};
    use formation::Vec2;
    use formation::drive::DriveKind;
    use formation::front_point::Heading;
    use formation::front_point::front_point;
    use formation::pose::{Pose, Twist};
    use formation::scale::Scale;
    use formation::trajectory::Trajectory;
    use formation::unicycle::integrate_arc;

    const PERIOD_S: f64 = 0.01;
    const ELL: f64 = 0.15;
    const FRONT_POINT_DRIVE: Drive = Drive {
        kind: DriveKind::Differential,
        ell_m: ELL,
        turn_rate_max_rad_s: f64::INFINITY,
        curvature_max_per_m: f64::INFINITY,
    };
    const AXLE_DRIVE: Drive = Drive { ell_m: 0.0, turn_rate_max_rad_s: 2.0, ..FRONT_POINT_DRIVE };
    /// Tolerance between frames of the same instant.
    const FRAME_TOLERANCE: f64 = 1e-9;

    /// Moves the front point by exactly gamma T, at most at 1 m/s.
    struct ExactAvoidance;

    impl Avoidance for ExactAvoidance {
        fn admit_velocity(&self, gamma: Vec2) -> Vec2 {
            gamma / gamma.norm().max(1.0)
        }

        fn velocity_to_twist(&self, heading_rad: f64, gamma: Vec2) -> Twist {
            exact_hold(Heading::new(heading_rad), ELL, gamma * PERIOD_S, PERIOD_S)
        }

        fn steer(&mut self, _: &Sample<'_>, _: Vec2) -> Twist {
            Twist::ZERO
        }
    }

    fn circle(radius_m: f64) -> Trajectory {
        Trajectory::Circle { center_m: [0.0, 0.0], radius_m, period_s: 10.0 }
    }

    fn frame_at(
        generator: &mut NominalFrameGenerator,
        t_s: f64,
        heading_rad: f64,
        radius_m: f64,
    ) -> LeaderFrame {
        let scale = Scale::Sine { mean: 1.0, amplitude: 0.2, period_s: 20.0 };
        let lead = LeadBrief { scale, trajectory: circle(radius_m), keep_heading: false };
        generator.advance(t_s, heading_rad, &lead, &ExactAvoidance)
    }

    fn tick_time_s(k: u32) -> f64 {
        f64::from(k) * PERIOD_S
    }

    #[test]
    fn nominal_frame_turns_like_an_undisturbed_leader() {
        let mut generator = NominalFrameGenerator::new(PERIOD_S, FRONT_POINT_DRIVE);
        let mut body = Pose { x_m: 1.0, y_m: 0.0, heading_rad: 0.3 };
        for k in 0..500 {
            let frame = frame_at(&mut generator, tick_time_s(k), body.heading_rad, 1.0);
            assert!(
                wrap_angle(frame.heading_rad - body.heading_rad).abs() < FRAME_TOLERANCE,
                "tick {k}"
            );
            let velocity = circle(1.0).target_at(tick_time_s(k) + 0.5 * PERIOD_S).velocity;
            body = integrate_arc(
                body,
                ExactAvoidance.velocity_to_twist(body.heading_rad, velocity),
                PERIOD_S,
            );
        }
        assert!(front_point(body, ELL).norm() > 0.5, "it has moved");
    }

    #[test]
    fn frame_at_the_axle_has_the_direction_of_the_path() {
        let mut generator = NominalFrameGenerator::new(PERIOD_S, AXLE_DRIVE);
        for k in 0..300 {
            let frame = frame_at(&mut generator, tick_time_s(k), -2.0, 1.0);
            let course = 0.2 * PI * tick_time_s(k) + 0.5 * PI;
            assert!(wrap_angle(frame.heading_rad - course).abs() < FRAME_TOLERANCE, "tick {k}");
            assert!((frame.turn_rate_rad_s - 0.2 * PI).abs() < 1e-6, "tick {k}");
        }
    }

    #[test]
    fn heading_is_kept_at_a_cusp_only_with_keep_heading() {
        // Back and forth along the line y = x, from its middle: it reverses after 2.5 s and 7.5 s.
        let back_and_forth = |keep_heading| LeadBrief {
            scale: Scale::CONSTANT_ONE,
            trajectory: Trajectory::Lissajous {
                center_m: [0.0, 0.0],
                radii_m: [1.0, 1.0],
                cycles: [1, 1],
                phase_rad: 0.0,
                period_s: 10.0,
            },
            keep_heading,
        };
        let heading_at_7_s = |keep_heading| {
            let mut generator = NominalFrameGenerator::new(PERIOD_S, FRONT_POINT_DRIVE);
            let heading = |k| {
                generator
                    .advance(tick_time_s(k), 0.9, &back_and_forth(keep_heading), &ExactAvoidance)
                    .heading_rad
            };
            (0..=700).map(heading).last().unwrap()
        };
        // Without `keep_heading` the heading is unstable behind the cusp, and has turned by pi some 4 s later.
        let (reversed, unchanged) = (heading_at_7_s(false), heading_at_7_s(true));
        assert!(wrap_angle(unchanged - 0.25 * PI).abs() < 1e-3, "{unchanged}");
        assert!(wrap_angle(reversed + 0.75 * PI).abs() < 0.05, "{reversed}");
    }

    #[test]
    fn nominal_frame_uses_only_the_first_heading() {
        let (mut one, mut other) = (
            NominalFrameGenerator::new(PERIOD_S, FRONT_POINT_DRIVE),
            NominalFrameGenerator::new(PERIOD_S, FRONT_POINT_DRIVE),
        );
        for k in 0..300 {
            let heading_rad = if k == 0 { 0.3 } else { 0.3 + f64::from(k).sin() };
            let (a, b) = (
                frame_at(&mut one, tick_time_s(k), 0.3, 1.0),
                frame_at(&mut other, tick_time_s(k), heading_rad, 1.0),
            );
            assert_eq!(a, b, "tick {k}");
        }
    }

    #[test]
    fn turn_rate_and_acceleration_are_heading_derivatives() {
        let mut generator = NominalFrameGenerator::new(PERIOD_S, FRONT_POINT_DRIVE);
        let frames: Vec<LeaderFrame> =
            (0..200).map(|k| frame_at(&mut generator, tick_time_s(k), 2.0, 1.0)).collect();
        for (k, three) in frames.windows(3).enumerate() {
            let [before, now, after] = [0, 1, 2].map(|i| three[i].heading_rad);
            let slope = wrap_angle(after - before) / (2.0 * PERIOD_S);
            let bend = (wrap_angle(after - now) - wrap_angle(now - before)) / (PERIOD_S * PERIOD_S);
            let (rate, acceleration) =
                (three[1].turn_rate_rad_s, three[1].turn_acceleration_rad_s2);
            assert!((slope - rate).abs() < 1e-6, "tick {k}: {slope}, {rate}");
            assert!((bend - acceleration).abs() < 1e-6, "tick {k}: {bend}, {acceleration}");
        }
        assert!(frames[1].turn_rate_rad_s.abs() > 0.5, "it turns");
    }

    #[test]
    fn jitter_and_gaps_keep_the_frame_and_a_long_gap_restarts_it() {
        let mut regular = NominalFrameGenerator::new(PERIOD_S, FRONT_POINT_DRIVE);
        let frames: Vec<LeaderFrame> =
            (0..2000).map(|k| frame_at(&mut regular, tick_time_s(k), 0.3, 1.0)).collect();
        let mut late = NominalFrameGenerator::new(PERIOD_S, FRONT_POINT_DRIVE);
        frame_at(&mut late, 0.0, 0.3, 1.0);
        // Timer jitter of up to 0.4 T, and 3 s without a sample.
        for k in (1..400).chain(700..900) {
            let jitter_s = 0.4 * PERIOD_S * f64::from(k).sin();
            let (found, expected) = (
                frame_at(&mut late, tick_time_s(k) + jitter_s, 9.9, 1.0),
                frames[k as usize].extrapolate(jitter_s),
            );
            let error_rad = wrap_angle(found.heading_rad - expected.heading_rad);
            assert!(error_rad.abs() < FRAME_TOLERANCE, "tick {k}: off by {error_rad}");
            assert!((found.scale - expected.scale).abs() < 1e-6, "the scale is that of now");
        }
        let long_s = 9.0 + (SAMPLE_GAP_PERIODS_MAX + 2.0) * PERIOD_S;
        let restarted = frame_at(&mut late, long_s, 9.9, 1.0);
        assert_eq!((restarted.heading_rad, restarted.turn_acceleration_rad_s2), (9.9, 0.0));
    }

    #[test]
    fn scale_and_its_rate_match_the_instant() {
        let mut generator = NominalFrameGenerator::new(PERIOD_S, FRONT_POINT_DRIVE);
        let scale = Scale::Sine { mean: 1.0, amplitude: 0.2, period_s: 20.0 };
        for k in 0..100 {
            let t_s = tick_time_s(k) + 0.3 * PERIOD_S * f64::from(k).sin();
            let frame = frame_at(&mut generator, t_s, 0.3, 1.0);
            let error = frame.scale - scale.value_and_rate_at(t_s).0;
            assert!(
                error.abs() < 1e-6 && frame.scale_rate_per_s == scale.value_and_rate_at(t_s).1,
                "tick {k}"
            );
        }
    }

    #[test]
    fn path_above_the_admitted_speed_limits_the_turn_rate() {
        // The path needs 2 pi 5 m in 10 s, 3.1 m/s, of which 1 m/s is admitted. A velocity perpendicular to the
        // heading turns the body at u / ell.
        let mut generator = NominalFrameGenerator::new(PERIOD_S, FRONT_POINT_DRIVE);
        frame_at(&mut generator, 0.0, 0.0, 5.0);
        let frame = frame_at(&mut generator, PERIOD_S, 0.0, 5.0);
        assert!(
            frame.heading_rad < 1.01 * PERIOD_S / ELL && frame.heading_rad > 0.9 * PERIOD_S / ELL
        );
        assert!(frame.heading_rad < PI);
    }
}
