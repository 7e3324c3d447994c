//! Processes that somebody else stops (`kill -STOP`, Ctrl-Z) and lets go on: told on the screen and, in real time,
//! where the run goes on without them, as a fault like any other. In lockstep all wait, and nothing of the run
//! depends on it.

use std::time::{Duration, Instant};

use experiment::scenario::{FaultKind, Struck};
use outcome::metrics::fault::End;

use super::Run;
use super::error::RunError;
use super::lives::{Event, Seat, Who};

/// How often the kernel is asked who is stopped.
const LOOK_EVERY: Duration = Duration::from_millis(100);

/// Who is stopped by somebody else.
pub(super) struct Stops {
    looked: Instant,
    plant: Option<Stopped>,
    /// In scenario order.
    robots: Vec<Option<Stopped>>,
}

/// A process that is.
#[derive(Debug, Clone, Copy)]
struct Stopped {
    since: Instant,
    /// The number of its fault, in real time.
    fault: Option<usize>,
}

impl Stops {
    /// Of so many robots none.
    pub(super) fn new(robots: usize) -> Stops {
        Stops { looked: Instant::now(), plant: None, robots: vec![None; robots] }
    }
}

impl Run<'_> {
    /// Looks, if it is time to, who was stopped, and who goes on.
    pub(super) fn take_stops(&mut self) -> Result<(), RunError> {
        if self.stops.looked.elapsed() < LOOK_EVERY {
            return Ok(());
        }
        self.stops.looked = Instant::now();
        match (self.stops.plant, self.processes.plant.is_stopped()) {
            (None, true) => self.stops.plant = Some(self.plant_was_stopped()),
            (Some(stopped), false) => self.plant_goes_on(stopped),
            _ => {}
        }
        for robot in 0..self.scenario.robots.len() {
            let stopped = self.processes.is_stopped(robot);
            match self.stops.robots[robot] {
                None if stopped && self.lives.seat(robot) == Seat::Moving => {
                    self.stops.robots[robot] = Some(self.robot_was_stopped(robot)?);
                }
                Some(since) if !stopped => self.robot_goes_on(robot, since)?,
                _ => {}
            }
        }
        Ok(())
    }

    fn plant_was_stopped(&mut self) -> Stopped {
        let now_ns = self.intake.now_ns();
        warn_of("the plant", "nobody moves before it goes on (SIGCONT)");
        let fault = self.conduct.goes_on_without_the_stopped().then(|| {
            let detail = format!("SIGSTOP of the plant, {}", Who::Outside.word());
            self.journal.event(now_ns, "freeze", None, detail);
            let what = format!("freeze plant, {}", Who::Outside.word());
            let fault = self.journal.metrics.new_fault(what, Struck::default());
            self.journal.metrics.fault_began(fault, now_ns);
            // Unless it goes on.
            self.journal.metrics.fault_ended(fault, End::ForGood, now_ns);
            fault
        });
        Stopped { since: Instant::now(), fault }
    }

    fn plant_goes_on(&mut self, stopped: Stopped) {
        self.stops.plant = None;
        stopped.tell_its_end("the plant");
        if let Some(fault) = stopped.fault {
            let now_ns = self.intake.now_ns();
            let detail = format!("SIGCONT of the plant, {}", Who::Outside.word());
            self.journal.event(now_ns, "thaw", None, detail);
            self.journal.metrics.fault_ended(fault, End::Whole, now_ns);
        }
    }

    fn robot_was_stopped(&mut self, robot: usize) -> Result<Stopped, RunError> {
        let stopped = Stopped { since: Instant::now(), fault: None };
        let name = self.journal.name(robot);
        if !self.conduct.goes_on_without_the_stopped() {
            warn_of(name, "the run waits for it (SIGCONT)");
            return Ok(stopped);
        }
        warn_of(name, "the others go on without it");
        let who = Who::Outside;
        let fault = self.new_fault(&FaultKind::Freeze { robot }, who);
        self.happens(self.intake.now_ns(), Event::Freeze { robot, fault, ends: false, who })?;
        Ok(Stopped { fault: Some(fault), ..stopped })
    }

    /// It goes on, or is dead.
    fn robot_goes_on(&mut self, robot: usize, stopped: Stopped) -> Result<(), RunError> {
        self.stops.robots[robot] = None;
        let frozen_by = self.lives.frozen_by(robot);
        if let Some(fault) = stopped.fault.filter(|&fault| frozen_by == Some(fault)) {
            stopped.tell_its_end(self.journal.name(robot));
            let who = Who::Outside;
            self.happens(self.intake.now_ns(), Event::Thaw { robot, fault, who })?;
        }
        Ok(())
    }
}

fn warn_of(name: &str, what_follows: &str) {
    tracing::warn!("{name} was stopped by somebody else; {what_follows}");
}

impl Stopped {
    fn tell_its_end(&self, name: &str) {
        let lasted_s = self.since.elapsed().as_secs_f64();
        tracing::warn!("{name} goes on, after {lasted_s:.1} s");
    }
}
