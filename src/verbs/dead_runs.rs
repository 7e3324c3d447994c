//! Finds and removes the files and processes that dead runs left behind, for `phalanx clean` and at the
//! start of each run.
//!
//! Must not touch a run that is in progress, or files of another user.

use std::fmt::Write as _;
use std::fs;
use std::os::unix::fs::MetadataExt as _;
use std::path::Path;

use protocol::run_root::{ExitedRunRoot, lock_dead_roots};
use protocol::scratch;
use supervisor::orphan_processes;

/// Removes the remains of dead runs below `base`, or only lists them if `dry_run`. Returns the text to
/// print, and the errors.
pub fn remove_dead_runs(base: &Path, dry_run: bool) -> (String, Vec<String>) {
    let (mut listing, mut failures) = (String::new(), Vec::new());
    let verb = if dry_run { "would remove" } else { "removed" };
    for root in lock_dead_roots(base) {
        let description = describe_dead_root(&root);
        let messages = if dry_run {
            Vec::new()
        } else {
            orphan_processes::kill_processes_of_run(&root.path, None)
        };
        for message in messages {
            let _ = writeln!(listing, "in a dead run, {message}");
        }
        match if dry_run { Ok(()) } else { root.remove() } {
            Ok(()) => drop(writeln!(listing, "{verb} {description}")),
            Err(error) => failures.push(format!("cannot remove {description}: {error}")),
        }
    }
    if !dry_run {
        // Fails while other runs are in progress, and the directory stays.
        let _ = fs::remove_dir(base);
    }
    if listing.is_empty() && failures.is_empty() {
        let _ = writeln!(listing, "no dead runs in {}", base.display());
    }
    (listing, failures)
}

/// Returns a line about the remains of a dead run.
pub(crate) fn describe_dead_root(root: &ExitedRunRoot) -> String {
    let (files, bytes) = disk_usage(&root.path);
    let mut text = format!("{}, {files} files, {} KiB", root.path.display(), bytes.div_ceil(1024));
    if let Some(folder) = scratch::find(&root.path) {
        let (files, bytes) = disk_usage(&folder);
        let (folder, kib) = (folder.display(), bytes.div_ceil(1024));
        text += &format!(
            "; and {folder}, {files} files, {kib} KiB, where `phalanx verify` was repeating a run"
        );
    }
    text
}

/// Returns the number of files below a directory, and their size in bytes.
fn disk_usage(directory: &Path) -> (usize, u64) {
    let entries = fs::read_dir(directory).into_iter().flatten().flatten();
    entries.fold((0, 0), |(files, bytes), entry| match entry.metadata() {
        Ok(metadata) if metadata.is_dir() => {
            let (files_below, bytes_below) = disk_usage(&entry.path());
            (files + files_below, bytes + bytes_below)
        }
        Ok(metadata) => (files + 1, bytes + 512 * metadata.blocks()),
        Err(_) => (files, bytes),
    })
}
