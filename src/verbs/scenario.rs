//! The scenario that a verb is about: a file, and the command line's changes to it.

use std::path::PathBuf;

use clap::Args;
use protocol::catalog::Catalog;

use super::screen::{show, unsound};
use experiment::scenario::Scenario;
use experiment::scenario::read::{Overrides, read_to_run};

/// A scenario file, and changes to it.
#[derive(Debug, Args)]
pub(super) struct ScenarioArgs {
    /// The scenario file.
    #[arg(value_name = "SCENARIO")]
    pub(super) path: PathBuf,
    /// Seed of everything random.
    #[arg(long)]
    seed: Option<u64>,
    /// Set a key of the scenario, as in avoidance.kind=none.
    #[arg(long, value_name = "KEY=VALUE")]
    set: Vec<String>,
    /// Add a fault, as in 'kill r2 @10 restart 2'.
    #[arg(long, value_name = "SPEC")]
    fault: Vec<String>,
}

impl ScenarioArgs {
    /// The scenario with its effective text; what is wrong with it is shown, with an exit code.
    pub(super) fn read(&self, catalog: &Catalog) -> Result<(Scenario, String), u8> {
        self.read_with(&[], catalog)
    }

    /// The same with these keys set as well.
    pub(super) fn read_with(
        &self,
        also: &[String],
        catalog: &Catalog,
    ) -> Result<(Scenario, String), u8> {
        let set = self.set.iter().chain(also).cloned().collect();
        let overrides = Overrides { set, faults: self.fault.clone(), seed: self.seed };
        let (scenario, text, warnings) =
            read_to_run(&self.path, &overrides, catalog).map_err(|why| unsound(&why))?;
        warnings.iter().for_each(show);
        Ok((scenario, text))
    }
}
