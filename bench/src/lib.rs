//! Benchmarks of `phalanx bench` (program `phalanx-bench`): the speed of runs, the baselines of this machine, and their
//! ratio.
//!
//! A run and its baselines alternate within each round, so that background load affects both equally. Timings are
//! printed but never judged; this crate is not a test. It must not leave a process or a file behind, or wait without a
//! deadline.
//!
//! | file | content |
//! |---|---|
//! | `cli` | command line and selection of the parts |
//! | `rounds` | order of the measurements |
//! | `table` | medians, minima and maxima as a text table and as JSON |
//! | `machine` | description and load of the machine |
//! | **parts** | |
//! | `round_trip` | time from a robot's odometry sample to its command, also over bare transports |
//! | `lockstep` | ticks per second and start-up time, with and without iceoryx2 |
//! | `realtime` | deadline misses by rate and number of robots |
//! | `neighbor` | time from a neighbor's publication of a beacon to its use |
//! | `growth` | processor time per tick and its growth, compared with the same controllers without iceoryx2 |
//! | `messages` | processor time per tick with a message of 256 bytes in each beacon, compared with none |
//! | `in_process` | processor time per tick of a run within one process, up to 1,024 robots |
//! | `repair` | time from the timeout of an in-neighbor to the first sample that uses a backup neighbor |
//! | `replacement` | time from a kill to the replacement's first command |
//! | **baselines** | |
//! | `transport` | an exchange of two messages between two processes, over several transports |
//! | `bare_lockstep` | the same controllers and plant over plain shared memory |
//! | `timers` | processes that only wait on a timer and use the processor |
//! | **shared code** | |
//! | `ring` | generated scenarios |
//! | `run` | one `phalanx run` as a child process, and its summary |
//! | `peers` | child processes of a measurement and their termination |
//! | `memory` | plain shared memory |
//! | `cores` | CPU pinning of both ends of a round trip |
//! | `quantiles` | quantiles that the table shows |

mod bare_lockstep;
pub mod cli;
mod cores;
mod growth;
mod in_process;
mod lockstep;
mod machine;
mod memory;
pub mod messages;
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

/// Maximum time for a pending response between two processes of a measurement; after it the process counts as hung.
const RESPONSE_TIMEOUT: Duration = Duration::from_secs(60);
/// Maximum duration of one measurement, also on a busy machine. A longer one fails.
const MEASUREMENT_DURATION_MAX: Duration = Duration::from_secs(240);
/// Number of log lines that an error about an exited process shows.
const SHOWN_LOG_LINES: usize = 8;

/// Error of a bench that was interrupted by a signal.
#[derive(Debug, thiserror::Error)]
#[error("interrupted")]
struct Interrupted;

/// Working directory of one measurement in the bench's run root, on tmpfs. Dropping it removes the directory with its
/// content.
struct WorkDir(PathBuf);

impl WorkDir {
    fn new(root: &RunRoot, name: &str) -> anyhow::Result<WorkDir> {
        let path = root.path().join(name);
        std::fs::create_dir(&path).with_context(|| format!("cannot create {}", path.display()))?;
        Ok(WorkDir(path))
    }

    fn path(&self) -> &Path {
        &self.0
    }
}

impl Drop for WorkDir {
    fn drop(&mut self) {
        // Files that remain are removed with the run root.
        let _ = std::fs::remove_dir_all(&self.0);
    }
}

/// Writes a file. An error names its path.
fn write_file(path: &Path, text: &str) -> anyhow::Result<()> {
    std::fs::write(path, text).with_context(|| format!("cannot write {}", path.display()))
}
