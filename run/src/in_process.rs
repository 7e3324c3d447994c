//! A lockstep run within one process: the control cycles of its robots and the simulation steps of its
//! plant, tick by tick, in the same order as in separate processes. Results are bit-identical to those of
//! processes, which tests check. Used for training, for predictions and for campaigns of many runs. It is
//! not a deployment: no robot is late, lost or killed except as planned.
//!
//! This is a driver of a [`RunStateMachine`], which decides what follows from an event, as with processes. `measured`
//! is a complete run, recorded like a run with processes.

pub mod measured;

use std::collections::VecDeque;
use std::convert::Infallible;

use agent::control_cycle::{ControlCycle, Inbox, Outbox, ReceivedBeacon};
use agent::controller::Controller;
use agent::laws::{LawOutput, Situation};
use experiment::briefs;
use experiment::scenario::{FaultKind, Scenario};
use plant::motion::UnicycleMotion;
use plant::simulation_step::{ReceivedCommand, SimulationStepper, StepError};
use plant::world::World;
use protocol::brief::{AgentBrief, Pace};
use protocol::message::Odometry;

use crate::lifecycle::{DriverOrder, LifecycleEvent, ProcessDeath, ProcessState};
use crate::state_machine::{RecordSink, RunStateMachine};

/// Exit cause of a killed process, as text.
const KILLED_CAUSE: &str = "signal 9";

/// Reason why a scenario cannot run within one process.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
pub enum InProcessError {
    /// A program moves the robots.
    #[error(
        "an external program simulates the robots ([plant]), and a run within one process starts no program"
    )]
    PlantProgram,
    /// A fault kills the plant.
    #[error("a fault kills the plant, which has no process in a run within one process")]
    PlantKill,
}

/// Creates the controller of a robot from its brief and incarnation number.
pub type ControllerFactory = Box<dyn Fn(&AgentBrief, u64) -> Controller + Send>;

/// Lockstep run in progress. `J` receives the records; `()` takes none.
pub struct InProcessRun<J = ()> {
    scenario: Scenario,
    create_controller: ControllerFactory,
    agent_briefs: Vec<AgentBrief>,
    plant: SimulationStepper,
    /// Newest odometry of each robot.
    samples: Vec<Odometry>,
    ticks: u64,
    robots: Vec<RobotProcess>,
    /// Indices, from 0, of the robots that each robot receives from: in-neighbors, then spares.
    senders: Vec<Box<[usize]>>,
    /// Messages of each robot at the previous tick.
    previous_outboxes: Vec<Outbox>,
    /// Messages of each robot at the current tick, once it has replied.
    outboxes: Vec<Outbox>,
    state_machine: RunStateMachine<J>,
    /// Events caused by the orders already executed, still to be processed.
    pending_events: VecDeque<LifecycleEvent>,
    /// Clock for latency measurements, ns; constant if the run is not measured.
    clock_ns: fn() -> u64,
    /// Time at which the last robot replied, ns, and the next one begins its control cycle.
    cycle_start_ns: u64,
}

#[derive(Default)]
struct RobotProcess {
    /// Control cycle of the robot; `None` while its process is dead.
    cycle: Option<Box<ControlCycle>>,
    /// First tick at which the robot takes part since its start or thaw; `None` while the plant does not
    /// wait for it.
    member_since_tick: Option<u64>,
}

impl RobotProcess {
    /// Returns whether the robot is alive and the plant waits for it.
    fn takes_part(&self) -> bool {
        self.cycle.is_some() && self.member_since_tick.is_some()
    }

    /// Returns the control cycle and the first tick of a robot that takes part; otherwise `None`.
    fn participating_cycle(&mut self) -> Option<(&mut ControlCycle, u64)> {
        match (&mut self.cycle, self.member_since_tick) {
            (Some(cycle), Some(since_tick)) => Some((&mut **cycle, since_tick)),
            _ => None,
        }
    }
}

impl InProcessRun {
    /// Creates the run at the start, before the first sample, without records. Fails if the scenario needs separate
    /// processes.
    pub fn new(
        scenario: Scenario,
        create_controller: ControllerFactory,
    ) -> Result<InProcessRun, InProcessError> {
        InProcessRun::with_journal(scenario, create_controller, ())
    }
}

impl<J: RecordSink> InProcessRun<J> {
    /// Creates the run at the start, before the first sample. Its records go to `journal`. Fails if the scenario
    /// needs separate processes.
    pub fn with_journal(
        scenario: Scenario,
        create_controller: ControllerFactory,
        journal: J,
    ) -> Result<InProcessRun<J>, InProcessError> {
        if scenario.plant_program.is_some() {
            return Err(InProcessError::PlantProgram);
        }
        if scenario.faults.iter().any(|fault| fault.kind == FaultKind::KillPlant) {
            return Err(InProcessError::PlantKill);
        }
        let plant = briefs::plant_brief(&scenario, Pace::Lockstep, "/nowhere".as_ref());
        let agent_briefs: Vec<AgentBrief> = agent_briefs(&scenario).collect();
        let new_cycle =
            |brief: &AgentBrief| Box::new(ControlCycle::new(create_controller(brief, 0), 0));
        let new_robot =
            |brief| RobotProcess { cycle: Some(new_cycle(brief)), ..RobotProcess::default() };
        let robots: Vec<RobotProcess> = agent_briefs.iter().map(new_robot).collect();
        Ok(InProcessRun {
            plant: SimulationStepper::new(&plant, UnicycleMotion::new(&plant)),
            samples: vec![Odometry::default(); robots.len()],
            ticks: plant.duration_ns / plant.period_ns,
            senders: agent_briefs.iter().map(sender_indices).collect(),
            previous_outboxes: robots.iter().map(|_| Outbox::default()).collect(),
            outboxes: robots.iter().map(|_| Outbox::default()).collect(),
            state_machine: RunStateMachine::new(&scenario, false, journal),
            pending_events: VecDeque::new(),
            clock_ns: || 0,
            cycle_start_ns: 0,
            scenario,
            create_controller,
            agent_briefs,
            robots,
        })
    }

    /// Returns the current tick.
    pub fn current_tick(&self) -> u64 {
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
        self.state_machine.lifecycles().alive_robots()
    }

    /// Returns whether this robot is dead and no restart is planned or in progress.
    pub fn is_permanently_dead(&self, robot: usize) -> bool {
        let lifecycles = self.state_machine.lifecycles();
        lifecycles.process_state(robot) == ProcessState::Dead && !lifecycles.will_be_replaced(robot)
    }

    /// Returns what the control law of this robot sees at the current tick, after [`Self::sense_robots`]. `None`
    /// if the robot has no reference to track, or does not take part.
    pub fn situation(&self, robot: usize) -> Option<Situation<'_>> {
        let RobotProcess { cycle, member_since_tick, .. } = &self.robots[robot];
        cycle.as_ref().zip(*member_since_tick)?.0.controller().situation()
    }

    /// Executes the kills, freezes and restarts of this tick; then lets all robots that take part sense, and receive
    /// the beacons of the previous tick.
    pub fn sense_robots(&mut self) {
        self.begin_tick();
        for robot in 0..self.robots.len() {
            self.sense_robot(robot);
        }
    }

    /// Lets all robots that take part reply to the current tick with the law output that
    /// `compute_law_output` returns for a robot's index and control cycle; then advances the plant by one
    /// period. Must be called after [`Self::sense_robots`].
    pub fn step(
        &mut self,
        mut compute_law_output: impl FnMut(usize, &mut ControlCycle) -> LawOutput,
    ) {
        for robot in 0..self.robots.len() {
            self.answer_robot(robot, &mut compute_law_output);
        }
        self.end_tick();
    }

    /// Advances the run by one period. Equals [`Self::sense_robots`] and [`Self::step`], but each robot replies before
    /// the next one senses, which is faster, and the time that it computes can be measured.
    pub fn advance(
        &mut self,
        mut compute_law_output: impl FnMut(usize, &mut ControlCycle) -> LawOutput,
    ) {
        self.begin_tick();
        for robot in 0..self.robots.len() {
            self.sense_robot(robot);
            self.answer_robot(robot, &mut compute_law_output);
        }
        self.end_tick();
    }

    /// Executes the planned events of the current tick, and writes the odometry of all robots that take part.
    fn begin_tick(&mut self) {
        self.execute_planned_events();
        let InProcessRun { robots, plant, samples, .. } = self;
        for (index, (robot, sample)) in robots.iter().zip(samples).enumerate() {
            if robot.takes_part() {
                plant.sense(index, 0, sample);
            }
        }
        self.cycle_start_ns = (self.clock_ns)();
    }

    /// Lets a robot that takes part sense, and receive the beacons of the previous tick.
    fn sense_robot(&mut self, robot: usize) {
        let InProcessRun { robots, samples, senders, previous_outboxes, .. } = self;
        let Some((cycle, member_since_tick)) = robots[robot].participating_cycle() else { return };
        // Odometry arrives at once. Its latency is recorded all the same: when a batch of measurements is due depends on
        // their number, and so does what a killed robot has not yet sent.
        samples[robot].sent_ns = self.cycle_start_ns;
        // Only from robots that take part; backup neighbors count while their edge is open.
        let beacons = senders[robot].iter().enumerate().filter_map(|(sender_index, &sender)| {
            let broadcast = previous_outboxes[sender].answer.as_ref()?.outgoing_broadcast()?;
            Some(Ok::<_, Infallible>(ReceivedBeacon { sender_index, broadcast, received_ns: 0 }))
        });
        let Ok(()) = cycle.sense(Inbox {
            received_ns: self.cycle_start_ns,
            odometry: Some(&samples[robot]),
            participant_since_tick: member_since_tick,
            beacons,
            link_faults: &[],
            goal: None,
        });
    }

    /// Lets a robot that takes part reply to its sample.
    fn answer_robot(
        &mut self,
        robot: usize,
        compute_law_output: &mut impl FnMut(usize, &mut ControlCycle) -> LawOutput,
    ) {
        let outbox = &mut self.outboxes[robot];
        let Some((cycle, _)) = self.robots[robot].participating_cycle() else {
            (outbox.answer, outbox.status_is_due) = (None, false);
            return;
        };
        let law_output = compute_law_output(robot, cycle);
        cycle.act(law_output, outbox);
        if outbox.answer.is_some() {
            // The control cycle of the next robot begins when that of this one ends.
            self.cycle_start_ns = (self.clock_ns)();
            cycle.record_sent(self.cycle_start_ns);
        }
    }

    /// Advances the plant by one period under the commands of the robots.
    fn end_tick(&mut self) {
        let commands = self.outboxes.iter().enumerate().filter_map(|(robot, outbox)| {
            let command = outbox.answer.as_ref()?.command;
            Some(Ok(ReceivedCommand {
                robot,
                command,
                received_ns: 0,
                is_from_dead_incarnation: false,
            }))
        });
        let result: Result<(), StepError> = self.plant.step(commands, || 0);
        result.expect("unicycles do not fail");
        std::mem::swap(&mut self.previous_outboxes, &mut self.outboxes);
    }

    /// Handles the planned events of the current tick, and all that follow from them.
    fn execute_planned_events(&mut self) {
        let now_ns = self.world().t_ns();
        if self.current_tick() == 0 {
            for robot in 0..self.robots.len() {
                self.handle_event(LifecycleEvent::StatusReported { robot, takes_part: true });
            }
        }
        while let Some(orders) = self.state_machine.handle_planned_event(now_ns) {
            self.execute_orders(orders);
        }
        while !self.state_machine.lifecycles().is_idle(now_ns) {
            self.handle_event(LifecycleEvent::TimePassed);
            while let Some(event) = self.pending_events.pop_front() {
                self.handle_event(event);
            }
        }
    }

    /// Handles an event, and executes the orders that follow from it.
    fn handle_event(&mut self, event: LifecycleEvent) {
        let orders = self.state_machine.handle_event(self.world().t_ns(), event);
        self.execute_orders(orders);
    }

    /// Executes orders. No load is started, because there are no processes that it could slow down.
    fn execute_orders(&mut self, orders: Vec<DriverOrder>) {
        let now_ns = self.world().t_ns();
        for order in orders {
            match order {
                DriverOrder::Start { robot, incarnation } => {
                    let brief = &self.agent_briefs[robot];
                    let controller = (self.create_controller)(brief, incarnation);
                    self.robots[robot].cycle =
                        Some(Box::new(ControlCycle::new(controller, now_ns)));
                    self.pending_events
                        .push_back(LifecycleEvent::StatusReported { robot, takes_part: true });
                }
                DriverOrder::Kill(robot) => {
                    if let Some(cycle) = self.robots[robot].cycle.take() {
                        self.state_machine.record_sent_counts(robot, cycle.sent_counts());
                    }
                    self.pending_events.push_back(LifecycleEvent::ProcessDied(ProcessDeath {
                        robot,
                        cause: KILLED_CAUSE.into(),
                        exited_successfully: false,
                        is_infrastructure_failure: false,
                        is_before_motion: false,
                        last_seen_alive_ns: 0,
                        fault: 0,
                    }));
                }
                DriverOrder::CleanUp(robot) => {
                    self.pending_events.push_back(LifecycleEvent::CleanedUp { robot })
                }
                DriverOrder::JoinBarrier(robot) => {
                    self.robots[robot].member_since_tick = Some(self.current_tick())
                }
                DriverOrder::LeaveBarrier(robot) => {
                    self.robots[robot].member_since_tick = None;
                    self.previous_outboxes[robot].answer = None;
                }
                DriverOrder::StartLoad { fault, .. } => {
                    self.handle_event(LifecycleEvent::LoadStarted {
                        fault,
                        detail: "0 processes".into(),
                    });
                }
                // A robot that left the barrier stands still.
                DriverOrder::Stop(_) | DriverOrder::Resume(_) | DriverOrder::EndLoad { .. } => {}
                DriverOrder::KillPlant => {
                    unreachable!("a scenario that kills the plant is rejected")
                }
                DriverOrder::SendCutLinks(_)
                | DriverOrder::WarnOfDeath { .. }
                | DriverOrder::EndRun { .. } => {
                    unreachable!("no link is cut by hand, and no robot dies without a plan")
                }
            }
        }
    }
}

/// Returns the indices, from 0, of the robots that this one receives from, in the order of its brief.
fn sender_indices(brief: &AgentBrief) -> Box<[usize]> {
    brief.senders().map(|sender| sender.index - 1).collect()
}

/// Returns the brief of each robot, in scenario order.
pub fn agent_briefs(scenario: &Scenario) -> impl Iterator<Item = AgentBrief> {
    let briefs = briefs::AgentBriefs::new(scenario);
    let robots = 0..scenario.robots.len();
    robots.map(move |i| briefs.brief(i, Pace::Lockstep, "/nowhere".as_ref()))
}
