//! How a control law describes itself to those that may not link it.
//!
//! The laws live in the crate `agent`; the supervisor must name them and their gains in its
//! diagnostics without knowing any of them. The binary hands it this list.

/// Key of the gain that says how many liars a robot leaves out on either side: F. A whole number.
pub const LIARS_MAX: &str = "liars_max";

/// What alpha*, and with it a robot's error, is made of.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Reference {
    /// A trajectory that the robot alone knows; it hears nobody. (25)
    Trajectory,
    /// Those it hears, and an offset from each. (13) (24) (45)
    Offsets,
    /// The middle of those it hears. (46)
    Middle,
    /// A place in `map` that the robot alone knows, whomever it hears.
    Goal,
}

impl Reference {
    /// Whether the robot alone knows it: nobody's silence takes it away.
    pub fn is_its_own(self) -> bool {
        match self {
            Reference::Trajectory | Reference::Goal => true,
            Reference::Offsets | Reference::Middle => false,
        }
    }
}

/// What a law makes of a robot, as those may know it that may not link the agent. Nobody asks for
/// its name: all follows from the other fields.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Role {
    /// The word for it in files.
    pub name: &'static str,
    /// What robots of this role do, as a list of them is headed.
    pub does: &'static str,
    /// What the error is measured against.
    pub reference: Reference,
    /// Whether offsets turn and grow with this robot's frame: one in a scenario at most.
    pub leads: bool,
    /// Whether avoidance has this robot make way for those that lead or keep a place. Comfort only:
    /// the promise about distances does not know of it.
    pub gives_way: bool,
}

impl Role {
    /// Follows the trajectory m(t); the formation turns and grows with it.
    pub const LEADER: Role = Role {
        name: "leader",
        does: "leads",
        reference: Reference::Trajectory,
        leads: true,
        gives_way: false,
    };
    /// Keeps its place in the formation.
    pub const FORMATION: Role = Role {
        name: "formation",
        does: "keep a place",
        reference: Reference::Offsets,
        leads: false,
        gives_way: false,
    };
    /// Goes into the leaders' hull.
    pub const CONTAINED: Role = Role {
        name: "contained",
        does: "are contained",
        reference: Reference::Middle,
        leads: false,
        gives_way: true,
    };
    /// Goes to a place of its own; nobody keeps a formation.
    pub const GOAL: Role = Role {
        name: "goal",
        does: "go to goals",
        reference: Reference::Goal,
        leads: false,
        gives_way: false,
    };
}

/// A law's name in scenario files and the gains it needs.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct LawDescription {
    /// Value of the key `law`.
    pub name: &'static str,
    /// What it makes of a robot.
    pub role: Role,
    /// Which of the chapter's equations it is.
    pub source: &'static str,
    /// Keys of its gains, with unit suffixes. All must be given, and positive.
    pub gains: &'static [&'static str],
    /// Whether it uses alpha*', which a robot knows by the published velocities of those it hears.
    pub feed_forward: bool,
    /// Key of the gain, in m/s, that bounds each component of what it adds to alpha*' (or to 0,
    /// without feed-forward): k in Lemma 1, mu in Proposition 2. `None`: no gain bounds it.
    pub correction_max: Option<&'static str>,
}
