//! Programs of a scenario that replace the built-in agent, in any language: which of their files are copied, when they
//! are started, and the errors of programs that do not act as robots.

mod metrics;
mod wrappers;

use std::os::unix::fs::PermissionsExt as _;
use std::path::{Path, PathBuf};
use std::process::Command;

use tempfile::TempDir;

use crate::harness::{ExitsWith as _, PHALANX, Phalanx, phalanx, run_file};

/// Creates a scenario of two robots in its own folder. r2 runs `program` with the law `own`.
pub fn scenario(program: &str, more: &str) -> TempDir {
    let folder = tempfile::tempdir().unwrap();
    let text = format!(
        "name = \"own\"\nduration_s = 0.5\nperiod_s = 0.01\n\
         avoidance = {{ kind = \"guard\", distance_min_m = 0.2, speed_max_m_s = 0.3 }}\n\
         edge = [{{ from = \"r1\", to = \"r2\", offset_m = [0.5, 0.0] }}]\n\
         trajectory = {{ kind = \"still\" }}\n\
         robot = [\n\
         {{ name = \"r1\", pose = {{ x_m = -0.1, y_m = 0.0, heading_rad = 0.0 }}, law = \"leader-tanh\" }},\n\
         {{ name = \"r2\", pose = {{ x_m = 1.0, y_m = 0.0, heading_rad = 0.0 }}, law = \"own\" }},\n]\n\
         [robot_defaults]\nfront_point_m = 0.1\nk_m_m_s = 0.1\nk_own_m_s = 0.1\n\
         [laws.own]\nrole = \"formation\"\ngains = [\"k_own_m_s\"]\nprogram = {program}\n{more}"
    );
    std::fs::write(folder.path().join("own.toml"), text).unwrap();
    folder
}

pub fn script(folder: &Path, name: &str, text: &str) {
    let path = folder.join(name);
    std::fs::write(&path, format!("#!/bin/sh\n{text}\n")).unwrap();
    std::fs::set_permissions(&path, std::fs::Permissions::from_mode(0o755)).unwrap();
}

pub fn run(folder: &Path) -> Phalanx {
    run_file(&folder.join("own.toml"))
}

/// A script that records how it was started, and then executes the built-in agent with a built-in law.
pub const FOLLOWS: &str = "pwd >> \"$TRACE\"; cat /proc/$$/personality > \"$TRACE-personality\"; cat \"$0\" > /dev/null; brief=\"$1\"; shift\n\
    sed -e 's/^law = .*/law = \"formation-tanh\"/' -e 's/^k_own_m_s/k_f_m_s/' \
    -e '/^\\[program\\]/,/^$/d' \"$brief\" > \"${brief%.toml}-own.toml\"\n\
    exec \"$PHALANX\" agent \"${brief%.toml}-own.toml\" \"$@\"";

fn followed(folder: &Path, trace: &Path) -> Phalanx {
    run(folder).env("TRACE", trace).env("PHALANX", PHALANX)
}

#[test]
fn script_replaces_built_in_agent_and_runs_from_its_copy() {
    let folder = scenario("[\"./follow.sh\"]", "files = [\"data/weights.txt\"]\n");
    script(folder.path(), "follow.sh", FOLLOWS);
    std::fs::create_dir(folder.path().join("data")).unwrap();
    std::fs::write(folder.path().join("data/weights.txt"), "1 2 3\n").unwrap();
    let trace = folder.path().join("trace");
    let own_run = followed(folder.path(), &trace).lockstep().finish();
    own_run.exits_with(0).assert_leaves_nothing();
    // The same law, built in.
    let built_in_run = ["robot.r2.law=formation-tanh", "robot_defaults.k_f_m_s=0.1"];
    let built_in_run = run(folder.path()).lockstep().sets(built_in_run).finish();
    own_run.assert_holds(
        own_run.hash() == built_in_run.hash(),
        format!("the trajectory is that of {}", built_in_run.hash()),
    );

    let programs = own_run.run_dir().join("programs").canonicalize().unwrap();
    let trace_text = std::fs::read_to_string(&trace).unwrap();
    assert_eq!(Path::new(trace_text.trim()), programs, "it runs there");
    let personality = std::fs::read_to_string(folder.path().join("trace-personality")).unwrap();
    let personality = u32::from_str_radix(personality.trim(), 16).unwrap();
    let fixed = libc::ADDR_NO_RANDOMIZE as u32;
    assert_eq!(personality & fixed, 0, "its addresses are random");
    for name in ["./follow.sh", "data/weights.txt"] {
        let copy = std::fs::read(programs.join(name)).unwrap();
        assert_eq!(copy, std::fs::read(folder.path().join(name)).unwrap(), "{name}");
    }
    let manifest: serde_json::Value = serde_json::from_str(&own_run.file("manifest.json")).unwrap();
    let entries = &manifest["programs"];
    // printf '1 2 3\n' | sha256sum
    let sum = Command::new("sha256sum").arg(programs.join("data/weights.txt")).exits_with(0).stdout;
    assert_eq!(entries[0]["file"], "./follow.sh");
    assert_eq!(entries[1]["file"], "data/weights.txt");
    assert_eq!(entries[1]["sha256"].as_str(), sum.split(' ').next());
    let other_manifest: serde_json::Value =
        serde_json::from_str(&built_in_run.file("manifest.json")).unwrap();
    assert!(other_manifest["programs"].is_null(), "nothing is listed where nothing is run");
}

#[test]
fn program_starts_only_under_run_and_permitted_verify() {
    let folder = scenario("[\"./follow.sh\"]", "");
    script(folder.path(), "follow.sh", FOLLOWS);
    let trace = folder.path().join("trace");
    let scenario_file = folder.path().join("own.toml");
    phalanx(["check", scenario_file.to_str().unwrap()]).exits_with(0);
    assert!(!trace.exists(), "check starts nothing");

    let ended = followed(folder.path(), &trace).lockstep().finish();
    ended.exits_with(0);
    // The run's directory has all files that the program needs.
    std::fs::remove_file(folder.path().join("follow.sh")).unwrap();
    std::fs::remove_file(&trace).unwrap();
    let run_dir = ended.run_dir();
    let run_dir = run_dir.to_str().unwrap();
    phalanx(["report", run_dir]).exits_with(0);
    let refusal = phalanx(["verify", run_dir]).exits_with(2).stderr;
    assert!(refusal.contains("./follow.sh") && refusal.contains("--allow-programs"), "{refusal}");
    assert!(!trace.exists(), "report and verify start nothing");

    let mut verify = phalanx(["verify", run_dir, "--allow-programs"]);
    verify.env("TRACE", &trace).env("PHALANX", PHALANX).exits_with(0);
    assert!(trace.exists());
}

#[test]
fn script_replaces_built_in_plant_and_its_exit_ends_the_run() {
    let built_in = |run: Phalanx| {
        let set = ["robot.r2.law=formation-tanh", "robot_defaults.k_f_m_s=0.1"];
        run.lockstep().sets(set)
    };
    let plant = "[plant]\nprogram = [\"./world.sh\"]\nfiles = [\"data.txt\"]\n";
    let folder = scenario("[\"sh\"]", plant);
    std::fs::write(folder.path().join("data.txt"), "1 2 3\n").unwrap();
    script(folder.path(), "world.sh", "pwd > \"$TRACE\"; exec \"$PHALANX\" plant \"$@\"");
    let trace = folder.path().join("trace");
    let own_run = built_in(followed(folder.path(), &trace)).drawing().finish();
    own_run.exits_with(0).assert_leaves_nothing();
    let built_in_run = built_in(run(scenario("[\"sh\"]", "").path())).finish();
    own_run.assert_holds(
        own_run.hash() == built_in_run.hash(),
        format!("the trajectory is that of {}", built_in_run.hash()),
    );
    let programs = own_run.run_dir().join("programs").canonicalize().unwrap();
    let trace_text = std::fs::read_to_string(&trace).unwrap();
    assert_eq!(Path::new(trace_text.trim()), programs, "it runs there");
    own_run.assert_holds(own_run.file("programs/data.txt") == "1 2 3\n", "its file is copied");
    let distance_m = own_run.number("/min_distance_m");
    let expected = "no promise about distances: `./world.sh` moves the robots, and the guard is proven for another \
                plant; the smallest distance seen is";
    own_run.assert_holds(
        own_run.file("report.html").contains(expected),
        format!("{expected} {distance_m}"),
    );

    std::fs::remove_file(&trace).unwrap();
    phalanx(["check", folder.path().join("own.toml").to_str().unwrap()]).exits_with(0);
    let run_dir = own_run.run_dir();
    phalanx(["report", run_dir.to_str().unwrap()]).exits_with(0);
    let refusal = phalanx(["verify", run_dir.to_str().unwrap()]).exits_with(2).stderr;
    assert!(refusal.contains("./world.sh") && refusal.contains("--allow-programs"), "{refusal}");
    assert!(!trace.exists(), "check, report and verify start nothing");

    let killed = built_in(followed(folder.path(), &trace)).fault("kill plant @0.2").finish();
    killed.exits_with(4).assert_leaves_nothing();
    killed.assert_holds(
        killed.stderr.contains("error: the plant died (signal 9)"),
        "the death is reported",
    );
}

#[test]
fn program_never_ready_ends_the_run_with_its_last_output() {
    let folder = scenario("[\"./wait.sh\"]", "");
    script(folder.path(), "wait.sh", "echo I wait for a licence server >&2; exec sleep 1000");
    for pace in ["lockstep", "realtime"] {
        let ended = run(folder.path()).args(["--pace", pace]).set("ready_after_s=0.5").finish();
        ended.exits_with(4).assert_leaves_nothing();
        let expected = "r2 was not ready after 0.5 s (ready_after_s); the last lines of its log:\n  I wait for a licence server";
        ended.assert_holds(ended.stderr.contains(expected), expected);
    }
}

#[test]
fn program_that_cannot_be_executed_is_named() {
    let folder = scenario("[\"./nothing.sh\"]", "");
    let path = folder.path().join("nothing.sh");
    std::fs::write(&path, "#!/no/such/interpreter\n").unwrap();
    std::fs::set_permissions(&path, std::fs::Permissions::from_mode(0o755)).unwrap();
    let ended = run(folder.path()).lockstep().finish();
    ended.exits_with(4).assert_leaves_nothing();
    let is_named =
        ended.stderr.contains("cannot start") && ended.stderr.contains("nothing.sh: No such file");
    ended.assert_holds(is_named, "the program and the reason are reported");
}

#[test]
fn program_memory_is_limited_to_memory_max_mb() {
    let folder = scenario("[\"python3\", \"eat.py\"]", "memory_max_mb = 200\n");
    let eat = "import sys\ntry:\n    held = bytearray(300_000_000)\nexcept MemoryError:\n    \
               sys.exit('no room for 300 MB')\nsys.exit('there was room')\n";
    std::fs::write(folder.path().join("eat.py"), eat).unwrap();
    let ended = run(folder.path()).lockstep().finish();
    ended.exits_with(4).assert_leaves_nothing();
    ended.assert_holds(ended.stderr.contains("no room for 300 MB"), "the allocation is refused");
}

#[test]
fn program_dies_with_the_supervisor_in_any_state() {
    let folder = scenario("[\"./wait.sh\"]", "");
    let wait = "exec python3 -c 'import time; time.sleep(1000)' \"$@\"";
    script(folder.path(), "wait.sh", wait);
    let mut running = run(folder.path()).start();
    let pid = running.wait_for("the program", |run| {
        let children = run.children();
        let (pid, _) = children.iter().find(|(_, name)| name == "r2")?;
        let comm = std::fs::read_to_string(format!("/proc/{pid}/comm")).ok()?;
        comm.starts_with("python").then_some(*pid)
    });
    running.signal(rustix::process::Signal::KILL);
    let exe_link = PathBuf::from(format!("/proc/{pid}/exe"));
    let start = std::time::Instant::now();
    while exe_link.read_link().is_ok() {
        assert!(start.elapsed().as_secs() < 60, "{pid} lives on");
        std::thread::sleep(std::time::Duration::from_millis(5));
    }
}
