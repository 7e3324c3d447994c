//! Tests that `phalanx bench` measures every part, gives one trajectory by all implementations, and leaves
//! nothing behind, even when interrupted. Its timings are not checked.

use std::path::{Path, PathBuf};
use std::process::{Command, Output, Stdio};
use std::time::{Duration, Instant};

use protocol::process::try_realtime_priority;
use rustix::process::{Pid, Signal, kill_process};
use serde_json::Value;
use tempfile::TempDir;

const BENCH: &str = env!("CARGO_BIN_EXE_phalanx-bench");

/// Deadline that only a hang exceeds.
const HANG: Duration = Duration::from_secs(60);

struct Bench {
    run_root: TempDir,
    command: Command,
}

/// Returns a bench with these arguments, started by a shell after the command `before`, if any.
fn bench(before: &str, args: &[&str]) -> Bench {
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
    Bench { run_root, command }
}

impl Bench {
    /// Runs it to its end, requires success, and returns its rows.
    fn report(self) -> Value {
        let output = self.finish(|_| false);
        assert_eq!(output.status.code(), Some(0), "{output:?}");
        serde_json::from_slice(&output.stdout).expect("JSON")
    }

    /// Runs it to its end, requires this exit code, and returns its error message.
    fn complaint(self, code: i32) -> String {
        let output = self.finish(|_| false);
        assert_eq!(output.status.code(), Some(code), "{output:?}");
        String::from_utf8(output.stderr).unwrap()
    }

    /// Runs it to its end. Interrupts it once `until` holds for its run root.
    fn finish(mut self, until: impl Fn(&Path) -> bool) -> Output {
        let mut child = self.command.spawn().unwrap();
        let (began, mut interrupted) = (Instant::now(), false);
        while child.try_wait().unwrap().is_none() {
            if began.elapsed() > HANG {
                let _ = child.kill();
                let _ = child.wait();
                panic!("{:?} hangs", self.command);
            }
            if !interrupted && until(self.run_root.path()) {
                interrupted = true;
                let pid = Pid::from_raw(child.id() as i32).expect("a process id");
                // It may have exited already.
                let _ = kill_process(pid, Signal::INT);
            }
            std::thread::sleep(Duration::from_millis(2));
        }
        let output = child.wait_with_output().unwrap();
        let left = (files_below(self.run_root.path()), processes_in(self.run_root.path()));
        assert_eq!(left, (vec![], vec![]), "{:?} leaves these\n{output:?}", self.command);
        output
    }
}

/// Returns everything below a directory.
fn files_below(directory: &Path) -> Vec<PathBuf> {
    let mut found = Vec::new();
    for entry in std::fs::read_dir(directory).into_iter().flatten().flatten() {
        found.push(entry.path());
        found.extend(files_below(&entry.path()));
    }
    found
}

/// Returns the command lines of living processes that name a path below a directory.
fn processes_in(directory: &Path) -> Vec<String> {
    let entries = std::fs::read_dir("/proc").unwrap().flatten();
    let lines = entries.filter_map(|entry| std::fs::read(entry.path().join("cmdline")).ok());
    let lines = lines.map(|line| String::from_utf8_lossy(&line).replace('\0', " "));
    let name = directory.display().to_string();
    lines.filter(|line| line.contains(&name)).collect()
}

#[test]
fn every_part_gives_figures_and_all_means_move_the_robots_along_one_trajectory() {
    let report = bench("", &["--robots", "3", "--seconds", "0.02", "--kills", "2"]).report();
    let [trajectory] = &report["trajectories"].as_array().unwrap()[..] else {
        panic!("one number of robots, one trajectory: {report:#}");
    };
    let hashes = trajectory["hashes"].as_array().unwrap();
    let means: Vec<&str> = hashes.iter().map(|hash| hash[0].as_str().unwrap()).collect();
    assert_eq!(means, ["phalanx run", "mapping + futex"]);
    assert_eq!(hashes[1][1], hashes[0][1], "{hashes:?}");
    assert_eq!(hashes[0][1].as_str().unwrap().len(), 16);

    let rows = report["rows"].as_array().unwrap();
    let count = |part: &str| rows.iter().filter(|row| row["part"] == part).count();
    // In real time: two rates, each with misses, expired commands, and three quantiles of wake-up latency.
    let parts = ["floors", "lockstep", "realtime", "neighbor", "startup", "replacement"];
    assert_eq!(parts.map(count), [10, 2, 10, 12, 1, 4], "{report:#}");
    for row in rows {
        let figure = |key: &str| row[key]["median"].as_f64();
        assert!(figure("ours").is_some_and(|ours| ours >= 0.0), "{row:#}");
        // There is no ratio to 0, and there may be no deadline misses.
        if let Some(floor) = figure("floor").filter(|floor| *floor > 0.0) {
            let (ours, ratio) = (figure("ours").unwrap(), figure("ratio").unwrap());
            // Where ours is 0, so is the ratio.
            assert!((ratio * floor - ours).abs() <= 1e-9 * ours, "{row:#}");
        }
    }
}

#[test]
fn a_bench_with_real_time_priority_says_so_in_each_row_or_why_it_cannot() {
    let args = ["--only", "realtime", "--robots", "2", "--seconds", "0.05", "--realtime-priority"];
    if let Err(error) = try_realtime_priority() {
        let complaint = bench("", &args).complaint(4);
        assert!(complaint.contains(&format!("error: --realtime-priority: {error}")), "{complaint}");
        return;
    }
    let report = bench("", &args).report();
    let rows = report["rows"].as_array().unwrap();
    assert_eq!(rows.len(), 10, "{report:#}");
    for row in rows {
        assert!(row["what"].as_str().unwrap().contains("Hz with real-time priority, "), "{row:#}");
    }
}

#[test]
fn a_bench_of_growth_says_what_a_tick_costs_with_few_robots_and_with_more_and_by_which_power() {
    let report = bench("", &["--only", "growth", "--robots", "5,2", "--seconds", "0.05"]).report();
    let rows = report["rows"].as_array().unwrap();
    assert_eq!(rows.len(), 2 * 6 + 1, "{report:#}");
    let figure = |what: &str| {
        let row = rows.iter().find(|row| row["what"] == what);
        row.unwrap_or_else(|| panic!("no {what}: {report:#}"))["ours"]["median"].as_f64().unwrap()
    };
    let all_us = [2, 5].map(|robots| {
        assert!(figure(&format!("{robots} robots, ticks/s")) > 0.0);
        assert!(figure(&format!("{robots} robots, ready, s")) > 0.0);
        let all_us = figure(&format!("{robots} robots, processor time per robot and tick, us"));
        let parts = ["robots", "plant", "supervisor"];
        let parts_us = parts.map(|part| figure(&format!("{robots} robots, of it {part}, us")));
        assert!((parts_us.iter().sum::<f64>() / all_us - 1.0).abs() < 1e-9, "{report:#}");
        all_us
    });
    let power = figure("5 robots, exponent of the time per tick, from 2");
    let grown = 5.0 * all_us[1] / (2.0 * all_us[0]);
    assert!((formation::portable_math::pow(2.5, power) / grown - 1.0).abs() < 1e-9, "{report:#}");
    assert!(report["notes"][0].as_str().unwrap().contains("robots of the ring grow"));
}

#[test]
fn a_bench_whose_run_fails_passes_on_what_the_run_complained_of() {
    let args = ["--only", "growth", "--robots", "64"];
    let complaint = bench("ulimit -n 300;", &args).complaint(4);
    let expected = "a run failed (exit code 4): 64 robots need 1384 open files";
    assert!(complaint.contains(expected), "{complaint}");
}

#[test]
fn an_interrupted_bench_ends_its_robots_and_leaves_nothing() {
    // The measurements are far longer than the test waits, but the first peer of a baseline starts after the run.
    for (part, seconds, sign) in [
        ("baselines", "50", "agent.log"),
        ("baselines", "0.2", "ready-0"),
        ("lockstep", "50", "samples.csv"),
        ("lockstep", "0.2", "ready-0"),
        ("realtime", "0.2", "ready-0"),
        ("neighbor", "0.2", "ready-0"),
        ("replacement", "50", "peer-0.log"),
    ] {
        let args = ["--only", part, "--robots", "3", "--seconds", seconds, "--kills", "10000"];
        let is_there = |root: &Path| files_below(root).iter().any(|file| file.ends_with(sign));
        let output = bench("", &args).finish(is_there);
        assert_eq!(output.status.code(), Some(130), "{part}: {output:?}");
        assert!(output.stdout.is_empty(), "{part}: {output:?}");
    }
}
