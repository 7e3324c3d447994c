//! Cleaning up after the dead, on a thread of its own: it may take long, and the supervisor's loop
//! must not wait for it.
//!
//! Only the supervisor cleans up, one death at a time, and only after the dead was reaped: before,
//! iceoryx2 takes it for alive, and its replacement finds no free port.

use std::fs;
use std::io;
use std::path::{Path, PathBuf};
use std::sync::mpsc::{Receiver, Sender, channel};
use std::thread::JoinHandle;
use std::time::Duration;

use protocol::service::{self, ServiceError};

/// One attempt to remove what the dead left.
const ATTEMPT_MAX: Duration = Duration::from_millis(500);

/// The thread, and the way to it.
pub struct Cleaner {
    requests: Option<Sender<usize>>,
    done: Receiver<usize>,
    thread: Option<JoinHandle<()>>,
}

impl Cleaner {
    /// Starts the thread in a run that this process has joined.
    pub fn start(run_root: &Path) -> io::Result<Cleaner> {
        let (requests, incoming) = channel::<usize>();
        let (outgoing, done) = channel();
        let run_root = run_root.to_path_buf();
        let thread = std::thread::Builder::new().name("cleanup".into()).spawn(move || {
            for robot in incoming {
                if let Err(error) = clean(&run_root) {
                    tracing::warn!(robot, %error, "clean-up failed");
                }
                if outgoing.send(robot).is_err() {
                    break;
                }
            }
        })?;
        Ok(Cleaner { requests: Some(requests), done, thread: Some(thread) })
    }

    /// Asks for the remains of `robot`'s process, which is reaped, to be removed.
    pub fn request(&self, robot: usize) {
        let requests = self.requests.as_ref().expect("open until dropped");
        requests.send(robot).expect("the thread ends only when this does");
    }

    /// The next robot whose remains are gone.
    pub fn done(&self) -> Option<usize> {
        self.done.try_recv().ok()
    }
}

impl Drop for Cleaner {
    fn drop(&mut self) {
        self.requests = None;
        if let Some(thread) = self.thread.take() {
            // It ends after the clean-up at hand, which is bounded; a panic was logged there.
            let _ = thread.join();
        }
    }
}

/// Why the dead could not be cleaned up.
#[derive(Debug, thiserror::Error)]
enum CleanupError {
    #[error(transparent)]
    Service(#[from] ServiceError),
    #[error("cannot remove {path}: {source}")]
    Remove { path: PathBuf, source: io::Error },
}

/// Removes what dead processes left in this run.
fn clean(run_root: &Path) -> Result<(), CleanupError> {
    let node = service::node("cleanup")?;
    let state = node.blocking_cleanup_dead_nodes(ATTEMPT_MAX);
    tracing::debug!(?state, "cleaned up");
    if state.failed_cleanups > 0 {
        remove_half_registered(&node, run_root)?;
    }
    Ok(())
}

/// A process killed while it registered leaves a node that iceoryx2 cannot remove: its files go by
/// hand, known by the node's id in their names.
fn remove_half_registered(node: &service::Node, run_root: &Path) -> Result<(), CleanupError> {
    use iceoryx2::prelude::{CallbackProgression, NodeState};
    let mut dead = Vec::new();
    let listed = service::Node::list(node.config(), |state| {
        if let NodeState::Dead(_) = &state {
            dead.push(state.node_id().to_string());
        }
        CallbackProgression::Continue
    });
    if let Err(error) = listed {
        tracing::warn!(%error, "cannot list nodes");
    }
    for id in dead {
        remove_named(run_root, &id)?;
    }
    Ok(())
}

/// Removes every file and directory below `directory` whose name contains `id`.
fn remove_named(directory: &Path, id: &str) -> Result<(), CleanupError> {
    let failed = |path: &Path| {
        let path = path.to_path_buf();
        move |source| CleanupError::Remove { path, source }
    };
    for entry in fs::read_dir(directory).map_err(failed(directory))?.flatten() {
        let path = entry.path();
        let is_directory = entry.file_type().is_ok_and(|kind| kind.is_dir());
        let named = entry.file_name().to_string_lossy().contains(id);
        match (named, is_directory) {
            (true, true) => fs::remove_dir_all(&path).map_err(failed(&path))?,
            (true, false) => fs::remove_file(&path).map_err(failed(&path))?,
            (false, true) => remove_named(&path, id)?,
            (false, false) => {}
        }
    }
    Ok(())
}
