//! `phalanx run --fleet` on a host without the plant: its robots and its bridge, for as long as the plant's
//! host wants them.

use std::path::Path;

use experiment::scenario::Scenario;
use outcome::results::host_dir::HostDir;
use outcome::results::programs::Programs;
use outcome::results::run_dir::{RunDirError, RunLocation};
use protocol::process::{exit, never_block_on_stderr};
use supervisor::run::RunError;
use supervisor::run::hosts::share::{self, Ended};
use supervisor::spawn::Launcher;

use super::fleet::Part;
use super::screen::{complain, misused, print, tell};

/// Runs this host's share into a new directory; the exit code.
pub(super) fn run(
    scenario: &Scenario,
    text: &str,
    part: &Part,
    programs: &Programs,
    place: &RunLocation,
    launcher: &Launcher,
) -> Result<u8, u8> {
    let stop = super::stop().map_err(|error| complain(&error))?;
    never_block_on_stderr();
    let make = |out: &Path| {
        let host_dir = HostDir::create(out)?;
        host_dir.write_scenario(text)?;
        host_dir.write_fleet(&part.text)?;
        Ok(host_dir)
    };
    let made = place.create_with(make).and_then(|made| {
        made.1.write_programs(programs)?;
        Ok(made)
    });
    let (out, host_dir) = made.map_err(|error| match error {
        RunDirError::Exists(_) => misused(&error),
        _ => complain(&error),
    })?;
    let (here, plant) = (part.brief.here, part.brief.plant);
    let name = |host: usize| part.brief.hosts[host].name.clone();
    let (here, plant) = (name(here), name(plant));
    tell(&format!("host {here}: waiting for {plant}, which has the plant"));
    match share::run(scenario, part.brief.clone(), launcher, &host_dir, &stop) {
        Ok(Ended::WithTheRun) => Ok(print(&format!(
            "{}, host {here}: the run is over; what came out is on {plant}\nlogs are in {}\n",
            scenario.name,
            out.display()
        ))),
        Ok(Ended::Interrupted) | Err(RunError::Interrupted { .. }) => Err(exit::INTERRUPTED),
        Err(error) => Err(complain(&error)),
    }
}
