//! Fixed convex obstacles and nearest-point queries.
//!
//! Obstacles are convex because the vector from the nearest point of a convex set to a query point changes by
//! at most the displacement of the query point (`proof/Obstacles.v::the_rest_is_not_longer`). A non-convex
//! obstacle is composed of convex parts.

use serde::{Deserialize, Serialize};

use crate::Vec2;
use crate::portable_math;

/// Minimum distance between consecutive corners, m. Closer corners are refused as coincident.
pub const CORNER_DISTANCE_M_MIN: f64 = 1e-6;
/// Maximum number of corners of one obstacle.
pub const CORNERS_MAX: usize = 64;

/// A fixed convex obstacle.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(tag = "kind", rename_all = "kebab-case", deny_unknown_fields)]
#[expect(missing_docs, reason = "the names say what the fields are")]
pub enum Obstacle {
    /// A disc around `center_m`.
    Disc { center_m: [f64; 2], radius_m: f64 },
    /// A convex polygon with its corners in order, clockwise or counter-clockwise. Two corners make a segment.
    Polygon { corners_m: Vec<[f64; 2]> },
}

/// Reason why a list of corners is not a convex polygon.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
pub enum ConvexityError {
    /// Number of corners, outside of 2 to [`CORNERS_MAX`].
    #[error("{0} corners")]
    CornerCount(usize),
    /// Index of a corner that coincides with the previous corner.
    #[error("corner {} coincides with the previous corner", .0 + 1)]
    CoincidentCorner(usize),
    /// Index of a corner at which the polygon turns in the opposite direction or starts a second revolution.
    #[error("the polygon is not convex at corner {}", .0 + 1)]
    ConcaveCorner(usize),
}

impl Obstacle {
    /// Returns the segment between two points.
    pub fn segment(from_m: [f64; 2], to_m: [f64; 2]) -> Obstacle {
        Obstacle::Polygon { corners_m: vec![from_m, to_m] }
    }

    /// Checks that the obstacle is convex. A disc always is. For a polygon, returns the first violation as an
    /// error.
    pub fn check_convex(&self) -> Result<(), ConvexityError> {
        let Obstacle::Polygon { corners_m } = self else { return Ok(()) };
        let count = corners_m.len();
        if !(2..=CORNERS_MAX).contains(&count) {
            return Err(ConvexityError::CornerCount(count));
        }
        let corner = |i: usize| Vec2::from(corners_m[i % count]);
        let side = |i: usize| corner(i + 1) - corner(i);
        if let Some(i) = (0..count).find(|&i| side(i).norm() < CORNER_DISTANCE_M_MIN) {
            return Err(ConvexityError::CoincidentCorner((i + 1) % count));
        }
        if count == 2 {
            return Ok(());
        }
        // Turn angles at the ends of the sides must all have one sign and sum to one revolution.
        let turn =
            |i: usize| portable_math::atan2(side(i).perp(&side(i + 1)), side(i).dot(&side(i + 1)));
        let total_turn: f64 = (0..count).map(turn).sum();
        let mut sum_of_turns = 0.0;
        for i in 0..count {
            let turn = turn(i) * total_turn.signum();
            sum_of_turns += turn;
            if turn < -1e-9 || sum_of_turns > std::f64::consts::TAU + 1e-6 {
                return Err(ConvexityError::ConcaveCorner((i + 1) % count));
            }
        }
        // A degenerate polygon that doubles back turns by half a revolution twice and has no interior.
        if total_turn.abs() < 1.0 || (0..count).any(|i| turn(i).abs() > std::f64::consts::PI - 1e-9)
        {
            return Err(ConvexityError::ConcaveCorner(1));
        }
        Ok(())
    }

    /// Returns the point of the obstacle nearest to `point`, which is `point` itself if it lies inside.
    pub fn nearest_point(&self, point: Vec2) -> Vec2 {
        match self {
            Obstacle::Disc { center_m, radius_m } => {
                let center = Vec2::from(*center_m);
                let offset = point - center;
                let distance = offset.norm();
                if distance <= *radius_m { point } else { center + offset * (radius_m / distance) }
            }
            Obstacle::Polygon { corners_m } => {
                let count = corners_m.len();
                let corner = |i: usize| Vec2::from(corners_m[i % count]);
                // A point outside is on the outer side of at least one side.
                let (mut is_left, mut is_right) = (false, false);
                let mut nearest = (f64::INFINITY, point);
                for i in 0..count {
                    let (from, along) = (corner(i), corner(i + 1) - corner(i));
                    let side = along.perp(&(point - from));
                    is_left |= side >= 0.0;
                    is_right |= side <= 0.0;
                    let fraction = (point - from).dot(&along) / along.norm_squared();
                    let foot = from + fraction.clamp(0.0, 1.0) * along;
                    let square = (point - foot).norm_squared();
                    if square < nearest.0 {
                        nearest = (square, foot);
                    }
                }
                if is_left && is_right { nearest.1 } else { point }
            }
        }
    }

    /// Returns the corners, m. A disc is approximated by a polygon whose deviation is at most 1 % of the
    /// radius.
    pub fn outline(&self) -> Vec<Vec2> {
        match self {
            Obstacle::Disc { center_m, radius_m } => {
                let corner = |k: u32| {
                    let (sin, cos) =
                        portable_math::sin_cos(std::f64::consts::TAU * f64::from(k) / 32.0);
                    Vec2::from(*center_m) + *radius_m * Vec2::new(cos, sin)
                };
                (0..32).map(corner).collect()
            }
            Obstacle::Polygon { corners_m } => corners_m.iter().map(|&c| Vec2::from(c)).collect(),
        }
    }

    /// Returns the center and radius, m, of a circle that contains the obstacle. For a polygon the center is
    /// the mean of its corners, so the circle need not be the smallest.
    pub fn bounding_circle(&self) -> (Vec2, f64) {
        match self {
            Obstacle::Disc { center_m, radius_m } => (Vec2::from(*center_m), *radius_m),
            Obstacle::Polygon { corners_m } => {
                let corners = || corners_m.iter().map(|&corner| Vec2::from(corner));
                let middle = corners().sum::<Vec2>() / corners_m.len() as f64;
                (middle, corners().map(|corner| (corner - middle).norm()).fold(0.0, f64::max))
            }
        }
    }
}

/// A list of obstacles with bounding circles, so distant obstacles are skipped cheaply.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Obstacles {
    /// Obstacle, center and radius of its bounding circle, m.
    obstacles_with_circles: Vec<(Obstacle, Vec2, f64)>,
}

/// The obstacle nearest to a query point.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct NearestObstacle {
    /// Index of the obstacle in the list.
    pub index: usize,
    /// Nearest point of the obstacle, m.
    pub point: Vec2,
    /// Distance from the query point to the nearest point, m.
    pub distance_m: f64,
}

impl Obstacles {
    /// Creates the list and computes a bounding circle for each obstacle.
    pub fn new(parts: &[Obstacle]) -> Obstacles {
        let with_circle = |part: &Obstacle| {
            let (center, radius_m) = part.bounding_circle();
            (part.clone(), center, radius_m)
        };
        Obstacles { obstacles_with_circles: parts.iter().map(with_circle).collect() }
    }

    /// Returns `true` if the list is empty.
    pub fn is_empty(&self) -> bool {
        self.obstacles_with_circles.is_empty()
    }

    /// Returns the obstacles within `radius_m` of `point`, in list order.
    pub fn obstacles_within(
        &self,
        point: Vec2,
        radius_m: f64,
    ) -> impl Iterator<Item = NearestObstacle> {
        let parts = self.obstacles_with_circles.iter().enumerate();
        parts.filter_map(move |(index, part)| nearest_point_within(index, part, point, radius_m))
    }

    /// Returns the obstacle nearest to `point`, or `None` if the list is empty. Of obstacles at equal distance
    /// the first in the list is returned.
    pub fn nearest_obstacle(&self, point: Vec2) -> Option<NearestObstacle> {
        let mut nearest: Option<NearestObstacle> = None;
        for (index, part) in self.obstacles_with_circles.iter().enumerate() {
            let radius_m = nearest.map_or(f64::INFINITY, |nearest| nearest.distance_m);
            let found = nearest_point_within(index, part, point, radius_m);
            nearest = found.filter(|found| found.distance_m < radius_m).or(nearest);
        }
        nearest
    }
}

fn nearest_point_within(
    index: usize,
    (part, center, bounding_radius_m): &(Obstacle, Vec2, f64),
    point: Vec2,
    radius_m: f64,
) -> Option<NearestObstacle> {
    // Enlarged by the rounding error. A NaN coordinate is within no radius.
    let reach_m = (radius_m + bounding_radius_m) * (1.0 + crate::RELATIVE_ROUNDING_ERROR_MAX);
    if (point - center).norm_squared() > reach_m * reach_m {
        return None;
    }
    let nearest = part.nearest_point(point);
    let distance_m = (point - nearest).norm();
    (distance_m <= radius_m).then_some(NearestObstacle { index, point: nearest, distance_m })
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn polygon(corners_m: &[[f64; 2]]) -> Obstacle {
        Obstacle::Polygon { corners_m: corners_m.to_vec() }
    }

    /// Generates a disc, or a polygon with its corners in order on an ellipse.
    fn convex_obstacles() -> impl Strategy<Value = Obstacle> {
        let angles = proptest::collection::btree_set(0..360u32, 2..9);
        let polygon = (angles, 0.1..3.0f64, 0.1..3.0f64, any::<bool>()).prop_map(
            |(angles, a, b, clockwise)| {
                let corner = |angle: u32| {
                    let (sin, cos) = f64::from(angle).to_radians().sin_cos();
                    [a * cos, b * sin]
                };
                let mut corners_m: Vec<[f64; 2]> = angles.into_iter().map(corner).collect();
                if clockwise {
                    corners_m.reverse();
                }
                Obstacle::Polygon { corners_m }
            },
        );
        let disc = (-1.0..1.0f64, -1.0..1.0f64, 0.01..2.0f64)
            .prop_map(|(x, y, radius_m)| Obstacle::Disc { center_m: [x, y], radius_m });
        prop_oneof![polygon, disc]
    }

    fn point() -> impl Strategy<Value = Vec2> {
        (-4.0..4.0f64, -4.0..4.0f64).prop_map(|(x, y)| Vec2::new(x, y))
    }

    #[test]
    fn non_convex_polygon_is_refused_with_its_corner() {
        let square = [[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]];
        assert_eq!(polygon(&square).check_convex(), Ok(()));
        let mut clockwise = square;
        clockwise.reverse();
        assert_eq!(polygon(&clockwise).check_convex(), Ok(()));
        assert_eq!(polygon(&square[..2]).check_convex(), Ok(()), "a segment");
        assert_eq!(polygon(&square[..1]).check_convex(), Err(ConvexityError::CornerCount(1)));
        let corner_on_a_side = [[0.0, 0.0], [0.5, 0.0], [1.0, 0.0], [0.0, 1.0]];
        assert_eq!(polygon(&corner_on_a_side).check_convex(), Ok(()));
        let dent = [[0.0, 0.0], [1.0, 0.0], [0.2, 0.2], [0.0, 1.0]];
        assert_eq!(polygon(&dent).check_convex(), Err(ConvexityError::ConcaveCorner(2)));
        let twice = [[0.0, 0.0], [1.0, 0.0], [1.0, 0.0], [0.0, 1.0]];
        assert_eq!(polygon(&twice).check_convex(), Err(ConvexityError::CoincidentCorner(2)));
        let forth_and_back = [[0.0, 0.0], [1.0, 0.0], [0.5, 0.0]];
        assert!(polygon(&forth_and_back).check_convex().is_err());
        let crossing = [[0.0, 0.0], [1.0, 1.0], [1.0, 0.0], [0.0, 1.0]];
        assert!(polygon(&crossing).check_convex().is_err());
        // A pentagram: all turns are to the left, but they sum to two revolutions.
        let star = [0.0, 144.0, 288.0, 72.0, 216.0f64].map(|angle| {
            let (sin, cos) = angle.to_radians().sin_cos();
            [cos, sin]
        });
        assert!(matches!(polygon(&star).check_convex(), Err(ConvexityError::ConcaveCorner(_))));
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(2000))]

        #[test]
        fn nearest_point_is_nearest_of_all_points_of_the_obstacle(
            obstacle in convex_obstacles(), point in point(), fractions in proptest::collection::vec(0.0..1.0f64, 9),
        ) {
            prop_assert_eq!(obstacle.check_convex(), Ok(()));
            let nearest = obstacle.nearest_point(point);
            let distance_m = (point - nearest).norm();
            // An arbitrary point of the obstacle.
            let other = match &obstacle {
                Obstacle::Disc { center_m, radius_m } => {
                    let (sin, cos) = (7.0 * fractions[0]).sin_cos();
                    Vec2::from(*center_m) + fractions[1] * radius_m * Vec2::new(cos, sin)
                }
                Obstacle::Polygon { corners_m } => {
                    let sum: f64 = fractions[..corners_m.len()].iter().sum();
                    let mean = corners_m.iter().zip(&fractions);
                    mean.map(|(corner, fraction)| fraction / sum * Vec2::from(*corner)).sum()
                }
            };
            prop_assert!(distance_m <= (point - other).norm() + 1e-12);
            // The nearest point belongs to the obstacle: its own nearest point is itself.
            prop_assert!((obstacle.nearest_point(nearest) - nearest).norm() < 1e-9);
            prop_assert!((obstacle.nearest_point(other) - other).norm() < 1e-9);
            let (center, radius_m) = obstacle.bounding_circle();
            prop_assert!((nearest - center).norm() <= radius_m + 1e-9 || distance_m == 0.0);
        }

        /// The Lipschitz property proven as `proof/Obstacles.v::the_rest_is_not_longer`.
        #[test]
        fn vector_from_nearest_point_is_nonexpansive(
            obstacle in convex_obstacles(), from in point(), to in point(),
        ) {
            let offset_from = |point: Vec2| point - obstacle.nearest_point(point);
            prop_assert!((offset_from(from) - offset_from(to)).norm() <= (from - to).norm() + 1e-9);
        }

        #[test]
        fn queries_find_obstacles_within_radius_and_the_nearest(
            parts in proptest::collection::vec(convex_obstacles(), 0..6), point in point(), radius_m in 0.0..5.0f64,
        ) {
            let obstacles = Obstacles::new(&parts);
            let distance_m = |part: &Obstacle| (point - part.nearest_point(point)).norm();
            let in_range = parts.iter().enumerate().filter(|(_, part)| distance_m(part) <= radius_m);
            let in_range: Vec<usize> = in_range.map(|(index, _)| index).collect();
            let found: Vec<usize> = obstacles.obstacles_within(point, radius_m).map(|n| n.index).collect();
            prop_assert_eq!(found, in_range);
            let smallest = parts.iter().map(distance_m).min_by(f64::total_cmp);
            prop_assert_eq!(obstacles.nearest_obstacle(point).map(|n| n.distance_m), smallest);
        }
    }
}
