//! The lockstep barrier: whose turn is it? Futex words in a small file mapped by all processes.
//!
//! The plant begins a tick and releases the agents group by group, so that one group thinks while
//! the plant still sends to the next; the last agent to arrive wakes the plant. The supervisor
//! decides who is a member, pauses the plant for faults, and tells how far it has read. Must not:
//! carry control data, or wait without a deadline. No lost wake-up and no dead process costs more
//! than `RECHECK` or a period of the alarm, because the plant decides by the slots, not by the count.
//!
//! Whoever waits reads a word, looks at the condition, and sleeps only while the word is the one
//! read; whoever changes the condition changes the word. All accesses are `SeqCst`: a flag set
//! before sleeping and a word changed before looking at the flag must not pass each other.

use std::fs::{File, OpenOptions};
use std::io;
use std::os::unix::fs::OpenOptionsExt as _;
use std::path::{Path, PathBuf};
use std::ptr::NonNull;
use std::sync::atomic::Ordering::SeqCst;
use std::sync::atomic::{AtomicU32, AtomicU64};
use std::time::{Duration, Instant};

use rustix::io::Errno;
use rustix::mm::{MapFlags, ProtFlags};
use rustix::thread::futex;
use rustix::time::Timespec;

use crate::process::Alarm;

/// The plant runs at most this many ticks ahead of the supervisor.
pub const LEAD_MAX: u64 = 63;
/// Most slots of a barrier.
pub const SLOTS_MAX: usize = 4096;
/// The plant looks at all members at least this often while it waits.
const RECHECK: Duration = Duration::from_millis(50);
/// Most groups of agents that are released apart.
pub const GROUPS_MAX: usize = 16;

const MAGIC: u64 = u64::from_le_bytes(*b"phxbarri");
const VERSION: u32 = 4;
/// "No member", "not paused", "pause never".
const NEVER: u64 = u64::MAX;
/// In the arrivals word: the member set changed, so every arrival wakes the plant.
const NUDGE: u32 = 1 << 15;
/// In the arrivals word: how many members have yet to arrive. Above both: the tick's low bits.
const REMAINING: u32 = NUDGE - 1;

/// Why a barrier could not be made or opened.
#[derive(Debug, thiserror::Error)]
pub enum BarrierError {
    /// The file or its mapping failed.
    #[error("cannot {action} the barrier {path}: {source}")]
    Io {
        /// What was tried.
        action: &'static str,
        /// Which file.
        path: PathBuf,
        /// Why it failed.
        source: io::Error,
    },
    /// Too many robots, or none.
    #[error("a barrier of {slots} slots: expected 1 to {SLOTS_MAX}")]
    Slots {
        /// How many were asked for.
        slots: usize,
    },
    /// The file is none of ours.
    #[error(
        "{path} is no barrier of this version: {found}; supervisor and children must be of one build"
    )]
    Foreign {
        /// Which file.
        path: PathBuf,
        /// What is wrong with it.
        found: String,
    },
}

/// A word alone on its cache line (two, for the prefetcher's pairs).
#[repr(C, align(128))]
struct Line<T>(T);

/// The start of the mapping; the slots follow.
#[repr(C)]
struct Head {
    /// Magic, version, number of slots: written before the file gets its name.
    magic: u64,
    version: u32,
    slots: u32,
    /// Into how many groups the slots are dealt, in turns.
    groups: u32,
    /// Counts the ticks that each group was released to; its agents sleep on it.
    epochs: [Line<AtomicU32>; GROUPS_MAX],
    /// The tick of an even and of an odd epoch, so that a late reader sees a matching pair.
    ticks: Line<[AtomicU64; 2]>,
    /// Tick's low 16 bits, nudge bit, remaining members; the plant sleeps on it.
    arrivals: Line<AtomicU32>,
    /// Counts changes of the member set.
    changes: Line<AtomicU32>,
    /// Ticks consumed by the supervisor.
    consumed: Line<AtomicU64>,
    /// Counts wake-ups for the lead; the plant sleeps on it.
    lead: Line<AtomicU32>,
    /// 1 while the plant waits for the lead.
    lead_waiting: Line<AtomicU32>,
    /// The plant pauses at ticks from here on.
    pause_at: Line<AtomicU64>,
    /// The tick at which the plant is paused.
    paused: Line<AtomicU64>,
    /// Counts resumptions; the paused plant sleeps on it.
    resumes: Line<AtomicU32>,
    /// Counts calls for attention; the supervisor sleeps on it.
    attention: Line<AtomicU32>,
    /// 1 while the supervisor sleeps.
    supervisor_waiting: Line<AtomicU32>,
}

/// One robot's place: what its neighbors and the plant read at each tick, and what seldom changes.
/// Behind all places follows for each the last tick it arrived at, plus 1, which changes at each.
#[repr(C, align(32))]
struct Slot {
    /// First tick it takes part in, or [`NEVER`].
    since: AtomicU64,
    /// The last even and the last odd tick at which it had nothing to say, plus 1. Two, because a
    /// neighbour may be a tick behind.
    mute: [AtomicU64; 2],
}

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

/// Making and opening.
impl Barrier {
    /// Makes the mapping: no members, not paused, nothing consumed. Slot i is in group
    /// i mod `groups`, of which there are 1 to [`GROUPS_MAX`]. The supervisor only.
    pub fn create(path: &Path, slots: usize, groups: usize) -> Result<Barrier, BarrierError> {
        if slots == 0 || slots > SLOTS_MAX {
            return Err(BarrierError::Slots { slots });
        }
        let groups = groups.clamp(1, GROUPS_MAX.min(slots));
        let bytes = bytes_for(slots);
        let failed =
            |action, source: io::Error| BarrierError::Io { action, path: path.into(), source };
        let unnamed = path.with_extension("new");
        let file = OpenOptions::new()
            .read(true)
            .write(true)
            .create_new(true)
            .mode(0o600)
            .open(&unnamed)
            .map_err(|source| failed("make", source))?;
        file.set_len(bytes as u64).map_err(|source| failed("size", source))?;
        // Takes the memory now: a full tmpfs is an error here and a SIGBUS later.
        match rustix::fs::fallocate(&file, rustix::fs::FallocateFlags::empty(), 0, bytes as u64) {
            Ok(()) | Err(Errno::OPNOTSUPP) => {}
            Err(error) => return Err(failed("allocate", error.into())),
        }
        let memory = map(&file, bytes).map_err(|source| failed("map", source))?;
        let attention_seen = AtomicU32::new(0);
        let barrier = Barrier { memory, bytes, slots, groups, attention_seen, alarm: None };
        // SAFETY: the mapping is large and aligned enough for `Head`, and still ours alone.
        unsafe {
            let head = memory.cast::<Head>().as_ptr();
            (*head).magic = MAGIC;
            (*head).version = VERSION;
            (*head).slots = slots as u32;
            (*head).groups = groups as u32;
        }
        barrier.head().pause_at.0.store(NEVER, SeqCst);
        barrier.head().paused.0.store(NEVER, SeqCst);
        for slot in barrier.all_slots() {
            slot.since.store(NEVER, SeqCst);
        }
        // Named once it is whole.
        std::fs::rename(&unnamed, path).map_err(|source| failed("name", source))?;
        Ok(barrier)
    }

    /// Opens the mapping that the supervisor made.
    pub fn open(path: &Path) -> Result<Barrier, BarrierError> {
        let failed =
            |action, source: io::Error| BarrierError::Io { action, path: path.into(), source };
        let foreign = |found: String| BarrierError::Foreign { path: path.into(), found };
        let file = OpenOptions::new()
            .read(true)
            .write(true)
            .open(path)
            .map_err(|source| failed("open", source))?;
        let bytes = file.metadata().map_err(|source| failed("look at", source))?.len() as usize;
        if bytes < bytes_for(1) {
            return Err(foreign(format!("it has only {bytes} bytes")));
        }
        let memory = map(&file, bytes).map_err(|source| failed("map", source))?;
        let attention_seen = AtomicU32::new(0);
        let (slots, groups) = (0, 0);
        let mut barrier = Barrier { memory, bytes, slots, groups, attention_seen, alarm: None };
        let Head { magic, version, slots, groups, .. } = *barrier.head();
        if magic != MAGIC {
            return Err(foreign(format!("it begins with {magic:#x}")));
        }
        if version != VERSION {
            return Err(foreign(format!("it has version {version}, expected {VERSION}")));
        }
        let (slots, groups) = (slots as usize, groups as usize);
        if groups == 0 || groups > GROUPS_MAX {
            return Err(foreign(format!("it has {groups} groups")));
        }
        if slots == 0 || slots > SLOTS_MAX || bytes != bytes_for(slots) {
            return Err(foreign(format!("it has {slots} slots in {bytes} bytes")));
        }
        (barrier.slots, barrier.groups) = (slots, groups);
        barrier.attention_seen = AtomicU32::new(barrier.head().attention.0.load(SeqCst));
        Ok(barrier)
    }

    /// From now on waits for a tick, and for arrivals at it, end by this alarm: arming a time-out
    /// for each of them, and taking it back, costs more than a robot's thinking.
    pub fn rely_on(&mut self, alarm: Alarm) {
        self.alarm = Some(alarm);
    }

    /// How many slots there are.
    pub fn slots(&self) -> usize {
        self.slots
    }

    /// How many groups there are.
    pub fn groups(&self) -> usize {
        self.groups
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

/// Members: changed by the supervisor while the plant is paused, or after an unplanned death.
impl Barrier {
    /// Makes a slot a member that must arrive at this tick and all later ones.
    pub fn set_member(&self, slot: usize, since_tick: u64) {
        let place = &self.all_slots()[slot];
        self.arrived()[slot].store(0, SeqCst);
        place.mute.iter().for_each(|mute| mute.store(0, SeqCst));
        place.since.store(since_tick, SeqCst);
        self.nudge();
    }

    /// Lets the plant go on without this slot, even in the middle of a tick.
    pub fn remove_member(&self, slot: usize) {
        self.all_slots()[slot].since.store(NEVER, SeqCst);
        self.nudge();
    }

    /// The first tick that a member takes part in; `None` if it is no member.
    pub fn member_since(&self, slot: usize) -> Option<u64> {
        Some(self.all_slots().get(slot)?.since.load(SeqCst)).filter(|&since| since != NEVER)
    }

    /// The members' slots.
    pub fn members(&self) -> impl Iterator<Item = usize> + '_ {
        (0..self.slots).filter(|&slot| self.member_since(slot).is_some())
    }

    /// Lets the plant look at the members again.
    fn nudge(&self) {
        self.head().changes.0.fetch_add(1, SeqCst);
        self.head().arrivals.0.fetch_or(NUDGE, SeqCst);
        wake(&self.head().arrivals.0);
    }

    fn expected(&self, slot: &Slot, tick: u64) -> bool {
        // NEVER is later than any tick.
        slot.since.load(SeqCst) <= tick
    }
}

/// The plant's side of a tick.
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

    /// Waits until every member has arrived at the tick; at the limit, names those that have not.
    pub fn wait_arrivals(&self, tick: u64, limit: Duration) -> Result<(), Vec<usize>> {
        let end = Instant::now() + limit;
        let word = &self.head().arrivals.0;
        loop {
            let seen = word.load(SeqCst);
            // While some remain and nobody was removed, the slots need not be looked at.
            let settled = seen & REMAINING == 0 || seen & NUDGE != 0;
            if settled && self.all_arrived(tick) {
                return Ok(());
            }
            let left = end.saturating_duration_since(Instant::now());
            if left.is_zero() {
                let missing: Vec<usize> = self.missing(tick).collect();
                return if missing.is_empty() { Ok(()) } else { Err(missing) };
            }
            // Nobody called for that long: believe the slots, not the count.
            if self.rest(word, seen, left.min(RECHECK)) != Woken::Perhaps && self.all_arrived(tick)
            {
                return Ok(());
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

    /// Sleeps within a tick, by the alarm if there is one.
    fn rest(&self, word: &AtomicU32, value: u32, limit: Duration) -> Woken {
        sleep_while(word, value, self.alarm.is_none().then_some(limit))
    }
}

/// The agent's side of a tick.
impl Barrier {
    /// The epoch of a slot's group now; take it before announcing readiness, then wait for the
    /// next one.
    pub fn epoch(&self, slot: usize) -> u32 {
        self.epoch_word(slot).load(SeqCst)
    }

    fn epoch_word(&self, slot: usize) -> &AtomicU32 {
        &self.head().epochs[slot % self.groups].0
    }

    /// A slot waits for another epoch than the one seen: that epoch and its tick. `None` at the
    /// limit and after a signal or alarm.
    pub fn wait_tick(&self, slot: usize, seen_epoch: u32, limit: Duration) -> Option<(u32, u64)> {
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
            if self.rest(word, seen_epoch, limit) != Woken::Perhaps {
                return None;
            }
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
}

/// The lead of the plant over the supervisor.
impl Barrier {
    /// The supervisor has consumed the truth of this many ticks.
    pub fn consumed(&self, ticks: u64) {
        let head = self.head();
        head.consumed.0.store(ticks, SeqCst);
        if head.lead_waiting.0.load(SeqCst) != 0 {
            head.lead.0.fetch_add(1, SeqCst);
            wake(&head.lead.0);
        }
    }

    /// The plant waits until the tick is at most `lead_max` after the ticks consumed; false at the
    /// limit and after a signal. Calls for attention before it sleeps.
    pub fn wait_lead(&self, tick: u64, lead_max: u64, limit: Duration) -> bool {
        let head = self.head();
        let near = || tick.saturating_sub(head.consumed.0.load(SeqCst)) <= lead_max;
        if near() {
            return true;
        }
        head.lead_waiting.0.store(1, SeqCst);
        self.attention();
        let reached = self.wait_until(&head.lead.0, near, limit);
        head.lead_waiting.0.store(0, SeqCst);
        reached
    }
}

/// Pauses, in which the supervisor acts.
impl Barrier {
    /// The plant shall pause at this tick or, if it is past, at the next; `u64::MAX` is never.
    /// Stays in force over [`Barrier::resume`]: set the next one before resuming.
    pub fn pause_at(&self, tick: u64) {
        self.head().pause_at.0.store(tick, SeqCst);
    }

    /// Whether the plant shall pause before it begins this tick.
    pub fn pause_due(&self, tick: u64) -> bool {
        tick >= self.head().pause_at.0.load(SeqCst)
    }

    /// The plant says that it is paused before this tick and waits to be resumed; false at the
    /// limit and after a signal.
    pub fn pause(&self, tick: u64, limit: Duration) -> bool {
        let head = self.head();
        let before = head.resumes.0.load(SeqCst);
        head.paused.0.store(tick, SeqCst);
        self.attention();
        let resumed = || head.resumes.0.load(SeqCst) != before;
        let resumed = self.wait_until(&head.resumes.0, resumed, limit);
        if !resumed {
            head.paused.0.store(NEVER, SeqCst);
        }
        resumed
    }

    /// The tick before which the plant is paused, if it is.
    pub fn paused(&self) -> Option<u64> {
        Some(self.head().paused.0.load(SeqCst)).filter(|&tick| tick != NEVER)
    }

    /// Lets the paused plant go on.
    pub fn resume(&self) {
        self.head().paused.0.store(NEVER, SeqCst);
        self.head().resumes.0.fetch_add(1, SeqCst);
        wake(&self.head().resumes.0);
    }
}

/// The supervisor's rest.
impl Barrier {
    /// Calls the supervisor: there is truth to consume, or a pause to act in.
    pub fn attention(&self) {
        let head = self.head();
        head.attention.0.fetch_add(1, SeqCst);
        if head.supervisor_waiting.0.load(SeqCst) != 0 {
            wake(&head.attention.0);
        }
    }

    /// The supervisor rests until it was called since the last time it asked; false at the limit
    /// and after a signal. For one thread only.
    pub fn wait_attention(&self, limit: Duration) -> bool {
        let head = self.head();
        let seen = self.attention_seen.load(SeqCst);
        head.supervisor_waiting.0.store(1, SeqCst);
        self.wait_until(&head.attention.0, || head.attention.0.load(SeqCst) != seen, limit);
        head.supervisor_waiting.0.store(0, SeqCst);
        let now = head.attention.0.load(SeqCst);
        self.attention_seen.store(now, SeqCst);
        now != seen
    }
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Woken {
    Perhaps,
    TimedOut,
    Signal,
}

impl Barrier {
    /// Sleeps until the condition holds; whoever makes it true changes the word. False at the
    /// limit and after a signal, but for alarms.
    fn wait_until(&self, word: &AtomicU32, condition: impl Fn() -> bool, limit: Duration) -> bool {
        let end = Instant::now() + limit;
        let only_alarm = || self.alarm.as_ref().is_some_and(|alarm| !alarm.stops());
        loop {
            let seen = word.load(SeqCst);
            if condition() {
                return true;
            }
            let left = end.saturating_duration_since(Instant::now());
            if left.is_zero() {
                return condition();
            }
            if sleep_while(word, seen, Some(left)) == Woken::Signal && !only_alarm() {
                return condition();
            }
        }
    }
}

/// Sleeps while the word has this value, at most for the limit; may return early.
fn sleep_while(word: &AtomicU32, value: u32, limit: Option<Duration>) -> Woken {
    let limit = limit.map(|limit| Timespec {
        tv_sec: limit.as_secs().min(i32::MAX as u64) as i64,
        tv_nsec: limit.subsec_nanos() as _,
    });
    // Not the private flag: the word is shared between processes.
    match futex::wait(word, futex::Flags::empty(), value, limit.as_ref()) {
        Err(Errno::TIMEDOUT) => Woken::TimedOut,
        Err(Errno::INTR) => Woken::Signal,
        _ => Woken::Perhaps,
    }
}

fn wake(word: &AtomicU32) {
    // Fails only for a word that is not mapped.
    let _ = futex::wake(word, futex::Flags::empty(), i32::MAX as u32);
}

fn bytes_for(slots: usize) -> usize {
    size_of::<Head>() + slots * (size_of::<Slot>() + size_of::<AtomicU64>())
}

fn map(file: &File, bytes: usize) -> io::Result<NonNull<u8>> {
    // SAFETY: a fresh mapping at an address of the kernel's choice.
    let memory = unsafe {
        rustix::mm::mmap(
            std::ptr::null_mut(),
            bytes,
            ProtFlags::READ | ProtFlags::WRITE,
            MapFlags::SHARED,
            file,
            0,
        )?
    };
    Ok(NonNull::new(memory.cast()).expect("the kernel maps nothing at 0 unasked"))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::process::Stop;
    use std::sync::atomic::AtomicBool;
    use std::thread;

    const LIMIT: Duration = Duration::from_secs(10);
    const SHORT: Duration = Duration::from_millis(20);

    /// A barrier and another mapping of the same file.
    fn pair(slots: usize) -> (tempfile::TempDir, Barrier, Barrier) {
        let directory = tempfile::tempdir().unwrap();
        let path = directory.path().join("barrier");
        let made = Barrier::create(&path, slots, 2).unwrap();
        let opened = Barrier::open(&path).unwrap();
        assert_eq!(opened.slots(), slots);
        (directory, made, opened)
    }

    fn begin(plant: &Barrier, tick: u64) {
        plant.begin(tick);
        (0..plant.groups()).for_each(|group| plant.release(group));
    }

    #[test]
    fn a_group_that_is_not_released_sleeps_on_and_is_still_waited_for() {
        let (_directory, plant, agents) = pair(3);
        (0..3).for_each(|slot| plant.set_member(slot, 0));
        assert_eq!(plant.members_of(0).collect::<Vec<_>>(), [0, 2]);
        plant.begin(0);
        plant.release(0);
        for slot in [0, 2] {
            assert_eq!(agents.wait_tick(slot, 0, LIMIT), Some((1, 0)));
            agents.arrive(slot, 0);
        }
        assert_eq!(agents.wait_tick(1, 0, SHORT), None);
        assert_eq!(plant.wait_arrivals(0, SHORT), Err(vec![1]));
        plant.release(1);
        assert_eq!(agents.wait_tick(1, 0, LIMIT), Some((1, 0)));
        agents.arrive(1, 0);
        plant.wait_arrivals(0, LIMIT).unwrap();
    }

    #[test]
    fn nobody_is_lost_in_many_ticks() {
        const TICKS: u64 = 5_000;
        const AGENTS: usize = 5;
        let (_directory, plant, agents) = pair(AGENTS + 1);
        let at = [const { AtomicU64::new(0) }; AGENTS];
        (0..AGENTS).for_each(|slot| plant.set_member(slot, 0));
        thread::scope(|scope| {
            let ready = agents.epoch(0);
            for (slot, at) in at.iter().enumerate() {
                let agents = &agents;
                scope.spawn(move || {
                    let mut seen = ready;
                    for expected in 0..TICKS {
                        let (epoch, tick) = agents.wait_tick(slot, seen, LIMIT).unwrap();
                        assert_eq!(tick, expected);
                        seen = epoch;
                        at.store(tick + 1, SeqCst);
                        agents.arrive(slot, tick);
                    }
                });
            }
            let start = Instant::now();
            for tick in 0..TICKS {
                begin(&plant, tick);
                plant.wait_arrivals(tick, LIMIT).unwrap();
                assert!(at.iter().all(|at| at.load(SeqCst) == tick + 1));
            }
            // With lost wake-ups each tick would take RECHECK.
            assert!(start.elapsed() < RECHECK * TICKS as u32 / 4);
        });
    }

    #[test]
    fn the_plant_goes_on_without_a_member_removed_in_the_middle_of_a_tick() {
        let (_directory, plant, supervisor) = pair(3);
        (0..3).for_each(|slot| plant.set_member(slot, 0));
        thread::scope(|scope| {
            begin(&plant, 0);
            scope.spawn(|| {
                supervisor.arrive(2, 0);
                thread::sleep(SHORT);
                supervisor.remove_member(1);
                thread::sleep(SHORT);
                supervisor.arrive(0, 0);
            });
            plant.wait_arrivals(0, LIMIT).unwrap();
        });
        assert_eq!(plant.members().collect::<Vec<_>>(), [0, 2]);
        assert_eq!(plant.member_since(1), None);
        begin(&plant, 1);
        assert_eq!(plant.head().arrivals.0.load(SeqCst), 1 << 16 | 2);
    }

    #[test]
    fn removals_that_race_with_ticks_never_hang_them() {
        let (_directory, plant, other) = pair(2);
        plant.set_member(0, 0);
        let done = AtomicBool::new(false);
        thread::scope(|scope| {
            let ready = other.epoch(0);
            let other = &other;
            scope.spawn(move || {
                let mut seen = ready;
                while let Some((epoch, tick)) = other.wait_tick(0, seen, Duration::from_secs(1)) {
                    seen = epoch;
                    other.arrive(0, tick);
                }
            });
            // Slot 1 never arrives, and is removed each time.
            scope.spawn(|| {
                while !done.load(SeqCst) {
                    other.set_member(1, 0);
                    thread::yield_now();
                    other.remove_member(1);
                }
            });
            for tick in 0..2_000 {
                begin(&plant, tick);
                plant.wait_arrivals(tick, LIMIT).unwrap();
            }
            done.store(true, SeqCst);
        });
    }

    #[test]
    fn the_limit_names_those_that_did_not_arrive() {
        let (_directory, plant, agents) = pair(4);
        (0..3).for_each(|slot| plant.set_member(slot, 0));
        plant.set_member(3, 8);
        begin(&plant, 7);
        agents.arrive(1, 7);
        agents.arrive(1, 7);
        assert_eq!(plant.wait_arrivals(7, SHORT), Err(vec![0, 2]));
        assert_eq!(agents.wait_tick(2, agents.epoch(2), SHORT), None);
    }

    #[test]
    fn a_late_arrival_at_an_older_tick_does_no_harm() {
        let (_directory, plant, agents) = pair(2);
        (0..2).for_each(|slot| plant.set_member(slot, 0));
        begin(&plant, 0);
        agents.arrive(0, 0);
        begin(&plant, 1);
        agents.arrive(1, 0);
        agents.arrive(0, 1);
        assert_eq!(plant.wait_arrivals(1, SHORT), Err(vec![1]));
        agents.arrive(1, 1);
        plant.wait_arrivals(1, SHORT).unwrap();
    }

    #[test]
    fn a_non_member_may_look_on_and_is_not_waited_for() {
        let (_directory, plant, agents) = pair(2);
        plant.set_member(0, 0);
        let seen = agents.epoch(1);
        begin(&plant, 3);
        assert_eq!(agents.wait_tick(1, seen, SHORT).unwrap().1, 3);
        agents.arrive(1, 3);
        assert_eq!(plant.wait_arrivals(3, SHORT), Err(vec![0]));
        agents.arrive(0, 3);
        plant.wait_arrivals(3, SHORT).unwrap();
    }

    #[test]
    fn the_plant_pauses_and_resumes() {
        let (_directory, plant, supervisor) = pair(1);
        assert!(!plant.pause_due(u64::MAX - 1));
        thread::scope(|scope| {
            supervisor.pause_at(5);
            scope.spawn(|| {
                assert!(!plant.pause_due(4));
                for tick in 5..500 {
                    assert!(plant.pause_due(tick));
                    assert!(plant.pause(tick, LIMIT));
                }
            });
            for tick in 5..500 {
                while supervisor.paused() != Some(tick) {
                    assert!(supervisor.wait_attention(LIMIT));
                }
                supervisor.pause_at(tick + 1);
                supervisor.resume();
            }
        });
        assert!(!plant.pause(500, SHORT));
        assert_eq!(supervisor.paused(), None);
        supervisor.pause_at(u64::MAX);
        assert!(!plant.pause_due(501));
    }

    #[test]
    fn the_lead_is_bounded() {
        const TICKS: u64 = 3_000;
        let (_directory, plant, supervisor) = pair(1);
        let published = AtomicU64::new(0);
        thread::scope(|scope| {
            scope.spawn(|| {
                for tick in 0..TICKS {
                    assert!(plant.wait_lead(tick, LEAD_MAX, LIMIT));
                    published.store(tick + 1, SeqCst);
                    plant.attention();
                }
            });
            let mut consumed = 0;
            while consumed < TICKS {
                let ready = published.load(SeqCst);
                assert!(ready <= consumed + LEAD_MAX + 1);
                if ready == consumed {
                    assert!(supervisor.wait_attention(LIMIT));
                    continue;
                }
                consumed = ready;
                supervisor.consumed(consumed);
            }
        });
        assert!(!plant.wait_lead(TICKS + LEAD_MAX + 1, LEAD_MAX, SHORT));
    }

    #[test]
    fn attention_is_remembered_and_told_once() {
        let (_directory, plant, supervisor) = pair(1);
        plant.attention();
        plant.attention();
        assert!(supervisor.wait_attention(SHORT));
        assert!(!supervisor.wait_attention(SHORT));
    }

    #[test]
    fn with_an_alarm_waits_within_a_tick_end_though_they_have_no_limit_of_their_own() {
        let (_directory, mut plant, mut agents) = pair(2);
        thread::scope(|scope| {
            plant.set_member(0, 0);
            plant.begin(0);
            scope.spawn(move || {
                agents.rely_on(Alarm::start(&Stop::default()).unwrap());
                assert_eq!(agents.wait_tick(0, agents.epoch(0), Duration::MAX), None);
                // Waits for longer things go on over alarms, to their limit or until a stop.
                let began = Instant::now();
                assert!(!agents.wait_lead(LEAD_MAX + 1, LEAD_MAX, 2 * Alarm::PERIOD));
                assert!(began.elapsed() >= 2 * Alarm::PERIOD);
            });
            scope.spawn(move || {
                plant.rely_on(Alarm::start(&Stop::default()).unwrap());
                assert_eq!(plant.wait_arrivals(0, SHORT), Err(vec![0]));
            });
        });
    }

    #[test]
    fn a_strange_file_is_refused() {
        let (directory, made, _opened) = pair(2);
        drop(made);
        let path = directory.path().join("barrier");
        assert!(Barrier::create(&path, 0, 1).is_err());
        let mut bytes = std::fs::read(&path).unwrap();
        bytes[8] = 9;
        std::fs::write(&path, &bytes).unwrap();
        let error = Barrier::open(&path).unwrap_err().to_string();
        assert!(error.contains(&format!("version 9, expected {VERSION}")), "{error}");
        bytes[0] = 0;
        std::fs::write(&path, &bytes).unwrap();
        assert!(Barrier::open(&path).is_err());
        std::fs::write(&path, "short").unwrap();
        assert!(Barrier::open(&path).is_err());
    }
}
