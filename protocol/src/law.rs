//! Descriptions of control laws, for crates that may not depend on the crate `agent`.
//!
//! The laws live in `agent`; the supervisor must name them and their gains in diagnostics without knowing a law.
//! The binary passes the list.

use crate::law_message::MessageFormat;

/// Key of the gain with the maximum number of Byzantine in-neighbors (F), a whole number: the robot discards up
/// to this many values on either side.
pub const LIARS_MAX_KEY: &str = "liars_max";

/// Source of the reference (alpha*), and with it of a robot's error.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Reference {
    /// A trajectory that only the robot knows; it receives from no robot. (25)
    Trajectory,
    /// The front points of the robot's in-neighbors, each with an offset. (13) (24) (45)
    Offsets,
    /// The mean of the front points of the robot's in-neighbors. (46)
    NeighborMean,
    /// A goal in `map` that only the robot knows.
    Goal,
    /// The target that the robot's law names at a sample, if it names one.
    LawTarget,
}

impl Reference {
    /// Returns whether the reference is local: no lost neighbor removes it.
    pub fn is_local(self) -> bool {
        match self {
            Reference::Trajectory | Reference::Goal | Reference::LawTarget => true,
            Reference::Offsets | Reference::NeighborMean => false,
        }
    }
}

/// Role that a law gives to a robot, for crates that may not depend on `agent`. No code depends on the name: all
/// behavior follows from the other fields.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Role {
    /// Keyword in files.
    pub name: &'static str,
    /// Verb phrase for robots of this role, the heading of a list of them.
    pub verb_phrase: &'static str,
    /// Reference against which the error is measured.
    pub reference: Reference,
    /// Whether offsets rotate and scale with this robot's frame. At most one robot of a scenario has such a role.
    pub leads: bool,
    /// Whether avoidance makes this robot yield to leaders and to robots with a slot. It improves performance
    /// only: the guarantee on distances does not depend on it.
    pub gives_way: bool,
}

impl Role {
    /// Leader: follows the trajectory m(t). The formation rotates and scales with it.
    pub const LEADER: Role = Role {
        name: "leader",
        verb_phrase: "leads",
        reference: Reference::Trajectory,
        leads: true,
        gives_way: false,
    };
    /// Formation robot: keeps its slot.
    pub const FORMATION: Role = Role {
        name: "formation",
        verb_phrase: "keep a slot",
        reference: Reference::Offsets,
        leads: false,
        gives_way: false,
    };
    /// Follower (containment control): moves into the convex hull of the leaders.
    pub const CONTAINED: Role = Role {
        name: "contained",
        verb_phrase: "stay in the hull",
        reference: Reference::NeighborMean,
        leads: false,
        gives_way: true,
    };
    /// Goal robot: moves to a goal of its own, without a formation.
    pub const GOAL: Role = Role {
        name: "goal",
        verb_phrase: "go to goals",
        reference: Reference::Goal,
        leads: false,
        gives_way: false,
    };
    /// Free robot: its law decides where it goes, and may name a target, to which the metrics refer.
    pub const FREE: Role = Role {
        name: "free",
        verb_phrase: "follow their own laws",
        reference: Reference::LawTarget,
        leads: false,
        gives_way: false,
    };
}

/// Name and gains of a control law.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct LawDescription {
    /// Value of the key `law`.
    pub name: &'static str,
    /// Role that the law gives to a robot.
    pub role: Role,
    /// Equation of the chapter that the law implements.
    pub source: &'static str,
    /// Keys of the law's gains, with unit suffixes. All are required, and positive unless they have a range.
    pub gain_keys: &'static [&'static str],
    /// Lowest and highest value of gains that need not be positive, by key.
    pub gain_ranges: &'static [(&'static str, [f64; 2])],
    /// Whether the law uses the derivative of the reference (alpha*'), which a robot knows from the published
    /// velocities of its in-neighbors.
    pub feed_forward: bool,
    /// Key of the gain, in m/s, that bounds each component of its correction, which is added to alpha*' (or to 0
    /// without feed-forward): k in Lemma 1, mu in Proposition 2. `None` if no gain bounds it.
    pub correction_max: Option<&'static str>,
    /// Parameters of the law that its robots may change; `None` if it takes none.
    pub params: Option<&'static toml::Table>,
    /// Format of the messages that the law sends with its beacons; `None` if it sends none.
    pub message_format: Option<&'static MessageFormat>,
    /// Maximum number of messages of an in-neighbor that are kept between two calls of the law; 0 if it takes only the
    /// newest one.
    pub queued_messages_max: usize,
    /// Whether the law may withhold its beacon at a sample, as in event-triggered control.
    pub may_withhold_beacon: bool,
    /// Names of the signals that the law records, see [`crate::signals`].
    pub signals: &'static [&'static str],
}

impl LawDescription {
    /// Returns the lowest and the highest value of a gain; `None` for a gain that may have any value above 0.
    pub fn gain_range(&self, key: &str) -> Option<[f64; 2]> {
        self.gain_ranges.iter().find(|(name, _)| *name == key).map(|(_, range)| *range)
    }
}
