//! Parts of the program that need the feature `bridge`: several hosts, and ROS 2. `without_bridge.rs` is in its place
//! without the feature, with the same items.

use std::net::{SocketAddr, TcpListener};
use std::path::{Path, PathBuf};

use bridge::certificates::{self, CertificatesError, Validity};
use bridge::fleet::{self, Fleet, FleetError};
use bridge::ros2::names;
use clap::Subcommand;
use experiment::scenario::Scenario;
use protocol::brief::BridgeBrief;
use protocol::process::exit;
use protocol::ros2::Ros2Brief;

use super::screen::{print, print_failure, print_invalid_file, print_misuse};

/// Roles of processes that need the feature `bridge`.
#[derive(Debug, Subcommand)]
pub enum BridgeRole {
    /// Run the network bridge between the hosts of a run that is in progress.
    #[command(hide = true)]
    Bridge {
        /// Configuration file (brief) of the bridge.
        brief: PathBuf,
        /// Run with SCHED_FIFO priority and locked memory.
        #[arg(long)]
        realtime_priority: bool,
    },
    /// Publish a run that is in progress to ROS 2.
    #[command(hide = true)]
    Ros2 {
        /// Configuration file (brief) of the ROS 2 bridge.
        brief: PathBuf,
    },
}

impl BridgeRole {
    /// Runs a process in this role to its end, and returns its exit code.
    pub fn main(self) -> u8 {
        match self {
            BridgeRole::Bridge { brief, realtime_priority } => {
                bridge::process::main(&brief, realtime_priority)
            }
            BridgeRole::Ros2 { brief } => bridge::ros2::process::main(&brief),
        }
    }
}

/// A fleet, and the index of this host in it.
pub(super) struct FleetMember {
    fleet: Fleet,
    host_index: usize,
}

impl FleetMember {
    /// Reads a fleet file. On an error, prints it and returns the exit code. `insecure` permits hosts without
    /// certificates.
    pub(super) fn read(path: &Path, host: &str, insecure: bool) -> Result<FleetMember, u8> {
        let fleet = fleet::read(path).map_err(|error| print_invalid_file(&error))?;
        let host_index = fleet.find_host(host).and_then(|host_index| match insecure {
            true => Ok(host_index),
            false => fleet.check_certificates_configured().map(|()| host_index),
        });
        let host_index = host_index.map_err(|error| print_misuse(&error))?;
        Ok(FleetMember { fleet, host_index })
    }

    /// Returns the scenario keys that the fleet sets: the command timeout H includes the latency between hosts.
    pub(super) fn scenario_overrides(&self) -> Vec<String> {
        let latency_s = formation::ns_to_seconds(self.fleet.latency_max_ns);
        vec![format!("realtime.between_hosts_s={latency_s:?}")]
    }

    /// Returns the brief of this host's bridge, and the text of the fleet file. `effective_text` is the effective
    /// scenario text. On an error, prints it and returns the exit code.
    pub(super) fn brief_and_text(
        self,
        scenario: &Scenario,
        effective_text: &str,
    ) -> Result<(BridgeBrief, String), u8> {
        let brief = self.fleet.bridge_brief(self.host_index, scenario, effective_text);
        let brief = brief.map_err(|error: FleetError| {
            print_failure(&error);
            exit::BAD_SCENARIO
        })?;
        Ok((brief, self.fleet.text))
    }
}

/// Creates the certificates for the hosts of a fleet file, valid for `days`. Returns the exit code.
pub(super) fn make_certificates(fleet: &Path, days: u32) -> Result<u8, u8> {
    let fleet = fleet::read(fleet).map_err(|error| print_invalid_file(&error))?;
    let result = certificates::create_certificates(&fleet, Validity::for_days(days));
    let files = result.map_err(|error| match error {
        CertificatesError::NoFolder | CertificatesError::Exists(..) => print_misuse(&error),
        _ => print_failure(&error),
    })?;
    let paths: String = files.iter().map(|path| format!("{}\n", path.display())).collect();
    Ok(print(&format!(
        "{paths}\neach host needs ca.pem and its own HOST.pem and HOST.key; keep each HOST.key on its host only\n"
    )))
}

/// Returns the brief of the ROS 2 bridge that `listens` at an address, or connects to it, and publishes at `hz`. It
/// has no goals and no run root. On an error, prints it and returns the exit code.
pub(super) fn ros2_brief(
    scenario: &Scenario,
    address: SocketAddr,
    listens: bool,
    domain: u32,
    hz: f64,
) -> Result<Ros2Brief, u8> {
    let robots: Vec<String> = scenario.robots.iter().map(|robot| robot.name.clone()).collect();
    if let Some(name) = robots.iter().find(|name| !names::is_valid_name(name)) {
        return Err(print_misuse(&format_args!(
            "robot name {name} is not valid in ROS 2: it must have letters, digits and single underscores only, and no digit first"
        )));
    }
    // Checked before anything is written or spawned, because the port may be in use.
    if listens && let Err(error) = TcpListener::bind(address) {
        return Err(print_failure(&format_args!("cannot listen at {address}: {error}")));
    }
    Ok(Ros2Brief {
        format: protocol::brief::FormatVersion,
        run_root: PathBuf::new(),
        address,
        listens,
        domain,
        period_ns: (1e9 / hz) as u64,
        robots,
        goals: Vec::new(),
        clearance_m: scenario.avoidance.clearance_m,
        obstacles: scenario.walls.iter().map(|wall| wall.shape.clone()).collect(),
        closed_walls_m: scenario.closed_walls_m(),
    })
}
