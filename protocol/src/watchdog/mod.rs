//! Is a process that owes an answer hung, or is it only kept from giving it?
//!
//! Processor time that it uses without answering counts against it, and so does time in which it is
//! blocked. If it may expect a share of the wall time for itself, all of that share counts once it ran for a
//! tenth of it: whoever loops for ever on a busy machine is found by the clock on the wall, and whoever is kept
//! from running is not. Time in which it is stopped, or could run and has no processor, does not count: on a
//! busy machine that is nobody's fault. Nor does time in which nobody looked: whoever looks may have been
//! stopped as well. Pure but for [`Sample::of`]. Must not: wait, or end anybody.

mod sample;
mod supervisor;

use std::time::Duration;

pub use self::sample::{Sample, State};
pub use self::supervisor::{SupervisorLost, SupervisorWatch};

/// Of the time between two samples at most this much counts.
pub const GAP_MAX: Duration = Duration::from_secs(1);
/// A share of the wall time counts if the process ran for at least this much of it. An agent that answers needs a
/// thousandth of this; one that loops beside ten others on one core gets nearly all of it, and more on two.
const RAN_MIN: f64 = 0.1;

/// What a process did instead of answering.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Instead {
    /// It ran.
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
        self.see_with_share(sample, 0.0);
    }

    /// The same for a process that may expect `share` of the wall time for itself, from 0 to 1.
    pub fn see_with_share(&mut self, sample: Sample, share: f64) {
        let Some(last) = self.last.replace(sample) else { return };
        let between = Duration::from_nanos(sample.at_ns.saturating_sub(last.at_ns)).min(GAP_MAX);
        let mut computed = sample.computed.saturating_sub(last.computed);
        let stopped = [last.state, sample.state].contains(&State::Stopped);
        let expected = between.mul_f64(share);
        if !stopped && !computed.is_zero() && computed >= expected.mul_f64(RAN_MIN) {
            computed = computed.max(expected);
        }
        self.computed += computed;
        if (last.state, sample.state) == (State::Blocked, State::Blocked) {
            self.waited += between.saturating_sub(computed);
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
    /// Follows a time: `60 s while it ran`, `60 s while blocked`.
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(match self {
            Instead::Computed => "while it ran",
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
    fn processor_time_and_time_blocked_count_whatever_the_clock_says() {
        let spins = |times: u64| (0..=times).map(|i| (State::Runnable, i, i as f64 / 4.0));
        assert_eq!(after(spins(59)).hung(LIMIT), None);
        assert_eq!(after(spins(60)).hung(LIMIT), Some(Instead::Computed));
        let waits = |s: u64| (0..=s * 5).map(|i| (State::Blocked, 3, i as f64 / 5.0));
        assert_eq!(after(waits(59)).hung(LIMIT), None);
        assert_eq!(after(waits(60)).hung(LIMIT), Some(Instead::Waited));
        // What it used before it was looked at is not held against it.
        assert_eq!(after([(State::Runnable, 500, 0.0)]).hung(LIMIT), None);
    }

    /// A process that has `per_cent` of a processor, looked at five times a second.
    fn runs_at(per_cent: u64, share: f64, for_s: u64) -> Option<Instead> {
        let mut dog = Watchdog::default();
        for look in 0..=for_s * 5 {
            let computed = Duration::from_millis(2 * per_cent * look);
            let (state, at_ns) = (State::Runnable, look * 200_000_000);
            dog.see_with_share(Sample { state, computed, at_ns, started: 7 }, share);
        }
        dog.hung(LIMIT)
    }

    #[test]
    fn whoever_runs_for_a_tenth_of_its_share_is_found_by_the_clock_on_the_wall() {
        let computed = Some(Instead::Computed);
        // Alone, and beside others of the run who owe an answer as well.
        assert_eq!([59, 60].map(|for_s| runs_at(10, 1.0, for_s)), [None, computed]);
        assert_eq!([119, 120].map(|for_s| runs_at(5, 0.5, for_s)), [None, computed]);
        // Who has more than its share used that much.
        assert_eq!([59, 60].map(|for_s| runs_at(100, 0.5, for_s)), [None, computed]);
        // Kept from running by others, it has only used what it used.
        assert_eq!([666, 667].map(|for_s| runs_at(9, 1.0, for_s)), [None, computed]);
        assert_eq!(runs_at(0, 1.0, 100_000), None);
    }

    #[test]
    fn of_a_share_nothing_counts_while_the_process_is_stopped() {
        let states = [State::Runnable, State::Stopped, State::Runnable];
        let mut dog = Watchdog::default();
        for look in 0..10_000 {
            let (state, computed) = (states[look % 3], Duration::from_millis(look as u64));
            let at_ns = look as u64 * 1_000_000;
            dog.see_with_share(Sample { state, computed, at_ns, started: 7 }, 1.0);
        }
        // A third of the looks is between two at which it was not stopped.
        assert_eq!(dog.hung(Duration::from_secs(10)), None);
    }

    #[test]
    fn neither_who_has_no_processor_nor_who_is_stopped_is_hung_nor_who_is_blocked_now_and_then() {
        let (runnable, blocked, stopped) = (State::Runnable, State::Blocked, State::Stopped);
        for states in
            [[runnable; 4], [stopped; 4], [State::Gone; 4], [blocked, runnable, blocked, stopped]]
        {
            let dog = after((0..10_000).map(|i| (states[i % 4], 3, i as f64)));
            assert_eq!(dog.hung(LIMIT), None, "{states:?}");
        }
    }

    #[test]
    fn time_in_which_nobody_looked_does_not_count() {
        let dog = after([0.0, 0.5, 3600.0, 3600.5].map(|at_s| (State::Blocked, 0, at_s)));
        let hung = [60_000, 2000, 2001].map(|ms| dog.hung(Duration::from_millis(ms)));
        assert_eq!(hung, [None, Some(Instead::Waited), None]);
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
