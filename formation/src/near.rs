//! Who is near whom, kept from one instant to the next.
//!
//! All pairs within a reach are listed with a margin (Verlet's list); the list is made anew only when
//! somebody has moved so far that the margin may be used up. Whoever walks the list sees pairs in list
//! order, and computes with them what he would with all pairs: the result is the same, bit by bit, at a
//! cost that grows with the number of near pairs.

use crate::closest::ClosestPair;
use crate::{ROUNDING, Vec2};

/// The margin for each of two points, as a share of the reach.
const MARGIN: f64 = 0.125;
/// So many instants are to pass from list to list, if a margin as large as the reach allows it.
const INSTANTS: f64 = 16.0;

/// All pairs of points within a reach.
#[derive(Debug, Clone)]
pub struct NearPairs {
    reach_m: f64,
    /// Where everybody was when the list was made.
    then: Vec<Vec2>,
    /// The list holds until somebody is farther from there than this, m^2.
    moved_square_max: f64,
    /// How often it was found to hold.
    held: u64,
    /// For each point the places of all near it, ascending.
    neighbors: Vec<Vec<usize>>,
}

impl NearPairs {
    /// Of no points yet, within `reach_m`, m.
    pub fn new(reach_m: f64) -> NearPairs {
        NearPairs {
            reach_m,
            then: Vec::new(),
            moved_square_max: 0.0,
            held: 0,
            neighbors: Vec::new(),
        }
    }

    /// Takes in where the points are now. Afterwards every pair within the reach is listed, and some
    /// others; so is everybody with whoever is nowhere (not a number).
    pub fn update(&mut self, points: &[Vec2]) {
        let moved = |(now, then): (&Vec2, &Vec2)| (now - then).norm_squared();
        let pairs = || points.iter().zip(&self.then);
        let same_points = points.len() == self.then.len();
        // NaN is no place to hold on to.
        if same_points && pairs().all(|pair| moved(pair) <= self.moved_square_max) {
            self.held += 1;
            return;
        }
        let step_m = match same_points {
            true => pairs().map(moved).fold(0.0, f64::max).sqrt() / (self.held + 1) as f64,
            false => 0.0,
        };
        let margin_m = (MARGIN * self.reach_m).max((INSTANTS * step_m).min(self.reach_m));
        // Rounding: what may move is taken a little shorter, so that this need not be longer.
        let near_m = self.reach_m + 2.0 * margin_m;
        self.moved_square_max = margin_m * margin_m * (1.0 - ROUNDING);
        self.held = 0;
        self.then.clear();
        self.then.extend_from_slice(points);
        self.neighbors.iter_mut().for_each(Vec::clear);
        self.neighbors.resize(points.len(), Vec::new());
        for i in 0..points.len() {
            for j in i + 1..points.len() {
                let far = (points[i] - points[j]).norm_squared() > near_m * near_m;
                if !far {
                    self.neighbors[i].push(j);
                    self.neighbors[j].push(i);
                }
            }
        }
    }

    /// Places of those near `point`, ascending.
    pub fn neighbors_of(&self, point: usize) -> impl Iterator<Item = usize> {
        self.neighbors[point].iter().copied()
    }

    /// The closest two of the pairs listed: of all pairs, where they are within the reach. Of
    /// equals, the first in list order. `points` are those of the last update.
    pub fn closest(&self, points: &[Vec2]) -> Option<ClosestPair> {
        let mut closest: Option<([usize; 2], f64)> = None;
        for (i, (a, neighbors)) in points.iter().zip(&self.neighbors).enumerate() {
            let later = neighbors.partition_point(|&j| j < i);
            for &j in &neighbors[later..] {
                let square = (a - points[j]).norm_squared();
                if closest.is_none_or(|(_, least)| square < least) {
                    closest = Some(([i, j], square));
                }
            }
        }
        closest.map(|(pair, square)| ClosestPair { pair, distance_m: square.sqrt() })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::closest::closest_pair;
    use crate::random::SplitMix64;
    use proptest::prelude::*;

    /// A motion: where everybody is at each of some instants, scattered, upon each other or on a lattice.
    /// All move slowly, one jumps, and one may be nowhere at some instants.
    fn motion() -> impl Strategy<Value = Vec<Vec<Vec2>>> {
        let step = prop_oneof![Just(0.0), Just(1e-17), 1e-4..0.2f64];
        let lattice = prop_oneof![Just(0.0), Just(0.5)];
        let broken =
            proptest::option::of(prop::sample::select(vec![f64::NAN, f64::INFINITY, 1e200]));
        (0..40_usize, step, lattice, any::<u64>(), broken).prop_map(
            |(count, step_m, lattice_m, seed, broken)| {
                let mut dice = SplitMix64::new(seed);
                let mut draw = |side: f64| side * (dice.unit() - 0.5);
                let mut points: Vec<Vec2> = (0..count)
                    .map(|_| Vec2::new(draw(8.0), draw(8.0)))
                    .map(|p| {
                        if lattice_m > 0.0 {
                            (p / lattice_m).map(f64::round) * lattice_m
                        } else {
                            p
                        }
                    })
                    .collect();
                let instants = (0..30).map(|instant| {
                    for point in &mut points {
                        *point += Vec2::new(draw(step_m), draw(step_m));
                    }
                    if let (12, Some(last)) = (instant, points.last_mut()) {
                        last.x += draw(6.0);
                    }
                    let mut now = points.clone();
                    if let (Some(broken), 20..23, Some(first)) = (broken, instant, now.first_mut())
                    {
                        first.y = broken;
                    }
                    now
                });
                instants.collect()
            },
        )
    }

    proptest! {
        #[test]
        fn whoever_is_within_reach_is_listed_at_every_instant_and_few_others(
            motion in motion(), reach_m in prop_oneof![Just(0.0), 0.1..2.0f64, Just(f64::INFINITY)],
        ) {
            let mut near = NearPairs::new(reach_m);
            for points in motion {
                near.update(&points);
                for (i, a) in points.iter().enumerate() {
                    let listed: Vec<usize> = near.neighbors_of(i).collect();
                    prop_assert!(listed.windows(2).all(|two| two[0] < two[1]));
                    for (j, b) in points.iter().enumerate() {
                        let within = j != i && (a - b).norm() <= reach_m;
                        prop_assert!(!within || listed.binary_search(&j).is_ok());
                    }
                    // The margin is no more than the reach, on either side, when the list is made.
                    let far = listed.iter().map(|&j| (near.then[i] - near.then[j]).norm());
                    prop_assert!(far.fold(0.0, f64::max) <= 3.0 * reach_m * (1.0 + 1e-6));
                }
                // Of all pairs, bit by bit, where the closest is within reach.
                let all = closest_pair(&points).filter(|pair| pair.distance_m < reach_m);
                let listed = near.closest(&points).filter(|pair| pair.distance_m < reach_m);
                prop_assert_eq!(listed, all);
            }
        }
    }

    #[test]
    fn a_list_is_made_anew_before_rounding_can_hide_who_came_within_reach() {
        let points = |apart_m: f64| [Vec2::zeros(), Vec2::new(apart_m, 0.0)];
        let mut near = NearPairs::new(1.0);
        // Just too far apart for the list, then each nearer by its margin and a billionth of it.
        near.update(&points(1.25 + 1e-12));
        assert_eq!(near.neighbors_of(0).count(), 0);
        let step = Vec2::new(0.125 * (1.0 + 3e-10), 0.0);
        let [a, b] = points(1.25 + 1e-12);
        let now = [a + step, b - step];
        assert!((now[0] - now[1]).norm() < 1.0);
        near.update(&now);
        assert_eq!(near.neighbors_of(0).count(), 1);
    }

    #[test]
    fn a_list_lasts_16_instants_or_for_as_long_as_a_margin_of_the_reach_allows() {
        let lattice: Vec<Vec2> =
            (0..100).map(|i| Vec2::new((i % 10) as f64, (i / 10) as f64)).collect();
        // How many lists are made if all move by so much from one instant to the next.
        let lists_made = |step_m: f64, instants: u32| {
            let mut near = NearPairs::new(0.5);
            let made = (0..instants).map(|instant| {
                let way = Vec2::new(step_m * f64::from(instant), 0.0);
                near.update(&lattice.iter().map(|place| place + way).collect::<Vec<_>>());
                u32::from(near.held == 0)
            });
            made.sum::<u32>()
        };
        assert_eq!(lists_made(0.0, 100), 1, "nobody moves");
        // The first has a margin of an eighth of the reach, none has more than the reach.
        for (step_m, first, lasts) in [(0.02, 4, 16), (0.01, 7, 16), (0.1, 1, 5), (0.001, 63, 63)] {
            let expected = 2 + (100 - first) / lasts;
            assert_eq!(lists_made(step_m, 101), expected, "{step_m}");
        }
    }
}
