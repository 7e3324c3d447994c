//! The programs of a scenario's own in a run's directory: copies of their files, and what these hash to.
//!
//! Must not: start one.

use std::fs;
use std::io;
use std::os::unix::fs::PermissionsExt as _;
use std::path::{Path, PathBuf};

use experiment::campaign::cells::sha256;
use experiment::scenario::Scenario;
use experiment::scenario::program::{PROGRAMS, Program};
use serde::Serialize;

/// All of them, read.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Programs {
    any: bool,
    files: Vec<File>,
}

/// One of their files.
#[derive(Debug, Clone, PartialEq)]
struct File {
    name: String,
    bytes: Vec<u8>,
    mode: u32,
}

/// What a manifest says of a program's file.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct Listed {
    /// As the scenario names it, and where it is below `programs/`.
    pub file: String,
    /// 64 hexadecimal digits.
    pub sha256: String,
}

/// What one process is started with.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Started {
    /// The program and its arguments; files are the copies.
    pub words: Vec<PathBuf>,
    /// Where it is started.
    pub folder: PathBuf,
    /// It may have no more memory than this, MB.
    pub memory_max_mb: Option<u64>,
}

impl Programs {
    /// Those of a scenario in that folder: all that its robots run.
    pub fn read(scenario: &Scenario, folder: &Path) -> Result<Programs, (PathBuf, io::Error)> {
        let mut files: Vec<File> = Vec::new();
        for (name, path) in scenario.programs().flat_map(|program| program.files(folder)) {
            if files.iter().any(|file| file.name == name) {
                continue;
            }
            let read = || -> io::Result<File> {
                let mode = path.metadata()?.permissions().mode();
                Ok(File { name, bytes: fs::read(&path)?, mode })
            };
            files.push(read().map_err(|error| (path.clone(), error))?);
        }
        Ok(Programs { any: scenario.programs().next().is_some(), files })
    }

    /// What a manifest says of them.
    pub fn listed(&self) -> Vec<Listed> {
        let hash = |bytes: &[u8]| sha256(bytes).expect("memory is always read");
        let listed = |file: &File| Listed { file: file.name.clone(), sha256: hash(&file.bytes) };
        self.files.iter().map(listed).collect()
    }

    /// Copies them into the run's directory.
    pub(crate) fn write(&self, run_dir: &Path) -> Result<(), (PathBuf, io::Error)> {
        if self.any {
            let folder = run_dir.join(PROGRAMS);
            fs::create_dir(&folder).map_err(|error| (folder, error))?;
        }
        for File { name, bytes, mode } in &self.files {
            let path = run_dir.join(PROGRAMS).join(name);
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

/// How a program is started from a run's directory, which is an absolute path.
pub(crate) fn started(program: &Program, run_dir: &Path) -> Started {
    let folder = run_dir.join(PROGRAMS);
    let word = |word: &String| match program.is_own(word, &folder) {
        true => folder.join(word),
        false => word.into(),
    };
    let words = program.words.iter().map(word).collect();
    Started { words, folder, memory_max_mb: program.memory_max_mb }
}
