//! Is a process that owes an answer hung, or is it only kept from giving it?
//!
//! Processor time that it uses without answering counts against it, and so does time in which it is
//! blocked. Time in which it is stopped, or could run and has no processor, does not: on a busy
//! machine that is nobody's fault. Nor does time in which nobody looked: whoever looks may have been
//! stopped as well. Pure but for [`Sample::of`]. Must not: wait, or end anybody.

mod sample;
mod supervisor;

use std::time::Duration;

pub use self::sample::{Sample, State};
pub use self::supervisor::{SupervisorLost, SupervisorWatch};

/// Of the time between two samples at most this much counts as blocked.
const GAP_MAX: Duration = Duration::from_secs(1);

/// What a process did instead of answering.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Instead {
    /// It used processor time.
    Computed,
    /// It waited for something.
    Waited,
}

/// How long a process has owed an answer, by what it did.
#[derive(Debug, Clone, Copy, Default)]
pub struct Watchdog {
    last: Option<Sample>,
    computed: Duration,
    waited: Duration,
}

impl Watchdog {
    /// It answered: begins anew.
    pub fn feed(&mut self) {
        *self = Watchdog::default();
    }

    /// Counts the time since the last sample. What happened before the first is not known.
    pub fn see(&mut self, sample: Sample) {
        let Some(last) = self.last.replace(sample) else { return };
        let computed = sample.computed.saturating_sub(last.computed);
        self.computed += computed;
        if (last.state, sample.state) == (State::Blocked, State::Blocked) {
            let between = Duration::from_nanos(sample.at_ns.saturating_sub(last.at_ns));
            self.waited += between.min(GAP_MAX).saturating_sub(computed);
        }
    }

    /// Whether it has owed an answer for `limit`, and what it mostly did meanwhile.
    pub fn hung(&self, limit: Duration) -> Option<Instead> {
        let mostly = match self.computed > self.waited {
            true => Instead::Computed,
            false => Instead::Waited,
        };
        (self.computed + self.waited >= limit).then_some(mostly)
    }
}

impl std::fmt::Display for Instead {
    /// Follows a time: `60 s of processor time`, `60 s while blocked`.
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(match self {
            Instead::Computed => "of processor time",
            Instead::Waited => "while blocked",
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const LIMIT: Duration = Duration::from_secs(60);

    /// A watchdog that saw these: state, processor time in s, time in s.
    fn after(samples: impl IntoIterator<Item = (State, u64, f64)>) -> Watchdog {
        let mut dog = Watchdog::default();
        for (state, computed_s, at_s) in samples {
            let computed = Duration::from_secs(computed_s);
            dog.see(Sample { state, computed, at_ns: (at_s * 1e9) as u64, started: 7 });
        }
        dog
    }

    #[test]
    fn processor_time_counts_whatever_the_clock_says() {
        let spins = |times: u64| (0..=times).map(|i| (State::Runnable, i, i as f64 / 4.0));
        assert_eq!(after(spins(59)).hung(LIMIT), None);
        assert_eq!(after(spins(60)).hung(LIMIT), Some(Instead::Computed));
        // What it used before it was looked at is not held against it.
        assert_eq!(after([(State::Runnable, 500, 0.0)]).hung(LIMIT), None);
    }

    #[test]
    fn time_blocked_counts() {
        let waits = |s: u64| (0..=s * 5).map(|i| (State::Blocked, 3, i as f64 / 5.0));
        assert_eq!(after(waits(59)).hung(LIMIT), None);
        assert_eq!(after(waits(60)).hung(LIMIT), Some(Instead::Waited));
    }

    #[test]
    fn neither_who_has_no_processor_nor_who_is_stopped_is_hung() {
        for state in [State::Runnable, State::Stopped, State::Gone] {
            let dog = after((0..10_000).map(|i| (state, 3, f64::from(i))));
            assert_eq!(dog.hung(LIMIT), None, "{state:?}");
        }
        // Nor who was blocked at one look and not at the next.
        let states = [State::Blocked, State::Runnable, State::Blocked, State::Stopped];
        let dog = after((0..10_000).map(|i| (states[i % 4], 3, i as f64)));
        assert_eq!(dog.hung(LIMIT), None);
    }

    #[test]
    fn time_in_which_nobody_looked_does_not_count() {
        let looked = [0.0, 0.5, 3600.0, 3600.5].map(|at_s| (State::Blocked, 0, at_s));
        let dog = after(looked);
        assert_eq!(dog.hung(LIMIT), None);
        assert_eq!(dog.hung(Duration::from_secs(2)), Some(Instead::Waited));
        assert_eq!(dog.hung(Duration::from_millis(2001)), None);
    }

    #[test]
    fn nothing_counts_twice_and_an_answer_clears_all() {
        let mut dog = after([(State::Blocked, 0, 0.0), (State::Blocked, 1, 1.0)]);
        assert_eq!(dog.hung(Duration::from_secs(1)), Some(Instead::Computed));
        assert_eq!(dog.hung(Duration::from_millis(1001)), None);
        dog.feed();
        assert_eq!(dog.hung(Duration::from_nanos(1)), None);
    }
}
