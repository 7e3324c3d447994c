//! Estimation of the time of the plant's host on another host.
//!
//! Each host has its own CLOCK_MONOTONIC, and two of them are never compared directly. As in NTP, four stamps
//! bound the offset: sent here, received there, sent back there, received here. The only assumption on the
//! network is that no message takes negative time; in particular the two directions need not be equally fast.

use std::collections::VecDeque;

/// Maximum age of a measurement that is used, ns.
const MEASUREMENT_AGE_NS_MAX: u64 = 30_000_000_000;
/// Maximum relative drift of two clocks: ten times that of quartz oscillators.
const RELATIVE_DRIFT_MAX: f64 = 100e-6;
/// Maximum number of stored measurements. Beyond it, the oldest one is dropped.
const STORED_MEASUREMENTS_MAX: usize = 512;

/// The four stamps of one measurement, ns.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct RoundTripStamps {
    /// Time of sending, by the local clock.
    pub sent_ns: u64,
    /// Time of reception, by the remote clock.
    pub remote_received_ns: u64,
    /// Time of sending back, by the remote clock.
    pub remote_sent_ns: u64,
    /// Time of reception, by the local clock.
    pub received_ns: u64,
}

impl RoundTripStamps {
    /// Returns the round-trip time without the time at the remote host, ns; `None` if the stamps are
    /// inconsistent.
    pub fn round_trip_ns(&self) -> Option<u64> {
        let remote_hold_ns = self.remote_sent_ns.checked_sub(self.remote_received_ns)?;
        self.received_ns.checked_sub(self.sent_ns)?.checked_sub(remote_hold_ns)
    }

    /// Returns the minimum and maximum offset (remote minus local) that these stamps allow, ns.
    fn offset_bounds_ns(&self) -> [i128; 2] {
        let [sent, remote_received, remote_sent, received] =
            [self.sent_ns, self.remote_received_ns, self.remote_sent_ns, self.received_ns]
                .map(i128::from);
        [remote_sent - received, remote_received - sent]
    }
}

/// Estimate of the offset of a remote clock.
#[derive(Debug, Clone, Default)]
pub struct ClockOffsetEstimator {
    /// Time by the local clock, and the two bounds, of each measurement.
    measurements: VecDeque<(u64, [i128; 2])>,
}

/// Bounds of the offset (remote minus local) at one time.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct OffsetBounds {
    low_ns: i128,
    high_ns: i128,
}

impl ClockOffsetEstimator {
    /// Adds a measurement. Returns `false` if its stamps are inconsistent.
    pub fn add_measurement(&mut self, stamps: &RoundTripStamps) -> bool {
        if stamps.round_trip_ns().is_none() {
            return false;
        }
        self.measurements.push_back((stamps.received_ns, stamps.offset_bounds_ns()));
        if self.measurements.len() > STORED_MEASUREMENTS_MAX {
            self.measurements.pop_front();
        }
        true
    }

    /// Returns the bounds at a time by the local clock, ns; `None` before the first measurement.
    pub fn bounds_at(&mut self, now_ns: u64) -> Option<OffsetBounds> {
        // An old measurement is dropped if there is a newer one.
        while self.measurements.len() > 1
            && self.measurements[0].0.saturating_add(MEASUREMENT_AGE_NS_MAX) < now_ns
        {
            self.measurements.pop_front();
        }
        loop {
            let bounds = self.intersect_bounds(now_ns)?;
            if bounds.low_ns <= bounds.high_ns {
                return Some(bounds);
            }
            // A clock was set, or its machine slept: only the newest measurement is kept.
            self.measurements.pop_front();
        }
    }

    fn intersect_bounds(&self, now_ns: u64) -> Option<OffsetBounds> {
        let widened = self.measurements.iter().map(|&(at_ns, [low, high])| {
            let drift = (now_ns.abs_diff(at_ns) as f64 * RELATIVE_DRIFT_MAX).ceil() as i128;
            [low - drift, high + drift]
        });
        let [low, high] =
            widened.reduce(|[a_low, a_high], [low, high]| [a_low.max(low), a_high.min(high)])?;
        Some(OffsetBounds { low_ns: low, high_ns: high })
    }
}

impl OffsetBounds {
    /// Offset of a host from itself.
    pub const SAME_CLOCK: OffsetBounds = OffsetBounds { low_ns: 0, high_ns: 0 };

    /// Returns the earliest local time that a remote stamp may mean, ns. With it, no sample is considered newer
    /// than it is.
    pub fn earliest_local_ns(&self, remote_ns: u64) -> u64 {
        clamp_ns(i128::from(remote_ns) - self.high_ns)
    }

    /// Returns the local time of a remote stamp at the middle of the bounds, ns. Its error is at most
    /// [`OffsetBounds::uncertainty_ns`].
    pub fn middle_local_ns(&self, remote_ns: u64) -> u64 {
        clamp_ns(i128::from(remote_ns) - self.middle_offset_ns())
    }

    /// Returns the earliest remote time that a local stamp may mean, ns.
    pub fn earliest_remote_ns(&self, local_ns: u64) -> u64 {
        clamp_ns(i128::from(local_ns) + self.low_ns)
    }

    /// Returns the remote time of a local stamp at the middle of the bounds, ns.
    pub fn middle_remote_ns(&self, local_ns: u64) -> u64 {
        clamp_ns(i128::from(local_ns) + self.middle_offset_ns())
    }

    /// Returns half the width of the bounds, ns: half of the shortest round-trip time, plus drift.
    pub fn uncertainty_ns(&self) -> u64 {
        clamp_ns((self.high_ns - self.low_ns) / 2)
    }

    fn middle_offset_ns(&self) -> i128 {
        self.low_ns + (self.high_ns - self.low_ns) / 2
    }
}

fn clamp_ns(ns: i128) -> u64 {
    ns.clamp(0, i128::from(u64::MAX)) as u64
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    /// Returns four stamps of two clocks, where the remote one is ahead by `offset_ns`.
    fn stamps(sent_ns: u64, offset_ns: u64, travel_ns: [u64; 2], hold_ns: u64) -> RoundTripStamps {
        let remote_received_ns = sent_ns + travel_ns[0] + offset_ns;
        let remote_sent_ns = remote_received_ns + hold_ns;
        let received_ns = remote_sent_ns + travel_ns[1] - offset_ns;
        RoundTripStamps { sent_ns, remote_received_ns, remote_sent_ns, received_ns }
    }

    #[test]
    fn equal_delays_give_the_exact_offset() {
        let mut offset = ClockOffsetEstimator::default();
        assert_eq!(offset.bounds_at(0), None);
        let measured = stamps(1_000, 86_400_000_000_000, [200, 200], 50);
        assert_eq!(measured.round_trip_ns(), Some(400));
        assert!(offset.add_measurement(&measured));
        let bounds = offset.bounds_at(measured.received_ns).unwrap();
        assert_eq!(bounds.uncertainty_ns(), 200);
        assert_eq!(bounds.middle_local_ns(86_400_000_005_000), 5_000);
        assert_eq!(bounds.middle_remote_ns(5_000), 86_400_000_005_000);
        assert_eq!(bounds.earliest_local_ns(86_400_000_005_000), 4_800);
        assert_eq!(bounds.earliest_remote_ns(5_000), 86_400_000_004_800);
    }

    #[test]
    fn inconsistent_stamps_are_refused() {
        let mut offset = ClockOffsetEstimator::default();
        let inconsistent = RoundTripStamps {
            sent_ns: 10,
            remote_received_ns: 5,
            remote_sent_ns: 5,
            received_ns: 9,
        };
        assert!(!offset.add_measurement(&inconsistent) && offset.bounds_at(100).is_none());
    }

    #[test]
    fn clock_jump_discards_old_measurements() {
        let mut offset = ClockOffsetEstimator::default();
        offset.add_measurement(&stamps(1_000, 1_000_000, [10, 10], 0));
        offset.add_measurement(&stamps(2_000, 9_000_000, [10, 10], 0));
        let bounds = offset.bounds_at(2_020).unwrap();
        assert_eq!(bounds.middle_remote_ns(0), 9_000_000);
    }

    proptest! {
        /// For any message delays, and for clocks that drift: age is never underestimated.
        #[test]
        fn sample_age_is_never_underestimated(
            offset_ns in 0u64..1_000_000_000_000,
            delays in proptest::collection::vec((0u64..50_000_000, 0u64..50_000_000, 0u64..1_000_000), 1..20),
            drift_ppm in -90i64..90,
            later_ns in 0u64..60_000_000_000,
        ) {
            // The remote clock runs faster or slower; local time is exact.
            let remote_time = |local_ns: u64| {
                offset_ns + (i128::from(local_ns) + i128::from(local_ns) * i128::from(drift_ppm) / 1_000_000) as u64
            };
            let mut offset = ClockOffsetEstimator::default();
            let mut now = 1_000_000_000;
            for (outgoing, returning, hold) in delays {
                let (remote_arrival, sent_back) = (now + outgoing, now + outgoing + hold);
                let received = sent_back + returning;
                offset.add_measurement(&RoundTripStamps {
                    sent_ns: now,
                    remote_received_ns: remote_time(remote_arrival),
                    remote_sent_ns: remote_time(sent_back),
                    received_ns: received,
                });
                now = received + 100_000_000;
            }
            let now = now + later_ns;
            let bounds = offset.bounds_at(now).unwrap();
            prop_assert!(bounds.earliest_local_ns(remote_time(now)) <= now + 1);
            prop_assert!(bounds.earliest_remote_ns(now) <= remote_time(now) + 1);
            prop_assert!(bounds.middle_local_ns(remote_time(now)).abs_diff(now) <= bounds.uncertainty_ns() + 1);
        }
    }
}
