//! Free space on the file system that the processes of a run share: check before the run begins, allocation
//! before it is needed, and the message when it runs out.
//!
//! Memory on tmpfs is reserved when a file is sized, but allocated when it is first accessed. An access for
//! which there is no memory kills the process with SIGBUS. Therefore all memory is allocated once every
//! port exists; if the file system fills later, only processes that start afterwards are affected.

use std::ffi::CString;
use std::fmt;
use std::fs::{self, OpenOptions};
use std::io::{self, Cursor, Write as _};
use std::os::unix::ffi::OsStrExt as _;
use std::os::unix::fs::MetadataExt as _;
use std::path::{Path, PathBuf};
use std::sync::OnceLock;
use std::time::Instant;

use crate::dead_nodes::layout::parse_sender_pid;
use experiment::scenario::Scenario;
use protocol::barrier::LEAD_TICKS_MAX;
use protocol::law_message::MESSAGE_QUEUE_LENGTH;
use protocol::process::exit;
use rustix::fs::{FallocateFlags, fallocate, statvfs};
use rustix::io::Errno;

/// Bytes that a run needs on tmpfs with all memory allocated, in real time, where queues are longest;
/// measured with 3 to 64 robots with in-degrees of 1 to 8, and rounded up by a quarter. The value for a run
/// includes the plant's queues.
const BYTES_OF_A_RUN: u64 = 2 * 1024 * 1024;
const BYTES_OF_A_ROBOT: u64 = 256 * 1024;
const BYTES_OF_A_LINK: u64 = 16 * 1024;
/// Number of files and directories that a run needs, measured and rounded up by a quarter.
const FILES_OF_A_RUN: u64 = 48;
const FILES_OF_A_ROBOT: u64 = 56;
const FILES_OF_A_LINK: u64 = 4;
/// Maximum number of bytes allocated per file. Robots have memory for long queues that never fill: they use
/// the lowest free slot, which is far below this.
const ALLOCATED_BYTES_MAX: u64 = 64 * 1024;
/// Maximum number of bytes allocated per file of the plant. In lockstep the plant may be 63 ticks ahead of
/// a supervisor that gets no processor time, and its samples wait in its queues.
const PLANT_ALLOCATED_BYTES_MAX: u64 = 1024 * 1024;
/// Time from one allocation to the next, as a multiple of the duration of the first: each searches all files of a run.
const ALLOCATION_PAUSE_FACTOR: u32 = 10;
/// Free space below which the file system counts as full, bytes.
const FREE_BYTES_MIN: u64 = 64 * 1024;
/// Remedy for missing space.
const ADVICE: &str = "free space there, enlarge it (mount -o remount,size=...; in a container --shm-size), or let \
                      PHALANX_RUN_ROOT name a directory on a larger tmpfs";

/// Lack of shared memory.
#[derive(Debug, thiserror::Error)]
#[expect(missing_docs, reason = "the messages say what the fields are")]
pub enum SpaceError {
    /// There is not enough for this run.
    #[error(
        "shared memory is {}: {available}, and {} robots with {} links need {} and {} files; {ADVICE}",
        available.too_small_or_full(need), need.robots, need.links, Bytes(need.bytes()), need.files()
    )]
    TooSmall { need: RequiredSpace, available: AvailableSpace },
    /// There was enough at the start, and none is left.
    #[error("shared memory is full: {available}; {ADVICE}")]
    Full { available: AvailableSpace },
}

/// Space that a run needs.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct RequiredSpace {
    robots: usize,
    links: usize,
    message_bytes: u64,
}

impl RequiredSpace {
    /// Returns the need of a run of this scenario.
    pub fn for_run(scenario: &Scenario) -> RequiredSpace {
        let links = scenario.graph_of_receivers().edges().len();
        RequiredSpace::for_robots(scenario, 0..scenario.robots.len(), links)
    }

    /// Returns the need of these robots of a scenario, which receive over `links` edges, on one of several hosts.
    pub fn for_robots(
        scenario: &Scenario,
        robots: impl ExactSizeIterator<Item = usize>,
        links: usize,
    ) -> RequiredSpace {
        let base = RequiredSpace::without_messages(robots.len(), links);
        let queued_bytes = |i| {
            let sent_bytes = scenario.message_format(i).map_or(0, |format| format.bytes_max);
            let recorded_bytes =
                scenario.recorded_message_format(i).map_or(0, |format| format.bytes_max);
            (MESSAGE_QUEUE_LENGTH * sent_bytes) as u64 + LEAD_TICKS_MAX * recorded_bytes as u64
        };
        RequiredSpace { message_bytes: robots.map(queued_bytes).sum(), ..base }
    }

    /// Returns the need of a run with `robots` robots, and `links` edges in its formation graph, whose laws send no
    /// messages.
    pub fn without_messages(robots: usize, links: usize) -> RequiredSpace {
        RequiredSpace { robots, links, message_bytes: 0 }
    }

    /// Returns the number of bytes on tmpfs, with full queues of messages.
    pub fn bytes(&self) -> u64 {
        let robot_bytes = self.robots as u64 * BYTES_OF_A_ROBOT;
        BYTES_OF_A_RUN + robot_bytes + self.links as u64 * BYTES_OF_A_LINK + self.message_bytes
    }

    /// Returns the number of files and directories.
    pub fn files(&self) -> u64 {
        FILES_OF_A_RUN + self.robots as u64 * FILES_OF_A_ROBOT + self.links as u64 * FILES_OF_A_LINK
    }
}

/// Space on a file system.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct AvailableSpace {
    mount_point: PathBuf,
    file_system_type: String,
    /// Size and free space, bytes; `None` without a limit.
    size_and_free_bytes: Option<[u64; 2]>,
    /// Number of files that may still be created; `None` without a limit.
    files_free: Option<u64>,
}

impl AvailableSpace {
    /// Returns the space on the file system of `path`, or of its nearest existing ancestor.
    pub fn of_file_system(path: &Path) -> io::Result<AvailableSpace> {
        let existing_path = path.ancestors().find(|path| path.exists()).unwrap_or(Path::new("/"));
        let space = statvfs(existing_path)?;
        let (mount_point, file_system_type) = find_mount(existing_path)
            .unwrap_or_else(|| (existing_path.into(), "file system".into()));
        // A tmpfs without a limit reports 0 of 0 blocks.
        let bytes = [space.f_blocks, space.f_bavail].map(|blocks| blocks * space.f_frsize);
        Ok(AvailableSpace {
            mount_point,
            file_system_type,
            size_and_free_bytes: (bytes[0] > 0).then_some(bytes),
            files_free: (space.f_files > 0).then_some(space.f_favail),
        })
    }

    /// Returns whether the file system is a tmpfs.
    pub fn is_tmpfs(&self) -> bool {
        self.file_system_type == "tmpfs"
    }

    /// Returns whether a run has enough space.
    pub fn covers(&self, need: &RequiredSpace) -> bool {
        self.size_and_free_bytes.is_none_or(|[_, free]| free >= need.bytes())
            && self.files_free.is_none_or(|free| free >= need.files())
    }

    /// Returns whether almost nothing is left.
    pub fn is_full(&self) -> bool {
        self.size_and_free_bytes.is_some_and(|[_, free]| free < FREE_BYTES_MIN)
            || self.files_free == Some(0)
    }

    fn too_small_or_full(&self, need: &RequiredSpace) -> &'static str {
        match self.size_and_free_bytes {
            Some([size, _]) if size < need.bytes() => "too small",
            _ => "full",
        }
    }
}

impl fmt::Display for AvailableSpace {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{} ({}) has ", self.mount_point.display(), self.file_system_type)?;
        match self.size_and_free_bytes {
            None => write!(f, "no limit")?,
            Some([size, free]) => write!(f, "{} of {} free", Bytes(free), Bytes(size))?,
        }
        match self.files_free {
            Some(free) if free < 10_000 => write!(f, " for {free} files"),
            _ => Ok(()),
        }
    }
}

/// Fails if `base` has too little space for a run.
pub fn check(base: &Path, need: RequiredSpace) -> Result<(), SpaceError> {
    match AvailableSpace::of_file_system(base) {
        Ok(available) if !available.covers(&need) => Err(SpaceError::TooSmall { need, available }),
        // If the space cannot be read, creating the run root reports the error.
        _ => Ok(()),
    }
}

/// Allocates the memory reserved by the files of a run root, as far as it will be used. `plant` is the
/// plant's process ID, once it exists.
pub fn allocate_reserved_memory(run_root: &Path, plant: Option<u32>) -> Result<(), SpaceError> {
    for entry in fs::read_dir(run_root).into_iter().flatten().flatten() {
        // The file may have been removed meanwhile, like those of dead processes.
        let Ok(metadata) = entry.metadata() else { continue };
        let is_of_plant =
            plant.is_some() && parse_sender_pid(&entry.file_name().to_string_lossy()) == plant;
        let allocated_bytes = metadata.len().min(if is_of_plant {
            PLANT_ALLOCATED_BYTES_MAX
        } else {
            ALLOCATED_BYTES_MAX
        });
        if !metadata.is_file() || 512 * metadata.blocks() >= allocated_bytes {
            continue;
        }
        let Ok(file) = OpenOptions::new().write(true).open(entry.path()) else { continue };
        if let Err(Errno::NOSPC) = fallocate(file, FallocateFlags::KEEP_SIZE, 0, allocated_bytes)
            && let Ok(available) = AvailableSpace::of_file_system(run_root)
        {
            return Err(SpaceError::Full { available });
        }
    }
    Ok(())
}

/// Allocation of the memory of new files, at most for a small fraction of the time.
#[derive(Debug, Default)]
pub struct Allocator {
    is_due: bool,
    /// Time before which the next allocation does not begin.
    not_before: Option<Instant>,
}

impl Allocator {
    /// Requests an allocation, because files may be new.
    pub fn request_allocation(&mut self) {
        self.is_due = true;
    }

    /// Does the work of [`allocate_reserved_memory`] if it was requested, and the last time is long enough ago.
    pub fn allocate_if_due(
        &mut self,
        run_root: &Path,
        plant: Option<u32>,
    ) -> Result<(), SpaceError> {
        let start = Instant::now();
        if !self.is_due || self.not_before.is_some_and(|earliest| start < earliest) {
            return Ok(());
        }
        self.is_due = false;
        allocate_reserved_memory(run_root, plant)?;
        self.not_before = Some(start + ALLOCATION_PAUSE_FACTOR * start.elapsed());
        Ok(())
    }
}

/// Returns an error if the file system is full, as the possible cause of a process's death.
pub fn find_space_error(run_root: &Path) -> Option<SpaceError> {
    AvailableSpace::of_file_system(run_root)
        .ok()
        .filter(AvailableSpace::is_full)
        .map(|available| SpaceError::Full { available })
}

/// Path on the shared file system and its mount, for the SIGBUS handler.
static SIGBUS_PATHS: OnceLock<(CString, String)> = OnceLock::new();

/// Installs a handler for SIGBUS in this process, which shares the memory of `base`. It prints a message to
/// stderr and exits with the code of an infrastructure failure.
pub fn install_sigbus_handler(base: &Path) {
    let existing_path = base.ancestors().find(|path| path.exists()).unwrap_or(Path::new("/"));
    let Ok(path) = CString::new(existing_path.as_os_str().as_bytes()) else { return };
    let mount = find_mount(existing_path).map_or_else(|| existing_path.into(), |(mount, _)| mount);
    let _ = SIGBUS_PATHS.set((path, mount.display().to_string()));
    let handler: extern "C" fn(libc::c_int) = handle_sigbus;
    // SAFETY: zeros are a value of this plain struct.
    let mut action: libc::sigaction = unsafe { std::mem::zeroed() };
    action.sa_sigaction = handler as libc::sighandler_t;
    // SAFETY: reads `action`, whose handler is async-signal-safe. If the call fails, the signal still ends
    // this process, without the message.
    unsafe { libc::sigaction(libc::SIGBUS, &action, std::ptr::null_mut()) };
}

/// Handles SIGBUS. Uses only system calls and the stack, because it may run at any time.
extern "C" fn handle_sigbus(_signal: libc::c_int) {
    let mut bytes = [0; 1024];
    // On the stack; what exceeds it is lost.
    let mut line = Cursor::new(&mut bytes[..]);
    if let Some((path, mount)) = SIGBUS_PATHS.get() {
        // SAFETY: zeros are a value of this plain struct.
        let mut space: libc::statfs = unsafe { std::mem::zeroed() };
        // SAFETY: reads a path that ends in 0, writes `space`.
        let is_known = unsafe { libc::statfs(path.as_ptr(), &mut space) } == 0;
        let to_bytes = |blocks: u64| Bytes(blocks * space.f_bsize as u64);
        let is_full = is_known && to_bytes(space.f_bavail).0 < FREE_BYTES_MIN;
        let cause = match is_full {
            true => "shared memory is full (SIGBUS)",
            false => "a part of shared memory was removed, or could not be allocated (SIGBUS)",
        };
        let (free, size) = (to_bytes(space.f_bavail), to_bytes(space.f_blocks));
        let _ = writeln!(line, "error: {cause}: {mount} has {free} of {size} free; {ADVICE}");
    }
    let length = line.position() as usize;
    // SAFETY: plain system calls; the buffer has the given length.
    unsafe {
        libc::write(2, bytes.as_ptr().cast(), length);
        libc::_exit(i32::from(exit::INFRASTRUCTURE_FAILURE));
    }
}

/// Number of bytes, formatted with a unit.
#[derive(Debug, Clone, Copy)]
pub struct Bytes(pub u64);

impl fmt::Display for Bytes {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self.0 {
            bytes if bytes >= 10 << 30 => write!(f, "{} GiB", bytes >> 30),
            bytes if bytes >= 10 << 20 => write!(f, "{} MiB", bytes >> 20),
            bytes => write!(f, "{} KiB", bytes >> 10),
        }
    }
}

/// Returns the mount point of a path and the type of its file system.
fn find_mount(path: &Path) -> Option<(PathBuf, String)> {
    let path = path.canonicalize().ok()?;
    let mounts = fs::read_to_string("/proc/self/mountinfo").ok()?;
    let mounts_and_types = mounts.lines().filter_map(|line| {
        let (mount_fields, type_fields) = line.split_once(" - ")?;
        let mount = PathBuf::from(unescape(mount_fields.split(' ').nth(4)?));
        Some((mount, type_fields.split(' ').next()?.to_owned()))
    });
    // The last of equals lies on top of the others.
    mounts_and_types
        .filter(|(mount, _)| path.starts_with(mount))
        .max_by_key(|(mount, _)| mount.components().count())
}

/// Decodes `\040` and other escapes of blanks in paths, as the kernel writes them.
fn unescape(text: &str) -> String {
    [("\\040", " "), ("\\011", "\t"), ("\\134", "\\")]
        .iter()
        .fold(text.to_owned(), |text, (escape, character)| text.replace(escape, character))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn available_space(bytes: Option<[u64; 2]>, files_free: Option<u64>) -> AvailableSpace {
        AvailableSpace {
            mount_point: "/m".into(),
            file_system_type: "tmpfs".into(),
            size_and_free_bytes: bytes,
            files_free,
        }
    }

    #[test]
    fn required_space_includes_bytes_and_files() {
        let need = RequiredSpace::without_messages(3, 3);
        let (bytes, files) = (need.bytes(), need.files());
        assert!(available_space(Some([bytes, bytes]), Some(files)).covers(&need));
        assert!(available_space(None, None).covers(&need), "a tmpfs without limits");
        let small = available_space(Some([bytes - 1, bytes - 1]), None);
        assert!(!small.covers(&need) && !available_space(None, Some(files - 1)).covers(&need));
        let error = SpaceError::TooSmall { need, available: small }.to_string();
        assert!(error.starts_with("shared memory is too small: /m (tmpfs) has "), "{error}");
        assert!(error.contains("3 robots with 3 links need"), "{error}");
        let error =
            SpaceError::TooSmall { need, available: available_space(Some([u64::MAX, 0]), None) }
                .to_string();
        assert!(error.starts_with("shared memory is full: ") && error.contains(ADVICE), "{error}");
    }

    #[test]
    fn reserved_memory_is_allocated_up_to_the_maximum() {
        let root = tempfile::tempdir_in("/dev/shm").unwrap();
        let path = root.path().join("promised");
        for (length, allocated) in [(5_000, 8_192), (1_000_000, ALLOCATED_BYTES_MAX)] {
            fs::File::create(&path).unwrap().set_len(length).unwrap();
            assert_eq!(fs::metadata(&path).unwrap().blocks(), 0);
            allocate_reserved_memory(root.path(), None).unwrap();
            let metadata = fs::metadata(&path).unwrap();
            assert_eq!((metadata.len(), 512 * metadata.blocks()), (length, allocated));
        }
        // One file of the plant, one of another process.
        for (process, allocated) in [(7u32, 1_003_520), (8, ALLOCATED_BYTES_MAX)] {
            let path = root.path().join(format!("phx_hash_{}.data", u128::from(process) << 64 | 1));
            fs::File::create(&path).unwrap().set_len(1_000_000).unwrap();
            allocate_reserved_memory(root.path(), Some(7)).unwrap();
            assert_eq!(512 * fs::metadata(&path).unwrap().blocks(), allocated);
        }
    }

    #[test]
    fn mount_point_of_a_path_is_found() {
        let (mount, file_system_type) = find_mount(Path::new("/proc/self")).unwrap();
        assert_eq!((mount.to_str(), file_system_type.as_str()), (Some("/proc"), "proc"));
        let space = AvailableSpace::of_file_system(Path::new("/dev/shm/not/yet/there")).unwrap();
        assert_eq!(space.mount_point, Path::new("/dev/shm"));
        assert!(space.is_tmpfs() && !space.is_full(), "{space}");
        assert_eq!(unescape("/a\\040b"), "/a b");
    }
}
