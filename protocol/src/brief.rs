//! The brief: the configuration of one process, in TOML, written by the supervisor into the run directory; on a real
//! robot, its configuration file.
//!
//! An agent's brief names only the robots that it receives from, and the plant's brief names no edges.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use formation::drive::{Drive, DriveKind};
use formation::obstacle::Obstacle;
use formation::pose::Pose;
use formation::ramp::{AccelerationLimits, Ramp};
use formation::scale::Scale;
use formation::trajectory::Trajectory;
use serde::{Deserialize, Serialize};

use crate::fault::{LieFault, LinkFault, SensorFault, SlowFault, Span, WheelFault};
use crate::law::LIARS_MAX_KEY;
use crate::law_message::MessageFormat;
use crate::message::DEPUTIES_MAX;
use crate::number::{format_distinct, is_zero};
use crate::regular_file::{self, SymlinkPolicy};

/// Version of the brief format that this build writes and reads. It is incremented with every change that makes a
/// brief of another build invalid or changes its meaning.
pub const FORMAT_VERSION: u64 = 2;

/// Format key of a brief, whose only value is [`FORMAT_VERSION`]: another one can be neither read nor written.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(from = "u64", into = "u64")]
pub struct FormatVersion;

impl From<FormatVersion> for u64 {
    fn from(_: FormatVersion) -> u64 {
        FORMAT_VERSION
    }
}

impl From<u64> for FormatVersion {
    /// Ignores the number: [`read`] checks it first.
    fn from(_: u64) -> FormatVersion {
        FormatVersion
    }
}

/// Time mode.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Pace {
    /// Simulated time, tick by tick, as fast as the machine allows.
    Lockstep,
    /// CLOCK_MONOTONIC; every process has its own timer.
    #[default]
    Realtime,
}

impl Pace {
    /// Returns the keyword on the command line and in files.
    pub fn keyword(self) -> &'static str {
        match self {
            Pace::Lockstep => "lockstep",
            Pace::Realtime => "realtime",
        }
    }
}

/// A class of robots of the same size and speed limit, with the distance that one robot keeps from them.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct RobotClassBrief {
    /// Minimum distance of the own front point from theirs (d_ij), m.
    pub distance_min_m: f64,
    /// Their speed limit (V_j), m/s.
    pub speed_max_m_s: f64,
}

/// Avoidance method and its parameters. They are the same for all robots of a scenario, except in a team of robots with
/// different sizes or speeds.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct AvoidanceBrief {
    /// Name of the method.
    pub kind: String,
    /// Minimum distance of two front points (d), m. In a team the largest that the robot keeps from another one.
    pub distance_min_m: f64,
    /// Speed limit of every front point (v_max), m/s; in a team that of this robot. It applies only with methods that
    /// clamp the speed.
    pub speed_max_m_s: f64,
    /// Sensing radius, m: robots beyond it are not reported.
    pub sensing_radius_m: f64,
    /// Maximum error of a reported position, m.
    pub sensing_error_m: f64,
    /// Maximum error of the robot's own reported heading, rad.
    #[serde(default, skip_serializing_if = "is_zero")]
    pub heading_error_rad: f64,
    /// Maximum braking time of all robots, s; 0 if all robots stop at once.
    #[serde(default, skip_serializing_if = "is_zero")]
    pub braking_time_max_s: f64,
    /// Minimum distance of a front point from a wall or obstacle (clearance), m; 0 if there are none.
    #[serde(default, skip_serializing_if = "is_zero")]
    pub clearance_m: f64,
    /// Longest command timeout (H) of all robots, s; 0 if it is the same for all.
    #[serde(default, skip_serializing_if = "is_zero")]
    pub command_timeout_max_s: f64,
    /// Classes of the other robots, in a team of robots with different sizes or speeds. A sensed robot has its class as
    /// an index into this list.
    #[serde(default, rename = "class", skip_serializing_if = "Vec::is_empty")]
    pub classes: Vec<RobotClassBrief>,
    /// Gains that only this method uses, by key.
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    pub gains: BTreeMap<String, f64>,
}

/// Factor on the correction speed of a follower (contained robot) that moves to a new target after an in-neighbor
/// was declared failed.
pub const REPAIR_SPEED_FACTOR: f64 = 2.0;

/// Yield priority: robots with a later value yield to those with an earlier one. It improves performance only:
/// the guarantee on distances does not depend on it.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum YieldPriority {
    /// A leader, or a robot in a leaderless formation.
    #[default]
    First,
    /// A robot with a slot in a formation with a leader.
    Follower,
    /// A follower (contained robot), without a slot of its own.
    Contained,
}

/// Policy for lost neighbors.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum SilencePolicy {
    /// Take the mean over the other neighbors; without any, hold the last extrapolated points.
    Last,
    /// Take the mean over the other neighbors; without any, stop.
    Ignore,
    /// Hold the last extrapolated point of each lost neighbor.
    Keep,
    /// Stop while any neighbor is lost.
    Stop,
}

/// Communication timeouts of neighbors, and the policy for lost ones.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SilenceBrief {
    /// Age of a neighbor's newest beacon above which the neighbor is stale, ns.
    pub stale_after_ns: u64,
    /// Age of a neighbor's newest beacon above which the neighbor is lost (timed out), ns.
    pub lost_after_ns: u64,
    /// Policy for lost neighbors.
    pub policy: SilencePolicy,
}

/// Kind of the velocity that a robot publishes, by which others extrapolate its position and follow it.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub enum PublishedVelocity {
    /// Nominal velocity (gamma), without avoidance: it creates no feedback loop between mutual neighbors.
    #[serde(rename = "gamma")]
    Gamma,
    /// Commanded velocity, with avoidance. For studies.
    #[serde(rename = "gamma+beta")]
    GammaAndBeta,
    /// Difference quotient of the last two sensed positions. For studies.
    #[serde(rename = "differenced")]
    Differenced,
}

/// A robot whose beacons are received.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct NeighborBrief {
    /// Name of the robot.
    pub name: String,
    /// Scenario index of the robot, from 1.
    pub index: usize,
    /// Desired position relative to this robot (c_ji), m, in `map`.
    pub offset_m: [f64; 2],
    /// Planned faults of the link from this robot.
    #[serde(default, rename = "fault", skip_serializing_if = "Vec::is_empty")]
    pub faults: Vec<LinkFault>,
    /// Planned false data in the beacons of the neighbor.
    #[serde(default, rename = "lie", skip_serializing_if = "Vec::is_empty")]
    pub lies: Vec<LieFault>,
    /// Whether the neighbor is trusted because it leads: resilient consensus (W-MSR) never discards it.
    #[serde(default, skip_serializing_if = "is_false")]
    pub trusted: bool,
    /// Scenario indices, from 1, of the in-neighbors that it replaces: it counts once more for each entry whose
    /// robot is declared failed. If empty, an in-neighbor counts once, and a backup neighbor replaces any
    /// in-neighbor.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub replaces: Vec<usize>,
    /// Format of the messages of the neighbor's law; `None` if it sends none.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub message: Option<MessageFormat>,
    /// Distances within which the neighbor is received; `None` if it is received at any distance.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub range: Option<RangeBrief>,
    /// Parameters of the link from this robot, with any content.
    #[serde(default, skip_serializing_if = "toml::Table::is_empty")]
    pub params: toml::Table,
}

/// Communication by distance, with hysteresis.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct RangeBrief {
    /// Distance of the front points up to which a robot that was not received is received, m.
    pub radius_m: f64,
    /// Distance beyond the radius up to which a robot that was received stays received, m.
    pub hysteresis_m: f64,
}

impl RangeBrief {
    /// Returns whether a robot at a distance, m, is received, given whether it was before.
    pub fn contains(self, distance_m: f64, is_connected: bool) -> bool {
        let beyond_m = if is_connected { self.hysteresis_m } else { 0.0 };
        distance_m <= self.radius_m + beyond_m
    }
}

/// Motion of the formation, known to the main leader and to its backup leaders.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct LeadBrief {
    /// Scale of the formation over time (delta(t)).
    pub scale: Scale,
    /// Trajectory of the main leader (m(t)).
    pub trajectory: Trajectory,
    /// `true` if theta_n keeps its heading where m(t) reverses: the nominal leader then drives backwards.
    #[serde(default, skip_serializing_if = "is_false")]
    pub keep_heading: bool,
}

/// Configuration of a backup leader (deputy), which leads while it receives from no leader of a better rank.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct DeputyBrief {
    /// Rank, from 1 (0 is the main leader).
    pub rank: u64,
    /// Slot in the leader's frame at scale 1, relative to the main leader, m.
    pub place_m: [f64; 2],
    /// Front-point distance (ell) of the main leader, whose frame it continues, m.
    pub front_point_m: f64,
    /// Kind of the drive of the main leader.
    #[serde(rename = "drive", default, skip_serializing_if = "DriveKind::is_differential")]
    pub drive_kind: DriveKind,
    /// Maximum turn rate (w_max) of the main leader, rad/s; `None` without a limit.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub turn_rate_max_rad_s: Option<f64>,
    /// Minimum turning radius (R_min) of a car, m; `None` for other drives.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub turning_radius_min_m: Option<f64>,
    /// Acceleration limits of the main leader; `None` if its twist changes at once.
    pub limits: Option<AccelerationLimitsBrief>,
    /// Motion of the formation, as in the main leader's brief.
    pub lead: LeadBrief,
}

/// Failover of one leader that a robot receives from: the followers that take its slot while it is lost.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SuccessionBrief {
    /// Scenario index of the leader, from 1.
    pub leader: usize,
    /// Scenario indices of its backup leaders, best rank first, perhaps including the robot itself.
    pub deputies: Vec<usize>,
    /// Scenario indices of the backup neighbors (spares) relative to which the robot keeps the leader's slot, if it is
    /// one of the backup leaders. They replace no other robot. Empty otherwise.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub by: Vec<usize>,
}

/// Additional configuration of a program with a user-defined law, which no build of phalanx knows.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ProgramBrief {
    /// Version of the phalanx that starts the program, which must equal the program's own.
    pub phalanx: String,
    /// Name of the role that the law gives to the robot.
    pub role: String,
}

/// Additional configuration of a program that moves the robots instead of the built-in plant.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct PlantProgramBrief {
    /// Version of the phalanx that starts the program, which must equal the program's own.
    pub phalanx: String,
}

/// Version of this build of phalanx.
pub const VERSION: &str = env!("CARGO_PKG_VERSION");

/// Configuration of one agent.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct AgentBrief {
    /// Format of the brief.
    pub format: FormatVersion,
    /// Name of the robot.
    pub name: String,
    /// Scenario index of the robot, from 1.
    pub index: usize,
    /// Directory of the files that the processes of this run share.
    pub run_root: PathBuf,
    /// Time mode.
    pub pace: Pace,
    /// Control period (T), ns: one command per period.
    pub period_ns: u64,
    /// Period of odometry, ns.
    pub plant_tick_ns: u64,
    /// Command timeout (H), ns: a command may act until this long after the stamp it answers.
    pub command_lifetime_ns: u64,
    /// Part of the command timeout that covers planned delays of odometry and commands, ns.
    #[serde(default, skip_serializing_if = "is_zero_ns")]
    pub late_ns: u64,
    /// Distance of the front point ahead of the axle (ell), m; 0 for the axle midpoint.
    pub front_point_m: f64,
    /// Kind of the drive.
    #[serde(rename = "drive", default, skip_serializing_if = "DriveKind::is_differential")]
    pub drive_kind: DriveKind,
    /// Maximum turn rate (w_max), rad/s; `None` without a limit. Required at the axle midpoint.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub turn_rate_max_rad_s: Option<f64>,
    /// Minimum turning radius (R_min) of a car, m; `None` for other drives.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub turning_radius_min_m: Option<f64>,
    /// Name of the control law.
    pub law: String,
    /// Gains of the law by key.
    pub gains: BTreeMap<String, f64>,
    /// Additional configuration of a program with a user-defined law; `None` for a built-in law.
    pub program: Option<ProgramBrief>,
    /// Seed of the law's own random numbers, which differs from robot to robot.
    #[serde(default)]
    pub seed: u64,
    /// Formation slot of the robot, m, if the scenario gives one.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub place_m: Option<[f64; 2]>,
    /// Parameters of the law, with any content.
    #[serde(default, skip_serializing_if = "toml::Table::is_empty")]
    pub params: toml::Table,
    /// Whether the law may withhold its beacon at a sample.
    #[serde(default, skip_serializing_if = "is_false")]
    pub withholds: bool,
    /// Maximum number of messages of an in-neighbor that are kept for the law between two of its calls; 0 if it takes
    /// only the newest one.
    #[serde(default, skip_serializing_if = "is_zero_bytes")]
    pub message_queue: usize,
    /// Names of the signals that the law records.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub signals: Vec<String>,
    /// Whether the robot reports the messages of its law to the supervisor, which records them.
    #[serde(default, skip_serializing_if = "is_false")]
    pub records_messages: bool,
    /// Whether some law of the scenario sends messages or withholds beacons: the robot then counts how many it
    /// has sent, in lockstep in the barrier at each tick.
    #[serde(default, skip_serializing_if = "is_false")]
    pub counts_sent: bool,
    /// Whether offsets rotate and scale with a leader's frame. The robot then waits until it has received the frame.
    pub led: bool,
    /// Motion of the formation; for the main leader only.
    pub lead: Option<LeadBrief>,
    /// Configuration of a backup leader; for backup leaders only.
    pub deputy: Option<DeputyBrief>,
    /// Scale (delta(t)) of a robot with a slot in a leaderless formation; `None` for the constant 1.
    pub scale: Option<Scale>,
    /// Target of a robot with a goal of its own, m, in `map`.
    pub goal_m: Option<[f64; 2]>,
    /// Heading to which the robot turns at its goal, rad; `None` for any. Only at the axle midpoint.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub goal_heading_rad: Option<f64>,
    /// Yield priority in avoidance.
    #[serde(default)]
    pub rank: YieldPriority,
    /// Kind of the velocity that it publishes.
    pub published_velocity: PublishedVelocity,
    /// Acceleration limits; `None` if its twist changes at once.
    pub limits: Option<AccelerationLimitsBrief>,
    /// Avoidance method and its parameters.
    pub avoidance: AvoidanceBrief,
    /// Communication timeouts and the policy for lost neighbors.
    pub silence: SilenceBrief,
    /// Time for which an in-neighbor must be lost before a backup neighbor replaces it, and must be received
    /// again before the replacement ends, ns.
    #[serde(default, skip_serializing_if = "is_zero_ns")]
    pub repair_after_ns: u64,
    /// Whether a user may cut its links, which the service `robot/<id>/faults` then reports. Real time only.
    #[serde(default)]
    pub links_by_hand: bool,
    /// Whether the robot's goal may be changed from outside, through the service `robot/<id>/goal`. Real time only.
    #[serde(default)]
    pub goals_from_outside: bool,
    /// Planned slowdowns of the robot's computation.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub slow: Vec<SlowFault>,
    /// Planned faults of the robot's odometry stream.
    #[serde(default, rename = "odometry_fault", skip_serializing_if = "Vec::is_empty")]
    pub odometry_faults: Vec<LinkFault>,
    /// Planned faults of the robot's command stream. The robot compensates their delay.
    #[serde(default, rename = "command_fault", skip_serializing_if = "Vec::is_empty")]
    pub command_faults: Vec<LinkFault>,
    /// Robots that this robot receives from.
    #[serde(default, rename = "neighbor")]
    pub neighbors: Vec<NeighborBrief>,
    /// Backup neighbors for lost in-neighbors, in order of preference. For the main leader: its backup leaders,
    /// from which it receives before it leads again after a restart.
    #[serde(default, rename = "spare", skip_serializing_if = "Vec::is_empty")]
    pub spares: Vec<NeighborBrief>,
    /// Format of the messages of the robot's law; `None` if it sends none.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub message: Option<MessageFormat>,
    /// Failover plans of the leaders that a follower (contained robot) receives from.
    #[serde(default, rename = "succession", skip_serializing_if = "Vec::is_empty")]
    pub successions: Vec<SuccessionBrief>,
}

impl AgentBrief {
    /// Returns the robot's drive.
    pub fn drive(&self) -> Drive {
        Drive::new(self.drive_kind, self.front_point_m, self.turn_rate_max_rad_s)
            .with_turning_radius(self.turning_radius_min_m)
    }

    /// Iterates over all robots that the robot may receive from: in-neighbors, then backup neighbors. Sender indices
    /// count in this order.
    #[inline]
    pub fn senders(&self) -> impl Iterator<Item = &NeighborBrief> {
        self.neighbors.iter().chain(&self.spares)
    }

    /// Returns the maximum number of Byzantine in-neighbors (F): values discarded on either side.
    pub fn liars_max(&self) -> usize {
        self.gains.get(LIARS_MAX_KEY).map_or(0, |&liars| liars as usize)
    }

    /// Returns the sender with this index. Panics if the index is out of range.
    #[inline]
    pub fn sender(&self, sender_index: usize) -> &NeighborBrief {
        let in_neighbor = self.neighbors.get(sender_index);
        in_neighbor.unwrap_or_else(|| &self.spares[sender_index - self.neighbors.len()])
    }
}

/// Limits of a robot's wheels: (v, w) is scaled down together to meet them.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct WheelsBrief {
    /// Maximum speed of a wheel's rim, m/s.
    pub speed_max_m_s: f64,
    /// Distance between the wheels, m.
    pub track_m: f64,
}

/// Acceleration limits of a robot's twist: its inertia.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct AccelerationLimitsBrief {
    /// Maximum acceleration (a_v), m/s^2.
    pub acceleration_m_s2: f64,
    /// Maximum turn acceleration (a_w), rad/s^2.
    pub turn_acceleration_rad_s2: f64,
    /// Maximum braking time of a commanded twist (tau), s.
    pub braking_time_s: f64,
    /// Coupling of the changes of speed and turn rate.
    #[serde(default, skip_serializing_if = "Ramp::is_coupled")]
    pub ramp: Ramp,
}

impl AccelerationLimitsBrief {
    /// Returns the maximum accelerations.
    pub fn maximum_accelerations(&self) -> AccelerationLimits {
        AccelerationLimits {
            forward_m_s2: self.acceleration_m_s2,
            turn_rad_s2: self.turn_acceleration_rad_s2,
        }
    }
}

/// Size, speed limit, command timeout and class of one robot in a team of different robots.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct MemberBrief {
    /// Part of this robot in the minimum distances, m: d_ij = keep_i + keep_j.
    pub keep_m: f64,
    /// Speed limit of the front point, m/s; `None` if commands are not limited.
    pub speed_max_m_s: Option<f64>,
    /// Command timeout (H), ns.
    pub command_lifetime_ns: u64,
    /// Class that other robots sense; always 0 if they sense none.
    pub class: u8,
}

/// One robot, as the plant knows it.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct BodyBrief {
    /// Name of the robot.
    pub name: String,
    /// Distance of the front point ahead of the axle (ell), m; 0 for the axle midpoint.
    pub front_point_m: f64,
    /// Kind of the drive.
    #[serde(rename = "drive", default, skip_serializing_if = "DriveKind::is_differential")]
    pub drive_kind: DriveKind,
    /// Maximum turn rate (w_max), rad/s; `None` without a limit. Required at the axle midpoint.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub turn_rate_max_rad_s: Option<f64>,
    /// Minimum turning radius (R_min) of a car, m; `None` for other drives.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub turning_radius_min_m: Option<f64>,
    /// Size, speed limit, command timeout and class of a robot in a team; `None` if all robots have the same.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub member: Option<MemberBrief>,
    /// Wheel limits; `None` if there are none.
    pub wheels: Option<WheelsBrief>,
    /// Acceleration limits; `None` if its twist changes at once.
    pub limits: Option<AccelerationLimitsBrief>,
    /// Start pose.
    pub start: Pose,
    /// Planned faults of the robot's sensors.
    #[serde(default, rename = "sensor_fault", skip_serializing_if = "Vec::is_empty")]
    pub sensor_faults: Vec<SensorFault>,
    /// Planned faults of the robot's wheels.
    #[serde(default, rename = "wheel_fault", skip_serializing_if = "Vec::is_empty")]
    pub wheel_faults: Vec<WheelFault>,
    /// Planned faults of the robot's command stream.
    #[serde(default, rename = "command_fault", skip_serializing_if = "Vec::is_empty")]
    pub command_faults: Vec<LinkFault>,
}

impl BodyBrief {
    /// Returns the robot's drive.
    #[inline]
    pub fn drive(&self) -> Drive {
        Drive::new(self.drive_kind, self.front_point_m, self.turn_rate_max_rad_s)
            .with_turning_radius(self.turning_radius_min_m)
    }
}

/// Configuration of the plant.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct PlantBrief {
    /// Format of the brief.
    pub format: FormatVersion,
    /// Directory of the files that the processes of this run share.
    pub run_root: PathBuf,
    /// Time mode.
    pub pace: Pace,
    /// Time of the run's end, ns.
    pub duration_ns: u64,
    /// Length of a tick in lockstep, ns.
    pub period_ns: u64,
    /// Maximum length of an arc, and period of odometry and ground truth, in real time, ns.
    pub plant_tick_ns: u64,
    /// Command timeout (H), ns: a command may act until this long after the stamp it answers.
    pub command_lifetime_ns: u64,
    /// Minimum distance of two front points (d), m: closer pairs are counted.
    pub distance_min_m: f64,
    /// Speed limit of every front point, m/s; `None` if commands are not limited.
    pub speed_max_m_s: Option<f64>,
    /// Sensing radius, m: robots within it are reported in odometry.
    pub sensing_radius_m: f64,
    /// Whether the velocities of these robots are reported too, because the avoidance method needs them.
    #[serde(default)]
    pub velocities_sensed: bool,
    /// Clearance, m: front points that are closer to an obstacle are counted.
    #[serde(default, skip_serializing_if = "is_zero")]
    pub clearance_m: f64,
    /// Configuration of a program that moves the robots; `None` for the built-in plant.
    pub program: Option<PlantProgramBrief>,
    /// Convex parts of all walls and obstacles.
    #[serde(default, rename = "obstacle", skip_serializing_if = "Vec::is_empty")]
    pub obstacles: Vec<Obstacle>,
    /// Robots, in scenario order.
    #[serde(rename = "robot")]
    pub robots: Vec<BodyBrief>,
}

/// Configuration of the bridge of one host, in a run on several hosts.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct BridgeBrief {
    /// Format of the brief.
    pub format: FormatVersion,
    /// Directory of the files that the processes of this run share on this host.
    pub run_root: PathBuf,
    /// Hash of the scenario and the fleet file, equal on all hosts: 16 hex digits.
    pub experiment: String,
    /// Index of this host, from 0.
    pub here: usize,
    /// Index of the plant's host.
    pub plant: usize,
    /// Maximum age of an odometry sample or command, ns: the command timeout. Older ones are dropped.
    pub odometry_age_ns_max: u64,
    /// Maximum age of a beacon, ns: the lost threshold. Older ones are dropped.
    pub beacon_age_ns_max: u64,
    /// Maximum time for which hosts wait for each other before the run, ns.
    pub join_within_ns: u64,
    /// Time without a message after which another host is unreachable, ns.
    pub unreachable_after_ns: u64,
    /// Time without a message of the plant's host after which this host ends its part of the run, ns.
    pub silence_ns_max: u64,
    /// Transport protocol: `tcp` or `udp`. With certificates it is TLS over TCP.
    pub transport: String,
    /// Whether robots report the messages of their laws to the supervisor.
    #[serde(default, skip_serializing_if = "is_false")]
    pub records_messages: bool,
    /// Certificates of mutual TLS, if there are any.
    pub certificates: Option<CertificatesBrief>,
    /// All hosts of the fleet.
    #[serde(rename = "host")]
    pub hosts: Vec<HostBrief>,
    /// All robots, in scenario order.
    #[serde(rename = "robot")]
    pub robots: Vec<BridgedRobotBrief>,
    /// Planned network partitions.
    #[serde(default, rename = "partition", skip_serializing_if = "Vec::is_empty")]
    pub partitions: Vec<PartitionBrief>,
}

/// Certificate files of mutual TLS, in PEM.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct CertificatesBrief {
    /// Certificate of the authority that signed the certificates of all hosts.
    pub authority: PathBuf,
    /// Certificate of this host, whose common name is the host's name.
    pub certificate: PathBuf,
    /// Private key of this host.
    pub key: PathBuf,
}

/// One host of the fleet.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct HostBrief {
    /// Name of the host.
    pub name: String,
    /// Address on which the bridge of the host listens, as `ADDRESS:PORT`.
    pub address: String,
}

/// One robot, as a bridge knows it.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct BridgedRobotBrief {
    /// Name of the robot.
    pub name: String,
    /// Index of the host on which the robot's process runs.
    pub host: usize,
    /// Indices of the other hosts with robots that receive from it.
    pub heard_on: Vec<usize>,
    /// Number of robots that this robot receives from.
    pub hears: usize,
    /// Maximum length of a message of the robot's law, bytes; 0 if it sends none.
    #[serde(default, skip_serializing_if = "is_zero_bytes")]
    pub message_bytes_max: usize,
}

impl BridgeBrief {
    /// Returns whether a planned partition separates two hosts at run time `t_ns`.
    pub fn are_partitioned(&self, a: usize, b: usize, t_ns: u64) -> bool {
        let is_inside = |hosts: &[usize], host: usize| hosts.contains(&host);
        self.partitions.iter().any(|partition| {
            partition.span.contains(t_ns)
                && is_inside(&partition.hosts, a) != is_inside(&partition.hosts, b)
        })
    }
}

/// A network partition: an interval in which two groups of hosts cannot communicate.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct PartitionBrief {
    /// Indices of the hosts in one group; all other hosts are in the other.
    pub hosts: Vec<usize>,
    /// Time of the partition.
    pub span: Span,
}

/// Failure to read or parse a brief.
#[derive(Debug, thiserror::Error)]
#[expect(missing_docs, reason = "the messages say what the fields are")]
pub enum BriefError {
    /// The file could not be read.
    #[error("cannot read the brief {path}: {source}")]
    Read { path: PathBuf, source: std::io::Error },
    /// Another build wrote the file.
    #[error(
        "{path} has {found}, and this program reads format {FORMAT_VERSION}: another build wrote it; start \
         supervisor, agents and plant from the same build"
    )]
    ForeignFormat { path: PathBuf, found: String },
    /// The file is not a brief of this kind.
    #[error("{path} is not a brief: {source}")]
    Parse { path: PathBuf, source: Box<toml::de::Error> },
    /// A value is out of range.
    #[error("{path} is invalid: {flaw}")]
    Invalid { path: PathBuf, flaw: String },
}

/// A kind of brief. The methods are implemented for each kind, not generic, so that the code that reads and writes a
/// brief is compiled once, in this crate.
pub trait Brief: Sized {
    /// Reads the TOML table of a brief; fails if it is not one of this kind. Does not check values.
    fn from_table(table: toml::Table) -> Result<Self, toml::de::Error>;

    /// Returns the text of the brief, TOML.
    fn to_toml(&self) -> String;

    /// Returns a message about the first value that is out of range, if any. The brief of a real robot is written
    /// by its operator and may contain such a value.
    fn find_invalid_value(&self) -> Option<String>;
}

impl Brief for AgentBrief {
    fn from_table(table: toml::Table) -> Result<Self, toml::de::Error> {
        table.try_into()
    }

    fn to_toml(&self) -> String {
        to_toml(self)
    }

    fn find_invalid_value(&self) -> Option<String> {
        let mut checker = RangeChecker::default();
        let neighbors = self.neighbors.iter().map(|neighbor| ("neighbor.index", neighbor.index));
        let spares = self.spares.iter().map(|spare| ("spare.index", spare.index));
        for (key, index) in neighbors.chain(spares).chain([("index", self.index)]) {
            checker.require(index > 0, || format!("{key} is 0, expected 1 or more"));
        }
        if let Some(&DeputyBrief { rank, .. }) = self.deputy.as_ref() {
            let is_valid_rank = (1..=DEPUTIES_MAX).contains(&rank);
            checker.require(is_valid_rank, || {
                format!("deputy.rank is {rank}, expected 1 to {DEPUTIES_MAX}")
            });
        }
        checker.require_time_in_range("period_ns", self.period_ns);
        checker.require_time_in_range("plant_tick_ns", self.plant_tick_ns);
        checker.require_time_in_range("command_lifetime_ns", self.command_lifetime_ns);
        checker.check_drive("", self.drive(), self.limits.as_ref());
        let liars = self.gains.get(LIARS_MAX_KEY).copied().unwrap_or(0.0);
        checker.require(liars.fract() == 0.0, || {
            format!("gains.{LIARS_MAX_KEY} is {liars}, expected a whole number")
        });
        let avoidance = &self.avoidance;
        checker.require_positive("avoidance.distance_min_m", avoidance.distance_min_m);
        checker.require_not_negative("avoidance.sensing_error_m", avoidance.sensing_error_m);
        checker.require_not_negative("avoidance.heading_error_rad", avoidance.heading_error_rad);
        checker.require_not_negative("avoidance.braking_time_max_s", avoidance.braking_time_max_s);
        checker.require_not_negative("avoidance.clearance_m", avoidance.clearance_m);
        checker.check_classes(avoidance);
        if let Some(limits) = &self.limits {
            checker.check_limits("limits", limits);
            // Otherwise it might need longer to brake than all robots assume.
            let (braking_time_s, braking_time_max_s) =
                (limits.braking_time_s, avoidance.braking_time_max_s);
            let [found, limit_text] = format_distinct(braking_time_s, braking_time_max_s);
            checker.require(braking_time_s <= braking_time_max_s, || {
                format!(
                    "limits.braking_time_s is {found}, expected at most \
                     avoidance.braking_time_max_s = {limit_text}"
                )
            });
        }
        // Otherwise the front point could move more than ell in one period: v_max T must be less than ell.
        // Without a speed limit, no computation depends on it.
        let v_max = avoidance.speed_max_m_s;
        let speed_limit = match self.drive().turns_freely() {
            true => f64::INFINITY,
            false => self.front_point_m / (self.period_ns as f64 / 1e9),
        };
        let is_valid = v_max > 0.0 && (v_max == f64::INFINITY || v_max < speed_limit);
        let [found, speed_limit] = format_distinct(v_max, speed_limit);
        checker.require(is_valid, || {
            format!(
                "avoidance.speed_max_m_s is {found}, expected more than 0 and less than \
                 front_point_m / period = {speed_limit} m/s"
            )
        });
        checker.first_flaw
    }
}

impl Brief for PlantBrief {
    fn from_table(table: toml::Table) -> Result<Self, toml::de::Error> {
        table.try_into()
    }

    fn to_toml(&self) -> String {
        to_toml(self)
    }

    fn find_invalid_value(&self) -> Option<String> {
        let mut checker = RangeChecker::default();
        checker
            .require(!self.robots.is_empty(), || "there is no robot, expected one or more".into());
        checker.require_time_in_range("period_ns", self.period_ns);
        checker.require_time_in_range("plant_tick_ns", self.plant_tick_ns);
        checker.require_time_in_range("command_lifetime_ns", self.command_lifetime_ns);
        checker.require_time_in_range("duration_ns", self.duration_ns);
        checker.require_positive("distance_min_m", self.distance_min_m);
        checker.require_positive("speed_max_m_s", self.speed_max_m_s.unwrap_or(1.0));
        checker.require_not_negative("clearance_m", self.clearance_m);
        for robot in &self.robots {
            checker.check_drive("robot.", robot.drive(), robot.limits.as_ref());
            if let Some(member) = &robot.member {
                checker.require_positive("robot.member.keep_m", member.keep_m);
                checker.require_positive(
                    "robot.member.speed_max_m_s",
                    member.speed_max_m_s.unwrap_or(1.0),
                );
                checker.require_time_in_range(
                    "robot.member.command_lifetime_ns",
                    member.command_lifetime_ns,
                );
            }
            robot.limits.iter().for_each(|limits| checker.check_limits("robot.limits", limits));
        }
        for obstacle in &self.obstacles {
            let (center, radius_m) = obstacle.bounding_circle();
            let is_finite = radius_m.is_finite() && radius_m >= 0.0;
            let is_finite = is_finite && center.iter().all(|coordinate| coordinate.is_finite());
            let convexity = obstacle.check_convex();
            checker.require(is_finite && convexity.is_ok(), || {
                let reason = convexity
                    .err()
                    .map_or("numbers that are none".into(), |reason| reason.to_string());
                format!(
                    "obstacle is {obstacle:?}, expected a convex one of finite numbers: {reason}"
                )
            });
        }
        checker.first_flaw
    }
}

impl Brief for BridgeBrief {
    fn from_table(table: toml::Table) -> Result<Self, toml::de::Error> {
        table.try_into()
    }

    fn to_toml(&self) -> String {
        to_toml(self)
    }

    fn find_invalid_value(&self) -> Option<String> {
        let mut checker = RangeChecker::default();
        let hosts = self.hosts.len();
        let mut check_host = |key: &str, host: usize| {
            let message =
                || format!("{key} is {host}, expected the index of one of {hosts} hosts, from 0");
            checker.require(host < hosts, message);
        };
        check_host("here", self.here);
        check_host("plant", self.plant);
        for robot in &self.robots {
            check_host("robot.host", robot.host);
            robot.heard_on.iter().for_each(|&host| check_host("robot.heard_on", host));
        }
        let partitioned_hosts = self.partitions.iter().flat_map(|partition| &partition.hosts);
        partitioned_hosts.for_each(|&host| check_host("partition.hosts", host));
        checker.require(u64::from_str_radix(&self.experiment, 16).is_ok(), || {
            format!("experiment is {:?}, expected 16 hex digits", self.experiment)
        });
        checker.require_time_in_range("odometry_age_ns_max", self.odometry_age_ns_max);
        checker.require_time_in_range("beacon_age_ns_max", self.beacon_age_ns_max);
        checker.require_time_in_range("join_within_ns", self.join_within_ns);
        checker.require_time_in_range("unreachable_after_ns", self.unreachable_after_ns);
        checker.require_time_in_range("silence_ns_max", self.silence_ns_max);
        checker.first_flaw
    }
}

/// Maximum time in a brief, ns: a third of the range of 64 bits, so sums of two times do not overflow. 194 years.
const TIME_NS_MAX: u64 = u64::MAX / 3;

/// Collector of range checks, which keeps the first message.
#[derive(Default)]
struct RangeChecker {
    first_flaw: Option<String>,
}

impl RangeChecker {
    fn require(&mut self, is_valid: bool, flaw: impl FnOnce() -> String) {
        if !is_valid {
            self.first_flaw.get_or_insert_with(flaw);
        }
    }

    fn require_time_in_range(&mut self, key: &str, ns: u64) {
        let message = || format!("{key} is {ns}, expected 1 to {TIME_NS_MAX}");
        self.require((1..=TIME_NS_MAX).contains(&ns), message);
    }

    fn require_positive(&mut self, key: &str, number: f64) {
        let message = || format!("{key} is {number}, expected a number above 0");
        self.require(number.is_finite() && number > 0.0, message);
    }

    fn require_not_negative(&mut self, key: &str, number: f64) {
        let message = || format!("{key} is {number}, expected a number of 0 or more");
        self.require(number.is_finite() && number >= 0.0, message);
    }

    /// Checks a drive, whose keys begin with `path`.
    fn check_drive(&mut self, path: &str, drive: Drive, limits: Option<&AccelerationLimitsBrief>) {
        self.require_not_negative(&format!("{path}front_point_m"), drive.ell_m);
        let turn_rate_max = drive.turn_rate_max_rad_s;
        // Without turning, an omnidirectional robot is a drone at fixed height.
        let is_valid_rate =
            turn_rate_max > 0.0 || (turn_rate_max == 0.0 && drive.kind == DriveKind::Omni);
        self.require(is_valid_rate, || {
            format!("{path}turn_rate_max_rad_s is {turn_rate_max}, expected a number above 0")
        });
        self.require(drive.kind.is_differential() || drive.turns_freely(), || {
            let ell = drive.ell_m;
            let kind = if drive.is_car() { "ackermann" } else { "omni" };
            format!("{path}front_point_m is {ell} with {path}drive = \"{kind}\", expected 0")
        });
        let curvature = drive.curvature_max_per_m;
        self.require(!drive.is_car() || (curvature > 0.0 && curvature.is_finite()), || {
            format!(
                "{path}turning_radius_min_m is missing with {path}drive = \"ackermann\", expected a number above 0"
            )
        });
        if drive.turns_freely() {
            self.require(turn_rate_max.is_finite() || drive.is_car(), || {
                format!("{path}front_point_m is 0 without {path}turn_rate_max_rad_s, expected both")
            });
            // With a common ramp a slow turn would prolong the braking.
            let is_independent = limits.is_none_or(|limits| !limits.ramp.is_coupled());
            self.require(is_independent, || {
                format!(
                    "{path}limits.ramp is \"together\" with front_point_m = 0, expected \"independent\""
                )
            });
        }
    }

    /// Checks the classes of robots. The radius within which the guard considers robots follows from `distance_min_m`.
    fn check_classes(&mut self, avoidance: &AvoidanceBrief) {
        self.require_not_negative(
            "avoidance.command_timeout_max_s",
            avoidance.command_timeout_max_s,
        );
        for class in &avoidance.classes {
            let (distance_min_m, distance_limit_m) =
                (class.distance_min_m, avoidance.distance_min_m);
            let [found, most_text] = format_distinct(distance_min_m, distance_limit_m);
            self.require(distance_min_m > 0.0 && distance_min_m <= distance_limit_m, || {
                format!(
                    "avoidance.class.distance_min_m is {found}, expected more than 0 and at most \
                     avoidance.distance_min_m = {most_text}"
                )
            });
            let speed_m_s = class.speed_max_m_s;
            self.require(speed_m_s > 0.0, || {
                format!("avoidance.class.speed_max_m_s is {speed_m_s}, expected a number above 0")
            });
        }
    }

    fn check_limits(&mut self, path: &str, limits: &AccelerationLimitsBrief) {
        self.require_positive(&format!("{path}.acceleration_m_s2"), limits.acceleration_m_s2);
        let turn = limits.turn_acceleration_rad_s2;
        self.require_positive(&format!("{path}.turn_acceleration_rad_s2"), turn);
        self.require_not_negative(&format!("{path}.braking_time_s"), limits.braking_time_s);
    }
}

/// Maximum size of a brief, bytes: far more than 1,024 robots need. A larger file is refused.
const BRIEF_BYTES_MAX: u64 = 1 << 26;

/// Reads and checks a brief.
///
/// # Errors
///
/// The file cannot be read, has another format, is not a brief of this kind, or has a value out of range.
pub fn read<B: Brief>(path: &Path) -> Result<B, BriefError> {
    let text = regular_file::read_to_string(path, SymlinkPolicy::Followed, BRIEF_BYTES_MAX)
        .map_err(|source| BriefError::Read { path: path.into(), source })?;
    parse(path, &text)
}

/// Parses in two steps: text to table, table to brief. serde's code for each structure is then compiled for one kind of
/// map only; `toml::from_str` would compile it for three.
fn parse<B: Brief>(path: &Path, text: &str) -> Result<B, BriefError> {
    let parse_error = |source| BriefError::Parse { path: path.into(), source: Box::new(source) };
    let table: toml::Table = text.parse().map_err(parse_error)?;
    check_format(path, &table)?;
    let brief = B::from_table(table).map_err(parse_error)?;
    match brief.find_invalid_value() {
        None => Ok(brief),
        Some(flaw) => Err(BriefError::Invalid { path: path.into(), flaw }),
    }
}

/// Fails if the table has another format than this program reads.
fn check_format(path: &Path, table: &toml::Table) -> Result<(), BriefError> {
    let found = match table.get("format") {
        Some(toml::Value::Integer(format)) if u64::try_from(*format) == Ok(FORMAT_VERSION) => {
            return Ok(());
        }
        Some(other) => format!("format {other}"),
        None => "no format".to_owned(),
    };
    Err(BriefError::ForeignFormat { path: path.into(), found })
}

/// Returns the version of the phalanx that wrote a program's brief, whatever its format; `None` if it has none.
pub fn read_writer_version(path: &Path) -> Option<String> {
    let text = regular_file::read_to_string(path, SymlinkPolicy::Followed, BRIEF_BYTES_MAX).ok()?;
    let table: toml::Table = text.parse().ok()?;
    Some(table.get("program")?.get("phalanx")?.as_str()?.to_owned())
}

fn is_false(truth: &bool) -> bool {
    !truth
}

fn is_zero_bytes(bytes: &usize) -> bool {
    *bytes == 0
}

fn is_zero_ns(ns: &u64) -> bool {
    *ns == 0
}

/// Returns the text of a brief.
pub(crate) fn to_toml(brief: &impl Serialize) -> String {
    toml::to_string(brief).expect("a brief has string keys and no empty values")
}

#[cfg(test)]
mod tests;
