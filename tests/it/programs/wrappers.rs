//! Programs behind a wrapper: faults act on all processes of a robot wherever they are, and in lockstep the robot
//! moves as the same law without a wrapper.

use std::path::Path;
use std::time::{Duration, Instant};

use rustix::process::Signal;
use tempfile::TempDir;

use crate::harness::{
    FinishedRun, PHALANX, Phalanx, RunInProgress, WAIT_TIMEOUT, map_in_parallel, processes_of,
    signal_pid,
};
use crate::programs::{run, scenario, script};

/// Shell commands that write a process configuration with the built-in law, as `programs::FOLLOWS` does.
const WRITE_BRIEF_COMMANDS: &str = "brief=\"$1\"; shift\n\
    sed -e 's/^law = .*/law = \"formation-tanh\"/' -e 's/^k_own_m_s/k_f_m_s/' \
    -e '/^\\[program\\]/,/^$/d' \"$brief\" > \"${brief%.toml}-own.toml\"\n\
    set -- agent \"${brief%.toml}-own.toml\" \"$@\"\n";

/// Named ways to start a law: without a wrapper, and by wrappers that wait for it, ignore signals, start it in another
/// session, or exit before it.
const WRAPPERS: [(&str, &str); 5] = [
    ("bare", "exec \"$PHALANX\" \"$@\""),
    ("child", "\"$PHALANX\" \"$@\"\ncode=$?; exit $code"),
    ("deaf", "trap '' TERM INT HUP USR1 USR2\n\"$PHALANX\" \"$@\" &\nwait $!; exit $?"),
    ("session", "setsid sh -c '\"$PHALANX\" \"$@\"; exit $?' sh \"$@\" &\nwait $!"),
    ("double fork", "(setsid sh -c '\"$PHALANX\" \"$@\"; exit $?' sh \"$@\" &)\nexit 0"),
];

/// Prepares a run whose r2 is started by a wrapper.
fn wrapped(wrapper: &str, more: &str) -> (TempDir, Phalanx) {
    let folder = scenario("[\"./wrap.sh\"]", more);
    script(folder.path(), "wrap.sh", &format!("{WRITE_BRIEF_COMMANDS}{wrapper}"));
    let run = run(folder.path()).env("PHALANX", PHALANX).set("duration_s=2");
    (folder, run)
}

/// Runs in lockstep while r2 is killed, restarted and frozen.
fn broken_in_lockstep(wrapper: &str) -> FinishedRun {
    let (_folder, run) = wrapped(wrapper, "");
    let faults = ["kill r2 @0.5 restart 0.3", "freeze r2 @1.2 for 0.4"];
    let ended = run.lockstep().faults(faults).finish();
    ended.exits_with(0).assert_leaves_nothing();
    ended
}

#[test]
fn lockstep_wrapped_law_equals_bare_law_for_each_wrapper() {
    let bare = broken_in_lockstep(WRAPPERS[0].1);
    for (name, wrapper) in &WRAPPERS[1..] {
        let ended = broken_in_lockstep(wrapper);
        ended.assert_holds(ended.hash() == bare.hash(), format!("{name}: as {}", bare.hash()));
        let (found, expected) = (ended.file("events.csv"), bare.file("events.csv"));
        ended.assert_holds(
            found == expected,
            format!("{name}: the same events:\n{found}\n{expected}"),
        );
    }
}

#[test]
#[ignore = "long: 20 runs of each wrapper"]
fn lockstep_wrapped_law_has_one_hash_in_20_runs() {
    let bare = broken_in_lockstep(WRAPPERS[0].1);
    for run in 0..20 {
        for (name, wrapper) in &WRAPPERS[1..] {
            let ended = broken_in_lockstep(wrapper);
            ended.assert_holds(
                ended.hash() == bare.hash(),
                format!("{name}, {run}: as {}", bare.hash()),
            );
        }
    }
}

/// Returns the processes of r2 that run the law or its wrapper.
fn processes_of_r2(run: &RunInProgress) -> Vec<u32> {
    let all = processes_of(&run.run_dir()).into_iter();
    all.filter(|(_, name)| name.starts_with("r2")).map(|(pid, _)| pid).collect()
}

/// Returns whether a process can run: it is neither dead nor stopped.
fn may_run(pid: u32) -> bool {
    let stat = std::fs::read_to_string(format!("/proc/{pid}/stat")).unwrap_or_default();
    let state = stat.rsplit(')').next().and_then(|rest| rest.trim_start().chars().next());
    state.is_some_and(|state| !"TtZX".contains(state))
}

#[test]
fn real_time_death_event_follows_death_of_all_processes() {
    map_in_parallel(&WRAPPERS, |(name, wrapper)| {
        let (_folder, run) = wrapped(wrapper, "");
        let mut running = run.set("duration_s=1000").fault("kill r2 @4").start();
        running.wait_for_event("contact");
        let before = processes_of_r2(&running);
        assert!(!before.is_empty(), "{name}");
        running.wait_for_event("died");
        let left: Vec<u32> = before.into_iter().filter(|&pid| may_run(pid)).collect();
        assert!(left.is_empty() && processes_of_r2(&running).is_empty(), "{name}: {left:?}");
        running.signal(Signal::INT);
        let ended = running.finish();
        ended.exits_with(130).assert_leaves_nothing();
        let died = ended.file("events.csv").contains("died,r2,signal 9");
        ended.assert_holds(died, format!("{name}: by the kill"));
    });
}

#[test]
fn real_time_freeze_stops_all_processes_and_thaw_resumes_them() {
    map_in_parallel(&WRAPPERS, |(name, wrapper)| {
        let (_folder, run) = wrapped(wrapper, "");
        let mut running = run.set("duration_s=1000").fault("freeze r2 @1 for 4").start();
        running.wait_for_event("freeze");
        let frozen = processes_of_r2(&running);
        let run: Vec<u32> = frozen.iter().copied().filter(|&pid| may_run(pid)).collect();
        assert!(!frozen.is_empty() && run.is_empty(), "{name}: {run:?} of {frozen:?}");
        running.wait_for_event("thaw");
        let start = Instant::now();
        while frozen.iter().any(|&pid| !may_run(pid)) {
            assert!(start.elapsed() < WAIT_TIMEOUT, "{name}: they stand");
            std::thread::sleep(Duration::from_millis(2));
        }
        running.signal(Signal::INT);
        running.finish().exits_with(130).assert_leaves_nothing();
    });
}

#[test]
fn robot_with_killed_keeper_dies_with_all_its_processes() {
    let (_folder, run) = wrapped(WRAPPERS[4].1, "");
    let never = "robot_defaults.restart_policy=never";
    let mut running = run.set("duration_s=1000").set(never).start();
    running.wait_for_event("contact");
    let before = processes_of_r2(&running);
    let keepers = crate::failures::keepers_of(running.pid());
    assert_eq!(keepers.len(), 1);
    signal_pid(keepers[0], Signal::KILL);
    running.wait_for_event("died");
    assert!(!before.is_empty() && !before.iter().any(|&pid| may_run(pid)), "{before:?}");
    running.signal(Signal::INT);
    running.finish().exits_with(130).assert_leaves_nothing();
}

#[test]
fn killed_supervisor_takes_wrapped_robot_processes_along() {
    map_in_parallel(&WRAPPERS, |(name, wrapper)| {
        let (_folder, run) = wrapped(wrapper, "");
        let mut running = run.set("duration_s=100").start();
        running.wait_for_event("contact");
        let before = processes_of_r2(&running);
        running.signal(Signal::KILL);
        let start = Instant::now();
        while before.iter().any(|&pid| may_run(pid)) {
            assert!(start.elapsed() < WAIT_TIMEOUT, "{name}: {before:?}");
            std::thread::sleep(Duration::from_millis(2));
        }
    });
}

#[test]
fn total_memory_of_a_robots_processes_is_limited() {
    let eats = "for i in 1 2 3 4; do\n\
        python3 -c 'import time; held = b\"x\" * 60_000_000; time.sleep(1000)' &\ndone\n\
        \"$PHALANX\" \"$@\"\nexit $?";
    let (_folder, run) = wrapped(eats, "memory_max_mb = 150\n");
    let never = "robot_defaults.restart_policy=never";
    let mut running = run.sets(["duration_s=1000", never]).start();
    running.wait_for_event("died");
    running.signal(Signal::INT);
    let ended = running.finish();
    ended.exits_with(130).assert_leaves_nothing();
    let expected = "MB together, above the limit of 150 MB (memory_max_mb); killing them";
    ended.assert_holds(ended.stderr.contains(expected), expected);
}

#[test]
fn processor_time_includes_all_processes_of_a_robot() {
    let spins = "python3 -c 'import time\nwhile time.process_time() < 0.5: pass'\n\
        \"$PHALANX\" \"$@\"\nexit $?";
    let (_folder, run) = wrapped(spins, "");
    let ended = run.lockstep().finish();
    ended.exits_with(0).assert_leaves_nothing();
    let processes = ended.summary["wall"]["processes"].as_array().unwrap();
    let r2 = processes.iter().find(|process| process["name"] == "r2");
    let user_s = r2.and_then(|r2| r2["user_s"].as_f64()).unwrap_or(0.0);
    let system_s = r2.and_then(|r2| r2["system_s"].as_f64()).unwrap_or(0.0);
    ended.assert_holds(
        user_s + system_s >= 0.5,
        format!("r2 took {user_s} s and {system_s} s: {r2:?}"),
    );
}

#[test]
fn robot_exit_status_is_that_of_the_wrapped_law() {
    let never = ["robot_defaults.restart_policy=never", "duration_s=1"];
    for (script, how) in [
        ("(sleep 0.01; exit 7) ; exit $?", "exit code 7"),
        ("sh -c 'kill -SEGV $$'; exit $?", "exit code 139"),
        ("kill -ABRT $$", "signal 6"),
    ] {
        let (_folder, run) = wrapped(script, "");
        let ended = run.lockstep().sets(never).finish();
        ended.exits_with(4).assert_leaves_nothing();
        let expected = format!("r2 died ({how}, before it was ready) and is not restarted");
        ended.assert_holds(ended.stderr.contains(&expected), expected);
    }
}

#[test]
fn commands_of_a_dead_incarnation_are_ignored() {
    let set = ["duration_s=5", "expect={}"];
    let mut running = crate::harness::run("triangle").sets(set).fault("kill r2 @0.5").start();
    running.wait_for_event("died");
    // A process that escaped the kill.
    let mut hidden = std::process::Command::new(PHALANX);
    hidden.arg("agent").arg(running.run_dir().join("briefs/r2.toml"));
    hidden.env("PHALANX_LOG", "info").stderr(std::process::Stdio::piped());
    let hidden = hidden.spawn().unwrap();
    let pid = hidden.id();
    let ended = running.finish();
    signal_pid(pid, Signal::KILL);
    let stderr = hidden.wait_with_output().unwrap().stderr;
    let stderr = String::from_utf8_lossy(&stderr);
    ended.exits_with(0);
    ended.assert_holds(stderr.contains("ready"), format!("it has taken part: {stderr}"));
    let samples = ended.file("samples.csv");
    let header: Vec<&str> = samples.lines().next().unwrap_or_default().split(',').collect();
    let column = |name: &str| header.iter().position(|other| *other == name).expect(name);
    let [t, robot, x, y] = ["t_s", "robot", "x_m", "y_m"].map(column);
    let rows = samples.lines().skip(1).map(|line| line.split(',').collect::<Vec<_>>());
    let late = |row: &Vec<&str>| row[robot] == "r2" && row[t].parse::<f64>().unwrap() > 1.5;
    let positions: std::collections::BTreeSet<String> =
        rows.filter(late).map(|row| format!("{} {}", row[x], row[y])).collect();
    ended.assert_holds(positions.len() == 1, format!("r2 stands: {positions:?}"));
}

/// Arguments that run a command under a seccomp filter by which the kernel refuses SIGKILL and SIGSTOP, as it does for
/// a program of another user. The filter blocks only the supervisor's system call for them, pidfd_send_signal.
const SECCOMP_PROGRAM: &str = "import ctypes, os, struct, sys\n\
    nr = 424\n\
    ops = [(0x20, 0, 0, 0), (0x15, 0, 4, nr), (0x20, 0, 0, 24), (0x15, 1, 0, 9), (0x15, 0, 1, 19),\n\
           (0x06, 0, 0, 0x00050001), (0x06, 0, 0, 0x7fff0000)]\n\
    code = ctypes.create_string_buffer(b''.join(struct.pack('HBBI', *op) for op in ops))\n\
    class Program(ctypes.Structure):\n\
    \x20   _fields_ = [('len', ctypes.c_ushort), ('filter', ctypes.c_void_p)]\n\
    program = Program(len(ops), ctypes.cast(code, ctypes.c_void_p))\n\
    libc = ctypes.CDLL(None, use_errno=True)\n\
    assert libc.prctl(38, 1, 0, 0, 0) == 0 and libc.prctl(22, 2, ctypes.byref(program)) == 0\n\
    os.execvp(sys.argv[1], sys.argv[1:])";

#[test]
fn undeliverable_kill_or_freeze_ends_the_run_with_the_reason() {
    for (fault, done, signal) in
        [("kill r2 @0.5", "killed", "SIGKILL"), ("freeze r2 @0.5 for 0.2", "frozen", "SIGSTOP")]
    {
        for pace in ["lockstep", "realtime"] {
            let mut command = std::process::Command::new("python3");
            command.args([
                "-c",
                SECCOMP_PROGRAM,
                PHALANX,
                "run",
                "scenarios/triangle.toml",
                "--pace",
                pace,
            ]);
            let ended = Phalanx::new(command).fault(fault).finish();
            ended.exits_with(4);
            let expected = format!("r2 could not be {done}: {signal} was not sent to its process");
            ended.assert_holds(ended.stderr.contains(&expected), expected);
            crate::harness::wait_until_gone(&ended.run_dir());
        }
    }
}

/// Returns whether a run has a copy of a file.
fn is_copied(ended: &FinishedRun, name: &str) -> bool {
    Path::new(&ended.run_dir()).join("programs").join(name).is_file()
}

#[test]
fn own_arguments_and_folders_reach_the_program() {
    let folder = scenario(
        "[\"./args.sh\", \"--model\", \"big.pt\", \"--rate\", \"3\"]",
        "files = [\"mylaws\"]\n",
    );
    let args = "echo \"$1 $(basename $2) $3 $4\" > \"$SAID\"; cat mylaws/deep/gains.txt >> \"$SAID\"; shift 4";
    let wrap = format!("{args}\n{WRITE_BRIEF_COMMANDS}exec \"$PHALANX\" \"$@\"");
    script(folder.path(), "args.sh", &wrap);
    std::fs::create_dir_all(folder.path().join("mylaws/deep")).unwrap();
    std::fs::write(folder.path().join("mylaws/deep/gains.txt"), "0.1").unwrap();
    std::fs::write(folder.path().join("big.pt"), "").unwrap();
    let arguments_file = folder.path().join("said");
    let ended =
        run(folder.path()).env("PHALANX", PHALANX).env("SAID", &arguments_file).lockstep().finish();
    ended.exits_with(0).assert_leaves_nothing();
    assert_eq!(std::fs::read_to_string(arguments_file).unwrap(), "--model big.pt --rate 3\n0.1");
    ended.assert_holds(
        is_copied(&ended, "mylaws/deep/gains.txt") && is_copied(&ended, "big.pt"),
        "copied",
    );
}
