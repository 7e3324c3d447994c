//! Failures are reported by exit code and on the last lines, with the robot's name, the cause and the log. A program
//! that writes endlessly or leaves processes affects no other robot.

mod standstill;

use std::time::{Duration, Instant};

use rustix::process::Signal;

use crate::harness::{
    ExitsWith as _, FinishedRun, PHALANX, Phalanx, ROOT, RunInProgress, RunRoot, WAIT_TIMEOUT,
    phalanx, run, signal_pid, wait_until_gone,
};
use crate::programs::{FOLLOWS, run as run_own, scenario, script};

/// Checks that the last line of the output has this text about a process.
#[track_caller]
fn assert_last_line(ended: &FinishedRun, process: &str, how: &str) {
    let log = ended.run_dir().join(format!("logs/{process}.jsonl"));
    let line = format!("failed: {how}; its log: {}", log.display());
    let last = ended.stderr.lines().last().unwrap_or_default();
    ended.assert_holds(last == line, format!("the last line is {line:?}, not {last:?}"));
}

/// Prepares a run of two robots. r2 is a script that runs these commands before it becomes an agent.
fn with_script(before: &str) -> (tempfile::TempDir, Phalanx) {
    let folder = scenario("[\"./own.sh\"]", "");
    script(folder.path(), "own.sh", &format!("{before}\n{FOLLOWS}"));
    let run = run_own(folder.path()).env("TRACE", folder.path().join("trace"));
    (folder, run.env("PHALANX", PHALANX))
}

#[test]
fn unplanned_permanent_death_fails_run_unless_expendable() {
    for (expect, code) in [
        ("{}", 1),
        ("{ min_distance_m = 0.1 }", 1),
        ("{ alive_at_end = [\"r1\", \"r3\"] }", 0),
        ("{ alive_at_end = 2 }", 0),
    ] {
        let mut running = run("triangle")
            .lockstep()
            .sets(["period_s=0.0001", "duration_s=8", "robot_defaults.restart_policy=never"])
            .set(format!("expect={expect}"))
            .start();
        running.wait_for_event("contact");
        let r2 = running.pid_of("r2");
        signal_pid(r2, Signal::KILL);
        let ended = running.finish();
        ended.exits_with(code).assert_leaves_nothing();
        let how = "r2 died (signal 9) and was not restarted (restart_policy never)";
        assert_last_line(&ended, "r2", how);
        let missed = ended.stdout.contains("triangle, lockstep: a robot failed\n")
            && ended.stdout.contains("MISSED failed_robots")
            && ended.stdout.contains(how);
        ended.assert_holds(
            missed == (code == 1),
            format!("{expect}: the verdict is about it: {missed}"),
        );
        ended.assert_holds(ended.number("/t_s") == 8.0, "the run goes to its end");
    }
}

#[test]
fn silent_robot_in_real_time_is_reported_and_fails_the_run() {
    let folder = scenario("[\"./own.sh\"]", "");
    let [go, agent] = ["go", "agent.sh"].map(|name| folder.path().join(name));
    script(folder.path(), "agent.sh", FOLLOWS);
    // The agent, a child of the script, is stopped. The script waits: the robot is not stopped as a whole, but blocked.
    let hangs = "\"$AGENT\" \"$@\" & while [ ! -e \"$GO\" ]; do sleep 0.05; done\n\
                 kill -STOP $!; exec sleep 1000";
    script(folder.path(), "own.sh", hangs);
    let run = run_own(folder.path()).env("TRACE", folder.path().join("trace"));
    let run = run.env("PHALANX", PHALANX).env("AGENT", agent).env("GO", &go);
    let mut running = run.set("duration_s=12").start();
    running.wait_for_event("contact");
    std::fs::write(go, "").unwrap();
    running.wait_for_line(
        " WARN r2 has sent no status for 5 s while blocked; the others continue without it",
    );
    let ended = running.finish();
    ended.exits_with(1).assert_leaves_nothing();
    assert_last_line(&ended, "r2", "r2 was hung at the end: it sent no status while blocked");
}

#[test]
fn robot_stopped_for_good_in_real_time_fails_the_run() {
    let mut running = run("triangle").sets(["duration_s=3", "expect={}"]).start();
    running.wait_for_event("contact");
    let r2 = running.pid_of("r2");
    signal_pid(r2, Signal::STOP);
    running.wait_for_event("freeze");
    let ended = running.finish();
    ended.exits_with(1).assert_leaves_nothing();
    assert_last_line(&ended, "r2", "r2 was stopped by another process, and was not resumed");
}

#[test]
fn lockstep_stop_beyond_the_limit_ends_the_run_with_4() {
    for (process, subject) in [("r2", "r2"), ("plant", "the plant")] {
        let set = ["duration_s=240", "stopped_after_s=0.5", "expect={}"];
        let mut running = run("triangle").lockstep().sets(set).start();
        running.wait_for_event("contact");
        let stopped = running.pid_of(process);
        signal_pid(stopped, Signal::STOP);
        let ended = running.finish();
        ended.exits_with(4).assert_leaves_nothing();
        let ago =
            "was stopped by another process 0.5 s ago, and has not been resumed (stopped_after_s)";
        assert_last_line(&ended, process, &format!("{subject} {ago}"));
    }
}

#[test]
fn leftover_program_processes_are_killed_and_named() {
    let (_folder, run) = with_script("sleep 1000 &\nsetsid sleep 1001 &");
    let ended = run.lockstep().finish();
    ended.exits_with(0).assert_leaves_nothing();
    let prefix = " WARN r2 left the process `sleep` (";
    let leftovers: Vec<&str> =
        ended.stderr.lines().filter_map(|l| l.strip_prefix(prefix)).collect();
    ended.assert_holds(leftovers.len() == 2, format!("both are named: {leftovers:?}"));
    for line in leftovers {
        let (pid, rest) = line.split_once(')').unwrap();
        assert_eq!(rest, " behind; killed it");
        let arguments = std::fs::read_to_string(format!("/proc/{pid}/cmdline")).unwrap_or_default();
        ended
            .assert_holds(!arguments.starts_with("sleep"), format!("{pid} is gone: {arguments:?}"));
    }
}

/// Starts a run whose r2 has left three processes, one of which hides its origin. Returns the run and their ids.
fn with_three_left() -> (tempfile::TempDir, RunInProgress, Vec<u32>) {
    let leftovers = "sleep 1000 & echo $! >> \"$LEFT\"\nsetsid sleep 1001 & echo $! >> \"$LEFT\"\n\
                env -i setsid sleep 1002 & echo $! >> \"$LEFT\"";
    let (folder, run) = with_script(leftovers);
    let leftovers = folder.path().join("left");
    let mut running = run.env("LEFT", &leftovers).set("duration_s=100").start();
    running.wait_for_event("contact");
    let pids = std::fs::read_to_string(leftovers).unwrap();
    let pids: Vec<u32> = pids.lines().map(|pid| pid.parse().unwrap()).collect();
    assert_eq!(pids.len(), 3);
    (folder, running, pids)
}

/// Returns the keeper processes that a supervisor has started.
pub fn keepers_of(supervisor: u32) -> Vec<u32> {
    let children = format!("/proc/{supervisor}/task/{supervisor}/children");
    let children = std::fs::read_to_string(children).unwrap();
    let children = children.split_whitespace().map(|pid| pid.parse().unwrap());
    let is_keeper = |pid: &u32| {
        std::fs::read_to_string(format!("/proc/{pid}/comm"))
            .is_ok_and(|name| name == "phalanx-keeper\n")
    };
    children.filter(is_keeper).collect()
}

fn sleeps(pid: u32) -> bool {
    std::fs::read_to_string(format!("/proc/{pid}/cmdline")).is_ok_and(|w| w.contains("sleep"))
}

#[track_caller]
fn wait_until_none_sleeps(pids: &[u32]) {
    let start = Instant::now();
    while let Some(pid) = pids.iter().find(|&&pid| sleeps(pid)) {
        assert!(start.elapsed() < WAIT_TIMEOUT, "{pid} is left behind");
        std::thread::sleep(Duration::from_millis(5));
    }
}

#[test]
fn killed_supervisor_takes_leftover_program_processes_along() {
    let (_folder, running, pids) = with_three_left();
    assert!(pids.iter().all(|&pid| sleeps(pid)));
    running.signal(Signal::KILL);
    wait_until_none_sleeps(&pids);
    wait_until_gone(&running.run_dir());
    let log = running.run_dir().join("logs/reaper.jsonl");
    let start = Instant::now();
    let names = |text: &str, pid: &u32| {
        text.contains(&format!("r2 left the process `sleep` ({pid}) behind; killed it"))
    };
    while !pids.iter().all(|pid| names(&std::fs::read_to_string(&log).unwrap(), pid)) {
        assert!(start.elapsed() < WAIT_TIMEOUT, "{}", std::fs::read_to_string(&log).unwrap());
        std::thread::sleep(Duration::from_millis(5));
    }
    let text = std::fs::read_to_string(log).unwrap();
    assert_eq!(text.lines().count(), 3, "and no other robot: {text}");
}

#[test]
fn next_run_or_clean_ends_and_names_orphaned_leftovers() {
    for arguments in [&["run", "scenarios/triangle.toml", "--pace", "lockstep"][..], &["clean"]] {
        let (folder, mut running, pids) = with_three_left();
        let logs = running.run_dir().canonicalize().unwrap().join("logs");
        let is_reaper = |pid: &u32| {
            let line = std::fs::read_to_string(format!("/proc/{pid}/cmdline")).unwrap_or_default();
            line.starts_with("phalanx-reaper\0reap\0") && line.contains(logs.to_str().unwrap())
        };
        let processes = std::fs::read_dir("/proc").unwrap().flatten();
        let mut others = processes.filter_map(|entry| entry.file_name().to_str()?.parse().ok());
        // The supervisor must not detect it, and the keeper must not outlive it.
        running.signal(Signal::STOP);
        signal_pid(others.find(is_reaper).expect("there is one"), Signal::KILL);
        let keepers = keepers_of(running.pid());
        assert_eq!(keepers.len(), 1);
        running.signal(Signal::KILL);
        keepers.into_iter().for_each(|pid| signal_pid(pid, Signal::KILL));
        running.wait_until_ended();
        wait_until_gone(&running.run_dir());
        assert!(pids.iter().all(|&pid| sleeps(pid)));
        let mut next = phalanx(arguments);
        if arguments[0] == "run" {
            next.arg("--out").arg(folder.path().join("next"));
        }
        let output =
            next.env("PHALANX_RUN_ROOT", running.run_root()).exits_with(0).stdout_and_stderr();
        for pid in &pids[..2] {
            let named = format!("a program of the run left the process `sleep` ({pid}) behind");
            assert!(output.contains(&named), "{output}");
        }
        wait_until_none_sleeps(&pids[..2]);
        // The origin of that process is unknown by now.
        signal_pid(pids[2], Signal::KILL);
    }
}

#[test]
fn endless_program_output_is_truncated_with_a_warning() {
    let (_folder, run) = with_script("yes 'a line of a log' | head -c 68000000");
    let ended = run.lockstep().finish();
    ended.exits_with(0).assert_leaves_nothing();
    let log = ended.run_dir().join("logs/r2.jsonl");
    let expected = "logs/r2.jsonl is longer than 64 MiB; dropped its middle";
    ended.assert_holds(ended.stderr.contains(expected), expected);
    let text = std::fs::read_to_string(log).unwrap();
    ended.assert_holds(text.len() < 64 << 20, format!("it has {} bytes", text.len()));
    ended.assert_holds(
        text.contains(" bytes were dropped here: the limit of a log is 64 MiB\"}\n"),
        "it says so",
    );
    ended.assert_holds(text.starts_with("a line of a log\n"), "its beginning is there");
}

#[test]
fn long_scenario_name_is_truncated_in_the_run_directory() {
    let folder = tempfile::tempdir().unwrap();
    let root = RunRoot::new();
    let text = std::fs::read_to_string(format!("{ROOT}/scenarios/triangle.toml")).unwrap();
    let long = text.replace("\"triangle\"", &format!("\"{}\"", "ü".repeat(3000)));
    assert_ne!(text, long);
    std::fs::write(folder.path().join("long.toml"), long).unwrap();
    for arguments in [&["check"][..], &["run", "--pace", "lockstep", "--no-report"]] {
        let mut command = phalanx(arguments);
        command.arg("long.toml").current_dir(folder.path());
        command.env("PHALANX_RUN_ROOT", root.path()).exits_with(0);
    }
    let runs = std::fs::read_dir(folder.path().join("runs")).unwrap();
    let names: Vec<_> = runs.map(|run| run.unwrap().file_name().into_string().unwrap()).collect();
    assert!(
        names.len() == 1 && names[0].starts_with(&format!("{}-2", "ü".repeat(100))),
        "{names:?}"
    );
}

#[test]
fn verify_names_the_file_that_is_missing() {
    let ended = run("triangle").lockstep().sets(["duration_s=1", "expect={}"]).finish();
    ended.exits_with(0);
    for name in ["samples.csv", "pairs.csv", "events.csv", "run.mcap", "manifest.json"] {
        let [path, backup] = [name, "kept"].map(|name| ended.run_dir().join(name));
        std::fs::rename(&path, &backup).unwrap();
        let mut verify = phalanx(["verify", ended.run_dir().to_str().unwrap()]);
        let output = verify.env("PHALANX_RUN_ROOT", RunRoot::new().path()).exits_with(4).stderr;
        assert!(output.contains(&format!(": {name}: No such file")), "{output}");
        std::fs::rename(&backup, &path).unwrap();
    }
}
