//! Time of the last resumption (SIGCONT) by the parent process, after a planned freeze.
//!
//! A stop by any other process is not planned: lateness after it counts as lateness.

use std::io;
use std::sync::atomic::{AtomicU64, Ordering};

use crate::machine::clock;

/// CLOCK_MONOTONIC time of the last SIGCONT sent by the parent, ns; 0 if there was none.
static LAST_THAW_NS: AtomicU64 = AtomicU64::new(0);

/// Listener for planned thaws of this process.
#[derive(Debug)]
pub struct ThawListener(());

impl ThawListener {
    /// Starts listening for SIGCONT.
    ///
    /// # Errors
    ///
    /// The kernel refuses the handler.
    pub fn start() -> io::Result<ThawListener> {
        let handler: extern "C" fn(_, _, _) = on_continue;
        // SAFETY: all-zero bytes are a valid value of this plain struct: no flags, an empty mask.
        let mut action: libc::sigaction = unsafe { std::mem::zeroed() };
        action.sa_sigaction = handler as libc::sighandler_t;
        action.sa_flags = libc::SA_SIGINFO | libc::SA_RESTART;
        // SAFETY: the handler has the signature that SA_SIGINFO requires, and does only what a signal handler
        // may: it reads the clock, gets the parent's process id and stores a number.
        match unsafe { libc::sigaction(libc::SIGCONT, &action, std::ptr::null_mut()) } {
            0 => Ok(ThawListener(())),
            _ => Err(io::Error::last_os_error()),
        }
    }

    /// Returns the CLOCK_MONOTONIC time of the last planned thaw, ns; 0 if there was none.
    pub fn last_thaw_ns(&self) -> u64 {
        LAST_THAW_NS.load(Ordering::Relaxed)
    }
}

extern "C" fn on_continue(
    _signal: libc::c_int,
    info: *mut libc::siginfo_t,
    _context: *mut libc::c_void,
) {
    // SAFETY: with SA_SIGINFO the kernel passes a valid pointer; `kill` fills in the sender.
    let sender = unsafe { (*info).si_pid() };
    // SAFETY: the call has no preconditions.
    if sender == unsafe { libc::getppid() } {
        LAST_THAW_NS.store(clock::now_ns(), Ordering::Relaxed);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sigcont_from_non_parent_is_not_a_planned_thaw() {
        let listener = ThawListener::start().unwrap();
        signal_hook::low_level::raise(libc::SIGCONT).unwrap();
        assert_eq!(listener.last_thaw_ns(), 0);
    }
}
