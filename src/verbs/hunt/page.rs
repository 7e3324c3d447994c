//! Records a run of a hunt as `phalanx run` does, by computing it again, and writes the page of the run found.

use std::fs;
use std::path::Path;

use experiment::scenario::Scenario;
use outcome::metrics::Metrics;
use outcome::results::manifest::{BuildInfo, Manifest};
use outcome::results::page;
use outcome::results::programs::Programs;
use protocol::brief::Pace;
use protocol::process::{StopFlag, exit};
use supervisor::spawn::Launcher;

use crate::verbs::cell_in_process::{create_run_dir, format_error, simulate_to_end};
use crate::verbs::execute::evaluate_and_write;

/// Draws the figures and the page of a run in the folder `run_dir`. `description` is a sentence about the run, for the
/// top of its page.
pub(super) fn draw_run_page(
    scenario: &Scenario,
    description: &str,
    run_dir: &Path,
) -> Result<(), String> {
    page::write_page(run_dir, scenario, Some(format!("{description}.")))
        .map(|_| ())
        .map_err(format_error)
}

/// Writes the run of a scenario without programs, from the file `scenario_path`, to the folder `out_dir`, replacing
/// its contents. Fails if the folder cannot be written.
pub(super) fn record_run(
    scenario: &Scenario,
    text: &str,
    scenario_path: &Path,
    out_dir: &Path,
    build: &BuildInfo,
    launcher: &Launcher,
    stop: &StopFlag,
) -> Result<(), String> {
    let pace = Pace::Lockstep;
    let manifest = Manifest::collect(scenario, scenario_path, pace, build);
    let _ = fs::remove_dir_all(out_dir);
    let mut run_dir =
        create_run_dir(scenario, text, &manifest, out_dir, true, &Programs::default())
            .map_err(format_error)?;
    let mut metrics = Metrics::new(scenario, pace);
    let (mut outcome, result) = simulate_to_end(scenario, &mut run_dir, &mut metrics, || true);
    result.map_err(format_error)?;
    let end = (exit::OK, launcher, stop);
    let evaluation = evaluate_and_write(scenario, pace, &metrics, &mut outcome, end, &mut run_dir);
    evaluation.first_error().map_or(Ok(()), Err)
}
