//! How an avoidance method describes itself to those that may not link it.
//!
//! The methods live in the crate `agent`. The supervisor must know their keys and their figures, and
//! the plant what to sense and to limit, without knowing any of them: the binary hands over the
//! list, and briefs carry what follows from it.

use std::f64::consts::PI;
use std::fmt;

use formation::portable_math;

use crate::brief::{AgentBrief, AvoidanceBrief, Rank};

/// What a method promises about the distance of any two robots that use it.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Promise {
    /// Nothing.
    Nothing,
    /// d where its paper's assumptions hold, which no run fulfils in full: continuous time, say, or no
    /// delay.
    Ideal,
    /// d, whatever is sampled late, frozen or dead.
    Always,
}

/// What a method must know of the robots near.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Senses {
    /// Nothing.
    Nothing,
    /// The front points of all within its radius.
    Positions,
    /// Those, and how they move.
    Velocities,
}

/// A key of `[avoidance]` that one method alone needs; its value is positive.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Gain {
    /// The key, with a unit suffix.
    pub key: &'static str,
    /// What it is, with its unit, as diagnostics say it.
    pub meaning: &'static str,
    /// What it is where it is not given; `None`: it must be.
    pub otherwise: Option<f64>,
}

impl Gain {
    /// One that must be given.
    pub const fn needed(key: &'static str, meaning: &'static str) -> Gain {
        Gain { key, meaning, otherwise: None }
    }

    /// One that is `otherwise` where it is not given.
    pub const fn or(key: &'static str, otherwise: f64, meaning: &'static str) -> Gain {
        Gain { key, meaning, otherwise: Some(otherwise) }
    }
}

/// What the figures of a method follow from.
#[derive(Debug, Clone, Copy)]
pub struct Conditions<'a> {
    /// Distances, speeds and gains.
    pub avoidance: &'a AvoidanceBrief,
    /// T, s.
    pub period_s: f64,
    /// H: how long a command may act, s.
    pub lifetime_s: f64,
    /// ell, the smallest of all robots at hand, m.
    pub front_point_m: f64,
    /// The last of all robots at hand.
    pub rank: Rank,
}

impl<'a> Conditions<'a> {
    /// Those of one robot.
    pub fn of(brief: &'a AgentBrief) -> Conditions<'a> {
        Conditions {
            avoidance: &brief.avoidance,
            period_s: brief.period_ns as f64 / 1e9,
            lifetime_s: brief.command_lifetime_ns as f64 / 1e9,
            front_point_m: brief.front_point_m,
            rank: brief.rank,
        }
    }

    /// By how much the sensed distance to another front point may be off, m: by the error of reported
    /// positions, and by that of the own front point where the heading is not exact.
    pub fn distance_error_m(&self) -> f64 {
        let heading_rad = self.avoidance.heading_error_rad.min(PI);
        self.avoidance.sensing_error_m
            + 2.0 * self.front_point_m * portable_math::sin(0.5 * heading_rad)
    }

    /// The gain `key` of these, as given, or what it is otherwise. Panics if it is none of them.
    pub fn gain(&self, gains: &[Gain], key: &str) -> f64 {
        let otherwise =
            || gains.iter().find(|gain| gain.key == key).and_then(|gain| gain.otherwise);
        let given = self.avoidance.gains.get(key).copied();
        given.or_else(otherwise).unwrap_or_else(|| panic!("no gain {key}"))
    }

    /// v_max, m/s; 0 where there is no limit and nothing rests on it.
    pub fn speed_m_s(&self) -> f64 {
        let speed_max_m_s = self.avoidance.speed_max_m_s;
        if speed_max_m_s.is_finite() { speed_max_m_s } else { 0.0 }
    }
}

/// That a method would work badly.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Advice {
    /// Which key of `[avoidance]` it is about.
    pub key: &'static str,
    /// What is wrong, with the values.
    pub message: String,
    /// What was expected instead.
    pub expected: String,
}

/// A method's name in scenario files, what it needs and what it promises.
#[derive(Clone, Copy)]
pub struct AvoidanceDescription {
    /// Value of the key `kind`.
    pub name: &'static str,
    /// Where it is published.
    pub source: &'static str,
    /// What it promises.
    pub promise: Promise,
    /// The same in words, as `phalanx check` prints it.
    pub promises: &'static str,
    /// What that rests on, in words; empty where it rests on nothing.
    pub assumes: &'static str,
    /// Whether agent and plant limit every front point to `speed_max_m_s`, which must be given then.
    pub clamps_speed: bool,
    /// What it must know of the robots near.
    pub senses: Senses,
    /// Whether it keeps away from walls and obstacles.
    pub minds_walls: bool,
    /// Within this radius it must know everybody, m.
    pub sensing_radius_m: Figure,
    /// Farther than that it makes use of whom it knows within this radius, m: the default of what is
    /// sensed. `None`: no farther.
    pub useful_radius_m: Option<Figure>,
    /// The distance to another robot at which it begins to steer: its symbol, and its value, m.
    /// Two robots that are nearer do not come to rest. (Remark 1) `None`: it never steers.
    pub steers_within: Option<(&'static str, Figure)>,
    /// The same of a wall.
    pub steers_beside_walls: Option<(&'static str, Figure)>,
    /// Farther beyond d than this, m, nobody slows a robot down, where somebody has inertia.
    pub slow_down_zone_m: Option<Figure>,
    /// A robot that stands off from a place that is taken stays farther away than that distance, by
    /// this share of how far the place is within it.
    pub aside: f64,
    /// Above this v_max it brakes more than it helps, m/s.
    pub speed_cap_m_s: Option<Figure>,
    /// Its own keys.
    pub gains: &'static [Gain],
    /// Whether it would work badly under such conditions.
    pub advice: fn(&Conditions<'_>) -> Option<Advice>,
}

/// A number that follows from the conditions.
pub type Figure = fn(&Conditions<'_>) -> f64;

impl AvoidanceDescription {
    /// One that senses, limits and promises nothing: a row says what is different.
    pub const INERT: AvoidanceDescription = AvoidanceDescription {
        name: "",
        source: "",
        promise: Promise::Nothing,
        promises: "nothing",
        assumes: "",
        clamps_speed: false,
        senses: Senses::Nothing,
        minds_walls: false,
        sensing_radius_m: |_| 0.0,
        useful_radius_m: None,
        steers_within: None,
        steers_beside_walls: None,
        slow_down_zone_m: None,
        aside: 0.0,
        speed_cap_m_s: None,
        gains: &[],
        advice: |_| None,
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
