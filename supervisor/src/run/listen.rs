//! Reading of messages from the plant and the robots, in an order in which a cause is always read before
//! its effect, and their distribution.

use std::time::Instant;

use protocol::message::{NeighborStatus, StatusHeader, TruthHeader, TruthRow};

use super::Run;
use super::error::RunError;
use crate::shm_capacity;
use outcome::results::scene;
use run::lifecycle::{Event, ProcessState};
use run::reports::StatusChange;

/// Maximum number of ground truth samples read before reports and deaths are processed. The plant may send
/// them as fast as they are read.
const TRUTHS_PER_TURN: usize = 64;

impl Run<'_> {
    /// Reads new ground truth samples, at most [`TRUTHS_PER_TURN`]. Returns whether all were read.
    pub(super) fn read_truths(&mut self) -> Result<bool, RunError> {
        for _ in 0..TRUTHS_PER_TURN {
            if self.journal.metrics.ends_early() {
                return Ok(true);
            }
            let Some(sample) = self.intake.truths.receive()? else { return Ok(true) };
            let header = *sample.user_header();
            // All messages sent before this sample are read before it is recorded.
            if let Some(reports) = self.time_mode.reports_before_truth() {
                if self.intake.reports_taken.replace(reports) != Some(reports) {
                    self.read_statuses()?;
                }
                self.journal.known_before(header.t_ns)?;
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
        let (journal, alive) = (&mut self.journal, self.lifecycles.alive());
        journal.metrics.add_truth(header, rows, alive);
        let measured = journal.metrics.current();
        journal.run_dir.write_truth(header, rows, alive, measured)?;
        if let Some(view) = &mut self.view
            && (view.wants_frame(now)
                || view.is_watched() && (is_last || journal.metrics.ends_early()))
        {
            let (lifecycles, reports) = (&self.lifecycles, &self.intake.reports);
            let heard = |from: usize, to: usize| reports[to].contact(from);
            let orphaned = journal.metrics.orphaned();
            let state = |robot: usize| lifecycles.process_state(robot).state(orphaned[robot]);
            let cut = |edge| lifecycles.is_cut(edge);
            let errors_m = measured.errors_m;
            view.frame(scene::frame(self.scenario, header, rows, errors_m, state, heard, cut));
        }
        self.time_mode.took(header);
        Ok(())
    }

    /// Allocates the reserved memory of ports and connections.
    fn allocate_memory(&self) -> Result<(), RunError> {
        Ok(shm_capacity::allocate(self.run_root.path(), self.processes.plant.agent_pid())?)
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
        if header.incarnation != self.lifecycles.incarnation(robot) {
            return Ok(()); // sent before its death
        }
        let (moved, moves) = (self.intake.reports[robot].moves(), header.moving == 1);
        let news = self.intake.reports[robot].update(header, neighbors);
        self.journal.metrics.set_own_target(robot, header.t_ns, header.target());
        let takes_part = self.time_mode.takes_part(header);
        let t_ns = self.intake.now_ns().max(header.t_ns);
        let was_starting = self.lifecycles.process_state(robot) == ProcessState::Starting;
        self.happens(t_ns, Event::Reported { robot, takes_part })?;
        let mut robots = 0..self.scenario.robots.len();
        // All ports of the robots exist once no robot is starting, and all connections between them once
        // each robot has received and sent. From then on a full file system affects no robot.
        let all_there = was_starting
            && robots
                .clone()
                .all(|robot| self.lifecycles.process_state(robot) != ProcessState::Starting);
        let all_move = !moved
            && moves
            && robots.all(|robot| {
                self.lifecycles.process_state(robot) != ProcessState::Moving
                    || self.intake.reports[robot].moves()
            });
        if all_there || all_move {
            self.allocate_memory()?;
        }
        for news in news {
            match news {
                StatusChange::Heard { other, contact, since_ns } => {
                    self.journal.heard(since_ns, robot, other, contact);
                }
                StatusChange::FrameHeard { contact, since_ns } => {
                    // The same holds for the beacon of a backup leader that a returning leader has opened.
                    self.allocate_memory()?;
                    self.journal.frame_heard(since_ns, robot, contact);
                }
                StatusChange::GoesBy { other, yes, since_ns } => {
                    // The connection to an activated backup neighbor has memory of its own.
                    self.allocate_memory()?;
                    self.journal.goes_by(since_ns, robot, other, yes);
                }
                StatusChange::GoesTo { outside_m, since_ns } => {
                    let own_m = self.scenario.robots[robot].goal_m;
                    if let Some(goal_m) = outside_m.or(own_m) {
                        let whose = if outside_m.is_some() { "ros2" } else { "the scenario" };
                        self.journal.goes_to(since_ns, robot, goal_m, whose);
                    }
                }
            }
        }
        Ok(())
    }
}
