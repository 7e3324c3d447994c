//! Whether what moves the bodies keeps up with real time: a physics engine may not.
//!
//! A machine that is busy is no reason to end a run: one catch-up may take as long as it likes. But one that takes
//! longer than the time that it lets pass makes the next one longer still, without end.

use formation::seconds;

/// A second catch-up in a row that is too slow ends the run once it has taken this long, ns.
const CATCH_UP_NS_MAX: u64 = 1_000_000_000;

/// What moves the bodies is slower than real time.
#[derive(Debug, PartialEq, thiserror::Error)]
#[error(
    "the plant is slower than real time: to move the robots by {covered_s} s it took {took_s:.3} s; expected a \
     faster plant, a longer `plant_tick_s` in `realtime`, or `--pace lockstep`"
)]
pub struct TooSlow {
    covered_s: f64,
    took_s: f64,
}

/// Looks at one catch-up after the other.
#[derive(Debug, Default)]
pub(crate) struct Overrun {
    /// The last catch-up took longer than it covered.
    before: bool,
}

impl Overrun {
    /// In the catch-up at hand, the robots were moved by `covered_ns` so far, which took `took_ns`.
    pub(crate) fn under_way(&self, covered_ns: u64, took_ns: u64) -> Result<(), TooSlow> {
        if !self.before || took_ns <= covered_ns || took_ns <= CATCH_UP_NS_MAX {
            return Ok(());
        }
        Err(TooSlow { covered_s: seconds(covered_ns), took_s: seconds(took_ns) })
    }

    /// The catch-up at hand is over.
    pub(crate) fn over(&mut self, covered_ns: u64, took_ns: u64) {
        self.before = took_ns > covered_ns;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const MS: u64 = 1_000_000;

    /// Catch-ups of a plant that needs `cost` times as long as it covers, from a backlog of 1 ms on; the
    /// seconds that the last one took, if it was refused.
    fn grows(cost: u64) -> Option<f64> {
        let (mut overrun, mut backlog_ns) = (Overrun::default(), MS);
        for _ in 0..20 {
            let took_ns = cost * backlog_ns;
            if let Err(error) = overrun.under_way(backlog_ns, took_ns) {
                return Some(error.took_s);
            }
            overrun.over(backlog_ns, took_ns);
            backlog_ns = took_ns.max(MS);
        }
        None
    }

    #[test]
    fn a_plant_that_falls_ever_farther_behind_is_refused_after_a_second() {
        assert_eq!(grows(0), None);
        assert_eq!(grows(1), None);
        assert_eq!(grows(2), Some(1.024));
        assert_eq!(grows(2000), Some(4000.0));
    }

    #[test]
    fn a_plant_that_was_stopped_for_a_while_and_catches_up_is_not() {
        let mut overrun = Overrun::default();
        for (covered_ns, took_ns) in
            [(MS, 5000 * MS), (5000 * MS, 3000 * MS), (3000 * MS, 9000 * MS)]
        {
            assert_eq!(overrun.under_way(covered_ns, took_ns), Ok(()));
            overrun.over(covered_ns, took_ns);
        }
    }
}
