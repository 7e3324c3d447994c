//! The folder of a campaign: which runs are done, which gave up, which are missing.
//!
//! A run is done when its directory is there: it is written under another name and renamed when it is
//! complete. What was killed on its way is as if it had never been.

use std::collections::BTreeSet;
use std::fs;
use std::io::{self, Write as _};
use std::path::{Path, PathBuf};

use rustix::fs::{FlockOperation, flock};
use rustix::io::Errno;

use crate::metrics::summary::Summary;
use crate::results::run_dir::SUMMARY;

use crate::results::run_dir::SAMPLES;
use experiment::campaign::cells::Cell;
use experiment::campaign::file::Keep;

/// A run whose machinery failed so often is given up.
pub const ATTEMPTS_MAX: usize = 3;

/// Held by whoever runs it, and says who that is.
const LOCK: &str = ".lock";

/// Where the runs of a campaign are.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Folder {
    path: PathBuf,
}

/// What became of a run.
#[derive(Debug, Clone, PartialEq)]
pub enum State {
    /// It has a result.
    Done(Box<Summary>),
    /// Its machinery failed as often as it may, the last time so.
    GivenUp(String),
    /// It is yet to be run.
    Missing,
}

/// Why the folder cannot be used.
#[derive(Debug, thiserror::Error)]
#[error("cannot {what} {}: {source}", path.display())]
pub struct FolderError {
    what: &'static str,
    path: PathBuf,
    source: io::Error,
}

pub(crate) fn failed(what: &'static str, path: &Path) -> impl FnOnce(io::Error) -> FolderError {
    let path = path.to_path_buf();
    move |source| FolderError { what, path, source }
}

/// Why nobody else may run it.
#[derive(Debug, thiserror::Error)]
pub enum LockError {
    /// Another sweep does.
    #[error(
        "another `phalanx sweep` ({holder}) runs this campaign in {}; wait for it, or give --out another \
         directory",
        path.display()
    )]
    Held {
        /// Where.
        path: PathBuf,
        /// Which process, and on which host.
        holder: String,
    },
    /// The lock could not be taken.
    #[error("cannot lock {}: {source}", path.display())]
    Unlockable {
        /// Which file.
        path: PathBuf,
        /// Why.
        source: io::Error,
    },
}

/// Only whoever holds this runs what is missing; dropped, or with the end of the process, it is free.
#[derive(Debug)]
pub struct Lock {
    _file: fs::File,
}

impl Folder {
    /// Makes it, unless it is there.
    pub fn open(path: &Path) -> Result<Folder, FolderError> {
        for folder in [path.join("runs"), path.join("figures")] {
            fs::create_dir_all(&folder).map_err(failed("make", &folder))?;
        }
        let path = path.canonicalize().map_err(failed("open", path))?;
        Ok(Folder { path })
    }

    /// Makes sure that nobody else runs what is missing.
    pub fn lock(&self) -> Result<Lock, LockError> {
        let path = self.path.join(LOCK);
        let unlockable = |source| LockError::Unlockable { path: path.clone(), source };
        let open =
            fs::File::options().create(true).read(true).write(true).truncate(false).open(&path);
        let mut file = open.map_err(unlockable)?;
        match flock(&file, FlockOperation::NonBlockingLockExclusive) {
            Ok(()) => {}
            Err(Errno::WOULDBLOCK) => {
                let holder = fs::read_to_string(&path).unwrap_or_default().trim().to_owned();
                return Err(LockError::Held { path: self.path.clone(), holder });
            }
            // A file system that knows no locks; there nobody is kept from computing things twice.
            Err(Errno::NOSYS | Errno::OPNOTSUPP | Errno::NOLCK) => {
                tracing::warn!("{} cannot be locked: start one sweep at a time", path.display());
            }
            Err(error) => return Err(unlockable(error.into())),
        }
        let holder = format!("process {} on {}\n", std::process::id(), host());
        file.set_len(0).and_then(|()| file.write_all(holder.as_bytes())).map_err(unlockable)?;
        Ok(Lock { _file: file })
    }

    /// Where it is.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// The directory of a run, once it is done.
    pub fn run(&self, id: &str) -> PathBuf {
        self.path.join("runs").join(id)
    }

    /// What became of a run. One of which less was kept than is asked for now is missing.
    pub fn state(&self, cell: &Cell, keep: Keep) -> Result<State, FolderError> {
        let run = self.run(&cell.id);
        let summary = run.join(SUMMARY);
        match fs::read_to_string(&summary) {
            Ok(text) => {
                let parsed = serde_json::from_str(&text).map_err(io::Error::from);
                let found: Summary = parsed.map_err(failed("read", &summary))?;
                let wanted = keep == Keep::All || keep == Keep::Failed && found.exit != 0;
                if wanted && !run.join(SAMPLES).exists() {
                    fs::remove_dir_all(&run).map_err(failed("remove", &run))?;
                    return Ok(State::Missing);
                }
                Ok(State::Done(Box::new(found)))
            }
            Err(error) if error.kind() == io::ErrorKind::NotFound => {
                let attempts = attempts(&run);
                Ok(match attempts.last() {
                    Some(last) if attempts.len() >= ATTEMPTS_MAX => State::GivenUp(last.clone()),
                    _ => State::Missing,
                })
            }
            Err(error) => Err(failed("read", &summary)(error)),
        }
    }

    /// Forgets that runs were given up.
    pub fn forgive(&self, cells: &[Cell]) {
        for cell in cells {
            let _ = fs::remove_file(beside(&self.run(&cell.id), "failed"));
        }
    }

    /// Removes what processes of this machine that are gone left of runs under way, and logs of runs
    /// that are done.
    pub fn tidy(&self) {
        let host = host();
        for entry in fs::read_dir(self.path.join("runs")).into_iter().flatten().flatten() {
            let name = entry.file_name().to_string_lossy().into_owned();
            if name.strip_suffix(".log").is_some_and(|id| self.run(id).exists()) {
                let _ = fs::remove_file(entry.path());
            }
            let Some((_, by)) = name.split_once(".part-") else { continue };
            let Some((pid, on)) = by.split_once('-') else { continue };
            if on == host && !lives(pid) {
                let _ = fs::remove_dir_all(entry.path());
            }
        }
    }

    /// The runs that are missing, each once.
    pub fn missing<'c>(&self, cells: &'c [Cell], keep: Keep) -> Result<Vec<&'c Cell>, FolderError> {
        let (mut missing, mut seen) = (Vec::new(), BTreeSet::new());
        for cell in cells {
            if seen.insert(&cell.id) && self.state(cell, keep)? == State::Missing {
                missing.push(cell);
            }
        }
        Ok(missing)
    }

    /// Writes a file at once: whoever reads it sees the old one or the new one.
    pub fn write(&self, name: &str, content: &str) -> Result<(), FolderError> {
        let (path, new) = (self.path.join(name), self.path.join(format!("{name}.new")));
        fs::write(&new, content).map_err(failed("write", &new))?;
        fs::rename(&new, &path).map_err(failed("write", &path))
    }
}

/// The failed attempts at a run, each in words.
pub fn attempts(run: &Path) -> Vec<String> {
    let text = fs::read_to_string(beside(run, "failed")).unwrap_or_default();
    text.lines().map(str::to_owned).collect()
}

/// Writes down that an attempt at a run failed.
pub fn note_failure(run: &Path, why: &str) -> io::Result<()> {
    let why = why.lines().next().unwrap_or("failed");
    let mut file = fs::File::options().create(true).append(true).open(beside(run, "failed"))?;
    writeln!(file, "{why}")
}

/// Under which name this process writes a run while it is under way.
pub fn part(run: &Path) -> PathBuf {
    part_of(run, std::process::id())
}

/// The same of another process of this machine.
pub fn part_of(run: &Path, pid: u32) -> PathBuf {
    beside(run, &format!("part-{pid}-{}", host()))
}

/// Keeps of a complete run, which is written in `part`, what is to be kept, and gives it its name. One
/// that another process has completed meanwhile stays.
pub fn complete(part: &Path, run: &Path, keep: Keep, passed: bool) -> io::Result<()> {
    if keep == Keep::Summary || keep == Keep::Failed && passed {
        for entry in fs::read_dir(part)? {
            let path = entry?.path();
            let name = path.file_name().unwrap_or_default().to_string_lossy().into_owned();
            match name.as_str() {
                "scenario.toml" | "manifest.json" | "summary.json" => {}
                _ if path.is_dir() => fs::remove_dir_all(&path)?,
                _ => fs::remove_file(&path)?,
            }
        }
    }
    match fs::rename(part, run) {
        Err(_) if run.join(SUMMARY).exists() => fs::remove_dir_all(part),
        renamed => renamed,
    }
}

/// A file or folder that lies beside a run, with this ending of its name.
pub fn beside(run: &Path, ending: &str) -> PathBuf {
    let name = run.file_name().unwrap_or_default().to_string_lossy().into_owned();
    run.with_file_name(format!("{name}.{ending}"))
}

/// Whether there is such a process, and it is not dead and yet to be reaped.
fn lives(pid: &str) -> bool {
    let stat = fs::read_to_string(format!("/proc/{pid}/stat")).unwrap_or_default();
    // Behind its name, which may hold anything.
    let state = stat.rsplit_once(") ").map(|(_, rest)| rest.chars().next());
    matches!(state, Some(Some(state)) if !"ZX".contains(state))
}

fn host() -> String {
    rustix::system::uname().nodename().to_string_lossy().into_owned()
}
