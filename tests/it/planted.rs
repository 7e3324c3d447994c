//! Patches of `tests/planted/run`, each of which plants one defect in the code.

use std::collections::BTreeSet;
use std::path::Path;
use std::process::Command;

use crate::harness::{ExitsWith, ROOT, files_below};

/// Folder of the patches, relative to the root of the repository.
const FOLDER: &str = "tests/planted";

/// If this fails, the code around a defect has changed. Apply the change that the patch describes to the new code, and
/// replace the patch: its first line, an empty line, and `git diff -U2`.
#[test]
fn patches_of_planted_defects_apply() {
    let patches = files_below(&Path::new(ROOT).join(FOLDER));
    let is_patch = |path: &&std::path::PathBuf| path.extension().is_some_and(|end| end == "patch");
    let mut names = BTreeSet::new();
    for patch in patches.iter().filter(is_patch) {
        let mut git = Command::new("git");
        git.args(["apply", "--check"]).arg(patch).current_dir(ROOT).exits_with(0);
        names.insert(patch.file_stem().unwrap().to_str().unwrap().to_owned());
    }
    // A row of `DEFECTS` starts with the name of the defect in quotes.
    let script = std::fs::read_to_string(Path::new(ROOT).join(FOLDER).join("run")).unwrap();
    let rows = script.lines().filter_map(|line| line.strip_prefix("    (\"")?.split_once('"'));
    let listed: BTreeSet<String> = rows.map(|(name, _)| name.to_owned()).collect();
    assert_eq!(names, listed, "each defect of {FOLDER}/run has a patch, and each patch a row");
    assert!(names.len() >= 10, "{names:?}");
}
