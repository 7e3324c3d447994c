//! Child processes that take part in a measurement: started, watched, and ended.
//!
//! They share a directory. Each is started with [`Post`]: the directory, and its index.
//!
//! A thread watches them. If one exits early, a signal arrives, or the time is over, it kills all of them.
//! A process that waits for them then notices the end of a pipe or [`Peers::gone`].

use std::ffi::OsString;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use anyhow::{Context as _, anyhow, bail};
use protocol::brief;
use protocol::process::Stop;
use serde::Serialize;
use serde::de::DeserializeOwned;
use supervisor::child::{Child, in_words};
use supervisor::spawn::{Launcher, Role};

use crate::run::dead;
use crate::{Interrupted, MEASUREMENT_MAX, write};

/// Maximum lifetime of a peer, s. The kernel ends it then, in whatever state.
const LIFE_S_MAX: u32 = 300;
/// Polling interval of the watching thread.
const LOOK_EVERY: Duration = Duration::from_millis(50);
/// Polling interval for readiness and results.
const READY_EVERY: Duration = Duration::from_millis(1);
/// Maximum time for all peers to become ready and start, and for a finished peer to be ended.
const BEGIN_MAX: Duration = Duration::from_secs(20);

/// First argument of a peer's command line.
pub(crate) const PEER: &str = "peer";

/// Directory and index of a peer.
#[derive(Debug, Clone, clap::Args)]
pub(crate) struct Post {
    /// Directory that the peers share.
    pub(crate) dir: PathBuf,
    /// Index of the peer, from 0.
    pub(crate) index: usize,
}

impl Post {
    /// Returns the path of its brief, for a peer that is a robot.
    pub(crate) fn brief(&self) -> PathBuf {
        self.dir.join(format!("brief-{}.toml", self.index))
    }

    fn ready(&self) -> PathBuf {
        self.dir.join(format!("ready-{}", self.index))
    }

    fn result(&self) -> PathBuf {
        self.dir.join(format!("result-{}.json", self.index))
    }

    /// Returns the path of the file that tells all peers to start.
    fn go(&self) -> PathBuf {
        self.dir.join("go")
    }

    /// Reports that it is ready.
    pub(crate) fn report_ready(&self) -> anyhow::Result<()> {
        write(&self.ready(), "")
    }

    /// Reports that it is ready, and waits until all others are.
    pub(crate) fn wait_for_all(&self) -> anyhow::Result<()> {
        self.report_ready()?;
        let began = Instant::now();
        while !self.go().exists() {
            if began.elapsed() > BEGIN_MAX {
                bail!("the others were not ready in time");
            }
            std::thread::sleep(READY_EVERY);
        }
        Ok(())
    }

    /// Writes its result and waits to be killed, because its own exit would count as premature.
    pub(crate) fn report<T: Serialize>(&self, seen: &T) -> anyhow::Result<()> {
        let (result, unnamed) = (self.result(), self.result().with_extension("new"));
        write(&unnamed, &serde_json::to_string(seen)?)?;
        std::fs::rename(&unnamed, &result)
            .with_context(|| format!("cannot name {}", result.display()))?;
        std::thread::sleep(BEGIN_MAX);
        Ok(())
    }
}

/// Limits the lifetime of this process by an alarm, so that its waits need no deadlines.
pub(crate) fn limit_life() {
    // SAFETY: a plain system call.
    unsafe { libc::alarm(LIFE_S_MAX) };
}

/// Writes the briefs of peers that are robots.
pub(crate) fn write_briefs<B: Serialize>(
    dir: &Path,
    briefs: impl Iterator<Item = B>,
) -> anyhow::Result<()> {
    for (index, brief) in briefs.enumerate() {
        write(&Post { dir: dir.into(), index }.brief(), &brief::to_text(&brief))?;
    }
    Ok(())
}

/// Children of one measurement. Dropping the value kills and reaps them.
pub(crate) struct Peers {
    posts: Vec<Post>,
    watched: Arc<Watched>,
    watch: Option<JoinHandle<()>>,
}

struct Watched {
    children: Mutex<Vec<Child>>,
    /// Whether they are dead.
    gone: AtomicBool,
    /// Whether they are no longer needed.
    done: AtomicBool,
    why: Mutex<Option<anyhow::Error>>,
    stop: Stop,
}

impl Peers {
    /// Starts `count` processes of this executable with the same task: `verb` and these arguments.
    pub(crate) fn start(
        dir: &Path,
        stop: &Stop,
        count: usize,
        verb: &str,
        arguments: &[OsString],
    ) -> anyhow::Result<Peers> {
        let posts = (0..count).map(|index| Post { dir: dir.into(), index });
        let posts: Vec<Post> = posts.collect();
        let (mut children, launcher) = (Vec::new(), Launcher::of_this_executable());
        for Post { dir, index } in &posts {
            let mut words: Vec<OsString> = vec![PEER.into(), dir.into(), index.to_string().into()];
            words.push(verb.into());
            words.extend_from_slice(arguments);
            let log = dir.join(format!("peer-{index}.log"));
            children.push(launcher.spawn(Role::Bench { words: &words }, &log)?);
        }
        let watched = Arc::new(Watched {
            children: Mutex::new(children),
            gone: AtomicBool::new(false),
            done: AtomicBool::new(false),
            why: Mutex::new(None),
            stop: stop.clone(),
        });
        let watch = std::thread::spawn({
            let watched = watched.clone();
            move || watched.watch()
        });
        Ok(Peers { posts, watched, watch: Some(watch) })
    }

    /// Waits until every peer is ready.
    pub(crate) fn wait_ready(&self) -> anyhow::Result<()> {
        self.posts.iter().try_for_each(|post| self.wait_for(&post.ready()))
    }

    /// Starts all peers once every one is ready, and returns what they [report](Post::report).
    pub(crate) fn results<T: DeserializeOwned>(&self) -> anyhow::Result<Vec<T>> {
        self.wait_ready()?;
        if let Some(post) = self.posts.first() {
            write(&post.go(), "")?;
        }
        let result = |post: &Post| {
            let path = post.result();
            self.wait_for(&path)?;
            let cannot = || format!("cannot read {}", path.display());
            serde_json::from_slice(&std::fs::read(&path).with_context(cannot)?).with_context(cannot)
        };
        self.posts.iter().map(result).collect()
    }

    fn wait_for(&self, file: &Path) -> anyhow::Result<()> {
        while !file.exists() {
            self.check()?;
            std::thread::sleep(READY_EVERY);
        }
        Ok(())
    }

    /// Returns whether the first one has written its result.
    pub(crate) fn is_done(&self) -> bool {
        self.posts[0].result().exists()
    }

    /// Fails with the reason if the peers are dead.
    pub(crate) fn check(&self) -> anyhow::Result<()> {
        if self.gone() { Err(self.why()) } else { Ok(()) }
    }

    /// Returns whether the peers are dead.
    pub(crate) fn gone(&self) -> bool {
        self.watched.gone.load(Ordering::Acquire)
    }

    /// Returns the reason why the peers are dead. Waits for the watching thread, because a closed pipe may
    /// be noticed earlier.
    pub(crate) fn why(&self) -> anyhow::Error {
        let began = Instant::now();
        while !self.gone() && began.elapsed() < 10 * LOOK_EVERY {
            std::thread::sleep(READY_EVERY);
        }
        let why = self.watched.why.lock().expect("the watch does not panic").take();
        why.unwrap_or_else(|| anyhow!("a peer closed its end, and lives"))
    }
}

impl Watched {
    fn watch(&self) {
        let began = Instant::now();
        while !self.done.load(Ordering::Acquire) {
            let mut children = self.children.lock().expect("nobody panics with it");
            if let Some(reason) = self.failure(&mut children, began) {
                *self.why.lock().expect("nobody panics with it") = Some(reason);
                self.gone.store(true, Ordering::Release);
                children.iter().for_each(|child| drop(child.kill()));
                return;
            }
            drop(children);
            std::thread::park_timeout(LOOK_EVERY);
        }
    }

    /// Returns the reason why the measurement cannot continue, if there is one.
    fn failure(&self, children: &mut [Child], began: Instant) -> Option<anyhow::Error> {
        if self.stop.requested() {
            return Some(Interrupted.into());
        }
        if began.elapsed() > MEASUREMENT_MAX {
            return Some(anyhow!("not measured within {} s", MEASUREMENT_MAX.as_secs()));
        }
        children.iter_mut().find_map(|child| {
            let what = format!("a peer ended early ({})", in_words(child.ended()?));
            Some(dead(&what, child))
        })
    }
}

impl Drop for Peers {
    fn drop(&mut self) {
        self.watched.done.store(true, Ordering::Release);
        if let Some(watch) = self.watch.take() {
            watch.thread().unpark();
            let _ = watch.join();
        }
        if let Ok(mut children) = self.watched.children.lock() {
            // All are killed first, then each is reaped.
            children.iter().for_each(|child| drop(child.kill()));
            children.clear();
        }
    }
}
