//! Where a host without the plant writes: briefs and logs of its own processes. What came out of the run
//! is written on the plant's host, into the run's directory.

use std::fs;
use std::path::{Path, PathBuf};

use protocol::brief;
use serde::Serialize;

use crate::results::programs::{self, Programs, Started};
use crate::results::run_dir::{RunDirError, failed, make};
use experiment::scenario::program::Program;

/// The directory of one host's share of a run.
#[derive(Debug)]
pub struct HostDir {
    path: PathBuf,
}

impl HostDir {
    /// Makes the directory, which must not exist, and writes the effective scenario and the fleet file.
    pub fn create(path: &Path, scenario: &str, fleet: &str) -> Result<HostDir, RunDirError> {
        make(path)?;
        for (name, text) in [("scenario.toml", scenario), ("fleet.toml", fleet)] {
            let file = path.join(name);
            fs::write(&file, text).map_err(failed(&file))?;
        }
        Ok(HostDir { path: path.into() })
    }

    /// Copies the programs that robots run.
    pub fn write_programs(&self, programs: &Programs) -> Result<(), RunDirError> {
        programs.write(&self.path).map_err(|(path, error)| failed(&path)(error))
    }

    /// How a program is started from the copies.
    pub fn started(&self, program: &Program) -> Result<Started, RunDirError> {
        let path = self.path.canonicalize().map_err(failed(&self.path))?;
        Ok(programs::started(program, &path))
    }

    /// Writes the brief of a process; where to.
    pub fn write_brief<B: Serialize>(&self, name: &str, told: &B) -> Result<PathBuf, RunDirError> {
        let path = self.path.join(format!("briefs/{name}.toml"));
        fs::write(&path, brief::to_text(told)).map_err(failed(&path))?;
        path.canonicalize().map_err(failed(&path))
    }

    /// Where the log of a process goes.
    pub fn log_path(&self, name: &str) -> PathBuf {
        self.path.join(format!("logs/{name}.jsonl"))
    }
}
