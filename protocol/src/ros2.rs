//! What the process is told that shows a run to ROS 2.

use std::net::SocketAddr;
use std::path::PathBuf;

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
}

impl Brief for Ros2Brief {
    fn flaw(&self) -> Option<String> {
        (self.period_ns == 0).then(|| "period_ns is 0, expected 1 or more".into())
    }
}
