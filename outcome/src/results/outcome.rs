//! What a run leaves besides its metrics.

use std::time::Duration;

use protocol::message::TruthHeader;

use crate::metrics::expect::FailedRobot;
use crate::metrics::summary::{GoalSummary, HostSummary, ProcessUsage};
use crate::results::latency::Latency;

/// What a run leaves besides its metrics.
#[derive(Debug, Clone, Default)]
pub struct Outcome {
    /// Ended by a signal.
    pub interrupted: bool,
    /// Wall time from the start of the first process to t = 0, when all were ready; `None` if it
    /// never came to that.
    pub startup: Option<Duration>,
    /// How often somebody acted on it through the live view.
    pub acts_by_hand: u64,
    /// Wall time from t = 0 to the last truth, or to what ended the run before its end.
    pub wall: Duration,
    /// The newest truth.
    pub truth: Option<TruthHeader>,
    /// Commands sent too late, by all agents.
    pub deadline_misses: u64,
    /// Samples too old for an answer, which got none, of all agents.
    pub odometry_old: u64,
    /// Beacons that each robot refused, in scenario order.
    pub beacons_refused: Vec<u64>,
    /// Restarts by robot, in scenario order.
    pub restarts: Vec<u64>,
    /// Robots that were lost for good by nobody's plan.
    pub failed_robots: Vec<FailedRobot>,
    /// What the processes measured of delays.
    pub latency: Latency,
    /// Where there are several: what is to be said of each host.
    pub hosts: Vec<HostSummary>,
    /// Where robots take goals from outside: what became of those.
    pub goals: Option<GoalSummary>,
    /// What each process took from the machine: the supervisor, the plant, the robots in scenario
    /// order, and in lockstep what kept the cores awake, which is time that nobody else wanted.
    pub usages: Vec<ProcessUsage>,
}
