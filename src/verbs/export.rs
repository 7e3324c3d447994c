//! `phalanx export`: converts a recording to CSV tables.

use std::path::PathBuf;

use clap::Args;
use outcome::recording::export::{ExportError, ExportResult, export as write_tables};
use protocol::process::exit;

use super::check_in_run_folder;
use super::screen::{print, print_failure};
use outcome::results::run_dir::RECORDING_FILE;

/// Arguments of `phalanx export`.
#[derive(Debug, Args)]
pub struct ExportArgs {
    /// Run directory, or a recording.
    #[arg(value_name = "RUN_DIR|FILE")]
    run: PathBuf,
    /// Directory for the tables; must not exist [default: RUN_DIR/export, or FILE with -export in place of
    /// its extension].
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
    /// Export the valid records of a recording that is corrupt, truncated, or not of this run.
    #[arg(long)]
    allow_damage: bool,
}

pub(super) fn export(args: &ExportArgs) -> Result<u8, u8> {
    let (file, out) = if args.run.is_dir() {
        (args.run.join(RECORDING_FILE), args.run.join("export"))
    } else {
        let stem = args.run.file_stem().unwrap_or_default().to_string_lossy();
        (args.run.clone(), args.run.with_file_name(format!("{stem}-export")))
    };
    check_in_run_folder(&file)?;
    let out = args.out.clone().unwrap_or(out);
    match write_tables(&file, &out, args.allow_damage) {
        Ok(ExportResult { tables, integrity }) => {
            if !integrity.is_complete() {
                tracing::warn!("{} is damaged: {integrity}; the rest is exported", file.display());
            }
            let rows = |(name, rows): &(&str, u64)| format!("{rows:>9} rows  {name}\n");
            let tables: String = tables.iter().map(rows).collect();
            Ok(print(&format!("{tables}written to {}\n", out.display())))
        }
        Err(error) => {
            let code = print_failure(&error);
            Err(match error {
                ExportError::DamagedRecording(..)
                | ExportError::OtherRecording { .. }
                | ExportError::MalformedMessage(..) => exit::EXPECTATION_MISSED,
                ExportError::Write(..) => code,
                _ => exit::USAGE_ERROR,
            })
        }
    }
}
