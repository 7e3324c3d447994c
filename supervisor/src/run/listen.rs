//! Reading of messages from the plant and the robots, in an order in which a cause is always read before
//! its effect, and their distribution.

use std::time::Instant;

use protocol::message::{NeighborStatus, StatusHeader, TruthHeader, TruthRow};

use super::Run;
use super::error::RunError;
use crate::shm_capacity;
use run::lifecycle::{Event, ProcessState};
use run::reports::StatusChange;

/// Maximum number of ground truth samples read before reports and deaths are processed. The plant may send
/// them as fast as they are read.
const TRUTHS_PER_TURN: usize = 64;

impl Run<'_> {
    /// Reads new ground truth samples, at most [`TRUTHS_PER_TURN`]. Returns whether all were read.
    pub(super) fn read_truths(&mut self) -> Result<bool, RunError> {
        for _ in 0..TRUTHS_PER_TURN {
            if self.course.journal.metrics.ends_early() {
                return Ok(true);
            }
            let Some(sample) = self.intake.truths.receive()? else { return Ok(true) };
            let header = *sample.user_header();
            // All messages sent before this sample are read before it is recorded.
            if let Some(reports) = self.time_mode.reports_before_truth() {
                if self.intake.reports_taken.replace(reports) != Some(reports) {
                    self.read_statuses()?;
                }
                self.course.journal.known_before(header.t_ns)?;
            }
            self.take_truth(&header, sample.payload())?;
        }
        Ok(false)
    }

    fn take_truth(&mut self, header: &TruthHeader, rows: &[TruthRow]) -> Result<(), RunError> {
        let now = Instant::now();
        if self.intake.began.is_none() {
            self.intake.began = Some(now);
            // All ports of the plant exist now.
            self.allocate_memory()?;
        }
        self.intake.last_news = now;
        self.intake.newest = Some(*header);
        let is_last = header.t_ns >= self.end_ns();
        self.course.record_truth(header, rows)?;
        let is_last = is_last || self.course.journal.metrics.ends_early();
        if let Some(view) = &mut self.by_hand.view
            && (view.wants_frame(now) || view.is_watched() && is_last)
        {
            view.frame(self.course.frame(self.scenario, header, rows));
        }
        self.time_mode.record_truth_arrival(header);
        Ok(())
    }

    /// Allocates the reserved memory of ports and connections.
    fn allocate_memory(&self) -> Result<(), RunError> {
        Ok(shm_capacity::allocate(self.shared.run_root.path(), self.processes.plant.agent_pid())?)
    }

    /// Reads the status messages of the robots.
    pub(super) fn read_statuses(&mut self) -> Result<(), RunError> {
        for robot in 0..self.intake.statuses.len() {
            while let Some(sample) = self.intake.statuses[robot].receive()? {
                self.take_status(robot, sample.user_header(), sample.payload())?;
            }
        }
        Ok(())
    }

    fn take_status(
        &mut self,
        robot: usize,
        header: &StatusHeader,
        neighbors: &[NeighborStatus],
    ) -> Result<(), RunError> {
        if header.incarnation != self.course.lifecycles().incarnation(robot) {
            return Ok(()); // sent before its death
        }
        let (moved, moves) = (self.course.report(robot).has_replied(), header.moving == 1);
        let takes_part = self.time_mode.takes_part(header);
        let t_ns = self.intake.now_ns().max(header.t_ns);
        let was_starting = self.course.lifecycles().process_state(robot) == ProcessState::Starting;
        self.handle(t_ns, Event::Reported { robot, takes_part })?;
        let changes = self.course.record_status(robot, header, neighbors);
        let mut robots = 0..self.scenario.robots.len();
        // All ports of the robots exist once no robot is starting, and all connections between them once
        // each robot has received and sent. From then on a full file system affects no robot.
        let all_there = was_starting
            && robots.clone().all(|robot| {
                self.course.lifecycles().process_state(robot) != ProcessState::Starting
            });
        let all_move = !moved
            && moves
            && robots.all(|robot| {
                self.course.lifecycles().process_state(robot) != ProcessState::Moving
                    || self.course.report(robot).has_replied()
            });
        if all_there || all_move || changes.iter().any(StatusChange::may_open_connection) {
            self.allocate_memory()?;
        }
        Ok(())
    }
}
