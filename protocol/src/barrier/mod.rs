//! The lockstep barrier: whose turn is it? Futex words in a small file mapped by all processes.
//!
//! The plant begins a tick and releases the agents group by group, so that one group thinks while
//! the plant still sends to the next; the last agent to arrive wakes the plant. The supervisor
//! decides who is a member, pauses the plant for faults, and tells how far it has read. Must not:
//! carry control data. Whoever waits asks a closure, every `RECHECK` or period of the alarm, whether
//! to go on waiting: the caller's deadline.
//!
//! No wake-up is lost and nobody is counted twice, whoever dies, freezes or joins at whichever step:
//! `tests/plots` searches all orders of steps of this very code.
//!
//! | file | question it answers |
//! |---|---|
//! | `layout` | what lies where in the mapping? |
//! | `file` | how is it made and opened, and what is refused? |
//! | `plant` | what does the plant do at each tick? |
//! | `agent` | what does an agent do at each tick? |
//! | `supervisor` | who is a member, and when does the plant pause? |
//! | `words` | how does one sleep on a word until another process changes it? |

mod agent;
mod file;
mod layout;
mod plant;
mod supervisor;
#[cfg(test)]
mod tests;
mod words;

use std::ptr::NonNull;
use std::sync::atomic::Ordering::SeqCst;
use std::time::Duration;

use crate::process::Alarm;

pub use self::file::BarrierError;
use self::layout::{Head, NEVER, Slot};
use self::words::{AtomicU32, AtomicU64};

/// The plant runs at most this many ticks ahead of the supervisor.
pub const LEAD_MAX: u64 = 63;
/// Most slots of a barrier.
pub const SLOTS_MAX: usize = 4096;
/// Most groups of agents that are released apart.
pub const GROUPS_MAX: usize = 16;

/// The barrier as one process sees it.
#[derive(Debug)]
pub struct Barrier {
    memory: NonNull<u8>,
    bytes: usize,
    slots: usize,
    groups: usize,
    attention_seen: AtomicU32,
    alarm: Option<Alarm>,
}

// SAFETY: the mapping is only read and written through atomics (the constant head fields are
// written before it is shared) and lives as long as the value.
unsafe impl Send for Barrier {}
// SAFETY: as above.
unsafe impl Sync for Barrier {}

impl Drop for Barrier {
    fn drop(&mut self) {
        // SAFETY: mapped with this length by `map`; no reference outlives `self`.
        let _ = unsafe { rustix::mm::munmap(self.memory.as_ptr().cast(), self.bytes) };
    }
}

impl Barrier {
    /// From now on waits for a tick, and for arrivals at it, end by this alarm: arming a time-out
    /// for each of them, and taking it back, costs more than a robot's thinking.
    pub fn rely_on(&mut self, alarm: Alarm) {
        self.alarm = Some(alarm);
    }

    /// The process id of the supervisor.
    pub fn supervisor(&self) -> u32 {
        self.head().supervisor
    }

    /// How long a process may owe an answer before it counts as hung.
    pub fn hung_after(&self) -> Duration {
        Duration::from_millis(self.head().hung_after_ms)
    }

    /// How many slots there are.
    pub fn slots(&self) -> usize {
        self.slots
    }

    /// How many groups there are.
    pub fn groups(&self) -> usize {
        self.groups
    }

    /// The first tick that a member takes part in; `None` if it is no member.
    pub fn member_since(&self, slot: usize) -> Option<u64> {
        Some(self.all_slots().get(slot)?.since.load(SeqCst)).filter(|&since| since != NEVER)
    }

    /// The members' slots.
    pub fn members(&self) -> impl Iterator<Item = usize> + '_ {
        (0..self.slots).filter(|&slot| self.member_since(slot).is_some())
    }

    fn expected(&self, slot: &Slot, tick: u64) -> bool {
        // NEVER is later than any tick.
        slot.since.load(SeqCst) <= tick
    }

    fn head(&self) -> &Head {
        // SAFETY: the mapping begins with a `Head`, is page-aligned and lives as long as `self`;
        // everything in it that changes is atomic.
        unsafe { self.memory.cast::<Head>().as_ref() }
    }

    fn all_slots(&self) -> &[Slot] {
        // SAFETY: `bytes` was checked to hold `slots` slots behind the head, whose size is a
        // multiple of their alignment; everything in them is atomic.
        unsafe {
            let first = self.memory.byte_add(size_of::<Head>()).cast::<Slot>();
            std::slice::from_raw_parts(first.as_ptr(), self.slots)
        }
    }

    /// Of each slot the last tick it arrived at, plus 1.
    fn arrived(&self) -> &[AtomicU64] {
        // SAFETY: as above; these follow the slots, whose size is a multiple of their alignment.
        unsafe {
            let behind = size_of::<Head>() + self.slots * size_of::<Slot>();
            let first = self.memory.byte_add(behind).cast::<AtomicU64>();
            std::slice::from_raw_parts(first.as_ptr(), self.slots)
        }
    }
}
