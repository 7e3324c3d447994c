//! What a process that died during the run left in iceoryx2, its node and ports, and their removal
//! on a thread of its own: it may take long, and the supervisor's loop must not wait for it.
//!
//! Only the supervisor cleans up, one death at a time, and only after the dead was reaped: before,
//! iceoryx2 takes it for alive, and its replacement finds no free port.

use std::collections::{BTreeMap, BTreeSet};
use std::fs;
use std::io;
use std::os::fd::{AsFd, BorrowedFd, OwnedFd};
use std::os::unix::fs::MetadataExt as _;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::mpsc::{Receiver, RecvTimeoutError, Sender, channel};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use iceoryx2::prelude::{CallbackProgression, NodeState};
use protocol::run_root::RunRoot;
use protocol::service::{self, Node};
use rustix::event::{EventfdFlags, eventfd};

/// One attempt to remove what the dead left.
const ATTEMPT_MAX: Duration = Duration::from_millis(500);

/// While a clean-up is at work, half-made connections are looked for this often: iceoryx2 waits
/// for ever for one whose maker has died meanwhile, and goes on once it is gone.
const LOOK_EVERY: Duration = Duration::from_millis(20);
/// The last clean-up is waited for no longer than this at the end of a run.
const LAST_MAX: Duration = Duration::from_secs(5);

/// Where iceoryx2 keeps connections.
const SHARED_MEMORY: &str = "/dev/shm";
/// Permissions of shared memory that is being made; when it is whole, it may be read too.
const HALF_MADE: u32 = 0o200;

/// The thread, and the way to it.
pub struct Cleaner {
    requests: Option<Sender<usize>>,
    done: Receiver<usize>,
    /// Readable while there may be news in `done`.
    news: Arc<OwnedFd>,
    thread: Option<JoinHandle<()>>,
}

impl Cleaner {
    /// Starts the thread in a run that this process has joined.
    pub fn start(run_root: &RunRoot) -> io::Result<Cleaner> {
        let (requests, incoming) = channel::<usize>();
        let (outgoing, done) = channel();
        let news = Arc::new(eventfd(0, EventfdFlags::CLOEXEC | EventfdFlags::NONBLOCK)?);
        let told = news.clone();
        let (run_root, prefix) = (run_root.path().to_path_buf(), run_root.prefix());
        let thread = std::thread::Builder::new().name("cleanup".into()).spawn(move || {
            let node = service::node("cleanup");
            for robot in incoming {
                let cleaned = match &node {
                    Ok(node) => clean_watched(node, &run_root, &prefix).map_err(|e| e.to_string()),
                    Err(error) => Err(error.to_string()),
                };
                if let Err(error) = cleaned {
                    tracing::warn!(robot, error, "clean-up failed");
                }
                if outgoing.send(robot).is_err() {
                    break;
                }
                // Full is as good as told.
                let _ = rustix::io::write(&*told, &1u64.to_ne_bytes());
            }
        })?;
        Ok(Cleaner { requests: Some(requests), done, news, thread: Some(thread) })
    }

    /// Asks for the remains of `robot`'s process, which is reaped, to be removed.
    pub fn request(&self, robot: usize) {
        let requests = self.requests.as_ref().expect("open until dropped");
        requests.send(robot).expect("the thread ends only when this does");
    }

    /// The next robot whose remains are gone.
    pub fn done(&self) -> Option<usize> {
        let _ = rustix::io::read(&*self.news, &mut [0; 8]);
        self.done.try_recv().ok()
    }

    /// Readable when [`Cleaner::done`] has something new to say.
    pub fn news(&self) -> BorrowedFd<'_> {
        self.news.as_fd()
    }
}

impl Drop for Cleaner {
    fn drop(&mut self) {
        self.requests = None;
        let Some(thread) = self.thread.take() else { return };
        // It ends after the clean-up at hand.
        let asked = Instant::now();
        while !thread.is_finished() {
            if asked.elapsed() > LAST_MAX {
                tracing::warn!("a clean-up does not end; left to the next run");
                return;
            }
            std::thread::sleep(Duration::from_millis(1));
        }
        // A panic was logged there.
        let _ = thread.join();
    }
}

/// Why the dead could not be cleaned up.
#[derive(Debug, thiserror::Error)]
enum CleanupError {
    #[error("cannot look into {path}: {source}")]
    Look { path: PathBuf, source: io::Error },
    #[error("cannot remove {path}: {source}")]
    Remove { path: PathBuf, source: io::Error },
}

/// [`clean`], with somebody beside it who removes what others leave half-made meanwhile.
fn clean_watched(node: &Node, run_root: &Path, prefix: &str) -> Result<(), CleanupError> {
    let (at_work, done) = channel::<()>();
    std::thread::scope(|scope| {
        scope.spawn(move || {
            while done.recv_timeout(LOOK_EVERY) == Err(RecvTimeoutError::Timeout) {
                if let Err(error) = remove_half_made_connections(Path::new(SHARED_MEMORY), prefix) {
                    tracing::debug!(%error, "cannot look for half-made connections");
                }
            }
        });
        let cleaned = clean(node, run_root, prefix);
        drop(at_work);
        cleaned
    })
}

/// Removes what dead processes left in this run.
fn clean(node: &Node, run_root: &Path, prefix: &str) -> Result<(), CleanupError> {
    let nodes = run_root.join("nodes");
    let mut census = Census::default();
    // Whoever dies from here on has ports that iceoryx2 has not seen to: the next clean-up's work.
    let files = files_by_node(&nodes)?;
    let dead: BTreeSet<u128> = files.map(|(id, _)| id).filter(|&id| census.is_gone(id)).collect();
    let between_the_dead = remove_half_made_connections(Path::new(SHARED_MEMORY), prefix)?;
    let mut unseen = dead.clone();
    let listed = Node::list(node.config(), |state| {
        // Others that died meanwhile may have left half-made connections as well.
        let seen_to = unseen.remove(&state.node_id().value());
        if let (true, NodeState::Dead(of_the_dead)) = (seen_to, state)
            && let Err(error) = of_the_dead.blocking_remove_stale_resources(ATTEMPT_MAX)
        {
            tracing::debug!(?error, "removed by hand");
        }
        // Looking at one of the living is as dear as removing a port of the dead.
        if unseen.is_empty() { CallbackProgression::Stop } else { CallbackProgression::Continue }
    });
    if let Err(error) = listed {
        tracing::warn!(%error, "cannot list nodes");
    }
    // A process killed while it registered leaves a node that iceoryx2 cannot remove, or does not
    // even list: its files go by hand.
    for (_, path) in files_by_node(&nodes)?.filter(|(id, _)| dead.contains(id)) {
        let removed =
            if path.is_dir() { fs::remove_dir_all(&path) } else { fs::remove_file(&path) };
        removed.map_err(|source| CleanupError::Remove { path, source })?;
    }
    // Each end's clean-up leaves a connection to the other end, who died before it could.
    between_the_dead.into_iter().try_for_each(remove_if_there)
}

fn remove_if_there(path: PathBuf) -> Result<(), CleanupError> {
    match fs::remove_file(&path) {
        Err(source) if source.kind() != io::ErrorKind::NotFound => {
            Err(CleanupError::Remove { path, source })
        }
        _ => Ok(()),
    }
}

/// Files and directories of nodes, each with the node's id.
fn files_by_node(
    nodes: &Path,
) -> Result<impl Iterator<Item = (u128, PathBuf)> + use<>, CleanupError> {
    let failed = |source| CleanupError::Look { path: nodes.into(), source };
    let entries = fs::read_dir(nodes).map_err(failed)?.flatten();
    Ok(entries
        .filter_map(|entry| Some((node_in(&entry.file_name().to_string_lossy())?, entry.path()))))
}

/// Removes connections that a process was making when it was killed: iceoryx2 would wait for ever
/// until they are whole. Those between two dead processes are left, and told.
fn remove_half_made_connections(
    shared_memory: &Path,
    prefix: &str,
) -> Result<Vec<PathBuf>, CleanupError> {
    let mut census = Census::default();
    let mut between_the_dead = Vec::new();
    for (path, ends) in connections(shared_memory, prefix)? {
        let gone = ends.into_iter().filter(|&end| census.is_gone(end)).count();
        let half_made = |found: fs::Metadata| found.mode() & 0o777 == HALF_MADE;
        if gone > 0 && fs::metadata(&path).is_ok_and(half_made) {
            remove_if_there(path)?;
        } else if gone == 2 {
            between_the_dead.push(path);
        }
    }
    Ok(between_the_dead)
}

/// This run's connections, and the ids of their ends.
fn connections(
    shared_memory: &Path,
    prefix: &str,
) -> Result<impl Iterator<Item = (PathBuf, [u128; 2])>, CleanupError> {
    let failed = |source| CleanupError::Look { path: shared_memory.into(), source };
    let entries = fs::read_dir(shared_memory).map_err(failed)?.flatten();
    Ok(entries.filter_map(move |entry| {
        let name = entry.file_name();
        let ends = ends_in(name.to_str()?.strip_prefix(prefix)?)?;
        Some((entry.path(), ends))
    }))
}

/// The ids of sender and receiver in `<type>_<sender>_<receiver>.connection`.
fn ends_in(name: &str) -> Option<[u128; 2]> {
    let (rest, receiver) = name.strip_suffix(".connection")?.rsplit_once('_')?;
    let (_, sender) = rest.rsplit_once('_')?;
    Some([sender.parse().ok()?, receiver.parse().ok()?])
}

/// The id of the node that a file or directory below `nodes/` belongs to: `<id>` is what it owns,
/// `<prefix>_<id>.node_monitor` and its like show that it lives.
fn node_in(name: &str) -> Option<u128> {
    let (stem, _) = name.split_once('.').unwrap_or((name, ""));
    let (_, id) = stem.rsplit_once('_').unwrap_or(("", stem));
    id.parse().ok()
}

/// Who is dead, each looked at once.
#[derive(Debug, Default)]
struct Census(BTreeMap<u32, bool>);

impl Census {
    /// Whether the process that made an id is dead. None is reused so soon; if one were, a later
    /// clean-up would find what this one left.
    fn is_gone(&mut self, id: u128) -> bool {
        let process = process_of(id);
        *self
            .0
            .entry(process)
            .or_insert_with(|| !Path::new("/proc").join(process.to_string()).exists())
    }
}

/// The process that made an id, of a node or a port: its third 32 bits, after seconds and nanoseconds.
fn process_of(id: u128) -> u32 {
    (id >> 64) as u32
}

#[cfg(test)]
mod tests {
    use std::os::unix::fs::OpenOptionsExt as _;

    use protocol::run_root;

    use super::*;

    #[test]
    fn who_died_while_it_registered_leaves_nothing_and_the_living_keep_their_nodes() {
        let base = tempfile::tempdir().unwrap();
        let run_root = RunRoot::create(&base.path().join("runs")).unwrap();
        run_root::join(run_root.path()).unwrap();
        let living = service::node("living").unwrap();
        assert_eq!(process_of(living.id().value()), std::process::id());

        let mut gone = std::process::Command::new("true").spawn().unwrap();
        gone.wait().unwrap();
        let nodes = run_root.path().join("nodes");
        let files = || {
            let names = fs::read_dir(&nodes).unwrap().map(|entry| entry.unwrap().file_name());
            names.collect::<BTreeSet<_>>()
        };
        let before = files();
        // One had made its directory alone, another the file that shows that it lives as well.
        let ids = [1, 2].map(|time_s: u128| u128::from(gone.id()) << 64 | time_s);
        for id in ids {
            fs::create_dir(nodes.join(id.to_string())).unwrap();
            fs::write(nodes.join(format!("{id}/{}node.details", run_root.prefix())), "").unwrap();
        }
        fs::write(nodes.join(format!("{}{}.node_monitor", run_root.prefix(), ids[1])), "").unwrap();
        assert_eq!(files().len(), before.len() + 3);
        // And one knew the other.
        let known = format!("{}type_{}_{}.connection", run_root.prefix(), ids[0], ids[1]);
        let known = Path::new(SHARED_MEMORY).join(known);
        fs::write(&known, "whole").unwrap();
        clean_watched(&living, run_root.path(), &run_root.prefix()).unwrap();
        assert_eq!(files(), before);
        assert!(!known.exists(), "a connection between the dead");
        // Of two half-made connections, the one between the living is left to them.
        let memory = tempfile::tempdir().unwrap();
        let alive = living.id().value();
        let paths = [ids[0], alive].map(|end| {
            let name = format!("{}type_{alive}_{end}.connection", run_root.prefix());
            let path = memory.path().join(name);
            fs::File::options().write(true).create_new(true).mode(HALF_MADE).open(&path).unwrap();
            path
        });
        remove_half_made_connections(memory.path(), &run_root.prefix()).unwrap();
        assert_eq!(paths.map(|path| path.exists()), [false, true]);
        drop(living);
        run_root.remove().unwrap();
    }
}
