//! The folder of a campaign: which runs are done, which gave up, which are missing.
//!
//! A run is done when its directory is there and fits its checksums, which are the last thing that is written
//! under another name, before the directory gets its own. What was killed on its way is as if it had never been;
//! what the disk lost or somebody changed is damaged, and run again.

use std::fs;
use std::io::{self, Seek as _, SeekFrom, Write as _};
use std::path::{Path, PathBuf};

use protocol::regular_file::{self, Links};
use rustix::fs::{FlockOperation, flock};
use rustix::io::Errno;

use crate::metrics::summary::Summary;
use crate::results::chained::{Chain, Opened};
use crate::results::checksums::{self, Damage, replace, sync};
use crate::results::host_dir::SCENARIO;
use crate::results::own_file;
use crate::results::run_dir::{MANIFEST, SAMPLES, SUMMARY};
use experiment::campaign::cells::Cell;
use experiment::campaign::file::Keep;
use experiment::scenario::file::stays_in;

/// A run whose machinery failed so often is given up.
pub const ATTEMPTS_MAX: usize = 3;

/// Held by whoever runs it, and says who that is.
const LOCK: &str = ".lock";

/// Maximum length of the text that says which process holds the lock, bytes. A longer one is not shown.
const HOLDER_BYTES_MAX: u64 = 1 << 12;
/// Maximum size of a list of failed attempts, bytes. A longer one counts as none.
const FAILED_BYTES_MAX: u64 = 1 << 20;
/// Maximum size of a summary, bytes. A run with a larger one counts as damaged.
const SUMMARY_BYTES_MAX: u64 = 1 << 30;

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
    /// It is yet to be run, or less was kept of it than is asked for now.
    Missing,
    /// It is there, but not as it was written, for this reason: it is yet to be run again.
    Damaged(String),
}

impl State {
    /// Whether it has no result yet, and is not given up.
    pub fn is_to_be_run(&self) -> bool {
        matches!(self, State::Missing | State::Damaged(_))
    }
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
    /// Another sweep or hunt does: where, and which process on which host.
    #[error("another `phalanx` ({}) is at work in {}; wait for it, or give --out another directory", .1, .0.display())]
    Held(PathBuf, String),
    /// The lock could not be taken.
    #[error("cannot lock {}: {}", .0.display(), .1)]
    Unlockable(PathBuf, io::Error),
}

/// Only whoever holds this runs what is missing; dropped, or with the end of the process, it is free.
#[derive(Debug)]
pub struct Lock {
    _file: fs::File,
}

impl Folder {
    /// Makes it, unless it is there.
    pub fn open(path: &Path) -> Result<Folder, FolderError> {
        Folder::with(path, &["runs", "figures"])
    }

    /// Makes it with these folders in it, unless they are there.
    pub fn with(path: &Path, folders: &[&str]) -> Result<Folder, FolderError> {
        for folder in folders.iter().map(|folder| path.join(folder)) {
            fs::create_dir_all(&folder).map_err(failed("make", &folder))?;
            stays_in(path, &folder).map_err(failed("write into", &folder))?;
        }
        let path = path.canonicalize().map_err(failed("open", path))?;
        Ok(Folder { path })
    }

    /// Makes sure that nobody else runs what is missing.
    pub fn lock(&self) -> Result<Lock, LockError> {
        let path = self.path.join(LOCK);
        let unlockable = |error| LockError::Unlockable(path.clone(), error);
        let mut file = own_file::open(&path).map_err(unlockable)?;
        match flock(&file, FlockOperation::NonBlockingLockExclusive) {
            Ok(()) => {}
            Err(Errno::WOULDBLOCK) => {
                let holder = regular_file::read_open(&file, HOLDER_BYTES_MAX).unwrap_or_default();
                let holder = String::from_utf8_lossy(&holder).trim().to_owned();
                return Err(LockError::Held(self.path.clone(), holder));
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

    /// What became of each run, in their order.
    pub fn states(&self, cells: &[Cell], keep: Keep) -> Result<Vec<State>, FolderError> {
        cells.iter().map(|cell| state(&self.run(&cell.id), keep)).collect()
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

    /// Returns once the disk knows which runs there are.
    pub fn sync(&self) -> Result<(), FolderError> {
        let runs = self.path.join("runs");
        sync(&runs).map_err(failed("sync", &runs))
    }

    /// Writes a file at once: whoever reads it sees the old one or the new one.
    pub fn write(&self, name: &str, content: &str) -> Result<(), FolderError> {
        let path = self.path.join(name);
        replace(&path, content, false).map_err(failed("write", &path))
    }
}

/// What became of a run.
pub fn state(run: &Path, keep: Keep) -> Result<State, FolderError> {
    if fs::symlink_metadata(run).is_err_and(|error| error.kind() == io::ErrorKind::NotFound) {
        let attempts = attempts(run);
        return Ok(match attempts.last() {
            Some(last) if attempts.len() >= ATTEMPTS_MAX => State::GivenUp(last.clone()),
            _ => State::Missing,
        });
    }
    match checksums::check(run) {
        Ok(()) => {}
        Err(Damage::Unreadable(name, error)) => return Err(failed("read", &run.join(name))(error)),
        Err(damage) => return Ok(State::Damaged(damage.to_string())),
    }
    let read = regular_file::read(&run.join(SUMMARY), Links::Followed, SUMMARY_BYTES_MAX);
    let summary = read.and_then(|text| Ok(serde_json::from_slice::<Box<Summary>>(&text)?));
    Ok(match summary {
        Err(error) => State::Damaged(format!("{SUMMARY}: {error}")),
        Ok(summary) => {
            let wanted = keep == Keep::All || keep == Keep::Failed && summary.exit != 0;
            let is_less = wanted && !run.join(SAMPLES).exists();
            if is_less { State::Missing } else { State::Done(summary) }
        }
    })
}

/// Makes room for a run that is to be run: whether it is there already. What is there of a damaged one stays beside
/// it, as RUN.damaged; one of which less was kept than is asked for now is removed.
pub fn make_room(run: &Path, keep: Keep) -> Result<bool, FolderError> {
    match state(run, keep)? {
        State::Done(_) => return Ok(true),
        State::Damaged(_) => {
            let aside = beside(run, "damaged");
            let _ = fs::remove_dir_all(&aside);
            // Unless another process did it.
            match fs::rename(run, &aside) {
                Err(error) if error.kind() == io::ErrorKind::NotFound => {}
                renamed => renamed.map_err(failed("rename", run))?,
            }
        }
        State::Missing if run.exists() => fs::remove_dir_all(run).map_err(failed("remove", run))?,
        State::Missing | State::GivenUp(_) => {}
    }
    Ok(false)
}

/// Returns the reasons of the failed attempts at a run, in order. Lines that do not fit their checksums do not count: the
/// run is tried again.
pub fn attempts(run: &Path) -> Vec<String> {
    let path = beside(run, "failed");
    let text = regular_file::read_to_string(&path, Links::Refused, FAILED_BYTES_MAX);
    let text = text.unwrap_or_default();
    let lines = failures(run).open(&text).lines;
    lines.into_iter().map(str::to_owned).collect()
}

/// The chain that the list of failed attempts at a run begins with: a list of another run does not fit.
fn failures(run: &Path) -> Chain {
    Chain::new(&run.file_name().unwrap_or_default().to_string_lossy())
}

/// Writes down that an attempt at a run failed.
pub fn note_failure(run: &Path, why: &str) -> io::Result<()> {
    let why = why.lines().next().unwrap_or("failed");
    let mut file = own_file::open(&beside(run, "failed"))?;
    let text = regular_file::text(regular_file::read_open(&file, FAILED_BYTES_MAX)?);
    let text = text.unwrap_or_default();
    let Opened { bytes, mut chain, .. } = failures(run).open(&text);
    file.set_len(bytes as u64)?;
    file.seek(SeekFrom::End(0))?;
    writeln!(file, "{}", chain.seal(why))
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
    for step in steps(part, keep == Keep::Summary || keep == Keep::Failed && passed)? {
        step.take(part, run)?;
    }
    Ok(())
}

/// What is done to complete a run, in this order.
#[derive(Debug, Clone)]
enum Step {
    Remove(PathBuf),
    /// The run was written to its end.
    WriteChecksums,
    /// It gets its name: if the disk loses that, it is run again.
    Rename,
}

fn steps(part: &Path, is_summary: bool) -> io::Result<Vec<Step>> {
    let mut steps = Vec::new();
    if is_summary {
        for entry in fs::read_dir(part)? {
            let entry = entry?;
            if ![SCENARIO, MANIFEST, SUMMARY].iter().any(|&kept| entry.file_name() == kept) {
                steps.push(Step::Remove(entry.path()));
            }
        }
    }
    steps.extend([Step::WriteChecksums, Step::Rename]);
    Ok(steps)
}

impl Step {
    fn take(&self, part: &Path, run: &Path) -> io::Result<()> {
        match self {
            Step::Remove(path) if path.is_dir() => fs::remove_dir_all(path),
            Step::Remove(path) => fs::remove_file(path),
            Step::WriteChecksums => checksums::write(part, run),
            Step::Rename => match fs::rename(part, run) {
                Err(_) if checksums::check(run).is_ok() => fs::remove_dir_all(part),
                renamed => renamed,
            },
        }
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::results::checksums::CHECKSUMS;
    use crate::results::summary::to_json;

    const FILES: [&str; 4] = [SCENARIO, MANIFEST, SUMMARY, SAMPLES];

    fn found() -> Summary {
        Summary { t_s: 1.0, ..Summary::default() }
    }

    /// A run of which everything but its checksums is written.
    fn written(place: &Path) -> (PathBuf, PathBuf) {
        let (part, run) = (place.join("id.part-1-host"), place.join("id"));
        fs::create_dir_all(part.join("logs")).unwrap();
        let texts = ["name = 1\n", "{}\n", &to_json(&found()), "t_s\n0\n"];
        FILES.iter().zip(texts).for_each(|(name, text)| fs::write(part.join(name), text).unwrap());
        (part, run)
    }

    /// The power fails between any two writes, and of what is not synced any file is lost or cut.
    #[test]
    fn whenever_the_power_fails_a_run_is_whole_or_run_again() {
        let mut whole = 0;
        for (keep, files) in [(Keep::Summary, 3), (Keep::All, 4)] {
            let cuts = 0..=steps(&written(tempfile::tempdir().unwrap().path()).0, files == 3)
                .unwrap()
                .len();
            let losses = FILES[..files].iter().flat_map(|name| [(name, 0), (name, 4)]);
            let losses: Vec<_> = losses.map(Some).chain([None]).collect();
            for (cut, loss) in cuts.flat_map(|cut| losses.iter().map(move |&loss| (cut, loss))) {
                let place = tempfile::tempdir().unwrap();
                let (part, run) = written(place.path());
                for step in &steps(&part, files == 3).unwrap()[..cut] {
                    step.take(&part, &run).unwrap();
                }
                let is_named = run.exists();
                if let (Some((name, bytes)), true) = (loss, is_named) {
                    let file = fs::File::options().write(true).open(run.join(name)).unwrap();
                    file.set_len(bytes).unwrap();
                }
                let state = state(&run, keep).unwrap();
                let expected = match (is_named, loss) {
                    (false, _) => State::Missing,
                    (true, None) => State::Done(Box::new(found())),
                    (true, Some((name, _))) => {
                        State::Damaged(format!("{name} is not as the run wrote it"))
                    }
                };
                assert_eq!(state, expected, "after {cut} steps, {loss:?} lost");
                whole += usize::from(make_room(&run, keep).unwrap());
                let (part, run) = written(place.path());
                complete(&part, &run, keep, true).unwrap();
                assert_eq!(super::state(&run, keep).unwrap(), State::Done(Box::new(found())));
                assert!(!part.exists());
            }
        }
        // Once it has its name, and nothing of it is lost.
        assert_eq!(whole, 2);
    }

    #[test]
    fn no_file_of_a_run_may_be_lost_or_listed_beside_the_others() {
        let place = tempfile::tempdir().unwrap();
        let (part, run) = written(place.path());
        complete(&part, &run, Keep::All, true).unwrap();
        let listed = fs::read_to_string(run.join(CHECKSUMS)).unwrap();
        for wrong in ["", "?", &listed[..listed.len() / 2], &(listed.clone() + "0  other\n")] {
            fs::write(run.join(CHECKSUMS), wrong).unwrap();
            let damaged = matches!(state(&run, Keep::All).unwrap(), State::Damaged(_));
            assert!(damaged, "{wrong:?}");
        }
        fs::write(run.join(CHECKSUMS), listed).unwrap();
        fs::remove_file(run.join(MANIFEST)).unwrap();
        let gone = state(&run, Keep::All).unwrap();
        assert_eq!(gone, State::Damaged("manifest.json is missing".into()));
        // As a pipe, it has no content to be hashed.
        fs::create_dir(run.join(MANIFEST)).unwrap();
        let replaced = state(&run, Keep::All).unwrap();
        assert_eq!(replaced, State::Damaged("manifest.json is not as the run wrote it".into()));
    }
}
