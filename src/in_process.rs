//! A run in lockstep within one process: the brains and the world of a run's processes, tick by tick. What
//! it comes to is what the processes come to, bit by bit: the tests hold that. For training and for
//! foretelling; it is no deployment, for nobody here can be late, lost or killed but by the plan.

use agent::brain::Brain;
use agent::laws::{Situation, Wish};
use experiment::briefs;
use experiment::scenario::{FaultKind, Scenario};
use metrics::fault::End;
use plant::world::World;
use protocol::brief::{AgentBrief, Pace};
use protocol::message::Beacon;

/// A run under way. `F` makes the brain of a robot's brief and incarnation.
pub struct InProcess<F> {
    scenario: Scenario,
    think: F,
    agents: Vec<AgentBrief>,
    period_ns: u64,
    ticks: u64,
    tick: u64,
    world: World,
    robots: Vec<Robot>,
    /// What everybody said at the tick before.
    beacons: Vec<Option<Beacon>>,
}

struct Robot {
    brain: Option<Brain>,
    frozen: bool,
    incarnation: u64,
    /// The first tick since it was started, or went on after a freeze.
    first_tick: u64,
}

impl Robot {
    fn new(brain: Brain, incarnation: u64, first_tick: u64) -> Robot {
        Robot { brain: Some(brain), frozen: false, incarnation, first_tick }
    }

    /// Its brain, if it takes part.
    fn taking_part(&mut self) -> Option<&mut Brain> {
        self.brain.as_mut().filter(|_| !self.frozen)
    }
}

/// What becomes of a fault of the plan that kills or freezes.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Turn {
    /// It strikes.
    Began,
    /// It is over.
    Ended(End),
}

impl<F: Fn(&AgentBrief, u64) -> Brain> InProcess<F> {
    /// Everybody at the start, before the first sample.
    pub fn new(scenario: Scenario, think: F) -> InProcess<F> {
        let nowhere = "/nowhere".as_ref();
        let plant = briefs::plant(&scenario, Pace::Lockstep, nowhere);
        let agents: Vec<AgentBrief> = agents(&scenario).collect();
        let robots: Vec<Robot> =
            agents.iter().map(|brief| Robot::new(think(brief, 0), 0, 0)).collect();
        InProcess {
            period_ns: plant.period_ns,
            ticks: plant.duration_ns / plant.period_ns,
            tick: 0,
            world: World::new(&plant),
            beacons: vec![None; robots.len()],
            scenario,
            think,
            agents,
            robots,
        }
    }

    /// The tick at hand.
    pub fn tick(&self) -> u64 {
        self.tick
    }

    /// How many there are.
    pub fn ticks(&self) -> u64 {
        self.ticks
    }

    /// Whether the last one has come, which nobody answers.
    pub fn is_over(&self) -> bool {
        self.tick >= self.ticks
    }

    /// Where everybody is.
    pub fn world(&self) -> &World {
        &self.world
    }

    /// Who is alive, in scenario order.
    pub fn alive(&self) -> impl Iterator<Item = bool> {
        self.robots.iter().map(|robot| robot.brain.is_some())
    }

    /// What the law of this robot sees at the tick at hand, once everybody has sensed; `None` for one that
    /// has nothing to go by, or does not take part.
    pub fn situation(&self, robot: usize) -> Option<Situation<'_>> {
        let robot = &self.robots[robot];
        robot.brain.as_ref().filter(|_| !robot.frozen)?.situation()
    }

    /// The tick's kills and freezes happen, and `told` is told of them by number and robot; then all that take
    /// part sense, and hear what was said at the tick before.
    pub fn sense(&mut self, mut told: impl FnMut(usize, usize, Turn)) {
        for number in 0..self.scenario.faults.len() {
            self.strike(number, &mut told);
        }
        self.world.take_due();
        for (i, robot) in self.robots.iter_mut().enumerate() {
            let first_tick = robot.first_tick;
            let Some(brain) = robot.taking_part() else { continue };
            let odometry = self.world.odometry(i);
            if self.tick > first_tick {
                for (place, neighbor) in self.agents[i].neighbors.iter().enumerate() {
                    // Of the tick before, from a robot that still takes part.
                    if let Some(beacon) = self.beacons[neighbor.index - 1] {
                        let _ = brain.hear(place, &beacon, odometry.stamp_ns);
                    }
                }
            }
            brain.sense(&odometry);
        }
    }

    /// What a fault of the plan does at the tick at hand to a robot's process. The others act by the briefs,
    /// or not on a simulated time.
    fn strike(&mut self, number: usize, told: &mut impl FnMut(usize, usize, Turn)) {
        let fault = &self.scenario.faults[number];
        let (period_ns, tick) = (self.period_ns, self.tick);
        let now = |t_ns: u64| t_ns.div_ceil(period_ns) == tick;
        let (begins, ends) = (now(fault.at_ns), fault.until_ns().is_some_and(now));
        match fault.kind {
            FaultKind::Kill { robot, restart_after_ns } => {
                if begins {
                    self.robots[robot].brain = None;
                    self.robots[robot].frozen = false;
                    self.beacons[robot] = None;
                    told(number, robot, Turn::Began);
                    if restart_after_ns.is_none() {
                        told(number, robot, Turn::Ended(End::ForGood));
                    }
                }
                if restart_after_ns.is_some_and(|after_ns| now(fault.at_ns + after_ns)) {
                    let incarnation = self.robots[robot].incarnation + 1;
                    let brain = (self.think)(&self.agents[robot], incarnation);
                    self.robots[robot] = Robot::new(brain, incarnation, tick);
                    told(number, robot, Turn::Ended(End::Whole));
                }
            }
            FaultKind::Freeze { robot } => {
                if begins && self.robots[robot].brain.is_some() {
                    self.robots[robot].frozen = true;
                    self.beacons[robot] = None;
                    told(number, robot, Turn::Began);
                }
                if ends && self.robots[robot].frozen {
                    self.robots[robot].frozen = false;
                    self.robots[robot].first_tick = tick;
                    told(number, robot, Turn::Ended(End::Whole));
                }
            }
            _ => {}
        }
    }

    /// All that take part answer the tick at hand by what `wish` says, of a robot by its place and brain; a
    /// period passes.
    pub fn step(&mut self, mut wish: impl FnMut(usize, &mut Brain) -> Wish) {
        let now_ns = self.tick * self.period_ns;
        for (i, robot) in self.robots.iter_mut().enumerate() {
            self.beacons[i] = None;
            let Some(brain) = robot.taking_part() else { continue };
            let wish = wish(i, brain);
            let answer = brain.act(wish, now_ns);
            // An answer that takes a period or more is dead before it is sent.
            let Some(answer) = answer.filter(|answer| answer.delay_ns < self.period_ns) else {
                continue;
            };
            // What the plant refuses it counts.
            let _ = self.world.take(i, &answer.command);
            self.beacons[i] = Some(answer.beacon);
        }
        self.tick += 1;
        self.world.advance(self.tick * self.period_ns);
        self.world.next_tick();
    }
}

/// What each robot is told, in scenario order.
pub fn agents(scenario: &Scenario) -> impl Iterator<Item = AgentBrief> {
    let robots = 0..scenario.robots.len();
    robots.map(|i| briefs::agent(scenario, i, Pace::Lockstep, "/nowhere".as_ref()))
}
