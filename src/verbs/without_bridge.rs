//! Items of `with_bridge.rs` without the feature `bridge`: each reports that it is missing.

use std::net::SocketAddr;
use std::path::Path;

use clap::Subcommand;
use experiment::scenario::Scenario;
use protocol::brief::BridgeBrief;
use protocol::ros2::Ros2Brief;

use super::screen::print_misuse;

pub use NoBridgeRole as BridgeRole;
pub(super) use NoFleet as FleetMember;

/// Roles of processes that need the feature `bridge`: none without it.
#[derive(Debug, Subcommand)]
pub enum NoBridgeRole {}

impl NoBridgeRole {
    /// Runs a process in this role to its end, and returns its exit code.
    pub fn main(self) -> u8 {
        match self {}
    }
}

/// Uninhabited: without the feature `bridge` there is no fleet.
pub(super) enum NoFleet {}

impl NoFleet {
    pub(super) fn read(_: &Path, _: &str, _: bool) -> Result<NoFleet, u8> {
        Err(report_missing_bridge())
    }

    pub(super) fn scenario_overrides(&self) -> Vec<String> {
        match *self {}
    }

    pub(super) fn brief_and_text(self, _: &Scenario, _: &str) -> Result<(BridgeBrief, String), u8> {
        match self {}
    }
}

pub(super) fn make_certificates(_: &Path, _: u32) -> Result<u8, u8> {
    Err(report_missing_bridge())
}

pub(super) fn ros2_brief(
    _: &Scenario,
    _: SocketAddr,
    _: bool,
    _: u32,
    _: f64,
) -> Result<Ros2Brief, u8> {
    Err(report_missing_bridge())
}

/// Reports that several hosts and ROS 2 are not built in, and returns the exit code.
fn report_missing_bridge() -> u8 {
    print_misuse(
        &"this phalanx was built without support for several hosts and ROS 2: rebuild it with `--features bridge`, as in \
          `cargo install --path . --features bridge`",
    )
}
