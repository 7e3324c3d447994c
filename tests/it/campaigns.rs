//! Campaigns: one file, many runs, one table, which is the same after any interruption.

use std::ffi::OsStr;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};

use rustix::process::Signal;
use tempfile::TempDir;

use crate::harness::{
    ExitsWith as _, ROOT, RunRoot, assert_texts_beside, files_below, phalanx, signal_pid,
};

/// Deadline of every campaign. Only a hang reaches it.
const HANG: Duration = Duration::from_secs(400);

/// A campaign file in a temporary folder, with a separate run root.
pub struct CampaignDir {
    scratch: TempDir,
    run_root: RunRoot,
}

impl CampaignDir {
    pub fn new(text: &str) -> CampaignDir {
        let scratch = tempfile::tempdir().unwrap();
        let text = text.replace("SCENARIOS", &format!("{ROOT}/scenarios"));
        fs::write(scratch.path().join("campaign.toml"), text).unwrap();
        CampaignDir { scratch, run_root: RunRoot::new() }
    }

    pub fn out_path(&self, name: &str) -> PathBuf {
        self.scratch.path().join(name)
    }

    pub fn file(&self, name: &str) -> String {
        fs::read_to_string(self.out_path(name)).unwrap_or_default()
    }

    /// Prepares `phalanx sweep` into the folder of that name.
    pub fn sweep(&self, out: &str, args: &[&str]) -> Command {
        let mut command = phalanx(["sweep"]);
        command.arg(self.out_path("campaign.toml")).arg("--out").arg(self.out_path(out));
        command.args(args);
        self.prepared(command)
    }

    pub fn prepared(&self, mut command: Command) -> Command {
        command
            .env("PHALANX_RUN_ROOT", self.run_root.path())
            .env("NO_COLOR", "1")
            .stdin(Stdio::null())
            .stdout(Stdio::piped())
            .stderr(Stdio::piped());
        command
    }

    /// Counts the complete runs of a folder.
    fn complete(&self, out: &str) -> usize {
        let runs = fs::read_dir(self.out_path(out).join("runs")).into_iter().flatten().flatten();
        runs.filter(|run| !run.file_name().to_string_lossy().contains('.')).count()
    }

    fn wait_for_runs(&self, child: &mut Child, out: &str, runs: usize) {
        self.wait_for(child, || self.complete(out) >= runs);
    }

    /// Waits until a condition holds for a running sweep. Panics if the sweep ends first, or at the deadline.
    pub fn wait_for(&self, child: &mut Child, what: impl Fn() -> bool) {
        let start = Instant::now();
        while !what() {
            assert!(child.try_wait().unwrap().is_none(), "it ended first");
            assert!(start.elapsed() < HANG, "nothing within {HANG:?}");
            std::thread::sleep(Duration::from_millis(2));
        }
    }

    /// Waits until no process uses the run root: children of a killed sweep exit by themselves.
    pub fn assert_no_process_left(&self) {
        let start = Instant::now();
        loop {
            self.run_root.sweep();
            let files = files_below(self.run_root.path());
            let files: Vec<_> = files.iter().filter(|path| path.is_file()).collect();
            if files.is_empty() {
                return;
            }
            assert!(start.elapsed() < HANG, "left in the run root: {files:?}");
            std::thread::sleep(Duration::from_millis(20));
        }
    }
}

#[track_caller]
pub fn run_to_exit_code(mut command: Command, code: i32) -> String {
    command.exits_with(code).stdout_and_stderr()
}

/// Campaign of nine short runs with different starts.
pub const NINE_RUN_CAMPAIGN: &str = "name = \"nine\"\nscenario = \"SCENARIOS/triangle.toml\"\nseeds = 9\n\
    starts = { box_m = [1.6, 1.6], apart_m = 0.3 }\n\
    set = { duration_s = 1.0, period_s = 0.02, expect.converged_by_s = 1.0 }\n";

fn rows(table: &str) -> Vec<Vec<&str>> {
    table.lines().map(|line| line.split(',').collect()).collect()
}

#[test]
fn campaign_killed_twice_ends_with_an_identical_table() {
    let campaign = CampaignDir::new(NINE_RUN_CAMPAIGN);
    run_to_exit_code(campaign.sweep("whole", &[]), 0);
    for runs in [3, 6] {
        let mut child = campaign.sweep("killed", &["--jobs", "1"]).spawn().unwrap();
        campaign.wait_for_runs(&mut child, "killed", runs);
        signal_pid(child.id(), Signal::KILL);
        child.wait().unwrap();
        assert!(!campaign.out_path("killed/runs.csv").exists());
    }
    // Completed runs are not repeated.
    let before = campaign.complete("killed");
    assert!((6..9).contains(&before), "{before} of 9 runs after the second kill");
    let output = run_to_exit_code(campaign.sweep("killed", &[]), 0);
    assert!(output.contains(&format!("{} runs in", 9 - before)), "{output}");
    let [uninterrupted, killed] =
        ["whole", "killed"].map(|out| campaign.file(&format!("{out}/runs.csv")));
    assert_eq!(uninterrupted, killed);
    assert_eq!(rows(&uninterrupted).len(), 10, "{uninterrupted}");
    let hashes: std::collections::BTreeSet<_> =
        rows(&uninterrupted).iter().map(|row| row[3].to_owned()).collect();
    assert_eq!(hashes.len(), 10, "each seed starts elsewhere:\n{uninterrupted}");
    let left = fs::read_dir(campaign.out_path("killed/runs")).unwrap().flatten();
    let left: Vec<_> = left.map(|entry| entry.file_name()).collect();
    assert_eq!(left.len(), 9, "nothing is left of runs that were cut short: {left:?}");
    campaign.assert_no_process_left();
}

#[test]
fn interrupted_campaign_prints_progress_and_can_be_resumed() {
    let campaign = CampaignDir::new(NINE_RUN_CAMPAIGN);
    let mut child = campaign.sweep("out", &["--jobs", "1"]).spawn().unwrap();
    campaign.wait_for_runs(&mut child, "out", 1);
    signal_pid(child.id(), Signal::INT);
    let output = child.wait_with_output().unwrap();
    let stderr = String::from_utf8_lossy(&output.stderr);
    assert_eq!(output.status.code(), Some(130), "{stderr}");
    assert!(stderr.contains("of 9 runs are done"), "{stderr}");
    let left = fs::read_dir(campaign.out_path("out/runs")).unwrap().flatten();
    assert!(left.map(|entry| entry.file_name()).all(|name| name.len() == 64), "no part of a run");
    campaign.assert_no_process_left();
    // The table has the completed runs, and the exit code shows that it is incomplete.
    let output = run_to_exit_code(campaign.sweep("out", &["--collect"]), 4);
    assert!(output.contains("are missing"), "{output}");
    run_to_exit_code(campaign.sweep("out", &[]), 0);
    assert_eq!(rows(&campaign.file("out/runs.csv")).len(), 10);
}

#[test]
fn second_sweep_into_a_folder_in_use_is_refused_with_owner() {
    let campaign = CampaignDir::new(NINE_RUN_CAMPAIGN);
    let mut first = campaign.sweep("out", &["--jobs", "1"]).spawn().unwrap();
    campaign.wait_for_runs(&mut first, "out", 1);
    let output = run_to_exit_code(campaign.sweep("out", &[]), 2);
    assert!(output.contains(&format!("process {} on ", first.id())), "{output}");
    // A command that runs nothing may read the folder.
    run_to_exit_code(campaign.sweep("out", &["--emit-commands"]), 0);
    assert_eq!(first.wait().unwrap().code(), Some(0));
    let output = run_to_exit_code(campaign.sweep("out", &[]), 0);
    assert!(output.contains("9 of 9 runs"), "it is free again: {output}");
    campaign.assert_no_process_left();
}

#[test]
fn run_identity_is_independent_of_the_scenario_path_spelling() {
    let campaign = CampaignDir::new("");
    let scenarios = Path::new(ROOT).join("scenarios");
    std::os::unix::fs::symlink(&scenarios, campaign.out_path("linked")).unwrap();
    // One scenario has its graph in a separate file.
    for name in ["triangle.toml", "swarm64.toml"] {
        let absolute = scenarios.join(name).to_str().unwrap().to_owned();
        let paths = [absolute, format!("linked/{name}"), format!("./linked/../scenarios/{name}")];
        let identities = paths.map(|path| {
            let text = format!("name = \"one\"\nscenario = \"{path}\"\nseeds = 1\n");
            fs::write(campaign.out_path("campaign.toml"), text).unwrap();
            let line = run_to_exit_code(campaign.sweep("out", &["--emit-commands"]), 0);
            let (_, run) = line.split_once("/runs/").expect("a run");
            run[..64].to_owned()
        });
        assert!(identities.iter().all(|one| *one == identities[0]), "{name}: {identities:?}");
    }
}

#[test]
fn axes_zips_and_faults_make_the_grid_and_the_table() {
    let campaign = CampaignDir::new(
        "name = \"grid\"\nscenario = \"SCENARIOS/triangle.toml\"\n\
         zip = [[\"avoidance.kind\", \"period_s\"]]\nfaults = [\"loss r2->r1 of {lost} @0.1\"]\n\
         set = { duration_s = 0.4, expect.converged_by_s = 0.4 }\n\
         [vary]\navoidance.kind = [\"guard\", \"none\"]\nperiod_s = [0.01, 0.02]\n\
         lost = [\"none\", 1]\nfault = [\"none\", \"kill r3 @0.2\"]\n",
    );
    run_to_exit_code(campaign.sweep("out", &[]), 0);
    let table = campaign.file("out/runs.csv");
    let rows = rows(&table);
    assert_eq!(rows[0][..5], ["avoidance.kind", "period_s", "lost", "fault", "seed"]);
    let points: Vec<String> = rows[1..].iter().map(|row| row[..4].join(" ")).collect();
    assert_eq!(
        points,
        [
            "guard 0.01 none none",
            "guard 0.01 none kill r3 @0.2",
            "guard 0.01 1 none",
            "guard 0.01 1 kill r3 @0.2",
            "none 0.02 none none",
            "none 0.02 none kill r3 @0.2",
            "none 0.02 1 none",
            "none 0.02 1 kill r3 @0.2",
        ]
    );
    let column = |name: &str| rows[0].iter().position(|head| *head == name).unwrap();
    for row in &rows[1..] {
        let alive = if row[3] == "none" { "3" } else { "2" };
        assert_eq!(row[column("alive_at_end")], alive, "{row:?}");
        let ticks = if row[1] == "0.01" { "40" } else { "20" };
        assert_eq!(row[column("ticks")], ticks, "{row:?}");
    }
    let page = campaign.file("out/report.html");
    assert!(page.contains("avoidance.kind") && page.contains("Wilson"), "{page}");
    let json: serde_json::Value =
        serde_json::from_str(&campaign.file("out/campaign.json")).unwrap();
    assert_eq!(json["points"].as_array().unwrap().len(), 8);
    assert_eq!(json["zip"], serde_json::json!([["avoidance.kind", "period_s"]]));
}

#[test]
fn case_descriptions_are_in_the_report_and_campaign_json() {
    let campaign = CampaignDir::new(
        "name = \"cases\"\nscenario = \"SCENARIOS/triangle.toml\"\nseeds = 1\n\
         case = [\n\
         { axis = \"robots\", name = \"all live\" },\n\
         { axis = \"robots\", name = \"one dies\", faults = [\"kill r3 @0.1\"], set = { period_s = 0.01 }, \
           starts = { box_m = [2, 3], apart_m = 0.3 } },\n\
         ]\nset = { duration_s = 0.2, expect = {} }\n",
    );
    run_to_exit_code(campaign.sweep("out", &["--in-process"]), 0);
    let json: serde_json::Value =
        serde_json::from_str(&campaign.file("out/campaign.json")).unwrap();
    let cases = &json["axes"][0]["cases"];
    assert_eq!(cases[0]["faults"], serde_json::json!([]));
    assert_eq!(cases[1]["faults"], serde_json::json!(["kill r3 @0.1"]));
    assert_eq!(cases[1]["set"], serde_json::json!(["period_s=0.01"]));
    assert_eq!(cases[1]["starts"]["box_m"], serde_json::json!([2.0, 3.0]));
    let page = campaign.file("out/report.html");
    assert!(page.contains("robots all live: nothing changed"), "{page}");
    assert!(
        page.contains("robots one dies: period_s=0.01; fault kill r3 @0.1; starts drawn"),
        "{page}"
    );
}

#[test]
fn run_with_three_machinery_failures_is_retried_on_request() {
    let campaign = CampaignDir::new(&NINE_RUN_CAMPAIGN.replace("seeds = 9", "seeds = 1"));
    let nowhere = |args: &[&str]| {
        let mut command = campaign.sweep("out", args);
        command.env("PHALANX_RUN_ROOT", campaign.out_path("no/such/place"));
        command
    };
    let output = run_to_exit_code(nowhere(&[]), 4);
    assert!(output.contains("1 given up"), "{output}");
    let table = campaign.file("out/runs.csv");
    assert!(table.lines().nth(1).unwrap().starts_with("1,infrastructure,4,"), "{table}");
    assert!(campaign.file("out/timing.csv").lines().nth(1).unwrap().contains(",3,"));
    // The run stays declared failed.
    run_to_exit_code(campaign.sweep("out", &[]), 4);
    run_to_exit_code(campaign.sweep("out", &["--retry"]), 0);
    assert!(!campaign.file("out/runs.csv").contains("infrastructure"));
}

#[test]
fn real_time_runs_are_sequential_and_kept_on_request() {
    let campaign = CampaignDir::new(
        "name = \"real\"\nscenario = \"SCENARIOS/triangle.toml\"\npace = \"realtime\"\nseeds = 2\n\
         keep = \"all\"\nset = { duration_s = 0.5, period_s = 0.02, expect.converged_by_s = 0.5 }\n",
    );
    let output = run_to_exit_code(campaign.sweep("out", &["--jobs", "2"]), 0);
    assert!(output.contains("one run at a time") && output.contains(", 1 at a time"), "{output}");
    let runs = fs::read_dir(campaign.out_path("out/runs")).unwrap().flatten();
    let recorded = runs.filter(|run| run.path().join("run.mcap").exists()).count();
    assert_eq!(recorded, 2);
}

#[test]
fn commands_printed_for_other_engines_give_the_same_table() {
    let campaign = CampaignDir::new(&NINE_RUN_CAMPAIGN.replace("seeds = 9", "seeds = [4, 7]"));
    run_to_exit_code(campaign.sweep("own", &[]), 0);
    let lines = run_to_exit_code(campaign.sweep("theirs", &["--emit-commands"]), 0);
    assert_eq!(lines.lines().count(), 2, "{lines}");
    for line in lines.lines() {
        let mut shell = Command::new("sh");
        shell.args(["-c", line]);
        run_to_exit_code(campaign.prepared(shell), 0);
    }
    assert_eq!(run_to_exit_code(campaign.sweep("theirs", &["--emit-commands"]), 0), "");
    run_to_exit_code(campaign.sweep("theirs", &["--collect"]), 0);
    assert_eq!(campaign.file("own/runs.csv"), campaign.file("theirs/runs.csv"));
}

#[test]
fn batched_commands_run_only_their_runs_and_give_equal_tables() {
    let campaign = CampaignDir::new(&NINE_RUN_CAMPAIGN.replace("seeds = 9", "seeds = 4"));
    run_to_exit_code(campaign.sweep("own", &[]), 0);
    let output = run_to_exit_code(campaign.sweep("theirs", &["--only", "2"]), 0);
    assert!(output.contains("nine: 1 of 1 runs (2) have a result\n"), "{output}");
    assert_eq!((campaign.complete("theirs"), campaign.file("theirs/runs.csv")), (1, String::new()));
    let emit = ["--emit-commands", "--chunk", "2", "--in-process"];
    let lines = run_to_exit_code(campaign.sweep("theirs", &emit), 0);
    let only = lines.lines().map(|line| line.split(" --only ").nth(1).unwrap());
    let expected = ["1,3 --jobs 1 --in-process", "4 --jobs 1 --in-process"];
    assert_eq!(only.collect::<Vec<_>>(), expected);
    for line in lines.lines() {
        let mut shell = Command::new("sh");
        // From any folder.
        shell.args(["-c", line]).current_dir("/");
        run_to_exit_code(campaign.prepared(shell), 0);
    }
    assert_eq!(run_to_exit_code(campaign.sweep("theirs", &emit), 0), "");
    run_to_exit_code(campaign.sweep("theirs", &["--collect"]), 0);
    assert_eq!(campaign.file("own/runs.csv"), campaign.file("theirs/runs.csv"));
    let output = run_to_exit_code(campaign.sweep("theirs", &["--only", "3-5"]), 2);
    assert!(output.contains("--only 3-5 is out of range: nine has 4 runs"), "{output}");
    let output =
        run_to_exit_code(campaign.sweep("theirs", &["--emit-commands", "--in-process"]), 2);
    assert!(output.contains("add --chunk RUNS"), "{output}");
}

/// Runs the commands of a campaign with another engine: a shell command in which `COMMANDS` is the file of the
/// commands.
fn run_with_engine(engine: &str) {
    let campaign = CampaignDir::new(NINE_RUN_CAMPAIGN);
    run_to_exit_code(campaign.sweep("own", &[]), 0);
    let lines = run_to_exit_code(campaign.sweep("theirs", &["--emit-commands"]), 0);
    fs::write(campaign.out_path("commands.txt"), &lines).unwrap();
    let tools = Path::new(ROOT).join("target/engines/bin");
    let mut shell = Command::new("bash");
    let path = format!("{}:{}", tools.display(), std::env::var("PATH").unwrap());
    shell.args(["-euc", engine]).current_dir(campaign.out_path("")).env("PATH", path);
    run_to_exit_code(campaign.prepared(shell), 0);
    run_to_exit_code(campaign.sweep("theirs", &["--collect"]), 0);
    assert_eq!(campaign.file("own/runs.csv"), campaign.file("theirs/runs.csv"));
    campaign.assert_no_process_left();
}

#[test]
#[ignore = "needs GNU parallel, which tests/engines/install installs"]
fn engines_gnu_parallel_gives_the_same_table() {
    run_with_engine("parallel --joblog log --retries 3 < commands.txt");
}

#[test]
#[ignore = "needs HyperQueue, which tests/engines/install installs"]
fn engines_hyperqueue_gives_the_same_table() {
    run_with_engine(&format!("python {ROOT}/tests/engines/by_hyperqueue.py commands.txt"));
}

#[test]
fn every_bad_campaign_gets_its_diagnostic_and_exit_status_3() {
    let scratch = tempfile::tempdir().unwrap();
    let out = scratch.path().join("out");
    assert_texts_beside("tests/bad_campaigns", 15, |path| {
        let sweep = [OsStr::new("sweep"), path.as_os_str(), OsStr::new("--out"), out.as_os_str()];
        let stderr = phalanx(sweep).exits_with(3).stderr;
        assert!(!out.exists(), "a folder was made for {}", path.display());
        stderr
    });
}

#[test]
fn every_shipped_campaign_is_valid() {
    let folder = Path::new(ROOT).join("scenarios/campaigns");
    let files = fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().path());
    let files: Vec<PathBuf> =
        files.filter(|path| path.extension() == Some("toml".as_ref())).collect();
    assert!(files.len() >= 5, "{files:?}");
    for file in files {
        if let Err(diagnostic) = experiment::campaign::file::read(&file, &agent::catalog()) {
            panic!("{}", diagnostic.render(false));
        }
    }
}
