//! Plain pipes with names, for values of one fixed size each.

use std::fs::{File, OpenOptions};
use std::io::{self, Read as _, Write as _};
use std::os::unix::fs::OpenOptionsExt as _;
use std::path::Path;

use rustix::fs::{CWD, FileType, Mode, OFlags, fcntl_setfl, mknodat};

use crate::mapping::Plain;
use crate::{BenchError, failed};

/// Makes a named pipe.
pub(crate) fn make(path: &Path) -> Result<(), BenchError> {
    mknodat(CWD, path, FileType::Fifo, Mode::RUSR | Mode::WUSR, 0)
        .map_err(|error| failed("make", path)(error.into()))
}

/// Opens a named pipe for both directions, so that nobody waits for the other end to open.
pub(crate) fn open(path: &Path) -> Result<File, BenchError> {
    OpenOptions::new().read(true).write(true).open(path).map_err(failed("open", path))
}

/// Opens it for reading alone: a read ends when the last writer has gone.
pub(crate) fn open_for_reading(path: &Path) -> Result<File, BenchError> {
    let nonblocking = OFlags::NONBLOCK.bits() as i32;
    let open = || {
        let file = OpenOptions::new().read(true).custom_flags(nonblocking).open(path)?;
        fcntl_setfl(&file, OFlags::empty())?;
        Ok(file)
    };
    open().map_err(failed("open", path))
}

/// Opens it for writing alone, once somebody reads.
pub(crate) fn open_for_writing(path: &Path) -> Result<File, BenchError> {
    OpenOptions::new().write(true).open(path).map_err(failed("open", path))
}

/// Writes a value in one piece: all are smaller than what a pipe takes at once.
pub(crate) fn write<T: Plain>(mut pipe: &File, value: &T) -> io::Result<()> {
    pipe.write_all(bytes(value))
}

/// Reads a value.
pub(crate) fn read<T: Plain + Default>(mut pipe: &File) -> io::Result<T> {
    let mut value = T::default();
    pipe.read_exact(bytes_mut(&mut value))?;
    Ok(value)
}

/// A value's bytes.
pub(crate) fn bytes<T: Plain>(value: &T) -> &[u8] {
    // SAFETY: `Plain`: no padding, so every byte is initialized.
    unsafe { std::slice::from_raw_parts(std::ptr::from_ref(value).cast(), size_of::<T>()) }
}

/// A value's bytes, to be written.
pub(crate) fn bytes_mut<T: Plain>(value: &mut T) -> &mut [u8] {
    // SAFETY: `Plain`: any bytes are a value.
    unsafe { std::slice::from_raw_parts_mut(std::ptr::from_mut(value).cast(), size_of::<T>()) }
}
