//! The processes that a run starts, the programs they execute, and the report if one cannot be started.

use std::path::{Path, PathBuf};
use std::process::Command;

use clap::Parser;
use outcome::results::manifest::BuildInfo;
use protocol::brief;
use serde_json::Value;
use supervisor::spawn::Launcher;
use tempfile::TempDir;

use crate::harness::{PHALANX, Phalanx, ROOT, limited_by, write_script};
use crate::law_messages::TEST_LAWS;

/// A program that embeds the supervisor, as this test binary does.
#[derive(Parser)]
struct Embedding {
    #[command(subcommand)]
    verb: phalanx::verbs::Verb,
}

#[test]
#[ignore = "a program of its own: another test starts it"]
fn embedded_supervisor_process() {
    let (Ok(program), Ok(arguments)) = (std::env::var("PROGRAM"), std::env::var("WORDS")) else {
        return;
    };
    let Embedding { verb } = Embedding::parse_from(arguments.lines());
    let launcher = Launcher::new(program);
    let catalog = agent::catalog_with_laws(&TEST_LAWS);
    let code = phalanx::verbs::main(&verb, &catalog, &launcher, &BuildInfo::default());
    std::process::exit(code.into());
}

/// Result of a run whose supervisor is embedded in such a program.
pub(crate) struct EmbeddedRun {
    pub code: i32,
    pub summary: Value,
    folder: TempDir,
}

impl EmbeddedRun {
    pub fn file(&self, name: &str) -> String {
        std::fs::read_to_string(self.folder.path().join("run").join(name)).unwrap_or_default()
    }
}

/// Runs the triangle in lockstep as [`run_embedded_scenario`] does.
pub(crate) fn run_embedded(script: &str, more: &[&str]) -> EmbeddedRun {
    let scenario = format!("{ROOT}/scenarios/triangle.toml");
    run_embedded_scenario(&scenario, script, &[&["--pace", "lockstep"], more].concat())
}

/// Runs a scenario file with the additional arguments `more`, in a program that embeds the supervisor and whose robots
/// and plant execute this shell script. It is a separate process because iceoryx2's configuration is process-wide.
pub(crate) fn run_embedded_scenario(scenario: &str, script: &str, more: &[&str]) -> EmbeddedRun {
    let folder = tempfile::tempdir().unwrap();
    let [program, out] = ["program", "run"].map(|name| folder.path().join(name));
    write_script(&program, script);
    let arguments = ["embedding", "run", scenario, "--no-report", "--out"];
    let arguments = [&arguments[..], &[out.to_str().unwrap()], more].concat();
    let ended = Command::new(std::env::current_exe().unwrap())
        .args(["--exact", "processes::embedded_supervisor_process"])
        .args(["--ignored", "--nocapture"])
        .env("PROGRAM", program)
        .env("WORDS", arguments.join("\n"))
        .output()
        .unwrap();
    eprint!("{}", String::from_utf8_lossy(&ended.stderr));
    let code = ended.status.code().expect("it ends by itself");
    let summary = std::fs::read_to_string(out.join("summary.json")).unwrap_or_default();
    EmbeddedRun { code, summary: serde_json::from_str(&summary).unwrap_or_default(), folder }
}

/// Returns a script that accepts `phalanx`'s command lines, and for one role runs an ignored test of this binary with
/// these environment variables.
pub(crate) fn in_place_of(role: &str, variables: &str, test: &str) -> String {
    format!(
        "[ \"$1\" = {role} ] || exec '{PHALANX}' \"$@\"\n\
         {variables} exec '{}' --exact {test} --ignored --nocapture\n",
        std::env::current_exe().unwrap().display()
    )
}

#[test]
fn embedding_program_names_the_robot_and_plant_executables() {
    let script = format!("exec '{PHALANX}' \"$@\"\n");
    let run = run_embedded(&script, &["--set", "duration_s=1", "--set", "expect={}"]);
    assert_eq!(run.code, 0);
    assert_eq!(run.summary["t_s"], 1.0);
    // Robots and plant received options that `phalanx` supports and this binary does not.
    assert!(run.file("logs/plant.jsonl").contains("all ready"));
    assert!(run.file("logs/r1.jsonl").contains("ready"));
}

#[test]
fn children_of_another_build_end_the_run_with_the_reason() {
    // A process configuration as a later build would write it.
    let script = format!(
        "case \"$1\" in agent|plant) sed -i 's/^format = .*/format = 99/' \"$2\";; esac\n\
         exec '{PHALANX}' \"$@\"\n"
    );
    let run = run_embedded(&script, &[]);
    assert_eq!(run.code, 4);
    let logs = ["plant", "r1", "r2", "r3"].map(|name| run.file(&format!("logs/{name}.jsonl")));
    let errors = logs.iter().flat_map(|log| log.lines()).filter(|line| line.contains("ERROR"));
    let errors: Vec<&str> = errors.collect();
    let expected =
        format!("has format 99, and this program reads format {}", brief::FORMAT_VERSION);
    assert!(
        !errors.is_empty() && errors.iter().all(|line| line.contains(&expected)),
        "{errors:#?}"
    );
}

/// A control group of this test alone, with a limit on processes and threads.
struct Group(PathBuf);

impl Group {
    /// Creates the group. Returns `None` if the user may not create one.
    fn new() -> Option<Group> {
        let name = format!("phalanx-test-{}", std::process::id());
        let version_1 = Path::new("/sys/fs/cgroup/pids").join(&name);
        let version_2 = Path::new("/sys/fs/cgroup").join(&name);
        [version_1, version_2]
            .into_iter()
            .map(Group)
            .find(|group| std::fs::create_dir(&group.0).is_ok() && group.permit(100).is_ok())
    }

    fn permit(&self, processes_max: usize) -> std::io::Result<()> {
        std::fs::write(self.0.join("pids.max"), processes_max.to_string())
    }
}

impl Drop for Group {
    fn drop(&mut self) {
        let _ = std::fs::remove_dir(&self.0);
    }
}

#[test]
fn too_low_process_limit_is_reported_with_its_value() {
    let Some(group) = Group::new() else {
        eprintln!("skipped: no control group can be made here");
        return;
    };
    let run_among = |processes_max: usize| {
        group.permit(processes_max).unwrap();
        let mut command = limited_by(&format!("echo $$ > {}/cgroup.procs", group.0.display()));
        command.args(["run", "scenarios/triangle.toml", "--fault", "load of 30 @0.2 for 0.5"]);
        Phalanx::new(command).lockstep().set("duration_s=1").set("expect={}").finish()
    };
    let limit = |processes_max: usize| {
        let group = group.0.display();
        format!(
            "pids.max of the control group {group} permits {processes_max} processes and threads"
        )
    };
    // Enough for all processes.
    run_among(80).exits_with(0).assert_leaves_nothing();
    // Too few for the run: it is refused before anything starts.
    let mut processes_max = 3;
    let barely = loop {
        let ended = run_among(processes_max);
        ended.exits_with(4).assert_leaves_nothing();
        if ended.number("/t_s") > 0.0 {
            break ended;
        }
        let need = "error: 3 robots need 11 processes and threads, and ";
        ended.assert_holds(ended.stderr.contains(need), "the need is reported");
        let limit = format!(
            "pids.max of the control group {} permits {processes_max}, ",
            group.0.display()
        );
        ended.assert_holds(ended.stderr.contains(&limit), "and the limit");
        processes_max += 1;
    };
    assert_eq!(processes_max, 12, "one process is in the group before");
    // Too few for the requested load: the run is complete, but with less of it.
    barely.assert_holds(barely.number("/t_s") == 1.0, "the run has its full duration");
    barely.assert_holds(barely.file("events.csv").contains(" of 30 processes"), "how much load");
    let error = format!(
        "error: cannot start a process that takes processor time: {}",
        limit(processes_max)
    );
    barely.assert_holds(barely.stderr.contains(&error), "the missing load is reported");
}
