//! In lockstep the plant and the agents wait for as long as the run has a supervisor: it watches
//! over all others. This is how they watch over it.

use std::time::Duration;

use super::{Instead, Sample, State, Watchdog};
use crate::barrier::Barrier;
use crate::clock;
use crate::process::Stop;

/// How often it is looked at, ns.
const LOOK_EVERY_NS: u64 = 500_000_000;

/// Why nobody need wait any longer.
#[derive(Debug, Clone, Copy, PartialEq, thiserror::Error)]
#[expect(missing_docs, reason = "the messages say what the fields are")]
pub enum SupervisorLost {
    /// Its process is dead.
    #[error("the supervisor is gone")]
    Gone,
    /// Its process lives and does nothing for the run.
    #[error("no sign of life of the supervisor for {} s {instead}", limit.as_secs_f64())]
    Hung { limit: Duration, instead: Instead },
}

/// Watches over the supervisor of a lockstep run.
#[derive(Debug)]
pub struct SupervisorWatch {
    pid: u32,
    limit: Duration,
    started: Option<u64>,
    turns: u32,
    looked_ns: u64,
    dog: Watchdog,
    lost: Option<SupervisorLost>,
}

impl SupervisorWatch {
    /// Over the process that made the barrier, with the patience that it asked for.
    pub fn new(barrier: &Barrier) -> SupervisorWatch {
        SupervisorWatch {
            pid: barrier.supervisor(),
            limit: barrier.hung_after(),
            started: None,
            turns: barrier.turns(),
            looked_ns: 0,
            dog: Watchdog::default(),
            lost: None,
        }
    }

    /// For the waits of the barrier: until this process is asked to stop, or is alone.
    pub fn patience<'w>(
        &'w mut self,
        barrier: &'w Barrier,
        stop: &'w Stop,
    ) -> impl FnMut() -> bool + 'w {
        move || !stop.requested() && self.look(barrier)
    }

    /// Why the patience ended, unless it was asked to stop.
    pub fn lost(&self) -> Option<SupervisorLost> {
        self.lost
    }

    /// The run went on: whoever moves it lives.
    pub fn went_on(&mut self) {
        self.dog.feed();
    }

    /// Looks, if it is time to: whether there is somebody to wait for. For whoever has nothing else
    /// to do; asks the kernel only while the supervisor makes no turns.
    pub fn look(&mut self, barrier: &Barrier) -> bool {
        let now_ns = clock::now_ns();
        if now_ns - self.looked_ns < LOOK_EVERY_NS {
            return true;
        }
        self.looked_ns = now_ns;
        let turns = barrier.turns();
        if std::mem::replace(&mut self.turns, turns) != turns {
            self.dog.feed();
            return true;
        }
        self.lost = self.judge(Sample::of(self.pid).ok()).err();
        self.lost.is_none()
    }

    /// `seen`: its process, if there is one of that id.
    fn judge(&mut self, seen: Option<Sample>) -> Result<(), SupervisorLost> {
        let seen = seen.filter(|seen| {
            seen.state != State::Gone && *self.started.get_or_insert(seen.started) == seen.started
        });
        self.dog.see(seen.ok_or(SupervisorLost::Gone)?);
        match self.dog.hung(self.limit) {
            Some(instead) => Err(SupervisorLost::Hung { limit: self.limit, instead }),
            None => Ok(()),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_supervisor_is_missed_when_gone_replaced_or_hung_and_not_when_stopped() {
        let directory = tempfile::tempdir().unwrap();
        let path = directory.path().join("barrier");
        let barrier = Barrier::create(&path, 1, 1, Duration::from_secs(3)).unwrap();
        let new = || SupervisorWatch::new(&barrier);
        // This very process made it, and may run.
        assert!(new().look(&barrier));
        let seen = |state, at_s: u64, started| {
            let computed = Duration::ZERO;
            Some(Sample { state, computed, at_ns: at_s * 1_000_000_000, started })
        };
        assert_eq!(new().judge(None), Err(SupervisorLost::Gone));
        assert_eq!(new().judge(seen(State::Gone, 0, 7)), Err(SupervisorLost::Gone));
        let mut watch = new();
        watch.judge(seen(State::Stopped, 0, 7)).unwrap();
        watch.judge(seen(State::Stopped, 3600, 7)).unwrap();
        assert_eq!(watch.judge(seen(State::Stopped, 3601, 8)), Err(SupervisorLost::Gone));
        for at_s in 4000..4003 {
            watch.judge(seen(State::Blocked, at_s, 7)).unwrap();
        }
        let lost = watch.judge(seen(State::Blocked, 4003, 7)).unwrap_err();
        assert_eq!(lost.to_string(), "no sign of life of the supervisor for 3 s while blocked");
        watch.went_on();
        watch.judge(seen(State::Blocked, 4004, 7)).unwrap();
        watch.judge(seen(State::Blocked, 4005, 7)).unwrap();
    }
}
