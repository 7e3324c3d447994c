//! Reference trajectory of the main leader: m(t) and its derivative m'(t), in `map`.
//!
//! Every trajectory is continuously differentiable, as the chapter requires.

use std::f64::consts::TAU;

use serde::{Deserialize, Serialize};

use crate::Vec2;
use crate::desired::Target;
use crate::front_point::towing_velocity;
use crate::path::Path;
use crate::portable_math;
use crate::pose::wrap_angle;

/// A reference (navigation) trajectory m(t), with t in seconds since the start of the run.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(tag = "kind", rename_all = "kebab-case", deny_unknown_fields)]
#[expect(
    missing_docs,
    reason = "`radius_m` is the a, and `period_s` the 2 pi / w of a formula, w negative too"
)]
pub enum Trajectory {
    /// A fixed point.
    Still { center_m: [f64; 2] },
    /// A straight line at constant velocity, starting at `center_m` at t = 0.
    Line { center_m: [f64; 2], velocity_m_s: [f64; 2] },
    /// A circle starting at its easternmost point: counter-clockwise, or clockwise if its period is negative.
    Circle { center_m: [f64; 2], radius_m: f64, period_s: f64 },
    /// The four-leaved rose of section 3.2: a (sin 2wt cos wt, sin 2wt sin wt).
    Quadrifolium { center_m: [f64; 2], radius_m: f64, period_s: f64 },
    /// A Lissajous figure: (a_x sin(n_x wt + phase), a_y sin(n_y wt)) with `radii_m` a, `cycles` n.
    Lissajous {
        center_m: [f64; 2],
        radii_m: [f64; 2],
        cycles: [u32; 2],
        phase_rad: f64,
        period_s: f64,
    },
    /// A horizontal figure eight, Bernoulli's lemniscate: a cos wt / (1 + sin^2 wt) (1, sin wt). It starts at
    /// its easternmost point, towards the upper left.
    Lemniscate { center_m: [f64; 2], radius_m: f64, period_s: f64 },
    /// A path through waypoints.
    Waypoints(Path),
}

/// Direction of a trajectory at one instant: the heading of a robot whose axle midpoint follows it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Direction {
    /// Angle of m'(t), rad; in reverse, that of -m'(t).
    pub heading_rad: f64,
    /// Turn rate, rad/s.
    pub turn_rate_rad_s: f64,
    /// Turn acceleration, rad/s^2.
    pub turn_acceleration_rad_s2: f64,
}

/// Maximum turn within half a step of [`Trajectory::direction_at`], rad. A larger one is a cusp, where the direction
/// jumps and has no rate.
const HALF_STEP_TURN_RAD_MAX: f64 = 0.35;

impl Trajectory {
    /// Returns the direction of m(t), with rates from differences over `step_s`, s. Where the trajectory is at rest the
    /// heading is `heading_rad`. With `keeps_heading` it is the one of m' and -m' nearer to `heading_rad`, so that it
    /// does not jump at a cusp.
    pub fn direction_at(
        &self,
        t_s: f64,
        step_s: f64,
        heading_rad: f64,
        keeps_heading: bool,
    ) -> Direction {
        let heading_at = |t_s: f64, reference_rad: f64| {
            let velocity = self.target_at(t_s).velocity;
            let direction = towing_velocity(reference_rad, velocity, keeps_heading);
            match velocity.norm_squared() > 0.0 {
                true => portable_math::atan2(direction.y, direction.x),
                false => reference_rad,
            }
        };
        let half_s = 0.5 * step_s;
        let center_rad = heading_at(t_s, heading_rad);
        let turns =
            [-half_s, half_s].map(|s| wrap_angle(heading_at(t_s + s, center_rad) - center_rad));
        let [before, after] = match turns.iter().all(|turn| turn.abs() <= HALF_STEP_TURN_RAD_MAX) {
            true => turns,
            false => [0.0; 2],
        };
        Direction {
            heading_rad: center_rad,
            turn_rate_rad_s: (after - before) / step_s,
            turn_acceleration_rad_s2: (after + before) / (half_s * half_s),
        }
    }

    /// Returns the time from which the trajectory is at rest, s, or `None` if it never stops.
    pub fn rest_start_s(&self) -> Option<f64> {
        match self {
            Trajectory::Still { .. } => Some(0.0),
            Trajectory::Waypoints(path) => path.end_s(),
            _ => None,
        }
    }

    /// Evaluates m(t) and m'(t).
    pub fn target_at(&self, t_s: f64) -> Target {
        let (position, velocity) = match *self {
            Trajectory::Still { center_m } => (center_m.into(), Vec2::zeros()),
            Trajectory::Line { center_m, velocity_m_s } => {
                let velocity = Vec2::from(velocity_m_s);
                (Vec2::from(center_m) + velocity * t_s, velocity)
            }
            Trajectory::Circle { center_m, radius_m, period_s } => {
                let w = TAU / period_s;
                let (sin, cos) = portable_math::sin_cos(w * t_s);
                let position = Vec2::from(center_m) + radius_m * Vec2::new(cos, sin);
                (position, radius_m * w * Vec2::new(-sin, cos))
            }
            Trajectory::Quadrifolium { center_m, radius_m, period_s } => {
                let w = TAU / period_s;
                let (sin, cos) = portable_math::sin_cos(w * t_s);
                let (sin_2, cos_2) = portable_math::sin_cos(2.0 * w * t_s);
                let position = Vec2::from(center_m) + radius_m * sin_2 * Vec2::new(cos, sin);
                let slope =
                    Vec2::new(2.0 * cos_2 * cos - sin_2 * sin, 2.0 * cos_2 * sin + sin_2 * cos);
                (position, radius_m * w * slope)
            }
            Trajectory::Lissajous { center_m, radii_m, cycles, phase_rad, period_s } => {
                let w = cycles.map(|n| f64::from(n) * TAU / period_s);
                let (sin_x, cos_x) = portable_math::sin_cos(w[0] * t_s + phase_rad);
                let (sin_y, cos_y) = portable_math::sin_cos(w[1] * t_s);
                let [a_x, a_y] = radii_m;
                (
                    Vec2::from(center_m) + Vec2::new(a_x * sin_x, a_y * sin_y),
                    Vec2::new(a_x * w[0] * cos_x, a_y * w[1] * cos_y),
                )
            }
            Trajectory::Lemniscate { center_m, radius_m, period_s } => {
                let w = TAU / period_s;
                let (sin, cos) = portable_math::sin_cos(w * t_s);
                let q = 1.0 / (1.0 + sin * sin);
                let position = Vec2::from(center_m) + radius_m * q * Vec2::new(cos, sin * cos);
                // (cos q)' = -sin q (1 + 2 cos^2 q), (sin cos q)' = (1 - 3 sin^2) q^2, by wt.
                let slope = Vec2::new(
                    -sin * q * (1.0 + 2.0 * cos * cos * q),
                    (1.0 - 3.0 * sin * sin) * q * q,
                );
                (position, radius_m * w * slope)
            }
            Trajectory::Waypoints(ref path) => return path.target_at(t_s),
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
            Trajectory::Lemniscate { center_m, radius_m: 2.0, period_s },
        ]
    }

    #[test]
    fn lemniscate_has_constant_product_of_focal_distances() {
        let trajectory =
            Trajectory::Lemniscate { center_m: [1.0, -2.0], radius_m: 2.0, period_s: 40.0 };
        let focus = Vec2::new(2.0 / 2f64.sqrt(), 0.0);
        for t in 0..40 {
            let from_center = trajectory.target_at(f64::from(t)).position - Vec2::new(1.0, -2.0);
            let product = (from_center - focus).norm() * (from_center + focus).norm();
            assert!((product - 2.0).abs() < 1e-12, "{product}");
        }
        let start = trajectory.target_at(0.0);
        assert!((start.position - Vec2::new(3.0, -2.0)).norm() < 1e-12);
        assert!(start.velocity.y > 0.0);
    }

    #[test]
    fn direction_and_its_rates_are_those_of_a_circle() {
        let circle = Trajectory::Circle { center_m: [0.0, 0.0], radius_m: 2.0, period_s: 40.0 };
        let found = circle.direction_at(10.0, 0.01, 1.0, false);
        assert!((found.heading_rad.abs() - std::f64::consts::PI).abs() < 1e-12, "{found:?}");
        assert!((found.turn_rate_rad_s - TAU / 40.0).abs() < 1e-9, "{found:?}");
        assert!(found.turn_acceleration_rad_s2.abs() < 1e-6, "{found:?}");
        // In reverse, with the nearer of the two headings.
        let found = circle.direction_at(10.0, 0.01, 1.0, true);
        assert!(found.heading_rad.abs() < 1e-12, "{found:?}");
        let at_rest = Trajectory::Still { center_m: [1.0, 1.0] };
        let found = at_rest.direction_at(10.0, 0.01, 1.0, false);
        assert_eq!((found.heading_rad, found.turn_rate_rad_s), (1.0, 0.0));
    }

    #[test]
    fn direction_at_a_cusp_has_no_rate() {
        // To and fro on a line, reversing at 2.5 s.
        let line = Trajectory::Lissajous {
            center_m: [0.0, 0.0],
            radii_m: [1.0, 0.0],
            cycles: [1, 1],
            phase_rad: 0.0,
            period_s: 10.0,
        };
        for keeps_heading in [false, true] {
            let found = line.direction_at(2.5 + 1e-3, 0.01, 0.0, keeps_heading);
            assert_eq!(found.turn_rate_rad_s, 0.0, "{found:?}");
            assert_eq!(found.heading_rad == 0.0, keeps_heading, "{found:?}");
        }
    }

    #[test]
    fn circle_with_a_negative_period_runs_clockwise() {
        let circle = Trajectory::Circle { center_m: [0.0, 0.0], radius_m: 2.0, period_s: -40.0 };
        let quarter = circle.target_at(10.0);
        assert!((quarter.position - Vec2::new(0.0, -2.0)).norm() < 1e-12, "{quarter:?}");
        assert!(quarter.velocity.x < 0.0, "{quarter:?}");
    }

    #[test]
    fn waypoints_round_trip_through_toml_and_bad_ones_fail() {
        let text = |points: &str| {
            format!(
                "kind = \"waypoints\"\npoints_m = {points}\nspeed_m_s = 0.5\n\
                 acceleration_m_s2 = 0.5\nclosed = true\n"
            )
        };
        let square = text("[[0.0, 0.0], [2.0, 0.0], [2.0, 2.0], [0.0, 2.0]]");
        let trajectory: Trajectory = toml::from_str(&square).unwrap();
        let reread: Trajectory = toml::from_str(&toml::to_string(&trajectory).unwrap()).unwrap();
        assert_eq!(reread, trajectory);
        let error = toml::from_str::<Trajectory>(&text("[[0.0, 0.0]]")).unwrap_err();
        assert!(error.to_string().contains("there are 1 waypoints"), "{error}");
        assert!(toml::from_str::<Trajectory>(&format!("{square}rate_hz = 1\n")).is_err());
    }

    proptest! {
        /// Compares each periodic trajectory with its defining formula, for any period.
        #[test]
        fn periodic_trajectory_matches_its_defining_formula(
            period_s in prop_oneof![0.5..60.0f64, -60.0..-0.5f64], fraction in -2.0..2.0f64, phase_rad in -3.0..3.0f64,
            radii_m in [0.1..3.0f64, 0.1..3.0f64], cycles in [1..5u32, 1..5u32],
        ) {
            let (center_m, radius_m, turn) = ([1.0, -2.0], radii_m[0], fraction * TAU);
            let (sin, cos) = turn.sin_cos();
            let eight_factor = radius_m * cos / (1.0 + sin * sin);
            let [n_x, n_y] = cycles.map(f64::from);
            let lissajous =
                Trajectory::Lissajous { center_m, radii_m, cycles, phase_rad, period_s };
            for (trajectory, x_m, y_m) in [
                (Trajectory::Circle { center_m, radius_m, period_s }, radius_m * cos, radius_m * sin),
                (
                    Trajectory::Quadrifolium { center_m, radius_m, period_s },
                    radius_m * (2.0 * turn).sin() * cos,
                    radius_m * (2.0 * turn).sin() * sin,
                ),
                (
                    lissajous,
                    radii_m[0] * (n_x * turn + phase_rad).sin(),
                    radii_m[1] * (n_y * turn).sin(),
                ),
                (Trajectory::Lemniscate { center_m, radius_m, period_s }, eight_factor, eight_factor * sin),
            ] {
                let found = trajectory.target_at(fraction * period_s).position - Vec2::from(center_m);
                prop_assert!((found - Vec2::new(x_m, y_m)).norm() < 1e-9, "{trajectory:?}");
            }
        }

        #[test]
        fn velocity_is_the_derivative_of_position(t in 0.0..100.0f64) {
            let h = 1e-5;
            for trajectory in trajectories() {
                let slope = trajectory.target_at(t + h).position - trajectory.target_at(t - h).position;
                let slope = slope / (2.0 * h);
                prop_assert!((slope - trajectory.target_at(t).velocity).norm() < 1e-7, "{trajectory:?}");
            }
        }
    }
}
