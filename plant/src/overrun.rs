//! Overrun detection: whether the motion keeps up with real time. An external physics engine may be too slow.
//!
//! A single slow catch-up is tolerated, because the machine may be busy. But a catch-up that takes longer than
//! the time it covers makes the next one longer, without bound.

use formation::ns_to_seconds;

/// Maximum duration of the second slow catch-up in a row, ns. The run ends if it takes longer.
const CATCH_UP_NS_MAX: u64 = 1_000_000_000;

/// The motion is slower than real time.
#[derive(Debug, PartialEq, thiserror::Error)]
#[error(
    "the plant is slower than real time: moving the robots by {covered_time_s} s took {elapsed_time_s:.3} s; use a \
     faster plant, a longer `plant_tick_s` in `realtime`, or `--pace lockstep`"
)]
pub struct PlantTooSlow {
    covered_time_s: f64,
    elapsed_time_s: f64,
}

/// State of the overrun detection.
#[derive(Debug, Default)]
pub(crate) struct OverrunDetector {
    /// `true` if the previous catch-up took longer than the time it covered.
    previous_was_too_slow: bool,
}

impl OverrunDetector {
    /// Checks the current catch-up, which has advanced by `covered_ns` in `took_ns`. Returns an error if the
    /// motion is too slow.
    pub(crate) fn check(&self, covered_ns: u64, took_ns: u64) -> Result<(), PlantTooSlow> {
        if !self.previous_was_too_slow || took_ns <= covered_ns || took_ns <= CATCH_UP_NS_MAX {
            return Ok(());
        }
        Err(PlantTooSlow {
            covered_time_s: ns_to_seconds(covered_ns),
            elapsed_time_s: ns_to_seconds(took_ns),
        })
    }

    /// Records the end of the current catch-up.
    pub(crate) fn record_catch_up(&mut self, covered_ns: u64, took_ns: u64) {
        self.previous_was_too_slow = took_ns > covered_ns;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const NS_PER_MS: u64 = 1_000_000;

    #[test]
    fn growing_backlog_is_refused_and_a_single_stall_is_not() {
        // Catch-ups, as pairs of covered time and duration, ms.
        for (catch_ups, refused_s) in [
            (vec![(1, 1); 20], None),
            ((0..12).map(|power| (1 << power, 2 << power)).collect(), Some(1.024)),
            (vec![(1, 2000), (2000, 4_000_000)], Some(4000.0)),
            (vec![(1, 5000), (5000, 3000), (3000, 9000)], None),
        ] {
            let mut overrun = OverrunDetector::default();
            let took_s = catch_ups.into_iter().find_map(|(covered_ms, took_ms)| {
                let (covered_ns, took_ns) = (covered_ms * NS_PER_MS, took_ms * NS_PER_MS);
                let error = overrun.check(covered_ns, took_ns).err();
                overrun.record_catch_up(covered_ns, took_ns);
                error.map(|error| error.elapsed_time_s)
            });
            assert_eq!(took_s, refused_s);
        }
    }
}
