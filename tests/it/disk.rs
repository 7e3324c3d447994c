//! Communication by distance: links come and go with the distance of their ends, as events, and equally in process and
//! by processes.

use std::path::Path;

use serde_json::json;
use tempfile::TempDir;

use crate::harness::{ExitsWith as _, RunRoot, phalanx, run_file};

/// Four robots: r1 and r2 swap sides and pass each other, r3 and r4 stay far away and are near each other.
const CROSSING: &str = r#"
name = "crossing"
duration_s = 12.0
period_s = 0.01
graph = { kind = "disk", radius_m = 0.8, hysteresis_m = 0.1 }
robot = [
    { name = "r1", goal_m = [1.0, 0.0], pose = { x_m = -1.1, y_m = 0.0, heading_rad = 0.0 } },
    { name = "r2", goal_m = [-1.0, 0.3], pose = { x_m = 1.1, y_m = 0.3, heading_rad = 3.0 } },
    { name = "r3", goal_m = [9.0, 0.1], pose = { x_m = 9.0, y_m = 0.0, heading_rad = 0.0 } },
    { name = "r4", goal_m = [9.5, 0.1], pose = { x_m = 9.5, y_m = 0.0, heading_rad = 0.0 } },
]
[avoidance]
kind = "guard"
distance_min_m = 0.15
speed_max_m_s = 0.4
[robot_defaults]
front_point_m = 0.1
law = "goal-unit"
speed_m_s = 0.3
"#;

fn folder() -> TempDir {
    let folder = tempfile::tempdir().unwrap();
    std::fs::write(folder.path().join("crossing.toml"), CROSSING).unwrap();
    folder
}

/// Returns the contact changes of a table of events, as robot, new state and other robot.
fn contacts(events: &str) -> Vec<String> {
    let lines = events.lines().map(|line| line.split(',').collect::<Vec<_>>());
    let contacts = lines.filter(|line| line[1] == "contact");
    contacts.map(|line| format!("{} {} {}", line[2], line[5], line[4])).collect()
}

#[test]
fn links_by_distance_are_events_and_repeat_bit_by_bit() {
    let folder = folder();
    let run = || run_file(&folder.path().join("crossing.toml")).lockstep().finish();
    let (first, second) = (run(), run());
    first.exits_with(0).assert_leaves_nothing();
    first.assert_holds(first.hash() == second.hash(), "the trajectory is the same");
    first.assert_holds(first.file("events.csv") == second.file("events.csv"), "so are the events");
    let mut found = contacts(&first.file("events.csv"));
    let of_pair = |found: &[String], pair: [&str; 2]| -> Vec<String> {
        let is_of_pair = |line: &&String| line.starts_with(pair[0]) && line.ends_with(pair[1]);
        found.iter().filter(is_of_pair).cloned().collect()
    };
    // Each link comes once and goes once, without chatter.
    for [to, from] in [["r1", "r2"], ["r2", "r1"]] {
        let changes = of_pair(&found, [to, from]);
        let expected = [format!("{to} fresh {from}"), format!("{to} apart {from}")];
        first.assert_holds(changes == expected, format!("{changes:?}"));
    }
    found.retain(|line| line.contains("r3") || line.contains("r4"));
    found.sort();
    first.assert_holds(found == ["r3 fresh r4", "r4 fresh r3"], format!("{found:?}"));
}

#[test]
fn links_by_distance_are_equal_in_process_and_by_processes() {
    let folder = folder();
    let campaign = "name = \"c\"\nscenario = \"crossing.toml\"\npace = \"lockstep\"\nseeds = 1\nkeep = \"all\"\n\
                    faults = [\"kill r2 @3 restart 1\"]\n";
    std::fs::write(folder.path().join("campaign.toml"), campaign).unwrap();
    let run_root = RunRoot::new();
    let sweep = |out: &str, more: &[&str]| -> [String; 3] {
        let out = folder.path().join(out);
        let mut sweep = phalanx(["sweep"]);
        sweep.arg(folder.path().join("campaign.toml")).arg("--out").arg(&out);
        sweep.args(more).env("PHALANX_RUN_ROOT", run_root.path()).exits_with(0);
        let run = std::fs::read_dir(out.join("runs")).unwrap().next().unwrap().unwrap().path();
        let text = |path: &Path| std::fs::read_to_string(path).unwrap();
        [out.join("runs.csv"), run.join("events.csv"), run.join("samples.csv")].map(|p| text(&p))
    };
    let (by_processes, in_process) = (sweep("own", &[]), sweep("same", &["--in-process"]));
    assert_eq!(by_processes, in_process);
    assert!(contacts(&by_processes[1]).contains(&"r1 apart r2".to_owned()), "{}", by_processes[1]);
}

#[test]
fn check_says_what_the_distance_means() {
    let folder = folder();
    let output = phalanx(["check"]).arg(folder.path().join("crossing.toml")).exits_with(0).stdout;
    let line = "a robot is heard from 0.8 m on, until it is more than 0.9 m away; at the start 2 of 12 links";
    assert!(output.contains(line), "{output}");
    let mut text = CROSSING.to_owned();
    let mut robots = String::new();
    for i in 5..=65 {
        let x_m = 10.0 * f64::from(i);
        robots += &format!(
            "{{ name = \"r{i}\", goal_m = [{x_m}, 0.0], pose = {{ x_m = {x_m}, y_m = 0.0, heading_rad = 0.0 }} }},\n"
        );
    }
    text = text.replace("]\n[avoidance]", &format!("{robots}]\n[avoidance]"));
    std::fs::write(folder.path().join("many.toml"), text).unwrap();
    let output = phalanx(["check"]).arg(folder.path().join("many.toml")).exits_with(3).stderr;
    let expected = "is communication by distance between 65 robots";
    assert!(output.contains(expected) && output.contains("at most 64 robots"), "{output}");
}

#[test]
fn schema_takes_a_graph_file_or_a_disk() {
    let schema = phalanx(["schema"]).exits_with(0).stdout;
    let schema: serde_json::Value = serde_json::from_str(&schema).unwrap();
    let graph = &schema["properties"]["graph"]["anyOf"];
    assert_eq!(graph[0], json!({ "type": "string" }), "{graph:#}");
}
