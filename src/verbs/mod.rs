//! What was asked for: the command line, one file for each verb.
//!
//! Results go to stdout, everything else to stderr. The exit code tells how it went.
//!
//! | file | what it does |
//! |---|---|
//! | `new` `run` `check` `schema` `report` `doctor` `clean` `recover` `export` `verify` | the verb of its name |
//! | `fleet_keys` | `phalanx fleet keys`: certificates |
//! | `sweep` | runs a campaign; `cell`: one run of it; `cell_in_process`: without processes |
//! | `hunt` | looks for a run that misses an expectation, and shrinks it |
//! | `execute` | runs a sound scenario, judges it and writes it down, for `run`, `cell` and `verify` |
//! | `fleet` `share` | this host's part of a run on several |
//! | `scenario` | reads the scenario that a verb is about, with the command line's changes |
//! | `dead_runs` | what did earlier runs that died leave behind? |
//! | `screen` | writes to the terminal: results, complaints, the log, the progress bar |

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

use std::path::{Path, PathBuf};

use clap::Subcommand;
use experiment::scenario::file::stays_in;
use protocol::catalog::Catalog;
use protocol::process::{Stop, fail_at_file_size_limits, quiet_iceoryx2};
use protocol::run_root;

use outcome::results::manifest::Build;
use supervisor::spawn::Launcher;

pub(crate) use screen::print;

/// Why a verb could not go on.
type Failure = Box<dyn std::error::Error>;

/// What ends a verb early: signals.
fn stop() -> Result<Stop, String> {
    Stop::on_signals_twice_at_once().map_err(|error| format!("cannot handle signals: {error}"))
}

/// Says of what is about several hosts, or about ROS 2, that it is not built in.
#[cfg(not(feature = "bridge"))]
fn needs_bridge() -> u8 {
    screen::misused(
        &"this phalanx was built for one host and without ROS 2: expected one built with `--features bridge`, as by \
          `cargo install --path . --features bridge`",
    )
}

/// The supervisor's verbs.
#[derive(Debug, Subcommand)]
pub enum Verb {
    /// Make a folder with a scenario to start from, its schema, and a control law.
    New(new::NewArgs),
    /// Run a scenario: every robot is a process of its own.
    Run(Box<run::RunArgs>),
    /// Run a campaign: one scenario many times, varied as its file says.
    Sweep(sweep::SweepArgs),
    /// Look for a run of a scenario that misses what it expects, and shrink it to the simplest one.
    Hunt(hunt::HuntArgs),
    /// Validate a scenario, and print what theory says about it before it runs.
    Check(check::CheckArgs),
    /// Print the JSON Schema of scenario files, for editors and other programs.
    Schema(schema::SchemaArgs),
    /// Draw the figures of a run and write its page, from what it has written.
    Report(report::ReportArgs),
    /// Say whether this machine is fit for runs, and what to do about it.
    Doctor(doctor::DoctorArgs),
    /// Remove what dead runs left behind.
    Clean(clean::CleanArgs),
    /// Rebuild the index of a truncated recording, in a new file.
    Recover(recover::RecoverArgs),
    /// Turn a recording into CSV tables, one for each kind of observation.
    Export(export::ExportArgs),
    /// Make what a run on several hosts needs.
    #[cfg_attr(not(feature = "bridge"), command(hide = true))]
    Fleet(fleet_keys::FleetVerbArgs),
    /// Run a recorded run in lockstep again, and say whether it is the same bit by bit.
    Verify(verify::VerifyArgs),
}

/// Does what was asked for; `catalog` is what the agents know, which `launcher` starts, and `build` is
/// what manifests say about this program.
pub fn main(verb: &Verb, catalog: &Catalog, launcher: &Launcher, build: &Build) -> u8 {
    screen::log_to_stderr();
    quiet_iceoryx2();
    fail_at_file_size_limits();
    let ended = match verb {
        Verb::New(args) => Ok(new::new(args, catalog)),
        Verb::Run(args) => args.run(catalog, launcher.clone(), build),
        Verb::Sweep(args) => sweep::sweep(args, catalog, launcher, build),
        Verb::Hunt(args) => Ok(hunt::hunt(args, catalog, build)),
        Verb::Check(args) => check::check(args, catalog),
        Verb::Schema(args) => Ok(schema::schema(args, catalog)),
        Verb::Report(args) => report::report(args, catalog),
        Verb::Doctor(args) => Ok(doctor::doctor(args)),
        Verb::Clean(args) => Ok(clean::clean(args)),
        Verb::Recover(args) => recover::recover(args),
        Verb::Export(args) => export::export(args),
        Verb::Fleet(args) => fleet_keys::fleet(args),
        Verb::Verify(args) => verify::verify(args, catalog, launcher.clone(), build),
    };
    // What went wrong was said.
    ended.unwrap_or_else(|code| code)
}

/// Refuses to write results to `out` if it lies in the directory of run roots: later runs would find a directory there
/// that they did not make. `what` is the option or folder that named it.
fn must_be_outside_of_run_roots(out: &Path, what: &str) -> Result<(), u8> {
    let base = resolved(&run_root::base());
    if !resolved(out).starts_with(&base) {
        return Ok(());
    }
    let (out, base) = (out.display(), base.display());
    Err(screen::misused(&format_args!(
        "{what} {out} lies in {base}, where runs share their memory and remove what they find: \
         choose a directory elsewhere"
    )))
}

/// Returns the absolute path, with links resolved as far as it exists.
fn resolved(path: &Path) -> PathBuf {
    let path = std::path::absolute(path).unwrap_or_else(|_| path.into());
    let there = path.ancestors().find_map(|there| Some((there, there.canonicalize().ok()?)));
    let Some((there, canonical)) = there else { return path };
    canonical.join(path.strip_prefix(there).unwrap_or(Path::new("")))
}

/// Refuses a recording that is not there, or is a link that leads out of its folder.
fn must_be_in_its_folder(recording: &Path) -> Result<(), u8> {
    stays_in(recording.parent().unwrap_or(recording), recording).map_err(|error| {
        screen::misused(&format_args!("cannot read {}: {error}", recording.display()))
    })
}
