//! Child processes that take part in a measurement (peers).
//!
//! The peers of a measurement exchange files in one directory. Each is started with a [`PeerAddress`], the directory
//! and the index of the peer.
//!
//! A thread monitors the peers. If one exits early, a signal arrives or the maximum duration passes, it kills all of
//! them. A caller that waits for them is then woken by the end of a pipe, or sees [`Peers::have_failed`].

use std::ffi::OsString;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use anyhow::{Context as _, anyhow, bail};
use protocol::brief::Brief;
use protocol::process::StopFlag;
use serde::Serialize;
use serde::de::DeserializeOwned;
use supervisor::child::{Child, describe_exit};
use supervisor::spawn::{Launcher, ProcessRole};

use crate::run::exit_error;
use crate::{Interrupted, MEASUREMENT_DURATION_MAX, write_file};

/// Maximum lifetime of a peer, s. The kernel ends it then, whatever it waits for.
const LIFETIME_S_MAX: u32 = 300;
/// Polling interval of the monitor thread.
const MONITOR_INTERVAL: Duration = Duration::from_millis(50);
/// Polling interval for ready and result files.
const READY_POLL_INTERVAL: Duration = Duration::from_millis(1);
/// Maximum time of a peer to wait until all others are ready, and for its end after it has reported.
const PEER_WAIT_TIMEOUT: Duration = Duration::from_secs(20);

/// First argument of a peer process.
pub(crate) const PEER_SUBCOMMAND: &str = "peer";

/// Directory and index of a peer, from which the paths of its files follow.
#[derive(Debug, Clone, clap::Args)]
pub(crate) struct PeerAddress {
    /// Directory for the files of all peers.
    pub(crate) dir: PathBuf,
    /// Index of the peer, from 0.
    pub(crate) index: usize,
}

impl PeerAddress {
    /// Returns the path of the brief of a peer that acts as a robot.
    pub(crate) fn brief_path(&self) -> PathBuf {
        self.dir.join(format!("brief-{}.toml", self.index))
    }

    fn ready_path(&self) -> PathBuf {
        self.dir.join(format!("ready-{}", self.index))
    }

    fn result_path(&self) -> PathBuf {
        self.dir.join(format!("result-{}.json", self.index))
    }

    /// Returns the path of the start file, which the bench creates once all peers are ready.
    fn start_path(&self) -> PathBuf {
        self.dir.join("go")
    }

    /// Reports that this peer is ready.
    pub(crate) fn report_ready(&self) -> anyhow::Result<()> {
        write_file(&self.ready_path(), "")
    }

    /// Reports that this peer is ready and waits for the start file, at most [`PEER_WAIT_TIMEOUT`].
    ///
    /// # Errors
    /// If the other peers are not ready in time.
    pub(crate) fn wait_for_start(&self) -> anyhow::Result<()> {
        self.report_ready()?;
        let start = Instant::now();
        while !self.start_path().exists() {
            if start.elapsed() > PEER_WAIT_TIMEOUT {
                bail!("the other peers were not ready within {} s", PEER_WAIT_TIMEOUT.as_secs());
            }
            std::thread::sleep(READY_POLL_INTERVAL);
        }
        Ok(())
    }

    /// Writes the result of this peer, then waits to be killed: an exit of its own would count as too early.
    pub(crate) fn report_result<T: Serialize>(&self, value: &T) -> anyhow::Result<()> {
        let (result, temporary) = (self.result_path(), self.result_path().with_extension("new"));
        write_file(&temporary, &serde_json::to_string(value)?)?;
        std::fs::rename(&temporary, &result)
            .with_context(|| format!("cannot write {}", result.display()))?;
        std::thread::sleep(PEER_WAIT_TIMEOUT);
        Ok(())
    }
}

/// Limits the lifetime of this peer to [`LIFETIME_S_MAX`]: the kernel then ends it, so its waits need no deadline.
pub(crate) fn limit_lifetime() {
    // SAFETY: a system call without pointers.
    unsafe { libc::alarm(LIFETIME_S_MAX) };
}

/// Writes the briefs of peers that act as robots.
pub(crate) fn write_briefs<B: Brief>(
    dir: &Path,
    briefs: impl Iterator<Item = B>,
) -> anyhow::Result<()> {
    for (index, brief) in briefs.enumerate() {
        write_file(&PeerAddress { dir: dir.into(), index }.brief_path(), &brief.to_toml())?;
    }
    Ok(())
}

/// Child processes of one measurement. Dropping it kills and reaps them.
pub(crate) struct Peers {
    addresses: Vec<PeerAddress>,
    state: Arc<MonitorState>,
    monitor: Option<JoinHandle<()>>,
}

/// State that the monitor thread and [`Peers`] share.
struct MonitorState {
    children: Mutex<Vec<Child>>,
    /// `true` once the monitor has found a failure and begins to kill the peers.
    has_failed: AtomicBool,
    /// `true` once the peers are no longer needed; the monitor thread then ends.
    is_done: AtomicBool,
    failure: Mutex<Option<anyhow::Error>>,
    stop: StopFlag,
}

impl Peers {
    /// Starts `count` peer processes of this executable with the same `verb` and arguments, and the monitor thread.
    pub(crate) fn start(
        dir: &Path,
        stop: &StopFlag,
        count: usize,
        verb: &str,
        arguments: &[OsString],
    ) -> anyhow::Result<Peers> {
        let addresses = (0..count).map(|index| PeerAddress { dir: dir.into(), index });
        let addresses: Vec<PeerAddress> = addresses.collect();
        let (mut children, launcher) = (Vec::new(), Launcher::for_this_executable());
        for PeerAddress { dir, index } in &addresses {
            let mut command_line: Vec<OsString> =
                vec![PEER_SUBCOMMAND.into(), dir.into(), index.to_string().into()];
            command_line.push(verb.into());
            command_line.extend_from_slice(arguments);
            let log = dir.join(format!("peer-{index}.log"));
            children.push(launcher.spawn(ProcessRole::Bench { arguments: &command_line }, &log)?);
        }
        let state = Arc::new(MonitorState {
            children: Mutex::new(children),
            has_failed: AtomicBool::new(false),
            is_done: AtomicBool::new(false),
            failure: Mutex::new(None),
            stop: stop.clone(),
        });
        let monitor = std::thread::spawn({
            let state = state.clone();
            move || state.monitor()
        });
        Ok(Peers { addresses, state, monitor: Some(monitor) })
    }

    /// Waits until all peers are ready.
    ///
    /// # Errors
    /// If the peers have failed.
    pub(crate) fn wait_ready(&self) -> anyhow::Result<()> {
        self.addresses.iter().try_for_each(|address| self.wait_for_file(&address.ready_path()))
    }

    /// Starts the measurement once all peers are ready, and returns their [results](PeerAddress::report_result) in the
    /// order of their indexes.
    ///
    /// # Errors
    /// If the peers fail or a result cannot be read.
    pub(crate) fn wait_for_results<T: DeserializeOwned>(&self) -> anyhow::Result<Vec<T>> {
        self.wait_ready()?;
        if let Some(address) = self.addresses.first() {
            write_file(&address.start_path(), "")?;
        }
        let result = |address: &PeerAddress| {
            let path = address.result_path();
            self.wait_for_file(&path)?;
            let error_context = || format!("cannot read {}", path.display());
            serde_json::from_slice(&std::fs::read(&path).with_context(error_context)?)
                .with_context(error_context)
        };
        self.addresses.iter().map(result).collect()
    }

    fn wait_for_file(&self, file: &Path) -> anyhow::Result<()> {
        while !file.exists() {
            self.check_running()?;
            std::thread::sleep(READY_POLL_INTERVAL);
        }
        Ok(())
    }

    /// Returns whether the first peer has written its result.
    pub(crate) fn has_result(&self) -> bool {
        self.addresses[0].result_path().exists()
    }

    /// Returns the failure of the peers as an error if they have failed.
    pub(crate) fn check_running(&self) -> anyhow::Result<()> {
        if self.have_failed() { Err(self.wait_for_failure()) } else { Ok(()) }
    }

    /// Returns whether the monitor has found a failure; it then kills the peers.
    pub(crate) fn have_failed(&self) -> bool {
        self.state.has_failed.load(Ordering::Acquire)
    }

    /// Returns the reason of the failure. Waits for the monitor for at most ten polling intervals, because a caller
    /// that reads the end of a pipe may be faster than the monitor.
    pub(crate) fn wait_for_failure(&self) -> anyhow::Error {
        let start = Instant::now();
        while !self.have_failed() && start.elapsed() < 10 * MONITOR_INTERVAL {
            std::thread::sleep(READY_POLL_INTERVAL);
        }
        let failure = self.state.failure.lock().expect("the monitor does not panic").take();
        failure
            .unwrap_or_else(|| anyhow!("a peer closed its end of the connection without exiting"))
    }
}

impl MonitorState {
    /// Polls the peers until they are done or a failure occurs. After a failure it kills them.
    fn monitor(&self) {
        let start = Instant::now();
        while !self.is_done.load(Ordering::Acquire) {
            let mut children =
                self.children.lock().expect("no thread panics while it holds this lock");
            if let Some(failure) = self.find_failure(&mut children, start) {
                *self.failure.lock().expect("no thread panics while it holds this lock") =
                    Some(failure);
                self.has_failed.store(true, Ordering::Release);
                children.iter().for_each(|child| drop(child.kill()));
                return;
            }
            drop(children);
            std::thread::park_timeout(MONITOR_INTERVAL);
        }
    }

    /// Returns the reason why the measurement cannot continue: an interruption, the maximum duration or a peer that has
    /// exited. `None` if it can continue.
    fn find_failure(&self, children: &mut [Child], start: Instant) -> Option<anyhow::Error> {
        if self.stop.is_requested() {
            return Some(Interrupted.into());
        }
        if start.elapsed() > MEASUREMENT_DURATION_MAX {
            return Some(anyhow!(
                "the measurement took more than {} s",
                MEASUREMENT_DURATION_MAX.as_secs()
            ));
        }
        children.iter_mut().find_map(|child| {
            let message = format!("a peer exited early ({})", describe_exit(child.try_reap()?));
            Some(exit_error(&message, child))
        })
    }
}

impl Drop for Peers {
    fn drop(&mut self) {
        self.state.is_done.store(true, Ordering::Release);
        if let Some(monitor) = self.monitor.take() {
            monitor.thread().unpark();
            let _ = monitor.join();
        }
        if let Ok(mut children) = self.state.children.lock() {
            // Kills all of them before reaping, so that they end at the same time.
            children.iter().for_each(|child| drop(child.kill()));
            children.clear();
        }
    }
}
