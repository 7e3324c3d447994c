//! Messages of the plant and the robots: ground truth samples, statuses, latencies. Must not decide what
//! follows from them.

use std::time::{Duration, Instant};

use protocol::message::{
    GoalCounts, LatencyHeader, LatencyRow, NeighborStatus, StatusHeader, TruthHeader, TruthRow,
};
use protocol::service::{ServiceError, Subscriber};

use super::error::RunError;
use super::goals::Goals;
use super::services::RunServices;
use outcome::results::latency::Latency;
use outcome::results::outcome::Outcome;

/// Polling interval of latencies, and in real time of reports. Each poll costs some time per robot.
const REPORTS_EVERY: Duration = Duration::from_millis(10);

/// Receivers of all messages, and the values read from them.
pub(super) struct Intake {
    pub(super) truths: Subscriber<[TruthRow], TruthHeader>,
    /// Status receivers of the robots, in scenario order.
    pub(super) statuses: Vec<Subscriber<[NeighborStatus], StatusHeader>>,
    /// Latency receivers: of the plant, then of the robots in scenario order, then of the control process
    /// if there is one.
    latencies: Vec<Subscriber<[LatencyRow], LatencyHeader>>,
    /// Receiver of goal counts, if robots accept goals from outside.
    goal_counts: Option<Subscriber<GoalCounts>>,
    pub(super) goals: Goals,
    /// Number of reports that had been sent at the last read, in lockstep.
    pub(super) reports_taken: Option<u32>,
    /// Newest ground truth sample.
    pub(super) newest: Option<TruthHeader>,
    /// Arrival time of that sample, or the time of a later robot start, which may take long.
    pub(super) last_news: Instant,
    /// Arrival time of the first ground truth sample.
    pub(super) began: Option<Instant>,
    pub(super) latency: Latency,
    last_arrival: Instant,
}

impl Intake {
    /// Creates the receivers, without any message.
    pub(super) fn new(services: &RunServices, latency: Latency) -> Result<Intake, ServiceError> {
        let statuses: Vec<_> = services
            .robots
            .status
            .iter()
            .map(|service| service.subscriber())
            .collect::<Result<_, _>>()?;
        let now = Instant::now();
        Ok(Intake {
            truths: services.truth.subscriber()?,
            latencies: services
                .robots
                .latencies
                .iter()
                .map(|service| service.subscriber())
                .collect::<Result<_, _>>()?,
            goal_counts: services
                .goal_counts
                .as_ref()
                .map(|goals| goals.subscriber())
                .transpose()?,
            goals: Goals::default(),
            statuses,
            reports_taken: None,
            newest: None,
            last_news: now,
            began: None,
            latency,
            last_arrival: now,
        })
    }

    /// Returns the run time of the newest ground truth sample, ns.
    pub(super) fn now_ns(&self) -> u64 {
        self.newest.map_or(0, |header| header.t_ns)
    }

    /// Returns whether reports are to be polled now.
    pub(super) fn is_due(&mut self) -> bool {
        let due = self.last_arrival.elapsed() >= REPORTS_EVERY;
        if due {
            self.last_arrival = Instant::now();
        }
        due
    }

    /// Reads the latencies that all processes measured.
    pub(super) fn read_latencies(&mut self) -> Result<(), RunError> {
        self.latency.set_time(self.now_ns());
        for (process, subscriber) in self.latencies.iter().enumerate() {
            // Latencies of robots and of the control process count from the first sample on.
            let counts = self.began.is_some() || process <= self.statuses.len();
            while let Some(sample) = subscriber.receive()? {
                let (header, rows) = (sample.user_header(), sample.payload());
                match counts {
                    true => self.latency.add_batch(process, header, rows),
                    false => self.latency.skip_batch(process, header, rows),
                }
            }
        }
        Ok(())
    }

    /// Reads the counts of goals from outside.
    pub(super) fn read_goal_counts(&mut self) -> Result<(), RunError> {
        let Some(counts) = &self.goal_counts else { return Ok(()) };
        while let Some(sample) = counts.receive()? {
            self.goals.add(*sample);
        }
        Ok(())
    }

    /// Returns the outcome of the run, completed by the values read.
    pub(super) fn into_outcome(self, outcome: Outcome) -> Outcome {
        Outcome {
            truth: self.newest,
            latency: self.latency,
            goals: self.goal_counts.map(|_| self.goals.summary()),
            ..outcome
        }
    }
}
