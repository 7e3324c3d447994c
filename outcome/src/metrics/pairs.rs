//! How near each single pair of robots came, and when. (15)
//!
//! All pairs are looked at together for a window of truths: one whose way to its smallest distance
//! is longer than the way it can have made within the window is passed over.

use formation::{ROUNDING, Vec2};
use serde::Serialize;

use crate::metrics::closest::Closest;
use formation::seconds;

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
pub(super) struct Pairs {
    robots: usize,
    /// For each pair i < j, row by row: square of the smallest distance, m^2, and when, ns; the
    /// window under way not yet looked at.
    least: Vec<(f64, u64)>,
    window: Window,
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

impl Pairs {
    pub(super) fn new(robots: usize) -> Pairs {
        let pairs = robots * robots.saturating_sub(1) / 2;
        Pairs {
            robots,
            least: vec![(f64::INFINITY, 0); pairs],
            window: Window {
                t_ns: Vec::with_capacity(WINDOW),
                tracks: vec![[[0.0; WINDOW]; 2]; robots],
                middles: Vec::with_capacity(WINDOW),
            },
        }
    }

    /// Takes in where everybody is now.
    pub(super) fn truth(&mut self, t_ns: u64, alphas: &[Vec2]) {
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
    pub(super) fn seen_by_plant(&mut self, seen: Closest) {
        let place = self.place(seen.pair);
        let truths = self.window.t_ns.len();
        let least = self.window.least(seen.pair, self.least[place], truths);
        let square = seen.distance_m * seen.distance_m;
        // Where both saw the same arc's end, the time is the same and rounding must not matter.
        let nearer = square < least.0 * (1.0 - 1e-12);
        self.least[place] = if nearer { (square, seen.t_ns) } else { least };
    }

    /// Where in the list the pair i < j stands.
    pub(super) fn place(&self, [i, j]: [usize; 2]) -> usize {
        i * (2 * self.robots - i - 1) / 2 + j - i - 1
    }

    /// Every pair in scenario order; none before the first truth.
    pub(super) fn report(&self, names: &[String]) -> Vec<PairDistance> {
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
