//! Search for the pair of points with the smallest distance.

use crate::Vec2;

/// The pair of points with the smallest distance.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ClosestPair {
    /// Indices of the two points, in ascending order.
    pub pair: [usize; 2],
    /// Distance between the two points, m.
    pub distance_m: f64,
}

/// Returns the pair of `points` with the smallest distance, or `None` for fewer than two points. Of pairs at
/// equal distance the first in list order is returned, and a distance that is NaN counts only if all are.
pub fn closest_pair(points: &[Vec2]) -> Option<ClosestPair> {
    let mut closest: Option<([usize; 2], f64)> = None;
    for (i, a) in points.iter().enumerate() {
        for (j, b) in points.iter().enumerate().skip(i + 1) {
            let square = (a - b).norm_squared();
            if closest.is_none_or(|(_, smallest)| square < smallest || smallest.is_nan()) {
                closest = Some(([i, j], square));
            }
        }
    }
    closest.map(|(pair, square)| ClosestPair { pair, distance_m: square.sqrt() })
}
