//! Whether a process was asked to stop: by SIGTERM, SIGINT, or SIGHUP when its terminal is gone.

use std::io;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

use signal_hook::consts::{SIGHUP, SIGINT, SIGTERM};

use super::exit;

/// Becomes true once the process was asked to stop.
#[derive(Debug, Clone, Default)]
pub struct Stop(Arc<AtomicBool>);

impl Stop {
    /// A flag that these signals set. Waits they interrupt return early.
    pub fn on_signals() -> io::Result<Stop> {
        let stop = Stop::default();
        stop.listen()?;
        Ok(stop)
    }

    /// The same, for a process that a person waits for: a second signal ends it at once. Not a
    /// SIGHUP, which nobody presses: of one terminal that closes, shell and kernel both send it.
    pub fn on_signals_twice_at_once() -> io::Result<Stop> {
        let stop = Stop::default();
        // Before the flag is set by the same signal.
        for signal in [SIGTERM, SIGINT] {
            let code = i32::from(exit::INTERRUPTED);
            signal_hook::flag::register_conditional_shutdown(signal, code, stop.0.clone())?;
        }
        stop.listen()?;
        Ok(stop)
    }

    fn listen(&self) -> io::Result<()> {
        for signal in [SIGTERM, SIGINT] {
            signal_hook::flag::register(signal, self.0.clone())?;
        }
        // Under `nohup` it goes on without its terminal.
        if !is_ignored(SIGHUP)? {
            signal_hook::flag::register(SIGHUP, self.0.clone())?;
        }
        Ok(())
    }

    /// Asks as a signal does: for a deadline of this process's own.
    pub fn request(&self) {
        self.0.store(true, Ordering::Relaxed);
    }

    /// Whether the process was asked to stop.
    pub fn requested(&self) -> bool {
        self.0.load(Ordering::Relaxed)
    }
}

/// Whether whoever started this process had it ignore a signal.
fn is_ignored(signal: i32) -> io::Result<bool> {
    // SAFETY: zeros are a value of this plain struct.
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
    fn each_of_the_signals_requests_a_stop() {
        for signal in [SIGTERM, SIGINT, SIGHUP] {
            if is_ignored(signal).unwrap() {
                continue; // these tests run under `nohup`
            }
            let stop = Stop::on_signals().unwrap();
            assert!(!stop.requested());
            signal_hook::low_level::raise(signal).unwrap();
            assert!(stop.clone().requested(), "{signal}");
        }
    }

    #[test]
    fn who_was_told_to_ignore_a_signal_is_known() {
        let unused = libc::SIGUSR2;
        assert!(!is_ignored(unused).unwrap());
        // SAFETY: nothing in this process uses that signal.
        unsafe { libc::signal(unused, libc::SIG_IGN) };
        assert!(is_ignored(unused).unwrap());
    }
}
