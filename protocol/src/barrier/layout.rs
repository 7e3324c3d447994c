//! What lies where in the mapping: constants, words that processes share, one place for each robot.
//!
//! Must not: read or change a word; the sides do that.

use super::GROUPS_MAX;
use super::words::{AtomicU32, AtomicU64};

pub(super) const MAGIC: u64 = u64::from_le_bytes(*b"phxbarri");
pub(super) const VERSION: u32 = 6;
/// "No member", "not paused", "pause never".
pub(super) const NEVER: u64 = u64::MAX;
/// In the arrivals word: the member set changed, so every arrival wakes the plant.
pub(super) const NUDGE: u32 = 1 << 15;
/// In the arrivals word: how many members have yet to arrive. Above both: the tick's low bits.
pub(super) const REMAINING: u32 = NUDGE - 1;

/// A word alone on its cache line (two, for the prefetcher's pairs).
#[repr(C, align(128))]
pub(super) struct Line<T>(pub(super) T);

/// The start of the mapping; the slots follow.
#[repr(C)]
pub(super) struct Head {
    /// Magic, version, number of slots: written before the file gets its name.
    pub(super) magic: u64,
    pub(super) version: u32,
    pub(super) slots: u32,
    /// Into how many groups the slots are dealt, in turns.
    pub(super) groups: u32,
    /// Who made it: the process id of the supervisor.
    pub(super) supervisor: u32,
    /// How long a process may owe an answer before it counts as hung, ms.
    pub(super) hung_after_ms: u64,
    /// Counts the ticks that each group was released to; its agents sleep on it.
    pub(super) epochs: [Line<AtomicU32>; GROUPS_MAX],
    /// The tick of an even and of an odd epoch, so that a late reader sees a matching pair.
    pub(super) ticks: Line<[AtomicU64; 2]>,
    /// Tick's low 16 bits, nudge bit, remaining members; the plant sleeps on it.
    pub(super) arrivals: Line<AtomicU32>,
    /// Counts changes of the member set.
    pub(super) changes: Line<AtomicU32>,
    /// Ticks consumed by the supervisor.
    pub(super) consumed: Line<AtomicU64>,
    /// Counts wake-ups for the lead; the plant sleeps on it.
    pub(super) lead: Line<AtomicU32>,
    /// 1 while the plant waits for the lead.
    pub(super) lead_waiting: Line<AtomicU32>,
    /// The plant pauses at ticks from here on.
    pub(super) pause_at: Line<AtomicU64>,
    /// The tick at which the plant is paused.
    pub(super) paused: Line<AtomicU64>,
    /// Counts resumptions; the paused plant sleeps on it.
    pub(super) resumes: Line<AtomicU32>,
    /// Counts calls for attention; the supervisor sleeps on it.
    pub(super) attention: Line<AtomicU32>,
    /// 1 while the supervisor sleeps.
    pub(super) supervisor_waiting: Line<AtomicU32>,
    /// Counts the supervisor's turns, so that others see it at work.
    pub(super) turns: Line<AtomicU32>,
    /// Counts what agents reported, so that the supervisor need not ask each at every tick.
    pub(super) reports: Line<AtomicU32>,
}

/// One robot's place: what its neighbors and the plant read at each tick, and what seldom changes.
/// Behind all places follows for each the last tick it arrived at, plus 1, which changes at each.
#[repr(C, align(32))]
pub(super) struct Slot {
    /// First tick it takes part in, or [`NEVER`].
    pub(super) since: AtomicU64,
    /// The last even and the last odd tick at which it had nothing to say, plus 1. Two, because a
    /// neighbour may be a tick behind.
    pub(super) mute: [AtomicU64; 2],
}

/// How long the file is.
pub(super) fn bytes_for(slots: usize) -> usize {
    size_of::<Head>() + slots * (size_of::<Slot>() + size_of::<AtomicU64>())
}
