//! The leader's frame: how the formation is turned and scaled, and how that changes. (20)-(23)
//!
//! In the chapter the frame's heading is that of the leader's body. A body is turned by more than
//! its task: by avoidance, on the way back to its path, and, through its law, by the noise of its
//! sensors. Each of these would swing everybody's offsets, by more the farther they are away; and
//! w_n', a difference over one period, would carry noise of millimeters into tens of rad/s^2.
//!
//! So the frame is that of a *nominal* leader: the same unicycle, from the heading at which the
//! robot first finds itself, whose front point moves with m'(t) and nothing else. A leader that is
//! on its path has that heading too, whatever its own was before: along m(t) the difference of two
//! headings dies out, like exp(-|m'| t / ell). Nothing is estimated: m is known, so neither turn
//! rate nor its rate have noise to filter, and nothing that pushes the leader turns the formation.
//!
//! Must not use anything sensed but the first heading. Not in the paper.

use formation::frame::LeaderFrame;
use formation::pose::wrap_angle;
use formation::scale::Scale;
use formation::trajectory::Trajectory;

use crate::avoidance::Avoidance;

/// After a gap of more periods than this the nominal leader starts anew from the robot's own
/// heading, as that of a restarted robot does: the work of one sample stays bounded.
const GAP_PERIODS_MAX: f64 = 1000.0;

/// The frame of a leader that nothing holds up and nothing deceives.
pub(super) struct NominalFrame {
    /// T, s.
    period_s: f64,
    nominal: Option<Nominal>,
}

/// The nominal leader at one instant.
#[derive(Debug, Clone, Copy)]
struct Nominal {
    /// Time since the run's start, s.
    t_s: f64,
    /// Its heading then, rad.
    heading_rad: f64,
    /// Turn rate held from then on for a period, rad/s.
    held_rad_s: f64,
    /// What was held before differs from this by so much per second, rad/s^2.
    acceleration_rad_s2: f64,
}

impl NominalFrame {
    /// Of a robot that has not seen where it is yet.
    pub(super) fn new(period_s: f64) -> NominalFrame {
        NominalFrame { period_s, nominal: None }
    }

    /// That continues a frame of `t_s`, s since the run's start.
    pub(super) fn from(period_s: f64, t_s: f64, frame: LeaderFrame) -> NominalFrame {
        let LeaderFrame { heading_rad, turn_rate_rad_s, turn_acceleration_rad_s2, .. } = frame;
        let held_rad_s = turn_rate_rad_s + 0.5 * period_s * turn_acceleration_rad_s2;
        let acceleration_rad_s2 = turn_acceleration_rad_s2;
        let nominal = Nominal { t_s, heading_rad, held_rad_s, acceleration_rad_s2 };
        NominalFrame { period_s, nominal: Some(nominal) }
    }

    /// Whether it was asked before, or continues another.
    pub(super) fn has_begun(&self) -> bool {
        self.nominal.is_some()
    }

    /// The frame at `t_s`, s since the run's start. `heading_rad`, the robot's own, counts if this
    /// is the first sample, or the first after a long gap.
    pub(super) fn at(
        &mut self,
        t_s: f64,
        heading_rad: f64,
        trajectory: &Trajectory,
        scale: &Scale,
        avoidance: &dyn Avoidance,
    ) -> LeaderFrame {
        let period_s = self.period_s;
        let held = |t_s: f64, heading_rad: f64| {
            let velocity = trajectory.at(t_s + 0.5 * period_s).velocity;
            avoidance.follow(heading_rad, avoidance.admit(velocity)).w_rad_s
        };
        let begun = self.nominal.filter(|was| t_s - was.t_s <= GAP_PERIODS_MAX * period_s);
        let mut now = begun.unwrap_or_else(|| Nominal {
            t_s,
            heading_rad,
            held_rad_s: held(t_s, heading_rad),
            acceleration_rad_s2: 0.0,
        });
        // Whole periods, to the one nearest to the sample: a timer's jitter does not get in.
        let periods = ((t_s - now.t_s) / period_s).round();
        for period in 1..=periods as u32 {
            let from_s = begun.unwrap_or(now).t_s;
            let heading_rad = wrap_angle(now.heading_rad + now.held_rad_s * period_s);
            let t_s = from_s + f64::from(period) * period_s;
            let held_rad_s = held(t_s, heading_rad);
            let acceleration_rad_s2 = (held_rad_s - now.held_rad_s) / period_s;
            now = Nominal { t_s, heading_rad, held_rad_s, acceleration_rad_s2 };
        }
        self.nominal = Some(now);
        let (scale, scale_rate_per_s) = scale.at(t_s);
        let frame = LeaderFrame {
            heading_rad: now.heading_rad,
            // What is held for a period is the rate at its middle.
            turn_rate_rad_s: now.held_rad_s - 0.5 * period_s * now.acceleration_rad_s2,
            turn_acceleration_rad_s2: now.acceleration_rad_s2,
            scale,
            scale_rate_per_s: 0.0,
        };
        LeaderFrame { scale_rate_per_s, ..frame.later(t_s - now.t_s) }
    }
}

#[cfg(test)]
mod tests {
    use std::f64::consts::PI;

    use super::*;
    use crate::avoidance::{Sample, exact_hold};
    use formation::Vec2;
    use formation::front_point::front_point;
    use formation::pose::{Pose, Twist};
    use formation::unicycle::arc;

    const T: f64 = 0.01;
    const ELL: f64 = 0.15;
    /// Frames of the same instant differ by no more than this.
    const SAME: f64 = 1e-9;

    /// Moves the front point by exactly gamma T, at 1 m/s at most.
    struct Exact;

    impl Avoidance for Exact {
        fn admit(&self, gamma: Vec2) -> Vec2 {
            gamma / gamma.norm().max(1.0)
        }

        fn follow(&self, heading_rad: f64, gamma: Vec2) -> Twist {
            exact_hold(heading_rad, ELL, gamma * T, T)
        }

        fn steer(&mut self, _: &Sample<'_>, _: Vec2) -> Twist {
            Twist::ZERO
        }
    }

    fn circle(radius_m: f64) -> Trajectory {
        Trajectory::Circle { center_m: [0.0, 0.0], radius_m, period_s: 10.0 }
    }

    fn at(frame: &mut NominalFrame, t_s: f64, heading_rad: f64, radius_m: f64) -> LeaderFrame {
        let scale = Scale::Sine { mean: 1.0, amplitude: 0.2, period_s: 20.0 };
        frame.at(t_s, heading_rad, &circle(radius_m), &scale, &Exact)
    }

    fn tick(k: u32) -> f64 {
        f64::from(k) * T
    }

    #[test]
    fn it_turns_like_a_leader_that_nothing_disturbs() {
        let mut frame = NominalFrame::new(T);
        let mut body = Pose { x_m: 1.0, y_m: 0.0, heading_rad: 0.3 };
        for k in 0..500 {
            let told = at(&mut frame, tick(k), body.heading_rad, 1.0);
            assert!(wrap_angle(told.heading_rad - body.heading_rad).abs() < SAME, "tick {k}");
            let velocity = circle(1.0).at(tick(k) + 0.5 * T).velocity;
            body = arc(body, Exact.follow(body.heading_rad, velocity), T);
        }
        assert!(front_point(body, ELL).norm() > 0.5, "it has moved");
    }

    #[test]
    fn nothing_but_the_first_heading_is_sensed() {
        let (mut one, mut other) = (NominalFrame::new(T), NominalFrame::new(T));
        for k in 0..300 {
            let pushed = if k == 0 { 0.3 } else { 0.3 + f64::from(k).sin() };
            let (a, b) = (at(&mut one, tick(k), 0.3, 1.0), at(&mut other, tick(k), pushed, 1.0));
            assert_eq!(a, b, "tick {k}");
        }
    }

    #[test]
    fn turn_rate_and_acceleration_are_the_headings_derivatives() {
        let mut frame = NominalFrame::new(T);
        let told: Vec<LeaderFrame> = (0..200).map(|k| at(&mut frame, tick(k), 2.0, 1.0)).collect();
        for (k, three) in told.windows(3).enumerate() {
            let [before, now, after] = [0, 1, 2].map(|i| three[i].heading_rad);
            let slope = wrap_angle(after - before) / (2.0 * T);
            let bend = (wrap_angle(after - now) - wrap_angle(now - before)) / (T * T);
            let (rate, acceleration) =
                (three[1].turn_rate_rad_s, three[1].turn_acceleration_rad_s2);
            assert!((slope - rate).abs() < 1e-6, "tick {k}: {slope}, {rate}");
            assert!((bend - acceleration).abs() < 1e-6, "tick {k}: {bend}, {acceleration}");
        }
        assert!(told[1].turn_rate_rad_s.abs() > 0.5, "it turns");
    }

    #[test]
    fn jitter_and_gaps_lose_nothing_and_a_long_gap_begins_anew() {
        let mut regular = NominalFrame::new(T);
        let told: Vec<LeaderFrame> =
            (0..2000).map(|k| at(&mut regular, tick(k), 0.3, 1.0)).collect();
        let mut late = NominalFrame::new(T);
        at(&mut late, 0.0, 0.3, 1.0);
        // A timer that is off by up to 0.4 T, and 3 s without a sample.
        for k in (1..400).chain(700..900) {
            let off_s = 0.4 * T * f64::from(k).sin();
            let (found, expected) =
                (at(&mut late, tick(k) + off_s, 9.9, 1.0), told[k as usize].later(off_s));
            let off_rad = wrap_angle(found.heading_rad - expected.heading_rad);
            assert!(off_rad.abs() < SAME, "tick {k}: off by {off_rad}");
            assert!((found.scale - expected.scale).abs() < 1e-6, "the scale is that of now");
        }
        let long_s = 9.0 + (GAP_PERIODS_MAX + 2.0) * T;
        let anew = at(&mut late, long_s, 9.9, 1.0);
        assert_eq!((anew.heading_rad, anew.turn_acceleration_rad_s2), (9.9, 0.0));
    }

    #[test]
    fn the_scale_and_its_rate_are_those_of_the_instant() {
        let mut frame = NominalFrame::new(T);
        let scale = Scale::Sine { mean: 1.0, amplitude: 0.2, period_s: 20.0 };
        for k in 0..100 {
            let t_s = tick(k) + 0.3 * T * f64::from(k).sin();
            let told = at(&mut frame, t_s, 0.3, 1.0);
            let off = told.scale - scale.at(t_s).0;
            assert!(off.abs() < 1e-6 && told.scale_rate_per_s == scale.at(t_s).1, "tick {k}");
        }
    }

    #[test]
    fn a_path_faster_than_is_admitted_turns_it_no_faster_than_the_leader_can_go() {
        // 2 pi 5 m in 10 s: 3.1 m/s, of which 1 m/s is admitted. Across its velocity a front point
        // turns the body by u / ell.
        let mut frame = NominalFrame::new(T);
        at(&mut frame, 0.0, 0.0, 5.0);
        let told = at(&mut frame, T, 0.0, 5.0);
        assert!(told.heading_rad < 1.01 * T / ELL && told.heading_rad > 0.9 * T / ELL);
        assert!(told.heading_rad < PI);
    }
}
