//! Signal state that a process inherits from its parent: ignored signals and the mask of blocked ones.

use std::io;

/// Signals that stay ignored if the parent ignored them. SIGHUP: the run was started under `nohup`. SIGPIPE: the
/// Rust runtime ignores it. The others belong to the shell's job control.
const PRESERVED_IGNORED_SIGNALS: [libc::c_int; 6] =
    [libc::SIGHUP, libc::SIGPIPE, libc::SIGQUIT, libc::SIGTSTP, libc::SIGTTIN, libc::SIGTTOU];

/// Restores the default action of every signal that the parent ignored (except those that `nohup` and job control
/// ignore on purpose), and unblocks all signals. A supervisor that inherits an ignored SIGCHLD loses the exit status of
/// its children, and one that inherits a blocked SIGTERM cannot be ended by it. Call it before the process has threads
/// or signal handlers; programs that this process becomes inherit the result.
///
/// # Errors
/// The kernel refuses to change the state.
pub fn reset_signals() -> io::Result<()> {
    for signal in 1..=libc::SIGRTMAX() {
        if PRESERVED_IGNORED_SIGNALS.contains(&signal) || !is_ignored(signal).unwrap_or(false) {
            continue; // the C library has a few signals of its own, which it does not show
        }
        // SAFETY: SIG_DFL is a valid disposition, and no handler is replaced, because the signal was ignored.
        if unsafe { libc::signal(signal, libc::SIG_DFL) } == libc::SIG_ERR {
            return Err(io::Error::last_os_error());
        }
    }
    // SAFETY: all-zero bytes are a valid value of this plain type.
    let mut none: libc::sigset_t = unsafe { std::mem::zeroed() };
    // SAFETY: writes `none`, then reads it; the old mask is not requested.
    let code = unsafe {
        libc::sigemptyset(&mut none);
        libc::pthread_sigmask(libc::SIG_SETMASK, &none, std::ptr::null_mut())
    };
    if code == 0 { Ok(()) } else { Err(io::Error::from_raw_os_error(code)) }
}

/// Returns whether the process ignores `signal`.
///
/// # Errors
///
/// The signal does not exist.
pub(super) fn is_ignored(signal: libc::c_int) -> io::Result<bool> {
    // SAFETY: all-zero bytes are a valid value of this plain struct.
    let mut action: libc::sigaction = unsafe { std::mem::zeroed() };
    // SAFETY: writes `action`, and changes nothing.
    match unsafe { libc::sigaction(signal, std::ptr::null(), &mut action) } {
        0 => Ok(action.sa_sigaction == libc::SIG_IGN),
        _ => Err(io::Error::last_os_error()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ignored_signals_of_the_parent_are_reset() {
        // Signals that no other test of this process uses.
        let (reset, unchanged) = (libc::SIGWINCH, libc::SIGTTOU);
        for signal in [reset, unchanged] {
            // SAFETY: an ignored signal affects no code of this process.
            unsafe { libc::signal(signal, libc::SIG_IGN) };
            assert!(is_ignored(signal).unwrap());
        }
        reset_signals().unwrap();
        assert_eq!([reset, unchanged].map(|signal| is_ignored(signal).unwrap()), [false, true]);
    }
}
