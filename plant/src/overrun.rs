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

    #[test]
    fn a_plant_that_falls_ever_farther_behind_is_refused_after_a_second_and_one_that_was_stopped_is_not()
     {
        // Catch-ups, by how long they took for each time that they covered, ms.
        for (catch_ups, refused_s) in [
            (vec![(1, 1); 20], None),
            ((0..12).map(|power| (1 << power, 2 << power)).collect(), Some(1.024)),
            (vec![(1, 2000), (2000, 4_000_000)], Some(4000.0)),
            (vec![(1, 5000), (5000, 3000), (3000, 9000)], None),
        ] {
            let mut overrun = Overrun::default();
            let took_s = catch_ups.into_iter().find_map(|(covered_ms, took_ms)| {
                let (covered_ns, took_ns) = (covered_ms * MS, took_ms * MS);
                let refused = overrun.under_way(covered_ns, took_ns).err();
                overrun.over(covered_ns, took_ns);
                refused.map(|error| error.took_s)
            });
            assert_eq!(took_s, refused_s);
        }
    }
}
