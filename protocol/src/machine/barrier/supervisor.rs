//! The supervisor's side of the barrier: it decides which slots are members, pauses and resumes the plant,
//! publishes how many ticks it has consumed, and sleeps until it is called.

use std::sync::atomic::Ordering::SeqCst;
use std::time::{Duration, Instant};

use super::Barrier;
use super::futex::{WakeReason, sleep_while, wake_waiters};
use super::layout::{MEMBERS_CHANGED_FLAG, NEVER_TICK};
use crate::law_message::SentCounts;

/// Members: changed while the plant is paused, or after an unplanned exit of an agent.
impl Barrier {
    /// Makes a slot a member that must arrive at this tick and all later ones.
    pub fn set_member(&self, slot: usize, since_tick: u64) {
        let slot_words = &self.all_slots()[slot];
        self.arrived_ticks()[slot].store(0, SeqCst);
        slot_words.mute.iter().for_each(|mute| mute.store(0, SeqCst));
        slot_words.since.store(since_tick, SeqCst);
        self.notify_member_change();
    }

    /// Returns what the process of a slot, which is dead or sends no more, has sent up to the last tick at which it
    /// stored that. The counts of its replacement begin at 0.
    pub fn take_sent_counts(&self, slot: usize) -> SentCounts {
        let words = &self.sent_words()[slot];
        SentCounts {
            beacons: words.beacons.swap(0, SeqCst),
            messages: words.messages.swap(0, SeqCst),
            message_hash: words.message_hash.swap(0, SeqCst),
            dropped_messages: words.dropped_messages.swap(0, SeqCst),
        }
    }

    /// Removes a member, even in the middle of a tick: the plant no longer waits for it.
    pub fn remove_member(&self, slot: usize) {
        self.all_slots()[slot].since.store(NEVER_TICK, SeqCst);
        self.notify_member_change();
    }

    /// Makes the plant read the members again.
    fn notify_member_change(&self) {
        self.header().changes.0.fetch_add(1, SeqCst);
        self.header().arrivals.0.fetch_or(MEMBERS_CHANGED_FLAG, SeqCst);
        wake_waiters(&self.header().arrivals.0);
    }
}

/// Lead limit, pauses and calls of the plant.
impl Barrier {
    /// Publishes that the ground truth of `ticks` ticks has been consumed.
    pub fn set_consumed_ticks(&self, ticks: u64) {
        let head = self.header();
        head.consumed.0.store(ticks, SeqCst);
        if head.lead_waiting.0.load(SeqCst) != 0 {
            head.lead.0.fetch_add(1, SeqCst);
            wake_waiters(&head.lead.0);
        }
    }

    /// Makes the plant pause at this tick or, if it is past, at the next one; `u64::MAX` means never. It stays in
    /// force over [`Barrier::resume`]: set the next pause before resuming.
    pub fn pause_at(&self, tick: u64) {
        self.header().pause_at.0.store(tick, SeqCst);
    }

    /// Returns the tick before which the plant is paused, if it is.
    pub fn paused_before_tick(&self) -> Option<u64> {
        Some(self.header().paused.0.load(SeqCst)).filter(|&tick| tick != NEVER_TICK)
    }

    /// Resumes the paused plant.
    pub fn resume(&self) {
        self.header().paused.0.store(NEVER_TICK, SeqCst);
        self.header().resumes.0.fetch_add(1, SeqCst);
        wake_waiters(&self.header().resumes.0);
    }

    /// Returns the number of reports that agents have sent. Once the supervisor has received a ground truth, the
    /// count includes all reports sent at earlier ticks.
    pub fn report_count(&self) -> u32 {
        self.header().reports.0.load(SeqCst)
    }

    /// Sleeps until the plant has called since the last call of this function. Returns `false` at the limit and
    /// after a signal. For one thread only.
    pub fn wait_for_attention(&self, limit: Duration) -> bool {
        let head = self.header();
        head.heartbeats.0.fetch_add(1, SeqCst);
        let seen = self.seen_attention_count.load(SeqCst);
        head.supervisor_waiting.0.store(1, SeqCst);
        let end = Instant::now() + limit;
        let mut count = head.attention.0.load(SeqCst);
        while count == seen {
            let remaining = end.saturating_duration_since(Instant::now());
            let is_called = || {
                sleep_while(&head.attention.0, seen, Some(remaining))
                    == WakeReason::WordMayHaveChanged
            };
            let was_called = !remaining.is_zero() && is_called();
            count = head.attention.0.load(SeqCst);
            if !was_called {
                break;
            }
        }
        head.supervisor_waiting.0.store(0, SeqCst);
        self.seen_attention_count.store(count, SeqCst);
        count != seen
    }

    /// Returns the members whose group was released and that have not arrived, each with the tick.
    pub fn pending_members(&self) -> Vec<(usize, u64)> {
        let pending_tick = |slot: usize| {
            let epoch = self.epoch(slot);
            let tick = self.header().ticks.0[epoch as usize & 1].load(SeqCst);
            // The first epoch is the one before the first tick.
            let is_released = epoch != 0 && self.is_expected(&self.all_slots()[slot], tick);
            let is_pending = is_released && self.arrived_ticks()[slot].load(SeqCst) != tick + 1;
            (is_pending && self.epoch(slot) == epoch).then_some((slot, tick))
        };
        (0..self.slots()).filter_map(pending_tick).collect()
    }

    /// Returns the number of ticks to which all groups were released: the plant's heartbeat.
    pub fn ticks_begun(&self) -> u32 {
        self.epoch(self.groups() - 1)
    }
}
