//! `phalanx run --fleet FLEET --host HOST`: this host's part of a run on several hosts.
//!
//! Requires the feature `bridge`; without it the flags exist, and report that it is missing.

use std::path::PathBuf;

use clap::Args;
use experiment::scenario::{FaultKind, Scenario};
use protocol::brief::BridgeBrief;
use protocol::process::exit;

use super::screen::print_failure;
pub(super) use super::with_bridge::FleetMember;

/// Fleet options of a run.
#[derive(Debug, Args)]
pub(super) struct FleetArgs {
    /// Run the scenario on several hosts in real time, as this fleet file assigns robots and plant to them.
    /// Run the same command with the same files and options on each host, with its own --host.
    #[arg(long, value_name = "FILE", requires = "host")]
    fleet: Option<PathBuf>,
    /// Name of this host in the fleet.
    #[arg(long, value_name = "NAME", requires = "fleet")]
    pub(super) host: Option<String>,
}

/// This host's part of a run on several hosts.
pub(super) struct HostPart {
    /// Configuration (brief) of the bridge, without its run root.
    pub(super) brief: BridgeBrief,
    /// Text of the fleet file.
    pub(super) fleet_text: String,
}

impl HostPart {
    /// Returns this host's part of a run. `effective_text` is the effective scenario text. On an error, prints it and
    /// returns the exit code.
    pub(super) fn new(
        member: FleetMember,
        scenario: &Scenario,
        effective_text: &str,
    ) -> Result<HostPart, u8> {
        let (brief, text) = member.brief_and_text(scenario, effective_text)?;
        Ok(HostPart { brief, fleet_text: text })
    }

    /// Returns whether the plant runs on this host.
    pub(super) fn has_plant(&self) -> bool {
        self.brief.here == self.brief.plant
    }
}

impl FleetArgs {
    /// Returns whether the run is on several hosts.
    pub(super) fn has_fleet(&self) -> bool {
        self.fleet.is_some()
    }

    /// Returns the fleet, or `None` for a run on one host. On an error, prints it and returns the exit
    /// code. `insecure` permits hosts without certificates.
    pub(super) fn read(&self, insecure: bool) -> Result<Option<FleetMember>, u8> {
        match (&self.fleet, &self.host) {
            (Some(path), Some(host)) => FleetMember::read(path, host, insecure).map(Some),
            _ => Ok(None),
        }
    }
}

/// Rejects a scenario with faults that need several hosts.
pub(super) fn reject_host_faults(scenario: &Scenario) -> Result<(), u8> {
    let partitioned_hosts = scenario.faults.iter().find_map(|fault| match &fault.kind {
        FaultKind::Partition { hosts } => Some(hosts.join(",")),
        _ => None,
    });
    partitioned_hosts.map_or(Ok(()), |hosts| {
        print_failure(&format_args!(
            "the fault `partition {hosts}` separates hosts, but this run has one: add `--fleet FILE --host \
             NAME`, or use `cut` and `loss` for links between robots"
        ));
        Err(exit::BAD_SCENARIO)
    })
}
