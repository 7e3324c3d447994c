//! Detection of times in which the supervisor itself did not run: its process was stopped, or its container
//! or machine was paused. No deadline counts that time, and deaths in it are processed before newer ground
//! truth.

use std::time::{Duration, Instant};

/// Minimum time between two iterations of the loop that counts as a standstill. An iteration takes a few
/// milliseconds; on a busy machine, some tenths of a second.
const STANDSTILL_MIN: Duration = Duration::from_secs(2);

/// The kind of the event.
pub(super) const EVENT_KIND: &str = "stood-still";

/// Measures the time between two iterations of the supervisor's loop.
#[derive(Debug)]
pub(super) struct StandstillDetector {
    last_iteration: Instant,
}

impl StandstillDetector {
    /// Starts to measure now.
    pub(super) fn new() -> StandstillDetector {
        StandstillDetector { last_iteration: Instant::now() }
    }

    /// Returns the time since the last iteration if that was a standstill.
    pub(super) fn detect_standstill(&mut self, now: Instant) -> Option<Duration> {
        let elapsed =
            now.saturating_duration_since(std::mem::replace(&mut self.last_iteration, now));
        (elapsed >= STANDSTILL_MIN).then_some(elapsed)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn standstill_is_a_long_time_between_iterations() {
        let mut standstill = StandstillDetector::new();
        let start = standstill.last_iteration;
        let after_ms = |ms: u64| start + Duration::from_millis(ms);
        assert_eq!(standstill.detect_standstill(after_ms(900)), None);
        assert_eq!(standstill.detect_standstill(after_ms(1_800)), None);
        assert_eq!(standstill.detect_standstill(after_ms(15_800)), Some(Duration::from_secs(14)));
        assert_eq!(standstill.detect_standstill(after_ms(15_801)), None);
    }
}
