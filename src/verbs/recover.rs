//! `phalanx recover`: rebuilds the index of a truncated recording.

use std::path::PathBuf;

use clap::Args;
use outcome::recording::recover::{RecoverError, RecoverOutcome, recover as rebuild};
use protocol::process::exit;

use super::check_in_run_folder;
use super::screen::{print, print_failure, print_misuse};

/// Arguments of `phalanx recover`.
#[derive(Debug, Args)]
pub struct RecoverArgs {
    /// Recording to read; it is not modified. For a complete recording nothing is written.
    file: PathBuf,
    /// File for the recovered recording; must not exist [default: FILE with the extension .recovered.mcap].
    #[arg(long, value_name = "FILE")]
    out: Option<PathBuf>,
}

pub(super) fn recover(args: &RecoverArgs) -> Result<u8, u8> {
    check_in_run_folder(&args.file)?;
    let out = args.out.clone().unwrap_or_else(|| args.file.with_extension("recovered.mcap"));
    match rebuild(&args.file, &out) {
        Ok(RecoverOutcome::Complete { is_checked }) => {
            let limitation = match is_checked {
                true => "",
                false => {
                    ", as far as its checksums reach; an earlier version wrote it, and metadata and indexes have none"
                }
            };
            Ok(print(&format!(
                "{} is complete{limitation}: nothing to recover\n",
                args.file.display()
            )))
        }
        Ok(RecoverOutcome::Recovered(recovered)) => {
            match print(&format!("{recovered}written to {}\n", out.display())) {
                exit::OK if recovered.is_damaged() => Err(exit::EXPECTATION_MISSED),
                code => Ok(code),
            }
        }
        Err(error @ RecoverError::Write(..)) => Err(print_failure(&error)),
        Err(error) => Err(print_misuse(&error)),
    }
}
