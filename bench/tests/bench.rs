//! `phalanx bench` measures every part, checks that the run and its baseline have one trajectory, and leaves no process
//! or file behind, also when it is interrupted. The tests do not judge the measured values.

use std::path::{Path, PathBuf};
use std::process::{Command, Output, Stdio};
use std::time::{Duration, Instant};

use protocol::process::check_realtime_priority;
use rustix::process::{Pid, Signal, kill_process};
use serde_json::Value;
use tempfile::TempDir;

const BENCH: &str = env!("CARGO_BIN_EXE_phalanx-bench");

/// Maximum duration of a bench. A longer one counts as hung and is killed.
const DURATION_MAX: Duration = Duration::from_secs(60);

struct BenchProcess {
    run_root: TempDir,
    command: Command,
}

/// Returns a quick bench with these additional arguments. A shell runs the commands `before` and then starts it.
fn bench_process(before: &str, args: &[&str]) -> BenchProcess {
    let run_root = tempfile::Builder::new().prefix("phx").tempdir_in("/dev/shm").unwrap();
    let mut command = Command::new("sh");
    command
        .args(["-c", &format!("{before} exec \"$0\" \"$@\""), BENCH])
        .args(["--quick", "--rounds", "1", "--output", "json"])
        .args(args)
        .env("PHALANX_RUN_ROOT", run_root.path())
        .stdin(Stdio::null())
        .stdout(Stdio::piped())
        .stderr(Stdio::piped());
    BenchProcess { run_root, command }
}

impl BenchProcess {
    /// Runs the bench and returns its report. Panics unless it succeeds.
    fn run_to_report(self) -> Value {
        let output = self.finish(|_| false);
        assert_eq!(output.status.code(), Some(0), "{output:?}");
        serde_json::from_slice(&output.stdout).expect("JSON")
    }

    /// Runs the bench and returns its stderr. Panics unless it exits with this code.
    fn run_to_stderr(self, code: i32) -> String {
        let output = self.finish(|_| false);
        assert_eq!(output.status.code(), Some(code), "{output:?}");
        String::from_utf8(output.stderr).unwrap()
    }

    /// Runs the bench, interrupts it once `until` returns `true` for its run root, and returns its output. Panics if it
    /// hangs or leaves files or processes behind.
    fn finish(mut self, until: impl Fn(&Path) -> bool) -> Output {
        let mut child = self.command.spawn().unwrap();
        let (start, mut interrupted) = (Instant::now(), false);
        while child.try_wait().unwrap().is_none() {
            if start.elapsed() > DURATION_MAX {
                let _ = child.kill();
                let _ = child.wait();
                panic!("{:?} hangs", self.command);
            }
            if !interrupted && until(self.run_root.path()) {
                interrupted = true;
                let pid = Pid::from_raw(child.id() as i32).expect("a process id");
                // Fails if the bench has already exited, which is fine.
                let _ = kill_process(pid, Signal::INT);
            }
            std::thread::sleep(Duration::from_millis(2));
        }
        let output = child.wait_with_output().unwrap();
        let remaining =
            (files_below(self.run_root.path()), command_lines_with_path(self.run_root.path()));
        assert_eq!(
            remaining,
            (vec![], vec![]),
            "{:?} left files or processes behind\n{output:?}",
            self.command
        );
        output
    }
}

/// Returns the paths of all files and directories below a directory.
fn files_below(directory: &Path) -> Vec<PathBuf> {
    let mut found = Vec::new();
    for entry in std::fs::read_dir(directory).into_iter().flatten().flatten() {
        found.push(entry.path());
        found.extend(files_below(&entry.path()));
    }
    found
}

/// Returns the command lines of running processes that contain the path of a directory.
fn command_lines_with_path(directory: &Path) -> Vec<String> {
    let entries = std::fs::read_dir("/proc").unwrap().flatten();
    let lines = entries.filter_map(|entry| std::fs::read(entry.path().join("cmdline")).ok());
    let lines = lines.map(|line| String::from_utf8_lossy(&line).replace('\0', " "));
    let name = directory.display().to_string();
    lines.filter(|line| line.contains(&name)).collect()
}

#[test]
fn every_part_has_rows_and_trajectories_are_identical() {
    let report =
        bench_process("", &["--robots", "3", "--seconds", "0.02", "--kills", "2"]).run_to_report();
    let [trajectory] = &report["trajectories"].as_array().unwrap()[..] else {
        panic!("the report must have one trajectory: {report:#}");
    };
    let hashes = trajectory["hashes"].as_array().unwrap();
    let sources: Vec<&str> = hashes.iter().map(|hash| hash[0].as_str().unwrap()).collect();
    assert_eq!(sources, ["phalanx run", "mapping + futex"]);
    assert_eq!(hashes[1][1], hashes[0][1], "{hashes:?}");
    assert_eq!(hashes[0][1].as_str().unwrap().len(), 16);

    let rows = report["rows"].as_array().unwrap();
    let count = |part: &str| rows.iter().filter(|row| row["part"] == part).count();
    // The part realtime has two rates, each with deadline misses, expired commands and three latency quantiles.
    let parts = ["floors", "lockstep", "realtime", "neighbor", "startup", "replacement"];
    assert_eq!(parts.map(count), [10, 2, 10, 12, 1, 4], "{report:#}");
    for row in rows {
        let figure = |key: &str| row[key]["median"].as_f64();
        assert!(figure("ours").is_some_and(|ours| ours >= 0.0), "{row:#}");
        // A baseline of 0 has no ratio, for example if no deadline was missed.
        if let Some(floor) = figure("floor").filter(|floor| *floor > 0.0) {
            let (ours, ratio) = (figure("ours").unwrap(), figure("ratio").unwrap());
            // A value of 0 has the ratio 0.
            assert!((ratio * floor - ours).abs() <= 1e-9 * ours, "{row:#}");
        }
    }
}

#[test]
fn real_time_priority_is_in_each_row_or_fails_with_a_reason() {
    let args = ["--only", "realtime", "--robots", "2", "--seconds", "0.05", "--realtime-priority"];
    if let Err(error) = check_realtime_priority() {
        let stderr = bench_process("", &args).run_to_stderr(4);
        assert!(stderr.contains(&format!("error: --realtime-priority: {error}")), "{stderr}");
        return;
    }
    let report = bench_process("", &args).run_to_report();
    let rows = report["rows"].as_array().unwrap();
    assert_eq!(rows.len(), 10, "{report:#}");
    for row in rows {
        assert!(row["what"].as_str().unwrap().contains("Hz with real-time priority, "), "{row:#}");
    }
}

#[test]
fn growth_reports_time_per_tick_and_exponent() {
    let report = bench_process("", &["--only", "growth", "--robots", "5,2", "--seconds", "0.05"])
        .run_to_report();
    let rows = report["rows"].as_array().unwrap();
    assert_eq!(rows.len(), 2 * 7 + 1, "{report:#}");
    let baselines: Vec<&str> = rows.iter().filter_map(|row| row["floor_name"].as_str()).collect();
    let baselines_of_a_case = ["mapping + futex", "woken without work"];
    assert_eq!(baselines, [baselines_of_a_case; 2].concat());
    let median = |what: &str| {
        let row = rows.iter().find(|row| row["what"] == what);
        row.unwrap_or_else(|| panic!("no {what}: {report:#}"))["ours"]["median"].as_f64().unwrap()
    };
    let all_us = [2, 5].map(|robots| {
        assert!(median(&format!("{robots} robots, ticks/s")) > 0.0);
        assert!(median(&format!("{robots} robots, ready, s")) > 0.0);
        let all_us = median(&format!("{robots} robots, processor time per robot and tick, us"));
        let parts = ["robots", "plant", "supervisor"];
        let parts_us = parts.map(|part| {
            median(&format!("{robots} robots, processor time of {part} per robot and tick, us"))
        });
        assert!((parts_us.iter().sum::<f64>() / all_us - 1.0).abs() < 1e-9, "{report:#}");
        all_us
    });
    let exponent = median("5 robots, exponent of the time per tick, from 2");
    let growth = 5.0 * all_us[1] / (2.0 * all_us[0]);
    assert!(
        (formation::portable_math::pow(2.5, exponent) / growth - 1.0).abs() < 1e-9,
        "{report:#}"
    );
    assert!(
        report["notes"][0].as_str().unwrap().contains("grow with the number of robots of the ring")
    );
}

#[test]
fn messages_are_compared_with_none_on_one_trajectory() {
    let report = bench_process("", &["--only", "messages", "--robots", "3", "--seconds", "0.05"])
        .run_to_report();
    let rows = report["rows"].as_array().unwrap();
    assert_eq!(rows.len(), 2, "{report:#}");
    assert!(rows.iter().all(|row| row["floor_name"] == "no messages"), "{report:#}");
    let hashes = report["trajectories"][0]["hashes"].as_array().unwrap();
    let sources: Vec<&str> = hashes.iter().map(|hash| hash[0].as_str().unwrap()).collect();
    assert_eq!(sources, ["256 bytes per beacon", "no messages"]);
}

#[test]
fn failed_run_has_its_error_in_the_bench_error() {
    let args = ["--only", "growth", "--robots", "64"];
    let stderr = bench_process("ulimit -n 300;", &args).run_to_stderr(4);
    let expected = "a run failed (exit code 4): 64 robots need 1192 open files";
    assert!(stderr.contains(expected), "{stderr}");
}

#[test]
fn interrupted_bench_leaves_no_process_or_file() {
    // A duration of 50 s keeps the measurement running. Peers of a baseline start only after the measurement of the
    // run, which must therefore be short.
    for (part, seconds, awaited_file) in [
        ("baselines", "50", "agent.log"),
        ("baselines", "0.2", "ready-0"),
        ("lockstep", "50", "samples.csv"),
        ("lockstep", "0.2", "ready-0"),
        ("realtime", "0.2", "ready-0"),
        ("neighbor", "0.2", "ready-0"),
        ("replacement", "50", "peer-0.log"),
    ] {
        let args = ["--only", part, "--robots", "3", "--seconds", seconds, "--kills", "10000"];
        let has_awaited_file =
            |root: &Path| files_below(root).iter().any(|file| file.ends_with(awaited_file));
        let output = bench_process("", &args).finish(has_awaited_file);
        assert_eq!(output.status.code(), Some(130), "{part}: {output:?}");
        assert!(output.stdout.is_empty(), "{part}: {output:?}");
    }
}
