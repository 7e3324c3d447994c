//! Build script: embeds the commit, whether the sources differ from it, the compiler and the profile in the binary.
//! Cargo reruns it only when a source file or the commit changes. The git index is ignored, because the sources are
//! compared with the commit.
//!
//! Must not require git, a repository or a network. An unknown value becomes an empty string.

use std::env;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;

fn main() {
    let tree =
        PathBuf::from(env::var_os("CARGO_MANIFEST_DIR").expect("cargo sets CARGO_MANIFEST_DIR"));
    let sources = sources(&tree);
    let commit = commit(&tree);
    // A missing path would make cargo rerun this script at every build.
    for path in sources.iter().chain(&watched(&tree)).filter(|path| path.exists()) {
        println!("cargo::rerun-if-changed={}", path.display());
    }
    let dirty = commit.as_ref().and_then(|_| dirty(&tree, &sources));
    embed("GIT_HASH", commit);
    embed("GIT_DIRTY", dirty.map(|dirty| dirty.to_string()));
    let rustc = env::var_os("RUSTC").unwrap_or("rustc".into());
    embed("RUSTC", command_output(Command::new(rustc).arg("--version")));
    embed("PROFILE", profile());
}

/// Returns the name of the cargo profile, read from the path of the output directory (for example
/// `target/dist/build/phalanx-0/out`). Cargo's variable `PROFILE` only holds the profile that it inherits from,
/// `debug` or `release`.
fn profile() -> Option<String> {
    let out = PathBuf::from(env::var_os("OUT_DIR")?);
    Some(out.ancestors().nth(3)?.file_name()?.to_str()?.to_owned())
}

/// Sets the environment variable `PHALANX_{name}` for the compilation; `None` becomes an empty string.
fn embed(name: &str, value: Option<String>) {
    println!("cargo::rustc-env=PHALANX_{name}={}", value.unwrap_or_default());
}

/// Returns the existing source paths of the program: this package and every crate in a folder of the repository root.
fn sources(tree: &Path) -> Vec<PathBuf> {
    let mut sources =
        ["Cargo.toml", "Cargo.lock", "build.rs", "src"].map(|name| tree.join(name)).to_vec();
    let folders = fs::read_dir(tree).into_iter().flatten().flatten().map(|entry| entry.path());
    let crates = folders.filter(|folder| folder.join("Cargo.toml").exists());
    // The other bindings depend on this program, not the other way round.
    for folder in crates.chain([tree.join("bindings/bridge")]) {
        sources.extend(["Cargo.toml", "src", "assets"].map(|name| folder.join(name)));
    }
    sources.retain(|path| path.exists());
    sources.sort();
    sources
}

/// Returns the git files that change when another commit is checked out.
fn watched(tree: &Path) -> Vec<PathBuf> {
    let folder = |which| git(tree, &["rev-parse", which]).map(|folder| tree.join(folder));
    let mut watched = Vec::new();
    if let Some(own) = folder("--git-dir") {
        watched.extend(["HEAD", "logs/HEAD"].map(|name| own.join(name)));
    }
    if let Some(shared) = folder("--git-common-dir") {
        watched.push(shared.join("packed-refs"));
        let branch = git(tree, &["rev-parse", "--symbolic-full-name", "HEAD"]);
        watched.extend(branch.map(|branch| shared.join(branch)));
    }
    watched
}

fn commit(tree: &Path) -> Option<String> {
    git(tree, &["rev-parse", "HEAD"]).filter(|hash| !hash.is_empty())
}

/// Returns whether a source file differs from the commit or is not part of it; `None` if git cannot tell.
fn dirty(tree: &Path, sources: &[PathBuf]) -> Option<bool> {
    let mut arguments = vec!["status", "--porcelain", "--"];
    arguments.extend(sources.iter().filter_map(|path| path.to_str()));
    git(tree, &arguments).map(|changes| !changes.is_empty())
}

/// Runs git in this tree and returns its output. `None` if git fails, or if the tree has no `.git` of its own: a tree
/// inside of another repository has no commit.
fn git(tree: &Path, arguments: &[&str]) -> Option<String> {
    if !tree.join(".git").exists() {
        return None;
    }
    let mut git = Command::new("git");
    // A query must not write the index. The variables that a git hook sets refer to another repository.
    git.arg("--no-optional-locks").args(arguments).current_dir(tree);
    for name in ["GIT_DIR", "GIT_WORK_TREE", "GIT_INDEX_FILE"] {
        git.env_remove(name);
    }
    command_output(&mut git)
}

/// Returns the trimmed standard output of a command; `None` if it is not installed, fails or prints invalid UTF-8.
fn command_output(command: &mut Command) -> Option<String> {
    let output = command.output().ok().filter(|output| output.status.success())?;
    String::from_utf8(output.stdout).ok().map(|text| text.trim().to_owned())
}
