//! `phalanx report`: writes the figures and the page of a recorded run.

use std::path::PathBuf;

use clap::Args;
use protocol::catalog::Catalog;
use protocol::process::exit;

use super::screen::{print, print_failure, print_invalid_file, print_misuse};
use experiment::scenario::read::{Overrides, read};
use outcome::results::page::{self, WrittenPage};

/// Arguments of `phalanx report`.
#[derive(Debug, Args)]
pub struct ReportArgs {
    /// Run directory; figures and page of an earlier report are replaced.
    run_dir: PathBuf,
    /// Write the run also as an animated picture (SVG), for pages without scripts.
    #[arg(long, value_name = "FILE")]
    animate: Option<PathBuf>,
}

pub(super) fn report(
    ReportArgs { run_dir, animate }: &ReportArgs,
    catalog: &Catalog,
) -> Result<u8, u8> {
    let scenario = page::scenario_path(run_dir).map_err(|error| print_misuse(&error))?;
    // The run has already printed the warnings.
    let (scenario, ..) = read(&scenario, &Overrides::default(), catalog)
        .map_err(|error| print_invalid_file(&error))?;
    let result = page::write_page(run_dir, &scenario, None).and_then(|page| {
        let animation =
            animate.as_ref().map(|path| page::write_animation(run_dir, &scenario, path));
        animation.transpose().map(|_| page)
    });
    let WrittenPage { path, cut_short_note, damage, is_checked } =
        result.map_err(|error| print_failure(&error))?;
    let unchecked_note = (cut_short_note.is_none() && !is_checked)
        .then_some("its tables have no checksums to verify them");
    let note = cut_short_note.or(unchecked_note);
    let note = note.map_or(String::new(), |note| format!("{}: {note}\n", scenario.name));
    let exit_code = print(&format!("{note}written to {}\n", path.display()));
    let Some(damage) = damage else { return Ok(exit_code) };
    print_failure(&format_args!("{}: {damage}; the report shows this too", run_dir.display()));
    Err(exit::EXPECTATION_MISSED)
}
