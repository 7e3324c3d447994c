//! Resource usage of processes, as counted by the kernel.

use std::io;
use std::mem::MaybeUninit;
use std::os::fd::{AsRawFd, BorrowedFd};

pub use crate::metrics::summary::Usage;

/// Returns the resource usage of a child that has exited, without reaping it; `None` while it runs.
pub fn read_exited_child(pidfd: BorrowedFd<'_>) -> io::Result<Option<Usage>> {
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
    // SAFETY: all zeros is a valid value of either type, and the kernel writes valid values. The call succeeded, so
    // the pid is set; it is 0 if the child has not exited.
    let (usage, dead) = unsafe { (usage.assume_init(), info.assume_init().si_pid() != 0) };
    Ok(dead.then(|| convert_rusage(&usage)))
}

/// Returns the resource usage of this process up to now.
pub fn read_this_process() -> Usage {
    read_rusage(libc::RUSAGE_SELF)
}

/// Returns the resource usage of this thread up to now.
pub fn read_this_thread() -> Usage {
    read_rusage(libc::RUSAGE_THREAD)
}

/// Returns the resource usage of all reaped children and their reaped descendants.
pub fn read_reaped_children() -> Usage {
    read_rusage(libc::RUSAGE_CHILDREN)
}

fn read_rusage(processes: libc::c_int) -> Usage {
    let mut usage = MaybeUninit::<libc::rusage>::zeroed();
    // SAFETY: the pointer is to memory of the right type; all zeros is a value of it.
    let usage = unsafe {
        libc::getrusage(processes, usage.as_mut_ptr());
        usage.assume_init()
    };
    convert_rusage(&usage)
}

fn convert_rusage(usage: &libc::rusage) -> Usage {
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
