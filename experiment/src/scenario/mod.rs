//! A valid experiment, parsed from a TOML file.
//!
//! | file | question it answers |
//! |---|---|
//! | `keys` | which keys are there, with which type, unit, range and default? |
//! | `declare` `fields` | how do the row, the constant and the field of a key follow from one declaration? |
//! | `format` | which columns does a row have, and what is suggested for an unknown key? |
//! | `read` | which scenario does a text describe, and where are its errors? |
//! | `laws` `program` | which control laws are external programs, and which files do these need? |
//! | `metrics` `reduction` | which metrics are computed from signals of the laws, and which by programs? |
//! | `robots` `graph` `lead` `scale` `walls` `faults` `expect` | what is in the tables of this kind? |
//! | `models` | which commercially available robots are known, with which parameters? |
//! | `team` | which sizes, speeds and command timeouts do robots have, and which does each assume of others? |
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
pub mod team;
#[cfg(test)]
mod tests;
mod walls;

use std::borrow::Cow;
use std::collections::BTreeMap;
use std::ops::{Deref, DerefMut};

pub use graph::DiskGraph;
pub use metrics::{Metric, MetricProgram, MetricSource};
pub use reduction::{RobotReduction, TimeReduction};
pub use restart::{DeathReaction, RestartCondition, RestartPolicy};

pub use keys::{RealtimeSettings, Settings};

use laws::ProgramLaw;
use program::ExternalProgram;

use formation::Vec2;
use formation::drive::{Drive, DriveKind};
use formation::front_point::front_point;
use formation::graph::{Edge, FormationGraph};
use formation::ns_to_seconds;
use formation::obstacle::{Obstacle, Obstacles};
use formation::pose::Pose;
use formation::reachability::Reachability;
use formation::rewiring::{RepairPlan, Rewiring};
use formation::scale::Scale;
use protocol::avoidance::{AvoidanceDescription, DistanceGuarantee, MethodConditions};
use protocol::brief::{
    AccelerationLimitsBrief, AvoidanceBrief, LeadBrief, Pace, RangeBrief, SilenceBrief,
    WheelsBrief, YieldPriority,
};
use protocol::fault::{
    Lie, LinkFaultKind, RobotStream, Sensor, SensorFaultKind, Span, WheelFaultKind,
};
use protocol::law::{LIARS_MAX_KEY, Reference, Role};
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
    pub avoidance_method: AvoidanceDescription,
    /// Parameters of the avoidance. They may include gains of other methods.
    ///
    /// In a team of robots with different sizes or speeds: the largest minimum distance and the highest speed limit.
    pub avoidance: AvoidanceBrief,
    /// Whether robots sense size and speed limit of others.
    pub classes_sensed: bool,
    /// Communication timeouts and the reaction to them.
    pub silence: SilenceBrief,
    /// Control laws in external programs.
    pub laws: Vec<ProgramLaw>,
    /// External program that simulates the robots. `None`: the built-in plant.
    pub plant_program: Option<ExternalProgram>,
    /// All robots, in the order of the file. Indices of robots refer to this list.
    pub robots: Vec<Robot>,
    /// Communication links with their offsets. The offset is zero if the receiver's law uses no offsets.
    pub graph: FormationGraph,
    /// Communication by distance; `None` if all edges of the graph are permanent.
    pub disk_graph: Option<DiskGraph>,
    /// Parameters of links, by sender and receiver; with any content.
    pub edge_params: BTreeMap<[usize; 2], toml::Table>,
    /// Backup neighbors and backup leaders.
    pub repair_plan: RepairPlan,
    /// Time for which an in-neighbor must be lost before a backup neighbor replaces it, and received again before it is
    /// restored, ns. `None`: no topology repair.
    pub repair_after_ns: Option<u64>,
    /// Reference trajectory and scale of the main leader, if there is one.
    pub lead: Option<LeadBrief>,
    /// delta(t), scale of a leaderless formation. `None`: constant 1.
    pub leaderless_scale: Option<Scale>,
    /// Convex parts of walls and obstacles.
    pub walls: Vec<Wall>,
    /// Injected faults, in order of their start times.
    pub faults: Vec<Fault>,
    /// Metrics of the experiment's own, computed from signals of the laws or by programs.
    pub metrics: Vec<Metric>,
    /// Acceptance criteria.
    pub expectations: Expectations,
    /// Search space of a hunt (falsification).
    pub hunt_bounds: HuntBounds,
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
pub enum VariedPart {
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
    pub varied_parts: Vec<VariedPart>,
    /// Maximum number of faults in a run.
    pub faults_max: usize,
    /// Kinds of faults to inject.
    pub fault_kinds: Vec<&'static str>,
    /// Indices of the robots that faults may affect.
    pub robots: Vec<usize>,
    /// Earliest start time of a fault, ns.
    pub earliest_fault_start_ns: u64,
    /// Time by which every fault has ended, ns.
    pub latest_fault_end_ns: u64,
    /// Width and height of the box around each robot's start in the scenario from which the start of its front point is
    /// drawn, m.
    pub start_box_m: [f64; 2],
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
    /// Maximum offset, and maximum random error, of the numbers in a false message, in their units.
    pub message_error_max: f64,
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
    /// w_max, maximum turn rate, rad/s. `None`: no limit of its own. Never `None` at the axle midpoint, except for a
    /// car.
    pub turn_rate_max_rad_s: Option<f64>,
    /// R_min, minimum turning radius of a car, m. `None` for other drives.
    pub turning_radius_min_m: Option<f64>,
    /// Part of the robot in the minimum distances, m: d_ij = keep_i + keep_j.
    pub keep_m: f64,
    /// v_max of the robot, m/s; infinite without a limit.
    pub speed_max_m_s: f64,
    /// h of the robot: number of periods for which the plant may hold its commands, in real time.
    pub hold_periods: u64,
    /// Wheel limits. `None`: unlimited.
    pub wheels: Option<WheelsBrief>,
    /// Radius of the body around the middle of the axle, m. `None`: unknown.
    pub body_radius_m: Option<f64>,
    /// Inertia: maximum accelerations. `None`: the twist changes instantly.
    pub acceleration_limits: Option<AccelerationLimitsBrief>,
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
    pub uses_feed_forward: bool,
    /// Bound on each component of the correction that the law adds to these velocities, m/s. `None`: no gain of the law
    /// is such a bound.
    pub correction_max_m_s: Option<f64>,
    /// Format of the messages of the law; `None` if it sends none.
    pub message_format: Option<&'static MessageFormat>,
    /// Maximum number of messages of an in-neighbor that are kept between two calls of the law; 0 for only the newest.
    pub queued_messages_max: usize,
    /// Whether the law may withhold its beacon at a sample.
    pub withholds_beacons: bool,
    /// Names of the signals that the law records.
    pub signals: &'static [&'static str],
    /// Lowest and highest value of gains of the law that need not be positive, by key.
    pub gain_ranges: &'static [(&'static str, [f64; 2])],
    /// Whether the law takes parameters, its own and those of edges.
    pub takes_params: bool,
    /// Formation slot, m, if it is given.
    pub place_m: Option<[f64; 2]>,
    /// Parameters of the law, with any content.
    pub params: toml::Table,
    /// Restart policy for an unexpected exit of the process.
    pub restart_policy: RestartPolicy,
}

impl Robot {
    /// Returns the robot's drive.
    pub fn drive(&self) -> Drive {
        Drive::new(self.drive_kind, self.front_point_m, self.turn_rate_max_rad_s)
            .with_turning_radius(self.turning_radius_min_m)
    }

    /// Returns F, the number of extreme values that the robot discards on either side (W-MSR). 0 for other laws.
    pub fn liars_max(&self) -> usize {
        self.gains.get(LIARS_MAX_KEY).map_or(0, |&liars| liars as usize)
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
    pub start_ns: u64,
    /// Duration, ns. `None`: until the end of the run. A kill has no duration.
    pub duration_ns: Option<u64>,
    /// Kind of the fault and the affected component.
    pub kind: FaultKind,
}

impl Fault {
    /// Returns the end time, ns since the start of the run, or `None` if the fault lasts until the end of the run.
    pub fn end_ns(&self) -> Option<u64> {
        self.duration_ns.map(|for_ns| self.start_ns.saturating_add(for_ns))
    }

    /// Returns the interval in which the fault is active.
    pub fn span(&self) -> Span {
        Span { from_ns: self.start_ns, until_ns: self.end_ns().unwrap_or(Span::UNBOUNDED_END_NS) }
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
    Slowdown { robot: usize, delay_ns: u64 },
    /// A link that drops or delays messages.
    Link { edge: usize, kind: LinkFaultKind },
    /// A message stream of a robot that drops or delays messages.
    Stream { robot: usize, stream: RobotStream, kind: LinkFaultKind },
    /// A Byzantine robot: its beacons to `receiver`, or to all out-neighbors if that is `None`, are falsified.
    Lie { robot: usize, receiver: Option<usize>, lie: Lie },
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
pub struct AffectedComponent {
    /// Index of the robot that is silenced or disturbed. `None` if the fault affects no robot.
    pub robot: Option<usize>,
    /// Index of the only receiver that is affected. `None`: all receivers are.
    pub receiver: Option<usize>,
    /// Robot or link from which no beacons arrive during the fault.
    pub silenced_source: SilencedSource,
    /// `true` for a Byzantine fault. Its effects are not predicted.
    pub is_byzantine: bool,
}

/// Source of beacons that a fault silences.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum SilencedSource {
    /// No robot and no link.
    #[default]
    NoSource,
    /// All links of the robot with this index.
    Robot(usize),
    /// The link with this index in the graph.
    Edge(usize),
}

/// Criterion for the robots that are alive at the end of a run.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum AliveAtEnd {
    /// The robots with these indices must be alive.
    Robots(Vec<usize>),
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
    /// Minimum distance of two front points over the minimum distance of the two robots, at every tick.
    pub min_distance_over_d: Option<f64>,
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
    pub exit_code: Option<u8>,
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
    /// In a team in which robots have different h it is the longest.
    pub fn command_lifetime_ns(&self, pace: Pace) -> u64 {
        let hold_periods = self.robots.iter().map(|robot| robot.hold_periods).max();
        self.lifetime_ns(pace, hold_periods.unwrap_or(self.realtime.hold_periods))
    }

    /// Returns H of a robot whose commands the plant may hold for `hold_periods`, ns.
    fn lifetime_ns(&self, pace: Pace, hold_periods: u64) -> u64 {
        let in_time_ns = match pace {
            Pace::Lockstep => self.period_ns,
            Pace::Realtime => {
                let RealtimeSettings { plant_tick_ns, latency_allowed_ns, .. } = self.realtime;
                plant_tick_ns + latency_allowed_ns + hold_periods * self.period_ns
            }
        };
        in_time_ns + self.command_delay_ns_max(pace)
    }

    /// Returns the maximum additional latency of a robot's commands that faults and the network between hosts cause,
    /// ns. It is the maximum over all robots. The robot polls its odometry once per period, the plant its commands once
    /// per tick.
    pub fn command_delay_ns_max(&self, pace: Pace) -> u64 {
        let plant_tick_ns = match pace {
            Pace::Lockstep => self.period_ns,
            Pace::Realtime => self.realtime.plant_tick_ns,
        };
        let delays = || {
            self.faults.iter().filter_map(|fault| match fault.kind {
                FaultKind::Stream {
                    robot,
                    stream,
                    kind: LinkFaultKind::Delay { delay_ns, jitter_ns },
                } => Some((robot, stream, delay_ns + jitter_ns)),
                _ => None,
            })
        };
        let delay_ns_of = |i: usize, affected_stream: RobotStream, polling_period_ns: u64| {
            let delays_of_stream =
                delays().filter(|&(robot, stream, _)| (robot, stream) == (i, affected_stream));
            let delay_ns = delays_of_stream.map(|(.., delay_ns)| delay_ns).max().unwrap_or(0);
            delay_ns.next_multiple_of(polling_period_ns)
        };
        let robot_delay_ns = |i| {
            delay_ns_of(i, RobotStream::Odometry, self.period_ns)
                + delay_ns_of(i, RobotStream::Commands, plant_tick_ns)
        };
        let between_hosts_ns = match pace {
            Pace::Lockstep => 0,
            Pace::Realtime => {
                self.realtime.between_hosts_latency_ns.next_multiple_of(self.period_ns)
            }
        };
        between_hosts_ns + delays().map(|(robot, ..)| robot_delay_ns(robot)).max().unwrap_or(0)
    }

    /// Returns the format of the messages of robot `i`; `None` if its law sends none.
    pub fn message_format(&self, i: usize) -> Option<&'static MessageFormat> {
        self.robots[i].message_format
    }

    /// Returns the format of the recorded messages of robot `i`; `None` if its messages are not recorded.
    pub fn recorded_message_format(&self, i: usize) -> Option<&'static MessageFormat> {
        self.message_format(i).filter(|_| self.record_messages)
    }

    /// Returns whether the messages of some law are recorded.
    pub fn has_recorded_messages(&self) -> bool {
        (0..self.robots.len()).any(|i| self.recorded_message_format(i).is_some())
    }

    /// Returns whether some law sends messages or withholds beacons, so that the beacons and messages of all robots are
    /// counted.
    pub fn counts_sent_messages(&self) -> bool {
        self.robots.iter().any(|robot| robot.message_format.is_some() || robot.withholds_beacons)
    }

    /// Returns whether some law records signals.
    pub fn has_signals(&self) -> bool {
        self.robots.iter().any(|robot| !robot.signals.is_empty())
    }

    /// Returns the external program that robot `i` runs, or `None` for the built-in agent.
    pub fn program(&self, i: usize) -> Option<&ExternalProgram> {
        let law = self.laws.iter().find(|law| law.name == self.robots[i].law)?;
        Some(&law.program)
    }

    /// Returns all external programs that the run starts: those of robots, plant and metrics.
    pub fn programs(&self) -> impl Iterator<Item = &ExternalProgram> {
        let metric_programs = self.metric_programs().into_iter().map(|metrics| metrics.program);
        self.process_programs().chain(metric_programs)
    }

    /// Returns the external programs that robots and plant run.
    pub fn process_programs(&self) -> impl Iterator<Item = &ExternalProgram> {
        self.used_program_laws().map(|law| &law.program).chain(&self.plant_program)
    }

    /// Returns the laws of programs that a robot has.
    pub(crate) fn used_program_laws(&self) -> impl Iterator<Item = &ProgramLaw> {
        let is_used = |law: &&ProgramLaw| self.robots.iter().any(|robot| robot.law == law.name);
        self.laws.iter().filter(is_used)
    }

    /// Returns the distances within which this edge of the graph exists; `None` if it is permanent.
    pub fn communication_range(&self, edge: usize) -> Option<RangeBrief> {
        let is_by_distance =
            |disk: &DiskGraph| (disk.first_edge_index..self.graph.edges().len()).contains(&edge);
        self.disk_graph.filter(is_by_distance).map(|disk| disk.range)
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
        self.lead.as_ref().map(|lead| &lead.scale).or(self.leaderless_scale.as_ref())
    }

    /// Returns the scenario with the scale delta(t) replaced. `None`: constant 1.
    pub(crate) fn with_scale(mut self, scale: Option<Scale>) -> Scenario {
        match (&mut self.lead, scale) {
            (Some(lead), scale) => lead.scale = scale.unwrap_or(Scale::CONSTANT_ONE),
            (None, scale) => self.leaderless_scale = scale,
        }
        self
    }

    /// Returns the maximum delay of the answers of `robot` by faults, ns.
    pub fn slow_fault_delay_ns_max(&self, robot: usize) -> u64 {
        let delays = self.faults.iter().filter_map(|fault| match fault.kind {
            FaultKind::Slowdown { robot: slow_robot, delay_ns } if slow_robot == robot => {
                Some(delay_ns)
            }
            _ => None,
        });
        delays.max().unwrap_or(0)
    }

    /// Returns the time after which no planned event is pending, ns: no fault starts or ends, the scale is constant and
    /// the leader is at rest. A fault that lasts until the end of the run counts as over once it has started.
    ///
    /// Returns `None` if the plan never ends, because the leader never comes to rest or the scale oscillates.
    pub fn plan_end_ns(&self) -> Option<u64> {
        let lead_s = match &self.lead {
            Some(lead) => lead.trajectory.rest_start_s()?,
            None => 0.0,
        };
        let scale_s = match self.scale() {
            Some(scale) => scale.constant_start_s()?,
            None => 0.0,
        };
        let end_ns = |fault: &Fault| match fault.kind {
            FaultKind::Kill { restart_after_ns, .. } => {
                fault.start_ns.saturating_add(restart_after_ns.unwrap_or(0))
            }
            _ => fault.end_ns().unwrap_or(fault.start_ns),
        };
        let faults_ns = self.faults.iter().map(end_ns).max().unwrap_or(0);
        Some(faults_ns.max((lead_s.max(scale_s) * 1e9).ceil() as u64))
    }

    /// Returns the indices of the leaders of a containment: the main leader and all robots that keep a slot.
    pub fn leaders(&self) -> Vec<usize> {
        let senders =
            self.contained_robots().into_iter().flat_map(|i| self.graph.incoming_edges(i));
        let senders: Vec<usize> = senders.map(|edge| edge.from).collect();
        let mut leaders = self.robots_with_role(|role| role.reference != Reference::NeighborMean);
        // A free robot belongs only to the hull of the robots that receive from it.
        leaders.retain(|i| {
            self.robots[*i].role.reference != Reference::LawTarget || senders.contains(i)
        });
        leaders
    }

    /// Returns the indices of the contained robots.
    pub fn contained_robots(&self) -> Vec<usize> {
        self.robots_with_role(|role| role.reference == Reference::NeighborMean)
    }

    /// Returns the reachability analysis of the formation graph.
    pub fn reachability(&self) -> Reachability {
        self.reachability_of(&self.graph)
    }

    /// Returns the reachability analysis of another graph of these robots.
    pub fn reachability_of(&self, graph: &FormationGraph) -> Reachability {
        let independent = self.robots_with_role(|role| {
            matches!(role.reference, Reference::Goal | Reference::LawTarget)
        });
        Reachability::new(graph, self.leader(), &self.contained_robots(), &independent)
    }

    /// Returns the references of all robots after failures.
    pub fn rewiring(&self) -> Rewiring {
        let has_offsets = |i: usize| self.robots[i].role.reference != Reference::NeighborMean;
        Rewiring::new(&self.graph, &self.repair_plan, has_offsets)
    }

    /// Returns the graph with the backup links appended: all links that may ever be used.
    pub fn graph_with_spares(&self) -> FormationGraph {
        let edges = self.graph.edges().iter().chain(&self.repair_plan.spares);
        FormationGraph::new(self.robots.len(), edges.copied().collect())
    }

    /// Returns the graph of all beacons that any robot may receive: the links of [`Scenario::graph_with_spares`], and
    /// links from the deputies to the main leader, which listens to them before it leads again after a restart.
    pub fn graph_of_receivers(&self) -> FormationGraph {
        let to_leader = self.repair_plan.deputies.iter().zip(std::iter::repeat(self.leader()));
        let offset_m = Vec2::zeros();
        let to_leader = to_leader.filter_map(|(&from, to)| Some(Edge { from, to: to?, offset_m }));
        let edges = self.graph.edges().iter().chain(&self.repair_plan.spares).copied();
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
            Reference::LawTarget => Some(front_point(robot.start, robot.front_point_m)),
            _ => None,
        };
        self.robots.iter().map(anchor).collect()
    }

    /// Returns whether robot `i` is free: its law alone decides where it goes.
    pub fn is_free(&self, i: usize) -> bool {
        self.robots[i].role.reference == Reference::LawTarget
    }

    /// Returns whether a free robot takes part.
    pub fn has_free_robots(&self) -> bool {
        self.robots.iter().any(|robot| robot.role.reference == Reference::LawTarget)
    }

    /// Returns the graph without the edges into free robots, whose positions depend on no offset.
    pub fn graph_of_offsets(&self) -> FormationGraph {
        let is_free = |i: usize| self.robots[i].role.reference == Reference::LawTarget;
        let edges = self.graph.edges().iter().filter(|edge| !is_free(edge.to));
        FormationGraph::new(self.robots.len(), edges.copied().collect())
    }

    fn robots_with_role(&self, predicate: impl Fn(Role) -> bool) -> Vec<usize> {
        (0..self.robots.len()).filter(|&i| predicate(self.robots[i].role)).collect()
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
    /// smallest distance of a front point above 0, the longer look-ahead of robots that turn first, and the lowest rank.
    pub fn avoidance_conditions(&self) -> MethodConditions<'_> {
        let front_points_m = self.robots.iter().map(|robot| robot.front_point_m);
        let front_point_min_m = front_points_m.filter(|ell_m| *ell_m > 0.0).reduce(f64::min);
        MethodConditions {
            avoidance: &self.avoidance,
            period_s: ns_to_seconds(self.period_ns),
            command_timeout_s: ns_to_seconds(self.command_lifetime_ns_max()),
            front_point_m: front_point_min_m.unwrap_or(0.0),
            moves_along_heading: (self.robots.iter())
                .any(|robot| robot.drive().moves_along_heading()),
            rank: (0..self.robots.len()).map(|i| self.yield_rank(i)).max().unwrap_or_default(),
        }
    }

    /// Returns the convex parts of all walls and obstacles.
    pub fn obstacles(&self) -> Obstacles {
        let shapes: Vec<Obstacle> = self.walls.iter().map(|wall| wall.shape.clone()).collect();
        Obstacles::new(&shapes)
    }

    /// Returns the reason why the guarantee of the avoidance method does not hold for these robots, or `None` if it
    /// holds.
    pub fn missing_guarantee_reason(&self) -> Option<String> {
        if self.avoidance_method.distance_guarantee != DistanceGuarantee::Unconditional {
            return None;
        }
        let command = self.plant_program.as_ref()?.command_line.join(" ");
        Some(format!(
            "`{command}` moves the robots, and the {} is proven for another plant",
            self.avoidance_method.name
        ))
    }

    /// Returns the yield priority of robot `i`.
    pub fn yield_rank(&self, i: usize) -> YieldPriority {
        match self.robots[i].role {
            Role { gives_way: true, .. } => YieldPriority::Contained,
            Role { leads: false, .. } if self.lead.is_some() => YieldPriority::Follower,
            _ => YieldPriority::First,
        }
    }

    /// Returns the distances at which another robot makes each robot steer, m. Two robots closer than the larger of
    /// their distances do not both come to rest (Remark 1). Returns `None` if the method does not steer.
    pub fn steering_distances_m(&self) -> Option<Vec<f64>> {
        let (_, distance_m) = self.avoidance_method.steering_distance?;
        let briefs = self.avoidance_of_all(Pace::Lockstep);
        let distance_m = |(i, avoidance): (usize, &Cow<'_, AvoidanceBrief>)| {
            distance_m(&self.conditions_of(i, avoidance))
        };
        Some(briefs.iter().enumerate().map(distance_m).collect())
    }

    /// Returns the larger of the distances at which two robots steer because of each other, m. Closer than this they do
    /// not both come to rest (Remark 1). Returns `None` if the method does not steer.
    pub fn pair_steering_distance_m(&self, [i, j]: [usize; 2]) -> Option<f64> {
        let (_, distance_m) = self.avoidance_method.steering_distance?;
        let steering_distance_m = |robot: usize| {
            let mut avoidance = self.avoidance_of(robot, Pace::Lockstep).into_owned();
            if self.classes_sensed {
                avoidance.distance_min_m = self.pair_distance_min_m([i, j]);
            }
            distance_m(&self.conditions_of(robot, &avoidance))
        };
        Some(steering_distance_m(i).max(steering_distance_m(j)))
    }

    /// Returns the minimum sensing radius that the method requires, m.
    pub fn sensing_radius_needed_m(&self) -> f64 {
        let briefs = self.avoidance_of_all(Pace::Realtime);
        let radius_m = |(i, avoidance): (usize, &Cow<'_, AvoidanceBrief>)| {
            (self.avoidance_method.sensing_radius_m)(&self.conditions_of(i, avoidance))
        };
        briefs.iter().enumerate().map(radius_m).fold(0.0, f64::max)
    }

    /// Returns the maximum sensing radius that the method can use, m.
    pub fn sensing_radius_useful_m(&self) -> f64 {
        let useful_m = self
            .avoidance_method
            .useful_radius_m
            .map_or(0.0, |radius_m| radius_m(&self.avoidance_conditions()));
        useful_m.max(self.sensing_radius_needed_m())
    }
}
