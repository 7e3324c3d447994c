//! Whether a process was asked to stop: by SIGTERM, SIGINT, or SIGHUP when its terminal is gone; a supervisor also by
//! SIGUSR1 or SIGUSR2.

use std::io;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

use signal_hook::consts::{SIGHUP, SIGINT, SIGTERM, SIGUSR1, SIGUSR2};

use super::exit;
use super::signals::is_ignored;

/// Signals that ask a run to end. Batch systems send SIGUSR1 or SIGUSR2 before a job's time is over.
const RUN_ENDING: [i32; 4] = [SIGTERM, SIGINT, SIGUSR1, SIGUSR2];

/// Becomes true once the process was asked to stop.
#[derive(Debug, Clone, Default)]
pub struct Stop(Arc<AtomicBool>);

impl Stop {
    /// A flag that these signals set. Waits they interrupt return early.
    pub fn on_signals() -> io::Result<Stop> {
        let stop = Stop::default();
        stop.listen(&[SIGTERM, SIGINT])?;
        Ok(stop)
    }

    /// Returns a flag that the signals set which end a run, SIGUSR1 and SIGUSR2 included. A second signal ends the process
    /// at once, except SIGHUP: when a terminal closes, shell and kernel both send it.
    pub fn on_signals_twice_at_once() -> io::Result<Stop> {
        let stop = Stop::default();
        // Before the flag is set by the same signal.
        for signal in RUN_ENDING {
            let code = i32::from(exit::INTERRUPTED);
            signal_hook::flag::register_conditional_shutdown(signal, code, stop.0.clone())?;
        }
        stop.listen(&RUN_ENDING)?;
        Ok(stop)
    }

    fn listen(&self, signals: &[i32]) -> io::Result<()> {
        for &signal in signals {
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
    fn a_supervisor_also_stops_on_the_signals_of_batch_systems() {
        for signal in [SIGUSR1, SIGUSR2] {
            let stop = Stop::default();
            stop.listen(&RUN_ENDING).unwrap();
            signal_hook::low_level::raise(signal).unwrap();
            assert!(stop.requested(), "{signal}");
        }
    }

    #[test]
    fn who_was_told_to_ignore_a_signal_is_known() {
        let unused = libc::SIGXCPU;
        assert!(!is_ignored(unused).unwrap());
        // SAFETY: nothing in this process uses that signal.
        unsafe { libc::signal(unused, libc::SIG_IGN) };
        assert!(is_ignored(unused).unwrap());
    }
}
