//! Shared table of the lowest incarnation of each robot whose commands the plant accepts: one word for each robot
//! in a small file that supervisor and plant map. The supervisor raises the word before it kills a robot, and
//! after each exit.
//!
//! Must not: be read by a robot.

use std::fs::{File, OpenOptions};
use std::io;
use std::os::unix::fs::OpenOptionsExt as _;
use std::path::Path;
use std::ptr::NonNull;
use std::sync::atomic::AtomicU64;
use std::sync::atomic::Ordering::SeqCst;

use rustix::mm::{MapFlags, ProtFlags};

/// Name of the file in the run root.
const FILE_NAME: &str = "incarnations";

/// Shared table of the lowest incarnation of each robot whose commands the plant accepts.
#[derive(Debug)]
pub struct Incarnations {
    memory: NonNull<AtomicU64>,
    robots: usize,
}

// SAFETY: the mapping is only read and written through atomics, and lives as long as the value.
unsafe impl Send for Incarnations {}
// SAFETY: as above.
unsafe impl Sync for Incarnations {}

impl Incarnations {
    /// Creates the file, with every incarnation accepted. For the supervisor only.
    pub fn create(run_root: &Path, robots: usize) -> io::Result<Incarnations> {
        let mut options = OpenOptions::new();
        options.read(true).write(true).create_new(true).mode(0o600);
        let file = options.open(run_root.join(FILE_NAME))?;
        let bytes = (robots.max(1) * size_of::<AtomicU64>()) as u64;
        file.set_len(bytes)?;
        // Allocates the memory now, so that a full tmpfs is an error here instead of a SIGBUS later.
        match rustix::fs::fallocate(&file, rustix::fs::FallocateFlags::empty(), 0, bytes) {
            Ok(()) | Err(rustix::io::Errno::OPNOTSUPP) => {}
            Err(error) => return Err(error.into()),
        }
        Incarnations::map_file(&file, robots)
    }

    /// Opens the file of a run.
    ///
    /// # Errors
    ///
    /// The file is missing, or is for fewer robots.
    pub fn open(run_root: &Path, robots: usize) -> io::Result<Incarnations> {
        let file = OpenOptions::new().read(true).write(true).open(run_root.join(FILE_NAME))?;
        let (found, expected) = (file.metadata()?.len(), robots * size_of::<AtomicU64>());
        if found < expected as u64 {
            let message = format!("{FILE_NAME} has {found} bytes, expected {expected}");
            return Err(io::Error::other(message));
        }
        Incarnations::map_file(&file, robots)
    }

    fn map_file(file: &File, robots: usize) -> io::Result<Incarnations> {
        let bytes = robots.max(1) * size_of::<AtomicU64>();
        let protection = ProtFlags::READ | ProtFlags::WRITE;
        // SAFETY: a new mapping at an address that the kernel chooses, of a file that is long enough.
        let memory = unsafe {
            rustix::mm::mmap(std::ptr::null_mut(), bytes, protection, MapFlags::SHARED, file, 0)?
        };
        let memory = NonNull::new(memory.cast()).expect("the kernel maps nothing at 0 unasked");
        Ok(Incarnations { memory, robots })
    }

    fn robot_word(&self, robot: usize) -> &AtomicU64 {
        assert!(robot < self.robots, "robot {robot} of {}", self.robots);
        // SAFETY: within the mapping, aligned, and only used through atomics.
        unsafe { self.memory.add(robot).as_ref() }
    }

    /// Returns whether the plant accepts commands of this incarnation of a robot. `robot`: scenario index from 0.
    #[inline]
    pub fn is_accepted(&self, robot: usize, incarnation: u64) -> bool {
        incarnation >= self.robot_word(robot).load(SeqCst)
    }

    /// Stops the plant from accepting commands of this incarnation of a robot and of all earlier ones.
    pub fn retire(&self, robot: usize, incarnation: u64) {
        self.robot_word(robot).fetch_max(incarnation.saturating_add(1), SeqCst);
    }
}

impl Drop for Incarnations {
    fn drop(&mut self) {
        let bytes = self.robots.max(1) * size_of::<AtomicU64>();
        // SAFETY: mapped with this length by `map`; no reference outlives `self`.
        let _ = unsafe { rustix::mm::munmap(self.memory.as_ptr().cast(), bytes) };
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn retired_incarnation_is_refused_in_every_mapping() {
        let root = tempfile::tempdir().unwrap();
        assert!(Incarnations::open(root.path(), 2).is_err());
        let supervisor = Incarnations::create(root.path(), 2).unwrap();
        let plant = Incarnations::open(root.path(), 2).unwrap();
        assert!(plant.is_accepted(1, 0));
        supervisor.retire(1, 0);
        supervisor.retire(1, 2);
        supervisor.retire(1, 1);
        let accepted: Vec<bool> =
            (0..5).map(|incarnation| plant.is_accepted(1, incarnation)).collect();
        assert_eq!(accepted, [false, false, false, true, true]);
        assert!(plant.is_accepted(0, 0));
        assert!(Incarnations::open(root.path(), 3).is_err());
    }
}
