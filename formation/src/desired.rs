//! Where a robot should be, seen from the robots it hears.

use crate::Vec2;

/// alpha*_i = mean over heard j of (alpha_j + c_ji), m, in `map`; `None` if nobody is heard. (13)
///
/// `heard` yields (alpha_j, c_ji).
pub fn desired_position(heard: impl IntoIterator<Item = (Vec2, Vec2)>) -> Option<Vec2> {
    let mut sum = Vec2::zeros();
    let mut count = 0u32;
    for (alpha_j, c_ji) in heard {
        sum += alpha_j + c_ji;
        count += 1;
    }
    (count > 0).then(|| sum / f64::from(count))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_desired_position_is_the_mean_of_what_each_neighbour_asks_for() {
        let heard = [
            (Vec2::new(1.0, 0.0), Vec2::new(0.0, 1.0)),
            (Vec2::new(3.0, 2.0), Vec2::new(0.0, -1.0)),
        ];
        assert_eq!(desired_position(heard), Some(Vec2::new(2.0, 1.0)));
        assert_eq!(desired_position([]), None);
    }
}
