//! Start and end of every process of a run: name, log, signals, priority, exit code.
//!
//! Must not: decide anything about the run, or write to stdout, which is reserved for results.
//!
//! | file | content |
//! |---|---|
//! | `log` | process name and log |
//! | `stop` | stop requests by signals |
//! | `alarm` | periodic signal that ends waits |
//! | `thaw` | time of the last planned thaw |
//! | `priority` | scheduling policy, time slices and memory locking |
//! | `signals` | reset of inherited signal state |
//! | `stderr` | stderr that never blocks or fails |

use std::sync::Arc;
use std::sync::atomic::AtomicBool;

mod alarm;
mod log;
mod priority;
mod signals;
mod stderr;
mod stop;
mod thaw;

pub use self::alarm::Alarm;
pub use self::log::{
    limit_iceoryx2_log, log_level, log_to_stderr, log_to_stderr_and_listener, set_thread_name,
    unknown_log_level,
};
pub use self::priority::{
    PriorityError, REALTIME_PRIORITY, REALTIME_RUNTIME_PATH, TimeSlice, apply_realtime_priority,
    check_realtime_priority, may_lock_memory, raise_out_of_memory_score, request_time_slice,
    request_time_slice_of_all_threads, set_idle_priority, take_realtime_priority,
};
pub use self::signals::reset_signals;
pub use self::stderr::{Stderr, drain_stderr, never_block_on_stderr};
pub use self::stop::StopFlag;
pub use self::thaw::ThawListener;
pub use crate::exit;

/// Failure of a process, as text: no caller distinguishes causes.
pub type Failure = Box<dyn std::error::Error + Send + Sync>;

/// Runs a process: sets its name, starts the log, takes real-time priority if requested, and calls `run`. Returns
/// the exit code.
pub fn main(name: &str, realtime_priority: bool, run: impl FnOnce() -> Result<(), Failure>) -> u8 {
    main_with_log(name, realtime_priority, log_to_stderr, run)
}

/// Runs a process as [`main`] does, with its own log, which `log` starts.
pub fn main_with_log(
    name: &str,
    realtime_priority: bool,
    log: impl FnOnce(),
    run: impl FnOnce() -> Result<(), Failure>,
) -> u8 {
    set_thread_name(name);
    log();
    fail_at_file_size_limits();
    if realtime_priority {
        apply_realtime_priority();
    }
    match run() {
        Ok(()) => exit::OK,
        Err(error) => {
            tracing::error!("{error}");
            exit::INFRASTRUCTURE_FAILURE
        }
    }
}

/// Makes a write beyond the file size limit (`ulimit -f`) fail like one to a full disk, instead of ending the
/// process by SIGXFSZ. A program that this process executes has the default action again.
pub fn fail_at_file_size_limits() {
    let unread_flag: Arc<AtomicBool> = Arc::default();
    if let Err(error) = signal_hook::flag::register(libc::SIGXFSZ, unread_flag) {
        tracing::warn!("cannot handle SIGXFSZ: {error}");
    }
}
