//! Runs whose output is not read or whose terminal is closed: the run is recorded nevertheless, and no process exits
//! because of a line that it could not write.

use std::fs::File;
use std::io::Write as _;
use std::os::fd::AsRawFd;
use std::path::{Path, PathBuf};
use std::process::Command;

use rustix::process::Signal;

use crate::harness::{FinishedRun, Phalanx, RunInProgress, limited_by, run, signal_pid};

/// Acceptance criteria that also hold if a replacement is not ready at the end of a short run on a busy machine.
const TWO_ARE_ENOUGH: &str = "expect={alive_at_end=2}";

/// Returns shell commands after which stderr is not read: two ways in which writing fails.
fn unread_outputs(scratch: &Path) -> [String; 2] {
    let pipe = scratch.join("pipe");
    let pipe = pipe.display();
    let closed = format!("mkfifo {pipe} && exec 3<>{pipe} && exec 2>{pipe} && exec 3<&-");
    ["exec 2>/dev/full".into(), closed]
}

#[test]
fn run_with_unread_warnings_ends_normally() {
    let scratch = tempfile::tempdir().unwrap();
    for commands in unread_outputs(scratch.path()) {
        let mut command = limited_by(&commands);
        command.args(["run", "scenarios/triangle.toml"]);
        let mut running = Phalanx::new(command).set("duration_s=2").set(TWO_ARE_ENOUGH).start();
        running.wait_for_event("contact");
        // An unplanned death is a warning.
        let robot = running.pid_of("r2");
        signal_pid(robot, Signal::KILL);
        let ended = running.finish();
        ended.exits_with(0).assert_leaves_nothing();
        ended.assert_holds(ended.stderr.is_empty(), "nothing can be said");
        ended.assert_holds(
            ended.file("events.csv").contains("died,r2"),
            "there was something to say",
        );
        ended.assert_holds(ended.number("/t_s") == 2.0, "and there is a summary");
    }
}

/// Returns shell commands after which stderr is a full pipe that no process reads.
fn full_pipe(scratch: &Path) -> String {
    let pipe = scratch.join("full");
    let pipe = pipe.display();
    // The pipe is smaller if the user has many pipes.
    let dd = format!("dd if=/dev/zero of={pipe} bs=4096 count=16 oflag=nonblock 2>/dev/null");
    format!("mkfifo {pipe} && exec 3<>{pipe} && {{ {dd} || true; }} && exec 2>{pipe}")
}

/// Kills r2, waits for its replacement, and ends the run by Ctrl-C.
fn restarts_and_ends(mut running: RunInProgress) -> FinishedRun {
    running.wait_for_event("contact");
    let r2 = running.pid_of("r2");
    signal_pid(r2, Signal::KILL);
    running.wait_for_event("restart");
    running.signal(Signal::INT);
    let ended = running.finish();
    ended.exits_with(130).assert_leaves_nothing();
    ended
}

#[test]
fn full_unread_pipe_does_not_block_a_run() {
    let scratch = tempfile::tempdir().unwrap();
    let mut command = limited_by(&full_pipe(scratch.path()));
    command.args(["run", "scenarios/triangle.toml"]);
    restarts_and_ends(Phalanx::new(command).set("duration_s=3600").start());
}

#[test]
fn robot_and_plant_with_full_logs_keep_their_exit_codes() {
    let scratch = tempfile::tempdir().unwrap();
    for commands in unread_outputs(scratch.path()) {
        for role in ["agent", "plant"] {
            let _ = std::fs::remove_file(scratch.path().join("pipe"));
            let status = limited_by(&commands).args([role, "/no/such/brief"]).status().unwrap();
            assert_eq!(status.code(), Some(4), "{role}, {commands}: {status}");
        }
    }
}

/// Returns whether the tests run under `nohup`: then hang-ups cannot be tested.
fn hangups_are_ignored() -> bool {
    let status = std::fs::read_to_string("/proc/self/status").unwrap();
    let ignored = status.lines().find_map(|line| line.strip_prefix("SigIgn:")).unwrap();
    let ignored = u64::from_str_radix(ignored.trim(), 16).unwrap() & 1 != 0;
    if ignored {
        eprintln!("skipped: SIGHUP is ignored here");
    }
    ignored
}

#[test]
fn repeated_hangup_stops_a_run_like_an_interrupt() {
    if hangups_are_ignored() {
        return;
    }
    for pace in ["realtime", "lockstep"] {
        let started = run("triangle").args(["--pace", pace]).set("duration_s=3600");
        let mut running = started.set("record_hz=1").drawing().start();
        running.wait_for_event("contact");
        // A shell forwards the signals that the kernel sends.
        running.signal(Signal::HUP);
        running.signal(Signal::HUP);
        let ended = running.finish();
        ended.exits_with(130).assert_leaves_nothing();
        ended.assert_holds(ended.summary["interrupted"] == true, "the summary says so");
        ended.assert_holds(ended.file("report.html").contains("</html>"), "and there is a report");
    }
}

#[test]
fn robots_and_plant_end_on_a_hang_up_by_themselves() {
    if hangups_are_ignored() {
        return;
    }
    let mut running = run("triangle").set("duration_s=60").start();
    running.wait_for_event("contact");
    let robot = running.pid_of("r2");
    signal_pid(robot, Signal::HUP);
    running.wait_for_event("died");
    let log = |run: &crate::harness::RunInProgress, name: &str| {
        std::fs::read_to_string(run.run_dir().join(format!("logs/{name}.jsonl"))).unwrap()
    };
    assert!(running.events().contains("died,r2,exit code 0"), "{}", running.events());
    let robot_log = log(&running, "r2");
    let plant = running.pid_of("plant");
    signal_pid(plant, Signal::HUP);
    let ended = running.finish();
    ended.exits_with(4).assert_leaves_nothing();
    ended.assert_holds(ended.stderr.contains("the plant died (exit code 0)"), robot_log);
}

#[test]
fn run_under_nohup_survives_the_hangup() {
    let mut command = limited_by("trap '' HUP");
    command.args(["run", "scenarios/triangle.toml"]);
    let mut running = Phalanx::new(command).set("duration_s=2").set("expect={}").start();
    running.wait_for_event("contact");
    running.signal(Signal::HUP);
    let ended = running.finish();
    ended.exits_with(0).assert_leaves_nothing();
    ended.assert_holds(ended.number("/t_s") == 2.0, "it is whole");
}

/// Controlling end of a pseudoterminal. The terminal is closed when it is dropped.
struct Screen {
    end: File,
    /// Path of the terminal that programs open.
    path: PathBuf,
}

impl Screen {
    fn new() -> Screen {
        let end = File::options().read(true).write(true).open("/dev/ptmx").unwrap();
        let (mut number, unlock) = (0u32, 0i32);
        // SAFETY: system calls on an open descriptor, which read and write one number.
        let is_unlocked = unsafe {
            libc::ioctl(end.as_raw_fd(), libc::TIOCSPTLCK, &unlock) == 0
                && libc::ioctl(end.as_raw_fd(), libc::TIOCGPTN, &mut number) == 0
        };
        assert!(is_unlocked, "{}", std::io::Error::last_os_error());
        Screen { end, path: format!("/dev/pts/{number}").into() }
    }
}

/// Starts a run on the terminal, with a progress bar and without the warning about a missing one.
fn run_on(screen: &Screen, outputs: &str) -> RunInProgress {
    let path = screen.path.display();
    let script = format!("exec <>{path} {outputs} && exec \"$0\" \"$@\"");
    // A new session, so that this terminal becomes its controlling terminal.
    let mut command = Command::new("setsid");
    command.args(["sh", "-c", &script, env!("CARGO_BIN_EXE_phalanx")]);
    command.args(["run", "scenarios/triangle.toml"]);
    Phalanx::new(command).set("duration_s=3600").start()
}

#[test]
fn paused_terminal_does_not_block_a_run() {
    let mut screen = Screen::new();
    let mut running = run_on(&screen, "2>&0");
    running.wait_for_event("contact");
    // Ctrl-S.
    screen.end.write_all(&[0x13]).unwrap();
    restarts_and_ends(running);
}

#[test]
fn closed_terminal_stops_the_run_and_writes_its_results() {
    if hangups_are_ignored() {
        return;
    }
    let screen = Screen::new();
    let mut running = run_on(&screen, ">&0 2>&0");
    running.wait_for_event("contact");
    drop(screen);
    let ended = running.finish();
    ended.exits_with(130).assert_leaves_nothing();
    ended.assert_holds(ended.summary["interrupted"] == true, "the summary says so");
}

#[test]
fn help_that_cannot_be_printed_is_an_error() {
    for option in ["--help", "--version"] {
        let printed = limited_by("exec >/dev/full").arg(option).output().unwrap();
        let stderr = String::from_utf8_lossy(&printed.stderr);
        assert_eq!(printed.status.code(), Some(4), "{option}: {stderr}");
        assert!(stderr.contains("cannot write to stdout"), "{option}: {stderr}");
    }
}

#[test]
fn unknown_log_level_is_named() {
    for (level, is_named) in [("loud", true), ("debug", false), ("", false)] {
        let mut check = limited_by("true");
        let printed = check.env("PHALANX_LOG", level).args(["check", "scenarios/triangle.toml"]);
        let printed = printed.output().unwrap();
        let stderr = String::from_utf8_lossy(&printed.stderr);
        let named = stderr.contains("PHALANX_LOG is \"loud\"; must be error, warn");
        assert!(printed.status.success() && named == is_named, "{level:?}: {stderr}");
    }
}
