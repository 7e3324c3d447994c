//! Plain shared memory: a file on tmpfs, mapped by several processes as an array.

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

/// Value that one process at a time writes, on cache lines of its own.
#[repr(C, align(128))]
pub(crate) struct Line<T>(UnsafeCell<T>);

impl<T: Plain> Line<T> {
    /// Reads the value. The writer must have announced it, through a counter, before.
    pub(crate) fn read(&self) -> T {
        // SAFETY: `Plain`: any bytes are a value; a counter tells when it is complete.
        unsafe { self.0.get().read_volatile() }
    }

    /// Writes the value. No process reads it until a counter announces it.
    pub(crate) fn write(&self, value: T) {
        // SAFETY: behind an `UnsafeCell`, in memory mapped for writing.
        unsafe { self.0.get().write_volatile(value) }
    }
}

/// Futex word, on cache lines of its own.
#[repr(C, align(128))]
pub(crate) struct FutexWord(pub(crate) AtomicU32);

/// Array of `count` shared values of `T`.
pub(crate) struct Mapping<T> {
    memory: NonNull<T>,
    count: usize,
    shared: PhantomData<T>,
}

impl<T> Mapping<T> {
    /// Maps the file, and creates it with zeros if it does not exist.
    ///
    /// # Errors
    /// The file cannot be created or mapped.
    ///
    /// # Safety
    /// Zeros must be a value of `T`.
    pub(crate) unsafe fn new(path: &Path, count: usize) -> anyhow::Result<Mapping<T>> {
        let bytes = count * size_of::<T>();
        let open = || -> io::Result<File> {
            let mut options = OpenOptions::new();
            options.read(true).write(true).create(true).truncate(false).mode(0o600);
            let file = options.open(path)?;
            file.set_len(bytes as u64)?;
            Ok(file)
        };
        let cannot = || format!("cannot map {}", path.display());
        let file = open().with_context(cannot)?;
        let access = ProtFlags::READ | ProtFlags::WRITE;
        let anywhere = std::ptr::null_mut();
        // SAFETY: a fresh mapping at an address of the kernel's choice.
        let memory =
            unsafe { rustix::mm::mmap(anywhere, bytes, access, MapFlags::SHARED, &file, 0) };
        let memory = memory.with_context(cannot)?.cast();
        let memory = NonNull::new(memory).expect("the kernel maps nothing at 0 unasked");
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
