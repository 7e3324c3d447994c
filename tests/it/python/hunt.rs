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
    let output = workspace.run_program(&format!(
        "def spacing(run): return run.pairs.min_distance_m.min() / 0.2 - 1\n\
         own = phalanx.hunt({CROSSING}, margin=spacing, runs=100, out='own')\n\
         same = phalanx.hunt({CROSSING}, runs=100, out='same')\n\
         print(own.found, same.found, own.document['run'] == same.document['run'])\n\
         print(own.document['trajectory_hash'] == same.document['trajectory_hash'])\n\
         print(own.document['expectation'], own.document['what'].split(' is ')[0], own.scenario.name)\n\
         print(abs(spacing(own.run) - own.document['margin_of_file']) < 1e-12, own.run.report.exists())\n\
         print(own.document['trajectory_hash'], sorted(path.name for path in own.path.glob('asked*')))"
    ));
    let (report_text, last) = output.trim_end().rsplit_once('\n').unwrap();
    let expected = "True True True\nTrue\nspacing spacing antipodal-8-spacing.toml\nTrue True";
    assert_eq!(report_text, expected);
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
    let output = workspace.run_program(&format!(
        "def broken(run): return run.summary['no such key']\n\
         try: phalanx.hunt({CROSSING}, margin=broken, runs=8)\n\
         except KeyError as error: print(error)\n\
         for margin in [lambda run: float('nan'), lambda run: None]:\n\
         \x20   try: phalanx.hunt({CROSSING}, margin=margin, runs=8, out='b')\n\
         \x20   except (phalanx.RunError, TypeError) as error: print(type(error).__name__, error)\n\
         try: phalanx.hunt({CROSSING}, vary=['start'])\n\
         except phalanx.RunError as error: print(error.code, error)"
    ));
    let lines: Vec<&str> = output.lines().collect();
    let [raised, no_number, none, refused, ..] = lines[..] else { panic!("{output}") };
    assert_eq!(raised, "'no such key'");
    assert_eq!(no_number, "RunError error: <lambda> is \"nan\", but must be a number");
    assert!(none.starts_with("TypeError ") && none.contains("NoneType"), "{none}");
    assert!(refused.starts_with("2 error: invalid value 'start' for '--vary <WHAT>'"), "{refused}");
}

/// Two robots that drive to their targets by a law in Python.
const SEEKERS: &str = r#"
name = "seekers"
duration_s = 4.0
period_s = 0.02
robot = [
    { name = "r1", params = { at_m = [0.0, 0.0] }, pose = { x_m = 0.0, y_m = 0.1, heading_rad = 0.0 } },
    { name = "r2", params = { at_m = [2.0, 0.0] }, pose = { x_m = 2.0, y_m = 0.1, heading_rad = 0.0 } },
]
[laws.seek]
program = ["python3", "seek.py"]
role = "free"
gains = ["k_per_s"]
[avoidance]
kind = "none"
distance_min_m = 0.2
speed_max_m_s = 1.0
[robot_defaults]
front_point_m = 0.1
law = "seek"
k_per_s = 3.0
[hunt]
vary = ["starts"]
[expect]
final_error_m_max = 0.05
"#;

/// The law, with a defect beyond x = 2.2 m, in the place of `DEFECT`.
const SEEK: &str = r#"
import phalanx

class Seek(phalanx.Law):
    def gamma(self, situation):
        (x, y), (u, v) = situation.front_point, self.robot.params["at_m"]
        self.target((u, v))
        k = self.k_per_s
        if x > 2.2:
            DEFECT
        return k * (u - x), k * (v - y)

phalanx.serve(Seek)
"#;

/// Creates a working folder with the scenario and its law with this defect.
fn workspace_with_defect(defect: &str) -> Workspace {
    let workspace = Workspace::new();
    let folder = workspace.folder.path();
    std::fs::write(folder.join("seekers.toml"), SEEKERS).unwrap();
    std::fs::write(folder.join("seek.py"), SEEK.replace("DEFECT", defect)).unwrap();
    workspace
}

#[test]
#[ignore = "needs the package that tests/python/install installs"]
fn defect_of_a_python_law_is_found_shrunk_and_replayed() {
    let workspace = workspace_with_defect("k = -k");
    let output = workspace.run_program(
        "hunt = phalanx.hunt('seekers.toml', runs=40, out='out')\n\
         d = hunt.document\n\
         print(hunt.found, d['expectation'], d['starts'], d['faults'], d['margin_of_file'] < 0)\n\
         replay = phalanx.run(hunt.scenario, pace='lockstep', out='replay', draw=False)\n\
         hashes = {run.summary['trajectory_hash'] for run in (replay, hunt.run)}\n\
         print(hashes == {d['trajectory_hash']}, replay.held)\n\
         print(hunt.run.report.exists(), (hunt.path / 'runs').exists())",
    );
    assert_eq!(output, "True final_error_m_max 1 0 True\nTrue False\nTrue False\n");
    // The journal continues the hunt, and a changed law is another hunt.
    let hunt = || {
        let mut hunt = installed();
        hunt.args(["hunt", "seekers.toml", "--runs", "40", "--out", "out"]);
        hunt.current_dir(workspace.folder.path());
        hunt.env("PHALANX_RUN_ROOT", workspace.run_root.path());
        hunt
    };
    let before = std::fs::read(workspace.folder.path().join("out/journal.csv")).unwrap();
    let ended = hunt().exits_with(1);
    assert!(ended.stderr.contains("each run has a process for each robot"), "{}", ended.stderr);
    let after = std::fs::read(workspace.folder.path().join("out/journal.csv")).unwrap();
    assert_eq!(before, after);
    std::fs::write(workspace.folder.path().join("seek.py"), SEEK.replace("DEFECT", "k = 0"))
        .unwrap();
    let output = hunt().exits_with(2).stderr;
    assert!(output.contains("another hunt"), "{output}");
}

/// Robot r2, which goes to the point that it receives from r1.
const FOLLOWERS: &str = r#"
name = "followers"
duration_s = 4.0
period_s = 0.02
robot = [
    { name = "r1", params = { at_m = [0.0, 0.0] }, pose = { x_m = 0.0, y_m = 0.1, heading_rad = 0.0 } },
    { name = "r2", hears = ["r1"], params = { at_m = [2.0, 0.0] }, pose = { x_m = 2.0, y_m = 0.1, heading_rad = 0.0 } },
]
[laws.follow]
program = ["python3", "follow.py"]
role = "free"
message = { at_m = 2 }
[avoidance]
kind = "none"
distance_min_m = 0.2
speed_max_m_s = 1.0
[robot_defaults]
front_point_m = 0.1
law = "follow"
[hunt]
vary = ["faults"]
kinds = ["lie"]
faults_max = 2
until_s = 4.0
message_error_max = 2.0
[expect]
final_error_m_max = 0.05
"#;

const FOLLOW: &str = r#"
import phalanx

class Follow(phalanx.Law):
    def gamma(self, situation):
        (x, y), (u, v) = situation.front_point, self.robot.params["at_m"]
        self.target((u, v))
        self.publish(at_m=(2.0, 0.0))
        for other in situation.neighbors:
            if other.message:
                u, v = other.message["at_m"]
        return 3.0 * (u - x), 3.0 * (v - y)

phalanx.serve(Follow)
"#;

#[test]
#[ignore = "needs the package that tests/python/install installs"]
fn hunt_finds_false_messages_and_replays_them() {
    let workspace = Workspace::new();
    let folder = workspace.folder.path();
    std::fs::write(folder.join("followers.toml"), FOLLOWERS).unwrap();
    std::fs::write(folder.join("follow.py"), FOLLOW).unwrap();
    // The law ignores the positions in beacons: only a lie in messages misleads it.
    let output = workspace.run_program(
        "hunt = phalanx.hunt('followers.toml', runs=100, out='out')\n\
         d = hunt.document\n\
         print(hunt.found, d['expectation'], d['faults'], d['margin_of_file'] < 0)\n\
         text = open(hunt.scenario).read()\n\
         print('message_' in text, 'random_m' in text)\n\
         replay = phalanx.run(hunt.scenario, pace='lockstep', out='replay', draw=False)\n\
         hashes = {run.summary['trajectory_hash'] for run in (replay, hunt.run)}\n\
         print(hashes == {d['trajectory_hash']}, replay.held)",
    );
    assert_eq!(output, "True final_error_m_max 1 True\nTrue False\nTrue False\n");
}

#[test]
#[ignore = "needs the package that tests/python/install installs"]
fn python_law_that_raises_misses_failed_robots() {
    let workspace = workspace_with_defect("raise ValueError('too far')");
    let output = workspace.run_program(
        "def margin(run): return 1 - run.samples.error_m.dropna().max() / 100\n\
         hunt = phalanx.hunt('seekers.toml', margin=margin, runs=40, expect={})\n\
         print(hunt.found, hunt.document['expectation'], hunt.document['starts'])\n\
         print(hunt.document['what'].split(' (')[0])",
    );
    assert_eq!(output, "True failed_robots 1\nfailed_robots is 1\n");
}
