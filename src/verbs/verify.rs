//! `phalanx verify`: repeats a recorded lockstep run from its directory, and compares the results.

use std::path::{Path, PathBuf};

use clap::Args;
use protocol::catalog::Catalog;
use protocol::process::exit;
use protocol::run_root::{self, RunRoot};
use protocol::scratch;

use super::execute::{read_programs, repeat_run};
use super::screen::{
    OutputFormat, print, print_failure, print_invalid_file, print_misuse, print_result,
};
use experiment::scenario::read::{Overrides, read_for_run};
use outcome::results::compare::{Comparison, RepeatabilityError, check_repeatable};
use outcome::results::manifest::BuildInfo;
use outcome::results::page;
use outcome::results::summary::to_json;
use supervisor::spawn::Launcher;

/// Arguments of `phalanx verify`.
#[derive(Debug, Args)]
pub struct VerifyArgs {
    /// Directory of a complete lockstep run that was not interrupted.
    run_dir: PathBuf,
    /// Keep the repeated run in this directory, which must not exist [default: the repeated run is removed].
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
    /// Start the run's own programs, copied in `programs/`. They run with all of your permissions.
    #[arg(long)]
    allow_programs: bool,
    /// Output format.
    #[arg(long, value_enum, default_value_t = OutputFormat::Text)]
    output: OutputFormat,
}

/// Temporary folder of the repeated run, next to the recorded one; dropping the value removes it. If the
/// process is killed, the next run or `phalanx clean` removes it.
struct ScratchRunDir {
    root: RunRoot,
    /// Directory of the repeated run.
    run_dir: PathBuf,
}

impl ScratchRunDir {
    fn create_next_to(run_dir: &Path) -> Result<ScratchRunDir, String> {
        let root =
            RunRoot::create(&run_root::base_directory()).map_err(|error| error.to_string())?;
        let name = run_dir.file_name().unwrap_or_default().to_string_lossy().into_owned();
        let folder = run_dir.with_file_name(format!("{name}-again-{}", std::process::id()));
        scratch::create(root.path(), &folder).map_err(|error| {
            format!(
                "cannot create {}: {error}; choose another directory with --out",
                folder.display()
            )
        })?;
        Ok(ScratchRunDir { root, run_dir: folder.join("run") })
    }
}

impl Drop for ScratchRunDir {
    fn drop(&mut self) {
        if let Err(error) = scratch::remove(self.root.path()) {
            tracing::warn!("cannot remove {}: {error}", self.run_dir.display());
        }
    }
}

pub(super) fn verify(
    args: &VerifyArgs,
    catalog: &Catalog,
    launcher: Launcher,
    build: &BuildInfo,
) -> Result<u8, u8> {
    let run_dir = &args.run_dir;
    let path = page::scenario_path(run_dir).map_err(|error| print_misuse(&error))?;
    check_repeatable(run_dir).map_err(|error| match error {
        RepeatabilityError::UnreadableFile(..) => print_failure(&error),
        _ => print_misuse(&error),
    })?;
    let (scenario, text, _) = read_for_run(&path, &Overrides::default(), catalog)
        .map_err(|error| print_invalid_file(&error))?;
    if let Some(program) = scenario.programs().next().filter(|_| !args.allow_programs) {
        return Err(print_misuse(&format_args!(
            "{} starts a program from the run directory, {}, which may be untrusted: \
             inspect programs/, then add --allow-programs",
            run_dir.display(),
            program.command_line.join(" ")
        )));
    }
    let programs = read_programs(&scenario, &path)?;
    if let Some(out) = args.out.as_ref().filter(|out| out.exists()) {
        let out = out.display();
        return Err(print_misuse(&format_args!(
            "--out {out} already exists; choose a new directory"
        )));
    }
    let (out, _scratch) = match &args.out {
        Some(out) => (out.clone(), None),
        None => {
            let scratch =
                ScratchRunDir::create_next_to(run_dir).map_err(|error| print_failure(&error))?;
            (scratch.run_dir.clone(), Some(scratch))
        }
    };
    repeat_run(&scenario, &text, programs, &out, launcher, build)?;
    let comparison = Comparison::compare(run_dir, &out).map_err(|error| {
        print_failure(&format_args!("cannot compare {}: {error}", run_dir.display()))
    })?;
    let exit_code = match args.output {
        OutputFormat::Text => print(&format!("{}: {comparison}", run_dir.display())),
        OutputFormat::Json => print_result(OutputFormat::Json, &to_json(&comparison)),
    };
    match (exit_code, comparison.same) {
        (exit::OK, false) => Err(exit::EXPECTATION_MISSED),
        (exit_code, _) => Ok(exit_code),
    }
}
