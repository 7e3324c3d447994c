//! The `Dockerfile` where there is no Docker: what it names is there, what it calls is what continuous
//! integration calls, and what runs in its image has no more shared memory than Docker gives.

use std::path::Path;
use std::process::Command;

use clap::Parser as _;
use phalanx::command_line::CommandLine;

const ROOT: &str = env!("CARGO_MANIFEST_DIR");
/// Docker's default size of /dev/shm.
const SHARED_MEMORY: &str = "64m";

fn text(path: &str) -> String {
    std::fs::read_to_string(Path::new(ROOT).join(path)).unwrap_or_else(|e| panic!("{path}: {e}"))
}

/// The instructions of the Dockerfile: word and rest.
fn instructions() -> Vec<(String, String)> {
    let text = text("Dockerfile").replace("\\\n", " ");
    let lines = text.lines().filter(|line| !line.is_empty() && !line.starts_with('#'));
    let split = |line: &str| {
        let (word, rest) = line.split_once(' ').expect("an instruction has arguments");
        (word.to_owned(), rest.split_whitespace().collect::<Vec<_>>().join(" "))
    };
    lines.map(split).collect()
}

/// The arguments of all instructions of this kind.
fn all(kind: &str) -> Vec<String> {
    instructions().into_iter().filter(|(word, _)| word == kind).map(|(_, rest)| rest).collect()
}

/// `key = "value"` in a manifest.
fn value(manifest: &str, key: &str) -> String {
    let text = text(manifest);
    let line = text.lines().find_map(|line| line.strip_prefix(&format!("{key} = ")));
    line.unwrap_or_else(|| panic!("no {key} in {manifest}")).trim_matches('"').to_owned()
}

#[test]
fn the_image_is_built_by_the_oldest_rust_that_is_supported() {
    let version = value("Cargo.toml", "rust-version");
    assert!(all("FROM")[0].starts_with(&format!("rust:{version}-")), "{:?}", all("FROM"));
}

#[test]
fn the_image_is_built_by_commands_that_cargo_takes_and_tested_as_in_continuous_integration() {
    let ran = all("RUN");
    let ci = text(".ci/run");
    assert!(ran.iter().any(|command| {
        let command = command.trim_end_matches(" --locked");
        command == "cargo test --workspace" && ci.lines().any(|line| line == command)
    }));
    for command in &ran {
        let words: Vec<&str> = command.split(' ').collect();
        let [program, verb, rest @ ..] = &words[..] else { panic!("{command}") };
        assert_eq!(*program, "cargo", "{command}");
        // The rest up to `--` are flags of cargo; with `--help` behind them it checks them first.
        let own = rest.iter().take_while(|word| **word != "--");
        let mut cargo = Command::new(env!("CARGO"));
        let output = cargo.arg(verb).args(own).arg("--help").output().unwrap();
        assert!(output.status.success(), "{command}: {output:?}");
        let profiles = rest.windows(2).filter(|pair| pair[0] == "--profile");
        for profile in profiles.map(|pair| format!("[profile.{}]", pair[1])) {
            assert!(text("Cargo.toml").lines().any(|line| line == profile), "{command}");
        }
        for package in rest.windows(2).filter(|pair| pair[0] == "-p").map(|pair| pair[1]) {
            let folder = if package == "phalanx" { "." } else { package };
            assert_eq!(value(&format!("{folder}/Cargo.toml"), "name"), package);
        }
    }
}

#[test]
fn what_the_image_copies_is_in_the_sources_or_made_by_its_commands() {
    let built =
        ["phalanx", "phalanx-agent", "phalanx-bench"].map(|name| format!("target/dist/{name}"));
    let made = [&built[..], &["target/manual/man1".to_owned()]].concat();
    for copy in all("COPY") {
        let mut words: Vec<&str> = copy.split(' ').collect();
        words.pop().expect("where to");
        let from_build = words.first() == Some(&"--from=build");
        for path in words.iter().skip(usize::from(from_build)) {
            match from_build {
                true => {
                    let path = path.strip_prefix("/phalanx/").expect("a path of the build stage");
                    assert!(made.iter().any(|made| made == path), "{path} of {made:?}");
                }
                false => assert!(Path::new(ROOT).join(path).exists(), "{path}"),
            }
        }
    }
}

#[test]
fn its_page_runs_the_image_with_arguments_that_its_entry_point_takes() {
    assert_eq!(all("ENTRYPOINT"), [r#"["phalanx"]"#]);
    let page = text("docs/how-to/install.md");
    let runs = page.lines().filter(|line| line.starts_with("docker run "));
    let mut ran = 0;
    for line in runs {
        let (_, arguments) = line.split_once(" phalanx ").expect("the image's name");
        let words = ["phalanx"].into_iter().chain(arguments.split(' '));
        CommandLine::try_parse_from(words).unwrap_or_else(|error| panic!("{line}: {error}"));
        ran += 1;
    }
    assert!(ran >= 2, "{ran} lines");
}

#[test]
fn a_hundred_robots_run_in_the_shared_memory_that_docker_gives() {
    let script = format!(
        "mount -t tmpfs -o size={SHARED_MEMORY} shm /dev/shm || exit 77; exec \"$0\" \"$@\""
    );
    let in_namespace = |program: &str| {
        let mut command = Command::new("unshare");
        command.args(["--mount", "sh", "-c", &script, program]).current_dir(ROOT);
        // As in the image: where runs share memory is the default.
        command.env_remove("PHALANX_RUN_ROOT");
        command
    };
    if !in_namespace("true").status().is_ok_and(|status| status.success()) {
        println!("SKIPPED: this user may not mount a tmpfs in a namespace of its own");
        return;
    }
    let folder = tempfile::tempdir().unwrap();
    let scenario = folder.path().join("ring.toml");
    std::fs::write(&scenario, bench::ring::text(100, 20, 0.005)).unwrap();
    let output = in_namespace(env!("CARGO_BIN_EXE_phalanx"))
        .arg("run")
        .arg(&scenario)
        .args(["--pace", "lockstep", "--no-report", "--out"])
        .arg(folder.path().join("run"))
        .output()
        .unwrap();
    assert!(output.status.success(), "{output:?}");
}
