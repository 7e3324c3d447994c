//! Broken robots: the cause and the distance from the slot.

use protocol::number::format_short;
use serde::Serialize;

use crate::scenario::Robot;
use crate::scenario::diagnostic::format_list;

/// Maximum number of robots that a line names.
const NAMES_MAX: usize = 24;

/// A broken robot: it ends off its slot.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct BrokenPrediction {
    /// Index of the robot in the scenario.
    pub robot: usize,
    /// Cause for which the robot ends off its slot.
    pub cause: BreakCause,
    /// Distance from its slot at which the robot settles, m. `None` if the moving formation leaves it behind.
    pub slot_distance_m: Option<f64>,
    /// Distance outside the convex hull of the robots that lead or keep a slot, m, if it should be inside.
    pub hull_distance_m: Option<f64>,
}

/// Cause for which a robot ends off its slot. Robots are indices in the scenario.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum BreakCause {
    /// The main leader has failed: no robot tracks the trajectory (Assumptions 3, 5).
    LeaderDead {
        /// Main leader.
        leader: usize,
    },
    /// The main leader is alive, but its information does not reach the robot (Assumptions 3, 5).
    LeaderUnreachable {
        /// Main leader.
        leader: usize,
    },
    /// The robot stops while the formation moves on, because it has no in-neighbor left.
    NoInNeighbor {
        /// Lost in-neighbor.
        lost_in_neighbor: usize,
    },
    /// The robot uses the last known position of a lost in-neighbor, which stays behind.
    UsesLastPosition {
        /// Lost in-neighbor.
        lost_in_neighbor: usize,
    },
    /// The leader reaches the robot, but it also uses an in-neighbor that is left behind.
    InNeighborLeftBehind {
        /// The in-neighbor that is left behind.
        in_neighbor: usize,
    },
    /// No robot that leads or keeps a slot reaches the robot, so its hull is empty (Assumption 4).
    Uncontained,
    /// The desired position of the robot is different without a lost in-neighbor.
    DesiredPositionChanged {
        /// Lost in-neighbor.
        lost_in_neighbor: usize,
    },
    /// The robot takes the slot of a lost leader.
    TakesLeaderSlot {
        /// Lost leader.
        leader: usize,
    },
    /// The robot follows an in-neighbor that is itself off its slot.
    FollowsBrokenRobot {
        /// The in-neighbor off its slot.
        in_neighbor: usize,
    },
    /// The desired position of the robot is closer to another robot than robots come to rest (Remark 1).
    SlotOccupied {
        /// Robot at the desired position.
        occupant: usize,
    },
    /// The desired position of another robot is too close to the slot of this one (Remark 1).
    SlotClaimed {
        /// Robot whose desired position is too close.
        claimant: usize,
    },
}

impl BreakCause {
    /// Returns the keyword of the cause in files, and the robot that it refers to.
    pub fn keyword_and_robot(self) -> (&'static str, Option<usize>) {
        match self {
            BreakCause::LeaderDead { leader } => ("leader-dead", Some(leader)),
            BreakCause::LeaderUnreachable { leader } => ("unled", Some(leader)),
            BreakCause::NoInNeighbor { lost_in_neighbor } => ("stops", Some(lost_in_neighbor)),
            BreakCause::UsesLastPosition { lost_in_neighbor } => ("kept", Some(lost_in_neighbor)),
            BreakCause::InNeighborLeftBehind { in_neighbor } => ("pulled", Some(in_neighbor)),
            BreakCause::Uncontained => ("uncontained", None),
            BreakCause::DesiredPositionChanged { lost_in_neighbor } => {
                ("without", Some(lost_in_neighbor))
            }
            BreakCause::TakesLeaderSlot { leader } => ("takes-place", Some(leader)),
            BreakCause::FollowsBrokenRobot { in_neighbor } => ("follows", Some(in_neighbor)),
            BreakCause::SlotOccupied { occupant } => ("place-taken", Some(occupant)),
            BreakCause::SlotClaimed { claimant } => ("crowded", Some(claimant)),
        }
    }

    /// Returns the cause as text that suits one or several robots. `name` returns the name of a robot.
    pub fn describe<'s>(self, name: impl Fn(usize) -> &'s str) -> String {
        match self {
            BreakCause::LeaderDead { leader } => format!("the leader {} is dead", name(leader)),
            BreakCause::LeaderUnreachable { leader } => {
                format!("not reached by the leader {}", name(leader))
            }
            BreakCause::NoInNeighbor { lost_in_neighbor } => {
                format!("no in-neighbor left without {}", name(lost_in_neighbor))
            }
            BreakCause::UsesLastPosition { lost_in_neighbor } => {
                format!("follows the last known point of {}", name(lost_in_neighbor))
            }
            BreakCause::InNeighborLeftBehind { in_neighbor } => {
                format!("held back by {}, which is left behind", name(in_neighbor))
            }
            BreakCause::Uncontained => {
                "an empty hull: no robot that leads or keeps a slot".to_owned()
            }
            BreakCause::DesiredPositionChanged { lost_in_neighbor } => {
                format!("another desired position without {}", name(lost_in_neighbor))
            }
            BreakCause::TakesLeaderSlot { leader } => {
                format!("backup leader in the slot of {}", name(leader))
            }
            BreakCause::FollowsBrokenRobot { in_neighbor } => {
                format!("in-neighbor {} is off its slot", name(in_neighbor))
            }
            BreakCause::SlotOccupied { occupant } => {
                format!("desired position occupied by {} (Remark 1)", name(occupant))
            }
            BreakCause::SlotClaimed { claimant } => {
                format!("desired position too close to that of {} (Remark 1)", name(claimant))
            }
        }
    }
}

/// A broken robot by name, as in files.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct BrokenRobot<'s> {
    /// Name of the robot.
    pub robot: &'s str,
    /// Keyword of the cause, as in [`BreakCause::keyword_and_robot`].
    pub cause: &'static str,
    /// Name of the robot that the cause refers to.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub by: Option<&'s str>,
    /// Distance from its slot at which the robot settles, m. `None` if the moving formation leaves it behind.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub off_m: Option<f64>,
    /// Distance outside the hull at which the robot settles, m, if it should be inside.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub outside_m: Option<f64>,
    /// The cause as a sentence.
    pub why: String,
}

impl BrokenPrediction {
    /// Returns the cause as text.
    pub fn describe<'s>(&self, name: impl Fn(usize) -> &'s str) -> String {
        let why = self.cause.describe(name);
        match self.hull_distance_m {
            Some(outside_m) => format!("{why}, {} m outside the hull", format_short(outside_m)),
            None => why,
        }
    }

    /// Returns the broken robot with the names of `robots`.
    pub fn with_names<'s>(&self, robots: &'s [Robot]) -> BrokenRobot<'s> {
        let name = |i: usize| robots[i].name.as_str();
        let (cause, by) = self.cause.keyword_and_robot();
        BrokenRobot {
            robot: name(self.robot),
            cause,
            by: by.map(name),
            off_m: self.slot_distance_m,
            outside_m: self.hull_distance_m,
            why: self.describe(name),
        }
    }
}

/// Returns the definition of a broken robot as text.
pub fn broken_definition_text(bound_m: f64) -> String {
    format!(
        "a robot is broken if, when the fault ends (a permanent one: at the end of the run), it is more than {} m \
         from its slot in the planned formation",
        format_short(bound_m)
    )
}

/// Returns one line for each cause with all its robots: `r1, r2: the leader r5 is dead`.
pub fn lines_by_cause<'a>(broken: impl IntoIterator<Item = (&'a str, String)>) -> Vec<String> {
    let mut lines: Vec<(String, Vec<&str>)> = Vec::new();
    for (robot, why) in broken {
        match lines.iter_mut().find(|(same, _)| *same == why) {
            Some((_, robots)) => robots.push(robot),
            None => lines.push((why, vec![robot])),
        }
    }
    lines
        .into_iter()
        .map(|(why, robots)| format!("{}: {why}", format_list(&robots, NAMES_MAX)))
        .collect()
}
