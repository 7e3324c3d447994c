//! `phalanx bench`, the program `phalanx-bench`: baselines of this machine, the speed of a run, and their ratio.
//!
//! A run and its baselines alternate within each round, so that other load on the machine affects both
//! alike. Timings are printed and never judged: nothing here is a test. Must not leave a process or a file
//! behind, or wait without a deadline.
//!
//! | file | contents |
//! |---|---|
//! | `cli` | command line |
//! | `rounds` | order of the measurements |
//! | `table` | medians with minimum and maximum, as text and as JSON |
//! | `machine` | description of the machine |
//! | **parts** | |
//! | `round_trip` | time from a robot's sample to its command, and over bare transports |
//! | `lockstep` | ticks per second, start-up time, and the same without iceoryx2 |
//! | `realtime` | deadline misses, by rate and number of robots |
//! | `neighbor` | time from a neighbor's publication to its use |
//! | `growth` | cost of a tick for up to 256 robots |
//! | `repair` | time from a loss to the first sample for which a backup neighbor is used |
//! | `replacement` | time from a kill to the replacement's first command |
//! | **baselines** | |
//! | `transport` | two messages between two processes, over several transports |
//! | `bare_lockstep` | the same controllers and plant over plain shared memory |
//! | `timers` | processes that only wait on timers |
//! | **helpers** | |
//! | `ring` | scenarios |
//! | `run` | one `phalanx run` as a child, and its summary |
//! | `peers` | child processes that take part in a measurement |
//! | `memory` | plain shared memory |
//! | `cores` | cores for both ends of a round trip |
//! | `quantiles` | quantiles that are shown |

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

/// Maximum time for a measured process to respond to another.
const HUNG_AFTER: Duration = Duration::from_secs(60);
/// Maximum time for a measurement, even on a busy machine.
const MEASUREMENT_MAX: Duration = Duration::from_secs(240);
/// Number of lines of a dead process's log that are shown.
const LOG_LINES: usize = 8;

/// Error for a measurement that a signal ended.
#[derive(Debug, thiserror::Error)]
#[error("interrupted")]
struct Interrupted;

/// Directory of one measurement in the bench's run root, on tmpfs. Dropping it removes it with its contents.
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
        // Remaining files are removed with the run root.
        let _ = std::fs::remove_dir_all(&self.0);
    }
}

/// Writes a file. An error names the file.
fn write(path: &Path, text: &str) -> anyhow::Result<()> {
    std::fs::write(path, text).with_context(|| format!("cannot write {}", path.display()))
}
