//! Resilient consensus: the W-MSR filter, a mean that at most F Byzantine neighbors cannot pull out of the
//! honest range. (LeBlanc, Zhang, Koutsoukos, Sundaram, IEEE JSAC 2013)
//!
//! Of the received values, the F largest above the own value and the F smallest below it are discarded. If at
//! most F in-neighbors are Byzantine, the rest lies between values of honest robots. Values of trusted nodes
//! are never discarded. (Abbas, Laszka, Koutsoukos, IEEE TCNS 2018)

use crate::Vec2;
use crate::desired::Target;
use crate::frame::LeaderFrame;
use crate::pose::wrap_angle;

/// A received value and whether its sender is a trusted node.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ReceivedValue<T> {
    /// Received value.
    pub value: T,
    /// `true` if the sender is a trusted node, whose value is never discarded.
    pub is_trusted: bool,
}

/// Returns the mean of the values without the `liars_max` (F) largest untrusted ones above `own` and the
/// `liars_max` smallest untrusted ones below it, or `own` if none remain.
pub fn resilient_mean(
    own: f64,
    received: impl Iterator<Item = ReceivedValue<f64>>,
    liars_max: usize,
) -> f64 {
    let (trusted, mut others): (Vec<ReceivedValue<f64>>, Vec<ReceivedValue<f64>>) =
        received.partition(|received| received.is_trusted);
    others.sort_by(|a, b| a.value.total_cmp(&b.value));
    let below = others.iter().filter(|received| received.value < own).count();
    let above = others.iter().filter(|received| received.value > own).count();
    let kept = below.min(liars_max)..others.len() - above.min(liars_max);
    let kept = trusted.iter().chain(&others[kept]);
    let (count, sum) =
        kept.fold((0u32, 0.0), |(count, sum), received| (count + 1, sum + received.value));
    if count == 0 { own } else { sum / f64::from(count) }
}

/// Returns the desired position and velocity (alpha*, alpha*') of a robot at `own` by W-MSR on each axis, over
/// the slots alpha_j + C_ji implied by its in-neighbors. The velocity of `own` is the previous desired
/// velocity.
pub fn resilient_target(
    own: Target,
    received: &[ReceivedValue<Target>],
    liars_max: usize,
) -> Target {
    let mean = |component: fn(&Target) -> f64| {
        let received = received.iter().map(|received| ReceivedValue {
            value: component(&received.value),
            is_trusted: received.is_trusted,
        });
        resilient_mean(component(&own), received, liars_max)
    };
    Target {
        position: Vec2::new(mean(|t| t.position.x), mean(|t| t.position.y)),
        velocity: Vec2::new(mean(|t| t.velocity.x), mean(|t| t.velocity.y)),
    }
}

/// Returns the leader's frame by W-MSR on each of its numbers, over the frames relayed by the in-neighbors for
/// one instant. If the robot has no frame of its `own` yet, it starts from the relayed frame with the smallest
/// distance to its `liars_max`-th nearest other frame. This needs at least 2 `liars_max` + 1 frames, and `None`
/// is returned with fewer.
pub fn resilient_frame(
    own: Option<LeaderFrame>,
    relayed: &[LeaderFrame],
    liars_max: usize,
) -> Option<LeaderFrame> {
    let own = match own {
        Some(own) => own,
        None if relayed.len() > 2 * liars_max => select_most_supported_frame(relayed, liars_max)?,
        None => return None,
    };
    let mean = |component: &dyn Fn(&LeaderFrame) -> f64| {
        let received = relayed
            .iter()
            .map(|frame| ReceivedValue { value: component(frame), is_trusted: false });
        resilient_mean(component(&own), received, liars_max)
    };
    Some(LeaderFrame {
        heading_rad: own.heading_rad
            + mean(&|frame| wrap_angle(frame.heading_rad - own.heading_rad)),
        turn_rate_rad_s: mean(&|frame| frame.turn_rate_rad_s),
        turn_acceleration_rad_s2: mean(&|frame| frame.turn_acceleration_rad_s2),
        scale: mean(&|frame| frame.scale),
        scale_rate_per_s: mean(&|frame| frame.scale_rate_per_s),
    })
}

/// Returns the frame with the smallest distance to its `others`-th nearest other frame. At least one frame of
/// this group is from an honest robot.
fn select_most_supported_frame(frames: &[LeaderFrame], others: usize) -> Option<LeaderFrame> {
    let distance = |a: &LeaderFrame, b: &LeaderFrame| {
        wrap_angle(a.heading_rad - b.heading_rad).abs()
            + (a.turn_rate_rad_s - b.turn_rate_rad_s).abs()
            + (a.turn_acceleration_rad_s2 - b.turn_acceleration_rad_s2).abs()
            + (a.scale - b.scale).abs()
            + (a.scale_rate_per_s - b.scale_rate_per_s).abs()
    };
    let spread = |frame: &LeaderFrame| {
        let mut all: Vec<f64> = frames.iter().map(|other| distance(frame, other)).collect();
        all.sort_by(f64::total_cmp);
        // The first distance is that to itself.
        all[others.min(all.len() - 1)]
    };
    frames.iter().copied().min_by(|a, b| spread(a).total_cmp(&spread(b)))
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn mean(own: f64, received: &[f64], liars_max: usize) -> f64 {
        let received = received.iter().map(|&value| ReceivedValue { value, is_trusted: false });
        resilient_mean(own, received, liars_max)
    }

    #[test]
    fn w_msr_discards_only_the_extremes_on_either_side() {
        assert_eq!(mean(0.0, &[9.0, 1.0, 3.0], 1), 2.0, "all above: the farthest");
        assert_eq!(mean(0.0, &[9.0, 1.0, -3.0], 1), 1.0, "one on each side");
        assert_eq!(mean(2.0, &[9.0, -1.0], 1), 2.0, "no value is left");
        assert_eq!(mean(2.0, &[2.0, 2.0, 7.0], 1), 2.0, "an equal value is never discarded");
        assert_eq!(mean(0.0, &[1.0, 2.0, 3.0], 0), 2.0);
        let leader = [
            ReceivedValue { value: 8.0, is_trusted: true },
            ReceivedValue { value: 2.0, is_trusted: false },
        ];
        assert_eq!(resilient_mean(0.0, leader.into_iter(), 1), 8.0);
    }

    fn frame(heading_rad: f64) -> LeaderFrame {
        LeaderFrame { heading_rad, ..LeaderFrame::IDENTITY }
    }

    #[test]
    fn frame_is_agreed_across_angle_wrap_despite_one_liar() {
        let (near, far) = (std::f64::consts::PI - 0.01, 0.02 - std::f64::consts::PI);
        let relayed = [frame(0.0), frame(near), frame(far)];
        let agreed = resilient_frame(None, &relayed, 1).unwrap();
        let error_rad = wrap_angle(agreed.heading_rad - near);
        assert!((0.0..=0.03 + 1e-12).contains(&error_rad), "{error_rad}");
        assert_eq!(
            resilient_frame(None, &relayed[..2], 1),
            None,
            "two frames cannot reveal the liar"
        );
        let own = Some(frame(near));
        assert_eq!(resilient_frame(own, &relayed[..2], 1), own);
    }

    proptest! {
        /// The mean stays within the hull of the honest values and the own value, for any false values in any
        /// order.
        #[test]
        fn f_byzantine_values_do_not_move_the_mean_out_of_the_hull(
            own in -9.0..9.0f64,
            honest in proptest::collection::vec(-9.0..9.0f64, 0..6),
            false_values in proptest::collection::vec(prop_oneof![-9.0..9.0f64, Just(1e6), Just(-1e6)], 0..4),
            at in any::<proptest::sample::Index>(),
        ) {
            let mut received = honest.clone();
            false_values.iter().for_each(|&false_value| received.insert(at.index(received.len() + 1), false_value));
            let found = mean(own, &received, false_values.len());
            let minimum = honest.iter().fold(own, |a, &b| a.min(b));
            let maximum = honest.iter().fold(own, |a, &b| a.max(b));
            prop_assert!((minimum - 1e-9..=maximum + 1e-9).contains(&found), "{found}");
        }
    }
}
