//! Smallest distances between robots (15): of each pair and of all pairs, and when they occurred.

use formation::{Vec2, seconds};
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
pub(super) struct Closest {
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
    /// Square of the smallest distance, m^2, and its time, ns, for each pair i < j, row by row.
    least: Vec<(f64, u64)>,
    closest: Option<Closest>,
    /// Nearest pair at the newest ground-truth sample.
    nearest: Option<Closest>,
    /// Smallest distance that the plant reported last.
    reported_by_plant: Option<Closest>,
    violations: u64,
    violations_plant: u64,
    newest_t_ns: Option<u64>,
}

impl Distances {
    /// Creates the metric before the first sample. A distance below `distance_min_m` is a violation.
    pub(super) fn new(robots: usize, distance_min_m: f64) -> Distances {
        Distances {
            robots,
            distance_min_m,
            least: vec![(f64::INFINITY, 0); robots * robots.saturating_sub(1) / 2],
            ..Distances::default()
        }
    }

    /// Updates the metric with one sample. Returns the smallest known distance since the previous sample, m. The
    /// plant evaluates the end of every arc from the start of the run on, so that neither shorter arcs nor lost
    /// samples hide anything.
    pub(super) fn add_truth(&mut self, header: &TruthHeader, alphas: &[Vec2]) -> f64 {
        let t_ns = header.t_ns;
        let now = self.update_pairs(t_ns, alphas);
        self.nearest = now;
        let plant = seen_by_plant(header);
        if let Some(seen) = plant
            && self.reported_by_plant.replace(seen) != Some(seen)
        {
            self.update_from_plant(seen);
        }
        for seen in [plant, now].into_iter().flatten() {
            if self.closest.is_none_or(|closest| seen.distance_m < closest.distance_m) {
                self.closest = Some(seen);
            }
        }
        let distance_m = now.map_or(f64::INFINITY, |closest| closest.distance_m);
        self.violations += u64::from(distance_m < self.distance_min_m);
        self.violations_plant = header.violations;
        let before_ns = self.newest_t_ns.replace(t_ns);
        let news = |seen: &Closest| before_ns.is_none_or(|t_ns| seen.t_ns > t_ns);
        plant.filter(news).map_or(distance_m, |seen| distance_m.min(seen.distance_m))
    }

    /// Updates the smallest distance of each pair. Returns the nearest pair; of equal distances, the first.
    fn update_pairs(&mut self, t_ns: u64, alphas: &[Vec2]) -> Option<Closest> {
        let mut nearest: Option<([usize; 2], f64)> = None;
        let mut least = self.least.iter_mut();
        for (i, a) in alphas.iter().enumerate() {
            // The iterators end together: each i has one row of pairs.
            for ((j, b), least) in alphas.iter().enumerate().skip(i + 1).zip(&mut least) {
                let square = (a - b).norm_squared();
                if square < least.0 {
                    *least = (square, t_ns);
                }
                if nearest.is_none_or(|(_, nearest)| square < nearest) {
                    nearest = Some(([i, j], square));
                }
            }
        }
        nearest.map(|(pair, square)| Closest { distance_m: square.sqrt(), pair, t_ns })
    }

    /// Updates the smallest distance of a pair with a distance that the plant measured between two samples.
    fn update_from_plant(&mut self, seen: Closest) {
        let least = &mut self.least[pair_index(self.robots, seen.pair)];
        let square = seen.distance_m * seen.distance_m;
        // If both evaluated the end of the same arc, the time is the same, and rounding must not change it.
        if square < least.0 * (1.0 - 1e-12) {
            *least = (square, seen.t_ns);
        }
    }

    /// Returns the smallest distance at the newest sample, m, and the indices of the two robots.
    pub(super) fn newest_minimum(&self) -> Option<(f64, [usize; 2])> {
        self.nearest.map(|nearest| (nearest.distance_m, nearest.pair))
    }

    /// Returns the smallest distance of all pairs and samples.
    pub(super) fn closest_pair(&self) -> Option<Closest> {
        self.closest
    }

    /// Returns every pair in scenario order; empty before the first sample.
    pub(super) fn pairs(&self, names: &[String]) -> Vec<PairDistance> {
        let pairs = (0..self.robots).flat_map(|i| (i + 1..self.robots).map(move |j| [i, j]));
        let seen = pairs.zip(&self.least).filter(|(_, (square, _))| square.is_finite());
        seen.map(|([a, b], (square, t_ns))| PairDistance {
            robot_a: names[a].clone(),
            robot_b: names[b].clone(),
            min_distance_m: square.sqrt(),
            t_s: seconds(*t_ns),
        })
        .collect()
    }

    /// Returns the number of ticks (in real time, of arc ends) at which some pair was too near.
    pub(super) fn violations(&self) -> u64 {
        self.violations.max(self.violations_plant)
    }
}

/// Returns the index of the pair i < j in the list of pairs.
fn pair_index(robots: usize, [i, j]: [usize; 2]) -> usize {
    i * (2 * robots - i - 1) / 2 + j - i - 1
}

/// Returns the smallest distance that the plant has measured, also at arc ends between samples.
fn seen_by_plant(header: &TruthHeader) -> Option<Closest> {
    let seen = Closest {
        distance_m: header.closest_m,
        pair: header.closest_pair.map(|place| place as usize),
        t_ns: header.closest_t_ns,
    };
    seen.distance_m.is_finite().then_some(seen)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::metrics::examples::header;

    #[test]
    fn every_pair_has_its_minimum_distance_with_its_time() {
        let names = ["a", "b", "c", "d"].map(String::from);
        let mut distances = Distances::new(4, 0.0);
        assert_eq!(distances.pairs(&names), []);
        // All robots stand in a row; one after the other approaches the last and leaves again.
        for tick in 0..8_u64 {
            let nearer = |robot: u64| if robot < 3 && tick == 2 * robot { 0.5 } else { 0.0 };
            let at = |robot: u64| Vec2::new(3.0 * robot as f64 + nearer(robot), 0.0);
            let alphas = [0, 1, 2, 3].map(at);
            let mut seen = TruthHeader { t_ns: 1000 * tick, ..header(tick) };
            if tick > 4 {
                (seen.closest_m, seen.closest_pair, seen.closest_t_ns) = (2.0, [1, 3], 4500);
            }
            distances.add_truth(&seen, &alphas);
            let pair = match tick {
                0 | 2 | 4 => [tick as usize / 2, tick as usize / 2 + 1],
                _ => [0, 1],
            };
            let nearest_m = if matches!(tick, 0 | 2 | 4) { 2.5 } else { 3.0 };
            assert_eq!(distances.newest_minimum(), Some((nearest_m, pair)), "{tick}");
        }
        let found = distances.pairs(&names).into_iter();
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
