//! Recording of measured latencies and ages, which `latency_port` sends to the supervisor. The values are listed in
//! [`crate::stage`].
//!
//! A process only records values; the supervisor computes histograms of them, so no outlier is dropped and no
//! statistics are computed between two ticks. Must not: allocate, wait, or read a clock.

use crate::age::AgeSums;
use crate::message::{LatencyHeader, LatencyRow};
use crate::stage::Stage;
use crate::wake::StaggeredInterval;

/// Time in which a process sends at least one batch in real time, ns. A killed process loses at most the values of this
/// time.
const SEND_INTERVAL_NS: u64 = 100_000_000;
/// Minimum capacity of a recorder, in values. A batch is sent once half of it is used.
const CAPACITY_ROWS_MIN: usize = 1024;
/// Minimum capacity of a recorder, in ticks. The values not sent then cover twice the lead over the supervisor
/// that the plant may have in lockstep.
const CAPACITY_TICKS_MIN: usize = 16;

/// Returns the maximum number of values that a robot with this number of senders measures in one tick: of a wake-up, of
/// the cause of its lateness, of odometry and of the computation, and of the delivery and the age of each beacon.
pub fn robot_rows_per_tick(senders: usize) -> usize {
    4 + 2 * senders
}

/// Returns the capacity of a recorder for at most `rows_per_tick` values per tick: the maximum length of a batch.
pub fn recorder_capacity(rows_per_tick: usize) -> usize {
    CAPACITY_ROWS_MIN.max(CAPACITY_TICKS_MIN * rows_per_tick)
}

/// Recorded values that have not been sent.
#[derive(Debug)]
pub struct LatencyRecorder {
    rows: Vec<LatencyRow>,
    rows_max: usize,
    header: LatencyHeader,
    /// Number of values dropped since the last batch because the recorder was full.
    dropped_count: u64,
    last_send_ns: u64,
    send_interval: StaggeredInterval,
}

impl LatencyRecorder {
    /// Creates a recorder for at most `rows_per_tick` values per tick, with room for many ticks. `index`: that of the
    /// robot, from 1, or 0 for the plant, which determines when it sends.
    pub fn for_process(index: usize, incarnation: u64, rows_per_tick: usize) -> LatencyRecorder {
        LatencyRecorder {
            send_interval: StaggeredInterval::new(SEND_INTERVAL_NS, index),
            ..LatencyRecorder::new(incarnation, recorder_capacity(rows_per_tick))
        }
    }

    /// Creates a recorder with room for `rows_max` values.
    pub fn new(incarnation: u64, rows_max: usize) -> LatencyRecorder {
        LatencyRecorder {
            rows: Vec::with_capacity(rows_max),
            rows_max,
            header: LatencyHeader { incarnation, ..LatencyHeader::default() },
            dropped_count: 0,
            last_send_ns: 0,
            send_interval: StaggeredInterval::new(SEND_INTERVAL_NS, 0),
        }
    }

    /// Records one value, ns. `from`: scenario index, from 1, of the robot whose beacon or command was measured;
    /// 0 for none. If the recorder is full, the value is dropped and counted.
    #[inline]
    pub fn record(&mut self, stage: Stage, from: usize, value_ns: u64) {
        if self.rows.len() < self.rows_max {
            self.rows.push(LatencyRow { stage: stage as u32, from: from as u32, value_ns });
        } else {
            self.dropped_count += 1;
        }
    }

    /// Records the age sums of an edge since the last call. `from`: scenario index, from 1, of the sending robot.
    pub fn record_age(&mut self, from: usize, sums: &AgeSums) {
        let rows = sums.to_rows(from);
        if self.rows.len() + rows.len() <= self.rows_max {
            self.rows.extend(rows);
        } else {
            self.dropped_count += rows.len() as u64;
        }
    }

    /// Returns the capacity, in values: the maximum length of a batch.
    pub fn rows_max(&self) -> usize {
        self.rows_max
    }

    /// Counts samples that should have been received and were overwritten before.
    #[inline]
    pub fn count_lost_samples(&mut self, samples: u64) {
        self.header.samples_lost = self.header.samples_lost.saturating_add(samples);
    }

    /// Returns whether a batch should be sent at `now_ns`.
    #[inline]
    pub fn is_due(&self, now_ns: u64) -> bool {
        let begins_interval = self.send_interval.begins_between(self.last_send_ns, now_ns);
        !self.rows.is_empty() && (begins_interval || self.is_half_full())
    }

    /// Returns whether half of the capacity is used.
    #[inline]
    pub fn is_half_full(&self) -> bool {
        self.rows.len() >= self.rows_max / 2
    }

    /// Returns the batch to send.
    pub fn batch(&self) -> (LatencyHeader, &[LatencyRow]) {
        (self.header, &self.rows)
    }

    /// Begins the next batch, after the last one was sent at `now_ns`.
    pub fn begin_next_batch(&mut self, now_ns: u64) {
        self.header.first_row += self.rows.len() as u64 + std::mem::take(&mut self.dropped_count);
        self.rows.clear();
        self.last_send_ns = now_ns;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn batch_is_due_every_100_ms_or_at_half_capacity() {
        let mut recorder = LatencyRecorder::new(0, 4);
        assert!(!recorder.is_due(u64::MAX), "there is nothing to send");
        recorder.begin_next_batch(7);
        recorder.record(Stage::Wake, 0, 1);
        assert!(!recorder.is_due(SEND_INTERVAL_NS - 1));
        assert!(recorder.is_due(SEND_INTERVAL_NS));
        recorder.record(Stage::Wake, 0, 2);
        assert!(recorder.is_due(7));
    }

    #[test]
    fn dropped_values_leave_a_gap_in_row_numbers() {
        let mut recorder = LatencyRecorder::new(3, 4);
        (0..6).for_each(|value_ns| recorder.record(Stage::BeaconAge, 2, value_ns));
        let (header, rows) = recorder.batch();
        assert_eq!((header.incarnation, header.first_row, rows.len()), (3, 0, 4));
        assert_eq!(rows[3], LatencyRow { stage: 4, from: 2, value_ns: 3 });
        recorder.begin_next_batch(0);
        recorder.record(Stage::BeaconAge, 2, 6);
        assert_eq!(recorder.batch().0.first_row, 6);
    }
}
