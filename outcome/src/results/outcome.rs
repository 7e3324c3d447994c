//! Results of a run in addition to its metrics.

use std::time::Duration;

use protocol::law_message::SentCounts;
use protocol::message::TruthHeader;

use crate::metrics::expect::FailedRobot;
use crate::metrics::summary::{GoalSummary, HostSummary, ProcessUsage};
use crate::results::latency::LatencyCollector;

/// Results of a run in addition to its metrics.
#[derive(Debug, Clone, Default)]
pub struct RunOutcome {
    /// Whether a signal ended the run.
    pub was_interrupted: bool,
    /// Wall time from the start of the first process to t = 0, when all processes were ready; `None` if t = 0 was
    /// not reached.
    pub startup_time: Option<Duration>,
    /// Number of manual interventions through the live view.
    pub manual_interventions: u64,
    /// Wall time from t = 0 to the last ground-truth sample, or to the failure that ended the run.
    pub wall_time: Duration,
    /// Header of the newest ground-truth sample.
    pub newest_truth: Option<TruthHeader>,
    /// Number of commands sent too late, by all agents.
    pub deadline_misses: u64,
    /// Number of samples without an answer because they were too old, of all agents.
    pub unanswered_samples: u64,
    /// Number of beacons that each robot rejected, in scenario order.
    pub refused_beacon_counts: Vec<u64>,
    /// Beacons and messages that each robot sent, in scenario order.
    pub sent_counts: Vec<SentCounts>,
    /// Number of restarts of each robot, in scenario order.
    pub restart_counts: Vec<u64>,
    /// Robots that were lost for good without being planned.
    pub failed_robots: Vec<FailedRobot>,
    /// Metrics that programs computed from the directory of the run, by name.
    pub program_metrics: Vec<(String, Option<f64>)>,
    /// Latencies measured by the processes.
    pub latency: LatencyCollector,
    /// Summary of each host, if there are several.
    pub hosts: Vec<HostSummary>,
    /// Counts of external goals, if robots accept goals from outside.
    pub goals: Option<GoalSummary>,
    /// Resource usage of each process: the supervisor, the plant, the robots in scenario order, and in lockstep the
    /// process that keeps the cores awake, which uses only idle time.
    pub usages: Vec<ProcessUsage>,
}
