//! Opening of a formation while it forms: whether it is needed, how wide, and for how long.
//!
//! A robot passes between two others in their slots if their distance is more than twice its steering distance. Through
//! narrower gaps the last robots cannot pass, unless the formation stays open until all have arrived (`scale = { kind =
//! "closing" }`).

use std::f64::consts::PI;

use formation::Vec2;
use formation::closest::{ClosestPair, closest_pair};
use formation::front_point::rotate;
use formation::portable_math;
use formation::pose::wrap_angle;
use serde::Serialize;

use super::start_front_points;
use super::steady::planned_positions;
use crate::scenario::Scenario;

/// Minimum gap of an open formation, as a multiple of the gap that a robot passes through.
const OPEN_GAP_FACTOR: f64 = 1.05;
/// Minimum gap of an open formation divided by the square root of the number of robots, as a multiple of the gap that a
/// robot passes through. On their way all robots meet in a crowd whose width grows with that root. A robot whose slot
/// is close to its in-neighbors stays in the crowd. Measured by `scenarios/campaigns/lattices-open.toml`: in 20 runs of
/// 30 robots that receive from each other, 17 never left the crowd at gaps of 2.4 d, and all arrived at 7.2 d, the
/// value of this constant.
const OPEN_GAP_ROBOT_COUNT_FACTOR: f64 = 0.625;
/// Time for which the formation stays open, as a multiple of the longest travel time.
const OPEN_TIME_FACTOR: f64 = 2.5;
/// Time for which the formation stays open per hop of the graph diameter, as a multiple of the longest travel time. In
/// a row each robot can only follow the one before it.
const OPEN_TIME_PER_HOP_FACTOR: f64 = 0.25;
/// Factor on the open time if the graph has a directed cycle, in which robots wait for each other.
const OPEN_TIME_CYCLE_FACTOR: f64 = 1.5;
/// Maximum speed of slots while the formation closes, as a fraction of the robots' speed.
const CLOSING_SPEED_FRACTION_MAX: f64 = 0.75;

/// Recommended opening of a formation.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Opening {
    /// Smallest distance of two slots at scale 1, m.
    pub gap_m: f64,
    /// Minimum gap that a robot passes through, m.
    pub passage_m: f64,
    /// Scale of the open formation, at which all gaps are wide enough.
    pub from: f64,
    /// Longest distance from a start to its slot in the open formation, m.
    pub way_m: f64,
    /// Speed that all robots can reach, m/s.
    pub speed_m_s: f64,
    /// Time for which to stay open, s.
    pub hold_s: f64,
    /// Duration of the closing, s.
    pub over_s: f64,
    /// Indices of the two robots with the smallest gap, and of the robot with the longest distance.
    #[serde(skip)]
    pub(super) closest_pair_and_farthest: ([usize; 2], usize),
}

impl Opening {
    /// Computes the recommended opening. Returns `None` if fewer than two robots keep slots, the slots do not follow
    /// from the graph, or two slots coincide.
    pub fn compute(scenario: &Scenario) -> Option<Opening> {
        let slot_robots = scenario.leaders();
        if slot_robots.len() < 2 || scenario.anchors_m().iter().all(Option::is_some) {
            return None;
        }
        let planned = planned_positions(scenario)?;
        let slots: Vec<Vec2> = slot_robots.iter().map(|&i| planned[i]).collect();
        let closest = closest_pair(&slots).filter(|closest| closest.distance_m > 0.0);
        let ClosestPair { pair, distance_m: gap_m } = closest?;
        let steering_m = scenario.steering_distances_m().unwrap_or_default();
        let used_steering_m = slot_robots.iter().filter_map(|&i| steering_m.get(i));
        let passage_m = 2.0 * used_steering_m.copied().fold(0.0, f64::max);
        let gap_min_m = passage_m.max(2.0 * scenario.avoidance.distance_min_m);
        let open_gap_m = gap_min_m
            * OPEN_GAP_FACTOR.max(OPEN_GAP_ROBOT_COUNT_FACTOR * (slot_robots.len() as f64).sqrt());
        let from = round_up_to_fraction(open_gap_m / gap_m, 1e3).max(1.0);

        let starts = start_front_points(&scenario.robots);
        let starts: Vec<Vec2> = slot_robots.iter().map(|&i| starts[i]).collect();
        let mean = |points: &[Vec2]| points.iter().sum::<Vec2>() / points.len() as f64;
        // Slot that is the fixed point of the scaling, its position, and the rotation of the formation.
        let (fixed_slot, fixed_position, rotation_rad) =
            match (scenario.leader(), &scenario.graph.roots()[..]) {
                (Some(leader), _) => {
                    let position = scenario.lead.as_ref()?.trajectory.target_at(0.0).position;
                    (Vec2::zeros(), position, scenario.robots[leader].start.heading_rad)
                }
                (None, &[root]) => {
                    let index = slot_robots.iter().position(|&i| i == root)?;
                    (slots[index], starts[index], 0.0)
                }
                (None, _) => (mean(&slots), mean(&starts), 0.0),
            };
        let from_fixed = |slot: &Vec2| rotate(rotation_rad, slot - fixed_slot);
        let distances_m = slots.iter().zip(&starts);
        let distances_m = distances_m
            .map(|(slot, start)| (fixed_position + from * from_fixed(slot) - start).norm());
        let (farthest, way_m) = distances_m.enumerate().max_by(|a, b| a.1.total_cmp(&b.1))?;
        let reach_m = slots.iter().map(|slot| from_fixed(slot).norm()).fold(0.0, f64::max);
        let hops = scenario.graph.hop_counts();
        let pairs = || slot_robots.iter().flat_map(|&i| slot_robots.iter().map(move |&j| (i, j)));
        let hops_max = pairs().filter_map(|(i, j)| hops[i][j]).max()?;
        let has_cycle = pairs().any(|(i, j)| i < j && hops[i][j].and(hops[j][i]).is_some());
        let margin = OPEN_TIME_FACTOR.max(OPEN_TIME_PER_HOP_FACTOR * hops_max as f64)
            * if has_cycle { OPEN_TIME_CYCLE_FACTOR } else { 1.0 };
        let v_max = scenario.avoidance.speed_max_m_s;
        let speeds_m_s = slot_robots.iter().map(|&i| scenario.robots[i].correction_max_m_s);
        let speed_m_s = speeds_m_s.map(|speed| speed.unwrap_or(v_max)).fold(v_max, f64::min);
        // The maximum speed along half a cosine is pi/2 times the mean.
        let closing_s =
            0.5 * PI * (from - 1.0) * reach_m / (CLOSING_SPEED_FRACTION_MAX * speed_m_s);
        Some(Opening {
            gap_m,
            passage_m,
            from,
            way_m,
            speed_m_s,
            hold_s: round_up_to_fraction(margin * way_m / speed_m_s, 1.0).max(1.0),
            over_s: round_up_to_fraction(closing_s, 1.0).max(1.0),
            closest_pair_and_farthest: (
                pair.map(|index| slot_robots[index]),
                slot_robots[farthest],
            ),
        })
    }
}

/// Returns a robot whose slot lies inside a closed ring of gaps narrower than `passage_m`. If it arrives late, it
/// cannot reach its slot. Returns `None` if there is none, or if no robot has to pass another on its straight way.
pub(super) fn find_enclosed_slot(scenario: &Scenario, passage_m: f64) -> Option<usize> {
    let slot_robots = scenario.leaders();
    let planned = planned_positions(scenario)?;
    let slots: Vec<Vec2> = slot_robots.iter().map(|&i| planned[i]).collect();
    let starts = start_front_points(&scenario.robots);
    let rotation_rad = scenario.leader().map_or(0.0, |i| scenario.robots[i].start.heading_rad);
    let is_blocked = |i: usize, j: usize| {
        let start = starts[slot_robots[i]] - starts[slot_robots[j]];
        let end = rotate(rotation_rad, slots[i] - slots[j]);
        distance_from_origin(start, end) < 0.5 * passage_m
    };
    let mut pairs = (0..slot_robots.len()).flat_map(|i| (0..i).map(move |j| (i, j)));
    if !pairs.any(|(i, j)| is_blocked(i, j)) {
        return None;
    }
    let is_near = |i: usize, j: usize| i != j && (slots[i] - slots[j]).norm() < passage_m;
    let adjacent: Vec<Vec<usize>> = (0..slot_robots.len())
        .map(|i| (0..slot_robots.len()).filter(|&j| is_near(i, j)).collect())
        .collect();
    (0..slot_robots.len())
        .find(|&i| is_enclosed_by_ring(i, &slots, &adjacent))
        .map(|i| slot_robots[i])
}

/// Returns the distance of the segment from `start` to `end` from the origin.
fn distance_from_origin(start: Vec2, end: Vec2) -> f64 {
    let along = end - start;
    let fraction =
        (-start.dot(&along) / along.norm_squared().max(f64::MIN_POSITIVE)).clamp(0.0, 1.0);
    (start + fraction * along).norm()
}

/// Returns whether the adjacent slots form a ring around slot `middle`. In that case the accumulated bearing of a slot,
/// seen from `middle`, depends on the path to it.
fn is_enclosed_by_ring(middle: usize, slots: &[Vec2], adjacent: &[Vec<usize>]) -> bool {
    let bearing = |i: usize| {
        let from = slots[i] - slots[middle];
        portable_math::atan2(from.y, from.x)
    };
    let mut bearings: Vec<Option<f64>> = vec![None; slots.len()];
    for start in (0..slots.len()).filter(|&i| i != middle) {
        if bearings[start].is_some() {
            continue;
        }
        bearings[start] = Some(0.0);
        let mut pending = vec![start];
        while let Some(slot) = pending.pop() {
            let so_far = bearings[slot].unwrap_or_default();
            for &next in adjacent[slot].iter().filter(|&&next| next != middle) {
                let angle = so_far + wrap_angle(bearing(next) - bearing(slot));
                match bearings[next] {
                    Some(known) if (known - angle).abs() > PI => return true,
                    Some(_) => {}
                    None => {
                        bearings[next] = Some(angle);
                        pending.push(next);
                    }
                }
            }
        }
    }
    false
}

/// Rounds up to a multiple of 1 / `per_unit`.
fn round_up_to_fraction(number: f64, per_unit: f64) -> f64 {
    (number * per_unit - 1e-6).ceil() / per_unit
}

#[cfg(test)]
mod tests {
    use formation::graph::{Edge, FormationGraph};
    use formation::scale::Scale;

    use super::*;
    use crate::examples::row_of_three;

    /// Returns a lattice of slots 0.22 m apart. All robots start at the same point and receive from the robots to their
    /// left and below, or with `both_ways` all adjacent ones. There is no steering: gaps of 2 d are wide enough.
    fn lattice_scenario(columns: usize, rows: usize, both_ways: bool) -> Scenario {
        let mut scenario = row_of_three();
        scenario.robots = vec![scenario.robots[0].clone(); columns * rows];
        let to_the_right = (0..columns * rows).filter(|i| (i + 1) % columns > 0);
        let to_the_right = to_the_right.map(|i| (i, i + 1, Vec2::new(0.22, 0.0)));
        let above = (columns..columns * rows).map(|i| (i - columns, i, Vec2::new(0.0, 0.22)));
        let edges = to_the_right.chain(above).flat_map(|(from, to, offset_m)| {
            let back = both_ways.then_some(Edge { from: to, to: from, offset_m: -offset_m });
            [Some(Edge { from, to, offset_m }), back].into_iter().flatten()
        });
        scenario.graph = FormationGraph::new(columns * rows, edges.collect());
        scenario
    }

    /// Returns the opening in multiples of the passage width, the open time, s, and the longest travel time, s.
    fn opening_of_grid(columns: usize, rows: usize, both_ways: bool) -> (f64, f64, f64) {
        let scenario = lattice_scenario(columns, rows, both_ways);
        let opening = Opening::compute(&scenario).expect("all robots keep a slot");
        let passage_m = 2.0 * scenario.avoidance.distance_min_m;
        let hundredths = |x: f64| (100.0 * x).round() / 100.0;
        let passages = opening.from * opening.gap_m / passage_m;
        (hundredths(passages), opening.hold_s, opening.way_m / opening.speed_m_s)
    }

    #[test]
    fn opening_grows_with_robots_mutual_edges_and_row_length() {
        for ((columns, rows, both_ways), passages, travel_factor) in [
            // Four times as many robots open twice as wide.
            ((4, 4, false), 2.5, 2.5),
            ((8, 8, false), 5.0, 0.25 * 14.0),
            ((2, 1, false), 1.05, 2.5),
            ((4, 3, true), 2.17, 1.5 * 2.5),
            ((12, 1, false), 2.17, 0.25 * 11.0),
            ((12, 1, true), 2.17, 1.5 * 0.25 * 11.0),
        ] {
            let (open, hold_s, travel_s) = opening_of_grid(columns, rows, both_ways);
            assert_eq!(open, passages, "{columns} x {rows}");
            assert_eq!(hold_s, f64::ceil(travel_factor * travel_s), "{columns} x {rows}");
        }
    }

    #[test]
    fn closing_slots_move_at_most_at_three_quarters_of_the_speed() {
        let scenario = lattice_scenario(4, 3, false);
        let Opening { from, over_s, speed_m_s, .. } = Opening::compute(&scenario).unwrap();
        let scale = Scale::Closing { from, hold_s: 0.0, over_s, reopen_at_s: Vec::new() };
        let reach_m = 0.22 * f64::hypot(3.0, 2.0);
        let fastest_m_s = reach_m * scale.value_and_rate_at(0.5 * over_s).1.abs();
        assert!(fastest_m_s <= 0.75 * speed_m_s, "{fastest_m_s}");
        assert!(fastest_m_s > 0.7 * speed_m_s, "{fastest_m_s}");
    }

    fn enclosed_robots(points: &[Vec2], near_m: f64) -> Vec<usize> {
        let is_near = |a: &Vec2, b: &Vec2| a != b && (a - b).norm() < near_m;
        let adjacent = |a: &Vec2| (0..points.len()).filter(|&j| is_near(a, &points[j])).collect();
        let adjacent: Vec<Vec<usize>> = points.iter().map(adjacent).collect();
        (0..points.len()).filter(|&i| is_enclosed_by_ring(i, points, &adjacent)).collect()
    }

    #[test]
    fn dense_lattice_encloses_inner_slots_only() {
        let lattice: Vec<Vec2> =
            (0..12).map(|i| Vec2::new(f64::from(i % 4), f64::from(i / 4))).collect();
        assert_eq!(enclosed_robots(&lattice, 1.1), [5, 6]);
        assert_eq!(enclosed_robots(&lattice, 0.9), [0; 0], "no two robots are near each other");
        let without_a_corner: Vec<Vec2> = lattice[1..].to_vec();
        assert_eq!(enclosed_robots(&without_a_corner, 1.1), [5], "r6 may be reached by the corner");
        assert_eq!(enclosed_robots(&without_a_corner, 1.5), [4, 5], "diagonally it is too narrow");
    }

    #[test]
    fn row_and_pentagon_have_no_ringed_robot() {
        let row: Vec<Vec2> = (0..5).map(|i| Vec2::new(f64::from(i), 0.0)).collect();
        assert_eq!(enclosed_robots(&row, 1.5), [0; 0]);
        let corner =
            |i: i32| Vec2::new((0.4 * PI * f64::from(i)).cos(), (0.4 * PI * f64::from(i)).sin());
        let pentagon: Vec<Vec2> = (0..5).map(corner).collect();
        assert_eq!(enclosed_robots(&pentagon, 1.3), [0; 0]);
        let around_one = [pentagon, vec![Vec2::zeros()]].concat();
        assert_eq!(enclosed_robots(&around_one, 1.3), [5]);
    }

    #[test]
    fn swapping_robots_meet_and_parallel_robots_do_not() {
        let ahead = Vec2::new(1.0, 0.2);
        assert!(distance_from_origin(ahead, -ahead) < 1e-12);
        assert_eq!(distance_from_origin(ahead, ahead), ahead.norm());
        assert_eq!(distance_from_origin(ahead, 2.0 * ahead), ahead.norm());
        assert!(
            (distance_from_origin(Vec2::new(1.0, 0.2), Vec2::new(-1.0, 0.2)) - 0.2).abs() < 1e-12
        );
    }
}
