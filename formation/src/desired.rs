//! Where a robot should be, seen from the robots it hears.

use crate::Vec2;

/// A place in `map`, m, and how it moves, m/s.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Target {
    /// alpha*, m.
    pub position: Vec2,
    /// alpha*', m/s.
    pub velocity: Vec2,
}

impl Target {
    /// A place that stays where it is.
    pub fn still(position: Vec2) -> Target {
        Target { position, velocity: Vec2::zeros() }
    }

    /// The same place `dt_s` later.
    pub fn later(self, dt_s: f64) -> Target {
        Target { position: self.position + dt_s * self.velocity, ..self }
    }
}

/// alpha*_i = mean over heard j of (alpha_j + C_ji), and its derivative; `None` if nobody is
/// heard. (13) (24) (45); with C = 0, (46).
///
/// `heard` yields what is known of alpha_j, and of C_ji.
pub fn desired(heard: impl IntoIterator<Item = (Target, Target)>) -> Option<Target> {
    let mut sum = Target::still(Vec2::zeros());
    let mut count = 0u32;
    for (alpha_j, c_ji) in heard {
        sum.position += alpha_j.position + c_ji.position;
        sum.velocity += alpha_j.velocity + c_ji.velocity;
        count += 1;
    }
    let g = f64::from(count);
    (count > 0).then(|| Target { position: sum.position / g, velocity: sum.velocity / g })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_desired_position_is_the_mean_of_what_each_neighbour_asks_for() {
        let target = |x, y, vx| Target { position: Vec2::new(x, y), velocity: Vec2::new(vx, 0.0) };
        let heard = [
            (target(1.0, 0.0, 1.0), target(0.0, 1.0, 0.5)),
            (target(3.0, 2.0, 2.0), target(0.0, -1.0, 0.5)),
        ];
        assert_eq!(desired(heard), Some(target(2.0, 1.0, 2.0)));
        assert_eq!(desired([]), None);
    }
}
