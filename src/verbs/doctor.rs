//! `phalanx doctor`: checks that this machine can run experiments.

use clap::Args;
use protocol::process::exit;

mod examine;

use super::screen::{OutputFormat, print_result};
use outcome::results::summary::to_json;

/// Arguments of `phalanx doctor`.
#[derive(Debug, Args)]
pub struct DoctorArgs {
    /// Number of robots to check for.
    #[arg(long, value_name = "N", default_value_t = 8, value_parser = clap::value_parser!(u32).range(1..=100_000))]
    robots: u32,
    /// Output format.
    #[arg(long, value_enum, default_value_t = OutputFormat::Text)]
    output: OutputFormat,
}

pub(super) fn doctor(args: &DoctorArgs) -> u8 {
    let findings = examine::examine(args.robots as usize);
    let exit_code = print_result(
        args.output,
        &match args.output {
            OutputFormat::Text => examine::format_findings(&findings),
            OutputFormat::Json => to_json(&findings),
        },
    );
    if examine::has_error_finding(&findings) { exit::INFRASTRUCTURE_FAILURE } else { exit_code }
}
