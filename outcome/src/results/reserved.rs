//! A file whose room on the disk is taken at the beginning, and whose content comes at the end: it is
//! written even if the disk is full by then. Nobody sees it before it is whole.

use std::fs::{self, File};
use std::io::{self, Write};
use std::os::unix::fs::FileExt;
use std::path::{Path, PathBuf};

use rustix::fs::{FallocateFlags, fallocate};
use rustix::io::Errno;

/// Room for a file that is not there yet. Dropped, the room is given back.
#[derive(Debug)]
pub struct Reserved {
    path: PathBuf,
    /// What it is called until it is whole.
    part: PathBuf,
    file: File,
}

impl Reserved {
    /// Takes so much room for a file at `path`, beside it.
    pub fn create(path: &Path, bytes: u64) -> io::Result<Reserved> {
        let mut part = path.as_os_str().to_owned();
        part.push(".part");
        let file = File::create_new(&part)?;
        let mut reserved = Reserved { path: path.into(), part: part.into(), file };
        match fallocate(&reserved.file, FallocateFlags::empty(), 0, bytes) {
            Ok(()) => {}
            // A file system that cannot: what was written once has room on nearly all of them.
            Err(Errno::OPNOTSUPP | Errno::NOSYS | Errno::INTR) => {
                reserved.file.write_all(&vec![0; bytes as usize])?;
            }
            Err(error) => return Err(error.into()),
        }
        Ok(reserved)
    }

    /// Writes the file.
    pub fn fill(self, content: &[u8]) -> io::Result<()> {
        self.file.write_all_at(content, 0)?;
        self.file.set_len(content.len() as u64)?;
        fs::rename(&self.part, &self.path)
    }
}

impl Drop for Reserved {
    fn drop(&mut self) {
        // After the rename there is nothing of that name.
        let _ = fs::remove_file(&self.part);
    }
}
