//! Smallest distances between robots (15): of each pair and of all pairs, and when they occurred.

use formation::neighbor_list::ClosestPairSearch;
use formation::pair_minima::PairMinima;
use formation::{Vec2, ns_to_seconds};
use protocol::message::TruthHeader;

use crate::columns::table;

table! {
    /// Line of `pairs.csv`: smallest distance of a pair of robots. The pairs are in scenario order.
    #[derive(Debug, Clone, PartialEq)]
    pub struct PairDistance in "pairs.csv" {
        /// Name of the first robot.
        pub robot_a: String,
        /// Name of the second robot.
        pub robot_b: String,
        /// Smallest distance between their front points over all ticks, m.
        pub min_distance_m: f64 as Decimal,
        /// Time of the smallest distance, s.
        pub t_s: f64 as Decimal,
    }
}

/// Two robots at their smallest distance.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct ClosestPair {
    /// |alpha_i - alpha_j|, m.
    pub(super) distance_m: f64,
    /// Indices of the two robots, the smaller one first.
    pub(super) pair: [usize; 2],
    /// Run time, ns.
    pub(super) t_ns: u64,
}

/// Smallest distances between robots up to now.
#[derive(Default)]
pub(super) struct Distances {
    robots: usize,
    distance_min_m: f64,
    /// Sizes of the robots (keep), m, if they differ: two robots keep the sum. Otherwise empty.
    sizes_m: Vec<f64>,
    /// Smallest distance of each pair; `None` if only the closest pair is measured.
    minima: Option<PairMinima>,
    search: ClosestPairSearch,
    closest_pair: Option<ClosestPair>,
    /// Nearest pair at the newest ground-truth sample.
    newest_nearest_pair: Option<ClosestPair>,
    /// Smallest distance that the plant reported last.
    plant_closest_pair: Option<ClosestPair>,
    violations: u64,
    plant_violations: u64,
    newest_t_ns: Option<u64>,
}

impl Distances {
    /// Creates the metric before the first sample. A distance below `distance_min_m` is a violation. If `sizes_m` is
    /// not empty, the robots have these sizes, and a distance below the sum of two sizes is a violation.
    pub(super) fn new(robots: usize, distance_min_m: f64, sizes_m: Vec<f64>) -> Distances {
        Distances {
            robots,
            distance_min_m,
            sizes_m,
            minima: Some(PairMinima::new(robots)),
            ..Distances::default()
        }
    }

    /// Measures only the closest pair. Does nothing if the robots have different sizes, because the smallest distance
    /// over their sum then needs all pairs.
    pub(super) fn measure_only_closest_pair(&mut self) {
        if self.sizes_m.is_empty() {
            self.minima = None;
        }
    }

    /// Updates the metric with one sample. Returns the smallest known distance since the previous sample, m. The
    /// plant evaluates the end of every arc from the start of the run on, so that neither shorter arcs nor lost
    /// samples hide anything.
    pub(super) fn add_truth(&mut self, header: &TruthHeader, alphas: &[Vec2]) -> f64 {
        let t_ns = header.t_ns;
        if let Some(minima) = &mut self.minima {
            minima.update(alphas, t_ns);
        }
        let nearest_pair = self.search.closest_pair(alphas).map(|nearest| ClosestPair {
            distance_m: nearest.distance_m,
            pair: nearest.pair,
            t_ns,
        });
        self.newest_nearest_pair = nearest_pair;
        let plant_pair = closest_pair_of_plant(header);
        if let Some(pair) = plant_pair
            && self.plant_closest_pair.replace(pair) != Some(pair)
        {
            self.update_from_plant(pair);
        }
        for pair in [plant_pair, nearest_pair].into_iter().flatten() {
            if self.closest_pair.is_none_or(|closest| pair.distance_m < closest.distance_m) {
                self.closest_pair = Some(pair);
            }
        }
        let distance_m = nearest_pair.map_or(f64::INFINITY, |closest| closest.distance_m);
        let is_below = match self.sizes_m.is_empty() {
            true => distance_m < self.distance_min_m,
            false => self.has_pair_below_sum_of_sizes(alphas),
        };
        self.violations += u64::from(is_below);
        self.plant_violations = header.violations;
        let previous_ns = self.newest_t_ns.replace(t_ns);
        let is_new = |pair: &ClosestPair| previous_ns.is_none_or(|t_ns| pair.t_ns > t_ns);
        plant_pair.filter(is_new).map_or(distance_m, |pair| distance_m.min(pair.distance_m))
    }

    /// Updates the smallest distance of a pair with a distance that the plant measured between two samples.
    fn update_from_plant(&mut self, closest: ClosestPair) {
        let Some(minima) = &mut self.minima else { return };
        let square = closest.distance_m * closest.distance_m;
        // If both evaluated the end of the same arc, the time is the same, and rounding must not change it.
        if square < minima.minimum_squared_and_time(closest.pair).0 * (1.0 - 1e-12) {
            minima.set_minimum(closest.pair, square, closest.t_ns);
        }
    }

    /// Returns the smallest distance at the newest sample, m, and the indices of the two robots.
    pub(super) fn newest_min_distance(&self) -> Option<(f64, [usize; 2])> {
        self.newest_nearest_pair.map(|nearest| (nearest.distance_m, nearest.pair))
    }

    /// Returns the smallest distance of all pairs and samples.
    pub(super) fn closest_pair(&self) -> Option<ClosestPair> {
        self.closest_pair
    }

    /// Returns the smallest distance of any pair over the minimum distance of the two robots; `None` if all pairs have
    /// the same minimum distance, and with fewer than two robots.
    pub(super) fn smallest_over_d(&self) -> Option<f64> {
        let minima = self.minima.as_ref()?;
        let sizes = self.sizes_m.iter().enumerate();
        let ratios = sizes.flat_map(|(j, size_j)| {
            self.sizes_m[..j].iter().enumerate().map(move |(i, size_i)| {
                minima.minimum_squared_and_time([i, j]).0.sqrt() / (size_i + size_j)
            })
        });
        ratios.reduce(f64::min).filter(|ratio| ratio.is_finite())
    }

    /// Returns `true` if two robots are closer than the sum of their sizes.
    fn has_pair_below_sum_of_sizes(&self, alphas: &[Vec2]) -> bool {
        let robots = || alphas.iter().zip(&self.sizes_m);
        robots().enumerate().any(|(i, (a, size_a))| {
            robots().take(i).any(|(b, size_b)| (a - b).norm() < size_a + size_b)
        })
    }

    /// Returns every pair in scenario order; empty before the first sample, and if only the closest pair is measured.
    pub(super) fn pair_distances(&self, names: &[String]) -> Vec<PairDistance> {
        let Some(minima) = &self.minima else { return Vec::new() };
        let pairs = (0..self.robots).flat_map(|i| (i + 1..self.robots).map(move |j| [i, j]));
        let measured = pairs.map(|pair| (pair, minima.minimum_squared_and_time(pair)));
        let measured = measured.filter(|(_, (square, _))| square.is_finite());
        measured
            .map(|([a, b], (square, t_ns))| PairDistance {
                robot_a: names[a].clone(),
                robot_b: names[b].clone(),
                min_distance_m: square.sqrt(),
                t_s: ns_to_seconds(t_ns),
            })
            .collect()
    }

    /// Returns the number of ticks (in real time, of arc ends) at which some pair was too near.
    pub(super) fn violations(&self) -> u64 {
        self.violations.max(self.plant_violations)
    }
}

/// Returns the smallest distance that the plant has measured, also at arc ends between samples.
fn closest_pair_of_plant(header: &TruthHeader) -> Option<ClosestPair> {
    let closest = ClosestPair {
        distance_m: header.closest_m,
        pair: header.closest_pair.map(|robot| robot as usize),
        t_ns: header.closest_t_ns,
    };
    closest.distance_m.is_finite().then_some(closest)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::metrics::examples::header;

    #[test]
    fn pairs_of_different_sizes_have_their_own_minimum_distance() {
        let mut distances = Distances::new(3, 0.4, vec![0.1, 0.1, 0.3]);
        let mut add = |x_m: [f64; 3]| {
            distances.add_truth(&header(0), &x_m.map(|x_m| Vec2::new(x_m, 0.0)));
            (distances.violations(), distances.smallest_over_d())
        };
        // The small robots are 0.25 m apart and keep 0.2 m, the large one keeps 0.4 m from each.
        assert_eq!(add([0.0, 0.25, 0.75]), (0, Some(1.25)));
        assert_eq!(add([0.0, 0.5, 0.75]), (1, Some(0.625)));
        assert_eq!(add([0.0, 0.25, 0.75]), (1, Some(0.625)));
    }

    #[test]
    fn every_pair_has_its_minimum_distance_with_its_time() {
        let names = ["a", "b", "c", "d"].map(String::from);
        let mut distances = Distances::new(4, 0.0, Vec::new());
        assert_eq!(distances.pair_distances(&names), []);
        // All robots stand in a row; one after the other approaches the last and leaves again.
        for tick in 0..8_u64 {
            let shift_m = |robot: u64| if robot < 3 && tick == 2 * robot { 0.5 } else { 0.0 };
            let position = |robot: u64| Vec2::new(3.0 * robot as f64 + shift_m(robot), 0.0);
            let alphas = [0, 1, 2, 3].map(position);
            let mut header_with_pair = TruthHeader { t_ns: 1000 * tick, ..header(tick) };
            if tick > 4 {
                (
                    header_with_pair.closest_m,
                    header_with_pair.closest_pair,
                    header_with_pair.closest_t_ns,
                ) = (2.0, [1, 3], 4500);
            }
            distances.add_truth(&header_with_pair, &alphas);
            let pair = match tick {
                0 | 2 | 4 => [tick as usize / 2, tick as usize / 2 + 1],
                _ => [0, 1],
            };
            let nearest_m = if matches!(tick, 0 | 2 | 4) { 2.5 } else { 3.0 };
            assert_eq!(distances.newest_min_distance(), Some((nearest_m, pair)), "{tick}");
        }
        let found = distances.pair_distances(&names).into_iter();
        let found: Vec<_> = found
            .map(|p| (p.robot_a + &p.robot_b, p.min_distance_m, (p.t_s * 1e9).round()))
            .collect();
        let expected = [
            ("ab", 2.5, 0.0),
            ("ac", 5.5, 0.0),
            ("ad", 8.5, 0.0),
            ("bc", 2.5, 2000.0),
            ("bd", 2.0, 4500.0),
            ("cd", 2.5, 4000.0),
        ];
        let expected = expected.map(|(pair, m, ns)| (pair.to_owned(), m, ns));
        assert_eq!(found, expected);
        assert_eq!(distances.closest_pair().map(|c| (c.distance_m, c.pair)), Some((2.0, [1, 3])));
    }
}
