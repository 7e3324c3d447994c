//! The pair of points nearest to each other, at every instant of a run.

use crate::closest::{ClosestPair, closest_pair};
use crate::near::NearPairs;
use crate::{ROUNDING, Vec2};

/// Below so many points all pairs are looked at. A guess, not yet measured.
const LIST_MIN: usize = 8;
/// Pairs are listed as far as this times the closest distance, so that it may grow for a while.
const REACH: f64 = 1.25;
/// A list that reaches as far as this times the closest distance is too long.
const REACH_MAX: f64 = 2.5;

/// [`closest_pair`] at every instant of a run, at a cost that hardly grows with the pairs.
#[derive(Debug, Clone)]
pub struct ClosestOverTime {
    near: NearPairs,
}

impl Default for ClosestOverTime {
    fn default() -> Self {
        ClosestOverTime { near: NearPairs::new(0.0) }
    }
}

impl ClosestOverTime {
    /// What [`closest_pair`] says of `points`, bit by bit.
    pub fn now(&mut self, points: &[Vec2]) -> Option<ClosestPair> {
        if points.len() < LIST_MIN {
            return closest_pair(points);
        }
        self.near.update(points);
        let listed = self.near.closest(points);
        let reach_m = self.near.reach_m();
        if let Some(ClosestPair { distance_m, .. }) = listed
            && distance_m <= reach_m * (1.0 - ROUNDING)
        {
            if distance_m * REACH_MAX < reach_m {
                self.near.set_reach(REACH * distance_m);
            }
            return listed;
        }
        // Whatever pair is listed, the closest is no farther.
        let bound = listed.filter(|pair| pair.distance_m.is_finite());
        let bound = bound.or_else(|| closest_pair(points));
        self.near.set_reach(bound.map_or(0.0, |pair| REACH * pair.distance_m));
        self.near.update(points);
        self.near.closest(points)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::near::tests::motion;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn the_closest_pair_of_moving_points_is_at_every_instant_that_of_all_pairs(motion in motion()) {
            let mut closest = ClosestOverTime::default();
            for points in motion {
                let [now, expected] = [closest.now(&points), closest_pair(&points)];
                prop_assert_eq!(now.map(|c| c.pair), expected.map(|c| c.pair));
                prop_assert_eq!(
                    now.map(|c| c.distance_m.to_bits()), expected.map(|c| c.distance_m.to_bits())
                );
            }
        }

        /// Or else the list would have to be made at every instant, or hold everybody.
        #[test]
        fn the_list_reaches_as_far_as_the_closest_pair_and_not_much_farther(motion in motion()) {
            let mut closest = ClosestOverTime::default();
            for points in motion.iter().filter(|points| points.len() >= LIST_MIN) {
                let Some(ClosestPair { distance_m, .. }) = closest.now(points) else { continue };
                if distance_m.is_finite() {
                    let reach_m = closest.near.reach_m();
                    prop_assert!(reach_m >= distance_m && reach_m <= REACH_MAX * distance_m);
                }
            }
        }
    }
}
