//! Means that a few liars cannot move: W-MSR. (LeBlanc, Zhang, Koutsoukos, Sundaram, IEEE JSAC 2013)
//!
//! Of what others say of a number, the F farthest above one's own and the F farthest below are left out. What
//! remains lies between numbers that those who do not lie have, if at most F of those heard lie. Whoever is
//! trusted is never left out. (Abbas, Laszka, Koutsoukos, IEEE TCNS 2018)

use crate::Vec2;
use crate::desired::Target;
use crate::frame::LeaderFrame;
use crate::pose::wrap_angle;

/// What somebody says, and whether it is trusted.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Said<T> {
    /// What.
    pub value: T,
    /// Never left out.
    pub trusted: bool,
}

/// The mean of numbers without the `liars_max` farthest of those that are not trusted on either side of `own`;
/// `own` if that leaves none.
pub fn resilient_mean(own: f64, said: impl Iterator<Item = Said<f64>>, liars_max: usize) -> f64 {
    let (trusted, mut others): (Vec<Said<f64>>, Vec<Said<f64>>) = said.partition(|one| one.trusted);
    others.sort_by(|a, b| a.value.total_cmp(&b.value));
    let below = others.iter().filter(|one| one.value < own).count();
    let above = others.iter().filter(|one| one.value > own).count();
    let kept = below.min(liars_max)..others.len() - above.min(liars_max);
    let kept = trusted.iter().chain(&others[kept]);
    let (count, sum) = kept.fold((0u32, 0.0), |(count, sum), one| (count + 1, sum + one.value));
    if count == 0 { own } else { sum / f64::from(count) }
}

/// alpha* and alpha*' of a robot at `own` by the places that those heard ask for, alpha_j + C_ji: on each axis
/// W-MSR. `own` has the velocity that was desired before.
pub fn resilient_target(own: Target, said: &[Said<Target>], liars_max: usize) -> Target {
    let mean = |of: fn(&Target) -> f64| {
        let said = said.iter().map(|one| Said { value: of(&one.value), trusted: one.trusted });
        resilient_mean(of(&own), said, liars_max)
    };
    Target {
        position: Vec2::new(mean(|t| t.position.x), mean(|t| t.position.y)),
        velocity: Vec2::new(mean(|t| t.velocity.x), mean(|t| t.velocity.y)),
    }
}

/// The leader's frame by those that are passed on, all of one instant: of each of its numbers W-MSR. Without one
/// of its `own` to begin from, a robot begins with that which `liars_max` others are nearest to, and needs
/// 2 `liars_max` + 1 of them.
pub fn resilient_frame(
    own: Option<LeaderFrame>,
    passed_on: &[LeaderFrame],
    liars_max: usize,
) -> Option<LeaderFrame> {
    let own = match own {
        Some(own) => own,
        None if passed_on.len() > 2 * liars_max => most_agreed(passed_on, liars_max)?,
        None => return None,
    };
    let mean = |of: &dyn Fn(&LeaderFrame) -> f64| {
        let said = passed_on.iter().map(|frame| Said { value: of(frame), trusted: false });
        resilient_mean(of(&own), said, liars_max)
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

/// The frame whose `others` nearest are nearest to it: one of them at least is no lie.
fn most_agreed(frames: &[LeaderFrame], others: usize) -> Option<LeaderFrame> {
    let apart = |a: &LeaderFrame, b: &LeaderFrame| {
        wrap_angle(a.heading_rad - b.heading_rad).abs()
            + (a.turn_rate_rad_s - b.turn_rate_rad_s).abs()
            + (a.turn_acceleration_rad_s2 - b.turn_acceleration_rad_s2).abs()
            + (a.scale - b.scale).abs()
            + (a.scale_rate_per_s - b.scale_rate_per_s).abs()
    };
    let spread = |frame: &LeaderFrame| {
        let mut all: Vec<f64> = frames.iter().map(|other| apart(frame, other)).collect();
        all.sort_by(f64::total_cmp);
        // The first is its distance to itself.
        all[others.min(all.len() - 1)]
    };
    frames.iter().copied().min_by(|a, b| spread(a).total_cmp(&spread(b)))
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn mean(own: f64, said: &[f64], liars_max: usize) -> f64 {
        let said = said.iter().map(|&value| Said { value, trusted: false });
        resilient_mean(own, said, liars_max)
    }

    #[test]
    fn the_farthest_on_either_side_are_left_out_and_no_others() {
        assert_eq!(mean(0.0, &[9.0, 1.0, 3.0], 1), 2.0, "all above: the farthest");
        assert_eq!(mean(0.0, &[9.0, 1.0, -3.0], 1), 1.0, "one on each side");
        assert_eq!(mean(2.0, &[9.0, -1.0], 1), 2.0, "nobody is left");
        assert_eq!(mean(2.0, &[2.0, 2.0, 7.0], 1), 2.0, "who agrees is never left out");
        assert_eq!(mean(0.0, &[1.0, 2.0, 3.0], 0), 2.0);
        let leader = [Said { value: 8.0, trusted: true }, Said { value: 2.0, trusted: false }];
        assert_eq!(resilient_mean(0.0, leader.into_iter(), 1), 8.0);
    }

    fn frame(heading_rad: f64) -> LeaderFrame {
        LeaderFrame { heading_rad, ..LeaderFrame::STILL }
    }

    #[test]
    fn a_frame_is_agreed_on_across_the_jump_of_the_angle_and_without_one_liar() {
        let (near, far) = (std::f64::consts::PI - 0.01, 0.02 - std::f64::consts::PI);
        let passed_on = [frame(0.0), frame(near), frame(far)];
        let agreed = resilient_frame(None, &passed_on, 1).unwrap();
        let off_rad = wrap_angle(agreed.heading_rad - near);
        assert!((0.0..=0.03 + 1e-12).contains(&off_rad), "{off_rad}");
        assert_eq!(resilient_frame(None, &passed_on[..2], 1), None, "who lies?");
        let own = Some(frame(near));
        assert_eq!(resilient_frame(own, &passed_on[..2], 1), own);
    }

    proptest! {
        /// Whatever liars say, in whatever order: the mean lies between what the others say and one's own.
        #[test]
        fn f_liars_among_those_heard_move_it_out_of_no_hull(
            own in -9.0..9.0f64,
            honest in proptest::collection::vec(-9.0..9.0f64, 0..6),
            lies in proptest::collection::vec(prop_oneof![-9.0..9.0f64, Just(1e6), Just(-1e6)], 0..4),
            at in any::<proptest::sample::Index>(),
        ) {
            let mut said = honest.clone();
            lies.iter().for_each(|&lie| said.insert(at.index(said.len() + 1), lie));
            let found = mean(own, &said, lies.len());
            let least = honest.iter().fold(own, |a, &b| a.min(b));
            let most = honest.iter().fold(own, |a, &b| a.max(b));
            prop_assert!((least - 1e-9..=most + 1e-9).contains(&found), "{found}");
        }
    }
}
