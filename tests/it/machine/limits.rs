//! Machine limits that are too low for a run: each is reported by one error line with the remedy.

use std::io::Write as _;
use std::path::{Path, PathBuf};
use std::process::Command;

use rustix::process::Signal;

use crate::harness::{ExitsWith as _, PHALANX, Phalanx, RunRoot, phalanx, run, wait_until_gone};

/// Returns the error lines of stderr. The tests expect exactly one.
fn errors(stderr: &str) -> Vec<&str> {
    stderr.lines().filter(|line| line.starts_with("error: ")).collect()
}

/// Starts a short run of three robots under a limit set by bash's `ulimit`.
fn run_under(limit: &str, pace: &str) -> Phalanx {
    // Not every `sh` supports all limits.
    let mut command = Command::new("bash");
    command.args(["-c", &format!("ulimit {limit} && exec \"$0\" \"$@\""), PHALANX]);
    command.args(["run", "scenarios/triangle.toml", "--pace", pace]);
    Phalanx::new(command).sets(["duration_s=0.2", "expect={}"])
}

#[test]
fn low_signal_queue_limit_is_reported_before_a_lockstep_run() {
    let ended = run_under("-i 0", "lockstep").finish();
    ended.exits_with(4).assert_leaves_nothing();
    let [error] = errors(&ended.stderr)[..] else { panic!("one error: {}", ended.stderr) };
    let expected = "error: 3 robots in lockstep need 4 queued signals, one for each timer, and ";
    ended.assert_holds(error.starts_with(expected) && error.contains("`ulimit -i "), expected);
    run_under("-i 0", "realtime").finish().exits_with(0).assert_leaves_nothing();
}

#[test]
fn low_address_space_limit_is_reported_before_a_run() {
    for pace in ["lockstep", "realtime"] {
        let ended = run_under("-v 30000", pace).finish();
        ended.exits_with(4).assert_leaves_nothing();
        let [error] = errors(&ended.stderr)[..] else { panic!("one error: {}", ended.stderr) };
        ended.assert_holds(
            error.contains("KiB of address space, and the limit is 30000 KiB"),
            "the limit",
        );
        let needed = error.split("`ulimit -v ").nth(1).and_then(|rest| rest.split('`').next());
        let limit = format!("-v {}", needed.expect("the remedy"));
        run_under(&limit, pace).finish().exits_with(0).assert_leaves_nothing();
    }
}

/// A control group with a memory limit. Dropping it removes it.
struct MemoryGroup(PathBuf);

impl MemoryGroup {
    /// Creates a control group with a limit of `bytes`. Returns `None` if the user may not create one.
    fn new(bytes: u64) -> Option<MemoryGroup> {
        let name = format!("phalanx-test-{}", std::process::id());
        let locations = [("memory", "memory.limit_in_bytes"), ("", "memory.max")];
        locations.into_iter().find_map(|(folder, limit)| {
            let group = MemoryGroup(Path::new("/sys/fs/cgroup").join(folder).join(&name));
            std::fs::create_dir(&group.0).ok()?;
            std::fs::write(group.0.join(limit), bytes.to_string()).ok()?;
            Some(group)
        })
    }
}

impl Drop for MemoryGroup {
    fn drop(&mut self) {
        let _ = std::fs::remove_dir(&self.0);
    }
}

#[test]
fn low_cgroup_memory_limit_is_reported_before_a_run() {
    let Some(group) = MemoryGroup::new(14_000_000) else {
        let _ = writeln!(std::io::stderr(), "skipped: no control group for memory can be made");
        return;
    };
    let script = format!("echo $$ > {}/cgroup.procs && exec \"$0\" \"$@\"", group.0.display());
    for (scenario, pace, robots) in [("triangle", "realtime", 3), ("lattice-12", "lockstep", 12)] {
        let mut command = Command::new("sh");
        let scenario = format!("scenarios/{scenario}.toml");
        command.args(["-c", &script, PHALANX, "run", &scenario, "--pace", pace]);
        let ended = Phalanx::new(command).set("duration_s=1").set("expect={}").finish();
        ended.exits_with(4).assert_leaves_nothing();
        let [error] = errors(&ended.stderr)[..] else { panic!("one error: {}", ended.stderr) };
        ended.assert_holds(
            error.starts_with(&format!("error: {robots} robots need about ")),
            "the need",
        );
        ended.assert_holds(error.contains(group.0.to_str().unwrap()), "the group with the limit");
    }
}

#[test]
fn kernel_kills_children_before_their_supervisor() {
    let score = |pid: u32| {
        let text = std::fs::read_to_string(format!("/proc/{pid}/oom_score_adj")).unwrap();
        text.trim().parse::<i32>().unwrap()
    };
    let mut running = run("triangle").set("duration_s=3600").start();
    running.wait_for_event("contact");
    let supervisor = score(running.pid());
    for (pid, name) in running.children() {
        let expected = (supervisor + 500).min(1000);
        assert_eq!(score(pid), expected, "{name}, below a supervisor with {supervisor}");
    }
    running.signal(Signal::INT);
    running.finish().exits_with(130).assert_leaves_nothing();
}

#[test]
fn phalanx_processes_are_not_reported_as_orphans() {
    let mut killed = run("triangle").set("duration_s=3600").start();
    killed.wait_for_event("contact");
    let root = killed.roots().remove(0);
    // The supervisor starts its own processes like this, and robot programs start theirs like this.
    let start = |name: &str, parent: Option<&str>| {
        let mut command = Command::new("sleep");
        command.arg(name).env("PHALANX_RUN", &root);
        command.envs(parent.map(|parent| ("PHALANX_PARENT", parent)));
        command.spawn().unwrap()
    };
    let mut own_process = start("1001", Some("1"));
    let mut of_a_program = start("1002", None);
    killed.signal(Signal::KILL);
    wait_until_gone(&killed.run_dir());
    let mut clean = phalanx(["clean"]);
    let output = clean.env("PHALANX_RUN_ROOT", killed.run_root()).exits_with(0).stdout;
    // Both processes are killed, so neither wait blocks.
    own_process.wait().unwrap();
    of_a_program.wait().unwrap();
    assert!(output.contains(&format!("`sleep` ({}) behind", of_a_program.id())), "{output}");
    assert!(!output.contains(&format!("({})", own_process.id())), "{output}");
}

#[test]
fn output_in_the_directory_of_run_roots_is_refused() {
    let run_root = RunRoot::new();
    let base = run_root.path().join(format!("phalanx-{}", rustix::process::geteuid().as_raw()));
    let link = tempfile::tempdir().unwrap();
    std::os::unix::fs::symlink(run_root.path(), link.path().join("link")).unwrap();
    for out in [base.join("mine"), link.path().join("link").join(base.file_name().unwrap())] {
        for arguments in [
            ["run", "scenarios/triangle.toml"],
            ["sweep", "scenarios/campaigns/triangle-starts.toml"],
        ] {
            let mut command = phalanx(arguments);
            command.arg("--out").arg(&out).env("PHALANX_RUN_ROOT", run_root.path());
            let error = command.exits_with(2).stderr;
            assert!(error.contains("where runs keep shared memory"), "{error}");
        }
    }
    assert!(!base.exists(), "no directory was created");
    // A directory next to the run roots is allowed.
    let mut command =
        phalanx(["run", "scenarios/triangle.toml", "--pace", "lockstep", "--no-report"]);
    command.args(["--set", "duration_s=0.1", "--set", "expect={}", "--out"]);
    command.arg(run_root.path().join("mine")).env("PHALANX_RUN_ROOT", run_root.path());
    command.exits_with(0);
}
