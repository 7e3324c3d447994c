//! What every host of a run writes: the effective scenario, briefs and logs of its processes, and copies of the
//! programs that they run. What came out of the run is written on the plant's host alone, into the same directory.

use std::fs;
use std::io;
use std::path::{Path, PathBuf};

use protocol::brief;
use serde::Serialize;

use crate::results::programs::{self, Programs, Started};
use experiment::scenario::program::Program;

/// The effective scenario.
pub const SCENARIO: &str = "scenario.toml";

/// Why something could not be written down. What was written before is kept.
#[derive(Debug, thiserror::Error)]
pub enum RunDirError {
    /// It would overwrite an earlier run.
    #[error("{} exists already; a run never overwrites another, give --out a new name", .0.display())]
    Exists(PathBuf),
    /// Its directory could not be made.
    #[error("cannot make {}: {}; nothing was run", .0.display(), .1)]
    Make(PathBuf, io::Error),
    /// A file or directory could not be written.
    #[error("cannot write {}: {}; what was written before is kept", .0.display(), .1)]
    Write(PathBuf, io::Error),
}

pub(crate) fn failed(path: &Path) -> impl FnOnce(io::Error) -> RunDirError {
    let path = path.to_path_buf();
    move |error| RunDirError::Write(path, error)
}

/// The directory of one host's share of a run.
#[derive(Debug)]
pub struct HostDir {
    path: PathBuf,
}

impl HostDir {
    /// Makes the directory, which must not exist, with places for briefs and logs.
    pub fn make(path: &Path) -> Result<HostDir, RunDirError> {
        let unmade = |path: &Path| {
            let path = path.to_path_buf();
            move |error| RunDirError::Make(path, error)
        };
        if let Some(parent) = path.parent() {
            fs::create_dir_all(parent).map_err(unmade(parent))?;
        }
        // Made here and nowhere else, so that of two runs that want it one gets it.
        fs::create_dir(path).map_err(|error| match error.kind() {
            io::ErrorKind::AlreadyExists => RunDirError::Exists(path.into()),
            _ => unmade(path)(error),
        })?;
        for directory in [path.join("briefs"), path.join("logs")] {
            fs::create_dir(&directory).map_err(unmade(&directory))?;
        }
        Ok(HostDir { path: path.into() })
    }

    /// Where it is.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// Writes the effective scenario, which can be run again.
    pub fn write_scenario(&self, text: &str) -> Result<(), RunDirError> {
        self.write(SCENARIO, text)
    }

    /// Writes which hosts there are, and who lives where.
    pub fn write_fleet(&self, text: &str) -> Result<(), RunDirError> {
        self.write("fleet.toml", text)
    }

    /// Copies the programs that robots run.
    pub fn write_programs(&self, programs: &Programs) -> Result<(), RunDirError> {
        programs.write(&self.path).map_err(|(path, error)| failed(&path)(error))
    }

    /// How a program is started from the copies.
    pub fn started(&self, program: &Program) -> Result<Started, RunDirError> {
        // Its processes are started elsewhere than this one.
        let path = self.path.canonicalize().map_err(failed(&self.path))?;
        Ok(programs::started(program, &path))
    }

    /// Writes the brief of a process; where to.
    pub fn write_brief<B: Serialize>(&self, name: &str, told: &B) -> Result<PathBuf, RunDirError> {
        let file = format!("briefs/{name}.toml");
        self.write(&file, brief::to_text(told))?;
        let path = self.path.join(file);
        // Children may run elsewhere one day, and a relative path would mean something else.
        path.canonicalize().map_err(failed(&path))
    }

    /// Where the logs of all processes go.
    pub fn logs(&self) -> PathBuf {
        self.path.join("logs")
    }

    /// Where the log of a process goes.
    pub fn log_path(&self, name: &str) -> PathBuf {
        self.logs().join(format!("{name}.jsonl"))
    }

    pub(crate) fn write(&self, name: &str, content: impl AsRef<[u8]>) -> Result<(), RunDirError> {
        let path = self.path.join(name);
        fs::write(&path, content).map_err(failed(&path))
    }
}
