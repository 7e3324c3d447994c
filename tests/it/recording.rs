//! Tests of the recording: it agrees with the tables, in our own reader and in those of others; a kill of the
//! supervisor loses little of it; and it stays small.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::process::Command;
use std::time::{Duration, Instant};

use rustix::process::Signal;

use crate::harness::{ExitsWith as _, FinishedRun, phalanx, run, signal_pid};

const FAULT: &str = "kill r2 @2.5 restart 2";

/// Parses the rows of a table, with columns by name.
fn table(path: &Path) -> Vec<BTreeMap<String, String>> {
    let text = std::fs::read_to_string(path).unwrap();
    let mut rows = text.lines().map(|line| line.split(',').map(str::to_owned));
    let columns: Vec<String> = rows.next().expect("a header").collect();
    rows.map(|row| columns.iter().cloned().zip(row).collect()).collect()
}

/// Checks that the columns of two tables are equal, number by number.
#[track_caller]
fn assert_columns_equal(first: &Path, second: &Path, columns: &[&str], rows_max: usize) {
    let (one_rows, other_rows) = (table(first), table(second));
    for (one_row, other_row) in one_rows.iter().zip(&other_rows).take(rows_max) {
        for &column in columns {
            let (a, b) = (&one_row[column], &other_row[column]);
            let is_equal = match (a.parse::<f64>(), b.parse::<f64>()) {
                // The heading is converted to a quaternion and back.
                (Ok(a), Ok(b)) if column == "heading_rad" => (a - b).abs() < 1e-14,
                (Ok(a), Ok(b)) => a == b,
                _ => a == b,
            };
            assert!(is_equal, "{column} at {}: {a} and {b}", one_row["t_s"]);
        }
    }
    let rows = (one_rows.len().min(rows_max), other_rows.len().min(rows_max));
    assert_eq!(rows.0, rows.1, "{} and {}", first.display(), second.display());
}

fn recorded_run() -> FinishedRun {
    let ended = run("triangle").lockstep().fault(FAULT).finish();
    ended.exits_with(0).assert_leaves_nothing();
    ended
}

#[test]
fn export_equals_the_run_files_for_every_robot_and_event() {
    let ended = recorded_run();
    let run_dir = ended.run_dir();
    let output = phalanx([Path::new("export"), &run_dir]).exits_with(0).stdout_and_stderr();
    ended.assert_holds(output.contains("poses.csv"), format!("the tables are named: {output}"));
    let (samples, export) = (run_dir.join("samples.csv"), run_dir.join("export"));
    let all = usize::MAX;
    let pose = ["t_s", "robot", "x_m", "y_m", "heading_rad"];
    assert_columns_equal(&samples, &export.join("poses.csv"), &pose, all);
    assert_columns_equal(
        &samples,
        &export.join("commands.csv"),
        &["t_s", "robot", "v_m_s", "w_rad_s"],
        all,
    );
    let errors = ["t_s", "robot", "error_m", "alive", "ideal_error_m", "error_x_m", "error_y_m"];
    assert_columns_equal(&samples, &export.join("errors.csv"), &errors, all);
    assert_columns_equal(
        &run_dir.join("events.csv"),
        &export.join("events.csv"),
        &["t_s", "kind", "robot"],
        all,
    );
    // The minimum over recorded instants is not below the minimum over all ticks.
    let nearest = table(&export.join("distances.csv"))
        .iter()
        .map(|row| row["min_distance_m"].parse().unwrap())
        .fold(f64::INFINITY, f64::min);
    let minimum_m = ended.number("/min_distance_m");
    ended.assert_holds(
        (minimum_m..1.01 * minimum_m).contains(&nearest),
        format!("{nearest} m apart at last"),
    );

    let second_export = phalanx([Path::new("export"), &run_dir]).exits_with(2).stdout_and_stderr();
    ended.assert_holds(
        second_export.contains("exists already"),
        format!("it is not overwritten: {second_export}"),
    );
    let recover_output = phalanx([Path::new("recover"), &run_dir.join("run.mcap")])
        .exits_with(0)
        .stdout_and_stderr();
    ended.assert_holds(
        recover_output.contains("is complete"),
        format!("there is nothing to recover: {recover_output}"),
    );
    let missing = phalanx([Path::new("recover"), Path::new("missing.mcap")])
        .exits_with(2)
        .stdout_and_stderr();
    ended.assert_holds(missing.contains("missing.mcap"), format!("the file is named: {missing}"));

    let bytes = std::fs::read(run_dir.join("run.mcap")).unwrap();
    let mut bit_flipped = bytes.clone();
    bit_flipped[bytes.len() / 2] ^= 4;
    for (name, damaged) in [("flipped", &bit_flipped[..]), ("cut", &bytes[..bytes.len() - 1])] {
        let file = run_dir.join(name).with_extension("mcap");
        std::fs::write(&file, damaged).unwrap();
        let output = phalanx([Path::new("export"), &file]).exits_with(1).stdout_and_stderr();
        let named = output.contains("is damaged") && output.contains("--allow-damage");
        ended.assert_holds(named, format!("{name}: the remedy is reported: {output}"));
        phalanx([Path::new("export"), &file, Path::new("--allow-damage")])
            .exits_with(0)
            .stdout_and_stderr();
        // Of the second recording only the end of the index is lost.
        let code = i32::from(name == "flipped");
        let output = phalanx([Path::new("recover"), &file]).exits_with(code).stdout_and_stderr();
        ended.assert_holds(!output.contains("is complete"), format!("{name}: {output}"));
        ended.assert_holds(
            output.contains("seconds lost: ") == (code == 1),
            format!("{name}: {output}"),
        );
    }
}

/// A run whose supervisor was killed in mid-run.
struct Cut {
    /// The run, which keeps its directory alive.
    _running: crate::harness::RunInProgress,
    recovered: PathBuf,
    run_dir: PathBuf,
    /// Lower bound of the run time at which the supervisor was killed, s.
    killed_after_s: f64,
}

/// Runs in real time and kills r2, which the supervisor records with its run time, and then the supervisor after a
/// pause. The run time at its death is at least the recorded one plus the pause.
fn cut() -> Cut {
    let mut running = run("triangle").set("expect={}").start();
    running.wait_for("a second of samples", |run| {
        let samples = std::fs::read_to_string(run.run_dir().join("samples.csv")).ok()?;
        (samples.lines().count() > 300).then_some(())
    });
    let robot = running.pid_of("r2");
    signal_pid(robot, Signal::KILL);
    running.wait_for_event("died");
    let death_seen = Instant::now();
    running.wait_for("1.2 s more", |_| {
        (death_seen.elapsed() > Duration::from_millis(1200)).then_some(())
    });
    running.signal(Signal::KILL);
    let later_s = death_seen.elapsed().as_secs_f64();
    let run_dir = running.run_dir();
    let died = table(&run_dir.join("events.csv")).into_iter().find(|row| row["kind"] == "died");
    let died_s: f64 = died.expect("it was waited for")["t_s"].parse().unwrap();
    let recovered = run_dir.join("run.recovered.mcap");
    // The supervisor has exited at the end of its output: it wrote within the last milliseconds.
    let exit_time = Instant::now();
    while exit_time.elapsed() < Duration::from_secs(20)
        && std::fs::read(format!("/proc/{}/cmdline", running.pid())).is_ok_and(|w| !w.is_empty())
    {
        std::thread::sleep(Duration::from_millis(5));
    }
    phalanx([Path::new("recover"), &run_dir.join("run.mcap")]).exits_with(0).stdout_and_stderr();
    Cut { _running: running, recovered, run_dir, killed_after_s: died_s + later_s }
}

#[test]
fn killed_supervisor_loses_at_most_1_s_of_recording() {
    let cut = cut();
    let out = cut.run_dir.join("tables");
    let args = [Path::new("export"), &cut.recovered, Path::new("--out"), &out];
    phalanx(args).exits_with(0).stdout_and_stderr();
    let poses = table(&out.join("poses.csv"));
    let last_s: f64 = poses.last().expect("there are poses")["t_s"].parse().unwrap();
    let lost_s = cut.killed_after_s - last_s;
    assert!(lost_s <= 1.0, "the last {lost_s} s are lost: {last_s} of {} s", cut.killed_after_s);
    let samples = cut.run_dir.join("samples.csv");
    let rows = poses.len().min(table(&samples).len() - 1);
    assert_columns_equal(&samples, &out.join("poses.csv"), &["t_s", "robot", "x_m", "y_m"], rows);
    let events = table(&out.join("events.csv"));
    assert!(events.iter().any(|row| row["kind"] == "died"), "{events:?}");
}

/// Returns the path of the Python that has the readers.
fn python() -> PathBuf {
    let installed = concat!(env!("CARGO_MANIFEST_DIR"), "/target/readers/bin/python");
    let python = std::env::var_os("PHALANX_PYTHON").map_or(installed.into(), PathBuf::from);
    assert!(
        python.exists(),
        "{}: no such Python. Install the readers with: tests/readers/install",
        python.display()
    );
    python
}

/// Runs a script of `tests/readers`, which must succeed.
#[track_caller]
pub fn assert_script_succeeds(script: &str, args: &[&Path]) {
    Command::new(python())
        .env("PYTHONDONTWRITEBYTECODE", "1")
        .arg(format!("{}/tests/readers/{script}.py", env!("CARGO_MANIFEST_DIR")))
        .args(args)
        .exits_with(0);
}

const READERS: &str = "by_rosbags by_mcap by_rerun";

#[test]
#[ignore = "needs the readers that tests/readers/install installs"]
fn third_party_readers_find_every_number_of_the_tables() {
    let ended = recorded_run();
    for script in READERS.split(' ') {
        assert_script_succeeds(script, &[&ended.run_dir()]);
    }
}

#[test]
#[ignore = "needs the readers that tests/readers/install installs"]
fn third_party_readers_find_walls_as_a_latched_marker() {
    let disc = "obstacle=[{ kind = \"disc\", center_m = [4.0, 4.0], radius_m = 0.5 }]";
    let wall = "wall=[{ points_m = [[-3.0, 4.0], [3.0, 4.0], [3.0, 5.0]], closed = true }]";
    let with_walls =
        run("triangle").lockstep().set(disc).set(wall).set("duration_s=1").set("expect={}");
    let ended = with_walls.finish();
    ended.exits_with(0);
    for script in READERS.split(' ') {
        assert_script_succeeds(script, &[&ended.run_dir()]);
    }
}

#[test]
#[ignore = "needs the readers that tests/readers/install installs"]
fn third_party_readers_open_a_recovered_file() {
    let cut = cut();
    for script in ["by_rosbags", "by_mcap"] {
        assert_script_succeeds(script, &[&cut.run_dir, &cut.recovered]);
    }
}
