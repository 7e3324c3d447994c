//! The `Dockerfile`, tested without Docker: its files exist, its test command is that of continuous integration, and
//! runs work with the shared memory that Docker provides.

use std::path::Path;
use std::process::Command;

use clap::Parser as _;
use phalanx::command_line::CommandLine;

use crate::harness::ExitsWith as _;

const ROOT: &str = env!("CARGO_MANIFEST_DIR");
/// Docker's default size of /dev/shm.
const SHARED_MEMORY: &str = "64m";

fn text(path: &str) -> String {
    std::fs::read_to_string(Path::new(ROOT).join(path)).unwrap_or_else(|e| panic!("{path}: {e}"))
}

/// Returns the arguments of all instructions of this kind, each as a list.
fn instruction_arguments(kind: &str) -> Vec<Vec<String>> {
    let text = text("Dockerfile").replace("\\\n", " ");
    let arguments = text.lines().map(|line| line.split_whitespace().map(str::to_owned));
    let mut of_kind: Vec<Vec<String>> = arguments.map(Iterator::collect).collect();
    of_kind.retain(|arguments| arguments.first().is_some_and(|first| first == kind));
    of_kind.iter_mut().for_each(|arguments| drop(arguments.remove(0)));
    of_kind
}

#[test]
fn image_uses_repository_files_oldest_rust_and_the_ci_tests() {
    let manifest: toml::Table = text("Cargo.toml").parse().unwrap();
    let version = manifest["workspace"]["package"]["rust-version"].as_str().unwrap();
    assert!(
        instruction_arguments("FROM")[0][0].starts_with(&format!("rust:{version}-")),
        "{:?}",
        instruction_arguments("FROM")
    );
    let ran = instruction_arguments("RUN");
    let tests = ["cargo", "test", "--workspace"];
    assert!(
        ran.iter()
            .any(|arguments| arguments[..3] == tests
                && arguments[3..].iter().all(|w| w == "--locked"))
    );
    assert!(text(".ci/run").lines().any(|line| line == tests.join(" ")));
    for arguments in &ran {
        let [program, verb, rest @ ..] = &arguments[..] else { panic!("{arguments:?}") };
        assert_eq!(program, "cargo", "{arguments:?}");
        // Arguments up to `--` are flags of cargo, which checks them before it handles `--help`.
        let own = rest.iter().take_while(|word| *word != "--");
        Command::new(env!("CARGO")).arg(verb).args(own).arg("--help").exits_with(0);
        for pair in rest.windows(2).filter(|pair| pair[0] == "--profile") {
            assert!(manifest["profile"].get(&pair[1]).is_some(), "{arguments:?}");
        }
    }
    let made = ["dist/phalanx", "dist/phalanx-agent", "dist/phalanx-bench", "manual/man1"];
    for copy in instruction_arguments("COPY") {
        let (_, from) = copy.split_last().expect("where to");
        match from {
            [stage, paths @ ..] if stage == "--from=build" => {
                for path in paths {
                    let target = path.strip_prefix("/phalanx/target/").expect("what was built");
                    assert!(made.contains(&target), "{path}");
                }
            }
            paths => {
                assert!(paths.iter().all(|path| Path::new(ROOT).join(path).exists()), "{copy:?}")
            }
        }
    }
}

#[test]
fn page_runs_the_image_with_valid_entry_point_arguments() {
    assert_eq!(instruction_arguments("ENTRYPOINT"), [[r#"["phalanx"]"#]]);
    let page = text("docs/how-to/install.md");
    let runs: Vec<&str> = page.lines().filter(|line| line.starts_with("docker run ")).collect();
    assert!(runs.len() >= 2, "{runs:?}");
    for line in runs {
        let (_, arguments) = line.split_once(" phalanx ").expect("the image's name");
        let arguments = ["phalanx"].into_iter().chain(arguments.split(' '));
        CommandLine::try_parse_from(arguments).unwrap_or_else(|error| panic!("{line}: {error}"));
    }
}

#[test]
fn hundred_robots_run_in_dockers_shared_memory() {
    let script = format!(
        "mount -t tmpfs -o size={SHARED_MEMORY} shm /dev/shm || exit 77; exec \"$0\" \"$@\""
    );
    let in_namespace = |program: &str| {
        let mut command = Command::new("unshare");
        command.args(["--mount", "sh", "-c", &script, program]).current_dir(ROOT);
        // As in the image: the folder for shared memory is the default.
        command.env_remove("PHALANX_RUN_ROOT");
        command
    };
    if !in_namespace("true").status().is_ok_and(|status| status.success()) {
        println!("SKIPPED: this user may not mount a tmpfs in a namespace of its own");
        return;
    }
    let folder = tempfile::tempdir().unwrap();
    let scenario = folder.path().join("ring.toml");
    std::fs::write(&scenario, bench::ring::ring_scenario_text(100, 20, 0.005)).unwrap();
    in_namespace(env!("CARGO_BIN_EXE_phalanx"))
        .arg("run")
        .arg(&scenario)
        .args(["--pace", "lockstep", "--no-report", "--out"])
        .arg(folder.path().join("run"))
        .exits_with(0);
}
