//! Removal of the iceoryx2 nodes and ports that a process left when it died during the run. Runs on its own
//! thread, because it may take long and must not block the supervisor's loop.
//!
//! Only the supervisor cleans up, and only after the process was reaped: before that, iceoryx2 considers it
//! alive, and its replacement finds no free port. Processes that die during a clean-up share the next one.

pub mod layout;

use std::collections::{BTreeMap, BTreeSet};
use std::fs;
use std::io::{self, Write as _};
use std::os::fd::{AsFd, BorrowedFd, OwnedFd};
use std::os::unix::fs::MetadataExt as _;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{Receiver, RecvTimeoutError, Sender, channel};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use protocol::run_root::RunRoot;
use protocol::service::{self, Node};
use rustix::event::{EventfdFlags, eventfd};

use crate::spawn::SpawnError;

use self::layout::{INCOMPLETE_PERMISSIONS, LayoutError, list_connections, list_nodes};

/// Maximum time for one attempt to remove stale resources.
const CLEANUP_ATTEMPT_TIMEOUT: Duration = Duration::from_millis(500);

/// Minimum polling interval for half-made connections during a clean-up. iceoryx2 waits half a second for a
/// connection whose creator has died, and continues once it is removed.
const POLL_INTERVAL_MIN: Duration = Duration::from_millis(20);
/// Minimum polling interval as a multiple of the time that a search takes, which grows with the number of files.
const POLL_INTERVAL_FACTOR: u32 = 5;
/// Time after a clean-up at which a remaining connection with a dead process counts as unclaimed. Alive
/// processes release theirs at their next send or receive.
const UNCLAIMED_TIMEOUT: Duration = Duration::from_secs(1);
/// Maximum time to wait for the last clean-up at the end of a run.
const LAST_CLEANUP_TIMEOUT: Duration = Duration::from_secs(5);

/// Invalid iceoryx2 version, written to the start of a half-made file. A process that waits for the file
/// gives up at once, even if it has it open.
const INVALID_VERSION: [u8; 8] = [0xff; 8];

/// Failure to start the cleaner.
#[derive(Debug, thiserror::Error)]
pub enum CleanerError {
    /// The iceoryx2 file layout is not as expected, so stale resources would not be found.
    #[error(transparent)]
    Layout(#[from] LayoutError),
    /// The thread could not be started.
    #[error(transparent)]
    Thread(#[from] SpawnError),
}

/// Owner of a dead process.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum DeadProcessOwner {
    /// Robot, by the number that its supervisor uses.
    Robot(usize),
    /// Bridge to other hosts.
    Bridge,
    /// ROS 2 bridge.
    Ros2,
}

/// Handle of the clean-up thread.
pub struct Cleaner {
    requests: Option<Sender<DeadProcessOwner>>,
    results: Receiver<DeadProcessOwner>,
    /// Event descriptor, readable while there may be results in `results`.
    results_event: Arc<OwnedFd>,
    /// Whether the run has ended, so that its run root is removed and no clean-up is needed.
    has_ended: Arc<AtomicBool>,
    thread: Option<JoinHandle<()>>,
}

impl Cleaner {
    /// Starts the thread with its own node, in a run that this process has joined.
    pub fn start(run_root: &RunRoot, node: &Node) -> Result<Cleaner, CleanerError> {
        layout::verify(run_root.path(), node)?;
        let (requests, request_receiver) = channel::<DeadProcessOwner>();
        let (result_sender, results) = channel();
        let spawn_error = |source| SpawnError::from_thread_error("the clean-up thread", source);
        let results_event = eventfd(0, EventfdFlags::CLOEXEC | EventfdFlags::NONBLOCK);
        let results_event = Arc::new(results_event.map_err(|error| spawn_error(error.into()))?);
        let results_event_writer = results_event.clone();
        let has_ended = Arc::new(AtomicBool::new(false));
        let run_has_ended = has_ended.clone();
        let run_root = run_root.path().to_path_buf();
        let thread = std::thread::Builder::new().name("cleanup".into());
        let thread = thread.spawn(move || {
            let node = service::create_node("cleanup");
            let mut has_cleaned = false;
            loop {
                let timeout = if has_cleaned { UNCLAIMED_TIMEOUT } else { Duration::MAX };
                let owner = match request_receiver.recv_timeout(timeout) {
                    Ok(owner) => owner,
                    Err(RecvTimeoutError::Timeout) => {
                        has_cleaned = false;
                        if let Err(error) = remove_unclaimed_connections(&run_root) {
                            tracing::warn!(%error, "cannot search for stale resources of dead processes");
                        }
                        continue;
                    }
                    Err(RecvTimeoutError::Disconnected) => break,
                };
                has_cleaned = true;
                // One clean-up, which searches the whole run root, is for all that died meanwhile.
                let owners: Vec<DeadProcessOwner> = std::iter::once(owner).chain(request_receiver.try_iter()).collect();
                let result = match &node {
                    Ok(node) => {
                        clean_without_hanging(node, &run_root, &run_has_ended).map_err(|e| e.to_string())
                    }
                    Err(error) => Err(error.to_string()),
                };
                if run_has_ended.load(Ordering::Relaxed) {
                    break;
                }
                if let Err(error) = result {
                    tracing::warn!(dead = ?owners, error, "clean-up failed");
                }
                if owners.into_iter().any(|owner| result_sender.send(owner).is_err()) {
                    break;
                }
                // If the counter is full, the reader is already signaled.
                let _ = rustix::io::write(&*results_event_writer, &1u64.to_ne_bytes());
            }
        });
        let thread = thread.map_err(spawn_error)?;
        Ok(Cleaner {
            requests: Some(requests),
            results,
            results_event,
            has_ended,
            thread: Some(thread),
        })
    }

    /// Requests the removal of the stale resources of a process, which must be reaped.
    pub fn request_cleanup(&self, owner: DeadProcessOwner) {
        let requests = self.requests.as_ref().expect("open until dropped");
        requests.send(owner).expect("the thread ends only when this does");
    }

    /// Returns the next owner whose stale resources are removed.
    pub fn next_cleaned_owner(&self) -> Option<DeadProcessOwner> {
        let _ = rustix::io::read(&*self.results_event, &mut [0; 8]);
        self.results.try_recv().ok()
    }

    /// Returns a descriptor that becomes readable when [`Cleaner::next_cleaned_owner`] has results.
    pub fn results_fd(&self) -> BorrowedFd<'_> {
        self.results_event.as_fd()
    }
}

impl Drop for Cleaner {
    fn drop(&mut self) {
        self.has_ended.store(true, Ordering::Relaxed);
        self.requests = None;
        let Some(thread) = self.thread.take() else { return };
        // The thread ends after the dead process that it is cleaning up after.
        let start = Instant::now();
        while !thread.is_finished() {
            if start.elapsed() > LAST_CLEANUP_TIMEOUT {
                tracing::warn!("a clean-up does not end; the next run completes it");
                return;
            }
            std::thread::sleep(Duration::from_millis(1));
        }
        // The thread has logged its panic.
        let _ = thread.join();
    }
}

/// Failure of a clean-up.
#[derive(Debug, thiserror::Error)]
enum CleanupError {
    #[error(transparent)]
    ReadLayout(#[from] LayoutError),
    #[error("cannot remove {path}: {source}")]
    Remove { path: PathBuf, source: io::Error },
}

/// Calls [`remove_stale_resources`] while another thread removes half-made connections.
fn clean_without_hanging(
    node: &Node,
    run_root: &Path,
    has_ended: &AtomicBool,
) -> Result<(), CleanupError> {
    let (work_sender, work_receiver) = channel::<()>();
    std::thread::scope(|scope| {
        scope.spawn(move || {
            let mut interval = POLL_INTERVAL_MIN;
            while work_receiver.recv_timeout(interval) == Err(RecvTimeoutError::Timeout) {
                let start = Instant::now();
                if let Err(error) = remove_half_made_connections(run_root) {
                    tracing::debug!(%error, "cannot search for half-made connections");
                }
                interval = POLL_INTERVAL_MIN.max(POLL_INTERVAL_FACTOR * start.elapsed());
            }
        });
        let result = remove_stale_resources(node, run_root, has_ended);
        drop(work_sender);
        result
    })
}

/// Removes the stale resources of dead processes in this run, or part of them if the run ends meanwhile.
fn remove_stale_resources(
    node: &Node,
    run_root: &Path,
    has_ended: &AtomicBool,
) -> Result<(), CleanupError> {
    let mut death_cache = DeathCache::default();
    // Processes that die from here on are left to the next clean-up, because iceoryx2 has not processed their ports.
    let files = list_nodes(run_root)?;
    let dead: BTreeSet<u128> =
        files.map(|(id, _)| id).filter(|&id| death_cache.is_dead(id)).collect();
    let dead_connections = remove_half_made_connections(run_root)?;
    // Processes that died meanwhile may have left half-made connections too, so their nodes are not removed yet.
    let run_has_ended = || has_ended.load(Ordering::Relaxed);
    let list_result =
        service::remove_dead_nodes(node, dead.clone(), CLEANUP_ATTEMPT_TIMEOUT, &run_has_ended);
    if run_has_ended() {
        return Ok(());
    }
    if let Err(error) = list_result {
        tracing::warn!(%error, "cannot list nodes");
    }
    // A process killed during registration leaves a node that iceoryx2 cannot remove or does not list, so
    // its files are removed directly.
    for (_, path) in list_nodes(run_root)?.filter(|(id, _)| dead.contains(id)) {
        let result = if path.is_dir() { fs::remove_dir_all(&path) } else { fs::remove_file(&path) };
        result.map_err(|source| CleanupError::Remove { path, source })?;
    }
    // The clean-up of each endpoint leaves a connection to the other endpoint if that died first.
    dead_connections.into_iter().try_for_each(remove_if_present)
}

fn remove_if_present(path: PathBuf) -> Result<(), CleanupError> {
    match fs::remove_file(&path) {
        Err(source) if source.kind() != io::ErrorKind::NotFound => {
            Err(CleanupError::Remove { path, source })
        }
        _ => Ok(()),
    }
}

/// Removes connections that a process was creating when it was killed, for which iceoryx2 would wait.
/// Leaves those between two dead processes, and returns them.
fn remove_half_made_connections(run_root: &Path) -> Result<Vec<PathBuf>, CleanupError> {
    let mut death_cache = DeathCache::default();
    let mut dead_connections = Vec::new();
    for (path, endpoints) in list_connections(run_root)? {
        let dead_count =
            endpoints.into_iter().filter(|&endpoint| death_cache.is_dead(endpoint)).count();
        let is_half_made =
            |metadata: fs::Metadata| metadata.mode() & 0o777 == INCOMPLETE_PERMISSIONS;
        if dead_count > 0 && fs::metadata(&path).is_ok_and(is_half_made) {
            // The file may have been removed meanwhile.
            let _ = fs::File::options()
                .write(true)
                .open(&path)
                .and_then(|mut file| file.write_all(&INVALID_VERSION));
            remove_if_present(path)?;
        } else if dead_count == 2 {
            dead_connections.push(path);
        }
    }
    Ok(dead_connections)
}

/// Removes connections of dead processes that the alive endpoint has not opened. iceoryx2 leaves them: a
/// process creates a connection and then registers in it; a process killed in between leaves a complete
/// connection without an owner, and only the last owner removes it.
fn remove_unclaimed_connections(run_root: &Path) -> Result<(), CleanupError> {
    let mut death_cache = DeathCache::default();
    let mut memory_maps = BTreeMap::<u32, String>::new();
    for (path, endpoints) in list_connections(run_root)? {
        let Some(alive_index) =
            endpoints.iter().position(|&endpoint| !death_cache.is_dead(endpoint))
        else {
            continue;
        };
        if !death_cache.is_dead(endpoints[1 - alive_index]) {
            continue;
        }
        let alive_pid = layout::creator_pid(endpoints[alive_index]);
        let memory_maps = memory_maps.entry(alive_pid).or_insert_with(|| {
            fs::read_to_string(format!("/proc/{alive_pid}/maps")).unwrap_or_default()
        });
        // A process that cannot be inspected may have it open.
        let name = path.file_name().unwrap_or_default().to_string_lossy().into_owned();
        if !memory_maps.is_empty() && !memory_maps.contains(&name) {
            tracing::debug!(name, "removed an unclaimed connection");
            remove_if_present(path)?;
        }
    }
    Ok(())
}

/// Cache of which processes are dead, each checked once.
#[derive(Debug, Default)]
struct DeathCache(BTreeMap<u32, bool>);

impl DeathCache {
    /// Returns whether the process that created an ID is dead. Process IDs are not reused so soon;
    /// otherwise a later clean-up would find the resources.
    fn is_dead(&mut self, id: u128) -> bool {
        let process = layout::creator_pid(id);
        *self
            .0
            .entry(process)
            .or_insert_with(|| !Path::new("/proc").join(process.to_string()).exists())
    }
}

#[cfg(test)]
mod tests {
    use std::os::unix::fs::OpenOptionsExt as _;

    use protocol::run_root::{self, ICEORYX2_PREFIX};

    use super::layout::{creator_pid, nodes_dir};

    use super::*;

    #[test]
    fn clean_up_removes_half_registered_nodes_of_the_dead_only() {
        let base = tempfile::tempdir().unwrap();
        let run_root = RunRoot::create(&base.path().join("runs")).unwrap();
        run_root::join(run_root.path()).unwrap();
        let node = service::create_node("living").unwrap();
        assert_eq!(creator_pid(node.id().value()), std::process::id());

        let mut dead_process = std::process::Command::new("true").spawn().unwrap();
        dead_process.wait().unwrap();
        let nodes = nodes_dir(run_root.path());
        let files = || {
            let names = fs::read_dir(&nodes).unwrap().map(|entry| entry.unwrap().file_name());
            names.collect::<BTreeSet<_>>()
        };
        let before = files();
        // One has created only its directory, another also the file that shows that it is alive.
        let ids = [1, 2].map(|time_s: u128| u128::from(dead_process.id()) << 64 | time_s);
        for id in ids {
            fs::create_dir(nodes.join(id.to_string())).unwrap();
            fs::write(nodes.join(format!("{id}/{ICEORYX2_PREFIX}node.details")), "").unwrap();
        }
        fs::write(nodes.join(format!("{ICEORYX2_PREFIX}{}.node_monitor", ids[1])), "").unwrap();
        assert_eq!(files().len(), before.len() + 3);
        // One was connected to the other.
        let connection = |sender, receiver| {
            run_root.path().join(format!("{ICEORYX2_PREFIX}type_{sender}_{receiver}.connection"))
        };
        let dead_connection = connection(ids[0], ids[1]);
        fs::write(&dead_connection, "whole").unwrap();
        clean_without_hanging(&node, run_root.path(), &AtomicBool::new(false)).unwrap();
        assert_eq!(files(), before);
        assert!(!dead_connection.exists(), "a connection between the dead");
        // A half-made connection between alive processes is left to them.
        let alive_id = node.id().value();
        let half_made_files = [ids[0], alive_id].map(|receiver| {
            let path = connection(alive_id, receiver);
            let mut options = fs::File::options();
            (
                options
                    .write(true)
                    .create_new(true)
                    .mode(INCOMPLETE_PERMISSIONS)
                    .open(&path)
                    .unwrap(),
                path,
            )
        });
        remove_half_made_connections(run_root.path()).unwrap();
        assert_eq!(half_made_files.each_ref().map(|(_, path)| path.exists()), [false, true]);
        // A process that has the file open stops waiting, because the file is no longer empty and has an
        // invalid version.
        assert_eq!(half_made_files.map(|(file, _)| file.metadata().unwrap().len()), [8, 0]);
        // Complete connections are removed once the alive endpoint has released them, or if it never opened them.
        let unclaimed_connection = connection(ids[0], alive_id);
        let file = fs::File::options()
            .read(true)
            .write(true)
            .create_new(true)
            .open(&unclaimed_connection)
            .unwrap();
        file.set_len(4096).unwrap();
        let alive_connection = connection(alive_id, alive_id);
        fs::write(&alive_connection, "whole").unwrap();
        // SAFETY: a mapping of a file of this length, which no other process changes.
        let mapping = unsafe {
            use rustix::mm::{MapFlags, ProtFlags, mmap};
            mmap(std::ptr::null_mut(), 4096, ProtFlags::READ, MapFlags::SHARED, &file, 0).unwrap()
        };
        remove_unclaimed_connections(run_root.path()).unwrap();
        assert!(unclaimed_connection.exists(), "the living end has it open");
        // SAFETY: mapped above, and not accessed by other code.
        unsafe { rustix::mm::munmap(mapping, 4096).unwrap() };
        remove_unclaimed_connections(run_root.path()).unwrap();
        assert!(!unclaimed_connection.exists() && alive_connection.exists());
        drop(node);
        run_root.remove().unwrap();
    }
}
