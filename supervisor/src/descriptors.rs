//! Open files of the supervisor: how many a run needs, and the limit that permits them.

use std::fmt;
use std::fs;
use std::sync::atomic::{AtomicU64, Ordering};

use rustix::process::{Resource, Rlimit, getrlimit, setrlimit};

/// Descriptors of the supervisor beyond those per robot, measured with 8 and 64 robots: 28, plus 17 for
/// each robot. No other process needs as many.
const DESCRIPTORS_OF_A_RUN: u64 = 40;
const DESCRIPTORS_OF_A_ROBOT: u64 = 18;
/// Descriptors for each robot whose links may be cut from a live view.
const DESCRIPTORS_OF_A_CONTROLLED_ROBOT: u64 = 4;
/// Reserve for the clients of a live view, which closes connections beyond 64, and for its own files.
const DESCRIPTORS_OF_A_VIEW: u64 = 72;

/// Descriptors beyond the first three that were open when this process began.
static INHERITED_DESCRIPTORS: AtomicU64 = AtomicU64::new(0);

/// The limit of the machine permits too few open files.
#[derive(Debug, thiserror::Error)]
#[error(
    "{need}, and no process may have more than {maximum} (RLIMIT_NOFILE): raise it by `ulimit -n {}` as root, or by \
     nofile in /etc/security/limits.conf",
    need.files()
)]
pub struct TooFewDescriptors {
    pub(crate) need: RequiredDescriptors,
    pub(crate) maximum: u64,
}

/// Use of the live view in a run.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum ViewUse {
    /// The run has no live view.
    Off,
    /// Clients of the view watch the run.
    Watch,
    /// Clients of the view watch the run, and may inject faults.
    Control,
}

/// Open files that a run needs.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct RequiredDescriptors {
    robots: usize,
    view: ViewUse,
    inherited_count: u64,
}

impl RequiredDescriptors {
    /// Returns the need of a run with that number of robots in this process.
    pub(crate) fn for_run(robots: usize, view: ViewUse) -> RequiredDescriptors {
        RequiredDescriptors {
            robots,
            view,
            inherited_count: INHERITED_DESCRIPTORS.load(Ordering::Relaxed),
        }
    }

    fn view_descriptors(&self) -> u64 {
        match self.view {
            ViewUse::Off => 0,
            ViewUse::Watch => DESCRIPTORS_OF_A_VIEW,
            ViewUse::Control => {
                DESCRIPTORS_OF_A_VIEW + DESCRIPTORS_OF_A_CONTROLLED_ROBOT * self.robots as u64
            }
        }
    }

    fn files(&self) -> u64 {
        needed_descriptors(self.robots) + self.view_descriptors() + self.inherited_count
    }
}

impl fmt::Display for RequiredDescriptors {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{} robots need {} open files", self.robots, needed_descriptors(self.robots))?;
        if self.view != ViewUse::Off {
            write!(f, ", the live view {}", self.view_descriptors())?;
        }
        match self.inherited_count {
            0 => Ok(()),
            inherited => {
                write!(f, ", {inherited} more are open already (inherited from the parent process)")
            }
        }
    }
}

/// Returns the number of descriptors that the supervisor of `robots` robots needs, without inherited descriptors.
pub fn needed_descriptors(robots: usize) -> u64 {
    DESCRIPTORS_OF_A_RUN + DESCRIPTORS_OF_A_ROBOT * robots as u64
}

/// Returns the hard limit of open files; `None` means that there is no limit.
pub fn read_limit() -> Option<u64> {
    getrlimit(Resource::Nofile).maximum
}

/// Counts the descriptors that this process has inherited beyond the first three. Call it before the process opens any.
pub(crate) fn count_inherited_descriptors() {
    let numbers = fs::read_dir("/proc/self/fd").into_iter().flatten().flatten();
    let numbers = numbers.filter_map(|entry| entry.file_name().to_str()?.parse::<u32>().ok());
    // One of them reads that folder.
    let inherited_count = numbers.filter(|&number| number > 2).count().saturating_sub(1);
    INHERITED_DESCRIPTORS.store(inherited_count as u64, Ordering::Relaxed);
}

/// Raises the soft limit of open files to what a run needs. Most machines begin with 1024, for the sake of old
/// programs, and permit far more.
///
/// # Errors
/// The hard limit is lower than the need.
pub(crate) fn raise_descriptor_limit(need: RequiredDescriptors) -> Result<(), TooFewDescriptors> {
    let Rlimit { current, maximum } = getrlimit(Resource::Nofile);
    let files = need.files();
    if current.is_none_or(|current| current >= files) {
        return Ok(());
    }
    let new_limit = Rlimit { current: Some(files), maximum };
    setrlimit(Resource::Nofile, new_limit)
        .map_err(|_| TooFewDescriptors { need, maximum: maximum.unwrap_or(u64::MAX) })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn open_files_of_view_and_parent_are_part_of_the_need() {
        let alone = RequiredDescriptors { robots: 3, view: ViewUse::Off, inherited_count: 0 };
        assert_eq!(
            (alone.files(), alone.to_string().as_str()),
            (94, "3 robots need 94 open files")
        );
        let all = RequiredDescriptors { view: ViewUse::Watch, inherited_count: 100, ..alone };
        let error = TooFewDescriptors { need: all, maximum: 200 }.to_string();
        assert!(
            error.starts_with("3 robots need 94 open files, the live view 72, 100 more"),
            "{error}"
        );
        assert!(error.contains("more than 200") && error.contains("`ulimit -n 266`"), "{error}");
        let controlled = RequiredDescriptors { view: ViewUse::Control, ..alone };
        assert_eq!(controlled.files(), 94 + 72 + 3 * 4);
    }
}
