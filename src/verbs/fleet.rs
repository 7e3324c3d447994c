//! `phalanx run --fleet FLEET --host HOST`: this host's part of a run on several hosts.
//!
//! Requires the feature `bridge`; without it the flags exist, and report that it is missing.

use std::path::PathBuf;

use clap::Args;
use experiment::scenario::{FaultKind, Scenario};
use protocol::brief::BridgeBrief;
use protocol::process::exit;

use super::screen::complain;

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
    pub(super) text: String,
}

impl HostPart {
    /// Returns whether the plant runs on this host.
    pub(super) fn has_plant(&self) -> bool {
        self.brief.here == self.brief.plant
    }
}

impl FleetArgs {
    /// Returns whether the run is on several hosts.
    pub(super) fn is_given(&self) -> bool {
        self.fleet.is_some()
    }

    /// Returns the fleet, or `None` for a run on one host. On an error, prints it and returns the exit
    /// code. `insecure` permits hosts without certificates.
    pub(super) fn read(&self, insecure: bool) -> Result<Option<Member>, u8> {
        match (&self.fleet, &self.host) {
            (Some(path), Some(host)) => Member::read(path, host, insecure).map(Some),
            _ => Ok(None),
        }
    }
}

/// Rejects a scenario with faults that need several hosts.
pub(super) fn reject_host_faults(scenario: &Scenario) -> Result<(), u8> {
    let between = scenario.faults.iter().find_map(|fault| match &fault.kind {
        FaultKind::Partition { hosts } => Some(hosts.join(",")),
        _ => None,
    });
    between.map_or(Ok(()), |hosts| {
        complain(&format_args!(
            "the fault `partition {hosts}` separates hosts, but this run has one: add `--fleet FILE --host \
             NAME`, or use `cut` and `loss` for links between robots"
        ));
        Err(exit::BAD_SCENARIO)
    })
}

#[cfg(feature = "bridge")]
pub(super) use with_bridge::Member;
#[cfg(not(feature = "bridge"))]
pub(super) use without_bridge::Member;

#[cfg(feature = "bridge")]
mod with_bridge {
    use std::path::Path;

    use bridge::fleet::{self, Fleet, FleetError};
    use experiment::scenario::Scenario;
    use protocol::process::exit;

    use super::HostPart;
    use crate::verbs::screen::{complain, misused, unsound};

    /// A fleet, and the index of this host in it.
    pub(in crate::verbs) struct Member {
        fleet: Fleet,
        here: usize,
    }

    impl Member {
        pub(super) fn read(path: &Path, host: &str, insecure: bool) -> Result<Member, u8> {
            let fleet = fleet::read(path).map_err(|why| unsound(&why))?;
            let sound = fleet.host(host).and_then(|here| match insecure {
                true => Ok(here),
                false => fleet.must_be_secure().map(|()| here),
            });
            let here = sound.map_err(|error| misused(&error))?;
            Ok(Member { fleet, here })
        }

        /// Returns the scenario keys that the fleet sets: the command timeout H includes the latency between hosts.
        pub(in crate::verbs) fn set(&self) -> Vec<String> {
            let latency_s = formation::seconds(self.fleet.latency_max_ns);
            vec![format!("realtime.between_hosts_s={latency_s:?}")]
        }

        /// Returns this host's part of the run. `effective` is the effective scenario text.
        pub(in crate::verbs) fn part(
            self,
            scenario: &Scenario,
            effective: &str,
        ) -> Result<HostPart, u8> {
            let brief = self.fleet.brief(self.here, scenario, effective);
            let brief = brief.map_err(|error: FleetError| {
                complain(&error);
                exit::BAD_SCENARIO
            })?;
            Ok(HostPart { brief, text: self.fleet.text })
        }
    }
}

#[cfg(not(feature = "bridge"))]
mod without_bridge {
    use std::path::Path;

    use experiment::scenario::Scenario;

    use super::HostPart;

    /// Uninhabited: without the feature `bridge` there is no fleet.
    pub(in crate::verbs) enum Member {}

    impl Member {
        pub(super) fn read(_: &Path, _: &str, _: bool) -> Result<Member, u8> {
            Err(crate::verbs::needs_bridge())
        }

        pub(in crate::verbs) fn set(&self) -> Vec<String> {
            match *self {}
        }

        pub(in crate::verbs) fn part(self, _: &Scenario, _: &str) -> Result<HostPart, u8> {
            match self {}
        }
    }
}
