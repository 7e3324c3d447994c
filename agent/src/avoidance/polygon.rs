//! Nearest point of a convex polygon that is given by half-planes and contains 0.

use formation::Vec2;

/// The half-plane `normal . u >= -bound` with |normal| = 1. With bound >= 0, as in this module, it contains 0.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct HalfPlane {
    /// Inward unit normal.
    pub normal: Vec2,
    /// Distance of the boundary line behind 0.
    pub boundary_distance: f64,
}

/// Maximum violation of a half-plane by the result because of rounding, m/s. Over one hour it accumulates to
/// less than the nanometer of [`ROUNDING_MARGIN_M`](super::cone::ROUNDING_MARGIN_M).
pub const VIOLATION_TOLERANCE_M_S: f64 = 1e-13;
/// Maximum sine of the angle between lines that are treated as parallel.
pub const PARALLEL_SINE_MAX: f64 = 1e-12;

impl HalfPlane {
    /// Returns the violation of the half-plane by `u`, m/s, which is negative inside.
    pub fn violation_m_s(&self, u: Vec2) -> f64 {
        -self.boundary_distance - self.normal.dot(&u)
    }

    /// Returns the point of the boundary line nearest to 0, and the direction of the line.
    pub fn boundary_line(&self) -> (Vec2, Vec2) {
        (-self.boundary_distance * self.normal, Vec2::new(-self.normal.y, self.normal.x))
    }

    /// Returns the part of the boundary line between two positions that satisfies `others`, as positions along
    /// it from the point nearest to 0, m/s, or `None` if it is empty. Parallel lines may be violated by
    /// `tolerance`, m/s.
    pub fn clip_boundary_line(
        &self,
        others: &[HalfPlane],
        [mut low, mut high]: [f64; 2],
        tolerance: f64,
    ) -> Option<[f64; 2]> {
        let (foot, along) = self.boundary_line();
        for other in others {
            let slope = other.normal.dot(&along);
            let missing = other.violation_m_s(foot);
            if slope.abs() < PARALLEL_SINE_MAX {
                if missing > tolerance {
                    return None;
                }
            } else if slope > 0.0 {
                low = low.max(missing / slope);
            } else {
                high = high.min(missing / slope);
            }
        }
        (low <= high).then_some([low, high])
    }
}

/// Returns the point nearest to `target` in the intersection of `sides`, or `None` if it is `target` itself.
///
/// The sides are added incrementally: a best point that satisfies the next side stays the best. Otherwise the
/// best point is on that side's line, within the part that the earlier sides leave. It is never longer than
/// `target`, on which the guard relies: `proof/Geometry.v::nearest_is_not_longer`.
pub fn nearest_point(target: Vec2, sides: &[HalfPlane]) -> Option<Vec2> {
    let mut best = target;
    for (index, side) in sides.iter().enumerate() {
        if side.violation_m_s(best) > 0.0 {
            best = nearest_point_on_line(target, side, &sides[..index]);
        }
    }
    if best == target {
        return None;
    }
    Some(scale_into_polygon(best, sides))
}

/// Returns the largest factor, at most 1, with which `target` satisfies all `sides`: the nearest point of the polygon
/// on the ray of `target` from 0.
pub fn scale_factor_on_ray(target: Vec2, sides: &[HalfPlane]) -> f64 {
    let violated = sides.iter().filter(|side| side.violation_m_s(target) > 0.0);
    violated.map(|side| side.boundary_distance / -side.normal.dot(&target)).fold(1.0, f64::min)
}

/// Returns `point`, scaled towards 0 if it violates a side by more than the tolerance. The polygon contains 0.
fn scale_into_polygon(mut point: Vec2, sides: &[HalfPlane]) -> Vec2 {
    for side in sides {
        if side.violation_m_s(point) > VIOLATION_TOLERANCE_M_S {
            point *= side.boundary_distance / -side.normal.dot(&point);
        }
    }
    point
}

/// Returns the point nearest to `target` on the line of `side` that satisfies `others`, or 0 if rounding leaves
/// nothing of the line.
fn nearest_point_on_line(target: Vec2, side: &HalfPlane, others: &[HalfPlane]) -> Vec2 {
    let (foot, along) = side.boundary_line();
    let unbounded = [f64::NEG_INFINITY, f64::INFINITY];
    let Some([low, high]) = side.clip_boundary_line(others, unbounded, VIOLATION_TOLERANCE_M_S)
    else {
        return Vec2::zeros();
    };
    foot + along * along.dot(&target).clamp(low, high)
}

#[cfg(test)]
mod tests {
    use std::f64::consts::FRAC_PI_2;

    use super::*;
    use proptest::prelude::*;

    /// Computes the slow reference: the nearest of all feasible foot points and corners, the target and 0.
    fn nearest_point_by_enumeration(target: Vec2, sides: &[HalfPlane]) -> Vec2 {
        let mut candidates = vec![target, Vec2::zeros()];
        for (i, a) in sides.iter().enumerate() {
            candidates.push(target + a.normal * a.violation_m_s(target));
            for b in &sides[..i] {
                let det = a.normal.x * b.normal.y - a.normal.y * b.normal.x;
                if det.abs() > 1e-12 {
                    candidates.push(Vec2::new(
                        (-a.boundary_distance * b.normal.y + b.boundary_distance * a.normal.y)
                            / det,
                        (-b.boundary_distance * a.normal.x + a.boundary_distance * b.normal.x)
                            / det,
                    ));
                }
            }
        }
        let feasible = |u: &Vec2| sides.iter().all(|s| s.violation_m_s(*u) <= 1e-9);
        let distance = |u: &Vec2| (u - target).norm();
        candidates
            .into_iter()
            .filter(feasible)
            .min_by(|a, b| distance(a).total_cmp(&distance(b)))
            .expect("0 is feasible")
    }

    fn half_planes() -> impl Strategy<Value = Vec<HalfPlane>> {
        let side =
            (-3.2..3.2f64, prop_oneof![Just(0.0), 0.0..1.0f64]).prop_map(|(angle, bound)| {
                HalfPlane { normal: Vec2::new(angle.cos(), angle.sin()), boundary_distance: bound }
            });
        proptest::collection::vec(side, 0..20)
    }

    /// Generates half-planes of which half are axis-parallel, so that many are parallel to each other.
    fn sides_often_parallel() -> impl Strategy<Value = Vec<HalfPlane>> {
        let angle = prop_oneof![-3.2..3.2f64, (0..4).prop_map(|q| f64::from(q) * FRAC_PI_2)];
        let side = (angle, 0.0..1.0f64).prop_map(|(angle, bound)| {
            let normal = Vec2::new(angle.cos(), angle.sin());
            HalfPlane { normal, boundary_distance: bound }
        });
        proptest::collection::vec(side, 1..6)
    }

    proptest! {
        /// The result is the longest feasible part of the segment from 0 to the point.
        #[test]
        fn infeasible_point_is_scaled_to_the_boundary(
            x in -2.0..2.0f64, y in -2.0..2.0f64, sides in half_planes(),
        ) {
            let point = Vec2::new(x, y);
            let fraction = |side: &HalfPlane| side.boundary_distance / (-side.normal.dot(&point)).max(0.0);
            let factor = sides.iter().map(fraction).fold(1.0, f64::min);
            let found = scale_into_polygon(point, &sides);
            prop_assert!((found - factor * point).norm() < 1e-12, "{found:?}");
            prop_assert!(factor < 1.0 || found == point);
            prop_assert!(sides.iter().all(|side| side.violation_m_s(found) <= VIOLATION_TOLERANCE_M_S));
        }

        /// The result is the nearest feasible candidate among foot point and corners on the line, or 0 if there
        /// is none.
        #[test]
        fn nearest_on_line_satisfies_the_other_sides(
            x in -2.0..2.0f64, y in -2.0..2.0f64, sides in sides_often_parallel(),
        ) {
            let target = Vec2::new(x, y);
            let (side, others) = sides.split_last().unwrap();
            let along = Vec2::new(-side.normal.y, side.normal.x);
            let foot = -side.boundary_distance * side.normal;
            let mut candidates = vec![foot + along * along.dot(&target)];
            for other in others {
                let slope = other.normal.dot(&along);
                if slope.abs() > 1e-9 {
                    candidates.push(foot + along * other.violation_m_s(foot) / slope);
                }
            }
            let excess = |u: &Vec2| others.iter().map(|o| o.violation_m_s(*u)).fold(f64::MIN, f64::max);
            // Candidates at the rounding limit are skipped.
            prop_assume!(candidates.iter().all(|u| !(1e-14..1e-9).contains(&excess(u))));
            let permitted = candidates.into_iter().filter(|u| excess(u) < 1e-9);
            let nearest = permitted.min_by(|a, b| {
                (a - target).norm().total_cmp(&(b - target).norm())
            });
            let found = nearest_point_on_line(target, side, others);
            prop_assert!((found - nearest.unwrap_or_default()).norm() < 1e-6, "{found:?}");
        }
    }

    proptest! {
        #[test]
        fn nearest_on_ray_is_the_longest_feasible_part(
            x in -2.0..2.0f64, y in -2.0..2.0f64, sides in half_planes(),
        ) {
            let target = Vec2::new(x, y);
            let found = scale_factor_on_ray(target, &sides);
            prop_assert!((0.0..=1.0).contains(&found));
            let excess = |part: f64| {
                sides.iter().map(|side| side.violation_m_s(part * target)).fold(f64::MIN, f64::max)
            };
            prop_assert!(sides.is_empty() || excess(found) <= VIOLATION_TOLERANCE_M_S);
            prop_assert!(found == 1.0 || excess(found * (1.0 + 1e-9) + 1e-9) > 0.0);
        }
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(2000))]
        #[test]
        fn nearest_point_agrees_with_enumeration_and_is_feasible(
            x in -2.0..2.0f64, y in -2.0..2.0f64, sides in half_planes(),
        ) {
            let target = Vec2::new(x, y);
            let found = nearest_point(target, &sides).unwrap_or(target);
            for side in &sides {
                prop_assert!(side.violation_m_s(found) <= VIOLATION_TOLERANCE_M_S);
            }
            let reference = nearest_point_by_enumeration(target, &sides);
            let (found_distance, reference_distance) = ((found - target).norm(), (reference - target).norm());
            prop_assert!((found_distance - reference_distance).abs() < 1e-6, "{found_distance} vs {reference_distance}");
        }
    }
}
