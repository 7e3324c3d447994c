//! Smallest distance of each pair of points over time, and its time.
//!
//! All pairs are evaluated at every update. Their number grows with the square of the number of points, so coordinates
//! and minima are in arrays of their own, of which several elements are evaluated at once.

use crate::Vec2;
use crate::closest::ClosestPair;

/// Number of pairs that are evaluated at once.
const LANES: usize = 4;

/// Smallest distance of each pair of points up to now.
#[derive(Debug, Clone, Default)]
pub struct PairMinima {
    points: usize,
    /// Square of the smallest distance of each pair i < j, row by row, m^2.
    distances_squared_m2: Vec<f64>,
    /// Time of the smallest distance of each pair, ns.
    times_ns: Vec<u64>,
    /// Coordinates of the points at the current update, m.
    x_m: Vec<f64>,
    y_m: Vec<f64>,
}

impl PairMinima {
    /// Creates the state before the first update, for this number of points. All distances are infinite.
    pub fn new(points: usize) -> PairMinima {
        let pairs = points * points.saturating_sub(1) / 2;
        let (squares, times_ns) = (vec![f64::INFINITY; pairs], vec![0; pairs]);
        PairMinima {
            points,
            distances_squared_m2: squares,
            times_ns,
            x_m: Vec::new(),
            y_m: Vec::new(),
        }
    }

    /// Updates all pairs with the positions at `t_ns`, m. Returns the closest pair; of equal distances, the first in
    /// the order of the points. Returns `None` for fewer than two points.
    pub fn update(&mut self, points: &[Vec2], t_ns: u64) -> Option<ClosestPair> {
        let PairMinima { distances_squared_m2: squares, times_ns, x_m, y_m, .. } = self;
        x_m.clear();
        y_m.clear();
        x_m.extend(points.iter().map(|point| point.x));
        y_m.extend(points.iter().map(|point| point.y));
        let (mut squares, mut times_ns) = (&mut squares[..], &mut times_ns[..]);
        let mut closest: Option<([usize; 2], f64)> = None;
        for (i, point) in points.iter().enumerate() {
            let (x_m, y_m) = (&x_m[i + 1..], &y_m[i + 1..]);
            let (row, squares_below) = std::mem::take(&mut squares).split_at_mut(x_m.len());
            let (row_times, times_below) = std::mem::take(&mut times_ns).split_at_mut(x_m.len());
            (squares, times_ns) = (squares_below, times_below);
            let smallest = update_row(*point, x_m, y_m, row, row_times, t_ns);
            if closest.is_none_or(|(_, closest)| smallest < closest) {
                let is_smallest = |j: &usize| square_m2(*point, x_m[*j], y_m[*j]) == smallest;
                // No distance is found if all are infinite or NaN.
                let found = (0..x_m.len()).find(is_smallest).filter(|_| smallest < f64::INFINITY);
                closest = found.map(|j| ([i, i + 1 + j], smallest)).or(closest);
            }
        }
        let (pair, square) = closest.or_else(|| {
            let square = |b: &Vec2| square_m2(points[0], b.x, b.y);
            points.get(1).map(|b| ([0, 1], square(b)))
        })?;
        Some(ClosestPair { pair, distance_m: square.sqrt() })
    }

    /// Returns the square of the smallest distance of the pair i < j, m^2, and its time, ns.
    pub fn minimum_squared_and_time(&self, pair: [usize; 2]) -> (f64, u64) {
        let index = self.pair_index(pair);
        (self.distances_squared_m2[index], self.times_ns[index])
    }

    /// Replaces the square of the smallest distance of the pair i < j, m^2, and its time, ns.
    pub fn set_minimum(&mut self, pair: [usize; 2], square_m2: f64, t_ns: u64) {
        let index = self.pair_index(pair);
        (self.distances_squared_m2[index], self.times_ns[index]) = (square_m2, t_ns);
    }

    /// Returns the index of the pair i < j.
    fn pair_index(&self, [i, j]: [usize; 2]) -> usize {
        i * (2 * self.points - i - 1) / 2 + j - i - 1
    }
}

/// Returns the square of the distance between a point and the point (`x_m`, `y_m`), m^2.
fn square_m2(point: Vec2, x_m: f64, y_m: f64) -> f64 {
    let (dx_m, dy_m) = (point.x - x_m, point.y - y_m);
    dx_m * dx_m + dy_m * dy_m
}

/// Updates the pairs of a point with the points that follow it. Returns the smallest square at this time, m^2; infinite
/// if there is none.
fn update_row(
    point: Vec2,
    x_m: &[f64],
    y_m: &[f64],
    squares: &mut [f64],
    times_ns: &mut [u64],
    t_ns: u64,
) -> f64 {
    let mut smallest = [f64::INFINITY; LANES];
    let (x_chunks, x_rest) = x_m.as_chunks::<LANES>();
    let (y_chunks, y_rest) = y_m.as_chunks::<LANES>();
    let (square_chunks, square_rest) = squares.as_chunks_mut::<LANES>();
    let (time_chunks, time_rest) = times_ns.as_chunks_mut::<LANES>();
    let minima = square_chunks.iter_mut().zip(time_chunks);
    for ((x_m, y_m), (minima, times_ns)) in x_chunks.iter().zip(y_chunks).zip(minima) {
        let mut now = [0.0; LANES];
        let mut is_any_smaller = false;
        for lane in 0..LANES {
            now[lane] = square_m2(point, x_m[lane], y_m[lane]);
            smallest[lane] = if now[lane] < smallest[lane] { now[lane] } else { smallest[lane] };
            is_any_smaller |= now[lane] < minima[lane];
        }
        if is_any_smaller {
            for lane in 0..LANES {
                let is_smaller = now[lane] < minima[lane];
                times_ns[lane] = if is_smaller { t_ns } else { times_ns[lane] };
                minima[lane] = if is_smaller { now[lane] } else { minima[lane] };
            }
        }
    }
    let minima = square_rest.iter_mut().zip(time_rest);
    for ((&x_m, &y_m), (minima, known_ns)) in x_rest.iter().zip(y_rest).zip(minima) {
        let now = square_m2(point, x_m, y_m);
        smallest[0] = if now < smallest[0] { now } else { smallest[0] };
        if now < *minima {
            (*minima, *known_ns) = (now, t_ns);
        }
    }
    smallest.into_iter().fold(f64::INFINITY, f64::min)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::closest::closest_pair;
    use proptest::prelude::*;

    proptest! {
        /// Coarse positions, so that distances are often equal.
        #[test]
        fn minima_equal_those_of_a_search_over_all_pairs(
            motion in (0..14_usize).prop_flat_map(|count| {
                prop::collection::vec(prop::collection::vec((-6..6_i8, -6..6_i8), count), 1..8)
            }),
        ) {
            let count = motion[0].len();
            let mut minima = PairMinima::new(count);
            let mut expected = vec![vec![(f64::INFINITY, 0); count]; count];
            for (t_ns, points) in (3..).zip(&motion) {
                let point = |&(x, y): &(i8, i8)| 0.3 * Vec2::new(x.into(), y.into());
                let points: Vec<Vec2> = points.iter().map(point).collect();
                prop_assert_eq!(minima.update(&points, t_ns), closest_pair(&points));
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
}
