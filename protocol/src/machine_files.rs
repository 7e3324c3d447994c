//! For tests of this crate and of `supervisor`: a machine of files.

use std::fs;

use tempfile::TempDir;

/// A machine's files, made of their names and texts. Their root takes the place of `/`.
pub(crate) fn machine(files: &[(&str, &str)]) -> TempDir {
    let root = tempfile::tempdir().unwrap();
    for (name, text) in files {
        let path = root.path().join(name);
        fs::create_dir_all(path.parent().unwrap()).unwrap();
        fs::write(path, format!("{text}\n")).unwrap();
    }
    root
}
