//! Generated scenarios of the bench: a ring with any number of robots, and a single robot.

use std::f64::consts::{PI, TAU};
use std::fmt::Write as _;
use std::path::Path;

use experiment::scenario::Scenario;
use experiment::scenario::read::{Overrides, read_text};

use formation::portable_math;

/// Distance between adjacent robots on the ring, m.
const GAP_M: f64 = 0.6;
/// Distance from a robot's slot to its start position, m.
const START_OFFSET_M: f64 = 0.1;
/// Control law of the robots of a ring.
pub(crate) const RING_LAW: &str = "formation-unit";
/// Maximum number of in-neighbors of each robot.
const NEIGHBORS_MAX: usize = 4;

/// Tables that all generated scenarios have in common. Robots restart immediately and practically without limit.
const COMMON_TABLES: &str = r#"
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

/// Returns the scenario text of a ring with a duration of `ticks` periods of `period_s`. Requires at least 2 `robots`.
/// Each robot receives from the next four robots, or from all others in smaller rings, and starts at a small distance
/// from its slot; the directions of these offsets are spread over the circle.
pub fn ring_scenario_text(robots: usize, ticks: u64, period_s: f64) -> String {
    ring_scenario_text_with_law(robots, ticks, period_s, RING_LAW)
}

/// Returns the scenario text of [`ring_scenario_text`] with another control law, which has the same gains.
pub(crate) fn ring_scenario_text_with_law(
    robots: usize,
    ticks: u64,
    period_s: f64,
    law: &str,
) -> String {
    let mut text = scenario_header_text(&format!("ring-{robots}"), ticks, period_s);
    let radius_m = GAP_M / (2.0 * portable_math::sin(PI / robots as f64));
    for i in 0..robots {
        let (sin, cos) = portable_math::sin_cos(TAU * i as f64 / robots as f64);
        let (x_m, y_m) = (radius_m * cos, radius_m * sin);
        let direction_rad = TAU * (0.618_033_988_7 * i as f64).fract() - PI;
        let (offset_y, offset_x) = portable_math::sin_cos(direction_rad);
        let in_neighbors: Vec<String> = (1..=NEIGHBORS_MAX.min(robots - 1))
            .map(|offset| format!("\"r{}\"", (i + offset) % robots + 1))
            .collect();
        let _ = write!(
            text,
            "[[robot]]\nname = \"r{}\"\nlaw = \"{law}\"\nspeed_m_s = 0.1\n\
             hears = [{}]\nplace_m = [{x_m}, {y_m}]\n\
             pose = {{ x_m = {}, y_m = {}, heading_rad = {direction_rad} }}\n",
            i + 1,
            in_neighbors.join(", "),
            x_m + START_OFFSET_M * offset_x,
            y_m + START_OFFSET_M * offset_y,
        );
    }
    text + COMMON_TABLES
}

/// Returns the number of ticks, at least 1, and the scenario text of a ring with this rate and duration.
pub(crate) fn ring_text_for_duration(robots: usize, rate_hz: u64, seconds: f64) -> (u64, String) {
    let ticks = ((seconds * rate_hz as f64) as u64).max(1);
    (ticks, ring_scenario_text(robots, ticks, 1.0 / rate_hz as f64))
}

/// Returns the scenario text of a single robot: a leader named `name` that follows a circle.
pub(crate) fn single_robot_text(name: &str, ticks: u64, period_s: f64) -> String {
    let mut text = scenario_header_text("alone", ticks, period_s);
    let _ = write!(
        text,
        "trajectory = {{ kind = \"circle\", radius_m = 1.0, period_s = 60.0 }}\n\
         [[robot]]\nname = \"{name}\"\nlaw = \"leader-tanh\"\nk_m_m_s = 1.0\n\
         pose = {{ x_m = 1.0, y_m = -0.1, heading_rad = 1.5 }}\n",
    );
    text + COMMON_TABLES
}

fn scenario_header_text(name: &str, ticks: u64, period_s: f64) -> String {
    let duration_s = ticks as f64 * period_s;
    format!("name = \"{name}\"\nduration_s = {duration_s:.6}\nperiod_s = {period_s:.6}\n")
}

/// Parses the text of a generated scenario.
///
/// # Errors
/// If the scenario is invalid.
pub fn parse_scenario(text: &str) -> anyhow::Result<Scenario> {
    let overrides = Overrides { assignments: Vec::new(), faults: Vec::new(), seed: None };
    match read_text(Path::new("bench.toml"), text, &overrides, &agent::catalog()) {
        Ok((scenario, ..)) => Ok(scenario),
        Err(diagnostic) => Err(anyhow::anyhow!(diagnostic.render(false))),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ring_of_any_size_and_rate_is_valid_and_has_the_duration() {
        for robots in [2, 3, 4, 5, 8, 64, 256] {
            for period_s in [0.001, 0.005, 0.01] {
                let scenario = parse_scenario(&ring_scenario_text(robots, 7, period_s)).unwrap();
                assert_eq!(scenario.robots.len(), robots);
                assert_eq!(scenario.duration_ns, 7 * scenario.period_ns);
                let in_degree =
                    |i: usize| scenario.graph.edges().iter().filter(|e| e.to == i).count();
                assert!((0..robots).all(|i| in_degree(i) == NEIGHBORS_MAX.min(robots - 1)));
            }
        }
    }

    #[test]
    fn single_robot_scenario_is_valid() {
        assert_eq!(parse_scenario(&single_robot_text("solo", 7, 0.005)).unwrap().robots.len(), 1);
    }
}
