//! The pair of points nearest to each other: once, or at every instant of a flight.

use crate::Vec2;
use crate::near::NearPairs;

/// Below so many points all pairs are looked at. A guess, not yet measured.
const LIST_MIN: usize = 8;
/// Pairs are listed as far as this times the closest distance, so that it may grow for a while.
const REACH: f64 = 1.25;
/// A list that reaches as far as this times the closest distance is too long.
const REACH_MAX: f64 = 2.5;
/// Rounding moves no distance by so large a share.
const ROUNDING: f64 = 1e-9;

/// Two points, by their places in the list, and how far apart they are.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ClosestPair {
    /// Places in the list, the smaller one first.
    pub pair: [usize; 2],
    /// Distance, m.
    pub distance_m: f64,
}

/// The closest two of `points`; `None` for fewer than two. Of equals, the first in list order.
pub fn closest_pair(points: &[Vec2]) -> Option<ClosestPair> {
    let mut closest: Option<([usize; 2], f64)> = None;
    for (i, a) in points.iter().enumerate() {
        for (j, b) in points.iter().enumerate().skip(i + 1) {
            let square = (a - b).norm_squared();
            if closest.is_none_or(|(_, least)| square < least) {
                closest = Some(([i, j], square));
            }
        }
    }
    closest.map(|(pair, square)| ClosestPair { pair, distance_m: square.sqrt() })
}

/// [`closest_pair`] at every instant of a flight, at a cost that hardly grows with the pairs.
#[derive(Debug, Clone)]
pub struct ClosestInFlight {
    near: NearPairs,
}

impl Default for ClosestInFlight {
    fn default() -> Self {
        ClosestInFlight { near: NearPairs::new(0.0) }
    }
}

impl ClosestInFlight {
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
    use crate::near::tests::flight;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn the_closest_pair_of_a_flight_is_at_every_instant_that_of_all_pairs(flight in flight()) {
            let mut closest = ClosestInFlight::default();
            for points in flight {
                let [now, expected] = [closest.now(&points), closest_pair(&points)];
                prop_assert_eq!(now.map(|c| c.pair), expected.map(|c| c.pair));
                prop_assert_eq!(
                    now.map(|c| c.distance_m.to_bits()), expected.map(|c| c.distance_m.to_bits())
                );
            }
        }
    }

    #[test]
    fn the_closest_pair_is_found_and_one_point_alone_has_none() {
        let points = [Vec2::new(0.0, 0.0), Vec2::new(5.0, 0.0), Vec2::new(5.0, 0.5)];
        let closest = closest_pair(&points).unwrap();
        assert_eq!(closest, ClosestPair { pair: [1, 2], distance_m: 0.5 });
        assert_eq!(closest_pair(&points[..1]), None);
    }
}
