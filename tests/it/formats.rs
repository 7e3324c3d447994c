//! Scenarios in short forms and with imported graphs, run like by a user.

use std::path::{Path, PathBuf};

use crate::harness::{Phalanx, run_file};

/// Prepares `phalanx run PATH --pace lockstep`.
fn run(scenario: &Path) -> Phalanx {
    run_file(scenario).lockstep()
}

/// Writes a scenario to a temporary folder, with copies of `tests/graphs`.
fn write_scenario_with_graphs(text: &str) -> (tempfile::TempDir, PathBuf) {
    let folder = tempfile::tempdir().unwrap();
    let graphs = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/graphs");
    for entry in std::fs::read_dir(graphs).unwrap() {
        let path = entry.unwrap().path();
        std::fs::copy(&path, folder.path().join(path.file_name().unwrap())).unwrap();
    }
    let path = folder.path().join("scenario.toml");
    std::fs::write(&path, text).unwrap();
    (folder, path)
}

#[test]
fn run_with_imported_graph_repeats_without_the_graph_file() {
    let (folder, path) = write_scenario_with_graphs(
        "name = \"imported\"\nduration_s = 1.0\nperiod_s = 0.005\n\
         graph = \"triangle.graphml\"\n\
         avoidance = { distance_min_m = 0.2, speed_max_m_s = 0.3 }\n\
         robot_defaults = { front_point_m = 0.045 }\n",
    );
    let first = run(&path).finish();
    assert_eq!(first.code, Some(0), "{}", first.stderr);
    let effective = first.run_dir().join("scenario.toml");
    let again = run(&effective).finish();
    assert_eq!(again.code, Some(0), "{}", again.stderr);
    assert_eq!(again.summary["trajectory_hash"], first.summary["trajectory_hash"]);
    assert_eq!(
        std::fs::read_to_string(again.run_dir().join("scenario.toml")).unwrap(),
        std::fs::read_to_string(effective).unwrap()
    );
    drop(folder);
}

#[test]
fn undirected_leader_graph_runs_after_edges_are_dropped() {
    let (folder, path) = write_scenario_with_graphs(
        "name = \"led\"\nduration_s = 0.2\nperiod_s = 0.02\n\
         graph = \"all-hear-all.json\"\ndrop_edges_to_leaders = true\n\
         trajectory = { kind = \"still\" }\n\
         avoidance = { kind = \"guard\", distance_min_m = 0.2, speed_max_m_s = 0.5 }\n\
         robot_defaults = { front_point_m = 0.05, law = \"formation-unit\", speed_m_s = 0.3, k_m_m_s = 1.0 }\n\
         robot = [\n\
         { name = \"r1\", law = \"leader-tanh\", place_m = [0.6, 0.0], pose = { x_m = 0.6, y_m = 0.0, heading_rad = 0.0 } },\n\
         { name = \"r2\", place_m = [-0.3, 0.5], pose = { x_m = -0.3, y_m = 0.5, heading_rad = 0.0 } },\n\
         { name = \"r3\", place_m = [-0.3, -0.5], pose = { x_m = -0.3, y_m = -0.5, heading_rad = 0.0 } },\n]\n",
    );
    let first = run(&path).finish();
    assert_eq!(first.code, Some(0), "{}", first.stderr);
    let again = run(&first.run_dir().join("scenario.toml")).finish();
    assert_eq!(again.summary["trajectory_hash"], first.summary["trajectory_hash"]);
    let set = run(&path).set("drop_edges_to_leaders=false").finish();
    assert_eq!(set.code, Some(3), "{}", set.stderr);
    drop(folder);
}
