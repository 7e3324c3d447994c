//! A lockstep run within one process: the control cycles of its robots and the simulation steps of its
//! plant, tick by tick, in the same order as in separate processes. Results are bit-identical to those of
//! processes, which tests check. Used for training, for predictions and for campaigns of many runs. It is
//! not a deployment: no robot is late, lost or killed except as planned.
//!
//! The effects of a kill or a freeze come from the same state machines as with processes: `timeline` and
//! `lifecycle`. `measured` is a complete run, recorded like a run with processes.

pub mod measured;

use std::collections::VecDeque;
use std::convert::Infallible;

use agent::control_cycle::{self, ControlCycle, Inbox};
use agent::controller::Controller;
use agent::laws::{LawOutput, Situation};
use experiment::briefs;
use experiment::scenario::{FaultKind, Scenario};
use outcome::metrics::fault::End;
use plant::motion::Unicycles;
use plant::simulation_step::{Delivery, SimulationStepper, StepError};
use plant::world::World;
use protocol::brief::{AgentBrief, Pace};
use protocol::law_message::Broadcast;

use crate::lifecycle::{Death, Effect, Event, Initiator, Lifecycles, ProcessState};
use crate::timeline::{Due, PlannedAction, Timeline};

/// Exit cause of a killed process, as text.
const KILLED: &str = "signal 9";

/// Reason why a scenario cannot run within one process.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
pub enum NotInProcess {
    /// A program moves the robots.
    #[error(
        "an external program simulates the robots ([plant]), and a run within one process starts no program"
    )]
    PlantProgram,
    /// A fault kills the plant.
    #[error("a fault kills the plant, which has no process in a run within one process")]
    KillsThePlant,
}

/// Lockstep run in progress. `F` creates the controller of a robot from its brief and incarnation number.
pub struct InProcess<F> {
    scenario: Scenario,
    think: F,
    agents: Vec<AgentBrief>,
    plant: SimulationStepper,
    ticks: u64,
    robots: Vec<Robot>,
    /// Beacon of each robot at the previous tick.
    beacons: Vec<Option<Broadcast>>,
    /// Commands of the robots at the current tick.
    commands: Vec<Delivery>,
    timeline: Timeline,
    lifecycles: Lifecycles,
    /// Events caused by the effects already executed, still to be processed.
    follows: VecDeque<Event>,
    /// Clock for latency measurements, ns; constant if the run is not measured.
    clock_ns: fn() -> u64,
}

#[derive(Default)]
struct Robot {
    /// Control cycle of the robot; `None` while its process is dead.
    cycle: Option<ControlCycle>,
    /// First tick at which the robot takes part since its start or thaw; `None` while the plant does not
    /// wait for it.
    member_since: Option<u64>,
    /// Time at which the robot finished sensing the current tick, ns.
    sensed_ns: u64,
    /// Whether the robot has a status report for the supervisor.
    reports: bool,
}

impl Robot {
    /// Returns the control cycle and the first tick of a robot that takes part; otherwise `None`.
    fn taking_part(&mut self) -> Option<(&mut ControlCycle, u64)> {
        self.cycle.as_mut().zip(self.member_since)
    }
}

impl<F: Fn(&AgentBrief, u64) -> Controller> InProcess<F> {
    /// Creates the run at the start, before the first sample. Fails if the scenario needs separate processes.
    pub fn new(scenario: Scenario, think: F) -> Result<InProcess<F>, NotInProcess> {
        if scenario.plant.is_some() {
            return Err(NotInProcess::PlantProgram);
        }
        if scenario.faults.iter().any(|fault| fault.kind == FaultKind::KillPlant) {
            return Err(NotInProcess::KillsThePlant);
        }
        let plant = briefs::plant(&scenario, Pace::Lockstep, "/nowhere".as_ref());
        let agents: Vec<AgentBrief> = agents(&scenario).collect();
        let cycle = |brief: &AgentBrief| ControlCycle::new(brief.clone(), think(brief, 0), 0);
        let robot = |brief| Robot { cycle: Some(cycle(brief)), ..Robot::default() };
        let robots: Vec<Robot> = agents.iter().map(robot).collect();
        let policies = scenario.robots.iter().map(|robot| robot.restart);
        let hearers = scenario.graph.edges().iter().map(|edge| edge.to);
        Ok(InProcess {
            plant: SimulationStepper::new(&plant, Unicycles::new(&plant)),
            ticks: plant.duration_ns / plant.period_ns,
            beacons: vec![None; robots.len()],
            commands: Vec::with_capacity(robots.len()),
            timeline: Timeline::new(&scenario),
            lifecycles: Lifecycles::new(policies, hearers, false),
            follows: VecDeque::new(),
            clock_ns: || 0,
            scenario,
            think,
            agents,
            robots,
        })
    }

    /// Returns the current tick.
    pub fn tick(&self) -> u64 {
        self.world().tick()
    }

    /// Returns the total number of ticks.
    pub fn ticks(&self) -> u64 {
        self.ticks
    }

    /// Returns whether the last tick has been reached, to which no robot replies.
    pub fn is_over(&self) -> bool {
        self.plant.is_over()
    }

    /// Returns the plant state.
    pub fn world(&self) -> &World {
        self.plant.world()
    }

    /// Returns for each robot, in scenario order, whether it is alive.
    pub fn alive(&self) -> &[bool] {
        self.lifecycles.alive()
    }

    /// Returns whether this robot is dead and no restart is planned or in progress.
    pub fn is_gone(&self, robot: usize) -> bool {
        self.lifecycles.process_state(robot) == ProcessState::Down
            && !self.lifecycles.returns(robot)
    }

    /// Returns what the control law of this robot sees at the current tick, after [`Self::sense`]. `None`
    /// if the robot has no reference to track, or does not take part.
    pub fn situation(&self, robot: usize) -> Option<Situation<'_>> {
        let Robot { cycle, member_since, .. } = &self.robots[robot];
        cycle.as_ref().zip(*member_since)?.0.controller().situation()
    }

    /// Executes the kills, freezes and restarts of this tick and passes each effect to `on_effect`; then
    /// lets all robots that take part sense, and receive the beacons of the previous tick.
    pub fn sense(&mut self, on_effect: impl FnMut(&Effect)) {
        self.act(on_effect);
        let InProcess { robots, plant, agents, beacons, clock_ns, .. } = self;
        for (place, robot) in robots.iter_mut().enumerate() {
            let Some((cycle, member_since)) = robot.taking_part() else { continue };
            let odometry = plant.sense(place, clock_ns());
            // Only from robots that take part; backup neighbors count while their edge is open.
            let heard = agents[place].senders().enumerate().filter_map(|(place, sender)| {
                let Broadcast { beacon, message } = beacons[sender.index - 1].clone()?;
                let delivery = control_cycle::Delivery { place, beacon, message, taken_ns: 0 };
                Some(Ok::<_, Infallible>(delivery))
            });
            let Ok(()) = cycle.sense(Inbox {
                taken_ns: clock_ns(),
                odometry: Some(&odometry),
                member_since,
                beacons: heard,
                cuts: &[],
                goal: None,
            });
            robot.sensed_ns = clock_ns();
        }
    }

    /// Lets all robots that take part reply to the current tick with the law output that `wish` returns for
    /// a robot's index and control cycle; then advances the plant by one period.
    pub fn step(&mut self, mut wish: impl FnMut(usize, &mut ControlCycle) -> LawOutput) {
        let InProcess { robots, plant, beacons, commands, clock_ns, .. } = self;
        for (place, robot) in robots.iter_mut().enumerate() {
            let sensed_ns = robot.sensed_ns;
            beacons[place] = None;
            robot.reports = false;
            let Some((cycle, _)) = robot.taking_part() else { continue };
            // Time during which other robots compute is not part of this robot's cycle.
            let idle_ns = clock_ns().saturating_sub(sensed_ns);
            let wish = wish(place, cycle);
            let outbox = cycle.act(wish);
            if let Some(answer) = outbox.answer {
                let sent_ns = clock_ns();
                cycle.record_sent(sent_ns.saturating_sub(idle_ns));
                beacons[place] = answer.broadcast();
                let command = answer.command;
                commands.push(Delivery {
                    robot: place,
                    command,
                    taken_ns: sent_ns,
                    is_retired: false,
                });
            }
            robot.reports = outbox.report;
        }
        let passed: Result<(), StepError> = plant.step(commands.drain(..).map(Ok), *clock_ns);
        passed.expect("unicycles do not fail");
    }

    /// Executes the planned process faults of the current tick and their consequences. A load fault has no
    /// effect here.
    fn act(&mut self, mut on_effect: impl FnMut(&Effect)) {
        let now_ns = self.world().t_ns();
        if self.tick() == 0 {
            for robot in 0..self.robots.len() {
                self.happens(Event::Reported { robot, takes_part: true }, &mut on_effect);
            }
        }
        while let Some(Due { fault, act, .. }) = self.timeline.take_due(now_ns) {
            let who = Initiator::Plan;
            let event = match act {
                PlannedAction::Kill { robot, restart_at_ns } => {
                    Event::Kill { robot, fault, restart_at_ns, who }
                }
                PlannedAction::Freeze { robot } => {
                    let ends = self.scenario.faults[fault].for_ns.is_some();
                    Event::Freeze { robot, fault, ends, who }
                }
                PlannedAction::Thaw { robot } => Event::Thaw { robot, fault, who },
                PlannedAction::KillPlant => unreachable!("InProcess::new rejects it"),
                PlannedAction::StartLoad { .. } => {
                    on_effect(&Effect::Began(fault));
                    continue;
                }
                PlannedAction::EndLoad => {
                    on_effect(&Effect::Ended { fault, end: End::Whole, at_ns: now_ns });
                    continue;
                }
            };
            self.happens(event, &mut on_effect);
        }
        while !self.lifecycles.is_at_rest(now_ns) {
            self.happens(Event::Due, &mut on_effect);
            while let Some(event) = self.follows.pop_front() {
                self.happens(event, &mut on_effect);
            }
        }
    }

    /// Handles an event of a robot, and executes its effects.
    fn happens(&mut self, event: Event, on_effect: &mut impl FnMut(&Effect)) {
        let now_ns = self.world().t_ns();
        for effect in self.lifecycles.step(now_ns, event) {
            match effect {
                Effect::Start { robot, incarnation } => {
                    let brief = &self.agents[robot];
                    let controller = (self.think)(brief, incarnation);
                    self.robots[robot].cycle =
                        Some(ControlCycle::new(brief.clone(), controller, now_ns));
                    self.follows.push_back(Event::Reported { robot, takes_part: true });
                }
                Effect::Kill(robot) => {
                    self.robots[robot].cycle = None;
                    self.follows.push_back(Event::Died(Death {
                        robot,
                        how: KILLED.into(),
                        success: false,
                        gave_up: false,
                        starting_up: false,
                        alive_ns: 0,
                        fault: 0,
                    }));
                }
                Effect::CleanUp(robot) => self.follows.push_back(Event::Cleaned { robot }),
                Effect::Join(robot) => self.robots[robot].member_since = Some(self.tick()),
                Effect::Leave(robot) => {
                    self.robots[robot].member_since = None;
                    self.beacons[robot] = None;
                }
                _ => {}
            }
            on_effect(&effect);
        }
    }
}

/// Returns the brief of each robot, in scenario order.
pub fn agents(scenario: &Scenario) -> impl Iterator<Item = AgentBrief> {
    let robots = 0..scenario.robots.len();
    robots.map(|i| briefs::agent(scenario, i, Pace::Lockstep, "/nowhere".as_ref()))
}
