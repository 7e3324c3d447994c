//! File whose disk space is allocated at the beginning and whose content is written at the end, even if the disk is
//! full by then. It becomes visible only when it is complete.

use std::fs::{self, File};
use std::io::{self, Write};
use std::os::unix::fs::FileExt;
use std::path::{Path, PathBuf};

use rustix::fs::{FallocateFlags, fallocate};
use rustix::io::Errno;

/// Allocated space of a file that does not exist yet. Dropping it frees the space.
#[derive(Debug)]
pub struct ReservedFile {
    path: PathBuf,
    /// Temporary name until the file is complete.
    temporary_path: PathBuf,
    file: File,
}

impl ReservedFile {
    /// Allocates `bytes` bytes for the file `path`, under a temporary name next to it.
    pub fn create(path: &Path, bytes: u64) -> io::Result<ReservedFile> {
        let mut part = path.as_os_str().to_owned();
        part.push(".part");
        let file = File::create_new(&part)?;
        let mut reserved = ReservedFile { path: path.into(), temporary_path: part.into(), file };
        match fallocate(&reserved.file, FallocateFlags::empty(), 0, bytes) {
            Ok(()) => {}
            // The file system does not support allocation; on nearly all of them, written data keeps its space.
            Err(Errno::OPNOTSUPP | Errno::NOSYS | Errno::INTR) => {
                reserved.file.write_all(&vec![0; bytes as usize])?;
            }
            Err(error) => return Err(error.into()),
        }
        Ok(reserved)
    }

    /// Writes the content and renames the file to its final name.
    pub fn fill(self, content: &[u8]) -> io::Result<()> {
        self.file.write_all_at(content, 0)?;
        self.file.set_len(content.len() as u64)?;
        fs::rename(&self.temporary_path, &self.path)
    }
}

impl Drop for ReservedFile {
    fn drop(&mut self) {
        // After the rename there is no file of this name.
        let _ = fs::remove_file(&self.temporary_path);
    }
}
