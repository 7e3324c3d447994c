//! Walls: the findings of `check`, the measures of a run among walls, and the drawings of walls.

use std::path::Path;

use experiment::scenario::diagnostic::Severity;
use experiment::scenario::read::{Overrides, read};
use formation::Vec2;

use crate::harness::run;
use crate::oracle::{self, scenario};

const PATH: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/scenarios/corridor.toml");

/// Returns the warnings about `corridor` with these keys set: the line that each points at, and its message.
fn warned(set: &[&str]) -> Vec<(String, String)> {
    let overrides =
        Overrides { assignments: set.iter().map(|&s| s.into()).collect(), ..Overrides::default() };
    let (_, text, warnings) = read(Path::new(PATH), &overrides, &agent::catalog()).unwrap();
    let line = |line: u32| text.lines().nth(line as usize - 1).unwrap().trim().to_owned();
    let warnings = warnings.into_iter().filter(|one| one.severity == Severity::Warning);
    warnings.map(|one| (line(one.line), one.message)).collect()
}

#[test]
fn slots_and_trajectories_near_walls_are_reported_with_line() {
    // The outer robots' slots swing out of the corridor where it bends, by design of the scenario.
    let [(line, message)] = &warned(&[])[..] else { panic!("{:?}", warned(&[])) };
    assert!(line.starts_with("{ name = \"r"), "{line}");
    assert!(message.contains("avoidance steers it away from there (1 more"), "{message}");
    let with_large_clearance = warned(&["avoidance.clearance_m=0.9"]);
    let (line, message) = &with_large_clearance[0];
    assert!(line.starts_with("points_m = [[0.0, 0.0]"), "{line}");
    assert!(message.starts_with("the trajectory of r1 is 0.89"), "{message}");
    // A body that extends farther from its front point than the clearance.
    let (line, message) = &warned(&["avoidance.clearance_m=0.2"])[0];
    assert!(
        line.contains("clearance_m") && message.contains("but not bodies"),
        "{line}: {message}"
    );
    let (line, message) = &warned(&["avoidance.kind=none"])[0];
    assert!(line.contains("kind") && message.contains("ignores walls"), "{line}: {message}");
}

#[test]
fn robot_unaware_of_walls_crosses_them_and_is_counted() {
    let free = oracle::simulate(&scenario("corridor", &["avoidance.kind=none", "expect={}"]));
    let clearance = free.min_clearance.unwrap();
    assert!(clearance.distance_m < 0.01, "{clearance:?}");
    assert!(free.clearance_violations > 100, "{}", free.clearance_violations);
}

/// Returns the minimum distance of a recorded front point from a wall, m.
fn recorded_clearance(samples: &str) -> f64 {
    let corridor = scenario("corridor", &[]);
    let walls = corridor.obstacles();
    let front = |line: &str| {
        let fields: Vec<&str> = line.split(',').collect();
        let number = |i: usize| fields[i].parse::<f64>().unwrap();
        let (sin, cos) = number(4).sin_cos();
        Vec2::new(number(2), number(3)) + 0.1 * Vec2::new(cos, sin)
    };
    let distances =
        samples.lines().skip(1).map(|line| walls.nearest_obstacle(front(line)).unwrap().distance_m);
    distances.fold(f64::INFINITY, f64::min)
}

#[test]
fn run_reports_and_judges_minimum_clearance_and_draws_walls() {
    let ended = run("corridor").lockstep().drawing().set("record_hz=50").finish();
    ended.exits_with(0);
    let clearance = &ended.summary["min_clearance"];
    let found_m = clearance["distance_m"].as_f64().unwrap();
    let samples = std::fs::read_to_string(ended.run_dir().join("samples.csv")).unwrap();
    // Every tick is recorded.
    let recorded_m = recorded_clearance(&samples);
    ended.assert_holds(
        (found_m - recorded_m).abs() < 1e-9,
        format!("{found_m} m is {recorded_m} m"),
    );
    ended.assert_holds((0.21..0.25).contains(&found_m), "the corridor is narrow");
    let wall = clearance["wall"].as_str().unwrap();
    ended.assert_holds(wall == "wall 1" || wall == "wall 2", format!("{wall} is a wall"));
    let at = ["/min_clearance/at_m/0", "/min_clearance/at_m/1"].map(|key| ended.number(key));
    let corridor = scenario("corridor", &[]);
    let distance_m = corridor.obstacles().nearest_obstacle(at.into()).unwrap().distance_m;
    ended.assert_holds((distance_m - found_m).abs() < 1e-12, "it was there");
    let expectations = ended.summary["expectations"].as_array().unwrap();
    let expectation = expectations.iter().find(|one| one["name"] == "min_clearance_m").unwrap();
    ended.assert_holds(expectation["held"] == true, "the clearance was kept");

    let read = |path: &str| std::fs::read_to_string(ended.run_dir().join(path)).unwrap();
    ended.assert_holds(
        read("report.html").contains("Smallest clearance"),
        "the page shows the clearance",
    );
    let figure = read("figures/trajectories.svg");
    ended.assert_holds(
        figure.contains("Gray: walls") || read("report.html").contains("Gray: walls"),
        "drawn",
    );
    let brief = read("briefs/plant.toml");
    ended.assert_holds(brief.matches("[[obstacle]]").count() == 24, "every segment is an obstacle");
    let missed = run("corridor").lockstep().set("expect={min_clearance_m=0.3}").finish();
    missed.exits_with(1);
}
