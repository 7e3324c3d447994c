//! A scratch folder outside of a run root that goes with it: `phalanx verify` writes its second run beside the first, where there
//! is room. The run root names the folder, and the folder names the run root: if the process is killed, the next run and `phalanx
//! clean` find the folder by the run root whose lock is free.
//!
//! Must not: remove a folder that does not name the run root.

use std::fs;
use std::io::{self, Write as _};
use std::os::unix::ffi::{OsStrExt as _, OsStringExt as _};
use std::path::{Path, PathBuf};

use crate::regular_file::{self, Links};

/// The file in a run root that holds the path of its scratch folder.
const NOTE: &str = "scratch";
/// The file in a scratch folder that holds the path of its run root.
const OWNER: &str = ".phalanx-scratch";
/// Maximum length of a path in either file, bytes.
const PATH_BYTES_MAX: u64 = 1 << 13;

/// Makes the folder, which must not exist, as the scratch folder of a run root.
///
/// # Errors
///
/// The folder exists or cannot be made; the run root has a scratch folder.
pub fn make(run_root: &Path, folder: &Path) -> io::Result<()> {
    let folder = std::path::absolute(folder)?;
    // First the note: of what is not noted nothing may be left.
    fs::File::create_new(run_root.join(NOTE))?.write_all(folder.as_os_str().as_bytes())?;
    fs::create_dir(&folder)?;
    fs::write(folder.join(OWNER), run_root.as_os_str().as_bytes())
}

/// Returns the scratch folder of a run root, if it has one that is still there.
pub fn find(run_root: &Path) -> Option<PathBuf> {
    let folder = path_in(&run_root.join(NOTE))?;
    let is_folder = fs::symlink_metadata(&folder).is_ok_and(|found| found.is_dir());
    (is_folder && path_in(&folder.join(OWNER)).as_deref() == Some(run_root)).then_some(folder)
}

/// Removes the scratch folder of a run root, if it has one.
pub fn remove(run_root: &Path) -> io::Result<()> {
    let Some(folder) = find(run_root) else { return Ok(()) };
    // Its owner's name goes last: if this process is killed, the folder is found again.
    for entry in fs::read_dir(&folder)? {
        let entry = entry?;
        match entry.file_type()?.is_dir() {
            true => fs::remove_dir_all(entry.path())?,
            false if entry.file_name() != OWNER => fs::remove_file(entry.path())?,
            false => {}
        }
    }
    fs::remove_file(folder.join(OWNER))?;
    fs::remove_dir(folder)
}

/// Returns the absolute path that a file holds.
fn path_in(file: &Path) -> Option<PathBuf> {
    let bytes = regular_file::read(file, Links::Refused, PATH_BYTES_MAX).ok()?;
    Some(PathBuf::from(std::ffi::OsString::from_vec(bytes))).filter(|path| path.is_absolute())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_a_folder_that_names_the_run_root_is_removed() {
        let place = tempfile::tempdir().unwrap();
        let [root, other, folder] =
            ["root", "other", "run-again"].map(|name| place.path().join(name));
        fs::create_dir(&root).unwrap();
        fs::create_dir(&other).unwrap();
        assert_eq!(find(&root), None);
        make(&root, &folder).unwrap();
        fs::create_dir_all(folder.join("run/logs")).unwrap();
        assert!(make(&other, &folder).is_err(), "the folder is there");
        assert_eq!(find(&other), None, "it is of another root");
        remove(&other).unwrap();
        assert!(folder.join("run/logs").exists());
        assert_eq!(find(&root), Some(folder.clone()));
        remove(&root).unwrap();
        assert!(!folder.exists());
        remove(&root).unwrap();
        // A folder of the same name that is not ours.
        fs::create_dir(&folder).unwrap();
        remove(&root).unwrap();
        assert!(folder.exists());
    }
}
