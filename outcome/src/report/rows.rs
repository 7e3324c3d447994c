//! Facts and table rows of a finished run, shared by the screen and the page.

use protocol::brief::Pace;
use protocol::number::{format_distinct, format_short};
use protocol::stage::LatenessCause;

use crate::metrics::expect::{self, FAILED_ROBOTS_NAME, Verdict};
use crate::metrics::fault::FaultReport;
use crate::metrics::summary::{StageLatency, Summary};
use crate::quantities::Fact;
use crate::report::digits::format_four_digits;

/// Maximum number of robots in a list.
const SHOWN_ROBOTS_MAX: usize = 12;
/// Verdict on a run without expectations: it has neither passed nor failed.
const NO_EXPECTATIONS_VERDICT: &str =
    "no expectations declared; exit code 0 says that the run ended as planned";

/// Returns the verdict on a run as text, and as a value unless nothing was expected.
pub fn verdict(summary: &Summary) -> (&'static str, Option<Verdict>) {
    match (summary.interrupted, summary.exit, expect::worst_verdict(&summary.expectations)) {
        (true, ..) => ("interrupted", Some(Verdict::Missed)),
        (_, 4, _) => ("ended early", Some(Verdict::Missed)),
        _ if summary
            .expectations
            .iter()
            .any(|expectation| expectation.name == FAILED_ROBOTS_NAME) =>
        {
            ("a robot failed", Some(Verdict::Missed))
        }
        (.., None) => (NO_EXPECTATIONS_VERDICT, None),
        (.., Some(worst)) => (worst.describe_all(), Some(worst)),
    }
}

/// An expectation, formatted for a table.
pub struct ExpectationRow<'s> {
    /// Key of the expectation in the scenario.
    pub name: &'s str,
    /// Measured value, with enough digits to differ from the bound.
    pub measured_value: String,
    /// Bound with its relation.
    pub required_value: String,
    /// Verdict on the expectation.
    pub verdict: Verdict,
    /// Reason of a verdict that the value does not explain.
    pub reason: Option<&'s str>,
}

/// Returns all expectations in order.
pub fn expectation_rows(summary: &Summary) -> impl Iterator<Item = ExpectationRow<'_>> {
    summary.expectations.iter().map(|expectation| {
        let bound = expectation.bound;
        let (measured_value, bound) = match expectation.value {
            Some(value) => format_distinct(value, bound).into(),
            None => ("-".to_owned(), format_short(bound)),
        };
        ExpectationRow {
            name: &expectation.name,
            measured_value,
            required_value: format!("{} {bound}", expectation.relation()),
            verdict: expectation.verdict(),
            reason: expectation.reason.as_deref(),
        }
    })
}

/// Returns advice for a miss that the machine may have caused: deadlines were missed, and more than half of the
/// late wake-ups waited for a CPU core.
pub fn deadline_advice(summary: &Summary) -> Option<String> {
    if expect::worst_verdict(&summary.expectations)? != Verdict::Missed {
        return None;
    }
    let late = summary.late_wake_ups_by_cause();
    let total: u64 = late.iter().map(|&(_, count)| count).sum();
    let core_waits = late.iter().find(|(cause, _)| *cause == LatenessCause::Core)?.1;
    (summary.pace == Pace::Realtime && summary.deadline_misses > 0 && 2 * core_waits > total).then(|| {
        format!(
            "other programs occupied the cores ({core_waits} of {total} late wake-ups waited for a core); results with \
             `--pace lockstep` do not depend on that"
        )
    })
}

/// Returns the facts about a run: names and values, in order.
pub fn fact_rows(summary: &Summary) -> Vec<(String, String)> {
    let row = |fact: &Fact<Summary>| Some((fact.label.to_owned(), (fact.text)(summary)?));
    let hosts = summary.wall.hosts.iter();
    let hosts = hosts.map(|host| (format!("host {}", host.name), host.describe()));
    Summary::FACTS.iter().filter_map(row).chain(hosts).collect()
}

/// Column heads of the latency table and their widths on the screen. The first two columns are text.
pub const LATENCY_COLUMNS: [(&str, usize); 7] = [
    ("latency, us", 16),
    ("worst", 16),
    ("count", 9),
    ("p50", 9),
    ("p99", 9),
    ("p99.9", 9),
    ("max", 9),
];

/// Formats a row of the latency table.
pub fn format_latency_row(line: &StageLatency) -> [String; 7] {
    let format_us = |ns: u64| format_four_digits(ns as f64 / 1e3);
    let StageLatency { stage, count, p50_ns, p99_ns, p99_9_ns, max_ns, .. } = line;
    let [p50, p99, p99_9, max] = [*p50_ns, *p99_ns, *p99_9_ns, *max_ns].map(format_us);
    [stage.clone(), line.robot_or_edge_name(), count.to_string(), p50, p99, p99_9, max]
}

/// Maximum number of faults or repairs in a table of the screen or page, and of marks on a time line.
pub const SHOWN_ROWS_MAX: usize = 200;

/// Column heads of the fault table and their widths on the screen. The second column is text.
pub const FAULT_COLUMNS: [(&str, usize); 7] = [
    ("fault, s", 9),
    ("what", 28),
    ("stale, s", 9),
    ("lost, s", 9),
    ("peak err, m", 11),
    ("min dist, m", 11),
    ("recovered, s", 12),
];

/// Formats a row of the fault table.
pub fn format_fault_row(fault: &FaultReport) -> [String; 7] {
    [
        format!("{:.3}", fault.t_s),
        fault.what.clone(),
        format_or_dash(fault.stale_after_s),
        format_or_dash(fault.lost_after_s),
        format_four_digits(fault.peak_error_m),
        format_or_dash(fault.min_distance_m),
        format_or_dash(fault.recovered_after_s),
    ]
}

/// Column heads of the robots that a fault was predicted to break, was observed to break, affected, and orphaned.
pub const BROKEN_ROBOT_COLUMNS: [&str; 4] =
    ["predicted to break", "observed", "affected", "orphaned"];

/// Formats these four groups of robots.
pub fn format_broken_robots(fault: &FaultReport) -> [String; 4] {
    let groups = [&fault.predicted, &fault.broken, &fault.affected, &fault.orphaned];
    groups.map(|robots| match robots.as_slice() {
        [] => "none".to_owned(),
        [names @ .., _] if names.len() >= SHOWN_ROBOTS_MAX => {
            format!("{} and {} more", robots[..8].join(", "), robots.len() - 8)
        }
        names => names.join(", "),
    })
}

/// Formats a value, or a dash if there is none.
pub fn format_or_dash(value: Option<f64>) -> String {
    value.map_or("-".into(), format_four_digits)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn late_wake_ups_are_reported_with_cause_and_effect() {
        let mut summary = Summary::default();
        for (cause, count) in [(LatenessCause::Core, 3), (LatenessCause::Unknown, 4)] {
            let stage = cause.stage().keyword().to_owned();
            summary.wall.latency.push(StageLatency { stage, count, ..StageLatency::default() });
        }
        let late = |summary: &Summary| {
            fact_rows(summary).into_iter().find(|(name, _)| name == "late wake-ups").unwrap().1
        };
        let causes = late(&summary);
        assert!(causes.starts_with("7: ") && causes.contains("no cause found 4"), "{causes}");
        assert!(causes.ends_with("; no deadline was missed because of them"), "{causes}");
        summary.deadline_misses = 1;
        let missed = late(&summary);
        assert!(missed.ends_with("; with 1 deadline miss, and no robot stopped because of them"));
        summary.deadline_misses = 2;
        for (expired, times) in [(1, "once"), (6, "6 times")] {
            summary.commands.expired = expired;
            let expected = format!("; with 2 deadline misses; a robot stopped {times} because");
            assert!(late(&summary).contains(&expected), "{}", late(&summary));
        }
    }
}
