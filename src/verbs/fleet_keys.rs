//! `phalanx fleet keys`: certificates for the hosts of a fleet.
//!
//! Requires the feature `bridge`; without it the subcommand exists, and reports that it is missing.

use std::path::PathBuf;

use clap::{Args, Subcommand};

use super::with_bridge::make_certificates;

/// Arguments of `phalanx fleet`.
#[derive(Debug, Args)]
pub struct FleetVerbArgs {
    #[command(subcommand)]
    act: FleetSubcommand,
}

#[derive(Debug, Subcommand)]
enum FleetSubcommand {
    /// Create certificates for the hosts of a fleet and an authority that signs them, in the folder that
    /// the fleet file names: ca.pem, HOST.pem and HOST.key. Existing files are kept.
    Keys(KeysArgs),
}

#[derive(Debug, Args)]
struct KeysArgs {
    /// Fleet file.
    #[arg(value_name = "FLEET")]
    fleet: PathBuf,
    /// Validity of the certificates, in days.
    #[arg(long, value_name = "DAYS", default_value_t = 365, value_parser = clap::value_parser!(u32).range(1..=3650))]
    days: u32,
}

/// Runs the fleet subcommand and returns the exit code.
pub(super) fn run_fleet_subcommand(args: &FleetVerbArgs) -> Result<u8, u8> {
    match &args.act {
        FleetSubcommand::Keys(KeysArgs { fleet, days }) => make_certificates(fleet, *days),
    }
}
