//! Briefs for tests.

use std::path::PathBuf;

use protocol::brief::{BridgeBrief, BridgedRobotBrief, FormatVersion, HostBrief};

/// Returns a robot on the host with index `host`, whose beacons are received on the hosts `heard_on`.
pub fn robot(name: &str, host: usize, heard_on: &[usize]) -> BridgedRobotBrief {
    BridgedRobotBrief {
        name: name.into(),
        host,
        heard_on: heard_on.into(),
        hears: 1,
        message_bytes_max: 0,
    }
}

/// Returns the brief of the first of these hosts, which has the plant; without certificates and partitions.
pub fn brief(hosts: &[HostBrief], robots: impl Into<Vec<BridgedRobotBrief>>) -> BridgeBrief {
    BridgeBrief {
        format: FormatVersion,
        run_root: PathBuf::new(),
        experiment: "0".repeat(16),
        here: 0,
        plant: 0,
        odometry_age_ns_max: 1,
        beacon_age_ns_max: 1,
        join_within_ns: 1,
        unreachable_after_ns: 1,
        silence_ns_max: 1,
        transport: "tcp".into(),
        records_messages: false,
        certificates: None,
        hosts: hosts.to_vec(),
        robots: robots.into(),
        partitions: Vec::new(),
    }
}
