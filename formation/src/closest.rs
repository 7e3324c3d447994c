//! The pair of points nearest to each other.

use crate::Vec2;

/// Two points, by their places in the list, and how far apart they are.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ClosestPair {
    /// Places in the list, the smaller one first.
    pub pair: [usize; 2],
    /// Distance, m.
    pub distance_m: f64,
}

/// The closest two of `points`; `None` for fewer than two. Of equals, the first in list order.
pub fn closest_pair(points: &[Vec2]) -> Option<ClosestPair> {
    let mut closest: Option<([usize; 2], f64)> = None;
    for (i, a) in points.iter().enumerate() {
        for (j, b) in points.iter().enumerate().skip(i + 1) {
            let square = (a - b).norm_squared();
            if closest.is_none_or(|(_, least)| square < least) {
                closest = Some(([i, j], square));
            }
        }
    }
    closest.map(|(pair, square)| ClosestPair { pair, distance_m: square.sqrt() })
}
