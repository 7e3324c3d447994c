//! Where robots start, drawn from a seed: front points even over a box, none nearer to another than
//! asked (Assumption 1), headings even over a turn.
//!
//! The draw depends on the seed, the box and the number of robots alone: runs that differ in anything
//! else start alike, and can be compared seed by seed.

use std::f64::consts::PI;

use experiment::scenario::Scenario;
use experiment::scenario::diagnostic::Diagnostic;
use experiment::scenario::table::Value;
use formation::Vec2;
use formation::front_point::front_point;
use formation::random::SplitMix64;

/// Told apart from other draws of the same seed.
const STREAM: u64 = u64::from_le_bytes(*b"starts  ");
/// So often a robot is drawn again, and so often all of them, before there is no room.
const TRIES: usize = 1000;
/// A drawn distance is larger than asked by this, m: what is written down rounds.
const HAIR_M: f64 = 1e-9;

/// The box that starts are drawn from.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Starts {
    /// Its width and height, m.
    pub box_m: [f64; 2],
    /// No two front points are nearer, m.
    pub apart_m: f64,
    /// Its middle, m; without, the mean of the scenario's own front points.
    pub center_m: Option<[f64; 2]>,
}

/// Why no starts could be drawn.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum NoStarts {
    /// Assumption 1 would not hold.
    #[error(
        "`apart_m` is {apart_m}, and d is {d_m}: Assumption 1 asks for starts farther apart than d"
    )]
    TooNear {
        /// Asked for, m.
        apart_m: f64,
        /// The scenario's, m.
        d_m: f64,
    },
    /// They do not fit.
    #[error("{robots} robots {apart_m} m apart find no room in a box of {} m by {} m with seed {seed}", .box_m[0], .box_m[1])]
    NoRoom {
        /// How many.
        robots: usize,
        /// How far apart, m.
        apart_m: f64,
        /// In this, m.
        box_m: [f64; 2],
        /// With this seed.
        seed: u64,
    },
}

impl Starts {
    pub(crate) fn read(value: &Value<'_>) -> Result<Starts, Diagnostic> {
        let table = value.table()?;
        let sides = table.need("box_m")?;
        let box_m = sides.pair()?;
        if box_m.iter().any(|side| *side <= 0.0) {
            return Err(sides.wrong("has a side without length", "expected two lengths above 0 m"));
        }
        let center = table.get("center_m").map(|center| center.pair()).transpose()?;
        Ok(Starts { box_m, apart_m: table.number("apart_m")?, center_m: center })
    }

    /// The start poses that a seed draws for a scenario's robots, as `--set` has them.
    pub fn draw(&self, scenario: &Scenario, seed: u64) -> Result<Vec<String>, NoStarts> {
        let d_m = scenario.avoidance.distance_min_m;
        if self.apart_m <= d_m {
            return Err(NoStarts::TooNear { apart_m: self.apart_m, d_m });
        }
        let robots = &scenario.robots;
        let own = |i: usize| front_point(robots[i].start, robots[i].front_point_m);
        let middle = match self.center_m {
            Some([x, y]) => Vec2::new(x, y),
            None => (0..robots.len()).map(own).sum::<Vec2>() / robots.len() as f64,
        };
        let mut random = SplitMix64::new(seed ^ STREAM);
        let places = self.places(&mut random, robots.len()).ok_or(NoStarts::NoRoom {
            robots: robots.len(),
            apart_m: self.apart_m,
            box_m: self.box_m,
            seed,
        })?;
        let start = |(place, robot): (Vec2, &experiment::scenario::Robot)| {
            // From 0 to below 1, turned around: above -pi, up to pi.
            let heading_rad = PI - 2.0 * PI * random.unit();
            let ahead = robot.front_point_m * Vec2::new(heading_rad.cos(), heading_rad.sin());
            let axle = middle + place - ahead;
            format!(
                "robot.{}.pose={{ x_m = {:?}, y_m = {:?}, heading_rad = {heading_rad:?} }}",
                robot.name, axle.x, axle.y
            )
        };
        Ok(places.into_iter().zip(robots).map(start).collect())
    }

    /// Places about the middle of the box; `None`: no room.
    fn places(&self, random: &mut SplitMix64, robots: usize) -> Option<Vec<Vec2>> {
        let [width, height] = self.box_m;
        for _ in 0..TRIES {
            let mut places: Vec<Vec2> = Vec::new();
            for _ in 0..TRIES {
                if places.len() == robots {
                    break;
                }
                let [x, y] = [width, height].map(|side| side * (random.unit() - 0.5));
                let place = Vec2::new(x, y);
                let far = |other: &Vec2| (place - other).norm() >= self.apart_m + HAIR_M;
                if places.iter().all(far) {
                    places.push(place);
                }
            }
            if places.len() == robots {
                return Some(places);
            }
        }
        None
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use experiment::examples::row_of_three;
    use proptest::prelude::*;

    const STARTS: Starts = Starts { box_m: [2.0, 1.0], apart_m: 0.3, center_m: Some([5.0, -1.0]) };

    #[test]
    fn a_box_without_room_and_one_against_assumption_1_are_refused() {
        let scenario = row_of_three();
        let small = Starts { box_m: [0.2, 0.2], ..STARTS };
        assert!(matches!(small.draw(&scenario, 1), Err(NoStarts::NoRoom { robots: 3, .. })));
        let near = Starts { apart_m: 0.2, ..STARTS };
        assert!(matches!(near.draw(&scenario, 1), Err(NoStarts::TooNear { .. })), "d is 0.2 m");
    }

    #[test]
    fn without_a_center_the_box_is_where_the_scenarios_own_starts_are() {
        let scenario = row_of_three();
        let own = Starts { center_m: None, ..STARTS }.draw(&scenario, 3).unwrap();
        let points = scenario.robots.iter().map(|r| front_point(r.start, r.front_point_m));
        let mean = points.sum::<Vec2>() / 3.0;
        let there = Starts { center_m: Some([mean.x, mean.y]), ..STARTS };
        assert_eq!(own, there.draw(&scenario, 3).unwrap());
    }

    fn number(text: &str, key: &str) -> f64 {
        let (_, rest) = text.split_once(&format!("{key} = ")).unwrap();
        rest.split([',', ' ']).next().unwrap().parse().unwrap()
    }

    proptest! {
        #[test]
        fn every_seed_starts_everybody_in_the_box_and_apart(seed in any::<u64>()) {
            let drawn = STARTS.draw(&row_of_three(), seed).unwrap();
            prop_assert_eq!(&drawn, &STARTS.draw(&row_of_three(), seed).unwrap());
            prop_assert!(drawn != STARTS.draw(&row_of_three(), seed ^ 1).unwrap());
            let points: Vec<Vec2> = drawn.iter().map(|text| {
                let heading = number(text, "heading_rad");
                assert!(-PI < heading && heading <= PI);
                let axle = Vec2::new(number(text, "x_m"), number(text, "y_m"));
                axle + 0.1 * Vec2::new(heading.cos(), heading.sin())
            }).collect();
            for (i, point) in points.iter().enumerate() {
                prop_assert!((point.x - 5.0).abs() <= 1.0 + 1e-9 && (point.y + 1.0).abs() <= 0.5 + 1e-9);
                for other in &points[..i] {
                    prop_assert!((point - other).norm() >= 0.3);
                }
            }
        }
    }
}
