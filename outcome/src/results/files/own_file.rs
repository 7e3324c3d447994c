//! Opening of existing files for further writing, in folders that may have been changed meanwhile: locks, journals,
//! lists.

use std::fs::{File, OpenOptions};
use std::io;
use std::os::unix::fs::OpenOptionsExt as _;
use std::path::Path;

use protocol::regular_file::check_is_regular;
use rustix::fs::OFlags;

/// Opens a regular file for reading and writing, and creates it if it does not exist. Its content is kept.
///
/// # Errors
///
/// The file is a symbolic link, named pipe, socket, device or directory, or cannot be opened.
pub fn open_regular_file(path: &Path) -> io::Result<File> {
    let mut options = OpenOptions::new();
    options.create(true).read(true).write(true).truncate(false);
    // Opening a pipe must not block.
    options.custom_flags((OFlags::NOFOLLOW | OFlags::NONBLOCK).bits() as i32);
    let file = options.open(path).map_err(|error| match path.symlink_metadata() {
        Ok(found) => check_is_regular(&found).err().unwrap_or(error),
        Err(_) => error,
    })?;
    check_is_regular(&file.metadata()?)?;
    Ok(file)
}
