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
use outcome::metrics::fault::End;
use outcome::report::scene::RobotState;

pub use event::{Death, Effect, Event, Initiator, Order, Record};

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
    Ending,
    /// The process is dead and reaped.
    Down,
}

impl ProcessState {
    /// Returns the state for display. `orphaned` is whether the robot is disconnected from every living leader.
    pub fn state(self, orphaned: bool) -> RobotState {
        match self {
            ProcessState::Moving if orphaned => RobotState::Orphaned,
            ProcessState::Moving => RobotState::Moving,
            ProcessState::Frozen => RobotState::Frozen,
            ProcessState::Starting => RobotState::Starting,
            ProcessState::Ending | ProcessState::Down => RobotState::Dead,
        }
    }
}

/// Lifecycle of one robot.
#[derive(Debug)]
struct Lifecycle {
    process_state: ProcessState,
    incarnation: u64,
    /// Whether the plant waits for the robot at each tick.
    member: bool,
    /// Number of dead and reaped processes of the robot that are not yet cleaned up.
    pending_cleanups: usize,
    /// Run time at which a replacement is due, ns.
    restart_at_ns: Option<u64>,
    policy: RestartPolicy,
    /// Run times of unplanned restarts, ns.
    unplanned_ns: Vec<u64>,
    /// Number of the fault that caused the present death of the robot's process or the start of a replacement.
    fault: Option<usize>,
    /// Number of the fault that froze the robot's process.
    frozen_by: Option<usize>,
    /// Number of the fault that made the robot's host unreachable, and the reason.
    unreachable_by: Option<(usize, String)>,
    /// Cause of an unplanned death after which no replacement is started.
    failed: Option<String>,
    /// Cause of death of the robot's process, until an unplanned replacement takes part.
    replaced: Option<String>,
}

/// Link that may be cut interactively.
#[derive(Debug)]
struct Link {
    hearer: usize,
    /// Number of the fault that cut the link; `None` while the link is not cut.
    cut_by: Option<usize>,
}

/// Lifecycles of all robots.
#[derive(Debug)]
pub struct Lifecycles {
    robots: Vec<Lifecycle>,
    alive: Vec<bool>,
    links: Vec<Link>,
    /// Faults that have begun, and the kind of end of each; `None` while a fault lasts.
    faults: BTreeMap<usize, Option<End>>,
    restart_before_cleanup: bool,
}

impl Lifecycles {
    /// Creates the state in which all first processes are being started. `hearers` is the receiver of each
    /// edge. `restart_before_cleanup` is whether a replacement may start before the stale resources of its
    /// predecessor are removed.
    pub fn new(
        policies: impl Iterator<Item = RestartPolicy>,
        hearers: impl Iterator<Item = usize>,
        restart_before_cleanup: bool,
    ) -> Lifecycles {
        let robots: Vec<Lifecycle> = policies
            .map(|policy| Lifecycle {
                process_state: ProcessState::Starting,
                incarnation: 0,
                member: false,
                pending_cleanups: 0,
                restart_at_ns: None,
                policy,
                unplanned_ns: Vec::new(),
                fault: None,
                frozen_by: None,
                unreachable_by: None,
                failed: None,
                replaced: None,
            })
            .collect();
        Lifecycles {
            alive: vec![true; robots.len()],
            robots,
            links: hearers.map(|hearer| Link { hearer, cut_by: None }).collect(),
            faults: BTreeMap::new(),
            restart_before_cleanup,
        }
    }

    /// Returns the state of a robot's process.
    pub fn process_state(&self, robot: usize) -> ProcessState {
        self.robots[robot].process_state
    }

    /// Returns whether the first status of a process is pending.
    pub fn is_any_starting(&self) -> bool {
        self.robots.iter().any(|life| life.process_state == ProcessState::Starting)
    }

    /// Returns the incarnation number of a robot's process: the number of earlier starts.
    pub fn incarnation(&self, robot: usize) -> u64 {
        self.robots[robot].incarnation
    }

    /// Returns for each robot whether it counts as alive: it did not die, or its replacement takes part.
    pub fn alive_robots(&self) -> &[bool] {
        &self.alive
    }

    /// Returns whether an edge is cut interactively.
    pub fn is_cut(&self, edge: usize) -> bool {
        self.links[edge].cut_by.is_some()
    }

    /// Returns the fault that froze a robot.
    pub fn frozen_by(&self, robot: usize) -> Option<usize> {
        self.robots[robot].frozen_by
    }

    /// Returns whether a replacement is due now or later.
    pub fn will_be_replaced(&self, robot: usize) -> bool {
        self.robots[robot].restart_at_ns.is_some()
    }

    /// Returns the robots that were lost without a plan, and the cause: dead for good, or dead with a
    /// replacement that does not take part yet.
    pub fn failed_robots(&self) -> impl Iterator<Item = (usize, String)> {
        let robots = self.robots.iter().enumerate();
        robots.filter_map(|(robot, life)| Some((robot, life.failed.clone().or(life.waits())?)))
    }

    /// Returns the robots whose host is unreachable, and the reason; without those known to be dead.
    pub fn unreachable_robots(&self) -> impl Iterator<Item = (usize, &str)> {
        let robots = self.robots.iter().enumerate();
        let lives = |life: &Lifecycle| {
            !matches!(life.process_state, ProcessState::Ending | ProcessState::Down)
        };
        let robots = robots.filter(move |(_, life)| lives(life));
        robots.filter_map(|(robot, life)| Some((robot, life.unreachable_by.as_ref()?.1.as_str())))
    }

    /// Returns whether the host of a robot is unreachable.
    pub fn is_unreachable(&self, robot: usize) -> bool {
        self.robots[robot].unreachable_by.is_some()
    }

    /// Returns the run time of the next replacement, ns.
    pub fn next_restart_ns(&self) -> Option<u64> {
        self.robots.iter().filter_map(|life| life.restart_at_ns).min()
    }

    /// Returns whether nothing is in progress at this run time, ns: no process is starting or exiting, no
    /// stale resources are left, and no replacement is due.
    pub fn is_at_rest(&self, now_ns: u64) -> bool {
        self.robots.iter().all(|life| match life.process_state {
            ProcessState::Moving | ProcessState::Frozen => true,
            ProcessState::Down => {
                life.pending_cleanups == 0 && life.restart_at_ns.is_none_or(|at| at > now_ns)
            }
            ProcessState::Starting | ProcessState::Ending => false,
        })
    }

    /// Handles an event at this run time, ns, and returns its effects in order.
    pub fn step(&mut self, now_ns: u64, event: Event) -> Vec<Effect> {
        let mut effects = Effects { effects: Vec::new(), now_ns };
        let out = &mut effects;
        match event {
            Event::Kill { robot, fault, restart_at_ns, who } => {
                self.kill(out, robot, fault, restart_at_ns, who);
            }
            Event::Freeze { robot, fault, ends, who } => {
                self.freeze(out, robot, fault, ends, who);
            }
            Event::Thaw { robot, fault, who } => self.thaw(out, robot, fault, who),
            Event::KillPlant { fault } => {
                let detail = format!("SIGKILL of the plant, {}", Initiator::Plan.keyword());
                out.add_record("kill", None, detail);
                self.begin_fault(out, fault);
                out.order(Order::KillPlant);
            }
            Event::PlantStopped { fault, who } => {
                out.add_record("freeze", None, format!("SIGSTOP of the plant, {}", who.keyword()));
                self.begin_fault(out, fault);
                // Unless it is resumed.
                self.end_fault(out, fault, End::ForGood, now_ns);
            }
            Event::PlantResumed { fault, who } => {
                out.add_record("thaw", None, format!("SIGCONT of the plant, {}", who.keyword()));
                self.end_fault(out, fault, End::Whole, now_ns);
            }
            Event::StartLoad { fault, processes } => {
                out.order(Order::StartLoad { fault, processes });
            }
            Event::LoadStarted { fault, detail } => {
                out.add_record("load", None, detail);
                self.begin_fault(out, fault);
            }
            Event::EndLoad { fault } => {
                out.order(Order::EndLoad { fault });
                out.add_record("load-ended", None, String::new());
                self.end_fault(out, fault, End::Whole, now_ns);
            }
            Event::Restart { robot } => {
                let life = &mut self.robots[robot];
                if matches!(life.process_state, ProcessState::Down | ProcessState::Ending) {
                    (life.failed, life.replaced) = (None, None);
                    life.restart_at_ns = Some(now_ns);
                }
            }
            Event::Cut { edge, fault } => {
                let link = &mut self.links[edge];
                if link.cut_by.is_none() {
                    link.cut_by = Some(fault);
                    out.order(Order::TellLinks(link.hearer));
                    self.begin_fault(out, fault);
                    self.end_fault(out, fault, End::ForGood, now_ns);
                }
            }
            Event::Mend { edge } => {
                let link = &mut self.links[edge];
                if let Some(fault) = link.cut_by.take() {
                    out.order(Order::TellLinks(link.hearer));
                    self.end_fault(out, fault, End::Whole, now_ns);
                }
            }
            Event::Died(death) => self.process_death(out, death),
            Event::Cleaned { robot } => {
                let life = &mut self.robots[robot];
                life.pending_cleanups = life.pending_cleanups.saturating_sub(1);
            }
            Event::Reported { robot, takes_part } => self.process_report(out, robot, takes_part),
            Event::Unreachable { robot, fault, why } => {
                out.add_record("unreachable", Some(robot), why.clone());
                self.robots[robot].unreachable_by = Some((fault, why));
                self.alive[robot] = false;
                self.begin_fault(out, fault);
                // Unless the host becomes reachable again.
                self.end_fault(out, fault, End::ForGood, now_ns);
            }
            Event::Reachable { robot, why } => {
                let life = &mut self.robots[robot];
                if let Some((fault, _)) = life.unreachable_by.take() {
                    let up =
                        matches!(life.process_state, ProcessState::Moving | ProcessState::Frozen);
                    self.alive[robot] = up;
                    out.add_record("reachable", Some(robot), why);
                    self.end_fault(out, fault, End::Whole, now_ns);
                }
            }
            Event::Due => self.start_due(out),
        }
        effects.effects
    }

    fn kill(
        &mut self,
        out: &mut Effects,
        robot: usize,
        fault: usize,
        restart_at_ns: Option<u64>,
        who: Initiator,
    ) {
        out.add_record("kill", Some(robot), format!("SIGKILL, {}", who.keyword()));
        let life = &mut self.robots[robot];
        // A robot whose process is ending or dead stays dead; only its return changes.
        if !matches!(life.process_state, ProcessState::Ending | ProcessState::Down) {
            life.leave_barrier(out, robot);
            life.process_state = ProcessState::Ending;
            out.order(Order::Kill(robot));
        }
        life.restart_at_ns = restart_at_ns;
        (life.failed, life.replaced) = (None, None);
        let earlier = life.fault.replace(fault);
        self.end_faults_as_recovered(out, earlier);
        self.begin_fault(out, fault);
        if restart_at_ns.is_none() {
            self.end_fault(out, fault, End::ForGood, out.now_ns);
        }
    }

    fn freeze(
        &mut self,
        out: &mut Effects,
        robot: usize,
        fault: usize,
        ends: bool,
        who: Initiator,
    ) {
        let life = &mut self.robots[robot];
        if life.process_state == ProcessState::Moving {
            life.leave_barrier(out, robot);
            life.process_state = ProcessState::Frozen;
            if who != Initiator::Outside {
                out.order(Order::Stop(robot));
            }
        }
        let stopped = life.process_state == ProcessState::Frozen;
        let earlier = if stopped { life.frozen_by.replace(fault) } else { None };
        let sent = if stopped { "SIGSTOP" } else { "no process to stop" };
        out.add_record("freeze", Some(robot), format!("{sent}, {}", who.keyword()));
        self.end_faults_as_recovered(out, earlier);
        self.begin_fault(out, fault);
        // An interactive freeze lasts until an interactive thaw.
        if !ends {
            self.end_fault(out, fault, End::ForGood, out.now_ns);
        }
    }

    fn thaw(&mut self, out: &mut Effects, robot: usize, fault: usize, who: Initiator) {
        let life = &mut self.robots[robot];
        if life.process_state == ProcessState::Frozen {
            life.process_state = ProcessState::Moving;
            if who != Initiator::Outside {
                out.order(Order::GoOn(robot));
            }
            life.join(out, robot);
        }
        out.add_record("thaw", Some(robot), format!("SIGCONT, {}", who.keyword()));
        let frozen_by = life.frozen_by.take();
        self.end_faults_as_recovered(out, [Some(fault), frozen_by].into_iter().flatten());
    }

    fn process_death(&mut self, out: &mut Effects, death: Death) {
        let Death { robot, cause: how, .. } = death;
        let now_ns = out.now_ns;
        let life = &mut self.robots[robot];
        let planned = life.process_state == ProcessState::Ending;
        life.leave_barrier(out, robot);
        life.process_state = ProcessState::Down;
        life.pending_cleanups += 1;
        self.alive[robot] = false;
        out.order(Order::CleanUp(robot));
        out.add_record("died", Some(robot), how.clone());
        // A dead process is no longer frozen.
        let frozen_by = life.frozen_by.take();
        self.end_faults_as_recovered(out, frozen_by);
        if planned {
            return;
        }
        let life = &mut self.robots[robot];
        let verdict = life.action_after_death(now_ns, death.success);
        let returns = matches!(verdict, DeathReaction::Return { .. });
        if !returns && (death.gave_up || death.starting_up) {
            out.order(Order::EndRun { robot, how });
            return;
        }
        match verdict {
            DeathReaction::Return { delay_ns } => {
                // The clock of the run stands still during the start-up, so a delay would never pass.
                let delay_ns = if death.starting_up { 0 } else { delay_ns };
                life.unplanned_ns.push(now_ns);
                life.restart_at_ns = Some(now_ns.saturating_add(delay_ns));
                life.replaced = Some(how.clone());
            }
            DeathReaction::Ceiling => {
                let RestartPolicy { restarts_max, window_ns, .. } = life.policy;
                let window_s = window_ns as f64 / 1e9;
                let detail = format!("{restarts_max} restarts within {window_s} s");
                life.failed = Some(format!("died ({how}) after {detail} (max_restarts)"));
                out.add_record("restart-ceiling", Some(robot), detail);
            }
            DeathReaction::StayDead => {
                let policy = life.policy.condition.keyword();
                life.failed =
                    Some(format!("died ({how}) and was not restarted (restart_policy {policy})"));
            }
        }
        // A death during a fault that is still in effect belongs to that fault.
        let fault = *life.fault.get_or_insert(death.fault);
        let at_ns = death.alive_ns;
        if fault == death.fault {
            self.faults.insert(fault, None);
            out.record(Record::DiedUnplanned { robot, how: how.clone(), at_ns, fault });
        }
        out.order(Order::WarnOfDeath { robot, how, again: fault != death.fault });
        // Unless it is restarted interactively.
        if !returns {
            self.end_fault(out, fault, End::ForGood, at_ns);
        }
    }

    fn process_report(&mut self, out: &mut Effects, robot: usize, takes_part: bool) {
        let life = &mut self.robots[robot];
        if life.process_state != ProcessState::Starting {
            return;
        }
        // Sent before it receives any beacon, because a replacement does not know which links were cut
        // before its start.
        if self.links.iter().any(|link| link.hearer == robot && link.cut_by.is_some()) {
            out.order(Order::TellLinks(robot));
        }
        if takes_part {
            life.process_state = ProcessState::Moving;
            life.replaced = None;
            self.alive[robot] = life.unreachable_by.is_none();
            life.join(out, robot);
            out.add_record("ready", Some(robot), format!("incarnation {}", life.incarnation));
            let fault = life.fault.take();
            self.end_faults_as_recovered(out, fault);
        }
    }

    fn start_due(&mut self, out: &mut Effects) {
        let pending_cleanups: usize = self.robots.iter().map(|life| life.pending_cleanups).sum();
        let room = self.restart_before_cleanup && pending_cleanups <= 1;
        for (robot, life) in self.robots.iter_mut().enumerate() {
            let due = life.restart_at_ns.is_some_and(|at_ns| at_ns <= out.now_ns);
            if due
                && life.process_state == ProcessState::Down
                && (room || life.pending_cleanups == 0)
            {
                life.restart_at_ns = None;
                life.incarnation += 1;
                life.process_state = ProcessState::Starting;
                let incarnation = life.incarnation;
                out.order(Order::Start { robot, incarnation });
                out.add_record("restart", Some(robot), format!("incarnation {incarnation}"));
            }
        }
    }

    fn begin_fault(&mut self, out: &mut Effects, fault: usize) {
        self.faults.insert(fault, None);
        out.record(Record::Began(fault));
    }

    fn end_faults_as_recovered(
        &mut self,
        out: &mut Effects,
        faults: impl IntoIterator<Item = usize>,
    ) {
        faults.into_iter().for_each(|fault| self.end_fault(out, fault, End::Whole, out.now_ns));
    }

    /// Records how a fault ended. An end for good may later become a recovery, by an interactive action; a
    /// recovery is final.
    fn end_fault(&mut self, out: &mut Effects, fault: usize, end: End, at_ns: u64) {
        let Some(known) = self.faults.get_mut(&fault) else { return };
        if known.is_none() || (*known, end) == (Some(End::ForGood), End::Whole) {
            *known = Some(end);
            out.record(Record::Ended { fault, end, at_ns });
        }
    }
}

impl Lifecycle {
    /// Returns what the restart policy requires after a death at this run time, ns, with or without `success`.
    fn action_after_death(&mut self, now_ns: u64, success: bool) -> DeathReaction {
        let window_began_ns = now_ns.saturating_sub(self.policy.window_ns);
        self.unplanned_ns.retain(|&at_ns| at_ns >= window_began_ns);
        self.policy.action_after_death(success, self.unplanned_ns.len() as u32)
    }

    /// Returns the cause of death, if the replacement does not take part yet.
    fn waits(&self) -> Option<String> {
        let how = self.replaced.as_ref()?;
        let replacement = match self.process_state {
            ProcessState::Starting => "was not ready",
            _ => "had not been started",
        };
        Some(format!("died ({how}), and its replacement {replacement} at the end"))
    }

    fn join(&mut self, out: &mut Effects, robot: usize) {
        if !std::mem::replace(&mut self.member, true) {
            out.order(Order::Join(robot));
        }
    }

    fn leave_barrier(&mut self, out: &mut Effects, robot: usize) {
        if std::mem::take(&mut self.member) {
            out.order(Order::Leave(robot));
        }
    }
}

/// Effects of the current event.
struct Effects {
    effects: Vec<Effect>,
    now_ns: u64,
}

impl Effects {
    fn order(&mut self, order: Order) {
        self.effects.push(Effect::Order(order));
    }

    fn record(&mut self, record: Record) {
        self.effects.push(Effect::Record(record));
    }

    fn add_record(&mut self, kind: &'static str, robot: Option<usize>, detail: String) {
        self.record(Record::Note { kind, robot, detail });
    }
}
