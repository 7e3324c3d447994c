//! Watch of the plant and the agents over the supervisor, in lockstep. They wait for as long as the supervisor,
//! which watches over all other processes, is alive.

use std::time::Duration;

use super::{Activity, ProcessSample, SchedulingState, Watchdog};
use crate::machine::barrier::Barrier;
use crate::machine::clock;
use crate::machine::process::StopFlag;

/// Time between two checks, ns.
const CHECK_INTERVAL_NS: u64 = 500_000_000;

/// Reason why waiting is useless.
#[derive(Debug, Clone, Copy, PartialEq, thiserror::Error)]
#[expect(missing_docs, reason = "the messages say what the fields are")]
pub enum SupervisorLossReason {
    /// The process of the supervisor has exited.
    #[error("the supervisor is gone")]
    Exited,
    /// The process of the supervisor is alive and makes no progress.
    #[error("no sign of life of the supervisor for {} s {instead}", limit.as_secs_f64())]
    Hung { limit: Duration, instead: Activity },
}

/// Watch over the supervisor of a lockstep run.
#[derive(Debug)]
pub struct SupervisorWatch {
    pid: u32,
    limit: Duration,
    start_time_ticks: Option<u64>,
    heartbeats: u32,
    last_check_ns: u64,
    watchdog: Watchdog,
    loss: Option<SupervisorLossReason>,
}

impl SupervisorWatch {
    /// Creates a watch over the process that created the barrier, with the time limit in it.
    pub fn new(barrier: &Barrier) -> SupervisorWatch {
        SupervisorWatch {
            pid: barrier.supervisor_pid(),
            limit: barrier.hung_timeout(),
            start_time_ticks: None,
            heartbeats: barrier.heartbeat_count(),
            last_check_ns: 0,
            watchdog: Watchdog::default(),
            loss: None,
        }
    }

    /// Returns a closure for the waits of the barrier: `true` until a stop of this process is requested
    /// or the supervisor is lost.
    pub fn waiting_condition<'w>(
        &'w mut self,
        barrier: &'w Barrier,
        stop: &'w StopFlag,
    ) -> impl FnMut() -> bool + 'w {
        move || !stop.is_requested() && self.check(barrier)
    }

    /// Returns the reason why the supervisor is lost; `None` if it is not.
    pub fn loss_reason(&self) -> Option<SupervisorLossReason> {
        self.loss
    }

    /// Records progress of the run, which shows that the supervisor is alive.
    pub fn record_progress(&mut self) {
        self.watchdog.reset();
    }

    /// Checks the supervisor if a check is due. Returns whether waiting makes sense. Call it while idle; it reads
    /// from the kernel only if the heartbeat of the supervisor has stopped.
    pub fn check(&mut self, barrier: &Barrier) -> bool {
        let now_ns = clock::now_ns();
        if now_ns - self.last_check_ns < CHECK_INTERVAL_NS {
            return true;
        }
        self.last_check_ns = now_ns;
        let heartbeats = barrier.heartbeat_count();
        if std::mem::replace(&mut self.heartbeats, heartbeats) != heartbeats {
            self.watchdog.reset();
            return true;
        }
        self.loss = self.assess_sample(ProcessSample::read(self.pid).ok()).err();
        self.loss.is_none()
    }

    /// Judges the supervisor by a sample of the process with its id; `None` if there is no such process.
    fn assess_sample(&mut self, sample: Option<ProcessSample>) -> Result<(), SupervisorLossReason> {
        let sample = sample.filter(|sample| {
            sample.state != SchedulingState::Exited
                && *self.start_time_ticks.get_or_insert(sample.start_time_ticks)
                    == sample.start_time_ticks
        });
        self.watchdog.add_sample(sample.ok_or(SupervisorLossReason::Exited)?);
        match self.watchdog.hung_activity(self.limit) {
            Some(instead) => Err(SupervisorLossReason::Hung { limit: self.limit, instead }),
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
        let sample = |state, time_s: u64, start_time_ticks| {
            let cpu_time = Duration::ZERO;
            Some(ProcessSample {
                state,
                cpu_time,
                time_ns: time_s * 1_000_000_000,
                start_time_ticks,
            })
        };
        assert_eq!(new().assess_sample(None), Err(SupervisorLossReason::Exited));
        assert_eq!(
            new().assess_sample(sample(SchedulingState::Exited, 0, 7)),
            Err(SupervisorLossReason::Exited)
        );
        let mut watch = new();
        watch.assess_sample(sample(SchedulingState::Stopped, 0, 7)).unwrap();
        watch.assess_sample(sample(SchedulingState::Stopped, 3600, 7)).unwrap();
        assert_eq!(
            watch.assess_sample(sample(SchedulingState::Stopped, 3601, 8)),
            Err(SupervisorLossReason::Exited)
        );
        for time_s in 4000..4003 {
            watch.assess_sample(sample(SchedulingState::Blocked, time_s, 7)).unwrap();
        }
        let reason = watch.assess_sample(sample(SchedulingState::Blocked, 4003, 7)).unwrap_err();
        assert_eq!(reason.to_string(), "no sign of life of the supervisor for 3 s while blocked");
        watch.record_progress();
        watch.assess_sample(sample(SchedulingState::Blocked, 4004, 7)).unwrap();
        watch.assess_sample(sample(SchedulingState::Blocked, 4005, 7)).unwrap();
    }
}
