//! What runs that died left on tmpfs, and its removal: the work of `phalanx clean`. A new run does
//! the same before it begins.
//!
//! Must not: touch a run that is under way, or what belongs to another user.

use std::fmt::Write as _;
use std::fs;
use std::os::unix::fs::MetadataExt as _;
use std::path::Path;

use protocol::run_root::{DeadRoot, dead_roots};
use protocol::scratch;
use supervisor::left_behind;

/// Removes what dead runs left below `base`, or only looks, if `dry_run`; what there is to say, and
/// what could not be removed.
pub fn remove(base: &Path, dry_run: bool) -> (String, Vec<String>) {
    let (mut said, mut failures) = (String::new(), Vec::new());
    let verb = if dry_run { "would remove" } else { "removed" };
    for root in dead_roots(base) {
        let what = in_words(&root);
        let ended = if dry_run { Vec::new() } else { left_behind::end_all_of(&root.path, None) };
        for named in ended {
            let _ = writeln!(said, "in a run that was killed, {named}");
        }
        match if dry_run { Ok(()) } else { root.remove() } {
            Ok(()) => drop(writeln!(said, "{verb} {what}")),
            Err(error) => failures.push(format!("cannot remove {what}: {error}")),
        }
    }
    if !dry_run {
        // The last one out; runs under way keep it.
        let _ = fs::remove_dir(base);
    }
    if said.is_empty() && failures.is_empty() {
        let _ = writeln!(said, "no dead run left anything in {}", base.display());
    }
    (said, failures)
}

/// What a dead run left, on one line.
pub(crate) fn in_words(root: &DeadRoot) -> String {
    let (files, bytes) = taken(&root.path);
    let mut text = format!("{}, {files} files, {} KiB", root.path.display(), bytes.div_ceil(1024));
    if let Some(folder) = scratch::find(&root.path) {
        let (files, bytes) = taken(&folder);
        let (folder, kib) = (folder.display(), bytes.div_ceil(1024));
        text += &format!(
            "; and {folder}, {files} files, {kib} KiB, where `phalanx verify` was repeating a run"
        );
    }
    text
}

/// How many files there are below a directory, and how many bytes they take.
fn taken(directory: &Path) -> (usize, u64) {
    let entries = fs::read_dir(directory).into_iter().flatten().flatten();
    entries.fold((0, 0), |(files, bytes), entry| match entry.metadata() {
        Ok(found) if found.is_dir() => {
            let (files_below, bytes_below) = taken(&entry.path());
            (files + files_below, bytes + bytes_below)
        }
        Ok(found) => (files + 1, bytes + 512 * found.blocks()),
        Err(_) => (files, bytes),
    })
}
