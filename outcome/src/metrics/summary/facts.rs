//! Texts of the facts about a run that need more than one number, and fields of `runs.csv`.

use protocol::stage::LatenessCause;

use super::{CommandCounts, GoalSummary, InformationAge, Summary};
use crate::columns::format_number;
use crate::metrics::blocked_robots::BlockedRobot;
use crate::report::digits::format_four_digits;

/// Maximum number of robots in a list. Of more robots, only those with the largest errors are named.
const SHOWN_ROBOTS_MAX: usize = 12;

/// Formats the smallest distance, its pair and time, and how often it was below d.
pub(super) fn format_min_distance(summary: &Summary) -> Option<String> {
    let [a, b] = summary.min_distance_pair.as_ref()?;
    let (distance, t_s) = (format_four_digits(summary.min_distance_m?), summary.min_distance_t_s?);
    let below = match summary.violations {
        0 => String::new(),
        ticks => format!(", below d at {ticks} ticks"),
    };
    Some(format!("{distance} m, {a} - {b} at {t_s:.3} s{below}"))
}

/// Formats the smallest distance from a wall or obstacle.
pub(super) fn format_min_clearance(summary: &Summary) -> Option<String> {
    let clearance = summary.min_clearance.as_ref()?;
    let position = clearance.describe(summary.clearance_violations);
    Some(format!("{} m, {position}", format_four_digits(clearance.distance_m)))
}

/// Formats the time of convergence, s.
pub(super) fn format_convergence(at_s: Option<f64>) -> String {
    at_s.map_or("never".into(), |t_s| format!("at {t_s:.3} s"))
}

/// Formats the messages and the beacons that carried them; `None` if no law sends messages.
pub(super) fn format_messages(summary: &Summary) -> Option<String> {
    let sum = |counts: &[(String, u64)]| counts.iter().map(|(_, sent)| sent).sum::<u64>();
    let (messages, beacons) = (sum(&summary.messages_sent), sum(&summary.beacons_sent));
    (!summary.messages_sent.is_empty()).then(|| format!("{messages} sent with {beacons} beacons"))
}

/// Formats the number of dropped messages; `None` if there are none.
pub(super) fn format_dropped_messages(summary: &Summary) -> Option<String> {
    let dropped: u64 = summary.messages_dropped.iter().map(|(_, dropped)| dropped).sum();
    (dropped > 0).then(|| dropped.to_string())
}

/// Formats the metrics of the experiment's own; `None` if there are none.
pub(super) fn format_metrics(metrics: &[(String, Option<f64>)]) -> Option<String> {
    (!metrics.is_empty()).then(|| format_error_list(metrics.iter()))
}

/// Formats the error of every robot; `None` with too many robots for that.
pub(super) fn format_all_errors(errors: &[(String, Option<f64>)]) -> Option<String> {
    (errors.len() <= SHOWN_ROBOTS_MAX).then(|| format_error_list(errors.iter()))
}

/// Formats the largest errors; `None` if there are few enough robots for [`format_all_errors`].
pub(super) fn format_largest_errors(errors: &[(String, Option<f64>)]) -> Option<String> {
    (errors.len() > SHOWN_ROBOTS_MAX).then(|| {
        let mut errors: Vec<_> = errors.iter().collect();
        errors.sort_by(|(_, a), (_, b)| b.partial_cmp(a).expect("errors are no NaN"));
        format_error_list(errors.into_iter().take(SHOWN_ROBOTS_MAX / 2))
    })
}

/// Formats values with their names.
fn format_error_list<'e>(values: impl Iterator<Item = &'e (String, Option<f64>)>) -> String {
    let fields = values
        .map(|(name, value)| format!("{name} {}", value.map_or("-".into(), format_four_digits)));
    fields.collect::<Vec<_>>().join("  ")
}

/// Formats the robots that are blocked at the end.
pub(super) fn format_blocked_robots(blocked: &[BlockedRobot]) -> Option<String> {
    let omitted = blocked.len().saturating_sub(SHOWN_ROBOTS_MAX);
    let descriptions: Vec<String> =
        blocked.iter().take(SHOWN_ROBOTS_MAX).map(BlockedRobot::describe).collect();
    let omitted = if omitted > 0 { format!("; and {omitted} more") } else { String::new() };
    (!blocked.is_empty()).then(|| format!("{}{omitted}", descriptions.join("; ")))
}

/// Formats run time, wall time and speed.
pub(super) fn format_times(Summary { t_s, ended_early, wall, .. }: &Summary) -> String {
    let ended_early = if *ended_early { ", ended early," } else { "" };
    format!(
        "{t_s:.3} s run{ended_early} in {:.3} s of wall time, {:.0} ticks/s, {:.2} x real time",
        wall.wall_s, wall.ticks_per_s, wall.real_time_factor
    )
}

/// Formats the commands by outcome.
pub(super) fn format_commands(commands: &CommandCounts) -> String {
    let CommandCounts { late, old, not_finite, scaled, expired, lost, .. } = commands;
    let refused = late + old + not_finite;
    format!("{refused} refused, {scaled} scaled, {expired} expired, {lost} lost")
}

/// Formats the lost ground-truth samples, with the gaps.
pub(super) fn format_lost_samples(
    Summary { truths_lost, unseen_s, .. }: &Summary,
) -> Option<String> {
    let gap = |[from, until]: &[f64; 2]| format!(", gap from {from:.3} s to {until:.3} s");
    let gaps: String = unseen_s.iter().map(gap).collect();
    (*truths_lost > 0).then(|| format!("{truths_lost}{gaps}"))
}

/// Formats the largest age of information.
pub(super) fn format_oldest_information(summary: &Summary) -> Option<String> {
    let InformationAge { robot, from, mean_ns, peak_ns, .. } = summary.oldest_information()?;
    let ms = |ns: f64| format_four_digits(ns / 1e6);
    let (mean, peak) = (ms(*mean_ns), ms(*peak_ns as f64));
    Some(format!("oldest {from} -> {robot}: mean {mean} ms, peak {peak} ms"))
}

/// Formats the late wake-ups by cause, and their effect.
pub(super) fn format_late_wake_ups(summary: &Summary) -> Option<String> {
    let late = summary.late_wake_ups_by_cause();
    if late.is_empty() {
        return None;
    }
    let total: u64 = late.iter().map(|&(_, count)| count).sum();
    let causes = late.iter().map(|(cause, count): &(LatenessCause, u64)| (cause.text(), count));
    let misses = match summary.deadline_misses {
        1 => "1 deadline miss".to_owned(),
        misses => format!("{misses} deadline misses"),
    };
    let effect = match (summary.deadline_misses, summary.commands.expired) {
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
    Some(format!("{total}: {}; {effect}", format_counts(causes)))
}

/// Formats the goals from outside by outcome.
pub(super) fn format_goals(GoalSummary { taken, refused }: &GoalSummary) -> String {
    let reasons = format_counts(refused.iter().map(|(reason, count)| (reason, count)));
    let reasons = if reasons.is_empty() { reasons } else { format!("; refused: {reasons}") };
    format!("{taken} accepted{reasons}")
}

/// Formats counts as `this 3, that 4`.
fn format_counts<'c>(counts: impl Iterator<Item = (impl std::fmt::Display, &'c u64)>) -> String {
    counts.map(|(label, count)| format!("{label} {count}")).collect::<Vec<_>>().join(", ")
}

/// Formats a field of a table; empty without a value.
pub(super) fn format_field(value: Option<f64>) -> String {
    value.map_or(String::new(), format_number)
}

/// Returns the sum of all values; `None` without values, or if one is missing.
pub(super) fn sum_if_complete(list: &[(String, Option<f64>)]) -> Option<f64> {
    let values: Option<Vec<f64>> = list.iter().map(|(_, value)| *value).collect();
    values.filter(|values| !values.is_empty()).map(|values| values.iter().sum())
}

/// Returns the times of arrival of the robots that arrived, s.
pub(super) fn arrival_times_s(summary: &Summary) -> Vec<f64> {
    summary.arrived_at_s.iter().filter_map(|(_, at_s)| *at_s).collect()
}

/// Returns the mean, or `None` without values.
pub(super) fn mean(values: &[f64]) -> Option<f64> {
    (!values.is_empty()).then(|| values.iter().sum::<f64>() / values.len() as f64)
}

/// Returns the longest time until the formation recovered from a fault, s; `None` if it did not recover from one.
pub(super) fn slowest_recovery_s(summary: &Summary) -> Option<f64> {
    let recovered = summary.faults.iter().map(|fault| fault.recovered_after_s);
    recovered.collect::<Option<Vec<f64>>>()?.into_iter().reduce(f64::max)
}
