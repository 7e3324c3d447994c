//! The convex hull of the leaders, and the distance of a follower from it. (7) (49)

use crate::Vec2;
use crate::obstacle::Obstacle;

/// Returns the corners of the convex hull of `points`, counter-clockwise, without points on its edges (Andrew's
/// monotone chain).
pub fn convex_hull(points: &[Vec2]) -> Vec<Vec2> {
    let mut sorted = points.to_vec();
    sorted.sort_by(|a, b| a.x.total_cmp(&b.x).then(a.y.total_cmp(&b.y)));
    sorted.dedup();
    if sorted.len() < 3 {
        return sorted;
    }
    let mut hull: Vec<Vec2> = Vec::with_capacity(2 * sorted.len());
    let chain = |hull: &mut Vec<Vec2>, points: &mut dyn Iterator<Item = Vec2>| {
        let start = hull.len();
        for point in points {
            while hull.len() >= start + 2
                && orientation(hull[hull.len() - 2], hull[hull.len() - 1], point) <= 0.0
            {
                hull.pop();
            }
            hull.push(point);
        }
        hull.pop();
    };
    chain(&mut hull, &mut sorted.iter().copied());
    chain(&mut hull, &mut sorted.iter().rev().copied());
    hull
}

/// Returns the distance, m, from `point` to the convex hull of `points` (the polygon, not only its corners). It
/// is 0 inside the hull and infinite if `points` is empty.
pub fn hull_distance(point: Vec2, points: &[Vec2]) -> f64 {
    match convex_hull(points)[..] {
        [] => f64::INFINITY,
        [only] => (point - only).norm(),
        ref corners => {
            let corners_m = corners.iter().map(|&corner| corner.into()).collect();
            (point - Obstacle::Polygon { corners_m }.nearest_point(point)).norm()
        }
    }
}

/// Returns the cross product (b - a) x (c - a), which is positive if a, b, c are counter-clockwise.
fn orientation(a: Vec2, b: Vec2, c: Vec2) -> f64 {
    (b - a).perp(&(c - a))
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    /// Computes the hull distance by brute force, as the minimum over all triangles and segments.
    fn hull_distance_by_brute_force(point: Vec2, points: &[Vec2]) -> f64 {
        let mut nearest = f64::INFINITY;
        for a in points {
            for b in points {
                let segment = Obstacle::segment((*a).into(), (*b).into());
                let nearest_point = if a == b { *a } else { segment.nearest_point(point) };
                nearest = nearest.min((point - nearest_point).norm());
                for c in points {
                    let turns = [
                        orientation(*a, *b, point),
                        orientation(*b, *c, point),
                        orientation(*c, *a, point),
                    ];
                    let is_inside = turns.iter().all(|t| *t >= 0.0);
                    if orientation(*a, *b, *c) > 1e-12 && is_inside {
                        nearest = 0.0;
                    }
                }
            }
        }
        nearest
    }

    proptest! {
        #[test]
        fn hull_distance_agrees_with_brute_force(
            x in -2.0..2.0f64, y in -2.0..2.0f64,
            points in proptest::collection::vec((-1.0..1.0f64, -1.0..1.0f64), 1..9),
        ) {
            let points: Vec<Vec2> = points.into_iter().map(|(x, y)| Vec2::new(x, y)).collect();
            let point = Vec2::new(x, y);
            let difference = hull_distance(point, &points) - hull_distance_by_brute_force(point, &points);
            prop_assert!(difference.abs() < 1e-9);
        }

        /// Uses a lattice, on which many points coincide or are collinear.
        #[test]
        fn hull_is_convex_and_contains_all_points(
            points in proptest::collection::vec((-3..4i32, -3..4i32), 0..12),
            (x, y) in (-5..6i32, -5..6i32),
            line in any::<bool>(),
        ) {
            let to_point = |(x, y): (i32, i32)| {
                Vec2::new(f64::from(x), if line { 0.0 } else { f64::from(y) })
            };
            let points: Vec<Vec2> = points.into_iter().map(to_point).collect();
            let hull = convex_hull(&points);
            prop_assert!(hull.iter().all(|corner| points.contains(corner)));
            if hull.len() > 2 {
                for i in 0..hull.len() {
                    let [a, b, c] = [0, 1, 2].map(|k| hull[(i + k) % hull.len()]);
                    prop_assert!(orientation(a, b, c) > 0.0, "{a:?} {b:?} {c:?}");
                }
            }
            for &point in &points {
                prop_assert!(hull_distance(point, &points) < 1e-12);
            }
            let distance = hull_distance(to_point((x, y)), &points);
            let expected = hull_distance_by_brute_force(to_point((x, y)), &points);
            prop_assert!(distance == expected || (distance - expected).abs() < 1e-9);
        }
    }
}
