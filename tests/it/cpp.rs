//! Laws in C and C++, built by the system's compiler against `bindings/c/include/phalanx.h` and the library of
//! `bindings/c/`. `tests/cpp/install` installs the packages for it. A law in C++ moves a robot like the built-in one.

use std::path::{Path, PathBuf};
use std::process::Command;

use crate::external_laws::{Pentagon, assert_keeps_distance, stderr_contains};
use crate::harness::ExitsWith as _;

const ROOT: &str = env!("CARGO_MANIFEST_DIR");

/// Returns the folder of the library that cargo has built, which is that of this test.
pub fn library() -> PathBuf {
    let folder = std::env::current_exe().unwrap().parent().unwrap().to_owned();
    assert!(folder.join("libphalanx_agent.so").exists(), "{}", folder.display());
    folder
}

/// Builds `source` as `program` with the commands of the page `docs/how-to/cpp.md`, and warnings as errors.
fn build(source: &str, program: &Path, more: &[&str]) {
    let (source, library) = (Path::new(ROOT).join(source), library());
    let c = source.extension().is_some_and(|ending| ending == "c");
    let (compiler, standard) = if c { ("cc", "-std=c11") } else { ("g++", "-std=c++17") };
    Command::new(compiler)
        .args([standard, "-O2", "-ffp-contract=off", "-Wall", "-Wextra", "-Wpedantic", "-Werror"])
        .args(more)
        .args(["-I", &format!("{ROOT}/bindings/c/include")])
        .arg(&source)
        .arg("-o")
        .arg(program)
        .arg(format!("-L{}", library.display()))
        .arg(format!("-Wl,-rpath,{}", library.display()))
        .args(["-lphalanx_agent", "-lm"])
        .exits_with(0);
}

/// Creates the pentagon with a program of the law `mine`, built from `source`.
fn pentagon(source: &str, more: &[&str], gain: &str) -> Pentagon {
    let folder = tempfile::tempdir().unwrap();
    build(source, &folder.path().join("mine"), more);
    let law = format!(
        "\n[laws.mine]\nprogram = [\"./mine\"]\nrole = \"formation\"\ngains = [\"{gain}\"]\n\
         feed_forward = true\n"
    );
    Pentagon::write(folder.path(), &law);
    let phalanx = || Command::new(env!("CARGO_BIN_EXE_phalanx"));
    let by_hand = |folder: &Path, arguments: &[&Path]| {
        let mut command = Command::new(folder.join("mine"));
        command.args(arguments);
        command
    };
    Pentagon { folder, phalanx, by_hand }
}

fn tanh() -> Pentagon {
    pentagon("bindings/c/examples/tanh.cpp", &[], "k_f_m_s")
}

#[test]
#[ignore = "needs what tests/cpp/install installs"]
fn cpp_law_moves_bit_for_bit_like_the_built_in_law() {
    tanh().assert_moves_as_built_in(1, "duration_s=4", None);
}

#[test]
#[ignore = "needs what tests/cpp/install installs"]
fn cpp_robot_restarted_in_lockstep_moves_like_built_in_robot() {
    tanh().assert_moves_as_built_in(1, "duration_s=8", Some("kill r3 @4 restart 2"));
}

#[test]
#[ignore = "needs what tests/cpp/install installs"]
fn cpp_robot_restarted_in_real_time_returns_to_its_slot() {
    tanh().assert_comes_back("duration_s=8", "kill r3 @3 restart 1");
}

#[test]
#[ignore = "needs what tests/cpp/install installs"]
fn c_controller_holds_its_slot_and_sees_agent_inputs() {
    pentagon("tests/cpp/laws/place.c", &[], "k_per_s").assert_keeps_its_place();
}

#[test]
#[ignore = "needs what tests/cpp/install installs"]
fn failing_cpp_law_ends_only_its_robot_with_the_reason() {
    let numbers = "expected two finite numbers (x, y) in m/s";
    let returned = "the law \"mine\": gamma at t = 1.000 s returned";
    let cases = [
        ("returns_a_code", "-UOBJECT", format!("{returned} 7, expected 0"), "exit code 1"),
        ("returns_nan", "-UOBJECT", format!("{returned} (NaN, 0.5), {numbers}"), "exit code 1"),
        ("answers_nothing", "-UOBJECT", format!("{returned} (NaN, NaN), {numbers}"), "exit code 1"),
        ("throws", "-UOBJECT", "in a function that cannot unwind".to_owned(), "signal 6"),
        (
            "throws",
            "-DOBJECT",
            "threw an exception: my law is at its end".to_owned(),
            "exit code 1",
        ),
    ];
    for (fails_by, more, reason, death) in cases {
        let fails_by = format!("-DFAILS_BY={fails_by}");
        let fails = pentagon("tests/cpp/laws/fails.cpp", &[&fails_by, more], "k_f_m_s");
        let ended = fails.with_r3().lockstep().set("duration_s=2").finish();
        ended.exits_with(1).assert_leaves_nothing();
        assert_keeps_distance(&ended);
        stderr_contains(&ended, "died unexpectedly");
        let log = ended.file("logs/r3.jsonl").replace("\\\"", "\"");
        ended.assert_holds(log.contains(&reason), format!("its log says {reason:?}: {log}"));
        let events = ended.file("events.csv");
        ended.assert_holds(
            events.contains(&format!("died,r3,{death}")),
            format!("{death}: {events}"),
        );
    }
}

/// Three robots in a row with the law of `messages.c`, each of which receives from the other two.
const MESSAGES: &str = r#"
name = "messages"
duration_s = 10.0
period_s = 0.01

[avoidance]
distance_min_m = 0.2
speed_max_m_s = 0.5

[laws.mine]
program = ["./mine"]
role = "free"
gains = ["k_per_s", "start_m"]
message = { n = 1, x_m = 2 }
signals = ["x_m"]

[metrics.x_m]
signal = "x_m"

[robot_defaults]
front_point_m = 0.1
law = "mine"
k_per_s = 1.0
restart_policy = "never"

[[robot]]
name = "r1"
hears = ["r2", "r3"]
start_m = 1.0
pose = { x_m = 0.9, y_m = 0.0, heading_rad = 0.0 }

[[robot]]
name = "r2"
hears = ["r1", "r3"]
start_m = 2.0
pose = { x_m = 1.9, y_m = 1.0, heading_rad = 0.0 }

[[robot]]
name = "r3"
hears = ["r1", "r2"]
start_m = 6.0
pose = { x_m = 5.9, y_m = 2.0, heading_rad = 0.0 }
"#;

/// Runs [`MESSAGES`] in lockstep with the law built with these flags.
fn messages(more: &[&str]) -> crate::harness::FinishedRun {
    let folder = tempfile::tempdir().unwrap();
    build("tests/cpp/laws/messages.c", &folder.path().join("mine"), more);
    let scenario = folder.path().join("messages.toml");
    std::fs::write(&scenario, MESSAGES).unwrap();
    let mut command = Command::new(env!("CARGO_BIN_EXE_phalanx"));
    command.arg("run").arg(&scenario);
    crate::harness::Phalanx::new(command).lockstep().finish()
}

#[test]
#[ignore = "needs what tests/cpp/install installs"]
fn messages_targets_and_signals_of_c_laws_reach_the_results() {
    let [first, second] = [(); 2].map(|()| messages(&[]));
    first.exits_with(0).assert_leaves_nothing();
    let hash = |ended: &crate::harness::FinishedRun| ended.summary["message_hash"].clone();
    first.assert_holds(
        hash(&first) == hash(&second) && first.hash() == second.hash(),
        "the same twice",
    );
    first.assert_holds(first.number("/messages_sent/r1") == 1000.0, "a message at each tick");
    let x_m = first.number("/metrics/x_m");
    first.assert_holds(
        (x_m - 3.0).abs() < 1e-6,
        format!("they agree on the mean of their starts: {x_m}"),
    );
    let error_m = first.number("/final_error_m_max");
    first.assert_holds(error_m < 0.01, format!("and go there: {error_m} m"));
}

#[test]
#[ignore = "needs what tests/cpp/install installs"]
fn wrong_messages_of_c_laws_end_the_robot_with_the_reason() {
    for (wrong, reason) in [
        ("phalanx_publish(seen, \"price\", law->estimate, 1)", "`price`, which is not declared"),
        ("return phalanx_publish(seen, \"n\", law->estimate, 1), 0", "the message has no `x_m`"),
        (
            "return phalanx_publish(seen, \"n\", law->estimate, 2), phalanx_publish(seen, \"x_m\", law->estimate, 2), 0",
            "`n` has 2 numbers, expected 1",
        ),
        ("law->estimate[1] = NAN", "the message has NaN in `x_m`"),
        (
            "phalanx_publish_bytes(seen, (const uint8_t *)\"a\", 1)",
            "expected arrays: { n = 1, x_m = 2 }",
        ),
        ("phalanx_withhold(seen)", "does not declare that"),
        ("phalanx_record(seen, \"cost\", 1.0)", "`cost`, expected one of"),
    ] {
        let ended = messages(&[&format!("-DWRONG={wrong}")]);
        ended.exits_with(1).assert_leaves_nothing();
        let log = ended.file("logs/r1.jsonl");
        ended
            .assert_holds(log.contains(reason), format!("{wrong}: its log says {reason:?}: {log}"));
    }
}

#[test]
#[ignore = "needs what tests/cpp/install installs"]
fn cpp_program_that_cannot_serve_prints_the_reason() {
    let cases = [
        (&[][..], "the law \"mine\" has no gain \"k_f\"; its gains: k_f_m_s", "exit code 1"),
        (&["-DSERVES_NONE"], "the law \"mine\" is NULL", "exit code 4"),
    ];
    for (more, reason, death) in cases {
        let wrong = pentagon("tests/cpp/laws/wrong.cpp", more, "k_f_m_s");
        wrong.assert_cannot_start(&[], &[reason, death]);
    }
}

#[test]
#[ignore = "needs what tests/cpp/install installs"]
fn cpp_program_started_manually_names_its_starter() {
    let parts = ["error: ", "<BRIEF>", "`phalanx run SCENARIO` starts it"];
    tanh().assert_output_by_hand(&[], 2, &parts, usize::MAX);
}

#[test]
#[ignore = "needs what tests/cpp/install installs"]
fn cpp_program_of_another_version_is_refused() {
    tanh().assert_version_mismatch("but its libphalanx_agent", usize::MAX);
}

#[test]
#[ignore = "needs what tests/cpp/install installs"]
fn c_header_equals_the_output_of_cbindgen() {
    let generated = Command::new("cbindgen")
        .args(["--quiet", "--config", "bindings/c/cbindgen.toml", "bindings/c/src/abi.rs"])
        .current_dir(ROOT)
        .exits_with(0)
        .stdout;
    let path = Path::new(ROOT).join("bindings/c/include/phalanx.h");
    if std::env::var_os("PHALANX_BLESS").is_some() {
        std::fs::write(&path, &generated).unwrap();
    }
    let committed = std::fs::read_to_string(&path).unwrap();
    assert!(committed == generated, "PHALANX_BLESS=1 writes it anew");
}
