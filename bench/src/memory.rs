//! Plain shared memory: a file on tmpfs that several processes map as an array.

use std::cell::UnsafeCell;
use std::fs::{File, OpenOptions};
use std::io;
use std::marker::PhantomData;
use std::os::unix::fs::OpenOptionsExt as _;
use std::path::Path;
use std::ptr::NonNull;
use std::sync::atomic::AtomicU32;

use anyhow::Context as _;
use protocol::message::Plain;
use rustix::mm::{MapFlags, ProtFlags};

/// A value on cache lines of its own. At most one process writes it at a time.
#[repr(C, align(128))]
pub(crate) struct CacheAligned<T>(UnsafeCell<T>);

impl<T: Plain> CacheAligned<T> {
    /// Reads the value. The writer must have signaled before that the write is complete.
    pub(crate) fn read(&self) -> T {
        // SAFETY: any bytes are a valid value of a `Plain` type; a futex word signals when the write is complete.
        unsafe { self.0.get().read_volatile() }
    }

    /// Writes the value. No process reads it until the writer signals that the write is complete.
    pub(crate) fn write(&self, value: T) {
        // SAFETY: the value is behind an `UnsafeCell`, in memory mapped for writing.
        unsafe { self.0.get().write_volatile(value) }
    }
}

/// A futex word on cache lines of its own.
#[repr(C, align(128))]
pub(crate) struct FutexWord(pub(crate) AtomicU32);

/// A shared memory mapping that holds an array of `T`. Dropping it removes the mapping, but not the file.
pub(crate) struct Mapping<T> {
    memory: NonNull<T>,
    count: usize,
    shared: PhantomData<T>,
}

impl<T> Mapping<T> {
    /// Maps `count` values of a file. Creates the file, filled with zeros, if it is missing.
    ///
    /// # Errors
    /// If the file cannot be opened, resized or mapped.
    ///
    /// # Safety
    /// All-zero bytes must be a valid value of `T`.
    pub(crate) unsafe fn new(path: &Path, count: usize) -> anyhow::Result<Mapping<T>> {
        let bytes = count * size_of::<T>();
        let open = || -> io::Result<File> {
            let mut options = OpenOptions::new();
            options.read(true).write(true).create(true).truncate(false).mode(0o600);
            let file = options.open(path)?;
            file.set_len(bytes as u64)?;
            Ok(file)
        };
        let error_context = || format!("cannot map {}", path.display());
        let file = open().with_context(error_context)?;
        let access = ProtFlags::READ | ProtFlags::WRITE;
        let address = std::ptr::null_mut();
        // SAFETY: a new mapping at an address that the kernel chooses.
        let memory =
            unsafe { rustix::mm::mmap(address, bytes, access, MapFlags::SHARED, &file, 0) };
        let memory = memory.with_context(error_context)?.cast();
        let memory =
            NonNull::new(memory).expect("the kernel does not choose address 0 for a mapping");
        Ok(Mapping { memory, count, shared: PhantomData })
    }
}

impl<T> std::ops::Deref for Mapping<T> {
    type Target = [T];

    fn deref(&self) -> &[T] {
        // SAFETY: `count` zeroed or written values are mapped as long as `self` lives.
        unsafe { std::slice::from_raw_parts(self.memory.as_ptr(), self.count) }
    }
}

impl<T> Drop for Mapping<T> {
    fn drop(&mut self) {
        let bytes = self.count * size_of::<T>();
        // SAFETY: `new` mapped this length; no reference outlives `self`.
        let _ = unsafe { rustix::mm::munmap(self.memory.as_ptr().cast(), bytes) };
    }
}
