//! Hunts from Python: the margin may be a function of a run's tables, and a result can be replayed.

use super::installed;
use super::runs::Workspace;
use crate::harness::ExitsWith as _;

/// Eight robots that cross without avoidance for a short time.
const CROSSING: &str =
    "'scenarios/antipodal-8.toml', avoidance={'kind': 'none'}, duration_s=4, expect={}";

#[test]
#[ignore = "needs the package that tests/python/install installs"]
fn table_function_agrees_with_expectation_and_processes() {
    let workspace = Workspace::new();
    let said = workspace.run_program(&format!(
        "def spacing(run): return run.pairs.min_distance_m.min() / 0.2 - 1\n\
         own = phalanx.hunt({CROSSING}, margin=spacing, runs=100, out='own')\n\
         same = phalanx.hunt({CROSSING}, runs=100, out='same')\n\
         print(own.found, same.found, own.document['run'] == same.document['run'])\n\
         print(own.document['trajectory_hash'] == same.document['trajectory_hash'])\n\
         print(own.document['expectation'], own.document['what'].split(' is ')[0], own.scenario.name)\n\
         print(abs(spacing(own.run) - own.document['margin_of_file']) < 1e-12, own.run.report.exists())\n\
         print(own.document['trajectory_hash'], sorted(path.name for path in own.path.glob('asked*')))"
    ));
    let (words, last) = said.trim_end().rsplit_once('\n').unwrap();
    let expected = "True True True\nTrue\nspacing spacing antipodal-8-spacing.toml\nTrue True";
    assert_eq!(words, expected);
    let (hash, left) = last.split_once(' ').unwrap();
    assert_eq!(left, "[]");
    let found = workspace.folder.path().join("own/found/antipodal-8-spacing.toml");
    let mut run = installed();
    run.arg("run").arg(&found).args(["--pace", "lockstep", "--out", "again"]);
    run.current_dir(workspace.folder.path()).env("PHALANX_RUN_ROOT", workspace.run_root.path());
    run.exits_with(0);
    let summary =
        std::fs::read_to_string(workspace.folder.path().join("again/summary.json")).unwrap();
    let summary: serde_json::Value = serde_json::from_str(&summary).unwrap();
    assert_eq!(summary["trajectory_hash"], hash);
}

#[test]
#[ignore = "needs the package that tests/python/install installs"]
fn function_errors_propagate_and_non_numbers_are_reported() {
    let workspace = Workspace::new();
    let said = workspace.run_program(&format!(
        "def broken(run): return run.summary['no such key']\n\
         try: phalanx.hunt({CROSSING}, margin=broken, runs=8)\n\
         except KeyError as error: print(error)\n\
         for margin in [lambda run: float('nan'), lambda run: None]:\n\
         \x20   try: phalanx.hunt({CROSSING}, margin=margin, runs=8, out='b')\n\
         \x20   except (phalanx.RunError, TypeError) as error: print(type(error).__name__, error)\n\
         try: phalanx.hunt({CROSSING}, vary=['start'])\n\
         except phalanx.RunError as error: print(error.code, error)"
    ));
    let lines: Vec<&str> = said.lines().collect();
    let [raised, no_number, none, refused, ..] = lines[..] else { panic!("{said}") };
    assert_eq!(raised, "'no such key'");
    assert_eq!(no_number, "RunError error: <lambda> is \"nan\", but must be a number");
    assert!(none.starts_with("TypeError ") && none.contains("NoneType"), "{none}");
    assert!(refused.starts_with("2 error: invalid value 'start' for '--vary <WHAT>'"), "{refused}");
}
