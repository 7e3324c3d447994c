//! Readers of latencies: `latency_over_time.csv` and `latency.hlog`.

use std::path::Path;

use crate::report::run::{LatencyDistribution, LatencyInterval};
use base64::Engine as _;
use base64::engine::general_purpose::STANDARD;
use hdrhistogram::Histogram;
use hdrhistogram::serialization::Deserializer;
use hdrhistogram::serialization::interval_log::{IntervalLogIterator, LogEntry};

use super::ReportError;
use super::files::{for_each_line, read_file};

/// Relative distance within which points of a distribution are merged into the largest one, because a histogram has
/// thousands of values.
const MERGE_DISTANCE: f64 = 0.01;

/// Reads `latency_over_time.csv`. Without the file, because the run was cut short, the list is empty.
pub(super) fn read_latency_over_time(path: &Path) -> Result<Vec<LatencyInterval>, ReportError> {
    let mut intervals = Vec::new();
    for_each_line(path, |interval| {
        intervals.push(interval);
        Ok(())
    })?;
    Ok(intervals)
}

/// Reads `latency.hlog`. Without the file, because the run was cut short, the list is empty.
pub(super) fn read_latency_distributions(
    path: &Path,
) -> Result<Vec<LatencyDistribution>, ReportError> {
    let Some(text) = read_file(path)? else { return Ok(Vec::new()) };
    let malformed = |index: usize, message: String| {
        let message = format!("{message}; expected the log of histograms that a run writes");
        ReportError::MalformedLine(path.into(), index as u64 + 1, message)
    };
    let mut deserializer = Deserializer::new();
    let mut distributions = Vec::new();
    for (index, entry) in IntervalLogIterator::new(&text).enumerate() {
        let entry = entry.map_err(|error| malformed(index, format!("{error:?}")))?;
        let LogEntry::Interval(interval) = entry else { continue };
        let Some(tag) = interval.tag() else { continue };
        let Some((stage, robot_or_edge)) = tag.as_str().split_once(':') else { continue };
        let bytes = STANDARD.decode(interval.encoded_histogram());
        let bytes = bytes.map_err(|error| malformed(index, error.to_string()))?;
        let histogram: Histogram<u64> = deserializer
            .deserialize(&mut &bytes[..])
            .map_err(|error| malformed(index, error.to_string()))?;
        let exceedance = exceedance_curve(&histogram);
        distributions.push(LatencyDistribution {
            stage: stage.into(),
            robot_or_edge: robot_or_edge.into(),
            exceedance,
        });
    }
    Ok(distributions)
}

/// Returns values, ns, with the fraction of samples above each.
fn exceedance_curve(histogram: &Histogram<u64>) -> Vec<(u64, f64)> {
    let total = histogram.len() as f64;
    let mut count_above = histogram.len();
    let mut curve: Vec<(u64, f64)> = Vec::new();
    let mut group_start_ns = 0.0;
    for step in histogram.iter_recorded() {
        count_above = count_above.saturating_sub(step.count_since_last_iteration());
        let point = (step.value_iterated_to(), count_above as f64 / total);
        let value = point.0 as f64;
        let is_near = !curve.is_empty() && value <= group_start_ns * (1.0 + MERGE_DISTANCE);
        // The last point, with no sample above, is always kept.
        if is_near && count_above > 0 {
            *curve.last_mut().expect("it is near to something") = point;
        } else {
            group_start_ns = value;
            curve.push(point);
        }
    }
    curve
}
