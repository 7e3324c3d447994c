//! Model of the real-time mode in one process: the control cycles of the robots and the simulation steps of the plant,
//! the same functions as in their processes, at times that a seed and an adversary choose (`model/adversary.rs`).
//!
//! - The plant wakes up late, and simulates a step with the commands that have arrived.
//! - An agent wakes up and reads the newest sample, runs a control cycle with it, and sends the answer: three
//!   moments with any delay between them. It may be frozen or killed at each; messages that it has sent still arrive.
//! - Beacons are lost, delayed and reordered.
//!
//! Faults of sensors and wheels are in the plant's brief, as in any run.

mod adversary;
mod bodies;
mod hardship;
mod limits;
mod team;
mod walls;

use std::convert::Infallible;
use std::sync::{Arc, Mutex};

use agent::control_cycle::{ControlCycle, Inbox, ReceivedBeacon};
use agent::controller::Answer;
use experiment::briefs;
use experiment::scenario::Scenario;
use formation::Vec2;
use formation::front_point::front_point;
use formation::obstacle::Obstacles;
use formation::random::SplitMix64;
use plant::motion::UnicycleMotion;
use plant::simulation_step::{self, SimulationStepper, StepError};
use protocol::brief::{AgentBrief, Pace, PlantBrief};
use protocol::law_message::Broadcast;
use protocol::message::{Command, Odometry, TruthHeader, TruthRow};
use protocol::wake::WakeUp;

use adversary::Deceit;
pub use adversary::{ADVERSARIES, Adversary, RequestedVelocity, stay_at};
pub use hardship::{FAULT_PROFILES, FaultProfile};
pub use limits::INERTIAS;

const US: u64 = 1_000;
const MS: u64 = 1_000_000;
/// Stamp of t = 0. Not 0, so that a time used as a stamp by mistake is detected.
const START_NS: u64 = 1_000_000_007;

/// Briefs of the plant and of all agents.
#[derive(Clone)]
pub struct Fleet {
    pub plant: PlantBrief,
    pub agents: Vec<AgentBrief>,
}

impl Fleet {
    pub fn from_scenario(scenario: &Scenario) -> Fleet {
        let run_root = "/nowhere".as_ref();
        let agent = |i| briefs::agent_brief(scenario, i, Pace::Realtime, run_root);
        Fleet {
            plant: briefs::plant_brief(scenario, Pace::Realtime, run_root),
            agents: (0..scenario.robots.len()).map(agent).collect(),
        }
    }
}

/// Parameters of one trial.
#[derive(Debug, Clone, Copy)]
pub struct Trial {
    pub seed: u64,
    pub adversary: Adversary,
    pub requested_velocity: RequestedVelocity,
    pub expiry: Expiry,
    /// Time until which faults happen, ns. After it all robots are resumed or restarted, and no message is late.
    pub hostile_ns: u64,
    pub duration_ns: u64,
}

/// Start of a command's lifetime.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Expiry {
    /// Stamp of the sample that the command answers, which is correct.
    FromSample,
    /// Arrival of the command: a mistake that the tests must find.
    FromArrival,
}

/// Result of a trial.
#[derive(Debug, Clone, Copy)]
pub struct TrialResult {
    pub closest_m: f64,
    /// Smallest margin of the distance of two robots to their minimum distance, m.
    pub margin_m: f64,
    /// Minimum clearance to walls, m. Infinite without walls.
    pub clearance_m: f64,
    pub commands_late: u64,
    pub freezes: u64,
    pub kills: u64,
}

/// Simulates `fleet`. Calls `watch` with every ground-truth sample and the robots that were alive at it.
pub fn simulate(
    fleet: &Fleet,
    trial: Trial,
    mut watch: impl FnMut(&TruthHeader, &[TruthRow], &[bool]),
) -> TrialResult {
    let mut model = Model::new(fleet, trial);
    while model.now_ns < START_NS + trial.duration_ns {
        if model.step() {
            let world = model.plant.world();
            let truth: Vec<TruthRow> = world.truth().collect();
            let alive: Vec<bool> = model.robots.iter().map(|r| r.cycle.is_some()).collect();
            watch(&world.truth_header(), &truth, &alive);
        }
    }
    let header = model.plant.world().truth_header();
    TrialResult {
        closest_m: header.closest_m,
        margin_m: match fleet.plant.robots.iter().any(|body| body.member.is_some()) {
            // The plant also looks between ticks.
            true if header.violations > 0 => model.margin_m.min(-f64::MIN_POSITIVE),
            true => model.margin_m,
            false => header.closest_m - fleet.plant.distance_min_m,
        },
        clearance_m: header.clearance_m,
        commands_late: header.commands_late,
        freezes: model.freezes,
        kills: model.kills,
    }
}

struct Model<'a> {
    fleet: &'a Fleet,
    trial: Trial,
    rng: SplitMix64,
    plant: SimulationStepper,
    obstacles: Obstacles,
    robots: Vec<Robot>,
    now_ns: u64,
    plant_wakes_ns: u64,

    /// Front points at the newest tick, m.
    alphas: Vec<Vec2>,
    /// Front points one tick before, m.
    alphas_before: Vec<Vec2>,
    /// Smallest margin of a pair of a team to its minimum distance, m.
    margin_m: f64,
    freezes: u64,
    kills: u64,
}

/// State of a robot's process, and the messages in transit to and from it.
#[derive(Default)]
struct Robot {
    /// Control cycle of the running process. `None` if the robot is dead.
    cycle: Option<ControlCycle>,
    /// Number of starts.
    starts: u64,
    phase_ns: u64,
    /// Next expiry of the timer, ns.
    due_ns: u64,
    /// Next action. It is delayed while the robot is frozen.
    next: NextAction,
    next_ns: u64,
    frozen_until_ns: u64,
    /// Tick of the newest sample that the robot has read.
    newest_tick: Option<u64>,
    /// Time of the restart of a dead robot, ns.
    starts_ns: Option<u64>,
    /// Distance of another robot at which a freeze ends, m. `None` if the robot is not frozen by an ambush.
    ambush_m: Option<f64>,
    /// `true` if the robot is killed as soon as it has sent.
    kill_after_send: bool,
    /// False input, shared with the robot's control law and avoidance.
    deceit: Arc<Mutex<Deceit>>,
    /// Commands in transit to the plant, with the time of arrival, ns.
    commands: Vec<(u64, Command)>,
    /// Beacons in transit to this robot, read on arrival.
    beacons: Vec<ReceivedBeacon>,
}

#[derive(Default)]
enum NextAction {
    #[default]
    Wake,
    Answer(Box<Odometry>),
    Send(Box<Answer>),
}

impl Robot {
    fn is_frozen(&self, now_ns: u64) -> bool {
        self.cycle.is_some() && self.frozen_until_ns > now_ns
    }

    /// Returns the time of the next action, after the end of a freeze, ns. `None` if the robot is dead.
    fn acts_ns(&self) -> Option<u64> {
        self.cycle.as_ref().map(|_| self.next_ns.max(self.frozen_until_ns))
    }

    /// Runs a control cycle with a sample, if there is one, and the beacons that have arrived by `now_ns`.
    fn run_cycle(&mut self, odometry: Option<&Odometry>, now_ns: u64) -> Option<Answer> {
        self.beacons.sort_by_key(|delivery| delivery.received_ns);
        let arrived = self.beacons.partition_point(|delivery| delivery.received_ns <= now_ns);
        let cycle = self.cycle.as_mut().expect("only a running robot acts");
        let Ok(outbox) = cycle.run(Inbox {
            received_ns: now_ns,
            odometry,
            participant_since_tick: 0,
            beacons: self.beacons.drain(..arrived).map(Ok::<_, Infallible>),
            link_faults: &[],
            goal: None,
        });
        assert!(!outbox.is_plant_silent, "the plant keeps sending samples");
        outbox.answer
    }
}

impl<'a> Model<'a> {
    fn new(fleet: &'a Fleet, trial: Trial) -> Model<'a> {
        let brief = PlantBrief { duration_ns: u64::MAX, ..fleet.plant.clone() };
        let mut plant = SimulationStepper::new(&brief, UnicycleMotion::new(&brief));
        plant.start_at(START_NS);
        let mut model = Model {
            fleet,
            trial,
            rng: SplitMix64::new(trial.seed),
            plant,
            obstacles: Obstacles::new(&fleet.plant.obstacles),
            robots: fleet.agents.iter().map(|_| Robot::default()).collect(),
            now_ns: START_NS,
            plant_wakes_ns: START_NS + fleet.plant.plant_tick_ns,
            alphas: Vec::new(),
            alphas_before: Vec::new(),
            margin_m: f64::INFINITY,
            freezes: 0,
            kills: 0,
        };
        model.record_front_points();
        for i in 0..model.robots.len() {
            model.start(i);
            // The first sample is published once all robots have started.
            model.robots[i].newest_tick = None;
        }
        model
    }

    fn is_hostile(&self) -> bool {
        self.now_ns < START_NS + self.trial.hostile_ns
    }

    /// Simulates the next event. Returns whether it was a tick of the plant.
    fn step(&mut self) -> bool {
        let acts = self.robots.iter().map(Robot::acts_ns).enumerate();
        let first = acts.filter_map(|(i, acts_ns)| acts_ns.map(|acts_ns| (acts_ns, i))).min();
        match first {
            Some((acts_ns, i)) if acts_ns < self.plant_wakes_ns => {
                self.now_ns = acts_ns;
                self.act(i);
                false
            }
            _ => {
                self.now_ns = self.plant_wakes_ns;
                self.tick();
                true
            }
        }
    }

    /// Simulates one tick of the plant, and then the adversary's faults.
    fn tick(&mut self) {
        let (now_ns, expiry) = (self.now_ns, self.trial.expiry);
        let queues = self.robots.iter_mut().enumerate();
        let commands = queues.flat_map(|(robot, Robot { commands, .. })| {
            commands.sort_by_key(|(arrival_ns, _)| *arrival_ns);
            let arrived = commands.partition_point(|(at_ns, _)| *at_ns <= now_ns);
            commands.drain(..arrived).map(move |(arrival_ns, mut command)| {
                if expiry == Expiry::FromArrival {
                    command.stamp_ns = arrival_ns;
                }
                Ok::<_, StepError>(simulation_step::ReceivedCommand {
                    robot,
                    command,
                    received_ns: now_ns,
                    is_from_dead_incarnation: false,
                })
            })
        });
        self.plant.step(commands, || now_ns).expect("the unicycle model does not fail");
        let due_ns = first_after(self.now_ns, self.fleet.plant.plant_tick_ns, START_NS);
        self.plant_wakes_ns = due_ns + self.plant_lateness_ns();
        self.record_front_points();
        for i in 0..self.robots.len() {
            if self.robots[i].starts_ns.is_some_and(|starts_ns| starts_ns <= self.now_ns) {
                self.start(i);
            }
        }
        if self.is_hostile() {
            self.inject_faults();
        } else {
            self.clear_faults();
        }
    }

    fn record_front_points(&mut self) {
        let bodies = self.fleet.plant.robots.iter();
        let points = self.plant.world().truth().zip(bodies);
        let alphas = points.map(|(row, body)| front_point(row.pose(), body.front_point_m));
        let alphas: Vec<Vec2> = alphas.collect();
        self.alphas_before = std::mem::replace(&mut self.alphas, alphas);
        let bodies = &self.fleet.plant.robots;
        let members =
            self.alphas.iter().zip(bodies).filter_map(|(&at, body)| {
                Some((<[f64; 2]>::from(at), body.member.as_ref()?.keep_m))
            });
        let members: Vec<([f64; 2], f64)> = members.collect();
        for (i, &(a, keep_a_m)) in members.iter().enumerate() {
            for &(b, keep_b_m) in &members[..i] {
                let margin_m = distance_m(a, b) - keep_a_m - keep_b_m;
                self.margin_m = self.margin_m.min(margin_m);
            }
        }
    }

    /// Simulates the next action of an agent's loop.
    fn act(&mut self, i: usize) {
        let (period_ns, tick) = (self.fleet.agents[i].period_ns, self.plant.world().tick());
        match std::mem::take(&mut self.robots[i].next) {
            NextAction::Wake => {
                let robot = &mut self.robots[i];
                let lateness_ns = self.now_ns.saturating_sub(robot.due_ns);
                let wake = WakeUp { due_ns: robot.due_ns, lateness_ns };
                let cycle = robot.cycle.as_mut().expect("only a running robot acts");
                cycle.record_wake_up(&wake, robot.frozen_until_ns.min(self.now_ns));
                robot.due_ns = first_after(self.now_ns, period_ns, robot.phase_ns);
                if robot.newest_tick == Some(tick) {
                    robot.run_cycle(None, self.now_ns);
                    robot.next_ns = robot.due_ns;
                    return;
                }
                robot.newest_tick = Some(tick);
                let mut odometry = Box::<Odometry>::default();
                self.plant.sense(i, self.now_ns, &mut odometry);
                robot.next = NextAction::Answer(odometry);
                robot.next_ns = self.now_ns + self.rng.draw_between(5 * US, 100 * US);
            }
            NextAction::Answer(odometry) => {
                let sends_ns = self.answer_takes_until_ns(odometry.stamp_ns);
                self.deceive(i);
                let robot = &mut self.robots[i];
                match robot.run_cycle(Some(&odometry), self.now_ns) {
                    Some(answer) => robot.next = NextAction::Send(Box::new(answer)),
                    // The agent has no position or has overslept: it waits for the next sample.
                    None => return robot.next_ns = self.now_ns.max(robot.due_ns),
                }
                robot.next_ns = sends_ns.max(self.now_ns);
            }
            NextAction::Send(answer) => {
                let arrival_ns = self.now_ns + self.transport_ns();
                let oversleeps_ns = self.oversleeping_ns(period_ns);
                let robot = &mut self.robots[i];
                robot.cycle.as_mut().expect("only a running robot acts").record_sent(self.now_ns);
                robot.commands.push((arrival_ns, answer.command));
                robot.next_ns = self.now_ns.max(robot.due_ns + oversleeps_ns);
                let kill_after_send = robot.kill_after_send;
                if let Some(broadcast) = answer.outgoing_broadcast() {
                    self.send_beacon(i, broadcast);
                }
                if kill_after_send {
                    self.kill(i);
                }
            }
        }
    }

    /// Sends a beacon to all out-neighbors of `i`.
    fn send_beacon(&mut self, i: usize, broadcast: &Broadcast) {
        for (receiver, brief) in self.fleet.agents.iter().enumerate() {
            let sender_index = brief.senders().position(|sender| sender.index == i + 1);
            if let Some(sender_index) = sender_index
                && self.robots[receiver].cycle.is_some()
                && let Some(delay_ns) = self.beacon_delay_ns()
            {
                let received_ns = self.now_ns + delay_ns;
                self.robots[receiver].beacons.push(ReceivedBeacon {
                    sender_index,
                    broadcast: broadcast.clone(),
                    received_ns,
                });
            }
        }
    }

    /// Starts the next incarnation of `i`, which reads the first sample that is published after `now_ns`.
    fn start(&mut self, i: usize) {
        let period_ns = self.fleet.agents[i].period_ns;
        let phase_ns = self.rng.draw_between(0, period_ns - 1);
        let before = std::mem::take(&mut self.robots[i]);
        self.robots[i] = Robot {
            cycle: Some(self.cycle(i, before.starts, &before.deceit)),
            starts: before.starts + 1,
            phase_ns,
            due_ns: first_after(self.now_ns, period_ns, phase_ns),
            next_ns: first_after(self.now_ns, period_ns, phase_ns),
            newest_tick: Some(self.plant.world().tick()),
            deceit: before.deceit,
            commands: before.commands,
            ..Robot::default()
        };
    }
}

/// Returns the distance between two points, m. On plain numbers, because calls into nalgebra are not inlined in tests.
fn distance_m(a: [f64; 2], b: [f64; 2]) -> f64 {
    let (dx_m, dy_m) = (a[0] - b[0], a[1] - b[1]);
    (dx_m * dx_m + dy_m * dy_m).sqrt()
}

/// Returns the first `n * period + phase` later than `now`.
fn first_after(now_ns: u64, period_ns: u64, phase_ns: u64) -> u64 {
    let phase_ns = phase_ns % period_ns;
    (now_ns.saturating_sub(phase_ns) / period_ns + 1) * period_ns + phase_ns
}
