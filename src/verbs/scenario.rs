//! Scenario argument of a subcommand: a file, and the changes that options make to it.

use std::path::PathBuf;

use clap::Args;
use protocol::catalog::Catalog;

use super::screen::{print_diagnostic, print_invalid_file};
use experiment::scenario::Scenario;
use experiment::scenario::read::{Overrides, read_for_run};

/// Scenario file with overrides.
#[derive(Debug, Args)]
pub(super) struct ScenarioArgs {
    /// Scenario file.
    #[arg(value_name = "SCENARIO")]
    pub(super) path: PathBuf,
    /// Seed of the random number generator.
    #[arg(long)]
    seed: Option<u64>,
    /// Set a scenario key, as in avoidance.kind=none. May be repeated.
    #[arg(long, value_name = "KEY=VALUE")]
    set: Vec<String>,
    /// Add a fault, as in 'kill r2 @10 restart 2'. May be repeated.
    #[arg(long, value_name = "SPEC")]
    fault: Vec<String>,
}

impl ScenarioArgs {
    /// Returns the scenario and its effective text. On an error, prints the diagnostic and returns the exit code.
    pub(super) fn read(&self, catalog: &Catalog) -> Result<(Scenario, String), u8> {
        self.read_with_keys(&[], catalog)
    }

    /// Works as [`Self::read`], and also sets the keys in `extra_keys`.
    pub(super) fn read_with_keys(
        &self,
        extra_keys: &[String],
        catalog: &Catalog,
    ) -> Result<(Scenario, String), u8> {
        let assignments = self.set.iter().chain(extra_keys).cloned().collect();
        let overrides = Overrides { assignments, faults: self.fault.clone(), seed: self.seed };
        let (scenario, text, warnings) = read_for_run(&self.path, &overrides, catalog)
            .map_err(|error| print_invalid_file(&error))?;
        warnings.iter().for_each(print_diagnostic);
        Ok((scenario, text))
    }
}
