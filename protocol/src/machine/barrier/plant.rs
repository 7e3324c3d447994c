//! The plant's side of the barrier: it begins ticks, releases the groups, waits for all members, keeps its lead
//! over the supervisor within the limit, and pauses on request.

use std::sync::atomic::Ordering::SeqCst;

use super::Barrier;
use super::futex::{WakeReason, wake_waiters};
use super::layout::{MEMBERS_CHANGED_FLAG, NEVER_TICK, REMAINING_MEMBERS_MASK};

/// Begin and end of a tick.
impl Barrier {
    /// Begins a tick. A member may arrive at it once its group is released.
    pub fn begin_tick(&self, tick: u64) {
        let head = self.header();
        let changes = head.changes.0.load(SeqCst);
        let members = self.all_slots().iter().filter(|slot| self.is_expected(slot, tick)).count();
        head.arrivals.0.store((tick as u32) << 16 | members as u32, SeqCst);
        // A change before the store may have set a nudge bit that the store has cleared.
        if head.changes.0.load(SeqCst) != changes {
            head.arrivals.0.fetch_or(MEMBERS_CHANGED_FLAG, SeqCst);
        }
        // The last group is released last, so all other groups are at its epoch already.
        let epoch = head.epochs[self.groups - 1].0.load(SeqCst).wrapping_add(1);
        head.ticks.0[epoch as usize & 1].store(tick, SeqCst);
    }

    /// Releases a group to the current tick and wakes it. All groups are released, in order, before the next
    /// tick.
    pub fn release_group(&self, group: usize) {
        let word = &self.header().epochs[group].0;
        word.fetch_add(1, SeqCst);
        wake_waiters(word);
    }

    /// Returns the slots of the members of a group.
    pub fn group_members(&self, group: usize) -> impl Iterator<Item = usize> + '_ {
        let slots = (group..self.slots).step_by(self.groups);
        slots.filter(|&slot| self.first_member_tick(slot).is_some())
    }

    /// Waits until every member has arrived at the tick. Once `keep_waiting` returns `false`, returns the slots that
    /// have not arrived.
    pub fn wait_for_arrivals(
        &self,
        tick: u64,
        mut keep_waiting: impl FnMut() -> bool,
    ) -> Result<(), Vec<usize>> {
        let word = &self.header().arrivals.0;
        loop {
            let seen = word.load(SeqCst);
            // While arrivals are missing and no member was removed, the slots need not be read.
            let may_be_complete =
                seen & REMAINING_MEMBERS_MASK == 0 || seen & MEMBERS_CHANGED_FLAG != 0;
            if may_be_complete && self.all_arrived(tick) {
                return Ok(());
            }
            if self.sleep_while_unchanged(word, seen) != WakeReason::WordMayHaveChanged {
                // No wake-up for that long: read the slots instead of the count.
                if self.all_arrived(tick) {
                    return Ok(());
                }
                if !keep_waiting() {
                    return Err(self.missing_slots(tick).collect());
                }
            }
        }
    }

    fn all_arrived(&self, tick: u64) -> bool {
        self.missing_slots(tick).next().is_none()
    }

    fn missing_slots(&self, tick: u64) -> impl Iterator<Item = usize> + '_ {
        let slots = self.all_slots().iter().zip(self.arrived_ticks()).enumerate();
        slots
            .filter(move |(_, (slot, arrived))| {
                self.is_expected(slot, tick) && arrived.load(SeqCst) != tick + 1
            })
            .map(|(i, _)| i)
    }
}

/// Lead over the supervisor, and pauses.
impl Barrier {
    /// Waits until the tick is at most `lead_max` after the ticks consumed. Returns `false` once `keep_waiting` does.
    /// Calls the supervisor before it sleeps.
    pub fn wait_for_lead_limit(
        &self,
        tick: u64,
        lead_max: u64,
        keep_waiting: impl FnMut() -> bool,
    ) -> bool {
        let head = self.header();
        let is_within_lead = || tick.saturating_sub(head.consumed.0.load(SeqCst)) <= lead_max;
        if is_within_lead() {
            return true;
        }
        head.lead_waiting.0.store(1, SeqCst);
        self.request_attention();
        let reached = self.wait_until(&head.lead.0, is_within_lead, keep_waiting);
        head.lead_waiting.0.store(0, SeqCst);
        reached
    }

    /// Returns whether the plant must pause before it begins this tick.
    pub fn is_pause_due(&self, tick: u64) -> bool {
        tick >= self.header().pause_at.0.load(SeqCst)
    }

    /// Marks the plant as paused before this tick and waits until it is resumed. Returns `false` once `keep_waiting`
    /// does.
    pub fn pause(&self, tick: u64, keep_waiting: impl FnMut() -> bool) -> bool {
        let head = self.header();
        let resume_count = head.resumes.0.load(SeqCst);
        head.paused.0.store(tick, SeqCst);
        self.request_attention();
        let is_resumed = || head.resumes.0.load(SeqCst) != resume_count;
        let resumed = self.wait_until(&head.resumes.0, is_resumed, keep_waiting);
        if !resumed {
            head.paused.0.store(NEVER_TICK, SeqCst);
        }
        resumed
    }

    /// Returns the number of loop iterations of the supervisor: its heartbeat.
    pub fn heartbeat_count(&self) -> u32 {
        self.header().heartbeats.0.load(SeqCst)
    }

    /// Calls the supervisor: ground truth is available, or the plant is about to pause.
    pub fn request_attention(&self) {
        let head = self.header();
        head.attention.0.fetch_add(1, SeqCst);
        if head.supervisor_waiting.0.load(SeqCst) != 0 {
            wake_waiters(&head.attention.0);
        }
    }
}
