//! Messages of the plant and the robots: ground truth samples, statuses, latencies. Must not decide what
//! follows from them.

use std::time::{Duration, Instant};

use protocol::message::{
    GoalCounts, LatencyHeader, LatencyRow, StatusHeader, TruthHeader, TruthRow,
};
use protocol::service::{ServiceError, Subscriber};

use super::error::RunError;
use super::goals::GoalCounter;
use super::services::RunServices;
use outcome::results::latency::LatencyCollector;
use outcome::results::outcome::RunOutcome;

/// Polling interval of latencies, and in real time of reports. Each poll costs some time per robot.
const REPORT_POLL_INTERVAL: Duration = Duration::from_millis(10);

/// Receivers of all messages, and the values read from them.
pub(super) struct MessageReceivers {
    pub(super) truth_subscriber: Subscriber<[TruthRow], TruthHeader>,
    /// Status receivers of the robots, in scenario order.
    pub(super) status_subscribers: Vec<Subscriber<[u8], StatusHeader>>,
    /// Latency receivers: of the plant, then of the robots in scenario order, then of the control process
    /// if there is one.
    latency_subscribers: Vec<Subscriber<[LatencyRow], LatencyHeader>>,
    /// Receiver of goal counts, if robots accept goals from outside.
    goal_counts: Option<Subscriber<GoalCounts>>,
    pub(super) goal_counter: GoalCounter,
    /// Number of reports that had been sent at the last read, in lockstep.
    pub(super) read_report_count: Option<u32>,
    /// Newest ground truth sample.
    pub(super) newest_truth: Option<TruthHeader>,
    /// Arrival time of that sample, or the time of a later robot start, which may take long.
    pub(super) last_truth_arrival: Instant,
    /// Arrival time of the first ground truth sample.
    pub(super) first_truth_arrival: Option<Instant>,
    pub(super) latency_collector: LatencyCollector,
    last_report_poll: Instant,
}

impl MessageReceivers {
    /// Creates the receivers, without any message.
    pub(super) fn new(
        services: &RunServices,
        latency: LatencyCollector,
    ) -> Result<MessageReceivers, ServiceError> {
        let statuses: Vec<_> = services
            .robots
            .status
            .iter()
            .map(|service| service.subscriber())
            .collect::<Result<_, _>>()?;
        let now = Instant::now();
        Ok(MessageReceivers {
            truth_subscriber: services.truth.subscriber()?,
            latency_subscribers: services
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
            goal_counter: GoalCounter::default(),
            status_subscribers: statuses,
            read_report_count: None,
            newest_truth: None,
            last_truth_arrival: now,
            first_truth_arrival: None,
            latency_collector: latency,
            last_report_poll: now,
        })
    }

    /// Returns the run time of the newest ground truth sample, ns.
    pub(super) fn now_ns(&self) -> u64 {
        self.newest_truth.map_or(0, |header| header.t_ns)
    }

    /// Returns whether reports are to be polled now.
    pub(super) fn is_report_poll_due(&mut self) -> bool {
        let is_due = self.last_report_poll.elapsed() >= REPORT_POLL_INTERVAL;
        if is_due {
            self.last_report_poll = Instant::now();
        }
        is_due
    }

    /// Reads the latencies that all processes measured.
    pub(super) fn read_latencies(&mut self) -> Result<(), RunError> {
        self.latency_collector.set_time(self.now_ns());
        for (process, subscriber) in self.latency_subscribers.iter().enumerate() {
            // Latencies of robots and of the control process count from the first sample on.
            let is_counted =
                self.first_truth_arrival.is_some() || process <= self.status_subscribers.len();
            while let Some(sample) = subscriber.receive()? {
                let (header, rows) = (sample.user_header(), sample.payload());
                match is_counted {
                    true => self.latency_collector.add_batch(process, header, rows),
                    false => self.latency_collector.skip_batch(process, header, rows),
                }
            }
        }
        Ok(())
    }

    /// Reads the counts of goals from outside.
    pub(super) fn read_goal_counts(&mut self) -> Result<(), RunError> {
        let Some(counts) = &self.goal_counts else { return Ok(()) };
        while let Some(sample) = counts.receive()? {
            self.goal_counter.add_counts(*sample);
        }
        Ok(())
    }

    /// Returns the outcome of the run, completed by the values read.
    pub(super) fn into_outcome(self, outcome: RunOutcome) -> RunOutcome {
        RunOutcome {
            newest_truth: self.newest_truth,
            latency: self.latency_collector,
            goals: self.goal_counts.map(|_| self.goal_counter.summary()),
            ..outcome
        }
    }
}
