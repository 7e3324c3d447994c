//! `phalanx hunt`: its findings are reproducible, also with processes; a killed hunt has the same result when resumed;
//! invalid requests are reported in one line.

use std::fs;
use std::path::Path;
use std::process::{Command, Stdio};
use std::time::Duration;

use rustix::process::Signal;
use serde_json::Value;
use tempfile::TempDir;

use crate::harness::{ExitsWith as _, PHALANX, WAIT_TIMEOUT, phalanx, run_file, signal_pid};

/// Eight robots that cross without avoidance for a short time: some variations come closer than d.
const CROSSING: [&str; 9] = [
    "hunt",
    "scenarios/antipodal-8.toml",
    "--set",
    "avoidance.kind=none",
    "--set",
    "duration_s=4",
    "--set",
    "expect={}",
    "--out",
];

fn hunt(arguments: &[&str], out: &Path, options: &[&str]) -> Command {
    let mut command = phalanx(arguments);
    command.arg(out).args(options);
    command
}

fn report(out: &Path) -> Value {
    serde_json::from_str(&fs::read_to_string(out.join("hunt.json")).unwrap()).unwrap()
}

/// Returns all files that a hunt writes, except for its lock.
fn read_written_files(out: &Path) -> Vec<(String, String)> {
    let names = ["journal.csv", "hunt.json", "nearest.toml", "scenario.toml"];
    let read_text = |name: &str| fs::read_to_string(out.join(name)).unwrap_or_default();
    // The paths of the folders differ.
    names.map(|name| (name.to_owned(), read_text(name))).into()
}

#[test]
fn shrunk_miss_has_equal_trajectories_in_processes() {
    let scratch = TempDir::new().unwrap();
    let out = scratch.path().join("out");
    let output = hunt(&CROSSING, &out, &["--runs", "300"]).exits_with(1).stdout;
    let result = report(&out);
    assert_eq!(
        (&result["found"], &result["expectation"]),
        (&true.into(), &"min_distance_m".into())
    );
    assert!(result["margin_of_file"].as_f64().unwrap() < 0.0, "{result:#}");
    // The shrunk run changes the start of one or two robots, and has no fault.
    assert_eq!(result["faults"], 0, "{result:#}");
    assert!(result["starts"].as_u64().unwrap() <= 2, "{result:#}");
    assert!(output.contains(result["what"].as_str().unwrap()), "{output}");
    let file = out.join(result["file"].as_str().unwrap());
    let page = fs::read_to_string(file.with_extension("").join("report.html")).unwrap();
    let head = page.split("</h1>").nth(1).unwrap();
    assert!(head.starts_with(&format!("\n<p>{}.</p>", result["what"].as_str().unwrap())), "{head}");
    let ended = run_file(&file).lockstep().finish();
    ended.exits_with(1);
    assert_eq!(ended.hash(), result["trajectory_hash"].as_str().unwrap());
    let expectation = &ended.summary["expectations"][0];
    assert_eq!(
        (&expectation["name"], &expectation["held"]),
        (&"min_distance_m".into(), &false.into())
    );
}

/// Hunt with faults, delays and noise of every kind, and several expectations.
#[test]
fn nearest_run_of_all_variations_is_equal_in_processes() {
    let scratch = TempDir::new().unwrap();
    let out = scratch.path().join("out");
    let arguments =
        ["hunt", "scenarios/triangle.toml", "--set", "duration_s=6", "--set", "expect={}", "--out"];
    let sets = [
        "--set",
        "expect.final_error_m_max=100",
        "--set",
        "expect.alive_at_end=1",
        "--set",
        "hunt.faults_max=8",
        "--vary",
        "starts,faults,delays,noise,gains",
        "--runs",
        "64",
        "--expect",
        "final_error_m_max,alive_at_end,min_distance_m",
    ];
    hunt(&arguments, &out, &sets).exits_with(0);
    let result = report(&out);
    assert_eq!((&result["found"], &result["runs"]), (&false.into(), &64.into()));
    let ended = run_file(&out.join("nearest.toml")).lockstep().finish();
    ended.exits_with(0);
    assert_eq!(ended.hash(), result["trajectory_hash"].as_str().unwrap());
    let journal = fs::read_to_string(out.join("journal.csv")).unwrap();
    assert_eq!(
        journal.lines().nth(1),
        Some("by,final_error_m_max,alive_at_end,min_distance_m,traits,checksum")
    );
    assert_eq!(journal.lines().count(), 66);
}

#[test]
fn killed_hunt_on_any_core_count_gives_equal_results() {
    let scratch = TempDir::new().unwrap();
    let [complete, killed] = ["whole", "killed"].map(|name| scratch.path().join(name));
    let arguments =
        ["hunt", "scenarios/triangle.toml", "--set", "duration_s=2", "--set", "expect={}", "--out"];
    let options = ["--runs", "200", "--jobs", "1"];
    hunt(&arguments, &complete, &options).exits_with(0);
    let mut first = hunt(&arguments, &killed, &["--runs", "200", "--jobs", "2"]);
    let mut first = first.stdout(Stdio::null()).stderr(Stdio::null()).spawn().unwrap();
    let journal = killed.join("journal.csv");
    let lines = || fs::read_to_string(&journal).map_or(0, |text| text.lines().count());
    while lines() < 60 && first.try_wait().unwrap().is_none() {
        std::thread::sleep(Duration::from_millis(1));
    }
    signal_pid(first.id(), Signal::KILL);
    first.wait().unwrap();
    // A truncated line.
    let text = fs::read_to_string(&journal).unwrap();
    fs::write(&journal, &text[..text.len() - 5]).unwrap();
    hunt(&arguments, &killed, &["--runs", "200", "--jobs", "3"]).exits_with(0);
    assert_eq!(read_written_files(&complete), read_written_files(&killed));
    // A larger number of runs resumes the hunt, and another hunt does not.
    hunt(&arguments, &killed, &["--runs", "210"]).exits_with(0);
    let extended = fs::read_to_string(&journal).unwrap();
    assert!(extended.starts_with(&fs::read_to_string(complete.join("journal.csv")).unwrap()));
    assert_eq!(extended.lines().count(), 212);
    let output = hunt(&arguments, &killed, &["--seed", "9"]).exits_with(2).stderr;
    assert!(output.contains("another hunt") && output.lines().count() == 1, "{output}");
}

#[test]
fn altered_journal_is_computed_again_with_a_warning() {
    let scratch = TempDir::new().unwrap();
    let out = scratch.path().join("out");
    let arguments =
        ["hunt", "scenarios/triangle.toml", "--set", "duration_s=2", "--set", "expect={}", "--out"];
    let options = ["--runs", "40"];
    let output = hunt(&arguments, &out, &options).exits_with(0).stderr;
    assert!(!output.contains("checksum"), "{output}");
    let before = read_written_files(&out);
    let path = out.join("journal.csv");
    let journal = fs::read_to_string(&path).unwrap();
    let lines: Vec<&str> = journal.split_inclusive('\n').collect();
    // The line of the nearest run becomes a miss, is deleted, is duplicated, or moves.
    let margin_of = |line: &str| line.split(',').nth(1).and_then(|margin| margin.parse().ok());
    let margins: Vec<f64> = lines.iter().skip(2).filter_map(|line| margin_of(line)).collect();
    let lowest_margin = margins.iter().copied().fold(f64::INFINITY, f64::min);
    let lowest_line = 2 + margins.iter().position(|margin| *margin == lowest_margin).unwrap();
    let missed = lines[lowest_line].replacen(',', ",-", 1);
    let (head, rest) = (lines[..lowest_line].concat(), lines[lowest_line + 1..].concat());
    for altered in [
        format!("{head}{missed}{rest}"),
        format!("{head}{rest}"),
        format!("{head}{0}{0}{rest}", lines[lowest_line]),
        format!(
            "{}{}{}{rest}",
            lines[..lowest_line - 1].concat(),
            lines[lowest_line],
            lines[lowest_line - 1]
        ),
    ] {
        fs::write(&path, &altered).unwrap();
        let output = hunt(&arguments, &out, &options).exits_with(0).stderr;
        assert!(output.contains("does not match its checksum"), "{output}");
        assert_eq!(read_written_files(&out), before);
        assert_eq!(fs::read_to_string(out.join("journal.csv.damaged")).unwrap(), altered);
    }
}

#[test]
fn links_and_pipes_in_the_folder_of_a_hunt_are_refused() {
    let scratch = TempDir::new().unwrap();
    let precious = scratch.path().join("precious");
    fs::write(&precious, "precious\n").unwrap();
    for name in [".lock", "journal.csv"] {
        for (target, why) in [
            (Some(&*precious), "a symbolic link"),
            (Some(Path::new("/dev/zero")), "a symbolic link"),
            (None, "no regular file"),
        ] {
            let out = scratch.path().join("out");
            fs::create_dir(&out).unwrap();
            match target {
                Some(target) => std::os::unix::fs::symlink(target, out.join(name)).unwrap(),
                None => {
                    Command::new("mkfifo").arg(out.join(name)).exits_with(0);
                }
            }
            // Without a bound, the program reads until memory is full, or waits for a writer.
            let mut command = Command::new("timeout");
            command.args(["--signal", "KILL", &WAIT_TIMEOUT.as_secs().to_string(), "sh", "-c"]);
            command.args(["ulimit -v 4000000 && exec \"$0\" \"$@\"", PHALANX]);
            command.args(CROSSING).arg(&out).args(["--runs", "1"]).stdin(Stdio::null());
            let output = command.exits_with(4).stderr;
            assert!(output.contains(name) && output.contains(why), "{name}: {output}");
            assert_eq!(fs::read_to_string(&precious).unwrap(), "precious\n");
            fs::remove_dir_all(&out).unwrap();
        }
    }
}

#[test]
fn emitted_commands_are_hunts_of_their_own() {
    let scratch = TempDir::new().unwrap();
    let out = scratch.path().join("out");
    let options = ["--seed", "5", "--runs", "3", "--emit-commands", "2"];
    let lines = hunt(&CROSSING, &out, &options).exits_with(0).stdout;
    assert!(!out.exists());
    assert_eq!(lines.lines().count(), 2, "{lines}");
    for (line, seed) in lines.lines().zip([5, 6]) {
        let mut shell = Command::new("sh");
        let code =
            shell.args(["-c", line]).stdout(Stdio::null()).stderr(Stdio::null()).status().unwrap();
        assert!(matches!(code.code(), Some(0 | 1)), "{line}: {code}");
        assert_eq!(report(&out.join(format!("seed-{seed}")))["seed"], seed);
    }
}

#[test]
fn invalid_hunt_request_is_reported_in_one_line() {
    let scratch = TempDir::new().unwrap();
    let out = scratch.path().join("out");
    let goals = "scenarios/antipodal-8.toml";
    let cases: [(&[&str], &str); 7] = [
        (&["scenarios/triangle.toml", "--expect", "exit"], "has no margin"),
        (&["scenarios/triangle.toml", "--expect", "converged_by"], "did you mean converged_by_s?"),
        (&["scenarios/triangle.toml", "--expect", "hull_distance_m_max"], "has no bound for it"),
        (&["scenarios/triangle.toml", "--vary", "start"], "must be one of starts, faults"),
        (&["scenarios/triangle.toml", "--minutes", "0"], "a number of minutes above 0"),
        (&[goals, "--vary", "faults", "--set", "hunt.kinds=[\"cut\"]"], "nothing would vary"),
        (&["scenarios/triangle.toml", "--runs", "0"], "0 is not in"),
    ];
    for (arguments, expected) in cases {
        let arguments = [&["hunt"], arguments, &["--out"]].concat();
        let output = hunt(&arguments, &out, &[]).exits_with(2).stderr;
        assert!(
            output.starts_with("error: ") && output.contains(expected),
            "{arguments:?}: {output}"
        );
        assert_eq!(output.matches("error: ").count(), 1, "{output}");
        assert!(!out.exists());
    }
}
