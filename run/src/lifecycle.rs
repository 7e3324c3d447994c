//! State machine of each robot's process, and the only place where an event leads to effects.
//!
//! Pure: takes an event, and returns the effects in the order in which they must be executed. Kill, freeze,
//! death and restart are combined here. Must not start or signal a process, read a clock, write a file, or
//! know the time mode.

mod event;
#[cfg(test)]
mod tests;

use std::collections::BTreeMap;

use experiment::scenario::{DeathReaction, RestartPolicy};
use outcome::metrics::fault::FaultEnd;
use outcome::report::scene::RobotState;

pub use event::{DriverOrder, Effect, Initiator, LifecycleEvent, ProcessDeath, RunRecord};

/// State of a robot's process.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum ProcessState {
    /// The process was started, and its first status is pending.
    Starting,
    /// The process takes part in the run.
    Moving,
    /// SIGSTOP has stopped the process.
    Frozen,
    /// The process was killed on purpose, and its exit is pending.
    Exiting,
    /// The process is dead and reaped.
    Dead,
}

impl ProcessState {
    /// Returns the state for display. `orphaned` is whether the robot is disconnected from every alive leader.
    pub fn display_state(self, orphaned: bool) -> RobotState {
        match self {
            ProcessState::Moving if orphaned => RobotState::Orphaned,
            ProcessState::Moving => RobotState::Moving,
            ProcessState::Frozen => RobotState::Frozen,
            ProcessState::Starting => RobotState::Starting,
            ProcessState::Exiting | ProcessState::Dead => RobotState::Dead,
        }
    }
}

/// Lifecycle of one robot.
#[derive(Debug)]
struct Lifecycle {
    process_state: ProcessState,
    incarnation: u64,
    /// Whether the plant waits for the robot at each tick.
    is_barrier_member: bool,
    /// Number of dead and reaped processes of the robot that are not yet cleaned up.
    pending_cleanups: usize,
    /// Run time at which a replacement is due, ns.
    restart_at_ns: Option<u64>,
    policy: RestartPolicy,
    /// Run times of unplanned restarts, ns.
    unplanned_restarts_ns: Vec<u64>,
    /// Number of the fault that caused the present death of the robot's process or the start of a replacement.
    current_fault: Option<usize>,
    /// Number of the fault that froze the robot's process.
    freezing_fault: Option<usize>,
    /// Number of the fault that made the robot's host unreachable, and the reason.
    unreachability_cause: Option<(usize, String)>,
    /// Cause of an unplanned death after which no replacement is started.
    permanent_failure_cause: Option<String>,
    /// Cause of death of the robot's process, until an unplanned replacement takes part.
    replaced_death_cause: Option<String>,
}

/// Link that may be cut interactively.
#[derive(Debug)]
struct CuttableLink {
    receiver: usize,
    /// Number of the fault that cut the link; `None` while the link is not cut.
    cutting_fault: Option<usize>,
}

/// Lifecycles of all robots.
#[derive(Debug)]
pub struct Lifecycles {
    robots: Vec<Lifecycle>,
    is_alive: Vec<bool>,
    links: Vec<CuttableLink>,
    /// Faults that have begun, and the kind of end of each; `None` while a fault lasts.
    fault_ends: BTreeMap<usize, Option<FaultEnd>>,
    restarts_before_cleanup: bool,
}

impl Lifecycles {
    /// Creates the state in which all first processes are being started. `link_receivers` is the receiver of each
    /// edge. `restart_before_cleanup` is whether a replacement may start before the stale resources of its
    /// predecessor are removed.
    pub fn new(
        policies: impl Iterator<Item = RestartPolicy>,
        link_receivers: impl Iterator<Item = usize>,
        restart_before_cleanup: bool,
    ) -> Lifecycles {
        let robots: Vec<Lifecycle> = policies
            .map(|policy| Lifecycle {
                process_state: ProcessState::Starting,
                incarnation: 0,
                is_barrier_member: false,
                pending_cleanups: 0,
                restart_at_ns: None,
                policy,
                unplanned_restarts_ns: Vec::new(),
                current_fault: None,
                freezing_fault: None,
                unreachability_cause: None,
                permanent_failure_cause: None,
                replaced_death_cause: None,
            })
            .collect();
        Lifecycles {
            is_alive: vec![true; robots.len()],
            robots,
            links: link_receivers
                .map(|receiver| CuttableLink { receiver, cutting_fault: None })
                .collect(),
            fault_ends: BTreeMap::new(),
            restarts_before_cleanup: restart_before_cleanup,
        }
    }

    /// Returns the state of a robot's process.
    pub fn process_state(&self, robot: usize) -> ProcessState {
        self.robots[robot].process_state
    }

    /// Returns whether the first status of a process is pending.
    pub fn is_any_process_starting(&self) -> bool {
        self.robots.iter().any(|lifecycle| lifecycle.process_state == ProcessState::Starting)
    }

    /// Returns the incarnation number of a robot's process: the number of earlier starts.
    pub fn incarnation(&self, robot: usize) -> u64 {
        self.robots[robot].incarnation
    }

    /// Returns for each robot whether it counts as alive: it did not die, or its replacement takes part.
    pub fn alive_robots(&self) -> &[bool] {
        &self.is_alive
    }

    /// Returns whether an edge is cut interactively.
    pub fn is_link_cut(&self, edge: usize) -> bool {
        self.links[edge].cutting_fault.is_some()
    }

    /// Returns the fault that froze a robot.
    pub fn freezing_fault(&self, robot: usize) -> Option<usize> {
        self.robots[robot].freezing_fault
    }

    /// Returns whether a replacement is due now or later.
    pub fn will_be_replaced(&self, robot: usize) -> bool {
        self.robots[robot].restart_at_ns.is_some()
    }

    /// Returns the robots that were lost without a plan, and the cause: dead for good, or dead with a
    /// replacement that does not take part yet.
    pub fn failed_robots(&self) -> impl Iterator<Item = (usize, String)> {
        let robots = self.robots.iter().enumerate();
        robots.filter_map(|(robot, lifecycle)| {
            Some((
                robot,
                lifecycle
                    .permanent_failure_cause
                    .clone()
                    .or(lifecycle.pending_replacement_text())?,
            ))
        })
    }

    /// Returns the robots whose host is unreachable, and the reason; without those known to be dead.
    pub fn unreachable_robots(&self) -> impl Iterator<Item = (usize, &str)> {
        let robots = self.robots.iter().enumerate();
        let is_running = |lifecycle: &Lifecycle| {
            !matches!(lifecycle.process_state, ProcessState::Exiting | ProcessState::Dead)
        };
        let robots = robots.filter(move |(_, lifecycle)| is_running(lifecycle));
        robots.filter_map(|(robot, lifecycle)| {
            Some((robot, lifecycle.unreachability_cause.as_ref()?.1.as_str()))
        })
    }

    /// Returns whether the host of a robot is unreachable.
    pub fn is_unreachable(&self, robot: usize) -> bool {
        self.robots[robot].unreachability_cause.is_some()
    }

    /// Returns the run time of the next replacement, ns.
    pub fn next_restart_ns(&self) -> Option<u64> {
        self.robots.iter().filter_map(|lifecycle| lifecycle.restart_at_ns).min()
    }

    /// Returns whether nothing is in progress at this run time, ns: no process is starting or exiting, and no
    /// replacement is due. A due replacement waits for the clean-up of its predecessor; other robots wait for no
    /// clean-up, which takes seconds in a run of 1,024 robots.
    pub fn is_idle(&self, now_ns: u64) -> bool {
        self.robots.iter().all(|lifecycle| match lifecycle.process_state {
            ProcessState::Moving | ProcessState::Frozen => true,
            ProcessState::Dead => lifecycle.restart_at_ns.is_none_or(|at| at > now_ns),
            ProcessState::Starting | ProcessState::Exiting => false,
        })
    }

    /// Handles an event at this run time, ns, and returns its effects in order.
    pub fn handle_event(&mut self, now_ns: u64, event: LifecycleEvent) -> Vec<Effect> {
        let mut effects = Effects { effects: Vec::new(), now_ns };
        let out = &mut effects;
        match event {
            LifecycleEvent::Kill { robot, fault, restart_at_ns, initiator } => {
                self.kill(out, robot, fault, restart_at_ns, initiator);
            }
            LifecycleEvent::Freeze { robot, fault, has_planned_thaw, initiator } => {
                self.freeze(out, robot, fault, has_planned_thaw, initiator);
            }
            LifecycleEvent::Thaw { robot, fault, initiator } => {
                self.thaw(out, robot, fault, initiator)
            }
            LifecycleEvent::KillPlant { fault } => {
                let detail = format!("SIGKILL of the plant, {}", Initiator::Plan.keyword());
                out.push_note("kill", None, detail);
                self.begin_fault(out, fault);
                out.push_order(DriverOrder::KillPlant);
            }
            LifecycleEvent::PlantStopped { fault, initiator } => {
                let detail = format!("SIGSTOP of the plant, {}", initiator.keyword());
                out.push_note("freeze", None, detail);
                self.begin_fault(out, fault);
                // Unless it is resumed.
                self.end_fault(out, fault, FaultEnd::Permanent, now_ns);
            }
            LifecycleEvent::PlantResumed { fault, initiator } => {
                let detail = format!("SIGCONT of the plant, {}", initiator.keyword());
                out.push_note("thaw", None, detail);
                self.end_fault(out, fault, FaultEnd::Repaired, now_ns);
            }
            LifecycleEvent::StartLoad { fault, processes } => {
                out.push_order(DriverOrder::StartLoad { fault, processes });
            }
            LifecycleEvent::LoadStarted { fault, detail } => {
                out.push_note("load", None, detail);
                self.begin_fault(out, fault);
            }
            LifecycleEvent::EndLoad { fault } => {
                out.push_order(DriverOrder::EndLoad { fault });
                out.push_note("load-ended", None, String::new());
                self.end_fault(out, fault, FaultEnd::Repaired, now_ns);
            }
            LifecycleEvent::Restart { robot } => {
                let lifecycle = &mut self.robots[robot];
                if matches!(lifecycle.process_state, ProcessState::Dead | ProcessState::Exiting) {
                    (lifecycle.permanent_failure_cause, lifecycle.replaced_death_cause) =
                        (None, None);
                    lifecycle.restart_at_ns = Some(now_ns);
                }
            }
            LifecycleEvent::CutLink { edge, fault } => {
                let link = &mut self.links[edge];
                if link.cutting_fault.is_none() {
                    link.cutting_fault = Some(fault);
                    out.push_order(DriverOrder::SendCutLinks(link.receiver));
                    self.begin_fault(out, fault);
                    self.end_fault(out, fault, FaultEnd::Permanent, now_ns);
                }
            }
            LifecycleEvent::RepairLink { edge } => {
                let link = &mut self.links[edge];
                if let Some(fault) = link.cutting_fault.take() {
                    out.push_order(DriverOrder::SendCutLinks(link.receiver));
                    self.end_fault(out, fault, FaultEnd::Repaired, now_ns);
                }
            }
            LifecycleEvent::ProcessDied(death) => self.handle_death(out, death),
            LifecycleEvent::CleanedUp { robot } => {
                let lifecycle = &mut self.robots[robot];
                lifecycle.pending_cleanups = lifecycle.pending_cleanups.saturating_sub(1);
            }
            LifecycleEvent::StatusReported { robot, takes_part } => {
                self.handle_report(out, robot, takes_part)
            }
            LifecycleEvent::HostUnreachable { robot, fault, reason } => {
                out.push_note("unreachable", Some(robot), reason.clone());
                self.robots[robot].unreachability_cause = Some((fault, reason));
                self.is_alive[robot] = false;
                self.begin_fault(out, fault);
                // Unless the host becomes reachable again.
                self.end_fault(out, fault, FaultEnd::Permanent, now_ns);
            }
            LifecycleEvent::HostReachable { robot, reason } => {
                self.restore_host(out, robot, reason);
            }
            LifecycleEvent::TimePassed => self.start_due_processes(out),
        }
        effects.effects
    }

    /// Ends the fault of a robot whose host was unreachable.
    fn restore_host(&mut self, out: &mut Effects, robot: usize, reason: String) {
        let lifecycle = &mut self.robots[robot];
        if let Some((fault, _)) = lifecycle.unreachability_cause.take() {
            let state = lifecycle.process_state;
            self.is_alive[robot] = matches!(state, ProcessState::Moving | ProcessState::Frozen);
            out.push_note("reachable", Some(robot), reason);
            self.end_fault(out, fault, FaultEnd::Repaired, out.now_ns);
        }
    }

    fn kill(
        &mut self,
        out: &mut Effects,
        robot: usize,
        fault: usize,
        restart_at_ns: Option<u64>,
        initiator: Initiator,
    ) {
        out.push_note("kill", Some(robot), format!("SIGKILL, {}", initiator.keyword()));
        let lifecycle = &mut self.robots[robot];
        // A robot whose process is ending or dead stays dead; only its restart time changes.
        if !matches!(lifecycle.process_state, ProcessState::Exiting | ProcessState::Dead) {
            lifecycle.leave_barrier(out, robot);
            lifecycle.process_state = ProcessState::Exiting;
            out.push_order(DriverOrder::Kill(robot));
        }
        lifecycle.restart_at_ns = restart_at_ns;
        (lifecycle.permanent_failure_cause, lifecycle.replaced_death_cause) = (None, None);
        let earlier_fault = lifecycle.current_fault.replace(fault);
        self.end_faults_as_recovered(out, earlier_fault);
        self.begin_fault(out, fault);
        if restart_at_ns.is_none() {
            self.end_fault(out, fault, FaultEnd::Permanent, out.now_ns);
        }
    }

    fn freeze(
        &mut self,
        out: &mut Effects,
        robot: usize,
        fault: usize,
        has_planned_thaw: bool,
        initiator: Initiator,
    ) {
        let lifecycle = &mut self.robots[robot];
        if lifecycle.process_state == ProcessState::Moving {
            lifecycle.leave_barrier(out, robot);
            lifecycle.process_state = ProcessState::Frozen;
            if initiator != Initiator::OtherProcess {
                out.push_order(DriverOrder::Stop(robot));
            }
        }
        let is_stopped = lifecycle.process_state == ProcessState::Frozen;
        let earlier_fault = if is_stopped { lifecycle.freezing_fault.replace(fault) } else { None };
        let signal_text = if is_stopped { "SIGSTOP" } else { "no process to stop" };
        out.push_note("freeze", Some(robot), format!("{signal_text}, {}", initiator.keyword()));
        self.end_faults_as_recovered(out, earlier_fault);
        self.begin_fault(out, fault);
        // An interactive freeze lasts until an interactive thaw.
        if !has_planned_thaw {
            self.end_fault(out, fault, FaultEnd::Permanent, out.now_ns);
        }
    }

    fn thaw(&mut self, out: &mut Effects, robot: usize, fault: usize, initiator: Initiator) {
        let lifecycle = &mut self.robots[robot];
        if lifecycle.process_state == ProcessState::Frozen {
            lifecycle.process_state = ProcessState::Moving;
            if initiator != Initiator::OtherProcess {
                out.push_order(DriverOrder::Resume(robot));
            }
            lifecycle.join_barrier(out, robot);
        }
        out.push_note("thaw", Some(robot), format!("SIGCONT, {}", initiator.keyword()));
        let freezing_fault = lifecycle.freezing_fault.take();
        self.end_faults_as_recovered(out, [Some(fault), freezing_fault].into_iter().flatten());
    }

    fn handle_death(&mut self, out: &mut Effects, death: ProcessDeath) {
        let ProcessDeath { robot, cause, .. } = death;
        let now_ns = out.now_ns;
        let lifecycle = &mut self.robots[robot];
        let is_planned = lifecycle.process_state == ProcessState::Exiting;
        lifecycle.leave_barrier(out, robot);
        lifecycle.process_state = ProcessState::Dead;
        lifecycle.pending_cleanups += 1;
        self.is_alive[robot] = false;
        out.push_order(DriverOrder::CleanUp(robot));
        out.push_note("died", Some(robot), cause.clone());
        // A dead process is no longer frozen.
        let freezing_fault = lifecycle.freezing_fault.take();
        self.end_faults_as_recovered(out, freezing_fault);
        if is_planned {
            return;
        }
        let lifecycle = &mut self.robots[robot];
        let reaction = lifecycle.action_after_death(now_ns, death.exited_successfully);
        let will_restart = matches!(reaction, DeathReaction::Restart { .. });
        if !will_restart && (death.is_infrastructure_failure || death.is_before_motion) {
            out.push_order(DriverOrder::EndRun { robot, cause });
            return;
        }
        match reaction {
            DeathReaction::Restart { delay_ns } => {
                // The clock of the run stands still during the start-up, so a delay would never pass.
                let delay_ns = if death.is_before_motion { 0 } else { delay_ns };
                lifecycle.unplanned_restarts_ns.push(now_ns);
                lifecycle.restart_at_ns = Some(now_ns.saturating_add(delay_ns));
                lifecycle.replaced_death_cause = Some(cause.clone());
            }
            DeathReaction::RestartLimitReached => {
                let RestartPolicy { restarts_max, window_ns, .. } = lifecycle.policy;
                let window_s = window_ns as f64 / 1e9;
                let detail = format!("{restarts_max} restarts within {window_s} s");
                lifecycle.permanent_failure_cause =
                    Some(format!("died ({cause}) after {detail} (max_restarts)"));
                out.push_note("restart-ceiling", Some(robot), detail);
            }
            DeathReaction::StayDead => {
                let policy = lifecycle.policy.condition.keyword();
                lifecycle.permanent_failure_cause =
                    Some(format!("died ({cause}) and was not restarted (restart_policy {policy})"));
            }
        }
        // A death during a fault that is still in effect belongs to that fault.
        let fault = *lifecycle.current_fault.get_or_insert(death.fault);
        let at_ns = death.last_seen_alive_ns;
        if fault == death.fault {
            self.fault_ends.insert(fault, None);
            out.push_record(RunRecord::UnplannedDeath {
                robot,
                cause: cause.clone(),
                at_ns,
                fault,
            });
        }
        out.push_order(DriverOrder::WarnOfDeath {
            robot,
            cause,
            is_replacement: fault != death.fault,
        });
        // Unless it is restarted interactively.
        if !will_restart {
            self.end_fault(out, fault, FaultEnd::Permanent, at_ns);
        }
    }

    fn handle_report(&mut self, out: &mut Effects, robot: usize, takes_part: bool) {
        let life = &mut self.robots[robot];
        if life.process_state != ProcessState::Starting {
            return;
        }
        // Sent before it receives any beacon, because a replacement does not know which links were cut
        // before its start.
        if self.links.iter().any(|link| link.receiver == robot && link.cutting_fault.is_some()) {
            out.push_order(DriverOrder::SendCutLinks(robot));
        }
        if takes_part {
            life.process_state = ProcessState::Moving;
            life.replaced_death_cause = None;
            self.is_alive[robot] = life.unreachability_cause.is_none();
            life.join_barrier(out, robot);
            out.push_note("ready", Some(robot), format!("incarnation {}", life.incarnation));
            let fault = life.current_fault.take();
            self.end_faults_as_recovered(out, fault);
        }
    }

    fn start_due_processes(&mut self, out: &mut Effects) {
        let pending_cleanups: usize =
            self.robots.iter().map(|lifecycle| lifecycle.pending_cleanups).sum();
        let may_start_before_cleanup = self.restarts_before_cleanup && pending_cleanups <= 1;
        for (robot, lifecycle) in self.robots.iter_mut().enumerate() {
            let is_due = lifecycle.restart_at_ns.is_some_and(|at_ns| at_ns <= out.now_ns);
            if is_due
                && lifecycle.process_state == ProcessState::Dead
                && (may_start_before_cleanup || lifecycle.pending_cleanups == 0)
            {
                lifecycle.restart_at_ns = None;
                lifecycle.incarnation += 1;
                lifecycle.process_state = ProcessState::Starting;
                let incarnation = lifecycle.incarnation;
                out.push_order(DriverOrder::Start { robot, incarnation });
                out.push_note("restart", Some(robot), format!("incarnation {incarnation}"));
            }
        }
    }

    fn begin_fault(&mut self, out: &mut Effects, fault: usize) {
        self.fault_ends.insert(fault, None);
        out.push_record(RunRecord::FaultBegan(fault));
    }

    fn end_faults_as_recovered(
        &mut self,
        out: &mut Effects,
        faults: impl IntoIterator<Item = usize>,
    ) {
        faults
            .into_iter()
            .for_each(|fault| self.end_fault(out, fault, FaultEnd::Repaired, out.now_ns));
    }

    /// Records how a fault ended. An end for good may later become a recovery, by an interactive action; a
    /// recovery is final.
    fn end_fault(&mut self, out: &mut Effects, fault: usize, end: FaultEnd, at_ns: u64) {
        let Some(recorded_end) = self.fault_ends.get_mut(&fault) else { return };
        if recorded_end.is_none()
            || (*recorded_end, end) == (Some(FaultEnd::Permanent), FaultEnd::Repaired)
        {
            *recorded_end = Some(end);
            out.push_record(RunRecord::FaultEnded { fault, end, at_ns });
        }
    }
}

impl Lifecycle {
    /// Returns what the restart policy requires after a death at this run time, ns. `exited_successfully` is whether
    /// the exit code was 0.
    fn action_after_death(&mut self, now_ns: u64, exited_successfully: bool) -> DeathReaction {
        let window_start_ns = now_ns.saturating_sub(self.policy.window_ns);
        self.unplanned_restarts_ns.retain(|&at_ns| at_ns >= window_start_ns);
        self.policy.action_after_death(exited_successfully, self.unplanned_restarts_ns.len() as u32)
    }

    /// Returns the cause of death, if the replacement does not take part yet.
    fn pending_replacement_text(&self) -> Option<String> {
        let cause = self.replaced_death_cause.as_ref()?;
        let replacement_state = match self.process_state {
            ProcessState::Starting => "was not ready",
            _ => "had not been started",
        };
        Some(format!("died ({cause}), and its replacement {replacement_state} at the end"))
    }

    fn join_barrier(&mut self, out: &mut Effects, robot: usize) {
        if !std::mem::replace(&mut self.is_barrier_member, true) {
            out.push_order(DriverOrder::JoinBarrier(robot));
        }
    }

    fn leave_barrier(&mut self, out: &mut Effects, robot: usize) {
        if std::mem::take(&mut self.is_barrier_member) {
            out.push_order(DriverOrder::LeaveBarrier(robot));
        }
    }
}

/// Effects of the current event.
struct Effects {
    effects: Vec<Effect>,
    now_ns: u64,
}

impl Effects {
    fn push_order(&mut self, order: DriverOrder) {
        self.effects.push(Effect::Order(order));
    }

    fn push_record(&mut self, record: RunRecord) {
        self.effects.push(Effect::Record(record));
    }

    fn push_note(&mut self, kind: &'static str, robot: Option<usize>, detail: String) {
        self.push_record(RunRecord::Note { kind, robot, detail });
    }
}
