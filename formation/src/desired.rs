//! Desired position of a robot, computed from its in-neighbors.

use crate::Vec2;

/// A desired position in `map`, m, and its velocity, m/s.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Target {
    /// Desired position (alpha*), m.
    pub position: Vec2,
    /// Desired velocity (alpha*'), m/s.
    pub velocity: Vec2,
}

impl Target {
    /// Returns a target with velocity 0 at `position`.
    #[inline]
    pub fn at_rest(position: Vec2) -> Target {
        Target { position, velocity: Vec2::zeros() }
    }

    /// Returns the target after `dt_s` seconds at its constant velocity.
    #[inline]
    pub fn extrapolate(self, dt_s: f64) -> Target {
        Target { position: self.position + dt_s * self.velocity, ..self }
    }
}

/// Returns the desired position and velocity (alpha*_i, alpha*_i'): the mean over the in-neighbors j of
/// (alpha_j + C_ji), and its derivative. (13) (24) (45); with C = 0, (46).
///
/// Each item of `received` is the estimate of alpha_j and the desired relative position C_ji. Returns `None` if
/// `received` is empty.
pub fn mean_target(received: impl IntoIterator<Item = (Target, Target)>) -> Option<Target> {
    let mut sum = Target::at_rest(Vec2::zeros());
    let mut count = 0u32;
    received.into_iter().for_each(|(alpha_j, c_ji)| {
        sum.position += alpha_j.position + c_ji.position;
        sum.velocity += alpha_j.velocity + c_ji.velocity;
        count += 1;
    });
    let g = f64::from(count);
    (count > 0).then(|| Target { position: sum.position / g, velocity: sum.velocity / g })
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn targets() -> impl Strategy<Value = Target> {
        let vector = || (-9.0..9.0f64, -9.0..9.0f64).prop_map(|(x, y)| Vec2::new(x, y));
        (vector(), vector()).prop_map(|(position, velocity)| Target { position, velocity })
    }

    proptest! {
        #[test]
        fn target_later_moves_at_its_velocity(target in targets(), dt_s in -3.0..3.0f64) {
            let later = target.extrapolate(dt_s);
            prop_assert_eq!(later.velocity, target.velocity);
            let displacement = later.position - target.position;
            prop_assert!((displacement - target.velocity * dt_s).norm() < 1e-12);
        }

        #[test]
        fn desired_target_is_the_mean_over_in_neighbors(
            received in proptest::collection::vec((targets(), targets()), 0..9),
        ) {
            let desired = mean_target(received.iter().copied());
            prop_assert_eq!(desired.is_some(), !received.is_empty());
            let Some(desired) = desired else { return Ok(()) };
            let error = |desired: Vec2, of: fn(&Target) -> Vec2| {
                let sum: Vec2 = received.iter().map(|(alpha, c)| of(alpha) + of(c)).sum();
                (desired * received.len() as f64 - sum).norm()
            };
            prop_assert!(error(desired.position, |target| target.position) < 1e-9);
            prop_assert!(error(desired.velocity, |target| target.velocity) < 1e-9);
        }
    }
}
