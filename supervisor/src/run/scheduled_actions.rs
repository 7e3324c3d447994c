//! Actions that are due: planned by the scenario, or at the end of a wait.

use std::os::unix::process::ExitStatusExt as _;
use std::process::ExitStatus;
use std::time::{Duration, Instant};

use protocol::message::Wanted;
use protocol::process::exit;

use super::Run;
use super::error::RunError;
use super::processes::{LOG_LINES, Processes};
use crate::child;
use crate::dead_nodes::Dead;
use crate::shm_capacity;
use run::lifecycle::{Death, Event, Order, ProcessState};

impl Run<'_> {
    /// Executes the actions that are due, if the supervisor may act now. In lockstep, lets the plant
    /// continue once all consequences are complete.
    pub(super) fn act(&mut self) -> Result<(), RunError> {
        if !self.time_mode.may_act(self.intake.newest.as_ref()) {
            return Ok(());
        }
        // In lockstep a plan that begins at t = 0 requires that all robots have started.
        let starting_up = self.time_mode.starting_up(self.intake.newest.as_ref());
        let awaited = starting_up && self.course.lifecycles().is_any_starting();
        let (now_ns, begun) = (self.intake.now_ns(), self.intake.newest.is_some() && !awaited);
        while begun && let Some(orders) = self.course.handle_planned(now_ns) {
            self.execute(now_ns, orders)?;
        }
        self.apply_requests(now_ns)?;
        self.handle(now_ns, Event::Due)?;
        if begun && self.course.lifecycles().is_at_rest(now_ns) {
            self.set_next_pause();
            self.time_mode.resume();
        }
        Ok(())
    }

    /// Executes the pending requests of the live view.
    fn apply_requests(&mut self, now_ns: u64) -> Result<(), RunError> {
        while let Some(request) = self.by_hand.next_request() {
            let event = match self.intake.newest {
                Some(_) => self.by_hand.event(now_ns, request.act, self.scenario, &mut self.course),
                None => Err("the run has not begun: not all robots are ready".into()),
            };
            let done = match event {
                Ok(event) => Ok(self.handle(now_ns, event)?),
                Err(refusal) => Err(refusal),
            };
            request.send_result(done);
        }
        Ok(())
    }

    /// Handles an event, and executes the orders that follow from it.
    pub(super) fn handle(&mut self, now_ns: u64, event: Event) -> Result<(), RunError> {
        let orders = self.course.handle(now_ns, event);
        self.execute(now_ns, orders)
    }

    /// Executes orders at this run time, ns.
    fn execute(&mut self, now_ns: u64, orders: Vec<Order>) -> Result<(), RunError> {
        for order in orders {
            match order {
                Order::Start { robot, incarnation } => {
                    self.processes.start(robot, incarnation)?;
                    self.intake.last_news = Instant::now();
                }
                Order::Kill(robot) => {
                    let incarnation = self.course.lifecycles().incarnation(robot);
                    self.processes.incarnations.retire(robot, incarnation);
                    self.set_wanted_state(robot, Wanted::Killed)?;
                }
                Order::Stop(robot) => self.set_wanted_state(robot, Wanted::Stopped)?,
                Order::GoOn(robot) => self.set_wanted_state(robot, Wanted::Running)?,
                Order::Join(robot) => self.time_mode.join(robot),
                Order::Leave(robot) => self.time_mode.remove_robot(robot),
                // The robot's host removes its stale resources.
                Order::CleanUp(robot) if self.processes.remote_host(robot).is_some() => {}
                Order::CleanUp(robot) => self.helpers.cleaner.request(Dead::Robot(robot)),
                Order::TellLinks(robot) => {
                    self.by_hand.tell_links(robot, self.scenario, self.course.lifecycles())?;
                }
                Order::KillPlant => {
                    let killed = self.processes.plant.kill();
                    killed.map_err(|error| RunError::signal_failure("the plant", error))?;
                }
                Order::StartLoad { fault, processes } => {
                    let log = self.course.journal.run_dir.log_path("load");
                    let Processes { load, launcher, .. } = &mut self.processes;
                    let detail = load.start(launcher, fault, processes, &log);
                    self.handle(now_ns, Event::LoadStarted { fault, detail })?;
                }
                Order::EndLoad { fault } => self.processes.load.end(fault),
                Order::WarnOfDeath { robot, how, again } => {
                    self.warn_of_death(now_ns, robot, &how, again);
                }
                Order::EndRun { robot, how } => return Err(self.gave_up(robot, how)),
            }
        }
        Ok(())
    }

    /// Warns of an unplanned death: of a replacement that died `again`, or of another process.
    fn warn_of_death(&self, now_ns: u64, robot: usize, how: &str, again: bool) {
        let (name, t_s) = (self.course.journal.name(robot), now_ns as f64 / 1e9);
        if again {
            let log = self.processes.last_lines(robot);
            tracing::warn!(
                robot = name,
                t_s,
                how,
                "its replacement died as well; the last lines of its log:\n{log}"
            );
        } else if let Some(said) = self.last_words(robot) {
            tracing::warn!(robot = name, t_s, how, "died unexpectedly; its last message:\n{said}");
        } else {
            tracing::warn!(robot = name, t_s, how, "died unexpectedly");
        }
    }

    /// Returns the error of a robot that gave up and will not be replaced.
    fn gave_up(&self, robot: usize, mut how: String) -> RunError {
        let program = self.scenario.program(robot).is_some();
        if program && self.time_mode.starting_up(self.intake.newest.as_ref()) {
            how += ", before it was ready";
        }
        let log = self.processes.last_lines(robot);
        RunError::AgentDied { robot: self.course.journal.name(robot).to_owned(), how, log }
    }

    /// Sets the wanted state of a robot's process. A signal that cannot be sent ends the run: in lockstep
    /// all other processes would wait for its effect, and the measurements would not match the plan.
    fn set_wanted_state(&mut self, robot: usize, wanted: Wanted) -> Result<(), RunError> {
        let wanted = self.processes.set_wanted_state(robot, wanted);
        wanted.map_err(|error| RunError::signal_failure(self.course.journal.name(robot), error))
    }

    /// Returns the last message of a robot's program, beyond its exit status. During the start-up it is
    /// printed if the run ends because of it.
    fn last_words(&self, robot: usize) -> Option<String> {
        let program = self.scenario.program(robot).is_some();
        let told = program && !self.time_mode.starting_up(self.intake.newest.as_ref());
        let log = told.then(|| self.processes.last_entries(robot))?;
        let routine = log.iter().rposition(|entry| entry.level.as_deref() == Some("INFO"));
        let said = &log[routine.map_or(0, |at| at + 1)..];
        said.iter()
            .any(|entry| !entry.message.trim().is_empty())
            .then(|| child::format_log_lines(said))
    }

    /// Reaps all processes that have exited, and processes their deaths.
    pub(super) fn take_deaths(&mut self) -> Result<(), RunError> {
        if self.processes.has_any_died() {
            self.take_plants_death()?;
            self.process_robot_deaths()?;
            self.take_deaths_of_helpers();
        }
        self.detectors.all_seen_alive_ns = self.intake.now_ns();
        Ok(())
    }

    /// Reaps the robots' processes that have exited, and processes their deaths at the newest ground truth.
    pub(super) fn process_robot_deaths(&mut self) -> Result<(), RunError> {
        for robot in 0..self.scenario.robots.len() {
            if let Some(status) = self.processes.reap(robot) {
                self.process_death(robot, status)?;
            }
        }
        Ok(())
    }

    /// Warns of helper processes that died and were not ended on purpose. No robot needs them.
    fn take_deaths_of_helpers(&mut self) {
        if let Some(status) = self.processes.reap_control_timer() {
            tracing::warn!(
                "the control timer died ({}); the latencies of `machine` end there",
                child::describe_exit(status)
            );
        }
        for status in self.processes.load.reap_exited() {
            let how = child::describe_exit(status);
            tracing::warn!("a process that takes processor time died ({how}); the load is smaller");
        }
    }

    fn take_plants_death(&mut self) -> Result<(), RunError> {
        let Some(status) = self.processes.plant.try_reap() else { return Ok(()) };
        // The plant may have sent its last ground truth between the last read and its exit.
        while !self.read_truths()? {}
        if self.is_over() {
            return Ok(());
        }
        let log = self.processes.plant.last_lines(LOG_LINES);
        self.died_of_full_memory("the plant", status, &log)?;
        Err(RunError::PlantDied { how: self.cause_of_death(status, false), log })
    }

    /// Returns how a process ended, as text. For an unplanned SIGKILL, also whether the kernel sent it for
    /// lack of memory.
    fn cause_of_death(&mut self, status: ExitStatus, planned: bool) -> String {
        let how = child::describe_exit(status);
        let is_killed = status.signal() == Some(libc::SIGKILL) && !planned;
        match is_killed.then(|| self.detectors.out_of_memory.cause()).flatten() {
            Some(cause) => format!("{how}: {cause}"),
            None => how,
        }
    }

    /// Returns an error if a process gave up or was killed by SIGBUS while shared memory is full, because a
    /// replacement would fail too.
    fn died_of_full_memory(
        &self,
        who: &str,
        status: ExitStatus,
        log: &str,
    ) -> Result<(), RunError> {
        let may_be = match status.signal() {
            Some(signal) => signal == libc::SIGBUS,
            None => !status.success(),
        };
        let Some(room) =
            may_be.then(|| shm_capacity::find_space_error(self.shared.run_root.path())).flatten()
        else {
            return Ok(());
        };
        let (who, how, log) = (who.into(), child::describe_exit(status), log.into());
        Err(RunError::DiedOfFullMemory { room: room.into(), who, how, log })
    }

    /// Returns an error if a process gave up after the run root was removed: no replacement can start without it.
    fn died_without_run_root(&self, who: &str, status: ExitStatus) -> Result<(), RunError> {
        let run_root = self.shared.run_root.path();
        if status.code().unwrap_or(0) == 0 || run_root.exists() {
            return Ok(());
        }
        let (run_root, who, how) = (run_root.into(), who.into(), child::describe_exit(status));
        Err(RunError::RunRootGone { run_root, who, how })
    }

    /// Returns the run time at which a robot whose death was just found was last known to live, ns.
    fn seen_alive_ns(&self, robot: usize) -> u64 {
        let host = self.processes.remote_host(robot).zip(self.helpers.hosts.as_ref());
        let unknown_for = host.map_or(Duration::ZERO, |(host, hosts)| hosts.report_interval(host));
        self.detectors.all_seen_alive_ns.saturating_sub(unknown_for.as_nanos() as u64)
    }

    /// Processes the death of a robot's process, which has been reaped.
    pub(super) fn process_death(
        &mut self,
        robot: usize,
        status: ExitStatus,
    ) -> Result<(), RunError> {
        // Read before the clean-up removes the last messages of the process.
        self.intake.read_latencies()?;
        let planned = self.course.lifecycles().process_state(robot) == ProcessState::Ending;
        let death = Death {
            robot,
            cause: self.cause_of_death(status, planned),
            success: status.success(),
            gave_up: status.code() == Some(exit::INFRASTRUCTURE.into()),
            starting_up: self.time_mode.starting_up(self.intake.newest.as_ref()),
            alive_ns: self.seen_alive_ns(robot),
            fault: self.course.journal.metrics.next_fault_number(),
        };
        let dead = self.course.lifecycles().incarnation(robot);
        let happened = self.handle(self.intake.now_ns(), Event::Died(death));
        // In lockstep the plant no longer waits for its command.
        self.processes.incarnations.retire(robot, dead);
        let (who, log) = (self.course.journal.name(robot), self.processes.last_lines(robot));
        self.died_of_full_memory(who, status, &log)?;
        self.died_without_run_root(who, status)?;
        happened?;
        self.set_next_pause();
        Ok(())
    }

    /// Sets the run time at which the plant pauses next, because an action is due.
    pub(super) fn set_next_pause(&self) {
        let asked = self.by_hand.has_requests().then_some(0);
        // The plant must not pass the earliest time at which the run may end.
        let end = self.course.journal.metrics.earliest_end_ns();
        let next = [self.course.next_action_ns(), asked, end];
        self.time_mode.pause_at(next.into_iter().flatten().min());
    }
}
