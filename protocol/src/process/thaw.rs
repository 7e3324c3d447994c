//! When a process was last let go on by the process that started it, after a freeze on purpose.
//!
//! A stop by anybody else is not on purpose: whoever is late after it was late.

use std::io;
use std::sync::atomic::{AtomicU64, Ordering};

use crate::clock;

/// CLOCK_MONOTONIC of the last SIGCONT of the parent's, ns; 0 for none yet.
static THAWED_NS: AtomicU64 = AtomicU64::new(0);

/// What a process knows of its own freezes.
#[derive(Debug)]
pub struct Thaws(());

impl Thaws {
    /// Listens for SIGCONT from here on. It interrupts waits, as the freeze has done anyhow.
    pub fn watch() -> io::Result<Thaws> {
        let handler: extern "C" fn(_, _, _) = on_continue;
        // SAFETY: zeros are a value of this plain struct: no flags, an empty mask.
        let mut action: libc::sigaction = unsafe { std::mem::zeroed() };
        action.sa_sigaction = handler as libc::sighandler_t;
        action.sa_flags = libc::SA_SIGINFO | libc::SA_RESTART;
        // SAFETY: the handler has the form that SA_SIGINFO asks for, and does only what a handler
        // may: it reads the clock, asks for the parent's number and stores a number.
        match unsafe { libc::sigaction(libc::SIGCONT, &action, std::ptr::null_mut()) } {
            0 => Ok(Thaws(())),
            _ => Err(io::Error::last_os_error()),
        }
    }

    /// CLOCK_MONOTONIC when it was last let go on, ns; 0 if it never was.
    pub fn last_ns(&self) -> u64 {
        THAWED_NS.load(Ordering::Relaxed)
    }
}

extern "C" fn on_continue(
    _signal: libc::c_int,
    info: *mut libc::siginfo_t,
    _context: *mut libc::c_void,
) {
    // SAFETY: under SA_SIGINFO the kernel passes a valid one; a kill fills in the sender.
    let sender = unsafe { (*info).si_pid() };
    // SAFETY: it has no conditions.
    if sender == unsafe { libc::getppid() } {
        THAWED_NS.store(clock::now_ns(), Ordering::Relaxed);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn who_is_let_go_on_by_anybody_but_its_parent_was_not_frozen_on_purpose() {
        let thaws = Thaws::watch().unwrap();
        signal_hook::low_level::raise(libc::SIGCONT).unwrap();
        assert_eq!(thaws.last_ns(), 0);
    }
}
