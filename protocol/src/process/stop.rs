//! Whether a process was asked to stop: by SIGTERM or SIGINT.

use std::io;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

use signal_hook::consts::{SIGINT, SIGTERM};

use super::exit;

/// Becomes true once the process was asked to stop.
#[derive(Debug, Clone, Default)]
pub struct Stop(pub(super) Arc<AtomicBool>);

impl Stop {
    /// A flag that SIGTERM and SIGINT set. Waits they interrupt return early.
    pub fn on_signals() -> io::Result<Stop> {
        let stop = Stop::default();
        signal_hook::flag::register(SIGTERM, stop.0.clone())?;
        signal_hook::flag::register(SIGINT, stop.0.clone())?;
        Ok(stop)
    }

    /// The same, for a process that a person waits for: a second signal ends it at once.
    pub fn on_signals_twice_at_once() -> io::Result<Stop> {
        let stop = Stop::default();
        for signal in [SIGTERM, SIGINT] {
            let code = i32::from(exit::INTERRUPTED);
            signal_hook::flag::register_conditional_shutdown(signal, code, stop.0.clone())?;
            signal_hook::flag::register(signal, stop.0.clone())?;
        }
        Ok(stop)
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
    fn sigterm_requests_a_stop() {
        let stop = Stop::on_signals().unwrap();
        assert!(!stop.requested());
        signal_hook::low_level::raise(SIGTERM).unwrap();
        assert!(stop.clone().requested());
    }
}
