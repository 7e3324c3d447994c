//! Stop requests by signals: SIGTERM, SIGINT, and SIGHUP when the terminal is closed; for a supervisor also
//! SIGUSR1 and SIGUSR2.

use std::io;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

use signal_hook::consts::{SIGHUP, SIGINT, SIGTERM, SIGUSR1, SIGUSR2};

use super::exit;
use super::signals::is_ignored;

/// Signals that end a run. Batch systems send SIGUSR1 or SIGUSR2 shortly before a job's time limit.
const RUN_ENDING_SIGNALS: [i32; 4] = [SIGTERM, SIGINT, SIGUSR1, SIGUSR2];

/// Flag that is set once a stop of the process is requested.
#[derive(Debug, Clone, Default)]
pub struct StopFlag(Arc<AtomicBool>);

impl StopFlag {
    /// Returns a flag that SIGTERM, SIGINT and SIGHUP set. Waits that they interrupt return early.
    pub fn for_termination_signals() -> io::Result<StopFlag> {
        let stop = StopFlag::default();
        stop.install_handlers(&[SIGTERM, SIGINT])?;
        Ok(stop)
    }

    /// Returns a flag that the signals which end a run set, including SIGUSR1 and SIGUSR2. A second signal ends
    /// the process at once, except SIGHUP: when a terminal closes, shell and kernel both send it.
    pub fn for_run_ending_signals() -> io::Result<StopFlag> {
        let stop = StopFlag::default();
        // Registered before the handler that sets the flag, so that the first signal does not end the process.
        for signal in RUN_ENDING_SIGNALS {
            let code = i32::from(exit::INTERRUPTED);
            signal_hook::flag::register_conditional_shutdown(signal, code, stop.0.clone())?;
        }
        stop.install_handlers(&RUN_ENDING_SIGNALS)?;
        Ok(stop)
    }

    fn install_handlers(&self, signals: &[i32]) -> io::Result<()> {
        for &signal in signals {
            signal_hook::flag::register(signal, self.0.clone())?;
        }
        // Under `nohup` the process continues without its terminal.
        if !is_ignored(SIGHUP)? {
            signal_hook::flag::register(SIGHUP, self.0.clone())?;
        }
        Ok(())
    }

    /// Sets the flag as a signal does, for example at a deadline of this process.
    pub fn request(&self) {
        self.0.store(true, Ordering::Relaxed);
    }

    /// Returns whether a stop of the process was requested.
    #[inline]
    pub fn is_requested(&self) -> bool {
        self.0.load(Ordering::Relaxed)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_handled_signal_requests_a_stop() {
        for signal in [SIGTERM, SIGINT, SIGHUP] {
            if is_ignored(signal).unwrap() {
                continue; // these tests run under `nohup`
            }
            let stop = StopFlag::for_termination_signals().unwrap();
            assert!(!stop.is_requested());
            signal_hook::low_level::raise(signal).unwrap();
            assert!(stop.clone().is_requested(), "{signal}");
        }
    }

    #[test]
    fn supervisor_stops_on_signals_of_batch_systems() {
        for signal in [SIGUSR1, SIGUSR2] {
            let stop = StopFlag::default();
            stop.install_handlers(&RUN_ENDING_SIGNALS).unwrap();
            signal_hook::low_level::raise(signal).unwrap();
            assert!(stop.is_requested(), "{signal}");
        }
    }

    #[test]
    fn ignored_signal_is_detected() {
        let unused = libc::SIGXCPU;
        assert!(!is_ignored(unused).unwrap());
        // SAFETY: no code of this process uses that signal.
        unsafe { libc::signal(unused, libc::SIG_IGN) };
        assert!(is_ignored(unused).unwrap());
    }
}
