//! Must a formation open while it forms, how far, and for how long?
//!
//! A robot passes between two others that stand in their places if these are farther apart than
//! twice the distance at which it is led around each. Through narrower gaps the last to come find no
//! way in, unless the formation is open until all have arrived (`scale = { kind = "closing" }`).

use std::f64::consts::PI;

use formation::Vec2;
use formation::closest::{ClosestPair, closest_pair};
use formation::front_point::rotate;
use formation::pose::wrap_angle;
use serde::Serialize;

use super::start_points;
use super::steady::places;
use crate::scenario::Scenario;

/// An open formation has gaps of so many d. Measured: of 12 robots nobody gets stuck then.
const OPEN_GAPS: f64 = 2.4;
/// And of so many times what a robot passes through, where that is more.
const OPEN_PASSAGES: f64 = 1.05;
/// It stays open so many times as long as the longest way takes, for each robot: the more there are, the
/// more are in the way. Measured: with twice in all, none of 40 lattices of 12 robots got stuck, but 4 of
/// 6 of 30 robots; with six times, none of 4.
const HOLD_PER_ROBOT: f64 = 0.2;
/// But so many times at least.
const HOLD_MIN: f64 = 2.0;
/// And so many times that where no robot's place is fixed: everybody waits for everybody. Measured: of
/// 24 lattices of 12 robots with edges both ways 3 got stuck with four times the way, none with eight.
const ADRIFT: f64 = 3.5;
/// While it closes, places move at this share of the robots' speed at most.
const CLOSING_SPEED: f64 = 0.5;

/// How a formation is to open and to close again.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Opening {
    /// Smallest distance of two places at scale 1, m.
    pub gap_m: f64,
    /// Through gaps wider than this a robot passes, m.
    pub passage_m: f64,
    /// How far to open: the scale at which all gaps are wide.
    pub from: f64,
    /// The longest way from a start to a place of the open formation, m.
    pub way_m: f64,
    /// How fast all robots can go there, m/s.
    pub speed_m_s: f64,
    /// How long to stay open, s.
    pub hold_s: f64,
    /// How long to take to close, s.
    pub over_s: f64,
    /// Between which two places the smallest gap is, and whose way is the longest.
    #[serde(skip)]
    pub(super) who: ([usize; 2], usize),
}

impl Opening {
    /// `None` where nobody keeps a place, none follows from the graph, or two are the same.
    pub fn of(scenario: &Scenario) -> Option<Opening> {
        let kept = scenario.leaders();
        if kept.len() < 2 || scenario.goals_m().is_some() {
            return None;
        }
        let places = places(scenario)?;
        let places: Vec<Vec2> = kept.iter().map(|&i| places[i]).collect();
        let closest = closest_pair(&places).filter(|closest| closest.distance_m > 0.0);
        let ClosestPair { pair, distance_m: gap_m } = closest?;
        let steered_m = kept.iter().filter_map(|&i| scenario.steers_within_m(i));
        let passage_m = 2.0 * steered_m.fold(0.0, f64::max);
        let open_m = (OPEN_GAPS * scenario.avoidance.distance_min_m).max(OPEN_PASSAGES * passage_m);
        let from = rounded_up(open_m / gap_m, 1e3).max(1.0);

        let starts = start_points(&scenario.robots);
        let starts: Vec<Vec2> = kept.iter().map(|&i| starts[i]).collect();
        let mean = |points: &[Vec2]| points.iter().sum::<Vec2>() / points.len() as f64;
        // Which place stays where it is while the others move away from it, and where that is.
        let adrift = scenario.leader().is_none() && scenario.graph.roots().len() > 1;
        let (fixed, at, turned_rad) = match (scenario.leader(), &scenario.graph.roots()[..]) {
            (Some(leader), _) => {
                let begin = scenario.lead.as_ref()?.trajectory.at(0.0).position;
                (Vec2::zeros(), begin, scenario.robots[leader].start.heading_rad)
            }
            (None, &[root]) => {
                let place = kept.iter().position(|&i| i == root)?;
                (places[place], starts[place], 0.0)
            }
            (None, _) => (mean(&places), mean(&starts), 0.0),
        };
        let from_fixed = |place: &Vec2| rotate(turned_rad, place - fixed);
        let ways_m = places.iter().zip(&starts);
        let ways_m = ways_m.map(|(place, start)| (at + from * from_fixed(place) - start).norm());
        let (farthest, way_m) = ways_m.enumerate().max_by(|a, b| a.1.total_cmp(&b.1))?;
        let reach_m = places.iter().map(|place| from_fixed(place).norm()).fold(0.0, f64::max);
        // From one end to the other, and not only from the middle.
        let margin = (HOLD_PER_ROBOT * kept.len() as f64).max(HOLD_MIN);
        let (margin, reach_m) = match adrift {
            true => (ADRIFT * margin, 2.0 * reach_m),
            false => (margin, reach_m),
        };
        let v_max = scenario.avoidance.speed_max_m_s;
        let speeds_m_s = kept.iter().map(|&i| scenario.robots[i].correction_max_m_s);
        let speed_m_s = speeds_m_s.map(|speed| speed.unwrap_or(v_max)).fold(v_max, f64::min);
        // Along half a cosine the fastest is pi/2 times the mean.
        let closing_s = 0.5 * PI * (from - 1.0) * reach_m / (CLOSING_SPEED * speed_m_s);
        Some(Opening {
            gap_m,
            passage_m,
            from,
            way_m,
            speed_m_s,
            hold_s: rounded_up(margin * way_m / speed_m_s, 1.0).max(1.0),
            over_s: rounded_up(closing_s, 1.0).max(1.0),
            who: (pair.map(|place| kept[place]), kept[farthest]),
        })
    }
}

/// Whose place lies within a closed ring of gaps that nobody passes through, m: whoever comes late to
/// it finds no way in. `None` as well where everybody goes straight to its place and nobody has to
/// pass anybody.
pub(super) fn locked_out(scenario: &Scenario, passage_m: f64) -> Option<usize> {
    let kept = scenario.leaders();
    let all = places(scenario)?;
    let places: Vec<Vec2> = kept.iter().map(|&i| all[i]).collect();
    let starts = start_points(&scenario.robots);
    let turned_rad = scenario.leader().map_or(0.0, |i| scenario.robots[i].start.heading_rad);
    let passes = |i: usize, j: usize| {
        let begin = starts[kept[i]] - starts[kept[j]];
        let end = rotate(turned_rad, places[i] - places[j]);
        nearest_to_zero(begin, end) < 0.5 * passage_m
    };
    let mut pairs = (0..kept.len()).flat_map(|i| (0..i).map(move |j| (i, j)));
    if !pairs.any(|(i, j)| passes(i, j)) {
        return None;
    }
    let near = |i: usize, j: usize| i != j && (places[i] - places[j]).norm() < passage_m;
    let beside: Vec<Vec<usize>> =
        (0..kept.len()).map(|i| (0..kept.len()).filter(|&j| near(i, j)).collect()).collect();
    (0..kept.len()).find(|&i| is_ringed(i, &places, &beside)).map(|i| kept[i])
}

/// How near the segment from `begin` to `end` comes to zero.
fn nearest_to_zero(begin: Vec2, end: Vec2) -> f64 {
    let along = end - begin;
    let share = (-begin.dot(&along) / along.norm_squared().max(f64::MIN_POSITIVE)).clamp(0.0, 1.0);
    (begin + share * along).norm()
}

/// Whether steps between places beside each other lead once around place `middle`: then the angle at
/// which a place is seen from there depends on the way by which one comes to it.
fn is_ringed(middle: usize, places: &[Vec2], beside: &[Vec<usize>]) -> bool {
    let bearing = |i: usize| {
        let from = places[i] - places[middle];
        from.y.atan2(from.x)
    };
    let mut turned: Vec<Option<f64>> = vec![None; places.len()];
    for first in (0..places.len()).filter(|&i| i != middle) {
        if turned[first].is_some() {
            continue;
        }
        turned[first] = Some(0.0);
        let mut open = vec![first];
        while let Some(here) = open.pop() {
            let so_far = turned[here].unwrap_or_default();
            for &next in beside[here].iter().filter(|&&next| next != middle) {
                let angle = so_far + wrap_angle(bearing(next) - bearing(here));
                match turned[next] {
                    Some(known) if (known - angle).abs() > PI => return true,
                    Some(_) => {}
                    None => {
                        turned[next] = Some(angle);
                        open.push(next);
                    }
                }
            }
        }
    }
    false
}

/// The next number of `per_unit` to the unit.
fn rounded_up(number: f64, per_unit: f64) -> f64 {
    (number * per_unit - 1e-6).ceil() / per_unit
}

#[cfg(test)]
mod tests {
    use super::*;

    fn beside(places: &[Vec2], near_m: f64) -> Vec<Vec<usize>> {
        let near = |a: &Vec2, b: &Vec2| a != b && (a - b).norm() < near_m;
        let of = |a: &Vec2| (0..places.len()).filter(|&j| near(a, &places[j])).collect();
        places.iter().map(of).collect()
    }

    fn ringed(places: &[Vec2], near_m: f64) -> Vec<usize> {
        let beside = beside(places, near_m);
        (0..places.len()).filter(|&i| is_ringed(i, places, &beside)).collect()
    }

    #[test]
    fn the_middle_of_a_dense_lattice_is_ringed_and_its_rim_is_not() {
        let lattice: Vec<Vec2> =
            (0..12).map(|i| Vec2::new(f64::from(i % 4), f64::from(i / 4))).collect();
        assert_eq!(ringed(&lattice, 1.1), [5, 6]);
        assert_eq!(ringed(&lattice, 0.9), [0; 0], "nobody is near anybody");
        let without_a_corner: Vec<Vec2> = lattice[1..].to_vec();
        assert_eq!(ringed(&without_a_corner, 1.1), [5], "r6 may be reached by the corner");
        assert_eq!(ringed(&without_a_corner, 1.5), [4, 5], "diagonally it is too narrow");
    }

    #[test]
    fn a_row_and_a_pentagon_ring_nobody() {
        let row: Vec<Vec2> = (0..5).map(|i| Vec2::new(f64::from(i), 0.0)).collect();
        assert_eq!(ringed(&row, 1.5), [0; 0]);
        let corner =
            |i: i32| Vec2::new((0.4 * PI * f64::from(i)).cos(), (0.4 * PI * f64::from(i)).sin());
        let pentagon: Vec<Vec2> = (0..5).map(corner).collect();
        assert_eq!(ringed(&pentagon, 1.3), [0; 0]);
        let around_one = [pentagon, vec![Vec2::zeros()]].concat();
        assert_eq!(ringed(&around_one, 1.3), [5]);
    }

    #[test]
    fn two_that_change_places_meet_and_two_that_move_together_do_not() {
        let ahead = Vec2::new(1.0, 0.2);
        assert!(nearest_to_zero(ahead, -ahead) < 1e-12);
        assert_eq!(nearest_to_zero(ahead, ahead), ahead.norm());
        assert_eq!(nearest_to_zero(ahead, 2.0 * ahead), ahead.norm());
        assert!((nearest_to_zero(Vec2::new(1.0, 0.2), Vec2::new(-1.0, 0.2)) - 0.2).abs() < 1e-12);
    }
}
