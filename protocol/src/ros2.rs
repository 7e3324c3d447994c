//! Brief of the ROS 2 process, and the messages that it and a recording write.
//!
//! | file | content |
//! |---|---|
//! | `cdr` | CDR encoding of numbers and strings |
//! | `messages` | encoding and decoding of ROS 2 messages |

pub mod cdr;
pub mod messages;

use std::net::SocketAddr;
use std::path::PathBuf;

use formation::obstacle::Obstacle;
use serde::{Deserialize, Serialize};

use crate::brief::{self, Brief, FormatVersion};

/// Configuration of the ROS 2 process.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Ros2Brief {
    /// Format of the brief.
    pub format: FormatVersion,
    /// Directory of the files that the processes of this run share.
    pub run_root: PathBuf,
    /// Address on which the bridge listens, or of the router to which it connects.
    pub address: SocketAddr,
    /// Whether the bridge listens as the router to which ROS 2 connects.
    pub listens: bool,
    /// ROS domain ID.
    pub domain: u32,
    /// Period of the messages of each robot, ns.
    pub period_ns: u64,
    /// All robots, in scenario order.
    pub robots: Vec<String>,
    /// Robots of this host that accept goals from outside.
    #[serde(default, rename = "goal")]
    pub goals: Vec<GoalBrief>,
    /// Minimum distance of a goal from walls and obstacles, m.
    #[serde(default)]
    pub clearance_m: f64,
    /// Convex parts of all walls and obstacles.
    #[serde(default)]
    pub obstacles: Vec<Obstacle>,
    /// Corners of each closed wall in order, m: a goal must be on the same side of it as the robot's start.
    #[serde(default)]
    pub closed_walls_m: Vec<Vec<[f64; 2]>>,
}

/// A robot that accepts goals.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct GoalBrief {
    /// Name of the robot.
    pub robot: String,
    /// Start position of the robot's front point, m.
    pub start_m: [f64; 2],
}

impl Ros2Brief {
    /// Returns whether this robot accepts goals from outside.
    pub fn accepts_goals(&self, robot: &str) -> bool {
        self.goals.iter().any(|goal| goal.robot == robot)
    }
}

impl Brief for Ros2Brief {
    fn from_table(table: toml::Table) -> Result<Self, toml::de::Error> {
        table.try_into()
    }

    fn to_toml(&self) -> String {
        brief::to_toml(self)
    }

    fn find_invalid_value(&self) -> Option<String> {
        (self.period_ns == 0).then(|| "period_ns is 0, expected 1 or more".into())
    }
}
