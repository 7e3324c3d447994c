//! Reduction of curves to the points that are visible, without loss of extremes.

use formation::portable_math;

/// A point of the canvas, px.
pub type CanvasPoint = (f64, f64);

/// Returns of a curve over x the first, lowest, highest and last point in every `column` of the canvas.
pub fn simplify_by_column(points: &[CanvasPoint], column: f64) -> Vec<CanvasPoint> {
    let mut simplified = Vec::new();
    for group in points.chunk_by(|a, b| (a.0 / column).floor() == (b.0 / column).floor()) {
        let indices = 0..group.len();
        let lowest = indices.clone().min_by(|&a, &b| group[a].1.total_cmp(&group[b].1));
        let highest = indices.max_by(|&a, &b| group[a].1.total_cmp(&group[b].1));
        let mut selected = [Some(0), lowest, highest, Some(group.len() - 1)].map(Option::unwrap);
        selected.sort_unstable();
        simplified.extend(selected.iter().map(|&index| group[index]));
    }
    simplified.dedup();
    simplified
}

/// Simplifies a curve by the Douglas-Peucker algorithm: no removed point is farther than `tolerance` from the
/// result.
pub fn simplify_curve(points: &[CanvasPoint], tolerance: f64) -> Vec<CanvasPoint> {
    if points.len() < 3 {
        return points.to_vec();
    }
    let mut is_kept = vec![false; points.len()];
    is_kept[0] = true;
    is_kept[points.len() - 1] = true;
    let mut open_ranges = vec![(0, points.len() - 1)];
    while let Some((first, last)) = open_ranges.pop() {
        let inner_indices = first + 1..last;
        let deviation =
            |&index: &usize| distance_to_segment(points[index], points[first], points[last]);
        let farthest_index = inner_indices.max_by(|a, b| deviation(a).total_cmp(&deviation(b)));
        if let Some(index) = farthest_index.filter(|index| deviation(index) > tolerance) {
            is_kept[index] = true;
            open_ranges.extend([(first, index), (index, last)]);
        }
    }
    points.iter().zip(is_kept).filter(|(_, is_kept)| *is_kept).map(|(point, _)| *point).collect()
}

/// Returns the distance of a point from the segment from `a` to `b`.
fn distance_to_segment(point: CanvasPoint, a: CanvasPoint, b: CanvasPoint) -> f64 {
    let (dx, dy) = (b.0 - a.0, b.1 - a.1);
    let (x, y) = (point.0 - a.0, point.1 - a.1);
    let square = dx * dx + dy * dy;
    let fraction = if square > 0.0 { ((x * dx + y * dy) / square).clamp(0.0, 1.0) } else { 0.0 };
    portable_math::hypot(x - fraction * dx, y - fraction * dy)
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn curve() -> impl Strategy<Value = Vec<CanvasPoint>> {
        prop::collection::vec((0.0..3.0f64, -9.0..9.0f64), 1..200).prop_map(|steps| {
            let mut x = 0.0;
            let step = |(dx, y)| {
                x += dx;
                (x, y)
            };
            steps.into_iter().map(step).collect()
        })
    }

    proptest! {
        #[test]
        fn column_simplification_keeps_all_extremes(points in curve(), column in 0.1..50.0f64) {
            let simplified = simplify_by_column(&points, column);
            let extremes = |points: &[CanvasPoint]| {
                let y_values = points.iter().map(|point| point.1);
                (y_values.clone().fold(f64::INFINITY, f64::min), y_values.fold(-99.0, f64::max))
            };
            prop_assert_eq!(extremes(&simplified), extremes(&points));
            prop_assert_eq!((simplified[0], simplified[simplified.len() - 1]), (points[0], points[points.len() - 1]));
            let columns = (points[points.len() - 1].0 / column) as usize + 1;
            prop_assert!(simplified.len() <= 4 * columns && simplified.is_sorted_by_key(|point| point.0));
        }

        #[test]
        fn no_point_is_farther_from_the_simpler_curve_than_allowed(
            points in curve(), tolerance in 0.0..3.0f64,
        ) {
            let simplified = simplify_curve(&points, tolerance);
            for &point in &points {
                let is_near = |pair: &[CanvasPoint]| distance_to_segment(point, pair[0], pair[1]) <= tolerance + 1e-9;
                prop_assert!(simplified.contains(&point) || simplified.windows(2).any(is_near));
            }
        }
    }
}
