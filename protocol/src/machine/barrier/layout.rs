//! Memory layout of the mapping: constants, futex words, and one slot for each robot.
//!
//! Must not: read or change a word; the modules of the three sides do that.

use super::GROUPS_MAX;
use super::futex::{AtomicU32, AtomicU64};

pub(super) const MAGIC: u64 = u64::from_le_bytes(*b"phxbarri");
pub(super) const VERSION: u32 = 8;
/// Value for "not a member", "not paused" and "never pause".
pub(super) const NEVER_TICK: u64 = u64::MAX;
/// Flag in the arrivals word: the set of members has changed, so every arrival wakes the plant.
pub(super) const MEMBERS_CHANGED_FLAG: u32 = 1 << 15;
/// Mask in the arrivals word: the number of members that have not arrived. The bits above [`MEMBERS_CHANGED_FLAG`] are
/// the low bits of the tick.
pub(super) const REMAINING_MEMBERS_MASK: u32 = MEMBERS_CHANGED_FLAG - 1;

/// Flag in a mute word: only the beacon was withheld, and a command was sent.
pub(super) const BEACON_WITHHELD_FLAG: u64 = 1 << 63;

/// A word alone on its pair of cache lines, because the prefetcher loads pairs.
#[repr(C, align(128))]
pub(super) struct CacheLinePair<T>(pub(super) T);

/// Start of the mapping, before the slots.
#[repr(C)]
pub(super) struct BarrierHeader {
    /// Magic number. Constant fields are written before the file gets its name.
    pub(super) magic: u64,
    pub(super) version: u32,
    pub(super) slots: u32,
    /// Number of groups. Slots are assigned to groups in round-robin order.
    pub(super) groups: u32,
    /// Process id of the supervisor, which created the file.
    pub(super) supervisor: u32,
    /// Time after which a process with a pending response counts as hung, ms.
    pub(super) hung_after_ms: u64,
    /// Number of ticks to which each group was released. Its agents sleep on this word.
    pub(super) epochs: [CacheLinePair<AtomicU32>; GROUPS_MAX],
    /// Ticks of the last even and the last odd epoch, so that a late reader sees a matching pair.
    pub(super) ticks: CacheLinePair<[AtomicU64; 2]>,
    /// Low 16 bits of the tick, nudge bit, and number of remaining members. The plant sleeps on this word.
    pub(super) arrivals: CacheLinePair<AtomicU32>,
    /// Number of changes of the set of members.
    pub(super) changes: CacheLinePair<AtomicU32>,
    /// Number of ticks consumed by the supervisor.
    pub(super) consumed: CacheLinePair<AtomicU64>,
    /// Number of wake-ups for the lead limit. The plant sleeps on this word.
    pub(super) lead: CacheLinePair<AtomicU32>,
    /// 1 while the plant waits for the supervisor to catch up.
    pub(super) lead_waiting: CacheLinePair<AtomicU32>,
    /// Tick from which on the plant pauses.
    pub(super) pause_at: CacheLinePair<AtomicU64>,
    /// Tick at which the plant is paused, or [`NEVER_TICK`].
    pub(super) paused: CacheLinePair<AtomicU64>,
    /// Number of resumptions. The paused plant sleeps on this word.
    pub(super) resumes: CacheLinePair<AtomicU32>,
    /// Number of calls for attention. The supervisor sleeps on this word.
    pub(super) attention: CacheLinePair<AtomicU32>,
    /// 1 while the supervisor sleeps.
    pub(super) supervisor_waiting: CacheLinePair<AtomicU32>,
    /// Number of loop iterations of the supervisor: its heartbeat.
    pub(super) heartbeats: CacheLinePair<AtomicU32>,
    /// Number of reports sent by agents, so that the supervisor need not poll each agent at every tick.
    pub(super) reports: CacheLinePair<AtomicU32>,
}

/// The words of one robot that seldom change, and that its neighbors and the plant read at each tick. The words
/// that change at each tick, one arrival word for each slot, follow behind all slots.
#[repr(C, align(32))]
pub(super) struct Slot {
    /// First tick at which the slot is a member, or [`NEVER_TICK`].
    pub(super) since: AtomicU64,
    /// The last even and the last odd tick at which the robot sent nothing, plus 1, or with the bit
    /// [`BEACON_WITHHELD_FLAG`] only a command. There are two because a neighbor may be one tick behind.
    pub(super) mute: [AtomicU64; 2],
}

/// The beacons and messages that the present process of a slot has sent, behind the arrival words. Only the supervisor
/// reads them, once that process is dead or the run over, so they have memory of their own.
#[repr(C)]
pub(super) struct SentWords {
    pub(super) beacons: AtomicU64,
    pub(super) messages: AtomicU64,
    pub(super) message_hash: AtomicU64,
    pub(super) dropped_messages: AtomicU64,
    /// Padding, so that robots write to different cache lines.
    padding: [u64; 4],
}

/// Returns the size of the file, bytes.
pub(super) fn file_size_bytes(slots: usize) -> usize {
    let bytes_per_slot = size_of::<Slot>() + size_of::<AtomicU64>() + size_of::<SentWords>();
    size_of::<BarrierHeader>() + slots * bytes_per_slot
}
