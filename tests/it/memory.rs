//! Shared memory that is too small or full. The run is refused before the start, continues where it can, and otherwise
//! ends with full memory named as the cause.
//!
//! Each test has its own tmpfs in a private mount namespace.

use std::cell::Cell;
use std::fs::File;
use std::io::Write as _;
use std::process::Command;
use std::sync::atomic::{AtomicBool, Ordering};

use rustix::fs::{Mode, OFlags};
use rustix::process::Signal;

use crate::harness::{Phalanx, RunInProgress, signal_pid, wait_until_gone};

/// Prepares `phalanx run scenarios/triangle.toml` with its run root on a tmpfs of `kib` KiB, of which `taken_kib` KiB
/// are in use. Returns `None` and prints a note if this user may not mount one.
fn triangle_on(kib: u64, taken_kib: u64) -> Option<Phalanx> {
    let script = format!(
        r#"mount -t tmpfs -o size={kib}k phalanx-test "$PHALANX_RUN_ROOT" || exit 77
        head -c {taken_kib}k /dev/zero >"$PHALANX_RUN_ROOT/taken"; exec "$0" "$@""#
    );
    let in_namespace = |program: &str| {
        let mut command = Command::new("unshare");
        command.args(["--mount", "sh", "-c", &script, program]);
        command
    };
    let run_root = tempfile::tempdir().unwrap();
    let probe = in_namespace("true").env("PHALANX_RUN_ROOT", run_root.path()).status();
    if !probe.is_ok_and(|status| status.success()) {
        println!("SKIPPED: this user may not mount a tmpfs in a private mount namespace");
        return None;
    }
    let mut command = in_namespace(env!("CARGO_BIN_EXE_phalanx"));
    command.args(["run", "scenarios/triangle.toml"]);
    Some(Phalanx::new(command).set("expect={}"))
}

/// Opens the directory of a run's tmpfs. A path would not do: when the run ends, its mount namespace is removed, and the
/// same path can then lead to the shared memory of the machine.
fn open_tmpfs(running: &RunInProgress) -> File {
    let path = format!("/proc/{}/root{}", running.pid(), running.run_root().display());
    let tmpfs = File::open(path).unwrap();
    let space = rustix::fs::fstatvfs(&tmpfs).unwrap();
    assert_eq!(space.f_blocks * space.f_frsize, 16 << 20, "the tmpfs of the test");
    tmpfs
}

/// Fills the free space of the tmpfs.
fn fill(tmpfs: &File) {
    let flags = OFlags::CREATE | OFlags::RDWR | OFlags::APPEND;
    let filler = rustix::fs::openat(tmpfs, "filler", flags, Mode::RUSR | Mode::WUSR);
    let Ok(mut filler) = filler.map(File::from) else { return };
    for size in [1 << 16, 1 << 12] {
        while filler.write(&vec![1; size]).is_ok_and(|written| written > 0) {}
    }
}

/// Waits until the plant and all robots are ready: a robot that has received a beacon has also received odometry.
fn wait_until_all_are_ready(running: &mut RunInProgress) {
    running.wait_for("three robots that hear each other", |run| {
        let seen = [",ready,", ",contact,"].map(|kind| run.events().matches(kind).count());
        seen.iter().all(|&count| count >= 3).then_some(())
    });
}

/// Waits until the supervisor has allocated the memory of the files that the robots created when they connected: the
/// use of the file system no longer grows.
fn wait_until_memory_is_allocated(running: &mut RunInProgress, tmpfs: &File) {
    let last_use_and_polls = Cell::new((0, 0));
    running.wait_for("memory that is allocated", |_| {
        let space = rustix::fs::fstatvfs(tmpfs).ok()?;
        let in_use = space.f_blocks - space.f_bfree;
        let (last_use, polls) = last_use_and_polls.get();
        let polls = if in_use == last_use { polls + 1 } else { 0 };
        last_use_and_polls.set((in_use, polls));
        (polls >= 40).then_some(())
    });
}

#[test]
fn small_or_full_tmpfs_is_refused_before_the_start() {
    for (kib, taken_kib, problem) in [(64, 0, "too small"), (8192, 8000, "full")] {
        let Some(run) = triangle_on(kib, taken_kib) else { return };
        let running = run.start();
        let mount = running.run_root().display().to_string();
        let ended = running.finish();
        ended.exits_with(4);
        let expected = format!("error: shared memory is {problem}: {mount} (tmpfs) has ");
        ended.assert_holds(ended.stderr.contains(&expected), format!("it says {expected:?}"));
        ended.assert_holds(
            ended.stderr.contains("3 robots with 3 links need "),
            "the need is reported",
        );
        ended.assert_holds(ended.stderr.contains("PHALANX_RUN_ROOT"), "the remedy is reported");
        ended.assert_holds(
            !ended.run_dir().join("logs/plant.jsonl").exists(),
            "nothing was started",
        );
    }
}

#[test]
fn memory_filled_after_the_start_does_not_affect_robots() {
    let Some(run) = triangle_on(16 * 1024, 0) else { return };
    // In lockstep no queue grows because the machine is busy.
    let mut running = run.lockstep().set("duration_s=300").start();
    wait_until_all_are_ready(&mut running);
    let tmpfs = open_tmpfs(&running);
    wait_until_memory_is_allocated(&mut running, &tmpfs);
    fill(&tmpfs);
    let ended = running.finish();
    ended.exits_with(0);
    ended.assert_holds(ended.number("/t_s") == 300.0, "the run continued to its end");
}

#[test]
fn replacement_with_full_memory_ends_run_with_4_and_cause() {
    let Some(run) = triangle_on(16 * 1024, 0) else { return };
    let mut running = run.set("duration_s=60").fault("kill r2 @1 restart 1").start();
    wait_until_all_are_ready(&mut running);
    let tmpfs = open_tmpfs(&running);
    let ended = AtomicBool::new(false);
    let ended = std::thread::scope(|scope| {
        // Space that is freed by terminated processes is filled, too.
        scope.spawn(|| {
            while !ended.load(Ordering::Relaxed) {
                fill(&tmpfs);
                std::thread::sleep(std::time::Duration::from_millis(1));
            }
        });
        let outcome = running.finish();
        ended.store(true, Ordering::Relaxed);
        outcome
    });
    ended.exits_with(4);
    ended.assert_holds(
        ended.stderr.contains("error: shared memory is full: "),
        "the cause is named",
    );
    ended.assert_holds(ended.stderr.contains("0 KiB of 16 MiB free"), "with what is left");
    ended.assert_holds(ended.stderr.contains("r2 "), "the robot is named");
}

#[test]
fn sigbus_in_full_memory_is_reported_as_full_memory() {
    for process_name in ["plant", "r1", "supervisor"] {
        let Some(run) = triangle_on(16 * 1024, 0) else { return };
        let mut running = run.set("duration_s=60").start();
        wait_until_all_are_ready(&mut running);
        let pid = match process_name {
            "supervisor" => running.pid(),
            child => running.pid_of(child),
        };
        let run_dir = running.run_dir();
        fill(&open_tmpfs(&running));
        // At the first SIGBUS, Rust's handler only restores the default action, since it expects the fault to
        // repeat. The third has no effect if the process is already dead and not yet reaped.
        for _ in 0..3 {
            signal_pid(pid, Signal::BUS);
            std::thread::sleep(std::time::Duration::from_millis(50));
        }
        let ended = running.finish();
        ended.exits_with(4);
        ended.assert_holds(
            ended.stderr.contains("error: shared memory is full"),
            "the cause is named",
        );
        ended.assert_holds(ended.stderr.contains("of 16 MiB free"), "with what is left");
        if process_name != "supervisor" {
            let expected = format!("{process_name} died for this reason (signal 7");
            ended.assert_holds(ended.stderr.contains(&expected), format!("it says {expected:?}"));
        }
        wait_until_gone(&run_dir);
    }
}
