//! `phalanx run --fleet FLEET --host HOST`: this host's part of a run on several.
//!
//! Built with the feature `bridge`; without, the flags are there and say so.

use std::path::PathBuf;

use clap::Args;
use experiment::scenario::{FaultKind, Scenario};
use protocol::brief::BridgeBrief;
use protocol::process::exit;

use super::screen::complain;

/// Where a scenario runs, if on several hosts.
#[derive(Debug, Args)]
pub(super) struct FleetArgs {
    /// Run the scenario on several hosts, in real time: which, and who lives where. Each of them needs this
    /// command with the same files and options, and a --host of its own.
    #[arg(long, value_name = "FILE", requires = "host")]
    fleet: Option<PathBuf>,
    /// Which host of the fleet this is.
    #[arg(long, value_name = "NAME", requires = "fleet")]
    pub(super) host: Option<String>,
}

/// This host's part of a run on several.
pub(super) struct Part {
    /// What its bridge is told, but for the run root.
    pub(super) brief: BridgeBrief,
    /// The fleet file.
    pub(super) text: String,
}

impl Part {
    /// Whether the plant is here.
    pub(super) fn has_plant(&self) -> bool {
        self.brief.here == self.brief.plant
    }
}

impl FleetArgs {
    /// Whether the run is on several hosts.
    pub(super) fn is_given(&self) -> bool {
        self.fleet.is_some()
    }

    /// The fleet, if the run is on one. Whatever is wrong with it is said, with an exit code. `insecure`:
    /// addresses may be open.
    pub(super) fn read(&self, insecure: bool) -> Result<Option<Member>, u8> {
        match (&self.fleet, &self.host) {
            (Some(path), Some(host)) => Member::read(path, host, insecure).map(Some),
            _ => Ok(None),
        }
    }
}

/// Refuses what only makes sense on several hosts.
pub(super) fn must_be_of_one_host(scenario: &Scenario) -> Result<(), u8> {
    let between = scenario.faults.iter().find_map(|fault| match &fault.kind {
        FaultKind::Partition { hosts } => Some(hosts.join(",")),
        _ => None,
    });
    between.map_or(Ok(()), |hosts| {
        complain(&format_args!(
            "the fault `partition {hosts}` is between hosts, and this run is on one: expected `--fleet FILE --host \
             NAME`, or `cut` and `loss` for links between robots"
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

    use super::Part;
    use crate::verbs::screen::{complain, misused, unsound};

    /// A fleet, and which of its hosts this is.
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

        /// What it sets in the scenario: H has room for the latency between hosts.
        pub(in crate::verbs) fn set(&self) -> Vec<String> {
            let latency_s = formation::seconds(self.fleet.latency_max_ns);
            vec![format!("realtime.between_hosts_s={latency_s:?}")]
        }

        /// This host's part of the run. `effective`: the scenario's text.
        pub(in crate::verbs) fn part(
            self,
            scenario: &Scenario,
            effective: &str,
        ) -> Result<Part, u8> {
            let brief = self.fleet.brief(self.here, scenario, effective);
            let brief = brief.map_err(|error: FleetError| {
                complain(&error);
                exit::BAD_SCENARIO
            })?;
            Ok(Part { brief, text: self.fleet.text })
        }
    }
}

#[cfg(not(feature = "bridge"))]
mod without_bridge {
    use std::path::Path;

    use experiment::scenario::Scenario;

    use super::Part;

    /// There is none.
    pub(in crate::verbs) enum Member {}

    impl Member {
        pub(super) fn read(_: &Path, _: &str, _: bool) -> Result<Member, u8> {
            Err(crate::verbs::needs_bridge())
        }

        pub(in crate::verbs) fn set(&self) -> Vec<String> {
            match *self {}
        }

        pub(in crate::verbs) fn part(self, _: &Scenario, _: &str) -> Result<Part, u8> {
            match self {}
        }
    }
}
