//! The page of what a hunt found: the run is computed once more, written down and drawn as `phalanx run` does.

use std::fmt::Display;
use std::fs;
use std::path::Path;

use experiment::scenario::read::{Overrides, read_to_run};
use outcome::metrics::Metrics;
use outcome::results::manifest::{Build, Manifest};
use outcome::results::run_dir::RunDir;
use outcome::results::{checksums, page};
use protocol::brief::Pace;
use protocol::catalog::Catalog;
use protocol::process::exit;

use crate::verbs::cell_in_process::to_the_end;
use crate::verbs::execute::judge;

/// Writes the run of the scenario file `found` into the folder `to`, in place of what was there. `words`: what happens
/// in it, in one sentence, which stands at the top of its page. An error says what could not be done.
pub(super) fn write(
    found: &Path,
    words: &str,
    to: &Path,
    catalog: &Catalog,
    build: &Build,
) -> Result<(), String> {
    let read = read_to_run(found, &Overrides::default(), catalog);
    let (scenario, text, _) = read.map_err(|diagnostic| diagnostic.message)?;
    let pace = Pace::Lockstep;
    let manifest = Manifest::collect(&scenario, found, pace, build);
    let _ = fs::remove_dir_all(to);
    let mut run_dir = RunDir::create(to, &scenario).map_err(said)?;
    run_dir.write_scenario(&text).map_err(said)?;
    run_dir.write_manifest(&manifest).map_err(said)?;
    run_dir.begin_recording(&text, &manifest).map_err(said)?;
    let mut metrics = Metrics::new(&scenario, pace);
    let (mut outcome, ran) = to_the_end(&scenario, &mut run_dir, &mut metrics, || true);
    ran.map_err(said)?;
    let judged = judge(&scenario, pace, &metrics, &mut outcome, exit::OK, &mut run_dir);
    judged.unwritten.first().map_or(Ok(()), |error| Err(said(error)))?;
    drop(run_dir);
    checksums::write(to, to).map_err(said)?;
    let path = page::write(to, &scenario).map_err(said)?.path;
    let html = fs::read_to_string(&path).map_err(said)?;
    let words = words.replace('&', "&amp;").replace('<', "&lt;");
    fs::write(&path, html.replacen("</h1>", &format!("</h1>\n<p>{words}.</p>"), 1)).map_err(said)
}

fn said(error: impl Display) -> String {
    error.to_string()
}
