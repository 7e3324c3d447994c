//! Scratch folder outside of a run root that is removed with it: `phalanx verify` writes its second run next to
//! the first one, where there is space. Run root and folder hold each other's path: if the process is killed, the
//! next run and `phalanx clean` find the folder through the run root whose lock is free.
//!
//! Must not: remove a folder that does not hold the path of the run root.

use std::fs;
use std::io::{self, Write as _};
use std::os::unix::ffi::{OsStrExt as _, OsStringExt as _};
use std::path::{Path, PathBuf};

use crate::regular_file::{self, SymlinkPolicy};

/// Name of the file in a run root with the path of its scratch folder.
const PATH_FILE_NAME: &str = "scratch";
/// Name of the file in a scratch folder with the path of its run root.
const OWNER_FILE_NAME: &str = ".phalanx-scratch";
/// Maximum length of a path in either file, bytes.
const PATH_BYTES_MAX: u64 = 1 << 13;

/// Creates the scratch folder of a run root.
///
/// # Errors
///
/// The folder exists or cannot be created, or the run root already has a scratch folder.
pub fn create(run_root: &Path, folder: &Path) -> io::Result<()> {
    let folder = std::path::absolute(folder)?;
    // The path is recorded first, so that no folder is ever left unrecorded.
    fs::File::create_new(run_root.join(PATH_FILE_NAME))?
        .write_all(folder.as_os_str().as_bytes())?;
    fs::create_dir(&folder)?;
    fs::write(folder.join(OWNER_FILE_NAME), run_root.as_os_str().as_bytes())
}

/// Returns the scratch folder of a run root, if it exists.
pub fn find(run_root: &Path) -> Option<PathBuf> {
    let folder = read_path(&run_root.join(PATH_FILE_NAME))?;
    let is_folder = fs::symlink_metadata(&folder).is_ok_and(|metadata| metadata.is_dir());
    (is_folder && read_path(&folder.join(OWNER_FILE_NAME)).as_deref() == Some(run_root))
        .then_some(folder)
}

/// Removes the scratch folder of a run root, if it has one.
pub fn remove(run_root: &Path) -> io::Result<()> {
    let Some(folder) = find(run_root) else { return Ok(()) };
    // The owner file is removed last: if this process is killed, the folder is still found.
    for entry in fs::read_dir(&folder)? {
        let entry = entry?;
        match entry.file_type()?.is_dir() {
            true => fs::remove_dir_all(entry.path())?,
            false if entry.file_name() != OWNER_FILE_NAME => fs::remove_file(entry.path())?,
            false => {}
        }
    }
    fs::remove_file(folder.join(OWNER_FILE_NAME))?;
    fs::remove_dir(folder)
}

/// Reads the absolute path in a file; `None` if there is none.
fn read_path(file: &Path) -> Option<PathBuf> {
    let bytes = regular_file::read(file, SymlinkPolicy::Refused, PATH_BYTES_MAX).ok()?;
    Some(PathBuf::from(std::ffi::OsString::from_vec(bytes))).filter(|path| path.is_absolute())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn scratch_folder_of_another_process_is_kept() {
        let parent = tempfile::tempdir().unwrap();
        let [root, other, folder] =
            ["root", "other", "run-again"].map(|name| parent.path().join(name));
        fs::create_dir(&root).unwrap();
        fs::create_dir(&other).unwrap();
        assert_eq!(find(&root), None);
        create(&root, &folder).unwrap();
        fs::create_dir_all(folder.join("run/logs")).unwrap();
        assert!(create(&other, &folder).is_err(), "the folder is there");
        assert_eq!(find(&other), None, "it is of another root");
        remove(&other).unwrap();
        assert!(folder.join("run/logs").exists());
        assert_eq!(find(&root), Some(folder.clone()));
        remove(&root).unwrap();
        assert!(!folder.exists());
        remove(&root).unwrap();
        // A folder with the same name and no owner file.
        fs::create_dir(&folder).unwrap();
        remove(&root).unwrap();
        assert!(folder.exists());
    }
}
