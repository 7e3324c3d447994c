//! What the plant and the robots say: truths, statuses, latencies. Must not: decide what follows.

use std::time::{Duration, Instant};

use protocol::message::{
    GoalCounts, LatencyHeader, LatencyRow, NeighborStatus, StatusHeader, TruthHeader, TruthRow,
};
use protocol::service::{ServiceError, Subscriber};

use super::error::RunError;
use super::goals::Goals;
use super::lives::Lives;
use super::reports::Report;
use super::services::RunServices;
use outcome::metrics::summary::ProcessUsage;
use outcome::results::latency::Latency;
use outcome::results::outcome::Outcome;

/// How often latencies are looked at, and in real time reports; each look costs a little for every
/// robot.
const REPORTS_EVERY: Duration = Duration::from_millis(10);

/// What was said, and through which ports.
pub(super) struct Intake {
    pub(super) truths: Subscriber<[TruthRow], TruthHeader>,
    /// Of the robots in scenario order.
    pub(super) statuses: Vec<Subscriber<[NeighborStatus], StatusHeader>>,
    /// Of the plant, then of the robots in scenario order, then of the control timer if there is one.
    latencies: Vec<Subscriber<[LatencyRow], LatencyHeader>>,
    /// What became of goals from outside, where robots take such.
    goal_counts: Option<Subscriber<GoalCounts>>,
    pub(super) goals: Goals,
    /// How many reports had been sent when they were taken last, in lockstep.
    pub(super) reports_taken: Option<u32>,
    /// What the robots say, in scenario order.
    pub(super) reports: Vec<Report>,
    /// The newest truth.
    pub(super) newest: Option<TruthHeader>,
    /// When it was taken; or when a robot was started, which may take long.
    pub(super) last_news: Instant,
    /// When the first truth was taken.
    pub(super) began: Option<Instant>,
    pub(super) latency: Latency,
    taken: Instant,
}

impl Intake {
    /// Nothing was said yet.
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
            reports: vec![Report::new(statuses.len()); statuses.len()],
            statuses,
            reports_taken: None,
            newest: None,
            last_news: now,
            began: None,
            latency,
            taken: now,
        })
    }

    /// Run time of the newest truth, ns.
    pub(super) fn now_ns(&self) -> u64 {
        self.newest.map_or(0, |header| header.t_ns)
    }

    /// Whether it is time to look for reports.
    pub(super) fn is_due(&mut self) -> bool {
        let due = self.taken.elapsed() >= REPORTS_EVERY;
        if due {
            self.taken = Instant::now();
        }
        due
    }

    /// Takes in what everybody measured of delays.
    pub(super) fn take_latencies(&mut self) -> Result<(), RunError> {
        self.latency.set_time(self.now_ns());
        for (process, subscriber) in self.latencies.iter().enumerate() {
            // Robots are late from their first sample on, and the control timer with them.
            let counts = self.began.is_some() || process <= self.reports.len();
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

    /// Takes in what became of goals from outside.
    pub(super) fn take_goal_counts(&mut self) -> Result<(), RunError> {
        let Some(counts) = &self.goal_counts else { return Ok(()) };
        while let Some(sample) = counts.receive()? {
            self.goals.take(*sample);
        }
        Ok(())
    }

    /// What it all came to.
    pub(super) fn into_outcome(
        self,
        launched: Instant,
        lives: &Lives,
        interrupted: bool,
        usages: Vec<ProcessUsage>,
    ) -> Outcome {
        let robots = 0..self.reports.len();
        Outcome {
            interrupted,
            startup: self.began.map(|at| at - launched),
            truth: self.newest,
            deadline_misses: self.reports.iter().map(|report| report.counts().misses).sum(),
            odometry_old: self.reports.iter().map(|report| report.counts().odometry_old).sum(),
            beacons_refused: self.reports.iter().map(|report| report.counts().refused).collect(),
            restarts: robots.map(|robot| lives.incarnation(robot)).collect(),
            latency: self.latency,
            goals: self.goal_counts.map(|_| self.goals.summary()),
            usages,
            ..Outcome::default()
        }
    }
}
