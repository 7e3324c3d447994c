//! Campaigns within one process: their results equal those of runs with processes, byte for byte.

use std::fs;
use std::path::Path;

use run::in_process::InProcessRun;
use run::in_process::measured::create_controller;
use rustix::process::Signal;
use serde_json::Value;

use crate::campaigns::{CampaignDir, NINE_RUN_CAMPAIGN, run_to_exit_code};
use crate::harness::signal_pid;
use crate::oracle::with_faults;

/// Campaign with every feature that is possible without processes.
const FULL_CAMPAIGN: &str = "name = \"all\"\nscenario = \"SCENARIOS/triangle.toml\"\nkeep = \"KEEP\"\n\
    case = [\n\
    { axis = \"case\", name = \"kills\", faults = [\"kill r2 @0.4 restart 0.3\", \"kill r2 @0.9 restart 0.2\", \
      \"freeze r3 @0.4 for 0.4\", \"freeze r1 @0.6 for 0.1\", \"kill r1 @1\", \"kill r3 @1.2\"] },\n\
    { axis = \"case\", name = \"at the start\", faults = [\"kill r2 @0 restart 0.1\", \
      \"freeze r3 @0 for 0.1\", \"freeze r1 @0.3\"] },\n\
    { axis = \"case\", name = \"sensors\", faults = [\"noise r1 odometry by 0.01 @0.1 for 1\", \
      \"noise r3 proximity by 0.01 @0.1 for 1\", \"blackout r2 odometry @0.3 for 0.3\", \
      \"slow r3 by 0.03 @0.3 for 0.3\", \"wheels r1 limit 0.03 @0.4 for 0.5\"] },\n\
    { axis = \"case\", name = \"radio\", faults = [\"delay * odometry by 0.02 @0\", \
      \"delay * commands by 0.02 jitter 0.01 @0\", \"bursts * odometry of 0.2 mean 0.1 @0\", \
      \"bursts * commands of 0.2 mean 0.1 @0\", \"bursts r2->r1 of 0.5 mean 0.1 @0\", \
      \"delay r1->r3 by 0.05 jitter 0.03 @0.2\", \"loss r2->r1 of 0.3 @0\", \"cut r1->r3 @0.5 for 0.3\"] },\n\
    { axis = \"case\", name = \"goals\", scenario = \"SCENARIOS/antipodal-8.toml\", set = { \
      expect.converged_by_s = 1.5, chaos = { mean_time_between_kills_s = 0.3, restart_after_s = 0.3, \
      mean_time_between_freezes_s = 0.3 } } },\n\
    { axis = \"case\", name = \"walls\", scenario = \"SCENARIOS/corridor.toml\", \
      faults = [\"kill r2 @0.5 restart 0.4\"] },\n\
    { axis = \"case\", name = \"repair\", scenario = \"SCENARIOS/pentagon.toml\", set = { repair = \"spares\", \
      repair_after_s = 0.1 }, faults = [\"kill r4 @0.6 restart 0.5\", \"freeze r3 @0.7 for 0.4\"] },\n\
    { axis = \"case\", name = \"inertia\", scenario = \"SCENARIOS/pentagon-inertia.toml\" },\n]\n\
    [set]\nduration_s = 1.5\nperiod_s = 0.02\nexpect = {}\n";

/// Scenario with simultaneous faults: robots that are killed, frozen and disconnected at the same time and report it at
/// the same time; reordered beacons; bad sensors.
const CHAOS: &str = "{ axis = \"case\", name = \"chaos\", scenario = \"SCENARIOS/containment-chaos.toml\", \
    set = { duration_s = 10, period_s = 0.002, chaos = { from_s = 1, until_s = 8, restart_after_s = 0.5, \
      mean_time_between_kills_s = 1.5, mean_time_between_freezes_s = 1.5 } }, \
    faults = [\"kill r5 @3 restart 1\", \"kill r7 @3 restart 0.002\", \"freeze r2 @3 for 0.5\", \"kill r1 @6\", \
      \"cut r1->r4 @4.001 for 2\", \"loss r6->r7 of 0.9 @2 for 5\", \"delay r7->r6 by 0.006 jitter 0.01 @0.5 for 4\", \
      \"noise r3 odometry by 0.001 @1 for 3\", \"slow r8 by 0.003 @7 for 0.5\"] },\n]\n[set]";

fn runs(campaign: &CampaignDir, out: &str) -> Vec<String> {
    let runs = fs::read_dir(campaign.out_path(out).join("runs")).unwrap().flatten();
    let mut runs: Vec<String> = runs.map(|run| run.file_name().into_string().unwrap()).collect();
    runs.sort();
    runs
}

/// Returns the deterministic part of a summary.
fn determined(path: &Path) -> Value {
    let mut summary: Value = serde_json::from_str(&fs::read_to_string(path).unwrap()).unwrap();
    let wall = summary.as_object_mut().unwrap().remove("wall").unwrap();
    assert!(wall["wall_s"].as_f64().unwrap() > 0.0, "{path:?}: {wall}");
    summary
}

#[test]
fn campaign_in_process_equals_processes_byte_for_byte() {
    let campaign =
        CampaignDir::new(&FULL_CAMPAIGN.replace("KEEP", "all").replace("]\n[set]", CHAOS));
    run_to_exit_code(campaign.sweep("processes", &[]), 0);
    let output = run_to_exit_code(campaign.sweep("one", &["--in-process"]), 0);
    assert!(!output.contains("by processes"), "{output}");
    let [processes, one] =
        ["processes", "one"].map(|out| campaign.file(&format!("{out}/runs.csv")));
    assert_eq!(processes, one);
    assert_eq!(one.lines().count(), 10, "{one}");
    assert_stored_files_equal(&campaign);
    let summary =
        |run: &String| determined(&campaign.out_path("one/runs").join(run).join("summary.json"));
    let mut summaries = runs(&campaign, "one").iter().map(summary).collect::<Vec<_>>().into_iter();
    let chaos = summaries.find(|summary| summary["scenario"] == "containment-chaos").unwrap();
    assert!(chaos["faults"].as_array().unwrap().len() > 12, "there was chaos: {chaos:#}");
    let refused = chaos["beacons_refused"].as_object().unwrap().values();
    let refused: u64 = refused.filter_map(Value::as_u64).sum();
    assert!(refused > 0, "beacons overtook each other: {chaos:#}");
    // Measured entries have a value, and entries that need processes have none.
    let timing = campaign.file("one/timing.csv");
    let columns: Vec<&str> = timing.lines().next().unwrap().split(',').collect();
    for line in timing.lines().skip(1) {
        for (column, field) in columns.iter().zip(line.split(',')) {
            assert_eq!(field.is_empty(), *column == "startup_s", "{column} of {line}");
        }
    }
}

/// Checks that the stored files of the runs in the folders `processes` and `one` are equal, except for wall times.
#[track_caller]
fn assert_stored_files_equal(campaign: &CampaignDir) {
    let [processes, one] =
        ["processes", "one"].map(|out| campaign.file(&format!("{out}/runs.csv")));
    assert_eq!(processes, one);
    assert_eq!(runs(campaign, "processes"), runs(campaign, "one"));
    for run in runs(campaign, "one") {
        let of = |out: &str, file: &str| campaign.out_path(out).join("runs").join(&run).join(file);
        for file in ["scenario.toml", "samples.csv", "pairs.csv", "events.csv", "run.mcap"] {
            let [a, b] = ["processes", "one"].map(|out| fs::read(of(out, file)).unwrap());
            assert!(a == b, "{file} of {run} differs");
        }
        let [a, b] = ["processes", "one"].map(|out| determined(&of(out, "summary.json")));
        assert_eq!(a, b, "{run}");
    }
}

#[test]
fn early_end_tick_is_equal_in_processes_and_in_process() {
    let campaign = CampaignDir::new(
        "name = \"early\"\nscenario = \"SCENARIOS/triangle.toml\"\nkeep = \"all\"\n\
         case = [\n\
         { axis = \"case\", name = \"freeze\", faults = [\"freeze r3 @11 for 0.4\"] },\n\
         { axis = \"case\", name = \"radio\", faults = [\"delay * odometry by 0.02 @0\", \
           \"bursts * odometry of 0.2 mean 0.1 @0\"] },\n\
         { axis = \"case\", name = \"goals\", scenario = \"SCENARIOS/antipodal-8.toml\" },\n\
         { axis = \"case\", name = \"opening\", scenario = \"SCENARIOS/lattice-12.toml\" },\n\
         { axis = \"hold\", name = \"2\", set = { end_after_converged_s = 2.0 } },\n\
         { axis = \"hold\", name = \"0.03\", set = { end_after_converged_s = 0.03 } },\n]\n\
         [set]\nduration_s = 300\nperiod_s = 0.02\nexpect = {}\n",
    );
    run_to_exit_code(campaign.sweep("processes", &[]), 0);
    run_to_exit_code(campaign.sweep("one", &["--in-process"]), 0);
    assert_stored_files_equal(&campaign);
    let mut held_s = Vec::new();
    for run in runs(&campaign, "one") {
        let summary = determined(&campaign.out_path("one/runs").join(run).join("summary.json"));
        assert_eq!(summary["ended_early"], true, "{summary}");
        let number = |key: &str| summary[key].as_f64().unwrap();
        let (t_s, converged_at_s) = (number("t_s"), number("converged_at_s"));
        // The last tenth of the run has converged, and the report agrees.
        assert!(converged_at_s <= 0.9 * t_s + 1e-9, "{summary}");
        assert!(number("final_error_m_max") < 0.05, "{summary}");
        assert!(
            summary["scenario"] != "triangle" || t_s >= 11.4 || summary["faults"][0]["t_s"] == 0.0
        );
        held_s.push(t_s - converged_at_s);
    }
    let (short, long): (Vec<f64>, Vec<f64>) = held_s.iter().partition(|&&held_s| held_s < 2.0);
    assert!(!short.is_empty() && !long.is_empty(), "{held_s:?}");
}

#[test]
fn campaign_resumes_in_process_and_with_processes() {
    let campaign = CampaignDir::new(&FULL_CAMPAIGN.replace("KEEP", "summary"));
    run_to_exit_code(campaign.sweep("whole", &["--in-process"]), 0);
    let table = campaign.file("whole/runs.csv");
    for (out, first, second) in
        [("one", vec!["--in-process"], vec![]), ("other", vec![], vec!["--in-process"])]
    {
        run_to_exit_code(campaign.sweep(out, &first), 0);
        for run in runs(&campaign, out).iter().step_by(2) {
            fs::remove_dir_all(campaign.out_path(out).join("runs").join(run)).unwrap();
        }
        let output = run_to_exit_code(campaign.sweep(out, &second), 0);
        assert!(output.contains("4 runs in"), "{output}");
        assert_eq!(campaign.file(&format!("{out}/runs.csv")), table);
    }
}

#[test]
fn in_process_campaign_starts_processes_only_if_required() {
    let campaign = CampaignDir::new(
        "name = \"plant\"\nscenario = \"SCENARIOS/triangle.toml\"\n\
         set = { duration_s = 1.0, expect.converged_by_s = 1.0 }\n\
         vary.fault = [\"none\", \"kill plant @0.5\", \"load of 1 @0.2 for 0.2\"]\n",
    );
    let output = run_to_exit_code(campaign.sweep("one", &["--in-process"]), 0);
    assert!(output.contains("2 of them by processes"), "{output}");
    run_to_exit_code(campaign.sweep("processes", &[]), 0);
    let table = campaign.file("processes/runs.csv");
    assert_eq!(campaign.file("one/runs.csv"), table);
    assert!(table.contains("\nkill plant @0.5,1,missed,4,"), "its end is a result: {table}");
}

#[test]
fn plant_kill_is_refused_in_process() {
    let scenario = with_faults("triangle", &[], &["kill plant @0.5"]);
    let run = InProcessRun::new(scenario, Box::new(create_controller));
    let refusal = run.err().expect("it cannot be foretold").to_string();
    assert!(refusal.contains("a fault kills the plant"), "{refusal}");
}

#[test]
fn in_real_time_a_run_is_its_processes() {
    let campaign = CampaignDir::new(&format!("pace = \"realtime\"\n{NINE_RUN_CAMPAIGN}"));
    let output = run_to_exit_code(campaign.sweep("out", &["--in-process"]), 2);
    assert!(output.contains("remove the option"), "{output}");
    assert!(!campaign.out_path("out").exists());
}

#[test]
fn interrupted_in_process_campaign_leaves_no_partial_run() {
    let campaign = CampaignDir::new(
        &NINE_RUN_CAMPAIGN
            .replace("duration_s = 1.0", "duration_s = 100000.0")
            .replace("_by_s = 1.0", "_by_s = 9.0"),
    );
    let mut child = campaign.sweep("out", &["--in-process"]).spawn().unwrap();
    campaign.wait_for(&mut child, || !runs_if_any(&campaign).is_empty());
    signal_pid(child.id(), Signal::INT);
    let output = child.wait_with_output().unwrap();
    let stderr = String::from_utf8_lossy(&output.stderr);
    assert_eq!(output.status.code(), Some(130), "{stderr}");
    assert!(stderr.contains("0 of 9 runs are done"), "{stderr}");
    assert!(runs_if_any(&campaign).is_empty(), "{:?}", runs_if_any(&campaign));
}

fn runs_if_any(campaign: &CampaignDir) -> Vec<String> {
    if campaign.out_path("out/runs").exists() { runs(campaign, "out") } else { Vec::new() }
}

#[test]
fn run_past_its_deadline_counts_as_machinery_failure() {
    let campaign = CampaignDir::new(&format!(
        "deadline_s = 0.001\n{}",
        NINE_RUN_CAMPAIGN
            .replace("seeds = 9", "seeds = 1")
            .replace("duration_s = 1.0", "duration_s = 10000.0")
    ));
    for (out, args) in [("processes", &[][..]), ("one", &["--in-process"])] {
        let output = run_to_exit_code(campaign.sweep(out, args), 4);
        assert!(output.contains("1 given up"), "{output}");
        assert!(campaign.file(&format!("{out}/runs.csv")).contains(",infrastructure,4,"));
        let left = runs(&campaign, out);
        let is_partial = |name: &String| name.ends_with(".failed") || name.ends_with(".log");
        assert!(left.iter().all(is_partial), "{left:?}");
    }
    campaign.assert_no_process_left();
}
