//! What a process took from the machine, as the kernel counted it up to its end.

use std::io;
use std::mem::MaybeUninit;
use std::ops::AddAssign;
use std::os::fd::{AsRawFd, BorrowedFd};

use metrics::summary::ProcessUsage;

/// What a process took, or several one after the other.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct Usage {
    /// Processor time in user mode, s.
    pub user_s: f64,
    /// Processor time in the kernel, s.
    pub system_s: f64,
    /// How often it waited for something.
    pub voluntary_switches: u64,
    /// How often its processor was taken away.
    pub involuntary_switches: u64,
    /// Page faults met without reading a disk.
    pub minor_faults: u64,
    /// Page faults that read a disk.
    pub major_faults: u64,
}

impl AddAssign for Usage {
    fn add_assign(&mut self, other: Usage) {
        self.user_s += other.user_s;
        self.system_s += other.system_s;
        self.voluntary_switches += other.voluntary_switches;
        self.involuntary_switches += other.involuntary_switches;
        self.minor_faults += other.minor_faults;
        self.major_faults += other.major_faults;
    }
}

impl From<libc::rusage> for Usage {
    fn from(usage: libc::rusage) -> Usage {
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
}

impl Usage {
    /// The same, for the summary.
    pub(crate) fn of_process(&self, name: &str, starts: u64) -> ProcessUsage {
        let &Usage { user_s, system_s, .. } = self;
        let &Usage { voluntary_switches, involuntary_switches, minor_faults, major_faults, .. } =
            self;
        ProcessUsage {
            name: name.into(),
            starts,
            user_s,
            system_s,
            voluntary_switches,
            involuntary_switches,
            minor_faults,
            major_faults,
        }
    }

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
        Ok(dead.then(|| usage.into()))
    }

    /// What this process took up to now.
    pub fn of_this_process() -> Usage {
        let mut usage = MaybeUninit::<libc::rusage>::zeroed();
        // SAFETY: the pointer is to memory of the right type; all zeros is a value of it.
        let usage = unsafe {
            libc::getrusage(libc::RUSAGE_SELF, usage.as_mut_ptr());
            usage.assume_init()
        };
        usage.into()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use rustix::process::{Pid, PidfdFlags, pidfd_open};
    use std::os::fd::AsFd;
    use std::process::Command;

    #[test]
    fn what_a_killed_process_took_is_known_before_it_is_reaped_and_it_still_can_be() {
        let mut child = Command::new("sh").arg("-c").arg("while :; do :; done").spawn().unwrap();
        let pidfd = pidfd_open(Pid::from_child(&child), PidfdFlags::empty()).unwrap();
        assert_eq!(Usage::of_dead(pidfd.as_fd()).unwrap(), None, "it lives");
        std::thread::sleep(std::time::Duration::from_millis(50));
        child.kill().unwrap();
        let usage = loop {
            if let Some(usage) = Usage::of_dead(pidfd.as_fd()).unwrap() {
                break usage;
            }
            std::thread::yield_now();
        };
        assert!(usage.user_s + usage.system_s > 0.0 && usage.minor_faults > 0, "{usage:?}");
        assert!(!child.wait().unwrap().success());
        assert!(Usage::of_dead(pidfd.as_fd()).is_err(), "reaped");
    }
}
