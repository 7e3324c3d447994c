//! A supervisor that does not run for a while in real time, and robots that are dead when a run ends.

use std::time::Duration;

use rustix::process::Signal;

use crate::harness::{FinishedRun, RunInProgress, run, signal_pid};

/// Starts a run of 60 periods in real time, and stops its supervisor.
fn start_with_stopped_supervisor(expect: &str) -> RunInProgress {
    let set = ["duration_s=3", "period_s=0.05", "avoidance.kind=none", expect];
    let mut running = run("triangle").sets(set).start();
    running.wait_for_event("contact");
    running.signal(Signal::STOP);
    running
}

/// Resumes the supervisor of a run of [`start_with_stopped_supervisor`] after the duration of the run has passed and
/// the plant has exited. Waits 5 s for the former, because a stopped supervisor writes nothing that shows it.
fn resume_after_end(mut running: RunInProgress) -> FinishedRun {
    let plant = running.pid_of("plant");
    std::thread::sleep(Duration::from_secs(5));
    signal_pid(plant, Signal::TERM);
    running.wait_for("the end of the plant", |run| {
        run.children().iter().all(|(pid, _)| *pid != plant).then_some(())
    });
    running.signal(Signal::CONT);
    running.finish()
}

#[test]
fn death_in_a_standstill_past_the_end_misses_alive_at_end() {
    let mut running = start_with_stopped_supervisor("expect={alive_at_end=3}");
    let r2 = running.pid_of("r2");
    signal_pid(r2, Signal::KILL);
    let ended = resume_after_end(running);
    ended.exits_with(1).assert_leaves_nothing();
    ended.assert_holds(ended.stdout.contains("MISSED alive_at_end"), "r2 is not alive at the end");
    ended.assert_holds(
        ended.file("events.csv").contains("died,r2,signal 9"),
        "the death is an event",
    );
}

#[test]
fn standstill_of_all_processes_is_reported() {
    let mut running = start_with_stopped_supervisor("expect={}");
    let children = running.children();
    children.iter().for_each(|&(pid, _)| signal_pid(pid, Signal::STOP));
    std::thread::sleep(Duration::from_secs(3));
    children.iter().for_each(|&(pid, _)| signal_pid(pid, Signal::CONT));
    running.signal(Signal::CONT);
    running.wait_for_line(" WARN the supervisor did not run for ");
    let ended = running.finish();
    ended.exits_with(0).assert_leaves_nothing();
    ended.assert_holds(
        ended.file("events.csv").contains(",stood-still,,\"supervisor, for "),
        "an event",
    );
}

#[test]
fn replacement_due_after_the_end_fails_the_run() {
    let set = ["duration_s=2", "expect={}", "robot_defaults.restart_delay_s=60"];
    let mut running = run("triangle").sets(set).start();
    running.wait_for_event("contact");
    let r2 = running.pid_of("r2");
    signal_pid(r2, Signal::KILL);
    let ended = running.finish();
    ended.exits_with(1).assert_leaves_nothing();
    let expected =
        "failed: r2 died (signal 9), and its replacement had not been started at the end";
    ended.assert_holds(ended.stderr.contains(expected), expected);
}

#[test]
fn replacement_that_dies_at_once_is_a_warning() {
    let set = ["duration_s=3600", "expect={}", "robot_defaults.restart_delay_s=0.1"];
    let mut running = run("triangle").sets(set).start();
    running.wait_for_event("contact");
    // The name of its law is no law any more.
    let brief = running.run_dir().join("briefs/r2.toml");
    std::fs::write(&brief, "").unwrap();
    let r2 = running.pid_of("r2");
    signal_pid(r2, Signal::KILL);
    running.wait_for_line(" WARN its replacement died as well; the last lines of its log:");
    running.signal(Signal::INT);
    running.finish().exits_with(130).assert_leaves_nothing();
}

#[test]
fn removed_run_root_ends_the_run_with_the_reason() {
    let set = ["duration_s=3600", "expect={}", "robot_defaults.restart_delay_s=0.1"];
    let mut running = run("triangle").sets(set).start();
    running.wait_for_event("contact");
    let root = running.roots().remove(0);
    std::fs::remove_dir_all(&root).unwrap();
    let r2 = running.pid_of("r2");
    signal_pid(r2, Signal::KILL);
    let ended = running.finish();
    ended.exits_with(4);
    let expected = format!("the run root {} was removed during the run", root.display());
    ended.assert_holds(ended.stderr.contains(&expected), expected);
}
