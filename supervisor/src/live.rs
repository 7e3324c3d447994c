//! Conversion of run data to the types of the live view.

use crate::view::{RunEvent, StageNow};

use formation::seconds;
use outcome::results::latency::Latency;
use run::journal::AddedEvent;

impl From<AddedEvent> for RunEvent {
    fn from(AddedEvent { t_ns, kind, robot, detail }: AddedEvent) -> RunEvent {
        RunEvent { t_s: seconds(t_ns), kind: kind.into(), robot, detail }
    }
}

/// Returns the present latency statistics of every stage.
pub(crate) fn stages(latency: &Latency) -> Vec<StageNow> {
    let us = |ns: u64| ns as f64 / 1e3;
    let stages = latency.latest().into_iter().map(|line| StageNow {
        worst: line.edge(),
        stage: line.stage,
        p50_us: us(line.p50_ns),
        p99_us: us(line.p99_ns),
        max_us: us(line.max_ns),
        count: line.count,
    });
    stages.collect()
}
