//! Bad scenarios, one mistake per file: each gets exactly the diagnostic beside it; `phalanx run` of one shows
//! it, has exit status 3, and leaves nothing behind. `PHALANX_BLESS=1` rewrites the expected diagnostics; read
//! the diff.

use std::path::{Path, PathBuf};
use std::process::{Command, Output};

use experiment::scenario::read::{Overrides, read_to_run};

/// `phalanx run` on a path as seen from the root of the project. The run directory must not come
/// into being.
fn run(scenario: &Path) -> Output {
    let scratch = tempfile::tempdir().unwrap();
    let out = scratch.path().join("run");
    let output = Command::new(env!("CARGO_BIN_EXE_phalanx"))
        .current_dir(env!("CARGO_MANIFEST_DIR"))
        .arg("run")
        .arg(scenario)
        .args(["--pace", "lockstep", "--out"])
        .arg(&out)
        .env("NO_COLOR", "1")
        .output()
        .unwrap();
    assert!(!out.exists(), "a run directory was made for {}", scenario.display());
    output
}

/// Status 3, nothing on stdout; gives stderr.
fn refused(scenario: &Path) -> String {
    let output = run(scenario);
    let stderr = String::from_utf8(output.stderr).unwrap();
    let shown = scenario.display();
    assert_eq!(output.status.code(), Some(3), "{shown}: {stderr}");
    assert!(output.stdout.is_empty(), "{shown}: {}", String::from_utf8_lossy(&output.stdout));
    let raw = stderr.chars().any(|c| c.is_control() && c != '\n');
    assert!(!raw, "{shown}: a terminal would obey {stderr:?}");
    stderr
}

/// The same, and stderr is one line that begins with `error: ` and holds `part`.
fn refused_in_one_line(scenario: &Path, part: &str) {
    let stderr = refused(scenario);
    assert_eq!(stderr.lines().count(), 1, "{stderr}");
    assert!(stderr.starts_with("error: ") && stderr.contains(part), "{stderr}");
}

fn with_content(content: &[u8]) -> (tempfile::TempDir, PathBuf) {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("scenario.toml");
    std::fs::write(&path, content).unwrap();
    (folder, path)
}

/// How many of the files are given to the program too; of the others the reader says all there is to say.
const PROCESSES: usize = 10;

#[test]
fn every_bad_scenario_gets_its_diagnostic_and_exit_status_3() {
    let folder = Path::new("tests/bad");
    let mut names: Vec<String> = std::fs::read_dir(folder)
        .unwrap()
        .map(|entry| entry.unwrap().file_name().into_string().unwrap())
        .filter(|name| name.ends_with(".toml"))
        .collect();
    names.sort();
    assert!(names.len() >= 210, "only {} files in tests/bad", names.len());
    let catalog = agent::catalog();
    let mut wrong = Vec::new();
    for (at, name) in names.iter().enumerate() {
        let path = folder.join(name);
        let read = read_to_run(&path, &Overrides::default(), &catalog);
        let shown = read.expect_err(name).render(false) + "\n";
        if at % names.len().div_ceil(PROCESSES) == 0 {
            assert_eq!(refused(&path), shown, "{name}");
        }
        let beside = path.with_extension("stderr");
        if std::env::var_os("PHALANX_BLESS").is_some() {
            std::fs::write(&beside, &shown).unwrap();
        }
        let expected = std::fs::read_to_string(&beside).unwrap_or_default();
        if shown != expected {
            wrong.push(format!("{name}\nexpected:\n{expected}\nfound:\n{shown}"));
        }
    }
    assert!(wrong.is_empty(), "{}", wrong.join("\n"));
}

#[test]
fn every_expected_diagnostic_belongs_to_a_bad_scenario() {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/bad");
    for entry in std::fs::read_dir(folder).unwrap() {
        let path = entry.unwrap().path();
        assert!(path.with_extension("toml").exists(), "{} is left over", path.display());
    }
}

#[test]
fn a_missing_scenario_is_named() {
    refused_in_one_line(
        Path::new("scenarios/no-such.toml"),
        "`scenarios/no-such.toml` does not exist",
    );
}

#[test]
fn a_directory_is_no_scenario() {
    refused_in_one_line(Path::new("scenarios"), "`scenarios` is a directory");
}

#[test]
fn a_device_is_no_scenario() {
    refused_in_one_line(Path::new("/dev/zero"), "is not a regular file");
}

#[test]
fn a_path_with_control_characters_is_shown_without_them() {
    refused_in_one_line(Path::new("no\u{1b}[2J.toml"), r"`no\u{1b}[2J.toml` does not exist");
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a\u{1b}]0;b\u{7}.toml");
    std::fs::write(&path, "name = \"a\u{202e}\"\nname = 1\n").unwrap();
    assert!(refused(&path).contains(r"a\u{1b}]0;b\u{7}.toml:2:1"));
}

#[test]
fn an_empty_file_is_no_scenario() {
    let (_folder, path) = with_content(b" \n\n");
    refused_in_one_line(&path, "is empty");
}

#[test]
fn ten_megabytes_of_noise_are_no_scenario() {
    let mut state: u64 = 42; // the seed
    let mut noise = Vec::with_capacity(10_000_000);
    while noise.len() < 10_000_000 {
        state ^= state << 13;
        state ^= state >> 7;
        state ^= state << 17;
        noise.extend_from_slice(&state.to_le_bytes());
    }
    let (_folder, path) = with_content(&noise);
    refused_in_one_line(&path, "has 10000000 bytes");
    // Small enough to be read, and still noise.
    let (_folder, path) = with_content(&noise[..100_000]);
    refused_in_one_line(&path, "is not UTF-8");
}

#[test]
fn a_byte_that_is_not_utf_8_is_found() {
    let (_folder, path) = with_content(b"name = \"a\"\nperiod_s = 0.005 # \xff\n");
    refused_in_one_line(&path, "byte 0xff at offset 30, on line 2");
}
