//! Scenarios in their shorter forms and with imported graphs, as a user runs them.

use std::path::{Path, PathBuf};

use crate::harness::{Phalanx, run_file};

/// `phalanx run PATH --pace lockstep`.
fn run(scenario: &Path) -> Phalanx {
    run_file(scenario).lockstep()
}

/// A scenario in a folder of its own, beside copies of `tests/graphs`.
fn beside_graphs(text: &str) -> (tempfile::TempDir, PathBuf) {
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
fn a_run_with_an_imported_graph_can_be_run_again_without_the_graphs_file() {
    let (folder, path) = beside_graphs(
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
