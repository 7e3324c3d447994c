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
    let (scenario, ..) =
        read(&scenario, &Overrides::default(), catalog).map_err(|why| print_invalid_file(&why))?;
    let written = page::write_page(run_dir, &scenario, None).and_then(|written| {
        let animated = animate.as_ref().map(|path| page::write_animation(run_dir, &scenario, path));
        animated.transpose().map(|_| written)
    });
    let WrittenPage { path, cut_short_note: cut_short, damage, is_checked } =
        written.map_err(|error| print_failure(&error))?;
    let unchecked = (cut_short.is_none() && !is_checked)
        .then_some("its tables have no checksums to verify them");
    let why = cut_short.or(unchecked);
    let why = why.map_or(String::new(), |why| format!("{}: {why}\n", scenario.name));
    let printed = print(&format!("{why}written to {}\n", path.display()));
    let Some(damage) = damage else { return Ok(printed) };
    print_failure(&format_args!("{}: {damage}; the report shows this too", run_dir.display()));
    Err(exit::EXPECTATION_MISSED)
}
