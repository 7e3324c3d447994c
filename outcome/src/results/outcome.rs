//! Results of a run in addition to its metrics.

use std::time::Duration;

use protocol::law_message::SentCounts;
use protocol::message::TruthHeader;

use crate::metrics::expect::FailedRobot;
use crate::metrics::summary::{GoalSummary, HostSummary, ProcessUsage};
use crate::results::latency::Latency;

/// Results of a run in addition to its metrics.
#[derive(Debug, Clone, Default)]
pub struct Outcome {
    /// Whether a signal ended the run.
    pub interrupted: bool,
    /// Wall time from the start of the first process to t = 0, when all processes were ready; `None` if t = 0 was
    /// not reached.
    pub startup: Option<Duration>,
    /// Number of manual interventions through the live view.
    pub acts_by_hand: u64,
    /// Wall time from t = 0 to the last ground-truth sample, or to the failure that ended the run.
    pub wall: Duration,
    /// Header of the newest ground-truth sample.
    pub truth: Option<TruthHeader>,
    /// Number of commands sent too late, by all agents.
    pub deadline_misses: u64,
    /// Number of samples without an answer because they were too old, of all agents.
    pub odometry_old: u64,
    /// Number of beacons that each robot rejected, in scenario order.
    pub beacons_refused: Vec<u64>,
    /// Beacons and messages that each robot sent, in scenario order.
    pub sent: Vec<SentCounts>,
    /// Number of restarts of each robot, in scenario order.
    pub restarts: Vec<u64>,
    /// Robots that were lost for good without being planned.
    pub failed_robots: Vec<FailedRobot>,
    /// Latencies measured by the processes.
    pub latency: Latency,
    /// Summary of each host, if there are several.
    pub hosts: Vec<HostSummary>,
    /// Counts of external goals, if robots accept goals from outside.
    pub goals: Option<GoalSummary>,
    /// Resource usage of each process: the supervisor, the plant, the robots in scenario order, and in lockstep the
    /// process that keeps the cores awake, which uses only idle time.
    pub usages: Vec<ProcessUsage>,
}
