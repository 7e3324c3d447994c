//! Smallest distance of each pair of points over time, and its time.
//!
//! The number of pairs grows with the square of the number of points, so that the minima of many points do not fit into
//! a processor's cache. The positions of several updates are therefore collected, and then every pair is evaluated once
//! for all of them. A pair is skipped if its points have not moved far enough for a new minimum.

use crate::{RELATIVE_ROUNDING_ERROR_MAX, Vec2};

/// Number of updates for which the pairs are evaluated together.
const UPDATES: usize = 16;
/// Number of points whose tracks stay in the first-level cache while all pairs with them are evaluated.
const TILE_POINTS: usize = 64;

/// Smallest distance of each pair of points up to now.
#[derive(Debug, Clone, Default)]
pub struct PairMinima {
    points: usize,
    /// Square of the smallest distance of each pair i < j at the evaluated updates, row by row, m^2.
    distances_squared_m2: Vec<f64>,
    /// Time of the smallest distance of each pair, ns.
    times_ns: Vec<u64>,
    /// Positions of all points, m, at each update that is not evaluated yet, oldest first.
    pending_points: Vec<Vec<Vec2>>,
    /// Times of these updates, ns.
    pending_times_ns: Vec<u64>,
    /// Buffer of [`PairMinima::evaluate_pending_updates`].
    tracks: Vec<Track>,
}

/// Positions of one point at [`UPDATES`] updates.
#[derive(Debug, Clone)]
struct Track {
    x_m: [f64; UPDATES],
    y_m: [f64; UPDATES],
    /// Upper bound on the distance of the point from its first position, relative to the mean of all points, m.
    displacement_max_m: f64,
}

impl PairMinima {
    /// Creates the state before the first update, for this number of points. All distances are infinite.
    pub fn new(points: usize) -> PairMinima {
        let pairs = points * points.saturating_sub(1) / 2;
        PairMinima {
            points,
            distances_squared_m2: vec![f64::INFINITY; pairs],
            times_ns: vec![0; pairs],
            pending_points: Vec::new(),
            pending_times_ns: Vec::new(),
            tracks: Vec::new(),
        }
    }

    /// Updates all pairs with the positions at `t_ns`, m.
    pub fn update(&mut self, points: &[Vec2], t_ns: u64) {
        let pending_count = self.pending_times_ns.len();
        // The buffers of evaluated updates are used again.
        if self.pending_points.len() == pending_count {
            self.pending_points.push(Vec::with_capacity(points.len()));
        }
        self.pending_points[pending_count].clear();
        self.pending_points[pending_count].extend_from_slice(points);
        self.pending_times_ns.push(t_ns);
        if self.pending_times_ns.len() == UPDATES {
            self.evaluate_pending_updates();
        }
    }

    /// Returns the square of the smallest distance of the pair i < j, m^2, and its time, ns.
    pub fn minimum_squared_and_time(&self, [i, j]: [usize; 2]) -> (f64, u64) {
        let index = self.pair_index([i, j]);
        let evaluated = (self.distances_squared_m2[index], self.times_ns[index]);
        let pending = self.pending_points.iter().zip(&self.pending_times_ns);
        pending.fold(evaluated, |minimum, (points, &t_ns)| {
            let square = (points[i] - points[j]).norm_squared();
            if square < minimum.0 { (square, t_ns) } else { minimum }
        })
    }

    /// Replaces the square of the smallest distance of the pair i < j, m^2, and its time, ns, by smaller ones.
    pub fn set_minimum(&mut self, pair: [usize; 2], square_m2: f64, t_ns: u64) {
        let index = self.pair_index(pair);
        (self.distances_squared_m2[index], self.times_ns[index]) = (square_m2, t_ns);
    }

    /// Returns the index of the pair i < j.
    fn pair_index(&self, [i, j]: [usize; 2]) -> usize {
        i * (2 * self.points - i - 1) / 2 + j - i - 1
    }

    /// Evaluates all pairs at [`UPDATES`] pending updates.
    fn evaluate_pending_updates(&mut self) {
        let mut tracks = std::mem::take(&mut self.tracks);
        tracks.clear();
        let means: Vec<Vec2> = self.pending_points.iter().map(|points| mean(points)).collect();
        tracks.extend((0..self.points).map(|i| {
            Track::new(&std::array::from_fn(|update| self.pending_points[update][i]), &means)
        }));
        for tile_start in (0..self.points).step_by(TILE_POINTS) {
            let tile_end = (tile_start + TILE_POINTS).min(self.points);
            for (i, track) in tracks[..tile_end].iter().enumerate() {
                let first = tile_start.max(i + 1);
                if first == tile_end {
                    continue;
                }
                let indices = self.pair_index([i, first])..=self.pair_index([i, tile_end - 1]);
                let minima = self.distances_squared_m2[indices.clone()].iter_mut();
                let minima = minima.zip(&mut self.times_ns[indices]);
                for (other, (square, t_ns)) in tracks[first..tile_end].iter().zip(minima) {
                    if let Some((new, update)) = track.smaller_distance_squared(other, *square) {
                        (*square, *t_ns) = (new, self.pending_times_ns[update]);
                    }
                }
            }
        }
        self.tracks = tracks;
        self.pending_times_ns.clear();
    }
}

impl Track {
    /// Creates the track of a point, given the mean of all points at each update.
    fn new(positions: &[Vec2; UPDATES], means: &[Vec2]) -> Track {
        let displacement_m = |(position, mean): (&Vec2, &Vec2)| {
            let displacement = (position - positions[0]) - (mean - means[0]);
            let rounding = RELATIVE_ROUNDING_ERROR_MAX * (position.norm() + mean.norm());
            let displacement_m = displacement.norm() + rounding;
            if displacement_m.is_nan() { f64::INFINITY } else { displacement_m }
        };
        Track {
            x_m: positions.map(|position| position.x),
            y_m: positions.map(|position| position.y),
            displacement_max_m: positions.iter().zip(means).map(displacement_m).fold(0.0, f64::max),
        }
    }

    /// Returns the smallest square of the distance to another point, m^2, and the first update at which it occurs, if
    /// it is below `square_m2`.
    #[inline]
    fn smaller_distance_squared(&self, other: &Track, square_m2: f64) -> Option<(f64, usize)> {
        let square = |update: usize| {
            let (dx, dy) =
                (self.x_m[update] - other.x_m[update], self.y_m[update] - other.y_m[update]);
            dx * dx + dy * dy
        };
        let reach_m = self.displacement_max_m + other.displacement_max_m;
        // NaN becomes 0, so that the pair is evaluated.
        let distance_min_m = (square(0).sqrt() - reach_m).max(0.0);
        if distance_min_m * distance_min_m * (1.0 - RELATIVE_ROUNDING_ERROR_MAX) > square_m2 {
            return None;
        }
        let squares: [f64; UPDATES] = std::array::from_fn(square);
        let smallest = squares.iter().fold(square_m2, |a, &b| if b < a { b } else { a });
        let update = squares.iter().position(|square| *square == smallest)?;
        (smallest < square_m2).then_some((smallest, update))
    }
}

/// Returns the mean of the points, m.
fn mean(points: &[Vec2]) -> Vec2 {
    points.iter().sum::<Vec2>() / points.len() as f64
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::random::SplitMix64;
    use proptest::prelude::*;

    /// Generates the positions of all points at each update. Many distances are equal, most points move little or
    /// together, and a coordinate may be NaN or infinite for one update.
    fn motion() -> impl Strategy<Value = Vec<Vec<Vec2>>> {
        let start = prop::collection::vec((-6..6_i8, -6..6_i8), 0..80);
        let coordinate = prop::sample::select(vec![f64::NAN, f64::INFINITY, 1e200]);
        let broken = proptest::option::of((0..50_usize, any::<prop::sample::Index>(), coordinate));
        let scale = prop::sample::select(vec![0.3, 1e-9, 1e6]);
        (start, any::<u64>(), 1..50_usize, broken, scale).prop_map(
            |(start, seed, updates, broken, scale)| {
                let mut rng = SplitMix64::new(seed);
                let mut points: Vec<Vec2> =
                    (start.iter()).map(|&(x, y)| scale * Vec2::new(x.into(), y.into())).collect();
                let mut motion = Vec::new();
                for update in 0..updates {
                    let mut now = points.clone();
                    if let Some((_, index, coordinate)) =
                        broken.filter(|(at, ..)| *at == update && !now.is_empty())
                    {
                        let point = index.index(now.len());
                        now[point].x = coordinate;
                    }
                    motion.push(now);
                    for point in &mut points {
                        let step = |rng: &mut SplitMix64| (4.0 * rng.draw_unit()).floor() - 1.0;
                        let own = if rng.draw_unit() < 0.1 { step(&mut rng) } else { 0.0 };
                        *point += scale * Vec2::new(0.5 + own, 0.25 * own);
                    }
                }
                motion
            },
        )
    }

    proptest! {
        #[test]
        fn minima_equal_those_of_an_update_of_all_pairs(motion in motion()) {
            let count = motion[0].len();
            let mut minima = PairMinima::new(count);
            let mut expected = vec![vec![(f64::INFINITY, 0); count]; count];
            for (update, points) in motion.iter().enumerate() {
                let t_ns = 3 + update as u64;
                minima.update(points, t_ns);
                for i in 0..count {
                    for j in i + 1..count {
                        let square = (points[i] - points[j]).norm_squared();
                        if square < expected[i][j].0 {
                            expected[i][j] = (square, t_ns);
                        }
                        prop_assert_eq!(minima.minimum_squared_and_time([i, j]), expected[i][j]);
                    }
                }
            }
        }
    }

    #[test]
    fn replaced_minimum_survives_pending_updates() {
        let mut minima = PairMinima::new(2);
        for t_ns in 1..=40 {
            minima.update(&[Vec2::zeros(), Vec2::new(2.0, 0.0)], t_ns);
            if t_ns == 5 {
                minima.set_minimum([0, 1], 1.0, 4);
            }
            let expected = if t_ns < 5 { (4.0, 1) } else { (1.0, 4) };
            assert_eq!(minima.minimum_squared_and_time([0, 1]), expected);
        }
    }
}
