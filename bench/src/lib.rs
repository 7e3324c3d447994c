//! `phalanx bench`, the program `phalanx-bench`: how fast this machine could be, how fast a run is, and the ratio.
//!
//! A run and its baselines take turns within each round, so that whatever else the machine does meets both
//! alike. Timings are printed and never judged: nothing in here is a test. Must not: leave a
//! process or a file behind, or wait without a deadline.
//!
//! | file | question it answers |
//! |---|---|
//! | `cli` | what was asked for? |
//! | `rounds` | in which order is it measured? |
//! | `table` | medians with least and most, on a screen and as JSON |
//! | `machine` | on what was it measured? |
//! | **parts** | |
//! | `round_trip` | how long from a robot's sample to its command, and over bare transports? |
//! | `lockstep` | how many ticks a second, how long until everybody is ready, and without iceoryx2? |
//! | `realtime` | how many deadlines are missed, at which rate and size? |
//! | `neighbor` | how long from a neighbor's publication to its use? |
//! | `growth` | what does a tick cost, to 256 robots, and how does that grow? |
//! | `repair` | how long from a loss to the first sample for which a spare is gone by? |
//! | `replacement` | how long from a kill to the replacement's first command? |
//! | **baselines** | |
//! | `transport` | two messages between two processes, over anything |
//! | `bare_lockstep` | the same brains and world over plain shared memory |
//! | `timers` | processes that do nothing but wake |
//! | **what they need** | |
//! | `ring` | which scenario is run? |
//! | `run` | one `phalanx run` as a child, and its summary |
//! | `peers` | child processes that take part in a measurement, and their end |
//! | `memory` | plain shared memory |
//! | `cores` | on which cores are both ends of a round trip? |
//! | `quantiles` | which quantiles of a spread of times are shown? |

mod bare_lockstep;
pub mod cli;
mod cores;
mod growth;
mod lockstep;
mod machine;
mod memory;
mod neighbor;
mod peers;
mod quantiles;
mod realtime;
mod repair;
mod replacement;
pub mod ring;
mod round_trip;
mod rounds;
mod run;
mod table;
mod timers;
mod transport;

use std::path::{Path, PathBuf};
use std::time::Duration;

use anyhow::Context as _;
use protocol::run_root::RunRoot;

/// How long a process under measurement may owe another an answer.
const HUNG_AFTER: Duration = Duration::from_secs(60);
/// No measurement takes this long, even on a machine that is busy with other things.
const MEASUREMENT_MAX: Duration = Duration::from_secs(240);
/// How many lines of a dead process's log are shown.
const LOG_LINES: usize = 8;

/// A signal came.
#[derive(Debug, thiserror::Error)]
#[error("interrupted")]
struct Interrupted;

/// A directory of one measurement in the bench's run root, on tmpfs, removed with everything in it.
struct Place(PathBuf);

impl Place {
    fn new(root: &RunRoot, name: &str) -> anyhow::Result<Place> {
        let path = root.path().join(name);
        std::fs::create_dir(&path).with_context(|| format!("cannot make {}", path.display()))?;
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

/// Writes a file, and says which one it was if it fails.
fn write(path: &Path, text: &str) -> anyhow::Result<()> {
    std::fs::write(path, text).with_context(|| format!("cannot write {}", path.display()))
}
