//! What every process of a run does first and last: take a name, log, listen for signals, take
//! priority if it was told to, exit.
//!
//! Must not: decide anything about the run, or touch stdout, which belongs to results.

use std::ffi::CString;
use std::io::{self, IsTerminal};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

use rustix::mm::{MlockAllFlags, mlockall};
use rustix::process::{Resource, getrlimit};
use rustix::thread::{CapabilitySet, capabilities};

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

/// While it lives, a signal interrupts whatever the thread that started it waits for, every
/// [`Alarm::PERIOD`]: a deadline for all waits that costs nothing at each of them.
#[derive(Debug)]
pub struct Alarm {
    stop: Stop,
    timer: libc::timer_t,
}

// SAFETY: the timer's number is the process's, whichever thread holds it.
unsafe impl Send for Alarm {}
// SAFETY: as above; nothing but dropping it touches the timer.
unsafe impl Sync for Alarm {}

impl Alarm {
    /// Time between two interruptions.
    pub const PERIOD: Duration = Duration::from_millis(100);

    /// Interrupts the calling thread, which `stop` asks to stop.
    pub fn start(stop: &Stop) -> io::Result<Alarm> {
        extern "C" fn nothing(_signal: libc::c_int) {}
        let handler: extern "C" fn(libc::c_int) = nothing;
        // Not SIGALRM, which ends processes that set an end to their lives.
        let signal = libc::SIGRTMIN();
        let succeeded = |code| if code == 0 { Ok(()) } else { Err(io::Error::last_os_error()) };
        // SAFETY: zeros are a value of these plain structs.
        let (mut action, mut event): (libc::sigaction, libc::sigevent) =
            unsafe { (std::mem::zeroed(), std::mem::zeroed()) };
        // Without SA_RESTART: that is what it is for.
        action.sa_sigaction = handler as libc::sighandler_t;
        // SAFETY: reads `action`; its handler does nothing, which is safe at any time.
        succeeded(unsafe { libc::sigaction(signal, &action, std::ptr::null_mut()) })?;
        event.sigev_signo = signal;
        event.sigev_notify = libc::SIGEV_THREAD_ID;
        event.sigev_notify_thread_id = rustix::thread::gettid().as_raw_nonzero().get();
        let mut timer = std::ptr::null_mut();
        // SAFETY: reads `event`, writes `timer`.
        succeeded(unsafe { libc::timer_create(libc::CLOCK_MONOTONIC, &mut event, &mut timer) })?;
        let alarm = Alarm { stop: stop.clone(), timer };
        let period = libc::timespec { tv_sec: 0, tv_nsec: Alarm::PERIOD.subsec_nanos().into() };
        let times = libc::itimerspec { it_interval: period, it_value: period };
        // SAFETY: a timer that was made; reads `times`.
        succeeded(unsafe { libc::timer_settime(timer, 0, &times, std::ptr::null_mut()) })?;
        Ok(alarm)
    }

    /// Whether it is more than an alarm: the process was asked to stop.
    pub(crate) fn stops(&self) -> bool {
        self.stop.requested()
    }
}

impl Drop for Alarm {
    fn drop(&mut self) {
        // SAFETY: made by `start`, and deleted once. The handler stays: a signal may be under way.
        unsafe { libc::timer_delete(self.timer) };
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

/// Priority under SCHED_FIFO: above every ordinary process, below the kernel's own threads (50 and
/// more) and whatever else on this machine is in a hurry for a reason.
pub const REALTIME_PRIORITY: i32 = 10;
/// How much of each second real-time processes may have, us; -1 for all of it.
pub const REALTIME_RUNTIME: &str = "/proc/sys/kernel/sched_rt_runtime_us";

/// Why a process goes on with ordinary priority.
#[derive(Debug, thiserror::Error)]
pub enum PriorityError {
    /// One process that spins would take its core from everybody for good.
    #[error(
        "{REALTIME_RUNTIME} is {0:?}, expected a positive number: without that limit a real-time process that spins starves the machine; set it to 950000"
    )]
    Unlimited(String),
    /// The kernel does not let this user.
    #[error(
        "the kernel does not permit SCHED_FIFO at priority {REALTIME_PRIORITY}: {0}; it needs root, CAP_SYS_NICE, or an rtprio of {REALTIME_PRIORITY} in /etc/security/limits.conf"
    )]
    Refused(io::Error),
}

/// Lets the calling thread run before every ordinary process of the machine. Threads that it
/// starts from now on do the same.
pub fn take_realtime_priority() -> Result<(), PriorityError> {
    let runtime = std::fs::read_to_string(REALTIME_RUNTIME).unwrap_or_default();
    if !runtime.trim().parse::<i64>().is_ok_and(|us| us > 0) {
        return Err(PriorityError::Unlimited(runtime.trim().into()));
    }
    let parameters = libc::sched_param { sched_priority: REALTIME_PRIORITY };
    // SAFETY: a plain system call that reads `parameters`; 0 is the calling thread.
    match unsafe { libc::sched_setscheduler(0, libc::SCHED_FIFO, &parameters) } {
        0 => Ok(()),
        _ => Err(PriorityError::Refused(io::Error::last_os_error())),
    }
}

/// Whether [`take_realtime_priority`] would be granted to processes that this one starts.
pub fn try_realtime_priority() -> Result<(), PriorityError> {
    std::thread::scope(|scope| {
        let thread = std::thread::Builder::new().spawn_scoped(scope, take_realtime_priority);
        thread.map_err(PriorityError::Refused)?.join().expect("it does not panic")
    })
}

/// Whether a process may lock all its memory, whatever it grows to. With less, a mapping made later
/// would fail.
pub fn may_lock_memory() -> bool {
    let unlimited = getrlimit(Resource::Memlock).current.is_none();
    unlimited
        || capabilities(None).is_ok_and(|sets| sets.effective.contains(CapabilitySet::IPC_LOCK))
}

/// What a child does that was told to take priority: SCHED_FIFO, and its memory locked so that it
/// waits for no page. It goes on without whatever it does not get; the supervisor has said so.
pub fn hurry() {
    if let Err(error) = take_realtime_priority() {
        tracing::warn!("ordinary priority: {error}");
    }
    if !may_lock_memory() {
        tracing::warn!("memory is not locked: RLIMIT_MEMLOCK is not unlimited");
    } else if let Err(error) = mlockall(MlockAllFlags::CURRENT | MlockAllFlags::FUTURE) {
        tracing::warn!(%error, "memory is not locked");
    }
}

/// How long a process that is due may run before others have their turn, ns: the least that Linux
/// grants. Whoever asks for little is served first, which is what a control loop wants: a tenth of
/// a millisecond is more than it needs.
const TURN_NS: u64 = 100_000;

/// Asks for short turns, and thereby for early ones, for the calling thread, if its priority is an
/// ordinary one. Linux before 6.12 pays no heed, which is no harm.
pub fn take_short_turns() {
    // SAFETY: zeros are a value of this plain struct.
    let mut attributes: libc::sched_attr = unsafe { std::mem::zeroed() };
    let size = size_of_val(&attributes) as u32;
    // SAFETY: writes `size` bytes at most to `attributes`; 0 is the calling thread.
    let read = unsafe { libc::syscall(libc::SYS_sched_getattr, 0, &mut attributes, size, 0) };
    if read != 0 || attributes.sched_policy != libc::SCHED_OTHER as u32 {
        return;
    }
    attributes.sched_runtime = TURN_NS;
    // SAFETY: reads `attributes`, which says its own size.
    if unsafe { libc::syscall(libc::SYS_sched_setattr, 0, &attributes, 0) } != 0 {
        let error = io::Error::last_os_error();
        tracing::debug!(%error, "turns are as long as everybody's");
    }
}

/// Lets the calling thread run only while no other wants its core.
pub fn stand_back() -> io::Result<()> {
    let parameters = libc::sched_param { sched_priority: 0 };
    // SAFETY: a plain system call that reads `parameters`; 0 is the calling thread.
    match unsafe { libc::sched_setscheduler(0, libc::SCHED_IDLE, &parameters) } {
        0 => Ok(()),
        _ => Err(io::Error::last_os_error()),
    }
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
    fn an_alarm_interrupts_a_wait_without_a_limit_again_and_again() {
        let stop = Stop::default();
        let alarm = Alarm::start(&stop).unwrap();
        let interrupted = || {
            // SAFETY: a wait for nothing, which only a signal ends before its 20 s.
            let ended = unsafe { libc::poll(std::ptr::null_mut(), 0, 20_000) };
            ended == -1 && io::Error::last_os_error().kind() == io::ErrorKind::Interrupted
        };
        assert!(interrupted() && interrupted());
        assert!(!alarm.stops());
        stop.0.store(true, Ordering::Relaxed);
        assert!(alarm.stops());
    }

    #[test]
    fn trying_for_priority_leaves_the_caller_as_it_was() {
        // SAFETY: plain system calls about the calling thread.
        let policy = || unsafe { libc::sched_getscheduler(0) };
        let before = policy();
        let granted = try_realtime_priority();
        assert_eq!(policy(), before);
        let then = std::thread::spawn(move || (take_realtime_priority().is_ok(), policy()));
        let (taken, policy) = then.join().unwrap();
        assert_eq!(taken, granted.is_ok());
        assert_eq!(policy == libc::SCHED_FIFO, taken);
    }

    #[test]
    fn the_log_level_defaults_to_info() {
        assert_eq!(level(None, Level::INFO), Level::INFO);
        assert_eq!(level(Some("debug"), Level::INFO), Level::DEBUG);
        assert_eq!(level(Some("loud"), Level::INFO), Level::INFO);
    }
}
