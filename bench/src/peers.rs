//! Child processes that take part in a measurement: started, watched, and ended.
//!
//! They meet in a directory. Each is started with [`Post`]: the directory, and which of them it is.
//!
//! A thread watches them. Once one ends early, a signal comes, or time is up, it kills all of
//! them: whoever waits for them is then woken by the end of a pipe, or sees [`Peers::gone`].

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

/// A peer that lives this long is ended by the kernel, whatever it waits for.
const LIFE_S_MAX: u32 = 300;
/// How often the watch looks around.
const LOOK_EVERY: Duration = Duration::from_millis(50);
/// How often readiness is looked at, and results are.
const READY_EVERY: Duration = Duration::from_millis(1);
/// Everybody is there, and begins, within this; and whoever is done is ended within it.
const BEGIN_MAX: Duration = Duration::from_secs(20);

/// The first word of a peer's command line.
pub(crate) const PEER: &str = "peer";

/// Where a peer meets the others, and which of them it is.
#[derive(Debug, Clone, clap::Args)]
pub(crate) struct Post {
    /// Where they meet.
    pub(crate) dir: PathBuf,
    /// Which peer it is, from 0.
    pub(crate) index: usize,
}

impl Post {
    /// Its brief, if it is a robot.
    pub(crate) fn brief(&self) -> PathBuf {
        self.dir.join(format!("brief-{}.toml", self.index))
    }

    fn ready(&self) -> PathBuf {
        self.dir.join(format!("ready-{}", self.index))
    }

    fn result(&self) -> PathBuf {
        self.dir.join(format!("result-{}.json", self.index))
    }

    /// Made once everybody is ready: begin.
    fn go(&self) -> PathBuf {
        self.dir.join("go")
    }

    /// Says that it is ready.
    pub(crate) fn say_ready(&self) -> anyhow::Result<()> {
        write(&self.ready(), "")
    }

    /// Says that it is ready, and waits until all others are.
    pub(crate) fn wait_for_all(&self) -> anyhow::Result<()> {
        self.say_ready()?;
        let began = Instant::now();
        while !self.go().exists() {
            if began.elapsed() > BEGIN_MAX {
                bail!("the others were not ready in time");
            }
            std::thread::sleep(READY_EVERY);
        }
        Ok(())
    }

    /// Leaves its result and waits to be ended: an end of its own would count as too early.
    pub(crate) fn report<T: Serialize>(&self, seen: &T) -> anyhow::Result<()> {
        let (result, unnamed) = (self.result(), self.result().with_extension("new"));
        write(&unnamed, &serde_json::to_string(seen)?)?;
        std::fs::rename(&unnamed, &result)
            .with_context(|| format!("cannot name {}", result.display()))?;
        std::thread::sleep(BEGIN_MAX);
        Ok(())
    }
}

/// A peer's waits need no deadline of their own after this: the kernel ends it.
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

/// Children of one measurement; dropped, they are dead and reaped.
pub(crate) struct Peers {
    posts: Vec<Post>,
    watched: Arc<Watched>,
    watch: Option<JoinHandle<()>>,
}

struct Watched {
    children: Mutex<Vec<Child>>,
    /// They are dead.
    gone: AtomicBool,
    /// They are not needed any more.
    done: AtomicBool,
    why: Mutex<Option<anyhow::Error>>,
    stop: Stop,
}

impl Peers {
    /// Starts so many processes of this executable that do the same: `verb` with these arguments.
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

    /// Lets all begin once every one is ready; what they [report](Post::report).
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

    /// Whether the first one has left its result.
    pub(crate) fn is_done(&self) -> bool {
        self.posts[0].result().exists()
    }

    /// Fails once the peers are dead, and says why.
    pub(crate) fn check(&self) -> anyhow::Result<()> {
        if self.gone() { Err(self.why()) } else { Ok(()) }
    }

    /// Whether the peers are dead.
    pub(crate) fn gone(&self) -> bool {
        self.watched.gone.load(Ordering::Acquire)
    }

    /// Why the peers are dead. Whoever lost a pipe may be here before the watch has looked.
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
            if let Some(reason) = self.flaw(&mut children, began) {
                *self.why.lock().expect("nobody panics with it") = Some(reason);
                self.gone.store(true, Ordering::Release);
                children.iter().for_each(|child| drop(child.kill()));
                return;
            }
            drop(children);
            std::thread::park_timeout(LOOK_EVERY);
        }
    }

    /// Why the measurement cannot go on, if it cannot.
    fn flaw(&self, children: &mut [Child], began: Instant) -> Option<anyhow::Error> {
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
            // All at once, then each is reaped.
            children.iter().for_each(|child| drop(child.kill()));
            children.clear();
        }
    }
}
