//! Runs for analysis: `phalanx.run`, `phalanx.load`, and the notebook that shows them.

use std::path::Path;

use tempfile::TempDir;

use super::{ROOT, python};
use crate::harness::{ExitsWith as _, RunRoot};

/// A working folder with the shipped scenarios, and a run root.
pub(super) struct Workspace {
    pub(super) folder: TempDir,
    pub(super) run_root: RunRoot,
}

impl Workspace {
    pub(super) fn new() -> Workspace {
        let folder = tempfile::tempdir().unwrap();
        let scenarios = Path::new(ROOT).join("scenarios");
        std::os::unix::fs::symlink(scenarios, folder.path().join("scenarios")).unwrap();
        Workspace { folder, run_root: RunRoot::new() }
    }

    /// Runs Python, which must exit with 0, and returns its output.
    #[track_caller]
    pub(super) fn python(&self, arguments: &[&str]) -> String {
        let mut command = python(arguments);
        command.current_dir(self.folder.path()).env("PHALANX_RUN_ROOT", self.run_root.path());
        command.exits_with(0).stdout
    }

    /// Runs a Python program, which must exit with 0, and returns its output.
    #[track_caller]
    pub(super) fn run_program(&self, program: &str) -> String {
        self.python(&["-c", &format!("import phalanx\n{program}")])
    }
}

#[test]
#[ignore = "needs the package that tests/python/install installs"]
fn python_run_equals_command_line_run_with_tables_as_frames() {
    let workspace = Workspace::new();
    let output = workspace.run_program(
        "run = phalanx.run('scenarios/triangle.toml', pace='lockstep', out='a', duration_s=2, expect={})\n\
         print(run.summary['trajectory_hash'], run.held, sorted(run.figures)[:2], run.report.exists())\n\
         again = phalanx.load('a')\n\
         print(*again.samples.columns, len(again.samples), again.samples.t_s.max())\n\
         print(len(again.pairs), again.pairs.min_distance_m.min() == run.summary['min_distance_m'])\n\
         print(list(again.events.kind[:3]), 'stage' in again.latency.columns)\n\
         print(again.figures['errors']._repr_svg_().startswith('<svg'))",
    );
    let set = ["duration_s=2", "expect={}"];
    let same = set.iter().fold(crate::harness::run("triangle").lockstep(), |run, set| run.set(set));
    let same = same.finish();
    let samples = same.file("samples.csv");
    let (columns, rows) = samples.split_once('\n').unwrap();
    let expected = format!(
        "{} True ['distances', 'error_components'] True\n{} {} 2.0\n3 True\n['ready', 'ready', 'ready'] True\nTrue\n",
        same.hash(),
        columns.replace(',', " "),
        rows.lines().count(),
    );
    assert_eq!(output, expected);
}

#[test]
#[ignore = "needs the package that tests/python/install installs"]
fn scenario_keys_are_given_as_python_values() {
    let workspace = Workspace::new();
    workspace.run_program(
        "import numpy\n\
         phalanx.run('scenarios/triangle.toml', pace='lockstep', out='b', draw=False, duration_s=numpy.float64(0.5),\n\
             name='the \"b\"', expect={}, avoidance={'distance_min_m': 0.15}, realtime={'control_timer': False},\n\
             faults=['kill r2 @0.1 restart 0.1'], robot={'r1': {'speed_m_s': 0.2}}, fault=[dict(\n\
                 kind='freeze', robot='r3', at_s=0.2, for_s=0.1)])",
    );
    let text = std::fs::read_to_string(workspace.folder.path().join("b/scenario.toml")).unwrap();
    let scenario: toml::Table = text.parse().unwrap();
    assert_eq!(scenario["name"].as_str(), Some("the \"b\""));
    assert_eq!(scenario["duration_s"].as_float(), Some(0.5));
    assert_eq!(scenario["avoidance"]["distance_min_m"].as_float(), Some(0.15));
    assert_eq!(scenario["avoidance"]["speed_max_m_s"].as_float(), Some(0.3), "the rest stays");
    assert_eq!(scenario["realtime"]["control_timer"].as_bool(), Some(false));
    assert_eq!(scenario["robot"][0]["speed_m_s"].as_float(), Some(0.2));
    let kinds = scenario["fault"].as_array().unwrap().iter().map(|fault| fault["kind"].as_str());
    assert_eq!(kinds.collect::<Vec<_>>(), [Some("freeze"), Some("kill")]);
    let output = workspace.run_program("print(phalanx.load('b').figures)");
    assert_eq!(output, "{}\n", "nothing was drawn");
}

#[test]
#[ignore = "needs the package that tests/python/install installs"]
fn failure_is_an_exception_with_the_phalanx_message() {
    let workspace = Workspace::new();
    let output = workspace.run_program(
        "for words in [dict(duration_s=-1), dict(speed=1), dict(faults=['kill plant @0.1'], duration_s=0.5, expect={})]:\n\
         \x20   try: phalanx.run('scenarios/triangle.toml', pace='lockstep', out='c', draw=False, **words)\n\
         \x20   except phalanx.RunError as error: print(error.code, str(error).splitlines()[0])\n\
         missed = phalanx.run('scenarios/triangle.toml', pace='lockstep', out='d', draw=False, duration_s=1,\n\
             expect={'converged_by_s': 1})\n\
         print(missed.held)\n\
         try: phalanx.load('scenarios')\n\
         except FileNotFoundError as error: print(error)\n\
         try: phalanx.run('scenarios/triangle.toml', name={1, 2})\n\
         except TypeError as error: print(error)",
    );
    let expected = "3 error: `duration_s` is -1\n\
         3 error: the scenario has no key `speed`\n\
         4 error: the plant died (signal 9); the last lines of its log:\n\
         False\n\
         scenarios is not a run directory: it has no scenario.toml; expected a directory written by `phalanx run`\n\
         {1, 2} is no value of a scenario: expected numbers, strings, lists and dicts of them\n";
    assert_eq!(output, expected);
}

#[test]
#[ignore = "needs the package that tests/python/install installs"]
fn paths_with_a_leading_dash_are_not_options() {
    let workspace = Workspace::new();
    let output = workspace.run_program(
        "import shutil\n\
         for call in phalanx.run, phalanx.hunt, phalanx.sweep:\n\
         \x20   try: call('--help', out='none')\n\
         \x20   except phalanx.RunError as error: print(error.code, str(error).splitlines()[0])\n\
         shutil.copy('scenarios/triangle.toml', '--version')\n\
         run = phalanx.run('--version', pace='lockstep', out='-o', draw=False, duration_s=0.5, expect={})\n\
         print(run.path, run.summary['t_s'])",
    );
    let scenario = "3 error: `./--help` does not exist; expected a scenario file, such as scenarios/triangle.toml\n";
    let campaign = "3 error: `./--help` does not exist; expected a campaign file, such as scenarios/campaigns/";
    let [ran, hunted, swept, written] = output.split_inclusive('\n').collect::<Vec<_>>()[..] else {
        panic!("{output}")
    };
    assert_eq!([ran, hunted, written], [scenario, scenario, "-o 0.5\n"]);
    assert!(swept.starts_with(campaign), "{swept}");
}

#[test]
#[ignore = "needs the package that tests/python/install installs"]
fn missing_pandas_fails_only_frames_and_names_the_package() {
    let workspace = Workspace::new();
    let output = workspace.run_program(
        "import sys\n\
         sys.modules['pandas'] = None\n\
         run = phalanx.run('scenarios/triangle.toml', pace='lockstep', out='e', draw=False, duration_s=0.5, expect={})\n\
         print(run.summary['t_s'])\n\
         try: run.events\n\
         except ImportError as error: print(error)",
    );
    assert!(
        output.starts_with("0.5\nRun.events is a pandas frame, and pandas cannot be imported"),
        "{output}"
    );
    assert!(output.ends_with("pip install pandas; the table itself is e/events.csv\n"), "{output}");
}

#[test]
#[ignore = "needs the package that tests/python/install installs"]
fn notebook_runs_completely() {
    let workspace = Workspace::new();
    let nbclient = Path::new(ROOT).join("tests/python/by_nbclient.py");
    let notebook = Path::new(ROOT).join("bindings/python/examples/first_look.ipynb");
    let output = workspace.python(&[nbclient.to_str().unwrap(), notebook.to_str().unwrap()]);
    for part in ["image/svg+xml", "text/html", ", True)\n", "kill", "ready", "'trajectories'"] {
        assert!(output.contains(part), "{part}: {output}");
    }
}
