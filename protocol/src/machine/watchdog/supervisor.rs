//! Watch of the plant and the agents over the supervisor, in lockstep. They wait for as long as the supervisor,
//! which watches over all other processes, is alive.

use std::time::Duration;

use super::{Activity, ProcessSample, SchedulingState, Watchdog};
use crate::machine::barrier::Barrier;
use crate::machine::clock;
use crate::machine::process::Stop;

/// Time between two checks, ns.
const CHECK_EVERY_NS: u64 = 500_000_000;

/// Reason why waiting is useless.
#[derive(Debug, Clone, Copy, PartialEq, thiserror::Error)]
#[expect(missing_docs, reason = "the messages say what the fields are")]
pub enum SupervisorLost {
    /// The process of the supervisor has exited.
    #[error("the supervisor is gone")]
    Gone,
    /// The process of the supervisor is alive and makes no progress.
    #[error("no sign of life of the supervisor for {} s {instead}", limit.as_secs_f64())]
    Hung { limit: Duration, instead: Activity },
}

/// Watch over the supervisor of a lockstep run.
#[derive(Debug)]
pub struct SupervisorWatch {
    pid: u32,
    limit: Duration,
    started: Option<u64>,
    heartbeats: u32,
    checked_ns: u64,
    dog: Watchdog,
    loss: Option<SupervisorLost>,
}

impl SupervisorWatch {
    /// Creates a watch over the process that created the barrier, with the time limit in it.
    pub fn new(barrier: &Barrier) -> SupervisorWatch {
        SupervisorWatch {
            pid: barrier.supervisor(),
            limit: barrier.hung_timeout(),
            started: None,
            heartbeats: barrier.heartbeats(),
            checked_ns: 0,
            dog: Watchdog::default(),
            loss: None,
        }
    }

    /// Returns a closure for the waits of the barrier: `true` until this process is asked to stop or the
    /// supervisor is lost.
    pub fn patience<'w>(
        &'w mut self,
        barrier: &'w Barrier,
        stop: &'w Stop,
    ) -> impl FnMut() -> bool + 'w {
        move || !stop.is_requested() && self.check(barrier)
    }

    /// Returns the reason why the supervisor is lost; `None` if it is not.
    pub fn loss_reason(&self) -> Option<SupervisorLost> {
        self.loss
    }

    /// Records progress of the run, which shows that the supervisor is alive.
    pub fn record_progress(&mut self) {
        self.dog.reset();
    }

    /// Checks the supervisor if a check is due. Returns whether waiting makes sense. Call it while idle; it reads
    /// from the kernel only if the heartbeat of the supervisor has stopped.
    pub fn check(&mut self, barrier: &Barrier) -> bool {
        let now_ns = clock::now_ns();
        if now_ns - self.checked_ns < CHECK_EVERY_NS {
            return true;
        }
        self.checked_ns = now_ns;
        let heartbeats = barrier.heartbeats();
        if std::mem::replace(&mut self.heartbeats, heartbeats) != heartbeats {
            self.dog.reset();
            return true;
        }
        self.loss = self.judge(ProcessSample::read(self.pid).ok()).err();
        self.loss.is_none()
    }

    /// Judges the supervisor by a sample of the process with its id; `None` if there is no such process.
    fn judge(&mut self, seen: Option<ProcessSample>) -> Result<(), SupervisorLost> {
        let seen = seen.filter(|seen| {
            seen.state != SchedulingState::Gone
                && *self.started.get_or_insert(seen.started) == seen.started
        });
        self.dog.add_sample(seen.ok_or(SupervisorLost::Gone)?);
        match self.dog.hung_activity(self.limit) {
            Some(instead) => Err(SupervisorLost::Hung { limit: self.limit, instead }),
            None => Ok(()),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn supervisor_is_lost_if_gone_replaced_or_hung_not_stopped() {
        let directory = tempfile::tempdir().unwrap();
        let path = directory.path().join("barrier");
        let barrier = Barrier::create(&path, 1, 1, Duration::from_secs(3)).unwrap();
        let new = || SupervisorWatch::new(&barrier);
        // This process created the barrier, and may run.
        assert!(new().check(&barrier));
        let seen = |state, at_s: u64, started| {
            let computed = Duration::ZERO;
            Some(ProcessSample { state, computed, at_ns: at_s * 1_000_000_000, started })
        };
        assert_eq!(new().judge(None), Err(SupervisorLost::Gone));
        assert_eq!(new().judge(seen(SchedulingState::Gone, 0, 7)), Err(SupervisorLost::Gone));
        let mut watch = new();
        watch.judge(seen(SchedulingState::Stopped, 0, 7)).unwrap();
        watch.judge(seen(SchedulingState::Stopped, 3600, 7)).unwrap();
        assert_eq!(watch.judge(seen(SchedulingState::Stopped, 3601, 8)), Err(SupervisorLost::Gone));
        for at_s in 4000..4003 {
            watch.judge(seen(SchedulingState::Blocked, at_s, 7)).unwrap();
        }
        let lost = watch.judge(seen(SchedulingState::Blocked, 4003, 7)).unwrap_err();
        assert_eq!(lost.to_string(), "no sign of life of the supervisor for 3 s while blocked");
        watch.record_progress();
        watch.judge(seen(SchedulingState::Blocked, 4004, 7)).unwrap();
        watch.judge(seen(SchedulingState::Blocked, 4005, 7)).unwrap();
    }
}
