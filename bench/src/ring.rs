//! Scenarios of the benchmarks: a ring of any size, and a single robot.

use std::f64::consts::{PI, TAU};
use std::fmt::Write as _;
use std::path::Path;

use experiment::scenario::Scenario;
use experiment::scenario::read::{Overrides, read_text};

use formation::portable_math;

/// Distance of neighbors on the ring, m.
const GAP_M: f64 = 0.6;
/// Distance of a robot's start from its slot, m.
const OFF_M: f64 = 0.1;
/// Number of following robots from which each one receives.
const HEARS_MAX: usize = 4;

/// Keys that all scenarios have in common. A replacement is started without delay, any number of times.
const REST: &str = r#"
[avoidance]
kind = "guard"
distance_min_m = 0.2
speed_max_m_s = 0.3
[robot_defaults]
front_point_m = 0.045
restart_policy = "always"
restart_delay_s = 0.0
max_restarts = 1000000
restart_window_s = 1.0
"#;

/// Returns a ring of `robots` (2 or more) for `ticks` ticks of `period_s`. Each robot receives from the
/// next four or, in smaller rings, from all others. Robots start off their slots, in all directions.
pub fn text(robots: usize, ticks: u64, period_s: f64) -> String {
    let mut text = head(&format!("ring-{robots}"), ticks, period_s);
    let radius_m = GAP_M / (2.0 * portable_math::sin(PI / robots as f64));
    for i in 0..robots {
        let (sin, cos) = portable_math::sin_cos(TAU * i as f64 / robots as f64);
        let (x_m, y_m) = (radius_m * cos, radius_m * sin);
        let toward_rad = TAU * (0.618_033_988_7 * i as f64).fract() - PI;
        let (off_y, off_x) = portable_math::sin_cos(toward_rad);
        let hears: Vec<String> = (1..=HEARS_MAX.min(robots - 1))
            .map(|next| format!("\"r{}\"", (i + next) % robots + 1))
            .collect();
        let _ = write!(
            text,
            "[[robot]]\nname = \"r{}\"\nlaw = \"formation-unit\"\nspeed_m_s = 0.1\n\
             hears = [{}]\nplace_m = [{x_m}, {y_m}]\n\
             pose = {{ x_m = {}, y_m = {}, heading_rad = {toward_rad} }}\n",
            i + 1,
            hears.join(", "),
            x_m + OFF_M * off_x,
            y_m + OFF_M * off_y,
        );
    }
    text + REST
}

/// Returns the number of ticks, at least one, and the text of a ring at this rate for `seconds`.
pub(crate) fn lasting(robots: usize, rate_hz: u64, seconds: f64) -> (u64, String) {
    let ticks = ((seconds * rate_hz as f64) as u64).max(1);
    (ticks, text(robots, ticks, 1.0 / rate_hz as f64))
}

/// Returns the text of a scenario with a single leader `name` on a circle.
pub(crate) fn alone(name: &str, ticks: u64, period_s: f64) -> String {
    let mut text = head("alone", ticks, period_s);
    let _ = write!(
        text,
        "trajectory = {{ kind = \"circle\", radius_m = 1.0, period_s = 60.0 }}\n\
         [[robot]]\nname = \"{name}\"\nlaw = \"leader-tanh\"\nk_m_m_s = 1.0\n\
         pose = {{ x_m = 1.0, y_m = -0.1, heading_rad = 1.5 }}\n",
    );
    text + REST
}

fn head(name: &str, ticks: u64, period_s: f64) -> String {
    let duration_s = ticks as f64 * period_s;
    format!("name = \"{name}\"\nduration_s = {duration_s:.6}\nperiod_s = {period_s:.6}\n")
}

/// Parses the text of a scenario from this module.
pub fn read(text: &str) -> anyhow::Result<Scenario> {
    let overrides = Overrides { set: Vec::new(), faults: Vec::new(), seed: None };
    match read_text(Path::new("bench.toml"), text, &overrides, &agent::catalog()) {
        Ok((scenario, ..)) => Ok(scenario),
        Err(diagnostic) => Err(anyhow::anyhow!(diagnostic.render(false))),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rings_of_every_size_and_rate_are_sound_and_as_long_as_asked() {
        for robots in [2, 3, 4, 5, 8, 64, 256] {
            for period_s in [0.001, 0.005, 0.01] {
                let scenario = read(&text(robots, 7, period_s)).unwrap();
                assert_eq!(scenario.robots.len(), robots);
                assert_eq!(scenario.duration_ns, 7 * scenario.period_ns);
                let heard = |i: usize| scenario.graph.edges().iter().filter(|e| e.to == i).count();
                assert!((0..robots).all(|i| heard(i) == HEARS_MAX.min(robots - 1)));
            }
        }
    }

    #[test]
    fn a_robot_may_run_alone() {
        assert_eq!(read(&alone("solo", 7, 0.005)).unwrap().robots.len(), 1);
    }
}
