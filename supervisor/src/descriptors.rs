//! Open files of the supervisor: how many a run needs, and the limit that permits them.

use std::fmt;
use std::fs;
use std::sync::atomic::{AtomicU64, Ordering};

use rustix::process::{Resource, Rlimit, getrlimit, setrlimit};

/// Descriptors of the supervisor beyond those per robot, measured with 8 and 64 robots: 28, plus 17 for
/// each robot; `--view-control` adds 4 for each. No other process needs as many.
const OF_A_RUN: u64 = 40;
const OF_A_ROBOT: u64 = 21;
/// Reserve for the clients of a live view, which closes connections beyond 64, and for its own files.
const OF_A_VIEW: u64 = 72;

/// Descriptors beyond the first three that were open when this process began.
static INHERITED_DESCRIPTORS: AtomicU64 = AtomicU64::new(0);

/// The limit of the machine permits too few open files.
#[derive(Debug, thiserror::Error)]
#[error(
    "{need}, and no process may have more than {most} (RLIMIT_NOFILE): raise it by `ulimit -n {}` as root, or by \
     nofile in /etc/security/limits.conf",
    need.files()
)]
pub struct TooFewDescriptors {
    need: Need,
    most: u64,
}

/// Open files that a run needs.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Need {
    robots: usize,
    has_view: bool,
    inherited: u64,
}

impl Need {
    /// Returns the need of a run with that number of robots in this process.
    pub(crate) fn for_run(robots: usize, has_view: bool) -> Need {
        Need { robots, has_view, inherited: INHERITED_DESCRIPTORS.load(Ordering::Relaxed) }
    }

    fn view_descriptors(&self) -> u64 {
        if self.has_view { OF_A_VIEW } else { 0 }
    }

    fn files(&self) -> u64 {
        needed_descriptors(self.robots) + self.view_descriptors() + self.inherited
    }
}

impl fmt::Display for Need {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{} robots need {} open files", self.robots, needed_descriptors(self.robots))?;
        if self.has_view {
            write!(f, ", the live view {OF_A_VIEW}")?;
        }
        match self.inherited {
            0 => Ok(()),
            open => write!(f, ", {open} more are open already (inherited from the parent process)"),
        }
    }
}

/// Returns the number of descriptors that the supervisor of `robots` robots needs, without inherited descriptors.
pub fn needed_descriptors(robots: usize) -> u64 {
    OF_A_RUN + OF_A_ROBOT * robots as u64
}

/// Returns the hard limit of open files; `None` means that there is no limit.
pub fn read_limit() -> Option<u64> {
    getrlimit(Resource::Nofile).maximum
}

/// Counts the descriptors that this process has inherited beyond the first three. Call it before the process opens any.
pub(crate) fn count_inherited() {
    let numbers = fs::read_dir("/proc/self/fd").into_iter().flatten().flatten();
    let numbers = numbers.filter_map(|entry| entry.file_name().to_str()?.parse::<u32>().ok());
    // One of them reads that folder.
    let beyond = numbers.filter(|&number| number > 2).count().saturating_sub(1);
    INHERITED_DESCRIPTORS.store(beyond as u64, Ordering::Relaxed);
}

/// Raises the soft limit of open files to what a run needs. Most machines begin with 1024, for the sake of old
/// programs, and permit far more.
///
/// # Errors
/// The hard limit is lower than the need.
pub(crate) fn make_room(need: Need) -> Result<(), TooFewDescriptors> {
    let Rlimit { current, maximum } = getrlimit(Resource::Nofile);
    let files = need.files();
    if current.is_none_or(|current| current >= files) {
        return Ok(());
    }
    let raised = Rlimit { current: Some(files), maximum };
    setrlimit(Resource::Nofile, raised)
        .map_err(|_| TooFewDescriptors { need, most: maximum.unwrap_or(u64::MAX) })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn open_files_of_view_and_parent_are_part_of_the_need() {
        let alone = Need { robots: 3, has_view: false, inherited: 0 };
        assert_eq!(
            (alone.files(), alone.to_string().as_str()),
            (103, "3 robots need 103 open files")
        );
        let all = Need { has_view: true, inherited: 100, ..alone };
        let error = TooFewDescriptors { need: all, most: 200 }.to_string();
        assert!(
            error.starts_with("3 robots need 103 open files, the live view 72, 100 more"),
            "{error}"
        );
        assert!(error.contains("more than 200") && error.contains("`ulimit -n 275`"), "{error}");
    }
}
