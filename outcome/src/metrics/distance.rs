//! How near any two robots came to each other, each pair and the nearest of all, and when. (15)

use formation::{Vec2, seconds};
use protocol::message::TruthHeader;
use serde::Serialize;

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

/// The smallest distances so far.
#[derive(Default)]
pub(super) struct Distances {
    robots: usize,
    distance_min_m: f64,
    /// For each pair i < j, row by row: square of its smallest distance, m^2, and when, ns.
    least: Vec<(f64, u64)>,
    closest: Option<Closest>,
    /// At the newest truth.
    nearest: Option<Closest>,
    /// What the plant saw last.
    seen: Option<Closest>,
    violations: u64,
    violations_plant: u64,
    newest_t_ns: Option<u64>,
}

impl Distances {
    /// Nothing measured yet; nearer than `distance_min_m` is too near.
    pub(super) fn new(robots: usize, distance_min_m: f64) -> Distances {
        Distances {
            robots,
            distance_min_m,
            least: vec![(f64::INFINITY, 0); robots * robots.saturating_sub(1) / 2],
            ..Distances::default()
        }
    }

    /// Takes in where everybody is now. The smallest distance since the previous truth, as far as it
    /// is known, m: the plant looks at the end of every arc and counts from the start, so that
    /// neither shorter arcs nor lost truths hide anything.
    pub(super) fn truth(&mut self, header: &TruthHeader, alphas: &[Vec2]) -> f64 {
        let t_ns = header.t_ns;
        let now = self.look_at_all_pairs(t_ns, alphas);
        self.nearest = now;
        let plant = seen_by_plant(header);
        if let Some(seen) = plant
            && self.seen.replace(seen) != Some(seen)
        {
            self.take_in_what_the_plant_saw(seen);
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

    /// Lowers what each pair's distance now lowers. The nearest two; of equals, the first.
    fn look_at_all_pairs(&mut self, t_ns: u64, alphas: &[Vec2]) -> Option<Closest> {
        let mut nearest: Option<([usize; 2], f64)> = None;
        let mut least = self.least.iter_mut();
        for (i, a) in alphas.iter().enumerate() {
            // The iterators end together: one row of pairs for each i.
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

    /// At the end of an arc that no truth may tell of.
    fn take_in_what_the_plant_saw(&mut self, seen: Closest) {
        let least = &mut self.least[place(self.robots, seen.pair)];
        let square = seen.distance_m * seen.distance_m;
        // Where both saw the same arc's end, the time is the same and rounding must not matter.
        if square < least.0 * (1.0 - 1e-12) {
            *least = (square, seen.t_ns);
        }
    }

    /// The smallest distance at the newest truth, m, and of which two.
    pub(super) fn nearest(&self) -> Option<(f64, [usize; 2])> {
        self.nearest.map(|nearest| (nearest.distance_m, nearest.pair))
    }

    /// The smallest distance of all.
    pub(super) fn closest(&self) -> Option<Closest> {
        self.closest
    }

    /// Every pair in scenario order; none before the first truth.
    pub(super) fn pairs(&self, names: &[String]) -> Vec<PairDistance> {
        let pairs = (0..self.robots).flat_map(|i| (i + 1..self.robots).map(move |j| [i, j]));
        let seen = pairs.zip(&self.least).filter(|(_, (square, _))| square.is_finite());
        seen.map(|(pair, (square, t_ns))| PairDistance {
            pair: pair.map(|i| names[i].clone()),
            min_distance_m: square.sqrt(),
            t_s: seconds(*t_ns),
        })
        .collect()
    }

    /// Ticks (arcs' ends, in real time) at which some pair was too near.
    pub(super) fn violations(&self) -> u64 {
        self.violations.max(self.violations_plant)
    }
}

/// Where in the list the pair i < j stands.
fn place(robots: usize, [i, j]: [usize; 2]) -> usize {
    i * (2 * robots - i - 1) / 2 + j - i - 1
}

/// What the plant saw so far, at the end of an arc that no truth may tell of.
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
    fn every_pair_keeps_its_own_smallest_distance_and_its_time_the_plants_among_them() {
        let names = ["a", "b", "c", "d"].map(String::from);
        let mut distances = Distances::new(4, 0.0);
        assert_eq!(distances.pairs(&names), []);
        // All stand in a row; one after the other comes nearer to the last, and leaves again.
        for tick in 0..8_u64 {
            let nearer = |robot: u64| if robot < 3 && tick == 2 * robot { 0.5 } else { 0.0 };
            let at = |robot: u64| Vec2::new(3.0 * robot as f64 + nearer(robot), 0.0);
            let alphas = [0, 1, 2, 3].map(at);
            let mut seen = TruthHeader { t_ns: 1000 * tick, ..header(tick) };
            if tick > 4 {
                (seen.closest_m, seen.closest_pair, seen.closest_t_ns) = (2.0, [1, 3], 4500);
            }
            distances.truth(&seen, &alphas);
            let pair = match tick {
                0 | 2 | 4 => [tick as usize / 2, tick as usize / 2 + 1],
                _ => [0, 1],
            };
            let nearest_m = if matches!(tick, 0 | 2 | 4) { 2.5 } else { 3.0 };
            assert_eq!(distances.nearest(), Some((nearest_m, pair)), "{tick}");
        }
        let found = distances.pairs(&names).into_iter();
        let found: Vec<_> =
            found.map(|p| (p.pair.concat(), p.min_distance_m, (p.t_s * 1e9).round())).collect();
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
        assert_eq!(distances.closest().map(|c| (c.distance_m, c.pair)), Some((2.0, [1, 3])));
    }
}
