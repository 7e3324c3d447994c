//! A periodic signal that ends the blocking waits of a thread.

use std::io;
use std::time::Duration;

/// Periodic timer whose signal interrupts the blocking system calls of the thread that started it, every
/// [`Alarm::PERIOD`], until it is dropped: a deadline for all waits that costs nothing at each of them. From its
/// start on, a handled SIGTERM interrupts waits too.
#[derive(Debug)]
pub struct Alarm {
    timer: libc::timer_t,
}

// SAFETY: the timer's number belongs to the process, whichever thread holds it.
unsafe impl Send for Alarm {}
// SAFETY: as above; nothing but dropping it touches the timer.
unsafe impl Sync for Alarm {}

impl Alarm {
    /// Time between two interruptions.
    pub const PERIOD: Duration = Duration::from_millis(100);

    /// Starts the timer for the calling thread.
    ///
    /// # Errors
    ///
    /// The kernel refuses the handler or the timer.
    pub fn start() -> io::Result<Alarm> {
        extern "C" fn ignore_signal(_signal: libc::c_int) {}
        let handler: extern "C" fn(libc::c_int) = ignore_signal;
        // Not SIGALRM, which a process may use to limit its own lifetime.
        let signal = libc::SIGRTMIN();
        let check_code = |code| if code == 0 { Ok(()) } else { Err(io::Error::last_os_error()) };
        // SAFETY: all-zero bytes are a valid value of these plain structs.
        let (mut action, mut event): (libc::sigaction, libc::sigevent) =
            unsafe { (std::mem::zeroed(), std::mem::zeroed()) };
        // Without SA_RESTART, so that the signal ends waits.
        action.sa_sigaction = handler as libc::sighandler_t;
        // SAFETY: reads `action`; its handler does nothing, which is safe at any time.
        check_code(unsafe { libc::sigaction(signal, &action, std::ptr::null_mut()) })?;
        // SIGTERM must end a wait too, instead of waiting for the next alarm.
        // SAFETY: writes `action`, then reads it: the handler stays what it is.
        check_code(unsafe { libc::sigaction(libc::SIGTERM, std::ptr::null(), &mut action) })?;
        action.sa_flags &= !libc::SA_RESTART;
        // SAFETY: as above.
        check_code(unsafe { libc::sigaction(libc::SIGTERM, &action, std::ptr::null_mut()) })?;
        event.sigev_signo = signal;
        event.sigev_notify = libc::SIGEV_THREAD_ID;
        event.sigev_notify_thread_id = rustix::thread::gettid().as_raw_nonzero().get();
        let mut timer = std::ptr::null_mut();
        // SAFETY: reads `event`, writes `timer`.
        check_code(unsafe { libc::timer_create(libc::CLOCK_MONOTONIC, &mut event, &mut timer) })?;
        let alarm = Alarm { timer };
        let period = libc::timespec { tv_sec: 0, tv_nsec: Alarm::PERIOD.subsec_nanos().into() };
        let times = libc::itimerspec { it_interval: period, it_value: period };
        // SAFETY: the timer was created above; reads `times`.
        check_code(unsafe { libc::timer_settime(timer, 0, &times, std::ptr::null_mut()) })?;
        Ok(alarm)
    }
}

impl Drop for Alarm {
    fn drop(&mut self) {
        // SAFETY: created by `start`, and deleted once. The handler stays, because a signal may be pending.
        unsafe { libc::timer_delete(self.timer) };
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sigterm_interrupts_waits_and_is_handled_with_an_alarm() {
        let stop = crate::machine::process::StopFlag::for_termination_signals().unwrap();
        let _alarm = Alarm::start().unwrap();
        // SAFETY: all-zero bytes are a valid value, which the call overwrites.
        let mut action: libc::sigaction = unsafe { std::mem::zeroed() };
        // SAFETY: writes `action`; the signal goes to this thread, which has a handler for it.
        unsafe {
            libc::sigaction(libc::SIGTERM, std::ptr::null(), &mut action);
            libc::raise(libc::SIGTERM);
        }
        assert_eq!(action.sa_flags & libc::SA_RESTART, 0);
        assert!(stop.is_requested());
    }

    #[test]
    fn alarm_interrupts_unbounded_waits_repeatedly() {
        let _alarm = Alarm::start().unwrap();
        let is_interrupted = || {
            // SAFETY: a wait without descriptors, which only a signal ends before its 20 s.
            let result = unsafe { libc::poll(std::ptr::null_mut(), 0, 20_000) };
            result == -1 && io::Error::last_os_error().kind() == io::ErrorKind::Interrupted
        };
        assert!(is_interrupted() && is_interrupted());
    }
}
