//! `phalanx clean`: removes the leftover files and processes of dead runs.

use clap::Args;
use protocol::process::exit;
use protocol::run_root;

use super::dead_runs;
use super::screen::{print, print_failure};

/// Arguments of `phalanx clean`.
#[derive(Debug, Args)]
pub struct CleanArgs {
    /// Print what would be removed, but remove nothing.
    #[arg(long)]
    dry_run: bool,
}

pub(super) fn clean(args: &CleanArgs) -> u8 {
    let (report, failures) = dead_runs::remove_dead_runs(&run_root::base_directory(), args.dry_run);
    let exit_code = print(&report);
    for failure in &failures {
        print_failure(failure);
    }
    if failures.is_empty() { exit_code } else { exit::INFRASTRUCTURE_FAILURE }
}
