//! Who is near whom, kept from one instant to the next.
//!
//! All pairs within a reach are listed with a margin (Verlet's list); the list is made anew, by way
//! of a cell grid, only when somebody has moved so far that the margin may be used up. Whoever walks
//! the list sees pairs in list order, and computes with them what he would with all pairs: the
//! result is the same, bit by bit, at a cost that grows with the number of near pairs.

use crate::cells::Cells;
use crate::closest::ClosestPair;
use crate::{ROUNDING, Vec2};

/// The margin for each of two points, as a share of the reach.
const MARGIN: f64 = 0.125;
/// So many instants are to pass from list to list, if a margin as large as the reach allows it.
const INSTANTS: f64 = 16.0;
/// Below so many points all pairs are looked at, and no grid filled. A guess, not yet measured.
const GRID_MIN: usize = 24;
/// Squares of distances and coordinates within these bounds, m, neither vanish nor overflow.
const LENGTH_M: std::ops::Range<f64> = 1e-100..1e100;

/// All pairs of points within a reach.
#[derive(Debug, Clone)]
pub struct NearPairs {
    reach_m: f64,
    /// Where everybody was when the list was made.
    then: Vec<Vec2>,
    /// The list holds until somebody is farther from there than this, m^2.
    moved_square_max: f64,
    /// How often it was found to hold.
    held: u64,
    /// Where the others of each point begin, and where those after it in list order do.
    begins: Vec<[u32; 2]>,
    /// For each point the places of all near it, ascending.
    others: Vec<u32>,
    cells: Cells,
}

impl NearPairs {
    /// Of no points yet, within `reach_m`, m.
    pub fn new(reach_m: f64) -> NearPairs {
        NearPairs {
            reach_m,
            then: Vec::new(),
            moved_square_max: -1.0,
            held: 0,
            begins: Vec::new(),
            others: Vec::new(),
            cells: Cells::default(),
        }
    }

    /// How near two points must be to be listed, m.
    pub fn reach_m(&self) -> f64 {
        self.reach_m
    }

    /// From the next update on, pairs within `reach_m` are listed, m.
    pub fn set_reach(&mut self, reach_m: f64) {
        self.reach_m = reach_m;
        self.moved_square_max = -1.0;
    }

    /// Takes in where the points are now. Afterwards every pair within the reach is listed, and
    /// some others; all pairs where coordinates are not finite or immense.
    pub fn update(&mut self, points: &[Vec2]) {
        let moved = |(now, then): (&Vec2, &Vec2)| (now - then).norm_squared();
        let pairs = || points.iter().zip(&self.then);
        // NaN is no place to hold on to.
        if points.len() == self.then.len()
            && pairs().all(|pair| moved(pair) <= self.moved_square_max)
        {
            self.held += 1;
            return;
        }
        let step_m = match self.moved_square_max >= 0.0 && points.len() == self.then.len() {
            true => pairs().map(moved).fold(0.0, f64::max).sqrt() / (self.held + 1) as f64,
            false => 0.0,
        };
        let margin_m = (MARGIN * self.reach_m).max((INSTANTS * step_m).min(self.reach_m));
        let near_m = self.reach_m + 2.0 * margin_m;
        self.moved_square_max = margin_m * margin_m * (1.0 - ROUNDING);
        self.held = 0;
        self.then.clear();
        self.then.extend_from_slice(points);
        self.begins.clear();
        self.others.clear();
        let most_m = LENGTH_M.end;
        let tame = |point: &Vec2| point.x.abs() < most_m && point.y.abs() < most_m; // no NaN either
        if !LENGTH_M.contains(&near_m) || !points.iter().all(tame) {
            self.list(|i| (0..points.len()).filter(move |&j| j != i));
            return;
        }
        // Rounding: what may move is taken a little shorter, so that this need not be longer.
        let near_square = near_m * near_m;
        let near =
            &|i: usize, j: usize| j != i && (points[i] - points[j]).norm_squared() <= near_square;
        if points.len() < GRID_MIN {
            self.list(|i| (0..points.len()).filter(move |&j| near(i, j)));
            return;
        }
        let mut cells = std::mem::take(&mut self.cells);
        cells.fill(points, near_m);
        self.list(|i| cells.around(i).filter(move |&j| near(i, j)));
        self.cells = cells;
    }

    /// Makes the list of what `find` gives for each point, in any order.
    fn list<I: Iterator<Item = usize>>(&mut self, find: impl Fn(usize) -> I) {
        for point in 0..self.then.len() {
            let begin = self.others.len();
            self.others.extend(find(point).map(|other| other as u32));
            let found = &mut self.others[begin..];
            found.sort_unstable();
            let after = begin + found.partition_point(|&other| (other as usize) < point);
            self.begins.push([begin as u32, after as u32]);
        }
        self.begins.push([self.others.len() as u32; 2]);
    }

    /// Places of those near `point`, ascending.
    pub fn of(&self, point: usize) -> impl Iterator<Item = usize> {
        let range = self.begins[point][0] as usize..self.begins[point + 1][0] as usize;
        self.others[range].iter().map(|&other| other as usize)
    }

    /// The closest two of the pairs listed: of all pairs, where they are within the reach. Of
    /// equals, the first in list order. `points` are those of the last update.
    pub fn closest(&self, points: &[Vec2]) -> Option<ClosestPair> {
        let mut closest: Option<([usize; 2], f64)> = None;
        for (i, (a, ends)) in points.iter().zip(self.begins.windows(2)).enumerate() {
            for &j in &self.others[ends[0][1] as usize..ends[1][0] as usize] {
                let square = (a - points[j as usize]).norm_squared();
                if closest.is_none_or(|(_, least)| square < least) {
                    closest = Some(([i, j as usize], square));
                }
            }
        }
        closest.map(|(pair, square)| ClosestPair { pair, distance_m: square.sqrt() })
    }
}

#[cfg(test)]
pub(crate) mod tests {
    use super::*;
    use crate::cells::tests::crowd;
    use proptest::prelude::*;

    /// What coordinates may become where something is badly broken.
    fn broken() -> impl Strategy<Value = f64> {
        prop::sample::select(vec![f64::NAN, f64::INFINITY, f64::NEG_INFINITY, 1e200, -1e160])
    }

    /// A motion: where everybody is at each of some instants. Most move slowly, one jumps, and one
    /// may be broken at some instants.
    pub(crate) fn motion() -> impl Strategy<Value = Vec<Vec<Vec2>>> {
        let jump = (0..30_usize, any::<prop::sample::Index>(), -3.0..3.0f64);
        let broken = prop::option::of((
            0..30_usize,
            prop::option::of(any::<prop::sample::Index>()),
            broken(),
        ));
        let slow = prop_oneof![Just(0.0), Just(1e-17), 1e-4..0.2f64];
        (crowd(), slow, any::<u64>(), jump, broken).prop_map(
            |(start, speed, seed, (jump_at, jumps, by), broken)| {
                (0..30)
                    .map(|instant| {
                        let mut now = start.clone();
                        for (i, point) in now.iter_mut().enumerate() {
                            let toward = (seed % 1000) as f64 * (i + 1) as f64;
                            let (sin, cos) = toward.sin_cos();
                            *point += Vec2::new(cos, sin) * (speed * instant as f64);
                        }
                        if now.is_empty() {
                            return now;
                        }
                        if instant >= jump_at {
                            let place = jumps.index(now.len());
                            now[place].x += by;
                        }
                        if let Some((at, who, what)) = broken
                            && (at..at + 3).contains(&instant)
                        {
                            // Often the first, whose distances count as those of the closest pair.
                            let place = who.map_or(0, |who| who.index(now.len()));
                            now[place].y = what;
                        }
                        now
                    })
                    .collect()
            },
        )
    }

    proptest! {
        #[test]
        fn whoever_is_within_reach_is_listed_at_every_instant_of_a_motion(
            motion in motion(), reach_m in prop_oneof![Just(0.0), 0.1..2.0f64, Just(f64::INFINITY)],
        ) {
            let mut near = NearPairs::new(reach_m);
            for points in motion {
                near.update(&points);
                for (i, a) in points.iter().enumerate() {
                    let listed: Vec<usize> = near.of(i).collect();
                    prop_assert!(listed.windows(2).all(|two| two[0] < two[1]));
                    for (j, b) in points.iter().enumerate() {
                        let within = j != i && (a - b).norm() <= reach_m;
                        prop_assert!(!within || listed.binary_search(&j).is_ok());
                    }
                }
            }
        }

        /// The margin is no more than the reach, on either side, when the list is made.
        #[test]
        fn nobody_farther_than_three_times_the_reach_is_listed_anew(
            motion in motion(), reach_m in 0.1..2.0f64,
        ) {
            let mut near = NearPairs::new(reach_m);
            let tame = |points: &&Vec<Vec2>| {
                points.iter().all(|p| p.x.abs() < LENGTH_M.end && p.y.abs() < LENGTH_M.end)
            };
            for points in motion.iter().filter(tame) {
                near.update(points);
                for (i, then) in near.then.iter().enumerate() {
                    let far = near.of(i).map(|j| (then - near.then[j]).norm()).fold(0.0, f64::max);
                    prop_assert!(far <= 3.0 * reach_m * (1.0 + 1e-6), "{far} of {reach_m}");
                }
            }
        }
    }

    #[test]
    fn a_list_is_made_anew_before_rounding_can_hide_who_came_within_reach() {
        let points = |apart_m: f64| [Vec2::zeros(), Vec2::new(apart_m, 0.0)];
        let mut near = NearPairs::new(1.0);
        // Just too far apart for the list, then each nearer by its margin and a billionth of it.
        near.update(&points(1.25 + 1e-12));
        assert_eq!(near.of(0).count(), 0);
        let step = Vec2::new(0.125 * (1.0 + 3e-10), 0.0);
        let [a, b] = points(1.25 + 1e-12);
        let now = [a + step, b - step];
        assert!((now[0] - now[1]).norm() < 1.0);
        near.update(&now);
        assert_eq!(near.of(0).count(), 1);
    }

    /// How many lists are made of robots that keep their places to each other, and all move by
    /// `step_m` from one instant to the next.
    fn lists_made(reach_m: f64, step_m: f64, instants: u32) -> u32 {
        let mut near = NearPairs::new(reach_m);
        let lattice = (0..400).map(|i| Vec2::new((i % 20) as f64, (i / 20) as f64));
        let lattice: Vec<Vec2> = lattice.collect();
        let made = (0..instants).map(|instant| {
            let way = Vec2::new(step_m * f64::from(instant), 0.0);
            near.update(&lattice.iter().map(|place| place + way).collect::<Vec<_>>());
            u32::from(near.held == 0)
        });
        made.sum()
    }

    #[test]
    fn a_list_lasts_16_instants_or_for_as_long_as_a_margin_of_the_reach_allows() {
        assert_eq!(lists_made(0.5, 0.0, 100), 1, "nobody moves");
        // The first has a margin of an eighth of the reach, none has more than the reach.
        for (step_m, first, lasts) in [(0.02, 4, 16), (0.01, 7, 16), (0.1, 1, 5), (0.001, 63, 63)] {
            let expected = 2 + (100 - first) / lasts;
            assert_eq!(lists_made(0.5, step_m, 101), expected, "{step_m}");
        }
    }

    #[test]
    fn robots_that_move_in_a_wide_lattice_have_short_lists_that_last() {
        let mut near = NearPairs::new(0.5);
        let lattice: Vec<Vec2> =
            (0..400).map(|i| Vec2::new((i % 20) as f64, (i / 20) as f64)).collect();
        let mut made = 0;
        for instant in 0..100 {
            let points: Vec<Vec2> = lattice
                .iter()
                .map(|place| place + Vec2::new(0.002 * f64::from(instant), 0.0))
                .collect();
            near.update(&points);
            made += u32::from(near.held == 0);
            assert!((0..400).all(|i| near.of(i).count() == 0));
        }
        assert!(made <= 5, "{made}");
    }
}
