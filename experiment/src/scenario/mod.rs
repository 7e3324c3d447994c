//! One experiment, read from a TOML file and known to be sound.
//!
//! | file | question it answers |
//! |---|---|
//! | `keys` | THE table: which keys are there, of which type, unit, range and default? |
//! | `read` | what does the text say, and where does it go wrong? |
//! | `laws` `program` | which laws are in programs of the scenario's own, and which files are these made of? |
//! | `robots` `graph` `lead` `scale` `walls` `faults` `expect` | the same for one kind of table each |
//! | `models` | which robots can one buy, and what can they do? |
//! | `deputies` | who leads in the main leader's place? |
//! | `spares` | by whom does a robot go in place of those it has lost for long? |
//! | `import/` | which robots and edges does a graph of another tool hold? |
//! | `file` | how is a file's text had, and when is it refused? |
//! | `table` | is a value what its key takes, and where does it stand? |
//! | `overrides` | what do `--set`, `--fault` and `--seed` change? |
//! | `diagnostic` | how is a mistake shown: file, line, column, snippet, value, expectation? |
//! | `../check` | does it make sense: graph, offsets, distances, speeds? |
//! | `fault` | what breaks when, and how is that written on the command line? |
//! | `restart` | does a robot come back after a death that nobody planned? |
//! | `chaos` | which faults does a seed draw? |
//! | `lives` | who is alive when a fault is to happen? |
//! | `hunt` | what may `phalanx hunt` vary, and within which bounds? |

mod chaos;
mod deputies;
pub mod diagnostic;
mod expect;
pub mod fault;
mod faults;
pub mod file;
mod graph;
pub mod hunt;
mod import;
pub mod keys;
pub mod laws;
mod lead;
mod lives;
pub mod models;
mod overrides;
pub mod program;
pub mod read;
mod restart;
mod robots;
mod scale;
#[cfg(test)]
mod shaken;
mod spares;
pub mod table;
#[cfg(test)]
mod tests;
mod walls;

use std::collections::BTreeMap;

pub use deputies::Succession;
pub use restart::{AfterDeath, RestartPolicy, RestartWhen};
pub use spares::{Repaired, Substitutes};

use laws::ProgramLaw;
use program::Program;

use formation::Vec2;
use formation::graph::{Edge, FormationGraph};
use formation::obstacle::{Obstacle, Obstacles};
use formation::pose::Pose;
use formation::ramp::Ramp;
use formation::reachability::Reachability;
use formation::scale::Scale;
use formation::seconds;
use protocol::avoidance::{AvoidanceDescription, Conditions, Promise};
use protocol::brief::{
    AvoidanceBrief, LeadBrief, LimitsBrief, Pace, PublishedVelocity, Rank, SilenceBrief,
    WheelsBrief,
};
use protocol::fault::{Lie, LinkFaultKind, Sensor, SensorFaultKind, Span, Stream, WheelFaultKind};
use protocol::law::{LIARS_MAX, Reference, Role};
use serde::Deserialize;

/// One experiment. Robots are numbered by their place in the file, from 0.
#[derive(Debug, Clone, PartialEq)]
pub struct Scenario {
    /// Its name.
    pub name: String,
    /// How long it runs, ns.
    pub duration_ns: u64,
    /// It ends before that once all living errors have been below `converged_error_m` for so long, ns, and
    /// nothing of the plan is to come, see [`Scenario::plan_over_ns`].
    pub end_after_converged_ns: Option<u64>,
    /// T: one command per robot and period, ns.
    pub period_ns: u64,
    /// T_p: the plant's tick in real time, ns.
    pub plant_tick_ns: u64,
    /// L: latency from odometry to command that real time allows for, ns.
    pub latency_allowed_ns: u64,
    /// How much later a sample may come because it goes from host to host, ns: as the fleet
    /// file of a run on several says.
    pub between_hosts_ns: u64,
    /// h: for how many periods a command may be held in real time.
    pub hold_periods: u32,
    /// In real time, whether a process with the robots' timer and nothing else runs beside them.
    pub control_timer: bool,
    /// A process that owes the others an answer in lockstep for this long is hung, ns: processor time
    /// that it uses meanwhile, or wall time while it is blocked.
    pub hung_after_ns: u64,
    /// How long a robot's process may take to start, ns of its own time.
    pub ready_after_ns: u64,
    /// A process that somebody else stopped ends a lockstep run after this, ns; without, the run waits.
    pub stopped_after_ns: Option<u64>,
    /// Seed of everything random.
    pub seed: u64,
    /// Rows of `samples.csv` per second of run time and robot.
    pub record_hz: f64,
    /// Which velocity robots publish.
    pub published_velocity: PublishedVelocity,
    /// How robots keep their distance.
    pub method: AvoidanceDescription,
    /// What that rests on. It may hold gains of other methods.
    pub avoidance: AvoidanceBrief,
    /// What silence means.
    pub silence: SilenceBrief,
    /// Laws in programs of its own.
    pub laws: Vec<ProgramLaw>,
    /// What moves the robots, if that is a program of its own.
    pub plant: Option<Program>,
    /// The robots.
    pub robots: Vec<Robot>,
    /// Who hears whom, at which offset (zero where the hearer's law knows no offsets).
    pub graph: FormationGraph,
    /// Who may be heard in place of lost in-neighbours, robot by robot and in order, at the same kind of offset; and
    /// by whom contained robots keep the places of leaders that they take, at offsets that are not zero.
    pub spares: Vec<Edge>,
    /// By whom contained robots go in place of each that they may lose, if that is planned.
    pub substitutes: Vec<Substitutes>,
    /// Who leads in the main leader's place while it is lost, the best rank first.
    pub deputies: Vec<usize>,
    /// Who takes the places of other leaders of a containment while these are lost.
    pub successions: Vec<Succession>,
    /// For how long an in-neighbour is lost before a spare is opened, and heard again before it is closed, ns;
    /// `None`: nothing is repaired.
    pub repair_after_ns: Option<u64>,
    /// Where the main leader goes, if there is one.
    pub lead: Option<LeadBrief>,
    /// delta(t) of a formation that nobody leads; without, always 1.
    pub unled_scale: Option<Scale>,
    /// What stands in their way.
    pub walls: Vec<Wall>,
    /// What breaks, in order of time.
    pub faults: Vec<Fault>,
    /// What must hold for exit code 0.
    pub expect: Expectations,
    /// What may vary when a run is looked for that misses it.
    pub hunt: HuntBounds,
}

/// What a hunt varies.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Varied {
    /// Where robots start.
    Starts,
    /// What breaks.
    Faults,
    /// How late or lost everything is that is sent, over the whole run.
    Delays,
    /// How wrong sensors are, over the whole run.
    Noise,
    /// Gains of laws and of the avoidance method.
    Gains,
}

/// What may vary when a run is looked for that misses an expectation, and within which bounds.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct HuntBounds {
    /// Which of these.
    pub vary: Vec<Varied>,
    /// How many faults there are at most.
    pub faults_max: usize,
    /// Kinds of faults.
    pub kinds: Vec<&'static str>,
    /// Robots that break, by their places.
    pub robots: Vec<usize>,
    /// No fault begins before, ns.
    pub from_ns: u64,
    /// Every fault has ended by then, ns.
    pub until_ns: u64,
    /// Width and height of the box around each robot's own start in which its front point starts, m.
    pub box_m: [f64; 2],
    /// No two front points start nearer to each other, m; or no nearer than in the scenario.
    pub apart_m: f64,
    /// Longest delay, ns.
    pub delay_ns_max: u64,
    /// Largest share of what is sent that is lost.
    pub loss_max: f64,
    /// Largest error of a position, m, and of a heading, rad.
    pub noise_m_max: f64,
    /// The same of a heading, rad.
    pub noise_heading_rad_max: f64,
    /// Gains are those of the scenario times a factor from the first to the second of these.
    pub gain_factors: [f64; 2],
}

/// One robot.
#[derive(Debug, Clone, PartialEq)]
pub struct Robot {
    /// Its name: letters, digits, `-` and `_`.
    pub name: String,
    /// Where it starts.
    pub start: Pose,
    /// ell, m.
    pub front_point_m: f64,
    /// Wheel limits, if any.
    pub wheels: Option<WheelsBrief>,
    /// How far its body reaches from the axle's middle, m, if that is known.
    pub body_radius_m: Option<f64>,
    /// How fast its twist can change; without, at once.
    pub limits: Option<LimitsBrief>,
    /// Where it goes, m, in `map`, if its role goes to a goal.
    pub goal_m: Option<[f64; 2]>,
    /// Name of its control law.
    pub law: String,
    /// What that law makes of it.
    pub role: Role,
    /// The law's gains by key.
    pub gains: BTreeMap<String, f64>,
    /// Whether that law uses the velocities of those heard.
    pub feed_forward: bool,
    /// Bound on each component of what the law adds to that, m/s, if one of its gains is one.
    pub correction_max_m_s: Option<f64>,
    /// What happens when its process dies unasked.
    pub restart: RestartPolicy,
}

impl Robot {
    /// F: how many of those heard it leaves out on either side.
    pub fn liars_max(&self) -> usize {
        self.gains.get(LIARS_MAX).map_or(0, |&liars| liars as usize)
    }
}

/// One convex part of a wall or obstacle.
#[derive(Debug, Clone, PartialEq)]
pub struct Wall {
    /// Of which one it is: `wall 1`, `obstacle 2`.
    pub name: String,
    /// The key that says so: `wall.0`.
    pub path: String,
    /// Where it is.
    pub shape: Obstacle,
}

/// Something that breaks on purpose.
#[derive(Debug, Clone, PartialEq)]
pub struct Fault {
    /// When it begins, ns since the run's start.
    pub at_ns: u64,
    /// How long it lasts, ns; without, to the run's end. A kill has no length.
    pub for_ns: Option<u64>,
    /// What it is.
    pub kind: FaultKind,
}

impl Fault {
    /// When it ends, ns since the run's start; `None` if it lasts to the end.
    pub fn until_ns(&self) -> Option<u64> {
        self.for_ns.map(|for_ns| self.at_ns.saturating_add(for_ns))
    }

    /// When it acts.
    pub fn span(&self) -> Span {
        Span { from_ns: self.at_ns, until_ns: self.until_ns().unwrap_or(Span::END_NS) }
    }
}

/// What breaks.
#[derive(Debug, Clone, PartialEq)]
#[expect(missing_docs, reason = "`robot`, `hearer`: by place; `edge`: by its place in the graph")]
pub enum FaultKind {
    /// SIGKILL of a robot's process. Its replacement is started this long after it, ns; without, the robot
    /// stays dead (its restart policy is for deaths that nobody planned).
    Kill { robot: usize, restart_after_ns: Option<u64> },
    /// SIGKILL of the plant: the run ends.
    KillPlant,
    /// SIGSTOP of a robot's process, and SIGCONT at its end.
    Freeze { robot: usize },
    /// A robot that needs longer to answer, by this, ns.
    Slow { robot: usize, delay_ns: u64 },
    /// A link that loses or delays what it carries.
    Link { edge: usize, kind: LinkFaultKind },
    /// A robot's own stream that loses or delays what it carries.
    Stream { robot: usize, stream: Stream, kind: LinkFaultKind },
    /// A robot whose beacons are false, to this hearer alone; `None`: to all.
    Lie { robot: usize, hearer: Option<usize>, lie: Lie },
    /// A sensor that sees nothing, or not exactly.
    Sensor { robot: usize, sensor: Sensor, kind: SensorFaultKind },
    /// Wheels that are stuck, or slow.
    Wheels { robot: usize, kind: WheelFaultKind },
    /// Hosts, by the names of the fleet file, that cannot hear the others, nor these them.
    Partition { hosts: Vec<String> },
    /// So many processes that take processor time from everybody.
    Load { processes: usize },
}

/// Whom a fault strikes.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Struck {
    /// The robot that falls silent, or stands wrong; `None` if it is no robot.
    pub robot: Option<usize>,
    /// The only robot that cannot hear it; `None`: nobody can.
    pub hearer: Option<usize>,
    /// What nobody hears any more while it lasts.
    pub silenced: Silenced,
    /// It lies: theory does not foretell what becomes of that.
    pub lies: bool,
}

/// What a fault silences.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Silenced {
    /// Nobody.
    #[default]
    Nobody,
    /// A robot.
    Robot(usize),
    /// One edge, by its place in the graph.
    Edge(usize),
}

/// Who shall live at the end of a run.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum AliveAtEnd {
    /// These, by their places.
    Names(Vec<usize>),
    /// At least so many, whoever they are.
    Count(u64),
}

/// What must hold for exit code 0; what is absent is not asked.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Expectations {
    /// No two front points nearer than this at any tick, m.
    pub min_distance_m: Option<f64>,
    /// No front point nearer than this to a wall or obstacle at any tick, m.
    pub min_clearance_m: Option<f64>,
    /// Bound on the distance of contained robots from the leaders' hull over the last 10 %, m.
    pub hull_distance_m_max: Option<f64>,
    /// Bound on the worst living error over the last 10 % of the run, m.
    pub final_error_m_max: Option<f64>,
    /// Bound on the worst living error to the ideal formation over the last 10 % of the run, m.
    pub final_ideal_error_m_max: Option<f64>,
    /// Bound on the main leader's error over the last 10 % of the run, m.
    pub tracking_error_m_max: Option<f64>,
    /// All living errors below `converged_error_m` from then on, s.
    pub converged_by_s: Option<f64>,
    /// The same within this long after each fault's end, s.
    pub recovered_within_s: Option<f64>,
    /// Who shall live at the end; without, whom the plan leaves alive counts in the others.
    pub alive_at_end: Option<AliveAtEnd>,
    /// Bound on deadline misses of all agents (real time only).
    pub deadline_misses_max: Option<u64>,
    /// The exit code that the run itself ends with, where it is not 0.
    pub exit: Option<u8>,
    /// Errors below this count as converged, m.
    pub converged_error_m: f64,
}

impl Scenario {
    /// H: how long after the stamp it answers a command may act, ns.
    ///
    /// Lockstep: T. Real time: T_p + L + h T. And how late faults make odometry and commands.
    pub fn command_lifetime_ns(&self, pace: Pace) -> u64 {
        let in_time_ns = match pace {
            Pace::Lockstep => self.period_ns,
            Pace::Realtime => {
                self.plant_tick_ns
                    + self.latency_allowed_ns
                    + u64::from(self.hold_periods) * self.period_ns
            }
        };
        in_time_ns + self.late_ns(pace)
    }

    /// How much later than without faults, and on one host, a robot's commands may arrive, ns: its odometry
    /// is looked at once a period, its commands once a tick of the plant. The largest of all robots.
    pub fn late_ns(&self, pace: Pace) -> u64 {
        let plant_tick_ns = match pace {
            Pace::Lockstep => self.period_ns,
            Pace::Realtime => self.plant_tick_ns,
        };
        let late_ns = |i: usize, of: Stream, looked_at_ns: u64| {
            let delays_ns = self.faults.iter().filter_map(|fault| match fault.kind {
                FaultKind::Stream {
                    robot,
                    stream,
                    kind: LinkFaultKind::Delay { delay_ns, jitter_ns },
                } if (robot, stream) == (i, of) => Some(delay_ns + jitter_ns),
                _ => None,
            });
            delays_ns.max().unwrap_or(0).div_ceil(looked_at_ns) * looked_at_ns
        };
        let of_robot_ns = |i| {
            late_ns(i, Stream::Odometry, self.period_ns)
                + late_ns(i, Stream::Commands, plant_tick_ns)
        };
        let between_hosts_ns = match pace {
            Pace::Lockstep => 0,
            Pace::Realtime => self.between_hosts_ns.next_multiple_of(self.period_ns),
        };
        between_hosts_ns + (0..self.robots.len()).map(of_robot_ns).max().unwrap_or(0)
    }

    /// What robot `i` runs in place of the built-in agent, if its law is in a program of its own.
    pub fn program(&self, i: usize) -> Option<&Program> {
        let law = self.laws.iter().find(|law| law.name == self.robots[i].law)?;
        Some(&law.program)
    }

    /// All programs that are run.
    pub fn programs(&self) -> impl Iterator<Item = &Program> {
        let followed = |law: &&ProgramLaw| self.robots.iter().any(|robot| robot.law == law.name);
        let laws = self.laws.iter().filter(followed).map(|law| &law.program);
        laws.chain(&self.plant)
    }

    /// The main leader's place, if there is one.
    pub fn leader(&self) -> Option<usize> {
        self.robots.iter().position(|robot| robot.role.leads)
    }

    /// The trajectory of robot `i`, if it follows one: that of the main leader.
    pub fn lead_of(&self, i: usize) -> Option<&LeadBrief> {
        self.lead.as_ref().filter(|_| self.robots[i].role.reference == Reference::Trajectory)
    }

    /// delta(t), whoever leads; `None`: always 1.
    pub fn scale(&self) -> Option<&Scale> {
        self.lead.as_ref().map(|lead| &lead.scale).or(self.unled_scale.as_ref())
    }

    /// The same with this delta(t); `None`: always 1.
    pub(crate) fn scaled(mut self, scale: Option<Scale>) -> Scenario {
        match (&mut self.lead, scale) {
            (Some(lead), scale) => lead.scale = scale.unwrap_or(Scale::ONE),
            (None, scale) => self.unled_scale = scale,
        }
        self
    }

    /// By how much a robot is slow on purpose at most, ns.
    pub fn slow_ns_max(&self, robot: usize) -> u64 {
        let slow = self.faults.iter().filter_map(|fault| match fault.kind {
            FaultKind::Slow { robot: slow, delay_ns } if slow == robot => Some(delay_ns),
            _ => None,
        });
        slow.max().unwrap_or(0)
    }

    /// From when on nothing of the plan is to come, ns: no fault begins or ends (one that lasts to the end of
    /// the run is over when it has begun), the formation neither opens nor closes, the leader is at rest.
    /// `None` where the plan has no end: a leader that never comes to rest, a formation that swings.
    pub fn plan_over_ns(&self) -> Option<u64> {
        let lead_s = match &self.lead {
            Some(lead) => lead.trajectory.at_rest_from_s()?,
            None => 0.0,
        };
        let scale_s = match self.scale() {
            Some(scale) => scale.constant_from_s()?,
            None => 0.0,
        };
        let over = |fault: &Fault| match fault.kind {
            FaultKind::Kill { restart_after_ns, .. } => {
                fault.at_ns.saturating_add(restart_after_ns.unwrap_or(0))
            }
            _ => fault.until_ns().unwrap_or(fault.at_ns),
        };
        let faults_ns = self.faults.iter().map(over).max().unwrap_or(0);
        Some(faults_ns.max((lead_s.max(scale_s) * 1e9).ceil() as u64))
    }

    /// The leaders of a containment: the main one and all that keep a place to it; by their places.
    pub fn leaders(&self) -> Vec<usize> {
        self.places(|role| role.reference != Reference::Middle)
    }

    /// The contained, by their places.
    pub fn contained(&self) -> Vec<usize> {
        self.places(|role| role.reference == Reference::Middle)
    }

    /// Who needs whom, and what a death takes from whom.
    pub fn reachability(&self) -> Reachability {
        self.reachability_of(&self.graph)
    }

    /// The same over edges of another graph.
    pub fn reachability_of(&self, graph: &FormationGraph) -> Reachability {
        let alone = self.places(|role| role.reference == Reference::Goal);
        Reachability::new(graph, self.leader(), &self.contained(), &alone)
    }

    /// Who goes by whom instead once these robots are dead and these edges cut for long enough.
    pub fn repairs(&self, dead: &[usize], cut: &[usize]) -> Vec<Repaired> {
        if self.spares.is_empty() && self.substitutes.is_empty() && self.successions.is_empty() {
            return Vec::new();
        }
        let edges = self.graph.edges();
        let is_lost = |place: usize| dead.contains(&edges[place].from) || cut.contains(&place);
        // Over which spare a living robot is heard, if it is: over none if it is heard anyway.
        let heard = |by: usize, robot: usize| {
            let ends = |edge: &Edge| (edge.from, edge.to) == (by, robot);
            let spare = self.spares.iter().position(ends);
            let silent = || edges.iter().position(ends).is_none_or(is_lost);
            (!dead.contains(&by) && (spare.is_some() || !silent())).then_some(spare)
        };
        let mut lost: Vec<&Edge> = (0..edges.len())
            .filter(|&place| is_lost(place) && !dead.contains(&edges[place].to))
            .map(|place| &edges[place])
            .collect();
        let mut repairs = Vec::new();
        let mut takes = Vec::new();
        lost.retain(|&&Edge { from: instead_of, to: robot, .. }| {
            let succession = self.successions_heard(robot).find(|one| one.leader == instead_of);
            let deputies = succession.iter().flat_map(|one| &one.deputies);
            let mut deputies = deputies.map(|&by| (by, heard(by, robot)));
            match deputies.find(|(by, heard)| *by == robot || heard.is_some()) {
                Some((by, Some(spare))) => {
                    repairs.push(Repaired { robot, by, instead_of, spare });
                }
                Some(_) => takes.push((robot, instead_of)),
                None => {}
            }
            succession.is_none()
        });
        for (place, spare) in self.spares.iter().enumerate() {
            let &Edge { from: by, to: robot, .. } = spare;
            let living = self.is_for_anybody(spare) && !dead.contains(&by);
            if let Some(first) = lost.iter().position(|edge| living && edge.to == robot) {
                let instead_of = lost.remove(first).from;
                repairs.push(Repaired { robot, by, instead_of, spare: Some(place) });
            }
        }
        for &Edge { from: instead_of, to: robot, .. } in lost {
            for &by in self.substitutes_of(robot, instead_of) {
                if let Some(spare) = heard(by, robot) {
                    repairs.push(Repaired { robot, by, instead_of, spare });
                }
            }
        }
        for (robot, instead_of) in takes {
            let spares = self.spares.iter().enumerate();
            let by = spares.filter(|(_, edge)| edge.to == robot && self.is_for_place(edge));
            let by = by.filter(|(_, edge)| !dead.contains(&edge.from)).map(|(place, edge)| {
                Repaired { robot, by: edge.from, instead_of, spare: Some(place) }
            });
            let by: Vec<Repaired> = by.collect();
            if !by.is_empty() {
                repairs.retain(|repaired| repaired.robot != robot);
                repairs.extend(by);
            }
        }
        repairs
    }

    /// The deputies of leaders that a contained robot hears.
    pub fn successions_heard(&self, robot: usize) -> impl Iterator<Item = &Succession> {
        let contained = self.robots[robot].role.reference == Reference::Middle;
        let hears = move |leader| self.graph.incoming_edges(robot).any(|edge| edge.from == leader);
        self.successions.iter().filter(move |one| contained && hears(one.leader))
    }

    /// Whether a contained robot hears this spare to keep the place of a leader that it takes.
    pub fn is_for_place(&self, spare: &Edge) -> bool {
        let contained = self.robots[spare.to].role.reference == Reference::Middle;
        contained && spare.offset_m != Vec2::zeros()
    }

    /// Whether this spare replaces whoever is lost: one that is neither planned, nor a deputy, nor for a place.
    pub fn is_for_anybody(&self, spare: &Edge) -> bool {
        let planned = self.substitutes.iter().any(|planned| planned.robot == spare.to);
        let mut successions = self.successions_heard(spare.to);
        let is_deputy = successions.any(|one| one.deputies.contains(&spare.from));
        !(planned || is_deputy || self.is_for_place(spare))
    }

    /// By whom a contained robot goes in place of this one, as planned; somebody twice counts twice.
    fn substitutes_of(&self, robot: usize, lost: usize) -> &[usize] {
        let mut plans = self.substitutes.iter();
        let plan = plans.find(|planned| (planned.robot, planned.lost) == (robot, lost));
        plan.map_or(&[], |planned| &planned.by)
    }

    /// In place of whom this sender counts for that robot, as planned: once for each entry.
    pub fn replaces(&self, robot: usize, sender: usize) -> impl Iterator<Item = usize> {
        let plans = self.substitutes.iter().filter(move |planned| planned.robot == robot);
        plans.flat_map(move |planned| {
            let times = planned.by.iter().filter(|&&by| by == sender).count();
            std::iter::repeat_n(planned.lost, times)
        })
    }

    /// Which spares stay closed then, as edges of [`Scenario::graph_with_spares`], and over which edges nobody goes any
    /// longer since it takes the place of a leader.
    pub fn closed_spares(&self, dead: &[usize], cut: &[usize]) -> Vec<usize> {
        let open = self.repairs(dead, cut);
        let closed = |place: &usize| open.iter().all(|repaired| repaired.spare != Some(*place));
        let for_place = |place: usize| self.is_for_place(&self.spares[place]);
        let takes = |robot: usize| {
            let mut own = open.iter().filter(|repaired| repaired.robot == robot);
            own.any(|repaired| repaired.spare.is_some_and(for_place))
        };
        let edges = self.graph.edges();
        let left = (0..edges.len()).filter(|&place| takes(edges[place].to));
        let closed = (0..self.spares.len()).filter(closed).map(|place| edges.len() + place);
        left.chain(closed).collect()
    }

    /// The graph with all spares as edges behind its own: everybody who may ever hear somebody.
    pub fn graph_with_spares(&self) -> FormationGraph {
        let edges = self.graph.edges().iter().chain(&self.spares);
        FormationGraph::new(self.robots.len(), edges.copied().collect())
    }

    /// The same with the edges from the deputies to the main leader, which hears them before it leads anew: whose
    /// beacons anybody may open.
    pub fn graph_of_receivers(&self) -> FormationGraph {
        let to_leader = self.deputies.iter().zip(std::iter::repeat(self.leader()));
        let offset_m = Vec2::zeros();
        let to_leader = to_leader.filter_map(|(&from, to)| Some(Edge { from, to: to?, offset_m }));
        let edges = self.graph.edges().iter().chain(&self.spares).copied();
        FormationGraph::new(self.robots.len(), edges.chain(to_leader).collect())
    }

    /// Who leads once these robots are dead and these edges cut for long enough, the best rank first: the main
    /// leader, and each deputy that nobody of a better rank who leads reaches.
    pub fn leading(&self, dead: &[usize], cut: &[usize]) -> Vec<usize> {
        let living = |robot: &usize| !dead.contains(robot);
        let mut leading: Vec<usize> = self.leader().filter(living).into_iter().collect();
        if self.deputies.is_empty() {
            return leading;
        }
        let reachability = self.reachability_of(&self.graph_with_spares());
        let silent = [cut, &self.closed_spares(dead, cut)].concat();
        for &deputy in self.deputies.iter().filter(|deputy| living(deputy)) {
            if !reachability.reached(&leading, dead, &silent)[deputy] {
                leading.push(deputy);
            }
        }
        leading
    }

    /// Where everybody goes, m, in `map`, if they have goals of their own: all do, or nobody.
    pub fn goals_m(&self) -> Option<Vec<Vec2>> {
        self.robots.iter().map(|robot| robot.goal_m.map(Vec2::from)).collect()
    }

    fn places(&self, of: impl Fn(Role) -> bool) -> Vec<usize> {
        (0..self.robots.len()).filter(|&i| of(self.robots[i].role)).collect()
    }

    /// The edges whose offsets mean something: those into robots that keep a place in the
    /// formation.
    pub fn formation_edges(&self) -> impl Iterator<Item = (usize, &Edge)> {
        let edges = self.graph.edges().iter().enumerate();
        edges.filter(|(_, edge)| self.robots[edge.to].role.reference == Reference::Offsets)
    }

    /// The longer of both paces' H, ns: what is safe with it is safe in either.
    pub fn command_lifetime_ns_max(&self) -> u64 {
        self.command_lifetime_ns(Pace::Lockstep).max(self.command_lifetime_ns(Pace::Realtime))
    }

    /// What the method's figures for all robots together follow from: the longer H, the shortest
    /// front point, and the last rank.
    pub fn conditions(&self) -> Conditions<'_> {
        let front_points_m = self.robots.iter().map(|robot| robot.front_point_m);
        Conditions {
            avoidance: &self.avoidance,
            period_s: seconds(self.period_ns),
            lifetime_s: seconds(self.command_lifetime_ns_max()),
            front_point_m: front_points_m.fold(f64::INFINITY, f64::min),
            rank: (0..self.robots.len()).map(|i| self.rank(i)).max().unwrap_or_default(),
        }
    }

    /// The convex parts of all walls and obstacles.
    pub fn obstacles(&self) -> Obstacles {
        let shapes: Vec<Obstacle> = self.walls.iter().map(|wall| wall.shape.clone()).collect();
        Obstacles::new(&shapes)
    }

    /// The first robot whose speed and turn rate change independently, by its name: the guard with
    /// inertia promises nothing then.
    pub fn voids_the_promise(&self) -> Option<&str> {
        let independent =
            |robot: &&Robot| robot.limits.is_some_and(|limits| limits.ramp == Ramp::Independent);
        self.robots.iter().find(independent).map(|robot| robot.name.as_str())
    }

    /// Why the promise of the method does not hold for how these robots move, if it does not.
    pub fn unpromised(&self) -> Option<String> {
        if self.method.promise != Promise::Always {
            return None;
        }
        if let Some(plant) = &self.plant {
            let words = plant.words.join(" ");
            return Some(format!(
                "`{words}` moves the robots, and the {} is proven for another plant",
                self.method.name
            ));
        }
        let name = self.voids_the_promise()?;
        Some(format!("speed and turn rate of {name} change independently"))
    }

    /// Whom robot `i` makes way for.
    pub fn rank(&self, i: usize) -> Rank {
        match self.robots[i].role {
            Role { gives_way: true, .. } => Rank::Contained,
            Role { leads: false, .. } if self.lead.is_some() => Rank::Follower,
            _ => Rank::First,
        }
    }

    /// Within this distance of robot `i`, m, another makes it steer: two that are nearer than the
    /// larger of theirs do not both come to rest. `None` where the method never steers. (Remark 1)
    pub fn steers_within_m(&self, i: usize) -> Option<f64> {
        let (_, distance_m) = self.method.steers_within?;
        Some(distance_m(&Conditions { rank: self.rank(i), ..self.conditions() }))
    }

    /// Nobody farther away than this, m, matters to the method.
    pub fn sensing_radius_needed_m(&self) -> f64 {
        let conditions = self.conditions();
        let front_points_m = self.robots.iter().map(|robot| robot.front_point_m);
        let radii_m = front_points_m.map(|front_point_m| {
            (self.method.sensing_radius_m)(&Conditions { front_point_m, ..conditions })
        });
        radii_m.fold(0.0, f64::max)
    }

    /// Nobody farther away than this, m, makes any difference to the method.
    pub fn sensing_radius_useful_m(&self) -> f64 {
        let useful_m =
            self.method.useful_radius_m.map_or(0.0, |radius_m| radius_m(&self.conditions()));
        useful_m.max(self.sensing_radius_needed_m())
    }
}
