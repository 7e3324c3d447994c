//! Where each robot's process is in its life, and what follows from what happens to it.
//!
//! Pure: an event in, effects out, in the order in which they are to be done. This is where kill,
//! freeze, death and restart meet. Must not: start or signal a process, read a clock, write a file,
//! or know how time passes.

mod event;
#[cfg(test)]
mod tests;

use std::collections::BTreeMap;

use experiment::scenario::{AfterDeath, RestartPolicy};
use outcome::metrics::fault::End;
use outcome::report::scene::RobotState;
use protocol::planted;

pub use event::{Death, Effect, Event, Who};

/// Where a robot's process is in its life.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Seat {
    /// Started; its first status is awaited.
    Starting,
    /// Taking part.
    Moving,
    /// Stopped by SIGSTOP.
    Frozen,
    /// Killed on purpose; its end is awaited.
    Ending,
    /// Dead and reaped.
    Down,
}

impl Seat {
    /// How a robot in it looks. `orphaned`: no living leader reaches it.
    pub fn state(self, orphaned: bool) -> RobotState {
        match self {
            Seat::Moving if orphaned => RobotState::Orphaned,
            Seat::Moving => RobotState::Moving,
            Seat::Frozen => RobotState::Frozen,
            Seat::Starting => RobotState::Starting,
            Seat::Ending | Seat::Down => RobotState::Dead,
        }
    }
}

/// One robot's life.
#[derive(Debug)]
struct Life {
    seat: Seat,
    incarnation: u64,
    /// The plant waits for it.
    member: bool,
    /// Its processes that are dead and reaped, and not yet cleaned up.
    remains: usize,
    /// Run time at which a replacement is due, ns.
    restart_at_ns: Option<u64>,
    policy: RestartPolicy,
    /// Run times of restarts nobody planned, ns.
    unplanned_ns: Vec<u64>,
    /// The fault that its present death, or its replacement's start, belongs to.
    fault: Option<usize>,
    /// The fault by which it is frozen.
    frozen_by: Option<usize>,
    /// The fault by which its host is out of reach, and why it is.
    unreachable_by: Option<(usize, String)>,
    /// Dead for good by nobody's plan: how that came about.
    failed: Option<String>,
    /// How its process died, while a replacement that no plan has is yet to take part.
    replaced: Option<String>,
}

/// A link that may be cut by hand.
#[derive(Debug)]
struct Link {
    hearer: usize,
    /// The fault by which it is.
    cut_by: Option<usize>,
}

/// All robots' lives.
#[derive(Debug)]
pub struct Lives {
    robots: Vec<Life>,
    alive: Vec<bool>,
    links: Vec<Link>,
    /// How far each fault is that began: `None` while it lasts.
    faults: BTreeMap<usize, Option<End>>,
    beside_remains: bool,
}

impl Lives {
    /// All first processes are being started. `hearers`: of each edge. `beside_remains`: services
    /// have room for a replacement beside one of the dead, and it need not wait for the clean-up.
    pub fn new(
        policies: impl Iterator<Item = RestartPolicy>,
        hearers: impl Iterator<Item = usize>,
        beside_remains: bool,
    ) -> Lives {
        let robots: Vec<Life> = policies
            .map(|policy| Life {
                seat: Seat::Starting,
                incarnation: 0,
                member: false,
                remains: 0,
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
        Lives {
            alive: vec![true; robots.len()],
            robots,
            links: hearers.map(|hearer| Link { hearer, cut_by: None }).collect(),
            faults: BTreeMap::new(),
            beside_remains,
        }
    }

    /// Where a robot is in its life.
    pub fn seat(&self, robot: usize) -> Seat {
        self.robots[robot].seat
    }

    /// Whether the first status of some process is awaited.
    pub fn anybody_starts(&self) -> bool {
        self.robots.iter().any(|life| life.seat == Seat::Starting)
    }

    /// How often a robot's process was started before this one.
    pub fn incarnation(&self, robot: usize) -> u64 {
        self.robots[robot].incarnation
    }

    /// Who counts as alive: whoever did not die, or was replaced by one that takes part.
    pub fn alive(&self) -> &[bool] {
        &self.alive
    }

    /// Whether an edge is cut by hand.
    pub fn is_cut(&self, edge: usize) -> bool {
        self.links[edge].cut_by.is_some()
    }

    /// The fault by which a robot is frozen.
    pub fn frozen_by(&self, robot: usize) -> Option<usize> {
        self.robots[robot].frozen_by
    }

    /// Whether a replacement is due now or later.
    pub fn returns(&self, robot: usize) -> bool {
        self.robots[robot].restart_at_ns.is_some()
    }

    /// Returns the robots that no plan has lost, and how that came about: dead for good, or dead now with a replacement
    /// that does not take part yet.
    pub fn failed(&self) -> impl Iterator<Item = (usize, String)> {
        let robots = self.robots.iter().enumerate();
        robots.filter_map(|(robot, life)| Some((robot, life.failed.clone().or(life.waits())?)))
    }

    /// Returns the robots whose host is out of reach, and why it is; without those that are known to be dead.
    pub fn unreachable(&self) -> impl Iterator<Item = (usize, &str)> {
        let robots = self.robots.iter().enumerate();
        let lives = |life: &Life| !matches!(life.seat, Seat::Ending | Seat::Down);
        let robots = robots.filter(move |(_, life)| lives(life));
        robots.filter_map(|(robot, life)| Some((robot, life.unreachable_by.as_ref()?.1.as_str())))
    }

    /// Returns whether the host of a robot is out of reach.
    pub fn is_unreachable(&self, robot: usize) -> bool {
        self.robots[robot].unreachable_by.is_some()
    }

    /// When the next replacement is due, ns.
    pub fn next_restart_ns(&self) -> Option<u64> {
        self.robots.iter().filter_map(|life| life.restart_at_ns).min()
    }

    /// Whether nothing is under way at this run time, ns: nobody starts or ends, nothing of the dead
    /// is left, no replacement is due.
    pub fn at_rest(&self, now_ns: u64) -> bool {
        self.robots.iter().all(|life| match life.seat {
            Seat::Moving | Seat::Frozen => true,
            Seat::Down => life.remains == 0 && life.restart_at_ns.is_none_or(|at| at > now_ns),
            Seat::Starting | Seat::Ending => false,
        })
    }

    /// What follows from an event at this run time, ns.
    pub fn step(&mut self, now_ns: u64, event: Event) -> Vec<Effect> {
        let mut effects = Effects { list: Vec::new(), now_ns };
        let out = &mut effects;
        match event {
            Event::Kill { robot, fault, restart_at_ns, who } => {
                self.kill(out, robot, fault, restart_at_ns, who);
            }
            Event::Freeze { robot, fault, ends, who } => {
                self.freeze(out, robot, fault, ends, who);
            }
            Event::Thaw { robot, fault, who } => self.thaw(out, robot, fault, who),
            Event::Restart { robot } => {
                let life = &mut self.robots[robot];
                if matches!(life.seat, Seat::Down | Seat::Ending) {
                    (life.failed, life.replaced) = (None, None);
                    life.restart_at_ns = Some(now_ns);
                }
            }
            Event::Cut { edge, fault } => {
                let link = &mut self.links[edge];
                if link.cut_by.is_none() {
                    link.cut_by = Some(fault);
                    out.push(Effect::TellLinks(link.hearer));
                    self.began(out, fault);
                    self.ended(out, fault, End::ForGood, now_ns);
                }
            }
            Event::Mend { edge } => {
                let link = &mut self.links[edge];
                if let Some(fault) = link.cut_by.take() {
                    out.push(Effect::TellLinks(link.hearer));
                    self.ended(out, fault, End::Whole, now_ns);
                }
            }
            Event::Died(death) => self.died(out, death),
            Event::Cleaned { robot } => {
                let life = &mut self.robots[robot];
                life.remains = life.remains.saturating_sub(1);
            }
            Event::Reported { robot, takes_part } => self.reported(out, robot, takes_part),
            Event::Unreachable { robot, fault, why } => {
                out.note("unreachable", robot, why.clone());
                self.robots[robot].unreachable_by = Some((fault, why));
                self.alive[robot] = false;
                self.began(out, fault);
                // Unless it is heard again.
                self.ended(out, fault, End::ForGood, now_ns);
            }
            Event::Reachable { robot, why } => {
                let life = &mut self.robots[robot];
                if let Some((fault, _)) = life.unreachable_by.take() {
                    let up = matches!(life.seat, Seat::Moving | Seat::Frozen);
                    self.alive[robot] = up;
                    out.note("reachable", robot, why);
                    self.ended(out, fault, End::Whole, now_ns);
                }
            }
            Event::Due => self.start_due(out),
        }
        effects.list
    }

    fn kill(
        &mut self,
        out: &mut Effects,
        robot: usize,
        fault: usize,
        restart_at_ns: Option<u64>,
        who: Who,
    ) {
        out.note("kill", robot, format!("SIGKILL, {}", who.word()));
        let life = &mut self.robots[robot];
        // Whoever is ending, or dead, is dead already: only its return is another.
        if !matches!(life.seat, Seat::Ending | Seat::Down) {
            life.leave(out, robot);
            life.seat = Seat::Ending;
            out.push(Effect::Kill(robot));
        }
        life.restart_at_ns = restart_at_ns;
        (life.failed, life.replaced) = (None, None);
        let earlier = life.fault.replace(fault);
        self.all_whole(out, earlier);
        self.began(out, fault);
        if restart_at_ns.is_none() {
            self.ended(out, fault, End::ForGood, out.now_ns);
        }
    }

    fn freeze(&mut self, out: &mut Effects, robot: usize, fault: usize, ends: bool, who: Who) {
        let life = &mut self.robots[robot];
        if life.seat == Seat::Moving {
            life.leave(out, robot);
            life.seat = Seat::Frozen;
            if who != Who::Outside {
                out.push(Effect::Stop(robot));
            }
        }
        let stopped = life.seat == Seat::Frozen;
        let earlier = if stopped { life.frozen_by.replace(fault) } else { None };
        let sent = if stopped { "SIGSTOP" } else { "nobody there to stop" };
        out.note("freeze", robot, format!("{sent}, {}", who.word()));
        self.all_whole(out, earlier);
        self.began(out, fault);
        // By hand, it lasts until somebody ends it.
        if !ends {
            self.ended(out, fault, End::ForGood, out.now_ns);
        }
    }

    fn thaw(&mut self, out: &mut Effects, robot: usize, fault: usize, who: Who) {
        let life = &mut self.robots[robot];
        if life.seat == Seat::Frozen {
            life.seat = Seat::Moving;
            if who != Who::Outside {
                out.push(Effect::GoOn(robot));
            }
            life.join(out, robot);
        }
        out.note("thaw", robot, format!("SIGCONT, {}", who.word()));
        let frozen_by = life.frozen_by.take();
        self.all_whole(out, [Some(fault), frozen_by].into_iter().flatten());
    }

    fn died(&mut self, out: &mut Effects, death: Death) {
        let Death { robot, how, .. } = death;
        let now_ns = out.now_ns;
        let life = &mut self.robots[robot];
        let planned = life.seat == Seat::Ending;
        life.leave(out, robot);
        life.seat = Seat::Down;
        life.remains += 1;
        self.alive[robot] = false;
        out.push(Effect::CleanUp(robot));
        out.note("died", robot, how.clone());
        // The dead are not frozen any more.
        let frozen_by = life.frozen_by.take();
        self.all_whole(out, frozen_by);
        if planned {
            return;
        }
        let life = &mut self.robots[robot];
        let verdict = life.after_death(now_ns, death.success);
        let returns = matches!(verdict, AfterDeath::Return { .. });
        if !returns && (death.gave_up || death.starting_up) {
            out.push(Effect::GaveUp { robot, how });
            return;
        }
        match verdict {
            AfterDeath::Return { delay_ns } => {
                // The run's clock stands still during the start-up: no use in waiting for it.
                let delay_ns = if death.starting_up { 0 } else { delay_ns };
                life.unplanned_ns.push(now_ns);
                life.restart_at_ns = Some(now_ns.saturating_add(delay_ns));
                life.replaced = Some(how.clone());
            }
            AfterDeath::Ceiling => {
                let RestartPolicy { restarts_max, window_ns, .. } = life.policy;
                let window_s = window_ns as f64 / 1e9;
                let detail = format!("{restarts_max} restarts within {window_s} s");
                life.failed = Some(format!("died ({how}) after {detail} (max_restarts)"));
                out.note("restart-ceiling", robot, detail);
            }
            AfterDeath::StayDead => {
                let policy = life.policy.when.word();
                life.failed =
                    Some(format!("died ({how}) and was not restarted (restart_policy {policy})"));
            }
        }
        // A death on top of a fault that is still going on belongs to that fault.
        let fault = *life.fault.get_or_insert(death.fault);
        let at_ns = death.alive_ns;
        if fault == death.fault {
            self.faults.insert(fault, None);
            out.push(Effect::DiedUnplanned { robot, how, at_ns, fault });
        } else {
            out.push(Effect::DiedAgain { robot, how });
        }
        // Unless somebody brings it back by hand.
        if !returns {
            self.ended(out, fault, End::ForGood, at_ns);
        }
    }

    fn reported(&mut self, out: &mut Effects, robot: usize, takes_part: bool) {
        let is_away = |life: &Life| matches!(life.seat, Seat::Frozen | Seat::Down);
        let two_are_away = self.robots.iter().filter(|life| is_away(life)).count() > 1;
        let life = &mut self.robots[robot];
        if life.seat != Seat::Starting {
            return;
        }
        // It says so before it hears anybody, and knows nothing of links cut before its birth.
        if self.links.iter().any(|link| link.hearer == robot && link.cut_by.is_some()) {
            out.push(Effect::TellLinks(robot));
        }
        if takes_part {
            life.seat = Seat::Moving;
            life.replaced = None;
            self.alive[robot] = life.unreachable_by.is_none();
            if !(two_are_away && planted::is("join-lost")) {
                life.join(out, robot);
            }
            out.note("ready", robot, format!("incarnation {}", life.incarnation));
            let fault = life.fault.take();
            self.all_whole(out, fault);
        }
    }

    fn start_due(&mut self, out: &mut Effects) {
        let remains: usize = self.robots.iter().map(|life| life.remains).sum();
        let room = self.beside_remains && remains <= 1;
        for (robot, life) in self.robots.iter_mut().enumerate() {
            let due = life.restart_at_ns.is_some_and(|at_ns| at_ns <= out.now_ns);
            if due && life.seat == Seat::Down && (room || life.remains == 0) {
                life.restart_at_ns = None;
                life.incarnation += 1;
                life.seat = Seat::Starting;
                let incarnation = life.incarnation;
                out.push(Effect::Start { robot, incarnation });
                out.note("restart", robot, format!("incarnation {incarnation}"));
            }
        }
    }

    fn began(&mut self, out: &mut Effects, fault: usize) {
        self.faults.insert(fault, None);
        out.push(Effect::Began(fault));
    }

    fn all_whole(&mut self, out: &mut Effects, faults: impl IntoIterator<Item = usize>) {
        faults.into_iter().for_each(|fault| self.ended(out, fault, End::Whole, out.now_ns));
    }

    /// What ended for good may be made whole after all, by hand; what is whole stays so.
    fn ended(&mut self, out: &mut Effects, fault: usize, end: End, at_ns: u64) {
        let Some(known) = self.faults.get_mut(&fault) else { return };
        if known.is_none() || (*known, end) == (Some(End::ForGood), End::Whole) {
            *known = Some(end);
            out.push(Effect::Ended { fault, end, at_ns });
        }
    }
}

impl Life {
    /// What its policy says of a death at this run time, ns, with or without `success`.
    fn after_death(&mut self, now_ns: u64, success: bool) -> AfterDeath {
        let window_began_ns = now_ns.saturating_sub(self.policy.window_ns);
        self.unplanned_ns.retain(|&at_ns| at_ns >= window_began_ns);
        self.policy.after_death(success, self.unplanned_ns.len() as u32)
    }

    /// Returns how it died, if its replacement does not take part yet.
    fn waits(&self) -> Option<String> {
        let how = self.replaced.as_ref()?;
        let replacement = match self.seat {
            Seat::Starting => "was not ready",
            _ => "had not been started",
        };
        Some(format!("died ({how}), and its replacement {replacement} at the end"))
    }

    fn join(&mut self, out: &mut Effects, robot: usize) {
        if !std::mem::replace(&mut self.member, true) {
            out.push(Effect::Join(robot));
        }
    }

    fn leave(&mut self, out: &mut Effects, robot: usize) {
        if std::mem::take(&mut self.member) {
            out.push(Effect::Leave(robot));
        }
    }
}

/// What is to be done so far.
struct Effects {
    list: Vec<Effect>,
    now_ns: u64,
}

impl Effects {
    fn push(&mut self, effect: Effect) {
        self.list.push(effect);
    }

    fn note(&mut self, kind: &'static str, robot: usize, detail: String) {
        self.push(Effect::Note { kind, robot, detail });
    }
}
