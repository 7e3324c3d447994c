//! A valid experiment, parsed from a TOML file.
//!
//! | file | question it answers |
//! |---|---|
//! | `keys` | which keys are there, with which type, unit, range and default? |
//! | `declare` `fields` | how do the row, the constant and the field of a key follow from one declaration? |
//! | `format` | which columns does a row have, and what is suggested for an unknown key? |
//! | `read` | which scenario does a text describe, and where are its errors? |
//! | `laws` `program` | which control laws are external programs, and which files do these need? |
//! | `metrics` `reduction` | which metrics are computed from signals of the laws? |
//! | `robots` `graph` `lead` `scale` `walls` `faults` `expect` | what is in the tables of this kind? |
//! | `models` | which commercially available robots are known, with which parameters? |
//! | `deputies` | which robots are backup leaders? |
//! | `spares` | which robots are backup neighbors? |
//! | `import/` | which robots and edges does a graph of another tool have? |
//! | `file` | how is a file read, and when is it rejected? |
//! | `table` | does a value have the type and range of its key, and where is it? |
//! | `overrides` | what do `--set`, `--fault` and `--seed` change? |
//! | `diagnostic` | how is an error shown: file, line, column, snippet, value, remedy? |
//! | `../check` | is it valid as a whole: graph, offsets, distances, speeds? |
//! | `fault` | which faults are there, with which syntax on the command line? |
//! | `restart` | is a robot restarted after an unexpected exit? |
//! | `chaos` | which faults does a seed draw? |
//! | `availability` | which robots are alive when a fault starts? |
//! | `hunt` | what does `phalanx hunt` vary, and within which bounds? |

mod availability;
mod chaos;
mod declare;
mod deputies;
pub mod diagnostic;
mod expect;
pub mod fault;
mod faults;
pub mod fields;
pub mod file;
pub mod format;
#[cfg(test)]
mod fuzz;
mod graph;
pub mod hunt;
mod import;
pub mod keys;
pub mod laws;
mod lead;
mod metrics;
pub mod models;
mod overrides;
pub mod program;
pub mod read;
mod reduction;
mod restart;
mod robots;
mod scale;
mod spares;
pub mod table;
#[cfg(test)]
mod tests;
mod walls;

use std::collections::BTreeMap;
use std::ops::{Deref, DerefMut};

pub use metrics::Metric;
pub use reduction::{OverRobots, OverTime};
pub use restart::{DeathReaction, RestartPolicy, RestartWhen};

pub use keys::{RealtimeSettings, Settings};

use laws::ProgramLaw;
use program::Program;

use formation::Vec2;
use formation::drive::{Drive, DriveKind};
use formation::front_point::front_point;
use formation::graph::{Edge, FormationGraph};
use formation::obstacle::{Obstacle, Obstacles};
use formation::pose::Pose;
use formation::ramp::Ramp;
use formation::reachability::Reachability;
use formation::rewiring::{RepairPlan, Rewiring};
use formation::scale::Scale;
use formation::seconds;
use protocol::avoidance::{AvoidanceDescription, Conditions, Promise};
use protocol::brief::{
    AvoidanceBrief, LeadBrief, LimitsBrief, Pace, Rank, SilenceBrief, WheelsBrief,
};
use protocol::fault::{Lie, LinkFaultKind, Sensor, SensorFaultKind, Span, Stream, WheelFaultKind};
use protocol::law::{LIARS_MAX, Reference, Role};
use protocol::law_message::MessageFormat;
use serde::Deserialize;

/// One experiment. The index of a robot is its position in the file, from 0.
#[derive(Debug, Clone, PartialEq)]
pub struct Scenario {
    /// Name of the experiment.
    pub name: String,
    /// Settings that are values of top-level keys of the file. A scenario dereferences to them.
    pub settings: Settings,
    /// Settings of real time.
    pub realtime: RealtimeSettings,
    /// Collision avoidance method.
    pub method: AvoidanceDescription,
    /// Parameters of the avoidance. They may include gains of other methods.
    pub avoidance: AvoidanceBrief,
    /// Communication timeouts and the reaction to them.
    pub silence: SilenceBrief,
    /// Control laws in external programs.
    pub laws: Vec<ProgramLaw>,
    /// External program that simulates the robots. `None`: the built-in plant.
    pub plant: Option<Program>,
    /// All robots, in the order of the file. Indices of robots refer to this list.
    pub robots: Vec<Robot>,
    /// Communication links with their offsets. The offset is zero if the receiver's law uses no offsets.
    pub graph: FormationGraph,
    /// Backup neighbors and backup leaders.
    pub repair: RepairPlan,
    /// Time for which an in-neighbor must be lost before a backup neighbor replaces it, and heard again before it is
    /// restored, ns. `None`: no topology repair.
    pub repair_after_ns: Option<u64>,
    /// Reference trajectory and scale of the main leader, if there is one.
    pub lead: Option<LeadBrief>,
    /// delta(t), scale of a leaderless formation. `None`: constant 1.
    pub unled_scale: Option<Scale>,
    /// Convex parts of walls and obstacles.
    pub walls: Vec<Wall>,
    /// Injected faults, in order of their start times.
    pub faults: Vec<Fault>,
    /// Metrics of the experiment's own, computed from signals of the laws.
    pub metrics: Vec<Metric>,
    /// Acceptance criteria.
    pub expect: Expectations,
    /// Search space of a hunt (falsification).
    pub hunt: HuntBounds,
}

impl Deref for Scenario {
    type Target = Settings;

    fn deref(&self) -> &Settings {
        &self.settings
    }
}

impl DerefMut for Scenario {
    fn deref_mut(&mut self) -> &mut Settings {
        &mut self.settings
    }
}

/// A part of the scenario that a hunt varies.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Varied {
    /// Start poses.
    Starts,
    /// Injected faults.
    Faults,
    /// Delays and losses of all messages, over the whole run.
    Delays,
    /// Errors of all sensors, over the whole run.
    Noise,
    /// Gains of the control laws and of the avoidance method.
    Gains,
}

/// Search space of a hunt: what it varies, and within which bounds.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct HuntBounds {
    /// Varied parts of the scenario.
    pub vary: Vec<Varied>,
    /// Maximum number of faults in a run.
    pub faults_max: usize,
    /// Kinds of faults to inject.
    pub kinds: Vec<&'static str>,
    /// Indices of the robots that faults may affect.
    pub robots: Vec<usize>,
    /// Earliest start time of a fault, ns.
    pub from_ns: u64,
    /// Time by which every fault has ended, ns.
    pub until_ns: u64,
    /// Width and height of the box around each robot's start in the scenario from which the start of its front point is
    /// drawn, m.
    pub box_m: [f64; 2],
    /// Minimum distance of two front points at the start, m, or their distance in the scenario if that is smaller.
    pub separation_min_m: f64,
    /// Maximum delay, ns.
    pub delay_ns_max: u64,
    /// Maximum fraction of the messages that is lost.
    pub loss_max: f64,
    /// Maximum error of a sensed position, m.
    pub noise_m_max: f64,
    /// Maximum error of a sensed heading, rad.
    pub noise_heading_rad_max: f64,
    /// Smallest and largest factor by which the gains of the scenario are multiplied.
    pub gain_factors: [f64; 2],
}

/// Robot of a scenario: start pose, role, control law and body.
#[derive(Debug, Clone, PartialEq)]
pub struct Robot {
    /// Name: letters, digits, `-` and `_`.
    pub name: String,
    /// Start pose.
    pub start: Pose,
    /// ell, distance of the front point ahead of the axle, m; 0 for the axle midpoint.
    pub front_point_m: f64,
    /// Kind of the drive.
    pub drive_kind: DriveKind,
    /// w_max, maximum turn rate, rad/s. `None`: no limit of its own. Never `None` at the axle midpoint.
    pub turn_rate_max_rad_s: Option<f64>,
    /// Wheel limits. `None`: unlimited.
    pub wheels: Option<WheelsBrief>,
    /// Radius of the body around the middle of the axle, m. `None`: unknown.
    pub body_radius_m: Option<f64>,
    /// Inertia: maximum accelerations. `None`: the twist changes instantly.
    pub limits: Option<LimitsBrief>,
    /// Goal of the front point in the frame `map`, m. `None` for robots with other roles.
    pub goal_m: Option<[f64; 2]>,
    /// Heading to which the robot turns at its goal, rad. `None`: any.
    pub goal_heading_rad: Option<f64>,
    /// Name of the robot's control law.
    pub law: String,
    /// Role that the law gives the robot.
    pub role: Role,
    /// Gains of the law, by key.
    pub gains: BTreeMap<String, f64>,
    /// `true` if the law uses the velocities of the in-neighbors.
    pub feed_forward: bool,
    /// Bound on each component of the correction that the law adds to these velocities, m/s. `None`: no gain of the law
    /// is such a bound.
    pub correction_max_m_s: Option<f64>,
    /// Format of the messages of the law; `None` if it sends none.
    pub message: Option<&'static MessageFormat>,
    /// Whether the law may withhold its beacon at a sample.
    pub withholds: bool,
    /// Names of the signals that the law records.
    pub signals: &'static [&'static str],
    /// Formation slot, m, if it is given.
    pub place_m: Option<[f64; 2]>,
    /// Parameters of the law, with any content.
    pub params: toml::Table,
    /// Restart policy for an unexpected exit of the process.
    pub restart: RestartPolicy,
}

impl Robot {
    /// Returns the robot's drive.
    pub fn drive(&self) -> Drive {
        Drive::new(self.drive_kind, self.front_point_m, self.turn_rate_max_rad_s)
    }

    /// Returns F, the number of extreme values that the robot discards on either side (W-MSR). 0 for other laws.
    pub fn liars_max(&self) -> usize {
        self.gains.get(LIARS_MAX).map_or(0, |&liars| liars as usize)
    }
}

/// One convex part of a wall or obstacle.
#[derive(Debug, Clone, PartialEq)]
pub struct Wall {
    /// Name of the wall or obstacle: `wall 1`, `obstacle 2`.
    pub name: String,
    /// Path of the key that defines it: `wall.0`.
    pub path: String,
    /// Shape and position.
    pub shape: Obstacle,
}

/// An injected fault.
#[derive(Debug, Clone, PartialEq)]
pub struct Fault {
    /// Start time, ns since the start of the run.
    pub at_ns: u64,
    /// Duration, ns. `None`: until the end of the run. A kill has no duration.
    pub for_ns: Option<u64>,
    /// Kind of the fault and the affected component.
    pub kind: FaultKind,
}

impl Fault {
    /// Returns the end time, ns since the start of the run, or `None` if the fault lasts until the end of the run.
    pub fn until_ns(&self) -> Option<u64> {
        self.for_ns.map(|for_ns| self.at_ns.saturating_add(for_ns))
    }

    /// Returns the interval in which the fault is active.
    pub fn span(&self) -> Span {
        Span { from_ns: self.at_ns, until_ns: self.until_ns().unwrap_or(Span::END_NS) }
    }
}

/// Kind of a fault and the affected component.
#[derive(Debug, Clone, PartialEq)]
#[expect(
    missing_docs,
    reason = "`robot` and `hearer` are robot indices, `edge` is an index in the graph"
)]
pub enum FaultKind {
    /// SIGKILL of a robot's process. The replacement process starts `restart_after_ns` later. `None`: no restart. The
    /// restart policy of the robot does not apply to planned kills.
    Kill { robot: usize, restart_after_ns: Option<u64> },
    /// SIGKILL of the plant. It ends the run.
    KillPlant,
    /// SIGSTOP of a robot's process, and SIGCONT at the end of the fault.
    Freeze { robot: usize },
    /// A robot whose answers are delayed by `delay_ns`, ns.
    Slow { robot: usize, delay_ns: u64 },
    /// A link that drops or delays messages.
    Link { edge: usize, kind: LinkFaultKind },
    /// A message stream of a robot that drops or delays messages.
    Stream { robot: usize, stream: Stream, kind: LinkFaultKind },
    /// A Byzantine robot: its beacons to `hearer`, or to all out-neighbors if that is `None`, are falsified.
    Lie { robot: usize, hearer: Option<usize>, lie: Lie },
    /// A sensor with a dropout or noise.
    Sensor { robot: usize, sensor: Sensor, kind: SensorFaultKind },
    /// Wheels that are stuck or limited in speed.
    Wheels { robot: usize, kind: WheelFaultKind },
    /// A network partition between these hosts of the fleet and all others.
    Partition { hosts: Vec<String> },
    /// Processes that take CPU time from all others.
    Load { processes: usize },
}

/// Component that a fault affects.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Struck {
    /// Index of the robot that is silenced or disturbed. `None` if the fault affects no robot.
    pub robot: Option<usize>,
    /// Index of the only receiver that is affected. `None`: all receivers are.
    pub hearer: Option<usize>,
    /// Robot or link from which no beacons arrive during the fault.
    pub silenced: Silenced,
    /// `true` for a Byzantine fault. Its effects are not predicted.
    pub lies: bool,
}

/// Source of beacons that a fault silences.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Silenced {
    /// No robot and no link.
    #[default]
    Nobody,
    /// All links of the robot with this index.
    Robot(usize),
    /// The link with this index in the graph.
    Edge(usize),
}

/// Criterion for the robots that are alive at the end of a run.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum AliveAtEnd {
    /// The robots with these indices must be alive.
    Names(Vec<usize>),
    /// Minimum number of robots that must be alive.
    Count(u64),
}

/// Bounds of a metric of the experiment's own.
#[derive(Debug, Clone, PartialEq)]
pub struct MetricBounds {
    /// Name of the metric.
    pub metric: String,
    /// Smallest allowed value.
    pub min: Option<f64>,
    /// Largest allowed value.
    pub max: Option<f64>,
}

/// Acceptance criteria for exit code 0. A criterion that is `None` is not evaluated.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Expectations {
    /// Minimum distance of two front points, at every tick, m.
    pub min_distance_m: Option<f64>,
    /// Minimum distance of a front point from walls and obstacles, at every tick, m.
    pub min_clearance_m: Option<f64>,
    /// Maximum distance of a contained robot from the convex hull of the leaders over the last 10 % of the run, m.
    pub hull_distance_m_max: Option<f64>,
    /// Maximum error of any living robot over the last 10 % of the run, m.
    pub final_error_m_max: Option<f64>,
    /// Maximum distance of any living robot from its slot in the ideal formation over the last 10 % of the run, m.
    pub final_ideal_error_m_max: Option<f64>,
    /// Maximum tracking error of the main leader over the last 10 % of the run, m.
    pub tracking_error_m_max: Option<f64>,
    /// Time from which on the errors of all living robots stay below `converged_error_m`, s.
    pub converged_by_s: Option<f64>,
    /// Maximum time after the end of each fault until the errors of all living robots stay below `converged_error_m`,
    /// s.
    pub recovered_within_s: Option<f64>,
    /// Robots that must be alive at the end. Only they count in the other criteria. `None`: no criterion, and the
    /// robots that no planned fault leaves dead count.
    pub alive_at_end: Option<AliveAtEnd>,
    /// Maximum number of deadline misses of all agents (real time only).
    pub deadline_misses_max: Option<u64>,
    /// Expected exit code of the run itself. `None`: 0.
    pub exit: Option<u8>,
    /// Bounds of metrics of the experiment's own.
    pub metrics: Vec<MetricBounds>,
    /// Threshold below which an error counts as converged, m.
    pub converged_error_m: f64,
}

impl Scenario {
    /// Returns H, the command lifetime, ns: how long after the stamp of the odometry sample that it answers a command
    /// may act.
    ///
    /// Lockstep: T. Real time: T_p + L + h T. Delays of odometry and commands by faults are added.
    pub fn command_lifetime_ns(&self, pace: Pace) -> u64 {
        let in_time_ns = match pace {
            Pace::Lockstep => self.period_ns,
            Pace::Realtime => {
                let RealtimeSettings { plant_tick_ns, latency_allowed_ns, hold_periods, .. } =
                    self.realtime;
                plant_tick_ns + latency_allowed_ns + hold_periods * self.period_ns
            }
        };
        in_time_ns + self.late_ns(pace)
    }

    /// Returns the maximum additional latency of a robot's commands that faults and the network between hosts cause,
    /// ns. It is the maximum over all robots. The robot polls its odometry once per period, the plant its commands once
    /// per tick.
    pub fn late_ns(&self, pace: Pace) -> u64 {
        let plant_tick_ns = match pace {
            Pace::Lockstep => self.period_ns,
            Pace::Realtime => self.realtime.plant_tick_ns,
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
            Pace::Realtime => self.realtime.between_hosts_ns.next_multiple_of(self.period_ns),
        };
        between_hosts_ns + (0..self.robots.len()).map(of_robot_ns).max().unwrap_or(0)
    }

    /// Returns the format of the messages of robot `i`; `None` if its law sends none.
    pub fn message_format(&self, i: usize) -> Option<&'static MessageFormat> {
        self.robots[i].message
    }

    /// Returns whether some law sends messages or withholds beacons, so that the beacons and messages of all robots are
    /// counted.
    pub fn counts_sent(&self) -> bool {
        self.robots.iter().any(|robot| robot.message.is_some() || robot.withholds)
    }

    /// Returns whether some law records signals.
    pub fn has_signals(&self) -> bool {
        self.robots.iter().any(|robot| !robot.signals.is_empty())
    }

    /// Returns the external program that robot `i` runs, or `None` for the built-in agent.
    pub fn program(&self, i: usize) -> Option<&Program> {
        let law = self.laws.iter().find(|law| law.name == self.robots[i].law)?;
        Some(&law.program)
    }

    /// Returns all external programs that the run starts.
    pub fn programs(&self) -> impl Iterator<Item = &Program> {
        let followed = |law: &&ProgramLaw| self.robots.iter().any(|robot| robot.law == law.name);
        let laws = self.laws.iter().filter(followed).map(|law| &law.program);
        laws.chain(&self.plant)
    }

    /// Returns the index of the main leader, or `None` in a leaderless formation.
    pub fn leader(&self) -> Option<usize> {
        self.robots.iter().position(|robot| robot.role.leads)
    }

    /// Returns the reference trajectory of robot `i`, or `None` if it is not the main leader.
    pub fn lead_of(&self, i: usize) -> Option<&LeadBrief> {
        self.lead.as_ref().filter(|_| self.robots[i].role.reference == Reference::Trajectory)
    }

    /// Returns delta(t), the scale of the formation. `None`: constant 1.
    pub fn scale(&self) -> Option<&Scale> {
        self.lead.as_ref().map(|lead| &lead.scale).or(self.unled_scale.as_ref())
    }

    /// Returns the scenario with the scale delta(t) replaced. `None`: constant 1.
    pub(crate) fn with_scale(mut self, scale: Option<Scale>) -> Scenario {
        match (&mut self.lead, scale) {
            (Some(lead), scale) => lead.scale = scale.unwrap_or(Scale::CONSTANT_ONE),
            (None, scale) => self.unled_scale = scale,
        }
        self
    }

    /// Returns the maximum delay of the answers of `robot` by faults, ns.
    pub fn slow_ns_max(&self, robot: usize) -> u64 {
        let slow = self.faults.iter().filter_map(|fault| match fault.kind {
            FaultKind::Slow { robot: slow, delay_ns } if slow == robot => Some(delay_ns),
            _ => None,
        });
        slow.max().unwrap_or(0)
    }

    /// Returns the time after which no planned event is pending, ns: no fault starts or ends, the scale is constant and
    /// the leader is at rest. A fault that lasts until the end of the run counts as over once it has started.
    ///
    /// Returns `None` if the plan never ends, because the leader never comes to rest or the scale oscillates.
    pub fn plan_over_ns(&self) -> Option<u64> {
        let lead_s = match &self.lead {
            Some(lead) => lead.trajectory.rest_start_s()?,
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

    /// Returns the indices of the leaders of a containment: the main leader and all robots that keep a slot.
    pub fn leaders(&self) -> Vec<usize> {
        let heard = self.contained_robots().into_iter().flat_map(|i| self.graph.incoming_edges(i));
        let heard: Vec<usize> = heard.map(|edge| edge.from).collect();
        let mut leaders = self.robots_with_role(|role| role.reference != Reference::Middle);
        // A free robot belongs to the hull only of the robots that hear it.
        leaders.retain(|i| self.robots[*i].role.reference != Reference::Free || heard.contains(i));
        leaders
    }

    /// Returns the indices of the contained robots.
    pub fn contained_robots(&self) -> Vec<usize> {
        self.robots_with_role(|role| role.reference == Reference::Middle)
    }

    /// Returns the reachability analysis of the formation graph.
    pub fn reachability(&self) -> Reachability {
        self.reachability_of(&self.graph)
    }

    /// Returns the reachability analysis of another graph of these robots.
    pub fn reachability_of(&self, graph: &FormationGraph) -> Reachability {
        let alone = self
            .robots_with_role(|role| matches!(role.reference, Reference::Goal | Reference::Free));
        Reachability::new(graph, self.leader(), &self.contained_robots(), &alone)
    }

    /// Returns the references of all robots after failures.
    pub fn rewiring(&self) -> Rewiring {
        let has_offsets = |i: usize| self.robots[i].role.reference != Reference::Middle;
        Rewiring::new(&self.graph, &self.repair, has_offsets)
    }

    /// Returns the graph with the backup links appended: all links that may ever be used.
    pub fn graph_with_spares(&self) -> FormationGraph {
        let edges = self.graph.edges().iter().chain(&self.repair.spares);
        FormationGraph::new(self.robots.len(), edges.copied().collect())
    }

    /// Returns the graph of all beacons that any robot may receive: the links of [`Scenario::graph_with_spares`], and
    /// links from the deputies to the main leader, which listens to them before it leads again after a restart.
    pub fn graph_of_receivers(&self) -> FormationGraph {
        let to_leader = self.repair.deputies.iter().zip(std::iter::repeat(self.leader()));
        let offset_m = Vec2::zeros();
        let to_leader = to_leader.filter_map(|(&from, to)| Some(Edge { from, to: to?, offset_m }));
        let edges = self.graph.edges().iter().chain(&self.repair.spares).copied();
        FormationGraph::new(self.robots.len(), edges.chain(to_leader).collect())
    }

    /// Returns the goals of all robots in the frame `map`, m, or `None` if they have no goals.
    pub fn goals_m(&self) -> Option<Vec<Vec2>> {
        self.robots.iter().map(|robot| robot.goal_m.map(Vec2::from)).collect()
    }

    /// Returns the point that each robot with a goal of its own keeps in the frame `map`, m: its goal, and for a free
    /// robot its start. `None` for all others.
    pub fn anchors_m(&self) -> Vec<Option<Vec2>> {
        let anchor = |robot: &Robot| match robot.role.reference {
            Reference::Goal => robot.goal_m.map(Vec2::from),
            Reference::Free => Some(front_point(robot.start, robot.front_point_m)),
            _ => None,
        };
        self.robots.iter().map(anchor).collect()
    }

    /// Returns whether robot `i` is free: its law alone decides where it goes.
    pub fn is_free(&self, i: usize) -> bool {
        self.robots[i].role.reference == Reference::Free
    }

    /// Returns whether a free robot takes part.
    pub fn has_free_robots(&self) -> bool {
        self.robots.iter().any(|robot| robot.role.reference == Reference::Free)
    }

    /// Returns the graph without the edges into free robots, whose positions depend on no offset.
    pub fn graph_of_offsets(&self) -> FormationGraph {
        let is_free = |i: usize| self.robots[i].role.reference == Reference::Free;
        let edges = self.graph.edges().iter().filter(|edge| !is_free(edge.to));
        FormationGraph::new(self.robots.len(), edges.copied().collect())
    }

    fn robots_with_role(&self, of: impl Fn(Role) -> bool) -> Vec<usize> {
        (0..self.robots.len()).filter(|&i| of(self.robots[i].role)).collect()
    }

    /// Returns the edges whose offsets are used, with their indices: the in-edges of robots that keep a slot.
    pub fn formation_edges(&self) -> impl Iterator<Item = (usize, &Edge)> {
        let edges = self.graph.edges().iter().enumerate();
        edges.filter(|(_, edge)| self.robots[edge.to].role.reference == Reference::Offsets)
    }

    /// Returns the larger H of lockstep and real time, ns. A design that is safe with it is safe in both.
    pub fn command_lifetime_ns_max(&self) -> u64 {
        self.command_lifetime_ns(Pace::Lockstep).max(self.command_lifetime_ns(Pace::Realtime))
    }

    /// Returns the conditions for parameters of the avoidance method that hold for all robots: the larger H, the
    /// smallest distance of a front point above 0, and the lowest rank.
    pub fn conditions(&self) -> Conditions<'_> {
        let front_points_m = self.robots.iter().map(|robot| robot.front_point_m);
        let least_m = front_points_m.filter(|ell_m| *ell_m > 0.0).reduce(f64::min);
        Conditions {
            avoidance: &self.avoidance,
            period_s: seconds(self.period_ns),
            lifetime_s: seconds(self.command_lifetime_ns_max()),
            front_point_m: least_m.unwrap_or(0.0),
            rank: (0..self.robots.len()).map(|i| self.rank(i)).max().unwrap_or_default(),
        }
    }

    /// Returns the convex parts of all walls and obstacles.
    pub fn obstacles(&self) -> Obstacles {
        let shapes: Vec<Obstacle> = self.walls.iter().map(|wall| wall.shape.clone()).collect();
        Obstacles::new(&shapes)
    }

    /// Returns the name of the first robot whose front point has a speed and turn rate that change independently, or
    /// `None`. The guard with inertia guarantees nothing for such a robot. At the axle midpoint they may.
    pub fn first_robot_without_guarantee(&self) -> Option<&str> {
        let independent =
            |robot: &&Robot| robot.limits.is_some_and(|limits| limits.ramp == Ramp::Independent);
        let independent = |robot: &&Robot| !robot.drive().turns_freely() && independent(robot);
        self.robots.iter().find(independent).map(|robot| robot.name.as_str())
    }

    /// Returns the reason why the guarantee of the avoidance method does not hold for these robots, or `None` if it
    /// holds.
    pub fn missing_guarantee(&self) -> Option<String> {
        if self.method.promise != Promise::Always {
            return None;
        }
        if let Some(plant) = &self.plant {
            let words = plant.command_line.join(" ");
            return Some(format!(
                "`{words}` moves the robots, and the {} is proven for another plant",
                self.method.name
            ));
        }
        let name = self.first_robot_without_guarantee()?;
        Some(format!("speed and turn rate of {name} change independently"))
    }

    /// Returns the yield priority of robot `i`.
    pub fn rank(&self, i: usize) -> Rank {
        match self.robots[i].role {
            Role { gives_way: true, .. } => Rank::Contained,
            Role { leads: false, .. } if self.lead.is_some() => Rank::Follower,
            _ => Rank::First,
        }
    }

    /// Returns the distance at which another robot makes robot `i` steer, m. Two robots closer than the larger of their
    /// distances do not both come to rest (Remark 1). Returns `None` if the method does not steer.
    pub fn steers_within_m(&self, i: usize) -> Option<f64> {
        let (_, distance_m) = self.method.steers_within?;
        Some(distance_m(&Conditions { rank: self.rank(i), ..self.conditions() }))
    }

    /// Returns the minimum sensing radius that the method requires, m.
    pub fn sensing_radius_needed_m(&self) -> f64 {
        let conditions = self.conditions();
        let front_points_m = self.robots.iter().map(|robot| robot.front_point_m);
        let radii_m = front_points_m.map(|front_point_m| {
            (self.method.sensing_radius_m)(&Conditions { front_point_m, ..conditions })
        });
        radii_m.fold(0.0, f64::max)
    }

    /// Returns the maximum sensing radius that the method can use, m.
    pub fn sensing_radius_useful_m(&self) -> f64 {
        let useful_m =
            self.method.useful_radius_m.map_or(0.0, |radius_m| radius_m(&self.conditions()));
        useful_m.max(self.sensing_radius_needed_m())
    }
}
