//! Laws and controllers in Python, with the installed package: `tests/python/install` installs it into target/python. A
//! law in Python moves a robot like the built-in one, and a hostile law affects no other robot.

mod algorithms;
mod env;
mod examples;
mod hunt;
mod plant;
mod runs;
mod sensing;
mod sweep;

use std::path::{Path, PathBuf};
use std::process::Command;

use rustix::process::Signal;

use crate::external_laws::{Pentagon, assert_keeps_distance, stderr_contains};
use crate::harness::{ExitsWith as _, FinishedRun, RunInProgress};

const ROOT: &str = env!("CARGO_MANIFEST_DIR");

/// Returns the path of a law in `tests/python/laws`.
fn law(name: &str) -> PathBuf {
    Path::new(ROOT).join("tests/python/laws").join(name).with_extension("py")
}

/// Returns PATH with the virtual environment of the package in front.
fn path() -> String {
    let programs = Path::new(ROOT).join("target/python/bin");
    assert!(programs.join("phalanx").exists(), "run tests/python/install first");
    format!("{}:{}", programs.display(), std::env::var("PATH").unwrap())
}

/// Returns a command of the `phalanx` that the package has installed.
fn installed() -> Command {
    let mut command = Command::new(Path::new(ROOT).join("target/python/bin/phalanx"));
    command.env("PATH", path());
    command
}

/// Returns the path of a program in the virtual environment of the package.
fn python(arguments: &[&str]) -> Command {
    let mut command = Command::new("python3");
    command.args(arguments).env("PATH", path());
    command
}

/// Creates the pentagon with the law `mine` in `mine.py`, a copy of a law of the tests, for the installed `phalanx`.
fn pentagon(file: &str, more: &str) -> Pentagon {
    with_gain(file, "mine", "k_f_m_s", &format!("correction_max = \"k_f_m_s\"\n{more}"))
}

fn with_gain(file: &str, name: &str, gain: &str, more: &str) -> Pentagon {
    let folder = tempfile::tempdir().unwrap();
    std::fs::copy(law(file), folder.path().join(format!("{name}.py"))).unwrap();
    std::fs::copy(law("leader"), folder.path().join("leader.py")).unwrap();
    let laws = format!(
        "\n[laws.mine]\nprogram = [\"python3\", \"{name}.py\"]\nrole = \"formation\"\n\
         gains = [\"{gain}\"]\nfeed_forward = true\n{more}\n\
         [laws.ahead]\nprogram = [\"python3\", \"leader.py\"]\nrole = \"leader\"\n\
         gains = [\"k_m_m_s\"]\nfeed_forward = true\ncorrection_max = \"k_m_m_s\"\n"
    );
    Pentagon::write(folder.path(), &laws);
    let by_hand = |folder: &Path, arguments: &[&Path]| {
        let mut command = Command::new("python3");
        command.arg(folder.join("mine.py")).args(arguments).env("PATH", path());
        command
    };
    Pentagon { folder, phalanx: installed, by_hand }
}

fn tanh() -> Pentagon {
    pentagon("tanh", "")
}

/// Creates the pentagon with a law that is hostile from 1 s on; its file name is the kind of hostility.
fn hostile_pentagon(name: &str, more: &str) -> Pentagon {
    with_gain("hostile", name, "k_f_m_s", &format!("correction_max = \"k_f_m_s\"\n{more}"))
}

/// Checks that a lockstep run with a hostile r3 exits with `code` and prints all of `parts`.
#[track_caller]
fn assert_run_ends(name: &str, more: &str, set: &[&str], code: i32, parts: &[&str]) -> FinishedRun {
    let pentagon = hostile_pentagon(name, more);
    let run = pentagon.with_r3().lockstep().set("duration_s=2");
    let ended = set.iter().fold(run, |run, set| run.set(set)).finish();
    ended.exits_with(code).assert_leaves_nothing();
    assert_keeps_distance(&ended);
    parts.iter().for_each(|part| stderr_contains(&ended, part));
    ended
}

#[test]
#[ignore = "needs the package that tests/python/install installs"]
fn auditwheel_accepts_the_wheel_for_equal_or_newer_systems() {
    let wheels = std::fs::read_dir(Path::new(ROOT).join("target/python/wheels")).unwrap();
    let [wheel] = &wheels.map(|entry| entry.unwrap().path()).collect::<Vec<_>>()[..] else {
        panic!("one wheel")
    };
    assert!(wheel.to_string_lossy().ends_with("-cp310-abi3-linux_x86_64.whl"), "{wheel:?}");
    let mut audit = python(&["-m", "auditwheel", "show", wheel.to_str().unwrap()]);
    let output = audit.exits_with(0).stdout;
    let output = output.split_whitespace().collect::<Vec<_>>().join(" ");
    // Only libraries that every Linux with this glibc has.
    let tag = "is consistent with the following platform tag: \"manylinux_2_";
    assert!(output.contains(tag), "{output}");
}

#[test]
#[ignore = "needs the package that tests/python/install installs"]
fn package_and_program_have_the_workspace_version() {
    let mut command = python(&["-c", "import phalanx; print(phalanx.__version__)"]);
    let version = env!("CARGO_PKG_VERSION");
    assert_eq!(command.exits_with(0).stdout.trim(), version);
    let output = installed().arg("--version").exits_with(0).stdout;
    assert_eq!(output.trim(), format!("phalanx {version}"));
    let manifest =
        std::fs::read_to_string(Path::new(ROOT).join("bindings/python/Cargo.toml")).unwrap();
    let manifest: toml::Table = manifest.parse().unwrap();
    assert_eq!(manifest["package"]["version"].as_str(), Some(version));
}

#[test]
#[ignore = "needs the package that tests/python/install installs"]
fn python_law_equals_built_in_law_bit_for_bit_in_ten_runs() {
    tanh().assert_moves_as_built_in(10, "duration_s=4", None);
}

/// Returns two wrappers, one of the tests and one of another package, as arguments of `program`.
fn wrappers(pentagon: &Pentagon) -> Vec<String> {
    let shell = |name: &str, text: &str| {
        let path = pentagon.folder.path().join(name);
        crate::harness::write_script(&path, text);
        format!("laws.mine.program=[\"./{name}\"]\nlaws.mine.files=[\"mine.py\"]")
    };
    let python = Path::new(ROOT).join("target/python/bin/python3");
    vec![
        format!(
            "laws.mine.program=[\"uv\", \"run\", \"--no-project\", \"--offline\", \"--python\", \"{}\", \"mine.py\"]",
            python.display()
        ),
        shell("child.sh", "python3 mine.py \"$@\"\nexit $?\n"),
        shell("session.sh", "setsid python3 mine.py \"$@\" &\nwait $!\n"),
        shell("fork.sh", "trap '' TERM INT HUP\n(setsid python3 mine.py \"$@\" &)\nexit 0\n"),
    ]
}

/// Runs the pentagon in lockstep with this program of r3, which is killed, restarted and frozen.
fn run_with_broken_program(pentagon: &Pentagon, program: &str) -> FinishedRun {
    let run = pentagon.with_r3().sets(program.lines().filter(|line| !line.is_empty()));
    let faults = ["kill r3 @1 restart 1", "freeze r3 @3 for 0.5"];
    run.lockstep().set("duration_s=6").faults(faults).finish()
}

/// Returns how often a run is repeated: once, or as often as the environment variable PHALANX_REPETITIONS specifies.
fn repetitions() -> usize {
    std::env::var("PHALANX_REPETITIONS").map_or(1, |number| number.parse().expect("a number"))
}

#[test]
#[ignore = "needs the package that tests/python/install installs"]
fn wrapped_law_equals_bare_law_with_each_wrapper() {
    let pentagon = tanh();
    let bare = run_with_broken_program(&pentagon, "");
    bare.exits_with(0).assert_leaves_nothing();
    for program in wrappers(&pentagon) {
        for _ in 0..repetitions() {
            let ended = run_with_broken_program(&pentagon, &program);
            ended.exits_with(0).assert_leaves_nothing();
            ended.assert_holds(
                ended.hash() == bare.hash(),
                format!("{program}: as {}", bare.hash()),
            );
        }
    }
}

#[test]
#[ignore = "needs the package that tests/python/install installs"]
fn realtime_wrapped_law_returns_with_each_wrapper() {
    let pentagon = tanh();
    let programs = wrappers(&pentagon);
    for program in (0..repetitions()).flat_map(|_| &programs) {
        let run = pentagon.with_r3().sets(program.lines().filter(|line| !line.is_empty()));
        let faults = ["freeze r3 @1 for 0.5", "kill r3 @3 restart 1"];
        let mut running =
            run.args(["--pace", "realtime"]).set("duration_s=1000").faults(faults).start();
        let is_back = |run: &RunInProgress| run.events().contains(",ready,r3,incarnation 1");
        running.wait_for("return of r3", |run| is_back(run).then_some(()));
        running.signal(Signal::INT);
        let ended = running.finish();
        ended.exits_with(130).assert_leaves_nothing();
        assert_keeps_distance(&ended);
        let events = ended.file("events.csv");
        let killed = events.contains("died,r3,signal 9") && events.contains(",thaw,r3,");
        ended.assert_holds(killed, format!("{program}: it is frozen, thawed and killed"));
    }
}

#[test]
#[ignore = "needs the package that tests/python/install installs"]
fn law_arguments_are_in_its_command_line() {
    let pentagon = tanh();
    let path = pentagon.folder.path().join("mine.py");
    let text = std::fs::read_to_string(&path).unwrap();
    let parses = "import argparse\nimport phalanx\nparser = argparse.ArgumentParser()\n\
                  parser.add_argument('--model')\nprint('the model is', parser.parse_args().model)\n";
    std::fs::write(&path, parses.to_owned() + &text).unwrap();
    let program = "laws.mine.program=[\"python3\", \"mine.py\", \"--model\", \"big.pt\"]";
    let ended = pentagon.with_r3().lockstep().sets([program, "duration_s=1"]).finish();
    ended.exits_with(0).assert_leaves_nothing();
    let log = ended.file("logs/r3.jsonl");
    ended.assert_holds(log.contains("the model is big.pt"), log.clone());
}

#[test]
#[ignore = "needs the package that tests/python/install installs"]
fn import_times_on_shared_cores_are_counted_separately() {
    let pentagon = tanh();
    let path = pentagon.folder.path().join("mine.py");
    let text = std::fs::read_to_string(&path).unwrap();
    let imports = "import time\nwhile time.process_time() < 1.0:\n    pass\n";
    std::fs::write(&path, imports.to_owned() + &text).unwrap();
    for pace in ["lockstep", "realtime"] {
        // Five robots need 5 s of processor time: each 1 s, and the start of the package.
        let set =
            ["robot_defaults.law=mine", "robot.r5.law=ahead", "duration_s=2", "ready_after_s=2.5"];
        let ended = pentagon.run().args(["--pace", pace]).sets(set).finish();
        ended.exits_with(0).assert_leaves_nothing();
    }
}

#[test]
#[ignore = "needs the package that tests/python/install installs"]
fn five_python_robots_equal_five_built_in_robots() {
    let pentagon = tanh();
    let built_in = pentagon.run().lockstep().set("duration_s=12").finish();
    let all = pentagon.run().set("robot_defaults.law=mine").set("robot.r5.law=ahead");
    let all = all.lockstep().set("duration_s=12").finish();
    all.exits_with(0).assert_leaves_nothing();
    all.assert_holds(all.hash() == built_in.hash(), format!("as {}", built_in.hash()));
    let converged_s = all.number("/converged_at_s");
    all.assert_holds(converged_s < 10.0, format!("they converge: {converged_s} s"));
}

#[test]
#[ignore = "needs the package that tests/python/install installs"]
fn python_robot_restarted_in_lockstep_equals_built_in_robot() {
    tanh().assert_moves_as_built_in(1, "duration_s=14", Some("kill r3 @10 restart 2"));
}

#[test]
#[ignore = "needs the package that tests/python/install installs"]
fn python_robot_restarted_in_real_time_returns_to_its_slot() {
    tanh().assert_comes_back("duration_s=18", "kill r3 @10 restart 2");
}

#[test]
#[ignore = "needs the package that tests/python/install installs"]
fn law_exception_ends_robot_with_traceback_on_screen_and_log() {
    let parts = [
        "Hostile.gamma (raises.py:23) at t = 1.000 s raised",
        "Traceback (most recent call last):",
        "ValueError: my law is at its end",
    ];
    // The replacement raises as well, and the next one is not started before the end.
    let ended = assert_run_ends("raises", "", &[], 1, &parts);
    let log = ended.file("logs/r3.jsonl");
    ended.assert_holds(
        parts.iter().all(|part| log.contains(part)),
        format!("its log has the error: {log}"),
    );
    let events = ended.file("events.csv");
    ended.assert_holds(events.contains(",ready,r3,incarnation 1"), "it was restarted");
    let parts = [
        "failed: r3 died (exit code 1) and was not restarted (restart_policy never)",
        "ValueError: my law is at its end",
    ];
    // Like a law that is terminated by a signal.
    assert_run_ends("raises", "", &["robot_defaults.restart_policy=never"], 1, &parts);
}

#[test]
#[ignore = "needs the package that tests/python/install installs"]
fn law_with_invalid_output_or_excess_memory_is_refused() {
    let nan = "Hostile.gamma (returns_nan.py:23) at t = 1.000 s returned (nan, 0.0), expected two \
               finite numbers (x, y) in m/s";
    let memory = "Hostile.gamma (eats.py:23) at t = 1.000 s raised";
    for (name, more, parts) in [
        ("returns_nan", "", &[nan][..]),
        ("returns_a_string", "", &["returned 'north', expected two finite numbers"]),
        ("returns_bytes", "", &["returned b'ab', expected two finite numbers"]),
        ("returns_a_dict", "", &["returned {0: 0.1, 1: 0.2}, expected two finite numbers"]),
        ("returns_three", "", &["returned (0.1, 0.2, 0.3), expected two finite numbers"]),
        ("eats", "memory_max_mb = 300", &[memory, "MemoryError"]),
    ] {
        assert_run_ends(name, more, &[], 1, parts);
    }
}

#[test]
#[ignore = "needs the package that tests/python/install installs"]
fn law_that_exits_or_crashes_is_an_unplanned_death() {
    for (name, death) in [("leaves", "exit code 0"), ("crashes", "signal 11")] {
        let ended = assert_run_ends(name, "", &[], 1, &["died unexpectedly", death]);
        let events = ended.file("events.csv");
        ended.assert_holds(events.contains(&format!("died,r3,{death}")), "it is an event");
    }
}

#[test]
#[ignore = "needs the package that tests/python/install installs"]
fn endless_law_is_named_in_lockstep() {
    let parts = ["error: r3 has not answered tick 500 for 1 s", "(hung_after_s)"];
    assert_run_ends("loops", "", &["hung_after_s=1"], 4, &parts);
}

#[test]
#[ignore = "needs the package that tests/python/install installs"]
fn endless_law_in_real_time_is_skipped_and_killed_at_end() {
    let ended = hostile_pentagon("loops", "").with_r3().set("duration_s=10").finish();
    ended.exits_with(1).assert_leaves_nothing();
    assert_keeps_distance(&ended);
    stderr_contains(
        &ended,
        "failed: r3 was hung at the end: it sent no status while it ran; its log: ",
    );
    stderr_contains(&ended, "r3 did not exit on request, and was killed");
    ended.assert_holds(ended.file("events.csv").contains("lost"), "others lose it");
}

#[test]
#[ignore = "needs the package that tests/python/install installs"]
fn sleeping_law_is_late_and_not_hung() {
    let ended = hostile_pentagon("sleeps", "").with_r3().set("duration_s=4").finish();
    ended.exits_with(0).assert_leaves_nothing();
    assert_keeps_distance(&ended);
    let misses = ended.number("/deadline_misses");
    ended.assert_holds(misses >= 400.0, format!("{misses} deadlines are missed"));
    let table = ended.file("latency.csv");
    let compute = table.lines().find(|line| line.starts_with("compute,r3,")).unwrap_or_default();
    let longest_ns: f64 = compute.split(',').nth(10).and_then(|ns| ns.parse().ok()).unwrap_or(0.0);
    ended.assert_holds(longest_ns >= 1e9, format!("an answer took a second: {compute}"));
}

#[test]
#[ignore = "needs the package that tests/python/install installs"]
fn law_that_kills_siblings_ends_the_run_without_collision() {
    let ended = assert_run_ends("kills", "", &[], 4, &["error: the plant died (signal 9)"]);
    ended.assert_holds(ended.number("/t_s") >= 0.99, "the run has no earlier defect");
}

#[test]
#[ignore = "needs the package that tests/python/install installs"]
fn controller_aimed_at_others_keeps_the_minimum_distance() {
    let chase = pentagon("chase", "");
    for pace in ["lockstep", "realtime"] {
        let all = chase.run().set("robot_defaults.law=mine").args(["--pace", pace]);
        let ended = all.set("duration_s=8").finish();
        ended.exits_with(0).assert_leaves_nothing();
        assert_keeps_distance(&ended);
        let nearest_m = ended.number("/min_distance_m");
        ended.assert_holds(nearest_m < 0.4, format!("they went for each other: {nearest_m}"));
    }
}

#[test]
#[ignore = "needs the package that tests/python/install installs"]
fn controller_keeps_its_slot_among_robots_with_laws() {
    with_gain("place", "mine", "k_per_s", "").assert_keeps_its_place();
}

#[test]
#[ignore = "needs the package that tests/python/install installs"]
fn program_that_cannot_serve_reports_the_reason() {
    let parts = ["cannot make the law Place(k_f_m_s=3): ", "unexpected keyword argument 'k_f_m_s'"];
    pentagon("place", "").assert_cannot_start(&[], &parts);

    let without = tanh();
    let bare = without.folder.path().join("bare");
    python(&["-m", "venv", "--without-pip", bare.to_str().unwrap()]).exits_with(0);
    let program = format!("laws.mine.program=[\"{}/bin/python3\", \"mine.py\"]", bare.display());
    let parts =
        ["ModuleNotFoundError: No module named 'phalanx'", "activate the virtual environment"];
    without.assert_cannot_start(&[&program], &parts);

    let nothing = tanh();
    std::fs::write(nothing.folder.path().join("mine.py"), "import phalanx\n").unwrap();
    let expected = "r3 died (exit code 0, before it was ready) and is not restarted";
    nothing.assert_cannot_start(&[], &[expected]);
}

#[test]
#[ignore = "needs the package that tests/python/install installs"]
fn supervisor_of_another_version_gives_one_diagnostic() {
    tanh().assert_version_mismatch("", 1);
}

#[test]
#[ignore = "needs Python, as tests/python/install does"]
fn package_build_names_its_wait_and_how_to_shorten_it() {
    // Without maturin, so that nothing is built or copied.
    let program = "import shutil, subprocess, sys, types\n\
         names = 'get_requires_for_build_editable get_requires_for_build_sdist get_requires_for_build_wheel '\n\
         names += 'prepare_metadata_for_build_editable prepare_metadata_for_build_wheel'\n\
         stub = types.ModuleType('maturin')\n\
         for name in names.split(): setattr(stub, name, None)\n\
         sys.modules['maturin'] = stub\n\
         shutil.copy2 = subprocess.run = lambda *_, **__: None\n\
         sys.path.insert(0, 'bindings/python/build_backend')\n\
         import backend, os\n\
         backend._prepare({})\n\
         os.chdir('bindings/python')\n\
         backend._prepare({'program': 'src/main.rs'})\n\
         backend._prepare({'program': 'nowhere'})";
    let mut python = Command::new("python3");
    let output = python.args(["-c", program]).env_remove("PWD").output().unwrap();
    let stderr = String::from_utf8_lossy(&output.stderr);
    for expected_part in [
        // pip starts it in another folder than itself.
        &format!("packing {ROOT}/src/main.rs"),
        "--config-settings program=nowhere: there is no file ",
        "building the program `phalanx` first, unless ",
        ": minutes, the first time; `--config-settings program=target/release/phalanx` packs a program that is already built",
        "now building the package itself, which takes minutes the first time",
    ] {
        assert!(stderr.contains(expected_part), "{stderr}");
    }
    // pip hides the output of a build, which is therefore also written to the terminal.
    let line = "python3 -c \"$PROGRAM\" 2>/dev/null";
    let mut terminal = Command::new("script");
    let output = terminal.args(["-qec", line, "/dev/null"]).env("PROGRAM", program).output();
    let printed = String::from_utf8(output.unwrap().stdout).unwrap();
    assert!(printed.contains("phalanx: building the program `phalanx` first"), "{printed}");
}

#[test]
#[ignore = "needs the package that tests/python/install installs"]
fn law_started_manually_names_the_command_to_use() {
    let parts = ["mine.py does nothing by itself: a scenario runs it", "phalanx run SCENARIO"];
    tanh().assert_output_by_hand(&[], 2, &parts, usize::MAX);
    let output = python(&["-c", "import phalanx; phalanx.serve(3)"]).output().unwrap();
    let stderr = String::from_utf8_lossy(&output.stderr);
    let expected = "takes a class derived from phalanx.Law, phalanx.Controller or phalanx.Plant";
    assert!(stderr.contains(expected), "{stderr}");
}

#[test]
#[ignore = "needs the package that tests/python/install installs"]
fn package_types_match_its_stubs() {
    python(&["-m", "mypy.stubtest", "phalanx", "--ignore-disjoint-bases"]).exits_with(0);
}
