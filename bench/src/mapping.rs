//! Plain shared memory: a file on tmpfs, mapped by several processes as an array.

use std::cell::UnsafeCell;
use std::fs::OpenOptions;
use std::io;
use std::marker::PhantomData;
use std::os::unix::fs::OpenOptionsExt as _;
use std::path::Path;
use std::ptr::NonNull;
use std::sync::atomic::AtomicU32;

use protocol::message::{Beacon, Command, Odometry};
use rustix::mm::{MapFlags, ProtFlags};

use crate::{BenchError, failed};

/// What may lie in shared memory and cross a pipe.
///
/// # Safety
/// Any bytes, zeros above all, are a value; there is no padding and no pointer in it.
pub(crate) unsafe trait Plain {}

// SAFETY: `#[repr(C)]` of 8-byte numbers, with 4-byte ones in pairs.
unsafe impl Plain for Odometry {}
// SAFETY: as above.
unsafe impl Plain for Command {}
// SAFETY: as above.
unsafe impl Plain for Beacon {}

/// What is written by one process at a time, and alone on its cache lines.
#[repr(C, align(128))]
pub(crate) struct Line<T>(UnsafeCell<T>);

impl<T: Plain + Copy> Line<T> {
    /// Reads it; whoever writes it must have said that it is written.
    pub(crate) fn read(&self) -> T {
        // SAFETY: `Plain`: any bytes are a value; a word says when it is whole.
        unsafe { self.0.get().read_volatile() }
    }

    /// Writes it; nobody reads it until told.
    pub(crate) fn write(&self, value: T) {
        // SAFETY: behind an `UnsafeCell`, in memory mapped for writing.
        unsafe { self.0.get().write_volatile(value) }
    }
}

/// A word to wait on, alone on its cache lines.
#[repr(C, align(128))]
pub(crate) struct Word(pub(crate) AtomicU32);

/// `count` values of `T`, shared.
pub(crate) struct Mapping<T> {
    memory: NonNull<T>,
    count: usize,
    shared: PhantomData<T>,
}

impl<T> Mapping<T> {
    /// Maps the file, which is made if it is missing; zeros at first.
    ///
    /// # Safety
    /// Zeros must be a value of `T`.
    pub(crate) unsafe fn new(path: &Path, count: usize) -> Result<Mapping<T>, BenchError> {
        let map = || -> io::Result<NonNull<T>> {
            let bytes = count * size_of::<T>();
            let file = OpenOptions::new()
                .read(true)
                .write(true)
                .create(true)
                .truncate(false)
                .mode(0o600)
                .open(path)?;
            file.set_len(bytes as u64)?;
            // SAFETY: a fresh mapping at an address of the kernel's choice.
            let memory = unsafe {
                let access = ProtFlags::READ | ProtFlags::WRITE;
                rustix::mm::mmap(std::ptr::null_mut(), bytes, access, MapFlags::SHARED, &file, 0)?
            };
            Ok(NonNull::new(memory.cast()).expect("the kernel maps nothing at 0 unasked"))
        };
        let memory = map().map_err(failed("map", path))?;
        Ok(Mapping { memory, count, shared: PhantomData })
    }
}

impl<T> std::ops::Deref for Mapping<T> {
    type Target = [T];

    fn deref(&self) -> &[T] {
        // SAFETY: mapped with this many zeroed or written values, for as long as `self` lives.
        unsafe { std::slice::from_raw_parts(self.memory.as_ptr(), self.count) }
    }
}

impl<T> Drop for Mapping<T> {
    fn drop(&mut self) {
        let bytes = self.count * size_of::<T>();
        // SAFETY: mapped with this length by `new`; no reference outlives `self`.
        let _ = unsafe { rustix::mm::munmap(self.memory.as_ptr().cast(), bytes) };
    }
}
