//! What every process of a run does first and last: take a name, log, listen for signals, take
//! priority if it was told to, exit.
//!
//! Must not: decide anything about the run, or touch stdout, which belongs to results.
//!
//! | file | question it answers |
//! |---|---|
//! | `log` | what is it called, where does its log go, and what is in it? |
//! | `stop` | was it asked to stop? |
//! | `alarm` | what ends its waits? |
//! | `thaw` | when did a freeze on purpose end? |
//! | `priority` | who runs before it, and for how long? |
//! | `signals` | which signal state of its parent does it drop? |
//! | `stderr` | what if nothing reads what it writes? |
//! | `exit` | which exit code says what? |

use std::sync::Arc;
use std::sync::atomic::AtomicBool;

mod alarm;
pub mod exit;
mod log;
mod priority;
mod signals;
mod stderr;
mod stop;
mod thaw;

pub use self::alarm::Alarm;
pub use self::log::{
    log_level, log_to_stderr, log_to_stderr_and, quiet_iceoryx2, set_name, unknown_log_level,
};
pub use self::priority::{
    PriorityError, REALTIME_PRIORITY, REALTIME_RUNTIME, Turns, hurry, may_lock_memory,
    prefer_at_out_of_memory, stand_back, take_realtime_priority, take_turns, take_turns_of_all,
    try_realtime_priority,
};
pub use self::signals::reset_signals;
pub use self::stderr::{Stderr, drain_stderr, never_block_on_stderr};
pub use self::stop::Stop;
pub use self::thaw::Thaws;

/// Why a process gave up, in words: nobody asks for more.
pub type Failure = Box<dyn std::error::Error + Send + Sync>;

/// What a process does around `run`: named, logging, before every ordinary process if it is to be, and with an
/// exit code that tells how it ended.
pub fn main(name: &str, realtime_priority: bool, run: impl FnOnce() -> Result<(), Failure>) -> u8 {
    main_that_logs(name, realtime_priority, log_to_stderr, run)
}

/// The same, by a log of its own, which `log` begins.
pub fn main_that_logs(
    name: &str,
    realtime_priority: bool,
    log: impl FnOnce(),
    run: impl FnOnce() -> Result<(), Failure>,
) -> u8 {
    set_name(name);
    log();
    fail_at_file_size_limits();
    if realtime_priority {
        hurry();
    }
    match run() {
        Ok(()) => exit::OK,
        Err(error) => {
            tracing::error!("{error}");
            exit::INFRASTRUCTURE
        }
    }
}

/// Lets writing beyond a limit of file sizes (`ulimit -f`) fail as on a full disk does, in place of a signal that ends
/// the process. Programs that this one becomes have the signal again.
pub fn fail_at_file_size_limits() {
    let nobody_asks: Arc<AtomicBool> = Arc::default();
    if let Err(error) = signal_hook::flag::register(libc::SIGXFSZ, nobody_asks) {
        tracing::warn!("cannot handle SIGXFSZ: {error}");
    }
}
