//! The leader's frame: the rotation and scale that make static offsets time-varying. (20)-(23)

use crate::Vec2;
use crate::desired::Target;
use crate::front_point::Rotation;
use crate::scale::Scale;

/// Heading and scale of the formation at one instant, with their rates of change.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct LeaderFrame {
    /// Heading of the leader (theta_n), rad.
    pub heading_rad: f64,
    /// Turn rate of the leader (w_n), without the part caused by collision avoidance, rad/s.
    pub turn_rate_rad_s: f64,
    /// Turn acceleration of the leader (w_n'), rad/s^2. Without it, a frame relayed over several hops would lag
    /// behind w_n. An addition to the chapter.
    pub turn_acceleration_rad_s2: f64,
    /// Scale factor of the formation (delta).
    pub scale: f64,
    /// Rate of change of the scale factor (delta'), 1/s.
    pub scale_rate_per_s: f64,
}

impl LeaderFrame {
    /// Identity frame for formations without a leader: it leaves offsets unchanged.
    pub const IDENTITY: LeaderFrame = LeaderFrame {
        heading_rad: 0.0,
        turn_rate_rad_s: 0.0,
        turn_acceleration_rad_s2: 0.0,
        scale: 1.0,
        scale_rate_per_s: 0.0,
    };

    /// Returns the frame of a leaderless formation: offsets do not rotate, and `scale` is evaluated at `t_s`, s
    /// since the start of the run.
    pub fn for_leaderless_formation(scale: &Scale, t_s: f64) -> LeaderFrame {
        let (scale, scale_rate_per_s) = scale.value_and_rate_at(t_s);
        LeaderFrame { scale, scale_rate_per_s, ..LeaderFrame::IDENTITY }
    }

    /// Returns the frame extrapolated by `age_s`, with constant turn acceleration and constant scale rate.
    #[inline]
    pub fn extrapolate(self, age_s: f64) -> LeaderFrame {
        let turn_rate_gain = self.turn_acceleration_rad_s2 * age_s;
        LeaderFrame {
            heading_rad: self.heading_rad + (self.turn_rate_rad_s + 0.5 * turn_rate_gain) * age_s,
            turn_rate_rad_s: self.turn_rate_rad_s + turn_rate_gain,
            scale: self.scale + self.scale_rate_per_s * age_s,
            ..self
        }
    }

    /// Returns a frame with the current heading and scale and all rates 0.
    pub fn with_zero_rates(self) -> LeaderFrame {
        let identity = LeaderFrame::IDENTITY;
        LeaderFrame { heading_rad: self.heading_rad, scale: self.scale, ..identity }
    }

    /// Returns the desired relative position C_ji and its derivative C'_ji for the static offset c_ji, m.
    pub fn transform_offset(&self, c_ji: Vec2) -> Target {
        self.offset_transform().apply(c_ji)
    }

    /// Returns [`LeaderFrame::transform_offset`] of this instant, for several offsets.
    #[inline]
    pub fn offset_transform(&self) -> OffsetTransform {
        OffsetTransform { frame: *self, rotation: Rotation::from_angle(self.heading_rad) }
    }
}

/// Map of static offsets to desired relative positions at one instant, with the sine and cosine of the heading.
#[derive(Debug, Clone, Copy)]
pub struct OffsetTransform {
    frame: LeaderFrame,
    rotation: Rotation,
}

impl OffsetTransform {
    /// Returns the unit vector of the frame's heading.
    #[inline]
    pub fn direction(&self) -> Vec2 {
        self.rotation.unit_vector()
    }

    /// Returns the desired relative position C_ji and its derivative C'_ji for the static offset c_ji, m.
    #[inline]
    pub fn apply(&self, c_ji: Vec2) -> Target {
        let OffsetTransform { frame, rotation } = self;
        let rotated = rotation.apply(c_ji); // R c
        let perpendicular = Vec2::new(-rotated.y, rotated.x); // (23): R' c = w times this
        let offset = frame.scale * rotated; // (20)
        let rate =
            frame.scale_rate_per_s * rotated + frame.scale * frame.turn_rate_rad_s * perpendicular; // (22)
        Target { position: offset, velocity: rate }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn offset_velocity_is_derivative_of_offset(
            heading_rad in -3.0..3.0f64, turn_rate_rad_s in -2.0..2.0f64,
            turn_acceleration_rad_s2 in -1.0..1.0f64,
            scale in 0.5..2.0f64, scale_rate_per_s in -0.5..0.5f64,
        ) {
            let frame = LeaderFrame {
                heading_rad,
                turn_rate_rad_s,
                turn_acceleration_rad_s2,
                scale,
                scale_rate_per_s,
            };
            let (c, h) = (Vec2::new(0.6, -0.3), 1e-6);
            let slope = (frame.extrapolate(h).transform_offset(c).position
                - frame.extrapolate(-h).transform_offset(c).position) / (2.0 * h);
            prop_assert!((slope - frame.transform_offset(c).velocity).norm() < 1e-8);
        }

        #[test]
        fn frozen_frame_keeps_heading_and_scale(
            heading_rad in -3.0..3.0f64, rate in -2.0..2.0f64, scale in 0.5..2.0f64,
            age_s in 0.0..9.0f64,
        ) {
            let frame = LeaderFrame {
                heading_rad,
                turn_rate_rad_s: rate,
                turn_acceleration_rad_s2: rate,
                scale,
                scale_rate_per_s: rate,
            };
            let frozen = frame.with_zero_rates();
            prop_assert_eq!(frozen.extrapolate(age_s), frozen);
            let c = Vec2::new(0.6, -0.3);
            prop_assert_eq!(frozen.transform_offset(c), Target::at_rest(frame.transform_offset(c).position));
        }
    }

    #[test]
    fn still_frame_leaves_offsets_unchanged() {
        let c = Vec2::new(0.3, 0.4);
        assert_eq!(LeaderFrame::IDENTITY.transform_offset(c), Target::at_rest(c));
    }

    #[test]
    fn frame_later_integrates_its_rates() {
        let frame = LeaderFrame {
            heading_rad: 0.1,
            turn_rate_rad_s: 0.5,
            turn_acceleration_rad_s2: 0.25,
            scale: 2.0,
            scale_rate_per_s: -0.1,
        };
        let later = frame.extrapolate(2.0);
        assert!((later.heading_rad - 1.6).abs() < 1e-12, "{later:?}");
        assert!((later.turn_rate_rad_s - 1.0).abs() < 1e-12, "{later:?}");
        assert!((later.scale - 1.8).abs() < 1e-12, "{later:?}");
    }
}
