//! Scheduling: SCHED_FIFO, SCHED_IDLE, time slices, locked memory, and the out-of-memory score.

use std::io;

use rustix::mm::{MlockAllFlags, mlockall};
use rustix::process::{Resource, getrlimit};
use rustix::thread::{CapabilitySet, capabilities};

/// Priority under SCHED_FIFO: above every ordinary process, below the threads of the kernel (50 and more) and
/// other real-time processes.
pub const REALTIME_PRIORITY: i32 = 10;
/// File with the CPU time of each second that real-time processes may use, us; -1 for no limit.
pub const REALTIME_RUNTIME_PATH: &str = "/proc/sys/kernel/sched_rt_runtime_us";

/// Reason why a process keeps its ordinary priority.
#[derive(Debug, thiserror::Error)]
pub enum PriorityError {
    /// The kernel has no limit: a real-time process in an endless loop would take its core from all others.
    #[error(
        "{REALTIME_RUNTIME_PATH} is {0:?}, expected a positive number: without that limit a real-time process that spins starves the machine; set it to 950000"
    )]
    NoRuntimeLimit(String),
    /// The kernel does not permit it for this user.
    #[error(
        "the kernel does not permit SCHED_FIFO at priority {REALTIME_PRIORITY}: {0}; it needs root, CAP_SYS_NICE, or an rtprio of {REALTIME_PRIORITY} in /etc/security/limits.conf"
    )]
    Refused(io::Error),
}

/// Gives the calling thread SCHED_FIFO priority. Threads that it starts later inherit it.
///
/// # Errors
///
/// The kernel has no limit for real-time processes, or does not permit the priority.
pub fn take_realtime_priority() -> Result<(), PriorityError> {
    let runtime = std::fs::read_to_string(REALTIME_RUNTIME_PATH).unwrap_or_default();
    if !runtime.trim().parse::<i64>().is_ok_and(|us| us > 0) {
        return Err(PriorityError::NoRuntimeLimit(runtime.trim().into()));
    }
    let parameters = libc::sched_param { sched_priority: REALTIME_PRIORITY };
    // SAFETY: a plain system call that reads `parameters`; 0 is the calling thread.
    match unsafe { libc::sched_setscheduler(0, libc::SCHED_FIFO, &parameters) } {
        0 => Ok(()),
        _ => Err(PriorityError::Refused(io::Error::last_os_error())),
    }
}

/// Checks whether [`take_realtime_priority`] would succeed in processes that this one starts.
pub fn check_realtime_priority() -> Result<(), PriorityError> {
    std::thread::scope(|scope| {
        let thread = std::thread::Builder::new().spawn_scoped(scope, take_realtime_priority);
        thread.map_err(PriorityError::Refused)?.join().expect("it does not panic")
    })
}

/// Returns whether the process may lock all memory, without a limit. With a limit, a later mapping could fail.
pub fn may_lock_memory() -> bool {
    let is_unlimited = getrlimit(Resource::Memlock).current.is_none();
    is_unlimited
        || capabilities(None).is_ok_and(|sets| sets.effective.contains(CapabilitySet::IPC_LOCK))
}

/// File with the adjustment of this process's out-of-memory score, from -1000 to 1000.
const OUT_OF_MEMORY_SCORE_PATH: &str = "/proc/self/oom_score_adj";
/// Value added to the score of a child: it corresponds to half of all memory. A supervisor that runs a campaign
/// has children and grandchildren.
const CHILD_OUT_OF_MEMORY_SCORE: i32 = 500;

/// Makes the kernel end this process before its parent when a machine or control group runs out of memory: a
/// surviving supervisor can report the cause. Does nothing if the kernel does not permit it.
pub fn raise_out_of_memory_score() {
    let score = std::fs::read_to_string(OUT_OF_MEMORY_SCORE_PATH).ok();
    if let Some(score) = score.and_then(|text| text.trim().parse::<i32>().ok()) {
        let _ = std::fs::write(
            OUT_OF_MEMORY_SCORE_PATH,
            (score + CHILD_OUT_OF_MEMORY_SCORE).min(1000).to_string(),
        );
    }
}

/// Takes SCHED_FIFO priority and locks all memory, so that the process waits for no page. Logs a warning and
/// continues if the kernel refuses; the supervisor has reported it too.
pub fn apply_realtime_priority() {
    if let Err(error) = take_realtime_priority() {
        tracing::warn!("ordinary priority: {error}");
    }
    if !may_lock_memory() {
        tracing::warn!(
            "memory is not locked: RLIMIT_MEMLOCK limits it; raise it with `ulimit -l unlimited`"
        );
    } else if let Err(error) = mlockall(MlockAllFlags::CURRENT | MlockAllFlags::FUTURE) {
        tracing::warn!(%error, "memory is not locked");
    }
}

/// Length of the time slice that a thread requests from the scheduler. A thread with a shorter slice is scheduled
/// earlier.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum TimeSlice {
    /// The minimum of Linux, 0.1 ms: more than a control loop computes, and scheduled soonest.
    Short,
    /// 0.4 ms, for the plant: more than it computes at once, so that it is not interrupted at the end of a slice, and
    /// longer than that of robots, which run first.
    Medium,
    /// The default of the kernel.
    KernelDefault,
    /// The maximum of Linux, 100 ms: other threads run first, and this one works while they wait. Threads that it
    /// starts have the default slice.
    Long,
}

impl TimeSlice {
    fn length_ns(self) -> u64 {
        match self {
            TimeSlice::Short => 100_000,
            TimeSlice::Medium => 400_000,
            TimeSlice::KernelDefault => 0,
            TimeSlice::Long => 100_000_000,
        }
    }
}

/// Requests a time slice for the calling thread, if it has ordinary priority. Linux before 6.12 ignores the
/// request.
pub fn request_time_slice(slice: TimeSlice) {
    request_thread_time_slice(0, slice);
}

/// Requests a time slice for all threads of this process.
pub fn request_time_slice_of_all_threads(slice: TimeSlice) {
    let threads = std::fs::read_dir("/proc/self/task").into_iter().flatten().flatten();
    let ids = threads.filter_map(|thread| thread.file_name().to_str()?.parse().ok());
    ids.for_each(|id| request_thread_time_slice(id, slice));
}

/// Requests a time slice for a thread of this process; 0 is the calling thread.
fn request_thread_time_slice(thread: libc::pid_t, slice: TimeSlice) {
    // SAFETY: all-zero bytes are a valid value of this plain struct.
    let mut attributes: libc::sched_attr = unsafe { std::mem::zeroed() };
    let size = size_of_val(&attributes) as u32;
    // SAFETY: writes at most `size` bytes to `attributes`.
    let result =
        unsafe { libc::syscall(libc::SYS_sched_getattr, thread, &mut attributes, size, 0) };
    let is_ordinary = attributes.sched_policy == libc::SCHED_OTHER as u32;
    // Threads started by one with a negative nice value would lose it by the flag set below.
    if result != 0 || !is_ordinary || (slice == TimeSlice::Long && attributes.sched_nice < 0) {
        return;
    }
    attributes.sched_runtime = slice.length_ns();
    if slice == TimeSlice::Long {
        attributes.sched_flags |= libc::SCHED_FLAG_RESET_ON_FORK as u64;
    }
    // SAFETY: reads `attributes`, which holds its own size.
    if unsafe { libc::syscall(libc::SYS_sched_setattr, thread, &attributes, 0) } != 0 {
        let error = io::Error::last_os_error();
        tracing::debug!(%error, "cannot set the time slice");
    }
}

/// Sets SCHED_IDLE for the calling thread: it runs only while no other thread needs its core.
pub fn set_idle_priority() -> io::Result<()> {
    let parameters = libc::sched_param { sched_priority: 0 };
    // SAFETY: a plain system call that reads `parameters`; 0 is the calling thread.
    match unsafe { libc::sched_setscheduler(0, libc::SCHED_IDLE, &parameters) } {
        0 => Ok(()),
        _ => Err(io::Error::last_os_error()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Returns the length of this thread's time slice, ns, as the kernel reports it; `None` if it does not.
    fn time_slice_ns() -> Option<u64> {
        // SAFETY: all-zero bytes are a valid value of this plain struct, of which the call writes at most `size`
        // bytes.
        let (result, attributes) = unsafe {
            let mut attributes: libc::sched_attr = std::mem::zeroed();
            let size = size_of_val(&attributes) as u32;
            (libc::syscall(libc::SYS_sched_getattr, 0, &mut attributes, size, 0), attributes)
        };
        (result == 0).then_some(attributes.sched_runtime)
    }

    #[test]
    fn time_slice_can_be_changed_and_is_not_inherited() {
        let slice_of_new_thread = || std::thread::spawn(time_slice_ns).join().unwrap();
        let thread = std::thread::spawn(move || {
            let default_slice = time_slice_ns();
            request_time_slice(TimeSlice::Long);
            let (long_slice, inherited_slice) = (time_slice_ns(), slice_of_new_thread());
            request_time_slice(TimeSlice::KernelDefault);
            [default_slice, long_slice, inherited_slice, time_slice_ns()]
        });
        let [default_slice, long_slice, inherited_slice, restored_slice] = thread.join().unwrap();
        assert_eq!([inherited_slice, restored_slice], [default_slice; 2]);
        // Linux before 6.12 reports 0 for all threads.
        assert!(
            long_slice > default_slice || long_slice.is_none_or(|ns| ns == 0),
            "{long_slice:?}"
        );
    }

    #[test]
    fn priority_check_leaves_the_caller_unchanged() {
        // SAFETY: plain system calls about the calling thread.
        let policy = || unsafe { libc::sched_getscheduler(0) };
        let before = policy();
        let check = check_realtime_priority();
        assert_eq!(policy(), before);
        let then = std::thread::spawn(move || (take_realtime_priority().is_ok(), policy()));
        let (is_granted, policy) = then.join().unwrap();
        assert_eq!(is_granted, check.is_ok());
        assert_eq!(policy == libc::SCHED_FIFO, is_granted);
    }
}
