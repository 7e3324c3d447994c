//! `phalanx bench`, the program `phalanx-bench`: how fast this machine could be, how fast we are, and the ratio of both.
//!
//! Floors and ours take turns within one run, so that whatever else the machine does meets both
//! alike. Timings are printed and never judged: nothing in here is a test. Must not: leave a
//! process or a file behind, or wait without a deadline.
//!
//! | file | question it answers |
//! |---|---|
//! | `cli` | what was asked for, and in which order is it measured? |
//! | `round_trip` | how long from a robot's sample to its command, and over bare transports? |
//! | `cores` | on which cores? |
//! | `lockstep` | how many ticks a second, and without iceoryx2? |
//! | `floor` | the same brains and world over a mapping or over pipes |
//! | `realtime` | how many deadlines are missed, at which rate and size? |
//! | `timers` | and how many by processes that do nothing but wake? |
//! | `whose` | why were they late, and who held the cores? |
//! | `control` | is anybody later than the bare timer of the same run, and who held the cores? |
//! | `causes` | are late wake-ups told their true cause? |
//! | `neighbor` | how long from a neighbor's publication to its use? |
//! | `view` | is anybody later if a browser looks on? |
//! | `hosts` | how long from one host to another, one way? Behind the feature `bridge` |
//! | `growth` | what does a tick cost, to 256 robots, and how does that grow? |
//! | `pages` | which pages of memory does a tick touch? |
//! | `segments` | what is the memory of a process for? |
//! | `startup` | how long until everybody is ready? |
//! | `replacement` | how long from a kill to the replacement's first command? |
//! | `ring` | which scenario is run? |
//! | `child` | one `phalanx run` as a child, and its summary |
//! | `peers` | child processes that take part in a measurement, and their end |
//! | `mapping`, `pipe` | plain shared memory, and plain pipes |
//! | `quantiles` | what is told of a spread of times? |
//! | `machine` | on what was it measured? |
//! | `table` | medians with least and most, on a screen and as JSON |

mod causes;
mod child;
pub mod cli;
mod control;
mod cores;
mod floor;
mod growth;
#[cfg(feature = "bridge")]
mod hosts;
mod lockstep;
mod machine;
mod mapping;
mod neighbor;
mod pages;
mod peers;
mod pipe;
mod quantiles;
mod realtime;
mod replacement;
pub mod ring;
mod round_trip;
mod segments;
mod startup;
mod table;
mod timers;
mod view;
mod whose;

use std::io::{self, Write as _};
use std::path::{Path, PathBuf};
use std::time::Duration;

use protocol::process::Stop;
use protocol::run_root::RunRoot;

/// How long a process under measurement may owe another an answer.
const HUNG_AFTER: Duration = Duration::from_secs(60);

/// Why there is no figure.
#[derive(Debug, thiserror::Error)]
enum BenchError {
    /// A signal came.
    #[error("interrupted")]
    Interrupted,
    /// A file, pipe, socket or mapping failed.
    #[error("cannot {action} {path}: {source}")]
    Io { action: &'static str, path: PathBuf, source: io::Error },
    /// A process of a measurement ended or hung.
    #[error("{what}; the last lines of its log:\n{log}")]
    Peer { what: String, log: String },
    /// What came back was not what was sent for.
    #[error("{0}")]
    Wrong(String),
    #[error(transparent)]
    RunRoot(#[from] protocol::run_root::RunRootError),
    #[error(transparent)]
    Service(#[from] protocol::service::ServiceError),
    #[error(transparent)]
    Barrier(#[from] protocol::barrier::BarrierError),
    #[error(transparent)]
    Spawn(#[from] supervisor::spawn::SpawnError),
    #[error(transparent)]
    Brief(#[from] protocol::brief::BriefError),
    #[error(transparent)]
    Brain(#[from] agent::brain::BrainError),
}

/// The rows of one part.
type Measured = Result<Vec<table::Row>, BenchError>;

/// What all measurements have in common.
struct Setting<'a> {
    root: &'a RunRoot,
    stop: &'a Stop,
    /// How often ours and the floors take turns.
    rounds: usize,
    /// Somebody looks on.
    tells: bool,
    /// In real time robots, plant and timers run before every ordinary process.
    realtime_priority: bool,
}

impl Setting<'_> {
    /// How a case of real time is named.
    fn realtime_case(&self, robots: usize, rate_hz: u64) -> String {
        let priority = if self.realtime_priority { " with real-time priority" } else { "" };
        format!("{robots} robots at {rate_hz} Hz{priority}")
    }

    /// Says what is being measured.
    fn progress(&self, what: &str) {
        if self.tells {
            let _ = write!(io::stderr(), "\r\x1b[K{what} of {}", self.rounds);
        }
    }
}

/// Says which file it was.
fn failed(action: &'static str, path: &Path) -> impl FnOnce(io::Error) -> BenchError {
    let path = path.to_owned();
    move |source| BenchError::Io { action, path, source }
}

/// A directory of one measurement in the bench's run root, on tmpfs, removed with everything in it.
struct Place(PathBuf);

impl Place {
    fn new(root: &RunRoot, name: &str) -> Result<Place, BenchError> {
        let path = root.path().join(name);
        std::fs::create_dir(&path).map_err(failed("make", &path))?;
        Ok(Place(path))
    }

    fn path(&self) -> &Path {
        &self.0
    }
}

impl Drop for Place {
    fn drop(&mut self) {
        // What stays goes with the run root.
        let _ = std::fs::remove_dir_all(&self.0);
    }
}
