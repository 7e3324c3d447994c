//! Directory that every host of a run writes: the effective scenario, process configurations (briefs), logs, and
//! copies of external programs. The results are written on the plant's host alone, into the same directory.

use std::fs;
use std::io;
use std::path::{Path, PathBuf};

use protocol::brief::Brief;

use crate::results::files::programs::{self, ProgramCommand, Programs};
use experiment::scenario::program::ExternalProgram;

/// Name of the effective scenario.
pub const SCENARIO_FILE: &str = "scenario.toml";

/// Error of creating or writing a run's directory. What was written before is kept.
#[derive(Debug, thiserror::Error)]
pub enum RunDirError {
    /// The directory exists; a run never overwrites another.
    #[error("{} exists already; a run never overwrites another, choose a new name with --out", .0.display())]
    Exists(PathBuf),
    /// The directory could not be created.
    #[error("cannot make {}: {}; nothing was run", .0.display(), .1)]
    CreateDirectory(PathBuf, io::Error),
    /// A file or directory could not be written.
    #[error("cannot write {}: {}; what was written before is kept", .0.display(), .1)]
    Write(PathBuf, io::Error),
}

pub(crate) fn write_error(path: &Path) -> impl FnOnce(io::Error) -> RunDirError {
    let path = path.to_path_buf();
    move |error| RunDirError::Write(path, error)
}

/// Directory of one host's part of a run.
#[derive(Debug)]
pub struct HostDir {
    path: PathBuf,
}

impl HostDir {
    /// Creates the directory, which must not exist, with subdirectories for briefs and logs.
    pub fn create(path: &Path) -> Result<HostDir, RunDirError> {
        let create_error = |path: &Path| {
            let path = path.to_path_buf();
            move |error| RunDirError::CreateDirectory(path, error)
        };
        if let Some(parent) = path.parent() {
            fs::create_dir_all(parent).map_err(create_error(parent))?;
        }
        // Only this call creates it, so that one of two concurrent runs gets it.
        fs::create_dir(path).map_err(|error| match error.kind() {
            io::ErrorKind::AlreadyExists => RunDirError::Exists(path.into()),
            _ => create_error(path)(error),
        })?;
        for directory in [path.join("briefs"), path.join("logs")] {
            fs::create_dir(&directory).map_err(create_error(&directory))?;
        }
        Ok(HostDir { path: path.into() })
    }

    /// Returns the path of the directory.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// Writes the effective scenario, which can be run again.
    pub fn write_scenario(&self, text: &str) -> Result<(), RunDirError> {
        self.write_file(SCENARIO_FILE, text)
    }

    /// Writes the fleet file: the hosts and their robots.
    pub fn write_fleet(&self, text: &str) -> Result<(), RunDirError> {
        self.write_file("fleet.toml", text)
    }

    /// Copies the external programs of robots.
    pub fn write_programs(&self, programs: &Programs) -> Result<(), RunDirError> {
        programs.write(&self.path).map_err(|(path, error)| write_error(&path)(error))
    }

    /// Returns the command that starts a program from its copies.
    pub fn program_command(
        &self,
        program: &ExternalProgram,
    ) -> Result<ProgramCommand, RunDirError> {
        // Its processes have another working directory.
        let path = self.path.canonicalize().map_err(write_error(&self.path))?;
        Ok(programs::program_command(program, &path))
    }

    /// Writes the brief of a process. Returns its absolute path.
    pub fn write_brief<B: Brief>(&self, name: &str, content: &B) -> Result<PathBuf, RunDirError> {
        let file = format!("briefs/{name}.toml");
        self.write_file(&file, content.to_toml())?;
        let path = self.path.join(file);
        // Children have another working directory, where a relative path would be wrong.
        path.canonicalize().map_err(write_error(&path))
    }

    /// Returns the directory of all logs.
    pub fn logs_path(&self) -> PathBuf {
        self.path.join("logs")
    }

    /// Returns the path of a process's log.
    pub fn log_path(&self, name: &str) -> PathBuf {
        self.logs_path().join(format!("{name}.jsonl"))
    }

    pub(crate) fn write_file(
        &self,
        name: &str,
        content: impl AsRef<[u8]>,
    ) -> Result<(), RunDirError> {
        let path = self.path.join(name);
        fs::write(&path, content).map_err(write_error(&path))
    }
}
