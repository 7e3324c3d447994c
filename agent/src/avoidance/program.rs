//! The best velocity within a speed limit and half-planes: linear programs in two and three dimensions.
//! (van den Berg et al. 2011, "Basic Approach" and "Densely Packed Conditions")
//!
//! One side at a time: while the best point so far fulfils the next side it stays the best; otherwise
//! the best point lies on that side's line. Where nothing fulfils all sides, those that may give way
//! give way by the same amount, the least there is. (The guard's bounds always leave 0: `polygon`.)

use formation::Vec2;

use super::clip;
use super::polygon::{HalfPlane, PARALLEL};

/// What is best.
#[derive(Debug, Clone, Copy)]
enum Aim {
    /// To be near this point.
    Near(Vec2),
    /// To be far in this direction.
    Far(Vec2),
}

/// The velocity nearest to `target` that is no longer than `reach` and fulfils all `sides`. Where there
/// is none: that which misses the worst-missed side by least. The first `rigid` of them do not give
/// way, as long as they leave something.
pub fn nearest_permitted(target: Vec2, reach: f64, sides: &[HalfPlane], rigid: usize) -> Vec2 {
    match best(Aim::Near(target), reach, sides) {
        Ok(found) => found,
        Err((failed, so_far)) => {
            let rigid = if failed < rigid { 0 } else { rigid };
            least_missed(reach, sides, rigid, failed, so_far)
        }
    }
}

/// The best point within `reach` of 0 that fulfils all `sides`; or the place of the first side that
/// leaves nothing, and the best point that fulfils those before it.
fn best(aim: Aim, reach: f64, sides: &[HalfPlane]) -> Result<Vec2, (usize, Vec2)> {
    let mut best = match aim {
        Aim::Near(target) => clip(target, reach),
        Aim::Far(direction) => reach * direction,
    };
    for (done, side) in sides.iter().enumerate() {
        if side.excess(best) > 0.0 {
            best = best_on_line(aim, reach, side, &sides[..done]).ok_or((done, best))?;
        }
    }
    Ok(best)
}

/// The best point on the line of `side` within `reach` of 0 that fulfils `others`, if any does.
fn best_on_line(aim: Aim, reach: f64, side: &HalfPlane, others: &[HalfPlane]) -> Option<Vec2> {
    let (foot, along) = side.line();
    let half = (reach * reach - side.bound * side.bound).sqrt();
    if half.is_nan() {
        return None; // too far
    }
    let [low, high] = side.left_of_line(others, [-half, half], 0.0)?;
    let at = match aim {
        Aim::Near(target) => along.dot(&target).clamp(low, high),
        Aim::Far(direction) if along.dot(&direction) > 0.0 => high,
        Aim::Far(_) => low,
    };
    Some(foot + at * along)
}

/// The point within `reach` of 0 that misses the worst-missed of `sides` by least, but fulfils the first
/// `rigid`; `so_far` is best for those before `failed`, and fulfils them.
fn least_missed(
    reach: f64,
    sides: &[HalfPlane],
    rigid: usize,
    failed: usize,
    so_far: Vec2,
) -> Vec2 {
    let (mut found, mut missed) = (so_far, 0.0);
    let mut program: Vec<HalfPlane> = Vec::with_capacity(sides.len());
    for (done, side) in sides.iter().enumerate().skip(failed) {
        if side.excess(found) <= missed {
            continue;
        }
        // It is the worst-missed then: no other is missed by more.
        program.clear();
        program.extend(&sides[..rigid]);
        for other in &sides[rigid..done] {
            let normal = other.normal - side.normal;
            let length = normal.norm();
            if length > PARALLEL {
                let bound = (other.bound - side.bound) / length;
                program.push(HalfPlane { normal: normal / length, bound });
            }
        }
        // Rounding may leave nothing of what there is.
        found = best(Aim::Far(side.normal), reach, &program).unwrap_or(found);
        missed = side.excess(found);
    }
    found
}

#[cfg(test)]
mod tests {
    use std::f64::consts::TAU;

    use super::*;
    use proptest::prelude::*;

    fn sides() -> impl Strategy<Value = Vec<HalfPlane>> {
        let bound = prop_oneof![Just(0.0), -0.5..1.0f64];
        let side = (-3.2..3.2f64, bound).prop_map(|(angle, bound)| HalfPlane {
            normal: Vec2::new(angle.cos(), angle.sin()),
            bound,
        });
        proptest::collection::vec(side, 0..9)
    }

    /// By how much the worst-missed is missed; 0 where none is.
    fn missed(u: Vec2, sides: &[HalfPlane]) -> f64 {
        sides.iter().map(|side| side.excess(u)).fold(0.0, f64::max)
    }

    /// The slow reference: corners, feet, and where lines leave the disc; and the target.
    fn candidates(target: Vec2, reach: f64, lines: &[HalfPlane]) -> Vec<Vec2> {
        let mut points = vec![clip(target, reach)];
        for (i, a) in lines.iter().enumerate() {
            let foot = -a.bound * a.normal;
            let along = Vec2::new(-a.normal.y, a.normal.x);
            points.push(foot + along.dot(&target) * along);
            let half = (reach * reach - a.bound * a.bound).sqrt();
            points.extend([foot + half * along, foot - half * along]);
            points.extend([reach * a.normal, -reach * a.normal]);
            for b in &lines[..i] {
                let slope = b.normal.dot(&along);
                if slope.abs() > 1e-9 {
                    points.push(foot + b.excess(foot) / slope * along);
                }
            }
        }
        points.retain(|u| u.norm() <= reach + 1e-9);
        points
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(3000))]

        #[test]
        fn it_is_the_nearest_of_what_is_permitted_or_misses_as_little_as_anything(
            x in -2.0..2.0f64, y in -2.0..2.0f64, reach in 0.1..1.5f64, sides in sides(),
        ) {
            let target = Vec2::new(x, y);
            let found = nearest_permitted(target, reach, &sides, 0);
            prop_assert!(found.norm() <= reach + 1e-9);
            let points = candidates(target, reach, &sides);
            let permitted = points.iter().filter(|u| missed(**u, &sides) <= 1e-10);
            let nearest = permitted.map(|u| (u - target).norm()).reduce(f64::min);
            if let Some(nearest) = nearest {
                prop_assert!(missed(found, &sides) < 1e-7, "{found:?}");
                prop_assert!((found - target).norm() < nearest + 1e-6, "{found:?}, {nearest}");
            } else {
                // Nowhere on a fine net of the disc is less missed.
                let least = missed(found, &sides);
                for k in 0..4000 {
                    let (angle, share) = (f64::from(k) * 0.618_034 * TAU, f64::from(k) / 3999.0);
                    let u = reach * share.sqrt() * Vec2::new(angle.cos(), angle.sin());
                    prop_assert!(least <= missed(u, &sides) + 1e-9, "{found:?}: {least}, {u:?}");
                }
            }
        }

        #[test]
        fn what_is_rigid_does_not_give_way_as_long_as_it_leaves_something(
            walls in proptest::collection::vec((-3.2..3.2f64, 0.0..0.5f64), 1..4), others in sides(),
        ) {
            let wall = |(angle, bound): (f64, f64)| HalfPlane {
                normal: Vec2::new(angle.cos(), angle.sin()),
                bound,
            };
            let rigid = walls.len();
            let sides: Vec<HalfPlane> = walls.into_iter().map(wall).chain(others).collect();
            let found = nearest_permitted(Vec2::new(0.7, 0.1), 1.0, &sides, rigid);
            prop_assert!(missed(found, &sides[..rigid]) < 1e-9, "{found:?}");
        }
    }

    #[test]
    fn three_sides_that_leave_nothing_give_way_by_the_same() {
        let side =
            |angle: f64| HalfPlane { normal: Vec2::new(angle.cos(), angle.sin()), bound: -0.3 };
        let sides = [0.1, 0.1 + TAU / 3.0, 0.1 - TAU / 3.0].map(side);
        let found = nearest_permitted(Vec2::new(1.0, 0.0), 1.0, &sides, 0);
        assert!(found.norm() < 1e-12, "{found:?}");
        // A wall that leaves nothing of the disc gives way as well.
        let beyond = HalfPlane { normal: Vec2::new(1.0, 0.0), bound: -1.5 };
        let found = nearest_permitted(Vec2::zeros(), 1.0, &[beyond], 1);
        assert!((found - Vec2::new(1.0, 0.0)).norm() < 1e-12, "{found:?}");
    }
}
