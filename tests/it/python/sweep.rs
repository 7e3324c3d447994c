//! Parameter studies from Python: any executor gives the table of `phalanx sweep`, also if a worker is killed.

use std::path::Path;

use super::runs::Workspace;
use super::{ROOT, installed};
use crate::campaigns::NINE_RUN_CAMPAIGN;
use crate::harness::ExitsWith as _;

/// Creates a working folder with a campaign of twelve runs.
fn campaign_workspace() -> Workspace {
    let workspace = Workspace::new();
    let text =
        NINE_RUN_CAMPAIGN.replace("SCENARIOS", "scenarios").replace("seeds = 9", "seeds = 12");
    std::fs::write(workspace.folder.path().join("campaign.toml"), text).unwrap();
    workspace
}

fn table(workspace: &Workspace, out: &str) -> String {
    std::fs::read_to_string(workspace.folder.path().join(out).join("runs.csv")).unwrap()
}

/// Asserts that a folder has the table that the command line writes for the same campaign.
#[track_caller]
fn assert_table_of_the_command_line(workspace: &Workspace, out: &str) {
    let mut sweep = installed();
    sweep.args(["sweep", "campaign.toml", "--out", "own"]).current_dir(workspace.folder.path());
    sweep.env("PHALANX_RUN_ROOT", workspace.run_root.path()).exits_with(0);
    assert_eq!(table(workspace, out), table(workspace, "own"));
}

#[track_caller]
fn run_with_executor(workspace: &Workspace, executor: &str) -> String {
    let program = Path::new(ROOT).join("tests/python/by_executors.py");
    workspace.python(&[program.to_str().unwrap(), executor])
}

#[test]
#[ignore = "needs the package that tests/python/install installs"]
fn killed_dask_worker_leaves_the_table_of_the_command_line() {
    let workspace = campaign_workspace();
    let expected = "killed in the middle True gone True\n1 12 0 12 12 0\nTrue\nTrue\nTrue\n";
    assert_eq!(run_with_executor(&workspace, "dask"), expected);
    assert_table_of_the_command_line(&workspace, "dask");
}

#[test]
#[ignore = "needs the package that tests/python/install installs"]
fn killed_pool_reports_finished_runs_and_can_be_resumed() {
    let workspace = campaign_workspace();
    let output = run_with_executor(&workspace, "pool");
    let lines: Vec<&str> = output.lines().collect();
    let [message, hint_line, status_line, total_line] = lines[..] else { panic!("{output}") };
    let finished = status_line.strip_prefix("killed in the middle True there ").unwrap();
    let expected_start = format!(
        "4 nine: {finished} of 12 runs, {} are missing",
        12 - finished.parse::<u32>().unwrap()
    );
    assert!(message.starts_with(&expected_start), "{output}");
    assert!(message.contains(": the executor failed (BrokenProcessPool: "), "{output}");
    assert!(hint_line.contains("call phalanx.sweep again with a working executor"), "{output}");
    assert_eq!(total_line, "12");
    assert_table_of_the_command_line(&workspace, "pool");
}

#[test]
#[ignore = "needs the package that tests/python/install installs"]
fn invalid_executor_or_one_without_workers_is_named() {
    let workspace = campaign_workspace();
    let output = workspace.run_program(
        "from concurrent.futures import Executor, Future\n\
         class Nobody(Executor):\n\
         \x20   def submit(self, *words): return Future()\n\
         for words in [dict(executor=Nobody(), wait_s=0.2), dict(executor=3), dict(out='scenarios/triangle.toml'), {}]:\n\
         \x20   file = 'campaign.toml' if words else 'scenarios/triangle.toml'\n\
         \x20   try: phalanx.sweep(file, **{'out': 'none', **words})\n\
         \x20   except (phalanx.RunError, TypeError) as error: print(str(error).splitlines()[0])\n\
         try: phalanx.Campaign('scenarios')\n\
         except FileNotFoundError as error: print(error)",
    );
    let lines: Vec<&str> = output.lines().collect();
    let expected = [
        "nine: 0 of 12 runs, 12 are missing: no task ended for 0.2 s, which is `wait_s`: are there workers?",
        "executor=3 has no method submit: expected a concurrent.futures.Executor, such as ProcessPoolExecutor() or \
         Dask's Client.get_executor()",
        "error: cannot make scenarios/triangle.toml/runs: Not a directory (os error 20)",
        "error: the campaign has no key `duration_s`",
        "scenarios is not the folder of a campaign: it has no campaign.json; expected a folder written by `phalanx sweep`",
    ];
    assert_eq!(lines, expected);
}

#[test]
#[ignore = "needs the package that tests/python/install installs"]
fn executor_without_futures_or_with_false_results_is_named() {
    let workspace = campaign_workspace();
    let output = workspace.run_program(
        "from concurrent.futures import Executor, Future\n\
         class NoFuture(Executor):\n\
         \x20   def submit(self, *words): return None\n\
         class FalseResult(Executor):\n\
         \x20   def submit(self, *words):\n\
         \x20       future = Future()\n\
         \x20       future.set_result(3)\n\
         \x20       return future\n\
         for executor in NoFuture(), FalseResult():\n\
         \x20   try: phalanx.sweep('campaign.toml', out='none', executor=executor)\n\
         \x20   except (phalanx.RunError, TypeError) as error: print(type(error).__name__, str(error).splitlines()[0])",
    );
    let [no_future, false_result] = output.lines().collect::<Vec<_>>()[..] else {
        panic!("{output}")
    };
    assert_eq!(
        no_future,
        "TypeError executor.submit returned None, which has no method add_done_callback: expected a future as \
         concurrent.futures.Executor returns it"
    );
    let result = "the executor gave 3 as the result of a task, expected what the task returned";
    assert!(false_result.starts_with("RunError ") && false_result.ends_with(result), "{output}");
}

#[test]
#[ignore = "needs the package that tests/python/install installs"]
fn every_run_table_is_a_frame() {
    let workspace = Workspace::new();
    let output = workspace.run_program(
        "import subprocess\n\
         run = phalanx.run('scenarios/triangle.toml', pace='lockstep', out='a', draw=False, duration_s=0.5, expect={})\n\
         subprocess.run(['phalanx', 'export', 'a'], check=True, capture_output=True)\n\
         tables = phalanx.load('a').tables\n\
         print(*tables)\n\
         print(tables['samples'].equals(run.samples), tables['export/poses'].columns[1])",
    );
    let expected = "events export/commands export/distances export/errors export/events export/poses latency \
                    latency_over_time pairs samples\nTrue robot\n";
    assert_eq!(output, expected);
}
