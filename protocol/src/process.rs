//! What every process of a run does first and last: take a name, log, listen for signals, exit.
//!
//! Must not: decide anything about the run, or touch stdout, which belongs to results.

use std::ffi::CString;
use std::io::{self, IsTerminal};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

use iceoryx2::prelude::{LogLevel, set_log_level_from_env_or};
use signal_hook::consts::{SIGINT, SIGTERM};
use tracing::Level;

/// Exit codes, the same for every role.
pub mod exit {
    /// Every expectation held.
    pub const OK: u8 = 0;
    /// The run ended as planned and missed an expectation.
    pub const EXPECTATION_MISSED: u8 = 1;
    /// The command line was wrong.
    pub const USAGE: u8 = 2;
    /// The scenario was wrong; nothing was spawned.
    pub const BAD_SCENARIO: u8 = 3;
    /// A process, the disk or shared memory failed.
    pub const INFRASTRUCTURE: u8 = 4;
    /// Ended by SIGINT or SIGTERM: 128 + 2, as shells report it.
    pub const INTERRUPTED: u8 = 130;
}

/// Names the calling thread as `ps` and `top` show it; the kernel keeps the first 15 bytes.
pub fn set_name(name: &str) {
    if let Ok(name) = CString::new(name) {
        // A missing name harms nobody.
        let _ = rustix::thread::set_name(&name);
    }
}

/// Becomes true once the process was asked to stop.
#[derive(Debug, Clone, Default)]
pub struct Stop(Arc<AtomicBool>);

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

/// Logs to stderr, panics included: one JSON object a line, or plain text where a person reads it.
/// `PHALANX_LOG` names the level.
pub fn log_to_stderr() {
    let level = log_level(Level::INFO);
    // Fails only if this process logs already, which then goes on as it was.
    let log = tracing_subscriber::fmt().with_max_level(level).with_writer(io::stderr);
    let _ = if io::stderr().is_terminal() {
        log.with_target(false).try_init()
    } else {
        log.json().flatten_event(true).try_init()
    };
    std::panic::set_hook(Box::new(|panic| {
        let payload = panic.payload();
        let message = payload
            .downcast_ref::<&str>()
            .copied()
            .or_else(|| payload.downcast_ref::<String>().map(String::as_str))
            .unwrap_or("(no message)");
        let at = panic.location().map(ToString::to_string).unwrap_or_default();
        tracing::error!(at, "panicked: {message}");
    }));
    quiet_iceoryx2();
}

/// Lets iceoryx2 log errors only, unless `IOX2_LOG_LEVEL` says otherwise.
pub fn quiet_iceoryx2() {
    set_log_level_from_env_or(LogLevel::Error);
}

/// The level that `PHALANX_LOG` names, or `default` if it names none.
pub fn log_level(default: Level) -> Level {
    level(std::env::var("PHALANX_LOG").ok().as_deref(), default)
}

fn level(text: Option<&str>, default: Level) -> Level {
    text.and_then(|text| text.parse().ok()).unwrap_or(default)
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

    #[test]
    fn the_log_level_defaults_to_info() {
        assert_eq!(level(None, Level::INFO), Level::INFO);
        assert_eq!(level(Some("debug"), Level::INFO), Level::DEBUG);
        assert_eq!(level(Some("loud"), Level::INFO), Level::INFO);
    }
}
