//! `phalanx verify`: repeats a recorded run and compares it bit by bit.

use std::fs;
use std::path::Path;
use std::process::{Command, Stdio};
use std::time::{Duration, Instant};

use rustix::process::Signal;

use crate::harness::{
    ExitsWith as _, FinishedRun, RunRoot, WAIT_TIMEOUT, phalanx, run, signal_pid, wait_until_gone,
};

/// Verifies a run. Asserts the exit code, and that the output contains all of `expected`.
#[track_caller]
fn verify(run_dir: &Path, code: i32, expected: &[&str]) {
    let root = RunRoot::new();
    let mut command = phalanx([Path::new("verify"), run_dir]);
    let text = command.env("PHALANX_RUN_ROOT", root.path()).exits_with(code).stdout_and_stderr();
    for part in expected {
        assert!(text.contains(part), "{part:?} is not in {text:?}");
    }
}

fn short_run() -> FinishedRun {
    let run = run("triangle").lockstep().set("expect={}").set("duration_s=5");
    let ended = run.fault("kill r2 @1 restart 1").finish();
    ended.exits_with(0);
    ended
}

#[test]
fn lockstep_run_with_faults_verifies_and_leaves_no_files() {
    let ended = short_run();
    let hash = ended.summary["trajectory_hash"].as_str().unwrap().to_owned();
    let expected = ["the same, bit by bit", &hash, "run.mcap            the same"];
    verify(&ended.run_dir(), 0, &expected);
    let other_folders = fs::read_dir(ended.run_dir().parent().unwrap()).unwrap().count();
    assert_eq!(other_folders, 1, "the new run is removed");
}

#[test]
fn changed_run_is_reported_with_second_line_and_column() {
    let ended = short_run();
    let run_dir = ended.run_dir();
    let scenario = run_dir.join("scenario.toml");
    let text = fs::read_to_string(&scenario).unwrap();
    // The runs are equal until that fault acts.
    let changed = text.replace("at_s = 1.0", "at_s = 3.5");
    assert_ne!(text, changed);
    fs::write(&scenario, changed).unwrap();
    let found =
        ["NOT the same", "between 1 s and 2 s of simulated time", "samples.csv         line "];
    verify(&run_dir, 1, &[&found[..], &[", robot r", " was ", ", is "]].concat());
}

#[test]
fn recording_of_another_commit_is_checked_by_checksum() {
    let ended = short_run();
    let run_dir = ended.run_dir();
    Command::new("sha256sum").args(["-c", "checksums.sha256"]).current_dir(&run_dir).exits_with(0);
    let manifest = run_dir.join("manifest.json");
    let mut text: serde_json::Value =
        serde_json::from_slice(&fs::read(&manifest).unwrap()).unwrap();
    text["git_hash"] = "another".into();
    fs::write(manifest, text.to_string()).unwrap();
    let same = "run.mcap            the same";
    verify(&run_dir, 0, &[same]);
    let recording = run_dir.join("run.mcap");
    let mut bytes = fs::read(&recording).unwrap();
    let middle = bytes.len() / 2;
    bytes[middle] ^= 1;
    fs::write(&recording, bytes).unwrap();
    verify(&run_dir, 1, &["NOT the same", "run.mcap            differs from what the run wrote"]);
    // An earlier version wrote no checksum of the recording.
    let sums = run_dir.join("checksums.sha256");
    let listed = fs::read_to_string(&sums).unwrap();
    let older: Vec<&str> = listed.lines().filter(|line| !line.ends_with("run.mcap")).collect();
    assert_eq!(older.len() + 1, listed.lines().count());
    fs::write(sums, older.join("\n") + "\n").unwrap();
    verify(&run_dir, 0, &["the same, bit by bit"]);
}

#[test]
fn tables_with_other_line_ends_differ() {
    let ended = short_run();
    let samples = ended.run_dir().join("samples.csv");
    let text = fs::read_to_string(&samples).unwrap();
    fs::write(samples, text.replace('\n', "\r\n")).unwrap();
    let line_ends = r#"samples.csv         line 1 ended with "\r\n", ends with "\n""#;
    verify(&ended.run_dir(), 1, &["NOT the same", line_ends]);
}

#[test]
fn folder_of_a_killed_verify_is_removed_by_clean() {
    let ended = run("triangle").lockstep().set("expect={}").set("duration_s=600").finish();
    ended.exits_with(0);
    let scratch = ended.run_dir().parent().unwrap().to_owned();
    let other_folders = || {
        let names = fs::read_dir(&scratch).unwrap().map(|entry| entry.unwrap().path());
        names.filter(|path| *path != ended.run_dir()).collect::<Vec<_>>()
    };
    let root = RunRoot::new();
    let mut command = phalanx([Path::new("verify"), &ended.run_dir()]);
    command.env("PHALANX_RUN_ROOT", root.path()).stdout(Stdio::null()).stderr(Stdio::null());
    let mut child = command.spawn().unwrap();
    let start = Instant::now();
    let samples = || other_folders().first().map(|folder| folder.join("run/samples.csv"));
    while !samples().is_some_and(|path| path.exists()) {
        assert!(
            start.elapsed() < WAIT_TIMEOUT && child.try_wait().unwrap().is_none(),
            "nothing to kill"
        );
        std::thread::sleep(Duration::from_millis(1));
    }
    signal_pid(child.id(), Signal::KILL);
    child.wait().unwrap();
    let [folder] = &other_folders()[..] else { panic!("{:?}", other_folders()) };
    wait_until_gone(&folder.join("run"));
    let name = folder.to_str().unwrap();
    // One folder with a similar name, and one that another process uses.
    let other = scratch.join("run-again-1");
    fs::create_dir(&other).unwrap();
    let clean = |more: &[&str]| {
        let mut command = phalanx(["clean"]);
        command.args(more).env("PHALANX_RUN_ROOT", root.path()).exits_with(0).stdout
    };
    let output = clean(&["--dry-run"]);
    assert!(output.contains("would remove") && output.contains(name), "{output}");
    assert!(folder.exists());
    let output = clean(&[]);
    assert!(output.contains("removed") && output.contains(name), "{output}");
    assert_eq!(other_folders(), [other]);
}

#[test]
fn unrepeatable_run_is_refused() {
    let real = run("triangle").set("expect={}").set("duration_s=0.5").finish();
    verify(&real.run_dir(), 2, &["real time", "--pace lockstep"]);

    let ended = short_run();
    let summary = ended.run_dir().join("summary.json");
    let text = fs::read_to_string(&summary).unwrap();
    fs::write(&summary, text.replace("\"acts_by_hand\": 0", "\"acts_by_hand\": 2")).unwrap();
    verify(&ended.run_dir(), 2, &["changed manually", "2 times"]);

    fs::write(&summary, text.replace("\"interrupted\": false", "\"interrupted\": true")).unwrap();
    verify(&ended.run_dir(), 2, &["interrupted"]);

    fs::remove_file(&summary).unwrap();
    verify(&ended.run_dir(), 4, &["not a complete run", "summary.json"]);
    verify(Path::new("/nowhere"), 2, &["/nowhere"]);
}
