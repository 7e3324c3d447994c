//! Creation and checked opening of the barrier's file.

use std::fs::{File, OpenOptions};
use std::io;
use std::os::unix::fs::OpenOptionsExt as _;
use std::path::{Path, PathBuf};
use std::ptr::NonNull;
use std::sync::atomic::Ordering::SeqCst;
use std::time::Duration;

use rustix::io::Errno;
use rustix::mm::{MapFlags, ProtFlags};

use super::futex::AtomicU32;
use super::layout::{BarrierHeader, MAGIC, NEVER_TICK, VERSION, file_size_bytes};
use super::{Barrier, GROUPS_MAX, SLOTS_MAX};

/// Failure to create or open a barrier.
#[derive(Debug, thiserror::Error)]
#[expect(missing_docs, reason = "the messages say what the fields are")]
pub enum BarrierError {
    /// The file or its mapping failed.
    #[error("cannot {action} the barrier {path}: {source}")]
    Io { action: &'static str, path: PathBuf, source: io::Error },
    /// The number of slots is 0 or more than [`SLOTS_MAX`].
    #[error("a barrier with {slots} slots: expected 1 to {SLOTS_MAX} slots")]
    InvalidSlotCount { slots: usize },
    /// The file is not a barrier of this version.
    #[error(
        "{path} is not a barrier of this version: {found}; start all processes from the same build"
    )]
    ForeignFile { path: PathBuf, found: String },
}

impl Barrier {
    /// Creates the mapping, with no members, not paused, and no ticks consumed. Slot i is in group i mod
    /// `groups`, where `groups` is 1 to [`GROUPS_MAX`]. Only the supervisor calls this. A process with a pending
    /// response for `hung_timeout` counts as hung.
    pub fn create(
        path: &Path,
        slots: usize,
        groups: usize,
        hung_timeout: Duration,
    ) -> Result<Barrier, BarrierError> {
        if slots == 0 || slots > SLOTS_MAX {
            return Err(BarrierError::InvalidSlotCount { slots });
        }
        let groups = groups.clamp(1, GROUPS_MAX.min(slots));
        let bytes = file_size_bytes(slots);
        let io_error =
            |action, source: io::Error| BarrierError::Io { action, path: path.into(), source };
        let unfinished = path.with_extension("new");
        let file = OpenOptions::new()
            .read(true)
            .write(true)
            .create_new(true)
            .mode(0o600)
            .open(&unfinished)
            .map_err(|source| io_error("make", source))?;
        file.set_len(bytes as u64).map_err(|source| io_error("size", source))?;
        // Allocates the memory now, so that a full tmpfs is an error here instead of a SIGBUS later.
        match rustix::fs::fallocate(&file, rustix::fs::FallocateFlags::empty(), 0, bytes as u64) {
            Ok(()) | Err(Errno::OPNOTSUPP) => {}
            Err(error) => return Err(io_error("allocate", error.into())),
        }
        let memory = map_file(&file, bytes).map_err(|source| io_error("map", source))?;
        let seen_attention_count = AtomicU32::new(0);
        let barrier =
            Barrier { memory, size_bytes: bytes, slots, groups, seen_attention_count, alarm: None };
        // SAFETY: the mapping is large and aligned enough for `Head`, and no other process has it yet.
        unsafe {
            let head = memory.cast::<BarrierHeader>().as_ptr();
            (*head).magic = MAGIC;
            (*head).version = VERSION;
            (*head).slots = slots as u32;
            (*head).groups = groups as u32;
            (*head).supervisor = std::process::id();
            (*head).hung_after_ms = hung_timeout.as_millis() as u64;
        }
        barrier.header().pause_at.0.store(NEVER_TICK, SeqCst);
        barrier.header().paused.0.store(NEVER_TICK, SeqCst);
        for slot in barrier.all_slots() {
            slot.since.store(NEVER_TICK, SeqCst);
        }
        // The file gets its name when it is complete.
        std::fs::rename(&unfinished, path).map_err(|source| io_error("name", source))?;
        Ok(barrier)
    }

    /// Opens the mapping that the supervisor created.
    pub fn open(path: &Path) -> Result<Barrier, BarrierError> {
        let io_error =
            |action, source: io::Error| BarrierError::Io { action, path: path.into(), source };
        let foreign_file = |found: String| BarrierError::ForeignFile { path: path.into(), found };
        let file = OpenOptions::new()
            .read(true)
            .write(true)
            .open(path)
            .map_err(|source| io_error("open", source))?;
        let bytes = file.metadata().map_err(|source| io_error("look at", source))?.len() as usize;
        if bytes < file_size_bytes(1) {
            return Err(foreign_file(format!("it has only {bytes} bytes")));
        }
        let memory = map_file(&file, bytes).map_err(|source| io_error("map", source))?;
        let seen_attention_count = AtomicU32::new(0);
        let (slots, groups) = (0, 0);
        let mut barrier =
            Barrier { memory, size_bytes: bytes, slots, groups, seen_attention_count, alarm: None };
        let BarrierHeader { magic, version, slots, groups, .. } = *barrier.header();
        if magic != MAGIC {
            return Err(foreign_file(format!("its magic number is {magic:#x}")));
        }
        if version != VERSION {
            return Err(foreign_file(format!("it has version {version}, expected {VERSION}")));
        }
        let (slots, groups) = (slots as usize, groups as usize);
        if groups == 0 || groups > GROUPS_MAX {
            return Err(foreign_file(format!("it has {groups} groups")));
        }
        if slots == 0 || slots > SLOTS_MAX || bytes != file_size_bytes(slots) {
            return Err(foreign_file(format!("it has {slots} slots in {bytes} bytes")));
        }
        (barrier.slots, barrier.groups) = (slots, groups);
        barrier.seen_attention_count = AtomicU32::new(barrier.header().attention.0.load(SeqCst));
        Ok(barrier)
    }
}

fn map_file(file: &File, bytes: usize) -> io::Result<NonNull<u8>> {
    // SAFETY: a new mapping at an address that the kernel chooses.
    let memory = unsafe {
        rustix::mm::mmap(
            std::ptr::null_mut(),
            bytes,
            ProtFlags::READ | ProtFlags::WRITE,
            MapFlags::SHARED,
            file,
            0,
        )?
    };
    Ok(NonNull::new(memory.cast()).expect("the kernel maps nothing at 0 unasked"))
}
