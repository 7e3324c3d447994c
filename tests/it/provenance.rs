//! Build information of a binary, tested with the real build script in a tree of two small crates: sources that differ
//! from their commit are never reported as clean.

use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;

use serde_json::Value;
use tempfile::TempDir;

use crate::harness::{CommandOutput, ExitsWith as _, run};

/// Source tree with our build script: a program, and a crate with a law.
struct Tree(TempDir);

impl Tree {
    fn new() -> Tree {
        let tree = Tree(tempfile::tempdir().unwrap());
        let main = r#"fn main() {
            let of = ["GIT_HASH", "GIT_DIRTY", "RUSTC", "PROFILE"];
            let is = [env!("PHALANX_GIT_HASH"), env!("PHALANX_GIT_DIRTY"),
                env!("PHALANX_RUSTC"), env!("PHALANX_PROFILE")];
            for (name, value) in of.iter().zip(is) { println!("{name}={value}"); }
            agent::law();
        }"#;
        let manifest = |name: &str| {
            format!("[package]\nname = \"{name}\"\nversion = \"0.1.0\"\nedition = \"2024\"\n")
        };
        let depends = "[dependencies]\nagent = { path = \"agent\" }\n[workspace]\n";
        tree.write("Cargo.toml", &(manifest("program") + depends));
        tree.write("src/main.rs", main);
        tree.write("agent/Cargo.toml", &manifest("agent"));
        tree.write("agent/src/lib.rs", "pub fn law() {}\n");
        tree.write(".gitignore", "target\n");
        let script = Path::new(env!("CARGO_MANIFEST_DIR")).join("build.rs");
        tree.write("build.rs", &fs::read_to_string(script).unwrap());
        tree
    }

    fn path(&self) -> &Path {
        self.0.path()
    }

    fn write(&self, name: &str, text: &str) {
        let path = self.path().join(name);
        fs::create_dir_all(path.parent().unwrap()).unwrap();
        fs::write(path, text).unwrap();
    }

    /// Commits all files, and returns the hash of the commit.
    fn commit(&self) -> String {
        let git = |arguments: &[&str]| {
            let identity = ["-c", "user.name=nobody", "-c", "user.email=nobody@localhost"];
            let output =
                self.without_ours("git").args(identity).args(arguments).exits_with(0).stdout;
            output.trim().to_owned()
        };
        git(&["init", "-q"]);
        git(&["add", "-A"]);
        git(&["commit", "-q", "-m", "a commit"]);
        git(&["rev-parse", "HEAD"])
    }

    /// Prepares a command in this tree, without the environment of the repository and build that the test runs in.
    fn without_ours(&self, program: &str) -> Command {
        let mut command = Command::new(program);
        command.current_dir(self.path());
        for (name, _) in std::env::vars_os() {
            let name = name.to_string_lossy().into_owned();
            if ["GIT_", "CARGO_BUILD_", "CARGO_TARGET_"].iter().any(|ours| name.starts_with(ours)) {
                command.env_remove(name);
            }
        }
        command
    }

    fn build(&self) -> CommandOutput {
        self.without_ours(env!("CARGO")).args(["build", "--offline"]).exits_with(0)
    }

    /// Builds the program if necessary, and returns its output about commit and sources.
    fn build_info(&self) -> (String, String) {
        self.build();
        let text = Command::new(self.path().join("target/debug/program")).exits_with(0).stdout;
        assert!(text.contains("\nRUSTC=rustc 1."), "{text}");
        assert!(text.contains("\nPROFILE=debug\n"), "{text}");
        (value_of(&text, "GIT_HASH="), value_of(&text, "GIT_DIRTY="))
    }
}

fn value_of(text: &str, name: &str) -> String {
    let found = text.lines().find_map(|line| line.strip_prefix(name));
    found.unwrap_or_else(|| panic!("no {name} in {text}")).to_owned()
}

#[test]
fn law_edited_after_the_commit_is_dirty_after_the_build() {
    let tree = Tree::new();
    tree.build(); // which makes Cargo.lock
    let first = tree.commit();
    // The repository is new, and no watched file has changed.
    tree.write("build.rs", &fs::read_to_string(tree.path().join("build.rs")).unwrap());
    assert_eq!(tree.build_info(), (first.clone(), "false".into()));

    let again = tree.build().stderr;
    assert!(!again.contains("Compiling"), "built again without a reason: {again}");

    tree.write("agent/src/lib.rs", "pub fn law() { assert!(true); }\n");
    assert_eq!(tree.build_info(), (first.clone(), "true".into()));
    let second = tree.commit();
    assert_ne!(first, second);
    assert_eq!(tree.build_info(), (second.clone(), "false".into()));

    // A law that is in no commit is not clean either.
    tree.write("agent/src/laws.rs", "");
    assert_eq!(tree.build_info(), (second.clone(), "true".into()));
    fs::remove_file(tree.path().join("agent/src/laws.rs")).unwrap();
    assert_eq!(tree.build_info(), (second.clone(), "false".into()));
    // Files that are not part of the program do not count.
    tree.write("docs/notes.md", "");
    assert_eq!(tree.build_info(), (second, "false".into()));
}

#[test]
fn without_a_repository_or_without_git_the_commit_is_unknown() {
    let tree = Tree::new();
    assert_eq!(tree.build_info(), (String::new(), String::new()));
    tree.commit();
    let scripts = fs::read_dir(tree.path().join("target/debug/build")).unwrap().flatten();
    let mut scripts = scripts.map(|entry| entry.path().join("build-script-build"));
    let script: PathBuf = scripts.find(|path| path.exists()).unwrap();
    let run_with = |path: &str| {
        let mut script = tree.without_ours(script.to_str().unwrap());
        script.env("CARGO_MANIFEST_DIR", tree.path()).env("PATH", path);
        let text = script.exits_with(0).stdout;
        value_of(&text, "cargo::rustc-env=PHALANX_GIT_HASH=")
    };
    assert_eq!(run_with(&std::env::var("PATH").unwrap()).len(), 40);
    assert_eq!(run_with("/no/such/folder"), "");
}

#[test]
fn manifest_names_the_build_configuration_and_processor() {
    let ended = run("triangle").lockstep().set("duration_s=0.1").set("expect={}").finish();
    ended.exits_with(0);
    let manifest: Value = serde_json::from_str(&ended.file("manifest.json")).unwrap();
    let text = |key: &str| manifest[key].as_str().unwrap_or("none").to_owned();
    ended.assert_holds(text("rustc").starts_with("rustc 1."), text("rustc"));
    ended.assert_holds(["debug", "release"].contains(&text("profile").as_str()), text("profile"));
    ended.assert_holds(
        !["", "none"].contains(&text("processor").as_str()),
        "the processor is named",
    );
    let (hash, dirty) = (&manifest["git_hash"], &manifest["git_dirty"]);
    let known = hash.as_str().is_some_and(|hash| hash.len() == 40) && dirty.is_boolean();
    ended.assert_holds(known || hash.is_null() && dirty.is_null(), format!("{hash}, {dirty}"));
}
