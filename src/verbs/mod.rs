//! Subcommands of `phalanx`, one file each.
//!
//! Results go to stdout, all other output to stderr. The exit code states the outcome.
//!
//! | file | contents |
//! |---|---|
//! | `new` `run` `check` `schema` `report` `doctor` `clean` `recover` `export` `verify` | the subcommand of
//! that name |
//! | `fleet_keys` | `phalanx fleet keys`: certificates |
//! | `sweep` | runs a campaign; `cell`: one run of it; `cell_in_process`: without processes |
//! | `hunt` | searches for a run that misses an expectation, and shrinks it |
//! | `execute` | executes a valid scenario, evaluates and records it, for `run`, `cell` and `verify` |
//! | `fleet` `share` | this host's part of a run on several hosts |
//! | `with_bridge` `without_bridge` | what needs the feature `bridge`, and its replacement without it |
//! | `scenario` | reads the scenario argument with its overrides |
//! | `dead_runs` | finds and removes what earlier runs that died left behind |
//! | `screen` | terminal output: results, errors, the log, the progress bar |

mod cell;
mod cell_in_process;
mod check;
mod clean;
mod dead_runs;
mod doctor;
mod execute;
mod export;
mod fleet;
mod fleet_keys;
mod hunt;
mod new;
mod recover;
mod report;
mod ros2;
mod run;
mod scenario;
mod schema;
pub(crate) mod screen;
mod share;
mod sweep;
mod verify;
#[cfg_attr(not(feature = "bridge"), path = "without_bridge.rs")]
pub mod with_bridge;

use std::path::{Path, PathBuf};

use clap::Subcommand;
use experiment::scenario::file::check_inside_folder;
use protocol::catalog::Catalog;
use protocol::process::{StopFlag, fail_at_file_size_limits, limit_iceoryx2_log};
use protocol::run_root;

use outcome::results::manifest::BuildInfo;
use supervisor::spawn::Launcher;

pub(crate) use screen::print;

/// Error that ends a subcommand.
type Failure = Box<dyn std::error::Error>;

/// Returns the stop flag that SIGINT and SIGTERM set. A second signal ends the process at once.
fn stop_flag_on_signals() -> Result<StopFlag, String> {
    StopFlag::for_run_ending_signals().map_err(|error| format!("cannot handle signals: {error}"))
}

/// User-facing subcommands.
#[derive(Debug, Subcommand)]
pub enum Verb {
    /// Create a folder with a starter scenario, its JSON Schema and a control law.
    New(new::NewArgs),
    /// Run a scenario, with one process for each robot.
    Run(Box<run::RunArgs>),
    /// Run a campaign: one scenario many times, with the variations of the campaign file.
    Sweep(sweep::SweepArgs),
    /// Search for a run that misses an expectation (falsification), and shrink it to the simplest one.
    Hunt(hunt::HuntArgs),
    /// Validate a scenario, and print what theory predicts for it.
    Check(check::CheckArgs),
    /// Print the JSON Schema of scenario files, for editors and other programs.
    Schema(schema::SchemaArgs),
    /// Draw the figures of a recorded run and write its report page.
    Report(report::ReportArgs),
    /// Check that this machine can run experiments, and suggest fixes.
    Doctor(doctor::DoctorArgs),
    /// Remove the leftover files and processes of runs whose supervisor has exited.
    Clean(clean::CleanArgs),
    /// Rebuild the index of a truncated recording, in a new file.
    Recover(recover::RecoverArgs),
    /// Convert a recording to CSV tables, one for each message type.
    Export(export::ExportArgs),
    /// Prepare a fleet of hosts for a run.
    #[cfg_attr(not(feature = "bridge"), command(hide = true))]
    Fleet(fleet_keys::FleetVerbArgs),
    /// Repeat a recorded lockstep run, and check that the result is bit-identical.
    Verify(verify::VerifyArgs),
}

/// Runs a subcommand and returns the exit code. `catalog` lists the laws, methods and roles that agents
/// know, `launcher` starts processes, and `build` describes this program in manifests.
pub fn main(verb: &Verb, catalog: &Catalog, launcher: &Launcher, build: &BuildInfo) -> u8 {
    screen::log_to_stderr();
    limit_iceoryx2_log();
    fail_at_file_size_limits();
    let result = match verb {
        Verb::New(args) => Ok(new::new(args, catalog)),
        Verb::Run(args) => args.run(catalog, launcher.clone(), build),
        Verb::Sweep(args) => sweep::sweep(args, catalog, launcher, build),
        Verb::Hunt(args) => Ok(hunt::hunt(args, catalog, launcher, build)),
        Verb::Check(args) => check::check(args, catalog),
        Verb::Schema(args) => Ok(schema::schema(args, catalog)),
        Verb::Report(args) => report::report(args, catalog),
        Verb::Doctor(args) => Ok(doctor::doctor(args)),
        Verb::Clean(args) => Ok(clean::clean(args)),
        Verb::Recover(args) => recover::recover(args),
        Verb::Export(args) => export::export(args),
        Verb::Fleet(args) => fleet_keys::run_fleet_subcommand(args),
        Verb::Verify(args) => verify::verify(args, catalog, launcher.clone(), build),
    };
    // The error has already been reported.
    result.unwrap_or_else(|code| code)
}

/// Rejects an output directory `out` inside the directory of run roots, where later runs would find a
/// directory that they did not create. A run root in use is allowed: `phalanx bench` keeps the directories of its runs
/// in its own. `what` names the option or folder in the message.
fn reject_inside_run_roots(out: &Path, what: &str) -> Result<(), u8> {
    let (base, path) = (resolve_path(&run_root::base_directory()), resolve_path(out));
    if !path.starts_with(&base) || run_root::is_in_live_root(&base, &path) {
        return Ok(());
    }
    let (out, base) = (out.display(), base.display());
    Err(screen::print_misuse(&format_args!(
        "{what} {out} is inside {base}, where runs keep shared memory and remove stale files: \
         choose a directory elsewhere"
    )))
}

/// Returns the absolute path, with symbolic links resolved as far as the path exists.
fn resolve_path(path: &Path) -> PathBuf {
    let path = std::path::absolute(path).unwrap_or_else(|_| path.into());
    let ancestor =
        path.ancestors().find_map(|ancestor| Some((ancestor, ancestor.canonicalize().ok()?)));
    let Some((ancestor, canonical)) = ancestor else { return path };
    canonical.join(path.strip_prefix(ancestor).unwrap_or(Path::new("")))
}

/// Rejects a recording that does not exist, or that is a symbolic link out of its folder.
fn check_in_run_folder(recording: &Path) -> Result<(), u8> {
    check_inside_folder(recording.parent().unwrap_or(recording), recording).map_err(|error| {
        screen::print_misuse(&format_args!("cannot read {}: {error}", recording.display()))
    })
}
