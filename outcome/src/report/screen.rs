//! Summary of a finished run on one screen: first the verdict, then its reasons.

use std::fmt::Write as _;

use crate::metrics::expect::Verdict;
use crate::metrics::summary::Summary;
use crate::report::rows::{
    BROKEN_ROBOT_COLUMNS, FAULT_COLUMNS, LATENCY_COLUMNS, SHOWN_ROWS_MAX, deadline_advice,
    expectation_rows, fact_rows, format_broken_robots, format_fault_row, format_latency_row,
    verdict,
};

/// Formats the summary of a run for the screen.
pub fn format_screen(summary: &Summary) -> String {
    let (verdict_text, _) = verdict(summary);
    let mut text = format!("{}, {}: {verdict_text}\n", summary.scenario, summary.pace.keyword());
    for expectation in expectation_rows(summary) {
        let verdict_label = match expectation.verdict {
            Verdict::Held => "held  ",
            Verdict::Missed => "MISSED",
            Verdict::Unseen => "UNSEEN",
        };
        let reason = expectation.reason.map_or(String::new(), |reason| format!(": {reason}"));
        let (name, measured_value) = (expectation.name, expectation.measured_value);
        let required = format!("required {}{reason}", expectation.required_value);
        append_line(
            &mut text,
            format_args!("  {verdict_label} {name:<23} {measured_value:>12}  {required}"),
        );
    }
    if let Some(advice) = deadline_advice(summary) {
        append_line(&mut text, format_args!("  {advice}"));
    }
    for (name, value) in fact_rows(summary) {
        append_line(&mut text, format_args!("{name:<19} {value}"));
    }
    let worst = summary.worst_latencies();
    if !worst.is_empty() {
        let row = |cells: [&str; 7]| align_columns(cells, LATENCY_COLUMNS, &[0, 1], " ");
        append_line(&mut text, format_args!("\n  {}", row(LATENCY_COLUMNS.map(|(head, _)| head))));
        // The latency of all robots is shown only if that of the control timer is known for comparison.
        let all = summary.wake_latency_pair().map(|[all, _]| all);
        for stage in all.into_iter().chain(worst) {
            append_line(
                &mut text,
                format_args!("  {}", row(format_latency_row(stage).each_ref().map(String::as_str))),
            );
        }
    }
    if let Some(first) = summary.faults.first() {
        let row = |[t_s, what, rest @ ..]: [&str; 7]| {
            let [(_, width), (_, what_width), widths @ ..] = FAULT_COLUMNS;
            format!("{t_s:>width$}  {what:<what_width$} {}", align_columns(rest, widths, &[], " "))
        };
        append_line(&mut text, format_args!("\n  {}", row(FAULT_COLUMNS.map(|(head, _)| head))));
        for fault in summary.faults.iter().take(SHOWN_ROWS_MAX) {
            append_line(
                &mut text,
                format_args!("  {}", row(format_fault_row(fault).each_ref().map(String::as_str))),
            );
            let [predicted, observed, affected, orphaned] = format_broken_robots(fault);
            let indent = "             ";
            append_line(
                &mut text,
                format_args!(
                    "{indent}{}: {predicted}; {}: {observed}; {}: {affected}",
                    BROKEN_ROBOT_COLUMNS[0], BROKEN_ROBOT_COLUMNS[1], BROKEN_ROBOT_COLUMNS[2]
                ),
            );
            for reason in &fault.predicted_why {
                append_line(&mut text, format_args!("{indent}  {reason}"));
            }
            if !fault.orphaned.is_empty() {
                append_line(
                    &mut text,
                    format_args!("{indent}{}: {orphaned}", BROKEN_ROBOT_COLUMNS[3]),
                );
            }
        }
        let count = summary.faults.len();
        if count > SHOWN_ROWS_MAX {
            append_line(
                &mut text,
                format_args!(
                    "  ... the first {SHOWN_ROWS_MAX} of {count} faults; summary.json has all"
                ),
            );
        }
        append_line(&mut text, format_args!("  {}", first.describe_broken()));
    }
    text
}

fn append_line(text: &mut String, line: std::fmt::Arguments<'_>) {
    // Writing to a string cannot fail.
    let _ = writeln!(text, "{line}");
}

/// Formats cells with these widths. Text is aligned to the left, numbers to the right.
fn align_columns<const N: usize>(
    cells: [&str; N],
    widths: [(&str, usize); N],
    text_columns: &[usize],
    separator: &str,
) -> String {
    let cell = |(index, (cell, (_, width))): (usize, (&str, (&str, usize)))| match text_columns
        .contains(&index)
    {
        true => format!("{cell:<width$}"),
        false => format!("{cell:>width$}"),
    };
    let cells: Vec<String> = cells.into_iter().zip(widths).enumerate().map(cell).collect();
    cells.join(separator)
}
