//! Descriptions of avoidance methods, for crates that may not depend on the crate `agent`.
//!
//! The methods live in `agent`. The supervisor must know their keys and derived figures, and the plant the
//! sensing radius and speed limit, without knowing a method: the binary passes the list, and briefs carry the
//! derived values.

use std::f64::consts::PI;
use std::fmt;

use formation::portable_math;

use crate::brief::{AgentBrief, AvoidanceBrief, YieldPriority};

/// Guarantee of a method on the distance between any two robots that use it.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum DistanceGuarantee {
    /// The method guarantees nothing.
    NoGuarantee,
    /// The distance is at least d under the assumptions of the method's paper, which no run fulfills completely (for
    /// example continuous time or no delay).
    UnderIdealAssumptions,
    /// The distance is at least d, also with delayed samples and with frozen or crashed robots.
    Unconditional,
}

/// Information that a method needs about neighbors in range.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum RequiredSensing {
    /// The method needs no information about neighbors.
    Nothing,
    /// Front points of all robots within the sensing radius.
    Positions,
    /// Front points and velocities of all robots within the sensing radius.
    PositionsAndVelocities,
}

/// A key of `[avoidance]` that only one method uses, and requires, with a positive value.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Gain {
    /// Key in the scenario, with a unit suffix.
    pub key: &'static str,
    /// Meaning of the key with its unit, as diagnostics print it.
    pub meaning: &'static str,
}

impl Gain {
    /// Returns a gain. The key is required with the method.
    pub const fn new(key: &'static str, meaning: &'static str) -> Gain {
        Gain { key, meaning }
    }
}

/// Values from which the figures of a method are computed.
#[derive(Debug, Clone, Copy)]
pub struct MethodConditions<'a> {
    /// Distances, speeds and gains.
    pub avoidance: &'a AvoidanceBrief,
    /// Control period (T), s.
    pub period_s: f64,
    /// Command timeout (H), s: the time for which a command may act.
    pub command_timeout_s: f64,
    /// Smallest front-point distance (ell) above 0 of all robots considered, m; 0 if all are controlled at the axle
    /// midpoint.
    pub front_point_m: f64,
    /// `true` if any robot considered drives along its heading only, so that it turns before it leaves its path.
    pub moves_along_heading: bool,
    /// Lowest priority of all robots considered.
    pub rank: YieldPriority,
}

impl<'a> MethodConditions<'a> {
    /// Returns the conditions of one robot.
    pub fn for_robot(brief: &'a AgentBrief) -> MethodConditions<'a> {
        MethodConditions {
            avoidance: &brief.avoidance,
            period_s: brief.period_ns as f64 / 1e9,
            command_timeout_s: brief.command_lifetime_ns as f64 / 1e9,
            front_point_m: brief.front_point_m,
            moves_along_heading: brief.drive().moves_along_heading(),
            rank: brief.rank,
        }
    }

    /// Returns the maximum error of the sensed distance to another front point, m: the error of reported
    /// positions plus the error of the own front point if the heading is not exact.
    pub fn distance_error_max_m(&self) -> f64 {
        let heading_rad = self.avoidance.heading_error_rad.min(PI);
        self.avoidance.sensing_error_m
            + 2.0 * self.front_point_m * portable_math::sin(0.5 * heading_rad)
    }

    /// Returns the highest speed limit of all other robots, m/s; 0 if there is no limit.
    pub fn others_speed_max_m_s(&self) -> f64 {
        let speeds_m_s = self.avoidance.classes.iter().map(|class| class.speed_max_m_s);
        match speeds_m_s.reduce(f64::max) {
            Some(speed_max_m_s) if speed_max_m_s.is_finite() => speed_max_m_s,
            Some(_) => 0.0,
            None => self.speed_max_m_s(),
        }
    }

    /// Returns the longest command timeout (H) of all robots of the team, s.
    pub fn team_command_timeout_max_s(&self) -> f64 {
        self.command_timeout_s.max(self.avoidance.command_timeout_max_s)
    }

    /// Returns the speed limit (v_max), m/s; 0 if there is no limit, in which case no figure depends on it.
    pub fn speed_max_m_s(&self) -> f64 {
        let speed_max_m_s = self.avoidance.speed_max_m_s;
        if speed_max_m_s.is_finite() { speed_max_m_s } else { 0.0 }
    }
}

/// A warning that a method would work badly.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct AvoidanceWarning {
    /// The key of `[avoidance]` that the warning is about.
    pub key: &'static str,
    /// Problem, with the values.
    pub message: String,
    /// Value that was expected instead.
    pub expected_value: String,
}

/// Name, requirements and guarantee of an avoidance method.
#[derive(Clone, Copy)]
pub struct AvoidanceDescription {
    /// Value of the key `kind`.
    pub name: &'static str,
    /// Publication in which the method is described.
    pub source: &'static str,
    /// Guarantee on distances.
    pub distance_guarantee: DistanceGuarantee,
    /// Guarantee as text, as `phalanx check` prints it.
    pub guarantee_text: &'static str,
    /// Assumptions of the guarantee as text; empty if there are none.
    pub assumptions_text: &'static str,
    /// Whether agent and plant limit every front point to `speed_max_m_s`, which is then required.
    pub clamps_speed: bool,
    /// Information that the method needs about neighbors in range.
    pub required_sensing: RequiredSensing,
    /// Whether the method needs a front point (ell > 0), because it inverts A(theta).
    pub needs_front_point: bool,
    /// Whether the method avoids walls and obstacles.
    pub avoids_walls: bool,
    /// Radius within which the method needs all robots to be sensed, m.
    pub sensing_radius_m: DerivedValue,
    /// Radius up to which the method can use sensed robots, m: the default sensing radius. `None`: the required radius.
    pub useful_radius_m: Option<DerivedValue>,
    /// Distance to another robot at which the method begins to steer: symbol and value, m. Two robots that are
    /// closer do not come to rest. (Remark 1) `None`: it never steers.
    pub steering_distance: Option<(&'static str, DerivedValue)>,
    /// Distance to a wall at which the method begins to steer: symbol and value, m.
    pub wall_steering_distance: Option<(&'static str, DerivedValue)>,
    /// Distance beyond d up to which the method may slow down a robot if any robot has inertia, m.
    pub slow_down_zone_m: Option<DerivedValue>,
    /// Extra standoff distance of a robot whose slot is occupied, as a fraction of the steering distance minus the
    /// distance of the slot from the other robot.
    pub standoff_excess: f64,
    /// Speed limit (v_max) above which the method brakes more than it helps, m/s.
    pub useful_speed_max_m_s: Option<DerivedValue>,
    /// Keys that only this method uses.
    pub gains: &'static [Gain],
    /// Returns a warning if the method would work badly under the given conditions.
    pub find_warning: fn(&MethodConditions<'_>) -> Option<AvoidanceWarning>,
}

/// A value derived from the conditions.
pub type DerivedValue = fn(&MethodConditions<'_>) -> f64;

impl AvoidanceDescription {
    /// A method that senses, limits and guarantees nothing. Other descriptions override its fields.
    pub const NO_AVOIDANCE: AvoidanceDescription = AvoidanceDescription {
        name: "",
        source: "",
        distance_guarantee: DistanceGuarantee::NoGuarantee,
        guarantee_text: "nothing",
        assumptions_text: "",
        clamps_speed: false,
        required_sensing: RequiredSensing::Nothing,
        needs_front_point: false,
        avoids_walls: false,
        sensing_radius_m: |_| 0.0,
        useful_radius_m: None,
        steering_distance: None,
        wall_steering_distance: None,
        slow_down_zone_m: None,
        standoff_excess: 0.0,
        useful_speed_max_m_s: None,
        gains: &[],
        find_warning: |_| None,
    };
}

impl PartialEq for AvoidanceDescription {
    fn eq(&self, other: &AvoidanceDescription) -> bool {
        self.name == other.name
    }
}

impl fmt::Debug for AvoidanceDescription {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("AvoidanceDescription").field("name", &self.name).finish_non_exhaustive()
    }
}
