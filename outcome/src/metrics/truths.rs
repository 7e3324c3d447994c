//! Which truths came: their hash, and how many are missing.

use protocol::brief::Pace;
use protocol::message::TruthRow;

use crate::metrics::hash::HashChain;

/// The truths so far.
pub(super) struct Truths {
    hash: Option<HashChain>,
    newest_tick: Option<u64>,
    newest_t_ns: u64,
    pub(super) lost: u64,
    /// Stretches of run time, ns, that were too long without a truth.
    pub(super) unseen_ns: Vec<[u64; 2]>,
}

/// While truths are lost for longer than this, ns, something may have come and gone that no verdict
/// knows of. Less than that passes for a look at the next truth: nothing moves far in it.
const UNSEEN_NS: u64 = 100_000_000;

impl Truths {
    /// None came yet. Only in lockstep are two runs the same.
    pub(super) fn new(pace: Pace) -> Truths {
        let hash = (pace == Pace::Lockstep).then(HashChain::default);
        Truths { hash, newest_tick: None, newest_t_ns: 0, lost: 0, unseen_ns: Vec::new() }
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
            hash.update(tick, t_ns, rows);
        }
    }

    /// In lockstep, of all that came; `None` if none did.
    pub(super) fn hash(&self) -> Option<String> {
        self.hash.as_ref().filter(|_| self.newest_tick.is_some()).map(HashChain::finish)
    }

    /// In lockstep, what the hash was at the end of each simulated second.
    pub(super) fn hash_by_second(&self) -> Vec<String> {
        self.hash.as_ref().map(|chain| chain.by_second().to_vec()).unwrap_or_default()
    }
}
