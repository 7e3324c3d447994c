//! Effects of phalanx on the machine: `doctor`, `clean`, real-time priority, limits that are too low, and state that
//! is inherited from the parent process.

mod inherited;
mod limits;

use std::path::Path;

use rustix::process::Signal;
use serde_json::Value;

use crate::harness::{
    ExitsWith as _, command_with_ulimit, files_below, phalanx, run, wait_until_gone,
};

#[test]
fn doctor_passes_a_working_machine_and_reports_defects() {
    let run_root = tempfile::tempdir_in("/dev/shm").unwrap();
    let doctor = |arguments: &[&str], run_root: &Path, code| {
        phalanx(arguments).env("PHALANX_RUN_ROOT", run_root).exits_with(code)
    };
    let findings = doctor(&["doctor", "--output", "json"], run_root.path(), 0).json();
    let findings = findings.as_array().unwrap();
    assert!(findings.len() >= 11, "{findings:#?}");
    assert!(findings.iter().all(|finding| finding["verdict"] != "wrong"), "{findings:#?}");

    let text = doctor(&["doctor"], &run_root.path().join("gone"), 4).stdout;
    assert!(text.contains("WRONG          run root") && text.contains("gone"), "{text}");
}

#[test]
fn run_raises_the_open_file_limit_or_reports_the_denial() {
    let run_root = tempfile::tempdir_in("/dev/shm").unwrap();
    let run_with = |limit: &str| {
        let out = run_root.path().join(format!("out{limit}"));
        let mut run = command_with_ulimit(limit);
        run.args(["run", "scenarios/triangle.toml"]);
        run.args(["--pace", "lockstep", "--set", "duration_s=1", "--set", "expect={}", "--out"]);
        run.arg(out).env("PHALANX_RUN_ROOT", run_root.path());
        run
    };
    // Three robots need 94 open files.
    run_with("-Sn 64").exits_with(0);
    let error = run_with("-n 64").exits_with(4).stderr;
    assert!(error.contains("3 robots need 94 open files"), "{error}");
    assert!(error.contains("no process may have more than 64"), "{error}");
}

#[test]
fn clean_removes_files_of_a_killed_run_and_keeps_live_runs() {
    let mut killed = run("triangle").set("duration_s=60").start();
    killed.wait_for_event("contact");
    let run_root = killed.run_root().to_path_buf();
    let dead = killed.roots().remove(0);
    let other_run = run("triangle").set("expect={}").set("duration_s=60");
    let mut other_run = other_run.in_run_root_of(&run_root).start();
    other_run.wait_for_event("contact");
    let alive = killed.roots().into_iter().find(|root| *root != dead).unwrap();
    let alive_before = files_below(&alive).len();

    killed.signal(Signal::KILL);
    wait_until_gone(&killed.run_dir());
    let left = files_below(&dead).len();
    assert!(left > 30, "a killed supervisor cannot have cleaned up");

    let clean = |arguments: &[&str]| {
        let text = phalanx(arguments).env("PHALANX_RUN_ROOT", &run_root).exits_with(0).stdout;
        assert!(text.contains(dead.to_str().unwrap()), "{text}");
        text
    };
    let text = clean(&["clean", "--dry-run"]);
    assert!(text.contains("would remove") && !text.contains(alive.to_str().unwrap()), "{text}");
    assert_eq!(files_below(&dead).len(), left, "a dry run removes nothing");
    assert!(clean(&["clean"]).contains("removed"));
    assert!(!dead.exists());
    assert_eq!(files_below(&alive).len(), alive_before);

    // The other run continues and ends normally.
    other_run.signal(Signal::INT);
    other_run.finish().exits_with(130);
    assert_eq!(files_below(&run_root), Vec::<std::path::PathBuf>::new());
}

#[test]
fn realtime_priority_applies_to_robots_and_plant_if_allowed() {
    let mut running =
        run("triangle").set("duration_s=4").set("expect={}").args(["--realtime-priority"]).start();
    running.wait_for_event("contact");
    let children = running.children();
    let states: Vec<(String, u64)> = children.iter().map(|(pid, _)| scheduling(*pid)).collect();
    let (supervisor, _) = scheduling(running.pid());
    let ended = running.finish();
    ended.exits_with(0).assert_leaves_nothing();
    ended.assert_keeps_d();
    ended.assert_holds(
        supervisor == "0 0",
        format!("the supervisor has ordinary priority, not {supervisor}"),
    );
    let manifest: Value = serde_json::from_str(&ended.file("manifest.json")).unwrap();
    let priority = manifest["realtime_priority"].as_str().unwrap_or("nothing");
    let is_granted = priority == "granted";
    ended.assert_holds(
        is_granted || priority.contains("SCHED_FIFO") || priority.contains("sched_rt"),
        priority,
    );
    ended.assert_holds(
        is_granted != ended.stderr.contains("running with ordinary priority"),
        "one warning",
    );
    ended.assert_holds(states.len() == 4, "three robots and a plant were checked");
    for (policy, _) in &states {
        let expected = if is_granted { "10 1" } else { "0 0" };
        ended.assert_holds(policy == expected, format!("all {priority}: {states:?}"));
    }
    if is_granted && protocol::process::may_lock_memory() {
        ended.assert_holds(
            states.iter().all(|(_, locked)| *locked > 1000),
            format!("locked: {states:?}"),
        );
    }
}

#[test]
fn realtime_priority_is_refused_in_lockstep() {
    let ended = run("triangle").lockstep().args(["--realtime-priority"]).finish();
    ended.exits_with(2);
    ended
        .assert_holds(ended.stderr.contains("lockstep has no deadlines"), "the reason is reported");
}

/// Returns the real-time priority and policy from /proc/PID/stat, and the locked memory in KiB.
fn scheduling(pid: u32) -> (String, u64) {
    let stat = std::fs::read_to_string(format!("/proc/{pid}/stat")).unwrap();
    let fields: Vec<&str> = stat.rsplit(')').next().unwrap().split_whitespace().collect();
    let status = std::fs::read_to_string(format!("/proc/{pid}/status")).unwrap();
    let locked = status.lines().find_map(|line| line.strip_prefix("VmLck:"));
    let locked = locked.and_then(|text| text.split_whitespace().next()?.parse().ok());
    (fields[37..39].join(" "), locked.unwrap_or(0))
}
