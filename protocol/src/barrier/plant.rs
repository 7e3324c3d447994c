//! The plant's side: it begins ticks, releases the groups, waits for all who take part, keeps to
//! its lead over the supervisor, and pauses when told.

use std::sync::atomic::Ordering::SeqCst;

use super::Barrier;
use super::layout::{NEVER, NUDGE, REMAINING};
use super::words::{Woken, wake};

/// A tick.
impl Barrier {
    /// Begins a tick: from here on members may arrive at it, each once its group is released.
    pub fn begin(&self, tick: u64) {
        let head = self.head();
        let changes = head.changes.0.load(SeqCst);
        let members = self.all_slots().iter().filter(|slot| self.expected(slot, tick)).count();
        head.arrivals.0.store((tick as u32) << 16 | members as u32, SeqCst);
        // A change up to here may have set its nudge bit before the store.
        if head.changes.0.load(SeqCst) != changes {
            head.arrivals.0.fetch_or(NUDGE, SeqCst);
        }
        // The last group is the last to be released: all others are at its epoch.
        let epoch = head.epochs[self.groups - 1].0.load(SeqCst).wrapping_add(1);
        head.ticks.0[epoch as usize & 1].store(tick, SeqCst);
    }

    /// Wakes a group to the tick that was begun. All are released, in order, before the next tick.
    pub fn release(&self, group: usize) {
        let word = &self.head().epochs[group].0;
        word.fetch_add(1, SeqCst);
        wake(word);
    }

    /// The members of a group.
    pub fn members_of(&self, group: usize) -> impl Iterator<Item = usize> + '_ {
        let slots = (group..self.slots).step_by(self.groups);
        slots.filter(|&slot| self.member_since(slot).is_some())
    }

    /// Waits until every member has arrived at the tick; when `patience` ends, names those that
    /// have not.
    pub fn wait_arrivals(
        &self,
        tick: u64,
        mut patience: impl FnMut() -> bool,
    ) -> Result<(), Vec<usize>> {
        let word = &self.head().arrivals.0;
        loop {
            let seen = word.load(SeqCst);
            // While some remain and nobody was removed, the slots need not be looked at.
            let settled = seen & REMAINING == 0 || seen & NUDGE != 0;
            if settled && self.all_arrived(tick) {
                return Ok(());
            }
            if self.rest(word, seen) != Woken::Perhaps {
                // Nobody called for that long: believe the slots, not the count.
                if self.all_arrived(tick) {
                    return Ok(());
                }
                if !patience() {
                    return Err(self.missing(tick).collect());
                }
            }
        }
    }

    fn all_arrived(&self, tick: u64) -> bool {
        self.missing(tick).next().is_none()
    }

    fn missing(&self, tick: u64) -> impl Iterator<Item = usize> + '_ {
        let places = self.all_slots().iter().zip(self.arrived()).enumerate();
        places
            .filter(move |(_, (slot, arrived))| {
                self.expected(slot, tick) && arrived.load(SeqCst) != tick + 1
            })
            .map(|(i, _)| i)
    }
}

/// Its lead over the supervisor, and pauses.
impl Barrier {
    /// The plant waits until the tick is at most `lead_max` after the ticks consumed; false once
    /// `patience` ends. Calls for attention before it sleeps.
    pub fn wait_lead(&self, tick: u64, lead_max: u64, patience: impl FnMut() -> bool) -> bool {
        let head = self.head();
        let near = || tick.saturating_sub(head.consumed.0.load(SeqCst)) <= lead_max;
        if near() {
            return true;
        }
        head.lead_waiting.0.store(1, SeqCst);
        self.attention();
        let reached = self.wait_until(&head.lead.0, near, patience);
        head.lead_waiting.0.store(0, SeqCst);
        reached
    }

    /// Whether the plant shall pause before it begins this tick.
    pub fn pause_due(&self, tick: u64) -> bool {
        tick >= self.head().pause_at.0.load(SeqCst)
    }

    /// The plant says that it is paused before this tick and waits to be resumed; false once
    /// `patience` ends.
    pub fn pause(&self, tick: u64, patience: impl FnMut() -> bool) -> bool {
        let head = self.head();
        let before = head.resumes.0.load(SeqCst);
        head.paused.0.store(tick, SeqCst);
        self.attention();
        let resumed = || head.resumes.0.load(SeqCst) != before;
        let resumed = self.wait_until(&head.resumes.0, resumed, patience);
        if !resumed {
            head.paused.0.store(NEVER, SeqCst);
        }
        resumed
    }

    /// How many turns the supervisor has made: a sign of its life.
    pub fn turns(&self) -> u32 {
        self.head().turns.0.load(SeqCst)
    }

    /// Calls the supervisor: there is truth to consume, or a pause to act in.
    pub fn attention(&self) {
        let head = self.head();
        head.attention.0.fetch_add(1, SeqCst);
        if head.supervisor_waiting.0.load(SeqCst) != 0 {
            wake(&head.attention.0);
        }
    }
}
