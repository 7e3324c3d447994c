//! The brief: all that one process is told. TOML, written by the supervisor into the run
//! directory; on a real robot, its configuration file.
//!
//! An agent's brief names the robots it hears and nobody else; the plant's names no edges.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use formation::obstacle::Obstacle;
use formation::pose::Pose;
use formation::ramp::{Accelerations, Ramp};
use formation::scale::Scale;
use formation::trajectory::Trajectory;
use serde::de::DeserializeOwned;
use serde::{Deserialize, Serialize};

use crate::fault::{LieFault, LinkFault, SensorFault, SlowFault, Span, WheelFault};
use crate::law::LIARS_MAX;
use crate::message::DEPUTIES_MAX;
use crate::number::{is_zero, told_apart};
use crate::regular_file::{self, Links};

/// The version of the briefs' form that this build writes and reads. It is raised with every change
/// that makes a brief of another build mean something else, or nothing.
pub const FORMAT: u64 = 2;

/// [`FORMAT`], as the first key of a brief: no other can be read or written.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(from = "u64", into = "u64")]
pub struct Format;

impl From<Format> for u64 {
    fn from(_: Format) -> u64 {
        FORMAT
    }
}

impl From<u64> for Format {
    /// Whether it is this one [`read`] asks before all else.
    fn from(_: u64) -> Format {
        Format
    }
}

/// How time passes.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Pace {
    /// Simulated time, tick by tick, as fast as the machine allows.
    Lockstep,
    /// CLOCK_MONOTONIC; every process keeps its own timer.
    #[default]
    Realtime,
}

impl Pace {
    /// The word for it on the command line and in files.
    pub fn word(self) -> &'static str {
        match self {
            Pace::Lockstep => "lockstep",
            Pace::Realtime => "realtime",
        }
    }
}

/// The avoidance method, and what it rests on; one set for all robots of a scenario.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct AvoidanceBrief {
    /// Which method.
    pub kind: String,
    /// d: no two front points nearer than this, m.
    pub distance_min_m: f64,
    /// v_max: the speed limit of every front point, m/s. It acts with methods that clamp only.
    pub speed_max_m_s: f64,
    /// Robots farther away than this are not reported, m.
    pub sensing_radius_m: f64,
    /// Bound on the error of a reported position, m.
    pub sensing_error_m: f64,
    /// Bound on the error of the robot's own reported heading, rad.
    #[serde(default, skip_serializing_if = "is_zero")]
    pub heading_error_rad: f64,
    /// The largest braking time of all robots, s: 0 where all stop at once.
    #[serde(default, skip_serializing_if = "is_zero")]
    pub braking_time_max_s: f64,
    /// The clearance: no front point nearer than this to a wall or obstacle, m; 0 where there are none.
    #[serde(default, skip_serializing_if = "is_zero")]
    pub clearance_m: f64,
    /// The method's own gains by key.
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    pub gains: BTreeMap<String, f64>,
}

/// A contained robot that has given up somebody whom it heard has another place, and goes there so many times as fast as it corrects
/// small errors else.
pub const REPAIR_HASTE: f64 = 2.0;

/// Whose way it is: who comes later here makes way for those before. Comfort only: no promise about
/// distances knows of it.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Rank {
    /// Leads, or is in a formation that nobody leads.
    #[default]
    First,
    /// Keeps a place in a formation that somebody leads.
    Follower,
    /// Has no place of its own.
    Contained,
}

/// What to do about neighbours that fell silent.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum SilencePolicy {
    /// Take the mean over the rest; with nobody left, let their last extrapolated points stand still.
    Last,
    /// Take the mean over the rest; with nobody left, stop.
    Ignore,
    /// Let the last extrapolated point stand still.
    Keep,
    /// Stop while anybody is lost.
    Stop,
}

/// When a neighbour counts as stale and as lost, and what then.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SilenceBrief {
    /// Older than this is stale, ns.
    pub stale_after_ns: u64,
    /// Older than this is lost, ns.
    pub lost_after_ns: u64,
    /// What to do about the lost.
    pub policy: SilencePolicy,
}

/// Which velocity a robot publishes: the one by which others extrapolate its position and follow
/// it.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub enum PublishedVelocity {
    /// The nominal one, free of avoidance: kicks do not echo between mutual neighbours.
    #[serde(rename = "gamma")]
    Gamma,
    /// The commanded one, avoidance included. For study.
    #[serde(rename = "gamma+beta")]
    GammaAndBeta,
    /// The difference of the last two sensed positions over the time between. For study.
    #[serde(rename = "differenced")]
    Differenced,
}

/// A robot that is heard.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct NeighborBrief {
    /// Its name.
    pub name: String,
    /// Its place in the scenario, from 1.
    pub index: usize,
    /// c_ji: where to stand as seen from it, m, in `map`.
    pub offset_m: [f64; 2],
    /// What is to be wrong with the link from it.
    #[serde(default, rename = "fault", skip_serializing_if = "Vec::is_empty")]
    pub faults: Vec<LinkFault>,
    /// When its beacons are to be false.
    #[serde(default, rename = "lie", skip_serializing_if = "Vec::is_empty")]
    pub lies: Vec<LieFault>,
    /// It leads: a robot that leaves out liars never leaves it out.
    #[serde(default, skip_serializing_if = "is_false")]
    pub trusted: bool,
    /// In place of which in-neighbours it counts, by their places in the scenario, from 1: once, or once more, for
    /// each entry whose robot is given up. Empty: an in-neighbour counts once, and a spare replaces anybody.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub replaces: Vec<usize>,
}

/// What the main leader alone is told: where to go, and how large the formation is to be.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct LeadBrief {
    /// delta(t).
    pub scale: Scale,
    /// m(t).
    pub trajectory: Trajectory,
}

/// What a robot is told that leads while it hears no leader of a better rank.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct DeputyBrief {
    /// Its rank, from 1; the main leader's is 0.
    pub rank: u64,
    /// Its place in the leader's frame at scale 1, seen from the main leader, m.
    pub place_m: [f64; 2],
    /// ell of the main leader, whose frame it continues, m.
    pub front_point_m: f64,
    /// How fast the main leader's twist can change; without, at once.
    pub limits: Option<LimitsBrief>,
    /// What the main leader is told.
    pub lead: LeadBrief,
}

/// Contained robots that take the place of a leader that a robot hears, while it is lost.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SuccessionBrief {
    /// The leader, by its place in the scenario, from 1.
    pub leader: usize,
    /// They, the best rank first; the robot itself may be one.
    pub deputies: Vec<usize>,
    /// If it is, by which of its spares it then keeps that place, at their offsets. They replace nobody else.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub by: Vec<usize>,
}

/// What a program with a law of its own is told beside the rest: no build has a row for it.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ProgramBrief {
    /// The version of the phalanx that starts it, which its own must be.
    pub phalanx: String,
    /// What the law makes of the robot: the name of a role.
    pub role: String,
}

/// What a program that moves the robots is told beside the rest.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct PlantProgramBrief {
    /// The version of the phalanx that starts it, which its own must be.
    pub phalanx: String,
}

/// The version of phalanx that this is part of.
pub const VERSION: &str = env!("CARGO_PKG_VERSION");

/// What one agent is told.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct AgentBrief {
    /// The form that this is in.
    pub format: Format,
    /// The robot's name.
    pub name: String,
    /// Its place in the scenario, from 1.
    pub index: usize,
    /// Where the files shared by this run live.
    pub run_root: PathBuf,
    /// How time passes.
    pub pace: Pace,
    /// T: one command per period, ns.
    pub period_ns: u64,
    /// The plant publishes odometry this often, ns.
    pub plant_tick_ns: u64,
    /// H: a command may act until the stamp it answers plus this, ns.
    pub command_lifetime_ns: u64,
    /// How much of that is for odometry and commands that faults delay, ns.
    #[serde(default, skip_serializing_if = "is_none")]
    pub late_ns: u64,
    /// ell: how far the front point lies ahead of the axle, m.
    pub front_point_m: f64,
    /// Which control law.
    pub law: String,
    /// The law's gains by key.
    pub gains: BTreeMap<String, f64>,
    /// Of a law in a program of its own.
    pub program: Option<ProgramBrief>,
    /// Whether offsets turn and grow with a leader's frame, which then must be heard first.
    pub led: bool,
    /// Where to lead, for the main leader only.
    pub lead: Option<LeadBrief>,
    /// How to lead in the main leader's place, for its deputies only.
    pub deputy: Option<DeputyBrief>,
    /// delta(t), for those that keep a place in a formation that nobody leads; without, always 1.
    pub scale: Option<Scale>,
    /// Where to go, m, in `map`, for a robot with a goal of its own.
    pub goal_m: Option<[f64; 2]>,
    /// Whom avoidance is to make way for.
    #[serde(default)]
    pub rank: Rank,
    /// Which velocity to publish.
    pub published_velocity: PublishedVelocity,
    /// How fast its twist can change; without, at once.
    pub limits: Option<LimitsBrief>,
    /// How to keep distance.
    pub avoidance: AvoidanceBrief,
    /// What to do about the silent.
    pub silence: SilenceBrief,
    /// For how long an in-neighbour is lost before a spare is opened, and heard again before it is
    /// closed, ns.
    #[serde(default, skip_serializing_if = "is_none")]
    pub repair_after_ns: u64,
    /// Links may be cut by hand: it is told so over `robot/<id>/faults`. In real time only.
    #[serde(default)]
    pub links_by_hand: bool,
    /// Its goal may be another from outside: it is told so over `robot/<id>/goal`. In real time only.
    #[serde(default)]
    pub goals_from_outside: bool,
    /// When it is to need longer for an answer.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub slow: Vec<SlowFault>,
    /// What is to be wrong with its odometry.
    #[serde(default, rename = "odometry_fault", skip_serializing_if = "Vec::is_empty")]
    pub odometry_faults: Vec<LinkFault>,
    /// What is known to be wrong with its commands: it reckons with their delay.
    #[serde(default, rename = "command_fault", skip_serializing_if = "Vec::is_empty")]
    pub command_faults: Vec<LinkFault>,
    /// Who is heard.
    #[serde(default, rename = "neighbor")]
    pub neighbors: Vec<NeighborBrief>,
    /// Who is heard in place of lost in-neighbours, in this order; of the main leader its deputies, which it
    /// hears before it leads anew.
    #[serde(default, rename = "spare", skip_serializing_if = "Vec::is_empty")]
    pub spares: Vec<NeighborBrief>,
    /// Who takes the places of leaders that a contained robot hears.
    #[serde(default, rename = "succession", skip_serializing_if = "Vec::is_empty")]
    pub successions: Vec<SuccessionBrief>,
}

impl AgentBrief {
    /// All whose beacons it may open: those heard, then the spares. Places count in this order.
    pub fn senders(&self) -> impl Iterator<Item = &NeighborBrief> {
        self.neighbors.iter().chain(&self.spares)
    }

    /// Whether anybody is gone by in place of lost in-neighbours.
    pub fn is_repaired(&self) -> bool {
        let is_planned = |sender: &NeighborBrief| !sender.replaces.is_empty();
        !(self.spares.is_empty() && self.successions.is_empty())
            || self.neighbors.iter().any(is_planned)
    }

    /// F: how many of those heard it leaves out on either side.
    pub fn liars_max(&self) -> usize {
        self.gains.get(LIARS_MAX).map_or(0, |&liars| liars as usize)
    }

    /// The sender at this place.
    pub fn sender(&self, place: usize) -> &NeighborBrief {
        let in_neighbor = self.neighbors.get(place);
        in_neighbor.unwrap_or_else(|| &self.spares[place - self.neighbors.len()])
    }
}

/// Limits of a robot's wheels: (v, w) are scaled down together to meet them.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct WheelsBrief {
    /// Largest speed of a wheel's rim, m/s.
    pub speed_max_m_s: f64,
    /// Distance between the wheels, m.
    pub track_m: f64,
}

/// How fast a robot's twist can change: its inertia.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct LimitsBrief {
    /// a_v: largest acceleration, m/s^2.
    pub acceleration_m_s2: f64,
    /// a_w: largest acceleration of its turn rate, rad/s^2.
    pub turn_acceleration_rad_s2: f64,
    /// tau: it is never commanded a twist that takes longer to brake from, s.
    pub braking_time_s: f64,
    /// How both parts of the twist change together.
    #[serde(default, skip_serializing_if = "Ramp::is_together")]
    pub ramp: Ramp,
}

impl LimitsBrief {
    /// Its accelerations.
    pub fn accelerations(&self) -> Accelerations {
        Accelerations {
            forward_m_s2: self.acceleration_m_s2,
            turn_rad_s2: self.turn_acceleration_rad_s2,
        }
    }
}

/// One robot as the plant knows it.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct BodyBrief {
    /// The robot's name.
    pub name: String,
    /// ell, m.
    pub front_point_m: f64,
    /// Wheel limits, if any.
    pub wheels: Option<WheelsBrief>,
    /// How fast its twist can change; without, at once.
    pub limits: Option<LimitsBrief>,
    /// Where it starts.
    pub start: Pose,
    /// What is to be wrong with its sensors.
    #[serde(default, rename = "sensor_fault", skip_serializing_if = "Vec::is_empty")]
    pub sensor_faults: Vec<SensorFault>,
    /// What is to be wrong with its wheels.
    #[serde(default, rename = "wheel_fault", skip_serializing_if = "Vec::is_empty")]
    pub wheel_faults: Vec<WheelFault>,
    /// What is to be wrong with its commands.
    #[serde(default, rename = "command_fault", skip_serializing_if = "Vec::is_empty")]
    pub command_faults: Vec<LinkFault>,
}

/// What the plant is told.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct PlantBrief {
    /// The form that this is in.
    pub format: Format,
    /// Where the files shared by this run live.
    pub run_root: PathBuf,
    /// How time passes.
    pub pace: Pace,
    /// The run ends at this time, ns.
    pub duration_ns: u64,
    /// Lockstep: length of a tick, ns.
    pub period_ns: u64,
    /// Real time: longest arc, and period of odometry and truth, ns.
    pub plant_tick_ns: u64,
    /// H: a command may act until the stamp it answers plus this, ns.
    pub command_lifetime_ns: u64,
    /// d, m: nearer pairs are counted.
    pub distance_min_m: f64,
    /// Speed limit of every front point, m/s; absent where commands are taken literally.
    pub speed_max_m_s: Option<f64>,
    /// Robots within this distance are reported in odometry, m.
    pub sensing_radius_m: f64,
    /// Their velocities are reported as well: the avoidance method asks for them.
    #[serde(default)]
    pub velocities_sensed: bool,
    /// The clearance, m: front points nearer to an obstacle are counted.
    #[serde(default, skip_serializing_if = "is_zero")]
    pub clearance_m: f64,
    /// Where a program of the scenario's own moves the robots.
    pub program: Option<PlantProgramBrief>,
    /// The convex parts of all walls and obstacles.
    #[serde(default, rename = "obstacle", skip_serializing_if = "Vec::is_empty")]
    pub obstacles: Vec<Obstacle>,
    /// The robots, in scenario order.
    #[serde(rename = "robot")]
    pub robots: Vec<BodyBrief>,
}

/// What the bridge of one host is told, where a run has several.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct BridgeBrief {
    /// The form that this is in.
    pub format: Format,
    /// Where the files shared by this host's share of the run live.
    pub run_root: PathBuf,
    /// Hash of the scenario and the fleet file, which must be the same on all hosts: 16 hex digits.
    pub experiment: String,
    /// This host, by its place among the hosts from 0.
    pub here: usize,
    /// The plant's host.
    pub plant: usize,
    /// An odometry sample or a command older than this is dropped, ns: the command's lifetime.
    pub odometry_age_ns_max: u64,
    /// A beacon older than this is dropped, ns: whoever sent it counts as lost.
    pub beacon_age_ns_max: u64,
    /// How long hosts wait for each other before the run, ns.
    pub join_within_ns: u64,
    /// Another host that was not heard for this long is unreachable, ns.
    pub unreachable_after_ns: u64,
    /// Without a sign of the plant's host for this long the share ends, ns.
    pub silence_ns_max: u64,
    /// tcp or udp; with certificates TLS, over TCP.
    pub transport: String,
    /// The certificates of mutual TLS, if there are any.
    pub certificates: Option<CertificatesBrief>,
    /// All hosts.
    #[serde(rename = "host")]
    pub hosts: Vec<HostBrief>,
    /// All robots, in scenario order.
    #[serde(rename = "robot")]
    pub robots: Vec<BridgedBrief>,
    /// When hosts cannot hear each other.
    #[serde(default, rename = "partition", skip_serializing_if = "Vec::is_empty")]
    pub partitions: Vec<PartitionBrief>,
}

/// Certificates in files, in PEM.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct CertificatesBrief {
    /// Of the authority that signed those of all hosts.
    pub authority: PathBuf,
    /// This host's, whose common name is the host's name.
    pub certificate: PathBuf,
    /// Its private key.
    pub key: PathBuf,
}

/// One host.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct HostBrief {
    /// Its name.
    pub name: String,
    /// Where its bridge listens, as `ADDRESS:PORT`.
    pub address: String,
}

/// One robot, as a bridge knows it.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct BridgedBrief {
    /// Its name.
    pub name: String,
    /// Its host's place.
    pub host: usize,
    /// The hosts of those that hear it, without its own.
    pub heard_on: Vec<usize>,
    /// How many robots it hears.
    pub hears: usize,
}

impl BridgeBrief {
    /// Returns whether a planned partition separates two hosts at a run time, ns.
    pub fn are_apart(&self, a: usize, b: usize, t_ns: u64) -> bool {
        let is_inside = |hosts: &[usize], host: usize| hosts.contains(&host);
        self.partitions.iter().any(|partition| {
            partition.span.holds(t_ns)
                && is_inside(&partition.hosts, a) != is_inside(&partition.hosts, b)
        })
    }
}

/// A time in which some hosts and the others cannot hear each other.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct PartitionBrief {
    /// Those on one side, by their places.
    pub hosts: Vec<usize>,
    /// When.
    pub span: Span,
}

/// Why a brief could not be read or written.
#[derive(Debug, thiserror::Error)]
#[expect(missing_docs, reason = "the messages say what the fields are")]
pub enum BriefError {
    /// The file could not be read.
    #[error("cannot read the brief {path}: {source}")]
    Read { path: PathBuf, source: std::io::Error },
    /// Another build wrote it.
    #[error(
        "{path} has {found}, and this program reads format {FORMAT}: whoever wrote it is of another \
         build; start supervisor, agents and plant from the same one"
    )]
    Format { path: PathBuf, found: String },
    /// The file's content is no such brief.
    #[error("{path} is not a brief: {source}")]
    Parse { path: PathBuf, source: Box<toml::de::Error> },
    /// It says what no process can do.
    #[error("{path} cannot be followed: {flaw}")]
    Unsound { path: PathBuf, flaw: String },
}

/// An [`AgentBrief`] or a [`PlantBrief`].
pub trait Brief: DeserializeOwned + Serialize {
    /// What is wrong with it beyond its form, if anything: on a real robot a person wrote it.
    fn flaw(&self) -> Option<String>;
}

impl Brief for AgentBrief {
    fn flaw(&self) -> Option<String> {
        let mut flaws = Flaws::default();
        let neighbors = self.neighbors.iter().map(|neighbor| ("neighbor.index", neighbor.index));
        let spares = self.spares.iter().map(|spare| ("spare.index", spare.index));
        for (key, place) in neighbors.chain(spares).chain([("index", self.index)]) {
            flaws.unless(place > 0, || format!("{key} is 0, expected 1 or more"));
        }
        if let Some(&DeputyBrief { rank, .. }) = self.deputy.as_ref() {
            let is_one = (1..=DEPUTIES_MAX).contains(&rank);
            flaws.unless(is_one, || format!("deputy.rank is {rank}, expected 1 to {DEPUTIES_MAX}"));
        }
        flaws.time("period_ns", self.period_ns);
        flaws.time("plant_tick_ns", self.plant_tick_ns);
        flaws.time("command_lifetime_ns", self.command_lifetime_ns);
        flaws.positive("front_point_m", self.front_point_m);
        let liars = self.gains.get(LIARS_MAX).copied().unwrap_or(0.0);
        flaws.unless(liars.fract() == 0.0, || {
            format!("gains.{LIARS_MAX} is {liars}, expected a whole number")
        });
        let avoidance = &self.avoidance;
        flaws.positive("avoidance.distance_min_m", avoidance.distance_min_m);
        flaws.not_negative("avoidance.sensing_error_m", avoidance.sensing_error_m);
        flaws.not_negative("avoidance.heading_error_rad", avoidance.heading_error_rad);
        flaws.not_negative("avoidance.braking_time_max_s", avoidance.braking_time_max_s);
        flaws.not_negative("avoidance.clearance_m", avoidance.clearance_m);
        if let Some(limits) = &self.limits {
            flaws.limits("limits", limits);
            // Else it may need longer to brake than everybody reckons with.
            let (own, most) = (limits.braking_time_s, avoidance.braking_time_max_s);
            let [found, most_told] = told_apart(own, most);
            flaws.unless(own <= most, || {
                format!(
                    "limits.braking_time_s is {found}, expected at most \
                     avoidance.braking_time_max_s = {most_told}"
                )
            });
        }
        // Else the front point could leave its robot behind in one period: v_max T must be less than ell.
        // Where there is no speed limit nothing rests on it.
        let v_max = avoidance.speed_max_m_s;
        let most = self.front_point_m / (self.period_ns as f64 / 1e9);
        let sound = v_max > 0.0 && (v_max == f64::INFINITY || v_max < most);
        let [found, most] = told_apart(v_max, most);
        flaws.unless(sound, || {
            format!(
                "avoidance.speed_max_m_s is {found}, expected more than 0 and less than \
                 front_point_m / period = {most} m/s"
            )
        });
        flaws.first
    }
}

impl Brief for PlantBrief {
    fn flaw(&self) -> Option<String> {
        let mut flaws = Flaws::default();
        flaws.unless(!self.robots.is_empty(), || "there is no robot, expected one or more".into());
        flaws.time("period_ns", self.period_ns);
        flaws.time("plant_tick_ns", self.plant_tick_ns);
        flaws.time("command_lifetime_ns", self.command_lifetime_ns);
        flaws.time("duration_ns", self.duration_ns);
        flaws.positive("distance_min_m", self.distance_min_m);
        flaws.positive("speed_max_m_s", self.speed_max_m_s.unwrap_or(1.0));
        flaws.not_negative("clearance_m", self.clearance_m);
        for robot in &self.robots {
            flaws.positive("robot.front_point_m", robot.front_point_m);
            robot.limits.iter().for_each(|limits| flaws.limits("robot.limits", limits));
        }
        for obstacle in &self.obstacles {
            let (center, radius_m) = obstacle.bounding_circle();
            let finite = radius_m.is_finite() && radius_m >= 0.0;
            let finite = finite && center.iter().all(|coordinate| coordinate.is_finite());
            let convex = obstacle.check_convex();
            flaws.unless(finite && convex.is_ok(), || {
                let why =
                    convex.err().map_or("numbers that are none".into(), |why| why.to_string());
                format!("obstacle is {obstacle:?}, expected a convex one of finite numbers: {why}")
            });
        }
        flaws.first
    }
}

impl Brief for BridgeBrief {
    fn flaw(&self) -> Option<String> {
        let mut flaws = Flaws::default();
        let hosts = self.hosts.len();
        let mut known = |key: &str, host: usize| {
            let wrong = || format!("{key} is {host}, expected the place of one of {hosts} hosts");
            flaws.unless(host < hosts, wrong);
        };
        known("here", self.here);
        known("plant", self.plant);
        for robot in &self.robots {
            known("robot.host", robot.host);
            robot.heard_on.iter().for_each(|&host| known("robot.heard_on", host));
        }
        let apart = self.partitions.iter().flat_map(|partition| &partition.hosts);
        apart.for_each(|&host| known("partition.hosts", host));
        flaws.unless(u64::from_str_radix(&self.experiment, 16).is_ok(), || {
            format!("experiment is {:?}, expected 16 hex digits", self.experiment)
        });
        flaws.time("odometry_age_ns_max", self.odometry_age_ns_max);
        flaws.time("beacon_age_ns_max", self.beacon_age_ns_max);
        flaws.time("join_within_ns", self.join_within_ns);
        flaws.time("unreachable_after_ns", self.unreachable_after_ns);
        flaws.time("silence_ns_max", self.silence_ns_max);
        flaws.first
    }
}

/// A third of the time that 64 bits of ns hold: sums of two stay within. 194 years.
const TIME_NS_MAX: u64 = u64::MAX / 3;

/// Looks for what no process can live by, and keeps the first.
#[derive(Default)]
struct Flaws {
    first: Option<String>,
}

impl Flaws {
    fn unless(&mut self, sound: bool, flaw: impl FnOnce() -> String) {
        if !sound {
            self.first.get_or_insert_with(flaw);
        }
    }

    fn time(&mut self, key: &str, ns: u64) {
        let wrong = || format!("{key} is {ns}, expected 1 to {TIME_NS_MAX}");
        self.unless((1..=TIME_NS_MAX).contains(&ns), wrong);
    }

    fn positive(&mut self, key: &str, number: f64) {
        let wrong = || format!("{key} is {number}, expected a number above 0");
        self.unless(number.is_finite() && number > 0.0, wrong);
    }

    fn not_negative(&mut self, key: &str, number: f64) {
        let wrong = || format!("{key} is {number}, expected a number of 0 or more");
        self.unless(number.is_finite() && number >= 0.0, wrong);
    }

    fn limits(&mut self, path: &str, limits: &LimitsBrief) {
        self.positive(&format!("{path}.acceleration_m_s2"), limits.acceleration_m_s2);
        let turn = limits.turn_acceleration_rad_s2;
        self.positive(&format!("{path}.turn_acceleration_rad_s2"), turn);
        self.not_negative(&format!("{path}.braking_time_s"), limits.braking_time_s);
    }
}

/// Maximum size of a brief, bytes: far more than 1,024 robots need. A larger file is refused.
const BRIEF_BYTES_MAX: u64 = 1 << 26;

/// Reads an [`AgentBrief`] or a [`PlantBrief`].
pub fn read<B: Brief>(path: &Path) -> Result<B, BriefError> {
    let text = regular_file::read_to_string(path, Links::Followed, BRIEF_BYTES_MAX)
        .map_err(|source| BriefError::Read { path: path.into(), source })?;
    parse(path, &text)
}

fn parse<B: Brief>(path: &Path, text: &str) -> Result<B, BriefError> {
    /// All that is asked of a text before it is known to be of this build's form.
    #[derive(Deserialize)]
    struct Formatted {
        format: Option<toml::Value>,
    }
    let found = match toml::from_str(text) {
        Ok(Formatted { format: None }) => Some("no format".to_owned()),
        Ok(Formatted { format: Some(toml::Value::Integer(format)) })
            if u64::try_from(format) == Ok(FORMAT) =>
        {
            None
        }
        Ok(Formatted { format: Some(other) }) => Some(format!("format {other}")),
        Err(_) => None, // it is no TOML, which is said below
    };
    if let Some(found) = found {
        return Err(BriefError::Format { path: path.into(), found });
    }
    let brief: B = toml::from_str(text)
        .map_err(|source| BriefError::Parse { path: path.into(), source: Box::new(source) })?;
    match brief.flaw() {
        None => Ok(brief),
        Some(flaw) => Err(BriefError::Unsound { path: path.into(), flaw }),
    }
}

/// The version of the phalanx that wrote the brief of a program, if it says so: whatever else is in
/// it, and however that is meant.
pub fn writer(path: &Path) -> Option<String> {
    let text = regular_file::read_to_string(path, Links::Followed, BRIEF_BYTES_MAX).ok()?;
    let told: toml::Table = text.parse().ok()?;
    Some(told.get("program")?.get("phalanx")?.as_str()?.to_owned())
}

fn is_false(truth: &bool) -> bool {
    !truth
}

fn is_none(ns: &u64) -> bool {
    *ns == 0
}

/// The text of a brief.
pub fn to_text<B: Serialize>(brief: &B) -> String {
    toml::to_string(brief).expect("a brief has string keys and no empty values")
}

#[cfg(test)]
mod tests;
