//! `phalanx fleet keys`: certificates for the hosts of a fleet.
//!
//! Requires the feature `bridge`; without it the subcommand exists, and reports that it is missing.

use std::path::PathBuf;

use clap::{Args, Subcommand};

/// Arguments of `phalanx fleet`.
#[derive(Debug, Args)]
pub struct FleetVerbArgs {
    #[command(subcommand)]
    act: Act,
}

#[derive(Debug, Subcommand)]
enum Act {
    /// Create certificates for the hosts of a fleet and an authority that signs them, in the folder that
    /// the fleet file names: ca.pem, HOST.pem and HOST.key. Existing files are kept.
    Keys(KeysArgs),
}

#[derive(Debug, Args)]
#[cfg_attr(
    not(feature = "bridge"),
    allow(dead_code, reason = "only read to say that it is of no use")
)]
struct KeysArgs {
    /// Fleet file.
    #[arg(value_name = "FLEET")]
    fleet: PathBuf,
    /// Validity of the certificates, in days.
    #[arg(long, value_name = "DAYS", default_value_t = 365, value_parser = clap::value_parser!(u32).range(1..=3650))]
    days: u32,
}

/// Runs the fleet subcommand and returns the exit code.
pub(super) fn fleet(args: &FleetVerbArgs) -> Result<u8, u8> {
    match &args.act {
        Act::Keys(args) => keys(args),
    }
}

#[cfg(feature = "bridge")]
fn keys(args: &KeysArgs) -> Result<u8, u8> {
    use bridge::certificates::{self, CertificatesError, Validity};
    use bridge::fleet;

    use super::screen::{complain, misused, print, unsound};

    let fleet = fleet::read(&args.fleet).map_err(|why| unsound(&why))?;
    let made = certificates::make(&fleet, Validity::for_days(args.days));
    let files = made.map_err(|error| match error {
        CertificatesError::NoFolder | CertificatesError::Exists(..) => misused(&error),
        _ => complain(&error),
    })?;
    let written: String = files.iter().map(|path| format!("{}\n", path.display())).collect();
    Ok(print(&format!(
        "{written}\neach host needs ca.pem and its own HOST.pem and HOST.key; keep each HOST.key on its host only\n"
    )))
}

#[cfg(not(feature = "bridge"))]
fn keys(_: &KeysArgs) -> Result<u8, u8> {
    Err(super::needs_bridge())
}
