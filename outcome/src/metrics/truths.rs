//! Received ground-truth samples: their hash, and the number of missing ones.

use protocol::brief::Pace;
use protocol::message::TruthRow;

use crate::metrics::hash::TrajectoryHash;

/// Sequence of received ground-truth samples.
#[derive(Default)]
pub(super) struct Truths {
    hash: Option<TrajectoryHash>,
    /// Intermediate hashes, in lockstep: entry k is the hash of all samples before k + 1 s. They show when two runs
    /// diverged.
    pub(super) hash_by_second: Vec<String>,
    newest_tick: Option<u64>,
    newest_t_ns: u64,
    pub(super) lost_samples: u64,
    /// Periods without a sample that exceed [`SAMPLE_GAP_NS_MAX`], start and end in ns of run time.
    pub(super) unseen_periods_ns: Vec<[u64; 2]>,
}

/// Maximum period without a sample that is tolerated, ns. In a longer one, an event may pass that no verdict
/// accounts for; in a shorter one, no robot moves far.
const SAMPLE_GAP_NS_MAX: u64 = 100_000_000;

const SECOND_NS: u64 = 1_000_000_000;

impl Truths {
    /// Creates the sequence before the first sample. A hash is computed in lockstep only, because real-time runs
    /// are never equal.
    pub(super) fn new(pace: Pace) -> Truths {
        let hash = (pace == Pace::Lockstep).then(TrajectoryHash::new);
        Truths { hash, ..Truths::default() }
    }

    /// Adds one sample.
    pub(super) fn add_truth(&mut self, tick: u64, t_ns: u64, rows: &[TruthRow]) {
        let expected = self.newest_tick.map_or(0, |tick| tick + 1);
        let lost = tick.saturating_sub(expected);
        self.lost_samples += lost;
        if lost > 0 && t_ns.saturating_sub(self.newest_t_ns) > SAMPLE_GAP_NS_MAX {
            self.unseen_periods_ns.push([self.newest_t_ns, t_ns]);
        }
        self.newest_tick = Some(tick);
        self.newest_t_ns = t_ns;
        if let Some(hash) = &mut self.hash {
            let seconds = (t_ns / SECOND_NS) as usize;
            if self.hash_by_second.len() < seconds {
                self.hash_by_second.resize(seconds, hash.finish());
            }
            hash.update(tick, rows);
        }
    }

    /// Returns the hash of all samples, in lockstep; `None` if there are none.
    pub(super) fn hash(&self) -> Option<String> {
        self.hash.as_ref().filter(|_| self.newest_tick.is_some()).map(TrajectoryHash::finish)
    }
}
