//! What the processes of this crate have in common of zenoh: how a session opens and ends, and why there is
//! no connection.

use std::sync::Once;

use serde_json::Value;
use zenoh::Wait as _;

/// Why there is no connection.
#[derive(Debug, thiserror::Error)]
pub enum WireError {
    /// zenoh does not take the configuration, or cannot listen: where, and why.
    #[error("cannot listen at {0}: {1}")]
    Open(String, zenoh::Error),
    /// A key could not be declared: which, and why.
    #[error("cannot declare {0}: {1}")]
    Declare(String, zenoh::Error),
}

impl WireError {
    /// That this key could not be declared.
    pub fn declaring(key: &str) -> impl FnOnce(zenoh::Error) -> WireError {
        move |why| WireError::Declare(key.to_owned(), why)
    }
}

/// Which of zenoh's tasks share a thread. Left alone it reads and writes a connection from two threads at once,
/// and rustls permits one: bridges over TLS died of it, within seconds at 1 kHz (zenoh's issue 2557).
const THREADS: (&str, &str) = (
    "ZENOH_RUNTIME",
    "(tx: (worker_threads: 1), rx: (handover: tx), acc: (handover: tx), net: (handover: tx))",
);

/// A session with nothing but what this configuration says.
pub fn open(config: &Value) -> zenoh::Result<zenoh::Session> {
    static TOLD: Once = Once::new();
    TOLD.call_once(|| {
        let (name, threads) = THREADS;
        // SAFETY: zenoh's threads are not there yet, and whoever reads the environment meanwhile does so by
        // the standard library, which locks it.
        unsafe { std::env::set_var(name, threads) };
    });
    zenoh::open(zenoh::Config::from_json5(&config.to_string())?).wait()
}

/// Ends a session, and with it whatever was declared in it.
pub fn close(session: &zenoh::Session) {
    if let Err(error) = session.close().wait() {
        tracing::debug!(%error, "the session did not close");
    }
}
