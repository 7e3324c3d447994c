//! Planned and unplanned deaths of robots: no robot blocks, distances are kept, and the formation recovers.

use rustix::process::Signal;

use crate::harness::{FinishedRun, Phalanx, run, signal_pid};

/// Checks the bounds during the fault and the convergence after it, in either time mode.
#[track_caller]
fn assert_survived_kill(ended: &FinishedRun) {
    ended.exits_with(0).assert_leaves_nothing().assert_keeps_d();
    ended.assert_holds(ended.number("/final_error_m_max") < 1e-3, "the formation stands again");
    ended.assert_holds(ended.number("/restarts/r2") == 1.0, "r2 was restarted once");
    ended.assert_holds(ended.number("/faults/0/recovered_after_s") >= 0.0, "and recovered from it");
    // The time at which r1 detects it is exact only in lockstep: a busy machine may delay r2 before its death.
    let events = ended.file("events.csv");
    let (dead, back) = events.split_once(",restart,r2").unwrap_or_default();
    ended.assert_holds(last_of_r2(dead) == Some("lost"), "r1 had lost r2 before it was restarted");
    ended.assert_holds(back.contains(",contact,r1,fresh r2"), "and heard it again");
}

/// Returns the last state of r2 that r1, its out-neighbor, reported in this part of `events.csv`.
fn last_of_r2(events: &str) -> Option<&str> {
    let states = events.lines().filter_map(|line| line.split_once(",contact,r1,"));
    states.filter_map(|(_, state)| Some(state.split_once(" r2,")?.0)).next_back()
}

/// Prepares a run with a kill during a maneuver: r2 stops, the others continue, and r2 joins them again.
fn killed_on_the_way(name: &str) -> Phalanx {
    run(name).set("duration_s=16").fault("kill r2 @2.5 restart 2")
}

/// Checks a permanent death of r2: r3, which receives from r1, stops at its slot relative to r1, and r1, which received
/// from r2, stops.
#[track_caller]
fn assert_r1_stands_without_r2(triangle: Phalanx) -> FinishedRun {
    let ended = triangle.lockstep().set("expect={}").fault("kill r2 @2.5").finish();
    ended.exits_with(0);
    ended.assert_holds(ended.number("/restarts/r2") == 0.0, "r2 was not restarted");
    ended.assert_holds(ended.number("/final_error_m/r3") < 1e-3, "r3 stands where r1 wants it");
    ended.assert_holds(ended.summary["final_error_m"]["r2"].is_null(), "the dead have no error");
    let samples = ended.file("samples.csv");
    let standing = samples.lines().filter(|line| line.starts_with("29.") && line.contains(",r1,"));
    let speeds: Vec<f64> =
        standing.map(|line| line.split(',').nth(5).unwrap().parse().unwrap()).collect();
    ended.assert_holds(
        speeds.len() > 50 && speeds.iter().all(|v| v.abs() < 1e-9),
        "r1 stands still",
    );
    ended
}

#[test]
fn robot_with_only_dead_neighbors_stops_or_uses_last_position() {
    assert_r1_stands_without_r2(run("triangle").set("silence.policy=ignore"));
    let ended = assert_r1_stands_without_r2(run("triangle"));
    // r1 extrapolates the last beacon of r2, which was moving; r2 stopped a moment later.
    let offset_m = ended.number("/final_error_m/r1");
    ended.assert_holds(offset_m < 0.02, format!("r1 stands by the dead r2, {offset_m} m off"));
}

#[test]
fn robot_killed_before_start_is_replaced_and_run_is_equal() {
    let undisturbed = run("triangle").lockstep().finish();
    for _ in 0..5 {
        let mut running = run("triangle").lockstep().start();
        let pid = running.pid_of("r2");
        signal_pid(pid, Signal::KILL);
        let ended = running.finish();
        ended.exits_with(0).assert_leaves_nothing();
        if ended.file("events.csv").contains("\n0,restart,r2") {
            ended.assert_holds(
                ended.hash() == undisturbed.hash(),
                "no robot had moved: the hash is the same",
            );
        }
    }
}

#[test]
fn robot_at_the_restart_limit_is_given_up_and_run_continues() {
    let mut running = run("triangle")
        .lockstep()
        .sets(["period_s=0.0001", "duration_s=12"])
        .set("robot_defaults.max_restarts=1")
        .set("expect={}")
        .start();
    running.wait_for_event("contact");
    for _ in 0..2 {
        let pid = running.pid_of("r2");
        signal_pid(pid, Signal::KILL);
        running.wait_for("its death", |run| {
            run.children().iter().all(|(other, _)| *other != pid).then_some(())
        });
    }
    let ended = running.finish();
    ended.exits_with(1).assert_leaves_nothing();
    ended.assert_holds(
        ended.file("events.csv").contains("restart-ceiling,r2"),
        "the ceiling is an event",
    );
    let why = "failed: r2 died (signal 9) after 1 restarts within 60 s (max_restarts); its log: ";
    ended.assert_holds(
        ended.stderr.lines().last().is_some_and(|l| l.starts_with(why)),
        "it is told last",
    );
}

#[test]
fn robot_that_gives_up_repeatedly_exits_4() {
    let mut running = run("triangle").lockstep().set("period_s=0.0001").start();
    running.wait_for_event("contact");
    // The replacement processes find an invalid brief.
    std::fs::write(running.run_dir().join("briefs/r2.toml"), "no brief").unwrap();
    let pid = running.pid_of("r2");
    signal_pid(pid, Signal::KILL);
    let ended = running.finish();
    ended.exits_with(4).assert_leaves_nothing();
    ended.assert_holds(
        ended.stderr.contains("r2 died (exit code 4) and is not restarted"),
        "it is named",
    );
    ended.assert_holds(ended.stderr.contains("not a brief"), "and why it gave up");
}

/// Checks that a process stopped by another program is reported on the screen, in the events, and in the report as
/// frozen.
#[track_caller]
fn assert_was_stopped(ended: &FinishedRun, process_name: &str, events: [&str; 2]) {
    ended.exits_with(130).assert_leaves_nothing();
    let warned = format!(" WARN {process_name} was stopped by another process");
    ended.assert_holds(ended.stderr.contains(&warned), "it is told");
    ended.assert_holds(
        ended.stderr.contains(&format!(" WARN {process_name} was resumed after ")),
        "and its end",
    );
    for event in events {
        ended
            .assert_holds(ended.file("events.csv").contains(event), format!("{event} is an event"));
    }
    let what = ended.summary["faults"][0]["what"].as_str().unwrap_or_default();
    ended.assert_holds(what.starts_with("freeze ") && what.ends_with(", by another process"), what);
    ended.assert_holds(ended.number("/faults/0/lasted_s") > 0.0, "a fault that is over");
    ended.assert_holds(ended.number("/min_distance_m") >= 0.2, "no two robots came closer than d");
}

#[test]
fn robot_stopped_in_real_time_is_reported_and_misses_deadlines() {
    let mut running = run("triangle").set("duration_s=1000").set("expect={}").start();
    running.wait_for_event("contact");
    let pid = running.pid_of("r2");
    signal_pid(pid, Signal::STOP);
    running.wait_for("lost", |run| run.events().contains("lost r2").then_some(()));
    running.wait_for_event("freeze");
    signal_pid(pid, Signal::CONT);
    running.wait_for_line(" WARN r2 was resumed after ");
    running.signal(Signal::INT);
    let ended = running.finish();
    let events =
        ["freeze,r2,\"SIGSTOP, by another process\"", "thaw,r2,\"SIGCONT, by another process\""];
    assert_was_stopped(&ended, "r2", events);
    // At least 100 ms without an answer, at a period of 5 ms.
    ended.assert_holds(ended.number("/deadline_misses") >= 15.0, "the missed periods are counted");
}

#[test]
fn stopped_real_time_plant_is_reported_and_run_continues() {
    let mut running = run("triangle").set("duration_s=1000").set("expect={}").start();
    running.wait_for_event("contact");
    let pid = running.pid_of("plant");
    signal_pid(pid, Signal::STOP);
    running.wait_for_line(" WARN the plant was stopped by another process");
    // Run time continues during the stop.
    std::thread::sleep(std::time::Duration::from_millis(500));
    signal_pid(pid, Signal::CONT);
    running.wait_for_line(" WARN the plant was resumed after ");
    running.signal(Signal::INT);
    let ended = running.finish();
    let events = ["freeze,,\"SIGSTOP of the plant, by", "thaw,,\"SIGCONT of the plant, by"];
    assert_was_stopped(&ended, "the plant", events);
}

#[test]
fn in_real_time_kills_by_plan_and_by_hand_are_survived_alike() {
    let mut planned = killed_on_the_way("triangle").set("expect.converged_by_s=12").start();
    let mut by_hand = run("triangle").set("duration_s=16").start();
    let (pid, _) = by_hand.wait_for("a moving robot", |run| {
        let events = std::fs::read_to_string(run.run_dir().join("events.csv")).ok()?;
        events.contains("contact").then_some(())?;
        run.children().into_iter().find(|(_, name)| name == "r2")
    });
    planned.wait_for_event("kill");
    signal_pid(pid, Signal::KILL);
    let (planned, by_hand) = (planned.finish(), by_hand.finish());
    assert_survived_kill(&planned);
    assert_survived_kill(&by_hand);
}
