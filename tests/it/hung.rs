//! Lockstep runs and wall time: a process that is stopped or descheduled, however long, does not end a run; a hung one
//! does, and is named.

use std::path::Path;
use std::time::{Duration, Instant};

use protocol::barrier::Barrier;
use protocol::run_root;
use rustix::process::Signal;

use crate::harness::{Phalanx, RunInProgress, run, signal_pid};
use crate::oracle::{self, scenario};

const HUNG_SETTINGS: [&str; 3] = ["duration_s=240", "hung_after_s=0.5", "expect={}"];
/// Duration of a stop: several times `hung_after_s`, so that a wrong detection would occur. The test waits for no
/// event.
const STOP_DURATION: Duration = Duration::from_millis(2500);

fn long() -> Phalanx {
    run("triangle").lockstep().sets(HUNG_SETTINGS)
}

/// Starts a run and waits until its robots move.
fn start_moving_run() -> RunInProgress {
    let mut running = long().start();
    running.wait_for_event("contact");
    running
}

fn assert_passes_undisturbed(running: RunInProgress) {
    let ended = running.finish();
    let predicted_hash =
        oracle::simulate(&scenario("triangle", &HUNG_SETTINGS)).trajectory_hash.unwrap();
    ended.exits_with(0).assert_leaves_nothing();
    ended.assert_holds(ended.hash() == predicted_hash, format!("the hash is {predicted_hash}"));
}

#[test]
fn run_waits_for_a_stopped_robot_and_a_stopped_plant() {
    let mut running = start_moving_run();
    for (name, process_name) in [("r2", "r2"), ("plant", "the plant")] {
        let stopped = running.pid_of(name);
        signal_pid(stopped, Signal::STOP);
        running.wait_for_line(&format!(" WARN {process_name} was stopped by another process"));
        std::thread::sleep(STOP_DURATION);
        signal_pid(stopped, Signal::CONT);
    }
    assert_passes_undisturbed(running);
}

#[test]
fn run_continues_after_stopped_supervisor_or_all_stopped() {
    let running = start_moving_run();
    running.signal(Signal::STOP);
    std::thread::sleep(STOP_DURATION);
    running.signal(Signal::CONT);
    let children = running.children();
    running.signal(Signal::STOP);
    children.iter().for_each(|&(pid, _)| signal_pid(pid, Signal::STOP));
    std::thread::sleep(STOP_DURATION);
    // The supervisor continues last: the others find it stopped.
    children.iter().for_each(|&(pid, _)| signal_pid(pid, Signal::CONT));
    std::thread::sleep(STOP_DURATION);
    running.signal(Signal::CONT);
    assert_passes_undisturbed(running);
}

#[test]
fn hung_robot_is_named_and_ends_the_run_with_exit_code_4() {
    let mut running = start_moving_run();
    let move_start = Instant::now();
    // A tick that takes long.
    let r3 = running.pid_of("r3");
    signal_pid(r3, Signal::STOP);
    running.wait_for_line(" WARN r3 was stopped by another process");
    let root = running.roots().into_iter().find(|root| root.is_dir()).expect("a run root");
    let barrier = Barrier::open(&run_root::barrier_path(Path::new(&root))).unwrap();
    let tick =
        running.wait_for("a tick that lacks r3 alone", |_| match barrier.pending_members()[..] {
            [(2, tick)] => Some(tick),
            _ => None,
        });
    // The robot has answered and waits for the next tick; now the answer is removed.
    barrier.set_member(1, 0);
    signal_pid(r3, Signal::CONT);
    let at_least_s = move_start.elapsed().as_secs_f64() + 0.5;
    running.wait_for_line(&format!(
        " WARN r2 has not answered tick {tick}, and is blocked (on a file, a timer or another process), for 0.25 s"
    ));
    let ended = running.finish();
    ended.exits_with(4).assert_leaves_nothing();
    let named = format!("r2 has not answered tick {tick} for 0.5 s while blocked (hung_after_s)");
    ended.assert_holds(ended.stderr.contains(&named), named);
    let wall_s = ended.number("/wall/wall_s");
    ended.assert_holds(
        wall_s >= at_least_s,
        format!("it took at least {at_least_s} s, found {wall_s}"),
    );
}
