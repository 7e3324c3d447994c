//! What the process is told that shows a run to ROS 2, and what it and a recording write.
//!
//! | file | question it answers |
//! |---|---|
//! | `cdr` | how are numbers and strings laid out in a message of ROS 2? |
//! | `messages` | what is in the messages? |

pub mod cdr;
pub mod messages;

use std::net::SocketAddr;
use std::path::PathBuf;

use formation::obstacle::Obstacle;
use serde::{Deserialize, Serialize};

use crate::brief::{Brief, Format};

/// Its brief.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Ros2Brief {
    /// The form that this is in.
    pub format: Format,
    /// Where the files shared by this run live.
    pub run_root: PathBuf,
    /// Where it listens, or the router is that it connects to.
    pub address: SocketAddr,
    /// Whether it listens, and is the router that ROS 2 connects to.
    pub listens: bool,
    /// The ROS domain.
    pub domain: u32,
    /// From one message of a robot to its next, ns.
    pub period_ns: u64,
    /// Every robot, in scenario order.
    pub robots: Vec<String>,
    /// Who may be sent elsewhere: those whose role goes to a goal, on this host.
    #[serde(default, rename = "goal")]
    pub goals: Vec<GoalBrief>,
    /// No goal is nearer to walls and obstacles than this, m.
    #[serde(default)]
    pub clearance_m: f64,
    /// The convex parts of all walls and obstacles.
    #[serde(default)]
    pub obstacles: Vec<Obstacle>,
    /// The corners of each closed wall in order, m: a goal is on the same side of it as the start.
    #[serde(default)]
    pub closed_walls_m: Vec<Vec<[f64; 2]>>,
}

/// A robot that takes goals.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct GoalBrief {
    /// Its name.
    pub robot: String,
    /// Where its front point starts, m.
    pub start_m: [f64; 2],
}

impl Ros2Brief {
    /// Whether it may send this robot elsewhere.
    pub fn sends(&self, robot: &str) -> bool {
        self.goals.iter().any(|goal| goal.robot == robot)
    }
}

impl Brief for Ros2Brief {
    fn flaw(&self) -> Option<String> {
        (self.period_ns == 0).then(|| "period_ns is 0, expected 1 or more".into())
    }
}
