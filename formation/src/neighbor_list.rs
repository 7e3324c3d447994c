//! Verlet neighbor list: all pairs within a cutoff radius, kept from one update to the next.
//!
//! The list includes a margin (skin) and is rebuilt only when the displacement of a point may have used up the
//! margin. Pairs are visited in list order, so a computation over the list gives bit for bit the same result as
//! one over all pairs, at a cost that grows with the number of listed pairs.

use crate::closest::{self, ClosestPair};
use crate::{RELATIVE_ROUNDING_ERROR_MAX, Vec2};

/// Minimum margin for each of the two points of a pair, as a fraction of the cutoff radius.
const MARGIN_FRACTION_MIN: f64 = 0.125;
/// Target number of updates between two rebuilds of the neighbor list. The margin is sized for it, up to the
/// cutoff radius.
const UPDATES_PER_REBUILD: f64 = 16.0;
/// Cutoff radius of [`ClosestPairSearch`], as a multiple of the smallest distance when it is chosen.
const SEARCH_CUTOFF_FACTOR: f64 = 2.0;
/// Minimum of this cutoff radius, m: points may coincide.
const SEARCH_CUTOFF_MIN_M: f64 = 1e-3;

/// Neighbor list of all pairs of points within a cutoff radius.
#[derive(Debug, Clone)]
pub struct NeighborList {
    cutoff_m: f64,
    /// Positions of all points at the last rebuild, m.
    reference_points: Vec<Vec2>,
    /// Squared displacement since the last rebuild up to which the list stays valid, m^2.
    displacement_squared_max: f64,
    /// Number of updates since the last rebuild, without the rebuild itself.
    updates_since_rebuild: u64,
    /// For each point, the indices of its listed neighbors, ascending.
    neighbors: Vec<Vec<usize>>,
    /// Buffer of the indices of all points, ascending by x.
    indices_by_x: Vec<usize>,
}

impl NeighborList {
    /// Creates an empty list with the cutoff radius `cutoff_m`, m.
    pub fn new(cutoff_m: f64) -> NeighborList {
        NeighborList {
            cutoff_m,
            reference_points: Vec::new(),
            displacement_squared_max: 0.0,
            updates_since_rebuild: 0,
            neighbors: Vec::new(),
            indices_by_x: Vec::new(),
        }
    }

    /// Updates the list for the current positions of all points. Afterwards it holds every pair within the
    /// cutoff radius, and some pairs beyond it. A point with a coordinate that is NaN is listed as a neighbor
    /// of every other point.
    pub fn update(&mut self, points: &[Vec2]) {
        let displacement_squared = |(now, then): (&Vec2, &Vec2)| (now - then).norm_squared();
        let pairs = || points.iter().zip(&self.reference_points);
        let same_points = points.len() == self.reference_points.len();
        // A comparison with NaN is false, so a NaN coordinate forces a rebuild.
        if same_points
            && pairs().all(|pair| displacement_squared(pair) <= self.displacement_squared_max)
        {
            self.updates_since_rebuild += 1;
            return;
        }
        let step_m = match same_points {
            true => {
                pairs().map(displacement_squared).fold(0.0, f64::max).sqrt()
                    / (self.updates_since_rebuild + 1) as f64
            }
            false => 0.0,
        };
        let margin_m = (MARGIN_FRACTION_MIN * self.cutoff_m)
            .max((UPDATES_PER_REBUILD * step_m).min(self.cutoff_m));
        // The permitted displacement is reduced by the rounding error, so the list radius need not be enlarged.
        let list_radius_m = self.cutoff_m + 2.0 * margin_m;
        self.displacement_squared_max = margin_m * margin_m * (1.0 - RELATIVE_ROUNDING_ERROR_MAX);
        self.updates_since_rebuild = 0;
        self.reference_points.clear();
        self.reference_points.extend_from_slice(points);
        self.neighbors.iter_mut().for_each(Vec::clear);
        self.neighbors.resize(points.len(), Vec::new());
        self.list_pairs(points, list_radius_m);
    }

    /// Lists all pairs within `list_radius_m`. Visits the points by x, so that pairs far apart along x are skipped.
    fn list_pairs(&mut self, points: &[Vec2], list_radius_m: f64) {
        self.indices_by_x.clear();
        self.indices_by_x.extend(0..points.len());
        // With a coordinate that is not finite, all pairs are compared.
        let is_ordered = points.iter().all(|point| point.x.is_finite() && point.y.is_finite());
        if is_ordered {
            self.indices_by_x.sort_unstable_by(|&i, &j| points[i].x.total_cmp(&points[j].x));
        }
        for (position_index, &i) in self.indices_by_x.iter().enumerate() {
            for &j in &self.indices_by_x[position_index + 1..] {
                let difference = points[i] - points[j];
                if is_ordered && difference.x * difference.x > list_radius_m * list_radius_m {
                    break;
                }
                let is_far = difference.norm_squared() > list_radius_m * list_radius_m;
                if !is_far {
                    self.neighbors[i].push(j);
                    self.neighbors[j].push(i);
                }
            }
        }
        self.neighbors.iter_mut().for_each(|neighbors| neighbors.sort_unstable());
    }

    /// Returns the indices of the listed neighbors of `point`, ascending.
    pub fn neighbors_of(&self, point: usize) -> impl Iterator<Item = usize> {
        self.neighbors[point].iter().copied()
    }

    /// Returns the listed pair with the smallest distance, which is the closest of all pairs if any pair is
    /// within the cutoff radius. Of pairs at equal distance the first in list order is returned. `points` must
    /// be those of the last update. Returns `None` if no pair is listed.
    pub fn closest_pair(&self, points: &[Vec2]) -> Option<ClosestPair> {
        let mut closest: Option<([usize; 2], f64)> = None;
        for (i, (a, neighbors)) in points.iter().zip(&self.neighbors).enumerate() {
            let later = neighbors.partition_point(|&j| j < i);
            for &j in &neighbors[later..] {
                let square = (a - points[j]).norm_squared();
                if closest.is_none_or(|(_, smallest)| square < smallest || smallest.is_nan()) {
                    closest = Some(([i, j], square));
                }
            }
        }
        closest.map(|(pair, square)| ClosestPair { pair, distance_m: square.sqrt() })
    }
}

/// Repeated search for the closest pair of moving points, which compares only points that are near each other.
#[derive(Debug, Clone)]
pub struct ClosestPairSearch {
    /// All pairs within the cutoff radius.
    list: NeighborList,
    cutoff_m: f64,
}

impl Default for ClosestPairSearch {
    fn default() -> ClosestPairSearch {
        ClosestPairSearch::with_cutoff(0.0)
    }
}

impl ClosestPairSearch {
    fn with_cutoff(cutoff_m: f64) -> ClosestPairSearch {
        ClosestPairSearch { list: NeighborList::new(cutoff_m), cutoff_m }
    }

    /// Returns the same pair as [`closest::closest_pair`].
    pub fn closest_pair(&mut self, points: &[Vec2]) -> Option<ClosestPair> {
        self.list.update(points);
        let listed = self.list.closest_pair(points);
        let closest = match listed.filter(|pair| pair.distance_m < self.cutoff_m) {
            Some(closest) => closest,
            None => closest::closest_pair(points)?,
        };
        let cutoff_m = (SEARCH_CUTOFF_FACTOR * closest.distance_m).max(SEARCH_CUTOFF_MIN_M);
        // Otherwise no pair is listed, or far too many are.
        if closest.distance_m >= self.cutoff_m || SEARCH_CUTOFF_FACTOR * cutoff_m < self.cutoff_m {
            *self = ClosestPairSearch::with_cutoff(cutoff_m);
        }
        Some(closest)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::closest::closest_pair;
    use crate::random::SplitMix64;
    use proptest::prelude::*;

    /// Generates a sequence of position snapshots: scattered, coincident or on a lattice. All points move
    /// slowly, one jumps, and one may have a non-finite coordinate for a few instants.
    fn motion() -> impl Strategy<Value = Vec<Vec<Vec2>>> {
        let step = prop_oneof![Just(0.0), Just(1e-17), 1e-4..0.2f64];
        let lattice = prop_oneof![Just(0.0), Just(0.5)];
        let broken =
            proptest::option::of(prop::sample::select(vec![f64::NAN, f64::INFINITY, 1e200]));
        (0..40_usize, step, lattice, any::<u64>(), broken).prop_map(
            |(count, step_m, lattice_m, seed, broken)| {
                let mut rng = SplitMix64::new(seed);
                let mut draw = |side: f64| side * (rng.draw_unit() - 0.5);
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
        fn repeated_search_finds_the_closest_of_all_pairs(motion in motion()) {
            let mut search = ClosestPairSearch::default();
            for points in motion {
                // Distances of NaN are equal.
                let key = |pair: ClosestPair| (pair.pair, pair.distance_m.to_bits());
                let found = search.closest_pair(&points).map(key);
                prop_assert_eq!(found, closest_pair(&points).map(key));
            }
        }

        #[test]
        fn pairs_within_cutoff_are_listed_at_every_instant(
            motion in motion(), cutoff_m in prop_oneof![Just(0.0), 0.1..2.0f64, Just(f64::INFINITY)],
        ) {
            let mut list = NeighborList::new(cutoff_m);
            for points in motion {
                list.update(&points);
                for (i, a) in points.iter().enumerate() {
                    let listed: Vec<usize> = list.neighbors_of(i).collect();
                    prop_assert!(listed.windows(2).all(|two| two[0] < two[1]));
                    for (j, b) in points.iter().enumerate() {
                        let is_within = j != i && (a - b).norm() <= cutoff_m;
                        prop_assert!(!is_within || listed.binary_search(&j).is_ok());
                    }
                    // At a rebuild the margin of each point is at most the cutoff radius.
                    let distances = listed.iter().map(|&j| (list.reference_points[i] - list.reference_points[j]).norm());
                    prop_assert!(distances.fold(0.0, f64::max) <= 3.0 * cutoff_m * (1.0 + 1e-6));
                }
                // Equal bit for bit to the search over all pairs, if the closest pair is within the cutoff
                // radius.
                let all = closest_pair(&points).filter(|pair| pair.distance_m < cutoff_m);
                let listed = list.closest_pair(&points).filter(|pair| pair.distance_m < cutoff_m);
                prop_assert_eq!(listed, all);
            }
        }
    }

    #[test]
    fn list_is_rebuilt_before_rounding_can_hide_a_pair() {
        let points = |distance_m: f64| [Vec2::zeros(), Vec2::new(distance_m, 0.0)];
        let mut list = NeighborList::new(1.0);
        // Just beyond the list radius, then each point moves by its margin plus a few parts in 1e10.
        list.update(&points(1.25 + 1e-12));
        assert_eq!(list.neighbors_of(0).count(), 0);
        let step = Vec2::new(0.125 * (1.0 + 3e-10), 0.0);
        let [a, b] = points(1.25 + 1e-12);
        let now = [a + step, b - step];
        assert!((now[0] - now[1]).norm() < 1.0);
        list.update(&now);
        assert_eq!(list.neighbors_of(0).count(), 1);
    }

    #[test]
    fn list_lasts_16_updates_or_as_long_as_the_margin_allows() {
        let lattice: Vec<Vec2> =
            (0..100).map(|i| Vec2::new((i % 10) as f64, (i / 10) as f64)).collect();
        // Number of rebuilds if all points move by `step_m` per instant.
        let rebuild_count = |step_m: f64, instants: u32| {
            let mut list = NeighborList::new(0.5);
            let rebuilds = (0..instants).map(|instant| {
                let displacement = Vec2::new(step_m * f64::from(instant), 0.0);
                list.update(&lattice.iter().map(|point| point + displacement).collect::<Vec<_>>());
                u32::from(list.updates_since_rebuild == 0)
            });
            rebuilds.sum::<u32>()
        };
        assert_eq!(rebuild_count(0.0, 100), 1, "no point moves");
        // The first margin is an eighth of the cutoff radius, and no margin exceeds the cutoff radius.
        for (step_m, first, updates_per_rebuild) in
            [(0.02, 4, 16), (0.01, 7, 16), (0.1, 1, 5), (0.001, 63, 63)]
        {
            let expected = 2 + (100 - first) / updates_per_rebuild;
            assert_eq!(rebuild_count(step_m, 101), expected, "{step_m}");
        }
    }
}
