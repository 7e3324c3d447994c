//! Descriptions of control laws, for crates that may not depend on the crate `agent`.
//!
//! The laws live in `agent`; the supervisor must name them and their gains in diagnostics without knowing a law.
//! The binary passes the list.

use crate::law_message::MessageFormat;

/// Key of the gain with the maximum number of Byzantine in-neighbors (F), a whole number: the robot discards up
/// to this many values on either side.
pub const LIARS_MAX: &str = "liars_max";

/// Source of the reference (alpha*), and with it of a robot's error.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Reference {
    /// A trajectory that only the robot knows; it receives from no robot. (25)
    Trajectory,
    /// The front points of the robot's in-neighbors, each with an offset. (13) (24) (45)
    Offsets,
    /// The mean of the front points of the robot's in-neighbors. (46)
    Middle,
    /// A goal in `map` that only the robot knows.
    Goal,
    /// The target that the robot's law names at a sample, if it names one.
    Free,
}

impl Reference {
    /// Returns whether the reference is local: no lost neighbor removes it.
    pub fn is_local(self) -> bool {
        match self {
            Reference::Trajectory | Reference::Goal | Reference::Free => true,
            Reference::Offsets | Reference::Middle => false,
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
    pub does: &'static str,
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
        does: "leads",
        reference: Reference::Trajectory,
        leads: true,
        gives_way: false,
    };
    /// Formation robot: keeps its slot.
    pub const FORMATION: Role = Role {
        name: "formation",
        does: "keep a slot",
        reference: Reference::Offsets,
        leads: false,
        gives_way: false,
    };
    /// Follower (containment control): moves into the convex hull of the leaders.
    pub const CONTAINED: Role = Role {
        name: "contained",
        does: "stay in the hull",
        reference: Reference::Middle,
        leads: false,
        gives_way: true,
    };
    /// Goal robot: moves to a goal of its own, without a formation.
    pub const GOAL: Role = Role {
        name: "goal",
        does: "go to goals",
        reference: Reference::Goal,
        leads: false,
        gives_way: false,
    };
    /// Free robot: its law decides where it goes, and may name a target by which it is judged.
    pub const FREE: Role = Role {
        name: "free",
        does: "follow their own laws",
        reference: Reference::Free,
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
    /// Keys of the law's gains, with unit suffixes. All are required and positive.
    pub gains: &'static [&'static str],
    /// Whether the law uses the derivative of the reference (alpha*'), which a robot knows from the published
    /// velocities of its in-neighbors.
    pub feed_forward: bool,
    /// Key of the gain, in m/s, that bounds each component of its correction, which is added to alpha*' (or to 0
    /// without feed-forward): k in Lemma 1, mu in Proposition 2. `None` if no gain bounds it.
    pub correction_max: Option<&'static str>,
    /// Parameters of the law that its robots may change; `None` if it takes none.
    pub params: Option<&'static toml::Table>,
    /// Format of the messages that the law sends with its beacons; `None` if it sends none.
    pub message: Option<&'static MessageFormat>,
    /// Whether the law may withhold its beacon at a sample, as in event-triggered control.
    pub withholds: bool,
    /// Names of the signals that the law records, see [`crate::signals`].
    pub signals: &'static [&'static str],
}
