//! Safe reading of small, regular UTF-8 files, and checks that a file is inside its folder.

use std::fs::File;
use std::io;
use std::path::Path;

use protocol::regular_file::{self, SymlinkPolicy};

use super::diagnostic::Diagnostic;

/// Maximum file size, bytes. Sufficient for 256 robots with edges between all, and for 1,024 with 100 in-neighbors
/// each.
pub const FILE_BYTES_MAX: u64 = 8 << 20;

/// Reason why a file cannot be read.
pub struct FileError {
    /// Problem, as a predicate that follows the file name.
    pub problem: String,
    /// Remedy, as a sentence of the diagnostic.
    pub remedy: &'static str,
}

impl FileError {
    /// Returns a diagnostic about the file, without a line.
    pub fn into_diagnostic(self, path: &Path) -> Diagnostic {
        Diagnostic::without_location(format!("`{}` {}", path.display(), self.problem), self.remedy)
    }
}

/// Checks that `path`, which is in `folder`, exists and is not a symbolic link out of `folder`. Such a link could make
/// an untrusted folder read any file of the user.
pub fn check_inside_folder(folder: &Path, path: &Path) -> io::Result<()> {
    let folder = if folder.as_os_str().is_empty() { Path::new(".") } else { folder };
    let (folder, target) = (folder.canonicalize()?, path.canonicalize()?);
    if target.starts_with(&folder) {
        return Ok(());
    }
    let (folder, target) = (folder.display(), target.display());
    Err(io::Error::other(format!("it is a link to {target}, which is outside of {folder}")))
}

/// Opens a regular file that [`check_inside_folder`] its folder. Fails for pipes, devices and folders.
pub fn open_inside_folder(folder: &Path, name: &str) -> io::Result<File> {
    let path = folder.join(name);
    check_inside_folder(folder, &path)?;
    regular_file::open(&path, SymlinkPolicy::Followed)
}

/// Reads a file with [`open_inside_folder`]. Fails if it has more than `bytes_max` bytes.
pub fn read_inside_folder(folder: &Path, name: &str, bytes_max: u64) -> io::Result<Vec<u8>> {
    regular_file::read_rest(&open_inside_folder(folder, name)?, bytes_max)
}

/// Returns the text of a file. `expected` is the remedy if there is no such file.
pub fn load_text(path: &Path, expected: &'static str) -> Result<String, FileError> {
    String::from_utf8(load_bytes(path, expected)?).map_err(|error| {
        let at = error.utf8_error().valid_up_to();
        let line = error.as_bytes()[..at].iter().filter(|&&byte| byte == b'\n').count() + 1;
        let byte = error.as_bytes()[at];
        FileError {
            problem: format!("is not UTF-8: byte 0x{byte:02x} at offset {at}, on line {line}"),
            remedy: "expected UTF-8 text",
        }
    })
}

/// Returns the bytes of a file. Fails in the same cases as [`load_text`], except for invalid UTF-8.
pub fn load_bytes(path: &Path, expected: &'static str) -> Result<Vec<u8>, FileError> {
    let file_error = |problem: String| FileError { problem, remedy: expected };
    let cannot_read = |error: std::io::Error| match error.kind() {
        std::io::ErrorKind::NotFound => file_error("does not exist".into()),
        std::io::ErrorKind::PermissionDenied => file_error("may not be read by this user".into()),
        _ => file_error(format!("cannot be read: {error}")),
    };
    let metadata = std::fs::metadata(path).map_err(cannot_read)?;
    if metadata.is_dir() {
        return Err(file_error("is a directory".into()));
    }
    if !metadata.is_file() {
        return Err(file_error("is not a regular file".into()));
    }
    let too_large = |bytes: u64| FileError {
        problem: format!("has {bytes} bytes"),
        remedy: "expected at most 8 MiB",
    };
    if metadata.len() > FILE_BYTES_MAX {
        return Err(too_large(metadata.len()));
    }
    // The file may have grown in the meantime.
    regular_file::read(path, SymlinkPolicy::Followed, FILE_BYTES_MAX).map_err(cannot_read)
}
