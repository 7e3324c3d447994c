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
    let broken = |place: usize, what: String| {
        let what = format!("{what}; expected the log of histograms that a run writes");
        ReportError::MalformedLine(path.into(), place as u64 + 1, what)
    };
    let mut deserializer = Deserializer::new();
    let mut spreads = Vec::new();
    for (place, entry) in IntervalLogIterator::new(&text).enumerate() {
        let entry = entry.map_err(|error| broken(place, format!("{error:?}")))?;
        let LogEntry::Interval(interval) = entry else { continue };
        let Some(tag) = interval.tag() else { continue };
        let Some((stage, of)) = tag.as_str().split_once(':') else { continue };
        let bytes = STANDARD.decode(interval.encoded_histogram());
        let bytes = bytes.map_err(|error| broken(place, error.to_string()))?;
        let histogram: Histogram<u64> = deserializer
            .deserialize(&mut &bytes[..])
            .map_err(|error| broken(place, error.to_string()))?;
        let above = exceedance_curve(&histogram);
        spreads.push(LatencyDistribution {
            stage: stage.into(),
            robot_or_edge: of.into(),
            exceedance: above,
        });
    }
    Ok(spreads)
}

/// Returns values, ns, with the fraction of samples above each.
fn exceedance_curve(histogram: &Histogram<u64>) -> Vec<(u64, f64)> {
    let all = histogram.len() as f64;
    let mut larger = histogram.len();
    let mut told: Vec<(u64, f64)> = Vec::new();
    let mut first_of_group = 0.0;
    for step in histogram.iter_recorded() {
        larger = larger.saturating_sub(step.count_since_last_iteration());
        let now = (step.value_iterated_to(), larger as f64 / all);
        let value = now.0 as f64;
        let near = !told.is_empty() && value <= first_of_group * (1.0 + MERGE_DISTANCE);
        // The last point, with no sample above, is always kept.
        if near && larger > 0 {
            *told.last_mut().expect("it is near to something") = now;
        } else {
            first_of_group = value;
            told.push(now);
        }
    }
    told
}
