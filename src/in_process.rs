//! A run in lockstep within one process: the turns of its robots and of its world, tick by tick, as its
//! processes take them. What it comes to is what the processes come to, bit by bit: the tests hold that. For
//! training, for foretelling, and for campaigns of many runs; it is no deployment, for nobody here can be
//! late, lost or killed but by the plan.
//!
//! What a kill or a freeze leads to is said by the supervisor's own tables, `supervisor::timeline` and
//! `supervisor::run::lives`. `measured` is a whole run, written down as one of processes is.

// By its path, so that `bindings/web/` finds it too.
#[path = "in_process/measured.rs"]
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
use protocol::message::Beacon;
pub use supervisor::run::lives::Effect;
use supervisor::run::lives::{Death, Event, Lives, Seat, Who};
use supervisor::timeline::{Act, Due, Timeline};

/// How a process ends that is killed.
const KILLED: &str = "signal 9";

/// Why a scenario cannot be run within one process.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
pub enum NotInProcess {
    /// The robots are moved by a program.
    #[error("a program moves the robots ([plant]), and within one process none is started")]
    PlantProgram,
    /// The plant is to be killed.
    #[error("a fault kills the plant, which is no process of its own within one process")]
    KillsThePlant,
}

/// A run under way. `F` makes the controller of a robot's brief and incarnation.
pub struct InProcess<F> {
    scenario: Scenario,
    think: F,
    agents: Vec<AgentBrief>,
    plant: SimulationStepper,
    ticks: u64,
    robots: Vec<Robot>,
    /// What everybody said at the tick before.
    beacons: Vec<Option<Beacon>>,
    /// What everybody answered at the tick at hand.
    commands: Vec<Delivery>,
    timeline: Timeline,
    lives: Lives,
    /// What follows on what was done, and is yet to happen.
    follows: VecDeque<Event>,
    /// The clock by which it is measured how long everything takes; without measuring, it stands.
    clock_ns: fn() -> u64,
}

#[derive(Default)]
struct Robot {
    /// None while it is dead.
    cycle: Option<ControlCycle>,
    /// The first tick that it takes part in, since it was started or went on after a freeze; without, the
    /// world does not wait for it.
    member_since: Option<u64>,
    /// When it had sensed the tick at hand, ns.
    sensed_ns: u64,
    /// It has news for the supervisor.
    reports: bool,
}

impl Robot {
    /// Its turn, and since when it takes part, if it does.
    fn taking_part(&mut self) -> Option<(&mut ControlCycle, u64)> {
        self.cycle.as_mut().zip(self.member_since)
    }
}

impl<F: Fn(&AgentBrief, u64) -> Controller> InProcess<F> {
    /// Everybody at the start, before the first sample. What only processes can do is refused.
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
            lives: Lives::new(policies, hearers, false),
            follows: VecDeque::new(),
            clock_ns: || 0,
            scenario,
            think,
            agents,
            robots,
        })
    }

    /// The tick at hand.
    pub fn tick(&self) -> u64 {
        self.world().tick()
    }

    /// How many there are.
    pub fn ticks(&self) -> u64 {
        self.ticks
    }

    /// Whether the last one has come, which nobody answers.
    pub fn is_over(&self) -> bool {
        self.plant.is_over()
    }

    /// Where everybody is.
    pub fn world(&self) -> &World {
        self.plant.world()
    }

    /// Who is alive, in scenario order.
    pub fn alive(&self) -> &[bool] {
        self.lives.alive()
    }

    /// Whether this robot was killed, and nothing under way brings it back.
    pub fn is_gone(&self, robot: usize) -> bool {
        self.lives.seat(robot) == Seat::Down && !self.lives.returns(robot)
    }

    /// What the law of this robot sees at the tick at hand, once everybody has sensed; `None` for one that
    /// has nothing to go by, or does not take part.
    pub fn situation(&self, robot: usize) -> Option<Situation<'_>> {
        let Robot { cycle, member_since, .. } = &self.robots[robot];
        cycle.as_ref().zip(*member_since)?.0.controller().situation()
    }

    /// The tick's kills, freezes and restarts happen, and `on_effect` hears of all that follows; then all that
    /// take part sense, and hear what was said at the tick before.
    pub fn sense(&mut self, on_effect: impl FnMut(&Effect)) {
        self.act(on_effect);
        let InProcess { robots, plant, agents, beacons, clock_ns, .. } = self;
        for (place, robot) in robots.iter_mut().enumerate() {
            let Some((cycle, member_since)) = robot.taking_part() else { continue };
            let odometry = plant.sense(place, clock_ns());
            // From robots that still take part; of spares, what they say while they are open counts.
            let heard = agents[place].senders().enumerate().filter_map(|(place, sender)| {
                let beacon = beacons[sender.index - 1]?;
                Some(Ok::<_, Infallible>(control_cycle::Delivery { place, beacon, taken_ns: 0 }))
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

    /// All that take part answer the tick at hand by what `wish` says, of a robot by its place and turn; a
    /// period passes.
    pub fn step(&mut self, mut wish: impl FnMut(usize, &mut ControlCycle) -> LawOutput) {
        let InProcess { robots, plant, beacons, commands, clock_ns, .. } = self;
        for (place, robot) in robots.iter_mut().enumerate() {
            let sensed_ns = robot.sensed_ns;
            beacons[place] = None;
            robot.reports = false;
            let Some((cycle, _)) = robot.taking_part() else { continue };
            // While others are at work it is not.
            let idle_ns = clock_ns().saturating_sub(sensed_ns);
            let wish = wish(place, cycle);
            let outbox = cycle.act(wish);
            if let Some(answer) = outbox.answer {
                let sent_ns = clock_ns();
                cycle.record_sent(sent_ns.saturating_sub(idle_ns));
                beacons[place] = Some(answer.beacon);
                let command = answer.command;
                commands.push(Delivery { robot: place, command, taken_ns: sent_ns });
            }
            robot.reports = outbox.report;
        }
        let passed: Result<(), StepError> = plant.step(commands.drain(..).map(Ok), *clock_ns);
        passed.expect("unicycles do not fail");
    }

    /// What the plan does to processes at the tick at hand, and what follows from it. What takes processor
    /// time does nothing here.
    fn act(&mut self, mut on_effect: impl FnMut(&Effect)) {
        let now_ns = self.world().t_ns();
        if self.tick() == 0 {
            for robot in 0..self.robots.len() {
                self.happens(Event::Reported { robot, takes_part: true }, &mut on_effect);
            }
        }
        while let Some(Due { fault, act, .. }) = self.timeline.take_due(now_ns) {
            let who = Who::Plan;
            let event = match act {
                Act::Kill { robot, restart_at_ns } => {
                    Event::Kill { robot, fault, restart_at_ns, who }
                }
                Act::Freeze { robot } => {
                    let ends = self.scenario.faults[fault].for_ns.is_some();
                    Event::Freeze { robot, fault, ends, who }
                }
                Act::Thaw { robot } => Event::Thaw { robot, fault, who },
                Act::KillPlant => unreachable!("it was refused"),
                Act::StartLoad { .. } => {
                    on_effect(&Effect::Began(fault));
                    continue;
                }
                Act::EndLoad => {
                    on_effect(&Effect::Ended { fault, end: End::Whole, at_ns: now_ns });
                    continue;
                }
            };
            self.happens(event, &mut on_effect);
        }
        while !self.lives.at_rest(now_ns) {
            self.happens(Event::Due, &mut on_effect);
            while let Some(event) = self.follows.pop_front() {
                self.happens(event, &mut on_effect);
            }
        }
    }

    /// Lets something happen to a robot, and does what follows from it.
    fn happens(&mut self, event: Event, on_effect: &mut impl FnMut(&Effect)) {
        let now_ns = self.world().t_ns();
        for effect in self.lives.step(now_ns, event) {
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

/// What each robot is told, in scenario order.
pub fn agents(scenario: &Scenario) -> impl Iterator<Item = AgentBrief> {
    let robots = 0..scenario.robots.len();
    robots.map(|i| briefs::agent(scenario, i, Pace::Lockstep, "/nowhere".as_ref()))
}
