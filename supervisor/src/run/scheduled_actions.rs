//! Actions that are due: planned by the scenario, or at the end of a wait.

use std::os::unix::process::ExitStatusExt as _;
use std::process::ExitStatus;
use std::time::{Duration, Instant};

use protocol::message::WantedState;
use protocol::process::exit;

use super::Run;
use super::error::RunError;
use super::processes::{Processes, SHOWN_LOG_LINES};
use crate::child;
use crate::dead_nodes::DeadProcessOwner;
use crate::shm_capacity;
use run::lifecycle::{DriverOrder, LifecycleEvent, ProcessDeath, ProcessState};

impl Run<'_> {
    /// Executes the actions that are due, if the supervisor may act now. In lockstep, lets the plant
    /// continue once all consequences are complete.
    pub(super) fn execute_due_actions(&mut self) -> Result<(), RunError> {
        if !self.time_mode.may_act(self.receivers.newest_truth.as_ref()) {
            return Ok(());
        }
        // In lockstep a plan that begins at t = 0 requires that all robots have started.
        let is_starting_up = self.time_mode.is_starting_up(self.receivers.newest_truth.as_ref());
        let is_start_pending =
            is_starting_up && self.state_machine.lifecycles().is_any_process_starting();
        let (now_ns, has_begun) =
            (self.receivers.now_ns(), self.receivers.newest_truth.is_some() && !is_start_pending);
        while has_begun && let Some(orders) = self.state_machine.handle_planned_event(now_ns) {
            self.execute_orders(now_ns, orders)?;
        }
        self.apply_requests(now_ns)?;
        self.handle_event(now_ns, LifecycleEvent::TimePassed)?;
        if has_begun && self.state_machine.lifecycles().is_idle(now_ns) {
            self.set_next_pause();
            self.time_mode.resume();
        }
        Ok(())
    }

    /// Executes the pending requests of the live view.
    fn apply_requests(&mut self, now_ns: u64) -> Result<(), RunError> {
        while let Some(request) = self.interactive_actions.next_request() {
            let event = match self.receivers.newest_truth {
                Some(_) => self.interactive_actions.register_action(
                    now_ns,
                    request.action,
                    self.scenario,
                    &mut self.state_machine,
                ),
                None => Err("the run has not begun: not all robots are ready".into()),
            };
            let result = match event {
                Ok(event) => Ok(self.handle_event(now_ns, event)?),
                Err(refusal) => Err(refusal),
            };
            request.send_result(result);
        }
        Ok(())
    }

    /// Handles an event, and executes the orders that follow from it.
    pub(super) fn handle_event(
        &mut self,
        now_ns: u64,
        event: LifecycleEvent,
    ) -> Result<(), RunError> {
        let orders = self.state_machine.handle_event(now_ns, event);
        self.execute_orders(now_ns, orders)
    }

    /// Executes orders at this run time, ns.
    fn execute_orders(&mut self, now_ns: u64, orders: Vec<DriverOrder>) -> Result<(), RunError> {
        for order in orders {
            match order {
                DriverOrder::Start { robot, incarnation } => {
                    self.processes.start_robot(robot, incarnation)?;
                    self.receivers.last_truth_arrival = Instant::now();
                }
                DriverOrder::Kill(robot) => {
                    let incarnation = self.state_machine.lifecycles().incarnation(robot);
                    self.processes.incarnations.retire(robot, incarnation);
                    self.set_wanted_state(robot, WantedState::Killed)?;
                }
                DriverOrder::Stop(robot) => self.set_wanted_state(robot, WantedState::Stopped)?,
                DriverOrder::Resume(robot) => self.set_wanted_state(robot, WantedState::Running)?,
                DriverOrder::JoinBarrier(robot) => self.time_mode.add_robot(robot),
                DriverOrder::LeaveBarrier(robot) => self.time_mode.remove_robot(robot),
                // The robot's host removes its stale resources.
                DriverOrder::CleanUp(robot) if self.processes.remote_host(robot).is_some() => {}
                DriverOrder::CleanUp(robot) => {
                    self.helpers.cleaner.request_cleanup(DeadProcessOwner::Robot(robot))
                }
                DriverOrder::SendCutLinks(robot) => {
                    self.interactive_actions.send_cut_links(
                        robot,
                        self.scenario,
                        self.state_machine.lifecycles(),
                    )?;
                }
                DriverOrder::KillPlant => {
                    let result = self.processes.plant.kill();
                    result.map_err(|error| RunError::signal_failure("the plant", error))?;
                }
                DriverOrder::StartLoad { fault, processes } => {
                    let log = self.state_machine.journal.run_dir.log_path("load");
                    let Processes { load, launcher, .. } = &mut self.processes;
                    let detail = load.start(launcher, fault, processes, &log);
                    self.handle_event(now_ns, LifecycleEvent::LoadStarted { fault, detail })?;
                }
                DriverOrder::EndLoad { fault } => self.processes.load.kill_fault_processes(fault),
                DriverOrder::WarnOfDeath { robot, cause, is_replacement } => {
                    self.warn_of_death(now_ns, robot, &cause, is_replacement);
                }
                DriverOrder::EndRun { robot, cause } => {
                    return Err(self.gave_up_error(robot, cause));
                }
            }
        }
        Ok(())
    }

    /// Warns of an unplanned death. `is_replacement` is whether the process was a replacement, and died before
    /// the end of the fault that killed its predecessor.
    fn warn_of_death(&self, now_ns: u64, robot: usize, cause: &str, is_replacement: bool) {
        let (name, t_s) = (self.state_machine.journal.robot_name(robot), now_ns as f64 / 1e9);
        if is_replacement {
            let log = self.processes.last_lines(robot);
            tracing::warn!(
                robot = name,
                t_s,
                how = cause,
                "its replacement died as well; the last lines of its log:\n{log}"
            );
        } else if let Some(log_lines) = self.last_log_message(robot) {
            tracing::warn!(
                robot = name,
                t_s,
                how = cause,
                "died unexpectedly; its last message:\n{log_lines}"
            );
        } else {
            tracing::warn!(robot = name, t_s, how = cause, "died unexpectedly");
        }
    }

    /// Returns the error of a robot that gave up and will not be replaced.
    fn gave_up_error(&self, robot: usize, mut cause: String) -> RunError {
        let has_program = self.scenario.program(robot).is_some();
        if has_program && self.time_mode.is_starting_up(self.receivers.newest_truth.as_ref()) {
            cause += ", before it was ready";
        }
        let log = self.processes.last_lines(robot);
        RunError::AgentDied {
            robot: self.state_machine.journal.robot_name(robot).to_owned(),
            cause,
            log,
        }
    }

    /// Sets the wanted state of a robot's process. A signal that cannot be sent ends the run: in lockstep
    /// all other processes would wait for its effect, and the measurements would not match the plan.
    fn set_wanted_state(&mut self, robot: usize, state: WantedState) -> Result<(), RunError> {
        let result = self.processes.set_wanted_state(robot, state);
        result.map_err(|error| {
            RunError::signal_failure(self.state_machine.journal.robot_name(robot), error)
        })
    }

    /// Returns the last message of a robot's program, beyond its exit status. During the start-up it is
    /// printed if the run ends because of it.
    fn last_log_message(&self, robot: usize) -> Option<String> {
        let has_program = self.scenario.program(robot).is_some();
        let has_unprinted_message =
            has_program && !self.time_mode.is_starting_up(self.receivers.newest_truth.as_ref());
        let entries = has_unprinted_message.then(|| self.processes.last_entries(robot))?;
        let last_info_index =
            entries.iter().rposition(|entry| entry.level.as_deref() == Some("INFO"));
        let last_entries = &entries[last_info_index.map_or(0, |index| index + 1)..];
        last_entries
            .iter()
            .any(|entry| !entry.message.trim().is_empty())
            .then(|| child::format_log_lines(last_entries))
    }

    /// Reaps all processes that have exited, and processes their deaths.
    pub(super) fn process_deaths(&mut self) -> Result<(), RunError> {
        if self.processes.has_any_died() {
            self.check_plant_alive()?;
            self.process_robot_deaths()?;
            self.warn_of_helper_deaths();
        }
        self.detectors.all_seen_alive_ns = self.receivers.now_ns();
        Ok(())
    }

    /// Reaps the robots' processes that have exited, and processes their deaths at the newest ground truth.
    pub(super) fn process_robot_deaths(&mut self) -> Result<(), RunError> {
        for robot in 0..self.scenario.robots.len() {
            if let Some(status) = self.processes.reap_robot(robot) {
                self.process_death(robot, status)?;
            }
        }
        Ok(())
    }

    /// Warns of helper processes that died and were not ended on purpose. No robot needs them.
    fn warn_of_helper_deaths(&mut self) {
        if let Some(status) = self.processes.reap_control_timer() {
            tracing::warn!(
                "the control timer died ({}); the latencies of `machine` end there",
                child::describe_exit(status)
            );
        }
        for status in self.processes.load.reap_exited() {
            let cause = child::describe_exit(status);
            tracing::warn!(
                "a process that takes processor time died ({cause}); the load is smaller"
            );
        }
    }

    fn check_plant_alive(&mut self) -> Result<(), RunError> {
        let Some(status) = self.processes.plant.try_reap() else { return Ok(()) };
        // The plant may have sent its last ground truth between the last read and its exit.
        while !self.read_truths()? {}
        if self.is_over() {
            return Ok(());
        }
        let log = self.processes.plant.last_lines(SHOWN_LOG_LINES);
        self.check_full_memory("the plant", status, &log)?;
        Err(RunError::PlantDied { cause: self.cause_of_death(status, false), log })
    }

    /// Returns how a process ended, as text. For an unplanned SIGKILL, also whether the kernel sent it for
    /// lack of memory.
    fn cause_of_death(&mut self, status: ExitStatus, is_planned: bool) -> String {
        let exit_text = child::describe_exit(status);
        let is_unplanned_kill = status.signal() == Some(libc::SIGKILL) && !is_planned;
        match is_unplanned_kill
            .then(|| self.detectors.out_of_memory_counter.find_kill_cause())
            .flatten()
        {
            Some(cause) => format!("{exit_text}: {cause}"),
            None => exit_text,
        }
    }

    /// Returns an error if a process gave up or was killed by SIGBUS while shared memory is full, because a
    /// replacement would fail too.
    fn check_full_memory(
        &self,
        process: &str,
        status: ExitStatus,
        log: &str,
    ) -> Result<(), RunError> {
        let may_be_full = match status.signal() {
            Some(signal) => signal == libc::SIGBUS,
            None => !status.success(),
        };
        let Some(space_error) = may_be_full
            .then(|| shm_capacity::find_space_error(self.shared_resources.run_root.path()))
            .flatten()
        else {
            return Ok(());
        };
        let (process, exit_text, log) = (process.into(), child::describe_exit(status), log.into());
        Err(RunError::DiedOfFullMemory {
            space_error: space_error.into(),
            process,
            cause: exit_text,
            log,
        })
    }

    /// Returns an error if a process gave up after the run root was removed: no replacement can start without it.
    fn check_run_root_exists(&self, process: &str, status: ExitStatus) -> Result<(), RunError> {
        let run_root = self.shared_resources.run_root.path();
        if status.code().unwrap_or(0) == 0 || run_root.exists() {
            return Ok(());
        }
        let (run_root, process, cause) =
            (run_root.into(), process.into(), child::describe_exit(status));
        Err(RunError::RunRootGone { run_root, process, cause })
    }

    /// Returns the run time at which a robot whose death was just found was last known to be alive, ns.
    fn last_seen_alive_ns(&self, robot: usize) -> u64 {
        let host = self.processes.remote_host(robot).zip(self.helpers.hosts.as_ref());
        let uncertainty = host.map_or(Duration::ZERO, |(host, hosts)| hosts.report_interval(host));
        self.detectors.all_seen_alive_ns.saturating_sub(uncertainty.as_nanos() as u64)
    }

    /// Processes the death of a robot's process, which has been reaped.
    pub(super) fn process_death(
        &mut self,
        robot: usize,
        status: ExitStatus,
    ) -> Result<(), RunError> {
        // Read before the clean-up removes the last messages of the process.
        self.receivers.read_latencies()?;
        let is_planned =
            self.state_machine.lifecycles().process_state(robot) == ProcessState::Exiting;
        let death = ProcessDeath {
            robot,
            cause: self.cause_of_death(status, is_planned),
            exited_successfully: status.success(),
            is_infrastructure_failure: status.code() == Some(exit::INFRASTRUCTURE_FAILURE.into()),
            is_before_motion: self.time_mode.is_starting_up(self.receivers.newest_truth.as_ref()),
            last_seen_alive_ns: self.last_seen_alive_ns(robot),
            fault: self.state_machine.journal.metrics.next_fault_number(),
        };
        self.record_sent_counts(robot);
        let incarnation = self.state_machine.lifecycles().incarnation(robot);
        let event_result =
            self.handle_event(self.receivers.now_ns(), LifecycleEvent::ProcessDied(death));
        // In lockstep the plant no longer waits for its command.
        self.processes.incarnations.retire(robot, incarnation);
        let (process, log) =
            (self.state_machine.journal.robot_name(robot), self.processes.last_lines(robot));
        self.check_full_memory(process, status, &log)?;
        self.check_run_root_exists(process, status)?;
        event_result?;
        self.set_next_pause();
        Ok(())
    }

    /// Sets the run time at which the plant pauses next, because an action is due.
    pub(super) fn set_next_pause(&self) {
        let request_ns = self.interactive_actions.has_requests().then_some(0);
        // The plant must not pass the earliest time at which the run may end.
        let end_ns = self.state_machine.journal.metrics.earliest_end_ns();
        let times_ns = [self.state_machine.next_action_ns(), request_ns, end_ns];
        self.time_mode.pause_at(times_ns.into_iter().flatten().min());
    }
}
