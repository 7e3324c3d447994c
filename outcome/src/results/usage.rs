//! What a process took from the machine, as the kernel counted it up to its end.

use std::io;
use std::mem::MaybeUninit;
use std::os::fd::{AsRawFd, BorrowedFd};

pub use crate::metrics::summary::Usage;

/// What a child took, once it is dead; it is not reaped. `None` while it lives.
pub fn of_dead(pidfd: BorrowedFd<'_>) -> io::Result<Option<Usage>> {
    let mut usage = MaybeUninit::<libc::rusage>::zeroed();
    let mut info = MaybeUninit::<libc::siginfo_t>::zeroed();
    // SAFETY: both pointers are to memory of the right types that outlives the call. The C
    // library's waitid has no fifth argument; the system call fills it, also under WNOWAIT.
    let result = unsafe {
        libc::syscall(
            libc::SYS_waitid,
            libc::P_PIDFD,
            pidfd.as_raw_fd(),
            info.as_mut_ptr(),
            libc::WEXITED | libc::WNOHANG | libc::WNOWAIT,
            usage.as_mut_ptr(),
        )
    };
    if result != 0 {
        return Err(io::Error::last_os_error());
    }
    // SAFETY: all zeros is a value of either type, and the kernel writes values only. The pid
    // is there: the call succeeded, and it is 0 if nobody died.
    let (usage, dead) = unsafe { (usage.assume_init(), info.assume_init().si_pid() != 0) };
    Ok(dead.then(|| of_rusage(&usage)))
}

/// What this process took up to now.
pub fn of_this_process() -> Usage {
    of(libc::RUSAGE_SELF)
}

/// What this thread took up to now.
pub fn of_this_thread() -> Usage {
    of(libc::RUSAGE_THREAD)
}

/// What all children that were reaped took, with those that they reaped.
pub fn of_ended_children() -> Usage {
    of(libc::RUSAGE_CHILDREN)
}

fn of(whom: libc::c_int) -> Usage {
    let mut usage = MaybeUninit::<libc::rusage>::zeroed();
    // SAFETY: the pointer is to memory of the right type; all zeros is a value of it.
    let usage = unsafe {
        libc::getrusage(whom, usage.as_mut_ptr());
        usage.assume_init()
    };
    of_rusage(&usage)
}

fn of_rusage(usage: &libc::rusage) -> Usage {
    let seconds = |time: libc::timeval| time.tv_sec as f64 + time.tv_usec as f64 / 1e6;
    Usage {
        user_s: seconds(usage.ru_utime),
        system_s: seconds(usage.ru_stime),
        voluntary_switches: usage.ru_nvcsw as u64,
        involuntary_switches: usage.ru_nivcsw as u64,
        minor_faults: usage.ru_minflt as u64,
        major_faults: usage.ru_majflt as u64,
    }
}
