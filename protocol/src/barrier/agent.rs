//! An agent's side: it waits for its group's release, and arrives.

use std::sync::atomic::Ordering::SeqCst;

use super::Barrier;
use super::layout::{NUDGE, REMAINING};
use super::words::{AtomicU32, Woken, wake};

impl Barrier {
    /// The epoch of a slot's group now; take it before announcing readiness, then wait for the
    /// next one.
    pub fn epoch(&self, slot: usize) -> u32 {
        self.epoch_word(slot).load(SeqCst)
    }

    fn epoch_word(&self, slot: usize) -> &AtomicU32 {
        &self.head().epochs[slot % self.groups].0
    }

    /// A slot waits for another epoch than the one seen: that epoch and its tick. `None` once
    /// `patience` ends.
    pub fn wait_tick(
        &self,
        slot: usize,
        seen_epoch: u32,
        mut patience: impl FnMut() -> bool,
    ) -> Option<(u32, u64)> {
        let head = self.head();
        let word = self.epoch_word(slot);
        loop {
            let epoch = word.load(SeqCst);
            if epoch != seen_epoch {
                let tick = head.ticks.0[epoch as usize & 1].load(SeqCst);
                // Else the plant went on without us, and the tick may be of a later epoch.
                if word.load(SeqCst) == epoch {
                    return Some((epoch, tick));
                }
                continue;
            }
            if self.rest(word, seen_epoch) != Woken::Perhaps && !patience() {
                return None;
            }
        }
    }

    /// Says that a report to the supervisor was sent; before arriving at the tick that it is about.
    pub fn reported(&self) {
        self.head().reports.0.fetch_add(1, SeqCst);
    }

    /// Says that this slot has sent all it has to say at this tick.
    pub fn arrive(&self, slot: usize, tick: u64) {
        let place = &self.all_slots()[slot];
        let before = self.arrived()[slot].swap(tick + 1, SeqCst);
        if before == tick + 1 || !self.expected(place, tick) {
            return;
        }
        let word = &self.head().arrivals.0;
        let counted = word.fetch_update(SeqCst, SeqCst, |now| {
            // Another tick's count is none of ours; and none goes below 0.
            (now >> 16 == tick as u32 & 0xffff && now & REMAINING != 0).then(|| now - 1)
        });
        if let Ok(before) = counted
            && (before & REMAINING == 1 || before & NUDGE != 0)
        {
            wake(word);
        }
    }

    /// Arrives without having sent anything at this tick.
    pub fn arrive_mute(&self, slot: usize, tick: u64) {
        self.all_slots()[slot].mute[tick as usize & 1].store(tick + 1, SeqCst);
        self.arrive(slot, tick);
    }

    /// Whether a slot that has arrived at this tick sent nothing; known until two ticks later.
    pub fn is_mute(&self, slot: usize, tick: u64) -> bool {
        self.all_slots()[slot].mute[tick as usize & 1].load(SeqCst) == tick + 1
    }
}
