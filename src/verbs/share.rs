//! `phalanx run --fleet` on a host without the plant: runs its robots and its bridge until the plant's host
//! ends the run.

use std::path::Path;

use experiment::scenario::Scenario;
use outcome::results::host_dir::HostDir;
use outcome::results::programs::Programs;
use outcome::results::run_dir::{RunDirError, RunLocation};
use protocol::process::{exit, never_block_on_stderr};
use supervisor::run::RunError;
use supervisor::run::hosts::share::{self, HostEnd};
use supervisor::spawn::Launcher;

use super::fleet::HostPart;
use super::screen::{print, print_failure, print_info, print_misuse};

/// Runs this host's part of the run into a new directory, and returns the exit code.
pub(super) fn run_host_part(
    scenario: &Scenario,
    text: &str,
    part: &HostPart,
    programs: &Programs,
    location: &RunLocation,
    launcher: &Launcher,
) -> Result<u8, u8> {
    let stop = super::stop_flag_on_signals().map_err(|error| print_failure(&error))?;
    never_block_on_stderr();
    let create_host_dir = |out: &Path| {
        let host_dir = HostDir::create(out)?;
        host_dir.write_scenario(text)?;
        host_dir.write_fleet(&part.fleet_text)?;
        Ok(host_dir)
    };
    let created = location.create_with(create_host_dir).and_then(|created| {
        created.1.write_programs(programs)?;
        Ok(created)
    });
    let (out, host_dir) = created.map_err(|error| match error {
        RunDirError::Exists(_) => print_misuse(&error),
        _ => print_failure(&error),
    })?;
    let (own_host, plant_host) = (part.brief.here, part.brief.plant);
    let name = |host: usize| part.brief.hosts[host].name.clone();
    let (own_host, plant_host) = (name(own_host), name(plant_host));
    print_info(&format!("host {own_host}: waiting for the plant's host {plant_host}"));
    match share::run(scenario, part.brief.clone(), launcher, &host_dir, &stop) {
        Ok(HostEnd::RunEnded) => Ok(print(&format!(
            "{}, host {own_host}: the run has ended; its results are on {plant_host}\nlogs are in {}\n",
            scenario.name,
            out.display()
        ))),
        Ok(HostEnd::Interrupted) | Err(RunError::Interrupted { .. }) => Err(exit::INTERRUPTED),
        Err(error) => Err(print_failure(&error)),
    }
}
