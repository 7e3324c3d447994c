//! Reading of messages from the plant and the robots, in an order in which a cause is always read before
//! its effect, and their distribution.

use std::time::Instant;

use protocol::message::{StatusHeader, TruthHeader, TruthRow};

use super::error::RunError;
use super::{Run, SharedResources};
use run::lifecycle::{LifecycleEvent, ProcessState};
use run::reports::StatusChange;

/// Maximum number of ground truth samples read before reports and deaths are processed. The plant may send
/// them as fast as they are read.
const TRUTHS_PER_ITERATION: usize = 64;

impl Run<'_> {
    /// Reads new ground truth samples, at most [`TRUTHS_PER_ITERATION`]. Returns whether all were read.
    pub(super) fn read_truths(&mut self) -> Result<bool, RunError> {
        for _ in 0..TRUTHS_PER_ITERATION {
            if self.state_machine.journal.metrics.ends_early() {
                return Ok(true);
            }
            let Some(sample) = self.receivers.truth_subscriber.receive()? else { return Ok(true) };
            let header = *sample.user_header();
            // All messages sent before this sample are read before it is recorded.
            if let Some(reports) = self.time_mode.reports_before_truth() {
                if self.receivers.read_report_count.replace(reports) != Some(reports) {
                    self.read_statuses()?;
                }
                self.state_machine.journal.write_events_before(header.t_ns)?;
            }
            self.process_truth(&header, sample.payload())?;
        }
        Ok(false)
    }

    fn process_truth(&mut self, header: &TruthHeader, rows: &[TruthRow]) -> Result<(), RunError> {
        let now = Instant::now();
        if self.receivers.first_truth_arrival.is_none() {
            self.receivers.first_truth_arrival = Some(now);
            // All ports of the plant exist now.
            self.shared_resources.allocator.request_allocation();
        }
        self.receivers.last_truth_arrival = now;
        self.receivers.newest_truth = Some(*header);
        let is_last = header.t_ns >= self.end_ns();
        self.state_machine.record_truth(header, rows)?;
        let is_last = is_last || self.state_machine.journal.metrics.ends_early();
        if let Some(view) = &mut self.interactive_actions.view
            && (view.is_frame_due(now) || view.is_watched() && is_last)
        {
            view.send_frame(self.state_machine.scene_frame(self.scenario, header, rows));
        }
        self.time_mode.record_truth_arrival(header);
        Ok(())
    }

    /// Allocates the reserved memory of new ports and connections.
    pub(super) fn allocate_memory_if_due(&mut self) -> Result<(), RunError> {
        let SharedResources { run_root, allocator, .. } = &mut self.shared_resources;
        Ok(allocator.allocate_if_due(run_root.path(), self.processes.plant.agent_pid())?)
    }

    /// Reads the status messages of the robots.
    pub(super) fn read_statuses(&mut self) -> Result<(), RunError> {
        for robot in 0..self.receivers.status_subscribers.len() {
            while let Some(sample) = self.receivers.status_subscribers[robot].receive()? {
                self.process_status(robot, sample.user_header(), sample.payload())?;
            }
        }
        Ok(())
    }

    /// Records what the process of a robot, which is dead or sends no more, has sent, in lockstep.
    pub(super) fn record_sent_counts(&mut self, robot: usize) {
        if let Some(counts) = self.time_mode.take_sent_counts(robot) {
            self.state_machine.record_sent_counts(robot, counts);
        }
    }

    fn process_status(
        &mut self,
        robot: usize,
        header: &StatusHeader,
        payload: &[u8],
    ) -> Result<(), RunError> {
        // Only a program that is no agent sends an incomplete status.
        let Some((neighbors, message)) = header.split_payload(payload) else { return Ok(()) };
        if header.incarnation != self.state_machine.lifecycles().incarnation(robot) {
            return Ok(()); // sent before its death
        }
        let (was_moving, is_moving) =
            (self.state_machine.report(robot).has_replied(), header.moving == 1);
        let takes_part = self.time_mode.takes_part(header);
        let t_ns = self.receivers.now_ns().max(header.t_ns);
        let was_starting =
            self.state_machine.lifecycles().process_state(robot) == ProcessState::Starting;
        self.handle_event(t_ns, LifecycleEvent::StatusReported { robot, takes_part })?;
        let changes = self.state_machine.record_status(robot, header, &neighbors, message);
        let mut robots = 0..self.scenario.robots.len();
        // All ports of the robots exist once no robot is starting, and all connections between them once
        // each robot has received and sent. From then on a full file system affects no robot.
        let all_started = was_starting
            && robots.clone().all(|robot| {
                self.state_machine.lifecycles().process_state(robot) != ProcessState::Starting
            });
        let all_moving = !was_moving
            && is_moving
            && robots.all(|robot| {
                self.state_machine.lifecycles().process_state(robot) != ProcessState::Moving
                    || self.state_machine.report(robot).has_replied()
            });
        if all_started || all_moving || changes.iter().any(StatusChange::may_open_connection) {
            self.shared_resources.allocator.request_allocation();
        }
        Ok(())
    }
}
