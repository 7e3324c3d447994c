//! External programs of a scenario in a run's directory: copies of their files, and checksums.
//!
//! Must not: start one.

use std::fs;
use std::io;
use std::os::unix::fs::PermissionsExt as _;
use std::path::{Path, PathBuf};

use experiment::campaign::cells::sha256;
use experiment::scenario::Scenario;
use experiment::scenario::program::{ExternalProgram, PROGRAMS_FOLDER};
use serde::Serialize;

/// Files of all programs of a scenario, in memory.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Programs {
    has_programs: bool,
    files: Vec<ProgramFile>,
}

/// A file of a program.
#[derive(Debug, Clone, PartialEq)]
struct ProgramFile {
    name: String,
    bytes: Vec<u8>,
    mode: u32,
}

/// Entry of a program's file in the manifest.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct ManifestFile {
    /// Path of the file as in the scenario, and below `programs/`.
    pub file: String,
    /// SHA-256 of the file, 64 hexadecimal digits.
    pub sha256: String,
}

/// Command that starts one process.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct ProgramCommand {
    /// Program and arguments; files are replaced by the paths of the copies.
    pub command_line: Vec<PathBuf>,
    /// Working directory.
    pub folder: PathBuf,
    /// Memory limit, MB; `None` without a limit.
    pub memory_max_mb: Option<u64>,
}

impl Programs {
    /// Reads the files of all programs that the robots of a scenario run. `folder` is the folder of the scenario.
    pub fn read(scenario: &Scenario, folder: &Path) -> Result<Programs, (PathBuf, io::Error)> {
        let mut files: Vec<ProgramFile> = Vec::new();
        for (name, path) in scenario.programs().flat_map(|program| program.files(folder)) {
            if files.iter().any(|file| file.name == name) {
                continue;
            }
            let read = || -> io::Result<ProgramFile> {
                let mode = path.metadata()?.permissions().mode();
                Ok(ProgramFile { name, bytes: fs::read(&path)?, mode })
            };
            files.push(read().map_err(|error| (path.clone(), error))?);
        }
        Ok(Programs { has_programs: scenario.programs().next().is_some(), files })
    }

    /// Returns the entries for the manifest.
    pub fn manifest_files(&self) -> Vec<ManifestFile> {
        let hash = |bytes: &[u8]| sha256(bytes).expect("memory is always read");
        let entry = |file: &ProgramFile| ManifestFile {
            file: file.name.clone(),
            sha256: hash(&file.bytes),
        };
        self.files.iter().map(entry).collect()
    }

    /// Copies the files into the folder `programs` of a run's directory, or of a scenario's, which must not have it
    /// yet.
    pub fn write(&self, run_dir: &Path) -> Result<(), (PathBuf, io::Error)> {
        if self.has_programs {
            let folder = run_dir.join(PROGRAMS_FOLDER);
            fs::create_dir(&folder).map_err(|error| (folder, error))?;
        }
        for ProgramFile { name, bytes, mode } in &self.files {
            let path = run_dir.join(PROGRAMS_FOLDER).join(name);
            let write = || {
                fs::create_dir_all(path.parent().unwrap_or(run_dir))?;
                fs::write(&path, bytes)?;
                fs::set_permissions(&path, fs::Permissions::from_mode(*mode))
            };
            write().map_err(|error| (path.clone(), error))?;
        }
        Ok(())
    }
}

/// Returns the command that starts a program from a run's directory, which must be an absolute path.
pub fn program_command(program: &ExternalProgram, run_dir: &Path) -> ProgramCommand {
    let folder = run_dir.join(PROGRAMS_FOLDER);
    let resolve = |argument: &String| match program.is_program_file(argument, &folder) {
        true => folder.join(argument),
        false => argument.into(),
    };
    let command_line = program.command_line.iter().map(resolve).collect();
    ProgramCommand { command_line, folder, memory_max_mb: program.memory_max_mb }
}
