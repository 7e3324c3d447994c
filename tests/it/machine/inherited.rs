//! State that a run inherits from the process that starts it: ignored and blocked signals, open descriptors, limits.

use std::os::unix::process::CommandExt as _;
use std::process::Command;

use rustix::process::Signal;

use crate::harness::{
    ExitsWith as _, FinishedRun, Phalanx, RunRoot, limited_by, phalanx, run, signal_pid,
};

/// Starts a run with these arguments, after `inherit` has changed the signal state of its process.
fn run_after(inherit: fn() -> i32, arguments: &[&str]) -> Phalanx {
    let mut command = phalanx(["run"]);
    command.args(arguments);
    // SAFETY: the closure makes only async-signal-safe system calls, which are allowed between fork and exec.
    unsafe {
        command.pre_exec(move || match inherit() {
            0 => Ok(()),
            _ => Err(std::io::Error::last_os_error()),
        })
    };
    Phalanx::new(command)
}

fn ignore_sigchld() -> i32 {
    // SAFETY: signal() takes no pointer of ours.
    let before = unsafe { libc::signal(libc::SIGCHLD, libc::SIG_IGN) };
    i32::from(before == libc::SIG_ERR)
}

fn block_all_signals() -> i32 {
    // SAFETY: all zeros is a valid value of this plain type; the first call fills it and the second reads it.
    unsafe {
        let mut all: libc::sigset_t = std::mem::zeroed();
        libc::sigfillset(&mut all);
        libc::sigprocmask(libc::SIG_SETMASK, &all, std::ptr::null_mut())
    }
}

#[test]
fn ignored_sigchld_deaths_are_detected_in_lockstep() {
    let ended = run_after(ignore_sigchld, &["scenarios/triangle-kill.toml"])
        .lockstep()
        .set("duration_s=12")
        .set("expect={}")
        .finish();
    ended.exits_with(0).assert_leaves_nothing();
    ended.assert_holds(
        ended.file("events.csv").contains("died,r2,signal 9"),
        "the death of r2 is recorded",
    );
}

#[test]
fn ignored_sigchld_deaths_are_detected_in_real_time() {
    let set = ["duration_s=60", "expect={}", "robot_defaults.restart_delay_s=0.1"];
    let mut running = run_after(ignore_sigchld, &["scenarios/triangle.toml"]).sets(set).start();
    running.wait_for_event("contact");
    let r2 = running.pid_of("r2");
    signal_pid(r2, Signal::KILL);
    running.wait_for_event("restart");
    running.signal(Signal::INT);
    let ended = running.finish();
    ended.exits_with(130).assert_leaves_nothing();
}

#[test]
fn run_with_blocked_signals_ends_on_sigterm() {
    for pace in ["realtime", "lockstep"] {
        let arguments = ["scenarios/triangle.toml", "--pace", pace];
        let mut running = run_after(block_all_signals, &arguments).set("duration_s=3600").start();
        running.wait_for_event("contact");
        running.signal(Signal::TERM);
        running.finish().exits_with(130).assert_leaves_nothing();
    }
}

#[test]
fn batch_system_signals_end_a_run_like_sigterm() {
    for signal in [Signal::USR1, Signal::USR2] {
        let mut running = run("triangle").lockstep().set("duration_s=3600").start();
        running.wait_for_event("contact");
        running.signal(signal);
        let ended = running.finish();
        ended.exits_with(130).assert_leaves_nothing();
        ended.assert_holds(
            ended.summary["interrupted"] == true,
            "the summary records the interruption",
        );
    }
}

/// Returns the number of open files in the remedy of a refused run.
fn needed_files(ended: &FinishedRun) -> u64 {
    let number = ended.stderr.split("`ulimit -n ").nth(1).and_then(|rest| rest.split('`').next());
    number.expect("the remedy").parse().expect("a number")
}

/// Returns the command of a five-robot run in a process that inherits 100 open descriptors and has an open-file limit
/// of `files`.
fn run_with_100_inherited_descriptors(files: u64, pace: &str) -> Command {
    let open = "i=20; while [ $i -lt 120 ]; do eval \"exec $i</dev/null\"; i=$((i + 1)); done";
    let mut command = Command::new("bash");
    let script = format!("{open}; ulimit -n {files} && exec \"$0\" \"$@\"");
    command.args(["-c", &script, crate::harness::PHALANX, "run", "scenarios/pentagon.toml"]);
    command.args(["--pace", pace, "--set", "duration_s=1", "--set", "expect={}"]);
    command
}

#[test]
fn inherited_open_descriptors_count_against_the_limit() {
    for pace in ["lockstep", "realtime"] {
        let ended = Phalanx::new(run_with_100_inherited_descriptors(200, pace)).finish();
        ended.exits_with(4).assert_leaves_nothing();
        // The test runner may have left descriptors open as well.
        let expected =
            ["5 robots need 130 open files, ", " more are open already (inherited from the parent"];
        ended.assert_holds(
            expected.iter().all(|part| ended.stderr.contains(part)),
            expected.concat(),
        );
        let needed = needed_files(&ended);
        ended.assert_holds(needed >= 230, format!("{needed} open files"));
        Phalanx::new(run_with_100_inherited_descriptors(needed, pace))
            .finish()
            .exits_with(0)
            .assert_leaves_nothing();
    }
}

#[test]
fn live_view_descriptors_are_counted_separately() {
    let run_of = |files: u64| {
        let mut command = limited_by(&format!("ulimit -n {files}"));
        command.args(["run", "scenarios/triangle.toml", "--pace", "lockstep", "--view"]);
        Phalanx::new(command).sets(["duration_s=1", "expect={}"])
    };
    let ended = run_of(150).finish();
    ended.exits_with(4).assert_leaves_nothing();
    let expected = "3 robots need 94 open files, the live view 72, ";
    ended.assert_holds(ended.stderr.contains(expected), expected);
    run_of(needed_files(&ended)).finish().exits_with(0).assert_leaves_nothing();
}

#[test]
fn robot_named_like_another_process_is_refused() {
    let sources =
        std::fs::read_dir("supervisor/src/run").unwrap().map(|entry| entry.unwrap().path());
    let text: String = sources.filter_map(|path| std::fs::read_to_string(path).ok()).collect();
    let mut names = vec!["reaper", "supervisor", "bridge", "ros2"];
    names.extend(text.split("log_path(\"").skip(1).filter_map(|rest| rest.split('"').next()));
    assert!(["plant", "load", "awake", "machine"].iter().all(|name| names.contains(name)));
    let scratch = RunRoot::new();
    let file = scratch.path().join("names.toml");
    for name in names {
        let text = std::fs::read_to_string("scenarios/triangle.toml").unwrap();
        std::fs::write(&file, text.replace("\"r2\"", &format!("\"{name}\""))).unwrap();
        let error = phalanx(["check", file.to_str().unwrap()]).exits_with(3).stderr;
        assert!(
            error.contains(&format!("is \"{name}\", which is the name of another part")),
            "{error}"
        );
    }
}
