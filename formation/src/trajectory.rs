//! Where the main leader is to be: m(t) and its derivative m'(t), in `map`.
//!
//! Every trajectory is continuously differentiable, as the chapter asks.

use std::f64::consts::TAU;

use serde::{Deserialize, Serialize};

use crate::Vec2;
use crate::desired::Target;

/// A navigation trajectory m(t), t in seconds since the run's start.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(tag = "kind", rename_all = "kebab-case", deny_unknown_fields)]
pub enum Trajectory {
    /// Stays at a point.
    Still {
        /// The point, m.
        center_m: [f64; 2],
    },
    /// A straight line at constant velocity.
    Line {
        /// Where it is at t = 0, m.
        center_m: [f64; 2],
        /// m', m/s.
        velocity_m_s: [f64; 2],
    },
    /// A circle, counter-clockwise, from its easternmost point.
    Circle {
        /// Its center, m.
        center_m: [f64; 2],
        /// Its radius, m.
        radius_m: f64,
        /// Once around, s.
        period_s: f64,
    },
    /// The four-leaved rose of section 3.2: a (sin 2wt cos wt, sin 2wt sin wt).
    Quadrifolium {
        /// Its center, m.
        center_m: [f64; 2],
        /// a: from the center to a leaf's tip, m.
        radius_m: f64,
        /// 2 pi / w, s.
        period_s: f64,
    },
    /// A Lissajous figure: (a_x sin(n_x wt + phase), a_y sin(n_y wt)).
    Lissajous {
        /// Its center, m.
        center_m: [f64; 2],
        /// a_x and a_y, m.
        radii_m: [f64; 2],
        /// n_x and n_y.
        cycles: [u32; 2],
        /// Phase of the first component, rad.
        phase_rad: f64,
        /// 2 pi / w, s.
        period_s: f64,
    },
}

impl Trajectory {
    /// m(t) and m'(t).
    pub fn at(&self, t_s: f64) -> Target {
        let (position, velocity) = match *self {
            Trajectory::Still { center_m } => (center_m.into(), Vec2::zeros()),
            Trajectory::Line { center_m, velocity_m_s } => {
                let velocity = Vec2::from(velocity_m_s);
                (Vec2::from(center_m) + velocity * t_s, velocity)
            }
            Trajectory::Circle { center_m, radius_m, period_s } => {
                let w = TAU / period_s;
                let (sin, cos) = (w * t_s).sin_cos();
                let place = Vec2::from(center_m) + radius_m * Vec2::new(cos, sin);
                (place, radius_m * w * Vec2::new(-sin, cos))
            }
            Trajectory::Quadrifolium { center_m, radius_m, period_s } => {
                let w = TAU / period_s;
                let (sin, cos) = (w * t_s).sin_cos();
                let (sin_2, cos_2) = (2.0 * w * t_s).sin_cos();
                let place = Vec2::from(center_m) + radius_m * sin_2 * Vec2::new(cos, sin);
                let slope =
                    Vec2::new(2.0 * cos_2 * cos - sin_2 * sin, 2.0 * cos_2 * sin + sin_2 * cos);
                (place, radius_m * w * slope)
            }
            Trajectory::Lissajous { center_m, radii_m, cycles, phase_rad, period_s } => {
                let w = cycles.map(|n| f64::from(n) * TAU / period_s);
                let (sin_x, cos_x) = (w[0] * t_s + phase_rad).sin_cos();
                let (sin_y, cos_y) = (w[1] * t_s).sin_cos();
                let [a_x, a_y] = radii_m;
                (
                    Vec2::from(center_m) + Vec2::new(a_x * sin_x, a_y * sin_y),
                    Vec2::new(a_x * w[0] * cos_x, a_y * w[1] * cos_y),
                )
            }
        };
        Target { position, velocity }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn trajectories() -> Vec<Trajectory> {
        let (center_m, period_s) = ([1.0, -2.0], 40.0);
        vec![
            Trajectory::Still { center_m },
            Trajectory::Line { center_m, velocity_m_s: [0.3, -0.1] },
            Trajectory::Circle { center_m, radius_m: 2.0, period_s },
            Trajectory::Quadrifolium { center_m, radius_m: 4.0, period_s },
            Trajectory::Lissajous {
                center_m,
                radii_m: [3.0, 2.0],
                cycles: [1, 2],
                phase_rad: 0.4,
                period_s,
            },
        ]
    }

    proptest! {
        #[test]
        fn the_velocity_is_the_derivative_of_the_place(t in 0.0..100.0f64) {
            let h = 1e-5;
            for trajectory in trajectories() {
                let slope = trajectory.at(t + h).position - trajectory.at(t - h).position;
                let slope = slope / (2.0 * h);
                prop_assert!((slope - trajectory.at(t).velocity).norm() < 1e-7, "{trajectory:?}");
            }
        }
    }

    #[test]
    fn the_quadrifolium_is_the_chapters() {
        let center_m = [0.0, 0.0];
        let rose = Trajectory::Quadrifolium { center_m, radius_m: 4.0, period_s: 80.0 };
        let w = TAU / 80.0;
        for t in [0.0, 3.0, 17.5, 66.6] {
            let expected = Vec2::new(
                4.0 * (2.0 * w * t).sin() * (w * t).cos(),
                4.0 * (2.0 * w * t).sin() * (w * t).sin(),
            );
            assert!((rose.at(t).position - expected).norm() < 1e-12);
        }
    }
}
