//! A run in lockstep within one process: the brains and the world of a run's processes, tick by tick. What
//! it comes to is what the processes come to, bit by bit: the tests hold that. For training, for
//! foretelling, and for campaigns of many runs; it is no deployment, for nobody here can be late, lost or
//! killed but by the plan.
//!
//! What a kill or a freeze leads to is said by the supervisor's own tables, `supervisor::timeline` and
//! `supervisor::run::lives`. `measured` is a whole run, written down as one of processes is.

pub mod measured;

use std::collections::VecDeque;

use agent::brain::Brain;
use agent::laws::{Situation, Wish};
use experiment::briefs;
use experiment::scenario::Scenario;
use outcome::metrics::fault::End;
use plant::world::World;
use protocol::brief::{AgentBrief, Pace};
use protocol::message::Beacon;
pub use supervisor::run::lives::Effect;
use supervisor::run::lives::{Death, Event, Lives, Seat, Who};
use supervisor::timeline::{Act, Due, Timeline};

/// How a process ends that is killed.
const KILLED: &str = "signal 9";

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
    timeline: Timeline,
    lives: Lives,
    /// What follows on what was done, and is yet to happen.
    follows: VecDeque<Event>,
}

struct Robot {
    /// None while it is dead.
    brain: Option<Brain>,
    /// The world waits for it.
    member: bool,
    /// The first tick since it was started, or went on after a freeze.
    first_tick: u64,
}

impl Robot {
    /// Its brain, if it takes part.
    fn taking_part(&mut self) -> Option<&mut Brain> {
        self.brain.as_mut().filter(|_| self.member)
    }
}

impl<F: Fn(&AgentBrief, u64) -> Brain> InProcess<F> {
    /// Everybody at the start, before the first sample.
    pub fn new(scenario: Scenario, think: F) -> InProcess<F> {
        let nowhere = "/nowhere".as_ref();
        let plant = briefs::plant(&scenario, Pace::Lockstep, nowhere);
        let agents: Vec<AgentBrief> = agents(&scenario).collect();
        let robot = |brief| Robot { brain: Some(think(brief, 0)), member: false, first_tick: 0 };
        let robots: Vec<Robot> = agents.iter().map(robot).collect();
        let policies = scenario.robots.iter().map(|robot| robot.restart);
        let hearers = scenario.graph.edges().iter().map(|edge| edge.to);
        InProcess {
            period_ns: plant.period_ns,
            ticks: plant.duration_ns / plant.period_ns,
            tick: 0,
            world: World::new(&plant),
            beacons: vec![None; robots.len()],
            timeline: Timeline::new(&scenario),
            lives: Lives::new(policies, hearers, false),
            follows: VecDeque::new(),
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
        let robot = &self.robots[robot];
        robot.brain.as_ref().filter(|_| robot.member)?.situation()
    }

    /// The tick's kills, freezes and restarts happen, and `told` is told of all that follows; then all that
    /// take part sense, and hear what was said at the tick before.
    pub fn sense(&mut self, told: impl FnMut(&Effect)) {
        self.act(told);
        self.world.take_due();
        for robot in 0..self.robots.len() {
            self.sense_one(robot, || {});
        }
    }

    /// All that take part answer the tick at hand by what `wish` says, of a robot by its place and brain; a
    /// period passes.
    pub fn step(&mut self, mut wish: impl FnMut(usize, &mut Brain) -> Wish) {
        for robot in 0..self.robots.len() {
            self.answer_one(robot, |brain| wish(robot, brain));
        }
        self.pass();
    }

    /// What the plan does to processes at the tick at hand, and what follows from it. What takes processor
    /// time, or kills the plant, does nothing here.
    fn act(&mut self, mut told: impl FnMut(&Effect)) {
        let now_ns = self.tick * self.period_ns;
        if self.tick == 0 {
            for robot in 0..self.robots.len() {
                self.happens(Event::Reported { robot, takes_part: true }, &mut told);
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
                Act::KillPlant => continue,
                Act::StartLoad { .. } => {
                    told(&Effect::Began(fault));
                    continue;
                }
                Act::EndLoad => {
                    told(&Effect::Ended { fault, end: End::Whole, at_ns: now_ns });
                    continue;
                }
            };
            self.happens(event, &mut told);
        }
        while !self.lives.at_rest(now_ns) {
            self.happens(Event::Due, &mut told);
            while let Some(event) = self.follows.pop_front() {
                self.happens(event, &mut told);
            }
        }
    }

    /// Lets something happen to a robot, and does what follows from it.
    fn happens(&mut self, event: Event, told: &mut impl FnMut(&Effect)) {
        for effect in self.lives.step(self.tick * self.period_ns, event) {
            match effect {
                Effect::Start { robot, incarnation } => {
                    self.robots[robot].brain = Some((self.think)(&self.agents[robot], incarnation));
                    self.follows.push_back(Event::Reported { robot, takes_part: true });
                }
                Effect::Kill(robot) => {
                    self.robots[robot].brain = None;
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
                Effect::Join(robot) => {
                    self.robots[robot].member = true;
                    self.robots[robot].first_tick = self.tick;
                }
                Effect::Leave(robot) => {
                    self.robots[robot].member = false;
                    self.beacons[robot] = None;
                }
                _ => {}
            }
            told(&effect);
        }
    }

    /// This robot senses, and hears what was said at the tick before; whether it takes part. `sampled` is
    /// called between the two.
    fn sense_one(&mut self, robot: usize, sampled: impl FnOnce()) -> bool {
        let Robot { first_tick, .. } = self.robots[robot];
        let Some(brain) = self.robots[robot].taking_part() else { return false };
        let odometry = self.world.odometry(robot);
        sampled();
        if self.tick > first_tick {
            for (place, neighbor) in self.agents[robot].neighbors.iter().enumerate() {
                // Of the tick before, from a robot that still takes part.
                if let Some(beacon) = &self.beacons[neighbor.index - 1] {
                    let _ = brain.hear(place, beacon, odometry.stamp_ns);
                }
            }
        }
        brain.sense(&odometry);
        true
    }

    /// This robot answers the tick at hand by what `wish` says, once everybody has sensed; whether it does so
    /// in time.
    fn answer_one(&mut self, robot: usize, wish: impl FnOnce(&mut Brain) -> Wish) -> bool {
        self.beacons[robot] = None;
        let Some(brain) = self.robots[robot].taking_part() else { return false };
        let wish = wish(brain);
        let answer = brain.act(wish, self.tick * self.period_ns);
        // An answer that takes a period or more is dead before it is sent.
        let Some(answer) = answer.filter(|answer| answer.delay_ns < self.period_ns) else {
            return false;
        };
        // What the plant refuses it counts.
        let _ = self.world.take(robot, &answer.command);
        self.beacons[robot] = Some(answer.beacon);
        true
    }

    /// A period passes.
    fn pass(&mut self) {
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
