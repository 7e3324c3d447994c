//! `phalanx bench` measures every part, runs one trajectory by all means, and leaves nothing, not
//! even when it is interrupted. What it measures is nobody's claim.

use std::path::{Path, PathBuf};
use std::process::{Command, Output, Stdio};
use std::time::{Duration, Instant};

use protocol::process::try_realtime_priority;
use rustix::process::{Pid, Signal, kill_process};
use serde_json::Value;
use tempfile::TempDir;

const BENCH: &str = env!("CARGO_BIN_EXE_phalanx-bench");

/// Only a hang takes this long.
const HANG: Duration = Duration::from_secs(60);

struct Bench {
    run_root: TempDir,
    command: Command,
}

fn bench(args: &[&str]) -> Bench {
    let run_root = tempfile::Builder::new().prefix("phx").tempdir_in("/dev/shm").unwrap();
    let mut command = Command::new(BENCH);
    command
        .args(["--quick", "--rounds", "1", "--output", "json"])
        .args(args)
        .env("PHALANX_RUN_ROOT", run_root.path())
        .stdin(Stdio::null())
        .stdout(Stdio::piped())
        .stderr(Stdio::piped());
    Bench { run_root, command }
}

impl Bench {
    /// Runs it to its end, which is to be a good one: what it reports.
    fn report(self) -> Value {
        let output = self.finish(None, |_| false);
        assert_eq!(output.status.code(), Some(0), "{output:?}");
        serde_json::from_slice(&output.stdout).expect("JSON")
    }

    /// Runs it to its end, and signals it once `until` holds for its run root.
    fn finish(mut self, signal: Option<Signal>, until: impl Fn(&Path) -> bool) -> Output {
        let mut child = self.command.spawn().unwrap();
        let began = Instant::now();
        let mut signal = signal;
        while child.try_wait().unwrap().is_none() {
            if began.elapsed() > HANG {
                let _ = child.kill();
                let _ = child.wait();
                panic!("{:?} hangs", self.command);
            }
            if let Some(signal) = signal.take_if(|_| until(self.run_root.path())) {
                let pid = Pid::from_raw(child.id() as i32).expect("a process id");
                // Gone already is as good as signalled.
                let _ = kill_process(pid, signal);
            }
            std::thread::sleep(Duration::from_millis(2));
        }
        let output = child.wait_with_output().unwrap();
        let left = files_below(self.run_root.path());
        assert!(left.is_empty(), "{:?} leaves {left:?}\n{output:?}", self.command);
        let processes = processes_in(self.run_root.path());
        assert!(processes.is_empty(), "{:?} leaves {processes:?}\n{output:?}", self.command);
        output
    }
}

impl Drop for Bench {
    /// Leaves nothing even where the test fails: what a bench shares outlives its kill, and is
    /// swept once its robots are dead.
    fn drop(&mut self) {
        let began = Instant::now();
        while !files_below(self.run_root.path()).is_empty() && began.elapsed() < HANG {
            for base in std::fs::read_dir(self.run_root.path()).into_iter().flatten().flatten() {
                protocol::run_root::sweep(&base.path());
                let _ = std::fs::remove_dir(base.path());
            }
            std::thread::sleep(Duration::from_millis(10));
        }
    }
}

/// Everything below a directory.
fn files_below(directory: &Path) -> Vec<PathBuf> {
    let mut found = Vec::new();
    for entry in std::fs::read_dir(directory).into_iter().flatten().flatten() {
        found.push(entry.path());
        found.extend(files_below(&entry.path()));
    }
    found
}

/// Command lines of living processes that name something below a directory.
fn processes_in(directory: &Path) -> Vec<String> {
    let entries = std::fs::read_dir("/proc").unwrap().flatten();
    let lines = entries.filter_map(|entry| std::fs::read(entry.path().join("cmdline")).ok());
    let lines = lines.map(|line| String::from_utf8_lossy(&line).replace('\0', " "));
    let name = directory.display().to_string();
    lines.filter(|line| line.contains(&name)).collect()
}

#[test]
fn every_part_gives_figures_and_all_means_move_the_robots_along_one_trajectory() {
    let args = ["--robots", "3", "--seconds", "0.02", "--kills", "2"];
    let report = bench(&args).report();

    let [trajectory] = &report["trajectories"].as_array().unwrap()[..] else {
        panic!("one number of robots, one trajectory: {report:#}");
    };
    let hashes = trajectory["hashes"].as_array().unwrap();
    let means: Vec<&str> = hashes.iter().map(|hash| hash[0].as_str().unwrap()).collect();
    assert_eq!(means, ["phalanx run", "mapping + futex", "pipes"]);
    assert!(hashes.iter().all(|hash| hash[1] == hashes[0][1]), "{hashes:?}");
    assert_eq!(hashes[0][1].as_str().unwrap().len(), 16);

    let rows = report["rows"].as_array().unwrap();
    let count = |part: &str| rows.iter().filter(|row| row["part"] == part).count();
    let parts = ["floors", "lockstep", "neighbor", "startup", "replacement"];
    assert_eq!(parts.map(count), [12, 3, 12, 1, 4], "{report:#}");
    // Two rates, each with misses, expired commands, and what the summary tells of lateness.
    assert_eq!(count("realtime"), 10, "{report:#}");
    for row in rows {
        let figure = |of: &str| row[of]["median"].as_f64();
        assert!(figure("ours").is_some_and(|ours| ours >= 0.0), "{row:#}");
        // Nothing is a multiple of nothing: nobody need miss a deadline.
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
    let bench = bench(&args);
    if let Err(error) = try_realtime_priority() {
        let output = bench.finish(None, |_| false);
        let complaint = format!("error: --realtime-priority: {error}");
        assert_eq!(output.status.code(), Some(4), "{output:?}");
        assert!(String::from_utf8_lossy(&output.stderr).contains(&complaint), "{output:?}");
        return;
    }
    let report = bench.report();
    let rows = report["rows"].as_array().unwrap();
    assert_eq!(rows.len(), 10, "{report:#}");
    for row in rows {
        assert!(row["what"].as_str().unwrap().contains("Hz with real-time priority, "), "{row:#}");
        assert!(row["ours"]["median"].as_f64() >= Some(0.0), "{row:#}");
    }
}

#[test]
fn a_bench_of_the_live_view_runs_with_a_reader_and_without() {
    let args = ["--only", "view", "--robots", "3", "--seconds", "0.3"];
    let report = bench(&args).report();
    let rows = report["rows"].as_array().unwrap();
    let figure = |what: &str, of: &str| {
        let row = rows.iter().find(|row| row["what"].as_str().unwrap().contains(what));
        row.unwrap_or_else(|| panic!("no {what}: {report:#}"))[of]["median"].as_f64()
    };
    assert!(figure("missed, % of periods, watched", "ours") >= Some(0.0));
    assert!(figure("missed, % of periods, without a view", "ours") >= Some(0.0));
    assert!(figure("frames", "ours") > Some(0.0), "the reader was shown the run: {report:#}");
    for quantile in ["p50", "p99", "p99.9"] {
        let what = format!("wake lateness {quantile} ");
        assert!(figure(&what, "ours") > Some(0.0) && figure(&what, "floor") > Some(0.0));
    }
}

#[test]
fn a_bench_of_growth_says_what_a_tick_costs_with_few_robots_and_with_more_and_by_which_power() {
    let args = ["--only", "growth", "--robots", "5,2", "--seconds", "0.05"];
    let report = bench(&args).report();
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
    let power = figure("2 to 5 robots, exponent of the processor time per tick");
    let grown = 5.0 * all_us[1] / (2.0 * all_us[0]);
    assert!((2.5_f64.powf(power) / grown - 1.0).abs() < 1e-9, "{report:#}");
    let notes = report["notes"].as_array().unwrap();
    assert!(notes.iter().any(|note| note.as_str().unwrap().contains("robots of the ring grow")));
}

#[test]
fn a_bench_of_pages_sorts_what_a_tick_touches_by_what_the_memory_is_for() {
    let report = bench(&["--only", "pages", "--robots", "3"]).report();
    let rows = report["rows"].as_array().unwrap();
    let figure = |begins: &str| {
        let row = rows.iter().find(|row| row["what"].as_str().unwrap().starts_with(begins));
        row.unwrap_or_else(|| panic!("no {begins}: {report:#}"))["ours"]["median"].as_f64().unwrap()
    };
    assert!(figure("3 robots, ticks") >= 2.0, "{report:#}");
    for process in ["3 robots, a robot: ", "3 robots, the plant: "] {
        let of = |kind: &str| figure(&format!("{process}{kind}"));
        for kind in ["code", "heap", "stack", "iceoryx2: samples", "iceoryx2: conn", "barrier"] {
            assert!(of(kind) >= 1.0, "{process}{kind}: {report:#}");
        }
        let is_a_kind = |row: &&Value| {
            let what = row["what"].as_str().unwrap();
            what.starts_with(process) && what.contains(", pages of") && !what.contains(": all")
        };
        let kinds = rows.iter().filter(is_a_kind);
        let sum: f64 = kinds.map(|row| row["ours"]["median"].as_f64().unwrap()).sum();
        assert!((sum - of("all")).abs() < 1e-9, "{report:#}");
    }
}

#[test]
fn a_bench_whose_run_fails_passes_on_what_the_run_complained_of() {
    let mut bench = bench(&["--only", "growth", "--robots", "64"]);
    let mut limited = Command::new("sh");
    limited.args(["-c", "ulimit -n 300 && exec \"$0\" \"$@\"", BENCH]);
    limited.args(bench.command.get_args()).env("PHALANX_RUN_ROOT", bench.run_root.path());
    limited.stdin(Stdio::null()).stdout(Stdio::piped()).stderr(Stdio::piped());
    bench.command = limited;
    let output = bench.finish(None, |_| false);
    assert_eq!(output.status.code(), Some(4), "{output:?}");
    let error = String::from_utf8(output.stderr).unwrap();
    let complaint = "a run failed (exit code 4): 64 robots need 1384 open files";
    assert!(error.contains(complaint), "{error}");
}

#[test]
fn an_interrupted_bench_ends_its_robots_and_leaves_nothing() {
    // Measurements far longer than the test waits; but the first peer of a floor comes after ours.
    for (part, seconds, sign) in [
        ("floors", "50", "agent.log"),
        ("floors", "0.2", "ready-0"),
        ("lockstep", "50", "samples.csv"),
        ("realtime", "50", "samples.csv"),
        ("realtime", "0.2", "ready-0"),
        ("neighbor", "0.2", "ready-0"),
        ("growth", "50", "samples.csv"),
        ("replacement", "50", "peer-0.log"),
    ] {
        let args = ["--only", part, "--robots", "3", "--seconds", seconds, "--kills", "10000"];
        let is_there = |root: &Path| files_below(root).iter().any(|file| file.ends_with(sign));
        let output = bench(&args).finish(Some(Signal::INT), is_there);
        assert_eq!(output.status.code(), Some(130), "{part}: {output:?}");
        assert!(output.stdout.is_empty(), "{part}: {output:?}");
    }
}
