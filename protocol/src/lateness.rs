//! Why a robot was late, from what a process may read of itself and its machine without privilege.
//!
//! Counters are read now and then and after each late wake-up, so that being on time costs next to
//! nothing. What they grew by in between, against how late it was, is the cause. Must not: allocate, or
//! read anything that waits.

use std::fs::File;
use std::os::unix::fs::FileExt as _;
use std::path::Path;

use crate::stage::Cause;
use crate::wake::Wake;
use crate::{cgroup, clock};

/// A wake-up is late if it comes this part of a period after its deadline.
const LATE_PART: u64 = 10;
/// After so many wake-ups on time counters are read again: what ordinary ones add up to in between explains
/// nothing yet, and what reading costs is shared by them.
const LOOK_EVERY: u32 = 50;
/// What a page fault without a disk takes at most, ns.
const MINOR_FAULT_NS: u64 = 1_000;

/// In `schedstat`: time on a core, time waiting for one, and how often.
const WAITED: usize = 1;
/// In `stat`: `cpu`, then user, nice, system, idle, iowait, irq, softirq and steal, of all cores.
const STOLEN: usize = 8;

/// What had been counted at one moment, since the process or the machine started; 0 where the kernel does not say.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
struct Counters {
    /// For how long this thread was ready to run while others ran, ns.
    waited_ns: u64,
    /// For how long the cgroups that this process is in were held up by a limit, on all cores together, ns.
    held_up_ns: u64,
    /// For how long the host of this virtual machine ran somebody else, on all cores together, ns. It grows in
    /// steps of 10 ms.
    stolen_ns: u64,
    /// Page faults that read a disk.
    major_faults: u64,
    /// Page faults that did not.
    minor_faults: u64,
}

/// Whether a wake-up this long after its deadline is on time, of a loop with this period.
const fn in_time(behind_ns: u64, period_ns: u64) -> bool {
    behind_ns <= period_ns / LATE_PART
}

/// A wake-up after its deadline.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
struct Late {
    /// How long after, ns.
    behind_ns: u64,
    /// How much of that the loop was still at work, ns.
    at_work_ns: u64,
    /// How long that work took since the wake-up before, ns.
    worked_ns: u64,
}

/// Why a loop with this period was late: whatever explains at least half of the lateness. `grown`: by how
/// much counters grew since the thread looked last; `previous`: why the wake-up before was late, if it was.
///
/// A process that its cgroup holds up waits for a core as well, but the kernel may not count it so.
/// Waiting comes before work: whoever is interrupted in the middle of its work is at work for longer.
/// The host comes last of those that are counted, for its steps are coarse. Work that takes less than a
/// period is still under way, or has missed its deadline, only because it began late: then the wake-up
/// before has the cause.
fn cause(late: Late, grown: Counters, period_ns: u64, previous: Option<Cause>) -> Cause {
    let began_late = previous.filter(|_| late.worked_ns < period_ns);
    if let Some(previous) = began_late.filter(|_| in_time(late.behind_ns, period_ns)) {
        return previous;
    }
    let explains = |ns: u64| ns >= late.behind_ns.div_ceil(2);
    if explains(grown.waited_ns.max(grown.held_up_ns)) {
        Cause::Core
    } else if grown.major_faults > 0 || explains(grown.minor_faults.saturating_mul(MINOR_FAULT_NS))
    {
        Cause::Faults
    } else if explains(grown.stolen_ns) {
        Cause::Host
    } else if explains(late.at_work_ns) {
        began_late.unwrap_or(Cause::Work)
    } else {
        Cause::Unknown
    }
}

impl Counters {
    /// By how much they grew since then.
    fn since(self, before: Counters) -> Counters {
        Counters {
            waited_ns: self.waited_ns.saturating_sub(before.waited_ns),
            held_up_ns: self.held_up_ns.saturating_sub(before.held_up_ns),
            stolen_ns: self.stolen_ns.saturating_sub(before.stolen_ns),
            major_faults: self.major_faults.saturating_sub(before.major_faults),
            minor_faults: self.minor_faults.saturating_sub(before.minor_faults),
        }
    }
}

/// Tells why its thread was late, by what was counted since it looked last, and by when its loop was at work.
#[derive(Debug)]
pub struct Witness {
    reader: Reader,
    period_ns: u64,
    counted: Counters,
    /// Wake-ups on time since.
    on_time: u32,
    previous: Option<Cause>,
    /// When the loop woke up last, ns, and until when it was at work then.
    awake_ns: u64,
    rested_ns: u64,
}

impl Witness {
    /// Of the thread that makes it, whose loop has this period, ns.
    pub fn new(period_ns: u64) -> Witness {
        let reader = Reader::new();
        let counted = reader.read();
        let (awake_ns, rested_ns) = (clock::now_ns(), clock::now_ns());
        Witness { reader, period_ns, counted, on_time: 0, previous: None, awake_ns, rested_ns }
    }

    /// Why the loop was late at this wake-up, if it was: by more than a tenth of the period, or after a
    /// `missed` deadline. To be asked at each wake-up. Counters are read again now and then while it is on time,
    /// and at each late wake-up: what was counted may yet be why the next is late.
    pub fn cause_if_late(&mut self, wake: &Wake, missed: bool) -> Option<Cause> {
        let late = Late {
            behind_ns: wake.lateness_ns,
            at_work_ns: self.rested_ns.saturating_sub(wake.due_ns),
            worked_ns: self.rested_ns.saturating_sub(self.awake_ns),
        };
        self.awake_ns = wake.due_ns + wake.lateness_ns;
        if !missed && in_time(late.behind_ns, self.period_ns) {
            self.previous = None;
            self.on_time += 1;
            if self.on_time == LOOK_EVERY {
                self.look();
            }
            return None;
        }
        self.on_time = 0;
        let before = std::mem::replace(&mut self.counted, self.reader.read());
        self.previous =
            Some(cause(late, self.counted.since(before), self.period_ns, self.previous));
        self.previous
    }

    /// At a wake-up that does not count: looks again.
    pub fn look_at(&mut self, wake: &Wake) {
        self.awake_ns = wake.due_ns + wake.lateness_ns;
        self.look();
    }

    /// The loop was at work until `now_ns`.
    pub fn rests(&mut self, now_ns: u64) {
        self.rested_ns = now_ns;
    }

    /// Looks again, so that what was counted until now explains nothing that comes.
    fn look(&mut self) {
        self.counted = self.reader.read();
        (self.on_time, self.previous) = (0, None);
    }
}

/// Reads the counters of late wake-ups, of the thread that made it. What cannot be read counts as 0.
#[derive(Debug)]
pub struct Reader {
    schedstat: Option<File>,
    stat: Option<File>,
    /// Of each cgroup that has a limit.
    limits: Vec<File>,
    ns_per_tick: u64,
}

impl Reader {
    /// A reader for this thread.
    pub fn new() -> Reader {
        let limits = cgroup::limits(Path::new("/"));
        Reader {
            schedstat: File::open("/proc/thread-self/schedstat").ok(),
            stat: File::open("/proc/stat").ok(),
            limits: limits.iter().filter_map(|limited| File::open(&limited.stat).ok()).collect(),
            ns_per_tick: 1_000_000_000 / clock::ticks_per_s(),
        }
    }

    /// The causes that this machine cannot tell: what they are counted in cannot be read.
    pub fn untold(&self) -> Vec<Cause> {
        let mut buffer = [0; 160];
        let mut untold = Vec::new();
        let told = |file: &Option<File>, buffer: &mut [u8], place| {
            number(file.as_ref(), buffer, place).is_some()
        };
        if !told(&self.schedstat, &mut buffer, WAITED) {
            untold.push(Cause::Core);
        }
        if !told(&self.stat, &mut buffer, STOLEN) {
            untold.push(Cause::Host);
        }
        untold
    }

    /// What is counted now.
    fn read(&self) -> Counters {
        let mut counters = faults();
        let mut buffer = [0; 160];
        if let Some(waited_ns) = number(self.schedstat.as_ref(), &mut buffer, WAITED) {
            counters.waited_ns = waited_ns;
        }
        if let Some(ticks) = number(self.stat.as_ref(), &mut buffer, STOLEN) {
            counters.stolen_ns = ticks.saturating_mul(self.ns_per_tick);
        }
        counters.held_up_ns = self.limits.iter().filter_map(held_up_ns).max().unwrap_or(0);
        counters
    }
}

impl Default for Reader {
    fn default() -> Reader {
        Reader::new()
    }
}

/// The number at this place of a file's first line.
fn number(file: Option<&File>, buffer: &mut [u8], place: usize) -> Option<u64> {
    let length = file?.read_at(buffer, 0).ok()?;
    let mut rest = &buffer[..length];
    // Byte by byte: this is half of what telling causes costs.
    for _ in 0..place {
        let end = rest.iter().position(|&byte| byte <= b' ')?;
        let blanks = rest[end..].iter().take_while(|&&byte| byte == b' ').count();
        rest = &rest[end + blanks..];
    }
    let digits = rest.iter().map(|byte| byte.wrapping_sub(b'0')).take_while(|&digit| digit < 10);
    let value =
        |number: Option<u64>, digit| Some(number.unwrap_or(0).wrapping_mul(10) + u64::from(digit));
    digits.fold(None, value)
}

fn held_up_ns(stat: &File) -> Option<u64> {
    let mut buffer = [0; 1024];
    let length = stat.read_at(&mut buffer, 0).ok()?;
    cgroup::held_up_ns(str::from_utf8(&buffer[..length]).ok()?)
}

fn faults() -> Counters {
    let mut usage = std::mem::MaybeUninit::<libc::rusage>::zeroed();
    // SAFETY: it writes the whole of `usage`, which holds a valid value before.
    let usage = unsafe {
        libc::getrusage(libc::RUSAGE_THREAD, usage.as_mut_ptr());
        usage.assume_init()
    };
    Counters {
        major_faults: usage.ru_majflt as u64,
        minor_faults: usage.ru_minflt as u64,
        ..Counters::default()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const MS: u64 = 1_000_000;
    /// More than any allocator keeps for the next, so that it is new memory.
    const FRESH: usize = 40 << 20;
    /// It has more page faults than this, even with pages of 2 MB.
    const FEW: u64 = 10;

    fn late(behind_ns: u64, at_work_ns: u64) -> Late {
        Late { behind_ns, at_work_ns, worked_ns: 10 * MS }
    }

    /// Recorded on an Intel Xeon with two cores, a virtual machine, Linux 6.18; what its host took had to be
    /// made up, and what a disk did.
    #[test]
    fn each_kind_of_lateness_has_its_cause() {
        // Behind, at work, waited, held up, stolen, all in ns; faults with a disk and without.
        for (what, numbers, expected) in [
            ("higher priority", [5_369_528, 0, 5_353_826, 0, 0, 0, 0], Cause::Core),
            ("a quota", [54_072_410, 54_042_576, 56_006_003, 51_644_774, 0, 0, 0], Cause::Core),
            (
                "a quota, not counted as waiting",
                [59_053_375, 0, 0, 55_658_137, 0, 0, 0],
                Cause::Core,
            ),
            ("fresh memory", [3_108_277, 3_073_230, 135_713, 0, 0, 0, 6_321], Cause::Faults),
            ("memory paged out", [3 * MS, 2 * MS, 40_000, 0, 0, 5, 9], Cause::Faults),
            ("a busy host", [12 * MS, 0, 80_000, 0, 10 * MS, 0, 0], Cause::Host),
            ("a law that overruns", [3_083_707, 3_047_666, 139_081, 0, 0, 0, 0], Cause::Work),
            ("stopped by a stranger", [7_833_855, 0, 27_142, 0, 0, 0, 0], Cause::Unknown),
            ("a timer that fired late", [MS, 0, 11_000, 0, 0, 0, 0], Cause::Unknown),
        ] {
            let [
                behind_ns,
                at_work_ns,
                waited_ns,
                held_up_ns,
                stolen_ns,
                major_faults,
                minor_faults,
            ] = numbers;
            let grown = Counters { waited_ns, held_up_ns, stolen_ns, major_faults, minor_faults };
            assert_eq!(cause(late(behind_ns, at_work_ns), grown, 5 * MS, None), expected, "{what}");
        }
    }

    #[test]
    fn work_that_began_late_and_was_quick_has_the_cause_for_which_it_began_late() {
        let quick = Late { worked_ns: 4 * MS, ..late(2 * MS, 2 * MS) };
        let slow = Late { worked_ns: 12 * MS, ..quick };
        let on_time = Late { behind_ns: MS / 100, at_work_ns: 0, ..quick };
        let cause = |late, previous| cause(late, Counters::default(), 10 * MS, previous);
        assert_eq!(cause(quick, Some(Cause::Core)), Cause::Core);
        assert_eq!(cause(on_time, Some(Cause::Core)), Cause::Core, "it missed its deadline");
        assert_eq!(cause(on_time, None), Cause::Unknown);
        assert_eq!(cause(quick, None), Cause::Work);
        assert_eq!(cause(slow, Some(Cause::Core)), Cause::Work);
    }

    fn wake(lateness_ns: u64) -> Wake {
        Wake { due_ns: clock::now_ns(), lateness_ns }
    }

    #[test]
    fn on_time_is_by_a_tenth_of_the_period_and_not_after_a_missed_deadline() {
        let mut witness = Witness::new(10 * MS);
        let mut is_late = |ns, missed| witness.cause_if_late(&wake(ns), missed).is_some();
        assert_eq!(
            [is_late(MS, false), is_late(MS, true), is_late(MS + 1, false)],
            [false, true, true]
        );
    }

    #[test]
    fn what_was_counted_while_it_overran_is_still_there_at_the_late_wake_up_that_follows() {
        let mut witness = Witness::new(10 * MS);
        let touch = || drop(std::hint::black_box(vec![1_u8; FRESH]));
        let faults = |witness: &Witness| witness.reader.read().since(witness.counted).minor_faults;
        touch();
        assert!(faults(&witness) > FEW);
        assert!(witness.cause_if_late(&wake(5 * MS), false).is_some());
        assert!(faults(&witness) < FEW, "they were looked at when it was late");
        touch();
        for _ in 1..LOOK_EVERY {
            assert_eq!(witness.cause_if_late(&wake(0), false), None);
        }
        assert!(faults(&witness) > FEW, "not yet");
        assert_eq!(witness.cause_if_late(&wake(0), false), None);
        assert!(faults(&witness) < FEW, "they were looked at when it was on time");
    }

    #[test]
    fn counters_that_cannot_be_read_explain_nothing() {
        let reader = Reader { schedstat: None, stat: None, limits: Vec::new(), ns_per_tick: 1 };
        let now = reader.read();
        assert_eq!((now.waited_ns, now.stolen_ns), (0, 0));
        assert_eq!(reader.untold(), [Cause::Core, Cause::Host]);
    }

    #[test]
    fn the_number_at_a_place_of_the_first_line_is_read() {
        let mut file = tempfile::tempfile().unwrap();
        std::io::Write::write_all(&mut file, b"cpu  10 20 30\ncpu0 1 2 3\n").unwrap();
        let mut buffer = [0; 32];
        assert_eq!(number(Some(&file), &mut buffer, 2), Some(20));
        assert_eq!(number(Some(&file), &mut buffer, 0), None, "a word");
        assert_eq!(number(Some(&file), &mut buffer, 4), None, "another line's");
        assert_eq!(number(None, &mut buffer, 1), None);
    }
}
