//! How near every pair of robots came, and when. (15)

use formation::Vec2;
use protocol::message::TruthHeader;
use serde::Serialize;

use super::seconds;

/// Two robots at their nearest.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Closest {
    /// |alpha_i - alpha_j|, m.
    pub(super) distance_m: f64,
    /// Their places, the smaller one first.
    pub(super) pair: [usize; 2],
    /// When, ns.
    pub(super) t_ns: u64,
}

/// Two robots by name, how near they came, and when.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct PairDistance {
    /// Which two, in scenario order.
    pub pair: [String; 2],
    /// Smallest distance of their front points at any truth, m.
    pub min_distance_m: f64,
    /// When, s.
    pub t_s: f64,
}

/// The smallest distance of every pair so far.
pub(super) struct Distances {
    robots: usize,
    /// For each pair i < j, row by row: square of the smallest distance, m^2, and when, ns.
    least: Vec<(f64, u64)>,
}

impl Distances {
    pub(super) fn new(robots: usize) -> Distances {
        let pairs = robots * robots.saturating_sub(1) / 2;
        Distances { robots, least: vec![(f64::INFINITY, 0); pairs] }
    }

    /// Takes in where everybody is now; the closest pair of this truth.
    pub(super) fn truth(&mut self, t_ns: u64, alphas: &[Vec2]) -> Option<Closest> {
        let mut closest: Option<([usize; 2], f64)> = None;
        let mut least = self.least.iter_mut();
        for (i, a) in alphas.iter().enumerate() {
            // The iterators end together: one row of pairs for each i.
            for ((j, b), least) in alphas.iter().enumerate().skip(i + 1).zip(&mut least) {
                let square = (a - b).norm_squared();
                if square < least.0 {
                    *least = (square, t_ns);
                }
                if closest.is_none_or(|(_, nearest)| square < nearest) {
                    closest = Some(([i, j], square));
                }
            }
        }
        closest.map(|(pair, square)| Closest { distance_m: square.sqrt(), pair, t_ns })
    }

    /// Takes in what the plant saw, at the end of an arc that no truth may tell of.
    pub(super) fn seen_by_plant(&mut self, header: &TruthHeader) -> Option<Closest> {
        let seen = Closest {
            distance_m: header.closest_m,
            pair: header.closest_pair.map(|place| place as usize),
            t_ns: header.closest_t_ns,
        };
        if !seen.distance_m.is_finite() {
            return None;
        }
        let place = self.place(seen.pair);
        let least = &mut self.least[place];
        let square = seen.distance_m * seen.distance_m;
        // Where both saw the same arc's end, the time is the same and rounding must not matter.
        if square < least.0 * (1.0 - 1e-12) {
            *least = (square, seen.t_ns);
        }
        Some(seen)
    }

    /// Where in the list the pair i < j stands.
    fn place(&self, [i, j]: [usize; 2]) -> usize {
        i * (2 * self.robots - i - 1) / 2 + j - i - 1
    }

    /// Every pair in scenario order; none before the first truth.
    pub(super) fn pairs(&self, names: &[String]) -> Vec<PairDistance> {
        let pairs = (0..self.robots).flat_map(|i| (i + 1..self.robots).map(move |j| [i, j]));
        let seen = pairs.zip(&self.least).filter(|(_, (square, _))| square.is_finite());
        seen.map(|(pair, &(square, t_ns))| PairDistance {
            pair: pair.map(|i| names[i].clone()),
            min_distance_m: square.sqrt(),
            t_s: seconds(t_ns),
        })
        .collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use formation::closest::closest_pair;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn every_pair_keeps_its_own_smallest_distance(
            flight in prop::collection::vec(
                prop::array::uniform5((-9.0..9.0f64, -9.0..9.0f64)), 1..20
            ),
        ) {
            let mut distances = Distances::new(5);
            let flight: Vec<Vec<Vec2>> = flight
                .iter()
                .map(|points| points.iter().map(|&(x, y)| Vec2::new(x, y)).collect())
                .collect();
            for (t_ns, alphas) in flight.iter().enumerate() {
                let closest = distances.truth(t_ns as u64, alphas).unwrap();
                let expected = closest_pair(alphas).unwrap();
                prop_assert_eq!(closest.pair, expected.pair);
                prop_assert_eq!(closest.distance_m, expected.distance_m);
            }
            for i in 0..5 {
                for j in i + 1..5 {
                    let apart = |alphas: &Vec<Vec2>| (alphas[i] - alphas[j]).norm();
                    let expected = flight.iter().map(apart).fold(f64::INFINITY, f64::min);
                    let (square, t_ns) = distances.least[distances.place([i, j])];
                    prop_assert!((square.sqrt() - expected).abs() < 1e-12);
                    prop_assert!((apart(&flight[t_ns as usize]) - expected).abs() < 1e-12);
                }
            }
        }
    }
}
