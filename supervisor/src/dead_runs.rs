//! What runs that died left on tmpfs, and its removal: the work of `phalanx clean`. A new run does
//! the same for roots; this also finds shared memory whose root is gone, wherever it was.
//!
//! Must not: touch a run that is under way, or what belongs to another user.

use std::fmt::Write as _;
use std::fs;
use std::path::Path;

use protocol::run_root::{Leftover, SHARED_MEMORY, leftovers};

/// Removes what dead runs left below `base` and in shared memory, or only looks, if `dry_run`; what
/// there is to say, and what could not be removed.
pub fn remove(base: &Path, dry_run: bool) -> (String, Vec<String>) {
    let (mut said, mut failures) = (String::new(), Vec::new());
    let verb = if dry_run { "would remove" } else { "removed" };
    for leftover in leftovers(base) {
        let what = in_words(&leftover);
        match if dry_run { Ok(()) } else { leftover.remove() } {
            Ok(()) => drop(writeln!(said, "{verb} {what}")),
            Err(error) => failures.push(format!("cannot remove {what}: {error}")),
        }
    }
    if !dry_run {
        // The last one out; runs under way keep it.
        let _ = fs::remove_dir(base);
    }
    if said.is_empty() && failures.is_empty() {
        let _ =
            writeln!(said, "no dead run left anything in {} or {SHARED_MEMORY}", base.display());
    }
    (said, failures)
}

/// What a dead run left, on one line.
pub(crate) fn in_words(leftover: &Leftover) -> String {
    let files = &leftover.shared_memory;
    let bytes: u64 = files.iter().filter_map(|path| fs::metadata(path).ok()).map(|m| m.len()).sum();
    let memory = format!("{} files of shared memory ({} KiB)", files.len(), bytes.div_ceil(1024));
    match &leftover.root {
        Some(root) => format!("{} and {memory}", root.display()),
        None => format!("{memory} of a run whose root is gone, {}", leftover.pattern()),
    }
}
