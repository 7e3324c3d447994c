//! Which truths came: their hash, and how many are missing.

use protocol::brief::Pace;
use protocol::message::TruthRow;

use crate::hash::TrajectoryHash;

/// The truths so far.
pub(super) struct Truths {
    hash: Option<TrajectoryHash>,
    newest_tick: Option<u64>,
    lost: u64,
}

impl Truths {
    /// None came yet. Only in lockstep are two runs the same.
    pub(super) fn new(pace: Pace) -> Truths {
        let hash = (pace == Pace::Lockstep).then(TrajectoryHash::new);
        Truths { hash, newest_tick: None, lost: 0 }
    }

    /// Takes in one.
    pub(super) fn truth(&mut self, tick: u64, rows: &[TruthRow]) {
        let expected = self.newest_tick.map_or(0, |tick| tick + 1);
        self.lost += tick.saturating_sub(expected);
        self.newest_tick = Some(tick);
        if let Some(hash) = &mut self.hash {
            hash.update(tick, rows);
        }
    }

    /// In lockstep, of all that came; `None` if none did.
    pub(super) fn hash(&self) -> Option<String> {
        self.hash.as_ref().filter(|_| self.newest_tick.is_some()).map(TrajectoryHash::finish)
    }

    /// Those that never arrived.
    pub(super) fn lost(&self) -> u64 {
        self.lost
    }
}
