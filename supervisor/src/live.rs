//! Conversion of run data to the types of the live view.

use crate::view::{RunEvent, StageLatency};

use outcome::results::latency::LatencyCollector;
use outcome::results::tables::EventLine;

impl From<EventLine> for RunEvent {
    fn from(EventLine { t_s, kind, robot, detail, other, .. }: EventLine) -> RunEvent {
        RunEvent { t_s, kind, robot, detail, other }
    }
}

/// Returns the present latency statistics of every stage.
pub(crate) fn summarize_stages(latency: &LatencyCollector) -> Vec<StageLatency> {
    let us = |ns: u64| ns as f64 / 1e3;
    let stages = latency.worst_stage_latencies().into_iter().map(|line| StageLatency {
        worst: line.robot_or_edge_name(),
        stage: line.stage,
        p50_us: us(line.p50_ns),
        p99_us: us(line.p99_ns),
        max_us: us(line.max_ns),
        count: line.count,
    });
    stages.collect()
}
