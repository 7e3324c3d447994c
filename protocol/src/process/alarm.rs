//! What ends the waits of a thread: a signal, again and again.

use std::io;
use std::time::Duration;

/// While it lives, a signal interrupts whatever the thread that started it waits for, every
/// [`Alarm::PERIOD`]: a deadline for all waits that costs nothing at each of them. A SIGTERM that is
/// handled interrupts them too, from then on.
#[derive(Debug)]
pub struct Alarm {
    timer: libc::timer_t,
}

// SAFETY: the timer's number is the process's, whichever thread holds it.
unsafe impl Send for Alarm {}
// SAFETY: as above; nothing but dropping it touches the timer.
unsafe impl Sync for Alarm {}

impl Alarm {
    /// Time between two interruptions.
    pub const PERIOD: Duration = Duration::from_millis(100);

    /// Interrupts the calling thread.
    pub fn start() -> io::Result<Alarm> {
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
        // And whoever is asked to end does not sleep until the next alarm.
        // SAFETY: writes `action`, then reads it: the handler stays what it is.
        succeeded(unsafe { libc::sigaction(libc::SIGTERM, std::ptr::null(), &mut action) })?;
        action.sa_flags &= !libc::SA_RESTART;
        // SAFETY: as above.
        succeeded(unsafe { libc::sigaction(libc::SIGTERM, &action, std::ptr::null_mut()) })?;
        event.sigev_signo = signal;
        event.sigev_notify = libc::SIGEV_THREAD_ID;
        event.sigev_notify_thread_id = rustix::thread::gettid().as_raw_nonzero().get();
        let mut timer = std::ptr::null_mut();
        // SAFETY: reads `event`, writes `timer`.
        succeeded(unsafe { libc::timer_create(libc::CLOCK_MONOTONIC, &mut event, &mut timer) })?;
        let alarm = Alarm { timer };
        let period = libc::timespec { tv_sec: 0, tv_nsec: Alarm::PERIOD.subsec_nanos().into() };
        let times = libc::itimerspec { it_interval: period, it_value: period };
        // SAFETY: a timer that was made; reads `times`.
        succeeded(unsafe { libc::timer_settime(timer, 0, &times, std::ptr::null_mut()) })?;
        Ok(alarm)
    }
}

impl Drop for Alarm {
    fn drop(&mut self) {
        // SAFETY: made by `start`, and deleted once. The handler stays: a signal may be under way.
        unsafe { libc::timer_delete(self.timer) };
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn with_an_alarm_a_request_to_end_interrupts_waits_and_is_still_handled() {
        let stop = crate::process::Stop::on_signals().unwrap();
        let _alarm = Alarm::start().unwrap();
        // SAFETY: zeros are a value of it, which the call overwrites.
        let mut action: libc::sigaction = unsafe { std::mem::zeroed() };
        // SAFETY: writes `action`; the signal goes to this thread, which has a handler for it.
        unsafe {
            libc::sigaction(libc::SIGTERM, std::ptr::null(), &mut action);
            libc::raise(libc::SIGTERM);
        }
        assert_eq!(action.sa_flags & libc::SA_RESTART, 0);
        assert!(stop.requested());
    }

    #[test]
    fn an_alarm_interrupts_a_wait_without_a_limit_again_and_again() {
        let _alarm = Alarm::start().unwrap();
        let interrupted = || {
            // SAFETY: a wait for nothing, which only a signal ends before its 20 s.
            let ended = unsafe { libc::poll(std::ptr::null_mut(), 0, 20_000) };
            ended == -1 && io::Error::last_os_error().kind() == io::ErrorKind::Interrupted
        };
        assert!(interrupted() && interrupted());
    }
}
