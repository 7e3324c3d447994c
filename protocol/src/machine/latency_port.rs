//! Sending of measured latencies and ages to the supervisor.

use crate::latency::LatencyRecorder;
use crate::machine::service::{Factory, Publisher, ServiceError, send_slice};
use crate::message::{LatencyHeader, LatencyRow};

/// Port through which the values of a [`LatencyRecorder`] are sent.
#[derive(Debug)]
pub struct LatencyPort {
    publisher: Publisher<[LatencyRow], LatencyHeader>,
}

impl LatencyPort {
    /// Creates a port for the batches of a recorder.
    pub fn new(
        service: &Factory<[LatencyRow], LatencyHeader>,
        recorder: &LatencyRecorder,
    ) -> Result<LatencyPort, ServiceError> {
        Ok(LatencyPort { publisher: service.publisher(recorder.rows_max())? })
    }

    /// Sends a batch if there is any value. A failure is only logged, because the robot must keep moving: the
    /// supervisor counts the missing values.
    pub fn send(&self, recorder: &mut LatencyRecorder, now_ns: u64) {
        let (header, rows) = recorder.batch();
        if rows.is_empty() {
            return;
        }
        if let Err(error) = send_slice(&self.publisher, header, rows.len(), |i| rows[i]) {
            tracing::warn!(%error, "latencies not sent");
        }
        recorder.begin_next_batch(now_ns);
    }

    /// Sends a batch if [`LatencyRecorder::is_due`].
    #[inline]
    pub fn send_if_due(&self, recorder: &mut LatencyRecorder, now_ns: u64) {
        if recorder.is_due(now_ns) {
            self.send(recorder, now_ns);
        }
    }
}
