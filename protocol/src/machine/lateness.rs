//! Diagnosis of late wake-ups from kernel counters that a process may read without privilege.
//!
//! Counters are read periodically and after each late wake-up, so being on time costs next to nothing. Their
//! growth in between is compared with the lateness to find the cause. Must not: allocate, or read anything that
//! blocks.

use std::fs::File;
use std::os::unix::fs::FileExt as _;
use std::path::Path;

use crate::machine::{cgroup, clock};
use crate::stage::LatenessCause;
use crate::wake::WakeUp;

/// Lateness threshold, as a fraction of the period: a wake-up is late if it comes more than 1/10 of a period
/// after its deadline.
const LATE_PERIOD_DIVISOR: u64 = 10;
/// Number of wake-ups on time between two reads of the counters. It is small enough that the counts of ordinary
/// wake-ups explain no lateness, and large enough to share the cost of reading.
const WAKE_UPS_PER_READ: u32 = 50;
/// Maximum duration of a page fault without disk access, ns.
const MINOR_FAULT_MAX_NS: u64 = 1_000;

/// Index of the run-queue delay in `schedstat`: time on a core, time waiting for one, number of time slices.
const RUN_QUEUE_DELAY_FIELD_INDEX: usize = 1;
/// Index of the steal time in `stat`: `cpu`, then user, nice, system, idle, iowait, irq, softirq and steal,
/// summed over all cores.
const STEAL_TIME_FIELD_INDEX: usize = 8;

/// Kernel counters at one time, since the start of the process or machine; 0 if the kernel does not report them.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
struct KernelCounters {
    /// Run-queue delay: time for which this thread was ready to run while others ran, ns.
    run_queue_delay_ns: u64,
    /// Time for which CPU bandwidth limits throttled the cgroups of this process, summed over cores, ns.
    throttled_ns: u64,
    /// Steal time: time for which the host of this virtual machine ran other guests, summed over cores, ns. It
    /// grows in steps of 10 ms.
    steal_time_ns: u64,
    /// Number of page faults with disk access.
    major_faults: u64,
    /// Number of page faults without disk access.
    minor_faults: u64,
}

/// Returns whether a wake-up this long after its deadline is on time, for a loop with this period.
const fn is_on_time(lateness_ns: u64, period_ns: u64) -> bool {
    lateness_ns <= period_ns / LATE_PERIOD_DIVISOR
}

/// A late wake-up.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
struct LateWakeUp {
    /// Time between deadline and wake-up, ns.
    lateness_ns: u64,
    /// Part of that time in which the loop was still computing, ns.
    computing_past_deadline_ns: u64,
    /// Duration of that computation since the previous wake-up, ns.
    computation_ns: u64,
}

/// Returns the cause of a late wake-up: the first cause that explains at least half of the lateness. `growth`: growth
/// of the counters since the last read; `previous`: cause of the previous wake-up if that was late.
///
/// Throttling by a cgroup is run-queue delay too, but the kernel may not count it as such. Run-queue delay is
/// tested before own work, because a preempted thread computes for longer. Steal time is tested last of the
/// counters, because it is coarse. A computation shorter than a period that is still in progress, or has missed
/// its deadline, only began late: it has the cause of the previous wake-up.
fn find_cause(
    late: LateWakeUp,
    growth: KernelCounters,
    period_ns: u64,
    previous: Option<LatenessCause>,
) -> LatenessCause {
    let inherited_cause = previous.filter(|_| late.computation_ns < period_ns);
    if let Some(previous) = inherited_cause.filter(|_| is_on_time(late.lateness_ns, period_ns)) {
        return previous;
    }
    let explains = |ns: u64| ns >= late.lateness_ns.div_ceil(2);
    if explains(growth.run_queue_delay_ns.max(growth.throttled_ns)) {
        LatenessCause::Core
    } else if growth.major_faults > 0
        || explains(growth.minor_faults.saturating_mul(MINOR_FAULT_MAX_NS))
    {
        LatenessCause::PageFaults
    } else if explains(growth.steal_time_ns) {
        LatenessCause::Host
    } else if explains(late.computing_past_deadline_ns) {
        inherited_cause.unwrap_or(LatenessCause::Work)
    } else {
        LatenessCause::Unknown
    }
}

impl KernelCounters {
    /// Returns the growth since `previous_counters`.
    fn growth_since(self, previous_counters: KernelCounters) -> KernelCounters {
        KernelCounters {
            run_queue_delay_ns: self
                .run_queue_delay_ns
                .saturating_sub(previous_counters.run_queue_delay_ns),
            throttled_ns: self.throttled_ns.saturating_sub(previous_counters.throttled_ns),
            steal_time_ns: self.steal_time_ns.saturating_sub(previous_counters.steal_time_ns),
            major_faults: self.major_faults.saturating_sub(previous_counters.major_faults),
            minor_faults: self.minor_faults.saturating_sub(previous_counters.minor_faults),
        }
    }
}

/// Diagnosis of the late wake-ups of one thread, from kernel counters and the times of its computations.
#[derive(Debug)]
pub struct LatenessDiagnosis {
    reader: CounterReader,
    period_ns: u64,
    last_counters: KernelCounters,
    /// Number of wake-ups on time since the last read of the counters.
    on_time_count: u32,
    previous_cause: Option<LatenessCause>,
    /// Time of the last wake-up, ns; `computation_end_ns` is the end of the computation after it.
    last_wake_up_ns: u64,
    computation_end_ns: u64,
}

impl LatenessDiagnosis {
    /// Creates a diagnosis for the calling thread, whose loop has this period, ns.
    pub fn new(period_ns: u64) -> LatenessDiagnosis {
        let reader = CounterReader::new();
        let counters = reader.read();
        let (last_wake_up_ns, computation_end_ns) = (clock::now_ns(), clock::now_ns());
        LatenessDiagnosis {
            reader,
            period_ns,
            last_counters: counters,
            on_time_count: 0,
            previous_cause: None,
            last_wake_up_ns,
            computation_end_ns,
        }
    }

    /// Returns the cause if this wake-up is late: by more than a tenth of the period, or after a missed
    /// deadline. Call it at each wake-up. It reads the counters again periodically while wake-ups are on time,
    /// and at each late one: counts before the last read cannot explain a later one.
    pub fn cause_if_late(&mut self, wake: &WakeUp, missed_deadline: bool) -> Option<LatenessCause> {
        let late = LateWakeUp {
            lateness_ns: wake.lateness_ns,
            computing_past_deadline_ns: self.computation_end_ns.saturating_sub(wake.due_ns),
            computation_ns: self.computation_end_ns.saturating_sub(self.last_wake_up_ns),
        };
        self.last_wake_up_ns = wake.due_ns + wake.lateness_ns;
        if !missed_deadline && is_on_time(late.lateness_ns, self.period_ns) {
            self.previous_cause = None;
            self.on_time_count += 1;
            if self.on_time_count == WAKE_UPS_PER_READ {
                self.read_counters();
            }
            return None;
        }
        self.on_time_count = 0;
        let previous_counters = std::mem::replace(&mut self.last_counters, self.reader.read());
        self.previous_cause = Some(find_cause(
            late,
            self.last_counters.growth_since(previous_counters),
            self.period_ns,
            self.previous_cause,
        ));
        self.previous_cause
    }

    /// Reads the counters again, at a wake-up that is not measured.
    pub fn skip_wake_up(&mut self, wake: &WakeUp) {
        self.last_wake_up_ns = wake.due_ns + wake.lateness_ns;
        self.read_counters();
    }

    /// Records the end of a computation at `now_ns`.
    pub fn record_computation_end(&mut self, now_ns: u64) {
        self.computation_end_ns = now_ns;
    }

    /// Reads the counters again, so that earlier counts explain no later wake-up.
    fn read_counters(&mut self) {
        self.last_counters = self.reader.read();
        (self.on_time_count, self.previous_cause) = (0, None);
    }
}

/// Reader of the kernel counters of the thread that created it. A counter that cannot be read counts as 0.
#[derive(Debug)]
pub struct CounterReader {
    schedstat: Option<File>,
    stat: Option<File>,
    /// `cpu.stat` of each cgroup with a limit.
    cgroup_stat_files: Vec<File>,
    ns_per_tick: u64,
}

impl CounterReader {
    /// Creates a reader for the calling thread.
    pub fn new() -> CounterReader {
        let limits = cgroup::find_limited_cgroups(Path::new("/"));
        CounterReader {
            schedstat: File::open("/proc/thread-self/schedstat").ok(),
            stat: File::open("/proc/stat").ok(),
            cgroup_stat_files: limits
                .iter()
                .filter_map(|limited| File::open(&limited.stat_path).ok())
                .collect(),
            ns_per_tick: 1_000_000_000 / clock::ticks_per_s(),
        }
    }

    /// Returns the causes that this machine cannot detect, because their counters cannot be read.
    pub fn undetectable_causes(&self) -> Vec<LatenessCause> {
        let mut buffer = [0; 160];
        let mut undetectable = Vec::new();
        let is_readable = |file: &Option<File>, buffer: &mut [u8], field_index| {
            read_number_field(file.as_ref(), buffer, field_index).is_some()
        };
        if !is_readable(&self.schedstat, &mut buffer, RUN_QUEUE_DELAY_FIELD_INDEX) {
            undetectable.push(LatenessCause::Core);
        }
        if !is_readable(&self.stat, &mut buffer, STEAL_TIME_FIELD_INDEX) {
            undetectable.push(LatenessCause::Host);
        }
        undetectable
    }

    /// Reads all counters.
    fn read(&self) -> KernelCounters {
        let mut counters = read_page_faults();
        let mut buffer = [0; 160];
        if let Some(run_queue_delay_ns) =
            read_number_field(self.schedstat.as_ref(), &mut buffer, RUN_QUEUE_DELAY_FIELD_INDEX)
        {
            counters.run_queue_delay_ns = run_queue_delay_ns;
        }
        if let Some(ticks) =
            read_number_field(self.stat.as_ref(), &mut buffer, STEAL_TIME_FIELD_INDEX)
        {
            counters.steal_time_ns = ticks.saturating_mul(self.ns_per_tick);
        }
        counters.throttled_ns =
            self.cgroup_stat_files.iter().filter_map(read_throttled_ns).max().unwrap_or(0);
        counters
    }
}

impl Default for CounterReader {
    fn default() -> CounterReader {
        CounterReader::new()
    }
}

/// Reads the number in this field of a file's first line; `None` if the field is not a number.
fn read_number_field(file: Option<&File>, buffer: &mut [u8], field_index: usize) -> Option<u64> {
    let length = file?.read_at(buffer, 0).ok()?;
    let mut rest = &buffer[..length];
    // Byte by byte, because this is half of the cost of a diagnosis.
    for _ in 0..field_index {
        let end = rest.iter().position(|&byte| byte <= b' ')?;
        let blanks = rest[end..].iter().take_while(|&&byte| byte == b' ').count();
        rest = &rest[end + blanks..];
    }
    let digits = rest.iter().map(|byte| byte.wrapping_sub(b'0')).take_while(|&digit| digit < 10);
    let value =
        |number: Option<u64>, digit| Some(number.unwrap_or(0).wrapping_mul(10) + u64::from(digit));
    digits.fold(None, value)
}

fn read_throttled_ns(stat: &File) -> Option<u64> {
    let mut buffer = [0; 1024];
    let length = stat.read_at(&mut buffer, 0).ok()?;
    cgroup::parse_throttled_ns(str::from_utf8(&buffer[..length]).ok()?)
}

fn read_page_faults() -> KernelCounters {
    let mut usage = std::mem::MaybeUninit::<libc::rusage>::zeroed();
    // SAFETY: it writes all of `usage`, which holds a valid value before.
    let usage = unsafe {
        libc::getrusage(libc::RUSAGE_THREAD, usage.as_mut_ptr());
        usage.assume_init()
    };
    KernelCounters {
        major_faults: usage.ru_majflt as u64,
        minor_faults: usage.ru_minflt as u64,
        ..KernelCounters::default()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const NS_PER_MS: u64 = 1_000_000;
    /// Size of an allocation that no allocator keeps for reuse, bytes, so its pages are new.
    const FRESH_ALLOCATION_BYTES: usize = 40 << 20;
    /// Minimum number of page faults that it causes, even with pages of 2 MB.
    const PAGE_FAULTS_MIN: u64 = 10;

    fn lateness_of(lateness_ns: u64, computing_past_deadline_ns: u64) -> LateWakeUp {
        LateWakeUp { lateness_ns, computing_past_deadline_ns, computation_ns: 10 * NS_PER_MS }
    }

    /// Numbers measured on an Intel Xeon with two cores, a virtual machine, Linux 6.18; steal time and disk
    /// access are made up.
    #[test]
    fn recorded_late_wake_ups_have_their_causes() {
        // Behind, at work, waited, held up, stolen, all in ns; page faults with and without disk access.
        for (what, numbers, expected) in [
            ("higher priority", [5_369_528, 0, 5_353_826, 0, 0, 0, 0], LatenessCause::Core),
            (
                "a quota",
                [54_072_410, 54_042_576, 56_006_003, 51_644_774, 0, 0, 0],
                LatenessCause::Core,
            ),
            (
                "a quota, not counted as waiting",
                [59_053_375, 0, 0, 55_658_137, 0, 0, 0],
                LatenessCause::Core,
            ),
            (
                "fresh memory",
                [3_108_277, 3_073_230, 135_713, 0, 0, 0, 6_321],
                LatenessCause::PageFaults,
            ),
            (
                "memory paged out",
                [3 * NS_PER_MS, 2 * NS_PER_MS, 40_000, 0, 0, 5, 9],
                LatenessCause::PageFaults,
            ),
            (
                "a busy host",
                [12 * NS_PER_MS, 0, 80_000, 0, 10 * NS_PER_MS, 0, 0],
                LatenessCause::Host,
            ),
            (
                "a law that overruns",
                [3_083_707, 3_047_666, 139_081, 0, 0, 0, 0],
                LatenessCause::Work,
            ),
            ("stopped by a stranger", [7_833_855, 0, 27_142, 0, 0, 0, 0], LatenessCause::Unknown),
            ("a timer that fired late", [NS_PER_MS, 0, 11_000, 0, 0, 0, 0], LatenessCause::Unknown),
        ] {
            let [
                lateness_ns,
                computing_past_deadline_ns,
                run_queue_delay_ns,
                throttled_ns,
                steal_time_ns,
                major_faults,
                minor_faults,
            ] = numbers;
            let growth = KernelCounters {
                run_queue_delay_ns,
                throttled_ns,
                steal_time_ns,
                major_faults,
                minor_faults,
            };
            assert_eq!(
                find_cause(
                    lateness_of(lateness_ns, computing_past_deadline_ns),
                    growth,
                    5 * NS_PER_MS,
                    None
                ),
                expected,
                "{what}"
            );
        }
    }

    #[test]
    fn short_work_inherits_the_cause_of_its_late_start() {
        let short_work = LateWakeUp {
            computation_ns: 4 * NS_PER_MS,
            ..lateness_of(2 * NS_PER_MS, 2 * NS_PER_MS)
        };
        let long_work = LateWakeUp { computation_ns: 12 * NS_PER_MS, ..short_work };
        let on_time = LateWakeUp {
            lateness_ns: NS_PER_MS / 100,
            computing_past_deadline_ns: 0,
            ..short_work
        };
        let cause =
            |late, previous| find_cause(late, KernelCounters::default(), 10 * NS_PER_MS, previous);
        assert_eq!(cause(short_work, Some(LatenessCause::Core)), LatenessCause::Core);
        assert_eq!(
            cause(on_time, Some(LatenessCause::Core)),
            LatenessCause::Core,
            "it missed its deadline"
        );
        assert_eq!(cause(on_time, None), LatenessCause::Unknown);
        assert_eq!(cause(short_work, None), LatenessCause::Work);
        assert_eq!(cause(long_work, Some(LatenessCause::Core)), LatenessCause::Work);
    }

    fn wake_up_late_by(lateness_ns: u64) -> WakeUp {
        WakeUp { due_ns: clock::now_ns(), lateness_ns }
    }

    #[test]
    fn wake_up_is_late_after_a_tenth_of_the_period_or_a_miss() {
        let mut diagnosis = LatenessDiagnosis::new(10 * NS_PER_MS);
        let mut is_late = |ns, missed_deadline| {
            diagnosis.cause_if_late(&wake_up_late_by(ns), missed_deadline).is_some()
        };
        assert_eq!(
            [is_late(NS_PER_MS, false), is_late(NS_PER_MS, true), is_late(NS_PER_MS + 1, false)],
            [false, true, true]
        );
    }

    #[test]
    fn counts_of_an_overrun_remain_for_the_late_wake_up() {
        let mut diagnosis = LatenessDiagnosis::new(10 * NS_PER_MS);
        let allocate = || drop(std::hint::black_box(vec![1_u8; FRESH_ALLOCATION_BYTES]));
        let faults = |diagnosis: &LatenessDiagnosis| {
            diagnosis.reader.read().growth_since(diagnosis.last_counters).minor_faults
        };
        allocate();
        assert!(faults(&diagnosis) > PAGE_FAULTS_MIN);
        assert!(diagnosis.cause_if_late(&wake_up_late_by(5 * NS_PER_MS), false).is_some());
        assert!(faults(&diagnosis) < PAGE_FAULTS_MIN, "they were looked at when it was late");
        allocate();
        for _ in 1..WAKE_UPS_PER_READ {
            assert_eq!(diagnosis.cause_if_late(&wake_up_late_by(0), false), None);
        }
        assert!(faults(&diagnosis) > PAGE_FAULTS_MIN, "not yet");
        assert_eq!(diagnosis.cause_if_late(&wake_up_late_by(0), false), None);
        assert!(faults(&diagnosis) < PAGE_FAULTS_MIN, "they were looked at when it was on time");
    }

    #[test]
    fn unreadable_counters_explain_nothing() {
        let reader = CounterReader {
            schedstat: None,
            stat: None,
            cgroup_stat_files: Vec::new(),
            ns_per_tick: 1,
        };
        let now = reader.read();
        assert_eq!((now.run_queue_delay_ns, now.steal_time_ns), (0, 0));
        assert_eq!(reader.undetectable_causes(), [LatenessCause::Core, LatenessCause::Host]);
    }

    #[test]
    fn field_of_the_first_line_is_read() {
        let mut file = tempfile::tempfile().unwrap();
        std::io::Write::write_all(&mut file, b"cpu  10 20 30\ncpu0 1 2 3\n").unwrap();
        let mut buffer = [0; 32];
        assert_eq!(read_number_field(Some(&file), &mut buffer, 2), Some(20));
        assert_eq!(read_number_field(Some(&file), &mut buffer, 0), None, "a word");
        assert_eq!(read_number_field(Some(&file), &mut buffer, 4), None, "another line's");
        assert_eq!(read_number_field(None, &mut buffer, 1), None);
    }
}
