//! Facts and table rows of a finished run, shared by the screen and the page.

use protocol::brief::Pace;
use protocol::number::{format_distinct, short};
use protocol::stage::Cause;

use crate::metrics::blocked_robots::BlockedRobot;
use crate::metrics::expect::{self, FAILED_ROBOTS, Verdict};
use crate::metrics::fault::FaultReport;
use crate::metrics::summary::{Commands, GoalSummary, InformationAge, StageLatency, Summary};
use crate::report::digits::digits;

/// Maximum number of robots in a list. Of more robots, only those with the largest errors are named.
const ROBOTS_SHOWN: usize = 12;
/// Verdict on a run without expectations: it has neither passed nor failed.
const UNDECLARED: &str = "no expectations declared; exit code 0 says that the run ended as planned";

/// Returns the verdict on a run as text, and as a value unless nothing was expected.
pub fn verdict(summary: &Summary) -> (&'static str, Option<Verdict>) {
    match (summary.interrupted, summary.exit, expect::worst(&summary.expectations)) {
        (true, ..) => ("interrupted", Some(Verdict::Missed)),
        (_, 4, _) => ("ended early", Some(Verdict::Missed)),
        _ if summary.expectations.iter().any(|expectation| expectation.name == FAILED_ROBOTS) => {
            ("a robot failed", Some(Verdict::Missed))
        }
        (.., None) => (UNDECLARED, None),
        (.., Some(worst)) => (worst.describe_all(), Some(worst)),
    }
}

/// An expectation, formatted for a table.
pub struct ExpectationRow<'s> {
    /// Key of the expectation in the scenario.
    pub name: &'s str,
    /// Measured value, with enough digits to differ from the bound.
    pub measured: String,
    /// Bound with its relation.
    pub required: String,
    /// Verdict on the expectation.
    pub verdict: Verdict,
    /// Reason of a verdict that the value does not explain.
    pub reason: Option<&'s str>,
}

/// Returns all expectations in order.
pub fn expectations(summary: &Summary) -> impl Iterator<Item = ExpectationRow<'_>> {
    summary.expectations.iter().map(|expectation| {
        let bound = expectation.bound;
        let (measured, bound) = match expectation.value {
            Some(value) => format_distinct(value, bound).into(),
            None => ("-".to_owned(), short(bound)),
        };
        ExpectationRow {
            name: &expectation.name,
            measured,
            required: format!("{} {bound}", expectation.relation()),
            verdict: expectation.verdict(),
            reason: expectation.reason.as_deref(),
        }
    })
}

/// Returns advice for a miss that the machine may have caused: deadlines were missed, and more than half of the
/// late wake-ups waited for a CPU core.
pub fn advice(summary: &Summary) -> Option<String> {
    if expect::worst(&summary.expectations)? != Verdict::Missed {
        return None;
    }
    let late = summary.late_by_cause();
    let total: u64 = late.iter().map(|&(_, count)| count).sum();
    let waited = late.iter().find(|(cause, _)| *cause == Cause::Core)?.1;
    (summary.pace == Pace::Realtime && summary.deadline_misses > 0 && 2 * waited > total).then(|| {
        format!(
            "other programs occupied the cores ({waited} of {total} late wake-ups waited for a core); results with \
             `--pace lockstep` do not depend on that"
        )
    })
}

/// Returns the facts about a run: names and values, in order.
pub fn facts(summary: &Summary) -> Vec<(String, String)> {
    let mut facts = FactRows(Vec::new());
    facts.push_formation(summary);
    facts.push_run(summary);
    facts.push_losses(summary);
    facts.push_machine(summary);
    facts.0
}

struct FactRows(Vec<(String, String)>);

impl FactRows {
    fn push(&mut self, name: &str, value: impl Into<String>) {
        self.0.push((name.to_owned(), value.into()));
    }

    fn push_formation(&mut self, summary: &Summary) {
        if let (Some(distance_m), Some([a, b]), Some(t_s)) =
            (summary.min_distance_m, &summary.min_distance_pair, summary.min_distance_t_s)
        {
            let below = match summary.violations {
                0 => String::new(),
                ticks => format!(", below d at {ticks} ticks"),
            };
            let distance = digits(distance_m);
            self.push("smallest distance", format!("{distance} m, {a} - {b} at {t_s:.3} s{below}"));
        }
        if let Some(clearance) = &summary.min_clearance {
            let position = clearance.describe(summary.clearance_violations);
            let distance = digits(clearance.distance_m);
            self.push("smallest clearance", format!("{distance} m, {position}"));
        }
        if !summary.is_unjudged {
            let converged = summary.converged_at_s;
            let at = converged.map_or("never".into(), |t_s| format!("at {t_s:.3} s"));
            self.push("converged", at);
        }
        for (errors, all, largest) in [
            (&summary.final_error_m, "final errors, m", "largest errors, m"),
            (&summary.final_ideal_error_m, "ideal errors, m", "largest ideal, m"),
        ] {
            let mut errors: Vec<_> = errors.iter().collect();
            let few = errors.len() <= ROBOTS_SHOWN;
            if !few {
                errors.sort_by(|(_, a), (_, b)| b.partial_cmp(a).expect("errors are no NaN"));
                errors.truncate(ROBOTS_SHOWN / 2);
            }
            let shown =
                errors.iter().map(|(robot, error_m)| format!("{robot} {}", or_dash(*error_m)));
            self.push(if few { all } else { largest }, shown.collect::<Vec<_>>().join("  "));
        }
        if !summary.waits.is_empty() {
            let more = summary.waits.len().saturating_sub(ROBOTS_SHOWN);
            let shown = summary.waits.iter().take(ROBOTS_SHOWN).map(BlockedRobot::describe);
            let shown = shown.collect::<Vec<_>>().join("; ");
            let more = if more > 0 { format!("; and {more} more") } else { String::new() };
            self.push("blocked", format!("{shown}{more}"));
        }
        for (name, error_m) in [
            ("tracking error, m", summary.tracking_error_m_max),
            ("outside the hull, m", summary.hull_distance_m_max_final),
        ] {
            if let Some(error_m) = error_m {
                self.push(name, digits(error_m));
            }
        }
    }

    fn push_run(&mut self, summary: &Summary) {
        let wall = &summary.wall;
        let early = if summary.ended_early { ", ended early," } else { "" };
        self.push(
            "time",
            format!(
                "{:.3} s run{early} in {:.3} s of wall time, {:.0} ticks/s, {:.2} x real time",
                summary.t_s, wall.wall_s, wall.ticks_per_s, wall.real_time_factor
            ),
        );
        if let Some(hash) = &summary.trajectory_hash {
            self.push("trajectory hash", hash);
        }
        if !summary.messages_sent.is_empty() {
            let sum = |counts: &[(String, u64)]| counts.iter().map(|(_, sent)| sent).sum::<u64>();
            let (messages, beacons) = (sum(&summary.messages_sent), sum(&summary.beacons_sent));
            self.push("messages", format!("{messages} sent with {beacons} beacons"));
        }
        if let Some(hash) = &summary.message_hash {
            self.push("message hash", hash);
        }
        if summary.pace == Pace::Realtime {
            self.push("deadline misses", summary.deadline_misses.to_string());
        }
        let Commands { late, old, not_finite, scaled, expired, lost, .. } = summary.commands;
        let refused = late + old + not_finite;
        let commands =
            format!("{refused} refused, {scaled} scaled, {expired} expired, {lost} lost");
        self.push("commands", commands);
    }

    fn push_losses(&mut self, summary: &Summary) {
        let beacons: u64 = summary.beacons_refused.iter().map(|(_, refused)| refused).sum();
        if beacons > 0 {
            self.push("beacons", format!("{beacons} refused"));
        }
        if summary.truths_lost > 0 {
            let gaps = summary.unseen_s.iter();
            let gap = |[from, until]: &[f64; 2]| format!(", gap from {from:.3} s to {until:.3} s");
            let gaps: String = gaps.map(gap).collect();
            self.push("samples lost", format!("{}{gaps}", summary.truths_lost));
        }
        if summary.wall.latencies_lost > 0 {
            self.push("latencies lost", summary.wall.latencies_lost.to_string());
        }
    }

    fn push_machine(&mut self, summary: &Summary) {
        if let Some(InformationAge { robot, from, mean_ns, peak_ns, .. }) = summary.oldest() {
            let ms = |ns: f64| digits(ns / 1e6);
            let (mean, peak) = (ms(*mean_ns), ms(*peak_ns as f64));
            let oldest = format!("oldest {from} -> {robot}: mean {mean} ms, peak {peak} ms");
            self.push("information age", oldest);
        }
        let late = summary.late_by_cause();
        if !late.is_empty() {
            let total: u64 = late.iter().map(|&(_, count)| count).sum();
            let causes = late.iter().map(|(cause, count)| (cause.text(), count));
            let misses = match summary.deadline_misses {
                1 => "1 deadline miss".to_owned(),
                misses => format!("{misses} deadline misses"),
            };
            let harm = match (summary.deadline_misses, summary.commands.expired) {
                (0, _) => "no deadline was missed because of them".to_owned(),
                (_, 0) => format!("with {misses}, and no robot stopped because of them"),
                (_, expired) => {
                    let times = if expired == 1 { "once" } else { &format!("{expired} times") };
                    format!(
                        "with {misses}; a robot stopped {times} because a command was missing, which may \
                     affect errors and times"
                    )
                }
            };
            self.push("late wake-ups", format!("{total}: {}; {harm}", format_counts(causes)));
        }
        if let Some(GoalSummary { taken, refused }) = &summary.wall.goals {
            let reasons = format_counts(refused.iter().map(|(why, count)| (why, count)));
            let reasons =
                if reasons.is_empty() { reasons } else { format!("; refused: {reasons}") };
            self.push("goals from ROS 2", format!("{taken} accepted{reasons}"));
        }
        for host in &summary.wall.hosts {
            self.push(&format!("host {}", host.name), host.describe());
        }
    }
}

/// Formats counts as `this 3, that 4`.
fn format_counts<'c>(counts: impl Iterator<Item = (impl std::fmt::Display, &'c u64)>) -> String {
    counts.map(|(what, count)| format!("{what} {count}")).collect::<Vec<_>>().join(", ")
}

/// Column heads of the latency table and their widths on the screen. The first two columns are text.
pub const LATENCY: [(&str, usize); 7] = [
    ("latency, us", 16),
    ("worst", 16),
    ("count", 9),
    ("p50", 9),
    ("p99", 9),
    ("p99.9", 9),
    ("max", 9),
];

/// Formats a row of the latency table.
pub fn latency(line: &StageLatency) -> [String; 7] {
    let us = |ns: u64| digits(ns as f64 / 1e3);
    let StageLatency { stage, count, p50_ns, p99_ns, p99_9_ns, max_ns, .. } = line;
    let [p50, p99, p99_9, max] = [*p50_ns, *p99_ns, *p99_9_ns, *max_ns].map(us);
    [stage.clone(), line.edge(), count.to_string(), p50, p99, p99_9, max]
}

/// Maximum number of faults or repairs in a table of the screen or page, and of marks on a time line.
pub const ROWS_SHOWN: usize = 200;

/// Column heads of the fault table and their widths on the screen. The second column is text.
pub const FAULTS: [(&str, usize); 7] = [
    ("fault, s", 9),
    ("what", 28),
    ("stale, s", 9),
    ("lost, s", 9),
    ("peak err, m", 11),
    ("min dist, m", 11),
    ("recovered, s", 12),
];

/// Formats a row of the fault table.
pub fn fault(fault: &FaultReport) -> [String; 7] {
    [
        format!("{:.3}", fault.t_s),
        fault.what.clone(),
        or_dash(fault.stale_after_s),
        or_dash(fault.lost_after_s),
        digits(fault.peak_error_m),
        or_dash(fault.min_distance_m),
        or_dash(fault.recovered_after_s),
    ]
}

/// Column heads of the robots that a fault was predicted to break, was observed to break, affected, and orphaned.
pub const BROKEN: [&str; 4] = ["predicted to break", "observed", "affected", "orphaned"];

/// Formats these four groups of robots.
pub fn broken(fault: &FaultReport) -> [String; 4] {
    let all = [&fault.predicted, &fault.broken, &fault.affected, &fault.orphaned];
    all.map(|robots| match robots.as_slice() {
        [] => "none".to_owned(),
        [few @ .., _] if few.len() >= ROBOTS_SHOWN => {
            format!("{} and {} more", robots[..8].join(", "), robots.len() - 8)
        }
        few => few.join(", "),
    })
}

/// Formats a value, or a dash if there is none.
pub fn or_dash(value: Option<f64>) -> String {
    value.map_or("-".into(), digits)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn late_wake_ups_say_what_made_them_and_whether_they_did_harm() {
        let mut summary = Summary::default();
        for (cause, count) in [(Cause::Core, 3), (Cause::Unknown, 4)] {
            let stage = cause.stage().keyword().to_owned();
            summary.wall.latency.push(StageLatency { stage, count, ..StageLatency::default() });
        }
        let late = |summary: &Summary| {
            facts(summary).into_iter().find(|(name, _)| name == "late wake-ups").unwrap().1
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
            let words = format!("; with 2 deadline misses; a robot stopped {times} because");
            assert!(late(&summary).contains(&words), "{}", late(&summary));
        }
    }
}
