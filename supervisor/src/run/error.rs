//! Errors that end a run.

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
use crate::run::helper_process::{HelperDeath, RepeatedStartFailure};
use crate::shm_capacity::SpaceError;
use crate::spawn::SpawnError;
use crate::tree::SignalError;
use outcome::results::run_dir::RunDirError;

/// Time without a ground truth sample after which the plant counts as hung in real time.
pub(super) const TRUTH_SILENCE_MAX: Duration = Duration::from_secs(15);

/// Error that ends a run. Results written before it are kept.
#[derive(Debug, thiserror::Error)]
#[expect(missing_docs, reason = "the messages say what the fields are")]
pub enum RunError {
    /// The directory of shared files cannot be created.
    #[error(transparent)]
    RunRoot(#[from] RunRootError),
    /// A service cannot be created.
    #[error(transparent)]
    Service(#[from] ServiceError),
    /// The barrier cannot be created.
    #[error(transparent)]
    Barrier(#[from] BarrierError),
    /// The file that contains the dead incarnations, for the plant, cannot be created.
    #[error("cannot make the file of incarnations in the run root: {0}")]
    Incarnations(std::io::Error),
    /// The file system of the run root is too small or full.
    #[error(transparent)]
    Space(#[from] SpaceError),
    /// A process died while the file system of the run root was full.
    #[error(
        "{space_error}\n{process} died for this reason ({cause}); the last lines of its log:\n{log}"
    )]
    DiedOfFullMemory { space_error: Box<SpaceError>, process: String, cause: String, log: String },
    /// The run root was removed during the run.
    #[error(
        "{process} died ({cause}), and cannot be replaced: the run root {} was removed during the run; do not remove run \
         roots manually, because `phalanx clean` keeps those that are in use",
        run_root.display()
    )]
    RunRootGone { run_root: PathBuf, process: String, cause: String },
    /// This number of robots needs more open files than the process may have.
    #[error(transparent)]
    Descriptors(#[from] descriptors::TooFewDescriptors),
    /// A limit of this process is too low for the run.
    #[error(transparent)]
    Limit(#[from] limits::LimitTooLow),
    /// A process or a thread cannot be started.
    #[error(transparent)]
    Spawn(#[from] SpawnError),
    /// The run directory cannot be written.
    #[error(transparent)]
    RunDir(#[from] RunDirError),
    /// The cleaner of stale resources cannot be started.
    #[error(transparent)]
    Cleaner(#[from] CleanerError),
    /// A message cannot be received.
    #[error("cannot receive from an agent or the plant: {reason}")]
    Receive { reason: String },
    /// The message about an interactive link fault cannot be sent to a robot.
    #[error("cannot send a robot the state of its links: {0}")]
    SendLinkFaults(#[from] SendError),
    /// A robot did not become ready.
    #[error("{robot} was not ready after {} s (ready_after_s); the last lines of its log:\n{log}", limit.as_secs_f64())]
    NotReady { robot: String, limit: Duration, log: String },
    /// A robot's process gave up or died before t = 0, and its restart policy allows no further restart.
    #[error("{robot} died ({cause}) and is not restarted; the last lines of its log:\n{log}")]
    AgentDied { robot: String, cause: String, log: String },
    /// The plant's process died.
    #[error("the plant died ({cause}); the last lines of its log:\n{log}")]
    PlantDied { cause: String, log: String },
    /// A robot is alive but does not reply, in lockstep.
    #[error(
        "{robot} has not answered tick {tick} for {} s {activity} (hung_after_s); the last lines of its log:\n{log}",
        limit.as_secs_f64()
    )]
    RobotHung { robot: String, tick: u64, limit: Duration, activity: Activity, log: String },
    /// A process could not be killed, frozen or resumed.
    #[error("{process} could not be {action}: {source}")]
    NotSignaled { process: String, action: &'static str, source: SignalError },
    /// Another process stopped a process of the run and did not resume it, in lockstep.
    #[error("{process} was stopped by another process {} s ago, and has not been resumed (stopped_after_s)", limit.as_secs_f64())]
    ProcessStopped { process: String, limit: Duration },
    /// The plant is alive and waits for no process, but does not advance, in lockstep.
    #[error(
        "the plant has not advanced for {} s {activity} (hung_after_s); the last lines of its log:\n{log}",
        limit.as_secs_f64()
    )]
    PlantHung { limit: Duration, activity: Activity, log: String },
    /// The bridge keeps failing.
    #[error(
        "the bridge died ({cause}) {failed_starts} times in a row; the last lines of its log:\n{log}"
    )]
    BridgeDied { cause: String, failed_starts: u64, log: String },
    /// Other hosts did not join.
    #[error(
        "hosts missing after {} s: {hosts}; each needs its own `phalanx run` with the same scenario and fleet file, \
         options included, and must be reached at the addresses of the fleet file{dropped}",
        waited.as_secs_f64()
    )]
    HostsMissing { hosts: String, waited: Duration, dropped: String },
    /// A signal arrived while the hosts waited for each other.
    #[error("interrupted while waiting for {hosts}")]
    Interrupted { hosts: String },
    /// The plant's host is lost, without which there is no run.
    #[error(
        "the plant's host {host} is lost: no message from it for {} s (silence_max_s); the run ends on this host",
        silent.as_secs_f64()
    )]
    PlantsHostLost { host: String, silent: Duration },
    /// The plant's host failed.
    #[error("the run failed on the plant's host {host}, which has printed the reason")]
    PlantsHostFailed { host: String },
    /// The plant is alive but sends nothing, in real time.
    #[error("the plant has sent no ground truth for {} s", limit.as_secs_f64())]
    PlantSilent { limit: Duration },
}

impl From<ReceiveError> for RunError {
    /// Returns the error with its cause, if the supervisor lacks a resource.
    fn from(error: ReceiveError) -> RunError {
        let reason = match resources::find_missing_resource() {
            Some(missing_resource) => limits::explain_refusal(&missing_resource),
            None => error.to_string(),
        };
        RunError::Receive { reason }
    }
}

impl RunError {
    /// Returns the failed process, by the name of its log, and how it failed; `None` if the error concerns
    /// no process.
    pub fn failed_process(&self) -> Option<(&str, String)> {
        let process = match self {
            RunError::NotReady { robot, .. }
            | RunError::AgentDied { robot, .. }
            | RunError::RobotHung { robot, .. } => robot,
            RunError::ProcessStopped { process, .. }
            | RunError::NotSignaled { process, .. }
            | RunError::DiedOfFullMemory { process, .. }
            | RunError::RunRootGone { process, .. } => {
                process.strip_prefix("the ").unwrap_or(process)
            }
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
    pub(crate) fn signal_failure(process: &str, source: SignalError) -> RunError {
        RunError::NotSignaled { process: process.into(), action: source.action_text(), source }
    }

    /// Returns how the bridge died, or an error if it will not be restarted.
    pub(crate) fn check_given_up(bridge: HelperDeath) -> Result<String, RunError> {
        let HelperDeath { cause, repeated_failure } = bridge;
        match repeated_failure {
            None => Ok(cause),
            Some(RepeatedStartFailure { failed_starts, log }) => {
                Err(RunError::BridgeDied { cause, failed_starts, log })
            }
        }
    }
}
