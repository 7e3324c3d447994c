//! Which truths came: their hash, and how many are missing.

use protocol::brief::Pace;
use protocol::message::TruthRow;

use crate::metrics::hash::TrajectoryHash;

/// The truths so far.
#[derive(Default)]
pub(super) struct Truths {
    hash: Option<TrajectoryHash>,
    /// In lockstep: entry k is the hash of all truths before k + 1 s, which tells when two runs parted.
    pub(super) hash_by_second: Vec<String>,
    newest_tick: Option<u64>,
    newest_t_ns: u64,
    pub(super) lost: u64,
    /// Stretches of run time, ns, that were too long without a truth.
    pub(super) unseen_ns: Vec<[u64; 2]>,
}

/// While truths are lost for longer than this, ns, something may have come and gone that no verdict
/// knows of. Less than that passes for a look at the next truth: nothing moves far in it.
const UNSEEN_NS: u64 = 100_000_000;

const SECOND_NS: u64 = 1_000_000_000;

impl Truths {
    /// None came yet. Only in lockstep are two runs the same.
    pub(super) fn new(pace: Pace) -> Truths {
        let hash = (pace == Pace::Lockstep).then(TrajectoryHash::new);
        Truths { hash, ..Truths::default() }
    }

    /// Takes in one.
    pub(super) fn truth(&mut self, tick: u64, t_ns: u64, rows: &[TruthRow]) {
        let expected = self.newest_tick.map_or(0, |tick| tick + 1);
        let lost = tick.saturating_sub(expected);
        self.lost += lost;
        if lost > 0 && t_ns.saturating_sub(self.newest_t_ns) > UNSEEN_NS {
            self.unseen_ns.push([self.newest_t_ns, t_ns]);
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

    /// In lockstep, of all that came; `None` if none did.
    pub(super) fn hash(&self) -> Option<String> {
        self.hash.as_ref().filter(|_| self.newest_tick.is_some()).map(TrajectoryHash::finish)
    }
}
