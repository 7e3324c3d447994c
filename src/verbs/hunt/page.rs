//! Records a run of a hunt as `phalanx run` does, by computing it again, and writes the page of the run found.

use std::fs;
use std::path::Path;

use experiment::campaign::file::Keep;
use experiment::scenario::Scenario;
use experiment::scenario::read::{Overrides, read_to_run};
use outcome::metrics::Metrics;
use outcome::results::manifest::{Build, Manifest};
use outcome::results::{checksums, page};
use protocol::brief::Pace;
use protocol::catalog::Catalog;
use protocol::process::exit;

use crate::verbs::cell_in_process::{begin, format_error, simulate_to_end};
use crate::verbs::execute::judge;

/// Writes the run of the scenario file `found` to the folder `to`, replacing its contents. `words` is a
/// sentence about the run, for the top of its page. Fails if the file is invalid or the folder cannot be
/// written.
pub(super) fn write(
    found: &Path,
    words: &str,
    to: &Path,
    catalog: &Catalog,
    build: &Build,
) -> Result<(), String> {
    let read = read_to_run(found, &Overrides::default(), catalog);
    let (scenario, text, _) = read.map_err(|diagnostic| diagnostic.message)?;
    record(&scenario, &text, found, to, build)?;
    checksums::write(to, to).map_err(format_error)?;
    page::write(to, &scenario, Some(format!("{words}."))).map(|_| ()).map_err(format_error)
}

/// Writes the run of a scenario from the file `from` to the folder `to`, replacing its contents. Fails if
/// the folder cannot be written.
pub(super) fn record(
    scenario: &Scenario,
    text: &str,
    from: &Path,
    to: &Path,
    build: &Build,
) -> Result<(), String> {
    let pace = Pace::Lockstep;
    let manifest = Manifest::collect(scenario, from, pace, build);
    let _ = fs::remove_dir_all(to);
    let mut run_dir = begin(scenario, text, &manifest, to, Keep::All).map_err(format_error)?;
    let mut metrics = Metrics::new(scenario, pace);
    let (mut outcome, ran) = simulate_to_end(scenario, &mut run_dir, &mut metrics, || true);
    ran.map_err(format_error)?;
    let judged = judge(scenario, pace, &metrics, &mut outcome, exit::OK, &mut run_dir);
    judged.unwritten.first().map_or(Ok(()), |error| Err(format_error(error)))
}
