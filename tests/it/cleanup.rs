//! No process and no shared memory is left after a run, a Ctrl-C, or a sudden death of the supervisor.

use std::path::Path;
use std::process::{Command, Stdio};

use rustix::process::Signal;

use crate::harness::{
    ExitsWith as _, PHALANX, Phalanx, ROOT, files_below, limited_by, phalanx, run, signal_pid,
    wait_until_gone,
};

#[test]
fn interrupt_ends_the_run_with_130_and_keeps_measurements() {
    for signal in [Signal::INT, Signal::TERM] {
        let mut running = run("triangle").start();
        running.wait_for_event("contact");
        running.signal(signal);
        let ended = running.finish();
        ended.exits_with(130).assert_leaves_nothing();
        ended.assert_holds(ended.summary["interrupted"] == true, "the summary says so");
        ended.assert_holds(ended.number("/min_distance_m") >= 0.2, "and has what was measured");
        ended.assert_holds(ended.file("samples.csv").lines().count() > 3, "samples are kept");
    }
}

#[test]
fn second_interrupt_ends_run_and_children_at_once() {
    let mut running = run("triangle").start();
    running.wait_for_event("contact");
    // Children that do not react make the supervisor wait, and the user press Ctrl-C again.
    for (pid, _) in running.children() {
        signal_pid(pid, Signal::STOP);
    }
    running.signal(Signal::INT);
    std::thread::sleep(std::time::Duration::from_millis(100));
    running.signal(Signal::INT);
    let directory = running.run_dir();
    let ended = running.finish();
    ended.exits_with(130);
    wait_until_gone(&directory);
}

#[test]
fn next_run_removes_resources_of_a_killed_supervisor() {
    let mut running = run("triangle").start();
    running.wait_for_event("contact");
    let run_root = running.run_root().to_path_buf();
    running.signal(Signal::KILL);
    wait_until_gone(&running.run_dir());
    let left = files_below(&run_root);
    assert!(!left.is_empty(), "a killed supervisor cannot have cleaned up");
    let memory = left.iter().filter(|path| path.extension().is_some_and(|end| end == "connection"));
    assert!(memory.count() > 5, "its memory is there too: {left:?}");

    let next = run("triangle").lockstep().in_run_root_of(&run_root).finish();
    next.exits_with(0);
    assert_eq!(files_below(&run_root), Vec::<std::path::PathBuf>::new());
}

#[test]
fn unusable_out_directory_is_refused_without_a_kept_message() {
    let scratch = tempfile::tempdir().unwrap();
    std::fs::write(scratch.path().join("precious"), "data").unwrap();
    for (out, code, expected) in [
        (scratch.path(), 2, "exists already"),
        (Path::new("/proc/run"), 4, "error: cannot make /proc/run: "),
        (Path::new("/proc/runs/new"), 4, "error: cannot make /proc/runs: "),
    ] {
        let mut run = phalanx(["run", "scenarios/triangle.toml", "--pace", "lockstep", "--out"]);
        let stderr = run.arg(out).exits_with(code).stderr;
        assert!(stderr.contains(expected) && !stderr.contains("kept"), "{stderr}");
    }
    assert_eq!(files_below(scratch.path()).len(), 1);
}

#[test]
fn runs_that_begin_in_the_same_second_get_a_directory_each() {
    let folder = tempfile::tempdir().unwrap();
    let scenario = format!("{ROOT}/scenarios/triangle.toml");
    let words = "--pace lockstep --no-report --set duration_s=0.1 --set expect={}".split(' ');
    let runs = [(); 6].map(|()| {
        let mut run = phalanx(["run", &scenario]);
        run.args(words.clone()).current_dir(folder.path());
        run.env("PHALANX_RUN_ROOT", folder.path()).stdout(Stdio::null()).stderr(Stdio::null());
        run.spawn().unwrap()
    });
    for mut run in runs {
        assert!(run.wait().unwrap().success());
    }
    let directories = std::fs::read_dir(folder.path().join("runs")).unwrap().count();
    assert_eq!(directories, 6);
}

#[test]
fn full_disk_exits_4_and_keeps_written_files() {
    // A file size limit simulates a full disk: writing fails, the run continues.
    let mut limited = limited_by("ulimit -f 8192");
    limited.args(["run", "scenarios/triangle.toml"]);
    let ended =
        Phalanx::new(limited).lockstep().set("period_s=0.0005").set("record_hz=2000").finish();
    ended.exits_with(4).assert_leaves_nothing();
    let named = ["samples.csv", "run.mcap"].iter().any(|file| ended.stderr.contains(file));
    ended.assert_holds(named, "the error names the file");
    ended.assert_holds(ended.stderr.contains("kept"), "and says that the rest is kept");
    ended.assert_holds(ended.file("samples.csv").len() > 1_000_000, "samples are kept");
    let tables = ended.run_dir().join("tables");
    let mut export = phalanx(["export", "--allow-damage", "--out"]);
    export.arg(&tables).arg(ended.run_dir()).exits_with(0);
    let poses = std::fs::read_to_string(tables.join("poses.csv")).unwrap();
    ended.assert_holds(poses.len() > 1_000_000, "as far as it was kept");
    ended.assert_holds(ended.number("/t_s") > 0.0, "and there is a summary");
}

#[test]
fn file_size_limit_below_shared_memory_size_is_reported() {
    let mut limited = limited_by("ulimit -f 200");
    limited.args(["run", "scenarios/triangle.toml"]);
    let ended = Phalanx::new(limited).lockstep().finish();
    ended.exits_with(4).assert_leaves_nothing();
    ended.assert_holds(ended.stderr.contains("`ulimit -f`"), "it says what to look at");
}

#[test]
fn summary_and_verdict_survive_a_full_disk() {
    let parent = tempfile::Builder::new().prefix("phx").tempdir_in("/dev/shm").unwrap();
    let [disk, copy] = ["disk", "kept"].map(|name| parent.path().join(name));
    std::fs::create_dir(&disk).unwrap();
    // A disk in a mount namespace of the run, which is removed with it: its files are copied before.
    let script = "mount -t tmpfs -o size=1500k tmpfs \"$1\" || exit 77
        disk=$1 kept=$2; shift 2; \"$@\" --out \"$disk/run\"; code=$?
        cp -r \"$disk/run\" \"$kept\"; exit $code";
    let mut unshare = Command::new("unshare");
    unshare.args(["--map-root-user", "--mount", "sh", "-c", script, "sh"]).args([&disk, &copy]);
    unshare.args([PHALANX, "run", "scenarios/triangle.toml"]);
    unshare.args("--pace lockstep --set period_s=0.0005 --set record_hz=2000".split(' '));
    unshare.current_dir(ROOT).env("PHALANX_RUN_ROOT", parent.path());
    let output = unshare.output().unwrap();
    let [out, error] = [&output.stdout, &output.stderr].map(|text| String::from_utf8_lossy(text));
    if !copy.exists() {
        assert!(error.contains("unshare") || error.contains("mount"), "{error}");
        eprintln!("skipped: no disk can be mounted here: {error}");
        return;
    }
    assert_eq!(output.status.code(), Some(4), "{out}{error}");
    let named = ["samples.csv", "run.mcap"].iter().any(|file| error.contains(file));
    assert!(named && error.contains("No space left"), "{error}");
    let summary = std::fs::read(copy.join("summary.json")).unwrap();
    let summary: serde_json::Value = serde_json::from_slice(&summary).unwrap();
    assert_eq!(summary["exit"], 4);
    assert!(summary["min_distance_m"].as_f64().unwrap() > 0.2, "{summary}");
    assert!(out.contains("triangle, lockstep: ended early"), "{out}");
    assert!(out.contains("smallest distance") && out.contains("not all of it is written"), "{out}");
    let rest = ["pairs.csv", "latency.csv", "latency_over_time.csv", "latency.hlog"];
    let is_empty = |name: &&str| std::fs::metadata(copy.join(name)).unwrap().len() == 0;
    let empty: Vec<&str> = rest.into_iter().filter(is_empty).collect();
    assert!(!empty.is_empty(), "the disk has room");
    // The recording fills the disk; all samples may fit into the remaining space.
    let samples = std::fs::read_to_string(copy.join("samples.csv")).unwrap();
    let newest = samples.lines().last().and_then(|line| line.split(',').next()?.parse().ok());
    let cut: &[&str] = if newest == summary["t_s"].as_f64() { &[] } else { &["samples.csv"] };
    for name in [&empty[..], cut, &["run.mcap"]].concat() {
        let named = format!("cannot write {}: No space", disk.join("run").join(name).display());
        assert!(error.contains(&named), "{name} is not named: {error}");
    }
    let parts =
        files_below(&copy).into_iter().filter(|path| path.extension() == Some("part".as_ref()));
    assert_eq!(parts.count(), 0);
}
