//! What happens in a run, in order, from the first process to the last.
//!
//! One loop takes in truths, statuses, deaths and signals, and acts on what is due. It never waits
//! for a child: a robot's seat is a state, and each turn of the loop moves it on if it can. In
//! lockstep the plant pauses at the exact tick of each fault until every seat is at rest.
//!
//! | file | question it answers |
//! |---|---|
//! | `launch` | how does it begin? |
//! | `services` | over what do the processes speak? |
//! | `conduct` | how does time pass, and what follows from that? |
//! | `load` | what takes processor time on purpose? |
//! | `by_hand` | what may people do to it meanwhile? |
//! | `farewell` | how does it end? |
//! | `error` | why could it not go on? |

mod by_hand;
mod conduct;
mod error;
mod farewell;
mod launch;
mod load;
mod services;

use std::collections::VecDeque;
use std::process::ExitStatus;
use std::time::{Duration, Instant};

use protocol::message::{
    Contact, LatencyHeader, LatencyRow, LinkFaultByHand, NeighborStatus, StatusHeader, TruthHeader,
    TruthRow,
};
use protocol::process::{Stop, exit};
use protocol::run_root::RunRoot;
use protocol::service::{Node, Publisher, Subscriber};
use rustix::event::{PollFd, PollFlags, Timespec, poll};
use view::View;

use crate::child::{self, Child};
use crate::dead_nodes::Cleaner;
use crate::live;
use crate::outcome::Outcome;
use crate::robot::{Robot, Seat};
use crate::run_dir::RunDir;
use crate::spawn::Launcher;
use crate::timeline::{Act, Due, Timeline};
use conduct::Conduct;
pub use error::RunError;
use error::{READY_MAX, TRUTH_SILENCE_MAX};
use experiment::scenario::{AfterDeath, Scenario};
use load::Load;
use metrics::Metrics;
use metrics::fault::End;
use services::Services;

/// The plant may send as fast as they are taken: after so many it is time for reports and deaths.
const TRUTHS_PER_TURN: usize = 64;
/// How often the agents' reports are looked at; each look costs a little for every robot.
const REPORTS_EVERY: Duration = Duration::from_millis(10);
/// How what the scenario planned is written down.
const AS_PLANNED: &str = "as planned";
/// How many lines of a dead child's log are shown.
const LOG_LINES: usize = 8;

/// A run under way.
pub struct Run<'a> {
    scenario: &'a Scenario,
    run_dir: &'a mut RunDir,
    metrics: &'a mut Metrics,
    stop: Stop,
    /// Whoever looks on.
    view: Option<&'a mut View>,
    /// What was asked for there, and is yet to be done or refused.
    asked: VecDeque<view::Request>,
    /// By edge, the fault by which it is cut by hand.
    cuts: Vec<Option<usize>>,
    outcome: Outcome,
    timeline: Timeline,
    alive: Vec<bool>,
    last_news: Instant,
    reports_taken: Instant,
    /// Run time at which deaths were last looked for: those found next came after it, ns.
    all_seen_alive_ns: u64,
    launched: Instant,
    began: Option<Instant>,
    // In the order in which they must go: processes before services before the run root.
    robots: Vec<Robot>,
    plant: Child,
    load: Load,
    launcher: Launcher,
    truth: Subscriber<[TruthRow], TruthHeader>,
    /// Of the plant, then of the robots in scenario order.
    latencies: Vec<Subscriber<[LatencyRow], LatencyHeader>>,
    /// To each robot in scenario order, if links may be cut by hand.
    faults_by_hand: Vec<Publisher<[LinkFaultByHand]>>,
    cleaner: Cleaner,
    conduct: Conduct,
    _services: Services,
    _node: Node,
    run_root: RunRoot,
}

impl<'a> Run<'a> {
    /// Lets somebody look on, and act by hand.
    pub fn watched_by(self, view: Option<&'a mut View>) -> Run<'a> {
        Run { view, ..self }
    }

    /// Goes on to the end, to a signal, or to an error; then ends every process and removes what they
    /// shared. `progress` is told the run time of the newest truth, ns.
    pub fn to_the_end(mut self, mut progress: impl FnMut(u64)) -> (Outcome, Result<(), RunError>) {
        let ran = self.turn_until_the_end(&mut progress);
        if let Err(error) = &ran {
            tracing::debug!(%error, "the run ends early");
        }
        let (outcome, ended) = self.farewell();
        (outcome, ran.and(ended))
    }

    fn turn_until_the_end(&mut self, progress: &mut impl FnMut(u64)) -> Result<(), RunError> {
        loop {
            if self.stop.requested() {
                self.outcome.interrupted = true;
                return Ok(());
            }
            self.wait_for_news();
            self.take_truths()?;
            // Deaths first: whoever calls a robot stale then does so of a fault that is known.
            self.take_deaths()?;
            // While the plant stands, all that was said before its next act is known before it.
            if self.reports_taken.elapsed() >= REPORTS_EVERY
                || self.conduct.stands(self.outcome.truth.as_ref())
            {
                self.reports_taken = Instant::now();
                self.take_statuses()?;
                self.take_latencies()?;
            }
            self.take_cleaned();
            self.run_dir.flush_if_due(Instant::now())?;
            self.take_requests();
            self.tell_view();
            progress(self.now_ns());
            if self.now_ns() >= self.scenario.duration_ns {
                self.conduct.let_finish();
                return Ok(());
            }
            self.act()?;
            self.check_deadlines()?;
            if self.began.is_some() {
                let robots = self.robots.iter().enumerate();
                let running = robots.filter_map(|(i, robot)| Some((i, robot.seat.child()?)));
                self.conduct.place(&self.plant, running, &self.run_dir.log_path("awake"));
            }
        }
    }

    /// Run time of the newest truth, ns.
    fn now_ns(&self) -> u64 {
        self.outcome.truth.map_or(0, |header| header.t_ns)
    }

    /// Waits until something may have happened.
    fn wait_for_news(&self) {
        self.conduct.wait_for_news(|| {
            let mut news = watch(&self.robots, &self.plant);
            news.push(PollFd::from_borrowed_fd(self.cleaner.news(), PollFlags::IN));
            news
        });
    }

    /// Takes in new truths, but not for longer than other news can wait; whether all are taken.
    fn take_truths(&mut self) -> Result<bool, RunError> {
        let mut all = false;
        for _ in 0..TRUTHS_PER_TURN {
            let Some(sample) = self.truth.receive()? else {
                all = true;
                break;
            };
            let header = *sample.user_header();
            self.began.get_or_insert_with(Instant::now);
            self.metrics.truth(&header, sample.payload(), &self.alive);
            let (errors_m, nearest) = (self.metrics.errors(), self.metrics.nearest());
            self.run_dir.truth(&header, sample.payload(), errors_m, &self.alive, nearest)?;
            self.outcome.truth = Some(header);
            self.last_news = Instant::now();
            if let Some(view) = &mut self.view
                && (view.wants_frame(self.last_news)
                    || view.is_watched() && header.t_ns >= self.scenario.duration_ns)
            {
                let (rows, errors_m) = (sample.payload(), self.metrics.errors());
                view.frame(live::frame(self.scenario, &header, rows, errors_m, &self.robots));
            }
            self.conduct.took(&header);
        }
        self.outcome.startup = self.began.map(|at| at - self.launched);
        self.outcome.wall = self.began.map_or(Duration::ZERO, |at| self.last_news - at);
        Ok(all)
    }

    fn take_statuses(&mut self) -> Result<(), RunError> {
        for i in 0..self.robots.len() {
            while let Some(sample) = self.robots[i].status.receive()? {
                let header = *sample.user_header();
                self.take_status(i, &header, sample.payload())?;
            }
        }
        Ok(())
    }

    fn take_latencies(&mut self) -> Result<(), RunError> {
        self.outcome.latency.now(self.now_ns());
        for (process, subscriber) in self.latencies.iter().enumerate() {
            while let Some(sample) = subscriber.receive()? {
                self.outcome.latency.take(process, sample.user_header(), sample.payload());
            }
        }
        Ok(())
    }

    /// Hands over what else there is to see. Waits for nobody.
    fn tell_view(&mut self) {
        let Some(view) = &mut self.view else { return };
        view.pass_on();
        if view.wants_latency(Instant::now()) {
            view.latency(live::stages(&self.outcome.latency));
        }
    }

    fn take_status(
        &mut self,
        i: usize,
        header: &StatusHeader,
        neighbors: &[NeighborStatus],
    ) -> Result<(), RunError> {
        let robot = &mut self.robots[i];
        if header.incarnation != robot.incarnation {
            return Ok(()); // sent before its death
        }
        robot.misses = header.deadline_misses;
        robot.refused = header.beacons_refused;
        // It says so before it hears anybody, and knows nothing of links cut before its birth.
        if matches!(robot.seat, Seat::Starting { .. }) && self.cuts.iter().any(Option::is_some) {
            self.tell_links(i)?;
        }
        let robot = &mut self.robots[i];
        if self.conduct.takes_part(header)
            && let Seat::Starting { .. } = robot.seat
        {
            robot.seat.has_started();
            let fault = robot.fault.take();
            let t_ns = self.now_ns().max(header.t_ns);
            self.alive[i] = true;
            self.conduct.join(i);
            let detail = format!("incarnation {}", header.incarnation);
            self.event(t_ns, "ready", Some(i), &detail)?;
            if let Some(fault) = fault {
                self.metrics.fault_ended(fault, End::Whole, t_ns);
            }
        }
        if let Some(frame) = Contact::from_number(header.frame)
            && std::mem::replace(&mut self.robots[i].frame, frame) != frame
        {
            let detail = format!("{} frame of the leader", frame.word());
            self.event(header.frame_since_t_ns, "contact", Some(i), &detail)?;
        }
        for status in neighbors {
            let Some(contact) = Contact::from_number(status.contact) else { continue };
            let Some(neighbor) = (status.robot as usize).checked_sub(1) else { continue };
            if contact == Contact::Unheard || neighbor >= self.robots.len() {
                continue;
            }
            self.metrics.contact(i, neighbor, contact, status.since_t_ns);
            let known = &mut self.robots[i].contacts[neighbor];
            if std::mem::replace(known, contact) != contact {
                let detail = format!("{} {}", contact.word(), self.robots[neighbor].name);
                self.event(status.since_t_ns, "contact", Some(i), &detail)?;
            }
        }
        Ok(())
    }

    fn take_deaths(&mut self) -> Result<(), RunError> {
        if !self.anybody_died() {
            self.all_seen_alive_ns = self.now_ns();
            return Ok(());
        }
        if let Some(status) = self.plant.ended() {
            // Its last truth may have been sent between our last look and its end.
            while !self.take_truths()? {}
            if self.now_ns() < self.scenario.duration_ns {
                let log = self.plant.last_lines(LOG_LINES);
                return Err(RunError::PlantDied { how: child::in_words(status), log });
            }
        }
        for i in 0..self.robots.len() {
            if let Some(status) = self.robots[i].seat.child_mut().and_then(Child::ended) {
                self.bury(i, status)?;
            }
        }
        self.load.bury();
        self.all_seen_alive_ns = self.now_ns();
        Ok(())
    }

    /// Asks about all at once: nearly always, none did.
    fn anybody_died(&self) -> bool {
        let load = self.load.children();
        let mut watched = watch(&self.robots, &self.plant);
        watched.extend(load.map(|child| PollFd::from_borrowed_fd(child.pidfd(), PollFlags::IN)));
        // An interruption tells nothing.
        poll(&mut watched, Some(&Timespec { tv_sec: 0, tv_nsec: 0 })) != Ok(0)
    }

    /// A robot's process is dead and reaped.
    fn bury(&mut self, i: usize, status: ExitStatus) -> Result<(), RunError> {
        // Before the clean-up takes what it sent last.
        self.take_latencies()?;
        let t_ns = self.now_ns();
        let how = child::in_words(status);
        let starting_up = self.conduct.starting_up(self.outcome.truth.as_ref());
        let robot = &mut self.robots[i];
        robot.misses_before += std::mem::take(&mut robot.misses);
        robot.refused_before += std::mem::take(&mut robot.refused);
        robot.usage += robot.seat.child().and_then(Child::usage).unwrap_or_default();
        self.alive[i] = false;
        self.conduct.leave(i);
        let planned = matches!(robot.seat, Seat::Ending { .. });
        robot.seat = Seat::Down;
        robot.remains += 1;
        self.cleaner.request(i);
        let frozen_by = robot.frozen_by.take();
        self.event(t_ns, "died", Some(i), &how)?;
        // The dead are not frozen any more.
        if let Some(fault) = frozen_by {
            self.metrics.fault_ended(fault, End::Whole, t_ns);
        }
        if planned {
            return Ok(());
        }
        let robot = &mut self.robots[i];
        tracing::warn!(robot = robot.name, t_s = t_ns as f64 / 1e9, how, "died unasked");
        let policy = self.scenario.robots[i].restart;
        let verdict = policy.after_death(status.success(), robot.recent_restarts(t_ns, &policy));
        let returns = matches!(verdict, AfterDeath::Return { .. });
        let gave_up = status.code().is_some_and(|code| code != 0);
        if !returns && (gave_up || starting_up) {
            let log = child::last_lines(&robot.log, LOG_LINES);
            return Err(RunError::AgentDied { robot: robot.name.clone(), how, log });
        }
        match verdict {
            AfterDeath::Return { delay_ns } => {
                // The run's clock stands still during the start-up: no use in waiting for it.
                let delay_ns = if starting_up { 0 } else { delay_ns };
                robot.restart_unplanned(t_ns, delay_ns);
            }
            AfterDeath::Ceiling => {
                let (count, window_s) = (policy.restarts_max, policy.window_ns as f64 / 1e9);
                let detail = format!("{count} restarts within {window_s} s");
                self.event(t_ns, "restart-ceiling", Some(i), &detail)?;
            }
            AfterDeath::StayDead => {}
        }
        let robot = &mut self.robots[i];
        // A death on top of a fault that is still going on belongs to that fault.
        if robot.fault.is_none() {
            robot.fault = Some(self.metrics.died_unplanned(i, &how, self.all_seen_alive_ns));
        }
        // Unless somebody brings it back by hand.
        if !returns && let Some(fault) = robot.fault {
            self.metrics.fault_ended(fault, End::ForGood, self.all_seen_alive_ns);
        }
        self.set_next_pause();
        Ok(())
    }

    fn take_cleaned(&mut self) {
        while let Some(i) = self.cleaner.done() {
            self.robots[i].remains -= 1;
        }
    }

    /// Does what is due now; in lockstep, only while the plant is paused, which goes on once
    /// nothing is under way.
    fn act(&mut self) -> Result<(), RunError> {
        if !self.conduct.may_act(self.outcome.truth.as_ref()) {
            return Ok(());
        }
        let now_ns = self.now_ns();
        while self.outcome.truth.is_some()
            && let Some(due) = self.timeline.take_due(now_ns)
        {
            self.act_on(due, now_ns, AS_PLANNED)?;
        }
        self.act_by_hand(now_ns)?;
        // Services have room for a replacement beside one of the dead, and nobody waits for the
        // clean-up in real time; in lockstep all do, so that each restart finds the same.
        let remains: usize = self.robots.iter().map(|robot| robot.remains).sum();
        let room = self.conduct.starts_beside_remains() && remains <= 1;
        for i in 0..self.robots.len() {
            let robot = &mut self.robots[i];
            let due = robot.restart_at_ns.is_some_and(|at_ns| at_ns <= now_ns);
            if due && matches!(robot.seat, Seat::Down) && (room || robot.remains == 0) {
                robot.restart_at_ns = None;
                robot.incarnation += 1;
                robot.start(&self.launcher)?;
                self.last_news = Instant::now();
                self.outcome.restarts[i] += 1;
                let detail = format!("incarnation {}", robot.incarnation);
                self.event(now_ns, "restart", Some(i), &detail)?;
            }
        }
        let at_rest = self.robots.iter().all(|robot| match robot.seat {
            Seat::Flying { .. } | Seat::Frozen { .. } => true,
            Seat::Down => {
                robot.remains == 0 && robot.restart_at_ns.is_none_or(|at_ns| at_ns > now_ns)
            }
            Seat::Starting { .. } | Seat::Ending { .. } => false,
        });
        if at_rest && self.outcome.truth.is_some() {
            self.set_next_pause();
            self.conduct.resume();
        }
        Ok(())
    }

    /// Does one thing of the timeline, or the same by hand: `why` is written down.
    fn act_on(&mut self, due: Due, now_ns: u64, why: &str) -> Result<(), RunError> {
        let fault = due.fault;
        match due.act {
            Act::Kill { robot, restart_at_ns } => {
                self.event(now_ns, "kill", Some(robot), &format!("SIGKILL, {why}"))?;
                let struck = &mut self.robots[robot];
                struck.seat.is_killed();
                struck.restart_at_ns = restart_at_ns;
                if let Some(earlier) = struck.fault.replace(fault) {
                    self.metrics.fault_ended(earlier, End::Whole, now_ns);
                }
                self.metrics.fault_began(fault, now_ns);
                if restart_at_ns.is_none() {
                    self.metrics.fault_ended(fault, End::ForGood, now_ns);
                }
            }
            Act::Freeze { robot } => {
                self.conduct.leave(robot);
                let stopped = self.robots[robot].seat.freezes();
                if stopped {
                    self.robots[robot].frozen_by = Some(fault);
                }
                let sent = if stopped { "SIGSTOP" } else { "nobody there to stop" };
                self.event(now_ns, "freeze", Some(robot), &format!("{sent}, {why}"))?;
                self.metrics.fault_began(fault, now_ns);
                // By hand, it lasts until somebody ends it.
                if self.scenario.faults.get(fault).is_none_or(|fault| fault.for_ns.is_none()) {
                    self.metrics.fault_ended(fault, End::ForGood, now_ns);
                }
            }
            Act::Thaw { robot } => {
                if self.robots[robot].seat.thaws() {
                    self.conduct.join(robot);
                }
                self.event(now_ns, "thaw", Some(robot), &format!("SIGCONT, {why}"))?;
                let frozen_by = self.robots[robot].frozen_by.take();
                for fault in [Some(fault), frozen_by].into_iter().flatten() {
                    self.metrics.fault_ended(fault, End::Whole, now_ns);
                }
            }
            Act::KillPlant => {
                self.event(now_ns, "kill", None, "SIGKILL of the plant, as planned")?;
                self.metrics.fault_began(fault, now_ns);
                self.plant.kill();
            }
            Act::StartLoad { processes } => {
                let log = self.run_dir.log_path("load");
                let started = self.load.start(&self.launcher, fault, processes, &log);
                self.event(now_ns, "load", None, &started)?;
                self.metrics.fault_began(fault, now_ns);
            }
            Act::EndLoad => {
                self.load.end(fault);
                self.event(now_ns, "load-ended", None, "")?;
                self.metrics.fault_ended(fault, End::Whole, now_ns);
            }
        }
        Ok(())
    }

    /// Writes down what happened, to a robot or to the run as a whole.
    fn event(
        &mut self,
        t_ns: u64,
        kind: &str,
        robot: Option<usize>,
        detail: &str,
    ) -> Result<(), RunError> {
        let name = robot.map_or("", |robot| self.robots[robot].name.as_str());
        if let Some(view) = &mut self.view {
            view.happened(live::happened(t_ns, kind, name, detail));
        }
        Ok(self.run_dir.event(t_ns, kind, name, detail)?)
    }

    /// Says when something is due next.
    fn set_next_pause(&self) {
        let restarts = self.robots.iter().filter_map(|robot| robot.restart_at_ns);
        let asked = (!self.asked.is_empty()).then_some(0);
        self.conduct.pause_at(restarts.chain(self.timeline.next_ns()).chain(asked).min());
    }

    fn check_deadlines(&self) -> Result<(), RunError> {
        for robot in &self.robots {
            if let Seat::Starting { child, since } = &robot.seat
                && since.elapsed() > READY_MAX
            {
                let log = child.last_lines(LOG_LINES);
                return Err(RunError::NotReady { robot: robot.name.clone(), log });
            }
        }
        if !self.conduct.is_paused() && self.last_news.elapsed() > TRUTH_SILENCE_MAX {
            return Err(RunError::PlantSilent);
        }
        Ok(())
    }
}

/// The exit code of a run that ended with this error.
pub fn exit_code(outcome: &Outcome, ran: &Result<(), RunError>) -> u8 {
    match ran {
        Err(_) => exit::INFRASTRUCTURE,
        Ok(()) if outcome.interrupted => exit::INTERRUPTED,
        Ok(()) => exit::OK,
    }
}

/// What is readable once one of these is dead.
fn watch<'a>(robots: &'a [Robot], plant: &'a Child) -> Vec<PollFd<'a>> {
    let children = robots.iter().filter_map(|robot| robot.seat.child()).chain([plant]);
    children.map(|child| PollFd::from_borrowed_fd(child.pidfd(), PollFlags::IN)).collect()
}
