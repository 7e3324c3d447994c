//! Optimal velocity within a speed limit and half-planes: linear programs in two and three dimensions. (van den
//! Berg et al. 2011, "Basic Approach" and "Densely Packed Conditions")
//!
//! The sides are added incrementally: a best point that satisfies the next side stays the best. Otherwise the
//! best point is on that side's line. If no point satisfies all sides, the sides that may be relaxed are
//! relaxed by the smallest possible common amount. (The bounds of the guard always contain 0: `polygon`.)

use formation::Vec2;

use super::clip;
use super::polygon::{HalfPlane, PARALLEL_SINE_MAX};

/// Objective of the optimization.
#[derive(Debug, Clone, Copy)]
enum Objective {
    /// Minimum distance from this point.
    NearestTo(Vec2),
    /// Maximum extent in this direction.
    FarthestAlong(Vec2),
}

/// Returns the velocity nearest to `target` that is at most `reach` and satisfies all `sides`. If there is
/// none, returns the velocity with the smallest maximum violation. The first `rigid` sides are not relaxed, as
/// long as they have a common point.
pub fn nearest_permitted_velocity(
    target: Vec2,
    reach: f64,
    sides: &[HalfPlane],
    rigid: usize,
) -> Vec2 {
    match best_point(Objective::NearestTo(target), reach, sides) {
        Ok(found) => found,
        Err((failed, previous_best)) => {
            let rigid = if failed < rigid { 0 } else { rigid };
            least_violating_point(reach, sides, rigid, failed, previous_best)
        }
    }
}

/// Returns the best point within `reach` of 0 that satisfies all `sides`. The error is the index of the first
/// side that leaves nothing, and the best point for the sides before it.
fn best_point(
    objective: Objective,
    reach: f64,
    sides: &[HalfPlane],
) -> Result<Vec2, (usize, Vec2)> {
    let mut best = match objective {
        Objective::NearestTo(target) => clip(target, reach),
        Objective::FarthestAlong(direction) => reach * direction,
    };
    for (index, side) in sides.iter().enumerate() {
        if side.violation_m_s(best) > 0.0 {
            best =
                best_point_on_line(objective, reach, side, &sides[..index]).ok_or((index, best))?;
        }
    }
    Ok(best)
}

/// Returns the best point on the line of `side` within `reach` of 0 that satisfies `others`, or `None`.
fn best_point_on_line(
    objective: Objective,
    reach: f64,
    side: &HalfPlane,
    others: &[HalfPlane],
) -> Option<Vec2> {
    let (foot, along) = side.boundary_line();
    let half = (reach * reach - side.boundary_distance * side.boundary_distance).sqrt();
    if half.is_nan() {
        return None; // the line does not reach the disc
    }
    let [low, high] = side.clip_boundary_line(others, [-half, half], 0.0)?;
    let position = match objective {
        Objective::NearestTo(target) => along.dot(&target).clamp(low, high),
        Objective::FarthestAlong(direction) if along.dot(&direction) > 0.0 => high,
        Objective::FarthestAlong(_) => low,
    };
    Some(foot + position * along)
}

/// Returns the point within `reach` of 0 with the smallest maximum violation of `sides` that satisfies the
/// first `rigid` ones. `previous_best` is the best point for the sides before `failed`, and satisfies them.
fn least_violating_point(
    reach: f64,
    sides: &[HalfPlane],
    rigid: usize,
    failed: usize,
    previous_best: Vec2,
) -> Vec2 {
    let (mut found, mut violation) = (previous_best, 0.0);
    let mut program: Vec<HalfPlane> = Vec::with_capacity(sides.len());
    for (index, side) in sides.iter().enumerate().skip(failed) {
        if side.violation_m_s(found) <= violation {
            continue;
        }
        // This side has the maximum violation from here on.
        program.clear();
        program.extend(&sides[..rigid]);
        for other in &sides[rigid..index] {
            let normal = other.normal - side.normal;
            let length = normal.norm();
            if length > PARALLEL_SINE_MAX {
                let bound = (other.boundary_distance - side.boundary_distance) / length;
                program.push(HalfPlane { normal: normal / length, boundary_distance: bound });
            }
        }
        // Rounding may make the feasible set empty. The previous point is kept then.
        found = best_point(Objective::FarthestAlong(side.normal), reach, &program).unwrap_or(found);
        violation = side.violation_m_s(found);
    }
    found
}

#[cfg(test)]
mod tests {
    use std::f64::consts::TAU;

    use super::*;
    use proptest::prelude::*;

    fn half_planes() -> impl Strategy<Value = Vec<HalfPlane>> {
        let bound = prop_oneof![Just(0.0), -0.5..1.0f64];
        let side = (-3.2..3.2f64, bound).prop_map(|(angle, bound)| HalfPlane {
            normal: Vec2::new(angle.cos(), angle.sin()),
            boundary_distance: bound,
        });
        proptest::collection::vec(side, 0..9)
    }

    /// Returns the maximum violation, or 0 if every side is satisfied.
    fn max_violation(u: Vec2, sides: &[HalfPlane]) -> f64 {
        sides.iter().map(|side| side.violation_m_s(u)).fold(0.0, f64::max)
    }

    /// Computes the slow reference: the best of corners, foot points, intersections of lines with the disc, and the
    /// target.
    fn candidate_points(target: Vec2, reach: f64, lines: &[HalfPlane]) -> Vec<Vec2> {
        let mut points = vec![clip(target, reach)];
        for (i, a) in lines.iter().enumerate() {
            let foot = -a.boundary_distance * a.normal;
            let along = Vec2::new(-a.normal.y, a.normal.x);
            points.push(foot + along.dot(&target) * along);
            let half = (reach * reach - a.boundary_distance * a.boundary_distance).sqrt();
            points.extend([foot + half * along, foot - half * along]);
            points.extend([reach * a.normal, -reach * a.normal]);
            for b in &lines[..i] {
                let slope = b.normal.dot(&along);
                if slope.abs() > 1e-9 {
                    points.push(foot + b.violation_m_s(foot) / slope * along);
                }
            }
        }
        points.retain(|u| u.norm() <= reach + 1e-9);
        points
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(3000))]

        #[test]
        fn result_is_nearest_permitted_or_least_violating(
            x in -2.0..2.0f64, y in -2.0..2.0f64, reach in 0.1..1.5f64, sides in half_planes(),
        ) {
            let target = Vec2::new(x, y);
            let found = nearest_permitted_velocity(target, reach, &sides, 0);
            prop_assert!(found.norm() <= reach + 1e-9);
            let points = candidate_points(target, reach, &sides);
            let permitted = points.iter().filter(|u| max_violation(**u, &sides) <= 1e-10);
            let nearest = permitted.map(|u| (u - target).norm()).reduce(f64::min);
            if let Some(nearest) = nearest {
                prop_assert!(max_violation(found, &sides) < 1e-7, "{found:?}");
                prop_assert!((found - target).norm() < nearest + 1e-6, "{found:?}, {nearest}");
            } else {
                // No point of a fine grid of the disc has a smaller violation.
                let smallest = max_violation(found, &sides);
                for k in 0..4000 {
                    let (angle, fraction) = (f64::from(k) * 0.618_034 * TAU, f64::from(k) / 3999.0);
                    let u = reach * fraction.sqrt() * Vec2::new(angle.cos(), angle.sin());
                    prop_assert!(smallest <= max_violation(u, &sides) + 1e-9, "{found:?}: {smallest}, {u:?}");
                }
            }
        }

        #[test]
        fn rigid_sides_are_not_relaxed_while_feasible(
            walls in proptest::collection::vec((-3.2..3.2f64, 0.0..0.5f64), 1..4), others in half_planes(),
        ) {
            let wall = |(angle, boundary_distance): (f64, f64)| HalfPlane {
                normal: Vec2::new(angle.cos(), angle.sin()),
                boundary_distance,
            };
            let rigid = walls.len();
            let sides: Vec<HalfPlane> = walls.into_iter().map(wall).chain(others).collect();
            let found = nearest_permitted_velocity(Vec2::new(0.7, 0.1), 1.0, &sides, rigid);
            prop_assert!(max_violation(found, &sides[..rigid]) < 1e-9, "{found:?}");
        }
    }

    #[test]
    fn three_infeasible_sides_are_relaxed_equally() {
        let side = |angle: f64| HalfPlane {
            normal: Vec2::new(angle.cos(), angle.sin()),
            boundary_distance: -0.3,
        };
        let sides = [0.1, 0.1 + TAU / 3.0, 0.1 - TAU / 3.0].map(side);
        let found = nearest_permitted_velocity(Vec2::new(1.0, 0.0), 1.0, &sides, 0);
        assert!(found.norm() < 1e-12, "{found:?}");
        // An unreachable rigid side is relaxed as well.
        let beyond = HalfPlane { normal: Vec2::new(1.0, 0.0), boundary_distance: -1.5 };
        let found = nearest_permitted_velocity(Vec2::zeros(), 1.0, &[beyond], 1);
        assert!((found - Vec2::new(1.0, 0.0)).norm() < 1e-12, "{found:?}");
    }
}
