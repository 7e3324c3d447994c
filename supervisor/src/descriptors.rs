//! How many files a run has open, and room for them.

use rustix::process::{Resource, Rlimit, getrlimit, setrlimit};

/// Descriptors of the supervisor, measured with 8 and 64 robots: 28, and 17 for each robot; with
/// `--view-control` 4 more for each, and a few for those who look on. No other process needs as many.
const OF_A_RUN: u64 = 40;
const OF_A_ROBOT: u64 = 21;

/// The machine does not permit so many.
#[derive(Debug, thiserror::Error)]
#[error(
    "{robots} robots need {needed} open files, and no process may have more than {most} \
     (RLIMIT_NOFILE): raise it by `ulimit -n {needed}` as root, or by nofile in \
     /etc/security/limits.conf"
)]
pub struct TooFew {
    robots: usize,
    needed: u64,
    most: u64,
}

/// How many descriptors the supervisor of so many robots needs.
pub fn needed(robots: usize) -> u64 {
    OF_A_RUN + OF_A_ROBOT * robots as u64
}

/// How many this process may have, if it asks for them; `None` is no limit.
pub fn most() -> Option<u64> {
    getrlimit(Resource::Nofile).maximum
}

/// Sees to it that this process may open what so many robots need. Most machines begin with 1024,
/// for the sake of old programs, and permit far more.
pub(crate) fn make_room(robots: usize) -> Result<(), TooFew> {
    let Rlimit { current, maximum } = getrlimit(Resource::Nofile);
    let needed = needed(robots);
    if current.is_none_or(|current| current >= needed) {
        return Ok(());
    }
    let raised = Rlimit { current: Some(needed), maximum };
    setrlimit(Resource::Nofile, raised).map_err(|_| TooFew {
        robots,
        needed,
        most: maximum.unwrap_or(u64::MAX),
    })
}
