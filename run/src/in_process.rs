//! A lockstep run within one process: the control cycles of its robots and the simulation steps of its
//! plant, tick by tick, in the same order as in separate processes. Results are bit-identical to those of
//! processes, which tests check. Used for training, for predictions and for campaigns of many runs. It is
//! not a deployment: no robot is late, lost or killed except as planned.
//!
//! This is a driver of a [`Course`], which decides what follows from an event, as with processes. `measured` is a
//! complete run, recorded like a run with processes.

pub mod measured;

use std::collections::VecDeque;
use std::convert::Infallible;

use agent::control_cycle::{self, ControlCycle, Inbox};
use agent::controller::Controller;
use agent::laws::{LawOutput, Situation};
use experiment::briefs;
use experiment::scenario::{FaultKind, Scenario};
use plant::motion::Unicycles;
use plant::simulation_step::{Delivery, SimulationStepper, StepError};
use plant::world::World;
use protocol::brief::{AgentBrief, Pace};
use protocol::law_message::Broadcast;

use crate::course::{Course, Records};
use crate::lifecycle::{Death, Event, Order, ProcessState};

/// Exit cause of a killed process, as text.
const KILLED_CAUSE: &str = "signal 9";

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

/// Lockstep run in progress. `F` creates the controller of a robot from its brief and incarnation number. `J`
/// receives the records; `()` takes none.
pub struct InProcess<F, J = ()> {
    scenario: Scenario,
    think: F,
    agents: Vec<AgentBrief>,
    plant: SimulationStepper,
    ticks: u64,
    robots: Vec<RobotProcess>,
    /// Beacon of each robot at the previous tick.
    beacons: Vec<Option<Broadcast>>,
    /// Commands of the robots at the current tick.
    commands: Vec<Delivery>,
    course: Course<J>,
    /// Events caused by the orders already executed, still to be processed.
    follows: VecDeque<Event>,
    /// Clock for latency measurements, ns; constant if the run is not measured.
    clock_ns: fn() -> u64,
}

#[derive(Default)]
struct RobotProcess {
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

impl RobotProcess {
    /// Returns the control cycle and the first tick of a robot that takes part; otherwise `None`.
    fn taking_part(&mut self) -> Option<(&mut ControlCycle, u64)> {
        self.cycle.as_mut().zip(self.member_since)
    }
}

impl<F: Fn(&AgentBrief, u64) -> Controller> InProcess<F> {
    /// Creates the run at the start, before the first sample, without records. Fails if the scenario needs separate
    /// processes.
    pub fn new(scenario: Scenario, think: F) -> Result<InProcess<F>, NotInProcess> {
        InProcess::with_journal(scenario, think, ())
    }
}

impl<F: Fn(&AgentBrief, u64) -> Controller, J: Records> InProcess<F, J> {
    /// Creates the run at the start, before the first sample. Its records go to `journal`. Fails if the scenario
    /// needs separate processes.
    pub fn with_journal(
        scenario: Scenario,
        think: F,
        journal: J,
    ) -> Result<InProcess<F, J>, NotInProcess> {
        if scenario.plant.is_some() {
            return Err(NotInProcess::PlantProgram);
        }
        if scenario.faults.iter().any(|fault| fault.kind == FaultKind::KillPlant) {
            return Err(NotInProcess::KillsThePlant);
        }
        let plant = briefs::plant(&scenario, Pace::Lockstep, "/nowhere".as_ref());
        let agents: Vec<AgentBrief> = agents(&scenario).collect();
        let cycle = |brief: &AgentBrief| ControlCycle::new(brief.clone(), think(brief, 0), 0);
        let robot = |brief| RobotProcess { cycle: Some(cycle(brief)), ..RobotProcess::default() };
        let robots: Vec<RobotProcess> = agents.iter().map(robot).collect();
        Ok(InProcess {
            plant: SimulationStepper::new(&plant, Unicycles::new(&plant)),
            ticks: plant.duration_ns / plant.period_ns,
            beacons: vec![None; robots.len()],
            commands: Vec::with_capacity(robots.len()),
            course: Course::new(&scenario, false, journal),
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
    pub fn alive_robots(&self) -> &[bool] {
        self.course.lifecycles().alive_robots()
    }

    /// Returns whether this robot is dead and no restart is planned or in progress.
    pub fn is_gone(&self, robot: usize) -> bool {
        let lifecycles = self.course.lifecycles();
        lifecycles.process_state(robot) == ProcessState::Down && !lifecycles.will_be_replaced(robot)
    }

    /// Returns what the control law of this robot sees at the current tick, after [`Self::sense`]. `None`
    /// if the robot has no reference to track, or does not take part.
    pub fn situation(&self, robot: usize) -> Option<Situation<'_>> {
        let RobotProcess { cycle, member_since, .. } = &self.robots[robot];
        cycle.as_ref().zip(*member_since)?.0.controller().situation()
    }

    /// Executes the kills, freezes and restarts of this tick; then lets all robots that take part sense, and receive
    /// the beacons of the previous tick.
    pub fn sense(&mut self) {
        self.act();
        let InProcess { robots, plant, agents, beacons, clock_ns, .. } = self;
        for (place, robot) in robots.iter_mut().enumerate() {
            let Some((cycle, member_since)) = robot.taking_part() else { continue };
            let odometry = plant.sense(place, clock_ns());
            // Only from robots that take part; backup neighbors count while their edge is open.
            let heard = agents[place].senders().enumerate().filter_map(|(place, sender)| {
                let Broadcast { beacon, message } = beacons[sender.index - 1].clone()?;
                let delivery = control_cycle::Delivery { place, beacon, message, received_ns: 0 };
                Some(Ok::<_, Infallible>(delivery))
            });
            let Ok(()) = cycle.sense(Inbox {
                received_ns: clock_ns(),
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
                beacons[place] = answer.outgoing_broadcast();
                let command = answer.command;
                commands.push(Delivery {
                    robot: place,
                    command,
                    received_ns: sent_ns,
                    is_retired: false,
                });
            }
            robot.reports = outbox.report;
        }
        let passed: Result<(), StepError> = plant.step(commands.drain(..).map(Ok), *clock_ns);
        passed.expect("unicycles do not fail");
    }

    /// Handles the planned events of the current tick, and all that follow from them.
    fn act(&mut self) {
        let now_ns = self.world().t_ns();
        if self.tick() == 0 {
            for robot in 0..self.robots.len() {
                self.handle(Event::Reported { robot, takes_part: true });
            }
        }
        while let Some(orders) = self.course.handle_planned(now_ns) {
            self.execute(orders);
        }
        while !self.course.lifecycles().is_at_rest(now_ns) {
            self.handle(Event::Due);
            while let Some(event) = self.follows.pop_front() {
                self.handle(event);
            }
        }
    }

    /// Handles an event, and executes the orders that follow from it.
    fn handle(&mut self, event: Event) {
        let orders = self.course.handle(self.world().t_ns(), event);
        self.execute(orders);
    }

    /// Executes orders. No load is started, because there are no processes that it could slow down.
    fn execute(&mut self, orders: Vec<Order>) {
        let now_ns = self.world().t_ns();
        for order in orders {
            match order {
                Order::Start { robot, incarnation } => {
                    let brief = &self.agents[robot];
                    let controller = (self.think)(brief, incarnation);
                    self.robots[robot].cycle =
                        Some(ControlCycle::new(brief.clone(), controller, now_ns));
                    self.follows.push_back(Event::Reported { robot, takes_part: true });
                }
                Order::Kill(robot) => {
                    self.robots[robot].cycle = None;
                    self.follows.push_back(Event::Died(Death {
                        robot,
                        cause: KILLED_CAUSE.into(),
                        success: false,
                        gave_up: false,
                        starting_up: false,
                        alive_ns: 0,
                        fault: 0,
                    }));
                }
                Order::CleanUp(robot) => self.follows.push_back(Event::Cleaned { robot }),
                Order::Join(robot) => self.robots[robot].member_since = Some(self.tick()),
                Order::Leave(robot) => {
                    self.robots[robot].member_since = None;
                    self.beacons[robot] = None;
                }
                Order::StartLoad { fault, .. } => {
                    self.handle(Event::LoadStarted { fault, detail: "0 processes".into() });
                }
                // A robot that left the barrier stands still.
                Order::Stop(_) | Order::GoOn(_) | Order::EndLoad { .. } => {}
                Order::KillPlant => unreachable!("a scenario that kills the plant is rejected"),
                Order::TellLinks(_) | Order::WarnOfDeath { .. } | Order::EndRun { .. } => {
                    unreachable!("no link is cut by hand, and no robot dies without a plan")
                }
            }
        }
    }
}

/// Returns the brief of each robot, in scenario order.
pub fn agents(scenario: &Scenario) -> impl Iterator<Item = AgentBrief> {
    let robots = 0..scenario.robots.len();
    robots.map(|i| briefs::agent(scenario, i, Pace::Lockstep, "/nowhere".as_ref()))
}
