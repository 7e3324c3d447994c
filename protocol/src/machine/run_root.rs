//! The run root: a directory on tmpfs with all shared files of one run, its shared memory included, and the
//! iceoryx2 configuration that isolates runs from each other.
//!
//! The supervisor holds its lock file as long as it runs. A root whose lock is free belongs to a run that has exited:
//! the next run removes it, and so does `phalanx clean`. Only the user can access it. Must not: remove anything
//! whose lock is not held, touch files of another user, or follow a symbolic link.

use std::fs::{self, File, OpenOptions};
use std::io::{self, Read as _, Write as _};
use std::os::unix::fs::{DirBuilderExt as _, MetadataExt as _, OpenOptionsExt as _};
use std::path::{Path, PathBuf};
use std::time::Duration;

use iceoryx2::prelude::{Config, FilePath, SemanticString as _};
use rustix::fs::{FlockOperation, OFlags, flock};

use crate::machine::scratch;

/// Parent directory of run roots unless PHALANX_RUN_ROOT is set: a tmpfs on every Linux.
const DEFAULT_PARENT_DIRECTORY: &str = "/dev/shm";
/// Minimum age of a directory without a lock file before it is removed: another run may be creating a younger
/// one.
const UNLOCKED_AGE_MIN: Duration = Duration::from_secs(10);
/// Maximum number of names that are tried. A name is lost when another run ends and removes the base directory.
const CREATE_ATTEMPTS_MAX: usize = 64;
/// Prefix of the names of iceoryx2's files in a run root.
pub const ICEORYX2_PREFIX: &str = "phx_";
/// Maximum number of former senders whose samples a receiver keeps until it next receives. At most two are
/// connected at a time, one of them a replacement; this leaves room for as many again.
const EXPIRED_CONNECTIONS_MAX: usize = 4;
/// Suffix of a root's name while it is being created.
const UNFINISHED_SUFFIX: &str = ".new";
/// Maximum length of the path of a run root, bytes: iceoryx2 refuses paths of more than 255 bytes, and adds up to
/// 123.
pub(crate) const PATH_BYTES_MAX: usize = 128;

/// Failure to create or join a run root.
#[derive(Debug, thiserror::Error)]
#[expect(missing_docs, reason = "the messages say what the fields are")]
pub enum RunRootError {
    /// A file or directory could not be created or read.
    #[error(
        "cannot {action} {path}: {source}; PHALANX_RUN_ROOT names the directory in which runs share their memory and files (default {DEFAULT_PARENT_DIRECTORY}): it must exist, be writable, have room, and should be on tmpfs"
    )]
    Io { action: &'static str, path: PathBuf, source: io::Error },
    /// The directory is not usable as a run root, or not by this process.
    #[error("{path} {why}")]
    Unusable { path: PathBuf, why: String },
}

/// Directory of a run, locked while this value exists.
#[derive(Debug)]
pub struct RunRoot {
    base_directory: PathBuf,
    path: PathBuf,
    removed: bool,
    _lock: File,
}

/// Returns the directory of this user's run roots: `phalanx-<uid>` under PHALANX_RUN_ROOT or /dev/shm.
pub fn base_directory() -> PathBuf {
    let parent = std::env::var_os("PHALANX_RUN_ROOT")
        .filter(|value| !value.is_empty())
        .map_or_else(|| PathBuf::from(DEFAULT_PARENT_DIRECTORY), PathBuf::from);
    parent.join(format!("phalanx-{}", rustix::process::geteuid().as_raw()))
}

/// Returns the path of the barrier's file in a run root.
pub fn barrier_path(run_root: &Path) -> PathBuf {
    run_root.join("barrier")
}

/// Returns the file in a run root in which the newest process of a robot, or of the `plant`, records its id when it
/// joins. If the program is user-defined, that process may be a descendant of the one that was started.
pub fn pid_path(run_root: &Path, name: &str) -> PathBuf {
    run_root.join(format!("process-{name}"))
}

/// Returns the path of the iceoryx2 configuration in a run root.
pub fn config_path(run_root: &Path) -> PathBuf {
    run_root.join("iceoryx2.toml")
}

impl RunRoot {
    /// Creates a new run root under `base`, which is created too if it is missing.
    ///
    /// # Errors
    ///
    /// A file or directory cannot be created, or `base` is not usable.
    pub fn create(base: &Path) -> Result<RunRoot, RunRootError> {
        let base = std::path::absolute(base).map_err(|source| io_error("resolve", base, source))?;
        for _ in 0..CREATE_ATTEMPTS_MAX {
            let id = draw_random_id()?;
            let path = base.join(&id);
            if !is_usable(&path) {
                return Err(unusable_error(
                    &path,
                    format!(
                        "cannot be a run root: iceoryx2 takes absolute UTF-8 paths without quotes of at most \
                         {PATH_BYTES_MAX} bytes; let PHALANX_RUN_ROOT name a shorter one"
                    ),
                ));
            }
            create_base_directory(&base)?;
            // Locked before it gets its name, so that no other run finds it unlocked.
            let unfinished = base.join(format!("{id}{UNFINISHED_SUFFIX}"));
            match fs::DirBuilder::new().mode(0o700).create(&unfinished) {
                Ok(()) => {}
                // The name is taken, or the base was removed by the last run that used it.
                Err(error) if is_lost_race(&error) => continue,
                Err(source) => return Err(io_error("make", &unfinished, source)),
            }
            let Some(lock) = create_lock_file(&unfinished.join("lock"))? else { continue };
            match fs::rename(&unfinished, &path) {
                Ok(()) if is_same_file(&lock, &path.join("lock")) => {}
                Err(source) if !is_lost_race(&source) => {
                    return Err(io_error("name", &path, source));
                }
                _ => continue,
            }
            let root = RunRoot { base_directory: base, path, removed: false, _lock: lock };
            let config = config_path(&root.path);
            write_private_file(&config, &root.iceoryx2_config())
                .map_err(|source| io_error("write", &config, source))?;
            return Ok(root);
        }
        let why = format!(
            "had no free name in {CREATE_ATTEMPTS_MAX} attempts; is something else removing directories there?"
        );
        Err(unusable_error(&base, why))
    }

    /// Returns the path of the directory.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// Returns the path of the barrier's file.
    pub fn barrier_path(&self) -> PathBuf {
        barrier_path(&self.path)
    }

    /// Removes the directory, and the base directory if it is empty.
    pub fn remove(mut self) -> io::Result<()> {
        self.removed = true;
        self.remove_directories()
    }

    fn remove_directories(&self) -> io::Result<()> {
        fs::remove_dir_all(&self.path)?;
        // Other runs may use the base directory.
        let _ = fs::remove_dir(&self.base_directory);
        Ok(())
    }

    /// Returns the iceoryx2 configuration. Only the supervisor removes the resources of dead processes: iceoryx2
    /// must not do it by itself.
    fn iceoryx2_config(&self) -> String {
        // By default every receiver has room for 128, and touches all of that memory when it is created.
        format!(
            "[global]\n\
             root-path = '{}'\n\
             prefix = '{ICEORYX2_PREFIX}'\n\
             [global.service]\n\
             cleanup-dead-nodes-on-open = false\n\
             [global.node]\n\
             cleanup-dead-nodes-on-creation = false\n\
             cleanup-dead-nodes-on-destruction = false\n\
             [defaults.publish-subscribe]\n\
             subscriber-expired-connection-buffer = {EXPIRED_CONNECTIONS_MAX}\n",
            self.path.display()
        )
    }
}

impl Drop for RunRoot {
    fn drop(&mut self) {
        if !self.removed
            && let Err(error) = self.remove_directories()
        {
            tracing::warn!(%error, path = %self.path.display(), "cannot remove the run root");
        }
    }
}

/// Run root of a run that has exited, locked while this value exists, so that no other process removes it.
#[derive(Debug)]
pub struct ExitedRunRoot {
    /// Path of the directory.
    pub path: PathBuf,
    _lock: Option<File>,
}

impl ExitedRunRoot {
    /// Removes the run root and its scratch folder, if it has one.
    pub fn remove(self) -> io::Result<()> {
        scratch::remove(&self.path)?;
        fs::remove_dir_all(self.path)
    }
}

/// Removes every run root whose lock is free, and returns their paths.
pub fn remove_dead_roots(base: &Path) -> Vec<PathBuf> {
    let mut removed = Vec::new();
    for root in lock_dead_roots(base) {
        let path = root.path.clone();
        match root.remove() {
            Ok(()) => removed.push(path),
            Err(error) => {
                tracing::warn!(%error, path = %path.display(), "cannot remove the run root of an exited run");
            }
        }
    }
    removed
}

/// Iterates over the run roots below `base` whose lock is free; each is locked when it is reached.
pub fn lock_dead_roots(base: &Path) -> impl Iterator<Item = ExitedRunRoot> {
    // `create` refuses a base that is a link or belongs to another user; here it is left alone.
    let is_ours =
        fs::symlink_metadata(base).is_ok_and(|metadata| unusable_reason(&metadata).is_none());
    let entries = is_ours.then(|| fs::read_dir(base).ok()).flatten();
    entries.into_iter().flatten().flatten().filter_map(|entry| {
        let path = entry.path();
        let name = path.file_name().and_then(|name| name.to_str())?;
        let id = name.strip_suffix(UNFINISHED_SUFFIX).unwrap_or(name);
        if !is_run_id(id) || (name != id && !is_past_unlocked_age(&path)) {
            return None;
        }
        if !fs::symlink_metadata(&path).is_ok_and(|metadata| metadata.is_dir()) {
            return None;
        }
        let lock_path = path.join("lock");
        let lock = match lock_options().open(&lock_path) {
            Ok(lock) => Some(lock),
            Err(error)
                if error.kind() == io::ErrorKind::NotFound && is_past_unlocked_age(&path) =>
            {
                None
            }
            Err(_) => return None,
        };
        if let Some(lock) = &lock
            && (flock(lock, FlockOperation::NonBlockingLockExclusive).is_err()
                || !is_same_file(lock, &lock_path))
        {
            return None;
        }
        Some(ExitedRunRoot { path, _lock: lock })
    })
}

/// Returns the reason why `base` is not usable for run roots; `None` if it is usable or missing.
pub fn find_unusable_reason(base: &Path) -> Option<String> {
    fs::symlink_metadata(base).ok().and_then(|metadata| unusable_reason(&metadata))
}

/// Joins a run as the process of a robot, or of the `plant`, and records the process id.
pub fn join_as_process(run_root: &Path, name: &str) -> Result<(), RunRootError> {
    join(run_root)?;
    let path = pid_path(run_root, name);
    let mut options = lock_options();
    let file = options.create(true).truncate(true).open(&path);
    file.and_then(|mut file| file.write_all(std::process::id().to_string().as_bytes()))
        .map_err(|source| io_error("write", &path, source))
}

/// Joins a run: makes iceoryx2 use its root from now on. Every process calls this first.
pub fn join(run_root: &Path) -> Result<(), RunRootError> {
    crate::machine::process::limit_iceoryx2_log();
    let path = config_path(run_root);
    let config_error = |cause: &dyn std::fmt::Debug| {
        let why = format!(
            "is refused by iceoryx2: {cause:?}; is the run of this brief still in progress?"
        );
        unusable_error(&path, why)
    };
    let file =
        FilePath::new(path.as_os_str().as_encoded_bytes()).map_err(|error| config_error(&error))?;
    let config = Config::from_file(&file).map_err(|error| config_error(&error))?;
    let joined_config =
        Config::setup_global_config_from_file(&file).map_err(|error| config_error(&error))?;
    if *joined_config != config {
        let joined_root = joined_config.global.root_path();
        let why = format!(
            "cannot be joined: this process has joined {joined_root} already; call join first thing, once"
        );
        return Err(unusable_error(run_root, why));
    }
    Ok(())
}

fn io_error(action: &'static str, path: &Path, source: io::Error) -> RunRootError {
    RunRootError::Io { action, path: path.into(), source }
}

fn unusable_error(path: &Path, why: String) -> RunRootError {
    RunRootError::Unusable { path: path.into(), why }
}

/// Returns whether `path` lies inside a run root below `base` that a live process holds. Such a root is removed by its
/// holder, with all that is in it.
pub fn is_in_live_root(base: &Path, path: &Path) -> bool {
    let root = path.strip_prefix(base).ok().and_then(|relative| relative.iter().next()?.to_str());
    root.filter(|name| is_run_id(name)).is_some_and(|name| {
        let lock = lock_options().open(base.join(name).join("lock"));
        lock.is_ok_and(|lock| flock(&lock, FlockOperation::NonBlockingLockExclusive).is_err())
    })
}

fn is_run_id(name: &str) -> bool {
    name.len() == 8 && name.bytes().all(|b| b.is_ascii_digit() || (b'a'..=b'f').contains(&b))
}

fn is_usable(path: &Path) -> bool {
    path.to_str().is_some_and(|text| {
        text.len() <= PATH_BYTES_MAX && !text.contains(|c: char| c == '\'' || c.is_control())
    })
}

fn draw_random_id() -> Result<String, RunRootError> {
    let source = Path::new("/dev/urandom");
    let mut bytes = [0; 4];
    File::open(source)
        .and_then(|mut file| file.read_exact(&mut bytes))
        .map_err(|error| io_error("read", source, error))?;
    Ok(format!("{:08x}", u32::from_le_bytes(bytes)))
}

/// Creates the base directory, or checks that only this user can write to the existing one.
fn create_base_directory(base: &Path) -> Result<(), RunRootError> {
    match fs::DirBuilder::new().mode(0o700).create(base) {
        Ok(()) => return Ok(()),
        Err(error) if error.kind() == io::ErrorKind::AlreadyExists => {}
        Err(source) => return Err(io_error("make", base, source)),
    }
    match fs::symlink_metadata(base) {
        Ok(metadata) => match unusable_reason(&metadata) {
            None => Ok(()),
            Some(reason) => {
                let uid = rustix::process::geteuid().as_raw();
                let why = format!(
                    "is not a private directory of user {uid}: {reason}; remove it, or let \
                     PHALANX_RUN_ROOT name another directory"
                );
                Err(unusable_error(base, why))
            }
        },
        // Removed again by another run: the next attempt creates it.
        Err(error) if error.kind() == io::ErrorKind::NotFound => Ok(()),
        Err(source) => Err(io_error("look at", base, source)),
    }
}

/// Returns the reason why a base directory is not usable, if any.
fn unusable_reason(metadata: &fs::Metadata) -> Option<String> {
    if metadata.is_symlink() {
        Some("it is a symbolic link".into())
    } else if !metadata.is_dir() {
        Some("it is not a directory".into())
    } else if !is_owned_by_user(metadata) {
        Some(format!("it belongs to user {}", metadata.uid()))
    } else if metadata.mode() & 0o077 != 0 {
        Some(format!("it is open to others (mode {:o})", metadata.mode() & 0o777))
    } else {
        None
    }
}

fn is_owned_by_user(metadata: &fs::Metadata) -> bool {
    metadata.uid() == rustix::process::geteuid().as_raw()
}

fn write_private_file(path: &Path, text: &str) -> io::Result<()> {
    let mut file = OpenOptions::new().write(true).create_new(true).mode(0o600).open(path)?;
    file.write_all(text.as_bytes())
}

fn lock_options() -> OpenOptions {
    let mut options = OpenOptions::new();
    options.read(true).write(true).mode(0o600).custom_flags(OFlags::NOFOLLOW.bits() as i32);
    options
}

/// Creates and locks a lock file; `None` if one exists, or if another run removed it first.
fn create_lock_file(path: &Path) -> Result<Option<File>, RunRootError> {
    let lock = match lock_options().create_new(true).open(path) {
        Ok(lock) => lock,
        Err(error) if is_lost_race(&error) => return Ok(None),
        Err(source) => return Err(io_error("make", path, source)),
    };
    match flock(&lock, FlockOperation::NonBlockingLockExclusive) {
        Ok(()) if is_same_file(&lock, path) => Ok(Some(lock)),
        Ok(()) | Err(rustix::io::Errno::WOULDBLOCK) => Ok(None),
        Err(error) => Err(io_error("lock", path, error.into())),
    }
}

/// Returns whether another process was faster, so another name may succeed.
fn is_lost_race(error: &io::Error) -> bool {
    use io::ErrorKind as K;
    matches!(error.kind(), K::AlreadyExists | K::DirectoryNotEmpty | K::NotFound)
}

/// Returns whether the path still leads to the open file.
fn is_same_file(file: &File, path: &Path) -> bool {
    match (file.metadata(), fs::symlink_metadata(path)) {
        (Ok(a), Ok(b)) => a.dev() == b.dev() && a.ino() == b.ino(),
        _ => false,
    }
}

fn is_past_unlocked_age(path: &Path) -> bool {
    fs::symlink_metadata(path)
        .and_then(|metadata| metadata.modified())
        .ok()
        .and_then(|modified| modified.elapsed().ok())
        .is_some_and(|age| age > UNLOCKED_AGE_MIN)
}

#[cfg(test)]
mod tests {
    use std::os::unix::fs::PermissionsExt as _;

    use super::*;

    fn temporary_base() -> (tempfile::TempDir, PathBuf) {
        let parent = tempfile::tempdir().unwrap();
        let base = parent.path().join("phalanx-test");
        (parent, base)
    }

    #[test]
    fn run_root_is_private_and_removed_completely() {
        let (parent, base) = temporary_base();
        let root = RunRoot::create(&base).unwrap();
        assert_eq!(fs::metadata(root.path()).unwrap().mode() & 0o777, 0o700);
        assert!(config_path(root.path()).exists());
        fs::write(root.path().join("left"), "x").unwrap();
        root.remove().unwrap();
        assert!(!base.exists());
        drop(parent);
    }

    #[test]
    fn sweep_removes_dead_roots_and_keeps_live_ones() {
        let (_parent, base) = temporary_base();
        let live = RunRoot::create(&base).unwrap();
        let id = format!("{:08x}", std::process::id());
        let dead = base.join(&id);
        fs::create_dir(&dead).unwrap();
        fs::write(dead.join("lock"), "").unwrap();
        fs::write(dead.join("left"), "x").unwrap();
        let unfinished = base.join("0000beef");
        fs::create_dir(&unfinished).unwrap();
        fs::create_dir(base.join("not-a-root")).unwrap();
        assert_eq!(remove_dead_roots(&base), std::slice::from_ref(&dead));
        assert!(!dead.exists());
        assert!(live.path().exists() && unfinished.exists());
    }

    #[test]
    fn shared_or_linked_base_is_refused() {
        let (parent, base) = temporary_base();
        fs::create_dir(&base).unwrap();
        fs::set_permissions(&base, fs::Permissions::from_mode(0o755)).unwrap();
        let error = RunRoot::create(&base).unwrap_err().to_string();
        assert!(error.contains("open to others (mode 755)"), "{error}");
        fs::remove_dir(&base).unwrap();
        std::os::unix::fs::symlink(parent.path(), &base).unwrap();
        let error = RunRoot::create(&base).unwrap_err().to_string();
        assert!(error.contains("symbolic link"), "{error}");
    }

    #[test]
    fn roots_survive_sweeps_during_their_creation() {
        let (_parent, base) = temporary_base();
        std::thread::scope(|scope| {
            for _ in 0..2 {
                scope.spawn(|| (0..200).for_each(|_| drop(remove_dead_roots(&base))));
            }
            for _ in 0..2 {
                scope.spawn(|| {
                    for _ in 0..100 {
                        let root = RunRoot::create(&base).unwrap();
                        assert!(config_path(root.path()).exists());
                        root.remove().unwrap();
                    }
                });
            }
        });
        assert!(!base.exists());
    }
}
