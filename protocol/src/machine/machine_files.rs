//! Simulated system files (`/proc`, `/sys`) for tests of this crate.

use std::fs;

use tempfile::TempDir;

/// Creates a directory with these files, given as names and texts. It is used in place of `/`.
pub(crate) fn create_machine_files(files: &[(&str, &str)]) -> TempDir {
    let root = tempfile::tempdir().unwrap();
    for (name, text) in files {
        let path = root.path().join(name);
        fs::create_dir_all(path.parent().unwrap()).unwrap();
        fs::write(path, format!("{text}\n")).unwrap();
    }
    root
}
