//! Invalid scenarios, one mistake per file: the diagnostic of each equals the `*.stderr` next to it. `phalanx run`
//! prints it, exits with status 3, and leaves no files. `PHALANX_BLESS=1` rewrites the expected diagnostics; read the
//! diff.

use std::cell::Cell;
use std::path::Path;

use experiment::scenario::read::{Overrides, read_for_run};

use crate::harness::{ExitsWith as _, assert_texts_beside, phalanx};

/// Returns the stderr of `phalanx run` on a path relative to the root of the project. Checks that its exit status is 3,
/// that stdout is empty, and that no run directory is created.
fn run_refused_scenario(scenario: &Path) -> String {
    let scratch = tempfile::tempdir().unwrap();
    let out = scratch.path().join("run");
    let mut run = phalanx(["run", "--pace", "lockstep", "--out"]);
    let output = run.arg(&out).arg(scenario).exits_with(3);
    assert!(
        !out.exists() && output.stdout.is_empty(),
        "{}: {}",
        run_of(scenario),
        output.stdout_and_stderr()
    );
    let has_control_characters = output.stderr.chars().any(|c| c.is_control() && c != '\n');
    assert!(
        !has_control_characters,
        "{}: a terminal would obey {:?}",
        run_of(scenario),
        output.stderr
    );
    output.stderr
}

fn run_of(scenario: &Path) -> String {
    format!("phalanx run {}", scenario.display())
}

/// Step between the files that are also passed to the program. For the others, only the reader is called.
const PROCESS_EVERY: usize = 22;

#[test]
fn every_bad_scenario_gets_its_diagnostic_and_exit_status_3() {
    let (catalog, files) = (agent::catalog(), Cell::new(0));
    assert_texts_beside("tests/bad", 224, |path| {
        let read = read_for_run(path, &Overrides::default(), &catalog);
        let diagnostic = read.expect_err(&run_of(path)).render(false) + "\n";
        if files.replace(files.get() + 1) % PROCESS_EVERY == 0 {
            assert_eq!(run_refused_scenario(path), diagnostic, "{}", run_of(path));
        }
        diagnostic
    });
}

#[test]
fn non_scenario_file_is_refused_in_one_printable_line() {
    let folder = tempfile::tempdir().unwrap();
    let file = |name: &str, content: &[u8]| {
        let path = folder.path().join(name);
        std::fs::write(&path, content).unwrap();
        path
    };
    let mut noise = Vec::with_capacity(10_000_000);
    let mut rng = formation::random::SplitMix64::new(42);
    while noise.len() < 10_000_000 {
        noise.extend_from_slice(&rng.next_u64().to_le_bytes());
    }
    for (path, expected) in [
        ("scenarios/no-such.toml".into(), "`scenarios/no-such.toml` does not exist"),
        ("scenarios".into(), "`scenarios` is a directory"),
        ("/dev/zero".into(), "is not a regular file"),
        ("no\u{1b}[2J.toml".into(), r"`no\u{1b}[2J.toml` does not exist"),
        (file("empty.toml", b" \n\n"), "is empty"),
        (file("noise.toml", &noise), "has 10000000 bytes"),
        // Random bytes, small enough to be read.
        (file("some-noise.toml", &noise[..100_000]), "is not UTF-8"),
        (
            file("latin.toml", b"name = \"a\"\nperiod_s = 0.005 # \xff\n"),
            "byte 0xff at offset 30, on line 2",
        ),
    ] {
        let stderr = run_refused_scenario(&path);
        assert_eq!(stderr.lines().count(), 1, "{stderr}");
        assert!(stderr.starts_with("error: ") && stderr.contains(expected), "{stderr}");
    }
    let hostile = file("a\u{1b}]0;b\u{7}.toml", "name = \"a\u{202e}\"\nname = 1\n".as_bytes());
    assert!(run_refused_scenario(&hostile).contains(r"a\u{1b}]0;b\u{7}.toml:2:1"));
}
