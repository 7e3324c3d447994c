//! Commands on an untrusted folder read and write no file outside of it, wherever its links lead.

use std::fs;
use std::os::unix::fs::symlink;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};

use tempfile::TempDir;

use crate::harness::{
    ExitsWith as _, FinishedRun, PHALANX, RunRoot, WAIT_TIMEOUT, files_below, phalanx, run,
};

const USERS_TEXT: &str = "precious\n";

/// A run, and next to it a folder with a file that no command may touch.
struct Foreign {
    ended: FinishedRun,
    outside: TempDir,
}

impl Foreign {
    fn new() -> Foreign {
        let ended = run("triangle").lockstep().set("duration_s=1").set("expect={}").finish();
        ended.exits_with(0);
        let outside = tempfile::tempdir().unwrap();
        fs::write(outside.path().join("precious"), USERS_TEXT).unwrap();
        Foreign { ended, outside }
    }

    fn users_file(&self) -> PathBuf {
        self.outside.path().join("precious")
    }

    /// Replaces a file or folder of the run by a link.
    fn link(&self, name: &str, target: &Path) {
        let path = self.ended.run_dir().join(name);
        let _ = fs::remove_file(&path);
        let _ = fs::remove_dir_all(&path);
        symlink(target, path).unwrap();
    }

    #[track_caller]
    fn verb(&self, verb: &str, name: &str, code: i32) -> String {
        // A process that opens a pipe waits forever, whatever signal it receives.
        let mut command = Command::new("timeout");
        command
            .args(["--signal", "KILL"])
            .arg(WAIT_TIMEOUT.as_secs().to_string())
            .args([PHALANX, verb]);
        command.arg(self.ended.run_dir().join(name)).env("NO_COLOR", "1").stdin(Stdio::null());
        let output = command.env("PHALANX_RUN_ROOT", RunRoot::new().path()).exits_with(code);
        assert_eq!(
            files_below(self.outside.path()),
            [self.users_file()],
            "{}",
            output.stdout_and_stderr()
        );
        assert_eq!(
            fs::read_to_string(self.users_file()).unwrap(),
            USERS_TEXT,
            "{}",
            output.stdout_and_stderr()
        );
        output.stdout_and_stderr()
    }
}

#[test]
fn report_replaces_links_and_writes_through_none() {
    let foreign = Foreign::new();
    foreign.verb("report", "", 0);
    let figures = foreign.ended.run_dir().join("figures");
    let names: Vec<_> = fs::read_dir(&figures).unwrap().map(|e| e.unwrap().file_name()).collect();
    assert!(names.len() > 2, "{names:?}");
    for name in names.iter().map(|name| format!("figures/{}", name.display())) {
        foreign.link(&name, &foreign.users_file());
    }
    // The temporary file has another name.
    for name in ["report.html", "report.html.new"] {
        foreign.link(name, &foreign.users_file());
    }
    foreign.verb("report", "", 0);
    assert!(foreign.ended.file("report.html").contains("</html>"));
    foreign.link("figures", foreign.outside.path());
    let output = foreign.verb("report", "", 4);
    assert!(output.contains("figures: it is a link to "), "{output}");
}

#[test]
fn link_out_of_a_run_is_not_followed() {
    let foreign = Foreign::new();
    let run_dir = foreign.ended.run_dir();
    // A link to a file within the folder is permitted.
    for name in ["events.csv", "run.mcap"] {
        fs::rename(run_dir.join(name), run_dir.join(format!("same.{name}"))).unwrap();
        foreign.link(name, &Path::new(".").join(format!("same.{name}")));
    }
    foreign.verb("report", "", 0);
    foreign.verb("export", "", 0);
    foreign.verb("recover", "run.mcap", 0);
    for name in ["samples.csv", "summary.json", "manifest.json", "latency.hlog", "scenario.toml"] {
        let path = run_dir.join(name);
        let text = fs::read(&path).unwrap();
        foreign.link(name, &foreign.users_file());
        let code = if name == "scenario.toml" { 2 } else { 4 };
        let output = foreign.verb("report", "", code);
        assert!(output.contains(&format!("{name}: it is a link to ")), "{output}");
        fs::remove_file(&path).unwrap();
        fs::write(&path, text).unwrap();
    }
    foreign.link("run.mcap", &foreign.users_file());
    fs::remove_dir_all(run_dir.join("export")).unwrap();
    for (verb, name) in [("export", ""), ("export", "run.mcap"), ("recover", "run.mcap")] {
        let output = foreign.verb(verb, name, 2);
        assert!(output.contains("run.mcap: it is a link to "), "{output}");
    }
    fs::remove_file(run_dir.join("run.mcap")).unwrap();
    Command::new("mkfifo").arg(run_dir.join("run.mcap")).exits_with(0);
    for (verb, name) in [("export", ""), ("export", "run.mcap"), ("recover", "run.mcap")] {
        let output = foreign.verb(verb, name, 2);
        assert!(output.contains("run.mcap: it is no regular file"), "{output}");
    }
    for output_name in ["export", "run-export", "run.recovered.mcap"] {
        assert!(!run_dir.join(output_name).exists(), "{output_name}");
    }
}

#[test]
fn verify_ignores_targets_of_links_and_pipes() {
    let foreign = Foreign::new();
    let run_dir = foreign.ended.run_dir();
    foreign.verb("verify", "", 0);
    for name in
        ["samples.csv", "pairs.csv", "events.csv", "summary.json", "manifest.json", "run.mcap"]
    {
        let [path, backup] = [name, "kept"].map(|name| run_dir.join(name));
        fs::rename(&path, &backup).unwrap();
        foreign.link(name, &foreign.users_file());
        let output = foreign.verb("verify", "", 4);
        assert!(output.contains(&format!("{name}: it is a link to ")), "{output}");
        fs::rename(&backup, &path).unwrap();
    }
    fs::remove_file(run_dir.join("samples.csv")).unwrap();
    Command::new("mkfifo").arg(run_dir.join("samples.csv")).exits_with(0);
    let output = foreign.verb("verify", "", 4);
    assert!(output.contains("samples.csv: it is no regular file"), "{output}");
    foreign.link("scenario.toml", &foreign.users_file());
    let output = foreign.verb("verify", "", 2);
    assert!(output.contains("scenario.toml: it is a link to "), "{output}");
}

#[test]
fn briefs_that_have_no_end_are_refused() {
    let folder = tempfile::tempdir().unwrap();
    let pipe = folder.path().join("pipe");
    Command::new("mkfifo").arg(&pipe).exits_with(0);
    for brief in [Path::new("/dev/zero"), &pipe, folder.path()] {
        for role in ["agent", "plant"] {
            let mut command = Command::new("timeout");
            command.args(["--signal", "KILL", &WAIT_TIMEOUT.as_secs().to_string(), "sh", "-c"]);
            command.args(["ulimit -v 4000000 && exec \"$0\" \"$@\"", PHALANX, role]).arg(brief);
            let output = command.stdin(Stdio::null()).exits_with(4).stdout_and_stderr();
            assert!(output.contains("it is no regular file"), "{role}: {output}");
        }
    }
}

#[test]
fn graph_link_out_of_its_folder_is_refused() {
    let folder = tempfile::tempdir().unwrap();
    let outside = tempfile::tempdir().unwrap();
    let graph = outside.path().join("swarm64.json");
    fs::copy("scenarios/swarm64.json", &graph).unwrap();
    let scenario = folder.path().join("swarm64.toml");
    fs::copy("scenarios/swarm64.toml", &scenario).unwrap();
    let imported = folder.path().join("swarm64.json");
    symlink(&graph, &imported).unwrap();
    let check =
        |code| phalanx([Path::new("check"), &scenario]).exits_with(code).stdout_and_stderr();
    let output = check(3);
    assert!(output.contains("swarm64.json`, which cannot be read: it is a link to "), "{output}");
    // Files that the scenario names are visible to its reader, and a link to a file within the folder is permitted.
    fs::rename(&graph, folder.path().join("same.json")).unwrap();
    fs::remove_file(&imported).unwrap();
    symlink("same.json", &imported).unwrap();
    check(0);
}

#[test]
fn program_files_outside_the_scenario_folder_are_refused() {
    let folder = tempfile::tempdir().unwrap();
    let outside = tempfile::tempdir().unwrap();
    let secret = outside.path().join("secret.txt");
    fs::write(&secret, USERS_TEXT).unwrap();
    symlink(&secret, folder.path().join("link.txt")).unwrap();
    fs::write(folder.path().join("law.py"), "").unwrap();
    symlink("law.py", folder.path().join("same.py")).unwrap();
    let text = fs::read_to_string("scenarios/triangle.toml").unwrap();
    let check = |law: &str| {
        let law = format!("{text}\n[laws.own]\nrole = \"formation\"\n{law}\n");
        fs::write(folder.path().join("scenario.toml"), law).unwrap();
        let mut check: Command = phalanx(["check"]);
        check.arg(folder.path().join("scenario.toml"));
        check
    };
    check("program = [\"python3\", \"same.py\"]").exits_with(0);
    for law in [
        "program = [\"python3\", \"law.py\"]\nfiles = [\"link.txt\"]",
        "program = [\"python3\", \"link.txt\"]",
    ] {
        let output = check(law).exits_with(3).stdout_and_stderr();
        assert!(
            output.contains("\"link.txt\", which is outside of the scenario's folder"),
            "{output}"
        );
    }
}
