//! Opening and closing of zenoh sessions, common to all processes of this crate.

use std::sync::Once;

use serde_json::Value;
use zenoh::Wait as _;

/// Failure of a connection.
#[derive(Debug, thiserror::Error)]
pub enum WireError {
    /// zenoh rejects the configuration, or cannot listen: address and reason.
    #[error("cannot listen at {0}: {1}")]
    Open(String, zenoh::Error),
    /// A key could not be declared: key and reason.
    #[error("cannot declare {0}: {1}")]
    Declare(String, zenoh::Error),
}

impl WireError {
    /// Returns a conversion of a zenoh error to [`WireError::Declare`] for this key.
    pub fn declare_error(key: &str) -> impl FnOnce(zenoh::Error) -> WireError {
        move |why| WireError::Declare(key.to_owned(), why)
    }
}

/// Value of zenoh's thread configuration, with the tasks that share a thread. By default it reads and writes a
/// connection on two threads at once, which rustls does not permit: bridges over TLS panicked within seconds at 1
/// kHz (zenoh's issue 2557).
const ZENOH_THREADS: (&str, &str) = (
    "ZENOH_RUNTIME",
    "(tx: (worker_threads: 1), rx: (handover: tx), acc: (handover: tx), net: (handover: tx))",
);

/// Opens a session with exactly this configuration.
pub fn open(config: &Value) -> zenoh::Result<zenoh::Session> {
    static WARNED: Once = Once::new();
    WARNED.call_once(|| {
        let (name, threads) = ZENOH_THREADS;
        // SAFETY: zenoh's threads do not exist yet, and all other readers of the environment use the standard
        // library, which locks it.
        unsafe { std::env::set_var(name, threads) };
    });
    zenoh::open(zenoh::Config::from_json5(&config.to_string())?).wait()
}

/// Closes a session, and with it all its declarations.
pub fn close(session: &zenoh::Session) {
    if let Err(error) = session.close().wait() {
        tracing::debug!(%error, "the session did not close");
    }
}
