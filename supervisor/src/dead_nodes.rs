//! What a process that died during the run left in iceoryx2, its node and ports, and their removal
//! on a thread of its own: it may take long, and the supervisor's loop must not wait for it.
//!
//! Only the supervisor cleans up, one death at a time, and only after the dead was reaped: before,
//! iceoryx2 takes it for alive, and its replacement finds no free port.

pub mod layout;

use std::collections::{BTreeMap, BTreeSet};
use std::fs;
use std::io::{self, Write as _};
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

use crate::spawn::SpawnError;

use self::layout::{HALF_MADE, LayoutError, connections, nodes};

/// One attempt to remove what the dead left.
const ATTEMPT_MAX: Duration = Duration::from_millis(500);

/// While a clean-up is at work, half-made connections are looked for this often: iceoryx2 waits
/// half a second for one whose maker has died meanwhile, and goes on once it is gone.
const LOOK_EVERY: Duration = Duration::from_millis(20);
/// A connection with the dead that is still there so long after a clean-up may be one that nobody opens any more.
/// The living let go of theirs when they next send or receive.
const UNCLAIMED_AFTER: Duration = Duration::from_secs(1);
/// The last clean-up is waited for no longer than this at the end of a run.
const LAST_MAX: Duration = Duration::from_secs(5);

/// Written at the beginning of a half-made file: no version of iceoryx2. Whoever waits for it to
/// become whole gives up at once, even if it is open already.
const SPOILT: [u8; 8] = [0xff; 8];

/// Why nobody could be there to clean up.
#[derive(Debug, thiserror::Error)]
pub enum CleanerError {
    /// It would not find what the dead leave.
    #[error(transparent)]
    Layout(#[from] LayoutError),
    /// No thread.
    #[error(transparent)]
    Thread(#[from] SpawnError),
}

/// Whose process died.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Dead {
    /// That of a robot, by whatever number its supervisor knows it.
    Robot(usize),
    /// The bridge to other hosts.
    Bridge,
    /// The process that shows the run to ROS 2.
    Ros2,
}

/// The thread, and the way to it.
pub struct Cleaner {
    requests: Option<Sender<Dead>>,
    done: Receiver<Dead>,
    /// Readable while there may be news in `done`.
    news: Arc<OwnedFd>,
    thread: Option<JoinHandle<()>>,
}

impl Cleaner {
    /// Starts the thread in a run that this process has joined, with a node of its own.
    pub fn start(run_root: &RunRoot, node: &Node) -> Result<Cleaner, CleanerError> {
        layout::verify(run_root.path(), node)?;
        let (requests, incoming) = channel::<Dead>();
        let (outgoing, done) = channel();
        let refused = |source| SpawnError::of_thread("the clean-up thread", source);
        let news = eventfd(0, EventfdFlags::CLOEXEC | EventfdFlags::NONBLOCK);
        let news = Arc::new(news.map_err(|error| refused(error.into()))?);
        let told = news.clone();
        let run_root = run_root.path().to_path_buf();
        let thread = std::thread::Builder::new().name("cleanup".into());
        let thread = thread.spawn(move || {
            let node = service::node("cleanup");
            let mut cleaned_some = false;
            loop {
                let wait = if cleaned_some { UNCLAIMED_AFTER } else { Duration::MAX };
                let dead = match incoming.recv_timeout(wait) {
                    Ok(dead) => dead,
                    Err(RecvTimeoutError::Timeout) => {
                        cleaned_some = false;
                        if let Err(error) = remove_unclaimed_connections(&run_root) {
                            tracing::warn!(%error, "cannot look for what the dead left");
                        }
                        continue;
                    }
                    Err(RecvTimeoutError::Disconnected) => break,
                };
                cleaned_some = true;
                let cleaned = match &node {
                    Ok(node) => clean_watched(node, &run_root).map_err(|e| e.to_string()),
                    Err(error) => Err(error.to_string()),
                };
                if let Err(error) = cleaned {
                    tracing::warn!(?dead, error, "clean-up failed");
                }
                if outgoing.send(dead).is_err() {
                    break;
                }
                // Full is as good as told.
                let _ = rustix::io::write(&*told, &1u64.to_ne_bytes());
            }
        });
        let thread = thread.map_err(refused)?;
        Ok(Cleaner { requests: Some(requests), done, news, thread: Some(thread) })
    }

    /// Asks for what this process, which is reaped, left to be removed.
    pub fn request(&self, dead: Dead) {
        let requests = self.requests.as_ref().expect("open until dropped");
        requests.send(dead).expect("the thread ends only when this does");
    }

    /// The next one of whose process nothing is left.
    pub fn done(&self) -> Option<Dead> {
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
    #[error(transparent)]
    Look(#[from] LayoutError),
    #[error("cannot remove {path}: {source}")]
    Remove { path: PathBuf, source: io::Error },
}

/// [`clean`], with somebody beside it who removes what others leave half-made meanwhile.
fn clean_watched(node: &Node, run_root: &Path) -> Result<(), CleanupError> {
    let (at_work, done) = channel::<()>();
    std::thread::scope(|scope| {
        scope.spawn(move || {
            while done.recv_timeout(LOOK_EVERY) == Err(RecvTimeoutError::Timeout) {
                if let Err(error) = remove_half_made_connections(run_root) {
                    tracing::debug!(%error, "cannot look for half-made connections");
                }
            }
        });
        let cleaned = clean(node, run_root);
        drop(at_work);
        cleaned
    })
}

/// Removes what dead processes left in this run.
fn clean(node: &Node, run_root: &Path) -> Result<(), CleanupError> {
    let mut census = Census::default();
    // Whoever dies from here on has ports that iceoryx2 has not seen to: the next clean-up's work.
    let files = nodes(run_root)?;
    let dead: BTreeSet<u128> = files.map(|(id, _)| id).filter(|&id| census.is_gone(id)).collect();
    let between_the_dead = remove_half_made_connections(run_root)?;
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
    for (_, path) in nodes(run_root)?.filter(|(id, _)| dead.contains(id)) {
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

/// Removes connections that a process was making when it was killed: iceoryx2 would wait until they
/// are whole. Those between two dead processes are left, and told.
fn remove_half_made_connections(run_root: &Path) -> Result<Vec<PathBuf>, CleanupError> {
    let mut census = Census::default();
    let mut between_the_dead = Vec::new();
    for (path, ends) in connections(run_root)? {
        let gone = ends.into_iter().filter(|&end| census.is_gone(end)).count();
        let half_made = |found: fs::Metadata| found.mode() & 0o777 == HALF_MADE;
        if gone > 0 && fs::metadata(&path).is_ok_and(half_made) {
            // It may be gone by now.
            let _ = fs::File::options()
                .write(true)
                .open(&path)
                .and_then(|mut file| file.write_all(&SPOILT));
            remove_if_there(path)?;
        } else if gone == 2 {
            between_the_dead.push(path);
        }
    }
    Ok(between_the_dead)
}

/// Removes connections of the dead that the living end has not opened. iceoryx2 leaves them: a process makes a
/// connection and then signs it; killed between the two, it has left one that is whole and signed by nobody, and its
/// removal is the work of the last who had signed.
fn remove_unclaimed_connections(run_root: &Path) -> Result<(), CleanupError> {
    let mut census = Census::default();
    let mut opened = BTreeMap::<u32, String>::new();
    for (path, ends) in connections(run_root)? {
        let Some(living) = ends.iter().position(|&end| !census.is_gone(end)) else { continue };
        if !census.is_gone(ends[1 - living]) {
            continue;
        }
        let living = layout::process_of(ends[living]);
        let opened = opened.entry(living).or_insert_with(|| {
            fs::read_to_string(format!("/proc/{living}/maps")).unwrap_or_default()
        });
        // Whoever cannot be looked at may have it open.
        let name = path.file_name().unwrap_or_default().to_string_lossy().into_owned();
        if !opened.is_empty() && !opened.contains(&name) {
            tracing::debug!(name, "a connection that nobody opened is removed");
            remove_if_there(path)?;
        }
    }
    Ok(())
}

/// Who is dead, each looked at once.
#[derive(Debug, Default)]
struct Census(BTreeMap<u32, bool>);

impl Census {
    /// Whether the process that made an id is dead. None is reused so soon; if one were, a later
    /// clean-up would find what this one left.
    fn is_gone(&mut self, id: u128) -> bool {
        let process = layout::process_of(id);
        *self
            .0
            .entry(process)
            .or_insert_with(|| !Path::new("/proc").join(process.to_string()).exists())
    }
}

#[cfg(test)]
mod tests {
    use std::os::unix::fs::OpenOptionsExt as _;

    use protocol::run_root::{self, PREFIX};

    use super::layout::{nodes_in, process_of};

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
        let nodes = nodes_in(run_root.path());
        let files = || {
            let names = fs::read_dir(&nodes).unwrap().map(|entry| entry.unwrap().file_name());
            names.collect::<BTreeSet<_>>()
        };
        let before = files();
        // One had made its directory alone, another the file that shows that it lives as well.
        let ids = [1, 2].map(|time_s: u128| u128::from(gone.id()) << 64 | time_s);
        for id in ids {
            fs::create_dir(nodes.join(id.to_string())).unwrap();
            fs::write(nodes.join(format!("{id}/{PREFIX}node.details")), "").unwrap();
        }
        fs::write(nodes.join(format!("{PREFIX}{}.node_monitor", ids[1])), "").unwrap();
        assert_eq!(files().len(), before.len() + 3);
        // And one knew the other.
        let connection = |sender, receiver| {
            run_root.path().join(format!("{PREFIX}type_{sender}_{receiver}.connection"))
        };
        let known = connection(ids[0], ids[1]);
        fs::write(&known, "whole").unwrap();
        clean_watched(&living, run_root.path()).unwrap();
        assert_eq!(files(), before);
        assert!(!known.exists(), "a connection between the dead");
        // Of two half-made connections, the one between the living is left to them.
        let alive = living.id().value();
        let made = [ids[0], alive].map(|end| {
            let path = connection(alive, end);
            let mut options = fs::File::options();
            (options.write(true).create_new(true).mode(HALF_MADE).open(&path).unwrap(), path)
        });
        remove_half_made_connections(run_root.path()).unwrap();
        assert_eq!(made.each_ref().map(|(_, path)| path.exists()), [false, true]);
        // Who has it open already stops waiting: it is not empty any more, and of no version.
        assert_eq!(made.map(|(file, _)| file.metadata().unwrap().len()), [8, 0]);
        // Whole ones go once the dead one's neighbour has let go of them, or had never opened them.
        let left = connection(ids[0], alive);
        let file = fs::File::options().read(true).write(true).create_new(true).open(&left).unwrap();
        file.set_len(4096).unwrap();
        let between_the_living = connection(alive, alive);
        fs::write(&between_the_living, "whole").unwrap();
        // SAFETY: a mapping of a file of this length, which nobody else changes.
        let mapped = unsafe {
            use rustix::mm::{MapFlags, ProtFlags, mmap};
            mmap(std::ptr::null_mut(), 4096, ProtFlags::READ, MapFlags::SHARED, &file, 0).unwrap()
        };
        remove_unclaimed_connections(run_root.path()).unwrap();
        assert!(left.exists(), "the living end has it open");
        // SAFETY: mapped above, and looked at by nobody.
        unsafe { rustix::mm::munmap(mapped, 4096).unwrap() };
        remove_unclaimed_connections(run_root.path()).unwrap();
        assert!(!left.exists() && between_the_living.exists());
        drop(living);
        run_root.remove().unwrap();
    }
}
