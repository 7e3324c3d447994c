//! Child processes that take part in a measurement: started, watched, and ended.
//!
//! A thread watches them. Once one ends early, a signal comes, or time is up, it kills all of
//! them: whoever waits for them is then woken by the end of a pipe, or sees `gone`.

use std::ffi::OsString;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use protocol::process::Stop;
use serde::Serialize;
use serde::de::DeserializeOwned;
use supervisor::child::Child;
use supervisor::spawn::{Launcher, Role};

use crate::{BenchError, failed};

/// No measurement with peers takes this long, even on a machine that is busy with other things.
const LIMIT: Duration = Duration::from_secs(240);
/// A peer that lives this long is ended by the kernel, whatever it waits for.
const LIFE_S_MAX: u32 = 300;
/// How often the watch looks around.
const LOOK_EVERY: Duration = Duration::from_millis(50);
/// How often readiness is looked at, and results are.
const READY_EVERY: Duration = Duration::from_millis(1);
/// Made once everybody is ready: begin.
const GO: &str = "go";
/// Everybody is there, and begins, within this; and whoever is done is ended within it.
const BEGIN_MAX: Duration = Duration::from_secs(20);
/// How many lines of a dead peer's log are shown.
const LOG_LINES: usize = 8;

/// Children of one measurement; dropped, they are dead and reaped.
pub(crate) struct Peers {
    dir: PathBuf,
    count: usize,
    children: Arc<Mutex<Vec<Child>>>,
    gone: Arc<AtomicBool>,
    done: Arc<AtomicBool>,
    why: Arc<Mutex<Option<BenchError>>>,
    watch: Option<JoinHandle<()>>,
}

impl Peers {
    /// Starts this executable with each list of words. Peer i says that it is ready by making
    /// the file [`ready`]`(dir, i)`.
    pub(crate) fn start(
        dir: &Path,
        stop: &Stop,
        peers: impl IntoIterator<Item = Vec<OsString>>,
    ) -> Result<Peers, BenchError> {
        let (mut children, launcher) = (Vec::new(), Launcher::of_this_executable());
        for words in peers {
            let log = dir.join(format!("peer-{}.log", children.len()));
            children.push(launcher.spawn(Role::Bench { words: &words }, &log)?);
        }
        let count = children.len();
        let children = Arc::new(Mutex::new(children));
        let gone = Arc::new(AtomicBool::new(false));
        let done = Arc::new(AtomicBool::new(false));
        let why = Arc::new(Mutex::new(None));
        let watch = {
            let (children, gone, done) = (children.clone(), gone.clone(), done.clone());
            let (why, stop) = (why.clone(), stop.clone());
            std::thread::spawn(move || watch(&children, &gone, &done, &why, &stop))
        };
        Ok(Peers { dir: dir.into(), count, children, gone, done, why, watch: Some(watch) })
    }

    /// Waits until every peer is ready.
    pub(crate) fn wait_ready(&self) -> Result<(), BenchError> {
        for i in 0..self.count {
            let sign = ready(&self.dir, i);
            while !sign.exists() {
                self.check()?;
                std::thread::sleep(READY_EVERY);
            }
        }
        Ok(())
    }

    /// Once every peer is ready, lets all begin that [`await_go`].
    pub(crate) fn go(&self) -> Result<(), BenchError> {
        self.wait_ready()?;
        let go = self.dir.join(GO);
        std::fs::write(&go, "").map_err(failed("make", &go))
    }

    /// What a peer will [`tell`].
    pub(crate) fn told<T: DeserializeOwned>(&self, result: &Path) -> Result<T, BenchError> {
        while !result.exists() {
            self.check()?;
            std::thread::sleep(READY_EVERY);
        }
        let bytes = std::fs::read(result).map_err(failed("read", result))?;
        serde_json::from_slice(&bytes)
            .map_err(|error| BenchError::Wrong(format!("{}: {error}", result.display())))
    }

    /// The process number of peer i.
    pub(crate) fn pid(&self, peer: usize) -> u32 {
        self.children.lock().expect("nobody panics with it")[peer].pid()
    }

    /// Stops peer i by a signal.
    pub(crate) fn stop(&self, peer: usize) {
        self.children.lock().expect("nobody panics with it")[peer].stop();
    }

    /// Lets it go on.
    pub(crate) fn go_on(&self, peer: usize) {
        self.children.lock().expect("nobody panics with it")[peer].go_on();
    }

    /// Fails once the peers are dead, and says why.
    pub(crate) fn check(&self) -> Result<(), BenchError> {
        if self.gone.load(Ordering::Acquire) { Err(self.why()) } else { Ok(()) }
    }

    /// Whether the peers are dead.
    pub(crate) fn gone(&self) -> bool {
        self.gone.load(Ordering::Relaxed)
    }

    /// Why the peers are dead. Whoever lost a pipe may be here before the watch has looked.
    pub(crate) fn why(&self) -> BenchError {
        let began = Instant::now();
        while !self.gone.load(Ordering::Acquire) && began.elapsed() < 10 * LOOK_EVERY {
            std::thread::sleep(READY_EVERY);
        }
        let why = self.why.lock().expect("the watch does not panic").take();
        why.unwrap_or_else(|| BenchError::Wrong("a peer closed its end, and lives".into()))
    }
}

impl Drop for Peers {
    fn drop(&mut self) {
        self.done.store(true, Ordering::Release);
        if let Some(watch) = self.watch.take() {
            watch.thread().unpark();
            let _ = watch.join();
        }
        if let Ok(mut children) = self.children.lock() {
            // All at once, then each is reaped.
            children.iter().for_each(Child::kill);
            children.clear();
        }
    }
}

fn watch(
    children: &Mutex<Vec<Child>>,
    gone: &AtomicBool,
    done: &AtomicBool,
    why: &Mutex<Option<BenchError>>,
    stop: &Stop,
) {
    let began = Instant::now();
    while !done.load(Ordering::Acquire) {
        let mut children = children.lock().expect("nobody panics with it");
        let early = children.iter_mut().find_map(|child| {
            let status = child.ended()?;
            let what = format!("a peer ended early ({})", supervisor::child::in_words(status));
            Some(BenchError::Peer { what, log: child.last_lines(LOG_LINES) })
        });
        let reason = if stop.requested() {
            Some(BenchError::Interrupted)
        } else if began.elapsed() > LIMIT {
            Some(BenchError::Wrong(format!("not measured within {} s", LIMIT.as_secs())))
        } else {
            early
        };
        if let Some(reason) = reason {
            *why.lock().expect("nobody panics with it") = Some(reason);
            gone.store(true, Ordering::Release);
            children.iter().for_each(Child::kill);
            return;
        }
        drop(children);
        std::thread::park_timeout(LOOK_EVERY);
    }
}

fn ready(dir: &Path, peer: usize) -> PathBuf {
    dir.join(format!("ready-{peer}"))
}

/// A peer says that it is ready.
pub(crate) fn say_ready(dir: &Path, peer: usize) -> Result<(), BenchError> {
    let sign = ready(dir, peer);
    std::fs::write(&sign, "").map_err(failed("make", &sign))
}

/// A peer says that it is ready, and waits until all others are.
pub(crate) fn await_go(dir: &Path, peer: usize) -> Result<(), BenchError> {
    say_ready(dir, peer)?;
    let began = Instant::now();
    while !dir.join(GO).exists() {
        if began.elapsed() > BEGIN_MAX {
            return Err(BenchError::Wrong("the others were not ready in time".into()));
        }
        std::thread::sleep(READY_EVERY);
    }
    Ok(())
}

/// A peer leaves its result and waits to be ended: an end of its own would count as too early.
pub(crate) fn tell<T: Serialize>(result: &Path, seen: &T) -> Result<(), BenchError> {
    let unnamed = result.with_extension("new");
    let text = serde_json::to_string(seen).expect("string keys and finite numbers only");
    std::fs::write(&unnamed, text).map_err(failed("write", &unnamed))?;
    std::fs::rename(&unnamed, result).map_err(failed("name", result))?;
    std::thread::sleep(BEGIN_MAX);
    Ok(())
}

/// A peer's waits need no deadline of their own after this: the kernel ends it.
pub(crate) fn limit_life() {
    // SAFETY: a plain system call.
    unsafe { libc::alarm(LIFE_S_MAX) };
}
