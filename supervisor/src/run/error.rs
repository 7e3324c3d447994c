//! Why a run could not go on.

use std::path::PathBuf;
use std::time::Duration;

use iceoryx2::port::ReceiveError;
use protocol::barrier::BarrierError;
use protocol::resources;
use protocol::run_root::RunRootError;
use protocol::service::{SendError, ServiceError};
use protocol::watchdog::Activity;

use crate::dead_nodes::CleanerError;
use crate::descriptors;
use crate::limits;
use crate::room::RoomError;
use crate::run::kept::{Died, GivenUp};
use crate::spawn::SpawnError;
use crate::tree::SignalError;
use outcome::results::run_dir::RunDirError;

/// In real time, without a truth for this long the plant counts as hung.
pub(super) const TRUTH_SILENCE_MAX: Duration = Duration::from_secs(15);

/// Why a run could not go on. What was written is kept.
#[derive(Debug, thiserror::Error)]
#[expect(missing_docs, reason = "the messages say what the fields are")]
pub enum RunError {
    /// No place for the files that the processes share.
    #[error(transparent)]
    RunRoot(#[from] RunRootError),
    /// A service could not be made.
    #[error(transparent)]
    Service(#[from] ServiceError),
    /// The barrier could not be made.
    #[error(transparent)]
    Barrier(#[from] BarrierError),
    /// The file by which the plant knows dead incarnations could not be made.
    #[error("cannot make the file of incarnations in the run root: {0}")]
    Incarnations(std::io::Error),
    /// The file system of the run root is too small, or full.
    #[error(transparent)]
    Room(#[from] RoomError),
    /// A process died while the file system of the run root was full.
    #[error("{room}\n{who} died of it ({how}); the last lines of its log:\n{log}")]
    DiedOfFullMemory { room: Box<RoomError>, who: String, how: String, log: String },
    /// The run root was removed during the run.
    #[error(
        "{who} died ({how}), and cannot be replaced: the run root {} was removed while the run went on; remove none \
         by hand, `phalanx clean` spares those that are in use",
        run_root.display()
    )]
    RunRootGone { run_root: PathBuf, who: String, how: String },
    /// So many robots need more open files than this process may have.
    #[error(transparent)]
    Descriptors(#[from] descriptors::TooFew),
    /// A limit of this process is too low for the run.
    #[error(transparent)]
    Limit(#[from] limits::TooLow),
    /// A process or a thread could not be started.
    #[error(transparent)]
    Spawn(#[from] SpawnError),
    /// The run directory could not be written.
    #[error(transparent)]
    RunDir(#[from] RunDirError),
    /// Nobody could clean up after the dead.
    #[error(transparent)]
    Cleaner(#[from] CleanerError),
    /// A sample could not be taken.
    #[error("cannot receive from an agent or the plant: {why}")]
    Receive { why: String },
    /// A robot could not be told of a link that was cut or mended by hand.
    #[error("cannot tell a robot of its links: {0}")]
    Tell(#[from] SendError),
    /// A robot did not come up.
    #[error("{robot} was not ready after {} s (ready_after_s); the last lines of its log:\n{log}", limit.as_secs_f64())]
    NotReady { robot: String, limit: Duration, log: String },
    /// A robot's process gave up, or died before t = 0, and its policy allows no (further) restart.
    #[error("{robot} died ({how}) and is not restarted; the last lines of its log:\n{log}")]
    AgentDied { robot: String, how: String, log: String },
    /// The plant's process died.
    #[error("the plant died ({how}); the last lines of its log:\n{log}")]
    PlantDied { how: String, log: String },
    /// In lockstep a robot lives, and does not answer.
    #[error(
        "{robot} has not answered tick {tick} for {} s {instead} (hung_after_s); the last lines of its log:\n{log}",
        limit.as_secs_f64()
    )]
    RobotHung { robot: String, tick: u64, limit: Duration, instead: Activity, log: String },
    /// A process could not be killed, frozen or continued.
    #[error("{who} could not be {done}: {source}")]
    NotSignaled { who: String, done: &'static str, source: SignalError },
    /// In lockstep somebody stopped a process, and did not let it go on.
    #[error("{who} was stopped by somebody else {} s ago, and does not go on (stopped_after_s)", limit.as_secs_f64())]
    Stopped { who: String, limit: Duration },
    /// In lockstep the plant lives, owes nobody a wait, and does not go on.
    #[error(
        "the plant has not gone on for {} s {instead} (hung_after_s); the last lines of its log:\n{log}",
        limit.as_secs_f64()
    )]
    PlantHung { limit: Duration, instead: Activity, log: String },
    /// The bridge does not stay up.
    #[error("the bridge died ({how}) {times} times in a row; the last lines of its log:\n{log}")]
    BridgeDied { how: String, times: u64, log: String },
    /// Other hosts did not turn up.
    #[error(
        "not there after {} s: {hosts}; each needs its own `phalanx run` with the same scenario and fleet file, \
         options included, and must be reached at the addresses of the fleet file{dropped}",
        waited.as_secs_f64()
    )]
    HostsMissing { hosts: String, waited: Duration, dropped: String },
    /// A signal came while hosts waited for each other.
    #[error("interrupted while waiting for {hosts}")]
    Interrupted { hosts: String },
    /// The plant's host is gone: there is no run without it.
    #[error(
        "the plant's host {host} is lost: no sign of it for {} s (silence_max_s); the run is over here",
        silent.as_secs_f64()
    )]
    PlantsHostLost { host: String, silent: Duration },
    /// The plant's host could not go on.
    #[error("the run could not go on; the plant's host {host} says why")]
    PlantsHostFailed { host: String },
    /// In real time the plant lives, and says nothing.
    #[error("the plant sent no truth for {} s", limit.as_secs_f64())]
    PlantSilent { limit: Duration },
}

impl From<ReceiveError> for RunError {
    /// Returns the error with its cause, if the supervisor lacks a resource.
    fn from(error: ReceiveError) -> RunError {
        let why = match resources::missing() {
            Some(missing) => limits::why(&missing),
            None => error.to_string(),
        };
        RunError::Receive { why }
    }
}

impl RunError {
    /// The process that failed, as its log is called, and how; `None` if no process is to blame.
    pub fn failed_process(&self) -> Option<(&str, String)> {
        let process = match self {
            RunError::NotReady { robot, .. }
            | RunError::AgentDied { robot, .. }
            | RunError::RobotHung { robot, .. } => robot,
            RunError::Stopped { who, .. }
            | RunError::NotSignaled { who, .. }
            | RunError::DiedOfFullMemory { who, .. }
            | RunError::RunRootGone { who, .. } => who.strip_prefix("the ").unwrap_or(who),
            RunError::PlantDied { .. }
            | RunError::PlantHung { .. }
            | RunError::PlantSilent { .. } => "plant",
            RunError::BridgeDied { .. } => "bridge",
            _ => return None,
        };
        let text = self.to_string();
        let cause = text.lines().find(|line| line.contains(process)).unwrap_or(&text);
        let cause = cause.split("; the last lines of its log").next().unwrap_or(cause);
        Some((process, cause.to_owned()))
    }

    /// Returns the error for a process that a signal did not reach.
    pub(crate) fn not_signaled(who: &str, source: SignalError) -> RunError {
        RunError::NotSignaled { who: who.into(), done: source.not_done(), source }
    }

    /// How the bridge died; an error if it is not started anew.
    pub(crate) fn unless_it_comes_back(bridge: Died) -> Result<String, RunError> {
        let Died { how, given_up } = bridge;
        match given_up {
            None => Ok(how),
            Some(GivenUp { times, log }) => Err(RunError::BridgeDied { how, times, log }),
        }
    }
}
