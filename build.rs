//! What is embedded in the binary about its own build: commit, whether the sources differ from it,
//! compiler and profile. Runs again when a source or the commit changes, and only then; the index
//! of git is of no account, for sources are compared with the commit.
//!
//! Must not: need git, a repository or a network. What is not known is an empty word.

use std::env;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;

fn main() {
    let tree = PathBuf::from(env::var_os("CARGO_MANIFEST_DIR").expect("cargo says where it is"));
    let sources = sources(&tree);
    let commit = commit(&tree);
    // A path that is missing would have this run at every build.
    for path in sources.iter().chain(&watched(&tree)).filter(|path| path.exists()) {
        println!("cargo::rerun-if-changed={}", path.display());
    }
    let dirty = commit.as_ref().and_then(|_| dirty(&tree, &sources));
    embed("GIT_HASH", commit);
    embed("GIT_DIRTY", dirty.map(|dirty| dirty.to_string()));
    let rustc = env::var_os("RUSTC").unwrap_or("rustc".into());
    embed("RUSTC", output_of(Command::new(rustc).arg("--version")));
    embed("PROFILE", profile());
}

/// The profile's folder, as in `target/dist/build/phalanx-0/out`: cargo's own `PROFILE` only says
/// which of its two it is made of.
fn profile() -> Option<String> {
    let out = PathBuf::from(env::var_os("OUT_DIR")?);
    Some(out.ancestors().nth(3)?.file_name()?.to_str()?.to_owned())
}

fn embed(name: &str, value: Option<String>) {
    println!("cargo::rustc-env=PHALANX_{name}={}", value.unwrap_or_default());
}

/// What the program is made of: this package, and every crate in a folder beside it.
fn sources(tree: &Path) -> Vec<PathBuf> {
    let mut sources =
        ["Cargo.toml", "Cargo.lock", "build.rs", "src"].map(|name| tree.join(name)).to_vec();
    let folders = fs::read_dir(tree).into_iter().flatten().flatten().map(|entry| entry.path());
    let crates = folders.filter(|folder| folder.join("Cargo.toml").exists());
    // The other bindings are made of this program, not the other way round.
    for folder in crates.chain([tree.join("bindings/bridge")]) {
        sources.extend(["Cargo.toml", "src", "assets"].map(|name| folder.join(name)));
    }
    sources.retain(|path| path.exists());
    sources.sort();
    sources
}

/// What changes with the commit that is checked out.
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

/// Whether a source differs from the commit, or is not in it.
fn dirty(tree: &Path, sources: &[PathBuf]) -> Option<bool> {
    let mut words = vec!["status", "--porcelain", "--"];
    words.extend(sources.iter().filter_map(|path| path.to_str()));
    git(tree, &words).map(|changes| !changes.is_empty())
}

/// What git says about this tree. One within another's repository has no commit of its own.
fn git(tree: &Path, words: &[&str]) -> Option<String> {
    if !tree.join(".git").exists() {
        return None;
    }
    let mut git = Command::new("git");
    // Looking must not write the index. A hook's variables are about another repository.
    git.arg("--no-optional-locks").args(words).current_dir(tree);
    for name in ["GIT_DIR", "GIT_WORK_TREE", "GIT_INDEX_FILE"] {
        git.env_remove(name);
    }
    output_of(&mut git)
}

/// What a command prints, if it is there and succeeds.
fn output_of(command: &mut Command) -> Option<String> {
    let output = command.output().ok().filter(|output| output.status.success())?;
    String::from_utf8(output.stdout).ok().map(|text| text.trim().to_owned())
}
