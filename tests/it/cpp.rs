//! Laws in C and C++, built by the system's compiler against `bindings/c/include/phalanx.h` and the library of `bindings/c/`.
//! `tests/cpp/install` installs the packages for it. A law in C++ moves a robot like the built-in one.

use std::path::{Path, PathBuf};
use std::process::Command;

use crate::elsewhere::{Pentagon, keeps_its_distance, stderr_contains};
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
    let by_hand = |folder: &Path, words: &[&Path]| {
        let mut command = Command::new(folder.join("mine"));
        command.args(words);
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
    tanh().moves_as_built_in(1, "duration_s=4", None);
}

#[test]
#[ignore = "needs what tests/cpp/install installs"]
fn cpp_robot_restarted_in_lockstep_moves_like_built_in_robot() {
    tanh().moves_as_built_in(1, "duration_s=8", Some("kill r3 @4 restart 2"));
}

#[test]
#[ignore = "needs what tests/cpp/install installs"]
fn cpp_robot_restarted_in_real_time_returns_to_its_slot() {
    tanh().comes_back("duration_s=8", "kill r3 @3 restart 1");
}

#[test]
#[ignore = "needs what tests/cpp/install installs"]
fn c_controller_holds_its_slot_and_sees_agent_inputs() {
    pentagon("tests/cpp/laws/place.c", &[], "k_per_s").keeps_its_place();
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
    for (fails_by, more, why, death) in cases {
        let fails_by = format!("-DFAILS_BY={fails_by}");
        let fails = pentagon("tests/cpp/laws/fails.cpp", &[&fails_by, more], "k_f_m_s");
        let ended = fails.with_r3().lockstep().set("duration_s=2").finish();
        ended.exits_with(1).leaves_nothing();
        keeps_its_distance(&ended);
        stderr_contains(&ended, "died unexpectedly");
        let log = ended.file("logs/r3.jsonl").replace("\\\"", "\"");
        ended.claim(log.contains(&why), format!("its log says {why:?}: {log}"));
        let events = ended.file("events.csv");
        ended.claim(events.contains(&format!("died,r3,{death}")), format!("{death}: {events}"));
    }
}

#[test]
#[ignore = "needs what tests/cpp/install installs"]
fn cpp_program_that_cannot_serve_prints_the_reason() {
    let cases = [
        (&[][..], "the law \"mine\" has no gain \"k_f\"; its gains: k_f_m_s", "exit code 1"),
        (&["-DSERVES_NONE"], "the law \"mine\" is NULL", "exit code 4"),
    ];
    for (more, why, death) in cases {
        let wrong = pentagon("tests/cpp/laws/wrong.cpp", more, "k_f_m_s");
        wrong.cannot_start(&[], &[why, death]);
    }
}

#[test]
#[ignore = "needs what tests/cpp/install installs"]
fn cpp_program_started_manually_names_its_starter() {
    let parts = ["error: ", "<BRIEF>", "`phalanx run SCENARIO` starts it"];
    tanh().says_by_hand(&[], 2, &parts, usize::MAX);
}

#[test]
#[ignore = "needs what tests/cpp/install installs"]
fn cpp_program_of_another_version_is_refused() {
    tanh().says_that_versions_differ("but its libphalanx_agent", usize::MAX);
}

#[test]
#[ignore = "needs what tests/cpp/install installs"]
fn c_header_equals_the_output_of_cbindgen() {
    let made = Command::new("cbindgen")
        .args(["--quiet", "--config", "bindings/c/cbindgen.toml", "bindings/c/src/abi.rs"])
        .current_dir(ROOT)
        .exits_with(0)
        .stdout;
    let path = Path::new(ROOT).join("bindings/c/include/phalanx.h");
    if std::env::var_os("PHALANX_BLESS").is_some() {
        std::fs::write(&path, &made).unwrap();
    }
    let kept = std::fs::read_to_string(&path).unwrap();
    assert!(kept == made, "PHALANX_BLESS=1 writes it anew");
}
