//! The agent's side of the barrier: it waits until its group is released, and arrives.

use std::sync::atomic::Ordering::SeqCst;

use super::Barrier;
use super::futex::{AtomicU32, WakeReason, wake_waiters};
use super::layout::{BEACON_WITHHELD_FLAG, MEMBERS_CHANGED_FLAG, REMAINING_MEMBERS_MASK};
use crate::law_message::SentCounts;

impl Barrier {
    /// Returns the current epoch of a slot's group. Read it before announcing readiness, then wait for the next
    /// epoch.
    pub fn epoch(&self, slot: usize) -> u32 {
        self.epoch_word(slot).load(SeqCst)
    }

    fn epoch_word(&self, slot: usize) -> &AtomicU32 {
        &self.header().epochs[slot % self.groups].0
    }

    /// Waits until a slot's group has another epoch than `seen_epoch`. Returns that epoch and its tick, or `None`
    /// once `keep_waiting` returns `false`.
    pub fn wait_for_tick(
        &self,
        slot: usize,
        seen_epoch: u32,
        mut keep_waiting: impl FnMut() -> bool,
    ) -> Option<(u32, u64)> {
        let head = self.header();
        let word = self.epoch_word(slot);
        loop {
            let epoch = word.load(SeqCst);
            if epoch != seen_epoch {
                let tick = head.ticks.0[epoch as usize & 1].load(SeqCst);
                // Otherwise the plant continued without this agent, and the tick may belong to a later epoch.
                if word.load(SeqCst) == epoch {
                    return Some((epoch, tick));
                }
                continue;
            }
            if self.sleep_while_unchanged(word, seen_epoch) != WakeReason::WordMayHaveChanged
                && !keep_waiting()
            {
                return None;
            }
        }
    }

    /// Counts a report sent to the supervisor. Call it before arriving at the tick of the report.
    pub fn count_report(&self) {
        self.header().reports.0.fetch_add(1, SeqCst);
    }

    /// Stores what the process of a slot has sent up to a tick. Call it before arriving at that tick: the supervisor then
    /// knows it when the process is killed.
    pub fn store_sent_counts(&self, slot: usize, counts: &SentCounts) {
        let words = &self.sent_words()[slot];
        words.beacons.store(counts.beacons, SeqCst);
        words.messages.store(counts.messages, SeqCst);
        words.message_hash.store(counts.message_hash, SeqCst);
        words.dropped_messages.store(counts.dropped_messages, SeqCst);
    }

    /// Marks a slot as arrived at a tick. Call it after all messages of that tick are sent.
    #[inline]
    pub fn arrive(&self, slot: usize, tick: u64) {
        let slot_words = &self.all_slots()[slot];
        let previous = self.arrived_ticks()[slot].swap(tick + 1, SeqCst);
        if previous == tick + 1 || !self.is_expected(slot_words, tick) {
            return;
        }
        let word = &self.header().arrivals.0;
        let decrement = word.fetch_update(SeqCst, SeqCst, |word_value| {
            // The count of another tick is not decremented, and no count goes below 0.
            (word_value >> 16 == tick as u32 & 0xffff && word_value & REMAINING_MEMBERS_MASK != 0)
                .then(|| word_value - 1)
        });
        if let Ok(previous) = decrement
            && (previous & REMAINING_MEMBERS_MASK == 1 || previous & MEMBERS_CHANGED_FLAG != 0)
        {
            wake_waiters(word);
        }
    }

    /// Marks a slot as arrived at a tick at which it sent nothing.
    pub fn arrive_without_messages(&self, slot: usize, tick: u64) {
        self.all_slots()[slot].mute[tick as usize & 1].store(tick + 1, SeqCst);
        self.arrive(slot, tick);
    }

    /// Marks a slot as arrived at a tick at which it sent a command and withheld its beacon.
    pub fn arrive_without_beacon(&self, slot: usize, tick: u64) {
        self.all_slots()[slot].mute[tick as usize & 1]
            .store((tick + 1) | BEACON_WITHHELD_FLAG, SeqCst);
        self.arrive(slot, tick);
    }

    /// Returns whether a slot that has arrived at this tick sent no beacon. Valid until two ticks later.
    #[inline]
    pub fn has_no_beacon(&self, slot: usize, tick: u64) -> bool {
        self.all_slots()[slot].mute[tick as usize & 1].load(SeqCst) & !BEACON_WITHHELD_FLAG
            == tick + 1
    }

    /// Returns whether a slot that has arrived at this tick sent nothing. Valid until two ticks later.
    pub fn has_sent_nothing(&self, slot: usize, tick: u64) -> bool {
        self.all_slots()[slot].mute[tick as usize & 1].load(SeqCst) == tick + 1
    }
}
