//! Folder of a campaign: which runs are complete, given up or missing.
//!
//! A run is complete when its directory exists and matches its checksums. The run is written under a temporary
//! name, the checksums last, and then renamed. An interrupted run therefore leaves no directory of its final name.
//! A directory with lost or changed files is damaged, and the run is repeated.

use std::fs;
use std::io::{self, Seek as _, SeekFrom, Write as _};
use std::path::{Path, PathBuf};

use protocol::regular_file::{self, SymlinkPolicy};
use rustix::fs::{FlockOperation, flock};
use rustix::io::Errno;

use crate::metrics::summary::Summary;
use crate::results::files::chained::{ChecksumChain, VerifiedLines};
use crate::results::files::checksums::{self, Damage, replace_file, sync_folder};
use crate::results::files::host_dir::SCENARIO_FILE;
use crate::results::files::own_file;
use crate::results::run_dir::{MANIFEST_FILE, SAMPLES_FILE, SUMMARY_FILE};
use experiment::campaign::cells::CampaignRun;
use experiment::campaign::file::FileRetention;
use experiment::scenario::file::check_inside_folder;

/// Maximum number of failed attempts at a run. Then the run is given up.
pub const ATTEMPTS_MAX: usize = 3;

/// Name of the lock file. The process that runs the campaign locks it and writes its identity into it.
const LOCK_FILE: &str = ".lock";

/// Maximum length of the text that identifies the lock holder, bytes. A longer text is not shown.
const HOLDER_BYTES_MAX: u64 = 1 << 12;
/// Maximum size of a list of failed attempts, bytes. A larger list is ignored.
const FAILURE_LIST_BYTES_MAX: u64 = 1 << 20;
/// Maximum size of a summary, bytes. A run with a larger summary counts as damaged.
const SUMMARY_BYTES_MAX: u64 = 1 << 30;

/// Directory that holds the runs of a campaign.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct CampaignFolder {
    path: PathBuf,
}

/// Status of a run.
#[derive(Debug, Clone, PartialEq)]
pub enum RunState {
    /// The run has a result.
    Done(Box<Summary>),
    /// The run failed [`ATTEMPTS_MAX`] times, the last time for this reason.
    GivenUp(String),
    /// The run has not been computed, or fewer of its files were kept than are requested now.
    Missing,
    /// The run's files differ from what was written, for this reason. The run must be repeated.
    Damaged(String),
}

impl RunState {
    /// Returns whether the run has no result yet and has not been given up.
    pub fn needs_run(&self) -> bool {
        matches!(self, RunState::Missing | RunState::Damaged(_))
    }
}

/// Error of an operation on the campaign folder.
#[derive(Debug, thiserror::Error)]
#[error("cannot {what} {}: {source}", path.display())]
pub struct FolderError {
    what: &'static str,
    path: PathBuf,
    source: io::Error,
}

pub(crate) fn file_error(what: &'static str, path: &Path) -> impl FnOnce(io::Error) -> FolderError {
    let path = path.to_path_buf();
    move |source| FolderError { what, path, source }
}

/// Reason why the campaign folder cannot be locked.
#[derive(Debug, thiserror::Error)]
pub enum LockError {
    /// Another sweep or hunt holds the lock: the folder, and the process and host that hold it.
    #[error("another `phalanx` ({}) is using {}; wait for it, or choose another directory with --out", .1, .0.display())]
    HeldByProcess(PathBuf, String),
    /// The lock file cannot be locked.
    #[error("cannot lock {}: {}", .0.display(), .1)]
    Unlockable(PathBuf, io::Error),
}

/// Exclusive lock on a campaign folder. Dropping it or ending the process releases it.
#[derive(Debug)]
pub struct FolderLock {
    _file: fs::File,
}

impl CampaignFolder {
    /// Opens a campaign folder and creates it if it does not exist.
    pub fn open(path: &Path) -> Result<CampaignFolder, FolderError> {
        CampaignFolder::open_with_subfolders(path, &["runs", "figures"])
    }

    /// Opens a folder and creates it and these subfolders if they do not exist.
    ///
    /// # Errors
    ///
    /// A folder cannot be created, or a subfolder leads out of `path` by a symbolic link.
    pub fn open_with_subfolders(
        path: &Path,
        folders: &[&str],
    ) -> Result<CampaignFolder, FolderError> {
        for folder in folders.iter().map(|folder| path.join(folder)) {
            fs::create_dir_all(&folder).map_err(file_error("make", &folder))?;
            check_inside_folder(path, &folder).map_err(file_error("write into", &folder))?;
        }
        let path = path.canonicalize().map_err(file_error("open", path))?;
        Ok(CampaignFolder { path })
    }

    /// Locks the folder against other sweeps and hunts. On a file system without locks, only prints a warning.
    pub fn lock(&self) -> Result<FolderLock, LockError> {
        let path = self.path.join(LOCK_FILE);
        let unlockable = |error| LockError::Unlockable(path.clone(), error);
        let mut file = own_file::open_regular_file(&path).map_err(unlockable)?;
        match flock(&file, FlockOperation::NonBlockingLockExclusive) {
            Ok(()) => {}
            Err(Errno::WOULDBLOCK) => {
                let holder = regular_file::read_rest(&file, HOLDER_BYTES_MAX).unwrap_or_default();
                let holder = String::from_utf8_lossy(&holder).trim().to_owned();
                return Err(LockError::HeldByProcess(self.path.clone(), holder));
            }
            // The file system supports no locks; two processes may then compute the same runs.
            Err(Errno::NOSYS | Errno::OPNOTSUPP | Errno::NOLCK) => {
                tracing::warn!("{} cannot be locked: start one sweep at a time", path.display());
            }
            Err(error) => return Err(unlockable(error.into())),
        }
        let holder = format!("process {} on {}\n", std::process::id(), host_name());
        file.set_len(0).and_then(|()| file.write_all(holder.as_bytes())).map_err(unlockable)?;
        Ok(FolderLock { _file: file })
    }

    /// Returns the absolute path of the folder.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// Returns the directory that a complete run has.
    pub fn run_path(&self, id: &str) -> PathBuf {
        self.path.join("runs").join(id)
    }

    /// Reads the status of each run, in the order of `cells`.
    pub fn read_states(
        &self,
        cells: &[CampaignRun],
        keep: FileRetention,
    ) -> Result<Vec<RunState>, FolderError> {
        cells.iter().map(|cell| read_state(&self.run_path(&cell.id), keep)).collect()
    }

    /// Removes the lists of failed attempts, so that runs that were given up are tried again.
    pub fn clear_failures(&self, cells: &[CampaignRun]) {
        for cell in cells {
            let _ = fs::remove_file(sibling_path(&self.run_path(&cell.id), "failed"));
        }
    }

    /// Removes partial runs of exited processes of this host, and logs of complete runs.
    pub fn remove_stale_files(&self) {
        let host = host_name();
        for entry in fs::read_dir(self.path.join("runs")).into_iter().flatten().flatten() {
            let name = entry.file_name().to_string_lossy().into_owned();
            if name.strip_suffix(".log").is_some_and(|id| self.run_path(id).exists()) {
                let _ = fs::remove_file(entry.path());
            }
            let Some((_, owner)) = name.split_once(".part-") else { continue };
            let Some((pid, owner_host)) = owner.split_once('-') else { continue };
            if owner_host == host && !is_running(pid) {
                let _ = fs::remove_dir_all(entry.path());
            }
        }
    }

    /// Syncs the directory entries of the runs to disk.
    pub fn sync(&self) -> Result<(), FolderError> {
        let runs = self.path.join("runs");
        sync_folder(&runs).map_err(file_error("sync", &runs))
    }

    /// Replaces a file atomically: readers see the old content or the new content.
    pub fn replace_file(&self, name: &str, content: &str) -> Result<(), FolderError> {
        let path = self.path.join(name);
        replace_file(&path, content, false).map_err(file_error("write", &path))
    }
}

/// Reads the status of a run.
///
/// # Errors
///
/// A file exists and cannot be read. Missing and changed files make the run [`RunState::Damaged`] instead.
pub fn read_state(run: &Path, keep: FileRetention) -> Result<RunState, FolderError> {
    if fs::symlink_metadata(run).is_err_and(|error| error.kind() == io::ErrorKind::NotFound) {
        let attempts = read_failed_attempts(run);
        return Ok(match attempts.last() {
            Some(last) if attempts.len() >= ATTEMPTS_MAX => RunState::GivenUp(last.clone()),
            _ => RunState::Missing,
        });
    }
    match checksums::check_run_files(run) {
        Ok(()) => {}
        Err(Damage::UnreadableFile(name, error)) => {
            return Err(file_error("read", &run.join(name))(error));
        }
        Err(damage) => return Ok(RunState::Damaged(damage.to_string())),
    }
    let read =
        regular_file::read(&run.join(SUMMARY_FILE), SymlinkPolicy::Followed, SUMMARY_BYTES_MAX);
    let summary = read.and_then(|text| Ok(serde_json::from_slice::<Box<Summary>>(&text)?));
    Ok(match summary {
        Err(error) => RunState::Damaged(format!("{SUMMARY_FILE}: {error}")),
        Ok(summary) => {
            let is_requested =
                keep == FileRetention::All || keep == FileRetention::Failed && summary.exit != 0;
            let is_incomplete = is_requested && !run.join(SAMPLES_FILE).exists();
            if is_incomplete { RunState::Missing } else { RunState::Done(summary) }
        }
    })
}

/// Prepares the directory of a run for writing. Returns `true` if the run is already complete. A damaged run is
/// renamed to RUN.damaged; a run with fewer files than `keep` requests is removed.
pub fn prepare_run(run: &Path, keep: FileRetention) -> Result<bool, FolderError> {
    match read_state(run, keep)? {
        RunState::Done(_) => return Ok(true),
        RunState::Damaged(_) => {
            let damaged_path = sibling_path(run, "damaged");
            let _ = fs::remove_dir_all(&damaged_path);
            // Another process may have renamed the directory first.
            match fs::rename(run, &damaged_path) {
                Err(error) if error.kind() == io::ErrorKind::NotFound => {}
                renamed => renamed.map_err(file_error("rename", run))?,
            }
        }
        RunState::Missing if run.exists() => {
            fs::remove_dir_all(run).map_err(file_error("remove", run))?
        }
        RunState::Missing | RunState::GivenUp(_) => {}
    }
    Ok(false)
}

/// Returns the reasons of the failed attempts at a run, in order. Lines with a wrong checksum are ignored, so the
/// run is tried again.
pub fn read_failed_attempts(run: &Path) -> Vec<String> {
    let path = sibling_path(run, "failed");
    let text = regular_file::read_to_string(&path, SymlinkPolicy::Refused, FAILURE_LIST_BYTES_MAX);
    let text = text.unwrap_or_default();
    let lines = failure_list_chain(run).verify(&text).lines;
    lines.into_iter().map(str::to_owned).collect()
}

/// Returns the initial checksum chain of the list of failed attempts. It depends on the run, so the list of another
/// run does not match.
fn failure_list_chain(run: &Path) -> ChecksumChain {
    ChecksumChain::new(&run.file_name().unwrap_or_default().to_string_lossy())
}

/// Appends a failed attempt and its reason to the list of the run.
pub fn append_failure(run: &Path, reason: &str) -> io::Result<()> {
    let reason = reason.lines().next().unwrap_or("failed");
    let mut file = own_file::open_regular_file(&sibling_path(run, "failed"))?;
    let text = regular_file::decode_utf8(regular_file::read_rest(&file, FAILURE_LIST_BYTES_MAX)?);
    let text = text.unwrap_or_default();
    let VerifiedLines { length_bytes, mut chain, .. } = failure_list_chain(run).verify(&text);
    file.set_len(length_bytes as u64)?;
    file.seek(SeekFrom::End(0))?;
    writeln!(file, "{}", chain.append_checksum(reason))
}

/// Returns the temporary name under which this process writes a run.
pub fn partial_dir(run: &Path) -> PathBuf {
    partial_run_dir(run, std::process::id())
}

/// Returns the temporary name under which process `pid` of this host writes a run.
pub fn partial_run_dir(run: &Path, pid: u32) -> PathBuf {
    sibling_path(run, &format!("part-{pid}-{}", host_name()))
}

/// Completes a run that is fully written in `part`: removes the files that `keep` does not request, writes the
/// checksums and renames the directory to `run`. If another process has completed the same run meanwhile, its
/// directory stays.
pub fn complete_run(part: &Path, run: &Path, keep: FileRetention, passed: bool) -> io::Result<()> {
    for step in completion_steps(
        part,
        keep == FileRetention::Summary || keep == FileRetention::Failed && passed,
    )? {
        step.execute(part, run)?;
    }
    Ok(())
}

/// Step of completing a run.
#[derive(Debug, Clone)]
enum CompletionStep {
    Remove(PathBuf),
    /// Writes the checksums. All other files are complete.
    WriteChecksums,
    /// Renames the directory to its final name. If the disk loses the rename, the run is repeated.
    Rename,
}

fn completion_steps(part: &Path, keeps_summary_only: bool) -> io::Result<Vec<CompletionStep>> {
    let mut steps = Vec::new();
    if keeps_summary_only {
        for entry in fs::read_dir(part)? {
            let entry = entry?;
            if ![SCENARIO_FILE, MANIFEST_FILE, SUMMARY_FILE]
                .iter()
                .any(|&name| entry.file_name() == name)
            {
                steps.push(CompletionStep::Remove(entry.path()));
            }
        }
    }
    steps.extend([CompletionStep::WriteChecksums, CompletionStep::Rename]);
    Ok(steps)
}

impl CompletionStep {
    fn execute(&self, part: &Path, run: &Path) -> io::Result<()> {
        match self {
            CompletionStep::Remove(path) if path.is_dir() => fs::remove_dir_all(path),
            CompletionStep::Remove(path) => fs::remove_file(path),
            CompletionStep::WriteChecksums => checksums::write_checksums(part, run),
            CompletionStep::Rename => match fs::rename(part, run) {
                Err(_) if checksums::check_run_files(run).is_ok() => fs::remove_dir_all(part),
                renamed => renamed,
            },
        }
    }
}

/// Returns the path next to a run that has the run's name and this extension.
pub fn sibling_path(run: &Path, ending: &str) -> PathBuf {
    let name = run.file_name().unwrap_or_default().to_string_lossy().into_owned();
    run.with_file_name(format!("{name}.{ending}"))
}

/// Returns whether a process with this ID exists and is not a zombie.
fn is_running(pid: &str) -> bool {
    let stat = fs::read_to_string(format!("/proc/{pid}/stat")).unwrap_or_default();
    // The state follows the process name, which may contain any characters.
    let state = stat.rsplit_once(") ").map(|(_, rest)| rest.chars().next());
    matches!(state, Some(Some(state)) if !"ZX".contains(state))
}

fn host_name() -> String {
    rustix::system::uname().nodename().to_string_lossy().into_owned()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::results::files::checksums::CHECKSUMS_FILE;
    use crate::results::summary::to_json;

    const FILES: [&str; 4] = [SCENARIO_FILE, MANIFEST_FILE, SUMMARY_FILE, SAMPLES_FILE];

    fn example_summary() -> Summary {
        Summary { t_s: 1.0, ..Summary::default() }
    }

    /// Writes a run without its checksums. Returns its temporary and its final path.
    fn write_example_run(folder: &Path) -> (PathBuf, PathBuf) {
        let (part, run) = (folder.join("id.part-1-host"), folder.join("id"));
        fs::create_dir_all(part.join("logs")).unwrap();
        let texts = ["name = 1\n", "{}\n", &to_json(&example_summary()), "t_s\n0\n"];
        FILES.iter().zip(texts).for_each(|(name, text)| fs::write(part.join(name), text).unwrap());
        (part, run)
    }

    /// Simulates a power failure between any two writes; of the files that were not synced any one is lost or
    /// truncated.
    #[test]
    fn power_failure_leaves_each_run_complete_or_repeatable() {
        let mut complete_count = 0;
        for (keep, files) in [(FileRetention::Summary, 3), (FileRetention::All, 4)] {
            let step_counts = 0..=completion_steps(
                &write_example_run(tempfile::tempdir().unwrap().path()).0,
                files == 3,
            )
            .unwrap()
            .len();
            let losses = FILES[..files].iter().flat_map(|name| [(name, 0), (name, 4)]);
            let losses: Vec<_> = losses.map(Some).chain([None]).collect();
            for (step_count, loss) in step_counts
                .flat_map(|step_count| losses.iter().map(move |&loss| (step_count, loss)))
            {
                let folder = tempfile::tempdir().unwrap();
                let (part, run) = write_example_run(folder.path());
                for step in &completion_steps(&part, files == 3).unwrap()[..step_count] {
                    step.execute(&part, &run).unwrap();
                }
                let is_renamed = run.exists();
                if let (Some((name, bytes)), true) = (loss, is_renamed) {
                    let file = fs::File::options().write(true).open(run.join(name)).unwrap();
                    file.set_len(bytes).unwrap();
                }
                let state = read_state(&run, keep).unwrap();
                let expected = match (is_renamed, loss) {
                    (false, _) => RunState::Missing,
                    (true, None) => RunState::Done(Box::new(example_summary())),
                    (true, Some((name, _))) => {
                        RunState::Damaged(format!("{name} is not as the run wrote it"))
                    }
                };
                assert_eq!(state, expected, "after {step_count} steps, {loss:?} lost");
                complete_count += usize::from(prepare_run(&run, keep).unwrap());
                let (part, run) = write_example_run(folder.path());
                complete_run(&part, &run, keep, true).unwrap();
                assert_eq!(
                    super::read_state(&run, keep).unwrap(),
                    RunState::Done(Box::new(example_summary()))
                );
                assert!(!part.exists());
            }
        }
        // A run is complete only if it was renamed and nothing was lost.
        assert_eq!(complete_count, 2);
    }

    #[test]
    fn missing_or_extra_file_makes_a_run_damaged() {
        let folder = tempfile::tempdir().unwrap();
        let (part, run) = write_example_run(folder.path());
        complete_run(&part, &run, FileRetention::All, true).unwrap();
        let listed = fs::read_to_string(run.join(CHECKSUMS_FILE)).unwrap();
        for wrong in ["", "?", &listed[..listed.len() / 2], &(listed.clone() + "0  other\n")] {
            fs::write(run.join(CHECKSUMS_FILE), wrong).unwrap();
            let damaged =
                matches!(read_state(&run, FileRetention::All).unwrap(), RunState::Damaged(_));
            assert!(damaged, "{wrong:?}");
        }
        fs::write(run.join(CHECKSUMS_FILE), listed).unwrap();
        fs::remove_file(run.join(MANIFEST_FILE)).unwrap();
        let state = read_state(&run, FileRetention::All).unwrap();
        assert_eq!(state, RunState::Damaged("manifest.json is missing".into()));
        // A directory has no content to hash, as a pipe has none.
        fs::create_dir(run.join(MANIFEST_FILE)).unwrap();
        let replaced = read_state(&run, FileRetention::All).unwrap();
        assert_eq!(replaced, RunState::Damaged("manifest.json is not as the run wrote it".into()));
    }
}
