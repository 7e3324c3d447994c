//! Process name in `ps`, and log on stderr.

use std::ffi::CString;
use std::io::{self, IsTerminal};

use iceoryx2::prelude::{LogLevel, set_log_level};
use tracing::{Level, Metadata};
use tracing_subscriber::filter::filter_fn;
use tracing_subscriber::layer::Identity;
use tracing_subscriber::prelude::*;
use tracing_subscriber::{Layer, Registry};

use super::stderr::Stderr;

/// Sets the name of the calling thread in `ps` and `top`, of which the kernel keeps the first 15 bytes.
pub fn set_thread_name(name: &str) {
    if let Ok(name) = CString::new(name) {
        // A missing name has no other effect.
        let _ = rustix::thread::set_name(&name);
    }
}

/// Starts logging to stderr, including panics: one JSON object per line, or plain text on a terminal.
/// `PHALANX_LOG` sets the level.
pub fn log_to_stderr() {
    log_to_stderr_and_listener(Identity::new(), |_| false);
}

/// Starts logging to stderr with a second subscriber layer, `listener`. Events for which `is_hidden` returns `true`
/// are not logged.
pub fn log_to_stderr_and_listener<L>(listener: L, is_hidden: fn(&Metadata<'_>) -> bool)
where
    L: Layer<Registry> + Send + Sync,
{
    let level = log_level(Level::INFO);
    let filter = filter_fn(move |metadata| *metadata.level() <= level && !is_hidden(metadata));
    let log = tracing_subscriber::fmt::layer().with_writer(|| Stderr);
    // Fails only if this process logs already; the existing log then stays.
    let registry = tracing_subscriber::registry().with(listener);
    let _ = if io::stderr().is_terminal() {
        registry.with(log.with_target(false).with_filter(filter)).try_init()
    } else {
        registry.with(log.json().flatten_event(true).with_filter(filter)).try_init()
    };
    log_panics();
    limit_iceoryx2_log();
}

fn log_panics() {
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
}

/// Limits the log of iceoryx2 to errors, unless `IOX2_LOG_LEVEL` sets another level.
pub fn limit_iceoryx2_log() {
    let level = std::env::var("IOX2_LOG_LEVEL").unwrap_or_default();
    // The own function of iceoryx2 is not used: it panics on an unknown level if stderr is closed.
    set_log_level(match level.to_lowercase().as_str() {
        "trace" => LogLevel::Trace,
        "debug" => LogLevel::Debug,
        "info" => LogLevel::Info,
        "warn" => LogLevel::Warn,
        "fatal" => LogLevel::Fatal,
        _ => LogLevel::Error,
    });
}

/// Returns the level that `PHALANX_LOG` sets, or `default` if it sets none.
pub fn log_level(default: Level) -> Level {
    parse_level(std::env::var("PHALANX_LOG").ok().as_deref(), default)
}

/// Returns the value of `PHALANX_LOG` if it is set and is not a level.
pub fn unknown_log_level() -> Option<String> {
    let text = std::env::var_os("PHALANX_LOG")?.to_string_lossy().into_owned();
    (!text.is_empty() && text.parse::<Level>().is_err()).then_some(text)
}

fn parse_level(text: Option<&str>, default: Level) -> Level {
    text.and_then(|text| text.parse().ok()).unwrap_or(default)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn log_level_defaults_to_info() {
        assert_eq!(parse_level(None, Level::INFO), Level::INFO);
        assert_eq!(parse_level(Some("debug"), Level::INFO), Level::DEBUG);
        assert_eq!(parse_level(Some("loud"), Level::INFO), Level::INFO);
    }
}
