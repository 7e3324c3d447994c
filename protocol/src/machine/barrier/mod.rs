//! The lockstep barrier: futex words in a small file that all processes map.
//!
//! The plant begins a tick and releases the agents group by group, so that one group computes while the plant
//! still sends to the next; the last agent to arrive wakes the plant. The supervisor decides which slots are
//! members, pauses the plant for faults, and publishes how many ticks it has consumed. Must not: carry control
//! data. A waiting process wakes at every `RECHECK` or alarm period and calls a closure of the caller, which enforces
//! the deadline: the closure returns whether to keep waiting.
//!
//! No wake-up is lost and no robot is counted twice, whichever process exits, freezes or joins at whichever step:
//! `tests/plots` checks all interleavings of the steps of this code.
//!
//! | file | content |
//! |---|---|
//! | `layout` | memory layout of the mapping |
//! | `file` | creation and checked opening of the file |
//! | `plant` | the plant's side |
//! | `agent` | the agent's side |
//! | `supervisor` | the supervisor's side: members and pauses |
//! | `futex` | sleeping on a futex word until another process changes it |

mod agent;
mod file;
mod futex;
mod layout;
mod plant;
mod supervisor;
#[cfg(test)]
mod tests;

use std::ptr::NonNull;
use std::sync::atomic::Ordering::SeqCst;
use std::time::Duration;

use crate::machine::process::Alarm;

pub use self::file::BarrierError;
use self::futex::{AtomicU32, AtomicU64};
use self::layout::{BarrierHeader, NEVER_TICK, SentWords, Slot};

/// Maximum number of ticks that the plant is ahead of the supervisor. The plant waits at this bound.
pub const LEAD_TICKS_MAX: u64 = 63;
/// Maximum number of slots of a barrier.
pub const SLOTS_MAX: usize = 4096;
/// Maximum number of groups of agents that are released separately.
pub const GROUPS_MAX: usize = 16;

/// One process's mapping of the barrier.
#[derive(Debug)]
pub struct Barrier {
    memory: NonNull<u8>,
    size_bytes: usize,
    slots: usize,
    groups: usize,
    seen_attention_count: AtomicU32,
    alarm: Option<Alarm>,
}

// SAFETY: the mapping is only read and written through atomics (the constant head fields are written before it
// is shared) and lives as long as the value.
unsafe impl Send for Barrier {}
// SAFETY: as above.
unsafe impl Sync for Barrier {}

impl Drop for Barrier {
    fn drop(&mut self) {
        // SAFETY: mapped with this length by `map`; no reference outlives `self`.
        let _ = unsafe { rustix::mm::munmap(self.memory.as_ptr().cast(), self.size_bytes) };
    }
}

impl Barrier {
    /// Sets an alarm that interrupts all later waits, in place of a timeout. Arming and disarming a timeout for
    /// each wait costs more than the computation of a robot.
    pub fn set_alarm(&mut self, alarm: Alarm) {
        self.alarm = Some(alarm);
    }

    /// Returns the process id of the supervisor.
    pub fn supervisor_pid(&self) -> u32 {
        self.header().supervisor
    }

    /// Returns the time after which a process with a pending response counts as hung.
    pub fn hung_timeout(&self) -> Duration {
        Duration::from_millis(self.header().hung_after_ms)
    }

    /// Returns the number of slots.
    pub fn slots(&self) -> usize {
        self.slots
    }

    /// Returns the number of groups.
    pub fn groups(&self) -> usize {
        self.groups
    }

    /// Returns the first tick at which a slot is a member; `None` if it is not a member.
    #[inline]
    pub fn first_member_tick(&self, slot: usize) -> Option<u64> {
        Some(self.all_slots().get(slot)?.since.load(SeqCst)).filter(|&since| since != NEVER_TICK)
    }

    /// Returns the slots of all members.
    pub fn members(&self) -> impl Iterator<Item = usize> + '_ {
        (0..self.slots).filter(|&slot| self.first_member_tick(slot).is_some())
    }

    #[inline]
    fn is_expected(&self, slot: &Slot, tick: u64) -> bool {
        // `NEVER_TICK` is later than any tick.
        slot.since.load(SeqCst) <= tick
    }

    fn header(&self) -> &BarrierHeader {
        // SAFETY: the mapping begins with a `BarrierHeader`, is page-aligned and lives as long as `self`;
        // everything in it that changes is atomic.
        unsafe { self.memory.cast::<BarrierHeader>().as_ref() }
    }

    fn all_slots(&self) -> &[Slot] {
        // SAFETY: `bytes` was checked to hold `slots` slots behind the header, whose size is a
        // multiple of their alignment; everything in them is atomic.
        unsafe {
            let first = self.memory.byte_add(size_of::<BarrierHeader>()).cast::<Slot>();
            std::slice::from_raw_parts(first.as_ptr(), self.slots)
        }
    }

    /// Returns, for each slot, the last tick at which it arrived, plus 1.
    fn arrived_ticks(&self) -> &[AtomicU64] {
        // SAFETY: as above; these follow the slots, whose size is a multiple of their alignment.
        unsafe {
            let offset = size_of::<BarrierHeader>() + self.slots * size_of::<Slot>();
            let first = self.memory.byte_add(offset).cast::<AtomicU64>();
            std::slice::from_raw_parts(first.as_ptr(), self.slots)
        }
    }

    /// Returns, for each slot, what its present process has sent.
    fn sent_words(&self) -> &[SentWords] {
        // SAFETY: as above; these follow the arrival words, whose alignment is theirs.
        unsafe {
            let bytes_per_slot = size_of::<Slot>() + size_of::<AtomicU64>();
            let offset = size_of::<BarrierHeader>() + self.slots * bytes_per_slot;
            let first = self.memory.byte_add(offset).cast::<SentWords>();
            std::slice::from_raw_parts(first.as_ptr(), self.slots)
        }
    }
}
