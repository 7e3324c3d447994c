//! A uniform cell grid over points of the plane: who may be within a cell's side of whom.
//!
//! Cells are hashed into as many buckets as there are points, so that it does not matter how far
//! apart the points are. What it once allocated it uses again. Must not: decide who is near, or be
//! asked about points that are not finite.

use crate::Vec2;

/// Cells are larger than the side asked for by this share, so that no rounding puts two points
/// that are one side apart two cells apart.
const SIDE_MARGIN: f64 = 1e-6;
/// Most cells along one axis: their numbers must be exact to less than the margin.
const ALONG_AXIS_MAX: f64 = (1_u32 << 24) as f64;

/// The cells that were last filled.
#[derive(Debug, Clone, Default)]
pub(crate) struct Cells {
    /// Of each point, its column and row.
    cell: Vec<[u32; 2]>,
    /// Where each bucket begins in `members`, and the end of the last one.
    begins: Vec<u32>,
    /// Points by bucket, in ascending order within each.
    members: Vec<u32>,
}

impl Cells {
    /// Sorts finite points into cells with sides of at least `side_m`, m.
    pub(crate) fn fill(&mut self, points: &[Vec2], side_m: f64) {
        let least = points.iter().copied().reduce(|a, b| a.inf(&b)).unwrap_or_default();
        let most = points.iter().copied().reduce(|a, b| a.sup(&b)).unwrap_or_default();
        let side_m = (side_m * (1.0 + SIDE_MARGIN)).max((most - least).max() / ALONG_AXIS_MAX);
        // Of points that are all in one place, 0 over 0: not a number, as which 0 is read.
        let number = |along_m: f64| (along_m / side_m) as u32 + 1;
        self.cell.clear();
        self.cell.extend(points.iter().map(|point| {
            let from = point - least;
            [number(from.x), number(from.y)]
        }));
        let buckets = points.len().next_power_of_two();
        self.begins.clear();
        self.begins.resize(buckets + 1, 0);
        for &cell in &self.cell {
            self.begins[bucket(cell, buckets)] += 1;
        }
        let mut end = 0;
        for begin in &mut self.begins {
            end += *begin;
            *begin = end;
        }
        self.members.clear();
        self.members.resize(points.len(), 0);
        for (point, &cell) in self.cell.iter().enumerate().rev() {
            let begin = &mut self.begins[bucket(cell, buckets)];
            *begin -= 1;
            self.members[*begin as usize] = point as u32;
        }
    }

    /// Every point, `point` included, in its cell and the eight around it, each once: all that are
    /// within a side of it are among them.
    pub(crate) fn around(&self, point: usize) -> impl Iterator<Item = usize> {
        let [column, row] = self.cell[point];
        let buckets = self.begins.len() - 1;
        let cells = (row - 1..=row + 1)
            .flat_map(move |row| (column - 1..=column + 1).map(move |column| [column, row]));
        cells.flat_map(move |cell| {
            let place = bucket(cell, buckets);
            let [begin, end] = [place, place + 1].map(|place| self.begins[place] as usize);
            let members = self.members[begin..end].iter().map(|&member| member as usize);
            // Cells may share a bucket.
            members.filter(move |&member| self.cell[member] == cell)
        })
    }
}

/// Where a cell's points are kept; `buckets` is a power of two.
fn bucket([column, row]: [u32; 2], buckets: usize) -> usize {
    let mixed = column.wrapping_mul(0x9E37_79B1) ^ row.wrapping_mul(0x85EB_CA77);
    (mixed ^ (mixed >> 15)) as usize & (buckets - 1)
}

#[cfg(test)]
pub(crate) mod tests {
    use super::*;
    use proptest::prelude::*;

    /// Robots scattered, on a lattice, in a line, in clusters far apart, and upon each other.
    pub(crate) fn crowd() -> impl Strategy<Value = Vec<Vec2>> {
        let count = || prop_oneof![0..8_usize, 20..90_usize];
        let point = |x: BoxedStrategy<f64>, y: BoxedStrategy<f64>| {
            count().prop_flat_map(move |count| {
                prop::collection::vec(
                    (x.clone(), y.clone()).prop_map(|(x, y)| Vec2::new(x, y)),
                    count,
                )
            })
        };
        let span = |m: f64| (-m..m).boxed();
        let steps = || (-4..5_i32).prop_map(|step| f64::from(step) * 0.5).boxed();
        let far = || {
            prop_oneof![(-1e9..-0.9999999999e9f64), Just(1e15), -1.0..1.0f64, (5e20..6e20f64),]
                .boxed()
        };
        prop_oneof![
            point(span(4.0), span(4.0)),
            point(span(1e7), span(1e7)),
            point(steps(), steps()),
            point(span(9.0), Just(-0.0).boxed()),
            point(far(), far()),
            point(Just(7.7).boxed(), Just(1e-300).boxed()),
        ]
    }

    proptest! {
        #[test]
        fn whoever_is_within_a_side_is_around_and_nobody_twice(
            points in crowd(), side_m in prop_oneof![1e-12..1e-9f64, 0.01..3.0f64, 1e5..1e9f64],
        ) {
            let mut cells = Cells::default();
            // What was there before must not matter.
            cells.fill(&[Vec2::new(3.0, 4.0); 5], 1.0);
            cells.fill(&points, side_m);
            for (i, a) in points.iter().enumerate() {
                let mut around: Vec<usize> = cells.around(i).collect();
                around.sort_unstable();
                prop_assert!(around.windows(2).all(|two| two[0] < two[1]));
                for (j, b) in points.iter().enumerate() {
                    prop_assert!((a - b).norm() > side_m || around.binary_search(&j).is_ok());
                }
            }
        }
    }

    proptest! {
        /// Where rounding decides whether two are a side apart, and in which cells they are.
        #[test]
        fn whoever_is_just_a_side_away_is_around(
            side_m in 0.01..3.0f64, x in -9.0..9.0f64, y in -9.0..9.0f64,
        ) {
            let at = |i: i32, j: i32| Vec2::new(x + f64::from(i) * side_m, y + f64::from(j) * side_m);
            let points: Vec<Vec2> = (0..144).map(|i| at(i / 12, i % 12)).collect();
            let mut cells = Cells::default();
            cells.fill(&points, side_m);
            for (i, a) in points.iter().enumerate() {
                let around: Vec<usize> = cells.around(i).collect();
                for (j, b) in points.iter().enumerate() {
                    prop_assert!((a - b).norm() > side_m || around.contains(&j));
                }
            }
        }
    }

    #[test]
    fn cells_share_their_buckets_evenly_wherever_the_points_are() {
        let side = 64;
        for (x_m, y_m) in [(1.0, 1.0), (3.0, 1.0), (1.0, 1000.0), (1e4, 1e4)] {
            let at = |i: usize| Vec2::new((i % side) as f64 * x_m, (i / side) as f64 * y_m);
            let points: Vec<Vec2> = (0..side * side).map(at).collect();
            let mut cells = Cells::default();
            cells.fill(&points, 0.9);
            // As many buckets as points, each point in a cell of its own: were they drawn, more
            // than 9 in one bucket would be a chance of 1 in 200.
            let fullest = cells.begins.windows(2).map(|ends| ends[1] - ends[0]).max();
            assert!(fullest <= Some(12), "{x_m} {y_m}: {fullest:?}");
        }
    }

    #[test]
    fn of_many_scattered_robots_only_few_are_around_one() {
        let side = 100;
        let points: Vec<Vec2> =
            (0..side * side).map(|i| Vec2::new((i % side) as f64, (i / side) as f64)).collect();
        let mut cells = Cells::default();
        cells.fill(&points, 1.0);
        let around: usize = (0..points.len()).map(|i| cells.around(i).count()).sum();
        assert!(around <= 10 * points.len());
    }
}
