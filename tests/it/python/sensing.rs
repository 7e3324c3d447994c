//! Sensing of a law in Python up to its own radius, a failure of the sensor, and communication by distance.

use super::runs::Workspace;

/// Scenario with a law in Python for r1, and two robots near it.
const SCENARIO: &str = r#"
name = "senses"
duration_s = 1.0
period_s = 0.01
record_hz = 100.0
robot = [
    { name = "r1", law = "looks", pose = { x_m = 0.0, y_m = 0.0, heading_rad = 0.0 } },
    { name = "r2", goal_m = [1.1, 0.0], pose = { x_m = 1.0, y_m = 0.0, heading_rad = 0.0 } },
    { name = "r3", goal_m = [3.1, 0.0], pose = { x_m = 3.0, y_m = 0.0, heading_rad = 0.0 } },
]
[laws.looks]
program = ["python3", "looks.py"]
role = "free"
sensing_radius_m = 2.0
signals = ["near_robots", "cut", "heard_robots"]
[avoidance]
kind = "none"
distance_min_m = 0.1
speed_max_m_s = 1.0
[robot_defaults]
front_point_m = 0.1
law = "goal-unit"
speed_m_s = 0.1
"#;

const LOOKS: &str = r#"
import phalanx

class Looks(phalanx.Law):
    def gamma(self, situation):
        near = situation.near
        count = -1.0 if near is None else float(len(near))
        self.record(near_robots=count, cut=float(situation.near_cut), heard_robots=float(len(situation.neighbors)))
        return 0.0, 0.0

phalanx.serve(Looks)
"#;

/// Runs the scenario with these overrides, and returns the distinct values of each signal over time.
fn signals(overrides: &str) -> String {
    let workspace = Workspace::new();
    std::fs::write(workspace.folder.path().join("senses.toml"), SCENARIO).unwrap();
    std::fs::write(workspace.folder.path().join("looks.py"), LOOKS).unwrap();
    workspace.run_program(&format!(
        "run = phalanx.run('senses.toml', pace='lockstep', out='a', draw=False, {overrides})\n\
         for name in ('near_robots', 'cut', 'heard_robots'):\n\
         \x20   values = run.signals[run.signals.signal == name].value\n\
         \x20   print(name, *(int(value) for value in values[values.shift() != values]))"
    ))
}

#[test]
#[ignore = "needs the package that tests/python/install installs"]
fn law_senses_as_far_as_it_asks_and_none_while_the_sensor_fails() {
    let output = signals("faults=['blackout r1 proximity @0.3 for 0.2']");
    assert_eq!(output, "near_robots 1 -1 1\ncut 0\nheard_robots 0\n");
    let output = signals("laws={'looks': {'sensing_radius_m': 4.0}}");
    assert_eq!(output, "near_robots 2\ncut 0\nheard_robots 0\n");
}

#[test]
#[ignore = "needs the package that tests/python/install installs"]
fn law_hears_only_robots_within_the_radius() {
    let output = signals("graph={'kind': 'disk', 'radius_m': 1.5}");
    assert_eq!(output, "near_robots 1\ncut 0\nheard_robots 0 1\n");
    let output = signals("graph={'kind': 'disk', 'radius_m': 5.0}");
    assert_eq!(output, "near_robots 1\ncut 0\nheard_robots 0 2\n");
}
