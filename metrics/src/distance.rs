//! How near every pair of robots came, and when. (15)
//!
//! The closest pair is known at every truth. All others are looked at together for a window of
//! truths: a pair whose way to its smallest distance is longer than the way it can have made
//! within the window is passed over.

use formation::closest_over_time::ClosestOverTime;
use formation::{ROUNDING, Vec2};
use protocol::message::TruthHeader;
use serde::Serialize;

use experiment::scenario::seconds;

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

/// Truths that are looked at together.
const WINDOW: usize = 64;

/// The smallest distance of every pair so far.
pub(super) struct Distances {
    robots: usize,
    closest: ClosestOverTime,
    /// For each pair i < j, row by row: square of the smallest distance, m^2, and when, ns; the
    /// window under way not yet looked at.
    least: Vec<(f64, u64)>,
    window: Window,
    /// What the plant saw last.
    seen: Option<Closest>,
}

/// Where everybody was at the last few truths.
struct Window {
    t_ns: Vec<u64>,
    /// For each robot its coordinates, m, at these times.
    tracks: Vec<[[f64; WINDOW]; 2]>,
    /// The middle of all of them.
    middles: Vec<Vec2>,
}

/// How a robot moved within a window.
#[derive(Clone, Copy)]
struct Motion {
    last: Vec2,
    /// Its largest distance from where it was last, both seen from the middle of all, m.
    away_m: f64,
    /// It never moved at all.
    stood: bool,
}

impl Window {
    /// How `robot` moved.
    fn motion(&self, robot: usize) -> Motion {
        let at = |k: usize| Vec2::from(self.tracks[robot].map(|coordinate| coordinate[k]));
        let newest = self.t_ns.len() - 1;
        let seen = |k: usize| at(k) - self.middles[k];
        let last = at(newest);
        let away = (0..newest).map(|k| (seen(k) - seen(newest)).norm_squared());
        // Not `max`, which passes over NaN: of a robot that is nowhere nothing is known.
        let away = away.fold(
            0.0,
            |most: f64, square| {
                if square > most || square.is_nan() { square } else { most }
            },
        );
        let size_m = last.norm() + self.middles[newest].norm() + away.sqrt();
        Motion {
            last,
            away_m: away.sqrt() + ROUNDING * size_m,
            stood: (0..newest).all(|k| at(k) == last),
        }
    }

    /// The smaller of `least` and the smallest square of a pair's distance at the first `truths`
    /// truths, m^2, and when, ns.
    fn least(&self, [i, j]: [usize; 2], least: (f64, u64), truths: usize) -> (f64, u64) {
        let [[ax, ay], [bx, by]] = [&self.tracks[i], &self.tracks[j]];
        let mut squares = [f64::INFINITY; WINDOW];
        for k in 0..truths {
            squares[k] = Vec2::new(ax[k] - bx[k], ay[k] - by[k]).norm_squared();
        }
        // In lanes, for vector registers.
        let mut lanes = [f64::INFINITY; 4];
        for four in squares.chunks_exact(4) {
            for (lane, square) in lanes.iter_mut().zip(four) {
                *lane = if square < lane { *square } else { *lane };
            }
        }
        let smallest = lanes.into_iter().fold(f64::INFINITY, f64::min);
        if smallest < least.0 {
            let first = squares.iter().position(|&square| square == smallest);
            return (smallest, first.map_or(least.1, |k| self.t_ns[k]));
        }
        least
    }
}

impl Distances {
    pub(super) fn new(robots: usize) -> Distances {
        let pairs = robots * robots.saturating_sub(1) / 2;
        Distances {
            robots,
            closest: ClosestOverTime::default(),
            least: vec![(f64::INFINITY, 0); pairs],
            window: Window {
                t_ns: Vec::with_capacity(WINDOW),
                tracks: vec![[[0.0; WINDOW]; 2]; robots],
                middles: Vec::with_capacity(WINDOW),
            },
            seen: None,
        }
    }

    /// Takes in where everybody is now; the closest pair of this truth.
    pub(super) fn truth(&mut self, t_ns: u64, alphas: &[Vec2]) -> Option<Closest> {
        let window = &mut self.window;
        let k = window.t_ns.len();
        for (track, alpha) in window.tracks.iter_mut().zip(alphas) {
            track[0][k] = alpha.x;
            track[1][k] = alpha.y;
        }
        window.t_ns.push(t_ns);
        window.middles.push(alphas.iter().sum::<Vec2>() / alphas.len() as f64);
        if window.t_ns.len() == WINDOW {
            self.look_at_window();
        }
        let closest = self.closest.now(alphas)?;
        Some(Closest { distance_m: closest.distance_m, pair: closest.pair, t_ns })
    }

    /// Lowers what the window lowers, and begins the next one.
    fn look_at_window(&mut self) {
        let window = &self.window;
        let motions: Vec<Motion> = (0..self.robots).map(|robot| window.motion(robot)).collect();
        let mut least = self.least.iter_mut();
        for (i, a) in motions.iter().enumerate() {
            // The iterators end together: one row of pairs for each i.
            for ((j, b), least) in motions.iter().enumerate().skip(i + 1).zip(&mut least) {
                let within_m = (a.last - b.last).norm() - a.away_m - b.away_m;
                if within_m > 0.0 && within_m * within_m > least.0 * (1.0 + ROUNDING) {
                    continue; // it was never as near as before
                }
                let truths = if a.stood && b.stood { 1 } else { WINDOW };
                *least = window.least([i, j], *least, truths);
            }
        }
        self.window.t_ns.clear();
        self.window.middles.clear();
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
        if self.seen != Some(seen) {
            self.seen = Some(seen);
            let place = self.place(seen.pair);
            let truths = self.window.t_ns.len();
            let least = self.window.least(seen.pair, self.least[place], truths);
            let square = seen.distance_m * seen.distance_m;
            // Where both saw the same arc's end, the time is the same and rounding must not matter.
            let nearer = square < least.0 * (1.0 - 1e-12);
            self.least[place] = if nearer { (square, seen.t_ns) } else { least };
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
        let truths = self.window.t_ns.len();
        let least = pairs.zip(&self.least);
        let least = least.map(|(pair, &least)| (pair, self.window.least(pair, least, truths)));
        let seen = least.filter(|(_, (square, _))| square.is_finite());
        seen.map(|(pair, (square, t_ns))| PairDistance {
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
    use crate::examples::header;
    use formation::closest::closest_pair;
    use proptest::prelude::*;

    /// What looking at all pairs at every truth gives.
    struct AllPairs(Vec<(f64, u64)>);

    impl AllPairs {
        fn truth(&mut self, t_ns: u64, alphas: &[Vec2]) {
            let mut least = self.0.iter_mut();
            for (i, a) in alphas.iter().enumerate() {
                for (b, least) in alphas[i + 1..].iter().zip(&mut least) {
                    let square = (a - b).norm_squared();
                    if square < least.0 {
                        *least = (square, t_ns);
                    }
                }
            }
        }

        fn seen_by_plant(&mut self, place: usize, closest: &Closest) {
            let square = closest.distance_m * closest.distance_m;
            if square < self.0[place].0 * (1.0 - 1e-12) {
                self.0[place] = (square, closest.t_ns);
            }
        }
    }

    /// One robot's way: it stands, sways, approaches and leaves, with all others or alone; now and
    /// then it jumps, and where things are badly broken it is nowhere.
    #[derive(Debug, Clone)]
    struct Way {
        start_m: (f64, f64),
        step_m: (f64, f64),
        sway_m: f64,
        stops: u64,
        jumps: u64,
        broken_m: f64,
    }

    impl Way {
        fn at(&self, tick: u64) -> Vec2 {
            let moving = tick.min(self.stops) as f64;
            let mut alpha = Vec2::new(self.start_m.0, self.start_m.1)
                + Vec2::new(self.step_m.0, self.step_m.1) * moving
                + Vec2::new(0.02 * tick as f64, self.sway_m * (0.1 * moving).sin());
            if (self.jumps..self.jumps + 2).contains(&tick) {
                alpha.x += 0.5 + self.broken_m;
            }
            alpha
        }
    }

    fn robot() -> impl Strategy<Value = Way> {
        let start = prop_oneof![Just((0.0, 0.0)), (-9.0..9.0f64, -9.0..9.0f64), Just((3e8, -1e9))];
        let step = prop_oneof![Just((0.0, 0.0)), (-0.1..0.1f64, -0.1..0.1f64)];
        let sway = prop_oneof![Just(0.0), Just(1e-16), 1e-3..1.0f64];
        let broken = prop::sample::select(vec![0.0, 0.0, 0.0, f64::NAN, f64::INFINITY, 1e200]);
        (start, step, sway, 0..300_u64, 0..300_u64, broken).prop_map(
            |(start_m, step_m, sway_m, stops, jumps, broken_m)| Way {
                start_m,
                step_m,
                sway_m,
                stops,
                jumps,
                broken_m,
            },
        )
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(300))]
        #[test]
        fn every_pair_keeps_its_own_smallest_distance_and_its_time_bit_by_bit(
            robots in prop::collection::vec(robot(), 0..12),
            truths in 0..300_u64,
            plant in prop::collection::vec((0..300_u64, any::<prop::sample::Index>(), 0.0..9.0f64), 0..5),
        ) {
            let mut distances = Distances::new(robots.len());
            let mut expected = AllPairs(distances.least.clone());
            let names: Vec<String> = (0..robots.len()).map(|i| i.to_string()).collect();
            let mut seen = header(0);
            for tick in 0..truths {
                let alphas: Vec<Vec2> = robots.iter().map(|robot| robot.at(tick)).collect();
                let t_ns = 1000 * tick;
                let closest = distances.truth(t_ns, &alphas);
                expected.truth(t_ns, &alphas);
                let all = closest_pair(&alphas);
                prop_assert_eq!(closest.map(|c| c.pair), all.map(|c| c.pair));
                prop_assert_eq!(
                    closest.map(|c| c.distance_m.to_bits()), all.map(|c| c.distance_m.to_bits())
                );
                for (at, pair, distance_m) in plant.iter().filter(|_| robots.len() > 1) {
                    if *at == tick && *distance_m < seen.closest_m {
                        seen.closest_m = *distance_m;
                        seen.closest_t_ns = t_ns.saturating_sub(1);
                        let i = pair.index(robots.len() - 1);
                        seen.closest_pair = [i as u32, i as u32 + 1];
                    }
                }
                if let Some(closest) = distances.seen_by_plant(&seen) {
                    expected.seen_by_plant(distances.place(closest.pair), &closest);
                }
            }
            let expected = expected.0.iter().filter(|(square, _)| square.is_finite());
            let expected: Vec<_> = expected.map(|&(square, t_ns)| (square.sqrt(), seconds(t_ns))).collect();
            let pairs = distances.pairs(&names).into_iter();
            let pairs: Vec<_> = pairs.map(|pair| (pair.min_distance_m, pair.t_s)).collect();
            prop_assert_eq!(pairs, expected);
        }
    }
}
